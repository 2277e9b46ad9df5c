"""Facts about steady strain, flow curves, creep and amplitude sweeps."""

import numpy as np
import pytest

import packmech as pm

LAW = pm.LinearSpring()


@pytest.fixture(scope="module")
def packing():
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    # mass 1 for a small disc
    start = start.replace(mass_n=(start.diameter_n / start.reference_diameter) ** 2)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-12).packing


@pytest.fixture(scope="module")
def scene(packing):
    """Discs at rest: every second contact a bond, the others with friction; the effects of test_oscillatory_shear."""
    bonds = pm.bond_contacts(
        packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    bonds = bonds.select(np.arange(len(bonds)) % 2 == 0)
    return pm.Scene(
        packing,
        (pm.Repulsion(law=LAW), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2), bonds, pm.BackgroundDamping(0.02)),
    )


@pytest.mark.parametrize("mode", ["shear", "uniaxial", "isotropic"])
def test_a_slow_small_ramp_has_the_static_moduli(scene, mode):
    exact = pm.complex_modulus(scene, [1e-5], mode=mode).stress_fdd[0].real
    run = pm.ramp_strain(scene, rate=2e-8, applied_strain=2e-5, mode=mode, dt=0.2, samples=10)
    slope = (run.stress["overall"][-1] - run.stress["overall"][5]) / (run.strain_t[-1] - run.strain_t[5])
    assert np.abs(slope - exact).max() < 2e-3 * np.abs(exact).max()


def test_stress_under_compression_is_per_volume_of_the_box_as_it_is(scene):
    run = pm.ramp_strain(scene, rate=-0.01, applied_strain=0.05, mode="isotropic", samples=5)
    assert run.packing.box.volume == pytest.approx(0.95**2 * scene.packing.box.volume, rel=1e-12)
    # all contacts counted from the packing at the end: normal forces alone, so less than the whole, but most of it
    again = pm.Scene(run.packing, (pm.Repulsion(law=LAW),))
    assert run.pressure_t[-1] == pytest.approx(pm.pressure(again), rel=0.2)
    assert run.pressure_t[-1] > 2.0 * run.pressure_t[0]


def test_creep_ends_at_the_static_compliance_whatever_the_boxs_inertia(scene):
    modulus = pm.complex_modulus(scene, [1e-5]).modulus_f[0].real
    for choices in ({}, {"inertia": 100.0, "viscosity": 1.0}):
        run = pm.creep(scene, stress=1e-5, duration=400.0, dt=0.1, **choices)
        # the shear stress at rest acts from the start
        assert (run.strain_t[-1]) == pytest.approx((1e-5 - run.shear_stress_t[0]) / modulus, rel=2e-3)
        assert run.shear_stress_t[-1] == pytest.approx(1e-5, rel=2e-3)
        # at rest forces balance, and the run says how well
        assert not run.flows and run.residual < 1e-6
        assert f"residual {run.residual:.1e}" in repr(run) and "of a flow" not in str(run.summary())


def test_creep_beyond_the_yield_stress_is_a_flow(scene):
    frictional = scene.without(pm.Bonds)
    run = pm.creep(frictional, stress=0.3, duration=40.0, dt=0.1)
    assert run.flows and run.strain_t[-1] > 0.5
    assert "residual" not in repr(run) and "of a flow not expected to vanish" in run.summary().stages[-1].note


def test_strain_comes_back_when_the_stress_of_creep_is_taken_away(scene):
    run = pm.creep(scene, stress=1e-5, duration=800.0, hold=400.0, dt=0.1)
    at_rest = -run.shear_stress_t[0] / pm.complex_modulus(scene, [1e-5]).modulus_f[0].real
    most = np.abs(run.strain_t - at_rest).max()
    assert run.strain_t[-1] == pytest.approx(at_rest, abs=2e-3 * most)


def test_an_undamped_box_rings_as_its_equation_of_motion_says(packing):
    # all particles follow the box, so that sigma = sigma_0 + G gamma: W gamma'' = V (stress - sigma_0 - G gamma)
    bonds = pm.bond_contacts(packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.0)
    scene = pm.Scene(packing, (pm.Repulsion(law=LAW), bonds))
    held = np.ones(packing.particles, dtype=bool)
    modulus = pm.complex_modulus(scene, [0.01], held_n=held).modulus_f[0].real
    inertia, volume = 500.0, packing.box.volume
    period = 2.0 * np.pi * np.sqrt(inertia / (volume * modulus))
    run = pm.creep(scene, stress=1e-4, duration=period, inertia=inertia, viscosity=0.0, held_n=held, dt=0.002 * period)
    swing = (1e-4 - run.shear_stress_t[0]) / modulus
    exact = swing * (1.0 - np.cos(2.0 * np.pi * run.time_t / period))
    assert np.abs(run.strain_t - exact).max() < 0.02 * 2.0 * abs(swing)


def test_faster_steady_shear_bears_more_stress_and_blocks_give_errors(scene):
    frictional = scene.replace(effects=tuple(one for one in scene.effects if not isinstance(one, pm.Bonds)))
    curve = pm.steady_shear(frictional, rates=[0.01, 0.3], applied_strain=3.0, samples=300)
    assert all("of a flow not expected to vanish" in stage.note for stage in curve.summary().stages)
    assert curve.stress_r[1] - curve.stress_r[0] > 3.0 * np.hypot(*curve.stress_error_r)
    assert (curve.stress_r > 0.0).all() and (curve.sliding_r > 0.0).all()
    assert curve.viscosity_r[1] < curve.viscosity_r[0]
    # energy: what the stress does is taken by dashpots, friction and drag, and does not heat the discs without end
    assert curve.runs[0].kinetic_t[-50:].mean() < 1.0


@pytest.mark.parametrize(
    ("call", "given"),
    [(pm.ramp_strain, {"rate": 0.1, "applied_strain": 0.4}), (pm.creep, {"stress": 1e-3, "duration": 10.0})],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_run_whose_forces_overflow_ends_with_a_step_too_long_and_the_last_finite_positions(call, given):
    packing = pm.random_packing(24, dimension=3, packing_fraction=0.7, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(law=LAW), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2)))
    spin = np.zeros((24, 3))
    spin[3] = 1e300
    run = call(scene, spin_nk=spin, check=False, **given)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    assert np.isfinite(run.packing.position_nd).all()
    with pytest.raises(pm.NotConverged, match="time step is too long"):
        call(scene, spin_nk=spin, **given)


def test_a_rate_at_which_the_time_step_is_too_long_is_nan_in_the_curve_and_raises_only_where_that_is_checked(scene):
    # the fast shear has short steps, as its samples are close
    given = {"rates": (0.003, 0.5), "applied_strain": 0.4, "skip_strain": 0.1, "samples": 40, "dt": 3.0}
    curve = pm.steady_shear(scene, check=False, **given)
    assert [run.outcome for run in curve.runs] == [pm.Outcome.STEP_TOO_LONG, pm.Outcome.FINISHED]
    assert curve.outcome is pm.Outcome.STEP_TOO_LONG and not curve.ok
    for name in ("stress_r", "stress_error_r", "pressure_r", "pressure_error_r", "contacts_r", "sliding_r"):
        assert np.isnan(getattr(curve, name)).tolist() == [True, False]
    assert curve.to_dict()["outcome"] == "step_too_long"
    assert "time step is too long" in repr(curve)
    with pytest.raises(pm.NotConverged) as caught:
        pm.steady_shear(scene, **given)
    assert caught.value.run.steps == curve.runs[0].steps
    drive = pm.SteadyShearDrive(**given)
    again = pm.run(scene.replace(drive=drive))
    np.testing.assert_array_equal(again.stress_r, curve.stress_r)


def test_an_amplitude_sweep_is_linear_at_small_amplitudes_and_softens_at_large_ones(scene):
    sweep = pm.amplitude_sweep(scene, amplitudes=[1e-5, 1e-4, 0.3], frequency=0.05, periods=6, samples_per_period=40)
    assert sweep.storage_a[1] == pytest.approx(sweep.storage_a[0], rel=1e-2)
    assert sweep.storage_a[2] < 0.8 * sweep.storage_a[0]
    assert 1e-4 < sweep.softening_strain() < 0.3
    assert len({run.dt for run in sweep.runs}) == 1


def test_an_interrupted_sweep_keeps_the_amplitudes_that_were_finished(scene):
    def stop(stage, figures):
        if stage.endswith("amplitude 0.002"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.amplitude_sweep(
            scene, amplitudes=[0.001, 0.002], frequency=0.1, periods=2, samples_per_period=20, progress=stop
        )
    assert caught.value.run.amplitude_a.tolist() == [0.001]


def test_bootstrap_and_standard_errors_agree_for_many_values():
    value = np.random.default_rng(1).standard_normal(400)
    mean, error = pm.mean_with_error(value)
    drawn = pm.mean_with_error(value, error="bootstrap", draws=4000)
    assert drawn[0] == mean == pytest.approx(value.mean(), rel=1e-14)
    assert drawn[1] == pytest.approx(error, rel=0.05)
    assert np.isnan(pm.mean_with_error([1.0])[1])


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (pm.Bonds([0, 1], [2, 16], [[0, 0], [0, 0]], [1.0, 1.0]), r"scene.effects\[1\].j_b must be below 16, got 16"),
        (pm.Bonds([0], [2], [[0, 0, 0]], [1.0]), r"scene.effects\[1\].image_bd must have shape \(1, 2\)"),
        (pm.Bonds([0], [0], [[0, 0]], [1.0]), "bonds whose ends are apart"),
    ],
)
def test_bonds_that_are_not_the_packing_s_are_refused_by_all_that_moves_it(effect, said):
    packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    scene = pm.Scene(packing, (pm.Repulsion(), effect))
    with pytest.raises(ValueError, match=said):
        pm.simulate(scene, steps=1)
    with pytest.raises(ValueError, match=said):
        pm.ramp_strain(scene, rate=0.1, applied_strain=0.1)


def test_a_second_friction_is_refused_instead_of_being_left_out():
    packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    for two in ((pm.Friction(0.5), pm.Friction(0.1)), (pm.Friction(0.5), *[pm.RollingResistance()] * 2)):
        with pytest.raises(ValueError, match=r"one (Friction|resistance to rolling) at most, got"):
            pm.Scene(packing, (pm.Repulsion(), *two))
