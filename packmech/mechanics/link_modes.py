"""Spectral problems on the motions that rigid links admit, sparse: the links stay unknowns of every system."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.measure.link_tension import LinkGradients
from packmech.mechanics.factor import NotDefinite, eigenvalues_below, factorize
from packmech.mechanics.link_relaxation import factor_linked, linked_system, no_shift
from packmech.mechanics.link_rows import admitted_strains, independent_rows, stiff_strains

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# counts of eigenvalues see the links' slack; it costs as many digits of them as rounding does
_COUNTING_SLACK = 1e-8
_SOLVING_SLACK = 1e-6
_REFINEMENTS = 12


class Operator(Protocol):
    """A symmetric matrix on a space of motions."""

    size: int
    motions: int

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the matrix times motions."""

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part of vectors within the motions."""

    def solver(self, shift: float) -> Solve:
        """Return the solver of (matrix - shift) x = right within the motions."""

    def below(self, bound: float) -> int:
        """Return how many eigenvalues lie below the bound."""


class FreeOperator:
    """A sparse matrix on all motions."""

    def __init__(self, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        self.size = self.motions = int(matrix.shape[0])

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the matrix times motions."""
        product: NDArray[np.float64] = self.matrix @ vector
        return product

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the vectors: all are motions."""
        return vector

    def solver(self, shift: float) -> Solve:
        """Return the solver of (matrix - shift) x = right."""
        return factorize(self.matrix - shift * sp.eye_array(self.size, format="csr")).solve

    def below(self, bound: float) -> int:
        """Return how many eigenvalues lie below the bound."""
        return eigenvalues_below(self.matrix, bound)


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
        factor = factor_linked(system, no_shift(matrix), _SOLVING_SLACK, self.dimension)

        def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
            load = np.concatenate([right, np.zeros((self.rows.shape[0], *right.shape[1:]))])
            found, rest = np.zeros_like(load), load
            reached = goal = float(np.abs(load).max(initial=0.0))
            for _ in range(_REFINEMENTS):
                if reached <= 1e-15 * goal:
                    break
                better = found + factor.solve(rest)
                rest = load - exact @ better
                now = float(np.abs(rest).max(initial=0.0))
                if not now < reached:
                    break
                found, reached = better, now
            return found[: self.size]

        return solve

    def project(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P times vectors."""
        return self._project(vector)

    def apply(self, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P H times motions."""
        return self._project(self.matrix @ vector)

    def solver(self, shift: float) -> Solve:
        """Return the solver of P (H - shift) x = P right within the motions."""
        return self._solver(sp.csr_array(self.matrix - shift * sp.eye_array(self.size, format="csr")))

    def below(self, bound: float) -> int:
        """Return how many eigenvalues of P H P on the motions lie below the bound."""
        shifted = sp.csr_array(self.matrix - bound * sp.eye_array(self.size, format="csr"))
        system = linked_system(shifted, self.rows)
        try:
            factor = factor_linked(system, no_shift(shifted), _COUNTING_SLACK, self.dimension)
        except NotDefinite:
            raise NotDefinite(f"matrix - {bound:g} cannot be factored: the bound is an eigenvalue") from None
        return int(factor.inertia.negative) - int(self.rows.shape[0])


def weighted_rows(
    links: LinkGradients, weight_x: NDArray[np.float64], strain_ek: NDArray[np.float64], strain_scale: float
) -> sp.csr_array:
    """Return independent rows that vanish on the motions which keep the links, for weighted coordinates.

    Coordinates are x / weight and, for each column of strain_ek, that strain times strain_scale. Strains that links
    forbid have rows of their own.
    """
    gradient, stretch = independent_rows(links)
    positions = gradient.multiply(weight_x[None, :]).tocsr()
    if not strain_ek.shape[1]:
        return sp.csr_array(positions)
    rows = sp.csr_array(sp.hstack([positions, sp.csr_array(stretch @ strain_ek / strain_scale)], format="csr"))
    stiff = stiff_strains(links, links.pairs.dimension)
    if not len(stiff):
        return rows
    # an orthonormal basis of what the stiff strains forbid among the given ones
    admitted = strain_ek.T @ admitted_strains(strain_ek, stiff)
    forbidden = np.linalg.svd(admitted, full_matrices=True)[0][:, admitted.shape[1] :].T
    extra = sp.hstack([sp.csr_array((len(forbidden), len(weight_x))), sp.csr_array(forbidden)], format="csr")
    return sp.csr_array(sp.vstack([rows, extra], format="csr"))
