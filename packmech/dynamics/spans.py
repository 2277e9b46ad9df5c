"""Motion in spans of time steps: in each the box deforms at one rate, which answers to the stress at its start."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.projection import strain_box
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.integrators import stiffness_and_damping
from packmech.dynamics.ledger import EnergyLedger, ledger_of
from packmech.dynamics.observables import (
    CONTACTS,
    KINETIC,
    LARGEST_FORCE,
    POTENTIAL,
    ROTATIONAL,
    SLIDING,
    TANGENTIAL,
    TOTAL,
    link_stress,
    tensors,
)
from packmech.effects import Bonds, ContactDamping, Friction, MeshWalls, Rolling, TwistingResistance, Walls
from packmech.minimize.passes.kernels import RUNNING
from packmech.result import Condition, Outcome
from packmech.scene import Scene

# damping of contacts that brings packings to rest in some collisions, over sqrt(k m), and the part of it that is enough
_DASHPOT, _ENOUGH = 0.3, 0.1


def with_dashpot(scene: Scene) -> tuple[Scene, float]:
    """Return the scene with a dashpot at each contact where nothing else would take energy out, and its damping.

    It is .3 sqrt(k m) [mass/time], k the stiffness of a contact and m the mean mass, and 0 where the scene's own
    dashpots have a tenth of that, or a background drag as much for a particle. Where all is at rest it does nothing.
    """
    across = Friction | Rolling | TwistingResistance | Bonds | Walls | MeshWalls
    pairs = scene.replace(effects=tuple(one for one in scene.effects if not isinstance(one, across)))
    stiff, damped, drag = stiffness_and_damping(pairs)
    mass = float(scene.packing.mass_n.mean())
    damping = _DASHPOT * math.sqrt(stiff * mass)
    if max(damped, drag * mass) >= _ENOUGH * damping:
        return scene, 0.0
    return scene.replace(effects=(*scene.effects, ContactDamping(damping))), damping


class Spans:
    """A scene on its way through time, in a box whose rate of strain is chosen again for every span of steps.

    Attributes
    ----------
    scene
        The scene as it is now.
    velocity_nd, spin_nk
        (N, d) velocities relative to the box's flow, (N, 1 or 3) spins or None.
    steps
        Steps taken.
    ledger
        Where the energy went, if it is kept.
    is_crowded
        Whether the last span was given up as a sphere touched a rough surface at more places than it has springs for.
    stress_dd
        (d, d) stress now, links', kinetic and torques' parts included; tension positive [energy/length^d].

    """

    def __init__(
        self,
        scene: Scene,
        dt: float,
        velocity_nd: NDArray[np.float64] | None = None,
        spin_nk: NDArray[np.float64] | None = None,
        *,
        ledger: bool = False,
        threads: int = 1,
    ) -> None:
        self.scene, self.dt, self.steps, self._threads = scene, dt, 0, threads
        self.is_crowded = False
        self._keeps_ledger = ledger
        # the engine whose book is the last, and where the tangential springs of bonds are
        self._booked: Engine | None = None
        self._bond_stretch_bk: NDArray[np.float64] | None = None
        self.velocity_nd = np.zeros_like(scene.packing.position_nd) if velocity_nd is None else velocity_nd
        self.spin_nk = spin_nk
        self._limits: tuple[Condition, ...] = ()
        d = scene.packing.dimension
        self._look(self._engine(np.zeros((d, d)), 1))

    def advance(self, rate_dd: NDArray[np.float64], steps: int) -> bool:
        """Take so many steps in which the box deforms at this (d, d) rate; return whether they were short enough.

        The deformation gradient is 1 + t rate from the start of the span on; where steps were too long everything stays
        as it was. A box of linked particles, whose links the engine holds in a box at rest alone, is strained at once:
        clusters go along without slip at their contacts.
        """
        before = self.scene
        if before.packing.links:
            tangential = before.packing.tangential
            strained = strain_box(before.packing, steps * self.dt * rate_dd).replace(tangential=tangential)
            self.scene = before.replace(packing=strained)
        engine = self._engine(rate_dd, steps)
        self._limits = engine.limits()
        status = engine.advance(steps)
        self.is_crowded = engine.is_crowded
        if status != RUNNING or self.is_crowded:
            self.scene = before
            return False
        self.steps += steps
        self._bond_stretch_bk = engine.bond_displacements()
        self.scene = self.scene.replace(packing=engine.packing())
        self.velocity_nd, self.spin_nk = engine.velocities(), engine.spins()
        self._look(engine)
        return True

    @property
    def ledger(self) -> EnergyLedger | None:
        """Where the energy went in all spans, with figures at their ends; None unless it is kept."""
        return None if self._booked is None else ledger_of(self._booked)

    def limits(self) -> tuple[Condition, ...]:
        """Return the limit that the time step does not keep, if there is one."""
        return self._limits

    def stop(self) -> None:
        """Take all motion relative to the box's flow away."""
        self.velocity_nd = np.zeros_like(self.velocity_nd)
        if self.spin_nk is not None:
            self.spin_nk = np.zeros_like(self.spin_nk)

    @property
    def contacts(self) -> int:
        """Number of touching pairs."""
        return int(self.row[CONTACTS])

    @property
    def sliding(self) -> int:
        """Number of contacts at the Coulomb limit."""
        return int(self.row[SLIDING])

    @property
    def kinetic_energy(self) -> float:
        """Kinetic energy, of spins too, relative to the box's flow [energy]."""
        return float(self.row[KINETIC] + self.row[ROTATIONAL])

    @property
    def potential_energy(self) -> float:
        """Energy of contacts, tangential springs and single particles [energy]."""
        return float(self.row[POTENTIAL] + self.row[TANGENTIAL])

    @property
    def pressure(self) -> float:
        """Pressure, -trace/d of the stress [energy/length^d]."""
        return -float(np.trace(self.stress_dd)) / len(self.stress_dd)

    def shear_stress(self, axes: tuple[int, int]) -> float:
        """Return the component of the stress along two axes, its mean with the transposed one [energy/length^d]."""
        a, b = axes
        return 0.5 * float(self.stress_dd[a, b] + self.stress_dd[b, a])

    @property
    def residual(self) -> float:
        """Largest net force over the mean contact force [1]; nan where nothing touches."""
        mean = self.row[TOTAL] / self.row[CONTACTS] if self.row[CONTACTS] else 0.0
        return float(self.row[LARGEST_FORCE] / mean) if mean > 0.0 else math.nan

    def come_to_rest(self, advance: Callable[[], Outcome], at_rest: Callable[[], bool], every: int) -> Outcome:
        """Take spans until everything is at rest: all motion is stopped whenever the kinetic energy has begun to fall.

        Each mode gives up its energy where it has most of it, however slow it is (dynamic relaxation, Cundall 1976).

        Parameters
        ----------
        advance
            Takes a span; anything but FINISHED ends the work.
        at_rest
            Whether this is rest, asked every so many spans.
        every
            So many.

        """
        count, energy = 0, 0.0
        while True:
            outcome = advance()
            if outcome is not Outcome.FINISHED:
                return outcome
            count += 1
            before, energy = energy, self.kinetic_energy
            if energy < before:
                self.stop()
                energy = 0.0
            if count % every == 0 and at_rest():
                return Outcome.CONVERGED

    def _engine(self, rate_dd: NDArray[np.float64], steps: int) -> Engine:
        """Return the engine of what is there now, in a box that deforms at this rate for so many steps."""
        size = float(np.abs(rate_dd).max())
        still = bool(self.scene.packing.links)
        engine = build_engine(
            self.scene,
            dt=self.dt,
            velocity_nd=self.velocity_nd,
            spin_nk=self.spin_nk,
            profile=None if still else Ramp(0.0, size, 0.0, math.inf),
            direction_dd=None if still else rate_dd / size if size > 0.0 else np.eye(len(rate_dd)),
            ledger_every=steps if self._keeps_ledger else None,
            bond_stretch_bk=self._bond_stretch_bk,
            threads=self._threads,
        )
        if engine.book is not None and self._booked is not None:
            engine.go_on_with_book_of(self._booked)
        return engine

    def _look(self, engine: Engine) -> None:
        self.row = engine.observe()
        if engine.book is not None:
            self._booked = engine
        d, volume = self.scene.packing.dimension, engine.box().volume
        self.stress_dd = tensors(self.row, d, volume)["overall"] + link_stress(self.row, d, volume)
