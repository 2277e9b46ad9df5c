"""The default jamming protocol: a short quench, the exact hard packing by interior points, the soft packing from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from packmech.box import Box
from packmech.check import integer, positive, real
from packmech.constraints.projection import scale_box
from packmech.contacts.network import find_contacts
from packmech.contacts.shape_contacts import touching_pairs
from packmech.effects import at_distances
from packmech.jamming.hard_packing import HardPacking, HardState, certify, densify, search_hard, start_state
from packmech.jamming.hard_start import settled_start
from packmech.measure.counting import packing_fraction
from packmech.minimize.second_order.soft_newton import judge
from packmech.packing import Packing
from packmech.protocols.method import JamMethod
from packmech.protocols.pressure_path import follow_jammed
from packmech.protocols.protocol import Protocol, at_packing_fraction
from packmech.protocols.soft import (
    FIRST_DEPTH,
    depth_asked,
    first_soft,
    follow_pressure,
    press_large,
    search_down,
    search_pressure,
)
from packmech.result import Outcome

# the onset is first guessed this far below, relative to the packing fraction, and held within these bounds afterwards
_ONSET, _ONSETS = 0.03, (0.001, 0.2)
# dense enough that a quench ends jammed, and not much denser than the packing that is looked for
START = {2: 0.87, 3: 0.68}
# From so many particles on, rearrangements that would hold each other up in the search for the hard packing are left to
# FIRE at constant pressure: a step of the search costs as much as hundreds of steps of FIRE.
_LARGE = 1000
# mean relative overlap to settle at [1], and largest error of forces and stress [1]
_SETTLED, _SETTLED_TOLERANCE = 1e-3, 1e-2
# correctors of an interior-point step of packings as large
_CORRECTORS = 6
# A small packing's search takes 20 to 200 iterations. One that takes more goes in circles now and then: one of 144
# starts did, of 24 with 512 discs, three steps for ever. After so many it starts again as that of a large packing.
_CIRCLES = 500


def check_quench(start: float | None, tolerance: float, steps: int, *, minimum_steps: int = 1) -> None:
    """Check the settings of the quench that a method begins with."""
    if start is not None:
        positive("start_packing_fraction", start)
    real("quench_tolerance", tolerance, above=0.0, below=1.0)
    integer("quench_steps", steps, at_least=minimum_steps)


def decompress(
    protocol: Protocol, start: float, stop_pressure: float | None, factor: float, tolerance: float, steps: int
) -> Packing:
    """Return the packing decompressed to the stop pressure; the extrapolated packing fraction goes into the report.

    Parameters
    ----------
    protocol
        The protocol; one stage is added per box.
    start
        Packing fraction of the quench.
    stop_pressure
        Pressure to stop at [energy_scale / diameter^d]; None stops after the quench.
    factor
        Ratio of successive pressures [1].
    tolerance, steps
        Where FIRE stops in each box.

    """
    unit = protocol.scene.pressure_unit

    def relaxed(at: Packing, name: str) -> tuple[Packing, float]:
        with protocol.stage(name) as figures:
            packing, done = protocol.relax(at, tolerance, steps, floor=1e-3 * (stop_pressure or 0.0))
            figures.take(done)
            now = done.pressure / unit
            figures.note = f"FIRE at packing fraction {packing_fraction(packing):.6f}, pressure {now:.2e}"
        return packing, now if done.outcome is not Outcome.UNJAMMED else 0.0

    packing, pressure = relaxed(at_packing_fraction(protocol.scene.packing, start), "quench")
    fraction = packing_fraction(packing)
    slope = pressure / (_ONSET * fraction)
    last: tuple[float, float] | None = None
    while stop_pressure is not None and pressure > stop_pressure:
        target = max(factor, stop_pressure / pressure * 0.9)
        while True:
            there = fraction - pressure * (1.0 - target) / slope
            trial, found = relaxed(at_packing_fraction(packing, there), "decompression")
            if found > 0.0 or target > 0.9:
                break
            # unjammed: go back and ask for less
            target = float(np.sqrt(target))
        last = (fraction, pressure)
        if found <= 0.0:
            pressure = 0.0
            packing = trial
            break
        slope = (pressure - found) / (fraction - there)
        packing, pressure, fraction = trial, found, there
        slope = float(np.clip(slope, pressure / (_ONSETS[1] * fraction), pressure / (_ONSETS[0] * target * fraction)))
    if last is not None and 0.0 < pressure < last[1]:
        onset = fraction - pressure * (last[0] - fraction) / (last[1] - pressure)
        protocol.report["extrapolated_packing_fraction"] = onset
    return packing


def settle_at_pressure(protocol: Protocol, packing: Packing, steps: int) -> Packing:
    """Return the packing after FIRE in positions and free strains at constant pressure.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it.
    packing
        The packing after its quench; one that nothing presses stays as it is.
    steps
        Maximum number of FIRE steps.

    """
    reduced = protocol.reduced(packing)
    if not len(contacts := find_contacts(reduced, gap_tolerance=0.0)):
        return packing
    sigma = contacts.contact_distance_c
    force = -protocol.units.terms(at_distances(contacts, sigma * (1.0 - _SETTLED)))[0]
    pressure = float((force * sigma).sum()) / (packing.dimension * reduced.box.volume)
    with protocol.stage("settling") as figures:
        asked, watch = pressure / protocol.reduced_pressure(1.0), protocol.watcher("settling", reduced=False)
        done = protocol.relax_strained(packing, asked, _SETTLED_TOLERANCE, steps, watch)
        figures.residual, figures.steps, figures.force_evaluations = done.merit, done.steps, done.steps
        sound = done.merit < 1.0  # false of what is no number, too
        lost = "" if sound else "; lost its balance, and the quench stays"
        figures.note = f"FIRE in positions and free strains at overlaps of {_SETTLED:g}{lost}"
        protocol.last = done.packing if sound else packing
    return protocol.last


@dataclass(frozen=True)
class HardVertex(JamMethod):
    """Quench at a packing fraction, then find the exact hard packing nearby, then press it to the pressure asked for.

    FIRE stops early, at rough balance: what it is slow at (soft modes, contacts that flicker, rattlers) is left to an
    interior-point method that makes the hard packing denser at its true distances until contacts block every motion.
    From 1000 particles on FIRE also settles the packing at constant pressure, with the strains that are free, and a
    search that rearranges late goes back to wider barriers.
    Measured in two dimensions: 20-120 factorizations for N = 256, 28-74 for N = 1024, 53-206 for N = 4096 (medians 45
    and 90 of ten seeds). A smaller packing whose search has not ended after 500 goes on as a large one. The ensemble is
    that of this protocol; state it with every jamming packing fraction, and that packings below and from 1000 particles
    on are made in two ways, where sizes across that number are compared.

    Parameters
    ----------
    start_packing_fraction
        Where the quench happens; None: .87 in two dimensions, .68 in three, and where it stands for a jammed packing
        that is followed.
    stop_pressure
        FIRE goes on decompressing until the pressure is at most this [energy_scale / diameter^d]; None: the quench is
        enough.
    quench_tolerance
        Net force over mean contact force at which FIRE stops [1].
    quench_steps
        Maximum number of FIRE steps in one box.
    iteration_limit
        Maximum number of interior-point iterations.

    """

    honors = {"isotropic": "kinds", "free": "kinds"}

    start_packing_fraction: float | None = None
    stop_pressure: float | None = None
    quench_tolerance: float = 1e-3
    quench_steps: int = 200_000
    iteration_limit: int = 2000

    def __post_init__(self) -> None:
        check_quench(self.start_packing_fraction, self.quench_tolerance, self.quench_steps, minimum_steps=0)
        if self.stop_pressure is not None:
            positive("stop_pressure", self.stop_pressure)
        integer("iteration_limit", self.iteration_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        start = protocol.start_fraction(self.start_packing_fraction, START)

        def begin() -> Packing:
            near = decompress(protocol, start, self.stop_pressure, 0.15, self.quench_tolerance, self.quench_steps)
            return settle_at_pressure(protocol, near, self.quench_steps) if near.particles >= _LARGE else near

        def search(near: Packing) -> HardPacking | None:
            limit = self.iteration_limit
            # what is followed from where it stands must not rearrange
            if near.particles >= _LARGE or limit <= _CIRCLES or protocol.continues:
                return find_hard_packing(protocol, near, limit)
            hard = find_hard_packing(protocol, near, _CIRCLES)
            used = sum(one.steps for one in protocol.stages if one.name == "hard packing")
            if hard is not None or used < _CIRCLES:
                return hard
            settled = settle_at_pressure(protocol, near, self.quench_steps)
            return find_hard_packing(protocol, settled, limit - used, large=True)

        return jam_hard(protocol, pressure, begin, search)


def jam_hard(
    protocol: Protocol,
    pressure: float,
    begin: Callable[[], Packing],
    search: Callable[[Packing], HardPacking | None],
) -> tuple[Packing, Outcome]:
    """Return the packing at the pressure, by way of the exact hard packing or followed where it is jammed already.

    Parameters
    ----------
    protocol
        The protocol.
    pressure
        Pressure to reach [energy_scale / diameter^d].
    begin
        Returns the packing that is not jammed as it stands, relaxed near jamming.
    search
        Returns the exact hard packing near a packing, in reduced units, or None.

    """
    if protocol.continues:
        return follow_jammed(protocol, pressure, search)
    hard = search(begin())
    if hard is None:
        return protocol.last, Outcome.NOT_JAMMED
    return press(protocol, hard, pressure)


def find_hard_packing(
    protocol: Protocol, packing: Packing, iteration_limit: int, *, large: bool | None = None
) -> HardPacking | None:
    """Return the exact hard packing nearby, in reduced units, or None when none could be certified.

    Parameters
    ----------
    protocol
        The protocol; two stages are added to it, and the figures of the hard packing to its report.
    packing
        Where to start, in the scene's units.
    iteration_limit
        Maximum number of iterations.
    large
        Whether to search as in a large packing; None: where it is one.

    """
    reduced = protocol.reduced(packing)
    basis = protocol.basis_kdd
    load = float(packing.particles * packing.dimension)
    large = packing.particles >= _LARGE if large is None else large
    begin, correctors = (settled_start, _CORRECTORS) if large else (start_state, 0)
    state = begin(reduced.position_nd, reduced.box.lattice_dd, reduced.radius_n, load)

    def watch(now: HardState) -> None:
        protocol.loop.check_time()
        if now.iterations % 10 == 0:
            protocol.loop.report("hard packing", iteration=now.iterations, barrier=now.barrier, overlap=now.violation)

    def approach(before: HardState, barrier: float) -> HardState:
        with protocol.stage("hard packing") as figures:
            state = densify(
                before, reduced.radius_n, basis,
                barrier=barrier, iteration_limit=iteration_limit, correctors=correctors, retreats=large, watch=watch,
            )  # fmt: skip
            figures.residual, figures.steps = state.barrier, state.iterations - before.iterations
            figures.note = f"interior point, {figures.steps} factorizations; residual is the barrier"
            protocol.last = protocol.restored(reduced.replace(position_nd=state.position_nd, box=Box(state.lattice_dd)))
        return state

    def accept(state: HardState) -> HardPacking | None:
        return certified(protocol, state, reduced)

    return search_hard(state, reduced, basis, iteration_limit, approach=approach, accept=accept)[0]


def certified(protocol: Protocol, state: HardState, like: Packing) -> HardPacking | None:
    """Return the exact hard packing that a search has come close to, at a saddle perhaps; None where there is none.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it, and the figures of the hard packing to its report.
    state
        The end of a search.
    like
        A packing of these particles, in the state's units.

    """
    with protocol.stage("certificate") as figures:
        hard, reason = certify(state, like, protocol.basis_kdd)
        if hard is not None:
            figures.residual = hard.force_imbalance
            figures.note = f"{len(hard.contacts)} contacts, {hard.excess} more than needed for one state of self stress"
            _report_hard_packing(protocol, hard)
            if not hard.floppy_modes:
                return hard
            reason = f"a saddle: {hard.floppy_modes} motions that open contacts"
        figures.note = f"not accepted: {reason}"
        protocol.report["not_certified"] = reason
    return hard


def set_apart(packing: Packing) -> Packing | None:
    """Return the packing of discs or spheres with its box grown until none touch; None where overlaps exceed a tenth.

    Beyond the largest overlap it grows by no more than rounding asks for.
    """
    slack = np.finfo(float).eps
    while len(near := touching_pairs(packing)):
        overlap = max(0.0, float(near.overlap_c.max()))
        if overlap > 0.1:
            return None
        packing = scale_box(packing, (1.0 + slack) / (1.0 - overlap))
        slack *= 2.0
    return packing


def _report_hard_packing(protocol: Protocol, hard: HardPacking) -> None:
    """Put the figures of the hard packing into the report."""
    restored = protocol.restored(hard.packing)
    protocol.last = restored
    protocol.report.pop("not_certified", None)
    protocol.report.update(
        jamming_packing_fraction=packing_fraction(restored),
        hard_packing=restored,
        packing_below_onset=None if hard.floppy_modes else set_apart(restored),
        hard_contacts=len(hard.contacts),
        hard_excess_contacts=hard.excess,
        floppy_modes=hard.floppy_modes,
        gap_error=hard.gap_error,
        force_imbalance=hard.force_imbalance,
        smallest_force=float(hard.force_c.min() / hard.force_c.mean()),
        patches=hard.patches,
    )


def press(protocol: Protocol, hard: HardPacking, pressure: float) -> tuple[Packing, Outcome]:
    """Return the soft packing at the pressure [energy_scale / diameter^d], and how it ended.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it, and another where balance has to be searched for.
    hard
        The hard packing.
    pressure
        Pressure to reach.

    """
    goal = protocol.reduced_pressure(pressure)
    units, tolerance = protocol.units, protocol.force_tolerance
    large = hard.packing.particles >= _LARGE
    if large and depth_asked(hard, units, goal) > FIRST_DEPTH:
        state = press_large(protocol, hard, goal)
        return protocol.restored(state.packing), judge(state, tolerance)
    with protocol.stage("soft packing") as figures:
        state = follow_pressure(hard, units, protocol.basis_kdd, goal, tolerance=tolerance, watch=protocol.in_time)
        figures.residual, figures.steps, figures.force_evaluations = state.residual, state.iterations, state.iterations
        figures.note = "Newton's method from the hard packing"
        protocol.last = protocol.restored(state.packing)
        # a large one goes down from where the way began sooner than on from where it ended
        down = state.reached < 1.0 and large
        start = first_soft(hard, units, protocol.basis_kdd, goal) if down else state.packing
    if state.reached < 1.0:
        state = search_down(protocol, start, goal) if down else search_pressure(protocol, start, goal)
    return protocol.restored(state.packing), judge(state, tolerance)
