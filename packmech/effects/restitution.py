"""Coefficients of restitution: what a head-on collision of two particles leaves of their speed."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from packmech.check import brief, clear_errors, entries, positive, positive_array, real
from packmech.contacts.network import pair_of_kinds
from packmech.effects.damping import ViscoelasticDamping
from packmech.effects.interaction import is_interaction
from packmech.effects.kinds import checked_pair, kinds_of_table, tables_in
from packmech.effects.laws import Law, is_law
from packmech.effects.pair import at_overlap, damps, is_bound, is_effect, pair_damping, pair_energy
from packmech.effects.partners import Partners, partners_of
from packmech.effects.repulsion import Repulsion

# relative error of the collision's integration
_ACCURACY = 1e-11
# overlap at the start, over the deepest one
_CLOSED = 1e-12
# error of the overlap by rounding, over the deepest one, beyond which no collision is followed
_LEAST = 1e-4
# relative error of the integration over that of the overlap by rounding: smaller ones follow noise
_OF_ROUNDING = 0.01
# part of the energy below which what is left counts as none
_STOPPED = 1e-16
# halvings of an overlap, and doublings of a time, after which there is none
_HALVINGS, _DOUBLINGS = 200, 60


@clear_errors
def coefficient_of_restitution(
    effects: Sequence[Any],
    speed: float,
    *,
    radii: ArrayLike = (0.5, 0.5),
    masses: ArrayLike = (1.0, 1.0),
    kinds: tuple[int, int] = (0, 0),
) -> float:
    """Return the speed at which two particles part over that at which they meet head on [1]; 0 where they do not part.

    The equation of motion of the pair, m dv/dt = -u' - c v with the reduced mass m, integrated to a relative error of
    1e-11, or to what rounding leaves of small overlaps (Dormand and Prince, order 8), from where they meet to where
    they part. A wall is hit as an equal particle is that comes as fast, with the law and the dashpot of the wall.

    Parameters
    ----------
    effects
        What acts between them, as in a scene: `Repulsion`, dashpots.
    speed
        Of the approach, v_i - v_j [length/time].
    radii, masses
        Of both [length], [mass]; a mass may be infinite.
    kinds
        Of both, for effects that differ by kinds.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, nothing repels them strongly enough, or they are so slow that rounding leaves fewer
        than four digits of their overlap.

    Examples
    --------
    >>> import packmech as pm
    >>> spheres = (pm.Repulsion(pm.Hertz()), pm.Restitution(0.7))
    >>> round(pm.coefficient_of_restitution(spheres, 1e-3, radii=(0.5, 2.0), masses=(1.0, 64.0)), 9)
    0.7

    """
    if not isinstance(effects, tuple | list):
        raise TypeError(f"effects must be a tuple of effects, got {brief(effects)}")
    acting = tuple(effects)
    for k, one in enumerate(acting):
        knows = is_effect(one) and not is_bound(one) and not is_interaction(one)
        if not knows or not (hasattr(one, "pair_energy") or damps(one)):
            raise TypeError(f"effects[{k}] must be a repulsion or a dashpot of touching pairs, got {brief(one)}")
    partners, mass = _pair_of(radii, masses)
    low, high = checked_pair("kinds", kinds)
    for k, one in enumerate(acting):
        for name, table in tables_in(one):
            if high >= kinds_of_table(len(table)):
                raise ValueError(
                    f"kinds must be below {kinds_of_table(len(table))}, for which effects[{k}].{name} has numbers, got "
                    f"{kinds!r}"
                )
    partners = partners._replace(kinds=int(pair_of_kinds(low, high)))
    return _restitution(acting, _checked_speed(speed, mass), partners, mass)


def _checked_speed(speed: Any, mass: float) -> float:
    """Return a speed at which a reduced mass has an energy that a float64 holds to all digits."""
    found = positive("speed", speed)
    # the product, unlike a power, overflows without an error
    energy = 0.5 * mass * found * found
    if not (energy >= sys.float_info.min and found * found >= sys.float_info.min and math.isfinite(energy)):
        raise ValueError(f"speed must be one whose energy, mass * speed^2 / 2, a float64 holds, got {found:g}")
    return found


def _pair_of(radii: ArrayLike, masses: ArrayLike) -> tuple[Partners, float]:
    """Return the partners and the reduced mass of two particles; one of the masses may be infinite."""
    radius, other = positive_array("radii", radii, shape=(2,), what="radius").tolist()
    partners = partners_of(radius, other, 0)
    found = entries("masses", masses, "iuf", "two positive numbers").astype(np.float64)
    if found.shape != (2,) or not (found > 0.0).all() or np.isinf(found).all():
        raise ValueError(f"masses must be two positive numbers, one of them finite, got {brief(masses)}")
    with np.errstate(over="ignore"):
        reduced = float(1.0 / (1.0 / found).sum())
    if not sys.float_info.min <= reduced < math.inf:
        raise ValueError(f"masses must have a reduced mass that float64 holds to all digits, got {brief(masses)}")
    return partners, reduced


def _restitution(effects: tuple[Any, ...], speed: float, partners: Partners, mass: float) -> float:
    """Return the restitution of two particles of this reduced mass."""
    sigma = partners.contact_distance
    start = 0.5 * mass * speed * speed
    deepest = _overlap_of(effects, start, partners)

    # lengths in the deepest overlap without dashpots, speeds in the first one
    def slope(_: float, state: NDArray[np.float64]) -> tuple[float, float]:
        overlap, rate = float(state[0]) * deepest, float(state[1]) * speed
        if not overlap > 0.0:
            return state[1], 0.0
        pair = at_overlap(effects, overlap / sigma, partners, mass)._replace(rate=-rate)
        force = pair.first - rate * sum(pair_damping(one, pair) for one in effects)
        return state[1], force / mass * deepest / speed**2

    def parted(_: float, state: NDArray[np.float64]) -> float:
        return float(state[0])

    def stopped(_: float, state: NDArray[np.float64]) -> float:
        overlap = max(float(state[0]), 0.0) * deepest
        left = sum(float(pair_energy(one, sigma - overlap, partners)) for one in effects)
        return left / start + float(state[1]) ** 2 - _STOPPED

    parted.terminal, parted.direction = True, -1.0  # type: ignore[attr-defined]
    stopped.terminal = True  # type: ignore[attr-defined]
    # what rounding of the distance leaves of the overlap: no integration is more accurate than the forces
    rounding = 4.0 * float(np.finfo(np.float64).eps) * sigma / deepest
    if rounding > _LEAST:
        raise ValueError(
            f"speed must be so large that rounding leaves four digits of the overlap, {deepest:.1g} at most, got "
            f"{speed:g}"
        )
    closed, accuracy = max(_CLOSED, rounding), max(_ACCURACY, _OF_ROUNDING * rounding)
    options = {"rtol": accuracy, "atol": 1e-3 * accuracy}
    run = solve_ivp(slope, (0.0, math.inf), (closed, 1.0), "DOP853", events=(parted, stopped), **options)
    return abs(float(run.y[1, -1])) if len(run.t_events[0]) else 0.0


def _overlap_of(effects: tuple[Any, ...], energy: float, partners: Partners) -> float:
    """Return the overlap at which a pair has this energy [length]."""
    sigma = partners.contact_distance

    def beyond(overlap: float) -> float:
        return sum(float(pair_energy(one, sigma - overlap, partners)) for one in effects) - energy

    high = 0.999 * sigma
    if not beyond(high) > 0.0:
        raise ValueError("speed must be so small that the effects stop the particles before their centers meet")
    low = high
    for _ in range(_HALVINGS):
        low *= 0.5
        if beyond(low) < 0.0:
            break
    return float(brentq(beyond, low, 2.0 * low, xtol=1e-15 * low))


@clear_errors
def viscoelastic_time(
    law: Law, restitution: float, speed: float, *, radii: ArrayLike = (0.5, 0.5), masses: ArrayLike = (1.0, 1.0)
) -> float:
    """Return the time of the `ViscoelasticDamping` that leaves this restitution to a collision of this speed [time].

    Found by bisection of `coefficient_of_restitution`; at other speeds, radii and masses the restitution is another.

    Parameters
    ----------
    law
        Of the repulsion.
    restitution
        Speed after over speed before, above 0 and below 1 [1].
    speed, radii, masses
        As in `coefficient_of_restitution`.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, or no time leaves so little.

    Examples
    --------
    >>> import math
    >>> import packmech as pm
    >>> time = pm.viscoelastic_time(pm.LinearSpring(4.0), 0.5, 0.01)
    >>> zeta = math.log(2.0) / math.hypot(math.pi, math.log(2.0))
    >>> round(time * 4.0, 8), round(2.0 * zeta * math.sqrt(0.5 * 4.0), 8)  # of a linear spring
    (0.60939526, 0.60939526)

    """
    aim = real("restitution", restitution, above=0.0, below=1.0)
    if not is_law(law):
        raise TypeError(f"law must be a law such as Hertz(), got {brief(law)}")

    partners, mass = _pair_of(radii, masses)
    speed = _checked_speed(speed, mass)
    energy = 0.5 * mass * speed * speed

    def beyond(time: float) -> float:
        effects = (Repulsion(law), ViscoelasticDamping(time))
        return coefficient_of_restitution(effects, speed, radii=radii, masses=masses) - aim

    # a little of the time that a collision takes
    return _root(beyond, 1e-3 * _overlap_of((Repulsion(law),), energy, partners) / speed)


def _root(beyond: Callable[[float], float], start: float) -> float:
    """Return the root of a function that falls from a positive value at 0."""
    low, high = 0.0, start
    for _ in range(_DOUBLINGS):
        if beyond(high) < 0.0:
            return float(brentq(beyond, low, high, rtol=_ACCURACY, xtol=_ACCURACY * high))
        low, high = high, 2.0 * high
    raise ValueError("restitution must be one that some time leaves, got one below all")
