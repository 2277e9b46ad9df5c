"""Hard cases of places, boxes and units: on the boundary, 1e8 images away, coincident, at contact, singular, 1e+-30."""

from __future__ import annotations

import itertools
import math
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from hard_cases.defects import strain_packing
from hard_cases.static import every_pair, in_units, key_list

EPS = float(np.finfo(float).eps)
BITS = 2.0**-16


@cache
def _dyadic(side: float = 8.0, dimension: int = 2) -> pm.Packing:
    """Return discs whose coordinates are multiples of 2^-16: moved by any number of boxes, they keep every digit."""
    count = 56 if dimension == 2 else 300
    rng = np.random.default_rng(5)
    place = np.floor(rng.random((count, dimension)) * side / BITS) * BITS
    return pm.Packing(place, np.full(count, 0.5), pm.Box.cubic(side, dimension))


def _sum_by_hand(packing: pm.Packing, images: int) -> tuple[float, NDArray[np.float64]]:
    """Return energy and forces by going through every pair and image."""
    energy, force = 0.0, np.zeros_like(packing.position_nd)
    lattice, place, radius = packing.box.lattice_dd, packing.position_nd, packing.radius_n
    for i, j, *image in every_pair(packing, images):
        vector = place[j] - place[i] + lattice @ np.array(image)
        distance, sigma = float(np.sqrt(vector @ vector)), radius[i] + radius[j]
        overlap = 1.0 - distance / sigma
        energy += 0.5 * overlap**2
        push = overlap / sigma * vector / distance
        force[j] += push
        force[i] -= push
    return energy, force


def _moved_away(images: int, sign: float) -> float:
    """Largest difference of forces and energy, over the largest, when discs are moved by multiples of the box."""
    packing = _dyadic()
    rng = np.random.default_rng(1)
    image = sign * np.floor(rng.random(packing.position_nd.shape) * images)
    moved = packing.replace(position_nd=packing.position_nd + image @ packing.box.lattice_dd.T)
    here, there = pm.Scene(packing, HARMONIC), pm.Scene(moved, HARMONIC)
    force = pm.forces(here)
    return max(
        float(np.abs(pm.forces(there) - force).max() / np.abs(force).max()),
        abs(pm.energy(there) / pm.energy(here) - 1.0),
    )


def _nearest_image(images: int) -> float:
    """Return the same figure of forces by nearest images in single precision, as on a graphics card."""
    packing = _dyadic()
    rng = np.random.default_rng(1)
    image = np.floor(rng.random(packing.position_nd.shape) * images)
    place = (packing.position_nd + image @ packing.box.lattice_dd.T).astype(np.float32)
    vector = place[None] - place[:, None]
    vector = (vector - 8.0 * np.rint(vector / 8.0)).astype(float)
    distance = np.sqrt((vector**2).sum(axis=2))
    np.fill_diagonal(distance, 2.0)
    overlap = np.maximum(1.0 - distance, 0.0)
    push = (overlap / np.maximum(distance, 1e-300))[:, :, None] * vector
    exact = pm.forces(pm.Scene(packing, HARMONIC))
    return float(np.abs(-push.sum(axis=1) - exact).max() / np.abs(exact).max())


def _on_the_boundary(dimension: int) -> float:
    """Count wrong contacts of a crystal on the faces of its box, whose particles are off by an ulp to either side."""
    side = 4
    grid = np.array(list(itertools.product(range(side), repeat=dimension)), dtype=float)
    rng = np.random.default_rng(2)
    # zero becomes the smallest number on either side, or the opposite face
    place = np.where(grid == 0.0, rng.choice([0.0, -1e-300, 5e-17, -5e-17, float(side)], size=grid.shape), grid)
    packing = pm.Packing(place, np.full(len(place), 0.5 + 1e-9), pm.Box.cubic(side, dimension))
    found = pm.find_contacts(packing, gap_tolerance=0.0)
    pairs = {(int(i), int(j)) for i, j in zip(found.i_c, found.j_c, strict=True)}
    return float(abs(len(found) - dimension * len(grid)) + abs(len(pairs) - dimension * len(grid)))


def _floored(dimension: int) -> float:
    """Return how many coordinates of that crystal x - L floor(x / L) puts outside the cell, or on its far face."""
    side, rng = 4, np.random.default_rng(2)
    grid = np.array(list(itertools.product(range(side), repeat=dimension)), dtype=float)
    place = np.where(grid == 0.0, rng.choice([0.0, -1e-300, 5e-17, -5e-17, float(side)], size=grid.shape), grid)
    wrapped = place - side * np.floor(place / side)
    return float(np.count_nonzero((wrapped < 0.0) | (wrapped >= side)))


def _at_contact() -> float:
    """Count wrong answers about pairs at contact and an ulp to either side: whether they touch, and push."""
    wrong = 0
    for way in (np.array([1.0, 0.0]), np.array([0.6, 0.8])):
        for steps, touches, pushes in ((0, True, False), (-1, True, True), (1, False, False)):
            distance = 1.0 + steps * (EPS if steps > 0 else 0.5 * EPS)
            place = np.array([[0.0, 0.0], distance * way])
            packing = pm.Packing(place, [0.5, 0.5], pm.Box.cubic(4.0, 2))
            # where the components round to another distance the case is that of the distance they have
            gap = float(np.sqrt((place[1] ** 2).sum())) - 1.0
            touches, pushes = gap <= 0.0, gap < 0.0
            scene = pm.Scene(packing, HARMONIC)
            wrong += (len(pm.find_contacts(packing, gap_tolerance=0.0)) == 1) != touches
            wrong += bool(pm.forces(scene).any()) != pushes
            wrong += pm.energy(scene) < 0.0
    return float(wrong)


def _coincident(dimension: int) -> float:
    """Largest relative error of energy and size of the force of two particles at one place, and of their sum."""
    packing = pm.Packing(np.full((2, dimension), 0.3), [0.5, 0.5], pm.Box.cubic(4.0, dimension))
    scene = pm.Scene(packing, HARMONIC)
    force = pm.forces(scene)
    size = np.sqrt((force**2).sum(axis=1))
    return float(max(abs(pm.energy(scene) / 0.5 - 1.0), np.abs(size - 1.0).max(), np.abs(force.sum(axis=0)).max()))


def _own_images(dimension: int) -> float:
    """Largest relative error of energy and forces of two particles larger than their box, against every image."""
    side, place = 0.9, np.vstack([np.zeros(dimension), np.full(dimension, 0.41)])
    packing = pm.Packing(place, [0.5, 0.4], pm.Box.cubic(side, dimension))
    scene = pm.Scene(packing, HARMONIC)
    energy, force = _sum_by_hand(packing, 3)
    return max(abs(pm.energy(scene) / energy - 1.0), float(np.abs(pm.forces(scene) - force).max()))


def _nearest_only(dimension: int) -> float:
    """Return the relative error of the energy by the nearest image of each pair alone."""
    side, vector = 0.9, np.full(dimension, 0.41)
    energy, _ = _sum_by_hand(
        pm.Packing(np.vstack([0.0 * vector, vector]), [0.5, 0.4], pm.Box.cubic(side, dimension)), 3
    )
    nearest = vector - side * np.rint(vector / side)
    return abs(0.5 * (1.0 - float(np.sqrt(nearest @ nearest)) / 0.9) ** 2 / energy - 1.0)


def _alone(dimension: int) -> float:
    """Count wrong answers about one particle that touches nothing."""
    packing = pm.Packing(np.zeros((1, dimension)), [0.5], pm.Box.cubic(4.0, dimension))
    scene = pm.Scene(packing, HARMONIC)
    run = pm.quench(scene, force_tolerance=1e-8, check=False)
    moved = pm.simulate(scene, steps=100, dt=0.01, velocity_nd=np.ones((1, dimension)))
    verdict = pm.classify_jamming(packing)
    wrong = [
        pm.energy(scene) != 0.0,
        bool(pm.forces(scene).any()),
        pm.pressure(scene) != 0.0,
        run.outcome is not pm.Outcome.UNJAMMED,
        bool(np.abs(moved.packing.position_nd - 1.0).max() > 1e-13),
        verdict.collective != "not jammed" or verdict.strict != "not jammed",
        not pm.find_rattlers(packing).all(),
        pm.coordination_number(packing) != 0.0,
        pm.elastic_moduli(scene).bulk_modulus != 0.0,
        len(pm.normal_modes(scene)) != 0,
    ]
    return float(sum(wrong))


def _singular(steps: int) -> float:
    """Largest difference, over the largest, of forces in a box and in one of vectors a million times as long."""
    packing = _dyadic()
    slant = np.array([[1, steps], [0, 1]]) @ np.array([[1, 0], [steps, 1]])
    lattice = packing.box.lattice_dd @ slant.astype(float)
    thin = pm.Scene(packing.replace(box=pm.Box(lattice)), HARMONIC)
    force = pm.forces(pm.Scene(packing, HARMONIC))
    return float(np.abs(pm.forces(thin) - force).max() / np.abs(force).max())


def _fractions(steps: int) -> float:
    """Return the same of forces by rounding the fractions of vectors along those lattice vectors."""
    packing = _dyadic()
    slant = np.array([[1, steps], [0, 1]]) @ np.array([[1, 0], [steps, 1]])
    lattice = packing.box.lattice_dd @ slant.astype(float)
    vector = packing.position_nd[None] - packing.position_nd[:, None]
    vector = vector - np.rint(vector @ np.linalg.inv(lattice).T) @ lattice.T
    distance = np.sqrt((vector**2).sum(axis=2))
    np.fill_diagonal(distance, 2.0)
    push = (np.maximum(1.0 - distance, 0.0) / np.maximum(distance, 1e-300))[:, :, None] * vector
    exact = pm.forces(pm.Scene(packing, HARMONIC))
    return float(np.abs(-push.sum(axis=1) - exact).max() / np.abs(exact).max())


def _refused() -> float:
    """Count singular boxes, of four, that are taken."""
    taken = 0
    for lattice in (
        [[1.0, 1.0], [1.0, 1.0]],
        [[1.0, 1.0], [0.0, 1e-13]],
        [[1.0, 0.0], [0.0, 0.0]],
        [[3.0, 1.0], [9.0, 3.0]],
    ):
        try:
            pm.Box(np.array(lattice))
            taken += 1
        except ValueError as refusal:
            taken += "lattice_dd" not in str(refusal)
    return float(taken)


def _long_box(cells: int) -> float:
    """Largest relative difference of energy per disc, stress and moduli of one cell and of a row of them."""
    cell = pm.lattice_packing("triangular", repeats=(1, 1), relative_overlap=0.01)
    lattice = cell.box.lattice_dd
    place = np.arange(cells)[:, None] * lattice[:, 0]
    row = pm.Packing(place, np.full(cells, cell.radius_n[0]), pm.Box(lattice * np.array([cells, 1.0])))
    one, many = pm.Scene(cell, HARMONIC), pm.Scene(row, HARMONIC)
    stress, moduli = pm.stress_tensor(one), pm.elastic_moduli(one).cauchy
    return max(
        abs(pm.energy(many) / pm.energy(one) / cells - 1.0),
        float(np.abs(pm.stress_tensor(many) - stress).max() / np.abs(stress).max()),
        float(np.abs(pm.elastic_moduli(many).cauchy - moduli).max() / np.abs(moduli).max()),
    )


def _long_random() -> float:
    """Residual of the quench of 300 discs in a box a thousand times as long as high, contacts tested by every image."""
    packing = pm.random_packing(300, dimension=2, packing_fraction=4.0, seed=4, box=[[1000.0, 0.0], [0.0, 1.0]])
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-8, check=False)
    found = set(key_list(run.packing))
    if found != set(every_pair(run.packing, 7)) or not any(i < j for i, j, *_ in found):
        return math.inf
    return run.residual if run.ok else math.inf


STRAIN = 100.25


def _strained_back() -> float:
    """Relative error of the energy after a strain of 100, wrapping into the box there, and the strain back."""
    start = pm.random_packing(60, dimension=2, packing_fraction=0.95, seed=4)
    strain = np.array([[0.0, STRAIN], [0.0, 0.0]])
    there = strain_packing(start, strain).wrapped()
    back = strain_packing(there, -strain)
    return abs(pm.energy(pm.Scene(back, HARMONIC)) / pm.energy(pm.Scene(start, HARMONIC)) - 1.0)


def _strained_contacts() -> float:
    """Count contacts missing or invented at strain 100, against every pair and image."""
    start = pm.random_packing(20, dimension=2, packing_fraction=0.95, seed=4)
    there = strain_packing(start, np.array([[0.0, STRAIN], [0.0, 0.0]])).wrapped()
    lattice = there.box.lattice_dd
    found = set()
    reach = there.radius_n[:, None] + there.radius_n[None, :]
    for up in range(-2, 3):
        middle = round(-up * STRAIN)
        for along in range(middle - 205, middle + 206):
            shift = lattice @ np.array([along, up])
            vector = there.position_nd[None] - there.position_nd[:, None] + shift
            for i, j in np.argwhere(np.sqrt((vector**2).sum(axis=2)) <= reach).tolist():
                if i < j or (i == j and (along > 0 or (along == 0 and up > 0))):
                    found.add((i, j, along, up))
    return float(len(found ^ set(key_list(there))))


def _reduced() -> float:
    """Return by how much the longest vector of the reduced box is longer than the side, at strains of 0 to 100."""
    box = pm.Box.cubic(1.0, 2)
    worst = 0.0
    for gamma in np.linspace(0.0, STRAIN, 97):
        short, change = box.strained([[0.0, gamma], [0.0, 0.0]]).reduced()
        if abs(round(float(np.linalg.det(change)))) != 1:
            return math.inf
        worst = max(worst, float(np.sqrt((short.lattice_dd**2).sum(axis=0)).max()))
    return worst


def _verdicts(length: float) -> float:
    """Count wrong verdicts of three crystals in another unit of length."""
    wrong = 0
    for name, collective, strict in (
        ("triangular", "jammed", "jammed"), ("square", "not jammed", "not jammed"), ("fcc", "jammed", "jammed"),
    ):  # fmt: skip
        crystal = pm.lattice_packing(name, repeats=2)
        scaled = pm.Packing(crystal.position_nd * length, crystal.radius_n * length, crystal.box.scaled(length))
        verdict = pm.classify_jamming(scaled)
        wrong += (verdict.collective != collective) + (verdict.strict != strict)
    return float(wrong)


def _swinging(length: float, energy: float, mass: float) -> float:
    """Difference of places after 500 steps in other units of length, energy and mass."""
    start = pm.random_packing(24, dimension=2, packing_fraction=0.9, seed=6)
    time = length * math.sqrt(mass / energy)
    ends = []
    for lengths, energies, masses, times in ((1.0, 1.0, 1.0, 1.0), (length, energy, mass, time)):
        packing = pm.Packing(
            start.position_nd * lengths, start.radius_n * lengths, start.box.scaled(lengths), mass_n=np.full(24, masses)
        )
        scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic(energies)),))
        run = pm.simulate(scene, steps=100, dt=0.02 * times)
        ends.append(run.packing.position_nd / lengths)
    return float(np.abs(ends[1] - ends[0]).max())


CASES = (
    *(
        HardCase(
            f"up to {images:.0e} boxes away, {name}",
            "wrapping by a product rounds, and pairs across many images lose their overlap",
            "largest difference of forces and energy to the same discs in the cell, over the largest",
            0.0,
            "coordinates are multiples of 2^-16 and the side is 8: every difference is exact",
            partial(_moved_away, images, sign),
            partial(_nearest_image, images),
        )
        for images, sign, name in ((10**4, -1.0, "negative"), (10**8, 1.0, "positive"), (10**8, -1.0, "negative"))
    ),
    *(
        HardCase(
            f"on the faces of the box, {dimension}D",
            "-1e-300 is wrapped onto the far face, which is outside: contacts twice, or not at all",
            "error in the number of contacts and of pairs that touch",
            0.0,
            "every particle of the crystal touches 2 d others",
            partial(_on_the_boundary, dimension),
            partial(_floored, dimension),
        )
        for dimension in (2, 3)
    ),
    HardCase(
        "at contact, and an ulp to either side",
        "what just touches is a contact without a force, and a law asked for there may push or pull",
        "wrong answers of 18: touching, pushing, negative energy",
        0.0,
        "signs of gaps that are exact differences",
        _at_contact,
    ),
    *(
        HardCase(
            f"two particles at one place, {dimension}D",
            "no direction: NaN, no force, or forces that do not cancel",
            "largest error of energy, size and sum of the forces",
            1e-15,
            "1/2 and 1 by the harmonic law at full overlap; unit vectors round by 2e-16, each",
            partial(_coincident, dimension),
            "vector over distance: 0/0",
        )
        for dimension in (2, 3)
    ),
    *(
        HardCase(
            f"two particles larger than their box, {dimension}D",
            "they touch each other through several images, and their own",
            "largest relative error of energy and forces against a sum over every image",
            1e-13,
            "sums of dozens of contacts that round by 2e-16 each, over energies of 1",
            partial(_own_images, dimension),
            partial(_nearest_only, dimension),
        )
        for dimension in (2, 3)
    ),
    *(
        HardCase(
            f"one particle alone, {dimension}D",
            "sums over nothing, matrices without rows, means of nothing",
            "wrong answers of ten: energy, force, pressure, quench, motion, verdict, rattler, contacts, modulus, modes",
            0.0,
            "nothing acts on it",
            partial(_alone, dimension),
        )
        for dimension in (2, 3)
    ),
    *(
        HardCase(
            f"box of vectors {steps**2:.0e} times too long",
            "neighbors are found along lattice vectors that are all but parallel",
            "largest difference of forces to those in the square box of the same lattice, over the largest",
            0.0,
            "vectors are whole multiples of 8, and reduce to it without rounding",
            partial(_singular, steps),
            partial(_fractions, steps),
        )
        for steps in (10, 1000)
    ),
    HardCase(
        "singular boxes",
        "a box without a volume has no contacts, infinitely many, or a crash",
        "boxes of four that are taken, or refused without naming the lattice",
        0.0,
        "a clear refusal",
        _refused,
    ),
    HardCase(
        "a crystal in a box 1000 times as long as high",
        "the same packing as one cell, by contacts with own images along one axis and others along the other",
        "largest relative difference of energy per disc, stress and moduli",
        1e-9,
        "overlaps of .01 at coordinates of 1000 are rounded by 1.1e-13",
        partial(_long_box, 1000),
        "one image for each pair: two contacts of three are missed",
    ),
    HardCase(
        "a random packing in a box 1000 times as long as high",
        "cells one deep: neighbors are looked for twice, or missed, across the short side",
        "residual of the quench (infinite if contacts are not those of a test of every pair and image)",
        1e-8,
        "the tolerance asked for",
        _long_random,
    ),
    HardCase(
        "strain 100 and back, wrapped there",
        "images taken off in the strained box are others than those of the box at the start",
        "relative error of the energy",
        1e-9,
        "coordinates of 700 are rounded by 1.1e-13, twice, over overlaps of .1, and their sums",
        _strained_back,
    ),
    HardCase(
        "contacts at strain 100",
        "rounding to the nearest image misses true neighbors in skewed boxes",
        "contacts missing or invented against a test of every pair and image",
        0.0,
        "a count is right or wrong",
        _strained_contacts,
    ),
    HardCase(
        "box reduced at strains of 0 to 100",
        "a lattice that is reduced by rounding keeps a vector that is not among the shortest",
        "length of the longest reduced vector over the side (infinite if the change is no change of basis)",
        math.sqrt(1.25) + 1e-12,
        "Gauss: the second shortest vector of a sheared square lattice is (1/2, 1) at most",
        _reduced,
        lambda: math.sqrt(1.0 + STRAIN**2),
    ),
    *(
        case
        for length in (1e-30, 1e30)
        for case in (
            HardCase(
                f"units of {length:.0e}",
                "absolute tolerances hidden in the code, squares that vanish or overflow",
                "relative difference of energy, forces and stress to ordinary units",
                1e-12,
                "scaling rounds each position once: 2e-16 x 8 diameters over the mean overlap, 64 particles",
                partial(in_units, length),
                "single precision: squares of 1e-30 are zero, of 1e30 infinite",
            ),
            HardCase(
                f"units of {length:.0e}, verdicts",
                "gaps compared with a length that is none",
                "wrong answers of six about three crystals",
                0.0,
                "jamming has no unit (Rev. Mod. Phys. 82, 2633, table II)",
                partial(_verdicts, length),
            ),
            HardCase(
                f"units of {length:.0e}, motion",
                "a time step, or a limit of speed, that is absolute",
                "largest difference of places after 100 steps, in diameters",
                1e-12,
                "scaling rounds by 2e-16 x 8, which grows by e^(w t) at most, w^2 = 6 k / m, in two units of time: 130",
                partial(_swinging, length, 1.0 / length, length),
            ),
        )
    ),
)
