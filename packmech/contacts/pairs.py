"""Near pairs of a packing of any shapes: found, measured, listed."""

from __future__ import annotations

from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.contacts.shape_contacts import ShapeContacts, candidate_shapes, shape_contacts
from packmech.packing import Packing


def search_pairs(packing: Packing, scale: float = 1.0, skin: float = 0.0) -> Candidates:
    """Return the pairs of sites that touch when particles are grown by a factor and a skin, and perhaps some more.

    Parameters
    ----------
    packing
        The packing.
    scale
        Factor of all radii [1].
    skin
        What is added to each distance of contact [length].

    """
    if packing.shapes is not None:
        return candidate_shapes(packing, scale, skin)
    return candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=scale, skin=skin)


def measure_pairs(packing: Packing, pairs: Candidates) -> Contacts | ShapeContacts:
    """Return the given pairs of sites, touching or not, as they are in a packing."""
    return pair_contacts(packing, *pairs) if packing.shapes is None else shape_contacts(packing, pairs)


def list_pairs(contacts: Contacts | ShapeContacts) -> Candidates:
    """Return the pairs of sites, as `measure_pairs` takes them: particles, or the beads of bodies."""
    if isinstance(contacts, ShapeContacts):
        return contacts.pairs
    return Candidates(contacts.i_c, contacts.j_c, contacts.image_cd)
