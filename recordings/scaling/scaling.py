"""How packings soften towards jamming: energy, contacts, moduli and omega* over pressure or the distance to jamming.

    python recordings/scaling/scaling.py springs --particles 64 --particles 256 --particles 1024 --states

Scenes are `springs.toml` and `hertz.toml` beside this file; `--over distance --strain isotropic` compresses packings
from their own jamming points. Several N are fitted together, which tells what N sets from the correction to scaling.
"""

from pathlib import Path
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent
LEVELS = {"pressure": np.logspace(-2.0, -6.0, 9), "distance": np.logspace(-5.0, -1.0, 9)}


def main(
    scene: str = "springs",
    *,
    particles: tuple[int, ...] = (256,),
    packings: int = 20,
    over: Literal["pressure", "distance"] = "pressure",
    levels: tuple[float, ...] = (),
    strain: str = "free",
    states: bool = False,
    largest: float | None = None,
    out: Path = HERE,
    workers: int | None = None,
) -> None:
    """Follow the packings of each N, write tables, draw the figure and print the power laws."""
    method = pm.HardVertex(start_packing_fraction=0.9, stop_pressure=1e-4)
    given = {"method": method, "states": states, "folder": out / "members", "workers": workers, "check": False}
    given["pressures" if over == "pressure" else "distances"] = np.array(levels) if levels else LEVELS[over]
    scalings = []
    for count in particles:
        changes = {"packing.particles": count}
        starts = [pm.read_scene(HERE / f"{scene}.toml", seed=k, changes=changes) for k in range(packings)]
        scalings.append(pm.jamming_scaling(starts, strain=strain, **given))
        (out / f"{scene}-{count}.csv").write_text(scalings[-1].to_csv())
    names = [name for name in scalings[0].names if np.isfinite(scalings[0].theory(name)) and name != over]
    figure, axes = plt.subplots(2, 4, figsize=(14.0, 7.2), layout="constrained")
    for ax, name in zip(axes.flat, names, strict=False):
        for one in scalings:
            mean, error, label = one.mean_p(name), one.error_p(name), f"N = {one.particles}, {one.packings} packings"
            ax.errorbar(one.level_p[mean > 0.0], mean[mean > 0.0], error[mean > 0.0], fmt="o", capsize=2.0, label=label)
        ax.set(xscale="log", yscale="log", xlabel=over, ylabel=name.replace("_", " "))
        try:
            fit = scalings[0].fit(name, corrected=True)
            together = f"\n{pm.fit_sizes(scalings, name, largest=largest)}" if len(scalings) > 1 else ""
            ax.set_title(f"{fit.exponent:.3f} +- {fit.error:.2g}, expected {scalings[0].theory(name, over=over):.4g}")
            print(name, f"{fit}{together}", sep="\n")
        except ValueError as reason:
            # too few levels, or a mean that is not positive
            print(f"{name}: {reason}")
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    axes[0, 0].legend()
    figure.savefig(out / f"{scene}{'-sizes' if len(scalings) > 1 else f'-{particles[0]}'}.png", dpi=150)


if __name__ == "__main__":
    run(main)
