"""What a verdict costs: by packing, method and solver, and where the time goes.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_verdict.py
Figures on the machine of the stated bounds (2D N = 1024 within 0.2 CPU seconds): see the table that this prints.
"""

from __future__ import annotations

import statistics
import time

from calibration import calibrate, cpu_seconds

import packmech as pm
from packmech.mechanics.motions import motion_cone
from packmech.mechanics.programs import largest_smallest_force
from packmech.mechanics.touching import backbone_contacts, check_rest, find_touching

PRESSURE = 1e-8
CASES = [(256, 2, "free"), (1024, 2, "free"), (1024, 2, "fixed"), (256, 3, "free"), (1024, 3, "free")]


def soft_packing(particles: int, dimension: int, strain: str, seed: int) -> pm.Packing:
    """Return a packing at pressure 1e-8 from a random start."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=PRESSURE, strain=strain).packing


def measure_methods(seeds: int) -> None:
    """Print the CPU seconds of whole verdicts, the median over seeds and the largest."""
    print(
        f"{'N':>5} {'d':>2} {'strain':>6} {'method':>12} {'median s':>9} {'largest s':>9}  verdicts (collective/strict)"
    )
    for particles, dimension, strain in CASES:
        count = 1 if (particles, dimension) == (1024, 3) else seeds
        packings = [soft_packing(particles, dimension, strain, seed) for seed in range(1, count + 1)]
        for method in ("certificate", "loads"):
            taken, found = [], []
            for packing in packings:
                started = time.process_time()
                verdict = pm.classify_jamming(packing, method=method)
                taken.append(time.process_time() - started)
                found.append(f"{verdict.collective}/{verdict.strict}")
            listed = ", ".join(f"{found.count(one)} x {one}" for one in dict.fromkeys(found))
            middle, largest = statistics.median(taken), max(taken)
            print(f"{particles:5d} {dimension:2d} {strain:>6} {method:>12} {middle:9.3f} {largest:9.3f}  {listed}")


def measure_parts() -> None:
    """Print where the time of one verdict goes, 2D N = 1024, every strain free."""
    packing = soft_packing(1024, 2, "free", 1)
    network = backbone_contacts(find_touching(packing, None).contacts)
    cone = motion_cone(packing, network, strain=True)
    parts = {
        "contacts at four tolerances": lambda: find_touching(packing, None),
        "rest": lambda: check_rest(packing, None, 1e-5),
        "cone": lambda: motion_cone(packing, network, strain=True),
        "rank": lambda: motion_cone(packing, network, strain=True).softest(),
        "force program": lambda: largest_smallest_force(cone),
    }
    for name, function in parts.items():
        print(f"{name:>28}: {1e3 * cpu_seconds(function, repeats=5):7.2f} ms")


if __name__ == "__main__":
    calibrate()
    pm.classify_jamming(pm.lattice_packing("triangular", (4, 4)))
    measure_parts()
    measure_methods(seeds=5)
