"""Whether a cone of motions is trivial, by the source's programs: a random load, then its opposite, move nothing.

Forces w >= 0 on the contacts that bear a load b leave no motion that goes against it: b . y = w . (rows y) >= 0. If
they bear it but for a rest r, no motion of length 1 goes farther than |r|, and the projection of -b on the motions is
no longer than that (Moreau 1962). So a solver may stop early where its multipliers, balanced to rounding, prove that
the load moves nothing; and what they differ by from the least forces that bear it is a state of self stress, which, if
all its forces push, bears the opposite load with the least forces taken off.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from packmech.jamming.certificates import VACUOUS, Finding, attempts, certify, closes_hardly, kept_open, soft_finding
from packmech.jamming.motion_cone import ROUNDS, MotionCone
from packmech.jamming.programs import NEAREST, load_gap, open_all, yield_to_load
from packmech.result import Outcome, Solve

# a motion of the load programs longer than this fraction of its bound is one
MOVED = 1e-3
# tolerance at which multipliers of jammed packings can be balanced (measured: 1e-1 does, but finds no motions yet)
EARLY = 1e-4
# rest over load [1] that balancing is tried on, times sqrt(n): loads move what moves by about 1 / sqrt(n)
_NEARLY_BORNE = 1e-2


def _settled(cone: MotionCone, solve: Solve) -> bool:
    """Return whether the load program's multipliers prove that no motion goes much farther.

    A load of unit length moves what moves by about 1 / sqrt(n).
    """
    return bool(np.sqrt(cone.unknowns) * abs(solve.gap) <= MOVED)


def borne(
    cone: MotionCone, load: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float] | None:
    """Return weights near the given ones that bear a load, and the longest motion that they leave it; None if none do.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    load
        (n,) load of unit length, without translation.
    weight
        (C + h + b,) weights of the rows that nearly bear it.

    """
    rest, far = np.zeros(cone.unknowns), np.sqrt(cone.unknowns)
    if not np.isfinite(weight).all() or far * load_gap(cone, load, rest, weight, "ball") > _NEARLY_BORNE:
        return None
    weight = cone.bearing(weight, load)
    # weights that pull where they must not count as none
    longest = load_gap(cone, load, rest, weight, "ball")
    return (weight, longest) if far * longest <= NEAREST else None


def turned_round(
    cone: MotionCone, load: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float] | None:
    """Return what `borne` does for the opposite load, made of weights that bear this one; None if they do not tell.

    Parameters
    ----------
    cone, load
        As there.
    weight
        (C + h + b,) weights of the rows that bear the load.

    """
    pressing = np.ones(len(weight), dtype=bool)
    pressing[cone.opening.shape[0] : cone.opening.shape[0] + cone.held.shape[0]] = False
    least = cone.bearing(np.zeros(len(weight)), load)
    stress = weight - least
    if not (stress[pressing] > 0.0).all():
        return None
    times = 2.0 * max(float((least[pressing] / stress[pressing]).max(initial=0.0)), 0.0)
    return borne(cone, -load, times * stress - least)


def yield_to_loads(
    cone: MotionCone,
    rng: np.random.Generator,
    *,
    bound: str = "ball",
    solver: str = "clarabel",
    tolerance: float = 1e-8,
    fallback: bool = True,
) -> Finding:
    """Return whether the cone is trivial, by the source's programs: a random load b, then -b, move nothing.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    rng
        Draws the load.
    bound, solver, tolerance
        As in `programs.yield_to_load`.
    fallback
        Whether to balance the multipliers of Clarabel's ball, which may end the search early, and to ask again where
        the solver's answer did not pass the check: at a tolerance of 1e-12, then simplex. Otherwise each of the two
        programs is solved once, at the tolerance.

    """
    if cone.unknowns == cone.dimension:
        return Finding(True, VACUOUS)
    load = cone.without_translations(rng.standard_normal(cone.unknowns))
    load /= np.sqrt(load @ load)
    asking = attempts(cone, solver, tolerance) if fallback else [(solver, tolerance)]
    balancing = fallback and solver == "clarabel" and bound == "ball"
    if balancing and tolerance < EARLY:
        asking.insert(0, (solver, EARLY))
    solves: list[Solve] = []
    longest = 0.0
    bearing = None
    for sign in (1.0, -1.0):
        if bearing is not None:
            started = time.process_time()
            found = turned_round(cone, load, bearing[0])
            if found is not None:
                longest = max(longest, found[1])
                solves.append(_turned(found[1], time.process_time() - started))
                continue
        for name, asked in asking:
            shape = "box" if name == "highs" else bound
            motion, solve, weight = yield_to_load(cone, sign * load, bound=shape, solver=name, tolerance=asked)
            bearing = borne(cone, sign * load, weight) if balancing else None
            if bearing is not None:
                size = bearing[1]
                solves.append(replace(solve, gap=size))
                break
            solves.append(solve)
            size = float(np.sqrt(motion @ motion) if shape == "ball" else np.abs(motion).max())
            # where nothing moves the multipliers are proof enough
            proof = kept_open(cone, motion, opening=False) if size > MOVED else motion
            if proof is not None and _settled(cone, solve):
                break
        else:
            longest = max(longest, size)
            if fallback and (soft := soft_finding(cone, solver, tolerance, tuple(solves))) is not None:
                return replace(soft, longest=longest)
            if fallback and size > MOVED:
                # soft motions come along with the load's; one that opens whatever can open needs none of them
                opened = open_all(cone, solver=name, tolerance=tolerance)
                solves.append(opened.solve)
                proof = kept_open(cone, opened.motion)
                if proof is not None:
                    reason = "a motion opens contacts and closes none, near one that a load makes"
                    return Finding(False, reason, motion=proof, solves=tuple(solves), longest=longest)
            reason = f"no answer of the load program passed the check ({solve.status}, duality gap {solve.gap:.1e})"
            return Finding(None, reason, solves=tuple(solves), longest=longest)
        longest = max(longest, size)
        if size > MOVED:
            if fallback and proof is not None and closes_hardly(cone, proof):
                # contact forces show less than motions do
                checked = certify(cone, solver=solver, tolerance=tolerance)
                if checked.jammed is not False:
                    reason = f"a load moves the contacts apart but for rounding; {checked.reason}"
                    return Finding(None, reason, solves=(*solves, *checked.solves), longest=longest)
            reason = f"a load moves the contacts apart (motion {size:.1e} of its bound)"
            return Finding(False, reason, motion=proof, solves=tuple(solves), longest=longest)
    # a motion that the loads' rounding hides
    if fallback and (soft := soft_finding(cone, solver, tolerance, tuple(solves))) is not None:
        return replace(soft, longest=longest)
    reason = f"neither a random load nor its opposite moves anything (motion {longest:.1e} of its bound)"
    return Finding(True, reason, solves=tuple(solves), longest=longest)


def _turned(longest: float, seconds: float) -> Solve:
    status = "the first load's multipliers, turned round: Solved"
    return Solve(Outcome.CONVERGED, residual=longest, gap=longest, iterations=ROUNDS, seconds=seconds, status=status)
