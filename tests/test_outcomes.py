"""How runs end: the limit that was met, the condition that was not, and both figures of it in the error."""

import pickle

import pytest

import packmech as pm

BIDISPERSE = pm.Bidisperse(ratio=1.4)


SMOOTH = (pm.Repulsion(),)


def scene(particles=48, packing_fraction=0.8, effects=SMOOTH):
    packing = pm.random_packing(particles, dimension=2, sizes=BIDISPERSE, packing_fraction=packing_fraction, seed=1)
    return pm.Scene(packing, effects)


@pytest.fixture(scope="module")
def jammed():
    return scene().replace(packing=pm.jam(scene(), pressure=1e-3).packing)


DAMPED = (pm.Repulsion(), pm.BackgroundDamping(0.1))
ROUGH = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(0.5, damping=0.1))
LATE = {
    "quench": lambda _, **given: pm.quench(scene(packing_fraction=0.95), force_tolerance=1e-12, **given),
    "jam": lambda _, **given: pm.jam(scene(), pressure=1e-4, **given),
    "jam with friction": lambda _, **given: pm.jam(scene(effects=ROUGH), pressure=1e-4, **given),
    "shear_stabilize": lambda _, **given: pm.shear_stabilize(scene(packing_fraction=0.95), **given),
    "compress": lambda jammed, **given: pm.compress(jammed, [1e-2], **given)[-1],
    "sweep_pressure": lambda jammed, **given: pm.sweep_pressure(jammed, [1e-2], **given)[-1],
    "tap": lambda jammed, **given: pm.tap(jammed, 0.05, 2, seed=1, pressure=1e-3, **given)[-1],
    "quasistatic_shear": lambda jammed, **given: pm.quasistatic_shear(jammed, 0.1, **given),
    "deform": lambda jammed, **given: pm.deform(jammed, strain={"yy": -0.01}, **given),
    "deform_at_rate": lambda jammed, **given: pm.deform_at_rate(
        jammed.replace(effects=ROUGH), rate=1e-6, strain={"yy": -0.01}, **given
    ),
    "shear_families": lambda jammed, **given: pm.shear_families(jammed.packing, 0.1, **given),
    "simulate": lambda jammed, **given: pm.simulate(jammed, steps=10**7, **given),
    "ramp_strain": lambda jammed, **given: pm.ramp_strain(
        jammed.replace(effects=DAMPED), rate=1e-6, applied_strain=0.1, **given
    ),
    "shear_at_pressure": lambda jammed, **given: pm.shear_at_pressure(
        jammed.replace(effects=ROUGH), rate=1e-5, pressure=1e-3, **given
    ),
}


@pytest.mark.parametrize("name", LATE)
def test_a_run_whose_time_is_up_names_the_time_limit_and_what_it_did_not_reach(name, jammed):
    run = LATE[name](jammed, time_limit=1e-9, check=False)
    assert run.outcome.name == "TIME_LIMIT" and not run.ok
    assert "raise time_limit" in run.outcome.value and "outside" not in run.outcome.value
    assert run.unmet and not any(one.met for one in run.unmet)
    assert all(f"{one.asked:.4g}" in run.to_dict()["unmet"] for one in run.unmet)


def test_an_error_says_the_unmet_condition_with_the_figure_reached_and_the_one_asked_for():
    with pytest.raises(pm.NotConverged) as caught:
        pm.jam(scene(), pressure=1e-4, time_limit=1e-9)
    pressure = next(one for one in caught.value.run.unmet if one.name == "pressure")
    assert pressure.asked == 1e-4
    assert pressure.reached == pytest.approx(caught.value.run.report["pressure"], rel=1e-15)
    assert f"pressure {pressure.reached:.4g} where 0.0001 was asked for" in str(caught.value)


def test_a_step_limit_says_the_residual_and_the_tolerance():
    with pytest.raises(pm.NotConverged, match=r"raise step_limit.*force residual .* where 1e-12 at most is allowed"):
        pm.quench(scene(packing_fraction=0.95), force_tolerance=1e-12, method=pm.Fire(), step_limit=10)


def test_a_balanced_packing_short_of_its_pressure_names_the_pressure_alone():
    # what follows the pressure of linked packings stops where it finds no way down
    run = pm.jam(scene(), pressure=1e-4, check=False)
    short = pm.result.unmet_conditions(
        pm.Outcome.STALLED,
        pm.result.Condition("force residual", run.residual, 1e-5),
        pm.result.Condition("pressure", 5e-4, 1e-4, 1e-6),
    )
    assert [str(one) for one in short] == ["pressure 0.0005 where 0.0001 was asked for"]


def test_a_success_has_no_unmet_condition(jammed):
    run = pm.quench(jammed, force_tolerance=1e-10)
    assert run.ok and run.unmet == () and "unmet" not in run.to_dict()


def test_a_word_of_the_outcome_is_the_one_of_the_table(jammed):
    run = pm.simulate(jammed, steps=10**7, time_limit=1e-9, check=False)
    names = [row[0] for row in run.rows()]
    assert names[:2] == ["outcome", "not met"] and run.rows()[0][1] == "time limit"


def test_a_lower_bound_is_met_from_above_and_named_as_one():
    low = pm.Condition("shear modulus", 0.1, 5.0, lower=True)
    assert not low.met and str(low) == "shear modulus 0.1 where 5 at least was asked for"
    assert pm.Condition("shear modulus", 5.5, 5.0, lower=True).met


def test_an_error_goes_to_another_process_with_what_was_reached():
    with pytest.raises(pm.NotConverged) as caught:
        pm.quench(scene(packing_fraction=0.9), force_tolerance=1e-10, method=pm.Fire(), step_limit=3)
    caught.value.finished = 3
    found = pickle.loads(pickle.dumps(caught.value))
    assert str(found) == str(caught.value) and found.run.outcome is pm.Outcome.STEP_LIMIT and found.finished == 3
    assert found.run.packing == caught.value.run.packing
