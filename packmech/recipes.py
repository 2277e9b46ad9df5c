"""How a scene file says its packing and its bonds: records of what makes them, each with a method that does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.effects import Repulsion
from packmech.effects.laws import Law
from packmech.files import read_packing
from packmech.generate import (
    Bidisperse,
    Cluster,
    Dimer,
    LinearCluster,
    LogNormal,
    Mixture,
    Monodisperse,
    Normal,
    RingCluster,
    Shape,
    Sizes,
    StarCluster,
    Trimer,
    Uniform,
    chain_packing,
    cluster_packing,
    fill_box,
    lattice_packing,
    random_packing,
)
from packmech.links import Links
from packmech.packing import Packing
from packmech.records import kinds_of
from packmech.scene import Scene

Vectors = tuple[tuple[float, ...], ...]

# the records that may stand in the fields of a packing, by name
NESTED = {
    "sizes": kinds_of((Monodisperse, Bidisperse, Mixture, Uniform, Normal, LogNormal)),
    "shape": kinds_of((Cluster, Dimer, Trimer, RingCluster, StarCluster, LinearCluster)),
}


@dataclass(frozen=True)
class _Random:
    """The arguments of `random_packing`."""

    particles: int
    packing_fraction: float
    seed: int
    dimension: int = 2
    sizes: Sizes = Bidisperse()
    lattice_vectors: Vectors | None = None

    def packing(self, folder: Path) -> Packing:
        return random_packing(
            self.particles,
            dimension=self.dimension,
            packing_fraction=self.packing_fraction,
            sizes=self.sizes,
            seed=self.seed,
            box=_box_shape(self.lattice_vectors),
        )


@dataclass(frozen=True)
class _Lattice:
    """The arguments of `lattice_packing`; `supercell` has one box vector a line."""

    name: str
    repeats: int | tuple[int, ...] | None = None
    supercell: tuple[tuple[int, ...], ...] | None = None
    conventional: bool = False
    relative_overlap: float = 0.0
    diameter: float = 1.0

    def packing(self, folder: Path) -> Packing:
        return lattice_packing(
            self.name,
            self.repeats,
            supercell=None if self.supercell is None else np.array(self.supercell).T,
            conventional=self.conventional,
            relative_overlap=self.relative_overlap,
            diameter=self.diameter,
        )


@dataclass(frozen=True)
class _Clusters:
    """The arguments of `cluster_packing`."""

    count: int
    shape: Shape
    packing_fraction: float
    seed: int
    dimension: int = 2
    sizes: Sizes | None = None
    lattice_vectors: Vectors | None = None
    crossing: str = "avoided"
    largest_overlap: float | None = None
    tries: int = 1000

    def packing(self, folder: Path) -> Packing:
        return cluster_packing(
            self.count,
            self.shape,
            dimension=self.dimension,
            packing_fraction=self.packing_fraction,
            sizes=self.sizes,
            seed=self.seed,
            box=_box_shape(self.lattice_vectors),
            crossing=self.crossing,
            largest_overlap=self.largest_overlap,
            tries=self.tries,
        )


@dataclass(frozen=True)
class _Chains:
    """The arguments of `chain_packing`."""

    count: int
    beads: int
    packing_fraction: float
    seed: int
    dimension: int = 2
    link_length: float = 1.0
    radii: float | tuple[float, ...] | None = None
    sizes: Sizes | None = None
    angles: str | float | tuple[float, ...] = "free"
    bend: float = 2.0 * math.pi / 3.0
    form: str | tuple[int, ...] = "open"
    winding: tuple[int, ...] | None = None
    lattice_vectors: Vectors | None = None
    crossing: str = "avoided"
    tries: int = 200

    def packing(self, folder: Path) -> Packing:
        return chain_packing(
            self.count,
            self.beads,
            dimension=self.dimension,
            packing_fraction=self.packing_fraction,
            link_length=self.link_length,
            radii=self.radii,
            sizes=self.sizes,
            angles=self.angles,
            bend=self.bend,
            form=self.form,
            winding=self.winding,
            seed=self.seed,
            box=_box_shape(self.lattice_vectors),
            crossing=self.crossing,
            tries=self.tries,
        )


@dataclass(frozen=True)
class Prepared:
    """A random packing at its energy minimum, without friction and bonds.

    With a `side` or `lattice_vectors` the box is this very one and the radii fill it (`fill_box`), else the smallest
    diameter is 1. The law is that of the scene's repulsion unless given.
    """

    particles: int
    packing_fraction: float
    seed: int
    dimension: int = 2
    sizes: Sizes = Bidisperse()
    side: float | None = None
    lattice_vectors: Vectors | None = None
    law: Law | None = None
    force_tolerance: float = 1e-10

    def packing(self, folder: Path) -> Packing:
        """Return the packing."""
        from packmech.dynamics.quench import quench

        if self.side is not None and self.lattice_vectors is not None:
            raise ValueError(f"side must be left out where lattice_vectors are given, got {self.side!r}")
        how: dict[str, Any] = {
            "packing_fraction": self.packing_fraction,
            "sizes": self.sizes,
            "seed": self.seed,
        }
        if self.side is not None:
            drawn = fill_box(Box.cubic(self.side, self.dimension), self.particles, **how)
        elif self.lattice_vectors is not None:
            drawn = fill_box(Box(_columns(self.lattice_vectors)), self.particles, **how)
        else:
            drawn = random_packing(self.particles, dimension=self.dimension, **how)
        assert self.law is not None
        return quench(Scene(drawn, (Repulsion(self.law),)), force_tolerance=self.force_tolerance).packing


@dataclass(frozen=True)
class _File:
    """A packing file; its path is relative to the scene file."""

    path: str

    def packing(self, folder: Path) -> Packing:
        return read_packing(folder / self.path)


@dataclass(frozen=True)
class _Inline:
    """Lattice vectors and positions one in a line, radii; and links as pairs, images, lengths, one each a link."""

    lattice_vectors: Vectors
    positions: Vectors
    radii: tuple[float, ...]
    link_pairs: tuple[tuple[int, ...], ...] | None = None
    link_images: tuple[tuple[int, ...], ...] | None = None
    link_lengths: tuple[float, ...] | None = None
    link_shapes: tuple[bool, ...] | None = None

    def packing(self, folder: Path) -> Packing:
        box = Box(_columns(self.lattice_vectors))
        return Packing(_rows("positions", self.positions), np.array(self.radii), box, self._links(box.dimension))

    def _links(self, dimension: int) -> Links | None:
        if self.link_pairs is None:
            for name in ("link_images", "link_lengths", "link_shapes"):
                if getattr(self, name) is not None:
                    raise ValueError(f"{name} must be left out without link_pairs, got {getattr(self, name)!r}")
            return None
        if self.link_lengths is None:
            raise ValueError("link_lengths must be given with link_pairs, got nothing")
        for k, pair in enumerate(self.link_pairs):
            if len(pair) != 2:
                raise ValueError(f"link_pairs[{k}] must hold two particles, got {len(pair)}")
        image = [(0,) * dimension] * len(self.link_pairs) if self.link_images is None else self.link_images
        for k, row in enumerate(image):
            if len(row) != dimension:
                raise ValueError(f"link_images[{k}] must hold {dimension} numbers, got {len(row)}")
        pairs = np.array(self.link_pairs, dtype=np.int64).reshape(-1, 2)
        shape = None if self.link_shapes is None else np.array(self.link_shapes, dtype=bool)
        return Links(
            pairs[:, 0], pairs[:, 1], _rows("link_images", image).astype(np.int64), np.array(self.link_lengths), shape
        )


# what the functions that make packings call a field of the file
FIELD_OF = {
    "box": "lattice_vectors",
    "lattice_dd": "lattice_vectors",
    "position_nd": "positions",
    "radius_n": "radii",
    "i_l": "link_pairs",
    "j_l": "link_pairs",
    "links": "link_pairs",
    "image_ld": "link_images",
    "length_l": "link_lengths",
    "shape_l": "link_shapes",
}
PACKINGS: dict[str, type] = {
    "random": _Random, "lattice": _Lattice, "clusters": _Clusters, "chains": _Chains, "file": _File, "inline": _Inline,
    "prepared": Prepared,
}  # fmt: skip
# kinds whose packing another seed changes
SEEDED = ("random", "clusters", "chains", "prepared")


def inline_table(packing: Packing) -> dict[str, Any]:
    """Return the table of a packing written out, from which the same packing is read to the last bit."""
    table: dict[str, Any] = {
        "kind": "inline",
        "lattice_vectors": packing.box.lattice_dd.T.tolist(),
        "radii": packing.radius_n.tolist(),
        "positions": packing.position_nd.tolist(),
    }
    links = packing.links
    if links is not None:
        assert links.shape_l is not None
        table["link_pairs"] = np.column_stack([links.i_l, links.j_l]).tolist()
        table["link_images"] = links.image_ld.tolist()
        table["link_lengths"] = links.length_l.tolist()
        table["link_shapes"] = links.shape_l.tolist()
    return table


def _rows(name: str, rows: Any) -> NDArray[np.float64]:
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f"{name} must hold rows of one length, got lengths {sorted({len(row) for row in rows})}")
    return np.array(rows, dtype=np.float64)


def _columns(vectors: Vectors) -> NDArray[np.float64]:
    return _rows("lattice_vectors", vectors).T


def _box_shape(vectors: Vectors | None) -> NDArray[np.float64] | None:
    return None if vectors is None else _columns(vectors)
