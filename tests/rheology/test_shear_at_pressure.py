"""Steady shear in a box whose volume follows the pressure: what it must agree with, whatever the flow."""

import dataclasses

import numpy as np
import pytest

import packmech as pm
from packmech.rheology.at_pressure import PressureShear

RUBBING = (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.4, 0.5), pm.ContactDamping(1.0))


def start(particles=100, fraction=0.8, seed=1):
    packing = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.3), packing_fraction=fraction, seed=seed
    )
    return pm.quench(pm.Scene(packing, RUBBING[:1]), force_tolerance=1e-3).packing


@pytest.fixture(scope="module")
def flow():
    """Return the scene and a run of it at an inertial number of 0.1."""
    packing = start()
    scene = pm.Scene(packing, RUBBING)
    pressure = 1e-3
    rate = 0.1 * np.sqrt(pressure / packing.mass_n.mean())
    run = pm.shear_at_pressure(scene, rate=rate, pressure=pressure, applied_strain=16.0, skip_strain=4.0)
    return scene, run


def test_the_mean_pressure_is_the_one_asked_for(flow):
    _, run = flow
    mean, error = run.mean(run.pressure_t)
    assert abs(mean - run.pressure) < 4.0 * error
    assert error < 0.1 * run.pressure


def test_the_residual_of_a_flow_is_said_to_be_no_failure_to_balance(flow):
    """Grains that collide are accelerated: the largest net force is of the order of contact forces."""
    _, run = flow
    assert run.flows and run.residual > 0.1
    assert "residual" not in repr(run).splitlines()[0]
    assert run.summary().stages[-1].note == "residual: unbalanced force, of a flow not expected to vanish"
    assert "residual" not in str(pm.NotConverged(run))


def test_inertial_number_is_the_rate_in_units_of_the_pressure_that_was_measured(flow):
    scene, run = flow
    mean, error = run.mean(run.pressure_t)
    assert run.inertial_number == pytest.approx(run.rate * np.sqrt(scene.packing.mass_n.mean() / mean), rel=1e-12)
    # to the first order half the error of the pressure away from that at the pressure asked for
    assert abs(run.inertial_number - 0.1) < 0.1 * 0.5 * 4.0 * error / mean


def test_a_loose_start_flows_at_the_pressure_asked_for():
    loose = start(100, fraction=0.5)
    scene = pm.Scene(loose, (pm.Repulsion(), pm.Friction(0.4), pm.ContactDamping(1.0)))
    run = pm.shear_at_pressure(scene, rate=3e-3, pressure=1e-3, applied_strain=8.0)
    mean, error = run.mean(run.pressure_t)
    assert run.ok and run.unmet == ()
    assert abs(mean - 1e-3) < 3e-4 and error < 2e-4
    assert 0.0 < run.approach < 2.0
    # discs that rub flow at I = .1 some hundredths below random close packing
    assert 0.74 < run.mean(run.packing_fraction_t)[0] < 0.82


@pytest.mark.parametrize("asked", [1e-4, 1e-3])
def test_a_flow_that_is_not_at_the_pressure_asked_for_says_so_with_what_was_measured(asked):
    dense = start(60, fraction=0.9)
    scene = pm.Scene(dense, RUBBING)
    # the box follows too slowly to get there
    given = {"rate": 0.05, "pressure": asked, "applied_strain": 2.0, "skip_strain": 1.0, "answer": 3000.0}
    run = pm.shear_at_pressure(scene, **given, check=False)
    mean, _ = run.mean(run.pressure_t)
    assert run.outcome.name == "NOT_AT_PRESSURE" and not run.ok
    assert (run.unmet[0].name, run.unmet[0].reached, run.unmet[0].asked) == ("pressure", mean, asked)
    assert f"pressure {mean:.4g} where {asked:.4g} was asked for" in str(run.summary())
    assert "not met" in repr(run) and run.to_dict()["mean_pressure"] == mean
    with pytest.raises(pm.NotConverged, match="The pressure measured is not the one asked for"):
        pm.shear_at_pressure(scene, **given)
    # how far off a caller bears is the caller's choice
    far = abs(mean / asked - 1.0)
    wide = pm.shear_at_pressure(scene, **given, pressure_tolerance=2.0 * far + 1.0, check=False)
    assert wide.outcome is not run.outcome


def test_a_flow_whose_packing_fraction_still_drifts_is_not_steady():
    drifting = np.linspace(0.0, 1.0, 400)
    scatter = np.random.default_rng(1).normal(size=400)
    run = PressureShear(
        packing=start(10),
        outcome=pm.Outcome.FINISHED,
        residual=0.0,
        steps=1,
        force_evaluations=1,
        seconds=0.0,
        rate=1e-3,
        pressure=1e-3,
        strain_t=np.arange(400.0),
        shear_stress_t=3e-4 * (1.0 + 0.1 * scatter),
        pressure_t=1e-3 * (1.0 + 0.1 * scatter),
        packing_fraction_t=0.78 + 0.1 * drifting,
        contacts_t=np.full(400, 200),
        sliding_t=np.zeros(400, dtype=np.int64),
        steady_t=np.ones(400, dtype=np.bool_),
    )
    missed = [one.name for one in run.conditions() if not one.met]
    assert missed == ["drift of the packing fraction"]
    still = dataclasses.replace(run, packing_fraction_t=0.78 + 0.01 * scatter)
    assert all(one.met for one in still.conditions())


def test_constant_volume_at_the_same_packing_fraction_has_the_same_stresses(flow):
    scene, run = flow
    fraction = run.mean(run.packing_fraction_t)[0]
    # overlaps are counted in full here, as in the run
    own = scene.packing
    scale = np.sqrt((np.pi * own.radius_n**2).sum() / own.box.volume / fraction)
    same = pm.Packing(own.position_nd * scale, own.radius_n, pm.Box(own.box.lattice_dd * scale))
    curve = pm.steady_shear(
        scene.replace(packing=same), rates=[run.rate], applied_strain=16.0, skip_strain=4.0, samples=1600
    )
    for one, error, (other, more) in (
        (curve.stress_ratio_r[0], curve.stress_error_r[0] / curve.pressure_r[0], run.stress_ratio),
        (curve.pressure_r[0], curve.pressure_error_r[0], run.mean(run.pressure_t)),
    ):
        assert abs(one - other) < 4.0 * np.hypot(error, more)


def test_a_crystal_answers_with_its_shear_modulus():
    packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.ContactDamping(0.3)))
    pressure = pm.pressure(scene)
    run = pm.shear_at_pressure(scene, rate=1e-6, pressure=pressure, applied_strain=2e-4, skip_strain=0.0, answer=30.0)
    modulus = pm.elastic_moduli(scene).shear_modulus
    # to the second order of the strain, and the rate times a viscosity of order one
    slope = np.polyfit(run.strain_t, run.shear_stress_t, 1)[0]
    assert slope == pytest.approx(modulus, rel=2e-3)
    assert run.pressure_t == pytest.approx(pressure, rel=1e-3)


def test_the_mirrored_flow_is_the_mirror_image():
    packing = start(40)
    scene = pm.Scene(packing, RUBBING[:1] + RUBBING[2:])
    swapped = scene.replace(
        packing=pm.Packing(packing.position_nd[:, ::-1], packing.radius_n, pm.Box(packing.box.lattice_dd[::-1, ::-1]))
    )
    settings = {"rate": 0.01, "pressure": 1e-3, "applied_strain": 0.05, "skip_strain": 0.0, "check": False}
    one = pm.shear_at_pressure(scene, **settings)
    other = pm.shear_at_pressure(swapped, axes=(1, 0), **settings)
    # rows go in another order: equal to rounding while trajectories have not parted
    assert other.shear_stress_t == pytest.approx(one.shear_stress_t, rel=1e-6)
    assert other.packing_fraction_t == pytest.approx(one.packing_fraction_t, rel=1e-12)


def test_what_has_no_place_in_a_box_that_dilates_is_refused():
    scene = pm.Scene(start(10), (*RUBBING, pm.Walls(1, 0.0, 5.0, friction=pm.Friction(0.0))))
    with pytest.raises(ValueError, match="would ignore, got Walls"):
        pm.shear_at_pressure(scene, rate=0.1, pressure=1e-3)


def test_time_is_up_with_what_was_reached():
    scene = pm.Scene(start(), RUBBING)
    run = pm.shear_at_pressure(scene, rate=1e-4, pressure=1e-3, applied_strain=50.0, time_limit=0.3, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert 0.0 < run.strain_t[-1] < 50.0
    assert np.isnan(run.stress_ratio).all()
    assert "asked for 0.001" in str(run.summary())


def test_ellipses_that_are_round_are_sheared_at_a_pressure_as_discs_are():
    packing = pm.random_packing(30, dimension=2, packing_fraction=0.85, seed=1)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5))
    how = {"rate": 1e-2, "pressure": 1e-2, "applied_strain": 0.1, "skip_strain": 0.0, "blocks": 2, "check": False}
    round_ones = packing.replace(shapes=pm.Spheroids(np.ones(30), np.eye(2)[[0] * 30]))
    one, other = (pm.shear_at_pressure(pm.Scene(each, effects), **how) for each in (packing, round_ones))
    np.testing.assert_allclose(other.pressure_t, one.pressure_t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.packing_fraction_t, one.packing_fraction_t, rtol=1e-9)
