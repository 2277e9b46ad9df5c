"""Second derivatives on the motions that rigid links admit, sparse: the links' forces stay unknowns of every system."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import null_space, qr
from scipy.sparse.csgraph import connected_components

from packmech.constraints.factor import DEPENDENT, ConstraintFactor, admitted_strains
from packmech.linalg.factor import Factorization, NotDefinite, eigenvalues_below, factor_saddle, factorize
from packmech.linalg.inertia import CountBelow, count_below, judged

# a translation costs nothing where it costs this part of the largest eigenvalue, which is rounding
_NO_COST = 1e-12
# eigenvalues below this fraction of their scale are zero: pinned Hessians of jammed packings stay above 1e-7
SOFT = 1e-10
# compliance of the links, over that of a mean coordinate, with which a system is factored in any order
_SLACK = 1e-5
_REFINEMENTS = 12
# what may be left unbalanced of the loads: the stiffness is wrong by its square (a further solve would be for nothing)
_BALANCED = 1e-8


@dataclass(frozen=True, eq=False)
class LinkedSystem:
    """A Hessian, independent link gradients, and the unit of the links' rows [stiffness]."""

    matrix: sp.csr_array
    gradient: sp.csr_array
    stiffness: float

    @functools.cached_property
    def exact(self) -> sp.csr_array:
        """The system without slack."""
        side = self.stiffness * self.gradient
        return sp.csr_array(sp.block_array([[self.matrix, side.T], [side, None]], format="csr"))


class LinkedResponse(NamedTuple):
    """The (k, k) energy that the loads release, numbers of unstable and of zero motions, and what is unbalanced."""

    relief: NDArray[np.float64]
    negative: int
    floppy: int
    residual: float


def linked_system(matrix: sp.csr_array, gradient: sp.csr_array) -> LinkedSystem:
    """Return the system of a Hessian and the gradients of independent links."""
    diagonal = np.abs(matrix.diagonal())
    stiff = diagonal > 0.0
    return LinkedSystem(matrix, gradient, float(diagonal[stiff].mean()) if stiff.any() else 1.0)


def soft_shift(matrix: sp.csr_array) -> NDArray[np.float64]:
    """Return a diagonal that is small against each row's own stiffness, and never zero."""
    diagonal = np.abs(matrix.diagonal())
    stiff = diagonal > 0.0
    mean = float(diagonal[stiff].mean()) if stiff.any() else 1.0
    return SOFT * np.where(diagonal > SOFT * mean, diagonal, mean)


def factor_linked(
    system: LinkedSystem, dimension: int, shift_x: NDArray[np.float64] | float = 0.0, slack: float = _SLACK
) -> Factorization:
    """Return the factored system, slack in the links, with a shift added to the Hessian's diagonal.

    With slack any order of elimination is possible, so that the factor fills in least: half the time of `factor_saddle`
    in two dimensions, a fifth in three. Slack only softens: what is stable with it is stable without.
    """
    rows, count = system.matrix.shape[0], system.gradient.shape[0]
    diagonal = np.concatenate([np.zeros(rows) + shift_x, np.full(count, -slack * system.stiffness)])
    whole = sp.csr_array(system.exact + sp.diags_array(diagonal))
    # three dimensions fill in: supernodes win by far
    for backend in ("rslab", "auto") if dimension == 3 else ("auto", "rslab"):
        try:
            return factorize(whole, kind="symmetric", backend=backend)
        except NotDefinite as failure:
            reason = failure
    raise reason


def negative_motions(system: LinkedSystem, shift_x: NDArray[np.float64], dimension: int) -> int:
    """Return how many eigenvalues of the shifted Hessian on the motions that the links admit are negative."""
    factor = factor_linked(system, dimension, shift_x)
    return int(factor.inertia.negative - system.gradient.shape[0])


def relax_linked(
    system: LinkedSystem, right: NDArray[np.float64], lengths: NDArray[np.float64], push: float, dimension: int
) -> LinkedResponse:
    """Return what the solution u, m of H u + G^T m = right, G u = lengths releases, right.u + lengths.m, and counts.

    With an answer Y of the loads B that leaves R = B - A Y it is B^T Y + Y^T R up to R^T A^-1 R, of second order in
    what is left.

    Parameters
    ----------
    system
        Hessian and gradients, uniform translations taken out.
    right, lengths
        (rows, k) loads and (L, k) prescribed changes of length.
    push
        Size of a contact's force under these loads, which the residual is compared with.
    dimension
        2 or 3, for the choice of the factorization.

    """
    rows, count = system.matrix.shape[0], system.gradient.shape[0]
    load = np.concatenate([right, system.stiffness * lengths])
    if not rows:
        return LinkedResponse(np.zeros((load.shape[1],) * 2), 0, 0, 0.0)
    shift = soft_shift(system.matrix)
    # an unloaded system is balanced; so is one whose links move with the strain alone
    size = max(float(np.abs(load).max(initial=0.0)), push)
    factor = factor_linked(system, dimension, -shift)
    negative = floppy = factor.inertia.negative - count
    if not negative:
        answer, left = _refined(system.exact, factor, load, _BALANCED * size)
    if negative or not np.abs(left).max(initial=0.0) <= _BALANCED * size:
        # a soft or unstable motion, or one that hangs on the links: their slack must not decide
        lower, upper = (
            factor_saddle(sp.csr_array(system.matrix + sp.diags_array(sign * shift)), system.gradient, dimension,
                          stiffness=system.stiffness) for sign in (-1.0, 1.0)
        )  # fmt: skip
        negative = upper.inertia.negative - count
        floppy = lower.inertia.negative - count - negative
        answer, left = _refined(system.exact, upper, load, _BALANCED * size)
    residual = float(np.abs(left).max(initial=0.0)) / push if push else 0.0
    return LinkedResponse(load.T @ answer + answer.T @ left, negative, floppy, residual)


def _refined(
    exact: sp.csr_array, factor: Factorization, load: NDArray[np.float64], enough: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a solution of the exact system by refinement from a factorization of one nearby, and what it leaves.

    Refinement ends where no more than `enough` is left, or where it gains nothing.
    """
    answer, left, reached = np.zeros_like(load), load, float(np.abs(load).max(initial=0.0))
    for _ in range(_REFINEMENTS):
        if reached <= enough:
            break
        better = answer + factor.solve(left)
        rest = load - exact @ better
        now = float(np.abs(rest).max(initial=0.0))
        if not now < reached:
            break
        answer, left, reached = better, rest, now
    return answer, left


Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# counts of eigenvalues see the links' slack; it costs as many digits of them as rounding does
_COUNTING_SLACK = 1e-8
# rounding over that slack, over the stiffness, with room: nearer to zero, eigenvalues are counted without slack
_COUNTING_ERROR = 1e-6
_SOLVING_SLACK = 1e-6


class Operator(Protocol):
    """A symmetric matrix on a space of motions."""

    matrix: sp.csr_array
    size: int
    motions: int

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the matrix times motions."""

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part of vectors within the motions."""

    def solver(self, shift: float, *, definite: bool = True) -> Solve:
        """Return the solver of (matrix - shift) x = right within the motions; all eigenvalues above where definite."""

    def below(self, bound: float) -> int:
        """Return how many eigenvalues lie below the bound."""

    def count(self, bound: float) -> CountBelow:
        """Return how many eigenvalues lie below the bound, and how sure that is."""


class FreeOperator:
    """A sparse matrix on all motions."""

    def __init__(self, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        self.size = self.motions = int(matrix.shape[0])
        self._last: Factorization | None = None

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the matrix times motions."""
        product: NDArray[np.float64] = self.matrix @ vector
        return product

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vectors: all are motions."""
        return vector

    def solver(self, shift: float, *, definite: bool = True) -> Solve:
        """Return the solver of (matrix - shift) x = right; all eigenvalues lie above the shift where definite."""
        kind = "definite" if definite else "symmetric"
        shifted = self.matrix - shift * sp.eye_array(self.size, format="csr")
        return factorize(shifted, kind=kind, like=None if definite else self._last).solve

    def below(self, bound: float) -> int:
        """Return how many eigenvalues lie below the bound."""
        return eigenvalues_below(self.matrix, bound)

    def count(self, bound: float) -> CountBelow:
        """Return how many eigenvalues lie below the bound, and how sure that is."""
        found = count_below(self.matrix, bound, self._last)
        self._last = found.factor
        return found


def operator_of(matrix: sp.csr_array, rows: sp.csr_array, dimension: int) -> Operator:
    """Return a sparse matrix on the motions that leave `rows` unchanged: on all where there are none."""
    return LinkedOperator(matrix, rows, dimension) if rows.shape[0] else FreeOperator(matrix)


class LinkedOperator:
    """A sparse matrix P H P on the motions that leave `rows` unchanged, P the projector on them."""

    def __init__(self, matrix: sp.csr_array, rows: sp.csr_array, dimension: int) -> None:
        self.matrix, self.rows, self.dimension = matrix, rows, dimension
        self.size = int(matrix.shape[0])
        self.motions = self.size - int(rows.shape[0])
        self._project = self._solver(sp.eye_array(self.size, format="csr"))

    def _solver(self, matrix: sp.csr_array) -> Solve:
        system = linked_system(matrix, self.rows)
        exact = system.exact
        factor = factor_linked(system, self.dimension, slack=_SOLVING_SLACK)

        def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
            load = np.concatenate([right, np.zeros((self.rows.shape[0], *right.shape[1:]))])
            return _refined(exact, factor, load, 1e-15 * float(np.abs(load).max(initial=0.0)))[0][: self.size]

        return solve

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P times vectors."""
        return self._project(vector)

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P H times motions."""
        return self._project(self.matrix @ vector)

    def solver(self, shift: float, *, definite: bool = True) -> Solve:
        """Return the solver of P (H - shift) x = P right within the motions."""
        return self._solver(sp.csr_array(self.matrix - shift * sp.eye_array(self.size, format="csr")))

    def count(self, bound: float) -> CountBelow:
        """Return how many eigenvalues of P H P on the motions lie below the bound, and how sure that is.

        The exact system has no slack. It is regular where no eigenvalue lies at the bound and the links are
        independent; of its negative eigenvalues one belongs to each link (Haynsworth), and none is nearer to zero than
        the nearest eigenvalue to the bound is to this.
        """
        shifted = sp.csr_array(self.matrix - bound * sp.eye_array(self.size, format="csr"))
        system = linked_system(shifted, self.rows)
        largest = float(abs(system.exact).sum(axis=0).max())
        try:
            factor = factor_linked(system, self.dimension, slack=_COUNTING_SLACK)
        except NotDefinite:
            raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue") from None
        found = judged(system.exact, factor, factor.inertia.negative - self.rows.shape[0], largest)
        if found.certain:
            return found
        try:
            # where slack matters, an order of elimination that needs none
            factor = factor_saddle(shifted, self.rows, self.dimension, stiffness=system.stiffness)
        except NotDefinite:
            return found
        return judged(system.exact, factor, factor.inertia.negative - self.rows.shape[0], largest)

    def below(self, bound: float) -> int:
        """Return how many eigenvalues of P H P on the motions lie below the bound."""
        shifted = sp.csr_array(self.matrix - bound * sp.eye_array(self.size, format="csr"))
        system = linked_system(shifted, self.rows)
        try:
            factor = factor_linked(system, self.dimension, slack=_COUNTING_SLACK)
            if factor.inertia.negative > self.rows.shape[0] and abs(bound) < _COUNTING_ERROR * system.stiffness:
                factor = factor_saddle(shifted, self.rows, self.dimension, stiffness=system.stiffness)
        except NotDefinite:
            raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue") from None
        return int(factor.inertia.negative) - int(self.rows.shape[0])


def weighted_rows(
    links: ConstraintFactor, weight_x: NDArray[np.float64], strain_ek: NDArray[np.float64], strain_scale: float
) -> sp.csr_array:
    """Return independent rows that vanish on the motions which keep the links, for weighted coordinates.

    Coordinates are x / weight and, for each column of strain_ek, that strain times strain_scale. Strains that links
    forbid have rows of their own.
    """
    gradient, stretch = links.independent_rows()
    positions = gradient.multiply(weight_x[None, :]).tocsr()
    if not strain_ek.shape[1]:
        return sp.csr_array(positions)
    rows = sp.csr_array(sp.hstack([positions, sp.csr_array(stretch @ strain_ek / strain_scale)], format="csr"))
    stiff = links.stiff_strains
    if not len(stiff):
        return rows
    # an orthonormal basis of what the stiff strains forbid among the given ones
    admitted = strain_ek.T @ admitted_strains(strain_ek, stiff)
    forbidden = np.linalg.svd(admitted, full_matrices=True)[0][:, admitted.shape[1] :].T
    extra = sp.hstack([sp.csr_array((len(forbidden), len(weight_x))), sp.csr_array(forbidden)], format="csr")
    return sp.csr_array(sp.vstack([rows, extra], format="csr"))


def rows_on(
    links: ConstraintFactor,
    free_f: NDArray[np.bool_],
    weight_f: NDArray[np.float64],
    strain_ek: NDArray[np.float64],
    strain_scale: float,
) -> sp.csr_array:
    """Return independent rows that vanish on those motions of the free coordinates which keep the links.

    Parameters
    ----------
    links
        The links.
    free_f
        (N d,) coordinates that can move: what is held may leave links that depend on others, or cannot move.
    weight_f
        (F,) weights of the free ones, as of `weighted_rows`.
    strain_ek, strain_scale
        As of `weighted_rows`.

    """
    if not len(links):
        return sp.csr_array((0, len(weight_f) + strain_ek.shape[1]))
    weight = np.ones(len(free_f))
    weight[free_f] = weight_f
    rows = weighted_rows(links, weight, strain_ek, strain_scale)
    if free_f.all():
        return rows
    held = np.concatenate([~free_f, np.zeros(strain_ek.shape[1], dtype=bool)])
    # links to what is held may depend on others now, or be unable to move
    suspect = np.asarray(abs(rows[:, np.flatnonzero(held)]).sum(axis=1)).ravel() > 0.0
    return _independent(sp.csr_array(rows[:, np.flatnonzero(~held)]), suspect)


def _independent(rows: sp.csr_array, suspect_r: NDArray[np.bool_]) -> sp.csr_array:
    """Return rows that span what the given ones span; only groups that share coordinates with suspects may depend."""
    _, group = connected_components(rows @ rows.T, directed=False)
    looked_at = np.isin(group, group[suspect_r])
    kept = [np.flatnonzero(~looked_at)]
    members = np.flatnonzero(looked_at)
    members = members[np.argsort(group[members], kind="stable")]
    for own in np.split(members, np.flatnonzero(np.diff(group[members])) + 1):
        part = rows[own]
        block = part[:, np.unique(part.indices)].toarray()
        size = np.sqrt((block**2).sum(axis=1))
        own, block = own[size > 0.0], block[size > 0.0] / size[size > 0.0, None]
        if not len(own):
            continue
        _, upper, order = qr(block.T, mode="economic", pivoting=True)
        pivot = np.abs(np.diag(upper))
        kept.append(own[order[: int(np.count_nonzero(pivot > DEPENDENT * pivot[0]))]])
    return sp.csr_array(rows[np.sort(np.concatenate(kept))])


def free_translations(
    matrix: sp.csr_array,
    rows: sp.csr_array,
    root: NDArray[np.float64],
    axis: NDArray[np.int64],
    dimension: int,
    anchored: bool,
) -> NDArray[np.float64]:
    """Return the uniform translations that cost nothing, as orthonormal columns; root are square roots of masses."""
    translation = np.zeros((matrix.shape[0], dimension))
    for a in range(dimension):
        translation[: len(root)][axis == a, a] = root[axis == a]
    if not len(root):
        return translation[:, :0]
    translation /= np.sqrt((root[axis == 0] ** 2).sum())
    if not anchored:
        return translation
    cost = np.sqrt(((matrix @ translation) ** 2).sum(axis=0))
    free = cost <= _NO_COST * float(abs(matrix).sum(axis=0).max())
    # one that links forbid is no motion
    stretch = np.abs(rows @ translation).max(axis=0, initial=0.0)
    free &= stretch <= _NO_COST * float(abs(rows).max()) if rows.nnz else True
    return translation[:, free]


def link_motions(rows: sp.csr_array) -> NDArray[np.float64]:
    """Return an orthonormal basis, as columns, of the motions on which rows vanish: dense, for small packings."""
    return np.asarray(null_space(rows.toarray())) if rows.shape[0] else np.eye(rows.shape[1])
