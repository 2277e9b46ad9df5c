"""Hard cases of matrices: redundant self stress, and factorizations that must notice what they are given."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import scipy.sparse as sp

from packmech.generate import lattice_packing
from packmech.linalg.factor import NotDefinite, factorize
from packmech.mechanics.rigidity import rigidity_matrix
from packmech.validation.hard_cases.case import HardCase


def _redundant(name: str, repeats: tuple[int, ...]) -> float:
    """Error in contacts - rank, the number of self stresses: the rank must be d (N - 1), all but the translations."""
    packing = lattice_packing(name, repeats=repeats)
    matrix = rigidity_matrix(packing, "none", gap_tolerance=1e-9)
    freedoms = packing.dimension * (packing.particles - 1)
    singular = np.linalg.svd(matrix.toarray(), compute_uv=False)
    rank = int(np.count_nonzero(singular > 1e-10 * singular[0]))
    return float(abs(rank - freedoms))


def _residual(matrix: sp.csc_array, inertia: tuple[int, int, int], backend: str) -> float:
    """Relative residual of a solve, infinite for a wrong inertia."""
    factor = factorize(matrix, kind="symmetric", backend=backend)
    if factor.inertia != inertia:
        return math.inf
    right = np.random.default_rng(12).normal(size=matrix.shape[0])
    return float(np.linalg.norm(matrix @ factor.solve(right) - right) / np.linalg.norm(right))


def _indefinite(backend: str) -> float:
    """Return the figure for a chain of 400 springs less 1.1, whose eigenvalues are 0.9 - 2 cos(k pi / 401)."""
    size = 400
    eigenvalue_m = 0.9 - 2.0 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1))
    negative = int(np.count_nonzero(eigenvalue_m < 0.0))
    matrix = sp.csc_array(sp.diags_array([0.9, -1.0, -1.0], offsets=[0, 1, -1], shape=(size, size)))
    return _residual(matrix, (size - negative, negative, 0), backend)


def _saddle() -> float:
    """[K G; G' 0] with K definite and G of full rank has as many negative eigenvalues as G has columns."""
    rng = np.random.default_rng(11)
    size, rows = 120, 30
    chain = sp.diags_array(
        [np.linspace(1.0, 3.0, size), np.full(size - 1, -0.4), np.full(size - 1, -0.4)], offsets=[0, -1, 1]
    )
    border = sp.random_array((size, rows), density=0.08, rng=rng) + sp.eye_array(size, rows)
    return _residual(sp.csc_array(sp.block_array([[chain, border], [border.T, None]])), (size, rows, 0), "auto")


def _silent(backend: str) -> float:
    """How many of three indefinite or singular matrices pass as positive definite."""
    chain = sp.csc_array(sp.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(50, 50)))
    ring = chain.tolil()
    ring[0, -1] = ring[-1, 0] = -1.0
    barely = chain - 1e-6 * sp.eye_array(50) - (2.0 - 2.0 * math.cos(math.pi / 51)) * sp.eye_array(50)
    passed = 0
    for matrix in (-chain, sp.csc_array(ring), sp.csc_array(barely)):
        try:
            factorize(matrix, kind="definite", backend=backend)
            passed += 1
        except NotDefinite:
            pass
    return float(passed)


CASES = (
    HardCase(
        "triangular crystal, 8 x 8",
        "192 contacts on 126 freedoms: dozens of exactly redundant states of self stress blur the rank",
        "error in the number of states of self stress",
        0.0,
        "N + 2 = 66 by counting: 3N contacts, rank 2N - 2 because the crystal is rigid up to translations",
        partial(_redundant, "triangular", (8, 8)),
    ),
    HardCase(
        "fcc crystal, 4 x 4 x 4",
        "384 contacts on 189 freedoms",
        "error in the number of states of self stress",
        0.0,
        "3N + 3 by counting: 6N contacts, rank 3N - 3",
        partial(_redundant, "fcc", (4, 4, 4)),
    ),
    *(
        HardCase(
            f"indefinite matrix, {backend}",
            "without pivoting an indefinite matrix loses digits, or the signs of its pivots",
            "relative residual of a solve (infinite for a wrong inertia)",
            1e-11,
            "condition number 2.9 / 0.0011 = 3e3 times 2e-16, and one digit for pivot growth",
            partial(_indefinite, backend),
        )
        for backend in ("qdldl", "superlu", "dense")
    ),
    HardCase(
        "saddle matrix",
        "zeros on the diagonal: the sparse backends cannot pivot, and must hand over instead of going wrong",
        "relative residual of a solve (infinite for a wrong inertia)",
        1e-12,
        "condition number below 1e3, times 2e-16, with one digit to spare",
        _saddle,
    ),
    *(
        HardCase(
            f"matrix that is not definite, {backend}",
            "an indefinite Hessian (a saddle, not a minimum) is factored without a word",
            "matrices that passed as definite: one negative, one singular, one with a single eigenvalue of -1e-6",
            0.0,
            "none may pass",
            partial(_silent, backend),
        )
        for backend in ("qdldl", "superlu", "dense")
    ),
)
