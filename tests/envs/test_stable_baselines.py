"""Batches behind the interface of stable-baselines3, and an agent that learns (with the extra `learning`)."""

import importlib.util
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.stable_baselines import as_vec_env

SCRIPT = Path(__file__).parents[2] / "recordings" / "learning.py"


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


@pytest.mark.slow
def test_an_agent_learns_to_jam(monkeypatch):
    pytest.importorskip("stable_baselines3")
    monkeypatch.syspath_prepend(SCRIPT.parent)
    loader = importlib.util.spec_from_file_location("learning", SCRIPT)
    learning = importlib.util.module_from_spec(loader)
    loader.loader.exec_module(learning)
    model, envs, rows = learning.learn(50_000)
    trained = learning.returns(learning.trained_policy(model, envs))
    random = learning.returns(learning.random_policy())
    _, _, apart = learning.compare(trained, random)
    assert apart > 3.0
    assert trained[:, 2].mean() > random[:, 2].mean() + 0.2
    assert len(rows) > 1000
