"""Strained runs: a scene under strain from start to end, what is kept on the way, and the run that comes of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import integer
from packmech.dynamics.breaking import BrokenBonds, numbers_of_broken, rows_of_broken
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.energy_drift import RowWatch
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.integrators import VelocityVerlet
from packmech.dynamics.ledger import EnergyLedger, every_of, ledger_of
from packmech.dynamics.observables import (
    BONDED,
    COLUMNS,
    CONTACTS,
    KINETIC,
    LARGEST_FORCE,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TOTAL,
    Ledger,
    new_ledger,
    tensors,
)
from packmech.dynamics.pair_forces import Touching, touching_of
from packmech.dynamics.simulation import (
    Snapshot,
    bonds_at,
    orientations_at,
    snapshot_arrays,
    snapshot_bounds,
    snapshots_of,
)
from packmech.effects import Bonds, bonds_of, roughness_of
from packmech.jit.interrupts import safe_interrupts
from packmech.loop.checkpoint import Arrays, IndexBounds, saved_array, scene_fingerprints
from packmech.measure.counting import packing_fraction
from packmech.minimize.passes.kernels import RUNNING
from packmech.observables import (
    State,
    Table,
    added_arrays,
    added_observables,
    added_rows,
    columns_in,
    columns_of,
    make_table,
    measure_added,
)
from packmech.result import Condition, Outcome, Row, Run, Stage, unmet_conditions
from packmech.rheology.arguments import StrainSettings
from packmech.rheology.walls import WallForces
from packmech.scene import Scene

# numbers in the loops' arrays times steps between two readings of the clock
_CHUNK = 1_000_000
# columns of a row that a run keeps as they are
_KEPT = {
    "time": TIME,
    "strain": STRAIN,
    "rate": RATE,
    "potential": POTENTIAL,
    "tangential": TANGENTIAL,
    "kinetic": KINETIC,
    "rotational": ROTATIONAL,
}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
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
    velocity_nd, spin_nk
        (N, d) peculiar velocities and (N, 1 or 3) spins at the end (None where particles do not turn).
    frame_time_f, position_fnd, lattice_fdd
        (F,) times, (F, N, d) positions and (F, d, d) lattice vectors of the frames that were asked for.
    spin_fnk, touching_f
        (F, N, 1 or 3) spins of the frames (None where particles do not turn), and who touches whom there.
    held_n
        (N,) who was held, if anybody was.
    bonds
        The bonds at the end; None in a scene without.
    broken_bonds
        Those that broke; None where no bond of the scene may break.
    ledger
        Where the energy went; None unless it was asked for.
    added
        (T, ...) arrays of the observables that were added by `pm.observable`, by name.

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
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    frame_time_f: NDArray[np.float64]
    position_fnd: NDArray[np.float64]
    lattice_fdd: NDArray[np.float64]
    spin_fnk: NDArray[np.float64] | None = None
    orientation_fnq: NDArray[np.float64] | None = None
    touching_f: tuple[Touching, ...] = ()
    held_n: NDArray[np.bool_] | None = None
    bonds: Bonds | None = None
    broken_bonds: BrokenBonds | None = None
    ledger: EnergyLedger | None = None
    added: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

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

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the observables that were kept, by name."""
        return {
            **columns_in(self, [one.name for one in fields(self)]),
            **{f"{name}_stress": tensor for name, tensor in self.stress.items()},
            **columns_in(self, ["pressure_t", "shear_stress_t", "sliding_fraction_t"]),
            **self.added,
        }

    def about(self) -> dict[str, Any]:
        """Return what a table of this run says of it."""
        return {**super().about(), "dt": self.dt}

    def table(self) -> Table:
        """Return every observable that the run kept, as columns."""
        return make_table(self.columns(), self.about())

    @property
    def flows(self) -> bool:
        """True: the box strains, or a stress moves it."""
        return True

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, strained to {float(self.strain_t[-1]):.6g}"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; stresses in the scene's units of energy/length^d."""
        return {
            **super().to_dict(),
            "time_step": self.dt,
            "strain": float(self.strain_t[-1]),
            "stress": float(self.shear_stress_t[-1]),
            "largest_stress": float(np.abs(self.shear_stress_t).max()),
            "pressure": float(self.pressure_t[-1]),
            "packing_fraction": packing_fraction(self.packing),
            "contacts": int(self.contacts_t[-1]),
            "sliding_fraction": float(self.sliding_fraction_t[-1]),
            **numbers_of_broken(self.broken_bonds),
        }

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        numbers, unit = self.to_dict(), self.stress_unit
        return [
            *self.outcome_rows(),
            ("strain at the end", f"{numbers['strain']:.6g}", ""),
            ("stress at the end", f"{numbers['stress']:.6g}", f"largest {numbers['largest_stress']:.6g}; {unit}"),
            ("pressure at the end", f"{numbers['pressure']:.6g}", unit),
            ("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted twice"),
            ("contacts", str(numbers["contacts"]), f"{numbers['sliding_fraction']:.1%} of them slide"),
            *rows_of_broken(self.broken_bonds),
        ]

    @property
    def stress_unit(self) -> str:
        """The unit of stresses, in words."""
        return f"energy / length^{self.packing.dimension} of the scene"


R = TypeVar("R", bound=StrainRun)


class _EndState(NamedTuple):
    """Positions, box, peculiar velocities, spins (None where nothing turns), orientations (None of discs, spheres)."""

    position_nd: NDArray[np.float64]
    box: Box
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    orientation_nq: NDArray[np.float64] | None

    @property
    def is_finite(self) -> bool:
        return bool(np.isfinite(self.position_nd).all())


@dataclass(frozen=True)
class StrainPlan:
    """How one run strains its scene, step by step.

    Attributes
    ----------
    stage
        What `progress` hears of it.
    dt, steps
        Time step, and steps to the end.
    every
        Steps from row to row.
    profile, direction_dd
        How the box deforms.
    axes
        The component of the stress that answers to the strain.
    further
        What else decides the numbers of the run, for its checkpoint.
    walls
        What is measured on the walls.
    drive, span
        Called with the task at the start of every so many steps, where the strain is driven from outside; rows are kept
        at their ends.
    report_every
        So many spans from one call of `progress` to the next.

    """

    stage: str
    dt: float
    steps: int
    every: int
    profile: Any
    direction_dd: NDArray[np.float64]
    axes: tuple[int, int]
    further: Mapping[str, Any] = field(default_factory=dict)
    walls: WallForces | None = None
    drive: Callable[[StrainTask], None] | None = None
    span: int = 0
    report_every: int = 1


class StrainTask:
    """One strained run as the run loop steps it: its engine, the rows and frames that are kept, and its checkpoint.

    Parameters
    ----------
    settings
        Checked arguments of the call.
    plan
        How the scene is strained.

    """

    def __init__(self, settings: StrainSettings, plan: StrainPlan) -> None:
        self.began = time.process_time()
        self.settings, self.plan, self.walls = settings, plan, plan.walls
        with safe_interrupts():
            self.engine: Engine = build_engine(
                settings.scene,
                dt=plan.dt,
                velocity_nd=settings.velocity_nd,
                spin_nk=settings.spin_nk,
                profile=plan.profile,
                direction_dd=plan.direction_dd,
                held_n=settings.held_n,
                second_order=isinstance(settings.method, VelocityVerlet),
                ledger_every=self._ledger_every(),
            )
            self.ledger: Ledger = new_ledger(plan.every, plan.steps // plan.every)
            self.stop_every = plan.span or max(1, _CHUNK // self.engine.state.body.size)
            self.stop = 0
            self.due_f = np.unique(np.linspace(0, plan.steps, settings.frames).round().astype(np.int64))
            self.frame_time_f: list[float] = []
            self.position_f: list[NDArray[np.float64]] = []
            self.snapshot_f: list[Snapshot] = []
            # rows of the observables that were added by `pm.observable`
            self.added: list[dict[str, NDArray[np.float64]]] = []
            self.seconds_before = 0.0
            # rows that are kept in place of the ledger's, where the run is driven from outside
            self.driven_rows: list[NDArray[np.float64]] | None = None
            if settings.file is None or not settings.file.begin(self, self._named()):
                self.engine.begin(self.ledger)
                self.first = self.engine.observe()
                self.driven_rows = None if plan.drive is None else [self.first]
                self._measure_added()
                self._keep_frame()
                if self.walls is not None:
                    self.walls.begin(self.engine)
            # what is returned where nothing finite is left in the end
            self.last_finite = self._now()
        self.energy = RowWatch(settings.scene, plan.direction_dd, plan.every, self.engine.released)
        self.build_seconds = time.process_time() - self.began

    def _ledger_every(self) -> int | None:
        """Return after how many steps the energies are kept; None where no ledger was asked for."""
        if self.settings.ledger and self.walls is not None:
            raise ValueError("ledger must be False where walls are driven, whose work is not accounted for, got True")
        # a run that is driven from outside has no steps from row to row
        return every_of(None if self.plan.span else self.plan.every, self.plan.steps) if self.settings.ledger else None

    def _named(self) -> dict[str, Any]:
        """Return what decides the numbers of this run."""
        settings, plan = self.settings, self.plan
        return {
            **{f"scene.{name}": text for name, text in scene_fingerprints(settings.scene).items()},
            "dt": plan.dt,
            "steps": plan.steps,
            "samples": plan.every,
            "strain": (plan.profile, plan.direction_dd),
            "frames": self.due_f,
            **{name: getattr(settings, name) for name in ("method", "velocity_nd", "spin_nk", "held_n")},
            **({"ledger": True} if settings.ledger else {}),
            **plan.further,
        }

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.engine.steps

    def _keep_frame(self) -> None:
        engine = self.engine
        if len(self.position_f) < len(self.due_f) and engine.steps >= self.due_f[len(self.position_f)]:
            self.frame_time_f.append(engine.time)
            self.position_f.append(engine.positions())
            kept = (engine.box().lattice_dd, self._spins(), touching_of(engine), engine.orientations())
            self.snapshot_f.append(Snapshot(*kept))

    def _measure_added(self) -> None:
        """Measure the added observables, at the start and wherever a row is kept."""
        engine = self.engine
        if added_observables() and (self.driven_rows is not None or engine.steps % self.plan.every == 0):
            packing = engine.packing_at(engine.positions(), engine.orientations(), engine.box())
            state = State(packing, engine.effects, engine.steps, engine.time, engine.velocities(), self._spins())
            self.added.append(measure_added(lambda: state))

    def _now(self) -> _EndState:
        engine = self.engine
        return _EndState(engine.positions(), engine.box(), engine.velocities(), self._spins(), engine.orientations())

    def _spins(self) -> NDArray[np.float64] | None:
        return self.engine.spins() if _turns(self.settings.scene) else None

    def next_stop(self) -> int | Outcome:
        """Return the step of the next frame or reading of the clock, whichever comes first."""
        plan = self.plan
        if self.steps >= plan.steps:
            return Outcome.FINISHED
        if self.stop <= self.steps:
            self.stop = min(plan.steps, self.steps + self.stop_every - (self.steps % plan.span if plan.span else 0))
            # frames of a run that is driven from outside fall on the ends of spans
            if len(self.position_f) < len(self.due_f) and not plan.span:
                self.stop = min(self.stop, int(self.due_f[len(self.position_f)]))
            if added_observables() and not plan.span:  # they are measured outside the compiled loops
                self.stop = min(self.stop, self.steps + plan.every - self.steps % plan.every)
        return self.stop

    def advance(self, steps: int) -> Outcome | None:
        """Take so many steps."""
        if self.plan.drive is not None and self.steps % self.plan.span == 0:
            if not self._can_be_driven():
                return Outcome.STEP_TOO_LONG
            self.plan.drive(self)
        end = self.steps + steps
        while self.steps < end:
            due = end - self.steps if self.walls is None else self.walls.before(self.engine, end - self.steps)
            if self.engine.advance(due, self.ledger) != RUNNING:
                return Outcome.STEP_TOO_LONG
            if self.walls is not None:
                self.walls.after(self.engine)
        return None

    def _can_be_driven(self) -> bool:
        """Whether the last row, which the rate of strain follows from, is finite."""
        return self.driven_rows is not None and bool(np.isfinite(self.driven_rows[-1]).all())

    def observe(self) -> Outcome | None:
        """Keep a frame or a row where one is due; end the run where energy grows without work."""
        if self.driven_rows is None or len(self.driven_rows) % self.plan.report_every == 0:
            now = self._now()
            self.last_finite = now if now.is_finite else self.last_finite
        self._keep_frame()
        self._measure_added()
        if self.driven_rows is not None:
            self.driven_rows.append(self.engine.observe())
            return None if self._can_be_driven() else Outcome.STEP_TOO_LONG
        # walls that are driven, and what is held by them, do work that is not in the stress
        watched = self.walls is None and self.settings.held_n is None
        return Outcome.STEP_TOO_LONG if watched and not self.energy.is_calm(self.rows()) else None

    def figures(self) -> tuple[str, dict[str, Any]] | None:
        """Return what `progress` is called with."""
        engine = self.engine
        if self.driven_rows is not None and len(self.driven_rows) % self.plan.report_every:
            return None
        return self.plan.stage, {
            "steps": engine.steps, "of": self.plan.steps, "time": engine.time, "strain": engine.gamma, "engine": engine,
        }  # fmt: skip

    def drive_at(self, rate: float) -> None:
        """Let gamma go on from where it is at another rate."""
        engine = self.engine
        engine.set_profile(Ramp(engine.gamma, rate, engine.time, math.inf))

    def index_bounds(self) -> dict[str, IndexBounds]:
        """Return what the saved arrays of integers may hold."""
        return self.engine.index_bounds() | snapshot_bounds(*self.settings.scene.packing.position_nd.shape)

    def arrays(self) -> Arrays:
        """Return everything that a checkpoint must keep."""
        shape = (-1, *self.settings.scene.packing.position_nd.shape)
        return {
            **self.engine.arrays(),
            "rows": self.rows(),
            "frame_time_f": np.array(self.frame_time_f),
            "position_fnd": np.array(self.position_f).reshape(shape),
            **snapshot_arrays(self.snapshot_f),
            **added_arrays(self.added),
            "seconds": np.array(self.seconds()),
            **({} if self.walls is None else self.walls.arrays()),
        }

    def restore(self, kept: Arrays) -> None:
        """Go on from what a checkpoint kept."""
        n, d = self.settings.scene.packing.position_nd.shape
        steps = integer("engine.steps", kept["engine.steps"], at_least=0, at_most=self.plan.steps)
        rows = saved_array(kept, "rows", (steps // (self.plan.span or self.plan.every) + 1, COLUMNS))
        frames = self._frames_at(steps)
        frame_time_f = saved_array(kept, "frame_time_f", (frames,))
        position_fnd = saved_array(kept, "position_fnd", (frames, n, d))
        spins = self._spins()
        shapes = self.settings.scene.packing.shapes
        turned = shapes.orientation_nq.shape if shapes.has_orientations else None
        snapshots = snapshots_of(kept, frames, None if spins is None else (n, spins.shape[1]), d, turned)
        if self.walls is not None:
            self.walls.restore(kept, steps)
        self.engine.restore(kept)
        self.first = rows[0]
        if self.plan.drive is not None:
            self.driven_rows = list(rows)
        else:
            self.ledger.row_tk[: len(rows) - 1] = rows[1:]
            self.ledger.written[0] = len(rows) - 1
        self.frame_time_f, self.position_f, self.snapshot_f = frame_time_f.tolist(), list(position_fnd), snapshots
        self.added = added_rows(kept, len(rows), d)
        self.seconds_before = float(saved_array(kept, "seconds", ()))

    def _frames_at(self, steps: int) -> int:
        """Return how many frames are kept after so many steps."""
        # the end of the span in which each is due, or of the one after that of the frame before
        number_f, span = np.arange(len(self.due_f)), self.plan.span or 1
        span_f = np.maximum.accumulate(-(-self.due_f // span) - number_f) + number_f
        return int(np.count_nonzero(span_f <= steps // span))

    def save(self) -> None:
        """Write the checkpoint."""
        assert self.settings.file is not None
        self.settings.file.write(self, finished=self.steps >= self.plan.steps)

    def seconds(self) -> float:
        """Return the CPU time taken so far, in what went before a checkpoint too."""
        return self.seconds_before + time.process_time() - self.began - self.build_seconds

    def run(self, finished: Callable[[Outcome], R], *, check: bool | None = None) -> R:
        """Return the run that comes of stepping this to its end or a limit, as `RunLoop.run` does."""
        loop = self.settings.loop
        save = None if self.settings.file is None else self.save
        return loop.run(lambda: loop.advance(self, save), finished, check=check)

    def rows(self) -> NDArray[np.float64]:
        """Return the figures kept so far, the start first."""
        if self.driven_rows is not None:
            return np.array(self.driven_rows)
        written = int(self.ledger.written[0])
        return np.concatenate([self.first[None], self.ledger.row_tk[:written]])

    def fields(self, outcome: Outcome) -> dict[str, Any]:
        """Return the fields of a `StrainRun` as far as it came."""
        rows, settings, plan, engine = self.rows(), self.settings, self.plan, self.engine
        packing = settings.scene.packing
        n, d = packing.particles, packing.dimension
        # what the box spans goes with the determinant of 1 + gamma M
        direction = np.zeros((d, d)) if engine.direction_dd is None else engine.direction_dd
        stretch = np.linalg.det(np.eye(d) + rows[:, STRAIN, None, None] * direction)
        volume = packing.box.volume * stretch[:, None, None]
        stress = tensors(rows, d, 1.0)
        stress["bond"] = rows[:, BONDED : BONDED + 9].reshape(-1, 3, 3)[:, :d, :d]
        motion, now, tangential = self._now(), engine.observe(), None
        if motion.is_finite:
            tangential = engine.tangential()
        else:
            motion, now = self.last_finite, rows[-1]
        mean = now[TOTAL] / now[CONTACTS] if now[CONTACTS] else 0.0
        residual = float(now[LARGEST_FORCE] / mean) if mean > 0.0 else 0.0
        seconds = self.seconds()
        snapshots = self.snapshot_f
        return {
            "packing": engine.packing_at(motion.position_nd, motion.orientation_nq, motion.box, tangential),
            "outcome": outcome,
            "residual": residual,
            "steps": engine.steps,
            "force_evaluations": engine.steps + 1,
            "seconds": seconds,
            "build_seconds": self.build_seconds,
            "stages": (Stage(plan.stage, residual, engine.steps, engine.steps + 1, seconds),),
            **{f"{name}_t": rows[:, column] for name, column in _KEPT.items()},
            "stress": {name: part / volume for name, part in stress.items()},
            "contacts_t": rows[:, CONTACTS].astype(np.int64),
            "sliding_t": rows[:, SLIDING].astype(np.int64),
            "axes": plan.axes,
            "dt": plan.dt,
            "velocity_nd": motion.velocity_nd,
            "spin_nk": motion.spin_nk,
            "frame_time_f": np.array(self.frame_time_f),
            "position_fnd": np.array(self.position_f).reshape(-1, n, d),
            "lattice_fdd": np.array([one.lattice_dd for one in snapshots]).reshape(-1, d, d),
            "spin_fnk": np.array([one.spin_nk for one in snapshots]) if snapshots and _turns(settings.scene) else None,
            "touching_f": tuple(one.touching for one in snapshots),
            "orientation_fnq": orientations_at(snapshots),
            "held_n": settings.held_n,
            **bonds_at(engine, engine.steps),
            "ledger": ledger_of(engine),
            "added": columns_of(self.added) if self.added and self.added[0] else {},
            "unmet": unmet_conditions(outcome, *engine.limits(), Condition("steps", engine.steps, plan.steps, 0.0)),
        }


def _turns(scene: Scene) -> bool:
    rough = roughness_of(scene.effects) or bonds_of(scene.effects)
    return bool(rough) or scene.packing.shapes.has_orientations
