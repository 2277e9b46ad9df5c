"""Checks of actions: those that no space holds get one clear error, wherever they come from."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

# what a bound may be missed by: an action at a bound that went through float32, as learners' do
_ROUNDING = float(np.finfo(np.float32).eps)


class Actions:
    """The actions that a box of float64 numbers holds; every check is a few comparisons.

    Parameters
    ----------
    space
        The space of a single action: a row of numbers between finite bounds.

    """

    def __init__(self, space: Box) -> None:
        self.shape = space.shape
        self.low_k, self.high_k = space.low.astype(np.float64), space.high.astype(np.float64)
        slack = _ROUNDING * np.maximum(np.abs(self.low_k), np.abs(self.high_k))
        self._least_k, self._most_k = self.low_k - slack, self.high_k + slack
        bounds = (self.low_k, self.high_k, self._least_k, self._most_k)
        self._bounds = list(zip(*(one.tolist() for one in bounds), strict=True))

    def one(self, action: Any) -> NDArray[np.float64]:
        """Return a single action as a (1, K) float64 array inside the bounds; a view of it where it needs no change.

        Raises
        ------
        TypeError, ValueError
            Not numbers, another shape, not finite, or out of the bounds by more than the rounding to float32.

        """
        given = action
        if type(given) is not np.ndarray or given.dtype != np.float64:
            given = _numbers(action)
        if given.shape != self.shape:
            raise ValueError(f"action must have shape {self.shape}, got {given.shape}")
        exact = True
        for k, value in enumerate(given.tolist()):
            low, high, least, most = self._bounds[k]
            if not low <= value <= high:
                if not least <= value <= most:
                    raise ValueError(self._told(k, value, ""))
                exact = False
        # functions of numpy cost microseconds
        held: NDArray[np.float64] = given if exact else np.clip(given, self.low_k, self.high_k)
        return held.reshape(1, -1)

    def many(self, actions: Any, active_b: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (B, K) actions inside the bounds, as a float64 array; rows that are not active are not looked at.

        Raises
        ------
        TypeError, ValueError
            As for a single one, naming the environment.

        """
        given = _numbers(actions)
        shape = (len(active_b), *self.shape)
        if given.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {given.shape}")
        inside = (given >= self._least_k) & (given <= self._most_k)
        if not inside.all() and (~inside[active_b]).any():
            b, k = np.argwhere(~inside & active_b[:, None])[0].tolist()
            raise ValueError(self._told(k, float(given[b, k]), f" for environment {b}"))
        held = np.minimum(np.maximum(given, self.low_k), self.high_k)
        return np.asarray(np.where(active_b[:, None], held, 0.0))

    def _told(self, k: int, value: float, where: str) -> str:
        return f"action[{k}] must lie between {self.low_k[k]:g} and {self.high_k[k]:g}, got {value!r}{where}"


def _numbers(action: Any) -> NDArray[np.float64]:
    try:
        given = np.asarray(action)
        if given.dtype.kind not in "iuf":
            raise TypeError
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"action must be an array of real numbers, got {action!r:.60}") from None
