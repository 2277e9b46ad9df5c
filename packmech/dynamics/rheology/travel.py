"""A march under strain from start to end: figures kept on the way, and the run that comes of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.checkpoint import scene_marks
from packmech.dynamics.growth import RowWatch
from packmech.dynamics.keepsakes import Scenery, sceneries, scenery_arrays
from packmech.dynamics.kernels import RUNNING
from packmech.dynamics.march.checkpoint import Leaves, march_leaves, restore_march
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
from packmech.dynamics.rheology.manner import Manner
from packmech.dynamics.rheology.wall_moduli import WallWatch
from packmech.dynamics.verlet import VelocityVerlet
from packmech.effects import Bonds, Friction
from packmech.interrupts import held_interrupts, safe_interrupts
from packmech.outcome import NotConverged, Outcome, Run, Stage
from packmech.scene import Scene

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


R = TypeVar("R", bound=StrainRun)


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
        driven: bool = False,
        further: dict[str, Any] | None = None,
        watch: WallWatch | None = None,
    ) -> None:
        self.began = time.process_time()
        self.watch = watch
        self.growth = RowWatch(manner.scene, direction_dd, every)
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
        self.chunk = max(1, _CHUNK // self.march.state.body.size)
        self.due_f = np.unique(np.linspace(0, steps, manner.frames).round().astype(np.int64))
        self.frame_time_f: list[float] = []
        self.position_f: list[NDArray[np.float64]] = []
        self.scenery_f: list[Scenery] = []
        self.seconds_before = 0.0
        # rows that are kept in place of the ledger's, where the run is driven from outside
        self.driven_rows: list[NDArray[np.float64]] | None = None
        kept = None
        if manner.keeper is not None:
            settings = {
                **{f"scene.{name}": text for name, text in scene_marks(manner.scene).items()},
                "dt": dt,
                "steps": steps,
                "samples": every,
                "strain": (profile, direction_dd),
                "frames": self.due_f,
                **{name: getattr(manner, name) for name in ("method", "mass_n", "velocity_nd", "spin_nk", "held_n")},
            }
            kept = manner.keeper.next(settings | (further or {}))
        if kept is None:
            self.march.begin()
            self.first = self.march.see()
            self.driven_rows = [self.first] if driven else None
            self._frame()
            if watch is not None:
                watch.begin(self.march)
        else:
            self._restore(kept, driven)
        self.build_seconds = time.process_time() - self.began

    def _frame(self) -> None:
        march = self.march
        if len(self.position_f) < len(self.due_f) and march.steps >= self.due_f[len(self.position_f)]:
            self.frame_time_f.append(march.time)
            self.position_f.append(march.positions())
            self.scenery_f.append(Scenery(march.box().lattice_dd, self._spins(), touching_of(march)))

    def _spins(self) -> NDArray[np.float64] | None:
        return self.march.spins() if _turns(self.manner.scene) else None

    def go(self, stage: str) -> Outcome:
        """Advance to the end or a limit; return how that ended."""
        while self.march.steps < self.steps:
            due = min(self.chunk, self.steps - self.march.steps)
            if len(self.position_f) < len(self.due_f):
                due = min(due, int(self.due_f[len(self.position_f)]) - self.march.steps)
            if not (self.advance(due) if self.watch is None else self._advance_watched(due, self.watch)):
                return Outcome.STEP_TOO_LONG
            # walls that are driven, and what is held by them, do work that is not in the stress
            if self.watch is None and self.manner.held_n is None and not self.growth.calm(self.rows()):
                return Outcome.STEP_TOO_LONG
            self.tell(stage)
            if self.late():
                return Outcome.INTERRUPTED
        return Outcome.FINISHED

    def advance(self, steps: int) -> bool:
        """Advance by so many steps, wholly; return whether they could be taken."""
        with held_interrupts():
            if self.march.advance(steps, self.ledger) != RUNNING:
                return False
            self._frame()
        return True

    def _advance_watched(self, steps: int, watch: WallWatch) -> bool:
        """Advance by so many steps in parts, between which walls are looked at."""
        end = self.march.steps + steps
        while self.march.steps < end:
            # what is done before a part belongs to it
            with held_interrupts():
                if not self.advance(watch.before(self.march, end - self.march.steps)):
                    return False
                watch.after(self.march)
        return True

    def tell(self, stage: str) -> None:
        """Tell who wants to know of it, and write a checkpoint if that was long ago."""
        march, keeper = self.march, self.manner.keeper
        if keeper is not None and keeper.due():
            self.save()
        if self.manner.progress is not None:
            told = {"steps": march.steps, "of": self.steps, "time": march.time, "strain": march.gamma}
            self.manner.progress(stage, {**told, "march": march})

    def late(self) -> bool:
        """Whether time is up before the end."""
        return time.process_time() > self.manner.deadline and self.march.steps < self.steps

    def drive(self, rate: float) -> None:
        """Let gamma go on from where it is at another rate."""
        march = self.march
        march.profile = Ramp(march.gamma, rate, march.time, math.inf)
        assert march.space.flow is not None
        march.space = march.space._replace(flow=march.space.flow._replace(profile=march.profile))
        march.homing = homing_steps(march)

    def save(self) -> None:
        """Write a checkpoint, if any are asked for."""
        keeper = self.manner.keeper
        if keeper is None:
            return
        shape = (-1, *self.manner.scene.packing.position_nd.shape)
        arrays: Leaves = {
            **march_leaves(self.march),
            "rows": self.rows(),
            "frame_time_f": np.array(self.frame_time_f),
            "position_fnd": np.array(self.position_f).reshape(shape),
            **scenery_arrays(self.scenery_f),
            "seconds": np.array(self.seconds()),
            **({} if self.watch is None else self.watch.leaves()),
        }
        with held_interrupts():
            keeper.write(arrays, finished=self.march.steps >= self.steps)

    def _restore(self, kept: Leaves, driven: bool) -> None:
        march, rows = self.march, kept["rows"]
        restore_march(march, kept)
        if march.space.flow is not None:
            march.profile = march.space.flow.profile
            march.homing = homing_steps(march)
        self.first = rows[0]
        if driven:
            self.driven_rows = list(rows)
        else:
            self.ledger.row_tk[: len(rows) - 1] = rows[1:]
            self.ledger.written[0] = len(rows) - 1
        self.frame_time_f = kept["frame_time_f"].tolist()
        self.position_f = list(kept["position_fnd"])
        self.scenery_f = sceneries(kept)
        self.seconds_before = float(kept["seconds"])
        if self.watch is not None:
            self.watch.restore(kept)

    def seconds(self) -> float:
        """Return the CPU time taken so far, in what went before a checkpoint too."""
        return self.seconds_before + time.process_time() - self.began - self.build_seconds

    def end(
        self,
        drive: Callable[[], Outcome],
        finished: Callable[[Outcome], R],
    ) -> R:
        """Return the run that comes of driving this to its end or a limit; `finished` makes it as far as it came.

        Raises
        ------
        KeyboardInterrupt
            Passed on with `.run` set to what was reached.
        NotConverged
            If the end was not reached, unless that is not to be checked.

        """
        try:
            with safe_interrupts():
                outcome = drive()
                if outcome is not Outcome.STEP_TOO_LONG:
                    self.save()
        except KeyboardInterrupt as stop:
            self.save()
            stop.run = finished(Outcome.INTERRUPTED)  # type: ignore[attr-defined]
            raise
        run = finished(outcome)
        if self.manner.check and not run.ok:
            raise NotConverged(run)
        return run

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
        seconds = self.seconds()
        scenery = self.scenery_f
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
            "spin_nk": self._spins(),
            "frame_time_f": np.array(self.frame_time_f),
            "position_fnd": np.array(self.position_f).reshape(-1, n, d),
            "lattice_fdd": np.array([one.lattice_dd for one in scenery]).reshape(-1, d, d),
            "spin_fnk": np.array([one.spin_nk for one in scenery]) if scenery and _turns(manner.scene) else None,
            "touching_f": tuple(one.touching for one in scenery),
            "held_n": manner.held_n,
        }


def _turns(scene: Scene) -> bool:
    return any(isinstance(one, Friction | Bonds) for one in scene.effects)
