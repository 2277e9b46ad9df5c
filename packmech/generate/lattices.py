"""Crystals and lattices, in two and three dimensions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import instance, integer, one_of, positive, real
from packmech.packing import Packing

_ROOT_2, _ROOT_3, _ROOT_7 = math.sqrt(2.0), math.sqrt(3.0), math.sqrt(7.0)
Columns = tuple[tuple[float, ...], ...]
Integers = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Crystal:
    """Primitive cell for touching particles of largest diameter 1, and the conventional cell in integers of it."""

    vectors: Columns  # one primitive lattice vector a line [diameter]
    basis: Columns  # fractional coordinates of the particles in the primitive cell
    conventional: Integers  # one conventional vector a line, in primitive vectors
    radius: tuple[float, ...] = ()  # of each particle of the basis [diameter]; all 1/2 unless given

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


def lattice_packing(
    name: str,
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
) -> Packing:
    """Return a crystal of discs or spheres in which every particle overlaps its neighbors alike.

    Parameters
    ----------
    name
        2D, the corners of the eleven Archimedean tilings: ``"triangular"``, ``"square"``, ``"honeycomb"``,
        ``"kagome"``, ``"elongated triangular"``, ``"snub square"``, ``"snub hexagonal"``, ``"rhombitrihexagonal"``,
        ``"truncated square"``, ``"truncated hexagonal"``, ``"truncated trihexagonal"``; ``"reinforced kagome"`` (the
        densest of `reinforced_kagome_packing`); with small discs in the holes ``"filled square"``,
        ``"filled triangular"``. 3D: ``"sc"``, ``"bcc"``, ``"fcc"``, ``"hcp"``, ``"diamond"``,
        ``"pyrochlore"`` (corner-sharing tetrahedra), ``"tunneled fcc"``, ``"tunneled hcp"`` (see `tunneled_packing`),
        ``"filled sc"`` (a small sphere in every cube).
    repeats
        Number of cells along each cell vector, one number for all or d of them; 1 unless given. The packing may
        be a single particle that touches its own images.
    supercell
        Instead of ``repeats``: (d, d) integers whose columns are the box vectors in cell vectors, determinant not 0.
    conventional
        Whether a cell is a right-angled one (two primitive cells of the lattices with triangular translations, 1 by
        sqrt 3; bcc, fcc, diamond, pyrochlore: cube; hcp: 1 by sqrt 3 by sqrt(8/3)) instead of the primitive one.
    relative_overlap
        xi = 1 - r/sigma of nearest neighbors [1], below 1. 0: they touch exactly; negative: they are apart.
    diameter
        Diameter of the particles, the largest where there are two [length].

    Raises
    ------
    TypeError, ValueError
        Naming the argument, for an unknown name, repeats below 1, a singular supercell, an overlap of 1 or more.

    Examples
    --------
    >>> packing = lattice_packing("kagome", repeats=(2, 2))
    >>> packing.particles, packing.box.lattice_dd[:, 0].tolist()
    (12, [4.0, 0.0])
    >>> lattice_packing("fcc", conventional=True).particles
    4

    """
    crystal = CRYSTALS[one_of("name", name, LATTICE_NAMES)]
    return crystal_packing(crystal, repeats, supercell, conventional, relative_overlap, diameter)


def crystal_packing(
    crystal: Crystal,
    repeats: int | Sequence[int] | None,
    supercell: ArrayLike | None,
    conventional: bool,
    relative_overlap: float,
    diameter: float,
) -> Packing:
    """Return the packing of any crystal; arguments as for `lattice_packing`."""
    diameter = positive("diameter", diameter)
    spacing = diameter * (1.0 - real("relative_overlap", relative_overlap, below=1.0))
    instance("conventional", conventional, bool)
    dimension = crystal.dimension
    if supercell is None:
        cells_dd = np.diag(_repeats(repeats, dimension))
    elif repeats is None:
        cells_dd = _integer_matrix(supercell, dimension)
    else:
        raise ValueError(f"repeats must be left out when supercell is given, got {repeats!r}")
    if conventional:
        cells_dd = np.array(crystal.conventional).T @ cells_dd
    vectors_dd = spacing * np.array(crystal.vectors, dtype=np.float64).T
    basis_bd = np.array(crystal.basis, dtype=np.float64)
    fraction_nd = (_cells_inside(cells_dd)[:, None, :] + basis_bd[None, :, :]).reshape(-1, dimension)
    position_nd = np.einsum("de,ne->nd", vectors_dd, fraction_nd)
    radius_n = diameter * np.tile(crystal.radius_b, len(position_nd) // len(basis_bd))
    return Packing(position_nd, radius_n, box=Box(np.einsum("de,ef->df", vectors_dd, cells_dd)))


def _repeats(repeats: int | Sequence[int] | None, dimension: int) -> list[int]:
    if repeats is None:
        return [1] * dimension
    if isinstance(repeats, (list, tuple, np.ndarray)):
        if len(repeats) != dimension:
            raise ValueError(f"repeats must hold {dimension} integers, got {len(repeats)}")
        return [integer(f"repeats[{k}]", value, at_least=1) for k, value in enumerate(repeats)]
    return [integer("repeats", repeats, at_least=1)] * dimension


def _integer_matrix(supercell: ArrayLike, dimension: int) -> NDArray[np.int64]:
    matrix = np.asarray(supercell)
    if matrix.dtype.kind not in "iu":
        raise TypeError(f"supercell must be an array of integers, got {matrix.tolist()!r}")
    if matrix.shape != (dimension, dimension):
        raise ValueError(f"supercell must have shape ({dimension}, {dimension}), got {matrix.shape}")
    matrix = matrix.astype(np.int64)
    if _adjugate(matrix)[1] == 0:
        raise ValueError(f"supercell must have a determinant other than 0, got {matrix.tolist()}")
    return matrix


def _adjugate(matrix_dd: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the integer adjugate and determinant: adjugate @ matrix = determinant * identity, without rounding."""
    if len(matrix_dd) == 2:
        (a, b), (c, d) = matrix_dd.tolist()
        adjugate = np.array([[d, -b], [-c, a]])
    else:
        # the rows of the adjugate are the cross products of the columns
        u, v, w = matrix_dd.T
        adjugate = np.array([np.cross(v, w), np.cross(w, u), np.cross(u, v)])
    return adjugate, int(adjugate[0] @ matrix_dd[:, 0])


def _cells_inside(cells_dd: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the integer points z with matrix^-1 z in [0, 1)^d, last index fastest: |det| of them, found exactly."""
    adjugate, determinant = _adjugate(cells_dd)
    low, high = np.minimum(cells_dd, 0).sum(axis=1), np.maximum(cells_dd, 0).sum(axis=1)
    grid = np.meshgrid(*[np.arange(a, b + 1) for a, b in zip(low, high, strict=True)], indexing="ij")
    point_kd = np.stack([axis.ravel() for axis in grid], axis=1)
    scaled_kd = np.sign(determinant) * point_kd @ adjugate.T
    inside_k = ((scaled_kd >= 0) & (scaled_kd < abs(determinant))).all(axis=1)
    points: NDArray[np.int64] = point_kd[inside_k]
    return points
