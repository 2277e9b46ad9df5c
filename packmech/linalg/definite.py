"""The most definite combination of symmetric matrices, by a semidefinite program that Clarabel solves.

    maximize t   with   sum over s of share_s form_s - t in the positive semidefinite cone,  |share| <= 1,
                        push @ share >= 0

Its dual is a positive semidefinite matrix X of trace 1: whatever the share, the smallest eigenvalue of the combination
is at most the mean <X, combination>, and this at most the length of <X, form_s> + (push^T y)_s for any y >= 0.
Both sides are evaluated after the solver, whose word is not taken: shares that pull are moved until all push.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.linalg.linear_programs import inner_direction
from packmech.result import Outcome, Solve


@dataclass(frozen=True, eq=False)
class MostDefinite:
    """The combination whose smallest eigenvalue is largest, and a bound on that of all others.

    Attributes
    ----------
    share_k
        (K,) share of each matrix, of length 1 at most; zeros where the solver found none that pushes at every row.
    lowest
        Smallest eigenvalue of the combination, or 0 of none.
    bound
        No admitted combination has a larger smallest eigenvalue than this.
    weight_mm
        (M, M) positive semidefinite matrix of trace 1 that says so.
    solve
        What the solver achieved.

    """

    share_k: NDArray[np.float64]
    lowest: float
    bound: float
    weight_mm: NDArray[np.float64]
    solve: Solve


def pushing_share(
    share_k: NDArray[np.float64], push_ck: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64] | None:
    """Return the share, moved until no `push_ck @ share_k` is negative, of length 1 at most; None if none was found.

    Examples
    --------
    >>> pushing_share(np.array([1.0, -1e-12]), np.eye(2), 1e-10).min() >= 0.0
    np.True_

    """
    push = push_ck @ share_k
    if push.min(initial=0.0) < 0.0:
        inner = inner_direction(sp.csr_array(push_ck), sp.csr_array((0, push_ck.shape[1])), tolerance)
        speed = push_ck @ inner
        if speed.min() <= 0.0:
            return None
        # a little farther, so that rounding leaves no pull
        share_k = share_k + 1.001 * float((-push / speed).max()) * inner
    share_k = share_k / max(1.0, float(np.linalg.norm(share_k)))
    return share_k if (push_ck @ share_k).min(initial=0.0) >= 0.0 else None


def most_definite(form_kmm: NDArray[np.float64], push_ck: NDArray[np.float64], tolerance: float) -> MostDefinite:
    """Return the combination of symmetric matrices whose smallest eigenvalue is largest.

    Parameters
    ----------
    form_kmm
        (K, M, M) symmetric matrices.
    push_ck
        (C, K) rows that must not be negative along the shares; perhaps none.
    tolerance
        Of the solver, for the duality gap and the residuals.

    Examples
    --------
    >>> forms = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
    >>> found = most_definite(forms, np.zeros((0, 2)), 1e-10)
    >>> found.share_k.round(6).tolist(), round(found.lowest, 6), round(found.bound, 6)
    ([0.707107, 0.707107], 0.707107, 0.707107)

    """
    import clarabel

    start = time.process_time()
    count, size = form_kmm.shape[:2]
    scale = float(np.abs(form_kmm).max(initial=0.0)) or 1.0
    # the upper triangle, column after column, products of two such vectors being those of the matrices
    column, row = np.tril_indices(size)
    weight = np.where(row == column, 1.0, np.sqrt(2.0))
    stacked = form_kmm[:, row, column] / scale * weight
    unit = np.eye(size)[row, column]
    blocks = [
        np.column_stack([-stacked.T, unit]),
        np.column_stack([np.vstack([np.zeros(count), -np.eye(count)]), np.zeros(count + 1)]),
        np.column_stack([-push_ck, np.zeros(len(push_ck))]),
    ]
    limit = np.concatenate([np.zeros(len(unit)), [1.0], np.zeros(count + len(push_ck))])
    cones = [clarabel.PSDTriangleConeT(size), clarabel.SecondOrderConeT(count + 1)]
    if len(push_ck):
        cones.append(clarabel.NonnegativeConeT(len(push_ck)))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    cost = np.concatenate([np.zeros(count), [-1.0]])
    matrix = sp.csc_matrix(np.vstack(blocks))
    found = clarabel.DefaultSolver(sp.csc_matrix((count + 1, count + 1)), cost, matrix, limit, cones, settings).solve()
    share, dual = np.nan_to_num(np.array(found.x)[:count]), np.nan_to_num(np.array(found.z))
    pushing = pushing_share(share, push_ck, tolerance)
    share = np.zeros(count) if pushing is None else pushing
    lowest = float(np.linalg.eigvalsh(np.tensordot(share, form_kmm, axes=1))[0])
    # what the solver says is made what it claims to be: positive semidefinite, of trace 1
    given = np.zeros((size, size))
    given[row, column] = given[column, row] = dual[: len(unit)] / weight
    value, vector = np.linalg.eigh(given)
    value = np.maximum(value, 0.0)
    value = value / value.sum() if value.sum() > 0.0 else np.full(size, 1.0 / size)
    mean = (vector * value) @ vector.T
    slope = np.tensordot(form_kmm, mean, axes=2)
    if len(push_ck):
        slope = slope + push_ck.T @ (scale * np.maximum(dual[len(dual) - len(push_ck) :], 0.0))
    outcome = Outcome.CONVERGED if str(found.status) == "Solved" else Outcome.INACCURATE
    solve = Solve(
        outcome,
        residual=float(max(found.r_prim, found.r_dual)),
        gap=float(abs(found.obj_val - found.obj_val_dual)),
        iterations=int(found.iterations),
        seconds=time.process_time() - start,
        status=f"Clarabel: {found.status}",
    )
    return MostDefinite(share, lowest, float(np.linalg.norm(slope)), mean, solve)
