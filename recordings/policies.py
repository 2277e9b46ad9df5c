"""Policies of Quench-v0, what they return on new starts, and how far apart these are; `learning.py` trains one."""

import numpy as np
from packmech_envs.batched import QuenchVectorEnv

EPISODES = 200


def returns(act, episodes=EPISODES, seed=10_000):
    """Return the (episodes, 3) returns, force evaluations and successes of a policy, on starts that only the seed sets.

    act takes (B, K) observations and returns (B, 2) actions.
    """
    envs = QuenchVectorEnv(episodes, autoreset_mode="Disabled")
    observation, info = envs.reset(seed=seed)
    total, cost, won = np.zeros(episodes), info["force_evaluations"].astype(float), np.zeros(episodes, dtype=bool)
    going = np.ones(episodes, dtype=bool)
    while going.any():
        action = np.clip(act(observation), -1.0, 1.0)
        observation, reward, terminated, truncated, info = envs.step(action)
        total += np.where(going, reward, 0.0)
        cost += np.where(going, info["force_evaluations"], 0.0)
        won |= going & terminated
        ended = going & (terminated | truncated)
        going &= ~ended
        # a batch is stepped as a whole: those that are done start again, and are not looked at
        over = terminated | truncated
        if over.any():
            observation, _ = envs.reset(options={"reset_mask": over})
    return np.stack([total, cost, won], axis=1)


def random_policy(seed=0):
    """Return a policy that draws every action uniformly from the space."""
    rng = np.random.default_rng(seed)
    return lambda observation: rng.uniform(-1.0, 1.0, (len(observation), 2))


def trained_policy(model, envs, seed=0):
    """Return what the model does, drawn from its distribution: its mean alone can go to and fro for ever."""
    import torch

    torch.manual_seed(seed)
    return lambda observation: model.predict(envs.normalize_obs(observation.astype(np.float32)))[0]


def compare(trained, random):
    """Return mean returns of both, with standard errors, and their difference in standard errors of it."""
    means = trained[:, 0].mean(), random[:, 0].mean()
    errors = [one[:, 0].std(ddof=1) / np.sqrt(len(one)) for one in (trained, random)]
    return (means[0], errors[0]), (means[1], errors[1]), (means[0] - means[1]) / np.hypot(*errors)
