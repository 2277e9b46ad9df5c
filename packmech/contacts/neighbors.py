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


class Candidates(NamedTuple):
    """Pairs whose distance is at most scale * (radius_i + radius_j) + skin, each once, sorted by (i, j, image).

    image_cd refers to the positions as given: v = x_j - x_i + lattice @ image.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]


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
    table = find_pairs((0,) * d, row, size_levels(radius_n), frame_of(small), float(scale), float(skin))
    i_c = table.i_p.astype(np.int64)
    j_c = (table.code_p >> np.uint32(table.bits)).astype(np.int64)
    image = table.image_kd[table.code_p & np.uint32((1 << table.bits) - 1), :d].astype(np.int64)
    image_cd = (image - step[j_c] + step[i_c]) @ change.T
    # a particle and its image are one pair: its first component along the given vectors is to be positive
    for k in np.flatnonzero(i_c == j_c):
        if image_cd[k][np.flatnonzero(image_cd[k])[0]] < 0:
            image_cd[k] *= -1
    # the search sorts by (i, j) already; only the images of one pair may want sorting along the given vectors
    again = np.flatnonzero((i_c[1:] == i_c[:-1]) & (j_c[1:] == j_c[:-1]))
    if len(again):
        sort = np.lexsort((*image_cd.T[::-1], j_c, i_c))
        image_cd = image_cd[sort]
    return Candidates(i_c, j_c, np.ascontiguousarray(image_cd))
