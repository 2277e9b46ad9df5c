"""Facts about normal modes and their density."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

import packmech as pm


def crystal_scene(name, repeats, overlap=0.0, **law):
    packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=overlap)
    return pm.Scene(packing.replace(mass_n=np.ones(packing.particles)), (pm.Repulsion(**law),))


def waves(bonds, lattice, repeats, along, across):
    """Return the squared frequencies of a crystal of one particle a cell, from its dynamical matrix at every wave."""
    values = []
    reciprocal = 2 * np.pi * np.linalg.inv(lattice).T
    for index in np.ndindex(*repeats):
        wave = reciprocal @ (np.array(index) / np.array(repeats))
        matrix = np.zeros((len(lattice), len(lattice)))
        for bond in bonds:
            normal = bond / np.linalg.norm(bond)
            outer = np.outer(normal, normal)
            matrix += 2 * (1 - np.cos(wave @ bond)) * (along * outer + across * (np.eye(len(lattice)) - outer))
        values.extend(np.linalg.eigvalsh(matrix))
    return np.sort(values)


ROOT = 3**0.5 / 2
TRIANGULAR = np.array([[1.0, 0.0], [0.5, ROOT], [-0.5, ROOT]])
FCC = np.array([[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]) / 2**0.5


@pytest.mark.parametrize("overlap", [0.0, 0.03])
@pytest.mark.parametrize(("name", "bonds", "repeats"), [("triangular", TRIANGULAR, (5, 6)), ("fcc", FCC, (3, 3, 4))])
def test_crystals_vibrate_in_plane_waves(name, bonds, repeats, overlap):
    scene = crystal_scene(name, repeats, overlap)
    lattice = scene.packing.box.lattice_dd / np.array(repeats)
    # u' / r and u'' of the harmonic law at unit diameter
    expected = waves(bonds * (1 - overlap), lattice, repeats, 1.0, -overlap / (1 - overlap))
    modes = pm.normal_modes(scene)
    d = len(repeats)
    # the d waves of infinite length are the translations
    np.testing.assert_allclose(modes.eigenvalue_m, np.delete(expected, np.argsort(np.abs(expected))[:d]), atol=1e-12)
    assert modes.complete and modes.translations == d and modes.translation_error < 1e-15


@pytest.mark.parametrize(
    ("name", "repeats", "zero"),
    [("kagome", (8, 8), 3 * 8 - 2), ("square", (15, 15), 2 * 15 - 2), ("triangular", (15, 15), 0)],
)
def test_shift_and_invert_finds_every_member_of_degenerate_sets(name, repeats, zero):
    scene = crystal_scene(name, repeats)
    dense = pm.normal_modes(scene, method="dense")
    sparse = pm.normal_modes(scene, 40, method="shift-invert")
    # inverted at a shift of 1e-6, eigenvectors are good to about 1e6 rounding units
    assert sparse.missed == 0 and sparse.residual < 1e-10
    np.testing.assert_allclose(sparse.eigenvalue_m, dense.eigenvalue_m[:40], atol=1e-12)
    assert int(sparse.zero_m.sum()) == zero == int(dense.zero_m.sum())


@pytest.mark.parametrize(("particles", "dimension", "fraction"), [(300, 2, 0.9), (128, 3, 0.7)])
@pytest.mark.parametrize("strain", ["none", "free"])
def test_shift_and_invert_agrees_with_dense_diagonalization(rest_scene, particles, dimension, fraction, strain):
    scene = rest_scene(particles, dimension, fraction, 3)
    dense = pm.normal_modes(scene, 30, method="dense", strain=strain)
    sparse = pm.normal_modes(scene, 30, method="shift-invert", strain=strain)
    np.testing.assert_allclose(sparse.eigenvalue_m, dense.eigenvalue_m, rtol=1e-9)
    overlap = np.einsum("mnd,n,mnd->m", sparse.displacement_mnd, scene.packing.mass_n, dense.displacement_mnd)
    scale = scene.packing.box.volume ** (1 / dimension)
    overlap += scale**2 * (sparse.strain_me * dense.strain_me).sum(axis=1)
    np.testing.assert_allclose(overlap, 1.0, atol=1e-8)


def with_masses(scene, mass_n):
    return scene.replace(packing=scene.packing.replace(mass_n=mass_n))


def test_modes_solve_the_eigenproblem_and_are_orthonormal_in_the_mass_metric(rest_scene):
    scene = rest_scene(64, 2, 0.9, 1)
    mass = np.linspace(1.0, 2.0, 64)
    modes = pm.normal_modes(with_masses(scene, mass), rattlers="keep")
    flat = modes.displacement_mnd.reshape(len(modes), -1)
    weight = np.repeat(mass, 2)
    np.testing.assert_allclose((flat * weight) @ flat.T, np.eye(len(modes)), atol=1e-12)
    hessian = pm.hessian(scene, "none")
    force = (hessian @ flat.T).T
    np.testing.assert_allclose(force, modes.eigenvalue_m[:, None] * weight * flat, atol=1e-12)
    assert modes.residual < 1e-13
    # no mode moves the center of mass
    assert np.abs(np.einsum("n,mnd->md", mass, modes.displacement_mnd)).max() < 1e-12


def test_frequencies_fall_with_the_root_of_a_common_mass(rest_scene):
    scene = rest_scene(64, 2, 0.9, 1)
    light, heavy = (pm.normal_modes(with_masses(scene, np.full(64, mass))).frequency_m for mass in (1.0, 9.0))
    np.testing.assert_allclose(light, 3 * heavy, rtol=1e-10)


def test_rattlers_add_d_zero_modes_each(rest_scene):
    scene = rest_scene(128, 2, 0.86, 5)
    rattlers = int(pm.find_rattlers(scene.packing).sum())
    contacts = pm.find_contacts(scene.packing).count_n()[pm.find_rattlers(scene.packing)]
    assert rattlers > 0 and not contacts.any()
    without, with_them = pm.normal_modes(scene), pm.normal_modes(scene, rattlers="keep")
    assert with_them.available == without.available + 2 * rattlers
    assert int(with_them.zero_m.sum()) == 2 * rattlers and not without.zero_m.any()
    np.testing.assert_allclose(with_them.eigenvalue_m[2 * rattlers :], without.eigenvalue_m, atol=1e-12)
    loose = pm.find_rattlers(scene.packing)
    assert not without.displacement_mnd[:, loose].any()


@pytest.mark.parametrize("method", ["dense", "shift-invert"])
def test_unstable_packings_have_modes_of_negative_frequency(method):
    scene = crystal_scene("square", (12, 12), 0.02)
    expected = np.linalg.eigvalsh(pm.hessian(scene, "none").toarray())
    modes = pm.normal_modes(scene, 60, method=method)
    assert modes.negative == int((expected < -1e-9).sum()) > 10
    np.testing.assert_allclose(modes.eigenvalue_m[:20], expected[:20], atol=1e-12)
    assert (modes.frequency_m[: modes.negative] < 0).all()


def test_prestress_only_softens_the_modes_of_repelling_particles(rest_scene):
    scene = rest_scene(64, 2, 0.9, 1)
    exact, unstressed = (pm.normal_modes(scene, kind=kind).eigenvalue_m for kind in ("exact", "unstressed"))
    assert (exact < unstressed + 1e-14).all()


def test_signs_of_modes_with_strain_do_not_depend_on_the_strain_scale(rest_scene):
    for seed in range(4):
        scene = rest_scene(32, 2, 0.86, seed)
        counts = {
            (modes.negative, int(modes.zero_m.sum()))
            for modes in (pm.normal_modes(scene, strain="free", strain_scale=scale) for scale in (0.3, 1.0, 5.0))
        }
        assert len(counts) == 1


def test_a_packing_with_fewer_modes_gives_those_it_has():
    modes = pm.normal_modes(crystal_scene("triangular", (2, 2)), 50)
    assert len(modes) == modes.available == 6
    alone = pm.normal_modes(crystal_scene("triangular", (1, 1)))
    assert len(alone) == 0 and alone.available == 0
    strained = pm.normal_modes(crystal_scene("triangular", (1, 1)), strain="free")
    assert len(strained) == 3 and (strained.participation_m == 0.0).all()


def test_all_modes_asked_for_by_their_number_are_all_whatever_the_method():
    scene = crystal_scene("triangular", (3, 3))
    few, every = pm.normal_modes(scene, 16, method="shift-invert"), pm.normal_modes(scene)
    assert few.complete and np.array_equal(few.eigenvalue_m, every.eigenvalue_m)


def test_a_packing_without_contacts_has_no_backbone_to_vibrate():
    packing = pm.Packing([[0.0, 0.0], [1.0, 1.0]], [0.1, 0.1], pm.Box.cubic(2.0, 2))
    scene = pm.Scene(packing, (pm.Repulsion(),))
    assert len(pm.normal_modes(scene)) == 0
    assert int(pm.normal_modes(scene, rattlers="keep").zero_m.sum()) == 2


def test_a_repetition_has_the_same_bits(rest_scene):
    scene = rest_scene(300, 2, 0.9, 3)
    one, two = (pm.normal_modes(scene, 20) for _ in range(2))
    np.testing.assert_array_equal(one.eigenvalue_m, two.eigenvalue_m)
    np.testing.assert_array_equal(one.displacement_mnd, two.displacement_mnd)


def test_the_number_of_threads_does_not_change_a_bit(rest_scene):
    answers = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            answers.append(pm.normal_modes(rest_scene(300, 2, 0.9, 3), 20).displacement_mnd)
    np.testing.assert_array_equal(*answers)


# -- density of states -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("particles", "dimension", "fraction"), [(96, 2, 0.9), (64, 3, 0.7)])
def test_counting_by_inertia_gives_the_histogram_of_all_modes(rest_scene, particles, dimension, fraction):
    scene = rest_scene(particles, dimension, fraction, 4)
    modes = pm.normal_modes(scene)
    edges = np.linspace(0.0, modes.frequency_m[-1] * 1.01, 24)
    counted, histogram = pm.density_of_states(scene, edges), pm.density_of_states(modes, edges)
    np.testing.assert_array_equal(counted.count_b, histogram.count_b)
    assert counted.count_b.sum() == modes.available == counted.modes


@pytest.mark.parametrize("overlap", [0.0, 1e-12, 1e-11])
def test_rows_that_slide_are_zero_modes_above_an_edge_at_zero_though_the_least_pressure_makes_them_fall(overlap):
    """A square crystal slides along each row and column: 2 (n - 1) zero modes, which pressure lets fall."""
    scene = crystal_scene("square", (5, 5), overlap)
    assert pm.density_of_states(scene, [-1.0, 0.0, 1e-3, 10.0], gap_tolerance=1e-9).count_b.tolist() == [0, 8, 40]


@pytest.mark.parametrize("name", ["triangular", "square"])
def test_density_of_states_integrates_to_one(name):
    for overlap in (0.0, 0.05):
        scene = crystal_scene(name, (8, 8), overlap)
        for source in (scene, pm.normal_modes(scene)):
            states = pm.density_of_states(source, 17)
            assert abs((states.density_b * np.diff(states.edge_b)).sum() - 1.0) < 1e-12


SCENE = crystal_scene("triangular", (3, 3))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: pm.normal_modes(SCENE.packing), TypeError, "scene must be a Scene"),
        (lambda: pm.normal_modes(SCENE, 0), ValueError, "count must be an integer at least 1, got 0"),
        (lambda: pm.normal_modes(SCENE, 2.5), TypeError, "count must be an integer"),
        (lambda: pm.normal_modes(SCENE, method="lanczos"), ValueError, "method must be one of"),
        (lambda: pm.normal_modes(SCENE, rattlers="drop"), ValueError, "rattlers must be one of"),
        (lambda: pm.density_of_states(3), TypeError, "source must be a Scene"),
        (
            lambda: pm.density_of_states(pm.normal_modes(SCENE, 3)),
            ValueError,
            "source must hold all modes, got 3 of 16",
        ),
        (
            lambda: pm.density_of_states(SCENE, [1.0, 0.5]),
            ValueError,
            "bins must be a number or at least two increasing edges",
        ),
        (lambda: pm.density_of_states(SCENE, 0), ValueError, "bins must be an integer at least 1"),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_spectra_do_not_depend_on_labels_lattice_vectors_wrapping_or_rotation(rest_scene, seed):
    scene = rest_scene(64, 2, 0.9, 1)
    packing = scene.packing
    rng = np.random.default_rng(seed)
    order = rng.permutation(64)
    image = rng.integers(-2, 3, size=(64, 2))
    shear = np.array([[1, rng.integers(-3, 4)], [0, 1]])
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    position = (packing.position_nd + image @ packing.box.lattice_dd.T)[order] @ turn.T
    other = pm.Packing(position, packing.radius_n[order], pm.Box(turn @ packing.box.lattice_dd @ shear))
    for strain in ("none", "free"):
        one = pm.normal_modes(scene, strain=strain).eigenvalue_m
        two = pm.normal_modes(scene.replace(packing=other), strain=strain).eigenvalue_m
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-12 * one.max())


def test_participation_is_one_where_all_move_alike_and_sums_weights_of_particles():
    """(sum w)^2 / (N sum w^2), w = m u.u of a particle; two discs that part move alike."""
    packing = pm.random_packing(24, dimension=2, packing_fraction=1.0, sizes=pm.Bidisperse(ratio=1.4), seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-10).packing)
    modes = pm.normal_modes(scene)
    weight = scene.packing.mass_n * (modes.displacement_mnd**2).sum(axis=2)
    expected = weight.sum(axis=1) ** 2 / (len(modes.index_n) * (weight**2).sum(axis=1))
    assert modes.participation_m == pytest.approx(expected, rel=1e-9)
    pair = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    stretch = pm.normal_modes(pm.Scene(pair, (pm.Repulsion(),)), rattlers="keep").participation_m[-1]
    assert stretch == pytest.approx(1.0)


def test_where_no_mode_is_left_there_are_no_states_and_nothing_is_divided_by_zero():
    apart = pm.Packing([[0.5, 0.5], [2.5, 2.5]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    for bins in (7, [0.0, 0.5, 2.0]):
        states = pm.density_of_states(pm.Scene(apart, (pm.Repulsion(),)), bins)
        assert states.modes == 0 and len(states.count_b) == len(states.edge_b) - 1
        assert not states.count_b.any() and not states.density_b.any()
        assert np.isnan(states.plateau) and np.isnan(states.plateau_edge)


def test_modes_of_a_packing_that_is_not_at_rest_say_so():
    scene = pm.Scene(pm.random_packing(64, dimension=2, packing_fraction=0.9, seed=3), (pm.Repulsion(),))
    with pytest.warns(UserWarning, match="scene should be at rest"):
        modes, moduli = pm.normal_modes(scene, 5), pm.elastic_moduli(scene)
    assert modes.force_residual == moduli.force_residual > 0.1
    assert "not at rest" in repr(modes).splitlines()[0]


def test_the_plateau_of_states_ends_where_the_density_falls_to_half():
    """Uniform from .1 to 1 and nothing below: averaged over a quarter to both sides, half is reached near the step."""
    edge = np.geomspace(1e-3, 2.0, 200)
    count = np.round(1e6 * np.diff(np.clip(edge, 0.1, 1.0))).astype(np.int64)
    states = pm.StateDensity(edge, count, int(count.sum()), 0.0)
    assert states.plateau == pytest.approx(1.0 / 0.9, rel=1e-3)
    assert states.plateau_edge == pytest.approx(0.1, rel=0.05)
    both = pm.StateDensity.merged([states, states])
    assert both.modes == 2 * states.modes and both.plateau_edge == states.plateau_edge
