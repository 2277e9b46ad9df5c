"""Facts about minimization with links: every method keeps them, goes down, and ends where the links bear the rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.projection import scale_box
from packmech.minimize.program import build_program

METHODS = [
    pm.Fire(), pm.Fire2(), pm.ConjugateGradient(), pm.LBFGS(), pm.DampedDynamics(), pm.GradientDescent(),
    pm.SteepestDescent(),
]  # fmt: skip


def trimers(count=12, dimension=2, packing_fraction=0.95, seed=1):
    """Return a scene of rigid trimers that overlap at random."""
    packing = pm.cluster_packing(count, pm.Trimer(), dimension=dimension, packing_fraction=packing_fraction, seed=seed)
    return pm.Scene(packing, (pm.Repulsion(),))


def left_over(scene):
    """Return what the links leave of the forces, largest, over the mean contact force, by dense least squares."""
    packing = scene.packing
    omega = pm.constraint_jacobian(packing).toarray()
    force = pm.forces(scene).ravel()
    left = force - omega @ np.linalg.lstsq(omega, force, rcond=None)[0]
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    mean = (contacts.overlap_c / contacts.contact_distance_c).mean()
    return float(np.linalg.norm(left.reshape(packing.position_nd.shape), axis=1).max() / mean)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: type(method).__name__)
def test_every_method_keeps_the_links_and_ends_where_they_bear_what_is_left(method):
    scene = trimers()
    run = pm.quench(scene, force_tolerance=1e-8, method=method)
    assert np.abs(run.packing.link_error).max() < 1e-13
    end = scene.replace(packing=run.packing)
    assert left_over(end) < 2e-8
    assert pm.energy(end) < pm.energy(scene)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_default_route_reaches_rounding_with_links(dimension):
    scene = trimers(dimension=dimension, packing_fraction={2: 0.95, 3: 0.75}[dimension])
    run = pm.quench(scene, force_tolerance=1e-11)
    assert run.outcome is pm.Outcome.CONVERGED and run.residual <= 1e-11
    assert np.abs(run.packing.link_error).max() < 1e-13
    assert left_over(scene.replace(packing=run.packing)) < 1e-10


@pytest.mark.parametrize("method", [pm.GradientDescent(step=0.3), pm.LBFGS(), pm.ConjugateGradient()])
def test_the_energy_falls_from_look_to_look(method):
    run = pm.quench(trimers(), force_tolerance=1e-6, method=method, trace_every=1)
    energy = run.trace.energy_t
    assert (np.diff(energy) <= 1e-12 * energy[0]).all()


def test_links_hold_at_every_step_that_is_kept():
    scene = trimers()
    run = pm.quench(scene, force_tolerance=1e-8, trace_every=5, trace_positions=True)
    for position in run.trace.position_tnd[1:]:
        assert np.abs(scene.packing.replace(position_nd=position).link_error).max() < 1e-13


def test_a_scene_without_links_carries_nothing_of_them():
    packing = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1)
    program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
    assert program.space.links is None


def test_linked_pairs_and_pairs_of_rigid_clusters_are_no_contacts_in_the_loop():
    scene = trimers(packing_fraction=1.2)
    program = build_program(scene)
    assert program.evaluate().contacts == len(pm.find_contacts(scene.packing, gap_tolerance=0.0))
    assert program.evaluate().energy == pytest.approx(pm.energy(scene), rel=1e-13)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**20))
def test_any_lattice_vectors_and_images_give_the_same_forces_and_stress(seed):
    rng = np.random.default_rng(seed)
    scene = trimers(count=6, seed=seed % 50)
    packing = scene.packing
    change = np.array([[1, rng.integers(-2, 3)], [0, 1]]) @ np.array([[1, 0], [rng.integers(-2, 3), 1]])
    back = np.rint(np.linalg.inv(change)).astype(int)
    image = rng.integers(-2, 3, packing.position_nd.shape)
    box = pm.Box(packing.box.lattice_dd @ change)
    links = packing.links
    links = pm.Links(links.i_l, links.j_l, links.image_ld @ back.T, links.length_l, links.shape_l).moved(image)
    other = packing.replace(position_nd=packing.position_nd - image @ box.lattice_dd.T, box=box, links=links)
    one, two = (build_program(scene.replace(packing=p)).evaluate() for p in (packing, other))
    np.testing.assert_allclose(two.force_nd, one.force_nd, atol=1e-12)
    np.testing.assert_allclose(two.stress_dd, one.stress_dd, atol=1e-12)
    assert two.contacts == one.contacts


def test_the_stress_of_contacts_and_links_is_the_slope_of_the_relaxed_energy():
    scene = trimers()
    packing = pm.quench(scene, force_tolerance=1e-12).packing
    stress = pm.stress_tensor(scene.replace(packing=packing))
    step = 1e-5
    for strain in (np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 0.5], [0.5, 0.0]])):
        energies = []
        for sign in (1.0, -1.0):
            box = packing.box.strained(sign * step * strain)
            moved = packing.position_nd @ (np.eye(2) + sign * step * strain).T
            at = ConstraintFactor(packing).projected(packing.replace(position_nd=moved, box=box))
            run = pm.quench(scene.replace(packing=at), force_tolerance=1e-12)
            energies.append(pm.energy(scene.replace(packing=run.packing)))
        slope = (energies[0] - energies[1]) / (2.0 * step * packing.box.volume)
        assert slope == pytest.approx(float((stress * strain).sum()), rel=1e-6, abs=1e-9)


def test_a_chain_that_winds_around_the_box_keeps_winding():
    packing = pm.chain_packing(2, 12, dimension=2, packing_fraction=0.7, form="wound", seed=1)
    run = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-8)
    assert np.abs(run.packing.link_error).max() < 1e-13
    np.testing.assert_array_equal(run.packing.links.image_ld, packing.links.image_ld)


def test_redundant_links_that_agree_change_nothing():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    pairs = np.array([(i, j) for i in range(4) for j in range(i + 1, 4)])
    length = np.linalg.norm(square[pairs[:, 0]] - square[pairs[:, 1]], axis=1)
    rng = np.random.default_rng(1)
    single = rng.random((10, 2)) * 3.0
    position, radius = np.concatenate([square + 0.7, single]), np.full(14, 0.5)
    ends = []
    for keep in (slice(None), slice(0, 5)):
        links = pm.Links(pairs[keep, 0], pairs[keep, 1], np.zeros((len(pairs[keep]), 2)), length[keep])
        packing = pm.Packing(position, radius, pm.Box.cubic(3.2, 2), links)
        ends.append(pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-10).packing)
    np.testing.assert_allclose(ends[0].position_nd, ends[1].position_nd, atol=1e-9)
    assert np.abs(ends[0].link_error).max() < 1e-13


def test_a_collinear_rigid_trimer_is_refused():
    position = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    links = pm.Links([0, 1, 0], [1, 2, 2], np.zeros((3, 2)), [1.0, 1.0, 2.0])
    packing = pm.Packing(position, [0.5] * 3, pm.Box.cubic(2.5, 2), links)
    with pytest.raises(ValueError, match="links that hold to first order, got a link of collinear particles 0, 1, 2"):
        pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-8)


def test_two_crossing_dimers_stay_locked_and_are_named():
    position = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, -0.5], [0.5, 0.5]])
    links = pm.Links([0, 2], [1, 3], np.zeros((2, 2)), [1.0, 1.0])
    packing = pm.Packing(position + 2.0, [0.5] * 4, pm.Box.cubic(6.0, 2), links)
    run = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-8)
    assert run.report["crossing_links"] == ((0, 1),) and run.report["crossed_links"] == ()
    # the source's bound: two ends within length / sqrt2, so that a crossing costs an overlap of 1 - 1/sqrt2
    assert pm.find_contacts(run.packing, gap_tolerance=0.0).overlap_c.max() >= 1.0 - 1.0 / np.sqrt(2.0) - 1e-12


def test_links_that_cross_on_the_way_are_named():
    # two discs of different dimers, one just past the other's link
    position = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.02], [0.5, 1.02]])
    links = pm.Links([0, 2], [1, 3], np.zeros((2, 2)), [1.0, 1.0])
    packing = pm.Packing(position + 2.0, [0.5] * 4, pm.Box.cubic(6.0, 2), links)
    pushed = packing.replace(position_nd=packing.position_nd - np.array([[0, 0], [0, 0], [0, 0.03], [0, 0.03]]))
    assert pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-6).report["crossed_links"] == ()
    assert pm.quench(pm.Scene(pushed, (pm.Repulsion(),)), force_tolerance=1e-6).report["crossing_links"] == ((0, 1),)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**20), st.floats(0.7, 1.4))
def test_scaling_the_box_keeps_the_shape_of_clusters(seed, factor):
    packing = pm.cluster_packing(5, pm.Trimer(), dimension=2, packing_fraction=0.6, seed=seed)
    scaled = scale_box(packing, factor)
    assert pm.packing_fraction(scaled) == pytest.approx(pm.packing_fraction(packing) / factor**2, rel=1e-12)
    before = packing.links.vectors(packing.position_nd, packing.box.lattice_dd)
    after = scaled.links.vectors(scaled.position_nd, scaled.box.lattice_dd)
    np.testing.assert_allclose(after, before, atol=1e-13)


def test_one_seed_gives_the_same_bits_twice_with_links():
    one, two = (pm.quench(trimers(seed=3), force_tolerance=1e-10).packing for _ in range(2))
    assert one == two


def test_a_link_far_longer_than_the_box_is_quenched_all_the_same():
    packing = pm.random_packing(24, dimension=2, packing_fraction=1.0, seed=8)
    image = np.array([[100_000, 3]])
    vector = packing.position_nd[1] - packing.position_nd[0] + packing.box.lattice_dd @ image[0]
    linked = packing.replace(links=pm.Links([0], [1], image, [float(np.hypot(*vector))]))
    run = pm.quench(pm.Scene(linked, (pm.Repulsion(),)), force_tolerance=1e-6)
    assert run.report["crossing_links"] is None and np.abs(run.packing.link_error).max() < 1e-9
