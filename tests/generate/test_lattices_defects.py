"""Facts about flaws put into crystals on purpose: what opens, by how much, and what must not change."""

import math

import numpy as np
import pytest
from hard_cases.defects import open_contact, random_strain, resize_particle, strain_packing

import packmech as pm

DISCS = [
    ("triangular", 1),
    ("triangular", 2),
    ("triangular", 3),
    ("snub square", 2),
    ("filled square", 2),
    ("kagome", 2),
]


def gaps(packing, within=0.05):
    contacts = pm.find_contacts(packing, gap_tolerance=within)
    return contacts.gap_c / contacts.contact_distance_c


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize(("name", "repeats"), DISCS)
def test_one_contact_opens_by_the_gap_and_all_others_stay_shut_to_rounding(name, repeats, gap):
    crystal = pm.lattice_packing(name, repeats)
    count = len(gaps(crystal))
    for contact in (0, count - 1):
        found = gaps(open_contact(crystal, contact, gap))
        assert len(found) == count
        # coordinates of up to six diameters
        assert found[contact] == pytest.approx(gap, abs=8e-15)
        assert np.abs(np.delete(found, contact)).max() < 8e-15


def test_a_gap_of_nothing_leaves_the_crystal_as_it_is_to_rounding():
    crystal = pm.lattice_packing("triangular", 3)
    same = open_contact(crystal, 7, 0.0)
    np.testing.assert_allclose(same.position_nd, crystal.position_nd, atol=1e-15)
    np.testing.assert_allclose(same.radius_n, crystal.radius_n, atol=1e-15)


@pytest.mark.parametrize("gap", [1e-6, 2e-6])
def test_the_changes_that_open_a_contact_are_proportional_to_the_gap(gap):
    crystal = pm.lattice_packing("triangular", 3)
    one, two = (open_contact(crystal, 4, g).radius_n - crystal.radius_n for g in (gap, 2 * gap))
    np.testing.assert_allclose(two, 2 * one, atol=20 * gap**2)


def test_no_single_contact_of_fcc_opens_alone():
    with pytest.raises(ValueError, match="contact must be one that can open while the others stay closed, got 3,"):
        open_contact(pm.lattice_packing("fcc", 2), 3, 1e-6)


def test_a_smaller_radius_opens_all_contacts_of_its_particle_by_half_as_much():
    crystal = pm.lattice_packing("triangular", 3)
    found = gaps(resize_particle(crystal, 4, 1 - 2e-4))
    assert np.count_nonzero(found > 1e-12) == 6
    # gap over the sum of radii: 1e-4 / (1 - 1e-4)
    np.testing.assert_allclose(found[found > 1e-12], 1e-4 / (1 - 1e-4), rtol=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
def test_random_strain_changes_lengths_by_its_size_at_most_and_once(dimension):
    strain_dd = random_strain(dimension, 1e-9, seed=3)
    assert np.array_equal(strain_dd, strain_dd.T)
    assert np.abs(np.linalg.eigvalsh(strain_dd)).max() == pytest.approx(1e-9, rel=1e-12)
    assert not np.array_equal(strain_dd, random_strain(dimension, 1e-9, seed=4))


@pytest.mark.parametrize("size", [1e-9, 1e-3])
def test_strained_crystals_have_the_gaps_of_their_strained_contact_vectors(size):
    crystal = pm.lattice_packing("fcc", 2)
    strain_dd = random_strain(3, size, seed=1)
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    expected = np.sort(np.linalg.norm(contacts.vector_cd @ (np.eye(3) + strain_dd), axis=1) - 1)
    np.testing.assert_allclose(np.sort(gaps(strain_packing(crystal, strain_dd))), expected, atol=4e-15)


@pytest.mark.parametrize("gap", [1e-4, 5e-9, 1e-12])
def test_opening_a_contact_of_one_disc_makes_its_cell_a_rhombus(gap):
    opened = open_contact(pm.lattice_packing("triangular"), 0, gap)
    first, second = opened.box.lattice_dd.T / opened.diameter_n[0]
    lengths = sorted(np.linalg.norm(v) for v in (first, second, second - first))
    assert lengths == pytest.approx([1.0, 1.0, 1.0 + gap], abs=4e-15)
    assert opened.box.volume / opened.diameter_n[0] ** 2 == pytest.approx(
        math.sin(2 * math.asin((1 + gap) / 2)), rel=1e-14
    )


@pytest.mark.parametrize("gap", [5e-9, 5e-10])
def test_a_network_that_empties_within_the_doubt_is_ambiguous_though_its_excess_stays_the_same(gap):
    # two contacts hold the square cell, one more than the fewest; an empty network counts as one more, too
    verdict = pm.classify_jamming(strain_packing(pm.lattice_packing("square"), gap * np.eye(2)))
    assert len({level.excess for level in verdict.touching.levels}) == 1
    assert (verdict.local, verdict.collective, verdict.strict) == ("ambiguous", "ambiguous", "not jammed")


def test_a_doubtful_strict_answer_leaves_the_collective_one_that_no_gap_can_change():
    # one disc in a fixed box is held by two contacts of its three already
    verdict = pm.classify_jamming(open_contact(pm.lattice_packing("triangular"), 0, 5e-10))
    assert (verdict.local, verdict.collective, verdict.strict) == ("jammed", "jammed", "ambiguous")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: open_contact(p, 27, 1e-6), "contact must be an integer at least 0 and at most 26, got 27"),
        (lambda p: open_contact(p, 0, -1e-6), "gap must be a finite number"),
        (lambda p: open_contact(p, 0, 0.5), "gap must be a finite number"),
        (lambda p: open_contact(3, 0, 1e-6), "packing must be a Packing"),
        (lambda p: resize_particle(p, 9, 1.1), "particle must be an integer at least 0 and at most 8, got 9"),
        (lambda p: resize_particle(p, 0, 0.0), "factor must be a finite number above 0"),
        (lambda p: random_strain(4, 1e-9, seed=0), "dimension must be an integer"),
        (lambda p: random_strain(2, math.nan, seed=0), "size must be a finite number"),
        (lambda p: strain_packing(p, np.eye(3)), "strain"),
    ],
)
def test_impossible_flaw_is_refused_by_name(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call(pm.lattice_packing("triangular", 3))
