"""Vibrational states of discs, and of ellipses, 1e-4 above jamming: density, rotational part, participation ratio.

    python recordings/spectra/states.py --packings 100

All particles have mass 1.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

EDGES = np.logspace(-4.0, 0.8, 41)


def vibrate(particles: int, aspect: float, distance: float, seed: int) -> dict[str, Any]:
    """Return frequencies, rotational parts and participation ratios of a packing, and what it is."""
    shapes = None if aspect == 1.0 else pm.Ellipses(aspect)
    given = {"sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": 0.6, "seed": seed}
    scene = pm.Scene(pm.random_packing(particles, dimension=2, shapes=shapes, **given), (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-6, strain="isotropic").packing)
    (found,) = pm.compress(scene, [distance])
    modes = pm.normal_modes(scene.replace(packing=found.packing.replace(mass_n=np.ones(particles))))
    counts = {name: found.report[name] for name in ("contacts", "isostatic_contacts", "pressure")}
    kept = {name: getattr(modes, name) for name in ("frequency_m", "rotation_m", "participation_m")}
    return counts | kept | {"modes": len(modes), "unstable_modes": modes.negative, "residual": found.residual}


def main(
    *,
    particles: int = 120,
    packings: int = 10,
    aspects: tuple[float, ...] = (1.0, 1.1, 1.5),
    distance: float = 1e-4,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Find the modes, write the table of packings and draw the figure."""
    grid = {"particles": particles, "aspect": aspects, "distance": distance, "seed": range(packings)}
    found = pm.run_ensemble(vibrate, grid, out / "members" / "states-2d", workers=workers).of(grid)
    pm.write_table(found, out / "states-2d.csv")
    center, names = np.sqrt(EDGES[1:] * EDGES[:-1]), ("frequency_m", "rotation_m", "participation_m")
    figure, axes = plt.subplots(1, 3, figsize=(13.2, 4.2), layout="constrained")
    for aspect in aspects:
        part = found.where(aspect=aspect)
        kept = [part.arrays(k) for k in range(len(part))]
        frequency, *others = (np.concatenate([one[name] for one in kept]) for name in names)
        count = np.histogram(frequency, EDGES)[0]
        some = count > 0
        label = f"aspect {aspect:g}, {len(part)} packings"
        axes[0].loglog(center[some], (count / (np.diff(EDGES) * len(frequency)))[some], "o-", label=label)
        for ax, value in zip(axes[1:], others, strict=True):
            ax.semilogx(center[some], np.histogram(frequency, EDGES, weights=value)[0][some] / count[some], "o-")
    for ax, name in zip(axes, ("density of states", "rotational part of modes", "participation ratio"), strict=True):
        ax.set(xlabel="frequency", ylabel=name)
    axes[0].legend()
    figure.suptitle(f"N = {particles}, {distance:g} above jamming, masses alike")
    figure.savefig(out / "states-2d.png", dpi=150)


if __name__ == "__main__":
    run(main)
