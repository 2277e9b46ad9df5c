"""Can an agent learn to jam a packing in few steps?

Proximal policy optimization: Schulman, Wolski, Dhariwal, Radford and Klimov, arXiv:1707.06347 (2017), with all settings
as stable-baselines3 has them. The agent compresses or expands a packing of 32 discs by steps of a few sizes, and sees
what the relaxation gave. Takes minutes, and needs the extra "learning".

Prints, with a margin for other seeds, of which five others were run:
    jammed of 100 new starts = 100 +- 30
    steps in the last tenth of the training = 7.8 +- 4

Time: 358 s, as a processor counts, with compiled code on disk. Larger: a scene of more particles (option `scene`).
"""

import sys

import gymnasium as gym
import numpy as np
from packmech_envs.stable_baselines import as_vec_env
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import packmech as pm

out, seed, lengths, jammed, ax = sys.argv[1] if sys.argv[1:] else ".", 1, [], {}, None


def watch(now, _):
    lengths.extend(info["episode"]["l"] for info in now["infos"] if "episode" in info)
    return True


how = {"actions": "steps", "bracket": True, "reward": "progress", "autoreset_mode": "SameStep"}
envs, new = (as_vec_env(gym.make_vec("packmech_envs:packmech/Quench-v0", num_envs=n, **how)) for n in (1, 100))
envs = VecNormalize(VecMonitor(envs))
agent = PPO("MlpPolicy", envs, seed=seed, device="cpu").learn(65_536, callback=watch)
new.seed(1_000_000)
seen = new.reset()
while len(jammed) < 100:
    seen, _, done, infos = new.step(agent.predict(envs.normalize_obs(seen), deterministic=True)[0])
    jammed = {b: infos[b]["jammed"] for b in np.flatnonzero(done)} | jammed
for name, part in zip(("first", "last"), (np.array_split(np.array(lengths), 10)[k] for k in (0, -1)), strict=True):
    counted, label = pm.histogram(part, bins=np.arange(0.5, 41.0)), f"{name} tenth of the episodes"
    ax = pm.plot(counted, ax, label=label, quantity="steps of an episode")
print(f"jammed of 100 new starts = {sum(jammed.values())}\nsteps in the last tenth of the training = {part.mean():.1f}")
ax.figure.savefig(f"{out}/learn_to_jam.png", dpi=120)
