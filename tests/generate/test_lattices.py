"""Facts about crystals: particles in a cell, neighbors, packing fractions, in every choice of cell."""

import itertools
import json
import math
import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.generate import LATTICE_NAMES

GOLDEN = pathlib.Path(__file__).parents[1] / "golden" / "lattice_shells.json"

# name: particles in the primitive cell, in the conventional one, contacts of each particle of the basis, packing
# fraction (closed form)
FACTS = {
    "triangular": (1, 2, (6,), math.pi / (2 * math.sqrt(3))),
    "square": (1, 1, (4,), math.pi / 4),
    "honeycomb": (2, 4, (3,), math.pi / (3 * math.sqrt(3))),
    "kagome": (3, 6, (4,), math.pi * math.sqrt(3) / 8),
    "elongated triangular": (2, 4, (5,), math.pi / (2 + math.sqrt(3))),
    "snub square": (4, 4, (5,), math.pi / (2 + math.sqrt(3))),
    "snub hexagonal": (6, 12, (5,), math.pi * math.sqrt(3) / 7),
    "rhombitrihexagonal": (6, 12, (4,), math.pi * math.sqrt(3) / (4 + 2 * math.sqrt(3))),
    "truncated square": (4, 4, (3,), math.pi * (3 - 2 * math.sqrt(2))),
    "truncated hexagonal": (6, 12, (3,), math.pi * math.sqrt(3) / (7 + 4 * math.sqrt(3))),
    "truncated trihexagonal": (12, 24, (3,), math.pi / (3 + 2 * math.sqrt(3))),
    "reinforced kagome": (8, 16, (6, 5, 5, 5, 5, 5, 5, 6), 8 / 9 * math.pi / (2 * math.sqrt(3))),
    "filled square": (2, 2, (8, 4), math.pi / 4 * (4 - 2 * math.sqrt(2))),
    "filled triangular": (3, 6, (12, 3, 3), math.pi / (2 * math.sqrt(3)) * (1 + 2 * (2 / math.sqrt(3) - 1) ** 2)),
    "sc": (1, 1, (6,), math.pi / 6),
    "bcc": (1, 2, (8,), math.pi * math.sqrt(3) / 8),
    "fcc": (1, 4, (12,), math.pi / (3 * math.sqrt(2))),
    "hcp": (2, 4, (12,), math.pi / (3 * math.sqrt(2))),
    "diamond": (2, 8, (4,), math.pi * math.sqrt(3) / 16),
    "pyrochlore": (4, 16, (6,), math.pi / (6 * math.sqrt(2))),
    "tunneled fcc": (2, 4, (7,), math.pi * math.sqrt(2) / 9),
    "tunneled hcp": (4, 8, (7,), math.pi * math.sqrt(2) / 9),
    "filled sc": (2, 2, (14, 8), math.pi / 6 * (1 + (math.sqrt(3) - 1) ** 3)),
}

# a right angle between all vectors of the conventional cell; of the tunneled fcc crystal only in the plane
TILTED = {"tunneled fcc"}


def touching_counts(packing, tolerance):
    contacts = pm.find_contacts(packing, gap_tolerance=tolerance)
    touching_n = np.bincount(contacts.i_c, minlength=packing.particles)
    return touching_n + np.bincount(contacts.j_c, minlength=packing.particles), contacts


def shells(packing, largest):
    """Return {r^2: mean number of particles at distance r} for r <= largest, by listing all images."""
    lattice, position = packing.box.lattice_dd, packing.position_nd
    reach = np.ceil(largest / packing.box.height_d).astype(int) + 2
    images = np.array(list(itertools.product(*[range(-m, m + 1) for m in reach])))
    found = {}
    for i in range(packing.particles):
        apart = (position - position[i])[:, None, :] + (images @ lattice.T)[None]
        distance2 = (apart**2).sum(axis=-1).ravel()
        for value in distance2[(distance2 > 1e-9) & (distance2 <= largest**2 + 1e-9)]:
            key = round(float(value), 6)
            found[key] = found.get(key, 0) + 1 / packing.particles
    return found


def test_every_lattice_has_its_row_of_facts():
    assert set(FACTS) == set(LATTICE_NAMES)


@pytest.mark.parametrize("conventional", [False, True])
@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_number_of_particles_in_a_cell(name, conventional):
    assert pm.lattice_packing(name, conventional=conventional).particles == FACTS[name][conventional]


@pytest.mark.parametrize("conventional", [False, True])
@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_every_particle_touches_its_neighbors_also_when_they_are_its_own_images(name, conventional):
    packing = pm.lattice_packing(name, conventional=conventional)
    touching_n, _ = touching_counts(packing, 1e-12)
    basis = FACTS[name][2]
    assert (touching_n.reshape(-1, len(basis)) == basis).all()


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_neighbors_touch_to_rounding(name):
    contacts = pm.find_contacts(pm.lattice_packing(name, repeats=3), gap_tolerance=0.01)
    assert np.abs(contacts.gap_c).max() < 4e-15


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_packing_fraction_is_the_closed_form(name):
    for packing in (pm.lattice_packing(name), pm.lattice_packing(name, repeats=2, conventional=True)):
        assert pm.packing_fraction(packing) == pytest.approx(FACTS[name][3], rel=2e-15)


@pytest.mark.parametrize("name", sorted(json.loads(GOLDEN.read_text())["shells"]))
def test_shells_of_neighbors_agree_with_the_stored_ones(name):
    stored = json.loads(GOLDEN.read_text())["shells"][name]
    largest = min(3.0, stored[-1][0])
    found = shells(pm.lattice_packing(name), largest)
    expected = {round(r**2, 6): count for r, count in stored if r <= largest}
    assert sorted(found) == pytest.approx(sorted(expected), abs=1e-6)
    assert [found[key] for key in sorted(found)] == pytest.approx([expected[key] for key in sorted(expected)])


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_conventional_cell_is_right_angled(name):
    lattice = pm.lattice_packing(name, conventional=True).box.lattice_dd
    metric = lattice.T @ lattice
    corner = metric[:2, :2] if name in TILTED else metric
    # vectors of up to six diameters, each with rounding errors of its components
    assert np.abs(corner - np.diag(np.diag(corner))).max() < 4 * np.finfo(float).eps * np.abs(metric).max()


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_primitive_and_conventional_cells_are_the_same_crystal(name):
    primitive, conventional = (shells(pm.lattice_packing(name, conventional=c), 2.3) for c in (False, True))
    assert sorted(primitive) == pytest.approx(sorted(conventional), abs=2e-6)
    assert [primitive[k] for k in sorted(primitive)] == pytest.approx([conventional[k] for k in sorted(conventional)])


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(LATTICE_NAMES), st.data())
def test_any_integer_supercell_holds_each_particle_once_and_touches_alike(name, data):
    dimension = pm.lattice_packing(name).dimension
    entries = st.lists(st.integers(-2, 3), min_size=dimension**2, max_size=dimension**2)
    matrix = np.array(data.draw(entries)).reshape(dimension, dimension)
    cells = round(abs(np.linalg.det(matrix)))
    if cells == 0 or cells > 20:
        return
    packing = pm.lattice_packing(name, supercell=matrix)
    assert packing.particles == cells * FACTS[name][0]
    touching_n, contacts = touching_counts(packing, 1e-9)
    basis = FACTS[name][2]
    assert (touching_n.reshape(-1, len(basis)) == basis).all()
    assert np.abs(contacts.gap_c).max() < 1e-13


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_repeats_are_a_diagonal_supercell(name):
    dimension = pm.lattice_packing(name).dimension
    repeats = (3, 2, 1)[:dimension]
    assert pm.lattice_packing(name, repeats) == pm.lattice_packing(name, supercell=np.diag(repeats))


@pytest.mark.parametrize("overlap", [-0.1, 1e-9, 0.01, 0.4])
def test_relative_overlap_is_the_one_asked_for(overlap):
    packing = pm.lattice_packing("fcc", repeats=(2, 1, 3), relative_overlap=overlap)
    contacts = pm.find_contacts(packing, gap_tolerance=0.2)
    nearest = contacts.overlap_c > contacts.overlap_c.max() - 1e-6
    assert np.count_nonzero(nearest) == 6 * packing.particles
    np.testing.assert_allclose(contacts.overlap_c[nearest], overlap, atol=4e-15)


def test_diameter_scales_every_length():
    one, two = pm.lattice_packing("hcp", diameter=1.0), pm.lattice_packing("hcp", diameter=2.0)
    assert two == pm.Packing(2 * one.position_nd, 2 * one.radius_n, box=one.box.scaled(2.0))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pm.lattice_packing("hexagonal"), "name must be one of 'triangular', .* got 'hexagonal'"),
        (lambda: pm.lattice_packing("square", repeats=(2, 2, 2)), "repeats must hold 2 integers, got 3"),
        (lambda: pm.lattice_packing("square", repeats=(2, 0)), r"repeats\[1\] must be an integer at least 1, got 0"),
        (lambda: pm.lattice_packing("square", repeats=2.5), "repeats must be an integer"),
        (lambda: pm.lattice_packing("square", supercell=[[1, 2], [2, 4]]), "supercell must have a determinant other"),
        (lambda: pm.lattice_packing("square", supercell=[[1.5, 0], [0, 1]]), "supercell must be an array of integers"),
        (lambda: pm.lattice_packing("square", supercell=np.eye(3, dtype=int)), r"supercell must have shape \(2, 2\)"),
        (lambda: pm.lattice_packing("square", 2, supercell=np.eye(2, dtype=int)), "repeats must be left out"),
        (
            lambda: pm.lattice_packing("square", relative_overlap=1.0),
            "relative_overlap must be a finite number below 1",
        ),
        (lambda: pm.lattice_packing("square", diameter=-1.0), "diameter must be a finite number above 0"),
        (lambda: pm.lattice_packing("square", conventional="yes"), "conventional must be True or False, got"),
    ],
)
def test_impossible_lattice_is_refused_by_name(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()
