# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Solutions with a matrix that `factor_fronts` factored, three right-hand sides at once, compiled."""

from __future__ import annotations

import numpy as np

from packmech.compiled import device, kernel
from packmech.mechanics.dense_fronts import LARGE


@device
def _forward(rows, begin, n, count, x):
    """Solve with the lower factor of one node: x (n, 3) becomes the pivots' part over D, and what the rest owes."""
    large = n >= LARGE and n > count
    stop = count if large else n
    for k in range(count):
        row = begin + k * n
        inverse = 1.0 / rows[row + k]
        a, b, c = x[0, k] * inverse, x[1, k] * inverse, x[2, k] * inverse
        for j in range(k + 1, stop):
            u = rows[row + j]
            x[0, j] -= a * u
            x[1, j] -= b * u
            x[2, j] -= c * u
        x[0, k], x[1, k], x[2, k] = a, b, c
    if large:
        block = rows[begin : begin + count * n].reshape((count, n))
        owed = np.dot(np.ascontiguousarray(x[:, :count]), block)
        for m in range(3):
            for j in range(count, n):
                x[m, j] -= owed[m, j]


@device
def _backward(rows, begin, n, count, x):
    """Solve with the upper factor of one node, the rest of x (n, 3) being known."""
    large = n >= LARGE and n > count
    stop = count if large else n
    if large:
        block = rows[begin : begin + count * n].reshape((count, n))
        full = np.zeros((3, n))
        full[:, count:] = x[:, count:n]
        owed = np.dot(full, block.T)
        for m in range(3):
            for k in range(count):
                x[m, k] -= owed[m, k] / rows[begin + k * n + k]
    for k in range(count - 1, -1, -1):
        row = begin + k * n
        a0 = a1 = b0 = b1 = c0 = c1 = 0.0
        j = k + 1
        while j + 1 < stop:
            u, v = rows[row + j], rows[row + j + 1]
            a0 += u * x[0, j]
            b0 += u * x[1, j]
            c0 += u * x[2, j]
            a1 += v * x[0, j + 1]
            b1 += v * x[1, j + 1]
            c1 += v * x[2, j + 1]
            j += 2
        if j < stop:
            u = rows[row + j]
            a0 += u * x[0, j]
            b0 += u * x[1, j]
            c0 += u * x[2, j]
        inverse = 1.0 / rows[row + k]
        x[0, k] -= (a0 + a1) * inverse
        x[1, k] -= (b0 + b1) * inverse
        x[2, k] -= (c0 + c1) * inverse


@kernel
def solve_fronts(fronts, right_sx):
    """Return the solutions of (s, N d + L) right-hand sides; each row is one, entries of pinned particles are left."""
    variables, variable_start, rows, row_start, pivots = fronts
    out = right_sx.copy()
    sides = out.shape[0]
    nodes = pivots.shape[0]
    most = 0
    for t in range(nodes):
        most = max(most, variable_start[t + 1] - variable_start[t])
    x = np.zeros((3, most))
    for first in range(0, sides, 3):
        many = min(3, sides - first)
        for step in range(2 * nodes):
            t = step if step < nodes else 2 * nodes - 1 - step
            low = variable_start[t]
            n = variable_start[t + 1] - low
            for m in range(many):
                for k in range(n):
                    x[m, k] = out[first + m, variables[low + k]]
            if step < nodes:
                _forward(rows, row_start[t], n, pivots[t], x)
            else:
                _backward(rows, row_start[t], n, pivots[t], x)
            for m in range(many):
                for k in range(n if step < nodes else pivots[t]):
                    out[first + m, variables[low + k]] = x[m, k]
    return out
