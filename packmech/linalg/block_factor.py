"""Factorization A = L D L^T of sparse symmetric matrices by blocks, one block for two particles that are coupled.

All coordinates of a particle are coupled to the same others, so that the order of elimination and the places of the
entries are found particle by particle, and the numbers computed block by block: for pairs of discs that is a quarter of
the places. No pivots are chosen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import kernel

# block sizes that are looked for, the largest first: coordinates of spheres or of discs that turn, and of discs
_SIZES = (3, 2)


class Plan(NamedTuple):
    """What the places of the entries alone decide.

    `size` is that of the blocks, `column_k` and `start` are the block columns of each block row; `order` the rows by
    elimination, `place` the place of each in it; `parent` the first row below each column of L, and `begin` where the
    blocks of each column begin.
    """

    size: int
    column_k: NDArray[np.int32]
    start: NDArray[np.int32]
    order: NDArray[np.int64]
    place: NDArray[np.int64]
    parent: NDArray[np.int64]
    begin: NDArray[np.int64]

    def fits(self, size: int, index: NDArray[np.int32], start: NDArray[np.int32]) -> bool:
        """Return whether it is that of a matrix made of blocks of this size, with entries at these places."""
        if size != self.size:
            return False
        found = _block_places(size, index, start)
        return np.array_equal(found[0], self.column_k) and np.array_equal(found[1], self.start)


class BlockFactors(NamedTuple):
    """The unit lower factor L, column by column: blocks below the diagonal, their rows, own blocks; and the pivots."""

    lower_kqq: NDArray[np.float64]
    row_k: NDArray[np.int32]
    own_nqq: NDArray[np.float64]
    pivot_nq: NDArray[np.float64]


@kernel
def _is_made_of(size, index, start):  # type: ignore[no-untyped-def]
    """Return whether a matrix is made of full square blocks of this size, each with its mirror image, in order."""
    rows = start.shape[0] - 1
    if rows % size:
        return False
    for row in range(rows):
        for k in range(start[row] + 1, start[row + 1]):
            # no entry stands twice
            if index[k] <= index[k - 1]:
                return False
    mirror = start[::size].copy()
    for row in range(0, rows, size):
        length = start[row + 1] - start[row]
        for k in range(length):
            column = index[start[row] + k]
            if k % size:
                if column != index[start[row] + k - 1] + 1:
                    return False
                continue
            if column % size:
                return False
            # rows that come in order meet the entries of the mirror image in order
            at = mirror[column // size]
            if at >= start[column + 1] or index[at] != row:
                return False
            mirror[column // size] = at + size
        for other in range(row + 1, row + size):
            if start[other + 1] - start[other] != length:
                return False
            for k in range(length):
                if index[start[other] + k] != index[start[row] + k]:
                    return False
    return True


def block_size(index: NDArray[np.int32], start: NDArray[np.int32]) -> int:
    """Return the size of the blocks that a matrix is made of, 1 without such; 0 where mirror images are missing.

    Examples
    --------
    >>> block_size(np.array([0, 1, 0, 1], np.int32), np.array([0, 2, 4], np.int32))
    2

    """
    return next((size for size in (*_SIZES, 1) if _is_made_of(size, index, start)), 0)


@kernel
def _minimum_degree(index, start):  # type: ignore[no-untyped-def]
    """Return an order of elimination that takes a row with few neighbors next (Amestoy, Davis and Duff, 1996).

    Rows that were neighbors of an eliminated one are neighbors of each other: such a set is kept as one element. The
    neighbors of a row are the rows in its list and in its elements; sums over elements that overlap bound their number.
    """
    rows = start.shape[0] - 1
    # of each row first its neighbors, then its elements: each new element replaces at least one of either
    near, middle, last = index.copy(), np.empty(rows, np.int64), np.empty(rows, np.int64)
    for row in range(rows):
        to = np.int64(start[row])
        for k in range(start[row], start[row + 1]):
            if index[k] != row:
                near[to] = index[k]
                to += 1
        middle[row] = last[row] = to
    # rows of equal degree are linked in lists
    degree = middle - start[:-1]
    head, after, before = np.full(rows + 1, -1), np.full(rows, -1), np.full(rows, -1)
    for row in range(rows - 1, -1, -1):
        after[row] = head[degree[row]]
        if after[row] >= 0:
            before[after[row]] = row
        head[degree[row]] = row
    member = np.empty(4 * index.shape[0] + rows, np.int64)
    first, count = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
    mark, seen, outside = np.full(rows, -1), np.full(rows, -1), np.zeros(rows, np.int64)
    order = np.empty(rows, np.int64)
    used = least = 0
    for step in range(rows):
        while head[least] < 0:
            least += 1
        pivot = head[least]
        head[least] = after[pivot]
        if after[pivot] >= 0:
            before[after[pivot]] = -1
        order[step] = pivot
        if used + rows > member.shape[0]:
            longer = np.empty(2 * member.shape[0] + rows, np.int64)
            longer[:used] = member[:used]
            member = longer
        mark[pivot], first[pivot] = pivot, used
        for k in range(start[pivot], middle[pivot]):
            mark[near[k]] = pivot
            member[used] = near[k]
            used += 1
        for k in range(middle[pivot], last[pivot]):
            element = near[k]
            for m in range(first[element], first[element] + count[element]):
                if mark[member[m]] != pivot:
                    mark[member[m]] = pivot
                    member[used] = member[m]
                    used += 1
            # what it joined the new element joins
            count[element] = 0
        size = used - first[pivot]
        count[pivot] = size
        # how many rows of each element are not in the new one
        for m in range(first[pivot], used):
            for k in range(middle[member[m]], last[member[m]]):
                element = near[k]
                if seen[element] != pivot:
                    seen[element], outside[element] = pivot, count[element]
                outside[element] -= 1
        for m in range(first[pivot], used):
            row = member[m]
            if before[row] >= 0:
                after[before[row]] = after[row]
            else:
                head[degree[row]] = after[row]
            if after[row] >= 0:
                before[after[row]] = before[row]
            to = np.int64(start[row])
            for k in range(start[row], middle[row]):
                if mark[near[k]] != pivot:
                    near[to] = near[k]
                    to += 1
            now = size - 1 + to - start[row]
            elements, middle[row] = middle[row], to
            for k in range(elements, last[row]):
                element = near[k]
                if count[element] > 0 and outside[element] > 0:
                    near[to] = element
                    to += 1
                    now += outside[element]
            near[to] = pivot
            last[row] = to + 1
            now = min(now, degree[row] + size - 1, rows - step - 2)
            degree[row], before[row], after[row] = now, -1, head[now]
            if head[now] >= 0:
                before[head[now]] = row
            head[now] = row
            least = min(least, now)
    return order


@kernel
def _places(order, index, start):  # type: ignore[no-untyped-def]
    """Return the place of each row in the order, and the parent and the beginning of each column of L."""
    rows = order.shape[0]
    place, parent, mark = np.empty(rows, np.int64), np.full(rows, -1), np.full(rows, -1)
    place[order] = np.arange(rows)
    begin = np.zeros(rows + 1, np.int64)
    for k in range(rows):
        mark[k] = k
        for p in range(start[order[k]], start[order[k] + 1]):
            column = place[index[p]]
            while column < k and mark[column] != k:
                if parent[column] < 0:
                    parent[column] = k
                begin[column + 1] += 1
                mark[column] = k
                column = parent[column]
    return place, parent, np.cumsum(begin)


@kernel
def _block_places(size, index, start):  # type: ignore[no-untyped-def]
    """Return the block columns of each block row, and where these begin."""
    begin = start[::size] // size**2
    column = np.empty(begin[-1], np.int32)
    for row in range(begin.shape[0] - 1):
        for k in range(begin[row + 1] - begin[row]):
            column[begin[row] + k] = index[start[row * size] + k * size] // size
    return column, begin


def plan(size: int, index: NDArray[np.int32], start: NDArray[np.int32]) -> Plan:
    """Return what the places of the entries decide, for a matrix that is made of blocks of a size."""
    return plan_blocks(size, *_block_places(size, index, start))


def plan_blocks(size: int, column_k: NDArray[np.int32], start: NDArray[np.int32]) -> Plan:
    """Return the same from the places of the blocks, those of each row in order."""
    order = _minimum_degree(column_k, start)
    return Plan(size, column_k, start, order, *_places(order, column_k, start))


@kernel
def _factor(axes, data, index, start, order, place, parent, begin):  # type: ignore[no-untyped-def]
    """Return L and D row by row (Davis, 2005: each row by a triangular solve), and whether no pivot vanished."""
    # a length that the compiler knows: it writes out the loops over blocks
    size = len(axes)
    rows = order.shape[0]
    lower, row = np.empty((begin[-1], size, size)), np.empty(begin[-1], np.int32)
    own, pivot = np.zeros((rows, size, size)), np.empty((rows, size))
    work, part = np.zeros((rows, size, size)), np.empty((size, size))
    end, mark = begin[:-1].copy(), np.full(rows, -1)
    chain, reached = np.empty(rows, np.int64), np.empty(rows, np.int64)
    for k in range(rows):
        # the columns that this row reaches, each after those that it depends on
        mark[k], top = k, rows
        from_row = start[order[k]]
        length = start[order[k] + 1] - from_row
        for slot in range(length):
            column = place[index[from_row + slot]]
            if column > k:
                continue
            at = size * (size * from_row + slot)
            for a in range(size):
                for b in range(size):
                    if column == k:
                        own[k, a, b] = data[at + b]
                    else:
                        work[column, b, a] = data[at + b]
                at += size * length
            count = 0
            while mark[column] != k:
                chain[count], mark[column] = column, k
                column = parent[column]
                count += 1
            while count > 0:
                count -= 1
                top -= 1
                reached[top] = chain[count]
        for m in range(top, rows):
            column = reached[m]
            for a in range(size):
                for b in range(size):
                    value = work[column, a, b]
                    for s in range(a):
                        value -= own[column, a, s] * part[s, b]
                    part[a, b] = value
                    work[column, a, b] = 0.0
            if size == 2:
                # the compiler cannot know that `part` is not written to: numbers of their own are a quarter faster
                p00, p01, p10, p11 = part[0, 0], part[0, 1], part[1, 0], part[1, 1]
                for p in range(begin[column], end[column]):
                    at, l00, l01, l10, l11 = row[p], lower[p, 0, 0], lower[p, 0, 1], lower[p, 1, 0], lower[p, 1, 1]
                    work[at, 0, 0] -= l00 * p00 + l01 * p10
                    work[at, 0, 1] -= l00 * p01 + l01 * p11
                    work[at, 1, 0] -= l10 * p00 + l11 * p10
                    work[at, 1, 1] -= l10 * p01 + l11 * p11
            else:
                for p in range(begin[column], end[column]):
                    at = row[p]
                    for a in range(size):
                        for b in range(size):
                            value = work[at, a, b]
                            for s in range(size):
                                value -= lower[p, a, s] * part[s, b]
                            work[at, a, b] = value
            to = end[column]
            row[to] = k
            end[column] += 1
            for a in range(size):
                for s in range(size):
                    lower[to, a, s] = part[s, a] / pivot[column, s]
            for a in range(size):
                for b in range(a + 1):
                    for s in range(size):
                        own[k, a, b] -= lower[to, a, s] * part[s, b]
        for a in range(size):
            for b in range(a + 1):
                value = own[k, a, b]
                for s in range(b):
                    value -= own[k, a, s] * own[k, b, s] * pivot[k, s]
                if b < a:
                    own[k, a, b] = value / pivot[k, b]
                else:
                    pivot[k, a] = value
            if not (np.isfinite(pivot[k, a]) and pivot[k, a] != 0.0):
                return lower, row, own, pivot, False
    return lower, row, own, pivot, True


def factor_blocks(data: NDArray[np.float64], known: Plan) -> BlockFactors | None:
    """Return the factors of a matrix whose entries are given row by row; None where a pivot vanishes."""
    *found, regular = _factor((0,) * known.size, data, *known[1:])
    return BlockFactors(*found) if regular else None


@kernel
def _growth(order, begin, lower, row, own, pivot):  # type: ignore[no-untyped-def]
    """Return the largest row of |L||D||L^T|."""
    rows, size = pivot.shape
    total = np.abs(pivot)
    for k in range(rows):
        for s in range(size):
            for a in range(s + 1, size):
                total[k, a] += own[k, a, s] ** 2 * abs(pivot[k, s])
            for p in range(begin[k], begin[k + 1]):
                for a in range(size):
                    total[row[p], a] += lower[p, a, s] ** 2 * abs(pivot[k, s])
    return total.max()


def growth(known: Plan, factors: BlockFactors) -> float:
    """Return the largest row of |L||D||L^T|."""
    return float(_growth(known.order, known.begin, *factors))


@kernel
def _solve(axes, order, begin, lower, row, own, pivot, right):  # type: ignore[no-untyped-def]
    """Return the solutions for right-hand sides in columns."""
    size = len(axes)
    rows = order.shape[0]
    out, x = np.empty_like(right), np.empty((rows, size))
    for side in range(right.shape[1]):
        for k in range(rows):
            for a in range(size):
                x[k, a] = right[order[k] * size + a, side]
        for k in range(rows):
            for a in range(size):
                for s in range(a):
                    x[k, a] -= own[k, a, s] * x[k, s]
            for p in range(begin[k], begin[k + 1]):
                at = row[p]
                for a in range(size):
                    value = x[at, a]
                    for s in range(size):
                        value -= lower[p, a, s] * x[k, s]
                    x[at, a] = value
        for k in range(rows - 1, -1, -1):
            for s in range(size):
                value = x[k, s] / pivot[k, s]
                for p in range(begin[k], begin[k + 1]):
                    at = row[p]
                    for a in range(size):
                        value -= lower[p, a, s] * x[at, a]
                x[k, s] = value
            for a in range(size - 1, -1, -1):
                for s in range(a + 1, size):
                    x[k, a] -= own[k, s, a] * x[k, s]
            for a in range(size):
                out[order[k] * size + a, side] = x[k, a]
    return out


def solve_blocks(known: Plan, factors: BlockFactors, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solutions for one (n,) or several (n, k) right-hand sides."""
    # a copy: arrays that may not be written to would be compiled for once more
    sides = np.array(right.reshape(len(right), -1), order="C")
    found = _solve((0,) * known.size, known.order, known.begin, *factors, sides)
    return np.asarray(found.reshape(right.shape))
