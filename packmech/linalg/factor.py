"""Sparse symmetric factorizations A = L D L^T behind one call: factor once, solve many, and see the signs of D.

The signs of D are the inertia of A (Sylvester's law): how many eigenvalues are positive, negative, zero. A matrix
that should be positive definite and is not never passes silently: `factorize` raises `NotDefinite` unless
`kind="symmetric"` is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, one_of

BACKENDS = ("qdldl", "superlu", "dense", "rslab")
# a pivot below this fraction of the largest entry of its row has lost all its digits
ZERO_PIVOT = 1e-12
# |L||D||L^T| above this multiple of |A| leaves fewer than eight digits of an indefinite factorization
GROWTH_LIMIT = 1e8
_DENSE_SIZE = 4000
# rows from which on supernodes win in two dimensions too
_LARGE = 12000
_REFINEMENTS = 3
_SINGULAR = "matrix must be nonsingular on the motions that the links admit, got a zero pivot"
# a link whose pivot is below this [stiffness] depends on others to rounding
_DEPENDENT = 1e-14


class Inertia(NamedTuple):
    """Numbers of positive, negative and (to rounding) zero eigenvalues."""

    positive: int
    negative: int
    zero: int


class NotDefinite(np.linalg.LinAlgError):  # noqa: N818 - says what the matrix is
    """Raised when a matrix that must be positive definite is not; `.inertia` says how far off it is, if known."""

    def __init__(self, message: str, inertia: Inertia | None = None) -> None:
        self.inertia = inertia
        super().__init__(message)


@dataclass(frozen=True, eq=False)
class Factorization:
    """A factored symmetric matrix.

    Attributes
    ----------
    size
        Number of rows.
    inertia
        Signs of the pivots, which are the signs of the eigenvalues.
    growth
        Largest row of |L||D||L^T| over the largest entry of A [1]: 1 for definite matrices, large where pivoting was
        missed.
    backend
        Which library factored it.

    """

    size: int
    inertia: Inertia
    growth: float
    backend: str
    _solve: Callable[[NDArray[np.float64]], NDArray[np.float64]]

    def solve(self, right: ArrayLike) -> NDArray[np.float64]:
        """Return x with A x = right, for one (n,) or several (n, k) right-hand sides.

        Raises
        ------
        ValueError
            If the right-hand side is not finite or has another length than the matrix.

        """
        sides = np.asarray(right, dtype=np.float64)
        sides = finite_array("right", sides, shape=(None,) * max(1, min(sides.ndim, 2)), what="row", empty=True)
        if sides.shape[0] != self.size:
            raise ValueError(f"right must have {self.size} rows, got {sides.shape[0]}")
        if not sides.size:
            return sides
        return self._solve(sides)


class _Failed(Exception):  # noqa: N818 - internal: this backend cannot factor this matrix
    pass


def factorize(matrix: Any, *, kind: str = "definite", backend: str = "auto") -> Factorization:
    """Return the factorization of a sparse symmetric matrix.

    Parameters
    ----------
    matrix
        (n, n) sparse array; symmetric (only its upper triangle may be read).
    kind
        "definite" raises `NotDefinite` unless all pivots are positive; "symmetric" takes any nonsingular matrix and
        reports its inertia.
    backend
        "qdldl" (sparse L D L^T), "superlu" (SciPy, minimum degree on A + A^T, pivots on the diagonal), "dense"
        (LAPACK, at most 4000 rows), "rslab" (supernodal with Bunch-Kaufman pivots), or "auto": qdldl while rows are
        short (two dimensions) or the matrix small, rslab otherwise. Measured, one thread, CPU milliseconds of a
        factorization: 2D N = 1024: qdldl 4.7, SuperLU 8.1, rslab 7.7; 4096: 28, 63, 29; 16384: 228, 516, 118; 3D N =
        256: 7.3, 7.7, 5.7; 1024: 147, 98, 43; 2048: 556, 453, 106. Without pivoting an indefinite matrix can lose
        its digits; "auto" notices by the growth and falls back to the dense one.

    Raises
    ------
    TypeError, ValueError
        If the matrix is not a sparse, square matrix of finite numbers, or a name is unknown.
    NotDefinite
        If `kind` is "definite" and the matrix is not, or if it is singular beyond factoring.

    Examples
    --------
    >>> spring = sp.csr_array([[2.0, -1.0], [-1.0, 2.0]])
    >>> factor = factorize(spring)
    >>> factor.solve([1.0, 0.0]).round(12).tolist(), factor.inertia
    ([0.666666666667, 0.333333333333], Inertia(positive=2, negative=0, zero=0))
    >>> factorize(sp.csr_array([[1.0, 2.0], [2.0, 1.0]]))
    Traceback (most recent call last):
    ...
    packmech.linalg.factor.NotDefinite: matrix must be positive definite, got 1 negative and 0 zero pivots of 2

    """
    one_of("kind", kind, ("definite", "symmetric"))
    one_of("backend", backend, ("auto", *BACKENDS))
    column = _checked(matrix)
    size = column.shape[0]
    if size == 0:
        return Factorization(0, Inertia(0, 0, 0), 1.0, "none", lambda right: right)
    order = _order(column) if backend == "auto" else (backend,)
    reason = ""
    for name in order:
        try:
            inertia, growth, solve = _TRY[name](column)
        except _Failed as failure:
            reason = str(failure)
            continue
        if kind == "definite" and inertia.positive < size:
            raise NotDefinite(
                "matrix must be positive definite, got "
                f"{inertia.negative} negative and {inertia.zero} zero pivots of {size}",
                inertia,
            )
        if growth > GROWTH_LIMIT and name != order[-1]:
            reason = f"growth {growth:.1e}"
            continue
        return Factorization(size, inertia, growth, name, solve)
    raise NotDefinite(f"matrix must be nonsingular, got one that {' and '.join(order)} cannot factor ({reason})")


def eigenvalues_below(matrix: Any, bound: float) -> int:
    """Return how many eigenvalues of a sparse symmetric matrix lie below the bound, by the inertia of matrix - bound.

    Parameters
    ----------
    matrix
        (n, n) sparse symmetric array.
    bound
        Upper end of the range, exclusive; should not be an eigenvalue.

    Examples
    --------
    >>> eigenvalues_below(sp.diags_array([1.0, 2.0, 3.0]), 2.5)
    2

    """
    column = sp.csc_array(_checked(matrix))
    size = column.shape[0]
    largest = float(np.abs(column.data).max(initial=0.0))
    for nudge in (0.0, 1e-14, 1e-13):
        shifted = column - (bound + nudge * largest) * sp.eye_array(size, format="csc")
        try:
            return factorize(shifted, kind="symmetric").inertia.negative
        except NotDefinite:
            continue
    raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue")


def _checked(matrix: Any) -> sp.csc_matrix:
    if not sp.issparse(matrix):
        raise TypeError(f"matrix must be a scipy sparse array, got {type(matrix).__name__}")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"matrix must be square, got shape {matrix.shape}")
    if not matrix.nnz:
        return sp.csc_matrix(matrix.shape, dtype=np.float64)
    if matrix.format == "csr" and matrix.has_canonical_format:
        # symmetric: its rows are its columns
        column = sp.csc_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape, dtype=np.float64)
    else:
        column = sp.csc_matrix(matrix, dtype=np.float64)
    column.sum_duplicates()
    data, row, size = column.data, column.indices, column.shape[0]
    finite = np.isfinite(data)
    if not finite.all():
        raise ValueError(f"matrix must be finite, got {data[~finite][0]} in row {int(row[~finite][0])}")
    owner = _columns(column)
    probe = np.random.default_rng(0).normal(size=size)
    skew = np.abs(np.bincount(row, data * probe[owner], size) - np.bincount(owner, data * probe[row], size)).max()
    if skew > 1e-8 * np.abs(data).max() * np.abs(probe).max():
        raise ValueError(f"matrix must be symmetric, got one whose transpose differs by about {skew:.2g}")
    return column


def _columns(column: sp.csc_matrix) -> NDArray[np.int64]:
    """Return the column of each stored entry."""
    return np.repeat(np.arange(column.shape[0]), np.diff(column.indptr))


def _order(column: sp.csc_matrix) -> tuple[str, ...]:
    size = column.shape[0]
    # long rows fill in so much that supernodes win; crossovers measured on jammed packings
    full = (column.nnz > 18 * size and size > 700) or size > _LARGE
    first = ("rslab", "superlu", "qdldl") if full else ("qdldl", "superlu")
    return (*first, "dense") if size <= _DENSE_SIZE else first


def _row_scale(column: sp.csc_matrix) -> NDArray[np.float64]:
    """Return the largest entry of each row, in size."""
    scale = np.zeros(column.shape[0])
    filled = np.diff(column.indptr) > 0
    if filled.any():
        scale[filled] = np.maximum.reduceat(np.abs(column.data), column.indptr[:-1][filled])
    return scale


def _inertia(pivot: NDArray[np.float64], scale: NDArray[np.float64]) -> Inertia:
    zero = (np.abs(pivot) <= ZERO_PIVOT * scale) | (scale == 0.0)
    positive = int(np.count_nonzero((pivot > 0) & ~zero))
    negative = int(np.count_nonzero((pivot < 0) & ~zero))
    return Inertia(positive, negative, int(np.count_nonzero(zero)))


def _growth(lower: sp.csc_matrix, pivot: NDArray[np.float64], scale: NDArray[np.float64]) -> float:
    """Return max over rows of (|L||D||L^T|)_ii / max|A|, for a unit lower factor given with or without its diagonal."""
    squares = lower.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        squares.data = squares.data**2
        growth = float((squares @ np.abs(pivot)).max(initial=0.0) / scale.max())
    return growth if np.isfinite(growth) else np.inf


def _upper(column: sp.csc_matrix) -> sp.csc_matrix:
    """Return the upper triangle with every diagonal entry stored, zero or not, as the library wants it."""
    size, owner = column.shape[0], _columns(column)
    inside = column.indices <= owner
    count = np.bincount(owner[inside], minlength=size)
    start = np.concatenate([[0], np.cumsum(count)])
    upper = sp.csc_matrix((column.data[inside], column.indices[inside], start), shape=column.shape)
    if np.count_nonzero(column.data[column.indices == owner]) < size:
        diagonal = column.diagonal()
        upper = sp.csc_matrix(sp.triu(upper, k=1) + sp.diags(np.where(diagonal == 0.0, np.finfo(float).tiny, diagonal)))
    return upper


def _qdldl(column: sp.csc_matrix) -> tuple[Inertia, float, Callable[..., NDArray[np.float64]]]:
    import qdldl

    upper = _upper(column)
    try:
        solver = qdldl.Solver(upper, True)
        lower, pivot, order = solver.factors()
    except RuntimeError as error:
        raise _Failed("a zero pivot") from error
    if not np.isfinite(pivot).all():
        raise _Failed("a zero pivot")
    scale = _row_scale(column)
    inertia = _inertia(pivot, scale[np.asarray(order)])
    growth = 1.0 if inertia.positive == len(pivot) else _growth(lower, pivot, scale)

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        if right.ndim == 1:
            return np.asarray(solver.solve(right))
        return np.stack([solver.solve(np.ascontiguousarray(one)) for one in right.T], axis=1)

    return inertia, growth, solve


def _superlu(column: sp.csc_matrix) -> tuple[Inertia, float, Callable[..., NDArray[np.float64]]]:
    try:
        factor = spla.splu(
            column, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
        )
    except RuntimeError as error:
        raise _Failed("a zero pivot") from error
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise _Failed("pivots off the diagonal")
    pivot = factor.U.diagonal()
    scale = _row_scale(column)
    order = np.argsort(factor.perm_c)
    inertia = _inertia(pivot, scale[order])
    growth = 1.0 if inertia.positive == len(pivot) else _growth(factor.L, pivot, scale)
    return inertia, growth, factor.solve


def _dense(column: sp.csc_matrix) -> tuple[Inertia, float, Callable[..., NDArray[np.float64]]]:
    import scipy.linalg

    if column.shape[0] > _DENSE_SIZE:
        raise _Failed(f"more than {_DENSE_SIZE} rows")
    full = column.toarray()
    scale = np.abs(full).max(axis=0)
    root = np.sqrt(np.where(scale > 0, scale, 1.0))
    lower, blocks, order = scipy.linalg.ldl(full / root / root[:, None])
    lower = lower[order]
    # the middle factor has blocks of one and two rows: a band of three diagonals
    inertia = _inertia(scipy.linalg.eigvalsh_tridiagonal(blocks.diagonal(), blocks.diagonal(1)), np.ones(len(root)))
    band = np.zeros((3, len(root)))
    band[0, 1:], band[1], band[2, :-1] = blocks.diagonal(1), blocks.diagonal(), blocks.diagonal(-1)

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        back = root.reshape((-1,) + (1,) * (right.ndim - 1))
        inside = scipy.linalg.solve_triangular(lower, (right / back)[order], lower=True, unit_diagonal=True)
        inside = scipy.linalg.solve_banded((1, 1), band, inside)
        inside = scipy.linalg.solve_triangular(lower, inside, lower=True, unit_diagonal=True, trans="T")
        result = np.empty_like(inside)
        result[order] = inside
        return np.asarray(result / back)

    return inertia, 1.0, solve


def _rslab(column: sp.csc_matrix) -> tuple[Inertia, float, Callable[..., NDArray[np.float64]]]:
    try:
        import rslab
    except ImportError:
        raise _Failed("rslab is not installed") from None
    try:
        factor = rslab.ldlt(column, threads=1)
    except RuntimeError as error:
        raise _Failed(str(error)) from error

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(factor.solve(right) if right.ndim == 1 else factor.solve_many(right))

    return Inertia(*factor.inertia), 1.0, solve


_TRY = {"qdldl": _qdldl, "superlu": _superlu, "dense": _dense, "rslab": _rslab}


def _particle_order(matrix: sp.csr_array, dimension: int) -> NDArray[np.int64]:
    """Return the place of each particle in an order of elimination with little fill (minimum degree).

    Parameters
    ----------
    matrix
        Sparse array whose (d, d) blocks are the graph.
    dimension
        d.

    """
    coo = matrix.tocoo()
    # turns may make the last block shorter; blocks need not be those of particles
    n = -(-matrix.shape[0] // dimension)
    graph = sp.csc_array((np.ones(coo.nnz), (coo.row // dimension, coo.col // dimension)), shape=(n, n))
    graph.sum_duplicates()
    graph.data[:] = 1.0
    heavy = sp.csc_matrix(graph + graph.T + sp.diags_array(2.0 * np.asarray(graph.sum(axis=0)).ravel() + 1.0))
    options = {"SymmetricMode": True, "Equil": False}
    factor = spla.splu(heavy, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.asarray(factor.perm_c, dtype=np.int64)


def factor_saddle(
    matrix: sp.csr_array, gradient: sp.csr_array, dimension: int, *, stiffness: float | None = None
) -> Factorization:
    """Return [[H, G^T], [G, 0]] factored without pivoting; right-hand sides are (N d + L,) or (N d + L, k).

    The zero block rules out an arbitrary order of elimination, and Bunch-Kaufman pivots inside supernodes call well
    conditioned systems singular. Here each link is eliminated right after the later of its two particles, in an order
    of the particles that keeps the fill low; H + s G^T G stands in for H, which changes no solution with G u = 0. Then
    every leading block is regular where the motions that the links admit are stable, and the signs of the pivots count,
    without any slack in the links, the unstable ones: negative pivots less one for each link (Haynsworth).

    Parameters
    ----------
    matrix
        (N d, N d) stiffness H [force/length], its translations taken out.
    gradient
        (L, N d) gradients G of the links' lengths, of full rank.
    dimension
        d.
    stiffness
        Unit of the link rows [force/length]; the mean diagonal of H unless given. Rows and columns of the links are
        those of G times this.

    Raises
    ------
    NotDefinite
        If a pivot vanishes: the links depend on each other, or H is singular on what they admit.

    Examples
    --------
    >>> held = sp.csr_array(np.diag([2.0, 2.0, 1.0, 1.0]))
    >>> link = sp.csr_array([[-1.0, 0.0, 1.0, 0.0]])
    >>> done = factor_saddle(held, link, 2, stiffness=1.0)
    >>> np.abs(done.solve([3.0, 0.0, 0.0, 0.0, 0.0])).round(12).tolist(), done.inertia.negative - 1
    ([1.0, 0.0, 1.0, 0.0, 1.0], 0)

    """
    size, count = matrix.shape[0], gradient.shape[0]
    if stiffness is None:
        diagonal = np.abs(matrix.diagonal())
        stiffness = float(diagonal.mean()) if diagonal.any() else 1.0
    side = sp.csr_array(stiffness * gradient)
    stiff = sp.csr_array(matrix + gradient.T @ side)
    rank = _particle_order(stiff, dimension)
    owner = np.repeat(rank, dimension)[:size]
    ends = np.zeros(count, dtype=np.int64)
    filled = np.diff(side.indptr) > 0
    if filled.any():
        ends[filled] = np.maximum.reduceat(owner[side.indices], side.indptr[:-1][filled])
    order = np.lexsort((np.concatenate([np.zeros(size), np.ones(count)]), np.concatenate([owner, ends])))
    exact = sp.csr_array(sp.block_array([[matrix, side.T], [side, None]], format="csr"))
    whole = sp.csr_array(sp.block_array([[stiff, side.T], [side, None]], format="csr"))
    shuffled = sp.csc_matrix(whole[order][:, order])
    try:
        factor = spla.splu(
            shuffled, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
        )
    except RuntimeError as failure:
        raise NotDefinite(_SINGULAR) from failure
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise NotDefinite(_SINGULAR)
    pivot = factor.U.diagonal()
    if count and np.abs(pivot[order >= size]).min() < _DEPENDENT * stiffness:
        raise NotDefinite(_SINGULAR)
    inertia = Inertia(int((pivot > 0).sum()), int((pivot < 0).sum()), int((pivot == 0).sum()))

    def once(right: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty_like(right)
        out[order] = factor.solve(np.ascontiguousarray(right[order]))
        # the links' forces under H + s G^T G and under H differ by s G u
        out[size:] += gradient @ out[:size]
        return out

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        answer = once(right)
        error = np.inf
        for _ in range(_REFINEMENTS):
            left = right - exact @ answer
            now = float(np.abs(left).max(initial=0.0))
            if not now < 0.1 * error:
                break
            error = now
            answer = answer + once(left)
        return answer

    return Factorization(size + count, inertia, 1.0, "saddle", solve)
