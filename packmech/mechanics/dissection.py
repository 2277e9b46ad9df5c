# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Nested dissection of a packing by position: an order of elimination with little fill, nearly for free.

A set of particles is cut at the median of its longest direction; those on one side of the cut that touch the other
side are eliminated after both halves. Periodic images and links of any length need no care: who is on the rim is read
from the graph, not from distances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device, kernel

# larger sets are cut at several places, on all axes along which they are long, for the smallest separator
_SEVERAL = 60
_WINDOW = 0.24
_LONG = 0.7


class Dissection(NamedTuple):
    """A tree of separators, children before parents, as a postorder needs them.

    Attributes
    ----------
    member_n
        Particles in the order of elimination.
    start_t
        (T + 1,) where the particles of each node start in `member_n`.
    children_t
        (T,) number of children of each node: the last ones before it that are nobody's yet.

    """

    member_n: NDArray[np.int64]
    start_t: NDArray[np.int64]
    children_t: NDArray[np.int64]


@kernel
def graph_of(i_p, j_p, particles):
    """Return start and neighbor of the particles' graph; pairs may come twice, those of a particle alone are left out.

    The first half of the entries of `edge` says which pair it was.
    """
    start = np.zeros(particles + 2, np.int64)
    for c in range(i_p.shape[0]):
        if i_p[c] != j_p[c]:
            start[i_p[c] + 2] += 1
            start[j_p[c] + 2] += 1
    for n in range(particles):
        start[n + 2] += start[n + 1]
    neighbor = np.empty(start[particles + 1], np.int64)
    edge = np.empty(start[particles + 1], np.int64)
    for c in range(i_p.shape[0]):
        i, j = i_p[c], j_p[c]
        if i != j:
            neighbor[start[i + 1]] = j
            edge[start[i + 1]] = c
            start[i + 1] += 1
            neighbor[start[j + 1]] = i
            edge[start[j + 1]] = c
            start[j + 1] += 1
    return start[: particles + 1], neighbor, edge


@device
def _spreads(place, member, low, high, spread):
    """Write how far these particles spread along each axis; return the axis along which they do most."""
    best = 0
    for a in range(place.shape[1]):
        least, largest = np.inf, -np.inf
        for m in range(low, high):
            x = place[member[m], a]
            least = min(least, x)
            largest = max(largest, x)
        spread[a] = largest - least
        if spread[a] > spread[best]:
            best = a
    return best


@device
def _split(key, member, low, high, middle):
    """Partition member[low:high] so that those before `middle` have the smaller keys (Hoare's selection)."""
    left, right = low, high - 1
    while left < right:
        pivot = key[member[(left + right) // 2]]
        a, b = left, right
        while a <= b:
            while key[member[a]] < pivot:
                a += 1
            while key[member[b]] > pivot:
                b -= 1
            if a <= b:
                member[a], member[b] = member[b], member[a]
                a += 1
                b -= 1
        if middle <= b:
            right = b
        elif middle >= a:
            left = a
        else:
            return


@device
def _cover(start, neighbor, side, member, low, high, gain):
    """Mark with side 3 a small set of particles of sides 1 and 2 that every edge between these has an end in.

    One after the other those with the most uncovered edges are taken.
    Return their number.
    """
    most = taken = 0
    for m in range(low, high):
        n = member[m]
        gain[n] = 0
        for h in range(start[n], start[n + 1]):
            if side[neighbor[h]] == 3 - side[n]:
                gain[n] += 1
        most = max(most, gain[n])
    while most > 0:
        for m in range(low, high):
            n = member[m]
            if gain[n] != most or side[n] == 3:
                continue
            own = side[n]
            side[n] = 3
            taken += 1
            for h in range(start[n], start[n + 1]):
                k = neighbor[h]
                if side[k] == 3 - own:
                    gain[k] -= 1
            gain[n] = 0
        most -= 1
    return taken


@kernel
def dissect(place, start, neighbor, pinned, leaf, trials):
    """Return the tree's arrays (as in `Dissection`) of all particles but the pinned one.

    `place` holds positions wrapped into the cell; sets of at most `leaf` particles are cut no more.
    """
    n = place.shape[0]
    member = np.empty(n, np.int64)
    size = 0
    for i in range(n):
        if i != pinned:
            member[size] = i
            size += 1
    member = member[:size]
    side = np.zeros(n, np.int8)
    gain = np.zeros(n, np.int64)
    other = np.empty(n, np.int64)
    key = np.empty(n)
    spread = np.empty(place.shape[1])
    # nodes in the order of discovery: parents first
    first = np.empty(2 * n + 2, np.int64)
    last = np.empty(2 * n + 2, np.int64)
    parts = np.zeros(2 * n + 2, np.int64)
    stack = np.empty((2 * n + 2, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, size
    height, count = 1, 0
    while height > 0:
        height -= 1
        low, high = stack[height, 0], stack[height, 1]
        last[count] = high
        if high - low <= leaf:
            first[count] = low
            count += 1
            continue
        axis = _spreads(place, member, low, high, spread)
        many = high - low
        cut, fewest = (low + high) // 2, np.inf
        if many >= _SEVERAL and trials > 1:
            chosen = axis
            for a in range(place.shape[1]):
                if spread[a] < _LONG * spread[axis]:
                    continue
                for m in range(low, high):
                    key[member[m]] = place[member[m], a]
                _split(key, member, low, high, low)
                for trial in range(trials):
                    middle = low + int(many * (0.5 + _WINDOW * ((trial + 0.5) / trials - 0.5)))
                    _split(key, member, low, high, middle)
                    for m in range(low, high):
                        side[member[m]] = 1 if m < middle else 2
                    cost = _cover(start, neighbor, side, member, low, high, gain)
                    for m in range(low, high):
                        side[member[m]] = 0
                    lean = abs(2 * (middle - low) - many) / many
                    price = cost * (1.0 + lean)
                    if price < fewest:
                        cut, chosen, fewest = middle, a, price
            axis = chosen
        for m in range(low, high):
            key[member[m]] = place[member[m], axis]
        _split(key, member, low, high, cut)
        for m in range(low, high):
            side[member[m]] = 1 if m < cut else 2
        _cover(start, neighbor, side, member, low, high, gain)
        used = np.zeros(4, np.int64)
        for m in range(low, high):
            used[side[member[m]]] += 1
        at = np.array([0, low, low + used[1], low + used[1] + used[2]])
        for m in range(low, high):
            other[m] = member[m]
        for m in range(low, high):
            s = side[other[m]]
            member[at[s]] = other[m]
            at[s] += 1
            side[other[m]] = 0
        first[count] = low + used[1] + used[2]
        for s in range(2):
            begin = low if s == 0 else low + used[1]
            if used[s + 1] > 0:
                stack[height, 0], stack[height, 1] = begin, begin + used[s + 1]
                height += 1
                parts[count] += 1
        count += 1
    # the segment discovered last stands first: reversed, children come before parents
    order = np.empty(size, np.int64)
    begin = np.empty(count + 1, np.int64)
    children = np.empty(count, np.int64)
    at_place = 0
    for t in range(count):
        k = count - 1 - t
        begin[t] = at_place
        children[t] = parts[k]
        for m in range(first[k], last[k]):
            order[at_place] = member[m]
            at_place += 1
    begin[count] = at_place
    return order, begin, children
