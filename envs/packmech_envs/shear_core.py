"""What a sheared environment and its batched twin share: scenes and starts, spaces, observations and rewards."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs import shear_tasks as tasks
from packmech_envs.scenes import LINKS, scene_of, shearable
from packmech_envs.shear_tasks import judge, task_of

CONTROLS = ("strain", "rate", "strain_and_rate")
UNITS = ("scene", "reduced")
# figures that are observed, in this order, the stress between; the others are told in infos
_BEFORE, _AFTER = ("strain", "rate"), ("pressure", "kinetic_energy", "contacts", "sliding_fraction")
_INFOS = ("time", "elastic_energy", "work")
# the largest rate, unless given: this strain in a frame
_FRAME_STRAIN = 0.01


class Motion(NamedTuple):
    """What a scene's drive says of masses, velocities and the time step; None where it says nothing."""

    dt: float | None
    method: Any
    axes: tuple[int, int]
    density: float | None
    mass_n: Any
    velocity_nd: Any
    spin_nk: Any
    held_n: Any


def motion_of(scene: pm.Scene) -> Motion:
    """Return what the drive of a scene says of its motion.

    Examples
    --------
    >>> motion_of(scene_of("frictionless")).density
    1e-09

    """
    drive = scene.drive
    said = {name: getattr(drive, name, None) for name in ("dt", "density", "masses", "velocities", "spins")}
    held = getattr(drive, "held", ())
    held_n = None
    if held:
        held_n = np.zeros(scene.packing.particles, dtype=bool)
        held_n[list(held)] = True
    method = getattr(drive, "method", None)
    rows = {name: said[name] if said[name] is None else np.array(said[name]) for name in ("velocities", "spins")}
    return Motion(
        said["dt"],
        method if isinstance(method, pm.VelocityVerlet | pm.SemiImplicitEuler) else None,
        getattr(drive, "axes", (0, 1)),
        said["density"],
        said["masses"],
        rows["velocities"],
        rows["spins"],
        held_n,
    )


class Start(NamedTuple):
    """How a start is made: whether it is brought to its energy minimum, and what becomes of rigid links."""

    relax: bool
    links: str
    link_stiffness: float | None

    def scene(self, scene: pm.Scene) -> pm.Scene:
        """Return the scene as an episode starts from it."""
        if self.relax and _quenches(scene):
            drawn = pm.quench(scene, force_tolerance=1e-8, check=False)
            scene = scene.replace(packing=drawn.packing)
        return shearable(scene, links=self.links, link_stiffness=self.link_stiffness)


def _quenches(scene: pm.Scene) -> bool:
    """Whether a scene's energy is one that a minimizer knows, and nothing says how it moves at the start."""
    motion = motion_of(scene)
    if motion.velocity_nd is not None or motion.held_n is not None:
        return False
    other = any(isinstance(one, pm.Bonds | pm.Gravity | pm.Walls) for one in scene.effects)
    return not other and any(isinstance(one, pm.Repulsion) for one in scene.effects)


@cache
def _shipped(name: str, start: Start) -> pm.Scene:
    return start.scene(scene_of(name))


class ShearCore:
    """Sheared packings with a task: what both environments do, over arrays with a row for each packing.

    Parameters are those of `ShearEnv`, and `count`, how many packings.
    """

    def __init__(
        self,
        count: int,
        *,
        scene: Any,
        task: Any,
        control: str,
        frame_skip: int,
        dt: float | None,
        axes: tuple[int, int] | None,
        method: Any,
        largest_strain: float,
        largest_rate: float | None,
        extra_actions: Sequence[str],
        start: Any,
        relax: bool,
        links: str,
        link_stiffness: float | None,
        budget: int | None,
        units: str,
        threads: int = 1,
    ) -> None:
        _one_of("control", control, CONTROLS)
        _one_of("units", units, UNITS)
        if not isinstance(relax, bool):
            raise TypeError(f"relax must be True or False, got {relax!r}")
        _one_of("links", links, LINKS)
        if link_stiffness is not None:
            link_stiffness = _positive("link_stiffness", link_stiffness)
        frame_skip = _count("frame_skip", frame_skip)
        self._how = Start(relax, links, link_stiffness)
        self._named = scene if not isinstance(scene, pm.Scene) else None
        self._choice = _choice(start, self._named)
        self._drawn: dict[int, pm.Scene] = {}
        if isinstance(scene, str) and scene in pm.list_scenes():
            self.scene = _shipped(scene, self._how)
        else:
            self.scene = self._how.scene(scene_of(scene))
        if self._choice != "as_prepared":
            # refuses recipes without a seed
            self.scene = self._random(0)
        self.task = task_of(task)
        extras = _extras(extra_actions, self.scene)
        motion = motion_of(self.scene)
        self.batch = pm.ShearBatch(
            [self.scene] * count,
            control=control,
            steps=frame_skip,
            dt=motion.dt if dt is None else dt,
            switched_friction="friction" in extras,
            axes=motion.axes if axes is None else axes,
            method=motion.method if method is None else method,
            mass_n=motion.mass_n,
            density=motion.density,
            velocity_nd=motion.velocity_nd,
            spin_nk=motion.spin_nk,
            held_n=motion.held_n,
            threads=threads,
        )
        batch = self.batch
        self.dt = float(batch.dt)
        self.frame_time = self.dt * int(batch.steps)
        most = _positive("largest_strain", largest_strain)
        fastest = _FRAME_STRAIN / self.frame_time if largest_rate is None else _positive("largest_rate", largest_rate)
        bounds = {"strain": [most], "rate": [fastest], "strain_and_rate": [most, fastest]}[control]
        low, high = [-one for one in bounds], list(bounds)
        for _ in extras:
            low.append(0.0)
            high.append(next(one.coefficient for one in self.scene.effects if isinstance(one, pm.Friction)))
        self.action_names = (*(("strain", "rate") if control == "strain_and_rate" else (control,)), *extras)
        self.action_space = gym.spaces.Box(np.array(low), np.array(high), dtype=np.float64)
        self._observe(units, fastest, budget)
        self._memory_bk = np.zeros((count, tasks.MEMORY))
        self._before_bk = np.zeros_like(batch.figure_bk)
        self.observation_bk = np.zeros((count, len(self.observation_names)))
        # infos, then the reward and the number of the reason
        self.answer_bk = np.zeros((count, len(self.info_names) + 2))
        self.info_bk, self.reward_b, self.reason_b = (
            self.answer_bk[:, :-2],
            self.answer_bk[:, -2],
            self.answer_bk[:, -1],
        )
        self._all_b = np.ones(count, dtype=bool)
        # those of the first one
        self.figure_k, self.observation_k, self.answer_k = batch.figure_bk[0], self.observation_bk[0], self.answer_bk[0]
        self._judged = (
            self.task.kind,
            self._number_k,
            self._where,
            self._pick_k,
            self._scale_k,
            batch.figure_bk,
            self._before_bk,
            self._memory_bk,
            self.observation_bk,
            self.info_bk,
            self.reward_b,
            self.reason_b,
        )

    def _observe(self, units: str, fastest: float, budget: int | None) -> None:
        names, task, scene = self.batch.names, self.task, self.scene
        figures = (*_BEFORE, *(name for name in names if name.startswith("stress_")), *_AFTER)
        self.observation_names = (*figures, *task.seen)
        self.info_names = (*_INFOS, *task.terms, *task.told)
        d = scene.packing.dimension
        plane = "".join(sorted("xyz"[axis] for axis in (self.batch.axes)))
        where = (f"stress_{plane}", "kinetic_energy", "elastic_energy", "work")
        self._where = np.array([names.index(name) for name in where])
        self._pick_k = np.array([names.index(name) for name in figures])
        volume = scene.packing.box.volume
        self.budget = None if budget is None else _count("budget", budget, "None or an integer at least 1")
        leading = [task.weight_failure, float(budget or 0), fastest]
        self._number_k = np.array([*leading, *task.numbers(scene.pressure_unit, volume)])
        # what one unit of each kind is
        unit = {"energy": scene.energy_scale, "stress": scene.pressure_unit, "rate": fastest, "contacts": 1.0}
        if units == "scene":
            unit = dict.fromkeys(unit, 1.0)
        else:
            unit["contacts"] = d * scene.packing.particles
        self._scale_k = np.array([1.0 / unit.get(_kind(name), 1.0) for name in self.observation_names])
        low = np.array([0.0 if name in ("kinetic_energy", "contacts", "sliding_fraction") else -np.inf
                        for name in self.observation_names])  # fmt: skip
        high = np.array([1.0 if name == "sliding_fraction" else np.inf for name in self.observation_names])
        self.observation_space = gym.spaces.Box(low, high, dtype=np.float64)

    def _random(self, seed: int) -> pm.Scene:
        assert self._named is not None
        return self._how.scene(pm.read_scene(self._named, seed=seed))

    def _begin(self, rng: np.random.Generator) -> pm.Scene:
        if self._choice == "as_prepared":
            return self.scene
        if self._choice == "random":
            return self._random(int(rng.integers(2**31)))
        seed = int(rng.integers(self._choice))
        if seed not in self._drawn:
            self._drawn[seed] = self._random(seed)
        return self._drawn[seed]

    def start(
        self, index_k: Sequence[int], rngs: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        """Start episodes anew, each with its own generator; nothing of what was before is left."""
        rate = _options(options)
        started_b = np.zeros(len(self.batch), dtype=bool)
        for b, rng in zip(index_k, rngs, strict=True):
            self.batch.restart(int(b), self._begin(rng), rate=rate)
            self._memory_bk[b] = 0.0
            self.task.draw(rng, self._memory_bk[b], self.scene.pressure_unit)
            started_b[b] = True
        judge(True, started_b, self._all_b, *self._judged)

    def advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_] | None = None) -> None:
        """Advance by a frame and judge it; actions lie inside their bounds."""
        good_b = self.batch.advance(action_bk, active_b)
        judge(False, self._all_b if active_b is None else active_b, good_b, *self._judged)

    @property
    def elapsed_b(self) -> NDArray[np.float64]:
        """(B,) how many frames each episode has had."""
        return self._memory_bk[:, tasks.ELAPSED]


def _kind(name: str) -> str:
    if name.endswith("energy"):
        return "energy"
    if name in ("pressure", "target_stress", "yield_stress") or name.startswith("stress_"):
        return "stress"
    return name


def _choice(start: Any, named: Any) -> Any:
    whole = isinstance(start, int | np.integer) and not isinstance(start, bool)
    if not (whole and start >= 1) and start not in ("as_prepared", "random"):
        raise ValueError(f"start must be 'as_prepared', 'random' or how many packings to draw from, got {start!r:.60}")
    if start != "as_prepared" and named is None:
        raise ValueError(f"start must be 'as_prepared' for a scene that is given as a Scene, got {start!r}")
    return int(start) if whole else start


def _extras(extra_actions: Any, scene: pm.Scene) -> tuple[str, ...]:
    if isinstance(extra_actions, str) or not isinstance(extra_actions, Sequence):
        raise TypeError(f"extra_actions must be a tuple of names such as ('friction',), got {extra_actions!r:.60}")
    for name in extra_actions:
        if name != "friction":
            raise ValueError(f"extra_actions must hold 'friction' or nothing, got {name!r:.60}")
    if len(extra_actions) and not any(isinstance(one, pm.Friction) for one in scene.effects):
        raise ValueError("extra_actions must be left out for a scene without friction, got 'friction'")
    return tuple(dict.fromkeys(extra_actions))


def _options(options: dict[str, Any] | None) -> float:
    if not isinstance(options, dict | None):
        raise TypeError(f"options must be None or a dictionary, got {options!r:.60}")
    given = dict(options or {})
    rate = given.pop("rate", 0.0)
    if given:
        raise ValueError(f"options must hold nothing but 'rate', the strain rate at the start, got {sorted(given)}")
    return rate  # type: ignore[no-any-return]


def _one_of(name: str, value: Any, allowed: tuple[str, ...]) -> None:
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r:.60}")


def _count(name: str, value: Any, what: str = "an integer at least 1") -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be {what}, got {value!r:.60}")
    if value < 1:
        raise ValueError(f"{name} must be {what}, got {value}")
    return int(value)


def _positive(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be a positive number, got {value!r:.60}")
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} must be a positive number, got {value!r}")
    return float(value)
