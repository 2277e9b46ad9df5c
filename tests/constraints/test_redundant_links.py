"""Facts about links that depend on others, and about the way back to the links' lengths."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.redundancy import dependence

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
COLLINEAR = [[0, 0], [1, 0], [2, 0]]
COLLINEAR_3D = [[0, 0, 0], [1, 0, 0], [2.5, 0, 0]]
COPLANAR = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1.2, 0]]


def shaken(packing, size, seed=0):
    noise = size * np.random.default_rng(seed).standard_normal(packing.position_nd.shape)
    return packing.replace(position_nd=packing.position_nd + noise)


def taut_ring():
    links = pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    return pm.Packing([[0.5 + k, 1.0] for k in range(4)], [0.4] * 4, pm.Box.cubic(4.0, 2), links)


def test_a_square_with_both_diagonals_has_one_redundant_link(rigid_cluster):
    packing = rigid_cluster(2, SQUARE)
    found = pm.independent_links(packing)
    assert (found.rank, len(found.removed_l), found.degenerate) == (5, 1, ())
    assert len(found.packing.links) == 5 and found.largest_error < 1e-15
    assert np.array_equal(found.packing.position_nd, packing.position_nd)


def test_all_pairs_up_to_four_along_a_chain_of_200_keep_397_links_with_every_bond(chain_packing):
    packing = chain_packing(200, reach=4)
    found = pm.independent_links(packing)
    assert len(packing.links) == 790 and found.rank == len(found.packing.links) == 397
    assert packing.links.shape_l[found.removed_l].all()
    assert np.linalg.matrix_rank(pm.constraint_jacobian(found.packing).toarray(), rtol=1e-9) == 397
    assert not len(pm.independent_links(found.packing).removed_l)


@pytest.mark.parametrize("reach", [1, 2])
def test_links_of_long_chains_are_found_independent_without_a_dense_matrix(reach, chain_packing):
    packing = chain_packing(1000, 4, reach=reach)
    found = pm.independent_links(packing)
    assert found.packing is packing and found.rank == len(packing.links)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]), size=st.integers(2, 8))
def test_rank_is_that_of_the_jacobian_by_singular_values(seed, dimension, size):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(size, dimension))
    pairs = np.array(np.triu_indices(size, 1)).T
    pairs = pairs[rng.permutation(len(pairs))[: rng.integers(1, len(pairs) + 1)]]
    length = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
    links = pm.Links(*pairs.T, np.zeros((len(pairs), dimension)), length)
    packing = pm.Packing(places, np.full(size, 0.5), pm.Box.cubic(20.0, dimension), links)
    found = pm.independent_links(packing)
    assert found.rank == np.linalg.matrix_rank(pm.constraint_jacobian(packing).toarray(), rtol=1e-8)
    assert found.rank + len(found.removed_l) == len(links) and found.degenerate == ()


def test_a_redundant_link_that_disagrees_is_refused_with_its_pair_and_both_lengths(rigid_cluster):
    packing = rigid_cluster(2, SQUARE)
    links = packing.links
    length = links.length_l.copy()
    length[(links.i_l == 1) & (links.j_l == 3)] = 1.5
    wrong = packing.replace(links=pm.Links(links.i_l, links.j_l, links.image_ld, length, np.arange(6) == 4))
    assert (links.i_l[4], links.j_l[4]) == (1, 3)
    expected = (
        "packing must have redundant links that agree .* got length 1.5 for the link of particles 1 and 3, .* 1.4142"
    )
    for call in (pm.independent_links, pm.reaffix_links):
        with pytest.raises(ValueError, match=expected):
            call(wrong)


def test_redundant_links_are_compared_where_the_others_have_their_lengths(rigid_cluster):
    packing = shaken(rigid_cluster(3, np.random.default_rng(1).normal(size=(7, 3))), 0.01)
    assert packing.link_error > 1e-3
    found = pm.independent_links(packing)
    assert (found.rank, len(found.removed_l)) == (15, 6) and found.largest_error < 1e-12


@pytest.mark.parametrize(
    ("places", "rank", "shape"),
    [(COLLINEAR, 2, "collinear"), (COLLINEAR_3D, 2, "collinear"), (COPLANAR, 5, "coplanar")],
)
def test_collinear_trimers_and_coplanar_tetramers_are_degenerate_not_redundant(places, rank, shape, rigid_cluster):
    packing = rigid_cluster(len(places[0]), places)
    found = pm.independent_links(packing)
    assert found.packing is packing and found.rank == rank
    (only,) = found.degenerate
    assert only.shape == shape and only.particles == tuple(range(len(places)))


@pytest.mark.parametrize("places", [COLLINEAR, COLLINEAR_3D, COPLANAR])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_way_back_to_a_degenerate_shape_is_refused_by_name_with_the_rank(places, noise, rigid_cluster):
    packing = shaken(rigid_cluster(len(places[0]), places), noise)
    with pytest.raises(pm.NotConverged, match=r"Links lose rank.*(collinear|coplanar) particles 0, 1, 2") as caught:
        pm.reaffix_links(packing)
    assert caught.value.run.outcome is pm.Outcome.DEGENERATE
    found = pm.reaffix_links(packing, check=False)
    assert not found.ok and found.rank == len(packing.links) - 1


def test_a_collinear_trimer_is_named_however_it_was_shaken(rigid_cluster):
    packing = rigid_cluster(2, COLLINEAR)
    for seed in range(100):
        found = pm.reaffix_links(shaken(packing, 0.05, seed), check=False)
        assert found.outcome is pm.Outcome.DEGENERATE, seed


def test_the_error_of_a_collinear_trimer_falls_by_four_in_each_iteration(rigid_cluster):
    packing = shaken(rigid_cluster(2, COLLINEAR), 0.02)
    error = pm.reaffix_links(packing, tolerance=1e-12, check=False).residual_t
    assert len(error) > 6
    assert np.all(np.abs(error[2:-1] / error[3:] - 4.0) < 0.05)


@pytest.mark.parametrize("dimension", [2, 3])
def test_errors_of_rigid_trimers_fall_quadratically(dimension, rigid_cluster):
    places = np.eye(3)[:, :dimension] if dimension == 3 else [[0, 0], [1, 0], [0.5, 0.75**0.5]]
    found = pm.reaffix_links(shaken(rigid_cluster(dimension, places), 0.05, seed=2), tolerance=1e-15, check=False)
    error = found.residual_t
    assert error[0] > 0.02 and found.iterations <= 6
    assert np.all(error[1:] <= 2.0 * error[:-1] ** 2 + 1e-15)


def test_steps_with_the_actual_direction_are_better_than_those_with_the_printed_one(rigid_cluster):
    packing = shaken(rigid_cluster(2, [[0, 0], [1, 0], [0.4, 0.9]]), 0.05)
    paper = packing
    error = []
    for _ in range(3):
        matrix = pm.constraint_jacobian(paper, form="paper").toarray()
        length = np.linalg.norm(paper.links.vectors(paper.position_nd, paper.box.lattice_dd), axis=1)
        step = np.linalg.lstsq(matrix.T, length - paper.links.length_l, rcond=None)[0]
        paper = paper.replace(position_nd=paper.position_nd - step.reshape(-1, 2))
        error.append(paper.link_error)
    exact = pm.reaffix_links(packing, tolerance=1e-15, check=False).residual_t[1:4]
    assert np.all(exact < 0.5 * np.array(error)) and error[2] < 1e-4


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]), reach=st.sampled_from([1, 2]))
def test_chains_come_back_to_their_lengths_and_keep_their_center(seed, dimension, reach, chain_packing):
    packing = shaken(chain_packing(20, 2, dimension=dimension, reach=reach), 0.01, seed)
    found = pm.reaffix_links(packing)
    assert found.ok and max(found.residual, found.packing.link_error - 1e-14) < 1e-13
    moved = found.packing.position_nd - packing.position_nd
    # rounding of the steps times multipliers, which bends at fixed angles make large
    assert np.abs(moved.reshape(2, 20, dimension).sum(axis=1)).max() < 1e-11
    assert found.rank == len(packing.links)


@given(seed=st.integers(0, 2**32))
def test_relabelling_and_images_change_nothing_on_the_way_back(seed, chain_packing):
    packing = shaken(chain_packing(12, 2, reach=2), 0.02)
    rng = np.random.default_rng(seed)
    image, number = rng.integers(-2, 3, packing.position_nd.shape), rng.permutation(packing.particles)
    place = np.empty_like(packing.position_nd)
    place[number] = packing.position_nd - image @ packing.box.lattice_dd.T
    other = packing.replace(position_nd=place, links=packing.links.moved(image).numbered(number))
    plain, again = pm.reaffix_links(packing).packing, pm.reaffix_links(other).packing
    back = again.position_nd[number] + image @ packing.box.lattice_dd.T
    assert np.allclose(back, plain.position_nd, rtol=0, atol=1e-10)


def test_a_stiff_chain_of_400_comes_back_to_its_lengths(chain_packing):
    found = pm.reaffix_links(shaken(chain_packing(400, reach=2), 1e-6))
    assert found.ok and found.iterations < 8


def test_redundant_links_get_their_lengths_through_the_others(chain_packing):
    packing = shaken(chain_packing(60, reach=4), 1e-3)
    found = pm.reaffix_links(packing)
    assert found.rank == 117 and found.packing.link_error < 1e-12


def test_lengths_that_no_places_have_stall_with_a_word():
    links = pm.Links([0, 1, 0], [1, 2, 2], [[0, 0]] * 3, [1.0, 1.0, 2.5])
    packing = pm.Packing([[0, 0], [1, 0], [1.9, 0.3]], [0.5] * 3, pm.Box.cubic(9.0, 2), links)
    with pytest.raises(pm.NotConverged, match=r"largest error"):
        pm.reaffix_links(packing)


def test_a_taut_ring_has_one_redundant_link_in_a_fixed_box_and_none_under_strain():
    packing = taut_ring()
    assert len(pm.independent_links(packing).removed_l) + len(pm.independent_links(packing).degenerate) == 1
    assert not len(pm.independent_links(packing, strain="free").removed_l)


def test_a_link_to_the_own_image_is_redundant_in_a_fixed_box_only():
    links = pm.Links([0, 0], [0, 1], [[1, 0], [0, 0]], [4.0, 1.0])
    packing = pm.Packing([[1.0, 1.0], [2.0, 1.0]], [0.5] * 2, pm.Box.cubic(4.0, 2), links)
    assert pm.independent_links(packing).removed_l.tolist() == [0]
    assert not len(pm.independent_links(packing, strain="free").removed_l)


def test_nearly_straight_chains_are_neither_redundant_nor_degenerate(chain_packing):
    found = dependence(chain_packing(100, reach=2, angle=0.01))
    assert found.independent_l.all() and not found.degenerate


@pytest.mark.slow
def test_a_nearly_straight_stiff_chain_of_a_thousand_comes_back_from_a_shove():
    # the normal matrix has condition 1e14 and more: where its step makes things worse a pivoted QR takes it
    chain = pm.chain_packing(
        1, 1000, dimension=2, packing_fraction=0.001, angles="fixed", bend=0.01, crossing="allowed", seed=1
    )
    shove = 1e-5 * np.random.default_rng(1).normal(size=chain.position_nd.shape)
    found = pm.reaffix_links(chain.replace(position_nd=chain.position_nd + shove))
    assert found.outcome is pm.Outcome.CONVERGED and found.residual <= 1e-13
