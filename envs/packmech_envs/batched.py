"""What all natively batched environments share: seeds, autoreset in its three modes, masks, budgets and infos.

The answers are those of Gymnasium's `SyncVectorEnv` over as many single environments, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from packmech_envs.actions import Actions

Infos = dict[str, NDArray[Any]]


class Advanced(NamedTuple):
    """What a step did to each environment; rows of those that were not active mean nothing.

    Attributes
    ----------
    reward_b, terminated_b, truncated_b
        (B,) rewards, ends of episodes, and ends for want of budget beyond `max_episode_steps`.
    infos
        Arrays of B rows by name. In an array of objects None says that there is nothing to tell.

    """

    reward_b: NDArray[np.float64]
    terminated_b: NDArray[np.bool_]
    truncated_b: NDArray[np.bool_]
    infos: Infos


class BatchedEnv(VectorEnv[NDArray[np.float64], NDArray[np.float64], NDArray[Any]]):
    """A batch of environments that one call advances; a subclass gives the five methods that start with `_`.

    Parameters
    ----------
    num_envs
        How many.
    observation_space, action_space
        Those of a single environment, float64.
    autoreset_mode
        AutoresetMode.NEXT_STEP, SAME_STEP or DISABLED, or its name such as "SameStep".
    max_episode_steps
        Steps after which an episode is truncated; None: none.
    metadata, render_mode
        As those of the single environment.

    """

    def __init__(
        self,
        num_envs: int,
        *,
        observation_space: Box,
        action_space: Box,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        metadata: dict[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = _count("num_envs", num_envs)
        self.max_episode_steps = None if max_episode_steps is None else _count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**(metadata or {}), "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.single_observation_space, self.single_action_space = observation_space, action_space
        self.observation_space = batch_space(observation_space, num_envs)
        self.action_space = batch_space(action_space, num_envs)
        self.actions = Actions(action_space)
        self._rng: list[np.random.Generator | None] = [None] * num_envs
        self._rng_seed: list[int | None] = [None] * num_envs
        self.elapsed_b = np.zeros(num_envs, dtype=np.int64)
        # whose episode is over, and who never had one
        self._done_b = np.zeros(num_envs, dtype=bool)
        self._fresh_b = np.ones(num_envs, dtype=bool)

    # what a subclass gives

    def _reset_some(
        self, index_k: NDArray[np.int64], rngs: Sequence[np.random.Generator], options: dict[str, Any]
    ) -> None:
        """Start new episodes in these environments, each with its own generator."""
        raise NotImplementedError

    def _observations(self) -> NDArray[np.float64]:
        """Return the (B, K) observations of the present moment, in an array of its own."""
        raise NotImplementedError

    def _starting_infos(self) -> Infos:
        """Return what there is to tell of an episode that has just started, B rows each."""
        raise NotImplementedError

    def _advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> Advanced:
        """Advance the active environments by a step with these actions, which lie inside the bounds."""
        raise NotImplementedError

    def _frame(self, index: int) -> NDArray[np.uint8]:
        """Return a picture of one environment."""
        raise NotImplementedError

    # Gymnasium's side

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators, one for each environment."""
        return tuple(self._generator(b) for b in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seeds of the generators."""
        return tuple(self._rng_seed[b] for b in range(self.num_envs) if self._generator(b))

    def _generator(self, b: int) -> np.random.Generator:
        if self._rng[b] is None:
            self._rng[b], self._rng_seed[b] = seeding.np_random()
        rng = self._rng[b]
        assert rng is not None
        return rng

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start new episodes and return their observations and infos.

        Parameters
        ----------
        seed
            Of the first environment, those of the others count up from it; or one for each; None: the generators go on.
        options
            With "reset_mask", (B,) True for the environments to reset, the others stay as they are. The rest is passed
            to the environments.

        Raises
        ------
        TypeError, ValueError
            Seeds or a mask of another kind or number.

        """
        rest = dict(options or {})
        mask = _mask(rest.pop("reset_mask", None), self.num_envs)
        for b, one in enumerate(_seeds(seed, self.num_envs)):
            if one is not None and mask[b]:
                self._rng[b], self._rng_seed[b] = seeding.np_random(one)
        self._restart(mask, rest)
        told: dict[str, Any] = {}
        _tell(told, self._starting_infos(), mask)
        return self._observations(), told

    def _restart(self, mask_b: NDArray[np.bool_], options: dict[str, Any]) -> None:
        index = np.flatnonzero(mask_b)
        self._reset_some(index, [self._generator(int(b)) for b in index], options)
        self.elapsed_b[mask_b] = 0
        self._done_b[mask_b] = False
        self._fresh_b[mask_b] = False

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance every environment by a step; those whose episode is over start a new one as the mode says.

        Raises
        ------
        TypeError, ValueError
            If an action is outside the space.
        gymnasium.error.ResetNeeded
            If an environment was never reset, or not since its episode ended where nothing resets it by itself.

        """
        over = self._done_b
        if self._fresh_b.any() or (over.any() and self.autoreset_mode is AutoresetMode.DISABLED):
            waiting = np.flatnonzero(self._fresh_b | over)
            raise gym.error.ResetNeeded(f"environment {waiting[0]} must be reset before it can be stepped")
        restart = over.copy()
        active = ~restart
        action_bk = self.actions.many(actions, active)
        told: dict[str, Any] = {}
        did = self._advance(action_bk, active)
        self.elapsed_b += active
        reward = np.where(active, did.reward_b, 0.0)
        terminated = did.terminated_b & active
        truncated = did.truncated_b & active
        if self.max_episode_steps is not None:
            truncated |= active & (self.elapsed_b >= self.max_episode_steps)
        ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            last = self._observations()
            final = np.full(self.num_envs, None, dtype=object)
            for b in np.flatnonzero(ended):
                final[b] = last[b]
            final_info: dict[str, Any] = {}
            _tell(final_info, did.infos, ended)
            told |= {"final_obs": final, "_final_obs": ended.copy()}
            told |= {"final_info": final_info, "_final_info": ended.copy()}
            _tell(told, did.infos, active & ~ended)
            self._restart(ended, {})
            _tell(told, self._starting_infos(), ended)
        else:
            _tell(told, did.infos, active)
            if restart.any():
                self._restart(restart, {})
                _tell(told, self._starting_infos(), restart)
            self._done_b = ended
        return self._observations(), reward, terminated, truncated, told

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment; None without a render_mode."""
        if self.render_mode is None:
            gym.logger.warn("render() was called without a render_mode: give render_mode='rgb_array' when making it")
            return None
        return tuple(self._frame(b) for b in range(self.num_envs))


def _tell(told: dict[str, Any], infos: Infos, mask_b: NDArray[np.bool_]) -> None:
    """Add rows of infos, and under _name whose they are, as `SyncVectorEnv` does."""
    if not mask_b.any():
        return
    whole = bool(mask_b.all())
    for name, array in infos.items():
        mine, all_of_it = mask_b, whole
        if array.dtype == object:
            mine = mask_b & np.array([one is not None for one in array])
            all_of_it = bool(mine.all())
            if not mine.any():
                continue
        if name in told:
            told[name][mine] = array[mine]
            told["_" + name] |= mine
            continue
        if all_of_it:
            told[name] = array.copy()
        else:
            told[name] = np.full(array.shape, None, dtype=object) if array.dtype == object else np.zeros_like(array)
            told[name][mine] = array[mine]
        told["_" + name] = mine.copy()


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer at least 1, got {value!r}")
    if value < 1:
        raise ValueError(f"{name} must be an integer at least 1, got {value}")
    return int(value)


def _mode(value: Any) -> AutoresetMode:
    try:
        return AutoresetMode(value)
    except ValueError:
        names = ", ".join(repr(one.value) for one in AutoresetMode)
        raise ValueError(f"autoreset_mode must be one of {names}, got {value!r}") from None


def _seeds(seed: Any, count: int) -> Sequence[int | None]:
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + b for b in range(count)]
    seeds = list(seed)
    if len(seeds) != count:
        raise ValueError(f"seed must hold one seed for each of {count} environments, got {len(seeds)}")
    return seeds


def _mask(given: Any, count: int) -> NDArray[np.bool_]:
    if given is None:
        return np.ones(count, dtype=bool)
    if not isinstance(given, np.ndarray) or given.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] must be a numpy array of bool, got {given!r:.60}")
    if given.shape != (count,):
        raise ValueError(f"options['reset_mask'] must have shape ({count},), got {given.shape}")
    if not given.any():
        raise ValueError("options['reset_mask'] must be True for at least one environment, got none")
    return given.copy()
