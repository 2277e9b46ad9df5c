# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Pair lists that follow moving particles, inside compiled loops, and the walk over them.

Two lists are kept. The outer one comes from the cell search, with a wide skin. The inner one is picked from the outer
one with a narrow skin that adapts to the pace of the motion, so that nearly all of its pairs touch; it is what loops
over pairs walk. Pairs that do not touch add nothing, and all lists are sorted, so no list history changes a bit of the
forces.

Rows belong to blocks, which threads share: as many as the number of rows says, so that any number of threads gives the
same bits; one for minimizers where rows are few, and in scenes that one thread walks. A block's pairs are those of its
rows i, sorted by (i, j, image): first the plain ones, whose j lies in the same block and whose image is zero, so that
the many need no image, then the special ones. What a special pair does to a row of another block goes to a slot, a row
of its own; slots are emptied into the forces of each block, in the order of their pairs, after all that fill them have
been walked.

In a box that deforms the affine part of the motion is subtracted, and a pair stays in a list as long as the peculiar
displacements since it was built, and what the strain did to a distance, leave room in the skin. Lists may carry numbers
of their pairs along, the displacements of tangential springs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.compiled_links import LinkedPairs, without_linked
from packmech.contacts.cells import Frame, PairTable, Sizes, find_pairs
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, inner_kernel, inner_lean

# places in PairList.number
SKIN_OUTER = 0  # every pair nearer than contact plus this, at the outer anchor, is in the outer list
SKIN_INNER = 1  # the same for the inner list and anchor
DISPLACED = 2  # bound on the largest displacement since it was last measured
BUDGET = 3  # displacement at which the inner list must be looked at again
AGE = 4  # steps since the inner list was made
SKIN_FULL = 5  # the outer skin that a new outer list gets
BEYOND = 6  # how far beyond contact pairs act: skins begin there
BENT = 7  # half of what free strains may have taken from distances since the inner list was made
NUMBERS = 8

# which anchor of a list a strain is counted from
INNER, OUTER = 0, 1

# an inner list that lasted fewer or more steps than these gets a wider or narrower skin
_SHORT_LIFE, _LONG_LIFE = 16, 64
_NARROWEST, _WIDEST = 1.0 / 256.0, 0.4  # of the outer skin

# slot of a pair whose two rows belong to one block
NO_SLOT = np.uint32(0xFFFFFFFF)

# blocks, at most, and rows of one, at least: of time steps, in which contacts take long; minimizers' are larger
_BLOCKS, _ROWS = 32, 320
# numbers that a pass may add up in a block: a cache line
_SUMS = 8


class Space(NamedTuple):
    """The surroundings of particles, which all of them share; parts that a scene lacks are None.

    sizes and box; links; bonds, whose pairs are no contacts; how the box deforms; in an array of one number, the
    resolution of positions, rounding times extent; and which rows are held, pairs of which push nothing.
    """

    sizes: Sizes
    frame: Frame
    links: Any = None
    bonds: Any = None
    flow: Any = None
    resolution: Any = None
    held: Any = None


class Slots(NamedTuple):
    """Rows of forces and torques on the way to other blocks: the row of each, and the first slot of each block.

    next_b is room to deal them out in.
    """

    push_qk: NDArray[np.float64]
    row_q: NDArray[np.uint32]
    start_b: NDArray[np.int64]
    next_b: NDArray[np.int64]


class PairList(NamedTuple):
    """Outer and inner pairs, images, the positions at which each list was made, and the numbers above.

    row_b holds the first row of each block; start_s the first inner pair of each section, plain and special ones of
    each block in turn, outer_start_s the same of the outer list. place_p is the place of an inner pair in the outer
    list. image_p and slot_p are set for special pairs only. sum_bk is room for what a pass adds up in each block.
    """

    row_b: NDArray[np.int64]
    outer_i_p: NDArray[np.uint32]
    outer_code_p: NDArray[np.uint32]
    outer_start_s: NDArray[np.int64]
    i_p: NDArray[np.uint32]
    j_p: NDArray[np.uint32]
    place_p: NDArray[np.uint32]
    image_p: NDArray[np.uint32]
    slot_p: NDArray[np.uint32]
    start_s: NDArray[np.int64]
    slots: Slots
    sum_bk: NDArray[np.float64]
    image_kd: NDArray[np.float64]
    shift_kd: NDArray[np.float64]
    outer_anchor_nd: NDArray[np.float64]
    anchor_nd: NDArray[np.float64]
    number: NDArray[np.float64]
    bits: int


def blocks_of(rows: int, least: int = _ROWS) -> NDArray[np.int64]:
    """Return the first row of each block of so many rows, and at the end their number.

    Parameters
    ----------
    rows
        Number of rows.
    least
        Rows of a block, at least, where there are several.

    """
    blocks = max(1, min(_BLOCKS, rows // least))
    return np.arange(blocks + 1, dtype=np.int64) * rows // blocks


def empty_slots(blocks: int, width: int) -> Slots:
    """Return no slots, for so many blocks."""
    first = np.zeros(blocks + 1, dtype=np.int64)
    return Slots(np.zeros((0, width)), np.zeros(0, dtype=np.uint32), first, np.zeros(blocks, dtype=np.int64))


def empty_list(
    rows: int, skin: float, beyond: float = 0.0, *, row_b: NDArray[np.int64] | None = None, width: int = 0
) -> PairList:
    """Return a list that is out of date, so that its first use makes it.

    Parameters
    ----------
    rows
        Number of particles.
    skin
        Outer skin [length].
    beyond
        How far beyond contact pairs act on each other [length].
    row_b
        The first row of each block, and at the end the number of rows; None: one block.
    width
        Forces and torques of a row: numbers in a slot.

    """
    number = np.zeros(NUMBERS)
    number[BEYOND] = beyond
    number[SKIN_OUTER] = -1.0
    number[SKIN_FULL] = skin
    number[SKIN_INNER] = 0.25 * skin
    number[DISPLACED] = np.inf
    row = np.array([0, rows], dtype=np.int64) if row_b is None else row_b
    blocks = len(row) - 1
    none = np.zeros(0, dtype=np.uint32)
    start = np.zeros(2 * blocks + 1, dtype=np.int64)
    image = np.zeros((1, 3))
    far = np.zeros((rows, 3))
    return PairList(
        row,
        *(none, none, start, none, none, none, none, none, start.copy()),
        empty_slots(blocks, width),
        np.zeros((blocks, _SUMS)),
        image,
        image.copy(),
        far,
        far.copy(),
        number,
        0,
    )


# the walk: every listed pair of a range is visited with a visitor, a record whose class says what is done with the
# pair: forces are added to rows, observables summed up, contacts written one by one. It hands a value from pair to
# pair, which the visitor may change.


class Pair(NamedTuple):
    """A listed pair: its place, rows, slot (NO_SLOT within a block), and the vector between the centers."""

    p: Any
    i: Any
    j: Any
    slot: Any
    dx: float
    dy: float
    dz: float


class InnerPairs(NamedTuple):
    """What a walk needs of a pair list: short enough to be handed on in every pass."""

    i_p: NDArray[np.uint32]
    j_p: NDArray[np.uint32]
    image_p: NDArray[np.uint32]
    slot_p: NDArray[np.uint32]
    shift_kd: NDArray[np.float64]


@inlined
def inner_pairs(pairs):
    """Return what a walk needs of a pair list."""
    return InnerPairs(pairs.i_p, pairs.j_p, pairs.image_p, pairs.slot_p, pairs.shift_kd)


def _not_in_python(visitor: Any, laws: Any, pair: Pair, value: Any) -> Any:
    raise NotImplementedError("pairs are visited in compiled loops")


# the value after the visit of a pair; visitors are records, and their class says what is done:
# (visitor, laws, pair, value) -> value
visit = by_type(_not_in_python)


@inlined
def walk_range(visitor, laws, pairs, first, special, last, value):
    """Visit listed pairs one after another, from the place `special` on with images; return the value after the last.

    `laws` is a record with the axes and the rows, as `body`, and what else visitors need.
    """
    axes, body = laws.axes, laws.body
    i_p, j_p, image_p, slot_p, shift_kd = pairs.i_p, pairs.j_p, pairs.image_p, pairs.slot_p, pairs.shift_kd
    from_here = np.uint64(special)
    # unsigned, so that no index can count from the end
    for p in range(np.uint64(first), np.uint64(last)):
        i, j, slot = i_p[p], j_p[p], NO_SLOT
        dx = body[j, 0] - body[i, 0]
        dy = body[j, 1] - body[i, 1]
        dz = 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
        if p >= from_here:
            k, slot = image_p[p], slot_p[p]
            dx += shift_kd[k, 0]
            dy += shift_kd[k, 1]
            if len(axes) == 3:
                dz += shift_kd[k, 2]
        value = visit(visitor, laws, Pair(p, i, j, slot, dx, dy, dz), value)
    return value


# the same for kernels that count references to arrays: to count in every walk would cost more than its pairs
walk = inner_lean(walk_range)


@inlined
def walk_pairs(visitor, laws, pairs, b, value):
    """Visit the listed pairs of a block's rows, one after another; return the value after the last."""
    start = pairs.start_s
    return walk_range(visitor, laws, pairs, start[2 * b], start[2 * b + 1], start[2 * b + 2], value)


@device
def walk_blocks(visitor, laws, pairs, value):
    """Visit all listed pairs, block by block; return the value after the last."""
    start, listed = pairs.start_s, inner_pairs(pairs)
    for b in range(pairs.row_b.shape[0] - 1):
        value = walk(visitor, laws, listed, start[2 * b], start[2 * b + 1], start[2 * b + 2], value)
    return value


@inlined
def is_near(laws, pair):
    """Whether rows may touch, as discs and spheres that are so near do."""
    square = pair.dx * pair.dx + pair.dy * pair.dy
    if len(laws.axes) == 3:
        square += pair.dz * pair.dz
    reach = laws.body[pair.i, 3] + laws.body[pair.j, 3]
    return square < reach * reach


@device
def first_pair_of(i_p, low, high, row):
    """Return the first place from low to high, at most high, where sorted i are this row or a later one."""
    while low < high:
        middle = (low + high) // 2
        if i_p[middle] < row:
            low = middle + 1
        else:
            high = middle
    return low


# how lists are made


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


@device
def block_of(row_b, i):
    """Return the block of a row."""
    blocks = row_b.shape[0] - 1
    b = i * blocks // row_b[blocks]
    while row_b[b] > i:
        b -= 1
    while row_b[b + 1] <= i:
        b += 1
    return b


@device
def _rebuilt(found, row, old):
    """Return lists with the outer pairs of a search in sections, and room for as many inner ones.

    Arrays come from `np.empty` alone, as in the search.
    """
    row_b = old.row_b
    blocks = row_b.shape[0] - 1
    total = found.i_p.shape[0]
    bits = np.uint64(found.bits)
    mask = np.uint64((1 << found.bits) - 1)
    # images are numbered from the most negative to the most positive
    none = np.uint64(found.image_kd.shape[0] // 2)
    outer_i = np.empty(total, np.uint32)
    outer_code = np.empty(total, np.uint32)
    start = np.empty(2 * blocks + 1, np.int64)
    far = 0
    first = 0
    put = 0
    for b in range(blocks):
        last = first
        while last < total and found.i_p[last] < row_b[b + 1]:
            last += 1
        for special in range(2):
            start[2 * b + special] = put
            for p in range(first, last):
                j = found.code_p[p] >> bits
                away = j >= row_b[b + 1]
                if (away or found.code_p[p] & mask != none) == (special == 1):
                    outer_i[put] = found.i_p[p]
                    outer_code[put] = found.code_p[p]
                    put += 1
                    far += away
        first = last
    start[2 * blocks] = put
    anchor(row, old.outer_anchor_nd)
    old.number[SKIN_OUTER] = old.number[SKIN_FULL]
    width = old.slots.push_qk.shape[1]
    return PairList(
        row_b,
        outer_i,
        outer_code,
        start,
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(2 * blocks + 1, np.int64),
        Slots(
            np.empty((far, width)), np.empty(far, np.uint32), np.empty(blocks + 1, np.int64), np.empty(blocks, np.int64)
        ),
        old.sum_bk,
        found.image_kd,
        np.empty((found.image_kd.shape[0], 3)),
        old.outer_anchor_nd,
        old.anchor_nd,
        old.number,
        found.bits,
    )


@device
def _pick(axes, row, pairs, skin):
    """Copy the outer pairs nearer than contact plus skin to the inner lists, and deal out the slots."""
    bits = np.uint64(pairs.bits)
    mask = np.uint64((1 << pairs.bits) - 1)
    row_b, slots = pairs.row_b, pairs.slots
    blocks = row_b.shape[0] - 1
    put, reach = 0, pairs.number[BEYOND] + skin
    for b in range(blocks + 1):
        slots.start_b[b] = 0
    for s in range(2 * blocks):
        pairs.start_s[s] = put
        b = s // 2
        for p in range(pairs.outer_start_s[s], pairs.outer_start_s[s + 1]):
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
            pairs.i_p[put] = i
            pairs.j_p[put] = j
            pairs.place_p[put] = p
            near = square < limit * limit
            if s % 2 == 1:
                pairs.image_p[put] = k
                pairs.slot_p[put] = NO_SLOT
                if near and j >= row_b[b + 1]:
                    other = block_of(row_b, np.int64(j))
                    pairs.slot_p[put] = other
                    slots.start_b[other + 1] += 1
            put += near
    pairs.start_s[2 * blocks] = put
    _assign_slots(pairs)


@device
def _assign_slots(pairs):
    """Sort the slots by the block that gets them; until then a pair's slot holds that block, and start_b counts."""
    slots = pairs.slots
    blocks = slots.start_b.shape[0] - 1
    next_b = slots.next_b
    for b in range(blocks):
        slots.start_b[b + 1] += slots.start_b[b]
        next_b[b] = slots.start_b[b]
    for b in range(blocks):
        for p in range(pairs.start_s[2 * b + 1], pairs.start_s[2 * b + 2]):
            other = pairs.slot_p[p]
            if other != NO_SLOT:
                q = next_b[other]
                next_b[other] += 1
                pairs.slot_p[p] = q
                slots.row_q[q] = pairs.j_p[p]


@inlined
def collect(axes, spins, slots, push, b):
    """Add what other blocks did to the rows of a block to their forces and, where they have spins, torques."""
    row_q, push_qk = slots.row_q, slots.push_qk
    for q in range(np.uint64(slots.start_b[b]), np.uint64(slots.start_b[b + 1])):
        i = row_q[q]
        for a in range(len(axes) + len(spins)):
            push[i, a] += push_qk[q, a]


@device
def _without_bonded(bonds, found):
    kept = 0
    mask = np.uint64((1 << found.bits) - 1)
    bits = np.uint64(found.bits)
    for p in range(found.i_p.shape[0]):
        i = np.int64(found.i_p[p])
        j = np.int64(found.code_p[p] >> bits)
        k = np.int64(found.code_p[p] & mask)
        bonded = False
        for s in range(bonds.start_n[i], bonds.start_n[i + 1]):
            if bonds.other_s[s] == j:
                same = True
                for a in range(3):
                    same = same and bonds.image_sd[s, a] == found.image_kd[k, a]
                bonded = bonded or same
        if not bonded:
            found.i_p[kept] = found.i_p[p]
            found.code_p[kept] = found.code_p[p]
            kept += 1
    return PairTable(found.i_p[:kept], found.code_p[:kept], found.image_kd, found.bits)


# the pairs of a search that are not bonded
without_bonded = by_type(
    _without_bonded,
    {type(None): lambda bonds, found: found, LinkedPairs: lambda bonds, found: without_linked(bonds, found)},
)


@device
def _without_held(held_n, found):
    kept = 0
    bits = np.uint64(found.bits)
    for p in range(found.i_p.shape[0]):
        if not (held_n[found.i_p[p]] and held_n[np.int64(found.code_p[p] >> bits)]):
            found.i_p[kept] = found.i_p[p]
            found.code_p[kept] = found.code_p[p]
            kept += 1
    return PairTable(found.i_p[:kept], found.code_p[:kept], found.image_kd, found.bits)


# the pairs of a search of which one particle at least is free
without_held = by_type(_without_held, {type(None): lambda held_n, found: found})


# numbers of pairs that lists carry along


class Track(NamedTuple):
    """Numbers of the inner pairs and of the outer ones: the stretches of their tangential springs."""

    inner_pk: NDArray[np.float64]
    outer_pk: NDArray[np.float64]


def _nothing(track: None, pairs: Any) -> None:
    return None


@device
def _store(track, pairs):
    for p in range(pairs.start_s[-1]):
        for a in range(track.outer_pk.shape[1]):
            track.outer_pk[pairs.place_p[p], a] = track.inner_pk[p, a]


@device
def _load(track, pairs):
    for p in range(pairs.start_s[-1]):
        for a in range(track.outer_pk.shape[1]):
            track.inner_pk[p, a] = track.outer_pk[pairs.place_p[p], a]


@device
def _carried(track, old, new):
    size = track.outer_pk.shape[1]
    outer = np.zeros((new.outer_i_p.shape[0], size))
    old_bits, new_bits = np.uint64(old.bits), np.uint64(new.bits)
    old_mask, new_mask = np.uint64((1 << old.bits) - 1), np.uint64((1 << new.bits) - 1)
    # a pair stays in its section: blocks are fixed, and images change only where all lists are given up
    for s in range(old.outer_start_s.shape[0] - 1):
        first = new.outer_start_s[s]
        last = new.outer_start_s[s + 1]
        for p in range(old.outer_start_s[s], old.outer_start_s[s + 1]):
            stretched = False
            for a in range(size):
                stretched = stretched or track.outer_pk[p, a] != 0.0
            if not stretched:
                continue
            i = old.outer_i_p[p]
            j = old.outer_code_p[p] >> old_bits
            k = np.int64(old.outer_code_p[p] & old_mask)
            while first < last and new.outer_i_p[first] < i:
                first += 1
            q = first
            while q < last and new.outer_i_p[q] == i:
                if new.outer_code_p[q] >> new_bits == j:
                    m = np.int64(new.outer_code_p[q] & new_mask)
                    same = True
                    for a in range(3):
                        same = same and old.image_kd[k, a] == new.image_kd[m, a]
                    if same:
                        for a in range(size):
                            outer[q, a] = track.outer_pk[p, a]
                q += 1
    return Track(np.zeros((new.i_p.shape[0], size)), outer)


# write the numbers of the inner pairs to their places in the outer list; fetch those of newly picked ones from there
store_track = by_type(_nothing, {Track: _store})
load_track = by_type(_nothing, {Track: _load})
# the numbers for a new outer list, those of pairs that were in the old one kept
carried_track = by_type(lambda track, old, new: None, {Track: _carried})


# boxes that deform: their class has forms of its own


@device
def _farthest(flow, row, anchor_nd, since):
    largest = 0.0
    for i in range(anchor_nd.shape[0]):
        x = row[i, 0] - anchor_nd[i, 0]
        y = row[i, 1] - anchor_nd[i, 1]
        z = row[i, 2] - anchor_nd[i, 2]
        largest = max(largest, x * x + y * y + z * z)
    return math.sqrt(largest)


# half of what the strain since an anchor can take from the distance of a pair this far apart [length]
strained = by_type(lambda flow, since, largest: 0.0)
# the largest displacement from an anchor that did not go with the box [length]
displaced = by_type(_farthest)
# stores the strain at which an anchor was set
mark_strain = by_type(lambda flow, since: None)


# when lists are stale, and what is done then


@device
def largest_contact(sizes):
    """Return the largest contact distance."""
    largest = 0.0
    for a in range(sizes.largest_a.shape[0]):
        largest = max(largest, sizes.largest_a[a])
    return 2.0 * largest


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
def is_stale(number, distance):
    """Count a step in which no particle moved farther than the distance; return whether the list may be stale.

    `number` is that of the list. What is not a number is left to the forces, which show it.
    """
    number[DISPLACED] += distance
    number[AGE] += 1.0
    return number[DISPLACED] > number[BUDGET]


@inlined
def is_stale_strained(flow, number, reach, moved):
    """Return the same in a box that may deform; `reach` is the largest contact distance.

    What is not a number is too far.
    """
    number[DISPLACED] += moved
    number[AGE] += 1.0
    reach += number[BEYOND]
    bent = strained(flow, INNER, reach + number[SKIN_INNER])
    # displacements since the anchor were strained themselves
    return not number[DISPLACED] * (1.0 + 2.0 * bent / reach) + bent <= number[BUDGET]


@inner_lean
def _pick_anew(axes, row, space, pairs, track):
    """Pick the inner pairs again at the present positions; their stretches are in the outer list."""
    number = pairs.number
    place_images(space.frame, pairs)
    _pick(axes, row, pairs, number[SKIN_INNER])
    load_track(track, pairs)
    anchor(row, pairs.anchor_nd)
    mark_strain(space.flow, INNER)
    number[DISPLACED] = 0.0
    number[BUDGET] = 0.5 * number[SKIN_INNER]
    number[BENT] = 0.0
    number[AGE] = 0.0


@inner_lean
def update_lists(axes, row, space, pairs, track):
    """Make stale lists valid; return whether that takes a new search, as does who asks again before it is made."""
    number = pairs.number
    flow = space.flow
    reach = largest_contact(space.sizes) + number[BEYOND]
    if number[DISPLACED] < np.inf:
        room = 0.5 * number[SKIN_INNER]
        bent = strained(flow, INNER, reach + number[SKIN_INNER])
        gone = displaced(flow, row, pairs.anchor_nd, INNER) + number[BENT]
        if gone + bent < 0.75 * room:
            # the bound added up the lengths of all steps; the true displacement leaves room
            number[DISPLACED] = 0.0
            number[BUDGET] = room - gone
            return False
        adapt_skin(number)
    gone = displaced(flow, row, pairs.outer_anchor_nd, OUTER)
    gone += strained(flow, OUTER, reach + number[SKIN_FULL])
    if 2.0 * gone + number[SKIN_INNER] > number[SKIN_OUTER]:
        number[DISPLACED] = np.inf
        return True
    store_track(track, pairs)
    _pick_anew(axes, row, space, pairs, track)
    return False


@inner_kernel
def follow(axes, row, space, pairs, track):
    """Return lists that are valid at the positions in row, remade only as far as they must be, and their track."""
    if not update_lists(axes, row, space, pairs, track):
        return pairs, track
    store_track(track, pairs)
    reach = pairs.number[BEYOND] + pairs.number[SKIN_FULL]
    found = find_pairs(axes, row[: pairs.anchor_nd.shape[0]], space.sizes, space.frame, 1.0, reach)
    found = without_linked(space.links, without_bonded(space.bonds, without_held(space.held, found)))
    new = _rebuilt(found, row, pairs)
    track = carried_track(track, pairs, new)
    mark_strain(space.flow, OUTER)
    _pick_anew(axes, row, space, new, track)
    return new, track


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


def listed_pairs(pairs: PairList) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return i, j and images of the inner pairs."""
    start = pairs.start_s
    total = int(start[-1])
    image = np.zeros((total, 3), dtype=np.int64)
    special = np.repeat(np.arange(len(start) - 1) % 2 == 1, np.diff(start))
    image[special] = np.rint(pairs.image_kd[pairs.image_p[:total][special]]).astype(np.int64)
    return pairs.i_p[:total].astype(np.int64), pairs.j_p[:total].astype(np.int64), image
