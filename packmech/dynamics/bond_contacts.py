"""Bonds made of the contacts of a packing."""

from __future__ import annotations

from packmech.check import instance, one_of
from packmech.contacts import find_contacts
from packmech.effects import Bonds, LinearSpring
from packmech.effects.laws import Law
from packmech.packing import Packing, without_links

REST = ("contact", "distance")


def bond_contacts(
    packing: Packing,
    *,
    compression: Law | None = None,
    tension: Law | None = None,
    tangential_stiffness: float = 1.0,
    damping: float = 0.0,
    tangential_damping: float = 0.0,
    rest: str = "contact",
    gap_tolerance: float = 0.0,
) -> Bonds:
    """Return bonds between all particles that touch.

    Parameters
    ----------
    packing
        The packing.
    compression, tension
        Laws of the normal springs; LinearSpring() unless given.
    tangential_stiffness, damping, tangential_damping
        As of `Bonds`.
    rest
        Lengths at which the normal springs are slack: "contact", the sums of the radii, so that bonds made in a
        compressed packing push; "distance", the distances as they are, so that they do not.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> bonds = bond_contacts(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01))
    >>> len(bonds), float(bonds.rest_length_b[0])
    (27, 1.0)

    """
    instance("packing", packing, Packing)
    without_links("packing", packing)
    one_of("rest", rest, REST)
    contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    return Bonds(
        contacts.i_c,
        contacts.j_c,
        contacts.image_cd,
        contacts.contact_distance_c if rest == "contact" else contacts.distance_c,
        LinearSpring() if compression is None else compression,
        LinearSpring() if tension is None else tension,
        tangential_stiffness,
        damping,
        tangential_damping,
    )
