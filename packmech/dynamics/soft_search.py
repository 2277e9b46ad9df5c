"""The soft packing far above the hard one, where following contacts fails: FIRE with the box, then Newton's method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from packmech.dynamics.soft_newton import SoftState, newton
from packmech.dynamics.strain_fire import relax_strained

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol
    from packmech.packing import Packing

_FIRST_TOLERANCE = 1e-3
_ROUNDS = 3
_FIRE_STEPS = 30_000


def search_pressure(protocol: Protocol, start: Packing, goal: float) -> SoftState:
    """Return the packing at the pressure: FIRE in positions and free strains until it is near, then Newton's method.

    The network rearranges on the way; the stage's note says so.

    Parameters
    ----------
    protocol
        The protocol; a stage is added to it.
    start
        A packing in balance at another pressure, in reduced units.
    goal
        Pressure to reach, in reduced units.

    """
    best: SoftState | None = None
    with protocol.stage("soft packing, searched") as figures:
        figures.note = "unstable on the way up: FIRE with the box, then Newton's method"
        asked = goal / protocol.reduced_pressure(1.0) * protocol.scene.pressure_unit
        packing, tolerance = protocol.restored(start), _FIRST_TOLERANCE
        for _ in range(_ROUNDS):
            done = relax_strained(
                protocol.program, packing, protocol.basis_kdd, asked, tolerance=tolerance, step_limit=_FIRE_STEPS
            )
            figures.steps += done.steps
            packing = protocol.last = done.packing
            best = newton(protocol.reduced(packing), protocol.units, protocol.basis_kdd, goal)
            if best.sound(protocol.force_tolerance) or done.merit > tolerance:
                break
            tolerance *= 0.03
        assert best is not None
        protocol.last = protocol.restored(best.packing)
        figures.residual, figures.force_evaluations = best.residual, figures.steps
    return best
