"""Facts about the complex modulus in the frequency domain: closed forms of lattices, static limit, symmetry."""

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
