"""The crystals by name: cell, particles in it and their radii, for touching particles of largest diameter 1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_ROOT_2, _ROOT_3, _ROOT_7 = math.sqrt(2.0), math.sqrt(3.0), math.sqrt(7.0)
Columns = tuple[tuple[float, ...], ...]
Integers = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Crystal:
    """Primitive cell for touching particles of largest diameter 1, and the conventional cell in integers of it."""

    vectors: Columns  # one primitive lattice vector a line [diameter]
    basis: Columns  # fractional coordinates of the particles in the primitive cell
    conventional: Integers  # one conventional vector a line, in primitive vectors
    radius: tuple[float, ...] = ()  # of each particle of the basis [diameter]; 1/2 all when nothing is said

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes."""
        return len(self.vectors)

    @property
    def radius_b(self) -> NDArray[np.float64]:
        """The radii of the particles in the primitive cell [diameter]."""
        return np.array(self.radius or (0.5,) * len(self.basis), dtype=np.float64)


def _times(factor: float, vectors: Columns) -> Columns:
    return tuple(tuple(factor * x for x in vector) for vector in vectors)


def _polygon(corners: int, radius: float, first_degrees: float, vectors: Columns) -> Columns:
    """Return a regular polygon about a lattice point, in fractional coordinates."""
    angle_k = np.deg2rad(first_degrees + 360.0 / corners * np.arange(corners))
    corner_kd = radius * np.stack([np.cos(angle_k), np.sin(angle_k)], axis=1)
    return _fractions(corner_kd, vectors)


def _fractions(position_bd: NDArray[np.float64], vectors: Columns) -> Columns:
    fraction_bd = np.linalg.solve(np.array(vectors).T, position_bd.T).T
    return tuple(tuple(line) for line in fraction_bd.tolist())


_TRIANGULAR: Columns = ((1.0, 0.0), (0.5, _ROOT_3 / 2))
_SQUARE: Columns = ((1.0, 0.0), (0.0, 1.0))
_CUBE: Columns = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_RECTANGLE: Integers = ((1, 0), (-1, 2))
_SAME_2: Integers = ((1, 0), (0, 1))
_SAME_3: Integers = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_FCC: Columns = _times(1 / _ROOT_2, ((0, 1, 1), (1, 0, 1), (1, 1, 0)))
_FCC_CUBE: Integers = ((-1, 1, 1), (1, -1, 1), (1, 1, -1))
_THIRDS: Columns = ((1 / 3, 1 / 3), (2 / 3, 2 / 3))

_TRUNCATED_SQUARE = _times(1 + _ROOT_2, _SQUARE)
_TRUNCATED_HEXAGONAL = _times(2 + _ROOT_3, _TRIANGULAR)
_RHOMBITRIHEXAGONAL = _times(1 + _ROOT_3, _TRIANGULAR)
_TRUNCATED_TRIHEXAGONAL = _times(3 + _ROOT_3, _TRIANGULAR)
# a triangle about each honeycomb site (1/3, 1/3), (2/3, 2/3), with its corners towards the neighboring sites
_TOWARDS = tuple((x / (2 + _ROOT_3), y / (2 + _ROOT_3)) for x, y in ((1 / 3, 1 / 3), (-2 / 3, 1 / 3), (1 / 3, -2 / 3)))
_TRIANGLES: Columns = tuple(
    (site[0] + sign * x, site[1] + sign * y) for site, sign in zip(_THIRDS, (1, -1), strict=True) for x, y in _TOWARDS
)
# the fraction x of (x, x + 1/2) at which (x, x + 1/2) and (-x, 1/2 - x) touch
_SNUB = (_ROOT_3 - 1) / 4
# the triangular lattice less one site of seven, by two primitive vectors of the sites that are left out
_SEVENTH: Columns = ((2.5, _ROOT_3 / 2), (0.5, 3 * _ROOT_3 / 2))


def reinforced_kagome(cells: int) -> Crystal:
    """Return kagome cells with a row and a column of discs more after every so many of them.

    Parameters
    ----------
    cells
        Between two reinforcements.

    """
    side = 2 * cells + 1
    kept = [(i, j) for i in range(side) for j in range(side) if i % 2 == 0 or j % 2 == 0]
    return Crystal(_times(side, _TRIANGULAR), tuple((i / side, j / side) for i, j in kept), _RECTANGLE)


def tunneled(steps: Sequence[int]) -> Crystal:
    """Return honeycomb layers stacked by steps: 1/sqrt 3 of a diameter at 30 + 60 k degrees, sqrt(2/3) up.

    Parameters
    ----------
    steps
        The k from each layer to the next.

    """
    angle_k = np.deg2rad([30.0 + 60.0 * step for step in steps])
    height_k = np.full(len(angle_k), math.sqrt(2 / 3))
    shift_kd = np.stack([np.cos(angle_k) / _ROOT_3, np.sin(angle_k) / _ROOT_3, height_k], axis=1)
    layer_kd = np.vstack([np.zeros(3), np.cumsum(shift_kd, axis=0)])
    # the two sites of a honeycomb whose hexagons have their middle at the origin
    site_bd = np.array([[1.0, 0.0, 0.0], [0.5, _ROOT_3 / 2, 0.0]])
    vectors: Columns = ((1.5, _ROOT_3 / 2, 0.0), (0.0, _ROOT_3, 0.0), tuple(layer_kd[-1].tolist()))
    position_bd = (layer_kd[:-1, None, :] + site_bd[None, :, :]).reshape(-1, 3)
    return Crystal(vectors, _fractions(position_bd, vectors), ((2, -1, 0), (0, 1, 0), (0, 0, 1)))


CRYSTALS = {
    # the eleven Archimedean tilings, discs of diameter 1 about their corners
    "triangular": Crystal(_TRIANGULAR, ((0, 0),), _RECTANGLE),
    "square": Crystal(_SQUARE, ((0, 0),), _SAME_2),
    "honeycomb": Crystal(_times(_ROOT_3, _TRIANGULAR), ((0, 0), (1 / 3, 1 / 3)), _RECTANGLE),
    "kagome": Crystal(_times(2.0, _TRIANGULAR), ((0, 0), (0.5, 0), (0, 0.5)), _RECTANGLE),
    "elongated triangular": Crystal(
        ((1.0, 0.0), (0.5, 1 + _ROOT_3 / 2)),
        ((0, 0), (-1 / (2 + _ROOT_3), 2 / (2 + _ROOT_3))),
        _RECTANGLE,
    ),
    "snub square": Crystal(
        _times(math.sqrt(2 + _ROOT_3), _SQUARE),
        ((_SNUB, 0.5 + _SNUB), (-_SNUB, 0.5 - _SNUB), (0.5 - _SNUB, _SNUB), (0.5 + _SNUB, -_SNUB)),
        _SAME_2,
    ),
    "snub hexagonal": Crystal(_SEVENTH, _polygon(6, 1.0, 0.0, _SEVENTH), ((1, 0), (-1, 2))),
    "rhombitrihexagonal": Crystal(
        _RHOMBITRIHEXAGONAL, _polygon(6, 1.0, 30.0, _RHOMBITRIHEXAGONAL), _RECTANGLE
    ),
    "truncated square": Crystal(
        _TRUNCATED_SQUARE, _polygon(4, 1 / _ROOT_2, 0.0, _TRUNCATED_SQUARE), _SAME_2
    ),
    "truncated hexagonal": Crystal(_TRUNCATED_HEXAGONAL, _TRIANGLES, _RECTANGLE),
    "truncated trihexagonal": Crystal(
        _TRUNCATED_TRIHEXAGONAL,
        _polygon(12, (math.sqrt(6) + _ROOT_2) / 2, 15.0, _TRUNCATED_TRIHEXAGONAL),
        _RECTANGLE,
    ),
    "reinforced kagome": reinforced_kagome(1),
    # small discs in the holes of others
    "filled square": Crystal(_SQUARE, ((0, 0), (0.5, 0.5)), _SAME_2, (0.5, (_ROOT_2 - 1) / 2)),
    "filled triangular": Crystal(
        _TRIANGULAR, ((0, 0), *_THIRDS), _RECTANGLE, (0.5, 1 / _ROOT_3 - 0.5, 1 / _ROOT_3 - 0.5)
    ),
    # spheres
    "sc": Crystal(_CUBE, ((0, 0, 0),), _SAME_3),
    "bcc": Crystal(
        _times(1 / _ROOT_3, ((-1, 1, 1), (1, -1, 1), (1, 1, -1))),
        ((0, 0, 0),),
        ((0, 1, 1), (1, 0, 1), (1, 1, 0)),
    ),
    "fcc": Crystal(_FCC, ((0, 0, 0),), _FCC_CUBE),
    "hcp": Crystal(
        ((1, 0, 0), (0.5, _ROOT_3 / 2, 0), (0, 0, math.sqrt(8 / 3))),
        ((0, 0, 0), (1 / 3, 1 / 3, 0.5)),
        ((1, 0, 0), (-1, 2, 0), (0, 0, 1)),
    ),
    "diamond": Crystal(
        _times(4 / math.sqrt(6), _FCC), ((0, 0, 0), (0.25, 0.25, 0.25)), _FCC_CUBE
    ),
    "pyrochlore": Crystal(
        _times(2.0, _FCC), ((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5)), _FCC_CUBE
    ),
    "tunneled fcc": tunneled((0,)),
    "tunneled hcp": tunneled((0, 3)),
    "filled sc": Crystal(_CUBE, ((0, 0, 0), (0.5, 0.5, 0.5)), _SAME_3, (0.5, (_ROOT_3 - 1) / 2)),
}  # fmt: skip

LATTICE_NAMES = tuple(CRYSTALS)
