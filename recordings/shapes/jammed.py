"""Jammed ellipses 1:1.4, or spheroids, over their aspect: packing fraction, contacts, quartic modes, sorted spectra.

python recordings/shapes/jammed.py --packings 10 [--dimension 3 --particles 64 --aspects 0.6 --aspects 0.8 ...]
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

ASPECTS = (1.02, 1.06, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 3.0)
NAMES = ("packing_fraction", "jamming_packing_fraction", "rattlers", "contacts", "isostatic_contacts")


def jam(dimension: int, particles: int, aspect: float, pressure: float, seed: int) -> dict[str, Any]:
    """Return what is counted of a packing jammed in a box of fixed shape, its sorted frequencies, and the packing."""
    given = {"sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": {2: 0.6, 3: 0.4}[dimension], "seed": seed}
    start = pm.random_packing(particles, dimension=dimension, shapes=pm.Ellipses(aspect), **given)
    scene = pm.Scene(start, (pm.Repulsion(),))
    found = pm.jam(scene, pressure=pressure, strain="isotropic", check=False)
    jammed = scene.replace(packing=found.packing)
    quartic, modes = pm.quartic_modes(jammed), pm.normal_modes(jammed)
    counts = {name: found.report.get(name, np.nan) for name in (*NAMES, "states_of_self_stress")}
    return counts | {
        "coordination_number": 2.0 * counts["contacts"] / (particles - counts["rattlers"]),
        "quartic_modes": len(quartic),
        "certain": bool(found.report.get("rank_certain", False) and quartic.certain and found.ok),
        "smallest_curvature": float(min(quartic.curvature_m, default=np.nan) / quartic.pressure),
        "largest_curvature": float(max(quartic.curvature_m, default=np.nan) / quartic.pressure),
        "unstable_modes": modes.negative,
        "residual": found.residual,
        "frequency_m": np.sqrt(np.maximum(modes.eigenvalue_m, 0.0)),
        "packing": found.packing,
    }


def main(
    *,
    dimension: int = 2,
    particles: int = 128,
    packings: int = 3,
    aspects: tuple[float, ...] = ASPECTS,
    pressure: float = 1e-7,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Jam the packings, write the table and draw the figure."""
    name = f"jammed-{dimension}d"
    grid = {"dimension": dimension, "particles": particles, "aspect": aspects, "pressure": pressure}
    grid["seed"] = range(packings)
    found = pm.run_ensemble(jam, grid, out / "members" / name, workers=workers).of(grid)
    pm.write_table(found, out / f"{name}.csv")
    figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.0), layout="constrained")
    for ax, quantity in zip(axes, ("jamming_packing_fraction", "coordination_number"), strict=False):
        mean = pm.group_statistics(found, quantity, ["aspect"])
        ax.errorbar(mean.by["aspect"], mean.value_g, mean.error_g, marker="o", capsize=2.0)
        ax.set(xlabel="aspect", ylabel=quantity.replace("_", " "))
    for aspect in sorted(aspects)[:: max(1, len(aspects) // 4)]:
        frequency_m = found.where(aspect=aspect).arrays(0)["frequency_m"]
        share = (np.arange(len(frequency_m)) + 1.0) / len(frequency_m)
        axes[2].plot(share, frequency_m, ".", markersize=2.5, label=f"aspect {aspect:g}")
    axes[2].set(yscale="log", xlabel="mode, sorted, over their number", ylabel="frequency")
    axes[2].legend()
    figure.suptitle(f"{packings} packings each of N = {particles}, d = {dimension}, pressure {pressure:g}")
    figure.savefig(out / f"{name}.png", dpi=150)


if __name__ == "__main__":
    run(main)
