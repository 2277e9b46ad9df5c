# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Lists of pairs that time steps walk, by fixed blocks of rows, so that any number of threads gives the same bits.

Rows belong to blocks that depend on their number alone. A block's pairs are those of its rows i, sorted by (i, j,
image): first the plain ones, whose j lies in the same block and whose image is zero, then the special ones. What a
special pair does to a row of another block goes to a slot, a row of its own; slots are emptied into the forces of each
block after all blocks have been walked, in the order of their pairs.

The lists follow a box that deforms: the affine part of the motion is subtracted, and a pair stays in a list as long as
the peculiar displacements since it was built, and what the strain did to a distance, leave room in the skin. They carry
the tangential displacements of contacts along, which can be taken out by pair and image where lists are rebuilt.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.constraints.compiled_links import without_linked
from packmech.contacts.cells import PairTable, find_pairs
from packmech.dynamics.deformation import (
    ANCHORED,
    BENDING,
    GAMMA,
    OUTER_ANCHORED,
    bending,
    entries,
    map_between,
)
from packmech.jit.compiled import compiled_form, device, inlined, inner_lean, kernel
from packmech.minimize.passes.pair_list import (
    AGE,
    BEYOND,
    BUDGET,
    DISPLACED,
    NUMBERS,
    SEARCHES,
    SKIN_FULL,
    SKIN_INNER,
    SKIN_OUTER,
    adapt_skin,
    anchor,
    place_images,
)

# rows of a block, at least; blocks, at most
_ROWS, _BLOCKS = 320, 32
# slot of a pair whose two rows belong to one block
NO_SLOT = np.uint32(0xFFFFFFFF)


class Slots(NamedTuple):
    """Rows of forces and torques on the way to other blocks: the row of each, and the first slot of each block.

    next_b is room to deal them out in.
    """

    push_qk: NDArray[np.float64]
    row_q: NDArray[np.uint32]
    start_b: NDArray[np.int64]
    next_b: NDArray[np.int64]


class Pairs(NamedTuple):
    """Outer and inner pairs, images, the positions at which each list was made, and the numbers of `pair_list`.

    row_b holds the first row of each block; start_s the first inner pair of each section, plain and special ones of
    each block in turn, outer_start_s the same of the outer list. image_p and slot_p are set for special pairs only.
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
    image_kd: NDArray[np.float64]
    shift_kd: NDArray[np.float64]
    outer_anchor_nd: NDArray[np.float64]
    anchor_nd: NDArray[np.float64]
    number: NDArray[np.float64]
    bits: int


def blocks_of(rows: int) -> NDArray[np.int64]:
    """Return the first row of each block of so many rows, and at the end their number."""
    blocks = max(1, min(_BLOCKS, rows // _ROWS))
    return np.arange(blocks + 1, dtype=np.int64) * rows // blocks


def empty_slots(blocks: int, width: int) -> Slots:
    """Return no slots, for so many blocks."""
    first = np.zeros(blocks + 1, dtype=np.int64)
    return Slots(np.zeros((0, width)), np.zeros(0, dtype=np.uint32), first, np.zeros(blocks, dtype=np.int64))


def empty_pairs(rows: int, width: int, skin: float, beyond: float = 0.0) -> Pairs:
    """Return lists that are out of date, so that their first use makes them.

    Parameters
    ----------
    rows
        Number of particles.
    width
        Forces and torques of a row: numbers in a slot.
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
    row = blocks_of(rows)
    blocks = len(row) - 1
    none = np.zeros(0, dtype=np.uint32)
    start = np.zeros(2 * blocks + 1, dtype=np.int64)
    image = np.zeros((1, 3))
    far = np.zeros((rows, 3))
    return Pairs(
        row,
        *(none, none, start, none, none, none, none, none, start.copy()),
        empty_slots(blocks, width),
        image,
        image.copy(),
        far,
        far.copy(),
        number,
        0,
    )


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
def rebuilt_pairs(found, body, old):
    """Return lists with the outer pairs of a search in sections, and room for as many inner ones."""
    row_b = old.row_b
    blocks = row_b.shape[0] - 1
    total = found.i_p.shape[0]
    bits = np.uint64(found.bits)
    mask = np.uint64((1 << found.bits) - 1)
    # images are numbered from the most negative to the most positive
    none = np.uint64(found.image_kd.shape[0] // 2)
    outer_i = np.empty(total, np.uint32)
    outer_code = np.empty(total, np.uint32)
    start = np.zeros(2 * blocks + 1, np.int64)
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
    anchor(body, old.outer_anchor_nd)
    old.number[SKIN_OUTER] = old.number[SKIN_FULL]
    old.number[SEARCHES] += 1.0
    width = old.slots.push_qk.shape[1]
    return Pairs(
        row_b,
        outer_i,
        outer_code,
        start,
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.empty(total + 1, np.uint32),
        np.zeros(2 * blocks + 1, np.int64),
        Slots(
            np.zeros((far, width)), np.zeros(far, np.uint32), np.zeros(blocks + 1, np.int64), np.zeros(blocks, np.int64)
        ),
        found.image_kd,
        np.zeros_like(found.image_kd),
        old.outer_anchor_nd,
        old.anchor_nd,
        old.number,
        found.bits,
    )


@device
def choose_inner(axes, body, pairs, skin):
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
            dx = body[j, 0] - body[i, 0] + pairs.shift_kd[k, 0]
            dy = body[j, 1] - body[i, 1] + pairs.shift_kd[k, 1]
            square = dx * dx + dy * dy
            if len(axes) == 3:
                dz = body[j, 2] - body[i, 2] + pairs.shift_kd[k, 2]
                square += dz * dz
            limit = body[i, 3] + body[j, 3] + reach
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


class Track(NamedTuple):
    """Stretches of the tangential springs of the inner pairs and of the outer ones."""

    inner_pk: NDArray[np.float64]
    outer_pk: NDArray[np.float64]


@device
def inner_stretches(track):
    """Return the stretches of the inner pairs; None without a track."""
    return None if track is None else track.inner_pk


class Space(NamedTuple):
    """What pair lists need to know besides the rows: sizes, box, how it deforms, bonds, linked pairs (None without)."""

    sizes: Any
    frame: Any
    flow: Any
    bonds: Any
    linked: Any


@device
def without_bonded(bonds, found):
    """Return the pairs of a search that are not bonded."""
    if bonds is None:
        return found
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


@device
def strained(flow, since, largest):
    """Return half of what the strain since an anchor can take from the distance of a pair this far apart [length]."""
    if flow is None:
        return 0.0
    bent = flow.number[BENDING + since - ANCHORED]
    return 0.5 * abs(flow.number[GAMMA] - flow.number[since]) * bent * largest


@device
def displaced(flow, body, anchor_nd, since):
    """Return the largest displacement from an anchor that went with the box [length]."""
    if flow is None:
        g = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    else:
        map_between(flow, flow.number[since], flow.number[GAMMA], flow.step_dd)
        g = entries(flow.step_dd)
    largest = 0.0
    for i in range(body.shape[0]):
        ax, ay, az = anchor_nd[i, 0], anchor_nd[i, 1], anchor_nd[i, 2]
        x = body[i, 0] - (g[0][0] * ax + g[0][1] * ay + g[0][2] * az)
        y = body[i, 1] - (g[1][0] * ax + g[1][1] * ay + g[1][2] * az)
        z = body[i, 2] - (g[2][0] * ax + g[2][1] * ay + g[2][2] * az)
        largest = max(largest, x * x + y * y + z * z)
    return math.sqrt(largest)


@device
def mark_strain(flow, since):
    """Note the strain at which an anchor was set."""
    if flow is not None:
        flow.number[since] = flow.number[GAMMA]
        flow.number[BENDING + since - ANCHORED] = bending(flow, flow.number[GAMMA])


@device
def store_stretches(track, pairs):
    """Write the stretches of the inner pairs to their places in the outer list."""
    if track is not None:
        for p in range(pairs.start_s[-1]):
            for a in range(track.outer_pk.shape[1]):
                track.outer_pk[pairs.place_p[p], a] = track.inner_pk[p, a]


@device
def load_stretches(track, pairs):
    """Fetch the stretches of the inner pairs, newly chosen, from the outer list."""
    if track is not None:
        for p in range(pairs.start_s[-1]):
            for a in range(track.outer_pk.shape[1]):
                track.inner_pk[p, a] = track.outer_pk[pairs.place_p[p], a]


@device
def _carried_stretches(track, old, new):
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


def carried_stretches(track: Any, old: Any, new: Any) -> Any:
    """Return the stretches for a new outer list, those of pairs that were in the old one kept; None without a track."""
    return None if track is None else _carried_stretches(track, old, new)


@compiled_form(carried_stretches)
def _choose_carried_stretches(track: Any, old: Any, new: Any) -> Any:
    if isinstance(track, types.NoneType):
        return lambda track, old, new: None
    return _carried_stretches


@inner_lean
def rebuild_inner(axes, body, space, pairs, track):
    """Choose the inner pairs again at the present positions; their stretches are in the outer list."""
    number = pairs.number
    place_images(space.frame, pairs)
    choose_inner(axes, body, pairs, number[SKIN_INNER])
    load_stretches(track, pairs)
    anchor(body, pairs.anchor_nd)
    mark_strain(space.flow, ANCHORED)
    number[DISPLACED] = 0.0
    number[BUDGET] = 0.5 * number[SKIN_INNER]
    number[AGE] = 0.0


@device
def largest_contact(sizes):
    """Return the largest contact distance."""
    largest = 0.0
    for a in range(sizes.largest_a.shape[0]):
        largest = max(largest, sizes.largest_a[a])
    return 2.0 * largest


@inlined
def is_stale(flow, number, reach, moved):
    """Return whether lists may be stale, after a step in which particles moved by at most this much.

    `reach` is the largest contact distance, `number` that of the lists.
    """
    number[DISPLACED] += moved
    number[AGE] += 1.0
    reach += number[BEYOND]
    bent = strained(flow, ANCHORED, reach + number[SKIN_INNER])
    # displacements since the anchor were strained themselves; what is not a number is too far
    return not number[DISPLACED] * (1.0 + 2.0 * bent / reach) + bent <= number[BUDGET]


@inner_lean
def update_lists(axes, body, space, pairs, track):
    """Make stale lists valid; return whether that takes a new search."""
    number = pairs.number
    flow = space.flow
    reach = largest_contact(space.sizes) + number[BEYOND]
    room = 0.5 * number[SKIN_INNER]
    bent = strained(flow, ANCHORED, reach + number[SKIN_INNER])
    gone = displaced(flow, body, pairs.anchor_nd, ANCHORED)
    if gone + bent < 0.75 * room:
        # the bound added up the lengths of all steps; the true displacement leaves room
        number[DISPLACED] = 0.0
        number[BUDGET] = room - gone
        return False
    adapt_skin(number)
    gone = displaced(flow, body, pairs.outer_anchor_nd, OUTER_ANCHORED)
    gone += strained(flow, OUTER_ANCHORED, reach + number[SKIN_FULL])
    if 2.0 * gone + number[SKIN_INNER] > number[SKIN_OUTER]:
        return True
    store_stretches(track, pairs)
    rebuild_inner(axes, body, space, pairs, track)
    return False


@kernel
def search(axes, body, space, pairs, track):
    """Return lists rebuilt at the present positions and strain, and the track with the stretches kept."""
    store_stretches(track, pairs)
    reach = pairs.number[BEYOND] + pairs.number[SKIN_FULL]
    found = find_pairs(axes, body, space.sizes, space.frame, 1.0, reach)
    found = without_linked(space.linked, without_bonded(space.bonds, found))
    new = rebuilt_pairs(found, body, pairs)
    track = carried_stretches(track, pairs, new)
    mark_strain(space.flow, OUTER_ANCHORED)
    rebuild_inner(axes, body, space, new, track)
    return new, track


def empty_track(dimension: int, beads: int = 1) -> Track:
    """Return a track without pairs, for an empty list; for bodies of up to so many beads."""
    none = np.zeros((0, beads * beads * (1 if dimension == 2 else 3)))
    return Track(none, none.copy())


class Stretches(NamedTuple):
    """Pairs of rows (i < j, or i == j), images in the loops' lattice (C, 3), beads (C, 2), stretches (C, 1 or 3)."""

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    bead_c2: NDArray[np.int64]
    stretch_ck: NDArray[np.float64]

    def moved(self, shift_nd: NDArray[np.int64], back_dd: NDArray[np.int64]) -> Stretches:
        """Return them after rows were moved by minus lattice @ shift and the lattice was exchanged.

        Parameters
        ----------
        shift_nd
            (N, d) whole numbers.
        back_dd
            (d, d) whole numbers: inverse of the change of lattice vectors.

        """
        d = shift_nd.shape[1]
        image = self.image_cd.copy()
        image[:, :d] += shift_nd[self.j_c] - shift_nd[self.i_c]
        image[:, :d] = image[:, :d] @ back_dd.T
        bead, stretch = self.bead_c2, self.stretch_ck
        own = self.i_c == self.j_c
        if own.any():
            # the list takes the image of a pair with itself whose first nonzero number is positive
            first = np.take_along_axis(image, np.argmax(image != 0, axis=1)[:, None], axis=1)[:, 0]
            turned = own & (first < 0)
            image[turned] *= -1
            bead = np.where(turned[:, None], bead[:, ::-1], bead)
            if stretch.shape[1] == 3:
                stretch = np.where(turned[:, None], -stretch, stretch)
        return Stretches(self.i_c, self.j_c, image, bead, stretch)


def listed_pairs(pairs: Pairs) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return i, j and images of the inner pairs."""
    start = pairs.start_s
    total = int(start[-1])
    image = np.zeros((total, 3), dtype=np.int64)
    special = np.repeat(np.arange(len(start) - 1) % 2 == 1, np.diff(start))
    image[special] = np.rint(pairs.image_kd[pairs.image_p[:total][special]]).astype(np.int64)
    return pairs.i_p[:total].astype(np.int64), pairs.j_p[:total].astype(np.int64), image


def read_stretches(pairs: Pairs, track: Track | None, dimension: int) -> Stretches:
    """Return the stretches that are not zero, sorted by (i, j, image, beads); none without a track."""
    components = 1 if dimension == 2 else 3
    if track is None:
        none, two, three = (np.zeros((0, *more), dtype=np.int64) for more in ((), (2,), (3,)))
        return Stretches(none, none, three, two, np.zeros((0, components)))
    i, j, image = listed_pairs(pairs)
    springs = track.inner_pk[: len(i)].reshape(len(i), track.inner_pk.shape[1] // components, components)
    pair, spring = np.nonzero(springs.any(axis=2))
    i, j, image, stretch = i[pair], j[pair], image[pair], springs[pair, spring]
    bead = np.stack(np.divmod(spring, math.isqrt(springs.shape[1])), axis=1)
    order = np.lexsort((*bead.T[::-1], *image.T[::-1], j, i))
    return Stretches(i[order], j[order], image[order], bead[order], stretch[order])


def write_stretches(pairs: Pairs, track: Track | None, held: Stretches) -> None:
    """Give the pairs of a list the stretches that are held for them."""
    if track is None or not len(held.i_c):
        return
    i, j, image = listed_pairs(pairs)
    whole = np.concatenate([np.column_stack([i, j, image]), np.column_stack([held.i_c, held.j_c, held.image_cd])])
    _, key = np.unique(whole, axis=0, return_inverse=True)
    key = key.ravel()
    listed, asked = key[: len(i)], key[len(i) :]
    order = np.argsort(listed)
    place = np.searchsorted(listed[order], asked)
    found = order[np.minimum(place, len(order) - 1)]
    hit = listed[found] == asked
    components = held.stretch_ck.shape[1]
    springs = np.zeros((len(i), track.inner_pk.shape[1] // components, components))
    spring = held.bead_c2[:, 0] * math.isqrt(springs.shape[1]) + held.bead_c2[:, 1]
    springs[found[hit], spring[hit]] = held.stretch_ck[hit]
    track.inner_pk[: len(i)] = springs.reshape(len(i), -1)
