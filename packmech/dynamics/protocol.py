"""What every jamming protocol works with: the compiled scene, reduced units, stages, and relaxation in a given box."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import compile_clock, compiling_noted
from packmech.dynamics.fire import Fire
from packmech.dynamics.kernels import RUNNING, Goal
from packmech.dynamics.program import OUTCOME_OF, Minimizer, Program, Relaxation, build_program
from packmech.dynamics.soft_network import Units, length_unit
from packmech.dynamics.tether import scale_box
from packmech.measure import packing_fraction
from packmech.outcome import Stage
from packmech.packing import Packing
from packmech.scene import Scene

_PORTION = 5_000_000
# steps between two looks of someone who watches
_WATCHED = 20
Progress = Callable[[str, dict[str, Any]], None]


class Figures:
    """What a stage achieved, filled in while it runs."""

    def __init__(self) -> None:
        self.residual, self.steps, self.force_evaluations, self.note = float("nan"), 0, 0, ""

    def take(self, done: Relaxation) -> None:
        """Take over what FIRE achieved and cost."""
        self.residual, self.steps, self.force_evaluations = done.residual, done.steps, done.force_evaluations


class Protocol:
    """One jamming run on its way: stages so far, last finished packing, and the tools of the methods.

    Parameters
    ----------
    scene
        The scene.
    basis_kdd
        (k, d, d) free strains.
    strain
        Their name.
    force_tolerance
        Net force over mean contact force that counts as balance [1].
    progress
        Called with a stage's name and its figures.

    """

    def __init__(
        self,
        scene: Scene,
        basis_kdd: NDArray[np.float64],
        strain: str,
        force_tolerance: float,
        progress: Progress | None,
    ) -> None:
        self.scene, self.basis_kdd, self.strain, self.force_tolerance = scene, basis_kdd, strain, force_tolerance
        self._progress = progress
        self.stages: list[Stage] = []
        self.last = scene.packing
        self.report: dict[str, Any] = {}
        self.length = length_unit(scene.packing)
        self.units = Units(scene.effects, self.length, scene.energy_scale)
        self._program: Program | None = None
        self.build_seconds = 0.0

    @property
    def program(self) -> Program:
        """The compiled scene."""
        if self._program is None:
            began = time.process_time()
            self._program = build_program(self.scene)
            self.build_seconds = time.process_time() - began
        return self._program

    def tell(self, stage: str, **figures: Any) -> None:
        """Pass figures on to whoever watches."""
        if self._progress is not None:
            self._progress(stage, figures)

    def watcher(self, stage: str, *, reduced: bool) -> Callable[[Packing], None] | None:
        """Return what passes packings on to whoever watches a stage, in reduced lengths or not; None if nobody does."""
        if self._progress is None:
            return None

        def watch(packing: Packing) -> None:
            self.tell(stage, packing=self.restored(packing) if reduced else packing)

        return watch

    @contextmanager
    def stage(self, name: str) -> Iterator[Figures]:
        """Time one part of the protocol and keep what it achieved."""
        figures = Figures()
        began = time.process_time()
        self.tell(name)
        compiling = 0.0
        try:
            with compile_clock() as clock:
                yield figures
                compiling = clock()
        except KeyboardInterrupt:
            figures.note = figures.note or "interrupted"
            raise
        finally:
            seconds = time.process_time() - began
            note = compiling_noted(figures.note, compiling, seconds)
            done = Stage(name, figures.residual, figures.steps, figures.force_evaluations, seconds, note)
            self.stages.append(done)
            self.tell(
                name, packing=self.last, residual=done.residual, steps=done.steps, seconds=seconds, note=done.note
            )

    def reduced_pressure(self, pressure: float) -> float:
        """Return a pressure given in the scene's unit [energy_scale / reference diameter^d] in reduced units."""
        return pressure * (self.length / self.scene.packing.reference_diameter) ** self.scene.packing.dimension

    def reduced(self, packing: Packing) -> Packing:
        """Return the packing in reduced lengths."""
        return self.units.reduced(packing)

    def restored(self, packing: Packing) -> Packing:
        """Return a packing of reduced lengths in the scene's own, with the scene's radii exactly."""
        return self.units.restored(packing, self.scene.packing)

    def at_fraction(self, packing: Packing, fraction: float) -> Packing:
        """Return the packing with its box, and the centers of particles or clusters, scaled to a packing fraction."""
        return scale_box(packing, (packing_fraction(packing) / fraction) ** (1.0 / packing.dimension))

    def relax(
        self,
        packing: Packing,
        force_tolerance: float,
        step_limit: int,
        floor: float = 0.0,
        method: Minimizer | None = None,
    ) -> tuple[Packing, Relaxation]:
        """Return the packing that a minimizer relaxes to in the box as it is, and how that went.

        Parameters
        ----------
        packing
            Where to start.
        force_tolerance, step_limit
            When to stop.
        floor
            Mean contact force at which the packing counts as unjammed [energy_scale / reference diameter].
        method
            Fire() unless given.

        """
        program = self.program
        goal = Goal(force_tolerance, floor * self.scene.energy_scale / packing.reference_diameter)
        method = Fire() if method is None else method
        program.place(packing.position_nd, packing.box.lattice_dd)
        state = method.start(program)
        # in portions of a fraction of a second, so that an interruption is heard
        portion = max(1, _PORTION // packing.particles)
        if self._progress is not None:
            portion = min(portion, _WATCHED)
        while True:
            status = method.advance(program, goal, state, min(portion, step_limit - state.steps))
            if status != RUNNING or state.steps >= step_limit:
                break
            self.last = packing.replace(position_nd=program.positions())
            self.tell("relaxation", steps=state.steps, packing=self.last)
        end = program.evaluate()
        self.last = packing.replace(position_nd=program.positions())
        done = Relaxation(
            position_nd=self.last.position_nd,
            outcome=OUTCOME_OF[status],
            residual=end.residual,
            max_force=end.max_force,
            mean_force=end.mean_force,
            energy=end.energy,
            pressure=end.pressure,
            contacts=end.contacts,
            steps=state.steps,
            force_evaluations=state.force_evaluations + 1,
        )
        return self.last, done
