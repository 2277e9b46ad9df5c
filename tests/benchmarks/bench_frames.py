"""What a picture and a recorded frame cost, in CPU time, by the number of particles.

python tests/benchmarks/bench_frames.py
"""

from __future__ import annotations

import tempfile
import time

import packmech as pm

REPEATS = 30


def seconds(call):
    """Return the least CPU seconds of one call, the first left out."""
    call()
    best = float("inf")
    for _ in range(REPEATS):
        began = time.process_time()
        call()
        best = min(best, time.process_time() - began)
    return best


def main() -> None:
    """Print a table."""
    print(f"{'':24}{'N':>6}{'draw_frame 480 x 480':>24}{'Recording.add, written':>24}")
    for dimension, particles in ((2, 64), (2, 256), (2, 1024), (3, 256)):
        fraction = 0.9 if dimension == 2 else 0.7
        packing = pm.random_packing(particles, dimension=dimension, packing_fraction=fraction, seed=1)
        scene = pm.Scene(packing, (pm.Repulsion(),))
        scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-6).packing)
        drawn = seconds(lambda scene=scene: pm.draw_frame(scene.packing, effects=scene.effects))
        frames = 100
        with tempfile.TemporaryDirectory() as folder:
            with pm.Recording(folder + "/first.rrd", scene) as first:  # loads what writes
                first.add(scene.packing)
            began = time.process_time()
            with pm.Recording(folder + "/a.rrd", scene) as recording:
                for _ in range(frames):
                    recording.add(scene.packing, figures={"height": 1.0})
            recorded = (time.process_time() - began) / frames
        kind = "discs" if dimension == 2 else "spheres"
        print(f"{kind:24}{particles:6d}{1e3 * drawn:21.2f} ms{1e3 * recorded:21.2f} ms", flush=True)


if __name__ == "__main__":
    main()
