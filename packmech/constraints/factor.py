"""The rigid links of a packing, factored: projection of forces, tensions, the way back to their lengths.

At a fixed box the projection is one sparse solve per cluster. With strains, what the constraints leave free are the
motions at fixed strain and, for each admissible strain e, the motion (-Y e, e), Y = Omega A^-1 T^T with A = Omega^T
Omega and T the rows of strains; the two sets are orthogonal, so that strains cost s further solves and a system of
size s.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import BoxStrain
from packmech.constraints.link_system import (
    DAMPED,
    NEWTON,
    TIGHT,
    LinkSystem,
    make_link_system,
    moved_system,
    project_links,
    record_link_positions,
    refill_links,
    solve_rates,
)
from packmech.contacts import Contacts
from packmech.contacts.elements import distance_rows
from packmech.contacts.network import pair_contacts
from packmech.linalg.mandel import (
    normal_strains,
    strain_components,
    strain_directions,
    trace_vector,
)
from packmech.links import Links
from packmech.packing import Packing

if TYPE_CHECKING:
    import scipy.sparse as sp

# a basis of links that takes more memory than this is not computed [bytes]
BASIS_LIMIT = 2e8
# a link whose gradient lies, to this sine, in the span of others of its cluster depends on them
DEPENDENT = 1e-8
# clusters with a smaller squared sine between a link and those before it are looked at again without squaring: where
# the dependence is small on its last link, that link keeps little of it
_NEARLY_DEPENDENT = 5e-6
# strains (of order 1) that links which depend on each other resist by more than this cannot be made
STIFF = 1e-7


class Strains(NamedTuple):
    """What links ask of strained motions, each strain times a scale; see `ConstraintFactor.strains`.

    The links' rates under each strain, the multipliers and the least motion that have these rates, the (s, s) matrix
    that makes of a force on the strains the strain that is free to follow it, and the row of the volume if it is held.
    """

    rows_el: NDArray[np.float64]
    part_el: NDArray[np.float64]
    motion_end: NDArray[np.float64]
    follow_ee: NDArray[np.float64]
    held_e: NDArray[np.float64]


def link_pairs(packing: Packing, links: Links | None = None) -> Contacts:
    """Return the geometry of a packing's links, or of the given ones, in their order.

    Raises
    ------
    ValueError
        If the ends of a link coincide: its length has no derivative there.

    """
    links = packing.links if links is None else links
    pairs = pair_contacts(packing, links.i_l, links.j_l, links.image_ld)
    stuck = np.flatnonzero(pairs.distance_c == 0.0)
    if len(stuck):
        ends = f"particles {links.i_l[stuck[0]]} and {links.j_l[stuck[0]]}"
        raise ValueError(f"packing must have linked particles at different places, got {ends} at one place")
    return pairs


class ConstraintFactor:
    """The rigid links of a packing and the factored normal matrix of their Jacobian; for one thread at a time.

    Sums over particles are the kernels', not BLAS's: their bits must not depend on the number of threads.

    Parameters
    ----------
    packing
        The packing; one without links has no constraints here.
    links
        Those of its links to take; all unless given.
    system
        Compiled links that are these, at another configuration, whose structure then serves again.

    Attributes
    ----------
    packing, links
        As given.
    pairs
        Normals and distances of the links.
    system
        The compiled links at the packing's configuration; None without links.
    smallest_pivot
        Smallest squared sine between a link's gradient and those before it in the order of elimination [1].
    left_out
        Number of links that depend on those before them to rounding; they get no multiplier in projections.

    Raises
    ------
    ValueError
        If the ends of a link coincide: its length has no derivative there.

    Examples
    --------
    >>> from packmech.box import Box
    >>> dimer = Packing([[0, 0], [1, 0]], [0.5, 0.5], Box.cubic(4.0, 2), Links([0], [1], [[0, 0]], [1.0]))
    >>> left, tension, _ = ConstraintFactor(dimer).project(np.array([[-1.0, 1.0], [3.0, 0.0]]))
    >>> left.round(12).tolist(), tension.round(12).tolist()
    ([[1.0, 1.0], [1.0, 0.0]], [2.0])

    """

    def __init__(self, packing: Packing, links: Links | None = None, system: LinkSystem | None = None) -> None:
        self.packing, self.links = packing, packing.links if links is None else links
        self.pairs = link_pairs(packing, self.links)
        self.system: LinkSystem | None = None
        self.smallest_pivot, self.left_out = 1.0, 0
        if not self.links:
            return
        if system is None:
            mean = float(packing.diameter_n.mean())
            self.system = make_link_system(self.links, packing.particles, packing.dimension, mean_diameter=mean)
        else:
            self.system = moved_system(system)
        pivot, left_out = refill_links(self.system, packing.position_nd, packing.box.lattice_dd)
        self.smallest_pivot, self.left_out = float(pivot), int(left_out)

    def __len__(self) -> int:
        return len(self.pairs)

    def at(self, packing: Packing) -> ConstraintFactor:
        """Return the same links factored where another packing of the same particles is."""
        return ConstraintFactor(packing, self.links, self.system)

    @functools.cached_property
    def cluster_n(self) -> NDArray[np.int64]:
        """The (N,) cluster of each particle."""
        return self.links.clusters(self.packing.particles)

    @functools.cached_property
    def cluster_l(self) -> NDArray[np.int64]:
        """The (L,) cluster of each link."""
        return self.cluster_n[self.pairs.i_c]

    @functools.cached_property
    def gradient_lx(self) -> sp.csr_array:
        """The (L, N d) derivatives of the lengths by the positions."""
        return distance_rows(self.pairs)

    @functools.cached_property
    def strain_le(self) -> NDArray[np.float64]:
        """The (L, s) derivatives rho n.E.n of the lengths by the Mandel strains [length]."""
        return self.pairs.distance_c[:, None] * normal_strains(self.pairs.normal_cd)

    @functools.cached_property
    def _suspects(self) -> tuple[NDArray[np.int64], ...]:
        """The links of each cluster in which some may depend on others."""
        if self.system is None or self.smallest_pivot >= _NEARLY_DEPENDENT:
            return ()
        system = self.system
        # masses are equal: two ends share the diagonal of 2
        inverse = system.inverse_pivot_r
        sine = np.where(inverse > 0.0, 0.5 / np.where(inverse > 0.0, inverse, 1.0) ** 2, 0.0)
        cluster = self.cluster_l[system.order_r]
        return tuple(np.flatnonzero(self.cluster_l == c) for c in np.unique(cluster[sine < _NEARLY_DEPENDENT]))

    @functools.cached_property
    def dependent_l(self) -> NDArray[np.bool_]:
        """The (L,) links that say nothing that others do not: the gradient lies in the span of others."""
        # measuring a packing imports nothing of SciPy until it must
        import scipy.linalg

        dependent = np.zeros(len(self.pairs), dtype=bool)
        for own in self._suspects:
            block = cluster_block(self.gradient_lx, own)[0]
            dependent[own] = True
            if block.size:
                _, right, order = scipy.linalg.qr(block.T, mode="economic", pivoting=True)
                size = np.abs(np.diag(right))
                dependent[own[order[: int(np.count_nonzero(size > DEPENDENT * np.sqrt(2.0)))]]] = False
        return dependent

    def independent_rows(self) -> tuple[sp.csr_array, NDArray[np.float64]]:
        """Return the derivatives by positions and by strains of the links that do not depend on others."""
        keep = np.flatnonzero(~self.dependent_l)
        return self.gradient_lx[keep], self.strain_le[keep]

    def project(self, force_nd: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return what links leave of a force at fixed strain, the (L,) tensions, and the largest rate of a link."""
        if self.system is None:
            return force_nd.copy(), np.zeros(0), 0.0
        left, tension = np.empty_like(force_nd), np.zeros(len(self.system.order_r))
        rate = float(project_links(self.system, force_nd, left, tension, True))
        return left, tension, rate

    def multipliers(self, push_x: NDArray[np.float64], free_n: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the (L,) multipliers m of the smallest |push + gradient^T m|, of smallest size where links depend.

        The sum is over particles that are free to move, all unless given.
        """
        push = np.ascontiguousarray(push_x, dtype=np.float64).reshape(self.packing.position_nd.shape)
        if len(self) and free_n is not None and not free_n.all():
            free = np.repeat(free_n, self.packing.dimension)
            return _least_squares(self.gradient_lx[:, free], -push.ravel()[free])
        found = self.project(-push)[1]
        for own in self._suspects:
            block, column = cluster_block(self.gradient_lx, own)
            found[own] = np.linalg.lstsq(block.T, -push.ravel()[column], rcond=DEPENDENT)[0]
        return found

    def project_positions(
        self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64], tolerance: float, step_limit: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions moved to the links' lengths by the least displacement, and the largest errors by step.

        Errors are over the larger of a link's length and the mean diameter.
        """
        if self.system is None:
            return np.array(position_nd), np.zeros(1)
        place, error_t = np.array(position_nd), np.zeros((1 + DAMPED) * step_limit + 1)
        steps = record_link_positions(moved_system(self.system), place, lattice_dd, tolerance, step_limit, error_t)[0]
        return place, error_t[: int(steps) + 1]

    def projected(self, packing: Packing) -> Packing:
        """Return a packing of the same particles with its links at their lengths, to rounding of the coordinates."""
        if self.system is None:
            return packing
        tolerance = max(TIGHT, self.rounding(packing))
        return packing.replace(
            position_nd=self.project_positions(packing.position_nd, packing.box.lattice_dd, tolerance, NEWTON)[0]
        )

    def rounding(self, packing: Packing) -> float:
        """Return the error of a link that rounding of the coordinates can make; 0 without links."""
        if self.system is None:
            return 0.0
        extent = max(float(np.abs(packing.position_nd).max()), float(np.abs(packing.box.lattice_dd).max()))
        return 2.0 * float(np.finfo(np.float64).eps) * extent / float(self.system.scale_r.min(initial=np.inf))

    def strains(self, scale: float, strain: BoxStrain) -> Strains:
        """Return what `project_strained` needs for "free" or "isochoric" strains times a scale."""
        d = self.packing.dimension
        rows = np.ascontiguousarray(self.strain_le.T / scale)
        part, motion = np.empty_like(rows), np.zeros((len(rows), *self.packing.position_nd.shape))
        for k, row_l in enumerate(rows if self.system is not None else ()):
            solve_rates(self.system, row_l, motion[k], part[k])
        inner = np.eye(len(rows)) + np.einsum("ind,jnd->ij", motion, motion)
        free = strain_directions(d, strain)
        follow = free @ np.linalg.solve(free.T @ inner @ free, free.T)
        held = trace_vector(d) / scale if strain == "isochoric" else np.zeros(len(rows))
        return Strains(rows, part, motion, follow, held)

    def project_strained(
        self, strains: Strains, force_nd: NDArray[np.float64], pull_e: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float, float]:
        """Return what is left of a force and of one on scaled strains, multipliers of links and volume, and rate."""
        rows, part, motion, follow, held = strains
        out, strain, multiplier, share = force_nd, pull_e, np.zeros(len(self)), 0.0
        for _ in range(2):  # a second pass takes the rounding of the first one out
            before, strain = strain, follow @ (strain - np.einsum("end,nd->e", motion, out))
            out, more, _ = self.project(out)
            out -= np.einsum("e,end->nd", strain, motion)
            more += np.einsum("e,el->l", strain, part)
            multiplier += more
            share += held @ (before - strain) - held @ np.einsum("el,l->e", rows, more)
        rate_l = self.gradient_lx @ out.ravel() + np.einsum("el,e->l", rows, strain)
        rate = max(abs(held @ strain), np.abs(rate_l).max(initial=0.0))
        return out, strain, multiplier, float(share / (held @ held) if held.any() else 0.0), float(rate)

    @functools.cached_property
    def stiff_strains(self) -> NDArray[np.float64]:
        """The (k, s) orthonormal strains that the links forbid, whatever the particles do.

        A dependent link follows the others under every motion of the particles. Where it does not follow them under a
        strain too, that strain is impossible: links that close around the box. Links that depend on each other within
        one place follow every strain, since the cluster can strain as a whole.
        """
        dependent, strain = self.dependent_l, self.strain_le
        if not dependent.any():
            return np.zeros((0, strain_components(self.packing.dimension)))
        found = []
        for c in np.unique(self.cluster_l[dependent]):
            own = np.flatnonzero(self.cluster_l == c)
            free, bound = own[~dependent[own]], own[dependent[own]]
            block = cluster_block(self.gradient_lx, own)[0]
            ahead, behind = block[~dependent[own]], block[dependent[own]]
            share = np.linalg.lstsq(ahead.T, behind.T, rcond=None)[0] if len(free) else np.zeros((0, len(bound)))
            excess = strain[bound] - share.T @ strain[free]
            scale = self.pairs.distance_c[own].sum() * (1.0 + np.abs(share).max(initial=0.0))
            found.append(excess / scale)
        _, size, direction = np.linalg.svd(np.concatenate(found), full_matrices=False)
        stiff: NDArray[np.float64] = direction[size > STIFF]
        return stiff


def _least_squares(gradient_lf: sp.csr_array, pull_f: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest of the multipliers that come nearest to a force, by LSQR."""
    from scipy.sparse.linalg import lsqr

    limit = 10 * gradient_lf.shape[0] + 100
    return np.asarray(lsqr(gradient_lf.T, pull_f, atol=1e-15, btol=1e-15, iter_lim=limit)[0], dtype=np.float64)


def cluster_block(gradient_lx: sp.csr_array, own: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the dense rows of a cluster's links on the coordinates that they touch, and these coordinates."""
    part = gradient_lx[own]
    column = np.unique(part.indices)
    return part[:, column].toarray(), column.astype(np.int64)


def admitted_strains(
    directions_ek: NDArray[np.float64], stiff_ke: NDArray[np.float64], tolerance: float = 1e-8
) -> NDArray[np.float64]:
    """Return an orthonormal basis, as columns, of those of the given strains that are across all stiff ones."""
    if not len(stiff_ke):
        return directions_ek
    _, size, right = np.linalg.svd(stiff_ke @ directions_ek, full_matrices=True)
    admitted: NDArray[np.float64] = directions_ek @ right[int(np.count_nonzero(size > tolerance)) :].T
    return admitted
