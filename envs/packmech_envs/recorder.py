"""Episodes written as Rerun recordings, by the triggers that Gymnasium's RecordVideo has."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper

import packmech as pm
from packmech_envs.words import brief

__all__ = ["RerunRecorder", "RerunVectorRecorder", "cubes_and_thousands"]

Trigger = Callable[[int], bool]
_SPACES = ("observation", "action")


def cubes_and_thousands(episode: int) -> bool:
    """Return whether an episode is recorded unless said otherwise: cubes below 1000, then every thousandth.

    Examples
    --------
    >>> [episode for episode in range(3001) if cubes_and_thousands(episode)][:7]
    [0, 1, 8, 27, 64, 125, 216]

    """
    if episode >= 1000:
        return episode % 1000 == 0
    return bool(round(np.cbrt(episode)) ** 3 == episode)


class EpisodeRecorder:
    """When recordings start and stop, and what goes into them; it reads the environment and changes nothing in it.

    Parameters
    ----------
    folder, episode_trigger, step_trigger, recording_length, name_prefix
        As of `RerunRecorder`.
    scene, packing
        Functions that return what is recorded.
    metadata
        Where the recordings are from.

    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        episode_trigger: Trigger | None,
        step_trigger: Trigger | None,
        recording_length: int,
        name_prefix: str,
        scene: Callable[[], pm.Scene],
        packing: Callable[[], pm.Packing],
        metadata: Mapping[str, Any],
    ) -> None:
        for name, trigger in (("episode_trigger", episode_trigger), ("step_trigger", step_trigger)):
            if trigger is not None and not callable(trigger):
                raise TypeError(f"{name} must be a function of a number, got {brief(trigger)}")
        if isinstance(recording_length, bool) or not isinstance(recording_length, int):
            raise TypeError(f"recording_length must be an integer, 0 for whole episodes, got {brief(recording_length)}")
        if recording_length < 0:
            raise ValueError(f"recording_length must be 0 for whole episodes or positive, got {recording_length}")
        if not isinstance(folder, str | os.PathLike):
            raise TypeError(f"folder must be a folder's name, got {brief(folder)}")
        if episode_trigger is None and step_trigger is None:
            episode_trigger = cubes_and_thousands
        self.folder = Path(folder).absolute()
        self.folder.mkdir(parents=True, exist_ok=True)
        self.episode_trigger, self.step_trigger = episode_trigger, step_trigger
        self.recording_length, self.name_prefix = recording_length, name_prefix
        self.scene, self.packing, self.metadata = scene, packing, dict(metadata)
        self.recording: Any = None
        self.recorded: Any = None
        self.name = ""
        self.step_id, self.episode_id = -1, -1
        self.returned, self.length = 0.0, 0

    def began(self, figures: Mapping[str, Any]) -> None:
        """Note that an episode has started."""
        if not self.recording_length:
            self.stop()
        self.episode_id += 1
        self.returned, self.length = 0.0, 0
        if self.episode_trigger is not None and self.episode_trigger(self.episode_id):
            self.start(f"{self.name_prefix}-episode-{self.episode_id}")
        elif self.recording is not None and not self._same_particles():
            self.start(f"{self.name}-{self.episode_id}")
        self.frame(figures)

    def stepped(self, reward: float, figures: Mapping[str, Any], *, current: bool = True) -> None:
        """Note a step; `current` says whether the packing is still the one that the step ended with."""
        self.step_id += 1
        self.length += 1
        self.returned += reward
        if self.step_trigger is not None and self.step_trigger(self.step_id):
            self.start(f"{self.name_prefix}-step-{self.step_id}")
        if current:
            self.frame({"reward": reward, "return": self.returned, **figures})

    def start(self, name: str) -> None:
        """Start a recording; one that is going on ends here."""
        self.stop()
        scene = self.scene()
        axes = sorted(getattr(scene.drive, "axes", (0, 1)))
        plane = "".join("xyz"[axis] for axis in axes)
        loop = ("strain", f"stress_{plane}") if axes[-1] < scene.packing.dimension else None
        self.name = name
        metadata = {**self.metadata, "episode": self.episode_id, "step": self.step_id}
        self.recording = pm.Recording(self.folder / f"{name}.rrd", scene, parameters=metadata, loop=loop)
        self.recorded = scene

    def _same_particles(self) -> bool:
        """Whether the packing has the particles, shapes and links of the one being recorded."""
        recorded, now = self.recorded.packing, self.packing()
        if not np.array_equal(recorded.radius_n, now.radius_n) or recorded.dimension != now.dimension:
            return False
        bodies, links, others = recorded.shapes, recorded.links, now.links
        return (
            type(bodies) is type(now.shapes)
            and bodies.oriented(now.shapes.orientation_nq) == now.shapes
            and all(np.array_equal(*ends) for ends in ((links.i_l, others.i_l), (links.j_l, others.j_l)))
        )

    def frame(self, figures: Mapping[str, Any]) -> None:
        """Add a frame to the recording, if there is one, and end it when it is long enough."""
        if self.recording is None:
            return
        numbers = _numbers(figures)
        try:
            self.recording.add(self.packing(), time=numbers.get("time"), figures=numbers)
        except BaseException:
            self.stop()
            raise
        # as RecordVideo: the frame at the start, and so many steps
        if self.recording_length and self.recording.frames > self.recording_length:
            self.stop()

    def stop(self) -> None:
        """End the recording, if there is one: its file is complete then."""
        recording, self.recording = self.recording, None
        if recording is not None:
            recording.close({"episode_return": self.returned, "episode_length": self.length})

    @contextmanager
    def ending(self) -> Iterator[None]:
        """End the recording where an exception comes through."""
        try:
            yield
        except BaseException:
            self.stop()
            raise


def _numbers(figures: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures that are single real numbers."""
    found = {}
    for name, value in figures.items():
        plain = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
        if isinstance(plain, int | float | np.integer | np.floating) and not isinstance(plain, bool):
            found[name] = float(plain)
    return found


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


def _metadata(env: Any) -> dict[str, Any]:
    """Return the id and the arguments of an environment."""
    spec = getattr(env, "spec", None)
    if spec is None:
        return {"environment": type(env.unwrapped).__name__}
    return {"environment": spec.id, "arguments": {name: f"{value!r:.200}" for name, value in spec.kwargs.items()}}


class RerunRecorder(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Writes episodes as Rerun recordings; triggers say which, as for Gymnasium's RecordVideo.

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
        options: dict[str, Any] = {
            "folder": folder,
            "episode_trigger": episode_trigger,
            "step_trigger": step_trigger,
            "recording_length": recording_length,
            "name_prefix": name_prefix,
        }
        gym.utils.RecordConstructorArgs.__init__(self, **options)
        gym.Wrapper.__init__(self, env)
        inner: Any = env.unwrapped
        if not (hasattr(type(inner), "packing") and hasattr(type(inner), "scene")):
            raise TypeError(f"env must have a packing to record, as packmech/Shear-v0 has, got {type(inner).__name__}")
        self._recorder = EpisodeRecorder(
            scene=lambda: inner.scene, packing=lambda: inner.packing, metadata=_metadata(env), **options
        )

    @property
    def recording(self) -> bool:
        """Whether a recording is going on."""
        return self._recorder.recording is not None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and start or end recordings."""
        with self._recorder.ending():
            observation, info = self.env.reset(seed=seed, options=options)
        self._recorder.began({**self._row("observation", observation), **info})
        return observation, info

    def _row(self, space: str, value: Any) -> dict[str, Any]:
        return _named(self.env, self.env.unwrapped, space, value)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment, and record the frame."""
        with self._recorder.ending():
            observation, reward, terminated, truncated, info = self.env.step(action)
        figures = {**self._row("observation", observation), **self._row("action", action), **info}
        self._recorder.stepped(float(reward), figures)
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
            raise ValueError(f"index must be that of one of {env.num_envs} environments, got {brief(index)}")
        inner: Any = env.unwrapped
        self.index = index
        self.mode = AutoresetMode(env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP))
        if isinstance(inner, SyncVectorEnv):
            single = inner.envs[index]
            one: Any = single.unwrapped
            sources = (lambda: one.scene, lambda: one.packing) if hasattr(type(one), "packing") else None
            plain = all(getattr(single, f"{name}_space") is getattr(one, f"{name}_space") for name in _SPACES)
            self._one = one if plain else None
        elif callable(getattr(inner, "packing", None)) and hasattr(inner, "scene"):
            sources = (lambda: inner.scene(index), lambda: inner.packing(index))
            self._one = inner
        else:
            sources = None
        if sources is None:
            raise TypeError(
                "env must have packings that can be read from here, got "
                f"{type(inner).__name__}; give each environment a RerunRecorder of its own instead"
            )
        self._recorder = EpisodeRecorder(
            folder,
            episode_trigger,
            step_trigger,
            recording_length,
            name_prefix,
            *sources,
            _metadata(env) | {"index": index},
        )
        self._over = False

    @property
    def recording(self) -> bool:
        """Whether a recording is going on."""
        return self._recorder.recording is not None

    def _info(self, infos: Mapping[str, Any]) -> dict[str, Any]:
        """Return the infos of the one environment."""
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
        with self._recorder.ending():
            observations, infos = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        if mask is None or mask[self.index]:
            self._over = False
            self._recorder.began({**self._row("observation", observations), **self._info(infos)})
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments, and record the frame of one."""
        with self._recorder.ending():
            observations, rewards, terminated, truncated, infos = self.env.step(actions)
        k, recorder = self.index, self._recorder
        figures = {**self._row("observation", observations), **self._info(infos)}
        over = bool(terminated[k] or truncated[k])
        if self._over and self.mode is AutoresetMode.NEXT_STEP:
            recorder.began(figures)
        elif over and self.mode is AutoresetMode.SAME_STEP:
            recorder.stepped(float(rewards[k]), {}, current=False)
            recorder.began(figures)
        else:
            recorder.stepped(float(rewards[k]), {**figures, **self._row("action", actions)})
        self._over = over
        return observations, rewards, terminated, truncated, infos

    def close(self, **kwargs: Any) -> None:
        """End the recording, and close the environments."""
        self._recorder.stop()
        super().close(**kwargs)
