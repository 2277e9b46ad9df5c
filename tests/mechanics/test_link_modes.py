"""Facts about normal modes of packings with links."""

import numpy as np
import pytest

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.mechanics.hessian import is_stable

AT_REST = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]


@pytest.mark.parametrize("name", AT_REST)
def test_spectra_at_fixed_volume_are_the_stored_ones_without_translations(linked, name):
    scene, data = linked(name)
    dimension = scene.packing.dimension
    for kind, curvature, stored in (
        ("paper", "det", "paper"),
        ("exact", "trace", "exact_trace"),
        ("exact", "det", "exact_det"),
    ):
        modes = pm.normal_modes(scene, strain="isochoric", kind=kind, volume_curvature=curvature, strain_scale=1.0)
        expected = np.sort(data[f"eigvals_reduced_fixed_volume_{stored}"])
        zero = np.argsort(np.abs(expected))[:dimension]
        assert np.abs(modes.eigenvalue_m - np.delete(expected, zero)).max() < 1e-9
        assert modes.residual < 1e-13 and modes.translation_error < 1e-13 and modes.complete


@pytest.mark.parametrize(("name", "strain"), [("jammed_dimer_strain", "isochoric"), ("jammed_trimer_fixedbox", "none")])
def test_spectra_near_jamming_are_the_stored_ones(linked, name, strain):
    scene, data = linked(name)
    for kind in ("exact", "paper"):
        modes = pm.normal_modes(
            scene, strain=strain, kind=kind, volume_curvature="trace", strain_scale=1.0, rattlers="keep"
        )
        assert np.abs(modes.eigenvalue_m - np.sort(data[f"eigvals_{kind}"])).max() < 1e-9


@pytest.mark.parametrize("name", AT_REST)
@pytest.mark.parametrize("strain", ["none", "free"])
def test_modes_keep_the_links_and_are_orthonormal_in_the_mass_metric(linked, name, strain):
    scene, _ = linked(name)
    packing = scene.packing
    mass = np.random.default_rng(0).uniform(0.5, 2.0, size=packing.particles)
    scene = scene.replace(packing=packing.replace(mass_n=mass))
    modes = pm.normal_modes(scene, strain=strain, strain_scale=2.3)
    links = ConstraintFactor(packing)
    change = modes.displacement_mnd.reshape(len(modes), -1) @ links.gradient_lx.T.toarray()
    change += modes.strain_me @ links.strain_le.T
    assert np.abs(change).max() < 1e-14
    metric = np.einsum("mnd,n,knd->mk", modes.displacement_mnd, mass, modes.displacement_mnd)
    metric += 2.3**2 * modes.strain_me @ modes.strain_me.T
    assert np.abs(metric - np.eye(len(modes))).max() < 1e-13
    value = np.linalg.eigvalsh(pm.dynamical_matrix(scene, strain, strain_scale=2.3).toarray())
    zero = np.argsort(np.abs(value))[: packing.dimension]
    assert np.abs(modes.eigenvalue_m - np.delete(value, zero)).max() < 1e-13


@pytest.fixture(scope="module")
def crystal():
    """Dimers and trimers cut out of a disturbed crystal, not at rest."""
    packing = pm.lattice_packing("triangular", repeats=(12, 12), relative_overlap=0.03)
    shake = 0.01 * np.random.default_rng(0).normal(size=packing.position_nd.shape)
    packing = packing.replace(position_nd=packing.position_nd + shake)
    contacts = pm.find_contacts(packing)
    taken = np.zeros(packing.particles, dtype=int)
    chosen = []
    for c, (i, j) in enumerate(zip(contacts.i_c, contacts.j_c, strict=True)):
        if taken[i] + taken[j] < 2 and taken[i] < 2 and taken[j] < 2:
            taken[[i, j]] += 1
            chosen.append(c)
    links = pm.Links(contacts.i_c[chosen], contacts.j_c[chosen], contacts.image_cd[chosen], contacts.distance_c[chosen])
    return pm.Scene(packing.replace(links=links), (pm.Repulsion(),))


@pytest.mark.parametrize("strain", ["none", "free"])
def test_shift_and_invert_finds_the_modes_of_the_dense_method(crystal, strain):
    dense = pm.normal_modes(crystal, 20, strain=strain, method="dense")
    sparse = pm.normal_modes(crystal, 20, strain=strain, method="shift-invert")
    assert len(crystal.packing.links) > 60
    assert np.abs(dense.eigenvalue_m - sparse.eigenvalue_m).max() < 1e-11 * dense.largest
    assert sparse.missed == 0 and sparse.residual < 1e-12
    assert sparse.available == dense.available == 2 * 144 - 2 + 3 * (strain == "free") - len(crystal.packing.links)


def test_links_around_the_box_leave_no_mode_with_the_strain_along_them():
    place = [[0.5 + k, 1.0] for k in range(4)]
    links = pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    packing = pm.Packing(place, [0.4] * 4, pm.Box([[4.0, 0.3], [0.0, 0.7]]), links)
    for method in ("dense", "shift-invert"):
        modes = pm.normal_modes(pm.Scene(packing, (pm.Repulsion(),)), 4, strain="free", rattlers="keep", method=method)
        assert modes.available == 8 - 3 + 2 - 2
        assert np.abs(modes.strain_me[:, 0]).max() < 1e-12


def test_density_of_states_counts_the_modes_between_its_edges(crystal):
    modes = pm.normal_modes(crystal)
    states = pm.density_of_states(crystal, 12)
    assert states.modes == len(modes) == states.count_b.sum()
    counted = np.histogram(modes.frequency_m, states.edge_b)[0]
    assert np.array_equal(states.count_b, counted)


@pytest.mark.parametrize("name", ["random_chain_3d_w2.5", "random_dimer_3d_w2.0", "random_trimer_2d_w2.5"])
def test_the_fastest_growing_mode_of_linked_packings_is_in_the_lowest_bin(linked, name):
    """Slack in the links would lower it by a part in 1e8, out of the bins."""
    scene, _ = linked(name)
    states, modes = (call(scene, rattlers="keep") for call in (pm.density_of_states, pm.normal_modes))
    assert states.edge_b[0] < 0.0 and states.count_b.sum() == states.modes == len(modes)
    assert np.array_equal(states.count_b, np.histogram(modes.frequency_m, states.edge_b)[0])


@pytest.mark.parametrize("name", AT_REST)
def test_packings_at_rest_are_stable_as_their_spectra_say(linked, name):
    scene, data = linked(name)
    for strain in ("none", "isochoric"):
        modes = pm.normal_modes(scene, strain=strain)
        assert is_stable(scene, strain=strain) == bool(modes.eigenvalue_m.min() > 0) is True


def test_disturbed_crystal_is_unstable_where_its_spectrum_says(crystal):
    # squeezed links push particles out of line
    thin = crystal.replace(effects=(pm.Repulsion(law=pm.PowerLaw(1.0, 5.0)),))
    for scene in (crystal, thin):
        modes = pm.normal_modes(scene, 5)
        assert is_stable(scene, strain="none") == bool(modes.eigenvalue_m.min() > 0)


SPRING = pm.Repulsion(pm.LinearSpring())


def standing_dimer(pull=1e-2):
    """Return two linked discs, one above the other on a floor that bears them, and the weight of one."""
    weight = pull * np.pi / 4.0
    # half the energy of a pair at twice the distance: a floor is twice as stiff as the spring
    low = 0.5 - weight
    links = pm.Links([0], [1], [[0, 0]], [1.0])
    pair = pm.Packing([[2.0, low], [2.0, low + 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), links)
    return pm.Scene(pair, (SPRING, pm.Gravity(0.0, -pull), pm.Walls(1, 0.0, 4.0))), weight


def test_a_link_bears_the_weight_above_it_and_its_stress_is_that_weight_times_its_length():
    scene, weight = standing_dimer()
    assert pm.link_tension(scene)[0] == pytest.approx(-weight, rel=1e-12)
    stress = pm.stress_tensor(scene)
    assert stress[1, 1] * 16.0 == pytest.approx(-weight, rel=1e-12) and abs(stress[0]).max() < 1e-15


def test_a_link_bears_the_tangential_force_of_a_contact_beside_it():
    """A linked pair that another disc pushes across its link's end by a tangential spring along the link."""
    links = pm.Links([0], [1], [[0, 0]], [1.2])
    spring = pm.TangentialDisplacements([1], [2], [[0, 0]], [[0.01]])
    place = [[1.0, 2.0], [2.2, 2.0], [2.2, 2.9]]
    packing = pm.Packing(place, [0.5] * 3, pm.Box.cubic(6.0, 2), links, tangential=spring)
    rough = pm.Scene(packing, (SPRING, pm.Friction(0.9, stiffness=0.8)))
    force = pm.forces(rough)[1]
    assert abs(force[0]) == pytest.approx(0.8 * 0.01, rel=1e-12)
    # half of it accelerates each end
    assert pm.link_tension(rough)[0] == pytest.approx(0.5 * force[0], rel=1e-12)
    assert pm.link_tension(rough.without(pm.Friction).replace(packing=packing.replace(tangential=None)))[0] == 0.0


def test_a_dimer_on_a_floor_bobs_slides_and_falls_over():
    scene, weight = standing_dimer()
    mass = np.pi / 4.0
    modes = pm.normal_modes(scene)
    assert modes.force_residual < 1e-12 and modes.residual < 1e-14
    assert modes.translations == 1 and modes.negative == 1
    # both ends move against each other under the compressed link; both move up and down on the floor, of stiffness 2
    assert modes.eigenvalue_m == pytest.approx([-2.0 * weight / mass, 2.0 / (2.0 * mass)], rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_hessian_of_chains_on_a_floor_is_the_second_difference_of_the_energy_with_links_kept(dimension):
    drawn = pm.cluster_packing(4, pm.LinearCluster(3), dimension=dimension, packing_fraction=0.25, seed=2)
    effects = (SPRING, pm.Gravity(0.0, -1e-3), pm.Walls(1, 0.0, float(drawn.box.lattice_dd[1, 1])))
    packing = pm.quench(pm.Scene(drawn, effects), force_tolerance=1e-8).packing
    scene = pm.Scene(packing, effects)
    stiffness = pm.hessian(scene, "none").toarray()
    assert pm.normal_modes(scene).force_residual < 1e-7

    def energy(motion_x):
        moved = packing.replace(position_nd=packing.position_nd + motion_x.reshape(packing.position_nd.shape))
        return pm.energy(scene.replace(packing=pm.reaffix_links(moved).packing))

    rng, size = np.random.default_rng(4), 1e-5
    admitted = pm.change_of_basis(packing, "none")
    for _ in range(3):
        motion = admitted @ rng.normal(size=admitted.shape[1])
        motion *= size / np.abs(motion).max()
        change = energy(motion) + energy(-motion) - 2.0 * pm.energy(scene)
        assert motion @ stiffness @ motion == pytest.approx(change, rel=1e-5)
    value = np.linalg.eigvalsh(pm.dynamical_matrix(scene).toarray())
    every = pm.normal_modes(scene, rattlers="keep").eigenvalue_m
    # the translations along the floor cost nothing, and are left out
    assert np.abs(every - np.delete(value, np.argsort(np.abs(value))[: dimension - 1])).max() < 1e-12 * value[-1]


def test_a_disc_that_is_linked_to_a_held_one_swings_as_a_pendulum():
    """Of frequency squared g / length, however it hangs; a translation that the link forbids is no motion of it."""
    length, pull = 1.5, 0.7
    for angle in (0.0, 0.4):
        below = [1.0 + length * np.sin(angle), 2.0 - length * np.cos(angle)]
        links = pm.Links([0], [1], [[0, 0]], [length])
        packing = pm.Packing([[1.0, 2.0], below], [0.5, 0.5], pm.Box.cubic(10.0, 2), links)
        # hung along the pull
        weight = pm.Gravity(pull * np.sin(angle), -pull * np.cos(angle))
        scene = pm.Scene(packing, (SPRING, pm.FixedParticles((0,)), weight))
        modes = pm.normal_modes(scene)
        assert modes.eigenvalue_m == pytest.approx([pull / length], rel=1e-12) and modes.translations == 0
        assert pm.density_of_states(scene, [0.0, 0.5, 1.0]).count_b.tolist() == [0, 1]
        assert modes.force_residual < 1e-14


def test_links_to_held_particles_leave_the_modes_of_the_dynamical_matrix():
    links = pm.Links([0], [1], [[0, 0]], [1.5])
    place = [[1.0, 2.0], [2.5, 2.0], [3.4, 2.0], [2.95, 2.8]]
    packing = pm.Packing(place, [0.5] * 4, pm.Box.cubic(10.0, 2), links, mass_n=[1.0, 2.0, 3.0, 1.5])
    scene = pm.Scene(packing, (SPRING, pm.FixedParticles((0,))))
    value = np.linalg.eigvalsh(pm.dynamical_matrix(scene, kind="unstressed").toarray())
    for method in ("dense", "shift-invert"):
        modes = pm.normal_modes(scene, 3, kind="unstressed", rattlers="keep", method=method)
        # the one translation that the link admits costs nothing here
        assert modes.translations == 1 and modes.residual < 1e-13 and modes.missed == 0
        assert np.r_[0.0, modes.eigenvalue_m] == pytest.approx(value[:4], abs=1e-12)
