"""Touching ellipses and spheroids: the scale at which they touch, and its derivatives along displacements and turns.

s is the factor by which two shapes must be scaled to touch, |r| over the contact distance, so that they overlap where
s < 1. Coordinates of a pair are r from i to j and the turns of i and of j: one angle each in a plane, rotation vectors
in space. F = s^2 is stationary in the parameter l of the
contact function, so that first derivatives are those at fixed l, and second ones follow from the implicit function
theorem.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.contact_distance import height, pair_of, root, shape_of
from packmech.jit.compiled import device, inlined, kernel


class ScaledContacts(NamedTuple):
    """Scales of pairs, the parameters l, and derivatives of the scales; X coordinates, 4 in a plane and 9 in space."""

    scale_p: NDArray[np.float64]
    parameter_p: NDArray[np.float64]
    first_px: NDArray[np.float64]
    second_pxx: NDArray[np.float64]


@inlined
def solved(at, one, other, x, y, z):
    """Return C^-1 applied to a vector."""
    ai, bi, xi, yi, zi = one
    aj, bj, xj, yj, zj = other
    m = 1.0 - at
    p, q = m * (ai - bi) * (ai + bi), at * (aj - bj) * (aj + bj)
    base = m * bi * bi + at * bj * bj
    cosine = xi * xj + yi * yj + zi * zj
    ux, uy, uz = yi * zj - zi * yj, zi * xj - xi * zj, xi * yj - yi * xj
    determinant = base * (m * ai * ai + at * aj * aj) + p * q * (ux * ux + uy * uy + uz * uz)
    along_i, along_j = x * xi + y * yi + z * zi, x * xj + y * yj + z * zj
    over, inverse = 1.0 / determinant, 1.0 / base
    off_i = (p * (base + q) * along_i - p * q * cosine * along_j) * over
    off_j = (q * (base + p) * along_j - p * q * cosine * along_i) * over
    return (
        (x - off_i * xi - off_j * xj) * inverse,
        (y - off_i * yi - off_j * yj) * inverse,
        (z - off_i * zi - off_j * zj) * inverse,
    )


@device
def touch(x, y, z, one, other, d, guess):
    """Return the scale of a pair and l, with s derived by r, and by turns of i and of j about each axis."""
    pair = pair_of(x, y, z, one, other, d)
    return touch_of(pair, x, y, z, one, other, root(pair, 3, guess), d)


@inlined
def touch_of(pair, x, y, z, one, other, at, d):
    """Return what `touch` does, of a pair (`pair_of` r) whose parameter l is known."""
    # not by w, in which flat shapes lose digits
    s = math.sqrt(height(pair, at))
    m = 1.0 - at
    factor = at * m / s
    ai, bi, xi, yi, zi = one
    aj, bj, xj, yj, zj = other
    share_i, share_j = -m * (ai - bi) * (ai + bi), -at * (aj - bj) * (aj + bj)
    if d == 2:
        # in a plane C^-1 is linear in l but for the determinant: sums of positive terms along and across both axes
        over = 1.0 / (pair.e_first * m * m + pair.e_both * at * m + pair.e_second * at * at)
        along_i, across_i = m * bi * bi * (x * xi + y * yi), m * ai * ai * (y * xi - x * yi)
        along_j, across_j = at * bj * bj * (x * xj + y * yj), at * aj * aj * (y * xj - x * yj)
        wx = over * (along_i * xi - across_i * yi + along_j * xj - across_j * yj)
        wy = over * (along_i * yi + across_i * xi + along_j * yj + across_j * xj)
        gx, gy = factor * wx, factor * wy
        return (
            s, at, gx, gy, 0.0,
            0.0, 0.0, share_i * (xi * gx + yi * gy) * (xi * wy - yi * wx),
            0.0, 0.0, share_j * (xj * gx + yj * gy) * (xj * wy - yj * wx),
        )  # fmt: skip
    wx, wy, wz = solved(at, one, other, x, y, z)
    turn_i = factor * share_i * (xi * wx + yi * wy + zi * wz)
    turn_j = factor * share_j * (xj * wx + yj * wy + zj * wz)
    return (
        s, at, factor * wx, factor * wy, factor * wz,
        turn_i * (yi * wz - zi * wy), turn_i * (zi * wx - xi * wz), turn_i * (xi * wy - yi * wx),
        turn_j * (yj * wz - zj * wy), turn_j * (zj * wx - xj * wz), turn_j * (xj * wy - yj * wx),
    )  # fmt: skip


@device
def _curvature(x, y, z, one, other, at, d, turned, solved_turned, first, mixed, second):
    """Write the first derivatives of F, and the second ones at the largest F, by r and the turns of i and of j.

    With w = C^-1 r and p = e x mu, a turn about e changes A by (a^2 - b^2)(p mu^T + mu p^T).
    """
    m = 1.0 - at
    turns = 1 if d == 2 else 3
    wx, wy, wz = solved(at, one, other, x, y, z)
    w = (wx, wy, wz)
    ai, bi, xi, yi, zi = one
    aj, bj, xj, yj, zj = other
    ei, ej = (ai - bi) * (ai + bi), (aj - bj) * (aj + bj)
    along_i, along_j = xi * wx + yi * wy + zi * wz, xj * wx + yj * wy + zj * wz
    # (A_j - A_i) w and what C^-1 makes of it
    base = (bj - bi) * (bj + bi)
    cx = base * wx + ej * along_j * xj - ei * along_i * xi
    cy = base * wy + ej * along_j * yj - ei * along_i * yi
    cz = base * wz + ej * along_j * zj - ei * along_i * zi
    px, py, pz = solved(at, one, other, cx, cy, cz)
    pull = (px, py, pz)
    bend = (
        -2.0 * (x * wx + y * wy + z * wz)
        - 2.0 * (1.0 - 2.0 * at) * (wx * cx + wy * cy + wz * cz)
        + 2.0 * at * m * (cx * px + cy * py + cz * pz)
    )
    for a in range(d):
        first[a] = 2.0 * at * m * w[a]
        mixed[a] = 2.0 * (1.0 - 2.0 * at) * w[a] - 2.0 * at * m * pull[a]
        unit = (1.0 if a == 0 else 0.0, 1.0 if a == 1 else 0.0, 1.0 if a == 2 else 0.0)
        column = solved(at, one, other, unit[0], unit[1], unit[2])
        for b in range(d):
            second[b, a] = 2.0 * at * m * column[b]
    for t in range(2 * turns):
        side = t // turns
        axis = 2 if turns == 1 else t % 3
        e, along, weight = (ei, along_i, at * m * m) if side == 0 else (ej, along_j, at * at * m)
        steep = m * m - 2.0 * at * m if side == 0 else 2.0 * at * m - at * at
        director = (xi, yi, zi) if side == 0 else (xj, yj, zj)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        # the axis times the director: -director[v] along u, director[u] along v
        across = director[u] * w[v] - director[v] * w[u]
        for a in range(3):
            turned[t, a] = e * across * director[a]
        turned[t, u] -= e * along * director[v]
        turned[t, v] += e * along * director[u]
        gx, gy, gz = solved(at, one, other, turned[t, 0], turned[t, 1], turned[t, 2])
        solved_turned[t, 0], solved_turned[t, 1], solved_turned[t, 2] = gx, gy, gz
        change = 2.0 * e * along * across
        first[d + t] = -weight * change
        mixed[d + t] = -steep * change
        for a in range(3):
            mixed[d + t] += 2.0 * weight * turned[t, a] * pull[a]
        for a in range(d):
            second[a, d + t] = second[d + t, a] = -2.0 * weight * solved_turned[t, a]
        for k in range(t + 1):
            other_side = k // turns
            share = (m if side == 0 else at) * (m if other_side == 0 else at)
            value = 0.0
            for a in range(3):
                value += turned[t, a] * solved_turned[k, a]
            value *= 2.0 * at * m * share
            if side == other_side:
                own = 2 if turns == 1 else k % 3
                g, h = (own + 1) % 3, (own + 2) % 3
                other_across = director[g] * w[h] - director[h] * w[g]
                bent = 0.5 * (w[own] * director[axis] + w[axis] * director[own])
                if own == axis:
                    bent -= along
                value -= 2.0 * weight * e * (bent * along + across * other_across)
            second[d + t, d + k] = second[d + k, d + t] = value
    size = d + 2 * turns
    for a in range(size):
        for b in range(size):
            second[a, b] -= mixed[a] * mixed[b] / bend


@kernel
def _scales(vector_pd, radius_pk, aspect_pk, director_pkd, guess_p, second):
    """Return scales, parameters and derivatives."""
    count, d = vector_pd.shape
    size = 4 if d == 2 else 9
    scale, parameter = np.empty(count), np.empty(count)
    first_px = np.empty((count, size))
    second_pxx = np.empty((count if second else 0, size, size))
    turned, solved_turned, slopes, mixed = np.zeros((6, 3)), np.zeros((6, 3)), np.zeros(size), np.zeros(size)
    for p in range(count):
        x, y = vector_pd[p, 0], vector_pd[p, 1]
        z = vector_pd[p, 2] if d == 3 else 0.0
        one = shape_of(radius_pk[p, 0], aspect_pk[p, 0], director_pkd[p, 0], d)
        other = shape_of(radius_pk[p, 1], aspect_pk[p, 1], director_pkd[p, 1], d)
        s, at, gx, gy, gz, ix, iy, iz, jx, jy, jz = touch(x, y, z, one, other, d, guess_p[p])
        scale[p], parameter[p] = s, at
        if d == 2:
            first_px[p, 0], first_px[p, 1], first_px[p, 2], first_px[p, 3] = gx, gy, iz, jz
        else:
            first_px[p, 0], first_px[p, 1], first_px[p, 2] = gx, gy, gz
            first_px[p, 3], first_px[p, 4], first_px[p, 5] = ix, iy, iz
            first_px[p, 6], first_px[p, 7], first_px[p, 8] = jx, jy, jz
        if second:
            curved = second_pxx[p]
            _curvature(x, y, z, one, other, at, d, turned, solved_turned, slopes, mixed, curved)
            for a in range(size):
                for b in range(size):
                    curved[a, b] = curved[a, b] / (2.0 * s) - slopes[a] * slopes[b] / (4.0 * s * s * s)
    return scale, parameter, first_px, second_pxx


def scaled_contacts(
    vector_pd: NDArray[np.float64],
    radius_pk: NDArray[np.float64],
    aspect_pk: NDArray[np.float64],
    director_pkd: NDArray[np.float64],
    *,
    guess_p: NDArray[np.float64] | None = None,
    second: bool = False,
) -> ScaledContacts:
    """Return the scales at which pairs touch, with derivatives.

    Parameters
    ----------
    vector_pd, radius_pk, aspect_pk, director_pkd
        As in `contact_distance`; directors are unit vectors.
    guess_p
        (P,) parameters l to start from, those found last time; 0 or None: none.
    second
        Whether second derivatives are asked for.

    """
    guess = np.zeros(len(vector_pd)) if guess_p is None else guess_p
    return ScaledContacts(*_scales(vector_pd, radius_pk, aspect_pk, director_pkd, guess, second))
