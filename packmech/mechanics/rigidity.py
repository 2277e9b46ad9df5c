"""The rigidity matrix: displacements and strains to changes of contact distance."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import instance
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.rattlers import check_contacts
from packmech.measure.link_tension import distance_gradients
from packmech.mechanics.strain import normal_strains
from packmech.packing import Packing

# largest relative gap that is rounding of a contact: crystals and exact hard-particle packings touch only to rounding
TOUCHING = 1e-9


def contacts_of(packing: Packing, contacts: Contacts | None, gap_tolerance: float) -> Contacts:
    """Return the given contacts after checking that they fit the packing, or else those within the gap tolerance."""
    instance("packing", packing, Packing)
    if contacts is None:
        return find_contacts(packing, gap_tolerance=gap_tolerance)
    check_contacts(packing, contacts)
    return contacts


def strain_columns(contacts: Contacts) -> NDArray[np.float64]:
    """Return the (C, s) derivatives rho n.E.n of the contact distances with respect to the Mandel strains [length]."""
    return contacts.distance_c[:, None] * normal_strains(contacts.normal_cd)


def rigidity_matrix(
    packing: Packing, strain: bool = True, *, contacts: Contacts | None = None, gap_tolerance: float = TOUCHING
) -> sp.csr_array:
    """Return the rigidity matrix: (C, N d + s) derivatives of contact distances, or (C, N d) without strain columns.

    Row c holds d rho_c / dx_k = n (delta_jk - delta_ik) and, for every Mandel strain E, rho n.E.n with the actual
    distance rho (equations 35 and 36 of the polymer source, whose sigma in 36 holds at zero overlap only). Its
    transpose turns contact forces into net forces and V times the stress. Columns are particle-major positions, then
    the strains xx, yy, sqrt2 xy in two dimensions; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in three. Rigid
    links have no rows here; `constrained_rigidity_matrix` keeps to the motions that they admit.

    Parameters
    ----------
    packing
        The packing; rattlers are columns of zeros unless taken out before (`remove_rattlers`).
    strain
        Whether to append the d(d+1)/2 strain columns [length].
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; the default admits the
        rounding of crystals and of exact hard-particle packings.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the contacts belong to another number of particles.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> pm.rigidity_matrix(crystal).shape
    (27, 21)

    """
    instance("strain", strain, bool)
    found = contacts_of(packing, contacts, gap_tolerance)
    position = distance_gradients(found)
    if not strain:
        return position
    return sp.csr_array(sp.hstack([position, sp.csr_array(strain_columns(found))], format="csr"))
