"""Shear-v0: its options, and episodes of many packings that are sheared frame by frame with a goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs import shear_goals as goals
from packmech_envs.episodes import Infos, reset_options
from packmech_envs.shear_goals import GOING, REASONS, Goal, goal_of, score_frames
from packmech_envs.tasks import LINKS, boolean, budget, count, one_of, positive, scene_of, shearable
from packmech_envs.turned import ObservedOrientations
from packmech_envs.words import brief

__all__ = ["ShearEpisodes", "ShearTask"]

CONTROLS = ("strain", "rate", "strain_and_rate")
UNITS = ("scene", "reduced")
# figures that are observed, in this order, with the stress between them; those that are in infos
_BEFORE, _AFTER = ("strain", "rate"), ("pressure", "kinetic_energy", "contacts", "sliding_fraction")
_INFOS = ("time", "elastic_energy", "work")
_REASONS = np.array(REASONS, dtype=object)
# the largest rate, unless given: this strain in a frame
_FRAME_STRAIN = 0.01


@dataclass(frozen=True, kw_only=True)
class ShearTask:
    """The options of Shear-v0, alone and batched, which take them as keywords or as this one record.

    Parameters
    ----------
    goal
        "follow_stress", "dissipate_least", "find_yield_strain", or one of their records with numbers of your own:
        `FollowStress`, `DissipateLeast`, `FindYieldStrain` in `packmech_envs.shear_goals`.
    control
        "rate", "strain" or "strain_and_rate": what an action sets.
    frame_skip
        Time steps of a frame.
    dt
        Time step. Unless given: that of the scene's drive, or the method's fraction of the shortest of
        sqrt(m / stiffness) and m / damping.
    axes
        Direction of the displacements, and of their gradient; unless given those of the scene's drive, or (0, 1).
    method
        pm.VelocityVerlet() or pm.SemiImplicitEuler(); unless given that of the scene's drive, or the former.
    largest_strain
        Bound of the strain that an action asks for [1].
    largest_rate
        Bound of the rate that an action asks for [1/time]; unless given a strain of 0.01 in a frame.
    extra_actions
        ("friction",) or (): further numbers of an action.
    start
        "as_prepared"; "random": every episode starts from a packing of its own, made by the scene's recipe with a seed
        drawn from the generator, which may take a second; or an integer K: drawn among K of them, each made once.
    relax
        Whether the start is brought to its energy minimum first, where minimizers know the scene's energy.
    links, link_stiffness
        What becomes of rigid links: "refuse", or "bonds": each a permanent bond of this stiffness (ten times
        energy_scale / reference_diameter^2 unless given).
    orientations
        Whether each particle's director is observed, beside the order tensor of all; for shapes only.
    budget
        Frames of an episode; None: no end.
    units
        Of observations: "scene": those of the scene; "reduced": energies in its energy_scale, stresses in energy_scale
        / reference_diameter^d, rates in the largest rate, contacts per degree of freedom of the particles.

    Raises
    ------
    TypeError, ValueError
        Naming the option that is wrong.

    Examples
    --------
    >>> ShearTask(goal="dissipate_least", control="strain").frame_skip
    20

    """

    goal: str | Goal = "follow_stress"
    control: str = "rate"
    frame_skip: int = 20
    dt: float | None = None
    axes: tuple[int, int] | None = None
    method: Any = None
    largest_strain: float = 0.2
    largest_rate: float | None = None
    extra_actions: Sequence[str] = ()
    start: str | int = "as_prepared"
    relax: bool = True
    links: str = "refuse"
    link_stiffness: float | None = None
    orientations: bool = False
    budget: int | None = 200
    units: str = "scene"

    def __post_init__(self) -> None:
        goal_of(self.goal)
        one_of("control", self.control, CONTROLS)
        count("frame_skip", self.frame_skip)
        positive("largest_strain", self.largest_strain)
        if self.largest_rate is not None:
            positive("largest_rate", self.largest_rate)
        _check_extra_actions(self.extra_actions)
        _check_start(self.start)
        boolean("relax", self.relax)
        one_of("links", self.links, LINKS)
        if self.link_stiffness is not None:
            positive("link_stiffness", self.link_stiffness)
        boolean("orientations", self.orientations)
        budget("budget", self.budget)
        one_of("units", self.units, UNITS)


def _check_extra_actions(extra_actions: Any) -> None:
    if isinstance(extra_actions, str) or not isinstance(extra_actions, Sequence):
        raise TypeError(f"extra_actions must be a tuple of names such as ('friction',), got {brief(extra_actions)}")
    for name in extra_actions:
        if not isinstance(name, str) or name != "friction":
            raise ValueError(f"extra_actions must hold 'friction' or nothing, got {brief(name)}")


def _check_start(start: Any) -> None:
    number = isinstance(start, int | np.integer) and not isinstance(start, bool) and start >= 1
    if not number and not (isinstance(start, str) and start in ("as_prepared", "random")):
        raise ValueError(f"start must be 'as_prepared', 'random' or how many packings to draw from, got {brief(start)}")


# scenes and starts


def prepared(scene: pm.Scene, relax: bool, links: str, link_stiffness: float | None) -> pm.Scene:
    """Return the scene as an episode starts from it."""
    if relax and _has_minimum(scene):
        # friction has no energy: contacts start with slack tangential springs
        smooth = scene.without(pm.Friction, pm.RollingResistance, pm.TwistingResistance)
        minimum = pm.quench(smooth, force_tolerance=1e-8, check=False)
        scene = scene.replace(packing=minimum.packing)
    return shearable(scene, links=links, link_stiffness=link_stiffness)


@cache
def _prepared_by_name(name: str, *options: Any) -> pm.Scene:
    return prepared(scene_of(name), *options)


def _has_minimum(scene: pm.Scene) -> bool:
    """Whether minimizers know the energy of a scene, and nothing says how it moves at the start."""
    if getattr(scene.drive, "velocities", None) is not None or getattr(scene.drive, "held", None):
        return False
    other = any(isinstance(one, pm.Bonds | pm.Gravity | pm.Walls) for one in scene.effects)
    return not other and any(isinstance(one, pm.Repulsion) for one in scene.effects)


def motion_of(scene: pm.Scene) -> dict[str, Any]:
    """Return what the drive of a scene says of its motion, as arguments of `pm.ShearBatch`; None where it says nothing.

    Examples
    --------
    >>> motion_of(scene_of("frictionless"))["axes"]
    (0, 1)

    """
    drive = scene.drive
    method = getattr(drive, "method", None)
    velocities, spins, held = (getattr(drive, name, None) for name in ("velocities", "spins", "held"))
    held_n = None
    if held:
        held_n = np.zeros(scene.packing.particles, dtype=bool)
        held_n[list(held)] = True
    return {
        "dt": getattr(drive, "dt", None),
        "method": method if isinstance(method, pm.VelocityVerlet | pm.SemiImplicitEuler) else None,
        "axes": getattr(drive, "axes", (0, 1)),
        "velocity_nd": None if velocities is None else np.array(velocities),
        "spin_nk": None if spins is None else np.array(spins),
        "held_n": held_n,
    }


class ShearEpisodes:
    """B episodes of Shear-v0, over arrays with a row for each packing.

    Parameters
    ----------
    count
        B.
    scene
        As of `ShearEnv`.
    task
        The options.
    threads
        How many packings are stepped at a time.

    """

    def __init__(self, count: int, scene: Any, task: ShearTask, threads: int = 1) -> None:
        self.task, self.goal = task, goal_of(task.goal)
        self.budget = task.budget
        self._named = scene if not isinstance(scene, pm.Scene) else None
        self._how = (task.relax, task.links, task.link_stiffness)
        self._drawn: dict[int, pm.Scene] = {}
        if task.start != "as_prepared" and self._named is None:
            raise ValueError(f"start must be 'as_prepared' for a scene that is given as a Scene, got {task.start!r}")
        if isinstance(scene, str) and scene in pm.list_scenes():
            first = _prepared_by_name(scene, *self._how)
        else:
            first = prepared(scene_of(scene), *self._how)
        if task.start != "as_prepared":
            # refuses recipes without a seed
            first = self._random(0)
        self._first = first
        extras = tuple(dict.fromkeys(task.extra_actions))
        friction = [one.coefficient for one in first.effects if isinstance(one, pm.Friction)]
        if extras and not friction:
            raise ValueError("extra_actions must be left out for a scene without friction, got 'friction'")
        given = {name: getattr(task, name) for name in ("dt", "axes", "method")}
        motion = motion_of(first) | {name: value for name, value in given.items() if value is not None}
        self.batch = pm.ShearBatch(
            [first] * count, control=task.control, steps=task.frame_skip, switched_friction=bool(extras),
            threads=threads, **motion,
        )  # fmt: skip
        self.dt = float(self.batch.dt)
        self.frame_time = self.dt * int(self.batch.steps)
        fastest = _FRAME_STRAIN / self.frame_time if task.largest_rate is None else float(task.largest_rate)
        largest = {"strain": float(task.largest_strain), "rate": fastest}
        asked = ("strain", "rate") if task.control == "strain_and_rate" else (task.control,)
        low = [-largest[name] for name in asked] + [0.0] * len(extras)
        high = [largest[name] for name in asked] + friction[: len(extras)]
        self.action_names = (*asked, *extras)
        self.action_space = gym.spaces.Box(np.array(low), np.array(high), dtype=np.float64)
        figures = self._figures()
        scored = (*figures, *self.goal.observed)
        self._turned = ObservedOrientations(first.packing, task.orientations)
        self.observation_names = (*scored, *self._turned.names)
        self.info_names = (*_INFOS, *self.goal.terms, *self.goal.infos)
        self.observation_space = self._space()
        self._memory_bk = np.zeros((count, goals.MEMORY))
        self.observation_bk = np.zeros((count, len(self.observation_names)))
        # infos, then the reward and the number of the reason
        self.result_bk = np.zeros((count, len(self.info_names) + 2))
        self._info_bk = self.result_bk[:, :-2]
        self.reward_b, self.reason_b = self.result_bk[:, -2], self.result_bk[:, -1]
        self._all_b = np.ones(count, dtype=bool)
        self._unlimited_b = np.zeros(count, dtype=bool)
        # those of the first packing
        self.figure_k, self.observation_k = self.batch.figure_bk[0], self.observation_bk[0]
        self.result_k = self.result_bk[0]
        volume = first.packing.box.volume
        self._scored = (
            self.goal.kind,
            np.array([self.goal.weight_failure, fastest, *self.goal.numbers(first.pressure_unit, volume)]),
            self._where(),
            np.array([self.batch.names.index(name) for name in figures]),
            self._scales(fastest),
            self.batch.figure_bk,
            np.zeros_like(self.batch.figure_bk),
            self._memory_bk,
            self.observation_bk[:, : len(scored)],
            self._info_bk,
            self.reward_b,
            self.reason_b,
        )

    def __len__(self) -> int:
        return len(self._all_b)

    # observations

    def _figures(self) -> tuple[str, ...]:
        """Return the names of the figures that are observed."""
        return (*_BEFORE, *(name for name in self.batch.names if name.startswith("stress_")), *_AFTER)

    def _where(self) -> NDArray[np.int64]:
        """Return the columns of the figures that goals need."""
        plane = "".join(sorted("xyz"[axis] for axis in self.batch.axes))
        names = (f"stress_{plane}", "kinetic_energy", "elastic_energy", "work")
        return np.array([self.batch.names.index(name) for name in names])

    def _scales(self, fastest: float) -> NDArray[np.float64]:
        """Return the factors that bring observations into the units asked for."""
        scene = self._first
        freedom = scene.packing.dimension * scene.packing.particles
        unit = {"energy": scene.energy_scale, "stress": scene.pressure_unit, "rate": fastest, "contacts": freedom}
        if self.task.units == "scene":
            unit = dict.fromkeys(unit, 1.0)
        return np.array([1.0 / unit.get(_kind(name), 1.0) for name in (*self._figures(), *self.goal.observed)])

    def _space(self) -> gym.spaces.Box[np.float64]:
        low = [0.0 if name in ("kinetic_energy", "contacts", "sliding_fraction") else -np.inf
               for name in self.observation_names]  # fmt: skip
        high = [1.0 if name == "sliding_fraction" else np.inf for name in self.observation_names]
        for k, (lowest, highest) in enumerate(self._turned.bounds, len(low) - len(self._turned.names)):
            low[k], high[k] = lowest, highest
        return gym.spaces.Box(np.array(low), np.array(high), dtype=np.float64)

    # episodes

    def _random(self, seed: int) -> pm.Scene:
        """Return a scene made by its recipe."""
        assert self._named is not None
        return prepared(pm.read_scene(self._named, seed=seed), *self._how)

    def _begin(self, rng: np.random.Generator) -> pm.Scene:
        """Return the scene that an episode starts from."""
        start = self.task.start
        if start == "as_prepared":
            return self._first
        if isinstance(start, str):
            return self._random(int(rng.integers(2**31)))
        seed = int(rng.integers(start))
        if seed not in self._drawn:
            self._drawn[seed] = self._random(seed)
        return self._drawn[seed]

    def start(self, index_k: Sequence[int], rngs: Sequence[np.random.Generator], options: Any) -> None:
        """Start new episodes of these packings, each with its own generator; nothing of the old ones is left."""
        rate = _rate(options)
        started_b = np.zeros(len(self), dtype=bool)
        for b, rng in zip(index_k, rngs, strict=True):
            self.batch.restart(int(b), self._begin(rng), rate=rate)
            self._memory_bk[b] = 0.0
            self.goal.draw(rng, self._memory_bk[b], self._first.pressure_unit)
            started_b[b] = True
        score_frames(True, started_b, self._all_b, *self._scored)
        self._observe_turns(started_b)

    def advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_] | None = None) -> None:
        """Advance the active packings by a frame and score it; None: all of them."""
        good_b = self.batch.advance(action_bk, active_b)
        stepped_b = self._all_b if active_b is None else active_b
        score_frames(False, stepped_b, good_b, *self._scored)
        self._observe_turns(stepped_b)

    def _observe_turns(self, which_b: NDArray[np.bool_]) -> None:
        """Write how particles are turned into the observations of these packings; nothing for discs and spheres."""
        if not self._turned.names:
            return
        place = self.observation_bk.shape[1] - len(self._turned.names)
        for b in np.flatnonzero(which_b).tolist():
            packing = self.batch.scenes[b].packing
            orientation_nq = self.batch.orientations(b)
            assert orientation_nq is not None  # what turns has orientations
            turned = packing.replace(shapes=packing.shapes.oriented(orientation_nq))
            self.observation_bk[b, place:] = self._turned.row(turned)

    @property
    def terminated_b(self) -> NDArray[np.bool_]:
        """Whether the last frame ended the task of each packing."""
        return np.asarray(self.reason_b != GOING)

    @property
    def truncated_b(self) -> NDArray[np.bool_]:
        """Whether the budget of each episode is spent."""
        if self.budget is None:
            return self._unlimited_b
        return np.asarray(self._memory_bk[:, goals.ELAPSED] >= self.budget)

    def infos(self) -> Infos:
        """Return the infos by name, B rows each, with the reasons of those that are over."""
        infos: Infos = {name: self._info_bk[:, k] for k, name in enumerate(self.info_names)}
        if self.reason_b.any():
            infos["reason"] = _REASONS[self.reason_b.astype(np.int64)]
        return infos

    def scene(self, index: int) -> pm.Scene:
        """Return the scene of one packing as its episode started from it."""
        return self.batch.scenes[index]

    def packing(self, index: int) -> pm.Packing:
        """Return one packing as it is now."""
        return self.batch.packing(index)


def _kind(name: str) -> str:
    """Return the kind of quantity that an observation is."""
    if name.endswith("energy"):
        return "energy"
    if name in ("pressure", "target_stress", "yield_stress") or name.startswith("stress_"):
        return "stress"
    return name


def _rate(options: Any) -> float:
    """Return the strain rate at the start, from the options of a reset."""
    rate: float = reset_options(options, ("rate",)).get("rate", 0.0)
    return rate
