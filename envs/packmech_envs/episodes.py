"""What single and batched environments step: episodes of many packings in arrays, and the actions that they take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.words import brief

Infos = dict[str, NDArray[Any]]

# by how much an action may miss a bound: one at a bound that went through float32, as learners' do
_ROUNDING = float(np.finfo(np.float32).eps)


def reset_options(options: Any, allowed: tuple[str, ...]) -> dict[str, Any]:
    """Return the options of a reset after checking that they hold nothing but these.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.

    """
    if not isinstance(options, dict | None):
        raise TypeError(f"options must be None or a dictionary, got {brief(options)}")
    given: dict[str, Any] = options or {}
    if set(given) - set(allowed):
        names = f"hold nothing but {', '.join(map(repr, allowed))}" if allowed else "be empty"
        raise ValueError(f"options must {names}, got {brief(list(given))}")
    return given


class Episodes(Protocol):
    """Episodes of B packings, stepped together; a single environment steps one.

    Attributes
    ----------
    observation_space, action_space
        Those of one packing: float64, or an action of whole numbers; the names say what their numbers are.
    task
        The options, a record.
    observation_bk
        (B, K) observations after the last start or step.

    """

    observation_space: Box[np.float64]
    observation_names: tuple[str, ...]
    action_names: tuple[str, ...]
    task: Any
    observation_bk: NDArray[np.float64]

    @property
    def action_space(self) -> Box[np.float64] | MultiDiscrete[Any]:
        """The space of one packing's actions."""

    @property
    def reward_b(self) -> NDArray[np.float64]:
        """The (B,) rewards of the last step."""

    @property
    def terminated_b(self) -> NDArray[np.bool_]:
        """Whether the last step ended the task of each packing."""

    @property
    def truncated_b(self) -> NDArray[np.bool_]:
        """Whether the budget of each episode is spent."""

    def __len__(self) -> int:
        """Return B."""

    def start(self, index_k: Sequence[int], rngs: Sequence[np.random.Generator], options: Any) -> None:
        """Start new episodes of these packings, each with its own generator; nothing of the old ones is left."""

    def advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> None:
        """Take a step with the active packings; their actions lie inside the space."""

    def infos(self) -> Infos:
        """Return infos by name, B rows each; None in an array of objects: this packing has no such info."""

    def scene(self, index: int) -> pm.Scene:
        """Return the scene of one packing."""

    def packing(self, index: int) -> pm.Packing:
        """Return one packing as it is now."""


class Actions:
    """The actions in a box of float64 numbers, or of whole numbers; every check is a few comparisons.

    Parameters
    ----------
    space
        The space of a single action: a row of numbers between finite bounds, or a row of choices.

    """

    def __init__(self, space: Box[Any] | MultiDiscrete[Any]) -> None:
        self.shape = space.shape
        self.whole = isinstance(space, MultiDiscrete)
        if isinstance(space, MultiDiscrete):
            low, high = space.start, space.start + space.nvec - 1
        else:
            low, high = space.low, space.high
        self.low_k, self.high_k = low.astype(np.float64), high.astype(np.float64)
        slack = _ROUNDING * np.maximum(np.abs(self.low_k), np.abs(self.high_k))
        self._lowest_k, self._highest_k = self.low_k - slack, self.high_k + slack
        bounds = (self.low_k, self.high_k, self._lowest_k, self._highest_k)
        self._bounds = list(zip(*(one.tolist() for one in bounds), strict=True))

    def one(self, action: Any) -> NDArray[np.float64]:
        """Return a single action as a (1, K) float64 array inside the bounds; a view of it where it needs no change.

        Raises
        ------
        TypeError, ValueError
            Not numbers, another shape, not finite, out of the bounds by more than the rounding to float32, or not whole
            where choices are asked for.

        """
        given = action
        if type(given) is not np.ndarray or given.dtype != np.float64:
            given = _numbers(action)
        if given.shape != self.shape:
            raise ValueError(f"action must have shape {self.shape}, got {given.shape}")
        exact = True
        for k, value in enumerate(given.tolist()):
            low, high, lowest, highest = self._bounds[k]
            if not low <= value <= high or (self.whole and not value.is_integer()):
                if self.whole or not lowest <= value <= highest:
                    raise ValueError(self._outside(k, value, ""))
                exact = False
        # functions of numpy cost microseconds
        held: NDArray[np.float64] = given if exact else np.clip(given, self.low_k, self.high_k)
        return held.reshape(1, -1)

    def many(self, actions: Any, active_b: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (B, K) actions inside the bounds, as a float64 array; rows that are not active are not checked.

        Raises
        ------
        TypeError, ValueError
            As for a single one, naming the environment.

        """
        given = _numbers(actions)
        shape = (len(active_b), *self.shape)
        if given.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {given.shape}")
        inside = (given >= self._lowest_k) & (given <= self._highest_k)
        if self.whole:
            inside &= given == np.floor(given)
        if not inside.all() and (~inside[active_b]).any():
            b, k = np.argwhere(~inside & active_b[:, None])[0].tolist()
            raise ValueError(self._outside(k, float(given[b, k]), f" for environment {b}"))
        held = np.minimum(np.maximum(given, self.low_k), self.high_k)
        return np.asarray(np.where(active_b[:, None], held, 0.0))

    def _outside(self, k: int, value: float, where: str) -> str:
        what = "be a whole number" if self.whole else "lie"
        return f"action[{k}] must {what} between {self.low_k[k]:g} and {self.high_k[k]:g}, got {value!r}{where}"


def _numbers(action: Any) -> NDArray[np.float64]:
    try:
        given = np.asarray(action)
        if given.dtype.kind not in "iuf":
            raise TypeError
        return np.asarray(given, dtype=np.float64)
    # whatever an object raises that is asked for its entries, it has none that are numbers
    except Exception:
        raise TypeError(f"action must be an array of real numbers, got {brief(action)}") from None
