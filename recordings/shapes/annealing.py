"""Ellipses 1:1.4 quenched, and annealed from discs in steps of the aspect: packing fraction, contacts and order.

    python recordings/shapes/annealing.py --packings 10 --aspects 1.1 --aspects 1.3 --aspects 1.5 ...

N = 64, pressure 1e-6, square boxes: figure 2.18 of Schreck and O'Hern with orders. Step 0 is a quench from random.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from packings import MEASURED, PANELS, measured

import packmech as pm

ASPECTS = (1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0, 2.5, 3.0)
NAMES = ("aspect", *MEASURED, "states_of_self_stress", "reached")


def prepare(particles: int, step: float, aspects: list[float], pressure: float, seed: int) -> dict[str, np.ndarray]:
    """Return the numbers of the packings of one seed over the aspects, each annealed on from the one before."""
    given = {"dimension": 2, "sizes": pm.Bidisperse(ratio=1.4), "seed": seed}
    settings = {"pressure": pressure, "strain": "isotropic"}
    scene = pm.Scene(pm.random_packing(particles, packing_fraction=0.9, **given), (pm.Repulsion(),))
    scene, last, rows = scene.replace(packing=pm.jam(scene, **settings).packing), 1.0, []
    for aspect in aspects:
        if step == 0.0:
            start = pm.random_packing(particles, packing_fraction=0.6, shapes=pm.Ellipses(aspect), **given)
            found = pm.jam(pm.Scene(start, (pm.Repulsion(),)), check=False, **settings)
            reached = found.ok
        else:
            way = np.linspace(last, aspect, max(1, round((aspect - last) / step)) + 1)[1:].tolist()
            draw = seed if last == 1.0 else None
            found = pm.anneal_shape(scene, way, seed=draw, pressure=pressure, check=False)[-1]
            reached = found.ok and found.report.get("aspect", aspect) == aspect
            if reached:
                scene, last = scene.replace(packing=found.packing), aspect
        rows.append((aspect, *measured(found), float(reached)))
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def main(
    *,
    particles: int = 64,
    packings: int = 3,
    steps: tuple[float, ...] = (0.0, 0.05),
    aspects: tuple[float, ...] = ASPECTS,
    pressure: float = 1e-6,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Prepare the packings, write a table of each step and draw the figure."""
    grid = {"particles": particles, "step": steps, "aspects": [aspects], "pressure": pressure, "seed": range(packings)}
    found = pm.run_ensemble(prepare, grid, out / "members" / "annealing", workers=workers).of(grid)
    figure, axes = plt.subplots(2, 2, figsize=(10.0, 7.2), layout="constrained")
    for step in steps:
        table = found.where(step=step).rows()
        pm.write_table(table, out / f"annealed-{step:g}.csv")
        for ax, name in zip(axes.flat, PANELS, strict=True):
            value_ra = np.where(table["reached"] > 0.0, table[name], np.nan).reshape(-1, len(aspects))
            error = np.nanstd(value_ra, axis=0) / np.sqrt(max(1, len(value_ra) - 1))
            label = f"annealed, steps of {step:g}" if step else "quenched"
            ax.errorbar(aspects, np.nanmean(value_ra, axis=0), error, marker="o", capsize=2.0, label=label)
            ax.set(xlabel="aspect", ylabel=name.replace("_", " "))
    axes[0, 0].legend()
    figure.savefig(out / "annealing.png", dpi=150)


if __name__ == "__main__":
    run(main)
