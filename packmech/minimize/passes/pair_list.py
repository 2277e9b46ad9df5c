# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Pair lists that follow moving particles, inside compiled loops.

Two lists are kept. The outer one comes from the cell search, with a wide skin. The inner one is picked from the outer
one with a narrow skin that adapts to the pace of the motion, so that nearly all of its pairs touch; it is what the loop
over pairs walks. Pairs that do not touch add nothing, and all lists are sorted by (i, j, image), pairs that cross a
face of the cell apart, so no list history changes a bit of the forces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.compiled_links import without_linked
from packmech.contacts.cells import find_pairs
from packmech.jit.compiled import device, inlined, inner_kernel

# places in PairList.number
SKIN_OUTER = 0  # every pair nearer than contact plus this, at the outer anchor, is in the outer list
SKIN_INNER = 1  # the same for the inner list and anchor
DISPLACED = 2  # bound on the largest displacement since it was last measured
BUDGET = 3  # displacement at which the inner list must be looked at again
AGE = 4  # steps since the inner list was made
SKIN_FULL = 5  # the outer skin that a new outer list gets
SEARCHES = 6  # outer lists made
BEYOND = 7  # how far beyond contact pairs act: skins begin there
NUMBERS = 8

# an inner list that lasted fewer or more steps than these gets a wider or narrower skin
_SHORT_LIFE, _LONG_LIFE = 16, 64
_NARROWEST, _WIDEST = 1.0 / 256.0, 0.4  # of the outer skin

# rows whose forces are completed, and then summed over, together
BLOCK = 256


class PairList(NamedTuple):
    """Outer and inner pairs, image vectors, the positions at which each list was made, and the numbers above.

    Inner pairs within the cell (image zero) are listed apart from those that cross its faces, so that the many need no
    image. block_b holds the first inner pair within the cell of each block of rows, and their number at its end;
    count_b the number of pairs within the cell and of those that cross.
    """

    outer_i_p: NDArray[np.uint32]
    outer_code_p: NDArray[np.uint32]
    image_kd: NDArray[np.float64]
    shift_kd: NDArray[np.float64]
    i_p: NDArray[np.uint32]
    j_p: NDArray[np.uint32]
    crossing_i_p: NDArray[np.uint32]
    crossing_j_p: NDArray[np.uint32]
    crossing_k_p: NDArray[np.uint32]
    outer_anchor_nd: NDArray[np.float64]
    anchor_nd: NDArray[np.float64]
    number: NDArray[np.float64]
    block_b: NDArray[np.int64]
    count_b: NDArray[np.int64]
    bits: int


def empty_list(particles: int, skin: float, beyond: float = 0.0) -> PairList:
    """Return a list that is out of date, so that its first use makes it.

    Parameters
    ----------
    particles
        Number of particles.
    skin
        Outer skin [length].
    beyond
        How far beyond contact pairs act on each other [length].

    """
    number = np.zeros(NUMBERS)
    number[BEYOND] = beyond
    number[SKIN_OUTER] = -1.0
    number[SKIN_FULL] = skin
    number[SKIN_INNER] = 0.25 * skin
    number[DISPLACED] = np.inf
    none = np.zeros(0, dtype=np.uint32)
    image = np.zeros((1, 3))
    far = np.zeros((particles, 3))
    block = np.zeros((particles - 1) // BLOCK + 2, dtype=np.int64)
    count = np.zeros(2, dtype=np.int64)
    return PairList(none, none, image, image, none, none, none, none, none, far, far.copy(), number, block, count, 0)


@device
def _farthest(row, anchor_nd):
    largest = 0.0
    for i in range(anchor_nd.shape[0]):
        x = row[i, 0] - anchor_nd[i, 0]
        y = row[i, 1] - anchor_nd[i, 1]
        z = row[i, 2] - anchor_nd[i, 2]
        largest = max(largest, x * x + y * y + z * z)
    return np.sqrt(largest)


@device
def anchor(row, anchor_nd):
    """Store the reference positions."""
    for i in range(anchor_nd.shape[0]):
        for a in range(3):
            anchor_nd[i, a] = row[i, a]


@device
def place_images(frame, pairs):
    """Put the images where the lattice has them."""
    for k in range(pairs.image_kd.shape[0]):
        for a in range(3):
            shift = 0.0
            for b in range(3):
                shift += frame.lattice_dd[a, b] * pairs.image_kd[k, b]
            pairs.shift_kd[k, a] = shift


@inlined
def pair_at(pairs, p):
    """Return the particles of an inner pair and the shift of its image; those within the cell come first."""
    within = pairs.count_b[0]
    if p < within:
        return pairs.i_p[p], pairs.j_p[p], 0.0, 0.0, 0.0
    c = p - within
    k = pairs.crossing_k_p[c]
    shift = pairs.shift_kd
    return pairs.crossing_i_p[c], pairs.crossing_j_p[c], shift[k, 0], shift[k, 1], shift[k, 2]


@device
def pick(axes, row, pairs, skin):
    """Copy the outer pairs nearer than contact plus skin to the inner lists and mark their blocks."""
    bits = np.uint64(pairs.bits)
    mask = np.uint64((1 << pairs.bits) - 1)
    # images are numbered from the most negative to the most positive
    none = np.uint64(pairs.image_kd.shape[0] // 2)
    reach = pairs.number[BEYOND] + skin
    within = 0
    crossing = 0
    for p in range(pairs.outer_i_p.shape[0]):
        i = pairs.outer_i_p[p]
        code = pairs.outer_code_p[p]
        j = code >> bits
        k = code & mask
        dx = row[j, 0] - row[i, 0] + pairs.shift_kd[k, 0]
        dy = row[j, 1] - row[i, 1] + pairs.shift_kd[k, 1]
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = row[j, 2] - row[i, 2] + pairs.shift_kd[k, 2]
            square += dz * dz
        limit = row[i, 3] + row[j, 3] + reach
        near = square < limit * limit
        if k == none:
            pairs.i_p[within] = i
            pairs.j_p[within] = j
            within += near
        else:
            pairs.crossing_i_p[crossing] = i
            pairs.crossing_j_p[crossing] = j
            pairs.crossing_k_p[crossing] = k
            crossing += near
    pairs.count_b[0] = within
    pairs.count_b[1] = crossing
    block = 0
    for p in range(within):
        while block * BLOCK <= pairs.i_p[p]:
            pairs.block_b[block] = p
            block += 1
    for b in range(block, pairs.block_b.shape[0]):
        pairs.block_b[b] = within


@device
def rebuilt(found, row, pairs):
    """Return a list with the outer pairs of a search, and room for as many inner ones."""
    room = found.i_p.shape[0] + 1
    none = np.uint32(found.image_kd.shape[0] // 2)
    mask = np.uint32((1 << found.bits) - 1)
    across = 1
    for p in range(room - 1):
        across += (found.code_p[p] & mask) != none
    anchor(row, pairs.outer_anchor_nd)
    pairs.number[SKIN_OUTER] = pairs.number[SKIN_FULL]
    pairs.number[SEARCHES] += 1.0
    return PairList(
        found.i_p,
        found.code_p,
        found.image_kd,
        np.empty_like(found.image_kd),
        np.empty(room, np.uint32),
        np.empty(room, np.uint32),
        np.empty(across, np.uint32),
        np.empty(across, np.uint32),
        np.empty(across, np.uint32),
        pairs.outer_anchor_nd,
        pairs.anchor_nd,
        pairs.number,
        pairs.block_b,
        pairs.count_b,
        found.bits,
    )


@device
def adapt_skin(number):
    """Widen the inner skin after a short life of the list, narrow it after a long one."""
    full = number[SKIN_FULL]
    if number[AGE] < _SHORT_LIFE:
        number[SKIN_INNER] *= 1.5
        if number[SKIN_INNER] > _WIDEST * full:
            # the outer list would not outlive one or two inner ones: let both be one
            number[SKIN_INNER] = full
    elif number[AGE] > _LONG_LIFE:
        number[SKIN_INNER] = min(max(number[SKIN_INNER] / 1.5, _NARROWEST * full), _WIDEST * full)


@device
def is_stale(pairs, distance):
    """Count a step in which no particle moved farther than the distance; return whether the list may be stale."""
    pairs.number[DISPLACED] += distance
    pairs.number[AGE] += 1.0
    return pairs.number[DISPLACED] > pairs.number[BUDGET]


@inner_kernel
def follow(axes, row, space, pairs):
    """Return a pair list that is valid at the positions in row, remade only as far as it must be."""
    number = pairs.number
    if number[DISPLACED] < np.inf:
        moved = _farthest(row, pairs.anchor_nd)
        if moved < 0.375 * number[SKIN_INNER]:
            # the bound added up the lengths of all steps; the true displacement leaves room
            number[DISPLACED] = 0.0
            number[BUDGET] = 0.5 * number[SKIN_INNER] - moved
            return pairs
        adapt_skin(number)
    if 2.0 * _farthest(row, pairs.outer_anchor_nd) + number[SKIN_INNER] > number[SKIN_OUTER]:
        reach = number[BEYOND] + number[SKIN_FULL]
        found = find_pairs(axes, row[: pairs.anchor_nd.shape[0]], space.sizes, space.frame, 1.0, reach)
        pairs = rebuilt(without_linked(space.bonded, without_linked(space.links, found)), row, pairs)
    place_images(space.frame, pairs)
    pick(axes, row, pairs, number[SKIN_INNER])
    anchor(row, pairs.anchor_nd)
    number[DISPLACED] = 0.0
    number[BUDGET] = 0.5 * number[SKIN_INNER]
    number[AGE] = 0.0
    return pairs


def strain_list(pairs: PairList, map_dd: NDArray[np.float64], largest: float) -> None:
    """Carry the list over to particles that moved anyhow, in a box that was mapped by the (d, d) matrix map_dd.

    Distances shrink at most by the smallest singular value s of the map, so that the outer list still holds every pair
    nearer than contact plus s * skin - (1 - s) * largest contact distance at the mapped anchors.
    """
    d, largest = len(map_dd), largest + pairs.number[BEYOND]
    pairs.outer_anchor_nd[:, :d] = pairs.outer_anchor_nd[:, :d] @ map_dd.T
    shrink = min(1.0, float(np.linalg.svd(map_dd, compute_uv=False)[-1]))
    pairs.number[SKIN_OUTER] = shrink * pairs.number[SKIN_OUTER] - (1.0 - shrink) * largest
    pairs.number[DISPLACED] = np.inf
