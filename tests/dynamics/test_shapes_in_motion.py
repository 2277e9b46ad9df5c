"""Ellipses and spheroids in time: orders of convergence, what is conserved, and discs as their limit."""

import numpy as np
import pytest

import packmech as pm

REPULSION = (pm.Repulsion(),)
ROUGH = (pm.Repulsion(), pm.Friction(coefficient=0.4, stiffness=0.7, damping=0.0))


def crowd(d, count=24, aspect=1.6, seed=1):
    start = pm.random_packing(
        count, dimension=d, packing_fraction=0.9 if d == 2 else 0.68, seed=seed, shapes=pm.Ellipses(aspect)
    )
    return pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6).packing


def motion(packing, size=0.02, seed=0):
    rng = np.random.default_rng(seed)
    velocity = size * rng.normal(size=packing.position_nd.shape)
    spin = size * rng.normal(size=(packing.particles, 1 if packing.dimension == 2 else 3))
    if packing.dimension == 3:
        director = packing.shapes.director_nd
        spin -= (spin * director).sum(axis=1, keepdims=True) * director
    mass = packing.mass_n[:, None]
    return {"velocity_nd": velocity - (mass * velocity).sum(axis=0) / mass.sum(), "spin_nk": spin}


# both turn one way, so that they rub
RUBBING = {"spin_nk": [[0.8], [0.8]]}


def pair(d, angle=0.0, aspects=(1.8, 0.6)):
    """Return two particles that overlap askew, far from their images, turned in the plane by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(d)
    turn[:2, :2] = [[c, -s], [s, c]]
    place = np.zeros((2, d))
    place[1, :2] = 0.75, 0.3
    director = np.zeros((2, d))
    director[:, :2] = [[0.8, 0.6], [0.1, 1.0]]
    director[:, d - 1] += 0.3
    shapes = pm.Spheroids(np.array(aspects), director @ turn.T)
    return pm.Packing(place @ turn.T + 5.0, [0.5, 0.45], pm.Box.cubic(10.0, d), shapes=shapes)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_is_conserved_to_second_order_and_starts_as_the_static_one(d):
    packing = crowd(d)
    scene, start = pm.Scene(packing, REPULSION), motion(packing)
    error = []
    for dt in (0.04, 0.02, 0.01):
        run = pm.simulate(scene, duration=2.0, dt=dt, trace_every=1, **start)
        energy = run.trace.energy_t + run.trace.kinetic_t
        error.append(np.abs(energy - energy[0]).max())
        assert run.momentum_error < 1e-13
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.15) and error[1] / error[2] == pytest.approx(4.0, rel=0.15)
    assert run.trace.energy_t[0] == pytest.approx(pm.energy(scene), rel=1e-12)
    assert np.abs(run.trace.stress_tdd[0] - pm.stress_tensor(scene)).max() < 1e-13
    end = scene.replace(packing=run.packing)
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(end), rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_a_free_particle_turns_at_its_spin(d):
    packing = pm.Packing(
        [[2.0] * d], [0.5], pm.Box.cubic(4.0, d), shapes=pm.Spheroids([2.0], [[1.0] + [0.0] * (d - 1)])
    )
    spin = [[0.7]] if d == 2 else [[0.0, 0.0, 0.7]]
    run = pm.simulate(pm.Scene(packing, REPULSION), duration=3.0, dt=0.01, spin_nk=spin)
    expected = np.zeros(d)
    expected[:2] = np.cos(2.1), np.sin(2.1)
    assert np.abs(run.packing.shapes.director_nd[0] - expected).max() < 1e-13
    assert np.array_equal(run.spin_nk, spin)


@pytest.mark.parametrize(
    ("d", "effects"), [(2, REPULSION), (2, ROUGH), (3, REPULSION), (2, (*ROUGH, pm.ContactDamping(0.2)))]
)
def test_angular_momentum_of_a_pair_is_conserved(d, effects):
    packing = pair(d)
    run = pm.simulate(pm.Scene(packing, effects), duration=4.0, dt=0.02, trace_every=1, **motion(packing, 0.1))
    momentum = run.trace.angular_momentum_tk
    scale = float(np.abs(momentum).max()) + float((packing.mass_n * packing.radius_n**2).sum())
    assert np.abs(momentum - momentum[0]).max() < 1e-13 * scale
    # they bounced
    assert run.trace.contacts_t[0] == 1 and np.ptp(run.trace.energy_t) > 1e-3


@pytest.mark.parametrize("coefficient", [10.0, 0.3])
def test_a_frictional_pair_is_followed_to_second_order(coefficient):
    packing = pair(2)
    effects = (pm.Repulsion(), pm.Friction(coefficient=coefficient, stiffness=0.7, damping=0.1))
    scene, ends = pm.Scene(packing, effects), []
    for dt in (0.02, 0.01, 0.005):
        run = pm.simulate(scene, duration=0.6, dt=dt, trace_every=1, **RUBBING)
        assert run.trace.contacts_t[-1] == 1
        assert (run.trace.sliding_t.max() == 1) == (coefficient < 1.0)
        ends.append(np.concatenate([run.packing.position_nd.ravel(), run.packing.shapes.director_nd.ravel()]))
    ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
    # a contact that begins to slide within a step costs some of the order
    assert ratio == pytest.approx(4.0, rel=0.1 if coefficient > 1.0 else 0.4)


def test_friction_takes_energy_and_gives_none():
    packing = pair(2)
    for coefficient in (0.1, 0.3, 100.0):
        lost = []
        for dt in (0.004, 0.002):
            effects = (pm.Repulsion(), pm.Friction(coefficient=coefficient, stiffness=0.7, damping=0.0))
            run = pm.simulate(pm.Scene(packing, effects), duration=0.6, dt=dt, trace_every=1, **RUBBING)
            assert run.trace.contacts_t[-1] == 1
            # energy_t holds the tangential springs', kinetic_t the spins'
            total = run.trace.energy_t + run.trace.kinetic_t
            assert np.diff(total).max() < 1e-6
            lost.append(total[0] - total[-1])
        # what a sliding contact takes does not depend on the step; one that sticks takes nothing
        assert lost[1] > 1e-3 if coefficient < 1.0 else abs(lost[1]) < 1e-6
        assert lost[0] == pytest.approx(lost[1], rel=0.01, abs=2e-6)


def test_the_motion_turns_with_the_pair():
    one, other = pair(2), pair(2, angle=0.8)
    c, s = np.cos(0.8), np.sin(0.8)
    turn = np.array([[c, -s], [s, c]])
    start = motion(one, 0.2)
    runs = [
        pm.simulate(pm.Scene(packing, ROUGH), duration=1.0, dt=0.01, velocity_nd=velocity, spin_nk=start["spin_nk"])
        for packing, velocity in ((one, start["velocity_nd"]), (other, start["velocity_nd"] @ turn.T))
    ]
    apart = runs[1].packing.position_nd - 5.0 - (runs[0].packing.position_nd - 5.0) @ turn.T
    assert np.abs(apart).max() < 1e-13
    assert np.abs(runs[1].packing.shapes.director_nd - runs[0].packing.shapes.director_nd @ turn.T).max() < 1e-13


@pytest.mark.parametrize(("d", "effects"), [(2, ROUGH), (3, REPULSION)])
def test_aspect_one_moves_as_discs_and_spheres_do(d, effects):
    start = pm.random_packing(30, dimension=d, packing_fraction=0.9 if d == 2 else 0.7, seed=2)
    plain = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-8).packing
    shaped = plain.replace(shapes=pm.Spheroids(np.ones(30), np.random.default_rng(1).normal(size=(30, d))))
    velocity = 0.05 * np.random.default_rng(3).normal(size=plain.position_nd.shape)
    one, other = (
        pm.simulate(pm.Scene(packing, effects), duration=2.0, dt=0.02, velocity_nd=velocity)
        for packing in (plain, shaped)
    )
    assert np.abs(one.packing.position_nd - other.packing.position_nd).max() < 1e-12
    assert one.trace is None or one.trace == other.trace
    if d == 2:
        assert np.abs(one.spin_nk - other.spin_nk).max() < 1e-12


@pytest.mark.parametrize("d", [2, 3])
def test_overall_stress_is_the_virial_of_what_moves(d):
    # V sigma less the integral of u u = -(1/2) d2/dt2 of that of x x, over the matter of an isolated pair
    packing = pair(d)
    dt = 0.01
    start = motion(packing, 0.3)
    run = pm.simulate(pm.Scene(packing, REPULSION), duration=0.4, dt=dt, trace_every=1, trace_positions=True, **start)
    trace = run.trace
    along, across = packing.shapes.semi_axes(packing.radius_n)
    share = 0.25 if d == 2 else 0.2
    whole, stirred = [], []
    kept = zip(trace.position_tnd, trace.orientation_tnq, trace.spin_tnk, strict=True)
    for position, director, spin in kept:
        own = share * (
            (along**2 - across**2)[:, None, None] * director[:, :, None] * director[:, None, :]
            + (across**2)[:, None, None] * np.eye(d)
        )
        # rotation stirs the matter of each about its center
        rate = np.zeros((2, 3))
        rate[:, 3 - spin.shape[1] :] = spin
        velocity = np.cross(np.eye(3)[None, :d], rate[:, None]) * -1.0
        stirred.append(
            (packing.mass_n[:, None, None] * np.einsum("nxa,nxy,nyb->nab", velocity, own, velocity)).sum(axis=0)[:d, :d]
        )
        whole.append((packing.mass_n[:, None, None] * (position[:, :, None] * position[:, None, :] + own)).sum(axis=0))
    whole = np.array(whole)
    second = (whole[2:] - 2.0 * whole[1:-1] + whole[:-2]) / dt**2
    sums = packing.box.volume * (trace.overall_stress_tdd + trace.kinetic_stress_tdd)[1:-1] - np.array(stirred)[1:-1]
    assert np.abs(sums + 0.5 * second).max() < 1e-3 * np.abs(sums).max()
    # the part of the turns is seen
    assert np.abs(packing.box.volume * trace.spin_stress_tdd).max() > 1e-2 * np.abs(sums).max()


def test_a_checkpoint_and_threads_change_no_bit(tmp_path):
    packing = crowd(2, count=60)
    scene, start = pm.Scene(packing, ROUGH), motion(packing, 0.1)
    whole = pm.simulate(scene, steps=200, dt=0.02, **start)
    path = tmp_path / "run.npz"
    pm.simulate(scene, steps=90, dt=0.02, checkpoint=path, trace_every=30, trace_positions=True, **start)
    again = pm.resume(path, scene, steps=200)
    assert again.packing == whole.packing and np.array_equal(again.spin_nk, whole.spin_nk)
    assert again.trace.orientation_tnq.shape == (len(again.trace.step_t), 60, 2)
    for threads in (2, 3):
        assert pm.simulate(scene, steps=200, dt=0.02, threads=threads, **start).packing == whole.packing
    # the springs go on where a run is cut in two
    half = pm.simulate(scene, steps=100, dt=0.02, **start)
    assert len(half.packing.tangential) > 0
    pm.write_packing(half.packing, tmp_path / "half.npz")
    kept = scene.replace(packing=pm.read_packing(tmp_path / "half.npz"))
    rest = pm.simulate(kept, steps=100, dt=0.02, velocity_nd=half.velocity_nd, spin_nk=half.spin_nk)
    assert np.abs(rest.packing.position_nd - whole.packing.position_nd).max() < 1e-6


def test_drag_slows_spins_and_dashpots_bring_a_crowd_to_rest():
    packing = pm.Packing([[2.0, 2.0]], [0.5], pm.Box.cubic(4.0, 2), shapes=pm.Spheroids([2.0], [[1.0, 0.0]]))
    run = pm.simulate(
        pm.Scene(packing, (*REPULSION, pm.BackgroundDamping(0.5))), duration=2.0, dt=0.001, spin_nk=[[0.3]]
    )
    assert run.spin_nk[0, 0] == pytest.approx(0.3 * np.exp(-1.0), rel=1e-6)
    crowded = crowd(2)
    shaken = motion(crowded, 0.1)
    effects = (*REPULSION, pm.ContactDamping(0.5), pm.BackgroundDamping(0.2))
    calm = pm.simulate(pm.Scene(crowded, effects), duration=60.0, **shaken)
    assert np.abs(calm.velocity_nd).max() < 1e-2 * np.abs(shaken["velocity_nd"]).max()


def test_moduli_of_nearly_round_ellipses_go_to_those_of_discs():
    start = pm.random_packing(40, dimension=2, packing_fraction=0.86, seed=4)
    plain = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-12).packing
    effects = (*REPULSION, pm.Friction(coefficient=0.5, stiffness=0.7, damping=0.2), pm.ContactDamping(0.3))
    director = np.random.default_rng(1).normal(size=(40, 2))

    def moduli(packing):
        rest = pm.quench(pm.Scene(packing, REPULSION), force_tolerance=1e-12).packing
        run = pm.oscillatory_shear(
            pm.Scene(rest, effects), amplitude=1e-6, relative_frequency=0.05, periods=3, frames=2, dt=0.05
        )
        return np.array([run.moduli.storage, run.moduli.loss]), run

    discs, _ = moduli(plain)
    apart = []
    for aspect in (1.001, 1.0001):
        found, run = moduli(plain.replace(shapes=pm.Spheroids(np.full(40, aspect), director)))
        assert run.orientation_fnq.shape == (2, 40, 2)
        apart.append(np.abs(found - discs).max() / np.abs(discs).max())
    assert apart[1] < 0.3 * apart[0] < 0.3 * 0.2


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_forces_of_many_are_the_static_ones(d, threads):
    # so many that the loops deal with them in blocks, which push each other's particles
    packing = pm.random_packing(
        1500, dimension=d, packing_fraction=0.8 if d == 2 else 0.6, seed=2, shapes=pm.Ellipses(1.7)
    )
    scene, dt = pm.Scene(packing, REPULSION), 1e-7
    run = pm.simulate(scene, steps=1, dt=dt, method=pm.SemiImplicitEuler(), threads=threads)
    force, torque = pm.forces(scene), pm.torques(scene).reshape(1500, -1)
    inertia = packing.mass_n * packing.shapes.gyration(packing.radius_n) ** 2
    assert np.abs(run.velocity_nd * packing.mass_n[:, None] / dt - force).max() < 1e-12 * np.abs(force).max()
    assert np.abs(run.spin_nk * inertia[:, None] / dt - torque).max() < 1e-12 * np.abs(torque).max()
