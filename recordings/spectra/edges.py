"""omega*, where the plateau of states of large packings of discs ends, over the distance to jamming.

python recordings/spectra/edges.py --packings 10
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

DISTANCES = tuple(float(x) for x in np.logspace(-5.0, -2.0, 7))
NAMES = ("distance", "plateau_edge", "plateau", "pressure", "excess_coordination", "residual")


def follow(particles: int, distances: list[float], seed: int) -> dict[str, np.ndarray]:
    """Return the rows of a packing that is followed upward: its states are counted without its stress, masses 1."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.9, seed=seed)
    scene, rows = pm.Scene(start, (pm.Repulsion(law=pm.LinearSpring()),)), []
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-7, strain="isotropic").packing)
    for distance, one in zip(distances, pm.compress(scene, distances, check=False), strict=False):
        here = scene.replace(packing=one.packing.replace(mass_n=np.ones(particles)))
        states = pm.density_of_states(here, np.logspace(-3.6, 0.8, 67), kind="unstressed")
        excess = 2.0 * one.report["excess_contacts"] / (particles - one.report["rattlers"])
        rows.append((distance, states.plateau_edge, states.plateau, one.report["pressure"], excess, one.residual))
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def main(
    *,
    particles: int = 1024,
    packings: int = 10,
    distances: tuple[float, ...] = DISTANCES,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Follow the packings, write the table and draw the figure."""
    grid = {"particles": particles, "distances": [sorted(distances)], "seed": range(packings)}
    found = pm.run_ensemble(follow, grid, out / "members" / "edges-2d", workers=workers).of(grid)
    rows = found.rows()
    pm.write_table(rows, out / "edges-2d.csv")
    some = np.isfinite(rows["plateau_edge"])
    distance, edge, excess = (rows[name][some] for name in ("distance", "plateau_edge", "excess_coordination"))
    x = np.unique(distance)
    edges = [edge[distance == one] for one in x]
    mean, error = np.array([(one.mean(), one.std() / np.sqrt(max(1, len(one) - 1))) for one in edges]).T
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    left.errorbar(x, mean, error, fmt="o", capsize=2.0)
    left.plot(x, mean[-1] * np.sqrt(x / x[-1]), ":", label="slope 1/2")
    left.legend()
    right.plot(excess, edge, ".")
    left.set(xscale="log", yscale="log", xlabel="packing fraction above jamming", ylabel=r"$\omega^*$")
    right.set(xscale="log", yscale="log", xlabel=r"contacts in excess, $z - z_{iso}$", ylabel=r"$\omega^*$")
    figure.suptitle(f"{packings} packings of N = {particles}")
    figure.savefig(out / "edges-2d.png", dpi=150)


if __name__ == "__main__":
    run(main)
