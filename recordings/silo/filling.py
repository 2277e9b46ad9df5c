"""Discs that have fallen between rough walls of a silo, made of held discs; `silo.py` lowers its floor."""

import numpy as np

import packmech as pm

# acceleration, room below the floor
GRAVITY, BELOW = 1e-4, 8.0


def fill(width: float, height: float, friction: float, seed: int) -> tuple[pm.Scene, np.ndarray, np.ndarray]:
    """Return discs that have fallen between walls of held discs, and which particles are floor and walls."""
    rng, across = np.random.default_rng(seed), int((width - 1.0) // 1.25)
    rows = round(height * width * 0.82 / (np.pi / 4.0 * (1.0 + 1.4**2) / 2.0 / 1.2**2 * across))
    grain_nd = np.array(
        [(1.1 + 1.25 * (i + 0.25 * (j % 2)), 1.5 + 1.1 * j) for j in range(rows) for i in range(across)]
    )
    grain_nd += rng.uniform(-0.05, 0.05, grain_nd.shape)
    radius_n = np.where(rng.permutation(len(grain_nd)) < len(grain_nd) // 2, 1.0, 1.4) / 2.4
    beside, up = np.linspace(1.15, width - 0.15, int(width - 1.0)), np.arange(1.0 - BELOW, grain_nd[:, 1].max() + 3.0)
    held_nd = np.concatenate([np.stack([beside, 0.0 * beside], axis=1), np.stack([0.0 * up, up], axis=1)])
    box = pm.Box(np.diag([width + 1.0, grain_nd[:, 1].max() + 4.0 + 3.0 * BELOW]))
    place_nd = np.concatenate([grain_nd, held_nd]) + (0.0, BELOW)
    packing = pm.Packing(place_nd, np.concatenate([radius_n, np.full(len(held_nd), 0.5)]), box)
    floor, walls = np.split(np.arange(len(grain_nd), len(place_nd)), [len(beside)])
    damping = 0.5 * float(np.sqrt(packing.mass_n.mean()))
    effects = (pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(friction, 0.5), pm.ContactDamping(damping))
    effects += (pm.Gravity(y=-GRAVITY), pm.FixedParticles(tuple(walls.tolist())))
    scene = pm.Scene(packing, (*effects, pm.FixedParticles(tuple(floor.tolist())), pm.BackgroundDamping(0.01)))
    fallen = pm.simulate(scene, duration=6.0 * float(np.sqrt(2.0 * height / GRAVITY)))
    return pm.Scene(fallen.packing, effects), floor, walls
