"""Batches behind the interface of stable-baselines3, and an agent that learns (with the extra `learning`)."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.stable_baselines import as_vec_env


def test_without_stable_baselines_the_error_names_the_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("stable_baselines3")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ModuleNotFoundError, match=r"packmech\[learning\]"):
        as_vec_env(QuenchVectorEnv(2, autoreset_mode="SameStep"))


def test_what_is_no_batch_or_resets_otherwise_is_refused():
    with pytest.raises(TypeError, match="envs must be a batch of environments"):
        as_vec_env(gym.make("packmech_envs:packmech/Quench-v0"))
    with pytest.raises(ValueError, match="autoreset_mode='SameStep'"):
        as_vec_env(QuenchVectorEnv(2))


def test_ends_of_episodes_are_told_as_learners_ask_for_them():
    pytest.importorskip("stable_baselines3")
    mine = QuenchVectorEnv(3, step_budget=2, autoreset_mode="SameStep")
    envs = as_vec_env(QuenchVectorEnv(3, step_budget=2, autoreset_mode="SameStep"))
    envs.seed(5)
    first = envs.reset()
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, mine.reset(seed=5)[0].astype(np.float32))
    for done in (False, True):
        actions = np.zeros((3, 2))
        observation, reward, dones, infos = envs.step(actions)
        expected, rewards, _, _, found = mine.step(actions)
        np.testing.assert_array_equal(observation, expected.astype(np.float32))
        np.testing.assert_array_equal(reward, rewards.astype(np.float32))
        assert dones.tolist() == [done] * 3
    for b in range(3):
        assert infos[b]["TimeLimit.truncated"] is True
        np.testing.assert_array_equal(infos[b]["terminal_observation"], found["final_obs"][b].astype(np.float32))
        assert infos[b]["reward_distance"] == found["final_info"]["reward_distance"][b]


def test_choices_reach_the_environment_as_whole_numbers():
    pytest.importorskip("stable_baselines3")
    made = QuenchVectorEnv(2, actions="steps", step_budget=3, autoreset_mode="SameStep")
    envs = as_vec_env(made)
    assert envs.action_space == made.single_action_space
    envs.seed(5)
    before = envs.reset()
    after, *_ = envs.step(np.array([[1, 1], [0, 2]]))
    np.testing.assert_allclose(after[:, 0] - before[:, 0], [0.025, -0.0125], atol=1e-6)


@pytest.mark.slow
def test_the_defaults_of_a_learner_learn_to_jam():
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    options = {"actions": "steps", "bracket": True, "reward": "progress", "autoreset_mode": "SameStep"}
    envs = VecNormalize(as_vec_env(QuenchVectorEnv(1, **options)))
    agent = PPO("MlpPolicy", envs, seed=14, device="cpu").learn(65_536)
    new = as_vec_env(QuenchVectorEnv(100, **options))
    new.seed(1_000_000)
    observation, jammed = new.reset(), {}
    while len(jammed) < 100:
        actions, _ = agent.predict(envs.normalize_obs(observation), deterministic=True)
        observation, _, done, infos = new.step(actions)
        jammed = {b: infos[b]["jammed"] for b in np.flatnonzero(done)} | jammed
    assert sum(jammed.values()) >= 70
