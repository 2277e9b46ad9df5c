"""How the coordinates of a system relax under unit strains: one solve with what links hold, and what it is like."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.linalg.factor import NotDefinite, factor_saddle, factorize
from packmech.mechanics.linked_systems import LinkedSystem, linked_system, relax_linked, soft_shift
from packmech.mechanics.system import System

# a matrix whose transpose differs by less, over its largest entry, is symmetric but for rounding
_SYMMETRIC = 1e-12
_REFINEMENTS = 12


class RelaxedStrains(NamedTuple):
    """The (s, s) stiffness that relaxation takes from the strains, what the system is like, and (x, s) motions.

    `negative` and `floppy` count negative and zero eigenvalues, of the symmetric part where there is no energy: motions
    whose second-order work is negative or none. `residual` is what stays unbalanced, over the largest force of a
    contact under a unit strain. Motions are those of all coordinates; zeros where an energy has links.
    """

    relief_ee: NDArray[np.float64]
    negative: int
    floppy: int
    residual: float
    motion_xe: NDArray[np.float64]


def is_symmetric(matrix: sp.csr_array) -> bool:
    """Return whether a matrix is symmetric but for rounding."""
    return not matrix.nnz or bool(abs(matrix - matrix.T).max() <= _SYMMETRIC * abs(matrix).max())


def general_factors(matrix: Any, soft: NDArray[np.float64] | None = None) -> Any:
    """Return the LU factors of a matrix whose pattern is symmetric, with pivots on the diagonal where these will do.

    A singular one is factored with what is added to its diagonal instead, where that is given: `refine` takes it back.
    """
    if soft is not None:
        try:
            return general_factors(matrix)
        except RuntimeError:
            return general_factors(matrix + sp.diags_array(soft))
    symmetric = {"SymmetricMode": True}
    return spla.splu(sp.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options=symmetric)


def relax(system: System) -> RelaxedStrains:
    """Return how the coordinates of a system relax under unit Mandel strains, its best connected particle at its place.

    Parameters
    ----------
    system
        The second derivatives; with links these keep their lengths, their forces further unknowns.

    """
    pinned, strains = system.network.pinned_f, len(system.corner)
    if not pinned.any():
        return RelaxedStrains(np.zeros((strains, strains)), 0, 0, 0.0, np.zeros((pinned.size, strains)))
    matrix, right, push = system.matrix(pinned), -system.column(pinned), system.push
    motion = np.zeros((pinned.size, strains))
    if len(system.links):
        gradient, stretch = system.network.link_rows
        linked = linked_system(matrix, gradient[:, pinned])
        if not system.assembled.symmetric:
            solution, negative, floppy, left = _solve_linked(linked, right, -stretch, system.network.dimension)
            motion[pinned] = solution[: len(right)]
            held = np.vstack([system.row(pinned).T, linked.stiffness * stretch])
            return RelaxedStrains(-held.T @ solution, negative, floppy, left / push if push else 0.0, motion)
        found = relax_linked(linked, right, -stretch, push, system.network.dimension)
        return RelaxedStrains(found.relief, found.negative, found.floppy, found.residual, motion)
    if system.assembled.symmetric:
        solution, negative, floppy, left = _solve(matrix, right)
        relief = right.T @ solution
    else:
        solution, negative, floppy, left = _solve_general(matrix, right)
        relief = -system.row(pinned) @ solution
    motion[pinned] = solution
    return RelaxedStrains(relief, negative, floppy, left / push if push else 0.0, motion)


class Factored(NamedTuple):
    """A symmetric system, factored once: what it is like, and its factors, shifted where it is singular."""

    matrix: sp.csr_array
    factor: Any
    negative: int
    floppy: int
    singular: bool

    def solve(self, right: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return the solution, without zero modes where there are such, and what is left unbalanced."""
        solution = self.factor.solve(right)
        left = right - self.matrix @ solution
        if not self.singular:
            return solution, float(np.abs(left).max())
        return refine(self.matrix, right, self.factor.solve, solution, left, gain=1.0)


def factored(matrix: sp.csr_array) -> Factored:
    """Return a symmetric system factored, with its negative and zero eigenvalues counted."""
    try:
        factor = factorize(matrix, kind="symmetric")
        if not factor.inertia.zero:
            return Factored(matrix, factor, factor.inertia.negative, 0, False)
    except NotDefinite:
        pass
    # counts by two definite shifts, then a solution without zero modes by refinement from the shifted factorization
    return Factored(matrix, *_shifted(matrix), True)


def _solve(matrix: sp.csr_array, right: NDArray[np.float64]) -> tuple[NDArray[np.float64], int, int, float]:
    """Return the solution of a symmetric system, negative and zero eigenvalues, and what is left unbalanced."""
    system = factored(matrix)
    solution, left = system.solve(right)
    return solution, system.negative, system.floppy, left


def _solve_general(matrix: sp.csr_array, right: NDArray[np.float64]) -> tuple[NDArray[np.float64], int, int, float]:
    """Return the same of a system without symmetry, whose counts are those of its symmetric part."""
    even = sp.csr_array(matrix + matrix.T) / 2.0
    _, negative, floppy = _shifted(even)
    solve = None
    if is_symmetric(matrix) and not floppy:
        try:
            solve = factorize(even, kind="symmetric").solve
        except NotDefinite:
            floppy = 1
    if solve is None:
        # zero modes, which the symmetric part does not show where contacts slide or carry tangential forces, do not
        # stand in the way of a shifted factorization; refinement takes the shift back
        solve = general_factors(matrix + sp.diags_array(soft_shift(even))).solve
    solution = np.asarray(solve(right))
    solution, size = refine(matrix, right, solve, solution, right - matrix @ solution, gain=0.5)
    return solution, negative, floppy, size


def _solve_linked(
    system: LinkedSystem, right: NDArray[np.float64], lengths: NDArray[np.float64], dimension: int
) -> tuple[NDArray[np.float64], int, int, float]:
    """Return the same of a system without symmetry, with the links' forces (over the unit of their rows) appended."""
    even, count = sp.csr_array(system.matrix + system.matrix.T) / 2.0, system.gradient.shape[0]
    shift = soft_shift(even)
    lower, upper = (
        factor_saddle(
            sp.csr_array(even + sp.diags_array(sign * shift)), system.gradient, dimension, stiffness=system.stiffness
        ).inertia.negative
        - count
        for sign in (-1.0, 1.0)
    )
    load = np.vstack([right, system.stiffness * lengths])
    solve = spla.splu(sp.csc_array(system.exact + sp.diags_array(np.concatenate([shift, np.zeros(count)])))).solve
    solution = np.asarray(solve(load))
    solution, size = refine(system.exact, load, solve, solution, load - system.exact @ solution, gain=0.5)
    return solution, upper, lower - upper, size


def _shifted(matrix: sp.csr_array) -> tuple[Any, int, int]:
    """Return the factored matrix with a small positive shift, and the numbers of negative and of zero eigenvalues."""
    shift = sp.diags_array(soft_shift(matrix))
    factor = factorize(matrix + shift, kind="symmetric")
    negative = factor.inertia.negative
    return factor, negative, factorize(matrix - shift, kind="symmetric").inertia.negative - negative


def refine(
    matrix: sp.csr_array,
    right: NDArray[np.float64],
    solve: Any,
    solution: NDArray[np.float64],
    left: NDArray[np.float64],
    gain: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the solution refined while what is left shrinks below `gain` times what it was, and how much is left."""
    size = float(np.abs(left).max())
    for _ in range(_REFINEMENTS):
        better = solution + solve(left)
        rest = right - matrix @ better
        reached = float(np.abs(rest).max())
        if not reached < gain * size:
            break
        solution, left, size = better, rest, reached
    return solution, size
