"""Touching ellipses and spheroids: the scale at which they touch, and its derivatives along displacements and turns.

s is the factor by which two shapes must be scaled to touch, |r| over the contact distance, so that they overlap where
s < 1. Coordinates of a pair are r from i to j and the turns of i and of j: one angle each in a plane, rotation vectors
in space. Section 4 of the corrected specification of the third source: F = s^2 is stationary in the parameter l of the
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
from packmech.jit.compiled import device, kernel


class ScaledContacts(NamedTuple):
    """Scales of pairs, the parameters l, and derivatives of the scales; X coordinates, 4 in a plane and 9 in space."""

    scale_p: NDArray[np.float64]
    parameter_p: NDArray[np.float64]
    first_px: NDArray[np.float64]
    second_pxx: NDArray[np.float64]


@device
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
    off_i = (p * (base + q) * along_i - p * q * cosine * along_j) / determinant
    off_j = (q * (base + p) * along_j - p * q * cosine * along_i) / determinant
    return (
        (x - off_i * xi - off_j * xj) / base,
        (y - off_i * yi - off_j * yj) / base,
        (z - off_i * zi - off_j * zj) / base,
    )


@device
def touch(x, y, z, one, other, d, guess):
    """Return the scale of a pair and l, with s derived by r, and by turns of i and of j about each axis."""
    r = math.sqrt(x * x + y * y + z * z)
    pair = pair_of(x / r, y / r, z / r, one, other, d)
    at = root(pair, 3, guess)
    # not by w, in which flat shapes lose digits
    s = r * math.sqrt(height(pair, at))
    wx, wy, wz = solved(at, one, other, x, y, z)
    m = 1.0 - at
    factor = at * m / s
    ai, bi, xi, yi, zi = one
    aj, bj, xj, yj, zj = other
    turn_i = -factor * m * (ai - bi) * (ai + bi) * (xi * wx + yi * wy + zi * wz)
    turn_j = -factor * at * (aj - bj) * (aj + bj) * (xj * wx + yj * wy + zj * wz)
    return (
        s, at, factor * wx, factor * wy, factor * wz,
        turn_i * (yi * wz - zi * wy), turn_i * (zi * wx - xi * wz), turn_i * (xi * wy - yi * wx),
        turn_j * (yj * wz - zj * wy), turn_j * (zj * wx - xj * wz), turn_j * (xj * wy - yj * wx),
    )  # fmt: skip


@device
def near(x, y, z, one, other, d):
    """Return whether a pair may overlap: at no l in 0 to 1 is F larger than at the root, so that F >= 1 says no."""
    square = x * x + y * y + z * z
    r = math.sqrt(square)
    return square * height(pair_of(x / r, y / r, z / r, one, other, d), 0.5) < 1.0


@device
def _shape_matrix(one):
    """Return b^2 1 + (a^2 - b^2) mu mu^T."""
    a, b, x, y, z = one
    axis = np.array([x, y, z])
    return b * b * np.eye(3) + (a - b) * (a + b) * np.outer(axis, axis)


@device
def _generator(axis):
    """Return K with K v = e x v."""
    found = np.zeros((3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[j, i], found[i, j] = 1.0, -1.0
    return found


@device
def _curvature(x, y, z, one, other, at):
    """Return the (9, 9) second derivatives of F by r and by the turns of i and j, and the (9,) first ones."""
    m = 1.0 - at
    r = np.array([x, y, z])
    shape_i, shape_j = _shape_matrix(one), _shape_matrix(other)
    inverse = np.linalg.inv(m * shape_i + at * shape_j)
    w = inverse @ r
    change = shape_j - shape_i
    first, mixed, second = np.zeros(9), np.zeros(9), np.zeros((9, 9))
    # of l: F_l = 0 here
    pull = inverse @ (change @ w)
    bend = -2.0 * (r @ w) - 2.0 * (1.0 - 2.0 * at) * (w @ (change @ w)) + 2.0 * at * m * ((change @ w) @ pull)
    first[:3] = 2.0 * at * m * w
    mixed[:3] = 2.0 * (1.0 - 2.0 * at) * w - 2.0 * at * m * pull
    second[:3, :3] = 2.0 * at * m * inverse
    turned = np.zeros((6, 3))
    weight = np.array([at * m * m, at * at * m])
    steep = np.array([m * m - 2.0 * at * m, 2.0 * at * m - at * at])
    share = np.array([m, at])
    for t in range(6):
        k = t // 3
        shape = shape_i if k == 0 else shape_j
        turn = _generator(t % 3)
        rate = turn @ shape - shape @ turn
        turned[t] = rate @ w
        first[3 + t] = -weight[k] * (w @ turned[t])
        mixed[3 + t] = -steep[k] * (w @ turned[t]) + 2.0 * weight[k] * (turned[t] @ pull)
        second[3 + t, :3] = -2.0 * weight[k] * (inverse @ turned[t])
        second[:3, 3 + t] = second[3 + t, :3]
    for t in range(6):
        for u in range(6):
            k, n = t // 3, u // 3
            value = 2.0 * at * m * share[k] * share[n] * (turned[t] @ (inverse @ turned[u]))
            if k == n:
                shape = shape_i if k == 0 else shape_j
                one_turn, other_turn = _generator(t % 3), _generator(u % 3)
                inner = other_turn @ shape - shape @ other_turn
                outer = one_turn @ shape - shape @ one_turn
                twice = one_turn @ inner - inner @ one_turn + other_turn @ outer - outer @ other_turn
                value -= 0.5 * weight[k] * (w @ (twice @ w))
            second[3 + t, 3 + u] = value
    return second - np.outer(mixed, mixed) / bend, first


@kernel
def _scales(vector_pd, radius_pk, aspect_pk, director_pkd, guess_p, kept, second):
    """Return scales, parameters and derivatives in the kept coordinates of nine."""
    count, d = vector_pd.shape
    size = kept.shape[0]
    scale, parameter = np.empty(count), np.empty(count)
    first_px = np.empty((count, size))
    second_pxx = np.empty((count if second else 0, size, size))
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
            curved, slopes = _curvature(x, y, z, one, other, at)
            for a in range(size):
                for b in range(size):
                    steep = slopes[kept[a]] * slopes[kept[b]] / (4.0 * s * s * s)
                    second_pxx[p, a, b] = curved[kept[a], kept[b]] / (2.0 * s) - steep
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
    count, d = vector_pd.shape
    kept = np.array([0, 1, 5, 8]) if d == 2 else np.arange(9)
    guess = np.zeros(count) if guess_p is None else guess_p
    return ScaledContacts(*_scales(vector_pd, radius_pk, aspect_pk, director_pkd, guess, kept, second))
