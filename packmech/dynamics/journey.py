"""One simulation on its way: its motion, what was kept, its limits, and its checkpoints."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.compiled import compiling_noted
from packmech.dynamics.checkpoint import Checkpoint, engine_leaves, restore_engine, scene_marks, write_checkpoint
from packmech.dynamics.growth import watch_of
from packmech.dynamics.keepsakes import Scenery, sceneries, scenery_arrays, sight_arrays, sights_of, trace_of_sights
from packmech.dynamics.kernels import RUNNING
from packmech.dynamics.march.journey import Marching, needs_march
from packmech.dynamics.march.touching import touching_of
from packmech.dynamics.motion import Motion, Sight
from packmech.dynamics.program import build_program
from packmech.dynamics.simulation import MotionTrace, Simulation
from packmech.dynamics.strain import OscillatoryStrain, SteadyStrain, Strain
from packmech.dynamics.verlet import INTEGRATORS, SemiImplicitEuler, VelocityVerlet
from packmech.interrupts import held_interrupts
from packmech.outcome import Outcome, Stage
from packmech.packing import Packing
from packmech.records import from_table, kinds_of, to_table
from packmech.scene import Scene

Progress = Callable[[str, dict[str, Any]], None]
Method = VelocityVerlet | SemiImplicitEuler


@dataclass(frozen=True)
class Plan:
    """Checked settings of a simulation; a checkpoint keeps all but the scene."""

    scene: Scene
    mass_n: NDArray[np.float64]
    dt: float
    steps: int
    method: Method
    strain: Strain | None = None
    held_n: NDArray[np.bool_] | None = None
    trace_every: int | None = None
    trace_positions: bool = False
    checkpoint: Path | None = None
    checkpoint_every: int | None = None
    threads: int = 1

    def told(self) -> dict[str, Any]:
        """Return the settings that are no arrays, as JSON knows them."""
        return {
            "dt": self.dt,
            "steps": self.steps,
            "method": to_table(self.method),
            "strain": None if self.strain is None else to_table(self.strain),
            "trace_every": self.trace_every,
            "trace_positions": self.trace_positions,
            "checkpoint_every": self.checkpoint_every,
            "scene": scene_marks(self.scene),
        }


def plan_of(found: Checkpoint, scene: Scene, path: Any, steps: int, threads: int) -> Plan:
    """Return the plan that a checkpoint holds, for the scene that it was made of, to another end on so many threads."""
    told, arrays = found
    strain, method = told["strain"], told["method"]
    if strain is not None:
        strain = from_table(strain, "strain", kinds_of((SteadyStrain, OscillatoryStrain)))
    return Plan(
        scene,
        arrays["mass_n"],
        float(told["dt"]),
        steps,
        from_table(method, "method", kinds_of(INTEGRATORS)),
        strain,
        arrays.get("held_n"),
        told["trace_every"],
        bool(told["trace_positions"]),
        Path(path),
        told["checkpoint_every"],
        threads,
    )


class Journey:
    """One simulation on its way."""

    def __init__(
        self,
        plan: Plan,
        *,
        spin_nk: NDArray[np.float64] | None = None,
        time_limit: float = math.inf,
        progress: Progress | None = None,
    ) -> None:
        self.began = time.process_time()
        self.plan, self.scene = plan, plan.scene
        scene, mass_n = plan.scene, plan.mass_n
        self.motion: Any
        if needs_march(scene, plan.strain) or plan.held_n is not None:
            self.motion = Marching(
                scene,
                mass_n,
                plan.dt,
                second_order=isinstance(plan.method, VelocityVerlet),
                spin_nk=spin_nk,
                strain=plan.strain,
                held_n=plan.held_n,
                threads=plan.threads,
            )
        elif plan.threads > 1:
            raise ValueError(
                "threads must be 1 for a scene without friction, bonds, body forces, strain and held particles, "
                f"got {plan.threads}"
            )
        else:
            program = build_program(scene)
            self.motion = Motion(program, scene.effects, 1.0 / mass_n[program.order_n], None, plan.dt)
            self.motion.affix()
        self.build_seconds = time.process_time() - self.began
        self.seconds_before = 0.0
        self.progress = progress
        self.deadline = self.began + time_limit
        self.compiling: Callable[[], float] = lambda: 0.0
        self.kept: list[tuple[int, Sight]] = []
        self.position_t: list[NDArray[np.float64]] | None = [] if plan.trace_positions else None
        self.velocity_t: list[NDArray[np.float64]] = []
        self.scenery: list[Scenery] = []
        self.largest = {"energy": 0.0, "impulse": 0.0, "momentum": 0.0, "link": 0.0}
        self.watch = watch_of(scene, plan.strain, plan.dt)
        self.start = self.last = self._blank()
        self.state = (scene.packing.position_nd, np.zeros_like(scene.packing.position_nd))
        self.reached = 0
        # the step at which figures are looked at next: checkpoints in between change none of them
        self.end = 0
        self.box: Box | None = None
        self.spin_nk: NDArray[np.float64] | None = None

    def _blank(self) -> Sight:
        d = self.scene.packing.dimension
        nothing, none = (
            np.zeros((d, d)),
            np.zeros(0 if self.motion.rattle is None else len(self.motion.rattle.impulse_r)),
        )
        return Sight(0.0, 0.0, 0.0, np.zeros(d), 0.0, nothing, nothing, 0, 0.0, 0.0, 0.0, none)

    def begin(self, velocity_nd: NDArray[np.float64]) -> None:
        """Set out with (N, d) velocities."""
        with held_interrupts():
            self.motion.set_velocities(velocity_nd)
            self.start = self.motion.see()
            self.watch.remember(self.start, 0)
            self._keep(self.start)

    def go(self) -> Outcome:
        """Advance to the end or a limit; return how that ended. Checkpoints hold whatever was finished."""
        try:
            outcome = self._go()
        except KeyboardInterrupt:
            self.save()
            raise
        if outcome is not Outcome.STEP_TOO_LONG:
            self.save()
        return outcome

    def _go(self) -> Outcome:
        motion, plan = self.motion, self.plan
        while motion.steps < plan.steps:
            if motion.steps >= self.end:
                due = plan.steps - motion.steps
                if plan.trace_every is not None:
                    due = min(due, plan.trace_every - motion.steps % plan.trace_every)
                self.end = motion.steps + motion.stride(due)
            # what a step changes is changed wholly before Ctrl-C is heard
            with held_interrupts():
                part = self.end - motion.steps
                if plan.checkpoint_every is not None:
                    part = min(part, plan.checkpoint_every - motion.steps % plan.checkpoint_every)
                if motion.follow(plan.method, part) != RUNNING:
                    return Outcome.STEP_TOO_LONG
                looked = motion.steps == self.end
                if looked:
                    now = motion.see()
                    if not self.watch.calm(now, self.last, self.start, motion.steps):
                        return Outcome.STEP_TOO_LONG
                    self._keep(now)
                if plan.checkpoint_every is not None and motion.steps % plan.checkpoint_every == 0:
                    self.save()
            if looked and self.progress is not None:
                figures: dict[str, Any] = {"steps": motion.steps, "time": motion.time, "energy": self.last.total}
                if isinstance(motion, Marching):
                    figures |= {"strain": self.last.strain, "march": motion.march}
                self.progress(type(plan.method).__name__, figures)
            if time.process_time() > self.deadline and motion.steps < plan.steps:
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
        every = self.plan.trace_every
        if every is not None and (motion.steps % every == 0 or motion.steps == self.plan.steps):
            self.kept.append((motion.steps, now))
            if self.position_t is not None:
                self.position_t.append(self.state[0])
                self.velocity_t.append(self.state[1])
                if isinstance(motion, Marching):
                    lattice = motion.march.box().lattice_dd
                    self.scenery.append(Scenery(lattice, self.spin_nk, touching_of(motion.march)))

    def save(self) -> None:
        """Write a checkpoint, if any are asked for."""
        plan = self.plan
        if plan.checkpoint is None:
            return
        arrays = engine_leaves(self.motion) | {"mass_n": plan.mass_n}
        if plan.held_n is not None:
            arrays["held_n"] = plan.held_n
        arrays |= sight_arrays([self.start, self.last, *(now for _, now in self.kept)])
        arrays["kept_step_t"] = np.array([step for step, _ in self.kept], dtype=np.int64)
        if self.position_t is not None:
            shape = (-1, *self.scene.packing.position_nd.shape)
            arrays["kept_position_tnd"] = np.array(self.position_t).reshape(shape)
            arrays["kept_velocity_tnd"] = np.array(self.velocity_t).reshape(shape)
            arrays |= scenery_arrays(self.scenery)
        arrays["state_position_nd"], arrays["state_velocity_nd"] = self.state
        if self.box is not None:
            arrays["state_lattice_dd"] = self.box.lattice_dd
        if self.spin_nk is not None:
            arrays["state_spin_nk"] = self.spin_nk
        told = {
            **plan.told(),
            "reached": self.reached,
            "end": self.end,
            "largest": self.largest,
            "watch": self.watch.told(),
            "seconds": self._seconds(),
        }
        with held_interrupts():
            write_checkpoint(plan.checkpoint, told, arrays)

    def restore(self, told: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
        """Go back to where a checkpoint was made."""
        restore_engine(self.motion, arrays)
        self.start, self.last, *sights = sights_of(arrays)
        every = self.plan.trace_every
        step_t = arrays["kept_step_t"].tolist()
        # the last step of a run that goes on is kept no longer, unless its turn has come
        chosen = [t for t, step in enumerate(step_t) if every is not None and step % every == 0]
        self.kept = [(step_t[t], sights[t]) for t in chosen]
        if self.position_t is not None:
            self.position_t = [arrays["kept_position_tnd"][t] for t in chosen]
            self.velocity_t = [arrays["kept_velocity_tnd"][t] for t in chosen]
            scenery = sceneries(arrays)
            self.scenery = [scenery[t] for t in chosen] if scenery else []
        self.state = arrays["state_position_nd"], arrays["state_velocity_nd"]
        if "state_lattice_dd" in arrays:
            self.box = Box(arrays["state_lattice_dd"])
        self.spin_nk = arrays.get("state_spin_nk")
        self.reached, self.largest = int(told["reached"]), {name: float(x) for name, x in told["largest"].items()}
        self.watch = dataclasses.replace(self.watch, **told["watch"])
        self.end, self.seconds_before = min(int(told["end"]), self.plan.steps), float(told["seconds"])

    def _seconds(self) -> float:
        return self.seconds_before + time.process_time() - self.began - self.build_seconds

    def finish(self, outcome: Outcome) -> Simulation:
        """Return the run as far as it came."""
        last, largest, plan = self.last, self.largest, self.plan
        residual = last.max_force / last.mean_force if last.mean_force > 0 else 0.0
        seconds = self._seconds()
        note = compiling_noted("", self.compiling(), seconds)
        evaluations, name = self.motion.force_evaluations, type(plan.method).__name__
        return Simulation(
            packing=self._packing(),
            outcome=outcome,
            residual=residual,
            steps=self.reached,
            force_evaluations=evaluations,
            seconds=seconds,
            build_seconds=self.build_seconds,
            stages=(Stage(name, residual, self.reached, evaluations, seconds, note),),
            trace=self._trace(),
            velocity_nd=self.state[1],
            mass_n=plan.mass_n,
            dt=plan.dt,
            energy_drift=(last.total - self.start.total) / largest["energy"] if largest["energy"] > 0 else 0.0,
            momentum_error=largest["momentum"] / largest["impulse"] if largest["impulse"] > 0 else 0.0,
            link_error=largest["link"],
            tension_l=self.motion.tensions(last.tension_l),
            spin_nk=self.spin_nk,
            strain=last.strain,
            held_n=plan.held_n,
        )

    def _packing(self) -> Packing:
        if self.box is not None:
            return self.scene.packing.replace(position_nd=self.state[0], box=self.box)
        return self.scene.packing.replace(position_nd=self.state[0])

    def _trace(self) -> MotionTrace | None:
        if self.plan.trace_every is None or not self.kept:
            return None
        return trace_of_sights(self.kept, self.position_t, self.velocity_t, self.scenery)
