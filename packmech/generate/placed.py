"""Beads placed one after another where they overlap earlier ones little."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import real


def checked_overlap(largest_overlap: float | None) -> float:
    """Return the largest overlap that an argument names; 1, which no pair exceeds, for None."""
    return 1.0 if largest_overlap is None else real("largest_overlap", largest_overlap, at_least=0.0, below=1.0)


class Placed:
    """The beads placed so far, and whether those of another cluster overlap them too much.

    Parameters
    ----------
    box
        The box.
    radius_n
        (N,) radii of all beads, in the order in which they will be placed [length].
    largest_overlap
        Largest overlap of two beads of different clusters, relative to the sum of their radii [1].

    """

    def __init__(self, box: Box, radius_n: NDArray[np.float64], largest_overlap: float) -> None:
        small, _ = box.reduced()
        self._lattice, self._inverse = small.lattice_dd, small.inverse_dd
        self._radius = radius_n
        self._apart = 1.0 - largest_overlap
        self._position_nd = np.empty((len(radius_n), box.dimension))
        self._count = 0
        # a vector shorter than half of every height rounds to itself; in smaller boxes further images count
        reach = 2.0 * float(radius_n.max()) * self._apart / small.height_d
        images_d = np.where(reach <= 0.5, 0, np.ceil(reach + 0.5)).astype(int)
        self._image_kd = np.array(list(itertools.product(*[range(-m, m + 1) for m in images_d])), dtype=np.float64)

    def allow(self, largest_overlap: float) -> None:
        """Set how far the next cluster may overlap earlier ones."""
        self._apart = max(0.0, 1.0 - largest_overlap)

    def add(self, position_bd: NDArray[np.float64]) -> None:
        """Add the beads of the next cluster."""
        last = self._count + len(position_bd)
        self._position_nd[self._count : last] = position_bd
        self._count = last

    def admits(self, position_bd: NDArray[np.float64]) -> bool:
        """Return whether the beads of the next cluster overlap earlier ones no more than allowed."""
        return self._clear(position_bd, np.ones(self._count, dtype=bool))

    def admits_next(self, position_d: Sequence[float], linked: Sequence[int]) -> bool:
        """Return whether the next bead overlaps earlier ones, but those it is linked to, no more than allowed."""
        others = np.ones(self._count, dtype=bool)
        others[list(linked)] = False
        return self._clear(np.array([position_d]), others)

    def take_back(self, count: int) -> None:
        """Keep the first beads only, so many."""
        self._count = count

    def _clear(self, position_bd: NDArray[np.float64], others: NDArray[np.bool_]) -> bool:
        if self._apart == 0.0:
            return True
        first, last = self._count, self._count + len(position_bd)
        fraction = (position_bd[:, None] - self._position_nd[None, :first][:, others]) @ self._inverse.T
        fraction -= np.rint(fraction)
        sigma = self._radius[first:last, None] + self._radius[None, :first][:, others]
        for image in self._image_kd:
            vector = (fraction + image) @ self._lattice.T
            if ((vector**2).sum(axis=2) < (self._apart * sigma) ** 2).any():
                return False
        return True
