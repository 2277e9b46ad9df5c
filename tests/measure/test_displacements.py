"""How particles moved: homogeneous strains, single particles, and a plain loop, in skewed boxes of both dimensions."""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm


def pair(dimension, seed, particles=40, size=0.2):
    """Return a random packing in a skewed box, the same moved and strained, the strain, and the steps beyond it."""
    rng = np.random.default_rng(seed)
    lattice = 5.0 * (np.eye(dimension) + 0.2 * rng.standard_normal((dimension, dimension)))
    box = pm.Box(lattice)
    place = rng.random((particles, dimension)) @ box.lattice_dd.T
    gradient = 0.1 * rng.standard_normal((dimension, dimension))
    step = size * rng.standard_normal((particles, dimension))
    before = pm.Packing(place, np.full(particles, 0.4), box)
    after = pm.Packing(place @ (np.eye(dimension) + gradient).T + step, before.radius_n, box.strained(gradient))
    return before, after, gradient, step


def by_loop(before, after, gradient, step, cutoff):
    """Return D2min by a loop over particles, images and a least-squares fit of each."""
    n, d = before.position_nd.shape
    images = np.stack(np.meshgrid(*[np.arange(-3, 4)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    shift = images @ before.box.lattice_dd.T
    strain = np.eye(d) + gradient
    found, tensors = np.zeros(n), np.zeros((n, d, d))
    for i in range(n):
        old, new = [], []
        for j in range(n):
            for one in shift:
                r = before.position_nd[j] - before.position_nd[i] + one
                if 0.0 < np.linalg.norm(r) <= cutoff:
                    old.append(r)
                    new.append(strain @ r + step[j] - step[i])
        fit, *_ = np.linalg.lstsq(np.array(old), np.array(new), rcond=None)
        found[i], tensors[i] = ((np.array(new) - np.array(old) @ fit) ** 2).sum(), fit.T
    return found, tensors


@pytest.mark.parametrize("dimension", [2, 3])
def test_steps_beyond_the_strain_of_the_box_are_found_in_any_image(dimension):
    before, after, gradient, step = pair(dimension, 1)
    images = np.random.default_rng(2).integers(-2, 3, step.shape)
    elsewhere = after.replace(position_nd=after.position_nd + images @ after.box.lattice_dd.T)
    for one in (after, elsewhere):
        found = pm.displacements(before, one)
        np.testing.assert_allclose(found.deformation_dd, np.eye(dimension) + gradient, atol=1e-14)
        np.testing.assert_allclose(found.nonaffine_nd, step, atol=1e-13)
        np.testing.assert_allclose(found.displacement_nd, after.position_nd - before.position_nd, atol=1e-13)
        np.testing.assert_allclose(found.drift_d, step.mean(axis=0), atol=1e-13)
    assert found.mean_square == pytest.approx(((step - step.mean(axis=0)) ** 2).sum(axis=1).mean(), rel=1e-12)


def test_another_choice_of_lattice_vectors_needs_the_strain_that_was_meant():
    before, after, gradient, step = pair(2, 3)
    turned = after.replace(box=pm.Box(after.box.lattice_dd @ np.array([[1.0, 1.0], [0.0, 1.0]])))
    found = pm.displacements(before, turned, deformation_dd=np.eye(2) + gradient)
    np.testing.assert_allclose(found.nonaffine_nd, step, atol=1e-13)


def test_images_are_the_nearest_of_a_cell_that_is_tilted():
    # fractions .42 and .45 round to none, but the second lattice vector less is nearer
    box = pm.Box([[4.0, 1.6], [0.0, 4.0]])
    one = pm.Packing([[0.0, 0.0]], [0.5], box)
    moved = one.replace(position_nd=[[2.4, 1.8]])
    np.testing.assert_allclose(pm.displacements(one, moved).nonaffine_nd, [[0.8, -2.2]], rtol=1e-14)


def test_the_part_that_moves_is_one_particle_or_all():
    box = pm.Box.cubic(10.0, 2)
    start = pm.Packing(np.random.default_rng(4).random((50, 2)) * 10.0, np.full(50, 0.3), box)
    one = np.zeros((50, 2))
    one[7] = [0.3, -0.4]
    found = pm.displacements(start, start.replace(position_nd=start.position_nd + one)).participation
    # about the mean the one moves 49/50 of its way, the others back by 1/50
    squares = np.array([49.0**2] + [1.0] * 49)
    assert found == pytest.approx(squares.sum() ** 2 / (50.0 * (squares**2).sum()), rel=1e-12)
    by_turns = 0.2 * np.where(np.arange(50)[:, None] % 2, 1.0, -1.0) * [0.6, 0.8]
    moved = start.replace(position_nd=start.position_nd + by_turns)
    assert pm.displacements(start, moved).participation == pytest.approx(1.0, rel=1e-12)
    assert np.isnan(pm.displacements(start, start).participation)


@pytest.mark.parametrize("dimension", [2, 3])
def test_d2min_is_that_of_a_plain_loop(dimension):
    before, after, gradient, step = pair(dimension, 5, particles=24)
    expected, tensors = by_loop(before, after, gradient, step, 3.0)
    found = pm.local_strain(before, after, cutoff=3.0)
    assert found.undetermined == 0
    np.testing.assert_allclose(found.d2min_n, expected, rtol=1e-12)
    np.testing.assert_allclose(found.deformation_ndd, tensors, atol=1e-12)
    np.testing.assert_allclose(found.mean_d2min_n * found.neighbors.count_n, expected, rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_homogeneous_strain_leaves_nothing(dimension):
    before, after, gradient, _ = pair(dimension, 6, size=0.0)
    found = pm.local_strain(before, after)
    strain = np.eye(dimension) + gradient
    # distances of up to 2 lose twelve digits when squared
    assert found.d2min_n.max() < 1e-26 * found.neighbors.count_n.max() * 4.0
    np.testing.assert_allclose(found.deformation_ndd, np.broadcast_to(strain, (40, dimension, dimension)), atol=1e-13)
    green = 0.5 * (strain.T @ strain - np.eye(dimension))
    deviator = green - np.trace(green) / dimension * np.eye(dimension)
    np.testing.assert_allclose(found.shear_strain_n, np.sqrt(0.5 * (deviator**2).sum()), rtol=1e-12)


def test_a_simple_shear_has_half_of_it_as_shear_strain():
    crystal = pm.lattice_packing("triangular", repeats=(6, 6))
    gamma = 1e-6
    sheared = crystal.replace(
        position_nd=crystal.position_nd @ np.array([[1.0, 0.0], [gamma, 1.0]]),
        box=crystal.box.strained([[0.0, gamma], [0.0, 0.0]]),
    )
    np.testing.assert_allclose(pm.local_strain(crystal, sheared).shear_strain_n, 0.5 * gamma, rtol=1e-5)


@pytest.mark.parametrize(("kind", "neighbors"), [("triangular", 6), ("fcc", 12)])
def test_the_center_of_a_shell_that_moves_alone_leaves_its_square_for_each_neighbor(kind, neighbors):
    d = 2 if kind == "triangular" else 3
    crystal = pm.lattice_packing(kind, repeats=(5,) * d)
    step = np.zeros(crystal.position_nd.shape)
    step[3, :2] = [0.03, -0.04]
    moved = crystal.replace(position_nd=crystal.position_nd + step)
    found = pm.local_strain(crystal, moved, "contact")
    assert found.neighbors.count_n[3] == neighbors
    # of the vectors, which sum to zero, no strain explains a common shift
    assert found.d2min_n[3] == pytest.approx(neighbors * 0.0025, rel=1e-12)
    np.testing.assert_allclose(found.deformation_ndd[3], np.eye(d), atol=1e-13)


def test_order_of_particles_place_and_direction_change_nothing():
    before, after, _, _ = pair(3, 7)
    expected = pm.local_strain(before, after, cutoff=2.1)
    order = np.random.default_rng(8).permutation(40)
    mixed = [one.replace(position_nd=one.position_nd[order] + [0.3, -1.0, 2.0]) for one in (before, after)]
    np.testing.assert_allclose(pm.local_strain(*mixed, cutoff=2.1).d2min_n, expected.d2min_n[order], rtol=1e-11)
    turn, _ = np.linalg.qr(np.random.default_rng(9).standard_normal((3, 3)))
    turned = [
        one.replace(position_nd=one.position_nd @ turn.T, box=pm.Box(turn @ one.box.lattice_dd))
        for one in (before, after)
    ]
    found = pm.local_strain(*turned, cutoff=2.1)
    np.testing.assert_allclose(found.d2min_n, expected.d2min_n, rtol=1e-11)
    np.testing.assert_allclose(found.shear_strain_n, expected.shear_strain_n, rtol=1e-10)


def test_too_few_neighbors_have_no_strain():
    box = pm.Box.cubic(10.0, 2)
    chain = pm.Packing([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0], [7.0, 7.0]], [0.5] * 4, box)
    found = pm.local_strain(chain, chain, cutoff=1.2)
    assert np.isnan(found.d2min_n).all() and found.undetermined == 4
    assert "4 have none" in repr(found)


def test_other_particles_are_refused():
    before, after, _, _ = pair(2, 10)
    with pytest.raises(ValueError, match="after must have the particles of before, 40, got 39"):
        pm.displacements(before, pm.Packing(after.position_nd[1:], after.radius_n[1:], after.box))
    with pytest.raises(TypeError, match="before must be a Packing"):
        pm.displacements(after.position_nd, after)
    with pytest.raises(ValueError, match="neighbors must be those of the packing"):
        pm.local_strain(before, after, pm.find_neighbors(pm.lattice_packing("square", repeats=(3, 3)), "contact"))
    with pytest.raises(TypeError, match="cutoff must be left out"):
        pm.local_strain(before, after, pm.find_neighbors(before, "cutoff", cutoff=2.0), cutoff=2.0)
