"""Quench-v0: its options, its reward, and episodes of many packings, from a random start to a jammed packing.

A single environment is a batch of one: all numbers are those of arrays of B rows, so that both agree to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.episodes import Infos, reset_options
from packmech_envs.tasks import LEFT_OUT, boolean, budget, one_of, positive, quenchable, real, scene_of
from packmech_envs.turned import ObservedOrientations
from packmech_envs.words import brief

__all__ = ["REWARDS", "TERMS", "QuenchEpisodes", "QuenchReward", "QuenchTask", "default_scene"]

TERMS = ("reward_distance", "reward_evaluations", "reward_stability", "reward_progress", "reward_steps")
ACTIONS = ("continuous", "steps")
INFOS = (
    "packing_fraction", "energy", "pressure", "shear_strain", "force_evaluations", "relaxed", "jammed", *TERMS,
)  # fmt: skip

# decades that a packing whose pressure is zero is away from the target: how far it really is, is not known
_UNJAMMED = 4.0
# force evaluations that cost one weight
_EVALUATIONS = 1000.0
# pressures that rounding alone can make [energy_scale / reference_diameter^d]
_ROUNDING_PRESSURE = 1e-12
# bounds of observations: logarithms above, and below by so many decades less than those of a jammed packing
_HIGHEST_LOG, _DECADES_BELOW, _LOWEST_LOG_FORCE = 4.0, 2.0, -16.0
_LARGEST_STRESS, _LARGEST_EXCESS = 1e4, 50.0
# packing fractions between which starts are drawn, by dimension and whether there are links: well below jamming;
# clusters do not overlap there
_STARTS = {(2, False): (0.7, 0.8), (3, False): (0.5, 0.6), (2, True): (0.4, 0.5), (3, True): (0.3, 0.4)}


def pressed(pressure_b: NDArray[np.float64], largest_pressure: float) -> NDArray[np.bool_]:
    """Return which pressures are observed: those within two decades of the largest that counts as jammed, and above.

    Contacts that merely touch below jamming keep less, as the relaxation ends at a tolerance.
    """
    return np.asarray(pressure_b > largest_pressure * 10.0**-_DECADES_BELOW)


class QuenchReward(NamedTuple):
    """Weights of the terms of the reward of Quench-v0; the reward is their sum.

    Parameters
    ----------
    distance_weight
        On the decades from jamming after the step, which count against: those of the pressure above the largest that
        counts as jammed, 4 where the pressure is too low to be observed, a hundredth of it. They count step by step,
        so that it pays to get there soon.
    evaluation_weight
        On every thousand force evaluations spent, which count against.
    stability_weight
        On a result that was verified to be jammed, which ends the episode.
    progress_weight
        On the decades by which the step narrowed the bracket of jamming, from the packing fraction last seen without
        pressure to that last seen with it; those by which it widened count against. What an episode gains by it depends
        on its start and end alone, as of a potential (Ng, Harada and Russell, 1999), which grows on both sides of
        jamming. It tells a learner after every step.
    step_weight
        On every step, which counts against. A cost of force evaluations alone can be saved by never compressing.

    Examples
    --------
    >>> QuenchReward(stability_weight=10.0).distance(np.array([0.0, 1e-3, 1e-5]), 1e-4).round(12).tolist()
    [4.0, 1.0, 0.0]

    """

    distance_weight: float = 0.25
    evaluation_weight: float = 0.1
    stability_weight: float = 5.0
    progress_weight: float = 0.0
    step_weight: float = 0.0

    @staticmethod
    def distance(pressure_b: NDArray[np.float64], largest_pressure: float) -> NDArray[np.float64]:
        """Return the decades from jamming, by pressures and the largest pressure that counts as jammed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            decades = np.maximum(np.log10(pressure_b / largest_pressure), 0.0)
        return np.where(pressed(pressure_b, largest_pressure), decades, _UNJAMMED)

    def terms(
        self,
        distance_b: NDArray[np.float64],
        evaluations_b: NDArray[np.int64],
        jammed_b: NDArray[np.bool_],
        progress_b: NDArray[np.float64],
    ) -> dict[str, NDArray[np.float64]]:
        """Return the terms of a step, weighted, by name.

        Parameters
        ----------
        distance_b
            (B,) distances after the step.
        evaluations_b
            (B,) force evaluations of the step.
        jammed_b
            (B,) whether the packing was verified to be jammed.
        progress_b
            (B,) decades by which the brackets narrowed.

        """
        values = (
            self.distance_weight * -distance_b,
            self.evaluation_weight * -(evaluations_b / _EVALUATIONS),
            self.stability_weight * jammed_b.astype(np.float64),
            self.progress_weight * progress_b,
            np.full(len(jammed_b), -self.step_weight, dtype=np.float64),
        )
        return dict(zip(TERMS, values, strict=True))


# the rewards that have a name
REWARDS = {
    "distance": QuenchReward(),
    "progress": QuenchReward(distance_weight=0.0, progress_weight=1.0, step_weight=0.1),
}


@dataclass(frozen=True, kw_only=True)
class QuenchTask:
    """The options of Quench-v0, alone and batched, which take them as keywords or as this one record.

    d is the reference diameter of the scene, and energy_scale / d^dimension the pressure unit.

    Parameters
    ----------
    bonds
        What becomes of bonds, which the batch does not know: "refuse" or "leave out".
    friction
        What becomes of friction, which has no energy to be minimized: "refuse" or "leave out".
    relax
        "full": each step relaxes to the tolerance. A number k: each takes k steps of the minimizer, which goes on where
        it was, so that the quench itself can be observed; it then starts from overlaps as they were drawn.
    force_tolerance
        Largest net force over mean contact force that counts as relaxed [1].
    force_floor
        Mean contact force that counts as none [energy_scale / d].
    method
        pm.Fire(), pm.Fire2() or pm.DampedDynamics(); None: Fire().
    start
        "random", or "scene": the packing as the scene has it.
    start_packing_fraction
        A number, or a pair between which it is drawn; None: below jamming; for start="scene" that of the packing.
    packing_fraction_limits
        (low, high) between which steps keep the packing fraction; None: those of `pm.QuenchBatch`.
    actions
        "continuous": two numbers, a change of the packing fraction and a shear strain, from smallest to largest on a
        logarithmic scale. "steps": a direction and a size among a few, and no strain (largest_strain is not used); a
        learner that chooses among a few steps can be exact from the start.
    largest_change, largest_strain, smallest_change
        Largest change of the packing fraction and largest shear strain of an action, and the size up to which actions
        are on a linear scale; the latter unless given a tenth of largest_pressure. With actions="steps" no step is
        smaller, and unless given it is largest_pressure itself: harmonic discs change theirs by a fourth of a step.
    largest_pressure
        Up to which a packing may count as jammed [pressure unit]; None: 0.1 / N^2, where pressure closes few gaps yet.
    verdict
        "collective" or "strict": which verdict ends an episode.
    shear_modulus
        Whether it is observed.
    bracket
        Whether the bracket of jamming is observed: between which packing fractions pressure appeared or vanished last.
        Pressures on the way of a relaxation bracket nothing: only with relax="full", as a reward of progress.
    orientations
        Whether each particle's direction is observed, beside the order tensor of all; for shapes only.
    step_budget, evaluation_budget
        Steps and force evaluations of an episode; None: no end.
    reward
        "distance": each step costs its distance from jamming; "progress": it pays what it came nearer, which learners
        find more easily; or a QuenchReward with weights of your own.

    Raises
    ------
    TypeError, ValueError
        Naming the option that is wrong.

    Examples
    --------
    >>> QuenchTask(relax=5).step_budget
    40

    """

    bonds: str = "refuse"
    friction: str = "refuse"
    relax: str | int = "full"
    force_tolerance: float = 1e-8
    force_floor: float = 0.0
    method: Any = None
    start: str = "random"
    start_packing_fraction: float | tuple[float, float] | None = None
    packing_fraction_limits: tuple[float, float] | None = None
    actions: str = "continuous"
    largest_change: float = 0.05
    smallest_change: float | None = None
    largest_strain: float = 0.05
    largest_pressure: float | None = None
    verdict: str = "collective"
    shear_modulus: bool = False
    bracket: bool = False
    orientations: bool = False
    step_budget: int | None = 40
    evaluation_budget: int | None = 50_000
    reward: str | QuenchReward = "distance"

    def __post_init__(self) -> None:
        one_of("bonds", self.bonds, LEFT_OUT)
        one_of("friction", self.friction, LEFT_OUT)
        one_of("start", self.start, ("random", "scene"))
        one_of("actions", self.actions, ACTIONS)
        one_of("verdict", self.verdict, ("collective", "strict"))
        boolean("shear_modulus", self.shear_modulus)
        boolean("bracket", self.bracket)
        if self.bracket and self.relax != "full":
            raise ValueError(f"bracket must be False unless relax is 'full', got relax={brief(self.relax)}")
        boolean("orientations", self.orientations)
        for name in ("largest_change", "largest_strain", "largest_pressure", "smallest_change"):
            if getattr(self, name) is not None or name in ("largest_change", "largest_strain"):
                positive(name, getattr(self, name))
        if self.largest_change > 0.2 or self.largest_strain > 1.0:
            raise ValueError(
                "largest_change must be at most 0.2 and largest_strain at most 1, "
                f"got {self.largest_change:g} and {self.largest_strain:g}"
            )
        budget("step_budget", self.step_budget)
        budget("evaluation_budget", self.evaluation_budget)
        if isinstance(self.reward, QuenchReward):
            for name, weight in self.reward._asdict().items():
                real(f"reward.{name}", weight)
        elif isinstance(self.reward, str):
            one_of("reward", self.reward, tuple(REWARDS))
        else:
            raise TypeError(f"reward must be a QuenchReward or a name such as 'progress', got {brief(self.reward)}")
        if self.weights.progress_weight != 0.0 and self.relax != "full":
            raise ValueError(f"reward must have progress_weight=0 unless relax is 'full', got relax={self.relax!r}")
        given = self.start_packing_fraction
        if isinstance(given, tuple | list):
            if len(given) != 2:
                raise ValueError(f"start_packing_fraction must be a number or a pair of numbers, got {brief(given)}")
            if positive("start_packing_fraction", given[0]) > positive("start_packing_fraction", given[1]):
                raise ValueError(f"start_packing_fraction must be a pair that rises, got {brief(given)}")
        elif given is not None:
            positive("start_packing_fraction", given)

    @property
    def weights(self) -> QuenchReward:
        """The weights of the reward."""
        return REWARDS[self.reward] if isinstance(self.reward, str) else self.reward


def default_scene() -> pm.Scene:
    """Return 32 bidisperse harmonic discs: small enough that an agent learns in minutes."""
    packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=0)
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))


class QuenchEpisodes:
    """B episodes of Quench-v0.

    Parameters
    ----------
    count
        B.
    scene
        As of `QuenchEnv`.
    task
        The options.
    threads
        How many packings are stepped at a time.

    """

    def __init__(self, count: int, scene: Any, task: QuenchTask, threads: int = 1) -> None:
        self.task = task
        self._reward = task.weights
        given = default_scene() if scene is None else scene_of(scene)
        self._scene = quenchable(given, bonds=task.bonds, friction=task.friction)
        packing = self._scene.packing
        self.largest_pressure = (
            0.1 / packing.particles**2 if task.largest_pressure is None else float(task.largest_pressure)
        )
        self.smallest_change = (
            min((1.0 if task.actions == "steps" else 0.1) * self.largest_pressure, task.largest_change)
            if task.smallest_change is None
            else float(task.smallest_change)
        )
        self._start_range = self._starts(task)
        self.batch = pm.QuenchBatch(
            self._scene, count, relax=task.relax, force_tolerance=task.force_tolerance, force_floor=task.force_floor,
            method=task.method, packing_fraction_limits=task.packing_fraction_limits, threads=threads,
        )  # fmt: skip
        low, high = self.batch.packing_fraction_limits
        if not low <= self._start_range[0] <= self._start_range[1] <= high:
            raise ValueError(
                f"start_packing_fraction must lie inside the limits ({low:g}, {high:g}), got {self._start_range}"
            )
        d = packing.dimension
        self._components = [(a, a) for a in range(d)] + ([(0, 1)] if d == 2 else [(1, 2), (0, 2), (0, 1)])
        stresses = ["stress_" + "xyz"[a] + "xyz"[b] for a, b in self._components]
        names = ["packing_fraction", "log_energy", "log_pressure", "log_max_force", "excess_contacts", *stresses]
        lowest = math.log10(self.largest_pressure) - _DECADES_BELOW
        bounds = [
            (low, high), (2.0 * lowest, _HIGHEST_LOG), (lowest, _HIGHEST_LOG), (_LOWEST_LOG_FORCE, _HIGHEST_LOG),
            (-float(d), _LARGEST_EXCESS),
        ]  # fmt: skip
        bounds += [(-_LARGEST_STRESS, _LARGEST_STRESS)] * len(stresses)
        if task.shear_modulus:
            names.append("shear_modulus")
            bounds.append((-_LARGEST_STRESS, _LARGEST_STRESS))
        if task.bracket:
            names.append("log_bracket")
            bounds.append((math.log10(self.smallest_change), 0.0))
        self._turned = ObservedOrientations(packing, task.orientations)
        names += self._turned.names
        bounds += self._turned.bounds
        self.observation_names = tuple(names)
        self._low_k, self._high_k = np.array(bounds).T.copy()
        self.observation_space: gym.spaces.Box[np.float64] = gym.spaces.Box(self._low_k, self._high_k, dtype=np.float64)
        self.action_names: tuple[str, ...]
        self.action_space: gym.spaces.Box[np.float64] | gym.spaces.MultiDiscrete[Any]
        if task.actions == "steps":
            self._sizes = 1 + int(math.log2(max(task.largest_change / self.smallest_change, 1.0)) + 1e-9)
            self.action_names = ("compress", "halvings")
            self.action_space = gym.spaces.MultiDiscrete([2, self._sizes])
        else:
            self.action_names = ("packing_fraction_change", "shear_strain")
            self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float64)
        self.observation_bk = np.zeros((count, len(names)))
        self.reward_b = np.zeros(count)
        self.terminated_b = np.zeros(count, dtype=bool)
        self.truncated_b = np.zeros(count, dtype=bool)
        self._steps_b = np.zeros(count, dtype=np.int64)
        self._evaluations_b = np.zeros(count, dtype=np.int64)
        self._terms = dict.fromkeys(TERMS, np.zeros(count))
        # the packing fractions last seen without and with pressure, between which jamming is; NaN: none
        self._below_b, self._above_b = np.full(count, np.nan), np.full(count, np.nan)
        self._brackets = task.bracket or self._reward.progress_weight != 0.0

    def __len__(self) -> int:
        return len(self.reward_b)

    def _starts(self, task: QuenchTask) -> tuple[float, float]:
        """Return the packing fractions between which starts are drawn."""
        given, packing = task.start_packing_fraction, self._scene.packing
        if given is None:
            if task.start == "scene":
                given = float(pm.packing_fraction(packing))
            else:
                given = _STARTS[packing.dimension, bool(packing.links)]
        low, high = given if isinstance(given, tuple | list) else (given, given)
        return float(low), float(high)

    # actions

    def _size(self, action_b: NDArray[np.float64], largest: float) -> NDArray[np.float64]:
        """Return what numbers between -1 and 1 stand for: sign(a) s (exp(|a| L) - 1), L = log(1 + c / s)."""
        folds = math.log1p(largest / self.smallest_change)
        return np.asarray(np.sign(action_b) * self.smallest_change * np.expm1(np.abs(action_b) * folds))

    def _asked(self, action_bk: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (B,) changes of the packing fraction and shear strains that actions stand for."""
        task = self.task
        if task.actions == "steps":
            change = np.where(action_bk[:, 0] > 0.0, task.largest_change, -task.largest_change)
            return np.ldexp(change, -action_bk[:, 1].astype(np.int64)), np.zeros(len(action_bk))
        return self._size(action_bk[:, 0], task.largest_change), self._size(action_bk[:, 1], task.largest_strain)

    def action(self, packing_fraction_change: Any, shear_strain: Any) -> NDArray[np.float64]:
        """Return the action that asks for a change of the packing fraction and a shear strain."""
        asked = (
            ("packing_fraction_change", packing_fraction_change, self.task.largest_change),
            ("shear_strain", shear_strain, self.task.largest_strain),
        )
        action = np.empty(2)
        for k, (name, value, largest) in enumerate(asked):
            number = real(name, value)
            if abs(number) > largest * (1.0 + 1e-12):
                raise ValueError(f"{name} must be within {largest:g}, got {number:g}")
            if self.task.actions == "steps":
                if (number == 0.0) is (name == "packing_fraction_change"):
                    required = "other than 0" if name == "packing_fraction_change" else "0"
                    raise ValueError(f"{name} must be {required} with actions='steps', got {number:g}")
                continue
            size = math.log1p(abs(number) / self.smallest_change) / math.log1p(largest / self.smallest_change)
            action[k] = math.copysign(min(size, 1.0), number)
        if self.task.actions == "steps":
            change = float(packing_fraction_change)
            halvings = round(math.log2(self.task.largest_change / abs(change)))
            return np.array([change > 0.0, min(max(halvings, 0), self._sizes - 1)], dtype=np.int64)
        return action

    # episodes

    def start(self, index_k: Sequence[int], rngs: Sequence[np.random.Generator], options: Any) -> None:
        """Start new episodes of these packings, each with its own generator; nothing of the old ones is left."""
        reset_options(options, ())
        for b, rng in zip(index_k, rngs, strict=True):
            self.batch.restart(int(b), self._drawn(rng), relax=self.batch.relax == "full")
        index = np.asarray(index_k, dtype=np.int64)
        pressure = self._pressure()
        self._below_b[index] = self._above_b[index] = np.nan
        self._close_in(index, pressure)
        self._observe(index, pressure)
        self._steps_b[index] = 0
        self._evaluations_b[index] = self.batch.force_evaluations_b[index]
        self.truncated_b[index] = False
        self._verify(index, pressure)
        self._terms = {name: np.where(np.isin(np.arange(len(term)), index), 0.0, term)
                       for name, term in self._terms.items()}  # fmt: skip

    def _drawn(self, rng: np.random.Generator) -> pm.Packing:
        """Return the packing that an episode starts from."""
        low, high = self._start_range
        fraction = low if low == high else float(rng.uniform(low, high))
        packing = self._scene.packing
        if self.task.start == "random":
            return pm.scattered_packing(packing, packing_fraction=fraction, rng=rng)
        now = float(pm.packing_fraction(packing))
        if fraction == now:
            return packing
        if packing.links:
            raise ValueError("start_packing_fraction must be left out for start='scene' and a scene with links")
        factor = (now / fraction) ** (1.0 / packing.dimension)
        return packing.replace(position_nd=packing.position_nd * factor, box=packing.box.scaled(factor))

    def advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> None:
        """Strain and relax the active packings, observe them, and verify those that may be jammed."""
        batch = self.batch
        batch.step(*self._asked(action_bk), active_b=active_b)
        index = np.flatnonzero(active_b)
        pressure = self._pressure()
        progress = self._close_in(index, pressure)
        self._observe(index, pressure)
        self._verify(index, pressure)
        reward = self._reward
        distance = np.where(self.terminated_b, 0.0, reward.distance(pressure, self.largest_pressure))
        self._terms = reward.terms(distance, batch.force_evaluations_b, self.terminated_b, progress)
        self.reward_b = np.sum(list(self._terms.values()), axis=0)
        self._steps_b[index] += 1
        self._evaluations_b[index] += batch.force_evaluations_b[index]
        self.truncated_b[index] = self._spent()[index]

    def _spent(self) -> NDArray[np.bool_]:
        """Return whose budget is spent."""
        spent = np.zeros(len(self), dtype=bool)
        if self.task.step_budget is not None:
            spent |= self._steps_b >= self.task.step_budget
        if self.task.evaluation_budget is not None:
            spent |= self._evaluations_b >= self.task.evaluation_budget
        return spent

    def _pressure(self) -> NDArray[np.float64]:
        """Return the pressures [energy_scale / reference_diameter^d], zero where rounding alone may have made them."""
        pressure = self.batch.pressure_b / self._scene.pressure_unit
        return np.where(np.abs(pressure) > _ROUNDING_PRESSURE, pressure, 0.0)

    def _close_in(self, index: NDArray[np.int64], pressure_b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Update the bracket of these packings, by what is seen of them now; return the (B,) decades it narrowed by.

        A packing may rearrange and jam elsewhere than before. A side that the other one passed is forgotten then.
        A bracket that is neither observed nor rewarded is not kept.
        """
        if not self._brackets:
            return np.zeros(len(self))
        before = self._decades_open()
        fraction = self.batch.packing_fraction_b[index]
        high = pressed(pressure_b[index], self.largest_pressure)
        below, above = self._below_b[index], self._above_b[index]
        self._below_b[index] = np.where(high, np.where(below < fraction, below, np.nan), fraction)
        self._above_b[index] = np.where(high, fraction, np.where(above > fraction, above, np.nan))
        return before - self._decades_open()

    def _decades_open(self) -> NDArray[np.float64]:
        """Return the logarithms of the widths of the brackets: 0 where there is none, at least the smallest change."""
        width = self._above_b - self._below_b
        return np.where(np.isnan(width), 0.0, np.log10(np.fmax(width, self.smallest_change)))

    def _verify(self, index: NDArray[np.int64], pressure_b: NDArray[np.float64]) -> None:
        """Set which of these packings are jammed: by cheap figures first, then by the verdict."""
        batch = self.batch
        maybe = (pressure_b > 0.0) & (pressure_b <= self.largest_pressure) & batch.relaxed_b
        if self._scene.packing.plain:
            maybe &= batch.excess_contacts_b >= 0
        self.terminated_b[index] = False
        for b in index[maybe[index]]:
            # with the scene's law: in equilibrium under one law is not in equilibrium under another
            answer = pm.classify_jamming(self._scene.replace(packing=batch.packing(int(b))))
            self.terminated_b[b] = getattr(answer, self.task.verdict) == "jammed"

    def _observe(self, index: NDArray[np.int64], pressure_b: NDArray[np.float64]) -> None:
        batch, scene = self.batch, self._scene
        packing, unit = scene.packing, scene.energy_scale
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = [
                np.log10(batch.energy_b / (packing.particles * unit)),
                np.log10(pressure_b),
                np.log10(batch.max_force_b * packing.reference_diameter / unit),
            ]
        stress = batch.stress_bdd / scene.pressure_unit
        columns = [
            batch.packing_fraction_b,
            *logs,
            batch.excess_contacts_b / packing.particles,
            *[stress[:, a, b] for a, b in self._components],
        ]
        if self.task.shear_modulus:
            modulus = self.observation_bk[:, len(columns)].copy()
            for b in index:
                modulus[b] = self._shear_modulus(int(b), pressure_b)
            columns.append(modulus)
        if self.task.bracket:
            columns.append(self._decades_open())
        observation = np.stack(columns, axis=1)
        if self._turned.names:
            turned = np.zeros((len(self), len(self._turned.names)))
            for b in index:
                turned[b] = self._turned.row(batch.packing(int(b)))
            observation = np.hstack([observation, turned])
        # the logarithm of zero, or of a negative number, is the lower bound
        observation = np.where(np.isnan(observation), self._low_k, np.clip(observation, self._low_k, self._high_k))
        self.observation_bk[index] = observation[index]

    def _shear_modulus(self, b: int, pressure_b: NDArray[np.float64]) -> float:
        """Return the relaxed shear modulus [energy_scale / reference_diameter^d]; 0 where nothing is rigid."""
        batch, scene = self.batch, self._scene
        rigid = not scene.packing.plain or batch.excess_contacts_b[b] >= 0
        if not (pressure_b[b] > 0.0 and batch.relaxed_b[b] and rigid):
            return 0.0
        moduli = pm.elastic_moduli(scene.replace(packing=batch.packing(b)))
        return float(moduli.shear_modulus / scene.pressure_unit)

    def infos(self) -> Infos:
        """Return the infos by name, B rows each, in the scene's units."""
        batch = self.batch
        values = (
            batch.packing_fraction_b, batch.energy_b, batch.pressure_b, batch.strain_b, batch.force_evaluations_b,
            batch.relaxed_b, self.terminated_b, *self._terms.values(),
        )  # fmt: skip
        return dict(zip(INFOS, values, strict=True))

    def scene(self, index: int) -> pm.Scene:
        """Return the scene, with the effects that are minimized; all packings share it."""
        return self._scene

    def packing(self, index: int) -> pm.Packing:
        """Return one packing as it is now."""
        return self.batch.packing(index)
