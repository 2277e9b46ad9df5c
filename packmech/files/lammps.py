"""Packings as LAMMPS data files and dumps, both of text.

Both hold any lattice as it stands: a box whose lattice vectors are an upper triangular matrix with a positive diagonal
in the usual way (``xlo xhi``, ``xy xz yz``), any other one as LAMMPS's general triclinic box (``avec``, ``abc origin``;
LAMMPS of July 2025 and OVITO 3.17 read it), which LAMMPS itself turns as it reads a data file (its ``read_dump`` takes
dumps of triangular boxes only). Nothing is turned or wrapped here: positions, velocities and directors come back to the
last bit. Of a left-handed box a data file has the negative of the last lattice vector, and says so, as LAMMPS wants a
right-handed one. A packing of two dimensions lies at z = 0 in a box of ``-0.5 0.5 zlo zhi``.

Data files (``.data``, ``.lmp``; one packing)
    Of the atom style ``sphere``, or ``hybrid sphere bond`` where there are links or springs. Types of atoms are the
    field ``type``, or else number up to ten sizes; where particles are of several kinds, types are these from 1, as the
    title says, by which they are read back: kind 0 is type 1 (diameters are the atoms' own in LAMMPS). Angular
    velocities stand with the velocities. LAMMPS keeps densities of spheres, also of discs: masses come back to the last
    bit but for rounding where no density has that mass, and those of density 1 as not given. Links and linear springs
    are bonds, each length and stiffness a bond type, with coefficients of the bond style ``harmonic``, K = k/2; a
    comment beside them says which they are. LAMMPS takes the nearest image of a bonded particle: others are refused.
    Rigid links have K = 0: hold them by fix shake or rattle. Not kept are tangential displacements, other shapes, and
    springs of other laws or along tangents.
    Read are the styles atomic, bond, charge, dipole, molecular, full, sphere, bpm/sphere and hybrids of these; where a
    file does not name its style after ``Atoms #``, it is given as ``format="lammps-data:hybrid sphere bond"``. Masses
    by type are those of their atoms, and harmonic bonds are springs; bonds without coefficients, pair coefficients,
    angles and what belongs to them are left out, and listed in a warning.
Dumps (``.dump``, ``.lammpstrj``; trajectories)
    Columns ``id type x y z radius`` (``xu yu zu`` where particles lie outside the cell), ``mass`` where given, ``kind``
    where there are several (types are then kinds from 1, unless there is a field ``type``), ``aspect`` and ``director_x
    ...`` of ellipses and spheroids, fields. OVITO draws these by ``shapex shapey shapez``, diameters along their axes,
    and ``quatw quati quatj quatk``, which are written, too, and read of other programs.
    Read are ``x xu xs xsu``, with ``ix iy iz`` or without, and ``radius`` or ``diameter``; other columns are fields.
    Not kept are links, tangential displacements, rigid bodies, springs and forces of contacts.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief
from packmech.effects.bonds import Bonds
from packmech.effects.laws import LinearSpring
from packmech.files import columns
from packmech.files.formats import BONDS, KINDS, LINKS, SPHEROIDS, STEP, Format, Given, One
from packmech.files.orientations import ellipsoids_of, rotations_of, spheroids_of
from packmech.files.snapshot import Snapshot, usual_types
from packmech.links import Links
from packmech.packing import MOST_KINDS, Packing, masses_of_density

# LAMMPS's planes lie between these heights
_LOW, _HIGH = -0.5, 0.5
# columns of an atom by style, of a hybrid after id, type and position
_SUBSTYLES = {
    "atomic": (),
    "charge": ("q",),
    "bond": ("molecule",),
    "angle": ("molecule",),
    "molecular": ("molecule",),
    "full": ("molecule", "q"),
    "sphere": ("diameter", "density"),
    "bpm/sphere": ("molecule", "diameter", "density"),
    "dipole": ("q", "mux", "muy", "muz"),
}
_PLACE = ("x", "y", "z")
# diameters along the axes of ellipsoids, and what turns these, as OVITO takes them
_SHAPE, _QUATERNION = ("shapex", "shapey", "shapez"), ("quatw", "quati", "quatj", "quatk")
# lines that stand above a frame's first
_ABOVE = (b"ITEM: UNITS", b"ITEM: TIME\n", b"ITEM: TIME\r")
_BLANKS = " \t\n\r\v\f"
_STYLES = {
    "atomic": ("id", "type", *_PLACE),
    "charge": ("id", "type", "q", *_PLACE),
    "bond": ("id", "molecule", "type", *_PLACE),
    "angle": ("id", "molecule", "type", *_PLACE),
    "molecular": ("id", "molecule", "type", *_PLACE),
    "full": ("id", "molecule", "type", "q", *_PLACE),
    "sphere": ("id", "type", "diameter", "density", *_PLACE),
    "bpm/sphere": ("id", "molecule", "type", "diameter", "density", *_PLACE),
    "dipole": ("id", "type", "q", *_PLACE, "mux", "muy", "muz"),
}
# what the title says where the last lattice vector is written as its negative
_MIRRORED = "last lattice vector reversed"
# and where types of atoms are kinds of particles, from 1
_TYPES_ARE_KINDS = "types are kinds"
_ROUND = 4.0 * float(np.finfo(float).eps)


# -- boxes -------------------------------------------------------------------------------------------------------------


def _spatial(lattice_dd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lattice with a third vector of length one, where it is of a plane."""
    found = np.eye(3)
    found[: len(lattice_dd), : len(lattice_dd)] = lattice_dd
    return found


def _is_triangular(lattice_dd: NDArray[np.float64]) -> bool:
    return bool((np.tril(lattice_dd, -1) == 0.0).all() and (np.diag(lattice_dd) > 0.0).all())


def _low(dimension: int) -> float:
    return _LOW if dimension == 2 else 0.0


def _box_of(lattice: NDArray[np.float64], low: NDArray[np.float64], z: NDArray[np.float64] | None) -> tuple[Box, int]:
    """Return the box, and how many dimensions it has: two where every particle lies at z = 0, in its midst."""
    flat = lattice[2, 0] == lattice[2, 1] == lattice[0, 2] == lattice[1, 2] == 0.0
    inside = min(low[2], low[2] + lattice[2, 2]) < 0.0 < max(low[2], low[2] + lattice[2, 2])
    dimension = 2 if z is None or (flat and inside and not np.any(z)) else 3
    return Box(lattice[:dimension, :dimension]), dimension


# -- data files --------------------------------------------------------------------------------------------------------


def _types(snapshot: Snapshot) -> NDArray[np.int64]:
    """Return the type of each particle, from 1."""
    given = snapshot.fields.get("type")
    if given is not None and given.dtype.kind == "i" and given.ndim == 1 and given.min() >= 1:
        return given
    return usual_types(snapshot.packing)


def _density(packing: Packing) -> NDArray[np.float64]:
    """Return the densities of spheres of the radii that have the masses."""
    volume, mass = _sphere(packing.radius_n), packing.mass_n
    density = mass / volume
    for way in (np.inf, -np.inf):
        other = np.nextafter(mass / volume, way)
        density = np.where((density * volume != mass) & (other * volume == mass), other, density)
    return density


def _sphere(radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(4.0 * np.pi / 3.0 * radius_n**3)


@dataclass(frozen=True)
class _Pairs:
    """Links and springs as bonds: particles, images, K and length of the harmonic style, and what they are."""

    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    image_bd: NDArray[np.int64]
    kind: list[tuple[str, float, float]]

    def near(self, packing: Packing) -> NDArray[np.bool_]:
        """Return which of them are of the nearest image, and of two particles."""
        vector = packing.position_nd[self.j_b] - packing.position_nd[self.i_b]
        nearest = packing.box.nearest_images(vector)
        return np.asarray((nearest == self.image_bd).all(axis=1) & (self.i_b != self.j_b))


def linear_stiffness(bonds: Bonds) -> float | None:
    """Return the stiffness of linear springs, None of others [energy/length^2]."""
    laws = (bonds.compression, bonds.tension)
    linear = all(type(one) is LinearSpring for one in laws) and laws[0] == laws[1]
    return float(laws[0].stiffness) if linear else None  # type: ignore[attr-defined]


def _pairs(snapshot: Snapshot) -> _Pairs:
    links = snapshot.packing.links
    d = snapshot.packing.dimension
    kind = [
        ("link shape" if shape else "link", 0.0, length)
        for shape, length in zip(links.shape_l.tolist(), links.length_l.tolist(), strict=True)
    ]
    i, j, image = [links.i_l], [links.j_l], [links.image_ld.reshape(-1, d)]
    for bonds in snapshot.bonds:
        kind += [("spring", 0.5 * (linear_stiffness(bonds) or 0.0), length) for length in bonds.rest_length_b.tolist()]
        i.append(bonds.i_b)
        j.append(bonds.j_b)
        image.append(bonds.image_bd)
    return _Pairs(np.concatenate(i), np.concatenate(j), np.concatenate(image), kind)


def _data_losses(snapshot: Snapshot) -> Iterator[str]:
    if snapshot.packing.kinds > 1 and "type" in snapshot.fields:
        if not np.array_equal(snapshot.fields["type"], usual_types(snapshot.packing)):
            yield "no field type beside kinds of particles, which are the types, got both"
    pairs = _pairs(snapshot)
    far = int((~pairs.near(snapshot.packing)).sum()) if len(pairs.kind) else 0
    if far:
        yield f"no links or springs to other than the nearest image, got {far}"
    for bonds in snapshot.bonds:
        if linear_stiffness(bonds) is None:
            yield f"springs of LinearSpring alone, the same for both signs, got {bonds.compression}, {bonds.tension}"
        if bonds.tangential_stiffness:
            yield f"springs without tangential ones, got a stiffness of {bonds.tangential_stiffness:g}"
        if bonds.damping or bonds.tangential_damping:
            yield f"springs without dashpots, got {bonds.damping:g}, {bonds.tangential_damping:g}"
        if bonds.breaks_at is not None:
            yield f"springs that never break, got limits: {bonds.breaks_at}"


def _data_field(name: str, array: NDArray[Any]) -> bool:
    if name == "type":
        return array.dtype.kind == "i" and array.ndim == 1 and bool(array.min() >= 1)
    return name in ("velocity_nd", "spin_nk")


def _write_data(snapshots: Iterable[Snapshot], path: Path) -> None:
    (snapshot,) = snapshots
    packing, pairs = snapshot.packing, _pairs(snapshot)
    keep = np.flatnonzero(pairs.near(packing)).tolist() if pairs.kind else []
    kinds = sorted({pairs.kind[k] for k in keep})
    style = "hybrid sphere bond" if kinds else "sphere"
    box, said = packing.box, "" if snapshot.step is None else f", timestep = {snapshot.step}"
    type_n = _types(snapshot)
    if packing.kinds > 1:
        type_n = usual_types(packing)
        said += f", {_TYPES_ARE_KINDS}"
    if np.linalg.det(box.lattice_dd) < 0.0:
        # LAMMPS's vectors are right-handed; the negative of one spans the same lattice
        box = Box(box.lattice_dd * np.append(np.ones(box.dimension - 1), -1.0))
        said += f", {_MIRRORED}"
    lines = [f"LAMMPS data file of a packing, by packmech, atom_style {style}{said}", ""]
    lines += [f"{packing.particles} atoms", f"{type_n.max()} atom types"]
    if kinds:
        lines += [f"{len(keep)} bonds", f"{len(kinds)} bond types"]
    lines += ["", *_data_box(box), "", f"Atoms # {style}", ""]
    number = np.arange(1, packing.particles + 1)
    place = _three(packing.position_nd)
    own = [packing.diameter_n, _density(packing)]
    if kinds:
        table = [number, type_n, *place, *own, packing.cluster_n + 1]
    else:
        table = [number, type_n, *own, *place]
    lines += columns.lines_of(table)
    velocity, spin = (snapshot.fields.get(name) for name in ("velocity_nd", "spin_nk"))
    if velocity is not None or spin is not None:
        moving = _three(np.zeros_like(packing.position_nd) if velocity is None else velocity)
        turning = np.zeros((packing.particles, 3))
        if spin is not None:
            turning[:, 3 - spin.shape[1] :] = spin
        lines += ["", "Velocities", "", *columns.lines_of([number, *moving, *turning.T])]
    if kinds:
        lines += ["", "Bond Coeffs # harmonic", ""]
        lines += [f"{k} {stiff!r} {length!r} # {what}" for k, (what, stiff, length) in enumerate(kinds, start=1)]
        lines += ["", "Bonds", ""]
        kind_number = {kind: k for k, kind in enumerate(kinds, start=1)}
        lines += [
            f"{m} {kind_number[pairs.kind[k]]} {pairs.i_b[k] + 1} {pairs.j_b[k] + 1}"
            for m, k in enumerate(keep, start=1)
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _three(array_nd: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the columns of vectors, three of them."""
    found = list(array_nd.T)
    return found if len(found) == 3 else [*found, np.zeros(len(array_nd))]


def _data_box(box: Box) -> list[str]:
    lattice, low = _spatial(box.lattice_dd), _low(box.dimension)
    if not _is_triangular(lattice):
        vectors = [" ".join(map(repr, vector)) for vector in lattice.T.tolist()]
        return [*(f"{one} {name}" for one, name in zip(vectors, ("avec", "bvec", "cvec"), strict=True)),
                f"0.0 0.0 {low!r} abc origin"]  # fmt: skip
    sides = lattice.diagonal().tolist()
    found = [f"0.0 {side!r} {axis}lo {axis}hi" for side, axis in zip(sides[:2], "xy", strict=True)]
    found.append(f"{low!r} {low + sides[2]!r} zlo zhi")
    if np.any(np.triu(lattice, 1)):
        found.append(" ".join(map(repr, lattice[[0, 0, 1], [1, 2, 2]].tolist())) + " xy xz yz")
    return found


_COUNT = re.compile(r"(\d+)\s+([a-z ]+?)\s*$")
_BOUND = re.compile(r"(.*?)\s+(xlo xhi|ylo yhi|zlo zhi|xy xz yz|avec|bvec|cvec|abc origin)\s*$")
_SECTION = re.compile(r"([A-Z][A-Za-z]*(?: [A-Za-z]+)*)\s*(?:#\s*(.*?))?\s*$")
_READ = ("Atoms", "Velocities", "Bonds", "Bond Coeffs", "Masses")


@dataclass
class _Data:
    """The parts of a data file: numbers of its head, lines of its sections with the numbers of their lines."""

    title: str = ""
    counts: dict[str, int] = field(default_factory=dict)
    bounds: dict[str, list[float]] = field(default_factory=dict)
    sections: dict[str, tuple[str, list[tuple[int, str]]]] = field(default_factory=dict)


def _split(path: Path) -> _Data:
    title, *others = path.read_text(encoding="utf-8", errors="replace").splitlines() or [""]
    found = _Data(title)
    lines: list[tuple[int, str]] | None = None
    for number, line in enumerate(others, start=2):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        section = _SECTION.match(text)
        if section and text[0].isupper():
            lines = []
            if section[1] in found.sections:
                raise ValueError(f"line {number} must begin a new section, got {section[1]} for the second time")
            found.sections[section[1]] = (section[2] or "", lines)
        elif lines is not None:
            lines.append((number, text))
        else:
            _head(found, text.partition("#")[0].strip(), number)
    return found


def _head(found: _Data, text: str, number: int) -> None:
    count, bound = _COUNT.match(text), _BOUND.match(text)
    if bound:
        try:
            found.bounds[bound[2]] = [columns.number(word) for word in bound[1].split()]
        except ValueError:
            raise ValueError(f"line {number} must hold numbers before {bound[2]}, got {brief(text)}") from None
        wanted = 2 if "lo" in bound[2] else 3
        if len(found.bounds[bound[2]]) != wanted:
            raise ValueError(f"line {number} must hold {wanted} numbers before {bound[2]}, got {brief(text)}")
    elif count:
        found.counts[count[2]] = int(count[1])
    elif text:
        raise ValueError(f"line {number} must be of the head of a LAMMPS data file, got {brief(text)}")


def _data_lattice(bounds: dict[str, list[float]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lattice vectors as columns, and the lower corner."""
    if "avec" in bounds:
        missing = [name for name in ("bvec", "cvec", "abc origin") if name not in bounds]
        if missing:
            raise ValueError(f"it must hold lines {', '.join(missing)} beside avec, got none")
        vectors = [bounds[name] for name in ("avec", "bvec", "cvec")]
        return np.array(vectors).T, np.array(bounds["abc origin"])
    # LAMMPS's own where a file says nothing
    side = [bounds.get(name, [-0.5, 0.5]) for name in ("xlo xhi", "ylo yhi", "zlo zhi")]
    x, y, z = (high - low for low, high in side)
    xy, xz, yz = bounds.get("xy xz yz", (0.0, 0.0, 0.0))
    return np.array([[x, xy, xz], [0.0, y, yz], [0.0, 0.0, z]]), np.array([low for low, _ in side])


def _atom_columns(style: str, hint: str, width: int) -> list[str]:
    words = (style or hint).split()
    known = f"one of {', '.join(_STYLES)}, or hybrid and several of them"
    if not words or words == ["hybrid"]:
        raise ValueError(
            f"it must name its atom style after 'Atoms #', {known}, got {hint or 'nothing'!r}: give it as "
            'format="lammps-data:sphere", and so on'
        )
    unknown = [word for word in words[words[0] == "hybrid" :] if word not in _STYLES]
    if unknown or (len(words) > 1 and words[0] != "hybrid"):
        raise ValueError(f"its atom style must be {known}, got {' '.join(words)!r}")
    if words[0] == "hybrid":
        names = ["id", "type", *_PLACE]
        names += [name for word in words[1:] for name in _SUBSTYLES[word] if name not in names]
    else:
        names = list(_STYLES[words[0]])
    if width not in (len(names), len(names) + 3):
        raise ValueError(
            f"its atoms of style {' '.join(words)} must have {len(names)} columns ({' '.join(names)}) or three more, "
            f"images, got {width}"
        )
    return names + ["ix", "iy", "iz"] * (width > len(names))


def _section(data: _Data, name: str, count: int | None) -> tuple[list[list[str]], list[int]]:
    """Return the words of the lines of a section, without comments, and their numbers."""
    lines = data.sections[name][1]
    rows = [line.partition("#")[0].split() for _, line in lines]
    if count is not None and len(rows) != count:
        raise ValueError(f"its section {name} must hold {count} lines, as its head says, got {len(rows)}")
    for (number, line), row in zip(lines, rows, strict=True):
        if len(row) != len(rows[0]):
            raise ValueError(f"line {number} must hold {len(rows[0])} words as others of {name}, got {brief(line)}")
    return rows, [number for number, _ in lines]


def _read_data(path: Path, given: Given) -> tuple[Snapshot, list[str]]:
    data = _split(path)
    if "Atoms" not in data.sections or "atoms" not in data.counts:
        raise ValueError("it must be a LAMMPS data file with a line 'N atoms' and a section Atoms, got none")
    rows, lines = _section(data, "Atoms", data.counts["atoms"])
    if not rows:
        raise ValueError("it must hold at least one atom, got none")
    names = _atom_columns(given.style, data.sections["Atoms"][0], len(rows[0]))
    table = columns.columns_of(names, rows, lines[0], lines)
    for name in ("id", "type", "ix", "iy", "iz"):
        if name in table and table[name].dtype.kind != "i" and not (name == "type" and table[name].dtype.kind == "U"):
            raise ValueError(f"its atoms must have whole numbers as {name}, got {table[name][0]}")
    order = np.argsort(table["id"], kind="stable")
    table = {name: column[order] for name, column in table.items()}
    number = table.pop("id")
    if (np.diff(number) == 0).any():
        raise ValueError(f"its atoms must have numbers of their own, got {number[np.diff(number, append=-1) == 0][0]}")
    lattice, low = _data_lattice(data.bounds)
    if _MIRRORED in data.title:
        lattice[:, _box_of(lattice, low, table["z"])[1] - 1] *= -1.0
    held, dimension = _box_of(lattice, low, table["z"])
    box = given.box_in(None if given.box is not None else held)
    if given.box is not None:
        dimension = box.dimension
    left_out = [f"section {name}" for name in data.sections if name not in _READ]
    image = [table.pop(name, None) for name in ("ix", "iy", "iz")]
    fields = _data_table(data, table, number, left_out)
    arrays, aside = columns.grouped(fields, dimension)
    _unwrap(arrays, image[:dimension], box)
    density = arrays.pop("density", None)
    if density is not None and not density.any():
        left_out.append("densities, which are all 0")
    elif density is not None:
        radius = arrays["radius_n"]
        arrays["mass_n"] = density * np.where(radius > 0.0, _sphere(radius), 1.0)
    if not (arrays.get("spin_nk", np.ones(1)) != 0.0).any():
        arrays.pop("spin_nk")
    if _TYPES_ARE_KINDS in data.title:
        if arrays["type"].dtype.kind != "i" or not columns.are_kinds(arrays["type"] - 1):
            raise ValueError(f"its atoms must be of types 1 to {MOST_KINDS} where types are kinds, got others")
        arrays[columns.KIND] = arrays["type"] - 1
    step = re.search(r"timestep = (\d+)", data.title)
    snapshot = columns.snapshot_of_particles(arrays, box, given, int(step[1]) if step else None)
    snapshot, unread = _with_bonds(snapshot, data, number)
    return _usual(snapshot), [*left_out, *aside, *unread]


def _data_table(
    data: _Data, table: dict[str, NDArray[Any]], number: NDArray[np.int64], left_out: list[str]
) -> dict[str, NDArray[Any]]:
    """Return the columns of atoms with masses of their types and velocities."""
    if "Masses" in data.sections and "density" not in table:
        rows, lines = _section(data, "Masses", None)
        mass = {row[0]: columns.numbers_of("a mass", [row[1]], n)[0] for row, n in zip(rows, lines, strict=True)}
        types = [str(one) for one in table["type"].tolist()]
        missing = next((one for one in types if one not in mass), None)
        if missing is not None:
            raise ValueError(f"its section Masses must hold a mass of type {missing}, got {', '.join(mass)}")
        table["mass"] = np.array([float(mass[one]) for one in types])
    if "Velocities" in data.sections:
        rows, lines = _section(data, "Velocities", len(number))
        width = len(rows[0])
        names = ["id", "vx", "vy", "vz", "omegax", "omegay", "omegaz"]
        if width not in (4, 7):
            raise ValueError(f"line {lines[0]} must hold a number and 3 or 6 velocities, got {width} words")
        found = columns.columns_of(names[:width], rows, lines[0], lines)
        order = np.argsort(found.pop("id"), kind="stable")
        table |= {name: column[order] for name, column in found.items()}
    return table


def _with_bonds(snapshot: Snapshot, data: _Data, number: NDArray[np.int64]) -> tuple[Snapshot, list[str]]:
    """Return the snapshot with links and springs, and what is left out."""
    if "Bonds" not in data.sections:
        return snapshot, []
    rows, lines = _section(data, "Bonds", data.counts.get("bonds"))
    if not rows:
        return snapshot, []
    style, coefficient_lines = data.sections.get("Bond Coeffs", ("", []))
    kinds: dict[str, tuple[str, float, float]] = {}
    for line_number, line in coefficient_lines:
        words, _, comment = line.partition("#")
        row = words.split()
        if style in ("", "harmonic") and len(row) == 3:
            stiff, length = columns.numbers_of("a coefficient", row[1:], line_number, [line_number] * 2)
            kinds[row[0]] = (comment.strip() or "spring", float(stiff), float(length))
    place = {one: k for k, one in enumerate(number.tolist())}
    pairs: dict[tuple[str, float], list[tuple[int, int, float]]] = {}
    unread = 0
    for row, line_number in zip(rows, lines, strict=True):
        if len(row) != 4:
            raise ValueError(f"line {line_number} must hold a number, a type and two atoms, got {len(row)} words")
        ends = [place.get(int(one), -1) if one.isdigit() else -1 for one in row[2:]]
        if min(ends) < 0:
            raise ValueError(f"line {line_number} must name two atoms of the file, got {' '.join(row[2:])}")
        if row[1] not in kinds:
            unread += 1
            continue
        what, stiff, length = kinds[row[1]]
        pairs.setdefault((what, stiff), []).append((ends[0], ends[1], length))
    packing, bonds = snapshot.packing, []
    links: list[tuple[NDArray[Any], ...]] = []
    for (what, stiff), found in pairs.items():
        i, j = np.array([one[:2] for one in found], dtype=np.int64).T
        length = np.array([one[2] for one in found])
        image = packing.box.nearest_images(packing.position_nd[j] - packing.position_nd[i])
        if what.startswith("link"):
            links.append((i, j, image, length, np.full(len(i), what == "link shape")))
        else:
            spring = LinearSpring(2.0 * stiff)
            bonds.append(Bonds(i, j, image, length, spring, spring, 0.0))
    if links:
        packing = packing.replace(links=Links(*(np.concatenate(one) for one in zip(*links, strict=True))))
    left_out = [f"{unread} bonds (without harmonic coefficients: give them as pm.Links or pm.Bonds)"] if unread else []
    return Snapshot(packing, snapshot.fields, tuple(bonds), step=snapshot.step), left_out


def _usual(snapshot: Snapshot) -> Snapshot:
    """Return the snapshot without masses of density 1, and molecules that are its clusters."""
    packing, fields = snapshot.packing, dict(snapshot.fields)
    usual = masses_of_density(1.0, packing.radius_n, packing.dimension)
    if usual is not None and np.allclose(packing.mass_n, usual, rtol=_ROUND, atol=0.0):
        packing = packing.replace(mass_n=None, tangential=packing.tangential)
    if np.array_equal(fields.get("molecule", ()), packing.cluster_n + 1):
        del fields["molecule"]
    return Snapshot(packing, fields, snapshot.bonds, step=snapshot.step)


def _data_frames(path: Path, given: Given) -> One:
    return One(lambda: _read_data(path, given))


def _unwrap(arrays: dict[str, NDArray[Any]], image: Sequence[NDArray[Any] | None], box: Box) -> None:
    """Move particles to the images that they are counted in, where they are."""
    count = len(arrays["position_nd"])
    moved = np.column_stack([np.zeros(count) if one is None else one for one in image])
    if moved.any():
        arrays["position_nd"] = arrays["position_nd"] + moved @ box.lattice_dd.T


# -- dumps -------------------------------------------------------------------------------------------------------------


def _dump_box(box: Box) -> list[str]:
    """Return the item of the box, from whose bounds the lattice is read back exactly."""
    lattice, low_z = _spatial(box.lattice_dd), _low(box.dimension)
    if _is_triangular(lattice):
        sides, (xy, xz, yz) = lattice.diagonal().tolist(), lattice[[0, 0, 1], [1, 2, 2]].tolist()
        if not (xy or xz or yz):
            bounds = [f"0.0 {side!r}" for side in sides[:2]]
            return ["ITEM: BOX BOUNDS pp pp pp", *bounds, f"{low_z!r} {low_z + sides[2]!r}"]
        x = _bounds(sides[0], min(0.0, xy, xz, xy + xz), max(0.0, xy, xz, xy + xz))
        y = _bounds(sides[1], min(0.0, yz), max(0.0, yz))
        if x is not None and y is not None:
            return [
                "ITEM: BOX BOUNDS xy xz yz pp pp pp",
                f"{x[0]!r} {x[1]!r} {xy!r}",
                f"{y[0]!r} {y[1]!r} {xz!r}",
                f"{low_z!r} {low_z + sides[2]!r} {yz!r}",
            ]
    origin = (0.0, 0.0, low_z)
    rows = [" ".join(map(repr, [*vector, one])) for vector, one in zip(lattice.T.tolist(), origin, strict=True)]
    return ["ITEM: BOX BOUNDS abc origin pp pp pp", *rows]


def _bounds(side: float, below: float, above: float) -> tuple[float, float] | None:
    """Return bounds of a tilted side from which it is read back exactly: the corner may be anywhere."""
    for part in np.linspace(0.0, 1.0, 65).tolist():
        corner = -part * side
        bounds = (corner + below, corner + side + above)
        if (bounds[1] - above) - (bounds[0] - below) == side:
            return bounds
    return None


def _write_dump(snapshots: Iterable[Snapshot], path: Path) -> None:
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        for number, snapshot in enumerate(snapshots):
            file.write("\n".join(_dump_lines(snapshot, number)) + "\n")


def _dump_lines(snapshot: Snapshot, number: int) -> list[str]:
    packing = snapshot.packing
    arrays = columns.arrays_of_particles(snapshot)
    arrays.pop("type", None)
    table = {"id": np.arange(1, packing.particles + 1), "type": _types(snapshot), **columns.flat(arrays)}
    ellipsoids = ellipsoids_of(packing)
    if ellipsoids:
        semi_axes, quaternion = ellipsoids
        table |= dict(zip(_SHAPE, 2.0 * semi_axes.T, strict=True)) | dict(zip(_QUATERNION, quaternion.T, strict=True))
    if packing.dimension == 2:
        names = list(table)
        at = names.index("y") + 1
        table = {name: table.get(name, np.zeros(packing.particles)) for name in [*names[:at], "z", *names[at:]]}
    fraction = packing.position_nd @ packing.box.inverse_dd.T
    outside = bool((fraction < 0.0).any() or (fraction >= 1.0).any())
    names = [f"{name}u" if outside and name in _PLACE else name for name in table]
    step = number if snapshot.step is None else snapshot.step
    return [
        *("ITEM: TIMESTEP", str(step), "ITEM: NUMBER OF ATOMS", str(packing.particles)),
        *_dump_box(packing.box),
        f"ITEM: ATOMS {' '.join(names)}",
        *columns.lines_of(list(table.values())),
    ]


class _DumpFrames:
    """The frames of a dump: where each begins, found once."""

    def __init__(self, path: Path, given: Given) -> None:
        self.path, self.given = path, given
        self.start: list[int] = []
        self.line: list[int] = []
        mark, line = b"ITEM: TIMESTEP", 1
        if not path.stat().st_size:
            return
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            before, found = 0, content.find(mark)
            while found >= 0:
                start = found
                # lines with the units and the time stand above it
                while (above := content.rfind(b"ITEM:", before, start)) >= 0 and content[above : above + 11] in _ABOVE:
                    start = above
                line += content[before:start].count(b"\n")
                self.start.append(start)
                self.line.append(line)
                before, found = start, content.find(mark, found + 1)
            self.start.append(len(content))
        if not self.line:
            raise ValueError("it must be a LAMMPS dump with lines 'ITEM: TIMESTEP', got none")

    def __len__(self) -> int:
        return len(self.line)

    def frame(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return the snapshot of a frame."""
        with open(self.path, "rb") as file:
            file.seek(self.start[number])
            text = file.read(self.start[number + 1] - self.start[number]).decode("utf-8", errors="replace")
        return _read_dump(text.splitlines(), self.line[number], self.given)


def _read_dump(lines: Sequence[str], first: int, given: Given) -> tuple[Snapshot, list[str]]:
    place, step, count = 0, 0, -1
    bounds: tuple[str, list[list[float]]] | None = None
    left_out = []
    while place < len(lines):
        item, at = lines[place], first + place
        if item.startswith("ITEM: ATOMS"):
            break
        if not item.startswith("ITEM:"):
            raise ValueError(f"line {at} must be an item of a LAMMPS dump ('ITEM: ...'), got {brief(item[:40])}")
        size = 3 if item.startswith("ITEM: BOX BOUNDS") else 1
        body = lines[place + 1 : place + 1 + size]
        if len(body) < size:
            raise ValueError(f"line {at} must be followed by {size} lines, as {item!r} says, got {len(body)}")
        if item == "ITEM: TIMESTEP":
            step = int(columns.numbers_of("a time step", [body[0].strip()], at + 1)[0])
        elif item == "ITEM: NUMBER OF ATOMS":
            count = int(columns.numbers_of("a number of atoms", [body[0].strip()], at + 1)[0])
        elif size == 3:
            words = [line.split() for line in body]
            bounds = (
                item,
                [
                    columns.numbers_of("a bound", row, at + 1 + k, [at + 1 + k] * len(row)).tolist()
                    for k, row in enumerate(words)
                ],
            )
        else:
            left_out.append(f"item {item.removeprefix('ITEM: ')}")
        place += 1 + size
    if place >= len(lines) or count < 0 or bounds is None:
        raise ValueError(
            f"line {first + len(lines) - 1} must not end a frame without items NUMBER OF ATOMS, BOX BOUNDS and ATOMS"
        )
    if count == 0:
        raise ValueError(f"line {first + place} must hold at least one atom, got none")
    names = lines[place].split()[2:]
    body = lines[place + 1 : place + 1 + count]
    if len(body) < count:
        raise ValueError(f"line {first + place} must be followed by {count} lines of atoms, got {len(body)}")
    rows = columns.rows_of(body, len(names), first + place + 1, " ".join(names))
    renamed = {f"{axis}u": axis for axis in _PLACE if axis not in names}
    table = columns.columns_of([renamed.get(name, name) for name in names], rows, first + place + 1)
    return _dump_snapshot(table, bounds, given, step, left_out)


def _dump_snapshot(
    table: dict[str, NDArray[Any]],
    bounds: tuple[str, list[list[float]]],
    given: Given,
    step: int,
    left_out: list[str],
) -> tuple[Snapshot, list[str]]:
    lattice, low, periodic = _dump_lattice(*bounds)
    for scaled in ("s", "su"):
        own = [f"{axis}{scaled}" for axis in _PLACE if f"{axis}{scaled}" in table]
        if len(own) >= 2:
            fraction = np.zeros((len(table[own[0]]), 3))
            fraction[:, : len(own)] = np.column_stack([table.pop(one) for one in own])
            table |= dict(zip(_PLACE[: len(own)], (fraction @ lattice.T + low).T, strict=False))
    if "x" not in table or "y" not in table:
        raise ValueError(f"it must hold columns x y z (or xu, xs, xsu, and so on), got {' '.join(table)}")
    order = np.argsort(table["id"], kind="stable") if "id" in table else np.arange(len(table["x"]))
    table = {name: column[order] for name, column in table.items()}
    if "id" in table and np.array_equal(table["id"], np.arange(1, len(order) + 1)):
        del table["id"]
    held, dimension = _box_of(lattice, low, table.get("z"))
    is_periodic = all(periodic[:dimension])
    if not is_periodic and given.box is None:
        raise ValueError("its box must be periodic (pp) along each axis, got another: give the periodic box as box=")
    box = given.box_in(held if is_periodic else None)
    dimension = box.dimension
    image = [table.pop(name, None) for name in ("ix", "iy", "iz")]
    named = (*_SHAPE, *_QUATERNION)
    seen = {name: table.pop(name) for name in named} if set(named) <= table.keys() else {}
    arrays, aside = columns.grouped(table, dimension)
    _unwrap(arrays, image[:dimension], box)
    if seen and "director_nd" not in arrays:
        # another program's: LAMMPS's shapes are diameters
        axes = 0.5 * np.column_stack([seen[name] for name in _SHAPE])
        turn = rotations_of(np.column_stack([seen[name] for name in _QUATERNION]))
        arrays["radius_n"], shapes = spheroids_of(axes, turn, dimension)
        arrays |= {"aspect_n": shapes.aspect_n, "director_nd": shapes.director_nd}
    return columns.snapshot_of_particles(arrays, box, given, step), [*left_out, *aside]


def _dump_lattice(item: str, rows: list[list[float]]) -> tuple[NDArray[np.float64], NDArray[np.float64], list[bool]]:
    """Return the lattice vectors as columns, the lower corner, and along which axes they are periodic."""
    words = item.split()[3:]
    flags = [word for word in words if re.fullmatch(r"[pfsm]{2}", word)]
    periodic = [flag == "pp" for flag in flags] or [True] * 3
    general, tilted = words[:2] == ["abc", "origin"], words[:3] == ["xy", "xz", "yz"]
    wanted = 4 if general else 3 if tilted else 2
    if any(len(row) != wanted for row in rows):
        raise ValueError(f"its {item!r} must be followed by lines of {wanted} numbers, got {rows}")
    if general:
        return np.array([row[:3] for row in rows]).T, np.array([row[3] for row in rows]), periodic
    xy, xz, yz = (row[2] for row in rows) if tilted else (0.0, 0.0, 0.0)
    low = np.array([row[0] for row in rows]) - [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
    high = np.array([row[1] for row in rows]) - [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
    x, y, z = high - low
    return np.array([[x, xy, xz], [0.0, y, yz], [0.0, 0.0, z]]), low, periodic


def _dump_field(name: str, array: NDArray[Any]) -> bool:
    return columns.can_be_column(name, array, _BLANKS)


DATA = Format(
    "lammps-data",
    (".data", ".lmp"),
    frozenset((LINKS, KINDS, BONDS, STEP)),
    _data_frames,
    _write_data,
    field=_data_field,
    losses=_data_losses,
)
DUMP = Format(
    "lammps-dump",
    (".dump", ".lammpstrj"),
    frozenset((SPHEROIDS, KINDS, STEP)),
    _DumpFrames,
    _write_dump,
    many=True,
    field=_dump_field,
)
