"""The folder of an ensemble: what lies where, and how it is written: all writes are atomic."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
import uuid
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

import packmech
from packmech.check import warn
from packmech.ensemble.members import Member, flattened, state_point_text
from packmech.files.archive import SEAL, read_archive, write_archive
from packmech.files.packings import write_packing
from packmech.files.paths import replacing
from packmech.packing import Packing

STATE_POINT, RESULT, FAILURE = "signac_statepoint.json", "result.json", "failure.json"
ARRAYS, CHECKPOINT = "arrays.npz", "checkpoint.npz"
JOB, WORKSPACE = "ensemble.json", "workspace"
# names in a job of where things lie, which may change from one machine to the next
PLACES = ("folder", "load", "root")
# what makes signac take the folder for a project
_SIGNAC, _SIGNAC_CONFIG = ".signac", "schema_version = 2\n"
# members are made here, in the same file system, and moved into the workspace when they are whole
_MAKING = ".making"
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)


class FolderError(OSError):
    """The folder of an ensemble cannot be written or read: no fault of a member, and the end of the command."""


@contextmanager
def _stored(folder: Path) -> Iterator[None]:
    """Name the folder where the disk is full, it may not be written, or is gone."""
    try:
        yield
    except FolderError:
        raise
    except OSError as error:
        raise FolderError(
            error.errno, f"folder must be one that can be written and has room, got {str(folder)!r}: {error}"
        ) from error


@dataclass(frozen=True)
class MemberOutcome:
    """The result of a member.

    Attributes
    ----------
    values
        Numbers and texts by name: a row of the table.
    arrays, packings
        What is kept in the member's folder.
    seconds
        CPU time.

    """

    values: dict[str, Any]
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    packings: dict[str, Packing] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Found:
    """What the folder says of a member: its result, its failure, or nothing yet.

    Attributes
    ----------
    member
        The member.
    result, failure
        What the file holds; None where there is none.
    damaged
        Files that are not as they were written and count as none.

    """

    member: Member
    result: dict[str, Any] | None = None
    failure: dict[str, Any] | None = None
    damaged: tuple[Path, ...] = ()

    @property
    def state(self) -> str:
        """Whether it is "done", "failed" or "missing"."""
        return "done" if self.result is not None else "failed" if self.failure is not None else "missing"


def prepare(folder: Path, job: Mapping[str, Any]) -> None:
    """Make the folder of an ensemble, or check that it is that of the same job.

    Raises
    ------
    ValueError
        If it holds members of another job, or something else.
    FolderError
        If it cannot be written.

    """
    with _stored(folder):
        known = folder / JOB
        # another process may make the folder at the same time
        found = read_job(folder) if known.exists() else None
        if found is not None:
            others = [name for name in {**found, **job} if _placeless(found.get(name)) != _placeless(job.get(name))]
            others = [name for name in others if name not in PLACES]
            if others:
                words = [_difference(name, found.get(name), job.get(name)) for name in others]
                raise ValueError(
                    f"folder must hold members of the same job, or be new, got {str(folder)!r} with {', '.join(words)}"
                )
        (folder / WORKSPACE).mkdir(parents=True, exist_ok=True)
        (folder / _SIGNAC).mkdir(exist_ok=True)
        if not (folder / _SIGNAC / "config").exists():
            _write(folder / _SIGNAC / "config", _SIGNAC_CONFIG)
        if found != job:
            _write(known, json.dumps({"packmech": packmech.__version__, "job": job}, indent=1) + "\n")


def _difference(name: str, found: Any, given: Any) -> str:
    """Return what is another in a job than in that of its folder, in words."""
    if isinstance(found, Mapping) and isinstance(given, Mapping) and name == "function":
        same = all(found.get(one) == given.get(one) for one in ("module", "name"))
        return f"a {given['name']} that was written otherwise" if same else "another function"
    return {"loaded": "files to load that were written otherwise"}.get(name, f"another {name}")


def _placeless(value: Any) -> Any:
    """Return part of a job without where it lies."""
    if isinstance(value, Mapping):
        return {name: _placeless(one) for name, one in value.items() if name not in PLACES}
    return [_placeless(one) for one in value] if isinstance(value, list) else value


def read_job(folder: Path) -> dict[str, Any]:
    """Return what the members of a folder run, as it was written by `prepare`.

    Raises
    ------
    FileNotFoundError, ValueError
        If the folder is none of an ensemble.

    """
    known = folder / JOB
    if not known.is_file():
        raise FileNotFoundError(f"folder must be that of an ensemble, got {str(folder)!r} without {JOB}")
    try:
        return dict(json.loads(known.read_text(encoding="utf-8"))["job"])
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"folder must hold a {JOB} of packmech, got {str(known)!r}: {error}") from error


def make_members(folder: Path, members: Iterable[Member]) -> None:
    """Make the folders of members that have none, each whole or not at all."""
    workspace, making = folder / WORKSPACE, folder / _MAKING
    with _stored(folder):
        there = set(os.listdir(workspace))
        for one in members:
            if one.id in there:
                continue
            new = making / f"{one.id}.{uuid.uuid4().hex}"
            try:
                _make_in(making, new)
                (new / STATE_POINT).write_text(state_point_text(one.parameters), encoding="utf-8")
                os.rename(new, workspace / one.id)
            except OSError:
                shutil.rmtree(new, ignore_errors=True)
                # another command may have been first
                if not (workspace / one.id / STATE_POINT).exists():
                    raise
        with contextlib.suppress(OSError):
            making.rmdir()


def _make_in(making: Path, new: Path) -> None:
    """Make a folder in the one for members on their way, which another command removes whenever it finds it empty."""
    while True:
        making.mkdir(exist_ok=True)
        try:
            return new.mkdir()
        except FileNotFoundError:
            if not making.parent.is_dir():
                raise


def listed_members(folder: Path) -> list[Member]:
    """Return the members that have a folder, in the order of their parameters.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such folder, or a state point cannot be read.

    """
    workspace = folder / WORKSPACE
    if not workspace.is_dir():
        raise FileNotFoundError(f"folder must be that of an ensemble, got {str(folder)!r} without {WORKSPACE}")
    found = []
    for name in os.listdir(workspace):
        path = workspace / name / STATE_POINT
        try:
            found.append(Member(name, flattened(json.loads(path.read_bytes()))))
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (ValueError, AttributeError) as error:
            raise ValueError(f"folder must hold state points of members, got {str(path)!r}: {error}") from error
    return sorted(found, key=_order)


def _order(member: Member) -> list[Any]:
    """Return what members are sorted by: names, then values, numbers before texts."""
    values = sorted(member.parameters.items())
    return [
        (name, isinstance(one, str | list), str(one) if isinstance(one, str | list) else one or 0)
        for name, one in values
    ]


def find(folder: Path, member: Member) -> Found:
    """Return what the folder says of a member; a file that cannot be read whole counts as none."""
    path = folder / WORKSPACE / member.id
    damaged: list[Path] = []
    result = _read(path / RESULT, damaged)
    failure = None if result is not None else _read(path / FAILURE, damaged)
    return Found(member, result, failure, tuple(damaged))


def find_all(folder: Path, members: Iterable[Member]) -> list[Found]:
    """Return what the folder says of members, with a warning where files count as none."""
    found = [find(folder, one) for one in members]
    damaged = [path for one in found for path in one.damaged]
    if damaged:
        warn(
            f"folder {str(folder)!r} holds {len(damaged)} results or failures that are not as they were written and "
            f"count as none, the first in {damaged[0].relative_to(folder)}: run the ensemble again to replace them"
        )
    return found


def _read(path: Path, damaged: list[Path]) -> dict[str, Any] | None:
    """Return what a file holds, or None; one that is not as it was written is put on the list."""
    try:
        found = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError, IsADirectoryError):
        found = None
    if isinstance(found, dict) and found.get(SEAL) == _seal(found):
        return found
    damaged.append(path)
    return None


def _seal(table: Mapping[str, Any]) -> str:
    """Return the hash of what a file of JSON holds, but for the seal itself."""
    held = {name: value for name, value in table.items() if name != SEAL}
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


def _sealed(table: Mapping[str, Any]) -> str:
    """Return the text of a file of JSON that says itself whether it is whole."""
    return json.dumps({**table, SEAL: _seal(table)})


@contextmanager
def claimed(folder: Path, member: Member) -> Iterator[bool]:
    """Give whether the member is this process's own until the block ends: no other process runs it at the same time.

    The lock is the system's and ends with the process, however that ends.
    """
    with _stored(folder):
        file = open(folder / WORKSPACE / member.id / STATE_POINT, "r+b")  # noqa: SIM115 - closed below
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            warnings.warn(
                f"{folder} lies in a file system without locks: see to it that no two commands run the same members",
                RuntimeWarning,
                stacklevel=3,
            )
        yield True


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays that a member left in its folder, by name; none if it left none."""
    if not (path / ARRAYS).exists():
        return {}
    arrays = read_archive(path / ARRAYS)
    arrays.pop(SEAL, None)
    return arrays


def write_outcome(folder: Path, member: Member, outcome: MemberOutcome) -> None:
    """Write the result of a member, atomically; what earlier attempts left is removed."""
    path = folder / WORKSPACE / member.id
    with _stored(folder):
        for name, packing in outcome.packings.items():
            write_packing(packing, path / f"{name}.npz")
        if outcome.arrays:
            with replacing(path / ARRAYS) as partial, open(partial, "wb") as file:
                write_archive(file, outcome.arrays)
        result = {
            "packmech": packmech.__version__,
            "random_seed": member.random_seed,
            "seconds": outcome.seconds,
            "values": outcome.values,
        }
        _write(path / RESULT, _sealed(result))
        for name in (FAILURE, CHECKPOINT):
            (path / name).unlink(missing_ok=True)


def write_failure(folder: Path, member: Member, failure: Mapping[str, Any]) -> None:
    """Move into place why a member has no result."""
    with _stored(folder):
        _write(folder / WORKSPACE / member.id / FAILURE, _sealed(failure))


def remove_leftovers(folder: Path, member: Member, *, checkpoint: bool) -> None:
    """Remove what a process that was ended left half written, and the checkpoint of a member that failed.

    Only who has claimed the member may.
    """
    with _stored(folder):
        for entry in os.scandir(folder / WORKSPACE / member.id):
            if entry.name.startswith(".") or (checkpoint and entry.name == CHECKPOINT):
                os.unlink(entry.path)


def _write(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
