"""The stretches of tangential springs by pair and image, so that lists may be made anew and runs be continued."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.lists import Track
from packmech.dynamics.march.pairs import Pairs


class Stretches(NamedTuple):
    """Pairs of rows (i < j, or i == j), images in the loops' lattice (C, 3), stretches (C, 1 or 3)."""

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
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
        stretch = self.stretch_ck
        own = self.i_c == self.j_c
        if own.any():
            # the list takes the image of a pair with itself whose first nonzero number is positive
            first = np.take_along_axis(image, np.argmax(image != 0, axis=1)[:, None], axis=1)[:, 0]
            turned = own & (first < 0)
            image[turned] *= -1
            if stretch.shape[1] == 3:
                stretch = np.where(turned[:, None], -stretch, stretch)
        return Stretches(self.i_c, self.j_c, image, stretch)


def _listed(pairs: Pairs) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return i, j and images of the inner pairs."""
    start = pairs.start_s
    total = int(start[-1])
    image = np.zeros((total, 3), dtype=np.int64)
    special = np.repeat(np.arange(len(start) - 1) % 2 == 1, np.diff(start))
    image[special] = np.rint(pairs.image_kd[pairs.image_p[:total][special]]).astype(np.int64)
    return pairs.i_p[:total].astype(np.int64), pairs.j_p[:total].astype(np.int64), image


def read_stretches(pairs: Pairs, track: Track | None, dimension: int) -> Stretches:
    """Return the stretches that are not zero, sorted by (i, j, image); none without a track."""
    if track is None:
        none = np.zeros(0, dtype=np.int64)
        return Stretches(none, none, np.zeros((0, 3), dtype=np.int64), np.zeros((0, 1 if dimension == 2 else 3)))
    i, j, image = _listed(pairs)
    stretch = track.inner_pk[: len(i)]
    keep = stretch.any(axis=1)
    i, j, image, stretch = i[keep], j[keep], image[keep], stretch[keep]
    order = np.lexsort((*image.T[::-1], j, i))
    return Stretches(i[order], j[order], image[order], stretch[order])


def write_stretches(pairs: Pairs, track: Track | None, held: Stretches) -> None:
    """Give the pairs of a list the stretches that are held for them."""
    if track is None or not len(held.i_c):
        return
    i, j, image = _listed(pairs)
    whole = np.concatenate([np.column_stack([i, j, image]), np.column_stack([held.i_c, held.j_c, held.image_cd])])
    _, key = np.unique(whole, axis=0, return_inverse=True)
    key = key.ravel()
    listed, asked = key[: len(i)], key[len(i) :]
    order = np.argsort(listed)
    place = np.searchsorted(listed[order], asked)
    found = order[np.minimum(place, len(order) - 1)]
    hit = listed[found] == asked
    stretch = np.zeros((len(i), held.stretch_ck.shape[1]))
    stretch[found[hit]] = held.stretch_ck[hit]
    track.inner_pk[: len(i)] = stretch
