"""What the first call of its kind costs where nothing is compiled yet: this checkout against another version.

    python tests/benchmarks/bench_cold.py --tag PATH_OF_A_CHECKOUT [--repeats 2] [--rows PATTERN ...]

Each call runs in a new process with an empty cache, the other version ("tag") and the one that this file is in ("head")
in turn, with one thread. CPU seconds are the user's, which a shared machine lengthens less than the wall clock's; the
ratio of both is printed, and the exit code is 1 where that of CPU seconds is above its bound.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

_HERE = Path(__file__).resolve()
_HEAD = _HERE.parents[2]
SIDES = ("head", "tag")


class Row(NamedTuple):
    """A first call, and how much of the tag's time it may take."""

    code: str
    bound: float


_DISCS = "pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(), packing_fraction={}, seed=1)"
ROWS = {
    "packmech jam": Row("sys.argv = ['packmech', 'jam']; runpy.run_module('packmech', run_name='__main__')", 0.8),
    "oscillatory shear with friction and bonds": Row(
        f"""
packing = {_DISCS.format(0.95)}
effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(coefficient=0.3), pm.Friction())
scene = pm.Scene(packing, (*effects, pm.bond_contacts(packing)))
pm.oscillatory_shear(scene, amplitude=0.02, frequency=0.05, periods=1.0)
""",
        0.75,
    ),
    "simulate without friction": Row(
        f"pm.simulate(pm.Scene({_DISCS.format(0.7)}, (pm.Repulsion(),)), steps=20, temperature=0.01, seed=1)", 1.0
    ),
    "simulate with links": Row(
        """
packing = pm.chain_packing(8, 16, dimension=2, packing_fraction=0.3, seed=1)
pm.simulate(pm.Scene(packing, (pm.Repulsion(),)), steps=20, temperature=0.01, seed=1)
""",
        1.0,
    ),
}


class Cost(NamedTuple):
    """CPU and wall seconds of a process."""

    cpu: float
    wall: float


def first_call(checkout: Path, code: str) -> Cost:
    """Return what a new process takes for the code, with an empty cache."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    path = os.pathsep.join(map(os.fspath, (checkout, checkout / "envs")))
    program = f"import runpy, sys\nimport packmech as pm\n{code}"
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, **threads, "PYTHONPATH": path, "NUMBA_CACHE_DIR": f"{folder}/cache"}
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, time.perf_counter()
        done = subprocess.run([sys.executable, "-c", program], cwd=folder, env=environment, stdout=subprocess.DEVNULL)
        if done.returncode not in (0, 1):
            raise RuntimeError(f"the first call ended with {done.returncode}")
        cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        return Cost(cpu, time.perf_counter() - began)


def compare(tag: Path, names: list[str], repeats: int) -> int:
    """Print the table; return 1 where a first call takes longer than it may."""
    checkouts = {"tag": tag, "head": _HEAD}
    dear = []
    print(f"other processes that run: {os.getloadavg()[0]:.1f}; medians of {repeats}")
    print(f"{'first call':44s}{'tag CPU s':>10s}{'head':>8s}{'ratio':>8s}{'at most':>9s}{'wall':>8s}", flush=True)
    for name in names:
        taken: dict[str, list[Cost]] = {side: [] for side in SIDES}
        for k in range(repeats):
            for side in ("tag", "head") if k % 2 == 0 else ("head", "tag"):
                taken[side].append(first_call(checkouts[side], ROWS[name].code))
        median = {side: Cost(*map(statistics.median, zip(*costs, strict=True))) for side, costs in taken.items()}
        ratio, wall = (median["head"][k] / median["tag"][k] for k in range(2))
        if ratio > ROWS[name].bound:
            dear.append(name)
        print(
            f"{name:44s}{median['tag'].cpu:10.1f}{median['head'].cpu:8.1f}{ratio:8.2f}{ROWS[name].bound:9.2f}{wall:8.2f}",
            flush=True,
        )
    print(f"above what they may take: {', '.join(dear) or 'none'}")
    return int(bool(dear))


def main(words: list[str] | None = None) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tag", type=Path, required=True, help="a checkout of the other version")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--rows", nargs="+", default=["*"], metavar="PATTERN")
    given = parser.parse_args(words)
    names = [name for name in ROWS if any(fnmatch.fnmatch(name, pattern) for pattern in given.rows)]
    return compare(given.tag.resolve(), names, given.repeats)


if __name__ == "__main__":
    sys.exit(main())
