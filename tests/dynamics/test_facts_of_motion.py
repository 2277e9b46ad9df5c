"""Facts about motion with friction, bonds, dashpots and spins, in a plane and in space."""

from functools import cache

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.friction import leading_share

SPRING = pm.LinearSpring()
# a box at rest that could deform: scenes that do and scenes that do not are compiled together
STILL = pm.SteadyStrain(0.0)
DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])


def turns(dimension):
    return 1 if dimension == 2 else 3


def no_bonds(dimension):
    return pm.Bonds(np.zeros(0, int), np.zeros(0, int), np.zeros((0, dimension), int), np.zeros(0))


def bond(dimension, rest_length, **numbers):
    return pm.Bonds([0], [1], np.zeros((1, dimension), int), [rest_length], **numbers)


def scene_of(packing, *, friction=0.5, across=0.4, damping=0.0, damping_across=0.0, bonds=None, law=SPRING):
    """Return a scene with every effect of the frictional model; a strength of zero is as good as none."""
    return pm.Scene(
        packing,
        (
            pm.Repulsion(law=law),
            pm.ContactDamping(damping),
            pm.Friction(friction, across, damping_across),
            no_bonds(packing.dimension) if bonds is None else bonds,
        ),
    )


def pair(dimension, vector, radius=(0.5, 0.5), mass_n=None):
    """Return two particles, of masses in proportion to their volumes and 1 for the smaller unless given."""
    if mass_n is None:
        mass_n = (np.array(radius) / min(radius)) ** dimension
    first = np.full(dimension, 5.0)
    return pm.Packing([first, first + vector], radius, pm.Box.cubic(10.0, dimension), mass_n=mass_n)


AXES = {2: np.array([0.6, 0.8]), 3: np.array([2.0, -1.0, 2.0]) / 3.0}
ACROSS = {2: np.array([-0.8, 0.6]), 3: np.array([2.0, 2.0, -1.0]) / 3.0}


@cache
def sliding(dimension, approach):
    """Two particles too heavy to be turned aside slide slowly over each other while they come closer or part."""
    coefficient, overlap, across, damping = 0.5, 0.1, 50.0, 0.1
    slip = 1e-3 * coefficient * overlap / damping
    scene = scene_of(
        pair(dimension, (1.0 - overlap) * AXES[dimension], mass_n=[1e15, 1e15]),
        friction=coefficient,
        across=across,
        damping=0.3,
        damping_across=damping,
    )
    velocity = np.zeros((2, dimension))
    velocity[1] = slip * ACROSS[dimension] - approach * AXES[dimension]
    return pm.simulate(
        scene,
        duration=12.0,
        dt=0.01,
        velocity_nd=velocity,
        applied_strain=STILL,
        trace_every=50,
        trace_positions=True,
    )


@pytest.mark.parametrize("approach", [0.0, 1e-3, -1e-3])
@DIMENSIONS
def test_a_slowly_slid_contact_feels_the_coefficient_times_the_elastic_normal_force_without_the_dashpots(
    dimension, approach
):
    trace = sliding(dimension, approach).trace
    late = np.flatnonzero(trace.time_t > 4.0)
    assert len(late) > 10
    for t in late:
        branch = trace.position_tnd[t, 1] - trace.position_tnd[t, 0]
        normal = branch / np.linalg.norm(branch)
        force = trace.touching_t[t].force_cd[0]
        across = force - (force @ normal) * normal
        elastic = 1.0 - np.linalg.norm(branch)
        assert np.linalg.norm(across) == pytest.approx(0.5 * elastic, rel=1e-12)
        # on the first particle it pulls along with the second
        assert across @ ACROSS[dimension] > 0.999 * np.linalg.norm(across)


@DIMENSIONS
def test_a_slid_contact_feels_less_until_its_spring_is_as_long_as_the_cap_over_its_stiffness(dimension):
    run = sliding(dimension, 0.0)
    slips = [float(np.any(one.sliding_c)) for one in run.trace.touching_t]
    # stiffness (slip time) + dashpot slip = cap
    reached = (0.05 - 5e-5) / (50.0 * 5e-4)
    assert [bool(one) for one in slips] == (run.trace.time_t >= reached).tolist()


@DIMENSIONS
def test_a_fast_slid_contact_with_a_strong_dashpot_stays_at_its_cap_and_winds_no_spring(dimension):
    # the dashpot alone would bear two hundred times the cap, and weakens faster than the spring gains
    coefficient, overlap, across, damping = 0.5, 0.1, 1.0, 10.0
    scene = scene_of(
        pair(dimension, (1.0 - overlap) * AXES[dimension], mass_n=[1e15, 1.0]),
        friction=coefficient,
        across=across,
        damping=0.3,
        damping_across=damping,
    )
    velocity = np.zeros((2, dimension))
    velocity[1] = ACROSS[dimension]
    run = pm.simulate(
        scene,
        duration=0.1,
        dt=0.002,
        velocity_nd=velocity,
        applied_strain=STILL,
        trace_every=1,
        trace_positions=True,
    )
    trace = run.trace
    assert len(trace.time_t) > 40
    for t in range(len(trace.time_t)):
        branch = trace.position_tnd[t, 1] - trace.position_tnd[t, 0]
        normal = branch / np.linalg.norm(branch)
        force = trace.touching_t[t].force_cd[0]
        slid = force - (force @ normal) * normal
        assert np.linalg.norm(slid) == pytest.approx(coefficient * (1.0 - np.linalg.norm(branch)), rel=1e-12)
    # a spring holds no more than the cap stretches it by, and here only what a step adds
    assert trace.tangential_t.max() <= 0.5 * across * 0.002**2


def spun_pair(dimension, dt, duration, **kept):
    """An undamped bonded pair of two sizes, stretched, flying, sheared and spinning."""
    rng = np.random.default_rng(4)
    start = pair(dimension, 1.17 * AXES[dimension], radius=(0.5, 0.7))
    scene = scene_of(start, bonds=bond(dimension, 1.1, tangential_stiffness=0.7))
    return pm.simulate(
        scene,
        duration=duration,
        dt=dt,
        velocity_nd=0.1 * rng.standard_normal((2, dimension)),
        spin_nk=0.2 * rng.standard_normal((2, turns(dimension))),
        applied_strain=STILL,
        **kept,
    )


@DIMENSIONS
def test_an_undamped_bonded_pair_conserves_energy_at_second_order(dimension):
    steps = 0.08 / 2.0 ** np.arange(4)
    error = []
    for dt in steps:
        trace = spun_pair(dimension, dt, 12.0, trace_every=1).trace
        energy = trace.energy_t + trace.kinetic_t
        error.append(np.abs(energy - energy[0]).max())
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(2.0, abs=0.1)


@DIMENSIONS
def test_the_energy_of_an_undamped_bonded_pair_does_not_drift_over_thousands_of_periods(dimension):
    trace = spun_pair(dimension, 0.05, 10_000.0, trace_every=400).trace
    energy = (trace.energy_t + trace.kinetic_t) / (trace.energy_t + trace.kinetic_t)[0]
    tenths = [part.mean() for part in np.array_split(energy, 10)]
    assert np.ptp(tenths) < 0.02


def test_an_undamped_tangential_spring_swings_with_the_frequency_of_its_closed_form():
    # slip s: d2s/dt2 = -k (2/m + 2 a^2/I) s, arms a = r and I = m r^2 / 2 at rest length 2 r
    stiffness, slip, duration = 0.25, 1e-6, 40.0
    omega = np.sqrt(6.0 * stiffness)
    scene = scene_of(pair(2, [1.0, 0.0]), bonds=bond(2, 1.0, tangential_stiffness=stiffness))
    trace = pm.simulate(
        scene,
        duration=duration,
        dt=0.01,
        velocity_nd=[[0.0, -0.5 * slip], [0.0, 0.5 * slip]],
        applied_strain=STILL,
        trace_every=7,
    ).trace
    exact = 0.5 * stiffness * (slip / omega * np.sin(omega * trace.time_t)) ** 2
    assert np.abs(trace.tangential_t - exact).max() < 1e-3 * exact.max()


def test_damped_springs_need_no_led_velocities_and_undamped_ones_do():
    def share(**numbers):
        return leading_share(scene_of(pair(2, [0.9, 0.0]), **numbers), 0.05, 1.0)

    assert share(damping_across=0.1) == share(friction=0.0) == 0.0
    assert share() == share(bonds=bond(2, 1.0), friction=0.0) == 0.35


@cache
def cluster(dimension):
    """Particles that fall on each other far from every boundary: bonded, touching, rubbing, spinning, damped."""
    rng = np.random.default_rng(8)
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    n = len(grid)
    radius = np.where(np.arange(n) % 3 == 0, 0.4, 0.55)
    position = 20.0 + 0.95 * grid + 0.05 * rng.standard_normal(grid.shape)
    packing = pm.Packing(position, radius, pm.Box.cubic(40.0, dimension))
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.1, tangential_damping=0.05)
    bonds = bonds.select(np.arange(len(bonds)) % 3 == 0)
    scene = scene_of(packing, friction=0.3, damping=0.2, damping_across=0.1, bonds=bonds)
    velocity = 0.3 * rng.standard_normal((n, dimension)) - 0.2 * (position - 21.0)
    run = pm.simulate(
        scene,
        steps=1500,
        dt=0.01,
        velocity_nd=velocity,
        spin_nk=rng.standard_normal((n, turns(dimension))),
        applied_strain=STILL,
        trace_every=25,
        trace_positions=True,
    )
    return scene, run


@DIMENSIONS
def test_angular_momentum_holds_to_rounding_with_sliding_bonds_and_dashpots(dimension):
    _, run = cluster(dimension)
    trace = run.trace
    lever = np.linalg.norm(trace.position_tnd[0], axis=1)
    scale = float((run.packing.mass_n * lever * np.linalg.norm(trace.velocity_tnd[0], axis=1)).sum())
    assert trace.sliding_t.max() > 0 and np.ptp(trace.contacts_t) > 0
    assert trace.rotational_t[-1] != pytest.approx(trace.rotational_t[0], rel=0.1)
    drift = trace.angular_momentum_tk - trace.angular_momentum_tk[0]
    assert np.abs(drift).max() < 1e-13 * scale


@DIMENSIONS
def test_friction_and_dashpots_only_take_energy(dimension):
    _, run = cluster(dimension)
    energy = run.trace.energy_t + run.trace.kinetic_t
    assert energy[-1] < 0.6 * energy[0]
    assert np.diff(energy).max() < 1e-3 * energy[0]


@cache
def quenched(dimension):
    start = pm.random_packing(
        40, dimension=dimension, sizes=pm.Bidisperse(1.4), packing_fraction=1.0 if dimension == 2 else 0.8, seed=2
    )
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=SPRING),)), force_tolerance=1e-12).packing


@DIMENSIONS
def test_a_quenched_packing_displaced_by_a_thousandth_of_a_diameter_relaxes_back(dimension):
    packing = quenched(dimension)
    assert not pm.find_rattlers(packing).any()
    displacement = np.random.default_rng(6).standard_normal(packing.position_nd.shape)
    displacement *= 1e-3 * packing.reference_diameter / np.linalg.norm(displacement, axis=1)[:, None]
    mass = packing.mass_n
    # dashpots between particles leave the center of mass where it is
    displacement -= mass @ displacement / mass.sum()
    moved = packing.replace(position_nd=packing.position_nd + displacement)
    run = pm.simulate(scene_of(moved, friction=0.0, damping=0.7), duration=500.0, dt=0.1, applied_strain=STILL)
    back = np.linalg.norm(run.packing.position_nd - packing.position_nd, axis=1)
    assert np.linalg.norm(displacement, axis=1).min() > 5e-4
    assert back.max() < 1e-9


def test_a_period_of_strain_brings_the_box_back():
    scene = scene_of(quenched(2), damping=0.3, damping_across=0.2)
    scene = scene.replace(effects=(*scene.effects, pm.BackgroundDamping(0.1)))
    strain = pm.OscillatoryStrain(3.0, 0.01, periods=1)
    run = pm.simulate(scene, duration=100.0, dt=0.05, applied_strain=strain, trace_every=10)
    assert np.abs(run.trace.strain_t).max() == pytest.approx(3.0, rel=1e-3)
    lattice = scene.packing.box.lattice_dd
    assert np.abs(run.packing.box.lattice_dd - lattice).max() < 1e-14 * np.abs(lattice).max()


def test_a_strain_of_one_brings_the_same_lattice_of_images():
    scene = scene_of(quenched(2), damping=0.3, damping_across=0.2)
    run = pm.simulate(scene, steps=2000, dt=0.05, applied_strain=pm.SteadyStrain(0.01))
    repulsion = (pm.Repulsion(law=SPRING),)
    sheared = pm.energy(pm.Scene(run.packing, repulsion))
    assert run.strain == pytest.approx(1.0, rel=1e-12)
    assert pm.energy(pm.Scene(run.packing.replace(box=scene.packing.box), repulsion)) == pytest.approx(
        sheared, rel=1e-11
    )


def test_without_friction_nothing_turns_but_what_a_bond_turns():
    """Rows in several blocks hand each other forces; torques only where contacts have them."""
    start = pm.random_packing(800, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=1)
    near = pm.find_contacts(start, gap_tolerance=0.0)
    bonds = pm.Bonds(near.i_c[:1], near.j_c[:1], near.image_cd[:1], near.distance_c[:1] * 1.1)
    velocity = np.random.default_rng(1).standard_normal((800, 2))
    run = pm.simulate(pm.Scene(start, (pm.Repulsion(), bonds)), steps=50, velocity_nd=velocity)
    turned = np.flatnonzero(run.spin_nk[:, 0])
    assert set(turned.tolist()) == {int(near.i_c[0]), int(near.j_c[0])}


def test_bonds_and_drag_alone_make_a_damped_oscillator_without_any_effect_between_touching_pairs():
    # relative motion: d2s/dt2 = -(2 k / m) s - rate ds/dt
    stiffness, rate, stretch, mass = 3.0, 0.2, 0.1, 1.5
    law = pm.LinearSpring(stiffness)
    bonds = bond(2, 1.0, compression=law, tension=law)
    scene = pm.Scene(pair(2, (1.0 + stretch) * AXES[2], mass_n=[mass, mass]), (bonds, pm.BackgroundDamping(rate)))
    frequency = np.sqrt(2.0 * stiffness / mass - 0.25 * rate**2)
    error = []
    for dt in (0.1, 0.05, 0.025):
        run = pm.simulate(scene, duration=10.0, dt=dt, trace_every=1, trace_positions=True)
        time = run.trace.time_t
        swing = np.cos(frequency * time) + 0.5 * rate / frequency * np.sin(frequency * time)
        length = np.linalg.norm(run.trace.position_tnd[:, 1] - run.trace.position_tnd[:, 0], axis=1)
        error.append(np.abs(length - 1.0 - stretch * np.exp(-0.5 * rate * time) * swing).max())
    assert error[-1] < 1e-3 * stretch
    assert np.divide(error[:-1], error[1:]) == pytest.approx(4.0, rel=0.05)
    assert not run.trace.contacts_t.any() and not run.trace.touching_t[0].i_c.size
