"""The table of costs in the guide's page `choosing`: CPU seconds of the usual calls against size and dimension.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_guide.py [LARGEST_N]
Bidisperse discs 1:1.4 and equal spheres, harmonic; medians over three seeds, of one seed above 1024 particles. All is
compiled before it is timed. A run that needs longer than the limit, or that is not made for large N, is not listed.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

from calibration import calibrate

import packmech as pm
from packmech.result import markdown_table

SIZES, DIMENSIONS, LIMIT = (64, 256, 1024, 4096), (2, 3), 250.0
HEADINGS = (
    "N",
    "d",
    "quench to 1e-10",
    "jam, 1e-4",
    "jam, 1e-8",
    "jam, 1e-8, box of fixed shape",
    "verdict",
    "moduli",
    "50 modes",
)


def start(particles: int, dimension: int, seed: int) -> pm.Scene:
    """Return a random start above jamming."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.9 if dimension == 2 else 0.7
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    return pm.Scene(packing, (pm.Repulsion(),))


def timed(call: Callable[[], object]) -> tuple[float, object]:
    """Return the CPU seconds of a call, and what it returned."""
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def measure(particles: int, dimension: int, seed: int) -> list[float]:
    """Return the seconds in the order of the headings; nan where a run did not converge within the limit."""
    scene = start(particles, dimension, seed)
    wanted = [(1e-4, "free"), (1e-8, "free"), (1e-8, "isotropic")]
    tried = [timed(lambda: pm.quench(scene, force_tolerance=1e-10, time_limit=LIMIT, check=False))]
    for pressure, strain in wanted:
        if pressure > 1e-8 and particles > 1024:
            tried.append((float("nan"), None))
            continue
        tried.append(timed(lambda p=pressure, s=strain: pm.jam(scene, p, strain=s, time_limit=LIMIT, check=False)))
    seconds = [spent if run is not None and run.ok else float("nan") for spent, run in tried]
    jammed = scene.replace(packing=tried[2][1].packing)
    seconds += [
        timed(call)[0]
        for call in (
            lambda: pm.classify_jamming(jammed),
            lambda: pm.elastic_moduli(jammed),
            lambda: pm.normal_modes(jammed, 50),
        )
    ]
    return seconds


def main() -> None:
    """Compile, then print the calibration and the table, line by line."""
    largest = int(sys.argv[1]) if len(sys.argv) > 1 else SIZES[-1]
    for dimension in DIMENSIONS:
        measure(64, dimension, 9)
    calibrate()
    rows = []
    for dimension in DIMENSIONS:
        for particles in (one for one in SIZES if one <= largest):
            seeds = (1, 2, 3) if particles <= 1024 else (1,)
            trials = [measure(particles, dimension, seed) for seed in seeds]
            # a seed that did not converge is no part of a median
            columns = [[one for one in column if one == one] for column in zip(*trials, strict=True)]
            found = [f"{statistics.median(column):.2g}" if column else "-" for column in columns]
            rows.append((str(particles), str(dimension), *found))
            print(*rows[-1], [len(column) for column in columns], flush=True)
    print(markdown_table(HEADINGS, rows))


if __name__ == "__main__":
    main()
