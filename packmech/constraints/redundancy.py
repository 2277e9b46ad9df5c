"""Which links depend on others: by redundancy, which no shape of the cluster mends, or by a degenerate shape.

A particle whose links are at most d and point in independent directions can be taken off with them: they depend on
nothing. What is left of each cluster after taking off all such particles, often nothing, is ranked by a pivoted QR of
its links' gradients. A link that depends on others at these places, and not at places a little moved, is degenerate:
three links of collinear particles, six of coplanar ones. It still holds the cluster, to second order, but its force is
not determined there and Newton's method converges only linearly.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import ANY_LENGTH, honors
from packmech.calls.status import shown_as
from packmech.check import BoxStrain, instance, one_of, positive, real
from packmech.constraints.factor import BASIS_LIMIT, ConstraintFactor, cluster_block, link_pairs
from packmech.constraints.jacobian import LINK_STRAINS
from packmech.contacts.elements import distance_rows
from packmech.jit.blas import single_thread
from packmech.links import Links, image_offsets
from packmech.packing import Packing, no_own_images

# sine between a link and the span of others below which it depends on them: a collinear trimer within rounding of its
# lengths is off its line by some 1e-7, a bend that is meant by more
SINE = 1e-6
# displacements that distinguish degenerate links from redundant ones, in mean link lengths
_SHAKE = 0.03
# in larger tangles of links the particles of a degenerate link are not distinguished from the others
_RESOLVED = 400
_SETTLED = 1e-13
_NEWTON_STEPS = 60


class DegenerateLink(NamedTuple):
    """A link that depends on others only because of how the particles stand: `shape` says how they do."""

    link: int
    particles: tuple[int, ...]
    shape: str

    def __str__(self) -> str:
        named = ", ".join(map(str, self.particles[:8])) + (", .." if len(self.particles) > 8 else "")
        return f"{self.shape} particles {named}"


class Dependence(NamedTuple):
    """Links by their part: independent ones (mask), redundant ones (places in the list) and degenerate ones."""

    independent_l: NDArray[np.bool_]
    redundant_l: NDArray[np.int64]
    degenerate: tuple[DegenerateLink, ...]


@shown()
@dataclass(frozen=True, eq=False)
class IndependentLinks:
    """A packing without its redundant links, and what was found about them.

    Attributes
    ----------
    packing
        The packing with the redundant links left out; degenerate ones are kept.
    removed_l
        Places of the redundant links in the list of the packing that was given.
    degenerate
        Links that depend on others only because particles stand in a line or in a plane, with those particles. Their
        forces are not determined.
    rank
        Number of independent links.
    largest_error
        Largest disagreement of a redundant link's length with the others, over the larger of it and the mean
        diameter [1].
    seconds
        CPU time.

    """

    packing: Packing
    removed_l: NDArray[np.int64]
    degenerate: tuple[DegenerateLink, ...]
    rank: int
    largest_error: float
    seconds: float


def _spread(direction: list[NDArray[np.float64]]) -> float:
    """Return the smallest sine between one of these unit vectors and the span of those before it."""
    smallest = 1.0
    basis: list[NDArray[np.float64]] = []
    for vector in direction:
        rest = vector
        for one in basis:
            rest = rest - (one @ rest) * one
        size = float(np.sqrt(rest @ rest))
        smallest = min(smallest, size)
        if size > 0.0:
            basis.append(rest / size)
    return smallest


def _core(links: Links, normal_ld: NDArray[np.float64], particles: int, tolerance: float) -> NDArray[np.bool_]:
    """Return (L,) the links that are left when particles with few links in independent directions are taken off."""
    d = normal_ld.shape[1]
    left = np.ones(len(links), dtype=bool)
    around: list[list[int]] = [[] for _ in range(particles)]
    ends = list(zip(links.i_l.tolist(), links.j_l.tolist(), strict=True))
    for k, (i, j) in enumerate(ends):
        around[i].append(k)
        around[j].append(k)
    queue = [n for n in range(particles) if around[n]]
    waiting = np.ones(particles, dtype=bool)
    while queue:
        n = queue.pop()
        waiting[n] = False
        own = [k for k in around[n] if left[k]]
        around[n] = own
        if not 0 < len(own) <= d or any(ends[k][0] == ends[k][1] for k in own):
            continue
        if len(own) > 1 and not _spread([normal_ld[k] for k in own]) > tolerance:
            continue
        for k in own:
            left[k] = False
            other = ends[k][0] + ends[k][1] - n
            if not waiting[other]:
                waiting[other] = True
                queue.append(other)
    return left


def _staged(matrix: NDArray[np.float64], stages: list[NDArray[np.int64]], tolerance: float) -> list[int]:
    """Return independent columns, those of earlier stages before those of later ones, by pivoted QR."""
    import scipy.linalg as sl

    kept: list[int] = []
    basis = np.zeros((len(matrix), 0))
    for stage in stages:
        rest = matrix[:, stage]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        if not rest.size:
            continue
        q, triangle, order = sl.qr(rest, mode="economic", pivoting=True, check_finite=False)
        rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > tolerance * np.sqrt(2.0)))
        kept += stage[order[:rank]].tolist()
        basis = np.hstack([basis, q[:, :rank]])
    return kept


def _shape(place_nd: NDArray[np.float64]) -> str:
    value = np.linalg.svd(place_nd - place_nd.mean(axis=0), compute_uv=False)
    flat = int(np.count_nonzero(value > 1e-4 * value[0]))
    return {1: "collinear", 2: "coplanar" if place_nd.shape[1] == 3 else "specially placed"}.get(
        flat, "specially placed"
    )


def _in_cluster(
    factor: ConstraintFactor, own: NDArray[np.int64], place_nd: NDArray[np.float64], tolerance: float
) -> tuple[list[int], list[int], list[tuple[int, list[int], str]]]:
    """Return independent, redundant and degenerate ones of own links, one cluster's core, whose places are unwrapped.

    They are named by their places among these.
    """
    links, pairs = factor.links.select(own), factor.pairs.select(own)
    members = np.unique(np.concatenate([links.i_l, links.j_l]))
    if 8.0 * members.size * pairs.dimension * len(links) > BASIS_LIMIT:
        raise ValueError(
            f"packing must have clusters with at most {BASIS_LIMIT:.0e} bytes of entangled links, got more"
        )
    matrix = cluster_block(factor.gradient_lx, own)[0].T
    # bonds of the molecule are kept rather than links that hold its shape
    kept = _staged(matrix, [np.flatnonzero(~links.shape_l), np.flatnonzero(links.shape_l)], tolerance)
    dependent = np.setdiff1d(np.arange(len(links)), kept)
    if not len(dependent):
        return kept, [], []
    shake = _SHAKE * pairs.distance_c.mean() * np.random.default_rng(0).standard_normal(place_nd.shape)
    moved = factor.packing.replace(position_nd=factor.packing.position_nd + shake, links=None)
    generic = distance_rows(link_pairs(moved, links)).toarray().T
    # elsewhere a redundant link depends to rounding: a larger tolerance would take a shake along the shape for none
    also = set(_staged(generic, [np.array(kept, dtype=np.int64), dependent], min(tolerance, SINE))[len(kept) :])
    degenerate = []
    if len(kept) > _RESOLVED:
        return (
            kept,
            [int(k) for k in dependent if int(k) not in also],
            [(k, members.tolist(), _shape(place_nd[members])) for k in sorted(also)],
        )
    for k in sorted(also):
        share = np.linalg.lstsq(matrix[:, kept], matrix[:, k], rcond=None)[0]
        part = [k, *(kept[m] for m in np.flatnonzero(np.abs(share) > 1e-3 * np.abs(share).max(initial=0.0)))]
        inside = np.unique(np.concatenate([links.i_l[part], links.j_l[part]]))
        degenerate.append((k, inside.tolist(), _shape(place_nd[inside])))
    return kept, [int(k) for k in dependent if int(k) not in also], degenerate


def dependence(packing: Packing, tolerance: float = SINE) -> Dependence:
    """Return which links are independent, redundant and degenerate at the packing's places."""
    links = packing.links
    factor = ConstraintFactor(packing)
    independent = ~_core(links, factor.pairs.normal_cd, packing.particles, tolerance)
    redundant: list[int] = []
    degenerate: list[DegenerateLink] = []
    if not independent.all():
        offset, _ = image_offsets(links, packing.particles)
        place = packing.position_nd + offset @ packing.box.lattice_dd.T
        core = np.flatnonzero(~independent)
        core = core[np.argsort(factor.cluster_l[core], kind="stable")]
        for own in np.split(core, np.flatnonzero(np.diff(factor.cluster_l[core])) + 1):
            kept, spare, bad = _in_cluster(factor, own, place, tolerance)
            independent[own[kept]] = True
            redundant += own[spare].tolist()
            degenerate += [DegenerateLink(int(own[k]), tuple(inside), shape) for k, inside, shape in bad]
    return Dependence(independent, np.array(sorted(redundant), dtype=np.int64), tuple(degenerate))


def check_consistent(packing: Packing, found: Dependence, tolerance: float) -> float:
    """Return the largest error of a redundant link where the independent ones have their lengths, over its scale [1].

    Raises
    ------
    ValueError
        If the independent links cannot be brought to their lengths from here; or naming the pair whose length disagrees
        with the others by more than the tolerance.

    """
    if not len(found.redundant_l):
        return 0.0
    links = packing.links
    place, lattice, worst = packing.position_nd, packing.box.lattice_dd, 0.0
    if found.independent_l.any():
        settled = ConstraintFactor(packing, links.select(found.independent_l))
        place, error_t = settled.project_positions(place, lattice, _SETTLED, _NEWTON_STEPS)
        worst = float(error_t[-1])
    if not worst < 1e-9:
        raise ValueError(
            f"packing must have links that can all have their lengths, got an error of {worst:.2g} at best"
        )
    spare = links.select(found.redundant_l)
    fits_l = np.sqrt((spare.vectors(place, lattice) ** 2).sum(axis=1))
    error_l = np.abs(fits_l - spare.length_l) / np.maximum(spare.length_l, float(packing.diameter_n.mean()))
    k = int(error_l.argmax())
    if error_l[k] > tolerance:
        raise ValueError(
            f"packing must have redundant links that agree with the others, got length {spare.length_l[k]:.12g} for "
            f"the link of particles {spare.i_l[k]} and {spare.j_l[k]}, which the others hold at {fits_l[k]:.12g}"
        )
    return float(error_l[k])


@shown_as("independent links")
@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def independent_links(
    packing: Packing, *, strain: BoxStrain = "none", tolerance: float = 1e-9, rank_tolerance: float = SINE
) -> IndependentLinks:
    """Return the packing without links that others already imply, and the links that are degenerate.

    Links that hold a shape go before bonds. A redundant link's length is compared where the others have theirs.

    Parameters
    ----------
    packing
        The packing; without links nothing is done.
    strain
        What the box may do: where it is not "none", a link that only strains could stretch (one of a taut chain around
        the box) is kept.
    tolerance
        Largest disagreement of a redundant link's length with the others, over the larger of it and the mean
        diameter [1].
    rank_tolerance
        A link depends on others when the sine between its gradient and their span is below this [1].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or a redundant link's length disagrees: the message names the pair.

    Examples
    --------
    >>> import packmech as pm
    >>> square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> pairs = [(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (1, 3)]
    >>> length = [1.0, 1.0, 1.0, 1.0, 2**0.5, 2**0.5]
    >>> links = pm.Links(*zip(*pairs), [[0, 0]] * 6, length)
    >>> packing = pm.Packing(square, [0.5] * 4, pm.Box.cubic(5.0, 2), links)
    >>> found = pm.independent_links(packing)
    >>> found.rank, len(found.removed_l), found.degenerate
    (5, 1, ())

    """
    instance("packing", packing, Packing)
    one_of("strain", strain, LINK_STRAINS)
    positive("tolerance", tolerance)
    real("rank_tolerance", rank_tolerance, above=0.0, below=1.0)
    started = time.process_time()
    links = packing.links
    with single_thread():
        found = dependence(packing, rank_tolerance)
        largest = check_consistent(packing, found, tolerance)
        removed = found.redundant_l
        if strain != "none" and len(removed):
            removed = removed[~_holds_strain(packing, found, removed, rank_tolerance)]
    keep = np.ones(len(links), dtype=bool)
    keep[removed] = False
    rank = len(links) - len(removed) - len(found.degenerate)
    kept = packing.replace(links=links.select(keep)) if len(removed) else packing
    return IndependentLinks(kept, removed, found.degenerate, rank, largest, time.process_time() - started)


def _holds_strain(
    packing: Packing, found: Dependence, spare_l: NDArray[np.int64], tolerance: float
) -> NDArray[np.bool_]:
    """Return which redundant links are independent of the others once strains move too."""
    import scipy.linalg as sl

    factor = ConstraintFactor(packing)
    cluster, rows = factor.cluster_l, factor.strain_le.T
    winding = packing.winding_n
    rest = np.zeros((len(rows), len(spare_l)))
    # in a cluster that does not wind around the box a strain is a displacement like others
    for c in np.unique(cluster[spare_l[winding[factor.pairs.i_c[spare_l]]]]):
        base = np.flatnonzero(found.independent_l & (cluster == c))
        own = np.flatnonzero(cluster[spare_l] == c)
        dense, used = cluster_block(factor.gradient_lx, base)
        target = factor.gradient_lx[spare_l[own]][:, used].toarray()
        share = np.linalg.lstsq(dense.T, target.T, rcond=None)[0]
        rest[:, own] = rows[:, spare_l[own]] - rows[:, base] @ share
    _, triangle, order = sl.qr(rest, mode="economic", pivoting=True, check_finite=False)
    rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > tolerance * np.abs(rows).max()))
    held = np.zeros(len(spare_l), dtype=bool)
    held[order[:rank]] = True
    return held


def workable_links(packing: Packing) -> Links:
    """Return the packing's links without redundant ones, whose forces would not be determined.

    Raises
    ------
    ValueError
        If a redundant link contradicts the others, or if links depend on each other only to first order, where
        particles stand in a line or in a plane: nothing could bring them back to their lengths.

    """
    links = packing.links
    no_own_images("packing", packing)
    members = np.bincount(links.clusters(packing.particles))
    if len(links) == int((members - 1).sum()) and (links.i_l != links.j_l).all():
        return links  # without rings every link is independent
    found = independent_links(packing)
    if found.degenerate:
        raise ValueError(f"packing must have links that hold to first order, got a link of {found.degenerate[0]}")
    return found.packing.links
