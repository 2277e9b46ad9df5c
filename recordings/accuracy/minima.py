"""Which share of random starts ends in the minimum that steepest descent leads to, by method and damping, and phi_J.

    python recordings/accuracy/minima.py

64 discs 50:50, 1:1.4, V = overlap^2 / 2, at packing fraction .9. Two minima are the same when their energies agree and
their contact networks, rattlers taken out, are equal. Errors of shares are half of Wilson's interval.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from descents import METHODS, REFERENCE, end

import packmech as pm

HEAD = "method,starts,failed,same minimum,+-,energy per particle,jamming packing fraction,median force evaluations"


def share_and_error(hits: int, of: int) -> tuple[float, float]:
    """Return a share and its binomial error, half of Wilson's interval of one standard deviation."""
    share = hits / of
    return share, float(np.sqrt(share * (1.0 - share) / of + 1.0 / (4.0 * of**2)) / (1.0 + 1.0 / of))


def same(one: pm.Ensemble, other: pm.Ensemble) -> np.ndarray:
    """Return for each seed whether both ended in one minimum."""
    near = np.abs(one["energy"] - other["energy"]) <= 1e-8 * np.maximum(one["energy"], other["energy"])
    return near & (one["network"] == other["network"]) & (one["converged"] == 1) & (other["converged"] == 1)


def main(
    *,
    particles: int = 64,
    starts: int = 200,
    jammed: int = 20,
    methods: tuple[str, ...] = tuple(METHODS),
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Quench all starts by all methods, write the table and draw the figure."""
    grid = [{"method": list(methods), "particles": particles, "jammed": True, "seed": range(jammed)}]
    if starts > jammed:
        grid.append(grid[0] | {"jammed": False, "seed": range(jammed, starts)})
    found = pm.run_ensemble(end, grid, out / "members" / "minima", workers=workers).of(grid)
    reference, rows = found.where(method=REFERENCE), []
    for method in methods:
        mine = found.where(method=method)
        share = share_and_error(int(same(mine, reference).sum()), len(mine))
        failed, cost = int((mine["converged"] == 0).sum()), float(np.median(mine["evaluations"]))
        rows.append((len(mine), failed, *share, mine["energy"].mean() / particles, np.nanmean(mine["onset"]), cost))
    lines = [f'"{method}",' + ",".join(f"{one:.9g}" for one in row) for method, row in zip(methods, rows, strict=True)]
    (out / "minima.csv").write_text("\n".join([HEAD, *lines, ""]))
    figure, ax = plt.subplots(figsize=(7.2, 5.0), layout="constrained")
    ax.errorbar([row[2] for row in rows], range(len(rows)), xerr=[row[3] for row in rows], fmt="o", capsize=2.0)
    ax.set_yticks(range(len(methods)), methods)
    ax.set(xlabel=f"share of {starts} starts that end in the minimum of steepest descent", xlim=(-0.03, 1.03))
    figure.savefig(out / "minima.png", dpi=150)


if __name__ == "__main__":
    run(main)
