"""Jamming by decompression of a dense packing, and by compression with step halving."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from packmech.check import brief, integer, positive, real
from packmech.files.records import is_record
from packmech.measure.counting import packing_fraction
from packmech.mechanics.stability import stability
from packmech.minimize.program import Minimizer
from packmech.packing import Packing
from packmech.protocols.hard_vertex import check_quench, decompress, find_hard_packing, jam_hard, press, set_apart
from packmech.protocols.linked_jam import decompress_linked
from packmech.protocols.method import JamMethod
from packmech.protocols.pressure_path import PressurePath, follow_jammed
from packmech.protocols.protocol import Protocol, at_packing_fraction
from packmech.result import Outcome

_START = {2: 0.90, 3: 0.70}


@dataclass(frozen=True)
class Decompression(JamMethod):
    """Quench at a packing fraction well above jamming, then decompress in steps that divide the pressure.

    Every step relaxes by FIRE and extrapolates the pressure to the next target by the last slope. The last two
    pressures give the packing fraction of zero pressure; the exact hard packing and the soft one at the pressure
    asked for follow from there. "Random at .90, FIRE, decompress, extrapolate" is this protocol.

    A packing with links is relaxed where it stands (or at `start_packing_fraction`) and compressed by small steps until
    it presses: large overlaps would push links through each other. Then it is followed down from pressure to pressure
    by Newton's method that only goes down, with links and free strains among the unknowns; the box grows and clusters
    keep their shape, which is the shrinking of clusters in place, in other units. Ellipses and spheroids go the same
    way, their turns among the unknowns.

    Parameters
    ----------
    start_packing_fraction
        Where the quench happens; None: .90 in two dimensions, .70 in three, and with links where the packing stands.
    stop_pressure, factor
        Stop decompressing at this pressure [energy_scale / diameter^d], and ratio of successive pressures; not used
        with links.
    quench_tolerance
        Net force over mean contact force at which FIRE stops [1].
    quench_steps
        Maximum number of FIRE steps in one box.
    iteration_limit
        Maximum number of interior-point iterations for the hard packing.

    """

    honors = {"isotropic": "links shapes kinds", "free": "links shapes kinds"}

    start_packing_fraction: float | None = None
    stop_pressure: float = 1e-4
    factor: float = 0.15
    quench_tolerance: float = 1e-4
    quench_steps: int = 1_000_000
    iteration_limit: int = 2000

    def __post_init__(self) -> None:
        check_quench(self.start_packing_fraction, self.quench_tolerance, self.quench_steps)
        positive("stop_pressure", self.stop_pressure)
        real("factor", self.factor, above=0.0, below=1.0)
        integer("iteration_limit", self.iteration_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        start = self.start_packing_fraction
        if not protocol.scene.packing.plain:
            # a shear stress that is set free moves what has links or shapes so far that there is nothing to follow
            if protocol.continues and not PressurePath(protocol).sheared:
                return follow_jammed(protocol, pressure)
            protocol.continues = False
            return decompress_linked(protocol, start, pressure, self.quench_tolerance, self.quench_steps)
        start = protocol.start_fraction(start, _START)
        return jam_hard(
            protocol,
            pressure,
            lambda: decompress(
                protocol, start, self.stop_pressure, self.factor, self.quench_tolerance, self.quench_steps
            ),
            lambda near: find_hard_packing(protocol, near, self.iteration_limit),
        )


_HARD_ITERATIONS = 2000
_HALVING_START = {2: 0.84, 3: 0.64}


@dataclass(frozen=True)
class StepHalving(JamMethod):
    """Compress or expand by small steps in packing fraction, relax, halve the step whenever the side changes.

    With every strain free, the exact hard packing near the result is found with the box among the unknowns, and
    pressed to the pressure that was reached.

    Ends when the energy per particle lies between `energy_tolerance` and twice that; the pressure follows from it.

    Parameters
    ----------
    start_packing_fraction
        Where the first relaxation happens; None: .84 in two dimensions, .64 in three.
    increment
        First step in packing fraction.
    energy_tolerance
        V_tol: energy per particle [energy_scale]. 1e-16 means overlaps of 1e-8.
    minimizer
        A minimizer such as pm.ConjugateGradient() or pm.DampedDynamics(damping=...); None: FIRE.
    quench_tolerance, quench_steps
        Net force over mean contact force at which a relaxation stops [1], and its maximum number of steps.
    step_limit
        Maximum number of compression steps.

    """

    honors = {"isotropic": "links shapes kinds", "free": "kinds"}
    ends_at = "an energy"

    start_packing_fraction: float | None = None
    increment: float = 1e-4
    energy_tolerance: float = 1e-16
    minimizer: Minimizer | None = None
    quench_tolerance: float = 1e-5
    quench_steps: int = 1_000_000
    step_limit: int = 10_000

    def __post_init__(self) -> None:
        check_quench(self.start_packing_fraction, self.quench_tolerance, self.quench_steps)
        real("increment", self.increment, above=0.0, at_most=0.1)
        positive("energy_tolerance", self.energy_tolerance)
        integer("step_limit", self.step_limit, at_least=1)
        if self.minimizer is not None and not (is_record(self.minimizer) and hasattr(self.minimizer, "advance")):
            raise TypeError(f"minimizer must be a minimizer such as Fire() or None, got {brief(self.minimizer)}")

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing whose energy lies in the window, and how the protocol ended."""
        first = protocol.scene.packing
        fraction = protocol.start_fraction(self.start_packing_fraction, _HALVING_START)
        packing = at_packing_fraction(first, fraction)
        change, side, below = self.increment, 0, None
        outcome = Outcome.STEP_LIMIT
        # V_min far below V_tol: a packing whose forces have fallen this low is taken as unjammed
        floor = 1e-2 * float(np.sqrt(self.energy_tolerance))
        with protocol.stage("step halving") as figures:
            for number in range(self.step_limit):
                packing, energy, residual, steps = self._relaxed(protocol, packing, floor)
                figures.residual = residual
                figures.steps += steps
                figures.force_evaluations += steps
                protocol.loop.report(
                    "step halving", number=number, packing_fraction=fraction, energy=energy, increment=change
                )
                if self.energy_tolerance < energy < 2.0 * self.energy_tolerance:
                    outcome = Outcome.CONVERGED
                    break
                now = 1 if energy >= 2.0 * self.energy_tolerance else -1
                if now < 0:
                    below = packing
                if side and now != side:
                    change *= 0.5
                side = now
                if change < 1e-15:
                    outcome = Outcome.STALLED
                    break
                fraction -= side * change
                packing = at_packing_fraction(packing, fraction)
            figures.note = f"{number + 1} relaxations, last step {change:.1e}, energy per particle {energy:.2e}"
        protocol.report["energy_per_particle"] = energy
        protocol.report["compression_steps"] = number + 1
        protocol.report["jamming_packing_fraction"] = packing_fraction(packing)
        if first.plain:
            protocol.report["packing_below_onset"] = set_apart(packing if below is None else below)
        if outcome.ok and protocol.strain == "free":
            return self._stabilized(protocol, packing)
        if outcome.ok and stability(protocol.scene.replace(packing=packing)).negative:
            outcome = Outcome.UNSTABLE
        return packing, outcome

    def _relaxed(self, protocol: Protocol, packing: Packing, floor: float) -> tuple[Packing, float, float, int]:
        packing, done = protocol.relax(packing, self.quench_tolerance, self.quench_steps, floor, self.minimizer)
        return packing, done.energy / (packing.particles * protocol.scene.energy_scale), done.residual, done.steps

    def _stabilized(self, protocol: Protocol, packing: Packing) -> tuple[Packing, Outcome]:
        """Return the packing with all strains free, at the pressure that was reached."""
        pressure = protocol.program.evaluate(packing.position_nd, packing.box.lattice_dd).pressure
        hard = find_hard_packing(protocol, packing, _HARD_ITERATIONS)
        if hard is None:
            return protocol.last, Outcome.NOT_JAMMED
        return press(protocol, hard, pressure / protocol.scene.pressure_unit)
