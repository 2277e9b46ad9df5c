"""Strain of the first change of contacts at constant volume of shear-stabilized packings, over pressure and N.

python recordings/families/first_change.py --particles 32 --particles 64 --particles 128 --particles 256 --packings 100
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

PRESSURES = tuple(float(x) for x in 10.0 ** np.arange(-2.0, -8.25, -0.5))
NAMES = ("pressure", "strain", "strain_from_above", "one_shot", "opened", "falls", "shear_modulus", "work_error")


def first_change(scene: pm.Scene, pressure: float) -> tuple[float, ...]:
    """Return the row of the first change, nan where none is located; `one_shot` is what linear response predicts."""
    guess = float(pm.quasistatic_shear(scene, 1e-3 * pressure, step=1e-3 * pressure, check=False).predicted_change_t[0])
    for factor in (1.1, 1.6, 3.0, 8.0):
        found = pm.quasistatic_shear(scene, factor * guess, step=guess / 12.0, check=False)
        one = found.first_change
        if one is not None:
            error = abs(one.work / one.energy_change - 1.0)
            said = one.strain, one.strain_from_above, guess, float(one.opened), float(one.falls)
            return pressure, *said, float(found.modulus_t[0]), error
    return pressure, *[np.nan] * 7


def follow(particles: int, pressures: list[float], seed: int) -> dict[str, np.ndarray]:
    """Return the rows of a packing that is followed through falling pressures."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=pressures[0], strain="free").packing)
    runs = pm.sweep_pressure(scene, pressures, strain="free", check=False)
    pairs = zip(pressures, runs, strict=False)
    rows = [first_change(scene.replace(packing=one.packing), pressure) for pressure, one in pairs if one.ok]
    return dict(zip(NAMES, np.array(rows).T, strict=True))


def main(
    *,
    particles: tuple[int, ...] = (32, 128),
    packings: int = 10,
    pressures: tuple[float, ...] = PRESSURES,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Follow the packings, write the table, draw the figure and print the power laws."""
    grid = {"particles": particles, "pressures": [sorted(pressures, reverse=True)], "seed": range(packings)}
    found = pm.run_ensemble(follow, grid, out / "members" / "first-change", workers=workers).of(grid)
    rows = found.rows()
    pm.write_table(rows, out / "first-change.csv")
    there = np.isfinite(rows["strain"])
    count, pressure, strain = (rows[name][there] for name in ("particles", "pressure", "strain"))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    for number in particles:
        levels = np.unique(pressure[count == number])
        median = np.array([np.median(strain[(count == number) & (pressure == one)]) for one in levels])
        left.loglog(levels, median, "o-", label=f"N = {number}")
        right.loglog(number**2 * levels, median / levels, "o-")
    left.set(xlabel="pressure", ylabel="strain of the first change of contacts, median")
    left.legend()
    right.set(xlabel="$N^2 P$", ylabel="strain / pressure")
    figure.savefig(out / "first-change.png", dpi=150)
    for words, there in (("small", count**2 * pressure <= 0.1), ("large", count**2 * pressure >= 10.0)):
        if len(set(count[there])) > 1 and len(set(pressure[there])) > 1:
            x = np.column_stack([np.ones(there.sum()), np.log(pressure[there]), np.log(count[there])])
            a, b, c = np.linalg.lstsq(x, np.log(strain[there]))[0]
            print(f"N^2 P {words}: strain = {np.exp(a):.3g} P^{b:.3f} N^{c:.3f}")


if __name__ == "__main__":
    run(main)
