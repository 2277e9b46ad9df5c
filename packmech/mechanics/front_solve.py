# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Solutions with a matrix that `factor_fronts` factored, all right-hand sides in one sweep, compiled."""

from __future__ import annotations

import numpy as np

from packmech.compiled import device, kernel
from packmech.mechanics.dense_fronts import KIND, LARGE, PLAIN, TURNED, matrix_product

# rows of a large front that are taken out one after the other, before a product takes out all of them
_BLOCK = 24


@device
def _take_row(rows, row, low, stop, factor, x):
    """Take a row, times one factor for each side, out of the sides' entries low..stop."""
    for m in range(0, x.shape[0], 3):
        a, b, c = factor[m], factor[m + 1], factor[m + 2]
        for j in range(low, stop):
            u = rows[row + j]
            x[m, j] -= a * u
            x[m + 1, j] -= b * u
            x[m + 2, j] -= c * u


@device
def _add_owed(rows, row, low, stop, x, owed):
    """Add the products of a row with the sides' entries low..stop."""
    for m in range(0, x.shape[0], 3):
        a0 = a1 = b0 = b1 = c0 = c1 = 0.0
        j = low
        while j + 1 < stop:
            u, v = rows[row + j], rows[row + j + 1]
            a0 += u * x[m, j]
            b0 += u * x[m + 1, j]
            c0 += u * x[m + 2, j]
            a1 += v * x[m, j + 1]
            b1 += v * x[m + 1, j + 1]
            c1 += v * x[m + 2, j + 1]
            j += 2
        if j < stop:
            u = rows[row + j]
            a0 += u * x[m, j]
            b0 += u * x[m + 1, j]
            c0 += u * x[m + 2, j]
        owed[m] += a0 + a1
        owed[m + 1] += b0 + b1
        owed[m + 2] += c0 + c1


@device
def _forward(rows, begin, n, count, paired, first_pair, ties, x, flat, reaction, factor, unit):
    """Solve with the lower factor of one node; x holds, then, the pivots' part over D, and what the rest owes.

    Coordinates that follow the others come with their g in `reaction`, and leave it in x, their load less h g in turn.
    """
    tie_start, tie_at, tie = ties
    sides, most = x.shape
    step = _BLOCK if n >= LARGE else max(count, 1)
    for first in range(0, count, step):
        last = min(first + step, count)
        stop = last if n >= LARGE else n
        for k in range(first, last):
            row = begin + k * n
            pivot = rows[row + k]
            if k < paired:
                for m in range(sides):
                    factor[m] = reaction[m, k]
                    left = x[m, k] - pivot * factor[m]
                    reaction[m, k] = left
                    for h in range(tie_start[first_pair + k], tie_start[first_pair + k + 1]):
                        x[m, tie_at[h]] -= tie[h] * left
            else:
                for m in range(sides):
                    factor[m] = x[m, k] / pivot
            _take_row(rows, row, k + 1, stop, factor, x)
            for m in range(sides):
                x[m, k] = factor[m]
        if stop < n:
            matrix_product(
                KIND, PLAIN, PLAIN, n - last, sides, last - first, unit.ctypes, rows[begin + first * n + last :].ctypes,
                n, flat[first:].ctypes, most, unit[1:].ctypes, flat[last:].ctypes, most,
            )  # fmt: skip


@device
def _backward(rows, begin, n, count, paired, first_pair, ties, x, flat, reaction, factor, unit, owed):
    """Solve with the upper factor of one node, the rest of x being known; `reaction` becomes that of the pairs."""
    tie_start, tie_at, tie = ties
    sides, most = x.shape
    step = _BLOCK if n >= LARGE else max(count, 1)
    for block in range((count + step - 1) // step - 1, -1, -1):
        first = block * step
        last = min(first + step, count)
        stop = last if n >= LARGE else n
        if stop < n:
            matrix_product(
                KIND, TURNED, PLAIN, last - first, sides, n - last, unit[1:].ctypes,
                rows[begin + first * n + last :].ctypes, n, flat[last:].ctypes, most, unit[2:].ctypes, owed.ctypes,
                _BLOCK,
            )  # fmt: skip
        for k in range(last - 1, first - 1, -1):
            row = begin + k * n
            for m in range(sides):
                factor[m] = owed[m * _BLOCK + k - first] if stop < n else 0.0
            _add_owed(rows, row, k + 1, stop, x, factor)
            pivot = rows[row + k]
            for m in range(sides):
                if k < paired:
                    tied = 0.0
                    for h in range(tie_start[first_pair + k], tie_start[first_pair + k + 1]):
                        tied += tie[h] * x[m, tie_at[h]]
                    reaction[m, k] += pivot * tied - factor[m]
                    x[m, k] -= tied
                else:
                    x[m, k] -= factor[m] / pivot


@kernel
def solve_fronts(fronts, right_sx):
    """Return the solutions of (s, N d + L) right-hand sides; each row is one, entries of pinned particles are left."""
    variables, variable_start, rows, row_start, pivots, pairs = fronts
    pair_start, pair_link, tie_start, tie_at, tie, share_start, share_at, share = pairs
    ties = (tie_start, tie_at, tie)
    out = right_sx.copy()
    given = out.shape[0]
    sides = (given + 2) // 3 * 3
    nodes = pivots.shape[0]
    links = out.shape[1] - pair_link.shape[0]
    most, most_pairs = 1, 1
    for t in range(nodes):
        most = max(most, variable_start[t + 1] - variable_start[t])
        most_pairs = max(most_pairs, pair_start[t + 1] - pair_start[t])
    flat = np.zeros(sides * most)
    x = flat.reshape((sides, most))
    reaction = np.zeros((sides, most_pairs))
    factor = np.empty(sides)
    unit = np.array([-1.0, 1.0, 0.0])
    owed = np.zeros(sides * _BLOCK)
    for step in range(2 * nodes):
        t = step if step < nodes else 2 * nodes - 1 - step
        low = variable_start[t]
        n = variable_start[t + 1] - low
        paired, first_pair = pair_start[t + 1] - pair_start[t], pair_start[t]
        for m in range(given):
            for k in range(n):
                x[m, k] = out[m, variables[low + k]]
        if step < nodes:
            for m in range(given):
                for k in range(paired):
                    total = 0.0
                    for h in range(share_start[first_pair + k], share_start[first_pair + k + 1]):
                        total += share[h] * out[m, links + pair_link[first_pair + share_at[h]]]
                    reaction[m, k] = total
            _forward(rows, row_start[t], n, pivots[t], paired, first_pair, ties, x, flat, reaction, factor, unit)
            for m in range(given):
                for k in range(paired):
                    out[m, links + pair_link[first_pair + k]] = reaction[m, k]
        else:
            for m in range(given):
                for k in range(paired):
                    reaction[m, k] = out[m, links + pair_link[first_pair + k]]
            _backward(rows, row_start[t], n, pivots[t], paired, first_pair, ties, x, flat, reaction, factor, unit, owed)
            for m in range(given):
                for k in range(paired):
                    out[m, links + pair_link[first_pair + k]] = 0.0
                for k in range(paired):
                    for h in range(share_start[first_pair + k], share_start[first_pair + k + 1]):
                        out[m, links + pair_link[first_pair + share_at[h]]] += share[h] * reaction[m, k]
        for m in range(given):
            for k in range(n if step < nodes else pivots[t]):
                out[m, variables[low + k]] = x[m, k]
    return out
