"""What a simulation returns, what it keeps on the way, and the simulation as a task that is stepped."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.check import boolean, instance, integer, positive
from packmech.dynamics.breaking import BrokenBonds, numbers_of_broken, rows_of_broken
from packmech.dynamics.deformation import OscillatoryStrain, SteadyStrain, Strain
from packmech.dynamics.energy_drift import (
    Moment,
    largest_held,
    moments_of,
    pace_of_held,
    steps_between_observations,
    watch_of,
)
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.integrators import INTEGRATORS, Method, VelocityVerlet, checked_method, start_of_motion
from packmech.dynamics.ledger import EnergyLedger, every_of, ledger_of
from packmech.dynamics.moved_walls import FaceRows, MovedWalls
from packmech.dynamics.observables import (
    ANGULAR,
    BEHIND_FACES,
    BONDED,
    COLUMNS,
    CONTACTS,
    IMPULSE,
    KINETIC,
    LARGEST_FORCE,
    LINK_ERROR,
    MOMENTUM,
    OF_FACES,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TOTAL,
    link_stress,
    tensors,
)
from packmech.dynamics.pair_forces import Touching, touching_of
from packmech.effects import Bonds, held_particles
from packmech.files.records import from_table, kinds_of, to_table
from packmech.jit.compiled import compiling_noted
from packmech.jit.interrupts import held_interrupts
from packmech.loop.checkpoint import (
    Arrays,
    Checkpoint,
    IndexBounds,
    check_indices,
    saved_array,
    scene_fingerprints,
    write_checkpoint,
)
from packmech.loop.run_loop import RunLoop
from packmech.measure.counting import packing_fraction
from packmech.minimize.passes.kernels import RUNNING
from packmech.observables import State, added_arrays, added_rows, measure_added
from packmech.packing import Packing
from packmech.result import Condition, Outcome, Row, Run, Stage, Trace, unmet_conditions
from packmech.scene import Scene

# what its checkpoints say they are of
KIND = "pm.simulate"


@shown()
@dataclass(frozen=True, eq=False, kw_only=True)
class MotionTrace(Trace):
    """A trace against time, kept at the steps that the caller asked for.

    Attributes
    ----------
    time_t
        (T,) times since the start [time].
    kinetic_t
        (T,) kinetic energies [energy]; energy_t are the potential ones.
    momentum_td
        (T, d) total momenta.
    stress_tdd
        (T, d, d) Cauchy stress of contacts, with their dashpots, and links, tension positive [energy/length^d];
        pressure_t is -trace / d of it.
    kinetic_stress_tdd
        (T, d, d) kinetic part -(1/V) sum m u u^T of the velocities u less their mass-weighted mean; in no other figure.
    link_error_t
        (T,) largest error of a link, over the larger of its length and the mean diameter [1].
    velocity_tnd
        (T, N, d) velocities (peculiar ones in a box that deforms), or None when positions were not asked for.
        lattice_tdd are the lattice vectors then, where the box deforms.
    overall_stress_tdd
        (T, d, d) the stress with torques and the spins' part, symmetric (as stress_tdd where nothing turns).
    strain_t, strain_rate_t
        (T,) gamma of the box [1] and its rate [1/time].
    sliding_t
        (T,) number of contacts at Coulomb's cap.
    torque_stress_tdd, spin_stress_tdd, bond_stress_tdd
        (T, d, d) the parts of the overall stress by torques and by spins, and the part of stress_tdd that bonds bear.
    tangential_t, rotational_t
        (T,) the parts of energy_t in tangential springs and of kinetic_t in spins.
    angular_momentum_tk
        (T, 1 or 3) total angular momenta about the origin, spins included.
    spin_tnk
        (T, N, 1 or 3) spins, None where particles do not turn or positions were not asked for.
    touching_t
        The contacts at each saved time, with which force and which of them slide; None where positions were not asked
        for.

    """

    time_t: NDArray[np.float64]
    kinetic_t: NDArray[np.float64]
    momentum_td: NDArray[np.float64]
    stress_tdd: NDArray[np.float64]
    kinetic_stress_tdd: NDArray[np.float64]
    link_error_t: NDArray[np.float64]
    overall_stress_tdd: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    strain_rate_t: NDArray[np.float64]
    sliding_t: NDArray[np.int64]
    velocity_tnd: NDArray[np.float64] | None = None
    torque_stress_tdd: NDArray[np.float64] | None = None
    spin_stress_tdd: NDArray[np.float64] | None = None
    bond_stress_tdd: NDArray[np.float64] | None = None
    tangential_t: NDArray[np.float64] | None = None
    rotational_t: NDArray[np.float64] | None = None
    angular_momentum_tk: NDArray[np.float64] | None = None
    spin_tnk: NDArray[np.float64] | None = None
    touching_t: tuple[Touching, ...] | None = None

    @property
    def stress(self) -> dict[str, NDArray[np.float64]]:
        """The (T, d, d) tensors by name, Cauchy, tension positive; parts that nothing has are zero."""
        none = np.zeros_like(self.stress_tdd)
        parts = {"torque": self.torque_stress_tdd, "spin": self.spin_stress_tdd, "bond": self.bond_stress_tdd}
        return {
            "overall": self.overall_stress_tdd,
            "contact": self.stress_tdd,
            **{name: none if part is None else part for name, part in parts.items()},
            "kinetic": self.kinetic_stress_tdd,
        }


# of a change of potential + kinetic energy
_AN_ERROR = "an error only where nothing is damped, slides, is driven or pushed by moving walls"
_STRESS_NOTES = {
    "overall": "forces, torques and spins together; tension positive",
    "contact": "forces of contacts and bonds times branch vectors",
    "torque": "what torques add",
    "spin": "what rotation stretches particles by",
    "kinetic": "of the velocities; in no other",
}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Simulation(Run):
    """A run through time: where it ended, what it kept on the way, and how well energy and momentum held.

    Attributes
    ----------
    velocity_nd
        (N, d) velocities at the end [length/time].
    dt
        The time step [time].
    energy_drift
        Energy at the end less that at the start, over the largest |potential| + kinetic energy seen [1]. With dashpots
        it holds what they took, without it is the method's error. What breaking bonds released counts as still there,
        and so does the kinetic energy of walls that move, less the work of what moves them.
    momentum_error
        Largest change of the total momentum seen, over the largest sum of m |v| [1].
    link_error
        Largest error of a link seen, over the larger of its length and the mean diameter [1].
    tension_l
        (L,) forces in the links at the end, positive for tension [force]; none in redundant ones.
    spin_nk
        (N, 1 or 3) spins at the end [1/time]; None where particles do not turn.
    strain
        gamma of the box at the end [1]; `packing` has the box as it is then.
    held_n
        (N,) whether a particle was held, by the call or by the scene (`FixedParticles`); None where none was.
    bonds
        The bonds at the end; None in a scene without.
    broken_bonds
        Those that broke; None where no bond of the scene may break.
    ledger
        Where the energy went; None unless it was asked for.
    walls
        Where walls were that move, and the stress at them; None where all stand still.

    """

    velocity_nd: NDArray[np.float64]
    dt: float
    energy_drift: float
    momentum_error: float
    link_error: float
    tension_l: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None = None
    strain: float = 0.0
    held_n: NDArray[np.bool_] | None = None
    bonds: Bonds | None = None
    broken_bonds: BrokenBonds | None = None
    ledger: EnergyLedger | None = None
    walls: MovedWalls | None = None

    def about(self) -> dict[str, Any]:
        """Return what a table of this run says of it."""
        return {**super().about(), "dt": self.dt, "energy_drift": self.energy_drift}

    @property
    def flows(self) -> bool:
        """Whether the box was strained."""
        return self.strain != 0.0

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title} through a time of {self._time:.6g}"

    @property
    def _time(self) -> float:
        """The time that was simulated [time]."""
        return float(self.trace.time_t[-1]) if isinstance(self.trace, MotionTrace) else self.steps * self.dt

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; what stands in a trace only where there is one.

        Stresses are in the scene's own units of energy/length^d, tension positive.
        """
        numbers = {
            **super().to_dict(),
            "packing_fraction": packing_fraction(self.packing),
            "time": self._time,
            "time_step": self.dt,
            "energy_drift": self.energy_drift,
            "momentum_error": self.momentum_error,
            "link_error": self.link_error,
            "strain": self.strain,
            **self._speeds(),
            **numbers_of_broken(self.broken_bonds),
            **({} if self.walls is None else {"walls": self.walls.to_dict()}),
        }
        trace = self.trace
        if isinstance(trace, MotionTrace):
            numbers |= {
                "potential_energy": float(trace.energy_t[-1]),
                "kinetic_energy": float(trace.kinetic_t[-1]),
                "momentum": trace.momentum_td[-1].tolist(),
                "contacts": int(trace.contacts_t[-1]),
                "sliding": int(trace.sliding_t[-1]),
                "stress": {name: tensor[-1].tolist() for name, tensor in trace.stress.items()},
            }
        return numbers

    def _speeds(self) -> dict[str, Any]:
        """Return how fast what is not held moves at the end, by name: of a single particle which, and its velocity."""
        moving_n = self.velocity_nd.any(axis=1)
        if self.held_n is not None:
            moving_n &= ~self.held_n
        number_m = np.flatnonzero(moving_n)
        if not len(number_m):
            return {}
        square_m = (self.velocity_nd[number_m] ** 2).sum(axis=1)
        alone = {"moving_particle": int(number_m[0]), "velocity": self.velocity_nd[number_m[0]].tolist()}
        return {
            "moving": len(number_m),
            "root_mean_square_speed": float(np.sqrt(square_m.mean())),
            "largest_speed": float(np.sqrt(square_m.max())),
            **(alone if len(number_m) == 1 else {}),
        }

    def _speed_rows(self, numbers: Mapping[str, Any]) -> list[Row]:
        """Return the velocity of the particle that moves at the end, or the speed of several."""
        if "moving" not in numbers:
            return []
        note = f"at the end{', less the flow of the box' if self.strain else ''} [length/time]"
        if "kinetic_energy" in numbers:
            note += f"; kinetic energy {numbers['kinetic_energy']:.6g} [energy]"
        if "velocity" in numbers:
            if numbers["particles"] > 1:
                note = f"of particle {numbers['moving_particle']}, the only one that is not held and moves, {note}"
            return [("velocity", "  ".join(f"{entry:.6g}" for entry in numbers["velocity"]), note)]
        note = (
            f"root mean square of the {numbers['moving']} that move, {numbers['largest_speed']:.6g} the largest, {note}"
        )
        return [("speed", f"{numbers['root_mean_square_speed']:.6g}", note)]

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        numbers = self.to_dict()
        unit = f"energy / length^{numbers['dimension']} of the scene"
        rows: list[Row] = []
        if "momentum" in numbers:
            energy = f"{numbers['potential_energy']:.6g} + {numbers['kinetic_energy']:.6g}"
            change = f"changed by {numbers['energy_drift']:.2g} of the largest: {_AN_ERROR}"
            momentum = "  ".join(f"{entry:.6g}" for entry in numbers["momentum"])
            rows += [
                ("energy", energy, f"potential + kinetic; {change}"),
                ("momentum", momentum, f"changed by {numbers['momentum_error']:.1e} of the sum of m |v|"),
                ("contacts", str(numbers["contacts"]), f"{numbers['sliding']} of them slide; bonds are not among them"),
            ]
        else:
            rows += [
                ("change of energy", f"{numbers['energy_drift']:.2g}", f"of the largest; {_AN_ERROR}"),
                ("momentum error", f"{numbers['momentum_error']:.1e}", "of the sum of m |v|"),
            ]
        rows += self._speed_rows(numbers)
        rows += rows_of_broken(self.broken_bonds)
        rows += [] if self.walls is None else self.walls.rows()
        if self.packing.links:
            rows.append(("link error", f"{numbers['link_error']:.1e}", "largest, over the length of the link"))
        rows.append(("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted twice"))
        for name, note in _STRESS_NOTES.items() if "stress" in numbers else ():
            lines = ["  ".join(f"{entry + 0.0:12.5g}" for entry in row) for row in numbers["stress"][name]]
            for k, line in enumerate(lines):
                rows.append((f"{name} stress" if k == 0 else "", line, note if k == 0 else unit if k == 1 else ""))
        return [*self.outcome_rows(), *rows]


def bonds_at(engine: Engine, step: int) -> dict[str, Any]:
    """Return the bonds at the end of a step and those that broke until then, as fields of a run."""
    breaks = engine.breaks
    if breaks is None:
        return {"bonds": engine.bonds}
    return {"bonds": breaks.left_at(step), "broken_bonds": breaks.until(step, engine.dt)}


class Snapshot(NamedTuple):
    """What is kept with positions: lattice vectors, (N, k) spins (None where nothing turns), contacts, orientations.

    Orientations are (N, d) directors, or (N, q) as `Beads` has them; None of discs and spheres.
    """

    lattice_dd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    touching: Touching
    orientation_nq: NDArray[np.float64] | None = None


def orientations_at(snapshots: Sequence[Snapshot]) -> NDArray[np.float64] | None:
    """Return the (T, N, q) orientations of snapshots; None of discs and spheres, or where nothing was kept."""
    kept = [one.orientation_nq for one in snapshots if one.orientation_nq is not None]
    return np.array(kept) if kept else None


def snapshot_arrays(kept: Sequence[Snapshot]) -> Arrays:
    """Return what was kept at several steps, contacts one step after the other, by name."""
    if not kept:
        return {}
    arrays: Arrays = {"snapshot_lattice_tdd": np.array([one.lattice_dd for one in kept])}
    if kept[0].spin_nk is not None:
        arrays["snapshot_spin_tnk"] = np.array([one.spin_nk for one in kept])
    turned = orientations_at(kept)
    if turned is not None:
        arrays["snapshot_orientation_tnq"] = turned
    arrays["snapshot_count_t"] = np.array([len(one.touching.i_c) for one in kept], dtype=np.int64)
    for name in Touching._fields:
        arrays[f"snapshot_{name}"] = np.concatenate([getattr(one.touching, name) for one in kept])
    return arrays


def snapshot_bounds(particles: int, dimension: int) -> dict[str, IndexBounds]:
    """Return what the integers in `snapshot_arrays` may be."""
    return {
        "snapshot_count_t": IndexBounds(0, 1 << 31, (None,)),
        "snapshot_i_c": IndexBounds(0, particles, (None,)),
        "snapshot_j_c": IndexBounds(0, particles, (None,)),
        "snapshot_image_cd": IndexBounds(-(1 << 31), 1 << 31, (None, dimension)),
    }


def snapshots_of(
    arrays: Mapping[str, Any],
    steps: int,
    spins: tuple[int, int] | None,
    dimension: int,
    orientations: tuple[int, int] | None = None,
) -> list[Snapshot]:
    """Return what `snapshot_arrays` took at so many steps, step by step.

    Parameters
    ----------
    arrays
        Arrays by name.
    steps
        How many steps were kept.
    spins
        Shape of the spins at each of them; None where there are none.
    dimension
        Of the packing.
    orientations
        Shape of the orientations at each of them; None of discs and spheres.

    Raises
    ------
    KeyError, ValueError
        If arrays are missing or of other lengths.

    """
    if not steps:
        return []
    lattice_tdd = saved_array(arrays, "snapshot_lattice_tdd", (steps, dimension, dimension))
    spin_tnk = None if spins is None else saved_array(arrays, "snapshot_spin_tnk", (steps, *spins))
    turned = None if orientations is None else saved_array(arrays, "snapshot_orientation_tnq", (steps, *orientations))
    count_t = arrays["snapshot_count_t"]
    if len(count_t) != steps:
        raise ValueError(f"snapshot_count_t must be of length {steps}, as many as steps were kept, got {len(count_t)}")
    columns = [arrays[f"snapshot_{name}"] for name in Touching._fields]
    for name, column in zip(Touching._fields, columns, strict=True):
        if column.shape[:1] != (count_t.sum(),):
            raise ValueError(
                f"snapshot_{name} must be of length {count_t.sum()}, the sum of snapshot_count_t, got {column.shape}"
            )
    parts = [np.split(column, np.cumsum(count_t)[:-1]) for column in columns]
    return [
        Snapshot(
            lattice,
            None if spin_tnk is None else spin_tnk[t],
            Touching(*(part[t] for part in parts)),
            None if turned is None else turned[t],
        )
        for t, lattice in enumerate(lattice_tdd)
    ]


def trace_of_rows(
    step_t: Sequence[int],
    rows: Sequence[NDArray[np.float64]],
    added: Sequence[Mapping[str, NDArray[np.float64]]],
    engine: Engine,
    position_t: list[NDArray[np.float64]] | None,
    velocity_t: list[NDArray[np.float64]],
    snapshots: Sequence[Snapshot],
) -> MotionTrace:
    """Return rows of observables, at least one, as columns.

    Parameters
    ----------
    step_t, rows, added
        Steps, what was observed there, and observables that were added by `pm.observable`.
    engine
        Which observed it.
    position_t, velocity_t, snapshots
        (N, d) arrays and snapshots at each of the steps; no positions where they were not asked for.

    """
    d, free = len(engine.axes), engine.free_mass
    named: list[dict[str, Any]] = []
    for step, row, further in zip(step_t, rows, added, strict=True):
        volume = engine.box(step).volume
        parts = tensors(row, d, volume)
        momentum = row[MOMENTUM : MOMENTUM + d].copy()
        # what is held has no velocity of its own, and no part in the mean
        kinetic = parts["kinetic"] + np.outer(momentum, momentum) / (free * volume) if free else np.zeros((d, d))
        stress, overall = parts["contact"], parts["overall"]
        if engine.rattle is not None:
            linked = link_stress(row, d, volume)
            stress, overall = stress + linked, overall + linked
        found = {
            "step": step,
            "energy": row[POTENTIAL] + row[TANGENTIAL],
            "pressure": (0.0 - float(np.trace(stress))) / d,
            "contacts": int(row[CONTACTS]),
            "max_force": row[LARGEST_FORCE],
            "time": row[TIME],
            "kinetic": row[KINETIC] + row[ROTATIONAL],
            "momentum": momentum,
            "stress": stress,
            "kinetic_stress": kinetic,
            "link_error": row[LINK_ERROR],
            "overall_stress": overall,
            "strain": row[STRAIN],
            "strain_rate": row[RATE],
            "sliding": int(row[SLIDING]),
            "torque_stress": parts["torque"],
            "spin_stress": parts["spin"],
            "bond_stress": row[BONDED : BONDED + 9].reshape(3, 3)[:d, :d] / volume,
            "tangential": row[TANGENTIAL],
            "rotational": row[ROTATIONAL],
            # in a plane only the last component is anything
            "angular_momentum": row[ANGULAR + (0 if d == 3 else 2) : ANGULAR + 3],
        }
        named.append({**found, **further})
    turning = bool(snapshots) and snapshots[0].spin_nk is not None
    return MotionTrace.of_rows(
        named,
        position_tnd=None if position_t is None else np.array(position_t),
        lattice_tdd=np.array([one.lattice_dd for one in snapshots]) if snapshots else None,
        velocity_tnd=None if position_t is None else np.array(velocity_t),
        spin_tnk=np.array([one.spin_nk for one in snapshots]) if turning else None,
        touching_t=tuple(one.touching for one in snapshots) if snapshots else None,
        orientation_tnq=orientations_at(snapshots),
    )


@dataclass(frozen=True)
class SimulationSettings:
    """Checked settings of a simulation; a checkpoint keeps all but the scene."""

    scene: Scene
    dt: float
    steps: int
    method: Method
    applied_strain: Strain | None = None
    held_n: NDArray[np.bool_] | None = None
    trace_every: int | None = None
    trace_positions: bool = False
    # hash of what it starts with: velocities, spins, held particles, temperature and seed
    start: str = ""
    ledger: bool = False

    def to_table(self) -> dict[str, Any]:
        """Return the settings that are no arrays, as JSON knows them."""
        return {
            "dt": self.dt,
            "steps": self.steps,
            "method": to_table(self.method),
            "applied_strain": None if self.applied_strain is None else to_table(self.applied_strain),
            "trace_every": self.trace_every,
            "trace_positions": self.trace_positions,
            "start": self.start,
            "ledger": self.ledger,
            "scene": scene_fingerprints(self.scene),
        }


def saved_settings(found: Checkpoint, scene: Scene) -> SimulationSettings:
    """Return the settings in a checkpoint, for the scene it was made of.

    Raises
    ------
    KeyError, TypeError, ValueError
        If one is missing, of the wrong kind or out of its bounds.

    """
    table, arrays = found
    strain, every = table["applied_strain"], table["trace_every"]
    if strain is not None:
        strain = from_table(strain, "applied_strain", kinds_of((SteadyStrain, OscillatoryStrain)))
        strain.direction(scene.packing.dimension)  # which refuses axes that the packing does not have
    boolean("trace_positions", table["trace_positions"])
    instance("start", table["start"], str)
    start = start_of_motion(scene.packing, None, None, arrays.get("held_n"))
    return SimulationSettings(
        scene,
        positive("dt", table["dt"]),
        integer("steps", table["steps"], at_least=1),
        checked_method(from_table(table["method"], "method", kinds_of(INTEGRATORS))),
        strain,
        start.held_n,
        None if every is None else integer("trace_every", every, at_least=1),
        table["trace_positions"],
        table["start"],
        bool(table["ledger"]),
    )


def _kept_steps(step_t: NDArray[np.int64], every: int | None, reached: int) -> list[int]:
    """Return the steps at which rows were kept on the way to the one that was reached, after checking that they are."""
    turns = 0 if every is None else reached // every + 1
    due_t = np.arange(min(turns, len(step_t))) * (every or 1)
    # the end of a run is kept even where it is not its turn
    end = [] if every is None or reached % every == 0 else [reached]
    if len(due_t) < turns or (step_t[:turns] != due_t).any() or step_t[turns:].tolist() not in ([], end):
        wanted = "empty" if every is None else f"0 and every {every} steps after it, up to {reached}"
        raise ValueError(f"kept_step_t must be {wanted}, got {len(step_t)} steps")
    return [int(step) for step in step_t]


class SimulationTask:
    """One simulation as the run loop steps it: its engine, what was kept, and its checkpoint."""

    def __init__(
        self,
        settings: SimulationSettings,
        loop: RunLoop,
        spin_nk: NDArray[np.float64] | None = None,
    ) -> None:
        self.began = time.process_time()
        self.settings, self.scene, self.loop = settings, settings.scene, loop
        scene, strain, d = settings.scene, settings.applied_strain, settings.scene.packing.dimension
        self.engine: Engine = build_engine(
            scene,
            dt=settings.dt,
            velocity_nd=np.zeros_like(scene.packing.position_nd),
            spin_nk=spin_nk,
            profile=None if strain is None else strain.profile(),
            direction_dd=None if strain is None else strain.direction(d),
            held_n=settings.held_n,
            second_order=isinstance(settings.method, VelocityVerlet),
            threads=loop.settings.threads,
            ledger_every=every_of(settings.trace_every, settings.steps) if settings.ledger else None,
        )
        kept_every = every_of(settings.trace_every, settings.steps)
        self.faces = None if self.engine.faces is None else FaceRows(self.engine, kept_every)
        self.direction_dd = np.zeros((d, d)) if strain is None else strain.direction(d)
        self.build_seconds = time.process_time() - self.began
        self.seconds_before = 0.0
        self.kept: list[tuple[int, NDArray[np.float64]]] = []
        self.added: list[dict[str, NDArray[np.float64]]] = []
        self.position_t: list[NDArray[np.float64]] | None = [] if settings.trace_positions else None
        self.velocity_t: list[NDArray[np.float64]] = []
        self.snapshots: list[Snapshot] = []
        self.orientation_nq = self.engine.orientations()
        self.largest = {"energy": 0.0, "impulse": 0.0, "momentum": 0.0, "link": 0.0}
        self.watch, self.held = watch_of(scene, strain, settings.dt), largest_held(scene)
        # at least so often is what happens observed: often enough that an interrupt is seen
        often = steps_between_observations(strain, settings.dt, scene.packing.particles, pace_of_held(scene))
        self.observe_every = min(max(1, 2_000_000 // self.engine.state.push.size), often)
        self.start = self.last = np.zeros(COLUMNS)
        self.state = (scene.packing.position_nd, np.zeros_like(scene.packing.position_nd))
        self.reached = 0
        # the step that is observed next: checkpoints in between change none of them
        self.end = 0
        self.box: Box = scene.packing.box
        self.spin_nk: NDArray[np.float64] | None = None
        self.tension_l = np.zeros(len(scene.packing.links))

    def begin(self, velocity_nd: NDArray[np.float64]) -> None:
        """Start with (N, d) velocities."""
        with held_interrupts():
            self.engine.set_velocities(velocity_nd)
            self.start = self.engine.observe()
            self.watch.remember(self._moment(self.start), 0)
            self._keep(self.start)

    def run(self, begin: Callable[[], None]) -> Simulation:
        """Return where the simulation gets to from where `begin` puts it."""
        save = None if self.loop.settings.checkpoint is None else self.save

        def work() -> Outcome:
            begin()
            return self.loop.advance(self, save)

        return self.loop.run(work, self.finish)

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.engine.steps

    def next_stop(self) -> int | Outcome:
        """Return the step that is to be observed next."""
        steps, every = self.engine.steps, self.settings.trace_every
        if steps >= self.settings.steps:
            return Outcome.FINISHED
        if steps >= self.end:
            due = self.settings.steps - steps
            if every is not None:
                due = min(due, every - steps % every)
            if self.faces is not None:
                due = min(due, self.faces.until_next(steps))
            self.end = steps + int(min(due, self.observe_every))
        return self.end

    def advance(self, steps: int) -> Outcome | None:
        """Take so many steps."""
        return None if self.engine.advance(steps) == RUNNING else Outcome.STEP_TOO_LONG

    def observe(self) -> Outcome | None:
        """Keep what is to be kept of this step; end the run where energy grew by more than work explains."""
        now = self.engine.observe()
        last, start = self._moment(self.last), self._moment(self.start)
        if not self.watch.is_calm(self._moment(now), last, start, self.engine.steps):
            return Outcome.STEP_TOO_LONG
        if self.faces is not None and not self.faces.have_room():
            return Outcome.WALLS_MET
        if self.engine.is_crowded:
            return Outcome.TOO_MANY_TOUCHES
        self._keep(now)
        return None

    def figures(self) -> tuple[str, dict[str, Any]]:
        """Return the stage and what the progress callback gets."""
        last, engine = self.last, self.engine
        total = float(last[POTENTIAL] + last[TANGENTIAL] + last[KINETIC] + last[ROTATIONAL])
        figures = {"steps": engine.steps, "time": engine.time, "energy": total, "strain": float(last[STRAIN])}
        return type(self.settings.method).__name__, {**figures, "engine": engine}

    def _moment(self, row: NDArray[np.float64]) -> Moment:
        return moments_of(row[None], self.direction_dd, self.held, self.engine.released)[0]

    def _keep(self, now: NDArray[np.float64]) -> None:
        engine, largest, d = self.engine, self.largest, len(self.engine.axes)
        self.last, self.reached = now, engine.steps
        self.state, self.orientation_nq = (engine.positions(), engine.velocities()), engine.orientations()
        self.box, self.spin_nk, self.tension_l = engine.box(), engine.spins(), engine.tensions()
        moved = float(np.abs(now[MOMENTUM : MOMENTUM + d] - self.start[MOMENTUM : MOMENTUM + d]).max())
        potential = abs(float(now[POTENTIAL] + now[TANGENTIAL])) + abs(float(now[BEHIND_FACES]))
        kinetic = float(now[KINETIC] + now[ROTATIONAL] + now[OF_FACES])
        seen = {"energy": potential + kinetic, "impulse": float(now[IMPULSE]), "momentum": moved}
        for name, value in {**seen, "link": float(now[LINK_ERROR])}.items():
            largest[name] = max(largest[name], value)
        if self.faces is not None:
            self.faces.keep()
        every = self.settings.trace_every
        if every is not None and (engine.steps % every == 0 or engine.steps == self.settings.steps):
            self.kept.append((engine.steps, now))
            self.added.append(measure_added(self._measured))
            if self.position_t is not None:
                self.position_t.append(self.state[0])
                self.velocity_t.append(self.state[1])
                kept = (self.box.lattice_dd, self.spin_nk, touching_of(engine), self.orientation_nq)
                self.snapshots.append(Snapshot(*kept))

    def _measured(self) -> State:
        """Return what added observables are measured of."""
        now = (self.reached, self.engine.time, self.state[1].copy(), self.spin_nk)
        return State(self._packing(), self.engine.effects, *now)

    def save(self) -> None:
        """Write the checkpoint."""
        path, arrays = self.loop.settings.checkpoint, self.arrays()
        assert path is not None
        check_indices(arrays, self.index_bounds())
        every = self.loop.settings.checkpoint_every
        table = {**self.settings.to_table(), "checkpoint_every": every, "reached": self.reached}
        write_checkpoint(path, KIND, table, arrays)

    def index_bounds(self) -> dict[str, IndexBounds]:
        """Return what the saved arrays of integers may hold."""
        kept = {"kept_step_t": IndexBounds(0, 1 << 62, (None,))}
        kept |= {} if self.faces is None else self.faces.index_bounds()
        return self.engine.index_bounds() | kept | snapshot_bounds(*self.scene.packing.position_nd.shape)

    def arrays(self) -> Arrays:
        """Return what a checkpoint keeps, by name."""
        settings = self.settings
        arrays = self.engine.arrays()
        if settings.held_n is not None:
            arrays["held_n"] = settings.held_n
        arrays["start_row"], arrays["last_row"] = self.start, self.last
        arrays["kept_row_tk"] = np.array([row for _, row in self.kept]).reshape(-1, COLUMNS)
        arrays["kept_step_t"] = np.array([step for step, _ in self.kept], dtype=np.int64)
        arrays |= added_arrays(self.added)
        if self.faces is not None:
            arrays |= self.faces.arrays()
        if self.position_t is not None:
            shape = (-1, *self.scene.packing.position_nd.shape)
            arrays["kept_position_tnd"] = np.array(self.position_t).reshape(shape)
            arrays["kept_velocity_tnd"] = np.array(self.velocity_t).reshape(shape)
            arrays |= snapshot_arrays(self.snapshots)
        arrays["state_position_nd"], arrays["state_velocity_nd"] = self.state
        arrays["state_lattice_dd"], arrays["state_tension_l"] = self.box.lattice_dd, self.tension_l
        if self.spin_nk is not None:
            arrays["state_spin_nk"] = self.spin_nk
        if self.orientation_nq is not None:
            arrays["state_orientation_nq"] = self.orientation_nq
        numbers = {
            "reached": self.reached,
            "end": self.end,
            "largest": self.largest,
            "watch": self.watch.to_table(),
            "seconds": self._seconds(),
        }
        return arrays | {"numbers_json": np.array(json.dumps(numbers))}

    def restore(self, arrays: Arrays) -> None:
        """Go back to where a checkpoint was made."""
        table = json.loads(str(arrays["numbers_json"]))
        every, packing = self.settings.trace_every, self.scene.packing
        (n, d), spins = packing.position_nd.shape, self.engine.spins()
        turning = None if spins is None else (n, spins.shape[1])
        self.reached = integer("reached", table["reached"], at_least=0, at_most=int(arrays["engine.steps"]))
        step_t = _kept_steps(arrays["kept_step_t"], every, self.reached)
        row_tk = saved_array(arrays, "kept_row_tk", (len(step_t), COLUMNS))
        self.engine.restore(arrays)
        self.start, self.last = (saved_array(arrays, name, (COLUMNS,)) for name in ("start_row", "last_row"))
        # the last step of a run that goes on is kept no longer, unless its turn has come
        chosen = [t for t, step in enumerate(step_t) if every is not None and step % every == 0]
        self.kept = [(step_t[t], row_tk[t]) for t in chosen]
        if self.faces is not None:
            self.faces.restore(arrays)
        added = added_rows(arrays, len(step_t), d)
        self.added = [added[t] for t in chosen]
        if self.position_t is not None:
            position_tnd, velocity_tnd = (
                saved_array(arrays, f"kept_{name}_tnd", (len(step_t), n, d)) for name in ("position", "velocity")
            )
            self.position_t = [position_tnd[t] for t in chosen]
            self.velocity_t = [velocity_tnd[t] for t in chosen]
            turned = packing.shapes.orientation_nq.shape if packing.shapes.has_orientations else None
            snapshots = snapshots_of(arrays, len(step_t), turning, d, turned)
            self.snapshots = [snapshots[t] for t in chosen]
        position_nd, velocity_nd = (
            saved_array(arrays, f"state_{name}_nd", (n, d)) for name in ("position", "velocity")
        )
        self.box = Box(saved_array(arrays, "state_lattice_dd", (d, d)))
        self.state = packing.replace(position_nd=position_nd, box=self.box).position_nd, velocity_nd
        self.tension_l = saved_array(arrays, "state_tension_l", self.tension_l.shape)
        self.spin_nk = None if turning is None else saved_array(arrays, "state_spin_nk", turning)
        if packing.shapes.has_orientations:
            shape = packing.shapes.orientation_nq.shape
            self.orientation_nq = saved_array(arrays, "state_orientation_nq", shape)
        self.largest = {name: float(table["largest"][name]) for name in self.largest}
        self.watch = dataclasses.replace(self.watch, **table["watch"])
        self.end, self.seconds_before = min(int(table["end"]), self.settings.steps), float(table["seconds"])

    def _seconds(self) -> float:
        return self.seconds_before + time.process_time() - self.began - self.build_seconds

    def finish(self, outcome: Outcome) -> Simulation:
        """Return the run as far as it came."""
        start, last, largest, settings = self.start, self.last, self.largest, self.settings
        mean = float(last[TOTAL] / last[CONTACTS]) if last[CONTACTS] else 0.0
        residual = float(last[LARGEST_FORCE]) / mean if mean > 0 else 0.0
        seconds = self._seconds()
        note = compiling_noted("", self.loop.compiling(), seconds)
        evaluations, name = self.engine.force_evaluations, type(settings.method).__name__
        before, after = self._moment(start), self._moment(last)
        change = after.energy + after.kinetic - (before.energy + before.kinetic)
        return Simulation(
            packing=self._packing(final=True),
            outcome=outcome,
            residual=residual,
            steps=self.reached,
            force_evaluations=evaluations,
            seconds=seconds,
            build_seconds=self.build_seconds,
            stages=(Stage(name, residual, self.reached, evaluations, seconds, note),),
            trace=self._trace(),
            velocity_nd=self.state[1],
            dt=settings.dt,
            energy_drift=change / largest["energy"] if largest["energy"] > 0 else 0.0,
            momentum_error=largest["momentum"] / largest["impulse"] if largest["impulse"] > 0 else 0.0,
            link_error=largest["link"],
            tension_l=self.tension_l,
            spin_nk=self.spin_nk,
            strain=float(last[STRAIN]),
            held_n=self._held(),
            **bonds_at(self.engine, self.reached),
            ledger=ledger_of(self.engine),
            walls=None if self.faces is None else self.faces.moved_walls(),
            unmet=unmet_conditions(
                outcome, *self.engine.limits(), Condition("steps", self.reached, settings.steps, 0.0)
            ),
        )

    def _held(self) -> NDArray[np.bool_] | None:
        """Return which particles are held, by the call or by the scene; None where none is."""
        fixed = held_particles(self.scene.effects, self.scene.packing.particles)
        asked = self.settings.held_n
        return fixed if asked is None else asked if fixed is None else asked | fixed

    def _packing(self, *, final: bool = False) -> Packing:
        """Return the packing that was kept last; the one at the end with its tangential displacements."""
        # a run that went astray goes back to an earlier step, whose springs are gone
        there = final and self.engine.steps == self.reached
        tangential = self.engine.tangential() if there else None
        return self.engine.packing_at(self.state[0], self.orientation_nq, self.box, tangential)

    def _trace(self) -> MotionTrace | None:
        if self.settings.trace_every is None or not self.kept:
            return None
        step_t, rows = zip(*self.kept, strict=True)
        return trace_of_rows(step_t, rows, self.added, self.engine, self.position_t, self.velocity_t, self.snapshots)
