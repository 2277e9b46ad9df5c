"""Episodes written as Rerun recordings, by the triggers that Gymnasium's RecordVideo has."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper

from packmech_envs.episode_recorder import EpisodeRecorder, Trigger, ending

__all__ = ["RerunRecorder", "RerunVectorRecorder"]

_SPACES = ("observation", "action")


def _named(env: Any, named: Any, space: str, value: Any) -> dict[str, Any]:
    """Return observation or action by name, where no wrapper between the environment and here has changed it."""
    names = getattr(named, f"{space}_names", None)
    if names is None or getattr(env, f"{space}_space") is not getattr(env.unwrapped, f"{space}_space"):
        return {}
    row = np.asarray(value, dtype=np.float64).ravel()
    if len(row) != len(names):
        return {}
    prefix = "action " if space == "action" else ""
    return {f"{prefix}{name}": float(one) for name, one in zip(names, row, strict=True)}


def _about(env: Any) -> dict[str, Any]:
    spec = getattr(env, "spec", None)
    if spec is None:
        return {"environment": type(env.unwrapped).__name__}
    return {"environment": spec.id, "arguments": {name: f"{value!r:.200}" for name, value in spec.kwargs.items()}}


class RerunRecorder(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Writes episodes as Rerun recordings; which ones, triggers say as for Gymnasium's RecordVideo.

    Each recording is a file of its own, `{name_prefix}-episode-{id}.rrd` or `{name_prefix}-step-{id}.rrd`: packing,
    contacts, bonds, links and box frame by frame, and every observation, action, reward, and number in infos against
    the step. Files are complete when an episode's reset, `close`, an exception, or the end of Python comes. Recording
    changes no bit of what is recorded, and needs no render_mode.

    Parameters
    ----------
    env
        packmech/Shear-v0 or packmech/Quench-v0, wrapped or not.
    folder
        Where the recordings go; made if need be. Files of these names are replaced.
    episode_trigger, step_trigger
        Functions of the number of the episode, and of the step through all episodes, that say whether a recording
        starts there. With neither: episodes 0, 1, 8, 27, ..., 1000, 2000, ...
    recording_length
        Steps of a recording, which may go on through several episodes; 0: to the episode's end.
    name_prefix
        How the files' names begin.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import tempfile, gymnasium as gym
    >>> folder = tempfile.mkdtemp()
    >>> env = RerunRecorder(gym.make("packmech_envs:packmech/Shear-v0", scene="triangular", frame_skip=2), folder)
    >>> observation, info = env.reset(seed=1)
    >>> for _ in range(3):
    ...     result = env.step(env.action_space.sample())
    >>> env.close()
    >>> sorted(os.listdir(folder))
    ['packmech-episode-0.rrd']

    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        folder: str | os.PathLike[str],
        episode_trigger: Trigger | None = None,
        step_trigger: Trigger | None = None,
        recording_length: int = 0,
        name_prefix: str = "packmech",
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self,
            folder=folder,
            episode_trigger=episode_trigger,
            step_trigger=step_trigger,
            recording_length=recording_length,
            name_prefix=name_prefix,
        )
        gym.Wrapper.__init__(self, env)
        inner: Any = env.unwrapped
        if not (hasattr(type(inner), "packing") and hasattr(type(inner), "scene")):
            raise TypeError(f"env must have a packing to record, as packmech/Shear-v0 has, got {type(inner).__name__}")
        self._recorder = EpisodeRecorder(
            folder,
            episode_trigger,
            step_trigger,
            recording_length,
            name_prefix,
            lambda: inner.scene,
            lambda: inner.packing,
            _about(env),
        )

    @property
    def recording(self) -> bool:
        """Whether a recording is going on."""
        return self._recorder.recording is not None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and start or end recordings."""
        with ending(self._recorder):
            observation, info = self.env.reset(seed=seed, options=options)
        self._recorder.began({**self._row("observation", observation), **info})
        return observation, info

    def _row(self, space: str, value: Any) -> dict[str, Any]:
        return _named(self.env, self.env.unwrapped, space, value)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment, and record the frame."""
        with ending(self._recorder):
            observation, reward, terminated, truncated, info = self.env.step(action)
        told = {
            **_named(self.env, self.env.unwrapped, "observation", observation),
            **_named(self.env, self.env.unwrapped, "action", action),
            **info,
        }
        self._recorder.stepped(float(reward), told)
        return observation, reward, terminated, truncated, info

    def close(self) -> None:
        """End the recording, and close the environment."""
        self._recorder.stop()
        super().close()


class RerunVectorRecorder(VectorWrapper):
    """Writes episodes of one environment of a batch as Rerun recordings, as `RerunRecorder` does.

    With AutoresetMode.SAME_STEP an episode's last packing is gone when its last step is over: the recording ends with
    the frame before.

    Parameters
    ----------
    env
        What gymnasium.make_vec makes of packmech/Shear-v0 or packmech/Quench-v0, batched natively or one after the
        other ("sync"). For "async" give each environment a recorder: make_vec(..., wrappers=[...]).
    folder, episode_trigger, step_trigger, recording_length, name_prefix
        As of `RerunRecorder`.
    index
        Which environment.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        folder: str | os.PathLike[str],
        episode_trigger: Trigger | None = None,
        step_trigger: Trigger | None = None,
        recording_length: int = 0,
        name_prefix: str = "packmech",
        *,
        index: int = 0,
    ) -> None:
        super().__init__(env)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < env.num_envs:
            raise ValueError(f"index must be that of one of {env.num_envs} environments, got {index!r}")
        inner: Any = env.unwrapped
        self.index = index
        self.mode = AutoresetMode(env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP))
        if isinstance(inner, SyncVectorEnv):
            single = inner.envs[index]
            one: Any = single.unwrapped
            look = (lambda: one.scene, lambda: one.packing) if hasattr(type(one), "packing") else None
            plain = all(getattr(single, f"{name}_space") is getattr(one, f"{name}_space") for name in _SPACES)
            self._one = one if plain else None
        elif callable(getattr(inner, "packing", None)) and hasattr(inner, "scene"):
            # batches whose packings differ have a scene for each
            look = (lambda: inner.scene(index) if callable(inner.scene) else inner.scene, lambda: inner.packing(index))
            self._one = inner
        else:
            look = None
        if look is None:
            raise TypeError(
                "env must have packings that can be looked at from here, got "
                f"{type(inner).__name__}; give each environment a RerunRecorder of its own instead"
            )
        self._recorder = EpisodeRecorder(
            folder, episode_trigger, step_trigger, recording_length, name_prefix, *look, _about(env) | {"index": index}
        )
        self._over = False

    @property
    def recording(self) -> bool:
        """Whether a recording is going on."""
        return self._recorder.recording is not None

    def _told(self, infos: Mapping[str, Any]) -> dict[str, Any]:
        """Return the numbers that infos tell of the environment."""
        return {
            name: rows[self.index]
            for name, rows in infos.items()
            if isinstance(rows, np.ndarray)
            and not name.startswith("_")
            and rows.ndim == 1
            and bool(infos.get(f"_{name}", np.ones(len(rows), dtype=bool))[self.index])
        }

    def _row(self, space: str, value: Any) -> dict[str, Any]:
        return _named(self.env, self._one, space, np.asarray(value)[self.index])

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environments, and start or end recordings."""
        with ending(self._recorder):
            observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        if mask is None or mask[self.index]:
            self._over = False
            self._recorder.began({**self._row("observation", observations), **self._told(infos)})
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments, and record the frame of one."""
        with ending(self._recorder):
            observations, rewards, terminated, truncated, infos = self.env.step(actions)
        k, recorder = self.index, self._recorder
        seen = {**self._row("observation", observations), **self._told(infos)}
        over = bool(terminated[k] or truncated[k])
        if self._over and self.mode is AutoresetMode.NEXT_STEP:
            recorder.began(seen)
        elif over and self.mode is AutoresetMode.SAME_STEP:
            recorder.stepped(float(rewards[k]), {}, seen=False)
            recorder.began(seen)
        else:
            recorder.stepped(float(rewards[k]), {**seen, **self._row("action", actions)})
        self._over = over
        return observations, rewards, terminated, truncated, infos

    def close(self, **kwargs: Any) -> None:
        """End the recording, and close the environments."""
        self._recorder.stop()
        super().close(**kwargs)
