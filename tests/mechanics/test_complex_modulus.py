"""Facts about the complex modulus in the frequency domain: closed forms, static limits, runs in time, symmetry."""

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm

FREQUENCY = np.array([0.003, 0.05, 0.4])
OMEGA = 2.0 * np.pi * FREQUENCY


@pytest.fixture(scope="module")
def jammed():
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=pm.LinearSpring()),)), force_tolerance=1e-12).packing


def lattice(dimension=2, **numbers):
    name = "triangular" if dimension == 2 else "fcc"
    packing = pm.lattice_packing(name, repeats=(3,) * dimension)
    return packing, pm.bond_contacts(packing, gap_tolerance=1e-9, **numbers)


def test_triangular_lattice_has_root_three_over_four_of_both_complex_stiffnesses():
    packing, bonds = lattice(tangential_stiffness=0.4, damping=0.7, tangential_damping=0.3)
    found = pm.complex_modulus(pm.Scene(packing, (bonds,)), FREQUENCY)
    expected = np.sqrt(3.0) / 4.0 * ((1.0 + 0.7j * OMEGA) + (0.4 + 0.3j * OMEGA))
    assert np.allclose(found.modulus_f, expected, rtol=1e-12)
    assert np.allclose(found.displacement_fnd, 0.0, atol=1e-12)


def test_discs_of_a_triangular_lattice_turn_like_a_driven_oscillator():
    # I theta'' = 3 d^2 k_t* (W - theta) + drag I (W - theta)' with W = -gamma/2: six springs at arms of half a diameter
    packing, bonds = lattice(tangential_stiffness=0.4, tangential_damping=0.3)
    found = pm.complex_modulus(pm.Scene(packing, (bonds, pm.BackgroundDamping(0.2))), FREQUENCY)
    inertia = 0.5 * (np.pi / 4.0) * 0.25
    spring = 3.0 * (0.4 + 0.3j * OMEGA) + 0.2j * OMEGA * inertia
    expected = -0.5 * spring / (spring - OMEGA**2 * inertia)
    assert np.allclose(found.rotation_fnk, expected[:, None, None], rtol=1e-12)
    # torques that inertia takes are what makes the forces' stress unsymmetric
    torque = 3.0 * (0.4 + 0.3j * OMEGA) * (-0.5 - expected) * packing.particles / packing.box.volume
    skew = found.contact_stress_fdd[:, 1, 0] - found.contact_stress_fdd[:, 0, 1]
    assert np.allclose(skew, torque, rtol=1e-10)


def test_spheres_of_an_fcc_lattice_have_the_closed_form_of_central_and_tangential_springs():
    packing, bonds = lattice(3, tangential_stiffness=0.4, damping=0.7, tangential_damping=0.3)
    found = pm.complex_modulus(pm.Scene(packing, (bonds,)), FREQUENCY, axes=(0, 1))
    vector = bonds_vectors(packing, bonds)
    normal, symmetric = vector / np.linalg.norm(vector, axis=1)[:, None], np.array([[0, 0.5, 0], [0.5, 0, 0], [0] * 3])
    along = np.einsum("ca,ab,cb->c", normal, symmetric, normal)
    across = vector @ symmetric - along[:, None] * normal * np.linalg.norm(vector, axis=1)[:, None]
    size = np.linalg.norm(vector, axis=1) ** 2
    central, tangential = (along**2 * size).sum(), (across**2).sum()
    expected = (central * (1.0 + 0.7j * OMEGA) + tangential * (0.4 + 0.3j * OMEGA)) / packing.box.volume
    # an affine answer: every sphere of the lattice is a center of inversion, in whatever axes the lattice lies
    assert np.allclose(found.displacement_fnd, 0.0, atol=1e-12)
    assert np.allclose(found.modulus_f, expected, rtol=1e-10)


def bonds_vectors(packing, bonds):
    apart = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b]
    return apart + bonds.image_bd @ packing.box.lattice_dd.T


def test_static_limit_is_the_slope_of_the_stress_of_packings_quenched_under_strain(jammed):
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.3))
    found = pm.complex_modulus(pm.Scene(jammed, effects), [1e-5])
    gamma = 1e-5

    def stress(sign):
        shear = np.eye(2) + sign * gamma * np.array([[0.0, 1.0], [0.0, 0.0]])
        moved = pm.Packing(jammed.position_nd @ shear.T, jammed.radius_n, pm.Box(shear @ jammed.box.lattice_dd))
        rest = pm.quench(pm.Scene(moved, effects[:1]), force_tolerance=1e-12).packing
        return pm.stress_tensor(pm.Scene(rest, effects[:1]))

    slope = (stress(1.0) - stress(-1.0)) / (2.0 * gamma)
    assert np.allclose(found.stress_fdd[0].real, slope, rtol=1e-5, atol=1e-7)


def test_isotropic_and_uniaxial_strain_have_the_moduli_of_a_triangular_lattice():
    packing, bonds = lattice(tangential_stiffness=0.4)
    scene = pm.Scene(packing, (bonds,))
    k, t = np.sqrt(3.0) / 4.0, np.sqrt(3.0) / 4.0 * 0.4
    bulk = pm.complex_modulus(scene, [0.01], mode="isotropic").modulus_f[0]
    # d2E/dgamma2 per area of x -> (1 + gamma) x is d times the mean stress: 2 K with K = sqrt(3)/2 k
    assert bulk == pytest.approx(4.0 * k, rel=1e-12)
    assert pm.complex_modulus(scene, [0.01], mode="uniaxial").modulus_f[0] == pytest.approx(3.0 * k + t, rel=1e-12)


def test_dissipation_is_never_negative(jammed):
    bonds = pm.bond_contacts(jammed, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3)
    found = pm.complex_modulus(pm.Scene(jammed, (bonds, pm.BackgroundDamping(0.1))), np.geomspace(1e-4, 3.0, 40))
    assert found.loss_f.min() > 0.0
    assert found.residual < 1e-11


def test_particles_that_all_follow_the_box_answer_affinely(jammed):
    bonds = pm.bond_contacts(jammed, tangential_stiffness=0.0, damping=0.4)
    scene = pm.Scene(jammed, (bonds,))
    found = pm.complex_modulus(scene, [0.1], held_n=np.ones(24, dtype=bool))
    vector = bonds_vectors(jammed, bonds)
    r, rest = np.linalg.norm(vector, axis=1), bonds.rest_length_b
    normal = vector / r[:, None]
    pull = r - rest
    affine = (((1.0 + 0.08j * np.pi) * r - pull) * r * (normal[:, 0] * normal[:, 1]) ** 2).sum()
    # the stress at rest turns and is carried along
    at_rest = (pull * r * normal[:, 1] ** 2).sum()
    assert found.modulus_f[0] == pytest.approx((affine + at_rest) / jammed.box.volume, rel=1e-12)


def test_a_scene_out_of_balance_is_refused():
    packing = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    with pytest.raises(ValueError, match=r"^scene must be at rest, got a net force of"):
        pm.complex_modulus(pm.Scene(packing, (pm.Repulsion(),)), [0.1])


# -- friction, weights, shapes -----------------------------------------------------------------------------------------

SPRINGS = pm.Repulsion(law=pm.LinearSpring())
DASHPOTS = (pm.ContactDamping(0.3), pm.BackgroundDamping(0.2))


@pytest.fixture(scope="module")
def pressed():
    """Return a scene of discs that were pressed with friction, whose contacts carry tangential forces."""
    start = pm.random_packing(16, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=4)
    scene = pm.Scene(start, (SPRINGS, pm.Friction(0.5, 0.7, 0.2), *DASHPOTS))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-2, strain="isotropic").packing)
    forces = pm.contact_forces(scene)
    assert np.abs(forces.tangential_cd).max() > 0.1 * forces.normal_c.mean()
    return scene


@pytest.fixture(scope="module")
def ellipses():
    """Return a scene of jammed ellipses with dashpots."""
    sizes, shapes = pm.Bidisperse(ratio=1.4), pm.Ellipses(aspect=1.5)
    start = pm.random_packing(16, dimension=2, sizes=sizes, shapes=shapes, packing_fraction=0.7, seed=3)
    scene = pm.Scene(start, (SPRINGS, *DASHPOTS))
    return scene.replace(packing=pm.jam(scene, pressure=1e-2).packing)


def stress_of_simple_shear(moduli, stress_dd):
    """Return the change of the Cauchy stress by the symmetric part of a simple shear, and by its rotation."""
    gradient = np.zeros_like(stress_dd)
    gradient[0, 1] = 1.0
    symmetric, turn = 0.5 * (gradient + gradient.T), 0.5 * (gradient - gradient.T)
    stretched = np.einsum("abcd,cd->ab", moduli.tensor(tangent="cauchy"), symmetric)
    return stretched + turn @ stress_dd - stress_dd @ turn


def test_slow_shear_of_a_packing_pressed_with_friction_has_the_elastic_moduli_of_contacts_that_stick(pressed):
    moduli = pm.elastic_moduli(pressed, contacts_at_limit="stick")
    expected = stress_of_simple_shear(moduli, pm.contact_forces(pressed).stress_dd)
    found = pm.complex_modulus(pressed, [1e-6])
    assert np.allclose(found.stress_fdd[0].real, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
    assert found.rest < 1e-8


def test_slow_shear_of_ellipses_has_their_elastic_moduli(ellipses):
    expected = stress_of_simple_shear(pm.elastic_moduli(ellipses), pm.stress_tensor(ellipses))
    found = pm.complex_modulus(ellipses, [1e-6])
    assert np.allclose(found.stress_fdd[0].real, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def in_time(scene, frequency, **choices):
    """Return the modulus of a run in time of small amplitude."""
    run = pm.oscillatory_shear(scene, amplitude=1e-6, frequency=frequency, periods=10, skip_periods=8, **choices)
    assert np.ptp(run.contacts_t) == 0
    return run.moduli.storage + 1j * run.moduli.loss


def test_a_run_in_time_of_contacts_with_tangential_forces_has_the_complex_modulus(pressed):
    # a larger coefficient, so that no contact is at its limit
    scene = pressed.replace(effects=(SPRINGS, pm.Friction(5.0, 0.7, 0.2), *DASHPOTS))
    assert not pm.contact_forces(scene).at_limit_c.any()
    found = pm.complex_modulus(scene, [0.02]).modulus_f[0]
    assert abs(in_time(scene, 0.02, dt=0.02) - found) < 1e-4 * abs(found)


def test_a_run_in_time_of_ellipses_has_the_complex_modulus(ellipses):
    found = pm.complex_modulus(ellipses, [0.02])
    assert abs(in_time(ellipses, 0.02, dt=0.02) - found.modulus_f[0]) < 1e-5 * abs(found.modulus_f[0])
    # the inertia of what turns stretches it
    contact = found.contact_stress_fdd[0]
    assert abs(found.modulus_f[0] - 0.5 * (contact[0, 1] + contact[1, 0])) > 1e-2 * abs(found.modulus_f[0])


FLOOR = 6


@pytest.fixture(scope="module")
def pile():
    """Return a scene of discs that lie on six that are held, and these."""
    n = 5 * FLOOR
    column, row = np.arange(n) % FLOOR, np.arange(n) // FLOOR
    radius = np.where(np.arange(n) < FLOOR, 0.45, 0.38 + 0.08 * np.cos(7.0 * np.arange(n)) ** 2)
    place = np.column_stack([column + 0.5 * (row % 2) + 0.06 * np.sin(3.0 * np.arange(n)), 0.7 + 0.92 * row])
    place[:FLOOR] = np.column_stack([np.arange(FLOOR) + 0.5, 0.6 + 0.1 * np.cos(2.0 * np.arange(FLOOR))])
    packing = pm.Packing(place, radius, pm.Box(np.diag([float(FLOOR), 14.0])))
    return heaped(packing), np.arange(n) < FLOOR


def heaped(packing):
    """Return a scene of discs at rest under their weights, six of them held."""
    effects = (SPRINGS, pm.Gravity(0.0, -0.02))
    rest = pm.quench(pm.Scene(packing, (*effects, pm.FixedParticles(range(FLOOR)))), force_tolerance=1e-12)
    return pm.Scene(rest.packing, effects)


@pytest.mark.parametrize("mode", ["shear", "uniaxial", "isotropic"])
def test_static_limit_of_a_pile_is_the_slope_of_the_stress_of_piles_at_rest_under_strain(pile, mode):
    scene, held = pile
    packing, gamma = scene.packing, 1e-6
    direction = {"shear": [[0.0, 1.0], [0.0, 0.0]], "uniaxial": [[1.0, 0.0], [0.0, 0.0]], "isotropic": np.eye(2)}[mode]

    def stress(sign):
        strained = np.eye(2) + sign * gamma * np.array(direction)
        box = pm.Box(strained @ packing.box.lattice_dd)
        rest = heaped(packing.replace(position_nd=packing.position_nd @ strained.T, box=box))
        return pm.stress_tensor(rest.without(pm.Gravity))

    found = pm.complex_modulus(scene, [1e-6], mode=mode, held_n=held)
    slope = (stress(1.0) - stress(-1.0)) / (2.0 * gamma)
    assert np.allclose(found.stress_fdd[0].real, slope, rtol=0.0, atol=1e-5 * np.abs(slope).max())


def test_weights_that_nothing_bears_are_out_of_balance(pile):
    scene, _ = pile
    with pytest.raises(ValueError, match=r"^scene must be at rest, got a net force of"):
        pm.complex_modulus(scene, [0.1])


class _Trap(NamedTuple):
    """A spring that holds every disc at one place."""

    stiffness: float = 1.0
    at: float = 2.0

    def body_force(self, x, y, z, u, v, w, mass, radius):
        return -self.stiffness * (x - self.at), 0.0, 0.0

    def body_energy(self, x, y, z, mass, radius):
        return 0.5 * self.stiffness * (x - self.at) ** 2

    def body_second(self, x, y, z, mass, radius):
        return self.stiffness, 0.0, 0.0, 0.0, 0.0, 0.0


def test_a_disc_between_a_trap_and_a_bond_is_a_driven_oscillator():
    # of the two bonded discs the first follows the box; the second is drawn along by the bond, and back by the trap
    packing = pm.Packing([[0.5, 1.0], [2.0, 1.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    bonds = pm.Bonds([0], [1], [[0, 0]], [1.5], tangential_stiffness=0.0, damping=0.7)
    scene = pm.Scene(packing, (bonds, pm.BackgroundDamping(0.2), pm.effect(_Trap)(0.3)))
    found = pm.complex_modulus(scene, FREQUENCY, mode="uniaxial", held_n=[True, False])
    bond, mass = 1.0 + 0.7j * OMEGA, packing.mass_n[1]
    free = 0.2j * OMEGA * mass - OMEGA**2 * mass
    expected = -(bond * 1.5 + 0.3 * 2.0) / (bond + 0.3 + free)
    assert np.allclose(found.displacement_fnd[:, 1, 0], expected, rtol=1e-12)
    assert np.allclose(found.modulus_f, bond * (1.5 + expected) * 1.5 / packing.box.volume, rtol=1e-12)


def test_what_follows_no_strain_is_refused_with_the_way_out(jammed):
    for effect, words in (
        (pm.Walls(1, -9.0, 99.0), r"got Walls at 1 \(walls follow no strain of the box\): leave it out"),
        (pm.FixedParticles((0,)), r"got FixedParticles at 1 \(give those that follow the box as held_n\)"),
    ):
        with pytest.raises(ValueError, match=words):
            pm.complex_modulus(pm.Scene(jammed, (SPRINGS, effect)), [0.1])


def test_tangential_bonds_of_ellipses_are_refused(ellipses):
    bonds = pm.bond_contacts(ellipses.packing, rest="distance", tangential_stiffness=0.5)
    with pytest.raises(ValueError, match=r"tangential_stiffness=0\.0"):
        pm.complex_modulus(ellipses.replace(effects=(SPRINGS, bonds)), [0.1])


def test_bonds_of_ellipses_act_on_their_centers(ellipses):
    # slack bonds in place of all contacts: ellipses move as discs do
    packing = ellipses.packing
    bonds = pm.bond_contacts(packing, rest="distance", tangential_stiffness=0.0, damping=0.4)
    scenes = [pm.Scene(one, (bonds, pm.BackgroundDamping(0.1))) for one in (packing, packing.replace(shapes=None))]
    one, other = (pm.complex_modulus(scene, FREQUENCY) for scene in scenes)
    assert np.allclose(one.displacement_fnd, other.displacement_fnd, rtol=0.0, atol=1e-10)
    assert np.allclose(one.contact_stress_fdd, other.contact_stress_fdd, rtol=0.0, atol=1e-10)


def test_a_rattler_that_touches_and_bears_nothing_hangs_on_nothing():
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=1)
    whole = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-4, strain="isotropic").packing
    rattlers = np.flatnonzero(pm.find_rattlers(whole))
    assert len(rattlers)
    one = int(rattlers[0])
    # a rattler pushed against its nearest neighbor until both just touch, and a little less far
    near = pm.find_contacts(whole, gap_tolerance=1.0)
    own = near.select((near.i_c == one) | (near.j_c == one))
    k = int(np.argmin(own.distance_c - own.contact_distance_c))
    toward = own.normal_cd[k] if own.i_c[k] == one else -own.normal_cd[k]
    places = []
    for gap in (1e-15, 1e-3):
        position = whole.position_nd.copy()
        position[one] += toward * (own.distance_c[k] - own.contact_distance_c[k] - gap)
        places.append(whole.replace(position_nd=position))
    effects = (pm.Repulsion(), pm.BackgroundDamping(0.05), pm.ContactDamping(0.3))
    touching, apart = (pm.complex_modulus(pm.Scene(one, effects), [0.001, 0.02]).modulus_f for one in places)
    assert np.abs(touching - apart).max() < 1e-9 * np.abs(apart).max()
