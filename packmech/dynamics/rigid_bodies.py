# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Rigid bodies in a time step, of discs or spheres, or superellipsoids: contacts, how they turn, and their observables.

In a plane a body turns at the spin in its row. In space its row holds its angular momentum over the mean of its moments
of inertia, as nothing but torques changes that. With the energy of rotation as

    L^2 / (2 I_c) + L_b^2 (1 / I_b - 1 / I_c) / 2 + L_a^2 (1 / I_a - 1 / I_c) / 2,

c the axis of the middle moment, each part alone turns a body at a constant rate about L or about one of its axes. The
first one commutes with both others; these are taken as b for half a step, a, and b again. This is of second order,
symplectic and its own inverse, keeps L to rounding, and is exact where two moments are equal, as b is the axis whose
moment is nearer to the middle one (Touma and Wisdom, Astron. J. 107 (1994) 1189; Dullweber, Leimkuhler and McLachlan,
J. Chem. Phys. 107 (1997) 5840).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.fused_volume import body_moments
from packmech.contacts.gauge_contact import support, support_bend
from packmech.dynamics.friction import Slip, cross, dot, slip_of_round
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, kernel
from packmech.minimize.passes.kernels import coincident_direction
from packmech.minimize.passes.shape_rows import (
    BeadRows,
    GaugeRows,
    gauge_body,
    shape_touch,
    touch_of_two_beads,
    touches,
)
from packmech.minimize.passes.shape_singles import RowMotion, energy_of_shape, push_on_shape
from packmech.shapes import Beads, Superellipsoids


class BodyRows(NamedTuple):
    """Rigid bodies that are stepped through time, by rows.

    Attributes
    ----------
    beads
        Their beads, or superellipsoids; frames and arms are those of `turn_nq`.
    turn_nq
        (N, 4) unit quaternions; in a plane directions of the first axes, then zeros.
    share_nk
        (N, 3) mean of the moments of inertia over those about the axes [1].
    axis_nk
        (N, 3) axes c, b and a, as above.
    spread_ndd
        (N, 3, 3) second moments of their matter over mass, in their frames [length^2].

    """

    beads: BeadRows | GaugeRows
    turn_nq: NDArray[np.float64]
    share_nk: NDArray[np.float64]
    axis_nk: NDArray[np.int64]
    spread_ndd: NDArray[np.float64]


def body_rows(beads: BeadRows | GaugeRows, shapes: Beads | Superellipsoids) -> BodyRows:
    """Return bodies as they stand, from their beads by rows, and the shapes in the order of these."""
    n, d = len(shapes), shapes.dimension
    turn, share = np.zeros((n, 4)), np.ones((n, 3))
    turn[:, : shapes.orientation_nq.shape[1]] = shapes.orientation_nq
    axis = np.tile(np.arange(3), (n, 1))
    spread = np.zeros((n, 3, 3))
    spread[:, :d, :d] = body_moments(shapes) * beads.radius_n[:, None, None] ** 2
    square = shapes.gyration_nk**2
    if d == 3:
        share = square.mean(axis=1, keepdims=True) / square
        order = np.argsort(share, axis=1, kind="stable")
        least, middle, most = (np.take_along_axis(share, order[:, k, None], axis=1)[:, 0] for k in range(3))
        near = (most - middle < middle - least)[:, None]
        axis = np.hstack([order[:, 1:2], np.where(near, order[:, ::-2], order[:, ::2])])
    found = BodyRows(beads, turn, share, axis, spread)
    place_bodies(found)
    return found


@device
def _place_body(bodies, i):
    """Put the frame and the beads of a body where its turn has them."""
    beads, turn = bodies.beads, bodies.turn_nq
    frame = beads.frame_ndd
    w, x, y, z = turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3]
    if beads.dimension == 2:
        frame[i, 0, 0], frame[i, 0, 1], frame[i, 1, 0], frame[i, 1, 1] = w, -x, x, w
    else:
        frame[i, 0, 0], frame[i, 0, 1], frame[i, 0, 2] = (
            w * w + x * x - y * y - z * z,
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        )
        frame[i, 1, 0], frame[i, 1, 1], frame[i, 1, 2] = (
            2.0 * (x * y + w * z),
            w * w - x * x + y * y - z * z,
            2.0 * (y * z - w * x),
        )
        frame[i, 2, 0], frame[i, 2, 1], frame[i, 2, 2] = (
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            w * w - x * x - y * y + z * z,
        )
    for bead in range(beads.start_n[i], beads.start_n[i + 1]):
        u, v, w = beads.offset_bd[bead, 0], beads.offset_bd[bead, 1], beads.offset_bd[bead, 2]
        for k in range(beads.dimension):
            beads.arm_bd[bead, k] = frame[i, k, 0] * u + frame[i, k, 1] * v + frame[i, k, 2] * w


@kernel
def place_bodies(bodies):
    """Put frames and beads where the turns have them."""
    for i in range(bodies.turn_nq.shape[0]):
        _place_body(bodies, i)


@inlined
def _about_axis(turn, own, axis, angle):
    """Return the quaternion of a body turned about one of its axes, and a vector that stays, seen from the body."""
    w, x, y, z = turn
    u, v, t = own
    h, g = math.cos(0.5 * angle), math.sin(0.5 * angle)
    c, s = math.cos(angle), math.sin(angle)
    if axis == 0:
        return (h * w - g * x, h * x + g * w, h * y + g * z, h * z - g * y), (u, c * v + s * t, c * t - s * v)
    if axis == 1:
        return (h * w - g * y, h * x - g * z, h * y + g * w, h * z + g * x), (c * u - s * t, v, c * t + s * u)
    return (h * w - g * z, h * x + g * y, h * y - g * x, h * z + g * w), (c * u + s * v, c * v - s * u, t)


@inlined
def _of(vector, axis):
    return vector[0] if axis == 0 else vector[1] if axis == 1 else vector[2]


@inlined
def _seen(frame, i, x, y, z):
    """Return a vector as the body i sees it."""
    return (
        frame[i, 0, 0] * x + frame[i, 1, 0] * y + frame[i, 2, 0] * z,
        frame[i, 0, 1] * x + frame[i, 1, 1] * y + frame[i, 2, 1] * z,
        frame[i, 0, 2] * x + frame[i, 1, 2] * y + frame[i, 2, 2] * z,
    )


@inlined
def _unseen(frame, i, x, y, z):
    """Return a vector that the body i sees so."""
    return (
        frame[i, 0, 0] * x + frame[i, 0, 1] * y + frame[i, 0, 2] * z,
        frame[i, 1, 0] * x + frame[i, 1, 1] * y + frame[i, 1, 2] * z,
        frame[i, 2, 0] * x + frame[i, 2, 1] * y + frame[i, 2, 2] * z,
    )


@inlined
def _per_inertia(bodies, i, x, y, z):
    """Return the mean of the moments of inertia times a vector over the tensor of inertia."""
    share = bodies.share_nk
    u, v, w = _seen(bodies.beads.frame_ndd, i, x, y, z)
    return _unseen(bodies.beads.frame_ndd, i, share[i, 0] * u, share[i, 1] * v, share[i, 2] * w)


@inlined
def turned_by(bodies, axes, i, x, y, z):
    """Return the mean of the moments of inertia times the spin that an impulse of torque gives to a body."""
    return (0.0, 0.0, z) if len(axes) == 2 else _per_inertia(bodies, i, x, y, z)


@inlined
def spin_of_body(bodies, axes, body, i):
    """Return the angular velocity of a body."""
    if len(axes) == 2:
        return 0.0, 0.0, body[i, 6]
    return turned_by(bodies, axes, i, body[i, 7], body[i, 8], body[i, 9])


@device
def _turn_body(bodies, axes, half, i, dt):
    turn = bodies.turn_nq
    w, x, y, z = turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3]
    if len(axes) == 2:
        angle = dt * half[i, 2]
        c, s = math.cos(angle), math.sin(angle)
        w, x = c * w - s * x, s * w + c * x
    else:
        share, a, b = bodies.share_nk, bodies.axis_nk[i, 2], bodies.axis_nk[i, 1]
        middle = share[i, bodies.axis_nk[i, 0]]
        u, v, t = half[i, 3], half[i, 4], half[i, 5]
        own = _seen(bodies.beads.frame_ndd, i, u, v, t)
        rate = 0.5 * dt * (share[i, b] - middle)
        q, own = _about_axis((w, x, y, z), own, b, rate * _of(own, b))
        q, own = _about_axis(q, own, a, dt * (share[i, a] - middle) * _of(own, a))
        q, own = _about_axis(q, own, b, rate * _of(own, b))
        # the part about the angular momentum, which does not see how the others turned the body
        size = math.sqrt(u * u + v * v + t * t)
        angle = 0.5 * dt * middle * size
        c = math.cos(angle)
        s = math.sin(angle) / size if size > 0.0 else 0.0
        u, v, t = s * u, s * v, s * t
        w, x, y, z = (
            c * q[0] - u * q[1] - v * q[2] - t * q[3],
            c * q[1] + u * q[0] + v * q[3] - t * q[2],
            c * q[2] + v * q[0] + t * q[1] - u * q[3],
            c * q[3] + t * q[0] + u * q[2] - v * q[1],
        )
    inverse = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    turn[i, 0], turn[i, 1], turn[i, 2], turn[i, 3] = inverse * w, inverse * x, inverse * y, inverse * z


@inlined
def turn_bodies(bodies, axes, half, low, high, dt):
    """Turn the bodies of rows by a step at what `half` holds of turns."""
    for i in range(low, high):
        _turn_body(bodies, axes, half, i, dt)
        _place_body(bodies, i)


@inlined
def dragged_to(bodies, axes, i, wx, wy, wz):
    """Return what the row of a body holds where it turns with a flow."""
    if len(axes) == 2:
        return wx, wy, wz
    share = bodies.share_nk
    u, v, w = _seen(bodies.beads.frame_ndd, i, wx, wy, wz)
    return _unseen(bodies.beads.frame_ndd, i, u / share[i, 0], v / share[i, 1], w / share[i, 2])


@inlined
def spread_of_kicks(bodies, axes, i, x, y, z):
    """Return an isotropic random vector in space, times the root of the inertia over the mean one."""
    share = bodies.share_nk
    u, v, w = _seen(bodies.beads.frame_ndd, i, x, y, z)
    u, v, w = u / math.sqrt(share[i, 0]), v / math.sqrt(share[i, 1]), w / math.sqrt(share[i, 2])
    return _unseen(bodies.beads.frame_ndd, i, u, v, w)


@inlined
def motion_of_row(axes, body, i, spin):
    """Return how a row moves that turns with a spin."""
    w = body[i, 6] if len(axes) == 3 else 0.0
    return RowMotion(body[i, 0], body[i, 1], body[i, 2], body[i, 4], body[i, 5], w, spin[0], spin[1], spin[2])


@inlined
def push_on_body(bodies, one, axes, body, i, mass):
    """Return the force and the torque of one effect on a row."""
    return push_on_shape(one, bodies.beads, i, motion_of_row(axes, body, i, spin_of_body(bodies, axes, body, i)), mass)


@inlined
def energy_of_body(bodies, one, body, i, mass):
    """Return the energy of a row under one effect."""
    return energy_of_shape(one, bodies.beads, i, body[i, 0], body[i, 1], body[i, 2], mass)[0]


def rows_of_spins(bodies: BodyRows, spin_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the rows of bodies in space hold for angular velocities."""
    frame = bodies.beads.frame_ndd
    own = (frame * spin_nk[:, :, None]).sum(axis=1) / bodies.share_nk
    return np.asarray((frame * own[:, None, :]).sum(axis=2))


def spins_of_rows(bodies: BodyRows, row_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angular velocities of bodies in space."""
    frame = bodies.beads.frame_ndd
    own = (frame * row_nk[:, :, None]).sum(axis=1) * bodies.share_nk
    return np.asarray((frame * own[:, None, :]).sum(axis=2))


@inlined
def touches_of_bodies(bodies, i, j):
    """Return how many pairs of beads two rows have."""
    return touches(bodies.beads, i, j)


@inlined
def _two_beads(beads, pair, k):
    """Return the beads of the k-th touch of two rows."""
    others = beads.start_n[pair.j + 1] - beads.start_n[pair.j]
    return beads.start_n[pair.i] + k // others, beads.start_n[pair.j] + k % others


@inlined
def _touch_of_beads(beads, axes, pair, k):
    one, other = _two_beads(beads, pair, k)
    return touch_of_two_beads(beads, one, other, pair.dx, pair.dy, pair.dz)


@inlined
def _touch_of_superellipsoids(beads, axes, pair, k):
    i, j, dx, dy, dz = pair.i, pair.j, pair.dx, pair.dy, pair.dz
    if dx * dx + dy * dy + dz * dz == 0.0:
        sigma = beads.radius_n[i] + beads.radius_n[j]
        nx, ny, nz = coincident_direction(i, j, len(axes))
        dx, dy, dz = 1e-9 * sigma * nx, 1e-9 * sigma * ny, 1e-9 * sigma * nz
    return shape_touch(beads, i, j, 0, dx, dy, dz, len(axes))


@inlined
def _steepness_of_touch(beads, touch):
    return math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)


_touch = by_type(_touch_of_beads, {GaugeRows: _touch_of_superellipsoids})
_steepness = by_type(lambda beads, touch: 1.0, {GaugeRows: _steepness_of_touch})


@inlined
def steepness(bodies, touch):
    """Return the size of the slope of a distance along the vector between the centers: 1 of beads."""
    return _steepness(bodies.beads, touch)


@inlined
def touch_of_bodies(bodies, axes, body, pair, k):
    """Return the touch of two beads, or of two superellipsoids."""
    return _touch(bodies.beads, axes, pair, k)


@inlined
def rate_of_bodies(bodies, axes, body, pair, touch, u):
    """Return the rate of the distance of two beads."""
    wi, wj = spin_of_body(bodies, axes, body, pair.i), spin_of_body(bodies, axes, body, pair.j)
    rate = u[0] * touch.x + u[1] * touch.y + u[2] * touch.z
    rate += touch.ix * wi[0] + touch.iy * wi[1] + touch.iz * wi[2]
    return rate + touch.jx * wj[0] + touch.jy * wj[1] + touch.jz * wj[2]


@inlined
def _slip_of_beads(beads, bodies, axes, body, pair, k, touch, u):
    one, other = _two_beads(beads, pair, k)
    wi, wj = spin_of_body(bodies, axes, body, pair.i), spin_of_body(bodies, axes, body, pair.j)
    ax, ay, az = beads.arm_bd[one, 0], beads.arm_bd[one, 1], beads.arm_bd[one, 2]
    bx, by, bz = beads.arm_bd[other, 0], beads.arm_bd[other, 1], beads.arm_bd[other, 2]
    share = touch.rho / touch.sigma
    ai, aj = share * beads.size_b[one], share * beads.size_b[other]
    # the velocity of the beads' centers
    ux = u[0] + wj[1] * bz - wj[2] * by - wi[1] * az + wi[2] * ay
    uy = u[1] + wj[2] * bx - wj[0] * bz - wi[2] * ax + wi[0] * az
    uz = u[2] + wj[0] * by - wj[1] * bx - wi[0] * ay + wi[1] * ax
    slip = slip_of_round(axes, touch, (ai, aj), (ux, uy, uz), wi, wj)
    return Slip(
        slip.nx, slip.ny, slip.nz,
        (ax + ai * slip.nx, ay + ai * slip.ny, az + ai * slip.nz),
        (aj * slip.nx - bx, aj * slip.ny - by, aj * slip.nz - bz),
        slip.sx, slip.sy, slip.sz, slip.ox, slip.oy, slip.oz,
    )  # fmt: skip


class Side(NamedTuple):
    """One of two surfaces that touch at a normal.

    How far the shape reaches along the normal, the vector from its center to the point of its surface where this is
    the normal, xx, xy, xz, yy, yz, zz of the change of that point by the normal, and the angular velocity.
    """

    reach: float
    point: tuple[float, float, float]
    radii: tuple[float, float, float, float, float, float]
    spin: tuple[float, float, float]


@inlined
def slip_of_surfaces(scale, n, side_i, side_j, u):
    """Return the slip of two surfaces in space that touch at a normal when scaled, levers the points of contact.

    With r = s (p_i + p_j), its rate and p' = w x p + R (n' - w x n), R the radii, the normal turns by
    (R_i + R_j) n' = R_i (w_i x n) + R_j (w_j x n) + (v - r (v n) / (r n)) / s, v the velocity of contact points.
    """
    gi, pi, ri, wi = side_i
    gj, pj, rj, wj = side_j
    one, other = cross(wi, pi), cross(wj, pj)
    vx = u[0] - scale * (one[0] + other[0])
    vy = u[1] - scale * (one[1] + other[1])
    vz = u[2] - scale * (one[2] + other[2])
    apart = dot((vx, vy, vz), n)
    one, other = times(ri, cross(wi, n)), times(rj, cross(wj, n))
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
    bent = times(m, turned)
    rate = (
        (trace * turned[0] - bent[0]) / product,
        (trace * turned[1] - bent[1]) / product,
        (trace * turned[2] - bent[2]) / product,
    )
    ox, oy, oz = cross(n, rate)
    about = 0.5 * (dot(wi, n) + dot(wj, n))
    return Slip(
        n[0], n[1], n[2],
        (scale * pi[0], scale * pi[1], scale * pi[2]),
        (scale * pj[0], scale * pj[1], scale * pj[2]),
        vx - apart * n[0], vy - apart * n[1], vz - apart * n[2],
        ox + about * n[0], oy + about * n[1], oz + about * n[2],
    )  # fmt: skip


@inlined
def _point_of(reach, n, turn, slope, over):
    """Return the point of a surface at a touch, by how far this reaches along the normal and the slopes of rho.

    Those along a turn are slope x point: exact in its part across the normal, where faces are flat, too.
    """
    x, y, z = cross(turn, slope)
    return reach * n[0] + over * x, reach * n[1] + over * y, reach * n[2] + over * z


@inlined
def _slip_of_superellipsoids(beads, bodies, axes, body, pair, k, touch, u):
    slope = touch.x, touch.y, touch.z
    square = dot(slope, slope)
    inverse = 1.0 / math.sqrt(square)
    n = inverse * touch.x, inverse * touch.y, inverse * touch.z
    one, other = gauge_body(beads, pair.i), gauge_body(beads, pair.j)
    gi, gj = support(one, n[0], n[1], n[2]), support(other, n[0], n[1], n[2])
    wi, wj = spin_of_body(bodies, axes, body, pair.i), spin_of_body(bodies, axes, body, pair.j)
    scale = touch.rho / touch.sigma
    over = 1.0 / (square * scale)
    pi = _point_of(gi, n, (touch.ix, touch.iy, touch.iz), slope, over)
    pj = _point_of(gj, n, (touch.jx, touch.jy, touch.jz), slope, over)
    if len(axes) == 2:
        ai, aj = scale * gi, scale * gj
        sx = u[1] * n[0] - u[0] * n[1] - ai * wi[2] - aj * wj[2]
        return Slip(
            n[0], n[1], 0.0,
            (scale * pi[0], scale * pi[1], 0.0), (scale * pj[0], scale * pj[1], 0.0),
            sx, 0.0, 0.0, 0.0, 0.0, 0.0,
        )  # fmt: skip
    ri = support_bend(one, n[0], n[1], n[2], gi, pi[0], pi[1], pi[2])
    rj = support_bend(other, n[0], n[1], n[2], gj, pj[0], pj[1], pj[2])
    return slip_of_surfaces(scale, n, Side(gi, pi, ri, wi), Side(gj, pj, rj, wj), u)


_slip = by_type(_slip_of_beads, {GaugeRows: _slip_of_superellipsoids})


@inlined
def slip_of_bodies(bodies, axes, body, pair, k, touch, u):
    """Return the slip of two beads, or of two superellipsoids, levers the points of contact."""
    return _slip(bodies.beads, bodies, axes, body, pair, k, touch, u)


@inlined
def place_of_spring(bodies, columns, stretch_pk, pair, k):
    """Return the first of so many columns of the k-th touch in a row, which has room for the largest bodies."""
    if stretch_pk is None:
        return 0
    start, size = bodies.beads.start_n, len(columns)
    most = int(round(math.sqrt(stretch_pk.shape[1] // size)))
    others = start[pair.j + 1] - start[pair.j]
    return size * (k // others * most + k % others)


@inlined
def relax_all(bodies, columns, stretch_pk, p):
    """Set all springs of a pair to zero; nothing where no stretches are held."""
    if stretch_pk is not None:
        for k in range(stretch_pk.shape[1]):
            stretch_pk[p, k] = 0.0


@inlined
def energy_about_axes(bodies, axes, state, i):
    """Return what a body's energy of rotation is more than the row alone gives."""
    if len(axes) == 2 or state.weight_nk[i, 1] == 0.0:
        return 0.0
    share = bodies.share_nk
    u, v, w = _seen(bodies.beads.frame_ndd, i, state.body[i, 7], state.body[i, 8], state.body[i, 9])
    more = (share[i, 0] - 1.0) * u * u + (share[i, 1] - 1.0) * v * v + (share[i, 2] - 1.0) * w * w
    return 0.5 / state.weight_nk[i, 1] * more


@inlined
def inertial_stress(bodies, axes, state, i):
    """Return xx, xy, xz, yy, yz, zz of the integral of a x over a turning body, a the acceleration by its rotation."""
    frame, own, mass = bodies.beads.frame_ndd, bodies.spread_ndd, state.mass_n[i]
    first = _seen_through(frame, own, i, 0)
    second = _seen_through(frame, own, i, 1)
    third = _seen_through(frame, own, i, 2)
    spread = (
        mass * first[0], mass * first[1], mass * first[2],
        mass * second[1], mass * second[2], mass * third[2],
    )  # fmt: skip
    spin = spin_of_body(bodies, axes, state.body, i)
    inverse = state.weight_nk[i, 1]
    if len(axes) == 2:
        return stretched_matter(spread, spin, (0.0, 0.0, inverse * state.push[i, 2]))
    # the rate of the angular velocity: of the torque less that of the angular momentum, which the frame turns under
    turned = cross(spin, (state.body[i, 7], state.body[i, 8], state.body[i, 9]))
    rate = _per_inertia(
        bodies,
        i,
        inverse * state.push[i, 3] - turned[0],
        inverse * state.push[i, 4] - turned[1],
        inverse * state.push[i, 5] - turned[2],
    )
    return stretched_matter(spread, spin, rate)


@inlined
def _seen_through(frame, own, i, k):
    """Return row k of a matrix of the body i, seen from outside."""
    x, y, z = frame[i, k, 0], frame[i, k, 1], frame[i, k, 2]
    return _unseen(
        frame,
        i,
        x * own[i, 0, 0] + y * own[i, 1, 0] + z * own[i, 2, 0],
        x * own[i, 0, 1] + y * own[i, 1, 1] + z * own[i, 2, 1],
        x * own[i, 0, 2] + y * own[i, 1, 2] + z * own[i, 2, 2],
    )


@inlined
def times(m, v):
    """Return the symmetric matrix (xx, xy, xz, yy, yz, zz) times a vector."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[1] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[2] * v[0] + m[4] * v[1] + m[5] * v[2],
    )


@inlined
def stretched_matter(spread, spin, rate):
    """Return xx, xy, xz, yy, yz, zz of the integral of a x of matter by its second moments, angular velocity w and w'.

    With S the integral of x x: w (S w) - w^2 S, and what the angular acceleration adds; the symmetric part.
    """
    xx, xy, xz, yy, yz, zz = spread
    square = spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]
    bent = times(spread, spin)
    one, two, three = cross(rate, (xx, xy, xz)), cross(rate, (xy, yy, yz)), cross(rate, (xz, yz, zz))
    return (
        spin[0] * bent[0] + one[0] - square * xx,
        0.5 * (spin[0] * bent[1] + spin[1] * bent[0] + two[0] + one[1]) - square * xy,
        0.5 * (spin[0] * bent[2] + spin[2] * bent[0] + three[0] + one[2]) - square * xz,
        spin[1] * bent[1] + two[1] - square * yy,
        0.5 * (spin[1] * bent[2] + spin[2] * bent[1] + three[1] + two[2]) - square * yz,
        spin[2] * bent[2] + three[2] - square * zz,
    )
