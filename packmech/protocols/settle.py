"""Settle: to rest with friction, in time and in the box as it is: under gravity, on walls or on held particles."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import instance, integer, positive
from packmech.dynamics.integrators import choose_time_step, stiffness_and_damping
from packmech.dynamics.spans import Spans, with_dashpot
from packmech.effects import refuse_free_fall
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.contact_forces import ContactForces, contact_forces
from packmech.mechanics.stability import Stability, stability
from packmech.packing import Packing
from packmech.result import Condition, Outcome, Run, Stage, unmet_conditions
from packmech.scene import Scene

# time between two looks at the motion, over that of a contact
_SPAN = 10.0
# fraction of the shortest time of a contact that a step takes: what is at rest at the end is no matter of accuracy
_STEP = 0.15
# spans between two looks at the balance in full, and spans of little motion after which the fall is over
_LOOK = 10
# kinetic energy, over its largest so far, that is little
_LITTLE = 1e-3
# spans over which the largest kinetic energy must change by this part, else nothing takes motion out: rotations against
# springs without dashpots, or all particles moving alike
_STRETCH, _STEADY = 100, 0.1


@honors("repulsion kinds friction rolling gravity walls held links shapes rough mesh", at_rest=True)
def settle(
    scene: Scene,
    *,
    force_tolerance: float,
    step_limit: int = 20_000_000,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Run:
    """Return the run to rest with friction, in the box as it is: under gravity, on a floor.

    Particles start without motion and follow Newton's equations with the scene's dashpots and drag until little of the
    motion is left, or it no longer dies out; then all motion is stopped whenever the kinetic energy has begun to fall
    (dynamic relaxation, Cundall 1976). With friction the packing at rest depends on the way to it: on masses, dashpots,
    and tangential displacements at the start. Contacts of a scene whose dashpots are too weak are given one more, of
    damping .3 sqrt(k m), on the way. A packing that is at rest already stays as it is. The packing that comes back
    holds its tangential displacements: their sums over the steps carry the error of the time step, which falls as its
    square and is no small part of what a slight change of the packing makes of its pressure. Without friction `quench`
    finds a minimum of the energy in a fraction of the time.

    Parameters
    ----------
    scene
        The scene. Under gravity it needs a floor: `Walls`, `MeshWalls`, or particles that are held (`FixedParticles`).
    force_tolerance
        Stop when the largest net force, and torque over radius, falls to this times the mean normal force [1].
    step_limit
        Largest number of time steps.
    time_limit
        Stop after so much CPU time, compiling aside [s].
    progress
        Called now and then as progress(stage, figures), figures a dict with "packing", "steps" and "residual".
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Run
        Outcome.CONVERGED; Outcome.UNJAMMED, a success, where nothing touches any more and nothing is pushed;
        Outcome.UNSTABLE where forces balance and a small displacement grows, as that of a disc balanced on another:
        move it and settle again.
        `residual` and `report` are those of `contact_forces`: counts of contacts, rattlers and contacts at the Coulomb
        limit, with added_damping [mass/time], time [sqrt(m / k)] and kinetic_energy [energy].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the tolerance was not met and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> stack = pm.Packing([[1.0, 0.5], [2.0, 0.5], [1.52, 1.4]], [0.5] * 3, pm.Box.cubic(8.0, 2))
    >>> grains = (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5), pm.Gravity(0.0, -1e-3), pm.FixedParticles((0, 1)))
    >>> run = pm.settle(pm.Scene(stack, grains), force_tolerance=1e-8)
    >>> run.outcome.name, run.residual <= 1e-8, run.report["bearing_contacts"]
    ('CONVERGED', True, 2)

    """
    instance("scene", scene, Scene)
    refuse_free_fall(scene.effects)
    tolerance = positive("force_tolerance", force_tolerance)
    limit = integer("step_limit", step_limit, at_least=1)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    settling = _Settling(scene, tolerance, limit, loop)
    with single_thread():
        return loop.run(settling.work, settling.finish)


class _Settling:
    """A scene on its way to rest."""

    def __init__(self, scene: Scene, tolerance: float, step_limit: int, loop: RunLoop) -> None:
        self.scene, self.tolerance, self.step_limit, self.loop = scene, tolerance, step_limit, loop
        self.began = time.process_time()
        self.stages: list[Stage] = []
        self.spans: Spans | None = None
        self.tau, self.added_damping = 1.0, 0.0
        self.stability: Stability | None = None

    @property
    def packing(self) -> Packing:
        """The packing as it is now."""
        return self.scene.packing if self.spans is None else self.spans.scene.packing

    def work(self) -> Outcome:
        """Fall, then come to rest; return how that ended."""
        if self._balanced():
            return self._at_rest()
        damped, self.added_damping = with_dashpot(self.scene)
        self.tau = math.sqrt(float(self.packing.mass_n.mean()) / stiffness_and_damping(self.scene)[0])
        self.spans = Spans(damped, choose_time_step(damped, _STEP))
        outcome = self._stage("falling", self._fall)
        if outcome is Outcome.FINISHED:
            outcome = self._stage("coming to rest", self._rest)
            outcome = self._at_rest() if outcome is Outcome.CONVERGED else outcome
        return outcome

    def _at_rest(self) -> Outcome:
        """Return how what is in balance ends: nothing is pushed where no force balances another, or it would fall."""
        found = self._forces()
        if not found.mean_force > 0.0:
            return Outcome.UNJAMMED
        self.stability = stability(self.scene.replace(packing=self.packing), found.largest_imbalance)
        return Outcome.UNSTABLE if self.stability.negative else Outcome.CONVERGED

    def _forces(self) -> ContactForces:
        return contact_forces(self.scene.replace(packing=self.packing))

    def _balanced(self) -> bool:
        return self._forces().residual <= self.tolerance

    def _advance(self) -> Outcome:
        """Take a span of steps."""
        assert self.spans is not None
        self.loop.check_time()
        span = max(1, round(_SPAN * self.tau / self.spans.dt))
        steps = min(span, self.step_limit - self.spans.steps)
        if steps <= 0:
            return Outcome.STEP_LIMIT
        if not self.spans.advance(np.zeros((self.packing.dimension, self.packing.dimension)), steps):
            return Outcome.TOO_MANY_TOUCHES if self.spans.is_crowded else Outcome.STEP_TOO_LONG
        self.loop.report("settling", packing=self.packing, steps=self.spans.steps, residual=self.spans.residual)
        return Outcome.FINISHED

    def _fall(self) -> Outcome:
        """Follow the motion until little is left of it, or it no longer dies out."""
        assert self.spans is not None
        largest, calm, outcome = 0.0, 0, Outcome.FINISHED
        last: list[float] = []
        before = math.inf
        while outcome is Outcome.FINISHED and calm < _LOOK:
            outcome = self._advance()
            energy = self.spans.kinetic_energy
            largest = max(largest, energy)
            calm = calm + 1 if energy <= _LITTLE * largest else 0
            last.append(energy)
            if len(last) == _STRETCH:
                now = max(last)
                if abs(now - before) <= _STEADY * before < math.inf:
                    break
                before, last = now, []
        return outcome

    def _rest(self) -> Outcome:
        """Stop the motion again and again until forces and torques are in balance."""
        assert self.spans is not None
        return self.spans.come_to_rest(self._advance, self._balanced, _LOOK)

    def _stage(self, name: str, part: Callable[[], Outcome]) -> Outcome:
        """Keep what a part of the way achieved and cost."""
        assert self.spans is not None
        began, before = time.process_time(), self.spans.steps
        try:
            return part()
        finally:
            taken, seconds = self.spans.steps - before, time.process_time() - began
            self.stages.append(Stage(name, self._forces().residual, taken, taken, seconds))

    def finish(self, outcome: Outcome) -> Run:
        """Return the run."""
        found = self._forces()
        limits = () if self.spans is None else self.spans.limits()
        steps = 0 if self.spans is None else self.spans.steps
        return Run(
            packing=self.packing,
            outcome=outcome,
            residual=found.residual,
            steps=steps,
            force_evaluations=steps,
            seconds=time.process_time() - self.began,
            stages=tuple(self.stages),
            report={
                **found.to_dict(),
                **({} if self.stability is None else self.stability.to_dict()),
                "added_damping": self.added_damping,
                "time": 0.0 if self.spans is None else steps * self.spans.dt / self.tau,
                "kinetic_energy": 0.0 if self.spans is None else self.spans.kinetic_energy,
            },
            unmet=unmet_conditions(
                outcome,
                *limits,
                Condition("force residual", found.residual, self.tolerance),
                Condition("unstable directions", (self.stability and self.stability.negative) or 0, 0),
            ),
        )
