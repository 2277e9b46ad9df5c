"""A cluster given by hand: where its beads are, how large they are, and which pairs are linked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, positive_array
from packmech.generate.rigid_links import Pair, bonds_of, cross, rigid_links


@runtime_checkable
class Shape(Protocol):
    """A shape: anything with this method can be given to ``cluster_packing``."""

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        ...


@runtime_checkable
class RandomShape(Protocol):
    """A shape that is another one in every cluster of a packing."""

    def drawn(self, rng: np.random.Generator) -> Shape:
        """Return the shape of one cluster; every one has the same number of beads and links the same pairs."""
        ...


@dataclass(frozen=True, eq=False)
class Cluster:
    """Beads and the links between them: a shape given by hand.

    Parameters
    ----------
    position_bd
        (B, d) centers of the beads [length], at least two, d = 2 or 3.
    radius_b
        (B,) radii [length].
    links
        (L, 2) pairs of beads; every link's length is the distance of its beads here. They may be redundant. None: the
        bonds are the pairs that touch or overlap (and the nearest ones between parts that do not touch), and pairs
        that hold the shape are added until the cluster is rigid: 2B - 3 links in two dimensions, 3B - 6 in three, none
        of them redundant. Beads on a line cannot be held rigid that way, nor four or more in a plane in three
        dimensions: to first order no link resists a bend out of it. A straight row of beads linked to their
        neighbors is a flexible chain.
    shape_l
        (L,) which of the links hold the shape and are no bonds; None: none does. Only with ``links``.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: wrong shapes, beads in one place, a bead that no link joins to the others, a pair twice,
        beads that no links hold rigid.

    Examples
    --------
    >>> cross = Cluster([[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]], [0.5] * 5)
    >>> len(cross.links), cross.shape_l.sum().item()
    (7, 3)
    >>> bent = Cluster([[0, 0], [1, 0], [1.5, 0.8]], [0.5] * 3, links=[[0, 1], [1, 2]])
    >>> bent.links.tolist()
    [[0, 1], [1, 2]]

    """

    position_bd: NDArray[np.float64]
    radius_b: NDArray[np.float64]
    links: NDArray[np.int64] | None = None
    shape_l: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        position = finite_array("position_bd", self.position_bd, shape=(None, None), what="bead")
        beads = len(position)
        if beads < 2 or position.shape[1] not in (2, 3):
            raise ValueError(f"position_bd must have shape (at least 2, 2 or 3), got {position.shape}")
        radius = positive_array("radius_b", self.radius_b, shape=(None,), what="bead")
        if len(radius) != beads:
            raise ValueError(f"radius_b must have one entry per bead ({beads}), got {len(radius)}")
        for i in range(beads):
            same = np.flatnonzero((position[i + 1 :] == position[i]).all(axis=1))
            if len(same):
                raise ValueError(f"position_bd must be distinct, got beads {i} and {i + 1 + int(same[0])} in one place")
        if self.links is None:
            if self.shape_l is not None:
                raise ValueError(f"shape_l must be left out without links, got {self.shape_l!r}")
            pairs, holds = rigid_links(position, bonds_of(position, radius))
            links, shape = np.array(pairs), np.array(holds)
        else:
            links = _pairs(self.links, beads)
            shape = np.zeros(len(links), dtype=bool) if self.shape_l is None else np.array(self.shape_l)
            if shape.dtype != bool or shape.shape != (len(links),):
                raise ValueError(f"shape_l must hold one truth value per link ({len(links)}), got {self.shape_l!r}")
        for name, array in (("position_bd", position), ("radius_b", radius), ("links", links), ("shape_l", shape)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __eq__(self, other: object) -> bool:
        names = ("position_bd", "radius_b", "links", "shape_l")
        return isinstance(other, Cluster) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in names
        )

    def __hash__(self) -> int:
        return hash((self.position_bd.tobytes(), self.radius_b.tobytes()))

    @property
    def length_l(self) -> NDArray[np.float64]:
        """The (L,) lengths of the links [length]."""
        assert self.links is not None
        vector = self.position_bd[self.links[:, 1]] - self.position_bd[self.links[:, 0]]
        length: NDArray[np.float64] = np.sqrt((vector**2).sum(axis=1))
        return length

    def cluster(self, dimension: int) -> Cluster:
        """Return the cluster itself, which must have as many dimensions as the packing."""
        if self.position_bd.shape[1] != dimension:
            raise ValueError(f"dimension must be that of the cluster, {self.position_bd.shape[1]}, got {dimension}")
        return self

    def crossing(self) -> tuple[Pair, Pair] | None:
        """Return two bonds of the cluster that cross each other, if any do."""
        assert self.links is not None and self.shape_l is not None
        bonds = [(int(i), int(j)) for i, j in self.links[~self.shape_l]]
        for k, one in enumerate(bonds):
            for other in bonds[:k]:
                if cross(self.position_bd, one, other):
                    return other, one
        return None


def _pairs(links: ArrayLike, beads: int) -> NDArray[np.int64]:
    given = finite_array("links", links, shape=(None, 2), what="link")
    pairs = np.sort(np.rint(given).astype(np.int64), axis=1)
    if (np.sort(given, axis=1) != pairs).any() or pairs.min() < 0 or pairs.max() >= beads:
        raise ValueError(f"links must be pairs of whole numbers from 0 to {beads - 1}, got {given.tolist()}")
    if (pairs[:, 0] == pairs[:, 1]).any():
        raise ValueError(f"links must join two beads, got {pairs[pairs[:, 0] == pairs[:, 1]][0].tolist()}")
    unique, count = np.unique(pairs, axis=0, return_counts=True)
    if (count > 1).any():
        raise ValueError(f"links must name each pair once, got {unique[count > 1][0].tolist()} twice")
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    graph = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(beads, beads))
    _, part = connected_components(graph, directed=False)
    if part.any():
        raise ValueError(f"links must join all beads, got bead {int(np.flatnonzero(part)[0])} apart from bead 0")
    return pairs
