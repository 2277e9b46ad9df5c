# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The order in which links are eliminated, so that factors stay narrow, and the envelope that it leaves.

A cluster is numbered as by Cuthill and McKee (Proc. 24th Nat. Conf. ACM, 157, 1969), level by level from a particle
with fewest links, neighbors with fewer links first; then reversed, as George found to fill less.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device, kernel
from packmech.links import Links


@device
def _ends(i_l, j_l, particles):
    """Return where each particle's entries begin, and the links there, in their order; one of itself stands once."""
    start = np.zeros(particles + 1, np.int64)
    for link in range(i_l.shape[0]):
        start[i_l[link] + 1] += 1
        if i_l[link] != j_l[link]:
            start[j_l[link] + 1] += 1
    for n in range(particles):
        start[n + 1] += start[n]
    entry, at = np.empty(start[particles], np.int64), start[:-1].copy()
    for link in range(i_l.shape[0]):
        i, j = i_l[link], j_l[link]
        entry[at[i]] = link
        at[i] += 1
        if i != j:
            entry[at[j]] = link
            at[j] += 1
    return start, entry


@device
def _flood(first, mark, seen, start, entry, i_l, j_l, out, begin):
    """Write the particles that hang on `first` to `out` from `begin` on, level by level; return the end."""
    seen[first] = mark
    out[begin] = first
    end, here = begin + 1, begin
    while here < end:
        i = out[here]
        here += 1
        level = end
        for h in range(start[i], start[i + 1]):
            other = j_l[entry[h]] if i_l[entry[h]] == i else i_l[entry[h]]
            if seen[other] == mark:
                continue
            seen[other] = mark
            degree = start[other + 1] - start[other]
            at = end
            while at > level and start[out[at - 1] + 1] - start[out[at - 1]] > degree:
                out[at] = out[at - 1]
                at -= 1
            out[at] = other
            end += 1
    return end


@kernel
def link_order(i_l, j_l, particles):
    """Return the links in the order of elimination: clusters by their smallest particle, along each."""
    start, entry = _ends(i_l, j_l, particles)
    seen = np.zeros(particles, np.int8)
    sequence = np.empty(particles, np.int64)
    rank = np.empty(particles, np.int64)
    order = np.empty(i_l.shape[0], np.int64)
    end = used = 0
    for first in range(particles):
        if seen[first] or start[first] == start[first + 1]:
            continue
        begin = end
        end = _flood(first, 1, seen, start, entry, i_l, j_l, sequence, begin)
        seed = first
        for k in range(begin, end):
            one = sequence[k]
            fewer = start[one + 1] - start[one] - start[seed + 1] + start[seed]
            if fewer < 0 or (fewer == 0 and one < seed):
                seed = one
        _flood(seed, 2, seen, start, entry, i_l, j_l, sequence, begin)
        for k in range(begin, end):
            rank[sequence[k]] = begin + end - 1 - k
        for k in range(end - 1, begin - 1, -1):
            one = sequence[k]
            low = used
            for h in range(start[one], start[one + 1]):
                link = entry[h]
                far = rank[i_l[link]] + rank[j_l[link]] - rank[one]
                if far >= rank[one]:
                    at = used
                    while at > low and rank[i_l[order[at - 1]]] + rank[j_l[order[at - 1]]] - rank[one] > far:
                        order[at] = order[at - 1]
                        at -= 1
                    order[at] = link
                    used += 1
    return order


@kernel
def link_envelope(i_r, j_r, particles):
    """Return the tables of a `LinkSystem` that links in the order of elimination make.

    They are (row_e, column_e, particle_e, slot_e, sign_e), (first_r, start_r, last_r, block_b) and (part_b, who_q,
    from_q, near_k, sense_k).
    """
    count = i_r.shape[0]
    # a link of a particle with its own image does not change when the particle moves: it couples to no other link
    start = np.zeros(particles + 1, np.int64)
    for r in range(count):
        if i_r[r] != j_r[r]:
            start[i_r[r] + 1] += 1
            start[j_r[r] + 1] += 1
    parts = pairs = 0
    for n in range(particles):
        parts += start[n + 1] > 0
        pairs += start[n + 1] * (start[n + 1] - 1) // 2
        start[n + 1] += start[n]
    entry, at = np.empty(start[particles], np.int64), start[:-1].copy()
    first, last = np.arange(count), np.arange(count)
    for r in range(count):
        if i_r[r] != j_r[r]:
            for n in (i_r[r], j_r[r]):
                if at[n] > start[n]:
                    first[r] = min(first[r], entry[start[n]])
                entry[at[n]] = r
                at[n] += 1
    begin = np.zeros(count + 1, np.int64)
    for r in range(count):
        begin[r + 1] = begin[r] + r - first[r]
        last[first[r]] = max(last[first[r]], r)
    for r in range(1, count):
        last[r] = max(last[r], last[r - 1])
    # no later row reaches before a cluster's first
    block, blocks, ahead = np.empty(count + 1, np.int64), 1, count
    block[count] = count
    for r in range(count - 1, -1, -1):
        ahead = min(ahead, first[r])
        if ahead == r:
            blocks += 1
            block[count + 1 - blocks] = r
    block = block[count + 1 - blocks :].copy()
    row, column, shared = np.empty(pairs, np.int64), np.empty(pairs, np.int64), np.empty(pairs, np.int64)
    slot, sign = np.empty(pairs, np.int64), np.empty(pairs)
    e = 0
    for n in range(particles):
        for h in range(start[n], start[n + 1]):
            r = entry[h]
            for k in range(start[n], h):
                c = entry[k]
                row[e], column[e], shared[e] = r, c, n
                slot[e] = begin[r] + c - first[r]
                sign[e] = 1.0 if (i_r[r] == n) == (i_r[c] == n) else -1.0
                e += 1
    part, who, place = np.empty(blocks, np.int64), np.empty(parts, np.int64), np.empty(parts + 1, np.int64)
    near, sense = np.empty(entry.shape[0], np.int64), np.empty(entry.shape[0])
    q = k = b = 0
    place[0] = 0
    for r in range(count):
        if r == block[b]:
            part[b] = q
            b += 1
        if i_r[r] == j_r[r]:
            continue
        for n in (i_r[r], j_r[r]):
            if entry[start[n]] != r:
                continue
            who[q] = n
            for h in range(start[n], start[n + 1]):
                near[k] = entry[h]
                sense[k] = -1.0 if i_r[entry[h]] == n else 1.0
                k += 1
            q += 1
            place[q] = k
    part[b] = q
    return (row, column, shared, slot, sign), (first, begin, last, block), (part, who, place, near, sense)


def elimination_order(links: Links, particles: int) -> NDArray[np.int64]:
    """Return an order of the links that goes through one cluster after another, along each.

    Examples
    --------
    >>> chain = Links([0, 0, 1], [2, 3, 3], [[0, 0]] * 3, [1.0] * 3)
    >>> [(int(chain.i_l[k]), int(chain.j_l[k])) for k in elimination_order(chain, 4)]
    [(0, 2), (0, 3), (1, 3)]

    """
    order: NDArray[np.int64] = link_order(links.i_l, links.j_l, particles)
    return order


def envelope(links: Links, order_r: NDArray[np.int64], particles: int) -> dict[str, Any]:
    """Return the tables of a `LinkSystem` by name, for links in this order."""
    names = (
        ("row_e", "column_e", "particle_e", "slot_e", "sign_e"),
        ("first_r", "start_r", "last_r", "block_b"),
        ("part_b", "who_q", "from_q", "near_k", "sense_k"),
    )
    i, j = links.i_l[order_r], links.j_l[order_r]
    tables = link_envelope(i, j, particles)
    found: dict[str, Any] = {"i_r": i, "j_r": j}
    for group, arrays in zip(names, tables, strict=True):
        found.update(zip(group, arrays, strict=True))
    return found
