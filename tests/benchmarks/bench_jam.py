"""What jamming costs: CPU seconds to pressure 1e-8, medians over seeds, and where the time goes.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_jam.py
Stated for the machine of the calibration: 2D N = 64 within 0.1 s, 256 within 0.8, 1024 within 5, 4096 with scattered
radii within 45; 3D N = 1024 within 15.
"""

from __future__ import annotations

import statistics

import numpy as np
from calibration import calibrate

import packmech as pm

# (particles, dimension, scatter of radii, seeds, stated CPU seconds)
CASES = [
    (64, 2, 0.0, 5, 0.1),
    (256, 2, 0.0, 5, 0.8),
    (1024, 2, 0.0, 5, 5.0),
    (4096, 2, 0.03, 5, 45.0),
    (64, 3, 0.0, 5, None),
    (256, 3, 0.0, 5, None),
    (1024, 3, 0.0, 5, 15.0),
]


def start(particles: int, dimension: int, scatter: float, seed: int) -> pm.Scene:
    """Return a random start."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.9 if dimension == 2 else 0.68
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    if scatter:
        spread = 1.0 + scatter * np.random.default_rng(seed).standard_normal(particles)
        packing = packing.replace(radius_n=packing.radius_n * spread)
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))


def measure(strain: str) -> None:
    """Print one line per size."""
    print(f"strain {strain}")
    head = f"{'N':>5} {'d':>2} {'median s':>9} {'largest':>8} {'stated':>7}"
    print(f"{head}   quench / hard / certificate / soft [s], iterations")
    for particles, dimension, scatter, seeds, stated in CASES:
        runs = [pm.jam(start(particles, dimension, scatter, seed), strain=strain) for seed in range(1, seeds + 1)]
        seconds = [run.seconds for run in runs]
        parts = {"quench": [], "hard packing": [], "certificate": [], "soft packing": []}
        for run in runs:
            for name, part in parts.items():
                part.append(sum(stage.seconds for stage in run.stages if stage.name == name))
        iterations = [sum(stage.steps for stage in run.stages if stage.name == "hard packing") for run in runs]
        listed = " / ".join(f"{statistics.median(part):.3f}" for part in parts.values())
        bound = f"{stated:7.1f}" if stated is not None else "      -"
        middle, largest = statistics.median(seconds), max(seconds)
        line = f"{particles:5d} {dimension:2d} {middle:9.3f} {largest:8.3f} {bound}"
        print(f"{line}   {listed}, {statistics.median(iterations)}")


def main() -> None:
    """Compile, then print the calibration and the tables."""
    for dimension in (2, 3):
        pm.jam(start(32, dimension, 0.0, 1), strain="free")
    calibrate()
    for strain in ("isotropic", "free"):
        measure(strain)


if __name__ == "__main__":
    main()
