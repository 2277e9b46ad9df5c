"""One jammed packing on its way from pressure to pressure, or from stress to stress, along its contact network."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.pairs import pair_names
from packmech.contacts.shape_contacts import touching_pairs
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import pressure as pressure_of
from packmech.measure.stress import stress_tensor
from packmech.minimize.second_order.soft_network import REACH, Load, SoftNetwork, isochoric_part
from packmech.minimize.second_order.soft_newton import (
    SoftState,
    find_bottom,
    judge,
    standing,
)
from packmech.packing import Packing
from packmech.protocols.continuation import Step, StepLengths, follow
from packmech.protocols.protocol import CHANGES, Protocol, report_changes
from packmech.protocols.soft import equilibrium, extrapolated, search_pressure
from packmech.result import Outcome

# largest ratio of successive pressures, the first one tried, and the smallest before contacts are let rearrange
_FACTOR, _FIRST, _MINIMUM_FACTOR = 4.0, 2.0, 1.05
# logarithm of a ratio of pressures too small to draw a line through two packings
_ALMOST = 0.01
# logarithms of a ratio of pressures that count as much as a change of the rest of the load by the pressure
_TURN = 10.0
# net force over mean contact force, and shear stress over pressure, that count as balance on the way, at least
_ISOTROPIC = 1e-7
# the last part of a short way that is not divided again
_SHORTEST = 0.2
# what rounding and the forces out of balance may add to the enthalpy between two steps, over its largest change [1]
_SLACK = 0.02
# smallest part of the work between two loads that is done on the way there, or on the way back, by what stays on its
# branch: a half, and as much more or less as contacts that change make of the stiffness
_UNEVEN = 0.2
# pressure [energy_scale / diameter^d] down to which a jammed packing is followed before its onset is looked for, and
# the second of the two on the line to the onset, in units of the first
_FOLLOWED_TO, _SECOND = 1e-5, 0.5
# missing stress over pressure up to which a packing in balance stays as it is: its packing fraction would change by
# less than this part of the overlaps [1]
_THERE = 1e-8


class PressurePath:
    """One packing on its way from load to load; loads and packings are in reduced units.

    Parameters
    ----------
    protocol
        The protocol.
    packing
        Where it begins; None: the scene's.

    """

    def __init__(self, protocol: Protocol, packing: Packing | None = None) -> None:
        self.protocol = protocol
        scene = protocol.scene if packing is None else protocol.scene.replace(packing=packing)
        self.packing = protocol.reduced(scene.packing)
        self.pressure = protocol.reduced_pressure(pressure_of(scene) / scene.pressure_unit)
        # where strains are free that a pressure alone does not change, the stress that they bear now
        shears = len(isochoric_part(protocol.basis_kdd, scene.packing.dimension)) > 0
        self.rest_dd = Load.of(stress_tensor(scene)).rest_dd if shears else None
        # whether that is to be set free
        self.sheared = self.rest_dd is not None and bool(
            np.abs(self.rest_dd).max() > max(protocol.force_tolerance, _ISOTROPIC)
        )
        # the packing before, and where on the way it was
        self.before: tuple[Packing, float] | None = None
        self.pairs = set(pair_names(touching_pairs(scene.packing)))
        self.tolerance = max(protocol.force_tolerance, _ISOTROPIC)
        # of the way in hand: its loads, lengths of steps, how often it rearranged, the work, and the packing tried last
        self.way, self.lengths = _Way(1.0, 1.0, None, None), StepLengths()
        self.rearrangements = self.iterations = 0
        self.tried: SoftState

    def go(self, pressure: float, rest_dd: NDArray[np.float64] | None = None) -> Outcome:
        """Go on to a load, its pressure in units of [energy_scale / diameter^d]; return how that ended.

        A packing that is at rest under the load stays as it is, to the last bit.
        """
        protocol = self.protocol
        self.rearrangements = self.iterations = 0
        self.sheared &= rest_dd is None
        self.way = way = _Way(self.pressure, protocol.reduced_pressure(pressure), self.rest_dd, rest_dd)
        # a way that almost nothing would be left of cannot be divided
        shortest = max(min(math.log(_MINIMUM_FACTOR), _SHORTEST * way.length), 2.0 * _ALMOST)
        self.lengths = StepLengths(math.log(_FIRST), math.log(_FACTOR), 1.5, shortest, left=_ALMOST)
        if rest_dd is not None:
            self.before = None
        with protocol.stage("following the pressure" if rest_dd is None else "following the stress") as figures:
            state = self.tried = standing(self.packing, protocol.units, protocol.basis_kdd, way.load(way.length))
            if not self._there(state):
                for step in follow(self._reach, self.packing, 0.0, way.length, self.lengths, self._rearrange):
                    self.packing, self.sheared = step.after, False
                    self.pressure, self.rest_dd = way.pressure(step.place), way.rest(step.place)
                    protocol.last = protocol.restored(self.packing)
                state = self.tried
            protocol.last = protocol.restored(state.packing)
            figures.residual = state.residual
            figures.steps = figures.force_evaluations = self.iterations
            figures.note = f"{self.rearrangements} rearrangements"
        self.pairs = report_changes(protocol, self.rearrangements, self.pairs)
        return judge(state, protocol.force_tolerance)

    def _reach(self, packing: Packing, place: float, further: float) -> Step[Packing, str] | None:
        """Return the step to a place, looked for on the line through the last two packings; None where it jumps."""
        protocol, way = self.protocol, self.way
        protocol.loop.check_time()
        start = packing
        if self.before is not None:
            start = extrapolated(*self.before, start, way.coordinate(place), way.coordinate(further))
        self.tried = state = equilibrium(protocol, start, way.load(further))
        self.iterations += state.iterations
        if not (state.sound(self.tolerance) and self._followed(packing, state.packing, place, further)):
            return None
        if abs(further - place) > _ALMOST:
            self.before = packing, way.coordinate(place)
        return self._arrived(further, None)

    def _rearrange(self, packing: Packing, place: float, further: float) -> Step[Packing, str] | None:
        """Return the step to where the way down in enthalpy leads; None where there is no balance."""
        protocol, load = self.protocol, self.way.load(further)
        self.rearrangements += 1
        self.before = None
        state = find_bottom(packing, protocol.units, protocol.basis_kdd, load, self.tolerance, watch=protocol.in_time)
        self.iterations += state.iterations
        self.tried = state if state.sound(self.tolerance) else search_pressure(protocol, packing, load)
        self.lengths.grow()
        return self._arrived(further, "rearranged") if self.tried.sound(self.tolerance) else None

    def _arrived(self, place: float, event: str | None) -> Step[Packing, str]:
        """Return the step to a packing in balance, at the end to the tolerance that was asked for where it can be."""
        protocol, state = self.protocol, self.tried
        if place == self.way.length and not state.sound(protocol.force_tolerance):
            # a contact that barely touches slows Newton's steps: those that only go down pass it
            load = self.way.load(place)
            tolerance, watch = protocol.force_tolerance, protocol.in_time
            lower = find_bottom(
                state.packing, protocol.units, protocol.basis_kdd, load, tolerance, watch=watch
            )  # fmt: skip
            self.iterations += lower.iterations
            if lower.sound(self.tolerance) and lower.residual < state.residual:
                self.tried = lower
        return Step(self.tried.packing, place, event)

    def go_down(self) -> Packing | None:
        """Return the packing at a pressure low enough to look for its onset, or None where it was lost on the way."""
        low = min(_FOLLOWED_TO, self.pressure / self.protocol.reduced_pressure(1.0))
        return self.protocol.last if self.go(low).ok else None

    def _there(self, state: SoftState) -> bool:
        """Return whether the packing, as it stands, is in stable balance under the load."""
        return state.sound(self.protocol.force_tolerance) and state.stress_error <= max(_THERE, state.least_error)

    def _followed(self, packing: Packing, reached: Packing, place: float, further: float) -> bool:
        """Return whether the step ended where the packing goes by itself, not in another minimum.

        Where it stays stable its volume V only falls with the pressure p, through changes of contacts, too. So its
        enthalpy H with dH/dp = V grows by an amount between V dp before and V dp after the step, and U + p V at the
        pressure before by one between 0 and -dV dp. What lies outside has jumped.
        Other loads have no enthalpy: see `stays_on_branch`.
        """
        before, now = self.way.load(place), self.way.load(further)
        if self.sheared:
            # where it stands no enthalpy is at a minimum
            return set(pair_names(touching_pairs(packing))) == set(pair_names(touching_pairs(reached)))
        if isinstance(before, Load) or isinstance(now, Load):
            return stays_on_branch(self.protocol, (packing, reached), (before, now))
        if moved_beyond_affine(packing, reached) > REACH:
            return False
        growth = SoftNetwork(packing, self.protocol.units, self.protocol.basis_kdd, before).growth_to(reached)
        largest = (packing.box.volume - reached.box.volume) * (now - before)
        return -_SLACK * largest <= growth <= (1.0 + _SLACK) * largest


def moved_beyond_affine(packing: Packing, reached: Packing) -> float:
    """Return the largest component of a displacement beyond that of the box [length]."""
    strain_dd = reached.box.lattice_dd @ packing.box.inverse_dd - np.eye(packing.dimension)
    moved_nd = reached.position_nd - packing.position_nd - packing.position_nd @ strain_dd.T
    return float(np.abs(moved_nd).max(initial=0.0))


def stays_on_branch(
    protocol: Protocol, packings: tuple[Packing, Packing], loads: tuple[float | Load, float | Load] | None = None
) -> bool:
    """Return whether a packing went from one balance to another by itself, and did not fall into another minimum.

    Its energy less the work of the load that it had grows on the way there, and less that of the load to come on the
    way back. Each of the two is about half of their sum where the stiffness stays; a fall takes from both.

    Parameters
    ----------
    protocol
        The protocol.
    packings
        The packing before and after, in reduced units.
    loads
        What they bear; None: the pressures that they have.

    """
    before, after = packings
    if moved_beyond_affine(before, after) > REACH:
        return False
    units, basis = protocol.units, protocol.basis_kdd
    first, last = (None, None) if loads is None else loads
    there = SoftNetwork(before, units, basis, first).growth_to(after)
    back = SoftNetwork(after, units, basis, last).growth_to(before)
    return min(there, back) >= _UNEVEN * (there + back)


def follow_jammed(
    protocol: Protocol, pressure: float, search: Callable[[Packing], object | None] | None = None
) -> tuple[Packing, Outcome]:
    """Return the scene's packing, which is jammed, followed to the pressure from where it stands, and how that ended.

    The packing fraction at which its overlaps would vanish goes into the report: that of the exact hard packing nearby,
    or that on the line through two packings where the search for one does not know the way. Both are looked for
    below 1e-5, where the packing is followed, too; `onset_rearrangements` says how often it rearranged on that way.

    Parameters
    ----------
    protocol
        The protocol; stages are added to it, and the figures of the hard packing to its report.
    pressure
        Pressure to reach [energy_scale / diameter^d].
    search
        Returns the exact hard packing near a packing at a small pressure, or None; None with links or shapes.

    """
    outcome = PressurePath(protocol).go(pressure)
    reached, changes = protocol.last, {name: protocol.report[name] for name in CHANGES}
    try:
        if outcome.ok:
            protocol.report["onset_rearrangements"] = _find_onset(protocol, reached, search)
    finally:
        protocol.last = reached
        protocol.report.update(changes)
    return reached, outcome


def _find_onset(protocol: Protocol, packing: Packing, search: Callable[[Packing], object | None] | None) -> int | None:
    """Report the onset of jamming of a packing; return how often it rearranged on the way, None if it was lost."""
    path = PressurePath(protocol, packing)
    near = path.go_down()
    rearrangements = int(protocol.report["rearrangements"])
    if near is None:
        return None
    if search is not None:
        search(near)
        return rearrangements
    depth = onset_depth(path.packing)
    if not path.go(_SECOND * path.pressure / protocol.reduced_pressure(1.0)).ok:
        return None
    report_onset(protocol, depth, onset_depth(path.packing))
    return rearrangements + int(protocol.report["rearrangements"])


def onset_depth(packing: Packing) -> tuple[float, float]:
    """Return packing fraction and mean relative overlap."""
    overlap = touching_pairs(packing).overlap_c
    return packing_fraction(packing), float(overlap.mean()) if len(overlap) else 0.0


def report_onset(protocol: Protocol, before: tuple[float, float], after: tuple[float, float]) -> None:
    """Put the packing fraction at which the overlaps would vanish into the report: the line through two packings."""
    if before[1] > after[1]:
        slope = (before[0] - after[0]) / (before[1] - after[1])
        protocol.report["jamming_packing_fraction"] = after[0] - slope * after[1]


class _Way:
    """The way from one load to another: by the pressure, or along a line where the rest of the load changes.

    Places on it are lengths in logarithms of the pressure, from 0 to `length`.
    """

    def __init__(
        self, now: float, goal: float, rest_dd: NDArray[np.float64] | None, goal_dd: NDArray[np.float64] | None
    ) -> None:
        self._now, self._goal, self._rest_dd, self._goal_dd = now, goal, rest_dd, goal_dd
        self.length = abs(math.log(goal / now))
        if rest_dd is not None and goal_dd is not None:
            self.length = max(self.length, _TURN * float(np.abs(goal_dd - rest_dd).max()))

    def coordinate(self, place: float) -> float:
        """Return what packings on the way are straight lines of: the pressure, or the part of the way."""
        return self.pressure(place) if self._goal_dd is None else 1.0 + place / self.length

    def pressure(self, place: float) -> float:
        """Return the pressure at a place."""
        return self._goal if place == self.length else self._now * (self._goal / self._now) ** (place / self.length)

    def rest(self, place: float) -> NDArray[np.float64] | None:
        """Return the rest of the load at a place, over its pressure."""
        if self._goal_dd is None or self._rest_dd is None or place == self.length:
            return self._goal_dd
        return self._rest_dd + place / self.length * (self._goal_dd - self._rest_dd)

    def load(self, place: float) -> float | Load:
        """Return the load at a place."""
        rest_dd = self.rest(place)
        return self.pressure(place) if rest_dd is None else Load(self.pressure(place), rest_dd)
