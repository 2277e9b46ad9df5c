"""Packings as files.

Three formats, chosen by the ending of the name:

``.npz`` (numpy)
    Everything, exactly: ``position_nd`` (N, d), ``radius_n`` (N,), ``lattice_dd`` (d, d) with the lattice vectors as
    columns, ``format_version`` and, when it is known, ``law`` (a JSON table such as
    ``{"kind": "harmonic", "energy_scale": 1.0}``). A file with the first three arrays alone is read too. A packing with
    links has them as ``link_i_l``, ``link_j_l``, ``link_image_ld``, ``link_length_l`` and ``link_shape_l``, as
    ``pm.Links`` describes them; such a file is of format version 2, so that a reader without links refuses it.
``.gsd`` (HOOMD schema, for freud, OVITO and HOOMD)
    See ``packmech.gsd_file``. Visible to those programs in single precision and in their orientation of the box; the
    exact packing lies beside it in log chunks, so that what packmech wrote it reads back to the last bit. Links are
    shown as bonds and constraints.
``.txt``, ``.dat``, ``.csv`` (plain table)
    Positions and radii only; a packing with links is refused.
    A line ``lattice x y [z]`` for each lattice vector, then a line ``x y [z] radius`` for each particle. Blanks or
    commas separate numbers, ``#`` starts a comment. Numbers get as many digits as they need to be read back exactly::

        lattice 4.0 0.0
        lattice 0.5 4.0
        0.25 0.5 0.5
        1.25 0.5 0.5
"""

from __future__ import annotations

import json
import os
import uuid
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from packmech.box import Box
from packmech.check import instance
from packmech.effects.laws import is_law, registered_laws
from packmech.files.gsd import read_gsd, write_gsd
from packmech.files.records import from_table, kinds_of, to_table
from packmech.links import Links
from packmech.packing import Packing

PathLike = str | os.PathLike[str]
T = TypeVar("T")

# a file without links is of version 1
_FORMAT_VERSION = 2
_LINK_ARRAYS = ("i_l", "j_l", "image_ld", "length_l", "shape_l")
_TEXT = (".txt", ".dat", ".csv")
_ENDINGS = (".npz", ".gsd", *_TEXT)


def read_packing(path: PathLike) -> Packing:
    """Return the packing in a .npz, .gsd or plain text file (of a .gsd trajectory the last frame).

    Parameters
    ----------
    path
        The file; its ending says the format, which the head of ``packmech.files`` describes.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        Naming the file and what is wrong with it or in it.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> packing = pm.lattice_packing("kagome", repeats=(2, 2))
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "kagome.npz"
    >>> pm.write_packing(packing, path)
    >>> pm.read_packing(path) == packing
    True

    """
    found = _existing(path)
    read: Callable[[Path], Packing] = {".npz": _read_npz, ".gsd": read_gsd}.get(_ending(found), _read_text)
    return _in_file(found, lambda: read(found))


def write_packing(packing: Packing, path: PathLike, *, law: Any = None) -> None:
    """Write the packing as .npz, .gsd or plain text, and read back from it the same packing to the last bit.

    Parameters
    ----------
    packing
        The packing.
    path
        The file; its ending says the format. An existing file is replaced, whole or not at all.
    law
        The law between the particles, kept in .npz files so that `packmech analyze` need not ask; None when unknown.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: not a packing, an ending without a format, a folder that does not exist, a law or links in
        a format that has no place for them.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> pm.write_packing(pm.lattice_packing("square"), folder / "square.txt")
    >>> print((folder / "square.txt").read_text().splitlines()[-1])
    0.0 0.0 0.5

    """
    instance("packing", packing, Packing)
    target = target_file(path)
    ending = _ending(target)
    if packing.links is not None and ending in _TEXT:
        raise ValueError(
            f"packing must have no links for {ending} files (only .npz and .gsd keep them), got {len(packing.links)}"
        )
    if law is not None:
        if not is_law(law):
            raise TypeError(f"law must be a law such as Harmonic(...) or None, got {law!r}")
        if ending != ".npz":
            raise ValueError(f"law must be None for {ending} files (only .npz keeps it), got {law!r}")
    with replacing(target) as partial:
        if ending == ".npz":
            _write_npz(packing, partial, law)
        elif ending == ".gsd":
            write_gsd(packing, partial)
        else:
            partial.write_text(_text(packing), encoding="utf-8")


def read_law(path: PathLike) -> Any:
    """Return the law stored with a packing, or None when the file says none.

    Parameters
    ----------
    path
        A packing file. Only .npz files can hold a law.

    Raises
    ------
    FileNotFoundError, ValueError
        As ``read_packing``; also for a law of an unknown kind (register a law of your own with ``pm.law`` first).

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "square.npz"
    >>> pm.write_packing(pm.lattice_packing("square"), path, law=pm.Hertz(energy_scale=2.0))
    >>> pm.read_law(path)
    Hertz(energy_scale=2.0)

    """
    found = _existing(path)
    if _ending(found) != ".npz":
        return None

    def read() -> Any:
        text = _arrays(found).get("law")
        laws = kinds_of(registered_laws())
        return None if text is None else from_table(json.loads(str(text)), "law", laws, {"law": laws})

    return _in_file(found, read)


def target_file(path: PathLike, *, packing: bool = False) -> Path:
    """Return the file to be written, after checking its folder and, for a packing, its ending."""
    target = _named(path)
    if packing:
        _ending(target)
    if not target.parent.is_dir():
        raise ValueError(f"path must lie in an existing folder, got {str(target)!r}")
    return target


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Give a file to write beside the target, of a name of its own, which replaces it in one step once it is whole."""
    partial = target.with_name(f".{target.stem}.{uuid.uuid4().hex}{target.suffix}")
    try:
        yield partial
        os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


def _named(path: PathLike) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name, got {path!r}")
    return Path(path)


def _existing(path: PathLike) -> Path:
    found = _named(path)
    if not found.is_file():
        raise FileNotFoundError(f"path must name an existing file, got {str(path)!r}")
    _ending(found)
    return found


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in _ENDINGS:
        raise ValueError(f"path must end in one of {', '.join(_ENDINGS)}, got {str(path)!r}")
    return ending


def _in_file(path: Path, read: Callable[[], T]) -> T:
    """Return what `read` returns; its errors, of whatever library, become one ValueError that names the file."""
    try:
        return read()
    except (OSError, EOFError, RuntimeError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"path must name a readable packing, got {str(path)!r}: {error}") from error


def _arrays(path: Path) -> dict[str, Any]:
    if not zipfile.is_zipfile(path):  # numpy would take it for pickled objects
        raise ValueError(f"{path.name} is not a .npz file")
    with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    version = arrays.get("format_version", np.array(_FORMAT_VERSION))
    if version.shape != () or version > _FORMAT_VERSION:
        raise ValueError(f"format_version must be at most {_FORMAT_VERSION}, got {version}")
    return arrays


def _read_npz(path: Path) -> Packing:
    arrays = _arrays(path)
    missing = [name for name in ("position_nd", "radius_n", "lattice_dd") if name not in arrays]
    if missing:
        raise ValueError(f"it must hold the arrays {', '.join(missing)}, got {', '.join(arrays) or 'none'}")
    return Packing(arrays["position_nd"], arrays["radius_n"], Box(arrays["lattice_dd"]), _links(arrays))


def _links(arrays: dict[str, Any]) -> Links | None:
    given = [name for name in _LINK_ARRAYS if f"link_{name}" in arrays]
    if not given:
        return None
    missing = [f"link_{name}" for name in _LINK_ARRAYS if name not in given]
    if missing:
        raise ValueError(f"it must hold all arrays of its links, got none named {', '.join(missing)}")
    return Links(*[arrays[f"link_{name}"] for name in _LINK_ARRAYS])


def _write_npz(packing: Packing, path: Path, law: Any) -> None:
    arrays: dict[str, Any] = {
        "format_version": np.array(1 if packing.links is None else _FORMAT_VERSION),
        "position_nd": packing.position_nd,
        "radius_n": packing.radius_n,
        "lattice_dd": packing.box.lattice_dd,
    }
    if packing.links is not None:
        arrays |= {f"link_{name}": getattr(packing.links, name) for name in _LINK_ARRAYS}
    if law is not None:
        arrays["law"] = np.array(json.dumps(to_table(law)))
    with open(path, "wb") as file:
        np.savez(file, **arrays)


def _read_text(path: Path) -> Packing:
    vectors: list[list[float]] = []
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        is_vector = words[0].lower() == "lattice"
        try:
            values = [float(word) for word in words[is_vector:]]
        except ValueError:
            raise ValueError(f"line {number} must hold numbers, got {line.strip()!r}") from None
        if is_vector and len(values) not in (2, 3):
            raise ValueError(f"line {number} must hold a lattice vector of 2 or 3 numbers, got {len(values)}")
        if not is_vector and len(values) != len(vectors) + 1:
            raise ValueError(
                f"line {number} must hold {len(vectors)} coordinates and a radius, after the lines with the lattice "
                f"vectors, got {len(values)} numbers"
            )
        (vectors if is_vector else rows).append(values)
    if len(vectors) not in (2, 3) or any(len(vector) != len(vectors) for vector in vectors):
        raise ValueError(f"it must hold 2 or 3 lines 'lattice x y [z]', as many as coordinates, got {len(vectors)}")
    if not rows:
        raise ValueError("it must hold at least one line 'x y [z] radius', got none")
    table = np.array(rows)
    return Packing(table[:, :-1], table[:, -1], Box(np.array(vectors).T))


def _text(packing: Packing) -> str:
    """Return the plain table; `repr` of a float is the shortest decimal that is read back exactly."""
    axes = "x y z".split()[: packing.dimension]
    lines = [
        f"# packing of {packing.particles} particles: lattice vectors, then {' '.join(axes)} radius of each particle"
    ]
    lines += ["lattice " + " ".join(map(repr, vector)) for vector in packing.box.lattice_dd.T.tolist()]
    table = np.column_stack([packing.position_nd, packing.radius_n])
    lines += [" ".join(map(repr, row)) for row in table.tolist()]
    return "\n".join(lines) + "\n"
