"""Seven discs mechanically stable beside seven only locally stable, moved along their lowest mode, and what that costs.

    python recordings/shapes/stability.py

Figure 2.15 of Schreck and O'Hern. With seven discs and eleven contacts one collective motion changes no contact to
first order. Straight along it distances only grow, so that it costs no energy until discs meet that did not touch.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from seven_discs import CELLS, energy_change, locally_stable, lowest_mode, mechanically_stable

import packmech as pm

AMPLITUDES = np.logspace(-5.0, -0.5, 46)


def search(kind: str, seed: int) -> dict[str, pm.Packing | str | float]:
    """Return what a search ended in and what the verdict says of it; nothing where it did not end."""
    packing = mechanically_stable(seed) if kind == "mechanically stable" else locally_stable(seed)
    if packing is None:
        return {"fits": 0}
    verdict = pm.classify_jamming(pm.Scene(packing, (pm.Repulsion(),)))
    floppy, rattlers = verdict.collectively.floppy_modes, int(verdict.rattlers.sum())
    wanted = ("jammed", "jammed") if kind == "mechanically stable" else ("jammed", "not jammed")
    fits = (verdict.local, verdict.collective) == wanted and not rattlers and (floppy > 0) == (wanted[1] != "jammed")
    said = {"local": verdict.local, "collective": verdict.collective, "floppy_modes": floppy, "rattlers": rattlers}
    numbers = {"contacts": verdict.contacts, "packing_fraction": pm.packing_fraction(packing), "fits": int(fits)}
    return said | numbers | {"states_of_self_stress": verdict.collectively.states_of_self_stress, "packing": packing}


def main(*, starts: int = 100, out: Path = Path(__file__).parent, workers: int | None = None) -> None:
    """Search, choose two packings of nearly the same packing fraction, write tables, draw the figure."""
    grid = {"kind": ["mechanically stable", "locally stable"], "seed": range(starts)}
    found = pm.run_ensemble(search, grid, out / "members" / "stability", workers=workers).of(grid)
    pm.write_table(found, out / "stability-found.csv")
    good = found.take(np.flatnonzero(found["fits"] == 1))
    parts = [good.where(kind=kind) for kind in grid["kind"]]
    scenes = [[pm.Scene(one.packing(k), (pm.Repulsion(),)) for k in range(len(one))] for one in parts]
    apart = np.abs(parts[0]["packing_fraction"][:, None] - parts[1]["packing_fraction"])
    # of the locally stable ones near a mechanically stable one, that which moves farthest without a cost
    free = [np.count_nonzero(energy_change(one, lowest_mode(one), AMPLITUDES) == 0.0) for one in scenes[1]]
    other = int(np.argmax(np.where(apart.min(axis=0) < 0.01, free, -1)))
    scenes = [scenes[0][int(apart[:, other].argmin())], scenes[1][other]]
    figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.4), layout="constrained")
    columns, angle = [AMPLITUDES], np.linspace(0.0, 2.0 * np.pi, 61)
    for number, (ax, scene) in enumerate(zip(axes, scenes, strict=False)):
        packing, mode_nd = scene.packing, lowest_mode(scene)
        for sign, style in ((1.0, "-"), (-1.0, "--")):
            columns.append(energy_change(scene, sign * mode_nd, AMPLITUDES))
            axes[2].plot(AMPLITUDES, columns[-1], f"C{number}{style}")
        rim = packing.radius_n[0] * np.column_stack([np.cos(angle), np.sin(angle)])
        side, start = float(packing.box.lattice_dd[0, 0]), packing.wrapped().position_nd
        for before in (start[:, None] + side * CELLS).reshape(-1, 2):
            ax.plot(*(before + rim).T, f"C{number}", linewidth=1.0)
        for before, way in zip(start, 0.2 * packing.reference_diameter * mode_nd, strict=True):
            ax.plot(*(before + way + rim).T, "--", color="#404040", linewidth=0.8)
        ax.set(xlim=(-0.25 * side, 1.25 * side), ylim=(-0.25 * side, 1.25 * side), aspect="equal")
        ax.set_title(f"{grid['kind'][number]}, packing fraction {pm.packing_fraction(packing):.4f}", fontsize=9)
    axes[2].set(xscale="log", xlabel="amplitude along the lowest mode [diameter]", ylabel="energy a particle")
    axes[2].set_yscale("symlog", linthresh=1e-13, linscale=0.5)
    axes[2].set_ylim(-1e-14, 1e-1)
    figure.savefig(out / "stability.png", dpi=150)
    head = "amplitude,mechanical forward,mechanical backward,local forward,local backward"
    np.savetxt(out / "stability.csv", np.column_stack(columns), "%.17g", delimiter=",", header=head, comments="")


if __name__ == "__main__":
    run(main)
