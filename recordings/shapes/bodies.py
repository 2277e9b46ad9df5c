"""Jammed rigid bodies over their shape: dimers over their asymmetry, trimers over their bend.

    python recordings/shapes/bodies.py --packings 5

Bodies bent enough pack isostatically: one state of self stress. Straight trimers that are alike (N = 64, P = 1e-7) have
12 to 18 instead, of which all but one live on the contacts between two bodies alone, which lie side by side. That is no
property of trimers: with radii of beads larger or smaller by up to 5 percent (`--scatter 0.05`) every packing has one.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

# beads and shape: radius of a dimer's smaller bead over the larger one's; angle of a trimer's arms [degrees]
SHAPES = {2: (0.2, 0.4, 0.6, 0.8, 1.0), 3: (60.0, 90.0, 120.0, 150.0, 180.0)}
NAMES = ("packing_fraction", "rattlers", "contacts", "isostatic_contacts", "floppy_modes", "states_of_self_stress")


def start(particles: int, beads: int, shape: float, scatter: float, seed: int) -> pm.Packing:
    """Return a dilute packing of dimers or trimers whose beads have radii of their own, evenly spread."""
    dimer = pm.Dimer(0.4 * (1.0 + shape), radii=(0.5, 0.5 * shape)) if beads == 2 else None
    trimer = pm.LinearCluster(3, 0.8) if shape == 180.0 else pm.Trimer(0.8, float(np.radians(shape)))
    packing = pm.random_packing(particles, dimension=2, packing_fraction=0.5, seed=seed, shapes=dimer or trimer)
    if scatter == 0.0:
        return packing
    loose = pm.bead_packing(packing)
    factor_b = 1.0 + scatter * np.random.default_rng(seed).uniform(-1.0, 1.0, loose.particles)
    return pm.rigid_packing(loose.replace(radius_n=loose.radius_n * factor_b), packing.shapes.particle_b)


def states_within_pairs(packing: pm.Packing) -> int:
    """Return the number of independent states of self stress that live on the contacts between two bodies alone."""
    packing, _ = pm.remove_rattlers(packing)
    one = pm.find_shape_contacts(packing)
    pair = np.unique(np.column_stack([one.i_c, one.j_c, one.image_cd]), axis=0, return_inverse=True)[1].ravel()
    several = np.flatnonzero(np.bincount(pair) > 1)
    return sum(pm.states_of_self_stress(packing, contacts=one.select(pair == each)).count for each in several)


def jam(particles: int, beads: int, shape: float, pressure: float, scatter: float, seed: int) -> dict[str, Any]:
    """Return what is counted of a jammed packing, every strain free, and the packing."""
    found = pm.jam(pm.Scene(start(particles, beads, shape, scatter, seed), (pm.Repulsion(),)), pressure=pressure)
    counts = {name: found.report[name] for name in NAMES}
    return counts | {
        "jamming_packing_fraction": found.report.get("jamming_packing_fraction", np.nan),
        "coordination_number": 2.0 * counts["contacts"] / (particles - counts["rattlers"]),
        "states_within_pairs": states_within_pairs(found.packing),
        "certain": bool(found.report.get("rank_certain", False)),
        "residual": found.residual,
        "packing": found.packing,
    }


def main(
    *,
    particles: int = 64,
    packings: int = 3,
    pressure: float = 1e-7,
    scatter: float = 0.0,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Jam the packings, write the table and draw the figure."""
    common = {"particles": particles, "pressure": pressure, "scatter": scatter, "seed": range(packings)}
    grid = [common | {"beads": beads, "shape": shapes} for beads, shapes in SHAPES.items()]
    found = pm.run_ensemble(jam, grid, out / "members" / "bodies-2d", workers=workers).of(grid)
    pm.write_table(found, out / "bodies-2d.csv")
    figure, axes = plt.subplots(2, 2, figsize=(9.0, 6.4), sharex="col", layout="constrained")
    for column, (beads, words) in enumerate(((2, "smaller over larger radius"), (3, "angle of trimers [degrees]"))):
        for ax, name in zip(axes[:, column], ("jamming_packing_fraction", "coordination_number"), strict=True):
            mean = pm.group_statistics(found.where(beads=beads), name, ["shape"])
            ax.errorbar(mean.by["shape"], mean.value_g, mean.error_g, marker="o", capsize=2.0)
            ax.set(ylabel=name.replace("_", " "))
        axes[1, column].set(xlabel=words)
    figure.suptitle(f"{packings} packings each of N = {particles}, pressure {pressure:g}, scatter {scatter:g}")
    figure.savefig(out / "bodies-2d.png", dpi=150)


if __name__ == "__main__":
    run(main)
