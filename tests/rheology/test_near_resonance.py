"""Oscillations whose frequency is near that of a mode: what leads the stress there, and what the run says of it."""

import dataclasses

import numpy as np
import pytest

import packmech as pm
from packmech.rheology.oscillatory import _judged


@pytest.fixture(scope="module")
def ellipses():
    """Return jammed ellipses, whose turns are soft modes."""
    start = pm.random_packing(32, dimension=2, packing_fraction=0.6, seed=1, shapes=pm.Ellipses(1.5))
    jammed = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-2, strain="isotropic").packing
    return pm.Scene(jammed, (pm.Repulsion(), pm.ContactDamping(0.1)))


def sheared(scene, relative_frequency):
    return pm.oscillatory_shear(scene, amplitude=1e-6, relative_frequency=relative_frequency, periods=5, check=False)


def test_a_frequency_among_those_of_the_modes_is_no_success_and_says_that_motion_leads_the_stress(ellipses):
    run = sheared(ellipses, 0.01)
    # the lowest mode stands just below it
    assert pm.normal_modes(ellipses.without(pm.ContactDamping), 8).frequency_m[0] < 2.0 * np.pi * run.frequency
    assert run.outcome.name in ("NOT_STEADY", "NEAR_RESONANCE") and not run.ok
    assert run.unmet and run.kinetic_share > 1.0
    assert "not met" in repr(run) and run.to_dict()["kinetic_share"] == run.kinetic_share
    with pytest.raises(pm.NotConverged, match="Not met"):
        pm.oscillatory_shear(ellipses, amplitude=1e-6, relative_frequency=0.01, periods=5)


@pytest.mark.parametrize("relative_frequency", [0.005, 0.007, 0.1])
def test_moduli_that_inertia_changes_say_so_where_they_are_printed(ellipses, relative_frequency):
    run = sheared(ellipses, relative_frequency)
    static = pm.elastic_moduli(ellipses.without(pm.ContactDamping)).cauchy[2, 2] / 2.0
    assert abs(run.moduli.storage / static - 1.0) > 0.15
    assert run.kinetic_share > 0.25 and "no moduli of a slow strain" in repr(run)


def test_a_slow_oscillation_has_the_static_modulus_and_little_kinetic_energy(ellipses):
    run = sheared(ellipses, 0.001)
    assert run.outcome is pm.Outcome.FINISHED and run.unmet == ()
    assert run.kinetic_share < 0.05 and "no moduli of a slow strain" not in repr(run)
    found = pm.elastic_moduli(ellipses.without(pm.ContactDamping)).cauchy
    assert run.moduli.storage == pytest.approx(found[2, 2] / 2.0, rel=0.05)


def test_a_negative_storage_modulus_beyond_its_error_is_a_stress_led_by_inertia(ellipses):
    slow = sheared(ellipses, 0.001)
    turned = {name: -value for name, value in slow.stress.items()}
    upside_down = dataclasses.replace(slow, stress=turned)
    judged = _judged(dataclasses.replace(upside_down, moduli=upside_down.demodulated()))
    assert judged.outcome.name == "NEAR_RESONANCE"
    assert [one.name for one in judged.unmet] == ["negative G'"]
