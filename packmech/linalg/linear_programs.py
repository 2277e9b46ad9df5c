"""Convex programs in one plain form, and the solvers that take them: Clarabel (interior point) and HiGHS (simplex).

    minimize cost . x + quadratic |x|^2 / 2   with   equal @ x = equal_to,  below @ x <= below_to,  lower <= x <= upper

Multipliers follow one convention for both solvers: cost + quadratic x + equal^T y + below^T z + (multipliers of the
bounds) = 0 with z >= 0. When no x is feasible Clarabel's multipliers are a proof of it: equal^T y + below^T z + ... = 0
with a negative value of equal_to . y + below_to . z + ....
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.result import Outcome, Solve

# measured: KKT systems of spheres in three dimensions fill in so much that the supernodal factorization wins early; for
# discs it takes 1.4 times longer with 8,000 unknowns and is as fast with 33,000
_SUPERNODAL_ROWS = {2: 33000, 3: 4000}


@dataclass(frozen=True, eq=False)
class LinearProgram:
    """A linear program, or with a positive `quadratic` a projection: the x nearest to -cost / quadratic.

    `dimension` is that of the packing that it is about, by which solvers choose how to factor.
    """

    cost: NDArray[np.float64]
    equal: sp.csr_array
    equal_to: NDArray[np.float64]
    below: sp.csr_array
    below_to: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    quadratic: float = 0.0
    dimension: int = 3


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver returned: the unknowns, the multipliers of both kinds of rows, and what it achieved."""

    x: NDArray[np.float64]
    equal_multiplier: NDArray[np.float64]
    below_multiplier: NDArray[np.float64]
    value: float
    solve: Solve


def solve_clarabel(program: LinearProgram, tolerance: float, *, refine: bool = False) -> Solution:
    """Return the solution by Clarabel's interior-point method, on one thread.

    Parameters
    ----------
    program
        The program.
    tolerance
        For the duality gap and the residuals, relative and absolute.
    refine
        Whether every system is solved with refinement, of a program with a quadratic term too.

    """
    import clarabel

    start = time.process_time()
    size, rows = len(program.cost), program.equal.shape[0]
    unit = sp.eye_array(size, format="csr")
    above, under = np.isfinite(program.lower), np.isfinite(program.upper)
    blocks = [program.equal, program.below, -unit[above], unit[under]]
    limits = [program.equal_to, program.below_to, -program.lower[above], program.upper[under]]
    one_sided = sum(len(limit) for limit in limits[1:])
    cones: list[Any] = [clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(one_sided)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    if size > _SUPERNODAL_ROWS[program.dimension]:
        settings.direct_solve_method = "faer"
    matrix = sp.csc_matrix(sp.vstack(blocks))
    curvature = sp.csc_matrix(program.quadratic * unit) if program.quadratic else sp.csc_matrix((size, size))
    limit = np.concatenate(limits)
    # a quadratic term keeps the systems regular: without refinement a third less time and the same answer
    settings.iterative_refinement_enable = refine or not program.quadratic
    found = clarabel.DefaultSolver(curvature, program.cost, matrix, limit, cones, settings).solve()
    if not settings.iterative_refinement_enable and str(found.status) != "Solved":
        settings.iterative_refinement_enable = True
        found = clarabel.DefaultSolver(curvature, program.cost, matrix, limit, cones, settings).solve()
    status = str(found.status)
    outcome = {"Solved": Outcome.CONVERGED, "PrimalInfeasible": Outcome.INFEASIBLE}.get(status, Outcome.INACCURATE)
    multiplier = np.array(found.z)
    scale = max(1.0, abs(found.obj_val))
    return Solution(
        x=np.array(found.x),
        equal_multiplier=multiplier[:rows],
        below_multiplier=multiplier[rows : rows + program.below.shape[0]],
        value=float(found.obj_val),
        solve=Solve(
            outcome,
            residual=float(max(found.r_prim, found.r_dual)),
            gap=float(abs(found.obj_val - found.obj_val_dual)) / scale,
            iterations=int(found.iterations),
            seconds=time.process_time() - start,
            status=f"Clarabel: {status}",
        ),
    )


def solve_highs(program: LinearProgram, tolerance: float) -> Solution:
    """Return the solution by HiGHS' dual simplex method: a vertex, exact to rounding, but slow for many unknowns.

    Parameters
    ----------
    program
        The program, without a quadratic term.
    tolerance
        Feasibility tolerance; HiGHS takes at least 1e-10.

    """
    from scipy.optimize import linprog

    if program.quadratic:
        raise ValueError("bound must be 'box' for the simplex method, got 'ball'")
    start = time.process_time()
    limit = max(tolerance, 1e-10)
    found = linprog(
        program.cost,
        A_eq=program.equal,
        b_eq=program.equal_to,
        A_ub=program.below,
        b_ub=program.below_to,
        bounds=np.stack([program.lower, program.upper], axis=1),
        method="highs-ds",
        options={"primal_feasibility_tolerance": limit, "dual_feasibility_tolerance": limit},
    )
    seconds = time.process_time() - start
    outcome = {0: Outcome.CONVERGED, 2: Outcome.INFEASIBLE}.get(found.status, Outcome.INACCURATE)
    if found.status != 0:
        nothing = np.full(len(program.cost), np.nan)
        solve = Solve(outcome, residual=np.nan, seconds=seconds, status=f"HiGHS: {found.message}")
        return Solution(nothing, np.full(program.equal.shape[0], np.nan), np.zeros(0), np.nan, solve)
    residual = max(
        np.abs(found.con).max(initial=0.0),
        -found.slack.min(initial=0.0),
        -(found.x - program.lower).min(initial=0.0),
        -(program.upper - found.x).min(initial=0.0),
    )
    return Solution(
        x=np.asarray(found.x),
        equal_multiplier=-np.asarray(found.eqlin.marginals),
        below_multiplier=-np.asarray(found.ineqlin.marginals),
        value=float(found.fun),
        solve=Solve(
            outcome,
            residual=float(residual),
            gap=0.0,
            iterations=int(found.nit),
            seconds=seconds,
            status="HiGHS: optimal",
        ),
    )


SOLVE = {"clarabel": solve_clarabel, "highs": solve_highs}


def inner_direction(rows: sp.csr_array, equal: sp.csr_array, tolerance: float) -> NDArray[np.float64]:
    """Return the x with `equal @ x` = 0 and entries of size 1 at most whose smallest product with a row is largest.

    Rows count by their directions. Where no x makes all products positive it is zero to the solver's tolerance.
    """
    count, size = rows.shape
    length = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).ravel())
    unit = sp.diags_array(1.0 / np.where(length > 0.0, length, 1.0)) @ rows
    program = LinearProgram(
        cost=np.append(np.zeros(size), -1.0),
        equal=sp.csr_array(sp.hstack([equal, sp.csr_array((equal.shape[0], 1))])),
        equal_to=np.zeros(equal.shape[0]),
        below=sp.csr_array(sp.hstack([-unit, sp.csr_array(np.ones((count, 1)))])),
        below_to=np.zeros(count),
        lower=np.append(np.full(size, -1.0), -np.inf),
        upper=np.append(np.ones(size), np.inf),
    )
    return np.nan_to_num(solve_clarabel(program, tolerance).x[:size])
