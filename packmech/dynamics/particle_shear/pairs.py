# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Which discs may touch: a list of near pairs that carries the contacts' states with it.

The reference package scans all ordered pairs at every step. Here the scan is made when some disc may have come nearer
than the list's margin, and every step looks at the listed pairs alone: the same contacts, found sooner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device, kernel

OPEN, STICK, SLIP, BOND = 0, 1, 2, 3


class Pairs(NamedTuple):
    """Near pairs i < j in order: kinds, the two histories, 1/(r_i + r_j), and where i last saw j (n_x, n_y, copy)."""

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    kind_p: NDArray[np.int64]
    history_p2: NDArray[np.float64]
    inverse_p: NDArray[np.float64]
    frame_p3: NDArray[np.float64]


@device
def image(dx, dy, width, height, strain):
    """Return the difference as the package images it, y first and then x, and how many heights and widths it took.

    In a strongly sheared cell this is not always the nearest image; it is for all distances below half the height.
    """
    up, along = 0.0, 0.0
    if dy >= height / 2.0 or dy < -height / 2.0:
        up = np.floor(dy / height + 0.5)
        dy -= up * height
        dx -= up * height * strain
    if dx >= width / 2.0 or dx < -width / 2.0:
        along = np.floor(dx / width + 0.5)
        dx -= along * width
    return dx, dy, up, along


@device
def _near(position_nd, radius_n, i, j, width, height, strain, margin):
    reach = radius_n[i] + radius_n[j] + margin
    y = abs(position_nd[j, 1] - position_nd[i, 1])
    if y > reach and height - y > reach:
        return False
    dx, dy, _, _ = image(
        position_nd[j, 0] - position_nd[i, 0], position_nd[j, 1] - position_nd[i, 1], width, height, strain
    )
    return dx * dx + dy * dy < reach * reach


@kernel
def list_pairs(position_nd, radius_n, width, height, strain, margin, old):
    """Return the pairs nearer than touching plus the margin.

    Pairs of the old list that are in contact or bonded stay, wherever they are, with their state.
    """
    count = radius_n.shape[0]
    room = 8 * count + old.i_p.shape[0]
    i_p, j_p, from_p = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64)
    found, seen = 0, 0
    for i in range(count):
        for j in range(i + 1, count):
            while seen < old.i_p.shape[0] and (old.i_p[seen] < i or (old.i_p[seen] == i and old.j_p[seen] < j)):
                seen += 1
            kept = -1
            if seen < old.i_p.shape[0] and old.i_p[seen] == i and old.j_p[seen] == j and old.kind_p[seen] != OPEN:
                kept = seen
            if kept >= 0 or _near(position_nd, radius_n, i, j, width, height, strain, margin):
                if found == room:
                    room *= 2
                    i_p = np.concatenate((i_p, np.empty(found, np.int64)))
                    j_p = np.concatenate((j_p, np.empty(found, np.int64)))
                    from_p = np.concatenate((from_p, np.empty(found, np.int64)))
                i_p[found], j_p[found], from_p[found] = i, j, kept
                found += 1
    kind_p, history_p2, inverse_p = np.zeros(found, np.int64), np.zeros((found, 2)), np.empty(found)
    for p in range(found):
        inverse_p[p] = 1.0 / (radius_n[i_p[p]] + radius_n[j_p[p]])
        if from_p[p] >= 0:
            kind_p[p] = old.kind_p[from_p[p]]
            history_p2[p, 0] = old.history_p2[from_p[p], 0]
            history_p2[p, 1] = old.history_p2[from_p[p], 1]
    return Pairs(i_p[:found].copy(), j_p[:found].copy(), kind_p, history_p2, inverse_p, np.zeros((found, 3)))
