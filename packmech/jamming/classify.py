"""The verdict on a packing, with its grounds, and when it must not be trusted.

That is where the packing is out of balance, or where its contacts depend on the gap tolerance. Contacts added to a
jammed packing leave it jammed, contacts taken from one that is not leave it so. So where the number of contacts depends
on the tolerance, an answer still stands if the least favorable of the tolerances gives it too. For the same reason the
fewest contacts, if they jam the packing, answer for the others as well.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import BoxStrain, brief, given_shape, instance, integer, integer_array, one_of, real
from packmech.contacts import Contacts
from packmech.contacts.given import check_given
from packmech.jamming.backbone import EMPTY, Judged, carrying_contacts, judge_network, standing_contacts, with_more
from packmech.jamming.certificates import Finding, certify, yield_to_loads
from packmech.jamming.contact_selection import (
    MINIMUM_GAP_TOLERANCE,
    ContactSelection,
    RestCheck,
    check_rest,
    select_contacts,
)
from packmech.jamming.motion_cone import MotionCone
from packmech.jamming.programs import SOLVERS
from packmech.jamming.shaped import classify_shaped
from packmech.jamming.tiled import MOST_COPIES, MOST_WAVES, floppy_in_copies, judge_tiled
from packmech.jamming.verdict import (
    AMBIGUOUS,
    JAMMED,
    NOT_JAMMED,
    OFF_PLATEAU,
    JammingAnswer,
    TiledAnswer,
    Verdict,
    unjamming_motion,
)
from packmech.jit.blas import single_thread
from packmech.measure.rattlers import without
from packmech.mechanics.hessian import is_stable
from packmech.packing import Packing, no_own_images, no_tangential
from packmech.scene import Scene

# Up to this mean overlap times N'^2 soft packings have the contacts of the hard packing that they come from. (The
# condition is P N^2 << 1; 53 of 60 packings had no surplus contact at 0.04, 13 of 20 at 0.7, none at 10.)
SMALL_OVERLAP = 0.1
# From this gap tolerance on [1] gaps are no errors of coordinates any more, even where it was asked for.
WIDE_GAPS = 0.01


def out_of_balance(rest: RestCheck | None, selection: ContactSelection) -> str:
    """Return why the packing is not at rest, or an empty string."""
    if rest is None or rest.at_rest:
        return ""
    reason = (
        f"not at rest: the largest net force is {rest.residual:.1e} of the mean contact force,"
        f" above {rest.limit:.1e} (law: {rest.law})"
    )
    if rest.law.endswith("assumed"):
        reason += "; a scene would give its law"
    if selection.mean_overlap < MINIMUM_GAP_TOLERANCE:
        reason += f"; if overlaps of {selection.mean_overlap:.0e} are errors of hard particles: rest_tolerance=inf"
    return reason


def off_plateau(selection: ContactSelection) -> str:
    """Return how the excess contacts depend on the gap tolerance; an empty string if not, or if it is not asked."""
    given = selection.rule == "given" and selection.tolerance < WIDE_GAPS
    if given or selection.on_plateau:
        return ""
    steps = ", ".join(f"{level.excess:+d} at {level.tolerance:.1e}" for level in selection.levels)
    return (
        f"{OFF_PLATEAU}: contacts beyond the fewest that jam are {steps}; "
        "judge the hard packing that pm.jam compressed (run.report['hard_packing'] of HardVertex), or the pairs that "
        "press, contacts=pm.find_contacts(packing), or a packing at a pressure at which overlaps are smaller "
        f"({selection.mean_overlap:.1e} in the mean here); see packmech guide verdicts"
    )


def by_level(selection: ContactSelection, judge: Callable[..., Judged]) -> Callable[[int], Judged]:
    """Return a function that gives the findings at each level of the gap tolerance, judged once when first asked for.

    Parameters
    ----------
    selection
        The pairs that touch; the level in the middle, 1, is at the tolerance.
    judge
        As `judge_network` with the contacts and, by name, their backbone left open.

    """

    @functools.cache
    def within(level: int) -> Judged:
        if level == 1:
            return judge(selection.contacts, backbone=selection.backbone)
        contacts = selection.within(level)
        # the pairs of one level are among those of the next: as many are the same
        return within(1) if len(contacts) == len(selection.contacts) else judge(contacts)

    return within


def judged_by_fewest(
    packing: Packing,
    selection: ContactSelection,
    rest: RestCheck | None,
    within: Callable[[int], Judged],
    strain: BoxStrain,
) -> Judged | None:
    """Return the findings at the gap tolerance where those at a tenth of it, asked first, imply them; or None.

    They are asked where the answer depends on them, as off the plateau, and where they may suffice: with the same
    backbone particles, and contacts enough to jam these strictly.

    Parameters
    ----------
    packing
        The packing.
    selection, rest
        What was assumed.
    within
        Gives the findings at a level.
    strain
        As in `judge_network`.

    """
    if not off_plateau(selection) or out_of_balance(rest, selection) or selection.backbone is None:
        return None
    d, (few, at, _) = packing.dimension, selection.levels
    if few.particles != at.particles or few.contacts == at.contacts or few.excess < d * (d + 1) // 2 - 1:
        return None
    return with_more(packing, within(0), selection.backbone, strain)


def settle(
    collectively: JammingAnswer,
    strictly: JammingAnswer,
    selection: ContactSelection,
    rest: RestCheck | None,
    within: Callable[[int], Judged],
) -> tuple[JammingAnswer, JammingAnswer]:
    """Return the collective and the strict answer, ambiguous where the packing's state leaves them open.

    Parameters
    ----------
    collectively, strictly
        The answers by the contacts within the gap tolerance.
    selection, rest
        What was assumed.
    within
        Gives all findings on the contacts at a level of the gap tolerance.

    """
    reason = out_of_balance(rest, selection)
    if reason:
        return _left_open(collectively, reason), _left_open(strictly, reason)
    reason = off_plateau(selection)
    if reason:
        jammed = (collectively.verdict == JAMMED, strictly.verdict == JAMMED)
        kept: tuple[bool | None, bool | None]
        if jammed == (True, True):
            may = _may_stand(collectively, selection) or _may_stand(strictly, selection)
            kept = within(0).jammed if may else (None, None)
        elif jammed == (True, False):
            may = _may_stand(collectively, selection)
            kept = (within(0).jammed[0] if may else None, within(2).jammed[1] is False)
        else:
            collective, strict = within(2).jammed
            kept = (collective is False, strict is False)
        collectively = _settled(collectively, selection, kept[0], reason)
        strictly = _settled(strictly, selection, kept[1], reason)
    return _consistent(collectively, strictly)


def settle_copies(
    packing: Packing,
    copied: TiledAnswer,
    strictly: JammingAnswer,
    judged: Judged,
    selection: ContactSelection,
    within: Callable[[int], Judged],
) -> TiledAnswer:
    """Return the answer on copies, ambiguous where other gap tolerances would give another.

    That copies unjam stands where their motion keeps all pairs within ten times the tolerance, too; that they are
    jammed, where the pairs within a tenth are the same. What one box says has been settled.
    """
    reason = off_plateau(selection)
    of_one_box = copied.repeats == (1,) * packing.dimension
    if not reason or copied.collective == AMBIGUOUS or of_one_box:
        return copied
    if copied.collective == JAMMED:
        stands = len(within(0).network) == len(judged.network)
    else:
        most = within(2)
        backbone = np.zeros(packing.particles, dtype=bool)
        backbone[most.collective[0].kept_n] = True
        assert copied.wave_vector_d is not None
        stands = floppy_in_copies(packing, most.network, backbone, copied.wave_vector_d)
    if stands:
        return copied
    strict = NOT_JAMMED if strictly.verdict == NOT_JAMMED else AMBIGUOUS
    return replace(copied, collective=AMBIGUOUS, strict=strict, reason=reason, packing=None, motion=None, repeats=None)


def undecided(packing: Packing, answer: JammingAnswer) -> JammingAnswer:
    """Return the answer, ambiguous where a motion that links admit is blocked at second order, by the forces."""
    if not packing.links or answer.verdict != NOT_JAMMED:
        return answer
    if answer.stable is None and answer.unjamming_motion is not None:
        return replace(answer, reason=f"{answer.reason}; to first order only: links may block it at second")
    if not answer.stable:
        return answer
    return _left_open(answer, f"not jammed to first order, but held by the forces at second order; {answer.reason}")


def _left_open(answer: JammingAnswer, reason: str) -> JammingAnswer:
    return replace(answer, verdict=AMBIGUOUS, reason=reason)


def _settled(answer: JammingAnswer, selection: ContactSelection, kept: bool | None, reason: str) -> JammingAnswer:
    """Return the answer, ambiguous unless it is `kept` by the fewest contacts (if jammed) or the most (if not)."""
    if answer.verdict == AMBIGUOUS:
        return answer
    fewest, _, most = selection.levels
    if answer.verdict == NOT_JAMMED and kept:
        return replace(answer, reason=f"{answer.reason}; nor with all pairs within {most.tolerance:.1e}")
    if answer.verdict == JAMMED and kept and _may_stand(answer, selection):
        return replace(answer, reason=f"{answer.reason}; with the pairs within {fewest.tolerance:.1e} already")
    return _left_open(answer, reason)


def _may_stand(answer: JammingAnswer, selection: ContactSelection) -> bool:
    """Return whether "jammed" may stand off the plateau, if the fewest contacts give it too."""
    fewest, at, _ = selection.levels
    unique = answer.states_of_self_stress == 1 and fewest.excess == at.excess
    return unique or selection.mean_overlap * fewest.particles**2 < SMALL_OVERLAP


def _consistent(collectively: JammingAnswer, strictly: JammingAnswer) -> tuple[JammingAnswer, JammingAnswer]:
    """Return the answers, an ambiguous one settled where the other implies it: strictly jammed is collectively so."""
    if strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:
        reason = f"strictly jammed, so collectively; {strictly.reason}"
        collectively = replace(collectively, verdict=JAMMED, reason=reason)
    elif collectively.verdict == NOT_JAMMED and strictly.verdict == AMBIGUOUS:
        reason = f"not collectively jammed, so not strictly; {collectively.reason}"
        strictly = replace(strictly, verdict=NOT_JAMMED, reason=reason)
    return collectively, strictly


METHODS = ("certificate", "loads")
STRICT_STRAINS: tuple[BoxStrain, ...] = ("free", "isochoric")
BOUNDS = ("ball", "box")


@shown_as("is it jammed?")
@honors("repulsion kinds links shapes", at_rest=True)
def classify_jamming(
    packing: Packing | Scene,
    *,
    method: str = "certificate",
    solver: str = "clarabel",
    strain: BoxStrain = "free",
    gap_tolerance: float | None = None,
    contacts: Contacts | None = None,
    rest_tolerance: float = 1e-5,
    tolerance: float = 1e-8,
    bound: str = "ball",
    seed: int = 0,
    tiled: bool | Sequence[int] = False,
) -> Verdict:
    """Return whether a packing is locally, collectively and strictly jammed, with grounds that can be checked.

    Rattlers are taken out first. What is left is collectively jammed when no motion but a translation opens or keeps
    all contacts in the fixed box, strictly jammed when none does that with a strain of the box that does not enlarge
    it. Motions are judged to first order, which decides for discs and spheres. Particles whose contacts can carry no
    force are taken out too if the others are jammed by themselves. Two contacts of a particle that are opposite to
    within 1e-8 rad count as opposite: held by forces smaller than that part of the others nothing is jammed for sure.

    Ellipses, spheroids and rigid bodies are judged at the contacts that overlap: to first order where these leave no
    motion, else by what the contact forces do to the motions that are left (quartic modes), the strict question at
    fixed volume; the reason says which. The settings of the solvers have no part in it.

    With rigid links motions keep these, and the certificate holds their forces, of either sign, beside those of the
    contacts. There a first-order motion may be blocked at second order: where the Hessian says so (`prestress_stable`,
    of the backbone) the answer is ambiguous, and `first_order_jammed` tells the first order apart.

    Parameters
    ----------
    packing
        The packing, or a scene: with its law the Hessian's stability is answered too, and rest is judged by its forces.
    method
        "certificate": rank of the rigidity matrix, and the state of self stress with the largest smallest force (Roth
        and Whiteley). "loads": the linear programs of Dennis (2021), a random load b and then -b; what these move
        relative to the largest group at rest is taken out, again and again, and an empty backbone is not jammed.
    solver
        "clarabel", "cvxpy" (the same programs as they read on paper) or "highs" (simplex; loads in a box). Where an
        interior-point method gives no answer that passes its check, simplex decides up to N = 1000.
    strain
        "free" or "isochoric": what the box may do in the strict question: any strain whose volume does not grow, or
        only those that keep it. The same for discs and spheres; clusters that
        are not convex might interlock.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching. By default
        max(7 x mean relative overlap, 1e-9). Where a tenth or ten times that tolerance gives another number of excess
        contacts, the answer is ambiguous, unless the pairs in question cannot matter: it is not jammed with all of them
        either, or jammed without them already and either its self stress is the only one or the overlaps are so small
        (mean overlap times N'^2 below 0.1) that pressure has closed no gap. A tolerance that is given is taken at its
        word below 0.01, as what the coordinates may be wrong by; from there on the same is asked of it.
    contacts
        The contacts to judge, instead of those within a gap tolerance; then neither gaps nor rest are checked. They
        must be pairs of this packing as it stands, each once.
    rest_tolerance
        Largest net force over mean contact force [1] at which a packing with overlaps counts as at rest; at least eight
        rounding floors are allowed. Without a scene the forces are those of a harmonic law. Beyond it: ambiguous.
        Infinity leaves the check out, for hard particles with coordinates of few digits.
    tolerance
        Of the solvers.
    bound
        "ball" or "box": what bounds the motion of the load programs. "highs" solves linear programs only and always
        takes the box; `Verdict.bound` says what was taken.
    seed
        Draws the load.
    tiled
        Whether to judge copies of the packing side by side, too: True for any numbers of copies, or the largest
        numbers along each lattice vector, up to 12 each and 1000 in all. The answer is `Verdict.tiled`; what is jammed
        in one box may unjam in two.
        Discs and spheres without rigid links; above 1500 coordinates the answer is "ambiguous".

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> verdict = classify_jamming(pm.lattice_packing("triangular", repeats=(4, 4)), tiled=True)
    >>> verdict.tiled.collective, verdict.tiled.strict
    ('jammed', 'jammed')
    >>> verdict.collective, verdict.strict, verdict.contacts, verdict.isostatic_contacts
    ('jammed', 'jammed', 48, 33)
    >>> verdict = classify_jamming(pm.lattice_packing("kagome", repeats=(2, 2)))
    >>> verdict.collective, verdict.collectively.floppy_modes, round(verdict.unjamming_motion.closing, 9)
    ('not jammed', 4, 0.0)

    """
    start = time.process_time()
    scene = packing if isinstance(packing, Scene) else None
    if isinstance(packing, Scene):
        # a scene with friction is refused: springs of one without are slack
        packing = packing.packing.replace(tangential=None)
        scene = None if scene is None else scene.replace(packing=packing)
    instance("packing", packing, Packing)
    no_tangential("packing", packing)
    no_own_images("packing", packing)
    if packing.shapes.has_orientations and not packing.shapes.turns_n.any():
        packing = packing.replace(shapes=None)
        scene = None if scene is None else scene.replace(packing=packing)
    one_of("method", method, METHODS)
    one_of("solver", solver, SOLVERS)
    one_of("strain", strain, STRICT_STRAINS)
    one_of("bound", bound, BOUNDS)
    if gap_tolerance is not None:
        gap_tolerance = real("gap_tolerance", gap_tolerance, above=-0.1, below=1.0)
    real("tolerance", tolerance, above=0.0, at_most=1e-3)
    rest_tolerance = real("rest_tolerance", rest_tolerance, above=0.0, infinite=True)
    integer("seed", seed, at_least=0)
    repeats = _repeats(packing, tiled, method)
    if method == "loads" and solver == "highs":
        bound = "box"
    if packing.shapes.has_orientations:
        if contacts is not None:
            raise ValueError(f"contacts must be left out for {type(packing.shapes).__name__}, got {len(contacts)}")
        with single_thread():
            return classify_shaped(
                packing, scene, strain=strain, gap_tolerance=gap_tolerance, rest_tolerance=rest_tolerance
            )

    def decide(cone: MotionCone) -> Finding:
        if method == "certificate":
            return certify(cone, solver=solver, tolerance=tolerance)
        rng = np.random.default_rng(seed)
        return yield_to_loads(cone, rng, bound=bound, solver=solver, tolerance=tolerance)

    def part(cone: MotionCone, finding: Finding, network: Contacts) -> Contacts | None:
        if method == "certificate":
            return carrying_contacts(packing, cone, network, solver, tolerance)
        return standing_contacts(cone, network, finding)

    with single_thread():
        if contacts is None:
            selection = select_contacts(packing, gap_tolerance)
            rest = check_rest(packing, None if scene is None else scene.effects, rest_tolerance)
        else:
            check_given(packing, contacts)
            selection, rest = ContactSelection(contacts, np.nan, np.nan, "contacts given"), None
        judge = functools.partial(judge_network, packing, strain=strain, decide=decide, part=part)
        within = by_level(selection, judge)
        # the load programs give no forces that would have to be those at the tolerance
        implied = judged_by_fewest(packing, selection, rest, within, strain) if method == "loads" else None
        judged = within(1) if implied is None else implied
        collectively, strictly = (
            _answer(packing, method, one, len(judged.network)) for one in (judged.collective, judged.strict)
        )
        if method == "loads" and judged.emptied:
            collectively, strictly = (_emptied(answer, judged.emptied) for answer in (collectively, strictly))
        rattlers = np.ones(packing.particles, dtype=bool)
        if len(judged.network):
            rattlers[judged.collective[0].kept_n] = False
        if scene is not None and rest is not None and rest.at_rest:
            closed = MINIMUM_GAP_TOLERANCE if selection.mean_overlap < 0.1 * MINIMUM_GAP_TOLERANCE else 0.0
            collectively = replace(collectively, stable=_stable(scene, rattlers, strain="none", gap_tolerance=closed))
            strictly = replace(strictly, stable=_stable(scene, rattlers, strain="isochoric", gap_tolerance=closed))
        collectively, strictly = (undecided(packing, answer) for answer in (collectively, strictly))
        collectively, strictly = settle(collectively, strictly, selection, rest, within)
        copied = None
        if tiled is not False:
            copied = judge_tiled(packing, collectively, strictly, judged.network, ~rattlers, repeats)
            copied = settle_copies(packing, copied, strictly, judged, selection, within)
    return Verdict(
        *_local(judged, selection, rest),
        collectively,
        strictly,
        rattlers,
        judged.network,
        selection,
        rest,
        method,
        solver,
        strain,
        time.process_time() - start,
        packing.cluster_n if packing.links else None,
        bound if method == "loads" else None,
        packing,
        copied,
    )


def _repeats(packing: Packing, tiled: bool | Sequence[int], method: str) -> tuple[int, ...] | None:
    """Return the largest numbers of copies to judge; None for any, or where none are asked for."""
    if tiled is False:
        return None
    if packing.links or packing.shapes.has_orientations:
        what = f"{len(packing.links)} rigid links" if packing.links else type(packing.shapes).__name__
        raise ValueError(f"tiled must be left out but for discs and spheres without rigid links, got {what}")
    if method == "loads":
        raise ValueError(
            'tiled must be left out with method "loads", which gives no contact forces: method="certificate"'
        )
    if tiled is True:
        return None
    if len(given_shape(tiled)) != 1:
        raise TypeError(f"tiled must be True, False or {packing.dimension} numbers of copies, got {brief(tiled)}")
    numbers = integer_array("tiled", tiled, shape=(packing.dimension,), what="lattice vector")
    if not (1 <= int(numbers.min()) and int(numbers.max()) <= MOST_COPIES and int(numbers.prod()) <= MOST_WAVES):
        raise ValueError(
            f"tiled must be between 1 and {MOST_COPIES} along each lattice vector, and at most {MOST_WAVES} copies, "
            f"got {numbers.tolist()}"
        )
    return tuple(numbers.tolist())


def _local(judged: Judged, selection: ContactSelection, rest: RestCheck | None) -> tuple[str, str]:
    """Return whether some particles hold each other in place one by one, and why."""
    emptied = len({level.contacts > 0 for level in selection.levels}) > 1
    reason = out_of_balance(rest, selection) or (off_plateau(selection) if emptied else "")
    if reason:
        return AMBIGUOUS, reason
    if len(judged.network):
        return JAMMED, "every backbone particle is held"
    if judged.jammed[0] is None:
        return AMBIGUOUS, judged.collective[1].reason
    return NOT_JAMMED, EMPTY


def _stable(scene: Scene, rattling_n: NDArray[np.bool_], *, strain: BoxStrain, gap_tolerance: float) -> bool:
    """Return whether the Hessian is positive, in packings with links on the backbone as it was judged."""
    if not scene.packing.links:
        return is_stable(scene, strain=strain, gap_tolerance=gap_tolerance)
    if rattling_n.all():
        return False
    backbone, _ = without(scene.packing, rattling_n)
    return is_stable(scene.replace(packing=backbone), strain=strain, gap_tolerance=gap_tolerance, free_turns=False)


def _emptied(answer: JammingAnswer, rounds: int) -> JammingAnswer:
    """Return the answer, its reason that taking out what moves, again and again (as Dennis, 2021), left nothing."""
    if answer.verdict != NOT_JAMMED:
        return answer
    times = "once" if rounds == 1 else f"{rounds} times"
    reason = f"{EMPTY.partition(':')[0]}: {answer.reason}, and nothing is left when what moves is taken out {times}"
    return replace(answer, reason=reason)


def _answer(packing: Packing, method: str, judged: tuple[MotionCone, Finding], count: int) -> JammingAnswer:
    cone, finding = judged
    # without a backbone there is nothing to count
    independent = cone.unknowns - cone.dimension if count else 0
    floppy = 0 if finding.jammed or not independent else cone.floppy_modes(within_error=finding.within_error)
    states = count + cone.bound_rows - (independent - floppy) if count else 0
    return JammingAnswer(
        verdict=AMBIGUOUS if finding.jammed is None else JAMMED if finding.jammed else NOT_JAMMED,
        reason=finding.reason,
        first_order_jammed=finding.jammed,
        isostatic_contacts=independent + 1 - cone.bound_rows if count else 0,
        states_of_self_stress=states,
        floppy_modes=floppy,
        smallest_singular_value=cone.softest()[0] if finding.implied and method == "certificate" else finding.softest,
        smallest_force=finding.smallest_force,
        contact_force_c=_forces(finding.weight, count),
        link_tension_l=_tensions(cone, finding.weight, count),
        balance=finding.balance,
        unjamming_motion=None
        if finding.motion is None
        else unjamming_motion(packing, cone, cone.keeping_rules(finding.motion)),
        solves=finding.solves,
    )


def _forces(weight: NDArray[np.float64] | None, count: int) -> NDArray[np.float64] | None:
    return None if weight is None else weight[:count]


def _tensions(cone: MotionCone, weight: NDArray[np.float64] | None, count: int) -> NDArray[np.float64] | None:
    if weight is None or not cone.links.share.shape[1]:
        return None
    # a contact's weight pushes
    tension: NDArray[np.float64] = -(cone.links.share.T @ weight[count : count + cone.link_rows])
    return tension
