r"""Draw what ensembles found: how jamming onsets are spread, and moduli over the amplitude with errors.

The ensembles are made by these commands, which go on where they were when given again::

    keep="--measures jamming_packing_fraction packing_fraction contacts rattlers isostatic_contacts --no-packings"
    packmech ensemble recordings/ensembles/discs.toml --seeds 0:400 --folder FOLDER/discs $keep \
        --grid packing.particles=32,64,128,256,512,1024
    packmech ensemble recordings/ensembles/ellipses.toml --seeds 0:100 --folder FOLDER/ellipses $keep \
        --grid packing.particles=32,64,128,256,512,1024
    for kind in microgel uncrosslinked bulk frictionless; do
        packmech ensemble $kind --seeds 0:10 --same-starts --grid drive.amplitude=0.005:0.5:8:log \
            --measures storage_modulus loss_modulus packing_fraction --no-packings --folder FOLDER/sweep-$kind
    done
    python recordings/ensembles.py FOLDER

The last one writes tables and figures to recordings/ensembles.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np

import packmech as pm

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402 - after the choice of what draws

OUT = Path(__file__).parent / "ensembles"
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
KINDS = {"discs": "discs", "ellipses": "ellipses of aspect 1.6"}
SWEEPS = {"microgel": "linked", "uncrosslinked": "unlinked", "bulk": "bulk", "frictionless": "no friction"}
# members of a size from which a width is drawn
LEAST = 10


def onsets(folder: Path) -> None:
    """Draw distributions of packing fraction and contacts at jamming, and their widths over the number of particles."""
    figure, axes = plt.subplots(2, 3, figsize=(12.0, 7.0), layout="constrained")
    for row, (kind, title) in zip(axes, KINDS.items(), strict=True):
        found = pm.read_ensemble(folder / kind)
        # tracebacks name the folders of the machine that ran
        columns = {name: column for name, column in found.columns.items() if name != "traceback"}
        pm.write_table(replace(found, columns=columns), OUT / f"{kind}.csv")
        size, phi = found["packing.particles"], found["jamming_packing_fraction"]
        z = 2.0 * found["contacts"] / (size - found["rattlers"])
        widths = []
        for number, particles in enumerate(sorted(set(size.tolist()))):
            part = (size == particles) & (found["state"] == "done")
            if part.sum() < LEAST:
                continue
            for ax, value in ((row[0], phi[part]), (row[1], z[part])):
                shown = pm.histogram(value)
                label = f"N = {particles}, {part.sum()} packings"
                ax.stairs(shown.density_b, shown.edge_b, color=COLORS[number % len(COLORS)], label=label)
            mean, width = pm.bootstrap(phi[part]), pm.bootstrap(phi[part], statistic="width")
            widths.append((particles, *width))
            contacts = pm.bootstrap(z[part])
            print(f"{kind:9} N = {particles:5} {part.sum():4} packings: phi_J {mean[0]:.5f} +- {mean[1]:.5f}, "
                  f"width {width[0]:.6f} +- {width[1]:.6f}, z {contacts[0]:.4f} +- {contacts[1]:.4f}")  # fmt: skip
        n, value, error = np.array(widths).T
        row[2].errorbar(n, value, error, color=COLORS[0], marker="o", markersize=4.0, linestyle="none", capsize=2.0)
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
    figure.savefig(OUT / "onsets.png", dpi=130, metadata={"Software": None})


def sweeps(folder: Path) -> None:
    """Draw storage and loss modulus over the amplitude, with bootstrap errors over repeats."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    for number, (kind, title) in enumerate(SWEEPS.items()):
        if not (folder / f"sweep-{kind}" / "ensemble.json").exists():
            continue
        found = pm.read_ensemble(folder / f"sweep-{kind}")
        if not found.counts()["done"]:
            continue
        pm.write_table(found, OUT / f"sweep-{kind}.csv")
        for ax, name in zip(axes, ("storage_modulus", "loss_modulus"), strict=True):
            mean = pm.group_statistics(found, name, ["drive.amplitude"])
            ax.errorbar(mean.by["drive.amplitude"], mean.value_g, mean.error_g, color=COLORS[number],
                        marker="osD^"[number], markersize=4.0, linewidth=1.0, capsize=2.0,
                        label=f"{title}, {mean.count_g.min()} repeats")  # fmt: skip
            print(kind, name, " ".join(f"{v:.4g}+-{e:.1g}" for v, e in zip(mean.value_g, mean.error_g, strict=True)))
    for ax, name in zip(axes, ("G' (Pa)", "G'' (Pa)"), strict=True):
        ax.set(xscale="log", yscale="log", xlabel="amplitude of the strain", ylabel=name)
        ax.legend(fontsize=7.0)
    figure.savefig(OUT / "amplitudes.png", dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    onsets(Path(sys.argv[1]))
    sweeps(Path(sys.argv[1]))
