"""What Quench-v0 and its batched twin share: starts, actions, observations, verdicts and rewards of B packings.

A single environment is a batch of one: all numbers are those of arrays of B rows, so that both agree to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.quench_reward import TERMS, QuenchReward
from packmech_envs.scenes import quenchable, scene_of

__all__ = ["INFOS", "QuenchCore", "default_scene"]

INFOS = (
    "packing_fraction", "energy", "pressure", "shear_strain", "force_evaluations", "relaxed", "jammed", *TERMS,
)  # fmt: skip

# pressures that rounding alone can make [energy_scale / reference_diameter^d]
_NOTHING = 1e-12
# logarithms of observations stop here, above, and below at so many decades less than those of a jammed packing
_MOST, _LESS, _FORCE = 4.0, 2.0, -16.0
_STRESS, _EXCESS = 1e4, 50.0
# packing fractions between which starts are drawn: well below jamming; clusters stay clear of each other there
_STARTS = {(2, False): (0.7, 0.8), (3, False): (0.5, 0.6), (2, True): (0.4, 0.5), (3, True): (0.3, 0.4)}


def default_scene() -> pm.Scene:
    """Return 32 bidisperse harmonic discs: small enough that an agent learns in minutes."""
    packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=0)
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))


class QuenchCore:
    """B episodes of Quench-v0; the arguments are those of the environment."""

    def __init__(
        self,
        count: int,
        *,
        scene: Any,
        bonds: str,
        relax: str | int,
        force_tolerance: float,
        force_floor: float,
        method: Any,
        start: str,
        start_packing_fraction: Any,
        packing_fraction_limits: Any,
        largest_change: float,
        smallest_change: float | None,
        largest_strain: float,
        largest_pressure: float | None,
        verdict: str,
        shear_modulus: bool,
        step_budget: int | None,
        evaluation_budget: int | None,
        reward: QuenchReward | None,
        threads: int,
    ) -> None:
        self.scene = quenchable(default_scene() if scene is None else scene_of(scene), bonds=bonds)
        packing = self.scene.packing
        self.reward = (QuenchReward() if reward is None else _record("reward", reward)).checked()
        self.largest_pressure = (
            0.1 / packing.particles**2 if largest_pressure is None else _positive("largest_pressure", largest_pressure)
        )
        self.largest_change = _positive("largest_change", largest_change)
        self.smallest_change = (
            min(0.1 * self.largest_pressure, largest_change)
            if smallest_change is None
            else _positive("smallest_change", smallest_change)
        )
        self.largest_strain = _positive("largest_strain", largest_strain)
        if self.largest_change > 0.2 or self.largest_strain > 1.0:
            raise ValueError(
                "largest_change must be at most 0.2 and largest_strain at most 1, "
                f"got {self.largest_change:g} and {self.largest_strain:g}"
            )
        _one_of("verdict", verdict, ("collective", "strict"))
        self.verdict = verdict
        if not isinstance(shear_modulus, bool):
            raise TypeError(f"shear_modulus must be True or False, got {shear_modulus!r:.60}")
        self.step_budget = _budget("step_budget", step_budget)
        self.evaluation_budget = _budget("evaluation_budget", evaluation_budget)
        _one_of("start", start, ("random", "scene"))
        self.start_choice = start
        self.start_range = self._starts(start_packing_fraction)
        self.batch = pm.QuenchBatch(
            self.scene, count, relax=relax, force_tolerance=force_tolerance, force_floor=force_floor, method=method,
            packing_fraction_limits=packing_fraction_limits, threads=threads,
        )  # fmt: skip
        low, high = self.batch.packing_fraction_limits
        if not low <= self.start_range[0] <= self.start_range[1] <= high:
            raise ValueError(
                f"start_packing_fraction must lie inside the limits ({low:g}, {high:g}), got {self.start_range}"
            )
        d = packing.dimension
        self.components = [(a, a) for a in range(d)] + ([(0, 1)] if d == 2 else [(1, 2), (0, 2), (0, 1)])
        stresses = ["stress_" + "xyz"[a] + "xyz"[b] for a, b in self.components]
        names = ["packing_fraction", "log_energy", "log_pressure", "log_max_force", "excess_contacts", *stresses]
        least = math.log10(self.largest_pressure) - _LESS
        bounds = [(low, high), (2.0 * least, _MOST), (least, _MOST), (_FORCE, _MOST), (-float(d), _EXCESS)]
        bounds += [(-_STRESS, _STRESS)] * len(stresses)
        self.shear_modulus = shear_modulus
        if shear_modulus:
            names.append("shear_modulus")
            bounds.append((-_STRESS, _STRESS))
        self.observation_names = tuple(names)
        self.action_names = ("packing_fraction_change", "shear_strain")
        self._low_k, self._high_k = np.array(bounds).T.copy()
        self.observation_space = gym.spaces.Box(self._low_k, self._high_k, dtype=np.float64)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float64)
        self.observation_bk = np.zeros((count, len(names)))
        self.reward_b = np.zeros(count)
        self.jammed_b = np.zeros(count, dtype=bool)
        self.truncated_b = np.zeros(count, dtype=bool)
        self.steps_b = np.zeros(count, dtype=np.int64)
        self.evaluations_b = np.zeros(count, dtype=np.int64)
        self._terms = dict.fromkeys(TERMS, np.zeros(count))

    def _starts(self, given: Any) -> tuple[float, float]:
        packing = self.scene.packing
        if given is None:
            if self.start_choice == "scene":
                own = float(pm.packing_fraction(packing))
                return own, own
            return _STARTS[packing.dimension, packing.links is not None]
        if isinstance(given, tuple | list):
            if len(given) != 2:
                raise ValueError(f"start_packing_fraction must be a number or a pair of numbers, got {given!r:.60}")
            low, high = (_positive("start_packing_fraction", one) for one in given)
            if low > high:
                raise ValueError(f"start_packing_fraction must be a pair that rises, got {given!r:.60}")
            return low, high
        one = _positive("start_packing_fraction", given)
        return one, one

    # actions

    def _amount(self, action_b: NDArray[np.float64], largest: float) -> NDArray[np.float64]:
        """Return what numbers between -1 and 1 stand for: sign(a) s (exp(|a| L) - 1), L = log(1 + c / s)."""
        folds = math.log1p(largest / self.smallest_change)
        return np.asarray(np.sign(action_b) * self.smallest_change * np.expm1(np.abs(action_b) * folds))

    def action_of(self, packing_fraction_change: Any, shear_strain: Any = 0.0) -> NDArray[np.float64]:
        """Return the action that asks for a change of the packing fraction and a shear strain."""
        asked = (
            ("packing_fraction_change", packing_fraction_change, self.largest_change),
            ("shear_strain", shear_strain, self.largest_strain),
        )
        action = np.empty(2)
        for k, (name, value, largest) in enumerate(asked):
            number = _real(name, value)
            if abs(number) > largest * (1.0 + 1e-12):
                raise ValueError(f"{name} must be within {largest:g}, got {number:g}")
            size = math.log1p(abs(number) / self.smallest_change) / math.log1p(largest / self.smallest_change)
            action[k] = math.copysign(min(size, 1.0), number)
        return action

    # episodes

    def start(self, index_k: Sequence[int], rngs: Sequence[np.random.Generator], options: Any) -> None:
        """Start episodes anew, each with its own generator; nothing of what was before is left."""
        if not isinstance(options, dict | None):
            raise TypeError(f"options must be None or a dictionary, got {options!r:.60}")
        if options:
            raise ValueError(f"options must be empty, got {sorted(options)}")
        for b, rng in zip(index_k, rngs, strict=True):
            self.batch.restart(int(b), self._drawn(rng), relax=self.batch.relax == "full")
        index = np.asarray(index_k, dtype=np.int64)
        pressure = self._pressure()
        self._observe(index, pressure)
        self.steps_b[index] = 0
        self.evaluations_b[index] = self.batch.force_evaluations_b[index]
        self.truncated_b[index] = False
        self._judge(index, pressure)
        self._terms = {name: np.where(np.isin(np.arange(len(term)), index), 0.0, term)
                       for name, term in self._terms.items()}  # fmt: skip

    def _drawn(self, rng: np.random.Generator) -> pm.Packing:
        low, high = self.start_range
        fraction = low if low == high else float(rng.uniform(low, high))
        packing = self.scene.packing
        if self.start_choice == "random":
            return pm.scattered_packing(packing, packing_fraction=fraction, rng=rng)
        now = float(pm.packing_fraction(packing))
        if fraction == now:
            return packing
        if packing.links is not None:
            raise ValueError("start_packing_fraction must be left out for start='scene' and a scene with links")
        factor = (now / fraction) ** (1.0 / packing.dimension)
        return packing.replace(position_nd=packing.position_nd * factor, box=packing.box.scaled(factor))

    def advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> None:
        """Strain, relax, look and judge; actions lie inside their bounds."""
        batch = self.batch
        change = self._amount(action_bk[:, 0], self.largest_change)
        strain = self._amount(action_bk[:, 1], self.largest_strain)
        batch.step(change, strain, active_b=active_b)
        index = np.flatnonzero(active_b)
        pressure = self._pressure()
        self._observe(index, pressure)
        self._judge(index, pressure)
        distance = self.reward.distance(pressure, self.largest_pressure)
        self._terms = self.reward.terms(distance, batch.force_evaluations_b, self.jammed_b)
        self.reward_b = np.sum(list(self._terms.values()), axis=0)
        self.steps_b[index] += 1
        self.evaluations_b[index] += batch.force_evaluations_b[index]
        self.truncated_b[index] = self._spent()[index]

    def _spent(self) -> NDArray[np.bool_]:
        spent = np.zeros(self.batch.batch, dtype=bool)
        if self.step_budget is not None:
            spent |= self.steps_b >= self.step_budget
        if self.evaluation_budget is not None:
            spent |= self.evaluations_b >= self.evaluation_budget
        return spent

    def _pressure(self) -> NDArray[np.float64]:
        """Return pressures [energy_scale / reference_diameter^d]; what rounding alone can press is none."""
        pressure = self.batch.pressure_b / self.scene.pressure_unit
        return np.where(np.abs(pressure) > _NOTHING, pressure, 0.0)

    def _judge(self, index: NDArray[np.int64], pressure_b: NDArray[np.float64]) -> None:
        """Set which of these packings are jammed: by cheap figures first, then by the verdict."""
        batch = self.batch
        maybe = (pressure_b > 0.0) & (pressure_b <= self.largest_pressure) & batch.relaxed_b
        if self.scene.packing.links is None:
            maybe &= batch.excess_contacts_b >= 0
        self.jammed_b[index] = False
        for b in index[maybe[index]]:
            # the scene tells the law: at rest under one law is not at rest under another
            answer = pm.classify_jamming(self.scene.replace(packing=batch.packing(int(b))))
            self.jammed_b[b] = (answer.collective if self.verdict == "collective" else answer.strict) == "jammed"

    def _observe(self, index: NDArray[np.int64], pressure_b: NDArray[np.float64]) -> None:
        batch, scene = self.batch, self.scene
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
            *[stress[:, a, b] for a, b in self.components],
        ]
        if self.shear_modulus:
            stiffness = self.observation_bk[:, -1].copy()
            for b in index:
                stiffness[b] = self._stiffness(int(b), pressure_b)
            columns.append(stiffness)
        seen = np.stack(columns, axis=1)
        # the logarithm of nothing, or of less, is the lowest that is told
        seen = np.where(np.isnan(seen), self._low_k, np.clip(seen, self._low_k, self._high_k))
        self.observation_bk[index] = seen[index]

    def _stiffness(self, b: int, pressure_b: NDArray[np.float64]) -> float:
        """Return the relaxed shear modulus [energy_scale / reference_diameter^d]; 0 where nothing is held at rest."""
        batch, scene = self.batch, self.scene
        held = scene.packing.links is not None or batch.excess_contacts_b[b] >= 0
        if not (pressure_b[b] > 0.0 and batch.relaxed_b[b] and held):
            return 0.0
        moduli = pm.elastic_moduli(scene.replace(packing=batch.packing(b)))
        return float(moduli.shear_modulus / scene.pressure_unit)

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return what there is to tell, B rows each, in the scene's units."""
        batch = self.batch
        values = (
            batch.packing_fraction_b, batch.energy_b, batch.pressure_b, batch.strain_b, batch.force_evaluations_b,
            batch.relaxed_b, self.jammed_b.copy(), *[term.copy() for term in self._terms.values()],
        )  # fmt: skip
        return dict(zip(INFOS, values, strict=True))


def _record(name: str, value: Any) -> QuenchReward:
    if not isinstance(value, QuenchReward):
        raise TypeError(f"{name} must be a QuenchReward, got {value!r:.60}")
    return value


def _one_of(name: str, value: Any, allowed: tuple[str, ...]) -> None:
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r:.60}")


def _real(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be a number, got {value!r:.60}")
    if not np.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    return float(value)


def _positive(name: str, value: Any) -> float:
    number = _real(name, value)
    if number <= 0.0:
        raise ValueError(f"{name} must be a positive number, got {value!r}")
    return number


def _budget(name: str, value: Any) -> int | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise ValueError(f"{name} must be None or an integer at least 1, got {value!r:.60}")
    return int(value)
