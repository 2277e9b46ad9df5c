"""Whether a cone of motions is trivial, decided so that either answer can be checked: by certificate or by loads.

Jammed comes with full rank and contact forces that balance to rounding, all positive. Not jammed comes with a motion
that closes no contact. An answer that passes neither check is none, whatever the solver said about itself.

Both checks go down to rounding. Forces w that leave a net force r lie within |r| / s of a state of self stress, where s
is the smallest singular value of the rows, and an error e of the rows moves that state by e |w| / s. A motion that
lengthens the contacts by o on average and shortens none by more than q leaves room for forces below q / o of their
mean; q is what rounding makes of contacts that the motion is made to keep.

The programs of Dennis (2021) ask whether a random load, then its opposite, move anything. Forces w >= 0 on the contacts
that bear a load b leave no motion that goes against it: b . y = w . (rows y) >= 0. If they bear it but for a rest r, no
motion of length 1 goes farther than |r|, and the projection of -b on the motions is no longer than that (Moreau 1962).
So a solver may stop early where its multipliers, balanced to rounding, prove that the load moves nothing; and what they
differ by from the least forces that bear it is a state of self stress, which, if all its forces push, bears the
opposite load with the least forces taken off.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from packmech.jamming.motion_cone import FLOPPY, ROUNDS, MotionCone
from packmech.jamming.programs import NEAREST, largest_smallest_force, load_gap, open_all, yield_to_load
from packmech.result import Outcome, Solve

# safety of the bound on what net forces do to the forces, and rounding of the rows in a box of N^(1/d) diameters
NET_FORCES, _ROWS = 10.0, 10.0 * float(np.finfo(np.float64).eps)
# how many times the largest shortening counts as none, when a motion is made to keep what it hardly changes
_HARDLY = (10.0, 1e3, 1e5)
# and how large such a change may be, of the motion
_LITTLE = 1e-2
# part of the bound on rounding that motions mostly stay within (measured: 10 eps at N = 1024, 0.3 % of the bound)
_TYPICAL_ROUNDING = 0.04
# singular values above so many times what could make them 0 are surely none
_SURE = 100.0
# part of a motion's change of all contacts by which it must close those without gaps, in either direction
_BOTH_WAYS = 0.1
# Next to a floppy motion and a soft one of value s, solvers take for the softest a mixture of the value 1e-16 / s, by
# rounding of R^T R and Lanczos' tolerance, or s if that is less: at most 1e-8 of the largest. A hundred times that.
_UNMIXED = 1e-6
# tolerance at which programs are asked again whose answer did not pass its check
CLOSE = 1e-12
# up to here a simplex solution decides when the interior-point method did not
SIMPLEX_PARTICLES = 1000
ROUNDING = 1e-11
# largest net force that the certificate's contact forces may leave, of their mean
BALANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Finding:
    """What is known about one cone of motions.

    Attributes
    ----------
    jammed
        Whether it holds translations only; None when no solver could tell.
    reason
        One sentence.
    softest
        Smallest over largest singular value of the rows [1]; infinity without rows to have one, NaN where not asked.
    smallest_force
        Smallest over mean contact force of the certificate [1]; minus infinity when no self stress exists, NaN where
        not asked.
    weight
        (C + h + b,) the certificate: contact forces of mean 1, then multipliers; None unless jammed.
    motion
        (n,) a motion that closes no contact; None unless not jammed.
    balance
        Largest component of the net force of `weight` [mean contact force]; 0 without one.
    solves
        What each solver achieved.
    longest
        Longest motion of the load programs, of its bound; NaN where not asked.
    within_error
        Whether motions are taken for floppy that change contacts by no more than these are known.
    implied
        Whether it follows from the answer to the strict question and nothing was computed.

    """

    jammed: bool | None
    reason: str
    softest: float = np.nan
    smallest_force: float = np.nan
    weight: NDArray[np.float64] | None = None
    motion: NDArray[np.float64] | None = None
    balance: float = 0.0
    solves: tuple[Solve, ...] = ()
    implied: bool = False
    longest: float = np.nan
    within_error: bool = False


VACUOUS = "no motion but translations exists for one particle in a fixed box: jammed without any condition"


def certify(cone: MotionCone, *, solver: str = "clarabel", tolerance: float = 1e-8) -> Finding:
    """Return whether the cone is trivial, by rank and the force program.

    At full rank the number of states of self stress is known. Where there is only one it is all that the program can
    choose from, and projection finds it to rounding: then the default solver has nothing to do unless a force pulls.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    solver, tolerance
        As in `programs.largest_smallest_force`.

    """
    count = cone.opening.shape[0]
    if cone.unknowns == cone.dimension:
        return Finding(True, VACUOUS, np.inf, 1.0, np.ones(count + cone.bound_rows))
    start = time.process_time()
    softest, motion = cone.softest()
    status = "shift-invert Lanczos on rows^T rows"
    rank = Solve(Outcome.CONVERGED, residual=softest, seconds=time.process_time() - start, status=status)
    if (soft := soft_finding(cone, solver, tolerance, (rank,))) is not None:
        return soft
    if solver == "clarabel" and cone.rows.shape[0] - (cone.unknowns - cone.dimension) == 1:
        finding = _only_state(cone, softest, rank)
        if finding.jammed:
            return finding
    solves = [rank]
    for name, asked in attempts(cone, solver, tolerance):
        stress = largest_smallest_force(cone, solver=name, tolerance=asked)
        solves.append(stress.solve)
        finding = proven(cone, softest, stress.weight, stress.motion, tuple(solves))
        if finding.jammed is None:
            # a motion that opens whatever can open has more room than the dual of the force program
            opened = open_all(cone, solver=name, tolerance=asked)
            solves.append(opened.solve)
            finding = proven(cone, softest, opened.weight, opened.motion, tuple(solves))
        if finding.jammed is not None:
            return finding
    return finding


def soft_finding(cone: MotionCone, solver: str, tolerance: float, solves: tuple[Solve, ...]) -> Finding | None:
    """Return what follows where the rows have no full rank, or hardly any; None at full rank.

    Below the threshold of rank a soft motion may be floppy in the hard packing that is meant: no forces make it sure
    then that the packing is jammed. It is not where some motion opens contacts and closes none, nor where the soft one
    changes the contacts by no more than these are known.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    solver, tolerance
        As in `programs.open_all`.
    solves
        What solvers did before.

    """
    softest, motion = cone.softest()
    if cone.is_floppy:
        reason = f"floppy: a motion changes no contact (singular value {softest:.1e} of the largest)"
        return Finding(False, reason, softest, motion=motion, solves=solves)
    if softest**2 > FLOPPY or is_surely_rigid(cone):
        return None
    softness = f"smallest singular value {softest:.1e} of the largest"
    for name, asked in attempts(cone, solver, tolerance):
        opened = open_all(cone, solver=name, tolerance=asked)
        solves = (*solves, opened.solve)
        if (proof := kept_open(cone, opened.motion)) is not None:
            return Finding(
                False, f"a motion opens contacts and closes none ({softness})", softest, motion=proof, solves=solves
            )
    if cone.is_floppy_within_error:
        reason = f"floppy: a motion changes contacts by less than these are known ({softness})"
        return Finding(False, reason, softest, motion=motion, solves=solves, within_error=True)
    return Finding(None, f"no full rank, but no motion passed the check either ({softness})", softest, solves=solves)


def is_surely_rigid(cone: MotionCone) -> bool:
    """Return whether the softest motion, though soft, changes contacts for sure in the hard packing that is meant too.

    By Weyl's bound: when rows change by the slack a particle's z contacts, two ends each, move singular values by at
    most about sqrt(2 z) times that. And before a gap closes, a motion that changes contacts by s of itself may go by
    gap / s and turn them by as much: contacts with gaps not far below s^2 may let particles go that they would hold at
    rest, so others must hold the motion in either direction. Next to a floppy motion solvers take a mixture with a soft
    one for the softest: its value is inconclusive.

    Parameters
    ----------
    cone
        The motions that the contacts admit.

    """
    value, motion = cone.softest()
    size = value * float(np.sqrt(cone.largest_eigenvalue))
    count, held = cone.opening.shape[0], cone.held.shape[0]
    known = max(cone.slack, cone.rounding) * 2.0 * float(np.sqrt(max(count / max(len(cone.kept_n), 1), 1.0)))
    if value <= _UNMIXED or size <= _SURE * known:
        return False
    change = cone.rows @ motion
    if cone.gap_c is not None:
        change[:count][size**2 <= _SURE * cone.gap_c] = 0.0
    either = float(np.square(change[count : count + held]).sum())
    change[count : count + held] = 0.0
    return all(
        either + float(np.square(np.minimum(one, 0.0)).sum()) > (_BOTH_WAYS * size) ** 2 for one in (change, -change)
    )


def _only_state(cone: MotionCone, softest: float, rank: Solve) -> Finding:
    """Return what the only state of self stress proves: what any weights leave when they are made to balance.

    The duality gap is that of the force program. With a motion that lengthens every contact by t / C and shortens the
    one of the smallest force t by 1, to an error e at most, no state has a smallest force above t + e sum |weight|.
    """
    start = time.process_time()
    count = cone.opening.shape[0]
    finding = proven(cone, softest, cone.balanced(np.ones(cone.rows.shape[0])), None, (rank,))
    if finding.weight is None:
        return finding
    stretch = np.zeros(cone.rows.shape[0])
    stretch[:count] = finding.smallest_force / count
    stretch[np.argmin(finding.weight[:count])] -= 1.0
    # what the contacts' lengths cannot follow of it
    error = float(np.abs(cone.balanced(stretch)).max())
    found = Solve(
        Outcome.CONVERGED,
        residual=finding.balance,
        gap=float(np.abs(finding.weight).sum()) * error,
        iterations=ROUNDS,
        seconds=time.process_time() - start,
        status="projection on the only state of self stress: Solved",
    )
    return replace(finding, solves=(rank, found))


def attempts(cone: MotionCone, solver: str, tolerance: float) -> list[tuple[str, float]]:
    """Return solvers and tolerances to ask until an answer passes its check.

    Contacts held by forces smaller than the tolerance seem to open, or to pull: there a smaller one may tell.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    solver, tolerance
        What is asked first.

    """
    closer = [] if solver == "highs" or tolerance <= CLOSE else [(solver, CLOSE)]
    simplex = [] if solver == "highs" or len(cone.kept_n) > SIMPLEX_PARTICLES else [("highs", tolerance)]
    return [(solver, tolerance), *closer, *simplex]


def proven(
    cone: MotionCone,
    softest: float,
    weight: NDArray[np.float64],
    motion: NDArray[np.float64] | None,
    solves: tuple[Solve, ...],
) -> Finding:
    """Return what candidate forces or a candidate motion prove, for a cone of full rank.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    softest
        Smallest over largest singular value of its rows [1].
    weight, motion
        (C + h + b,) forces and multipliers, and (n,) a motion or None, as `programs.largest_smallest_force` gives them.
    solves
        What the solvers achieved, the rank first.

    """
    count = cone.opening.shape[0]
    mean = float(weight[:count].mean())
    smallest = -np.inf
    if np.isfinite(mean) and mean > 0:
        weight = cone.balanced(weight / mean)
        weight /= weight[:count].mean()
        smallest = float(weight[:count].min())
        balance = float(np.abs(cone.rows.T @ weight).max())
        error = force_error(cone, softest, weight)
        pressing = bool((weight[count + cone.held.shape[0] :] > error).all())
        if smallest > error and balance <= BALANCE and pressing:
            reason = f"full rank, and contact forces in balance with smallest over mean {smallest:.2e}"
            return Finding(True, reason, softest, smallest, weight, balance=balance, solves=solves)
    if motion is not None and (proof := kept_open(cone, motion)) is not None:
        if 0.0 < smallest <= error and closes_hardly(cone, proof):
            reason = f"forces of {smallest:.1e} of their mean would hold what moves: no more than rounding either way"
            return Finding(None, reason, softest, solves=solves)
        if smallest == -np.inf:
            reason = "contacts push in no balanced way (no state of self stress without tension)"
        else:
            reason = f"every balance of the contacts pulls on one (largest smallest over mean force {smallest:.2e})"
        return Finding(False, reason, softest, smallest, motion=proof, solves=solves)
    status = "; ".join(solve.status for solve in solves[1:])
    reason = f"neither forces nor a motion passed the check ({status})"
    if np.isfinite(smallest) and abs(smallest) <= error:
        reason += f": the smallest force is {smallest:.1e} of their mean and not known better than to {error:.1e}"
    return Finding(None, reason, softest, solves=solves)


def force_error(cone: MotionCone, softest: float, weight: NDArray[np.float64]) -> float:
    """Return how far each of the weights, of mean 1, may be from a state of self stress of the exact rows [1].

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    softest
        Smallest over largest singular value of its rows [1].
    weight
        (C + h + b,) weights in balance to rounding.

    """
    net = cone.rows.T @ weight
    rows = _ROWS * len(cone.kept_n) ** (1.0 / cone.dimension) * np.sqrt(weight @ weight)
    return float((NET_FORCES * np.sqrt(net @ net) + rows) / (softest * np.sqrt(cone.largest_eigenvalue)))


def closes_nothing(cone: MotionCone, motion: NDArray[np.float64], *, opening: bool = True) -> bool:
    """Return whether the motion opens contacts and closes none by more than rounding.

    The volume's rule is enforced first, so what breaks it counts as closing contacts.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    motion
        (n,) a motion.
    opening
        Whether it must open some contact; a motion without translation that changes none will do otherwise.

    """
    stretch = cone.opening @ cone.keeping_rules(motion)
    size = float(np.abs(motion).max(initial=0.0))
    # an opening that is rounding of the motion is none
    if opening and not (len(stretch) and float(stretch.mean()) > ROUNDING * size):
        return False
    return size > 0.0 and -float(stretch.min(initial=0.0)) <= cone.rounding * size


def closes_hardly(cone: MotionCone, motion: NDArray[np.float64]) -> bool:
    """Return whether a motion that passes for one that closes nothing closes more than rounding mostly leaves.

    Forces that are as small could hold such a motion.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    motion
        (n,) a motion.

    """
    stretch = cone.opening @ cone.keeping_rules(motion)
    return -float(stretch.min(initial=0.0)) > _TYPICAL_ROUNDING * cone.rounding * float(np.abs(motion).max(initial=0.0))


def kept_open(cone: MotionCone, motion: NDArray[np.float64], *, opening: bool = True) -> NDArray[np.float64] | None:
    """Return a motion that closes no contact, near one that does so to a solver's tolerance; or None.

    Contacts that the motion hardly changes are kept as they are, by projection; contacts that cannot be kept while the
    others open, as where a force however small on these holds them, leave none.

    Parameters
    ----------
    cone
        The motions that the contacts admit.
    motion
        (n,) a motion.
    opening
        Whether it must open some contact.

    """
    motion = cone.without_translations(cone.keeping_rules(motion))
    if closes_nothing(cone, motion, opening=opening):
        return motion
    change = cone.rows @ motion
    count = cone.opening.shape[0]
    size = float(np.abs(motion).max(initial=0.0))
    closing = -float(change[:count].min(initial=0.0))
    if not np.isfinite(change).all() or closing <= 0.0:
        return None
    for times in _HARDLY:
        if times * closing > _LITTLE * size:
            return None
        shut = change < times * closing
        # rigid links and a fixed volume
        shut[count : count + cone.held.shape[0]] = True
        if opening and shut[:count].all():
            return None
        for kept in cone.shutting(motion, shut):
            if float(np.abs(kept).max()) > 0.5 * size and closes_nothing(cone, kept, opening=opening):
                return cone.keeping_rules(kept)
    return None


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
    """Return whether the cone is trivial, by the programs of Dennis (2021): a random load b, then -b, move nothing.

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
