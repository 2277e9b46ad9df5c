"""Matrices reduced to the motions that rigid links admit: dense, for small packings, and what others are checked by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, one_of, positive
from packmech.contacts import Contacts
from packmech.measure.link_tension import link_gradients
from packmech.mechanics.hessian import VOLUMES, strain_directions
from packmech.mechanics.link_basis import MEMORY_LIMIT, check_memory, motion_basis
from packmech.mechanics.rigidity import TOUCHING, contacts_of, rigidity_matrix
from packmech.packing import Packing


def change_of_basis(
    packing: Packing,
    strain: bool = True,
    *,
    volume: str = "free",
    strain_scale: float | None = None,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the (N_dof, N d + s) motions that the links admit to first order, or (N_dof, N d) without strain.

    N_dof = N d + s - rank of the links (- 1 at fixed volume; N d - rank in a fixed box), uniform translations
    included. The rows of B are a basis of the null space of the links' gradients (equations 28-32 of the polymer source
    with their errata): B Gamma = 0, and the reduced forms are B H B^T and R B^T. They are orthonormal in x.x +
    strain_scale^2 e.e. Strains that the links forbid altogether are in no row.

    Parameters
    ----------
    packing
        The packing; without links the basis is that of all motions.
    strain
        Whether the box may strain; then the last columns are Mandel strains.
    volume
        "free", or "fixed" for strains without trace.
    strain_scale
        Length that a unit strain counts as [length]; V^(1/d) by default.
    memory_limit
        Largest memory of the answer [bytes]. `elastic_moduli`, `normal_modes` and the others need no such matrix.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or the matrix would exceed the limit.

    Examples
    --------
    >>> import packmech as pm
    >>> dimer = pm.Packing([[0, 0], [1, 0]], [0.5, 0.5], pm.Box.cubic(3.0, 2), pm.Links([0], [1], [[0, 0]], [1.0]))
    >>> pm.change_of_basis(dimer, strain=False).shape, pm.change_of_basis(dimer, volume="fixed").shape
    ((3, 4), (5, 7))

    """
    instance("packing", packing, Packing)
    instance("strain", strain, bool)
    one_of("volume", volume, VOLUMES)
    positive("memory_limit", memory_limit)
    scale = packing.box.volume ** (1.0 / packing.dimension) if strain_scale is None else strain_scale
    positive("strain_scale", scale)
    directions = strain_directions(packing.dimension, volume) if strain else None
    basis = motion_basis(
        link_gradients(packing),
        directions,
        mass_n=np.ones(packing.particles),
        strain_scale=scale,
        memory_limit=memory_limit,
    )
    return np.ascontiguousarray(basis.T)


def constrained_rigidity_matrix(
    packing: Packing,
    strain: bool = True,
    *,
    volume: str = "free",
    strain_scale: float | None = None,
    contacts: Contacts | None = None,
    gap_tolerance: float = TOUCHING,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return R_E = R B^T, the (C, N_dof) changes of contact distances under the motions of `change_of_basis`.

    Equation 39 of the polymer source. R_E^T R_E is its dynamical matrix (with springs of stiffness 1), R_E R_E^T its
    N-matrix (`n_matrix`); the null space of R_E^T are the states of self stress, links bearing what they must.

    Parameters
    ----------
    packing, strain, volume, strain_scale, memory_limit
        As in `change_of_basis`.
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.

    Raises
    ------
    TypeError, ValueError
        As `change_of_basis`, or if the contacts belong to another number of particles.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.constrained_rigidity_matrix(pm.lattice_packing("triangular", repeats=(3, 3)), strain=False).shape
    (27, 18)

    """
    basis = change_of_basis(packing, strain, volume=volume, strain_scale=strain_scale, memory_limit=memory_limit)
    matrix = rigidity_matrix(packing, strain, contacts=contacts, gap_tolerance=gap_tolerance)
    check_memory(matrix.shape[0], len(basis), memory_limit)
    reduced: NDArray[np.float64] = matrix @ basis.T
    return reduced


def n_matrix(
    packing: Packing,
    strain: bool = True,
    *,
    volume: str = "free",
    strain_scale: float | None = None,
    contacts: Contacts | None = None,
    gap_tolerance: float = TOUCHING,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the N-matrix R_E R_E^T, (C, C): what contact forces do to contact distances through motions.

    Its null vectors are the states of self stress.

    Parameters
    ----------
    packing, strain, volume, strain_scale, contacts, gap_tolerance, memory_limit
        As in `constrained_rigidity_matrix`.

    Raises
    ------
    TypeError, ValueError
        As `constrained_rigidity_matrix`.

    Examples
    --------
    >>> import packmech as pm
    >>> matrix = pm.n_matrix(pm.lattice_packing("triangular", repeats=(4, 4)), strain=False)
    >>> int((np.linalg.eigvalsh(matrix) < 1e-10).sum())
    18

    """
    positive("memory_limit", memory_limit)
    found = contacts_of(packing, contacts, gap_tolerance)
    check_memory(len(found), len(found), memory_limit)
    matrix = constrained_rigidity_matrix(
        packing, strain, volume=volume, strain_scale=strain_scale, contacts=found, memory_limit=memory_limit
    )
    product: NDArray[np.float64] = matrix @ matrix.T
    return product
