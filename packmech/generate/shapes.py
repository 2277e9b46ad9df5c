"""Shapes of clusters by name: dimers, trimers, rings, stars, rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import integer, positive, positive_array, real
from packmech.generate.cluster import Cluster
from packmech.generate.rigid_links import Pair, rigid_links

Radii = float | tuple[float, ...]


def _radii(radii: Any, beads: int) -> NDArray[np.float64]:
    """Return one radius for each bead, given by one number or by as many."""
    if np.ndim(radii) == 0:
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
                raise ValueError(f"angle must go from low to high, got {self.angle!r}")
        else:
            _bond_angle(self.angle)
        _radii(self.radii, 3)

    def drawn(self, rng: np.random.Generator) -> Trimer:
        """Return a trimer of one angle: itself, or with an angle drawn from its range."""
        return replace(self, angle=float(rng.uniform(*self.angle))) if isinstance(self.angle, tuple) else self

    def cluster(self, dimension: int) -> Cluster:
        """Return the beads and links in two or three dimensions."""
        if isinstance(self.angle, tuple):
            raise ValueError(f"angle must be one angle for one cluster (see drawn), got {self.angle!r}")
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
        integer("beads", self.beads, at_least=3)
        positive("length", self.length)
        _radii(self.radii, self.beads)
        _switch("rigid", self.rigid)

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
        integer("arms", self.arms, at_least=3)
        integer("arm_beads", self.arm_beads, at_least=1)
        positive("length", self.length)
        _radii(self.radii, 1 + self.arms * self.arm_beads)
        _switch("rigid", self.rigid)

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
        integer("beads", self.beads, at_least=2)
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
        raise ValueError(f"angle must be at least 1e-6 away from 0 and pi, got {angle!r}")
    return checked


def _switch(name: str, value: Any) -> None:
    if not isinstance(value, bool):
        raise TypeError(f"{name} must be True or False, got {value!r}")


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
