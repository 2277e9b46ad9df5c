"""What every jamming protocol works with: the compiled scene, reduced units, stages, and relaxation in a given box."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.projection import scale_box
from packmech.jit.compiled import compile_clock, compiling_noted
from packmech.loop.run_loop import RunLoop
from packmech.measure import packing_fraction
from packmech.minimize.fire import Fire
from packmech.minimize.kernels import Goal
from packmech.minimize.program import Minimization, Minimizer, Program, Relaxation, build_program
from packmech.minimize.soft_network import Units, length_unit
from packmech.packing import Packing
from packmech.result import Stage
from packmech.scene import Scene

# numbers times steps of a relaxation between two packings that an interrupt leaves, and steps where someone watches
_PORTION, _WATCHED = 5_000_000, 20


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
    loop
        The run loop of the call.

    """

    def __init__(
        self,
        scene: Scene,
        basis_kdd: NDArray[np.float64],
        strain: str,
        force_tolerance: float,
        loop: RunLoop,
    ) -> None:
        self.scene, self.basis_kdd, self.strain, self.force_tolerance = scene, basis_kdd, strain, force_tolerance
        self.loop = loop
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

    def watcher(self, stage: str, *, reduced: bool) -> Callable[[Packing], None] | None:
        """Return what passes packings on to whoever watches a stage, in reduced lengths or not; None if nobody does."""
        if self.loop.settings.progress is None:
            return None

        def watch(packing: Packing) -> None:
            self.loop.report(stage, packing=self.restored(packing) if reduced else packing)

        return watch

    @contextmanager
    def stage(self, name: str) -> Iterator[Figures]:
        """Time one part of the protocol and keep what it achieved."""
        figures = Figures()
        began = time.process_time()
        self.loop.report(name)
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
            self.loop.report(
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
        program.place(packing.position_nd, packing.box.lattice_dd)

        def keep(steps: int) -> None:
            if steps:
                self.last = packing.replace(position_nd=program.positions())

        stop_every = max(1, _PORTION // packing.particles)
        task = Minimization(
            program,
            Fire() if method is None else method,
            goal,
            step_limit,
            stop_every=stop_every if self.loop.settings.progress is None else min(stop_every, _WATCHED),
            keep=keep,
            describe=lambda steps: ("relaxation", {"steps": steps, "packing": self.last}),
        )
        done = task.relaxation(self.loop.advance(task))
        self.last = packing.replace(position_nd=done.position_nd)
        return self.last, done
