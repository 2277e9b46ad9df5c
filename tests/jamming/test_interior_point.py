"""Facts about the interior-point search for hard packings and the block systems it factors."""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.network import candidate_pairs, pair_contacts
from packmech.jamming.hard_packing import densify, start_state
from packmech.linalg.block_system import BlockSystem, extensions, gather
from packmech.linalg.mandel import mandel_basis


def network(particles, dimension, seed, scale=1.4):
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=0.6, seed=seed)
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=scale)
    return pair_contacts(packing, *pairs)


def dense(contacts, along, across, extra):
    n, d = contacts.particles, contacts.dimension
    matrix = np.zeros((n, d, n, d))
    for c in range(len(contacts)):
        normal = contacts.normal_cd[c]
        block = across[c] * np.eye(d) + (along[c] - across[c]) * np.outer(normal, normal)
        i, j = contacts.i_c[c], contacts.j_c[c]
        if i == j:
            continue
        matrix[i, :, i] += block
        matrix[j, :, j] += block
        matrix[i, :, j] -= block
        matrix[j, :, i] -= block
    return matrix.reshape(n * d, n * d) + np.diag(np.repeat(extra, d))


@pytest.mark.parametrize("backend", ["blocks", "rslab"])
@pytest.mark.parametrize(("particles", "dimension"), [(1, 2), (2, 2), (40, 2), (3, 3), (30, 3)])
def test_a_block_system_solves_what_its_dense_matrix_says(backend, particles, dimension):
    contacts = network(particles, dimension, seed=particles)
    rng = np.random.default_rng(particles)
    along, across = rng.random(len(contacts)) + 0.5, 0.1 * rng.random(len(contacts))
    extra = rng.random(particles) + 0.1
    system = BlockSystem(contacts.i_c, contacts.j_c, particles, dimension, backend=backend)
    found = system.factor(contacts.normal_cd, along, across, extra_n=extra, pin=False)
    right = rng.standard_normal((particles * dimension, 3))
    expected = np.linalg.solve(dense(contacts, along, across, extra), right)
    assert np.abs(found.solve(right) - expected).max() < 1e-10
    assert np.abs(found.solve(right[:, 0]) - expected[:, 0]).max() < 1e-10
    assert found.negative == 0


@pytest.mark.parametrize("backend", ["blocks", "rslab"])
def test_a_pinned_block_system_balances_loads_that_sum_to_zero(backend):
    contacts = network(40, 2, seed=5, scale=2.0)
    along = np.ones(len(contacts))
    system = BlockSystem(contacts.i_c, contacts.j_c, 40, 2, backend=backend)
    found = system.factor(contacts.normal_cd, along, along)
    load = np.random.default_rng(0).standard_normal((40, 2))
    load -= load.mean(axis=0)
    answer = found.solve(load.ravel())
    assert np.abs(dense(contacts, along, along, np.zeros(40)) @ answer - load.ravel()).max() < 1e-10


@pytest.mark.parametrize("backend", ["blocks", "rslab"])
def test_negative_pivots_count_the_negative_eigenvalues(backend):
    contacts = network(20, 2, seed=7)
    along, across = np.ones(len(contacts)), np.full(len(contacts), -0.6)
    system = BlockSystem(contacts.i_c, contacts.j_c, 20, 2, backend=backend)
    found = system.factor(contacts.normal_cd, along, across, extra_n=np.full(20, 1e-3), pin=False)
    eigenvalue = np.linalg.eigvalsh(dense(contacts, along, across, np.full(20, 1e-3)))
    assert found.negative == int((eigenvalue < 0.0).sum()) > 0


def test_gathering_forces_is_the_transpose_of_extension():
    contacts = network(25, 3, seed=3)
    rng = np.random.default_rng(1)
    force, motion = rng.standard_normal(len(contacts)), rng.standard_normal((25, 3))
    net = gather(contacts.i_c, contacts.j_c, contacts.normal_cd, force, 25)
    growth = extensions(contacts.i_c, contacts.j_c, contacts.normal_cd, motion)
    assert float((net * motion).sum()) == pytest.approx(float(force @ growth), rel=1e-12)


def search(packing, basis, **settings):
    load = float(packing.particles * packing.dimension)
    state = start_state(packing.position_nd, packing.box.lattice_dd, packing.radius_n, load)
    return densify(state, packing.radius_n, basis, **settings)


@pytest.mark.parametrize("packing_fraction", [0.5, 0.7, 0.86])
def test_the_search_ends_with_slack_times_force_at_the_barrier_and_no_overlap(packing_fraction):
    packing = pm.random_packing(24, dimension=2, packing_fraction=packing_fraction, seed=1)
    rest = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-3).packing
    state = search(rest, np.eye(2)[None] / np.sqrt(2.0), barrier=1e-12)
    assert state.barrier <= 1e-12
    end = pm.Packing(state.position_nd, packing.radius_n, pm.Box(state.lattice_dd))
    overlap = -pm.find_contacts(end, gap_tolerance=1e-3).gap_c.min()
    assert overlap < 1e-12


def test_the_multipliers_balance_on_every_particle_and_carry_an_isotropic_stress():
    packing = pm.random_packing(24, dimension=2, packing_fraction=0.86, seed=2)
    rest = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-3).packing
    state = search(rest, mandel_basis(2))
    end = pm.Packing(state.position_nd, packing.radius_n, pm.Box(state.lattice_dd))
    contacts = pair_contacts(end, *state.pairs)
    net = gather(contacts.i_c, contacts.j_c, contacts.normal_cd, state.force_c, 24)
    virial = np.einsum("c,ca,cb->ab", state.force_c * contacts.distance_c, contacts.normal_cd, contacts.normal_cd)
    assert np.abs(net).max() < 1e-5
    assert np.abs(virial - 24 * np.eye(2)).max() < 1e-5


@pytest.mark.parametrize("backend", ["blocks", "rslab"])
def test_a_singular_system_says_so(backend):
    contacts = network(6, 2, seed=1, scale=0.1)
    system = BlockSystem(contacts.i_c, contacts.j_c, 6, 2, backend=backend)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        system.factor(contacts.normal_cd, np.ones(len(contacts)))
