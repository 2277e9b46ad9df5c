"""Crystals: nearest neighbors exactly touching, in primitive, conventional or any other cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import integer, one_of, positive, real
from packmech.generate.crystals import CRYSTALS, LATTICE_NAMES, Crystal
from packmech.packing import Packing


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
        Number of cells along each cell vector, one number for all or d of them; 1 when nothing is said. The packing may
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
    return crystal_packing(
        crystal,
        repeats,
        supercell=supercell,
        conventional=conventional,
        relative_overlap=relative_overlap,
        diameter=diameter,
    )


def crystal_packing(
    crystal: Crystal,
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
) -> Packing:
    """Return the packing of any crystal; arguments as for `lattice_packing`.

    Parameters
    ----------
    crystal
        Cell and basis.
    repeats, supercell, conventional, relative_overlap, diameter
        As for `lattice_packing`.

    """
    diameter = positive("diameter", diameter)
    spacing = diameter * (1.0 - real("relative_overlap", relative_overlap, below=1.0))
    if not isinstance(conventional, bool):
        raise TypeError(f"conventional must be True or False, got {conventional!r}")
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
