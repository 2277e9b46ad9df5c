"""Facts about the linear response of frictional packings: the engine's own derivatives, closed forms, limits."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import build_engine

HARD = pm.Repulsion(pm.LinearSpring(1.0))


@functools.cache
def at_rest(dimension, mu=0.5, particles=32, rolling=False):
    """Return a frictional scene at rest with stretched springs, and without dashpots."""
    fraction = 0.95 if dimension == 2 else 0.76
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=fraction, seed=3)
    turning = (pm.RollingResistance(0.2, 0.4), pm.TwistingResistance(0.1, 0.6))[: dimension - 1] if rolling else ()
    damped = (HARD, pm.Friction(mu, 0.7, 0.3), *turning, pm.ContactDamping(0.3), pm.BackgroundDamping(0.3))
    run = pm.simulate(pm.Scene(packing, damped), steps=6_000, dt=0.05)
    scene = pm.Scene(run.packing, (HARD, pm.Friction(mu, 0.7), *turning))
    assert pm.contact_forces(scene).residual < 1e-6
    return scene


def gyration(packing):
    """Return the (N, 1) radii of gyration of discs and spheres: angles are measured in them."""
    return packing.radius_n[:, None] * (0.5 if packing.dimension == 2 else 0.4) ** 0.5


def as_motion(packing, velocity_nd, spin_nk):
    """Return displacements and rotations in the coordinates of the stiffness matrix."""
    return np.hstack([velocity_nd, spin_nk * gyration(packing)]).ravel()


def as_forces(packing, force_nd, torque_nk):
    """Return forces and torques along the coordinates of the stiffness matrix."""
    return np.hstack([force_nd, torque_nk / gyration(packing)]).ravel()


def pushes(scene, velocity_nd, spin_nk, step, profile=None, direction_dd=None):
    """Return the engine's forces and torques after one small step of motion of particles too heavy to be moved."""
    heavy = scene.replace(packing=scene.packing.replace(mass_n=np.full(scene.packing.particles, 1e14)))
    engine = build_engine(
        heavy,
        dt=step,
        velocity_nd=velocity_nd,
        spin_nk=spin_nk,
        profile=profile,
        direction_dd=direction_dd,
        second_order=False,
    )
    engine.advance(1)
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    d = scene.packing.dimension
    return as_forces(scene.packing, push[:, :d], push[:, d:])


def motions(scene, seed=5):
    rng = np.random.default_rng(seed)
    n, d = scene.packing.position_nd.shape
    return rng.normal(size=(n, d)), rng.normal(size=(n, 1 if d == 2 else 3))


# what is left of a difference over steps of this size, relative to the largest
STEP, CLOSE = 1e-5, 1e-7


def sticking(scene):
    """Return the same scene, its forces what they were, far from the Coulomb limit."""
    springs = scene.packing.tangential
    found = pm.contact_forces(scene)
    assert len(springs) <= len(found.contacts)
    return scene.replace(effects=(HARD, *(one._replace(coefficient=1e6) for one in scene.effects[1:])))


@pytest.mark.parametrize("rolling", [False, True], ids=["sliding", "rolling"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_stiffness_matrix_is_the_derivative_of_the_engines_forces_and_torques(dimension, rolling):
    scene = sticking(at_rest(dimension, rolling=rolling))
    velocity, spin = motions(scene)
    motion = as_motion(scene.packing, velocity, spin)
    ahead, behind = (pushes(scene, sign * velocity, sign * spin, STEP) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * STEP)
    told = pm.stiffness_matrix(scene, "none") @ motion
    assert np.abs(told + change).max() < CLOSE * np.abs(change).max()
    # forces as they are matter: without them it is another matrix
    bare = pm.stiffness_matrix(scene, "none", "unstressed") @ motion
    assert np.abs(bare + change).max() > 1e-3 * np.abs(change).max()


@pytest.mark.parametrize("rolling", [False, True], ids=["sliding", "rolling"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_its_columns_of_strains_are_the_derivative_as_the_box_deforms(dimension, rolling):
    """A box sheared along x is strained and turned; seen from an axis that turns with it, spins turn backwards."""
    scene = sticking(at_rest(dimension, rolling=rolling))
    n, d = scene.packing.position_nd.shape
    rng = np.random.default_rng(8)
    gradient = rng.normal(size=(d, d))
    even, odd = (gradient + gradient.T) / 2.0, (gradient - gradient.T) / 2.0
    still, none = np.zeros((n, d)), np.zeros((n, 1 if d == 2 else 3))
    ahead, behind = (pushes(scene, still, none, STEP, Ramp(0.0, sign, 0.0, 9.0), gradient) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * STEP)
    vorticity = np.array([odd[1, 0]] if d == 2 else [odd[2, 1], odd[0, 2], odd[1, 0]])
    matrix = pm.stiffness_matrix(scene)
    size = n * (d + len(vorticity))
    motion = np.concatenate([as_motion(scene.packing, still, none - vorticity), pm.mandel_vector(even)])
    told = -(matrix @ motion)[:size]
    # rows are generalized forces (1 + strain) f; and what there was of forces and torques turns with the axes
    forces = pm.contact_forces(scene)
    turned = forces.torque_nk @ odd.T if d == 3 else none
    told += as_forces(scene.packing, forces.force_nd @ (odd - even).T, turned)
    assert np.abs(told - change).max() < CLOSE * np.abs(change).max()


@pytest.mark.parametrize("dimension", [2, 3])
def test_its_rows_of_strains_are_the_derivative_of_the_stress(dimension):
    scene = sticking(at_rest(dimension))
    velocity, spin = motions(scene)
    d, volume = dimension, scene.packing.box.volume
    heavy = scene.replace(packing=scene.packing.replace(mass_n=np.full(scene.packing.particles, 1e14)))
    stress = []
    for sign in (1.0, -1.0):
        run = pm.simulate(
            heavy, steps=1, dt=STEP, velocity_nd=sign * velocity, spin_nk=sign * spin, method=pm.SemiImplicitEuler()
        )
        stress.append(pm.contact_forces(scene.replace(packing=run.packing)).stress_dd)
    change = volume * (stress[0] - stress[1]) / (2.0 * STEP)
    motion = as_motion(scene.packing, velocity, spin)
    told = pm.stiffness_matrix(scene)[len(motion) :, : len(motion)] @ motion
    assert np.abs(told - pm.mandel_vector(change)).max() < CLOSE * np.abs(change).max()
    assert len(told) == d * (d + 1) // 2


def test_a_sliding_contact_follows_the_normal_force_and_a_returning_one_is_a_spring():
    """Forces of the engine on two discs, and two spheres, whose contact is at the limit, one step on."""
    mu, stiffness = 0.4, 0.7
    for d in (2, 3):
        place = np.full((2, d), 1.0)
        place[1] += np.array([0.6, 0.65, 0.2][:d])
        normal = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
        across = np.array([-normal[1], normal[0], 0.0])[:d]
        across /= np.linalg.norm(across)
        limit = mu * (1.0 - np.linalg.norm(place[1] - place[0])) / stiffness
        # a hair beyond it, to be cut
        along = [[limit * (1.0 + 1e-12)]] if d == 2 else [limit * (1.0 + 1e-12) * across]
        springs = pm.TangentialDisplacements([0], [1], [[0] * d], along)
        pair = pm.Packing(place, [0.55, 0.45], pm.Box.cubic(5.0, d), tangential=springs)
        scene = pm.Scene(pair, (HARD, pm.Friction(mu, stiffness)))
        assert pm.contact_forces(scene).at_limit_c.tolist() == [True]
        velocity, spin = motions(scene)
        # on along the force, whatever else moves
        velocity[1] += 6.0 * across
        motion = as_motion(pair, velocity, spin)
        found = pm.contact_forces(scene)
        now = as_forces(pair, found.force_nd, found.torque_nk)
        for sign, choice in ((1.0, "slip"), (-1.0, "stick")):
            one, two = ((pushes(scene, sign * velocity, sign * spin, h) - now) / (sign * h) for h in (2e-6, 1e-6))
            told = pm.stiffness_matrix(scene, "none", contacts_at_limit=choice) @ motion
            assert np.abs(told + (2.0 * two - one)).max() < 1e-7 * np.abs(told).max()
            other = pm.stiffness_matrix(scene, "none", contacts_at_limit={"slip": "stick", "stick": "slip"}[choice])
            assert np.abs(other @ motion - told).max() > 0.1 * np.abs(told).max()


@pytest.mark.parametrize("d", [2, 3])
def test_springs_against_rolling_and_twisting_at_their_limits_follow_the_normal_force_and_returning_ones_are_springs(d):
    """Forces and torques of the engine on two discs, and two spheres, one step on; friction is far from its limit."""
    rolling, twisting = pm.RollingResistance(0.2, 0.4), pm.TwistingResistance(0.1, 0.6)
    place = np.full((2, d), 1.0)
    place[1] += np.array([0.6, 0.65, 0.2][:d])
    normal = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    across = np.array([-normal[1], normal[0], 0.0])[:d]
    across /= np.linalg.norm(across)
    force = 1.0 - np.linalg.norm(place[1] - place[0])
    # a hair beyond them, to be cut
    rolled, twisted = ((1.0 + 1e-12) * one.coefficient * force / one.stiffness for one in (rolling, twisting))
    springs = pm.TangentialDisplacements(
        [0], [1], [[0] * d], [[0.01]] if d == 2 else [0.01 * across],
        rolling_ck=[[rolled]] if d == 2 else [rolled * across], twisting_c=None if d == 2 else [twisted],
    )  # fmt: skip
    pair = pm.Packing(place, [0.55, 0.45], pm.Box.cubic(5.0, d), tangential=springs)
    scene = pm.Scene(pair, (HARD, pm.Friction(0.4, 0.7), *(rolling, twisting)[: d - 1]))
    found = pm.contact_forces(scene)
    assert [one.at_limit_c.tolist() for one in (found.limit, *found.turning_limits)] == [[False], [True], [d == 3]]
    velocity, spin = motions(scene)
    # on along both moments, whatever else moves
    ahead = np.array([1.0]) if d == 2 else np.cross(normal, across) + normal
    spin[1] += 20.0 * ahead
    spin[0] -= 20.0 * ahead
    motion = as_motion(pair, velocity, spin)
    now = as_forces(pair, found.force_nd, found.torque_nk)
    for sign, choice in ((1.0, "slip"), (-1.0, "stick")):
        one, two = ((pushes(scene, sign * velocity, sign * spin, h) - now) / (sign * h) for h in (2e-6, 1e-6))
        expected = pm.stiffness_matrix(scene, "none", contacts_at_limit=choice) @ motion
        assert np.abs(expected + (2.0 * two - one)).max() < 1e-7 * np.abs(expected).max()
        other = pm.stiffness_matrix(scene, "none", contacts_at_limit={"slip": "stick", "stick": "slip"}[choice])
        assert np.abs(other @ motion - expected).max() > 0.1 * np.abs(expected).max()
    # rolling on along the force, and twisting on, meets no resistance, and rolling across the force in space does
    matrix = pm.stiffness_matrix(scene, "none", contacts_at_limit="slip")
    turns = np.array([[1.0]]) if d == 2 else np.stack([np.cross(normal, across), normal, across])
    arm = (0.55 * 0.45) * (1.0 - force)
    for k, turn in enumerate(turns):
        # so that the contact does not slip: both turn with equal speeds of their surfaces
        sides = np.stack([-turn / 0.55, turn / 0.45]) if k != 1 else np.stack([-turn, turn])
        torque = (matrix @ as_motion(pair, np.zeros((2, d)), sides)).reshape(2, -1)[:, d:] * gyration(pair)
        stiffness = float(torque[1] @ turn)
        spring = arm**2 * 0.4 * (1.0 / 0.55 + 1.0 / 0.45) if k == 2 else 0.0
        assert stiffness == pytest.approx(spring, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_without_friction_it_is_the_hessian_and_no_bit_of_the_moduli_differs(dimension):
    scene = at_rest(dimension)
    n, d, k = scene.packing.particles, dimension, 1 if dimension == 2 else 3
    strains = n * (d + k) + np.arange(d * (d + 1) // 2)
    kept = np.concatenate([(np.arange(n)[:, None] * (d + k) + np.arange(d)).ravel(), strains])
    bare = scene.without(pm.Friction)
    matrix = pm.stiffness_matrix(bare).toarray()
    assert np.abs(matrix[np.ix_(kept, kept)] - pm.hessian(bare).toarray()).max() < 1e-13
    assert not np.delete(matrix, kept, axis=0).any()
    smooth = scene.replace(packing=scene.packing.replace(tangential=None)).without(pm.Friction)
    # springs across carry a part here: without them nothing is at rest, and all would rattle
    told = pm.elastic_moduli(smooth, rattlers="keep")
    moduli = pm.elastic_moduli(scene.replace(effects=(HARD, pm.Friction(0.0, 0.7))), rattlers="keep")
    assert np.array_equal(moduli.cauchy, told.cauchy) and np.array_equal(moduli.affine, told.affine)
    assert moduli.contacts == told.contacts and not len(moduli.at_limit_k)


def test_moduli_with_friction_say_what_contacts_at_the_limit_do():
    rough = pressed(2)
    for choice, said in (("stick", "stick"), ("slip", "slip"), ([[0.0, 1.0], [1.0, 0.0]], "strain")):
        moduli = pm.elastic_moduli(rough, contacts_at_limit=choice)
        assert moduli.at_limit_motion == said and len(moduli.at_limit_k)
        assert f"{len(moduli.at_limit_k)} contacts at the Coulomb limit: {said}" in repr(moduli)
    smooth = rough.replace(packing=rough.packing.replace(tangential=None)).without(pm.Friction)
    assert pm.elastic_moduli(smooth, rattlers="keep").at_limit_motion == ""


@pytest.mark.parametrize("stiffness", [0.3, 2.0])
def test_springs_across_the_contacts_of_a_triangular_lattice_add_to_its_shear_modulus(stiffness):
    """B = sqrt(3)/2 k_n, G = sqrt(3)/4 (k_n + k_t): no disc turns, and each of its contacts does as the box does."""
    packing = pm.lattice_packing("triangular", repeats=(3, 2), relative_overlap=0.02)
    moduli = pm.elastic_moduli(pm.Scene(packing, (HARD, pm.Friction(0.5, stiffness))), kind="unstressed")
    assert moduli.bulk_modulus == pytest.approx(3**0.5 / 2.0, rel=1e-12)
    assert moduli.shear_modulus == pytest.approx(3**0.5 / 4.0 * (1.0 + stiffness), rel=1e-12)
    assert moduli.anisotropy == pytest.approx(0.0, abs=1e-12) and moduli.stable
    assert moduli.residual < 1e-12 and moduli.contacts == 18 and moduli.floppy_positions == 0
    # under a pressure both lose what they lose without friction
    smooth, rough = (
        pm.elastic_moduli(pm.Scene(packing, effects)) for effects in ((HARD,), (HARD, pm.Friction(0.5, stiffness)))
    )
    assert rough.bulk_modulus == pytest.approx(smooth.bulk_modulus, rel=1e-12)
    assert rough.shear_modulus - smooth.shear_modulus == pytest.approx(3**0.5 / 4.0 * stiffness, rel=1e-12)


def test_a_square_lattice_is_soft_in_shear_but_for_its_tangential_springs():
    packing = pm.lattice_packing("square", repeats=(2, 3), relative_overlap=0.02)
    moduli = pm.elastic_moduli(pm.Scene(packing, (HARD, pm.Friction(0.5, 0.3))), kind="unstressed")
    assert moduli.bulk_modulus == pytest.approx(0.5, rel=1e-12)
    assert moduli.shear_modulus == pytest.approx(0.15, rel=1e-12)
    assert not len(moduli.soft_directions)


def test_face_centered_cubic_spheres_keep_their_bulk_modulus_and_gain_shear_moduli():
    """C_abcd = sum of r^2 [k_n nnnn + k_t (ee)(1 - nn)] over the contacts of a particle and its volume r^3/sqrt(2)."""
    packing = pm.lattice_packing("fcc", repeats=(2, 2, 2), relative_overlap=0.02)
    stiffness, r = 0.4, 0.98
    moduli = pm.elastic_moduli(pm.Scene(packing, (HARD, pm.Friction(0.5, stiffness))), kind="unstressed")
    assert moduli.bulk_modulus == pytest.approx(2.0 * 2**0.5 / 3.0 / r, rel=1e-12)
    # of the six contacts (0, 1, +-1)/sqrt(2), two lie in the plane of the shear, two across each of its axes
    shear = 2**0.5 / r * (4.0 * 0.25 + stiffness * (2.0 * 0.125 * 4.0)) / 2.0
    assert moduli.component("xyxy") == pytest.approx(shear, rel=1e-12)


@pytest.mark.parametrize(("name", "images"), [("square", 2), ("triangular", 3)])
def test_a_lone_disc_spins_between_its_own_images(name, images):
    """Each contact with an image slips by distance times angle, on both sides: omega^2 = images k r^2 / (m R^2 / 2)."""
    packing = pm.lattice_packing(name, repeats=(1, 1), relative_overlap=0.02)
    mass, radius = packing.mass_n[0], packing.radius_n[0]
    r = 2.0 * radius * 0.98
    modes = pm.frictional_modes(pm.Scene(packing, (HARD, pm.Friction(0.5, 0.3))))
    assert len(modes) == 1 and modes.symmetric and modes.residual < 1e-14
    assert modes.frequency_m[0].real ** 2 == pytest.approx(images * 0.3 * r**2 / (0.5 * mass * radius**2), rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_modes_near_zero_are_the_lowest_of_all_modes(dimension):
    for scene in (at_rest(dimension), at_rest(dimension).replace(packing=slack(at_rest(dimension)))):
        every = pm.frictional_modes(scene, method="dense")
        assert every.residual < 1e-13 and len(every) == every.available
        assert every.symmetric is (scene.packing.tangential is None)
        lowest = pm.frictional_modes(scene, 9, method="shift-invert")
        assert lowest.residual < 1e-11 and len(lowest) in (9, 10) and lowest.method == "shift-invert"
        nearest = np.sort(np.abs(every.eigenvalue_m))[: len(lowest)]
        np.testing.assert_allclose(np.sort(np.abs(lowest.eigenvalue_m)), nearest, atol=1e-11 * every.largest)
        # of size 1 in the metric of masses and moments of inertia
        mass, radius = scene.packing.mass_n[:, None], scene.packing.radius_n[:, None]
        inertia = (0.5 if dimension == 2 else 0.4) * mass * radius**2
        size = (mass * np.abs(lowest.displacement_mnd) ** 2).sum(axis=(1, 2))
        size += (inertia * np.abs(lowest.rotation_mnk) ** 2).sum(axis=(1, 2))
        np.testing.assert_allclose(size, 1.0, rtol=1e-12)


def slack(scene):
    return scene.packing.replace(tangential=None)


def test_moduli_go_over_to_those_without_friction_where_contacts_slip_and_not_where_they_stick():
    """Henkes, van Hecke and van Saarloos (2010): all contacts at the limit of a coefficient that is almost none."""
    start = pm.random_packing(32, dimension=2, packing_fraction=0.95, seed=3)
    smooth = pm.Scene(pm.quench(pm.Scene(start, (HARD,)), force_tolerance=1e-12).packing, (HARD,))
    contacts = pm.find_contacts(smooth.packing)
    sign = np.where(np.arange(len(contacts)) % 2, 1.0, -1.0)
    springs = pm.TangentialDisplacements(contacts.i_c, contacts.j_c, contacts.image_cd, sign[:, None])
    bare = pm.elastic_moduli(smooth)
    apart = []
    for mu in (1e-4, 1e-6):
        scene = pm.Scene(smooth.packing.replace(tangential=springs), (HARD, pm.Friction(mu, 0.7)))
        slip, stick = (pm.elastic_moduli(scene, contacts_at_limit=choice) for choice in ("slip", "stick"))
        assert len(slip.at_limit_k) == slip.contacts == stick.contacts
        apart.append(abs(slip.shear_modulus / bare.shear_modulus - 1.0))
        assert stick.shear_modulus > 1.5 * bare.shear_modulus
    assert apart[1] < 1e-4 and apart[1] < 0.05 * apart[0]


@functools.cache
def pressed(dimension, *turning):
    """Return a scene pressed until it is at rest, with contacts, and what resists turning, at their limits."""
    sizes, fraction = (pm.Bidisperse(ratio=1.4), 0.7) if dimension == 2 else (pm.Monodisperse(), 0.5)
    packing = pm.random_packing(32, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=1)
    scene = pm.Scene(packing, (HARD, pm.ContactDamping(0.3), pm.Friction(0.1, 1.0, 0.1), *turning))
    for tolerance in (1e-8, 1e-12):
        method = pm.Press(force_tolerance=tolerance)
        scene = scene.replace(packing=pm.jam(scene, pressure=1e-2, strain="isotropic", method=method).packing)
    return scene


def strained(scene, gamma, mode):
    """Return forces after the box was strained by gamma in time, slowly and under a drag, and all came to rest."""
    turning = [one._replace(damping=0.0) for one in scene.effects if isinstance(one, pm.RollingResistance)]
    slow = scene.replace(effects=(HARD, pm.Friction(0.1, 1.0), *turning, pm.BackgroundDamping(0.3)))
    applied = pm.SteadyStrain(gamma / 2000.0, duration=2000.0, mode=mode)
    run = pm.simulate(slow, duration=3000.0, dt=0.1, applied_strain=applied)
    return pm.contact_forces(scene.replace(packing=run.packing))


@pytest.mark.parametrize("dimension", [2, 3])
def test_moduli_of_a_strain_are_those_of_simulated_strains_of_both_signs(dimension):
    """Contacts at the limit slide or stick as the sign of the strain has it; all stick or all slip for neither."""
    scene, size = pressed(dimension), 1e-7
    shear = np.zeros((dimension, dimension))
    shear[0, 1] = shear[1, 0] = 1.0
    before = pm.contact_forces(scene)
    stick, slip = (pm.elastic_moduli(scene, contacts_at_limit=choice) for choice in ("stick", "slip"))
    assert len(stick.sliding_k) == 0 < len(slip.sliding_k) == len(slip.at_limit_k) == before.at_limit_c.sum()
    found = []
    for sign in (1.0, -1.0):
        moduli = pm.elastic_moduli(scene, contacts_at_limit=sign * shear)
        assert 0 < len(moduli.sliding_k) < len(moduli.at_limit_k) and moduli.doubtful_at_limit == 0
        after = strained(scene, sign * size, "shear")
        simulated = (after.stress_dd - before.stress_dd)[0, 1] / (sign * size)
        assert moduli.shear_modulus == pytest.approx(simulated, rel=1e-3)
        assert slip.shear_modulus < 0.95 * simulated and simulated < 0.95 * stick.shear_modulus
        found.append(simulated)
    assert abs(found[0] - found[1]) > 0.02 * found[0]
    # compression loads other contacts than expansion does
    for sign in (1.0, -1.0):
        moduli = pm.elastic_moduli(scene, contacts_at_limit=sign * np.eye(dimension))
        after = strained(scene, sign * size, "isotropic")
        simulated = (before.pressure - after.pressure) / (sign * size * dimension)
        assert moduli.bulk_modulus == pytest.approx(simulated, rel=1e-3)


def test_moduli_of_a_strain_with_springs_at_the_rolling_limit_are_those_of_simulated_strains_of_both_signs():
    scene, size = pressed(2, pm.RollingResistance(0.06, 1.0, 0.1)), 1e-7
    shear = np.array([[0.0, 1.0], [1.0, 0.0]])
    before = pm.contact_forces(scene)
    stick, slip = (pm.elastic_moduli(scene, contacts_at_limit=choice) for choice in ("stick", "slip"))
    count = int(before.turning_limits[0].at_limit_c.sum())
    assert stick.turning_sliding == 0 < slip.turning_sliding == slip.turning_at_limit == stick.turning_at_limit == count
    for sign in (1.0, -1.0):
        moduli = pm.elastic_moduli(scene, contacts_at_limit=sign * shear)
        assert 0 < moduli.turning_sliding < count and moduli.doubtful_at_limit == 0
        simulated = (strained(scene, sign * size, "shear").stress_dd - before.stress_dd)[0, 1] / (sign * size)
        assert moduli.shear_modulus == pytest.approx(simulated, rel=1e-3)
        assert slip.shear_modulus < 0.99 * simulated < 0.95 * stick.shear_modulus


@pytest.mark.parametrize("dimension", [2, 3])
def test_slow_oscillations_of_the_box_have_the_shear_modulus_of_the_sparse_solve(dimension):
    """Contacts kept from sliding by a larger mu; G'(omega) extrapolated in omega^2 from two slow shears."""
    scene = sticking(at_rest(dimension))
    moduli = pm.elastic_moduli(scene)
    # forces across the contacts make it no second derivative of an energy
    assert np.abs(moduli.energy - moduli.energy.T).max() > 1e-3 * moduli.shear_modulus
    assert moduli.residual < 1e-12 and moduli.stable
    damped = scene.replace(effects=(HARD, pm.Friction(1e6, 0.7, 3.0), pm.ContactDamping(3.0)))
    storage = []
    for frequency in (0.006, 0.003):
        run = pm.oscillatory_shear(damped, amplitude=1e-6, frequency=frequency, periods=2.0, skip_periods=1.0)
        assert run.sliding_t.max() == 0 and np.ptp(run.contacts_t) == 0
        storage.append(run.moduli.storage)
    assert abs(storage[1] - storage[0]) < 1e-2 * moduli.shear_modulus
    assert (4.0 * storage[1] - storage[0]) / 3.0 == pytest.approx(moduli.shear_modulus, rel=2e-5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_undamped_run_started_along_a_mode_follows_it_and_grows_where_its_frequency_is_complex(dimension):
    """Velocities v give q(t) = v sin(omega t) / omega; in space forces across the contacts make omega complex."""
    scene = sticking(at_rest(dimension))
    modes = pm.frictional_modes(scene)
    m = int(np.argmax(modes.growth_m)) if dimension == 3 else 3
    assert bool(modes.growth_m[m] > 1e-3) is (dimension == 3)
    size, time, omega = 1e-5, 60.0, modes.frequency_m[m]
    run = pm.simulate(
        scene,
        steps=20_000,
        dt=time / 20_000,
        velocity_nd=size * modes.displacement_mnd[m].real,
        spin_nk=size * modes.rotation_mnk[m].real,
    )
    moved = run.packing.position_nd - scene.packing.position_nd
    off = [np.abs(moved - size * (modes.displacement_mnd[m] * np.sin(w * time) / w).real) for w in (omega, omega.real)]
    scale = size * np.abs(modes.displacement_mnd[m]).max() / abs(omega)
    assert off[0].max() < 2e-3 * scale, (off[0].max(), off[1].max(), scale)
    assert bool(off[1].max() > 0.02 * scale) is (dimension == 3), (off[0].max(), off[1].max(), scale)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda scene: pm.elastic_moduli(scene, gap_tolerance=1e-3),
            "gap_tolerance must be None for a scene with fric",
        ),
        (lambda scene: pm.elastic_moduli(scene, contacts_at_limit="roll"), "contacts_at_limit must be .*stick.*slip"),
        (lambda scene: pm.elastic_moduli(scene, contacts_at_limit=np.eye(4)), "contacts_at_limit must have shape"),
        (lambda scene: pm.elastic_moduli(scene, contacts_at_limit=np.zeros((2, 2))), "strain that is not zero"),
        (lambda scene: pm.stiffness_matrix(scene, "isotropic"), "strain must be 'none' or 'free'"),
        (lambda scene: pm.stiffness_matrix(scene, kind="paper"), "kind must be .*exact.*unstressed"),
        (lambda scene: pm.frictional_modes(scene, method="lanczos"), "method must be .*auto.*dense"),
        (lambda scene: pm.frictional_modes(scene, 0), "count must be an integer at least 1"),
        (
            lambda scene: pm.stiffness_matrix(
                scene.replace(packing=pm.Packing([[0.5, 0.5]] * 2, [0.5] * 2, pm.Box.cubic(4.0, 2)))
            ),
            "no coincident centers .*particles 0 and 1",
        ),
    ],
)
def test_what_has_no_linear_response_with_friction_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call(at_rest(2))


def test_a_packing_without_contacts_has_no_moduli_and_no_modes():
    apart = pm.Packing([[0.5, 0.5], [2.0, 2.0]], [0.5] * 2, pm.Box.cubic(4.0, 2))
    scene = pm.Scene(apart, (HARD, pm.Friction(0.5, 1.0)))
    moduli = pm.elastic_moduli(scene)
    assert not moduli.cauchy.any() and len(moduli.soft_directions) == 3 and moduli.particles == 0
    assert len(pm.frictional_modes(scene)) == 0
    assert pm.frictional_modes(scene, rattlers="keep").zero_m.all()


@pytest.mark.parametrize("particles", [3, 6])
def test_a_row_of_discs_that_resists_rolling_is_held_by_two_contacts_a_disc(particles):
    """Three numbers a contact for three motions a disc: without rolling springs the row buckles in as many ways."""
    side = particles * 0.98
    place = np.column_stack([np.arange(particles) * 0.98, np.full(particles, 1.5)])
    packing = pm.Packing(place, np.full(particles, 0.5), pm.Box(np.diag([side, 3.0])))
    rough = pm.Scene(packing, (HARD, pm.Friction(0.5, 0.7), pm.RollingResistance(0.2, 0.4)))
    for scene, floppy in ((rough, 2), (rough.without(pm.RollingResistance), particles + 1)):
        matrix = pm.stiffness_matrix(scene, "none", "unstressed").toarray()
        assert np.count_nonzero(np.abs(np.linalg.eigvalsh(matrix)) < 1e-10) == floppy
        assert pm.contact_forces(scene).isostatic_coordination == (2.0 if scene is rough else 3.0)


def rows_of_contacts(scene, kept):
    """Return the rows of all contacts of kept particles: how distance, slip, roll and twist grow with each motion."""
    packing = scene.packing
    d, k = packing.dimension, 1 if packing.dimension == 2 else 3
    found = pm.find_contacts(packing)
    rows = []
    for i, j, vector in zip(found.i_c, found.j_c, found.vector_cd, strict=True):
        if not (kept[i] and kept[j]):
            continue
        n = np.zeros(3)
        n[:d] = vector / np.linalg.norm(vector)
        share = np.linalg.norm(vector) / (packing.radius_n[i] + packing.radius_n[j])
        one = np.zeros((3 + 3, len(kept), d + k))
        for a in range(d):
            one[:3, i, a], one[:3, j, a] = -np.eye(3)[a], np.eye(3)[a]
        for b in range(k):
            spin = np.eye(3)[2 if d == 2 else b]
            for end in (i, j):
                one[:3, end, d + b] = -packing.radius_n[end] * share * np.cross(spin, n)
                one[3:, end, d + b] = spin * (1.0 if end == j else -1.0)
        rows.append(one.reshape(6, -1))
    whole = np.array(rows).reshape(6 * len(rows), len(kept), d + k)[:, kept].reshape(6 * len(rows), -1)
    return whole, len(rows)


@pytest.mark.parametrize("dimension", [2, 3])
def test_zero_modes_and_counts_with_rolling_and_twisting_springs_agree_with_ranks_on_ten_packings(dimension):
    """Whole packings have none but translations; half of their particles have as many as the rank of all rows lacks."""
    turning = (pm.RollingResistance(0.2, 0.4), pm.TwistingResistance(0.1, 0.6))[: dimension - 1]
    numbers, floppy = {2: 3, 3: 6}[dimension], []
    for seed in range(10):
        start = pm.random_packing(
            12, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.5, seed=seed
        )
        jammed = pm.jam(pm.Scene(start, (HARD,)), pressure=1e-3).packing
        half = pm.Packing(jammed.position_nd[:6], jammed.radius_n[:6], jammed.box)
        for packing in (jammed, half):
            scene = pm.Scene(packing, (HARD, pm.Friction(0.5, 0.7), *turning))
            found = pm.contact_forces(scene)
            kept = np.ones(packing.particles, dtype=bool) if packing is half else ~found.rattlers_n
            rows, contacts = rows_of_contacts(scene, kept)
            rank = np.linalg.matrix_rank(rows, tol=1e-9)
            how = "keep" if packing is half else "remove"
            modes = pm.frictional_modes(scene, kind="unstressed", method="dense", rattlers=how)
            # translations are none of them
            zero = int(np.count_nonzero(modes.zero_m))
            assert zero == rows.shape[1] - rank - dimension
            if packing is half:
                floppy.append(zero)
            else:
                excess = 0.5 * numbers * kept.sum() * (found.coordination_number - found.isostatic_coordination)
                assert excess == pytest.approx(numbers * contacts - rows.shape[1], abs=1e-9)
    assert max(floppy) > 0 and len(set(floppy)) > 2


def test_packings_that_resist_rolling_jam_with_fewer_contacts_and_room_between():
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.7, seed=1)
    effects = (HARD, pm.ContactDamping(0.3), pm.Friction(0.5, damping=0.1), pm.RollingResistance(0.5, 1.0, 0.1))
    scenes = [pm.Scene(start, effects[:3]), pm.Scene(start, effects)]
    runs = [pm.jam(scene, pressure=1e-3, method=pm.Press(rate=1e-3)) for scene in scenes]
    assert all(run.outcome.ok for run in runs)
    found = [pm.contact_forces(one.replace(packing=run.packing)) for one, run in zip(scenes, runs, strict=True)]
    assert all(one.residual < 1e-7 for one in found)
    assert found[1].coordination_number < found[0].coordination_number - 0.1
    assert pm.packing_fraction(runs[1].packing) < pm.packing_fraction(runs[0].packing) - 0.01
    assert 2.0 <= found[1].isostatic_coordination < found[1].coordination_number
    moduli = [pm.elastic_moduli(one.replace(packing=run.packing)) for one, run in zip(scenes, runs, strict=True)]
    assert all(one.bulk_modulus > 0.0 and one.shear_modulus > 0.0 for one in moduli)
