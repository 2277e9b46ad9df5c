# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Which discs may touch: a list of near pairs that carries the contacts' states with it.

The reference package scans all ordered pairs at every step. Here the scan is made when some disc may have come nearer
than the list's margin, and every step looks at the listed pairs alone: the same contacts, found sooner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device, kernel

OPEN, STICK, SLIP, BOND = 0, 1, 2, 3


class Pairs(NamedTuple):
    """Near pairs i < j in order, their kinds, and what a contact needs at hand.

    That is, in a row of 9: the two histories, 1/(r_i + r_j), and where i last saw j: n_x, n_y, the number of the copy,
    the distance and its inverse, and 1 if the contact crosses the cell's boundary.
    """

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    kind_p: NDArray[np.int64]
    state_p9: NDArray[np.float64]


@device
def image(dx, dy, width, height, strain):
    """Return the difference as the package images it, y first and then x, and how many heights and widths it took.

    In a strongly sheared cell this is not always the nearest image; it is for all distances below half the height.
    """
    up, along = 0, 0
    if abs(dy) >= height / 2.0:
        up = math.floor(dy / height + 0.5)
        dy -= up * height
        dx -= up * height * strain
    if abs(dx) >= width / 2.0:
        along = math.floor(dx / width + 0.5)
        dx -= along * width
    return dx, dy, up, along


@device
def _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n):
    """Flag the discs after the i-th that are near it; without branches, so that it is done for several at a time."""
    shift = height * strain - math.floor(height * strain / width) * width
    for j in range(i + 1, x_n.shape[0]):
        dx, dy = x_n[j] - x_n[i], y_n[j] - y_n[i]
        up = (1.0 if dy >= height / 2.0 else 0.0) - (1.0 if dy < -height / 2.0 else 0.0)
        dy -= up * height
        dx -= up * shift
        for _ in range(2):
            dx -= (width if dx >= width / 2.0 else 0.0) - (width if dx < -width / 2.0 else 0.0)
        reach = radius_n[i] + radius_n[j] + margin
        near_n[j] = dx * dx + dy * dy < reach * reach


@kernel
def list_pairs(position_nd, radius_n, width, height, strain, margin, old):
    """Return the pairs nearer than touching plus the margin.

    Pairs of the old list that are in contact or bonded stay, wherever they are, with their state.
    """
    count, listed = radius_n.shape[0], old.i_p.shape[0]
    x_n, y_n = position_nd[:, 0].copy(), position_nd[:, 1].copy()
    near_n = np.zeros(count, np.bool_)
    ij_p3 = np.empty((8 * count + listed, 3), np.int64)
    found, seen = 0, 0
    for i in range(count):
        _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n)
        first = seen
        while seen < listed and old.i_p[seen] == i:
            if old.kind_p[seen] != OPEN:
                near_n[old.j_p[seen]] = True
            seen += 1
        if found + count > ij_p3.shape[0]:
            ij_p3 = np.concatenate((ij_p3, np.empty_like(ij_p3)))
        for j in range(i + 1, count):
            if near_n[j]:
                while first < seen and old.j_p[first] < j:
                    first += 1
                kept = first < seen and old.j_p[first] == j and old.kind_p[first] != OPEN
                ij_p3[found, 0], ij_p3[found, 1], ij_p3[found, 2] = i, j, first if kept else -1
                found += 1
    i_p, j_p, from_p = ij_p3[:found, 0].copy(), ij_p3[:found, 1].copy(), ij_p3[:found, 2].copy()
    kind_p, state_p9 = np.zeros(found, np.int64), np.zeros((found, 9))
    for p in range(found):
        state_p9[p, 2] = 1.0 / (radius_n[i_p[p]] + radius_n[j_p[p]])
        if from_p[p] >= 0:
            kind_p[p] = old.kind_p[from_p[p]]
            state_p9[p, 0] = old.state_p9[from_p[p], 0]
            state_p9[p, 1] = old.state_p9[from_p[p], 1]
    return Pairs(i_p, j_p, kind_p, state_p9)
