# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The figures of a march at one moment: their columns, how they are summed, and those of single particles."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import literal_unroll, types

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.flow import with_flow
from packmech.dynamics.march.inlined import inlined
from packmech.effects import body_energy

# columns of a ledger
TIME, STRAIN, RATE = 0, 1, 2
POTENTIAL, TANGENTIAL, KINETIC, ROTATIONAL = 3, 4, 5, 6
CONTACTS, SLIDING, MOST, TOTAL = 7, 8, 9, 10
# 3 x 3 sums, row by row: force on i times branch vector over contacts and bonds; bonds alone; m c c; I/2 (w w - w^2 1)
FORCE, BONDED, MOTION, SPINNING = 11, 20, 29, 38
# 3 numbers each: sum of torques, of m c, of x cross m v + I w; then the sum of m |c|
TORQUE, MOMENTUM, ANGULAR, IMPULSE = 47, 50, 53, 56
COLUMNS = 57


@inlined
def dyad(axes, sums, fx, fy, fz, dx, dy, dz):
    """Return nine sums, row by row, with a product of two vectors added; a plane's third axis stays zero."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = sums
    xx += fx * dx
    xy += fx * dy
    yx += fy * dx
    yy += fy * dy
    if len(axes) == 3:
        xz += fx * dz
        yz += fy * dz
        zx += fz * dx
        zy += fz * dy
        zz += fz * dz
    return xx, xy, xz, yx, yy, yz, zx, zy, zz


@inlined
def moment(axes, sums, ai, aj, nx, ny, nz, fx, fy, fz):
    """Return three sums of torques with those of a tangential force added."""
    mx, my, mz = sums
    arm = ai + aj
    mz += arm * (nx * fy - ny * fx)
    if len(axes) == 3:
        mx += arm * (ny * fz - nz * fy)
        my += arm * (nz * fx - nx * fz)
    return mx, my, mz


@device
def write(out, place, sums):
    """Write a tuple of sums to a row of figures."""
    for k in range(len(sums)):
        out[place + k] = sums[k]


def energy_of_bodies(bodies: Any, body: Any, mass_n: Any) -> float:
    """Return the energy of single particles under what acts on them."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(energy_of_bodies)
def _choose_energy_of_bodies(bodies: Any, body: Any, mass_n: Any) -> Any:
    if isinstance(bodies, types.NoneType):
        return lambda bodies, body, mass_n: 0.0

    def total(bodies, body, mass_n):
        energy = 0.0
        for i in range(body.shape[0]):
            for one in literal_unroll(bodies):
                energy += body_energy(one, body[i, 0], body[i, 1], body[i, 2], mass_n[i], body[i, 3])
        return energy

    return total


@inlined
def look_at_motion(axes, state, flowing, out):
    """Write the figures of single particles and their motion."""
    d = len(axes)
    body, push, mass_n, weight = state.body, state.push, state.mass_n, state.weight_nk
    kinetic = rotational = impulse = most = 0.0
    motion = spinning = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    px = py = pz = lx = ly = lz = 0.0
    for i in range(np.uint64(body.shape[0])):
        m = mass_n[i]
        u, v, w = body[i, 4], body[i, 5], 0.0
        x, y, z = body[i, 0], body[i, 1], 0.0
        if d == 3:
            w, z = body[i, 6], body[i, 2]
        square = u * u + v * v + w * w
        kinetic += 0.5 * m * square
        impulse += m * math.sqrt(square)
        motion = dyad(axes, motion, m * u, m * v, m * w, u, v, w)
        px += m * u
        py += m * v
        pz += m * w
        u, v, w = with_flow(flowing, u, v, w, x, y, z)
        lz += m * (x * v - y * u)
        if d == 3:
            lx += m * (y * w - z * v)
            ly += m * (z * u - x * w)
        if len(state.spins) > 0:
            inertia = 1.0 / weight[i, 1] if weight[i, 1] > 0.0 else 0.0
            half = 0.5 * inertia
            p = q = 0.0
            r = body[i, 4 + d + len(state.spins) - 1]
            if d == 3:
                p, q = body[i, 7], body[i, 8]
                lx += inertia * p
                ly += inertia * q
            lz += inertia * r
            square = p * p + q * q + r * r
            rotational += half * square
            spinning = dyad(axes, spinning, half * p, half * q, half * r, p, q, r)
        square = 0.0
        for a in range(d):
            square += push[i, a] * push[i, a]
        most = max(most, square)
    out[KINETIC] = kinetic
    out[ROTATIONAL] = rotational
    out[IMPULSE] = impulse
    out[MOST] = math.sqrt(most)
    write(out, MOTION, motion)
    write(out, SPINNING, spinning)
    # w w - w^2 1, whose last number is zero in a plane
    for k in range(d):
        out[SPINNING + 4 * k] -= rotational
    write(out, MOMENTUM, (px, py, pz))
    write(out, ANGULAR, (lx, ly, lz))
