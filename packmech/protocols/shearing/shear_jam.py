"""Shear jamming: grains with friction that are loose until shear makes them bear it."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import check_steps, instance, positive, two_axes
from packmech.dynamics.integrators import choose_time_step, stiffness_and_damping
from packmech.dynamics.spans import Spans
from packmech.effects import BackgroundDamping
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.contact_forces import ContactForces, contact_forces
from packmech.result import Condition, Outcome, Run, Stage, unmet_conditions
from packmech.scene import Scene

# time of a span over that of a contact, and fraction of the shortest time of a contact that a step takes
_SPAN, _STEP = 10.0, 0.15
# rate at which velocities relax to the flow while the box shears, over that of a contact
_DRAG = 0.1
# spans from one look at the balance to the next
_LOOK = 10
# part of the pressure that counts as jammed below which all is loose
_LOOSE = 1e-2


@honors("repulsion kinds damping friction rolling bonds interactions drag", shaped="pm.shear_stabilize")
def shear_jam(
    scene: Scene,
    *,
    pressure: float,
    rate: float = 1e-3,
    step: float = 0.01,
    largest_strain: float = 1.0,
    force_tolerance: float = 1e-6,
    axes: tuple[int, int] = (0, 1),
    step_limit: int = 20_000_000,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Run:
    """Return the run of a scene that is sheared at constant volume, in small steps, until it bears a pressure at rest.

    Each step of strain is taken at a slow rate under a drag against the flow; then the box stands still and everything
    comes to rest. Loose packings with friction, below the packing fraction at which they jam by compression alone, can
    bear shear after a finite strain (Bi, Zhang, Chakraborty and Behringer, Nature 480, 355 (2011)); frictionless ones
    of many particles cannot.

    Parameters
    ----------
    scene
        The scene, without rigid links; loose: at rest its pressure should be below the one asked for.
    pressure
        Pressure at rest at which it counts as jammed [energy/length^d].
    rate
        Shear rate, in units of sqrt(k / m) of the stiffness of a contact and the mean mass.
    step, largest_strain
        Strain from one rest to the next, and at which the search ends [1].
    force_tolerance
        Largest net force, and torque over radius, over the mean normal force that counts as rest [1].
    axes
        Direction of the flow, and of its gradient.
    step_limit
        Maximum number of time steps.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures).
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Run
        Outcome.CONVERGED where it bears the pressure at rest, Outcome.UNJAMMED, a success too, where it does not up to
        the largest strain. `report` holds "strain", and at each rest "strain_t", "pressure_t", "shear_stress_t"; where
        it is jammed "stress_anisotropy", largest shear stress over pressure, and the counts of `contact_forces`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If it ends otherwise and `check` is set; its `.run` holds what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.7, seed=1)
    >>> loose = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-6).packing
    >>> scene = pm.Scene(loose, (pm.Repulsion(), pm.Friction(1.0), pm.ContactDamping(0.3)))
    >>> pm.shear_jam(scene, pressure=1e-4, largest_strain=0.02).outcome.name
    'UNJAMMED'

    """
    instance("scene", scene, Scene)
    if scene.packing.links:
        raise ValueError(f"scene.packing must have no rigid links, got {len(scene.packing.links)}")
    positive("pressure", pressure), positive("rate", rate), positive("force_tolerance", force_tolerance)
    small, end = positive("step", step), positive("largest_strain", largest_strain)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    settings = run_settings(step_limit=step_limit, time_limit=time_limit, progress=progress, check=check)
    loop = RunLoop(settings)
    shearing = _Shearing(scene, pressure, rate, small, force_tolerance, pair, loop)
    return loop.run(lambda: shearing.until(end), shearing.finish)


class _Shearing:
    """A packing on its way, from rest to rest."""

    def __init__(
        self,
        scene: Scene,
        pressure: float,
        rate: float,
        step: float,
        force_tolerance: float,
        axes: tuple[int, int],
        loop: RunLoop,
    ) -> None:
        self.began = time.process_time()
        self.scene, self.pressure, self.step, self.axes, self.loop = scene, pressure, step, axes, loop
        self.force_tolerance = force_tolerance
        packing = scene.packing
        tau = math.sqrt(float(packing.mass_n.mean()) / stiffness_and_damping(scene)[0])
        self.dragged = (*scene.effects, BackgroundDamping(_DRAG / tau))
        dt = choose_time_step(scene.replace(effects=self.dragged), _STEP)
        self.rate = rate / tau
        check_steps("step / rate", step / self.rate, dt)
        # a step of strain is a whole number of spans
        self.spans_of_step = max(1, math.ceil(step / self.rate / (_SPAN * tau)))
        self.steps_of_span = max(1, math.ceil(step / self.rate / (self.spans_of_step * dt)))
        self.dt = step / self.rate / (self.spans_of_step * self.steps_of_span)
        self.spans = Spans(scene, self.dt)
        self.strain = self.goal = 0.0
        self.rows: list[tuple[float, float, float]] = []

    def until(self, largest_strain: float) -> Outcome:
        """Shear until it is jammed, or up to a strain."""
        d = self.spans.scene.packing.dimension
        along = np.zeros((d, d))
        along[self.axes] = self.rate
        taken, self.goal = 0, largest_strain
        outcome = self._rest()
        while outcome is Outcome.UNJAMMED and self.strain < largest_strain * (1.0 - 1e-12):
            self.spans.scene = self.spans.scene.replace(effects=self.dragged)
            for _ in range(self.spans_of_step):
                moved = self._advance(along)
                if moved is not Outcome.FINISHED:
                    return moved
            taken += 1
            self.strain = taken * self.step
            outcome = self._rest()
        return outcome

    def _rest(self) -> Outcome:
        """Let everything come to rest; return whether it bears the pressure."""
        still = np.zeros((self.spans.scene.packing.dimension,) * 2)
        self.spans.scene = self.spans.scene.replace(effects=self.scene.effects)
        outcome = self.spans.come_to_rest(lambda: self._advance(still), self._at_rest, _LOOK)
        if outcome is not Outcome.CONVERGED:
            return outcome
        self.rows.append((self.strain, self.spans.pressure, self.spans.shear_stress(self.axes)))
        self.loop.report("at rest", strain=self.strain, pressure=self.spans.pressure)
        return Outcome.CONVERGED if self.spans.pressure >= self.pressure else Outcome.UNJAMMED

    def _at_rest(self) -> bool:
        # what flies about without pushing is loose, and never balances
        if self.spans.pressure < _LOOSE * self.pressure:
            return True
        if not self.spans.residual <= self.force_tolerance:
            return False
        return self._forces().residual <= self.force_tolerance

    def _forces(self) -> ContactForces:
        return contact_forces(self.scene.replace(packing=self.spans.scene.packing))

    def _advance(self, rate_dd: NDArray[np.float64]) -> Outcome:
        self.loop.check_time()
        if self.spans.steps + self.steps_of_span > self.loop.settings.step_limit:
            return Outcome.STEP_LIMIT
        return Outcome.FINISHED if self.spans.advance(rate_dd, self.steps_of_span) else Outcome.STEP_TOO_LONG

    def finish(self, outcome: Outcome) -> Run:
        """Return the run as far as it came."""
        spans, seconds = self.spans, time.process_time() - self.began
        strain, pressure, stress = np.array(self.rows).reshape(-1, 3).T.copy()
        report: dict[str, Any] = {"strain": self.strain}
        residual, balance = spans.residual, Condition("force residual", spans.residual, self.force_tolerance)
        if outcome is Outcome.CONVERGED:
            forces = self._forces()
            residual = forces.residual
            principal = np.linalg.eigvalsh(0.5 * (spans.stress_dd + spans.stress_dd.T))
            report["stress_anisotropy"] = float((principal[-1] - principal[0]) / (2.0 * self.spans.pressure))
            report |= forces.to_dict()
        report |= {"strain_t": strain, "pressure_t": pressure, "shear_stress_t": stress}
        return Run(
            packing=spans.scene.packing,
            outcome=outcome,
            residual=residual,
            steps=spans.steps,
            force_evaluations=spans.steps,
            seconds=seconds,
            stages=(Stage("shear and rest", residual, spans.steps, spans.steps, seconds, ""),),
            report=report,
            unmet=unmet_conditions(outcome, Condition("shear strain", self.strain, self.goal, 1e-12), balance),
        )
