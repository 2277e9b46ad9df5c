"""Facts about oscillatory shear: agreement with the frequency domain, order two in time, exact strain, how runs end."""

import numpy as np
import pytest

import packmech as pm
from packmech.rheology.oscillatory import characteristic_time

LAW = pm.LinearSpring()
SMALL = 1e-6


@pytest.fixture(scope="module")
def scene():
    """Discs at rest: every second contact a bond, the others with friction; dashpots of all kinds."""
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-12).packing
    bonds = pm.bond_contacts(
        packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    bonds = bonds.select(np.arange(len(bonds)) % 2 == 0)
    return pm.Scene(
        packing,
        (pm.Repulsion(law=LAW), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2), bonds, pm.BackgroundDamping(0.02)),
    )


@pytest.mark.parametrize("frequency", [0.02, 0.1])
def test_moduli_are_those_of_the_frequency_domain(scene, frequency):
    run = pm.oscillatory_shear(scene, amplitude=SMALL, frequency=frequency, periods=12, skip_periods=9, dt=0.02)
    exact = pm.complex_modulus(scene, [frequency])
    assert abs(run.moduli.storage + 1j * run.moduli.loss - exact.modulus_f[0]) < 1e-4 * abs(exact.modulus_f[0])
    for tensor, (a, b), table in (
        ("contact", (0, 1), exact.contact_stress_fdd),
        ("contact", (1, 0), exact.contact_stress_fdd),
        ("overall", (0, 0), exact.stress_fdd),
    ):
        found = run.demodulated(tensor, (a, b))
        assert abs(found.storage + 1j * found.loss - table[0, a, b]) < 1e-3 * abs(table[0, a, b])
    assert np.ptp(run.contacts_t) == 0 and run.sliding_t.max() == 0


def generic(scene):
    """Return velocities and spins of no symmetry, small enough that nothing opens, closes or slides."""
    rng = np.random.default_rng(7)
    n = scene.packing.particles
    return {"velocity_nd": 1e-5 * rng.standard_normal((n, 2)), "spin_nk": 1e-5 * rng.standard_normal((n, 1))}


STEPS = 0.125 / 2.0 ** np.arange(4)


def slope(error):
    return np.polyfit(np.log(STEPS), np.log(error), 1)[0]


def test_velocity_verlet_is_of_order_two_in_positions_under_shear_with_fixed_contacts(scene):
    strain = pm.OscillatoryStrain(2e-5, 0.02)

    def end(dt):
        run = pm.simulate(scene, duration=60.0, dt=dt, applied_strain=strain, **generic(scene))
        return np.concatenate([run.packing.position_nd, run.velocity_nd, run.spin_nk], axis=1)

    fine = end(STEPS[-1] / 16.0)
    assert slope([np.abs(end(dt) - fine).max() for dt in STEPS]) == pytest.approx(2.0, abs=0.1)


def moduli_order(scene, method, **choices):
    """Return the order in which G' + i G'' comes to that of small time steps of velocity Verlet."""

    def modulus(dt, method=method):
        run = pm.oscillatory_shear(
            scene, amplitude=2e-5, frequency=0.02, periods=2, dt=dt, method=method, samples_per_period=50, **choices
        )
        assert np.ptp(run.contacts_t) == 0 and run.sliding_t.max() == 0
        return run.moduli.storage + 1j * run.moduli.loss

    fine = modulus(STEPS[-1] / 16.0, pm.VelocityVerlet())
    return slope([abs(modulus(dt) - fine) for dt in STEPS])


@pytest.mark.parametrize(("method", "order"), [(pm.VelocityVerlet(), 2.0), (pm.SemiImplicitEuler(), 1.0)])
def test_moduli_are_of_the_methods_order_with_fixed_contacts_from_a_generic_start(scene, method, order):
    assert moduli_order(scene, method, **generic(scene)) == pytest.approx(order, abs=0.1)


def test_rests_before_and_after_leave_the_moduli_as_they_are(scene):
    choices = {"amplitude": SMALL, "frequency": 0.1, "periods": 8, "skip_periods": 6, "dt": 0.02}
    run = pm.oscillatory_shear(scene, pre_periods=0.3, post_periods=0.7, **choices)
    exact = pm.complex_modulus(scene, [0.1]).modulus_f[0]
    assert abs(run.moduli.storage + 1j * run.moduli.loss - exact) < 1e-3 * abs(exact)
    # the box is at rest again, and so is what was stretched in it
    assert abs(run.strain_t[-1]) < 1e-18


def test_strain_is_the_exact_sine_between_rests(scene):
    run = pm.oscillatory_shear(
        scene, amplitude=1e-3, frequency=0.1, pre_periods=0.5, periods=2, post_periods=0.5, samples_per_period=40
    )
    phase = run.phase_t
    on = (phase > 0.0) & (phase < 4.0 * np.pi)
    assert np.abs(run.strain_t[on] - 1e-3 * np.sin(phase[on])).max() < 1e-16
    assert np.abs(run.rate_t[on] - 1e-3 * 0.2 * np.pi * np.cos(phase[on])).max() < 1e-16
    assert np.abs(run.strain_t[~on]).max() < 1e-16
    assert run.rate_t[~on].tolist() == [0.0] * int((~on).sum())
    assert run.time_t[-1] == pytest.approx(30.0, abs=2.0 * run.dt)


def test_overall_stress_is_symmetric_and_the_sum_of_its_parts(scene):
    run = pm.oscillatory_shear(scene, amplitude=0.05, frequency=0.1, periods=2, samples_per_period=40)
    overall = run.stress["overall"]
    assert np.abs(overall - np.swapaxes(overall, 1, 2)).max() < 1e-14 * np.abs(overall).max()
    parts = run.stress["contact"] + run.stress["torque"] + run.stress["spin"]
    assert np.abs(parts - overall).max() < 1e-15
    assert run.sliding_t.max() > 0 and run.sliding_fraction_t.max() <= 1.0


def test_frames_and_samples_change_no_bit_of_the_run(scene):
    def end(**choices):
        return pm.oscillatory_shear(scene, amplitude=0.05, frequency=0.1, periods=2, dt=1.0 / 64.0, **choices)

    one, other = end(samples_per_period=40), end(samples_per_period=320, frames=5)
    assert one.dt == other.dt
    assert np.array_equal(one.packing.position_nd, other.packing.position_nd)
    assert np.array_equal(one.velocity_nd, other.velocity_nd)
    assert len(other.frame_time_f) == 5
    assert np.array_equal(other.position_fnd[-1], other.packing.position_nd)
    assert np.abs(other.position_fnd[0] - scene.packing.position_nd).max() < 1e-15 * len(scene.packing.position_nd)


def test_time_step_does_not_depend_on_the_amplitude_and_divides_the_period(scene):
    steps = [pm.oscillatory_shear(scene, amplitude=a, frequency=0.1, periods=1).dt for a in (1e-6, 0.3)]
    assert steps[0] == steps[1]
    assert (10.0 / steps[0]) % 200 == pytest.approx(0.0, abs=1e-9)


def test_relative_frequency_is_in_units_of_the_mean_mass_and_a_contacts_stiffness(scene):
    mass = np.pi * scene.packing.radius_n**2
    assert characteristic_time(scene) == pytest.approx(np.sqrt(mass.mean()), rel=1e-12)
    run = pm.oscillatory_shear(scene, amplitude=1e-3, relative_frequency=0.1, periods=1)
    assert run.frequency == pytest.approx(0.1 / np.sqrt(mass.mean()), rel=1e-12)


def test_an_interrupted_run_keeps_what_it_reached(scene):
    def stop(stage, figures):
        assert stage == "oscillatory shear"
        if figures["time"] > 60.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.oscillatory_shear(scene, amplitude=1e-3, frequency=0.05, periods=50, dt=0.01, progress=stop)
    run = caught.value.run
    assert run.outcome is pm.Outcome.INTERRUPTED
    assert 60.0 < run.time_t[-1] < 300.0
    assert run.moduli is not None and run.moduli.storage > 0.0


def test_too_long_a_step_is_named_and_an_early_end_has_no_moduli(scene):
    with pytest.raises(pm.NotConverged, match="time step is too long") as caught:
        pm.oscillatory_shear(scene, amplitude=0.1, frequency=0.01, dt=4.0, samples_per_period=8)
    assert caught.value.run.outcome is pm.Outcome.STEP_TOO_LONG
    assert caught.value.run.moduli is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"amplitude": float("inf")}, "amplitude must be a finite number above 0 and at most"),
        ({"amplitude": 1e300}, "amplitude must be a finite number above 0 and at most"),
        ({"periods": float("inf")}, "periods must be a finite number"),
        ({"periods": 1e9}, "periods x samples_per_period must be so small that memory holds it"),
    ],
)
def test_endless_amplitudes_and_periods_are_named(scene, arguments, message):
    with pytest.raises(ValueError, match=message):
        pm.oscillatory_shear(scene, **({"amplitude": 0.1, "frequency": 0.01} | arguments))


def test_stress_does_not_jump_where_particles_leave_the_cell(scene):
    # all drift together, across the edges of the cell again and again; drag slows them as one
    given = {"amplitude": 0.05, "frequency": 0.02, "periods": 2, "samples_per_period": 400}
    stay = pm.oscillatory_shear(scene, **given)
    drift = pm.oscillatory_shear(scene, velocity_nd=np.tile([0.6, 0.45], (24, 1)), **given)
    cells = np.floor(drift.packing.position_nd @ drift.packing.box.inverse_dd.T)
    assert (np.abs(cells) >= 2).all()
    apart = np.abs(drift.stress["overall"] - stay.stress["overall"]).max()
    assert apart < 1e-9 * np.abs(stay.shear_stress_t).max()
