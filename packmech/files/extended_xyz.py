"""Packings as extended xyz, for OVITO and ASE: any lattice, any arrays of particles, trajectories.

Of each frame a line with the number of particles, one with ``Lattice`` (the lattice vectors one after another),
``Properties``, ``pbc`` (``"T T F"`` in two dimensions, where the third lattice vector is of length one and z is 0) and
``Timestep``, then a line for each particle: ``species`` (the field of that name, else X), ``pos``, ``radius``,
``masses`` where given, ``kind`` where there are several, ``aspect`` and ``director`` of ellipses and spheroids, and
fields, those with names of their own as ``velo``, ``spin``, ``forces`` and ``torque``. OVITO draws spheroids by
``aspherical_shape``, semi-axes, and ``orientation``, quaternions, which are written, too, and read of other programs.
Positions need not lie in the cell. Numbers have as many digits as they need to be read back exactly (ASE's own writer
has eight). Not kept are links, tangential displacements, rigid bodies, springs and forces of contacts. Read are also
``radii``, ``diameter``, ``mass``, ``velocities``, ``force``; other columns are fields, and other entries of the second
line are left out, and listed in a warning.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief
from packmech.files import columns
from packmech.files.formats import KINDS, SPHEROIDS, STEP, Format, Given
from packmech.files.orientations import ellipsoids_of, rotations_of, spheroids_of
from packmech.files.snapshot import Snapshot

_ENTRY = re.compile(r"""([A-Za-z_][\w.\-]*|"[^"]*")(?:\s*=\s*("(?:[^"\\]|\\.)*"|'[^']*'|\{[^}]*\}|\[[^\]]*\]|\S+))?""")
_NAMES = {
    "position_nd": "pos",
    "radius_n": "radius",
    "mass_n": "masses",
    "aspect_n": "aspect",
    "director_nd": "director",
    "velocity_nd": "velo",
    "spin_nk": "spin",
    "force_nd": "forces",
    "torque_nk": "torque",
}
_ALIASES = {name: own for own, name in _NAMES.items()} | {
    "positions": "position_nd",
    "radii": "radius_n",
    "mass": "mass_n",
    "vel": "velocity_nd",
    "velocity": "velocity_nd",
    "velocities": "velocity_nd",
    "force": "force_nd",
}
# semi-axes of ellipsoids, and the quaternions that turn these, real part last, as OVITO has them
_SHAPE, _QUATERNION = "aspherical_shape", "orientation"
_VECTORS = ("position_nd", "velocity_nd", "force_nd", "director_nd")
_TURNING = ("spin_nk", "torque_nk")
_LETTERS = {"f": "R", "i": "I", "U": "S"}


def _write(snapshots: Iterable[Snapshot], path: Path) -> None:
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        for snapshot in snapshots:
            file.write("\n".join(_lines(snapshot)) + "\n")


def _lines(snapshot: Snapshot) -> list[str]:
    packing = snapshot.packing
    arrays = columns.arrays_of_particles(snapshot)
    species = arrays.pop("species", np.full(packing.particles, "X"))
    lattice = np.eye(3)
    lattice[: packing.dimension, : packing.dimension] = packing.box.lattice_dd
    table = {"species": species}
    for name, array in arrays.items():
        if name in _VECTORS and packing.dimension == 2:
            array = np.column_stack([array, np.zeros(packing.particles)])
        table[_NAMES.get(name, name)] = array
    ellipsoids = ellipsoids_of(packing)
    if ellipsoids:
        table[_SHAPE], quaternion = ellipsoids
        table[_QUATERNION] = np.roll(quaternion, -1, axis=1)
    widths = {name: 1 if array.ndim == 1 else array.shape[1] for name, array in table.items()}
    properties = ":".join(f"{name}:{_LETTERS[array.dtype.kind]}:{widths[name]}" for name, array in table.items())
    head = [
        f'Lattice="{" ".join(map(repr, lattice.T.ravel().tolist()))}"',
        f"Properties={properties}",
        'pbc="T T F"' if packing.dimension == 2 else 'pbc="T T T"',
    ]
    if snapshot.step is not None:
        head.append(f"Timestep={snapshot.step}")
    flat = [column for array in table.values() for column in (array.T if array.ndim == 2 else [array])]
    return [str(packing.particles), " ".join(head), *columns.lines_of(flat)]


class _Frames:
    """The frames of a file: where each begins, found once."""

    def __init__(self, path: Path, given: Given) -> None:
        self.path, self.given = path, given
        self.start: list[int] = []
        self.line: list[int] = []
        self.count: list[int] = []
        line = 1
        with open(path, "rb") as file:
            while True:
                place, first = file.tell(), file.readline()
                if not first.strip():
                    if not first or not file.read().strip():
                        break
                    raise ValueError(f"line {line} must hold a number of particles, got an empty one")
                try:
                    count = int(first)
                except ValueError:
                    shown = first.decode("utf-8", errors="replace").strip()[:40]
                    raise ValueError(f"line {line} must hold a number of particles, got {brief(shown)}") from None
                if count < 1:
                    raise ValueError(f"line {line} must hold a number of particles above 0, got {count}")
                self.start.append(place)
                self.line.append(line)
                self.count.append(count)
                for k in range(count + 1):
                    if not file.readline():
                        raise ValueError(f"line {line} must be followed by {count + 1} lines, got {k}")
                line += count + 2

    def __len__(self) -> int:
        return len(self.start)

    def frame(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return the snapshot of a frame."""
        with open(self.path, "rb") as file:
            file.seek(self.start[number])
            lines = [file.readline().decode("utf-8", errors="replace") for _ in range(self.count[number] + 2)]
        return _read(lines[1].strip(), lines[2:], self.line[number] + 1, self.given)


def _read(comment: str, body: Sequence[str], at: int, given: Given) -> tuple[Snapshot, list[str]]:
    entries = {
        name.strip('"'): value[1:-1] if value[:1] in ('"', "'", "{", "[") else value
        for name, value in _ENTRY.findall(comment)
    }
    held = {name.lower(): value for name, value in entries.items()}
    arrays = _arrays(held.get("properties", "species:S:1:pos:R:3"), body, at)
    position = arrays.get("position_nd")
    if position is None or position.ndim != 2 or position.shape[1] not in (2, 3):
        raise ValueError(f"line {at} must name a property pos:R:3, got {held.get('properties')!r}")
    box, dimension = _box(held, position, at, given)
    left_out = [
        f"entries {', '.join(others)}"
        for others in [[n for n in entries if n.lower() not in ("lattice", "properties", "pbc", "timestep")]]
        if others
    ]
    for name in _VECTORS:
        if name in arrays and arrays[name].ndim == 2:
            if arrays[name][:, dimension:].any():
                left_out.append(f"{_NAMES[name]} out of the plane")
            arrays[name] = arrays[name][:, :dimension]
    for name in _TURNING:
        if name in arrays and dimension == 2 and arrays[name].ndim == 2:
            if arrays[name][:, :-1].any():
                left_out.append(f"{_NAMES[name]} out of the plane")
            arrays[name] = arrays[name][:, -1:]
    species = arrays.get("species")
    if species is not None and (species == "X").all():
        del arrays["species"]
    if "diameter" in arrays and "radius_n" not in arrays:
        arrays["radius_n"] = 0.5 * arrays.pop("diameter")
    seen = [arrays.pop(name) for name in (_SHAPE, _QUATERNION)] if {_SHAPE, _QUATERNION} <= arrays.keys() else []
    if seen and "director_nd" not in arrays and (seen[0].shape[1:], seen[1].shape[1:]) == ((3,), (4,)):
        arrays["radius_n"], shapes = spheroids_of(seen[0], rotations_of(np.roll(seen[1], 1, axis=1)), dimension)
        arrays |= {"aspect_n": shapes.aspect_n, "director_nd": shapes.director_nd}
    # radii that are given by type are given by species here
    if species is not None and isinstance(given.radius, dict) and "type" not in arrays:
        given = given._replace(radius=given.radii(arrays.pop("radius_n", None), species, len(species)))
    step = held.get("timestep", "")
    return columns.snapshot_of_particles(arrays, box, given, int(step) if step.isdecimal() else None), left_out


def _arrays(properties: str, body: Sequence[str], at: int) -> dict[str, NDArray[Any]]:
    parts = properties.split(":")
    if len(parts) % 3 or not all(part.isdecimal() and int(part) for part in parts[2::3]):
        raise ValueError(f"line {at} must hold Properties=name:type:columns:..., got {brief(properties)}")
    kinds = list(zip(parts[::3], parts[1::3], map(int, parts[2::3]), strict=True))
    wrong = next((kind for _, kind, _ in kinds if kind not in "SRIL"), None)
    if wrong is not None:
        raise ValueError(f"line {at} must hold properties of the types S, R, I or L, got {brief(wrong)}")
    rows = columns.rows_of(body, sum(width for _, _, width in kinds), at + 1, properties)
    words = list(zip(*rows, strict=True))
    found: dict[str, NDArray[Any]] = {}
    place = 0
    for name, kind, width in kinds:
        own, place = words[place : place + width], place + width
        if kind == "S":
            table = [np.array(one, dtype=np.str_) for one in own]
        elif kind == "L":
            table = [np.array([word[0].upper() == "T" for word in one]).astype(np.int64) for one in own]
        else:
            table = [columns.numbers_of(name, one, at + 1) for one in own]
            table = [one.astype(np.float64) if kind == "R" else one for one in table]
        array = table[0] if width == 1 else np.column_stack(table)
        found[_ALIASES.get(name, name)] = array[:, None] if width == 1 and _ALIASES.get(name) in _TURNING else array
    return found


def _box(held: dict[str, str], position: NDArray[np.float64], at: int, given: Given) -> tuple[Box, int]:
    """Return the box, and how many dimensions it has: two where it is not periodic along z, and z is 0."""
    if "lattice" not in held:
        if given.box is None:
            raise ValueError(f"line {at} must hold Lattice=..., got none: give the periodic box as box=")
        return given.box, given.box.dimension
    words = held["lattice"].replace(",", " ").split()
    lattice = columns.numbers_of("a component of Lattice", words, at, [at] * len(words))
    if len(lattice) not in (4, 9):
        raise ValueError(f"line {at} must hold a Lattice of 9 numbers, got {len(lattice)}")
    vectors = lattice.reshape(2, 2).T if len(lattice) == 4 else lattice.reshape(3, 3).T
    periodic = [word.strip().upper()[:1] in ("T", "1") for word in held.get("pbc", "T T T").replace(",", " ").split()]
    if len(lattice) == 4:
        periodic = [*periodic[:2], False]
    flat = position.shape[1] == 2 or not position[:, 2].any()
    alone = len(lattice) == 4 or not (vectors[2, :2].any() or vectors[:2, 2].any())
    d = 2 if periodic == [True, True, False] and flat and alone else 3
    is_periodic = d == 2 or periodic == [True] * 3
    if not is_periodic and given.box is None:
        raise ValueError(
            f"line {at} must hold a box that is periodic along each axis (along x and y only where z is 0), got pbc "
            f"{held.get('pbc')!r}: give the periodic box as box="
        )
    box = given.box_in(Box(vectors[:d, :d]) if is_periodic else None)
    return box, box.dimension


def _field(name: str, array: NDArray[Any]) -> bool:
    texts = [name, *(array.tolist() if array.dtype.kind == "U" else [])]
    blank = any(not text or set(text) & set(" \t\n\r\v\f") for text in texts)
    return (
        not blank
        and not set(name) & set(":\"'=")
        and (name in _NAMES or name not in (*_ALIASES, "diameter", columns.KIND, _SHAPE, _QUATERNION))
    )


EXTXYZ = Format(
    "extxyz", (".extxyz", ".xyz"), frozenset((SPHEROIDS, KINDS, STEP)), _Frames, _write, many=True, field=_field
)
