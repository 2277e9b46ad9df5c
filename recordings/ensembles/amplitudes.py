r"""Storage and loss modulus of gels over the amplitude of the strain, with errors over repeats.

The ensembles are made by these commands, which go on where they were when given again:

    for kind in microgel uncrosslinked bulk frictionless; do
        packmech ensemble $kind --seeds 0:10 --same-starts --grid drive.amplitude=0.005:0.5:8:log \
            --measures storage_modulus loss_modulus packing_fraction --no-packings --folder FOLDER/sweep-$kind
    done
    python recordings/ensembles/amplitudes.py FOLDER
"""

from pathlib import Path

import matplotlib.pyplot as plt
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent
SWEEPS = {"microgel": "linked", "uncrosslinked": "unlinked", "bulk": "bulk", "frictionless": "no friction"}


def main(folder: Path) -> None:
    """Draw storage and loss modulus over the amplitude, with bootstrap errors over repeats."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    for number, (kind, title) in enumerate(SWEEPS.items()):
        if not (folder / f"sweep-{kind}" / "ensemble.json").exists():
            continue
        found = pm.read_ensemble(folder / f"sweep-{kind}")
        if not found.counts()["done"]:
            continue
        pm.write_table(found, HERE / f"sweep-{kind}.csv")
        for ax, name in zip(axes, ("storage_modulus", "loss_modulus"), strict=True):
            mean = pm.group_statistics(found, name, ["drive.amplitude"])
            ax.errorbar(mean.by["drive.amplitude"], mean.value_g, mean.error_g,
                        marker="osD^"[number], markersize=4.0, linewidth=1.0, capsize=2.0,
                        label=f"{title}, {mean.count_g.min()} repeats")  # fmt: skip
            print(kind, name, " ".join(f"{v:.4g}+-{e:.1g}" for v, e in zip(mean.value_g, mean.error_g, strict=True)))
    for ax, name in zip(axes, ("G' (Pa)", "G'' (Pa)"), strict=True):
        ax.set(xscale="log", yscale="log", xlabel="amplitude of the strain", ylabel=name)
        ax.legend(fontsize=7.0)
    figure.savefig(HERE / "amplitudes.png", dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    run(main)
