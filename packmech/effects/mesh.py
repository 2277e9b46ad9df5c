# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Walls of triangles, and the record that stands for them inside loops."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.check import brief, entries, finite_array
from packmech.contacts.triangles import (
    EDGE,
    FACE,
    face_area_of,
    first_near,
    make_triangles,
    next_near,
    touch_of_triangle,
)
from packmech.effects.body import ROUGHNESS, Walls, first_on_wall, walls_by_rows
from packmech.effects.damping import ContactDamping, Restitution, ViscoelasticDamping
from packmech.effects.friction import Friction
from packmech.effects.laws import Law, LinearSpring, law_energy, law_first, law_second
from packmech.effects.pair import bound_effect, inner_record, plain_record
from packmech.effects.partners import equal_partners
from packmech.effects.rolling import Rolling, RoughContacts, TwistingResistance

# area of a triangle over the square of the mesh's extent below which it is none
_FLAT = 1e-14
# places of a rough surface at which a sphere may touch it at once
_SLOTS = 16


def flat_triangles(corner_tcd: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which triangles have no area beside the size of all, by the corners of each."""
    size = float(np.ptp(corner_tcd.reshape(-1, 3), axis=0).max())
    return np.asarray(face_area_of(corner_tcd) <= _FLAT * size**2)


@inner_record
class MeshRows(NamedTuple):
    """Walls of triangles as loops over single particles know them."""

    law: Any
    damping: Any
    triangles: Any

    def body_energy(self, x, y, z, mass, radius):
        """Return the energy of a particle, half of that with its images [energy]."""
        near, energy = first_near(self.triangles, x, y, z, radius), 0.0
        while near.number >= 0:
            touch = touch_of_triangle(self.triangles, near)
            if touch.touches:
                energy += 0.5 * law_energy(self.law, 2.0 * touch.distance, equal_partners(2.0 * radius))
            near = next_near(self.triangles, near)
        return energy

    def body_force(self, x, y, z, u, v, w, mass, radius):
        """Return the push on a particle [force]."""
        near = first_near(self.triangles, x, y, z, radius)
        fx = fy = fz = 0.0
        while near.number >= 0:
            touch = touch_of_triangle(self.triangles, near)
            if touch.touches:
                n = touch.n
                rate = 2.0 * (u * n[0] + v * n[1] + w * n[2])
                push = -first_on_wall(self, 2.0 * touch.distance, 2.0 * radius, rate, 0.5 * mass)
                fx += push * n[0]
                fy += push * n[1]
                fz += push * n[2]
            near = next_near(self.triangles, near)
        return fx, fy, fz

    def body_second(self, x, y, z, mass, radius):
        """Return the second derivatives of the energy, xx, yy, zz, yz, xz, xy [energy/length^2]."""
        near = first_near(self.triangles, x, y, z, radius)
        xx = yy = zz = yz = xz = xy = 0.0
        while near.number >= 0:
            touch = touch_of_triangle(self.triangles, near)
            if touch.touches:
                image = equal_partners(2.0 * radius)
                steep = 2.0 * law_second(self.law, 2.0 * touch.distance, image)
                # where what is touched does not go along with the particle: across an edge, and about a corner
                bend = law_first(self.law, 2.0 * touch.distance, image) / touch.distance if touch.part != FACE else 0.0
                edge = bend if touch.part == EDGE else 0.0
                a, b, c = touch.n
                p, q, r = touch.along
                xx += (steep - bend) * a * a - edge * p * p + bend
                yy += (steep - bend) * b * b - edge * q * q + bend
                zz += (steep - bend) * c * c - edge * r * r + bend
                yz += (steep - bend) * b * c - edge * q * r
                xz += (steep - bend) * a * c - edge * p * r
                xy += (steep - bend) * a * b - edge * p * q
            near = next_near(self.triangles, near)
        return xx, yy, zz, yz, xz, xy


@shown()
@bound_effect
@dataclass(frozen=True, eq=False)
class MeshWalls:
    """A wall of triangles that spheres touch from either side: a hopper, a drum, a mould, read by `pm.read_mesh`.

    A contact is one with the mirror image behind the place of the surface that is nearest, as of `Walls`: with the
    distance D of the center from there, the law is that of the distance 2 D and the contact distance 2 r, and the
    energy half of it. Distances to faces, edges and corners are exact. A sphere touches wherever its distance from the
    surface has a minimum on it: once over the edge between two triangles of one plane, once on an edge that stands out,
    at each side of a groove. Contacts whose directions differ by less than ten degrees count as one, the nearest, so
    that a surface which is bent in by less from triangle to triangle, as a drum is, is touched once, too. Energies are
    continuous while spheres reach into the surface by less than 1.5 % of their radius. One that is pressed deeper into
    a facet, by more than 1 - cos(a), meets the next one of a groove of angle a at once with a force, not from zero on,
    and a run gains or loses that energy: a stiffer law, or a finer surface, mends it.

    Friction, and resistance to rolling and twisting, are as on `Walls`: the slip is that of the sphere's surface where
    it touches, the arm its distance from there. A contact that goes on over the edge between two triangles keeps its
    springs, which turn with its direction; so does one that goes over to the next facet of a surface bent in by less
    than ten degrees. One at another side of a groove has springs of its own. A sphere has them at up to 16 places of a
    rough surface: a run in which one touches it at more, as on the tip of a cone of many facets, ends with
    `Outcome.TOO_MANY_TOUCHES`. A scene whose contacts have friction, or resist rolling, must say what its surfaces do:
    Friction(0.0) makes them smooth.

    At rest. The surface is not repeated with the box, and periodic images do not touch it: spheres meet it
    where their positions say, inside the cell or not. It takes spheres.

    Parameters
    ----------
    vertices
        (V, 3) corners [length].
    triangles
        (T, 3) numbers of the three corners of each triangle.
    law
        What pushes at an overlap with the image; a LinearSpring unless given.
    damping
        Coefficient of a dashpot [mass/time], or one such as `Restitution`.
    friction
        `Friction` of the surface; none unless given.
    rolling, twisting
        `RollingResistance`, `ConstantRolling` or `ViscousRolling`, and `TwistingResistance` of the surface; none unless
        given.

    Raises
    ------
    TypeError, ValueError
        If an array is wrong, or a triangle has no area.

    Examples
    --------
    >>> import packmech as pm
    >>> floor = pm.MeshWalls([[0, 0, 1], [4, 0, 1], [0, 4, 1], [4, 4, 1]], [[0, 1, 2], [1, 3, 2]])
    >>> ball = pm.Packing([[2.0, 2.0, 1.45]], [0.5], pm.Box.cubic(4.0, 3))
    >>> pm.forces(pm.Scene(ball, (pm.Repulsion(), floor))).round(12).tolist()
    [[0.0, 0.0, 0.1]]

    """

    vertices: ArrayLike
    triangles: ArrayLike
    law: Law = LinearSpring()
    damping: float | ContactDamping | Restitution | ViscoelasticDamping = 0.0
    friction: Friction | None = None
    rolling: Rolling | None = None
    twisting: TwistingResistance | None = None

    moves: ClassVar[bool] = False
    acts_as: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        vertex = finite_array("vertices", self.vertices, shape=(None, 3), what="vertex")
        number = entries("triangles", self.triangles, "iu", "whole numbers")
        if number.ndim != 2 or number.shape[1] != 3 or not len(number):
            raise ValueError(
                f"triangles must be a (T, 3) array of whole numbers, the corners of each, got {brief(self.triangles)}"
            )
        number = number.astype(np.int64)
        if number.min() < 0 or number.max() >= len(vertex):
            raise ValueError(f"triangles must name vertices below {len(vertex)}, got {number.min()} to {number.max()}")
        corner = vertex[number]
        flat = flat_triangles(corner)
        if flat.any():
            raise ValueError(
                f"triangles must have an area, got none of number {int(np.argmax(flat))}: pm.read_mesh(..., "
                "drop_flat=True) leaves such triangles out"
            )
        for array in (vertex, number):
            array.setflags(write=False)
        object.__setattr__(self, "vertices", vertex)
        object.__setattr__(self, "triangles", number)
        fault = self.flat.fault()
        if fault:
            raise ValueError(fault)

    def __len__(self) -> int:
        return len(self.corner_tcd)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MeshWalls) and self._compared() == other._compared()

    def __hash__(self) -> int:
        return hash(self._compared())

    def _compared(self) -> tuple[Any, ...]:
        vertex, number = np.asarray(self.vertices), np.asarray(self.triangles)
        return vertex.tobytes(), number.tobytes(), self.law, self.damping, *self._across

    @property
    def _across(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in ROUGHNESS)

    @property
    def acts_also(self) -> tuple[str, ...]:
        """Columns of the table of effects beside "mesh"."""
        return () if self.roughness is None else ("rough",)

    @property
    def roughness(self) -> Friction | RoughContacts | None:
        """What acts across contacts with the surface; None where it is smooth."""
        return self.flat.roughness

    @property
    def slots(self) -> int:
        """Number of places at which a sphere may touch it at once where it is rough."""
        return min(len(self), _SLOTS)

    def resistances(self, radii: Iterable[float], mass: float) -> list[Any]:
        """Return what acts across contacts of particles of these radii, as of `Walls`."""
        return self.flat.resistances(radii, mass)

    @cached_property
    def corner_tcd(self) -> NDArray[np.float64]:
        """The (T, 3, 3) corners of the triangles [length]."""
        found: NDArray[np.float64] = np.asarray(self.vertices)[np.asarray(self.triangles)]
        return found

    @cached_property
    def rows(self) -> MeshRows:
        """What stands for it inside loops."""
        flat = plain_record(self.flat)
        return MeshRows(flat.law, flat.damping, make_triangles(self.corner_tcd))

    @property
    def flat(self) -> Walls:
        """Flat walls that do the same to what touches them."""
        return Walls._make((0.0, 0.0, 1.0, self.law, self.damping, *self._across, None, None))

    def body_energy(self, x: float, y: float, z: float, mass: float, radius: float) -> float:
        """Return the energy of a particle [energy]."""
        return float(self.rows.body_energy(x, y, z, mass, radius))

    def body_force(
        self, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
    ) -> tuple[float, float, float]:
        """Return the push on a particle [force]."""
        push: tuple[float, float, float] = self.rows.body_force(x, y, z, u, v, w, mass, radius)
        return push

    def body_second(
        self, x: float, y: float, z: float, mass: float, radius: float
    ) -> tuple[float, float, float, float, float, float]:
        """Return the second derivatives of its energy, xx, yy, zz, yz, xz, xy [energy/length^2]."""
        second: tuple[float, float, float, float, float, float] = self.rows.body_second(x, y, z, mass, radius)
        return second


def in_loops(effect: Any, kind_n: NDArray[np.int64]) -> Any:
    """Return what stands for an effect inside loops over single particles, of (N,) kinds in their order: mostly itself.

    Walls of triangles, and those that differ by kinds, have records of their own.
    """
    if isinstance(effect, MeshWalls):
        return effect.rows
    return walls_by_rows(effect, kind_n) if isinstance(effect, Walls) else effect
