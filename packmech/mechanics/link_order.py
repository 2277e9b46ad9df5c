"""The order in which links are eliminated, so that factors stay narrow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.links import Links


def elimination_order(links: Links, particles: int) -> NDArray[np.int64]:
    """Return an order of the links that goes through one cluster after another, along each.

    Examples
    --------
    >>> chain = Links([0, 0, 1], [2, 3, 3], [[0, 0]] * 3, [1.0] * 3)
    >>> [(int(chain.i_l[k]), int(chain.j_l[k])) for k in elimination_order(chain, 4)]
    [(0, 2), (0, 3), (1, 3)]

    """
    import scipy.sparse as sp
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    ones = np.ones(2 * len(links))
    ends = np.concatenate([links.i_l, links.j_l]), np.concatenate([links.j_l, links.i_l])
    graph = sp.csr_array((ones, ends), shape=(particles, particles))
    rank = np.empty(particles, dtype=np.int64)
    rank[reverse_cuthill_mckee(sp.csr_matrix(graph), symmetric_mode=True)] = np.arange(particles)
    low = np.minimum(rank[links.i_l], rank[links.j_l])
    high = np.maximum(rank[links.i_l], rank[links.j_l])
    order: NDArray[np.int64] = np.lexsort((low, high, links.clusters(particles)[links.i_l]))
    return order
