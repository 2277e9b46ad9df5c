"""Stress over depth in the silos of `silo.py`, and Janssen's law: vertical stress, and that on the walls.

    python recordings/silo/janssen.py

H. A. Janssen, Z. Ver. Dtsch. Ing. 39, 1045 (1895), in a plane: walls a width W apart bear mu_w K of the vertical
stress, which comes to rest at rho g lambda with lambda = W / (2 mu_w K). Run `silo.py` first.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from scipy.optimize import curve_fit


def janssen(depth: np.ndarray, length: float, surface: float, weight: float) -> np.ndarray:
    """Return the vertical stress of Janssen's law below a surface, for a weight over width and height."""
    return weight * length * (1.0 - np.exp((surface - depth) / length))


def fit(columns: np.ndarray, width: float) -> tuple[float, float, float, float]:
    """Return length and surface of the law fitted to vertical stresses, and wall friction and K from the walls."""
    depth, vertical, normal, shear, weight, _ = columns
    # neither the top of the heap nor next to the floor
    used = (depth > 0.05 * depth[-1]) & (depth < 0.9 * depth[-1])

    def law(z: np.ndarray, length: float, surface: float) -> np.ndarray:
        return janssen(z, length, surface, weight[0])

    (length, surface), _ = curve_fit(law, depth[used], vertical[used], p0=(width, 0.0))
    wall = normal[used].sum()
    return float(length), float(surface), float(shear[used].sum() / wall), float(wall / vertical[used].sum())


def main(*, width: float = 20.0, out: Path = Path(__file__).parent) -> None:
    """Draw the figure of all silos of this width."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for path in sorted(out.glob(f"silo-w{width:g}-*.csv")):
        columns = np.loadtxt(path, delimiter=",", skiprows=1).T
        depth, vertical, normal, shear, weight, _ = columns
        length, surface, friction, ratio = fit(columns, width)
        unit = weight[0] * width
        label = f"K = {width / (2.0 * friction * length):.2f} fitted, {ratio:.2f} measured"
        left.plot(depth, vertical / unit, "C0.")
        left.plot(depth, janssen(depth, length, surface, weight[0]) / unit, "C1", label=label)
        right.plot(depth, normal / vertical, "C0.", depth, shear / normal, "C2.")
    left.plot([0.0, 2.5 * width], [0.0, 2.5], "--", color="#909090", label="weight above")
    left.set(xlabel="depth [d]", ylabel="vertical stress / (density g W)")
    left.legend()
    right.set(xlabel="depth [d]", ylabel="on the wall / vertical (blue), along / on the wall (green)", ylim=(0.0, 2.0))
    figure.savefig(out / "silo.png", dpi=150)


if __name__ == "__main__":
    run(main)
