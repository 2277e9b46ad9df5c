"""Energies, forces and torques of particles with shapes: laws at the scaled distance, walls, potentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.elements import sum_slopes
from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.effects import (
    ContactTerms,
    ShapedTerms,
    acts_on_single,
    contact_terms,
    held_particles,
    refuse_unknown_to_shapes,
    shaped_terms,
    total_push,
)
from packmech.measure.bonds import BondedPairs, bonded_pairs, unbonded
from packmech.scene import Scene


@dataclass(frozen=True, eq=False)
class ShapeForces:
    """Touching pairs of shapes, and the energies and derivatives of their laws.

    With those of what acts on single particles, and the mask of held particles; None where neither is. Bonds act on
    the centers.
    """

    contacts: ShapeContacts
    terms: ContactTerms
    single: ShapedTerms | None = None
    held_n: NDArray[np.bool_] | None = None
    bonded: BondedPairs | None = None

    @property
    def energy(self) -> float:
        """The energy of all pairs, and of single particles."""
        pairs = float(np.add.reduce(self.terms.energy_c))
        if self.bonded is not None:
            pairs += float(np.add.reduce(self.bonded.terms.energy_c))
        return pairs if self.single is None else pairs + float(np.add.reduce(self.single.energy_n))

    def _net(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the net forces and torques, none on what is held."""
        d = self.contacts.dimension
        one = self.contacts
        # rotations in place of turns
        t = 1 if d == 2 else 3
        rotation_nkt = np.broadcast_to(np.eye(t), (one.particles, t, t))
        slope = sum_slopes(one.i_c, one.j_c, self.terms.first_c[:, None] * one.slope_cx, rotation_nkt, d)
        force, torque = -slope[:, :d], -slope[:, d:]
        if self.bonded is not None:
            force = force + self.bonded.forces()
        if self.single is not None:
            force = force - self.single.slope_nx[:, :d]
            torque = torque - self.single.slope_nx[:, d:]
        if self.held_n is not None:
            force[self.held_n] = 0.0
            torque[self.held_n] = 0.0
        return force, torque

    def forces(self) -> NDArray[np.float64]:
        """Return the (N, d) net forces."""
        return self._net()[0]

    def torques(self) -> NDArray[np.float64]:
        """Return the (N, 1) net torques in a plane, (N, 3) in space."""
        return self._net()[1]

    def stress(self, volume: float) -> NDArray[np.float64]:
        """Return the (d, d) stress, tension positive, row = force component; symmetric only where torques balance."""
        one = self.contacts
        pull = self.terms.first_c[:, None] * one.slope_cx[:, : one.dimension]
        virial = pull.T @ one.vector_cd
        if self.bonded is not None:
            virial += self.bonded.virial()
        return np.asarray(virial / volume)

    @property
    def force_c(self) -> NDArray[np.float64]:
        """The (C,) sizes of the contact forces."""
        return np.asarray(np.abs(self.terms.first_c) * self.contacts.push_c)

    def balance(self, turn_nkt: NDArray[np.float64]) -> tuple[float, float]:
        """Return the largest net force, or torque over radius of gyration, and the mean contact force.

        Forces on single particles that are free count with those of contacts.
        """
        size, count = float(self.force_c.sum()), len(self.contacts)
        if self.bonded is not None:
            size, count = size + float(np.abs(self.bonded.terms.first_c).sum()), count + len(self.bonded.pairs)
        if self.single is not None:
            push, pushes = total_push(self.single, self.held_n)
            size, count = size + push, count + pushes
        if not count:
            return 0.0, 0.0
        force, torque = self._net()
        turning = np.einsum("nkt,nt->nk", turn_nkt, torque)
        largest = max(float((force**2).sum(axis=1).max()), float((turning**2).sum(axis=1).max()))
        return float(np.sqrt(largest)), size / count


def check_pairs_only(scene: Scene) -> None:
    """Refuse effects that are none of pairs of particles and their distance.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    refuse_unknown_to_shapes(scene, single=False)


def shape_forces(scene: Scene) -> ShapeForces:
    """Return the touching pairs of a scene whose packing has shapes, and what presses them.

    Raises
    ------
    ValueError
        If an effect would take shapes for discs or spheres, or two centers coincide.

    """
    refuse_unknown_to_shapes(scene)
    packing, effects = scene.packing, scene.effects
    contacts = find_shape_contacts(packing)
    contacts = unbonded(contacts.select(contacts.gap_c < 0.0), effects)
    terms = contact_terms(effects, contacts.distance_c, contacts.contact_distance_c)
    single, held = None, None
    if acts_on_single(effects):
        single, held = shaped_terms(effects, packing), held_particles(effects, packing.particles)
    return ShapeForces(contacts, terms, single, held, bonded_pairs(effects, packing))
