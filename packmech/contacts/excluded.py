"""Pairs that are no contacts: linked ones at the link's image, and all within a rigid cluster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import kernel
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


def _are_rigid(
    position_bnd: NDArray[np.float64], i_bl: NDArray[np.int64], j_bl: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return (B,) whether links (numbered within each cluster) leave a cluster only translations and rotations."""
    clusters, count, d = position_bnd.shape
    centered = position_bnd - position_bnd.mean(axis=1, keepdims=True)
    axes = np.eye(d)
    rotations = [
        centered[..., a, None] * axes[b] - centered[..., b, None] * axes[a] for a in range(d) for b in range(a)
    ]
    trivial = d + _ranks(np.stack(rotations, axis=1).reshape(clusters, len(rotations), count * d))
    own, link = np.arange(clusters)[:, None], np.arange(i_bl.shape[1])
    vector = position_bnd[own, j_bl] - position_bnd[own, i_bl]
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
    links, d, cluster, winding = packing.links, packing.dimension, packing.cluster_n, packing.winding_n
    if not len(links):
        return rigid
    unwrapped_nd = packing.position_nd + packing.unwrapping_nd @ packing.box.lattice_dd.T
    size, bonds = np.bincount(cluster), np.bincount(cluster[links.i_l], minlength=int(cluster.max()) + 1)
    order, link_order = np.argsort(cluster, kind="stable"), np.argsort(cluster[links.i_l], kind="stable")
    start, link_start = np.cumsum(size) - size, np.cumsum(bonds) - bonds
    number = np.empty(packing.particles, dtype=np.int64)
    number[order] = np.arange(packing.particles) - start[cluster[order]]
    # fewer links than this never suffice, nor do links around the box
    candidate = (size > 1) & (bonds >= size * d - d * (d + 1) // 2)
    candidate[cluster[winding]] = False
    if not candidate.any():
        return rigid
    # two beads and a link: nothing but translations and rotations is left
    rigid[candidate[cluster] & (size[cluster] == 2)] = True
    candidate &= size > 2
    for beads, links_each in np.unique(np.stack([size[candidate], bonds[candidate]], axis=1), axis=0).tolist():
        alike = np.flatnonzero(candidate & (size == beads) & (bonds == links_each))
        at_once = max(1, _ENTRIES // (beads * d * max(links_each, 1)))
        for first in range(0, len(alike), at_once):
            some = alike[first : first + at_once, None]
            member = order[start[some] + np.arange(beads)]
            own = link_order[link_start[some] + np.arange(links_each)]
            found = _are_rigid(unwrapped_nd[member], number[links.i_l[own]], number[links.j_l[own]])
            rigid[member] = found[:, None]
    return rigid


@kernel
def _mask(i_c, j_c, image_cd, rigid_n, cluster_n, offset_nd, code_l, image_ld):  # type: ignore[no-untyped-def]
    """Return which pairs stand within a rigid cluster, or at a link's image; `code_l` rises."""
    count, d = image_cd.shape
    particles = rigid_n.shape[0]
    out = np.zeros(count, np.bool_)
    for c in range(count):
        i, j = i_c[c], j_c[c]
        if cluster_n[i] != cluster_n[j]:
            continue
        if rigid_n[i] and i != j:
            same = True
            for a in range(d):
                same = same and image_cd[c, a] == offset_nd[j, a] - offset_nd[i, a]
            if same:
                out[c] = True
                continue
        code = i * particles + j
        low, high = 0, code_l.shape[0]
        while low < high:
            middle = (low + high) // 2
            if code_l[middle] < code:
                low = middle + 1
            else:
                high = middle
        while low < code_l.shape[0] and code_l[low] == code and not out[c]:
            same = True
            for a in range(d):
                same = same and image_cd[c, a] == image_ld[low, a]
            out[c] = same
            low += 1
    return out


class Excluded:
    """The pairs of a packing that count as no contacts; made once for a packing and its later positions."""

    def __init__(self, packing: Packing) -> None:
        self._links = links = packing.links
        self._offset, self._cluster = packing.unwrapping_nd, packing.cluster_n
        self._rigid = rigid_clusters(packing)
        self._code = links.i_l * packing.particles + links.j_l

    def mask(self, i_c: NDArray[np.int64], j_c: NDArray[np.int64], image_cd: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (C,) which of the pairs i <= j count as no contacts."""
        if not self._links:
            return np.zeros(len(i_c), dtype=bool)
        out: NDArray[np.bool_] = _mask(
            i_c, j_c, image_cd, self._rigid, self._cluster, self._offset, self._code, self._links.image_ld
        )
        return out
