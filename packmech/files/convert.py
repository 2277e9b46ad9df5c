"""Packings from and to objects of other programs: ASE's Atoms, HOOMD's snapshots, freud's systems, networkx graphs.

The libraries come with the extra ``formats``; HOOMD's frames are those of ``gsd``, which HOOMD takes and gives. What an
object has no place for is refused, by name, unless ``drop=True`` leaves it out, as by `pm.write_packing`.
"""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from packmech.box import Box
from packmech.calls.honors import honors
from packmech.check import clear_errors, instance, integer
from packmech.contacts import Contacts, pair_contacts
from packmech.files.columns import KIND, snapshot_of_particles
from packmech.files.extended_xyz import EXTXYZ
from packmech.files.formats import BONDS, EVERYTHING, FORCES, KINDS, SPHEROIDS, STEP, Format, Given, numeric
from packmech.files.gsd_file import GSD, frame_of, hoomd_lattice, visible_of
from packmech.files.packings import kept_of, snapshot_of, warn_of
from packmech.files.snapshot import Snapshot
from packmech.packing import Packing

# what arrays of a packing are called there
_OF_PACKING = ("radius", "aspect", "director", KIND)
_ATOMS = Format(
    *("ASE Atoms", (), frozenset((SPHEROIDS, KINDS)), EXTXYZ.frames, EXTXYZ.write),
    field=lambda name, array: name not in _OF_PACKING,
)
_FRAME = Format("HOOMD", (), EVERYTHING | {BONDS, FORCES, STEP}, GSD.frames, GSD.write, field=numeric)
# arrays of ASE's own
_OF_ASE = ("numbers", "positions", "masses", "momenta")


def _library(name: str, call: str, package: str | None = None) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(
            f"pm.{call} must find the package {package or name}; pip install 'packmech[formats]' brings it"
        ) from error


@honors("links shapes", packing_only=True)
def to_ase(packing: Packing | Snapshot, *, drop: bool = False) -> Any:
    """Return the packing as `ase.Atoms`, exactly.

    Positions, the cell (of length one along z in two dimensions, where it is not periodic), arrays ``radius``, masses
    where given, ``kind`` where there are several, ``aspect`` and ``director`` of ellipses and spheroids, and fields as
    arrays of their names; symbols are the field ``species``, else X. ASE keeps momenta: velocities are arrays here,
    too.

    Parameters
    ----------
    packing
        The packing, or a `Snapshot`.
    drop
        Whether links, tangential displacements, rigid bodies, springs and contact forces are left out; unless it is
        True they are refused.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, or what ASE has no place for.
    ImportError
        Without the package ase.

    Examples
    --------
    >>> import packmech as pm
    >>> atoms = pm.to_ase(pm.lattice_packing("square", repeats=(2, 2)))
    >>> atoms.pbc.tolist(), atoms.arrays["radius"].tolist()
    ([True, True, False], [0.5, 0.5, 0.5, 0.5])

    """
    ase = _library("ase", "to_ase")
    snapshot = kept_of(snapshot_of("packing", packing), _ATOMS, "pm.to_ase", drop)
    held, d = snapshot.packing, snapshot.packing.dimension
    place, cell = np.zeros((held.particles, 3)), np.eye(3)
    place[:, :d], cell[:d, :d] = held.position_nd, held.box.lattice_dd.T
    fields = dict(snapshot.fields)
    species = fields.pop("species", np.full(held.particles, "X"))
    atoms = ase.Atoms(species.tolist(), place, cell=cell, pbc=[True, True, d == 3], masses=held.given_mass_n)
    arrays = {"radius": held.radius_n, **fields}
    if held.given_kind_n is not None:
        arrays[KIND] = held.given_kind_n
    if held.shapes.has_orientations:
        arrays |= held.shapes.arrays()
    for name, array in arrays.items():
        atoms.set_array({"aspect_n": "aspect", "director_nd": "director"}.get(name, name), array)
    return atoms


@clear_errors
def from_ase(atoms: Any, *, box: Box | None = None, radius: Any = None) -> Snapshot:
    """Return ASE's Atoms as a snapshot: two-dimensional where they are periodic along x and y only, at z = 0.

    Arrays ``radius`` (or ``radii``), ``kind``, ``aspect`` and ``director`` are the packing's, momenta become
    velocities, other arrays fields; entries of ``info``, constraints and calculators are left out, and listed in a
    warning.

    Parameters
    ----------
    atoms
        The `ase.Atoms`.
    box, radius
        As of `pm.read_packing`, for Atoms that have none; a radius by type is one by symbol, ``{"Cu": 0.5}``.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong with them.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> pm.from_ase(pm.to_ase(packing)).packing == packing
    True

    """
    if not all(hasattr(atoms, name) for name in ("arrays", "cell", "pbc", "get_chemical_symbols")):
        raise TypeError(f"atoms must be ase.Atoms, got {type(atoms).__name__}")
    given = Given.checked(box, radius)
    place, cell = np.array(atoms.positions), np.array(atoms.cell[:])
    flat = not place[:, 2].any() and not cell[2, :2].any() and not cell[:2, 2].any()
    d = 2 if list(atoms.pbc) == [True, True, False] and flat else 3
    is_periodic = all(atoms.pbc[:d])
    if not is_periodic and box is None:
        raise ValueError(f"atoms must be periodic along each axis, got pbc {list(atoms.pbc)}: give the box as box=")
    cell_box = given.box_in(Box(cell[:d, :d].T) if is_periodic else None)
    d = cell_box.dimension
    symbols = np.array(atoms.get_chemical_symbols(), dtype=np.str_)
    arrays: dict[str, Any] = {"position_nd": place[:, :d]}
    names = {"radius": "radius_n", "radii": "radius_n", "aspect": "aspect_n", "director": "director_nd"}
    arrays |= {names.get(name, name): np.array(one) for name, one in atoms.arrays.items() if name not in _OF_ASE}
    for name in ("director_nd",):
        if name in arrays:
            arrays[name] = arrays[name][:, :d]
    if "masses" in atoms.arrays:
        arrays["mass_n"] = np.array(atoms.arrays["masses"])
    if "momenta" in atoms.arrays and "velocity_nd" not in arrays:
        arrays["velocity_nd"] = np.array(atoms.get_velocities())[:, :d]
    if isinstance(radius, dict):
        given = Given(box, given.radii(arrays.pop("radius_n", None), symbols, len(symbols)))
    if not (symbols == "X").all():
        arrays["species"] = symbols
    left_out = [f"info {', '.join(map(str, atoms.info))}"] if atoms.info else []
    left_out += ["constraints"] if atoms.constraints else []
    left_out += ["a calculator"] if atoms.calc is not None else []
    warn_of("atoms", left_out)
    return snapshot_of_particles(arrays, cell_box, given)


@honors("links shapes", packing_only=True)
def to_hoomd(packing: Packing | Snapshot, *, drop: bool = False) -> Any:
    """Return the packing as a `gsd.hoomd.Frame`, from which HOOMD makes a state (`create_state_from_snapshot`).

    It is what a .gsd file has for each frame: `packmech.files.gsd_file` describes it.

    Parameters
    ----------
    packing
        The packing, or a `Snapshot`.
    drop
        Whether fields of words are left out; unless it is True they are refused.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, or what the frame has no place for.

    Examples
    --------
    >>> import packmech as pm
    >>> frame = pm.to_hoomd(pm.lattice_packing("square", repeats=(2, 2)))
    >>> int(frame.particles.N), [float(side) for side in frame.configuration.box[:3]]
    (4, [2.0, 2.0, 1.0])

    """
    return frame_of(kept_of(snapshot_of("packing", packing), _FRAME, "pm.to_hoomd", drop))


@clear_errors
def from_hoomd(frame: Any) -> Snapshot:
    """Return a snapshot of HOOMD (`hoomd.Snapshot`), or a `gsd.hoomd.Frame`, as a snapshot of packmech.

    What it holds and a snapshot has no place for is left out, and listed in a warning.

    Parameters
    ----------
    frame
        One or the other. Only a Frame has shapes of particle types; a `hoomd.Snapshot` has diameters.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong with it, as `pm.read_packing` of a .gsd file does.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> pm.from_hoomd(pm.to_hoomd(packing)).packing == packing
    True

    """
    import gsd.hoomd

    parts = ("configuration", "particles", "bonds", "angles", "dihedrals", "impropers", "constraints", "pairs")
    if not all(hasattr(frame, name) for name in parts[:3]):
        raise TypeError(f"frame must be a gsd.hoomd.Frame or a hoomd.Snapshot, got {type(frame).__name__}")
    found = frame
    if not isinstance(frame, gsd.hoomd.Frame):
        found = gsd.hoomd.Frame()
        for part in parts[1:]:
            theirs, ours = getattr(frame, part, None), getattr(found, part)
            for name in vars(ours):
                held = getattr(theirs, name, None)
                # arrays of no rows, and what is not there, stay as they are
                if held is not None and np.size(held):
                    setattr(ours, name, held)
        found.configuration.box = frame.configuration.box
        found.configuration.dimensions = int(frame.configuration.dimensions)
    # written and read once, the library checks it and fills in what was left out
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.gsd"
        with gsd.hoomd.open(str(path), "w") as file:
            file.append(found)
        snapshot, left_out = GSD.frames(path, Given()).frame(0)
    warn_of("frame", left_out)
    return snapshot


@honors("links shapes", packing_only=True)
def to_freud(packing: Packing | Snapshot) -> tuple[Any, Any]:
    """Return a freud system: a `freud.box.Box`, and (N, 3) positions in it. It holds neither radii nor kinds.

    freud's boxes are upper triangular and centered on the origin: both are turned into such a one, and positions are
    wrapped; a left-handed packing is seen in a lattice of which one vector is its negative.

    Parameters
    ----------
    packing
        The packing, or a `Snapshot`.

    Raises
    ------
    TypeError
        Naming the argument.
    ImportError
        Without the package freud-analysis.

    Examples
    --------
    >>> import packmech as pm
    >>> box, points = pm.to_freud(pm.lattice_packing("square", repeats=(2, 2)))
    >>> box.L.tolist(), points.shape
    ([2.0, 2.0, 0.0], (4, 3))

    """
    freud = _library("freud", "to_freud", "freud-analysis")
    held = snapshot_of("packing", packing).packing
    seen = visible_of(held)
    x, y, z, xy, xz, yz = seen.hoomd_box
    is_plane = held.dimension == 2
    points = np.zeros((held.particles, 3))
    points[:, : held.dimension] = seen.position_nd
    return freud.box.Box(x, y, 0.0 if is_plane else z, xy, xz, yz, is2D=is_plane), points


@clear_errors
def from_freud(system: Any, *, radius: Any) -> Snapshot:
    """Return a freud system, a box and points, as a snapshot.

    Parameters
    ----------
    system
        ``(box, points)``, or anything with ``box`` and ``points``, such as a `freud.locality.AABBQuery`.
    radius
        A number, or one for each point.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong with it.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> found = pm.from_freud(pm.to_freud(packing), radius=0.5).packing
    >>> pm.packing_fraction(found) == pm.packing_fraction(packing)
    True

    """
    is_pair = isinstance(system, Sequence) and len(system) == 2
    box: Any = system[0] if is_pair else getattr(system, "box", None)
    points = system[1] if is_pair else getattr(system, "points", None)
    if points is None or not all(hasattr(box, name) for name in ("Lx", "Ly", "Lz", "xy", "xz", "yz", "is2D")):
        raise TypeError(f"system must be a freud box and points, got {type(system).__name__}")
    d = 2 if box.is2D else 3
    given = Given.checked(None, radius)
    if radius is None:
        raise ValueError("radius must be a number, or one for each point, got None")
    sides = np.array([box.Lx, box.Ly, box.Lz, box.xy, box.xz, box.yz], dtype=np.float64)
    place = np.asarray(points, dtype=np.float64)
    if place.ndim != 2 or place.shape[1] != 3 or place[:, d:].any():
        raise ValueError(f"system must have (N, 3) points, at z = 0 in two dimensions, got shape {place.shape}")
    return snapshot_of_particles({"position_nd": place[:, :d]}, Box(hoomd_lattice(sides, d)), given)


@clear_errors
def to_networkx(contacts: Any) -> Any:
    """Return contacts as a `networkx.MultiGraph`: a node for each particle, an edge for each contact.

    Edges have ``image`` (a tuple, also their key), ``distance``, ``contact_distance`` and ``normal`` (from the smaller
    number to the larger); of contact forces also ``normal_force`` and ``tangential_force`` (on the smaller number),
    and nodes then ``position`` and ``radius``, and ``kind`` where there are several.

    Parameters
    ----------
    contacts
        What `pm.find_contacts` or `pm.contact_forces` returns, of discs and spheres.

    Raises
    ------
    TypeError
        If it is something else.
    ImportError
        Without the package networkx.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> graph = pm.to_networkx(pm.find_contacts(packing))
    >>> graph.number_of_nodes(), graph.number_of_edges()
    (9, 27)

    """
    networkx = _library("networkx", "to_networkx")
    pairs = contacts if isinstance(contacts, Contacts) else getattr(contacts, "contacts", None)
    if not isinstance(pairs, Contacts):
        raise TypeError(
            f"contacts must be Contacts or ContactForces of discs or spheres, got {type(contacts).__name__}"
        )
    graph = networkx.MultiGraph()
    graph.add_nodes_from(range(pairs.particles))
    edges: dict[str, list[Any]] = {
        "distance": pairs.distance_c.tolist(),
        "contact_distance": pairs.contact_distance_c.tolist(),
        "normal": list(map(tuple, pairs.normal_cd.tolist())),
    }
    if contacts is not pairs:
        packing = contacts.scene.packing
        for n in range(packing.particles):
            graph.nodes[n].update(position=tuple(packing.position_nd[n].tolist()), radius=float(packing.radius_n[n]))
            if packing.given_kind_n is not None:
                graph.nodes[n]["kind"] = int(packing.given_kind_n[n])
        edges["normal_force"] = contacts.normal_c.tolist()
        edges["tangential_force"] = list(map(tuple, contacts.tangential_cd.tolist()))
    ends = zip(pairs.i_c.tolist(), pairs.j_c.tolist(), map(tuple, pairs.image_cd.tolist()), strict=True)
    for c, (i, j, image) in enumerate(ends):
        graph.add_edge(i, j, key=image, image=image, **{name: one[c] for name, one in edges.items()})
    return graph


@clear_errors
def from_networkx(graph: Any, packing: Packing) -> Contacts:
    """Return the pairs of a packing that a graph joins, touching or not, as contacts, for calls that take these.

    Parameters
    ----------
    graph
        A graph of particles by their numbers. ``image`` of an edge is that of `Contacts`, from the smaller number to
        the larger; the nearest one where it has none.
    packing
        The packing, of discs or spheres.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, or the edge.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> contacts = pm.find_contacts(packing)
    >>> found = pm.from_networkx(pm.to_networkx(contacts), packing)
    >>> bool((found.distance_c == contacts.distance_c).all())
    True

    """
    instance("packing", packing, Packing)
    if packing.shapes.has_orientations:
        raise ValueError(f"packing must be of discs or spheres, got {type(packing.shapes).__name__}")
    if not hasattr(graph, "edges") or not hasattr(graph, "nodes"):
        raise TypeError(f"graph must be a networkx graph, got {type(graph).__name__}")
    d, last = packing.dimension, packing.particles - 1
    found: list[tuple[int, ...]] = []
    missing: list[int] = []
    for one, other, held in graph.edges(data=True):
        i, j = sorted(
            integer("graph must join particles by their numbers: one", end, at_least=0, at_most=last)
            for end in (one, other)
        )
        image = held.get("image")
        if image is None:
            missing.append(len(found))
            image = (0,) * d
        elif len(image) != d:
            raise ValueError(f"graph must have images of {d} components, got {image} for edge {i}-{j}")
        found.append((i, j, *map(int, image)))
    table = np.array(found, dtype=np.int64).reshape(-1, 2 + d)
    i_c, j_c, image_cd = table[:, 0], table[:, 1], table[:, 2:]
    vector = packing.position_nd[j_c[missing]] - packing.position_nd[i_c[missing]]
    image_cd[missing] = packing.box.nearest_images(vector)
    order = np.lexsort((*image_cd.T[::-1], j_c, i_c))
    own = np.flatnonzero((i_c == j_c) & ~image_cd.any(axis=1))
    if len(own):
        raise ValueError(f"graph must join a particle with itself through an image only, got particle {i_c[own[0]]}")
    return pair_contacts(packing, i_c[order], j_c[order], np.ascontiguousarray(image_cd[order]))
