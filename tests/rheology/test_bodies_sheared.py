"""Rigid bodies of beads in shear at given rates, amplitudes and stresses: as discs where they are, and balances."""

import numpy as np
import pytest

import packmech as pm

REST = (pm.Repulsion(),)


def effects(damping=0.3, drag=0.0):
    """Return the same kinds of effects for all, so that one compiled loop serves: none acts at a strength of zero."""
    return (*REST, pm.ContactDamping(damping), pm.BackgroundDamping(drag))


@pytest.fixture(scope="module")
def discs():
    start = pm.random_packing(12, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    return pm.quench(pm.Scene(start, REST), force_tolerance=1e-10).packing


@pytest.fixture(scope="module")
def dimers():
    start = pm.random_packing(10, dimension=2, packing_fraction=0.95, seed=1, shapes=pm.Dimer(0.8))
    return pm.Scene(pm.quench(pm.Scene(start, REST), force_tolerance=1e-10).packing, effects())


CALLS = {
    "steady_shear": lambda scene: pm.steady_shear(
        scene, rates=[0.05], applied_strain=0.1, skip_strain=0.0, blocks=2, dt=0.05
    ).runs[0],
    "creep": lambda scene: pm.creep(scene, stress=3e-3, duration=6.0, dt=0.05),
    "amplitude_sweep": lambda scene: pm.amplitude_sweep(
        scene, amplitudes=[0.01, 0.03], frequency=0.1, periods=1.0, dt=0.05
    ).runs[1],
    "equilibrate": lambda scene: (
        pm.equilibrate(scene, amplitude=0.01, frequency=0.1, expected_stress=1e-3, dt=0.05).baseline
    ),
}


@pytest.mark.parametrize("call", CALLS)
def test_bodies_of_one_bead_are_sheared_as_discs_are(call, discs):
    alone = CALLS[call](pm.Scene(discs, effects()))
    bodies = CALLS[call](pm.Scene(pm.rigid_packing(discs, np.arange(discs.particles)), effects()))
    assert np.array_equal(bodies.contacts_t, alone.contacts_t)
    assert np.abs(bodies.strain_t - alone.strain_t).max() < 1e-10
    assert np.abs(bodies.packing.position_nd - alone.packing.position_nd).max() < 1e-9
    size = np.abs(alone.stress["overall"]).max()
    assert np.abs(bodies.stress["overall"] - alone.stress["overall"]).max() < 1e-9 * size


def taken(run):
    """Return what the shear has done less what became energy, and what it has done [energy]."""
    # forces work along their branches, torques have no part in it; peculiar velocities carry momentum across the planes
    stress = run.stress["contact"][:, 0, 1] + run.stress["kinetic"][:, 0, 1]
    work = run.packing.box.volume * np.trapezoid(stress, run.strain_t)
    energy = run.potential_t + run.kinetic_t + run.rotational_t
    return work - (energy[-1] - energy[0]), work


def test_what_shear_does_on_bodies_becomes_their_energy_the_better_the_shorter_the_step_or_is_taken_by_dashpots(dimers):
    def shear(damping, samples):
        given = {"rates": [0.1], "applied_strain": 0.2, "skip_strain": 0.0, "blocks": 2, "dt": 2.0 / samples}
        return pm.steady_shear(dimers.replace(effects=effects(damping)), samples=samples, **given).runs[0]

    (coarse, _), (fine, work) = taken(shear(0.0, 50)), taken(shear(0.0, 200))
    # contacts that open and close on the way spoil the clean factor of 16
    assert abs(fine) < 2e-5 * work and abs(fine) < 0.15 * abs(coarse)
    lost, work = taken(shear(0.3, 100))
    assert 0.1 * work < lost < work


def test_bodies_keep_their_momentum_in_shear_and_creep_until_their_stress_is_the_load(dimers):
    ramped = CALLS["steady_shear"](dimers)
    push = (dimers.packing.mass_n[:, None] * ramped.velocity_nd).sum(axis=0)
    speed = (dimers.packing.mass_n[:, None] * np.abs(ramped.velocity_nd)).sum()
    assert np.abs(push).max() < 1e-12 * speed
    load = 3e-4
    run = pm.creep(dimers.replace(effects=effects(drag=0.3)), stress=load, duration=300.0, dt=0.1)
    assert run.shear_stress_t[-1] == pytest.approx(load, rel=5e-3)
    # what bears the load is at rest, and its static stress is the load, too
    static = pm.stress_tensor(dimers.replace(packing=run.packing, effects=REST))
    assert static[0, 1] == pytest.approx(load, rel=5e-3)


def test_bodies_in_equilibrium_stay_at_rest_and_their_modulus_at_small_amplitudes_is_the_static_one(dimers):
    rest = pm.equilibrate(dimers, amplitude=1e-4, frequency=0.02)
    assert rest.ratio < 1e-6
    assert np.abs(rest.packing.position_nd - dimers.packing.position_nd).max() < 1e-6
    sweep = pm.amplitude_sweep(dimers, amplitudes=[1e-5, 2e-5], frequency=2e-3, pre_periods=0.5, periods=1.0)
    modulus = pm.elastic_moduli(dimers.replace(effects=REST)).shear_modulus
    assert np.abs(sweep.storage_a / modulus - 1.0).max() < 0.03
    assert abs(sweep.storage_a[1] / sweep.storage_a[0] - 1.0) < 1e-3
