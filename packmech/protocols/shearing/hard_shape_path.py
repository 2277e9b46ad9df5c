"""A hard packing of shapes followed while its box shears: exactly, at zero pressure, from network to network.

Forces of hard shapes are the multipliers of the least volume: with positions, turns, volume and forces as unknowns
Newton's method solves for balance and for gaps that are zero at once. No stiffness enters, so that motions which only
the curvature of the shapes resists, thousands of times softer than contacts at any small pressure, are as easy as all
others, and packings may have fewer contacts than degrees of freedom. The network lasts until

- a pair closes: it bears forces from there on. Only where there are as many contacts as one state of self stress needs
  already does another open for it. Positions and volume are continuous;
- the force of a contact falls to zero: it opens, and the packing goes on where the curvature holds it without;
- the volume has no minimum nearby any more: with the contact that opened, or where a curvature falls to zero. It falls
  downhill, soft, at a small pressure, and from there to the hard packing.

Rattlers are kept apart from what surrounds them, as those of discs. Families of sheared packings: Schreck and O'Hern,
section 2.2 of their chapter; forces of hypostatic packings of ellipsoids: Donev et al., Phys. Rev. E 75, 051304 (2007).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from packmech.contacts.elements import sum_ends
from packmech.contacts.network import Candidates, Contacts
from packmech.contacts.overlaps import HARD
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, candidate_shapes, shape_contacts
from packmech.jamming.hard_path import Lost, dips, make_room
from packmech.jamming.sheared_lattice import ShearedLattice
from packmech.minimize.second_order.shape_network import ShapeNetwork
from packmech.minimize.second_order.soft_network import REACH, Response, Units
from packmech.minimize.second_order.soft_newton import descend, network_of
from packmech.packing import Packing

# stiffness of the augmented Lagrangian, whose multipliers are of order one: its inverse is the rate of convergence
_STIFFNESS, _TRACE, _PASSES = 1e6, 1e-14, 3
_ITERATIONS, _IDLE = 30, 4
# contacts touch to this, below what hard particles may overlap by, forces balance to this over the mean one, and pairs
# that close at one strain are as near
_TOUCH, _BALANCED, _AT_ONCE = 0.5 * HARD, 1e-9, 1e-9
_NEAR = 0.1
# room over the contact distance with which a rattler is left where it is
_TIGHT = 1e-3
# force over the mean one that counts as none, and rate of a force or gap that does
_NO_FORCE, _NO_RATE = 1e-7, 1e-9
# what is found must be this near where the rates lead, over the way
_CORRECTED, _ROUNDED = 0.25, 1e-9
# the shortest step of strain that is tried, and the strain beyond a fall's beginning at which it ends
_SHORTEST, _BEYOND = 1e-9, 2e-9
_FURTHER = (1e-4, 1e-3)
# pressures at which it falls, over that asked for; iterations down; pressures on the way to none
_HARDER, _DOWNHILL, _SOFTER, _ROUNDS, _SOUND = (1.0, 10.0, 100.0), 200, (1.0, 0.1, 1e-2, 1e-3), 12, 1e-4


@dataclass(frozen=True, eq=False)
class ShapeVertex:
    """An exact hard packing of shapes at a shear strain.

    Attributes
    ----------
    strain
        The shear strain since the start.
    packing
        The packing in reduced lengths, as it moves on from the start.
    contacts, force_c
        The contacts and their forces at pressure one; those that have just closed bear none yet.
    gap_error, force_imbalance
        Largest gap or overlap of a contact [length], and largest net force over the mean.
    answer, rate_c
        How packing and forces move on with the strain.
    near
        All pairs that are near.

    """

    strain: float
    packing: Packing
    contacts: ShapeContacts
    force_c: NDArray[np.float64]
    gap_error: float
    force_imbalance: float
    answer: Response
    rate_c: NDArray[np.float64]
    near: ShapeContacts

    @property
    def live_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that bear forces."""
        return np.asarray(self.contacts.count_n() > 0)

    def stress_ratio(self, axes: tuple[int, int]) -> float:
        """Return shear stress over pressure, stress with tension positive: d ln(volume) / d(strain)."""
        one, (flow, gradient) = self.contacts, axes
        pull_cd = self.force_c[:, None] * one.slope_cx[:, : one.dimension]
        moment = float((pull_cd[:, flow] * one.vector_cd[:, gradient]).sum())
        return -one.dimension * moment / float((pull_cd * one.vector_cd).sum())


@dataclass(frozen=True, eq=False)
class ShapeChange:
    """One change of the contact network: as `Change` of discs, with "instability" for a fold."""

    before: ShapeVertex
    after: ShapeVertex
    cause: str
    moved: float
    identities: tuple[frozenset[tuple[int, ...]], frozenset[tuple[int, ...]]]

    @property
    def jumps(self) -> bool:
        """Whether it fell to another packing, and not only exchanged contacts where it stands."""
        return self.after.strain != self.before.strain


class _HardNetwork(ShapeNetwork):
    """The augmented Lagrangian of the least volume: given contacts, with forces of their own and a stiffness each."""

    def __init__(
        self, packing: Packing, basis_kdd: NDArray[np.float64], active: Candidates, force_c: NDArray[np.float64]
    ):
        self.force_c, self._active = force_c, active
        super().__init__(packing, Units((), 1.0, 1.0), basis_kdd, 1.0)

    def search(self, packing: Packing) -> Candidates:
        """Return the contacts."""
        return self._active

    def measure(self, packing: Packing) -> None:
        """Take the packing in: its gaps, and forces that press on where they close."""
        self.packing = packing
        self.contacts = self.near(packing)
        self.gap_c = self.contacts.gap_c
        self.second_c = np.full(len(self.gap_c), _STIFFNESS)
        # how well the forces alone balance, then the slopes for Newton's steps
        self.first_c = -self.force_c
        self.balance()
        self.imbalance = self.merit
        self.first_c = _STIFFNESS * self.gap_c - self.force_c
        self.balance()

    def hard_response(self, shear_dd: NDArray[np.float64]) -> tuple[Response, NDArray[np.float64]]:
        """Return how the packing answers to an imposed displacement gradient, its gaps closed, and its forces."""
        basis, trace = self.basis_kdd, _TRACE * _STIFFNESS
        k = len(basis)
        found = self.coupled(np.concatenate([basis, shear_dd[None]]), trace)
        coupling, corner = found.coupling_fk, found.corner_kk.copy()
        # free strains act on what is sheared already
        corner[:k, k] += np.einsum("ab,kac,cb->k", self.gradient_slopes(), basis, shear_dd)
        right, right_k = -coupling[:, k], -corner[:k, k]
        rate_c = np.zeros(len(self.force_c))
        step, strain_k = np.zeros(found.size), np.zeros(k)
        for _ in range(_PASSES):
            more, more_k, _ = found.solved(right, right_k, coupling[:, :k], corner[:k, :k])
            step, strain_k = step + more, strain_k + more_k
            gradient = shear_dd + np.einsum("k,kab->ab", strain_k, basis)
            answer = Response(self._spread(found, step), strain_k, gradient, 0.0)
            # what gaps are left take more force
            push_c = -_STIFFNESS * self.gap_rates(self.contacts, answer)
            rate_c = rate_c + push_c
            right, right_k = self.pulled(found.free_f, push_c)
        return answer, rate_c

    def pulled(
        self, free_f: NDArray[np.int64], force_c: NDArray[np.float64], contacts: ShapeContacts | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the forces along free coordinates, and along strains, with which contacts push."""
        one = self.contacts if contacts is None else contacts
        pull_cd = force_c[:, None] * one.slope_cx[:, : one.dimension]
        along = np.einsum("kab,ca,cb->k", self.basis_kdd, pull_cd, one.vector_cd)
        return sum_ends(one, force_c).ravel()[free_f], along


class HardShapePath:
    """A hard packing of shapes on its way along a shear strain.

    Parameters
    ----------
    packing
        A soft packing with shapes at a small pressure, in reduced lengths.
    units
        Its law and units.
    pressure
        The pressure it has, and at which it falls [reduced].
    axes
        Direction of the flow and of its gradient.
    watch
        Called with the packing on the way down.

    """

    def __init__(
        self,
        packing: Packing,
        units: Units,
        pressure: float,
        axes: tuple[int, int],
        watch: Callable[[Packing], None] | None = None,
    ) -> None:
        d = packing.dimension
        self.axes, self.units, self.pressure, self._watch = axes, units, pressure, watch
        self.lattice = ShearedLattice(packing, axes)
        self.shear_dd = self.lattice.shear_dd
        self.isotropic_kdd = np.eye(d)[None] / math.sqrt(d)
        self.factorizations = 0
        self._stride = math.inf
        vertex = self._hardened(packing, 0.0, pressure)
        if vertex is None:
            raise Lost
        self.vertex = vertex

    def identity(self, contacts: Contacts | ShapeContacts) -> frozenset[tuple[int, ...]]:
        """Return the pairs (i, j, image), of sites that touch, with the images of the start."""
        assert isinstance(contacts, ShapeContacts)
        return self.lattice.identity(contacts, contacts.site_i_c, contacts.site_j_c)

    # what a network is at a strain

    def _settled(
        self, strain: float, packing: Packing, active: Candidates, force_c: NDArray[np.float64], *, stable: bool = True
    ) -> ShapeVertex | None:
        """Return the packing of the given contacts in the box of a strain; None where they have none, or no minimum."""
        network = _HardNetwork(packing, self.isotropic_kdd, active, force_c)
        best, lowest, idle, negative = (packing, force_c), math.inf, 0, 0
        for _ in range(_ITERATIONS):
            merit = max(network.imbalance, float(np.abs(network.gap_c).max()))
            if not np.isfinite(merit):
                return None
            idle = 0 if merit < 0.5 * lowest else idle + 1
            if merit < lowest:
                best, lowest = (network.packing, network.force_c), merit
            if lowest < 1e-13 or idle > (1 if lowest < 1e-10 else _IDLE):
                break
            try:
                u_nq, strain_k, negative = network.direction(_TRACE * _STIFFNESS)
            except (np.linalg.LinAlgError, RuntimeError, ValueError):
                return None
            self.factorizations += 1
            longest = float(np.abs(u_nq).max()) + float(np.abs(strain_k).max())
            if not np.isfinite(longest):
                return None
            size = min(1.0, REACH / max(longest, 1e-300))
            step = Response(u_nq, strain_k, np.einsum("k,kab->ab", strain_k, self.isotropic_kdd), 0.0)
            left = network.gap_c + network.gap_rates(network.contacts, step)
            network.force_c = network.force_c - size * _STIFFNESS * left
            network.measure(network.moved(size * u_nq, size * strain_k))
        packing, network.force_c = best
        network.measure(packing.replace(box=self.lattice.box(strain, packing.box.volume)))
        gap_error, imbalance = float(np.abs(network.gap_c).max()), network.imbalance
        if gap_error > _TOUCH or imbalance > _BALANCED or (stable and negative):
            return None
        return self._vertex(strain, network, gap_error, imbalance)

    def _vertex(self, strain: float, network: _HardNetwork, gap_error: float, imbalance: float) -> ShapeVertex | None:
        try:
            answer, rate_c = network.hard_response(self.shear_dd)
        except (np.linalg.LinAlgError, RuntimeError, ValueError):
            return None
        self.factorizations += 1
        packing = network.packing
        near = self._near(packing)
        live = network.contacts.count_n() > 0
        cages = ~(live[near.i_c] & live[near.j_c])
        if (near.gap_c[cages] < _TIGHT * near.contact_distance_c[cages]).any():
            packing, _, _ = make_room(packing, near, ~live)
            near = self._near(packing)
        return ShapeVertex(
            strain, packing, network.contacts, network.force_c, gap_error, imbalance, answer, rate_c, near
        )  # fmt: skip

    def _near(self, packing: Packing) -> ShapeContacts:
        return shape_contacts(packing, candidate_shapes(packing, 1.0 + _NEAR))

    def _key(self, pairs: Candidates) -> NDArray[np.int64]:
        """Return a number for each pair of sites and its image."""
        key = np.asarray(pairs.i_c * (1 << 24) + pairs.j_c)
        for column in pairs.image_cd.T:
            key = key * 401 + column + 200
        return key

    def _places(self, among: ShapeContacts, pairs: Candidates) -> NDArray[np.int64]:
        """Return where pairs are among others."""
        key = self._key(among.pairs)
        order = np.argsort(key)
        return np.asarray(order[np.searchsorted(key[order], self._key(pairs))])

    def _ahead(self, start: ShapeVertex, strain: float) -> Packing:
        """Return the packing at another strain, along the rates."""
        step, packing, answer, d = strain - start.strain, start.packing, start.answer, start.packing.dimension
        position = packing.position_nd + step * (packing.position_nd @ answer.gradient_dd.T + answer.u_nd[:, :d])
        size = 1.0 + step * float(np.trace(answer.gradient_dd)) / d
        shapes = packing.shapes
        assert shapes is not None
        turned = np.einsum("nk,nkt->nt", step * answer.u_nd[:, d:], shapes.turn_basis(packing.radius_n))
        return packing.replace(
            position_nd=position,
            box=self.lattice.box(strain, packing.box.volume * size**d),
            shapes=shapes.turned(turned),
        )

    def _try(self, start: ShapeVertex, strain: float) -> ShapeVertex | None:
        """Return what the network of a vertex gives at another strain; None where it cannot be brought there."""
        ahead, step = self._ahead(start, strain), strain - start.strain
        found = self._settled(strain, ahead, start.contacts.pairs, start.force_c + step * start.rate_c)
        if found is None:
            return None
        live, d = start.live_n, ahead.dimension
        assert start.packing.shapes is not None
        turning = start.packing.shapes.turn_basis(start.packing.radius_n)[live]
        turns = np.einsum("nk,nkt->nt", start.answer.u_nd[live][:, d:], turning)
        moved = (found.packing.position_nd - ahead.position_nd)[live]
        assert found.packing.shapes is not None and ahead.shapes is not None
        turned = found.packing.shapes.rotation_since(ahead.shapes)[live]
        corrected = max(float(np.abs(moved - moved.mean(axis=0)).max()), float(np.abs(turned).max()))
        way = abs(step) * max(1.0, float(np.abs(start.answer.u_nd[live][:, :d]).max()), float(np.abs(turns).max()))
        return found if corrected <= _CORRECTED * way + _ROUNDED else None

    def _margins(self, vertex: ShapeVertex) -> dict[str, float]:
        """Return how far closing, squeezing and opening are."""
        near, live = vertex.near, vertex.live_n
        gap_c = near.gap_c / near.contact_distance_c
        bearing = np.isin(self._key(near.pairs), self._key(vertex.contacts.pairs))
        both = live[near.i_c] & live[near.j_c]
        return {
            "closing": float(gap_c[both & ~bearing].min(initial=_NEAR)),
            "opening": float(vertex.force_c.min() / vertex.force_c.mean()),
            "squeezing": float(gap_c[~both].min(initial=_NEAR)),
        }

    # from vertex to vertex

    def go(self, strain: float) -> tuple[ShapeVertex, ShapeChange | None]:
        """Go on towards a strain; return the vertex there or on the way, or that of the first change, and the change.

        Raises
        ------
        Lost
            If no hard packing is found after a fall.

        """
        start = self.vertex
        direction = math.copysign(1.0, strain - start.strain)
        aim, halved = strain, False
        if self._stride < abs(strain - start.strain):
            aim = start.strain + direction * self._stride
        while True:
            trial = self._try(start, aim)
            step = abs(aim - start.strain)
            if trial is not None:
                margins = self._margins(trial)
                cause = min(margins, key=lambda name: margins[name])
                if margins[cause] <= -_TOUCH:
                    change = self._change(start, trial)
                    if change is not None:
                        self.vertex = self._relabeled(change.after)
                        # what rounding took for a change is none
                        same = not change.jumps and change.identities[0] == change.identities[1]
                        return self.vertex, None if same else change
                elif not self._dips(start, trial):
                    self._stride = step if halved else 3.0 * step
                    self.vertex = self._relabeled(trial)
                    return self.vertex, None
            if step <= _SHORTEST:
                return self.fall(direction, "instability")
            aim, halved = start.strain + 0.5 * (aim - start.strain), True

    def fall(self, direction: float, cause: str, beyond: float = _BEYOND) -> tuple[ShapeVertex, ShapeChange]:
        """Give the network up: go to the hard packing that is found next, whatever contacts it takes; and the change.

        Parameters
        ----------
        direction
            Sign of the strain to come.
        cause
            Why it falls.
        beyond
            How much farther in strain the next packing is looked for, at least.

        Raises
        ------
        Lost
            If none is found.

        """
        change = self._fall(self.vertex, cause, direction, beyond)
        self.vertex = self._relabeled(change.after)
        return self.vertex, change

    def _dips(self, start: ShapeVertex, end: ShapeVertex) -> bool:
        """Return whether a pair closes and opens again between two vertices."""
        near, live = start.near, start.live_n
        there = shape_contacts(end.packing, near.pairs)
        rates = [self._gap_rates(one, pairs) for one, pairs in ((start, near), (end, there))]
        both = live[near.i_c] & live[near.j_c]
        return dips(near.gap_c[both], rates[0][both], there.gap_c[both], rates[1][both], end.strain - start.strain)

    def _gap_rates(self, vertex: ShapeVertex, near: ShapeContacts) -> NDArray[np.float64]:
        """Return how fast the distances of pairs change with the strain."""
        d, answer, packing = near.dimension, vertex.answer, vertex.packing
        assert packing.shapes is not None
        turned = np.einsum("nk,nkt->nt", answer.u_nd[:, d:], packing.shapes.turn_basis(packing.radius_n))
        moved = answer.u_nd[near.j_c, :d] - answer.u_nd[near.i_c, :d] + near.vector_cd @ answer.gradient_dd.T
        whole = np.hstack([moved, turned[near.i_c], turned[near.j_c]])
        return np.asarray((near.slope_cx * whole).sum(axis=1))

    def _change(self, start: ShapeVertex, beyond: ShapeVertex) -> ShapeChange | None:
        """Return the first change between a vertex and a strain at which its network is none any more.

        None where a rattler that is squeezed at the farther strain is not on the way there: in so long a step it was
        led elsewhere.
        """
        found: dict[float, ShapeVertex | None] = {beyond.strain: beyond}

        def margin(strain: float) -> float:
            if strain == start.strain:
                # a contact that has just been given up is still closed, one that has just closed bears nothing
                return _TOUCH
            if strain not in found:
                found[strain] = self._try(start, strain)
            one = found[strain]
            return -1.0 if one is None else max(min(self._margins(one).values()), -1.0) + _TOUCH

        direction = math.copysign(1.0, beyond.strain - start.strain)
        root = brentq(margin, start.strain, beyond.strain, xtol=1e-15, rtol=4.0 * np.finfo(float).eps, maxiter=200)
        near = [one for strain, one in found.items() if one is not None and abs(strain - root) < 1e-11]
        if not near:
            return self._fall(start, "instability", direction)
        there = min(near, key=lambda one: abs(margin(one.strain)))
        margins = self._margins(there)
        cause = min(margins, key=lambda name: margins[name])
        if cause == "squeezing" and abs(margins[cause]) > _AT_ONCE:
            return None
        after = None
        if cause == "closing":
            after = self._with_closed(there, direction)
        elif cause == "opening":
            after = self._with_opened(there, direction)
        if after is None:
            return self._fall(there, cause, direction)
        return self._noted(there, after, cause, 0.0)

    def _noted(self, before: ShapeVertex, after: ShapeVertex, cause: str, moved: float) -> ShapeChange:
        return ShapeChange(
            before, after, cause, moved, (self.identity(before.contacts), self.identity(after.contacts))
        )  # fmt: skip

    def _with_opened(self, vertex: ShapeVertex, direction: float) -> ShapeVertex | None:
        """Return the packing without the contacts whose forces are zero, where it goes on so."""
        contacts = vertex.contacts
        opened = vertex.force_c < _NO_FORCE * vertex.force_c.mean()
        kept = ~opened
        rattling = rattlers_of(contacts.select(kept))
        kept &= ~(rattling[contacts.i_c] | rattling[contacts.j_c])
        if not kept.any():
            return None
        after = self._settled(vertex.strain, vertex.packing, contacts.select(kept).pairs, vertex.force_c[kept])
        if after is None:
            return None
        live = after.live_n
        apart = contacts.select(~kept & live[contacts.i_c] & live[contacts.j_c])
        return after if (self._gap_rates(after, apart) * direction > -_NO_RATE).all() else None

    def _with_closed(self, vertex: ShapeVertex, direction: float) -> ShapeVertex | None:
        """Return the packing with the pairs that have just closed, without those that open for them."""
        near, live = vertex.near, vertex.live_n
        where = self._places(near, vertex.contacts.pairs)
        closed = live[near.i_c] & live[near.j_c] & (np.abs(near.gap_c) < _AT_ONCE * near.contact_distance_c)
        closed[where] = False
        force = np.zeros(len(near))
        force[where] = vertex.force_c
        chosen = closed.copy()
        chosen[where] = True
        assert vertex.packing.shapes is not None
        turning = vertex.packing.shapes.turn_basis(vertex.packing.radius_n)[live]
        free = (int(live.sum()) - 1) * near.dimension + int((turning != 0.0).any(axis=2).sum()) + 1
        if chosen.sum() > free:
            return self._exchanged(vertex, near, closed, force, direction)
        after = self._settled(vertex.strain, vertex.packing, near.select(chosen).pairs, force[chosen])
        if after is None:
            return None
        fresh = closed[chosen]
        return after if (after.rate_c[fresh] * direction > 0.0).all() else None

    def _exchanged(
        self,
        vertex: ShapeVertex,
        near: ShapeContacts,
        closed: NDArray[np.bool_],
        force: NDArray[np.float64],
        direction: float,
    ) -> ShapeVertex | None:
        """Return the packing where a contact takes over from another, there being a second state of self stress."""
        network = _HardNetwork(vertex.packing, self.isotropic_kdd, vertex.contacts.pairs, vertex.force_c)
        fresh = near.select(closed)
        if len(fresh) != 1:
            return None
        # a unit force of the new contact, and what the others do against it
        found = network.coupled(self.isotropic_kdd, _TRACE * _STIFFNESS)
        right, along = network.pulled(found.free_f, np.ones(1), fresh)
        step, strain_k, _ = found.solved(right, along, found.coupling_fk, found.corner_kk)
        self.factorizations += 1
        gradient = np.einsum("k,kab->ab", strain_k, self.isotropic_kdd)
        answer = Response(network._spread(found, step), strain_k, gradient, 0.0)
        against = -_STIFFNESS * network.gap_rates(vertex.contacts, answer)
        falling = against < -_NO_RATE
        if not falling.any():
            return None
        ratio = np.where(falling, vertex.force_c / np.where(falling, -against, 1.0), np.inf)
        share = float(ratio.min())
        new = vertex.force_c + share * against
        bears = np.ones(len(new), dtype=bool)
        bears[int(np.argmin(ratio))] = False
        where = self._places(near, vertex.contacts.pairs)
        force[where], force[closed] = new, share
        chosen = closed.copy()
        chosen[where[bears]] = True
        return self._settled(vertex.strain, vertex.packing, near.select(chosen).pairs, force[chosen])

    # falls

    def _fall(self, vertex: ShapeVertex, cause: str, direction: float, beyond: float = _BEYOND) -> ShapeChange:
        """Return the change to the hard packing nearby, where the network holds the packing no more.

        Raises
        ------
        Lost
            If none is found.

        """
        strain = vertex.strain + direction * beyond
        for further in (beyond, *(one for one in _FURTHER if one > beyond)):
            after = self._fallen(vertex, vertex.strain + direction * further)
            if after is None:
                continue
            if further > beyond:
                # soft, it goes on a little further than hard: back to where that ends
                back = self._try(after, strain)
                if back is not None and min(self._margins(back).values()) > -_TOUCH:
                    after = back
            both = vertex.live_n & after.live_n
            moved = after.packing.position_nd @ after.packing.box.inverse_dd.T
            moved = (moved - vertex.packing.position_nd @ vertex.packing.box.inverse_dd.T)[both]
            moved = moved @ after.packing.box.lattice_dd.T
            moved = moved - moved.mean(axis=0) if len(moved) else np.zeros((1, 1))
            self._stride = math.inf
            return self._noted(vertex, after, cause, float(np.sqrt((moved**2).sum(axis=1)).max()))
        raise Lost

    def _fallen(self, vertex: ShapeVertex, strain: float) -> ShapeVertex | None:
        """Return the hard packing that a vertex, soft at a small pressure, falls to at a strain; None without any."""
        packing, way = vertex.packing, strain - vertex.strain
        position = packing.position_nd + way * packing.position_nd @ self.shear_dd.T
        for harder in _HARDER:
            pressure = harder * self.pressure
            # contacts that overlap by about what the pressure asks for
            size = 1.0 - pressure
            box = self.lattice.box(strain, packing.box.volume).scaled(size)
            state = descend(
                packing.replace(position_nd=position * size, box=box),
                self.units,
                self.isotropic_kdd,
                pressure,
                iterations=_DOWNHILL,
                watch=self._watch,
            )
            self.factorizations += state.iterations
            after = self._hardened(state.packing, strain, pressure) if state.sound(_SOUND) else None
            if after is not None:
                return after
        return None

    def _hardened(self, packing: Packing, strain: float, pressure: float) -> ShapeVertex | None:
        """Return the hard packing that a soft one comes to as its pressure falls to nothing, or None."""
        for softer in _SOFTER:
            at = softer * pressure
            if softer < 1.0:
                state = descend(
                    packing, self.units, self.isotropic_kdd, at, iterations=_DOWNHILL // 2, watch=self._watch
                )
                self.factorizations += state.iterations
                if not state.sound(_SOUND):
                    return None
                packing = state.packing
            network = network_of(packing, self.units, self.isotropic_kdd, at)
            contacts = network.contacts
            if not isinstance(contacts, ShapeContacts) or not len(contacts):
                return None
            rattling = rattlers_of(contacts)
            bears = ~(rattling[contacts.i_c] | rattling[contacts.j_c])
            found = self._complementary(
                packing.replace(box=self.lattice.box(strain, packing.box.volume)),
                strain,
                contacts.select(bears).pairs,
                -network.first_c[bears] / at,
            )
            if found is not None:
                return found
        return None

    def _complementary(
        self, packing: Packing, strain: float, active: Candidates, force_c: NDArray[np.float64]
    ) -> ShapeVertex | None:
        """Return the hard packing nearby, contacts that would pull given up and pairs that would overlap taken in."""
        for _ in range(_ROUNDS):
            if not len(force_c):
                return None
            found = self._settled(strain, packing, active, force_c, stable=False)
            if found is None:
                return None
            near, live = found.near, found.live_n
            bearing = np.isin(self._key(near.pairs), self._key(active))
            overlaps = ~bearing & live[near.i_c] & live[near.j_c] & (near.gap_c < -_TOUCH * near.contact_distance_c)
            pulls = found.force_c <= _NO_FORCE * found.force_c.mean()
            if not overlaps.any() and not pulls.any():
                settled = self._settled(strain, found.packing, active, found.force_c)
                # a rattler without room is none
                squeezed = settled is not None and self._margins(settled)["squeezing"] <= -_TOUCH
                return None if squeezed else settled
            force = np.zeros(len(near))
            keep = np.zeros(len(near), dtype=bool)
            where = self._places(near, active)
            force[where], keep[where] = found.force_c, ~pulls
            if not pulls.any():
                keep[overlaps] = True
            rattling = rattlers_of(near.select(keep))
            keep &= ~(rattling[near.i_c] | rattling[near.j_c])
            active, force_c, packing = near.select(keep).pairs, force[keep], found.packing
        return None

    def _relabeled(self, vertex: ShapeVertex) -> ShapeVertex:
        """Return the vertex with short lattice vectors and particles in the cell, where they have gone far."""
        renewed = self.lattice.renewed(vertex.packing, vertex.contacts)
        if renewed is None:
            return vertex
        packing, moved = renewed
        pairs = vertex.contacts.pairs
        order = np.lexsort((*moved.T[::-1], pairs.j_c, pairs.i_c))
        active = Candidates(pairs.i_c[order], pairs.j_c[order], np.ascontiguousarray(moved[order]))
        found = self._settled(vertex.strain, packing, active, vertex.force_c[order], stable=False)
        if found is None:
            raise Lost
        return replace(found, rate_c=vertex.rate_c[order])
