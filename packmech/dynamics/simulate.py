"""Simulate: Newton's equations for the particles of a scene, in the box as it is, with rigid links or without."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, instance, integer, positive, positive_array
from packmech.compiled import compile_clock, compiling_noted
from packmech.dynamics.kernels import RUNNING
from packmech.dynamics.march.journey import Marching, needs_march
from packmech.dynamics.motion import Motion, Sight, choose_time_step
from packmech.dynamics.program import build_program
from packmech.dynamics.settings import check_manner
from packmech.dynamics.simulation import MotionTrace, Simulation
from packmech.dynamics.strain import OscillatoryStrain, SteadyStrain
from packmech.dynamics.verlet import INTEGRATORS, SemiImplicitEuler, VelocityVerlet
from packmech.interrupts import safe_interrupts
from packmech.outcome import NotConverged, Outcome, Stage
from packmech.packing import Packing
from packmech.scene import Scene

Progress = Callable[[str, dict[str, Any]], None]


def simulate(
    scene: Scene,
    *,
    steps: int | None = None,
    duration: float | None = None,
    dt: float | None = None,
    method: VelocityVerlet | SemiImplicitEuler | None = None,
    velocity_nd: ArrayLike | None = None,
    temperature: float | None = None,
    seed: int | None = None,
    mass_n: ArrayLike | None = None,
    spin_nk: ArrayLike | None = None,
    strain: SteadyStrain | OscillatoryStrain | None = None,
    held_n: ArrayLike | None = None,
    trace_every: int | None = None,
    trace_positions: bool = False,
    time_limit: float | None = None,
    progress: Progress | None = None,
    check: bool = True,
) -> Simulation:
    """Return the motion of the scene's particles through a given time, in the box as it is or as it is deformed.

    m dv/dt = forces of all effects, dashpots (`ContactDamping`) included, and of rigid links: lengths are restored in
    every step along the links at its start, velocities projected at its end (RATTLE). Without dashpots energy is
    conserved to the method's order and without drift.

    Parameters
    ----------
    scene
        The scene. Positions may leave the cell; they are not wrapped, nor are those returned.
    steps, duration
        Exactly one of them: number of steps, or the time to cover, in equal steps of at most dt.
    dt
        Time step. Unless given: the method's fraction of the shortest of sqrt(m / stiffness) and m / damping, with the
        least mass and the stiffest pair of equal particles at a relative overlap of 0 or 0.1, whatever the motion is.
    method
        VelocityVerlet() unless given, or SemiImplicitEuler().
    velocity_nd
        (N, d) velocities at the start [length/time]; what would stretch links is left out. At rest unless given.
    temperature
        Start instead with random velocities of this temperature [energy]: kinetic energy temperature / 2 for each
        independent motion that links and a resting center of mass leave. Needs a seed.
    seed
        Seed of the velocities.
    mass_n
        (N,) masses. Unless given proportional to radius^d (one density for all), with mass 1 for a particle of the
        reference diameter.
    spin_nk
        (N, 1) spins at the start in a plane, (N, 3) in space [1/time], where particles turn (friction, bonds).
    strain
        How the box deforms: SteadyStrain(rate) or OscillatoryStrain(amplitude, frequency). Velocities are then peculiar
        ones, v - L x: what follows the box has none.
    held_n
        (N,) True for particles that nothing pushes or turns; they follow the box.
    trace_every
        Keep figures every so many steps, in `trace`; the first and last step always.
    trace_positions
        Keep positions and velocities with them.
    time_limit
        Stop after so much CPU time [s], with Outcome.INTERRUPTED.
    progress
        Called now and then as progress(stage, figures), figures a dict with "steps", "time" and "energy".
    check
        Raise NotConverged when the run did not get to its end; otherwise return what it came to all the same.

    Returns
    -------
    Simulation
        Outcome.FINISHED; Outcome.STEP_TOO_LONG, and the last good state, where links were lost, something moved by
        the smallest diameter in one step, or the energy doubled.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the end was not reached and `check` is set; its `.run` holds what was.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import numpy as np
    >>> import packmech as pm
    >>> link = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), link)
    >>> turning = [[0.0, -0.5], [0.0, 0.5]]
    >>> run = pm.simulate(pm.Scene(dimer, (pm.Repulsion(),)), duration=2 * np.pi, velocity_nd=turning)
    >>> run.outcome.name, run.tension_l.round(12).tolist(), run.energy_drift < 1e-14
    ('FINISHED', [0.5], True)

    """
    instance("scene", scene, Scene)
    method = VelocityVerlet() if method is None else method
    if not isinstance(method, INTEGRATORS):
        raise TypeError(f"method must be VelocityVerlet() or SemiImplicitEuler(), got {method!r}")
    fraction = positive("method.fraction", method.fraction)
    packing = scene.packing
    shape = (packing.particles, packing.dimension)
    if mass_n is None:
        mass = (packing.diameter_n / packing.reference_diameter) ** packing.dimension
    else:
        mass = positive_array("mass_n", mass_n, shape=shape[:1])
    longest = choose_time_step(scene, mass, fraction) if dt is None else positive("dt", dt)
    count, step = _steps(steps, duration, longest)
    velocity = np.zeros(shape) if velocity_nd is None else finite_array("velocity_nd", velocity_nd, shape=shape)
    if seed is not None:
        seed = integer("seed", seed, at_least=0)
    if temperature is not None:
        temperature = positive("temperature", temperature)
        if velocity_nd is not None:
            raise ValueError(f"temperature must be left out where velocity_nd is given, got {temperature:g}")
        if seed is None:
            raise ValueError("seed must be an integer where a temperature is given, got None")
    instance("trace_positions", trace_positions, bool)
    check_manner(progress, check)
    spin = None
    if spin_nk is not None:
        spin = finite_array("spin_nk", spin_nk, shape=(shape[0], 1 if shape[1] == 2 else 3))
    if strain is not None and not isinstance(strain, SteadyStrain | OscillatoryStrain):
        raise TypeError(f"strain must be SteadyStrain(...), OscillatoryStrain(...) or None, got {strain!r}")
    journey = _Journey(
        scene,
        mass,
        step,
        count,
        march={"spin_nk": spin, "strain": strain, "held_n": _held(held_n, shape[0])},
        second_order=isinstance(method, VelocityVerlet),
        trace_every=None if trace_every is None else integer("trace_every", trace_every, at_least=1),
        trace_positions=trace_positions,
        time_limit=math.inf if time_limit is None else positive("time_limit", time_limit),
        progress=progress,
    )
    try:
        with safe_interrupts(), compile_clock() as journey.compiling:
            if temperature is not None:
                velocity = journey.motion.thermal_velocities(temperature, np.random.default_rng(seed))
            outcome = journey.go(method, velocity)
    except KeyboardInterrupt as stop:
        stop.run = journey.finish(method, Outcome.INTERRUPTED)  # type: ignore[attr-defined]
        raise
    run = journey.finish(method, outcome)
    if check and not run.ok:
        raise NotConverged(run)
    return run


def _held(held_n: Any, particles: int) -> NDArray[np.bool_] | None:
    if held_n is None:
        return None
    held = np.asarray(held_n)
    if held.dtype != bool:
        raise TypeError(f"held_n must be True or False for each particle, got {held_n!r}")
    if held.shape != (particles,):
        raise ValueError(f"held_n must have shape ({particles},), got {held.shape}")
    return held


def _steps(steps: Any, duration: Any, longest: float) -> tuple[int, float]:
    """Return the number of steps and their length."""
    if steps is not None:
        count = integer("steps", steps, at_least=1)
        if duration is not None:
            raise ValueError(f"duration must be left out where steps are given, got {duration!r}")
        return count, longest
    if duration is None:
        raise ValueError("steps must be an integer at least 1 (or give duration), got None")
    whole = positive("duration", duration)
    # a duration of whole steps does not get one more by rounding
    count = max(1, math.ceil(whole / longest * (1.0 - 1e-12)))
    return count, whole / count


class _Journey:
    """One simulation on its way: its motion, what was kept, and its limits."""

    def __init__(
        self,
        scene: Scene,
        mass_n: NDArray[np.float64],
        dt: float,
        steps: int,
        *,
        march: dict[str, Any],
        second_order: bool,
        trace_every: int | None,
        trace_positions: bool,
        time_limit: float,
        progress: Progress | None,
    ) -> None:
        self.began = time.process_time()
        self.scene, self.mass_n, self.steps, self.dt = scene, mass_n, steps, dt
        self.motion: Any
        if needs_march(scene, march["strain"]) or march["held_n"] is not None:
            self.motion = Marching(scene, mass_n, dt, second_order=second_order, **march)
        else:
            program = build_program(scene)
            self.motion = Motion(program, scene.effects, 1.0 / mass_n[program.order_n], None, dt)
            self.motion.affix()
        self.build_seconds = time.process_time() - self.began
        self.trace_every = trace_every
        self.progress = progress
        self.deadline = self.began + time_limit
        self.compiling: Callable[[], float] = lambda: 0.0
        self.kept: list[tuple[int, Sight]] = []
        self.position_t: list[NDArray[np.float64]] | None = [] if trace_positions else None
        self.velocity_t: list[NDArray[np.float64]] = []
        self.largest = {"energy": 0.0, "impulse": 0.0, "momentum": 0.0, "link": 0.0}
        self.start = self.last = self._blank()
        self.state = (scene.packing.position_nd, np.zeros_like(scene.packing.position_nd))
        self.reached = 0
        self.box: Box | None = None
        self.spin_nk: NDArray[np.float64] | None = None

    def _blank(self) -> Sight:
        d = self.scene.packing.dimension
        nothing, none = (
            np.zeros((d, d)),
            np.zeros(0 if self.motion.rattle is None else len(self.motion.rattle.impulse_r)),
        )
        return Sight(0.0, 0.0, 0.0, np.zeros(d), 0.0, nothing, nothing, 0, 0.0, 0.0, 0.0, none)

    def go(self, method: Any, velocity_nd: NDArray[np.float64]) -> Outcome:
        """Advance to the end or a limit; return how that ended."""
        motion = self.motion
        motion.set_velocities(velocity_nd)
        self.start = motion.see()
        self._keep(self.start)
        while motion.steps < self.steps:
            due = self.steps - motion.steps
            if self.trace_every is not None:
                due = min(due, self.trace_every - motion.steps % self.trace_every)
            status = motion.follow(method, due)
            if status != RUNNING:
                return Outcome.STEP_TOO_LONG
            now = motion.see()
            if not motion.sane(now, self.start):
                return Outcome.STEP_TOO_LONG
            self._keep(now)
            if self.progress is not None:
                figures = {"steps": motion.steps, "time": motion.time, "energy": now.total}
                self.progress(type(method).__name__, figures)
            if time.process_time() > self.deadline and motion.steps < self.steps:
                return Outcome.INTERRUPTED
        return Outcome.FINISHED

    def _keep(self, now: Sight) -> None:
        motion, largest = self.motion, self.largest
        self.last, self.state, self.reached = now, motion.state(), motion.steps
        if isinstance(motion, Marching):
            self.box, self.spin_nk = motion.march.box(), motion.march.spins()
        moved = float(np.abs(now.momentum_d - self.start.momentum_d).max())
        seen = {"energy": abs(now.energy) + now.kinetic, "impulse": now.impulse, "momentum": moved}
        for name, value in {**seen, "link": now.link_error}.items():
            largest[name] = max(largest[name], value)
        every = self.trace_every
        if every is not None and (motion.steps % every == 0 or motion.steps == self.steps):
            self.kept.append((motion.steps, now))
            if self.position_t is not None:
                self.position_t.append(self.state[0])
                self.velocity_t.append(self.state[1])

    def finish(self, method: Any, outcome: Outcome) -> Simulation:
        """Return the run as far as it came."""
        last, largest = self.last, self.largest
        residual = last.max_force / last.mean_force if last.mean_force > 0 else 0.0
        seconds = time.process_time() - self.began - self.build_seconds
        note = compiling_noted("", self.compiling(), seconds)
        return Simulation(
            packing=self._packing(),
            outcome=outcome,
            residual=residual,
            steps=self.reached,
            force_evaluations=self.motion.force_evaluations,
            seconds=seconds,
            build_seconds=self.build_seconds,
            stages=(
                Stage(type(method).__name__, residual, self.reached, self.motion.force_evaluations, seconds, note),
            ),
            trace=self._trace(),
            velocity_nd=self.state[1],
            mass_n=self.mass_n,
            dt=self.dt,
            energy_drift=(last.total - self.start.total) / largest["energy"] if largest["energy"] > 0 else 0.0,
            momentum_error=largest["momentum"] / largest["impulse"] if largest["impulse"] > 0 else 0.0,
            link_error=largest["link"],
            tension_l=self.motion.tensions(last.tension_l),
            spin_nk=self.spin_nk,
            strain=last.strain,
        )

    def _packing(self) -> Packing:
        if self.box is not None:
            return self.scene.packing.replace(position_nd=self.state[0], box=self.box)
        return self.scene.packing.replace(position_nd=self.state[0])

    def _trace(self) -> MotionTrace | None:
        if self.trace_every is None or not self.kept:
            return None
        d = self.scene.packing.dimension
        step, kept = zip(*self.kept, strict=True)
        return MotionTrace(
            step_t=np.array(step, dtype=np.int64),
            energy_t=np.array([now.energy for now in kept]),
            pressure_t=np.array([(0.0 - float(np.trace(now.stress_dd))) / d for now in kept]),
            contacts_t=np.array([now.contacts for now in kept], dtype=np.int64),
            max_force_t=np.array([now.max_force for now in kept]),
            position_tnd=None if self.position_t is None else np.array(self.position_t),
            time_t=np.array([now.time for now in kept]),
            kinetic_t=np.array([now.kinetic for now in kept]),
            momentum_td=np.array([now.momentum_d for now in kept]),
            stress_tdd=np.array([now.stress_dd for now in kept]),
            kinetic_stress_tdd=np.array([now.kinetic_stress_dd for now in kept]),
            link_error_t=np.array([now.link_error for now in kept]),
            overall_stress_tdd=np.array(
                [now.stress_dd if now.overall_stress_dd is None else now.overall_stress_dd for now in kept]
            ),
            strain_t=np.array([now.strain for now in kept]),
            strain_rate_t=np.array([now.strain_rate for now in kept]),
            sliding_t=np.array([now.sliding for now in kept], dtype=np.int64),
            velocity_tnd=None if self.position_t is None else np.array(self.velocity_t),
        )
