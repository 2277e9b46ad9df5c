"""Crystals, and their defects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.honors import honors
from packmech.check import (
    PARTICLE_BYTES,
    boolean,
    brief,
    check_memory,
    clear_errors,
    entries,
    instance,
    integer,
    one_of,
    positive,
    real,
)
from packmech.contacts.shape_contacts import touching_pairs
from packmech.packing import Packing, masses_of_density

_ROOT_2, _ROOT_3 = math.sqrt(2.0), math.sqrt(3.0)
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


@clear_errors
def lattice_packing(
    name: str,
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
    density: float | None = None,
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
    density
        Mass over area, or over volume in space, of every particle [mass/length^d]; as of a `Packing` unless given.

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
    return crystal_packing(crystal, repeats, supercell, conventional, relative_overlap, diameter, density)


def crystal_packing(
    crystal: Crystal,
    repeats: int | Sequence[int] | None,
    supercell: ArrayLike | None,
    conventional: bool,
    relative_overlap: float,
    diameter: float,
    density: float | None,
) -> Packing:
    """Return the packing of any crystal; arguments as for `lattice_packing`."""
    diameter = positive("diameter", diameter)
    spacing = diameter * (1.0 - real("relative_overlap", relative_overlap, below=1.0))
    boolean("conventional", conventional)
    dimension = crystal.dimension
    if supercell is None:
        cells_dd = np.diag(_repeats(repeats, dimension))
    elif repeats is None:
        cells_dd = _integer_matrix(supercell, dimension)
    else:
        raise ValueError(f"repeats must be left out when supercell is given, got {brief(repeats)}")
    cells = abs(float(np.linalg.det(cells_dd.astype(np.float64))))
    check_memory("repeats" if supercell is None else "supercell", cells * len(crystal.basis) * PARTICLE_BYTES)
    if conventional:
        cells_dd = np.array(crystal.conventional).T @ cells_dd
    vectors_dd = spacing * np.array(crystal.vectors, dtype=np.float64).T
    basis_bd = np.array(crystal.basis, dtype=np.float64)
    fraction_nd = (_cells_inside(cells_dd)[:, None, :] + basis_bd[None, :, :]).reshape(-1, dimension)
    position_nd = np.einsum("de,ne->nd", vectors_dd, fraction_nd)
    radius_n = diameter * np.tile(crystal.radius_b, len(position_nd) // len(basis_bd))
    box = Box(np.einsum("de,ef->df", vectors_dd, cells_dd))
    return Packing(position_nd, radius_n, box, mass_n=masses_of_density(density, radius_n, dimension))


def _repeats(repeats: int | Sequence[int] | None, dimension: int) -> list[int]:
    if repeats is None:
        return [1] * dimension
    if isinstance(repeats, (list, tuple, np.ndarray)):
        if len(repeats) != dimension:
            raise ValueError(f"repeats must hold {dimension} integers, got {len(repeats)}")
        return [integer(f"repeats[{k}]", value, at_least=1) for k, value in enumerate(repeats)]
    return [integer("repeats", repeats, at_least=1)] * dimension


def _integer_matrix(supercell: ArrayLike, dimension: int) -> NDArray[np.int64]:
    matrix = entries("supercell", supercell, "iu", "integers")
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


# pairs of a crystal touch to rounding: the gap up to which they count
_TOUCHING = 1e-9


@clear_errors
def reinforced_kagome_packing(
    cells: int,
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
    density: float | None = None,
) -> Packing:
    """Return a kagome lattice with one row and one column of discs more in every so many cells.

    Where the kagome lattice leaves out the sites with two odd numbers of the triangular lattice, here two rows without
    vacancies lie side by side after every `cells` cells along each lattice vector: (2 c + 1)^2 - c^2 discs in a
    cell of side 2 c + 1. Strictly jammed, at a packing fraction that falls to that of the kagome lattice,
    sqrt(3) pi/8 = 0.680, as c grows (Donev, Torquato, Stillinger and Connelly, J. Comput. Phys. 197, 139 (2004), figure
    10).

    Parameters
    ----------
    cells
        Kagome cells c between two reinforcements, at least 1.
    repeats, supercell, conventional, relative_overlap, diameter, density
        As for `lattice_packing`; the cell is the one of side 2 c + 1.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, for cells below 1 and what `lattice_packing` refuses.

    Examples
    --------
    >>> packing = reinforced_kagome_packing(3)
    >>> packing.particles, packing.box.lattice_dd[:, 0].round(12).tolist()
    (40, [7.0, 0.0])

    """
    # particles grow as the square of the cells
    check_memory("cells", integer("cells", cells, at_least=1) ** 2 * PARTICLE_BYTES)
    crystal = reinforced_kagome(cells)
    return crystal_packing(crystal, repeats, supercell, conventional, relative_overlap, diameter, density)


@clear_errors
def tunneled_packing(
    steps: Sequence[int],
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
    density: float | None = None,
) -> Packing:
    """Return a tunneled crystal: honeycomb layers, stacked so that their vacancies form self-avoiding tunnels.

    Each layer is a close-packed one less the middle of every hexagon. The next one lies sqrt(2/3) diameters higher,
    shifted by 1/sqrt 3 of a diameter in one of six directions: the step k points 30 + 60 k degrees from a contact, and
    leads the tunnels there. Every sphere touches three others in its layer, two above and two below, whatever the
    steps. The packing fraction is sqrt(2) pi/9 = 0.494, two thirds of the densest (Torquato and Stillinger, J. Appl.
    Phys. 102, 093511 (2007)).

    That paper, whose crystals are among these (it counts two kinds of coordination, of four here), calls them strictly
    jammed. In periodic boxes they are not. A cell of L layers has 7 L contacts and 6 L - 3 + 6 ways to
    move and strain, and strict jamming needs one row more than these, the volume's included: too many for L = 1 and 2.
    For every choice of steps up to L = 5 the cell has floppy strains at fixed volume. They change no contact to first
    order, so lengthen it to second, while the volume shrinks to second order: the crystals shear into denser ones.

    Parameters
    ----------
    steps
        From each layer to the next, 0 to 5. A single step, ``(0,)``, is part of the fcc crystal with straight
        tunnels; ``(0, 3)`` of the hcp crystal. Even and odd steps are the two ways to stack close-packed layers.
    repeats, supercell, relative_overlap, diameter, density
        As for `lattice_packing`; the primitive cell holds two spheres of each layer. Its third vector is the sum of the
        steps.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, for steps other than 0 to 5 and what `lattice_packing` refuses.

    Examples
    --------
    >>> packing = tunneled_packing((0, 3), repeats=(2, 2, 1))
    >>> packing.particles, round(packing.box.volume * 2**0.5 / packing.particles, 12)
    (16, 1.5)

    """
    if isinstance(steps, str) or not isinstance(steps, (list, tuple, np.ndarray)):
        raise TypeError(f"steps must be a sequence of integers, got {brief(steps)}")
    if not len(steps):
        raise ValueError("steps must hold at least 1 integer, got none")
    step_k = [integer(f"steps[{k}]", step, at_least=0, at_most=5) for k, step in enumerate(steps)]
    return crystal_packing(tunneled(step_k), repeats, supercell, False, relative_overlap, diameter, density)


@honors("shapes", packing_only=True)
def vacancy_packing(packing: Packing, vacancies: int, *, seed: int, apart: bool = False) -> Packing:
    """Return a packing without so many of its particles, drawn at random.

    Parameters
    ----------
    packing
        The packing, without rigid links.
    vacancies
        Number of particles to leave out, at least 1 and fewer than there are.
    seed
        Draws them: the same seed, the same vacancies.
    apart
        Whether no two vacancies may touch: they are drawn one by one among the particles that touch no earlier one.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; also when so many vacancies find no room apart.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(5, 5))
    >>> vacancy_packing(crystal, 3, seed=0, apart=True).particles
    22

    """
    instance("packing", packing, Packing)
    count = integer("vacancies", vacancies, at_least=1)
    if count >= packing.particles:
        raise ValueError(f"vacancies must be fewer than the particles ({packing.particles}), got {count}")
    rng = np.random.default_rng(integer("seed", seed, at_least=0))
    boolean("apart", apart)
    kept_n = np.ones(packing.particles, dtype=bool)
    order_n = rng.permutation(packing.particles)
    if not apart:
        kept_n[order_n[:count]] = False
    else:
        contacts = touching_pairs(packing, _TOUCHING)
        free_n = np.ones(packing.particles, dtype=bool)
        for k in order_n:
            if free_n[k] and np.count_nonzero(~kept_n) < count:
                kept_n[k] = False
                free_n[contacts.j_c[contacts.i_c == k]] = False
                free_n[contacts.i_c[contacts.j_c == k]] = False
        found = np.count_nonzero(~kept_n)
        if found < count:
            raise ValueError(f"vacancies must find room apart from each other, got {count}, with room for {found} here")
    return packing.select(kept_n)
