"""When a verdict must not be trusted: packings not at rest, and contacts that depend on the gap tolerance.

Contacts added to a jammed packing leave it jammed, contacts taken from one that is not leave it so. So where the number
of contacts depends on the tolerance, an answer still stands if the least favorable of the tolerances gives it too.
For the same reason the fewest contacts, if they jam the packing, answer for the others as well.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

from packmech.jamming.backbone import Judged, with_more
from packmech.jamming.contact_selection import LEAST_GAP, RestCheck, Touching
from packmech.jamming.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, Answer
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


def by_level(touching: Touching, judge: Callable[..., Judged]) -> Callable[[int], Judged]:
    """Return a function that gives the findings at each level of the gap tolerance, judged once when first asked for.

    Parameters
    ----------
    touching
        The pairs that touch; the level in the middle, 1, is at the tolerance.
    judge
        As `judging.judge_network` with the contacts and, by name, their backbone left open.

    """

    @functools.cache
    def within(level: int) -> Judged:
        if level == 1:
            return judge(touching.contacts, backbone=touching.backbone)
        contacts = touching.within(level)
        # the pairs of one level are among those of the next: as many are the same
        return within(1) if len(contacts) == len(touching.contacts) else judge(contacts)

    return within


def judged_by_fewest(
    packing: Packing, touching: Touching, rest: RestCheck | None, within: Callable[[int], Judged], strain: str
) -> Judged | None:
    """Return the findings at the gap tolerance where those at a tenth of it, asked first, imply them; or None.

    They are asked where the answer depends on them, as off the plateau, and where they may suffice: with the same
    backbone particles, and contacts enough to jam these strictly.

    Parameters
    ----------
    packing
        The packing.
    touching, rest
        What was assumed.
    within
        Gives the findings at a level.
    strain
        As in `judging.judge_network`.

    """
    if not off_plateau(touching) or unrest(rest, touching) or touching.backbone is None:
        return None
    d, (few, at, _) = packing.dimension, touching.levels
    if few.particles != at.particles or few.contacts == at.contacts or few.excess < d * (d + 1) // 2 - 1:
        return None
    return with_more(packing, within(0), touching.backbone, strain)


def settle(
    collectively: Answer,
    strictly: Answer,
    touching: Touching,
    rest: RestCheck | None,
    within: Callable[[int], Judged],
) -> tuple[Answer, Answer]:
    """Return the collective and the strict answer, ambiguous where the packing's state leaves them open.

    Parameters
    ----------
    collectively, strictly
        The answers by the contacts within the gap tolerance.
    touching, rest
        What was assumed.
    within
        Gives all findings on the contacts at a level of the gap tolerance.

    """
    reason = unrest(rest, touching)
    if reason:
        return _left_open(collectively, reason), _left_open(strictly, reason)
    reason = off_plateau(touching)
    if reason:
        jammed = (collectively.verdict == JAMMED, strictly.verdict == JAMMED)
        kept: tuple[bool | None, bool | None]
        if jammed == (True, True):
            may = _may_stand(collectively, touching) or _may_stand(strictly, touching)
            kept = within(0).jammed if may else (None, None)
        elif jammed == (True, False):
            may = _may_stand(collectively, touching)
            kept = (within(0).jammed[0] if may else None, within(2).jammed[1] is False)
        else:
            collective, strict = within(2).jammed
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
    fewest, _, most = touching.levels
    if answer.verdict == NOT_JAMMED and kept:
        return replace(answer, reason=f"{answer.reason}; nor with all pairs within {most.tolerance:.1e}")
    if answer.verdict == JAMMED and kept and _may_stand(answer, touching):
        return replace(answer, reason=f"{answer.reason}; with the pairs within {fewest.tolerance:.1e} already")
    return _left_open(answer, reason)


def _may_stand(answer: Answer, touching: Touching) -> bool:
    """Return whether "jammed" may stand off the plateau, if the fewest contacts give it too."""
    fewest, at, _ = touching.levels
    unique = answer.states_of_self_stress == 1 and fewest.excess == at.excess
    return unique or touching.mean_overlap * fewest.particles**2 < SMALL_OVERLAP


def _consistent(collectively: Answer, strictly: Answer) -> tuple[Answer, Answer]:
    """Return the answers, a doubtful one settled where the other implies it: strictly jammed is collectively jammed."""
    if strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:
        reason = f"strictly jammed, so collectively; {strictly.reason}"
        collectively = replace(collectively, verdict=JAMMED, reason=reason)
    elif collectively.verdict == NOT_JAMMED and strictly.verdict == AMBIGUOUS:
        reason = f"not collectively jammed, so not strictly; {collectively.reason}"
        strictly = replace(strictly, verdict=NOT_JAMMED, reason=reason)
    return collectively, strictly
