# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Lists of pairs as a march walks them: by fixed blocks of rows, so that any number of threads gives the same bits.

Rows belong to blocks that depend on their number alone. A block's pairs are those of its rows i, sorted by (i, j,
image): first the plain ones, whose j lies in the same block and whose image is zero, then the special ones. What a
special pair does to a row of another block goes to a slot, a row of its own; slots are emptied into the forces of each
block after all blocks have been walked, in the order of their pairs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device
from packmech.dynamics.march.inlined import inlined
from packmech.dynamics.pair_list import NUMBERS, SEARCHES, SKIN_FULL, SKIN_INNER, SKIN_OUTER, TRAVEL, anchor

# rows of a block, at least; blocks, at most
_ROWS, _BLOCKS = 320, 32
# slot of a pair whose two rows belong to one block
NO_SLOT = np.uint32(0xFFFFFFFF)


class Slots(NamedTuple):
    """Rows of forces and torques on the way to other blocks: who gets each, and the first slot of each block.

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


def empty_pairs(rows: int, width: int, skin: float) -> Pairs:
    """Return lists that are out of date, so that their first use makes them.

    Parameters
    ----------
    rows
        Number of particles.
    width
        Forces and torques of a row: numbers in a slot.
    skin
        Outer skin [length].

    """
    number = np.zeros(NUMBERS)
    number[SKIN_OUTER] = -1.0
    number[SKIN_FULL] = skin
    number[SKIN_INNER] = 0.25 * skin
    number[TRAVEL] = np.inf
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
def renewed_pairs(found, body, old):
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
    put = 0
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
            limit = body[i, 3] + body[j, 3] + skin
            pairs.i_p[put] = i
            pairs.j_p[put] = j
            pairs.place_p[put] = p
            near = square < limit * limit
            if s % 2 == 1:
                pairs.image_p[put] = k
                pairs.slot_p[put] = NO_SLOT
                if near and j >= row_b[b + 1]:
                    home = block_of(row_b, np.int64(j))
                    pairs.slot_p[put] = home
                    slots.start_b[home + 1] += 1
            put += near
    pairs.start_s[2 * blocks] = put
    _deal(pairs)


@device
def _deal(pairs):
    """Sort the slots by the block that gets them; until then a pair's slot holds that block, and start_b counts."""
    slots = pairs.slots
    blocks = slots.start_b.shape[0] - 1
    next_b = slots.next_b
    for b in range(blocks):
        slots.start_b[b + 1] += slots.start_b[b]
        next_b[b] = slots.start_b[b]
    for b in range(blocks):
        for p in range(pairs.start_s[2 * b + 1], pairs.start_s[2 * b + 2]):
            home = pairs.slot_p[p]
            if home != NO_SLOT:
                q = next_b[home]
                next_b[home] += 1
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
