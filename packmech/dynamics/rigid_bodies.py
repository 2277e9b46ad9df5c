# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Rigid bodies of discs or spheres in a time step: contacts of their beads, how they turn, and their observables.

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
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.contacts.fused_volume import body_moments
from packmech.dynamics.deformation import relative
from packmech.dynamics.friction import Contact, Slip, measure_spring, reset_stretch, spring_in_plane, spring_in_space
from packmech.effects import pair_elastic, pair_energy, pair_first
from packmech.jit.compiled import device, inlined, kernel
from packmech.minimize.passes.shape_rows import BeadRows, touch_of_two_beads
from packmech.shapes import Beads


class BodyRows(NamedTuple):
    """Rigid bodies that are stepped through time, by rows.

    Attributes
    ----------
    beads
        Their beads; frames and arms are those of `turn_nq`.
    turn_nq
        (N, 4) unit quaternions; in a plane directions of the first axes, then zeros.
    share_nk
        (N, 3) mean of the moments of inertia over those about the axes [1].
    axis_nk
        (N, 3) axes c, b and a, as above.
    spread_ndd
        (N, 3, 3) second moments of their matter over mass, in their frames [length^2].

    """

    beads: BeadRows
    turn_nq: NDArray[np.float64]
    share_nk: NDArray[np.float64]
    axis_nk: NDArray[np.int64]
    spread_ndd: NDArray[np.float64]


def body_rows(beads: BeadRows, shapes: Beads) -> BodyRows:
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
def spin_of_body(bodies, axes, body, i):
    """Return the angular velocity of a body."""
    if len(axes) == 2:
        return 0.0, 0.0, body[i, 6]
    return _per_inertia(bodies, i, body[i, 7], body[i, 8], body[i, 9])


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
def body_dragged_to(bodies, i, wx, wy, wz):
    """Return what the row of a body holds where it turns with a flow in space."""
    share = bodies.share_nk
    u, v, w = _seen(bodies.beads.frame_ndd, i, wx, wy, wz)
    return _unseen(bodies.beads.frame_ndd, i, u / share[i, 0], v / share[i, 1], w / share[i, 2])


def rows_of_body_spins(bodies: BodyRows, spin_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the rows of bodies in space hold for angular velocities."""
    frame = bodies.beads.frame_ndd
    own = (frame * spin_nk[:, :, None]).sum(axis=1) / bodies.share_nk
    return np.asarray((frame * own[:, None, :]).sum(axis=2))


def body_spins_of_rows(bodies: BodyRows, row_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angular velocities of bodies in space."""
    frame = bodies.beads.frame_ndd
    own = (frame * row_nk[:, :, None]).sum(axis=1) * bodies.share_nk
    return np.asarray((frame * own[:, None, :]).sum(axis=2))


@inlined
def push_of(effects, rho, sigma, rate):
    """Return the derivative of the energy with its dashpots, and what of it is elastic."""
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, rho, sigma, rate)
        elastic += pair_elastic(one, rho, sigma)
    return first, elastic


@inlined
def energy_of(effects, rho, sigma):
    """Return the energy of a contact."""
    energy = 0.0
    for one in literal_unroll(effects):
        energy += pair_energy(one, rho, sigma)
    return energy


@inlined
def _rate(touch, ux, uy, uz, wi, wj):
    """Return the rate of the distance of two beads."""
    rate = ux * touch.x + uy * touch.y + uz * touch.z
    rate += touch.ix * wi[0] + touch.iy * wi[1] + touch.iz * wi[2]
    return rate + touch.jx * wj[0] + touch.jy * wj[1] + touch.jz * wj[2]


@inlined
def _slip(axes, beads, touch, one, other, ux, uy, uz, wi, wj):
    """Return the slip of two beads (in a plane its first number), from the velocity of their bodies' centers."""
    ax, ay, az = beads.arm_bd[one, 0], beads.arm_bd[one, 1], beads.arm_bd[one, 2]
    bx, by, bz = beads.arm_bd[other, 0], beads.arm_bd[other, 1], beads.arm_bd[other, 2]
    nx, ny, nz = touch.x, touch.y, touch.z
    share = touch.rho / touch.sigma
    ai, aj = share * beads.size_b[one], share * beads.size_b[other]
    # the velocity of the beads' centers
    ux += wj[1] * bz - wj[2] * by - wi[1] * az + wi[2] * ay
    uy += wj[2] * bx - wj[0] * bz - wi[2] * ax + wi[0] * az
    if len(axes) == 2:
        return Slip(ai, aj, uy * nx - ux * ny - ai * wi[2] - aj * wj[2], 0.0, 0.0, 0.0, 0.0, 0.0)
    uz += wj[0] * by - wj[1] * bx - wi[0] * ay + wi[1] * ax
    along = ux * nx + uy * ny + uz * nz
    tx, ty, tz = ux - along * nx, uy - along * ny, uz - along * nz
    wx, wy, wz = ai * wi[0] + aj * wj[0], ai * wi[1] + aj * wj[1], ai * wi[2] + aj * wj[2]
    # as of spheres: the line of centers turns, and about itself with the mean spin along it
    about = 0.5 * ((wi[0] + wj[0]) * nx + (wi[1] + wj[1]) * ny + (wi[2] + wj[2]) * nz)
    inverse = 1.0 / touch.rho if touch.rho > 0.0 else 0.0
    return Slip(
        ai, aj, tx - (wy * nz - wz * ny), ty - (wz * nx - wx * nz), tz - (wx * ny - wy * nx),
        (ny * tz - nz * ty) * inverse + about * nx,
        (nz * tx - nx * tz) * inverse + about * ny,
        (nx * ty - ny * tx) * inverse + about * nz,
    )  # fmt: skip


@inlined
def _springs(axes, stretch_pk):
    """Return the springs of all pairs of beads one after another."""
    return stretch_pk.reshape(-1, 3 if len(axes) == 3 else 1)


@inlined
def _first_spring(axes, stretch_pk, p):
    """Return the number of the first spring of a pair of bodies, and how many the pairs of one bead have."""
    springs = stretch_pk.shape[1] // 3 if len(axes) == 3 else stretch_pk.shape[1]
    return p * springs, int(round(math.sqrt(springs)))


@inlined
def _spring_of(axes, beads, stretch_pk, p, i, j, one, other):
    """Return the number of the spring of two beads; none without friction."""
    if stretch_pk is None:
        return 0
    first, most = _first_spring(axes, stretch_pk, p)
    return first + (one - beads.start_n[i]) * most + other - beads.start_n[j]


@inlined
def _friction(friction, axes, beads, stretch_pk, s, touch, i, j, one, other, u, wi, wj, elastic, pace):
    """Return the friction on i, and its torques on both; zeros without."""
    if friction is None:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    slip = _slip(axes, beads, touch, one, other, u[0], u[1], u[2], wi, wj)
    nx, ny, nz = touch.x, touch.y, touch.z
    arm = beads.arm_bd
    # the point of contact from either center
    ax, ay, az = arm[one, 0] + slip.ai * nx, arm[one, 1] + slip.ai * ny, arm[one, 2] + slip.ai * nz
    bx, by, bz = arm[other, 0] - slip.aj * nx, arm[other, 1] - slip.aj * ny, arm[other, 2] - slip.aj * nz
    if len(axes) == 2:
        force = spring_in_plane(friction, _springs(axes, stretch_pk), s, slip.sx, abs(elastic), pace)
        fx, fy = force * -ny, force * nx
        return (fx, fy, 0.0), (0.0, 0.0, ax * fy - ay * fx), (0.0, 0.0, by * fx - bx * fy)
    contact = Contact(i, j, nx, ny, nz, u[0], u[1], u[2], touch.rho, touch.sigma)
    fx, fy, fz = spring_in_space(friction, _springs(axes, stretch_pk), s, contact, slip, abs(elastic), pace)
    return (
        (fx, fy, fz),
        (ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx),
        (bz * fy - by * fz, bx * fz - bz * fx, by * fx - bx * fy),
    )


@inlined
def _reset(axes, stretch_pk, s):
    if stretch_pk is not None:
        reset_stretch(axes, _springs(axes, stretch_pk), s)


@inlined
def forces_of_bodies(bodies, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    """Return whether beads of two rows touch, the force on i, and the torques on both."""
    beads, touching = bodies.beads, False
    fx = fy = fz = ix = iy = iz = jx = jy = jz = 0.0
    start = beads.start_n
    for one in range(start[i], start[i + 1]):
        for other in range(start[j], start[j + 1]):
            touch = touch_of_two_beads(beads, one, other, dx, dy, dz)
            s = _spring_of(axes, beads, stretch_pk, p, i, j, one, other)
            if not touch.touching:
                _reset(axes, stretch_pk, s)
                continue
            touching = True
            u = relative(rates, axes, body, i, j, dx, dy, dz)
            wi, wj = spin_of_body(bodies, axes, body, i), spin_of_body(bodies, axes, body, j)
            first, elastic = push_of(effects, touch.rho, touch.sigma, _rate(touch, u[0], u[1], u[2], wi, wj))
            across, on_i, on_j = _friction(
                friction, axes, beads, stretch_pk, s, touch, i, j, one, other, u, wi, wj, elastic, pace
            )
            fx += first * touch.x + across[0]
            fy += first * touch.y + across[1]
            fz += first * touch.z + across[2]
            ix += on_i[0] - first * touch.ix
            iy += on_i[1] - first * touch.iy
            iz += on_i[2] - first * touch.iz
            jx += on_j[0] - first * touch.jx
            jy += on_j[1] - first * touch.jy
            jz += on_j[2] - first * touch.jz
    return touching, fx, fy, fz, ix, iy, iz, jx, jy, jz


@inlined
def _measure_friction(friction, axes, beads, stretch_pk, s, touch, one, other, u, wi, wj, normal, pace):
    """Return the energy of a tangential spring, whether it slides, and its force on i; zeros without friction."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    slip = _slip(axes, beads, touch, one, other, u[0], u[1], u[2], wi, wj)
    return measure_spring(
        friction, axes, _springs(axes, stretch_pk), s, touch.x, touch.y,
        slip.sx, slip.sy, slip.sz, slip.ox, slip.oy, slip.oz, normal, pace.after,
    )  # fmt: skip


@inlined
def measure_bodies(bodies, effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    """Return how many pairs of beads touch, two energies, how many slide, the sum of elastic forces, the force on i."""
    beads, touching = bodies.beads, 0
    energy = tangential = slides = total = fx = fy = fz = 0.0
    u = relative(flowing, axes, body, i, j, dx, dy, dz)
    wi, wj = spin_of_body(bodies, axes, body, i), spin_of_body(bodies, axes, body, j)
    start = beads.start_n
    for one in range(start[i], start[i + 1]):
        for other in range(start[j], start[j + 1]):
            touch = touch_of_two_beads(beads, one, other, dx, dy, dz)
            if not touch.touching:
                continue
            touching += 1
            s = _spring_of(axes, beads, stretch_pk, p, i, j, one, other)
            first, elastic = push_of(effects, touch.rho, touch.sigma, _rate(touch, u[0], u[1], u[2], wi, wj))
            energy += energy_of(effects, touch.rho, touch.sigma)
            normal = abs(elastic)
            total += normal
            spring, sliding, x, y, z = _measure_friction(
                friction, axes, beads, stretch_pk, s, touch, one, other, u, wi, wj, normal, pace
            )
            tangential += spring
            slides += sliding
            fx += first * touch.x + x
            fy += first * touch.y + y
            fz += first * touch.z + z
    return touching, energy, tangential, slides, total, fx, fy, fz


@inlined
def slip_of_bodies(bodies, axes, body, flowing, i, j, one, other, dx, dy, dz):
    """Return whether two beads of two rows touch, counted from 0 in each, and their slip as `slip_of` does."""
    beads = bodies.beads
    one, other = beads.start_n[i] + one, beads.start_n[j] + other
    touch = touch_of_two_beads(beads, one, other, dx, dy, dz)
    if not touch.touching:
        return False, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    wi, wj = spin_of_body(bodies, axes, body, i), spin_of_body(bodies, axes, body, j)
    slip = _slip(axes, beads, touch, one, other, ux, uy, uz, wi, wj)
    return True, (touch.x, touch.y, slip.sx, slip.sy, slip.sz, slip.ox, slip.oy, slip.oz)


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
def inertial_stress_of_body(bodies, axes, state, i, work_dd):
    """Write the integral of a x over a turning body, a the acceleration by its rotation, its symmetric part."""
    frame, spread = bodies.beads.frame_ndd, bodies.spread_ndd
    for k in range(3):
        for m in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += frame[i, k, a] * spread[i, a, b] * frame[i, m, b]
            work_dd[1, k, m] = state.mass_n[i] * total
    ox, oy, oz = spin_of_body(bodies, axes, state.body, i)
    inverse = state.weight_nk[i, 1]
    if len(axes) == 2:
        stretched_matter(work_dd, ox, oy, oz, 0.0, 0.0, inverse * state.push[i, 2])
        return
    # the rate of the angular velocity: of the torque less that of the angular momentum, which the frame turns under
    x, y, z = state.body[i, 7], state.body[i, 8], state.body[i, 9]
    px, py, pz = _per_inertia(
        bodies,
        i,
        inverse * state.push[i, 3] - (oy * z - oz * y),
        inverse * state.push[i, 4] - (oz * x - ox * z),
        inverse * state.push[i, 5] - (ox * y - oy * x),
    )
    stretched_matter(work_dd, ox, oy, oz, px, py, pz)


@inlined
def stretched_matter(work_dd, ox, oy, oz, px, py, pz):
    """Write the integral of a x of matter with second moments in work_dd[1], by its rates of turning w and w'.

    With S the integral of x x: w (S w) - w^2 S, and what the angular acceleration adds; the symmetric part, to 0.
    """
    s = work_dd[1]
    square = ox * ox + oy * oy + oz * oz
    spin = (ox, oy, oz)
    bent = (
        ox * s[0, 0] + oy * s[1, 0] + oz * s[2, 0],
        ox * s[0, 1] + oy * s[1, 1] + oz * s[2, 1],
        ox * s[0, 2] + oy * s[1, 2] + oz * s[2, 2],
    )
    for m in range(3):
        work_dd[2, 0, m] = py * s[2, m] - pz * s[1, m]
        work_dd[2, 1, m] = pz * s[0, m] - px * s[2, m]
        work_dd[2, 2, m] = px * s[1, m] - py * s[0, m]
    for k in range(3):
        for m in range(3):
            along = spin[k] * bent[m] + spin[m] * bent[k] + work_dd[2, k, m] + work_dd[2, m, k]
            work_dd[0, k, m] = 0.5 * along - square * s[k, m]
