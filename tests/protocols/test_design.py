"""Facts about designs: what is asked for is what the scene that comes back measures, at rest, and kept is kept."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import packmech as pm

_SCRIPT = Path(__file__).parents[2] / "recordings" / "design" / "design.py"


def script():
    spec = importlib.util.spec_from_file_location("design_script", _SCRIPT)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bonds_are_taken_away_until_a_network_grows_wide_when_it_is_pulled(seed):
    network = script().network(seed)
    run = pm.design(network, "poisson_ratio", "bonds", at_most=-0.5)
    moduli = pm.elastic_moduli(run.scene)
    assert run.ok and moduli.poisson_ratio == pytest.approx(run.value, rel=1e-9) and run.value <= -0.5
    assert moduli.stable and not moduli.floppy_positions
    # the bonds that are left are those of the start
    kept = network.effects[1].select(np.isin(np.arange(len(network.effects[1])), run.number_k))
    assert kept == run.scene.effects[1] and len(run.scene.effects[1]) == len(network.effects[1]) - run.steps
    assert (np.diff(run.value_t) < 0.0).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sizes_jam_denser_with_the_same_mean_and_deviation(seed):
    sizes = np.random.default_rng(seed).uniform(0.4, 0.7, 32)
    start = pm.random_packing(32, dimension=2, packing_fraction=0.8, seed=seed).replace(radius_n=sizes)
    scene = pm.Scene(start, (pm.Repulsion(law=pm.Harmonic()),))
    run = pm.design(
        scene, "packing_fraction", "radius", at_least=0.88, bounds=(0.35, 0.8), keep="mean and deviation"
    )  # fmt: skip
    radius = run.scene.packing.radius_n
    assert run.ok and run.value >= 0.88 and run.value == pm.packing_fraction(run.packing)
    assert run.value_t[0] < 0.84
    assert radius.mean() == pytest.approx(sizes.mean(), rel=1e-9)
    assert radius.std() == pytest.approx(sizes.std(), rel=1e-9)
    assert radius.min() >= 0.35 and radius.max() <= 0.8
    # it is jammed: contacts bear a state of self stress
    assert pm.states_of_self_stress(pm.remove_rattlers(run.packing)[0], "none").count == 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_masses_open_a_gap_of_frequencies(seed):
    made = script()
    scene = made.dense(seed, 24)
    run = pm.design(scene, made.gap, "mass", at_least=0.2, bounds=(0.25, 4.0))
    frequency = pm.normal_modes(run.scene).frequency_m
    assert frequency[made.MODE] - frequency[made.MODE - 1] >= 0.2 * (1.0 - 1e-12)
    assert run.value_t[0] < 0.1 and run.scene.packing.mass_n.min() >= 0.25
    np.testing.assert_array_equal(run.packing.position_nd, scene.packing.position_nd)


def test_a_goal_out_of_reach_is_said_with_the_best_that_was_found():
    scene = script().dense(1, 24)
    with pytest.raises(pm.NotConverged) as failed:
        pm.design(scene, "pressure", "radius", at_most=-1.0, bounds=(0.49, 0.8), step_limit=5)
    run = failed.value.run
    assert run.outcome in (pm.Outcome.STEP_LIMIT, pm.Outcome.STALLED) and run.value < run.value_t[0]
    assert run.value == pytest.approx(pm.pressure(run.scene), rel=1e-12) and run.residual < 1e-9
    late = pm.design(scene, "pressure", "radius", at_most=-1.0, bounds=(0.49, 0.8), time_limit=1e-6, check=False)
    assert late.outcome is pm.Outcome.TIME_LIMIT


def test_wrong_choices_are_refused_by_name():
    scene = script().dense(1, 24)
    with pytest.raises(ValueError, match="at_most must be left out where at_least is given, got 1.0 and 1.0"):
        pm.design(scene, "pressure", "radius", at_least=1.0, at_most=1.0, bounds=(0.1, 1.0))
    with pytest.raises(ValueError, match=r"scene.effects must hold Bonds for by='bonds'"):
        pm.design(scene, "pressure", "bonds", at_least=1.0)
    with pytest.raises(ValueError, match="bounds must be positive and hold the numbers at the start, got 0.6 to 1 for"):
        pm.design(scene, "pressure", "radius", at_least=1.0, bounds=(0.6, 1.0))


@pytest.mark.parametrize("good", [1, 3])
def test_an_end_for_want_of_packings_is_no_optimum(good):
    scene = script().dense(1, 24)
    made = []

    def fails(one):
        made.append(one)
        if len(made) > good:
            raise ValueError("no more of these")
        found = pm.sensitivity(one, "pressure", "radius")
        return found.value, found.gradient

    radius = scene.packing.radius_n
    limits = {"at_most": -np.inf, "bounds": (0.98 * radius, 1.02 * radius), "keep": "mean"}
    run = pm.design(scene, fails, "radius", check=False, **limits)
    assert run.outcome is pm.Outcome.STALLED and np.isnan(run.value_t).sum() == len(made) - good
    assert "could not be made: no more of these" in str(run.unmet[0])
    # the best is that of the last one that was made
    assert run.value == run.value_t[good - 1] == np.nanmin(run.value_t)
    # with all of them made, it is one
    assert pm.design(scene, "pressure", "radius", **limits).outcome is pm.Outcome.CONVERGED


def test_packings_that_fail_count_as_steps():
    scene = script().dense(1, 24)
    made = []

    def fails(one):
        made.append(one)
        if len(made) > 1:
            raise ValueError("no more of these")
        found = pm.sensitivity(one, "pressure", "radius")
        return found.value, found.gradient

    run = pm.design(scene, fails, "radius", at_most=-np.inf, bounds=(0.3, 0.9), step_limit=4, check=False)
    assert run.outcome is pm.Outcome.STEP_LIMIT and run.steps == len(made) - 1 == 4


def test_packing_fractions_of_what_has_no_hard_packing_are_refused_by_name():
    dimers = pm.cluster_packing(10, pm.Dimer(), dimension=2, packing_fraction=0.7, seed=1)
    ellipses = pm.random_packing(16, dimension=2, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.8, seed=3)
    discs = script().dense(1, 24)
    bonded = (*discs.effects, pm.Bonds([0], [1], [[0, 0]], [1.0], tangential_stiffness=0.0))
    for scene, by, what in (
        (pm.Scene(dimers, discs.effects), "radius", "got one with links"),
        (pm.Scene(ellipses, discs.effects), "aspect", r"got one with shapes \(Spheroids\)"),
        (discs.replace(effects=bonded), "radius", "got one with bonds"),
        (discs, "mass", "by must be 'radius' for objective='packing_fraction' of discs or spheres, got 'mass'"),
    ):
        with pytest.raises(ValueError, match=what):
            pm.design(scene, "packing_fraction", by, at_least=0.9, bounds=(0.01, 9.0))
