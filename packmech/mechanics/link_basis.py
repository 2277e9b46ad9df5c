"""The motions that rigid links admit, as a dense basis: the reference for all that is done sparsely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.measure.link_tension import LinkGradients, cluster_block
from packmech.mechanics.link_rows import admitted_strains, independent_rows, stiff_strains

# largest dense matrix that is made unless more is asked for [bytes]
MEMORY_LIMIT = 1e9


def check_memory(rows: int, columns: int, memory_limit: float) -> None:
    """Check that a dense matrix of this size fits the limit.

    Raises
    ------
    ValueError
        Naming the size.

    """
    need = 8.0 * rows * columns
    if need > memory_limit:
        raise ValueError(
            f"memory_limit must be at least {need:.3g} bytes for a dense matrix of {rows} by {columns}, "
            f"got {memory_limit:g}"
        )


def motion_basis(
    links: LinkGradients,
    strain_ek: NDArray[np.float64] | None,
    *,
    mass_n: NDArray[np.float64],
    strain_scale: float,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the motions (x, e) that the links admit to first order, as columns of an (N d + s, N_dof) matrix.

    Positions come first, cluster by cluster, then at most s motions with strain: of all that make that strain those
    with the least motion of the particles, made orthonormal (section 4 of the corrected specification). Columns are
    orthonormal in sum of mass x.x + strain_scale^2 e.e.

    Parameters
    ----------
    links
        The links.
    strain_ek
        (s, k) admitted strains as columns; None for a fixed box, whose motions have no strain rows.
    mass_n
        (N,) masses.
    strain_scale
        Length that a unit strain counts as.
    memory_limit
        Largest memory of the matrix [bytes].

    """
    dimension = links.pairs.dimension
    gradient, stretch = independent_rows(links)
    root = np.repeat(np.sqrt(mass_n), dimension)
    size = len(root)
    weighted = gradient.multiply(1.0 / root[None, :]).tocsr()
    strains = None if strain_ek is None else admitted_strains(strain_ek, stiff_strains(links, dimension))
    extra = 0 if strains is None else strains.shape[1]
    rows = size + (0 if strain_ek is None else len(strain_ek))
    count = size - weighted.shape[0] + extra
    check_memory(rows, count, memory_limit)
    basis = np.zeros((rows, count))
    response = np.zeros((size, extra))
    pull = np.zeros((weighted.shape[0], 0)) if strains is None else stretch @ strains / strain_scale
    cluster = links.cluster_l[~links.dependent_l]
    order = np.argsort(cluster, kind="stable")
    start = np.flatnonzero(np.concatenate([[True], np.diff(cluster[order]) != 0, [True]])) if len(order) else [0]
    at = 0
    single = np.ones(size, dtype=bool)
    for begin, end in zip(start[:-1], start[1:], strict=True):
        own = order[begin:end]
        block, column = cluster_block(weighted, own)
        single[column] = False
        full, right = np.linalg.qr(block.T, mode="complete")
        free = full[:, len(own) :]
        basis[column, at : at + free.shape[1]] = free
        at += free.shape[1]
        if extra:
            response[column] = -full[:, : len(own)] @ np.linalg.solve(right[: len(own)].T, pull[own])
    alone = np.flatnonzero(single)
    basis[alone, at : at + len(alone)] = np.eye(len(alone))
    if strains is not None:
        basis[:, count - extra :] = np.linalg.qr(np.concatenate([response, strains]))[0]
        basis[size:] /= strain_scale
    basis[:size] /= root[:, None]
    return basis
