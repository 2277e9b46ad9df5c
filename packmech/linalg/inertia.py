"""How many eigenvalues of a sparse symmetric matrix lie below a bound, and whether rounding could change the number.

What is factored is F = L D L^T, which differs from A = matrix - bound by rounding, and by more where pivots were small.
Signs of D are those of the eigenvalues of F (Sylvester). They are those of A as long as |F^-1 (A - F)| < 1: then none
of F + s (A - F), 0 <= s <= 1, is singular. That norm is bounded by what the factorization makes of random vectors x:
with y = F^-1 (A x) the difference x - y is -F^-1 (A - F) x. Along any direction a normal vector has a component z with
P(|z| < t) < 0.8 t, so that the norm is at most the largest |x - y| / t of k vectors, but for a chance (0.8 t)^k.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.linalg.factor import Factorization, NotDefinite, factorize

# vectors, and the component that each is trusted to have along any direction: wrong once in two million times
_VECTORS, _COMPONENT = 3, 0.01
# solves in a row, from one vector, whose component is trusted to be this large: wrong once in a million times
_STEPS, _SMALL_COMPONENT = 6, 1e-6
# what rounding of a matrix's own entries may do to its eigenvalues [largest sum of a row]
_ROUNDING = 1e-14
_NUDGES = (0.0, 1e-14, 1e-13)


class CountBelow(NamedTuple):
    """Number of eigenvalues below a bound, and how sure it is.

    Attributes
    ----------
    number
        How many eigenvalues lie below the bound.
    doubt
        Bound on |F^-1 (A - F)|, with the rounding of A's own entries [1]: below 1 the number is that of A. Infinite
        where the bound is an eigenvalue to rounding.
    distance
        No eigenvalue is nearer to the bound than this [as the eigenvalues]; 0 where the number is not certain.
    factor
        The factorization, without its factors.
    memory
        Of the factors [bytes].

    """

    number: int
    doubt: float
    distance: float
    factor: Factorization | None
    memory: int

    @property
    def certain(self) -> bool:
        """Whether no rounding can have changed the number."""
        return self.doubt < 1.0


def count_below(matrix: Any, bound: float, like: Factorization | None = None) -> CountBelow:
    """Return how many eigenvalues of a sparse symmetric matrix lie below a bound, and how sure that is.

    Parameters
    ----------
    matrix
        (n, n) sparse symmetric array.
    bound
        Upper end of the range.
    like
        As in `factorize`.

    Examples
    --------
    >>> found = count_below(sp.diags_array([1.0, 2.0, 3.0]), 2.5)
    >>> found.number, found.certain, 0.0 < found.distance <= 0.5
    (2, True, True)
    >>> count_below(sp.diags_array([1.0, 2.0, 3.0]), 2.0).certain
    False

    """
    size = matrix.shape[0]
    if not size:
        return CountBelow(0, 0.0, np.inf, None, 0)
    largest = float(abs(matrix).sum(axis=0).max())
    exact = sp.csr_array(matrix) - bound * sp.eye_array(size, format="csr")
    for nudge in _NUDGES:
        shifted = exact - nudge * largest * sp.eye_array(size, format="csr") if nudge else exact
        try:
            factor = factorize(shifted, kind="symmetric", like=like)
        except NotDefinite:
            continue
        return judged(exact, factor, factor.inertia.negative, largest + abs(bound))
    raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue")


def judged(exact: sp.csr_array, factor: Factorization, number: int, largest: float) -> CountBelow:
    """Return a number that the inertia of a factored matrix gave, with how sure it is for the exact one.

    Parameters
    ----------
    exact
        (n, n) the matrix whose inertia is asked for.
    factor
        What was factored in its place, or a symmetric matrix times one of determinant 1.
    number
        What its signs say.
    largest
        Bound on the largest eigenvalue's size, of which rounding of the entries is a part.

    """
    if factor.inertia.zero:
        # a pivot of no sign, and nothing that could be solved
        return CountBelow(number, np.inf, 0.0, factor.emptied(), factor.memory)
    distance = _distance(factor)
    spread = 0.0
    rng = np.random.default_rng(1)
    for _ in range(_VECTORS):
        vector = rng.normal(size=factor.size)
        with np.errstate(all="ignore"):
            spread = max(spread, _norm(factor.solve_once(exact @ vector) - vector))
    doubt = spread / _COMPONENT + (_ROUNDING * largest / distance if distance > 0.0 else np.inf)
    doubt = doubt if np.isfinite(doubt) else np.inf
    return CountBelow(number, doubt, distance * max(1.0 - doubt, 0.0), factor.emptied(), factor.memory)


def _distance(factor: Factorization) -> float:
    """Return a lower bound on the size of all eigenvalues of what was factored, by powers of its inverse."""
    vector = np.random.default_rng(0).normal(size=factor.size)
    logarithm = 0.0
    for _ in range(_STEPS):
        with np.errstate(all="ignore"):
            vector = factor.solve(vector)
        size = _norm(vector)
        if not 0.0 < size < np.inf:
            return 0.0
        logarithm += np.log(size)
        vector = vector / size
    return float(np.exp((np.log(_SMALL_COMPONENT) - logarithm) / _STEPS))


def _norm(vector: NDArray[np.float64]) -> float:
    with np.errstate(all="ignore"):
        size = float(np.linalg.norm(vector))
    return size if np.isfinite(size) else np.inf
