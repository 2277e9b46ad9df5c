"""Quench-v0: the interface, complete resets, the protocols of scripts, and what it does with whatever it is given."""

import math
import warnings
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.quench import TERMS, QuenchReward, QuenchTask
from packmech_envs.single import QuenchEnv

import packmech as pm


@cache
def discs(particles=16):
    packing = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    return pm.Scene(packing, (pm.Repulsion(),))


@cache
def trimers():
    packing = pm.cluster_packing(6, pm.Trimer(), dimension=2, packing_fraction=0.4, seed=3, largest_overlap=0.1)
    return pm.Scene(packing, (pm.Repulsion(),))


def episode(env, seed, actions):
    """Return all that an episode tells, as arrays."""
    observation, info = env.reset(seed=seed)
    answer = [(observation, 0.0, False, False, *info.values())]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        answer.append((observation, reward, terminated, truncated, *info.values()))
    return [np.concatenate([np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in row]) for row in answer]


def checked(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"scene": trimers()},
        {"scene": "triangular", "start": "scene"},
        {"relax": 5, "shear_modulus": True},
        {"actions": "steps", "bracket": True, "reward": "progress"},
    ],
    ids=["default", "links", "lattice", "steps", "to learn"],
)
def test_the_checker_passes(arguments):
    checked(gym.make("packmech_envs:packmech/Quench-v0", **arguments))


@pytest.mark.slow
@pytest.mark.parametrize("scene", pm.list_scenes())
def test_the_checker_passes_for_every_shipped_scene(scene):
    checked(
        gym.make("packmech_envs:packmech/Quench-v0", scene=scene, bonds="leave out", friction="leave out", relax=20)
    )


def test_scenes_with_bonds_are_refused_unless_they_are_to_be_left_out():
    with pytest.raises(ValueError, match="scene must have no bonds here.*leave out"):
        QuenchEnv("bulk", friction="leave out")


def test_observations_are_float64_and_named():
    env = QuenchEnv(discs(), shear_modulus=True)
    observation, _ = env.reset(seed=1)
    assert observation.dtype == np.float64 and len(observation) == len(env.observation_names)
    assert env.observation_names[-4:] == ("stress_xx", "stress_yy", "stress_xy", "shear_modulus")


def test_observations_are_the_measures_of_the_packing():
    env = QuenchEnv(discs(), shear_modulus=True)
    env.reset(seed=2)
    for _ in range(5):
        observation, *_ = env.step(env.action(0.04, 0.01))
    seen = dict(zip(env.observation_names, observation, strict=True))
    scene = env.scene.replace(packing=env.packing)
    assert seen["packing_fraction"] == pytest.approx(pm.packing_fraction(scene.packing), rel=1e-13)
    assert 10 ** seen["log_energy"] == pytest.approx(pm.energy(scene) / 16, rel=1e-10)
    assert 10 ** seen["log_pressure"] == pytest.approx(pm.pressure(scene), rel=1e-10)
    assert seen["stress_xy"] == pytest.approx(pm.stress_tensor(scene)[0, 1], rel=1e-9)
    assert seen["shear_modulus"] == pytest.approx(pm.elastic_moduli(scene).shear_modulus, rel=1e-9)


@pytest.mark.parametrize("change", [0.0, 1e-9, -3e-7, 2e-4, -0.05, 0.05])
def test_an_action_made_for_a_change_makes_that_change(change):
    env = QuenchEnv(discs())
    env.reset(seed=1)
    before = env.run.report["packing_fraction"]
    *_, info = env.step(env.action(change, 0.02))
    assert info["packing_fraction"] - before == pytest.approx(change, abs=1e-15 + 1e-13 * abs(change))
    assert info["shear_strain"] == pytest.approx(0.02, rel=1e-12)


@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    numbers=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=8),
    relax=st.sampled_from(["full", 4]),
    linked=st.booleans(),
)
def test_a_reset_with_the_same_seed_gives_the_same_bits_alone_and_in_batches(seed, numbers, relax, linked):
    scene = trimers() if linked else discs()
    env = QuenchEnv(scene, relax=relax, step_budget=None, evaluation_budget=None, render_mode="rgb_array")
    actions = [np.array(pair) for pair in numbers]
    first = episode(env, seed, actions)
    env.step([0.3, -0.2])
    env.render()
    second = episode(env, seed, actions)
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    for threads in (1, 2):
        envs = QuenchVectorEnv(
            3, scene, relax=relax, step_budget=None, evaluation_budget=None, autoreset_mode="Disabled", threads=threads
        )
        # the second of three environments gets the seed of the single one
        observations = [envs.reset(seed=seed - 1 if seed else [7, 0, 8])[0][1]]
        rewards = [0.0]
        for action in actions:
            observation, reward, terminated, _, _ = envs.step(np.stack([-action, action, 0.5 * action]))
            observations.append(observation[1])
            rewards.append(reward[1])
            envs._done_b[:] = False
        for k, row in enumerate(first):
            assert np.array_equal(row[: observations[k].size], observations[k])
            assert row[observations[k].size] == rewards[k]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    "more", [{}, {"actions": "steps", "bracket": True, "reward": "progress"}], ids=["", "to learn"]
)
def test_the_batch_is_so_many_single_environments_through_autoresets(mode, more):
    from gymnasium.vector import AutoresetMode

    arguments = {"scene": discs(), "step_budget": 4, "largest_pressure": 1e-3, **more}
    mine = QuenchVectorEnv(3, **arguments, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: QuenchEnv(**arguments)] * 3, autoreset_mode=AutoresetMode(mode))
    rng = np.random.default_rng(1)
    assert np.array_equal(mine.reset(seed=5)[0], theirs.reset(seed=5)[0])
    for _ in range(14):
        actions = rng.integers(0, [2, 5], (3, 2)) if more else rng.uniform(-1.0, 1.0, (3, 2))
        one, other = mine.step(actions), theirs.step(actions)
        for a, b in zip(one[:4], other[:4], strict=True):
            assert np.array_equal(a, b)
        assert set(one[4]) == set(other[4])
        for name in ("pressure", "reward_distance", "reward_progress", "jammed"):
            assert (one[4].get(name) is None) == (other[4].get(name) is None)
            if name in one[4]:
                assert np.array_equal(one[4][name], other[4][name])


def step_halving(env, increment, energy_tolerance, most=2000):
    """Replay pm.StepHalving through actions; return whether its window of energies was met."""
    side = 0
    for _ in range(most):
        energy = env.run.trace.energy_t[-1] / (env.packing.particles * env.scene.energy_scale)
        if energy_tolerance < energy < 2.0 * energy_tolerance:
            return True
        now = 1 if energy >= 2.0 * energy_tolerance else -1
        if side and now != side:
            increment *= 0.5
        side = now
        env.step(env.action(-side * increment))
    return False


@pytest.mark.parametrize("scene", [discs(), trimers()], ids=["discs", "trimers"])
def test_a_scripted_episode_reaches_the_packing_fraction_of_jam(scene):
    fraction, increment, tolerance = (0.8, 5e-3, 1e-10) if scene is discs() else (0.7, 1e-2, 1e-10)
    start = scene.packing
    if scene is trimers():
        # scaled as the protocol scales it: clusters keep their shape
        start = pm.scattered_packing(start, packing_fraction=fraction, seed=4, largest_overlap=0.3)
    else:
        factor = (pm.packing_fraction(start) / fraction) ** 0.5
        start = start.replace(position_nd=start.position_nd * factor, box=start.box.scaled(factor))
    scene = scene.replace(packing=start)
    method = pm.StepHalving(
        start_packing_fraction=fraction, increment=increment, energy_tolerance=tolerance, quench_tolerance=1e-8
    )
    run = pm.jam(scene, strain="isotropic", method=method, check=False)
    assert run.outcome is pm.Outcome.CONVERGED
    env = QuenchEnv(
        scene, start="scene", force_tolerance=1e-8, force_floor=1e-2 * np.sqrt(tolerance),
        step_budget=None, evaluation_budget=None,
    )  # fmt: skip
    env.reset()
    assert step_halving(env, increment, tolerance)
    # both take the same steps up and down, so that the packing fraction is the same but for the rounding of each step
    assert env.run.report["packing_fraction"] == pytest.approx(run.report["packing_fraction"], abs=1e-12)
    assert len(env.run.trace.step_t) == run.report["compression_steps"]


def press(env):
    """Compress, or expand in proportion to the pressure that is too much, until jammed; return the last step."""
    aim, up = env.largest_pressure, 0.02
    answer = env.step(env.action(up))
    for _ in range(80):
        now = answer[4]["pressure"] / env.scene.pressure_unit
        if answer[2]:
            break
        if now < 1e-12:
            answer = env.step(env.action(up))
            up = max(0.7 * up, 1e-3)
            continue
        if now <= aim:
            # pressed so much, gaps might still be closed by it
            aim *= 0.5
        answer = env.step(env.action(max(-(now - 0.5 * aim) / 0.4, -0.05)))
    return answer


def test_an_episode_unjams_and_rejams():
    env = QuenchEnv(step_budget=None, evaluation_budget=None)
    env.reset(seed=4)
    *_, terminated, _, info = press(env)
    assert terminated and info["jammed"] and info["reward_stability"] == 5.0
    assert pm.classify_jamming(env.packing).collective == "jammed"
    first = info["packing_fraction"]
    *_, terminated, _, info = env.step(env.action(-0.02))
    assert not terminated and not info["jammed"] and info["pressure"] == 0.0
    assert info["reward_stability"] == 0.0
    *_, terminated, _, info = press(env)
    assert terminated and info["jammed"]
    assert info["packing_fraction"] == pytest.approx(first, abs=0.01)


@pytest.mark.parametrize("law", [pm.Harmonic(), pm.Hertz()], ids=["harmonic", "hertz"])
def test_a_packing_is_judged_by_the_law_of_its_scene(law):
    env = QuenchEnv(discs().replace(effects=(pm.Repulsion(law=law),)), step_budget=80, evaluation_budget=None)
    env.reset(seed=1)
    change, over = 0.02, False
    while not over:
        *_, terminated, truncated, info = env.step(env.action(change))
        if (info["pressure"] > 1e-9) == (change > 0.0):
            change *= -0.5
        over = terminated or truncated
    assert terminated and info["jammed"]
    assert pm.classify_jamming(env.scene.replace(packing=env.packing)).collective == "jammed"


def test_the_reward_is_the_sum_of_its_named_terms_and_weights_scale_them():
    env = QuenchEnv(discs(), reward=QuenchReward(0.5, 2.0, 7.0))
    env.reset(seed=1)
    for action in ([0.9, 0.1], [0.9, 0.0], [1.0, 0.0]):
        _, reward, _, _, info = env.step(action)
        assert reward == sum(info[name] for name in TERMS)
        assert info["reward_evaluations"] == pytest.approx(-2.0 * info["force_evaluations"] / 1000)
        decades = 4.0 if info["pressure"] == 0 else max(0.0, np.log10(info["pressure"] / env.largest_pressure))
        assert info["reward_distance"] == pytest.approx(-0.5 * decades)


def test_progress_adds_up_to_the_decades_by_which_the_bracket_narrowed_less_the_steps():
    env = QuenchEnv(discs(), reward=QuenchReward(0.0, 0.0, 0.0, progress_weight=3.0, step_weight=0.5))
    env.reset(seed=1)
    gained, below, above, pressed = [], env.run.report["packing_fraction"], math.nan, False
    for size in (0.05, 0.05, 0.05, 0.03, 0.02, 0.01, 0.005, 0.04):
        gained.append(env.step(env.action(-size if pressed else size))[1])
        fraction = env.run.report["packing_fraction"]
        pressed = env.run.report["pressure"] > 0.01 * env.largest_pressure
        if pressed:
            above = fraction
            assert above > below
        else:
            below = fraction
            above = above if above > below else math.nan
    # no bracket counts as one of width 1
    assert 0.0 < above - below < 0.1
    assert sum(gained) == pytest.approx(-3.0 * np.log10(above - below) - 8 * 0.5)


def test_a_step_changes_the_packing_fraction_by_the_largest_change_halved_so_often():
    env = QuenchEnv(discs(), actions="steps")
    env.reset(seed=1)
    fraction = env.run.report["packing_fraction"]
    for compress, halvings in ((1, 0), (0, 1), (1, 3), (0, 7)):
        *_, info = env.step([compress, halvings])
        now = info["packing_fraction"]
        assert now - fraction == pytest.approx((2 * compress - 1) * 0.05 / 2**halvings, rel=1e-9)
        assert info["shear_strain"] == 0.0
        fraction = now
    assert 0.05 / 2 ** (env.action_space.nvec[1] - 1) >= env.largest_pressure > 0.05 / 2 ** env.action_space.nvec[1]
    assert [env.action(change).tolist() for change in (0.05, 0.024, -1e-9)] == [
        [1, 0],
        [1, 1],
        [0, env.action_space.nvec[1] - 1],
    ]


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([2, 0], r"action\[0\] must be a whole number between 0 and 1, got 2.0"),
        ([1, 0.5], r"action\[1\] must be a whole number between 0 and \d+, got 0.5"),
    ],
)
def test_steps_that_there_are_not_are_refused(action, message):
    env = QuenchEnv(discs(), actions="steps")
    env.reset(seed=1)
    with pytest.raises(ValueError, match=message):
        env.step(action)
    envs = QuenchVectorEnv(2, discs(), actions="steps")
    envs.reset(seed=1)
    with pytest.raises(ValueError, match=message + " for environment 1"):
        envs.step([[1, 0], action])
    with pytest.raises(ValueError, match="packing_fraction_change must be other than 0"):
        env.action(0.0)
    with pytest.raises(ValueError, match="shear_strain must be 0 with actions='steps', got 0.01"):
        envs.action(0.01, 0.01)


def test_bisection_by_what_is_observed_ends_every_episode_jammed():
    envs = QuenchVectorEnv(20, actions="steps", bracket=True, autoreset_mode="Disabled")
    pressure, bracket = (envs.observation_names.index(name) for name in ("log_pressure", "log_bracket"))
    none, most = envs.single_observation_space.low[pressure], envs.single_action_space.nvec[1] - 1
    observation, _ = envs.reset(seed=3)
    going, jammed, fraction, side, sides = np.ones(20, dtype=bool), np.zeros(20, dtype=bool), None, None, 0
    while going.any():
        compress = observation[:, pressure] <= none
        if side is not None:
            # where pressure just appeared or vanished, jamming is between the last two packing fractions
            crossed = going & (compress != side)
            np.testing.assert_allclose(
                10.0 ** observation[crossed, bracket], np.abs(observation[:, 0] - fraction)[crossed], rtol=1e-6
            )
            sides += crossed.sum()
        fraction, side = observation[:, 0], compress
        halvings = np.round(np.log2(0.05 / (0.5 * 10.0 ** observation[:, bracket])))
        halvings = np.where(observation[:, bracket] == 0.0, 2, np.clip(halvings, 0, most))
        observation, _, terminated, truncated, info = envs.step(np.stack([compress, halvings], axis=1).astype(int))
        jammed |= going & terminated & info["jammed"]
        going &= ~(terminated | truncated)
        if (terminated | truncated).any():
            envs.reset(options={"reset_mask": terminated | truncated})
    assert jammed.all() and sides > 20


def test_budgets_truncate():
    env = QuenchEnv(discs(), step_budget=3)
    env.reset(seed=1)
    assert [env.step([0.0, 0.0])[3] for _ in range(3)] == [False, False, True]
    env = QuenchEnv(discs(), evaluation_budget=60, relax=20)
    env.reset(seed=1)
    spent = [env.step([0.9, 0.0])[3] for _ in range(4)]
    assert spent[0] is False and spent[-1] is True


def test_so_many_steps_at_a_time_show_the_quench():
    scene = discs()
    env = QuenchEnv(scene, relax=5, start_packing_fraction=0.95, step_budget=None, evaluation_budget=None)
    env.reset(seed=1)
    start = env.packing
    while not env.step([0.0, 0.0])[4]["relaxed"]:
        pass
    run = pm.quench(scene.replace(packing=start), method=pm.Fire(), force_tolerance=1e-8)
    np.testing.assert_allclose(env.packing.position_nd, run.packing.position_nd, atol=1e-7)
    assert env.run.steps == run.steps and (np.diff(env.run.trace.energy_t) < 0).mean() > 0.8


def abuse(env, steps, seed):
    """Take random and hostile actions; everything stays finite and inside its space, with resets in the middle."""
    rng = np.random.default_rng(seed)
    space, count = env.single_observation_space, env.num_envs
    observation, _ = env.reset(seed=seed)
    manner = rng.integers(4, size=count)
    for step in range(steps // count):
        if step % 50 == 0:
            # at random; always up; always sheared one way; back and forth between the bounds
            manner = rng.integers(4, size=count)
        actions = rng.uniform(-1.0, 1.0, (count, 2))
        actions[manner == 1, 0] = 1.0
        actions[manner == 2, 1] = 1.0
        actions[manner == 3] = (-1.0) ** step
        observation, reward, _, _, answer = env.step(actions)
        assert np.isfinite(observation).all() and np.isfinite(reward).all()
        assert all(space.contains(row) for row in observation)
        if step % 37 == 36:
            observation, _ = env.reset(options={"reset_mask": rng.random(count) < 0.5} if step % 2 else None)
    return observation


CRUELTIES = [
    {"scene": discs(), "relax": 3},
    {"scene": discs(), "relax": "full", "force_tolerance": 1e-5, "largest_change": 0.2, "largest_strain": 1.0},
    {"scene": trimers(), "relax": 3, "largest_strain": 0.5},
    {"scene": discs().replace(effects=(pm.Repulsion(law=pm.RepulsiveLennardJones()),)), "relax": 3},
]


@pytest.mark.parametrize("arguments", CRUELTIES[:3], ids=["steps", "full", "links"])
def test_hostile_actions_leave_everything_finite_and_inside_its_space(arguments):
    abuse(QuenchVectorEnv(8, **arguments, step_budget=200, evaluation_budget=None, autoreset_mode="SameStep"), 1200, 1)


@pytest.mark.slow
@pytest.mark.parametrize("arguments", CRUELTIES, ids=["steps", "full", "links", "diverging"])
def test_a_hundred_thousand_hostile_actions(arguments):
    envs = QuenchVectorEnv(16, **arguments, step_budget=1000, evaluation_budget=None, autoreset_mode="NextStep")
    abuse(envs, 100_000, 2)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([1.5, 0.0], r"action\[0\] must lie between -1 and 1, got 1.5"),
        ([0.0, np.nan], r"action\[1\] must lie between -1 and 1, got nan"),
        ([0.0], r"action must have shape \(2,\), got \(1,\)"),
        ("up", "action must be an array of real numbers"),
        (None, "action must be an array of real numbers"),
    ],
)
def test_actions_outside_the_space_get_one_clear_error(action, message):
    env = QuenchEnv(discs())
    env.reset(seed=1)
    with pytest.raises((TypeError, ValueError), match=message):
        env.step(action)


def test_an_environment_that_is_closed_shows_its_packing_and_takes_no_steps_and_no_resets():
    env = QuenchEnv(discs())
    env.reset(seed=1)
    env.close()
    env.close()
    for act in (env.reset, lambda: env.step([0.0, 0.0])):
        with pytest.raises(gym.error.ClosedEnvironmentError, match="environment must be open, got one that is closed"):
            act()
    assert env.packing.particles == env.scene.packing.particles


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        QuenchEnv(discs()).step([0.0, 0.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scene": 3}, "scene must be a Scene"),
        ({"relax": 0}, "relax must be an integer at least 1"),
        ({"relax": "half"}, "relax must be one of 'full'"),
        ({"start": "middle"}, "start must be one of 'random', 'scene'"),
        ({"start_packing_fraction": (0.8, 0.7)}, "start_packing_fraction must be a pair that rises"),
        ({"start_packing_fraction": 2.0}, "start_packing_fraction must lie inside the limits"),
        ({"largest_change": 0.5}, "largest_change must be at most 0.2"),
        ({"largest_pressure": -1.0}, "largest_pressure must be a positive number"),
        ({"largest_strain": np.nan}, "largest_strain must be a positive number, got nan"),
        ({"verdict": "maybe"}, "verdict must be one of 'collective', 'strict'"),
        ({"actions": "discrete"}, "actions must be one of 'continuous', 'steps'"),
        ({"bracket": 1}, "bracket must be True or False"),
        ({"relax": 3, "reward": "progress"}, "reward must have progress_weight=0 unless relax is 'full', got relax=3"),
        ({"reward": "nearness"}, "reward must be one of 'distance', 'progress'"),
        ({"shear_modulus": 1}, "shear_modulus must be True or False"),
        ({"step_budget": 0}, "step_budget must be None or an integer at least 1"),
        ({"reward": 3.0}, "reward must be a QuenchReward"),
        ({"reward": QuenchReward(distance_weight=np.inf)}, "reward.distance_weight must be a finite number"),
        ({"bonds": "cut"}, "bonds must be one of"),
        ({"friction": 0.5}, "friction must be one of"),
        ({"method": "fire"}, r"method must be Fire\(\), Fire2\(\) or DampedDynamics\(\)"),
        ({"render_mode": "svg"}, "render_mode must be one of"),
    ],
)
def test_bad_arguments_get_one_clear_error(arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        QuenchEnv(**{"scene": discs(), **arguments})


def test_changes_beyond_the_largest_are_no_action():
    with pytest.raises(ValueError, match="packing_fraction_change must be within 0.05"):
        QuenchEnv(discs()).action(0.06)


def test_options_come_by_name_or_in_a_record_and_an_unknown_one_is_answered_with_those_there_are():
    task = QuenchTask(relax=5, step_budget=7)
    assert QuenchEnv(discs(), relax=5, step_budget=7).task == task
    assert QuenchEnv(discs(), task=QuenchTask(relax=5), step_budget=7).task == task
    batch = gym.make_vec("packmech_envs:packmech/Quench-v0", num_envs=2, scene=discs(), task=task)
    assert batch.unwrapped.task == task
    with pytest.raises(
        TypeError, match="'relaxed' is no option of QuenchTask, which has bonds, friction, relax, .*, reward"
    ):
        gym.make("packmech_envs:packmech/Quench-v0", relaxed=5)
    with pytest.raises(TypeError, match="task must be a QuenchTask, got 'jam'"):
        QuenchVectorEnv(2, discs(), task="jam")


@pytest.mark.parametrize("effect", [pm.Gravity(), pm.Walls(1, 0.0, 4.0), pm.FixedParticles((1,))])
def test_what_the_environment_does_not_know_is_refused_by_name(effect):
    packing = pm.random_packing(16, dimension=2, packing_fraction=0.8, seed=1)
    with pytest.raises(ValueError, match=f"no {type(effect).__name__} here.*got effects.1."):
        gym.make("packmech_envs:packmech/Quench-v0", scene=pm.Scene(packing, (pm.Repulsion(), effect)))
