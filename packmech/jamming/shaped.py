"""The verdict on packings of ellipses, spheroids and rigid bodies: first order where it decides, else second order.

Contacts of convex shapes leave motions that change no distance to first order. Where contact forces in balance, all of
them positive, make every such motion cost energy (quartic modes of positive curvature), no motion opens all contacts:
the packing is prestress stable, which implies that it is rigid (Connelly and Whiteley, SIAM J. Discrete Math. 9, 453
(1996)). Where the only state of self stress lets one of them gain energy, the packing is not rigid to second order.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import BoxStrain
from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.effects import Harmonic, Repulsion, contact_terms
from packmech.jamming.backbone import EMPTY
from packmech.jamming.contact_selection import ContactSelection, GapLevel, RestCheck
from packmech.jamming.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, JammingAnswer, Verdict
from packmech.measure.contact_forces import force_balance
from packmech.mechanics.network import Network, contact_network
from packmech.mechanics.quartic import quartic_modes
from packmech.mechanics.self_stress import states_of_self_stress
from packmech.packing import Packing
from packmech.scene import Scene

# curvatures below this part of pressure times reference diameter^(d - 2) are none: what they belong to turns freely
_FLAT = 1e-6
# forces below this part of the mean are none
_CARRYING = 1e-6
# what of the law's forces may be out of balance, over the largest: more is a load on strains, not rounding
_BALANCED = 1e-3


def classify_shaped(
    packing: Packing, scene: Scene | None, *, strain: BoxStrain, gap_tolerance: float | None, rest_tolerance: float
) -> Verdict:
    """Return the verdict on a packing with shapes that turn; arguments as of `classify_jamming`."""
    began = time.process_time()
    known = scene is not None
    scene = Scene(packing, (Repulsion(Harmonic()),)) if scene is None else scene
    network = _carrying(contact_network(packing, gap_tolerance=gap_tolerance, second=False), scene)
    touching: Any = find_shape_contacts(packing, gap_tolerance=gap_tolerance)
    contacts: Any = network.contacts
    overlap = touching.overlap_c[touching.overlap_c > 0.0]
    mean = float(overlap.mean()) if len(overlap) else 0.0
    tolerance = 0.0 if gap_tolerance is None else gap_tolerance
    count, particles = len(network.contacts), len(network.index_n)
    fewest = int(network.free_nq.sum()) - packing.dimension + 1
    level = GapLevel(tolerance, count, particles, count - fewest if particles else 0)
    rule = "overlapping pairs, or all that touch where none do" if gap_tolerance is None else "given"
    selection = ContactSelection(touching, tolerance, mean, rule, (level,))
    largest, contact_force = force_balance(scene)
    residual = largest / contact_force if contact_force > 0.0 else 0.0
    law = f"{type(next(iter(scene.effects))).__name__}, {'known' if known else 'a harmonic law, assumed'}"
    rest = RestCheck(residual, 0.0, rest_tolerance, law)
    collectively, strictly = (_answer(scene, network, kind, rest, gap_tolerance) for kind in ("none", "isochoric"))
    if strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:
        collectively = replace(strictly, reason=f"strictly jammed, so collectively; {strictly.reason}")
    rattlers = np.ones(packing.particles, dtype=bool)
    rattlers[network.index_n] = False
    return Verdict(
        JAMMED if count else NOT_JAMMED,
        "contacts can balance force and torque on every backbone particle" if count else EMPTY,
        collectively,
        strictly,
        rattlers,
        contacts,
        selection,
        rest,
        "second order",
        "singular values and the Hessian",
        strain,
        time.process_time() - began,
        packing=packing,
    )


def _carrying(network: Network, scene: Scene) -> Network:
    """Return the network without contacts that bear nothing: bodies that turn freely come to rest against others."""
    one = network.contacts
    force = -contact_terms(scene.effects, one).first_c
    if not len(one) or not force.max() > 0.0:
        return network
    return replace(network, contacts=one.select(force > _CARRYING * float(force.mean())))


def _answer(
    scene: Scene, network: Network, strain: BoxStrain, rest: RestCheck, gap_tolerance: float | None
) -> JammingAnswer:
    """Return the answer to one question, and what it rests on."""
    if not len(network.contacts):
        return JammingAnswer(NOT_JAMMED, EMPTY, False, 0, 0, 0)
    states = states_of_self_stress(network.packing, strain, contacts=network.contacts, basis_limit=1e9)
    floppy = states.motions - states.trivial - states.rank
    force = _balanced(states.force_ck, network.contacts, scene, rest)
    first: bool | None = force is not None and floppy == 0
    if not states.certain:
        first = None

    def answer(verdict: str, reason: str) -> JammingAnswer:
        return JammingAnswer(
            verdict,
            reason,
            first,
            states.isostatic_contact_count,
            states.count,
            floppy,
            smallest_force=float(force.min()) if verdict == JAMMED and force is not None else np.nan,
            contact_force_c=force if verdict == JAMMED else None,
            balance=rest.residual,
        )

    if not rest.at_rest:
        reason = f"not at rest: the largest net force is {rest.residual:.1e} of the mean contact force"
        return answer(AMBIGUOUS, f"{reason}, above {rest.limit:.1e} (law: {rest.law})")
    if not states.certain:
        return answer(AMBIGUOUS, "the rank of the contacts' slopes depends on its tolerance")
    if not states.count:
        load = "" if strain == "none" else " with the stress of the box isotropic"
        reason = f"no contact forces are in balance{load}: some motion opens a contact and closes none"
        return answer(NOT_JAMMED, reason)
    if force is None:
        if states.count == 1:
            return answer(NOT_JAMMED, "the only state of self stress pulls at some contacts")
        return answer(AMBIGUOUS, "the contact forces are not in balance for all strains, and other states might be")
    if first:
        return answer(JAMMED, "to first order: positive forces in balance, and contacts that leave no motion")
    quartic = quartic_modes(scene, strain=strain, gap_tolerance=gap_tolerance)
    value = quartic.curvature_m
    scale = _FLAT * abs(quartic.pressure) * scene.packing.reference_diameter ** (scene.packing.dimension - 2)
    if len(value) and value[0] < -scale:
        falling = int((value < -scale).sum())
        reason = f"the contact forces drive {falling} of {floppy} motions that the contacts leave to first order"
        return answer(NOT_JAMMED if states.count == 1 else AMBIGUOUS, f"not stable to second order: {reason}")
    flat = int((value <= scale).sum())
    if flat:
        return answer(AMBIGUOUS, f"forces hold all but {flat} of {floppy} motions to second order")
    # what the contacts leave and forces need not hold are turns of single bodies
    held = len(value)
    free = floppy - held
    reason = f"to second order: the contact forces hold {held} motions that the contacts leave (quartic modes)"
    return answer(JAMMED, reason + (f"; {free} turns of single bodies are free" if free else ""))


def _balanced(
    force_ck: NDArray[np.float64] | None, contacts: Contacts | ShapeContacts, scene: Scene, rest: RestCheck
) -> NDArray[np.float64] | None:
    """Return positive contact forces of mean 1 in balance, the only ones or those of the law; None without."""
    if force_ck is None or not force_ck.shape[1]:
        return None
    if force_ck.shape[1] == 1:
        force = force_ck[:, 0] * np.sign(force_ck[:, 0].sum())
    else:
        own = -contact_terms(scene.effects, contacts).first_c
        force = force_ck @ (force_ck.T @ own)
        if np.abs(force - own).max() > max(_BALANCED, rest.limit) * float(np.abs(own).max(initial=0.0)):
            return None
    return force / force.mean() if force.min() > 0.0 else None
