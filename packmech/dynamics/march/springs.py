# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Tangential springs of a march: their stretch, the slip that stretches them, and the torques of their forces.

A row of `body` holds x, y, z, radius, the peculiar velocity (d numbers) and, where particles turn, the spin (1 in a
plane, 3 in space); a row of `push` the force (d) and the torque.

A stretch is the integral of the slip, by the trapezoidal rule: a pass first adds `before` times the slip, takes the
force, and then adds `after` times it. In space it turns with the contact by half a step before and half a step after.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.compiled import device


class Pace(NamedTuple):
    """How much of the slip is added before and after the force is taken [time]."""

    before: float
    after: float


@device
def spun(x, y, z, ox, oy, oz, time):
    """Return a stretch turned by the angular velocity o for a time."""
    # the rotation of Cayley, (1 - W t/2)^-1 (1 + W t/2), keeps lengths and is of second order
    hx, hy, hz = 0.5 * time * ox, 0.5 * time * oy, 0.5 * time * oz
    cx, cy, cz = x + hy * z - hz * y, y + hz * x - hx * z, z + hx * y - hy * x
    dot = hx * cx + hy * cy + hz * cz
    scale = 1.0 / (1.0 + hx * hx + hy * hy + hz * hz)
    return (
        scale * (cx + hy * cz - hz * cy + hx * dot),
        scale * (cy + hz * cx - hx * cz + hy * dot),
        scale * (cz + hx * cy - hy * cx + hz * dot),
    )


@device
def stretch_before(held_pk, p, nx, ny, nz, sx, sy, sz, ox, oy, oz, time):
    """Return the stretch led on by a time at the present slip: turned, laid into the tangent plane, and stretched."""
    x, y, z = held_pk[p, 0], held_pk[p, 1], held_pk[p, 2]
    size = x * x + y * y + z * z
    if size > 0.0:
        x, y, z = spun(x, y, z, ox, oy, oz, time)
        along = x * nx + y * ny + z * nz
        x -= along * nx
        y -= along * ny
        z -= along * nz
        left = x * x + y * y + z * z
        scale = math.sqrt(size / left) if left > 0.0 else 0.0
        x *= scale
        y *= scale
        z *= scale
    return x + time * sx, y + time * sy, z + time * sz


@device
def stretch_after(held_pk, p, x, y, z, sx, sy, sz, ox, oy, oz, time):
    """Keep the stretch, led on by a time at the present slip: stretched, then turned."""
    x, y, z = spun(x + time * sx, y + time * sy, z + time * sz, ox, oy, oz, time)
    held_pk[p, 0] = x
    held_pk[p, 1] = y
    held_pk[p, 2] = z


@device
def slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma):
    """Return arms, slip velocity of the contact points, and the angular velocity with which the contact turns."""
    share = r * (1.0 / sigma)
    ai = body[i, 3] * share
    aj = body[j, 3] * share
    wx = ai * body[i, 7] + aj * body[j, 7]
    wy = ai * body[i, 8] + aj * body[j, 8]
    wz = ai * body[i, 9] + aj * body[j, 9]
    along = ux * nx + uy * ny + uz * nz
    tx, ty, tz = ux - along * nx, uy - along * ny, uz - along * nz
    # v_j - v_i - (a_i w_i + a_j w_j) x n, tangential part
    sx = tx - (wy * nz - wz * ny)
    sy = ty - (wz * nx - wx * nz)
    sz = tz - (wx * ny - wy * nx)
    # the line of centers turns by n x dn/dt, and about itself with the mean spin along it
    about = 0.5 * ((body[i, 7] + body[j, 7]) * nx + (body[i, 8] + body[j, 8]) * ny + (body[i, 9] + body[j, 9]) * nz)
    inverse = 1.0 / r if r > 0.0 else 0.0
    ox = (ny * tz - nz * ty) * inverse + about * nx
    oy = (nz * tx - nx * tz) * inverse + about * ny
    oz = (nx * ty - ny * tx) * inverse + about * nz
    return ai, aj, sx, sy, sz, ox, oy, oz


@device
def slip_in_plane(body, i, j, nx, ny, ux, uy, r, sigma):
    """Return arms, and the slip along t = (-ny, nx)."""
    share = r * (1.0 / sigma)
    ai = body[i, 3] * share
    aj = body[j, 3] * share
    return ai, aj, uy * nx - ux * ny - ai * body[i, 6] - aj * body[j, 6]


@device
def with_moment(nx, ny, nz, fx, fy, fz, ai, aj):
    """Return a tangential force on i, its moment for an arm of one, and the arms: the torques are arm times moment."""
    return fx, fy, fz, ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx, ai, aj


@device
def give(axes, spins, push, i, done):
    """Add a pair's force, and its torque where particles turn, to row i."""
    fx, fy, fz, mx, my, mz, ai, _ = done
    push[i, 0] += fx
    push[i, 1] += fy
    if len(axes) == 3:
        push[i, 2] += fz
    if len(spins) == 1:
        push[i, 2] += ai * mz
    if len(spins) == 3:
        push[i, 3] += ai * mx
        push[i, 4] += ai * my
        push[i, 5] += ai * mz


@device
def give_back(axes, spins, push, j, done):
    """Add the reaction to row j: the torque has the same sign on both."""
    fx, fy, fz, mx, my, mz, _, aj = done
    push[j, 0] -= fx
    push[j, 1] -= fy
    if len(axes) == 3:
        push[j, 2] -= fz
    if len(spins) == 1:
        push[j, 2] += aj * mz
    if len(spins) == 3:
        push[j, 3] += aj * mx
        push[j, 4] += aj * my
        push[j, 5] += aj * mz


@device
def leave(axes, spins, slot_qk, q, done):
    """Write the reaction to a slot."""
    fx, fy, fz, mx, my, mz, _, aj = done
    slot_qk[q, 0] = -fx
    slot_qk[q, 1] = -fy
    if len(axes) == 3:
        slot_qk[q, 2] = -fz
    if len(spins) == 1:
        slot_qk[q, 2] = aj * mz
    if len(spins) == 3:
        slot_qk[q, 3] = aj * mx
        slot_qk[q, 4] = aj * my
        slot_qk[q, 5] = aj * mz
