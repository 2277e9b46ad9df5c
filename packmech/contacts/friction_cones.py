# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Whether forces within friction cones can balance on a particle: the convex hull of their wrenches holds zero, or not.

A contact of direction n (away from the particle) at the point a (from its center, over the radius) that pushes with a
unit normal force makes wrenches (F, a x F), F = T - n with |T| at most mu, across n. Forces of all contacts balance,
without being all zero, where zero is a mean of such wrenches. Wolfe's algorithm (Math. Program. 11, 128 (1976)) finds
the mean of smallest size, over segments in the plane and over discs in space, whose farthest point in a direction is
known: no cone is replaced by a pyramid. Either that mean gets as small as rounding, or the direction of it parts all
wrenches from zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import device

# unbalanced part of the normal forces that counts as none [1]
BALANCED = 1e-6
_ROUNDS = 1000
# smallest pivot and weight, over the largest
_ROUNDING = 1e-14


class FrictionCones(NamedTuple):
    """Coefficient of friction, and (C, d) vectors from center i to contacts, and from there to center j, over radii."""

    coefficient: float
    of_i_cd: NDArray[np.float64]
    of_j_cd: NDArray[np.float64]


@device
def _against(normal, point, k, x):
    """Return what a unit force at a contact does along x by its direction, and the part of that across the normal."""
    d = normal.shape[1]
    n0, n1, p0, p1 = normal[k, 0], normal[k, 1], point[k, 0], point[k, 1]
    if d == 2:
        g0, g1, g2 = x[0] - x[2] * p1, x[1] + x[2] * p0, 0.0
        along = g0 * n0 + g1 * n1
        return along, g0 - along * n0, g1 - along * n1, 0.0
    n2, p2 = normal[k, 2], point[k, 2]
    g0, g1, g2 = x[0] + x[4] * p2 - x[5] * p1, x[1] + x[5] * p0 - x[3] * p2, x[2] + x[3] * p1 - x[4] * p0
    along = g0 * n0 + g1 * n1 + g2 * n2
    return along, g0 - along * n0, g1 - along * n1, g2 - along * n2


@device
def _farthest(normal, point, count, mu, x, best):
    """Write the wrench that lies farthest against x; return its product with x."""
    d = normal.shape[1]
    p = x.shape[0]
    lowest = math.inf
    chosen = 0
    for k in range(count):
        along, g0, g1, g2 = _against(normal, point, k, x)
        value = -along - mu * math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
        if value < lowest:
            lowest = value
            chosen = k
    k = chosen
    _, g0, g1, g2 = _against(normal, point, k, x)
    size = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    scale = -mu / size if size > 0.0 else 0.0
    f0, f1, p0, p1 = scale * g0 - normal[k, 0], scale * g1 - normal[k, 1], point[k, 0], point[k, 1]
    best[0], best[1] = f0, f1
    if d == 2:
        best[2] = p0 * f1 - p1 * f0
    else:
        f2, p2 = scale * g2 - normal[k, 2], point[k, 2]
        best[2] = f2
        best[3], best[4], best[5] = p1 * f2 - p2 * f1, p2 * f0 - p0 * f2, p0 * f1 - p1 * f0
    total = 0.0
    for a in range(p):
        total += x[a] * best[a]
    return total


@device
def _nearest_weights(point, used, gram, weight):
    """Write the weights, of sum 1 and any sign, of the combination of the points that is nearest to zero."""
    p = point.shape[1]
    largest = 0.0
    for a in range(used):
        for b in range(a + 1):
            total = 1.0
            for c in range(p):
                total += point[a, c] * point[b, c]
            gram[a, b] = total
        largest = max(largest, gram[a, a])
    # Cholesky factors of the products plus one: positive definite for points in general position
    for a in range(used):
        for b in range(a + 1):
            total = gram[a, b]
            for c in range(b):
                total -= gram[a, c] * gram[b, c]
            gram[a, b] = math.sqrt(max(total, _ROUNDING * largest)) if a == b else total / gram[b, b]
    for a in range(used):
        total = 1.0
        for c in range(a):
            total -= gram[a, c] * weight[c]
        weight[a] = total / gram[a, a]
    whole = 0.0
    for back in range(used):
        a = used - 1 - back
        total = weight[a]
        for c in range(a + 1, used):
            total -= gram[c, a] * weight[c]
        weight[a] = total / gram[a, a]
        whole += weight[a]
    for a in range(used):
        weight[a] /= whole


@device
def can_balance(normal, at, count, mu):
    """Return whether forces in the friction cones of the first `count` contacts can balance without being all zero.

    `normal` (K, d) are directions away from the particle, `at` (K, d) where contacts are, from its center over its
    radius.
    """
    d = normal.shape[1]
    p = 3 if d == 2 else 6
    room = p + 2
    point, share, weight = np.zeros((room, p)), np.zeros(room), np.zeros(room)
    gram, x, best = np.zeros((room, room)), np.zeros(p), np.zeros(p)
    if count < 2:
        return False
    x[0] = 1.0
    _farthest(normal, at, 1, 0.0, x, best)
    point[0] = best
    x[:] = best
    share[0] = 1.0
    used = 1
    for _ in range(_ROUNDS):
        square = 0.0
        for a in range(p):
            square += x[a] * x[a]
        if square <= BALANCED * BALANCED:
            return True
        value = _farthest(normal, at, count, mu, x, best)
        # all wrenches lie beyond a plane across x
        if value > BALANCED * math.sqrt(square):
            return False
        if used == room:
            return True
        point[used] = best
        share[used] = 0.0
        used += 1
        while True:
            _nearest_weights(point, used, gram, weight)
            inside = True
            for a in range(used):
                inside = inside and weight[a] > _ROUNDING
            if inside:
                for a in range(used):
                    share[a] = weight[a]
                break
            # as far towards it as weights stay positive; then without what has none
            step = 1.0
            for a in range(used):
                if weight[a] <= _ROUNDING and share[a] - weight[a] > 0.0:
                    step = min(step, share[a] / (share[a] - weight[a]))
            kept = 0
            for a in range(used):
                left = share[a] + step * (weight[a] - share[a])
                if left > _ROUNDING:
                    share[kept] = left
                    point[kept] = point[a]
                    kept += 1
            if kept == used:
                break
            used = kept
        whole = 0.0
        for a in range(used):
            whole += share[a]
        for a in range(p):
            x[a] = 0.0
            for b in range(used):
                x[a] += share[b] / whole * point[b, a]
    # nothing parts the wrenches from zero
    return True
