"""One jammed packing on its way from pressure to pressure, or from stress to stress, along its contact network."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.shape_contacts import touching_pairs
from packmech.measure.stress import pressure as pressure_of
from packmech.measure.stress import stress_tensor
from packmech.minimize.second_order.soft_network import Load
from packmech.minimize.second_order.soft_newton import SoftState, descend, find_bottom, judge, newton
from packmech.packing import Packing
from packmech.protocols.protocol import Protocol, pairs_of, report_changes
from packmech.protocols.soft import extrapolated, search_pressure
from packmech.result import Outcome

# largest ratio of successive pressures, the first one tried, and the smallest before contacts are let rearrange
_FACTOR, _FIRST, _MINIMUM_FACTOR = 4.0, 2.0, 1.05
# logarithm of a ratio of pressures too small to draw a line through two packings
_ALMOST = 0.01
# logarithms of a ratio of pressures that count as much as a change of the rest of the load by the pressure
_TURN = 10.0
_ITERATIONS = 25


class PressurePath:
    """One packing on its way from load to load; loads and packings are in reduced units.

    Parameters
    ----------
    protocol
        The protocol.
    shears
        Whether loads are stresses with parts that are no pressure, to begin with that of the packing.

    """

    def __init__(self, protocol: Protocol, *, shears: bool = False) -> None:
        self.protocol = protocol
        scene = protocol.scene
        self.packing = protocol.reduced(scene.packing)
        self.pressure = protocol.reduced_pressure(pressure_of(scene) / scene.pressure_unit)
        self.rest_dd = Load.of(stress_tensor(scene)).rest_dd if shears else None
        # the packing before, and where on the way it was
        self.before: tuple[Packing, float] | None = None
        self.pairs = pairs_of(touching_pairs(scene.packing))

    def go(self, pressure: float, rest_dd: NDArray[np.float64] | None = None) -> Outcome:
        """Go on to a load, its pressure in units of [energy_scale / diameter^d]; return how that ended."""
        protocol, rearrangements, iterations = self.protocol, 0, 0
        way = _Way(self.pressure, protocol.reduced_pressure(pressure), self.rest_dd, rest_dd)
        place, factor = way.start, _FIRST
        if rest_dd is not None:
            self.before = None
        tolerance = max(protocol.force_tolerance, 1e-7)
        with protocol.stage("following the pressure" if rest_dd is None else "following the stress") as figures:
            while True:
                protocol.loop.check_time()
                further = way.further(place, factor)
                load = way.load(further)
                state = self._step(place, further, load)
                iterations += state.iterations
                if not state.sound(tolerance):
                    if factor > _MINIMUM_FACTOR:
                        factor = factor**0.5
                        continue
                    rearrangements += 1
                    state = find_bottom(self.packing, protocol.units, protocol.basis_kdd, load, tolerance)
                    iterations += state.iterations
                    if not state.sound(tolerance) and self.packing.plain:
                        state = search_pressure(protocol, self.packing, load)
                    self.before = None
                    if not state.sound(tolerance):
                        break
                elif way.apart(place, further) > _ALMOST:
                    self.before = self.packing, place
                if further == way.end and not state.sound(protocol.force_tolerance):
                    # a contact that barely touches slows Newton's steps: those that only go down pass it
                    lower = find_bottom(
                        state.packing, protocol.units, protocol.basis_kdd, load, protocol.force_tolerance
                    )
                    iterations += lower.iterations
                    if lower.sound(tolerance) and lower.residual < state.residual:
                        state = lower
                self.packing, place = state.packing, further
                self.pressure, self.rest_dd = way.pressure(place), way.rest(place)
                protocol.last = protocol.restored(self.packing)
                if further == way.end:
                    break
                factor = min(_FACTOR, factor**1.5)
            protocol.last = protocol.restored(state.packing)
            figures.residual, figures.steps, figures.force_evaluations = state.residual, iterations, iterations
            figures.note = f"{rearrangements} rearrangements"
        self.pairs = report_changes(protocol, rearrangements, self.pairs)
        return judge(state, protocol.force_tolerance)

    def _step(self, place: float, further: float, load: float | Load) -> SoftState:
        """Return the packing at another load, looked for on the line through the last two."""
        start = self.packing
        if self.before is not None:
            start = extrapolated(*self.before, start, place, further)
        units, basis = self.protocol.units, self.protocol.basis_kdd
        if not start.plain:
            return descend(start, units, basis, load)
        return newton(start, units, basis, load, iterations=_ITERATIONS)


class _Way:
    """The way from one load to another: by the pressure, or along a line where the rest of the load changes."""

    def __init__(
        self, now: float, goal: float, rest_dd: NDArray[np.float64] | None, goal_dd: NDArray[np.float64] | None
    ) -> None:
        self._now, self._goal, self._rest_dd, self._goal_dd = now, goal, rest_dd, goal_dd
        self._far = 0.0
        self.start, self.end = now, goal
        if rest_dd is not None and goal_dd is not None:
            turn = float(np.abs(goal_dd - rest_dd).max())
            self._far = max(abs(math.log(goal / now)), turn * _TURN)
            self.start, self.end = 1.0, 2.0

    def apart(self, place: float, other: float) -> float:
        """Return how far two places are apart, in logarithms of the pressure."""
        return self._far * abs(other - place) if self._goal_dd is not None else abs(math.log(other / place))

    def further(self, place: float, factor: float) -> float:
        """Return the next place; at the end already where a step of almost nothing would be left."""
        reach = math.log(factor)
        if self.apart(place, self.end) < reach + _ALMOST:
            return self.end
        if self._goal_dd is not None:
            return place + reach / self._far
        return place * math.exp(math.copysign(reach, math.log(self.end / place)))

    def pressure(self, place: float) -> float:
        """Return the pressure at a place."""
        if self._goal_dd is None:
            return place
        return self._goal if place == self.end else self._now * (self._goal / self._now) ** (place - self.start)

    def rest(self, place: float) -> NDArray[np.float64] | None:
        """Return the rest of the load at a place, over its pressure."""
        if self._goal_dd is None or self._rest_dd is None or place == self.end:
            return self._goal_dd
        return self._rest_dd + (place - self.start) * (self._goal_dd - self._rest_dd)

    def load(self, place: float) -> float | Load:
        """Return the load at a place."""
        rest_dd = self.rest(place)
        return self.pressure(place) if rest_dd is None else Load(self.pressure(place), rest_dd)
