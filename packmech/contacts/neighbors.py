"""Candidate pairs: near enough to test, over all periodic images, for any lattice and any ratio of sizes.

The box is reduced to its shortest lattice vectors first, so that strained and tilted boxes need no more images than
compact ones; the compiled search of cells.py does the rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.cells import find_pairs, frame_of, size_levels
from packmech.jit.compiled import kernel


class Candidates(NamedTuple):
    """Pairs whose distance is at most scale * (radius_i + radius_j) + skin, each once, sorted by (i, j, image).

    image_cd refers to the positions as given: v = x_j - x_i + lattice @ image.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]


@kernel
def _pairs_as_given(axes, row, sizes, frame, scale, skin, step_nd, change_dd):  # type: ignore[no-untyped-def]
    """Return the pairs with images for the positions and vectors as given, and whether some pair has several."""
    i_p, code_p, image_kd, bits = find_pairs(axes, row, sizes, frame, scale, skin)
    count, d = i_p.shape[0], change_dd.shape[0]
    i_c, j_c, image_cd = np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, d), np.int64)
    several = False
    for c in range(count):
        i, j = np.int64(i_p[c]), np.int64(code_p[c]) >> bits
        k = np.int64(code_p[c]) & ((1 << bits) - 1)
        sign = 0
        for a in range(d):
            total = 0
            for b in range(d):
                total += change_dd[a, b] * (np.int64(image_kd[k, b]) - step_nd[j, b] + step_nd[i, b])
            image_cd[c, a] = total
            if sign == 0 and total != 0:
                sign = 1 if total > 0 else -1
        # a particle and its image are one pair: its first component along the given vectors is to be positive
        if i == j and sign < 0:
            for a in range(d):
                image_cd[c, a] *= -1
        several = several or (c > 0 and i == i_c[c - 1] and j == j_c[c - 1])
        i_c[c], j_c[c] = i, j
    return i_c, j_c, image_cd, several


def candidate_pairs(
    position_nd: NDArray[np.float64], radius_n: NDArray[np.float64], box: Box, *, scale: float = 1.0, skin: float = 0.0
) -> Candidates:
    """Return all pairs, over all images, with distance <= scale * (radius_i + radius_j) + skin.

    Parameters
    ----------
    position_nd
        (N, d) centers [length], inside the cell or not.
    radius_n
        (N,) radii [length].
    box
        The periodic box.
    scale, skin
        Factor on the contact distance [1] and length added to it [length].

    Examples
    --------
    >>> pairs = candidate_pairs(np.zeros((1, 2)), np.array([0.5]), Box.cubic(1.0, 2))
    >>> pairs.image_cd.tolist()
    [[0, 1], [1, 0]]

    """
    d = box.dimension
    small, change = box.reduced()
    wrapped, step = small.wrap(position_nd)
    row = np.zeros((len(radius_n), 4))
    row[:, :d] = wrapped
    row[:, 3] = radius_n
    i_c, j_c, image_cd, several = _pairs_as_given(
        (0,) * d, row, size_levels(radius_n), frame_of(small), float(scale), float(skin), step, change
    )
    # the search sorts by (i, j) already; only the images of one pair may want sorting along the given vectors
    if several:
        sort = np.lexsort((*image_cd.T[::-1], j_c, i_c))
        image_cd = image_cd[sort]
    return Candidates(i_c, j_c, np.ascontiguousarray(image_cd))
