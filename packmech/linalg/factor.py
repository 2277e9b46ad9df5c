"""Sparse symmetric factorizations A = L D L^T behind one call: factor once, solve many, and see the signs of D.

The signs of D are the inertia of A (Sylvester's law): how many eigenvalues are positive, negative, zero. A matrix
that should be positive definite and is not never passes silently: `factorize` raises `NotDefinite` unless
`kind="symmetric"` is asked for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, one_of
from packmech.jit.compiled import kernel
from packmech.linalg.block_factor import Plan, block_size, factor_blocks, growth, plan, solve_blocks
from packmech.linalg.threads import allowed_threads

BACKENDS = ("blocks", "qdldl", "superlu", "dense", "rslab")
# a pivot below this fraction of the largest entry of its row has lost all its digits
ZERO_PIVOT = 1e-12
# |L||D||L^T| above this multiple of |A| leaves fewer than eight digits of an indefinite factorization
GROWTH_LIMIT = 1e8
_DENSE_SIZE = 4000
# rows from which on supernodes win in two dimensions too: over blocks, and over single entries
_LARGE_BLOCKS, _LARGE = 25_000, 12_000
# rows from which on nested dissection is taken without trying other orders, which take longer than they gain
_DISSECTED = 400_000
_REFINEMENTS = 3
_TINY = float(np.finfo(float).tiny)
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
    memory
        Of the factors [bytes]; 0 where the library does not say.

    """

    size: int
    inertia: Inertia
    growth: float
    backend: str
    _solve: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    _analyzed: _Known = None
    memory: int = 0
    # solves by the factors alone, where `_solve` refines
    _once: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None

    def solve_once(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the factors alone make of checked right-hand sides, without refinement."""
        return (self._once or self._solve)(right)

    def emptied(self) -> Factorization:
        """Return it without its factors: it solves nothing, and serves as `like` of another one."""
        return replace(self, _solve=_spent, _once=None)

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


def _spent(right: NDArray[np.float64]) -> NDArray[np.float64]:
    raise ValueError("factorization must hold its factors, got an emptied one")


class _Failed(Exception):  # noqa: N818 - internal: this backend cannot factor this matrix
    pass


class _Stored(NamedTuple):
    """A symmetric matrix by columns, which are its rows, in order, and the largest entry of each in size.

    `block` is the size of the blocks that it is made of.
    """

    data: NDArray[np.float64]
    row: NDArray[np.int32]
    start: NDArray[np.int32]
    scale: NDArray[np.float64]
    block: int

    def whole(self) -> sp.csc_matrix:
        """Return it as a matrix of SciPy."""
        return sp.csc_matrix((self.data, self.row, self.start), shape=(len(self.scale), len(self.scale)))


class _Analyzed:
    """A triangle of a matrix, and what a library has found out about the places of its entries."""

    def __init__(self, triangle: tuple[Any, ...], analyze: Callable[[sp.csc_matrix], Any]) -> None:
        size = len(triangle[2]) - 1
        self.triangle = sp.csc_matrix(triangle, shape=(size, size))
        self.found = analyze(self.triangle)

    def takes(self, data: NDArray[np.float64], index: NDArray[np.int32], start: NDArray[np.int32]) -> bool:
        """Return whether the entries of another triangle stand at these places; if so, take them."""
        same = np.array_equal(index, self.triangle.indices) and np.array_equal(start, self.triangle.indptr)
        if same:
            self.triangle.data = data
        return same


# what a library has found out about the places of the entries
_Known = _Analyzed | Plan | None


@kernel
def _inspect(data, index, start, probe):  # type: ignore[no-untyped-def]
    """Return the largest entry of each row in size, that of (A - A^T) probe, and where an entry is not finite or -1."""
    size = start.shape[0] - 1
    scale, skew = np.zeros(size), np.zeros(size)
    for row in range(size):
        for k in range(start[row], start[row + 1]):
            if not np.isfinite(data[k]):
                return scale, 0.0, k
            scale[row] = max(scale[row], abs(data[k]))
            skew[row] += data[k] * probe[index[k]]
            skew[index[k]] -= data[k] * probe[row]
    largest = 0.0
    for row in range(size):
        largest = max(largest, abs(skew[row]))
    return scale, largest, -1


@kernel
def _triangle(data, index, start, upper):  # type: ignore[no-untyped-def]
    """Return a triangle by columns, the upper one with every diagonal entry, zero or not, as the library wants it."""
    size = start.shape[0] - 1
    values, rows = np.empty(data.shape[0] + size), np.empty(data.shape[0] + size, np.int32)
    first = np.zeros(size + 1, np.int32)
    place = 0
    for column in range(size):
        diagonal = 0.0
        for k in range(start[column], start[column + 1]):
            if (index[k] < column) if upper else (index[k] >= column):
                values[place], rows[place] = data[k], index[k]
                place += 1
            elif index[k] == column:
                diagonal = data[k]
        if upper:
            values[place], rows[place] = diagonal if diagonal != 0.0 else _TINY, column
            place += 1
        first[column + 1] = place
    return values[:place], rows[:place], first


@functools.lru_cache(maxsize=16)
def _probe(size: int) -> NDArray[np.float64]:
    """Return a vector in no special direction."""
    return np.random.default_rng(0).normal(size=size)


def factorize(
    matrix: Any, *, kind: str = "definite", backend: str = "auto", like: Factorization | None = None
) -> Factorization:
    """Return the factorization of a sparse symmetric matrix.

    Parameters
    ----------
    matrix
        (n, n) sparse array; symmetric (only its upper triangle may be read).
    kind
        "definite" raises `NotDefinite` unless all pivots are positive; "symmetric" takes any nonsingular matrix and
        reports its inertia.
    backend
        "blocks" (L D L^T by blocks of 2 or 3 coordinates of a particle, or of 1), "qdldl" (sparse L D L^T), "superlu"
        (SciPy, minimum degree on A + A^T, pivots on the diagonal), "dense" (LAPACK, at most 4000 rows), "rslab"
        (supernodal with Bunch-Kaufman pivots), or "auto": while rows are short (two dimensions) or the matrix small,
        blocks where it is made of such, qdldl where it is not; rslab otherwise. Measured, one thread, CPU milliseconds
        of a factorization: 2D N = 1024: blocks 2.0, qdldl 3.7, SuperLU 5.7, rslab 5.4; 4096: 14, 27, 34, 27; 16384:
        119, 273, 516 (in another run), 117; 3D N = 256: 2.2, 4.3, 4.5, 4.2; 512: 11.4, 23, 16, 11.1; 1024: 71, 116, 90,
        30. Without pivoting an indefinite matrix can lose its digits; "auto" notices by the growth and falls back to
        the dense one.
    like
        A factorization that is needed no more: where its matrix had entries at the same places, the order of
        elimination serves again, and it must not be used to solve from then on. Measured, CPU milliseconds of a
        factorization with it and without: 2D N = 256: 0.17 and 0.25; 1024: 1.2 and 2.0; 3D N = 256: 1.9 and 2.2.

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
    stored = _checked(matrix)
    size = len(stored.scale)
    if size == 0:
        return Factorization(0, Inertia(0, 0, 0), 1.0, "none", lambda right: right)
    order = _order(stored) if backend == "auto" else (backend,)
    reason = ""
    for name in order:
        try:
            known = like._analyzed if like is not None and like.backend == name else None
            inertia, growth, solve, known, memory = _TRY[name](stored, known)
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
        return Factorization(size, inertia, growth, name, solve, known, memory)
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
    largest = float(_checked(matrix).scale.max(initial=0.0))
    one = sp.eye_array(matrix.shape[0], format="csr")
    for nudge in (0.0, 1e-14, 1e-13):
        shifted = sp.csr_array(matrix) - (bound + nudge * largest) * one
        try:
            return factorize(shifted, kind="symmetric").inertia.negative
        except NotDefinite:
            continue
    raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue")


def _checked(matrix: Any) -> _Stored:
    if not sp.issparse(matrix):
        raise TypeError(f"matrix must be a scipy sparse array, got {type(matrix).__name__}")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"matrix must be square, got shape {matrix.shape}")
    if matrix.dtype.kind == "c":
        raise TypeError(f"matrix must be real, got {matrix.dtype}")
    if matrix.format not in ("csr", "csc") or not matrix.has_canonical_format:
        matrix = sp.csr_array(matrix, copy=True)
        matrix.sum_duplicates()
    # of a symmetric matrix rows are columns
    size, data = matrix.shape[0], np.asarray(matrix.data, dtype=np.float64)
    index, start = (np.asarray(one, dtype=np.int32) for one in (matrix.indices, matrix.indptr))
    probe = _probe(size)
    scale, skew, bad = _inspect(data, index, start, probe)
    if bad >= 0:
        row = int(np.searchsorted(start, bad, side="right")) - 1
        raise ValueError(f"matrix must be finite, got {data[bad]} in row {row}")
    if skew > 1e-8 * scale.max(initial=0.0) * np.abs(probe).max(initial=0.0):
        raise ValueError(f"matrix must be symmetric, got one whose transpose differs by about {skew:.2g}")
    return _Stored(data, index, start, scale, block_size(index, start))


def _order(matrix: _Stored) -> tuple[str, ...]:
    size = len(matrix.scale)
    # long rows fill in so much that supernodes win; crossovers measured on jammed packings
    blocks = matrix.block > 1
    short, large = (1500, _LARGE_BLOCKS) if blocks else (700, _LARGE)
    full = (len(matrix.data) > 18 * size and size > short) or size > large
    plain = ("blocks", "qdldl", "superlu") if blocks else ("qdldl", "superlu")
    first = ("rslab", "superlu", "qdldl") if full else plain
    return (*first, "dense") if size <= _DENSE_SIZE else first


# inertia, growth, solve, what holds for other matrices with entries at the same places, and bytes of the factors
_Found = tuple[Inertia, float, Callable[[NDArray[np.float64]], NDArray[np.float64]], _Known, int]
# of a stored entry and its row
_ENTRY_BYTES = 12


def _inertia(pivot: NDArray[np.float64], scale: NDArray[np.float64]) -> Inertia:
    """Return how many pivots are positive, negative and zero to rounding of a scale each."""
    sign = np.where((scale == 0.0) | (np.abs(pivot) <= ZERO_PIVOT * scale), 0.0, np.sign(pivot))
    return Inertia(*(int(np.count_nonzero(sign == one)) for one in (1.0, -1.0, 0.0)))


def _growth(lower: sp.csc_matrix, pivot: NDArray[np.float64], scale: NDArray[np.float64]) -> float:
    """Return max over rows of (|L||D||L^T|)_ii / max|A|, for a unit lower factor given with or without its diagonal."""
    squares = lower.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        squares.data = squares.data**2
        growth = float((squares @ np.abs(pivot)).max(initial=0.0) / scale.max())
    return growth if np.isfinite(growth) else np.inf


def _blocks(matrix: _Stored, known: Any) -> _Found:
    if not matrix.block:
        raise _Failed("entries without their mirror images")
    if known is None or not known.fits(matrix.block, matrix.row, matrix.start):
        known = plan(matrix.block, matrix.row, matrix.start)
    factors = factor_blocks(matrix.data, known)
    if factors is None:
        raise _Failed("a zero pivot")
    scale = matrix.scale.reshape(-1, known.size)[known.order]
    inertia = _inertia(factors.pivot_nq.ravel(), scale.ravel())
    grown = 1.0 if inertia.positive == len(matrix.scale) else growth(known, factors) / float(matrix.scale.max())
    memory = sum(one.nbytes for one in factors)
    return inertia, grown, functools.partial(solve_blocks, known, factors), known, memory


def _qdldl(matrix: _Stored, known: Any) -> _Found:
    import qdldl

    upper = _triangle(matrix.data, matrix.row, matrix.start, True)
    try:
        if known is not None and known.takes(*upper):
            known.found.update(known.triangle, upper=True)
        else:
            known = _Analyzed(upper, lambda triangle: qdldl.Solver(triangle, upper=True))
        solver = known.found
        lower, pivot, order = solver.factors()
    except RuntimeError as error:
        raise _Failed("a zero pivot") from error
    if not np.isfinite(pivot).all():
        raise _Failed("a zero pivot")
    inertia = _inertia(pivot, matrix.scale[np.asarray(order)])
    growth = 1.0 if inertia.positive == len(pivot) else _growth(lower, pivot, matrix.scale)

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        if right.ndim == 1:
            return np.asarray(solver.solve(right))
        return np.stack([solver.solve(np.ascontiguousarray(one)) for one in right.T], axis=1)

    return inertia, growth, solve, known, _ENTRY_BYTES * int(lower.nnz)


def _superlu(matrix: _Stored, known: Any) -> _Found:
    options = {"SymmetricMode": True, "Equil": False}
    try:
        factor = spla.splu(matrix.whole(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError as error:
        raise _Failed("a zero pivot") from error
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise _Failed("pivots off the diagonal")
    pivot = factor.U.diagonal()
    if not np.isfinite(pivot).all():
        raise _Failed("a pivot that is not finite")
    inertia = _inertia(pivot, matrix.scale[np.argsort(factor.perm_c)])
    growth = 1.0 if inertia.positive == len(pivot) else _growth(factor.L, pivot, matrix.scale)
    return inertia, growth, factor.solve, None, _ENTRY_BYTES * int(factor.nnz)


def _dense(matrix: _Stored, known: Any) -> _Found:
    import scipy.linalg

    if len(matrix.scale) > _DENSE_SIZE:
        raise _Failed(f"more than {_DENSE_SIZE} rows")
    full = matrix.whole().toarray()
    root = np.sqrt(np.where(matrix.scale > 0, matrix.scale, 1.0))
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

    return inertia, 1.0, solve, None, int(lower.nbytes)


def _rslab(matrix: _Stored, known: Any) -> _Found:
    try:
        import rslab
    except ImportError:
        raise _Failed("rslab is not installed") from None
    lower = _triangle(matrix.data, matrix.row, matrix.start, False)
    try:
        if known is None or not known.takes(*lower):
            order = "metis" if len(matrix.scale) > _DISSECTED else "auto"
            known = _Analyzed(
                lower, lambda triangle: rslab.analyze(triangle, path="ldlt", threads=allowed_threads(), ordering=order)
            )
        factor = known.found.factor(lower[0])
    except RuntimeError as error:
        raise _Failed(str(error)) from error

    def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(factor.solve(right) if right.ndim == 1 else factor.solve_many(right))

    return Inertia(*factor.inertia), 1.0, solve, known, int(factor.heap_bytes)


_TRY = {"blocks": _blocks, "qdldl": _qdldl, "superlu": _superlu, "dense": _dense, "rslab": _rslab}


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

    return Factorization(size + count, inertia, 1.0, "saddle", solve, memory=_ENTRY_BYTES * int(factor.nnz), _once=once)
