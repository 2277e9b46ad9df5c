"""One jammed packing on its way from pressure to pressure, along its contact network."""

from __future__ import annotations

import math

from packmech.contacts import find_contacts
from packmech.measure.stress import pressure as pressure_of
from packmech.minimize.soft_newton import SoftState, descend, judge, newton
from packmech.packing import Packing
from packmech.protocols.protocol import Protocol, pairs_of, report_changes
from packmech.protocols.soft import extrapolated, search_pressure
from packmech.result import Outcome

# largest ratio of successive pressures, the first one tried, and the smallest before contacts are let rearrange
_FACTOR, _FIRST, _MINIMUM_FACTOR = 4.0, 2.0, 1.05
# logarithm of a ratio of pressures too small to draw a line through two packings
_ALMOST = 0.01
_ITERATIONS = 25


class PressurePath:
    """One packing on its way from pressure to pressure; pressures and packings are in reduced units."""

    def __init__(self, protocol: Protocol) -> None:
        self.protocol = protocol
        scene = protocol.scene
        self.packing = protocol.reduced(scene.packing)
        self.pressure = protocol.reduced_pressure(pressure_of(scene) / scene.pressure_unit)
        self.before: tuple[Packing, float] | None = None
        self.pairs = pairs_of(find_contacts(scene.packing))

    def go(self, pressure: float) -> Outcome:
        """Go on to a pressure [energy_scale / diameter^d]; return how that ended."""
        protocol, rearrangements, iterations = self.protocol, 0, 0
        goal, factor = protocol.reduced_pressure(pressure), _FIRST
        tolerance = max(protocol.force_tolerance, 1e-7)
        with protocol.stage("following the pressure") as figures:
            while True:
                protocol.loop.check_time()
                far = math.log(goal / self.pressure)
                reach = math.log(factor)
                # a last step of a per cent would leave a line through two packings that are almost the same
                further = goal if abs(far) < reach + _ALMOST else self.pressure * math.exp(math.copysign(reach, far))
                state = self._step(further)
                iterations += state.iterations
                if not state.sound(tolerance):
                    if factor > _MINIMUM_FACTOR:
                        factor = factor**0.5
                        continue
                    rearrangements += 1
                    state = descend(self.packing, protocol.units, protocol.basis_kdd, further)
                    iterations += state.iterations
                    if not state.sound(tolerance) and self.packing.links is None:
                        state = search_pressure(protocol, self.packing, further)
                    self.before = None
                    if not state.sound(tolerance):
                        break
                elif abs(math.log(further / self.pressure)) > _ALMOST:
                    self.before = self.packing, self.pressure
                self.packing, self.pressure = state.packing, further
                protocol.last = protocol.restored(self.packing)
                if further == goal:
                    break
                factor = min(_FACTOR, factor**1.5)
            protocol.last = protocol.restored(state.packing)
            figures.residual, figures.steps, figures.force_evaluations = state.residual, iterations, iterations
            figures.note = f"{rearrangements} rearrangements"
        self.pairs = report_changes(protocol, rearrangements, self.pairs)
        return judge(state, protocol.force_tolerance)

    def _step(self, pressure: float) -> SoftState:
        """Return the packing at another pressure, looked for on the line through the last two."""
        start = self.packing
        if self.before is not None:
            start = extrapolated(*self.before, start, self.pressure, pressure)
        units, basis = self.protocol.units, self.protocol.basis_kdd
        if start.links is not None:
            return descend(start, units, basis, pressure)
        return newton(start, units, basis, pressure, iterations=_ITERATIONS)
