# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The compiled passes over pairs and particles that every minimizer is made of.

A row holds x, y, z, radius, fx, fy, fz and a stiffness: one cache line a particle (z = 0 in two dimensions). Passes
take the scene's tuple of effects and walk it with `literal_unroll`, so that code for an absent effect does not exist,
and a tuple `axes` as long as the dimension, so that a plane does not pay for the third axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.compiled import device, kernel
from packmech.contacts.cells import Frame, Sizes
from packmech.dynamics.pair_list import AGE, BUDGET, TRAVEL, PairList, follow
from packmech.effects import pair_energy, pair_first, pair_second

# columns of a row
X, RADIUS, FORCE, STIFFNESS, COLUMNS = 0, 3, 4, 7, 8

# how a chunk of steps ended
RUNNING, CONVERGED, FLOOR, UNJAMMED, NOT_FINITE, STALLED = range(6)


class Space(NamedTuple):
    """What stays fixed while particles move: sizes, box, resolution of positions (rounding unit times extent)."""

    sizes: Sizes
    frame: Frame
    resolution: float


class Goal(NamedTuple):
    """When to stop: largest net force over mean contact force [1]; mean contact force [force] that counts as none."""

    force_tolerance: float
    force_floor: float


@device
def coincident_direction(i, j, dimension):
    """Return a fixed unit vector for two particles at the same place, made of their numbers only."""
    turn = (i + 1) * 0.6180339887498949 + (j + 1) * 0.7548776662466927
    angle = 2.0 * math.pi * (turn - math.floor(turn))
    if dimension == 2:
        return math.cos(angle), math.sin(angle), 0.0
    rise = (i + 1) * 0.5698402909980532 + (j + 1) * 0.8191725133961645
    height = 2.0 * (rise - math.floor(rise)) - 1.0
    across = math.sqrt(1.0 - height * height)
    return across * math.cos(angle), across * math.sin(angle), height


@device
def force_pass(effects, axes, row, velocity_nd, pairs):
    """Add the forces of touching pairs to the rows; return the sum of their sizes and the number of pairs."""
    bits = np.uint64(pairs.bits)
    mask = np.uint64((1 << pairs.bits) - 1)
    shift_kd = pairs.shift_kd
    i_p = pairs.i_p
    code_p = pairs.code_p
    total = 0.0
    touching = 0
    for p in range(pairs.picked):
        i = i_p[p]
        code = code_p[p]
        j = code >> bits
        k = code & mask
        dx = row[j, 0] - row[i, 0] + shift_kd[k, 0]
        dy = row[j, 1] - row[i, 1] + shift_kd[k, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = row[j, 2] - row[i, 2] + shift_kd[k, 2]
            square += dz * dz
        sigma = row[i, 3] + row[j, 3]
        if square < sigma * sigma:
            r = math.sqrt(square)
            inverse = 1.0 / r
            if square == 0.0:
                dx, dy, dz = coincident_direction(i, j, len(axes))
                inverse = 1.0
            rate = (velocity_nd[j, 0] - velocity_nd[i, 0]) * dx + (velocity_nd[j, 1] - velocity_nd[i, 1]) * dy
            if len(axes) == 3:
                rate += (velocity_nd[j, 2] - velocity_nd[i, 2]) * dz
            rate *= inverse
            first = 0.0
            for one in literal_unroll(effects):
                first += pair_first(one, r, sigma, rate)
            total += abs(first)
            touching += 1
            first *= inverse
            fx = first * dx
            fy = first * dy
            row[i, 4] += fx
            row[i, 5] += fy
            row[j, 4] -= fx
            row[j, 5] -= fy
            if len(axes) == 3:
                fz = first * dz
                row[i, 6] += fz
                row[j, 6] -= fz
    return total, touching


@device
def power_pass(axes, row, velocity_nd):
    """Return F.v and F.F over all particles, and the largest squared force on one."""
    power = 0.0
    square = 0.0
    most = 0.0
    for i in range(row.shape[0]):
        fx = row[i, 4]
        fy = row[i, 5]
        own = fx * fx + fy * fy
        power += fx * velocity_nd[i, 0] + fy * velocity_nd[i, 1]
        if len(axes) == 3:
            fz = row[i, 6]
            own += fz * fz
            power += fz * velocity_nd[i, 2]
        square += own
        most = max(most, own)
    return power, square, most


@device
def move_pass(axes, row, velocity_nd, keep, push, dt):
    """Set v = keep v + push F, move by dt v, clear the forces; return v.v over all and the largest squared speed."""
    square = 0.0
    most = 0.0
    for i in range(row.shape[0]):
        vx = keep * velocity_nd[i, 0] + push * row[i, 4]
        vy = keep * velocity_nd[i, 1] + push * row[i, 5]
        velocity_nd[i, 0] = vx
        velocity_nd[i, 1] = vy
        row[i, 0] += dt * vx
        row[i, 1] += dt * vy
        row[i, 4] = 0.0
        row[i, 5] = 0.0
        own = vx * vx + vy * vy
        if len(axes) == 3:
            vz = keep * velocity_nd[i, 2] + push * row[i, 6]
            velocity_nd[i, 2] = vz
            row[i, 2] += dt * vz
            row[i, 6] = 0.0
            own += vz * vz
        square += own
        most = max(most, own)
    return square, most


@device
def clear_forces(row):
    """Set all forces to zero."""
    for i in range(row.shape[0]):
        row[i, 4] = 0.0
        row[i, 5] = 0.0
        row[i, 6] = 0.0


@device
def travel(axes, row, space, pairs, distance):
    """Return the pair list after a step in which nobody moved farther than the distance."""
    pairs.number[TRAVEL] += distance
    pairs.number[AGE] += 1.0
    if pairs.number[TRAVEL] > pairs.number[BUDGET]:
        return follow(axes, row, space.sizes, space.frame, pairs)
    return pairs


@device
def stiffest(effects, axes, row, pairs):
    """Return the largest sum of contact stiffnesses on one particle, half a bound on the largest curvature."""
    bits = np.uint64(pairs.bits)
    mask = np.uint64((1 << pairs.bits) - 1)
    for i in range(row.shape[0]):
        row[i, 7] = 0.0
    for p in range(pairs.picked):
        i = pairs.i_p[p]
        j = pairs.code_p[p] >> bits
        k = pairs.code_p[p] & mask
        dx = row[j, 0] - row[i, 0] + pairs.shift_kd[k, 0]
        dy = row[j, 1] - row[i, 1] + pairs.shift_kd[k, 1]
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = row[j, 2] - row[i, 2] + pairs.shift_kd[k, 2]
            square += dz * dz
        sigma = row[i, 3] + row[j, 3]
        if square < sigma * sigma:
            second = 0.0
            for one in literal_unroll(effects):
                second += pair_second(one, math.sqrt(square), sigma)
            row[i, 7] += abs(second)
            row[j, 7] += abs(second)
    most = 0.0
    for i in range(row.shape[0]):
        most = max(most, row[i, 7])
    return most


class Tally(NamedTuple):
    """Totals of one evaluation; virial_dd = sum over pairs of f v (outer product), in three dimensions."""

    energy: float
    total_force: float
    touching: int
    max_force: float
    stiffness: float
    virial_dd: NDArray[np.float64]


@device
def evaluate(effects, axes, row, pairs):
    """Put the conservative forces into the rows and return the totals."""
    bits = np.uint64(pairs.bits)
    mask = np.uint64((1 << pairs.bits) - 1)
    stiffness = stiffest(effects, axes, row, pairs)
    clear_forces(row)
    energy = 0.0
    total = 0.0
    touching = 0
    virial = np.zeros((3, 3))
    for p in range(pairs.picked):
        i = pairs.i_p[p]
        j = pairs.code_p[p] >> bits
        k = pairs.code_p[p] & mask
        dx = row[j, 0] - row[i, 0] + pairs.shift_kd[k, 0]
        dy = row[j, 1] - row[i, 1] + pairs.shift_kd[k, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = row[j, 2] - row[i, 2] + pairs.shift_kd[k, 2]
            square += dz * dz
        sigma = row[i, 3] + row[j, 3]
        if square < sigma * sigma:
            r = math.sqrt(square)
            inverse = 1.0 / r
            if square == 0.0:
                dx, dy, dz = coincident_direction(i, j, len(axes))
                inverse = 1.0
            first = 0.0
            for one in literal_unroll(effects):
                energy += pair_energy(one, r, sigma)
                first += pair_first(one, r, sigma, 0.0)
            total += abs(first)
            touching += 1
            first *= inverse
            fx = first * dx
            fy = first * dy
            row[i, 4] += fx
            row[i, 5] += fy
            row[j, 4] -= fx
            row[j, 5] -= fy
            virial[0, 0] += fx * dx
            virial[0, 1] += fx * dy
            virial[1, 1] += fy * dy
            if len(axes) == 3:
                fz = first * dz
                row[i, 6] += fz
                row[j, 6] -= fz
                virial[0, 2] += fx * dz
                virial[1, 2] += fy * dz
                virial[2, 2] += fz * dz
    virial[1, 0] = virial[0, 1]
    virial[2, 0] = virial[0, 2]
    virial[2, 1] = virial[1, 2]
    most = 0.0
    for i in range(row.shape[0]):
        most = max(most, row[i, 4] * row[i, 4] + row[i, 5] * row[i, 5] + row[i, 6] * row[i, 6])
    return Tally(energy, total, touching, math.sqrt(most), stiffness, virial)


@kernel
def evaluate_rows(effects, axes, row, space, pairs):
    """Return the totals at the positions in row, whose forces are left there, and the pair list."""
    pairs = travel(axes, row, space, pairs, np.inf)
    return evaluate(effects, axes, row, pairs), pairs


@device
def judge(total, touching, most, stiffness, space, goal):
    """Return how things stand: mean contact force `total / touching`, largest squared net force `most`."""
    if not (total < np.inf and most < np.inf):
        return NOT_FINITE
    floor = stiffness * space.resolution
    if total <= touching * max(floor, goal.force_floor):
        return UNJAMMED
    if math.sqrt(most) * touching <= goal.force_tolerance * total:
        return CONVERGED
    if math.sqrt(most) <= floor:
        return FLOOR
    return RUNNING


__all__ = ["PairList"]
