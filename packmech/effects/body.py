"""Effects on single particles: gravity, walls, drag."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types

from packmech.effects.damping import ContactDamping, Restitution, ViscoelasticDamping
from packmech.effects.laws import Law, LinearSpring, law_energy, law_first, law_second
from packmech.effects.pair import TouchingPair, effect, hook_of, pair_damping
from packmech.jit.compiled import compiled_form, device

# relative overlap at which the dashpot of a wall is looked up
_OVERLAP = 0.1


@effect
class Gravity(NamedTuple):
    """The same acceleration for every particle [length/time^2]; no potential is periodic, so put a wall in its way."""

    x: float = 0.0
    y: float = -1.0
    z: float = 0.0

    def body_force(
        self, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
    ) -> tuple[float, float, float]:
        """Return the force on a particle of this mass [force]."""
        return mass * self.x, mass * self.y, mass * self.z

    def body_energy(self, x: float, y: float, z: float, mass: float, radius: float) -> float:
        """Return its energy [energy]."""
        return -mass * (self.x * x + self.y * y + self.z * z)

    def body_second(
        self, x: float, y: float, z: float, mass: float, radius: float
    ) -> tuple[float, float, float, float, float, float]:
        """Return the second derivatives of its energy, xx, yy, zz, yz, xz, xy [energy/length^2]."""
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@effect
class BackgroundDamping(NamedTuple):
    """Drag against the local flow: -rate m (v - L x), and -rate I (spin - half the flow's vorticity).

    Where the box does not deform it slows everything down; where it does, what is carried along feels none of it.
    """

    rate: float = 0.1

    def body_force(
        self, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
    ) -> tuple[float, float, float]:
        """Return the drag on a particle with the peculiar velocity (u, v, w) [force]."""
        drag = -self.rate * mass
        return drag * u, drag * v, drag * w

    def spin_drag(self) -> float:
        """Return the rate at which spins relax to the flow's [1/time]."""
        return self.rate


def dashpot_of(damping: Any, pair: TouchingPair) -> float:
    """Return the coefficient of a dashpot that is given by its number, or as the effect of pairs [mass/time]."""
    return pair_damping(damping, pair) if isinstance(damping, tuple) else float(damping)


@compiled_form(dashpot_of)
def _dashpot_of(damping: Any, pair: Any) -> Any:
    if isinstance(damping, types.Float):
        return lambda damping, pair: damping
    return lambda damping, pair: pair_damping(damping, pair)


@device
def first_on_wall(wall: Any, distance: float, contact_distance: float, rate: float, mass: float) -> float:
    """Return the radial derivative of a particle and its image behind a wall, with the wall's dashpot [force].

    Parameters
    ----------
    wall
        The walls.
    distance, contact_distance, rate, mass
        As of a `TouchingPair`.

    """
    law = wall.law
    first = law_first(law, distance, contact_distance)
    energy, second = law_energy(law, distance, contact_distance), law_second(law, distance, contact_distance)
    pair = TouchingPair(distance, contact_distance, rate, energy, first, second, mass)
    return first + dashpot_of(wall.damping, pair) * rate


@effect
class Walls(NamedTuple):
    """Two smooth walls across an axis (0, 1 or 2), at `low` and `high`; particles touch them as they touch each other.

    A contact with a wall is one with the particle's mirror image, which moves as its mirror image does. At a distance D
    of the center the law is that of the distance rho = 2 D and the contact distance 2 r. The force on the particle is
    that of the pair, -u'(rho) - damping d(rho)/dt, where the image comes closer twice as fast as the particle: a
    dashpot brakes a disc of speed v by 2 v damping, and one such as `Restitution` takes from a particle what it takes
    from each of two equal ones that meet head on. As only one of the two is there, it has half the pair's energy,
    u(rho) / 2, whose slope by D is the force, and a stiffness of 2 u''(rho). With the law of the pairs a particle
    rebounds from a wall as each of two equal ones that meet head on; where it reaches d into the wall it is pressed as
    by an equal one at an overlap of 2 d. The law is a LinearSpring unless given, whatever the scene's pairs have.

    An ellipse or spheroid reaches h(n) = sqrt(n A n) toward a wall, and touches it where D is smaller; as its image
    touches it at the wall, rho = 2 D r / h, with the contact distance 2 r. The wall turns it, too. Of a rigid body each
    bead touches its own image, not those of other beads, which only beads pressed deep into a wall would reach.

    Walls are smooth: scenes with friction are refused, and need rough walls, of particles that are held. Walls stand
    still. The box goes on behind them: it must be longer than from wall to wall by more than particles press into both,
    or these touch each other through the walls.
    """

    axis: float = 1.0
    low: float = 0.0
    high: float = 1.0
    law: Law = LinearSpring()
    damping: float | ContactDamping | Restitution | ViscoelasticDamping = 0.0

    acts_as = "walls"  # type: ignore[misc]

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if self.axis not in (0.0, 1.0, 2.0):
            return f"axis must be 0, 1 or 2, got {self.axis!r}"
        return "" if self.low < self.high else f"high must be above low ({self.low!r}), got {self.high!r}"

    def body_force(
        self, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
    ) -> tuple[float, float, float]:
        """Return the push of the walls [force]."""
        at, speed = x, u
        if self.axis == 1.0:
            at, speed = y, v
        if self.axis == 2.0:
            at, speed = z, w
        push = 0.0
        if at - self.low < radius:
            push -= first_on_wall(self, 2.0 * (at - self.low), 2.0 * radius, 2.0 * speed, 0.5 * mass)
        if self.high - at < radius:
            push += first_on_wall(self, 2.0 * (self.high - at), 2.0 * radius, -2.0 * speed, 0.5 * mass)
        if self.axis == 0.0:
            return push, 0.0, 0.0
        if self.axis == 1.0:
            return 0.0, push, 0.0
        return 0.0, 0.0, push

    def body_energy(self, x: float, y: float, z: float, mass: float, radius: float) -> float:
        """Return the energy of a particle against both walls [energy]."""
        at = x
        if self.axis == 1.0:
            at = y
        if self.axis == 2.0:
            at = z
        energy = 0.0
        if at - self.low < radius:
            energy += 0.5 * law_energy(self.law, 2.0 * (at - self.low), 2.0 * radius)
        if self.high - at < radius:
            energy += 0.5 * law_energy(self.law, 2.0 * (self.high - at), 2.0 * radius)
        return energy

    def body_second(
        self, x: float, y: float, z: float, mass: float, radius: float
    ) -> tuple[float, float, float, float, float, float]:
        """Return the second derivatives of its energy, xx, yy, zz, yz, xz, xy [energy/length^2]."""
        at = x
        if self.axis == 1.0:
            at = y
        if self.axis == 2.0:
            at = z
        second = 0.0
        if at - self.low < radius:
            second += 2.0 * law_second(self.law, 2.0 * (at - self.low), 2.0 * radius)
        if self.high - at < radius:
            second += 2.0 * law_second(self.law, 2.0 * (self.high - at), 2.0 * radius)
        if self.axis == 0.0:
            return second, 0.0, 0.0, 0.0, 0.0, 0.0
        if self.axis == 1.0:
            return 0.0, second, 0.0, 0.0, 0.0, 0.0
        return 0.0, 0.0, second, 0.0, 0.0, 0.0

    def body_stiffness(self, radius: float) -> float:
        """Return the stiffness at contact [energy/length^2]."""
        return 2.0 * abs(law_second(self.law, 2.0 * radius * 0.999999, 2.0 * radius))

    def body_damping(self, radius: float, mass: float) -> float:
        """Return the coefficient of the dashpot of a particle and its image, at an overlap of 0.1 [mass/time]."""
        at = 2.0 * radius * (1.0 - _OVERLAP), 2.0 * radius
        energy, first, second = (part(self.law, *at) for part in (law_energy, law_first, law_second))
        return dashpot_of(self.damping, TouchingPair(*at, 0.0, energy, first, second, 0.5 * mass))


# fields that may be negative
SIGNED = {Gravity: ("x", "y", "z"), Walls: ("low", "high")}


def body_force(
    effect: Any, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
) -> tuple[float, float, float]:
    """Return the force of one effect on a particle at (x, y, z) with the peculiar velocity (u, v, w) [force]."""
    hook = getattr(effect, "body_force", None)
    return (0.0, 0.0, 0.0) if hook is None else hook(x, y, z, u, v, w, mass, radius)


def body_energy(effect: Any, x: float, y: float, z: float, mass: float, radius: float) -> float:
    """Return the energy of a particle under one effect [energy]."""
    hook = getattr(effect, "body_energy", None)
    return 0.0 if hook is None else hook(x, y, z, mass, radius)


def body_second(
    effect: Any, x: float, y: float, z: float, mass: float, radius: float
) -> tuple[float, float, float, float, float, float]:
    """Return the second derivatives xx, yy, zz, yz, xz, xy of a particle's energy [energy/length^2]."""
    hook = getattr(effect, "body_second", None)
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0) if hook is None else hook(x, y, z, mass, radius)


def spin_drag(effect: Any) -> float:
    """Return the rate at which one effect lets spins relax to the flow's [1/time]."""
    hook = getattr(effect, "spin_drag", None)
    return 0.0 if hook is None else hook()


@compiled_form(body_force)
def _body_force(effect: Any, x: Any, y: Any, z: Any, u: Any, v: Any, w: Any, mass: Any, radius: Any) -> Any:
    function = hook_of(effect, "body_force")
    if function is None:
        return lambda effect, x, y, z, u, v, w, mass, radius: (0.0, 0.0, 0.0)
    return function


@compiled_form(body_energy)
def _body_energy(effect: Any, x: Any, y: Any, z: Any, mass: Any, radius: Any) -> Any:
    function = hook_of(effect, "body_energy")
    if function is None:
        return lambda effect, x, y, z, mass, radius: 0.0
    return function


@compiled_form(body_second)
def _body_second(effect: Any, x: Any, y: Any, z: Any, mass: Any, radius: Any) -> Any:
    function = hook_of(effect, "body_second")
    if function is None:
        return lambda effect, x, y, z, mass, radius: (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return function


@compiled_form(spin_drag)
def _spin_drag(effect: Any) -> Any:
    function = hook_of(effect, "spin_drag")
    if function is None:
        return lambda effect: 0.0
    return function
