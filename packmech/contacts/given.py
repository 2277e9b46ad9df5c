"""Contacts that a user gives in place of those within a tolerance: whether they are those of the packing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.contacts.network import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.packing import Packing


def contacts_of(
    packing: Packing, contacts: Contacts | ShapeContacts | None, gap_tolerance: float | None
) -> Contacts | ShapeContacts:
    """Return the given contacts after checking that they fit the packing, or else those within the gap tolerance.

    Raises
    ------
    TypeError, ValueError
        If the packing is none, or the contacts are of the wrong kind or those of another packing.

    """
    instance("packing", packing, Packing)
    if contacts is None:
        return touching_pairs(packing, gap_tolerance)
    check_contacts(packing, contacts)
    return contacts


def check_contacts(packing: Packing, contacts: Contacts | ShapeContacts) -> None:
    """Check that the contacts can belong to the packing.

    Raises
    ------
    TypeError, ValueError
        If they are of the wrong kind, or made for other numbers of particles or axes, or other shapes.

    """
    if not packing.shapes.has_orientations:
        instance("contacts", contacts, Contacts)
    elif not isinstance(contacts, ShapeContacts):
        raise TypeError(f"contacts must be ShapeContacts for a packing with shapes, got {type(contacts).__name__}")
    if (contacts.particles, contacts.dimension) != (packing.particles, packing.dimension):
        raise ValueError(
            f"contacts must belong to {packing.particles} particles in {packing.dimension} dimensions,"
            f" got {contacts.particles} in {contacts.dimension}"
        )
    if contacts.shapes != packing.shapes:
        raise ValueError("contacts must be those of the packing, with its shapes as they are turned, got others")


# distances of another packing or image differ by more than this, of themselves; particles that moved by less since the
# contacts were found may be judged by them
_SAME = 1e-6


def check_given(packing: Packing, contacts: Contacts | ShapeContacts) -> None:
    """Check that the contacts are pairs of the packing as it stands, each once.

    Parameters
    ----------
    packing
        The packing.
    contacts
        What was given as its contacts.

    Raises
    ------
    TypeError, ValueError
        If they are of the wrong kind, made for another number of particles or axes, name particles that are not there,
        a particle and itself, or a pair and image twice, if a vector is not the packing's, or if a contact distance is
        neither the sum of the radii nor the distance itself, which says that the pair touches whatever its radii are.

    """
    check_contacts(packing, contacts)
    if not len(contacts):
        return
    i, j, image = contacts.i_c, contacts.j_c, contacts.image_cd
    for c in np.flatnonzero((np.minimum(i, j) < 0) | (np.maximum(i, j) >= packing.particles)):
        raise ValueError(
            f"contacts must be between particles 0 to {packing.particles - 1}, got {i[c]} and {j[c]} for contact {c}"
        )
    for c in np.flatnonzero((i == j) & ~image.any(axis=1)):
        raise ValueError(f"contacts must be between two particles or images, got {i[c]} and itself for contact {c}")
    twice = _twice(contacts)
    if twice is not None:
        one, two = twice
        raise ValueError(
            f"contacts must name each pair once, got particles {i[two]} and {j[two]}, image {image[two].tolist()},"
            f" for contacts {one} and {two}"
        )
    here = contacts.at(packing)
    off = np.sqrt(((contacts.vector_cd - here.vector_cd) ** 2).sum(axis=1))
    # what is no number is not within it either
    within = _SAME * np.maximum(here.contact_distance_c, here.distance_c)
    for c in np.flatnonzero(~(off <= within)):
        raise ValueError(
            f"contacts must have the packing's vectors from center to center, got {contacts.vector_cd[c].tolist()}"
            f" instead of {here.vector_cd[c].tolist()} for contact {c} (particles {i[c]} and {j[c]},"
            f" image {image[c].tolist()})"
        )
    given = contacts.contact_distance_c
    known = (np.abs(given - here.contact_distance_c) <= within) | (np.abs(given - here.distance_c) <= within)
    for c in np.flatnonzero(~known):
        raise ValueError(
            f"contacts must have the packing's sums of radii or its distances, got {given[c]:.9g} instead of"
            f" {here.contact_distance_c[c]:.9g} or {here.distance_c[c]:.9g} for contact {c}"
            f" (particles {i[c]} and {j[c]})"
        )


def _twice(contacts: Contacts | ShapeContacts) -> tuple[int, int] | None:
    """Return the numbers of two contacts that are the same pair and image, seen from either side, or None."""
    i, j, image = contacts.pairs
    rows = np.arange(len(contacts))
    first: NDArray[np.int64] = image[rows, (image != 0).argmax(axis=1)]
    turned = (i > j) | ((i == j) & (first < 0))
    pair = np.column_stack([np.minimum(i, j), np.maximum(i, j), np.where(turned[:, None], -image, image)])
    order = np.lexsort(pair.T)
    again = np.flatnonzero((pair[order[1:]] == pair[order[:-1]]).all(axis=1))
    if not len(again):
        return None
    one, two = sorted((int(order[again[0]]), int(order[again[0] + 1])))
    return one, two
