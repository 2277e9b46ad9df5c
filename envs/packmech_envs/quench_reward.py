"""What a step of Quench-v0 is worth: three terms with weights, each told by its name."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["TERMS", "QuenchReward"]

TERMS = ("reward_distance", "reward_evaluations", "reward_stability")

# decades that a packing whose pressure is zero is away from the target: nothing tells how far it really is
UNJAMMED = 4.0
# force evaluations that cost one weight
_EVALUATIONS = 1000.0


class QuenchReward(NamedTuple):
    """Weights of the terms of the reward of Quench-v0; the reward is their sum.

    Parameters
    ----------
    distance_weight
        On the decades from jamming after the step, which count against: those of the pressure above the largest that
        counts as jammed, 4 where nothing presses. They count step by step, so that it is worth to get there soon.
    evaluation_weight
        On every thousand force evaluations spent, which count against.
    stability_weight
        On a result that was verified to be jammed, which ends the episode.

    Examples
    --------
    >>> QuenchReward(stability_weight=10.0).distance(np.array([0.0, 1e-3, 1e-5]), 1e-4).round(12).tolist()
    [4.0, 1.0, 0.0]

    """

    distance_weight: float = 0.25
    evaluation_weight: float = 0.1
    stability_weight: float = 5.0

    def checked(self) -> QuenchReward:
        """Return the weights as floats.

        Raises
        ------
        TypeError, ValueError
            Naming a weight that is no finite number.

        """
        return QuenchReward(*[_number(name, value) for name, value in zip(self._fields, self, strict=True)])

    @staticmethod
    def distance(pressure_b: NDArray[np.float64], largest_pressure: float) -> NDArray[np.float64]:
        """Return the decades from jamming, by pressures and the largest pressure that counts as jammed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            decades = np.maximum(np.log10(pressure_b / largest_pressure), 0.0)
        return np.where(pressure_b > 0.0, decades, UNJAMMED)

    def terms(
        self,
        distance_b: NDArray[np.float64],
        evaluations_b: NDArray[np.int64],
        jammed_b: NDArray[np.bool_],
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

        """
        values = (
            self.distance_weight * -distance_b,
            self.evaluation_weight * -(evaluations_b / _EVALUATIONS),
            self.stability_weight * jammed_b.astype(np.float64),
        )
        return dict(zip(TERMS, values, strict=True))


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"reward.{name} must be a number, got {value!r:.60}")
    if not np.isfinite(value):
        raise ValueError(f"reward.{name} must be a finite number, got {value!r}")
    return float(value)
