"""Which links hold a cluster rigid: as many as it has inner freedoms, none of them redundant."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Pair = tuple[int, int]

# a link that adds less than this to those there are (of a row of length one) holds nothing to first order
_NEW = 1e-6
# beads apart by less than this (relative to their contact distance) count as touching
_TOUCHING = 1e-9


def bonds_of(position_bd: NDArray[np.float64], radius_b: NDArray[np.float64]) -> list[Pair]:
    """Return the pairs that touch or overlap, and the smallest gaps that join what does not, nearest first.

    In two dimensions none of them crosses another: of two that would, the nearer pair stays.
    """
    beads = len(radius_b)
    pairs = [(i, j) for i in range(beads) for j in range(i + 1, beads)]
    distance = {p: math.dist(position_bd[p[0]], position_bd[p[1]]) for p in pairs}
    gap = {p: distance[p] - float(radius_b[p[0]] + radius_b[p[1]]) * (1 + _TOUCHING) for p in pairs}
    # rounding must not choose between equal pairs
    pairs.sort(key=lambda p: (float(f"{distance[p]:.9e}"), p))
    bonds: list[Pair] = []
    group = list(range(beads))

    def add(pair: Pair) -> None:
        if not any(cross(position_bd, pair, one) for one in bonds):
            bonds.append(pair)
            old, new = group[pair[1]], group[pair[0]]
            group[:] = [new if g == old else g for g in group]

    for pair in pairs:
        if gap[pair] <= 0:
            add(pair)
    for pair in sorted(pairs, key=lambda p: (float(f"{gap[p]:.9e}"), p)):
        if group[pair[0]] != group[pair[1]]:
            add(pair)
    return bonds


def cross(position_bd: NDArray[np.float64], one: Pair, other: Pair) -> bool:
    """Return whether two pairs without a common bead cross as segments; never in three dimensions."""
    if position_bd.shape[1] != 2 or set(one) & set(other):
        return False
    (px, py), (qx, qy) = position_bd[one[0]].tolist(), position_bd[other[0]].tolist()
    ux, uy = (position_bd[one[1]] - position_bd[one[0]]).tolist()
    vx, vy = (position_bd[other[1]] - position_bd[other[0]]).tolist()
    turn = ux * vy - uy * vx
    if turn == 0.0:
        return False
    s, t = ((qx - px) * vy - (qy - py) * vx) / turn, ((qx - px) * uy - (qy - py) * ux) / turn
    return bool(0.0 <= s <= 1.0 and 0.0 <= t <= 1.0)


def rigid_links(position_bd: NDArray[np.float64], bonds: list[Pair]) -> tuple[list[Pair], list[bool]]:
    """Return independent links that leave a cluster its translations and rotations only, and which hold the shape.

    Bonds come first, in their order; those that add nothing are left out. Then pairs that hold the shape, each the
    shortest of those that add at least a third of what the best pair would.

    Raises
    ------
    ValueError
        For beads on a line, or in a plane in three dimensions, which no links hold rigid to first order.

    """
    beads, d = position_bd.shape
    centered = position_bd - position_bd.mean(axis=0)
    size = math.sqrt(float((centered**2).sum()))
    spread = np.linalg.svd(centered / size, compute_uv=False)
    flat = int((spread > _NEW).sum()) if beads > 1 else 0
    rotations = d * (d - 1) // 2 - (d - flat) * (d - flat - 1) // 2
    wanted = beads * d - d - rotations
    pairs = [(i, j) for i in range(beads) for j in range(i + 1, beads)]
    place = {p: k for k, p in enumerate(pairs)}
    rows = np.zeros((len(pairs), beads, d))
    i, j = np.array(pairs).T
    vector = position_bd[j] - position_bd[i]
    length = np.sqrt((vector**2).sum(axis=1))
    rows[np.arange(len(pairs)), j] = vector / length[:, None] / math.sqrt(2.0)
    rows[np.arange(len(pairs)), i] = -rows[np.arange(len(pairs)), j]
    left = rows.reshape(len(pairs), beads * d)
    links: list[Pair] = []

    def take(k: int) -> None:
        # twice, so that what is left stays orthogonal to what was taken
        nonlocal left
        unit = left[k] / math.sqrt(float(np.add.reduce(left[k] ** 2)))
        for _ in range(2):
            left = left - np.einsum("pk,k->p", left, unit)[:, None] * unit
        links.append(pairs[k])

    for pair in bonds:
        if np.add.reduce(left[place[pair]] ** 2) > _NEW**2:
            take(place[pair])
    bonded = len(links)
    while len(links) < wanted:
        new = np.sqrt(np.add.reduce(left**2, axis=1))
        if new.max() <= _NEW:
            break
        good = np.flatnonzero(new >= new.max() / 3)
        near = length[good]
        take(int(good[np.flatnonzero(near <= near.min() * (1 + _TOUCHING))[0]]))
    if len(links) < wanted:
        kind = "a line" if flat == 1 else "a plane"
        raise ValueError(
            f"position_bd must not lie on {kind} for links to hold it rigid (to first order none resists a bend out of "
            f"it; give links for a flexible cluster), got {beads} beads on {kind}"
        )
    return links, [k >= bonded for k in range(len(links))]
