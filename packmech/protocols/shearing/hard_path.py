"""A hard packing followed while its box shears: along its contact network, and across the changes between networks.

At each shear strain Newton's method gives the hard packing of a network exactly. The network lasts until

- a pair that did not touch closes, or the force of a contact falls to zero, and the packing goes on where it stands
  with a network that exchanges contacts (`HardNetwork.exchanged`): positions and volume are continuous;
- nothing holds the packing any more. It falls to the next hard packing (`HardNetwork.fallen`): packing fraction jumps.

Rattlers are kept apart from what surrounds them, by linear programs for the largest smallest gap over all pairs that
these can bring together; one that is squeezed closes d + 1 contacts at once. Families of sheared packings: Schreck and
O'Hern, section 2.2 of their chapter.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import Candidates
from packmech.contacts.overlaps import HARD
from packmech.contacts.pairs import are_among, measure_pairs, search_pairs
from packmech.jamming.room import AT_ONCE, NEAR, make_room
from packmech.packing import Packing
from packmech.protocols.continuation import Lost, Step, StepLengths, find_root, follow
from packmech.protocols.shearing.sheared_lattice import ShearedLattice

# contacts touch to this, below what hard particles may overlap by [contact distance]
TOUCH = 0.5 * HARD
# what is found must be this near where the rates lead, over the way
_CORRECTED, _ROUNDED = 0.25, 1e-9
# the shortest step of strain that is tried, and what a step grows by
_SHORTEST, _GROWTH = 1e-9, 3.0


class Rates(NamedTuple):
    """How a packing moves on with the shear strain.

    `u_nq` are motions beyond what the displacement gradient `gradient_dd` takes along, turns as lengths among them,
    and `force_c` how forces change; zero where the contacts alone determine them.
    """

    u_nq: NDArray[np.float64]
    gradient_dd: NDArray[np.float64]
    force_c: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Vertex:
    """An exact hard packing at a shear strain.

    Attributes
    ----------
    strain
        The shear strain since the start.
    packing
        The packing in reduced lengths, as it moves on from the start.
    contacts, force_c
        The contacts and their forces; those that have just closed may bear none yet.
    gap_error, force_imbalance
        Largest gap or overlap of a contact [length], and largest net force over the mean.
    rates
        How it moves on with the strain.
    near
        All pairs that are near.

    """

    strain: float
    packing: Packing
    contacts: Any
    force_c: NDArray[np.float64]
    gap_error: float
    force_imbalance: float
    rates: Rates
    near: Any

    @property
    def live_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that bear forces."""
        return np.asarray(self.contacts.count_n() > 0)

    @property
    def closing(self) -> float:
        """Smallest gap of a pair that is no contact, both particles bearing forces [contact distance]."""
        near, live = self.near, self.live_n
        apart = live[near.i_c] & live[near.j_c] & ~are_among(near, self.contacts)
        return float((near.gap_c / near.contact_distance_c)[apart].min(initial=NEAR))

    @property
    def opening(self) -> float:
        """Smallest force of a contact over the mean one."""
        return float(self.force_c.min() / self.force_c.mean())

    @property
    def squeezing(self) -> float:
        """Smallest gap of a rattler [contact distance]."""
        near, live = self.near, self.live_n
        loose = ~(live[near.i_c] & live[near.j_c])
        return float((near.gap_c / near.contact_distance_c)[loose].min(initial=NEAR))

    def stress_ratio(self, axes: tuple[int, int]) -> float:
        """Return shear stress over pressure, stress with tension positive: d ln(volume) / d(strain)."""
        one, (flow, gradient) = self.contacts, axes
        pull_cd = self.force_c[:, None] * one.slope_cx[:, : one.dimension]
        moment = float((pull_cd[:, flow] * one.vector_cd[:, gradient]).sum())
        return -moment * float(one.dimension) / float((pull_cd * one.vector_cd).sum())

    def gap_rates(self, near: Any) -> NDArray[np.float64]:
        """Return how fast the distances of pairs change with the strain."""
        d, rates = near.dimension, self.rates
        turned = np.einsum("nk,nkt->nt", rates.u_nq[:, d:], self.packing.turn_nkt)
        moved = rates.u_nq[near.j_c, :d] - rates.u_nq[near.i_c, :d] + near.vector_cd @ rates.gradient_dd.T
        whole = np.hstack([moved, turned[near.i_c], turned[near.j_c]])
        return np.asarray((near.slope_cx * whole).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Change:
    """One change of the contact network.

    Attributes
    ----------
    before, after
        The packings on both sides.
    cause
        "closing": a contact closed, "squeezing": a rattler was, "opening": the force of a contact fell to zero,
        `HardNetwork.ends`: the network ends for another reason.
    moved
        Largest displacement of a particle that bears forces in both packings, beyond the mean one [length].
    identities
        Pairs (i, j, image) that bear forces before and after, of sites that touch, images those of the start.

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


class HardNetwork(abc.ABC):
    """What a hard packing of one kind of particles is at a strain, and where it goes on.

    Parameters
    ----------
    packing
        The packing at strain zero, in reduced lengths.
    axes
        Direction of the flow and of its gradient.

    Attributes
    ----------
    ends
        Name of the cause of a change where the network is lost and no contact says why.
    falls_by
        Name of how the next network is found where the packing does not go on continuously.
    beyond, farther
        How far beyond a change in strain the next packing is looked for, and, where there is none, how far next.
    factorizations
        How many were made.

    """

    ends: ClassVar[str]
    falls_by: ClassVar[str]
    beyond: ClassVar[float]
    farther: ClassVar[tuple[float, ...]] = ()

    def __init__(self, packing: Packing, axes: tuple[int, int]) -> None:
        d = packing.dimension
        self.axes = axes
        self.lattice = ShearedLattice(packing, axes)
        self.shear_dd = self.lattice.shear_dd
        self.isotropic_kdd = np.eye(d)[None] / math.sqrt(d)
        self.factorizations = 0

    @abc.abstractmethod
    def at(self, start: Vertex, strain: float) -> Vertex | None:
        """Return what the network of a vertex gives at another strain, whatever its rattlers overlap; None without."""

    @abc.abstractmethod
    def exchanged(self, vertex: Vertex, cause: str, direction: float) -> tuple[Vertex, Vertex] | None:
        """Return the vertex at a change, and that with the network with which it goes on where it stands; or None."""

    @abc.abstractmethod
    def fallen(self, vertex: Vertex, strain: float) -> Vertex | None:
        """Return the hard packing that is found next at a strain beyond a vertex, whatever its contacts; or None."""

    @abc.abstractmethod
    def relisted(self, vertex: Vertex, packing: Packing, pairs: Candidates, order: NDArray[np.int64]) -> Vertex | None:
        """Return a vertex whose packing and contacts, in another order, have other labels; None where it is lost."""

    def near(self, packing: Packing) -> Any:
        """Return all pairs that are near."""
        return measure_pairs(packing, search_pairs(packing, 1.0 + NEAR))

    def with_room(self, vertex: Vertex) -> Vertex:
        """Return the vertex with its rattlers as far apart as they can be."""
        packing, _, _ = make_room(vertex.packing, vertex.near, ~vertex.live_n)
        return vertex if packing is vertex.packing else replace(vertex, packing=packing, near=self.near(packing))

    def ahead(self, start: Vertex, strain: float) -> Packing:
        """Return the packing at another strain, along the rates."""
        return self.lattice.moved_on(start.packing, start.strain, strain, start.rates.u_nq, start.rates.gradient_dd)

    def is_as_led(self, start: Vertex, ahead: Packing, found: Packing, step: float) -> bool:
        """Return whether a packing is where the rates lead: the network's equations have several solutions."""
        live, d, rates = start.live_n, ahead.dimension, start.rates
        moved = (found.position_nd - ahead.position_nd)[live]
        corrected = float(np.abs(moved - moved.mean(axis=0)).max())
        way = max(1.0, float(np.abs(rates.u_nq[live, :d]).max()))
        turned = found.shapes.rotation_since(ahead.shapes)[live]
        turns = np.einsum("nk,nkt->nt", rates.u_nq[live, d:], start.packing.turn_nkt[live])
        corrected = max(corrected, float(np.abs(turned).max(initial=0.0)))
        way = max(way, float(np.abs(turns).max(initial=0.0)))
        return corrected <= _CORRECTED * way * abs(step) + _ROUNDED

    def relabeled(self, vertex: Vertex) -> Vertex:
        """Return the vertex with short lattice vectors and particles in the cell, where they have gone far.

        Raises
        ------
        Lost
            If it is none any more.

        """
        renewed = self.lattice.renewed(vertex.packing, vertex.contacts)
        if renewed is None:
            return vertex
        packing, moved = renewed
        pairs = vertex.contacts.pairs
        order = np.lexsort((*moved.T[::-1], pairs.j_c, pairs.i_c))
        chosen = Candidates(pairs.i_c[order], pairs.j_c[order], np.ascontiguousarray(moved[order]))
        found = self.relisted(vertex, packing, chosen, order)
        if found is None:
            raise Lost
        return found

    def identity(self, vertex: Vertex) -> frozenset[tuple[int, ...]]:
        """Return the contacts (i, j, image), of sites that touch, with the images of the start."""
        sites = vertex.contacts.pairs
        return self.lattice.identity(vertex.contacts, sites.i_c, sites.j_c)


class _VertexAhead(NamedTuple):
    """What the network gives at a strain: the vertex, its smallest margin, and what that is a margin of."""

    vertex: Vertex | None
    margin: float
    cause: str


def _beyond_touch(trial: _VertexAhead) -> float:
    """Return the margin of a trial beyond that at which its network ends."""
    return trial.margin + TOUCH


class HardPath:
    """A hard packing on its way along a shear strain.

    Parameters
    ----------
    network
        What its network is at each strain.
    vertex
        Where it starts, at strain zero.
    check_time
        Called before each step.

    """

    def __init__(self, network: HardNetwork, vertex: Vertex, check_time: Callable[[], None]) -> None:
        self.network, self.vertex, self._check_time = network, vertex, check_time
        self.axes = network.axes
        self._lengths = StepLengths(growth=_GROWTH, shortest=_SHORTEST)
        self._cause = network.ends

    @property
    def factorizations(self) -> int:
        """How many were made."""
        return self.network.factorizations

    def go(self, strain: float) -> Change | None:
        """Go on to a strain, or to the first change on the way; return that.

        Raises
        ------
        Lost
            If no hard packing is found after a fall.

        """
        for step in follow(self._reach, self.vertex, self.vertex.strain, strain, self._lengths, self._go_on):
            self.vertex = step.after
            if step.event is not None:
                return step.event
        return None

    def fall(self, direction: float, cause: str, beyond: float) -> Change:
        """Give the network up: go to the hard packing that is found next, whatever its contacts; return the change.

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
        self.vertex = self.network.relabeled(change.after)
        return change

    # steps

    def _reach(self, state: Vertex, place: float, further: float) -> Step[Vertex, Change] | None:
        """Return the step to a strain, or to the first change of the network before it; None where it fails."""
        self._check_time()
        trial = self._try(state, further)
        self._cause = trial.cause
        if trial.vertex is None:
            return None
        if trial.margin > -TOUCH:
            return None if _dips(state, trial.vertex) else self._stepped(trial.vertex)
        change = self._change(state, trial, further - place)
        if change is None:
            return None
        if not change.jumps and change.identities[0] == change.identities[1] and change.after.strain != place:
            # what rounding took for a change is none
            return self._stepped(change.after)
        way = abs(change.before.strain - place)
        # about twice the way between changes
        self._lengths.next = max(min(0.5 * self._lengths.next, 4.0 * way) + way, _SHORTEST)
        return self._stepped(change.after, change)

    def _go_on(self, state: Vertex, place: float, further: float) -> Step[Vertex, Change] | None:
        """Return the step to the network that goes on where the steps have become too short, or to a fall."""
        self._lengths.next = math.inf
        direction = math.copysign(1.0, further - place)
        # equal particles close more contacts than may stay so: those that bear forces from here on
        pair = self.network.exchanged(state, self.network.ends, direction)
        change = self._noted(*pair, "opening", 0.0) if pair else self._fall(state, self._cause, direction)
        return self._stepped(change.after, change)

    def _stepped(self, vertex: Vertex, change: Change | None = None) -> Step[Vertex, Change]:
        vertex = self.network.relabeled(vertex)
        return Step(vertex, vertex.strain, change)

    def _try(self, start: Vertex, strain: float, *, room: bool = True) -> _VertexAhead:
        """Return what the network of a vertex gives at a strain, rattlers apart where it still holds there."""
        vertex = self.network.at(start, strain)
        if vertex is None:
            return _VertexAhead(None, -math.inf, self.network.ends)
        trial = _VertexAhead(vertex, *min((vertex.closing, "closing"), (vertex.opening, "opening")))
        return self._with_room(trial) if room and trial.margin > -TOUCH else trial

    def _with_room(self, trial: _VertexAhead) -> _VertexAhead:
        """Return the trial with its rattlers as far apart as they can be, and their margin."""
        if trial.vertex is None:
            return trial
        vertex = self.network.with_room(trial.vertex)
        return _VertexAhead(vertex, *min((trial.margin, trial.cause), (vertex.squeezing, "squeezing")))

    def _change(self, start: Vertex, beyond: _VertexAhead, direction: float) -> Change | None:
        """Return the first change between a vertex and a strain at which its network is none any more.

        None where a rattler that is squeezed at the farther strain is not on the way there: in so long a step it was
        led elsewhere.
        """
        there = beyond
        if there.cause != "squeezing":
            # programs for rattlers cost more than the network: they are asked once it is known where that ends
            there = self._with_room(self._root(start, there, room=False))
        if there.cause == "squeezing" and there.margin <= -TOUCH:
            there = self._root(start, there, room=True)
        if there.vertex is None:
            return self._fall(start, self.network.ends, direction)
        if there.cause == "squeezing" and abs(there.margin) > AT_ONCE:
            return None
        pair = None
        if there.vertex.strain != start.strain:
            pair = self.network.exchanged(there.vertex, there.cause, direction)
        return self._noted(*pair, there.cause, 0.0) if pair else self._fall(there.vertex, there.cause, direction)

    def _root(self, start: Vertex, beyond: _VertexAhead, *, room: bool) -> _VertexAhead:
        """Return what is seen where the margin vanishes between a vertex and a strain at which it is negative."""
        assert beyond.vertex is not None

        def look(strain: float) -> _VertexAhead:
            return self._try(start, strain, room=room)

        return find_root(
            look,
            _beyond_touch,
            start.strain,
            beyond.vertex.strain,
            beyond,
            # a contact that has just been given up is still closed, one that has just closed bears nothing
            TOUCH,
        )

    def _fall(self, vertex: Vertex, cause: str, direction: float, beyond: float | None = None) -> Change:
        """Return the change to the hard packing nearby, where the network holds the packing no more.

        Raises
        ------
        Lost
            If none is found.

        """
        network, sign = self.network, math.copysign(1.0, direction)
        first = network.beyond if beyond is None else beyond
        for further in (first, *(one for one in network.farther if one > first)):
            after = network.fallen(vertex, vertex.strain + sign * further)
            if after is None:
                continue
            if further > first:
                # soft, it goes on a little further than hard: back to where that ends
                back = self._try(after, vertex.strain + sign * first)
                if back.vertex is not None and back.margin > -TOUCH:
                    after = back.vertex
            both = vertex.live_n & after.live_n
            moved = after.packing.position_nd @ after.packing.box.inverse_dd.T
            moved = (moved - vertex.packing.position_nd @ vertex.packing.box.inverse_dd.T)[both]
            moved = moved @ vertex.packing.box.lattice_dd.T
            moved = moved - moved.mean(axis=0) if len(moved) else np.zeros((1, 1))
            return self._noted(vertex, after, cause, float(np.sqrt((moved**2).sum(axis=1)).max()))
        raise Lost

    def _noted(self, before: Vertex, after: Vertex, cause: str, moved: float) -> Change:
        identity = self.network.identity
        return Change(before, after, cause, moved, (identity(before), identity(after)))


def _dips(start: Vertex, end: Vertex) -> bool:
    """Return whether a pair closes and opens again between two vertices, by cubics through gaps and their rates."""
    near, live = start.near, start.live_n
    there = measure_pairs(end.packing, near.pairs)
    both, size, step = live[near.i_c] & live[near.j_c], near.contact_distance_c, end.strain - start.strain
    first, last = near.gap_c / size, there.gap_c / size
    then, later = start.gap_rates(near) / size, end.gap_rates(there) / size
    for c in np.flatnonzero(both & (then * step < 0.0) & (later * step > 0.0)):
        place = np.linspace(0.0, 1.0, 33)
        gap = (
            first[c] * (1 + 2 * place) * (1 - place) ** 2
            + last[c] * place**2 * (3 - 2 * place)
            + step * (then[c] * place * (1 - place) ** 2 - later[c] * place**2 * (1 - place))
        )
        if float(gap.min()) < -AT_ONCE:
            return True
    return False
