"""What cohesion costs: CPU time of a step of 10,648 spheres under Hertz's law, and under each kind of cohesion.

Spheres of an fcc lattice, each with twelve contacts, are stepped on one thread, one kind after the other, again and
again; lists are rebuilt as they must be. The ratio is the median of those of neighboring runs. Names of kinds choose
some of them.

    OMP_NUM_THREADS=1 python tests/benchmarks/bench_cohesion.py [JKR ...]
"""

from __future__ import annotations

import sys
import time

import numpy as np

import packmech as pm

REPEATS, STEPS, ROUNDS = (22, 22, 22), 50, 7
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
    packing = pm.lattice_packing("fcc", repeats=REPEATS, relative_overlap=0.01)
    kinds = {name: one for name, one in KINDS.items() if name in ["Hertz", *(sys.argv[1:] or KINDS)]}
    took: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(ROUNDS + 1):
        for name, effects in kinds.items():
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
