"""The three linear programs of jamming, lifted: motions stay in particle coordinates, so every matrix stays sparse.

    forces    max t       with  R^T s + H^T m = 0,  s >= t,  mean s = 1     the largest smallest force in balance
    openings  max sum o   with  R y >= o,  0 <= o <= 1,  H y = 0            the motion that opens whatever can open
    loads     min b . y   with  R y >= 0,  H y = 0,  |y| <= 1               the source's program, equations 40-42

R are the contacts' rows, H the rows that hold the volume; a volume free to shrink gives a row of the form H y >= 0 and
a multiplier m >= 0. One particle is held in the first two, the mean displacement in the third: otherwise a translation
of everything would answer. The source prints R y <= 0, which admits approach; contacts may not shorten: R y >= 0.

With the bound |y| <= 1 of the norm the load program's answer is the direction of -b's projection on the cone of motions
(Moreau 1962): the y nearest to -b. Clarabel is given that, a third of the work for a thousandth of the error; cvxpy
gets the program as printed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.mechanics.linear_programs import SOLVE, Program, Solution
from packmech.mechanics.motions import MotionCone
from packmech.outcome import Outcome, Solve

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
        from packmech.mechanics.readable_programs import largest_smallest_force_readable

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
    program = Program(
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
        from packmech.mechanics.readable_programs import open_all_readable

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
    program = Program(
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
    """Return the motion of bounded size that goes farthest against a load, by the source's program; zero if jammed.

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
        from packmech.mechanics.readable_programs import yield_to_load_readable

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


def load_program(cone: MotionCone, load: NDArray[np.float64], bound: str) -> Program:
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
    return Program(
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
