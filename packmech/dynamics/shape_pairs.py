# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Ellipses and spheroids in a time step: their contacts, tangential springs, turns and observables; walls push them.

Rigid bodies of beads have theirs in `rigid_bodies`; the type of what is given chooses.

Contacts are those of minimization (`shape_touch`): a distance rho with slopes along the vector between the centers and
the rotations of both. A dashpot sees the rate of rho. A tangential force acts where the two touch when both are scaled
by s = rho / sigma. With the supports g = sqrt(n A n) of the shapes along the normal n this is s A_i n / g_i from one
center, and -s A_j n / g_j from the other; in a plane only their lengths along n count.

In space the row of a spheroid holds its angular momentum over its moment of inertia across the director, not its
angular velocity (`spin_in_space`): a free director turns at just this rate, which nothing but torques changes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.dynamics.deformation import relative
from packmech.dynamics.friction import (
    Contact,
    Slip,
    measure_spring,
    reset_stretch,
    spring_in_plane,
    spring_in_space,
)
from packmech.dynamics.pair_lists import NO_SLOT
from packmech.dynamics.rigid_bodies import (
    BodyRows,
    body_dragged_to,
    body_rows,
    body_spins_of_rows,
    energy_about_axes,
    energy_of,
    forces_of_bodies,
    inertial_stress_of_body,
    measure_bodies,
    place_bodies,
    push_of,
    rows_of_body_spins,
    slip_of_bodies,
    spin_of_body,
    stretched_matter,
    turn_bodies,
)
from packmech.effects import body_energy, body_force
from packmech.jit.compiled import compiled_form, inlined
from packmech.minimize.passes.kernels import coincident_direction
from packmech.minimize.passes.shape_rows import BeadRows, ShapeRows, shape_rows, shape_touch
from packmech.minimize.passes.shape_singles import Motion, energy_of_shape, push_on_shape
from packmech.packing import Packing
from packmech.shapes import Beads

Shaped = ShapeRows | BodyRows


def shapes_in_motion(packing: Packing, order_n: NDArray[np.int64]) -> Shaped | None:
    """Return the shapes of a packing by rows, turned as they are; None for discs and spheres."""
    shapes = packing.shapes
    for rows in shape_rows(packing, order_n):
        if isinstance(rows, BeadRows) and isinstance(shapes, Beads):
            return body_rows(rows, shapes.select(order_n))
        if isinstance(rows, ShapeRows) and shapes is not None:
            rows.unit_nd[:, : packing.dimension] = shapes.orientation_nq[order_n]
            return rows
    return None


def gyration_of(shapes: Shaped) -> NDArray[np.float64]:
    """Return the radii of gyration that rows of turns are measured by [length]."""
    return shapes.beads.gyration_n if isinstance(shapes, BodyRows) else shapes.gyration_n


def most_beads(packing: Packing) -> int:
    """Return how many beads a particle has at most; 1 without beads."""
    return int(np.diff(packing.shapes.start_n).max()) if isinstance(packing.shapes, Beads) else 1


def turns_of(shapes: Shaped) -> NDArray[np.float64]:
    """Return a copy of what holds how shapes are turned."""
    return (shapes.turn_nq if isinstance(shapes, BodyRows) else shapes.unit_nd).copy()


def set_turns(shapes: Shaped, turn_nq: NDArray[np.float64]) -> None:
    """Turn shapes as `turns_of` had them."""
    if isinstance(shapes, BodyRows):
        shapes.turn_nq[:] = turn_nq
        place_bodies(shapes)
    else:
        shapes.unit_nd[:] = turn_nq


def _choose(shapes: Any, of_bodies: Any, of_spheroids: Any) -> Any:
    """Return one of two functions by the class of a record, or of numba's type of one."""
    return of_bodies if getattr(shapes, "instance_class", type(shapes)) is BodyRows else of_spheroids


@inlined
def _touch(shapes, axes, i, j, dx, dy, dz):
    """Return the touch of two rows; coincident ones get a direction."""
    if dx * dx + dy * dy + dz * dz == 0.0:
        sigma = shapes.radius_n[i] + shapes.radius_n[j]
        nx, ny, nz = coincident_direction(i, j, len(axes))
        dx, dy, dz = 1e-9 * sigma * nx, 1e-9 * sigma * ny, 1e-9 * sigma * nz
    return shape_touch(shapes, i, j, 0, dx, dy, dz, len(axes))


@inlined
def _rate(axes, body, touch, i, j, ux, uy, uz):
    """Return the rate of rho."""
    rate = ux * touch.x + uy * touch.y
    if len(axes) == 2:
        return rate + touch.iz * body[i, 6] + touch.jz * body[j, 6]
    rate += uz * touch.z
    rate += touch.ix * body[i, 7] + touch.iy * body[i, 8] + touch.iz * body[i, 9]
    return rate + touch.jx * body[j, 7] + touch.jy * body[j, 8] + touch.jz * body[j, 9]


@inlined
def _arm(shapes, touch, i, nx, ny):
    """Return the distance of a center from the tangent at the touch."""
    along = shapes.unit_nd[i, 0] * nx + shapes.unit_nd[i, 1] * ny
    a, b = shapes.along_n[i] * along, shapes.across_n[i]
    return touch.rho / touch.sigma * math.sqrt(a * a + b * b * (1.0 - along * along))


@inlined
def _slip_in_plane(shapes, body, touch, i, j, ux, uy):
    """Return the normal, arms, and the slip along t = (-ny, nx)."""
    inverse = 1.0 / math.sqrt(touch.x * touch.x + touch.y * touch.y)
    nx, ny = inverse * touch.x, inverse * touch.y
    ai, aj = _arm(shapes, touch, i, nx, ny), _arm(shapes, touch, j, nx, ny)
    return nx, ny, ai, aj, uy * nx - ux * ny - ai * body[i, 6] - aj * body[j, 6]


@inlined
def excess_of_spin(along, across):
    """Return by how much the moment of inertia across the director exceeds that about it, over the latter [1]."""
    return 0.5 * (along - across) * (along + across) / (across * across)


@inlined
def spin_in_space(shapes, body, i):
    """Return the angular velocity of a spheroid."""
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    about = body[i, 7] * x + body[i, 8] * y + body[i, 9] * z
    about *= excess_of_spin(shapes.along_n[i], shapes.across_n[i])
    return body[i, 7] + about * x, body[i, 8] + about * y, body[i, 9] + about * z


def rows_of_spins(shapes: Shaped, spin_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the rows of shapes in space hold for angular velocities."""
    if isinstance(shapes, BodyRows):
        return rows_of_body_spins(shapes, spin_nk)
    about = (spin_nk * shapes.unit_nd).sum(axis=1, keepdims=True)
    excess = excess_of_spin(shapes.along_n, shapes.across_n)[:, None]
    return np.asarray(spin_nk - excess / (1.0 + excess) * about * shapes.unit_nd)


def spins_of_rows(shapes: Shaped, row_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angular velocities of shapes in space."""
    if isinstance(shapes, BodyRows):
        return body_spins_of_rows(shapes, row_nk)
    about = (row_nk * shapes.unit_nd).sum(axis=1, keepdims=True)
    return np.asarray(row_nk + excess_of_spin(shapes.along_n, shapes.across_n)[:, None] * about * shapes.unit_nd)


@inlined
def dragged_to(shapes, axes, i, wx, wy, wz):
    """Return what the row of a particle holds where it turns with a flow in space."""
    if shapes is None or len(axes) == 2:
        return wx, wy, wz
    return _dragged_to(shapes, i, wx, wy, wz)


def _dragged_to(shapes: Any, i: Any, wx: Any, wy: Any, wz: Any) -> Any:
    """Return what the row of a shape holds where it turns with a flow in space."""
    return _choose(shapes, body_dragged_to, _spheroid_dragged_to)(shapes, i, wx, wy, wz)


@compiled_form(_dragged_to, inline=True)
def _choose_dragged_to(shapes: Any, i: Any, wx: Any, wy: Any, wz: Any) -> Any:
    return _choose(shapes, body_dragged_to, _spheroid_dragged_to)


@inlined
def _spheroid_dragged_to(shapes, i, wx, wy, wz):
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    excess = excess_of_spin(shapes.along_n[i], shapes.across_n[i])
    about = -excess / (1.0 + excess) * (wx * x + wy * y + wz * z)
    return wx + about * x, wy + about * y, wz + about * z


def push_on_row(one: Any, shapes: Any, axes: Any, body: Any, i: int, mass: float) -> Any:
    """Return the force and the torque of one effect on a particle of a time step."""
    raise NotImplementedError("particles are pushed in compiled loops")


@compiled_form(push_on_row, inline=True)
def _choose_push_on_row(one: Any, shapes: Any, axes: Any, body: Any, i: Any, mass: Any) -> Any:
    if isinstance(shapes, types.NoneType):
        return _push_on_disc
    return _choose(shapes, _push_on_body, _push_on_spheroid)


@inlined
def _push_on_disc(one, shapes, axes, body, i, mass):
    w = body[i, 6] if len(axes) == 3 else 0.0
    x, y, z = body_force(one, body[i, 0], body[i, 1], body[i, 2], body[i, 4], body[i, 5], w, mass, body[i, 3])
    return x, y, z, 0.0, 0.0, 0.0


@inlined
def _push_on_body(one, bodies, axes, body, i, mass):
    return push_on_shape(one, bodies.beads, i, _motion(axes, body, i, spin_of_body(bodies, axes, body, i)), mass)


@inlined
def _push_on_spheroid(one, shapes, axes, body, i, mass):
    # the angular momentum over the moment across the director, which differs from the spin along the director alone
    spin = (body[i, 7], body[i, 8], body[i, 9]) if len(axes) == 3 else (0.0, 0.0, body[i, 6])
    return push_on_shape(one, shapes, i, _motion(axes, body, i, spin), mass)


@inlined
def _motion(axes, body, i, spin):
    w = body[i, 6] if len(axes) == 3 else 0.0
    return Motion(body[i, 0], body[i, 1], body[i, 2], body[i, 4], body[i, 5], w, spin[0], spin[1], spin[2])


def energy_of_row(one: Any, shapes: Any, body: Any, i: int, mass: float) -> float:
    """Return the energy of a particle of a time step under one effect."""
    raise NotImplementedError("particles are looked at in compiled loops")


@compiled_form(energy_of_row)
def _choose_energy_of_row(one: Any, shapes: Any, body: Any, i: Any, mass: Any) -> Any:
    if isinstance(shapes, types.NoneType):
        return lambda one, shapes, body, i, mass: body_energy(one, body[i, 0], body[i, 1], body[i, 2], mass, body[i, 3])
    if not hasattr(getattr(one, "instance_class", type(one)), "body_energy"):
        return lambda one, shapes, body, i, mass: 0.0
    return _choose(shapes, _energy_of_body, _energy_of_spheroid)


@inlined
def _energy_of_body(one, bodies, body, i, mass):
    return energy_of_shape(one, bodies.beads, i, body[i, 0], body[i, 1], body[i, 2], mass)[0]


@inlined
def _energy_of_spheroid(one, shapes, body, i, mass):
    return energy_of_shape(one, shapes, i, body[i, 0], body[i, 1], body[i, 2], mass)[0]


@inlined
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _support(shapes, i, normal):
    """Return a shape's support g along a normal, and the point A n / g of its surface where this is the normal."""
    unit = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    a, b = shapes.along_n[i], shapes.across_n[i]
    square, along = b * b, (a - b) * (a + b) * _dot(unit, normal)
    x = square * normal[0] + along * unit[0]
    y = square * normal[1] + along * unit[1]
    z = square * normal[2] + along * unit[2]
    size = math.sqrt(x * normal[0] + y * normal[1] + z * normal[2])
    inverse = 1.0 / size
    return size, (inverse * x, inverse * y, inverse * z)


@inlined
def _radii(shapes, i, size, point):
    """Return xx, xy, xz, yy, yz, zz of (A - p p) / g, which makes the change of the point p of one of the normal."""
    a, b = shapes.along_n[i], shapes.across_n[i]
    over, square, share = 1.0 / size, b * b, (a - b) * (a + b)
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    return (
        over * (square + share * x * x - point[0] * point[0]),
        over * (share * x * y - point[0] * point[1]),
        over * (share * x * z - point[0] * point[2]),
        over * (square + share * y * y - point[1] * point[1]),
        over * (share * y * z - point[1] * point[2]),
        over * (square + share * z * z - point[2] * point[2]),
    )


@inlined
def _times(m, v):
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[1] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[2] * v[0] + m[4] * v[1] + m[5] * v[2],
    )


@inlined
def _slip_in_space(shapes, body, touch, i, j, ux, uy, uz):
    """Return the normal, the point of contact from either center (of j: with the other sign), and the slip.

    With r = s (p_i + p_j), its rate and p' = w x p + R (n' - w x n), R of `_radii`, the normal turns by
    (R_i + R_j) n' = R_i (w_i x n) + R_j (w_j x n) + (v - r (v n) / (r n)) / s, v the velocity of contact points.
    """
    inverse = 1.0 / math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
    n = inverse * touch.x, inverse * touch.y, inverse * touch.z
    gi, pi = _support(shapes, i, n)
    gj, pj = _support(shapes, j, n)
    wi, wj = spin_in_space(shapes, body, i), spin_in_space(shapes, body, j)
    scale = touch.rho / touch.sigma
    one, other = _cross(wi, pi), _cross(wj, pj)
    vx, vy, vz = ux - scale * (one[0] + other[0]), uy - scale * (one[1] + other[1]), uz - scale * (one[2] + other[2])
    apart = _dot((vx, vy, vz), n)
    ri, rj = _radii(shapes, i, gi, pi), _radii(shapes, j, gj, pj)
    one, other = _times(ri, _cross(wi, n)), _times(rj, _cross(wj, n))
    under, share = 1.0 / scale, apart / (gi + gj) / scale
    turned = (
        one[0] + other[0] + under * vx - share * (pi[0] + pj[0]),
        one[1] + other[1] + under * vy - share * (pi[1] + pj[1]),
        one[2] + other[2] + under * vz - share * (pi[2] + pj[2]),
    )
    m = ri[0] + rj[0], ri[1] + rj[1], ri[2] + rj[2], ri[3] + rj[3], ri[4] + rj[4], ri[5] + rj[5]
    # across n the inverse of m is (trace - m) over the product of its two eigenvalues, by Cayley and Hamilton
    trace = m[0] + m[3] + m[5]
    product = m[0] * m[3] - m[1] * m[1] + m[0] * m[5] - m[2] * m[2] + m[3] * m[5] - m[4] * m[4]
    bent = _times(m, turned)
    rate = (
        (trace * turned[0] - bent[0]) / product,
        (trace * turned[1] - bent[1]) / product,
        (trace * turned[2] - bent[2]) / product,
    )
    ox, oy, oz = _cross(n, rate)
    about = 0.5 * (_dot(wi, n) + _dot(wj, n))
    slip = Slip(
        0.0, 0.0, vx - apart * n[0], vy - apart * n[1], vz - apart * n[2],
        ox + about * n[0], oy + about * n[1], oz + about * n[2],
    )  # fmt: skip
    return (
        n,
        (scale * pi[0], scale * pi[1], scale * pi[2]),
        (scale * pj[0], scale * pj[1], scale * pj[2]),
        slip,
    )


@inlined
def _friction(friction, shapes, axes, body, stretch_pk, p, touch, i, j, ux, uy, uz, elastic, pace):
    """Return the friction on i, and its torques on both; zeros without."""
    if friction is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    normal = abs(elastic) * math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
    if len(axes) == 2:
        nx, ny, ai, aj, slip = _slip_in_plane(shapes, body, touch, i, j, ux, uy)
        force = spring_in_plane(friction, stretch_pk, p, slip, normal, pace)
        return (force * -ny, force * nx, 0.0), (0.0, 0.0, ai * force), (0.0, 0.0, aj * force)
    n, pi, pj, turning = _slip_in_space(shapes, body, touch, i, j, ux, uy, uz)
    contact = Contact(i, j, n[0], n[1], n[2], ux, uy, uz, touch.rho, touch.sigma)
    across = spring_in_space(friction, stretch_pk, p, contact, turning, normal, pace)
    return across, _cross(pi, across), _cross(pj, across)


@inlined
def _forces_of_spheroids(shapes, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        reset_stretch(axes, stretch_pk, p)
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = relative(rates, axes, body, i, j, dx, dy, dz)
    rate = _rate(axes, body, touch, i, j, ux, uy, uz)
    first, elastic = push_of(effects, touch.rho, touch.sigma, rate)
    (fx, fy, fz), (ix, iy, iz), (jx, jy, jz) = _friction(
        friction, shapes, axes, body, stretch_pk, p, touch, i, j, ux, uy, uz, elastic, pace
    )
    return (
        True, first * touch.x + fx, first * touch.y + fy, first * touch.z + fz,
        ix - first * touch.ix, iy - first * touch.iy, iz - first * touch.iz,
        jx - first * touch.jx, jy - first * touch.jy, jz - first * touch.jz,
    )  # fmt: skip


def _forces(
    shapes: Any, effects: Any, friction: Any, rates: Any, axes: Any, body: Any, stretch_pk: Any,
    p: Any, i: Any, j: Any, dx: Any, dy: Any, dz: Any, pace: Any,
) -> Any:  # fmt: skip
    """Return whether two rows touch, the force on i, and the torques on both."""
    return _choose(shapes, forces_of_bodies, _forces_of_spheroids)(
        shapes, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
    )


@compiled_form(_forces, inline=True)
def _choose_forces(
    shapes: Any, effects: Any, friction: Any, rates: Any, axes: Any, body: Any, stretch_pk: Any,
    p: Any, i: Any, j: Any, dx: Any, dy: Any, dz: Any, pace: Any,
) -> Any:  # fmt: skip
    return _choose(shapes, forces_of_bodies, _forces_of_spheroids)


@inlined
def _relax(stretch_pk, p):
    """Set the springs of a pair that does not touch to zero; nothing where no stretches are held."""
    if stretch_pk is not None:
        for k in range(stretch_pk.shape[1]):
            stretch_pk[p, k] = 0.0


@inlined
def _add(axes, row_nk, n, fx, fy, fz, tx, ty, tz):
    row_nk[n, 0] += fx
    row_nk[n, 1] += fy
    if len(axes) == 2:
        row_nk[n, 2] += tz
    else:
        row_nk[n, 2] += fz
        row_nk[n, 3] += tx
        row_nk[n, 4] += ty
        row_nk[n, 5] += tz


@inlined
def shapes_of_block(shapes, effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b):
    """Add what touching pairs of a block's rows do to these, and leave in slots what they do to other blocks' rows."""
    slot_qk = pairs.slots.push_qk
    if effects is None:
        for q in range(pairs.slots.start_b[b], pairs.slots.start_b[b + 1]):
            slot_qk[q] = 0.0
        return
    special = pairs.start_s[2 * b + 1]
    for p in range(pairs.start_s[2 * b], pairs.start_s[2 * b + 2]):
        i, j, slot = pairs.i_p[p], pairs.j_p[p], NO_SLOT
        dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
        if p >= special:
            k, slot = pairs.image_p[p], pairs.slot_p[p]
            dx += pairs.shift_kd[k, 0]
            dy += pairs.shift_kd[k, 1]
            dz += pairs.shift_kd[k, 2]
        if slot != NO_SLOT:
            # a slot is its pair's alone; other slots of this block are filled while other blocks are dealt with
            slot_qk[slot] = 0.0
        reach = body[i, 3] + body[j, 3]
        if dx * dx + dy * dy + dz * dz >= reach * reach:
            _relax(stretch_pk, p)
            continue
        touching, fx, fy, fz, ix, iy, iz, jx, jy, jz = _forces(
            shapes, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
        )
        if touching:
            _add(axes, push, i, fx, fy, fz, ix, iy, iz)
            if slot == NO_SLOT:
                _add(axes, push, j, -fx, -fy, -fz, jx, jy, jz)
            else:
                _add(axes, slot_qk, slot, -fx, -fy, -fz, jx, jy, jz)


@inlined
def turn_shapes(shapes, axes, state, low, high, dt):
    """Turn the shapes of rows by a step at what `half` holds of turns; nothing without shapes."""
    if shapes is not None:
        _turn(shapes, axes, state.half, low, high, dt)


def _turn(shapes: Any, axes: Any, half: Any, low: Any, high: Any, dt: Any) -> None:
    """Turn the shapes of rows by a step."""
    _choose(shapes, turn_bodies, _turn_directors)(shapes, axes, half, low, high, dt)


@compiled_form(_turn, inline=True)
def _choose_turn(shapes: Any, axes: Any, half: Any, low: Any, high: Any, dt: Any) -> Any:
    return _choose(shapes, turn_bodies, _turn_directors)


@inlined
def _turn_directors(shapes, axes, half, low, high, dt):
    unit = shapes.unit_nd
    for i in range(low, high):
        x, y, z = unit[i, 0], unit[i, 1], unit[i, 2]
        if len(axes) == 2:
            angle = dt * half[i, 2]
            c, s = math.cos(angle), math.sin(angle)
            x, y = c * x - s * y, s * x + c * y
        else:
            u, v, w = dt * half[i, 3], dt * half[i, 4], dt * half[i, 5]
            angle = math.sqrt(u * u + v * v + w * w)
            # Rodrigues' formula; sin t / t and (1 - cos t) / t^2 without division by small angles
            share = math.sin(angle) / angle if angle > 0.0 else 1.0
            half_share = math.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
            bend = 0.5 * half_share * half_share * (u * x + v * y + w * z)
            c = math.cos(angle)
            x, y, z = (
                c * x + share * (v * z - w * y) + bend * u,
                c * y + share * (w * x - u * z) + bend * v,
                c * z + share * (u * y - v * x) + bend * w,
            )
        inverse = 1.0 / math.sqrt(x * x + y * y + z * z)
        unit[i, 0], unit[i, 1], unit[i, 2] = inverse * x, inverse * y, inverse * z


@inlined
def _slip(shapes, axes, body, touch, i, j, ux, uy, uz):
    """Return the first two numbers of the normal, the slip (its first number in a plane), and how the contact turns."""
    if len(axes) == 2:
        nx, ny, _, _, slip = _slip_in_plane(shapes, body, touch, i, j, ux, uy)
        return nx, ny, slip, 0.0, 0.0, 0.0, 0.0, 0.0
    n, _, _, turning = _slip_in_space(shapes, body, touch, i, j, ux, uy, uz)
    return n[0], n[1], turning.sx, turning.sy, turning.sz, turning.ox, turning.oy, turning.oz


def slip_of_shapes(
    shapes: Any, axes: Any, body: Any, flowing: Any, i: Any, j: Any, one: Any, other: Any, dx: Any, dy: Any, dz: Any
) -> Any:
    """Return whether two rows touch, bodies with these beads, and their slip as `slip_of` does."""
    return _choose(shapes, slip_of_bodies, _slip_of_spheroids)(
        shapes, axes, body, flowing, i, j, one, other, dx, dy, dz
    )


@compiled_form(slip_of_shapes)
def _choose_slip_of_shapes(
    shapes: Any, axes: Any, body: Any, flowing: Any, i: Any, j: Any, one: Any, other: Any, dx: Any, dy: Any, dz: Any
) -> Any:
    return _choose(shapes, slip_of_bodies, _slip_of_spheroids)


@inlined
def _slip_of_spheroids(shapes, axes, body, flowing, i, j, one, other, dx, dy, dz):
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        return False, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    return True, _slip(shapes, axes, body, touch, i, j, ux, uy, uz)


def measure_shapes(
    shapes: Any, effects: Any, friction: Any, flowing: Any, axes: Any, body: Any, stretch_pk: Any,
    p: Any, i: Any, j: Any, dx: Any, dy: Any, dz: Any, pace: Any,
) -> Any:  # fmt: skip
    """Return in how many places two rows touch, two energies, where they slide, elastic forces, the force on i."""
    return _choose(shapes, measure_bodies, _measure_spheroids)(
        shapes, effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
    )


@compiled_form(measure_shapes, inline=True)
def _choose_measure_shapes(
    shapes: Any, effects: Any, friction: Any, flowing: Any, axes: Any, body: Any, stretch_pk: Any,
    p: Any, i: Any, j: Any, dx: Any, dy: Any, dz: Any, pace: Any,
) -> Any:  # fmt: skip
    return _choose(shapes, measure_bodies, _measure_spheroids)


@inlined
def _measure_spheroids(shapes, effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    rate = _rate(axes, body, touch, i, j, ux, uy, uz)
    energy = energy_of(effects, touch.rho, touch.sigma)
    first, elastic = push_of(effects, touch.rho, touch.sigma, rate)
    normal = abs(elastic) * math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
    spring, sliding, fx, fy, fz = _measure_friction(
        friction, shapes, axes, body, stretch_pk, p, touch, i, j, ux, uy, uz, normal, pace
    )
    return 1, energy, spring, sliding, normal, first * touch.x + fx, first * touch.y + fy, first * touch.z + fz


@inlined
def _measure_friction(friction, shapes, axes, body, stretch_pk, p, touch, i, j, ux, uy, uz, normal, pace):
    """Return the energy of a tangential spring, whether it slides, and its force on i; zeros without friction."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    nx, ny, sx, sy, sz, ox, oy, oz = _slip(shapes, axes, body, touch, i, j, ux, uy, uz)
    return measure_spring(friction, axes, stretch_pk, p, nx, ny, sx, sy, sz, ox, oy, oz, normal, pace.after)


@inlined
def _inertial_stress_of_spheroid(shapes, axes, state, i, work_dd):
    """Write the integral of a x over a turning shape, a the acceleration by its rotation, its symmetric part.

    Half the second derivative of that of x x is that for the row's rate of turning, less the flux of momentum, which is
    that of the angular velocity.
    """
    d = len(axes)
    a, b = shapes.along_n[i], shapes.across_n[i]
    share = state.mass_n[i] * (0.25 if d == 2 else 0.2)
    ox = oy = 0.0
    px = py = 0.0
    inverse = state.weight_nk[i, 1]
    if d == 2:
        oz, pz = state.body[i, 6], inverse * state.push[i, 2]
    else:
        ox, oy, oz = state.body[i, 7], state.body[i, 8], state.body[i, 9]
        px, py, pz = inverse * state.push[i, 3], inverse * state.push[i, 4], inverse * state.push[i, 5]
    for k in range(3):
        for m in range(3):
            work_dd[1, k, m] = share * (a * a - b * b) * shapes.unit_nd[i, k] * shapes.unit_nd[i, m]
        if k < d:
            work_dd[1, k, k] += share * b * b
    stretched_matter(work_dd, ox, oy, oz, px, py, pz)
    if d == 3:
        own = spin_in_space(shapes, state.body, i)
        spin = ox, oy, oz
        flux = share * b * b
        for k in range(3):
            work_dd[0, k, k] += flux * (_dot(spin, spin) - _dot(own, own))
            for m in range(3):
                work_dd[0, k, m] += flux * (own[k] * own[m] - spin[k] * spin[m])


def _inertial_stress(shapes: Any, axes: Any, state: Any, i: Any, work_dd: Any) -> None:
    """Write the integral of a x over a turning shape, a the acceleration by its rotation, its symmetric part."""
    _choose(shapes, inertial_stress_of_body, _inertial_stress_of_spheroid)(shapes, axes, state, i, work_dd)


@compiled_form(_inertial_stress, inline=True)
def _choose_inertial_stress(shapes: Any, axes: Any, state: Any, i: Any, work_dd: Any) -> Any:
    return _choose(shapes, inertial_stress_of_body, _inertial_stress_of_spheroid)


@inlined
def _energy_about_director(shapes, axes, state, i):
    if len(axes) == 2 or state.weight_nk[i, 1] == 0.0:
        return 0.0
    about = 0.0
    for k in range(3):
        about += state.body[i, 7 + k] * shapes.unit_nd[i, k]
    return 0.5 / state.weight_nk[i, 1] * excess_of_spin(shapes.along_n[i], shapes.across_n[i]) * about * about


def _more_energy(shapes: Any, axes: Any, state: Any, i: Any) -> Any:
    """Return what a shape's energy of rotation is more than the row alone gives."""
    return _choose(shapes, energy_about_axes, _energy_about_director)(shapes, axes, state, i)


@compiled_form(_more_energy, inline=True)
def _choose_more_energy(shapes: Any, axes: Any, state: Any, i: Any) -> Any:
    return _choose(shapes, energy_about_axes, _energy_about_director)


@inlined
def spinning_shapes(shapes, axes, state, rotational, place, out):
    """Write the sum of `_inertial_stress` to a row of observables, and add to its energy of rotation; else nothing."""
    if shapes is None:
        return
    work = np.zeros((3, 3, 3))
    for k in range(9):
        out[place + k] = 0.0
    for i in range(state.body.shape[0]):
        out[rotational] += _more_energy(shapes, axes, state, i)
        _inertial_stress(shapes, axes, state, i, work)
        for k in range(3):
            for m in range(3):
                out[place + 3 * k + m] += work[0, k, m]
