"""Facts about looking at the environments: pictures, texts and recordings change no bit of an episode."""

import gymnasium as gym
import numpy as np
import pytest
from packmech_envs.quench import QuenchEnv
from packmech_envs.quench_vector import QuenchVectorEnv
from packmech_envs.recorder import RerunRecorder, RerunVectorRecorder
from packmech_envs.shear import ShearEnv
from packmech_envs.shear_vector import ShearVectorEnv

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


def test_a_batch_draws_each_of_its_packings():
    envs = MANY["quench"](render_mode="rgb_array")
    envs.reset(seed=3)
    pictures = envs.render()
    assert len(pictures) == 3 and len({picture.tobytes() for picture in pictures}) == 3
