"""Packings as frames of .gsd files, the schema of HOOMD, for freud, OVITO and HOOMD.

HOOMD keeps single precision, a box centered on the origin whose lattice vectors form an upper triangular matrix with a
positive diagonal, and particles inside it. A packing is therefore written twice into its frame:

visible to every reader
    ``configuration/box`` (2D: ``dimensions`` 2, unit height), ``particles/position`` wrapped into that box and rotated
    with it, ``particles/image`` as taken away, ``particles/diameter`` and ``particles/mass``, one particle type for
    each of up to ten sizes, ``A``, ``B`` and so on; where particles are of several kinds one for each kind and size,
    ``kind0_A``, ``kind1_A``: names that say kinds are read of other programs' files, too. Rigid bodies have no
    diameters: OVITO would scale their beads by them. The schema does not store masses that are all 1: in other
    programs' files they are read as not given.
    Links are ``constraints`` (pair and length) and ``bonds`` of the types "bond" and "shape", for what draws or holds
    them. The schema has no place for a link's image: readers take the nearest one. A particle's link with its own
    image is left out. Ellipses and spheroids have orientations and, for each particle type, shape definitions of the
    kind "Ellipsoid", whose first axis is that along the director; rigid bodies such of the kind "SphereUnion", and
    discs and spheres of up to ten sizes such of the kind "Sphere". Velocities stand where the schema has them, other
    fields are log chunks ``log/particles/...``. Springs and contacts are further bonds, of the types "spring" and
    "contact", whose forces are ``log/bonds/normal_force`` and ``tangential_force``, nan of what is no contact.
exact, for packmech
    the log chunks ``log/packmech/...``, the arrays of an ``.npz`` file, in double precision, as they were. The bytes of
    ``log/packmech/sha256`` seal them, and the fields of particles, as those of an ``.npz`` file are sealed; a frame
    without them all is refused, as what is left of it would be single precision.

Of what another program wrote, a packing gets ``configuration``, ``particles/position`` unwrapped by
``particles/image``, ``mass``, ``constraints`` as links to the nearest image, and sizes and shapes by
``particles/type_shapes``, else by ``particles/diameter``. "Ellipsoid" may have any two axes equal (in the plane those
that lie in it are an ellipse's), "SphereUnion" any origin. Refused are polygons, polyhedra, meshes, ellipsoids of
three axes, diameters that contradict a "Sphere", particles that ``particles/body`` joins, and what leaves the plane in
2D. Velocities and log chunks of particles are fields. Left out, and listed in a warning, are angular momenta, charges,
moments of inertia, orientations of spheres, bonds without a constraint, angles, dihedrals, impropers, pairs, and other
log chunks. A link that single precision of the positions puts off its length is as long as its particles are apart.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.calls.honors import LINK_TOLERANCE
from packmech.check import brief, finite_array, positive, positive_array
from packmech.files.archive import SEAL, check_seal, seal
from packmech.files.formats import BONDS, EVERYTHING, FORCES, STEP, Format, Given, numeric
from packmech.files.npz import FIELD, LINK_GROUP, REQUIRED, arrays_beside, arrays_of, is_own, snapshot_in
from packmech.files.orientations import ROUNDING, quaternions_to, rotations_of, spheroids_of
from packmech.files.snapshot import Snapshot
from packmech.generate.rigid import UnionBody, beads_of, body_of, orientation_of
from packmech.links import Links
from packmech.packing import DISCRETE_SIZES, MOST_KINDS, Packing
from packmech.shapes import Beads, Shapes, Spheroids

# log chunks of packmech's own, of particles, and of bonds
_LOG, _OF_PARTICLES, _OF_BONDS = "packmech/", "particles/", "bonds/"
_BOND_TYPES = ["bond", "shape"]
_SPRING, _CONTACT = "spring", "contact"
# the name of a particle type where there are several kinds
_KIND_NAME = re.compile(r"kind(\d+)_[A-Z]\d*")
_SINGLE = ROUNDING
# of what a frame of the schema has counts
_COUNTED = ("particles", "bonds", "angles", "dihedrals", "impropers", "constraints", "pairs")


@dataclass(frozen=True, eq=False)
class Visible:
    """A packing as the HOOMD schema says it: upper triangular box, particles around its center."""

    lattice_dd: NDArray[np.float64]
    position_nd: NDArray[np.float64]
    image_nd: NDArray[np.int32]

    @property
    def hoomd_box(self) -> list[float]:
        """The lengths and tilts of the box, of unit height in a plane."""
        return _hoomd_box(self.lattice_dd)


def visible_of(packing: Packing) -> Visible:
    """Return the packing turned and wrapped as HOOMD and freud want it."""
    lattice = packing.box.lattice_dd
    # the mirrored last vector spans the same lattice, and only a right-handed one can be rotated to triangular form
    sign = np.ones(packing.dimension)
    sign[-1] = np.sign(np.linalg.det(lattice))
    triangular = np.linalg.qr(lattice * sign)[1]
    triangular = np.sign(np.diag(triangular))[:, None] * triangular
    fraction = (packing.position_nd @ packing.box.inverse_dd.T) * sign
    image = np.floor(fraction + 0.5)
    return Visible(triangular, (fraction - image) @ triangular.T, image.astype(np.int32))


def _hoomd_box(lattice_dd: NDArray[np.float64]) -> list[float]:
    side = np.diag(lattice_dd)
    if len(side) == 2:
        return [side[0], side[1], 1.0, lattice_dd[0, 1] / side[1], 0.0, 0.0]
    return [*side, lattice_dd[0, 1] / side[1], lattice_dd[0, 2] / side[2], lattice_dd[1, 2] / side[2]]


def hoomd_lattice(hoomd_box: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """Return the (d, d) lattice vectors, in columns, of lengths and tilts of a box."""
    x, y, z, xy, xz, yz = np.asarray(hoomd_box, dtype=np.float64)
    return np.array([[x, xy * y, xz * z], [0.0, y, yz * z], [0.0, 0.0, z]])[:dimension, :dimension]


def frame_of(snapshot: Snapshot) -> Any:
    """Return the snapshot as a frame of the schema, a `gsd.hoomd.Frame`."""
    import gsd.hoomd

    packing = snapshot.packing
    visible = visible_of(packing)
    dimension = packing.dimension
    frame = gsd.hoomd.Frame()
    frame.configuration.step = snapshot.step or 0
    frame.configuration.dimensions = dimension
    frame.configuration.box = visible.hoomd_box
    frame.particles.N = packing.particles
    frame.particles.position = _three_axes(visible.position_nd).astype(np.float32)
    frame.particles.image = _three_axes(visible.image_nd).astype(np.int32)
    frame.particles.mass = packing.mass_n.astype(np.float32)
    if "velocity_nd" in snapshot.fields:
        velocity = _visible_directions(packing, snapshot.fields["velocity_nd"])
        frame.particles.velocity = _three_axes(velocity).astype(np.float32)
    _show_types(frame, packing)
    own = arrays_of(packing) | arrays_beside(snapshot)
    # chunks of the links stand last; the schema has no truth values
    for name in sorted(own, key=_is_of_links):
        place = _LOG + name
        if name.startswith(FIELD) and name != FIELD + "velocity_nd":
            place = _OF_PARTICLES + name.removeprefix(FIELD)
        frame.log[place] = own[name].astype(np.uint8) if name == "link_shape_l" else own[name]
    if len(packing.links):
        _show_links(frame, packing.links)
    digest = seal(_sealed(own))
    frame.log[_LOG + SEAL] = np.frombuffer(bytes.fromhex(digest), dtype=np.uint8)
    _show_pairs(frame, snapshot)
    return frame


def _sealed(own: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return what is sealed of the arrays of a frame: the schema flattens a single column, and has no truth values."""
    flat = {name: np.ravel(one) for name, one in own.items()}
    return {name: one.astype(np.uint8) if one.dtype == bool else one for name, one in flat.items()}


def _write(snapshots: Iterable[Snapshot], path: Path) -> None:
    import gsd.hoomd

    with gsd.hoomd.open(str(path), "w") as file:
        for snapshot in snapshots:
            file.append(frame_of(snapshot))


def _show_types(frame: Any, packing: Packing) -> None:
    """Give the frame types of particles, one for each size and shape, or for each of these of each kind."""
    look_n = _show(packing.shapes, frame, packing)
    names = [_type_name(k) for k in range(int(look_n.max()) + 1)]
    if packing.given_kind_n is not None:
        found, look_n = np.unique(np.column_stack([packing.given_kind_n, look_n]), axis=0, return_inverse=True)
        names = [f"kind{kind}_{names[look]}" for kind, look in found.tolist()]
        if frame.particles.type_shapes is not None:
            frame.particles.type_shapes = [frame.particles.type_shapes[look] for look in found[:, 1]]
    frame.particles.types = names
    frame.particles.typeid = look_n.ravel().astype(np.uint32)


def _seen_kinds(frame: Any) -> NDArray[np.int64] | None:
    """Return the kinds that the names of the particle types say; None where not all say one that a packing can have."""
    found = {k: _KIND_NAME.fullmatch(frame.particles.types[k]) for k in np.unique(frame.particles.typeid).tolist()}
    kinds = {k: int(one[1]) for k, one in found.items() if one is not None}
    if len(kinds) < len(found) or max(kinds.values()) >= MOST_KINDS:
        return None
    return np.array([kinds[k] for k in frame.particles.typeid.tolist()], dtype=np.int64)


def _type_name(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else f"A{number}"


def _is_of_links(name: str) -> bool:
    return name.startswith(LINK_GROUP[0])


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
    director = _visible_directions(packing, shapes.director_nd)
    frame.particles.orientation = quaternions_to(director).astype(np.float32)
    return np.asarray(type_n.ravel(), dtype=np.int64)


def _visible_directions(packing: Packing, direction_nd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return directions in the frame of the visible box, which is that of the packing turned."""
    lattice = packing.box.lattice_dd
    sign = np.ones(packing.dimension)
    sign[-1] = np.sign(np.linalg.det(lattice))
    return np.asarray(direction_nd @ ((lattice * sign) @ np.linalg.inv(visible_of(packing).lattice_dd)))


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
                f"its particle types must be spheres, ellipsoids or unions of spheres, "
                f"got {brief(kind)} for type {name!r}"
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
    radius, shapes = spheroids_of(axes, rotations_of(frame.particles.orientation), dimension, names)
    return _Seen(radius, shapes, np.zeros((len(axes), dimension)))


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
    turn = rotations_of(frame.particles.orientation)
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
    ("angular momenta", "angmom", 0.0),
    ("charges", "charge", 0.0),
    ("moments of inertia", "moment_inertia", 0.0),
)


def _left_out(frame: Any, seen: Packing, own_log: set[str], is_exact: bool) -> list[str]:
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
    # names of types that say kinds are read
    kind_n = np.zeros(len(diameter)) if seen.kind_n is None else seen.kind_n
    looks = {
        (json.dumps(defined[k], sort_keys=True), *np.unique(np.c_[kind_n, diameter][particles.typeid == k]).tolist())
        for k in used
    }
    if len(looks) < len(used):
        found.append(f"particle types ({', '.join(particles.types[k] for k in used)}), some of one size and shape")
    linked = {(min(a, b), max(a, b)) for a, b in np.asarray(frame.constraints.group).reshape(-1, 2).tolist()}
    spare = [
        k for k, (a, b) in enumerate(np.asarray(frame.bonds.group).reshape(-1, 2)[: frame.bonds.N].tolist())
        if (min(a, b), max(a, b)) not in linked or not frame.constraints.N
    ]  # fmt: skip
    # of a file of packmech they are springs and contacts, which it holds exactly
    spare = [] if is_exact else spare
    if spare:
        found.append(
            f"{len(spare)} bonds (they have no lengths there: give them, with lengths, as pm.Links or pm.Bonds)"
        )
    for name in ("angles", "dihedrals", "impropers", "pairs"):
        count = int(getattr(frame, name).N)
        if count:
            found.append(f"{count} {name}")
    of_bonds = (_OF_BONDS,) if is_exact else ()
    others = sorted(name for name in frame.log if name not in own_log and not name.startswith(of_bonds))
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


def _show_pairs(frame: Any, snapshot: Snapshot) -> None:
    """Give the frame springs and contacts as further bonds, with the forces of these as log chunks of bonds."""
    contacts = snapshot.contact_forces
    pairs = [(_SPRING, one.i_b, one.j_b) for one in snapshot.bonds]
    if contacts is not None:
        pairs.append((_CONTACT, contacts.i_c, contacts.j_c))
    if not pairs:
        return
    bonds = frame.bonds
    links = int(bonds.N or 0)
    groups = [np.asarray(bonds.group if links else np.zeros((0, 2))).reshape(-1, 2)]
    kinds = [np.asarray(bonds.typeid if links else np.zeros(0))]
    bonds.types = [*_BOND_TYPES, _SPRING, _CONTACT]
    for kind, i, j in pairs:
        # no pair of a particle with its own image, as of links
        group = np.column_stack([i, j])[i != j]
        groups.append(group)
        kinds.append(np.full(len(group), bonds.types.index(kind)))
    bonds.group, bonds.typeid = np.concatenate(groups).astype(np.uint32), np.concatenate(kinds).astype(np.uint32)
    bonds.N = len(bonds.group)
    if contacts is not None:
        apart = contacts.i_c != contacts.j_c
        tangential = _visible_directions(snapshot.packing, contacts.tangential_cd)[apart]
        for name, force in (("normal_force", contacts.normal_c[apart]), ("tangential_force", _three_axes(tangential))):
            # what is no contact has no force of one
            all_bonds = np.full((bonds.N, *force.shape[1:]), np.nan)
            all_bonds[bonds.N - len(force) :] = force
            frame.log[_OF_BONDS + name] = all_bonds


def _seen_links(frame: Any, position_nd: NDArray[np.float64], box: Box) -> Links:
    """Return the frame's constraints as links to the nearest image; those that are bonds of type "shape" as such."""
    if not frame.constraints.N:
        return Links.none(box.dimension)
    i, j = np.asarray(frame.constraints.group, dtype=np.int64).reshape(-1, 2).T
    image = box.nearest_images(position_nd[j] - position_nd[i])
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


@dataclass(frozen=True)
class _Frames:
    """The frames of a file."""

    path: Path

    def __len__(self) -> int:
        import gsd.hoomd

        with gsd.hoomd.open(str(self.path), "r") as file:
            return len(file)

    def frame(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return the snapshot of a frame."""
        import gsd.hoomd

        with gsd.hoomd.open(str(self.path), "r") as file:
            for at in {0, number}:
                self._check_counts(file.file, at)
            ours = file.file.find_matching_chunk_names(f"log/{_LOG}")
            # frames that another program appended have none
            if number == 0 and ours and not any(file.file.chunk_exists(0, name) for name in ours):
                raise ValueError(f"it must hold {', '.join(ours)} in frame 0, got none of them")
            found = file[number]
            # the library fills in the chunks of frame 0, which are of another packing
            found.log = {name: one for name, one in found.log.items() if file.file.chunk_exists(number, f"log/{name}")}
        return snapshot_of_frame(found)

    def _check_counts(self, file: Any, number: int) -> None:
        """Refuse a frame that counts more of something than its file has bytes: the library makes room for all."""
        for name in _COUNTED:
            if file.chunk_exists(number, f"{name}/N"):
                count = int(np.ravel(file.read_chunk(number, f"{name}/N"))[0])
                if count > self.path.stat().st_size:
                    raise ValueError(f"{name}/N must be at most the bytes of its file, got {count}")


def snapshot_of_frame(frame: Any) -> tuple[Snapshot, list[str]]:
    """Return the snapshot in a frame: the exact one where packmech wrote it, else what every reader sees.

    Also what the frame holds and a snapshot has no place for.

    Raises
    ------
    ValueError
        If the frame has no particles, if particles are of shapes that packings cannot have, or if its exact and its
        visible packing differ by more than rounding to single precision (another program changed one of them).

    """
    dimension = int(frame.configuration.dimensions)
    lattice = hoomd_lattice(frame.configuration.box, dimension)
    position = np.asarray(frame.particles.position, dtype=np.float64)
    box = Box(lattice)
    if dimension == 2:
        side = float(np.abs(lattice).max())
        if np.abs(position[:, 2]).max(initial=0.0) > 1e-5 * side or any(frame.configuration.box[4:]):
            raise ValueError("its particles and box must lie in the plane z = 0 in two dimensions, got others")
    place = position[:, :dimension] + frame.particles.image[:, :dimension] @ lattice.T
    mass_n = np.asarray(frame.particles.mass, dtype=np.float64)
    what = _seen_shapes(frame, dimension)
    seen = Packing(
        place + what.center_nd,
        what.radius_n,
        box,
        mass_n=None if (mass_n == 1.0).all() else mass_n,
        shapes=what.shapes,
        kind_n=_seen_kinds(frame),
    )
    own = {name.removeprefix(_LOG): one for name, one in frame.log.items() if name.startswith(_LOG)}
    fields = {
        name.removeprefix(_OF_PARTICLES): one
        for name, one in frame.log.items()
        if name.startswith(_OF_PARTICLES) and np.shape(one)[:1] == (len(position),)
    }
    given = own.pop(SEAL, None)
    missing = [name for name in REQUIRED if own.get(name) is None]
    is_exact = not missing
    if missing and (given is not None or any(is_own(name) for name in own)):
        raise ValueError(
            f"it must hold all chunks {_LOG}... that it was written with, got none named {', '.join(missing)}: without "
            f"any it is read in single precision"
        )
    if given is not None:
        beside = {FIELD + name: one for name, one in fields.items()}
        check_seal(_sealed(own | beside), np.asarray(given).tobytes().hex())
    unknown = next((name for name in own if not is_own(name)), None)
    if given is None and unknown is not None:
        raise ValueError(f"its chunks {_LOG}... must have names of packmech's, or a seal ({SEAL}), got {unknown!r}")
    known = {_LOG + SEAL} | {_LOG + name for name in own if is_own(name)} | {_OF_PARTICLES + name for name in fields}
    left_out = _left_out(frame, seen, known, is_exact)
    if not is_exact:
        velocity = np.asarray(frame.particles.velocity, dtype=np.float64)
        if velocity.any():
            fields["velocity_nd"] = velocity[:, :dimension]
            if velocity[:, dimension:].any():
                left_out.append("velocities out of the plane")
        links = _seen_links(frame, seen.position_nd, box)
        return Snapshot(seen.replace(links=links), fields, step=int(frame.configuration.step)), left_out
    if "link_shape_l" in own:
        own["link_shape_l"] = own["link_shape_l"].astype(bool)
    exact = snapshot_in(own | {FIELD + name: one for name, one in fields.items()})
    if not (_agree(exact.packing, seen) and _same_links(exact, frame.constraints)):
        raise ValueError("its log/packmech chunks and its visible particles must be one packing, got two that differ")
    return exact, left_out


def _same_links(exact: Snapshot, constraints: Any) -> bool:
    """Return whether the visible constraints are the links rounded to single precision."""
    links = exact.packing.links
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
    if (exact.particles, exact.dimension, exact.kinds) != (seen.particles, seen.dimension, seen.kinds):
        return False
    kind_n = exact.given_kind_n
    if kind_n is not None and not np.array_equal(kind_n, np.asarray(seen.kind_n)):
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
    visible = visible_of(exact)
    size = float(np.abs(visible.lattice_dd).max())
    apart = seen.position_nd - visible.position_nd
    return bool(
        np.allclose(seen.box.lattice_dd, visible.lattice_dd, rtol=_SINGLE, atol=_SINGLE * size)
        and np.allclose(seen.radius_n, exact.radius_n, rtol=_SINGLE, atol=0.0)
        and (seen.given_mass_n is None or np.allclose(seen.mass_n, exact.mass_n, rtol=_SINGLE, atol=0.0))
        # a center on the face of the box may be written on either side of it
        and np.abs(apart - np.rint(apart @ seen.box.inverse_dd.T) @ seen.box.lattice_dd.T).max() <= 4 * _SINGLE * size
    )


def _frames(path: Path, given: Given) -> _Frames:
    return _Frames(path)


GSD = Format("gsd", (".gsd",), EVERYTHING | {BONDS, FORCES, STEP}, _frames, _write, many=True, field=numeric)
