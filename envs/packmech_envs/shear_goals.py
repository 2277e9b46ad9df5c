# mypy: disable-error-code="untyped-decorator, no-untyped-def, misc"
"""Goals under shear, by name: follow a stress, dissipate least, find the yield strain; rewards as named terms.

One compiled call scores a frame of all packings of a batch; a single environment is a batch of one.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.tasks import boolean, positive, real
from packmech_envs.words import brief

# what ended an episode
REASONS = (None, "step_too_long", "strain_reached", "yielded")
GOING, FAILED, REACHED, YIELDED = range(4)
# places, in the columns of `pm.ShearBatch`, of the figures that goals need: given in `where`, and the first three
SHEAR, KINETIC, ELASTIC, WORK = range(4)
TIME, STRAIN, RATE = range(3)
# numbers that a goal keeps of each packing
ELAPSED, TARGET, LEVEL, PHASE, PEAK, PEAK_STRAIN, DISSIPATED, MEMORY = range(8)
# kinds of goals
FOLLOW, DISSIPATE, YIELD = range(3)
# leading numbers of every goal: weight of a failure, and a scale of the rate [1/time]
WEIGHT_FAILURE, RATE_SCALE, OWN = range(3)


class _EpisodeGoal:
    """What all goals share: fields are checked, and episodes are all alike unless something is drawn."""

    positive_fields: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        given: Any = self
        for field in fields(given):
            value = getattr(self, field.name)
            if field.name == "random":
                boolean("random", value)
            elif field.name not in self.positive_fields:
                real(field.name, value)
            elif value is not None or field.name != "period":
                positive(field.name, value)

    def draw(self, rng: np.random.Generator, memory_k: NDArray[np.float64], pressure_unit: float) -> None:
        """Draw what differs from episode to episode: nothing."""


@dataclass(frozen=True, kw_only=True)
class FollowStress(_EpisodeGoal):
    """Keep the shear stress at a target: constant, or a sine.

    Observed beside the rest: "target_stress", the one for the end of the coming frame [energy/length^d]. In infos:
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
    infos: ClassVar[tuple[str, ...]] = ("stress_error",)
    observed: ClassVar[tuple[str, ...]] = ("target_stress",)
    positive_fields: ClassVar[tuple[str, ...]] = ("amplitude", "period")

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return the numbers of the goal in the compiled scores."""
        return [self.amplitude * pressure_unit, self.period or 0.0, self.weight_stress, self.weight_effort]

    def draw(self, rng: np.random.Generator, memory_k: NDArray[np.float64], pressure_unit: float) -> None:
        """Draw the level or phase of an episode."""
        memory_k[LEVEL] = self.amplitude * pressure_unit
        if self.random and self.period is None:
            memory_k[LEVEL] *= rng.uniform(-1.0, 1.0)
        elif self.random:
            memory_k[PHASE] = rng.uniform(0.0, 2.0 * math.pi)


@dataclass(frozen=True, kw_only=True)
class DissipateLeast(_EpisodeGoal):
    """Bring the strain to a target and dissipate as little energy on the way as possible.

    What is dissipated is the work done by the shear less what elastic and kinetic energies gained, by the trapezoidal
    rule over frames. Its error, of either sign, goes as the square of frame_skip: for the scene "default" it is 0.7 %
    of the stored energy in frames of 0.01 strain and 0.04 % in frames of 0.0025, so little of it wants short frames.
    An episode is over when the target is reached. Observed beside the rest: "strain_to_go" [1] and
    "dissipated_energy" so far [energy]; the latter is in infos, too.

    Parameters
    ----------
    target_strain
        The strain to reach [1].
    tolerance
        Largest distance from it at which it counts as reached [1].
    weight_progress
        Of "reward_progress" = how much closer the strain came to the target, in units of the target: 1 in all.
    weight_dissipation
        Of "reward_dissipation" = -dissipated energy / (energy_scale / reference_diameter^d volume target_strain^2).
    weight_time
        Of "reward_time" = -1 every frame.
    weight_failure
        As for `FollowStress`.

    """

    target_strain: float = 0.1
    tolerance: float = 1e-3
    weight_progress: float = 1.0
    weight_dissipation: float = 1.0
    weight_time: float = 0.0
    weight_failure: float = 10.0

    kind: ClassVar[int] = DISSIPATE
    terms: ClassVar[tuple[str, ...]] = ("reward_progress", "reward_dissipation", "reward_time", "reward_failure")
    infos: ClassVar[tuple[str, ...]] = ("dissipated_energy",)
    observed: ClassVar[tuple[str, ...]] = ("strain_to_go", "dissipated_energy")
    positive_fields: ClassVar[tuple[str, ...]] = ("tolerance",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.target_strain == 0.0:
            raise ValueError("target_strain must not be zero, got 0.0")

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return the numbers of the goal in the compiled scores."""
        energy = pressure_unit * volume * self.target_strain**2
        weights = [self.weight_progress, self.weight_dissipation, self.weight_time]
        return [self.target_strain, self.tolerance, energy, *weights]


@dataclass(frozen=True, kw_only=True)
class FindYieldStrain(_EpisodeGoal):
    """Shear until the packing yields, and find the strain at which it did.

    It has yielded when the shear stress has fallen by a part of its peak while the strain went on; the yield strain is
    that of the peak. An episode is over then. Observed beside the rest, and in infos: "yield_stress", the peak so
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
    infos: ClassVar[tuple[str, ...]] = ("yield_strain", "yield_stress")
    observed: ClassVar[tuple[str, ...]] = ("yield_strain", "yield_stress")
    positive_fields: ClassVar[tuple[str, ...]] = ("drop", "least_strain", "resolution")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.drop >= 1.0:
            raise ValueError(f"drop must be below 1, got {self.drop}")

    def numbers(self, pressure_unit: float, volume: float) -> list[float]:
        """Return the numbers of the goal in the compiled scores."""
        weights = [self.weight_rise, self.weight_found, self.weight_time]
        return [self.drop, self.least_strain, self.resolution, pressure_unit, *weights]


Goal = FollowStress | DissipateLeast | FindYieldStrain
GOALS: dict[str, type[Goal]] = {
    "follow_stress": FollowStress,
    "dissipate_least": DissipateLeast,
    "find_yield_strain": FindYieldStrain,
}


def goal_of(goal: Any) -> Goal:
    """Return the goal that was named, or given with its own numbers.

    Raises
    ------
    ValueError
        If there is no such goal.

    Examples
    --------
    >>> goal_of("dissipate_least").target_strain
    0.1

    """
    if isinstance(goal, Goal):
        return goal
    if not isinstance(goal, str) or goal not in GOALS:
        names = ", ".join(map(repr, GOALS))
        raise ValueError(f"goal must be one of {names} or a record such as FollowStress(...), got {brief(goal)}")
    return GOALS[goal]()


# rewards are the numbers that their formulas give in plain Python
_compiled = functools.partial(pm.kernel, contract=False)


@_compiled
def _follow_stress(p, shear, rate, memory, terms, infos, observed):
    amplitude, period, weight_stress, weight_effort = p[OWN], p[OWN + 1], p[OWN + 2], p[OWN + 3]
    error = shear - memory[TARGET]
    effort = rate / p[RATE_SCALE]
    terms[0] = -weight_stress * abs(error) / amplitude
    terms[1] = -weight_effort * effort * effort
    infos[0] = error
    level = memory[LEVEL]
    if period > 0.0:
        level *= math.sin(2.0 * math.pi * (memory[ELAPSED] + 1.0) / period + memory[PHASE])
    memory[TARGET] = level
    observed[0] = level
    return GOING


@_compiled
def _dissipate_least(p, strain, last_strain, dissipated, memory, terms, infos, observed):
    target, tolerance, energy = p[OWN], p[OWN + 1], p[OWN + 2]
    memory[DISSIPATED] += dissipated
    terms[0] = p[OWN + 3] * (abs(target - last_strain) - abs(target - strain)) / abs(target)
    terms[1] = -p[OWN + 4] * dissipated / energy
    terms[2] = -p[OWN + 5]
    infos[0] = memory[DISSIPATED]
    observed[0] = target - strain
    observed[1] = memory[DISSIPATED]
    return REACHED if abs(target - strain) <= tolerance else GOING


@_compiled
def _find_yield_strain(p, shear, strain, memory, terms, infos, observed):
    drop, least_strain, resolution, unit = p[OWN], p[OWN + 1], p[OWN + 2], p[OWN + 3]
    rise = 0.0
    found = 0.0
    reason = GOING
    if strain >= least_strain and shear > memory[PEAK]:
        rise = shear - memory[PEAK]
        memory[PEAK] = shear
        memory[PEAK_STRAIN] = strain
    elif memory[PEAK] > 0.0 and strain > memory[PEAK_STRAIN] and shear <= (1.0 - drop) * memory[PEAK]:
        reason = YIELDED
        found = 1.0 / (1.0 + (strain - memory[PEAK_STRAIN]) / resolution)
    terms[0] = p[OWN + 4] * rise / unit
    terms[1] = p[OWN + 5] * found
    terms[2] = -p[OWN + 6]
    infos[0] = observed[0] = memory[PEAK_STRAIN]
    infos[1] = observed[1] = memory[PEAK]
    return reason


@_compiled
def score_frames(
    starting,
    active_b,
    good_b,
    kind,
    p,
    where,
    pick_k,
    scale_k,
    figure_bk,
    before_bk,
    memory_bk,
    observation_bk,
    info_bk,
    reward_b,
    reason_b,
):
    """Score the frame that active packings took; where `starting`, set observations and infos of an episode's start.

    Writes observations (picked figures, then the goal's, scaled), infos (time, elastic energy, work, terms of the
    reward, and the goal's own), rewards, and why an episode is over, if it is.
    """
    count = pick_k.shape[0]
    observed = np.zeros(observation_bk.shape[1] - count)
    size = 4 if kind != FOLLOW else 3
    for b in range(active_b.shape[0]):
        if not active_b[b]:
            continue
        now, last, memory = figure_bk[b], before_bk[b], memory_bk[b]
        terms, infos = info_bk[b, 3 : 3 + size], info_bk[b, 3 + size :]
        terms[:] = 0.0
        infos[:] = 0.0
        if starting:
            last[:] = now
        else:
            memory[ELAPSED] += 1.0
        if kind == FOLLOW:
            reason = _follow_stress(p, now[where[SHEAR]], now[RATE], memory, terms, infos, observed)
        elif kind == DISSIPATE:
            stored = now[where[KINETIC]] + now[where[ELASTIC]] - last[where[KINETIC]] - last[where[ELASTIC]]
            dissipated = now[where[WORK]] - last[where[WORK]] - stored
            reason = _dissipate_least(p, now[STRAIN], last[STRAIN], dissipated, memory, terms, infos, observed)
        else:
            reason = _find_yield_strain(p, now[where[SHEAR]], now[STRAIN], memory, terms, infos, observed)
        if not good_b[b]:
            reason = FAILED
            terms[size - 1] = -p[WEIGHT_FAILURE]
        if starting:
            reason = GOING
            terms[:] = 0.0
            infos[:] = 0.0
        total = 0.0
        for k in range(size):
            total += terms[k]
        reward_b[b] = total
        reason_b[b] = reason
        info_bk[b, 0], info_bk[b, 1], info_bk[b, 2] = now[TIME], now[where[ELASTIC]], now[where[WORK]]
        for k in range(count):
            observation_bk[b, k] = now[pick_k[k]] * scale_k[k]
        for k in range(observed.shape[0]):
            observation_bk[b, count + k] = observed[k] * scale_k[count + k]
        last[:] = now
