"""The figures of a finished jamming run, recomputed from its packing."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts import Contacts, crossing_links, find_contacts
from packmech.contacts.rattlers import rattlers_of
from packmech.effects import contact_terms
from packmech.measure import packing_fraction, stress_tensor, sum_forces
from packmech.mechanics.rattling import find_rattling_clusters
from packmech.mechanics.self_stress import states_of_self_stress
from packmech.packing import Packing
from packmech.protocols.protocol import Protocol
from packmech.result import Outcome, Run


def backbone_contacts(contacts: Contacts) -> Contacts:
    """Return the contacts between particles that are not rattlers.

    Parameters
    ----------
    contacts
        The touching pairs.

    """
    loose = rattlers_of(contacts)
    return contacts.select(~(loose[contacts.i_c] | loose[contacts.j_c]))


def contact_count(contacts: Contacts, strains: int) -> dict[str, int]:
    """Return N', rattlers, contacts between the N', and the isostatic number d N' - d + k for k free strains.

    Parameters
    ----------
    contacts
        The touching pairs.
    strains
        How many strains are free, the volume among them.

    """
    loose = rattlers_of(contacts)
    kept = int((~loose).sum())
    number = int((~(loose[contacts.i_c] | loose[contacts.j_c])).sum())
    isostatic = contacts.dimension * (kept - 1) + strains if kept else 0
    return {
        "particles": contacts.particles,
        "rattlers": contacts.particles - kept,
        "contacts": number,
        "isostatic_contacts": isostatic,
        "excess_contacts": number - isostatic,
    }


def linked_count(packing: Packing, contacts: Contacts, strain: str) -> dict[str, int]:
    """Return rattling particles, contacts of the backbone, and the counts of section 12 of the specification.

    The isostatic number is that of one state of self stress, N_dof - d + 1, where N_dof leaves out clusters that rattle
    as a whole; free turns and loose ends of clusters that are held, `floppy_modes`, take as many contacts off.

    Parameters
    ----------
    packing
        The packing, with links.
    contacts
        Its touching pairs.
    strain
        "isotropic" or "free".

    """
    rattling = find_rattling_clusters(packing, contacts=contacts)
    none = {"particles": packing.particles, "rattlers": int(rattling.rattling_n.sum())}
    if rattling.empty:
        return {**none, "contacts": 0, "isostatic_contacts": 0, "excess_contacts": 0, "states_of_self_stress": 0}
    held = ~rattling.loose_n
    number = np.where(held, np.cumsum(held) - 1, -1)
    links = packing.links
    assert links is not None
    # links may all be between particles that rattle
    kept = links.numbered(number) if (held[links.i_l] & held[links.j_l]).any() else None
    part = packing.replace(position_nd=packing.position_nd[held], radius_n=packing.radius_n[held], links=kept)
    bearing = contacts.select(rattling.backbone_c)
    inner = replace(bearing, i_c=number[bearing.i_c], j_c=number[bearing.j_c], particles=int(held.sum()))
    states = states_of_self_stress(
        part, "none" if strain == "isotropic" else "isochoric", contacts=inner, basis_limit=1.0
    )
    floppy = states.motions - states.trivial - states.rank
    isostatic = states.isostatic_contact_count - floppy
    return {
        **none,
        "contacts": len(inner),
        "isostatic_contacts": isostatic,
        "excess_contacts": len(inner) - isostatic,
        "floppy_modes": floppy,
        "states_of_self_stress": states.count,
    }


def locked_links(packing: Packing) -> dict[str, Any]:
    """Return the pairs of links that cross, in two dimensions: they are locked, and press whatever the pressure is."""
    if packing.links is None or packing.dimension != 2:
        return {}
    try:
        found = crossing_links(packing)
    except ValueError:
        # links much longer than the box pass over more images than can be listed
        return {"crossing_links": None}
    return {"crossing_links": tuple(sorted(set(zip(found.first_c.tolist(), found.second_c.tolist(), strict=True))))}


def finish(
    protocol: Protocol, packing: Packing, outcome: Outcome, asked: float | None, method: str, began: float
) -> Run:
    """Return the run of a protocol that ended with the packing.

    Parameters
    ----------
    protocol
        The protocol.
    packing, outcome
        The packing it ended with, and how.
    asked
        The pressure asked for [energy_scale / diameter^d]; None where none was.
    method
        Its name.
    began
        CPU time of the start [s].

    """
    scene = protocol.scene.replace(packing=packing)
    contacts = find_contacts(packing)
    first_c = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c).first_c
    stress = stress_tensor(scene)
    d = packing.dimension
    pressure = (0.0 - float(np.trace(stress))) / d
    residual = 0.0
    # forces that are no more than rounding have no balance
    if first_c.any() and outcome is not Outcome.UNJAMMED:
        net = sum_forces(contacts, -first_c)
        if packing.links is not None:
            net, _, _ = ConstraintFactor(packing, workable_links(packing)).project(net)
        residual = float(np.sqrt((net**2).sum(axis=1)).max() / np.abs(first_c).mean())
    report: dict[str, Any] = {
        "method": method,
        "strain": protocol.strain,
        "packing_fraction": packing_fraction(packing),
        "pressure": pressure / scene.pressure_unit,
        "pressure_asked": asked,
        **(
            contact_count(contacts, len(protocol.basis_kdd))
            if packing.links is None
            else linked_count(packing, contacts, protocol.strain)
        ),
        "stress_anisotropy": float(np.abs(stress + pressure * np.eye(d)).max() / abs(pressure)) if pressure else 0.0,
        "patches": (),
        **locked_links(packing),
        **protocol.report,
    }
    if packing.links is None:
        carried = report["contacts"] > 0
        free = report.get("floppy_modes", 0)
        report["states_of_self_stress"] = report["excess_contacts"] + 1 + free if carried else 0
    return Run(
        packing=packing,
        outcome=outcome,
        residual=residual,
        steps=sum(stage.steps for stage in protocol.stages),
        force_evaluations=sum(stage.force_evaluations for stage in protocol.stages),
        seconds=time.process_time() - began,
        build_seconds=protocol.build_seconds,
        stages=tuple(protocol.stages),
        report=report,
    )
