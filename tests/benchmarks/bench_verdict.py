"""What a verdict costs: seconds, memory and accuracy against the goals, by packing and method; where the time goes.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_verdict.py [goals]
With "goals" only the table of goals is made. Packings up to N = 4096 in 2D and 1024 in 3D come from `pm.jam`, larger
ones are copies of these; a verdict on copies is one on more motions, with a state of self stress or more for each.
"""

from __future__ import annotations

import multiprocessing
import statistics
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np
from calibration import REFERENCE_NS, calibrate, cpu_seconds

import packmech as pm
from packmech.jamming.certificates import yield_to_loads
from packmech.jamming.contact_selection import backbone_contacts, backbone_of, check_rest, select_contacts
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.programs import largest_smallest_force

PRESSURE = 1e-8
# particles, dimension, copies of the jammed cell, seconds and megabytes asked for
GOALS = (
    (4096, 2, (1, 1), 1.0, None),
    (16384, 2, (2, 2), 5.0, 300.0),
    (2048, 3, (2, 1, 1), 3.0, None),
    (4096, 3, (2, 2, 1), 10.0, None),
)
LONGEST, GAP = 1e-6, 1e-8
CASES = [(256, 2, "free"), (1024, 2, "free"), (1024, 2, "isotropic"), (256, 3, "free"), (1024, 3, "free")]


def soft_packing(particles: int, dimension: int, strain: str, seed: int, pressure: float = PRESSURE) -> pm.Packing:
    """Return a packing at a low pressure from a random start."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain=strain).packing


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
    network = backbone_contacts(select_contacts(packing, None).contacts)
    cone = motion_cone(packing, network, strain="free")
    parts = {
        "contacts at four tolerances": lambda: select_contacts(packing, None),
        "rest": lambda: check_rest(packing, None, 1e-5),
        "cone": lambda: motion_cone(packing, network, strain="free"),
        "rank": lambda: motion_cone(packing, network, strain="free").softest(),
        "force program": lambda: largest_smallest_force(cone),
    }
    for name, function in parts.items():
        print(f"{name:>28}: {1e3 * cpu_seconds(function, repeats=5):7.2f} ms")


@cache
def cell(particles: int, dimension: int) -> pm.Packing:
    """Return the jammed packing that is copied, at a pressure low enough for the contacts of hard particles."""
    return soft_packing(particles, dimension, "free", 1, pressure=1e-9)


def one_verdict(packing: pm.Packing, method: str) -> tuple[float, float, str, float, float]:
    """Return CPU seconds (median of three), megabytes beyond the idle process, verdict, gap and longest motion."""
    pm.classify_jamming(pm.lattice_packing("triangular", (4, 4)), method=method)
    idle = _peak(reset=True)
    verdict = pm.classify_jamming(packing, method=method)
    peak = _peak() - idle
    seconds = cpu_seconds(lambda: pm.classify_jamming(packing, method=method), repeats=3)
    strictly = verdict.strictly
    gap = max(one.gap for one in strictly.solves)
    said = f"{verdict.collective}/{verdict.strict}, {strictly.states_of_self_stress} states"
    return seconds, peak, said, gap, _longest(packing, method)


def _peak(*, reset: bool = False) -> float:
    """Return the most memory that the process had resident, since the last reset [MB]; Linux only."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1000.0


def _longest(packing: pm.Packing, method: str) -> float:
    """Return the longest motion that the load programs leave, of their bound; NaN for the certificate."""
    if method != "loads":
        return np.nan
    network, kept = backbone_of(packing, select_contacts(packing, None).contacts)
    cone = motion_cone(packing, network, strain="free", kept_n=kept)
    return float(yield_to_loads(cone, np.random.default_rng(0)).longest)


def measure_goals(slowness: float) -> None:
    """Print the table of goals, every row in a process of its own; slowness is the calibration ratio."""
    print(
        f"goals, x {slowness:.2f} for this machine; MB beyond the idle process; max|y| at most {LONGEST:.0e} of its "
        f"bound for loads, duality gap at most {GAP:.0e} for the certificate"
    )
    heading = f"{'N':>6} {'d':>2} {'method':>12} {'goal s':>7} {'s':>7} {'part':>5} {'goal MB':>8} {'MB':>6}"
    print(f"{heading} {'gap':>8} {'max|y|':>8}  collective/strict")
    spawning = multiprocessing.get_context("spawn")
    for particles, dimension, repeats, seconds, memory in GOALS:
        packing = cell(particles // int(np.prod(repeats)), dimension).repeated(repeats)
        for method in ("certificate", "loads"):
            with spawning.Pool(1) as pool:
                took, peak, said, gap, longest = pool.apply(one_verdict, (packing, method))
            part = took / (seconds * slowness)
            asked = "-" if memory is None else f"{memory:.0f}"
            print(
                f"{particles:6d} {dimension:2d} {method:>12} {seconds:7.1f} {took:7.2f} {part:5.2f} {asked:>8} "
                f"{peak:6.0f} {gap:8.1e} {longest:8.1e}  {said}",
                flush=True,
            )


if __name__ == "__main__":
    slowness = calibrate() / REFERENCE_NS
    pm.classify_jamming(pm.lattice_packing("triangular", (4, 4)))
    measure_goals(slowness)
    if sys.argv[1:] == ["goals"]:
        sys.exit()
    measure_parts()
    measure_methods(seeds=5)
