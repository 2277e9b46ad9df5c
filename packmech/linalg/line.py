"""A straight line through points, weighted by their errors: what fits of power laws in logarithms are made of."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Line(NamedTuple):
    """y = height + slope * x.

    `slope_error` and `height_error` are standard errors where those of the points were given, else in units of the
    points' common error; `chi_square` is the sum of squares over those errors, per degree of freedom: nan through two
    points.
    """

    slope: float
    height: float
    slope_error: float
    height_error: float
    chi_square: float


def fit_line(x: NDArray[np.float64], y: NDArray[np.float64], error: NDArray[np.float64] | None = None) -> Line:
    """Return the straight line of least squares.

    Parameters
    ----------
    x, y
        (K,) points, at least two.
    error
        (K,) standard errors of y; None: equal ones.

    Examples
    --------
    >>> line = fit_line(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]))
    >>> round(line.slope, 12), round(line.height, 12)
    (2.0, 1.0)

    """
    weight = None if error is None else 1.0 / error
    found, covariance = np.polyfit(x, y, 1, w=weight, cov="unscaled")
    off = (y - np.polyval(found, x)) * (1.0 if weight is None else weight)
    slope_error, height_error = np.sqrt(np.diag(covariance))
    freedom = len(x) - 2
    chi = float(off @ off) / freedom if freedom > 0 else float("nan")
    return Line(float(found[0]), float(found[1]), float(slope_error), float(height_error), chi)


def windows_without_ends(count: int, shortest: int) -> list[slice]:
    """Return the windows that are left of points in order when some are left out at either end, half at the most.

    Fits in these show how far a result depends on where its points begin and end.

    Parameters
    ----------
    count
        Number of points.
    shortest
        Fewest points that a fit needs; with no more than these there is no window.

    Examples
    --------
    >>> windows_without_ends(4, 3)
    [slice(0, 3, None), slice(1, 4, None)]

    """
    least = max(shortest, (count + 1) // 2)
    pairs = [(low, high) for low in range(count) for high in range(low + least, count + 1)]
    return [slice(low, high) for low, high in pairs if high - low < count]
