"""Shear jamming: friction lets loose packings bear shear after a finite strain; without it they flow."""

import numpy as np
import pytest

import packmech as pm

SETTINGS = {"pressure": 1e-4, "step": 0.02, "rate": 2e-3, "largest_strain": 0.3}


def loose(mu, fraction, seed=3):
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=seed)
    rest = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-6).packing
    return pm.Scene(rest, (pm.Repulsion(), pm.Friction(mu, 0.5, 0.1), pm.ContactDamping(0.3)))


@pytest.fixture(scope="module")
def jammed():
    scene = loose(1.0, 0.8)
    return scene, pm.shear_jam(scene, **SETTINGS)


def test_without_friction_a_loose_packing_flows():
    run = pm.shear_jam(loose(0.0, 0.8), **SETTINGS)
    assert run.outcome is pm.Outcome.UNJAMMED
    assert run.report["strain"] == pytest.approx(0.3)
    assert run.report["pressure_t"].max() < 1e-2 * SETTINGS["pressure"]


def test_with_friction_it_jams_after_a_finite_strain(jammed):
    scene, run = jammed
    assert run.outcome is pm.Outcome.CONVERGED
    report = run.report
    assert 0.0 < report["strain"] < 0.3
    # loose at every rest before
    assert (report["pressure_t"][:-1] < SETTINGS["pressure"]).all()
    assert report["pressure_t"][-1] >= SETTINGS["pressure"]
    assert pm.packing_fraction(run.packing) == pytest.approx(pm.packing_fraction(scene.packing), rel=1e-3)


def test_what_is_jammed_is_in_balance_and_anisotropic(jammed):
    scene, run = jammed
    forces = pm.contact_forces(scene.replace(packing=run.packing))
    assert forces.residual <= 1e-6
    assert run.residual == forces.residual
    # the flow pushes along one diagonal
    stress = forces.stress_dd
    anisotropy = np.ptp(np.linalg.eigvalsh(0.5 * (stress + stress.T))) / (2.0 * forces.pressure)
    assert run.report["stress_anisotropy"] == pytest.approx(anisotropy, rel=1e-4)
    assert 0.1 < anisotropy < 1.0
    assert stress[0, 1] > 0.0
    # enough contacts to balance forces and torques
    assert forces.coordination_number >= forces.isostatic_coordination - 0.1


def test_a_jammed_start_is_told_at_once(jammed):
    scene, run = jammed
    again = pm.shear_jam(scene.replace(packing=run.packing), **SETTINGS)
    assert again.outcome is pm.Outcome.CONVERGED
    assert again.report["strain"] == 0.0


def test_limits_are_outcomes():
    scene = loose(1.0, 0.78)
    few = pm.shear_jam(scene, **SETTINGS, step_limit=1000, check=False)
    assert few.outcome is pm.Outcome.STEP_LIMIT
    assert few.steps <= 1000
    late = pm.shear_jam(scene, **SETTINGS, time_limit=1e-3, check=False)
    assert late.outcome is pm.Outcome.TIME_LIMIT
    with pytest.raises(ValueError, match="would ignore, got Walls"):
        pm.shear_jam(
            scene.replace(effects=(*scene.effects, pm.Walls(1, 0.0, 5.0, friction=pm.Friction(0.0)))), **SETTINGS
        )
