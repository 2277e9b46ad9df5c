# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Products of links' gradients factored in their envelope: little to do for chains and rings, compiled.

Along a chain each link meets the one before and the one after, so that the triangular factor has a number or two in a
row. Where clusters are wide the envelope holds much more than a sparse factor would, and the answer is to take that.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import kernel
from packmech.contacts import Contacts
from packmech.measure.link_order import link_envelope, link_order

# multiplications for each link, in the mean, above which a sparse factor is the better one
_MOST = 200.0


@kernel
def _factor(i_l, j_l, normal_ld, particles, nudge, most):
    """Return (whether all is well, smallest pivot, the factor): Cholesky's by rows, its diagonal inverted apart."""
    count, d = normal_ld.shape
    order = link_order(i_l, j_l, particles)
    i_r, j_r = i_l[order], j_l[order]
    pairs, rows, _ = link_envelope(i_r, j_r, particles)
    row, column, _, slot, sign = pairs
    first, start, _, _ = rows
    work = 0.0
    for r in range(count):
        work += (r - first[r]) ** 2
    if work > most * count:
        return False, 0.0, (order, first, start, np.empty(0), np.empty(0))
    factor, inverse = np.zeros(start[count]), np.empty(count)
    for e in range(row.shape[0]):
        product = 0.0
        for a in range(d):
            product += normal_ld[order[row[e]], a] * normal_ld[order[column[e]], a]
        factor[slot[e]] += sign[e] * product
    smallest = np.inf
    for r in range(count):
        own = start[r] - first[r]
        rest = nudge + (2.0 if i_r[r] != j_r[r] else 0.0)
        for c in range(first[r], r):
            other = start[c] - first[c]
            value = factor[own + c]
            for k in range(max(first[r], first[c]), c):
                value -= factor[own + k] * factor[other + k]
            value *= inverse[c]
            factor[own + c] = value
            rest -= value * value
        if not rest > 0.0:
            return True, 0.0, (order, first, start, factor, inverse)
        smallest = min(smallest, rest)
        inverse[r] = 1.0 / np.sqrt(rest)
    return True, smallest, (order, first, start, factor, inverse)


@kernel
def _solved(system, right_l):
    """Return the solution for one right-hand side, in the links' own order."""
    order, first, start, factor, inverse = system
    count = order.shape[0]
    value, out = np.empty(count), np.empty(count)
    for r in range(count):
        own = start[r] - first[r]
        rest = right_l[order[r]]
        for c in range(first[r], r):
            rest -= factor[own + c] * value[c]
        value[r] = rest * inverse[r]
    for r in range(count - 1, -1, -1):
        own = start[r] - first[r]
        found = value[r] * inverse[r]
        for c in range(first[r], r):
            value[c] -= factor[own + c] * found
        out[order[r]] = found
    return out


def band_solver(
    pairs: Contacts, nudge: float, smallest: float
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
    """Return a function that solves with the products of the links' gradients, `nudge` on the diagonal added.

    None where the envelope is wide or a pivot is below the smallest that is allowed.
    """
    narrow, pivot, system = _factor(pairs.i_c, pairs.j_c, pairs.normal_cd, pairs.particles, nudge, _MOST)
    if not narrow or pivot < smallest:
        return None

    def solve(right_l: NDArray[np.float64]) -> NDArray[np.float64]:
        found: NDArray[np.float64] = _solved(system, right_l)
        return found

    return solve
