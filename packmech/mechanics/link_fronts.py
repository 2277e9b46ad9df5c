# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Linear response of particles under rigid links by fronts: exact in the links, ordered by position.

Beside every link stands a spring of the typical stiffness, H + s G^T G for H, which changes no motion with G u = 0 and
makes every leading block regular where the motions that the links admit are stable. So no slack is needed, and the
negative pivots less one for each link count the unstable motions (Haynsworth).
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.compiled import kernel
from packmech.measure.link_tension import LinkGradients
from packmech.mechanics.bonds import BondSums
from packmech.mechanics.dissection import dissect, graph_of
from packmech.mechanics.front_solve import solve_fronts
from packmech.mechanics.fronts import factor_fronts
from packmech.mechanics.link_relaxation import SOFT
from packmech.mechanics.strain import mandel_basis

_REFINEMENTS = 12
# what may be left unbalanced of the loads: the stiffness is wrong by its square (a second solve would be for nothing);
# where more is left the springs beside the links are tried in vain
_DONE = 1e-8
# particles in a set that is cut no more, and places of each cut that are tried, by dimension
_LEAF = {2: 12, 3: 8}
_TRIALS = {2: 1, 3: 9}


# the most working space that a thread keeps from one call to the next [bytes]
_KEPT_BYTES = 48e6
_kept = threading.local()


class FrontResponse(NamedTuple):
    """The (s, s) stiffness that relaxation takes from the strains, and what the constrained Hessian is like."""

    relief_ee: NDArray[np.float64]
    negative: int
    floppy: int
    residual: float


@kernel
def _shifted(diagonal_ndd, pinned, soft):
    """Return the mean stiffness of a coordinate, and the particles' own blocks with small diagonals taken and added."""
    particles, d = diagonal_ndd.shape[0], diagonal_ndd.shape[1]
    total, count = 0.0, 0
    for n in range(particles):
        for a in range(d):
            own = abs(diagonal_ndd[n, a, a])
            if n != pinned and own > 0.0:
                total += own
                count += 1
    mean = total / count if count > 0 else 1.0
    lower, upper = diagonal_ndd.copy(), diagonal_ndd.copy()
    for n in range(particles):
        for a in range(d):
            own = abs(diagonal_ndd[n, a, a])
            shift = soft * (own if own > soft * mean else mean)
            lower[n, a, a] -= shift
            upper[n, a, a] += shift
    return mean, lower, upper


@kernel
def _loads(coupling_nde, distance_l, normal_ld, basis_edd, unit, pinned):
    """Return minus the strains' derivatives, of the energy and, times `unit`, of the links' lengths: (s, N d + L)."""
    particles, d, strains = coupling_nde.shape
    load = np.empty((strains, particles * d + distance_l.shape[0]))
    for e in range(strains):
        for n in range(particles):
            for a in range(d):
                load[e, n * d + a] = -coupling_nde[n, a, e] if n != pinned else 0.0
        for link in range(distance_l.shape[0]):
            stretch = 0.0
            for a in range(d):
                for b in range(d):
                    stretch += normal_ld[link, a] * basis_edd[e, a, b] * normal_ld[link, b]
            load[e, particles * d + link] = -unit * distance_l[link] * stretch
    return load


@kernel
def _left_over(load, answer, pair_i, pair_j, pair_pdd, diagonal_ndd, link_i, link_j, normal_ld, unit, pinned):
    """Return load - [[H, h G^T], [h G, 0]] answer, rows (k, N d + L), and its largest entry."""
    left = load.copy()
    sides = load.shape[0]
    particles, d = diagonal_ndd.shape[0], diagonal_ndd.shape[1]
    size = particles * d
    for s in range(sides):
        out, x = left[s], answer[s]
        for n in range(particles):
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += diagonal_ndd[n, a, b] * x[n * d + b]
                out[n * d + a] -= total
        for p in range(pair_i.shape[0]):
            i, j = pair_i[p] * d, pair_j[p] * d
            for a in range(d):
                for b in range(d):
                    out[i + a] += pair_pdd[p, a, b] * x[j + b]
                    out[j + a] += pair_pdd[p, b, a] * x[i + b]
        for link in range(link_i.shape[0]):
            i, j = link_i[link] * d, link_j[link] * d
            force = unit * x[size + link]
            for a in range(d):
                n_a = normal_ld[link, a]
                out[i + a] += n_a * force
                out[j + a] -= n_a * force
                out[size + link] -= unit * n_a * (x[j + a] - x[i + a])
        for a in range(d):
            out[pinned * d + a] = 0.0
    return left, np.abs(left).max()


@kernel
def _corrected(answer, step, link_i, link_j, normal_ld, size):
    """Add a step of the solution, the force of the springs beside the links going to the links."""
    d = normal_ld.shape[1]
    out = answer + step
    for s in range(out.shape[0]):
        for link in range(link_i.shape[0]):
            i, j = link_i[link] * d, link_j[link] * d
            stretch = 0.0
            for a in range(d):
                stretch += normal_ld[link, a] * (step[s, j + a] - step[s, i + a])
            out[s, size + link] += stretch
    return out


def _space() -> tuple[NDArray[np.float64], ...]:
    """Return this thread's working space: memory new from the system costs as much as a fifth of the arithmetic."""
    space: tuple[NDArray[np.float64], ...] = getattr(_kept, "space", (np.empty(64),) * 4)
    return space


def _keep(space: tuple[NDArray[np.float64], ...]) -> None:
    """Keep the working space for the next call, unless it is large."""
    if sum(array.nbytes for array in space) <= _KEPT_BYTES:
        _kept.space = space


def cut_places(position_nd: NDArray[np.float64], box: Box) -> NDArray[np.float64]:
    """Return the distances of the wrapped positions from the faces of the reduced box: cuts are parallel to these."""
    small, _ = box.reduced()
    fraction = position_nd @ small.inverse_dd.T
    return np.ascontiguousarray((fraction - np.floor(fraction)) * small.height_d)


def relax_by_fronts(
    sums: BondSums, links: LinkGradients, place_nd: NDArray[np.float64], pinned: int, push: float
) -> FrontResponse | None:
    """Return what particles and links relax of the stiffness: B^T A^-1 B, A = [[H, G^T], [G, 0]], one particle held.

    B holds the mixed derivatives with respect to the strains, of the energy and of the links' lengths. With an answer Y
    that leaves R = B - A Y it is B^T Y + Y^T R up to R^T A^-1 R, of second order in what is left.

    Parameters
    ----------
    sums
        Second derivatives.
    links
        The links.
    place_nd
        (N, d) places that cuts are made by (`cut_places`).
    pinned
        The particle that is held.
    push
        Size of a contact's force under these loads, which the residual is compared with.

    Returns
    -------
    FrontResponse or None
        None where a pivot vanishes or too much is left unbalanced: then slack in the links may help.

    """
    particles, dimension = sums.diagonal_ndd.shape[:2]
    size = particles * dimension
    pairs, distance = links.pairs, links.pairs.distance_c
    link_i, link_j, normal = pairs.i_c, pairs.j_c, pairs.normal_cd
    if links.dependent_l.any():
        free = np.flatnonzero(~links.dependent_l)
        link_i, link_j, normal, distance = link_i[free], link_j[free], normal[free], distance[free]
    mean, lower, upper = _shifted(sums.diagonal_ndd, pinned, SOFT)
    graph = graph_of(np.concatenate([sums.pair_i, link_i]), np.concatenate([sums.pair_j, link_j]), particles)
    link_start, _, link_entry = graph_of(link_i, link_j, particles)
    tree = dissect(place_nd, graph[0], graph[1], pinned, _LEAF[dimension], _TRIALS[dimension])

    def factor(shifted: NDArray[np.float64]) -> tuple[bool, int, Any]:
        failed, below, fronts, grown = factor_fronts(
            tree,
            graph,
            sums.pair_pdd,
            shifted,
            link_i,
            link_j,
            (link_start, link_entry),
            normal,
            mean,
            pinned,
            _space(),
        )
        _keep(grown)
        return failed, below, fronts

    failed, below, fronts = factor(lower)
    if failed:
        return None
    floor = negative = below - len(link_i)
    if floor:
        failed, below, fronts = factor(upper)
        if failed:
            return None
        negative = below - len(link_i)
    load = _loads(sums.coupling_nde, distance, normal, mandel_basis(dimension), mean, pinned)
    matrix = (sums.pair_i, sums.pair_j, sums.pair_pdd, sums.diagonal_ndd, link_i, link_j, normal, mean, pinned)
    # an unloaded system is balanced; so is one whose links move with the strain alone
    reached = float(np.abs(load).max(initial=0.0))
    weight = max(reached, push)
    answer, left = np.zeros_like(load), load
    for _ in range(_REFINEMENTS):
        if reached <= _DONE * weight:
            break
        better = _corrected(answer, solve_fronts(fronts, left), link_i, link_j, normal, size)
        rest, now = _left_over(load, better, *matrix)
        if not now < reached:
            break
        answer, left, reached = better, rest, now
    if not reached <= _DONE * weight:
        return None
    residual = reached / push if push else 0.0
    relief = load @ answer.T + answer @ left.T
    return FrontResponse(relief, negative, floor - negative, residual)
