"""Whether a cone of motions is trivial, by the source's programs: a random load, then its opposite, move nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from packmech.mechanics.certificates import VACUOUS, Finding, attempts, kept_open, soft_finding
from packmech.mechanics.motions import MotionCone
from packmech.mechanics.programs import open_all, yield_to_load
from packmech.outcome import Solve

# a motion of the load programs longer than this fraction of its bound is one
MOVED = 1e-3


def _settled(cone: MotionCone, solve: Solve) -> bool:
    """Return whether the load program's multipliers prove that no motion goes much farther.

    A load of unit length moves what moves by about 1 / sqrt(n).
    """
    return bool(np.sqrt(cone.unknowns) * abs(solve.gap) <= MOVED)


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
        Whether to ask again where the solver's answer did not pass the check: at a tolerance of 1e-12, then simplex.

    """
    if cone.unknowns == cone.dimension:
        return Finding(True, VACUOUS)
    load = cone.without_translations(rng.standard_normal(cone.unknowns))
    load /= np.sqrt(load @ load)
    asking = attempts(cone, solver, tolerance) if fallback else [(solver, tolerance)]
    solves: list[Solve] = []
    longest = 0.0
    for sign in (1.0, -1.0):
        for name, asked in asking:
            shape = "box" if name == "highs" else bound
            motion, solve = yield_to_load(cone, sign * load, bound=shape, solver=name, tolerance=asked)
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
            reason = f"a load moves the contacts apart (motion {size:.1e} of its bound)"
            return Finding(False, reason, motion=proof, solves=tuple(solves), longest=longest)
    # a motion that the loads' rounding hides
    if fallback and (soft := soft_finding(cone, solver, tolerance, tuple(solves))) is not None:
        return replace(soft, longest=longest)
    reason = f"neither a random load nor its opposite moves anything (motion {longest:.1e} of its bound)"
    return Finding(True, reason, solves=tuple(solves), longest=longest)
