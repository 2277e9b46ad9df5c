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
    """Return the bonds between rows, in their own order, with images of the loops' lattice.

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
        (B, 1 or 3) stretches of the tangential springs; None: slack.

    """
    n, d = home_nd.shape
    row = np.empty(n, dtype=np.int64)
    row[order_n] = np.arange(n)
    back = np.rint(np.linalg.inv(change_dd)).astype(np.int64)
    image = (bonds.image_bd + home_nd[bonds.j_b] - home_nd[bonds.i_b]) @ back.T
    i, j = row[bonds.i_b], row[bonds.j_b]
    padded = np.zeros((len(bonds), 3), dtype=np.int64)
    padded[:, :d] = image
    # a search finds a pair from either end
    start, other = np.concatenate([i, j]), np.concatenate([j, i])
    both = np.concatenate([padded, -padded])
    order = np.lexsort((*both.T[::-1], other, start))
    visit, first, slot, slots = _shared(i, j, n, 1 if d == 2 else 3, d)
    return BondTable(
        bonds.compression,
        bonds.tension,
        bonds.tangential_stiffness,
        bonds.damping,
        bonds.tangential_damping,
        i,
        j,
        padded.astype(np.float64),
        np.array(bonds.rest_length_b),
        np.zeros((len(bonds), 1 if d == 2 else 3)) if stretch_bk is None else stretch_bk,
        visit,
        first,
        slot,
        slots,
        np.searchsorted(start[order], np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(other[order]),
        np.ascontiguousarray(both[order]),
    )


def _shared(
    i_b: NDArray[np.int64], j_b: NDArray[np.int64], n: int, torques: int, d: int
) -> tuple[NDArray[np.uint32], NDArray[np.int64], NDArray[np.uint32], Slots]:
    """Return bonds by the block of their i, the first of each block, their slots, and these by the block of their j."""
    row = blocks_of(n)
    own = np.searchsorted(row, i_b, side="right") - 1
    other = np.searchsorted(row, j_b, side="right") - 1
    visit = np.argsort(own, kind="stable")
    away = np.flatnonzero((own != other)[visit])
    home = other[visit[away]]
    order = np.argsort(home, kind="stable")
    slot = np.full(len(i_b), NO_SLOT, dtype=np.uint32)
    slot[away[order]] = np.arange(len(away), dtype=np.uint32)
    blocks = np.arange(len(row))
    slots = Slots(
        np.zeros((len(away), d + torques)),
        j_b[visit[away[order]]].astype(np.uint32),
        np.searchsorted(home[order], blocks).astype(np.int64),
    )
    return visit.astype(np.uint32), np.searchsorted(own[visit], blocks).astype(np.int64), slot, slots
