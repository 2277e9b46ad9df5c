"""Packings as arrays by name, and as numpy's .npz files of these: everything, exactly.

``position_nd`` (N, d), ``radius_n`` (N,), ``lattice_dd`` (d, d) with the lattice vectors as columns, ``format_version``
and, when it is known, ``law`` (a JSON table such as ``{"kind": "harmonic", "energy_scale": 1.0}``). A file with the
first three arrays alone is read too. A packing with links has them as ``link_i_l``, ``link_j_l``, ``link_image_ld``,
``link_length_l`` and ``link_shape_l``, as ``pm.Links`` describes them; such a file is of format version 2, so that a
reader without links refuses it. Masses that were given are ``mass_n`` (N,), and make it version 3. Tangential
displacements of contacts, which make it version 4, are ``tangential_i_c``, ``tangential_j_c``, ``tangential_image_cd``
and ``tangential_displacement_ck``, as ``pm.TangentialDisplacements`` describes them. Ellipses and spheroids, which make
it version 5, are ``spheroid_aspect_n`` and ``spheroid_director_nd``, as ``pm.Spheroids`` describes them, and rigid
bodies, which make it version 6, the fields of ``pm.Beads`` after ``bead_``; their tangential displacements, which make
it version 7, have ``tangential_bead_c2``, too; ``tangential_rolling_ck`` and ``tangential_twisting_c`` make version 8,
kinds of particles, ``kind_n`` (N,) where there are several, version 9, and the fields of ``pm.Superellipsoids`` after
``superellipsoid_`` version 10.
Of a `Snapshot`, fields are arrays ``field_NAME``, forces of contacts
``contact_i_c`` and so on, springs ``bonds`` (a JSON table in bytes), and there is ``step``; none of them changes the
packing, nor the version. Other arrays are left out, and listed in a warning. ``sha256`` seals all arrays, as the head
of ``packmech.files.archive`` says.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from packmech.box import Box
from packmech.check import brief
from packmech.effects.bonds import BondLimits, Bonds
from packmech.effects.laws import registered_laws
from packmech.files.archive import SEAL, read_archive, write_archive
from packmech.files.formats import BONDS, EVERYTHING, FORCES, LAW, STEP, SUPERELLIPSOIDS, Format, Given, One
from packmech.files.records import OpenKinds, from_table, kinds_of, to_table
from packmech.files.snapshot import ContactData, Snapshot
from packmech.links import Links
from packmech.packing import Packing
from packmech.shapes import Beads, Discs, Shapes, Spheroids, Superellipsoids
from packmech.tangential import TangentialDisplacements

# a file without links and masses is of version 1, one without masses at most of version 2, and one whose tangential
# springs are slack of version 3; one of discs or spheres at most of version 4, one of spheroids of version 5
_FORMAT_VERSION = 10
_LINK_ARRAYS = ("i_l", "j_l", "image_ld", "length_l", "shape_l")
# arrays that belong together: what their names begin with, the names of their fields, and whose they are
LINK_GROUP = ("link_", _LINK_ARRAYS, "links")
_TANGENTIAL = ("tangential_", ("i_c", "j_c", "image_cd", "displacement_ck"), "tangential displacements")
# fields of tangential displacements that not all have
_SPRINGS_ALSO = ("bead_c2", "rolling_ck", "twisting_c", "memory_ck", "at_wall_w", "wall_stretch_wk")
_SPHEROIDS = ("spheroid_", ("aspect_n", "director_nd"), "shapes")
_BEADS = ("bead_", ("start_n", "offset_bd", "size_b", "gyration_nk", "orientation_nq"), "shapes")
_SUPERELLIPSOIDS = ("superellipsoid_", ("exponent_n", "ratio_nd", "orientation_nq"), "shapes")
# of the arrays of shapes: what their names begin with, and the version of the format that has them
_SHAPES = {
    Discs: ("", 1),
    Spheroids: (_SPHEROIDS[0], 5),
    Beads: (_BEADS[0], 6),
    Superellipsoids: (_SUPERELLIPSOIDS[0], 10),
}
REQUIRED = ("position_nd", "radius_n", "lattice_dd")
# all arrays that a file may hold of a packing
OWN = (
    *REQUIRED,
    "mass_n",
    "kind_n",
    *(_TANGENTIAL[0] + name for name in _SPRINGS_ALSO),
    *(
        prefix + name
        for prefix, names, _ in (LINK_GROUP, _TANGENTIAL, _SPHEROIDS, _BEADS, _SUPERELLIPSOIDS)
        for name in names
    ),
)
FIELD, CONTACT = "field_", "contact_"


def _arrays(path: Path) -> dict[str, Any]:
    arrays: dict[str, Any] = read_archive(path)
    version = arrays.get("format_version", np.array(_FORMAT_VERSION))
    if version.shape != () or version.dtype.kind not in "iu" or not 1 <= version <= _FORMAT_VERSION:
        raise ValueError(
            f"format_version must be an integer from 1 to {_FORMAT_VERSION}, got {brief(version.tolist())}"
        )
    return arrays


def _read(path: Path) -> tuple[Snapshot, list[str]]:
    arrays = _arrays(path)
    missing = [name for name in REQUIRED if name not in arrays]
    if missing:
        raise ValueError(f"it must hold the arrays {', '.join(missing)}, got {', '.join(arrays) or 'none'}")
    left_out = [name for name in arrays if not is_own(name) and name not in ("format_version", "law", SEAL)]
    return snapshot_in(arrays), [f"arrays {', '.join(left_out)}"] if left_out else []


def is_own(name: str) -> bool:
    """Return whether a snapshot's array has this name."""
    return name in (*OWN, "step", "bonds") or name.startswith((FIELD, CONTACT))


def snapshot_in(arrays: Mapping[str, Any]) -> Snapshot:
    """Return the snapshot that is written out in arrays."""
    packing = packing_in(arrays)
    contacts = _group(arrays, CONTACT, tuple(ContactData.__dataclass_fields__), "contact forces")
    if contacts is not None:
        # the schema of gsd flattens a single column, and what has no rows
        contacts = [one.reshape(-1, packing.dimension) if one.ndim == 2 else one for one in contacts]
    return Snapshot(
        packing,
        {name.removeprefix(FIELD): one for name, one in arrays.items() if name.startswith(FIELD)},
        _bonds_in(arrays["bonds"]) if "bonds" in arrays else (),
        None if contacts is None else ContactData(*contacts),
        int(np.ravel(arrays["step"])[0]) if "step" in arrays else None,
    )


def packing_in(arrays: Mapping[str, Any]) -> Packing:
    """Return the packing that is written out in arrays."""
    box, links = Box(arrays["lattice_dd"]), _group(arrays, *LINK_GROUP)
    return Packing(
        arrays["position_nd"],
        arrays["radius_n"],
        box,
        Links(*links) if links else None,
        arrays.get("mass_n"),
        _springs_in(arrays),
        _shapes_in(arrays),
        arrays.get("kind_n"),
    )


def _springs_in(arrays: Mapping[str, Any]) -> TangentialDisplacements | None:
    """Return the tangential displacements that are written out in arrays, if there are any."""
    springs = _group(arrays, *_TANGENTIAL)
    also = {name: arrays[whole] for name in _SPRINGS_ALSO if arrays.get(whole := _TANGENTIAL[0] + name) is not None}
    if springs is None:
        if also:
            alone = ", ".join(_TANGENTIAL[0] + name for name in also)
            raise ValueError(f"it must hold all arrays of its tangential displacements, got {alone} alone")
        return None
    i_c, j_c, image_cd, displacement_ck = springs
    # the schema of gsd flattens a single column
    if displacement_ck.ndim == 1:
        displacement_ck = displacement_ck[:, None]
    for name in ("rolling_ck", "memory_ck", "wall_stretch_wk"):
        if name in also and also[name].ndim == 1:
            also[name] = also[name][:, None]
    return TangentialDisplacements(i_c, j_c, image_cd, displacement_ck, **also)


def _shapes_in(arrays: Mapping[str, Any]) -> Shapes | None:
    """Return the shapes that are written out in arrays, if there are any."""
    spheroids, beads, superellipsoids = (_group(arrays, *one) for one in (_SPHEROIDS, _BEADS, _SUPERELLIPSOIDS))
    if sum(one is not None for one in (spheroids, beads, superellipsoids)) > 1:
        raise ValueError("it must hold arrays of spheroids, of rigid bodies or of superellipsoids, got several of them")
    if superellipsoids is not None:
        return Superellipsoids(*superellipsoids)
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


def _write(snapshots: Iterable[Snapshot], path: Path) -> None:
    (snapshot,) = snapshots
    write_npz(snapshot, path)


def write_npz(snapshot: Snapshot, path: Path, law: Any = None) -> None:
    """Write the snapshot, and the law between its particles where it is known."""
    packing = snapshot.packing
    own = arrays_of(packing)
    # the arrays that make a file one of a later version
    needs = {"link_i_l": 2, "mass_n": 3, "tangential_i_c": 4, "tangential_bead_c2": 7, "tangential_rolling_ck": 8}
    needs |= {"tangential_twisting_c": 8, "kind_n": 9}
    version = max(_SHAPES[type(packing.shapes)][1], *(needs.get(name, 1) for name in own))
    arrays: dict[str, Any] = {"format_version": np.array(version), **own, **arrays_beside(snapshot)}
    if law is not None:
        arrays["law"] = np.array(json.dumps(to_table(law)))
    with open(path, "wb") as file:
        write_archive(file, arrays)


def read_law(path: Path) -> Any:
    """Return the law that is written beside a packing, None where none is."""
    text = _arrays(path).get("law")
    laws = OpenKinds(kinds_of(registered_laws()), "pm.law")
    return None if text is None else from_table(json.loads(str(text)), "law", laws, {"law": laws, "laws": laws})


def arrays_beside(snapshot: Snapshot) -> dict[str, Any]:
    """Return fields, contact forces and the step of a snapshot as arrays."""
    found: dict[str, Any] = {FIELD + name: array for name, array in snapshot.fields.items()}
    if snapshot.contact_forces is not None:
        found |= {CONTACT + name: one for name, one in snapshot.contact_forces.arrays().items()}
    if snapshot.bonds:
        tables = [{name: _plain(one) for name, one in to_table(bonds).items()} for bonds in snapshot.bonds]
        # the schema of gsd has no words
        found["bonds"] = np.frombuffer(json.dumps(tables).encode(), dtype=np.uint8)
    if snapshot.step is not None:
        # nor numbers that are no arrays
        found["step"] = np.array([snapshot.step])
    return found


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _bonds_in(text: Any) -> tuple[Bonds, ...]:
    laws = kinds_of(registered_laws())
    nested = {"compression": laws, "tension": laws, "law": laws, "breaks_at": kinds_of((BondLimits,))}
    tables = json.loads(np.asarray(text, dtype=np.uint8).tobytes())
    return tuple(from_table(one, "bonds", {"bonds": Bonds}, nested) for one in tables)


def arrays_of(packing: Packing) -> dict[str, Any]:
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
    if packing.given_kind_n is not None:
        found["kind_n"] = packing.given_kind_n
    springs = packing.tangential
    if springs is not None:
        prefix = _TANGENTIAL[0]
        found |= {prefix + name: getattr(springs, name) for name in _TANGENTIAL[1]}
        also = {prefix + name: getattr(springs, name) for name in _SPRINGS_ALSO}
        found |= {name: array for name, array in also.items() if array is not None}
    prefix, _ = _SHAPES[type(packing.shapes)]
    found |= {prefix + name: array for name, array in packing.shapes.arrays().items()}
    return found


def _frames(path: Path, given: Given) -> One:
    return One(lambda: _read(path))


NPZ = Format("npz", (".npz",), EVERYTHING | {SUPERELLIPSOIDS, BONDS, FORCES, STEP, LAW}, _frames, _write)
