"""The network of a hard packing of discs or spheres that shears: fixed by the distances of its contacts.

A hard packing with one state of self stress has as many contacts as unknowns (positions and volume), so at each shear
strain Newton's method on the distances gives it exactly. Where a pair closes there are two states of self stress, and
the one whose volume grows most along the strain (the dual of the linear program of the least volume) says which contact
opens instead. Where the force of a contact falls to zero nothing holds the packing along the motion that opens it: it
falls to the next hard packing, by the interior-point method that minimizes the volume.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.contacts.pairs import are_among, places_among
from packmech.jamming.hard_packing import (
    REACH,
    ContactSystem,
    HardPacking,
    HardState,
    bring_to_contact,
    contact_system,
    search_hard,
)
from packmech.jamming.room import AT_ONCE, make_room
from packmech.linalg.linear_programs import LinearProgram, solve_highs
from packmech.packing import Packing
from packmech.protocols.shearing.hard_path import TOUCH, HardNetwork, Rates, Vertex
from packmech.result import Outcome

# force that counts as none, over the mean
_NO_FORCE = 1e-7
# slack that a search begins with [diameter], and its largest number of iterations
_SLACK, _ITERATIONS = 1e-3, 400


class HardDiscs(HardNetwork):
    """The network of a hard packing of discs or spheres.

    Parameters
    ----------
    hard
        Where it starts, at strain zero; made with isotropic strain alone free.
    axes
        Direction of the flow and of its gradient.

    """

    ends, falls_by = "fold", "interior point"
    beyond = 1e-9

    def __init__(self, hard: HardPacking, axes: tuple[int, int]) -> None:
        super().__init__(hard.packing, axes)
        self._touch = TOUCH * 2.0 * float(hard.packing.radius_n.min())
        self.start = self._vertex(0.0, hard.packing, hard.contacts, hard.force_c, hard.gap_error)

    def _vertex(
        self, strain: float, packing: Packing, contacts: Contacts, force_c: NDArray[np.float64], gap_error: float
    ) -> Vertex:
        system = contact_system(contacts, self.isotropic_kdd)
        single = redundancy(contacts) <= 0
        force_c = system.balanced(force_c, np.ones_like(force_c) if single else np.maximum(force_c, 1e-300))
        imbalance, rates = system.imbalance(force_c), self._rates(system, contacts)
        self.factorizations += 2
        return Vertex(strain, packing, contacts, force_c, gap_error, imbalance, rates, self.near(packing))

    def _rates(self, system: ContactSystem, contacts: Contacts) -> Rates:
        """Return the motion that keeps all contacts closed while the box shears."""
        sheared = np.einsum("ca,ab,cb->c", contacts.normal_cd, self.shear_dd, contacts.vector_cd)
        system.prepare(np.ones(len(contacts)))
        u_nd, strain_k = np.zeros(system.shape), np.zeros(len(self.isotropic_kdd))
        for _ in range(2):
            left = sheared + system.extend(u_nd, strain_k)
            du_nd, dstrain_k = system.solve(system.gather(-left), -system.stretch_ck.T @ left)
            u_nd, strain_k = u_nd + du_nd, strain_k + dstrain_k
        gradient_dd = self.shear_dd + np.einsum("k,kab->ab", strain_k, self.isotropic_kdd)
        return Rates(u_nd * system.live_n[:, None], gradient_dd, np.zeros(len(contacts)))

    def at(self, start: Vertex, strain: float) -> Vertex | None:
        """Return what the network of a vertex gives at another strain, whatever its rattlers overlap; None without."""
        pairs = Candidates(start.contacts.i_c, start.contacts.j_c, start.contacts.image_cd)
        ahead = self.ahead(start, strain)
        packing, contacts, error = bring_to_contact(ahead, pairs, self.isotropic_kdd)
        self.factorizations += 4
        if error > self._touch or not self.is_as_led(start, ahead, packing, strain - start.strain):
            return None
        # the volume may have changed, its shape may not
        packing = packing.replace(box=self.lattice.box(strain, packing.box.volume))
        return self._vertex(strain, packing, contacts, start.force_c, error)

    def exchanged(self, vertex: Vertex, cause: str, direction: float) -> tuple[Vertex, Vertex] | None:
        """Return the vertex where pairs have just closed, with its own network and with that which goes on; or None.

        So it is where a network with redundant contacts ends, too.
        """
        if cause == "opening" or (cause == self.ends and redundancy(vertex.contacts) <= 0):
            return None
        packing, room, held = make_room(vertex.packing, vertex.near, ~vertex.live_n)
        near = self.near(packing)
        bearing, live = are_among(near, vertex.contacts), vertex.live_n
        closed = ~bearing & (np.abs(near.gap_c) < AT_ONCE * near.contact_distance_c)
        closed &= live[near.i_c] & live[near.j_c]
        if abs(room) < AT_ONCE:
            closed |= are_among(near, held)
        if not closed.any() and redundancy(vertex.contacts) <= 0:
            return None
        # where these touch exactly is a strain to solve for
        chosen = Candidates(*(part[bearing | closed] for part in (near.i_c, near.j_c, near.image_cd)))
        both = np.concatenate([self.isotropic_kdd, self.shear_dd[None]])
        packing, contacts, error = bring_to_contact(packing, chosen, both)
        if error > self._touch:
            return None
        relative = packing.box.lattice_dd @ np.linalg.inv(self.lattice.unsheared_dd)
        strain = float(relative[self.axes] / relative[self.axes[0], self.axes[0]])
        if abs(strain - vertex.strain) > 1e-9:
            return None
        packing = packing.replace(box=self.lattice.box(strain, packing.box.volume))
        force = self._forces_ahead(contacts, direction)
        if force is None:
            return None
        bears = force > _NO_FORCE * force.mean()
        kept = contacts.select(bears)
        count = kept.count_n() > 0
        if redundancy(kept) < 0:
            return None
        # rattlers that were near one that was squeezed have room without it
        packing, _, _ = make_room(packing, self.near(packing), ~count)
        after = self._vertex(strain, packing, kept, force[bears], error)
        if after.force_imbalance > 1e-9 or after.force_c.min() <= 0.0:
            return None
        own = contacts.select(are_among(contacts, vertex.contacts))
        return self._vertex(strain, packing, own, vertex.force_c, error), after

    def _forces_ahead(self, contacts: Contacts, direction: float) -> NDArray[np.float64] | None:
        """Return the forces in balance, pushing, under which the volume grows most along the strain."""
        n, d, count = contacts.particles, contacts.dimension, len(contacts)
        rows = np.concatenate([contacts.i_c, contacts.j_c])[:, None] * d + np.arange(d)
        columns = np.repeat(np.tile(np.arange(count), 2), d)
        value = np.concatenate([-contacts.normal_cd, contacts.normal_cd]).ravel()
        gather = sp.coo_array((value, (rows.ravel(), columns)), shape=(n * d, count)).tocsr()
        used = np.flatnonzero(np.repeat(contacts.count_n() > 0, d))
        # one particle's balance follows from that of all others
        equal = sp.csr_array(sp.vstack([gather[used[d:]], sp.csr_array(contacts.distance_c[None])]))
        equal_to = np.zeros(equal.shape[0])
        equal_to[-1] = float(n * d)
        flow, gradient = self.axes
        cost = math.copysign(1.0, direction) * contacts.normal_cd[:, flow] * contacts.vector_cd[:, gradient]
        program = LinearProgram(
            cost=cost, equal=equal, equal_to=equal_to, below=sp.csr_array((0, count)), below_to=np.zeros(0),
            lower=np.zeros(count), upper=np.full(count, np.inf), dimension=d,
        )  # fmt: skip
        solution = solve_highs(program, 1e-10)
        return solution.x if solution.solve.outcome is Outcome.CONVERGED else None

    def fallen(self, vertex: Vertex, strain: float) -> Vertex | None:
        """Return the hard packing that is found next at a strain beyond a vertex, by interior points; or None."""
        packing, step = vertex.packing, strain - vertex.strain
        ahead = packing.position_nd + step * (packing.position_nd @ self.shear_dd.T)
        packing = packing.replace(position_nd=ahead, box=self.lattice.box(strain, packing.box.volume))
        state = self._warm(packing, vertex)
        hard, iterations = search_hard(state, packing, self.isotropic_kdd, _ITERATIONS)
        self.factorizations += iterations
        if hard is None:
            return None
        place = hard.packing.replace(box=self.lattice.box(strain, hard.packing.box.volume))
        return self.with_room(self._vertex(strain, place, hard.contacts, hard.force_c, hard.gap_error))

    def _warm(self, packing: Packing, vertex: Vertex) -> HardState:
        """Return the state of an interior-point search that begins with the forces of a vertex."""
        pairs = candidate_pairs(
            packing.position_nd, packing.radius_n, packing.box, scale=1.0 + REACH[packing.dimension]
        )
        near = pair_contacts(packing, *pairs)
        slack = np.maximum(near.gap_c, _SLACK)
        barrier = _SLACK * float(vertex.force_c.mean())
        force = barrier / slack
        own = are_among(vertex.contacts, near)
        place = places_among(vertex.contacts.select(own), near)
        force[place] = np.maximum(vertex.force_c[own], force[place])
        violation = float((slack - near.gap_c).max(initial=0.0))
        return HardState(packing.position_nd, packing.box.lattice_dd, pairs, slack, force, barrier, violation)

    def relisted(self, vertex: Vertex, packing: Packing, pairs: Candidates, order: NDArray[np.int64]) -> Vertex:
        """Return a vertex whose packing and contacts, in another order, have other labels."""
        contacts = pair_contacts(packing, *pairs)
        return self._vertex(vertex.strain, packing, contacts, vertex.force_c[order], vertex.gap_error)


def redundancy(contacts: Contacts) -> int:
    """Return how many contacts there are beyond those of one state of self stress, with the volume free."""
    return len(contacts) - contacts.dimension * (int((contacts.count_n() > 0).sum()) - 1) - 1
