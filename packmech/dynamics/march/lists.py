# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Pair lists of a march: they follow a box that deforms, and carry the stretches of tangential springs along.

The affine part of the motion is subtracted: a pair stays in a list as long as the peculiar displacements since its
anchor, and what the strain did to a distance, leave room in the skin.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device, kernel
from packmech.contacts.cells import PairTable, find_pairs
from packmech.dynamics.march.bonding import BondTable
from packmech.dynamics.march.flow import (
    ANCHORED,
    BENDING,
    GAMMA,
    OUTER_ANCHORED,
    bending,
    entries,
    is_still,
    map_between,
)
from packmech.dynamics.march.inlined import inlined
from packmech.dynamics.march.pairs import choose_inner, renewed_pairs
from packmech.dynamics.pair_list import (
    AGE,
    BUDGET,
    SKIN_FULL,
    SKIN_INNER,
    SKIN_OUTER,
    TRAVEL,
    adapt_skin,
    anchor,
    place_images,
)


class Track(NamedTuple):
    """Stretches of the tangential springs of the inner pairs and of the outer ones."""

    inner_pk: NDArray[np.float64]
    outer_pk: NDArray[np.float64]


class Space(NamedTuple):
    """What pair lists of a march need to know besides the rows."""

    sizes: Any
    frame: Any
    flow: Any
    bonds: Any


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


def without_bonded(bonds: BondTable | None, found: PairTable) -> PairTable:
    """Return the pairs of a search that are not bonded."""
    return found if bonds is None else _without_bonded(bonds, found)


@compiled_form(without_bonded)
def _choose_without_bonded(bonds: Any, found: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, found: found
    return lambda bonds, found: _without_bonded(bonds, found)


def strained(flow: Any, since: int, largest: float) -> float:
    """Return half of what the strain since an anchor can take from the distance of a pair this far apart [length]."""
    return 0.0 if flow is None else _strained(flow.number, since, largest)


@device
def _strained(number, since, largest):
    bent = number[BENDING + since - ANCHORED]
    return 0.5 * abs(number[GAMMA] - number[since]) * bent * largest


@compiled_form(strained)
def _choose_strained(flow: Any, since: Any, largest: Any) -> Any:
    if is_still(flow):
        return lambda flow, since, largest: 0.0
    return lambda flow, since, largest: _strained(flow.number, since, largest)


def strayed(flow: Any, body: Any, anchor_nd: Any, since: int) -> float:
    """Return the largest displacement from an anchor that went with the box [length]."""
    raise NotImplementedError("lists are followed in compiled loops")


@device
def _strayed(body, anchor_nd, g):
    most = 0.0
    for i in range(body.shape[0]):
        ax, ay, az = anchor_nd[i, 0], anchor_nd[i, 1], anchor_nd[i, 2]
        x = body[i, 0] - (g[0][0] * ax + g[0][1] * ay + g[0][2] * az)
        y = body[i, 1] - (g[1][0] * ax + g[1][1] * ay + g[1][2] * az)
        z = body[i, 2] - (g[2][0] * ax + g[2][1] * ay + g[2][2] * az)
        most = max(most, x * x + y * y + z * z)
    return math.sqrt(most)


@compiled_form(strayed)
def _choose_strayed(flow: Any, body: Any, anchor_nd: Any, since: Any) -> Any:
    if is_still(flow):

        def unmoved(flow, body, anchor_nd, since):
            return _strayed(body, anchor_nd, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))

        return unmoved

    def moved(flow, body, anchor_nd, since):
        map_between(flow, flow.number[since], flow.number[GAMMA], flow.step_dd)
        return _strayed(body, anchor_nd, entries(flow.step_dd))

    return moved


def mark(flow: Any, since: int) -> None:
    """Note the strain at which an anchor was set."""
    if flow is not None:
        _mark(flow, since)


@device
def _mark(flow, since):
    flow.number[since] = flow.number[GAMMA]
    flow.number[BENDING + since - ANCHORED] = bending(flow, flow.number[GAMMA])


@compiled_form(mark)
def _choose_mark(flow: Any, since: Any) -> Any:
    if is_still(flow):
        return lambda flow, since: None
    return lambda flow, since: _mark(flow, since)


def stow(track: Any, pairs: Any) -> None:
    """Write the stretches of the inner pairs to their places in the outer list."""
    raise NotImplementedError("lists are followed in compiled loops")


@device
def _stow(track, pairs):
    for p in range(pairs.start_s[-1]):
        for a in range(track.outer_pk.shape[1]):
            track.outer_pk[pairs.place_p[p], a] = track.inner_pk[p, a]


@compiled_form(stow)
def _choose_stow(track: Any, pairs: Any) -> Any:
    if isinstance(track, types.NoneType):
        return lambda track, pairs: None
    return lambda track, pairs: _stow(track, pairs)


def unstow(track: Any, pairs: Any) -> None:
    """Fetch the stretches of the inner pairs, newly chosen, from the outer list."""
    raise NotImplementedError("lists are followed in compiled loops")


@device
def _unstow(track, pairs):
    for p in range(pairs.start_s[-1]):
        for a in range(track.outer_pk.shape[1]):
            track.inner_pk[p, a] = track.outer_pk[pairs.place_p[p], a]


@compiled_form(unstow)
def _choose_unstow(track: Any, pairs: Any) -> Any:
    if isinstance(track, types.NoneType):
        return lambda track, pairs: None
    return lambda track, pairs: _unstow(track, pairs)


def carry(track: Any, old: Any, new: Any) -> Any:
    """Return the stretches for a new outer list, those of pairs that were in the old one kept."""
    raise NotImplementedError("lists are followed in compiled loops")


@device
def _carry(track, old, new):
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


@compiled_form(carry)
def _choose_carry(track: Any, old: Any, new: Any) -> Any:
    if isinstance(track, types.NoneType):
        return lambda track, old, new: None
    return lambda track, old, new: _carry(track, old, new)


@device
def settle_inner(axes, body, space, pairs, track):
    """Choose the inner pairs anew at the present positions; their stretches are in the outer list."""
    number = pairs.number
    place_images(space.frame, pairs)
    choose_inner(axes, body, pairs, number[SKIN_INNER])
    unstow(track, pairs)
    anchor(body, pairs.anchor_nd)
    mark(space.flow, ANCHORED)
    number[TRAVEL] = 0.0
    number[BUDGET] = 0.5 * number[SKIN_INNER]
    number[AGE] = 0.0


@device
def largest_contact(sizes):
    """Return the largest contact distance."""
    most = 0.0
    for a in range(sizes.largest_a.shape[0]):
        most = max(most, sizes.largest_a[a])
    return 2.0 * most


@inlined
def worn(flow, number, reach, moved):
    """Whether everybody may have moved too far for the lists, by at most this much in this step.

    `reach` is the largest contact distance, `number` that of the lists.
    """
    number[TRAVEL] += moved
    number[AGE] += 1.0
    bent = strained(flow, ANCHORED, reach + number[SKIN_INNER])
    # displacements since the anchor were strained themselves; what is not a number is too far
    return not number[TRAVEL] * (1.0 + 2.0 * bent / reach) + bent <= number[BUDGET]


@device
def keep_up(axes, body, space, pairs, track):
    """Make worn lists valid; return whether that takes a new search."""
    number = pairs.number
    flow = space.flow
    reach = largest_contact(space.sizes)
    room = 0.5 * number[SKIN_INNER]
    bent = strained(flow, ANCHORED, reach + number[SKIN_INNER])
    gone = strayed(flow, body, pairs.anchor_nd, ANCHORED)
    if gone + bent < 0.75 * room:
        # the bound added up the lengths of all steps; the true displacement leaves room
        number[TRAVEL] = 0.0
        number[BUDGET] = room - gone
        return False
    adapt_skin(number)
    gone = strayed(flow, body, pairs.outer_anchor_nd, OUTER_ANCHORED)
    gone += strained(flow, OUTER_ANCHORED, reach + number[SKIN_FULL])
    if 2.0 * gone + number[SKIN_INNER] > number[SKIN_OUTER]:
        return True
    stow(track, pairs)
    settle_inner(axes, body, space, pairs, track)
    return False


@kernel
def search(axes, body, space, pairs, track):
    """Return lists searched anew at the present positions and strain, and the track with the stretches kept."""
    stow(track, pairs)
    found = find_pairs(axes, body, space.sizes, space.frame, 1.0, pairs.number[SKIN_FULL])
    new = renewed_pairs(without_bonded(space.bonds, found), body, pairs)
    track = carry(track, pairs, new)
    mark(space.flow, OUTER_ANCHORED)
    settle_inner(axes, body, space, new, track)
    return new, track


def deform_images(flow: Any, lattice: Any, image_kd: Any, shift_kd: Any) -> None:
    """Put the images where the box has taken them."""
    raise NotImplementedError("lists are followed in compiled loops")


@device
def _deform_images(lattice, image_kd, shift_kd):
    for k in range(image_kd.shape[0]):
        for a in range(3):
            shift = 0.0
            for b in range(3):
                shift += lattice[a, b] * image_kd[k, b]
            shift_kd[k, a] = shift


@compiled_form(deform_images)
def _choose_deform_images(flow: Any, lattice: Any, image_kd: Any, shift_kd: Any) -> Any:
    if is_still(flow):
        return lambda flow, lattice, image_kd, shift_kd: None
    return lambda flow, lattice, image_kd, shift_kd: _deform_images(lattice, image_kd, shift_kd)


def empty_track(dimension: int) -> Track:
    """Return a track without pairs, for an empty list."""
    none = np.zeros((0, 1 if dimension == 2 else 3))
    return Track(none, none.copy())
