"""Quench at a packing fraction, then let the box grow in steps that divide the pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from packmech.measure import packing_fraction
from packmech.outcome import Outcome
from packmech.packing import Packing

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol

# the onset is first guessed this far below, relative to the packing fraction, and held within these bounds afterwards
_ONSET, _ONSETS = 0.03, (0.001, 0.2)


def decompress(
    protocol: Protocol, start: float, stop_pressure: float | None, factor: float, tolerance: float, steps: int
) -> Packing:
    """Return the packing decompressed to the stop pressure; the extrapolated packing fraction goes into the report.

    Parameters
    ----------
    protocol
        The protocol; one stage is added per box.
    start
        Packing fraction of the quench.
    stop_pressure
        Pressure to stop at [energy_scale / diameter^d]; None stops after the quench.
    factor
        Ratio of successive pressures [1].
    tolerance, steps
        Where FIRE stops in each box.

    """
    unit = protocol.scene.pressure_unit

    def relaxed(at: Packing, name: str) -> tuple[Packing, float]:
        with protocol.stage(name) as figures:
            packing, done = protocol.relax(at, tolerance, steps, floor=1e-3 * (stop_pressure or 0.0))
            figures.take(done)
            now = done.pressure / unit
            figures.note = f"FIRE at packing fraction {packing_fraction(packing):.6f}, pressure {now:.2e}"
        return packing, now if done.outcome is not Outcome.UNJAMMED else 0.0

    packing, pressure = relaxed(protocol.at_fraction(protocol.scene.packing, start), "quench")
    fraction = packing_fraction(packing)
    slope = pressure / (_ONSET * fraction)
    last: tuple[float, float] | None = None
    while stop_pressure is not None and pressure > stop_pressure:
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
        slope = (pressure - found) / (fraction - there)
        packing, pressure, fraction = trial, found, there
        slope = float(np.clip(slope, pressure / (_ONSETS[1] * fraction), pressure / (_ONSETS[0] * target * fraction)))
    if last is not None and 0.0 < pressure < last[1]:
        onset = fraction - pressure * (last[0] - fraction) / (last[1] - pressure)
        protocol.report["extrapolated_packing_fraction"] = onset
    return packing
