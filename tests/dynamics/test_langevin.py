"""Facts about thermal noise: equipartition, places and diffusion in a heat bath, and what its bits depend on."""

import math
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm

T, RATE = 0.3, 0.7
COUNT = 300


@pm.effect
class Traps(NamedTuple):
    """Springs to the middles of square cells of side one."""

    stiffness: float = 1.0

    def body_force(self, x, y, z, u, v, w, mass, radius):
        k = -self.stiffness
        return k * (x - math.floor(x) - 0.5), k * (y - math.floor(y) - 0.5), 0.0

    def body_energy(self, x, y, z, mass, radius):
        p, q = x - math.floor(x) - 0.5, y - math.floor(y) - 0.5
        return 0.5 * self.stiffness * (p * p + q * q)


def gas(dimension=2, count=COUNT, shapes=None):
    """Return particles of different masses that do not touch, on a lattice with room for half a diameter around."""
    side = math.ceil(count ** (1.0 / dimension))
    place = np.stack(np.meshgrid(*(np.arange(side) + 0.5,) * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    mass = np.random.default_rng(1).uniform(0.5, 2.0, count)
    box = pm.Box.cubic(float(side), dimension)
    return pm.Packing(place[:count], np.full(count, 0.4), box, mass_n=mass, shapes=shapes)


def agrees(sample, expected):
    """Whether the mean of independent samples is what is expected, within four standard errors."""
    sample = np.asarray(sample).ravel()
    return abs(sample.mean() - expected) < 4.0 * sample.std(ddof=1) / math.sqrt(len(sample))


@pytest.mark.parametrize("step", [0.4, 0.8])
def test_places_in_a_trap_have_the_boltzmann_distribution_at_any_step_and_velocities_to_second_order(step):
    """Groenbech-Jensen and Farago: <x^2> = T / k for any dt, <v^2> = T / m (1 - (omega dt / 2)^2)."""
    packing = gas().replace(mass_n=np.full(COUNT, 1.5))
    stiffness, temperature = 60.0, 0.3
    omega = math.sqrt(stiffness / 1.5)
    scene = pm.Scene(packing, (Traps(stiffness), pm.Langevin(temperature, RATE, seed=4)))
    run = pm.simulate(scene, dt=step / omega, steps=6000, trace_every=20, trace_positions=True)
    trace = run.trace
    place = trace.position_tnd[20:] - packing.position_nd
    assert np.abs(place).max() < 0.5
    # means over time of each particle and axis are independent
    assert agrees((place**2).mean(axis=0), temperature / stiffness)
    assert agrees((trace.velocity_tnd[20:] ** 2).mean(axis=0), temperature / 1.5 * (1.0 - (0.5 * step) ** 2))
    # so would not be had without that error
    assert not agrees((trace.velocity_tnd[20:] ** 2).mean(axis=0), temperature / 1.5)


@pytest.mark.parametrize("dt", [0.1, 1.0])
def test_free_particles_diffuse_at_any_step(dt):
    """D = T / (m rate), and <v^2> = T / m, without an error of the step."""
    packing, rate, steps, heat = gas(), 4.0, 200, 0.005
    scene = pm.Scene(packing, (pm.Langevin(heat, rate, seed=2),))
    run = pm.simulate(scene, dt=dt, steps=4000, trace_every=steps, trace_positions=True)
    moved = np.diff(run.trace.position_tnd[1:], axis=0)
    mass = packing.mass_n[:, None]
    # a step goes dt times the mean of the velocities at its ends, whose correlations fall by a from step to step
    a = (1.0 - 0.5 * rate * dt) / (1.0 + 0.5 * rate * dt)
    weight = np.r_[0.5, np.ones(steps - 1), 0.5]
    apart = np.abs(np.subtract.outer(np.arange(steps + 1), np.arange(steps + 1)))
    expected = dt**2 * heat * (weight @ (float(a) ** apart) @ weight)
    # that is 2 D t but for what two ends correlate
    assert expected == pytest.approx(2.0 * heat / rate * (steps * dt), rel=1.5 / (rate * steps * dt))
    assert agrees((moved**2 * mass).mean(axis=0), expected)
    assert agrees((run.trace.velocity_tnd[1:] ** 2 * mass).mean(axis=0), heat)


@pytest.mark.parametrize("rate", [0.0, 0.2])
def test_velocities_and_spins_are_equipartitioned_in_a_box_that_flows_too(rate):
    packing = gas()
    # contacts dissipate, and have no part in this
    effects = (pm.Friction(0.0), pm.Langevin(T, RATE, seed=5))
    flow = {"applied_strain": pm.SteadyStrain(rate)} if rate else {}
    run = pm.simulate(pm.Scene(packing, effects), dt=0.1, steps=6000, trace_every=30, trace_positions=True, **flow)
    inertia = 0.5 * packing.mass_n * packing.radius_n**2
    peculiar, spin = run.trace.velocity_tnd[10:], run.trace.spin_tnk[10:, :, 0]
    # half the vorticity of x' = rate y
    spin = spin + 0.5 * rate
    assert agrees((spin**2 * inertia).mean(axis=0), T) and agrees(spin.mean(axis=0), 0.0)
    if not rate:
        assert agrees((peculiar**2 * packing.mass_n[:, None]).mean(axis=0), T)
    else:
        # SLLOD without contacts: dc_x/dt = -rate c_y - RATE c_x + noise has these second moments
        ratio = rate / RATE
        xx, xy, yy = 1.0 + 0.5 * ratio**2, -0.5 * ratio, 1.0
        x, y = peculiar[..., 0], peculiar[..., 1]
        for product, expected in ((x * x, xx), (x * y, xy), (y * y, yy)):
            assert agrees((product * packing.mass_n).mean(axis=0) / T, expected)


@pytest.mark.parametrize("kind", ["spheroids", "bodies"])
def test_shapes_in_space_have_half_the_temperature_about_each_axis(kind):
    shapes = pm.Ellipses(1.5) if kind == "spheroids" else pm.Trimer()
    packing = pm.random_packing(100, dimension=3, packing_fraction=0.02, seed=1, shapes=shapes)
    run = pm.simulate(pm.Scene(packing, (pm.Langevin(T, RATE, seed=1),)), dt=0.02, steps=8000, trace_every=40)
    for energy in (run.trace.rotational_t, run.trace.kinetic_t - run.trace.rotational_t):
        # blocks of many times of relaxation
        assert agrees((energy[21:201] / 100.0).reshape(12, -1).mean(axis=1), 1.5 * T)


def test_bits_are_those_of_seed_step_and_particle(tmp_path):
    start = pm.random_packing(200, dimension=2, packing_fraction=0.8, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(), pm.Friction(0.5), pm.ContactDamping(0.1), pm.Langevin(1e-4, 0.2, 7)))
    settings = {"dt": 0.05, "steps": 400}
    whole = pm.simulate(scene, **settings)
    shared = pm.simulate(scene, threads=2, **settings)
    file = tmp_path / "half.npz"
    pm.simulate(scene, checkpoint=file, checkpoint_every=150, dt=0.05, steps=150)
    resumed = pm.simulate(scene, checkpoint=file, **settings)
    for other in (shared, resumed):
        assert np.array_equal(whole.packing.position_nd, other.packing.position_nd)
        assert np.array_equal(whole.velocity_nd, other.velocity_nd) and np.array_equal(whole.spin_nk, other.spin_nk)
    other = pm.simulate(scene.replace(effects=(*scene.effects[:3], pm.Langevin(1e-4, 0.2, 8))), **settings)
    assert not np.array_equal(whole.velocity_nd, other.velocity_nd)


def test_noise_belongs_to_particles_wherever_they_are_in_the_cell():
    packing = gas()
    effects = (pm.Langevin(T, RATE, seed=3),)
    moved = packing.replace(position_nd=packing.position_nd + [5.3, 9.1])
    found = [pm.simulate(pm.Scene(one, effects), dt=0.1, steps=50) for one in (packing, moved.wrapped())]
    np.testing.assert_allclose(found[0].velocity_nd, found[1].velocity_nd, atol=1e-13)
    # no two particles have the same noise
    kicks = found[0].velocity_nd * np.sqrt(packing.mass_n)[:, None]
    assert len(np.unique(kicks)) == kicks.size


def test_without_a_temperature_it_is_the_drag():
    """To the second order of the step: both slow a particle by exp(-rate t)."""
    packing = gas()
    velocity = np.random.default_rng(2).standard_normal((COUNT, 2)) * 0.1
    for dt in (0.2, 0.1):
        run = pm.simulate(pm.Scene(packing, (pm.Langevin(0.0, RATE),)), dt=dt, duration=2.0, velocity_nd=velocity)
        slowed = ((1.0 - 0.5 * RATE * dt) / (1.0 + 0.5 * RATE * dt)) ** round(2.0 / dt)
        np.testing.assert_allclose(run.velocity_nd, slowed * velocity, rtol=1e-12)
        assert slowed == pytest.approx(math.exp(-RATE * 2.0), rel=(RATE * dt) ** 2 * RATE * 2.0 / 10.0)


def test_held_particles_stay():
    packing = gas()
    scene = pm.Scene(packing, (pm.Langevin(T, RATE), pm.FixedParticles((0, 7))))
    run = pm.simulate(scene, dt=0.1, steps=20)
    still = (run.velocity_nd == 0.0).all(axis=1)
    assert np.flatnonzero(still).tolist() == [0, 7]
    assert np.array_equal(run.packing.position_nd[still], packing.position_nd[still])


def test_what_steps_do_not_sample_is_refused():
    bath = pm.Langevin(T, RATE)
    with pytest.raises(ValueError, match="must hold one Langevin, got them at 0 and 1"):
        pm.simulate(pm.Scene(gas(), (bath, bath)), dt=0.1, steps=1)
    with pytest.raises(ValueError, match="method must be VelocityVerlet"):
        pm.simulate(pm.Scene(gas(), (bath,)), dt=0.1, steps=1, method=pm.SemiImplicitEuler())
    dimers = pm.cluster_packing(4, pm.Dimer(), dimension=2, packing_fraction=0.3, seed=1)
    with pytest.raises(ValueError, match="must have no rigid links beside Langevin"):
        pm.simulate(pm.Scene(dimers, (pm.Repulsion(), bath)), dt=0.01, steps=1)
    for call in (pm.quench, pm.jam):
        with pytest.raises(ValueError, match="got Langevin at 1: leave it out"):
            call(pm.Scene(gas(), (pm.Repulsion(), bath)))
    for seed, what in ((-1, "not be negative"), (0.5, "be a whole number"), (1 << 53, "be a whole number")):
        with pytest.raises(ValueError, match=f"seed must {what}"):
            pm.Scene(gas(), (pm.Langevin(T, RATE, seed=seed),))
