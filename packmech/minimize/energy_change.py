"""The change of the energy along a step, contact by contact: not lost among the digits of the energy itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# Gauss-Legendre on [0, 1], exact for du/dr up to the fifth power of the distance
_PLACE = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6)
_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0

Array = NDArray[np.float64]


def energy_change(vector_cd: Array, change_cd: Array, sigma_c: Array, first: Callable[[Array, Array], Array]) -> float:
    """Return the energy of pairs after their vectors have changed, less that before.

    The distance changes by (2 v.dv + dv.dv) / (r + r'), and the energy by the integral of du/dr over that.

    Parameters
    ----------
    vector_cd, change_cd
        (C, d) vectors of the pairs where the step starts, and their changes.
    sigma_c
        (C,) contact distances.
    first
        du/dr of (distance, contact distance), both (k,).

    Examples
    --------
    >>> closer = energy_change(np.array([[0.9, 0.0]]), np.array([[-1e-12, 0.0]]), np.ones(1), lambda r, s: r - s)
    >>> round(closer / 1e-13, 10)
    1.0

    """
    before = np.sqrt((vector_cd**2).sum(axis=1))
    after = np.sqrt(((vector_cd + change_cd) ** 2).sum(axis=1))
    either = (before < sigma_c) | (after < sigma_c)
    before, after, sigma = before[either], after[either], sigma_c[either]
    vector, change = vector_cd[either], change_cd[either]
    exact = (2.0 * (vector * change).sum(axis=1) + (change**2).sum(axis=1)) / (before + after)
    low, high = np.minimum(before, sigma), np.minimum(after, sigma)
    length = np.where((before < sigma) & (after < sigma), exact, high - low)
    total = 0.0
    for place, weight in zip(_PLACE, _WEIGHT, strict=True):
        total += weight * float(np.add.reduce(first(low + place * length, sigma) * length))
    return float(total)
