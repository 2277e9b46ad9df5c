# mypy: disable-error-code="untyped-decorator, no-untyped-def, misc"
"""Tasks under shear, by name: follow a stress, dissipate least, find the yield strain; rewards as named terms.

One compiled call judges a frame of all packings of a batch; a single environment is a batch of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

# what ended an episode
REASONS = (None, "step_too_long", "strain_reached", "yielded")
GOING, FAILED, REACHED, YIELDED = range(4)
# places of the figures that tasks look at, in `where`
SHEAR, KINETIC, ELASTIC, WORK, PLACES = range(5)
TIME, STRAIN, RATE = range(3)
# numbers that a task keeps of each packing
ELAPSED, TARGET, LEVEL, PHASE, PEAK, PEAK_STRAIN, SPENT, MEMORY = range(8)
# kinds of tasks
FOLLOW, SPARE, YIELD = range(3)
# leading numbers of every task: weight of a failure, frames of an episode (0: no limit), a scale of the rate [1/time]
WEIGHT_FAILURE, BUDGET, RATE_SCALE, OWN = range(4)


@dataclass(frozen=True, kw_only=True)
class FollowStress:
    """Keep the shear stress at a target: constant, or a sine.

    Observed beside the rest: "target_stress", the one for the end of the coming frame [energy/length^d]. Told in infos:
    "stress_error", the stress less the target for the end of this frame.

    Parameters
    ----------
    amplitude
        Largest target, in units of the scene's energy_scale / reference_diameter^d [1].
    period
        Frames of a period of the sine; None: a constant target.
    random
        Whether each episode draws its level between -amplitude and amplitude (with a period: its phase) from the
        environment's generator; otherwise the level is the amplitude, and the phase 0.
    weight_stress
        Of "reward_stress" = -|stress - target| / amplitude.
    weight_effort
        Of "reward_effort" = -(rate / largest rate)^2.
    weight_failure
        Of "reward_failure" = -1 where the packing moved too fast for the time step.

    """

    amplitude: float = 0.01
    period: float | None = None
    random: bool = True
    weight_stress: float = 1.0
    weight_effort: float = 0.0
    weight_failure: float = 10.0

    kind: ClassVar[int] = FOLLOW
    terms: ClassVar[tuple[str, ...]] = ("reward_stress", "reward_effort", "reward_failure")
    told: ClassVar[tuple[str, ...]] = ("stress_error",)
    seen: ClassVar[tuple[str, ...]] = ("target_stress",)

    def __post_init__(self) -> None:
        _check(self, positive=("amplitude", "period"))

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return what the compiled judge is told of the task."""
        return [self.amplitude * pressure_unit, self.period or 0.0, self.weight_stress, self.weight_effort]

    def draw(self, rng: np.random.Generator, memory_k: NDArray[np.float64], pressure_unit: float) -> None:
        """Set what an episode draws."""
        memory_k[LEVEL] = self.amplitude * pressure_unit
        if self.random and self.period is None:
            memory_k[LEVEL] *= rng.uniform(-1.0, 1.0)
        elif self.random:
            memory_k[PHASE] = rng.uniform(0.0, 2.0 * math.pi)


@dataclass(frozen=True, kw_only=True)
class DissipateLeast:
    """Bring the strain to a goal and lose as little energy on the way as possible.

    What is dissipated is the work done by the shear less what elastic and kinetic energies gained, by the trapezoidal
    rule over frames. Its error, of either sign, goes as the square of frame_skip: for the scene "default" it is 0.7 %
    of the stored energy in frames of 0.01 strain and 0.04 % in frames of 0.0025, so little of it wants short frames.
    An episode is over when the goal is reached. Observed beside the rest: "strain_to_go" [1] and
    "dissipated_energy" so far [energy]; the latter is told in infos, too.

    Parameters
    ----------
    goal
        The strain [1].
    tolerance
        How near to it is near enough [1].
    weight_progress
        Of "reward_progress" = what the distance to the goal has become smaller, in units of the goal: 1 in all.
    weight_dissipation
        Of "reward_dissipation" = -dissipated energy / (energy_scale / reference_diameter^d volume goal^2).
    weight_time
        Of "reward_time" = -1 every frame.
    weight_failure
        As for `FollowStress`.

    """

    goal: float = 0.1
    tolerance: float = 1e-3
    weight_progress: float = 1.0
    weight_dissipation: float = 1.0
    weight_time: float = 0.0
    weight_failure: float = 10.0

    kind: ClassVar[int] = SPARE
    terms: ClassVar[tuple[str, ...]] = ("reward_progress", "reward_dissipation", "reward_time", "reward_failure")
    told: ClassVar[tuple[str, ...]] = ("dissipated_energy",)
    seen: ClassVar[tuple[str, ...]] = ("strain_to_go", "dissipated_energy")

    def __post_init__(self) -> None:
        _check(self, positive=("tolerance",))
        if self.goal == 0.0:
            raise ValueError("goal must not be zero, got 0.0")

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return what the compiled judge is told of the task."""
        energy = pressure_unit * volume * self.goal**2
        weights = [self.weight_progress, self.weight_dissipation, self.weight_time]
        return [self.goal, self.tolerance, energy, *weights]

    def draw(self, rng: np.random.Generator, memory_k: NDArray[np.float64], pressure_unit: float) -> None:
        """Draw nothing: the goal is the same in every episode."""


@dataclass(frozen=True, kw_only=True)
class FindYieldStrain:
    """Shear until the packing yields, and know the strain at which it did.

    It has yielded when the shear stress has fallen by a part of its peak while the strain went on; the yield strain is
    that of the peak. An episode is over then. Observed beside the rest, and told in infos: "yield_stress", the peak so
    far [energy/length^d], and "yield_strain", the strain there [1]; zeros until the strain has come to least_strain.

    Parameters
    ----------
    drop
        The part of the peak by which the stress falls [1].
    least_strain
        Peaks at smaller strains do not count [1].
    resolution
        Of the yield strain: how far beyond the peak halves the reward for finding it [1].
    weight_rise
        Of "reward_rise" = what the peak has grown, in units of energy_scale / reference_diameter^d.
    weight_found
        Of "reward_found" = 1 / (1 + (strain - yield strain) / resolution) when it has yielded.
    weight_time
        Of "reward_time" = -1 every frame.
    weight_failure
        As for `FollowStress`.

    """

    drop: float = 0.1
    least_strain: float = 0.01
    resolution: float = 0.01
    weight_rise: float = 10.0
    weight_found: float = 10.0
    weight_time: float = 0.01
    weight_failure: float = 10.0

    kind: ClassVar[int] = YIELD
    terms: ClassVar[tuple[str, ...]] = ("reward_rise", "reward_found", "reward_time", "reward_failure")
    told: ClassVar[tuple[str, ...]] = ("yield_strain", "yield_stress")
    seen: ClassVar[tuple[str, ...]] = ("yield_strain", "yield_stress")

    def __post_init__(self) -> None:
        _check(self, positive=("drop", "least_strain", "resolution"))
        if self.drop >= 1.0:
            raise ValueError(f"drop must be below 1, got {self.drop}")

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return what the compiled judge is told of the task."""
        weights = [self.weight_rise, self.weight_found, self.weight_time]
        return [self.drop, self.least_strain, self.resolution, pressure_unit, *weights]

    def draw(self, rng: np.random.Generator, memory_k: NDArray[np.float64], pressure_unit: float) -> None:
        """Draw nothing."""


Task = FollowStress | DissipateLeast | FindYieldStrain
TASKS: dict[str, Any] = {
    "follow_stress": FollowStress,
    "dissipate_least": DissipateLeast,
    "find_yield_strain": FindYieldStrain,
}


def task_of(task: Any) -> Task:
    """Return the task that was named, or given with its own numbers.

    Raises
    ------
    ValueError
        If there is no such task.

    Examples
    --------
    >>> task_of("dissipate_least").goal
    0.1

    """
    if isinstance(task, Task):
        return task
    if not isinstance(task, str) or task not in TASKS:
        names = ", ".join(map(repr, TASKS))
        raise ValueError(f"task must be one of {names} or a record such as FollowStress(...), got {task!r:.60}")
    return TASKS[task]()  # type: ignore[no-any-return]


def _check(task: Any, positive: tuple[str, ...]) -> None:
    for field in fields(task):
        value = getattr(task, field.name)
        if field.name == "random":
            if not isinstance(value, bool):
                raise TypeError(f"random must be True or False, got {value!r}")
            continue
        if value is None and field.name == "period":
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError(f"{field.name} must be a finite number, got {value!r:.60}")
        if not math.isfinite(value):
            raise ValueError(f"{field.name} must be a finite number, got {value!r}")
        if field.name in positive and value <= 0.0:
            raise ValueError(f"{field.name} must be positive, got {value!r}")


# self-contained, so numba's own cache on disk sees every change
@njit(cache=True, nogil=True, error_model="numpy")
def _follow(p, shear, rate, memory, terms, told, seen):
    amplitude, period, weight_stress, weight_effort = p[OWN], p[OWN + 1], p[OWN + 2], p[OWN + 3]
    error = shear - memory[TARGET]
    effort = rate / p[RATE_SCALE]
    terms[0] = -weight_stress * abs(error) / amplitude
    terms[1] = -weight_effort * effort * effort
    told[0] = error
    level = memory[LEVEL]
    if period > 0.0:
        level *= math.sin(2.0 * math.pi * (memory[ELAPSED] + 1.0) / period + memory[PHASE])
    memory[TARGET] = level
    seen[0] = level
    return GOING


@njit(cache=True, nogil=True, error_model="numpy")
def _spare(p, strain, last_strain, lost, memory, terms, told, seen):
    goal, tolerance, energy = p[OWN], p[OWN + 1], p[OWN + 2]
    memory[SPENT] += lost
    terms[0] = p[OWN + 3] * (abs(goal - last_strain) - abs(goal - strain)) / abs(goal)
    terms[1] = -p[OWN + 4] * lost / energy
    terms[2] = -p[OWN + 5]
    told[0] = memory[SPENT]
    seen[0] = goal - strain
    seen[1] = memory[SPENT]
    return REACHED if abs(goal - strain) <= tolerance else GOING


@njit(cache=True, nogil=True, error_model="numpy")
def _yield(p, shear, strain, memory, terms, told, seen):
    drop, least, resolution, unit = p[OWN], p[OWN + 1], p[OWN + 2], p[OWN + 3]
    rise = 0.0
    found = 0.0
    reason = GOING
    if strain >= least and shear > memory[PEAK]:
        rise = shear - memory[PEAK]
        memory[PEAK] = shear
        memory[PEAK_STRAIN] = strain
    elif memory[PEAK] > 0.0 and strain > memory[PEAK_STRAIN] and shear <= (1.0 - drop) * memory[PEAK]:
        reason = YIELDED
        found = 1.0 / (1.0 + (strain - memory[PEAK_STRAIN]) / resolution)
    terms[0] = p[OWN + 4] * rise / unit
    terms[1] = p[OWN + 5] * found
    terms[2] = -p[OWN + 6]
    told[0] = seen[0] = memory[PEAK_STRAIN]
    told[1] = seen[1] = memory[PEAK]
    return reason


@njit(cache=True, nogil=True, error_model="numpy")
def judge(
    starting,
    active_b,
    good_b,
    kind,
    p,
    where,
    pick_k,
    scale_k,
    figure,
    before,
    memory,
    observed,
    info,
    reward_b,
    reason_b,
):
    """Judge the frame that active packings took; where `starting`, only set what is seen at the start of an episode.

    Writes observations (picked figures, then the task's, scaled), infos (time, elastic energy, work, terms of the
    reward, and what the task tells), rewards, and why an episode is over, if it is.
    """
    count = pick_k.shape[0]
    seen = np.zeros(observed.shape[1] - count)
    size = 4 if kind != FOLLOW else 3
    for b in range(active_b.shape[0]):
        if not active_b[b]:
            continue
        now, last, kept = figure[b], before[b], memory[b]
        terms, told = info[b, 3 : 3 + size], info[b, 3 + size :]
        terms[:] = 0.0
        told[:] = 0.0
        if starting:
            last[:] = now
        else:
            kept[ELAPSED] += 1.0
        if kind == FOLLOW:
            reason = _follow(p, now[where[SHEAR]], now[RATE], kept, terms, told, seen)
        elif kind == SPARE:
            stored = now[where[KINETIC]] + now[where[ELASTIC]] - last[where[KINETIC]] - last[where[ELASTIC]]
            lost = now[where[WORK]] - last[where[WORK]] - stored
            reason = _spare(p, now[STRAIN], last[STRAIN], lost, kept, terms, told, seen)
        else:
            reason = _yield(p, now[where[SHEAR]], now[STRAIN], kept, terms, told, seen)
        if not good_b[b]:
            reason = FAILED
            terms[size - 1] = -p[WEIGHT_FAILURE]
        if starting:
            reason = GOING
            terms[:] = 0.0
            told[:] = 0.0
        total = 0.0
        for k in range(size):
            total += terms[k]
        reward_b[b] = total
        reason_b[b] = reason
        info[b, 0], info[b, 1], info[b, 2] = now[TIME], now[where[ELASTIC]], now[where[WORK]]
        for k in range(count):
            observed[b, k] = now[pick_k[k]] * scale_k[k]
        for k in range(seen.shape[0]):
            observed[b, count + k] = seen[k] * scale_k[count + k]
        last[:] = now
