"""Hard cases of packings as they stand: boxes, images, sizes and units; their self stresses and factorizations."""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from packmech.contacts import candidate_pairs
from packmech.linalg.factor import NotDefinite, factorize


def _packing(position_nd: list[list[float]], radius_n: list[float], lattice_dd: list[list[float]]) -> pm.Packing:
    return pm.Packing(np.array(position_nd), np.array(radius_n), pm.Box(np.array(lattice_dd)))


def key_list(packing: pm.Packing) -> list[tuple[int, ...]]:
    """Return the contacts that the library finds, as (i, j, image)."""
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    columns = np.column_stack([contacts.i_c, contacts.j_c, contacts.image_cd])
    return [tuple(row) for row in columns.tolist()]


def every_pair(packing: pm.Packing, images: int) -> list[tuple[int, ...]]:
    """Return contacts by testing every pair through every image up to `images` cells away: slow, and simple."""
    found = []
    reach = packing.radius_n[:, None] + packing.radius_n[None, :]
    for image in itertools.product(range(-images, images + 1), repeat=packing.dimension):
        shift = packing.box.lattice_dd @ np.array(image)
        vector = packing.position_nd[None, :, :] - packing.position_nd[:, None, :] + shift
        touching = np.linalg.norm(vector, axis=2) <= reach
        for i, j in np.argwhere(touching).tolist():
            first = next((z for z in image if z != 0), 0)
            if i < j or (i == j and first > 0):
                found.append((i, j, *image))
    return sorted(found)


def _wrong_contacts(packing: pm.Packing, images: int) -> float:
    return float(len(set(key_list(packing)) ^ set(every_pair(packing, images))))


def _relative(value: NDArray[np.float64] | float, reference: NDArray[np.float64] | float) -> float:
    scale = float(np.max(np.abs(reference)))
    return float(np.max(np.abs(np.asarray(value) - reference))) / scale


def _single_cell(name: str, dimension: int, contacts_each: int) -> float:
    """Stress of a one-particle cell against the closed form of n contacts of overlap xi in d dimensions."""
    overlap = 0.01
    packing = pm.lattice_packing(name, repeats=(1,) * dimension, relative_overlap=overlap)
    sigma = packing.reference_diameter
    if len(pm.find_contacts(packing, gap_tolerance=0.0)) != contacts_each:
        return math.inf
    # u' r = -(eps xi / sigma) sigma (1 - xi), shared alike by the axes
    pressure = contacts_each * overlap * (1.0 - overlap) / (dimension * packing.box.volume)
    scene = pm.Scene(packing, HARMONIC)
    return max(
        _relative(pm.stress_tensor(scene), -pressure * np.eye(dimension)),
        float(np.abs(pm.forces(scene)).max() * sigma),
        float(abs(pm.energy(scene) / (0.5 * contacts_each * overlap**2) - 1.0)),
    )


def _flat_box() -> float:
    return _wrong_contacts(_packing([[0.1, 0.01], [0.7, 0.02]], [0.5, 0.35], [[3.0, 0.4], [0.0, 0.0503]]), 22)


def _tilted() -> float:
    """Energy, forces and stress in a box sheared by 10 and a bit, against the same packing in its reduced cell."""
    start = pm.random_packing(60, dimension=3, packing_fraction=0.8, seed=4)
    shear = np.array([[0.0, 10.3, -9.7], [0.0, 0.0, 10.1], [0.0, 0.0, 0.0]])
    sheared = start.box.strained(shear)
    position_nd = start.position_nd @ (np.eye(3) + shear).T
    tilted = pm.Packing(position_nd, start.radius_n, sheared)
    compact, _ = sheared.reduced()
    short = pm.Packing(compact.wrap(position_nd)[0], start.radius_n, compact)
    one, other = pm.Scene(tilted, HARMONIC), pm.Scene(short, HARMONIC)
    if len(pm.find_contacts(tilted, gap_tolerance=0.0)) != len(pm.find_contacts(short, gap_tolerance=0.0)):
        return math.inf
    return max(
        _relative(pm.energy(one), pm.energy(other)),
        _relative(pm.forces(one), pm.forces(other)),
        _relative(pm.stress_tensor(one), pm.stress_tensor(other)),
    )


def _tilted_contacts() -> float:
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=5, box=[[1.0, 10.0], [0.0, 1.0]])
    return _wrong_contacts(packing, 13)


def _wide_sizes() -> pm.Packing:
    """Discs of 1000 : 1: six large ones, and 600 small ones of which many lie on the rims of the large."""
    rng = np.random.default_rng(8)
    side = 5000.0
    large_nd = rng.random((6, 2)) * side
    angle = rng.random(600) * 2.0 * math.pi
    owner = rng.integers(0, 6, 600)
    rim = 500.0 + rng.uniform(-0.4, 0.6, 600)
    small_nd = large_nd[owner] + rim[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    radius_n = np.concatenate([np.full(6, 500.0), np.full(600, 0.5)])
    return pm.Packing(np.concatenate([large_nd, small_nd]), radius_n, pm.Box.cubic(side, 2))


def _wide_sizes_contacts() -> float:
    return _wrong_contacts(_wide_sizes(), 1)


def _wide_sizes_candidates() -> float:
    """Candidate pairs over contacts in a dense mixture of 3000 particles with sizes of 1000 : 1."""
    rng = np.random.default_rng(9)
    radius_n = np.concatenate([[500.0], np.full(3000, 0.5)])
    # small discs at the spacing of a dense crowd, beside the large one
    position_nd = np.concatenate(
        [[[0.0, 0.0]], np.column_stack([rng.random(3000) * 60.0 + 480.0, rng.random(3000) * 50.0])]
    )
    packing = pm.Packing(position_nd, radius_n, pm.Box.cubic(2000.0, 2))
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0, skin=0.1)
    return len(pairs.i_c) / len(pm.find_contacts(packing, gap_tolerance=0.0))


def in_units(length: float) -> float:
    """Energy, stress and contacts in another unit of length and of energy, against ordinary numbers."""
    packing = pm.random_packing(64, dimension=2, packing_fraction=0.9, seed=6)
    scaled = pm.Packing(packing.position_nd * length, packing.radius_n * length, packing.box.scaled(length))
    plain = pm.Scene(packing, HARMONIC)
    other = pm.Scene(scaled, (pm.Repulsion(law=pm.Harmonic(energy_scale=length)),))
    if len(pm.find_contacts(scaled, gap_tolerance=0.0)) != len(pm.find_contacts(packing, gap_tolerance=0.0)):
        return math.inf
    return max(
        float(abs(pm.energy(other) / length / pm.energy(plain) - 1.0)),
        _relative(pm.forces(other), pm.forces(plain)),
        _relative(pm.stress_tensor(other) * length, pm.stress_tensor(plain)),
    )


def _redundant(name: str, repeats: tuple[int, ...]) -> float:
    """Error in contacts - rank, the number of self stresses: the rank must be d (N - 1), all but the translations."""
    packing = pm.lattice_packing(name, repeats=repeats)
    matrix = pm.rigidity_matrix(packing, "none", gap_tolerance=1e-9)
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
        "one particle in a box",
        "a particle touches its own image, and codes with one image a pair miss or double it",
        "relative error of energy, stress and force of a one-disc triangular cell",
        1e-14,
        "closed form; 45 rounding errors of 2e-16 are allowed for sums of three contacts at overlap 0.01",
        partial(_single_cell, "triangular", 2, 3),
    ),
    HardCase(
        "one sphere in a box",
        "the same in three dimensions, with six self-contacts",
        "relative error of energy, stress and force of a one-sphere fcc cell",
        1e-14,
        "closed form; rounding of sums of six contacts at overlap 0.01",
        partial(_single_cell, "fcc", 3, 6),
    ),
    HardCase(
        "nearly flat box",
        "a box twenty times thinner than its particles: pairs touch through dozens of images",
        "contacts missing or invented against a test of every pair and image",
        0.0,
        "a count is right or wrong",
        _flat_box,
    ),
    HardCase(
        "box tilted by 10",
        "rounding to the nearest image misses true neighbors in skewed boxes",
        "contacts missing or invented against a test of every pair and image",
        0.0,
        "a count is right or wrong",
        _tilted_contacts,
    ),
    HardCase(
        "3D box strained to tilt 10",
        "a strained box and its reduced cell hold the same packing and must say the same",
        "relative difference of energy, forces and stress",
        1e-12,
        "positions up to 30 box sides from the origin lose 2e-16 x 100 diameters, over overlaps of 0.1",
        _tilted,
    ),
    HardCase(
        "size ratio 1000, contacts",
        "cells as large as the largest particle, or images cut at the smallest",
        "contacts missing or invented against a test of every pair",
        0.0,
        "a count is right or wrong",
        _wide_sizes_contacts,
    ),
    HardCase(
        "size ratio 1000, cost",
        "one large particle makes every small pair a candidate (4.5 million here)",
        "candidate pairs for each contact",
        2.0,
        "pairs within a skin of 0.1 diameters, random places: (1.1)^2 = 1.21 for each contact",
        _wide_sizes_candidates,
    ),
    HardCase(
        "units of 1e-12",
        "absolute tolerances hidden in the code",
        "relative difference of energy, forces and stress to ordinary units",
        1e-12,
        "scaling rounds each position once: 2e-16 x 8 diameters over the mean overlap, 64 particles",
        partial(in_units, 1e-12),
    ),
    HardCase(
        "units of 1e12",
        "absolute tolerances hidden in the code",
        "relative difference of energy, forces and stress to ordinary units",
        1e-12,
        "scaling rounds each position once: 2e-16 x 8 diameters over the mean overlap, 64 particles",
        partial(in_units, 1e12),
    ),
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
        for backend in ("blocks", "qdldl", "superlu", "dense")
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
        for backend in ("blocks", "qdldl", "superlu", "dense")
    ),
)
