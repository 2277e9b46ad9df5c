"""The backbone and what is known about it: rattlers out, both questions asked, idle parts out, asked again."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from packmech.check import BoxStrain
from packmech.contacts import Contacts
from packmech.jamming.certificates import Finding, attempts, closes_hardly, kept_open
from packmech.jamming.contact_selection import backbone_of
from packmech.jamming.motion_cone import MotionCone, motion_cone
from packmech.jamming.programs import open_all
from packmech.measure.rattlers import moving_apart
from packmech.packing import Packing
from packmech.result import Outcome

EMPTY = "empty backbone: every particle rattles"
HARDLY_HELD = "every particle rattles if contacts within 1e-8 of opposite are, and no motion closes nothing"

# part of a motion above which its strain is one
_STRAINS = 1e-6


@dataclass(frozen=True, eq=False)
class Judged:
    """A contact network without rattlers, and the findings on it.

    Attributes
    ----------
    network
        The contacts.
    collective, strict
        The cone of motions in the fixed box and with strains, each with what was found.
    emptied
        After how many rounds of taking out what cannot be part of a jammed backbone nothing was left; 0 if that did not
        happen.

    """

    network: Contacts
    collective: tuple[MotionCone, Finding]
    strict: tuple[MotionCone, Finding]
    emptied: int = 0

    @property
    def jammed(self) -> tuple[bool | None, bool | None]:
        """Whether it is collectively and strictly jammed; None where no solver could tell."""
        return self.collective[1].jammed, self.strict[1].jammed


def judge_network(
    packing: Packing,
    contacts: Contacts,
    strain: BoxStrain,
    decide: Callable[[MotionCone], Finding],
    part: Callable[[MotionCone, Finding, Contacts], Contacts | None],
    backbone: tuple[Contacts, NDArray[np.int64]] | None = None,
) -> Judged:
    """Return the backbone of a contact network and what is known about it.

    While it is not collectively jammed, the contacts that `part` keeps are judged by themselves, again and again, and
    win if they are jammed: then the particles that lost their contacts rattle. Otherwise the first findings stand, but
    for what a part that no solver could judge leaves open.

    Parameters
    ----------
    packing
        The packing.
    contacts
        Its contacts, those of rattlers included.
    strain
        "free" or "isochoric": what the box may do in the strict question; its volume never grows.
    decide
        Whether a cone of motions is trivial.
    part
        Which contacts of a network that is not jammed may be jammed by themselves; None for unknown.
    backbone
        What `backbone_of` makes of the contacts, if known.

    """
    first = judged = _judge_once(packing, contacts, strain, decide, backbone)
    rounds = 0
    # a network of which no solver could tell may still have a part that is jammed
    while len(judged.network) and not judged.jammed[0]:
        rounds += 1
        smaller = part(*judged.collective, judged.network)
        if smaller is None or len(smaller) == len(judged.network):
            return first if smaller is not None and judged.jammed[0] is False else _left_open(first)
        judged = _judge_once(packing, smaller, strain, decide)
    if judged.jammed[0]:
        return judged
    return replace(first, emptied=rounds)


def _left_open(first: Judged) -> Judged:
    """Return the findings where no solver could tell whether some part of the network is jammed by itself.

    What is left of a motion on that part may be nothing, unless the box is strained.
    """
    fixed, collective = first.collective
    free, strict = first.strict
    if collective.jammed is False:
        collective = _not_known(collective)
    if strict.jammed is False and strict.motion is not None:
        strain = strict.motion[len(free.kept_n) * free.dimension :]
        if np.abs(strain).max(initial=0.0) <= _STRAINS * np.abs(strict.motion).max(initial=0.0):
            strict = _not_known(strict)
    return replace(first, collective=(fixed, collective), strict=(free, strict))


def _not_known(finding: Finding) -> Finding:
    reason = f"{finding.reason}; whether a part is jammed by itself no solver could tell"
    return replace(finding, jammed=None, reason=reason, motion=None)


def _judge_once(
    packing: Packing,
    contacts: Contacts,
    strain: BoxStrain,
    decide: Callable[[MotionCone], Finding],
    backbone: tuple[Contacts, NDArray[np.int64]] | None = None,
) -> Judged:
    """Return the contacts between particles that do not rattle and what is known about all of them together."""
    network, kept = backbone_of(packing, contacts) if backbone is None else backbone
    if not len(network):
        nothing = _nothing_held(motion_cone(packing, contacts, strain="none"))
        return Judged(network, nothing, nothing)
    free = motion_cone(packing, network, strain=strain, kept_n=kept)
    strict = decide(free)
    if strict.jammed:
        return Judged(network, _implied(packing, network, kept, free, strict), (free, strict))
    fixed = motion_cone(packing, network, strain="none", kept_n=kept)
    return Judged(network, (fixed, decide(fixed)), (free, strict))


def with_more(
    packing: Packing, fewer: Judged, backbone: tuple[Contacts, NDArray[np.int64]], strain: BoxStrain
) -> Judged | None:
    """Return what follows for the backbone with contacts added, where it is strictly jammed without them; or None.

    More contacts admit fewer motions. No forces come with it: those without the new contacts leave these idle.

    Parameters
    ----------
    packing
        The packing.
    fewer
        The findings on some of the contacts.
    backbone
        All contacts between particles that do not rattle, and the numbers of these, as `backbone_of` gives them.
    strain
        "free" or "isochoric": what the box may do in the strict question; its volume never grows.

    """
    network, kept = backbone
    if fewer.jammed != (True, True) or not np.array_equal(fewer.strict[0].kept_n, kept):
        return None
    free = motion_cone(packing, network, strain=strain, kept_n=kept)
    strict = replace(fewer.strict[1], softest=np.nan, smallest_force=np.nan, weight=None, balance=0.0)
    return Judged(network, _implied(packing, network, kept, free, strict), (free, strict))


def _implied(
    packing: Packing, network: Contacts, kept: NDArray[np.int64], free: MotionCone, strict: Finding
) -> tuple[MotionCone, Finding]:
    """Return the answer to the collective question that a strictly jammed packing has."""
    # a motion in the fixed box is one of those that were excluded
    fixed = replace(motion_cone(packing, network, strain="none", kept_n=kept), wider=free)
    weight = None if strict.weight is None else strict.weight[: len(network) + fixed.link_rows]
    reason = f"strictly jammed, so collectively; {strict.reason}"
    return fixed, replace(strict, reason=reason, softest=np.nan, weight=weight, solves=(), implied=True)


def _nothing_held(cone: MotionCone) -> tuple[MotionCone, Finding]:
    """Return what is known where all particles rattle: not jammed, with a motion that opens what it can.

    Rattlers are found to within a small angle: contacts as good as opposite to one another may hold by forces as small.
    Where no motion opens contacts and closes none, nor leaves all as they are, nothing is claimed.
    """
    if cone.unknowns <= cone.dimension or not cone.rows.nnz:
        return cone, Finding(False, EMPTY)
    proof = None
    for name, tolerance in attempts(cone, "clarabel", 1e-8):
        proof = kept_open(cone, open_all(cone, solver=name, tolerance=tolerance).motion)
        if proof is not None and not closes_hardly(cone, proof):
            return cone, Finding(False, EMPTY, motion=proof)
        # where nothing can open
        if cone.is_floppy:
            return cone, Finding(False, EMPTY, motion=cone.softest()[1])
    return cone, Finding(None, HARDLY_HELD)


def carrying_contacts(
    packing: Packing, cone: MotionCone, network: Contacts, solver: str, tolerance: float
) -> Contacts | None:
    """Return the contacts that can carry force among particles that they hold together; None if no solver could tell.

    Particles may carry force and still turn freely, as three discs that fill a hole of a crystal: those that do not
    move with the largest group are left out.
    """
    for name in dict.fromkeys((solver, "highs")):
        opened = open_all(cone, solver=name, tolerance=tolerance)
        if opened.solve.outcome is Outcome.CONVERGED:
            return _held_together(packing, network.select(opened.carrying_c))
    # any of them may carry force: what motions that change none of them leave together is less, where rank is missing
    together = _held_together(packing, network)
    return together if len(together) < len(network) else None


def _held_together(packing: Packing, contacts: Contacts) -> Contacts:
    """Return those of the contacts that join particles of the largest group that they hold together."""
    if not len(contacts):
        return contacts
    apart = moving_apart(packing, contacts)
    return contacts.among(~apart)


def standing_contacts(cone: MotionCone, network: Contacts, finding: Finding) -> Contacts | None:
    """Return the contacts within the largest group of particles that a motion leaves standing to one another."""
    if finding.motion is None:
        return None
    d = cone.dimension
    displacement = finding.motion[: len(cone.kept_n) * d].reshape(-1, d)
    grain = 1e-3 * max(float(np.abs(displacement).max()), 1e-300)
    stays = np.zeros(network.particles, dtype=bool)
    stays[cone.kept_n] = _largest_group(displacement / grain)
    return network.among(stays)


def _largest_group(place_nd: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points lie in the fullest cell of unit size; cells are shifted too, so that no edge splits them."""
    best = np.zeros(len(place_nd), dtype=bool)
    for shift in itertools.product((0.0, 0.5), repeat=place_nd.shape[1]):
        _, group, size = np.unique(np.rint(place_nd + shift), axis=0, return_inverse=True, return_counts=True)
        if size.max() > np.count_nonzero(best):
            best = group.ravel() == int(np.argmax(size))
    return best
