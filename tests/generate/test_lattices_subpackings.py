"""Facts about crystals with particles left out: counts, packing fractions, contacts, draws."""

import itertools
import math

import numpy as np
import pytest

import packmech as pm


def counts(packing):
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    both = np.bincount(contacts.i_c, minlength=packing.particles) + np.bincount(
        contacts.j_c, minlength=packing.particles
    )
    return both, contacts


@pytest.mark.parametrize("cells", [1, 2, 3, 5, 8])
def test_reinforced_kagome_lattice_has_the_packing_fraction_of_its_count(cells):
    side = 2 * cells + 1
    packing = pm.reinforced_kagome_packing(cells)
    assert packing.particles == side**2 - cells**2
    closed_form = math.pi / (2 * math.sqrt(3)) * (1 - cells**2 / side**2)
    assert pm.packing_fraction(packing) == pytest.approx(closed_form, rel=4e-15)


@pytest.mark.parametrize("cells", [1, 2, 3, 5, 8])
def test_reinforced_kagome_lattice_has_the_triangular_contacts_less_six_for_each_vacancy(cells):
    packing = pm.reinforced_kagome_packing(cells)
    touching_n, contacts = counts(packing)
    # no two vacancies touch, so none of their contacts is counted twice
    assert len(contacts) == 3 * (2 * cells + 1) ** 2 - 6 * cells**2
    assert np.abs(contacts.gap_c).max() < 1e-14
    assert set(touching_n.tolist()) <= {4, 5, 6}


def test_reinforced_kagome_lattice_tends_to_the_kagome_lattice_with_four_contacts_per_disc():
    kagome = pm.lattice_packing("kagome")
    large = pm.reinforced_kagome_packing(30)
    touching_n, _ = counts(large)
    assert pm.packing_fraction(large) == pytest.approx(pm.packing_fraction(kagome), rel=0.02)
    assert touching_n.mean() == pytest.approx(4.0, rel=0.03)


@pytest.mark.parametrize("steps", [(0,), (3,), (0, 1), (0, 3), (5, 2, 2), (1, 4, 1, 0, 2)])
def test_every_sphere_of_a_tunneled_crystal_touches_seven_others_whatever_the_steps(steps):
    for repeats in (1, (2, 1, 3)):
        packing = pm.tunneled_packing(steps, repeats)
        touching_n, contacts = counts(packing)
        assert (touching_n == 7).all()
        assert np.abs(contacts.gap_c).max() < 1e-13
        assert pm.packing_fraction(packing) == pytest.approx(math.pi * math.sqrt(2) / 9, rel=4e-15)


def test_tunneled_crystals_by_name_are_those_of_one_and_of_two_opposite_steps():
    assert pm.lattice_packing("tunneled fcc", (2, 1, 3)) == pm.tunneled_packing((0,), (2, 1, 3))
    assert pm.lattice_packing("tunneled hcp", 2) == pm.tunneled_packing((0, 3), 2)


@pytest.mark.parametrize(("steps", "crystal"), [((0,), "fcc"), ((0, 3), "hcp")])
def test_a_tunneled_crystal_fills_up_to_the_densest_when_the_middles_of_its_hexagons_are_put_back(steps, crystal):
    packing = pm.tunneled_packing(steps, 2)
    layers = 2 * len(steps)
    middle_nd = packing.position_nd[0::2] - np.array([1.0, 0.0, 0.0])
    assert len(middle_nd) == 4 * layers
    filled = pm.Packing(
        np.vstack([packing.position_nd, middle_nd]), np.full(packing.particles + len(middle_nd), 0.5), packing.box
    )
    touching_n, contacts = counts(filled)
    assert (touching_n == 12).all()
    assert np.abs(contacts.gap_c).max() < 1e-13
    # pairs at sqrt(8/3) diameters: in hcp two for each sphere, in fcc none
    next_ = pm.find_contacts(filled, gap_tolerance=0.7)
    assert np.any(np.abs(next_.distance_c - math.sqrt(8 / 3)) < 1e-9) == (crystal == "hcp")


def test_six_steps_reach_the_six_rotations_and_reflections_of_one_tunneled_crystal():
    distances = [
        np.sort(pm.find_contacts(pm.tunneled_packing((k,), 2), gap_tolerance=0.9).distance_c) for k in range(6)
    ]
    for one, other in itertools.pairwise(distances):
        np.testing.assert_allclose(one, other, atol=1e-13)


def test_vacancies_are_drawn_by_the_seed_and_the_rest_stays_in_place():
    crystal = pm.lattice_packing("triangular", (4, 5))
    packing = pm.vacancy_packing(crystal, 6, seed=3)
    assert packing == pm.vacancy_packing(crystal, 6, seed=3) != pm.vacancy_packing(crystal, 6, seed=4)
    where = {tuple(x) for x in crystal.position_nd.tolist()}
    assert packing.particles == 14
    assert {tuple(x) for x in packing.position_nd.tolist()} < where
    assert packing.box == crystal.box


@pytest.mark.parametrize("seed", range(5))
def test_vacancies_apart_take_six_contacts_each_from_the_triangular_crystal(seed):
    crystal = pm.lattice_packing("triangular", (6, 6))
    _, contacts = counts(pm.vacancy_packing(crystal, 5, seed=seed, apart=True))
    assert len(contacts) == 3 * 36 - 6 * 5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pm.reinforced_kagome_packing(0), "cells must be an integer at least 1, got 0"),
        (lambda: pm.tunneled_packing(()), "steps must hold at least 1 integer"),
        (lambda: pm.tunneled_packing((0, 6)), r"steps\[1\] must be an integer at least 0 and at most 5, got 6"),
        (lambda: pm.vacancy_packing(pm.lattice_packing("fcc", 2), 8, seed=0), "vacancies must be fewer than .* got 8"),
        (
            lambda: pm.vacancy_packing(pm.lattice_packing("triangular", 3), 4, seed=0, apart=True),
            "vacancies must find room apart from each other, got 4, with room for",
        ),
    ],
)
def test_impossible_subpacking_is_refused_by_name(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()
