"""The batched environments as stable-baselines3 takes them: `as_vec_env(envs)` is one of its VecEnvs.

stable-baselines3 comes with the extra `learning` and is imported on the first call only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import MultiDiscrete
from gymnasium.vector import AutoresetMode, VectorEnv

from packmech_envs.words import brief

__all__ = ["as_vec_env"]


def as_vec_env(envs: VectorEnv[Any, Any, Any]) -> Any:
    """Return a stable-baselines3 VecEnv over a batch of environments, to give to PPO and its like.

    Observations become float32, in which learners compute. An observation that ends an episode is in
    infos["terminal_observation"], and infos["TimeLimit.truncated"] says whether a budget ended it, as learners expect.

    Parameters
    ----------
    envs
        A batch with autoreset_mode "SameStep".

    Raises
    ------
    ModuleNotFoundError
        Without stable-baselines3, naming the extra that brings it.
    TypeError, ValueError
        If that is no batch, or one of another autoreset mode.

    """
    if not isinstance(envs, VectorEnv):
        raise TypeError(f"envs must be a batch of environments such as QuenchVectorEnv(8), got {brief(envs)}")
    mode = envs.metadata.get("autoreset_mode")
    if mode is not AutoresetMode.SAME_STEP:
        raise ValueError(f"envs must be made with autoreset_mode='SameStep', got {mode}")
    try:
        from stable_baselines3.common.vec_env import VecEnv
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            "as_vec_env needs stable-baselines3, which comes with the extra `learning`: "
            'pip install "packmech[learning]"',
            name=missing.name,
        ) from missing
    return _adapter(VecEnv)(envs)


def _adapter(base: Any) -> Any:
    """Return the class of the adapter; its base is known only where stable-baselines3 is installed."""

    class BatchedVecEnv(base):  # type: ignore[misc]
        """A batch of environments behind the interface of stable-baselines3."""

        def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
            self.envs = envs
            self._actions: Any = None
            self.render_mode = envs.render_mode
            super().__init__(envs.num_envs, _single(envs.single_observation_space), _single(envs.single_action_space))

        def reset(self) -> Any:
            seeds: Any = None if all(one is None for one in self._seeds) else list(self._seeds)
            observation, found = self.envs.reset(seed=seeds)
            self.reset_infos = _rows(found, self.num_envs)
            self._reset_seeds()
            return observation.astype(np.float32)

        def step_async(self, actions: Any) -> None:
            self._actions = np.asarray(actions)

        def step_wait(self) -> Any:
            observation, reward, terminated, truncated, found = self.envs.step(self._actions)
            done = terminated | truncated
            last, final = found.pop("final_obs", None), found.pop("final_info", {})
            found.pop("_final_obs", None)
            found.pop("_final_info", None)
            infos = _rows(found, self.num_envs)
            ends = _rows(final, self.num_envs)
            for b in np.flatnonzero(done):
                infos[b] = {
                    **ends[b],
                    "terminal_observation": last[b].astype(np.float32),
                    "TimeLimit.truncated": bool(truncated[b] and not terminated[b]),
                }
            return observation.astype(np.float32), reward.astype(np.float32), done, infos

        def get_images(self) -> Sequence[Any]:
            return list(self.envs.render() or [])

        def close(self) -> None:
            self.envs.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(self.envs, attr_name)] * len(self._listed(indices))

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise ValueError(f"attr_name must be given to the batch when it is made, got {brief(attr_name)}")

        def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **named: Any) -> list[Any]:
            method = getattr(self.envs, method_name)
            return [method(*method_args, **named) for _ in self._listed(indices)]

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * len(self._listed(indices))

        def _listed(self, indices: Any) -> list[int]:
            return list(self._get_indices(indices))

    return BatchedVecEnv


def _single(space: Any) -> Any:
    """Return the space with the numbers of learners: float32, or whole numbers as they are."""
    if isinstance(space, MultiDiscrete):
        return space
    return type(space)(space.low.astype(np.float32), space.high.astype(np.float32), dtype=np.float32)


def _rows(found: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Return a dictionary for each environment, of its infos."""
    rows: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, values in found.items():
        if name.startswith("_"):
            continue
        given = found.get("_" + name, np.ones(count, dtype=bool))
        for b in np.flatnonzero(given):
            value = values[b]
            rows[b][name] = value.item() if isinstance(value, np.generic) else value
    return rows
