"""One soft packing on its way along a strain, volume, pressure or stresses held, from equilibrium to equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.pairs import pair_names
from packmech.contacts.rattlers import rattlers_of
from packmech.measure.contact_forces import resting_forces
from packmech.measure.displacements import displacements
from packmech.minimize.second_order.soft_network import Load, Response, SoftNetwork, scaled_load
from packmech.minimize.second_order.soft_newton import SoftState, descend, find_bottom, newton
from packmech.packing import Packing
from packmech.protocols.continuation import Step, StepLengths, follow
from packmech.protocols.protocol import Protocol
from packmech.protocols.shearing.sheared_lattice import ShearedLattice, StrainedLattice
from packmech.protocols.soft import equilibrium, search_pressure

Pairs = frozenset[tuple[int, ...]]

# an equilibrium this near where the tangent leads, over the way, is the same one gone on; and rounding [diameter]
_CORRECTED, _ROUNDED = 2.0, 1e-8
# strain behind its last equilibrium by which a packing that does not go on is taken to fall: the same for steps of any
# length, as it falls to other packings from farther behind; and by how much more where it finds no balance so near
WIDTH, _WIDER = 1e-8, (1.0, 10.0, 100.0)
# part of the way to a predicted change that is left at the next tangent; tangents on either side, and the strain before
# or behind the change that is near enough
_LEFT, _TANGENTS, _NEARLY = 0.02, 60, 2e-13
# part of the enthalpy that is rounding
_ROUNDED_ENERGY = 1e-13
# strains nearer than this differ by rounding
_ROUNDED_STRAIN = 1e-15
# farther tangents are not believed, their error being of second order
_TRUSTED = 1e-11
# largest strain between the equilibria on both sides of a change that is found by halving
_HALVED = 1e-10
# net force over the mean one of an equilibrium on the way, where rounding allows it
_BALANCED = 1e-10
# net forces far from rattlers over the largest, which is on one that is pushed
_ELSEWHERE = 1e-2
# how often half as far behind a change an equilibrium is looked for
_ENDS = 6
# a packing that is back is as near as this to where it fell from, over how far it fell
_BACK = 1e-2
# relaxation by FIRE where Newton's method finds no equilibrium after an instability
_TOLERANCE, _STEPS, _ROUNDS = 1e-3, 200_000, 3


@dataclass(frozen=True, eq=False)
class Sheared:
    """A packing in equilibrium at a strain, in reduced units, and how it answers to more of it.

    Attributes
    ----------
    strain
        Strain since the start.
    packing, network
        The packing and what Newton's method sees of it.
    pairs
        Contacts of particles that are no rattlers, as (i, j, image).
    answer
        Its linear response to the strain.
    energy, pressure, stress
        Energy [energy], pressure, and stress along the strain [energy/length^d], tension positive.
    enthalpy
        Energy, and pressure held times volume [energy].
    volume
        Of the box [length^d].
    residual
        Largest net force over the mean contact force.
    curvature
        Second derivative of the enthalpy by the strain [energy].
    held_n
        (N,) particles that are no rattlers.

    """

    strain: float
    packing: Packing
    network: SoftNetwork
    pairs: Pairs
    answer: Response
    energy: float
    pressure: float
    stress: float
    enthalpy: float
    volume: float
    residual: float
    curvature: float
    held_n: NDArray[np.bool_]

    @property
    def modulus(self) -> float:
        """Tangent modulus of the strain: its curvature over the volume [energy/length^d]."""
        return self.curvature / self.volume

    @property
    def slope(self) -> float:
        """Derivative of the enthalpy by the strain [energy]."""
        return self.stress * self.volume


class Located(NamedTuple):
    """A change of contacts found from both sides.

    `below` and `above` are its strain by tangents before and behind it; `tangents` are strains of tangents before it
    and the strains that they predict; `pair` is the one that changes and `opened` whether it opens; the packings
    are those nearest to it on both sides, and the one at it. Where the packing falls at the change `after` is None, and
    `above` the nearest strain behind it that has no equilibrium nearby.
    """

    below: float
    above: float
    tangents: tuple[tuple[float, float], ...]
    pair: tuple[int, ...]
    opened: bool
    before: Sheared
    there: Sheared
    after: Sheared | None


class StrainPath:
    """One packing on its way in strain.

    Parameters
    ----------
    protocol
        The protocol of a packing at rest; its free strains are those that the box makes by itself: none at constant
        volume, the isotropic one at constant pressure.
    lattice
        What the strain does to the box.
    load
        Pressure [energy/length^d] or stress that is held; None: neither.

    """

    def __init__(
        self, protocol: Protocol, lattice: ShearedLattice | StrainedLattice, load: float | Load | None
    ) -> None:
        self.protocol, self.lattice = protocol, lattice
        # a stress has no enthalpy
        self.pressure = load if isinstance(load, float) else 0.0
        scene, d = protocol.scene, protocol.scene.packing.dimension
        self.unit = protocol.length**d / scene.energy_scale
        self.load = scaled_load(load, self.unit)
        packing = protocol.reduced(scene.packing)
        self.shear_dd = self.lattice.shear_dd
        self.tolerance = max(protocol.force_tolerance, 1e-7)
        # where a contact has just opened and nothing balances what it bore, forces are off by little: such a packing
        # is about to fall, while Newton's method comes to rounding wherever there is balance
        self._gone_on = _BALANCED if packing.plain else self.tolerance
        self.iterations = 0
        # energy that may be missing at the end of a step, of what its work gave [energy]
        self.largest_loss = math.inf
        state = self._relaxed(packing)
        self.iterations += state.iterations
        self.sound = state.sound(self.tolerance)
        self.now = self._measured(0.0, state)

    def _relaxed(self, packing: Packing, held_n: NDArray[np.bool_] | None = None) -> SoftState:
        """Return the equilibrium nearby; `held_n` are the particles that were no rattlers."""
        protocol = self.protocol
        found = equilibrium(protocol, packing, self.load)
        if found.sound(self._gone_on) or held_n is None or not packing.plain:
            return found
        if not self._rattlers_pushed(found.packing, held_n):
            return found
        self.iterations += found.iterations
        return descend(packing, protocol.units, protocol.basis_kdd, self.load, watch=protocol.in_time)

    def _rattlers_pushed(self, packing: Packing, held_n: NDArray[np.bool_]) -> bool:
        """Return whether forces are off only where rattlers are pushed: without stiffness Newton's steps stop there."""
        network = SoftNetwork(packing, self.protocol.units, self.protocol.basis_kdd, self.load)
        near = network.contacts
        loose = ~held_n
        pushed = loose.copy()
        for one_c, other_c in ((near.i_c, near.j_c), (near.j_c, near.i_c)):
            pushed[one_c[loose[other_c]]] = True
        force_n = np.linalg.norm(network.uphill_nd, axis=1)
        return bool((force_n[~pushed] <= _ELSEWHERE * force_n.max()).all())

    def _measured(self, strain: float, state: SoftState) -> Sheared:
        packing = state.packing
        network = SoftNetwork(packing, self.protocol.units, self.protocol.basis_kdd, self.load)
        restored = self.protocol.restored(packing)
        found = resting_forces(self.protocol.scene.replace(packing=restored))
        d, volume, own, stress = packing.dimension, restored.box.volume, found.energy, found.stress_dd
        along = float((0.5 * (stress + stress.T) * self.shear_dd).sum())
        pairs, held = bearing_pairs(packing, network)
        answer = network.response(self.shear_dd)
        return Sheared(
            strain, packing, network, pairs, answer, own,
            (0.0 - float(np.trace(stress))) / d, along, own + self.pressure * volume, volume, state.residual,
            answer.curvature * self.protocol.scene.energy_scale, held,
        )  # fmt: skip

    def _ahead(self, start: Sheared, strain: float) -> Packing:
        """Return the packing at another strain, along the linear response."""
        return self.lattice.moved_on(start.packing, start.strain, strain, start.answer.u_nd, start.answer.gradient_dd)

    def at(self, start: Sheared, strain: float) -> Sheared | None:
        """Return the equilibrium of a packing gone on to another strain; None where it does not go on."""
        self.protocol.loop.check_time()
        ahead = self._ahead(start, strain)
        state = self._relaxed(ahead, start.held_n)
        self.iterations += state.iterations
        if not state.sound(self._gone_on):
            return None
        moved = state.packing.position_nd - ahead.position_nd
        held = start.held_n
        if held.any():
            moved = moved[held] - moved[held].mean(axis=0)
            d = moved.shape[1]
            way = abs(strain - start.strain) * max(1.0, float(np.abs(start.answer.u_nd[:, :d][held]).max()))
            if float(np.abs(moved).max()) > _CORRECTED * way + _ROUNDED:
                return None
        found = self._measured(strain, state)
        lost = start.enthalpy + work_between(start, found) - found.enthalpy
        # of either sign, as cubics err where contacts change; never below rounding
        allowed = max(self.largest_loss, _ROUNDED_ENERGY * abs(start.enthalpy))
        return None if abs(lost) > allowed else found

    def step(self, strain: float, way: float | None = None) -> tuple[Sheared, Sheared | None]:
        """Return the last equilibrium on the way to a strain, and None, or the next one where it becomes unstable.

        The first is the equilibrium at that strain wherever the packing goes on to it.

        Parameters
        ----------
        strain
            Where to go.
        way
            A packing that has no equilibrium just behind it is taken on by so much strain only; None: all the way.

        """
        reached = self.now
        if way is None:
            # the last halving leaves half of it at least, which rounding may make longer
            lengths = StepLengths(growth=math.inf, shortest=min(1.001 * WIDTH, abs(strain - reached.strain)))
        else:
            lengths = StepLengths(way, shortest=2.001 * way, left=way)

        def fall(start: Sheared, place: float, further: float) -> Step[Sheared, str]:
            return self._fall(start, further, strain)

        for one in follow(self._reach, reached, reached.strain, strain, lengths, fall):
            self.now = one.after
            if one.event is not None:
                return reached, one.after
            reached = one.after
            if way is not None:
                break
        return reached, None

    def _reach(self, start: Sheared, place: float, further: float) -> Step[Sheared, str] | None:
        found = self.at(start, further)
        return None if found is None else Step(found, further)

    def _fall(self, start: Sheared, further: float, goal: float) -> Step[Sheared, str]:
        sound: Step[Sheared, str] | None = None
        for wider in _WIDER:
            at = start.strain + wider * (further - start.strain)
            if abs(at - start.strain) >= abs(goal - start.strain):
                at = goal
            step = Step(self._fallen(start, at), at, "fall")
            # contacts that have just opened push next to nothing: what is not quite balance looks like rest
            if self.sound and step.after.residual <= self._gone_on:
                return step
            sound = step if self.sound else sound
            if at == goal:
                break
        self.sound = sound is not None
        return sound or step

    def _fallen(self, start: Sheared, strain: float) -> Sheared:
        """Return the equilibrium that an unstable packing falls to."""
        still = np.zeros_like(start.answer.u_nd)
        packing = self.lattice.moved_on(start.packing, start.strain, strain, still, self.shear_dd)
        protocol = self.protocol
        state = find_bottom(
            packing, protocol.units, protocol.basis_kdd, self.load, self.tolerance, watch=protocol.in_time
        )
        self.iterations += state.iterations
        if not state.sound(self.tolerance) and packing.plain:
            state = self._relaxed_by_fire(packing)
        self.sound = state.sound(self.tolerance)
        return self._measured(strain, state)

    def _relaxed_by_fire(self, packing: Packing) -> SoftState:
        protocol = self.protocol
        if self.load is not None:
            return search_pressure(protocol, packing, self.load)
        tolerance = _TOLERANCE
        state = None
        for _ in range(_ROUNDS):
            relaxed, done = protocol.relax(protocol.restored(packing), tolerance, _STEPS)
            packing = protocol.reduced(relaxed)
            state = newton(packing, protocol.units, protocol.basis_kdd, None, watch=protocol.in_time)
            self.iterations += state.iterations + done.steps
            if state.sound(self.tolerance):
                break
            tolerance *= 1e-2
        assert state is not None
        return state

    def comes_back(self, before: Sheared, after: Sheared) -> bool:
        """Return whether a packing that fell returns to where it fell from when it is sheared back by as much.

        Particles that are no rattlers then end within a hundredth of what the fall moved them by, at the root mean
        square.
        """
        kept, sound = self.now, self.sound
        self.now = after
        reached, fallen = self.step(before.strain)
        self.now, self.sound = kept, sound
        held = before.held_n & after.held_n
        there = fallen or reached
        return there.strain == before.strain and _apart(before, there, held) <= _BACK * _apart(before, after, held)

    # changes of contacts

    def predicted(self, one: Sheared, direction: float, known: Pairs) -> tuple[float, tuple[int, ...] | None]:
        """Return the strain at which the tangent lets a contact change first, and which; infinite without any."""
        near = one.network.near(one.packing)
        rate = one.network.gap_rates(near, one.answer) * math.copysign(1.0, direction)
        held = one.held_n
        names = pair_names(near)
        own = np.array([name in known for name in names], dtype=bool)
        gap = near.gap_c
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.where(own, -gap / rate, gap / -rate)
        valid = held[near.i_c] & held[near.j_c] & np.isfinite(way)
        valid &= np.where(own, (rate > 0.0) & (gap <= 0.0), (rate < 0.0) & (gap >= 0.0))
        if not valid.any():
            return math.copysign(math.inf, direction), None
        c = int(np.flatnonzero(valid)[np.argmin(way[valid])])
        return one.strain + math.copysign(float(way[c]), direction), names[c]

    def _tangent_to(self, one: Sheared, pair: tuple[int, ...]) -> float:
        """Return the strain at which the tangent of an equilibrium gives a pair no gap."""
        near = one.network.near(one.packing)
        names = pair_names(near)
        if pair not in names:
            return math.nan
        c = names.index(pair)
        return one.strain - float(near.gap_c[c] / one.network.gap_rates(near, one.answer)[c])

    def locate(self, start: Sheared, beyond: float) -> Located | None:
        """Return the first change of contacts between an equilibrium and a strain, None where none can be located.

        Tangents are renewed ever nearer to what they predict, first before the change and then behind it.
        """
        direction = math.copysign(1.0, beyond - start.strain)
        known, one = start.pairs, start
        tangents: list[tuple[float, float]] = []
        pair: tuple[int, ...] | None = None
        limit = beyond
        behind: Sheared | None = None
        for _ in range(_TANGENTS):
            there, pair = self.predicted(one, direction, known)
            if pair is None:
                break
            tangents.append((one.strain, there))
            # a tangent may lead beyond the limit, of which rounding leaves no more to be halved
            if abs(there - one.strain) <= _NEARLY or abs(limit - one.strain) <= _ROUNDED_STRAIN:
                break
            aim = there - _LEFT * (there - one.strain)
            if (aim - limit) * direction > 0.0:
                aim = 0.5 * (one.strain + limit)
            following = self.at(one, aim)
            while (following is None or following.pairs != known) and abs(aim - one.strain) > _ROUNDED_STRAIN:
                limit, behind = aim, following or behind
                aim = one.strain + 0.5 * (aim - one.strain)
                following = self.at(one, aim)
            if following is None or following.pairs != known:
                break
            one = following
        below = tangents[-1][1] if tangents else math.inf
        if pair is not None and abs(below - one.strain) <= _TRUSTED:
            way = max(abs(below - start.strain), abs(below - one.strain))
            there_now, side = self.at(one, below), self._behind(one, below, pair, direction * way)
            if there_now is not None and side is not None:
                return Located(below, side[0], tuple(tangents), pair, pair in known, one, there_now, side[1])
            end = self._ended(one, below, direction)
            if there_now is not None and end is not None:
                return Located(below, end, tuple(tangents), pair, pair in known, one, there_now, None)
        return self._bisected(one, limit, behind, tuple(tangents))

    def _ended(self, before: Sheared, strain: float, direction: float) -> float | None:
        """Return the nearest strain behind a change that has no equilibrium nearby; None where a change goes on."""
        end = None
        for k in range(_ENDS):
            far = strain + direction * _TRUSTED * 0.5**k
            if self.at(before, far) is not None:
                break
            end = far
        return end

    def _bisected(
        self, before: Sheared, beyond: float, after: Sheared | None, tangents: tuple[tuple[float, float], ...]
    ) -> Located | None:
        """Return a change that tangents do not see from both sides, by halving: several contacts at once."""
        known, end = before.pairs, beyond
        while True:
            middle = 0.5 * (before.strain + end)
            if abs(end - before.strain) <= _NEARLY or middle in (before.strain, end):
                break
            one = self.at(before, middle)
            if one is not None and one.pairs == known:
                before = one
            else:
                end = middle
                # where contacts bear next to nothing rounding may keep a packing from balance: the nearest that has it
                after = one or after
        if after is None:
            after = self.at(before, end)
        if after is None or after.pairs == known or abs(after.strain - before.strain) > _HALVED:
            return None
        pair = min(after.pairs ^ known)
        return Located(before.strain, after.strain, tangents, pair, pair in known, before, after, after)

    def _behind(
        self, before: Sheared, strain: float, pair: tuple[int, ...], way: float
    ) -> tuple[float, Sheared] | None:
        """Return the strain of a pair's change by tangents behind it, and the equilibrium nearest to it there."""
        changed = before.pairs ^ {pair}
        far = 0.25 * way
        one: Sheared | None = None
        for _ in range(40):
            one = self.at(before, strain + far)
            if one is not None and one.pairs == changed:
                break
            far, one = 0.5 * far, None
            if abs(far) < _ROUNDED_STRAIN:
                break
        if one is None:
            return None
        last = math.nan
        for _ in range(_TANGENTS):
            found = self._tangent_to(one, pair)
            if not math.isfinite(found):
                break
            last = found
            if abs(one.strain - found) <= _NEARLY:
                break
            nearer = self.at(one, found + _LEFT * (one.strain - found))
            if nearer is None or nearer.pairs != changed:
                break
            one = nearer
        return (last, one) if abs(one.strain - last) <= _TRUSTED else None


def _apart(one: Sheared, other: Sheared, held_n: NDArray[np.bool_]) -> float:
    """Return how far particles are apart in two packings, at the root mean square about the mean."""
    moved_nd = displacements(one.packing, other.packing).nonaffine_nd[held_n]
    return float(np.sqrt(((moved_nd - moved_nd.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(moved_nd) else math.inf


def work_between(one: Sheared, other: Sheared) -> float:
    """Return the work of the shear stress on the way between two equilibria, by cubics through stress and modulus.

    Exact to the fourth order of the strain between them where no contact changes on the way.
    """
    step = other.strain - one.strain
    return step * 0.5 * (one.slope + other.slope) + step**2 / 12.0 * (one.curvature - other.curvature)


def bearing_pairs(packing: Packing, network: SoftNetwork) -> tuple[Pairs, NDArray[np.bool_]]:
    """Return the touching pairs of particles that are no rattlers, and which particles are none."""
    near = network.contacts
    if packing.links:
        # which clusters are held takes a linear program: what bears next to nothing is none
        push = np.abs(network.first_c)
        bears = push > 1e-7 * push.mean() if len(push) else np.zeros(0, dtype=bool)
        held = near.select(bears).count_n() > 0
    else:
        held = ~rattlers_of(near, network.held_n)
        bears = held[near.i_c] & held[near.j_c]
    return frozenset(pair_names(near.select(bears))), held
