"""Record an episode of each environment, and put pictures that they render side by side.

    python recordings/environments.py     # writes shear-episode.rrd, quench-episode.rrd, environments.png beside itself

Shear-v0 rocks the shipped gel of bonded fragments; Quench-v0 compresses rigid trimers until they are jammed, the step
halved and turned round wherever pressure appears or goes.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from packmech_envs.recorder import RerunRecorder
from PIL import Image

import packmech as pm

HERE, FRAMES, SIDE, GAP = Path(__file__).parent, 64, 360, 6


def recorded(name: str, target: str, play: object, **more: object) -> list[NDArray[np.uint8]]:
    """Play an episode, keep its recording under a name of its own, and return the pictures of its start and end."""
    with tempfile.TemporaryDirectory() as folder:
        env = RerunRecorder(gym.make(f"packmech_envs:packmech/{name}", render_mode="rgb_array", **more), folder)
        env.reset(seed=1)
        pictures = [env.render()]
        for _ in play(env):  # type: ignore[operator]
            pictures.append(env.render())
        env.close()
        shutil.copy(Path(folder) / "packmech-episode-0.rrd", HERE / target)
    return pictures


def rock(env: gym.Env) -> object:
    """Shear to and fro."""
    for frame in range(FRAMES):
        env.step(env.action_space.high * np.cos(4.0 * np.pi * (frame + 0.5) / FRAMES))
        yield frame


def halve(env: gym.Env) -> object:
    """Compress until jammed."""
    change, over = 0.05, False
    while not over:
        *_, terminated, truncated, info = env.step(env.unwrapped.action(packing_fraction_change=change))
        if (info["pressure"] > 1e-9) == (change > 0.0):
            change *= -0.5
        over = terminated or truncated
        yield info


def main() -> None:
    """Write the recordings and the pictures."""
    rocked = recorded("Shear-v0", "shear-episode.rrd", rock, scene="microgel", frame_skip=100)
    quenched = recorded("Quench-v0", "quench-episode.rrd", halve, scene="fifty-trimers-2d")
    spheres = pm.read_scene("spheres")
    jammed = pm.quench(spheres, force_tolerance=1e-8)
    chosen = [rocked[0], rocked[FRAMES // 8], quenched[0], quenched[-1]]
    chosen += [pm.draw_frame(jammed.packing, effects=spheres.effects, beads=part) for part in (1.0, 0.4)]
    sheet = Image.new("RGB", (3 * SIDE + 2 * GAP, 2 * SIDE + GAP), (70, 74, 82))
    for k, pixels in enumerate(chosen):
        picture = Image.fromarray(pixels).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
        sheet.paste(picture, ((k // 2) * (SIDE + GAP), (k % 2) * (SIDE + GAP)))
    few = sheet.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(HERE / "environments.png", optimize=True)


if __name__ == "__main__":
    main()
