"""Facts about rigid links in time-stepped dynamics: RATTLE."""

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm

REPULSION = (pm.Repulsion(),)
SIDE = 40.0


def free_scene(position_nd, links, *, radius=0.3, effects=REPULSION, mass_n=None):
    """Return a scene of few particles, of mass 1 unless given, in a box so large that they meet no image."""
    position = np.asarray(position_nd, dtype=float) + 0.5 * SIDE
    box = pm.Box.cubic(SIDE, position.shape[1])
    mass_n = np.ones(len(position)) if mass_n is None else mass_n
    return pm.Scene(pm.Packing(position, [radius] * len(position), box, links, mass_n), effects)


def chain_links(beads, dimension, lengths=1.0):
    one = np.arange(beads - 1)
    length = np.broadcast_to(lengths, beads - 1)
    return pm.Links(one, one + 1, np.zeros((beads - 1, dimension), dtype=int), length)


def tumbling_chain(beads, dimension, seed=0):
    """Return a chain with uneven masses in free flight: a pendulum of many arms without a pivot."""
    rng = np.random.default_rng(seed)
    step = np.eye(dimension)[0] + 0.5 * rng.standard_normal((beads - 1, dimension))
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    position = np.vstack([np.zeros(dimension), np.cumsum(step, axis=0)])
    velocity, mass = 0.5 * rng.standard_normal((beads, dimension)), rng.uniform(0.5, 2.0, beads)
    scene = free_scene(position, chain_links(beads, dimension), mass_n=mass)
    return scene, velocity - mass @ velocity / mass.sum(), mass


def rigid_trimers():
    shape = pm.cluster_packing(12, shape=pm.Trimer(), dimension=2, packing_fraction=0.85, seed=3)
    return pm.Scene(pm.quench(pm.Scene(shape, REPULSION), force_tolerance=1e-8).packing, REPULSION)


MASS, SPIN, LENGTH = np.array([1.0, 3.0]), 0.8, 1.25
REDUCED = MASS.prod() / MASS.sum()


def rotor():
    """Return a dimer, and the velocities with which it turns about a center at rest."""
    arm = LENGTH * np.array([-MASS[1], MASS[0]]) / MASS.sum()
    scene = free_scene(np.outer(arm, [1.0, 0.0]), chain_links(2, 2, LENGTH), mass_n=MASS)
    return scene, np.outer(SPIN * arm, [0.0, 1.0]), arm


def angular_momentum(position_nd, velocity_nd, mass_n):
    x, v = position_nd - 0.5 * SIDE, velocity_nd
    return float((mass_n * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum())


def test_rotor_follows_its_closed_form_to_second_order():
    scene, velocity, arm = rotor()
    duration = 5.0
    turned = np.outer(arm, [np.cos(SPIN * duration), np.sin(SPIN * duration)]) + 0.5 * SIDE
    error = []
    for dt in 2.0 ** -np.arange(3, 8):
        run = pm.simulate(scene, duration=duration, dt=dt, velocity_nd=velocity)
        error.append(np.abs(run.packing.position_nd - turned).max())
    assert np.allclose(np.divide(error[:-1], error[1:]), 4.0, atol=0.2)
    assert error[-1] < 2e-5


def test_tension_of_a_rotor_is_reduced_mass_times_spin_squared_times_length():
    scene, velocity, _ = rotor()
    run = pm.simulate(scene, steps=200, velocity_nd=velocity)
    assert run.tension_l == pytest.approx([REDUCED * SPIN**2 * LENGTH], rel=1e-13)


def test_stress_of_a_rotor_is_tension_along_the_link_and_kinetic_stress_across_it():
    scene, velocity, _ = rotor()
    run = pm.simulate(scene, steps=300, velocity_nd=velocity, trace_every=30, trace_positions=True)
    trace = run.trace
    vector = trace.position_tnd[:, 1] - trace.position_tnd[:, 0]
    along = vector / LENGTH
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    size = REDUCED * SPIN**2 * LENGTH**2 / SIDE**2
    assert np.allclose(trace.stress_tdd, size * np.einsum("ta,tb->tab", along, along), rtol=0, atol=1e-13 * size)
    expected = -size * np.einsum("ta,tb->tab", across, across)
    assert np.allclose(trace.kinetic_stress_tdd, expected, rtol=0, atol=1e-13 * size)


def test_link_forces_are_what_mass_times_acceleration_asks_for():
    scene, velocity, mass = tumbling_chain(6, 3)
    apart = []
    for dt in (1 / 64, 1 / 128, 1 / 256):
        manner = {"dt": dt, "velocity_nd": velocity, "trace_every": 1, "trace_positions": True}
        one, two = (pm.simulate(scene, steps=steps, **manner) for steps in (1, 2))
        acceleration = (two.velocity_nd - two.trace.velocity_tnd[0]) / (2.0 * dt)
        vector = np.diff(one.packing.position_nd, axis=0)
        pull = np.zeros((6, 3))
        pull[:-1] += one.tension_l[:, None] * vector
        pull[1:] -= one.tension_l[:, None] * vector
        apart.append(np.abs(mass[:, None] * acceleration - pull).max())
    assert np.allclose(np.divide(apart[:-1], apart[1:]), 4.0, atol=0.2)
    assert apart[-1] < 1e-3


@pytest.mark.parametrize(("beads", "dimension"), [(2, 3), (3, 2), (3, 3), (6, 2)])
def test_free_chains_converge_with_order_two(beads, dimension):
    scene, velocity, mass = tumbling_chain(beads, dimension)

    def end(dt):
        run = pm.simulate(scene, duration=2.0, dt=dt, velocity_nd=velocity)
        return np.concatenate([run.packing.position_nd, run.velocity_nd])

    fine = end(2.0**-12)
    error = [np.abs(end(2.0**-k) - fine).max() for k in (6, 7, 8, 9)]
    assert np.allclose(np.divide(error[:-1], error[1:]), 4.0, atol=0.2)


def test_links_and_contacts_together_converge_with_order_two():
    scene = rigid_trimers()
    velocity = 1e-6 * np.random.default_rng(2).standard_normal(scene.packing.position_nd.shape)

    def end(dt):
        return pm.simulate(scene, duration=4.0, dt=dt, velocity_nd=velocity).packing.position_nd

    fine = end(2.0**-9)
    error = [np.abs(end(2.0**-k) - fine).max() for k in (2, 3, 4, 5)]
    assert np.allclose(np.divide(error[:-1], error[1:]), 4.0, atol=0.2)


@pytest.fixture(scope="module")
def long_run():
    scene, velocity, mass = tumbling_chain(5, 2)
    run = pm.simulate(scene, steps=100_000, dt=1 / 64, velocity_nd=velocity, trace_every=100, trace_positions=True)
    return run, mass


def drift_over_its_error(effects, seeds=15):
    """Return the median change of energy of many chains over its standard error, found from the quartiles.

    Particles of a chain collide, and where its motion is chaotic rounding decides how: each collision takes or gives a
    little energy, a few in a tangle a lot. What drifts has a sign in most chains.
    """
    change = []
    for seed in range(seeds):
        scene, velocity, mass = tumbling_chain(5, 2, seed)
        scene = pm.Scene(scene.packing, effects)
        run = pm.simulate(scene, steps=100_000, dt=1 / 64, velocity_nd=velocity, trace_every=100)
        energy = run.trace.kinetic_t + run.trace.energy_t
        change.append((energy[-100:].mean() - energy[:100].mean()) / energy[0])
    low, middle, high = np.quantile(change, (0.25, 0.5, 0.75))
    # of a median of n normal numbers: 1.25 standard deviations over sqrt(n), one of them .74 of what quartiles span
    return abs(middle) / (1.25 * 0.74 * (high - low) / np.sqrt(seeds))


def test_energy_does_not_drift_over_1e5_steps(long_run):
    energy = long_run[0].trace.kinetic_t + long_run[0].trace.energy_t
    assert np.ptp(energy) < 4e-3 * energy[0]
    assert drift_over_its_error(REPULSION) < 3.0


def test_a_drag_that_takes_three_thousandths_of_the_energy_is_a_drift():
    assert drift_over_its_error((*REPULSION, pm.BackgroundDamping(1e-6))) > 6.0


def test_links_hold_to_1e_13_at_every_recorded_step(long_run):
    run, _ = long_run
    distance = np.linalg.norm(np.diff(run.trace.position_tnd, axis=1), axis=2)
    assert np.abs(distance - 1.0).max() <= 1e-13
    assert run.link_error <= 1e-13
    assert run.trace.link_error_t.max() == run.link_error


def test_velocities_stretch_no_link_at_any_recorded_step(long_run):
    trace = long_run[0].trace
    along = np.diff(trace.position_tnd, axis=1)
    assert np.abs((along * np.diff(trace.velocity_tnd, axis=1)).sum(axis=2)).max() < 1e-14


def test_momentum_and_angular_momentum_hold_to_rounding_over_1e5_steps(long_run):
    run, mass = long_run
    assert run.momentum_error < 1e-13
    trace = run.trace
    spin = [angular_momentum(x, v, mass) for x, v in zip(trace.position_tnd, trace.velocity_tnd, strict=True)]
    assert np.ptp(spin) < 1e-11 * abs(spin[0])


def test_reversed_velocities_lead_back_to_the_start():
    scene, velocity, mass = tumbling_chain(5, 3)
    there = pm.simulate(scene, steps=500, dt=1 / 64, velocity_nd=velocity)
    turned = pm.Scene(there.packing, REPULSION)
    back = pm.simulate(turned, steps=500, dt=1 / 64, velocity_nd=-there.velocity_nd)
    assert np.abs(there.packing.position_nd - scene.packing.position_nd).max() > 1.0
    assert np.abs(back.packing.position_nd - scene.packing.position_nd).max() < 1e-11


@pm.effect
class Spring(NamedTuple):
    """A spring between particles that touch: a bond where only bonded ones do."""

    stiffness: float = 1.0
    rest_length: float = 1.0

    # what touches at another distance than the rest length
    force_jumps = True

    def pair_energy(self, distance, contact_distance):
        """Return the energy."""
        return 0.5 * self.stiffness * (distance - self.rest_length) ** 2

    def pair_first(self, distance, contact_distance):
        """Return the pull."""
        return self.stiffness * (distance - self.rest_length)

    def pair_second(self, distance, contact_distance):
        """Return the stiffness."""
        return self.stiffness


@pytest.mark.parametrize("beads", [2, 3])
def test_a_bond_converges_to_the_link_as_one_over_its_stiffness(beads):
    angle = np.deg2rad([0.0, 50.0])[: beads - 1]
    position = np.vstack([[0.0, 0.0], np.cumsum(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0)])
    links = chain_links(beads, 2)
    linked = free_scene(position, links)
    random = 0.5 * np.random.default_rng(5).standard_normal((beads, 2))
    # along the links at the start
    velocity = pm.project_force(linked.packing, random).force_nd
    frames, duration = 50, 1.0
    reference = pm.simulate(
        linked, steps=64 * frames, dt=duration / (64 * frames), velocity_nd=velocity, trace_every=64,
        trace_positions=True,
    )  # fmt: skip
    stiffness = np.array([1e3, 1e4, 1e5])
    apart, stretch = [], []
    for k in stiffness:
        every = int(np.ceil(duration / frames / (0.05 / np.sqrt(k))))
        faint = pm.Repulsion(law=pm.Harmonic(energy_scale=1e-30))
        bonded = free_scene(position, None, radius=0.7, effects=(faint, Spring(k)), mass_n=np.ones(beads))
        run = pm.simulate(
            bonded, steps=every * frames, dt=duration / (every * frames), velocity_nd=velocity, trace_every=every,
            trace_positions=True,
        )  # fmt: skip
        apart.append(np.abs(run.trace.position_tnd - reference.trace.position_tnd).max())
        stretch.append(np.abs(np.linalg.norm(np.diff(run.trace.position_tnd, axis=1), axis=2) - 1.0).max())
    for value in (apart, stretch):
        assert np.polyfit(np.log(stiffness), np.log(value), 1)[0] == pytest.approx(-1.0, abs=0.05)


def test_redundant_links_hold_like_the_others():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    i, j = np.triu_indices(4, 1)
    links = pm.Links(i, j, np.zeros((6, 2), dtype=int), np.linalg.norm(square[j] - square[i], axis=1))
    scene = free_scene(square, links)
    run = pm.simulate(scene, steps=2000, velocity_nd=[[0.3, -0.1], [0.0, 0.4], [-0.2, 0.5], [0.1, 0.1]])
    assert run.packing.link_error < 1e-13
    assert abs(run.energy_drift) < 1e-12
    assert np.count_nonzero(run.tension_l == 0.0) == 1


def test_a_fast_dimer_keeps_its_link_through_many_cells():
    links = pm.Links([0], [1], [[1, 0]], [1.0])
    packing = pm.Packing([[2.6, 1.0], [0.6, 1.0]], [0.3, 0.3], pm.Box.cubic(3.0, 2), links)
    drift = np.array([2.0, -1.0])
    turning = 0.3 * np.array([[0.0, -1.0], [0.0, 1.0]])
    at_rest, flying = (
        pm.simulate(pm.Scene(packing, REPULSION), steps=5000, dt=0.02, velocity_nd=turning + v)
        for v in (np.zeros(2), drift)
    )
    assert flying.packing.link_error < 1e-13
    assert np.abs(flying.packing.position_nd).max() > 100.0
    moved = flying.packing.position_nd - 100.0 * drift
    assert np.abs(moved - at_rest.packing.position_nd).max() < 1e-10
    assert flying.tension_l == pytest.approx(at_rest.tension_l, rel=1e-11)


def test_random_velocities_along_links_have_the_temperature_and_no_momentum():
    scene = rigid_trimers()
    run = pm.simulate(scene, steps=1, temperature=1e-3, seed=4, trace_every=1, trace_positions=True)
    # a rigid trimer has three motions in a plane, and the center of all rests
    freedom = 3 * 12 - 2
    assert run.trace.kinetic_t[0] == pytest.approx(0.5 * freedom * 1e-3, rel=1e-12)
    assert np.abs(run.trace.momentum_td).max() < 1e-14


def test_same_seed_gives_the_same_bits_with_links_whatever_is_traced():
    scene = rigid_trimers()
    one, two = (pm.simulate(scene, steps=400, temperature=1e-3, seed=4, trace_every=n) for n in (None, 7))
    assert np.array_equal(one.packing.position_nd, two.packing.position_nd)
    assert np.array_equal(one.velocity_nd, two.velocity_nd)


def test_a_step_too_long_for_the_links_is_named():
    scene, velocity, mass = tumbling_chain(5, 2)
    run = pm.simulate(scene, steps=1000, dt=2.0, velocity_nd=3.0 * velocity, check=False)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    assert run.packing.link_error < 1e-13


def test_any_number_of_threads_gives_the_same_bits_with_links():
    packing = pm.cluster_packing(340, shape=pm.Dimer(), dimension=2, packing_fraction=0.7, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.ContactDamping(0.1)))
    one, two = (pm.simulate(scene, steps=60, temperature=1e-3, seed=2, threads=threads) for threads in (1, 2))
    assert one.packing.position_nd.tobytes() == two.packing.position_nd.tobytes()
    assert one.velocity_nd.tobytes() == two.velocity_nd.tobytes()
    assert one.tension_l.tobytes() == two.tension_l.tobytes()


def test_a_link_to_a_held_particle_is_a_pendulum_with_the_tension_of_one():
    gravity, length = 0.7, 1.0
    mass = np.array([1.0, 2.0])
    effects = (pm.Repulsion(), pm.Gravity(0.0, -gravity))
    scene = free_scene([[0.0, 0.0], [length, 0.0]], chain_links(2, 2), effects=effects, mass_n=mass)
    run = pm.simulate(scene, duration=2.0, dt=1e-3, held_n=[True, False], trace_every=100)
    hang = run.packing.position_nd[1] - run.packing.position_nd[0]
    assert np.array_equal(run.packing.position_nd[0], scene.packing.position_nd[0])
    assert np.linalg.norm(hang) == pytest.approx(length, abs=1e-13)
    speed = float((run.velocity_nd[1] ** 2).sum())
    assert speed == pytest.approx(-2.0 * gravity * hang[1], rel=1e-5)
    assert run.tension_l == pytest.approx([mass[1] * (speed / length - gravity * hang[1] / length)], rel=1e-12)


def test_links_hold_with_friction_and_momentum_and_angular_momentum_with_them():
    position = np.array([[0.0, 0.0], [1.0, 0.0], [0.3, 0.55], [1.3, 0.75]])
    length = [np.linalg.norm(position[k + 1] - position[k]) for k in (0, 2)]
    links = pm.Links([0, 2], [1, 3], [[0, 0]] * 2, length)
    scene = free_scene(position, links, radius=0.3, effects=(pm.Repulsion(), pm.Friction(0.6, 0.5, 0.1)))
    velocity = [[0.1, 0.05], [-0.02, 0.1], [0.0, -0.1], [0.05, -0.15]]
    run = pm.simulate(scene, steps=400, dt=0.01, velocity_nd=velocity, trace_every=10)
    trace = run.trace
    assert trace.contacts_t.max() > 0 and trace.rotational_t.max() > 0.0
    assert run.link_error < 1e-13 and run.momentum_error < 1e-13
    assert np.ptp(trace.angular_momentum_tk, axis=0) < 1e-11 * np.abs(trace.angular_momentum_tk).max()


def test_links_in_a_box_that_deforms_are_refused_by_name():
    scene, velocity, _ = rotor()
    with pytest.raises(ValueError, match="no rigid links where the box deforms: .* got 1 links"):
        pm.simulate(scene, steps=2, velocity_nd=velocity, applied_strain=pm.SteadyStrain(0.1))
