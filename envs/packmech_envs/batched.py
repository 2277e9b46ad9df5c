"""Natively batched environments: Quench-v0 and Shear-v0 over episodes that one compiled call advances.

`BatchedEnv` has what both share: seeds, autoreset in its three modes, masks, budgets and infos. The answers are
those of Gymnasium's `SyncVectorEnv` over as many single environments, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.drawing import METADATA, contacts_of
from packmech_envs.episodes import Actions, Episodes, Infos
from packmech_envs.quench import QuenchEpisodes, QuenchTask
from packmech_envs.shear import ShearEpisodes, ShearTask
from packmech_envs.tasks import count, task_of
from packmech_envs.words import brief

__all__ = ["BatchedEnv", "QuenchVectorEnv", "ShearVectorEnv"]

# environments of a batch
_MOST = 1_000_000

Kind = TypeVar("Kind", bound=Episodes)


class BatchedEnv(VectorEnv[NDArray[np.float64], NDArray[np.float64], NDArray[Any]], Generic[Kind]):
    """A batch of environments that one call advances.

    Parameters
    ----------
    episodes
        What is advanced.
    autoreset_mode
        AutoresetMode.NEXT_STEP, SAME_STEP or DISABLED, or its name such as "SameStep".
    max_episode_steps
        Steps after which an episode is truncated; None: none.
    render_mode
        None or "rgb_array": `render` returns a picture of each packing.

    Attributes
    ----------
    task
        The options.
    observation_names, action_names
        The names of the numbers in an observation, and in an action.

    """

    def __init__(
        self,
        episodes: Kind,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and not (isinstance(render_mode, str) and render_mode == "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array' for a batch, got {brief(render_mode)}")
        self._episodes, self.num_envs = episodes, len(episodes)
        self.task = episodes.task
        self.observation_names, self.action_names = episodes.observation_names, episodes.action_names
        self.max_episode_steps = None if max_episode_steps is None else count("max_episode_steps", max_episode_steps)
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.single_observation_space, self.single_action_space = episodes.observation_space, episodes.action_space
        self.observation_space = batch_space(episodes.observation_space, self.num_envs)
        self.action_space = batch_space(episodes.action_space, self.num_envs)
        self.actions = Actions(episodes.action_space)
        self._rng: list[np.random.Generator | None] = [None] * self.num_envs
        self._rng_seed: list[int | None] = [None] * self.num_envs
        self.elapsed_b = np.zeros(self.num_envs, dtype=np.int64)
        # whose episode is over, and who never had one
        self._done_b = np.zeros(self.num_envs, dtype=bool)
        self._fresh_b = np.ones(self.num_envs, dtype=bool)

    def scene(self, index: int) -> pm.Scene:
        """Return one scene as its episode started from it, with the effects that act in it.

        Parameters
        ----------
        index
            Which one.

        """
        return self._episodes.scene(index)

    def packing(self, index: int) -> pm.Packing:
        """Return one packing as it is now.

        Parameters
        ----------
        index
            Which one.

        """
        return self._episodes.packing(index)

    def contacts(self, index: int) -> pm.Contacts | pm.ShapeContacts:
        """Return the contacts of one packing now.

        Parameters
        ----------
        index
            Which one.

        """
        return contacts_of(self.packing(index))

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
        self._check_open()
        rest = dict(options or {})
        mask = _mask(rest.pop("reset_mask", None), self.num_envs)
        for b, one in enumerate(_seeds(seed, self.num_envs)):
            if one is not None and mask[b]:
                self._rng[b], self._rng_seed[b] = seeding.np_random(one)
        self._restart(mask, rest)
        infos: dict[str, Any] = {}
        _add_infos(infos, self._episodes.infos(), mask)
        return self._episodes.observation_bk.copy(), infos

    def _restart(self, mask_b: NDArray[np.bool_], options: dict[str, Any]) -> None:
        """Start new episodes in the environments of the mask."""
        index = np.flatnonzero(mask_b).tolist()
        self._episodes.start(index, [self._generator(b) for b in index], options)
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
        self._check_open()
        over = self._done_b
        if self._fresh_b.any() or (over.any() and self.autoreset_mode is AutoresetMode.DISABLED):
            waiting = np.flatnonzero(self._fresh_b | over)
            raise gym.error.ResetNeeded(f"environment {waiting[0]} must be reset before it can be stepped")
        restart = over.copy()
        active = ~restart
        action_bk = self.actions.many(actions, active)
        episodes, infos = self._episodes, dict[str, Any]()
        episodes.advance(action_bk, active)
        self.elapsed_b += active
        reward = np.where(active, episodes.reward_b, 0.0)
        terminated = episodes.terminated_b & active
        truncated = episodes.truncated_b & active
        if self.max_episode_steps is not None:
            truncated |= active & (self.elapsed_b >= self.max_episode_steps)
        ended = terminated | truncated
        of_step = episodes.infos()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for b in np.flatnonzero(ended):
                final[b] = episodes.observation_bk[b].copy()
            final_info: dict[str, Any] = {}
            _add_infos(final_info, of_step, ended)
            infos |= {"final_obs": final, "_final_obs": ended.copy()}
            infos |= {"final_info": final_info, "_final_info": ended.copy()}
            _add_infos(infos, of_step, active & ~ended)
            self._restart(ended, {})
            _add_infos(infos, episodes.infos(), ended)
        else:
            _add_infos(infos, of_step, active)
            if restart.any():
                self._restart(restart, {})
                _add_infos(infos, episodes.infos(), restart)
            self._done_b = ended
        return episodes.observation_bk.copy(), reward, terminated, truncated, infos

    def _check_open(self) -> None:
        if self.closed:
            raise gym.error.ClosedEnvironmentError(
                "the environments must be open, got some that are closed: make others"
            )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment; None without a render_mode."""
        if self.render_mode is None:
            gym.logger.warn("render() was called without a render_mode: give render_mode='rgb_array' when making it")
            return None
        scenes = [self.scene(b) for b in range(self.num_envs)]
        return tuple(pm.draw_frame(self.packing(b), effects=one.effects) for b, one in enumerate(scenes))


class QuenchVectorEnv(BatchedEnv[QuenchEpisodes]):
    """A batch of Quench-v0, with the bits of single environments (`packmech_envs.single.QuenchEnv`) of the same seeds.

    Parameters
    ----------
    num_envs
        How many, a million at most.
    scene, task, options
        As of `QuenchEnv`.
    threads
        How many of them are advanced at a time; the bits do not depend on it.
    autoreset_mode
        AutoresetMode.NEXT_STEP, SAME_STEP or DISABLED, or its name such as "SameStep".
    max_episode_steps
        A further budget of steps, beside step_budget.
    render_mode
        None or "rgb_array": `render` returns a picture of each.

    Examples
    --------
    >>> envs = QuenchVectorEnv(3, autoreset_mode="SameStep")
    >>> observations, infos = envs.reset(seed=1)
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((3, 2)))
    >>> observations.shape, infos["pressure"].tolist()
    ((3, 8), [0.0, 0.0, 0.0])

    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Any = None,
        *,
        task: QuenchTask | None = None,
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        task = task_of(QuenchTask, task, options)
        super().__init__(
            QuenchEpisodes(_number_of(num_envs), scene, task, threads),
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
        )

    def action(self, packing_fraction_change: float = 0.0, shear_strain: float = 0.0) -> NDArray[np.float64]:
        """Return the action of a single environment that asks for these changes, as `QuenchEnv.action` does."""
        return self._episodes.action(packing_fraction_change, shear_strain)


class ShearVectorEnv(BatchedEnv[ShearEpisodes]):
    """A batch of Shear-v0, with the bits of single environments (`packmech_envs.single.ShearEnv`) of the same seeds.

    Parameters
    ----------
    num_envs
        How many, a million at most.
    scene, task, options
        As of `ShearEnv`.
    threads, autoreset_mode, max_episode_steps, render_mode
        As of `QuenchVectorEnv`.

    Attributes
    ----------
    dt, frame_time
        As of `ShearEnv`.

    Examples
    --------
    >>> envs = ShearVectorEnv(3, "triangular", control="strain", frame_skip=10)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations, rewards, terminated, truncated, infos = envs.step([[1e-3], [2e-3], [3e-3]])
    >>> observations[:, envs.observation_names.index("strain")].round(12).tolist()
    [0.001, 0.002, 0.003]

    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Any = "default",
        *,
        task: ShearTask | None = None,
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        task = task_of(ShearTask, task, options)
        super().__init__(
            ShearEpisodes(_number_of(num_envs), scene, task, threads),
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
        )
        self.dt, self.frame_time = self._episodes.dt, self._episodes.frame_time

    def close_extras(self, **kwargs: Any) -> None:
        """Shut down the threads."""
        self._episodes.batch.close()


def _add_infos(infos: dict[str, Any], found: Infos, mask_b: NDArray[np.bool_]) -> None:
    """Add rows of what was found to infos, and under _name whose rows they are, as `SyncVectorEnv` does."""
    if not mask_b.any():
        return
    all_set = bool(mask_b.all())
    for name, array in found.items():
        mine, complete = mask_b, all_set
        if array.dtype == object:
            mine = mask_b & np.array([one is not None for one in array])
            complete = bool(mine.all())
            if not mine.any():
                continue
        if name in infos:
            infos[name][mine] = array[mine]
            infos["_" + name] |= mine
            continue
        if complete:
            infos[name] = array.copy()
        else:
            infos[name] = np.full(array.shape, None, dtype=object) if array.dtype == object else np.zeros_like(array)
            infos[name][mine] = array[mine]
        infos["_" + name] = mine.copy()


def _number_of(num_envs: Any) -> int:
    number = count("num_envs", num_envs)
    if number > _MOST:
        raise ValueError(f"num_envs must be at most {_MOST}, got {brief(num_envs)}")
    return number


def _mode(value: Any) -> AutoresetMode:
    try:
        return AutoresetMode(value)
    # an object may refuse to be compared
    except Exception:
        names = ", ".join(repr(one.value) for one in AutoresetMode)
        raise ValueError(f"autoreset_mode must be one of {names}, got {brief(value)}") from None


def _seeds(seed: Any, count: int) -> Sequence[int | None]:
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + b for b in range(count)]
    try:
        # one more than there may be
        seeds = list(islice(seed, count + 1))
    except Exception:
        raise TypeError(f"seed must be None, an integer or one for each environment, got {brief(seed)}") from None
    if len(seeds) != count:
        more = " or more" if len(seeds) > count else ""
        raise ValueError(f"seed must hold one seed for each of {count} environments, got {len(seeds)}{more}")
    return seeds


def _mask(given: Any, count: int) -> NDArray[np.bool_]:
    if given is None:
        return np.ones(count, dtype=bool)
    if not isinstance(given, np.ndarray) or given.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] must be a numpy array of bool, got {brief(given)}")
    if given.shape != (count,):
        raise ValueError(f"options['reset_mask'] must have shape ({count},), got {given.shape}")
    if not given.any():
        raise ValueError("options['reset_mask'] must be True for at least one environment, got none")
    return given.copy()
