"""Hard cases of boxes, images, sizes and units: contacts, energies and stresses of packings as they stand."""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts import candidate_pairs, find_contacts
from packmech.effects import Harmonic, Repulsion
from packmech.generate import lattice_packing, random_packing
from packmech.measure import energy, forces, stress_tensor
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.validation.hard_cases.case import HardCase

EPS = float(np.finfo(float).eps)
HARMONIC = (Repulsion(law=Harmonic()),)


def _packing(position_nd: list[list[float]], radius_n: list[float], lattice_dd: list[list[float]]) -> Packing:
    return Packing(np.array(position_nd), np.array(radius_n), Box(np.array(lattice_dd)))


def _key_list(packing: Packing) -> list[tuple[int, ...]]:
    contacts = find_contacts(packing)
    columns = np.column_stack([contacts.i_c, contacts.j_c, contacts.image_cd])
    return [tuple(row) for row in columns.tolist()]


def _every_pair(packing: Packing, images: int) -> list[tuple[int, ...]]:
    """Contacts by testing every pair through every image up to `images` cells away: slow, and nothing to get wrong."""
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


def _wrong_contacts(packing: Packing, images: int) -> float:
    return float(len(set(_key_list(packing)) ^ set(_every_pair(packing, images))))


def _relative(value: NDArray[np.float64] | float, reference: NDArray[np.float64] | float) -> float:
    scale = float(np.max(np.abs(reference)))
    return float(np.max(np.abs(np.asarray(value) - reference))) / scale


def _single_cell(name: str, dimension: int, contacts_each: int) -> float:
    """Stress of a one-particle cell against the closed form of n contacts of overlap xi in d dimensions."""
    overlap = 0.01
    packing = lattice_packing(name, repeats=(1,) * dimension, relative_overlap=overlap)
    sigma = packing.reference_diameter
    if len(find_contacts(packing)) != contacts_each:
        return math.inf
    # u' r = -(eps xi / sigma) sigma (1 - xi), shared alike by the axes
    pressure = contacts_each * overlap * (1.0 - overlap) / (dimension * packing.box.volume)
    scene = Scene(packing, HARMONIC)
    return max(
        _relative(stress_tensor(scene), -pressure * np.eye(dimension)),
        float(np.abs(forces(scene)).max()) * sigma,
        abs(energy(scene) / (0.5 * contacts_each * overlap**2) - 1.0),
    )


def _flat_box() -> float:
    return _wrong_contacts(_packing([[0.1, 0.01], [0.7, 0.02]], [0.5, 0.35], [[3.0, 0.4], [0.0, 0.0503]]), 22)


def _tilted() -> float:
    """Energy, forces and stress in a box sheared by 10 and a bit, against the same packing in its reduced cell."""
    start = random_packing(60, dimension=3, packing_fraction=0.8, seed=4)
    shear = np.array([[0.0, 10.3, -9.7], [0.0, 0.0, 10.1], [0.0, 0.0, 0.0]])
    sheared = start.box.strained(shear)
    position_nd = start.position_nd @ (np.eye(3) + shear).T
    tilted = Packing(position_nd, start.radius_n, sheared)
    compact, _ = sheared.reduced()
    short = Packing(compact.wrap(position_nd)[0], start.radius_n, compact)
    one, other = Scene(tilted, HARMONIC), Scene(short, HARMONIC)
    if len(find_contacts(tilted)) != len(find_contacts(short)):
        return math.inf
    return max(
        _relative(energy(one), energy(other)),
        _relative(forces(one), forces(other)),
        _relative(stress_tensor(one), stress_tensor(other)),
    )


def _tilted_contacts() -> float:
    packing = random_packing(20, dimension=2, packing_fraction=0.9, seed=5, box=[[1.0, 10.0], [0.0, 1.0]])
    return _wrong_contacts(packing, 13)


def _wide_sizes() -> Packing:
    """Discs of 1000 : 1: six large ones, and 600 small ones of which many lie on the rims of the large."""
    rng = np.random.default_rng(8)
    side = 5000.0
    large_nd = rng.random((6, 2)) * side
    angle = rng.random(600) * 2.0 * math.pi
    owner = rng.integers(0, 6, 600)
    rim = 500.0 + rng.uniform(-0.4, 0.6, 600)
    small_nd = large_nd[owner] + rim[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    radius_n = np.concatenate([np.full(6, 500.0), np.full(600, 0.5)])
    return Packing(np.concatenate([large_nd, small_nd]), radius_n, Box.cubic(side, 2))


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
    packing = Packing(position_nd, radius_n, Box.cubic(2000.0, 2))
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0, skin=0.1)
    return len(pairs.i_c) / len(find_contacts(packing))


def _in_units(length: float) -> float:
    """Energy, stress and contacts in another unit of length and of energy, against ordinary numbers."""
    packing = random_packing(64, dimension=2, packing_fraction=0.9, seed=6)
    scaled = Packing(packing.position_nd * length, packing.radius_n * length, packing.box.scaled(length))
    plain = Scene(packing, HARMONIC)
    other = Scene(scaled, (Repulsion(law=Harmonic(energy_scale=length)),))
    if len(find_contacts(scaled)) != len(find_contacts(packing)):
        return math.inf
    return max(
        abs(energy(other) / length / energy(plain) - 1.0),
        _relative(forces(other), forces(plain)),
        _relative(stress_tensor(other) * length, stress_tensor(plain)),
    )


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
        partial(_in_units, 1e-12),
    ),
    HardCase(
        "units of 1e12",
        "absolute tolerances hidden in the code",
        "relative difference of energy, forces and stress to ordinary units",
        1e-12,
        "scaling rounds each position once: 2e-16 x 8 diameters over the mean overlap, 64 particles",
        partial(_in_units, 1e12),
    ),
)
