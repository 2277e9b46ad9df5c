"""A hard packing followed while its box shears: along its contact network, and across the changes between networks.

A hard packing with one state of self stress has as many contacts as unknowns (positions and volume), so at each shear
strain Newton's method on the distances gives it exactly. The network lasts until

- a pair that did not touch closes: at that strain there are two states of self stress, and the one whose volume grows
  most along the strain (the dual of the linear program of the least volume) says which contact opens instead. Volume
  and positions are continuous, their slopes are not;
- the force of a contact falls to zero: nothing holds the packing any more along the motion that opens the contact. It
  falls to the next hard packing, by the interior-point method that minimizes the volume: packing fraction jumps up.

Rattlers are kept apart from what surrounds them, by linear programs for the largest smallest gap over all pairs that
these can bring together; one that is squeezed closes d + 1 contacts at once. Families of sheared packings: Schreck and
O'Hern, section 2.2 of their chapter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import brentq

from packmech.box import Box
from packmech.contacts.elements import end_slopes
from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.contacts.overlaps import HARD
from packmech.contacts.shape_contacts import ShapeContacts, candidate_shapes, shape_contacts
from packmech.jamming.hard_packing import (
    REACH,
    ContactSystem,
    HardPacking,
    HardState,
    bring_to_contact,
    certify,
    clusters,
    contact_system,
    densify,
    kicked,
    start_state,
)
from packmech.jamming.sheared_lattice import ShearedLattice
from packmech.linalg.linear_programs import LinearProgram, solve_highs
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.shapes import Beads

# contacts touch to this, below what hard particles may overlap by, and pairs that close at one strain are as near
# [contact distance]
_TOUCH = 0.5 * HARD
_AT_ONCE = 1e-9
# pairs are looked at within this reach beyond contact
_NEAR = 0.1
# room that is enough for a rattler, trust radius of its programs, and their number [diameter]
_ROOM, _TRUST, _PROGRAMS = 1e-3, 0.1, 30
# trust radius at which other shapes have straight distances
_STRAIGHT = 1e-7
# force that counts as none, over the mean
_NO_FORCE = 1e-7
# strain beyond an opening at which the next packing is looked for, and slack that it begins with [diameter]
_BEYOND, _SLACK = 1e-9, 1e-3
_BARRIERS = (1e-12, 1e-13, 1e-14)
_KICKS, _ITERATIONS = 3, 400
# the network's equations have several solutions: what is found must be this near where the rates lead, over the way
_CORRECTED, _ROUNDED = 0.25, 1e-9
# the shortest step of strain that is tried
_SHORTEST = 1e-9


class Rates(NamedTuple):
    """How positions, beyond those that strain takes along, and free strains change with the shear strain."""

    u_nd: NDArray[np.float64]
    strain_k: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Vertex:
    """An exact hard packing at a shear strain.

    Attributes
    ----------
    strain
        The shear strain since the start.
    packing
        The packing, in units of the mean diameter, as it moves on from the start.
    contacts, force_c
        The force-bearing contacts and their forces, whose sum of force * distance is N d.
    gap_error, force_imbalance
        Largest gap or overlap of a contact [mean diameter], and largest net force over the mean.
    rates
        How it moves on with the strain.

    """

    strain: float
    packing: Packing
    contacts: Contacts
    force_c: NDArray[np.float64]
    gap_error: float
    force_imbalance: float
    rates: Rates

    @property
    def live_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that bear forces."""
        return np.asarray(self.contacts.count_n() > 0)

    def stress_ratio(self, axes: tuple[int, int]) -> float:
        """Return shear stress over pressure, stress with tension positive: d ln(volume) / d(strain)."""
        one, (flow, gradient) = self.contacts, axes
        moment = float((self.force_c * one.normal_cd[:, flow] * one.vector_cd[:, gradient]).sum())
        return -one.dimension * moment / float((self.force_c * one.distance_c).sum())


@dataclass(frozen=True, eq=False)
class Change:
    """One change of the contact network.

    Attributes
    ----------
    before, after
        The packings on both sides.
    cause
        "closing": a contact closed, "squeezing": a rattler was, "opening": the force of a contact fell to zero,
        "fold": the network ends for another reason.
    moved
        Largest displacement of a particle that bears forces in both packings, beyond the mean one [mean diameter].
    identities
        Pairs (i, j, image) that bear forces before and after, images those of the start.

    """

    before: Vertex
    after: Vertex
    cause: str
    moved: float
    identities: tuple[frozenset[tuple[int, ...]], frozenset[tuple[int, ...]]]

    @property
    def jumps(self) -> bool:
        """Whether it fell to another packing, and not only exchanged contacts where it stands."""
        return self.after.strain != self.before.strain


class Lost(Exception):  # noqa: N818 - the caller decides what to make of it
    """Raised where no hard packing is found any more."""


class _Trial(NamedTuple):
    """What the network gives at a strain: the vertex, its smallest margin, and what that is a margin of."""

    vertex: Vertex | None
    margin: float
    cause: str


class HardPath:
    """A hard packing on its way along a shear strain.

    Parameters
    ----------
    hard
        Where it starts, at strain zero; made with isotropic strain alone free.
    axes
        Direction of the flow and of its gradient.

    """

    def __init__(self, hard: HardPacking, axes: tuple[int, int]) -> None:
        d = hard.packing.dimension
        self.axes = axes
        self.lattice = ShearedLattice(hard.packing, axes)
        self.shear_dd = self.lattice.shear_dd
        self.isotropic_kdd = np.eye(d)[None] / math.sqrt(d)
        self.radius_n = hard.packing.radius_n
        self._touch = _TOUCH * 2.0 * float(self.radius_n.min())
        self.factorizations = 0
        # how far is looked ahead in strain: about twice the way between changes
        self._stride = math.inf
        self.vertex = self._vertex(0.0, hard.packing, hard.contacts, hard.force_c, hard.gap_error)

    # what a network is at a strain

    def _vertex(
        self, strain: float, packing: Packing, contacts: Contacts, force_c: NDArray[np.float64], gap_error: float
    ) -> Vertex:
        system = contact_system(contacts, self.isotropic_kdd)
        redundant = redundancy(contacts)
        force_c = system.balanced(force_c, np.ones_like(force_c) if redundant <= 0 else np.maximum(force_c, 1e-300))
        imbalance = system.imbalance(force_c)
        rates = self._rates(system, contacts)
        self.factorizations += 2
        return Vertex(strain, packing, contacts, force_c, gap_error, imbalance, rates)

    def _rates(self, system: ContactSystem, contacts: Contacts) -> Rates:
        """Return the motion that keeps all contacts closed while the box shears."""
        sheared = np.einsum("ca,ab,cb->c", contacts.normal_cd, self.shear_dd, contacts.vector_cd)
        system.prepare(np.ones(len(contacts)))
        u_nd, strain_k = np.zeros(system.shape), np.zeros(len(self.isotropic_kdd))
        for _ in range(2):
            left = sheared + system.extend(u_nd, strain_k)
            du_nd, dstrain_k = system.solve(system.gather(-left), -system.stretch_ck.T @ left)
            u_nd, strain_k = u_nd + du_nd, strain_k + dstrain_k
        return Rates(u_nd * system.live_n[:, None], strain_k)

    def _lattice(self, strain: float, like: Packing) -> Box:
        """Return the box of the shape that belongs to a strain, at the volume of a packing."""
        return self.lattice.box(strain, like.box.volume)

    def _ahead(self, start: Vertex, strain: float) -> Packing:
        """Return the packing at another strain, along the rates."""
        step, packing = strain - start.strain, start.packing
        grown = np.einsum("k,kab->ab", start.rates.strain_k, self.isotropic_kdd)
        size = 1.0 + step * float(np.trace(grown)) / packing.dimension
        position = packing.position_nd + step * (packing.position_nd @ self.shear_dd.T + start.rates.u_nd)
        packing = packing.replace(position_nd=position * size, box=packing.box.scaled(size))
        return packing.replace(box=self._lattice(strain, packing))

    def _length(self, start: Vertex, strain: float) -> float:
        """Return how far the rates take particles that bear forces, or the strain its own diameter."""
        fastest = float(np.abs(start.rates.u_nd).max())
        return abs(strain - start.strain) * max(fastest, 1.0)

    def _key(self, pairs: Candidates | Contacts) -> NDArray[np.int64]:
        """Return a number for each pair and its image."""
        key = np.asarray(pairs.i_c * len(self.radius_n) + pairs.j_c)
        for column in pairs.image_cd.T:
            key = key * 401 + column + 200
        return key

    def identity(self, contacts: Contacts | ShapeContacts) -> frozenset[tuple[int, ...]]:
        """Return the pairs (i, j, image), with the images that they had in the box and the cell of the start."""
        return self.lattice.identity(contacts, contacts.i_c, contacts.j_c)

    def _try(self, start: Vertex, strain: float) -> _Trial:
        """Return what the network of a vertex gives at another strain, rattlers apart where it still holds there."""
        trial = self._network_at(start, strain)
        return trial if trial.vertex is None or trial.margin <= -_TOUCH else self._with_room(trial)

    def _network_at(self, start: Vertex, strain: float) -> _Trial:
        """Return what the network of a vertex gives at another strain, rattlers left out; nothing where none is found.

        A network that cannot be brought there is gone before.
        """
        pairs = Candidates(start.contacts.i_c, start.contacts.j_c, start.contacts.image_cd)
        ahead = self._ahead(start, strain)
        packing, contacts, error = bring_to_contact(ahead, pairs, self.isotropic_kdd)
        self.factorizations += 4
        corrected = float(np.abs(packing.position_nd - ahead.position_nd)[start.live_n].max())
        if error > self._touch or corrected > _CORRECTED * self._length(start, strain) + _ROUNDED:
            return _Trial(None, -math.inf, "fold")
        # the volume may have changed, its shape may not
        packing = packing.replace(box=self._lattice(strain, packing))
        vertex = self._vertex(strain, packing, contacts, start.force_c, error)
        near, live = self._near(packing), vertex.live_n
        bearing = np.isin(self._key(near), self._key(contacts))
        both = live[near.i_c] & live[near.j_c] & ~bearing
        closing = float((near.gap_c / near.contact_distance_c)[both].min(initial=_NEAR))
        opening = float(vertex.force_c.min() / vertex.force_c.mean())
        return _Trial(vertex, *min((closing, "closing"), (opening, "opening")))

    def _with_room(self, trial: _Trial) -> _Trial:
        """Return the trial with its rattlers as far apart as they can be."""
        vertex = trial.vertex
        assert vertex is not None
        packing, squeezing, _ = make_room(vertex.packing, self._near(vertex.packing), ~vertex.live_n)
        margin, cause = min((trial.margin, trial.cause), (squeezing, "squeezing"))
        return _Trial(replace(vertex, packing=packing), margin, cause)

    def _near(self, packing: Packing) -> Contacts:
        pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 + _NEAR)
        return pair_contacts(packing, *pairs)

    # from vertex to vertex

    def go(self, strain: float) -> tuple[Vertex, Change | None]:
        """Go on towards a strain; return the vertex there, or that of the first change on the way, and the change."""
        start = self.vertex
        goal = strain
        direction = math.copysign(1.0, strain - start.strain)
        if self._stride < abs(strain - start.strain):
            goal = start.strain + direction * self._stride
        while True:
            trial = self._try(start, goal)
            if trial.vertex is not None and trial.margin > -_TOUCH and not self._dips(start, trial.vertex):
                self.vertex = self._relabeled(trial.vertex)
                if goal == strain:
                    return self.vertex, None
                self._stride *= 3.0
                return self.go(strain)
            if trial.vertex is not None and trial.margin <= -_TOUCH:
                change = self._change(start, trial)
                if change is not None:
                    way = abs(change.before.strain - start.strain)
                    self._stride = max(min(0.5 * self._stride, 4.0 * way) + way, _SHORTEST)
                    self.vertex = self._relabeled(change.after)
                    return self.vertex, change
            if abs(goal - start.strain) < _SHORTEST:
                # equal particles close more contacts than may stay so: those that bear forces from here on
                exchanged = self._exchange(start, strain - start.strain) if redundancy(start.contacts) > 0 else None
                if exchanged is not None:
                    change = self._noted(*exchanged, "opening", 0.0)
                    self.vertex = self._relabeled(change.after)
                    return self.vertex, change
                return self.fall(direction, trial.cause if trial.vertex else "fold")
            goal = 0.5 * (start.strain + goal)

    def fall(self, direction: float, cause: str, beyond: float = _BEYOND) -> tuple[Vertex, Change]:
        """Give the network up: go to the hard packing that is found next, whatever contacts it takes; and the change.

        Parameters
        ----------
        direction
            Sign of the strain to come.
        cause
            Why it falls.
        beyond
            How much farther in strain the next packing is looked for.

        Raises
        ------
        Lost
            If none is found.

        """
        change = self._fall(self.vertex, cause, direction, beyond)
        self.vertex = self._relabeled(change.after)
        return self.vertex, change

    def _dips(self, start: Vertex, end: Vertex) -> bool:
        """Return whether a pair closes and opens again between two vertices, by cubics through gaps and their rates."""
        near = self._near(start.packing)
        size = near.contact_distance_c
        first, then = self._gap_rates(start, near)
        there = pair_contacts(end.packing, near.i_c, near.j_c, near.image_cd)
        last, later = self._gap_rates(end, there)
        step = end.strain - start.strain
        both = start.live_n[near.i_c] & start.live_n[near.j_c]
        return dips(
            first[both] / size[both], then[both] / size[both], last[both] / size[both], later[both] / size[both], step
        )

    def _gap_rates(self, vertex: Vertex, near: Contacts) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        rates = vertex.rates
        grown = self.shear_dd + np.einsum("k,kab->ab", rates.strain_k, self.isotropic_kdd)
        change = rates.u_nd[near.j_c] - rates.u_nd[near.i_c] + near.vector_cd @ grown.T
        return near.gap_c, np.einsum("ca,ca->c", near.normal_cd, change)

    def _change(self, start: Vertex, beyond: _Trial) -> Change | None:
        """Return the first change between a vertex and a strain at which its network is none any more.

        None where a rattler that is squeezed at the farther strain is not on the way there: in so long a step it was
        led elsewhere.
        """
        assert beyond.vertex is not None
        there = beyond
        if there.cause != "squeezing":
            # programs for rattlers cost more than the network: they are asked once it is known where that ends
            there = self._root(start, there, self._network_at)
            if there.vertex is not None:
                there = self._with_room(there)
        if there.cause == "squeezing" and there.margin <= -_TOUCH:
            there = self._root(start, there, self._try)
        direction = beyond.vertex.strain - start.strain
        if there.vertex is None:
            return self._fall(start, "fold", direction)
        if there.cause == "squeezing" and abs(there.margin) > _AT_ONCE:
            return None
        if there.cause == "opening" or there.vertex.strain == start.strain:
            return self._fall(there.vertex, there.cause, direction)
        exchanged = self._exchange(there.vertex, direction)
        if exchanged is None:
            return self._fall(there.vertex, there.cause, direction)
        before, after = exchanged
        return self._noted(before, after, there.cause, 0.0)

    def _root(self, start: Vertex, beyond: _Trial, look: Callable[[Vertex, float], _Trial]) -> _Trial:
        """Return what is seen where the margin vanishes between a vertex and a strain at which it is negative."""
        assert beyond.vertex is not None
        found: dict[float, _Trial] = {beyond.vertex.strain: beyond}

        def margin(strain: float) -> float:
            if strain == start.strain:
                # a contact that has just been given up is still closed
                return _TOUCH
            if strain not in found:
                found[strain] = look(start, strain)
            return max(found[strain].margin, -1.0) + _TOUCH

        least = 4.0 * np.finfo(float).eps
        root = brentq(margin, start.strain, beyond.vertex.strain, xtol=1e-15, rtol=least, maxiter=200)
        trials = [one for strain, one in found.items() if one.vertex is not None and abs(strain - root) < 1e-11]
        return min(trials, key=lambda one: abs(one.margin + _TOUCH)) if trials else look(start, root)

    def _noted(self, before: Vertex, after: Vertex, cause: str, moved: float) -> Change:
        return Change(before, after, cause, moved, (self.identity(before.contacts), self.identity(after.contacts)))

    def _exchange(self, vertex: Vertex, direction: float) -> tuple[Vertex, Vertex] | None:
        """Return the vertex where pairs have just closed, with its own network and with that which goes on."""
        live = vertex.live_n
        packing, room, held = make_room(vertex.packing, self._near(vertex.packing), ~live)
        near = self._near(packing)
        bearing = np.isin(self._key(near), self._key(vertex.contacts))
        closed = ~bearing & (np.abs(near.gap_c) < _AT_ONCE * near.contact_distance_c)
        closed &= live[near.i_c] & live[near.j_c]
        if abs(room) < _AT_ONCE:
            closed |= np.isin(self._key(near), self._key(held))
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
        packing = packing.replace(box=self._lattice(strain, packing))
        force = self._forces_ahead(contacts, direction)
        if force is None:
            return None
        bears = force > _NO_FORCE * force.mean()
        kept = contacts.select(bears)
        count = kept.count_n() > 0
        if len(kept) < contacts.dimension * (int(count.sum()) - 1) + 1:
            return None
        # rattlers that were near one that was squeezed have room without it
        packing, _, _ = make_room(packing, self._near(packing), ~count)
        after = self._vertex(strain, packing, kept, force[bears], error)
        if after.force_imbalance > 1e-9 or after.force_c.min() <= 0.0:
            return None
        own = np.isin(self._key(contacts), self._key(vertex.contacts))
        before = self._vertex(strain, packing, contacts.select(own), vertex.force_c, error)
        return before, after

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

    def _fall(self, vertex: Vertex, cause: str, direction: float, beyond: float = _BEYOND) -> Change:
        """Return the change to the hard packing nearby, where the network holds the packing no more.

        Raises
        ------
        Lost
            If none is found.

        """
        packing = vertex.packing
        step = math.copysign(beyond, direction)
        strain = vertex.strain + step
        ahead = packing.position_nd + step * (packing.position_nd @ self.shear_dd.T)
        packing = packing.replace(position_nd=ahead, box=self._lattice(strain, packing))
        state = self._warm(packing, vertex)
        hard, iterations = search_hard(state, self.radius_n, self.isotropic_kdd)
        self.factorizations += iterations
        if hard is None:
            raise Lost
        place = hard.packing.replace(box=self._lattice(strain, hard.packing))
        bears = hard.contacts.count_n() > 0
        roomy, _, _ = make_room(place, self._near(place), ~bears)
        after = self._vertex(strain, roomy, hard.contacts, hard.force_c, hard.gap_error)
        both = vertex.live_n & after.live_n
        moved = place.position_nd @ np.linalg.inv(place.box.lattice_dd).T
        moved = (moved - packing.position_nd @ packing.box.inverse_dd.T)[both] @ packing.box.lattice_dd.T
        moved = moved - moved.mean(axis=0) if len(moved) else np.zeros((1, 1))
        return self._noted(vertex, after, cause, float(np.sqrt((moved**2).sum(axis=1)).max()))

    def _warm(self, packing: Packing, vertex: Vertex) -> HardState:
        """Return the state of an interior-point search that begins with the forces of a vertex."""
        pairs = candidate_pairs(
            packing.position_nd, packing.radius_n, packing.box, scale=1.0 + REACH[packing.dimension]
        )
        near = pair_contacts(packing, *pairs)
        slack = np.maximum(near.gap_c, _SLACK)
        barrier = _SLACK * float(vertex.force_c.mean())
        force = barrier / slack
        key, own = self._key(near), self._key(vertex.contacts)
        order = np.argsort(own)
        place = np.searchsorted(own[order], key)
        place[place == len(own)] = 0
        mine = own[order][place] == key
        force[mine] = np.maximum(vertex.force_c[order][place[mine]], force[mine])
        violation = float((slack - near.gap_c).max(initial=0.0))
        return HardState(packing.position_nd, packing.box.lattice_dd, pairs, slack, force, barrier, violation)

    # labels of the same lattice

    def _relabeled(self, vertex: Vertex) -> Vertex:
        """Return the vertex with short lattice vectors and particles in the cell, where they have gone far."""
        contacts = vertex.contacts
        renewed = self.lattice.renewed(vertex.packing, contacts)
        if renewed is None:
            return vertex
        packing, moved = renewed
        order = np.lexsort((*moved.T[::-1], contacts.j_c, contacts.i_c))
        pairs = Candidates(contacts.i_c[order], contacts.j_c[order], np.ascontiguousarray(moved[order]))
        return self._vertex(
            vertex.strain, packing, pair_contacts(packing, *pairs), vertex.force_c[order], vertex.gap_error
        )


def redundancy(contacts: Contacts) -> int:
    """Return how many contacts there are beyond those of one state of self stress, with the volume free."""
    return len(contacts) - contacts.dimension * (int((contacts.count_n() > 0).sum()) - 1) - 1


def dips(
    first_c: NDArray[np.float64],
    then_c: NDArray[np.float64],
    last_c: NDArray[np.float64],
    later_c: NDArray[np.float64],
    step: float,
) -> bool:
    """Return whether a gap closes and opens again on the way, by cubics through gaps and their rates at both ends."""
    for c in np.flatnonzero((then_c * step < 0.0) & (later_c * step > 0.0)):
        place = np.linspace(0.0, 1.0, 33)
        gap = (
            first_c[c] * (1 + 2 * place) * (1 - place) ** 2
            + last_c[c] * place**2 * (3 - 2 * place)
            + step * (then_c[c] * place * (1 - place) ** 2 - later_c[c] * place**2 * (1 - place))
        )
        if float(gap.min()) < -_AT_ONCE:
            return True
    return False


def make_room(
    packing: Packing, near: Contacts | ShapeContacts, rattling_n: NDArray[np.bool_]
) -> tuple[Packing, float, Candidates]:
    """Return the packing with its rattlers as far from everything as they can be, the room left, and who limits it.

    Each program maximizes the smallest relative gap of each group of rattlers that can meet, to first order in their
    displacements, turns among them, over all pairs that these can bring together; distances of discs and spheres are
    convex, so that the true gaps are no smaller. Room of a thousandth is enough.

    Parameters
    ----------
    packing
        The packing.
    near
        All pairs that are near.
    rattling_n
        (N,) its rattlers.

    Returns
    -------
    tuple
        The packing, the smallest gap of a rattler over its contact distance, negative where one is squeezed, and the
        pairs that have that gap and hold it there.

    """
    gap_c = near.gap_c / near.contact_distance_c
    loose_i, loose_j = rattling_n[near.i_c], rattling_n[near.j_c]
    room = float(gap_c[loose_i | loose_j].min(initial=_NEAR))
    waiting = np.zeros(packing.particles, dtype=bool)
    for loose_c, end_c in ((loose_i, near.i_c), (loose_j, near.j_c)):
        waiting[end_c[loose_c & (gap_c <= _ROOM)]] = True
    if not waiting.any():
        return packing, room, _no_pairs(packing)
    meeting = _within_reach(packing, rattling_n, _TRUST)
    label_n = _groups(meeting, rattling_n)
    packing, found = _apart(packing, rattling_n & np.isin(label_n, label_n[waiting]))
    room = min(own for own, _ in found)
    limiting = [limits for own, limits in found if own <= room + _AT_ONCE]
    return packing, room, Candidates(*(np.concatenate(part) for part in zip(*limiting, strict=True)))


def _no_pairs(packing: Packing) -> Candidates:
    none = np.zeros(0, dtype=np.int64)
    return Candidates(none, none, np.zeros((0, packing.dimension), dtype=np.int64))


def _within_reach(packing: Packing, member_n: NDArray[np.bool_], trust: float) -> Contacts | ShapeContacts:
    """Return the pairs of members that are tight, or may be once each coordinate has changed by no more than `trust`.

    A pair is tight up to the room that is enough.
    """
    d, shapes = packing.dimension, packing.shapes
    way = math.sqrt(d)
    if isinstance(shapes, Beads):
        # beads go round their bodies' centers, other shapes turn within the discs or spheres that hold them
        turn = np.sqrt((shapes.turn_basis(packing.radius_n) ** 2).sum(axis=(1, 2)))
        way += math.sqrt(d) * float((turn * shapes.reach(packing.radius_n)).max())
    skin, scale = 2.0 * way * trust, 1.0 + _ROOM
    if shapes is not None:
        pairs = candidate_shapes(packing, scale, skin)
        owner = shapes.particle_b
        keep = member_n[owner[pairs.i_c]] | member_n[owner[pairs.j_c]]
        return shape_contacts(packing, Candidates(*(part[keep] for part in pairs)))
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=scale, skin=skin)
    keep = member_n[pairs.i_c] | member_n[pairs.j_c]
    return pair_contacts(packing, *(part[keep] for part in pairs))


def _groups(near: Contacts | ShapeContacts, member_n: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the (N,) number of each particle's group of those members that the pairs join."""
    both = member_n[near.i_c] & member_n[near.j_c]
    return clusters(len(member_n), near.i_c[both], near.j_c[both])


def _apart(packing: Packing, member_n: NDArray[np.bool_]) -> tuple[Packing, list[tuple[float, Candidates]]]:
    """Return the packing with each group of members as far from everything as it can be, and of each its limits.

    These are the room that it has and the pairs that hold it there. One program moves all groups; they do not meet in
    it, so each has a room of its own.
    """
    found: list[tuple[float, Candidates]] = []
    member_n, trust_n = member_n.copy(), np.full(packing.particles, _TRUST)
    for left in range(_PROGRAMS, 0, -1):
        here = _within_reach(packing, member_n, float(trust_n[member_n].max()))
        label_n = _groups(here, member_n)
        names = np.unique(label_n[member_n])
        group_n = np.where(member_n, np.searchsorted(names, label_n), -1)
        group_c = np.where(member_n[here.i_c], group_n[here.i_c], group_n[here.j_c])
        trust_g = np.full(len(names), _TRUST)
        np.minimum.at(trust_g, group_n[member_n], trust_n[member_n])
        u_nq, push_c = _outwards(packing, here, group_n, group_c, trust_g)
        room_g = _smallest(here, group_c, len(names))
        reached_g = _smallest(here.at(packing.moved(u_nq)), group_c, len(names))
        better_g = reached_g > room_g + 1e-15
        packing = packing.moved(u_nq * better_g[group_n][:, None])
        way_g = np.zeros(len(names))
        np.maximum.at(way_g, group_n[member_n], np.abs(u_nq[member_n]).max(axis=1))
        stuck_g = ~better_g
        if packing.shapes is not None:
            # distances of other shapes bend both ways: nearer by they are straight
            stuck_g &= (trust_g < _STRAIGHT) | (way_g == 0.0)
        done_g = stuck_g | (better_g & ((reached_g > _ROOM) | (reached_g - room_g < 1e-14))) | (left == 1)
        for g in np.flatnonzero(done_g):
            limits = here.select((group_c == g) & push_c)
            found.append((float(max(reached_g[g], room_g[g])), limits.pairs))
        trust_g = np.where(better_g, np.minimum(trust_g, np.maximum(3.0 * way_g, 1e-6)), 0.25 * trust_g)
        trust_n[member_n] = trust_g[group_n[member_n]]
        member_n &= ~done_g[group_n]
        if not member_n.any():
            break
    return packing, found


def _smallest(near: Contacts | ShapeContacts, group_c: NDArray[np.int64], groups: int) -> NDArray[np.float64]:
    """Return the (G,) smallest relative gaps of the pairs of each group, at most that up to which pairs are near."""
    smallest = np.full(groups, _NEAR)
    np.minimum.at(smallest, group_c, near.gap_c / near.contact_distance_c)
    return smallest


def _outwards(
    packing: Packing,
    here: Contacts | ShapeContacts,
    group_n: NDArray[np.int64],
    group_c: NDArray[np.int64],
    trust_g: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the displacements that give each group the most room to first order, and the pairs that limit them.

    Where the program is not solved there are none.
    """
    ends = end_slopes(here.i_c, here.j_c, here.slope_cx, here.turn_nkt, here.dimension)
    member_n, q, groups = group_n >= 0, ends.shape[2], len(trust_g)
    count, number = int(member_n.sum()), np.cumsum(member_n) - 1
    lines = np.arange(len(here))
    row, column, value = [lines], [count * q + group_c], [here.contact_distance_c]
    for end, slope_cq in zip((here.i_c, here.j_c), ends, strict=True):
        one = np.flatnonzero(member_n[end])
        row.append(np.repeat(one, q))
        column.append((number[end[one]][:, None] * q + np.arange(q)).ravel())
        value.append(-slope_cq[one].ravel())
    below = sp.coo_array(
        (np.concatenate(value), (np.concatenate(row), np.concatenate(column))), shape=(len(here), count * q + groups)
    ).tocsr()
    bound = np.repeat(trust_g[group_n[member_n]], q)
    program = LinearProgram(
        cost=np.concatenate([np.zeros(count * q), -np.ones(groups)]),
        equal=sp.csr_array((0, count * q + groups)), equal_to=np.zeros(0), below=below, below_to=here.gap_c,
        lower=np.concatenate([-bound, np.full(groups, -np.inf)]),
        upper=np.concatenate([bound, np.full(groups, _NEAR)]), dimension=q,
    )  # fmt: skip
    solution = solve_highs(program, 1e-10)
    u_nq = np.zeros((packing.particles, q))
    if solution.solve.outcome is not Outcome.CONVERGED:
        return u_nq, np.zeros(len(here), dtype=bool)
    u_nq[member_n] = solution.x[: count * q].reshape(count, q)
    return u_nq, np.asarray(solution.below_multiplier > 1e-6 * float(solution.below_multiplier.max(initial=1e-300)))


def search_hard(
    state: HardState, radius_n: NDArray[np.float64], basis_kdd: NDArray[np.float64]
) -> tuple[HardPacking | None, int]:
    """Return the hard packing that an interior-point search from a state ends in, or None, and its iterations."""
    rung = kicks = used = 0
    while True:
        began = state.iterations
        state = densify(state, radius_n, basis_kdd, barrier=_BARRIERS[rung], iteration_limit=_ITERATIONS)
        used += state.iterations - began
        hard, _ = certify(state, radius_n, basis_kdd)
        if hard is not None and not hard.floppy_modes:
            return hard, used
        if state.iterations >= _ITERATIONS:
            return None, used
        if hard is not None and kicks < _KICKS:
            kicks, rung = kicks + 1, 0
            near = kicked(hard.packing, basis_kdd, kicks)
            load = float(near.particles * near.dimension)
            state = start_state(near.position_nd, near.box.lattice_dd, near.radius_n, load)
        elif hard is None and rung < len(_BARRIERS) - 1:
            rung += 1
        else:
            return None, used
