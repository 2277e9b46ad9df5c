"""When recordings of episodes start and stop, and what goes into them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import packmech as pm

Trigger = Callable[[int], bool]


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
    """When recordings start and stop, and what goes into them; asks the environment, and tells it nothing.

    Parameters
    ----------
    folder, episode_trigger, step_trigger, recording_length, name_prefix
        As of `RerunRecorder`.
    scene, packing
        Functions that return what is recorded.
    about
        What the recordings tell of where they are from.

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
        about: Mapping[str, Any],
    ) -> None:
        for name, trigger in (("episode_trigger", episode_trigger), ("step_trigger", step_trigger)):
            if trigger is not None and not callable(trigger):
                raise TypeError(f"{name} must be a function of a number, got {trigger!r}")
        if isinstance(recording_length, bool) or not isinstance(recording_length, int):
            raise TypeError(f"recording_length must be an integer, 0 for whole episodes, got {recording_length!r}")
        if recording_length < 0:
            raise ValueError(f"recording_length must be 0 for whole episodes or positive, got {recording_length}")
        if not isinstance(folder, str | os.PathLike):
            raise TypeError(f"folder must be a folder's name, got {folder!r}")
        if episode_trigger is None and step_trigger is None:
            episode_trigger = cubes_and_thousands
        self.folder = Path(folder).absolute()
        self.folder.mkdir(parents=True, exist_ok=True)
        self.episode_trigger, self.step_trigger = episode_trigger, step_trigger
        self.recording_length, self.name_prefix = recording_length, name_prefix
        self.scene, self.packing, self.about = scene, packing, dict(about)
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

    def stepped(self, reward: float, figures: Mapping[str, Any], *, seen: bool = True) -> None:
        """Note a step; `seen` says whether the packing is still the one that the step ended with."""
        self.step_id += 1
        self.length += 1
        self.returned += reward
        if self.step_trigger is not None and self.step_trigger(self.step_id):
            self.start(f"{self.name_prefix}-step-{self.step_id}")
        if seen:
            self.frame({"reward": reward, "return": self.returned, **figures})

    def start(self, name: str) -> None:
        """Start a recording; one that is going on ends here."""
        self.stop()
        scene = self.scene()
        names = {letter for letter in "xyz"[: scene.packing.dimension]}
        drive = getattr(scene, "drive", None)
        plane = "".join(sorted("xyz"[axis] for axis in getattr(drive, "axes", (0, 1))))
        loop = ("strain", f"stress_{plane}") if set(plane) <= names else None
        self.name = name
        about = {**self.about, "episode": self.episode_id, "step": self.step_id}
        self.recording = pm.Recording(self.folder / f"{name}.rrd", scene, parameters=about, loop=loop)
        self.recorded = scene

    def _same_particles(self) -> bool:
        mine, theirs = self.recorded.packing, self.packing()
        if not np.array_equal(mine.radius_n, theirs.radius_n) or mine.dimension != theirs.dimension:
            return False
        one, other = mine.links, theirs.links
        if one is None or other is None:
            return one is other
        return bool(np.array_equal(one.i_l, other.i_l) and np.array_equal(one.j_l, other.j_l))

    def frame(self, figures: Mapping[str, Any]) -> None:
        """Add a frame to the recording, if there is one, and end it when it is long enough."""
        if self.recording is None:
            return
        told = _numbers(figures)
        time = told.get("time")
        try:
            self.recording.add(self.packing(), time=time, figures=told)
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


class ending:  # noqa: N801 - used like a function
    """Ends the recording where an exception comes through."""

    def __init__(self, recorder: EpisodeRecorder) -> None:
        self.recorder = recorder

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, *more: object) -> None:
        if kind is not None:
            self.recorder.stop()


def _numbers(figures: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures that are single real numbers."""
    found = {}
    for name, value in figures.items():
        plain = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
        if isinstance(plain, int | float | np.integer | np.floating) and not isinstance(plain, bool):
            found[name] = float(plain)
    return found
