"""What an ensemble costs beside its members: CPU time of a member that does nothing, and two processes against one.

    python tests/benchmarks/bench_ensemble.py [packings]

The first table is of `square`, which returns four numbers: time of everything that belongs to the call (who watches,
the processes, writing and reading), from the difference of two sizes, so that starting processes drops out. The second
is of packings of 64 discs with contacts and moduli, with one process and two in turns, from the same seeds.
"""

from __future__ import annotations

import pathlib
import resource
import shutil
import sys
import tempfile
import time

import packmech as pm

JOB = f"{pathlib.Path(__file__).parents[1] / 'ensemble' / 'jobs.py'}:square"
MEASURES = ["jamming_packing_fraction", "contacts", "bulk_modulus", "shear_modulus"]


def cpu() -> float:
    """Return the CPU time of this process and of those that ended [s]."""
    return sum(
        one.ru_utime + one.ru_stime
        for one in (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    )


def timed(job: str, grid: dict[str, object], workers: int, **options: object) -> tuple[float, float]:
    """Return wall and CPU time of an ensemble in a new folder."""
    folder = pathlib.Path(tempfile.mkdtemp())
    wall, before = time.perf_counter(), cpu()
    found = pm.run_ensemble(job, grid, folder / "out", workers=workers, **options)
    spent = time.perf_counter() - wall, cpu() - before
    assert found.counts()["done"] == len(found)
    shutil.rmtree(folder)
    return spent


def main() -> None:
    """Print both tables."""
    packings = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    few, many = 100, 2100
    print(f"{'processes':>9}  {'wall ms':>8}  {'CPU ms':>8}   of a member that does nothing")
    for workers in (1, 2):
        small, large = timed(JOB, {"seed": range(few)}, workers), timed(JOB, {"seed": range(many)}, workers)
        wall, spent = (1e3 * (b - a) / (many - few) for a, b in zip(small, large, strict=True))
        print(f"{workers:>9}  {wall:8.3f}  {spent:8.3f}")
    for folder_of in (few, many):
        with tempfile.TemporaryDirectory() as place:
            pm.run_ensemble(JOB, {"seed": range(folder_of)}, pathlib.Path(place, "out"), workers=2)
            began = time.process_time()
            pm.read_ensemble(pathlib.Path(place, "out"))
            print(
                f"table of {folder_of} members: {1e3 * (time.process_time() - began) / folder_of:.3f} CPU ms a member"
            )
    grid = {"packing.particles": 64, "seed": range(packings)}
    print(f"{'processes':>9}  {'wall s':>8}  {'CPU s':>8}   {packings} packings of 64 discs")
    walls: dict[int, list[float]] = {1: [], 2: []}
    for workers in (2, 1, 2, 1):
        wall, spent = timed("default", grid, workers, measures=MEASURES)
        walls[workers].append(wall)
        print(f"{workers:>9}  {wall:8.2f}  {spent:8.2f}")
    print("one over two processes:", ", ".join(f"{a / b:.2f}" for a, b in zip(walls[1], walls[2], strict=True)))


if __name__ == "__main__":
    main()
