"""Means with error bars: over repeats, and over blocks of a signal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, integer, one_of

ERRORS = ("standard", "bootstrap")


def mean_with_error(
    value_r: ArrayLike, *, error: str = "standard", draws: int = 2000, seed: int = 0
) -> tuple[float, float]:
    """Return the mean of independent values and the error of it; nan as the error of a single one.

    Parameters
    ----------
    value_r
        (R,) values, such as those of repeats.
    error
        "standard": standard deviation over the root of R. "bootstrap": standard deviation of the means of `draws`
        samples drawn with replacement, times sqrt(R / (R - 1)), without which it is too small for few values.
    draws, seed
        Of the bootstrap.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> mean_with_error([1.0, 2.0, 3.0])
    (2.0, 0.5773502691896258)

    """
    value = finite_array("value_r", value_r, shape=(None,), what="value")
    one_of("error", error, ERRORS)
    count = integer("draws", draws, at_least=2)
    rng = np.random.default_rng(integer("seed", seed, at_least=0))
    mean = float(value.mean())
    if len(value) == 1:
        return mean, math.nan
    if error == "standard":
        return mean, float(value.std(ddof=1) / math.sqrt(len(value)))
    drawn = value[rng.integers(len(value), size=(count, len(value)))].mean(axis=1)
    return mean, float(drawn.std() * math.sqrt(len(value) / (len(value) - 1.0)))


def block_mean(value_t: NDArray[np.float64], blocks: int) -> tuple[float, float]:
    """Return the mean of a signal and its error from the means of equal blocks, as if these were independent.

    Parameters
    ----------
    value_t
        (T,) values, at least one for each block.
    blocks
        At least 2.

    """
    means = np.array([part.mean() for part in np.array_split(value_t, blocks)])
    return float(value_t.mean()), float(means.std(ddof=1) / math.sqrt(blocks))
