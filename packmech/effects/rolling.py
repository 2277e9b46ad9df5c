"""Resistance of contacts to rolling and twisting: springs that give way at a limit, as Coulomb's, and dashpots."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from packmech.check import brief
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
    (Powder Technol. 206 (2011) 269); `ConstantRolling` and `ViscousRolling` are the others of these that packmech has.
    On a slope below atan(coefficient) a disc or sphere does not roll, where a is its radius: on what is much larger
    than itself.

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
class ConstantRolling(NamedTuple):
    """A force of one size against rolling at each contact: coefficient times the normal force, whatever the speed.

    Model A of Ai, Chen, Rotter and Ooi (Powder Technol. 206 (2011) 269), the constant directional torque: with the
    rolling velocity v = a (w_j - w_i) x n and the arm a of `RollingResistance` the force is coefficient * F_n v / |v|,
    which turns i by a n x f and j by the opposite. It would jump where v turns round; here it goes through zero as a
    dashpot does, f = min(coefficient * F_n, damping |v|) v / |v|. So what rolls freely loses its speed at a constant
    rate down to coefficient * F_n / damping, then exponentially, and never turns round. Nothing is remembered, and
    nothing is held at rest: under a steady load below the limit contacts creep at the velocity load / damping, where
    `RollingResistance` holds them.
    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        Of rolling mu_r [1].
    damping
        Of the dashpot below the limit [mass/time]: the larger, the sharper the turn and the slower the creep, and the
        shorter the time steps, which must not turn what rolls round: dt is chosen, and checked, for that.

    """

    coefficient: float = 0.1
    damping: float = 1.0

    acts_as = "damping"  # type: ignore[misc]

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        return "" if self.damping > 0.0 else f"damping must be positive, got {brief(self.damping)}"

    @property
    def stiffness(self) -> float:
        """There is no spring [energy/length^2]."""
        return 0.0

    def rolling_dashpot(self, speed: float, normal_force: float) -> float:
        """Return the force over the rolling velocity of this speed [mass/time]."""
        limit = self.coefficient * normal_force
        return self.damping if self.damping * speed <= limit else limit / speed


@effect
class ViscousRolling(NamedTuple):
    """A force against rolling at each contact in proportion to the normal force and to the velocity of rolling.

    Model B of Ai, Chen, Rotter and Ooi (Powder Technol. 206 (2011) 269): with the rolling velocity v =
    a (w_j - w_i) x n and the arm a of `RollingResistance` the force is coefficient * F_n v, without a limit; it turns i
    by a n x f and j by the opposite. What rolls freely loses its speed exponentially. At rest it is zero.
    Its numbers are checked when a `Scene` is made with it.

    Time steps that are not given are chosen for contacts, of walls too, pressed by a tenth of the contact distance: F_n
    there grows with the stiffness, and where contacts bear little beside it, such as the weight of stiff particles, the
    step may be hundreds of times shorter than it need be. No check in the course of a run finds every step that is too
    long for a normal force that grows, so none is chosen by that of the start. Calls that take `dt` are given one: with
    F_n the largest to come, dt times coefficient F_n a^2 (1/I_i + 1/I_j), I the moments of inertia, is to be well below
    1, and a twentieth is what is chosen for other dashpots; that of the scene without this effect is the longest.

    Parameters
    ----------
    coefficient
        Force over normal force and rolling velocity [time/length].

    """

    coefficient: float = 0.1

    acts_as = "damping"  # type: ignore[misc]

    @property
    def stiffness(self) -> float:
        """There is no spring [energy/length^2]."""
        return 0.0

    def rolling_dashpot(self, speed: float, normal_force: float) -> float:
        """Return the force over the rolling velocity of this speed [mass/time]."""
        return self.coefficient * normal_force


# resistance to rolling without a spring, and all that there is
RollingDashpot = ConstantRolling | ViscousRolling
Rolling = RollingResistance | RollingDashpot


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
    rolling: Rolling | None
    twisting: TwistingResistance | None


def springs_of(rough: Friction | RoughContacts | None) -> Friction | RoughContacts | None:
    """Return what holds contacts at rest: without resistance to rolling that has no spring."""
    if not isinstance(rough, RoughContacts) or not isinstance(rough.rolling, RollingDashpot):
        return rough
    return rough.friction if rough.twisting is None else rough._replace(rolling=None)


def resistances(friction: Friction | RoughContacts | None) -> tuple[Any, ...]:
    """Return the friction and what resists rolling and twisting beside it; nothing without."""
    if not isinstance(friction, RoughContacts):
        return () if friction is None else (friction,)
    return tuple(one for one in friction if one is not None)


def at_normal_force(resistance: Rolling | TwistingResistance, normal: Any) -> RollingResistance | TwistingResistance:
    """Return a resistance as a spring and a dashpot with a limit, as it is under a normal force, or (C,) of them.

    Of those without a spring the stiffness is 0, of those without a limit the coefficient infinite.
    """
    if isinstance(resistance, ConstantRolling):
        return RollingResistance._make((resistance.coefficient, 0.0, resistance.damping))
    if isinstance(resistance, ViscousRolling):
        return RollingResistance._make((math.inf, 0.0, resistance.coefficient * normal))
    return resistance


def rolling_spring_of(effects: tuple[Any, ...]) -> RollingResistance | None:
    """Return the spring against rolling among the effects; None without, and where its coefficient is 0.

    Dashpots, which do nothing at rest, are left out: see `rolling_of`.
    """
    found = rolling_of(effects)
    return found if isinstance(found, RollingResistance) else None


def rolling_of(effects: tuple[Any, ...]) -> Rolling | None:
    """Return what resists rolling among the effects; None without, and where its coefficient is 0."""
    return next((one for one in effects if isinstance(one, Rolling) and one.coefficient > 0.0), None)


def twisting_of(effects: tuple[Any, ...]) -> TwistingResistance | None:
    """Return the resistance to twisting among the effects; None without, and where its coefficient is 0."""
    return next((one for one in effects if isinstance(one, TwistingResistance) and one.coefficient > 0.0), None)


def refuse_rolling(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse two resistances to rolling, resistance to rolling or twisting of shapes, and to twisting in a plane.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    rolling = [f"{type(one).__name__} at {k}" for k, one in enumerate(effects) if isinstance(one, Rolling)]
    if len(rolling) > 1:
        raise ValueError(f"effects must hold one resistance to rolling at most, got {', '.join(rolling)}")
    for k, one in enumerate(effects):
        if not isinstance(one, Rolling | TwistingResistance):
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
