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
from learning_curve import draw
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.stable_baselines import as_vec_env
from policies import compare, random_policy, returns, trained_policy
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

ENVS, STEPS = 16, 50_000
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
