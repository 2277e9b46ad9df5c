"""What acts on the single particles of a packing at rest: energies, forces, second derivatives; held particles."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.contacts.triangles import surface_touches
from packmech.contacts.wall_touches import WallTouches, wall_touches
from packmech.effects.body import Gravity, Walls, body_energy, body_force, body_second, on_row
from packmech.effects.friction import Friction
from packmech.effects.held import FixedParticles
from packmech.effects.kinds import LawPerKind, kinds_by_rows, number_at
from packmech.effects.mesh import MeshWalls, in_loops
from packmech.effects.pair import ContactTerms, contact_terms, equal_touches
from packmech.effects.repulsion import Repulsion
from packmech.jit.compiled import device, kernel
from packmech.packing import Packing


class SingleTerms(NamedTuple):
    """Energies (N,), forces (N, d) and second derivatives (N, d, d) of particles under what acts on single ones.

    size_n (N,) are the sizes of the forces of each effect, added up, and acting_n (N,) how many are not zero: a weight
    and the floor that bears it balance, but both are forces.
    """

    energy_n: NDArray[np.float64]
    force_nd: NDArray[np.float64]
    second_ndd: NDArray[np.float64]
    size_n: NDArray[np.float64]
    acting_n: NDArray[np.int64]


def single_effects(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the effects that give single particles an energy, such as gravity and walls; drag is none of them."""
    return tuple(one for one in effects if hasattr(type(one), "body_energy"))


def single_rows(effects: tuple[Any, ...], kind_n: NDArray[np.int64]) -> tuple[Any, ...]:
    """Return the same as loops over single particles, of (N,) kinds in their order, know them (`in_loops`)."""
    return tuple(in_loops(one, kind_n) for one in single_effects(effects))


def refuse_free_fall(effects: tuple[Any, ...]) -> None:
    """Refuse weights that nothing bears: what falls through a periodic box comes to no rest.

    Raises
    ------
    ValueError
        Naming what is missing.

    """
    acting = single_effects(effects)
    falls = all(isinstance(one, Gravity) for one in acting) and any(any(one) for one in acting)
    if falls and not any(isinstance(one, FixedParticles) for one in effects):
        raise ValueError(
            "scene.effects must hold what bears weights where particles come to rest, Walls or FixedParticles, got "
            "Gravity alone"
        )


def lacking_second(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the potentials of single particles that give no second derivatives."""
    return tuple(one for one in single_effects(effects) if not hasattr(type(one), "body_second"))


def needs_second(effects: tuple[Any, ...], what: str) -> None:
    """Refuse effects on single particles whose second derivatives are not known, for what needs them."""
    for k, one in enumerate(effects):
        if hasattr(type(one), "body_energy") and not hasattr(type(one), "body_second"):
            name = type(one).__qualname__
            raise ValueError(
                f"scene.effects[{k}] must have the method body_second(x, y, z, mass, radius) for {what}, got {name} "
                "without it"
            )


def acts_on_single(effects: tuple[Any, ...]) -> bool:
    """Return whether anything pushes or holds single particles: potentials and walls, or what holds them."""
    return bool(single_effects(effects)) or any(isinstance(one, FixedParticles) and one.particles for one in effects)


def held_velocity(effects: tuple[Any, ...], particles: int, dimension: int) -> NDArray[np.float64]:
    """Return (N, d) velocities of the particles that are held, zero for all others.

    Raises
    ------
    ValueError
        If a velocity has not as many numbers as there are axes, or a particle is moved twice.

    """
    velocity = np.zeros((particles, dimension))
    for k, one in enumerate(effects):
        if isinstance(one, FixedParticles) and one.velocity:
            if len(one.velocity) != dimension:
                raise ValueError(
                    f"scene.effects[{k}].velocity must have {dimension} numbers, one for each axis, got {one.velocity}"
                )
            mine = one.marked(particles)
            others = (
                other.marked(particles)
                for m, other in enumerate(effects)
                if m != k and isinstance(other, FixedParticles)
            )
            if any((mine & other).any() for other in others):
                raise ValueError(f"scene.effects[{k}].particles must be held by nothing else where they move")
            velocity[mine] = one.velocity
    return velocity


@device
def _size(vector: Any) -> float:
    square = vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
    return math.sqrt(square)


@kernel
def _single_terms(  # type: ignore[no-untyped-def]
    effects, position_n3, mass_n, radius_n, energy_n, force_n3, second_n6, size_n, acting_n
):
    for i in range(position_n3.shape[0]):
        x, y, z = position_n3[i, 0], position_n3[i, 1], position_n3[i, 2]
        energy = fx = fy = fz = size = 0.0
        acting = 0
        xx = yy = zz = yz = xz = xy = 0.0
        for one in literal_unroll(effects):
            met = on_row(one, i)
            energy += body_energy(met, x, y, z, mass_n[i], radius_n[i])
            force = body_force(met, x, y, z, 0.0, 0.0, 0.0, mass_n[i], radius_n[i])
            fx += force[0]
            fy += force[1]
            fz += force[2]
            own = _size(force)
            size += own
            acting += own > 0.0
            second = body_second(met, x, y, z, mass_n[i], radius_n[i])
            xx += second[0]
            yy += second[1]
            zz += second[2]
            yz += second[3]
            xz += second[4]
            xy += second[5]
        energy_n[i] = energy
        size_n[i], acting_n[i] = size, acting
        force_n3[i, 0], force_n3[i, 1], force_n3[i, 2] = fx, fy, fz
        second_n6[i, 0], second_n6[i, 1], second_n6[i, 2] = xx, yy, zz
        second_n6[i, 3], second_n6[i, 4], second_n6[i, 5] = yz, xz, xy


# places in a symmetric matrix of the six second derivatives
_PLACES = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def vectors_outside(effects: tuple[Any, ...], packing: Packing) -> NDArray[np.float64]:
    """Return the (N, d) numbers of lattice vectors by which particles are outside the cell that walls stand in.

    The cell begins at the origin; along an axis whose walls reach out of it, half its height before the middle between
    these, so that what is between the walls stays there. Zeros beside a surface of triangles, which particles meet
    where their positions say.
    """
    box, begin_d = packing.box, np.zeros(packing.dimension)
    if any(getattr(one, "acts_as", "") == "mesh" for one in effects):
        return np.zeros_like(packing.position_nd)
    for one in effects:
        axis = int(one.axis) if getattr(one, "acts_as", "") == "walls" else packing.dimension
        height = box.height_across(axis) if axis < packing.dimension else None
        if height is not None and (one.low < 0.0 or one.high > height) and one.high - one.low <= height:
            along = int(np.abs(box.lattice_dd[axis]).argmax())
            begin_d[along] = 0.5 * (one.low + one.high) / box.lattice_dd[axis, along] - 0.5
    return np.floor(packing.position_nd @ box.inverse_dd.T - begin_d)


def places_in_cell(
    effects: tuple[Any, ...], packing: Packing, position_nd: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the (N, 3) places that walls and potentials see: those of the images in the cell (`vectors_outside`).

    Parameters
    ----------
    effects
        The scene's effects.
    packing
        The packing.
    position_nd
        Other positions of its particles, near its own: the image is that of the packing's.

    """
    own = packing.position_nd
    wrap = vectors_outside(effects, packing)
    place = np.zeros((packing.particles, 3))
    place[:, : packing.dimension] = (own if position_nd is None else position_nd) - wrap @ packing.box.lattice_dd.T
    return place


def single_terms(
    effects: tuple[Any, ...], packing: Packing, position_nd: NDArray[np.float64] | None = None
) -> SingleTerms:
    """Return what the effects on single particles make of the packing's; zeros where there are none.

    Parameters
    ----------
    effects
        The scene's effects.
    packing, position_nd
        As in `places_in_cell`.

    """
    n, d = packing.particles, packing.dimension
    energy, force, second = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 6))
    size, number = np.zeros(n), np.zeros(n, dtype=np.int64)
    acting = single_rows(effects, kinds_by_rows(packing))
    if acting:
        place = places_in_cell(effects, packing, position_nd)
        mass = np.ascontiguousarray(packing.mass_n, dtype=np.float64)
        _single_terms(acting, place, mass, packing.radius_n, energy, force, second, size, number)
    return SingleTerms(energy, force[:, :d], second[:, _PLACES[:d, :d]], size, number)


class ShapedTerms(NamedTuple):
    """Energies (N,) of particles with shapes under what acts on single ones, and their derivatives.

    slope_nx (N, X) and second_nxx (N, X, X) are by positions and rotations, X = 3 in a plane and 6 in space;
    stiffness_nxx is the part of the latter that is left where nothing presses; size_n and acting_n as in `SingleTerms`.
    """

    energy_n: NDArray[np.float64]
    slope_nx: NDArray[np.float64]
    second_nxx: NDArray[np.float64]
    stiffness_nxx: NDArray[np.float64]
    size_n: NDArray[np.float64]
    acting_n: NDArray[np.int64]


def total_push(terms: SingleTerms | ShapedTerms, held_n: NDArray[np.bool_] | None) -> tuple[float, int]:
    """Return the sum of the sizes of all forces on single particles that are not held, and how many there are."""
    free = slice(None) if held_n is None else ~held_n
    return float(terms.size_n[free].sum()), int(terms.acting_n[free].sum())


def refuse_unknown_to_shapes(scene: Any, *, single: bool = True) -> None:
    """Refuse effects that would take shapes for discs or spheres.

    Those are tangential forces and walls of one's own; Friction, Walls, potentials of the center, and particles that
    are held are known, but for calls that know effects of pairs alone.

    Parameters
    ----------
    scene
        The scene; one of discs or spheres has nothing that is unknown.
    single
        Whether the call knows effects on single particles.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    shapes = scene.packing.shapes
    for k, one in enumerate(scene.effects if shapes.has_orientations else ()):
        kind = type(one)
        alone = hasattr(kind, "body_energy") or hasattr(one, "particles")
        own_walls = getattr(one, "acts_as", None) == "walls" and not isinstance(one, Walls)
        own_friction = hasattr(kind, "tangential_force") and not isinstance(one, Friction)
        if own_friction or own_walls or (alone and not single):
            raise ValueError(
                f"scene.effects must hold no {kind.__qualname__} for {type(shapes).__name__}, which it would take for "
                f"discs or spheres, got it at {k}: leave it out with scene.without(pm.{kind.__qualname__})"
            )


class WallSide(NamedTuple):
    """What touches one of two walls: place of the effect among all, the walls, 1 for that below or -1, touches, kinds.

    Of a surface of triangles, which is of one side, the number is 0. kind_w are the (W,) kinds of the particles.
    """

    place: int
    wall: Any
    below: float
    touches: WallTouches
    kind_w: NDArray[np.int64]

    def terms(self) -> ContactTerms:
        """Return the (W,) energies of particles with their images in the wall, and derivatives by their distances."""
        law, distance, sigma = self.wall.law, self.touches.distance_w, self.touches.contact_distance_w
        if not isinstance(law, LawPerKind):
            return contact_terms((Repulsion(law=law),), equal_touches(distance, sigma))
        found = ContactTerms(*(np.zeros(len(sigma)) for _ in ContactTerms._fields))
        for kind in np.unique(self.kind_w).tolist():
            mine = self.kind_w == kind
            own = contact_terms((Repulsion(law=law.of(kind)),), equal_touches(distance[mine], sigma[mine]))
            for whole, part in zip(found, own, strict=True):
                whole[mine] = part
        return found

    @property
    def coefficient_w(self) -> NDArray[np.float64]:
        """The (W,) coefficients of friction [1]."""
        friction = self.wall.friction
        coefficient = 0.0 if friction is None else number_at(friction.coefficient, self.kind_w)
        return np.broadcast_to(np.asarray(coefficient, dtype=np.float64), len(self.touches))

    @property
    def is_first(self) -> bool:
        """Whether it is the first or only side of its effect."""
        return self.below >= 0.0

    @property
    def steepness_w(self) -> NDArray[np.float64]:
        """The (W,) sizes of the slopes of the distances with the image [1]."""
        if not self.below:
            return np.full(len(self.touches), 2.0)
        return np.abs(self.touches.slope_wx[:, int(self.wall.axis)])

    def normal_wd(self, dimension: int) -> NDArray[np.float64]:
        """Return the (W, d) directions from the particles to the wall [1]."""
        if not self.below:
            return -0.5 * self.touches.slope_wx[:, :dimension]
        normal = np.zeros((len(self.touches), dimension))
        normal[:, int(self.wall.axis)] = -self.below
        return normal


def _touches_of(
    wall: Walls | MeshWalls, packing: Packing, place_n3: NDArray[np.float64]
) -> list[tuple[float, WallTouches]]:
    """Return what touches either of two walls, or a surface, by the number that stands for it in `WallSide`."""
    if isinstance(wall, MeshWalls):
        return [(0.0, surface_touches(wall.rows.triangles, place_n3, packing.radius_n))]
    axis = int(wall.axis)
    heights = (1.0, place_n3[:, axis] - wall.low), (-1.0, wall.high - place_n3[:, axis])
    return [(below, wall_touches(packing, height, axis, below)) for below, height in heights]


def flat_sides(effects: tuple[Any, ...], packing: Packing) -> list[WallSide]:
    """Return what touches each flat wall, that below before that above."""
    return wall_sides(tuple(one if isinstance(one, Walls) else None for one in effects), packing)


def wall_sides(effects: tuple[Any, ...], packing: Packing) -> list[WallSide]:
    """Return what touches each wall, that below before that above, and each surface of triangles."""
    found: list[WallSide] = []
    walls = [(k, one) for k, one in enumerate(effects) if isinstance(one, Walls | MeshWalls)]
    place = places_in_cell(effects, packing) if walls else np.zeros((0, 3))
    kind_n = kinds_by_rows(packing)
    for k, one in walls:
        for below, touches in _touches_of(one, packing, place):
            found.append(WallSide(k, one, below, touches, kind_n[touches.particle_w]))
    return found


def shaped_terms(effects: tuple[Any, ...], packing: Packing) -> ShapedTerms:
    """Return what effects on single particles make of a packing: walls turn those with shapes, all else does not.

    Parameters
    ----------
    effects
        The scene's effects.
    packing
        The packing.

    """
    n, d = packing.particles, packing.dimension
    size = d + (1 if d == 2 else 3)
    others = single_terms(tuple(one for one in effects if not isinstance(one, Walls)), packing)
    energy, slope = others.energy_n.copy(), np.zeros((n, size))
    second, stiffness = np.zeros((n, size, size)), np.zeros((n, size, size))
    slope[:, :d] = -others.force_nd
    second[:, :d, :d] = stiffness[:, :d, :d] = others.second_ndd
    push_kn: dict[int, NDArray[np.float64]] = {}
    for side in flat_sides(effects, packing):
        k, wall, touches, terms = side.place, side.wall, side.touches, side.terms()
        # half of what the particle and its mirror image have together
        first, steep = 0.5 * terms.first_c, 0.5 * terms.second_c
        np.add.at(energy, touches.particle_w, 0.5 * terms.energy_c)
        np.add.at(slope, touches.particle_w, first[:, None] * touches.slope_wx)
        np.add.at(push_kn.setdefault(k, np.zeros(n)), touches.particle_w, first * touches.slope_wx[:, int(wall.axis)])
        steep_wxx = steep[:, None, None] * touches.slope_wx[:, :, None] * touches.slope_wx[:, None, :]
        np.add.at(stiffness, touches.particle_w, steep_wxx)
        np.add.at(second, touches.particle_w, steep_wxx + first[:, None, None] * touches.curvature_wxx)
    sizes = [others.size_n, *(np.abs(push_n) for push_n in push_kn.values())]
    acting = [others.acting_n, *(push_n != 0.0 for push_n in push_kn.values())]
    return ShapedTerms(energy, slope, second, stiffness, np.sum(sizes, axis=0), np.sum(acting, axis=0))
