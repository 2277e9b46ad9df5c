# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Partial elimination of a dense symmetric matrix, its upper triangle stored by rows in a flat array, compiled."""

from __future__ import annotations

import numpy as np
import scipy.linalg  # noqa: F401  the BLAS behind it must be there when `single_thread` looks for what to limit
from numba import types

from packmech.compiled import device

# fronts from this size on leave most of their work to matrix products of blocks of this many rows, twice as many in
# broad fronts; so many rows are eliminated from each other before
LARGE = 64
_BLOCK = 32
_BROAD = 200
_INNER = 16
WIDE = 192

# BLAS's dgemm as numba's own `np.dot` calls it, but into a part of a matrix: C = alpha A B + beta C by columns
_NUMBER = types.CPointer(types.float64)
matrix_product = types.ExternalFunction(
    "numba_xxgemm",
    types.intc(
        types.char, types.char, types.char, types.intp, types.intp, types.intp,
        _NUMBER, _NUMBER, types.intp, _NUMBER, types.intp, _NUMBER, _NUMBER, types.intp,
    ),
)  # fmt: skip
KIND, PLAIN, TURNED = ord("d"), ord("n"), ord("t")


@device
def work_size(n):
    """Return how much working space elimination in an n x n front takes."""
    return WIDE * n + 2


@device
def _take_four(front, n, k, width, low, stop, panel):
    """Take the eliminated rows k..k + width, at most four, out of the rows low..stop, two at once."""
    for a in range(4):
        if a < width:
            for j in range(low, n):
                panel[a, j] = front[(k + a) * n + j]
        else:
            for j in range(low, n):
                panel[a, j] = 0.0
    d0 = 1.0 / front[k * n + k]
    d1 = 1.0 / front[(k + 1) * n + k + 1] if width > 1 else 0.0
    d2 = 1.0 / front[(k + 2) * n + k + 2] if width > 2 else 0.0
    d3 = 1.0 / front[(k + 3) * n + k + 3] if width > 3 else 0.0
    i = low
    while i + 1 < stop:
        a0, a1, a2, a3 = panel[0, i] * d0, panel[1, i] * d1, panel[2, i] * d2, panel[3, i] * d3
        b0, b1, b2, b3 = panel[0, i + 1] * d0, panel[1, i + 1] * d1, panel[2, i + 1] * d2, panel[3, i + 1] * d3
        row = i * n
        after = row + n
        for j in range(i, n):
            x0, x1, x2, x3 = panel[0, j], panel[1, j], panel[2, j], panel[3, j]
            front[row + j] -= (a0 * x0 + a1 * x1) + (a2 * x2 + a3 * x3)
            front[after + j] -= (b0 * x0 + b1 * x1) + (b2 * x2 + b3 * x3)
        i += 2
    if i < stop:
        a0, a1, a2, a3 = panel[0, i] * d0, panel[1, i] * d1, panel[2, i] * d2, panel[3, i] * d3
        row = i * n
        for j in range(i, n):
            front[row + j] -= (a0 * panel[0, j] + a1 * panel[1, j]) + (a2 * panel[2, j] + a3 * panel[3, j])


@device
def _eliminate_rows(front, n, begin, end, stop, panel):
    """Eliminate the rows begin..end of the upper triangle from each other and from those up to `stop`."""
    k = begin
    while k < end:
        width = min(4, end - k)
        for a in range(width):
            row = (k + a) * n
            inverse = 1.0 / front[row + k + a]
            for b in range(a + 1, width):
                share = front[row + k + b] * inverse
                target = (k + b) * n
                for j in range(k + b, n):
                    front[target + j] -= share * front[row + j]
        _take_four(front, n, k, width, k + width, stop, panel)
        k += width


@device
def _take_out(front, n, k, after, low, stop, work):
    """Take the eliminated rows k..after, at most WIDE, out of the rows low..stop, by products of blocks."""
    width = after - k
    many = stop - low
    work[0], work[1] = -1.0, 1.0
    scaled = work[2:]
    for a in range(width):
        row = (k + a) * n
        inverse = 1.0 / front[row + k + a]
        for j in range(many):
            scaled[a * many + j] = front[row + low + j] * inverse
    tall = _BLOCK if n - low < _BROAD else 2 * _BLOCK
    i = low
    while i < stop:
        high = min(tall, stop - i)
        # read by columns, as the product does, the rows are transposed: C^T -= U^T S
        matrix_product(
            KIND, PLAIN, TURNED, n - i, high, width, work.ctypes, front[k * n + i :].ctypes, n,
            scaled[i - low :].ctypes, many, work[1:].ctypes, front[i * n + i :].ctypes, n,
        )  # fmt: skip
        i += high


@device
def eliminate(front, n, begin, end, stop, panel, work):
    """Eliminate the rows begin..end of the upper triangle of an n x n front from each other and those up to `stop`.

    The rows keep those of U, with the pivots on the diagonal.
    """
    if n < LARGE:
        _eliminate_rows(front, n, begin, end, stop, panel)
        return
    k = begin
    while k < end:
        last = min(k + WIDE, end)
        inner = k
        while inner < last:
            after = min(inner + _INNER, last)
            _eliminate_rows(front, n, inner, after, after, panel)
            if after < last:
                _take_out(front, n, inner, after, after, last, work)
            inner = after
        if last < stop:
            _take_out(front, n, k, last, last, stop, work)
        k = last


@device
def finish(front, n, begin, count, low, panel, work):
    """Take the rows begin..count, all eliminated, out of the rows from `low` on."""
    if n >= LARGE:
        if low < n:
            for k in range(begin, count, WIDE):
                _take_out(front, n, k, min(k + WIDE, count), low, n, work)
        return
    for k in range(begin, count, 4):
        _take_four(front, n, k, min(4, count - k), low, n, panel)


@device
def firm_links(front, n, begin, count, bound, good, order):
    """Choose the order in which links are eliminated; return how many are firm enough (`bound`).

    They keep their places while their pivots are good; then the firmest goes first.
    """
    block = np.empty((count, count))
    for a in range(count):
        order[a] = a
        for b in range(a, count):
            block[a, b] = front[(begin + a) * n + begin + b]
            block[b, a] = block[a, b]
    for k in range(count):
        best, most = k, abs(block[k, k])
        if not most > good:
            for a in range(k + 1, count):
                if abs(block[a, a]) > most:
                    best, most = a, abs(block[a, a])
        if not most > bound:
            return k
        if best != k:
            order[k], order[best] = order[best], order[k]
            for a in range(count):
                block[k, a], block[best, a] = block[best, a], block[k, a]
            for a in range(count):
                block[a, k], block[a, best] = block[a, best], block[a, k]
        for a in range(k + 1, count):
            share = block[a, k] / block[k, k]
            for b in range(k + 1, count):
                block[a, b] -= share * block[k, b]
    return count


@device
def reorder(front, n, begin, count, order):
    """Exchange the links' rows and columns of the front."""
    copy = np.empty((count, n))
    for a in range(count):
        for b in range(count):
            low, high = min(a, b), max(a, b)
            copy[a, begin + b] = front[(begin + low) * n + begin + high]
        for j in range(begin + count, n):
            copy[a, j] = front[(begin + a) * n + j]
    for a in range(count):
        for b in range(a, count):
            front[(begin + a) * n + begin + b] = copy[order[a], begin + order[b]]
        for j in range(begin + count, n):
            front[(begin + a) * n + j] = copy[order[a], j]
    line = np.empty(count)
    for k in range(begin):
        for a in range(count):
            line[a] = front[k * n + begin + order[a]]
        for a in range(count):
            front[k * n + begin + a] = line[a]
