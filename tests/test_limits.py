"""What no call can do is refused before it begins, and whatever takes long looks at its time limit."""

import time

import numpy as np
import pytest
from arguments import hard_packing, pressed, scene

import packmech as pm
from packmech.jit.compiled import working_time
from packmech.loop.run_loop import RunLoop, run_settings

# calls that would take more steps, more memory or more pressure than there are
ENDLESS = {
    "strain": (
        lambda: pm.steady_shear(scene(), rates=[0.1], applied_strain=1e200, skip_strain=0.1, samples=80),
        r"applied_strain / rate must be at most 1e\+13 steps of",
    ),
    "rate": (
        lambda: pm.ramp_strain(scene(), rate=1e-300, applied_strain=0.1),
        r"applied_strain / rate must be at most 1e\+13 steps of .* got 1e\+299",
    ),
    "frequency": (
        lambda: pm.oscillatory_shear(scene(), amplitude=1e-3, frequency=5e-324, periods=2.0),
        r"periods / frequency must be at most 1e\+13 steps of .* got inf",
    ),
    "period": (
        lambda: pm.equilibrate(scene(), amplitude=1e-3, frequency=1e-300),
        r"1 / frequency must be at most 1e\+13 steps of",
    ),
    "creep": (
        lambda: pm.creep(scene(), stress=1e-3, duration=1e200),
        r"duration must be at most 1e\+13 steps of",
    ),
    "duration": (
        lambda: pm.simulate(scene(), duration=1.0, dt=1e-300),
        r"duration must be at most 1e\+13 steps of 1e-300, got 1",
    ),
    "deform": (
        lambda: pm.deform_at_rate(scene(), rate=1e-300, strain={"xx": -0.1}),
        r"strain / rate must be at most 1e\+13 steps of",
    ),
    "at pressure": (
        lambda: pm.shear_at_pressure(scene(), rate=1e-300, pressure=1e-3, applied_strain=0.1, skip_strain=0.0),
        r"applied_strain / rate must be at most 1e\+13 steps of",
    ),
    "shear jam": (
        lambda: pm.shear_jam(scene(), pressure=1e-3, rate=1e-300, largest_strain=1.0),
        r"step / rate must be at most 1e\+13 steps of",
    ),
    "goals": (
        lambda: pm.quasistatic_shear(pressed(), applied_strain=1e-3, step=1e-300),
        "applied_strain / step must be so small that memory holds it",
    ),
    "cycles": (
        lambda: pm.cyclic_shear(pressed(), 1e-3, step=1e-300),
        "amplitude / step must be so small that memory holds it",
    ),
    "families": (
        lambda: pm.shear_families(hard_packing(), applied_strain=1e200),
        "applied_strain / step must be so small that memory holds it",
    ),
    "steps": (
        lambda: pm.deform(pressed(), strain={"yy": -1e-4}, steps=2**62),
        "steps must be so small that memory holds it",
    ),
    "motion": (
        lambda: pm.play_motion(scene().packing, np.eye(9, 2), steps=2**62),
        "steps must be so small that memory holds it",
    ),
    "memory": (
        lambda: pm.quench(scene(), force_tolerance=1e-6, method=pm.LBFGS(memory=2**60)),
        "method.memory must be so small that memory holds it",
    ),
    "cells": (lambda: pm.reinforced_kagome_packing(10**9), "cells must be so small that memory holds it"),
    "density": (
        lambda: pm.cluster_packing(
            count=2, shape=pm.Trimer(), dimension=2, packing_fraction=1e30, seed=1
        ),
        "packing_fraction must be at most 5, got 1e",
    ),
    "pressure": (
        lambda: pm.shear_stabilize(pressed(), pressure=1e300),
        "pressure must be at most .* no law of contacts holds",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ENDLESS)
def test_what_would_never_end_is_refused_by_name(name):
    call, words = ENDLESS[name]
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize("dt", [10.0, 1e200, 1e308])
def test_however_long_a_time_step_is_the_longest_stable_one_is_named_beside_it(dt):
    run = pm.simulate(scene(), steps=2, dt=dt, check=False)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    stable = run.unmet[0].asked
    # of equal discs omega^2 = 2 k / m; what grows by g in a step has (omega dt)^2 = 2 + g + 1 / g
    mass, stiffness = scene().packing.mass_n[0], pm.Harmonic().energy_scale / scene().packing.diameter_n[0] ** 2
    assert stable == pytest.approx(np.sqrt((2.0 + 1.1 + 1.0 / 1.1) / (2.0 * stiffness / mass)), rel=1e-6)


LATE = {
    "step halving": lambda limit: pm.jam(pressed(), energy_tolerance=0.3, time_limit=limit, check=False),
    "shear": lambda limit: pm.quasistatic_shear(
        pressed(), applied_strain=1.0, step=1e-6, time_limit=limit, check=False
    ),
    "relaxing": lambda limit: pm.shear_stabilize(
        pm.Scene(pm.random_packing(400, dimension=2, packing_fraction=1.0, seed=1), (pm.Repulsion(),)),
        pressure=1e-7, force_tolerance=1e-13, time_limit=limit, check=False,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LATE)
def test_a_protocol_ends_near_its_time_limit(name):
    LATE[name](1e-9)
    began = working_time()
    run = LATE[name](0.3)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert working_time() - began < 2.0


def test_a_part_of_a_call_has_the_time_that_is_left():
    loop = RunLoop(run_settings(time_limit=5.0, check=False))
    until = time.process_time() + 0.05
    while time.process_time() < until:
        pass
    rest = loop.rest()
    assert rest.time_limit < 4.96 and not rest.check
    assert RunLoop(run_settings()).rest().time_limit == np.inf


def test_oscillations_that_no_longer_fall_are_not_waited_for():
    run = pm.equilibrate(scene(), amplitude=1e-3, frequency=0.2, dt=0.2, largest_oscillation=1e-300, check=False)
    assert run.outcome is pm.Outcome.STALLED and run.periods < 500
