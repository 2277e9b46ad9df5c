"""An agent learns to jam 32 discs: PPO on Quench-v0, against a policy that acts at random.

    pip install "packmech[learning]"
    python recordings/learning.py            # writes learning.png and learning.csv beside this file; a few minutes

The agent is to find a packing that is verified to be jammed, at a pressure below 1e-4 energy_scale / diameter^2, with
few force evaluations. What it may do: change the packing fraction, shear, look at the figures after the relaxation.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.stable_baselines import as_vec_env
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

ENVS, STEPS = 16, 50_000
EPISODES = 200
HERE = Path(__file__).parent


def batch(count=ENVS):
    """Return so many environments that a learner steps."""
    return QuenchVectorEnv(count, autoreset_mode="SameStep")


class Curve(BaseCallback):
    """Keeps return, length and success of every episode of the training."""

    def __init__(self):
        super().__init__()
        self.rows = []

    def _on_step(self):
        for info in self.locals["infos"]:
            if "episode" in info:
                self.rows.append((self.num_timesteps, info["episode"]["r"], info["episode"]["l"], info["jammed"]))
        return True


def learn(steps=STEPS, seed=0):
    """Return the trained model, the scaling of its observations, and (episodes, 4) rows of its learning curve."""
    envs = VecNormalize(VecMonitor(as_vec_env(batch())), gamma=0.95)
    model = PPO(
        "MlpPolicy", envs, n_steps=64, batch_size=128, learning_rate=1e-3, gamma=0.95, gae_lambda=0.9,
        policy_kwargs={"log_std_init": -0.7}, seed=seed, device="cpu",
    )  # fmt: skip
    curve = Curve()
    model.learn(steps, callback=curve)
    envs.training = False
    return model, envs, np.array(curve.rows, dtype=float)


def returns(act, episodes=EPISODES, seed=10_000):
    """Return the (episodes, 3) returns, force evaluations and successes of a policy, on starts that only the seed sets.

    act takes (B, K) observations and returns (B, 2) actions.
    """
    envs = QuenchVectorEnv(episodes, autoreset_mode="Disabled")
    observation, told = envs.reset(seed=seed)
    total, cost, won = np.zeros(episodes), told["force_evaluations"].astype(float), np.zeros(episodes, dtype=bool)
    going = np.ones(episodes, dtype=bool)
    while going.any():
        action = np.clip(act(observation), -1.0, 1.0)
        observation, reward, terminated, truncated, told = envs.step(action)
        total += np.where(going, reward, 0.0)
        cost += np.where(going, told["force_evaluations"], 0.0)
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


def draw(rows, trained, random, path):
    """Draw the learning curve, and what the policies reach on new starts."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    edges = np.linspace(0, rows[:, 0].max(), 41)
    place = np.clip(np.digitize(rows[:, 0], edges) - 1, 0, 39)
    middle = 0.5 * (edges[1:] + edges[:-1])
    some = [k for k in range(40) if (place == k).sum() > 1]
    for axis, column, name in ((axes[0], 1, "return of an episode"), (axes[1], 3, "episodes that end jammed")):
        mean = np.array([rows[place == k, column].mean() for k in some])
        error = np.array([rows[place == k, column].std(ddof=1) / np.sqrt((place == k).sum()) for k in some])
        axis.fill_between(middle[some], mean - error, mean + error, alpha=0.3, color="C0", lw=0)
        axis.plot(middle[some], mean, color="C0", label="PPO while it learns (mean and standard error)")
        for data, color, label in ((trained, "C2", "trained, 200 new starts"), (random, "C3", "acting at random")):
            level = data[:, 0 if column == 1 else 2].mean()
            axis.axhline(level, color=color, ls="--", label=f"{label}: {level:.2f}")
        axis.set(xlabel="steps of environments", ylabel=name)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.3 * (high - low))
        axis.legend(frameon=False, fontsize=8, loc="upper left")
    figure.suptitle("Quench-v0, 32 bidisperse discs: to a jammed packing with few force evaluations")
    figure.savefig(path, dpi=120)


def main():
    """Train, compare, print and draw."""
    import torch

    torch.set_num_threads(1)
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else STEPS
    began = time.process_time()
    model, envs, rows = learn(steps)
    seconds = time.process_time() - began
    trained, random = returns(trained_policy(model, envs)), returns(random_policy())
    mine, theirs, apart = compare(trained, random)
    print(f"return: trained {mine[0]:.3f} +- {mine[1]:.3f}, random {theirs[0]:.3f} +- {theirs[1]:.3f}")
    print(f"difference: {apart:.1f} standard errors")
    for name, data in (("trained", trained), ("random", random)):
        print(f"{name}: {data[:, 2].mean():.1%} end jammed, {data[:, 1].mean():.0f} force evaluations an episode")
    print(f"{seconds:.0f} s of CPU time for {steps} steps")
    np.savetxt(HERE / "learning.csv", rows, delimiter=",", header="step,return,length,jammed", fmt="%.6g", comments="")
    draw(rows, trained, random, HERE / "learning.png")


if __name__ == "__main__":
    main()
