"""Shapes of rigid clusters: dimers, trimers, rings, stars, lines, and the rigid links that hold them."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import (
    PARTICLE_BYTES,
    boolean,
    brief,
    finite_array,
    given_shape,
    integer,
    positive,
    positive_array,
    real,
)

Pair = tuple[int, int]

# a link that adds less than this to those there are (of a row of length one) holds nothing to first order
_NEW = 1e-6
# beads apart by less than this (relative to their contact distance) count as touching
_TOUCHING = 1e-9


def bonds_of(position_bd: NDArray[np.float64], radius_b: NDArray[np.float64]) -> list[Pair]:
    """Return the pairs that touch or overlap, and the smallest gaps that join what does not, nearest first.

    In two dimensions none of them crosses another: of two that would, the nearer pair stays.
    """
    beads = len(radius_b)
    pairs = [(i, j) for i in range(beads) for j in range(i + 1, beads)]
    distance = {p: math.dist(position_bd[p[0]], position_bd[p[1]]) for p in pairs}
    gap = {p: distance[p] - float(radius_b[p[0]] + radius_b[p[1]]) * (1 + _TOUCHING) for p in pairs}
    # rounding must not choose between equal pairs
    pairs.sort(key=lambda p: (float(f"{distance[p]:.9e}"), p))
    bonds: list[Pair] = []
    group = list(range(beads))

    def add(pair: Pair) -> None:
        if not any(cross(position_bd, pair, one) for one in bonds):
            bonds.append(pair)
            old, new = group[pair[1]], group[pair[0]]
            group[:] = [new if g == old else g for g in group]

    for pair in pairs:
        if gap[pair] <= 0:
            add(pair)
    for pair in sorted(pairs, key=lambda p: (float(f"{gap[p]:.9e}"), p)):
        if group[pair[0]] != group[pair[1]]:
            add(pair)
    return bonds


def cross(position_bd: NDArray[np.float64], one: Pair, other: Pair) -> bool:
    """Return whether two pairs without a common bead cross as segments; never in three dimensions."""
    if position_bd.shape[1] != 2 or set(one) & set(other):
        return False
    (px, py), (qx, qy) = position_bd[one[0]].tolist(), position_bd[other[0]].tolist()
    ux, uy = (position_bd[one[1]] - position_bd[one[0]]).tolist()
    vx, vy = (position_bd[other[1]] - position_bd[other[0]]).tolist()
    turn = ux * vy - uy * vx
    if turn == 0.0:
        return False
    s, t = ((qx - px) * vy - (qy - py) * vx) / turn, ((qx - px) * uy - (qy - py) * ux) / turn
    return bool(0.0 <= s <= 1.0 and 0.0 <= t <= 1.0)


def rigid_links(position_bd: NDArray[np.float64], bonds: list[Pair]) -> tuple[list[Pair], list[bool]]:
    """Return independent links that leave a cluster its translations and rotations only, and which hold the shape.

    Bonds come first, in their order; those that add nothing are left out. Then pairs that hold the shape, each the
    shortest of those that add at least a third of what the best pair would.

    Raises
    ------
    ValueError
        For beads on a line, or in a plane in three dimensions, which no links hold rigid to first order.

    """
    beads, d = position_bd.shape
    centered = position_bd - position_bd.mean(axis=0)
    size = math.sqrt(float((centered**2).sum()))
    spread = np.linalg.svd(centered / size, compute_uv=False)
    flat = int((spread > _NEW).sum()) if beads > 1 else 0
    rotations = d * (d - 1) // 2 - (d - flat) * (d - flat - 1) // 2
    wanted = beads * d - d - rotations
    pairs = [(i, j) for i in range(beads) for j in range(i + 1, beads)]
    place = {p: k for k, p in enumerate(pairs)}
    rows = np.zeros((len(pairs), beads, d))
    i, j = np.array(pairs).T
    vector = position_bd[j] - position_bd[i]
    length = np.sqrt((vector**2).sum(axis=1))
    rows[np.arange(len(pairs)), j] = vector / length[:, None] / math.sqrt(2.0)
    rows[np.arange(len(pairs)), i] = -rows[np.arange(len(pairs)), j]
    left = rows.reshape(len(pairs), beads * d)
    links: list[Pair] = []

    def take(k: int) -> None:
        # twice, so that what is left stays orthogonal to what was taken
        nonlocal left
        unit = left[k] / math.sqrt(float(np.add.reduce(left[k] ** 2)))
        for _ in range(2):
            left = left - np.einsum("pk,k->p", left, unit)[:, None] * unit
        links.append(pairs[k])

    for pair in bonds:
        if np.add.reduce(left[place[pair]] ** 2) > _NEW**2:
            take(place[pair])
    bonded = len(links)
    while len(links) < wanted:
        new = np.sqrt(np.add.reduce(left**2, axis=1))
        if new.max() <= _NEW:
            break
        good = np.flatnonzero(new >= new.max() / 3)
        near = length[good]
        take(int(good[np.flatnonzero(near <= near.min() * (1 + _TOUCHING))[0]]))
    if len(links) < wanted:
        kind = "a line" if flat == 1 else "a plane"
        raise ValueError(
            f"position_bd must not lie on {kind} for links to hold it rigid (to first order none resists a bend out of "
            f"it; give links for a flexible cluster), got {beads} beads on {kind}"
        )
    return links, [k >= bonded for k in range(len(links))]


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
    links: NDArray[np.int64] = None  # type: ignore[assignment]  # those that hold the cluster rigid
    shape_l: NDArray[np.bool_] = None  # type: ignore[assignment]  # an array is made of it

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
                raise ValueError(f"shape_l must be left out without links, got {brief(self.shape_l)}")
            pairs, holds = rigid_links(position, bonds_of(position, radius))
            links, shape = np.array(pairs), np.array(holds)
        else:
            links = _pairs(self.links, beads)
            shape = np.zeros(len(links), dtype=bool) if self.shape_l is None else np.array(self.shape_l)
            if shape.dtype != bool or shape.shape != (len(links),):
                raise ValueError(
                    f"shape_l must hold one truth value per link ({len(links)}), got {brief(self.shape_l)}"
                )
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
        vector = self.position_bd[self.links[:, 1]] - self.position_bd[self.links[:, 0]]
        length: NDArray[np.float64] = np.sqrt((vector**2).sum(axis=1))
        return length

    @functools.cached_property
    def bonds(self) -> list[Pair]:
        """The pairs of beads that a bond joins: links that hold the shape are none."""
        return [(int(i), int(j)) for i, j in self.links[~self.shape_l]]

    @property
    def longest_bond(self) -> float:
        """Length of the longest bond [length]."""
        return float(self.length_l[~self.shape_l].max(initial=0.0))

    def cluster(self, dimension: int) -> Cluster:
        """Return the cluster itself, which must have as many dimensions as the packing."""
        if self.position_bd.shape[1] != dimension:
            raise ValueError(f"dimension must be that of the cluster, {self.position_bd.shape[1]}, got {dimension}")
        return self

    def crossing(self) -> tuple[Pair, Pair] | None:
        """Return two bonds of the cluster that cross each other, if any do."""
        for k, one in enumerate(self.bonds):
            for other in self.bonds[:k]:
                if cross(self.position_bd, one, other):
                    return other, one
        return None


def drawn_clusters(shape: Shape | RandomShape, count: int, dimension: int, rng: np.random.Generator) -> list[Cluster]:
    """Return the cluster of every place: the same one, or each drawn by itself."""
    shapes = [shape.drawn(rng) if isinstance(shape, RandomShape) else shape for _ in range(count)]
    found = {key: one.cluster(dimension) for key, one in {id(one): one for one in shapes}.items()}
    return [found[id(one)] for one in shapes]


def _pairs(links: ArrayLike, beads: int) -> NDArray[np.int64]:
    given = finite_array("links", links, shape=(None, 2), what="link")
    pairs = np.sort(np.rint(given).astype(np.int64), axis=1)
    if (np.sort(given, axis=1) != pairs).any() or pairs.min() < 0 or pairs.max() >= beads:
        raise ValueError(f"links must be pairs of whole numbers from 0 to {beads - 1}, got {brief(given.tolist())}")
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


Radii = float | tuple[float, ...]


def _radii(radii: Any, beads: int) -> NDArray[np.float64]:
    """Return one radius for each bead, given by one number or by as many."""
    if not given_shape(radii):
        return np.full(beads, positive("radii", radii))
    checked = positive_array("radii", radii, shape=(None,), what="bead")
    if len(checked) != beads:
        raise ValueError(f"radii must be a number or {beads} of them, got {len(checked)}")
    return checked


def _in_space(plane: Any, dimension: int) -> NDArray[np.float64]:
    position = np.zeros((len(plane), dimension))
    position[:, :2] = plane
    return position


def _dimension(dimension: int) -> int:
    return integer("dimension", dimension, at_least=2, at_most=3)


@dataclass(frozen=True)
class Dimer:
    """Two beads and the link between them.

    Parameters
    ----------
    length
        Length of the link [length].
    radii
        Radius of the beads, or one for each [length].

    Examples
    --------
    >>> Dimer(length=0.8).cluster(2).length_l.tolist()
    [0.8]

    """

    length: float = 1.0
    radii: Radii = 0.5

    def __post_init__(self) -> None:
        positive("length", self.length)
        _radii(self.radii, 2)

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        place = _in_space([[0.0, 0.0], [self.length, 0.0]], _dimension(dimension))
        return Cluster(place, _radii(self.radii, 2), [[0, 1]])  # type: ignore[arg-type]


@dataclass(frozen=True)
class Trimer:
    """Three beads, rigid: two links of one length and the link that holds the angle between them.

    Parameters
    ----------
    length
        Length of the links from the middle bead to the others [length].
    angle
        Angle between them [rad], above 0 and below pi (three beads on a line are not held by links). At pi/3, an
        equilateral triangle, all three links are bonds; else the third one holds the shape. Two angles (low, high):
        every cluster of a packing has one of its own, uniform between them.
    radii
        Radius of the beads, or one for each, the middle one second [length].

    Examples
    --------
    >>> Trimer().cluster(2).links.tolist(), Trimer(angle=2.0).cluster(3).shape_l.tolist()
    ([[0, 1], [1, 2], [0, 2]], [False, False, True])

    """

    length: float = 1.0
    angle: float | tuple[float, float] = math.pi / 3
    radii: Radii = 0.5

    def __post_init__(self) -> None:
        positive("length", self.length)
        if isinstance(self.angle, list | tuple):
            if len(self.angle) != 2:
                raise ValueError(f"angle must be one angle or two (low, high), got {len(self.angle)}")
            object.__setattr__(self, "angle", (_bond_angle(self.angle[0]), _bond_angle(self.angle[1])))
            if self.angle[0] >= self.angle[1]:
                raise ValueError(f"angle must go from low to high, got {brief(self.angle)}")
        else:
            _bond_angle(self.angle)
        _radii(self.radii, 3)

    def drawn(self, rng: np.random.Generator) -> Trimer:
        """Return a trimer of one angle: itself, or with an angle drawn from its range."""
        return replace(self, angle=float(rng.uniform(*self.angle))) if isinstance(self.angle, tuple) else self

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        if isinstance(self.angle, tuple):
            raise ValueError(f"angle must be one angle for one cluster (see drawn), got {brief(self.angle)}")
        turn = [self.length * math.cos(self.angle), self.length * math.sin(self.angle)]
        place = _in_space([[self.length, 0.0], [0.0, 0.0], turn], _dimension(dimension))
        open_angle = abs(self.angle - math.pi / 3) > 1e-9
        links, shape = [[0, 1], [1, 2], [0, 2]], [False, False, open_angle]
        return Cluster(place, _radii(self.radii, 3), links, shape)  # type: ignore[arg-type]


@dataclass(frozen=True)
class RingCluster:
    """A regular polygon of beads, each linked to the next one.

    Parameters
    ----------
    beads
        Number of beads, at least 3.
    length
        Length of the links between neighbors [length].
    radii
        Radius of the beads, or one for each [length].
    rigid
        Whether further links hold the shape. A rigid ring in three dimensions has three beads; more of them lie in a
        plane, which links do not hold.

    Examples
    --------
    >>> len(RingCluster(6).cluster(2).links), len(RingCluster(6, rigid=False).cluster(3).links)
    (9, 6)

    """

    beads: int
    length: float = 1.0
    radii: Radii = 0.5
    rigid: bool = True

    def __post_init__(self) -> None:
        integer("beads", self.beads, at_least=3, bytes_each=PARTICLE_BYTES)
        positive("length", self.length)
        _radii(self.radii, self.beads)
        boolean("rigid", self.rigid)

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        if self.rigid and self.beads > 3 and dimension == 3:
            raise ValueError(
                "rigid must be False for a ring of more than three beads in three dimensions (they lie in a plane, "
                f"which links do not hold), got True with {self.beads} beads"
            )
        turn = 2 * math.pi * np.arange(self.beads) / self.beads
        radius = 0.5 * self.length / math.sin(math.pi / self.beads)
        place = _in_space(radius * np.column_stack([np.cos(turn), np.sin(turn)]), _dimension(dimension))
        bonds = [(k, k + 1) for k in range(self.beads - 1)] + [(0, self.beads - 1)]
        return _joined(place, _radii(self.radii, self.beads), bonds, self.rigid)


@dataclass(frozen=True)
class StarCluster:
    """A bead with straight arms in evenly spread directions.

    Parameters
    ----------
    arms
        Number of arms, at least 3; in three dimensions 4, 6 or 8, to the corners of a tetrahedron, an octahedron or a
        cube.
    arm_beads
        Number of beads in each arm.
    length
        Length of the links between neighbors [length].
    radii
        Radius of the beads, or one for each: the center, then arm after arm from the center outwards [length].
    rigid
        Whether further links hold the shape.

    Examples
    --------
    >>> len(StarCluster(3).cluster(2).links), len(StarCluster(4, rigid=False).cluster(3).links)
    (5, 4)

    """

    arms: int
    arm_beads: int = 1
    length: float = 1.0
    radii: Radii = 0.5
    rigid: bool = True

    def __post_init__(self) -> None:
        arms = integer("arms", self.arms, at_least=3, bytes_each=PARTICLE_BYTES)
        integer("arm_beads", self.arm_beads, at_least=1, bytes_each=arms * PARTICLE_BYTES)
        positive("length", self.length)
        _radii(self.radii, 1 + self.arms * self.arm_beads)
        boolean("rigid", self.rigid)

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        along = _directions(self.arms, _dimension(dimension))
        steps = self.length * np.arange(1, self.arm_beads + 1)
        place = np.concatenate([np.zeros((1, dimension)), *(steps[:, None] * one for one in along)])
        bonds = []
        for arm in range(self.arms):
            first = 1 + arm * self.arm_beads
            bonds += [(0, first)] + [(k, k + 1) for k in range(first, first + self.arm_beads - 1)]
        return _joined(place, _radii(self.radii, len(place)), bonds, self.rigid)


@dataclass(frozen=True)
class LinearCluster:
    """A straight row of beads, each linked to the next one: straight at the start, and flexible.

    Links cannot hold a row of three or more beads straight (they are degenerate there: to first order none resists a
    bend), so there is no rigid form; ``StarCluster`` or a slightly bent ``Cluster`` is what comes nearest.

    Parameters
    ----------
    beads
        Number of beads, at least 2.
    length
        Length of the links [length].
    radii
        Radius of the beads, or one for each [length].

    Examples
    --------
    >>> LinearCluster(3).cluster(2).links.tolist()
    [[0, 1], [1, 2]]

    """

    beads: int
    length: float = 1.0
    radii: Radii = 0.5

    def __post_init__(self) -> None:
        integer("beads", self.beads, at_least=2, bytes_each=PARTICLE_BYTES)
        positive("length", self.length)
        _radii(self.radii, self.beads)

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        place = np.zeros((self.beads, _dimension(dimension)))
        place[:, 0] = self.length * np.arange(self.beads)
        return _joined(place, _radii(self.radii, self.beads), [(k, k + 1) for k in range(self.beads - 1)], False)


def _bond_angle(angle: Any) -> float:
    checked = real("angle", angle, above=0.0, below=math.pi)
    if abs(math.pi - checked) < 1e-6 or checked < 1e-6:
        raise ValueError(f"angle must be at least 1e-6 away from 0 and pi, got {brief(angle)}")
    return checked


def _joined(position_bd: NDArray[np.float64], radius_b: NDArray[np.float64], bonds: list[Pair], rigid: bool) -> Cluster:
    links, shape = rigid_links(position_bd, bonds) if rigid else (bonds, [False] * len(bonds))
    return Cluster(position_bd, radius_b, np.array(links), np.array(shape))


def _directions(arms: int, dimension: int) -> NDArray[np.float64]:
    if dimension == 2:
        turn = 2 * math.pi * np.arange(arms) / arms
        return np.column_stack([np.cos(turn), np.sin(turn)])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3.0)
    if arms == 8:
        return np.asarray(corners)
    if arms == 6:
        return np.concatenate([np.eye(3), -np.eye(3)])
    if arms == 4:
        tetrahedron: NDArray[np.float64] = corners[corners.prod(axis=1) > 0]
        return tetrahedron
    raise ValueError(f"arms must be 4, 6 or 8 in three dimensions, got {arms}")
