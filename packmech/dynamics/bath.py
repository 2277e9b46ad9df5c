# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""A heat bath in time steps: what it takes from and gives to velocities and spins between both kicks of a step.

A kicked velocity p becomes 2 q - p, and the particle is carried by q = p + share, share = -lost p + noise (`Langevin`).
The rows have already been carried by p: the rest is added here, so that scenes without a bath have none of it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.by_shape import dragged_to, spread_of_kicks
from packmech.dynamics.deformation import maps_of_step, rates_at, turning
from packmech.effects import Langevin
from packmech.jit.by_type import by_type
from packmech.jit.compiled import inlined
from packmech.jit.philox import normal_pair, philox

_LOW, _HALF = np.uint64(0xFFFFFFFF), np.uint64(32)


class Bath(NamedTuple):
    """The bath of a run of steps dt: b rate dt / 2, b sqrt(rate temperature dt / 2), the seed in halves, and particles.

    `particle_n` are the numbers of the particles of rows.
    """

    lost: float
    noise: float
    key: Any
    other_key: Any
    particle_n: Any


def make_bath(effect: Langevin | None, dt: float, particle_n: NDArray[np.int64]) -> Bath | None:
    """Return the bath of an effect; None without one."""
    if effect is None:
        return None
    part = 0.5 * effect.rate * dt
    b, seed = 1.0 / (1.0 + part), int(effect.seed)
    noise = b * math.sqrt(0.5 * effect.rate * effect.temperature * dt)
    return Bath(b * part, noise, np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32), particle_n.astype(np.uint64))


@inlined
def _normals(bath, i, step, block):
    """Return four standard normal numbers of a row."""
    particle = bath.particle_n[i]
    high = ((step >> _HALF) << np.uint64(2)) | block
    a, b, c, d = philox(particle & _LOW, step & _LOW, high, particle >> _HALF, bath.key, bath.other_key)
    x, y = normal_pair(a, b)
    z, w = normal_pair(c, d)
    return x, y, z, w


@inlined
def _times(matrix, x, y, z):
    return (
        matrix[0][0] * x + matrix[0][1] * y + matrix[0][2] * z,
        matrix[1][0] * x + matrix[1][1] * y + matrix[1][2] * z,
        matrix[2][0] * x + matrix[2][1] * y + matrix[2][2] * z,
    )


@inlined
def _no_bath(bath, shapes, flow, axes, state, rows, time, dt, square):
    return square


@inlined
def _bathe(bath, shapes, flow, axes, state, rows, time, dt, square):
    d, spins = len(axes), len(state.spins)
    body, half, push, weight = state.body, state.half, state.push, state.weight_nk
    step = np.uint64(np.int64(time / dt + 0.5))
    one = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    g = b = h = one
    wx = wy = wz = 0.0
    if flow is not None:
        g, b, h = maps_of_step(flow, time, dt)
        wx, wy, wz = turning(rates_at(flow, time + 0.5 * dt))
    largest = 0.0
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        x, y, z, w = _normals(bath, i, step, np.uint64(0))
        size = bath.noise * math.sqrt(weight[i, 0])
        lost = bath.lost if weight[i, 0] > 0.0 else 0.0
        pz = half[i, 2] if d == 3 else 0.0
        px, py, pz = _times(g, half[i, 0], half[i, 1], pz)
        sx, sy = size * x - lost * px, size * y - lost * py
        sz = size * z - lost * pz if d == 3 else 0.0
        mx, my, mz = _times(h, px + sx, py + sy, pz + sz)
        moved = dt * dt * (mx * mx + my * my + mz * mz)
        if not moved <= largest:
            largest = moved
        mx, my, mz = _times(h, sx, sy, sz)
        vx, vy, vz = _times(b, sx, sy, sz)
        body[i, 0] += dt * mx
        body[i, 1] += dt * my
        half[i, 0] += 2.0 * vx
        half[i, 1] += 2.0 * vy
        body[i, 4] += 2.0 * vx
        body[i, 5] += 2.0 * vy
        if d == 3:
            body[i, 2] += dt * mz
            half[i, 2] += 2.0 * vz
            body[i, 6] += 2.0 * vz
        if spins > 0 and weight[i, 1] > 0.0:
            size = bath.noise * math.sqrt(weight[i, 1])
            if d == 2:
                share = size * z - bath.lost * (half[i, 2] - wz)
                push[i, 2] = share
                half[i, 2] += share
                body[i, 6] += 2.0 * share
            else:
                u, v, t, w = _normals(bath, i, step, np.uint64(1))
                x, y, z = spread_of_kicks(shapes, axes, i, size * u, size * v, size * t)
                ox, oy, oz = dragged_to(shapes, axes, i, wx, wy, wz)
                x -= bath.lost * (half[i, 3] - ox)
                y -= bath.lost * (half[i, 4] - oy)
                z -= bath.lost * (half[i, 5] - oz)
                push[i, 3], push[i, 4], push[i, 5] = x, y, z
                half[i, 3] += x
                half[i, 4] += y
                half[i, 5] += z
                body[i, 7] += 2.0 * x
                body[i, 8] += 2.0 * y
                body[i, 9] += 2.0 * z
    return largest


@inlined
def _leave(bath, axes, state, rows):
    d, half, push = len(axes), state.half, state.push
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        for k in range(len(state.spins)):
            half[i, d + k] += push[i, d + k]
            push[i, d + k] = 0.0


# adds the bath's share to rows that were kicked and carried, all of it to velocities and half of it to what turns
# shapes; returns the largest squared displacement, in place of the one that is given where there is no bath
bathe_rows = by_type(_no_bath, {Bath: _bathe})
# adds the other half, when shapes have turned
leave_bath = by_type(lambda bath, axes, state, rows: None, {Bath: _leave})
