"""The linear programs of jamming: sparse for solvers, and in cvxpy as they read on paper."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.jamming.motion_cone import MotionCone
from packmech.linalg.linear_programs import SOLVE, LinearProgram, Solution
from packmech.result import Outcome, Solve

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
    """Return what `programs.yield_to_load` returns; equations 40-42 of Dennis (2021), contacts may not shorten.

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


SOLVERS = ("clarabel", "cvxpy", "highs")
# A random load of unit length projects on a line of motions in n dimensions to about 1 / sqrt(n); to this much less it
# does once in 10^5 times, and what solvers leave in jammed packings stays below 1e-9 of it.
NEAREST = 1e-5


@dataclass(frozen=True, eq=False)
class ForceBalance:
    """The answer of the force program.

    Attributes
    ----------
    smallest
        Largest possible smallest force over the mean force [1]; minus infinity when no self stress exists.
    weight
        (C + h + b,) forces of mean 1, then the multipliers of held and one-sided rows; zeros when there is none.
    motion
        (n,) the program's dual: a motion that closes no contact, if `smallest` is not positive. None if the solver
        gave none.
    solve
        What the solver achieved.

    """

    smallest: float
    weight: NDArray[np.float64]
    motion: NDArray[np.float64] | None
    solve: Solve


def largest_smallest_force(cone: MotionCone, *, solver: str = "clarabel", tolerance: float = 1e-8) -> ForceBalance:
    """Return a state of self stress whose smallest force is as large as possible, by the force program.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    solver
        "clarabel", "highs", or "cvxpy" for the program as it reads.
    tolerance
        Of the solver.

    """
    if solver == "cvxpy":
        return largest_smallest_force_readable(cone, tolerance)
    d, count = cone.dimension, cone.opening.shape[0]
    extra = cone.bound_rows
    balance = sp.csr_array(cone.rows.T)[d:]
    # s = w + t with w >= 0
    together = np.asarray(cone.opening.T @ np.ones(count))[d:]
    mean = np.concatenate([np.full(count, 1.0 / count), np.zeros(extra), [1.0]])
    equal = sp.vstack(
        [sp.hstack([balance, sp.csr_array(together[:, None])]), sp.csr_array(mean[None, :])], format="csr"
    )
    lower = np.concatenate(
        [np.zeros(count), np.full(cone.held.shape[0], -np.inf), np.zeros(cone.one_sided.shape[0]), [-np.inf]]
    )
    cost = np.zeros(count + extra + 1)
    cost[-1] = -1.0
    size = len(cost)
    program = LinearProgram(
        cost,
        equal,
        np.concatenate([np.zeros(balance.shape[0]), [1.0]]),
        sp.csr_array((0, size)),
        np.zeros(0),
        lower,
        np.full(size, np.inf),
        dimension=d,
    )
    found = SOLVE[solver](program, tolerance)
    outcome = found.solve.outcome
    motion = _unpinned(cone, found.equal_multiplier[:-1]) if np.isfinite(found.equal_multiplier).all() else None
    if outcome is not Outcome.CONVERGED:
        smallest = -np.inf if outcome is Outcome.INFEASIBLE else np.nan
        return ForceBalance(smallest, np.zeros(count + extra), motion, found.solve)
    weight = found.x[:-1].copy()
    weight[:count] += found.x[-1]
    return ForceBalance(float(found.x[-1]), weight, motion, found.solve)


def _unpinned(cone: MotionCone, motion: NDArray[np.float64]) -> NDArray[np.float64]:
    return cone.without_translations(np.concatenate([np.zeros(cone.dimension), motion]))


@dataclass(frozen=True, eq=False)
class Openings:
    """The answer of the opening program.

    Attributes
    ----------
    carrying_c
        (C,) whether a contact carries a force in some self stress without tension; the others open in `motion`.
    weight
        (C + h + b,) such a self stress with force at least 1 on every carrying contact and 0 on the others.
    motion
        (n,) opens every contact that does not carry, and closes none.
    solve
        What the solver achieved.

    """

    carrying_c: NDArray[np.bool_]
    weight: NDArray[np.float64]
    motion: NDArray[np.float64]
    solve: Solve


def open_all(cone: MotionCone, *, solver: str = "clarabel", tolerance: float = 1e-8) -> Openings:
    """Return which contacts can carry force and a motion that opens all others, by the opening program.

    By complementarity each contact does one or the other. The force on a contact is its row's multiplier.

    Parameters
    ----------
    cone, solver, tolerance
        As in `largest_smallest_force`.

    """
    if solver == "cvxpy":
        return open_all_readable(cone, tolerance)
    d, count = cone.dimension, cone.opening.shape[0]
    free = cone.unknowns - d
    nothing = sp.csr_array((cone.one_sided.shape[0], count))
    below = sp.vstack(
        [
            sp.hstack([-cone.opening[:, d:], sp.eye_array(count)]),
            sp.hstack([-cone.one_sided[:, d:], nothing]),
        ],
        format="csr",
    )
    equal = sp.csr_array(sp.hstack([cone.held[:, d:], sp.csr_array((cone.held.shape[0], count))], format="csr"))
    program = LinearProgram(
        np.concatenate([np.zeros(free), -np.ones(count)]),
        equal,
        np.zeros(cone.held.shape[0]),
        below,
        np.zeros(below.shape[0]),
        np.concatenate([np.full(free, -np.inf), np.zeros(count)]),
        np.concatenate([np.full(free, np.inf), np.ones(count)]),
        dimension=d,
    )
    found = SOLVE[solver](program, tolerance)
    return _openings(cone, found, free)


def _openings(cone: MotionCone, found: Solution, free: int) -> Openings:
    count = cone.opening.shape[0]
    if found.solve.outcome is not Outcome.CONVERGED:
        empty = np.zeros(count + cone.bound_rows)
        return Openings(np.zeros(count, dtype=bool), empty, np.zeros(cone.unknowns), found.solve)
    force, one_sided = found.below_multiplier[:count], found.below_multiplier[count:]
    weight = np.concatenate([force, -found.equal_multiplier, one_sided])
    return Openings(force > 0.5, weight, _unpinned(cone, found.x[:free]), found.solve)


class Yielding(NamedTuple):
    """The answer of a load program.

    Attributes
    ----------
    motion
        (n,) the motion that goes farthest against the load; zero if nothing moves.
    solve
        What the solver achieved; its gap is that of `weight`.
    weight
        (C + h + b,) the program's multipliers; NaN where the solver gave none.

    """

    motion: NDArray[np.float64]
    solve: Solve
    weight: NDArray[np.float64]


def yield_to_load(
    cone: MotionCone,
    load: NDArray[np.float64],
    *,
    bound: str = "ball",
    solver: str = "clarabel",
    tolerance: float = 1e-8,
) -> Yielding:
    """Return the motion of bounded size that goes farthest against a load, after Dennis (2021); zero if jammed.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    load
        (n,) load b; neither its length nor its part along translations matters.
    bound
        "ball": |y| <= 1 as printed; "box": every component within 1, which makes it a linear program.
    solver, tolerance
        As in `largest_smallest_force`; "highs" takes the box only.

    """
    if solver == "cvxpy":
        return yield_to_load_readable(cone, load, bound, tolerance)
    n = cone.unknowns
    load = cone.without_translations(load)
    load = load / max(float(np.sqrt(load @ load)), 1e-300)
    # measured: fewest iterations with a load as long as this, where the solver scales its rows; the answer goes with it
    scale = 1.0 if bound == "box" else 5.0 * n
    found = SOLVE[solver](load_program(cone, scale * load, bound), tolerance)
    motion = cone.without_translations(found.x / scale)
    length = float(np.sqrt(motion @ motion))
    if not len(found.below_multiplier):
        return Yielding(motion, found.solve, np.full(cone.rows.shape[0], np.nan))
    if bound == "ball" and np.sqrt(n) * length > NEAREST:
        motion /= length
    weight = np.concatenate(
        [
            found.below_multiplier[: cone.opening.shape[0]],
            -found.equal_multiplier[: cone.held.shape[0]],
            found.below_multiplier[cone.opening.shape[0] :],
        ]
    )
    weight /= scale
    return Yielding(motion, replace(found.solve, gap=load_gap(cone, load, motion, weight, bound)), weight)


def load_program(cone: MotionCone, load: NDArray[np.float64], bound: str) -> LinearProgram:
    """Return the load program in a box, or for a ball the projection of minus the load on the cone of motions.

    Parameters
    ----------
    cone, bound
        As in `yield_to_load`.
    load
        (n,) load without translation.

    """
    d, n, particles = cone.dimension, cone.unknowns, len(cone.kept_n)
    equal, limit = cone.held, np.inf
    if bound == "box":
        mean = sp.hstack([sp.kron(np.ones((1, particles)), sp.eye_array(d)), sp.csr_array((d, n - particles * d))])
        equal, limit = sp.csr_array(sp.vstack([cone.held, mean], format="csr")), 1.0
    below = -sp.csr_array(sp.vstack([cone.opening, cone.one_sided], format="csr"))
    return LinearProgram(
        load,
        equal,
        np.zeros(equal.shape[0]),
        below,
        np.zeros(below.shape[0]),
        np.full(n, -limit),
        np.full(n, limit),
        quadratic=0.0 if bound == "box" else 1.0,
        dimension=d,
    )


def load_gap(
    cone: MotionCone, load: NDArray[np.float64], motion: NDArray[np.float64], weight: NDArray[np.float64], bound: str
) -> float:
    """Return by how much b . y may at most be lowered from where it is, by the multipliers of the load program.

    For every motion z that the cone admits b . z >= (b - rows^T weight) . z, as weights of contacts are not negative.

    Parameters
    ----------
    cone, load, motion, bound
        As in `yield_to_load`; the load has unit length.
    weight
        (C + h + b,) multipliers of contacts, held and one-sided rows; negative ones count as 0 where they must not be.

    """
    d, moving = cone.dimension, len(cone.kept_n) * cone.dimension
    free = slice(cone.opening.shape[0], cone.opening.shape[0] + cone.held.shape[0])
    pressing = np.maximum(weight, 0.0)
    pressing[free] = weight[free]
    rest = load - cone.rows.T @ pressing
    # loads along translations move nothing: those that leave least
    force_nd = rest[:moving].reshape(-1, d)
    force_nd -= force_nd.mean(axis=0) if bound == "ball" else np.median(force_nd, axis=0)
    largest = np.sqrt(rest @ rest) if bound == "ball" else np.abs(rest).sum()
    return abs(float(load @ motion + largest))
