"""What rigid links ask of a motion of some of the particles: rows that must not change, all independent.

Particles left out of a motion (they rattle) still move as their links ask. Links between the particles that are kept
give a row each; those through the others give the combinations in which these no longer appear, for most dangling ends
none at all. Links that close around the box may forbid strains too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from packmech.constraints.factor import ConstraintFactor
from packmech.linalg.factor import factorize
from packmech.packing import Packing

# a combination of links whose part on the others is this small against the links is free of them
_FREE = 1e-8
# keeps products of nearly dependent rows definite
_NUDGE = 1e-14


@dataclass(frozen=True, eq=False)
class LinkRules:
    """Rows h on the displacements (of the kept particles) and on Mandel strains that a motion leaves unchanged.

    Attributes
    ----------
    position
        (h, N' d) rows on the displacements, linearly independent.
    strain
        (h, s) the same rows on the strains [length].
    share
        (h, L) the rows as combinations of the packing's links.
    stiff
        (k, s) orthonormal strains that the links forbid whatever the particles do [1].

    """

    position: sp.csr_array
    strain: NDArray[np.float64]
    share: sp.csr_array
    stiff: NDArray[np.float64]


def link_rules(packing: Packing, kept_n: NDArray[np.int64]) -> LinkRules:
    """Return the rows for the particles kept_n.

    Parameters
    ----------
    packing
        The packing; without links there are no rows.
    kept_n
        (N',) numbers of the particles that move, increasing.

    """
    d = packing.dimension
    links = ConstraintFactor(packing)
    stay = np.zeros(packing.particles, dtype=bool)
    stay[kept_n] = True
    i, j = links.pairs.i_c, links.pairs.j_c
    direct = np.flatnonzero(~links.dependent_l & stay[i] & stay[j])
    count = len(i)
    share = sp.csr_array((np.ones(len(direct)), (np.arange(len(direct)), direct)), shape=(len(direct), count))
    share = sp.csr_array(sp.vstack([share, *_through_others(links, stay)], format="csr"))
    moving = (kept_n[:, None] * d + np.arange(d)).ravel()
    position = sp.csr_array(share @ links.gradient_lx)[:, moving]
    return LinkRules(sp.csr_array(position), share @ links.strain_le, share, links.stiff_strains)


def _through_others(links: ConstraintFactor, stay_n: NDArray[np.bool_]) -> list[sp.csr_array]:
    """Return combinations of links with particles that are left out, in which these do not move, as (k, L) rows."""
    i, j, d = links.pairs.i_c, links.pairs.j_c, links.pairs.dimension
    cut = np.flatnonzero(~links.dependent_l & ~(stay_n[i] & stay_n[j]))
    if not len(cut):
        return []
    a, b = np.where(stay_n[i[cut]], j[cut], i[cut]), np.where(stay_n[j[cut]], i[cut], j[cut])
    graph = sp.coo_array((np.ones(len(cut)), (a, b)), shape=(len(stay_n), len(stay_n)))
    _, label = connected_components(graph, directed=False)
    part = label[a]
    order = np.argsort(part, kind="stable")
    found = []
    for own in np.split(cut[order], np.flatnonzero(np.diff(part[order])) + 1):
        ends = np.unique(np.concatenate([i[own], j[own]]))
        others = ends[~stay_n[ends]]
        # what hangs on one particle asks nothing of the rest
        if len(ends) - len(others) < 2:
            continue
        block = links.gradient_lx[own][:, (others[:, None] * d + np.arange(d)).ravel()].toarray()
        left, size, _ = np.linalg.svd(block, full_matrices=True)
        rank = int(np.count_nonzero(size > _FREE))
        rows = left[:, rank:].T
        place = np.tile(own, (len(rows), 1))
        number = np.repeat(np.arange(len(rows)), len(own))
        found.append(
            sp.csr_array((rows.ravel(), (number, place.ravel())), shape=(len(rows), links.gradient_lx.shape[0]))
        )
    return found


def follow_links(
    packing: Packing, kept_n: NDArray[np.int64], displacement_nd: NDArray[np.float64], strain_e: NDArray[np.float64]
) -> None:
    """Move the particles that are not among kept_n, in place, by as little as their links ask."""
    links = ConstraintFactor(packing)
    d = packing.dimension
    others = np.setdiff1d(np.unique(np.concatenate([links.pairs.i_c, links.pairs.j_c])), kept_n)
    if not len(others):
        return
    column = (others[:, None] * d + np.arange(d)).ravel()
    part = links.gradient_lx[:, column]
    touched = np.flatnonzero(np.diff(part.indptr) > 0)
    wrong = (links.gradient_lx @ displacement_nd.ravel() + links.strain_le @ strain_e)[touched]
    if np.abs(wrong).max() > 0.0:
        found = spla.lsmr(part[touched], -wrong, atol=1e-14, btol=1e-14, maxiter=50 * len(column))[0]
        displacement_nd[others] = found.reshape(-1, d)


class RuleKeeper:
    """Takes from motions what breaks the links' rules, and the rule for the volume."""

    def __init__(
        self,
        position: sp.csr_array,
        strain: NDArray[np.float64],
        held_kz: NDArray[np.float64],
        one_sided_bz: NDArray[np.float64],
    ) -> None:
        self._position, self._strain = position, strain
        self._held, self._one_sided = held_kz, one_sided_bz
        product = sp.csr_array(position @ position.T + _NUDGE * sp.eye_array(position.shape[0]))
        self._solve = factorize(product).solve if position.shape[0] else lambda right: right

    def keep(self, motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the motion, strains last, without what breaks the rules: first of its strain, then of the rest."""
        result = motion.copy()
        moving = self._position.shape[1]
        strain = result[moving:]
        if len(strain):
            basis, _ = np.linalg.qr(self._held.T)
            strain -= basis @ (basis.T @ strain)
            for row in self._one_sided:
                across = row - basis @ (basis.T @ row)
                strain -= across * (min(0.0, float(row @ strain)) / float(across @ across))
        for _ in range(3):
            wrong = self._position @ result[:moving]
            if len(strain):
                wrong = wrong + self._strain @ strain
            result[:moving] -= self._position.T @ self._solve(wrong)
        return result
