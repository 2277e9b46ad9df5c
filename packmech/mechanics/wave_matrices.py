"""Rows and second derivatives at a wave vector: the box is one cell of an endless packing, and motions are waves in it.

A wave vector is given as fractions f of the reciprocal lattice. Copies of a particle that are n boxes away move as it
does, times exp(2 pi i f.n), so that a pair whose image is n has

    d(vector) = exp(2 pi i f.n) du_j - du_i

and likewise for turns. The second derivatives are K = A^H W A with W as in `packmech.mechanics.assembly`: Hermitian
where there is an energy, and that of the box at f = 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array
from packmech.contacts.elements import Elements, PairGeometry, end_slopes
from packmech.packing import Packing


def wave_fractions(wave_vector: ArrayLike, dimension: int) -> NDArray[np.float64]:
    """Return the (d,) fractions of the reciprocal lattice that a wave vector is given as, checked."""
    return finite_array("wave_vector", wave_vector, shape=(dimension,), what="component")


def pair_images(
    i_c: NDArray[np.int64], j_c: NDArray[np.int64], vector_cd: NDArray[np.float64], packing: Packing
) -> NDArray[np.float64]:
    """Return the (C, d) images of the particles j of pairs, in boxes; arguments as of `wave_phases`."""
    inside = packing.position_nd[j_c] - packing.position_nd[i_c]
    return np.asarray(np.rint((vector_cd - inside) @ packing.box.inverse_dd.T))


def _phases(image_cd: NDArray[np.float64], fraction_d: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the (C,) phases of images."""
    # whole turns taken off, so that whole fractions give 1 to the last bit
    turn = image_cd @ fraction_d
    return np.asarray(np.exp(2j * np.pi * (turn - np.rint(turn))))


def wave_phases(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    vector_cd: NDArray[np.float64],
    packing: Packing,
    fraction_d: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Return the (C,) phases of the particles j of pairs, beside those of i in the box.

    Parameters
    ----------
    i_c, j_c, vector_cd
        The pairs: particles, and vectors from center i to center j [length].
    packing
        The packing whose particles they are.
    fraction_d
        (d,) wave vector, in fractions of the reciprocal lattice [1].

    """
    return _phases(pair_images(i_c, j_c, vector_cd, packing), fraction_d)


def wave_rows(pairs: PairGeometry, packing: Packing, fraction_d: NDArray[np.float64]) -> sp.csr_array:
    """Return the (C, N q) derivatives of the pairs' distances by waves of the coordinates; arguments as above."""
    phase = wave_phases(pairs.i_c, pairs.j_c, pairs.vector_cd, packing, fraction_d)
    ends = end_slopes(pairs.i_c, pairs.j_c, pairs.slope_cx, pairs.turn_nkt, pairs.dimension)
    q, count = ends.shape[2], len(pairs.i_c)
    data = np.concatenate([ends[0].astype(complex), phase[:, None] * ends[1]], axis=1)
    column = np.concatenate([pairs.i_c[:, None] * q + np.arange(q), pairs.j_c[:, None] * q + np.arange(q)], axis=1)
    row = np.repeat(np.arange(count), 2 * q)
    shape = (count, q * len(pairs.turn_nkt))
    return sp.csr_array(sp.coo_array((data.ravel(), (row, column.ravel())), shape=shape))


class WaveStiffness:
    """The (N q, N q) second derivatives of elements by waves of the coordinates, at any wave vector.

    Parameters
    ----------
    elements
        Elements of any kinds.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns; K = 0 where nothing turns.
    packing
        The packing whose particles they join.

    """

    def __init__(self, elements: Sequence[Elements], turn_nkt: NDArray[np.float64], packing: Packing) -> None:
        particles, turns, t = turn_nkt.shape
        d = packing.dimension
        q = d + turns
        self.size = particles * q
        self.symmetric = all(one.symmetric for one in elements)
        blocks, images, rows, columns = [], [], [], []
        for one in elements:
            i, j = one.i_c, one.j_c
            image = pair_images(i, j, one.vector_cd, packing)
            # what coordinates of i and of j change of a pair's
            change = np.zeros((2, len(i), one.pull_cx.shape[1], q))
            change[0, :, :d, :d], change[1, :, :d, :d] = -np.eye(d), np.eye(d)
            if one.rotations:
                change[0, :, d : d + t, d:] = turn_nkt[i].transpose(0, 2, 1)
                change[1, :, d + t :, d:] = turn_nkt[j].transpose(0, 2, 1)
            for a, first in enumerate((i, j)):
                for b, second in enumerate((i, j)):
                    blocks.append(change[a].transpose(0, 2, 1) @ one.stiffness_cxx @ change[b])
                    # blocks of i and j turn by the image of j, those of j and i back
                    images.append((b - a) * image)
                    rows.append(first)
                    columns.append(second)
        self._block = np.concatenate([np.zeros((0, q, q)), *blocks])
        self._image = np.concatenate([np.zeros((0, d)), *images])
        row, column = (np.concatenate([np.zeros(0, np.int64), *ends]) for ends in (rows, columns))
        own = np.arange(q)
        self._at = tuple(
            np.broadcast_to(place, self._block.shape).ravel()
            for place in (row[:, None, None] * q + own[:, None], column[:, None, None] * q + own)
        )

    def at(self, fraction_d: NDArray[np.float64]) -> sp.csr_array:
        """Return them at a wave vector in fractions of the reciprocal lattice; Hermitian of an energy."""
        value = self._block * _phases(self._image, fraction_d)[:, None, None]
        found = sp.csr_array(sp.coo_array((value.ravel(), self._at), shape=(self.size, self.size)))
        # but for rounding it is Hermitian
        return sp.csr_array(0.5 * (found + found.conj().T)) if self.symmetric else found
