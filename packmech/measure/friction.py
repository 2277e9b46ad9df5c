"""Tangential forces of contacts at rest: a scene's friction and the tangential displacements of its packing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.effects import friction_of
from packmech.links import named_rows
from packmech.scene import Scene


class TangentialForces(NamedTuple):
    """(C, d) tangential forces on particle i [force], and (C,) energies of their springs."""

    force_cd: NDArray[np.float64]
    energy_c: NDArray[np.float64]


def tangential_forces(
    scene: Scene, contacts: Contacts | ShapeContacts, normal_c: NDArray[np.float64]
) -> TangentialForces:
    """Return the tangential forces of the contacts, zeros without friction.

    Parameters
    ----------
    scene
        The scene.
    contacts
        Its touching pairs.
    normal_c
        (C,) normal forces, positive for repulsion [force].

    """
    count, d, friction = len(contacts), contacts.dimension, friction_of(scene.effects)
    springs = scene.packing.tangential
    if friction is None or springs is None:
        return TangentialForces(np.zeros((count, d)), np.zeros(count))
    displacement, normal = np.zeros((count, 1 if d == 2 else 3)), contacts.normal_cd
    known, asked = ((one.i_c, one.j_c, one.image_cd) for one in (contacts, springs))
    place = named_rows(known, asked, contacts.bead_c2, springs.bead_c2)
    displacement[place[place >= 0]] = springs.displacement_ck[place >= 0]
    if d == 3:
        displacement = _laid_across(displacement, normal)
    force = friction.stiffness * displacement
    size = np.sqrt((force**2).sum(axis=1))
    cap = friction.coefficient * np.abs(normal_c)
    force = force * np.where(size > cap, cap / np.maximum(size, 1e-300), 1.0)[:, None]
    if d == 2:
        force = np.stack([-normal[:, 1], normal[:, 0]], axis=1) * force
    # a spring that gave way holds what its force is worth
    stretch = np.minimum(size, cap) / friction.stiffness if friction.stiffness > 0.0 else np.zeros(count)
    return TangentialForces(force, 0.5 * friction.stiffness * stretch**2)


def _laid_across(displacement_c3: NDArray[np.float64], normal_c3: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the displacements laid into the contacts' tangent planes, as long as they were, as the engine does."""
    across = displacement_c3 - (displacement_c3 * normal_c3).sum(axis=1)[:, None] * normal_c3
    before, after = (np.sqrt((one**2).sum(axis=1)) for one in (displacement_c3, across))
    return np.asarray(across * np.divide(before, after, out=np.zeros_like(after), where=after > 0.0)[:, None])


def sum_both(
    contacts: Contacts | ShapeContacts, on_i: NDArray[np.float64], on_j: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (N, k) sums of what contacts do to their two particles."""
    total = np.empty((contacts.particles, on_i.shape[1]))
    for k in range(on_i.shape[1]):
        total[:, k] = np.bincount(contacts.i_c, on_i[:, k], contacts.particles)
        total[:, k] += np.bincount(contacts.j_c, on_j[:, k], contacts.particles)
    return total
