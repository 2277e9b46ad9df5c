"""How near two ellipses or spheroids come before they touch, by the contact function of Perram and Wertheim (1985).

Two ellipsoids with A = b^2 1 + (a^2 - b^2) mu mu^T (a along the axis mu, b across it) whose centers are r apart touch
when scaled by s, with s^2 the largest F(l) = l (1 - l) r C^-1 r for 0 < l < 1 and C = (1 - l) A_i + l A_j. F has one
maximum. The contact distance along n is sigma = |r| / s. The levels are those of section 3 of Schreck and O'Hern
(2010), whose polynomials, misprints corrected, are written here with positive terms only, so that flat shapes lose no
digits.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import clear_errors, finite_array, one_of, positive_array
from packmech.jit.compiled import device, inlined, kernel

# from the roughest: half way, one Newton step of the stationarity condition from there, one of second order, its root
LEVELS = ("gaussian", "linear", "quadratic", "exact")
# a step this small, over the distance to the nearer end, is the last: convergence is cubic
_LAST = 1e-6
_STEPS = 100


class Pair(NamedTuple):
    """What F depends on: coefficients of l (1 - l) B / (b E) on (1 - l, l), |r|^2 left out.

    E is the determinant of C over that of the part across both axes; in a plane b is 1 and B linear, else b is that
    part and B quadratic.
    """

    b_first: float
    b_second: float
    b_both: float
    e_first: float
    e_second: float
    e_both: float
    across_i: float
    across_j: float


@inlined
def flat_pair(ai, bi, aj, bj, cross_i, dot_i, cross_j, dot_j, cross):
    """Return the pair in a plane, by squares of semi-axes and of sines and cosines of n, and of the axes, with axes."""
    first = bi * dot_i + ai * cross_i
    second = bj * dot_j + aj * cross_j
    both = (1.0 - cross) * (bi * aj + bj * ai) + cross * (ai * aj + bi * bj)
    return Pair(first, second, 0.0, ai * bi, aj * bj, both, 0.0, 0.0)


@device
def solid_pair(ai, bi, aj, bj, cross_i, dot_i, cross_j, dot_j, cross, triple):
    """Return the pair in space, `triple` the square of n . (mu_i x mu_j)."""
    first = bi * dot_i + ai * cross_i
    second = bj * dot_j + aj * cross_j
    both = (1.0 - cross) * (bi * aj + bj * ai) + cross * (ai * aj + bi * bj)
    mixed = bi * second + bj * first + (ai - bi) * (aj - bj) * triple
    return Pair(bi * first, bj * second, mixed, ai * bi, aj * bj, both, bi, bj)


@device
def parts(pair, at):
    """Return numerator and denominator of F / |r|^2 at l, with three and three derivatives."""
    m = 1.0 - at
    a0, a1, a2 = at * m, m - at, -2.0
    e0 = pair.e_first * m * m + pair.e_both * at * m + pair.e_second * at * at
    e1 = -2.0 * pair.e_first * m + pair.e_both * a1 + 2.0 * pair.e_second * at
    e2 = 2.0 * (pair.e_first - pair.e_both + pair.e_second)
    if pair.across_i == 0.0:
        b0, b1 = pair.b_first * m + pair.b_second * at, pair.b_second - pair.b_first
        return a0 * b0, a1 * b0 + a0 * b1, a2 * b0 + 2.0 * a1 * b1, 3.0 * a2 * b1, e0, e1, e2, 0.0
    b0 = pair.b_first * m * m + pair.b_both * at * m + pair.b_second * at * at
    b1 = -2.0 * pair.b_first * m + pair.b_both * a1 + 2.0 * pair.b_second * at
    b2 = 2.0 * (pair.b_first - pair.b_both + pair.b_second)
    c0, c1 = pair.across_i * m + pair.across_j * at, pair.across_j - pair.across_i
    return (
        a0 * b0,
        a1 * b0 + a0 * b1,
        a2 * b0 + 2.0 * a1 * b1 + a0 * b2,
        3.0 * (a2 * b1 + a1 * b2),
        c0 * e0,
        c1 * e0 + c0 * e1,
        2.0 * c1 * e1 + c0 * e2,
        3.0 * c1 * e2,
    )


@inlined
def flat_slope(pair, at):
    """Return the same in a plane: c0 m^4 + c1 m^3 l + ... + c4 l^4 with m = 1 - l, whose signs change once."""
    first, second = pair.b_first, pair.b_second
    c0, c1 = first * pair.e_first, 2.0 * second * pair.e_first
    c2 = second * (pair.e_first + pair.e_both) - first * (pair.e_both + pair.e_second)
    c3, c4 = -2.0 * first * pair.e_second, -second * pair.e_second
    d0, d1, d2, d3 = c1 - 4.0 * c0, 2.0 * c2 - 3.0 * c1, 3.0 * c3 - 2.0 * c2, 4.0 * c4 - c3
    m = 1.0 - at
    mm, ml, ll = m * m, m * at, at * at
    return (
        mm * (c0 * mm + c1 * ml + c2 * ll) + ll * (c3 * ml + c4 * ll),
        mm * (d0 * m + d1 * at) + ll * (d2 * m + d3 * at),
        (d1 - 3.0 * d0) * mm + 2.0 * (d2 - d1) * ml + (3.0 * d3 - d2) * ll,
    )


@inlined
def slope(pair, at):
    """Return the stationarity condition at l, positive below its root and negative above, and two derivatives."""
    if pair.across_i == 0.0:
        return flat_slope(pair, at)
    p0, p1, p2, p3, q0, q1, q2, q3 = parts(pair, at)
    return p1 * q0 - p0 * q1, p2 * q0 - p0 * q2, p3 * q0 + p2 * q1 - p1 * q2 - p0 * q3


@inlined
def rough_root(pair, level):
    """Return l of a level below the exact one; outside of 0 to 1 where its step leads there."""
    if level == 0:
        return 0.5
    f0, f1, f2 = slope(pair, 0.5)
    if level == 1:
        return 0.5 - f0 / f1
    inside = f1 * f1 - 2.0 * f0 * f2
    return 0.5 + 2.0 * f0 / (-f1 + math.sqrt(max(inside, 0.0)))


@inlined
def exact_root(pair, guess):
    """Return l at the largest F: Halley's steps, or halving where these leave what brackets the root."""
    low, high = 0.0, 1.0
    at = guess if 0.0 < guess < 1.0 else 0.5
    for _ in range(_STEPS):
        f0, f1, f2 = slope(pair, at)
        if f0 > 0.0:
            low = at
        elif f0 < 0.0:
            high = at
        else:
            return at
        below = 2.0 * f1 * f1 - f0 * f2
        step = -2.0 * f0 * f1 / below if f1 < 0.0 and below > 0.0 else 2.0
        if abs(step) < _LAST * min(at, 1.0 - at):
            return at + step
        at = at + step if low < at + step < high else 0.5 * (low + high)
        if high - low <= 4e-16 * high:
            return at
    return at


@device
def root(pair, level, guess):
    """Return l at a level; the exact one begins with the guess, or where that is none half way."""
    return rough_root(pair, level) if level < 3 else exact_root(pair, guess)


@inlined
def height(pair, at):
    """Return F / |r|^2 at l; 0 outside of 0 to 1, where nothing is known of contact."""
    if not 0.0 < at < 1.0:
        return 0.0
    m = 1.0 - at
    ml = at * m
    e0 = pair.e_first * m * m + pair.e_both * ml + pair.e_second * at * at
    if pair.across_i == 0.0:
        return ml * (pair.b_first * m + pair.b_second * at) / e0
    b0 = pair.b_first * m * m + pair.b_both * ml + pair.b_second * at * at
    return ml * b0 / ((pair.across_i * m + pair.across_j * at) * e0)


@device
def semi_axes(radius, aspect, d):
    """Return a and b of the ellipse or spheroid with the area or volume of a disc or sphere of this radius."""
    if d == 2:
        b = radius / math.sqrt(aspect)
    else:
        b = radius / aspect ** (1.0 / 3.0)
    return aspect * b, b


@inlined
def pair_of(nx, ny, nz, one, other, d):
    """Return the pair of two shapes (a, b, x, y, z of the axis) that are apart along n; `height` is F where n is r."""
    ai, bi, xi, yi, zi = one
    aj, bj, xj, yj, zj = other
    dot_i, dot_j = nx * xi + ny * yi + nz * zi, nx * xj + ny * yj + nz * zj
    if d == 2:
        cross_i, cross_j, cross = nx * yi - ny * xi, nx * yj - ny * xj, xi * yj - yi * xj
        return flat_pair(
            ai * ai, bi * bi, aj * aj, bj * bj, cross_i**2, dot_i**2, cross_j**2, dot_j**2, cross**2
        )  # fmt: skip
    ux, uy, uz = yi * zj - zi * yj, zi * xj - xi * zj, xi * yj - yi * xj
    across_i = (ny * zi - nz * yi) ** 2 + (nz * xi - nx * zi) ** 2 + (nx * yi - ny * xi) ** 2
    across_j = (ny * zj - nz * yj) ** 2 + (nz * xj - nx * zj) ** 2 + (nx * yj - ny * xj) ** 2
    triple = nx * ux + ny * uy + nz * uz
    return solid_pair(
        ai * ai, bi * bi, aj * aj, bj * bj, across_i, dot_i**2, across_j, dot_j**2,
        ux * ux + uy * uy + uz * uz, triple * triple,
    )  # fmt: skip


@device
def shape_of(radius, aspect, director, d):
    """Return a and b and the axis of a particle."""
    a, b = semi_axes(radius, aspect, d)
    return a, b, director[0], director[1], director[2] if d == 3 else 0.0


@kernel
def distances(normal_pd, radius_pk, aspect_pk, director_pkd, level):
    """Return contact distances of pairs along their normals; infinite where a level finds none."""
    count, d = normal_pd.shape
    out = np.empty(count)
    for p in range(count):
        nz = normal_pd[p, 2] if d == 3 else 0.0
        one = shape_of(radius_pk[p, 0], aspect_pk[p, 0], director_pkd[p, 0], d)
        other = shape_of(radius_pk[p, 1], aspect_pk[p, 1], director_pkd[p, 1], d)
        pair = pair_of(normal_pd[p, 0], normal_pd[p, 1], nz, one, other, d)
        h = height(pair, root(pair, level, 0.0))
        out[p] = 1.0 / math.sqrt(h) if h > 0.0 else math.inf
    return out


@clear_errors
def contact_distance(
    vector_cd: ArrayLike,
    semi_axes_i_ck: ArrayLike,
    director_i_cd: ArrayLike,
    semi_axes_j_ck: ArrayLike,
    director_j_cd: ArrayLike,
    *,
    level: str = "exact",
) -> NDArray[np.float64]:
    """Return the distances at which pairs of ellipses or spheroids touch when they approach along given directions.

    Perram and Wertheim, J. Comput. Phys. 58, 409 (1985), with the levels of Schreck and O'Hern (2010): "gaussian" takes
    the middle of the range of the parameter, "linear" and "quadratic" the root of its stationarity condition expanded
    there to first and second order, "exact" the root by Halley's method, safeguarded. Rough levels overestimate: they
    are for measuring what they cost. Their forces are no gradients of their energies, so that minimizing on them
    stalls.

    Parameters
    ----------
    vector_cd
        (C, d) vectors from the first to the second particle, in two or three dimensions, of any length [length].
    semi_axes_i_ck, semi_axes_j_ck
        (C, 2) semi-axes of the first and of the second particles, along their directors and across them [length].
    director_i_cd, director_j_cd
        (C, d) their directors, of any length.
    level
        "gaussian", "linear", "quadratic" or "exact".

    Returns
    -------
    ndarray
        (C,) distances [length]; infinite where the linear or quadratic level finds no contact.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or a vector or director has no direction.

    Examples
    --------
    >>> import packmech as pm
    >>> along, across = [[1.0, 0.0]], [[0.0, 1.0]]
    >>> pm.contact_distance([[3.0, 0.0]], [[1.0, 0.25]], along, [[1.0, 0.25]], across).tolist()
    [1.25]

    """
    number = LEVELS.index(one_of("level", level, LEVELS))
    vector = finite_array("vector_cd", vector_cd, shape=(None, None), what="pair")
    count, d = vector.shape
    if d not in (2, 3):
        raise ValueError(f"vector_cd must have shape (C, 2) or (C, 3), got {vector.shape}")
    semi = [
        positive_array(name, given, shape=(count, 2), what="pair")
        for name, given in (("semi_axes_i_ck", semi_axes_i_ck), ("semi_axes_j_ck", semi_axes_j_ck))
    ]
    director_i = finite_array("director_i_cd", director_i_cd, shape=(count, d), what="pair")
    director_j = finite_array("director_j_cd", director_j_cd, shape=(count, d), what="pair")
    ways = {"vector_cd": vector, "director_i_cd": director_i, "director_j_cd": director_j}
    normal, *director = (unit_rows(name, one) for name, one in ways.items())
    # sizes of order one: products of eight of them must neither overflow nor vanish
    unit = np.maximum(semi[0].max(axis=1), semi[1].max(axis=1))
    along, across = (np.stack([one[:, k] / unit for one in semi], axis=1) for k in (0, 1))
    aspect = along / across
    found: Any = distances(normal, across * aspect ** (1.0 / d), aspect, np.stack(director, axis=1), number)
    return np.asarray(unit * found)


def unit_rows(name: str, given_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows with unit length, by the largest component first, so that any unit of length has a direction."""
    largest = np.abs(given_cd).max(axis=1, keepdims=True)
    if (largest == 0.0).any():
        raise ValueError(f"{name} must have a direction, got zeros for pair {int(np.argmin(largest))}")
    scaled = given_cd / largest
    return np.asarray(scaled / np.sqrt((scaled**2).sum(axis=1, keepdims=True)))
