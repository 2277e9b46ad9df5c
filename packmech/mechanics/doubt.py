"""When a verdict must not be trusted: packings not at rest, and contacts that depend on the gap tolerance.

Contacts added to a jammed packing leave it jammed, contacts taken from one that is not leave it so. So where the number
of contacts depends on the tolerance, an answer still stands if the least favorable of the tolerances gives it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from packmech.contacts import Contacts
from packmech.mechanics.judging import Judged
from packmech.mechanics.touching import LEAST_GAP, RestCheck, Touching
from packmech.mechanics.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, Answer
from packmech.packing import Packing

# Up to this mean overlap times N'^2 soft packings have the contacts of the hard packing that they come from. (The
# condition is P N^2 << 1; 53 of 60 packings had no surplus contact at 0.04, 13 of 20 at 0.7, none at 10.)
SMALL_OVERLAP = 0.1


def unrest(rest: RestCheck | None, touching: Touching) -> str:
    """Return why the packing is not at rest, or an empty string."""
    if rest is None or rest.at_rest:
        return ""
    reason = (
        f"not at rest: the largest net force is {rest.residual:.1e} of the mean contact force,"
        f" above {rest.limit:.1e} (law: {rest.law})"
    )
    if rest.law.endswith("assumed"):
        reason += "; a scene would tell its law"
    if touching.mean_overlap < LEAST_GAP:
        reason += f"; if overlaps of {touching.mean_overlap:.0e} are errors of hard particles: rest_tolerance=inf"
    return reason


def off_plateau(touching: Touching) -> str:
    """Return how the excess contacts depend on the gap tolerance; an empty string if they do not, or it was given."""
    if touching.rule == "given" or touching.on_plateau:
        return ""
    steps = ", ".join(f"{level.excess:+d} at {level.tolerance:.1e}" for level in touching.levels)
    return f"the gap tolerance is off its plateau: contacts beyond the fewest that jam are {steps}"


def settle(
    collectively: Answer,
    strictly: Answer,
    touching: Touching,
    rest: RestCheck | None,
    judge: Callable[[Contacts], Judged],
) -> tuple[Answer, Answer]:
    """Return the collective and the strict answer, ambiguous where the packing's state leaves them open.

    Parameters
    ----------
    collectively, strictly
        The answers by the contacts within the gap tolerance.
    touching, rest
        What was assumed.
    judge
        Gives all findings on other contacts of the same packing.

    """
    reason = unrest(rest, touching)
    if reason:
        return _left_open(collectively, reason), _left_open(strictly, reason)
    reason = off_plateau(touching)
    if reason:
        fewer, more = touching.within(0), touching.within(2)
        jammed = (collectively.verdict == JAMMED, strictly.verdict == JAMMED)
        if jammed == (True, True):
            kept = judge(fewer).jammed
        elif jammed == (True, False):
            kept = (judge(fewer).jammed[0], judge(more).jammed[1] is False)
        else:
            collective, strict = judge(more).jammed
            kept = (collective is False, strict is False)
        collectively = _settled(collectively, touching, kept[0], reason)
        strictly = _settled(strictly, touching, kept[1], reason)
    return _consistent(collectively, strictly)


def undecided(packing: Packing, answer: Answer) -> Answer:
    """Return the answer, ambiguous where a motion that links admit is blocked at second order, by the forces."""
    if packing.links is None or answer.verdict != NOT_JAMMED:
        return answer
    if answer.stable is None and answer.unjamming_motion is not None:
        return replace(answer, reason=f"{answer.reason}; to first order only: links may block it at second")
    if not answer.stable:
        return answer
    return _left_open(answer, f"not jammed to first order, but held by the forces at second order; {answer.reason}")


def _left_open(answer: Answer, reason: str) -> Answer:
    return replace(answer, verdict=AMBIGUOUS, reason=reason)


def _settled(answer: Answer, touching: Touching, kept: bool | None, reason: str) -> Answer:
    """Return the answer, ambiguous unless it is `kept` by the fewest contacts (if jammed) or the most (if not)."""
    if answer.verdict == AMBIGUOUS:
        return answer
    fewest, at, most = touching.levels
    if answer.verdict == NOT_JAMMED and kept:
        return replace(answer, reason=f"{answer.reason}; nor with all pairs within {most.tolerance:.1e}")
    if answer.verdict == JAMMED and kept:
        unique = answer.states_of_self_stress == 1 and fewest.excess == at.excess
        if unique or touching.mean_overlap * fewest.particles**2 < SMALL_OVERLAP:
            return replace(answer, reason=f"{answer.reason}; with the pairs within {fewest.tolerance:.1e} already")
    return _left_open(answer, reason)


def _consistent(collectively: Answer, strictly: Answer) -> tuple[Answer, Answer]:
    """Return the answers, a doubtful one settled where the other implies it: strictly jammed is collectively jammed."""
    if strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:
        reason = f"strictly jammed, so collectively; {strictly.reason}"
        collectively = replace(collectively, verdict=JAMMED, reason=reason)
    elif collectively.verdict == NOT_JAMMED and strictly.verdict == AMBIGUOUS:
        reason = f"not collectively jammed, so not strictly; {collectively.reason}"
        strictly = replace(strictly, verdict=NOT_JAMMED, reason=reason)
    return collectively, strictly
