"""Facts about the links' order of elimination, its envelope, and the factor in it, against dense algebra."""

import numpy as np
import pytest

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.link_system import link_order, make_link_system
from packmech.contacts.network import pair_contacts
from packmech.linalg.block_system import gather


def tangle(seed, particles=40, count=45):
    """Return random links, some of them closing rings, of a packing at random places."""
    rng = np.random.default_rng(seed)
    pair = np.unique(np.sort(rng.integers(0, particles, (count, 2)), axis=1), axis=0)
    pair = rng.permutation(pair[pair[:, 0] != pair[:, 1]])
    links = pm.Links(*pair.T, np.zeros((len(pair), 3)), np.ones(len(pair)))
    return pm.Packing(rng.uniform(0, 9, (particles, 3)), [0.4] * particles, pm.Box.cubic(9.0, 3), links)


def geometry(packing):
    links = packing.links
    return pair_contacts(packing, links.i_l, links.j_l, links.image_ld)


def products(pairs):
    """Return the dense products of the gradients of the pairs' distances."""
    gradient = np.zeros((len(pairs), pairs.particles, pairs.dimension))
    gradient[np.arange(len(pairs)), pairs.j_c] += pairs.normal_cd
    gradient[np.arange(len(pairs)), pairs.i_c] -= pairs.normal_cd
    flat = gradient.reshape(len(pairs), -1)
    return flat @ flat.T


@pytest.mark.parametrize("seed", range(8))
def test_the_order_names_every_link_once_and_cluster_after_cluster(seed):
    packing = tangle(seed)
    order = link_order(packing.links.i_l, packing.links.j_l, packing.particles)
    assert sorted(order) == list(range(len(packing.links)))
    assert (np.diff(packing.links.clusters(packing.particles)[packing.links.i_l][order]) >= 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_the_tables_of_the_envelope_hold_all_products_of_gradients(seed):
    packing = tangle(seed)
    pairs, table = geometry(packing), make_link_system(packing.links, *packing.position_nd.shape)
    order = table.order_r
    filled, normal = 2.0 * np.eye(len(order)), pairs.normal_cd[order]
    row, column = table.row_e, table.column_e
    np.add.at(filled, (row, column), table.sign_e * (normal[row] * normal[column]).sum(axis=1))
    whole = products(pairs)[np.ix_(order, order)]
    assert np.abs(np.tril(whole) - filled).max() < 1e-14
    assert (column >= table.first_r[row]).all()
    assert (table.slot_e == table.start_r[row] + column - table.first_r[row]).all()


@pytest.mark.parametrize("seed", range(8))
def test_the_factor_in_the_envelope_solves_the_dense_system(seed):
    packing = tangle(seed)
    force = np.random.default_rng(seed).normal(size=packing.position_nd.shape)
    factor = ConstraintFactor(packing)
    left, tension, rate = factor.project(force)
    gradient = factor.gradient_lx.toarray()
    expected = np.linalg.solve(products(factor.pairs), gradient @ force.ravel())
    assert np.abs(tension - expected).max() < 1e-11 * np.abs(expected).max()
    assert np.abs(left - (force.ravel() - expected @ gradient).reshape(force.shape)).max() < 1e-12
    assert rate < 1e-14 and not factor.dependent_l.any()


def test_dependent_links_share_the_smallest_forces_that_balance_the_contacts():
    rng = np.random.default_rng(1)
    i, j = np.triu_indices(5, 1)
    links = pm.Links(i, j, np.zeros((10, 2)), np.ones(10))
    packing = pm.Packing(rng.uniform(0, 9, (5, 2)), [0.4] * 5, pm.Box.cubic(9.0, 2), links)
    factor = ConstraintFactor(packing)
    # five points of the plane keep their shape with seven distances
    assert factor.dependent_l.sum() == 3 and factor.left_out == 3
    push = rng.normal(size=10)
    expected = np.linalg.lstsq(factor.gradient_lx.toarray().T, -(push @ factor.gradient_lx), rcond=1e-8)[0]
    pairs = factor.pairs
    found = factor.multipliers(gather(pairs.i_c, pairs.j_c, pairs.normal_cd, push, pairs.particles))
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_wide_clusters_are_solved_too():
    rng = np.random.default_rng(2)
    links = pm.Links(np.zeros(60, int), np.arange(1, 61), np.zeros((60, 3)), np.ones(60))
    packing = pm.Packing(rng.uniform(0, 9, (61, 3)), [0.4] * 61, pm.Box.cubic(9.0, 3), links)
    factor, force = ConstraintFactor(packing), rng.normal(size=(61, 3))
    tension = factor.project(force)[1]
    expected = np.linalg.solve(products(factor.pairs), factor.gradient_lx @ force.ravel())
    assert np.abs(tension - expected).max() < 1e-11 * np.abs(expected).max()
