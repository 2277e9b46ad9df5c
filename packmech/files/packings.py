"""Packings as files.

Three formats, chosen by the ending of the name:

``.npz`` (numpy)
    Everything, exactly: ``position_nd`` (N, d), ``radius_n`` (N,), ``lattice_dd`` (d, d) with the lattice vectors as
    columns, ``format_version`` and, when it is known, ``law`` (a JSON table such as
    ``{"kind": "harmonic", "energy_scale": 1.0}``). A file with the first three arrays alone is read too. A packing with
    links has them as ``link_i_l``, ``link_j_l``, ``link_image_ld``, ``link_length_l`` and ``link_shape_l``, as
    ``pm.Links`` describes them; such a file is of format version 2, so that a reader without links refuses it. Masses
    that were given are ``mass_n`` (N,), and make it version 3. Tangential displacements of contacts, which make it
    version 4, are ``tangential_i_c``, ``tangential_j_c``, ``tangential_image_cd`` and
    ``tangential_displacement_ck``, as ``pm.TangentialDisplacements`` describes them. Ellipses and spheroids, which
    make it version 5, are ``spheroid_aspect_n`` and ``spheroid_director_nd``, as ``pm.Spheroids`` describes them, and
    rigid bodies, which make it version 6, the fields of ``pm.Beads`` after ``bead_``; their tangential displacements,
    which make it version 7, have ``tangential_bead_c2``, too.
``.gsd`` (HOOMD schema, for freud, OVITO and HOOMD)
    Visible to those programs in single precision and in their orientation of the box; the exact packing lies beside it
    in log chunks, so that what packmech wrote it reads back to the last bit. Links are shown as bonds and constraints.
``.txt``, ``.dat``, ``.csv`` (plain table)
    Positions, radii and masses only; a packing with links, tangential displacements or shapes is refused.
    A line ``lattice x y [z]`` for each lattice vector, then a line ``x y [z] radius [mass]`` for each particle, with
    masses in all lines or in none. Blanks or commas separate numbers, ``#`` starts a comment. Numbers get as many
    digits as they need to be read back exactly::

        lattice 4.0 0.0
        lattice 0.5 4.0
        0.25 0.5 0.5
        1.25 0.5 0.5

HOOMD keeps single precision, a box centered on the origin whose lattice vectors form an upper triangular matrix with a
positive diagonal, and particles inside it. A packing is therefore written twice into its frame:

visible to every reader
    ``configuration/box`` (2D: ``dimensions`` 2, unit height), ``particles/position`` wrapped into that box and rotated
    with it, ``particles/image`` as taken away, ``particles/diameter`` and ``particles/mass``, one particle type for
    each of up to ten sizes. Rigid bodies have no diameters: OVITO would scale their beads by them. The schema does not
    store masses that are all 1: in other programs' files they are read as not given.
    Links are ``constraints`` (pair and length) and ``bonds`` of the types "bond" and "shape", for what draws or holds
    them. The schema has no place for a link's image: readers take the nearest one. A particle's link with its own
    image is left out. Ellipses and spheroids have orientations and, for each particle type, shape definitions of the
    kind "Ellipsoid", whose first axis is that along the director; rigid bodies such of the kind "SphereUnion".
exact, for packmech
    the log chunks ``log/packmech/position_nd``, ``radius_n`` and ``lattice_dd`` in double precision, as they were; with
    links also ``link_i_l``, ``link_j_l``, ``link_image_ld``, ``link_length_l`` and ``link_shape_l``, with given masses
    ``mass_n``, and tangential displacements and shapes as in an ``.npz`` file.
"""

from __future__ import annotations

import json
import os
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import instance
from packmech.effects.laws import is_law, registered_laws
from packmech.files.records import from_table, kinds_of, to_table
from packmech.generate.rigid import beads_of, body_of, orientation_of
from packmech.honors import honors
from packmech.links import Links
from packmech.packing import DISCRETE_SIZES, Packing
from packmech.shapes import Beads, Shapes, Spheroids
from packmech.tangential import TangentialDisplacements

PathLike = str | os.PathLike[str]
T = TypeVar("T")

# a file without links and masses is of version 1, one without masses at most of version 2, and one whose tangential
# springs are slack of version 3; one of discs or spheres at most of version 4, one of spheroids of version 5
_FORMAT_VERSION = 7
_LINK_ARRAYS = ("i_l", "j_l", "image_ld", "length_l", "shape_l")
# arrays that belong together: what their names begin with, the names of their fields, and whose they are
_LINKS = ("link_", _LINK_ARRAYS, "links")
_TANGENTIAL = ("tangential_", ("i_c", "j_c", "image_cd", "displacement_ck"), "tangential displacements")
_SPRING_BEADS = "tangential_bead_c2"
_SPHEROIDS = ("spheroid_", ("aspect_n", "director_nd"), "shapes")
_BEADS = ("bead_", ("start_n", "offset_bd", "size_b", "gyration_nk", "orientation_nq"), "shapes")
_TEXT = (".txt", ".dat", ".csv")
_ENDINGS = (".npz", ".gsd", *_TEXT)


def read_packing(path: PathLike) -> Packing:
    """Return the packing in a .npz, .gsd or plain text file (of a .gsd trajectory the last frame).

    Parameters
    ----------
    path
        The file; its ending says the format, which the head of ``packmech.files.packings`` describes.

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


@honors("links shapes", packing_only=True)
def write_packing(packing: Packing, path: PathLike, *, law: Any = None) -> None:
    """Write the packing as .npz, .gsd or plain text, and read back from it the same packing to the last bit.

    Parameters
    ----------
    packing
        The packing.
    path
        The file; its ending says the format. An existing file is replaced, completely or not at all.
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
    if packing.tangential is not None and ending in _TEXT:
        raise ValueError(
            f"packing must have no tangential displacements for {ending} files (only .npz and .gsd keep them), "
            f"got {len(packing.tangential)}: leave them out with packing.replace(tangential=None)"
        )
    if packing.shapes is not None and ending in _TEXT:
        raise ValueError(
            f"packing must be of discs or spheres for {ending} files (only .npz and .gsd keep shapes), got "
            f"{type(packing.shapes).__name__}"
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
    """Give a file to write beside the target, of a name of its own, which replaces it in one step at the end."""
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
    box = Box(arrays["lattice_dd"])
    links = _group(arrays, *_LINKS)
    return Packing(
        arrays["position_nd"],
        arrays["radius_n"],
        box,
        None if links is None else Links(*links),
        arrays.get("mass_n"),
        _springs_in(arrays),
        _shapes_in(arrays),
    )


def _springs_in(arrays: Mapping[str, Any]) -> TangentialDisplacements | None:
    """Return the tangential displacements that are written out in arrays, if there are any."""
    springs = _group(arrays, *_TANGENTIAL)
    if springs is None:
        return None
    i_c, j_c, image_cd, displacement_ck = springs
    # the schema of gsd flattens a single column
    displacement_ck = displacement_ck.reshape(len(i_c), -1)
    return TangentialDisplacements(i_c, j_c, image_cd, displacement_ck, arrays.get(_SPRING_BEADS))


def _shapes_in(arrays: Mapping[str, Any]) -> Shapes | None:
    """Return the shapes that are written out in arrays, if there are any."""
    spheroids, beads = (_group(arrays, *one) for one in (_SPHEROIDS, _BEADS))
    if beads is not None:
        start, offset, size, gyration, orientation = beads
        # the schema of gsd flattens a single column
        return Beads(start, offset, size, gyration.reshape(len(start) - 1, -1), orientation)
    return None if spheroids is None else Spheroids(*spheroids)


def _group(arrays: Mapping[str, Any], prefix: str, names: tuple[str, ...], of: str) -> list[Any] | None:
    """Return arrays that belong together, None where there are none of them."""
    given = [name for name in names if arrays.get(prefix + name) is not None]
    if not given:
        return None
    missing = [prefix + name for name in names if name not in given]
    if missing:
        raise ValueError(f"it must hold all arrays of its {of}, got none named {', '.join(missing)}")
    return [arrays[prefix + name] for name in names]


def _write_npz(packing: Packing, path: Path, law: Any) -> None:
    version = 1 if packing.links is None else 2
    version = version if packing.given_mass_n is None else 3
    version = version if packing.tangential is None else 4
    version = version if packing.shapes is None else 6 if isinstance(packing.shapes, Beads) else 5
    version = 7 if packing.tangential is not None and packing.tangential.bead_c2 is not None else version
    arrays: dict[str, Any] = {
        "format_version": np.array(version),
        "position_nd": packing.position_nd,
        "radius_n": packing.radius_n,
        "lattice_dd": packing.box.lattice_dd,
    }
    if packing.links is not None:
        arrays |= {f"link_{name}": getattr(packing.links, name) for name in _LINK_ARRAYS}
    if packing.given_mass_n is not None:
        arrays["mass_n"] = packing.given_mass_n
    arrays |= _further_arrays(packing)
    if law is not None:
        arrays["law"] = np.array(json.dumps(to_table(law)))
    with open(path, "wb") as file:
        np.savez(file, **arrays)


def _further_arrays(packing: Packing) -> dict[str, Any]:
    """Return the arrays of tangential displacements and of shapes, if there are any, by the names of files."""
    found: dict[str, Any] = {}
    shapes = _BEADS if isinstance(packing.shapes, Beads) else _SPHEROIDS
    for (prefix, names, _), record in ((_TANGENTIAL, packing.tangential), (shapes, packing.shapes)):
        if record is not None:
            found |= {prefix + one: getattr(record, one) for one in names}
    if packing.tangential is not None and packing.tangential.bead_c2 is not None:
        found[_SPRING_BEADS] = packing.tangential.bead_c2
    return found


def _read_text(path: Path) -> Packing:
    vectors: list[list[float]] = []
    rows: list[list[float]] = []
    has_masses = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        table_line, _, comment = line.partition("#")
        words = table_line.replace(",", " ").split()
        # a number too many is a mass only where the head says so
        has_masses = has_masses or (not rows and "mass" in comment.split())
        if not words:
            continue
        is_vector = words[0].lower() == "lattice"
        try:
            values = [float(word) for word in words[is_vector:]]
        except ValueError:
            raise ValueError(f"line {number} must hold numbers, got {line.strip()!r}") from None
        if is_vector and len(values) not in (2, 3):
            raise ValueError(f"line {number} must hold a lattice vector of 2 or 3 numbers, got {len(values)}")
        d = len(vectors)
        if not is_vector and len(values) != d + 1 + has_masses:
            wanted = "a radius and a mass" if has_masses else "a radius"
            raise ValueError(
                f"line {number} must hold {d} coordinates and {wanted}, after the lines with the lattice vectors "
                f"(masses only below a comment that names them), got {len(values)} numbers"
            )
        (vectors if is_vector else rows).append(values)
    if len(vectors) not in (2, 3) or any(len(vector) != len(vectors) for vector in vectors):
        raise ValueError(f"it must hold 2 or 3 lines 'lattice x y [z]', as many as coordinates, got {len(vectors)}")
    if not rows:
        raise ValueError("it must hold at least one line 'x y [z] radius', got none")
    table = np.array(rows)
    d = len(vectors)
    mass_n = table[:, d + 1] if has_masses else None
    return Packing(table[:, :d], table[:, d], Box(np.array(vectors).T), mass_n=mass_n)


def _text(packing: Packing) -> str:
    """Return the plain table; `repr` of a float is the shortest decimal that is read back exactly."""
    axes = "x y z".split()[: packing.dimension]
    given = packing.given_mass_n
    columns = [*axes, "radius"] if given is None else [*axes, "radius mass"]
    lines = [f"# packing of {packing.particles} particles: lattice vectors, then {' '.join(columns)} of each particle"]
    lines += ["lattice " + " ".join(map(repr, vector)) for vector in packing.box.lattice_dd.T.tolist()]
    table = np.column_stack([packing.position_nd, packing.radius_n, *([] if given is None else [given])])
    lines += [" ".join(map(repr, row)) for row in table.tolist()]
    return "\n".join(lines) + "\n"


_LOG = "packmech/"
_BOND_TYPES = ["bond", "shape"]
_SINGLE = 4 * float(np.finfo(np.float32).eps)


@dataclass(frozen=True, eq=False)
class _Visible:
    """A packing as the HOOMD schema says it: upper triangular box, particles around its center."""

    lattice_dd: NDArray[np.float64]
    position_nd: NDArray[np.float64]
    image_nd: NDArray[np.int32]


def _visible(packing: Packing) -> _Visible:
    lattice = packing.box.lattice_dd
    # the mirrored last vector spans the same lattice, and only a right-handed one can be rotated to triangular form
    sign = np.ones(packing.dimension)
    sign[-1] = np.sign(np.linalg.det(lattice))
    triangular = np.linalg.qr(lattice * sign)[1]
    triangular = np.sign(np.diag(triangular))[:, None] * triangular
    fraction = (packing.position_nd @ packing.box.inverse_dd.T) * sign
    image = np.floor(fraction + 0.5)
    return _Visible(triangular, (fraction - image) @ triangular.T, image.astype(np.int32))


def _hoomd_box(lattice_dd: NDArray[np.float64]) -> list[float]:
    side = np.diag(lattice_dd)
    if len(side) == 2:
        return [side[0], side[1], 1.0, lattice_dd[0, 1] / side[1], 0.0, 0.0]
    return [*side, lattice_dd[0, 1] / side[1], lattice_dd[0, 2] / side[2], lattice_dd[1, 2] / side[2]]


def _lattice(hoomd_box: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    x, y, z, xy, xz, yz = np.asarray(hoomd_box, dtype=np.float64)
    return np.array([[x, xy * y, xz * z], [0.0, y, yz * z], [0.0, 0.0, z]])[:dimension, :dimension]


def write_gsd(packing: Packing, path: Path) -> None:
    """Write the packing as one frame of a new GSD file."""
    import gsd.hoomd

    visible = _visible(packing)
    dimension = packing.dimension
    frame = gsd.hoomd.Frame()
    frame.configuration.dimensions = dimension
    frame.configuration.box = _hoomd_box(visible.lattice_dd)
    frame.particles.N = packing.particles
    frame.particles.position = _three_axes(visible.position_nd).astype(np.float32)
    frame.particles.image = _three_axes(visible.image_nd).astype(np.int32)
    if not isinstance(packing.shapes, Beads):
        frame.particles.diameter = packing.diameter_n.astype(np.float32)
    frame.particles.mass = packing.mass_n.astype(np.float32)
    size_k, type_n = np.unique(packing.radius_n, return_inverse=True)
    if packing.shapes is not None:
        beads = isinstance(packing.shapes, Beads)
        type_n = _show_beads(frame, packing) if beads else _show_spheroids(frame, packing)
    elif len(size_k) > DISCRETE_SIZES:
        type_n = np.zeros_like(type_n)
    frame.particles.types = [_type_name(k) for k in range(int(type_n.max()) + 1)]
    frame.particles.typeid = type_n.astype(np.uint32)
    frame.log = {
        _LOG + "position_nd": packing.position_nd,
        _LOG + "radius_n": packing.radius_n,
        _LOG + "lattice_dd": packing.box.lattice_dd,
    }
    if packing.given_mass_n is not None:
        frame.log[_LOG + "mass_n"] = packing.given_mass_n
    frame.log |= {_LOG + name: array for name, array in _further_arrays(packing).items()}
    if packing.links is not None:
        _add_links(frame, packing.links)
    with gsd.hoomd.open(str(path), "w") as file:
        file.append(frame)


def _type_name(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else f"A{number}"


def _show_beads(frame: Any, packing: Packing) -> NDArray[np.int64]:
    """Give the frame orientations and the union of spheres of each particle type; return the type of each particle."""
    shapes = packing.shapes
    assert isinstance(shapes, Beads)
    length, bead = packing.radius_n[shapes.particle_b, None], np.hstack([shapes.offset_bd, shapes.size_b[:, None]])
    own = np.split(length * bead, shapes.start_n[1:-1])
    kinds: dict[bytes, int] = {}
    type_n = [kinds.setdefault(one.tobytes(), len(kinds)) for one in own]
    first = np.unique(type_n, return_index=True)[1]
    frame.particles.type_shapes = [
        {
            "type": "SphereUnion",
            "centers": _three_axes(own[n][:, :-1]).tolist(),
            "diameters": (2.0 * own[n][:, -1]).tolist(),
        }
        for n in first
    ]
    columns = shapes.frames().transpose(0, 2, 1).reshape(-1, packing.dimension)
    turned = _visible_directions(packing, columns).reshape(len(shapes), packing.dimension, -1)
    turn = np.array([orientation_of(one.T) for one in turned])
    if packing.dimension == 2:
        angle = 0.5 * np.arctan2(turn[:, 1], turn[:, 0])
        turn = np.column_stack([np.cos(angle), np.zeros((len(angle), 2)), np.sin(angle)])
    frame.particles.orientation = turn.astype(np.float32)
    return np.array(type_n)


def _show_spheroids(frame: Any, packing: Packing) -> NDArray[np.int64]:
    """Give the frame orientations and the shape of each particle type; return the type of each particle."""
    shapes = packing.shapes
    assert isinstance(shapes, Spheroids)
    kinds, type_n = np.unique(np.column_stack([packing.radius_n, shapes.aspect_n]), axis=0, return_inverse=True)
    along, across = Spheroids(kinds[:, 1], np.ones((len(kinds), packing.dimension))).semi_axes(kinds[:, 0])
    frame.particles.type_shapes = [
        {"type": "Ellipsoid", "a": float(a), "b": float(b), "c": float(b)} for a, b in zip(along, across, strict=True)
    ]
    director = _three_axes(_visible_directions(packing, shapes.director_nd))
    # the turn of the first axis to the director, about what is across both
    turn = np.column_stack([1.0 + director[:, 0], np.zeros(len(director)), -director[:, 2], director[:, 1]])
    back = turn[:, 0] < 1e-6
    turn[back] = (0.0, 0.0, 0.0, 1.0)
    turn /= np.sqrt((turn**2).sum(axis=1, keepdims=True))
    frame.particles.orientation = turn.astype(np.float32)
    return np.asarray(type_n.ravel(), dtype=np.int64)


def _visible_directions(packing: Packing, direction_nd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return directions in the frame of the visible box, which is that of the packing turned."""
    lattice = packing.box.lattice_dd
    sign = np.ones(packing.dimension)
    sign[-1] = np.sign(np.linalg.det(lattice))
    return np.asarray(direction_nd @ ((lattice * sign) @ np.linalg.inv(_visible(packing).lattice_dd)))


def _seen_shapes(frame: Any, dimension: int) -> tuple[NDArray[np.float64], Shapes | None]:
    """Return the radii of the frame's particles, and their ellipsoids or unions of spheres, if there are any."""
    radius_n = 0.5 * np.asarray(frame.particles.diameter, dtype=np.float64)
    defined = frame.particles.type_shapes or []
    if defined and all(one.get("type") == "SphereUnion" for one in defined):
        return _seen_beads(frame, dimension)
    kinds = [one for one in defined if one.get("type") == "Ellipsoid"]
    if not kinds:
        return radius_n, None
    if len(kinds) < len(defined):
        raise ValueError("its particle types must all be ellipsoids, all unions of spheres, or none")
    axes = np.array([[one["a"], one["b"], one.get("c", one["b"])] for one in defined], dtype=np.float64)
    if dimension == 3 and (axes[:, 1] != axes[:, 2]).any():
        raise ValueError("its ellipsoids must have two equal axes, b and c")
    w, x, y, z = np.asarray(frame.particles.orientation, dtype=np.float64).T
    first = np.column_stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
    type_n = np.asarray(frame.particles.typeid, dtype=np.int64)
    return radius_n, Spheroids((axes[:, 0] / axes[:, 1])[type_n], first[:, :dimension])


def _seen_beads(frame: Any, dimension: int) -> tuple[NDArray[np.float64], Beads]:
    """Return the frame's unions of spheres, each about its center of mass, and the radii of equal area or volume."""
    bodies = []
    for one in frame.particles.type_shapes:
        center = np.array(one["centers"], dtype=np.float64)[:, :dimension]
        body = body_of(center, 0.5 * np.array(one["diameters"], dtype=np.float64))
        if np.abs(body.center_d).max() > _SINGLE * body.radius:
            raise ValueError("its unions of spheres must have their centers of mass at the origin")
        bodies.append(body)
    type_n = np.asarray(frame.particles.typeid, dtype=np.int64)
    turn = np.asarray(frame.particles.orientation, dtype=np.float64)
    if dimension == 2:
        turn = np.column_stack([turn[:, 0] ** 2 - turn[:, 3] ** 2, 2.0 * turn[:, 0] * turn[:, 3]])
    own = [bodies[k] for k in type_n]
    given = beads_of(own, turn)
    frames = given.frames() @ np.array([one.frame_dd for one in own])
    oriented = given.oriented(np.array([orientation_of(one) for one in frames]))
    return np.array([one.radius for one in own]), oriented


def _shown(links: Links) -> NDArray[np.bool_]:
    """Return which links the schema can show: it has no place for a particle's link with its own image."""
    shown: NDArray[np.bool_] = links.i_l != links.j_l
    return shown


def _add_links(frame: Any, links: Links) -> None:
    shape = links.shape_l
    assert shape is not None
    shown = _shown(links)
    group = np.column_stack([links.i_l, links.j_l])[shown]
    frame.constraints.N = len(group)
    frame.constraints.group = group.astype(np.uint32)
    frame.constraints.value = links.length_l[shown].astype(np.float32)
    frame.bonds.N = len(group)
    frame.bonds.group = group.astype(np.uint32)
    frame.bonds.types = _BOND_TYPES
    frame.bonds.typeid = shape[shown].astype(np.uint32)
    for name in _LINK_ARRAYS:
        array = getattr(links, name)
        frame.log[f"{_LOG}link_{name}"] = array.astype(np.uint8) if name == "shape_l" else array


def _seen_links(frame: Any, position_nd: NDArray[np.float64], box: Box) -> Links | None:
    """Return the frame's constraints as links to the nearest image; those that are bonds of type "shape" as such."""
    if not frame.constraints.N:
        return None
    i, j = np.asarray(frame.constraints.group, dtype=np.int64).reshape(-1, 2).T
    image = -np.rint((position_nd[j] - position_nd[i]) @ box.inverse_dd.T).astype(np.int64)
    bonds = frame.bonds
    shapes: set[tuple[int, int]] = set()
    if bonds.N and "shape" in bonds.types:
        marked = np.asarray(bonds.group)[np.asarray(bonds.typeid) == bonds.types.index("shape")]
        shapes = {(min(a, b), max(a, b)) for a, b in marked.tolist()}
    shape = [(min(a, b), max(a, b)) in shapes for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    return Links(i, j, image, np.asarray(frame.constraints.value, dtype=np.float64), np.array(shape))


def _three_axes(array_nd: NDArray[Any]) -> NDArray[Any]:
    padded = np.zeros((len(array_nd), 3))
    padded[:, : array_nd.shape[1]] = array_nd
    return padded


def read_gsd(path: Path) -> Packing:
    """Return the packing in the last frame: the exact one where packmech wrote it, else what every reader sees.

    Raises
    ------
    ValueError
        If the file has no frame or no particles, or if its exact and its visible packing differ by more than rounding
        to single precision (another program changed one of them).

    """
    import gsd.hoomd

    with gsd.hoomd.open(str(path), "r") as file:
        if len(file) == 0:
            raise ValueError("it must hold at least one frame, got none")
        frame = file[len(file) - 1]
    dimension = int(frame.configuration.dimensions)
    lattice = _lattice(frame.configuration.box, dimension)
    position = np.asarray(frame.particles.position, dtype=np.float64)[:, :dimension]
    box = Box(lattice)
    mass_n = np.asarray(frame.particles.mass, dtype=np.float64)
    visible = None if (mass_n == 1.0).all() else mass_n
    radius_n, seen_shapes = _seen_shapes(frame, dimension)
    seen = Packing(position, radius_n, box, mass_n=visible, shapes=seen_shapes)
    chunks = [frame.log.get(_LOG + name) for name in ("position_nd", "radius_n", "lattice_dd")]
    if any(chunk is None for chunk in chunks):
        return seen.replace(links=_seen_links(frame, seen.position_nd, box))
    own = {name.removeprefix(_LOG): one for name, one in frame.log.items()}
    parts = _group(own, *_LINKS)
    links = None
    if parts is not None:
        i_l, j_l, image_ld, length_l, shape_l = parts
        links = Links(i_l, j_l, image_ld, length_l, shape_l.astype(bool))
    masses, shapes = frame.log.get(_LOG + "mass_n"), _shapes_in(own)
    exact = Packing(chunks[0], chunks[1], Box(chunks[2]), links, masses, _springs_in(own), shapes)
    if not (_agree(exact, seen) and _same_links(exact.links, frame.constraints)):
        raise ValueError("its log/packmech chunks and its visible particles must be one packing, got two that differ")
    return exact


def _same_links(links: Links | None, constraints: Any) -> bool:
    """Return whether the visible constraints are the links rounded to single precision."""
    if links is None:
        return not constraints.N
    shown = links.select(_shown(links))
    group = np.asarray(constraints.group, dtype=np.int64).reshape(-1, 2) if constraints.N else np.zeros((0, 2))
    return bool(
        np.array_equal(group, np.column_stack([shown.i_l, shown.j_l]))
        and np.array_equal(np.asarray(constraints.value, dtype=np.float32), shown.length_l.astype(np.float32))
    )


def _agree(exact: Packing, seen: Packing) -> bool:
    """Return whether the visible packing is the exact one rounded to single precision."""
    if (exact.particles, exact.dimension) != (seen.particles, seen.dimension):
        return False
    if type(exact.shapes) is not type(seen.shapes):
        return False
    if isinstance(exact.shapes, Beads) and isinstance(seen.shapes, Beads):
        if not np.array_equal(exact.shapes.start_n, seen.shapes.start_n):
            return False
        turned, arm = _visible_directions(exact, exact.shapes.arms(exact.radius_n)), seen.shapes.arms(seen.radius_n)
        if np.abs(turned - arm).max() > _SINGLE * float(exact.shapes.reach(exact.radius_n).max()):
            return False
    elif isinstance(exact.shapes, Spheroids) and isinstance(seen.shapes, Spheroids):
        turned = _visible_directions(exact, exact.shapes.director_nd)
        along = np.abs((turned * seen.shapes.director_nd).sum(axis=1))
        if not (
            np.allclose(exact.shapes.aspect_n, seen.shapes.aspect_n, rtol=_SINGLE) and (along > 1.0 - _SINGLE).all()
        ):
            return False
    visible = _visible(exact)
    size = float(np.abs(visible.lattice_dd).max())
    apart = seen.position_nd - visible.position_nd
    return bool(
        np.allclose(seen.box.lattice_dd, visible.lattice_dd, rtol=_SINGLE, atol=_SINGLE * size)
        and np.allclose(seen.radius_n, exact.radius_n, rtol=_SINGLE, atol=0.0)
        and (seen.given_mass_n is None or np.allclose(seen.mass_n, exact.mass_n, rtol=_SINGLE, atol=0.0))
        # a center on the face of the box may be written on either side of it
        and np.abs(apart - np.rint(apart @ seen.box.inverse_dd.T) @ seen.box.lattice_dd.T).max() <= 4 * _SINGLE * size
    )
