"""Effects on single particles: gravity, walls, drag."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.check import brief
from packmech.effects.damping import ContactDamping, Restitution, ViscoelasticDamping
from packmech.effects.friction import Friction, Mindlin, at_contact
from packmech.effects.kinds import PerKind, at_kind, kinds_by_rows, largest_number, rows_in
from packmech.effects.laws import Law, LinearSpring, law_energy, law_first, law_second
from packmech.effects.pair import TouchingPair, effect, hook_of, pair_damping
from packmech.effects.partners import equal_partners
from packmech.effects.rolling import (
    ConstantRolling,
    Rolling,
    RollingResistance,
    RoughContacts,
    TwistingResistance,
    ViscousRolling,
    at_normal_force,
    resistances,
    roughness_of,
    springs_of,
)
from packmech.effects.wall_motion import HeldStress, WallMotion, moved_along
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, device
from packmech.packing import Packing

# of each `Walls`, low and high
SIDES = 2
# numbers before those of the springs of a contact with a surface of triangles: the direction to it
DIRECTION_COLUMNS = 3
# cosine of the angle between directions below which a contact with a surface is the same: no two at once are that near
SAME_DIRECTION = math.cos(math.radians(5.0))
# what acts across contacts, by the names that walls give it
ROUGHNESS: dict[str, tuple[type, ...]] = {
    "friction": (Friction,),
    "rolling": (RollingResistance, ConstantRolling, ViscousRolling),
    "twisting": (TwistingResistance,),
}
# what may differ by the kind of the particle that touches walls
PER_KIND = (
    "law",
    "damping",
    "damping.coefficient",
    "damping.time",
    "friction.coefficient",
    "friction.stiffness.poisson_ratio",
)
# relative overlaps at which what walls do is looked up
_BARELY, _OVERLAP = 1e-9, 0.1


class _Gravity(NamedTuple):
    x: float = 0.0
    y: float = -1.0
    z: float = 0.0


@effect
class Gravity(_Gravity):
    """The same acceleration for every particle [length/time^2]; no potential is periodic, so put a wall in its way.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    x, y, z
        Along the axes; those that are left out are 0 where one is given. Without any, 1 down the second axis.

    Examples
    --------
    >>> Gravity(), Gravity(z=-9.81)
    (Gravity(x=0.0, y=-1.0, z=0.0), Gravity(x=0.0, y=0.0, z=-9.81))

    """

    def __new__(cls, x: float | None = None, y: float | None = None, z: float | None = None) -> Gravity:
        """Return the record: down, unless an axis is named."""
        given = (x, y, z) if any(one is not None for one in (x, y, z)) else (0.0, -1.0, 0.0)
        return super().__new__(cls, *(0.0 if one is None else one for one in given))

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

    Its numbers are checked when a `Scene` is made with it.
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
    law, image = wall.law, equal_partners(contact_distance)
    first = law_first(law, distance, image)
    energy, second = law_energy(law, distance, image), law_second(law, distance, image)
    pair = TouchingPair(distance, contact_distance, rate, energy, first, second, mass, image.effective_radius, 0)
    return first + dashpot_of(wall.damping, pair) * rate


@effect
class Walls(NamedTuple):
    """Two walls across an axis (0, 1 or 2), at `low` and `high`; particles touch them as they touch each other.

    A contact with a wall is one with the particle's mirror image, which moves as its mirror image does. At a distance D
    of the center the law is that of the distance rho = 2 D and the contact distance 2 r. The force on the particle is
    that of the pair, -u'(rho) - damping d(rho)/dt, where the image comes closer twice as fast as the particle: a
    dashpot brakes a disc of speed v by 2 v damping, and one such as `Restitution` takes from a particle what it takes
    from each of two equal ones that meet head on. As only one of the two is there, it has half the pair's energy,
    u(rho) / 2, whose slope by D is the force, and a stiffness of 2 u''(rho). With the law of the pairs a particle
    rebounds from a wall as each of two equal ones that meet head on; where it reaches d into the wall it is pressed as
    by an equal one at an overlap of 2 d. So `ElasticSpheres` of the pairs make a wall rigid, twice as stiff as a thick
    plate of the particles' material: `Material.walls` makes such plates. The law is a LinearSpring unless given,
    whatever the scene's pairs have, or in scene files with a table [material] that of the material.

    An ellipse or spheroid reaches h(n) = sqrt(n A n) toward a wall, and touches it where D is smaller; as its image
    touches it at the wall, rho = 2 D r / h, with the contact distance 2 r. The wall turns it, too. So it is of
    superellipsoids, with their own support h (`Superellipsoids.surface_points`). Of a rigid body each bead touches its
    own image, not those of other beads, which only beads pressed deep into a wall would reach.

    Walls have a friction of their own, with its own coefficient, spring and dashpot; so does what resists rolling and
    twisting. Where the center is at the distance D, the slip is that of the particle's surface there, the arm D, and
    the normal force that of the wall. `Mindlin` takes the wall's stiffness 2 u''(rho), `DampingRatio` the coefficient
    2 c of its dashpot at the particle's speed. A scene whose contacts have friction, or resist rolling, must say what
    its walls do: Friction(0.0) makes them smooth. Rough walls touch discs and spheres, in a box that does not deform.

    What walls do may differ by the kind of the particle that touches them (`Packing.kind_n`): the law by `LawPerKind`,
    numbers of damping and friction by `PerKind`. `of(kind)` returns the walls as particles of one kind meet them.

    Walls stand still, but for faces that are given a motion: with a velocity, or a stress that they hold
    (`WallMotion`). `pm.simulate` moves them, in a box that does not deform, and discs or spheres between them, and ends
    before they meet; calls of what is at rest refuse them. The box goes on behind the walls: it must be longer than
    from wall to wall by more than particles press into both, or these touch each other through the walls. What begins
    with a packing takes particles where they are in the cell; where walls reach out of it, in the one that has its
    middle between them.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    axis
        0, 1 or 2: the walls stand across x, y or z.
    low, high
        Places of the two walls [length].
    law
        What pushes at an overlap with the image, or `LawPerKind`, in scene files
        { kind = "law-per-kind", laws = [{ ... }, { ... }] }.
    damping
        Coefficient of a dashpot [mass/time], or `PerKind`, or a dashpot such as `Restitution`.
    friction
        `Friction` of the walls, in scene files { kind = "friction", coefficient = 0.3 }; none unless given.
    rolling, twisting
        `RollingResistance`, `ConstantRolling` or `ViscousRolling`, and `TwistingResistance` of the walls, tables of
        these kinds; none unless given.
    low_motion, high_motion
        `WallMotion` of either face, in scene files { x = 0.1, y = { stress = -1e-3, inertia = 10.0 } }; it stands
        still unless given.

    """

    axis: float = 1.0
    low: float = 0.0
    high: float = 1.0
    law: Law = LinearSpring()
    damping: float | PerKind | ContactDamping | Restitution | ViscoelasticDamping = 0.0
    friction: Friction | None = None
    rolling: Rolling | None = None
    twisting: TwistingResistance | None = None
    low_motion: WallMotion | None = None
    high_motion: WallMotion | None = None

    acts_as = "walls"  # type: ignore[misc]

    @property
    def acts_also(self) -> tuple[str, ...]:
        """Columns of the table of effects beside "walls"."""
        there = {"rough": self.roughness is not None, "moving": self.moves, "kinds": bool(rows_in(self))}
        return tuple(column for column, acts in there.items() if acts)

    @property
    def moves(self) -> bool:
        """Whether a face is given a motion."""
        return self.low_motion is not None or self.high_motion is not None

    @property
    def still(self) -> Walls:
        """The same walls, standing still where they are."""
        return self._replace(low_motion=None, high_motion=None)

    @property
    def roughness(self) -> Friction | RoughContacts | None:
        """What acts across contacts with the walls; None where they are smooth."""
        found = roughness_of(tuple(one for one in (self.friction, self.rolling, self.twisting) if one is not None))
        return None if isinstance(found, Friction) and not largest_number(found.coefficient) else found

    def of(self, kind: int) -> Walls:
        """Return the walls as particles of a kind meet them; the same for all where nothing differs by kinds."""
        found: Walls = at_kind(self, kind)
        return found

    @property
    def of_kinds(self) -> tuple[Walls, ...]:
        """The walls as particles of each kind meet them; themselves alone where nothing differs by kinds."""
        rows = rows_in(self)
        return tuple(self.of(kind) for kind in range(len(rows[0][1]))) if rows else (self,)

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        rows = rows_in(self)
        for name, row in rows:
            if name not in PER_KIND:
                known = ", ".join(PER_KIND)
                return f"{name} must be the same for all kinds of particles (only {known} may differ), got {row}"
            if len(row) != len(rows[0][1]):
                return f"{name} must be for as many kinds as {rows[0][0]}, {len(rows[0][1])}, got {len(row)}"
        if self.axis not in (0.0, 1.0, 2.0):
            return f"axis must be 0, 1 or 2, got {brief(self.axis)}"
        for name, kinds in ROUGHNESS.items():
            value = getattr(self, name)
            if value is not None and not isinstance(value, kinds):
                words = ", ".join(f"{kind.__name__}(...)" for kind in kinds)
                return f"{name} must be {words} or None, got {brief(value)}"
        for name, value in (("low_motion", self.low_motion), ("high_motion", self.high_motion)):
            if value is not None and not isinstance(value, WallMotion):
                return f"{name} must be WallMotion(...) or None, got {brief(value)}"
        return "" if self.low < self.high else f"high must be above low ({self.low!r}), got {brief(self.high)}"

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
            energy += 0.5 * law_energy(self.law, 2.0 * (at - self.low), equal_partners(2.0 * radius))
        if self.high - at < radius:
            energy += 0.5 * law_energy(self.law, 2.0 * (self.high - at), equal_partners(2.0 * radius))
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
            second += 2.0 * law_second(self.law, 2.0 * (at - self.low), equal_partners(2.0 * radius))
        if self.high - at < radius:
            second += 2.0 * law_second(self.law, 2.0 * (self.high - at), equal_partners(2.0 * radius))
        if self.axis == 0.0:
            return second, 0.0, 0.0, 0.0, 0.0, 0.0
        if self.axis == 1.0:
            return 0.0, second, 0.0, 0.0, 0.0, 0.0
        return 0.0, 0.0, second, 0.0, 0.0, 0.0

    def body_stiffness(self, radius: float, overlap: float = 1e-6) -> float:
        """Return the stiffness at a relative overlap [energy/length^2]."""
        return 2.0 * abs(law_second(self.law, 2.0 * radius * (1.0 - overlap), equal_partners(2.0 * radius)))

    def resistances(self, radii: Iterable[float], mass: float) -> list[Any]:
        """Return what acts across contacts of particles of these radii: friction, what resists rolling and twisting.

        What follows from the contact, a friction's spring and dashpot or `ViscousRolling`, for each radius, barely
        touching and pressed deep; rolling as of `at_normal_force`.
        """
        there = [(radius, overlap) for radius in radii for overlap in (_BARELY, _OVERLAP)]
        found: list[Any] = []
        for one in resistances(self.roughness):
            if not one.coefficient > 0.0:
                continue
            if isinstance(one, Friction) and not all(isinstance(number, float) for number in one):
                found += [
                    at_contact(one, self.body_stiffness(*at), 2.0 * self.body_damping(at[0], mass, at[1]), 0)
                    for at in there
                ]
            elif isinstance(one, Friction):
                found.append(one)
            elif isinstance(one, ViscousRolling):
                found += [at_normal_force(one, self._normal_force(*at)) for at in there]
            else:
                found.append(at_normal_force(one, 0.0))
        return found

    def _normal_force(self, radius: float, overlap: float) -> float:
        """Return the force on a particle at a relative overlap with its image, without dashpots [force]."""
        return abs(law_first(self.law, 2.0 * radius * (1.0 - overlap), equal_partners(2.0 * radius)))

    def body_damping(self, radius: float, mass: float, overlap: float = 0.1) -> float:
        """Return the coefficient of the dashpot of a particle and its image, at a relative overlap [mass/time]."""
        image = equal_partners(2.0 * radius)
        distance = (1.0 - overlap) * image.contact_distance
        energy, first, second = (part(self.law, distance, image) for part in (law_energy, law_first, law_second))
        pair = TouchingPair(distance, 2.0 * radius, 0.0, energy, first, second, 0.5 * mass, image.effective_radius)
        return dashpot_of(self.damping, pair)


class KindWalls(NamedTuple):
    """Walls that differ by kinds of particles, as loops over these know them: those of each kind, and kinds by rows.

    roughs are what acts across contacts with each, of one class; Nones where the walls are smooth.
    """

    walls: Any
    roughs: Any
    kind_n: NDArray[np.int64]


# an effect on single particles as a row meets it: of walls that differ by kinds those of the row's kind
on_row = by_type(lambda one, i: one, {KindWalls: lambda one, i: one.walls[one.kind_n[i]]})


def walls_met(wall: Walls, packing: Packing) -> tuple[Walls, ...]:
    """Return walls as particles of each kind that a packing has meet them; themselves alone without rows by kinds."""
    if not rows_in(wall):
        return (wall,)
    return tuple(wall.of(kind) for kind in np.unique(kinds_by_rows(packing)).tolist())


def walls_by_rows(wall: Walls, kind_n: NDArray[np.int64]) -> Walls | KindWalls:
    """Return walls as loops over particles of (N,) kinds, in their order, know them; themselves without rows."""
    if not rows_in(wall):
        return wall
    of_kinds, rough = wall.of_kinds, wall.roughness
    frictions: list[Any] = [None if rough is None else one.friction or Friction(0.0) for one in of_kinds]
    roughs = [rough._replace(friction=one) if isinstance(rough, RoughContacts) else one for one in frictions]
    return KindWalls(of_kinds, tuple(roughs), kind_n)


def is_walls(effect: Any) -> bool:
    """Return whether an effect is `Walls` or a surface of triangles, which may be rough."""
    return isinstance(effect, Walls) or getattr(effect, "acts_as", None) == "mesh"


def rough_walls(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the walls and surfaces with friction, or with resistance to rolling or twisting, among the effects."""
    return tuple(one for one in effects if is_walls(one) and one.roughness is not None)


def visited_walls(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the walls that push rows by more than a still and smooth one does: rough ones, and those that move."""
    return tuple(one for one in effects if is_walls(one) and (one.roughness is not None or one.moves))


def wall_columns(walls: tuple[Any, ...], dimension: int) -> tuple[list[int], int]:
    """Return which columns of `TangentialDisplacements.wall_stretch_wk` rough walls use, and how many there are.

    Of each wall, low before high: sliding (1 or 3), `Mindlin`'s stiffness, rolling (1 or 3), and twisting. Of a surface
    of triangles the same for each of its slots, after the direction to the contact (3).
    """
    used: list[int] = []
    turns, first = 1 if dimension == 2 else 3, 0
    for one in walls:
        slots, ahead = (SIDES, 0) if isinstance(one, Walls) else (one.slots, DIRECTION_COLUMNS)
        rough = springs_of(one.roughness)
        friction, rolling, twisting = rough if isinstance(rough, RoughContacts) else (rough, None, None)
        for _ in range(slots):
            used += range(first, first + ahead + turns)
            first += ahead + turns
            used += [first] if friction and isinstance(friction.stiffness, Mindlin) else []
            used += range(first + 1, first + turns + 1) if rolling else []
            used += [first + turns + 1] if twisting else []
            first += turns + 2
    return used, first


def refuse_walls(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse walls that do not say what they do where contacts have friction, and rough ones that touch shapes.

    Raises
    ------
    ValueError
        Naming the walls.

    """
    for k, one in enumerate(effects):
        if getattr(one, "acts_as", None) == "mesh" and (packing.dimension == 2 or packing.shapes.has_orientations):
            what = "discs" if packing.dimension == 2 else packing.shapes.names[1]
            raise ValueError(
                f"effects[{k}] must be no MeshWalls for {what}: they take spheres, got {len(one)} triangles"
            )
        # of a surface Friction(0.0) alone says that it is smooth
        smooth = getattr(one, "acts_as", None) == "mesh" and one.friction is not None and one.roughness is None
        if smooth or getattr(one, "acts_as", None) not in ("walls", "mesh"):
            continue
        for name, kinds in ROUGHNESS.items():
            found = next((m for m, other in enumerate(effects) if isinstance(other, kinds)), None)
            kind = kinds[0] if found is None else type(effects[found])
            if found is not None and not is_walls(one):
                raise ValueError(
                    f"effects must hold no {type(one).__qualname__} beside {kind.__name__}, which would have no part "
                    f"in what walls do, got them at {k} and {found}: take pm.Walls, or held particles "
                    "(pm.FixedParticles)"
                )
            if found is not None and getattr(one, name) is None:
                raise ValueError(
                    f"effects[{k}].{name} of {type(one).__name__} must be given where contacts have {kind.__name__} "
                    f"(effects[{found}]), got None: {name}=pm.{kind.__name__}(...), or pm.{kind.__name__}(0.0) for "
                    "walls without"
                )
        if not isinstance(one, Walls):
            continue
        if one.axis >= packing.dimension:
            raise ValueError(f"effects[{k}].axis must be 0 or 1 in a plane, got {one.axis:g}")
        if one.roughness is not None and packing.shapes.has_orientations:
            raise ValueError(
                f"effects[{k}] must be smooth Walls, with friction=pm.Friction(0.0), for {packing.shapes.names[1]}: "
                f"rough ones touch discs and spheres, got {brief(one.roughness)}"
            )
        if one.moves and packing.shapes.has_orientations:
            raise ValueError(
                f"effects[{k}] must be Walls that stand still for {packing.shapes.names[1]}: those that move push "
                f"discs and spheres, got {brief(one.low_motion)} and {one.high_motion!r}"
            )
        for name in ("low_motion", "high_motion"):
            motion = moved_along(getattr(one, name))
            beyond = motion[packing.dimension :]
            if any(beyond):
                raise ValueError(f"effects[{k}].{name}.z must be zero in a plane, got {brief(beyond[0])}")
            idle = [a for a, along in enumerate(motion) if a != one.axis and along != 0.0]
            if idle and one.roughness is None:
                raise ValueError(
                    f"effects[{k}].{name}.{'xyz'[idle[0]]} must be zero for smooth walls, which drag nothing along, "
                    f"got {brief(motion[idle[0]])}: give friction=pm.Friction(...)"
                )
        if one.twisting is not None and packing.dimension == 2:
            raise ValueError(
                f"effects[{k}].twisting must be None in a plane, where nothing twists, got {brief(one.twisting)}"
            )


# fields that may be negative
SIGNED = {
    Gravity: ("x", "y", "z"),
    Walls: ("low", "high"),
    WallMotion: ("x", "y", "z"),
    HeldStress: ("stress", "velocity"),
}


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
