"""The programs of jamming as they read on paper, in cvxpy: for people, and to check the fast forms by."""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.mechanics.motions import MotionCone
from packmech.mechanics.programs import ForceBalance, Openings, Yielding, load_gap
from packmech.outcome import Outcome, Solve

_OUTCOMES = {"optimal": Outcome.CONVERGED, "infeasible": Outcome.INFEASIBLE}


def _solved(problem: Any, tolerance: float) -> Solve:
    import cvxpy as cp

    start = time.process_time()
    try:
        with warnings.catch_warnings():
            # the status says that it is inaccurate; no need to print it too
            warnings.simplefilter("ignore")
            problem.solve(
                solver=cp.CLARABEL, tol_gap_abs=tolerance, tol_gap_rel=tolerance, tol_feas=tolerance, max_threads=1
            )
        status, steps = problem.status, problem.solver_stats.num_iters
    except cp.error.SolverError as error:
        status, steps = str(error), 0
    outcome = _OUTCOMES.get(status, Outcome.INACCURATE)
    residual = (
        max((float(np.max(c.violation(), initial=0.0)) for c in problem.constraints), default=0.0)
        if (outcome is Outcome.CONVERGED)
        else np.nan
    )
    seconds = time.process_time() - start
    return Solve(outcome, residual, iterations=int(steps or 0), seconds=seconds, status=f"cvxpy: {status}")


def _motion(cone: MotionCone) -> tuple[Any, list[Any]]:
    """Return the unknown motion y and what it must satisfy: no contact closes, nothing translates, the volume obeys."""
    import cvxpy as cp

    particles, d = len(cone.kept_n), cone.dimension
    displacement = cp.Variable((particles, d))
    y: Any = cp.vec(displacement, order="C")
    if cone.strain_scale:
        y = cp.hstack([y, cp.Variable(cone.unknowns - particles * d)])
    rules = [cp.sum(displacement, axis=0) == 0]
    if cone.held.shape[0]:
        rules.append(cone.held @ y == 0)
    if cone.one_sided.shape[0]:
        rules.append(cone.one_sided @ y >= 0)
    return y, rules


def yield_to_load_readable(cone: MotionCone, load: NDArray[np.float64], bound: str, tolerance: float) -> Yielding:
    """Return what `programs.yield_to_load` returns; equations 40-42 of the polymer source, contacts may not shorten.

    Parameters
    ----------
    cone, load, bound, tolerance
        As there.

    """
    import cvxpy as cp

    y, rules = _motion(cone)
    size = cp.norm(y, 2) if bound == "ball" else cp.norm(y, "inf")
    load = cone.without_translations(load)
    load = load / max(float(np.sqrt(load @ load)), 1e-300)
    contact = cone.opening @ y >= 0
    problem = cp.Problem(cp.Minimize(load @ y), [contact, size <= 1, *rules])
    solve = _solved(problem, tolerance)
    found = np.full(cone.unknowns, np.nan) if y.value is None else np.asarray(y.value)
    if contact.dual_value is None:
        return Yielding(found, solve, np.full(cone.rows.shape[0], np.nan))
    others = [np.ravel(rule.dual_value) for rule in rules[1:]]
    if cone.held.shape[0]:
        others[0] = -others[0]
    weight = np.concatenate([np.asarray(contact.dual_value), *others])
    return Yielding(found, replace(solve, gap=load_gap(cone, load, found, weight, bound)), weight)


def largest_smallest_force_readable(cone: MotionCone, tolerance: float) -> ForceBalance:
    """Return what `programs.largest_smallest_force` returns.

    Parameters
    ----------
    cone, tolerance
        As there.

    """
    import cvxpy as cp

    count, d = cone.opening.shape[0], cone.dimension
    force, smallest = cp.Variable(count), cp.Variable()
    held, one_sided = cp.Variable(cone.held.shape[0]), cp.Variable(cone.one_sided.shape[0])
    total = cone.opening.T @ force
    if cone.held.shape[0]:
        total = total + cone.held.T @ held
    if cone.one_sided.shape[0]:
        total = total + cone.one_sided.T @ one_sided
    # one particle's balance follows from that of all others
    balance = total[d:] == 0
    problem = cp.Problem(cp.Maximize(smallest), [balance, force >= smallest, cp.sum(force) == count, one_sided >= 0])
    solve = _solved(problem, tolerance)
    if solve.outcome is not Outcome.CONVERGED:
        none = np.zeros(count + cone.bound_rows)
        return ForceBalance(-np.inf if solve.outcome is Outcome.INFEASIBLE else np.nan, none, None, solve)
    weight = np.concatenate([part.value for part in (force, held, one_sided) if part.size])
    motion = cone.without_translations(np.concatenate([np.zeros(d), np.asarray(balance.dual_value)]))
    if (cone.opening @ motion).sum() < 0:
        motion = -motion
    return ForceBalance(float(smallest.value), weight, motion, solve)


def open_all_readable(cone: MotionCone, tolerance: float) -> Openings:
    """Return what `programs.open_all` returns.

    Parameters
    ----------
    cone, tolerance
        As there.

    """
    import cvxpy as cp

    y, rules = _motion(cone)
    count = cone.opening.shape[0]
    opened = cp.Variable(count)
    contact = cone.opening @ y >= opened
    problem = cp.Problem(cp.Maximize(cp.sum(opened)), [contact, opened >= 0, opened <= 1, *rules])
    solve = _solved(problem, tolerance)
    if solve.outcome is not Outcome.CONVERGED:
        none = np.zeros(count + cone.bound_rows)
        return Openings(np.zeros(count, dtype=bool), none, np.zeros(cone.unknowns), solve)
    others = [np.ravel(rule.dual_value) for rule in rules[1:]]
    if cone.held.shape[0]:
        others[0] = -others[0]
    force = np.asarray(contact.dual_value)
    weight = np.concatenate([force, *others])
    return Openings(force > 0.5, weight, np.asarray(y.value), solve)
