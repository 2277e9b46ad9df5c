"""Facts about constrained forces: the orthogonal projection, its multipliers, and what it does not depend on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.projection import METHODS
from packmech.linalg.mandel import mandel_basis

NAMES = ["random_chain_3d_w2.5", "random_dimer_3d_w2.0", "random_trimer_2d_w2.5", "equilibrium_chain_2d"]
# which coordinates there are, and whether the volume is held
BOXES = {"none": (False, False), "free": (True, False), "isochoric": (True, True)}


def pulls(packing, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=packing.position_nd.shape), rng.normal(size=packing.dimension * (packing.dimension + 1) // 2)


def joined(found, strain):
    parts = [found.force_nd.ravel(), found.strain_force_e] if strain else [found.force_nd.ravel()]
    return np.concatenate(parts)


def dense_projector(matrix):
    left, value, _ = np.linalg.svd(matrix, full_matrices=False)
    left = left[:, value > 1e-9 * value[0]]
    return np.eye(len(matrix)) - left @ left.T


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("name", NAMES)
def test_force_is_the_orthogonal_projection_by_the_stored_jacobian(name, box, method, stored_links):
    packing, data, place = stored_links(name)
    strain, volume = BOXES[box]
    key = "Gamma_links_mandel" if "Gamma_links_mandel" in data else "constraint_jacobian_Gamma_links_mandel"
    matrix = np.array(data[key])[:, place]
    size = packing.position_nd.size
    column = np.zeros((len(matrix), 1))
    column[size : size + packing.dimension] = 1.0
    matrix = np.hstack([matrix, column]) if volume else matrix[: None if strain else size]
    force, pull = pulls(packing)
    found = pm.project_force(
        packing,
        force,
        pull if strain else None,
        strain="isochoric" if volume else "free",
        method=method,
        strain_scale=1.0,
    )
    whole = np.concatenate([force.ravel(), pull]) if strain else force.ravel()
    assert np.abs(joined(found, strain) - dense_projector(matrix) @ whole).max() < 1e-12
    multiplier = np.append(found.multiplier_l, found.volume_multiplier) if volume else found.multiplier_l
    assert np.abs(joined(found, strain) + matrix @ multiplier - whole).max() < 1e-12
    assert found.rate < 1e-14 and found.method == method


@pytest.mark.parametrize("name", NAMES[:3])
def test_multipliers_of_contact_forces_are_the_stored_tensions(name, stored_links):
    packing, data, place = stored_links(name)
    found = pm.project_force(packing, data["forces"])
    assert np.abs(found.multiplier_l - np.array(data["least_squares_link_multipliers"])[place]).max() < 1e-12


def test_at_rest_nothing_is_left_and_links_carry_the_stored_tension(stored_links):
    packing, data, place = stored_links("equilibrium_chain_2d")
    gradient = np.array(data["gradient_mandel"])
    size = packing.position_nd.size
    found = pm.project_force(packing, -gradient[:size].reshape(-1, 2), -gradient[size:], strain="isochoric")
    assert max(np.abs(found.force_nd).max(), np.abs(found.strain_force_e).max()) < 1e-14
    assert np.abs(found.multiplier_l - np.array(data["link_multipliers"])[place]).max() < 1e-13


@pytest.mark.parametrize(("strain", "volume"), BOXES.values())
@pytest.mark.parametrize("dimension", [2, 3])
def test_clusters_and_the_whole_matrix_agree_on_long_chains(dimension, strain, volume, chain_packing):
    packing = chain_packing(80, 3, dimension=dimension)
    force, pull = pulls(packing)
    by = {
        m: pm.project_force(
            packing, force, pull if strain else None, strain="isochoric" if volume else "free", method=m
        )
        for m in ("clusters", "whole-matrix")
    }
    assert np.abs(by["clusters"].force_nd - by["whole-matrix"].force_nd).max() < 1e-13
    assert np.abs(by["clusters"].strain_force_e - by["whole-matrix"].strain_force_e).max() < 1e-12


def test_dependent_links_are_handed_to_the_basis_with_pivoting(chain_packing):
    packing = chain_packing(40, reach=4)
    force, _ = pulls(packing)
    found = pm.project_force(packing, force)
    matrix = pm.constraint_jacobian(packing).toarray()
    assert found.method == "householder"
    assert np.abs(found.force_nd.ravel() - dense_projector(matrix) @ force.ravel()).max() < 1e-12
    assert np.abs(found.force_nd.ravel() + matrix @ found.multiplier_l - force.ravel()).max() < 1e-10


def test_a_stiff_chain_of_a_thousand_has_no_rate_left(chain_packing):
    packing = chain_packing(1000, reach=2)
    force, _ = pulls(packing)
    assert pm.project_force(packing, force).rate < 1e-12


def test_a_taut_ring_around_the_box_takes_up_the_pull_along_it():
    links = pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    ring = pm.Packing([[0.5 + k, 1.0] for k in range(4)], [0.4] * 4, pm.Box.cubic(4.0, 2), links)
    found = pm.project_force(ring, np.zeros((4, 2)), [6.0, 1.0, 2.0])
    assert np.allclose(found.strain_force_e, [0.0, 1.0, 2.0], rtol=0, atol=1e-13)
    assert np.allclose(found.multiplier_l, 1.5, rtol=0, atol=1e-13)


def test_projecting_twice_changes_nothing(chain_packing):
    packing = chain_packing(100)
    force, pull = pulls(packing)
    once = pm.project_force(packing, force, pull, strain="isochoric")
    twice = pm.project_force(packing, once.force_nd, once.strain_force_e, strain="isochoric")
    assert np.abs(twice.force_nd - once.force_nd).max() < 1e-14
    assert np.abs(twice.multiplier_l).max() < 1e-13


def test_without_links_only_the_volume_is_held():
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    force, pull = pulls(packing)
    found = pm.project_force(packing, force, pull, strain="isochoric")
    assert np.array_equal(found.force_nd, force)
    assert np.allclose(found.strain_force_e, pull - np.array([1, 1, 0]) * pull[:2].mean(), rtol=0, atol=1e-14)


def test_projected_force_on_strains_depends_on_the_scale_of_strains(off_lengths):
    packing = off_lengths(2)
    force, pull = pulls(packing)
    one, other = (pm.project_force(packing, force, pull, strain_scale=scale) for scale in (1.0, 3.7))
    default = pm.project_force(packing, force, pull)
    same = pm.project_force(packing, force, pull, strain_scale=1.0)
    assert np.abs(one.force_nd - other.force_nd).max() > 0.01
    assert np.array_equal(default.force_nd, same.force_nd)


def test_a_later_force_on_the_same_packing_and_another_packing_get_their_own_answer(off_lengths):
    first, second = off_lengths(2), off_lengths(2, seed=1)
    force, _ = pulls(first)
    a, b, c = (pm.project_force(one, force).force_nd for one in (first, second, first))
    assert np.array_equal(a, c) and not np.allclose(a, b)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_rotation_turns_the_projected_force_and_strain(seed, dimension, off_lengths):
    packing = off_lengths(dimension)
    force, pull = pulls(packing, seed)
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))
    turned = packing.replace(position_nd=packing.position_nd @ turn.T, box=pm.Box(turn @ packing.box.lattice_dd))
    basis = mandel_basis(dimension)
    strains = np.einsum("mab,ac,bd,ncd->mn", basis, turn, turn, basis)
    plain = pm.project_force(packing, force, pull, strain="isochoric")
    other = pm.project_force(turned, force @ turn.T, strains @ pull, strain="isochoric")
    assert np.allclose(other.force_nd, plain.force_nd @ turn.T, rtol=0, atol=1e-10)
    assert np.allclose(other.strain_force_e, strains @ plain.strain_force_e, rtol=0, atol=1e-10)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_translation_images_and_relabelling_change_nothing(seed, dimension, off_lengths):
    packing = off_lengths(dimension)
    rng = np.random.default_rng(seed)
    force, pull = pulls(packing, seed)
    image, number = rng.integers(-2, 3, packing.position_nd.shape), rng.permutation(packing.particles)
    place = packing.position_nd + rng.normal(size=dimension) - image @ packing.box.lattice_dd.T
    moved, pushed = np.empty_like(place), np.empty_like(force)
    moved[number], pushed[number] = place, force
    other = packing.replace(position_nd=moved, links=packing.links.moved(image).numbered(number))
    plain, again = pm.project_force(packing, force, pull), pm.project_force(other, pushed, pull)
    assert np.allclose(again.force_nd[number], plain.force_nd, rtol=0, atol=1e-10)
    assert np.allclose(again.strain_force_e, plain.strain_force_e, rtol=0, atol=1e-10)


def test_a_volume_that_no_force_strains_is_no_constraint(off_lengths):
    packing, force = off_lengths(2), np.random.default_rng(3).normal(size=(12, 2))
    one, other = (pm.project_force(packing, force, strain=strain) for strain in ("free", "isochoric"))
    np.testing.assert_array_equal(one.force_nd, other.force_nd)
    assert other.volume_multiplier == 0.0
