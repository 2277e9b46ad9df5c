"""Facts about what Quench-v0 asks, observes and pays, from its formulas: few packings, hardly a relaxation."""

import math

import numpy as np
import pytest
from packmech_envs.quench import INFOS, TERMS, QuenchEpisodes, QuenchReward, QuenchTask, pressed

import packmech as pm


def discs(size=1.0, energy_scale=1.0, particles=12):
    packing = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=3)
    packing = pm.Packing(packing.position_nd * size, packing.radius_n * size, pm.Box(packing.box.lattice_dd * size))
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic(energy_scale)),))


def episodes(scene=None, count=2, **options):
    found = QuenchEpisodes(count, discs() if scene is None else scene, QuenchTask(**options))
    found.start(range(count), [np.random.default_rng(k) for k in range(count)], None)
    return found


# -- options


def test_options_that_are_left_out_are_those_that_are_written_down():
    task = QuenchTask()
    assert (task.step_budget, task.evaluation_budget, task.relax, task.verdict) == (40, 50_000, "full", "collective")
    assert (task.largest_change, task.largest_strain, task.force_tolerance) == (0.05, 0.05, 1e-8)
    assert task.weights == QuenchReward(0.25, 0.1, 5.0, 0.0, 0.0)
    assert QuenchTask(reward="progress").weights == QuenchReward(0.0, 0.1, 5.0, 1.0, 0.1)


def test_starts_are_between_numbers_that_rise_and_inside_the_limits():
    assert QuenchTask(start_packing_fraction=(0.7, 0.7)).start_packing_fraction == (0.7, 0.7)
    for bad in ((0.8, 0.7), (0.7,), (0.7, 0.8, 0.9)):
        with pytest.raises(ValueError, match="start_packing_fraction must be a"):
            QuenchTask(start_packing_fraction=bad)
    limits = {"packing_fraction_limits": (0.6, 0.95)}
    assert episodes(start_packing_fraction=(0.6, 0.95), **limits).batch.packing_fraction_b.min() >= 0.6
    for bad in ((0.5, 0.8), (0.7, 0.96), 0.5, 0.99):
        with pytest.raises(ValueError, match=r"start_packing_fraction must lie inside the limits \(0\.6, 0\.95\), got"):
            episodes(start_packing_fraction=bad, **limits)


def test_a_start_from_the_scene_is_its_packing_at_its_packing_fraction_or_at_another_one():
    scene = discs()
    same = episodes(scene, start="scene", relax=1)
    assert same.packing(0) == scene.packing and same.packing(1) == scene.packing
    other = episodes(scene, start="scene", relax=1, start_packing_fraction=0.7).packing(0)
    assert abs(pm.packing_fraction(other) - 0.7) < 1e-14
    factor = math.sqrt(pm.packing_fraction(scene.packing) / 0.7)
    assert np.allclose(other.position_nd, scene.packing.position_nd * factor, rtol=1e-14, atol=1e-14)
    drawn = episodes(scene, relax=1, start_packing_fraction=0.7)
    assert not np.array_equal(drawn.packing(0).position_nd, drawn.packing(1).position_nd)
    assert np.allclose([pm.packing_fraction(drawn.packing(b)) for b in range(2)], 0.7, rtol=1e-14)


def test_the_largest_pressure_is_a_tenth_over_particles_squared_and_the_smallest_change_a_tenth_of_it_or_itself():
    largest = 0.1 / 144
    for actions, share in (("continuous", 0.1), ("steps", 1.0)):
        found = episodes(actions=actions, relax=1)
        assert found.largest_pressure == largest
        assert np.isclose(found.smallest_change, share * largest, rtol=1e-15, atol=0.0)
    assert episodes(largest_pressure=1e-3, relax=1).smallest_change == 1e-4
    assert episodes(largest_pressure=1e-3, smallest_change=1e-7, relax=1).smallest_change == 1e-7
    # never above the largest
    assert episodes(largest_pressure=10.0, relax=1).smallest_change == 0.05


# -- actions


@pytest.mark.parametrize("wanted", [(0.05, -0.05), (-0.05, 0.05), (3e-5, 0.0), (-1e-9, 2e-3)])
def test_an_action_made_for_a_change_and_a_strain_asks_for_them(wanted):
    found = episodes(relax=1)
    action = found.action(*wanted)
    assert np.abs(action).max() <= 1.0 and found.action_space.contains(action)
    change, strain = found._asked(action[None])
    assert np.allclose((change[0], strain[0]), wanted, rtol=1e-12, atol=0.0)
    for name, bad in (("packing_fraction_change", (0.051, 0.0)), ("shear_strain", (0.0, -0.051))):
        with pytest.raises(ValueError, match=f"{name} must be within 0.05, got"):
            found.action(*bad)


def test_steps_are_the_largest_change_halved_so_often_up_or_down():
    found = episodes(actions="steps", largest_change=0.04, smallest_change=0.01, relax=1)
    assert found.action_space.nvec.tolist() == [2, 3] and found.action_names == ("compress", "halvings")
    change, strain = found._asked(np.array([[1, 0], [0, 0], [1, 1], [0, 2]]))
    assert change.tolist() == [0.04, -0.04, 0.02, -0.01] and strain.tolist() == [0.0] * 4
    assert found.action(0.04, 0.0).tolist() == [1, 0] and found.action(-0.01, 0.0).tolist() == [0, 2]
    # the nearest there is
    assert found.action(1e-5, 0.0).tolist() == [1, 2]
    with pytest.raises(ValueError, match="packing_fraction_change must be other than 0 with actions='steps', got 0"):
        found.action(0.0, 0.0)
    with pytest.raises(ValueError, match="shear_strain must be 0 with actions='steps', got 0.01"):
        found.action(0.04, 0.01)
    # one of them may be as large as a number that is no change
    assert found.action(0.04, 0).tolist() == [1, 0]


def test_actions_are_two_numbers_between_minus_one_and_one():
    space = episodes(relax=1).action_space
    assert space.shape == (2,) and (space.low == -1.0).all() and (space.high == 1.0).all()


# -- observations


@pytest.mark.parametrize(("size", "energy_scale"), [(1.0, 1.0), (3.0, 0.25)])
def test_observations_are_in_units_of_the_scene_so_that_these_change_none(size, energy_scale):
    def seen(scene):
        found = episodes(scene, start="scene", relax=1, start_packing_fraction=0.95, largest_pressure=1e-3)
        return found, found.observation_bk[0]

    found, row = seen(discs(size, energy_scale))
    assert np.allclose(row, seen(discs())[1], rtol=1e-11, atol=1e-11)
    scene = found.scene(0).replace(packing=found.packing(0))
    unit, diameter = scene.energy_scale, scene.packing.reference_diameter
    force = float(np.sqrt((pm.forces(scene) ** 2).sum(axis=1)).max())
    expected = {
        "packing_fraction": 0.95,
        "log_energy": math.log10(pm.energy(scene) / (12 * unit)),
        "log_pressure": math.log10(pm.pressure(scene) / scene.pressure_unit),
        "log_max_force": math.log10(force * diameter / unit),
        "stress_xy": pm.stress_tensor(scene)[0, 1] / scene.pressure_unit,
    }
    for name, value in expected.items():
        assert np.isclose(row[found.observation_names.index(name)], value, rtol=1e-11, atol=1e-11), name


def test_bounds_of_observations_are_those_of_jammed_packings_and_two_decades_below():
    found = episodes(largest_pressure=1e-3, bracket=True, shear_modulus=True, packing_fraction_limits=(0.1, 2.0))
    low, high = found.observation_space.low, found.observation_space.high
    bound = {name: (low[k], high[k]) for k, name in enumerate(found.observation_names)}
    assert np.allclose(bound["log_pressure"], (-5.0, 4.0)) and np.allclose(bound["log_energy"], (-10.0, 4.0))
    assert bound["log_max_force"] == (-16.0, 4.0) and bound["excess_contacts"] == (-2.0, 50.0)
    assert bound["stress_xx"] == bound["stress_xy"] == bound["shear_modulus"] == (-1e4, 1e4)
    assert np.allclose(bound["log_bracket"], (-4.0, 0.0)) and bound["packing_fraction"] == (0.1, 2.0)


def test_far_from_contact_logarithms_are_at_their_bounds_and_nothing_is_jammed():
    found = episodes(start_packing_fraction=0.2, packing_fraction_limits=(0.1, 1.0), largest_pressure=1e-3)
    row = dict(zip(found.observation_names, found.observation_bk[0], strict=True))
    assert np.isclose(row["log_pressure"], -5.0) and np.isclose(row["log_energy"], -10.0)
    assert row["log_max_force"] == -16.0
    assert found._pressure().tolist() == [0.0, 0.0] and not found.terminated_b.any()


# -- rewards


def test_the_reward_pays_decades_evaluations_verdicts_progress_and_steps_by_their_weights():
    reward = QuenchReward(2.0, 3.0, 5.0, 7.0, 11.0)
    terms = reward.terms(np.array([1.0, 4.0]), np.array([500, 2000]), np.array([False, True]), np.array([0.5, -0.25]))
    assert {name: value.tolist() for name, value in terms.items()} == {
        "reward_distance": [-2.0, -8.0],
        "reward_evaluations": [-1.5, -6.0],
        "reward_stability": [0.0, 5.0],
        "reward_progress": [3.5, -1.75],
        "reward_steps": [-11.0, -11.0],
    }


def test_the_distance_is_in_decades_above_the_largest_pressure_and_four_where_no_pressure_is_observed():
    pressure = np.array([1e-2, 1e-4, 1e-5, 1.01e-6, 1e-6, 0.0, -1.0])
    assert np.allclose(QuenchReward.distance(pressure, 1e-4), [2.0, 0.0, 0.0, 0.0, 4.0, 4.0, 4.0])
    assert pressed(pressure, 1e-4).tolist() == [True] * 4 + [False] * 3


def test_a_bracket_is_between_what_was_seen_last_without_pressure_and_with_it(monkeypatch):
    found = episodes(count=4, relax="full", bracket=True, largest_pressure=1e-3, smallest_change=1e-4)
    found._below_b[:], found._above_b[:] = np.nan, np.nan

    def see(fractions, pressures):
        monkeypatch.setattr(type(found.batch), "packing_fraction_b", np.array(fractions))
        return found._close_in(np.arange(4), np.array(pressures))

    # nothing is known of a bracket that has one side
    assert see([0.8, 0.8, 0.9, 0.8], [0.0, 0.0, 1.0, 0.0]).tolist() == [0.0] * 4
    assert np.allclose(found._decades_open(), 0.0)
    # the other side: a bracket of a tenth is one decade narrower than none
    assert np.allclose(see([0.9, 0.85, 0.8, 0.80001], [1.0, 0.0, 0.0, 1.0]), [1.0, 0.0, 1.0, 4.0])
    assert np.allclose(see([0.81, 0.85, 0.8, 0.9], [0.0, 0.0, 0.0, 0.0]), [math.log10(0.1 / 0.09), 0.0, 0.0, -4.0])
    # what pressed below what did not press forgets that
    assert np.isnan(found._above_b[3]) and found._below_b[3] == 0.9
    see([0.8, 0.85, 0.9, 0.85], [1.0, 0.0, 0.0, 1.0])
    assert np.isnan(found._below_b[0]) and found._above_b[0] == 0.8
    assert np.isnan(found._above_b[2]) and np.isnan(found._below_b[3])


def test_a_bracket_is_kept_where_it_is_observed_or_paid_for():
    assert not episodes(relax=1)._brackets and episodes(bracket=True)._brackets
    assert episodes(reward="progress")._brackets
    assert episodes(reward=QuenchReward(progress_weight=0.5))._brackets
    assert not episodes(reward=QuenchReward(progress_weight=0.0))._brackets


def test_budgets_of_steps_and_of_evaluations_are_each_spent_when_reached():
    found = episodes(step_budget=3, evaluation_budget=100, relax=1)
    found._steps_b[:], found._evaluations_b[:] = [2, 3], [99, 0]
    assert found._spent().tolist() == [False, True]
    found._steps_b[:], found._evaluations_b[:] = [0, 0], [100, 99]
    assert found._spent().tolist() == [True, False]
    endless = episodes(step_budget=None, evaluation_budget=None, relax=1)
    endless._steps_b[:] = endless._evaluations_b[:] = 10**9
    assert not endless._spent().any()


class Answer:
    """Collectively jammed, and not strictly."""

    collective, strict = "jammed", "not jammed"


@pytest.mark.parametrize(("verdict", "ended"), [("collective", True), ("strict", False)])
def test_what_presses_little_is_relaxed_and_has_contacts_enough_is_asked_for_its_verdict(monkeypatch, verdict, ended):
    found = episodes(count=5, largest_pressure=1e-3, verdict=verdict)
    asked = []
    monkeypatch.setattr(pm, "classify_jamming", lambda scene: asked.append(scene) or Answer())
    monkeypatch.setattr(type(found.batch), "relaxed_b", np.array([True, True, True, True, False]))
    monkeypatch.setattr(type(found.batch), "excess_contacts_b", np.array([0, -1, 3, 0, 0]))
    found._verify(np.arange(5), np.array([1e-3, 1e-4, 1.1e-3, 0.0, 1e-4]))
    assert found.terminated_b.tolist() == [ended, False, False, False, False]
    assert [scene.packing for scene in asked] == [found.packing(0)]


def test_infos_have_their_names():
    assert tuple(episodes(relax=1).infos()) == INFOS and set(TERMS) < set(INFOS)
