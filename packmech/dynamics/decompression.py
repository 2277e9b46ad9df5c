"""Decompression: quench far above jamming, let the box grow until the pressure has all but gone, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from packmech.check import integer, positive, real
from packmech.dynamics.hard_vertex import find_vertex, press
from packmech.measure import packing_fraction
from packmech.outcome import Outcome
from packmech.packing import Packing

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol

_START = {2: 0.90, 3: 0.70}
# dP / d(packing fraction) in units of the pressure unit: where the secant starts, and its bounds
_SLOPE, _SLOPES = 0.35, (0.1, 1.0)


@dataclass(frozen=True)
class Decompression:
    """Quench at a packing fraction well above jamming, then decompress in steps that divide the pressure.

    Every step relaxes by FIRE and extrapolates the pressure to the next target by the last slope. The last two pressures give the
    packing fraction of zero pressure; the exact hard packing and the soft one at the pressure asked for follow from there.
    "Random at .90, FIRE, decompress, extrapolate" is this protocol.

    Parameters
    ----------
    start_packing_fraction
        Where the quench happens; None: .90 in two dimensions, .70 in three.
    stop_pressure
        Stop decompressing at this pressure [energy_scale / diameter^d].
    factor
        Ratio of successive pressures.
    quench_tolerance
        Net force over mean contact force at which FIRE stops [1].
    quench_steps
        Most FIRE steps in one box.
    iteration_limit
        Most interior-point iterations for the hard packing.

    """

    start_packing_fraction: float | None = None
    stop_pressure: float = 1e-4
    factor: float = 0.15
    quench_tolerance: float = 1e-4
    quench_steps: int = 1_000_000
    iteration_limit: int = 2000

    def __post_init__(self) -> None:
        if self.start_packing_fraction is not None:
            positive("start_packing_fraction", self.start_packing_fraction)
        positive("stop_pressure", self.stop_pressure)
        real("factor", self.factor, above=0.0, below=1.0)
        real("quench_tolerance", self.quench_tolerance, above=0.0, below=1.0)
        integer("quench_steps", self.quench_steps, at_least=1)
        integer("iteration_limit", self.iteration_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        start = self.start_packing_fraction
        start = _START[protocol.scene.packing.dimension] if start is None else start
        packing = decompress(
            protocol, start, self.stop_pressure, self.factor, self.quench_tolerance, self.quench_steps
        )  # fmt: skip
        vertex = find_vertex(protocol, packing, self.iteration_limit)
        if vertex is None:
            return protocol.last, Outcome.NOT_JAMMED
        return press(protocol, vertex, pressure)


def decompress(
    protocol: Protocol, start: float, stop_pressure: float, factor: float, tolerance: float, steps: int
) -> Packing:
    """Return the packing decompressed to the stop pressure; the extrapolated packing fraction goes into the report.

    Parameters
    ----------
    protocol
        The protocol; one stage is added per box.
    start
        Packing fraction of the quench.
    stop_pressure
        Pressure to stop at [energy_scale / diameter^d].
    factor
        Ratio of successive pressures [1].
    tolerance, steps
        Where FIRE stops in each box.

    """
    unit = protocol.scene.pressure_unit

    def relaxed(at: Packing, name: str) -> tuple[Packing, float]:
        with protocol.stage(name) as figures:
            packing, done = protocol.relax(at, tolerance, steps, floor=1e-3 * stop_pressure)
            figures.residual, figures.steps, figures.force_evaluations = (
                done.residual,
                done.steps,
                done.force_evaluations,
            )
            now = done.pressure / unit
            figures.note = f"FIRE at packing fraction {packing_fraction(packing):.6f}, pressure {now:.2e}"
        return packing, now if done.outcome is not Outcome.UNJAMMED else 0.0

    packing, pressure = relaxed(protocol.at_fraction(protocol.scene.packing, start), "quench")
    fraction, slope = packing_fraction(packing), _SLOPE
    last: tuple[float, float] | None = None
    while pressure > stop_pressure:
        target = max(factor, stop_pressure / pressure * 0.9)
        while True:
            there = fraction - pressure * (1.0 - target) / slope
            trial, found = relaxed(protocol.at_fraction(packing, there), "decompression")
            if found > 0.0 or target > 0.9:
                break
            # unjammed: go back and ask for less
            target = float(np.sqrt(target))
        last = (fraction, pressure)
        if found <= 0.0:
            pressure = 0.0
            packing = trial
            break
        slope = float(np.clip((pressure - found) / (fraction - there), *_SLOPES))
        packing, pressure, fraction = trial, found, there
    if last is not None and 0.0 < pressure < last[1]:
        onset = fraction - pressure * (last[0] - fraction) / (last[1] - pressure)
        protocol.report["extrapolated_packing_fraction"] = onset
    return packing
