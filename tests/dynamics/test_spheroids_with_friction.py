"""Spheroids in space that rub: their rotation as symmetric tops, orders, what is conserved, spheres as their limit."""

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import CONTACTS, FORCE
from packmech.dynamics.pair_forces import pair_forces

REPULSION = (pm.Repulsion(),)
# a turn of all of space
TURN = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
MOTION = np.random.default_rng(4).normal(size=(4, 3))
# they meet, and turn about all axes, their own among them
VELOCITY = 0.1 * MOTION[2:] + [[0.22, 0.1, 0.0], [0.0, 0.0, 0.0]]
VELOCITY -= np.array([0.5**3, 0.45**3]) @ VELOCITY / (0.5**3 + 0.45**3)
SPIN = 0.5 * MOTION[:2]
# both turn one way about all axes
RUBBING = {"velocity_nd": None, "spin_nk": [[0.4, -0.3, 0.8], [0.2, -0.6, 0.7]]}


def rough(coefficient, damping=0.0):
    return (*REPULSION, pm.Friction(coefficient=coefficient, stiffness=0.7, damping=damping))


def pair(turn=None, aspects=(1.8, 0.6), side=10.0):
    """Return two spheroids that overlap askew in the middle of a box, turned."""
    turn = np.eye(3) if turn is None else turn
    place = np.array([[0.0, 0.0, 0.0], [0.7, 0.25, 0.1]])
    director = np.array([[0.8, 0.6, 0.3], [0.1, 1.0, 0.3]])
    shapes = pm.Spheroids(np.array(aspects), director @ turn.T)
    return pm.Packing(place @ turn.T + 0.5 * side, [0.5, 0.45], pm.Box.cubic(side, 3), shapes=shapes)


def inertias(packing):
    """Return moments of inertia across directors and about them."""
    along, across = packing.shapes.semi_axes(packing.radius_n)
    return packing.mass_n * (along**2 + across**2) / 5.0, packing.mass_n * 2.0 * across**2 / 5.0


def angular_momentum(packing, spin_nk):
    """Return the (N, 3) angular momenta of spins."""
    side, own = inertias(packing)
    director = packing.shapes.director_nd
    about = (spin_nk * director).sum(axis=1)
    return side[:, None] * spin_nk + ((own - side) * about)[:, None] * director


def rotated(vector_d, axis_d, angle):
    """Return a vector turned about an axis of length one."""
    c, s = np.cos(angle), np.sin(angle)
    return c * vector_d + s * np.cross(axis_d, vector_d) + (1.0 - c) * (axis_d @ vector_d) * axis_d


def run(packing, effects, *, dt=0.01, duration=0.5, turn=None, **more):
    turn = np.eye(3) if turn is None else turn
    start = {"velocity_nd": VELOCITY @ turn.T, "spin_nk": SPIN @ turn.T}
    return pm.simulate(pm.Scene(packing, effects), duration=duration, dt=dt, trace_every=1, **start | more)


@pytest.mark.parametrize("aspect", [2.5, 0.4, 1.0])
@pytest.mark.parametrize("dt", [0.1, 0.05])
def test_a_free_spheroid_precesses_as_a_symmetric_top_whatever_the_step(aspect, dt):
    packing = pm.Packing([[2.0] * 3], [0.5], pm.Box.cubic(4.0, 3), shapes=pm.Spheroids([aspect], [[0.6, 0.0, 0.8]]))
    spin = np.array([[0.3, -0.4, 1.1]])
    whole = angular_momentum(packing, spin)[0]
    size = np.linalg.norm(whole)
    (side,), (own,) = inertias(packing)
    end = run(packing, REPULSION, dt=dt, duration=5.0, velocity_nd=None, spin_nk=spin)
    expected = rotated(packing.shapes.director_nd[0], whole / size, 5.0 * size / side)
    assert np.abs(end.packing.shapes.director_nd[0] - expected).max() < 1e-13
    # the spin follows: across the director by one moment of inertia, about it by the other
    about = (whole @ expected) * expected
    assert np.abs(end.spin_nk[0] - (whole - about) / side - about / own).max() < 1e-12
    kinetic = 0.5 * spin[0] @ whole
    assert np.abs(end.trace.kinetic_t / kinetic - 1.0).max() < 1e-13
    outside = packing.mass_n[0] * np.cross(packing.position_nd[0], [0.0, 0.0, 0.0])
    assert np.abs(end.trace.angular_momentum_tk - whole - outside).max() < 1e-14


def test_drag_takes_angular_momentum_at_its_rate():
    packing = pm.Packing([[2.0] * 3], [0.5], pm.Box.cubic(4.0, 3), shapes=pm.Spheroids([2.0], [[0.6, 0.0, 0.8]]))
    spin = np.array([[0.3, -0.4, 1.1]])
    whole = angular_momentum(packing, spin)[0]
    effects = (*REPULSION, pm.BackgroundDamping(0.5))
    end = run(packing, effects, dt=0.002, duration=2.0, velocity_nd=None, spin_nk=spin)
    assert np.abs(end.trace.angular_momentum_tk[-1] - np.exp(-1.0) * whole).max() < 1e-6 * np.linalg.norm(whole)


@pytest.mark.parametrize("aspect", [2.0, 0.5])
def test_a_flow_turns_a_spheroid_along_its_vorticity_as_it_does_a_sphere(aspect):
    packing = pm.Packing([[2.0] * 3], [0.5], pm.Box.cubic(4.0, 3), shapes=pm.Spheroids([aspect], [[0.0, 0.0, 1.0]]))
    scene = pm.Scene(packing, (*REPULSION, pm.BackgroundDamping(0.5)))
    # it also flies along its axis
    end = pm.ramp_strain(scene, rate=0.1, applied_strain=0.2, dt=0.005, velocity_nd=[[0.0, 0.0, 0.3]])
    # half the vorticity of v_x = rate y
    assert end.spin_nk[0] == pytest.approx([0.0, 0.0, -0.05 * (1.0 - np.exp(-0.5 * end.time_t[-1]))], abs=1e-7)


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_pair_that_sticks_is_followed_to_second_order_spring_and_all(damping):
    ends = []
    for dt in (0.02, 0.01, 0.005):
        end = run(pair(), rough(10.0, damping), dt=dt)
        assert end.trace.contacts_t[-1] == 1 and not end.trace.sliding_t.any()
        there = end.packing
        moved = (there.position_nd, there.shapes.director_nd, end.spin_nk)
        ends.append((np.concatenate(moved).ravel(), there.tangential.displacement_ck[0]))
    for one, two, three in zip(*ends, strict=True):
        assert np.abs(one - two).max() / np.abs(two - three).max() == pytest.approx(4.0, rel=0.05)


def test_a_pair_that_sticks_keeps_its_energy_to_second_order():
    error = []
    for dt in (0.02, 0.01, 0.005):
        trace = run(pair(), rough(10.0), dt=dt).trace
        total = trace.energy_t + trace.kinetic_t
        error.append(np.abs(total - total[0]).max())
        assert trace.tangential_t[-1] > 1e-4
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.1) and error[1] / error[2] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("coefficient", [0.03, 0.1])
def test_what_slides_loses_energy_and_gains_none(coefficient):
    lost = []
    for dt in (0.004, 0.002):
        trace = run(pair(), rough(coefficient), dt=dt, **RUBBING).trace
        total = trace.energy_t + trace.kinetic_t
        assert trace.sliding_t.any() and np.diff(total).max() < 1e-6
        lost.append(total[0] - total[-1])
    assert lost[1] > 1e-3 and lost[0] == pytest.approx(lost[1], rel=0.01)


@pytest.mark.parametrize("effects", [rough(0.3, 0.1), (*rough(10.0), pm.ContactDamping(0.2))])
def test_angular_momentum_of_a_pair_is_conserved(effects):
    packing = pair()
    trace = run(packing, effects, duration=2.0).trace
    momentum = trace.angular_momentum_tk
    orbital = packing.mass_n[:, None] * np.cross(packing.position_nd, VELOCITY)
    assert np.abs(momentum[0] - (orbital + angular_momentum(packing, SPIN)).sum(axis=0)).max() < 1e-14
    # about the corner of the box, far from the pair
    assert np.abs(momentum - momentum[0]).max() < 1e-13 * np.abs(orbital).sum()


def test_the_motion_turns_with_all_of_space():
    effects = (*rough(0.3, 0.1), pm.ContactDamping(0.2))
    plain, other = run(pair(), effects), run(pair(TURN), effects, turn=TURN)
    assert plain.trace.sliding_t.any()
    assert np.abs(other.packing.position_nd - 5.0 - (plain.packing.position_nd - 5.0) @ TURN.T).max() < 1e-13
    assert np.abs(other.packing.shapes.director_nd - plain.packing.shapes.director_nd @ TURN.T).max() < 1e-13
    assert np.abs(other.spin_nk - plain.spin_nk @ TURN.T).max() < 1e-12
    spring, turned = (one.packing.tangential.displacement_ck for one in (plain, other))
    assert np.abs(turned - spring @ TURN.T).max() < 1e-13


def test_a_spring_turns_with_a_pair_that_turns_as_a_whole():
    held = run(pair(), rough(10.0)).packing
    center = (held.mass_n[:, None] * held.position_nd).sum(axis=0) / held.mass_n.sum()
    rate = np.array([0.3, -0.5, 0.4])
    # too soft to push, so that only the springs' own way of turning is seen
    soft = (pm.Repulsion(law=pm.Harmonic(energy_scale=1e-9)), pm.Friction(coefficient=1e9, stiffness=1e-9, damping=0.0))
    start = {"velocity_nd": np.cross(rate, held.position_nd - center), "spin_nk": np.tile(rate, (2, 1))}
    size, spring = np.linalg.norm(rate), held.tangential.displacement_ck[0]
    gone = []
    for time in (0.008, 0.004):
        end = run(held, soft, dt=time, duration=time, **start).packing
        expected = rotated(spring, rate / size, time * size)
        gone.append(np.abs(end.tangential.displacement_ck[0] - expected).max())
    # what flies straight on leaves the circle by the square of the time
    assert gone[0] / gone[1] == pytest.approx(4.0, rel=0.1)
    assert gone[1] < 1e-2 * np.abs(expected - spring).max()


def test_aspect_one_rubs_as_spheres_do_and_nearly_round_ones_nearly_so():
    start = pm.random_packing(30, dimension=3, packing_fraction=0.7, seed=2)
    plain = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-8).packing
    director = np.random.default_rng(1).normal(size=(30, 3))
    motion = np.random.default_rng(3).normal(size=(2, 30, 3))
    effects = (*rough(0.4, 0.1), pm.BackgroundDamping(0.1))

    def end(packing):
        found = run(packing, effects, dt=0.02, duration=2.0, velocity_nd=0.05 * motion[0], spin_nk=0.1 * motion[1])
        assert found.trace.sliding_t.any()
        return np.hstack([found.packing.position_nd, found.spin_nk])

    spheres = end(plain)
    away = [
        np.abs(end(plain.replace(shapes=pm.Spheroids(np.full(30, aspect), director))) - spheres).max()
        for aspect in (1.0, 1.0001, 1.001)
    ]
    assert away[0] < 1e-12
    assert 0.0 < away[1] < 0.2 * away[2] < 0.02


def test_overall_stress_is_the_virial_of_what_moves_and_rubs():
    # V sigma less the integral of u u = -(1/2) d2/dt2 of that of x x, over the matter of an isolated pair
    packing, dt = pair(), 0.01
    trace = run(packing, rough(0.5), dt=dt, duration=0.3, trace_positions=True).trace
    along, across = (one[:, None, None] ** 2 for one in packing.shapes.semi_axes(packing.radius_n))
    mass = packing.mass_n[:, None, None]
    spread, stirred = [], []
    for position, director, spin in zip(trace.position_tnd, trace.orientation_tnq, trace.spin_tnk, strict=True):
        own = 0.2 * mass * ((along - across) * director[:, :, None] * director[:, None, :] + across * np.eye(3))
        spread.append((mass * position[:, :, None] * position[:, None, :] + own).sum(axis=0))
        velocity = np.cross(spin[:, None], np.eye(3)[None])
        stirred.append(np.einsum("nxa,nxy,nyb->ab", velocity, own, velocity))
    spread = np.array(spread)
    second = (spread[2:] - 2.0 * spread[1:-1] + spread[:-2]) / dt**2
    sums = packing.box.volume * (trace.overall_stress_tdd + trace.kinetic_stress_tdd) - np.array(stirred)
    assert np.abs(sums[1:-1] + 0.5 * second).max() < 2e-4 * np.abs(sums).max()
    # the part of the turns is seen, and symmetric with the others
    assert np.abs(packing.box.volume * trace.spin_stress_tdd).max() > 1e-2 * np.abs(sums).max()
    assert np.abs(trace.overall_stress_tdd - trace.overall_stress_tdd.transpose(0, 2, 1)).max() < 1e-15


def test_a_checkpoint_threads_and_files_change_nothing(tmp_path):
    start = pm.random_packing(40, dimension=3, packing_fraction=0.68, seed=1, shapes=pm.Ellipses(1.6))
    packing = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6).packing
    motion = np.random.default_rng(3).normal(size=(2, 40, 3))
    scene, start = pm.Scene(packing, rough(0.4, 0.1)), {"velocity_nd": 0.05 * motion[0], "spin_nk": 0.1 * motion[1]}
    whole = pm.simulate(scene, steps=100, dt=0.02, **start)
    path = tmp_path / "run.npz"
    pm.simulate(scene, steps=45, dt=0.02, checkpoint=path, **start)
    again = pm.resume(path, scene, steps=100)
    assert again.packing == whole.packing and np.array_equal(again.spin_nk, whole.spin_nk)
    assert pm.simulate(scene, steps=100, dt=0.02, threads=2, **start).packing == whole.packing
    half = pm.simulate(scene, steps=50, dt=0.02, **start)
    pm.write_packing(half.packing, tmp_path / "half.npz")
    rest = scene.replace(packing=pm.read_packing(tmp_path / "half.npz"))
    end = pm.simulate(rest, steps=50, dt=0.02, velocity_nd=half.velocity_nd, spin_nk=half.spin_nk)
    assert np.abs(end.packing.position_nd - whole.packing.position_nd).max() < 1e-6


@pytest.mark.parametrize("d", [2, 3])
def test_forces_of_pairs_make_up_the_stress(d):
    start = pm.random_packing(
        24, dimension=d, packing_fraction=0.9 if d == 2 else 0.68, seed=1, shapes=pm.Ellipses(1.6)
    )
    packing = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6).packing
    rng = np.random.default_rng(3)
    velocity, spin = 0.1 * rng.normal(size=(24, d)), 0.1 * rng.normal(size=(24, 1 if d == 2 else 3))
    engine = build_engine(pm.Scene(packing, rough(0.4, 0.1)), dt=0.02, velocity_nd=velocity, spin_nk=spin)
    engine.advance(20)
    found = pair_forces(engine)
    row = engine.observe()
    sums = np.einsum("ka,kb->ab", found.force_kd, found.branch_kd)
    assert len(found.i_k) == row[CONTACTS] > 24
    assert np.abs(sums - row[FORCE : FORCE + 9].reshape(3, 3)[:d, :d]).max() < 1e-13
