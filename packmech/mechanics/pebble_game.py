# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The pebble game: generic counting of what is rigid in the plane, in a periodic box of fixed shape.

Each particle has pebbles, its motions: two for a point, three for a disc that turns. A bar takes one motion away, and
is independent of the bars before it where every set of bars obeys

    bars <= pebbles of its particles - 3      if it does not wind around the box
    bars <= pebbles of its particles - 2      if it does: it cannot turn

(Jacobs and Hendrickson, J. Comput. Phys. 137, 346 (1997) for points; Henkes, Quint, Fily and Schwarz, Phys. Rev. Lett.
116, 028301 (2016) for discs, where a contact that sticks is two bars and one that slides is one; Ross, Discrete Comput.
Geom. 54, 79 (2015) for boxes). Counting knows no lengths: it answers for places in no special position.

An independent bar is held by one of its particles, in place of a pebble. A set that no bar leaves has as many bars as
its particles have places, less the pebbles that lie on it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import device, kernel


class Counted(NamedTuple):
    """What counting says of bars: which are independent, which carry stress, and in which rigid cluster each is.

    Clusters are numbered from 0; -1 is none: of points, which may be in several, and of what turns against all others.
    """

    independent_b: NDArray[np.bool_]
    stressed_b: NDArray[np.bool_]
    cluster_b: NDArray[np.int64]
    cluster_n: NDArray[np.int64]
    clusters: int


@device
def _pebbles(target, n):
    """Return how many pebbles lie on a particle."""
    count = 0
    for s in range(target.shape[1]):
        count += target[n, s] < 0
    return count


@device
def _fetch(target, gain, bar, root, other, seen, stamp, queue, parent, place):
    """Bring one more pebble to `root`, but none of `other`; return whether there is one within reach."""
    seen[root] = stamp
    queue[0] = root
    begin, end = 0, 1
    k, d = target.shape[1], gain.shape[2]
    while begin < end:
        n = queue[begin]
        begin += 1
        for s in range(k):
            m = target[n, s]
            if m < 0 or seen[m] == stamp:
                continue
            seen[m] = stamp
            parent[m], place[m] = n, s
            queue[end] = m
            end += 1
            if m == other or _pebbles(target, m) == 0:
                continue
            slot = 0
            while target[m, slot] >= 0:
                slot += 1
            # each bar on the way goes over to its far end
            while m != root:
                one, at = parent[m], place[m]
                target[m, slot] = one
                for a in range(d):
                    gain[m, slot, a] = -gain[one, at, a]
                bar[m, slot] = bar[one, at]
                target[one, at], bar[one, at] = -1, -1
                m, slot = one, at
            return True
    return False


@device
def _gather(target, gain, bar, u, v, wanted, seen, stamp, queue, parent, place):
    """Bring pebbles to u and v until these have so many; return how many they have, and the last stamp."""
    k = target.shape[1]
    found = _pebbles(target, u)
    if v != u:
        found += _pebbles(target, v)
    while found < wanted:
        got = False
        if _pebbles(target, u) < k:
            stamp += 1
            got = _fetch(target, gain, bar, u, v, seen, stamp, queue, parent, place)
        if not got and v != u and _pebbles(target, v) < k:
            stamp += 1
            got = _fetch(target, gain, bar, v, u, seen, stamp, queue, parent, place)
        if not got:
            break
        found += 1
    return found, stamp


@device
def _reach(target, u, v, seen, stamp, queue, parent, without):
    """List what bars lead to from u and v, but for the one that led to `without` before; return how many."""
    seen[u] = stamp
    queue[0] = u
    end = 1
    if v != u:
        seen[v] = stamp
        queue[1] = v
        end = 2
    begin, k = 0, target.shape[1]
    while begin < end:
        n = queue[begin]
        begin += 1
        for s in range(k):
            m = target[n, s]
            if m < 0 or seen[m] == stamp or (m == without and parent[m] == n * k + s):
                continue
            seen[m] = stamp
            if without < 0:
                parent[m] = n * k + s
            queue[end] = m
            end += 1
    return end


@device
def _top(n, up, step, total):
    """Return the particle at the top of n's tree, and set the image of n against it."""
    d = step.shape[1]
    for a in range(d):
        total[a] = 0
    while up[n] != n:
        for a in range(d):
            total[a] += step[n, a]
        n = up[n]
    return n


@device
def _join(n, m, image, up, step, size, one, other):
    """Join the trees of the ends of a bar; return whether its image agrees where both are in one already.

    Images of particles against the tops of their trees are sums of steps: m - n must be that of the bar.
    """
    top, base = _top(n, up, step, one), _top(m, up, step, other)
    d = step.shape[1]
    if top == base:
        for a in range(d):
            if other[a] - one[a] != image[a]:
                return False
        return True
    if size[top] < size[base]:
        up[top] = base
        size[base] += size[top]
        for a in range(d):
            step[top, a] = other[a] - image[a] - one[a]
    else:
        up[base] = top
        size[top] += size[base]
        for a in range(d):
            step[base, a] = one[a] + image[a] - other[a]
    return True


@device
def _is_balanced(target, gain, queue, count, i, j, image, up, step, size, one, other):
    """Whether a set that no bar leaves, the first of the queue, winds around nothing with one bar more from i to j."""
    for q in range(count):
        n = queue[q]
        up[n], size[n] = n, 1
    balanced = _join(i, j, image, up, step, size, one, other)
    for q in range(count):
        n = queue[q]
        for s in range(target.shape[1]):
            m = target[n, s]
            # what `without` left out of the set is no part of it
            if m >= 0 and up[m] >= 0:
                balanced &= _join(n, m, gain[n, s], up, step, size, one, other)
    return balanced


@device
def _forget(queue, count, up):
    for q in range(count):
        up[queue[q]] = -1


@device
def _mark(bar, queue, count, inside, stamp, target, stressed):
    """Mark the bars within a set."""
    for q in range(count):
        n = queue[q]
        for s in range(target.shape[1]):
            m = target[n, s]
            if m >= 0 and inside[m] == stamp and bar[n, s] >= 0:
                stressed[bar[n, s]] = True


@device
def _condense(target, gain, bar, queue, count, balanced, turns_n, up, step, one, other):
    """Let all of a rigid set that no bar leaves be held by two of it, so that later ways through it are short."""
    u, v = queue[0], queue[1]
    d = gain.shape[2]
    # between the two as many bars as make them rigid, one more around the box where the set winds
    between = turns_n[u] + turns_n[v] + (1 if balanced else 2)
    for q in range(count):
        n = queue[q]
        for s in range(2 + turns_n[n]):
            to = u
            if q == 0 or q == 1:
                held = between if q == 1 else between - 2 - turns_n[v]
                to = -1 if s >= held else (v if q == 0 else u)
            elif s == 1:
                to = v
            target[n, s], bar[n, s] = to, -1
            if to >= 0:
                _top(n, up, step, one)
                _top(to, up, step, other)
                for a in range(d):
                    gain[n, s, a] = other[a] - one[a]
    if not balanced:
        # any image but that of the others winds
        gain[v, 0, 0] += 1


@kernel
def _play(i_b, j_b, image_bd, turns_n, k, marks):
    """Return the bars as they are held, which are independent, and which carry stress."""
    bars, d = image_bd.shape
    particles = turns_n.shape[0]
    target, bar = np.full((particles, k), -1, np.int64), np.full((particles, k), -1, np.int64)
    for n in range(particles):
        if k == 3 and turns_n[n] == 0:
            # a place that is never free
            target[n, 2] = n
    gain = np.zeros((particles, k, d), np.int64)
    seen, stamp = np.zeros(particles, np.int64), 0
    queue, parent, place = np.empty(particles, np.int64), np.empty(particles, np.int64), np.empty(particles, np.int64)
    up, size = np.full(particles, -1, np.int64), np.ones(particles, np.int64)
    step, one, other = np.zeros((particles, d), np.int64), np.zeros(d, np.int64), np.zeros(d, np.int64)
    independent, stressed = np.zeros(bars, np.bool_), np.zeros(bars, np.bool_)
    reached = np.empty(particles, np.int64)
    for b in range(bars):
        u, v = i_b[b], j_b[b]
        winds = False
        for a in range(d):
            winds |= image_bd[b, a] != 0
        if u == v and (turns_n[u] == 0 or not winds):
            # an own image moves along
            stressed[b] = True
            continue
        found, stamp = _gather(target, gain, bar, u, v, 3 if u == v else 4, seen, stamp, queue, parent, place)
        balanced = False
        if found == 3 and u != v:
            stamp += 1
            count = _reach(target, u, v, seen, stamp, queue, parent, -1)
            balanced = _is_balanced(target, gain, queue, count, u, v, image_bd[b], up, step, size, one, other)
            if balanced:
                stressed[b] = True
                _mark(bar, queue, count, seen, stamp, target, stressed)
                _condense(target, gain, bar, queue, count, True, turns_n, up, step, one, other)
            _forget(queue, count, up)
        if found >= 3 and not balanced:
            independent[b] = True
            n = u if _pebbles(target, u) > 0 else v
            slot = 0
            while target[n, slot] >= 0:
                slot += 1
            target[n, slot], bar[n, slot] = v if n == u else u, b
            for a in range(d):
                gain[n, slot, a] = image_bd[b, a] if n == u else -image_bd[b, a]
        elif found < 3:
            stressed[b] = True
            stamp += 1
            count = _reach(target, u, v, seen, stamp, queue, parent, -1)
            # a part that one bar leaves and that winds around nothing may carry the stress alone: the smallest
            least, last = count, -1
            if marks and u != v:
                reached[:count] = queue[:count]
                for q in range(2, count):
                    stamp += 1
                    fewer = _reach(target, u, v, seen, stamp, queue, parent, reached[q])
                    if fewer >= least or seen[reached[q]] == stamp:
                        continue
                    if _is_balanced(target, gain, queue, fewer, u, v, image_bd[b], up, step, size, one, other):
                        least, last = fewer, reached[q]
                    _forget(queue, fewer, up)
            stamp += 1
            if last >= 0:
                least = _reach(target, u, v, seen, stamp, queue, parent, last)
                _mark(bar, queue, least, seen, stamp, target, stressed)
                continue
            _reach(target, u, v, seen, stamp, queue, parent, -1)
            _mark(bar, queue, count, seen, stamp, target, stressed)
            if count > 1:
                _is_balanced(target, gain, queue, count, u, v, image_bd[b], up, step, size, one, other)
                _condense(target, gain, bar, queue, count, False, turns_n, up, step, one, other)
                _forget(queue, count, up)
    return target, gain, bar, independent, stressed


@kernel
def _label(target, gain, bar, i_b, j_b, image_bd, turns_n, start, neighbor):
    """Return the rigid cluster of each bar, of each particle where particles turn, and how many clusters there are.

    start and neighbor are the bars of each particle. From what holds all pebbles that it can, clusters grow by
    particles from which no further pebble can be reached, and by all on the way.
    """
    particles, k = target.shape
    bars, d = image_bd.shape
    seen, stamp = np.zeros(particles, np.int64), 0
    # of each particle in which cluster it was last found to be, and in which not
    rigid, floppy = np.full(particles, -1, np.int64), np.full(particles, -1, np.int64)
    queue, parent, place = np.empty(particles, np.int64), np.empty(particles, np.int64), np.empty(particles, np.int64)
    up, size = np.full(particles, -1, np.int64), np.ones(particles, np.int64)
    step, one, other = np.zeros((particles, d), np.int64), np.zeros(d, np.int64), np.zeros(d, np.int64)
    image_nd, nothing = np.zeros((particles, d), np.int64), np.zeros(d, np.int64)
    members = np.empty(particles, np.int64)
    cluster_b, cluster_n = np.full(bars, -1, np.int64), np.full(particles, -1, np.int64)
    clusters = 0
    for seed in range(particles + bars):
        # what turns is rigid by itself; then bars that end at a point
        alone = seed < particles
        if alone:
            if turns_n[seed] == 0 or cluster_n[seed] >= 0:
                continue
            u = v = seed
        else:
            u, v = i_b[seed - particles], j_b[seed - particles]
            if cluster_b[seed - particles] >= 0 or (turns_n[u] > 0 and turns_n[v] > 0):
                continue
            if u == v or turns_n[u] + turns_n[v] > 0:
                # an own image cannot turn; what turns against its bar has no part in its cluster
                for c in range(start[u], start[u + 1]):
                    b = neighbor[c]
                    if b == seed - particles or (u == v and i_b[b] == j_b[b]):
                        cluster_b[b] = clusters
                clusters += 1
                continue
        found, stamp = _gather(target, gain, bar, u, v, 3, seen, stamp, queue, parent, place)
        turns = found == 3
        rigid[u], members[0] = clusters, u
        image_nd[u] = 0
        count = 1
        if v != u:
            rigid[v], members[1] = clusters, v
            for a in range(d):
                image_nd[v, a] = image_bd[seed - particles, a]
            count = 2
        m = 0
        while m < count:
            n = members[m]
            m += 1
            for c in range(start[n], start[n + 1]):
                b = neighbor[c]
                w = j_b[b] if i_b[b] == n else i_b[b]
                if rigid[w] == clusters or floppy[w] == clusters:
                    continue
                # what bars lead to from w, up to the cluster
                stamp += 1
                seen[w] = stamp
                queue[0] = w
                begin, end = 0, 1
                free = False
                while begin < end and not free:
                    at = queue[begin]
                    begin += 1
                    for s in range(k):
                        to = target[at, s]
                        if to < 0 or floppy[to] == clusters:
                            free = True
                            break
                        if seen[to] != stamp and rigid[to] != clusters:
                            seen[to] = stamp
                            queue[end] = to
                            end += 1
                if not free and turns:
                    # it must not wind: the cluster is one particle for this, its image that of the first
                    for q in range(end):
                        up[queue[q]], size[queue[q]] = queue[q], 1
                    up[u], size[u] = u, 1
                    for q in range(end):
                        at = queue[q]
                        for s in range(k):
                            to = target[at, s]
                            inside = rigid[to] != clusters
                            for a in range(d):
                                nothing[a] = gain[at, s, a] - (0 if inside else image_nd[to, a])
                            free |= not _join(at, to if inside else u, nothing, up, step, size, one, other)
                    if not free:
                        base = _top(u, up, step, other)
                        for q in range(end):
                            free |= _top(queue[q], up, step, one) != base
                            for a in range(d):
                                image_nd[queue[q], a] = one[a] - other[a]
                    _forget(queue, end, up)
                    up[u] = -1
                if free:
                    floppy[w] = clusters
                    continue
                for q in range(end):
                    rigid[queue[q]] = clusters
                    members[count] = queue[q]
                    count += 1
        if count == 1 and alone:
            # a body alone is no cluster
            rigid[u] = -1
            for q in range(start[u], start[u + 1]):
                b = neighbor[q]
                floppy[j_b[b] if i_b[b] == u else i_b[b]] = -1
            continue
        for m in range(count):
            n = members[m]
            if turns_n[n] > 0:
                cluster_n[n] = clusters
            for c in range(start[n], start[n + 1]):
                b = neighbor[c]
                if rigid[i_b[b]] == clusters and rigid[j_b[b]] == clusters and (i_b[b] != j_b[b] or not turns):
                    cluster_b[b] = clusters
        clusters += 1
    return cluster_b, cluster_n, clusters


def play_pebble_game(
    i_b: NDArray[np.int64], j_b: NDArray[np.int64], image_bd: NDArray[np.int64], turns_n: NDArray[np.bool_]
) -> Counted:
    """Return what is rigid by counting, of bars in the plane.

    Parameters
    ----------
    i_b, j_b, image_bd
        (B,), (B,), (B, 2) the particles that each bar joins, and the image of the second against the first.
    turns_n
        (N,) particles that turn: three motions, and one cluster at most; a contact that sticks is two bars.

    Examples
    --------
    >>> i, j = np.array([0, 0, 1, 1, 2]), np.array([1, 2, 2, 3, 3])
    >>> points = np.zeros(4, dtype=bool)
    >>> play_pebble_game(i, j, np.zeros((5, 2), dtype=np.int64), points).cluster_b.tolist()
    [0, 0, 0, 0, 0]
    >>> play_pebble_game(i[:4], j[:4], np.zeros((4, 2), dtype=np.int64), points).cluster_b.tolist()
    [0, 0, 0, 1]

    """
    i, j, image = (np.ascontiguousarray(one, dtype=np.int64) for one in (i_b, j_b, image_bd))
    turns = np.ascontiguousarray(turns_n, dtype=np.int64)
    target, gain, bar, independent, stressed = _play(i, j, image, turns, 2 + int(turns.max(initial=0)), True)
    ends = np.concatenate([i, j])
    order = np.argsort(ends, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=len(turns)))])
    both = np.tile(np.arange(len(i)), 2)[order]
    cluster_b, cluster_n, clusters = _label(target, gain, bar, i, j, image, turns, start, both)
    return Counted(independent, stressed, cluster_b, cluster_n, int(clusters))
