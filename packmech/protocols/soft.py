"""From the hard packing to the soft one at a small pressure: the law gives the overlaps, Newton's method the rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.constraints.projection import scale_box
from packmech.contacts.network import candidate_pairs, pair_contacts
from packmech.contacts.pairs import are_among
from packmech.effects import at_distances
from packmech.jamming.hard_packing import ContactSystem, HardPacking, contact_system
from packmech.minimize.second_order.soft_network import Load, Units, scaled_load
from packmech.minimize.second_order.soft_newton import SoftState, descend, find_bottom, newton
from packmech.packing import Packing
from packmech.protocols.continuation import Step, StepLengths, follow
from packmech.protocols.protocol import Protocol

# Net forces over the mean contact force that FIRE goes to, each time Newton's method finds no balance from the last.
# Measured in the plane, N = 1024, five packings at pressures 1e-5, 1e-4 and 1e-3 each: from 1e-4 Newton's method ended
# in balance in 14 of 15 searches, from 1e-3 in 4, and one that does not costs as much as 2000 steps of FIRE.
_SEARCHED_TO = (1e-4, 1e-5, 9e-7)
_FIRE_STEPS = 30_000
# largest number of Newton's steps from one packing on a way to the next
_NEWTON_STEPS = 25
# and of those that only go down from the first soft packing of 1000 particles before FIRE is asked; of others they grow
# as the square root of their number
_DOWNHILL = 80
# mean relative overlap up to which the soft packing is as good as one linear step from the hard one
FIRST_DEPTH = 1e-7
# gaps up to this fraction of the contact distance may close on the way to the first soft packing
_NEAR = 1e-3
_SWITCHES = 60
_OPEN, _FURTHEST = 1e-9, 1e6
_ROUNDS, _TURN = 8, 1e-3
# motion on the way to a small overlap that is none [mean diameter]
_TOO_FAR = 0.1
# where rounding of positions leaves no digits of the overlaps
_MINIMUM_DEPTH = 1e-11
# steps in the logarithm of the depth
_DEEPER = StepLengths(
    next=math.log(4.0), longest=math.log(4.0), growth=1.5, shortest=2.0 * math.log(1.02)
)  # fmt: skip
# Large packings rearrange at so many pressures that steps that fail are halved only once: FIRE finds the way sooner.
_LARGE, _GIVEN_UP = 1000, math.log(2.0)
# Mean relative overlap up to which Newton's method goes from the first soft packing of a large one, beyond which FIRE
# goes from the hard one with its box shrunk: somewhat above 1e-6, which a pressure of 1e-6 asks for. Measured in the
# plane, seconds from the first and of FIRE: N = 1024 at 1e-6, ten seeds, .04 to .25 (one 4.3) and .1 to 1.6, of which
# one ended on a saddle, at 1e-5, three seeds, .4 to 1.0 and .3 to 1.1; N = 4096 at 1e-5, two, 10 to 13 and 3.5.
_FROM_FIRST = 2e-6


def search_pressure(protocol: Protocol, start: Packing, goal: float | Load, *, downhill: int = 0) -> SoftState:
    """Return the packing at the load: FIRE in positions and free strains until it is near, then Newton's method.

    Links and shapes go down by Newton's steps, discs too where nothing else brought them to balance. The network
    rearranges on the way; the stage's note says so.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it.
    start
        A packing in balance at another pressure, in reduced units.
    goal
        Pressure or load to reach, in reduced units.
    downhill
        Largest number of Newton's steps that go down, before FIRE is asked.

    """
    enough = protocol.force_tolerance
    with protocol.stage("soft packing, searched") as figures:
        if downhill:
            figures.note = "Newton's steps that go down"
            best = descend(start, protocol.units, protocol.basis_kdd, goal, iterations=downhill, watch=protocol.in_time)
            figures.steps, figures.force_evaluations = best.iterations, best.evaluations
            figures.residual, start = best.residual, best.packing
            protocol.last = protocol.restored(start)
            if best.sound(enough):
                return best
        figures.note = "FIRE with the box, then Newton's method"
        asked = scaled_load(goal, 1.0 / protocol.reduced_pressure(1.0))
        packing = protocol.restored(start)
        for tolerance in _SEARCHED_TO:
            done = protocol.relax_strained(packing, asked, tolerance, _FIRE_STEPS)
            packing = protocol.last = done.packing
            near = protocol.reduced(packing), protocol.units, protocol.basis_kdd, goal
            if packing.plain:
                best = newton(*near, watch=protocol.in_time)
            else:
                best = find_bottom(*near, enough, watch=protocol.in_time)
            figures.steps += done.steps + best.iterations
            figures.force_evaluations += done.steps + best.evaluations
            if best.sound(enough) or done.merit > tolerance:
                break
        if packing.plain and not best.sound(enough):
            # of discs FIRE finds the way sooner; steps that only go down leave the saddle where it came to its end
            figures.note += ", and by its steps that go down"
            lower = find_bottom(*near, enough, watch=protocol.in_time)
            figures.steps += lower.iterations
            figures.force_evaluations += lower.evaluations
            best = min(best, lower, key=lambda one: (one.negative, one.residual + one.stress_error))
        protocol.last = protocol.restored(best.packing)
        figures.residual = best.residual
    return best


def equilibrium(protocol: Protocol, packing: Packing, load: float | Load | None) -> SoftState:
    """Return the balance nearby under a load: by Newton's method, with links or shapes by its steps that go down."""
    units, basis_kdd = protocol.units, protocol.basis_kdd
    if packing.plain:
        return newton(packing, units, basis_kdd, load, iterations=_NEWTON_STEPS, watch=protocol.in_time)
    return descend(packing, units, basis_kdd, load, watch=protocol.in_time)


def first_soft(hard: HardPacking, units: Units, basis_kdd: NDArray[np.float64], pressure: float) -> Packing:
    """Return the packing in which the contacts of the hard one overlap as its forces ask for, to first order.

    The forces, scaled to the pressure, give each contact its overlap and so its secant stiffness. Contacts that would
    pull open, near pairs that would overlap close: the springs are one-sided, their energy convex, and Newton's
    method with an exact line search finds its minimum.

    Parameters
    ----------
    hard
        The hard packing.
    units, basis_kdd, pressure
        As in `newton`.

    """
    packing, bearing = hard.packing, hard.contacts
    scale = pressure * packing.box.volume / packing.particles
    sigma = bearing.contact_distance_c
    secant = hard.force_c * scale / (units.overlap_of(hard.force_c * scale, bearing) * sigma)
    unit = float(secant.mean())
    load_k = np.einsum("kaa->k", basis_kdd) * (packing.particles * scale / unit)
    # pairs that all but touch may close under the load: soft motions are thousands of times larger than overlaps
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 + _NEAR)
    contacts = pair_contacts(packing, *pairs)
    bears = are_among(contacts, bearing)
    gap = np.where(bears, 0.0, np.maximum(contacts.gap_c, 0.0))
    stiffness = np.ones(len(contacts))
    stiffness[bears] = secant / unit
    depth = float((hard.force_c * scale / secant).mean())
    closed = bears
    for _ in range(_ROUNDS):
        network = contact_system(contacts, basis_kdd, bearing.count_n() > 0)
        u_nd, strain_k, closed = _one_sided(network, gap, stiffness, load_k, closed)
        # beside stiffnesses that are millions of times larger the smallest is lost in rounding, and nothing is held
        if not float(np.abs(u_nd).max()) < _TOO_FAR:
            break
        packing = network.moved(packing, u_nd, strain_k)
        # contacts turn by u / r, which changes lengths by u^2 / r: linearize again while that matters
        if float(np.abs(u_nd).max()) ** 2 < _TURN * depth:
            break
        contacts = pair_contacts(packing, *pairs)
        gap = contacts.gap_c
    return packing


def _one_sided(
    network: ContactSystem,
    gap: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    load_k: NDArray[np.float64],
    closed: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return the motion of one-sided springs to balance under the load, and which of them end closed."""
    u_nd, strain_k = np.zeros(network.shape), np.zeros(len(load_k))
    extension = np.zeros(len(gap))
    for _ in range(_SWITCHES):
        push = stiffness * np.maximum(-extension - gap, 0.0)
        try:
            # open contacts keep a trace of stiffness: with too few closed ones the system would be singular
            network.prepare(np.where(closed, stiffness, _OPEN * stiffness))
            du_nd, dstrain_k = network.solve(network.gather(push), network.stretch_ck.T @ push - load_k)
        except np.linalg.LinAlgError:
            break
        growth = network.extend(du_nd, dstrain_k)
        size = _lowest(extension, growth, gap, stiffness, float(load_k @ dstrain_k))
        u_nd, strain_k, extension = u_nd + size * du_nd, strain_k + size * dstrain_k, extension + size * growth
        now = extension < -gap
        if size > 0.999 and (now == closed).all():
            break
        closed = now
    return u_nd, strain_k, closed


def _lowest(
    extension: NDArray[np.float64],
    growth: NDArray[np.float64],
    gap: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    work: float,
) -> float:
    """Return how far along a step the energy of one-sided springs under the load is lowest; it is convex."""

    def slope(size: float) -> float:
        overlap = np.maximum(-(extension + size * growth) - gap, 0.0)
        return work - float((stiffness * overlap) @ growth)

    low, high = 0.0, 1.0
    while slope(high) < 0.0 and high < _FURTHEST:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
    # a full Newton step is exact while no contact switches
    middle = 0.5 * (low + high)
    return 1.0 if abs(middle - 1.0) < 1e-9 else middle


def depth_asked(hard: HardPacking, units: Units, pressure: float) -> float:
    """Return the mean relative overlap that the forces of a hard packing ask for at a pressure in reduced units."""
    scale = pressure * hard.packing.box.volume / hard.packing.particles
    return float(units.overlap_of(hard.force_c * scale, hard.contacts).mean())


def press_large(protocol: Protocol, hard: HardPacking, goal: float) -> SoftState:
    """Return the soft packing at the pressure that a large hard packing is pressed to, at one go.

    Large packings rearrange at so many pressures that those pressed deeper than `FIRST_DEPTH` are not followed: where
    Newton's method from the first soft packing does not end in balance, its steps that go down do, or FIRE finds the
    way.

    Parameters
    ----------
    protocol
        The protocol; a stage or two are added to it.
    hard
        The hard packing.
    goal
        Pressure to reach, in reduced units.

    """
    units, basis_kdd = protocol.units, protocol.basis_kdd
    depth = depth_asked(hard, units, goal)
    if depth > _FROM_FIRST:
        return search_pressure(protocol, scale_box(hard.packing, 1.0 / (1.0 + depth)), goal)
    with protocol.stage("soft packing") as figures:
        start = first_soft(hard, units, basis_kdd, goal)
        state = newton(start, units, basis_kdd, goal, iterations=_NEWTON_STEPS, watch=protocol.in_time)
        figures.residual, figures.steps, figures.force_evaluations = state.residual, state.iterations, state.evaluations
        figures.note = "Newton's method from the hard packing"
        protocol.last = protocol.restored(state.packing)
    sound = state.sound(protocol.force_tolerance)
    return state if sound else search_down(protocol, start, goal)


def search_down(protocol: Protocol, start: Packing, goal: float) -> SoftState:
    """Return the packing that Newton's steps go down to from the first soft one of a large packing, or FIRE finds.

    Parameters
    ----------
    protocol, start, goal
        As in `search_pressure`.

    """
    downhill = round(_DOWNHILL * math.sqrt(start.particles / _LARGE))
    return search_pressure(protocol, start, goal, downhill=downhill)


def follow_pressure(
    hard: HardPacking,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float,
    *,
    tolerance: float = 1e-5,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the soft packing at the pressure, followed from the exact hard one.

    Where the pressure asks for overlaps above 1e-7 the packing is taken there in steps, each at most four times
    deeper than the one before and halved (in the logarithm) when Newton's method does not end in balance.

    Parameters
    ----------
    hard
        The hard packing.
    units, basis_kdd, pressure, watch
        As in `newton`.
    tolerance
        Net force over mean contact force, and relative error of the stress, that count as balance on the way [1].

    """
    sigma = hard.contacts.contact_distance_c
    volume = hard.packing.box.volume

    def pressure_at(depth: float) -> float:
        force = -units.terms(at_distances(hard.contacts, sigma * (1.0 - depth)))[0]
        return float((force * sigma).sum()) / (hard.packing.dimension * volume)

    goal = depth_asked(hard, units, pressure)
    depth = min(goal, FIRST_DEPTH)
    now = pressure if depth == goal else pressure_at(depth)
    state = newton(first_soft(hard, units, basis_kdd, now), units, basis_kdd, now, watch=watch)
    used = state.iterations
    while not state.sound(tolerance) and depth > _MINIMUM_DEPTH:
        depth *= 0.25
        now = pressure_at(depth)
        state = newton(first_soft(hard, units, basis_kdd, now), units, basis_kdd, now, watch=watch)
        used += state.iterations
    before, iterations = (hard.packing, 0.0), used

    def reach(state: SoftState, place: float, further: float) -> Step[SoftState, None] | None:
        nonlocal before, iterations
        depth, at = math.exp(place), pressure if further == end else pressure_at(math.exp(further))
        ahead = extrapolated(*before, state.packing, depth, math.exp(further))
        trial = newton(ahead, units, basis_kdd, at, iterations=20, watch=watch)
        iterations += trial.iterations
        if not trial.sound(tolerance):
            return None
        before = state.packing, depth
        return Step(trial, further)

    end, reached = math.log(goal), depth / goal
    lengths = replace(_DEEPER, shortest=_GIVEN_UP) if hard.packing.particles >= _LARGE else replace(_DEEPER)
    for step in follow(reach, state, math.log(depth), end, lengths) if depth < goal else ():
        state, reached = step.after, math.exp(step.place - end)
    return replace(state, iterations=iterations, reached=reached)


def extrapolated(before: Packing, at: float, now: Packing, depth: float, further: float) -> Packing:
    """Return the packing on the straight line through two others, in the coordinates of the cell."""
    if at == 0.0 or further / depth > 100.0:
        return now
    ahead = (further - depth) / (depth - at)
    fraction, earlier = now.position_nd @ now.box.inverse_dd.T, before.position_nd @ before.box.inverse_dd.T
    fraction = fraction + ahead * (fraction - earlier)
    box = Box(now.box.lattice_dd + ahead * (now.box.lattice_dd - before.box.lattice_dd))
    shapes = now.shapes.turned(ahead * now.shapes.rotation_since(before.shapes))
    return now.replace(position_nd=fraction @ box.lattice_dd.T, box=box, shapes=shapes)
