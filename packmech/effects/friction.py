"""Friction between touching particles: a tangential spring that gives way at Coulomb's limit."""

from __future__ import annotations

from typing import Any, NamedTuple

from packmech.check import brief
from packmech.effects.kinds import ByKind, largest_number, number_at
from packmech.effects.pair import effect
from packmech.jit.compiled import device, tell_apart


class Mindlin(NamedTuple):
    """The tangential stiffness of a smooth contact that does not slip: k_t = 2 (1 - nu) / (2 - nu) k_n.

    k_n = u'' is the normal stiffness of the contact as it is. Of Hertz spheres k_n = 2 E* a, and this is k_t = 8 G* a
    (Mindlin, J. Appl. Mech. 16 (1949) 259), a the radius of contact, 1/E* = 2 (1 - nu^2) / E, 1/G* = 2 (2 - nu) / G.
    The ratio is the same for smooth contacts of any form; here it is for any law.

    The force grows by dT = k_t ds. It stays as the normal force alone grows, and falls with k_t as that falls: what
    parts no longer bears (Walton; Thornton, Cummins and Cleary, Powder Technol. 233 (2013) 30). The displacement s is
    T / k_t, the energy T^2 / (2 k_t): it falls whichever way k_t changes, so that no cycle makes energy. At rest the
    stiffness of packings is that of contacts whose normal forces grow.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    poisson_ratio
        nu, from 0 to 0.5 [1], or `ByKind`, of walls `PerKind`.

    Examples
    --------
    >>> round(mindlin_stiffness(Mindlin(0.5), 3.0, 0), 12)
    2.0

    """

    poisson_ratio: float | ByKind = 0.3

    def fault(self) -> str:
        """Return what is wrong with the number; nothing is, where it is empty."""
        within = 0.0 <= largest_number(self.poisson_ratio) <= 0.5
        return "" if within else f"poisson_ratio must be from 0 to 0.5, got {brief(self.poisson_ratio)}"


class DampingRatio(NamedTuple):
    """A tangential dashpot that is so many times the normal dashpots of its contact.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    ratio
        Over the sum of the normal ones, such as `Restitution` [1].

    Examples
    --------
    >>> Friction(0.5, Mindlin(), DampingRatio(0.5))
    Friction(coefficient=0.5, stiffness=Mindlin(poisson_ratio=0.3), damping=DampingRatio(ratio=0.5))

    """

    ratio: float = 1.0


@device
def mindlin_stiffness(mindlin: Any, second: Any, kinds: Any) -> Any:
    """Return the tangential stiffness, a number or an array as the normal stiffness u'' is [energy/length^2].

    `kinds` are the pairs of kinds of particles, one or an array of them.
    """
    poisson_ratio = number_at(mindlin.poisson_ratio, kinds)
    return 2.0 * (1.0 - poisson_ratio) / (2.0 - poisson_ratio) * abs(second)


for _one in (Mindlin, DampingRatio):
    tell_apart(_one)


@effect
class Friction(NamedTuple):
    """A tangential spring and dashpot at each contact, whose force is capped at coefficient times the normal force.

    The spring's stretch is the integral of the slip at the contact point since the contact closed, cut back where
    the cap is reached: steady sliding feels coefficient * F_n at once, F_n the elastic normal force without
    dashpots. Arms are the particles' shares of the distance, a_i = r_i d / (r_i + r_j), in the slip and in the torque:
    angular momentum is kept exactly and energy is, where nothing slides and nothing is damped. Cundall and Strack
    (1979), with these arms and this cap.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        Coulomb's coefficient mu [1], or `ByKind`, of walls `PerKind`.
    stiffness
        Of the tangential spring [energy/length^2], or `Mindlin`: in proportion to that of the normal force.
    damping
        Of the tangential dashpot [mass/time], or `DampingRatio`: in proportion to the normal ones.

    """

    coefficient: float | ByKind = 0.5
    stiffness: float | Mindlin = 1.0
    damping: float | DampingRatio = 0.0

    def tangential_force(self, stretch: float, slip: float) -> float:
        """Return the force along the contact for a stretch of the spring and a slip speed, before the cap [force]."""
        # of numbers: compiled loops put those of the contact in
        return self.stiffness * stretch + self.damping * slip  # type: ignore[operator]


def friction_of(effects: tuple[Any, ...]) -> Friction | None:
    """Return the friction among the effects; None without."""
    return next((one for one in effects if isinstance(one, Friction)), None)


def acting_friction(effects: tuple[Any, ...]) -> Friction | None:
    """Return the friction among the effects; None without, and where its coefficient is 0."""
    found = friction_of(effects)
    return found if found and largest_number(found.coefficient) > 0.0 else None


def friction_or_zero(effects: tuple[Any, ...]) -> Friction:
    """Return the friction that acts; one whose coefficient, spring and dashpot are 0 where none does."""
    return acting_friction(effects) or Friction(0.0, 0.0, 0.0)


def at_contact(friction: Friction, second: Any, normal: Any, kinds: Any) -> Any:
    """Return the friction with the coefficient, the stiffness and the dashpot that it has at contacts.

    Where the coefficient is 0 nothing acts across, and spring and dashpot are 0.

    Parameters
    ----------
    friction
        The friction.
    second, normal
        Stiffness and coefficient of the dashpots along the normals, numbers or arrays.
    kinds
        The pairs of kinds of particles, one or an array of them.

    """
    k, c, coefficient = friction.stiffness, friction.damping, number_at(friction.coefficient, kinds)
    rubs = coefficient > 0.0
    return friction._replace(
        coefficient=coefficient,
        stiffness=(mindlin_stiffness(k, second, kinds) if isinstance(k, Mindlin) else k) * rubs,
        damping=(c.ratio * normal if isinstance(c, DampingRatio) else c) * rubs,
    )
