"""Arrays of particles as columns of text, and back: tables, LAMMPS dumps, extended xyz."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief
from packmech.files.formats import Given
from packmech.files.snapshot import Snapshot
from packmech.packing import MOST_KINDS, Packing
from packmech.shapes import Spheroids

# arrays by their names in a snapshot, and what their columns are called, as in LAMMPS
VECTORS = {
    "position_nd": ("x", "y", "z"),
    "director_nd": ("director_x", "director_y", "director_z"),
    "velocity_nd": ("vx", "vy", "vz"),
    "spin_nk": ("omegax", "omegay", "omegaz"),
    "force_nd": ("fx", "fy", "fz"),
    "torque_nk": ("tqx", "tqy", "tqz"),
}
SCALARS = {"radius_n": "radius", "mass_n": "mass", "aspect_n": "aspect"}
# the column of kinds; other numbers and words in a column of that name are a field
KIND = "kind"
_NUMBERED = re.compile(r"(.+)\[(\d+)\]$")
_WHOLE = re.compile(r"[+-]?\d{1,19}$")


def arrays_of_particles(snapshot: Snapshot) -> dict[str, NDArray[Any]]:
    """Return positions, radii, given masses, kinds, aspects and directors of spheroids, and fields, by name."""
    packing = snapshot.packing
    found: dict[str, NDArray[Any]] = {"position_nd": packing.position_nd, "radius_n": packing.radius_n}
    if packing.given_mass_n is not None:
        found["mass_n"] = packing.given_mass_n
    if packing.given_kind_n is not None:
        found[KIND] = packing.given_kind_n
    if isinstance(packing.shapes, Spheroids):
        found |= {"aspect_n": packing.shapes.aspect_n, "director_nd": packing.shapes.director_nd}
    return found | dict(snapshot.fields)


def snapshot_of_particles(
    arrays: Mapping[str, NDArray[Any]], box: Box, given: Given, step: int | None = None
) -> Snapshot:
    """Return the snapshot of such arrays; those that are no packing's are its fields."""
    rest = dict(arrays)
    position, mass = rest.pop("position_nd"), rest.pop("mass_n", None)
    radius = given.radii(rest.pop("radius_n", None), rest.get("type"), len(position))
    aspect, director = rest.pop("aspect_n", None), rest.pop("director_nd", None)
    if (aspect is None) != (director is None):
        raise ValueError("it must hold aspects and directors of its particles, got one of them alone")
    shapes = None if aspect is None or director is None else Spheroids(aspect, director)
    kind = rest.pop(KIND) if KIND in rest and are_kinds(rest[KIND]) else None
    return Snapshot(Packing(position, radius, box, mass_n=mass, shapes=shapes, kind_n=kind), rest, step=step)


def are_kinds(column: NDArray[Any]) -> bool:
    """Return whether these are numbers that kinds of particles can have."""
    whole = column.dtype.kind in "iu" and column.ndim == 1
    return whole and bool(((column >= 0) & (column < MOST_KINDS)).all())


def flat(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays as columns by their names."""
    found: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        if name in VECTORS:
            own = VECTORS[name][-1:] if array.shape[1] == 1 else VECTORS[name]
            found |= dict(zip(own, array.T, strict=False))
        elif array.ndim == 1:
            found[SCALARS.get(name, name)] = array
        else:
            found |= {f"{name}[{k + 1}]": column for k, column in enumerate(array.T)}
    return found


def grouped(columns: Mapping[str, NDArray[Any]], dimension: int) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return columns as arrays by the names of a snapshot, and the columns that leave the plane, which are left out."""
    rest, found = dict(columns), {}
    left_out: list[str] = []
    for name, own in VECTORS.items():
        held = [one for one in own if one in rest]
        if not held:
            continue
        turning = name in ("spin_nk", "torque_nk") and dimension == 2
        wanted = own[-1:] if turning else own[:dimension]
        if any(one not in rest for one in wanted):
            continue  # half a vector: each column is a field of its own
        found[name] = np.column_stack([rest.pop(one) for one in wanted]).astype(np.float64)
        for one in held:
            if one in rest and np.any(rest.pop(one) != 0):
                left_out.append(f"column {one}, out of the plane")
    for name, one in SCALARS.items():
        if one in rest:
            found[name] = rest.pop(one).astype(np.float64)
    if "diameter" in rest and "radius_n" not in found:
        found["radius_n"] = 0.5 * rest.pop("diameter").astype(np.float64)
    numbered: dict[str, dict[int, NDArray[Any]]] = {}
    for one in list(rest):
        match = _NUMBERED.match(one)
        if match:
            numbered.setdefault(match[1], {})[int(match[2])] = rest.pop(one)
    for name, parts in numbered.items():
        if sorted(parts) == list(range(1, len(parts) + 1)) and name not in rest:
            found[name] = np.column_stack([parts[k] for k in sorted(parts)])
        else:
            rest |= {f"{name}[{k}]": part for k, part in parts.items()}
    return found | rest, left_out


def text_of(column: NDArray[Any]) -> list[str]:
    """Return the entries of a column as text; `repr` of a float is the shortest decimal that is read back exactly."""
    return [one if isinstance(one, str) else repr(one) for one in column.tolist()]


def lines_of(columns: Sequence[NDArray[Any]], separator: str = " ") -> list[str]:
    """Return the rows of a table as lines."""
    return [separator.join(row) for row in zip(*map(text_of, columns), strict=True)]


def number(word: str) -> float:
    """Return the number that is written; Fortran's exponents D are taken, too."""
    if "_" in word:  # Python's own way to group digits
        raise ValueError(f"{word!r} is no number")
    try:
        return float(word)
    except ValueError:
        return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", word))


def column_of(words: Sequence[str]) -> NDArray[Any]:
    """Return a column: of integers where all words are, else of numbers, else of the words."""
    if all(_WHOLE.match(word) for word in words):
        whole = [int(word) for word in words]
        if -(2**63) <= min(whole, default=0) and max(whole, default=0) < 2**63:
            return np.array(whole, dtype=np.int64)
    try:
        return np.array([number(word) for word in words])
    except ValueError:
        return np.array(words, dtype=np.str_)


def numbers_of(name: str, words: Sequence[str], first_line: int, lines: Sequence[int] | None = None) -> NDArray[Any]:
    """Return a column that must hold numbers; an error names the line, the first being `first_line`."""
    found = column_of(words)
    if found.dtype.kind == "U":
        for k, word in enumerate(words):
            try:
                number(word)
            except ValueError:
                line = first_line + k if lines is None else lines[k]
                raise ValueError(f"line {line} must hold a number as {name}, got {brief(word)}") from None
    return found


def rows_of(
    lines: Sequence[str], width: int, first_line: int, what: str, separator: str | None = None
) -> list[list[str]]:
    """Return lines as words, as many in each; an error names the line."""
    rows = [line.split(separator) for line in lines]
    for k, row in enumerate(rows):
        if len(row) != width:
            raise ValueError(f"line {first_line + k} must hold {width} words ({what}), got {len(row)}")
    return rows


# columns whose words are numbers in any file
NUMBERS = frozenset(name for own in VECTORS.values() for name in own) | {"radius", "mass", "diameter", "aspect"}
# names that readers know besides
_OTHERS = frozenset(
    f"id {KIND} ix iy iz xu yu zu xs ys zs xsu ysu zsu r d m lattice shapex shapey shapez".split()
    + "quatw quati quatj quatk".split()
)


def columns_of(
    names: Sequence[str], rows: Sequence[Sequence[str]], first_line: int, lines: Sequence[int] | None = None
) -> dict[str, NDArray[Any]]:
    """Return the columns of rows of words by their names."""
    found = {}
    for name, words in zip(names, zip(*rows, strict=True), strict=True):
        found[name] = numbers_of(name, words, first_line, lines) if name in NUMBERS else column_of(words)
    return found


def can_be_column(name: str, array: NDArray[Any], unwanted: str) -> bool:
    """Return whether a field is read back from columns of text as it was: names and words without such characters.

    Nor must its name be that of other columns, or words look like numbers.
    """
    if name not in VECTORS and (name in NUMBERS or name in _OTHERS or _NUMBERED.match(name)):
        return False
    texts = [name, *(array.tolist() if array.dtype.kind == "U" else [])]
    if any(not text.strip() or text != text.strip() or set(text) & set(unwanted) for text in texts):
        return False
    return array.dtype.kind != "U" or column_of(array.tolist()).dtype.kind == "U"
