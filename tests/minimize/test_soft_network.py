"""Facts about what Newton's method takes of a soft packing: smoothed overlaps, units, energies, slopes and freedoms."""

import numpy as np
import pytest

import packmech as pm
from packmech.effects import contact_terms, equal_touches
from packmech.minimize.second_order.soft_network import (
    SoftNetwork,
    Units,
    energy_between,
    isochoric_part,
    length_unit,
    smoothed_overlap,
)

LAWS = [pm.Harmonic(2.0), pm.Hertz(3.0), pm.LinearSpring(5.0), pm.PowerLaw(1.5, 3.0)]
SYMMETRIC = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])


def scene(dimension=2, law=None, seed=1, overlap=0.9):
    packing = pm.random_packing(16, dimension=dimension, packing_fraction=overlap, seed=seed)
    return pm.Scene(packing, (pm.Repulsion(law=law or pm.Harmonic(2.0)),))


def units_of(one, length=1.0, energy=1.0):
    return Units(one.effects, length, energy)


@pytest.mark.parametrize("width", [1e-8, 1e-3, 0.3])
def test_a_smoothed_overlap_times_what_it_is_beyond_the_true_one_is_the_square_of_the_width(width):
    inside = width * np.concatenate([-np.logspace(-3, 4, 40), [0.0], np.logspace(-3, 4, 40)])
    overlap = smoothed_overlap(2.0 - inside, np.full(len(inside), 2.0), width)
    true = 2.0 - (2.0 - inside)
    assert (overlap > 0.0).all()
    # the smaller of the two factors of the square of the width
    other = np.where(true < 0.0, overlap, overlap - true)
    larger = np.where(true < 0.0, overlap - true, overlap)
    assert np.allclose(other * larger, width**2, rtol=1e-7, atol=1e-15 * width)
    assert np.allclose(overlap[true < 0.0], 0.5 * (np.sqrt(true**2 + 4.0 * width**2) + true)[true < 0.0], rtol=1e-6)


@pytest.mark.parametrize("law", LAWS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("width", [1e-3, 0.05])
def test_smoothed_forces_and_stiffnesses_are_derivatives_of_the_energy_of_smoothed_overlaps(law, width):
    effects, sigma = (pm.Repulsion(law=law),), 1.25
    units = Units(effects, 1.0, 1.0)

    def at(distance):
        return equal_touches(distance, np.full(len(distance), sigma))

    def energy(distance):
        soft = sigma - smoothed_overlap(distance, np.full(len(distance), sigma), width)
        return contact_terms(effects, at(soft)).energy_c

    distance = sigma - np.array([0.3, 0.1, 0.01, 0.0, -0.01, -0.1])
    first, second = units.smoothed(at(distance), width)
    step = 1e-4 * width
    slope = (energy(distance + step) - energy(distance - step)) / (2.0 * step)
    change = [units.smoothed(at(distance + by), width)[0] for by in (step, -step)]
    assert np.allclose(first, slope, rtol=1e-5, atol=1e-9 * np.abs(first).max())
    assert np.allclose(second, (change[0] - change[1]) / (2.0 * step), rtol=1e-5, atol=1e-8 * np.abs(second).max())


def test_reduced_lengths_are_lengths_over_the_unit_and_come_back_bit_for_bit():
    one = scene().packing
    large = pm.Packing(one.position_nd * 5.0, one.radius_n * 5.0, pm.Box(one.box.lattice_dd * 5.0))
    length = length_unit(large)
    assert 2.0 ** np.round(np.log2(length)) == length and 0.7 <= large.diameter_n.mean() / length <= 1.42
    units = Units((pm.Repulsion(),), length, 3.0)
    small = units.reduced(large)
    assert np.array_equal(small.position_nd * length, large.position_nd)
    assert np.array_equal(small.radius_n * length, large.radius_n)
    assert np.array_equal(small.box.lattice_dd * length, large.box.lattice_dd)
    assert units.restored(small, large) == large


@pytest.mark.parametrize("law", LAWS, ids=lambda one: type(one).__name__)
def test_reduced_forces_and_stiffnesses_are_those_of_the_law_in_units_of_energy_and_length(law):
    effects, length, energy = (pm.Repulsion(law=law),), 4.0, 3.0
    distance, sigma = np.array([0.9, 1.0]), np.array([1.0, 1.3])
    first, second = Units(effects, length, energy).terms(equal_touches(distance, sigma))
    true = contact_terms(effects, equal_touches(length * distance, length * sigma))
    assert np.allclose(first, true.first_c * length / energy, rtol=1e-14)
    assert np.allclose(second, true.second_c * length**2 / energy, rtol=1e-14)


@pytest.mark.parametrize("law", LAWS, ids=lambda one: type(one).__name__)
def test_the_overlap_of_a_force_is_that_at_which_the_law_gives_it(law):
    sigma, overlap = np.array([1.0, 1.3, 2.0]), np.array([1e-9, 1e-3, 0.4])
    units = Units((pm.Repulsion(law=law),), 1.0, 1.0)
    touches = equal_touches(sigma * (1.0 - overlap), sigma)
    force = -units.terms(touches)[0]
    assert np.allclose(units.overlap_of(force, equal_touches(sigma, sigma)), overlap, rtol=1e-6)


@pytest.mark.parametrize("law", [pm.Harmonic(2.0), pm.PowerLaw(1.0, 4.0), pm.PowerLaw(1.0, 6.0)])
@pytest.mark.parametrize("width", [0.0, 0.04])
def test_energies_between_two_distances_are_those_of_the_law_wherever_the_pairs_begin_and_end(law, width):
    effects, sigma = (pm.Repulsion(law=law),), np.full(6, 1.0)
    before = np.array([0.9, 0.9, 1.1, 1.1, 0.99, 0.7])
    after = np.array([0.8, 1.1, 0.9, 1.2, 0.991, 0.9])
    units = Units(effects, 1.0, 1.0)

    def energy(distance):
        soft = 1.0 - smoothed_overlap(distance, sigma, width) if width else np.minimum(distance, 1.0)
        return contact_terms(effects, equal_touches(soft, sigma)).energy_c

    change = energy(after) - energy(before)
    for c in range(6):
        one = energy_between(
            equal_touches(before[c : c + 1], sigma[:1]), after[c : c + 1], (after - before)[c : c + 1],
            lambda touches: units.terms(touches)[0], width,
        )  # fmt: skip
        assert np.isclose(one, change[c], rtol=1e-12, atol=1e-15)


def test_the_strains_without_trace_of_all_strains_are_one_fewer_and_orthonormal():
    part = isochoric_part(SYMMETRIC, 2)
    assert part.shape == (2, 2, 2) and np.abs(np.einsum("kaa->k", part)).max() < 1e-15
    assert np.allclose(np.einsum("kab,lab->kl", part, part), np.eye(2))
    assert np.allclose(part, part.transpose(0, 2, 1)) and len(isochoric_part(np.eye(2)[None], 2)) == 0


@pytest.mark.parametrize("pressure", [None, 0.01])
def test_a_network_moves_at_the_volume_that_is_held_or_as_its_strains_say(pressure):
    one = scene()
    network = SoftNetwork(one.packing, units_of(one), SYMMETRIC, pressure)
    assert len(network.basis_kdd) == (3 if pressure else 2)
    rng = np.random.default_rng(0)
    u, strain = 1e-3 * rng.normal(size=(16, 2)), 1e-3 * rng.normal(size=len(network.basis_kdd))
    for strain_k in (strain, np.array([0.0, 2e-3, 0.0])[: len(strain)]):
        moved = network.moved(u, strain_k)
        gradient = np.eye(2) + np.einsum("k,kab->ab", strain_k, network.basis_kdd)
        volume = one.packing.box.volume * (1.0 if pressure is None else np.linalg.det(gradient))
        assert np.isclose(moved.box.volume, volume, rtol=1e-14, atol=0.0)
        factor = (moved.box.volume / (one.packing.box.volume * np.linalg.det(gradient))) ** 0.5
        assert np.allclose(moved.position_nd, factor * (one.packing.position_nd @ gradient.T + u), atol=1e-14)
    assert network.moved(u, 0.0 * strain).box == one.packing.box


def test_slopes_forces_and_the_growth_of_the_enthalpy_are_those_of_the_scene():
    one = scene()
    pressure = 0.01
    network = SoftNetwork(one.packing, units_of(one), SYMMETRIC, pressure)
    contacts = pm.find_contacts(one.packing, gap_tolerance=0.0)
    force = contact_terms(one.effects, contacts).first_c
    assert np.allclose(network.uphill_nd, -pm.forces(one), atol=1e-14)
    assert np.isclose(network.mean_force, np.abs(force).mean(), rtol=1e-13)
    assert np.isclose(network.residual, np.sqrt((pm.forces(one) ** 2).sum(axis=1)).max() / network.mean_force)
    rng = np.random.default_rng(1)
    u, strain = 1e-3 * rng.normal(size=(16, 2)), 1e-3 * rng.normal(size=3)
    for by in (1.0, 1e-3):
        moved = network.moved(by * u, by * strain)
        true = pm.energy(one.replace(packing=moved)) - pm.energy(one)
        true += pressure * (moved.box.volume - one.packing.box.volume)
        assert np.isclose(network.growth_to(moved), true, rtol=1e-9, atol=1e-14)
    # a packing far apart has no contacts, and no mean force
    apart = one.replace(packing=one.packing.replace(radius_n=0.01 * one.packing.radius_n))
    assert SoftNetwork(apart.packing, units_of(apart), SYMMETRIC, None).mean_force == 0.0


def test_spheroids_along_an_axis_are_free_to_turn_as_all_others_are():
    plain = pm.random_packing(6, dimension=3, packing_fraction=0.7, seed=2)
    for director in (np.tile([1.0, 0.0, 0.0], (6, 1)), np.tile([1.0, 1.0, 1.0], (6, 1)) / np.sqrt(3.0)):
        shapes = pm.Spheroids(np.full(6, 1.5), director)
        one = pm.Scene(plain.replace(shapes=shapes), (pm.Repulsion(),))
        network = SoftNetwork(one.packing, units_of(one), np.zeros((0, 3, 3)), None)
        found = network.coupled(np.zeros((0, 3, 3)), 1e-3)
        turns = one.packing.turn_nkt.shape[1]
        # one particle's position stays
        assert turns == 2 and len(found.free_f) == 6 * (3 + turns) - 3


@pytest.mark.parametrize("law", [pm.Harmonic(2.0), pm.Hertz(3.0)])
def test_the_newton_step_solves_the_second_derivatives_of_the_enthalpy(law):
    one = scene(law=law)
    network = SoftNetwork(one.packing, units_of(one), SYMMETRIC, 0.01)
    found = network.coupled(SYMMETRIC, 0.0)
    rng = np.random.default_rng(0)
    u, strain = np.zeros(32), rng.normal(size=3)
    # nothing holds what nothing touches
    touched = np.repeat(pm.find_contacts(one.packing, gap_tolerance=0.0).count_n() > 0, 2)[found.free_f]
    u[found.free_f] = np.where(touched, rng.normal(size=len(found.free_f)), 0.0)
    by = 1e-6
    ends = []
    for sign in (1.0, -1.0):
        there = SoftNetwork(
            network.moved(sign * by * u.reshape(16, 2), sign * by * strain), network.units, SYMMETRIC, 0.01
        )
        ends.append(there.uphill_nd.ravel())
    change = (ends[0] - ends[1]) / (2.0 * by)
    # forces at particles that the strain takes along: the slope by positions, u and strains alone
    expected = found.solve(change[found.free_f] - found.coupling_fk @ strain)
    assert np.allclose(expected, u[found.free_f], rtol=1e-5, atol=1e-5)
