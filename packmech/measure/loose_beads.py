"""Loose beads of packings with rigid links: those that their contacts and links leave free, found again and again.

A bead of a cluster may be held by its links alone, and one with many contacts may still turn about them. With all other
clusters at rest, a contact counts if it can push in some balance of its cluster, link forces of either sign included; a
bead is loose if it moves in a motion of its cluster that changes no link and none of these contacts. For single
particles this is the rule of `contacts.rattlers`: contact normals that positively span the space.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.links import image_offsets
from packmech.measure.link_tension import LinkGradients, distance_gradients, link_gradients
from packmech.packing import Packing

# singular values below this fraction of the largest are zero
_RANK = 1e-5
_SWEEPS = 12
# beads that random zero modes move by less than this part of their size are held
_STILL = 1e-6
# overlaps that balance to this part of their mean are forces of such a balance
_BALANCED = 1e-6
_PROGRAM_TOLERANCE = 1e-9
_METHODS = (("highs-ds", True), ("highs-ipm", True), ("highs-ds", False))


def loose_beads(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether contacts with particles that are not loose, and its links, leave it free.

    Links to loose beads still count: what they admit, and no more, is a motion.

    Parameters
    ----------
    packing
        The packing, with links.
    contacts
        Its contacts.

    """
    links = packing.links
    assert links is not None
    gradients = link_gradients(packing)
    independent = sp.csr_array(gradients.gradient_lx[np.flatnonzero(~gradients.dependent_l)])
    cluster = links.clusters(packing.particles)
    offset, _ = image_offsets(links, packing.particles)
    loose = np.zeros(packing.particles, dtype=bool)
    while not loose.all():
        left = contacts.select(~loose[contacts.i_c] & ~loose[contacts.j_c])
        rows, owner, overlap = _one_by_one(left, cluster, offset)
        pushed = _shown(rows, owner, overlap, gradients, cluster)
        doubtful = np.unique(cluster[_moving(rows[np.flatnonzero(pushed)], independent, packing.dimension) & ~loose])
        if not len(doubtful):
            break
        look = np.isin(owner, doubtful)
        pushed |= look
        pushed[look] = _pushing(rows[np.flatnonzero(look)], independent, np.isin(cluster, doubtful), packing.dimension)
        found = _moving(rows[np.flatnonzero(pushed)], independent, packing.dimension) & np.isin(cluster, doubtful)
        if not (found & ~loose).any():
            break
        loose |= found
    return loose


def _one_by_one(
    contacts: Contacts, cluster_n: NDArray[np.int64], offset_nd: NDArray[np.int64]
) -> tuple[sp.csr_array, NDArray[np.int64], NDArray[np.float64]]:
    """Return changes of contact distances as one cluster moves, all else at rest: rows, their clusters and overlaps.

    A contact between clusters, or of a cluster with its own image, has a row for either side.
    """
    inside = cluster_n[contacts.i_c] == cluster_n[contacts.j_c]
    inside &= (contacts.image_cd == offset_nd[contacts.j_c] - offset_nd[contacts.i_c]).all(axis=1)
    between = np.flatnonzero(~inside)
    within = np.flatnonzero(inside)
    d, size = contacts.dimension, contacts.particles * contacts.dimension
    end = np.concatenate([contacts.i_c[between], contacts.j_c[between]])
    normal = np.concatenate([-contacts.normal_cd[between], contacts.normal_cd[between]])
    column = end[:, None] * d + np.arange(d)
    halves = sp.csr_array((normal.ravel(), column.ravel(), np.arange(len(end) + 1) * d), shape=(len(end), size))
    rows = sp.csr_array(sp.vstack([halves, distance_gradients(contacts.select(within))], format="csr"))
    place = np.concatenate([between, between, within])
    owner = cluster_n[np.concatenate([end, contacts.i_c[within]])]
    return rows, owner, contacts.overlap_c[place] / contacts.contact_distance_c[place]


def _shown(
    rows: sp.csr_array,
    owner: NDArray[np.int64],
    force: NDArray[np.float64],
    links: LinkGradients,
    cluster_n: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return which rows push as the packing is: overlaps of clusters that rest in balance, if its law is harmonic."""
    push = np.maximum(force, 0.0)
    if not (push > 0.0).any():
        return np.zeros(len(owner), dtype=bool)
    net = rows.T @ push
    net = np.abs(net + links.gradient_lx.T @ links.multipliers(net)).reshape(len(cluster_n), -1).max(axis=1)
    worst = np.zeros(int(cluster_n.max()) + 1)
    np.maximum.at(worst, cluster_n, net)
    shown: NDArray[np.bool_] = (worst < _BALANCED * push[push > 0.0].mean())[owner] & (push > 10.0 * worst[owner])
    return shown


def _pushing(rows: sp.csr_array, links: sp.csr_array, here_n: NDArray[np.bool_], dimension: int) -> NDArray[np.bool_]:
    """Return which rows push in some balance of the clusters to which the particles `here_n` belong."""
    from scipy.optimize import linprog

    count = rows.shape[0]
    if not count:
        return np.zeros(0, dtype=bool)
    column = np.flatnonzero(np.repeat(here_n, dimension))
    own = sp.csr_array(links[:, column])
    own = sp.csr_array(own[np.flatnonzero(np.diff(own.indptr) > 0)])
    push = sp.csr_array(rows[:, column]).T
    free = own.shape[0]
    # s = p + q with p at most 1: the largest sum of p has p = 1 wherever any balance pushes
    program = {
        "c": np.concatenate([-np.ones(count), np.zeros(count + free)]),
        "A_eq": sp.csr_array(sp.hstack([push, push, own.T], format="csr")),
        "b_eq": np.zeros(len(column)),
        "bounds": np.array([[0.0, 1.0]] * count + [[0.0, np.inf]] * count + [[-np.inf, np.inf]] * free),
    }
    # simplex may lose the solution between its presolve and the end, or call a program unbounded whose sum is not
    tries = [(method, tight) for tight in (_PROGRAM_TOLERANCE, 1e-7) for method in _METHODS]
    for (method, presolve), limit in tries:
        precise = {"primal_feasibility_tolerance": limit, "dual_feasibility_tolerance": limit, "presolve": presolve}
        found = linprog(**program, method=method, options=precise)
        if found.status == 0:
            break
    else:
        raise np.linalg.LinAlgError(f"packing must have contacts whose balances can be found, got: {found.message}")
    pushing: NDArray[np.bool_] = found.x[:count] > 0.5
    return pushing


def _moving(rows: sp.csr_array, links: sp.csr_array, dimension: int) -> NDArray[np.bool_]:
    """Return which particles move in a generic motion that changes none of the rows and no link."""
    import scipy.sparse.linalg as spla

    every = sp.csr_array(sp.vstack([rows, links], format="csr"))
    square = sp.csc_matrix(every.T @ every)
    shift = _RANK**2 * float(abs(square).sum(axis=0).max())
    factor = spla.splu(
        sp.csc_matrix(square + shift * sp.eye_array(square.shape[0])),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True, "Equil": False},
    )
    # what inverse iteration leaves of random motions is their part without any extension
    motion = np.random.default_rng(0).normal(size=(square.shape[0], 2))
    for _ in range(_SWEEPS):
        motion = shift * factor.solve(motion)
    moves: NDArray[np.bool_] = np.abs(motion.reshape(-1, 2 * dimension)).max(axis=1) > _STILL
    return moves
