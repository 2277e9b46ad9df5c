"""The rigidity matrix: displacements and strains to changes of contact distance; and reduced to what links admit."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import honors
from packmech.check import STRAINS, BoxStrain, instance, one_of, positive
from packmech.constraints.basis import MEMORY_LIMIT, check_memory, motion_basis
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.jacobian import scale_of_strain
from packmech.contacts import Contacts
from packmech.contacts.elements import PairGeometry, distance_rows
from packmech.contacts.given import contacts_of
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.linalg.mandel import mandel_basis, strain_directions
from packmech.mechanics.wave_matrices import wave_fractions, wave_rows
from packmech.packing import Packing


def strain_columns(contacts: PairGeometry) -> NDArray[np.float64]:
    """Return the (C, s) derivatives of the distances by the Mandel strains, which turn nothing [length].

    Of discs and spheres rho n.E.n.
    """
    d = contacts.dimension
    return np.asarray(np.einsum("mab,ca,cb->cm", mandel_basis(d), contacts.slope_cx[:, :d], contacts.vector_cd))


@honors("links shapes", packing_only=True)
def rigidity_matrix(
    packing: Packing,
    strain: BoxStrain = "free",
    *,
    strain_scale: float | None = 1.0,
    contacts: Contacts | ShapeContacts | None = None,
    gap_tolerance: float | None = None,
    wave_vector: ArrayLike | None = None,
) -> sp.csr_array:
    """Return the rigidity matrix: (C, N d + s) derivatives of contact distances, or (C, N d) without strain columns.

    Row c holds d rho_c / dx_k = n (delta_jk - delta_ik) and, for every Mandel strain E, rho n.E.n with the actual
    distance rho (equations 35 and 36 of Dennis, 2021, whose sigma in 36 holds at zero overlap only). Its
    transpose turns contact forces into net forces and V times the stress. Columns are particle-major positions, then
    the strains xx, yy, sqrt2 xy in two dimensions; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in three. Rigid
    links have no rows here; `constrained_rigidity_matrix` keeps to the motions that they admit. Of shapes the distances
    are those at which laws are taken, and the turns of each particle follow its position, as in `hessian`.

    Parameters
    ----------
    packing
        The packing; rattlers are columns of zeros unless taken out before (`remove_rattlers`).
    strain
        What the box may do: "free" appends the d(d+1)/2 strain columns [length]; "isochoric" and "isotropic" only their
        parts without trace, or along it; "none" appends nothing.
    strain_scale
        Length by which strains are multiplied to be coordinates; their columns are divided by it. None: V^(1/d).
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    wave_vector
        (d,) fractions of the reciprocal lattice [1], with strain "none": the complex rows for waves through copies of
        the box, as in `hessian`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the contacts belong to another number of particles; if waves are asked
        for with strains or rigid links.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> pm.rigidity_matrix(crystal).shape
    (27, 21)

    """
    one_of("strain", strain, STRAINS)
    found = contacts_of(packing, contacts, gap_tolerance)
    if wave_vector is not None:
        fraction = wave_fractions(wave_vector, packing.dimension)
        if strain != "none" or packing.links:
            what = f"strain {strain!r}" if strain != "none" else f"{len(packing.links)} rigid links"
            raise ValueError(f"wave_vector must be left out but for strain 'none' without rigid links, got {what}")
        return wave_rows(found, packing, fraction)
    position, columns = distance_rows(found), strain_columns(found)
    if strain == "none":
        return position
    if strain != "free":
        admitted = strain_directions(packing.dimension, strain)
        columns = columns @ admitted @ admitted.T
    columns = columns / scale_of_strain(packing, strain_scale)
    return sp.csr_array(sp.hstack([position, sp.csr_array(columns)], format="csr"))


@honors("links", packing_only=True)
def change_of_basis(
    packing: Packing,
    strain: BoxStrain = "free",
    *,
    strain_scale: float | None = 1.0,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the (N d + s, N_dof) motions that the links admit to first order, or (N d, N_dof) without strain.

    N_dof = N d + s - rank of the links (one less for isochoric strains; N d - rank in a fixed box), uniform
    translations included. The columns of B are a basis of the null space of the links' gradients (equations 28-32 of
    Dennis, 2021, with their errata): Gamma^T B = 0, and the reduced forms are B^T H B and R B. They are
    orthonormal in the coordinates of `constraint_jacobian`, `rigidity_matrix` and `hessian`, where strains are
    multiplied by `strain_scale`. Strains that the links forbid altogether are in no column.

    Parameters
    ----------
    packing
        The packing; without links the basis is that of all motions.
    strain
        What the box may do: "none", "isotropic", "isochoric" or "free". But for "none" the last rows are Mandel
        strains.
    strain_scale
        Length by which strains are multiplied to be coordinates [length]. None: V^(1/d).
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
    >>> pm.change_of_basis(dimer, strain="none").shape, pm.change_of_basis(dimer, strain="isochoric").shape
    ((4, 3), (7, 5))

    """
    instance("packing", packing, Packing)
    one_of("strain", strain, STRAINS)
    positive("memory_limit", memory_limit)
    directions = None if strain == "none" else strain_directions(packing.dimension, strain)
    scale = scale_of_strain(packing, strain_scale)
    basis = motion_basis(
        ConstraintFactor(packing),
        directions,
        mass_n=np.ones(packing.particles),
        strain_scale=scale,
        memory_limit=memory_limit,
    )
    basis[packing.position_nd.size :] *= scale
    return basis


@honors("links", packing_only=True, shaped="pm.rigidity_matrix")
def constrained_rigidity_matrix(
    packing: Packing,
    strain: BoxStrain = "free",
    *,
    strain_scale: float | None = 1.0,
    contacts: Contacts | ShapeContacts | None = None,
    gap_tolerance: float | None = None,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return R_E = R B, the (C, N_dof) changes of contact distances under the motions of `change_of_basis`.

    Equation 39 of Dennis (2021). R_E^T R_E is its dynamical matrix (with springs of stiffness 1), R_E R_E^T its
    N-matrix (`n_matrix`); the null space of R_E^T are the states of self stress, links bearing what they must.

    Parameters
    ----------
    packing, strain, strain_scale, memory_limit
        As in `change_of_basis`.
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.

    Raises
    ------
    TypeError, ValueError
        As `change_of_basis`, or if the contacts belong to another number of particles.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.constrained_rigidity_matrix(pm.lattice_packing("triangular", repeats=(3, 3)), strain="none").shape
    (27, 18)

    """
    basis = change_of_basis(packing, strain, strain_scale=strain_scale, memory_limit=memory_limit)
    matrix = rigidity_matrix(
        packing,
        "none" if strain == "none" else "free",
        strain_scale=strain_scale,
        contacts=contacts,
        gap_tolerance=gap_tolerance,
    )
    check_memory(matrix.shape[0], basis.shape[1], memory_limit)
    reduced: NDArray[np.float64] = matrix @ basis
    return reduced


@honors("links", packing_only=True, shaped="pm.rigidity_matrix")
def n_matrix(
    packing: Packing,
    strain: BoxStrain = "free",
    *,
    strain_scale: float | None = 1.0,
    contacts: Contacts | None = None,
    gap_tolerance: float | None = None,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the N-matrix R_E R_E^T, (C, C): what contact forces do to contact distances through motions.

    Its null vectors are the states of self stress.

    Parameters
    ----------
    packing, strain, strain_scale, contacts, gap_tolerance, memory_limit
        As in `constrained_rigidity_matrix`.

    Raises
    ------
    TypeError, ValueError
        As `constrained_rigidity_matrix`.

    Examples
    --------
    >>> import packmech as pm
    >>> matrix = pm.n_matrix(pm.lattice_packing("triangular", repeats=(4, 4)), strain="none")
    >>> int((np.linalg.eigvalsh(matrix) < 1e-10).sum())
    18

    """
    positive("memory_limit", memory_limit)
    found = contacts_of(packing, contacts, gap_tolerance)
    check_memory(len(found), len(found), memory_limit)
    matrix = constrained_rigidity_matrix(
        packing, strain, strain_scale=strain_scale, contacts=found, memory_limit=memory_limit
    )
    product: NDArray[np.float64] = matrix @ matrix.T
    return product
