"""Forces that rigid links carry: the multipliers that leave as little force on the particles as links can."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.compiled import kernel, single_thread
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.network import pair_contacts
from packmech.effects import contact_terms
from packmech.measure.link_band import band_solver
from packmech.packing import Packing
from packmech.scene import Scene

if TYPE_CHECKING:
    import scipy.sparse as sp

# a link whose gradient lies, to this sine, in the span of others of its cluster depends on them
DEPENDENT = 1e-8
# pivots (squares of that sine) below this are looked at again without squaring: where the dependence is small on its
# last link, that link's pivot keeps little of it
_SMALL_PIVOT = 1e-5
_NUDGE = 1e-14
_REFINEMENTS = 3


def distance_gradients(pairs: Contacts) -> sp.csr_array:
    """Return the (C, N d) derivatives of the pairs' distances with respect to the positions, -n at i and +n at j."""
    import scipy.sparse as sp

    parts = _gradient_rows(pairs.i_c, pairs.j_c, pairs.normal_cd)
    matrix = sp.csr_array(parts, shape=(len(pairs), pairs.particles * pairs.dimension))
    matrix.has_canonical_format = True
    return matrix


@kernel
def _gradient_rows(i_c, j_c, normal_cd):  # type: ignore[no-untyped-def]
    """Return data, columns and row starts of the pairs' gradients, without zeros; i <= j."""
    count, d = normal_cd.shape
    data, column = np.empty(2 * d * count), np.empty(2 * d * count, np.int32)
    start = np.empty(count + 1, np.int32)
    at = 0
    for c in range(count):
        start[c] = at
        # a particle keeps its distance to its own image when it moves
        if i_c[c] == j_c[c]:
            continue
        for end in range(2):
            for a in range(d):
                value = -normal_cd[c, a] if end == 0 else normal_cd[c, a]
                if value != 0.0:
                    data[at] = value
                    column[at] = (i_c[c] if end == 0 else j_c[c]) * d + a
                    at += 1
    start[count] = at
    return data[:at], column[:at], start


@kernel
def _along(i_c, j_c, normal_cd, x):  # type: ignore[no-untyped-def]
    """Return the changes of the pairs' distances with displacements x (N d)."""
    count, d = normal_cd.shape
    out = np.zeros(count)
    for c in range(count):
        for a in range(d):
            out[c] += normal_cd[c, a] * (x[j_c[c] * d + a] - x[i_c[c] * d + a])
    return out


@kernel
def _pulled(i_c, j_c, normal_cd, pull_c, x):  # type: ignore[no-untyped-def]
    """Return x (N d) with pull times the gradient of each pair's distance added."""
    count, d = normal_cd.shape
    out = x.copy()
    for c in range(count):
        for a in range(d):
            part = normal_cd[c, a] * pull_c[c]
            out[j_c[c] * d + a] += part
            out[i_c[c] * d + a] -= part
    return out


@kernel
def _gradient_products(i_l, j_l, normal_ld, particles, nudge):  # type: ignore[no-untyped-def]
    """Return data, rows and column starts of the products of the links' gradients, `nudge` on the diagonal added."""
    count, d = normal_ld.shape
    first = np.zeros(particles + 2, np.int64)
    for c in range(count):
        if i_l[c] != j_l[c]:
            first[i_l[c] + 2] += 1
            first[j_l[c] + 2] += 1
    for n in range(particles):
        first[n + 2] += first[n + 1]
    entry = np.empty(first[particles + 1], np.int64)
    for c in range(count):
        if i_l[c] != j_l[c]:
            for n in (i_l[c], j_l[c]):
                entry[first[n + 1]] = c
                first[n + 1] += 1
    most = count
    for n in range(particles):
        most += (first[n + 1] - first[n]) ** 2
    data, row = np.empty(most), np.empty(most, np.int32)
    start = np.empty(count + 1, np.int32)
    place = np.full(count, -1, np.int64)
    at = 0
    for c in range(count):
        start[c] = at
        place[c] = at
        row[at] = c
        data[at] = nudge
        at += 1
        if i_l[c] != j_l[c]:
            for n in (i_l[c], j_l[c]):
                for h in range(first[n], first[n + 1]):
                    other = entry[h]
                    # both point away from the particle that they share, or both towards it, or not
                    product = 0.0
                    for a in range(d):
                        product += normal_ld[c, a] * normal_ld[other, a]
                    if (i_l[c] == n) != (i_l[other] == n):
                        product = -product
                    if place[other] < start[c]:
                        place[other] = at
                        row[at] = other
                        data[at] = 0.0
                        at += 1
                    data[place[other]] += product
    start[count] = at
    return data[:at], row[:at], start


def link_pairs(packing: Packing) -> Contacts:
    """Return the geometry of a packing's links, in their order; none for a packing without links."""
    links = packing.links
    if links is None:
        none = np.zeros(0, dtype=np.int64)
        return pair_contacts(packing, none, none, np.zeros((0, packing.dimension), dtype=np.int64))
    return pair_contacts(packing, links.i_l, links.j_l, links.image_ld)


@dataclass(frozen=True, eq=False)
class LinkGradients:
    """The links of a packing and how their lengths change with the positions.

    Attributes
    ----------
    pairs
        Normals and distances of the links.
    cluster_l
        (L,) cluster of each link.
    dependent_l
        (L,) which links say nothing that others do not: the gradient lies in the span of others.

    """

    pairs: Contacts
    cluster_l: NDArray[np.int64]
    dependent_l: NDArray[np.bool_]
    _solve: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    _doubtful: tuple[NDArray[np.int64], ...]

    @functools.cached_property
    def gradient_lx(self) -> sp.csr_array:
        """The (L, N d) derivatives of the lengths."""
        return distance_gradients(self.pairs)

    def multipliers(self, push_x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (L,) multipliers m that make |push + gradient^T m| least, of smallest size where links depend."""
        found: NDArray[np.float64] = np.zeros(len(self.pairs))
        pairs = self.pairs.i_c, self.pairs.j_c, self.pairs.normal_cd
        push = np.ascontiguousarray(push_x, dtype=np.float64)
        for k in range(_REFINEMENTS):
            rest = _pulled(*pairs, found, push) if k else push
            found = found - self._solve(_along(*pairs, rest))
        for own in self._doubtful:
            block, column = cluster_block(self.gradient_lx, own)
            found[own] = np.linalg.lstsq(block.T, -push_x[column], rcond=DEPENDENT)[0]
        return found


def cluster_block(gradient_lx: sp.csr_array, own: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the dense rows of a cluster's links on the coordinates that they touch, and these coordinates."""
    part = gradient_lx[own]
    column = np.unique(part.indices)
    return part[:, column].toarray(), column.astype(np.int64)


def _dependent(block: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows to leave out so that the others are independent and span the same."""
    import scipy.linalg

    out = np.ones(len(block), dtype=bool)
    if block.size:
        _, right, order = scipy.linalg.qr(block.T, mode="economic", pivoting=True)
        size = np.abs(np.diag(right))
        out[order[: int(np.count_nonzero(size > DEPENDENT * np.sqrt(2.0)))]] = False
    return out


def link_gradients(packing: Packing) -> LinkGradients:
    """Return the gradients of a packing's links, factored cluster by cluster."""
    pairs = link_pairs(packing)
    links = packing.links
    count = len(pairs)
    dependent = np.zeros(count, dtype=bool)
    if links is None:
        return LinkGradients(pairs, np.zeros(0, np.int64), dependent, lambda right: right, ())
    cluster = links.clusters(packing.particles)[links.i_l]
    solve = band_solver(pairs, _NUDGE, _SMALL_PIVOT)
    if solve is not None:
        return LinkGradients(pairs, cluster, dependent, solve, ())
    import scipy.sparse as sp
    import scipy.sparse.linalg as spla

    # links share a particle or nothing: their products are sparse, and block diagonal by cluster
    parts = _gradient_products(pairs.i_c, pairs.j_c, pairs.normal_cd, packing.particles, _NUDGE)
    product = sp.csc_matrix(parts, shape=(count, count))
    factor = spla.splu(
        product, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
    )
    small = np.abs(factor.U.diagonal())[factor.perm_c] < _SMALL_PIVOT
    doubtful: list[NDArray[np.int64]] = []
    if not small.any():
        return LinkGradients(pairs, cluster, dependent, factor.solve, ())
    gradient = distance_gradients(pairs)
    for c in np.unique(cluster[small]):
        own = np.flatnonzero(cluster == c)
        dependent[own] = _dependent(cluster_block(gradient, own)[0])
        doubtful.append(own)
    return LinkGradients(pairs, cluster, dependent, factor.solve, tuple(doubtful))


def link_tension(scene: Scene) -> NDArray[np.float64]:
    """Return the (L,) forces in the rigid links [force], tension positive, in the order of `packing.links`.

    They are the multipliers t that make |grad U + sum of t grad(length)| least over the positions; for a packing at
    rest the sum vanishes and they are exact. Where links depend on each other (more links than a shape needs) the
    smallest such set is given.

    Parameters
    ----------
    scene
        The scene; without links the answer is empty.

    Raises
    ------
    TypeError
        If it is no scene.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0, 1], [1, 2], [[0, 0], [1, 0]], [1.0, 1.0])
    >>> chain = pm.Packing([[0.0, 0.0], [1.0, 0.0], [-0.9, 0.0]], [0.5] * 3, pm.Box.cubic(2.9, 2), links)
    >>> pm.link_tension(pm.Scene(chain, (pm.Repulsion(),))).round(12).tolist()
    [-0.1, -0.1]

    """
    instance("scene", scene, Scene)
    if scene.packing.links is None:
        return np.zeros(0)
    contacts = find_contacts(scene.packing)
    first = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c).first_c
    with single_thread():
        return tension_of(link_gradients(scene.packing), contacts, first)


def tension_of(gradients: LinkGradients, contacts: Contacts, first_c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (L,) forces in the links that balance contacts with radial derivatives first_c."""
    none = np.zeros(contacts.particles * contacts.dimension)
    return gradients.multipliers(_pulled(contacts.i_c, contacts.j_c, contacts.normal_cd, first_c, none))
