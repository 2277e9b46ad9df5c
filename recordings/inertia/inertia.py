"""Dense flow of discs with friction .4: stress over pressure and packing fraction over the inertial number.

    python recordings/inertia/inertia.py --packings 2

At constant pressure and, in the volume found, at constant volume; beside the lines of Phys. Rev. E 72, 021309 (2005).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

LITERATURE = {"stress_ratio": (0.25, 1.1), "packing_fraction": (0.81, -0.3)}
NUMBERS = (0.01, 0.02, 0.03, 0.05, 0.1)


def shear(particles: int, pressure: float, inertial_number: float, strain: float, seed: int) -> dict[str, float]:
    """Return means and errors of a flow at constant pressure and of one at constant volume."""
    effects = (pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(0.4, 0.5), pm.ContactDamping(1.0))
    sizes = pm.Bidisperse(ratio=1.3)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    # deep overlaps of a random start would blow the box up
    start = pm.quench(pm.Scene(start, effects[:1]), force_tolerance=1e-3, check=False).packing
    rate = inertial_number * float(np.sqrt(pressure / start.mass_n.mean()))
    skip = max(2.0, rate / pressure)
    given = {"applied_strain": skip + strain, "skip_strain": skip, "check": False}
    flow = pm.shear_at_pressure(pm.Scene(start, effects), rate=rate, pressure=pressure, **given)
    fraction = flow.mean(flow.packing_fraction_t)
    same = pm.Scene(pm.at_packing_fraction(start, fraction[0]), effects)
    curve = pm.steady_shear(same, rates=[rate], samples=4000, **given)
    level = float(curve.pressure_r[0])
    values = {
        "stress_ratio": flow.stress_ratio,
        "packing_fraction": fraction,
        "mean_pressure": flow.mean(flow.pressure_t),
    }
    values["volume_stress_ratio"] = float(curve.stress_ratio_r[0]), float(curve.stress_error_r[0]) / level
    values["volume_pressure"] = level, float(curve.pressure_error_r[0])
    return {name + end: x for name, one in values.items() for end, x in zip(("", "_error"), one, strict=True)}


def main(
    *,
    particles: int = 400,
    packings: int = 1,
    pressure: float = 1e-3,
    strain: float = 8.0,
    inertial_numbers: tuple[float, ...] = NUMBERS,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
):
    """Shear the discs, write the table and draw the figure."""
    grid = {"particles": particles, "pressure": pressure, "inertial_number": inertial_numbers, "strain": strain}
    grid["seed"] = range(packings)
    found = pm.run_ensemble(shear, grid, out / "members" / "inertia", workers=workers).of(grid)
    pm.write_table(found, out / "inertia.csv")
    x, along = found["inertial_number"], np.linspace(0.0, 1.05 * max(inertial_numbers), 50)
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    axes[0].errorbar(x, found["volume_stress_ratio"], found["volume_stress_ratio_error"], fmt="s", label="same volume")
    for ax, (name, (rest, slope)) in zip(axes, LITERATURE.items(), strict=True):
        ax.errorbar(x, found[name], found[f"{name}_error"], fmt="o", label="constant pressure")
        b, a = np.polyfit(x, found[name], 1, w=1.0 / found[f"{name}_error"])
        ax.plot(along, a + b * along, label=f"{a:.3f} {b:+.2f} I")
        ax.plot(along, rest + slope * along, "--", color="#909090", label=f"{rest:g} {slope:+g} I (2005)")
        ax.set(xlabel="inertial number I", ylabel=name.replace("_", " "))
        ax.legend()
    figure.savefig(out / "inertia.png", dpi=150)


if __name__ == "__main__":
    run(main)
