"""Energies, forces and torques of touching ellipses and spheroids: laws at the scaled distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import candidate_pairs
from packmech.contacts.scaled_contact import scaled_contacts
from packmech.effects import contact_terms
from packmech.scene import Scene


@dataclass(frozen=True, eq=False)
class ShapedContacts:
    """Touching pairs of shapes: their energies, and the energies' slopes along r from i to j and turns of i and j.

    Laws are taken at rho = s (r_i + r_j), s the scale at which the two touch, with the contact distance r_i + r_j.
    """

    particles: int
    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    vector_cd: NDArray[np.float64]
    energy_c: NDArray[np.float64]
    slope_cd: NDArray[np.float64]
    turn_i_ck: NDArray[np.float64]
    turn_j_ck: NDArray[np.float64]

    def forces(self) -> NDArray[np.float64]:
        """Return the (N, d) net forces."""
        return self._sum(self.slope_cd, -self.slope_cd)

    def torques(self) -> NDArray[np.float64]:
        """Return the (N, 1) net torques in a plane, (N, 3) in space."""
        return self._sum(-self.turn_i_ck, -self.turn_j_ck)

    def stress(self, volume: float) -> NDArray[np.float64]:
        """Return the (d, d) stress, tension positive, row = force component; symmetric only where torques balance."""
        return np.asarray(self.slope_cd.T @ self.vector_cd / volume)

    def _sum(self, on_i_ck: NDArray[np.float64], on_j_ck: NDArray[np.float64]) -> NDArray[np.float64]:
        net = np.empty((self.particles, on_i_ck.shape[1]))
        for k in range(on_i_ck.shape[1]):
            net[:, k] = np.bincount(self.i_c, on_i_ck[:, k], self.particles)
            net[:, k] += np.bincount(self.j_c, on_j_ck[:, k], self.particles)
        return net


def shaped_contacts(scene: Scene) -> ShapedContacts:
    """Return the touching pairs of a scene whose packing has shapes.

    Raises
    ------
    ValueError
        If an effect is none of pairs of particles and their distance, or two centers coincide.

    """
    packing = scene.packing
    shapes = packing.shapes
    assert shapes is not None
    for k, one in enumerate(scene.effects):
        if any(hasattr(type(one), hook) for hook in ("body_energy", "tangential_force")) or hasattr(one, "particles"):
            kind = type(one).__qualname__
            raise ValueError(
                f"scene.effects must hold no {kind} for {type(shapes).__name__}, which it would take for discs or "
                f"spheres, got it at {k}: leave it out with scene.without(pm.{kind})"
            )
    d = packing.dimension
    along, across = shapes.semi_axes(packing.radius_n)
    pairs = candidate_pairs(packing.position_nd, np.maximum(along, across), packing.box)
    i, j = pairs.i_c, pairs.j_c
    vector = packing.position_nd[j] - packing.position_nd[i] + pairs.image_cd @ packing.box.lattice_dd.T
    same = ~vector.any(axis=1)
    if same.any():
        c = int(np.argmax(same))
        raise ValueError(f"packing must have no coincident centers, got particles {i[c]} and {j[c]} at one place")

    def both(array: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([array[i], array[j]], axis=1)

    found = scaled_contacts(vector, both(packing.radius_n), both(shapes.aspect_n), both(shapes.director_nd))
    touching = found.scale_p < 1.0
    sigma = (packing.radius_n[i] + packing.radius_n[j])[touching]
    terms = contact_terms(scene.effects, found.scale_p[touching] * sigma, sigma)
    slope = found.first_px[touching] * (terms.first_c * sigma)[:, None]
    turns = 1 if d == 2 else 3
    return ShapedContacts(
        packing.particles,
        i[touching],
        j[touching],
        vector[touching],
        terms.energy_c,
        slope[:, :d],
        slope[:, d : d + turns],
        slope[:, d + turns :],
    )
