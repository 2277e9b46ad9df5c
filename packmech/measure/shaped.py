"""Energies, forces and torques of touching ellipses and spheroids: laws at the scaled distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.effects import ContactTerms, contact_terms
from packmech.scene import Scene


@dataclass(frozen=True, eq=False)
class ShapeForces:
    """Touching pairs of shapes, and the energies and derivatives of their laws."""

    contacts: ShapeContacts
    terms: ContactTerms

    def forces(self) -> NDArray[np.float64]:
        """Return the (N, d) net forces."""
        return -self.contacts.gather(self.terms.first_c)[0]

    def torques(self) -> NDArray[np.float64]:
        """Return the (N, 1) net torques in a plane, (N, 3) in space."""
        return -self.contacts.gather(self.terms.first_c)[1]

    def stress(self, volume: float) -> NDArray[np.float64]:
        """Return the (d, d) stress, tension positive, row = force component; symmetric only where torques balance."""
        one = self.contacts
        pull = self.terms.first_c[:, None] * one.slope_cx[:, : one.dimension]
        return np.asarray(pull.T @ one.vector_cd / volume)

    @property
    def force_c(self) -> NDArray[np.float64]:
        """The (C,) sizes of the contact forces."""
        return np.asarray(np.abs(self.terms.first_c) * self.contacts.push_c)

    def balance(self, turn_nkt: NDArray[np.float64]) -> tuple[float, float]:
        """Return the largest net force, or torque over radius of gyration, and the mean contact force."""
        if not len(self.contacts):
            return 0.0, 0.0
        force, torque = self.contacts.gather(self.terms.first_c)
        turning = np.einsum("nkt,nt->nk", turn_nkt, torque)
        largest = max(float((force**2).sum(axis=1).max()), float((turning**2).sum(axis=1).max()))
        return float(np.sqrt(largest)), float(self.force_c.mean())


def check_pairs_only(scene: Scene) -> None:
    """Refuse effects that are none of pairs of particles and their distance.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    shapes = scene.packing.shapes
    for k, one in enumerate(scene.effects):
        if any(hasattr(type(one), hook) for hook in ("body_energy", "tangential_force")) or hasattr(one, "particles"):
            kind = type(one).__qualname__
            raise ValueError(
                f"scene.effects must hold no {kind} for {type(shapes).__name__}, which it would take for discs or "
                f"spheres, got it at {k}: leave it out with scene.without(pm.{kind})"
            )


def shape_forces(scene: Scene) -> ShapeForces:
    """Return the touching pairs of a scene whose packing has shapes, and what presses them.

    Raises
    ------
    ValueError
        If an effect is none of pairs of particles and their distance, or two centers coincide.

    """
    check_pairs_only(scene)
    contacts = find_shape_contacts(scene.packing)
    contacts = contacts.select(contacts.gap_c < 0.0)
    return ShapeForces(contacts, contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c))
