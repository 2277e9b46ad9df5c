"""Linear response of particles under rigid links: sparse systems of positions and link forces together.

The system [[H, h G^T], [h G, 0]] (G the gradients of the link lengths, h a typical stiffness) is indefinite. It is
factored with -h * SLACK in place of the zeros, as if links were springs of that compliance; refinement against the
true system takes the slack out again. Slack much smaller would lose digits of soft motions to rounding; the factor's
negative pivots less one for each link are the unstable motions (Sylvester, Haynsworth).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.mechanics.factor import Factorization, NotDefinite, factorize

SLACKS = (1e-5, 1e-8, 1e-11)
# eigenvalues below this fraction of their scale are zero, as for packings without links
SOFT = 1e-10
_REFINEMENTS = 30
_DONE = 1e-13


class LinkedSystem(NamedTuple):
    """A Hessian and independent link gradients, scaled alike."""

    matrix: sp.csr_array
    gradient: sp.csr_array
    stiffness: float

    @property
    def exact(self) -> sp.csr_array:
        """The system without slack."""
        side = self.stiffness * self.gradient
        return sp.csr_array(sp.block_array([[self.matrix, side.T], [side, None]], format="csr"))


class LinkedResponse(NamedTuple):
    """Response (rows, k) of the positions, multipliers (L, k), and what the constrained Hessian is like."""

    response: NDArray[np.float64]
    multiplier: NDArray[np.float64]
    negative: int
    floppy: int
    residual: float


def linked_system(matrix: sp.csr_array, gradient: sp.csr_array) -> LinkedSystem:
    """Return the system of a Hessian and the gradients of independent links."""
    diagonal = np.abs(matrix.diagonal())
    firm = diagonal > 0.0
    return LinkedSystem(matrix, gradient, float(diagonal[firm].mean()) if firm.any() else 1.0)


def soft_shift(matrix: sp.csr_array) -> sp.dia_array:
    """Return a diagonal that is small against each row's own stiffness, and never zero."""
    diagonal = np.abs(matrix.diagonal())
    firm = diagonal > 0.0
    mean = float(diagonal[firm].mean()) if firm.any() else 1.0
    return sp.diags_array(SOFT * np.where(diagonal > SOFT * mean, diagonal, mean))


def no_shift(matrix: sp.csr_array) -> sp.dia_array:
    """Return a diagonal of zeros."""
    return sp.diags_array(np.zeros(matrix.shape[0]))


def factor_linked(system: LinkedSystem, shift: sp.dia_array, slack: float, dimension: int) -> Factorization:
    """Return the factored system with a shifted Hessian, and slack in the links."""
    side = system.stiffness * system.gradient
    corner = -slack * system.stiffness * sp.eye_array(side.shape[0])
    whole = sp.csr_array(sp.block_array([[system.matrix + shift, side.T], [side, corner]], format="csr"))
    # three dimensions fill in: supernodes win by far
    for backend in ("rslab", "auto") if dimension == 3 else ("auto", "rslab"):
        try:
            return factorize(whole, kind="symmetric", backend=backend)
        except NotDefinite as failure:
            reason = failure
    raise reason


def negative_motions(system: LinkedSystem, shift: sp.dia_array, dimension: int) -> int:
    """Return how many eigenvalues of the shifted Hessian on the motions that the links admit are negative."""
    factor = factor_linked(system, shift, SLACKS[0], dimension)
    return int(factor.inertia.negative - system.gradient.shape[0])


def relax_linked(
    system: LinkedSystem, right: NDArray[np.float64], lengths: NDArray[np.float64], push: float, dimension: int
) -> LinkedResponse:
    """Return u and m with H u + G^T m = right and G u = lengths, and the counts of unstable and of zero motions.

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
    if not rows:
        return LinkedResponse(np.zeros_like(right), np.zeros_like(lengths), 0, 0, 0.0)
    shift = soft_shift(system.matrix)
    factor = factor_linked(system, -shift, SLACKS[0], dimension)
    floor = factor.inertia.negative - count
    if floor:
        factor = factor_linked(system, shift, SLACKS[0], dimension)
    else:
        # no motion is soft: one factorization counts and solves
        shift = -shift
    negative = factor.inertia.negative - count
    exact = system.exact
    load = np.concatenate([right, system.stiffness * lengths])
    # an unloaded system is balanced; so is one whose links move with the strain alone
    size = max(float(np.abs(load).max(initial=0.0)), push)
    best = np.zeros_like(load)
    residual = np.inf
    for slack in SLACKS:
        if slack != SLACKS[0]:
            factor = factor_linked(system, shift, slack, dimension)
        solution, left, reached = np.zeros_like(load), load, float(np.abs(load).max(initial=0.0))
        for _ in range(_REFINEMENTS):
            if reached <= _DONE * size:
                break
            better = solution + factor.solve(left)
            rest = load - exact @ better
            now = float(np.abs(rest).max(initial=0.0))
            if not now < reached:
                break
            solution, left, reached = better, rest, now
        if reached < residual:
            best, residual = solution, reached
        if residual <= 1e-9 * size:
            break
    return LinkedResponse(
        best[:rows],
        system.stiffness * best[rows:],
        negative,
        floor - negative,
        residual / push if push else 0.0,
    )
