"""Candidate pairs: near enough to test, over all periodic images, for any lattice and any ratio of sizes.

The box is reduced to its shortest lattice vectors first, so that strained and tilted boxes need no more images than
compact ones. Particles are sorted into levels of size, a factor of two apart, each with its own grid of cells; a
particle looks into the grid of its own level and of every coarser one, so a few large particles do not make the cells
of the small ones large.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.compiled import kernel

# a particle more than 2^16 times smaller than the largest shares the last level
_MAX_LEVELS = 16


class Candidates(NamedTuple):
    """Pairs whose distance is at most scale * (radius_i + radius_j) + skin, each once, sorted by (i, j, image).

    image_cd refers to the positions as given: v = x_j - x_i + lattice @ image.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]


@kernel
def _search(  # type: ignore[no-untyped-def]
    fraction, position, wrap, radius, level, lattice, height, change, cells, first, count, start, order,
    scale, skin, coarsest, i_out, j_out, image_out,
):  # fmt: skip
    """Write the pairs that fit into the output arrays and return how many there are."""
    particles = radius.shape[0]
    d = position.shape[1]
    found = 0
    low = np.zeros(3, np.int64)
    high = np.zeros(3, np.int64)
    shift = np.zeros(3, np.int64)
    image = np.zeros(3, np.int64)
    for i in range(particles):
        for a in range(level[i] + 1):
            if count[a] == 0:
                continue
            reach = scale * (radius[i] + coarsest[a]) + skin
            for k in range(d):
                width = reach / height[k] * cells[a, k] + 1e-9
                low[k] = int(np.floor(fraction[i, k] * cells[a, k] - width))
                high[k] = int(np.floor(fraction[i, k] * cells[a, k] + width))
            for c0 in range(low[0], high[0] + 1):
                shift[0] = c0 // cells[a, 0]
                for c1 in range(low[1], high[1] + 1):
                    shift[1] = c1 // cells[a, 1]
                    for c2 in range(low[2], high[2] + 1):
                        shift[2] = c2 // cells[a, 2]
                        cell = (
                            first[a]
                            + (c0 - shift[0] * cells[a, 0])
                            + cells[a, 0]
                            * ((c1 - shift[1] * cells[a, 1]) + cells[a, 1] * (c2 - shift[2] * cells[a, 2]))
                        )
                        for slot in range(start[cell], start[cell + 1]):
                            j = order[slot]
                            if a == level[i] and j < i:
                                continue
                            distance2 = 0.0
                            for k in range(d):
                                v = position[j, k] - position[i, k]
                                for m in range(d):
                                    v += lattice[k, m] * shift[m]
                                distance2 += v * v
                            limit = scale * (radius[i] + radius[j]) + skin
                            if distance2 > limit * limit * (1.0 + 1e-12):
                                continue
                            for k in range(d):
                                z = 0
                                for m in range(d):
                                    z += change[k, m] * (shift[m] - wrap[j, m] + wrap[i, m])
                                image[k] = z
                            if i == j:
                                sign = 0
                                for k in range(d):
                                    if sign == 0:
                                        sign = image[k]
                                if sign <= 0:
                                    continue
                            if found < i_out.shape[0]:
                                swap = j < i
                                i_out[found] = j if swap else i
                                j_out[found] = i if swap else j
                                for k in range(d):
                                    image_out[found, k] = -image[k] if swap else image[k]
                            found += 1
    return found


@kernel
def _fill_cells(fraction, level, cells, first, start, order):  # type: ignore[no-untyped-def]
    """Sort particles into cells by counting: order[start[c]:start[c+1]] are the particles of cell c."""
    particles = level.shape[0]
    d = fraction.shape[1]
    home = np.empty(particles, np.int64)
    for i in range(particles):
        a = level[i]
        cell = 0
        for k in range(d - 1, -1, -1):
            index = min(int(fraction[i, k] * cells[a, k]), cells[a, k] - 1)
            cell = cell * cells[a, k] + index
        home[i] = first[a] + cell
        start[home[i] + 1] += 1
    for c in range(start.shape[0] - 1):
        start[c + 1] += start[c]
    fill = start[:-1].copy()
    for i in range(particles):
        order[fill[home[i]]] = i
        fill[home[i]] += 1


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
    dimension = box.dimension
    small, change = box.reduced()
    raw = position_nd @ small.inverse_dd.T
    wrap = np.floor(raw)
    fraction = np.clip(raw - wrap, 0.0, np.nextafter(1.0, 0.0))
    position = fraction @ small.lattice_dd.T

    largest = radius_n.max()
    level = np.clip(np.floor(np.log2(largest / radius_n)), 0, _MAX_LEVELS - 1).astype(np.int64)
    levels = int(level.max()) + 1
    count = np.bincount(level, minlength=levels)
    coarsest = np.zeros(levels)
    np.maximum.at(coarsest, level, radius_n)
    cells = np.ones((levels, 3), dtype=np.int64)
    for a in range(levels):
        if count[a]:
            wide = scale * 2.0 * coarsest[a] + skin
            ideal = small.height_d / max(wide, 1e-300)
            # no more than about two cells a particle, keeping their shape
            crowd = max(1.0, (np.prod(np.maximum(ideal, 1.0)) / (2.0 * count[a])) ** (1.0 / dimension))
            cells[a, :dimension] = np.maximum(1, np.floor(np.minimum(ideal / crowd, 2.0**20))).astype(np.int64)
    size = cells.prod(axis=1)
    first = np.concatenate([[0], np.cumsum(size)[:-1]])
    start = np.zeros(int(size.sum()) + 1, dtype=np.int64)
    order = np.empty(len(radius_n), dtype=np.int64)
    _fill_cells(fraction, level, cells, first, start, order)

    room = max(16, 2 ** (dimension + 1) * len(radius_n))
    while True:
        i_c = np.empty(room, dtype=np.int64)
        j_c = np.empty(room, dtype=np.int64)
        image_cd = np.empty((room, dimension), dtype=np.int64)
        found = _search(
            fraction, position, wrap.astype(np.int64), radius_n, level, small.lattice_dd, small.height_d, change,
            cells, first, count, start, order, scale, skin, coarsest, i_c, j_c, image_cd,
        )  # fmt: skip
        if found <= room:
            break
        room = found
    i_c, j_c, image_cd = i_c[:found], j_c[:found], image_cd[:found]
    sort = np.lexsort((*image_cd.T[::-1], j_c, i_c))
    return Candidates(i_c[sort], j_c[sort], image_cd[sort])
