"""Resistance of contacts to rolling and twisting: springs that give way at a limit, as Coulomb's."""

from __future__ import annotations

from typing import Any, NamedTuple

from packmech.effects.friction import Friction, friction_of
from packmech.effects.pair import effect
from packmech.packing import Packing


@effect
class RollingResistance(NamedTuple):
    """A spring and dashpot against rolling at each contact, whose force is capped at coefficient times the normal one.

    Contacts of discs and spheres are patches, not points: what rolls presses on its way ahead of the center. The
    rolling displacement is the integral of a (w_j - w_i) x n since the contact closed, w the spins, n the direction
    from i to j, and a = a_i a_j / (a_i + a_j) of the arms of `Friction`. Its force f, cut back at the cap as that of
    friction is, turns i by a n x f and j by the opposite, and pushes neither. This is the rolling spring of Luding
    (Granul. Matter 10 (2008) 235), and, as springs give way and have dashpots, model C of Ai, Chen, Rotter and Ooi
    (Powder Technol. 206 (2011) 269). On a slope below atan(coefficient) a disc or sphere does not roll, where a is its
    radius: on what is much larger than itself.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        Of rolling mu_r [1].
    stiffness
        Of the rolling spring [energy/length^2].
    damping
        Of the rolling dashpot [mass/time].

    """

    coefficient: float = 0.1
    stiffness: float = 1.0
    damping: float = 0.0

    acts_as = "rolling"  # type: ignore[misc]

    def tangential_force(self, stretch: float, slip: float) -> float:
        """Return the force of a displacement and its rate, before the cap [force]."""
        return self.stiffness * stretch + self.damping * slip


@effect
class TwistingResistance(NamedTuple):
    """A spring and dashpot against twisting at each contact of spheres, capped at coefficient times the normal force.

    As `RollingResistance` for spins along the direction n between the centers: the twisting displacement is the
    integral of a (w_j - w_i).n, its force f turns i by a f n and j by the opposite.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        Of twisting mu_t [1].
    stiffness
        Of the twisting spring [energy/length^2].
    damping
        Of the twisting dashpot [mass/time].

    """

    coefficient: float = 0.1
    stiffness: float = 1.0
    damping: float = 0.0

    acts_as = "rolling"  # type: ignore[misc]

    def tangential_force(self, stretch: float, slip: float) -> float:
        """Return the force of a displacement and its rate, before the cap [force]."""
        return self.stiffness * stretch + self.damping * slip


class RoughContacts(NamedTuple):
    """Friction with resistance to rolling, to twisting, or to both; None for what a scene lacks."""

    friction: Friction
    rolling: RollingResistance | None
    twisting: TwistingResistance | None


def resistances(friction: Friction | RoughContacts | None) -> tuple[Any, ...]:
    """Return the friction and what resists rolling and twisting beside it; nothing without."""
    if not isinstance(friction, RoughContacts):
        return () if friction is None else (friction,)
    return tuple(one for one in friction if one is not None)


def rolling_of(effects: tuple[Any, ...]) -> RollingResistance | None:
    """Return the resistance to rolling among the effects; None without, and where its coefficient is 0."""
    return next((one for one in effects if isinstance(one, RollingResistance) and one.coefficient > 0.0), None)


def twisting_of(effects: tuple[Any, ...]) -> TwistingResistance | None:
    """Return the resistance to twisting among the effects; None without, and where its coefficient is 0."""
    return next((one for one in effects if isinstance(one, TwistingResistance) and one.coefficient > 0.0), None)


def refuse_rolling(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse resistance to rolling or twisting of shapes, and to twisting in a plane.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    for k, one in enumerate(effects):
        if not isinstance(one, RollingResistance | TwistingResistance):
            continue
        name = type(one).__name__
        if packing.shapes.has_orientations:
            raise ValueError(
                f"effects must hold no {name} for {packing.shapes.names[1]}, whose shapes decide how they roll: it is "
                f"that of discs and spheres, got it at {k}"
            )
        if isinstance(one, TwistingResistance) and packing.dimension == 2:
            raise ValueError(f"effects must hold no {name} in a plane, where nothing twists, got it at {k}")


def roughness_of(effects: tuple[Any, ...]) -> Friction | RoughContacts | None:
    """Return what acts across contacts: the friction alone, or with what resists rolling and twisting; None without."""
    friction, rolling, twisting = friction_of(effects), rolling_of(effects), twisting_of(effects)
    if rolling is None and twisting is None:
        return friction
    return RoughContacts(friction or Friction(0.0), rolling, twisting)
