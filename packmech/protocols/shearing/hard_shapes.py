"""The network of a hard packing of shapes that shears, exactly, at zero pressure: its forces are among the unknowns.

Forces of hard shapes are the multipliers of the least volume: with positions, turns, volume and forces as unknowns
Newton's method solves for balance and for gaps that are zero at once. No stiffness enters, so that motions which only
the curvature of the shapes resists, thousands of times softer than contacts at any small pressure, are as easy as all
others, and packings may have fewer contacts than degrees of freedom. So

- a pair that closes bears forces from there on, and only where there are as many contacts as one state of self stress
  needs already does another open for it;
- a contact whose force falls to zero opens, and the packing goes on where the curvature holds it without;
- where the volume has no minimum nearby any more, with the contact that opened or where a curvature falls to zero, it
  falls downhill, soft, at a small pressure, and from there to the hard packing.

Forces of hypostatic packings of ellipsoids: Donev et al., Phys. Rev. E 75, 051304 (2007).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.elements import sum_ends
from packmech.contacts.network import Candidates
from packmech.contacts.pairs import are_among, places_among
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.jamming.room import AT_ONCE
from packmech.minimize.second_order.soft_network import REACH, Response, SoftNetwork, Units
from packmech.minimize.second_order.soft_newton import descend
from packmech.packing import Packing
from packmech.protocols.continuation import Lost
from packmech.protocols.shearing.hard_path import TOUCH, HardNetwork, Rates, Vertex

# stiffness of the augmented Lagrangian, whose multipliers are of order one: its inverse is the rate of convergence
_STIFFNESS, _TRACE, _PASSES = 1e6, 1e-14, 3
_ITERATIONS, _IDLE = 30, 4
# forces balance to this over the mean one
_BALANCED = 1e-9
# force over the mean one that counts as none, and rate of a force or gap that does
_NO_FORCE, _NO_RATE = 1e-7, 1e-9
# pressures at which it falls, over that asked for; iterations down; pressures on the way to none
_HARDER, _DOWNHILL, _SOFTER, _ROUNDS, _SOUND = (1.0, 10.0, 100.0), 200, (1.0, 0.1, 1e-2, 1e-3), 12, 1e-4


class _Lagrangian(SoftNetwork):
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
        corner[:k, k] += np.einsum("ab,kac,cb->k", self.gradient_dd, basis, shear_dd)
        right, right_k = -coupling[:, k], -corner[:k, k]
        rate_c = np.zeros(len(self.force_c))
        step, strain_k = np.zeros(found.size), np.zeros(k)
        for _ in range(_PASSES):
            more, more_k, _ = found.solved(right, right_k, coupling[:, :k], corner[:k, :k])
            step, strain_k = step + more, strain_k + more_k
            gradient = shear_dd + np.einsum("k,kab->ab", strain_k, basis)
            answer = Response(self.spread(found, step), strain_k, gradient, 0.0)
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


class HardShapes(HardNetwork):
    """The network of a hard packing of shapes.

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

    Raises
    ------
    Lost
        If there is no hard packing nearby.

    """

    ends, falls_by = "instability", "downhill"
    beyond = 2e-9
    farther = (1e-4, 1e-3)

    def __init__(
        self,
        packing: Packing,
        units: Units,
        pressure: float,
        axes: tuple[int, int],
        watch: Callable[[Packing], None] | None = None,
    ) -> None:
        super().__init__(packing, axes)
        self.units, self.pressure, self._watch = units, pressure, watch
        start = self._hardened(packing, 0.0, pressure)
        if start is None:
            raise Lost
        self.start = start

    def _settled(
        self, strain: float, packing: Packing, active: Candidates, force_c: NDArray[np.float64], *, stable: bool = True
    ) -> Vertex | None:
        """Return the packing of the given contacts in the box of a strain; None where they have none, or no minimum."""
        network = _Lagrangian(packing, self.isotropic_kdd, active, force_c)
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
        if gap_error > TOUCH or imbalance > _BALANCED or (stable and negative):
            return None
        return self._vertex(strain, network, gap_error, imbalance)

    def _vertex(self, strain: float, network: _Lagrangian, gap_error: float, imbalance: float) -> Vertex | None:
        try:
            answer, rate_c = network.hard_response(self.shear_dd)
        except (np.linalg.LinAlgError, RuntimeError, ValueError):
            return None
        self.factorizations += 1
        packing, rates = network.packing, Rates(answer.u_nd, answer.gradient_dd, rate_c)
        near = self.near(packing)
        return Vertex(strain, packing, network.contacts, network.force_c, gap_error, imbalance, rates, near)

    def at(self, start: Vertex, strain: float) -> Vertex | None:
        """Return what the network of a vertex gives at another strain, whatever its rattlers overlap; None without."""
        ahead, step = self.ahead(start, strain), strain - start.strain
        found = self._settled(strain, ahead, start.contacts.pairs, start.force_c + step * start.rates.force_c)
        return found if found is not None and self.is_as_led(start, ahead, found.packing, step) else None

    def exchanged(self, vertex: Vertex, cause: str, direction: float) -> tuple[Vertex, Vertex] | None:
        """Return the vertex, and the packing with the contacts that have just closed, or without those that opened."""
        after = None
        if cause == "closing":
            after = self._with_closed(vertex, direction)
        elif cause == "opening":
            after = self._with_opened(vertex, direction)
        return None if after is None else (vertex, self.with_room(after))

    def _with_opened(self, vertex: Vertex, direction: float) -> Vertex | None:
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
        return after if (after.gap_rates(apart) * direction > -_NO_RATE).all() else None

    def _with_closed(self, vertex: Vertex, direction: float) -> Vertex | None:
        """Return the packing with the pairs that have just closed, without those that open for them."""
        near, live = vertex.near, vertex.live_n
        where = places_among(vertex.contacts, near)
        closed = live[near.i_c] & live[near.j_c] & (np.abs(near.gap_c) < AT_ONCE * near.contact_distance_c)
        closed[where] = False
        force = np.zeros(len(near))
        force[where] = vertex.force_c
        chosen = closed.copy()
        chosen[where] = True
        turning = vertex.packing.turn_nkt[live]
        free = (int(live.sum()) - 1) * near.dimension + int((turning != 0.0).any(axis=2).sum()) + 1
        if chosen.sum() > free:
            return self._exchanged(vertex, near, closed, force, direction)
        after = self._settled(vertex.strain, vertex.packing, near.select(chosen).pairs, force[chosen])
        if after is None:
            return None
        fresh = closed[chosen]
        return after if (after.rates.force_c[fresh] * direction > 0.0).all() else None

    def _exchanged(
        self,
        vertex: Vertex,
        near: ShapeContacts,
        closed: NDArray[np.bool_],
        force: NDArray[np.float64],
        direction: float,
    ) -> Vertex | None:
        """Return the packing where a contact takes over from another, there being a second state of self stress."""
        network = _Lagrangian(vertex.packing, self.isotropic_kdd, vertex.contacts.pairs, vertex.force_c)
        fresh = near.select(closed)
        if len(fresh) != 1:
            return None
        # a unit force of the new contact, and what the others do against it
        found = network.coupled(self.isotropic_kdd, _TRACE * _STIFFNESS)
        right, along = network.pulled(found.free_f, np.ones(1), fresh)
        step, strain_k, _ = found.solved(right, along, found.coupling_fk, found.corner_kk)
        self.factorizations += 1
        gradient = np.einsum("k,kab->ab", strain_k, self.isotropic_kdd)
        answer = Response(network.spread(found, step), strain_k, gradient, 0.0)
        against = -_STIFFNESS * network.gap_rates(vertex.contacts, answer)
        falling = against < -_NO_RATE
        if not falling.any():
            return None
        ratio = np.where(falling, vertex.force_c / np.where(falling, -against, 1.0), np.inf)
        share = float(ratio.min())
        new = vertex.force_c + share * against
        bears = np.ones(len(new), dtype=bool)
        bears[int(np.argmin(ratio))] = False
        where = places_among(vertex.contacts, near)
        force[where], force[closed] = new, share
        chosen = closed.copy()
        chosen[where[bears]] = True
        return self._settled(vertex.strain, vertex.packing, near.select(chosen).pairs, force[chosen])

    def fallen(self, vertex: Vertex, strain: float) -> Vertex | None:
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

    def _hardened(self, packing: Packing, strain: float, pressure: float) -> Vertex | None:
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
            network = SoftNetwork(packing, self.units, self.isotropic_kdd, at)
            contacts = network.contacts
            if not len(contacts):
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
    ) -> Vertex | None:
        """Return the hard packing nearby, contacts that would pull given up and pairs that would overlap taken in."""
        for _ in range(_ROUNDS):
            if not len(force_c):
                return None
            found = self._settled(strain, packing, active, force_c, stable=False)
            if found is None:
                return None
            near, live = found.near, found.live_n
            bearing = are_among(near, active)
            overlaps = ~bearing & live[near.i_c] & live[near.j_c] & (near.gap_c < -TOUCH * near.contact_distance_c)
            pulls = found.force_c <= _NO_FORCE * found.force_c.mean()
            if not overlaps.any() and not pulls.any():
                settled = self._settled(strain, found.packing, active, found.force_c)
                settled = None if settled is None else self.with_room(settled)
                # a rattler without room is none
                return None if settled is None or settled.squeezing <= -TOUCH else settled
            force = np.zeros(len(near))
            keep = np.zeros(len(near), dtype=bool)
            where = places_among(active, near)
            force[where], keep[where] = found.force_c, ~pulls
            if not pulls.any():
                keep[overlaps] = True
            rattling = rattlers_of(near.select(keep))
            keep &= ~(rattling[near.i_c] | rattling[near.j_c])
            active, force_c, packing = near.select(keep).pairs, force[keep], found.packing
        return None

    def relisted(self, vertex: Vertex, packing: Packing, pairs: Candidates, order: NDArray[np.int64]) -> Vertex | None:
        """Return a vertex whose packing and contacts, in another order, have other labels; None where it is lost."""
        found = self._settled(vertex.strain, packing, pairs, vertex.force_c[order], stable=False)
        if found is None:
            return None
        return replace(found, rates=found.rates._replace(force_c=vertex.rates.force_c[order]))
