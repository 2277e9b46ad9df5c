"""Packing fraction at jamming over shear strain, as figure 2.7 of Schreck and O'Hern (2010), of 10 discs or ellipses.

    python recordings/families/map.py --packings 6 [--aspect 1.5 --step 0.01]

Each packing is sheared at zero pressure and (dotted) back; lines break where its contacts change.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm


def walk(particles: int, aspect: float, strain: float, step: float, seed: int) -> dict[str, np.ndarray | str]:
    """Return the rows of the way up to the strain and of the way back, and the changes of contacts of both."""
    shapes = {"packing_fraction": 0.8} if aspect == 1.0 else {"packing_fraction": 0.6, "shapes": pm.Ellipses(aspect)}
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), seed=seed, **shapes)
    pressure = 1e-8 if aspect == 1.0 else 1e-6
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="isotropic").packing
    made, offset, goal = {}, 0.0, strain
    for way in ("up", "down"):
        # a walk on which the packing is lost ends there, and the way back begins there
        run_ = pm.shear_families(packing, goal, step=step, check=False)
        made |= {f"{way}_{name}": column for name, column in run_.table().columns.items()}
        made[f"{way}_strain"] = run_.strain_t + offset
        rows = [(one.strain + offset, one.cause, one.route, one.jump, one.moved) for one in run_.changes]
        lines = [",".join(map(str, row)) for row in [("strain", "cause", "route", "jump", "moved"), *rows]]
        made[f"{way}_changes"] = "\n".join([*lines, ""])
        packing, offset = run_.packing, float(run_.strain_t[-1])
        goal = -offset
    return made


def main(
    *,
    particles: int = 10,
    packings: int = 10,
    aspect: float = 1.0,
    strain: float = 0.5,
    step: float = 2e-3,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Shear the packings, write the tables and draw the figure."""
    what = f"{particles}" if aspect == 1.0 else f"ellipses-{aspect:g}-{particles}"
    grid = {"particles": particles, "aspect": aspect, "strain": strain, "step": step, "seed": range(packings)}
    found = pm.run_ensemble(walk, grid, out / "members" / "map", workers=workers).of(grid)
    figure, ax = plt.subplots(figsize=(7.2, 5.4), layout="constrained")
    for k, seed in enumerate(found["seed"]):
        arrays = found.arrays(k)
        for way, style in (("up", "-"), ("down", ":")):
            columns = {name.removeprefix(f"{way}_"): x for name, x in arrays.items() if name.startswith(f"{way}_")}
            table = np.column_stack([*columns.values()])
            path = out / f"map-{what}-{seed}-{way}.csv"
            np.savetxt(path, table, "%.17g", delimiter=",", header=",".join(columns), comments="")
            (out / path.name.replace("map", "changes")).write_text(found[f"{way}_changes"][k])
            # two rows, before a change and after it, at a strain or with a fall between them
            new = (np.diff(columns["family"]) != 0) | (np.abs(np.diff(columns["strain"])) < 1e-8)
            for piece in np.split(np.arange(len(table)), np.flatnonzero(new) + 1):
                ax.plot(
                    columns["strain"][piece], columns["packing_fraction"][piece], f"C{k % 10}{style}", linewidth=0.9
                )
    ax.set(xlabel="shear strain", ylabel="packing fraction at jamming")
    ax.set_title(f"{packings} packings, {what}; breaks are changes of contacts", fontsize=8)
    figure.savefig(out / f"map-{what}.png", dpi=150)


if __name__ == "__main__":
    run(main)
