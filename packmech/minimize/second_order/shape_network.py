"""What Newton's method needs of a soft packing of shapes, their turns among the unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.elements import elements_of, sum_ends
from packmech.contacts.network import Candidates
from packmech.contacts.shape_contacts import ShapeContacts, candidate_shapes, shape_contacts
from packmech.linalg.factor import factorize
from packmech.mechanics.assembly import assemble
from packmech.minimize.second_order.soft_network import REACH, Coupled, Response, SoftNetwork, energy_between
from packmech.packing import Packing
from packmech.shapes import Beads


class ShapeNetwork(SoftNetwork):
    """Contacts of a packing of shapes; `uphill_nd` is (N, q), slopes along positions and turns, measured in lengths."""

    contacts: ShapeContacts

    def search(self, packing: Packing) -> Candidates:
        """Return the pairs that touch or may soon."""
        shapes = packing.shapes
        assert shapes is not None
        # beads move by more than turns, measured in radii of gyration
        arm = float((shapes.reach(packing.radius_n) / shapes.gyration(packing.radius_n)).max())
        return candidate_shapes(packing, 1.0 + REACH, 2.0 * REACH * arm if isinstance(shapes, Beads) else 0.0)

    def near(self, packing: Packing) -> ShapeContacts:
        """Return the pairs of the list, touching or not, as they are in a packing."""
        return shape_contacts(packing, self.pairs)

    def energy_change(self, near: ShapeContacts) -> float:
        """Return the energy less that of the packing whose pairs of the list are given."""
        now = self.near(self.packing)
        sigma = near.contact_distance_c
        either = (near.distance_c < sigma) | (now.distance_c < sigma) | (self.width > 0.0)
        now, near = now.select(either), near.select(either)
        exact = now.distance_change(near)
        return energy_between(near.distance_c, now.distance_c, exact, sigma[either], self.first_at, self.width)

    def growth_to(self, other: Packing) -> float:
        """Return the enthalpy of a packing nearby, whose pairs are those of the list, less that of this one."""
        packing = self.packing
        near, self.packing = self.near(packing), other
        own = self.energy_change(near)
        self.packing = packing
        return own + self._pressing(packing.box, other.box.lattice_dd - packing.box.lattice_dd)

    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the energy's slopes along positions and turns, along strains, and the virial sum."""
        one, packing = self.contacts, self.packing
        self._turn_nkt = packing.turn_nkt
        pull = self.first_c[:, None] * one.slope_cx[:, : one.dimension]
        along = np.einsum("kab,ca,cb->k", self.basis_kdd, pull, one.vector_cd)
        return sum_ends(one, self.first_c), along, float((pull * one.vector_cd).sum())

    def largest_force(self) -> float:
        """Return the largest net force, or torque over the radius of gyration, on a particle."""
        d = self.packing.dimension
        square = self.uphill_nd**2
        return float(np.sqrt(max(square[:, :d].sum(axis=1).max(), square[:, d:].sum(axis=1).max())))

    def mean_contact_force(self) -> float:
        """Return the mean size of the contacts' forces; none where nothing touches."""
        return float((np.abs(self.first_c) * self.contacts.push_c).mean()) if len(self.contacts) else 0.0

    @property
    def largest_stiffness(self) -> float:
        """Largest stiffness of a contact along a particle's motion."""
        return float((self.second_c * self.contacts.push_c**2).max())

    def coupled(self, basis_kdd: NDArray[np.float64], regularization: float) -> Coupled:
        """Return the factored second derivatives by positions and turns, and those with the strains of a basis."""
        one, packing = self.contacts, self.packing
        curved = shape_contacts(packing, one.pairs, second=True)
        count, n, d, turn = one.count_n(), packing.particles, packing.dimension, self._turn_nkt
        found = assemble([elements_of(curved, self.first_c, self.second_c)], turn, d, basis_edd=basis_kdd)
        free = np.hstack([np.ones((n, d), dtype=bool), (turn != 0.0).any(axis=2)])
        free[int(np.argmax(count)), :d] = False
        extra = np.where(count == 0, 1.0, regularization)
        free_f, added = free.ravel(), np.repeat(extra, free.shape[1])
        factor = factorize(found.matrix(free_f, added), kind="symmetric")
        return Coupled(
            factor.solve, factor.inertia.negative, np.flatnonzero(free_f), found.column(free_f),
            found.corner_ee + self._bulging(basis_kdd),
        )  # fmt: skip

    def gradient_slopes(self) -> NDArray[np.float64]:
        """Return the (d, d) slopes of the energy along displacement gradients, which turn no particle."""
        one = self.contacts
        return np.asarray(np.einsum("c,ca,cb->ab", self.first_c, one.slope_cx[:, : one.dimension], one.vector_cd))

    def gap_rates(self, near: ShapeContacts, answer: Response) -> NDArray[np.float64]:
        """Return how fast the distances of pairs change in a response."""
        d, u_nd = near.dimension, answer.u_nd
        turned = np.einsum("nk,nkt->nt", u_nd[:, d:], self._turn_nkt)
        moved = u_nd[near.j_c, :d] - u_nd[near.i_c, :d] + near.vector_cd @ answer.gradient_dd.T
        whole = np.hstack([moved, turned[near.i_c], turned[near.j_c]])
        return np.asarray((near.slope_cx * whole).sum(axis=1))

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing after displacements, turns and strains, at the volume that is held."""
        packing = self.packing
        shapes, d = packing.shapes, packing.dimension
        assert shapes is not None
        turned = shapes.turned(np.einsum("nk,nkt->nt", u_nd[:, d:], shapes.turn_basis(packing.radius_n)))
        return super().moved(u_nd[:, :d], strain_k).replace(shapes=turned)
