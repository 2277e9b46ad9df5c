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
    Other arrays are left out, and listed in a warning.
``.gsd`` (HOOMD schema, for freud, OVITO and HOOMD)
    Visible to those programs in single precision and in their orientation of the box; the exact packing lies beside it
    in log chunks, so that what packmech wrote it reads back to the last bit. Links are shown as bonds and constraints.
    Of a trajectory any frame is read, the last unless one is asked for.
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
    kind "Ellipsoid", whose first axis is that along the director; rigid bodies such of the kind "SphereUnion", and
    discs and spheres of up to ten sizes such of the kind "Sphere".
exact, for packmech
    the log chunks ``log/packmech/position_nd``, ``radius_n`` and ``lattice_dd`` in double precision, as they were; with
    links also ``link_i_l``, ``link_j_l``, ``link_image_ld``, ``link_length_l`` and ``link_shape_l``, with given masses
    ``mass_n``, and tangential displacements and shapes as in an ``.npz`` file.

Of what another program wrote, a packing gets ``configuration``, ``particles/position`` unwrapped by
``particles/image``, ``mass``, ``constraints`` as links to the nearest image, and sizes and shapes by
``particles/type_shapes``, else by ``particles/diameter``. "Ellipsoid" may have any two axes equal (in the plane those
that lie in it are an ellipse's), "SphereUnion" any origin. Refused are polygons, polyhedra, meshes, ellipsoids of
three axes, diameters that contradict a "Sphere", particles that ``particles/body`` joins, and what leaves the plane in
2D. Left out, and listed in a warning, are velocities, angular momenta, charges, moments of inertia, orientations of
spheres, bonds without a constraint, angles, dihedrals, impropers, pairs, and log chunks. A link that single precision
of the positions puts off its length is as long as its particles are apart.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import uuid
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import finite_array, instance, integer, positive, positive_array
from packmech.effects.laws import is_law, registered_laws
from packmech.files.records import from_table, kinds_of, to_table
from packmech.generate.rigid import UnionBody, beads_of, body_of, orientation_of
from packmech.honors import LINK_TOLERANCE, honors
from packmech.links import Links
from packmech.packing import DISCRETE_SIZES, Packing
from packmech.shapes import Beads, Discs, Shapes, Spheroids
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
# of the arrays of shapes: what their names begin with, and the version of the format that has them
_SHAPES = {Discs: ("", 1), Spheroids: (_SPHEROIDS[0], 5), Beads: (_BEADS[0], 6)}
_REQUIRED = ("position_nd", "radius_n", "lattice_dd")
# all arrays that a file may hold of a packing
_OWN = (
    *_REQUIRED,
    "mass_n",
    _SPRING_BEADS,
    *(prefix + name for prefix, names, _ in (_LINKS, _TANGENTIAL, _SPHEROIDS, _BEADS) for name in names),
)
_TEXT = (".txt", ".dat", ".csv")
_ENDINGS = (".npz", ".gsd", *_TEXT)


def read_packing(path: PathLike, *, frame: int | None = None) -> Packing:
    """Return the packing in a .npz, .gsd or plain text file (of a .gsd trajectory the last frame).

    What a file holds and a packing has no place for, such as velocities, is left out and listed in a UserWarning.
    Particles of shapes that packings cannot have are refused.

    Parameters
    ----------
    path
        The file; its ending says the format, which the head of ``packmech.files.packings`` describes.
    frame
        Number of the frame of a .gsd trajectory, from 0, or from the end where it is negative; the last unless given.

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
    ending = _ending(found)
    if frame is not None:
        frame = integer("frame", frame)
        if ending != ".gsd":
            raise ValueError(f"frame must be left out for {ending} files, which hold one packing, got {frame}")
    read: Callable[[], tuple[Packing, list[str]]] = {
        ".npz": lambda: _read_npz(found),
        ".gsd": lambda: read_gsd(found, frame),
    }.get(ending, lambda: (_read_text(found), []))
    packing, left_out = _in_file(found, read)
    if left_out:
        warnings.warn(f"{found}: left out, as a packing has no place for them: {'; '.join(left_out)}", stacklevel=2)
    return packing


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
    links = packing.links
    if len(links) and ending in _TEXT:
        raise ValueError(
            f"packing must have no links for {ending} files (only .npz and .gsd keep them), got {len(links)}"
        )
    if packing.tangential is not None and ending in _TEXT:
        raise ValueError(
            f"packing must have no tangential displacements for {ending} files (only .npz and .gsd keep them), "
            f"got {len(packing.tangential)}: leave them out with packing.replace(tangential=None)"
        )
    if ending in _TEXT and packing.shapes.has_orientations:
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


def _read_npz(path: Path) -> tuple[Packing, list[str]]:
    arrays = _arrays(path)
    missing = [name for name in _REQUIRED if name not in arrays]
    if missing:
        raise ValueError(f"it must hold the arrays {', '.join(missing)}, got {', '.join(arrays) or 'none'}")
    left_out = [name for name in arrays if name not in (*_OWN, "format_version", "law")]
    return _packing_in(arrays), [f"arrays {', '.join(left_out)}"] if left_out else []


def _packing_in(arrays: Mapping[str, Any]) -> Packing:
    """Return the packing that is written out in arrays."""
    box, links = Box(arrays["lattice_dd"]), _group(arrays, *_LINKS)
    return Packing(
        arrays["position_nd"],
        arrays["radius_n"],
        box,
        Links(*links) if links else None,
        arrays.get("mass_n"),
        _springs_in(arrays),
        _shapes_in(arrays),
    )


def _springs_in(arrays: Mapping[str, Any]) -> TangentialDisplacements | None:
    """Return the tangential displacements that are written out in arrays, if there are any."""
    springs = _group(arrays, *_TANGENTIAL)
    if springs is None:
        if arrays.get(_SPRING_BEADS) is not None:
            raise ValueError(f"it must hold all arrays of its tangential displacements, got {_SPRING_BEADS} alone")
        return None
    i_c, j_c, image_cd, displacement_ck = springs
    # the schema of gsd flattens a single column
    displacement_ck = displacement_ck.reshape(len(i_c), -1)
    return TangentialDisplacements(i_c, j_c, image_cd, displacement_ck, arrays.get(_SPRING_BEADS))


def _shapes_in(arrays: Mapping[str, Any]) -> Shapes | None:
    """Return the shapes that are written out in arrays, if there are any."""
    spheroids, beads = (_group(arrays, *one) for one in (_SPHEROIDS, _BEADS))
    if spheroids is not None and beads is not None:
        raise ValueError("it must hold arrays of spheroids or of rigid bodies, got both")
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
    own = _arrays_of(packing)
    # the arrays that make a file one of a later version
    needs = {"link_i_l": 2, "mass_n": 3, "tangential_i_c": 4, _SPRING_BEADS: 7}
    version = max(_SHAPES[type(packing.shapes)][1], *(needs.get(name, 1) for name in own))
    arrays: dict[str, Any] = {"format_version": np.array(version), **own}
    if law is not None:
        arrays["law"] = np.array(json.dumps(to_table(law)))
    with open(path, "wb") as file:
        np.savez(file, **arrays)


def _arrays_of(packing: Packing) -> dict[str, Any]:
    """Return all arrays of a packing by the names of files."""
    found: dict[str, Any] = {
        "position_nd": packing.position_nd,
        "radius_n": packing.radius_n,
        "lattice_dd": packing.box.lattice_dd,
    }
    if len(packing.links):
        found |= {f"link_{name}": getattr(packing.links, name) for name in _LINK_ARRAYS}
    if packing.given_mass_n is not None:
        found["mass_n"] = packing.given_mass_n
    springs = packing.tangential
    if springs is not None:
        found |= {f"tangential_{name}": getattr(springs, name) for name in _TANGENTIAL[1]}
    prefix, _ = _SHAPES[type(packing.shapes)]
    found |= {prefix + name: array for name, array in packing.shapes.arrays().items()}
    if springs is not None and springs.bead_c2 is not None:
        found[_SPRING_BEADS] = springs.bead_c2
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
    frame.particles.mass = packing.mass_n.astype(np.float32)
    type_n = _show(packing.shapes, frame, packing)
    frame.particles.types = [_type_name(k) for k in range(int(type_n.max()) + 1)]
    frame.particles.typeid = type_n.astype(np.uint32)
    own = _arrays_of(packing)
    # chunks of the links stand last; the schema has no truth values
    for name in sorted(own, key=_is_of_links):
        frame.log[_LOG + name] = own[name].astype(np.uint8) if name == "link_shape_l" else own[name]
    if len(packing.links):
        _show_links(frame, packing.links)
    with gsd.hoomd.open(str(path), "w") as file:
        file.append(frame)


def _type_name(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else f"A{number}"


def _is_of_links(name: str) -> bool:
    return name.startswith(_LINKS[0])


@functools.singledispatch
def _show(shapes: Shapes, frame: Any, packing: Packing) -> NDArray[np.int64]:
    """Give the frame sizes, shapes of particle types and orientations; return the type of each particle.

    Here of discs and spheres; other shapes are registered below.
    """
    frame.particles.diameter = packing.diameter_n.astype(np.float32)
    size_k, type_n = np.unique(packing.radius_n, return_inverse=True)
    if len(size_k) > DISCRETE_SIZES:
        return np.zeros_like(type_n)
    # the schema does not store diameters that are all 1, and OVITO takes them for 0 then
    frame.particles.type_shapes = [{"type": "Sphere", "diameter": 2.0 * size} for size in size_k.tolist()]
    return type_n


@_show.register
def _(shapes: Beads, frame: Any, packing: Packing) -> NDArray[np.int64]:
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


@_show.register
def _(shapes: Spheroids, frame: Any, packing: Packing) -> NDArray[np.int64]:
    frame.particles.diameter = packing.diameter_n.astype(np.float32)
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


@dataclass(frozen=True, eq=False)
class _Seen:
    """What particles of a frame are: radii and shapes, and vectors from their positions to their centers of mass."""

    radius_n: NDArray[np.float64]
    shapes: Shapes | None
    center_nd: NDArray[np.float64]


# kinds of shape definitions of which a packing can be
_KINDS = ("Sphere", "Ellipsoid", "SphereUnion")


def _definitions(frame: Any) -> list[dict[str, Any]]:
    """Return the shape definition of each particle's type, {} where it has none, after checking those in use."""
    particles = frame.particles
    type_n = np.asarray(particles.typeid, dtype=np.int64)
    if type_n.max(initial=0) >= len(particles.types):
        raise ValueError(f"its particles must have types below {len(particles.types)}, got {type_n.max()}")
    defined = (list(particles.type_shapes or []) + [{}] * len(particles.types))[: len(particles.types)]
    diameter = np.asarray(particles.diameter)
    any_defined = any(defined[k] for k in np.unique(type_n))
    for k in np.unique(type_n):
        name, kind = particles.types[k], defined[k].get("type")
        if defined[k] and kind not in _KINDS:
            raise ValueError(
                f"its particle types must be spheres, ellipsoids or unions of spheres, got {kind!r} for type {name!r}"
            )
        given = diameter[type_n == k]
        # the schema does not store diameters that are all 1
        if any_defined and not defined[k] and (given == 1.0).all():
            raise ValueError(
                f"its particle types must all have shape definitions or diameters where one has, got none for {name!r}"
            )
        if kind == "Sphere":
            size = _size(defined[k], "diameter", name)
            if not (given == 1.0).all() and not np.allclose(given, size, rtol=_SINGLE, atol=0.0):
                wrong = float(given[np.abs(given - size).argmax()])
                raise ValueError(
                    f"its particles/diameter and particles/type_shapes must agree, got {wrong:g} and {size:g} for type "
                    f"{name!r}"
                )
    return [defined[k] for k in type_n]


def _size(definition: dict[str, Any], key: str, name: str) -> float:
    """Return a length of a shape definition."""
    if key not in definition:
        raise ValueError(f"its {definition['type']} of type {name!r} must have {key!r}, got {', '.join(definition)}")
    return positive(f"{key} of type {name!r}", definition[key])


def _turns(frame: Any) -> NDArray[np.float64]:
    """Return the (N, 3, 3) rotations of the frame's particles, whose columns are the turned axes."""
    turn = np.asarray(frame.particles.orientation, dtype=np.float64)
    size = np.sqrt((turn**2).sum(axis=1))
    if not (np.abs(size - 1.0) < 1e-3).all():
        n = int(np.abs(size - 1.0).argmax())
        raise ValueError(f"its orientations must be unit quaternions, got {turn[n].tolist()} for particle {n}")
    w, x, y, z = (turn / size[:, None]).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _seen_shapes(frame: Any, dimension: int) -> _Seen:
    """Return what the frame's particles are, by the shape definitions of their types or else by their diameters."""
    definition_n = _definitions(frame)
    kinds = {one.get("type", "Sphere") for one in definition_n}
    body = np.asarray(frame.particles.body, dtype=np.int64)
    joined = np.flatnonzero(body != -1)
    # a body that is one particle with a shape is that shape
    shaped = all(definition_n[n].get("type") in ("Ellipsoid", "SphereUnion") for n in joined)
    if len(joined) and not (shaped and len(np.unique(body[joined])) == len(joined)):
        raise ValueError(
            f"its particles must not form bodies, got particles/body {body[joined[0]]} for particle {joined[0]}: the "
            "file does not say which particles of a body are solid; give positions and radii of these, and the numbers "
            "of their bodies, to pm.rigid_packing"
        )
    if kinds >= {"Ellipsoid", "SphereUnion"}:
        raise ValueError("its particle types must not be ellipsoids and unions of spheres in one packing, got both")
    half = 0.5 * np.asarray(frame.particles.diameter, dtype=np.float64)
    names = [frame.particles.types[k] for k in frame.particles.typeid]
    radius_n = half.copy()
    for n, one in enumerate(definition_n):
        if one.get("type") == "Sphere":
            radius_n[n] = 0.5 * _size(one, "diameter", names[n])
    if "SphereUnion" in kinds:
        return _seen_beads(frame, definition_n, names, radius_n, dimension)
    if "Ellipsoid" in kinds:
        return _seen_spheroids(frame, definition_n, names, radius_n, dimension)
    return _Seen(radius_n, None, np.zeros((len(radius_n), dimension)))


def _seen_spheroids(
    frame: Any, definition_n: list[dict[str, Any]], names: list[str], radius_n: NDArray[np.float64], dimension: int
) -> _Seen:
    """Return the frame's ellipsoids, whose equal axes may be any two; in the plane, their sections there."""
    axes = np.repeat(radius_n[:, None], 3, axis=1)
    for n, one in enumerate(definition_n):
        if one.get("type") == "Ellipsoid":
            # a definition in the plane may leave c out
            axes[n] = [_size(one, key, names[n]) for key in ("a", "b", "c" if "c" in one else "b")]
    turn = _turns(frame)
    many = np.arange(len(axes))
    if dimension == 2:
        # in the plane are the two axes that are not along z
        upright = np.abs(turn[:, 2]).argmax(axis=1)
        tilted = (np.abs(turn[many, 2, upright]) < 1.0 - 1e-5) & (np.ptp(axes, axis=1) > 0.0)
        if tilted.any():
            n = int(tilted.argmax())
            raise ValueError(
                f"its ellipsoids must have an axis along z in two dimensions, got another for particle {n}"
            )
        first, other = np.array([[1, 2], [0, 2], [0, 1]])[upright].T
    else:
        # the axis that differs from the others, which are equal; the first where all are
        pair = np.array([[1, 2], [0, 2], [0, 1]])
        apart = np.abs(axes[:, pair[:, 0]] - axes[:, pair[:, 1]]) / axes.max(axis=1, keepdims=True)
        equal = apart <= _SINGLE
        if not equal.any(axis=1).all():
            n = int((~equal.any(axis=1)).argmax())
            raise ValueError(
                f"its ellipsoids must have two equal axes, got {axes[n].tolist()} for particle {n} of type {names[n]!r}"
            )
        first = equal.argmax(axis=1)
        other = pair[first, 0]
    along, across = axes[many, first], axes[many, other]
    director = turn[many, :dimension, first]
    radius = np.sqrt(along * across) if dimension == 2 else np.cbrt(along * across * axes[many, pair[first, 1]])
    return _Seen(radius, Spheroids(along / across, director), np.zeros((len(axes), dimension)))


def _seen_beads(
    frame: Any, definition_n: list[dict[str, Any]], names: list[str], radius_n: NDArray[np.float64], dimension: int
) -> _Seen:
    """Return the frame's unions of spheres, each about its center of mass, and the radii of equal area or volume."""
    known: dict[tuple[str, float], UnionBody] = {}
    own = []
    for name, one, radius in zip(names, definition_n, radius_n.tolist(), strict=True):
        key = (name, 0.0 if one.get("type") == "SphereUnion" else radius)
        if key not in known:
            known[key] = (
                _union(one, name, dimension) if key[1] == 0.0 else body_of(np.zeros((1, dimension)), np.array([radius]))
            )
        own.append(known[key])
    turn = _turns(frame)
    if dimension == 2 and (np.abs(turn[:, 2, 2]) < 1.0 - 1e-5).any():
        n = int(np.abs(turn[:, 2, 2]).argmin())
        raise ValueError(
            f"its unions of spheres must turn about z in two dimensions, got another axis for particle {n}"
        )
    if dimension == 2 and (turn[:, 2, 2] < 0.0).any():
        n = int(turn[:, 2, 2].argmin())
        raise ValueError(f"its unions of spheres must not be turned over in two dimensions, got particle {n} so")
    turn = turn[:, :dimension, :dimension]
    frames = turn @ np.array([one.frame_dd for one in own])
    shapes = beads_of(own, np.array([orientation_of(one) for one in frames]))
    center = (turn @ np.array([one.center_d for one in own])[:, :, None])[:, :, 0]
    return _Seen(np.array([one.radius for one in own]), shapes, center)


def _union(definition: dict[str, Any], name: str, dimension: int) -> UnionBody:
    """Return the rigid body that a shape definition says."""
    missing = next((key for key in ("centers", "diameters") if key not in definition), None)
    if missing is not None:
        raise ValueError(f"its SphereUnion of type {name!r} must have {missing!r}, got {', '.join(definition)}")
    center = finite_array(f"centers of type {name!r}", definition["centers"], shape=(None, None), what="sphere")
    if center.shape[1] not in (dimension, 3) or np.abs(center[:, dimension:]).max(initial=0.0) > 0.0:
        raise ValueError(f"centers of type {name!r} must have {dimension} components, got {center[0].tolist()}")
    diameter = positive_array(
        f"diameters of type {name!r}", definition["diameters"], shape=(len(center),), what="sphere"
    )
    return body_of(center[:, :dimension], 0.5 * diameter)


# what a packing has no place for: words, names of the arrays, and their values where there is none
_NO_PLACE = (
    ("velocities", "velocity", 0.0),
    ("angular momenta", "angmom", 0.0),
    ("charges", "charge", 0.0),
    ("moments of inertia", "moment_inertia", 0.0),
)


def _left_out(frame: Any, seen: Packing, own_log: set[str]) -> list[str]:
    """Return what the frame holds and a packing has no place for."""
    particles = frame.particles
    found = [words for words, name, none in _NO_PLACE if (np.asarray(getattr(particles, name)) != none).any()]
    round_ = not seen.shapes.has_orientations
    if round_ and (np.asarray(particles.orientation) != [1.0, 0.0, 0.0, 0.0]).any():
        found.append("orientations (its types have no shape that could turn)")
    diameter = np.asarray(particles.diameter)
    if not round_ and not (diameter == 1.0).all():
        if not np.allclose(diameter, seen.diameter_n, rtol=_SINGLE, atol=0.0):
            found.append("particles/diameter (sizes are those of particles/type_shapes)")
    used = np.unique(particles.typeid)
    defined = (list(particles.type_shapes or []) + [{}] * len(particles.types))[: len(particles.types)]
    looks = {
        (json.dumps(defined[k], sort_keys=True), *np.unique(diameter[particles.typeid == k]).tolist()) for k in used
    }
    if len(looks) < len(used):
        found.append(f"particle types ({', '.join(particles.types[k] for k in used)}), some of one size and shape")
    linked = {(min(a, b), max(a, b)) for a, b in np.asarray(frame.constraints.group).reshape(-1, 2).tolist()}
    spare = [
        k for k, (a, b) in enumerate(np.asarray(frame.bonds.group).reshape(-1, 2)[: frame.bonds.N].tolist())
        if (min(a, b), max(a, b)) not in linked or not frame.constraints.N
    ]  # fmt: skip
    if spare:
        found.append(
            f"{len(spare)} bonds (they have no lengths there: give them, with lengths, as pm.Links or pm.Bonds)"
        )
    for name in ("angles", "dihedrals", "impropers", "pairs"):
        count = int(getattr(frame, name).N)
        if count:
            found.append(f"{count} {name}")
    others = sorted(name for name in frame.log if name not in own_log)
    if others:
        found.append(f"log entries {', '.join(others)}")
    return found


def _shown(links: Links) -> NDArray[np.bool_]:
    """Return which links the schema can show: it has no place for a particle's link with its own image."""
    shown: NDArray[np.bool_] = links.i_l != links.j_l
    return shown


def _show_links(frame: Any, links: Links) -> None:
    """Give the frame the links as constraints and bonds."""
    shown = _shown(links)
    group = np.column_stack([links.i_l, links.j_l])[shown]
    frame.constraints.N = len(group)
    frame.constraints.group = group.astype(np.uint32)
    frame.constraints.value = links.length_l[shown].astype(np.float32)
    frame.bonds.N = len(group)
    frame.bonds.group = group.astype(np.uint32)
    frame.bonds.types = _BOND_TYPES
    frame.bonds.typeid = links.shape_l[shown].astype(np.uint32)


def _seen_links(frame: Any, position_nd: NDArray[np.float64], box: Box) -> Links:
    """Return the frame's constraints as links to the nearest image; those that are bonds of type "shape" as such."""
    if not frame.constraints.N:
        return Links.none(box.dimension)
    i, j = np.asarray(frame.constraints.group, dtype=np.int64).reshape(-1, 2).T
    image = -np.rint((position_nd[j] - position_nd[i]) @ box.inverse_dd.T).astype(np.int64)
    bonds = frame.bonds
    shapes: set[tuple[int, int]] = set()
    if bonds.N and "shape" in bonds.types:
        marked = np.asarray(bonds.group)[np.asarray(bonds.typeid) == bonds.types.index("shape")]
        shapes = {(min(a, b), max(a, b)) for a, b in marked.tolist()}
    shape = [(min(a, b), max(a, b)) in shapes for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    links = Links(i, j, image, np.asarray(frame.constraints.value, dtype=np.float64), np.array(shape))
    # single precision keeps positions less well than lengths: a link is as long as its particles are apart
    distance = np.sqrt((links.vectors(position_nd, box.lattice_dd) ** 2).sum(axis=1))
    error = np.abs(distance - links.length_l)
    rounded = (error > 0.1 * LINK_TOLERANCE * links.length_l) & (error <= _SINGLE * np.abs(box.lattice_dd).max())
    return dataclasses.replace(links, length_l=np.where(rounded, distance, links.length_l))


def _three_axes(array_nd: NDArray[Any]) -> NDArray[Any]:
    padded = np.zeros((len(array_nd), 3))
    padded[:, : array_nd.shape[1]] = array_nd
    return padded


def read_gsd(path: Path, frame: int | None = None) -> tuple[Packing, list[str]]:
    """Return the packing in a frame: the exact one where packmech wrote it, else what every reader sees.

    Also what the frame holds and a packing has no place for.

    Raises
    ------
    ValueError
        If the file has no such frame or no particles, if particles are of shapes that packings cannot have, or if its
        exact and its visible packing differ by more than rounding to single precision (another program changed one of
        them).

    """
    import gsd.hoomd

    with gsd.hoomd.open(str(path), "r") as file:
        if len(file) == 0:
            raise ValueError("it must hold at least one frame, got none")
        number = len(file) - 1 if frame is None else frame
        if not -len(file) <= number < len(file):
            raise ValueError(f"frame must be below {len(file)}, the number of frames, got {number}")
        number %= len(file)
        found = file[number]
        # the library fills in the chunks of frame 0, which are of another packing
        found.log = {name: one for name, one in found.log.items() if file.file.chunk_exists(number, f"log/{name}")}
    dimension = int(found.configuration.dimensions)
    lattice = _lattice(found.configuration.box, dimension)
    position = np.asarray(found.particles.position, dtype=np.float64)
    box = Box(lattice)
    if dimension == 2:
        side = float(np.abs(lattice).max())
        if np.abs(position[:, 2]).max(initial=0.0) > 1e-5 * side or any(found.configuration.box[4:]):
            raise ValueError("its particles and box must lie in the plane z = 0 in two dimensions, got others")
    place = position[:, :dimension] + found.particles.image[:, :dimension] @ lattice.T
    mass_n = np.asarray(found.particles.mass, dtype=np.float64)
    what = _seen_shapes(found, dimension)
    seen = Packing(
        place + what.center_nd, what.radius_n, box, mass_n=None if (mass_n == 1.0).all() else mass_n, shapes=what.shapes
    )
    own = {name.removeprefix(_LOG): one for name, one in found.log.items() if name.startswith(_LOG)}
    left_out = _left_out(found, seen, {_LOG + name for name in own if name in _OWN})
    if any(own.get(name) is None for name in _REQUIRED):
        return seen.replace(links=_seen_links(found, seen.position_nd, box)), left_out
    if "link_shape_l" in own:
        own["link_shape_l"] = own["link_shape_l"].astype(bool)
    exact = _packing_in(own)
    if not (_agree(exact, seen) and _same_links(exact.links, found.constraints)):
        raise ValueError("its log/packmech chunks and its visible particles must be one packing, got two that differ")
    return exact, left_out


def _same_links(links: Links, constraints: Any) -> bool:
    """Return whether the visible constraints are the links rounded to single precision."""
    if not constraints.N:
        return not _shown(links).any()
    shown = links.select(_shown(links))
    group = np.asarray(constraints.group, dtype=np.int64).reshape(-1, 2)
    return bool(
        np.array_equal(group, np.column_stack([shown.i_l, shown.j_l]))
        and np.array_equal(np.asarray(constraints.value, dtype=np.float32), shown.length_l.astype(np.float32))
    )


def _agree(exact: Packing, seen: Packing) -> bool:
    """Return whether the visible packing is the exact one rounded to single precision."""
    if (exact.particles, exact.dimension) != (seen.particles, seen.dimension):
        return False
    if type(exact.shapes) is not type(seen.shapes) or not np.array_equal(exact.shapes.start_n, seen.shapes.start_n):
        return False
    turned, arm = _visible_directions(exact, exact.shapes.arms(exact.radius_n)), seen.shapes.arms(seen.radius_n)
    if np.abs(turned - arm).max() > _SINGLE * float(exact.shapes.reach(exact.radius_n).max()):
        return False
    aspect, other = (along / across for along, across in (one.shapes.semi_axes(one.radius_n) for one in (exact, seen)))
    along = np.abs((_visible_directions(exact, exact.shapes.axis_bd) * seen.shapes.axis_bd).sum(axis=1))
    if not (np.allclose(aspect, other, rtol=_SINGLE) and (along[aspect != 1.0] > 1.0 - _SINGLE).all()):
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
