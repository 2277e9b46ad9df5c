# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What depends on the shapes of particles in a time step: the type of what is given chooses, here and nowhere else.

Discs and spheres have none (None), ellipses and spheroids `ShapeRows` (their functions are in `shape_pairs`), rigid
bodies of beads and superellipsoids `BodyRows` (`rigid_bodies`). A pair of bodies may touch in many places, counted by
k; each touch has a distance rho and its slopes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import effective_radius
from packmech.dynamics import rigid_bodies as of_bodies
from packmech.dynamics import shape_pairs as of_spheroids
from packmech.dynamics.friction import relax_columns, slip_of_discs, turning_axes
from packmech.dynamics.rigid_bodies import BodyRows, body_rows
from packmech.effects import body_energy, body_force
from packmech.jit.by_type import by_type
from packmech.jit.compiled import inlined
from packmech.minimize.passes.interaction_rows import law_between
from packmech.minimize.passes.kernels import coincident_direction
from packmech.minimize.passes.shape_rows import ShapeRows, ShapeTouch, shape_rows
from packmech.packing import Packing

Shaped = ShapeRows | BodyRows


def by_shape(discs: Any, spheroids: Any, bodies: Any) -> Any:
    """Return a function that runs one of three, by its first argument: None, `ShapeRows` or `BodyRows`."""
    return by_type(discs, {ShapeRows: spheroids, BodyRows: bodies})


@inlined
def _law_of_bodies(shapes, effects, body, i, j, r):
    return law_between(shapes.beads, effects, body, i, j, r)


# the PairLaw of interactions between two rows at a distance, and the slopes of the alignment along rotations of i
law_of_rows = by_shape(law_between, law_between, _law_of_bodies)


def shapes_in_motion(packing: Packing, order_n: NDArray[np.int64]) -> Shaped | None:
    """Return the shapes of a packing by rows, turned as they are; None for discs and spheres."""
    shapes: Any = packing.shapes
    for rows in shape_rows(packing, order_n):
        if not isinstance(rows, ShapeRows):
            return body_rows(rows, shapes.select(order_n))
        rows.unit_nd[:, : packing.dimension] = shapes.orientation_nq[order_n]
        return rows
    return None


def most_beads(packing: Packing) -> int:
    """Return how many beads a particle has at most; 1 without beads."""
    return int(np.diff(packing.shapes.start_n).max())


# Python's: radii of gyration [length], what holds how rows are turned, and moments of inertia from what rows hold


def _no_turns(shapes: None) -> NDArray[np.float64]:
    return np.zeros((0, 3))


# the array that holds how rows are turned; nothing of discs and spheres
turns_of = by_shape(_no_turns, lambda shapes: shapes.unit_nd, lambda bodies: bodies.turn_nq)
# puts in place what follows from the turns
place_turned = by_shape(lambda shapes: None, lambda shapes: None, of_bodies.place_bodies)
# (N,) moments of inertia of rows over their masses, of discs and spheres from (N,) radii and the dimension
inertia_per_mass = by_shape(
    lambda shapes, radius_n, d: (0.5 if d == 2 else 0.4) * radius_n**2,
    lambda shapes, radius_n, d: shapes.gyration_n**2,
    lambda bodies, radius_n, d: bodies.beads.gyration_n**2,
)


def _as_they_are(shapes: None, spin_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    return spin_nk


# what rows in space hold for (N, 3) angular velocities, and back
rows_of_spins = by_shape(_as_they_are, of_spheroids.rows_of_spins, of_bodies.rows_of_spins)
spins_of_rows = by_shape(_as_they_are, of_spheroids.spins_of_rows, of_bodies.spins_of_rows)


# contacts


@inlined
def _touch_of_discs(shapes, axes, body, pair, k):
    dx, dy, dz = pair.dx, pair.dy, pair.dz
    square = dx * dx + dy * dy
    if len(axes) == 3:
        square += dz * dz
    r = math.sqrt(square)
    inverse = 1.0 / r
    if square == 0.0:
        dx, dy, dz = coincident_direction(pair.i, pair.j, len(axes))
        inverse = 1.0
    size_i, size_j = body[pair.i, 3], body[pair.j, 3]
    sigma, effective = size_i + size_j, effective_radius(size_i, size_j)
    return ShapeTouch(
        True, r, sigma, effective, dx * inverse, dy * inverse, dz * inverse, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    )  # fmt: skip


@inlined
def _rate_of_discs(shapes, axes, body, pair, touch, u):
    rate = u[0] * touch.x + u[1] * touch.y
    if len(axes) == 3:
        rate += u[2] * touch.z
    return rate


@inlined
def _inertia_of_discs(shapes, axes, weight_nk, pair, touch):
    return _inverse(weight_nk[pair.i, 0] + weight_nk[pair.j, 0])


@inlined
def _inertia_of_spheroids(shapes, axes, weight_nk, pair, touch):
    # slopes have no part along a director, about which the moment of inertia is another
    i, j = pair.i, pair.j
    slope = touch.x * touch.x + touch.y * touch.y + touch.z * touch.z
    total = (weight_nk[i, 0] + weight_nk[j, 0]) * slope
    total += weight_nk[i, 1] * (touch.ix * touch.ix + touch.iy * touch.iy + touch.iz * touch.iz)
    return _inverse(total + weight_nk[j, 1] * (touch.jx * touch.jx + touch.jy * touch.jy + touch.jz * touch.jz))


@inlined
def _inertia_of_bodies(bodies, axes, weight_nk, pair, touch):
    i, j = pair.i, pair.j
    x, y, z = of_bodies.turned_by(bodies, axes, i, touch.ix, touch.iy, touch.iz)
    steep = of_bodies.steepness(bodies, touch)
    total = (weight_nk[i, 0] + weight_nk[j, 0]) * (steep * steep)
    total += weight_nk[i, 1] * (touch.ix * x + touch.iy * y + touch.iz * z)
    x, y, z = of_bodies.turned_by(bodies, axes, j, touch.jx, touch.jy, touch.jz)
    return _inverse(total + weight_nk[j, 1] * (touch.jx * x + touch.jy * y + touch.jz * z))


@inlined
def _inverse(total):
    return 1.0 / total if total > 0.0 else 0.0


@inlined
def _slip_of_discs(shapes, axes, body, pair, k, touch, u):
    return slip_of_discs(axes, body, pair.i, pair.j, touch, u)


@inlined
def _no_torques(shapes, touch, first, on_i, on_j):
    return on_i, on_j


@inlined
def _torques_of_slopes(shapes, touch, first, on_i, on_j):
    return (
        (on_i[0] - first * touch.ix, on_i[1] - first * touch.iy, on_i[2] - first * touch.iz),
        (on_j[0] - first * touch.jx, on_j[1] - first * touch.jy, on_j[2] - first * touch.jz),
    )


@inlined
def _one(shapes, i, j):
    return 1


@inlined
def _whole(shapes, touch):
    return 1.0


@inlined
def _first_column(shapes, columns, stretch_pk, pair, k):
    return 0


@inlined
def _relax_one(shapes, columns, stretch_pk, p):
    relax_columns(columns, stretch_pk, p, 0)


@inlined
def _axes_of_friction(shapes, friction, axes):
    return turning_axes(friction, axes)


@inlined
def _axes_of_shapes(shapes, friction, axes):
    return turning_axes(axes, axes)


# in how many places rows i and j may touch
touches_of = by_shape(_one, _one, of_bodies.touches_of_bodies)
# the k-th touch of a pair of rows
touch_of_rows = by_shape(_touch_of_discs, of_spheroids.touch_of_spheroids, of_bodies.touch_of_bodies)
# the rate of its distance, from the velocity u of the centers
rate_of_touch = by_shape(_rate_of_discs, of_spheroids.rate_of_spheroids, of_bodies.rate_of_bodies)
# the inertia of the rows against a change of its distance; 0 where nothing can move
inertia_against = by_shape(_inertia_of_discs, _inertia_of_spheroids, _inertia_of_bodies)
# the size of the slope of its distance along the vector between the centers, which makes a force of the derivative
steepness = by_shape(_whole, of_spheroids.steepness, of_bodies.steepness)
# how the rows slip there
slip_at_touch = by_shape(_slip_of_discs, of_spheroids.slip_of_spheroids, of_bodies.slip_of_bodies)
# torques on both rows with those of the slopes of its distance along their turns
with_torques_of_slopes = by_shape(_no_torques, _torques_of_slopes, _torques_of_slopes)
# the first column of its spring in a row of stretches, and how those of a pair that is apart are set to zero
place_of_spring = by_shape(_first_column, _first_column, of_bodies.place_of_spring)
relax_all = by_shape(_relax_one, _relax_one, of_bodies.relax_all)
# a tuple as long as the torque of a contact: none of discs and spheres without friction
contact_axes = by_shape(_axes_of_friction, _axes_of_shapes, _axes_of_shapes)


# single particles


@inlined
def _stays(shapes, axes, half, low, high, dt):
    return None


@inlined
def _same(shapes, axes, i, wx, wy, wz):
    return wx, wy, wz


@inlined
def _push_on_disc(shapes, one, axes, body, i, mass):
    w = body[i, 6] if len(axes) == 3 else 0.0
    x, y, z = body_force(one, body[i, 0], body[i, 1], body[i, 2], body[i, 4], body[i, 5], w, mass, body[i, 3])
    return x, y, z, 0.0, 0.0, 0.0


@inlined
def _energy_of_disc(shapes, one, body, i, mass):
    return body_energy(one, body[i, 0], body[i, 1], body[i, 2], mass, body[i, 3])


@inlined
def _as_sums(shapes, axes, state, out, rotational, spinning):
    return None


@inlined
def _spinning_spheroids(shapes, axes, state, out, rotational, spinning):
    _clear(out, spinning)
    for i in range(state.body.shape[0]):
        out[rotational] += of_spheroids.energy_about_director(shapes, axes, state, i)
        _add(out, spinning, of_spheroids.inertial_stress(shapes, axes, state, i))


@inlined
def _spinning_bodies(bodies, axes, state, out, rotational, spinning):
    _clear(out, spinning)
    for i in range(state.body.shape[0]):
        out[rotational] += of_bodies.energy_about_axes(bodies, axes, state, i)
        _add(out, spinning, of_bodies.inertial_stress(bodies, axes, state, i))


@inlined
def _clear(out, place):
    for k in range(9):
        out[place + k] = 0.0


@inlined
def _add(out, place, symmetric):
    xx, xy, xz, yy, yz, zz = symmetric
    whole = (xx, xy, xz, xy, yy, yz, xz, yz, zz)
    for k in range(9):
        out[place + k] += whole[k]


# turns rows by a step at what `half` holds of turns
turn_shapes = by_shape(_stays, of_spheroids.turn_directors, of_bodies.turn_bodies)
# the force and the torque of one effect on a row, and its energy
push_on_row = by_shape(_push_on_disc, of_spheroids.push_on_spheroid, of_bodies.push_on_body)
energy_of_row = by_shape(_energy_of_disc, of_spheroids.energy_of_spheroid, of_bodies.energy_of_body)
# the angular velocity of a row in space, of what it holds
spin_of_turn = by_shape(_same, of_spheroids.spin_of_turn, of_bodies.turned_by)
# what a row holds where it turns with a flow
dragged_to = by_shape(_same, of_spheroids.dragged_to, of_bodies.dragged_to)
# what a row holds of an isotropic random vector, so that its square is as the inertia along each axis
spread_of_kicks = by_shape(_same, of_spheroids.spread_of_kicks, of_bodies.spread_of_kicks)
# puts into observables what rotation stretches shapes by, and adds what their energy of rotation is more than a row's
measure_spinning = by_shape(_as_sums, _spinning_spheroids, _spinning_bodies)
