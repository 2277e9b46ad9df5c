"""What cohesion costs: CPU time of a step of 10,000 spheres under Hertz's law, and under each kind of cohesion.

Spheres near jamming are stepped on one thread, one kind after the other, again and again; lists are rebuilt as they
must be. The ratio is the median of those of neighboring runs.

    OMP_NUM_THREADS=1 python tests/benchmarks/bench_cohesion.py
"""

from __future__ import annotations

import time

import numpy as np

import packmech as pm

PARTICLES, FRACTION, STEPS, ROUNDS = 10_000, 0.66, 100, 7
HERTZ = pm.Repulsion(pm.Hertz(2.0 / 3.0))
KINDS = {
    "Hertz": (HERTZ,),
    "short-range attraction": (HERTZ, pm.ShortRangeAttraction(0.1, 0.01)),
    "DMT": (HERTZ, pm.DMT(1e-4, 1e-3)),
    "JKR": (pm.JKR(1.0, 1e-4),),
    "capillary bridge": (HERTZ, pm.CapillaryBridge(1e-6, 1e-4)),
}


def main() -> None:
    """Print microseconds of a step and the ratio to Hertz's law."""
    packing = pm.random_packing(PARTICLES, dimension=3, packing_fraction=FRACTION, seed=1)
    packing = pm.quench(pm.Scene(packing, (HERTZ,)), force_tolerance=1e-3, check=False).packing
    took: dict[str, list[float]] = {name: [] for name in KINDS}
    for _ in range(ROUNDS + 1):
        for name, effects in KINDS.items():
            scene = pm.Scene(packing, (*effects, pm.ContactDamping(0.1)))
            times = []
            for steps in (1, STEPS + 1):
                begin = time.process_time()
                pm.simulate(scene, steps=steps, dt=0.02, temperature=1e-6, seed=1, check=False)
                times.append(time.process_time() - begin)
            took[name].append((times[1] - times[0]) / STEPS)
    for name, one in took.items():
        # the first round compiles
        ratio = np.median(np.divide(one[1:], took["Hertz"][1:]))
        print(f"{name:24} {1e6 * np.median(one[1:]):10.0f} us a step {ratio:8.2f} of Hertz's")


if __name__ == "__main__":
    main()
