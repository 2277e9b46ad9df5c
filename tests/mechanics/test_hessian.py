"""Facts about second derivatives of the energy."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts import pair_contacts
from packmech.effects import contact_terms
from packmech.linalg.mandel import isochoric_basis, mandel_tensor, mandel_vector
from packmech.measure.stress import sum_forces
from packmech.mechanics.hessian import is_stable

LAW_NAMES = ["harmonic", "hertz", "power 3", "lennard-jones", "spring", "user's"]


def moved(packing, motion):
    """Return the packing after (positions, Mandel strain): v -> (1 + strain)(v + dv)."""
    count = packing.position_nd.size
    gradient = mandel_tensor(motion[count:])
    position = packing.position_nd + motion[:count].reshape(packing.position_nd.shape)
    return pm.Packing(position @ (np.eye(len(gradient)) + gradient), packing.radius_n, packing.box.strained(gradient))


def energy_gradient(scene, motion):
    """Return dU/d(positions, strain) at a motion, from first derivatives only."""
    packing = scene.packing
    count = packing.position_nd.size
    gradient = np.eye(packing.dimension) + mandel_tensor(motion[count:])
    now = moved(packing, motion)
    contacts = pm.find_contacts(now)
    terms = contact_terms(scene.effects, contacts)
    uphill = -sum_forces(contacts, -terms.first_c) @ gradient
    # vectors before the strain: the derivative of |(1 + e) v| with respect to e is n v
    before = contacts.vector_cd @ np.linalg.inv(gradient).T
    stretch = np.einsum("c,ca,cb->ab", terms.first_c, contacts.normal_cd, before)
    return np.concatenate([uphill.ravel(), mandel_vector(stretch)])


def numerical_hessian(scene, size=2e-4):
    """Return central differences of fourth order of the gradient."""
    packing = scene.packing
    count = packing.position_nd.size + packing.dimension * (packing.dimension + 1) // 2
    columns = []
    for one in np.eye(count) * size:
        near = energy_gradient(scene, one) - energy_gradient(scene, -one)
        far = energy_gradient(scene, 2 * one) - energy_gradient(scene, -2 * one)
        columns.append((8 * near - far) / (12 * size))
    return np.stack(columns, axis=1)


def test_hessian_blocks_agree_with_automatic_differentiation(golden):
    stored = golden("random_mono_2d_w3.0.json")
    packing = pm.Packing(stored["positions"], stored["radii"], pm.Box(stored["lattice_columns"]))
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.PowerLaw(1.0, stored["w"])),))
    found = pm.hessian(scene).toarray()
    for block, name in ((np.s_[:12, :12], "H_xx"), (np.s_[12:, :12], "H_ex_mandel"), (np.s_[12:, 12:], "H_ee_mandel")):
        np.testing.assert_allclose(found[block], stored[name], rtol=0, atol=1e-12)
    assert abs(pm.energy(scene) - stored["energy"]) < 1e-12
    np.testing.assert_allclose(pm.forces(scene), stored["forces"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(pm.stress_tensor(scene), stored["contact_stress_tensor"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("law", LAW_NAMES)
@pytest.mark.parametrize("seed", range(2))
def test_hessian_is_the_derivative_of_the_gradient_in_skewed_boxes(random_scene, dimension, law, seed):
    scene = random_scene(dimension, seed, law, 7 if dimension == 2 else 5)
    found = pm.hessian(scene).toarray()
    expected = numerical_hessian(scene)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_hessians_of_several_effects_add_up(random_scene):
    packing = random_scene(2, 3).packing
    parts = [pm.Repulsion(law=pm.Harmonic(0.3)), pm.Repulsion(law=pm.Hertz(2.0))]
    both = pm.hessian(pm.Scene(packing, tuple(parts))).toarray()
    each = [pm.hessian(pm.Scene(packing, (part,))).toarray() for part in parts]
    np.testing.assert_allclose(both, each[0] + each[1], atol=1e-14)
    damped = pm.hessian(pm.Scene(packing, (parts[0], pm.ContactDamping(0.5)))).toarray()
    np.testing.assert_array_equal(damped, each[0])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 30), dimension=st.sampled_from([2, 3]))
def test_uniform_translations_cost_nothing_and_the_matrix_is_symmetric(random_scene, seed, dimension):
    scene = random_scene(dimension, seed)
    found = pm.hessian(scene).toarray()
    np.testing.assert_array_equal(found, found.T)
    shift = np.zeros((len(found), dimension))
    for a in range(dimension):
        shift[a : scene.packing.position_nd.size : dimension, a] = 1.0
    assert np.abs(found @ shift).max() < 1e-13 * np.abs(found).max()


@pytest.mark.parametrize("dimension", [2, 3])
def test_unstressed_hessian_is_the_spring_network_of_the_rigidity_matrix(random_scene, dimension):
    scene = random_scene(dimension, 4, "lennard-jones")
    contacts = pm.find_contacts(scene.packing)
    second = contact_terms(scene.effects, contacts).second_c
    rigidity = pm.rigidity_matrix(scene.packing).toarray()
    expected = rigidity.T @ (second[:, None] * rigidity)
    found = pm.hessian(scene, kind="unstressed").toarray()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_without_strain_the_hessian_is_its_position_block(random_scene):
    scene = random_scene(3, 1)
    count = scene.packing.position_nd.size
    np.testing.assert_array_equal(pm.hessian(scene, "none").toarray(), pm.hessian(scene).toarray()[:count, :count])


def test_paper_and_exact_kinds_differ_by_the_curvature_of_a_fixed_volume_only():
    scene = pm.Scene(pm.lattice_packing("fcc", repeats=(2, 2, 2), relative_overlap=0.05), (pm.Repulsion(),))
    exact, paper = (pm.hessian(scene, kind=kind).toarray() for kind in ("exact", "paper"))
    np.testing.assert_array_equal(exact, paper)
    held = pm.hessian(scene, strain="isochoric").toarray() - exact
    pressure_volume = pm.pressure(scene) * scene.packing.box.volume
    one = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(held[-6:, -6:], pressure_volume * (np.outer(one, one) - np.eye(6)), atol=1e-13)
    assert not held[:-6].any()
    for other in (
        pm.hessian(scene, strain="isochoric", volume_curvature="trace"),
        pm.hessian(scene, strain="isochoric", kind="paper"),
    ):
        np.testing.assert_array_equal(other.toarray(), exact)


@pytest.mark.parametrize(("name", "dimension"), [("triangular", 2), ("fcc", 3)])
def test_curvature_of_a_fixed_volume_is_that_of_the_energy_along_a_path_that_keeps_the_determinant(name, dimension):
    scene = pm.Scene(pm.lattice_packing(name, repeats=(2,) * dimension, relative_overlap=0.1), (pm.Repulsion(),))
    packing = scene.packing
    strain = isochoric_basis(dimension) @ np.random.default_rng(2).normal(size=dimension * (dimension + 1) // 2 - 1)

    def energy(size):
        stretch = scipy.linalg.expm(size * mandel_tensor(strain))
        box = pm.Box(stretch @ packing.box.lattice_dd)
        return pm.energy(pm.Scene(pm.Packing(packing.position_nd @ stretch.T, packing.radius_n, box), scene.effects))

    h = 2e-3
    curvature = (16 * (energy(h) + energy(-h)) - energy(2 * h) - energy(-2 * h) - 30 * energy(0.0)) / (12 * h * h)
    components = len(strain)
    held = pm.hessian(scene, strain="isochoric").toarray()[-components:, -components:]
    free = pm.hessian(scene).toarray()[-components:, -components:]
    assert abs(strain @ held @ strain - curvature) < 1e-7 * abs(curvature)
    assert abs(strain @ free @ strain - curvature) > 1e-2 * abs(curvature)


# -- what just touches -------------------------------------------------------------------------------------------------


def test_a_crystal_at_contact_has_the_stiffness_of_the_closed_side():
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    stiff = pm.hessian(pm.Scene(crystal, (pm.Repulsion(law=pm.RepulsiveLennardJones()),))).toarray()
    harmonic = pm.hessian(pm.Scene(crystal, (pm.Repulsion(),))).toarray()
    np.testing.assert_allclose(stiff, 72.0 * harmonic, rtol=0, atol=1e-10)
    soft = pm.hessian(pm.Scene(crystal, (pm.Repulsion(law=pm.Hertz()),))).toarray()
    assert np.abs(soft).max() < 1e-6


def test_contacts_beyond_the_gap_tolerance_do_not_count():
    crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=-1e-6)
    scene = pm.Scene(crystal, (pm.Repulsion(),))
    assert pm.hessian(scene).nnz == 0
    assert pm.hessian(scene, gap_tolerance=1e-5).nnz > 0


# -- the energy of a perturbation --------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("strained", [False, True])
@pytest.mark.parametrize("law", LAW_NAMES)
def test_error_of_the_perturbation_energy_is_of_third_order(random_scene, dimension, strained, law):
    scene = random_scene(dimension, 6, law)
    packing = scene.packing
    rng = np.random.default_rng(8)
    displacement = rng.normal(size=packing.position_nd.shape)
    strain = mandel_tensor(rng.normal(size=dimension * (dimension + 1) // 2)) if strained else None
    count = dimension * (dimension + 1) // 2
    errors = []
    sizes = 1.5e-4 * 0.5 ** np.arange(3)
    for size in sizes:
        motion = np.zeros(packing.position_nd.size + count)
        motion[: packing.position_nd.size] = size * displacement.ravel()
        linear = -size * (pm.forces(scene) * displacement).sum()
        if strained:
            motion[-count:] = size * mandel_vector(strain)
            linear += size * packing.box.volume * (pm.stress_tensor(scene) * strain).sum()
        second = pm.perturbation_energy(scene, size * displacement, None if strain is None else size * strain)
        true = pm.energy(scene.replace(packing=moved(packing, motion))) - pm.energy(scene)
        errors.append(abs(true - linear - second))
    order = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 2.9 < order < 3.1


def test_perturbation_energy_is_the_change_of_energy_at_rest(rest_scene):
    scene = rest_scene(64, 2, 0.9, 1)
    displacement = 1e-5 * np.random.default_rng(0).normal(size=(64, 2))
    predicted = pm.perturbation_energy(scene, displacement)
    moved_scene = scene.replace(packing=scene.packing.replace(position_nd=scene.packing.position_nd + displacement))
    assert abs(pm.energy(moved_scene) - pm.energy(scene) - predicted) < 1e-3 * predicted


# -- the dynamical matrix ----------------------------------------------------------------------------------------------


def test_dynamical_matrix_is_the_hessian_weighted_with_masses_and_the_strain_scale(random_scene):
    scene = random_scene(2, 2)
    mass = np.linspace(0.5, 3.0, scene.packing.particles)
    weight = np.concatenate([np.repeat(mass**-0.5, 2), np.full(3, 1 / 1.7)])
    expected = pm.hessian(scene).toarray() * weight * weight[:, None]
    found = pm.dynamical_matrix(
        scene.replace(packing=scene.packing.replace(mass_n=mass)), "free", strain_scale=1.7
    ).toarray()
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-15)


def test_default_strain_scale_is_the_side_of_a_cube_of_the_volume(random_scene):
    scene = random_scene(3, 2)
    side = scene.packing.box.volume ** (1 / 3)
    default, given_scale = (pm.dynamical_matrix(scene, "free", strain_scale=one).toarray() for one in (None, side))
    np.testing.assert_array_equal(default, given_scale)


def test_a_fixed_volume_leaves_one_strain_fewer(random_scene):
    scene = random_scene(2, 2)
    assert pm.dynamical_matrix(scene, "free").shape == (17, 17)
    assert pm.dynamical_matrix(scene, "isochoric").shape == (16, 16)


def test_coincident_centers_are_refused():
    packing = pm.Packing([[0.5, 0.5], [0.5, 0.5]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    with pytest.raises(ValueError, match="must have no coincident centers .* got particles 0 and 1"):
        pm.hessian(pm.Scene(packing, (pm.Repulsion(),)))


SCENE = pm.Scene(pm.lattice_packing("triangular", repeats=(2, 2)), (pm.Repulsion(),))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: pm.hessian(SCENE.packing), TypeError, "scene must be a Scene"),
        (lambda: pm.hessian(SCENE, kind="bare"), ValueError, "kind must be one of"),
        (lambda: pm.hessian(SCENE, "held"), ValueError, "strain must be one of"),
        (lambda: pm.hessian(SCENE, volume_curvature="none"), ValueError, "volume_curvature must be one of"),
        (lambda: pm.hessian(SCENE, 1), ValueError, "strain must be one of"),
        (lambda: pm.dynamical_matrix(SCENE, strain_scale=0.0), ValueError, "strain_scale must be"),
        (lambda: pm.perturbation_energy(SCENE, np.zeros((3, 2))), ValueError, "displacement_nd must have shape"),
        (
            lambda: pm.perturbation_energy(SCENE, np.full((4, 2), np.nan)),
            ValueError,
            "displacement_nd must be finite, got nan for particle 0",
        ),
        (
            lambda: pm.perturbation_energy(SCENE, np.zeros((4, 2)), [[0.0, 1.0], [0.0, 0.0]]),
            ValueError,
            "strain_dd must be symmetric",
        ),
        (
            lambda: pm.perturbation_energy(SCENE, np.zeros((4, 2)), np.zeros((3, 3))),
            ValueError,
            "strain_dd must have shape",
        ),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()


def test_pairs_through_several_images_add_up():
    # two particles in a box so small that they touch through many images
    packing = pm.Packing([[0.0, 0.0], [0.3, 0.45]], [0.5, 0.55], pm.Box([[0.9, 0.1], [0.0, 1.0]]))
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    contacts = pm.find_contacts(packing)
    assert len(contacts) > 6 and (contacts.i_c == contacts.j_c).any()
    again = pair_contacts(packing, contacts.i_c, contacts.j_c, contacts.image_cd)
    np.testing.assert_array_equal(again.distance_c, contacts.distance_c)
    found, expected = pm.hessian(scene).toarray(), numerical_hessian(scene, 5e-5)
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


def test_crystals_are_stable_where_every_motion_and_in_a_box_of_free_shape_every_strain_takes_work():
    def stable(name, repeats, overlap, strain):
        packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=overlap)
        return is_stable(pm.Scene(packing, (pm.Repulsion(),)), strain=strain)

    for strain in ("none", "isochoric"):
        assert stable("triangular", (3, 3), 0.01, strain) and stable("fcc", (2, 2, 2), 0.01, strain)
        # rows of a square crystal slide; of a triangular one they shear away beyond an overlap of one quarter
        assert not stable("square", (2, 2), 0.01, strain)
    assert not stable("triangular", (3, 3), 0.26, "isochoric")
    # one particle cannot slide past itself, but its box may be sheared
    assert stable("square", (1, 1), 0.01, "none") and not stable("square", (1, 1), 0.01, "isochoric")
    # nothing that touches nothing is stable, nor is what is left without its rattlers
    apart = pm.lattice_packing("square", repeats=(2, 2)).replace(radius_n=np.full(4, 0.1))
    assert not is_stable(pm.Scene(apart, (pm.Repulsion(),)), strain="none")


def test_strains_of_symmetric_gradients_alone_have_an_energy():
    packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    scene, still = pm.Scene(packing, (pm.Repulsion(),)), np.zeros((9, 2))
    assert pm.perturbation_energy(scene, still, strain_dd=np.zeros((2, 2))) == 0.0
    assert pm.perturbation_energy(scene, still, strain_dd=[[0.0, 1e-3], [1e-3, 0.0]]) > 0.0
    with pytest.raises(ValueError, match="strain_dd must be symmetric, got"):
        pm.perturbation_energy(scene, still, strain_dd=[[0.0, 1e-3], [0.0, 0.0]])


@pytest.mark.parametrize("held", [(), (4, 5)])
def test_links_leave_one_motion_fewer_each_and_what_is_held_none(held):
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    vector = packing.position_nd[1] - packing.position_nd[0]
    packing = packing.replace(links=pm.Links([0], [1], [[0, 0]], [float(np.linalg.norm(vector))]))
    effects = (pm.Repulsion(), *([pm.FixedParticles(held)] if held else []))
    matrix = pm.dynamical_matrix(pm.Scene(packing, effects), "none", gap_tolerance=1e-9)
    matrix = matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)
    assert matrix.shape == (18 - 1 - 2 * len(held),) * 2
    assert np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix)[0] > -1e-12
