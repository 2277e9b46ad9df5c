"""Gaps to some thirty digits, of a packing whose coordinates are taken as exact, and of displacements from it.

Two spheres at a pressure of 1e-12 overlap by 1e-12 of their size. The difference of two coordinates of a box as long as
thirty of them is rounded by 4e-15, so that four of a thousand parts of the overlap are lost whatever is done later.
Displacements from a reference packing are not rounded so: numbers of the size of the overlaps keep all their sixteen
digits. The gaps of the reference itself are sums and products of its coordinates, which are double precision numbers;
with the rounding of every sum and product kept as a second number (Dekker, Numer. Math. 18, 224 (1971)) they are known
to 1e-32.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import Candidates
from packmech.packing import Packing

Array = NDArray[np.float64]
# splits a double precision number into two halves whose products are exact
_SPLIT = 2.0**27 + 1.0


class _Exact(NamedTuple):
    """Numbers as the sum of two: what double precision holds, and the rounding that it left."""

    value: Array
    rest: Array

    def __add__(self, other: _Exact) -> _Exact:  # type: ignore[override]
        """Return the sum."""
        total = _sum(self.value, other.value)
        return _sum(total.value, total.rest + self.rest + other.rest)

    def __mul__(self, other: _Exact) -> _Exact:  # type: ignore[override]
        """Return the product."""
        whole = _product(self.value, other.value)
        return _sum(whole.value, whole.rest + self.value * other.rest + self.rest * other.value)


def _sum(a: Array, b: Array) -> _Exact:
    """Return the exact sum of two numbers."""
    total = a + b
    part = total - a
    return _Exact(total, (a - (total - part)) + (b - part))


def _product(a: Array, b: Array) -> _Exact:
    """Return the exact product of two numbers."""
    whole = a * b
    a_scaled, b_scaled = _SPLIT * a, _SPLIT * b
    a_high, b_high = a_scaled - (a_scaled - a), b_scaled - (b_scaled - b)
    a_low, b_low = a - a_high, b - b_high
    return _Exact(whole, ((a_high * b_high - whole) + a_high * b_low + a_low * b_high) + a_low * b_low)


class ExactPairs:
    """Pairs of a reference packing of discs or spheres: vectors and gaps, free of the rounding of differences.

    Contact distances are the exact sums of the radii.

    Parameters
    ----------
    packing
        The reference; its coordinates, lattice vectors and radii are taken as they stand.
    pairs
        Pairs of different particles, or of a particle and its image.

    Attributes
    ----------
    vector_cd
        (C, d) vectors from i to j in the reference, each rounded once [length].
    gap_c
        (C,) gaps in the reference [length].

    """

    def __init__(self, packing: Packing, pairs: Candidates) -> None:
        self.pairs = pairs
        radius_n, d = packing.radius_n, packing.dimension
        sigma = _sum(radius_n[pairs.i_c], radius_n[pairs.j_c])
        square = sigma * _Exact(-sigma.value, -sigma.rest)
        columns = []
        for a in range(d):
            one = _sum(packing.position_nd[pairs.j_c, a], -packing.position_nd[pairs.i_c, a])
            for b in range(d):
                side = np.full(len(pairs.i_c), packing.box.lattice_dd[a, b])
                one = one + _product(side, pairs.image_cd[:, b].astype(np.float64))
            columns.append(one.value)
            square = square + one * one
        self.vector_cd = np.stack(columns, axis=1)
        self._distance_c = np.sqrt((self.vector_cd**2).sum(axis=1))
        # r^2 - sigma^2 has its digits, and r + sigma those of r
        self.gap_c = (square.value + square.rest) / (self._distance_c + sigma.value)

    def displaced(self, displacement_nd: Array, gradient_dd: Array) -> tuple[Array, Array]:
        """Return the (C, d) vectors and the (C,) gaps after displacements on top of a gradient.

        Parameters
        ----------
        displacement_nd
            (N, d) displacements beyond what the gradient takes along [length].
        gradient_dd
            (d, d) displacement gradient: lattice vectors become (1 + gradient) lattice.

        """
        i_c, j_c, _ = self.pairs
        change_cd = displacement_nd[j_c] - displacement_nd[i_c] + self.vector_cd @ gradient_dd.T
        vector_cd = self.vector_cd + change_cd
        longer = 2.0 * (self.vector_cd * change_cd).sum(axis=1) + (change_cd**2).sum(axis=1)
        return vector_cd, self.gap_c + longer / (self._distance_c + np.sqrt((vector_cd**2).sum(axis=1)))
