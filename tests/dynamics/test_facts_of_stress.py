"""Facts about the stress of frictional, bonded, damped, spinning particles: symmetry, frames, turned scenes."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packmech as pm
import packmech.validation.particle_shear as ps
from packmech.dynamics.friction import slip_of_discs, stretch_after, stretch_before
from packmech.minimize.passes.shape_rows import ShapeTouch

SPRING = pm.LinearSpring()
STILL = pm.SteadyStrain(0.0)
DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
TENSORS = ("stress_tdd", "overall_stress_tdd", "torque_stress_tdd", "spin_stress_tdd", "bond_stress_tdd")
INERTIA = {2: 0.5, 3: 0.4}


def spins(dimension):
    return 1 if dimension == 2 else 3


def scene_of(packing, bonds):
    effects = (pm.Repulsion(law=SPRING), pm.ContactDamping(0.2), pm.Friction(0.3, 0.4, 0.1), bonds)
    return pm.Scene(packing, effects)


@cache
def scene(dimension):
    """Particles that touch all over a periodic box, a third of the contacts bonds."""
    fraction = 0.95 if dimension == 2 else 0.75
    packing = pm.random_packing(40, dimension=dimension, packing_fraction=fraction, seed=6)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.1, tangential_damping=0.05)
    return scene_of(packing, bonds.select(np.arange(len(bonds)) % 3 == 0))


def motion(dimension):
    """Return velocities and spins of no symmetry."""
    rng = np.random.default_rng(1)
    return 0.2 * rng.standard_normal((40, dimension)), 0.5 * rng.standard_normal((40, spins(dimension)))


def moved(dimension, *, strain, boost=0.0, shift=0.0, steps=60):
    start, (velocity, spin) = scene(dimension), motion(dimension)
    start = start.replace(packing=start.packing.replace(position_nd=start.packing.position_nd + shift))
    return pm.simulate(
        start, steps=steps, dt=0.03, velocity_nd=velocity + boost, spin_nk=spin, applied_strain=strain, trace_every=10
    )


@cache
def sheared(dimension):
    return moved(dimension, strain=pm.SteadyStrain(0.5))


@DIMENSIONS
def test_the_overall_stress_is_symmetric_to_rounding_and_that_of_contacts_is_not(dimension):
    trace = sheared(dimension).trace
    scale = np.abs(trace.overall_stress_tdd).max()
    assert trace.sliding_t.min() > 0
    assert np.abs(trace.overall_stress_tdd - np.swapaxes(trace.overall_stress_tdd, 1, 2)).max() < 1e-14 * scale
    assert np.abs(trace.stress_tdd - np.swapaxes(trace.stress_tdd, 1, 2)).max() > 1e-3 * scale


BOOST = {2: np.array([0.7, -0.4]), 3: np.array([0.7, -0.4, 0.3])}
SHIFT = {2: np.array([13.7, -5.3]), 3: np.array([3.7, -5.3, 1.9])}


@pytest.mark.parametrize("strain", [STILL, pm.SteadyStrain(0.5)], ids=["still", "sheared"])
@pytest.mark.parametrize("name", [*TENSORS, "kinetic_stress_tdd"])
@DIMENSIONS
def test_no_stress_depends_on_the_velocity_of_the_frame(dimension, name, strain):
    one = moved(dimension, strain=strain, steps=20)
    other = moved(dimension, strain=strain, boost=BOOST[dimension], steps=20)
    a, b = getattr(one.trace, name), getattr(other.trace, name)
    assert np.abs(a - b).max() < 1e-11 * np.abs(a).max()


@DIMENSIONS
def test_kinetic_energy_is_that_of_another_frame_and_so_depends_on_it(dimension):
    one, other = (moved(dimension, strain=STILL, boost=v, steps=20) for v in (0.0, BOOST[dimension]))
    mass, boost = one.packing.mass_n.sum(), BOOST[dimension]
    expected = one.trace.kinetic_t + one.trace.momentum_td @ boost + 0.5 * mass * boost @ boost
    assert other.trace.kinetic_t == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", [*TENSORS, "kinetic_stress_tdd"])
@DIMENSIONS
def test_no_stress_depends_on_where_the_particles_are_in_the_box(dimension, name):
    one, other = sheared(dimension), moved(dimension, strain=pm.SteadyStrain(0.5), shift=SHIFT[dimension])
    a, b = getattr(one.trace, name), getattr(other.trace, name)
    assert np.abs(a - b).max() < 1e-10 * np.abs(a).max()


def test_tensors_of_the_preset_depend_on_where_the_cell_is_cut_and_the_virial_of_all_contacts_does_not():
    def stresses(shift):
        start = ps.SCENARIOS["assembly_sheared"](seed=2).start
        sides = np.array([start.width, start.height])
        discs = ps.ShearedDiscs((start.position_nd + shift) % sides, start.radius_n, start.mass_n)
        material = ps.SCENARIOS["assembly_sheared"](seed=2).material
        found = ps.advance(discs, material, ps.StepRules(1e-9, plates=False), np.zeros(2)).last
        packing = pm.Packing(discs.position_nd, discs.radius_n, pm.Box(np.diag(sides)))
        return found.stress("overall"), pm.stress_tensor(pm.Scene(packing, (pm.Repulsion(law=SPRING),)))

    (one, native), (other, native_shifted) = stresses(np.zeros(2)), stresses(np.array([170.0, 90.0]))
    assert np.abs(one - other).max() > 1e-2 * np.abs(one).max()
    assert np.abs(native - native_shifted).max() < 1e-11 * np.abs(native).max()


def alone(dimension, spin, *, velocity=None, shift=0.0):
    """Return the trace of three particles that touch nobody and spin, their moments of inertia, and the volume."""
    position = 3.0 * np.arange(1, 4)[:, None] * np.ones(dimension) + shift
    none = pm.Bonds(np.zeros(0, int), np.zeros(0, int), np.zeros((0, dimension), int), np.zeros(0))
    packing = pm.Packing(position, [0.5, 0.6, 0.8], pm.Box.cubic(12.0, dimension))
    moving = {"velocity_nd": velocity, "spin_nk": spin, "applied_strain": STILL}
    run = pm.simulate(scene_of(packing, none), steps=1, dt=0.1, trace_every=1, **moving)
    inertia = INERTIA[dimension] * packing.mass_n * packing.radius_n**2
    return run.trace, inertia, packing.box.volume


@DIMENSIONS
def test_angular_momentum_depends_on_the_origin_as_the_momentum_says(dimension):
    velocity, spin = (x[:3] for x in motion(dimension))
    shift = np.array([1.7, -1.3, 0.9])[:dimension]
    one, other = (alone(dimension, spin, velocity=velocity, shift=s)[0] for s in (0.0, shift))
    lever, momentum = np.zeros(3), np.zeros(3)
    lever[:dimension], momentum[:dimension] = shift, one.momentum_td[0]
    added = np.cross(lever, momentum)[-spins(dimension) :]
    assert np.abs(added).max() > 0.1
    assert other.angular_momentum_tk[0] - one.angular_momentum_tk[0] == pytest.approx(added, rel=1e-13, abs=1e-14)


def test_the_spin_stress_of_spheres_is_the_stress_that_holds_them_together():
    # div sigma = rho a and no traction: V sigma = -int rho a x^T, a = w (w.x) - w^2 x, int rho x x^T = I/2
    spin = np.array([[1.0, 2.0, -0.5], [0.3, 0.0, 0.9], [-1.0, 0.4, 0.2]])
    trace, inertia, volume = alone(3, spin)
    turn = np.array([np.cross(np.eye(3), w) for w in spin])
    expected = -sum(0.5 * i * w @ w for i, w in zip(inertia, turn, strict=True)) / volume
    assert trace.spin_stress_tdd[0] == pytest.approx(expected, rel=1e-14, abs=1e-17)


def test_spheres_that_spin_about_one_axis_have_the_spin_stress_of_discs_and_none_along_it():
    rate = np.array([1.0, -0.3, 2.0])
    flat, flat_inertia, area = alone(2, rate[:, None])
    trace, inertia, volume = alone(3, np.stack([0.0 * rate, 0.0 * rate, rate], axis=1))
    expected = np.diag([1.0, 1.0, 0.0])
    assert flat.spin_stress_tdd[0] * area / (0.5 * flat_inertia @ rate**2) == pytest.approx(expected[:2, :2], rel=1e-14)
    assert trace.spin_stress_tdd[0] * volume / (0.5 * inertia @ rate**2) == pytest.approx(expected, rel=1e-14)


def test_the_motion_of_a_turned_scene_in_space_is_the_turned_motion():
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    start, (velocity, spin) = scene(3), motion(3)
    packing = start.packing
    turned = packing.replace(position_nd=packing.position_nd @ turn.T, box=pm.Box(turn @ packing.box.lattice_dd))
    there = {"steps": 60, "dt": 0.03, "applied_strain": STILL, "trace_every": 10}
    one = pm.simulate(start, velocity_nd=velocity, spin_nk=spin, **there)
    other = pm.simulate(start.replace(packing=turned), velocity_nd=velocity @ turn.T, spin_nk=spin @ turn.T, **there)
    assert one.trace.sliding_t.max() > 0
    assert np.abs(other.packing.position_nd - one.packing.position_nd @ turn.T).max() < 1e-11
    assert np.abs(other.spin_nk - one.spin_nk @ turn.T).max() < 1e-11
    expected = np.einsum("ab,tbc,dc->tad", turn, one.trace.overall_stress_tdd, turn)
    assert np.abs(other.trace.overall_stress_tdd - expected).max() < 1e-11 * np.abs(expected).max()


# ----------------------------------------------------------------------------------- tangential history under rotation

SPIN = np.array([0.5, -0.8, 1.1])
RADII = np.array([0.5, 0.7])


def history(time):
    """Return branch vector, its rate and both spins of a contact that rolls, slides and changes its length."""
    n = np.array([np.cos(0.9 * time), np.sin(0.9 * time) * np.cos(0.3), np.sin(0.9 * time) * np.sin(0.3)])
    dn = 0.9 * np.array([-np.sin(0.9 * time), np.cos(0.9 * time) * np.cos(0.3), np.cos(0.9 * time) * np.sin(0.3)])
    r, dr = 1.1 + 0.05 * np.sin(2.0 * time), 0.1 * np.cos(2.0 * time)
    own = np.array([[0.3 * np.cos(time), 0.7, -0.2], [0.5, 0.4 * np.sin(time), 0.6]])
    return r * n, dr * n + r * dn, own


def seen(history, turned, time):
    """Return the same seen from a frame that turns with SPIN, or does not."""
    branch, rate, own = history(time)
    if not turned:
        return branch, rate, own, np.eye(3)
    q = Rotation.from_rotvec(SPIN * time).as_matrix()
    return q @ branch, q @ rate + np.cross(SPIN, q @ branch), own @ q.T + SPIN, q


def stretched(history, turned, steps, first=(0.0, 0.0, 0.0), duration=2.0):
    """Return the stretch of a tangential spring after a history, by the rule of the loops, seen in its own frame."""
    dt = duration / steps
    held = np.array(first, dtype=float)
    for step in range(steps + 1):
        branch, rate, own, q = seen(history, turned, step * dt)
        r = np.linalg.norm(branch)
        n = branch / r
        body = np.zeros((2, 10))
        body[:, 3], body[:, 7:] = RADII, own
        touch = ShapeTouch(True, r, RADII.sum(), RADII.prod() / RADII.sum(), *n, *np.zeros(6))
        slip = slip_of_discs((0, 1, 2), body, 0, 1, touch, rate)
        before, after = 0.5 * dt * (step > 0), 0.5 * dt * (step < steps)
        held = stretch_after(*stretch_before(*held, slip, before), slip, after)
    return q.T @ held, q.T @ n


def test_a_tangential_spring_in_space_is_stretched_alike_whatever_turns_around_it():
    steps = np.array([100, 200, 400, 800])
    fine, _ = stretched(history, False, 6400)
    error = [np.linalg.norm(stretched(history, True, k)[0] - fine) for k in steps]
    assert np.linalg.norm(fine) > 0.3
    # the rule of the loops is objective to its order
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(-2.0, abs=0.1)
    assert error[-1] < 1e-4


def at_rest(time):
    return np.array([1.1, 0.0, 0.0]), np.zeros(3), np.zeros((2, 3))


def test_rigid_rotation_turns_a_tangential_spring_with_the_contact_and_keeps_its_length():
    first = np.array([0.0, 0.03, -0.04])
    found, _ = stretched(at_rest, True, 400, first)
    assert np.linalg.norm(found) == pytest.approx(0.05, rel=1e-13)
    assert found == pytest.approx(first, abs=1e-5)


def test_a_tangential_spring_stays_in_the_tangent_plane():
    found, n = stretched(history, True, 100)
    assert abs(found @ n) < 1e-14 * np.linalg.norm(found)
