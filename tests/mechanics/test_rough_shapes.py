"""Facts about friction of ellipses, spheroids, rigid bodies and linked discs at rest: the engine's own derivatives."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import build_engine

SPRING = pm.Repulsion(pm.LinearSpring(1.0))
# a time step, and what differences over it leave of derivatives, relative to the largest
STEP, CLOSE = 1e-5, 1e-7
# third derivatives are larger where faces are flatter: errors, as the square of the step, would be 3e-7 and 4e-9
STEPS = {"superellipsoids": 1e-6, "superellipses": 1e-6}
BODIES = {
    "ellipses": (2, pm.Ellipses(aspect=1.6), 0.95),
    "spheroids": (3, pm.Ellipses(aspect=0.6), 0.78),
    "bodies": (3, pm.Trimer(angle=2.0), 0.75),
    "superellipses": (2, pm.Superellipses(3.0, (1.3, 1.0)), 0.95),
    "superellipsoids": (3, pm.Superellipses(2.5, (1.4, 1.2, 1.0)), 0.78),
}
LINKED = {"linked dimers": 2}


def effects(mu, damping):
    """Return the same kinds of effects, with dashpots and without."""
    return SPRING, pm.Friction(mu, 0.7, damping), pm.ContactDamping(damping)


def pushed(packing):
    """Return the packing with particles moved and turned a little, so that friction has something to do."""
    rng = np.random.default_rng(9)
    n, d = packing.position_nd.shape
    position = packing.position_nd + 0.03 * rng.normal(size=(n, d))
    if not packing.shapes.has_orientations:
        return pm.reaffix_links(packing.replace(position_nd=position)).packing
    turned = packing.shapes.turned(0.1 * rng.normal(size=(n, 1 if d == 2 else 3)))
    return packing.replace(position_nd=position, shapes=turned)


@functools.cache
def settled(name):
    """Return a scene with friction, and the run in which it came to rest."""
    if name in LINKED:
        d = LINKED[name]
        dimer = pm.Dimer(length=1.05, radii=0.5)
        fraction = 0.95 if d == 2 else 0.75
        start = pm.cluster_packing(8, dimer, dimension=d, packing_fraction=fraction, seed=3)
    else:
        d, shapes, fraction = BODIES[name]
        start = pm.random_packing(12, dimension=d, packing_fraction=fraction, seed=3, shapes=shapes)
    start = pm.quench(pm.Scene(start, (SPRING,)), force_tolerance=1e-4).packing
    scene = pm.Scene(pushed(start), effects(0.5, 0.3))
    return scene, pm.settle(scene, force_tolerance=1e-10)


@functools.cache
def at_rest(name):
    """Return a scene at rest with stretched springs, far from the Coulomb limit and without dashpots."""
    found = pm.Scene(settled(name)[1].packing, effects(1e6, 0.0))
    forces = pm.contact_forces(found)
    assert forces.residual < 1e-9
    assert np.abs(forces.tangential_cd).max() > 0.05 * forces.normal_c.mean()
    return found


def after(scene, motion_nq, step, gradient_dd=None):
    """Return the forces after one small step of motion of particles too heavy to be moved, in a box that deforms."""
    packing, d = scene.packing, scene.packing.dimension
    # the engine holds links in a box at rest alone; these particles do not touch when they are not linked
    heavy = packing.replace(mass_n=np.full(packing.particles, 1e14), links=None)
    size = 1.0 if gradient_dd is not None else 0.0
    engine = build_engine(
        scene.replace(packing=heavy),
        dt=abs(step),
        velocity_nd=np.sign(step) * motion_nq[:, :d],
        spin_nk=np.sign(step) * np.einsum("nk,nkt->nt", motion_nq[:, d:], packing.spin_nkk),
        profile=Ramp(0.0, np.sign(step) * size, 0.0, 9.0),
        direction_dd=np.eye(d) if gradient_dd is None else gradient_dd,
        second_order=False,
    )
    engine.advance(1)
    moved = engine.packing()
    return pm.contact_forces(scene.replace(packing=moved.replace(links=packing.links, tangential=moved.tangential)))


def along(scene, forces):
    """Return forces and torques along the coordinates of the stiffness matrix."""
    torque = np.einsum("nkt,nt->nk", scene.packing.spin_nkk, forces.torque_nk)
    return np.hstack([forces.force_nd, torque]).ravel()


def motion_of(scene, seed=5):
    n, d = scene.packing.position_nd.shape
    return np.random.default_rng(seed).normal(size=(n, 3 if d == 2 else 6))


@pytest.mark.parametrize("name", [*BODIES, *LINKED])
def test_rough_particles_settle_within_the_cones_of_friction(name):
    scene, run = settled(name)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual == found.residual <= 1e-10
    size = np.sqrt((found.tangential_cd**2).sum(axis=1))
    assert (size <= 0.5 * found.normal_c * (1.0 + 1e-12)).all()
    assert np.abs((found.tangential_cd * found.contacts.normal_cd).sum(axis=1)).max() < 1e-15
    # at rest the parts of the scene say the same
    at_rest = found.scene
    assert np.abs(found.torque_nk).max() < 1e-9 * found.normal_c.mean()
    assert pm.pressure(at_rest) == pytest.approx(found.pressure, rel=1e-12)
    if name in BODIES:
        assert pm.force_distribution(at_rest).mean == pytest.approx(np.linalg.norm(found.force_cd, axis=1).mean())
    else:
        whole = pm.stress_tensor(at_rest, parts="contacts") + pm.stress_tensor(at_rest, parts="links")
        assert np.allclose(found.stress_dd, whole, rtol=0.0, atol=1e-15) and found.tension_l.any()
    assert np.allclose(found.stress_dd, found.stress_dd.T, rtol=0.0, atol=1e-9 * found.pressure)


@pytest.mark.parametrize("name", BODIES)
def test_the_stiffness_matrix_is_the_derivative_of_forces_and_torques_in_the_engine(name):
    scene, step = at_rest(name), STEPS.get(name, STEP)
    motion = motion_of(scene)
    ahead, behind = (along(scene, after(scene, motion, sign * step)) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * step)
    told = pm.stiffness_matrix(scene, "none") @ motion.ravel()
    assert np.abs(told + change).max() < CLOSE * np.abs(change).max()
    bare = pm.stiffness_matrix(scene, "none", "unstressed") @ motion.ravel()
    assert np.abs(bare + change).max() > 1e-3 * np.abs(change).max()


@pytest.mark.parametrize("name", [*BODIES, *LINKED])
def test_moduli_are_those_of_a_small_strain_in_the_engine(name):
    """Particles that relax as the moduli say stay in balance, and their stress changes as these say."""
    scene, step = at_rest(name), STEPS.get(name, STEP)
    packing, n, d = scene.packing, scene.packing.particles, scene.packing.dimension
    moduli = pm.elastic_moduli(scene, contacts_at_limit="stick")
    assert moduli.residual < 1e-8 and moduli.stable_in_box
    rng = np.random.default_rng(4)
    gradient = rng.normal(size=(d, d))
    gradient += gradient.T
    strain = pm.mandel_vector(gradient)
    matrix = pm.stiffness_matrix(scene).toarray()
    size = matrix.shape[0] - len(strain)
    stiffness, load = matrix[:size, :size], -matrix[:size, size:] @ strain
    if packing.links:
        jacobian = pm.constraint_jacobian(packing, strain="free")
        jacobian = (jacobian.toarray() if hasattr(jacobian, "toarray") else np.asarray(jacobian)).T
        rows = np.zeros((len(packing.links), n, size // n))
        rows[:, :, :d] = jacobian[:, : n * d].reshape(-1, n, d)
        rows = rows.reshape(-1, size)
        stiffness = np.block([[stiffness, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        load = np.concatenate([load, -jacobian[:, n * d :] @ strain])
    motion = np.linalg.lstsq(stiffness, load, rcond=1e-11)[0][:size].reshape(n, -1)
    ahead, behind = (after(scene, motion, sign * step, gradient) for sign in (1.0, -1.0))
    left = (ahead.largest_imbalance + behind.largest_imbalance) / (2.0 * step)
    assert left < 1e-4 * np.abs(load).max()
    change = (ahead.stress_dd - behind.stress_dd) / (2.0 * step)
    expected = moduli.cauchy @ strain
    assert np.abs(pm.mandel_vector(0.5 * (change + change.T)) - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["ellipses", "bodies"])
def test_the_complex_modulus_of_rough_shapes_tends_to_their_moduli(name):
    scene = at_rest(name)
    d = scene.packing.dimension
    found = pm.complex_modulus(scene, [1e-7], mode="isotropic")
    expected = np.trace(np.einsum("abcc->ab", pm.elastic_moduli(scene).tensor(tangent="cauchy"))) / d
    assert found.modulus_f[0].real == pytest.approx(expected, rel=1e-6)
    assert found.residual < 1e-8


@pytest.mark.parametrize("name", ["ellipses", "spheroids", "linked dimers"])
def test_modes_of_rough_shapes_are_the_same_dense_and_sparse_and_keep_links(name):
    scene = at_rest(name)
    dense = pm.frictional_modes(scene, 6, method="dense")
    sparse = pm.frictional_modes(scene, 6, method="shift-invert")
    scale = dense.largest
    assert np.abs(dense.eigenvalue_m - sparse.eigenvalue_m).max() < 1e-9 * scale
    assert max(dense.residual, sparse.residual) < 1e-9
    if name in LINKED:
        links = scene.packing.links
        vector = links.vectors(scene.packing.position_nd, scene.packing.box.lattice_dd)
        apart = dense.displacement_mnd[:, links.j_l] - dense.displacement_mnd[:, links.i_l]
        assert np.abs(np.einsum("mld,ld->ml", apart, vector)).max() < 1e-12


def test_a_sliding_contact_of_ellipses_follows_the_normal_force_and_a_returning_one_is_a_spring():
    mu, stiffness = 0.4, 0.7
    shapes = pm.Spheroids([1.8, 0.7], [[1.0, 0.3], [0.2, 1.0]])
    pair = pm.Packing([[1.0, 1.0], [1.55, 1.6]], [0.55, 0.45], pm.Box.cubic(6.0, 2), shapes=shapes)
    kinds = (SPRING, pm.Friction(mu, stiffness, 0.0), pm.ContactDamping(0.0))
    normal = pm.contact_forces(pm.Scene(pair, kinds)).normal_c[0]
    springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[mu * normal / stiffness * (1.0 + 1e-12)]])
    scene = pm.Scene(pair.replace(tangential=springs), kinds)
    found = pm.contact_forces(scene)
    assert found.at_limit_c.tolist() == [True]
    motion = motion_of(scene)
    # on along the force, whatever else moves
    motion[1, :2] += 6.0 * found.tangential_cd[0] / np.linalg.norm(found.tangential_cd[0])
    now = along(scene, found)
    for sign, choice in ((1.0, "slip"), (-1.0, "stick")):
        one, two = ((along(scene, after(scene, motion, sign * h)) - now) / (sign * h) for h in (2e-6, 1e-6))
        told = pm.stiffness_matrix(scene, "none", contacts_at_limit=choice) @ motion.ravel()
        assert np.abs(told + (2.0 * two - one)).max() < 1e-6 * np.abs(told).max()
