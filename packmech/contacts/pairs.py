"""Near pairs of a packing of any shapes: found, measured, listed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.excluded import Excluded
from packmech.contacts.network import Candidates, Contacts, pair_contacts
from packmech.contacts.shape_contacts import ShapeContacts, candidate_sites, shape_contacts
from packmech.packing import Packing

Pairs = Candidates | Contacts | ShapeContacts


def search_pairs(packing: Packing, scale: float = 1.0, skin: float = 0.0) -> Candidates:
    """Return the pairs of sites that touch when particles are grown by a factor and a skin, and perhaps some more.

    None that links rule out: linked pairs, and those within a rigid cluster.

    Parameters
    ----------
    packing
        The packing.
    scale
        Factor of all radii [1].
    skin
        What is added to each distance of contact [length].

    """
    pairs = candidate_sites(packing, scale, skin)
    if not packing.links:
        return pairs
    apart = ~Excluded(packing).mask(*pairs)
    return Candidates(*(part[apart] for part in pairs))


def measure_pairs(packing: Packing, pairs: Candidates, *, second: bool = False) -> Contacts | ShapeContacts:
    """Return the given pairs of sites, touching or not, as they are in a packing; with curvatures if `second`."""
    if packing.shapes.has_orientations:
        return shape_contacts(packing, pairs, second=second)
    return pair_contacts(packing, *pairs)


def list_pairs(pairs: Pairs) -> Candidates:
    """Return the pairs of sites, as `measure_pairs` takes them: particles, or the beads of bodies."""
    return pairs if isinstance(pairs, Candidates) else pairs.pairs


def pair_names(pairs: Pairs) -> list[tuple[int, ...]]:
    """Return pairs of sites as (i, j, image)."""
    return [tuple(row) for row in np.column_stack(list_pairs(pairs)).tolist()]


def are_among(some: Pairs, others: Pairs) -> NDArray[np.bool_]:
    """Return which of some pairs are among others, by sites and images."""
    return np.isin(_keys(some), _keys(others))


def places_among(some: Pairs, others: Pairs) -> NDArray[np.int64]:
    """Return where pairs, all of them listed, are among others."""
    key = _keys(others)
    order = np.argsort(key)
    return np.asarray(order[np.searchsorted(key[order], _keys(some))])


def _keys(pairs: Pairs) -> NDArray[np.int64]:
    """Return a number for each pair of sites and its image."""
    sites = list_pairs(pairs)
    key = np.asarray(sites.i_c * (1 << 24) + sites.j_c)
    for column in sites.image_cd.T:
        key = key * 401 + column + 200
    return key
