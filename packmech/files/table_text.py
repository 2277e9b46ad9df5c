"""Packings as tables of plain text: a line for each particle, with or without a header.

``.txt``, ``.dat``: a line ``lattice x y [z]`` for each lattice vector, then a line ``x y [z] radius [mass]`` for each
particle, with masses in all lines or in none (and named in a comment then)::

    lattice 4.0 0.0
    lattice 0.5 4.0
    0.25 0.5 0.5
    1.25 0.5 0.5

``.csv``: the lattice vectors, and the step, as comments; a header; a row for each particle::

    # lattice 4.0 0.0
    # lattice 0.5 4.0
    x,y,radius,vx,vy
    0.25,0.5,0.5,0.0,0.0

Either way of writing is read under any of the endings: with a header or without; blanks, tabs, commas or semicolons
between numbers (with semicolons a comma may be the decimal point); in UTF-8, with a byte-order mark or not, or else
Latin-1; with Fortran's exponents D. Columns are ``x y z``, ``radius`` (``r``, ``diameter``, ``d``), ``mass`` (``m``),
``kind``, ``aspect``, ``director_x``, ...; others are fields. A unit in brackets after a blank, ``x [mm]``, is no part
of a name. Plain tables are written without kinds of particles: those of several kinds are refused.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief
from packmech.files import columns
from packmech.files.formats import KINDS, SPHEROIDS, STEP, Format, Given, One
from packmech.files.snapshot import Snapshot

# what other programs call columns, in small letters
_ALIASES = {"r": "radius", "d": "diameter", "m": "mass"}
_WIDTHS = {2: "x y", 3: "x y z"}


def _decoded(path: Path) -> str:
    content = path.read_bytes()
    if b"\x00" in content:
        raise ValueError("it must be text, got zero bytes")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _is_number(word: str) -> bool:
    try:
        columns.number(word)
    except ValueError:
        return False
    return True


def _separator(line: str, header: bool) -> str | None:
    """Return what separates the words of a line; None for blanks, and commas where no header says otherwise."""
    for one in (";", "\t", ","):
        if one in line and (header or one == ";"):
            return one
    return None


class _Reader:
    """The lines of a table as they are read."""

    def __init__(self, given: Given) -> None:
        self.given = given
        self.vectors: list[list[float]] = []
        self.names: list[str] | None = None
        self.separator: str | None = None
        self.rows: list[list[str]] = []
        self.lines: list[int] = []
        self.has_masses = False
        self.step: int | None = None

    def words(self, line: str) -> list[str]:
        """Return the words of a line of the table."""
        if self.separator is None:
            return line.replace(",", " ").split()
        found = [word.strip() for word in next(csv.reader([line], delimiter=self.separator))]
        return [word.replace(",", ".") if _is_number(word.replace(",", ".")) else word for word in found]

    def comment(self, text: str, number: int) -> None:
        words = text.split()
        # a number too many is a mass only where the head says so
        self.has_masses = self.has_masses or (not self.rows and "mass" in words)
        if not self.rows and words[:1] == ["lattice"] and all(_is_number(word) for word in words[1:]):
            self.vector(words[1:], text, number)
        if not self.rows and words[:1] == ["step"] and len(words) == 2 and words[1].isdecimal():
            self.step = int(words[1])

    def vector(self, words: list[str], line: str, number: int) -> None:
        try:
            values = [columns.number(word) for word in words]
        except ValueError:
            raise ValueError(f"line {number} must hold numbers, got {brief(line.strip())}") from None
        if len(values) not in (2, 3):
            raise ValueError(f"line {number} must hold a lattice vector of 2 or 3 numbers, got {len(values)}")
        self.vectors.append(values)

    def row(self, line: str, number: int) -> None:
        first = re.split(r"[\s,;]+", line.strip())
        if first[0].lower() == "lattice":
            self.vector(columns_of_vector(line), line, number)
            return
        if not self.rows and self.names is None:
            self.separator = _separator(line, header=False)
            if not any(_is_number(word) for word in self.words(line)):
                self.separator = _separator(line, header=True)
                self.names = _names(self.words(line), number)
                return
        words = self.words(line)
        if self.names is None:
            self.unnamed(words, line, number)
        elif len(words) != len(self.names):
            raise ValueError(f"line {number} must hold {len(self.names)} entries, as the header does, got {len(words)}")
        self.rows.append(words)
        self.lines.append(number)

    def unnamed(self, words: list[str], line: str, number: int) -> None:
        """Check a line without a header above it."""
        if not all(_is_number(word) for word in words):
            raise ValueError(f"line {number} must hold numbers, got {brief(line.strip())}")
        d = len(self.vectors) or (0 if self.given.box is None else self.given.box.dimension)
        has_radius = self.given.radius is None
        if len(words) != d + has_radius + self.has_masses:
            wanted = " and ".join(["a radius"] * has_radius + ["a mass"] * self.has_masses)
            raise ValueError(
                f"line {number} must hold {d} coordinates{' and ' if wanted else ''}{wanted}, after the lines with the "
                f"lattice vectors (masses only below a comment that names them), got {len(words)} numbers"
            )

    def found(self) -> tuple[Snapshot, list[str]]:
        held = None
        if self.vectors or self.given.box is None:
            if len(self.vectors) not in (2, 3) or any(len(one) != len(self.vectors) for one in self.vectors):
                raise ValueError(
                    "it must hold 2 or 3 lines 'lattice x y [z]', as many as coordinates, got "
                    f"{len(self.vectors)} (or give the box as box=)"
                )
            held = Box(np.array(self.vectors).T)
        box = self.given.box_in(held)
        if not self.rows:
            raise ValueError("it must hold at least one line 'x y [z] radius', got none")
        names = self.names
        if names is None:
            names = [*_WIDTHS[box.dimension].split(), *["radius"] * (self.given.radius is None)]
            names += ["mass"] * self.has_masses
        table = columns.columns_of(names, self.rows, self.lines[0], self.lines)
        arrays, left_out = columns.grouped(table, box.dimension)
        if "position_nd" not in arrays:
            raise ValueError(f"it must hold columns {_WIDTHS[box.dimension]}, got {', '.join(names)}")
        return columns.snapshot_of_particles(arrays, box, self.given, self.step), left_out


def columns_of_vector(line: str) -> list[str]:
    """Return the numbers of a line with a lattice vector."""
    return re.split(r"[\s,;]+", line.strip(" \t\r\n,;"))[1:]


def _names(words: list[str], number: int) -> list[str]:
    found = []
    for word in words:
        name = re.split(r"\s+[\[(]", word)[0].strip()
        small = name.lower()
        found.append(_ALIASES.get(small, small if small in columns.NUMBERS else name))
    twice = next((name for k, name in enumerate(found) if name in found[:k]), None)
    if twice is not None or "" in found:
        raise ValueError(f"line {number} must name each column, and once, got {', '.join(words)}")
    return found


def _read(path: Path, given: Given) -> tuple[Snapshot, list[str]]:
    reader = _Reader(given)
    for number, line in enumerate(_decoded(path).splitlines(), start=1):
        row, mark, comment = line.partition("#")
        if mark:
            reader.comment(comment, number)
        if row.strip(" \t,;"):
            reader.row(row, number)
    return reader.found()


def _frames(path: Path, given: Given) -> One:
    return One(lambda: _read(path, given))


def _lattice(snapshot: Snapshot) -> list[str]:
    return ["lattice " + " ".join(map(repr, vector)) for vector in snapshot.packing.box.lattice_dd.T.tolist()]


def _write_plain(snapshots: Iterable[Snapshot], path: Path) -> None:
    (snapshot,) = snapshots
    table = columns.flat(columns.arrays_of_particles(snapshot))
    names = " ".join(table)
    lines = [f"# packing of {snapshot.packing.particles} particles: lattice vectors, then {names} of each particle"]
    lines += [*_lattice(snapshot), *columns.lines_of(list(table.values()))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_csv(snapshots: Iterable[Snapshot], path: Path) -> None:
    (snapshot,) = snapshots
    table = columns.flat(columns.arrays_of_particles(snapshot))
    text = io.StringIO()
    text.write(f"# packing of {snapshot.packing.particles} particles\n")
    text.writelines(f"# {line}\n" for line in _lattice(snapshot))
    if snapshot.step is not None:
        text.write(f"# step {snapshot.step}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*map(columns.text_of, table.values()), strict=True))
    path.write_text(text.getvalue(), encoding="utf-8")


def _no_field(name: str, array: Any) -> bool:
    return False


PLAIN = Format("table", (".txt", ".dat"), frozenset(), _frames, _write_plain, field=_no_field)


def _field(name: str, array: NDArray[Any]) -> bool:
    # a blank before a bracket begins a unit
    return columns.can_be_column(name, array, "#\n\r") and not re.search(r"\s[\[(]", name)


CSV = Format("csv", (".csv",), frozenset((SPHEROIDS, KINDS, STEP)), _frames, _write_csv, field=_field)
