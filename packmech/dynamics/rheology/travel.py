"""A march under strain from start to end: checked arguments, figures kept on the way, and the run that comes of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, integer, positive, positive_array
from packmech.dynamics.kernels import RUNNING
from packmech.dynamics.march.flow import Ramp
from packmech.dynamics.march.journey import tensors
from packmech.dynamics.march.look import (
    BONDED,
    CONTACTS,
    KINETIC,
    MOST,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TOTAL,
)
from packmech.dynamics.march.state import March, build_march, homing_steps
from packmech.dynamics.march.tally import Ledger, new_ledger
from packmech.dynamics.march.touching import Touching, touching_of
from packmech.dynamics.motion import choose_time_step
from packmech.dynamics.settings import check_manner
from packmech.dynamics.verlet import INTEGRATORS, SemiImplicitEuler, VelocityVerlet
from packmech.effects import Bonds, Friction
from packmech.outcome import Outcome, Run, Stage
from packmech.packing import without_links
from packmech.scene import Scene

Method = VelocityVerlet | SemiImplicitEuler
Progress = Callable[[str, dict[str, Any]], None]
# numbers in the loops' arrays times steps between two looks at the clock
_CHUNK = 1_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class StrainRun(Run):
    """What a scene did while it was strained; (T,) arrays against time, the start included.

    Attributes
    ----------
    time_t, strain_t, rate_t
        Times [time], strain gamma of the box [1] and its rate [1/time].
    stress
        (T, d, d) tensors by name, Cauchy, tension positive [energy/length^d]: "contact" (forces of contacts and bonds
        times branch vectors), "torque", "spin", "overall" (the sum of these three, symmetric), "kinetic" (in no other),
        and "bond" (the part of "contact" that bonds bear).
    potential_t, tangential_t, kinetic_t, rotational_t
        Energies [energy]: of laws, of tangential springs, of peculiar velocities and of spins.
    contacts_t, sliding_t
        Numbers of touching pairs (bonds not among them), and of those at Coulomb's cap.
    axes
        The component of the stress that answers to the strain.
    dt
        The time step [time].
    mass_n, velocity_nd, spin_nk
        (N,) masses; (N, d) peculiar velocities and (N, 1 or 3) spins at the end (None where particles do not turn).
    frame_time_f, position_fnd, lattice_fdd
        (F,) times, (F, N, d) positions and (F, d, d) lattice vectors of the frames that were asked for.
    spin_fnk, touching_f
        (F, N, 1 or 3) spins of the frames (None where particles do not turn), and who touches whom there.
    held_n
        (N,) who was held, if anybody was.

    """

    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    rate_t: NDArray[np.float64]
    stress: dict[str, NDArray[np.float64]]
    potential_t: NDArray[np.float64]
    tangential_t: NDArray[np.float64]
    kinetic_t: NDArray[np.float64]
    rotational_t: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    sliding_t: NDArray[np.int64]
    axes: tuple[int, int]
    dt: float
    mass_n: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    frame_time_f: NDArray[np.float64]
    position_fnd: NDArray[np.float64]
    lattice_fdd: NDArray[np.float64]
    spin_fnk: NDArray[np.float64] | None = None
    touching_f: tuple[Touching, ...] = ()
    held_n: NDArray[np.bool_] | None = None

    @property
    def shear_stress_t(self) -> NDArray[np.float64]:
        """The (T,) component of the overall stress that answers to the strain [energy/length^d]."""
        a, b = self.axes
        return np.asarray(self.stress["overall"][:, a, b])

    @property
    def pressure_t(self) -> NDArray[np.float64]:
        """The (T,) pressures -trace/d of the overall stress [energy/length^d]."""
        overall = self.stress["overall"]
        return np.asarray(-np.trace(overall, axis1=1, axis2=2) / overall.shape[1])

    @property
    def sliding_fraction_t(self) -> NDArray[np.float64]:
        """The (T,) parts of the contacts that slide [1]; 0 where nothing touches."""
        return np.asarray(self.sliding_t / np.maximum(self.contacts_t, 1))


@dataclass(frozen=True)
class Manner:
    """Checked arguments that all strained runs share."""

    scene: Scene
    method: Method
    mass_n: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    held_n: NDArray[np.bool_] | None
    longest: float
    deadline: float
    progress: Progress | None


def check_arguments(
    scene: Scene,
    *,
    dt: float | None,
    method: Method | None,
    mass_n: ArrayLike | None,
    velocity_nd: ArrayLike | None,
    spin_nk: ArrayLike | None,
    held_n: ArrayLike | None,
    time_limit: float | None,
    progress: Progress | None,
    check: bool,
) -> Manner:
    """Return the arguments as the march takes them.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    instance("scene", scene, Scene)
    without_links("scene.packing", scene.packing)
    packing = scene.packing
    n, d = packing.particles, packing.dimension
    method = VelocityVerlet() if method is None else method
    if not isinstance(method, INTEGRATORS):
        raise TypeError(f"method must be VelocityVerlet() or SemiImplicitEuler(), got {method!r}")
    fraction = positive("method.fraction", method.fraction)
    if mass_n is None:
        mass = (packing.diameter_n / packing.reference_diameter) ** d
    else:
        mass = positive_array("mass_n", mass_n, shape=(n,))
    velocity = np.zeros((n, d)) if velocity_nd is None else finite_array("velocity_nd", velocity_nd, shape=(n, d))
    spin = None if spin_nk is None else finite_array("spin_nk", spin_nk, shape=(n, 1 if d == 2 else 3))
    held = None
    if held_n is not None:
        held = np.asarray(held_n)
        if held.dtype != bool:
            raise TypeError(f"held_n must be True or False for each particle, got {held_n!r}")
        if held.shape != (n,):
            raise ValueError(f"held_n must have shape ({n},), got {held.shape}")
        velocity[held] = 0.0
    longest = choose_time_step(scene, mass, fraction) if dt is None else positive("dt", dt)
    limit = math.inf if time_limit is None else positive("time_limit", time_limit)
    check_manner(progress, check)
    return Manner(scene, method, mass, velocity, spin, held, longest, time.process_time() + limit, progress)


class Travel:
    """One strained run on its way: its march, the rows that were kept, and its limits."""

    def __init__(
        self,
        manner: Manner,
        *,
        dt: float,
        steps: int,
        every: int,
        profile: Any,
        direction_dd: NDArray[np.float64],
        frames: int = 0,
    ) -> None:
        self.began = time.process_time()
        self.manner, self.dt, self.steps, self.every = manner, dt, steps, every
        self.march: March = build_march(
            manner.scene,
            dt=dt,
            mass_n=manner.mass_n,
            velocity_nd=manner.velocity_nd,
            spin_nk=manner.spin_nk,
            profile=profile,
            direction_dd=direction_dd,
            held_n=manner.held_n,
            second_order=isinstance(manner.method, VelocityVerlet),
        )
        self.ledger: Ledger = new_ledger(every, steps // every)
        self.march.begin()
        self.first = self.march.see()
        self.build_seconds = time.process_time() - self.began
        # rows that are kept in place of the ledger's, where the run is driven from outside
        self.driven_rows: list[NDArray[np.float64]] | None = None
        self.chunk = max(1, _CHUNK // self.march.state.body.size)
        self.due_f = np.unique(np.linspace(0, steps, frames).round().astype(np.int64))
        self.frames: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
        self.seen: list[tuple[NDArray[np.float64] | None, Touching]] = []
        self._frame()

    def _frame(self) -> None:
        if len(self.frames) < len(self.due_f) and self.march.steps >= self.due_f[len(self.frames)]:
            self.frames.append((self.march.time, self.march.positions(), self.march.box().lattice_dd))
            self.seen.append((self.march.spins(), touching_of(self.march)))

    def go(self, stage: str) -> Outcome:
        """Advance to the end or a limit; return how that ended."""
        while self.march.steps < self.steps:
            due = min(self.chunk, self.steps - self.march.steps)
            if len(self.frames) < len(self.due_f):
                due = min(due, int(self.due_f[len(self.frames)]) - self.march.steps)
            outcome = self.advance(due, stage)
            if outcome is not Outcome.FINISHED:
                return outcome
        return Outcome.FINISHED

    def advance(self, steps: int, stage: str, *, tell: bool = True) -> Outcome:
        """Advance by so many steps; return FINISHED unless a limit was met."""
        if self.march.advance(steps, self.ledger) != RUNNING:
            return Outcome.STEP_TOO_LONG
        self._frame()
        if tell and self.manner.progress is not None:
            march = self.march
            told = {"steps": march.steps, "of": self.steps, "time": march.time, "strain": march.gamma}
            self.manner.progress(stage, {**told, "march": march})
        if time.process_time() > self.manner.deadline and self.march.steps < self.steps:
            return Outcome.INTERRUPTED
        return Outcome.FINISHED

    def drive(self, rate: float) -> None:
        """Let gamma go on from where it is at another rate."""
        march = self.march
        march.profile = Ramp(march.gamma, rate, march.time, math.inf)
        assert march.space.flow is not None
        march.space = march.space._replace(flow=march.space.flow._replace(profile=march.profile))
        march.homing = homing_steps(march)

    def rows(self) -> NDArray[np.float64]:
        """Return the figures kept so far, the start first."""
        if self.driven_rows is not None:
            return np.array(self.driven_rows)
        written = int(self.ledger.written[0])
        return np.concatenate([self.first[None], self.ledger.row_tk[:written]])

    def fields(self, stage: str, outcome: Outcome, axes: tuple[int, int]) -> dict[str, Any]:
        """Return the fields of a `StrainRun` as far as it came."""
        rows, manner, march = self.rows(), self.manner, self.march
        packing = manner.scene.packing
        n, d = packing.particles, packing.dimension
        # what the box spans goes with the determinant of 1 + gamma M
        direction = np.zeros((d, d)) if march.direction_dd is None else march.direction_dd
        stretch = np.linalg.det(np.eye(d) + rows[:, STRAIN, None, None] * direction)
        volume = packing.box.volume * stretch[:, None, None]
        stress = tensors(rows, d, 1.0)
        stress["bond"] = rows[:, BONDED : BONDED + 9].reshape(-1, 3, 3)[:, :d, :d]
        now = march.see()
        mean = now[TOTAL] / now[CONTACTS] if now[CONTACTS] else 0.0
        residual = float(now[MOST] / mean) if mean > 0.0 else 0.0
        seconds = time.process_time() - self.began - self.build_seconds
        return {
            "packing": packing.replace(position_nd=march.positions(), box=march.box()),
            "outcome": outcome,
            "residual": residual,
            "steps": march.steps,
            "force_evaluations": march.steps + 1,
            "seconds": seconds,
            "build_seconds": self.build_seconds,
            "stages": (Stage(stage, residual, march.steps, march.steps + 1, seconds),),
            "time_t": rows[:, TIME],
            "strain_t": rows[:, STRAIN],
            "rate_t": rows[:, RATE],
            "stress": {name: part / volume for name, part in stress.items()},
            "potential_t": rows[:, POTENTIAL],
            "tangential_t": rows[:, TANGENTIAL],
            "kinetic_t": rows[:, KINETIC],
            "rotational_t": rows[:, ROTATIONAL],
            "contacts_t": rows[:, CONTACTS].astype(np.int64),
            "sliding_t": rows[:, SLIDING].astype(np.int64),
            "axes": axes,
            "dt": self.dt,
            "mass_n": manner.mass_n,
            "velocity_nd": march.velocities(),
            "spin_nk": march.spins() if _turns(manner.scene) else None,
            "frame_time_f": np.array([one[0] for one in self.frames]),
            "position_fnd": np.array([one[1] for one in self.frames]).reshape(-1, n, d),
            "lattice_fdd": np.array([one[2] for one in self.frames]).reshape(-1, d, d),
            "spin_fnk": np.array([spin for spin, _ in self.seen]) if self.seen and _turns(manner.scene) else None,
            "touching_f": tuple(touching for _, touching in self.seen),
            "held_n": manner.held_n,
        }


def _turns(scene: Scene) -> bool:
    return any(isinstance(one, Friction | Bonds) for one in scene.effects)


def two_axes(axes: Any) -> tuple[int, int]:
    """Return the axes after checking that they are two of three."""
    if not isinstance(axes, tuple | list) or len(axes) != 2:
        raise TypeError(f"axes must be two axes, got {axes!r}")
    return (integer("axes", axes[0], at_least=0, at_most=2), integer("axes", axes[1], at_least=0, at_most=2))
