"""Motions that contacts admit, and whether any is left: the rank of the contacts and what balances them.

A motion is y = (displacements, strain_scale * strain), particles first. Contacts may open but not close; the volume may
be held, or free to shrink. The cone of admissible motions is {0} (translations apart) exactly when the rows have full
rank and a strictly positive combination of them vanishes (Roth and Whiteley 1981): a state of self stress.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.check import BoxStrain
from packmech.constraints.motion_rules import LinkRules, RuleKeeper, link_rules
from packmech.contacts import Contacts
from packmech.linalg.factor import eigenvalues_below, factorize
from packmech.linalg.mandel import trace_vector
from packmech.mechanics.rigidity import rigidity_matrix
from packmech.packing import Packing

# Smallest over largest eigenvalue of R^T R below which a motion may be floppy (1e-5 in singular values). Most jammed
# packings stay above 1e-7 of it up to N = 16384, floppy modes come out below 1e-15; in between the stretch decides.
FLOPPY = 1e-10
# rounding of a stretch, of the largest displacement: unit normals know no more digits in a box of N^(1/d) diameters
_ROUNDING = 100 * float(np.finfo(np.float64).eps)
# inverse iterations that leave of a floppy mode, tenfold purer each time, what rounding does
_PURER = 12
# changes of rows by so many times what the contacts are known to are zero within the error
_KNOWN = 10.0
# keeps the factorization of R^T R definite when there are floppy modes; below FLOPPY, above the rounding of its pivots
_LIFT = 1e-11
_DENSE_UNKNOWNS = 60
# Lanczos vectors; values come out with the square of its tolerance
_KRYLOV = 10
# projections on the weights that balance, each removing what rounding left of the one before
ROUNDS = 3
# and at most so many, while each halves what is left
_ITERATION_LIMIT = 20
# the volume's row counts as held by others when less than this of it is left
_HELD = 1e-7


@dataclass(frozen=True, eq=False)
class MotionCone:
    """The motions y with opening @ y >= 0, held @ y = 0 and one_sided @ y >= 0.

    Attributes
    ----------
    opening
        (C, n) change of each contact's distance.
    held, one_sided
        (h, n) and (b, n) rows for what may not change, and for what may only grow (minus the volume).
    kept_n
        (N',) numbers of the particles that move; the others have no columns.
    dimension
        Number of Cartesian axes; also the number of translations.
    strain_scale
        Length that a unit strain counts as [length]; 0 when the box is fixed.
    links
        What rigid links ask of the motions, their rows first among the held ones.
    wider
        The cone of the same particles and contacts with strains, if this one has none of them and it is at hand: its
        factorization serves both.
    slack
        How well the contacts are known: their largest gap or overlap and rounding of the coordinates, in contact
        distances [1]. The hard packing that is meant may have rows that differ by so much.
    gap_c
        (C,) gaps of the contacts, in contact distances [1]: what particles may come nearer before these close. None for
        no gaps.

    """

    opening: sp.csr_array
    held: sp.csr_array
    one_sided: sp.csr_array
    kept_n: NDArray[np.int64]
    dimension: int
    strain_scale: float
    links: LinkRules
    wider: MotionCone | None = None
    slack: float = 0.0
    gap_c: NDArray[np.float64] | None = None

    @property
    def unknowns(self) -> int:
        """Number n of components of a motion, translations included."""
        return int(self.opening.shape[1])

    @property
    def freedoms(self) -> int:
        """Number of independent motions: components less translations and held combinations."""
        return self.unknowns - self.dimension - self.bound_rows

    @property
    def bound_rows(self) -> int:
        """Number of rows besides the contacts: links, and 1 for the volume when the box may change shape."""
        return int(self.held.shape[0] + self.one_sided.shape[0])

    @property
    def link_rows(self) -> int:
        """Number of independent rows of rigid links on displacements."""
        return int(self.links.position.shape[0])

    @functools.cached_property
    def rows(self) -> sp.csr_array:
        """All rows: contacts, held, one-sided."""
        return sp.csr_array(sp.vstack([self.opening, self.held, self.one_sided], format="csr"))

    @property
    def rounding(self) -> float:
        """Change of a row that are zero within the error, of the largest component of the motion [1]."""
        return float(_ROUNDING * len(self.kept_n) ** (1.0 / self.dimension))

    def without_translations(self, motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the motion less its mean displacement."""
        result = motion.copy()
        displacement = result[: len(self.kept_n) * self.dimension].reshape(-1, self.dimension)
        displacement -= displacement.mean(axis=0)
        return result

    def keeping_rules(self, motion: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the motion less what breaks the rules: a uniform strain for the volume, what would stretch links."""
        if self._keeper is not None:
            return self._keeper.keep(motion)
        # unit rows on the strains alone
        change = np.concatenate([self.held @ motion, np.minimum(self.one_sided @ motion, 0.0)])
        return np.asarray(motion - sp.vstack([self.held, self.one_sided]).T @ change)

    @functools.cached_property
    def _keeper(self) -> RuleKeeper | None:
        if not self.link_rows and not len(self.links.stiff):
            return None
        moving = len(self.kept_n) * self.dimension
        strain = self.links.strain / self.strain_scale if self.strain_scale else self.links.strain[:, :0]
        held = self.held[self.link_rows :, moving:].toarray()
        return RuleKeeper(self.links.position, strain, held, self.one_sided[:, moving:].toarray())

    @functools.cached_property
    def _gram(self) -> sp.csr_array:
        return sp.csr_array(self.rows.T @ self.rows)

    @functools.cached_property
    def largest_eigenvalue(self) -> float:
        """Largest eigenvalue of rows^T rows."""
        gram = self._gram
        if self.unknowns <= _DENSE_UNKNOWNS:
            return float(np.linalg.eigvalsh(gram.toarray())[-1])
        found = spla.eigsh(
            gram, k=1, which="LA", tol=1e-3, ncv=_KRYLOV, v0=_start(self.unknowns), return_eigenvectors=False
        )
        return float(found[0])

    @functools.cached_property
    def _solve(self) -> Any:
        """Return a function that solves rows^T rows y = load for loads and motions without translation."""
        return self._solver(self._gram) if self.wider is None else self._solve_in(self.wider)

    def _solve_in(self, wider: MotionCone) -> Any:
        """Return what `_solve` does, from the cone with strains: strain forces keep its strains at zero."""
        n, strains = self.unknowns, wider.unknowns - self.unknowns
        unit = np.eye(strains, wider.unknowns, n)
        follow = np.stack([wider._solve(one) for one in unit], axis=1)
        stiffness = np.linalg.inv(follow[n:])

        def solve(load: NDArray[np.float64]) -> NDArray[np.float64]:
            motion = wider._solve(np.concatenate([np.asarray(load, dtype=np.float64).reshape(-1), np.zeros(strains)]))
            return self.without_translations((motion - follow @ (stiffness @ motion[n:]))[:n])

        return solve

    def _solver(self, gram: sp.csr_array) -> Any:
        d = self.dimension
        # one particle held; its rows and columns come back through the loads' balance
        held = gram[d:, d:] + _LIFT * self.largest_eigenvalue * sp.eye_array(self.unknowns - d)
        factor = factorize(held)

        def solve(load: NDArray[np.float64]) -> NDArray[np.float64]:
            motion = np.zeros(self.unknowns)
            motion[d:] = factor.solve(np.asarray(load, dtype=np.float64).reshape(-1)[d:])
            return self.without_translations(motion)

        return solve

    def shutting(self, motion: NDArray[np.float64], shut_r: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
        """Yield the motion nearest to the given one that does not change the chosen rows, better and better.

        Parameters
        ----------
        motion
            (n,) a motion that changes these rows little.
        shut_r
            Which of the rows.

        """
        rows = self.rows[np.flatnonzero(shut_r)]
        solve = self._solver(sp.csr_array(rows.T @ rows))
        for _ in range(_PURER):
            motion = motion - solve(self.without_translations(rows.T @ (rows @ motion)))
            yield motion

    def softest(self) -> tuple[float, NDArray[np.float64]]:
        """Return the smallest singular value of the rows over the largest, translations removed, and its motion.

        The motion has unit length. A cone without motions but translations has no smallest value: infinity, and zeros.
        """
        return self._softest

    @functools.cached_property
    def _softest(self) -> tuple[float, NDArray[np.float64]]:
        n, d = self.unknowns, self.dimension
        if n == d:
            return np.inf, np.zeros(n)
        if not self.rows.nnz:
            return 0.0, _unit(self.without_translations(_start(n)))
        if n <= _DENSE_UNKNOWNS:
            _, vector = np.linalg.eigh(self._free_basis.T @ self._gram.toarray() @ self._free_basis)
            motion = self._free_basis @ vector[:, 0]
        else:
            inverse = spla.LinearOperator(
                (n, n), matvec=lambda load: self._solve(self.without_translations(np.ravel(load))), dtype=np.float64
            )
            start = self.without_translations(_start(n))
            _, vector = spla.eigsh(inverse, k=1, which="LA", tol=1e-5, ncv=_KRYLOV, v0=start)
            motion = _unit(self.without_translations(vector[:, 0]))
        value = self._relative_stretch(motion)
        if value**2 <= FLOPPY:
            for _ in range(_PURER):
                if self.changes_nothing(motion):
                    break
                # corrected by its own stretch it loses more digits of what is not floppy than by solving alone
                excess = self.rows.T @ (self.rows @ motion)
                motion = _unit(motion - self._solve(self.without_translations(excess)))
            value = self._relative_stretch(motion)
        return value, motion

    def _relative_stretch(self, motion: NDArray[np.float64]) -> float:
        stretch = self.rows @ motion
        return float(np.sqrt(stretch @ stretch / self.largest_eigenvalue))

    def changes_nothing(self, motion: NDArray[np.float64]) -> bool:
        """Return whether a motion changes no row by more than rounding makes of it."""
        stretch = float(np.abs(self.rows @ motion).max(initial=0.0))
        return stretch <= self.rounding * float(np.abs(motion).max(initial=0.0))

    @property
    def is_floppy(self) -> bool:
        """Whether some motion, translations apart, changes no row: a soft one that does, by however little, is none."""
        if self.rows.shape[0] < self.unknowns - self.dimension:
            return True
        value, motion = self._softest
        return value**2 <= FLOPPY and self.changes_nothing(motion)

    @property
    def is_floppy_within_error(self) -> bool:
        """Whether the softest motion changes no row by more than the contacts are known: it may be floppy."""
        value, motion = self._softest
        stretch = float(np.abs(self.rows @ motion).max(initial=0.0))
        return value**2 <= FLOPPY and stretch <= _KNOWN * self.slack * float(np.abs(motion).max(initial=0.0))

    @functools.cached_property
    def _free_basis(self) -> NDArray[np.float64]:
        """Orthonormal columns that span everything but translations; for small systems."""
        n, d, particles = self.unknowns, self.dimension, len(self.kept_n)
        translations = np.zeros((n, d))
        translations[: particles * d] = np.tile(np.eye(d), (particles, 1)) / np.sqrt(particles)
        basis, _ = np.linalg.qr(translations, mode="complete")
        return np.asarray(basis[:, d:])

    def floppy_modes(self, *, within_error: bool = False) -> int:
        """Return the number of independent motions, translations apart, that change no row.

        Parameters
        ----------
        within_error
            Whether those count that change rows by no more than the contacts are known.

        """
        d = self.dimension
        if self.unknowns == d:
            return 0
        if not self.rows.nnz:
            return self.unknowns - d
        count = eigenvalues_below(self._gram[d:, d:], FLOPPY * self.largest_eigenvalue)
        return count if count and (self.is_floppy or within_error) else 0

    def balanced(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest weights of the rows that balance: rows^T weight = 0 to rounding."""
        return self.bearing(weight, np.zeros(self.unknowns))

    def bearing(self, weight: NDArray[np.float64], load: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest weights of the rows that bear a load: rows^T weight = load to rounding, at full rank."""
        if self.unknowns == self.dimension:
            return weight.copy()
        # Conjugate gradients on rows^T rows: one step each for the motions softer than what lifts its factorization.
        result, step, held = weight.copy(), np.zeros(self.unknowns), np.zeros(self.unknowns)
        last, before = np.inf, np.inf
        for k in range(_ITERATION_LIMIT):
            rest = self.without_translations(self.rows.T @ result - load)
            size = float(np.sqrt(rest @ rest))
            if k >= ROUNDS and not size < 0.5 * last:
                break
            follow = self._solve(rest)
            product = float(rest @ follow)
            if not product > 0.0:
                break
            step = follow + float(follow @ (rest - held)) / before * step
            change = self.rows @ step
            square = float(change @ change)
            if not square > 0.0:
                break
            result -= float(rest @ step) / square * change
            held, last, before = rest, size, product
        return result


def _start(size: int) -> NDArray[np.float64]:
    """Return a fixed start vector for Lanczos, so that repetitions have the same bits."""
    return np.random.default_rng(size).standard_normal(size)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.sqrt(vector @ vector)
    return vector / length if length > 0 else vector


def motion_cone(
    packing: Packing,
    contacts: Contacts,
    *,
    strain: BoxStrain,
    kept_n: NDArray[np.int64] | None = None,
) -> MotionCone:
    """Return the cone of motions that the contacts, and links if there are any, admit.

    Parameters
    ----------
    packing
        The packing.
    contacts
        Its contacts, those of rattlers taken out.
    strain
        What the box may do: "none", "isochoric", or "free" as long as its volume does not grow, to first order.
    kept_n
        (N',) numbers of the particles that move, increasing; those with contacts, and in packings with links all that
        belong to their clusters, if not given.

    """
    d = packing.dimension
    kept = _touched(packing, contacts) if kept_n is None else kept_n
    matrix = rigidity_matrix(packing, "none" if strain == "none" else "free", contacts=contacts)
    moving = (kept[:, None] * d + np.arange(d)).ravel()
    position = matrix[:, moving]
    rules = link_rules(packing, kept)
    extent = float(np.abs(packing.position_nd).max())
    gap = contacts.gap_c / contacts.contact_distance_c
    slack = float(np.abs(gap).max(initial=0.0))
    slack += float(np.spacing(extent)) / packing.reference_diameter
    if strain == "none":
        none = sp.csr_array((0, len(moving)))
        return MotionCone(position, rules.position, none, kept, d, 0.0, rules, slack=slack, gap_c=gap)
    scale = float(packing.box.volume ** (1.0 / d))
    opening = sp.csr_array(sp.hstack([position, matrix[:, packing.particles * d :] / scale], format="csr"))
    row = np.concatenate([np.zeros(len(moving)), -trace_vector(d) / np.sqrt(d)])
    grow, none = sp.csr_array(row[None, :]), sp.csr_array((0, len(row)))
    held, one_sided = (grow, none) if strain == "isochoric" else (none, grow)
    linked = sp.hstack([rules.position, sp.csr_array(rules.strain / scale)])
    # a volume that the links hold by themselves needs no rule
    outside = row[len(moving) :] - rules.stiff.T @ (rules.stiff @ row[len(moving) :])
    if outside @ outside < _HELD**2:
        held = one_sided = none
    stiff = sp.hstack([sp.csr_array((len(rules.stiff), len(moving))), sp.csr_array(rules.stiff)])
    held = sp.csr_array(sp.vstack([linked, stiff, held], format="csr"))
    return MotionCone(opening, held, one_sided, kept, d, scale, rules, slack=slack, gap_c=gap)


def _touched(packing: Packing, contacts: Contacts) -> NDArray[np.int64]:
    cluster = packing.cluster_n
    return np.flatnonzero(np.isin(cluster, cluster[np.concatenate([contacts.i_c, contacts.j_c])]))
