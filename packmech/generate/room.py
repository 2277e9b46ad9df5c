"""Room for the next cluster: whether its beads overlap those already placed by more than they may."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box


class Room:
    """The beads placed so far.

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
        self._place = np.empty((len(radius_n), box.dimension))
        self._count = 0
        # a vector shorter than half of every height rounds to itself; in smaller boxes further images count
        reach = 2.0 * float(radius_n.max()) * self._apart / small.height_d
        most = np.where(reach <= 0.5, 0, np.ceil(reach + 0.5)).astype(int)
        self._image_kd = np.array(list(itertools.product(*[range(-m, m + 1) for m in most])), dtype=np.float64)

    def allow(self, largest_overlap: float) -> None:
        """Set how far the next cluster may overlap earlier ones."""
        self._apart = max(0.0, 1.0 - largest_overlap)

    def take(self, position_bd: NDArray[np.float64]) -> None:
        """Place the beads of the next cluster."""
        last = self._count + len(position_bd)
        self._place[self._count : last] = position_bd
        self._count = last

    def has(self, position_bd: NDArray[np.float64]) -> bool:
        """Return whether the beads of the next cluster overlap earlier ones no more than they may."""
        first, last = self._count, self._count + len(position_bd)
        fraction = (position_bd[:, None] - self._place[None, :first]) @ self._inverse.T
        fraction -= np.rint(fraction)
        sigma = self._radius[first:last, None] + self._radius[None, :first]
        for image in self._image_kd:
            vector = (fraction + image) @ self._lattice.T
            if ((vector**2).sum(axis=2) < (self._apart * sigma) ** 2).any():
                return False
        return True
