"""Counts: packing fraction, coordination number, and rattlers."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import instance, one_of
from packmech.constraints.factor import DEPENDENT, ConstraintFactor
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.elements import distance_rows
from packmech.contacts.fused_volume import shared_volume
from packmech.contacts.network import pair_contacts
from packmech.contacts.rattlers import check_given, rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.contacts.shape_rattlers import shape_rattlers
from packmech.honors import honors
from packmech.jit.blas import single_thread
from packmech.links import Links, image_offsets
from packmech.packing import Packing, no_own_images, no_tangential

# singular values below this fraction of the largest are zero
_RANK = 1e-5
_SWEEPS = 12
# particles that random zero modes move by less than this part of their size are held
_STILL = 1e-6
# overlaps that balance to this part of their mean are forces of such a balance
_BALANCED = 1e-6
_PROGRAM_TOLERANCE = 1e-9
_METHODS = (("highs-ds", True), ("highs-ipm", True), ("highs-ds", False))


def rattling_by_links(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether contacts with particles that do not rattle, and its links, leave it free.

    Links to rattlers still count: what they admit, and no more, is a motion.

    Parameters
    ----------
    packing
        The packing, with links.
    contacts
        Its contacts.

    """
    links = packing.links
    assert links is not None
    gradients = ConstraintFactor(packing)
    independent = sp.csr_array(gradients.gradient_lx[np.flatnonzero(~gradients.dependent_l)])
    cluster = links.clusters(packing.particles)
    offset, _ = image_offsets(links, packing.particles)
    rattling = np.zeros(packing.particles, dtype=bool)
    while not rattling.all():
        left = contacts.select(~rattling[contacts.i_c] & ~rattling[contacts.j_c])
        rows, owner, overlap = _one_by_one(left, cluster, offset)
        pushed = _shown(rows, owner, overlap, gradients, cluster)
        unsure = np.unique(cluster[_moving(rows[np.flatnonzero(pushed)], independent, packing.dimension) & ~rattling])
        if not len(unsure):
            break
        look = np.isin(owner, unsure)
        pushed |= look
        pushed[look] = _pushing(rows[np.flatnonzero(look)], independent, np.isin(cluster, unsure), packing.dimension)
        found = _moving(rows[np.flatnonzero(pushed)], independent, packing.dimension) & np.isin(cluster, unsure)
        if not (found & ~rattling).any():
            break
        rattling |= found
    return rattling


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
    rows = sp.csr_array(sp.vstack([halves, distance_rows(contacts.select(within))], format="csr"))
    place = np.concatenate([between, between, within])
    owner = cluster_n[np.concatenate([end, contacts.i_c[within]])]
    return rows, owner, contacts.overlap_c[place] / contacts.contact_distance_c[place]


def _shown(
    rows: sp.csr_array,
    owner: NDArray[np.int64],
    force: NDArray[np.float64],
    links: ConstraintFactor,
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


def rattling_particles(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether the contacts, and links if there are any, leave it free."""
    if packing.links is None:
        return rattlers_of(contacts)

    with single_thread():
        return rattling_by_links(packing, contacts)


def _given_shape_contacts(packing: Packing, contacts: Any, gap_tolerance: float | None) -> ShapeContacts:
    """Return the contacts of a packing with shapes, those that were given or else those within the tolerance."""
    if contacts is None:
        return find_shape_contacts(packing, gap_tolerance=gap_tolerance)
    if not isinstance(contacts, ShapeContacts) or contacts.particles != packing.particles:
        raise TypeError(f"contacts must be those of the packing (pm.find_shape_contacts), got {contacts!r:.60}")
    return contacts


@honors("links shapes", packing_only=True)
def find_rattlers(
    packing: Packing, *, gap_tolerance: float | None = None, contacts: Contacts | ShapeContacts | None = None
) -> NDArray[np.bool_]:
    """Return, for each particle, whether it rattles: its contacts with particles that do not rattle fail to hold it.

    A particle is held when its contact normals positively span the space. Particles in contact with none are rattlers.
    With rigid links it is held if no motion that its cluster's links admit moves it while its contacts stay closed:
    a particle without contacts may be held by its links, and the end of a chain rattles while the rest is held.

    Ellipses and spheroids are held by at least d + 1 contacts that can balance force and torque on them; three whose
    normals meet in one point hold an ellipse.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`. It is not that of `classify_jamming`, which
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
    no_tangential("packing", packing)
    no_own_images("packing", packing)
    if packing.shapes is not None:
        return shape_rattlers(packing, _given_shape_contacts(packing, contacts, gap_tolerance))
    if isinstance(contacts, ShapeContacts):
        raise TypeError("contacts must be Contacts for a packing of discs or spheres, got ShapeContacts")
    if contacts is None:
        contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    else:
        check_given(packing, contacts)
    return rattling_particles(packing, contacts)


@honors("links shapes", packing_only=True)
def remove_rattlers(
    packing: Packing, *, gap_tolerance: float | None = None, contacts: Contacts | ShapeContacts | None = None
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
    rattling = find_rattlers(packing, gap_tolerance=gap_tolerance, contacts=contacts)
    if rattling.all():
        raise ValueError(f"packing must have particles that do not rattle, got {packing.particles} rattlers")
    return without(packing, rattling)


def without(packing: Packing, rattling_n: NDArray[np.bool_]) -> tuple[Packing, NDArray[np.int64]]:
    """Return the packing without the named particles and their links, and the numbers that the others had before."""
    kept = np.flatnonzero(~rattling_n)
    links = None
    if packing.links is not None:
        whole = _with_inner_links(packing, packing.links, rattling_n)
        if (~rattling_n[whole.i_l] & ~rattling_n[whole.j_l]).any():
            links = whole.numbered(np.where(rattling_n, -1, np.cumsum(~rattling_n) - 1))
    return packing.select(kept, links), kept


def _with_inner_links(packing: Packing, links: Links, rattling_n: NDArray[np.bool_]) -> Links:
    """Return the links, and shape links for the distances that held particles have by way of those taken out."""
    ends = np.stack([links.i_l, links.j_l], axis=1)
    between = np.flatnonzero(rattling_n[ends].all(axis=1))
    part = links.select(between).clusters(packing.particles) if len(between) else np.arange(packing.particles)
    rim = np.flatnonzero(rattling_n[ends].sum(axis=1) == 1)
    found: list[tuple[int, int, NDArray[np.int64]]] = []
    for p in np.unique(part[ends[rim][rattling_n[ends[rim]]]]):
        inside = rattling_n & (part == p)
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
    row_l = distance_rows(own)[:, column].toarray()
    row_p = distance_rows(pair_contacts(packing, i, j, image))[:, column].toarray()
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


@honors("links shapes", packing_only=True)
def packing_fraction(packing: Packing) -> float:
    """Return the volume of the particles over that of the box [1], rattlers included.

    Fused particles fill their union: those that overlap within a rigid cluster, and linked ones. What particles share
    that touch counts for each of them, as is usual at a finite pressure: this is the sum of all volumes over that of
    the box unless links are shorter than the sum of the radii. It depends on radii, links and box only, and falls as
    volume^-1 where the box grows between particles or clusters that keep their shape.

    Exact in two dimensions, and in three where no three particles are all fused with each other; else the error is
    below 1e-10 of a particle's volume in each particle's part.

    Parameters
    ----------
    packing
        The packing.

    Examples
    --------
    >>> import packmech as pm
    >>> round(pm.packing_fraction(pm.lattice_packing("triangular", repeats=(1, 1))), 6)
    0.9069
    >>> links = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [1.0, 1.0], pm.Box.cubic(10.0, 2), links)
    >>> round(100.0 * pm.packing_fraction(dimer), 6)  # 4 pi / 3 + sqrt(3) / 2
    5.054816

    """
    instance("packing", packing, Packing)
    unit = math.pi if packing.dimension == 2 else 4.0 * math.pi / 3.0
    volume = unit * (packing.radius_n**packing.dimension).sum() - shared_volume(packing)
    return float(volume / packing.box.volume)


@honors("links shapes", packing_only=True)
def coordination_number(packing: Packing, *, gap_tolerance: float | None = None, rattlers: str = "remove") -> float:
    """Return the mean number of contacts of a particle, 2 N_c / N' [1], in the periodic box.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    rattlers
        "remove" leaves rattlers and their contacts out of N' and N_c; "keep" counts everything.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.coordination_number(pm.lattice_packing("fcc", repeats=(2, 2, 2)), gap_tolerance=1e-9)
    12.0

    """
    instance("packing", packing, Packing)
    no_tangential("packing", packing)
    one_of("rattlers", rattlers, ("remove", "keep"))
    contacts: Contacts | ShapeContacts
    if packing.shapes is None:
        contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    else:
        contacts = find_shape_contacts(packing, gap_tolerance=gap_tolerance)
    if rattlers == "keep":
        return 2.0 * len(contacts) / packing.particles
    rattling = find_rattlers(packing, gap_tolerance=gap_tolerance)
    kept = int((~rattling).sum())
    if not kept:
        return 0.0
    return 2.0 * int((~rattling[contacts.i_c] & ~rattling[contacts.j_c]).sum()) / kept
