"""Pairs that are no contacts: linked ones at the link's image, and all within a rigid cluster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.links import Links, image_offsets
from packmech.packing import Packing

# singular values below this, relative to the largest, belong to a motion that the links admit
_RANK = 1e-9


def _jacobian(links: Links, vector_ld: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    i_l, j_l = links.i_l, links.j_l
    d = vector_ld.shape[1]
    normal = vector_ld / np.sqrt((vector_ld**2).sum(axis=1))[:, None]
    matrix = np.zeros((len(i_l), count, d))
    rows = np.arange(len(i_l))
    matrix[rows, j_l] += normal
    matrix[rows, i_l] -= normal
    return matrix.reshape(len(i_l), count * d)


def _rank(matrix: NDArray[np.float64]) -> int:
    value = np.linalg.svd(matrix, compute_uv=False)
    return int((value > _RANK * value[0]).sum()) if len(value) and value[0] > 0 else 0


def _is_rigid(place_nd: NDArray[np.float64], links: Links) -> bool:
    """Whether the links (numbered within the cluster) leave only translations and rotations of these places."""
    count, d = place_nd.shape
    centered = place_nd - place_nd.mean(axis=0)
    rotations = [np.outer(centered[:, a], np.eye(d)[b]) - np.outer(centered[:, b], np.eye(d)[a])
                 for a in range(d) for b in range(a)]  # fmt: skip
    trivial = d + _rank(np.array([turn.ravel() for turn in rotations]))
    if len(links) < count * d - trivial:
        return False
    vector = place_nd[links.j_l] - place_nd[links.i_l]
    return bool(count * d - _rank(_jacobian(links, vector, count)) == trivial)


def rigid_clusters(packing: Packing) -> NDArray[np.bool_]:
    """Return (N,) whether each particle's cluster is rigid: its links admit only translations and rotations.

    A cluster that winds around the box counts as flexible; so does a particle without links.
    """
    rigid = np.zeros(packing.particles, dtype=bool)
    links = packing.links
    if links is None:
        return rigid
    offset, winding = image_offsets(links, packing.particles)
    place = packing.position_nd + offset @ packing.box.lattice_dd.T
    cluster = links.clusters(packing.particles)
    order = np.argsort(cluster, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(cluster))])
    link_order = np.argsort(cluster[links.i_l], kind="stable")
    link_start = np.concatenate([[0], np.cumsum(np.bincount(cluster[links.i_l], minlength=len(start) - 1))])
    number = np.empty(packing.particles, dtype=np.int64)
    for c in range(len(start) - 1):
        member = order[start[c] : start[c + 1]]
        own = link_order[link_start[c] : link_start[c + 1]]
        if len(member) == 1 or winding[member[0]]:
            continue
        number[member] = np.arange(len(member))
        inside = Links(number[links.i_l[own]], number[links.j_l[own]], 0 * links.image_ld[own], links.length_l[own])
        rigid[member] = _is_rigid(place[member], inside)
    return rigid


class Excluded:
    """The pairs of a packing that count as no contacts; made once for a packing and its later positions."""

    def __init__(self, packing: Packing) -> None:
        links = packing.links
        assert links is not None
        self._links = links
        self._particles = packing.particles
        self._offset, _ = image_offsets(links, packing.particles)
        self._cluster = links.clusters(packing.particles)
        self._rigid = rigid_clusters(packing)
        self._code = links.i_l * packing.particles + links.j_l

    def mask(self, i_c: NDArray[np.int64], j_c: NDArray[np.int64], image_cd: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (C,) which of the pairs i <= j count as no contacts."""
        out = self._rigid[i_c] & (self._cluster[i_c] == self._cluster[j_c])
        out &= (image_cd == self._offset[j_c] - self._offset[i_c]).all(axis=1) & (i_c != j_c)
        code = i_c * self._particles + j_c
        first, last = np.searchsorted(self._code, code), np.searchsorted(self._code, code, side="right")
        for k in range(int((last - first).max(initial=0))):
            have = first + k < last
            link = np.where(have, first + k, 0)
            out |= have & (image_cd == self._links.image_ld[link]).all(axis=1)
        return np.asarray(out, dtype=bool)
