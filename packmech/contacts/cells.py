# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The cell search, compiled: pairs near enough to test, in two flat lists sorted by (i, j, image).

Arrays come from `np.empty` alone: each other way to make one, and each other type and number of axes, would be compiled
by itself.

Particles are sorted into levels of size, a factor of two apart, each with its own grid of cells; a particle looks into
the grid of its own level and of every coarser one, so a few large particles do not make the cells of the small ones
large.

A row holds x, y, z and radius in its first four columns (z = 0 in two dimensions). Neighbor and image share one word,
`code = (j << bits) | k`, where row k of a table is the image: the loop over pairs then needs no rounding to the
nearest image.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.jit.compiled import device, inner_kernel

# a particle more than 2^16 times smaller than the largest shares the last level
_MAX_LEVELS = 16


class Sizes(NamedTuple):
    """Level of each particle (0 the coarsest), and largest radius and number of particles of each level."""

    level_n: NDArray[np.int64]
    largest_a: NDArray[np.float64]
    count_a: NDArray[np.int64]


class Frame(NamedTuple):
    """A box in three dimensions as the compiled loops take it: lattice, its inverse, and the distances between faces.

    A plane has the third vector (0, 0, 1), along which nothing repeats.
    """

    lattice_dd: NDArray[np.float64]
    inverse_dd: NDArray[np.float64]
    height_d: NDArray[np.float64]


class PairTable(NamedTuple):
    """Pairs (i, code), the images that code refers to, and the number of bits of the image's place in code."""

    i_p: NDArray[np.uint32]
    code_p: NDArray[np.uint32]
    image_kd: NDArray[np.float64]
    bits: int


def size_levels(radius_n: NDArray[np.float64]) -> Sizes:
    """Return the levels of size, a factor of two apart.

    Parameters
    ----------
    radius_n
        (N,) radii [length].

    """
    level = np.clip(np.floor(np.log2(radius_n.max() / radius_n)), 0, _MAX_LEVELS - 1).astype(np.int64)
    levels = int(level.max()) + 1
    largest = np.zeros(levels)
    np.maximum.at(largest, level, radius_n)
    return Sizes(level, largest, np.bincount(level, minlength=levels).astype(np.int64))


def frame_of(box: Box) -> Frame:
    """Return the box as compiled loops take it; reduce it first (`box.reduced()`) when it may be tilted.

    Parameters
    ----------
    box
        The periodic box.

    """
    d = box.dimension
    lattice, inverse, height = np.eye(3), np.eye(3), np.ones(3)
    lattice[:d, :d] = box.lattice_dd
    inverse[:d, :d] = box.inverse_dd
    height[:d] = box.height_d
    return Frame(lattice, inverse, height)


@device
def set_frame(frame, lattice_dd):
    """Write the lattice, its inverse and the distances between faces into the frame."""
    a = lattice_dd
    inverse = frame.inverse_dd
    for i in range(3):
        for j in range(3):
            frame.lattice_dd[i, j] = a[i, j]
            p, q = (j + 1) % 3, (j + 2) % 3
            r, s = (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    for i in range(3):
        square = 0.0
        for j in range(3):
            inverse[i, j] /= determinant
            square += inverse[i, j] * inverse[i, j]
        frame.height_d[i] = 1.0 / math.sqrt(square)


@device
def lattice_volume(lattice_dd):
    """Return the volume of a cell."""
    a = lattice_dd
    return abs(
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


@device
def sort_row(value, low, high):
    """Sort value[low:high] in place: insertion for short rows, Shell's gaps for the long rows of large particles."""
    gap = 1
    while gap < (high - low) // 9:
        gap = 3 * gap + 1
    while gap > 0:
        for p in range(low + gap, high):
            key = value[p]
            q = p - gap
            while q >= low and value[q] > key:
                value[q + gap] = value[q]
                q -= gap
            value[q + gap] = key
        gap //= 3


@device
def _wrap(axes, row, frame):
    """Return fractions in [0, 1), wrapped points with radius, whole lattice steps taken away, and their spread."""
    d = len(axes)
    n = row.shape[0]
    fraction = np.empty((n, 3))
    point = np.empty((n, 4))
    step = np.empty((n, 3), np.int32)
    smallest = np.empty(3, np.int64)
    largest = np.empty(3, np.int64)
    for k in range(3):
        smallest[k] = largest[k] = 0
    for i in range(n):
        for k in range(d, 3):
            fraction[i, k] = point[i, k] = 0.0
            step[i, k] = 0
        for k in range(d):
            raw = 0.0
            for m in range(d):
                raw += frame.inverse_dd[k, m] * row[i, m]
            whole = np.floor(raw)
            fraction[i, k] = min(raw - whole, 1.0 - 1e-16)
            step[i, k] = int(whole)
            if i == 0 or step[i, k] < smallest[k]:
                smallest[k] = step[i, k]
            if i == 0 or step[i, k] > largest[k]:
                largest[k] = step[i, k]
        for k in range(d):
            x = row[i, k]
            for m in range(d):
                x -= frame.lattice_dd[k, m] * step[i, m]
            point[i, k] = x
        point[i, 3] = row[i, 3]
    for k in range(3):
        largest[k] -= smallest[k]
    return fraction, point, step, largest


@device
def _grids(axes, sizes, frame, scale, skin):
    """Return the cells of each level's grid along each lattice vector, as wide as its pairs reach."""
    d = len(axes)
    levels = sizes.count_a.shape[0]
    cells = np.empty((levels, 3), np.int64)
    for a in range(levels):
        for k in range(3):
            cells[a, k] = 1
        if sizes.count_a[a] > 0:
            width = scale * 2.0 * sizes.largest_a[a] + skin
            product = 1.0
            for k in range(d):
                product *= max(frame.height_d[k] / width, 1.0)
            crowd = max(1.0, (product / (2.0 * sizes.count_a[a])) ** (1.0 / d))
            for k in range(d):
                cells[a, k] = max(1, int(min(frame.height_d[k] / (width * crowd), 1048576.0)))
    return cells


@device
def _fill(sizes, cells, fraction, point):
    """Sort particles into cells by counting.

    Return the first cell of each level; the first place of each cell, and at the end their number; the particle at each
    place, and its point. Cells that follow each other along the first lattice vector follow each other here.
    """
    n = fraction.shape[0]
    levels = cells.shape[0]
    first = np.empty(levels + 1, np.int64)
    first[0] = 0
    for a in range(levels):
        first[a + 1] = first[a] + cells[a, 0] * cells[a, 1] * cells[a, 2]
    cell_n = np.empty(n, np.int32)
    start = np.empty(first[levels] + 2, np.int32)
    for c in range(start.shape[0]):
        start[c] = 0
    for i in range(n):
        a = sizes.level_n[i]
        c0 = min(int(fraction[i, 0] * cells[a, 0]), cells[a, 0] - 1)
        c1 = min(int(fraction[i, 1] * cells[a, 1]), cells[a, 1] - 1)
        c2 = min(int(fraction[i, 2] * cells[a, 2]), cells[a, 2] - 1)
        cell_n[i] = first[a] + c0 + cells[a, 0] * (c1 + cells[a, 1] * c2)
        start[cell_n[i] + 2] += 1
    for c in range(first[levels]):
        start[c + 2] += start[c + 1]
    order = np.empty(n, np.int32)
    placed = np.empty((n, 4))
    for i in range(n):
        place = start[cell_n[i] + 1]
        start[cell_n[i] + 1] += 1
        order[place] = i
        for k in range(4):
            placed[place, k] = point[i, k]
    return first, start, order, placed


@device
def _images(axes, sizes, frame, scale, skin, spread):
    """Return the largest image number along each vector that the longest reach and unwrapped positions can ask for."""
    widest = 0.0
    for a in range(sizes.largest_a.shape[0]):
        widest = max(widest, sizes.largest_a[a])
    reach = scale * 2.0 * widest + skin
    largest = np.empty(3, np.int64)
    for k in range(3):
        largest[k] = 0
    for k in range(len(axes)):
        largest[k] = int(reach / frame.height_d[k] + 1e-9) + 1 + spread[k]
    return largest


@device
def _turns(cell, cells):
    """Return how often a cell's number wraps round: its floor quotient, without a division where there is no need."""
    if cell < 0 or cell >= cells:
        return cell // cells
    return 0


@device
def _scan(axes, row, sizes, frame, scale, skin, grid, largest, bits, i_p, code_p):
    """Write the pairs, row by row, as far as they fit; return their number."""
    d = len(axes)
    n = row.shape[0]
    lattice = frame.lattice_dd
    fraction, point, step, cells, first, start, order, placed = grid
    n1 = 2 * largest[1] + 1
    n2 = 2 * largest[2] + 1
    found = 0
    hit = np.empty(n + 1, np.int32)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for k in range(3):
        low[k] = high[k] = 0
    for i in range(n):
        begin = found
        xi, yi, zi, ri = point[i, 0], point[i, 1], point[i, 2], point[i, 3]
        for a in range(cells.shape[0]):
            if sizes.count_a[a] == 0:
                continue
            reach = scale * (ri + sizes.largest_a[a]) + skin
            for k in range(d):
                width = reach / frame.height_d[k] * cells[a, k] + 1e-9
                low[k] = int(np.floor(fraction[i, k] * cells[a, k] - width))
                high[k] = int(np.floor(fraction[i, k] * cells[a, k] + width))
            for c2 in range(low[2], high[2] + 1):
                s2 = _turns(c2, cells[a, 2])
                for c1 in range(low[1], high[1] + 1):
                    s1 = _turns(c1, cells[a, 1])
                    line = first[a] + cells[a, 0] * ((c1 - s1 * cells[a, 1]) + cells[a, 1] * (c2 - s2 * cells[a, 2]))
                    c0 = low[0]
                    while c0 <= high[0]:
                        # cells up to the face of the box form one run of places
                        s0 = _turns(c0, cells[a, 0])
                        last = min(high[0], (s0 + 1) * cells[a, 0] - 1)
                        run = line + c0 - s0 * cells[a, 0]
                        ox = lattice[0, 0] * s0 + lattice[0, 1] * s1 + lattice[0, 2] * s2 - xi
                        oy = lattice[1, 0] * s0 + lattice[1, 1] * s1 + lattice[1, 2] * s2 - yi
                        oz = lattice[2, 0] * s0 + lattice[2, 1] * s1 + lattice[2, 2] * s2 - zi
                        hits = 0
                        for place in range(start[run], start[run + last - c0 + 1]):
                            dx = placed[place, 0] + ox
                            dy = placed[place, 1] + oy
                            square = dx * dx + dy * dy
                            if d == 3:
                                dz = placed[place, 2] + oz
                                square += dz * dz
                            limit = scale * (ri + placed[place, 3]) + skin
                            j = order[place]
                            hit[hits] = j
                            hits += (square <= limit * limit * (1.0 + 1e-12)) & (j >= i)
                        c0 = last + 1
                        for h in range(hits):
                            j = hit[h]
                            z0 = s0 - step[j, 0] + step[i, 0]
                            z1 = s1 - step[j, 1] + step[i, 1]
                            z2 = s2 - step[j, 2] + step[i, 2]
                            if i == j and (z0 < 0 or (z0 == 0 and (z1 < 0 or (z1 == 0 and z2 <= 0)))):
                                continue
                            if found < i_p.shape[0]:
                                i_p[found] = i
                                code_p[found] = (j << bits) | (
                                    ((largest[0] + z0) * n1 + largest[1] + z1) * n2 + largest[2] + z2
                                )
                            found += 1
        sort_row(code_p, begin, min(found, i_p.shape[0]))
    return found


@inner_kernel
def find_pairs(axes, row, sizes, frame, scale, skin):
    """Return the PairTable of all pairs, over all images, with distance <= scale * (radius_i + radius_j) + skin.

    Each pair is found once, with i < j, or i == j and the image's first nonzero component positive. `axes` is a tuple
    as long as the dimension, which is thereby known when the loop is compiled.
    """
    n = row.shape[0]
    fraction, point, step, spread = _wrap(axes, row, frame)
    cells = _grids(axes, sizes, frame, scale, skin)
    grid = (fraction, point, step, cells, *_fill(sizes, cells, fraction, point))
    largest = _images(axes, sizes, frame, scale, skin, spread)
    n1 = 2 * largest[1] + 1
    n2 = 2 * largest[2] + 1
    # in floating point, which holds products of any size
    images = 1.0
    for k in range(3):
        images *= 2.0 * largest[k] + 1.0 if largest[k] >= 0 else np.inf
    bits = 0
    while (1 << bits) < images and bits <= 24:
        bits += 1
    if bits > 24 or (n << bits) > (1 << 32):
        raise ValueError("packing must not reach over so many periodic images: the box is too small for its particles")
    table = (2 * largest[0] + 1) * n1 * n2
    image = np.empty((table, 3))
    for k in range(table):
        image[k, 0] = k // (n1 * n2) - largest[0]
        image[k, 1] = k // n2 % n1 - largest[1]
        image[k, 2] = k % n2 - largest[2]
    i_p = np.empty(6 * n + 64, np.uint32)
    code_p = np.empty(6 * n + 64, np.uint32)
    found = _scan(axes, row, sizes, frame, scale, skin, grid, largest, bits, i_p, code_p)
    if found > i_p.shape[0]:
        i_p = np.empty(found, np.uint32)
        code_p = np.empty(found, np.uint32)
        _scan(axes, row, sizes, frame, scale, skin, grid, largest, bits, i_p, code_p)
    return PairTable(i_p[:found], code_p[:found], image, bits)
