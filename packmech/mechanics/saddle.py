"""Sparse factorization of [[H, G^T], [G, 0]] without pivoting: stiffness of particles, and gradients of rigid links.

The zero block rules out an arbitrary order of elimination, and Bunch-Kaufman pivots inside supernodes call well
conditioned systems singular. Here each link is eliminated right after the later of its two particles, in an order of
the particles that keeps the fill low; H + s G^T G stands in for H, which changes no solution with G u = 0. Then every
leading block is regular where the motions that the links admit are stable, and the signs of the pivots count, without
any slack in the links, the unstable ones: negative pivots less one for each link (Haynsworth).
"""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.mechanics.factor import Factorization, Inertia, NotDefinite

_REFINEMENTS = 3
_SINGULAR = "matrix must be nonsingular on the motions that the links admit, got a zero pivot"
# a link whose pivot is below this [stiffness] hangs on others to rounding
_DEPENDENT = 1e-14


def particle_order(matrix: sp.csr_array, dimension: int) -> NDArray[np.int64]:
    """Return the place of each particle in an order of elimination with little fill (minimum degree).

    Parameters
    ----------
    matrix
        (N d, N d) sparse array whose blocks are the graph.
    dimension
        d.

    """
    coo = matrix.tocoo()
    n = matrix.shape[0] // dimension
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
    """Return the factored system; right-hand sides are (N d + L,) or (N d + L, k), positions first.

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
    began = time.process_time()
    size, count = matrix.shape[0], gradient.shape[0]
    if stiffness is None:
        diagonal = np.abs(matrix.diagonal())
        stiffness = float(diagonal.mean()) if diagonal.any() else 1.0
    side = sp.csr_array(stiffness * gradient)
    firm = sp.csr_array(matrix + gradient.T @ side)
    rank = particle_order(firm, dimension)
    owner = np.repeat(rank, dimension)
    ends = np.zeros(count, dtype=np.int64)
    filled = np.diff(side.indptr) > 0
    if filled.any():
        ends[filled] = np.maximum.reduceat(owner[side.indices], side.indptr[:-1][filled])
    order = np.lexsort((np.concatenate([np.zeros(size), np.ones(count)]), np.concatenate([owner, ends])))
    exact = sp.csr_array(sp.block_array([[matrix, side.T], [side, None]], format="csr"))
    whole = sp.csr_array(sp.block_array([[firm, side.T], [side, None]], format="csr"))
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

    return Factorization(size + count, inertia, 1.0, "saddle", time.process_time() - began, solve)
