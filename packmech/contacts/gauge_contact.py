"""Touching superellipsoids: the scale at which two of them touch, and its derivatives along displacements and turns.

The gauge g of a convex body about its center is the factor by which the body must be scaled for a point to lie on its
surface: of |x/a|^p + |y/b|^p + |z/c|^p = 1 the p-th root of that sum. Two bodies whose centers are r apart touch when
scaled by s, with s^2 the smallest F(x) = max(G_i(x), G_j(x - r)) over points x, G = g^2: a convex problem, whose value
is the largest over l, between 0 and 1, of the smallest L = (1 - l) G_i(x) + l G_j(x - r) over x. For ellipsoids this is
the contact function of Perram and Wertheim, J. Comput. Phys. 58, 409 (1985).

F is stationary in x and l, so that its first derivatives are those of L at fixed x and l; with z = (x, l) the second
ones are L_ab - L_az L_zz^-1 L_zb, by the implicit function theorem. They exist where the curvatures of both bodies at
their touch, added, leave no direction flat. Where flat faces lie on each other exactly (p > 2, both touched at the
middles of faces) a turn has no second derivative: the curvature of F by it is minus infinity, and forces hold it
infinitely stiffly. `_FLAT` then stands for the curvature that is missing, so that it is held stiffly.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import device, inlined, kernel

# curvature added to that of L, over its mean one: below it faces count as flat
_FLAT = 1e-13
# radius of curvature of a flat face over its size, where contacts turn with their normals
_ROUND = 1e8
# what a step gains of F, relative, below which the last few steps are taken, on the forces
_NEAR = 1e-16
# gain of an inner step over that of the next one in l, where the inner problem is solved well enough
_INNER = 1e-3
_ROUNDS, _STEPS, _CUTS, _LAST = 60, 60, 40, 40


class Body(NamedTuple):
    """A superellipsoid: its semi-axes (of any length across a plane), its exponent, and unit vectors along them."""

    a: float
    b: float
    c: float
    exponent: float
    ux: float
    uy: float
    uz: float
    vx: float
    vy: float
    vz: float
    wx: float
    wy: float
    wz: float


class Gauge(NamedTuple):
    """The square of a gauge at a point, its first derivatives and its second ones."""

    value: float
    x: float
    y: float
    z: float
    xx: float
    xy: float
    xz: float
    yy: float
    yz: float
    zz: float


class GaugeTouch(NamedTuple):
    """F of two bodies, l, the point x, and half of dF/dr."""

    square: float
    parameter: float
    px: float
    py: float
    pz: float
    fx: float
    fy: float
    fz: float


class GaugeContacts(NamedTuple):
    """Scales of pairs, points of touch from centers i, and derivatives of the scales, as of `ScaledContacts`."""

    scale_p: NDArray[np.float64]
    point_pd: NDArray[np.float64]
    first_px: NDArray[np.float64]
    second_pxx: NDArray[np.float64]


@device
def body_at(semi, exponent, frame):
    """Return the body of (3,) semi-axes, an exponent and a (3, 3) frame with axes in columns."""
    return Body(
        semi[0], semi[1], semi[2], exponent,
        frame[0, 0], frame[1, 0], frame[2, 0],
        frame[0, 1], frame[1, 1], frame[2, 1],
        frame[0, 2], frame[1, 2], frame[2, 2],
    )  # fmt: skip


@device
def gauge(body, x, y, z):
    """Return the square of the gauge at a point that is not the center."""
    p = body.exponent
    t = (body.ux * x + body.uy * y + body.uz * z) / body.a
    s = (body.vx * x + body.vy * y + body.vz * z) / body.b
    r = (body.wx * x + body.wy * y + body.wz * z) / body.c
    most = max(abs(t), abs(s), abs(r), 1e-300)
    # over the largest one: no power overflows
    t, s, r = t / most, s / most, r / most
    if p == 2.0:
        et = es = er = 1.0
    else:
        et, es, er = abs(t) ** (p - 2.0), abs(s) ** (p - 2.0), abs(r) ** (p - 2.0)
    total = et * t * t + es * s * s + er * r * r
    size = math.sqrt(total) if p == 2.0 else total ** (1.0 / p)
    value = most * size
    # |x/a|^(p - 2) / g^(p - 2) = e / size^(p - 2), with size^p = total
    share = size * size / total
    et, es, er = share * et, share * es, share * er
    # components of dg/dx along the axes
    over = 1.0 / size
    gt, gs, gr = et * t * over / body.a, es * s * over / body.b, er * r * over / body.c
    gx = gt * body.ux + gs * body.vx + gr * body.wx
    gy = gt * body.uy + gs * body.vy + gr * body.wy
    gz = gt * body.uz + gs * body.vz + gr * body.wz
    m = 2.0 * (p - 1.0)
    et, es, er = m * et / (body.a * body.a), m * es / (body.b * body.b), m * er / (body.c * body.c)
    less = 2.0 * (2.0 - p)
    return Gauge(
        value * value, 2.0 * value * gx, 2.0 * value * gy, 2.0 * value * gz,
        et * body.ux * body.ux + es * body.vx * body.vx + er * body.wx * body.wx + less * gx * gx,
        et * body.ux * body.uy + es * body.vx * body.vy + er * body.wx * body.wy + less * gx * gy,
        et * body.ux * body.uz + es * body.vx * body.vz + er * body.wx * body.wz + less * gx * gz,
        et * body.uy * body.uy + es * body.vy * body.vy + er * body.wy * body.wy + less * gy * gy,
        et * body.uy * body.uz + es * body.vy * body.vz + er * body.wy * body.wz + less * gy * gz,
        et * body.uz * body.uz + es * body.vz * body.vz + er * body.wz * body.wz + less * gz * gz,
    )  # fmt: skip


@device
def support(body, x, y, z):
    """Return how far a body reaches from its center along a direction, times the length of this: the dual of g."""
    q = body.exponent / (body.exponent - 1.0)
    t = abs(body.ux * x + body.uy * y + body.uz * z) * body.a
    s = abs(body.vx * x + body.vy * y + body.vz * z) * body.b
    r = abs(body.wx * x + body.wy * y + body.wz * z) * body.c
    most = max(t, s, r, 1e-300)
    return most * ((t / most) ** q + (s / most) ** q + (r / most) ** q) ** (1.0 / q)


@device
def support_point(body, x, y, z):
    """Return how far a body reaches along a unit vector, and the point of its surface where this is the normal."""
    power = 1.0 / (body.exponent - 1.0)
    t = (body.ux * x + body.uy * y + body.uz * z) * body.a
    s = (body.vx * x + body.vy * y + body.vz * z) * body.b
    r = (body.wx * x + body.wy * y + body.wz * z) * body.c
    most = max(abs(t), abs(s), abs(r), 1e-300)
    et, es, er = (abs(t) / most) ** power, (abs(s) / most) ** power, (abs(r) / most) ** power
    total = (et * abs(t) + es * abs(s) + er * abs(r)) / most
    over = total ** (-1.0 / body.exponent)
    t = math.copysign(over * et * body.a, t)
    s = math.copysign(over * es * body.b, s)
    r = math.copysign(over * er * body.c, r)
    return (
        most * total * over,
        t * body.ux + s * body.vx + r * body.wx,
        t * body.uy + s * body.vy + r * body.wy,
        t * body.uz + s * body.vz + r * body.wz,
    )


@device
def support_bend(body, x, y, z, size, px, py, pz):
    """Return xx, xy, xz, yy, yz, zz of the change of a point of the surface by its unit normal: radii of curvature.

    Given both and how far the body reaches. Flat faces count as curved by `_ROUND` times their size, so that inverses
    are exact enough.
    """
    power = 1.0 / (body.exponent - 1.0)
    t = abs(body.ux * x + body.uy * y + body.uz * z) * body.a
    s = abs(body.vx * x + body.vy * y + body.vz * z) * body.b
    r = abs(body.wx * x + body.wy * y + body.wz * z) * body.c
    over = power / size
    t = over * body.a * body.a * min(max(t / size, 1e-300) ** (power - 1.0), _ROUND)
    s = over * body.b * body.b * min(max(s / size, 1e-300) ** (power - 1.0), _ROUND)
    r = over * body.c * body.c * min(max(r / size, 1e-300) ** (power - 1.0), _ROUND)
    return (
        t * body.ux * body.ux + s * body.vx * body.vx + r * body.wx * body.wx - over * px * px,
        t * body.ux * body.uy + s * body.vx * body.vy + r * body.wx * body.wy - over * px * py,
        t * body.ux * body.uz + s * body.vx * body.vz + r * body.wx * body.wz - over * px * pz,
        t * body.uy * body.uy + s * body.vy * body.vy + r * body.wy * body.wy - over * py * py,
        t * body.uy * body.uz + s * body.vy * body.vz + r * body.wy * body.wz - over * py * pz,
        t * body.uz * body.uz + s * body.vz * body.vz + r * body.wz * body.wz - over * pz * pz,
    )


@inlined
def _curvature(one, other, at, d):
    """Return the second derivatives of L by x, none of them flat, and one of their size across a plane."""
    m = 1.0 - at
    xx, xy, yy = m * one.xx + at * other.xx, m * one.xy + at * other.xy, m * one.yy + at * other.yy
    if d == 2:
        flat = _FLAT * (xx + yy)
        return xx + flat, xy, 0.0, yy + flat, 0.0, xx + yy + flat
    xz, yz, zz = m * one.xz + at * other.xz, m * one.yz + at * other.yz, m * one.zz + at * other.zz
    flat = _FLAT * (xx + yy + zz)
    return xx + flat, xy, xz, yy + flat, yz, zz + flat


@inlined
def _inverse(h):
    """Return the inverse of a symmetric positive matrix (xx, xy, xz, yy, yz, zz) as a triangle of its factors."""
    d0 = h[0]
    l1, l2 = h[1] / d0, h[2] / d0
    tiny = 1e-3 * _FLAT * (h[0] + h[3] + h[5])
    d1 = max(h[3] - l1 * h[1], tiny)
    l3 = (h[4] - l2 * h[1]) / d1
    d2 = max(h[5] - l2 * h[2] - l3 * l3 * d1, tiny)
    return l1, l2, l3, 1.0 / d0, 1.0 / d1, 1.0 / d2


@inlined
def _solved(f, x, y, z):
    """Return the inverse, as `_inverse` gives it, times a vector."""
    y = y - f[0] * x
    z = z - f[1] * x - f[2] * y
    z = z * f[5]
    y = y * f[4] - f[2] * z
    return x * f[3] - f[0] * y - f[1] * z, y, z


@device
def gauge_touch(one, other, x, y, z, d, limit):
    """Return the touch of two bodies whose centers are r = (x, y, z) apart, or less where F is above a limit.

    Newton's method in x for given l, where its steps are cut so that the slope along them falls, and in l, between what
    brackets it; then in both. Where F is known to exceed the limit nothing more is computed: F comes out as infinite.

    Parameters
    ----------
    one, other
        The bodies.
    x, y, z
        Vector from center i to center j, not zero.
    d
        Number of axes.
    limit
        Largest F of interest.

    """
    gi, gj = math.sqrt(gauge(one, x, y, z).value), math.sqrt(gauge(other, x, y, z).value)
    share = gj / (gi + gj)
    # where on the line between the centers both gauges are the same
    px, py, pz = share * x, share * y, share * z
    length = math.sqrt(x * x + y * y + z * z)
    here, there = gauge(one, px, py, pz), gauge(other, px - x, py - y, pz - z)
    # l at which forces along that line balance
    at = gi / (gi + gj)
    low, high = 0.0, 1.0
    for _ in range(_ROUNDS):
        done = False
        for _ in range(_STEPS):
            f = _inverse(_curvature(here, there, at, d))
            m = 1.0 - at
            qx, qy, qz = m * here.x + at * there.x, m * here.y + at * there.y, m * here.z + at * there.z
            wx, wy, wz = there.x - here.x, there.y - here.y, there.z - here.z
            sx, sy, sz = _solved(f, qx, qy, qz)
            tx, ty, tz = _solved(f, wx, wy, wz)
            slope = -(sx * qx + sy * qy + sz * qz)
            bend = wx * tx + wy * ty + wz * tz
            rise = there.value - here.value
            value = m * here.value + at * there.value
            gain = rise * rise / bend if bend > 0.0 else 0.0
            if -slope <= max(_INNER * gain, _NEAR * value):
                done = True
                break
            size = math.sqrt(sx * sx + sy * sy + sz * sz)
            step = min(1.0, length / size)
            for _ in range(_CUTS):
                nx, ny, nz = px - step * sx, py - step * sy, pz - step * sz
                here, there = gauge(one, nx, ny, nz), gauge(other, nx - x, ny - y, nz - z)
                # the slope along the step, where it ends: L is convex, below zero it may go on falling
                qx, qy, qz = m * here.x + at * there.x, m * here.y + at * there.y, m * here.z + at * there.z
                end = -(sx * qx + sy * qy + sz * qz)
                if end <= -0.5 * slope:
                    break
                step *= max(0.1, min(0.9, -slope / (end - slope)))
            px, py, pz = nx, ny, nz
        if value > limit:
            # a plane across the force with which they would touch keeps them apart, if there is one
            nx, ny, nz = here.x - there.x, here.y - there.y, here.z - there.z
            reach = support(one, nx, ny, nz) + support(other, nx, ny, nz)
            if nx * x + ny * y + nz * z >= math.sqrt(limit) * reach:
                return GaugeTouch(math.inf, at, px, py, pz, 0.0, 0.0, 0.0)
        if done and gain <= _NEAR * value:
            break
        # where the inner problem ends, to first order
        rise -= wx * sx + wy * sy + wz * sz
        if rise > 0.0:
            low = at
        else:
            high = at
        move = rise / bend if bend > 0.0 else 2.0
        at = at + move if low < at + move < high else 0.5 * (low + high)
    return _polished(one, other, x, y, z, d, px, py, pz, at)


@device
def _polished(one, other, x, y, z, d, px, py, pz, at):
    """Return the touch from a point and l that are nearly right: Newton's steps in both while forces come nearer."""
    before = math.inf
    here, there = gauge(one, px, py, pz), gauge(other, px - x, py - y, pz - z)
    kept = (here, there, px, py, pz, at)
    for _ in range(_LAST):
        m = 1.0 - at
        qx, qy, qz = m * here.x + at * there.x, m * here.y + at * there.y, m * here.z + at * there.z
        rise = there.value - here.value
        force = m * math.sqrt(here.x * here.x + here.y * here.y + here.z * here.z)
        off = math.sqrt(qx * qx + qy * qy + qz * qz) / force + abs(rise) / here.value
        if not off < before:
            break
        kept = (here, there, px, py, pz, at)
        if off < 1e-16 or off > 0.5 * before:
            break
        before = off
        f = _inverse(_curvature(here, there, at, d))
        wx, wy, wz = there.x - here.x, there.y - here.y, there.z - here.z
        sx, sy, sz = _solved(f, qx, qy, qz)
        tx, ty, tz = _solved(f, wx, wy, wz)
        move = (rise - (wx * sx + wy * sy + wz * sz)) / (wx * tx + wy * ty + wz * tz)
        px, py, pz = px - sx - move * tx, py - sy - move * ty, pz - sz - move * tz
        at = min(max(at + move, 0.0), 1.0)
        here, there = gauge(one, px, py, pz), gauge(other, px - x, py - y, pz - z)
    here, there, px, py, pz, at = kept
    m = 1.0 - at
    return GaugeTouch(
        m * here.value + at * there.value, at, px, py, pz,
        0.25 * (m * here.x - at * there.x), 0.25 * (m * here.y - at * there.y), 0.25 * (m * here.z - at * there.z),
    )  # fmt: skip


@inlined
def slopes_of_scale(touch, x, y, z):
    """Return s, and its slopes along r, along turns of i and along turns of j, about three axes each."""
    s = math.sqrt(touch.square)
    over = 1.0 / s
    fx, fy, fz = over * touch.fx, over * touch.fy, over * touch.fz
    px, py, pz = touch.px, touch.py, touch.pz
    bx, by, bz = px - x, py - y, pz - z
    return (
        s, fx, fy, fz,
        pz * fy - py * fz, px * fz - pz * fx, py * fx - px * fy,
        by * fz - bz * fy, bz * fx - bx * fz, bx * fy - by * fx,
    )  # fmt: skip


@inlined
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@device
def _turned_gauge(body, x, y, z, weight, axis, second):
    """Return the derivative, by a turn of a body about an axis, of its weighted dG/dx at a point that stays.

    With W the cross product with the axis, G of the turned body at x is G at x - W x + W W x / 2.
    """
    h = second
    ex, ey, ez = (1.0, 0.0, 0.0) if axis == 0 else (0.0, 1.0, 0.0) if axis == 1 else (0.0, 0.0, 1.0)
    tx, ty, tz = _cross(ex, ey, ez, x, y, z)
    gx, gy, gz = _cross(ex, ey, ez, h.x, h.y, h.z)
    return (
        weight * (gx - h.xx * tx - h.xy * ty - h.xz * tz),
        weight * (gy - h.xy * tx - h.yy * ty - h.yz * tz),
        weight * (gz - h.xz * tx - h.yz * ty - h.zz * tz),
    )


@device
def _second_derivatives(one, other, touch, x, y, z, d, mixed, solved, second):
    """Write the second derivatives of F along r and the turns of i and of j, as the module says.

    `mixed` and `solved` are scratch arrays: (X, 3) derivatives of dL/dx by the coordinates, and L_xx^-1 times these.
    """
    t = 1 if d == 2 else 3
    size = d + 2 * t
    at, m = touch.parameter, 1.0 - touch.parameter
    px, py, pz = touch.px, touch.py, touch.pz
    bx, by, bz = px - x, py - y, pz - z
    here, there = gauge(one, px, py, pz), gauge(other, bx, by, bz)
    f = _inverse(_curvature(here, there, at, d))
    wx, wy, wz = there.x - here.x, there.y - here.y, there.z - here.z
    ux, uy, uz = _solved(f, wx, wy, wz)
    bend = wx * ux + wy * uy + wz * uz
    hj = ((there.xx, there.xy, there.xz), (there.xy, there.yy, there.yz), (there.xz, there.yz, there.zz))
    for k in range(size):
        if k < d:
            cx, cy, cz = -at * hj[0][k], -at * hj[1][k], -at * hj[2][k]
        else:
            turn = (k - d) % t if t == 3 else 2
            if k < d + t:
                cx, cy, cz = _turned_gauge(one, px, py, pz, m, turn, here)
            else:
                cx, cy, cz = _turned_gauge(other, bx, by, bz, at, turn, there)
        if d == 2:
            cz = 0.0
        mixed[k, 0], mixed[k, 1], mixed[k, 2] = cx, cy, cz
        solved[k, 0], solved[k, 1], solved[k, 2] = _solved(f, cx, cy, cz)
    for k in range(size):
        # dF/dk at fixed x and l is linear in l: what it is of j less what it is of i
        if k < d:
            own_k = -(there.x if k == 0 else there.y if k == 1 else there.z)
        else:
            turn = (k - d) % t if t == 3 else 2
            ix, iy, iz = _cross(px, py, pz, here.x, here.y, here.z)
            jx, jy, jz = _cross(bx, by, bz, there.x, there.y, there.z)
            if k < d + t:
                own_k = ix if turn == 0 else iy if turn == 1 else iz
            else:
                own_k = -(jx if turn == 0 else jy if turn == 1 else jz)
        # the fourth entry of the row: by l, x following
        mixed[k, 3] = own_k - (mixed[k, 0] * ux + mixed[k, 1] * uy + mixed[k, 2] * uz)
    for k in range(size):
        for n in range(k + 1):
            value = -(mixed[k, 0] * solved[n, 0] + mixed[k, 1] * solved[n, 1] + mixed[k, 2] * solved[n, 2])
            value += mixed[k, 3] * mixed[n, 3] / bend
            second[k, n] = second[n, k] = value
    # and L_ab itself
    for k in range(d):
        for n in range(d):
            second[k, n] += at * hj[k][n]
    for k in range(d, size):
        turn = (k - d) % t if t == 3 else 2
        if k >= d + t:
            # by r: minus the derivative of the gradient
            for n in range(d):
                second[k, n] -= mixed[k, n]
                second[n, k] -= mixed[k, n]
        first = k < d + t
        for n in range(d if first else d + t, d + t if first else size):
            other_turn = (n - d) % t if t == 3 else 2
            if first:
                second[k, n] += m * _turned_twice(px, py, pz, here, turn, other_turn)
            else:
                second[k, n] += at * _turned_twice(bx, by, bz, there, turn, other_turn)


@device
def _turned_twice(x, y, z, h, one, other):
    """Return the second derivative of G at a point that stays by a rotation vector of the body."""
    e = (1.0 if one == 0 else 0.0, 1.0 if one == 1 else 0.0, 1.0 if one == 2 else 0.0)
    f = (1.0 if other == 0 else 0.0, 1.0 if other == 1 else 0.0, 1.0 if other == 2 else 0.0)
    ax, ay, az = _cross(e[0], e[1], e[2], x, y, z)
    bx, by, bz = _cross(f[0], f[1], f[2], x, y, z)
    curved = ax * (h.xx * bx + h.xy * by + h.xz * bz) + ay * (h.xy * bx + h.yy * by + h.yz * bz)
    curved += az * (h.xz * bx + h.yz * by + h.zz * bz)
    # W W x for both orders, half each
    along_e, along_f = e[0] * x + e[1] * y + e[2] * z, f[0] * x + f[1] * y + f[2] * z
    both = e[0] * f[0] + e[1] * f[1] + e[2] * f[2]
    bent = 0.0
    for k in range(3):
        g = h.x if k == 0 else h.y if k == 1 else h.z
        v = x if k == 0 else y if k == 1 else z
        bent += g * (0.5 * (e[k] * along_f + f[k] * along_e) - both * v)
    return curved + bent


@kernel
def _contacts(vector_pd, semi_pk3, exponent_pk, frame_pkdd, second):
    """Return scales, points and derivatives."""
    count, d = vector_pd.shape
    size = 4 if d == 2 else 9
    scale, point = np.empty(count), np.empty((count, d))
    first_px = np.empty((count, size))
    second_pxx = np.empty((count if second else 0, size, size))
    mixed, solved = np.zeros((size, 4)), np.zeros((size, 3))
    for p in range(count):
        x, y = vector_pd[p, 0], vector_pd[p, 1]
        z = vector_pd[p, 2] if d == 3 else 0.0
        one = body_at(semi_pk3[p, 0], exponent_pk[p, 0], frame_pkdd[p, 0])
        other = body_at(semi_pk3[p, 1], exponent_pk[p, 1], frame_pkdd[p, 1])
        touch = gauge_touch(one, other, x, y, z, d, math.inf)
        s, fx, fy, fz, ix, iy, iz, jx, jy, jz = slopes_of_scale(touch, x, y, z)
        scale[p] = s
        point[p, 0], point[p, 1] = touch.px, touch.py
        if d == 2:
            first_px[p, 0], first_px[p, 1], first_px[p, 2], first_px[p, 3] = fx, fy, iz, jz
        else:
            point[p, 2] = touch.pz
            first_px[p, 0], first_px[p, 1], first_px[p, 2] = fx, fy, fz
            first_px[p, 3], first_px[p, 4], first_px[p, 5] = ix, iy, iz
            first_px[p, 6], first_px[p, 7], first_px[p, 8] = jx, jy, jz
        if second:
            curved = second_pxx[p]
            _second_derivatives(one, other, touch, x, y, z, d, mixed, solved, curved)
            for a in range(size):
                for b in range(size):
                    curved[a, b] = curved[a, b] / (2.0 * s) - first_px[p, a] * first_px[p, b] / s
    return scale, point, first_px, second_pxx


def gauge_contacts(
    vector_pd: NDArray[np.float64],
    semi_pkd: NDArray[np.float64],
    exponent_pk: NDArray[np.float64],
    frame_pkdd: NDArray[np.float64],
    *,
    second: bool = False,
) -> GaugeContacts:
    """Return the scales at which pairs of superellipsoids touch, with derivatives.

    Parameters
    ----------
    vector_pd
        (P, d) vectors from center i to center j [length], none of them zero.
    semi_pkd
        (P, 2, d) semi-axes of both [length].
    exponent_pk
        (P, 2) exponents, 2 or more.
    frame_pkdd
        (P, 2, d, d) their axes in columns, orthonormal.
    second
        Whether second derivatives are asked for.

    """
    count, d = vector_pd.shape
    semi, frame = np.ones((count, 2, 3)), np.zeros((count, 2, 3, 3))
    semi[..., :d], frame[..., :d, :d], frame[..., 2, 2] = semi_pkd, frame_pkdd, 1.0
    if d == 3:
        frame = np.ascontiguousarray(frame_pkdd)
    return GaugeContacts(*_contacts(vector_pd, semi, exponent_pk, frame, second))
