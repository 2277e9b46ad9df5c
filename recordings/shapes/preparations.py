"""Ellipses 1:1.4 of aspect 1.5: quenched, then sheared to and fro or tapped, beside annealed ones, over the cycles.

    python recordings/shapes/preparations.py --packings 3

N = 64, measured at pressure 1e-6, sheared at 1e-3. Amplitudes are shear strains, kicks in diameters, steps of aspect.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from packings import MEASURED, PANELS, measured

import packmech as pm

AMPLITUDES = {"quenched": (0.0,), "sheared": (0.05, 0.1), "tapped": (0.1, 0.2), "annealed": (0.05,)}
NAMES = ("cycle", *MEASURED, "states_of_self_stress", "displacement")
ASPECT, JAM = 1.5, {"pressure": 1e-6, "strain": "isotropic"}


def prepare(preparation: str, particles: int, amplitude: float, cycles: list[int], seed: int) -> dict[str, np.ndarray]:
    """Return the numbers of a packing after each number of cycles or taps."""
    given = {"dimension": 2, "sizes": pm.Bidisperse(ratio=1.4), "seed": seed}
    if preparation == "annealed":
        discs = pm.Scene(pm.random_packing(particles, packing_fraction=0.8, **given), (pm.Repulsion(),))
        discs = discs.replace(packing=pm.jam(discs, **JAM).packing)
        way = np.linspace(1.0, ASPECT, round((ASPECT - 1.0) / amplitude) + 1)[1:].tolist()
        found = pm.anneal_shape(discs, way, seed=seed, pressure=JAM["pressure"])[-1]
        return dict(zip(NAMES, np.array([(one, *measured(found), np.nan) for one in cycles]).T, strict=True))
    start = pm.random_packing(particles, packing_fraction=0.6, shapes=pm.Ellipses(ASPECT), **given)
    found = pm.jam(pm.Scene(start, (pm.Repulsion(),)), **JAM)
    scene, rng = pm.Scene(found.packing, (pm.Repulsion(),)), np.random.default_rng(seed)
    done, rows, displacement = 0, [], np.nan
    if preparation == "sheared":
        scene = scene.replace(packing=pm.jam(scene, pressure=1e-3, strain="isotropic").packing)
    for count in cycles:
        if preparation == "tapped":
            found = pm.tap(scene, amplitude, count - done, rng=rng, pressure=JAM["pressure"])[-1]
            scene = scene.replace(packing=found.packing)
        elif preparation == "sheared":
            last = pm.cyclic_shear(scene, amplitude, count - done, step=amplitude / 2.0, pressure=1e-3)[-1]
            scene, displacement = scene.replace(packing=last.packing), last.report.get("displacement", np.nan)
            found = pm.jam(scene, **JAM)
        rows.append((count, *measured(found), displacement))
        done = count
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def main(
    *,
    particles: int = 64,
    packings: int = 3,
    cycles: tuple[int, ...] = (1, 2, 5, 10, 20),
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Prepare the packings, write the table and draw the figure."""
    common = {"particles": particles, "cycles": [cycles], "seed": range(packings)}
    grid = [common | {"preparation": name, "amplitude": values} for name, values in AMPLITUDES.items()]
    found = pm.run_ensemble(prepare, grid, out / "members" / "preparations", workers=workers).of(grid)
    pm.write_table(found.rows(), out / "preparations.csv")
    figure, axes = plt.subplots(2, 2, figsize=(10.0, 7.2), layout="constrained")
    for preparation, amplitudes in AMPLITUDES.items():
        for amplitude in amplitudes:
            table = found.where(preparation=preparation, amplitude=amplitude).rows()
            for ax, name in zip(axes.flat, PANELS, strict=True):
                value_rc = table[name].reshape(-1, len(cycles))
                error_c = value_rc.std(axis=0) / np.sqrt(max(1, packings - 1))
                ax.errorbar(cycles, value_rc.mean(axis=0), error_c, fmt="o-", label=f"{preparation}, {amplitude:g}")
                ax.set(xscale="log", xlabel="cycles or taps", ylabel=name.replace("_", " "))
    axes[0, 0].legend()
    figure.savefig(out / "preparations.png", dpi=150)


if __name__ == "__main__":
    run(main)
