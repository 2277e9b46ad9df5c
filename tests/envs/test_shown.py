"""Facts about looking at the environments: pictures, texts and recordings change no bit of an episode."""

import copy
import os
import pickle
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from packmech_envs.batched import QuenchVectorEnv, ShearVectorEnv
from packmech_envs.recorder import RerunRecorder, RerunVectorRecorder
from packmech_envs.single import QuenchEnv, ShearEnv

import packmech as pm

ONE = {
    "shear": lambda **more: ShearEnv("triangular", frame_skip=5, budget=4, **more),
    "quench": lambda **more: QuenchEnv(step_budget=4, **more),
}
MANY = {
    "shear": lambda **more: ShearVectorEnv(3, "triangular", frame_skip=5, budget=4, **more),
    "quench": lambda **more: QuenchVectorEnv(3, step_budget=4, **more),
}


def play(env, steps=9, look=lambda: None):
    """Step through episodes with random actions; return the bytes of all that was seen."""
    env.action_space.seed(5)
    observation, _ = env.reset(seed=11)
    seen = [observation.tobytes()]
    for _ in range(steps):
        look()
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        seen.append((observation.tobytes(), np.float64(reward).tobytes(), terminated, truncated))
        if terminated or truncated:
            observation, _ = env.reset()
            seen.append(observation.tobytes())
    return seen


def play_batch(envs, steps=9, look=lambda: None):
    envs.action_space.seed(5)
    observations, _ = envs.reset(seed=11)
    seen = [observations.tobytes()]
    for _ in range(steps):
        look()
        observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
        seen.append((observations.tobytes(), rewards.tobytes(), terminated.tobytes(), truncated.tobytes()))
    return seen


@pytest.mark.parametrize("name", ONE)
def test_pictures_texts_and_recordings_change_no_bit_of_an_episode(name, tmp_path):
    bare = play(ONE[name]())
    drawn = ONE[name](render_mode="rgb_array")
    assert play(drawn, look=drawn.render) == bare
    told = ONE[name](render_mode="ansi")
    assert play(told, look=told.render) == bare
    recorded = RerunRecorder(ONE[name](), tmp_path, episode_trigger=lambda episode: True)
    assert play(recorded) == bare
    recorded.close()
    assert sum(path.stat().st_size > 1000 for path in tmp_path.iterdir()) >= 2


@pytest.mark.parametrize("name", MANY)
def test_pictures_and_recordings_change_no_bit_of_a_batch(name, tmp_path):
    bare = play_batch(MANY[name]())
    drawn = MANY[name](render_mode="rgb_array")
    assert play_batch(drawn, look=drawn.render) == bare
    recorded = RerunVectorRecorder(MANY[name](), tmp_path, lambda episode: True, index=2)
    assert play_batch(recorded) == bare
    recorded.close()
    assert len(list(tmp_path.iterdir())) >= 2


@pytest.mark.parametrize("name", ONE)
def test_the_picture_is_that_of_the_packing_and_the_text_tells_the_observation(name):
    env = ONE[name](render_mode="rgb_array")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    assert env.render().tobytes() == pm.draw_frame(env.packing, effects=env.scene.effects).tobytes()
    told = ONE[name](render_mode="ansi")
    told.reset(seed=1)
    assert all(word in told.render() for word in told.observation_names)


@pytest.mark.parametrize("name", ONE)
def test_render_without_a_mode_warns_and_returns_nothing(name, monkeypatch):
    said = []
    monkeypatch.setattr(gym.logger, "warn", said.append)
    env = ONE[name]()
    env.reset(seed=1)
    assert env.render() is None and "render_mode" in said[0]
    with pytest.raises(ValueError, match="render_mode must be one of"):
        ONE[name](render_mode="video")


@pytest.mark.parametrize("name", ONE)
def test_a_copy_is_made_anew_from_the_same_arguments(name):
    env = ONE[name]()
    seen = play(env)
    for again in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        with pytest.raises(gym.error.ResetNeeded):
            again.step(env.action_space.sample())
        assert play(again) == seen
    assert play(env) == seen


def test_a_batch_draws_each_of_its_packings():
    envs = MANY["quench"](render_mode="rgb_array")
    envs.reset(seed=3)
    pictures = envs.render()
    assert len(pictures) == 3 and len({picture.tobytes() for picture in pictures}) == 3


SHOWN = """
import gymnasium as gym

def play(render_mode):
    env = gym.make("packmech_envs:packmech/Quench-v0", render_mode=render_mode).unwrapped
    if render_mode == "human":
        env._screen.window.fps = 1000.0
    env.action_space.seed(5)
    seen = [env.reset(seed=11)[0].tobytes()]
    seen += [env.step(env.action_space.sample())[0].tobytes() for _ in range(3)]
    return env, seen

env, seen = play("human")
window = env._screen.window
assert window.shown == 4 and window.is_open
assert seen == play(None)[1]
env.close()
assert not window.is_open
print("all is well")
"""


def test_the_window_shows_every_frame_and_changes_no_bit(on_a_display):
    assert on_a_display(SHOWN) == "all is well\n"


@pytest.mark.parametrize("made", [{"id": "Shear-v0", "scene": "triangular", "frame_skip": 2}, {"id": "Quench-v0"}])
def test_the_checker_passes_with_every_render_mode_where_no_display_is(made, monkeypatch):
    pytest.importorskip("tkinter")
    monkeypatch.setenv("DISPLAY", "")
    if sys.platform != "linux":
        pytest.skip("displays are named by DISPLAY on Linux")
    more = {name: value for name, value in made.items() if name != "id"}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(gym.make(f"packmech_envs:packmech/{made['id']}", **more).unwrapped)
    # the box of Shear-v0 has no bounds; another warning is that nothing is shown
    told = {str(one.message) for one in said if "A Box observation space m" not in str(one.message)}
    assert len(told) == 1 and "needs a display" in told.pop()


def test_one_of_the_environments_that_are_stepped_one_after_the_other_is_recorded(tmp_path):
    envs = gym.make_vec("packmech_envs:packmech/Quench-v0", num_envs=2, vectorization_mode="sync", step_budget=2)
    envs = RerunVectorRecorder(envs, tmp_path, lambda episode: True, index=1)
    play_batch(envs, steps=4)
    envs.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["packmech-episode-0.rrd", "packmech-episode-1.rrd"]


def test_environments_in_processes_of_their_own_each_record_themselves(tmp_path):
    def recorder(env):
        return RerunRecorder(env, tmp_path, name_prefix=f"from-{os.getpid()}")

    envs = gym.make_vec(
        "packmech_envs:packmech/Quench-v0", num_envs=2, vectorization_mode="async", step_budget=2, wrappers=[recorder]
    )
    with pytest.raises(TypeError, match="got AsyncVectorEnv; give each environment a RerunRecorder of its own"):
        RerunVectorRecorder(envs, tmp_path)
    play_batch(envs, steps=2)
    envs.close()
    assert len([path for path in tmp_path.iterdir() if path.stat().st_size > 1000]) == 2
