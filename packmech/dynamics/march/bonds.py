"""Bonds of a scene as the loops of a march take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.bonding import BondTable
from packmech.dynamics.march.pairs import NO_SLOT, Slots, blocks_of
from packmech.effects import Bonds


def bond_table(
    bonds: Bonds,
    order_n: NDArray[np.int64],
    home_nd: NDArray[np.int64],
    change_dd: NDArray[np.int64],
    stretch_bk: NDArray[np.float64] | None,
) -> BondTable:
    """Return the bonds between rows, sorted for the loops, with images of the loops' lattice.

    Parameters
    ----------
    bonds
        The bonds between particles.
    order_n
        (N,) particle of each row.
    home_nd
        (N, d) lattice vectors by which particles were moved: x = row + lattice @ home.
    change_dd
        (d, d) whole numbers: the loops' lattice is lattice @ change.
    stretch_bk
        (B, 1 or 3) stretches of the tangential springs in the order of `bonds`; None: slack.

    """
    n, d = home_nd.shape
    row = np.empty(n, dtype=np.int64)
    row[order_n] = np.arange(n)
    back = np.rint(np.linalg.inv(change_dd)).astype(np.int64)
    padded = np.zeros((len(bonds), 3), dtype=np.int64)
    padded[:, :d] = (bonds.image_bd + home_nd[bonds.j_b] - home_nd[bonds.i_b]) @ back.T
    i, j = row[bonds.i_b], row[bonds.j_b]
    # a search finds a pair from either end
    start, other = np.concatenate([i, j]), np.concatenate([j, i])
    both = np.concatenate([padded, -padded])
    order = np.lexsort((*both.T[::-1], other, start))
    place, first = _sections(i, j, padded, n)
    slot, slots = _slots(i[place], j[place], n, d + (1 if d == 2 else 3))
    if stretch_bk is None:
        stretch_bk = np.zeros((len(bonds), 1 if d == 2 else 3))
    return BondTable(
        bonds.compression,
        bonds.tension,
        bonds.tangential_stiffness,
        bonds.damping,
        bonds.tangential_damping,
        i[place].astype(np.uint32),
        j[place].astype(np.uint32),
        padded[place].astype(np.float64),
        bonds.rest_length_b[place],
        stretch_bk[place],
        place,
        first,
        slot,
        slots,
        np.searchsorted(start[order], np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(other[order]),
        np.ascontiguousarray(both[order]),
    )


def bond_stretches(table: BondTable) -> NDArray[np.float64]:
    """Return the (B, 1 or 3) stretches in the order of the scene's bonds."""
    stretch = np.empty_like(table.stretch_bk)
    stretch[table.place_b] = table.stretch_bk
    return stretch


def _block(row_b: NDArray[np.int64], row: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.searchsorted(row_b, row, side="right") - 1


def _sections(
    i_b: NDArray[np.int64], j_b: NDArray[np.int64], image_bd: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the bonds section by section, in their own order in each, and the first of each section."""
    row = blocks_of(n)
    own = _block(row, i_b)
    section = 2 * own + ((own != _block(row, j_b)) | image_bd.any(axis=1))
    place = np.argsort(section, kind="stable")
    return place, np.searchsorted(section[place], np.arange(2 * len(row) - 1)).astype(np.int64)


def _slots(i_b: NDArray[np.int64], j_b: NDArray[np.int64], n: int, width: int) -> tuple[NDArray[np.uint32], Slots]:
    """Return the slots of sorted bonds, NO_SLOT for those within a block, and these by the block of their j."""
    row = blocks_of(n)
    other = _block(row, j_b)
    away = np.flatnonzero(_block(row, i_b) != other)
    away = away[np.argsort(other[away], kind="stable")]
    slot = np.full(len(i_b), NO_SLOT, dtype=np.uint32)
    slot[away] = np.arange(len(away), dtype=np.uint32)
    first = np.searchsorted(other[away], np.arange(len(row))).astype(np.int64)
    return slot, Slots(
        np.zeros((len(away), width)), j_b[away].astype(np.uint32), first, np.zeros(len(row) - 1, dtype=np.int64)
    )
