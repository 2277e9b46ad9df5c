r"""How jamming onsets of discs and ellipses are spread, and how the widths fall with the number of particles.

The ensembles are made by these commands, which go on where they were when given again:

    keep="--measures jamming_packing_fraction packing_fraction contacts rattlers isostatic_contacts --no-packings"
    packmech ensemble recordings/ensembles/discs.toml --seeds 0:400 --folder FOLDER/discs $keep \
        --grid packing.particles=32,64,128,256,512,1024
    packmech ensemble recordings/ensembles/ellipses.toml --seeds 0:100 --folder FOLDER/ellipses $keep \
        --grid packing.particles=32,64,128,256,512,1024
    python recordings/ensembles/onsets.py FOLDER
"""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent
KINDS = {"discs": "discs", "ellipses": "ellipses of aspect 1.6"}
# members of a size from which a width is drawn
LEAST = 10


def main(folder: Path) -> None:
    """Draw distributions of packing fraction and contacts at jamming, and their widths over the number of particles."""
    figure, axes = plt.subplots(2, 3, figsize=(12.0, 7.0), layout="constrained")
    for row, (kind, title) in zip(axes, KINDS.items(), strict=True):
        found = pm.read_ensemble(folder / kind)
        # tracebacks name the folders of the machine that ran
        columns = {name: column for name, column in found.columns.items() if name != "traceback"}
        pm.write_table(replace(found, columns=columns), HERE / f"{kind}.csv")
        size, phi = found["packing.particles"], found["jamming_packing_fraction"]
        z = 2.0 * found["contacts"] / (size - found["rattlers"])
        widths = []
        for particles in sorted(set(size.tolist())):
            part = (size == particles) & (found["state"] == "done")
            if part.sum() < LEAST:
                continue
            for ax, value in ((row[0], phi[part]), (row[1], z[part])):
                shown = pm.histogram(value)
                label = f"N = {particles}, {part.sum()} packings"
                ax.stairs(shown.density_b, shown.edge_b, label=label)
            mean, width = pm.bootstrap(phi[part]), pm.bootstrap(phi[part], statistic="width")
            widths.append((particles, *width))
            contacts = pm.bootstrap(z[part])
            print(f"{kind:9} N = {particles:5} {part.sum():4} packings: phi_J {mean[0]:.5f} +- {mean[1]:.5f}, "
                  f"width {width[0]:.6f} +- {width[1]:.6f}, z {contacts[0]:.4f} +- {contacts[1]:.4f}")  # fmt: skip
        n, value, error = np.array(widths).T
        row[2].errorbar(n, value, error, marker="o", markersize=4.0, linestyle="none", capsize=2.0)
        if len(n) >= 3:
            law = pm.fit_power_law(n, value, error)
            label = f"{law.prefactor:.3f} $N^{{{law.exponent:.3f} \\pm {law.exponent_error:.3f}}}$"
            row[2].plot(n, law.prefactor * n**law.exponent, color="#404040", linestyle="--", label=label)
            words = f"{law.exponent:.4f} +- {law.exponent_error:.4f}, chi^2 {law.chi_square:.2f} per degree of freedom"
            print(f"{kind}: width ~ N^({words})")
        row[2].plot(
            n, value[0] * (n / n[0]) ** -0.5, color="#b0b0b0", linestyle=":", label="slope -1/2 (source, discs)"
        )
        row[2].set(xscale="log", yscale="log", xlabel="N", ylabel="width of $\\phi_J$")
        row[0].set(xlabel="$\\phi_J$", ylabel="probability density", title=title)
        row[1].set(xlabel="contacts per particle, $z$", ylabel="probability density")
        row[0].legend(fontsize=7.0)
        row[2].legend(fontsize=7.0)
    figure.savefig(HERE / "onsets.png", dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    run(main)
