"""Facts about random starting packings."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm


def fraction_by_hand(packing):
    ball = math.pi if packing.dimension == 2 else 4 * math.pi / 3
    return ball * math.fsum(packing.radius_n**packing.dimension) / abs(np.linalg.det(packing.box.lattice_dd))


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 200), st.sampled_from([2, 3]), st.floats(1e-3, 5.0), st.integers(0, 2**32))
def test_packing_fraction_is_the_one_asked_for(particles, dimension, packing_fraction, seed):
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=packing_fraction, seed=seed)
    assert fraction_by_hand(packing) == pytest.approx(packing_fraction, rel=1e-14)


@pytest.mark.parametrize("dimension", [2, 3])
def test_same_seed_gives_the_same_packing_to_the_last_bit(dimension):
    make = lambda: pm.random_packing(100, dimension=dimension, packing_fraction=0.9, seed=1)  # noqa: E731
    assert make() == make()


def test_a_seed_and_a_generator_of_that_seed_give_the_same_packing():
    by_seed = pm.random_packing(50, dimension=2, packing_fraction=0.9, seed=5)
    by_rng = pm.random_packing(50, dimension=2, packing_fraction=0.9, rng=np.random.default_rng(5))
    assert by_seed == by_rng


def test_another_seed_gives_another_packing():
    one, other = (pm.random_packing(50, dimension=2, packing_fraction=0.9, seed=seed) for seed in (1, 2))
    assert not np.array_equal(one.position_nd, other.position_nd)


def test_box_keeps_the_shape_of_the_lattice_vectors_given():
    shape = np.array([[2.0, 7.0], [0.0, 1.0]])
    packing = pm.random_packing(64, dimension=2, packing_fraction=0.8, seed=1, box=shape)
    ratio = packing.box.lattice_dd[0, 0] / shape[0, 0]
    np.testing.assert_allclose(packing.box.lattice_dd, ratio * shape, rtol=1e-15)
    assert fraction_by_hand(packing) == pytest.approx(0.8, rel=1e-14)


def test_a_box_and_its_lattice_vectors_give_the_same_packing():
    shape = np.array([[2.0, 1.0], [0.5, 1.0]])
    by_array = pm.random_packing(10, dimension=2, packing_fraction=0.8, seed=1, box=shape)
    assert by_array == pm.random_packing(10, dimension=2, packing_fraction=0.8, seed=1, box=pm.Box(shape))


@pytest.mark.parametrize("dimension", [2, 3])
def test_positions_fill_a_skewed_cell_uniformly(dimension):
    shape = np.eye(dimension) + 0.4 * np.triu(np.ones((dimension, dimension)), 1)
    packing = pm.random_packing(40_000, dimension=dimension, packing_fraction=0.5, seed=2, box=shape)
    fraction = packing.position_nd @ packing.box.inverse_dd.T
    assert fraction.min() > -1e-12 and fraction.max() < 1.0 + 1e-12
    bins = 20 if dimension == 2 else 8
    counts = np.histogramdd(fraction, bins=bins, range=[(0, 1)] * dimension)[0]
    expected = 40_000 / bins**dimension
    chi2 = ((counts - expected) ** 2 / expected).sum()
    freedom = bins**dimension - 1
    assert abs(chi2 - freedom) < 5 * math.sqrt(2 * freedom)


def test_bidisperse_at_1_4_is_the_distribution_when_none_is_named():
    named = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1, sizes=pm.Bidisperse(ratio=1.4))
    assert pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1) == named


def test_a_distribution_of_ones_own_can_be_given():
    class Pair:
        def radii(self, particles, rng):
            return np.linspace(1.0, 2.0, particles)

    packing = pm.random_packing(5, dimension=3, packing_fraction=0.6, seed=1, sizes=Pair())
    assert packing.radius_n.tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert fraction_by_hand(packing) == pytest.approx(0.6, rel=1e-14)


def test_scattered_shapes_are_turned_anew_and_discs_keep_their_bits():
    discs = pm.random_packing(30, dimension=2, packing_fraction=0.5, seed=1)
    for shapes in (pm.Ellipses(aspect=1.5), pm.Dimer()):
        packing = pm.random_packing(30, dimension=2, packing_fraction=0.5, shapes=shapes, seed=1)
        again = pm.scattered_packing(packing, packing_fraction=0.6, seed=2)
        assert pm.packing_fraction(again) == pytest.approx(0.6, rel=1e-12)
        assert again.shapes.oriented(packing.shapes.orientation_nq) == packing.shapes
        assert np.abs(again.shapes.rotation_since(packing.shapes)).max() > 1.0
        plain = pm.scattered_packing(discs, packing_fraction=0.6, seed=2)
        assert np.array_equal(again.position_nd, plain.position_nd)


def test_vacancies_of_ellipses_keep_the_shapes_of_those_that_stay():
    packing = pm.random_packing(40, dimension=2, packing_fraction=0.8, shapes=pm.Ellipses(aspect=1.5), seed=1)
    fewer = pm.vacancy_packing(packing, 4, seed=3, apart=True)
    assert fewer.particles == 36
    places = {tuple(one): k for k, one in enumerate(packing.position_nd.tolist())}
    stayed = [places[tuple(one)] for one in fewer.position_nd.tolist()]
    assert fewer.shapes == packing.shapes.select(np.array(stayed))
    gone = sorted(set(range(40)) - set(stayed))
    contacts = pm.find_shape_contacts(packing, gap_tolerance=0.0)
    assert not (np.isin(contacts.i_c, gone) & np.isin(contacts.j_c, gone)).any()
