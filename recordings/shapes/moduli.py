"""Shear modulus of shear-stabilized ellipses over the distance above jamming, and where its exponent passes 3/4.

    python recordings/shapes/moduli.py --packings 10

The modulus is linear at first and bends toward a square root. Where does not grow with the aspect throughout: 6.0e-4,
5.9e-3, 1.2e-2 and 2.2e-2 at aspects 1.002, 1.01, 1.03 and 1.1, then 1.4e-2 and 5.9e-3 at 1.3 and 2.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from scipy.optimize import least_squares

import packmech as pm

DISTANCES = tuple(float(x) for x in np.logspace(-5.0, -1.0, 13))


def shear(particles: int, aspect: float, distances: list[float], seed: int) -> dict[str, np.ndarray]:
    """Return pressures and moduli of a packing that is followed from its jamming upward; nan where it ended."""
    given = {"sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": 0.6, "seed": seed}
    start = pm.random_packing(particles, dimension=2, shapes=pm.Ellipses(aspect), **given)
    scene = pm.Scene(start, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-6, strain="free").packing)
    rows = np.full((4, len(distances)), np.nan)
    rows[0] = distances
    for k, run_ in enumerate(pm.compress(scene, distances, strain="free", check=False)):
        moduli = pm.elastic_moduli(scene.replace(packing=run_.packing))
        rows[1:, k] = run_.report["pressure"], moduli.voigt.shear_modulus, moduli.bulk_modulus
    return dict(zip(("distance", "pressure", "shear_modulus", "bulk_modulus"), rows, strict=True))


def crossover(distance: np.ndarray, modulus_st: np.ndarray) -> float:
    """Return x* of the curve G = a x / sqrt(1 + x / x*) through mean moduli of packings, weighted by their errors."""
    mean = modulus_st.mean(axis=0)
    # no mean is known better than to two percent
    error = np.hypot(modulus_st.std(axis=0, ddof=1) / np.sqrt(len(modulus_st)) / mean, 0.02)
    x, y = np.log(distance), np.log(mean)

    def missed(p: np.ndarray) -> np.ndarray:
        return (p[0] + x - 0.5 * np.logaddexp(0.0, x - p[1]) - y) / error

    return float(np.exp(least_squares(missed, [y[0] - x[0], x.mean()]).x[1]))


def crossover_error(distance: np.ndarray, modulus_st: np.ndarray, draws: int = 100) -> float:
    """Return the spread of ln x* over packings drawn with repetition."""
    rng, count = np.random.default_rng(0), len(modulus_st)
    return float(np.std([np.log(crossover(distance, modulus_st[rng.integers(0, count, count)])) for _ in range(draws)]))


def main(
    *,
    particles: int = 256,
    packings: int = 3,
    aspects: tuple[float, ...] = (1.002, 1.01, 1.03, 1.1, 1.3, 2.0),
    distances: tuple[float, ...] = DISTANCES,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Follow the packings, write the table and draw the figure."""
    grid = {"particles": particles, "aspect": aspects, "distances": [distances], "seed": range(packings)}
    found = pm.run_ensemble(shear, grid, out / "members" / "moduli-2d", workers=workers).of(grid)
    pm.write_table(found.rows(), out / "moduli-2d.csv")
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.8, 4.4), width_ratios=(3, 2), layout="constrained")
    for number, aspect in enumerate(aspects):
        modulus_st = found.where(aspect=aspect).rows()["shear_modulus"].reshape(-1, len(distances))
        modulus_st = modulus_st[np.isfinite(modulus_st).all(axis=1)]
        left.plot(distances, modulus_st.mean(axis=0), ".-", color=f"C{number}", label=f"aspect {aspect:g}")
        if len(modulus_st) > 1:
            place = crossover(np.array(distances), modulus_st)
            error = place * crossover_error(np.array(distances), modulus_st)
            right.errorbar(aspect - 1.0, place, error, fmt="o", color=f"C{number}", capsize=2.0)
    left.set(xscale="log", yscale="log", xlabel="packing fraction above jamming", ylabel="shear modulus")
    left.legend()
    right.set(xscale="log", yscale="log", xlabel="aspect - 1", ylabel="where the exponent passes 3/4")
    figure.savefig(out / "moduli-2d.png", dpi=150)


if __name__ == "__main__":
    run(main)
