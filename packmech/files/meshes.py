"""Surfaces of triangles from files, read by trimesh (the extra `meshes`)."""

from __future__ import annotations

import importlib
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.status import shown_as
from packmech.check import boolean, clear_errors, positive
from packmech.effects.mesh import flat_triangles
from packmech.files.paths import existing_file


class Mesh(NamedTuple):
    """A surface of triangles: (V, 3) corners [length], and the (T, 3) numbers of the corners of each triangle."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]


@clear_errors
@shown_as("reading")
def read_mesh(path: str | os.PathLike[str], *, scale: float = 1.0, drop_flat: bool = False) -> Mesh:
    """Return the triangles in a file of a surface: STL (binary or text), OBJ, PLY, OFF and others that trimesh reads.

    Corners at the same place are one. `pm.MeshWalls(*pm.read_mesh("hopper.stl"))` makes walls of it.

    Parameters
    ----------
    path
        The file.
    scale
        Length that one unit of the file stands for [length]; STL files have no units.
    drop_flat
        Leave out triangles without an area, whose corners are the same or in a row: walls refuse them.

    Raises
    ------
    ModuleNotFoundError
        If trimesh is not installed: it is the extra `meshes`.
    TypeError, ValueError
        If an argument is wrong, or the file holds no triangles, or none with an area where the others are left out.
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "corner.off"
    >>> _ = path.write_text(chr(10).join(["OFF", "3 1 0", "0 0 0", "1 0 0", "0 1 0", "3 0 1 2"]))
    >>> float(read_mesh(path, scale=2.0).vertices.max())
    2.0

    """
    file = existing_file("path", path)
    positive("scale", scale)
    boolean("drop_flat", drop_flat)
    try:
        trimesh: Any = importlib.import_module("trimesh")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "pm.read_mesh reads surfaces by trimesh, which is not there: pip install 'packmech[meshes]'"
        ) from error
    try:
        found = trimesh.load(file, force="mesh", process=False)
        vertex, number = np.asarray(found.vertices, dtype=np.float64), np.asarray(found.faces, dtype=np.int64)
    except Exception as error:  # readers of many formats, each with errors of its own
        raise ValueError(f"path must name a file of triangles, got {str(file)!r}: {error}") from error
    if not len(number):
        raise ValueError(f"path must name a file of triangles, got none in {str(file)!r}")
    corner, same = np.unique(vertex, axis=0, return_inverse=True)
    number = np.reshape(same, -1)[number].astype(np.int64)
    if drop_flat:
        number = number[~flat_triangles(corner[number])]
        if not len(number):
            raise ValueError(f"path must name a file of triangles, got none with an area in {str(file)!r}")
    return Mesh(scale * corner, number)
