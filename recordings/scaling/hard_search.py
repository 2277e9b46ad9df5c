"""How the search for the exact hard packing grows with N: its steps and the seconds of each, apart.

    python recordings/scaling/hard_search.py --particles 256 --particles 1024 --particles 4096 --seeds 3

Discs of two sizes, 1 and 1.4, whose radii scatter by 3 %, jammed at a pressure of 1e-8 with every strain free; medians
over seeds, seconds of CPU on one thread.
"""

from pathlib import Path

import numpy as np
from cyclopts import run
from matplotlib.figure import Figure

import packmech as pm

HERE = Path(__file__).parent
COLUMNS = ("particles", "steps", "milliseconds_a_step", "seconds_of_search", "seconds")


def search(particles: int, seed: int) -> tuple[float, ...]:
    """Return steps of the search, milliseconds of each, its seconds, and those of the whole run."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    spread = 1.0 + 0.03 * np.random.default_rng(seed + 1000).standard_normal(particles)
    found = pm.jam(pm.Scene(packing.replace(radius_n=packing.radius_n * spread), (pm.Repulsion(law=pm.Harmonic()),)))
    stages = [one for one in found.stages if one.name == "hard packing"]
    steps, seconds = sum(one.steps for one in stages), sum(one.seconds for one in stages)
    return steps, 1e3 * seconds / steps, seconds, sum(one.seconds for one in found.stages)


def main(particles: tuple[int, ...] = (256, 1024, 4096), *, seeds: int = 3, first: int = 20, out: Path = HERE) -> None:
    """Measure, and write `hard-search.csv` and `hard-search.png`."""
    search(64, 0)
    rows = [(n, *np.median([search(n, first + k) for k in range(seeds)], axis=0)) for n in particles]
    table = np.array(rows)
    np.savetxt(out / "hard-search.csv", table, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.4g")
    figure = Figure(figsize=(4.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for column, name in ((1, "steps"), (2, "milliseconds a step")):
        slope = np.polyfit(np.log(table[:, 0]), np.log(table[:, column]), 1)[0] if len(table) > 1 else np.nan
        axes.loglog(table[:, 0], table[:, column], "o-", label=f"{name}, slope {slope:.2f}")
    axes.set_xlabel("N")
    axes.legend()
    figure.savefig(out / "hard-search.png", dpi=150)


if __name__ == "__main__":
    run(main)
