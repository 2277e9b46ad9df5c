"""What counted modes cost: a number of modes of a million discs, and a window of five hundred of a hundred thousand.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_mode_counts.py
Copies of a jammed box side by side are at rest. With a word, only the parts named: discs, window, spheres.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

import packmech as pm

PRESSURE = 1e-4
LIMIT_SECONDS, LIMIT_BYTES = 60.0, 8e9


def jammed(particles: int, dimension: int, repeats: tuple[int, ...]) -> tuple[pm.Scene, float]:
    """Return copies of a jammed box, and the frequency at which the plateau of one box ends."""
    start = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.84 if dimension == 2 else 0.64, seed=1,
    )  # fmt: skip
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.jam(scene, pressure=PRESSURE, strain="free", force_tolerance=1e-12, check=False)
    scene = scene.replace(packing=run.packing)
    states = pm.density_of_states(scene, np.geomspace(1e-3, 4.0, 67), kind="unstressed")
    return scene.replace(packing=run.packing.repeated(repeats)), states.plateau_edge


def peak() -> float:
    """Return the largest memory of this process so far [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def counts(words: str, particles: int, dimension: int, repeats: tuple[int, ...]) -> None:
    """Print what a number of modes below the plateau's end costs."""
    scene, edge = jammed(particles, dimension, repeats)
    begin = time.perf_counter()
    found = pm.count_modes(scene, edge, signs=False)
    wall = time.perf_counter() - begin
    print(
        f"{words}: N = {scene.packing.particles}: {found.count_v[0]} of {found.available} modes below omega* = "
        f"{edge:.4g}, certain {found.certain_v[0]} (doubt {found.doubt_v[0]:.1e}, nearest {found.distance_v[0]:.1e})\n"
        f"  {found.seconds:.1f} s CPU ({wall:.1f} s), factors {found.memory / 1e9:.2f} GB, peak {peak() / 1e9:.2f} GB"
    )
    if dimension == 2:
        within = found.seconds < LIMIT_SECONDS and peak() < LIMIT_BYTES
        print(f"  within {LIMIT_SECONDS:.0f} s and {LIMIT_BYTES / 1e9:.0f} GB: {within}")


def window(particles: int, repeats: tuple[int, ...], wanted: int = 500) -> None:
    """Print what a window of modes costs."""
    scene, edge = jammed(particles, 2, repeats)
    high = 1.05 * edge
    for _ in range(3):
        few, many = pm.count_modes(scene, [edge, high], signs=False).count_v.tolist()
        high = edge + (high - edge) * wanted / max(many - few, 1)
    begin = time.perf_counter()
    modes = pm.normal_modes(scene, between=(edge, high))
    wall = time.perf_counter() - begin
    print(
        f"window: N = {scene.packing.particles}: {len(modes)} modes from number {modes.below} on, {modes.missed} "
        f"missed, certain {modes.certain}; residual {modes.residual:.1e} of the largest eigenvalue, "
        f"{modes.relative_residual:.1e} of the own\n"
        f"  {modes.seconds:.1f} s CPU ({wall:.1f} s), peak {peak() / 1e9:.2f} GB"
    )


if __name__ == "__main__":
    parts = sys.argv[1:] or ["discs", "window", "spheres"]
    if "discs" in parts:
        counts("discs", 4096, 2, (16, 16))
    if "window" in parts:
        window(4096, (5, 5))
    if "spheres" in parts:
        counts("spheres", 2048, 3, (3, 4, 4))
