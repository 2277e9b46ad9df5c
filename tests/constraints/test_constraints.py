"""Facts about the constraint Jacobian: stored vectors, finite differences, closed forms, and what it does not see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.linalg.mandel import mandel_basis, mandel_tensor

RANDOM = ["random_chain_3d_w2.5", "random_dimer_3d_w2.0", "random_mono_2d_w3.0", "random_trimer_2d_w2.5"]
EQUILIBRIUM = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]


def lengths(packing, displacement, strain):
    affine = np.eye(packing.dimension) + mandel_tensor(strain)
    box = packing.box.lattice_dd
    vector = packing.links.vectors(packing.position_nd + displacement, box) @ affine.T
    return np.linalg.norm(vector, axis=1)


@pytest.mark.parametrize("name", RANDOM)
def test_random_packings_have_the_stored_jacobian(name, stored_links):
    packing, data, place = stored_links(name)
    expected = np.array(data["constraint_jacobian_Gamma_links_mandel"])
    expected = expected.reshape(packing.position_nd.size + len(data["H_ee_mandel"]), -1)[:, place]
    found = pm.constraint_jacobian(packing, strain="free")
    assert found.shape == expected.shape
    assert np.abs(found.toarray() - expected).max(initial=0.0) < 1e-12
    assert (abs(pm.constraint_jacobian(packing) - found[: packing.position_nd.size])).sum() == 0.0


@pytest.mark.parametrize("name", EQUILIBRIUM)
def test_packings_at_rest_have_the_stored_jacobian(name, stored_links):
    packing, data, place = stored_links(name)
    expected = np.array(data["Gamma_links_mandel"])[:, place]
    assert np.abs(pm.constraint_jacobian(packing, strain="free").toarray() - expected).max() < 1e-12


@pytest.mark.parametrize("dimension", [2, 3])
def test_exact_jacobian_is_the_gradient_of_lengths_off_their_lengths_too_and_the_printed_one_is_not(
    dimension, off_lengths
):
    packing = off_lengths(dimension)
    exact = pm.constraint_jacobian(packing, strain="free").toarray()
    paper = pm.constraint_jacobian(packing, strain="free", form="paper").toarray()
    rng = np.random.default_rng(1)
    displacement, strain = rng.normal(size=packing.position_nd.shape), rng.normal(size=dimension * (dimension + 1) // 2)
    step = 1e-5
    above, below = (lengths(packing, s * displacement, s * strain) for s in (step, -step))
    direction = np.concatenate([displacement.ravel(), strain])
    rate = (above - below) / (2 * step)
    assert np.abs(exact.T @ direction - rate).max() < 1e-8
    assert np.abs(paper.T @ direction - rate).max() > 0.05


def test_difference_quotient_approaches_the_jacobian_with_the_square_of_the_step(off_lengths):
    packing = off_lengths(2)
    direction = np.random.default_rng(2).normal(size=packing.position_nd.shape)
    rate = pm.constraint_jacobian(packing).T @ direction.ravel()
    error = []
    for step in (1e-2, 1e-3):
        above, below = (lengths(packing, s * direction, np.zeros(3)) for s in (step, -step))
        error.append(np.abs((above - below) / (2 * step) - rate).max())
    assert 90.0 < error[0] / error[1] < 110.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_column_of_a_dimer_has_squared_norm_two_plus_length_squared(dimension):
    rng = np.random.default_rng(3)
    for length in (0.3, 1.0, 2.7):
        arm = rng.normal(size=dimension)
        arm *= length / np.linalg.norm(arm)
        links = pm.Links([0], [1], [[0] * dimension], [length])
        dimer = pm.Packing([0 * arm, arm], [0.5, 0.5], pm.Box.cubic(9.0, dimension), links)
        column = pm.constraint_jacobian(dimer, strain="free").toarray()
        assert abs((column**2).sum() - (2.0 + length**2)) < 1e-14 * (2.0 + length**2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_volume_column_is_the_relative_rate_of_the_volume(dimension, off_lengths):
    packing = off_lengths(dimension)
    column = pm.constraint_jacobian(packing, strain="isochoric").toarray()[:, -1]
    strain = np.random.default_rng(4).normal(size=len(column) - packing.position_nd.size)
    tensor = mandel_tensor(1e-6 * strain)
    grown, shrunk = (np.linalg.det(np.eye(dimension) + s * tensor) for s in (1, -1))
    assert not column[: packing.position_nd.size].any()
    assert abs((grown - shrunk) / 2e-6 - column[packing.position_nd.size :] @ strain) < 1e-9


def test_strain_scale_divides_the_rows_of_strains(off_lengths):
    packing = off_lengths(3)
    plain, scaled = (pm.constraint_jacobian(packing, "isochoric", strain_scale=s).toarray() for s in (1.0, 3.7))
    default = pm.constraint_jacobian(packing, "isochoric", strain_scale=None).toarray()
    rows = packing.position_nd.size
    assert np.array_equal(plain[:rows], scaled[:rows])
    assert np.allclose(plain[rows:], 3.7 * scaled[rows:], rtol=1e-14, atol=0)
    assert np.allclose(plain[rows:], packing.box.volume ** (1 / 3) * default[rows:], rtol=1e-14, atol=0)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_translation_and_choice_of_images_change_nothing(seed, dimension, off_lengths):
    packing = off_lengths(dimension)
    rng = np.random.default_rng(seed)
    shift, image = rng.normal(size=dimension), rng.integers(-2, 3, packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd + shift - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    # moving by images may turn a link around or change its place in the order
    assert np.array_equal(moved.links.i_l, packing.links.i_l)
    before, after = (pm.constraint_jacobian(one, strain="free").toarray() for one in (packing, moved))
    assert np.allclose(before, after, rtol=0, atol=1e-12)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_rotation_turns_positions_and_strains_in_the_mandel_basis(seed, dimension, off_lengths):
    packing = off_lengths(dimension)
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))
    turned = packing.replace(position_nd=packing.position_nd @ turn.T, box=pm.Box(turn @ packing.box.lattice_dd))
    basis = mandel_basis(dimension)
    strains = np.einsum("mab,ac,bd,ncd->mn", basis, turn, turn, basis)
    big = np.zeros((packing.position_nd.size + len(strains),) * 2)
    big[: packing.position_nd.size, : packing.position_nd.size] = np.kron(np.eye(packing.particles), turn)
    big[packing.position_nd.size :, packing.position_nd.size :] = strains
    before, after = (pm.constraint_jacobian(one, strain="free").toarray() for one in (packing, turned))
    assert np.allclose(big @ before, after, rtol=0, atol=1e-12)


@given(seed=st.integers(0, 2**32))
def test_other_lattice_vectors_of_the_same_lattice_change_nothing(seed, off_lengths):
    packing = off_lengths(2)
    k = int(np.random.default_rng(seed).integers(-3, 4))
    change, back = np.array([[1, k], [0, 1]]), np.array([[1, -k], [0, 1]])
    links = packing.links
    other = pm.Links(links.i_l, links.j_l, links.image_ld @ back.T, links.length_l)
    moved = packing.replace(box=pm.Box(packing.box.lattice_dd @ change), links=other)
    before, after = (pm.constraint_jacobian(one, strain="free").toarray() for one in (packing, moved))
    assert np.allclose(before, after, rtol=0, atol=1e-11)


def test_a_link_to_the_own_image_has_rows_of_strains_only():
    links = pm.Links([0], [0], [[1, 0]], [4.0])
    packing = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(4.0, 2), links)
    assert pm.constraint_jacobian(packing, strain="free").toarray().ravel().tolist() == [0.0, 0.0, 4.0, 0.0, 0.0]


def test_coincident_ends_are_refused_by_name():
    links = pm.Links([0], [1], [[0, 0]], [1.0])
    packing = pm.Packing([[1.0, 1.0], [1.0, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), links)
    with pytest.raises(ValueError, match="different places, got particles 0 and 1 at one place"):
        pm.constraint_jacobian(packing)


def test_an_isotropic_box_is_no_choice_for_links(off_lengths):
    with pytest.raises(ValueError, match="strain must be one of 'none', 'isochoric', 'free', got 'isotropic'"):
        pm.constraint_jacobian(off_lengths(2), strain="isotropic")
