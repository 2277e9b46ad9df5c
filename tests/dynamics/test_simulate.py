"""Facts about time-stepped dynamics without links: order, conservation, time step, stress, and how runs end."""

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine

REPULSION = (pm.Repulsion(),)
METHODS = (pm.VelocityVerlet(), pm.SemiImplicitEuler())


def pair_scene(distance, *effects, radius=0.5, mass=1.0):
    position, masses = [[4.0, 5.0], [4.0 + distance, 5.0]], [mass, mass]
    packing = pm.Packing(position, [radius, radius], pm.Box.cubic(10.0, 2), mass_n=masses)
    return pm.Scene(packing, effects)


@pytest.fixture(scope="module")
def jammed():
    packing = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    return pm.quench(pm.Scene(packing, REPULSION), force_tolerance=1e-11).packing


def pushed(packing, seed=3):
    """Return a scene slightly out of balance with the same contacts, and velocities."""
    rng = np.random.default_rng(seed)
    shape = packing.position_nd.shape
    moved = packing.replace(position_nd=packing.position_nd + 1e-6 * rng.standard_normal(shape))
    return moved, 1e-6 * rng.standard_normal(shape)


def errors(packing, effects, method, powers):
    moved, velocity = pushed(packing)
    scene = pm.Scene(moved, effects)

    def end(dt, method):
        run = pm.simulate(scene, duration=4.0, dt=dt, velocity_nd=velocity, method=method)
        return np.concatenate([run.packing.position_nd - packing.position_nd, run.velocity_nd])

    fine = end(2.0**-11, pm.VelocityVerlet())
    error = [np.abs(end(2.0**-k, method) - fine).max() for k in powers]
    return np.divide(error[:-1], error[1:])


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_velocity_verlet_has_order_two_with_fixed_contacts(jammed, damping):
    effects = (pm.Repulsion(), pm.ContactDamping(damping))[: 1 + (damping > 0)]
    assert np.allclose(errors(jammed, effects, pm.VelocityVerlet(), (4, 5, 6, 7)), 4.0, atol=0.2)


def test_semi_implicit_euler_has_order_one(jammed):
    assert np.allclose(errors(jammed, REPULSION, pm.SemiImplicitEuler(), (5, 6, 7, 8)), 2.0, atol=0.1)


def test_damped_pair_follows_its_closed_form_to_second_order():
    stiffness, damping, overlap, duration = 2.0, 0.4, 0.1, 0.6
    scene = pair_scene(1.0 - overlap, pm.Repulsion(law=pm.Harmonic(stiffness)), pm.ContactDamping(damping))
    # the reduced mass is 1/2
    decay, frequency = damping, np.sqrt(2.0 * stiffness - damping**2)
    phase = frequency * duration
    expected = overlap * np.exp(-decay * duration) * (np.cos(phase) + decay / frequency * np.sin(phase))
    error = []
    for dt in duration / 2.0 ** np.arange(6, 11):
        run = pm.simulate(scene, duration=duration, dt=dt)
        error.append(abs(1.0 - np.diff(run.packing.position_nd[:, 0])[0] - expected))
    assert np.allclose(np.divide(error[:-1], error[1:]), 4.0, atol=0.2)


def test_colliding_pair_leaves_with_the_speed_it_came_with():
    run = pm.simulate(pair_scene(1.1, *REPULSION), duration=8.0, dt=1e-3, velocity_nd=[[0.1, 0.0], [-0.1, 0.0]])
    assert run.velocity_nd == pytest.approx(np.array([[-0.1, 0.0], [0.1, 0.0]]), abs=1e-6)


@pytest.fixture(scope="module")
def long_run(jammed):
    return pm.simulate(
        pm.Scene(jammed, REPULSION), steps=100_000, temperature=1e-4, seed=1, trace_every=100, trace_positions=True
    )


def test_energy_does_not_drift_over_1e5_steps_with_fixed_contacts(jammed):
    run = pm.simulate(pm.Scene(jammed, REPULSION), steps=100_000, temperature=1e-12, seed=1, trace_every=100)
    assert np.ptp(run.trace.contacts_t) == 0
    # what was put in, and not the energy of the packing at rest, is what a drift is measured by
    energy = (run.trace.energy_t + run.trace.kinetic_t) / run.trace.kinetic_t[0]
    tenths = [part.mean() for part in np.array_split(energy, 10)]
    assert np.ptp(energy) < 2e-3
    assert np.ptp(tenths) < 0.1 * np.ptp(energy)


def test_energy_drifts_by_little_over_1e5_steps_though_contacts_open_and_close(long_run):
    trace = long_run.trace
    energy = trace.energy_t + trace.kinetic_t
    assert np.ptp(trace.contacts_t) > 5
    assert np.ptp(energy) < 2e-3 * trace.kinetic_t[0]


def test_momentum_holds_to_rounding_over_1e5_steps(long_run):
    assert long_run.momentum_error < 1e-13


def test_kinetic_stress_is_twice_the_kinetic_energy_over_volume(long_run):
    trace = long_run.trace
    volume = long_run.packing.box.volume
    trace_t = np.trace(trace.kinetic_stress_tdd, axis1=1, axis2=2)
    assert np.allclose(trace_t, -2.0 * trace.kinetic_t / volume, rtol=1e-12)


def test_stress_and_energy_are_those_of_the_packing(long_run):
    for t in (0, 500, 1000):
        scene = pm.Scene(long_run.packing.replace(position_nd=long_run.trace.position_tnd[t]), REPULSION)
        assert long_run.trace.stress_tdd[t] == pytest.approx(pm.stress_tensor(scene), rel=1e-11, abs=1e-15)
        assert long_run.trace.energy_t[t] == pytest.approx(pm.energy(scene), rel=1e-11)


def test_figures_do_not_depend_on_the_velocity_of_the_frame(jammed):
    velocity = 1e-2 * np.random.default_rng(1).standard_normal(jammed.position_nd.shape)
    scene = pm.Scene(jammed, (pm.Repulsion(), pm.ContactDamping(0.2)))
    one, two = (
        pm.simulate(scene, steps=400, velocity_nd=velocity + v, trace_every=40)
        for v in (np.zeros(2), np.array([0.3, -0.2]))
    )
    for name in ("stress_tdd", "kinetic_stress_tdd", "energy_t"):
        a, b = getattr(one.trace, name), getattr(two.trace, name)
        assert np.abs(a - b).max() < 1e-10 * np.abs(a).max()


def test_reversed_velocities_lead_back_to_the_start(jammed):
    there = pm.simulate(pm.Scene(jammed, REPULSION), steps=1000, temperature=1e-4, seed=1)
    back = pm.simulate(pm.Scene(there.packing, REPULSION), steps=1000, velocity_nd=-there.velocity_nd)
    assert np.abs(there.packing.position_nd - jammed.position_nd).max() > 1e-2
    assert np.abs(back.packing.position_nd - jammed.position_nd).max() < 1e-11


def test_dashpots_count_in_the_stress():
    damping, speed = 0.3, 0.1
    scene = pair_scene(0.9, pm.Repulsion(), pm.ContactDamping(damping))
    run = pm.simulate(scene, steps=1, velocity_nd=[[speed, 0.0], [-speed, 0.0]], trace_every=1)
    expected = -(0.1 + damping * 2.0 * speed) * 0.9 / 100.0
    assert run.trace.stress_tdd[0] == pytest.approx(np.diag([expected, 0.0]), rel=1e-12, abs=1e-18)


def test_damped_motion_ends_at_rest(jammed):
    moved, velocity = pushed(jammed)
    run = pm.simulate(pm.Scene(moved, (pm.Repulsion(), pm.ContactDamping(0.5))), duration=400.0, velocity_nd=velocity)
    assert np.abs(run.velocity_nd - run.velocity_nd.mean(axis=0)).max() < 1e-9
    assert run.energy_drift < 0.0


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
def test_same_seed_gives_the_same_bits_whatever_is_traced(jammed, method):
    scene = pm.Scene(jammed, REPULSION)
    runs = [
        pm.simulate(scene, steps=3000, temperature=1e-3, seed=5, method=method, trace_every=n, trace_positions=True)
        for n in (None, 11, 1000)
    ]
    for one in runs[1:]:
        assert np.array_equal(one.packing.position_nd, runs[0].packing.position_nd)
        assert np.array_equal(one.velocity_nd, runs[0].velocity_nd)


def test_temperature_is_met_exactly_and_momentum_is_zero(jammed):
    run = pm.simulate(pm.Scene(jammed, REPULSION), steps=1, temperature=2e-3, seed=1, trace_every=1)
    assert run.trace.kinetic_t[0] == pytest.approx(0.5 * 2 * 47 * 2e-3, rel=1e-12)
    assert np.abs(run.trace.momentum_td).max() < 1e-14


def test_time_step_is_a_fraction_of_the_root_of_mass_over_stiffness_whatever_the_amplitude():
    stiffness, mass, fraction = 7.0, 3.0, 0.02
    for distance in (0.8, 0.99, 1.5):
        scene = pair_scene(distance, pm.Repulsion(law=pm.Harmonic(stiffness)), mass=mass)
        run = pm.simulate(scene, steps=1, method=pm.VelocityVerlet(fraction))
        assert run.dt == pytest.approx(fraction * np.sqrt(mass / stiffness), rel=1e-14)


def test_time_step_is_a_fraction_of_mass_over_damping_where_that_is_shorter():
    run = pm.simulate(pair_scene(0.9, pm.Repulsion(), pm.ContactDamping(50.0)), steps=1)
    assert run.dt == pytest.approx(0.05 / 50.0, rel=1e-12)


def test_duration_is_covered_in_equal_steps_no_longer_than_dt():
    run = pm.simulate(pair_scene(0.9, *REPULSION), duration=1.0, dt=0.3, trace_every=1)
    assert (run.steps, run.dt) == (4, 0.25)
    assert run.trace.time_t.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_a_step_beyond_stability_is_named_and_the_last_good_state_returned(jammed):
    scene = pm.Scene(jammed, REPULSION)
    with pytest.raises(pm.NotConverged, match="time step is too long") as caught:
        pm.simulate(scene, steps=5000, dt=2.5, temperature=1e-6, seed=1)
    run = caught.value.run
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    assert np.isfinite(run.packing.position_nd).all()
    assert pm.simulate(scene, steps=5000, dt=0.5, temperature=1e-6, seed=1).outcome is pm.Outcome.FINISHED


def test_one_over_the_stability_limit_of_a_pair_grows_and_one_below_does_not():
    # a particle between two images of itself does not move; a pair in contact from both sides is a spring for good
    packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box(np.diag([1.8, 5.0])), mass_n=[1.0, 1.0])
    scene = pm.Scene(packing, (pm.Repulsion(),))
    velocity = 1e-6 * np.array([[1.0, 0.0], [-1.0, 0.0]])
    # two springs of stiffness 1 on the reduced mass 1/2
    limit = 2.0 / np.sqrt(2.0 * 1.0 / 0.5)
    below = pm.simulate(scene, steps=3000, dt=0.99 * limit, velocity_nd=velocity)
    assert below.ok and np.abs(below.packing.position_nd - packing.position_nd).max() < 1e-4
    above = pm.simulate(scene, steps=3000, dt=1.01 * limit, velocity_nd=velocity, check=False)
    assert above.outcome is pm.Outcome.STEP_TOO_LONG


def test_coincident_particles_part_and_turn_their_energy_into_motion():
    run = pm.simulate(pair_scene(0.0, *REPULSION), duration=8.0, trace_every=1)
    assert run.trace.energy_t[0] == 0.5 and run.trace.energy_t[-1] == 0.0
    assert run.trace.kinetic_t[-1] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("ratio", [10.0, 1000.0])
def test_broad_mixtures_stay_stable_at_the_chosen_step(ratio):
    packing = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(ratio=ratio), packing_fraction=0.7, seed=1)
    run = pm.simulate(pm.Scene(packing, REPULSION), steps=3000)
    assert abs(run.energy_drift) < 1e-3


def test_one_particle_flies_on():
    packing = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(4.0, 2))
    run = pm.simulate(pm.Scene(packing, REPULSION), steps=4000, dt=0.01, velocity_nd=[[1.0, -3.0]])
    assert run.packing.position_nd == pytest.approx(np.array([[41.0, -119.0]]), rel=1e-12)


def test_a_time_limit_is_an_outcome(jammed):
    run = pm.simulate(pm.Scene(jammed, REPULSION), steps=10**9, temperature=1e-4, seed=1, time_limit=0.1, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert 0 < run.steps < 10**9


def test_a_scene_without_links_has_none_of_their_arrays(jammed):
    engine = build_engine(pm.Scene(jammed, REPULSION), dt=0.1, velocity_nd=np.zeros((48, 2)))
    assert engine.space.links is None and engine.rattle is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "steps must be an integer at least 1 .or give duration., got None"),
        ({"steps": 1, "duration": 1.0}, "duration must be left out"),
        ({"steps": 1, "temperature": 1.0}, "seed must be an integer"),
        ({"steps": 1, "temperature": 1.0, "seed": 1, "velocity_nd": np.zeros((2, 2))}, "temperature must be left out"),
        ({"steps": 1, "method": pm.Fire()}, "method must be VelocityVerlet"),
    ],
)  # fmt: skip
def test_arguments_that_do_not_go_together_are_named(arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.simulate(pair_scene(0.9, *REPULSION), **arguments)


def speed_words(run):
    """Return what the report of a run says of how fast it ended."""
    return [words for words in run.rows() if words[0] in ("velocity", "speed")]


def test_a_falling_ball_ends_with_the_velocity_of_free_fall():
    ball = pm.Packing([[2.0, 3.0]], [0.5], pm.Box.cubic(4.0, 2), mass_n=[3.0])
    scene = pm.Scene(ball, (pm.Repulsion(), pm.Gravity(0.0, -2.0)))
    run = pm.simulate(scene, duration=0.25, velocity_nd=[[0.5, 0.0]], trace_every=10)
    ((name, value, note),) = speed_words(run)
    assert (name, value) == ("velocity", "0.5  -0.5")
    # m v^2 / 2
    assert "kinetic energy 0.75 [energy]" in note
    assert run.to_dict()["velocity"] == pytest.approx([0.5, -0.5], abs=1e-12)
    still = pm.simulate(scene.without(pm.Gravity), duration=0.25)
    assert not speed_words(still)


def test_the_speed_of_several_particles_is_a_mean_over_those_that_move():
    start = pm.Packing([[1.0, 1.0], [3.0, 3.0], [5.0, 5.0]], [0.5] * 3, pm.Box.cubic(8.0, 2))
    scene = pm.Scene(start, (pm.Repulsion(), pm.FixedParticles((2,))))
    run = pm.simulate(scene, duration=0.1, velocity_nd=[[0.3, 0.4], [0.0, 0.1], [0.0, 0.0]])
    ((name, value, note),) = speed_words(run)
    # sqrt((0.5^2 + 0.1^2) / 2)
    assert name == "speed" and float(value) == pytest.approx(0.13**0.5, rel=1e-5)
    assert "of the 2 that move, 0.5 the largest" in note


def test_the_speed_is_that_of_what_is_not_held_and_a_single_one_of_many_is_named():
    start = pm.Packing([[1.0, 1.0], [3.0, 3.0], [5.0, 5.0]], [0.5] * 3, pm.Box.cubic(8.0, 2))
    scene = pm.Scene(start, (pm.Repulsion(), pm.FixedParticles((2,), velocity=(3.0, 0.0))))
    two = pm.simulate(scene, duration=0.1, velocity_nd=[[0.3, 0.4], [0.0, 0.1], [0.0, 0.0]])
    assert "of the 2 that move, 0.5 the largest" in speed_words(two)[0][2]
    one = pm.simulate(scene, duration=0.1, velocity_nd=[[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]])
    ((name, value, note),) = speed_words(one)
    assert (name, value) == ("velocity", "0  0.1") and note.startswith("of particle 1, the only one")
    assert one.held_n.tolist() == [False, False, True]
    assert not speed_words(pm.simulate(scene, duration=0.1))
    held = pm.simulate(
        scene, duration=0.1, velocity_nd=[[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]], held_n=[False, True, False]
    )
    assert not speed_words(held)
