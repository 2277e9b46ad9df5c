"""The soft packing far above the hard one, where following the contacts fails: FIRE and a secant in the box size."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from packmech.dynamics.soft import SoftState, newton

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol

_ROUNDS = 30
_FIRE_TOLERANCE = 1e-6
_FIRE_STEPS = 300_000


def search_pressure(protocol: Protocol, state: SoftState, goal: float) -> SoftState:
    """Return the packing at the pressure: FIRE in boxes of changing size until it is near, then Newton's method.

    The network rearranges on the way; the stage's note says so.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it.
    state
        A packing in balance at a lower pressure, in reduced units.
    goal
        Pressure to reach, in reduced units.

    """
    best = replace(state, reached=min(state.reached, 0.999))
    with protocol.stage("soft packing, searched") as figures:
        figures.note = "unstable on the way up: FIRE with a tight tolerance, then Newton's method"
        packing = protocol.restored(state.packing)
        d = packing.dimension
        asked = goal / protocol.reduced_pressure(1.0) * protocol.scene.pressure_unit
        # first guess of dP / d(-ln V); later the secant
        slope = 0.4 * protocol.scene.pressure_unit
        packing, done = protocol.relax(packing, _FIRE_TOLERANCE, _FIRE_STEPS)
        steps, squeeze, before = done.steps, 0.0, (0.0, done.pressure)
        for _ in range(_ROUNDS):
            change = float(np.clip((asked - done.pressure) / slope, -0.05, 0.05))
            squeeze += change
            factor = float(np.exp(-change / d))
            packing = packing.replace(position_nd=packing.position_nd * factor, box=packing.box.scaled(factor))
            packing, done = protocol.relax(packing, _FIRE_TOLERANCE, _FIRE_STEPS)
            steps += done.steps
            if squeeze != before[0] and (done.pressure - before[1]) / (squeeze - before[0]) > 0.0:
                slope = (done.pressure - before[1]) / (squeeze - before[0])
            before = (squeeze, done.pressure)
            if abs(done.pressure - asked) < 0.02 * asked:
                trial = newton(protocol.reduced(packing), protocol.units, protocol.basis_kdd, goal)
                if trial.sound(protocol.force_tolerance):
                    best = trial
                    break
        protocol.last = protocol.restored(best.packing)
        figures.residual, figures.steps, figures.force_evaluations = best.residual, steps, steps
    return best
