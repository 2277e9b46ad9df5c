"""Checkpoints: the one file format in which work is kept, written whole or not at all, and checked before it is used.

A checkpoint is a .npz file that numpy reads. Its array ``checkpoint_json`` is the head: the version of the format, that
of packmech, the kind of work and its settings. The comment of the archive ends the file and holds the SHA-256 of all
bytes before it, so that no byte can change unnoticed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

import packmech
from packmech.files.archive import UNREADABLE
from packmech.files.paths import existing_file, file_name, replacing, writable_file
from packmech.jit.source_key import source_key
from packmech.scene import Scene

Arrays = dict[str, NDArray[Any]]

ENDING = ".npz"
_VERSION = 2
_HEAD = "checkpoint_json"
_SEAL = b"packmech checkpoint; SHA-256 of all bytes before: "
_DIGITS = 64


class Checkpoint(NamedTuple):
    """What is in a file: settings as JSON knows them, and arrays by name."""

    settings: dict[str, Any]
    arrays: Arrays


class IndexBounds(NamedTuple):
    """What a saved array of integers may hold: low <= entry < high, in this shape (None: any length)."""

    low: int
    high: int
    shape: tuple[int | None, ...]


def check_path(path: Any) -> Path:
    """Return the file to write checkpoints to, or say what is wrong with it."""
    target = file_name("checkpoint", path)
    if target.suffix != ENDING:
        raise ValueError(f"checkpoint must end in {ENDING}, got {str(path)!r}")
    return writable_file("checkpoint", target)


def check_indices(arrays: Mapping[str, Any], bounds: Mapping[str, IndexBounds]) -> None:
    """Refuse arrays of integers that are not declared, or are not what they were declared to be.

    Parameters
    ----------
    arrays
        Arrays by name, about to be written or restored.
    bounds
        The declaration; what it names may be missing.

    Raises
    ------
    ValueError
        Naming the array, what is required and what was given.

    Examples
    --------
    >>> check_indices({"i_c": np.array([0, 3])}, {"i_c": IndexBounds(0, 3, (None,))})
    Traceback (most recent call last):
    ...
    ValueError: i_c must be at least 0 and below 3, got 3

    """
    for name, array in arrays.items():
        bound = bounds.get(name)
        if bound is None:
            if array.dtype.kind not in "fbU":
                raise ValueError(f"{name} must be declared with its bounds, as all arrays of {array.dtype} are")
            continue
        if array.dtype != np.int64:
            raise ValueError(f"{name} must be of kind int64, got {array.dtype}")
        fits = array.ndim == len(bound.shape)
        if not fits or any(want not in (None, have) for want, have in zip(bound.shape, array.shape, strict=True)):
            raise ValueError(f"{name} must have shape {bound.shape}, got {array.shape}")
        bad = (array < bound.low) | (array >= bound.high)
        if bad.any():
            raise ValueError(f"{name} must be at least {bound.low} and below {bound.high}, got {array[bad].flat[0]}")


def saved_array(arrays: Mapping[str, Any], name: str, shape: Sequence[int | None]) -> NDArray[np.float64]:
    """Return a saved array of floats after checking that it is there, in this shape (None: any length).

    Examples
    --------
    >>> saved_array({"x_nd": np.zeros((3, 2))}, "x_nd", (4, 2))
    Traceback (most recent call last):
    ...
    ValueError: x_nd must be float64 of shape (4, 2), got float64 of (3, 2)

    """
    array = np.asarray(arrays[name])
    fits = array.dtype == np.float64 and array.ndim == len(shape)
    if not fits or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name} must be float64 of shape {tuple(shape)}, got {array.dtype} of {array.shape}")
    return array


def write_checkpoint(path: Path, kind: str, settings: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Replace the file in one step, so that it is always a whole checkpoint.

    Parameters
    ----------
    path
        The file.
    kind
        What it is a checkpoint of.
    settings
        What JSON knows: numbers, texts, lists and tables.
    arrays
        Arrays by name.

    Raises
    ------
    OSError
        If the file cannot be written; the one that was there stays.

    """
    head = json.dumps({"version": _VERSION, "packmech": packmech.__version__, "kind": kind, "settings": settings})
    whole = io.BytesIO()
    np.savez(whole, allow_pickle=False, **{_HEAD: np.array(head)}, **arrays)
    # the last two bytes are the length of a comment that is yet empty
    whole.seek(-2, io.SEEK_END)
    whole.write((len(_SEAL) + _DIGITS).to_bytes(2, "little") + _SEAL)
    with whole.getbuffer() as content, replacing(path) as partial, open(partial, "wb") as file:
        file.write(content)
        file.write(hashlib.sha256(content).hexdigest().encode())
        file.flush()
        os.fsync(file.fileno())


def read_checkpoint(path: Any, kind: str, *, argument: str = "path") -> Checkpoint:
    """Return what is in a checkpoint.

    Parameters
    ----------
    path
        The file.
    kind
        What it must be a checkpoint of.
    argument
        Name of the caller's argument, for messages.

    Raises
    ------
    TypeError, FileNotFoundError, ValueError
        If it is no file name, no file, or no checkpoint of this kind and version, unchanged since it was written.

    """
    found = existing_file(argument, path)
    try:
        head, arrays = _read(found.read_bytes())
    except UNREADABLE as reason:
        raise ValueError(f"{argument} must name a checkpoint, got {str(path)!r}: {reason}") from reason
    if head["kind"] != kind:
        raise ValueError(f"{argument} must name a checkpoint of {kind}, got {str(path)!r}, one of {head['kind']}")
    return Checkpoint(head["settings"], arrays)


def _read(content: bytes) -> tuple[dict[str, Any], Arrays]:
    """Return the head and the arrays of a file of this version."""
    if not content.startswith(b"PK"):
        raise ValueError("it is not a .npz file")
    before, digest = content[:-_DIGITS], content[-_DIGITS:]
    sealed = before.endswith(_SEAL)
    if sealed and hashlib.sha256(before).hexdigest().encode() != digest:
        raise ValueError("its checksum must be that of its bytes, got another: it was changed after it was written")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        if _HEAD not in archive.files:
            raise ValueError(f"it must hold {_HEAD}, got {', '.join(archive.files[:3])} ...")
        head = json.loads(str(archive[_HEAD]))
        for name, own in (("version", _VERSION), ("packmech", packmech.__version__)):
            if head.get(name) != own:
                raise ValueError(f"{name} must be {own}, got {head.get(name)}")
        if not sealed:
            raise ValueError("it must end in its checksum, got none")
        if not isinstance(head["kind"], str) or not isinstance(head["settings"], dict):
            raise ValueError("its head must hold a kind and settings, got others")
        return head, {name: archive[name] for name in archive.files if name != _HEAD}


# classes whose sources do not tell results apart
_OURS = ("builtins", "numpy", "packmech")


def fingerprint(value: Any) -> str:
    """Return a hash of arrays, numbers, texts and records of them: the same for equal values in any process."""
    taken = hashlib.sha256()
    _take(value, taken)
    return taken.hexdigest()


def _take(value: Any, taken: Any) -> None:
    if isinstance(value, np.ndarray):
        taken.update(f"{value.dtype}{value.shape}".encode())
        taken.update(np.ascontiguousarray(value).tobytes())
        return
    kind: Any = type(value)
    taken.update(f"{kind.__module__}.{kind.__qualname__};".encode())
    if kind.__module__.partition(".")[0] not in _OURS:
        # a law of a user's own, whose methods may have been edited
        taken.update(str(source_key(kind)).encode())
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            taken.update(field.name.encode())
            _take(getattr(value, field.name), taken)
    elif isinstance(value, tuple | list):
        for part in value:
            _take(part, taken)
    else:
        taken.update(repr(value).encode())


def scene_fingerprints(scene: Scene) -> dict[str, str]:
    """Return hashes of the packing and of each effect, by name: the same for equal scenes in any process.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(law=pm.Harmonic()),))
    >>> other = scene.replace(effects=(pm.Repulsion(law=pm.Hertz()),))
    >>> one, two = scene_fingerprints(scene), scene_fingerprints(other)
    >>> one["packing"] == two["packing"], one["effects[0]"] == two["effects[0]"]
    (True, False)

    """
    packing = scene.packing
    links = packing.links
    named = (links.i_l, links.j_l, links.image_ld, links.length_l, links.shape_l) if links else ()
    masses = () if packing.given_mass_n is None else (packing.given_mass_n,)
    kinds = () if packing.given_kind_n is None else (packing.given_kind_n,)
    springs = packing.tangential
    tangential = () if springs is None else springs.arrays()
    shapes = (packing.shapes,) if packing.shapes.has_orientations else ()
    # what a packing has beside positions, radii and the box
    beside = (*named, *masses, *tangential, *shapes, *kinds)
    arrays = packing.position_nd, packing.radius_n, packing.box.lattice_dd, *beside
    found = {"packing": fingerprint(arrays)}
    return found | {f"effects[{k}]": fingerprint(one) for k, one in enumerate(scene.effects)}


def check_scene(scene: Scene, fingerprints: Mapping[str, str]) -> None:
    """Raise ValueError, naming the part that differs, unless the scene is the one of these fingerprints."""
    own = scene_fingerprints(scene)
    for name in sorted(set(own) | set(fingerprints), key=lambda one: (one != "packing", one)):
        if own.get(name) != fingerprints.get(name):
            raise ValueError(f"scene must be the one that the checkpoint was made of, got one that differs in {name}")


class Restorable(Protocol):
    """What a checkpoint keeps: arrays of what cannot be rebuilt, those of integers declared with their bounds."""

    def arrays(self) -> Arrays:
        """Return everything that must be kept."""

    def index_bounds(self) -> Mapping[str, IndexBounds]:
        """Return what each of the arrays of integers may hold."""

    def restore(self, kept: Arrays) -> None:
        """Go on from what was kept; raise ValueError for what is missing or cannot be."""


def restore_from(arrays: Arrays, run: Restorable, argument: str, path: Any) -> None:
    """Put a run where a checkpoint has it, after checking that no index leads out of its array.

    Raises
    ------
    ValueError
        If it cannot be what such a run left, naming the argument, the file and what is wrong in it.

    """
    with damage_refused(argument, path):
        check_indices(arrays, run.index_bounds())
        run.restore(arrays)


@contextmanager
def damage_refused(argument: str, path: Any) -> Iterator[None]:
    """Turn what goes wrong while a run is made of a checkpoint into one error.

    Raises
    ------
    ValueError
        Naming the argument, the file and what is wrong in it.

    """
    try:
        yield
    except UNREADABLE as reason:
        words = f"it must hold {reason}, got none" if isinstance(reason, KeyError) else str(reason)
        raise ValueError(f"{argument} must hold a run that can go on, got {str(path)!r}: {words}") from reason


class RunsFile:
    """The checkpoint of one call, or of several that follow each other: a run after the other, each with its settings.

    A run that is in the file already is taken from it, whether it was finished or not, if its settings are the same.

    Parameters
    ----------
    path
        The file. It need not be there yet.
    kind
        What kind of runs it holds.

    Raises
    ------
    TypeError, ValueError
        If it cannot be written, or is there and holds something else.

    """

    def __init__(self, path: str | os.PathLike[str], kind: str) -> None:
        self.path: Path = check_path(path)
        self.kind = kind
        self.settings: list[dict[str, str]] = []
        self.finished: list[bool] = []
        self.arrays: list[Arrays] = []
        # runs that were asked for so far; the last of them is the one that goes on
        self.begun = 0
        if self.path.exists():
            found, arrays = read_checkpoint(self.path, kind, argument="checkpoint")
            try:
                self.settings, self.finished = [dict(one) for one in found["runs"]], list(found["finished"])
                if len(self.finished) != len(self.settings):
                    raise ValueError(
                        f"finished must be of length {len(self.settings)}, as runs are, got {len(self.finished)}"
                    )
                self.arrays = [{} for _ in self.settings]
                for name, value in arrays.items():
                    run, _, rest = name.partition(".")
                    self.arrays[int(run)][rest] = value
            except UNREADABLE as reason:
                raise ValueError(f"checkpoint must hold runs, got {str(self.path)!r}: {reason}") from reason

    def begin(self, run: Restorable, settings: Mapping[str, Any]) -> bool:
        """Take up the run whose turn it is: put it where the file has it; return whether it does.

        Raises
        ------
        ValueError
            If what is kept is of other settings, or cannot be what such a run left.

        """
        own = {name: fingerprint(value) for name, value in settings.items()}
        turn, self.begun = self.begun, self.begun + 1
        if turn == len(self.settings):
            self.settings.append(own)
            self.finished.append(False)
            self.arrays.append({})
            return False
        kept = self.settings[turn]
        others = [name for name in {**kept, **own} if kept.get(name) != own.get(name)]
        if others:
            raise ValueError(
                f"checkpoint must hold a run of the same scene and settings, or be no file yet, got {str(self.path)!r} "
                f"with another {', another '.join(others)}; without that file the work begins from the start"
            )
        if not self.arrays[turn]:
            return False
        restore_from(self.arrays[turn], run, "checkpoint", self.path)
        return True

    def write(self, run: Restorable, *, finished: bool) -> None:
        """Write the file with the run that goes on as it is now; one that was finished before stays as it was."""
        turn = self.begun - 1
        if self.finished[turn]:
            return
        arrays = run.arrays()
        check_indices(arrays, run.index_bounds())
        whole = {
            f"{run}.{name}": value
            for run, part in enumerate([*self.arrays[:turn], arrays, *self.arrays[turn + 1 :]])
            for name, value in part.items()
        }
        done = [*self.finished[:turn], finished, *self.finished[turn + 1 :]]
        write_checkpoint(self.path, self.kind, {"runs": self.settings, "finished": done}, whole)
        self.arrays[turn], self.finished[turn] = arrays, finished
