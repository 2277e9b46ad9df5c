"""Spectral density of what 16384 discs 1:1.4 fill at a pressure of 1e-3, its power law, and S(k) of the centers.

    python recordings/structure/spectrum.py

Rattlers are included. The exact hard packing of so many is out of reach: packings are quenched at packing fractions .9
and .88, and from there on where a line through the last two pressures leads, until the pressure is within a tenth.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm


def quench(particles: int, pressure: float, seed: int) -> pm.Packing:
    """Return a packing near the pressure in a square box."""
    sizes, fraction, before = pm.Bidisperse(ratio=1.4), 0.9, None
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=fraction, seed=seed)
    for _ in range(12):
        scene = pm.Scene(pm.at_packing_fraction(packing, fraction), (pm.Repulsion(),))
        packing = pm.quench(scene, force_tolerance=1e-4).packing
        reached = pm.pressure(scene.replace(packing=packing))
        if abs(reached - pressure) < 0.1 * pressure:
            return packing
        further = fraction - 0.02
        if before is not None and before[1] != reached:
            further = fraction - (reached - pressure) * (before[0] - fraction) / (before[1] - reached)
        before, fraction = (fraction, reached), further
    raise RuntimeError(f"seed {seed} does not come to the pressure {pressure:g}, got {reached:g}")


def main(
    *,
    particles: int = 16384,
    pressure: float = 1e-3,
    seed: int = 0,
    window: tuple[float, float] = (0.2, 2.0),
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Make the packing, write the spectrum and draw the figure; lengths are mean diameters."""
    grid = {"particles": particles, "pressure": pressure, "seed": seed}
    packing = pm.run_ensemble(quench, grid, out / "members" / "spectrum", workers=workers).of(grid).packing(0)
    scale = 1.0 / float(packing.diameter_n.mean())
    packing = pm.Packing(packing.position_nd * scale, packing.radius_n * scale, packing.box.scaled(scale))
    index = pm.wave_indices(packing.box, 12.0, half=True)
    filled = pm.shell_average(packing.box, index, pm.spectral_density(packing, index), width=0.04)
    centers = pm.shell_average(packing.box, index, pm.structure_factor(packing, index), width=0.04)
    fit = filled.power_law(*window)
    head = "k_diameter,wave_vectors,spectral_density,error,structure_factor,structure_factor_error"
    columns = filled.k_b, filled.count_b, filled.value_b, filled.error_b, centers.value_b, centers.error_b
    np.savetxt(out / "spectrum.csv", np.column_stack(columns), "%.6g", delimiter=",", header=head, comments="")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    left.errorbar(filled.k_b, filled.value_b, filled.error_b, linewidth=0.8, label="measured")
    k, label = np.array(window), f"exponent {fit.exponent:.3f} +- {fit.exponent_error:.3f}"
    left.plot(k, fit.amplitude * k**fit.exponent, label=label)
    left.axvspan(filled.k_b[0], window[0], color="#f0f0f0", label="no claim")
    left.set(xscale="log", yscale="log", xlabel="k d", ylabel="spectral density of the discs / d^2")
    left.legend()
    right.plot(filled.k_b, centers.value_b, linewidth=0.8)
    right.set(xlabel="k d", ylabel="S(k) of the centers")
    figure.savefig(out / "spectrum.png", dpi=150)


if __name__ == "__main__":
    run(main)
