"""Checkpoints: the full state of a simulation in one file, written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from packmech.dynamics.march.checkpoint import Leaves, leaves, march_leaves, regrown, restore_march
from packmech.dynamics.march.journey import Marching
from packmech.files import replacing
from packmech.scene import Scene

ENDING = ".npz"
_VERSION = 1
_HEAD = "checkpoint_json"
# arrays of a program that change, in the order in which they must be restored
_ROWS = ("home_nd", "row", "force_nd", "velocity_nd")


class Checkpoint(NamedTuple):
    """What is in a file: settings as JSON knows them, and arrays by name."""

    told: dict[str, Any]
    arrays: dict[str, Any]


def check_path(path: Any) -> Path:
    """Return the file to write checkpoints to, or say what is wrong with it."""
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"checkpoint must be a file name, got {path!r}")
    target = Path(path)
    if target.suffix != ENDING:
        raise ValueError(f"checkpoint must end in {ENDING}, got {str(path)!r}")
    if not target.parent.is_dir():
        raise ValueError(f"checkpoint must lie in an existing folder, got {str(path)!r}")
    return target


def scene_marks(scene: Scene) -> dict[str, str]:
    """Return hashes of the packing and of each effect, by name: the same for equal scenes in any process.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(law=pm.Harmonic()),))
    >>> other = scene.replace(effects=(pm.Repulsion(law=pm.Hertz()),))
    >>> one, two = scene_marks(scene), scene_marks(other)
    >>> one["packing"] == two["packing"], one["effects[0]"] == two["effects[0]"]
    (True, False)

    """
    packing = scene.packing
    links = packing.links
    named = () if links is None else (links.i_l, links.j_l, links.image_ld, links.length_l, links.shape_l)
    marks = {"packing": mark((packing.position_nd, packing.radius_n, packing.box.lattice_dd, *named))}
    return marks | {f"effects[{k}]": mark(one) for k, one in enumerate(scene.effects)}


def mark(value: Any) -> str:
    """Return a hash of arrays, numbers, texts and records of them: the same for equal values in any process."""
    taken = hashlib.sha256()
    _take(value, taken)
    return taken.hexdigest()


def _take(value: Any, taken: Any) -> None:
    if isinstance(value, np.ndarray):
        taken.update(f"{value.dtype}{value.shape}".encode())
        taken.update(np.ascontiguousarray(value).tobytes())
        return
    taken.update(f"{type(value).__module__}.{type(value).__qualname__};".encode())
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            taken.update(field.name.encode())
            _take(getattr(value, field.name), taken)
    elif isinstance(value, tuple | list):
        for part in value:
            _take(part, taken)
    else:
        taken.update(repr(value).encode())


def write_checkpoint(path: Path, told: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Replace the file in one step, so that it is always a whole checkpoint.

    Parameters
    ----------
    path
        The file.
    told
        Settings as JSON knows them.
    arrays
        Arrays by name.

    """
    head = json.dumps({"version": _VERSION, **told})
    with replacing(path) as partial, open(partial, "wb") as file:
        np.savez(file, allow_pickle=False, **{_HEAD: np.array(head)}, **arrays)
        file.flush()
        os.fsync(file.fileno())


def read_checkpoint(path: Any) -> Checkpoint:
    """Return what is in a checkpoint.

    Raises
    ------
    TypeError, FileNotFoundError, ValueError
        If it is no file name, no file, or no checkpoint of a version that is known.

    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name, got {path!r}")
    found = Path(path)
    if not found.is_file():
        raise FileNotFoundError(f"path must name an existing file, got {str(path)!r}")
    try:
        if not zipfile.is_zipfile(found):
            raise ValueError("it is not a .npz file")
        with open(found, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if _HEAD not in arrays:
            raise ValueError(f"it must hold {_HEAD}, got {', '.join(list(arrays)[:3])} ...")
        told = json.loads(str(arrays.pop(_HEAD)))
        if told.get("version") != _VERSION:
            raise ValueError(f"version must be {_VERSION}, got {told.get('version')!r}")
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"path must name a checkpoint, got {str(path)!r}: {error}") from error
    return Checkpoint(told, arrays)


def check_scene(scene: Scene, marks: Mapping[str, str]) -> None:
    """Raise ValueError, naming the part that differs, unless the scene is the one of these marks."""
    own = scene_marks(scene)
    for name in sorted(set(own) | set(marks), key=lambda one: (one != "packing", one)):
        if own.get(name) != marks.get(name):
            raise ValueError(f"scene must be the one that the checkpoint was made of, got one that differs in {name}")


def engine_leaves(motion: Any) -> Leaves:
    """Return everything that changes on the way of a simulation, by name.

    Parameters
    ----------
    motion
        A `Marching` or a `Motion`.

    """
    if isinstance(motion, Marching):
        return {**march_leaves(motion.march), "force_evaluations": np.array(motion.force_evaluations)}
    program = motion.program
    found: Leaves = {name: getattr(program, name).copy() for name in _ROWS}
    found |= leaves(program.pairs, "pairs") | leaves(program.space, "space") | leaves(motion.rattle, "rattle")
    return found | {"steps": np.array(motion.steps), "force_evaluations": np.array(motion.force_evaluations)}


def restore_engine(motion: Any, saved: Mapping[str, Any]) -> None:
    """Put a simulation, built anew for the same scene and settings, where the saved one was.

    Parameters
    ----------
    motion
        A `Marching` or a `Motion`.
    saved
        What `engine_leaves` returned.

    """
    if isinstance(motion, Marching):
        restore_march(motion.march, saved)
        motion.force_evaluations = int(saved["force_evaluations"])
        return
    program = motion.program
    for name in _ROWS:
        regrown(getattr(program, name), name, saved, in_place=True)
    # images of links go with the places of particles; parts of what links need share their arrays
    program.join()
    motion.affix()
    program.row[:] = saved["row"]
    program.pairs = regrown(program.pairs, "pairs", saved)
    program.space = regrown(program.space, "space", saved, in_place=True)
    motion.rattle = regrown(motion.rattle, "rattle", saved, in_place=True)
    motion.steps, motion.force_evaluations = int(saved["steps"]), int(saved["force_evaluations"])
