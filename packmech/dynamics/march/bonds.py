"""Bonds of a scene as the loops of a march take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.bonding import BondTable
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
        np.searchsorted(start[order], np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(other[order]),
        np.ascontiguousarray(both[order]),
    )
