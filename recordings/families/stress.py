"""Shear stress over five decades of strain at constant volume, as figures 2.31 and 2.32 of Schreck and O'Hern (2010).

    python recordings/families/stress.py --packings 3

64 shear-stabilized discs 1:1.4 at 6e-5 to 2e-2 above jamming: linear up to the first change of contacts.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

DISTANCES, DECADES = (6e-5, 3e-4, 1e-3, 4e-3, 2e-2), (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
NAMES = ("distance", "strain", "shear_stress", "modulus", "pressure", "contacts", "first_change", "residual")


def follow(particles: int, distances: list[float], decades: list[float], seed: int) -> dict[str, np.ndarray]:
    """Return shear stresses, less that at the start, over the decades of strain at all distances above jamming."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    scene, rows = pm.Scene(start, (pm.Repulsion(),)), []
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-8, strain="free").packing)
    for one in pm.compress(scene, distances, strain="free", check=False):
        change, here = np.nan, scene.replace(packing=one.packing)
        for end in decades:
            # from the start in each decade, so that none inherits the steps of another; the first change once
            locate = "none" if np.isfinite(change) else "first"
            sheared = pm.quasistatic_shear(here, end, step=end / 8.0, locate=locate, check=False)
            change = sheared.first_change.strain if sheared.first_change is not None else change
            for k in np.flatnonzero(sheared.strain_t > 0.1 * end):
                stress = sheared.shear_stress_t[k] - sheared.shear_stress_t[0]
                last = sheared.pressure_t[k], sheared.contacts_t[k], change, sheared.residual_t[k]
                rows.append((one.report["distance"], sheared.strain_t[k], stress, sheared.modulus_t[0], *last))
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def main(
    *,
    particles: int = 64,
    packings: int = 3,
    distances: tuple[float, ...] = DISTANCES,
    decades: tuple[float, ...] = DECADES,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Shear the packings, write the table and draw a panel for each."""
    grid = {"particles": particles, "distances": [distances], "decades": [decades], "seed": range(packings)}
    found = pm.run_ensemble(follow, grid, out / "members" / "stress", workers=workers).of(grid)
    pm.write_table(found.rows(), out / f"stress-{particles}.csv")
    tables = [np.column_stack([*found.arrays(k).values()]) for k in range(len(found))]
    figure, axes = plt.subplots(1, packings, figsize=(4.2 * packings, 4.2), sharey=True, squeeze=False)
    for ax, table in zip(axes.flat, tables, strict=True):
        for number, distance in enumerate(np.unique(table[:, 0])):
            _, strain, stress, modulus, _, contacts, change, _ = table[table[:, 0] == distance].T
            # what unjammed bears no stress
            up = (stress > 0.0) & (contacts > 0)
            ax.loglog(strain[up], stress[up], f"C{number}o", markersize=3.0, label=f"{distance:.3g} above jamming")
            ax.loglog(strain, modulus * strain, f"C{number}-", linewidth=0.8)
            ax.loglog(change[-1:], (modulus * change)[-1:], f"C{number}|", markersize=14.0)
        ax.set(xlabel="shear strain", ylabel="shear stress, less that at the start")
    axes[0, 0].legend(fontsize=7)
    figure.suptitle("lines: modulus times strain; bars across: first change of contacts", fontsize=9)
    figure.savefig(out / f"stress-{particles}.png", dpi=150)


if __name__ == "__main__":
    run(main)
