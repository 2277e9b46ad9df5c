"""Links in second derivatives and linear systems: their curvature as bonds, and the strains that they admit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.compiled import kernel
from packmech.contacts import Contacts
from packmech.effects import ContactTerms
from packmech.measure.link_tension import LinkGradients, cluster_block, tension_of
from packmech.mechanics.strain import normal_strains

# strains (of order 1) that links which depend on each other resist by more than this cannot be made
STIFF = 1e-7


class Prestressed(NamedTuple):
    """Pairs with radial derivatives of their energies: contacts, and links as bonds with a force and no stiffness."""

    pairs: Contacts
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]


def prestressed(
    contacts: Contacts,
    terms: ContactTerms,
    kind: str,
    links: LinkGradients | None,
    tension_l: NDArray[np.float64] | None = None,
) -> Prestressed:
    """Return the pairs whose second derivatives make up the Hessian of the named kind.

    "exact" adds each link as a bond with u' = its tension (found here unless given) and u'' = 0; "paper" and
    "unstressed" have contacts only.
    """
    first = np.zeros_like(terms.first_c) if kind == "unstressed" else terms.first_c
    if links is None or kind != "exact":
        return Prestressed(contacts, first, terms.second_c)
    tension = tension_of(links, contacts, terms.first_c) if tension_l is None else tension_l
    pairs, order = joined(contacts, links.pairs)
    first = np.concatenate([first, tension])[order]
    return Prestressed(pairs, first, np.concatenate([terms.second_c, np.zeros(len(tension))])[order])


@kernel
def _merged(i_c, j_c, image_cd, count):  # type: ignore[no-untyped-def]
    """Return the order that merges the first `count` pairs and the others, each sorted by (i, j, image) already."""
    order = np.empty(i_c.shape[0], np.int64)
    a, b = 0, count
    for k in range(i_c.shape[0]):
        first = a < count
        if first and b < i_c.shape[0]:
            step = i_c[a] - i_c[b]
            if step == 0:
                step = j_c[a] - j_c[b]
            for m in range(image_cd.shape[1]):
                if step == 0:
                    step = image_cd[a, m] - image_cd[b, m]
            first = step <= 0
        if first:
            order[k] = a
            a += 1
        else:
            order[k] = b
            b += 1
    return order


@kernel
def _picked(order, i_c, j_c, image_cd, normal_cd, distance_c, touching_c):  # type: ignore[no-untyped-def]
    """Return the arrays in this order."""
    count, d = image_cd.shape
    i, j, image = np.empty_like(i_c), np.empty_like(j_c), np.empty((count, d), np.int64)
    normal, distance, touching = np.empty((count, d)), np.empty(count), np.empty(count)
    for k in range(count):
        c = order[k]
        i[k], j[k], distance[k], touching[k] = i_c[c], j_c[c], distance_c[c], touching_c[c]
        for a in range(d):
            image[k, a], normal[k, a] = image_cd[c, a], normal_cd[c, a]
    return i, j, image, normal, distance, touching


def joined(one: Contacts, other: Contacts) -> tuple[Contacts, NDArray[np.int64]]:
    """Return the pairs of both, sorted by (i, j, image), and where each of them came from."""
    i, j = np.concatenate([one.i_c, other.i_c]), np.concatenate([one.j_c, other.j_c])
    image = np.concatenate([one.image_cd, other.image_cd])
    order = _merged(i, j, image, len(one))
    normal = np.concatenate([one.normal_cd, other.normal_cd])
    distance = np.concatenate([one.distance_c, other.distance_c])
    touching = np.concatenate([one.contact_distance_c, other.contact_distance_c])
    i, j, image, normal, distance, touching = _picked(order, i, j, image, normal, distance, touching)
    return Contacts(i, j, image, normal, distance, touching, one.particles, one.dimension), order


def link_strains(links: LinkGradients) -> NDArray[np.float64]:
    """Return the (L, s) derivatives rho n.E.n of the links' lengths with respect to the Mandel strains [length]."""
    return links.pairs.distance_c[:, None] * normal_strains(links.pairs.normal_cd)


def independent_rows(links: LinkGradients) -> tuple[sp.csr_array, NDArray[np.float64]]:
    """Return the gradients and strain derivatives of the links that do not depend on others."""
    keep = np.flatnonzero(~links.dependent_l)
    return sp.csr_array(links.gradient_lx[keep]), link_strains(links)[keep]


def stiff_strains(links: LinkGradients | None, dimension: int) -> NDArray[np.float64]:
    """Return (k, s) orthonormal strains that the links forbid, whatever the particles do.

    A dependent link follows the others under every motion of the particles. Where it does not follow them under a
    strain too, that strain is impossible: links that close around the box. Links that depend on each other within one
    place follow every strain, since the cluster can strain as a whole.
    """
    components = dimension * (dimension + 1) // 2
    if links is None or not links.dependent_l.any():
        return np.zeros((0, components))
    strain = link_strains(links)
    found = []
    for c in np.unique(links.cluster_l[links.dependent_l]):
        own = np.flatnonzero(links.cluster_l == c)
        free, bound = own[~links.dependent_l[own]], own[links.dependent_l[own]]
        block, column = cluster_block(links.gradient_lx, own)
        rows = {int(link): block[k] for k, link in enumerate(own)}
        ahead = np.array([rows[int(link)] for link in free]).reshape(len(free), len(column))
        behind = np.array([rows[int(link)] for link in bound]).reshape(len(bound), len(column))
        share = np.linalg.lstsq(ahead.T, behind.T, rcond=None)[0] if len(free) else np.zeros((0, len(bound)))
        excess = strain[bound] - share.T @ strain[free]
        scale = links.pairs.distance_c[own].sum() * (1.0 + np.abs(share).max(initial=0.0))
        found.append(excess / scale)
    _, size, direction = np.linalg.svd(np.concatenate(found), full_matrices=False)
    stiff: NDArray[np.float64] = direction[size > STIFF]
    return stiff


def admitted_strains(directions_ek: NDArray[np.float64], stiff_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an orthonormal basis, as columns, of those of the given strains that are across all stiff ones."""
    if not len(stiff_ke):
        return directions_ek
    _, size, right = np.linalg.svd(stiff_ke @ directions_ek, full_matrices=True)
    admitted: NDArray[np.float64] = directions_ek @ right[int(np.count_nonzero(size > 1e-8)) :].T
    return admitted
