"""Packings with links or shapes on the way to jamming: Newton's method from pressure to pressure, FIRE with the box."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from packmech.contacts.network import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import pressure
from packmech.minimize.bodies_apart import separate
from packmech.minimize.second_order.soft_newton import SoftState, descend, find_bottom, judge
from packmech.packing import Packing
from packmech.protocols.continuation import Step, StepLengths, follow
from packmech.protocols.pressure_path import PressurePath, onset_depth, report_onset
from packmech.protocols.protocol import Protocol, at_packing_fraction, is_jammed
from packmech.result import Outcome

# lowest pressure over the smallest distance asked for, and its bounds: below, rounding of positions leaves too few
# digits of the overlaps; above, overlaps are no longer small [energy_scale / diameter^d]
_LOW, _LOWEST, _HIGHEST = 1e-3, 1e-10, 1e-8
# the second of the two packings on the line to the onset, in units of the pressure of the first
_SECOND = 0.5
_FIRE_TOLERANCE, _ONSET_STEPS = 1e-2, 200_000


class Onset(NamedTuple):
    """Packing fraction at which overlaps vanish, and the packing above: its state, how far above, its contacts."""

    fraction: float
    state: SoftState
    depth: float
    contacts: Contacts | ShapeContacts


def find_onset(protocol: Protocol, distance: float) -> Onset | None:
    """Return the onset of jamming of the scene's packing, or None when it is not jammed.

    Where contacts stay the same, overlaps grow in proportion to the packing fraction less its onset, whatever the law.
    The line through two packings at pressures far below that of the distance errs by the square of their overlaps.

    Parameters
    ----------
    protocol
        The protocol; stages and `jamming_packing_fraction` are added to it.
    distance
        The smallest packing fraction less onset that will be asked for [1].

    """
    scene = protocol.scene
    packing, now = scene.packing, pressure(scene) / scene.pressure_unit
    low = min(max(_LOW * distance, _LOWEST), _HIGHEST)
    resting = now >= _LOWEST and _onset_at(protocol, protocol.reduced(packing), now) is not None
    if not resting:
        packing, now = compress_linked(protocol, packing, PRESSED, _FIRE_TOLERANCE, _ONSET_STEPS)
        if now < PRESSED:
            return None
    low = min(low, now)
    start, outcome = packing, Outcome.STALLED
    if resting and is_jammed(scene):
        outcome = PressurePath(protocol).go(low)
        packing = protocol.last
        protocol.report["onset_rearrangements"] = protocol.report["rearrangements"]
    if not outcome.ok:
        # searches by FIRE lead on where contacts just touch, and may rearrange them
        packing, outcome = follow_pressure(protocol, start, now, low)
        protocol.report["onset_rearrangements"] = None
    if not outcome.ok:
        return None
    with protocol.stage("onset") as figures:
        first = _onset_at(protocol, protocol.reduced(packing), low)
        if first is None:
            figures.note = "not accepted: no stable balance"
            return None
        # on the line balance is enough: a contact that bears nothing may part and leave a motion that it held
        goal = protocol.reduced_pressure(_SECOND * low)
        last = descend(first.packing, protocol.units, protocol.basis_kdd, goal, watch=protocol.in_time)
        depths = [touching_pairs(state.packing).overlap_c.mean() for state in (last, first)]
        fractions = [packing_fraction(state.packing) for state in (last, first)]
        if not last.balanced(max(protocol.force_tolerance, 8.0 * last.floor)) or not depths[0] < depths[1]:
            figures.note = "not accepted: no balance with smaller overlaps at half the pressure"
            return None
        depth = float((fractions[1] - fractions[0]) / (depths[1] - depths[0]) * depths[1])
        figures.residual, figures.steps = last.residual, first.iterations + last.iterations
        figures.force_evaluations = first.evaluations + last.evaluations
        figures.note = f"the line through two packings, the first one {depth:.2e} above"
        protocol.last = protocol.restored(first.packing)
    onset = fractions[1] - depth
    protocol.report["jamming_packing_fraction"] = onset
    return Onset(onset, first, depth, touching_pairs(protocol.last))


def _onset_at(protocol: Protocol, packing: Packing, at: float) -> SoftState | None:
    """Return the packing, in reduced units, in stable balance at the pressure, or None."""
    state = _descended(protocol, packing, at, "onset")
    return state if state.sound(protocol.force_tolerance) else None


# each step of compression multiplies the packing fraction, until the pressure is this high [energy_scale / diameter^d]
_DENSER, _DENSEST, PRESSED = 1.03, 8.0, 1e-3
# mean contact force that counts as none [energy_scale / diameter]
_TOUCHING = 1e-6
# ratio of successive pressures: at first, the boldest, the one from which on searches take turns with shorter steps,
# and the one at which following is given up
_FIRST, _BOLDEST, _SEARCHED, _TIMID = (-math.log(ratio) for ratio in (0.3, 0.03, 0.8, 0.97))
_LENGTHS = StepLengths(_FIRST, _BOLDEST, growth=1.5, shortest=_SEARCHED, least=2.0 * _TIMID)
_FIRE_TOLERANCES = (1e-2, 1e-3, 1e-4)
_FIRE_STEPS = 20_000
# crystals of molecules lie in valleys whose walls are contacts that just touch: steps of Newton's method are no longer
# than those overlaps. Stop after so many searches, or force evaluations that led to no balance
_SEARCHES, _VAIN = 6, 8000


def decompress_linked(
    protocol: Protocol, start: float | None, pressure: float, tolerance: float, steps: int
) -> tuple[Packing, Outcome]:
    """Return the packing with links or shapes at the pressure, compressed, then decompressed, and how it ended.

    Deep overlaps are relaxed first, and compression goes by small steps, so that no links are pushed through each
    other, where they would lock.

    Parameters
    ----------
    protocol
        The protocol; stages are added to it.
    start
        Packing fraction to start at; None: as the packing stands.
    pressure
        Where to end [energy_scale / diameter^d].
    tolerance, steps
        Where FIRE stops in each box.

    """
    packing = protocol.scene.packing
    if start is not None:
        packing = at_packing_fraction(packing, start)
    packing, now = compress_linked(protocol, packing, max(PRESSED, pressure), tolerance, steps)
    if now < pressure:
        return packing, Outcome.NOT_JAMMED
    return follow_pressure(protocol, packing, now, pressure)


def compress_linked(
    protocol: Protocol, packing: Packing, until: float, tolerance: float, steps: int, denser: float = _DENSER
) -> tuple[Packing, float]:
    """Return the packing relaxed and compressed in turn until it presses as hard as asked for, and the pressure.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it.
    packing
        Where to start.
    until
        The pressure to press with [energy_scale / diameter^d]; less comes back where the packing never does.
    tolerance, steps
        Where FIRE stops in each box.
    denser
        What each step multiplies the packing fraction by.

    """
    with protocol.stage("compression") as figures:
        taken = 0
        while True:
            packing, separated = separate(protocol.program, packing)
            figures.steps += separated
            figures.force_evaluations += separated
            packing, done = protocol.relax(packing, tolerance, steps, floor=_TOUCHING)
            figures.residual = done.residual
            figures.steps += done.steps
            figures.force_evaluations += done.force_evaluations
            now = done.pressure / protocol.scene.pressure_unit if done.outcome is not Outcome.UNJAMMED else 0.0
            fraction = packing_fraction(packing)
            if now >= until or fraction > _DENSEST:
                break
            taken += 1
            protocol.loop.report("compression", packing_fraction=fraction, packing=packing)
            packing = at_packing_fraction(packing, fraction * denser)
        figures.note = f"FIRE after each of {taken} steps to packing fraction {fraction:.6f}, pressure {now:.2e}"
    return packing, now


def stabilize_linked(protocol: Protocol, pressure: float | None, step_limit: int) -> tuple[Packing, Outcome]:
    """Return the packing with links or shapes at rest in positions and strains, and how that ended.

    Parameters
    ----------
    protocol
        The protocol; stages are added to it.
    pressure
        Pressure to reach [energy_scale / diameter^d], from below or above; None holds the volume.
    step_limit
        Maximum number of FIRE steps in one box.

    """
    if pressure is not None and is_jammed(protocol.scene) and not (path := PressurePath(protocol)).sheared:
        outcome = path.go(pressure)
        return protocol.last, outcome
    if pressure is not None:
        packing, now = compress_linked(protocol, protocol.scene.packing, pressure, _FIRE_TOLERANCES[0], step_limit)
        if now < pressure:
            return packing, Outcome.NOT_JAMMED
        return follow_pressure(protocol, packing, now, pressure)
    with protocol.stage("quench") as figures:
        packing, separated = separate(protocol.program, protocol.scene.packing)
        packing, done = protocol.relax(packing, _FIRE_TOLERANCES[0], step_limit)
        figures.take(done)
        figures.steps += separated
        figures.force_evaluations += separated
        figures.note = "FIRE in the box as it is"
    if done.outcome is Outcome.UNJAMMED or not done.contacts:
        return packing, Outcome.UNJAMMED
    with protocol.stage("shear stabilization") as figures:
        state = _descended(protocol, protocol.reduced(packing), None, "shear stabilization")
        evaluations = state.evaluations
        if not (state.unjammed or state.sound(protocol.force_tolerance)):
            found, more = _searched(protocol, packing, None, "shear stabilization")
            state, evaluations = found or state, evaluations + more
        protocol.last = protocol.restored(state.packing)
        figures.steps, figures.force_evaluations = state.iterations, evaluations
        figures.residual, figures.note = state.residual, "Newton's method, going down"
    if state.unjammed:
        return protocol.last, Outcome.UNJAMMED
    return protocol.last, judge(state, protocol.force_tolerance)


def follow_pressure(protocol: Protocol, packing: Packing, start: float, goal: float) -> tuple[Packing, Outcome]:
    """Return the packing at the goal pressure, followed from one at about the start pressure, and how that ended.

    The box and with it the centers of clusters are scaled for the next pressure, then Newton's method takes positions,
    tensions and free strains there. Where it does not end in a stable balance, the step in pressure is shortened; where
    that does not help, FIRE with the box goes first.

    Parameters
    ----------
    protocol
        The protocol; one stage is added to it.
    packing
        Where to start.
    start, goal
        Pressures [energy_scale / diameter^d].

    """
    name = "decompression with links" if packing.links else "decompression"
    lengths = replace(_LENGTHS)
    now, end, vain, taken, searched = start, math.log(goal), 0, 0, 0

    def at(place: float) -> float:
        return goal if place == end else math.exp(place)

    with protocol.stage(name) as figures:

        def reach(state: SoftState, place: float, further: float) -> Step[SoftState, str] | None:
            nonlocal vain
            trial = _descended(protocol, state.packing, at(further), name)
            figures.steps += trial.iterations
            figures.force_evaluations += trial.evaluations
            if trial.sound(protocol.force_tolerance):
                return Step(trial, further)
            # a shorter step costs a few factorizations, a search thousands of passes
            if vain >= _VAIN:
                lengths.shortest = lengths.least = math.inf
            vain += trial.evaluations
            return None

        def search(state: SoftState, place: float, further: float) -> Step[SoftState, str] | None:
            nonlocal vain, searched
            found, evaluations = _searched(protocol, protocol.restored(state.packing), at(further), name)
            figures.force_evaluations += evaluations
            searched += 1
            if found is not None:
                return Step(found, further, "searched")
            vain += evaluations
            if searched >= _SEARCHES or vain >= _VAIN:
                lengths.least = math.inf
            return None

        first = _at(protocol, packing, now, name)
        if first is None:
            figures.note = "no balance at the first pressure"
            return protocol.last, Outcome.NOT_JAMMED
        state = first
        for step in follow(reach, state, math.log(now), end, lengths, search) if now > goal else ():
            taken += 1
            report_onset(protocol, onset_depth(state.packing), onset_depth(step.after.packing))
            state, now = step.after, at(step.place)
            protocol.last = protocol.restored(state.packing)
            figures.residual = state.residual
            protocol.loop.report(name, pressure=now, packing=protocol.last, residual=state.residual)
        figures.note = f"{taken} pressures, {searched} of them searched by FIRE with the box"
        if now > goal:
            contacts = len(touching_pairs(protocol.last))
            figures.note += (
                f"; given up in a valley that Newton's method follows too slowly between {contacts} contacts, "
                f"which is common in crystals; in balance at pressure {now:.2e}"
            )
            return protocol.last, Outcome.STALLED
    return protocol.restored(state.packing), judge(state, protocol.force_tolerance)


def _descended(protocol: Protocol, reduced: Packing, pressure: float | None, stage: str) -> SoftState:
    """Return the packing, in reduced units, that Newton's method going down reaches at a pressure or at its volume.

    Where it finds no balance, overlaps are smoothed first.
    """
    goal = None if pressure is None else protocol.reduced_pressure(pressure)
    watch = protocol.watcher(stage, reduced=True)
    return find_bottom(reduced, protocol.units, protocol.basis_kdd, goal, protocol.force_tolerance, watch=watch)


def _at(protocol: Protocol, packing: Packing, pressure: float, stage: str) -> SoftState | None:
    """Return the packing in stable balance at a pressure, or None."""
    state = _descended(protocol, protocol.reduced(packing), pressure, stage)
    return state if state.sound(protocol.force_tolerance) else _searched(protocol, packing, pressure, stage)[0]


def _searched(protocol: Protocol, packing: Packing, pressure: float | None, stage: str) -> tuple[SoftState | None, int]:
    """Return the packing that FIRE with the box and then Newton's method find, if any, and their force evaluations."""
    evaluations = 0
    watch = protocol.watcher(stage, reduced=False)
    for tolerance in _FIRE_TOLERANCES:
        done = protocol.relax_strained(packing, pressure, tolerance, _FIRE_STEPS, watch)
        packing = done.packing
        state = _descended(protocol, protocol.reduced(packing), pressure, stage)
        evaluations += state.evaluations
        if state.sound(protocol.force_tolerance):
            return state, evaluations
        if done.merit > tolerance or evaluations > _VAIN:
            break
    return None, evaluations
