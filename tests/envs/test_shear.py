"""Shear-v0: the interface, complete resets, the physics of scripts, and what it does with whatever it is given."""

import math
import warnings
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from packmech_envs.batched import ShearVectorEnv
from packmech_envs.recorder import RerunRecorder
from packmech_envs.shear import ShearTask
from packmech_envs.shear_goals import GOALS, DissipateLeast, FindYieldStrain, FollowStress
from packmech_envs.single import ShearEnv

import packmech as pm

FRICTIONAL_EFFECTS = (pm.Friction(coefficient=0.5, stiffness=0.5, damping=1.0), pm.ContactDamping(coefficient=2.0))


@cache
def frictionless(n=24, seed=1):
    packing = pm.random_packing(n, dimension=2, packing_fraction=0.9, seed=seed)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-8, check=False).packing)


@cache
def frictional(n=24, seed=1):
    scene = frictionless(n, seed)
    return scene.replace(effects=(*scene.effects, *FRICTIONAL_EFFECTS))


def checked(env):
    with warnings.catch_warnings():
        # bounds of an observation are infinite where the figure has none, and those of an action have units
        warnings.filterwarnings("ignore", message=".*A Box observation space m")
        warnings.filterwarnings("ignore", message=".*we recommend using a symmetric and normalized space")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("goal", GOALS)
def test_the_checker_passes_for_every_goal(goal):
    checked(gym.make("packmech_envs:packmech/Shear-v0", scene="triangular", goal=goal, start="as_prepared"))


WITH_RENDERING = """
import gymnasium as gym, warnings
from gymnasium.utils.env_checker import check_env
warnings.simplefilter("ignore")
check_env(gym.make("packmech_envs:packmech/Shear-v0", scene="triangular", frame_skip=2).unwrapped)
print("all is well")
"""


def test_the_checker_passes_with_every_render_mode_where_there_is_a_display(on_a_display):
    assert on_a_display(WITH_RENDERING) == "all is well\n"


@pytest.mark.slow
@pytest.mark.parametrize("scene", pm.list_scenes())
def test_the_checker_passes_for_every_shipped_scene_and_goal(scene):
    for goal in GOALS:
        env = gym.make("packmech/Shear-v0", scene=scene, goal=goal, links="bonds", frame_skip=3)
        assert not env.unwrapped.scene.packing.links
        checked(env)


def test_the_checker_passes_for_starts_that_are_drawn_and_for_all_controls():
    for control in ("strain", "rate", "strain_and_rate"):
        checked(gym.make("packmech/Shear-v0", scene=frictional(), control=control, extra_actions=("friction",)))
    checked(gym.make("packmech/Shear-v0", scene="default", start=1, relax=False, frame_skip=2))


def bits(run):
    return np.concatenate([run.figure_tk.ravel(), run.reward_t]).tobytes()


def played(env, seed, actions, *, look=False):
    answers = [env.reset(seed=seed)]
    for action in actions:
        answers.append(env.step(action))
        if look:
            env.render()
            env.packing, env.contacts(), env.run  # noqa: B018
        if answers[-1][2]:
            break
    return answers


@pytest.mark.parametrize("make", [frictionless, frictional])
def test_reset_and_the_same_actions_give_the_same_bits_alone_in_a_batch_and_on_threads(make):
    how = {"scene": make(), "control": "rate", "frame_skip": 3, "largest_rate": 0.05}
    quiet, seen = ShearEnv(**how), ShearEnv(**how, render_mode="rgb_array")
    one, two = (ShearVectorEnv(3, **how, threads=threads) for threads in (1, 2))

    @settings(max_examples=8, deadline=None)
    @given(
        seed=st.integers(0, 2**31 - 4),
        actions=st.lists(st.floats(-0.05, 0.05), min_size=1, max_size=25),
        before=st.lists(st.floats(-0.05, 0.05), max_size=10),
    )
    def same(seed, actions, before):
        rows = [np.array([value]) for value in actions]
        first = played(quiet, seed, rows)
        figures = bits(quiet.run)
        # an episode in between, left in the middle, and another while it is looked at
        played(quiet, seed + 1, [np.array([value]) for value in before])
        assert data_equivalence(played(quiet, seed, rows), first, exact=True)
        assert bits(quiet.run) == figures
        assert data_equivalence(played(seen, seed, rows, look=True), first, exact=True)
        for envs in (one, two):
            observations, _ = envs.reset(seed=seed)
            assert np.array_equal(observations[0], first[0][0])
            for action, answer in zip(rows, first[1:], strict=False):
                others = np.full((3, 1), 0.01)
                others[0] = action
                observations, rewards, *_ = envs.step(others)
                assert np.array_equal(observations[0], answer[0]) and rewards[0] == answer[1]

    same()
    one.close(), two.close()


def test_an_episode_that_is_recorded_has_the_bits_of_one_that_is_not_and_so_has_the_next(tmp_path):
    how = {"scene": frictional(), "frame_skip": 3, "largest_rate": 0.05}
    rows = np.random.default_rng(5).uniform(-0.05, 0.05, (12, 1))
    plain = played(ShearEnv(**how), 7, rows)
    env = RerunRecorder(ShearEnv(**how), tmp_path, episode_trigger=lambda episode: episode == 0)
    for _ in range(2):
        assert data_equivalence(played(env, 7, rows), plain, exact=True)
    env.close()
    assert len(list(tmp_path.glob("*.rrd"))) == 1


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_answers_as_single_environments_with_the_same_seeds_do(mode):
    goal = FindYieldStrain(least_strain=0.004, drop=0.1)
    how = {"scene": frictionless(), "goal": goal, "frame_skip": 8, "largest_rate": 0.05, "budget": 12}
    theirs = SyncVectorEnv([lambda: ShearEnv(**how)] * 4, autoreset_mode=gym.vector.AutoresetMode(mode))
    for threads in (1, 2):
        ours = ShearVectorEnv(4, **how, threads=threads, autoreset_mode=mode)
        assert data_equivalence(ours.reset(seed=5), theirs.reset(seed=5), exact=True)
        theirs.action_space.seed(3)
        ended = np.zeros(2)
        for _ in range(40):
            actions = np.abs(theirs.action_space.sample()) * [[1.0], [0.5], [1.0], [0.2]]
            mine = ours.step(actions)
            assert data_equivalence(mine, theirs.step(actions), exact=True)
            ended += [mine[2].sum(), mine[3].sum()]
        assert (ended > 0).all()
        ours.close()


@pytest.mark.parametrize("vectorization", ["sync", "async", "vector_entry_point"])
def test_all_modes_of_make_vec_give_the_same_numbers(vectorization):
    how = {"scene": "triangular", "frame_skip": 2}
    envs = gym.make_vec("packmech_envs:packmech/Shear-v0", num_envs=2, vectorization_mode=vectorization, **how)
    observations, _ = envs.reset(seed=4)
    envs.action_space.seed(4)
    moved = envs.step(envs.action_space.sample())
    alone = ShearEnv(**how)
    assert np.array_equal(observations[1], alone.reset(seed=5)[0])
    assert envs.observation_space.dtype == observations.dtype == moved[0].dtype == np.float64
    assert envs.observation_space.contains(moved[0])
    envs.close()


@pytest.mark.parametrize(("control", "path"), [("strain", "increments"), ("strain_and_rate", "exact")])
def test_a_scripted_episode_measures_the_moduli_of_oscillatory_shear(control, path):
    scene, amplitude, frequency = frictional(), 2e-3, 0.02
    run = pm.oscillatory_shear(scene, amplitude=amplitude, frequency=frequency, periods=3, strain_path=path)
    env = gym.make(
        "packmech/Shear-v0", scene=scene, control=control, frame_skip=1, dt=run.dt, budget=None, largest_rate=1.0
    ).unwrapped
    omega = 2.0 * math.pi * frequency
    env.reset(options={"rate": amplitude * omega} if path == "exact" else None)
    for k in range(1, run.steps + 1):
        phase = omega * k * run.dt
        action = [amplitude * math.sin(phase), amplitude * omega * math.cos(phase)]
        env.step(np.array(action[: len(env.action_names)]))
    every = run.steps // (len(run.time_t) - 1)
    so_far = env.run
    moduli = pm.demodulate(
        omega * so_far.time_t[::every], so_far.shear_stress_t[::every], amplitude=amplitude, periods=3
    )
    assert 0.3 < run.moduli.loss / run.moduli.storage < 3.0
    assert moduli.storage == pytest.approx(run.moduli.storage, rel=1e-12)
    assert moduli.loss == pytest.approx(run.moduli.loss, rel=1e-12)


def attacks(space, rng, count):
    """Random actions, actions at the bounds, one bound held, and sudden turns."""
    low, high = space.low, space.high
    for k in range(count):
        kind = k // 50 % 4
        if kind == 0:
            yield rng.uniform(low, high)
        elif kind == 1:
            yield np.where(rng.random(low.shape) < 0.5, low, high)
        elif kind == 2:
            yield high.copy() if k // 200 % 2 else low.copy()
        else:
            yield low.copy() if k % 2 else high.copy()


def attacked(control, make, steps):
    """Step 32 packings so often, at strains of up to 1 from one frame to the next."""
    extra = ("friction",) if make is frictional else ()
    how = {"scene": make(16), "control": control, "frame_skip": 2, "budget": 300, "extra_actions": extra, "threads": 2}
    fastest = 1.0 if control == "rate" else 5.0
    envs = ShearVectorEnv(32, **how, largest_strain=0.5, largest_rate=fastest, autoreset_mode="SameStep")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    reasons = set()
    for k, actions in enumerate(attacks(envs.action_space, rng, steps)):
        if k % 211 == 7:  # reset in the middle, all or some
            envs.reset(options={"reset_mask": rng.random(32) < 0.5} if k % 2 else None)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        assert envs.observation_space.contains(observations)
        assert np.isfinite(rewards).all()
        assert all(np.isfinite(infos[name]).all() for name in ("time", "elastic_energy", "work"))
        if terminated.any():
            final = infos["final_info"]
            reasons |= set(final["reason"][terminated])
            for b in np.flatnonzero(terminated):
                assert envs.single_observation_space.contains(infos["final_obs"][b])
        assert not (terminated & ~(infos.get("_final_obs", terminated))).any()
    assert reasons <= {"step_too_long"}
    envs.close()


ATTACKED = [("rate", frictionless), ("strain", frictional), ("strain_and_rate", frictional)]


@pytest.mark.parametrize(("control", "make"), ATTACKED)
def test_random_and_adversarial_steps_stay_inside_the_observation_space(control, make):
    attacked(control, make, 220)


@pytest.mark.slow
@pytest.mark.parametrize(("control", "make"), ATTACKED)
def test_a_hundred_thousand_random_and_adversarial_steps_stay_inside_the_observation_space(control, make):
    attacked(control, make, 3200)


def exploding():
    """Two particles that a few steps of shear press so deep that the next one throws them far apart.

    Their law is soft where particles touch, so that the step is not too long for any contact of little overlap.
    """
    packing = pm.Packing([[1.0, 1.0], [1.5, 1.9], [3.0, 3.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    return pm.Scene(packing, (pm.Repulsion(pm.PowerLaw(1e3, 6.0)),))


def test_a_step_too_long_terminates_with_its_reason_and_the_last_good_observation():
    env = ShearEnv(
        exploding(), dt=1.0, frame_skip=5, largest_rate=1.0, relax=False, goal=FollowStress(weight_failure=3.0)
    )
    last, _ = env.reset(seed=0)
    for _ in range(50):
        observation, reward, terminated, truncated, info = env.step([1.0])
        if terminated:
            break
        last = observation
    assert terminated and not truncated
    assert info["reason"] == "step_too_long" and info["reward_failure"] == -3.0
    assert np.array_equal(observation[:-1], last[:-1])
    assert env.packing.particles == 3  # what is there can still be read
    with pytest.raises(gym.error.ResetNeeded, match="must be reset"):
        env.step([0.0])
    env.reset()
    env.step([0.0])


@pytest.mark.parametrize(
    ("action", "error", "wording"),
    [
        ([0.3], ValueError, r"action\[0\] must lie between -0.2 and 0.2, got 0.3"),
        ([math.nan], ValueError, r"action\[0\] must lie between -0.2 and 0.2, got nan"),
        ([math.inf], ValueError, "got inf"),
        ([0.1, 0.1], ValueError, r"action must have shape \(1,\), got \(2,\)"),
        (0.1, ValueError, r"action must have shape \(1,\), got \(\)"),
        ("up", TypeError, "action must be an array of real numbers"),
        ([None], TypeError, "action must be an array of real numbers"),
        ([1j], TypeError, "action must be an array of real numbers"),
    ],
)
def test_an_action_outside_the_space_is_refused_and_changes_nothing(action, error, wording):
    env = ShearEnv(frictionless(), control="strain")
    env.reset(seed=0)
    with pytest.raises(error, match=wording):
        env.step(action)
    assert len(env.run.time_t) == 1


def test_a_frictionless_scene_holds_no_history():
    env, with_friction = ShearEnv(frictionless()), ShearEnv(frictional())
    env.reset(seed=0), with_friction.reset(seed=0)
    engine = env._episodes.batch._engines[0]
    assert engine.track is None and engine.acting.friction is None and engine.state.spins == ()
    assert with_friction._episodes.batch._engines[0].track is not None


def test_the_friction_of_an_action_is_that_of_the_frame():
    env = ShearEnv(frictional(), extra_actions=("friction",), largest_rate=0.05)
    assert env.action_names == ("rate", "friction")
    assert env.action_space.high[1] == 0.5 and env.action_space.low[1] == 0.0
    sliding = env.observation_names.index("sliding_fraction")
    env.reset(seed=0)
    for _ in range(5):
        off, *_ = env.step([0.05, 0.0])
    env.reset(seed=0)
    for _ in range(5):
        on, *_ = env.step([0.05, 0.5])
    assert off[sliding] == 1.0 > on[sliding]
    with pytest.raises(ValueError, match="extra_actions must be left out for a scene without friction"):
        ShearEnv(frictionless(), extra_actions=("friction",))


def test_infos_hold_every_term_and_the_reward_is_their_sum():
    for goal in GOALS.values():
        env = ShearEnv(frictionless(), goal=goal())
        env.reset(seed=0)
        for _ in range(5):
            _, reward, _, _, info = env.step(env.action_space.high)
            assert reward == pytest.approx(sum(info[name] for name in goal.terms), abs=1e-15)
            assert set(goal.infos) <= set(info)


def test_a_stress_that_is_followed_exactly_costs_nothing():
    env = ShearEnv(frictionless(), goal=FollowStress(amplitude=0.02, random=False, weight_effort=0.5))
    observation, _ = env.reset(seed=0)
    names = env.observation_names
    for _ in range(3):
        target = observation[names.index("target_stress")]
        assert target == 0.02 * env.scene.pressure_unit
        observation, _, _, _, info = env.step([env.action_space.high[0] / 2])
        error = observation[names.index("stress_xy")] - target
        assert info["stress_error"] == error
        assert info["reward_stress"] == -abs(error) / target
        assert info["reward_effort"] == pytest.approx(-0.5 * 0.25)


def test_targets_are_drawn_from_the_environments_generator():
    env = ShearEnv(frictionless(), goal=FollowStress(amplitude=0.02))
    drawn = [env.reset(seed=seed)[0][-1] for seed in (1, 2, 1)]
    assert drawn[0] == drawn[2] != drawn[1]
    assert max(map(abs, drawn)) <= 0.02
    wave = ShearEnv(frictionless(), goal=FollowStress(amplitude=0.02, period=8, random=False))
    seen = [wave.reset()[0][-1]] + [wave.step([0.0])[0][-1] for _ in range(7)]
    assert seen == pytest.approx(0.02 * np.sin(2.0 * np.pi * np.arange(1, 9) / 8), abs=1e-12)


def test_an_elastic_path_to_the_goal_dissipates_little_and_a_rubbing_one_more():
    goal = DissipateLeast(target_strain=0.004, tolerance=1e-9)
    spent = {}
    for name, scene in {"elastic": frictionless(), "with_friction": frictional()}.items():
        env = ShearEnv(scene, goal=goal, control="strain", frame_skip=20)
        env.reset(seed=0)
        for strain in np.linspace(2e-4, 4e-3, 20):
            observation, _, terminated, _, info = env.step([strain])
        assert terminated and info["reason"] == "strain_reached"
        assert observation[env.observation_names.index("strain_to_go")] == pytest.approx(0.0, abs=1e-12)
        spent[name] = info["dissipated_energy"]
        run = env.run
        stored = run["kinetic_energy"] + run["elastic_energy"]
        assert spent[name] == pytest.approx(run["work"][-1] - stored[-1] + stored[0], abs=1e-14)
    assert abs(spent["elastic"]) < 0.02 * spent["with_friction"]


def test_progress_to_the_goal_adds_up_to_one():
    env = ShearEnv(frictionless(), goal=DissipateLeast(target_strain=-0.01), control="strain", frame_skip=5)
    env.reset(seed=0)
    total = 0.0
    for strain in (0.002, -0.004, -0.01):
        *_, terminated, _, info = env.step([strain])
        total += info["reward_progress"]
    assert terminated and total == pytest.approx(1.0)


def test_the_yield_strain_is_that_of_the_peak_of_the_stress():
    goal = FindYieldStrain(least_strain=0.005, drop=0.2, resolution=0.02)
    env = ShearEnv(frictional(32, 3), goal=goal, control="strain", frame_skip=40, largest_strain=1.0, budget=None)
    env.reset(seed=0)
    for strain in np.arange(1, 500) * 2e-3:
        *_, terminated, _, info = env.step([strain])
        if terminated:
            break
    assert terminated and info["reason"] == "yielded"
    run = env.run
    counted = run.strain_t >= 0.005
    peak = np.argmax(np.where(counted, run.shear_stress_t, -np.inf))
    assert info["yield_strain"] == run.strain_t[peak] and info["yield_stress"] == run.shear_stress_t[peak]
    assert run.shear_stress_t[-1] <= 0.8 * info["yield_stress"]
    assert (run.shear_stress_t[peak + 1 : -1] > 0.8 * info["yield_stress"]).all()
    beyond = run.strain_t[-1] - info["yield_strain"]
    assert info["reward_found"] == pytest.approx(10.0 / (1.0 + beyond / 0.02))


def test_starts_are_drawn_by_the_recipe_from_the_environments_seed_alone():
    how = {"scene": "default", "relax": False, "frame_skip": 1}
    fixed, free, few = ShearEnv(**how), ShearEnv(**how, start="random"), ShearEnv(**how, start=2)
    seeds = {}
    for seed in range(6):
        free.reset(seed=seed)
        seeds[seed] = free.packing
        few.reset(seed=seed)
        assert few.packing in (pm.read_scene("default", seed=0).packing, pm.read_scene("default", seed=1).packing)
    assert seeds[0] != seeds[1]
    free.reset(seed=1)
    assert free.packing == seeds[1]
    fixed.reset(seed=3)
    assert fixed.packing == pm.read_scene("default").packing
    for scene, wording in (("triangular", "packing that is not random"), (frictionless(), "given as a Scene")):
        with pytest.raises(ValueError, match=wording):
            ShearEnv(scene, start="random")


def test_reduced_units_scale_what_is_seen_and_nothing_else():
    scene = frictionless()
    stiff = scene.replace(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=100.0)),))
    soft_env, stiff_env = (ShearEnv(one, units="reduced", control="strain") for one in (scene, stiff))
    soft_env.reset(seed=0), stiff_env.reset(seed=0)
    soft_seen, *_ = soft_env.step([0.01])
    stiff_seen, *_ = stiff_env.step([0.01])
    assert stiff_env.dt == pytest.approx(soft_env.dt / 10.0)
    assert stiff_seen == pytest.approx(soft_seen, rel=1e-6, abs=1e-9)
    raw = ShearEnv(scene, control="strain")
    raw.reset(seed=0)
    seen, *_ = raw.step([0.01])
    assert np.array_equal(raw.run.figure_tk, soft_env.run.figure_tk)
    contacts = raw.observation_names.index("contacts")
    assert soft_seen[contacts] == pytest.approx(seen[contacts] / (2 * 24), rel=1e-15)


def test_rigid_links_are_refused_unless_they_may_become_bonds():
    with pytest.raises(ValueError, match="scene must have no rigid links here"):
        ShearEnv("fifty-trimers-2d", relax=False)


@pytest.mark.parametrize(
    ("how", "wording"),
    [
        ({"control": "force"}, "control must be one of 'strain', 'rate', 'strain_and_rate', got 'force'"),
        ({"goal": "win"}, "goal must be one of 'follow_stress', 'dissipate_least', 'find_yield_strain'"),
        ({"frame_skip": 0}, "frame_skip must be an integer at least 1, got 0"),
        ({"frame_skip": 1.5}, "frame_skip must be an integer at least 1, got 1.5"),
        ({"links": ["bonds"]}, "links must be one of 'refuse', 'bonds'"),
        ({"link_stiffness": -1.0}, "link_stiffness must be a positive number, got -1.0"),
        ({"dt": 0.0}, "dt must be"),
        ({"largest_strain": -1.0}, "largest_strain must be a positive number, got -1.0"),
        ({"largest_rate": math.inf}, "largest_rate must be a positive number, got inf"),
        ({"extra_actions": ("pressure",)}, "extra_actions must hold 'friction' or nothing, got 'pressure'"),
        ({"start": 0}, "start must be 'as_prepared', 'random' or how many packings to draw from, got 0"),
        ({"budget": 0}, "budget must be None or an integer at least 1, got 0"),
        ({"units": "SI"}, "units must be one of 'scene', 'reduced', got 'SI'"),
        ({"render_mode": "film"}, "render_mode must be one of"),
        ({"axes": (0, 0)}, "axes must be two different axes"),
        ({"method": "euler"}, "method must be"),
    ],
)
def test_wrong_settings_are_refused_by_name(how, wording):
    with pytest.raises((TypeError, ValueError), match=wording):
        ShearEnv(frictionless(), **how)


@pytest.mark.parametrize(
    ("make", "wording"),
    [
        (lambda: FollowStress(amplitude=0.0), "amplitude must be a positive number, got 0.0"),
        (lambda: FollowStress(random=1), "random must be True or False, got 1"),
        (lambda: DissipateLeast(target_strain=0.0), "target_strain must not be zero"),
        (lambda: DissipateLeast(weight_time=math.nan), "weight_time must be a finite number, got nan"),
        (lambda: FindYieldStrain(drop=1.0), "drop must be below 1, got 1.0"),
        (lambda: FindYieldStrain(resolution="fine"), "resolution must be a positive number, got 'fine'"),
    ],
)
def test_wrong_numbers_of_a_goal_are_refused(make, wording):
    with pytest.raises((TypeError, ValueError), match=wording):
        make()


def test_options_of_a_reset_are_known_or_refused():
    env = ShearEnv(frictional())
    observation, _ = env.reset(options={"rate": 0.01})
    assert observation[env.observation_names.index("rate")] == 0.01
    with pytest.raises(ValueError, match="options must hold nothing but 'rate'"):
        env.reset(options={"speed": 1.0})
    with pytest.raises(TypeError, match="options must be None or a dictionary, got 3"):
        env.reset(options=3)


def test_a_budget_truncates_and_does_not_terminate():
    env = ShearEnv(frictionless(), budget=3)
    env.reset(seed=0)
    ends = [env.step([0.0])[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_pictures_and_texts_are_what_the_render_mode_says():
    for mode, kind in (("rgb_array", np.ndarray), ("ansi", str)):
        env = ShearEnv(frictionless(), render_mode=mode)
        env.reset(seed=0)
        assert isinstance(env.render(), kind)
    envs = ShearVectorEnv(2, frictionless(), render_mode="rgb_array")
    envs.reset(seed=0)
    assert len(envs.render()) == 2 and envs.render()[0].dtype == np.uint8


def test_options_come_by_name_or_in_a_record_and_an_unknown_one_is_answered_with_those_there_are():
    task = ShearTask(goal=DissipateLeast(target_strain=0.2), control="strain", frame_skip=2)
    env = gym.make("packmech/Shear-v0", scene=frictionless(), task=task).unwrapped
    twin = ShearEnv(frictionless(), goal=DissipateLeast(target_strain=0.2), control="strain", frame_skip=2)
    rows = np.full((3, 1), 0.01)
    assert env.task == twin.task == task
    assert data_equivalence(played(env, 1, rows), played(twin, 1, rows), exact=True)
    assert ShearEnv(frictionless(), task=task, frame_skip=3).task.frame_skip == 3
    with pytest.raises(TypeError, match="'steps' is no option of ShearTask, which has goal, control, .*, units"):
        gym.make_vec("packmech/Shear-v0", num_envs=2, scene=frictionless(), steps=3)
    with pytest.raises(TypeError, match="task must be a ShearTask, got 'dissipate_least'"):
        ShearEnv(frictionless(), task="dissipate_least")
