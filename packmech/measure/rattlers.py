"""Rattlers: particles that move freely between those that do not."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.compiled import single_thread
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.given import check_given
from packmech.contacts.network import pair_contacts
from packmech.contacts.rattlers import loose_particles
from packmech.links import Links, image_offsets
from packmech.measure.link_tension import DEPENDENT, distance_gradients
from packmech.packing import Packing, no_own_images


def loose_in(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether the contacts, and links if there are any, leave it free."""
    if packing.links is None:
        return loose_particles(contacts)
    from packmech.measure.loose_beads import loose_beads

    with single_thread():
        return loose_beads(packing, contacts)


def find_rattlers(
    packing: Packing, *, gap_tolerance: float = 1e-9, contacts: Contacts | None = None
) -> NDArray[np.bool_]:
    """Return, for each particle, whether it rattles: its contacts with particles that do not rattle fail to hold it.

    A particle is held when its contact normals positively span the space. Particles in contact with none are rattlers.
    With rigid links it is held if no motion that its cluster's links admit moves it while its contacts stay closed:
    a bead without contacts may be held by its links, and a loose end of a chain rattles while the rest is held.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching. The default, 1e-9, admits
        the rounding of crystals and of exact hard-particle packings. It is not the rule of `classify_jamming`, which
        goes by the mean overlap: `contacts=verdict.touching.contacts` gives the pairs that a verdict took.
    contacts
        The contacts to judge by instead of those within `gap_tolerance`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the contacts are not those of the packing as it stands.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> int(find_rattlers(crystal).sum())
    0
    >>> apart = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=-1e-6)
    >>> int(find_rattlers(apart).sum()), int(find_rattlers(apart, gap_tolerance=1e-5).sum())
    (9, 0)

    """
    instance("packing", packing, Packing)
    no_own_images("packing", packing)
    if contacts is None:
        contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    else:
        check_given(packing, contacts)
    return loose_in(packing, contacts)


def remove_rattlers(
    packing: Packing, *, gap_tolerance: float = 1e-9, contacts: Contacts | None = None
) -> tuple[Packing, NDArray[np.int64]]:
    """Return the packing without its rattlers, and the (N',) numbers that its particles had before.

    Clusters are cut where only a part of them rattles: links between particles that are left stay, others go. Distances
    that those held (of a rigid part that turns about two of its particles, say) become links of shape.

    Parameters
    ----------
    packing, gap_tolerance, contacts
        As in `find_rattlers`: pairs touch up to a relative gap of 1e-9 unless another is given.

    Raises
    ------
    ValueError
        If every particle rattles, so that nothing is left.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    >>> backbone, index_n = remove_rattlers(crystal)
    >>> backbone == crystal, index_n.tolist()
    (True, [0, 1, 2, 3, 4, 5, 6, 7])

    """
    loose = find_rattlers(packing, gap_tolerance=gap_tolerance, contacts=contacts)
    if loose.all():
        raise ValueError(f"packing must have particles that do not rattle, got {packing.particles} rattlers")
    return without(packing, loose)


def without(packing: Packing, loose_n: NDArray[np.bool_]) -> tuple[Packing, NDArray[np.int64]]:
    """Return the packing without the named particles and their links, and the numbers that the others had before."""
    kept = np.flatnonzero(~loose_n)
    links = None
    if packing.links is not None:
        whole = _with_inner_links(packing, packing.links, loose_n)
        if (~loose_n[whole.i_l] & ~loose_n[whole.j_l]).any():
            links = whole.numbered(np.where(loose_n, -1, np.cumsum(~loose_n) - 1))
    return packing.replace(position_nd=packing.position_nd[kept], radius_n=packing.radius_n[kept], links=links), kept


def _with_inner_links(packing: Packing, links: Links, loose_n: NDArray[np.bool_]) -> Links:
    """Return the links, and shape links for the distances that held particles have by way of those taken out."""
    ends = np.stack([links.i_l, links.j_l], axis=1)
    between = np.flatnonzero(loose_n[ends].all(axis=1))
    part = links.select(between).clusters(packing.particles) if len(between) else np.arange(packing.particles)
    rim = np.flatnonzero(loose_n[ends].sum(axis=1) == 1)
    found: list[tuple[int, int, NDArray[np.int64]]] = []
    for p in np.unique(part[ends[rim][loose_n[ends[rim]]]]):
        inside = loose_n & (part == p)
        edge = ends[inside[ends].any(axis=1)].ravel()
        edge = np.unique(edge[~inside[edge]])
        if len(edge) > 1:
            near = inside.copy()
            near[edge] = True
            found += _held_pairs(packing, links.select(near[ends].all(axis=1)), edge)
    if not found:
        return links
    i, j, image = (np.array(column) for column in zip(*found, strict=True))
    vector = packing.position_nd[j] - packing.position_nd[i] + image @ packing.box.lattice_dd.T
    assert links.shape_l is not None
    return Links(
        np.concatenate([links.i_l, i]),
        np.concatenate([links.j_l, j]),
        np.concatenate([links.image_ld, image]),
        np.concatenate([links.length_l, np.sqrt((vector**2).sum(axis=1))]),
        np.concatenate([links.shape_l, np.ones(len(i), dtype=bool)]),
    )


def _held_pairs(packing: Packing, links: Links, edge: NDArray[np.int64]) -> list[tuple[int, int, NDArray[np.int64]]]:
    """Return pairs among the particles `edge`, with images, whose distance the links hold and those among them do not.

    To first order; each pair found counts as linked for those after it.
    """
    offset, _ = image_offsets(links, packing.particles)
    pairs = list(itertools.combinations(edge.tolist(), 2))
    i, j = np.array(pairs).T
    image = offset[j] - offset[i]
    own = pair_contacts(packing, links.i_l, links.j_l, links.image_ld)
    column = np.unique(np.concatenate([links.i_l, links.j_l]))
    column = (column[:, None] * packing.dimension + np.arange(packing.dimension)).ravel()
    row_l = distance_gradients(own)[:, column].toarray()
    row_p = distance_gradients(pair_contacts(packing, i, j, image))[:, column].toarray()
    known = row_l[np.isin(links.i_l, edge) & np.isin(links.j_l, edge)]
    found = []
    for k, row in enumerate(row_p):
        if _spanned(row, row_l) and not _spanned(row, known):
            found.append((*pairs[k], image[k]))
            known = np.vstack([known, row])
    return found


def _spanned(row: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether a row is a combination of the others."""
    if not len(others):
        return False
    share = np.linalg.lstsq(others.T, row, rcond=DEPENDENT)[0]
    return bool(np.abs(row - others.T @ share).max() < DEPENDENT)
