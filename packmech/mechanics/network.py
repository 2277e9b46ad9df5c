"""The contacts that carry a packing: its network with the rattlers taken out."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.rattlers import rattlers_of, rattling_bodies
from packmech.jit.compiled import kernel
from packmech.links import image_offsets
from packmech.packing import Packing

RATTLERS = ("remove", "keep")


class Network(NamedTuple):
    """Contacts and links among the particles that are kept, numbered anew, and the numbers that these had before."""

    contacts: Contacts
    index_n: NDArray[np.int64]
    links: ConstraintFactor | None = None


@kernel
def _between(i_c, j_c, image_cd, normal_cd, cluster_n, offset_nd):  # type: ignore[no-untyped-def]
    """Return clusters and normals of the contacts between them, the smaller number first."""
    count, d = image_cd.shape
    i, j, normal = np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, d))
    used = 0
    for c in range(count):
        one, other = i_c[c], j_c[c]
        # a cluster's contact with its own image holds it, one within it does not
        apart = cluster_n[one] != cluster_n[other]
        for a in range(d):
            apart = apart or image_cd[c, a] != offset_nd[other, a] - offset_nd[one, a]
        if apart:
            flip = cluster_n[one] > cluster_n[other]
            i[used] = cluster_n[other] if flip else cluster_n[one]
            j[used] = cluster_n[one] if flip else cluster_n[other]
            for a in range(d):
                normal[used, a] = -normal_cd[c, a] if flip else normal_cd[c, a]
            used += 1
    return i[:used], j[:used], normal[:used]


def _by_cluster(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return (N,) who belongs to a cluster that its contacts with others do not even keep from moving as a whole."""
    assert packing.links is not None
    cluster = packing.links.clusters(packing.particles)
    offset, winding = image_offsets(packing.links, packing.particles)
    i, j, normal = _between(contacts.i_c, contacts.j_c, contacts.image_cd, contacts.normal_cd, cluster, offset)
    # a cluster that closes around the box resists its strain, touched or not
    loose: NDArray[np.bool_] = rattling_bodies(i, j, normal, int(cluster.max()) + 1)[cluster] & ~winding
    return loose


def held_network(packing: Packing, *, gap_tolerance: float, rattlers: str = "remove") -> Network:
    """Return the contacts within the gap tolerance, without those of rattlers unless these are to be kept.

    Linked particles go together: a cluster is taken out if it can be moved as a whole. One that can only turn stays,
    and so do its loose ends: they are zero modes that carry no strain.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    rattlers
        "remove" or "keep".

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.1, 0.0], [1.5, 1.5]], [0.5, 0.2], pm.Box([[1.0, 0.5], [0.0, 3.0]]))
    >>> held_network(packing, gap_tolerance=1e-9, rattlers="keep").index_n.tolist()
    [0, 1]
    >>> held_network(packing, gap_tolerance=1e-9).index_n.tolist()
    []

    """
    one_of("rattlers", rattlers, RATTLERS)
    contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    if rattlers == "keep":
        links = None if packing.links is None else ConstraintFactor(packing)
        return Network(contacts, np.arange(packing.particles), links)
    held = ~rattlers_of(contacts) if packing.links is None else ~_by_cluster(packing, contacts)
    if held.all():
        links = None if packing.links is None else ConstraintFactor(packing)
        return Network(contacts, np.arange(packing.particles), links)
    number = np.cumsum(held) - 1
    kept = contacts.select(held[contacts.i_c] & held[contacts.j_c])
    renumbered = dataclasses.replace(
        kept, i_c=number[kept.i_c], j_c=number[kept.j_c], particles=int(np.count_nonzero(held))
    )
    if packing.links is None:
        return Network(renumbered, np.flatnonzero(held))
    if not held.any():
        return Network(renumbered, np.flatnonzero(held), None)
    left = packing.replace(
        position_nd=packing.position_nd[held],
        radius_n=packing.radius_n[held],
        links=packing.links.numbered(np.where(held, number, -1)),
    )
    return Network(renumbered, np.flatnonzero(held), None if left.links is None else ConstraintFactor(left))
