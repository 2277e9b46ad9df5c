"""Packings in the GSD format (HOOMD schema), which freud, OVITO and HOOMD read.

HOOMD keeps single precision, a box centered on the origin whose lattice vectors form an upper triangular matrix with a
positive diagonal, and particles inside it. A packing is therefore written twice into its frame:

visible to every reader
    ``configuration/box`` (2D: ``dimensions`` 2, unit height), ``particles/position`` wrapped into that box and rotated
    with it, ``particles/image`` as taken away, ``particles/diameter``, one particle type for each of up to ten sizes.
    Links are ``constraints`` (pair and length) and ``bonds`` of the types "bond" and "shape", for what draws or holds
    them. The schema has no place for a link's image: readers take the nearest one. A particle's link with its own
    image is left out.
exact, for packmech
    the log chunks ``log/packmech/position_nd``, ``radius_n`` and ``lattice_dd`` in double precision, as they were; with
    links also ``link_i_l``, ``link_j_l``, ``link_image_ld``, ``link_length_l`` and ``link_shape_l``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.links import Links
from packmech.packing import DISCRETE_SIZES, Packing

_LOG = "packmech/"
_LINK_ARRAYS = ("i_l", "j_l", "image_ld", "length_l", "shape_l")
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
    frame.particles.diameter = packing.diameter_n.astype(np.float32)
    size_k, type_n = np.unique(packing.radius_n, return_inverse=True)
    if len(size_k) > DISCRETE_SIZES:
        type_n = np.zeros_like(type_n)
    frame.particles.types = [chr(ord("A") + k) for k in range(int(type_n.max()) + 1)]
    frame.particles.typeid = type_n.astype(np.uint32)
    frame.log = {
        _LOG + "position_nd": packing.position_nd,
        _LOG + "radius_n": packing.radius_n,
        _LOG + "lattice_dd": packing.box.lattice_dd,
    }
    if packing.links is not None:
        _add_links(frame, packing.links)
    with gsd.hoomd.open(str(path), "w") as file:
        file.append(frame)


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
    seen = Packing(position, 0.5 * np.asarray(frame.particles.diameter, dtype=np.float64), box)
    chunks = [frame.log.get(_LOG + name) for name in ("position_nd", "radius_n", "lattice_dd")]
    if any(chunk is None for chunk in chunks):
        return seen.replace(links=_seen_links(frame, seen.position_nd, box))
    parts = [frame.log.get(f"{_LOG}link_{name}") for name in _LINK_ARRAYS]
    links = None
    if all(part is not None for part in parts):
        i_l, j_l, image_ld, length_l, shape_l = parts
        links = Links(i_l, j_l, image_ld, length_l, shape_l.astype(bool))
    exact = Packing(chunks[0], chunks[1], Box(chunks[2]), links)
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
    visible = _visible(exact)
    size = float(np.abs(visible.lattice_dd).max())
    apart = seen.position_nd - visible.position_nd
    return bool(
        np.allclose(seen.box.lattice_dd, visible.lattice_dd, rtol=_SINGLE, atol=_SINGLE * size)
        and np.allclose(seen.radius_n, exact.radius_n, rtol=_SINGLE, atol=0.0)
        # a center on the face of the box may be written on either side of it
        and np.abs(apart - np.rint(apart @ seen.box.inverse_dd.T) @ seen.box.lattice_dd.T).max() <= 4 * _SINGLE * size
    )
