"""Packing fraction and coordination over friction: discs 1:1.4 or equal spheres, pressed from dilute starts.

    python recordings/friction/friction.py --packings 10 [--dimension 3 --particles 512]

Stiffness of contacts 1, pressure 1e-4, largest rate of strain 1e-4. What is finished is not run again.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

COEFFICIENTS = (0.0, 0.01, 0.1, 0.5, 1.0, 10.0)


def press(dimension: int, particles: int, coefficient: float, seed: int) -> pm.Run:
    """Return the run that presses a dilute start until it is in equilibrium."""
    sizes, fraction = (pm.Bidisperse(ratio=1.4), 0.7) if dimension == 2 else (pm.Monodisperse(), 0.5)
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    effects = (pm.Repulsion(pm.LinearSpring(1.0)), pm.ContactDamping(0.3), pm.Friction(coefficient, 1.0, 0.1))
    return pm.jam(pm.Scene(start, effects), pressure=1e-4, strain="isotropic", method=pm.Press(rate=1e-4))


def main(
    dimension: int = 2,
    particles: int = 256,
    packings: int = 3,
    coefficients: tuple[float, ...] = COEFFICIENTS,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Press the packings, write the table and draw the figure."""
    name = f"friction-{dimension}d"
    grid = {"dimension": dimension, "particles": particles, "coefficient": coefficients, "seed": range(packings)}
    found = pm.run_ensemble(press, grid, out / "members" / name, workers=workers).of(grid)
    pm.write_table(found, out / f"{name}.csv")
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for ax, quantity in zip(axes, ("packing_fraction", "coordination_number"), strict=True):
        mean = pm.group_statistics(found, quantity, ["coefficient"])
        # none stands at 1e-3 on the axis of logarithms
        x = np.maximum(mean.by["coefficient"], 1e-3)
        ax.errorbar(x, mean.value_g, mean.error_g, marker="o", capsize=2.0)
        ax.set(xscale="log", xlabel="friction coefficient (0.001: none)", ylabel=quantity.replace("_", " "))
    isostatic = pm.group_statistics(found, "isostatic_coordination", ["coefficient"])
    axes[1].plot(x, isostatic.value_g, ":", label="generalized isostaticity, (d + 1) + 2 n_m / d")
    for level in (dimension + 1, 2 * dimension):
        axes[1].axhline(level, color="#b0b0b0", linewidth=0.8)
    axes[1].legend()
    figure.suptitle(f"{packings} packings each of N = {particles}, d = {dimension}; gray: d + 1 and 2 d")
    figure.savefig(out / f"{name}.png", dpi=150)


if __name__ == "__main__":
    run(main)
