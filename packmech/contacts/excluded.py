"""Pairs that are no contacts: linked ones at the link's image, and all within a rigid cluster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.links import image_offsets
from packmech.packing import Packing

# singular values below this, relative to the largest, belong to a motion that the links admit
_RANK = 1e-9
# entries of the matrices that are decomposed at once
_ENTRIES = 1_000_000


def _ranks(matrix_bij: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (B,) ranks of a stack of matrices."""
    value = np.linalg.svd(matrix_bij, compute_uv=False)
    ranks: NDArray[np.int64] = ((value > _RANK * value[:, :1]) & (value > 0.0)).sum(axis=1)
    return ranks


def _are_rigid(place_bnd: NDArray[np.float64], i_bl: NDArray[np.int64], j_bl: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (B,) whether links (numbered within each cluster) leave only translations and rotations of the places."""
    clusters, count, d = place_bnd.shape
    centered = place_bnd - place_bnd.mean(axis=1, keepdims=True)
    axes = np.eye(d)
    turns = [centered[..., a, None] * axes[b] - centered[..., b, None] * axes[a] for a in range(d) for b in range(a)]
    trivial = d + _ranks(np.stack(turns, axis=1).reshape(clusters, len(turns), count * d))
    own, link = np.arange(clusters)[:, None], np.arange(i_bl.shape[1])
    vector = place_bnd[own, j_bl] - place_bnd[own, i_bl]
    normal = vector / np.sqrt((vector**2).sum(axis=2))[..., None]
    jacobian = np.zeros((clusters, i_bl.shape[1], count, d))
    jacobian[own, link, j_bl] += normal
    jacobian[own, link, i_bl] -= normal
    rank = _ranks(jacobian.reshape(clusters, i_bl.shape[1], count * d))
    return np.asarray(count * d - rank == trivial)


def rigid_clusters(packing: Packing) -> NDArray[np.bool_]:
    """Return (N,) whether each particle's cluster is rigid: its links admit only translations and rotations.

    A cluster that winds around the box counts as flexible; so does a particle without links.
    """
    rigid = np.zeros(packing.particles, dtype=bool)
    links = packing.links
    if links is None:
        return rigid
    d = packing.dimension
    offset, winding = image_offsets(links, packing.particles)
    place = packing.position_nd + offset @ packing.box.lattice_dd.T
    cluster = links.clusters(packing.particles)
    size, bonds = np.bincount(cluster), np.bincount(cluster[links.i_l], minlength=int(cluster.max()) + 1)
    order, link_order = np.argsort(cluster, kind="stable"), np.argsort(cluster[links.i_l], kind="stable")
    start, link_start = np.cumsum(size) - size, np.cumsum(bonds) - bonds
    number = np.empty(packing.particles, dtype=np.int64)
    number[order] = np.arange(packing.particles) - start[cluster[order]]
    # fewer links than this never suffice, nor do links around the box
    look = (size > 1) & (bonds >= size * d - d * (d + 1) // 2)
    look[cluster[winding]] = False
    for beads, links_each in np.unique(np.stack([size[look], bonds[look]], axis=1), axis=0).tolist():
        alike = np.flatnonzero(look & (size == beads) & (bonds == links_each))
        at_once = max(1, _ENTRIES // (beads * d * max(links_each, 1)))
        for first in range(0, len(alike), at_once):
            some = alike[first : first + at_once, None]
            member = order[start[some] + np.arange(beads)]
            own = link_order[link_start[some] + np.arange(links_each)]
            found = _are_rigid(place[member], number[links.i_l[own]], number[links.j_l[own]])
            rigid[member] = found[:, None]
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
