"""Newton's method for soft packings, at constant pressure or volume, with the free strains among the unknowns.

Unknowns are displacements and the free strains; the enthalpy U + p V is stationary where forces balance and the
stress is -p on every free strain, or that of another load. Prestress is included: without it Newton's method stalls at
a residual of 1e-2 near jamming. A packing with links keeps them: their tensions are unknowns too.

`newton` goes to the stationary point nearby. `descend` only goes down, for packings whose contacts change or that must
leave a saddle: where the Hessian has unstable directions every coordinate is regularized until it has none, and steps
are halved until the enthalpy falls.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.effects import equal_touches, held_particles
from packmech.effects.kinds import reference_partners
from packmech.mechanics.stability import stability_bound
from packmech.minimize.second_order.soft_network import REACH, Load, SoftNetwork, Units
from packmech.packing import Packing
from packmech.result import Outcome

_ITERATIONS = 40
_ARMIJO = 1e-4
_HALVINGS = 3
# regularization of every coordinate, in units of the mean stiffness of a contact: a trace always, more where unstable
_TRACE, _FIRST, _LARGEST_REGULARIZATION = 1e-10, 1e-9, 1e3
# after a good step there is less of it, after a bad one more
_LOOSER, _TIGHTER = 0.3, 10.0
# falling back onto the floor of a valley: regularization of what is soft, and how often
_STIFF, _CORRECTIONS = 1e-2, 3
# Newton's method without safeguards goes on from here
_NEAR = 1e-7
# smoothing of overlaps: its first width over the overlap at which a contact bears the pressure, and over the diameter.
# Wide at first, because steps that bend around each other must be shorter than the root of the width
_WIDE, _WIDEST = 1e2, 1e-3
# merit at which the width is multiplied by a factor; its last value over that overlap, and over the error of positions
_ROUGH, _NARROWER, _NARROW, _DIGITS = 1e-2, 0.3, 1e-8, 4.0
# positions are multiples of their last digit: so many floors is as still as a packing can be in double precision
FLOORS = 8.0
# sizes of the displacements that move a packing off a saddle, one after the other [reduced length]
_KICKS = (1e-5, 1e-4, 1e-3)
# largest force of a contact that grazes, over the largest net force [1]
_GRAZING = 30.0
# rounding of positions may make up this part of the contact forces before they count as none [1]
_NO_FORCE = 0.1


@dataclass(frozen=True, eq=False)
class SoftState:
    """A soft packing in balance, or as near as Newton's method came: how well, and after how many iterations.

    `stress_error` is the largest missing stress on a free strain over the pressure; `negative` counts unstable
    directions; `reached` is the depth of the overlaps over that asked for; `floor` the residual that rounding of
    positions alone can cause; `mean_force` is in reduced units; `evaluations` counts force evaluations.
    """

    packing: Packing
    residual: float
    stress_error: float
    iterations: int
    negative: int
    reached: float = 1.0
    floor: float = 0.0
    mean_force: float = 0.0
    evaluations: int = 0

    @property
    def unjammed(self) -> bool:
        """Whether the contact forces are no more than rounding."""
        return not self.mean_force > 0.0 or self.floor > _NO_FORCE

    def balanced(self, tolerance: float) -> bool:
        """Return whether forces and stress balance to the tolerance."""
        return self.residual <= tolerance and self.stress_error <= tolerance

    def sound(self, tolerance: float) -> bool:
        """Return whether the packing is stable and balanced to the tolerance or to the floor of rounding."""
        return self.negative == 0 and self.balanced(max(tolerance, self.least_error))

    @property
    def least_error(self) -> float:
        """The residual that rounding of positions leaves."""
        return FLOORS * self.floor


def newton(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | Load | None,
    *,
    iterations: int = _ITERATIONS,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the packing that Newton's method reaches at constant pressure or volume, in reduced units.

    Steps are halved until net forces and stress come closer to balance; the last digits stop at rounding.

    Parameters
    ----------
    packing
        Where to start; it must overlap already.
    units
        The law and the units.
    basis_kdd
        (k, d, d) free strains; none keeps the box.
    pressure
        Pressure [reduced energy / reduced length^d], or a load; None to hold the volume.
    iterations
        Maximum number of iterations.
    watch
        Called with the packing after each iteration.

    """
    network = SoftNetwork(packing, units, basis_kdd, pressure)
    best = network.packing, network.merit, network.residual, network.stress_error
    negative = 0
    used = idle = 0
    evaluations = 1
    travelled = 0.0
    for _ in range(iterations):
        used += 1
        start, merit = network.packing, network.merit
        if not np.isfinite(merit):
            break
        regularization = 1e-10 * float(np.abs(network.second_c).mean())
        try:
            u_nd, strain_k, negative = network.direction(regularization)
        except (np.linalg.LinAlgError, RuntimeError, ValueError):
            break
        size = 1.0
        longest = float(np.abs(u_nd).max()) + float(np.abs(strain_k).max(initial=0.0))
        if not np.isfinite(longest):
            break
        size = min(1.0, 0.3 * REACH / max(longest, 1e-300))
        travelled += size * longest
        if travelled > 0.8 * REACH:
            network = SoftNetwork(start, units, basis_kdd, pressure)
            travelled = size * longest
        begin = copy.copy(network)
        for _ in range(8):
            evaluations += 1
            network.measure(begin.moved(size * u_nd, size * strain_k))
            # a contact that opens or closes may raise the merit once before it falls
            if network.merit < (4.0 if merit > 1e-4 else 1e3) * merit:
                break
            size *= 0.5
        if network.merit < best[1]:
            idle = 0 if network.merit < 0.5 * best[1] else idle + 1
            best = network.packing, network.merit, network.residual, network.stress_error
        else:
            idle += 1
        if watch is not None:
            watch(network.packing)
        # where contacts open and close the merit rises before it falls; at the floor of rounding it only wanders
        if idle >= 10 or (idle >= 2 and best[1] <= FLOORS * rounding_floor(network)):
            break
    if negative:
        # the last step's count may belong to another set of contacts: some flicker where they just touch
        negative = _unstable_directions(best[0], units, network.basis_kdd, network.pressure)
    network.measure(best[0])
    mean = network.mean_force
    return SoftState(best[0], best[2], best[3], used, negative, 1.0, rounding_floor(network), mean, evaluations)


def standing(
    packing: Packing, units: Units, basis_kdd: NDArray[np.float64], pressure: float | Load | None
) -> SoftState:
    """Return the packing as it stands, nothing moved: how far from balance it is, and whether it is stable.

    Parameters
    ----------
    packing, units, basis_kdd, pressure
        As in `newton`.

    """
    network = SoftNetwork(packing, units, basis_kdd, pressure)
    negative = 0
    if len(network.contacts):
        negative = _unstable_directions(packing, units, network.basis_kdd, pressure)
    return SoftState(
        packing, network.residual, network.stress_error, 0, negative, 1.0,
        rounding_floor(network), network.mean_force, 1,
    )  # fmt: skip


def rounding_floor(network: SoftNetwork) -> float:
    """Return the residual that rounding of positions alone can cause; zero where nothing touches."""
    if not len(network.contacts):
        return 0.0
    return float(np.finfo(float).eps * network.extent * network.largest_stiffness / network.mean_force)


def _unstable_directions(
    packing: Packing, units: Units, basis_kdd: NDArray[np.float64], pressure: float | Load | None
) -> int:
    """Return the negative eigenvalues of the Hessian, with contacts that touch to rounding counted as closed.

    Forces that do not balance bend contacts sideways. Contacts that bear about as little as these, of rattlers that
    graze, count as bearing none: what they alone make negative says nothing about what bears the pressure.
    """
    network = SoftNetwork(packing, units, basis_kdd, pressure)
    unbalanced, radius = network.largest_force(), float(packing.radius_n.min())
    contacts = network.near(packing)
    network.close(contacts.select(contacts.gap_c < 4.0 * np.finfo(float).eps * network.extent), _GRAZING * unbalanced)
    stiffest = float(np.abs(network.second_c).max(initial=0.0))
    return _negative(network, stability_bound(stiffest, unbalanced, radius))


def judge(state: SoftState, tolerance: float) -> Outcome:
    """Return how a soft packing came out: balanced, at the floor of rounding, unstable, or stalled.

    Parameters
    ----------
    state
        The packing.
    tolerance
        Net force over mean contact force, and missing stress over pressure, that count as balance [1].

    """
    if state.reached < 1.0 or not np.isfinite(state.residual):
        return Outcome.STALLED
    if state.negative:
        return Outcome.UNSTABLE
    if state.balanced(tolerance):
        return Outcome.CONVERGED
    return Outcome.ROUNDING_FLOOR if state.sound(tolerance) else Outcome.STALLED


class _NewtonStep(NamedTuple):
    u_nd: NDArray[np.float64]
    strain_k: NDArray[np.float64]
    slope: float


def descend(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | Load | None,
    *,
    iterations: int = 200,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the packing at the bottom that Newton's method reaches going down, in reduced units.

    Parameters
    ----------
    packing, units, basis_kdd, pressure
        As in `newton`.
    iterations
        Maximum number of iterations, those of the last digits not counted.
    watch
        Called with the packing after each accepted step, and each of the last digits.

    """
    network = SoftNetwork(packing, units, basis_kdd, pressure)
    network, used, evaluations = _go_down(network, basis_kdd, pressure, _NEAR, iterations, watch)
    end = newton(network.packing, units, basis_kdd, pressure, watch=watch)
    return replace(end, iterations=end.iterations + used, evaluations=end.evaluations + evaluations)


def descend_smoothed(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | Load | None,
    *,
    iterations: int = 400,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the packing that Newton's method reaches going down with overlaps smoothed less and less.

    Where there are more contacts than balance needs, as in crystals, some bear next to nothing when the others do:
    which of them touch decides about the next step, and the step about which of them touch. Smoothed over a width, all
    near pairs press a little, and the slopes change by little over that width; then the width is made small against
    the overlaps.

    Parameters
    ----------
    packing, units, basis_kdd, pressure, watch
        As in `descend`.
    iterations
        Maximum number of iterations in all, those of the last digits not counted.

    """
    network = SoftNetwork(packing, units, basis_kdd, pressure)
    own = _overlap(network)
    width = max(own, min(_WIDE * own, _WIDEST))
    used, evaluations, negative = 0, 1, 0
    while width > 0.0 and used < iterations:
        lowest = max(_NARROW * _overlap(network), _DIGITS * np.finfo(float).eps * network.extent)
        width = max(width, lowest)
        network = SoftNetwork(network.packing, units, basis_kdd, pressure, width)
        goal = _ROUGH if width > lowest else _NEAR
        network, more, measured = _go_down(network, basis_kdd, pressure, goal, iterations - used, watch)
        used, evaluations = used + more, evaluations + measured
        if width <= lowest:
            negative = _negative(network)
            break
        width *= _NARROWER
    end = newton(network.packing, units, basis_kdd, pressure, watch=watch)
    # contacts that just touch hold what they touch: they count in the smoothed network alone
    negative = min(negative, end.negative) if used < iterations else end.negative
    return replace(end, negative=negative, iterations=end.iterations + used, evaluations=end.evaluations + evaluations)


def find_bottom(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | Load | None,
    tolerance: float,
    *,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the packing that `descend` reaches; where it finds no balance, that of `descend_smoothed`.

    A symmetric packing goes down to a saddle, where nothing pushes it off its symmetry: small displacements do.

    Parameters
    ----------
    packing, units, basis_kdd, pressure, watch
        As in `descend`.
    tolerance
        Net force over mean contact force, and missing stress over pressure, that count as balance [1].

    """
    state = descend(packing, units, basis_kdd, pressure, watch=watch)
    for size in _KICKS:
        if not state.negative or not replace(state, negative=0).sound(tolerance):
            break
        off = descend(_kicked(state.packing, size, units), units, basis_kdd, pressure, watch=watch)
        state = replace(
            off, iterations=state.iterations + off.iterations, evaluations=state.evaluations + off.evaluations
        )
    if state.sound(tolerance) or state.unjammed:
        return state
    smoothed = descend_smoothed(packing, units, basis_kdd, pressure, watch=watch)
    iterations, evaluations = state.iterations + smoothed.iterations, state.evaluations + smoothed.evaluations
    return replace(smoothed, iterations=iterations, evaluations=evaluations)


def _kicked(packing: Packing, size: float, units: Units) -> Packing:
    """Return the packing after displacements and turns of a size [reduced length], each along a direction of its own.

    Their mean is taken off: particles that all move alike leave no saddle. What is held stays.
    """
    d, turns = packing.dimension, packing.turn_nkt.shape[1]
    kick = size * np.random.default_rng(packing.particles).standard_normal((packing.particles, d + turns))
    held_n = held_particles(units.effects, packing.particles)
    if held_n is None:
        kick[:, :d] -= kick[:, :d].mean(axis=0)
    else:
        kick[held_n] = 0.0
    return packing.moved(kick)


def _overlap(network: SoftNetwork) -> float:
    """Return the overlap at which a contact bears the pressure [reduced length]; zero where nothing presses."""
    packing = network.packing
    sigma = packing.diameter_n.mean(keepdims=True)
    force = network.pressure * sigma ** (packing.dimension - 1)
    if not network.pressure > 0.0:
        return 0.0
    found = [
        equal_touches(sigma, sigma)._replace(kinds_c=np.array([pair.kinds]))
        for pair in reference_partners(network.units.effects, packing)
    ]
    return max(float((sigma * network.units.overlap_of(force, touches))[0]) for touches in found)


def _negative(network: SoftNetwork, bound: float = 0.0) -> int:
    """Return the number of directions whose curvature is negative by more than the bound, and by more than rounding."""
    try:
        return network.direction(max(_TRACE * float(np.abs(network.second_c).mean()), bound))[2]
    except np.linalg.LinAlgError:
        return 1


def _go_down(
    network: SoftNetwork,
    basis_kdd: NDArray[np.float64],
    pressure: float | Load | None,
    goal: float,
    iterations: int,
    watch: Callable[[Packing], None] | None,
) -> tuple[SoftNetwork, int, int]:
    """Return the network where Newton's method going down reaches the goal or stops, iterations, evaluations."""
    regularization, used, evaluations = _TRACE, 0, 1
    travelled = 0.0
    while used < iterations and np.isfinite(network.merit) and network.merit > max(goal, rounding_floor(network)):
        used += 1
        found = _downhill(network, regularization)
        if found is None:
            break
        step, regularization = found
        start, merit = network.packing, network.merit
        longest = float(np.abs(step.u_nd).max()) + float(np.abs(step.strain_k).max(initial=0.0))
        size = min(1.0, 0.5 * REACH / max(longest, 1e-300))
        travelled += size * longest
        if travelled > 0.8 * REACH:
            network = SoftNetwork(start, network.units, basis_kdd, pressure, network.width)
            travelled = size * longest
        begin = copy.copy(network)
        for halving in range(_HALVINGS):
            network.measure(begin.moved(size * step.u_nd, size * step.strain_k))
            evaluations += 1
            fall = _ARMIJO * size * step.slope
            lower = begin.growth_to(network.packing) <= fall
            for _ in range(0 if lower or halving < _HALVINGS - 1 else _CORRECTIONS):
                # a long way along a soft valley leaves its floor by the square of the way, and shorter ones may not:
                # let what is stiff fall back
                back = _downhill(network, _STIFF)
                if back is None:
                    break
                network.measure(network.moved(back[0].u_nd, back[0].strain_k))
                evaluations += 1
                lower = begin.growth_to(network.packing) <= fall
                if lower:
                    break
            if lower:
                regularization = regularization if halving else max(_LOOSER * regularization, _TRACE)
                break
            if network.merit < 0.3 * merit and merit < 1e-3:
                break
            size *= 0.5
        else:
            network.measure(start)
            regularization = max(_TIGHTER * regularization, _FIRST)
            if regularization > _LARGEST_REGULARIZATION:
                break
            continue
        if watch is not None:
            watch(network.packing)
    return network, used, evaluations


def _downhill(network: SoftNetwork, regularization: float) -> tuple[_NewtonStep, float] | None:
    """Return Newton's step with as much regularization as makes it go down, and how much."""
    mean = float(np.abs(network.second_c).mean()) if len(network.second_c) else 0.0
    while regularization <= _LARGEST_REGULARIZATION and mean > 0.0:
        try:
            u_nd, strain_k, negative = network.direction(regularization * mean)
        except np.linalg.LinAlgError:
            negative = 1
        if negative == 0:
            slope = float((network.uphill_nd * u_nd).sum() + network.uphill_k @ strain_k)
            if slope < 0.0 and np.isfinite(slope):
                return _NewtonStep(u_nd, strain_k, slope), regularization
        regularization = max(10.0 * regularization, _FIRST)
    return None
