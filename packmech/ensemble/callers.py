"""What the calls of packmech share that make many runs: members that are finished all, and scenes that are kept."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from packmech.check import brief, integer
from packmech.ensemble.folder import WORKSPACE, find, read_arrays
from packmech.ensemble.members import member_of
from packmech.ensemble.run import run_ensemble
from packmech.files.packings import read_packing
from packmech.loop.checkpoint import fingerprint, scene_fingerprints
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.scenes.scene_file import read_scene, write_scene

# beside the members: scenes that parameters of members name
SCENES = "scenes"


@dataclass(frozen=True)
class Finished:
    """A member that is done.

    Attributes
    ----------
    path
        Its folder.
    values
        The numbers and texts that its job returned.

    """

    path: Path
    values: dict[str, Any]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that its job returned."""
        return read_arrays(self.path)

    def packing(self, name: str = "packing") -> Packing:
        """Return a packing that its job returned."""
        return read_packing(self.path / f"{name}.npz")


@contextmanager
def folder_of(folder: str | os.PathLike[str] | None) -> Iterator[Path]:
    """Give the folder that was named, or for None one that is removed when the block ends.

    Raises
    ------
    TypeError, ValueError
        If it is none, or holds results as versions before kept them.

    """
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="packmech-") as place:
            yield Path(place)
        return
    if not isinstance(folder, str | os.PathLike):
        raise TypeError(f"folder must be a path or None, got {brief(folder)}")
    if any(Path(folder).glob("*.npz")):
        raise ValueError(f"folder must hold members of ensembles, or none, got {str(folder)!r} with files of before")
    yield Path(folder)


def complete(
    job: Callable[..., Any],
    wanted: Sequence[Mapping[str, Any]],
    folder: Path,
    *,
    workers: int | None,
    time_limit: float | None = None,
    progress: Callable[[int, int, int, Finished], None] | None = None,
) -> list[Finished]:
    """Return the members with these parameters, in this order, after running those that are missing or failed before.

    Parameters that are the same are one member.

    Parameters
    ----------
    job
        As in `run_ensemble`.
    wanted
        The parameters of each member; a list is a single value.
    folder
        That of the ensemble.
    workers
        As in `run_ensemble`. With 0 the first exception of a member passes on at once; else all members are run before
        failures are raised.
    time_limit
        Of each member where other processes run them, as in `run_ensemble`.
    progress
        Called as progress(finished, of, number, member) once for each that is wanted and finished.

    Raises
    ------
    TypeError, ValueError, RuntimeError
        If a member failed, with its message.
    KeyboardInterrupt
        As from `run_ensemble`.

    """
    if workers is not None:
        integer("workers", workers, at_least=0)
    members = [member_of(one) for one in wanted]
    numbers: dict[str, list[int]] = {}
    for k, one in enumerate(members):
        numbers.setdefault(one.id, []).append(k)
    finished: dict[str, Finished] = {}
    raised: list[Exception] = []

    def take(name: str) -> None:
        found = find(folder, members[numbers[name][0]])
        if found.result is not None and name not in finished:
            finished[name] = Finished((folder / WORKSPACE / name).absolute(), found.result["values"])
            done = sum(len(numbers[one]) for one in finished)
            if progress is not None:
                for k in numbers[name]:
                    progress(done, len(members), k, finished[name])

    @wraps(job)
    def run(**given: Any) -> Any:
        try:
            return job(**given)
        except Exception as error:
            raised.append(error)
            raise

    def report(stage: str, figures: dict[str, Any]) -> None:
        if raised:
            raise raised[0]
        if "member" in figures:
            take(figures["member"])

    for name in numbers:
        take(name)
    if len(finished) < len(numbers):
        grid = [{name: [value] for name, value in wanted[places[0]].items()} for places in numbers.values()]
        chosen: dict[str, Any] = {"workers": workers, "time_limit": time_limit if workers != 0 else None}
        run_ensemble(job if workers != 0 else run, grid, folder, retry=True, progress=report, **chosen)
    failed = [one for one in members if one.id not in finished]
    if failed:
        failure = find(folder, failed[0]).failure or {}
        reason, message = failure.get("reason", ""), failure.get("message", "")
        kind = {"TypeError": TypeError, "ValueError": ValueError}.get(reason, RuntimeError)
        raise kind(
            f"{message} ({reason} of {failed[0].parameters}; {len(failed)} of {len(members)} members failed in "
            f"{folder}, which has their tracebacks; the others are finished and stay)"
        )
    return [finished[one.id] for one in members]


def keep_scene(folder: Path, scene: Scene) -> str:
    """Write a scene with its drive into the folder of an ensemble; return what parameters of members call it.

    The name is a hash of what the scene holds, so that each is kept once.
    """
    path = _place(folder, scene)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_scene(scene, path)
    return path.stem


def has_scene(folder: Path, scene: Scene) -> bool:
    """Return whether a scene was kept in the folder of an ensemble."""
    return _place(folder, scene).exists()


def _place(folder: Path, scene: Scene) -> Path:
    return folder / SCENES / f"{fingerprint([sorted(scene_fingerprints(scene).items()), scene.drive])[:32]}.toml"


def scene_path(folder: Path, name: str) -> Path:
    """Return where a scene lies that a parameter of a member names, by the member's folder."""
    return folder.parents[1] / SCENES / f"{name}.toml"


@lru_cache(maxsize=4)
def scene_at(path: Path) -> Scene:
    """Return the scene in a file that `keep_scene` wrote, which never changes."""
    return read_scene(path)
