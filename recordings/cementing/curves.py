"""Bulk and shear modulus over cemented contacts per particle, of what `cementing.py` wrote.

    python recordings/cementing/curves.py recordings/cementing/angles

A trial's value is the mean of its Voigt and Reuss bounds, its weight 12/(Voigt - Reuss)^2, the inverse variance of a
value spread evenly between them; trials with an infinite bound carry none. Standard errors take packings as
independent, not the orders of one packing.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

HEAD = "N,nl/N,bulk,bulk error,shear,shear error,Poisson ratio,Poisson ratio error,anisotropy,anisotropy error"
HEAD += ",bulk Reuss,bulk Voigt,shear Reuss,shear Voigt,some stiff,all stiff"


def mean(value_pok: np.ndarray, weight_pok: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weighted means over packings and orders at each step, and standard errors over packings."""
    value = np.where(weight_pok > 0.0, value_pok, 0.0)
    total, count = weight_pok.sum(axis=(0, 1)), (weight_pok > 0.0).any(axis=1).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_k = (weight_pok * value).sum(axis=(0, 1)) / total
        off = (weight_pok * (value - np.nan_to_num(mean_k))).sum(axis=1)
        error = np.sqrt(count / (count - 1.0) * (off**2).sum(axis=0)) / total
    return mean_k, np.where(count > 1, error, np.nan)


def means(curve: dict[str, np.ndarray]) -> list[np.ndarray]:
    """Return bulk and shear modulus, Poisson ratio and anisotropy with errors, and the four bounds of the moduli."""
    some = np.isfinite(curve["bulk_voigt"]) & np.isfinite(curve["shear_voigt"])
    columns, bounds = [], []
    for name in ("bulk", "shear"):
        low, high = curve[f"{name}_reuss"], np.where(np.isfinite(curve[f"{name}_voigt"]), curve[f"{name}_voigt"], 0.0)
        middle = np.where(high > 0.0, (low + high) / 2.0, 1.0)
        # bounds nearer than 1e-6 of their mean weigh as if they were this far apart
        columns += mean(middle, np.where(high > 0.0, 12.0 / np.maximum(high - low, 1e-6 * middle) ** 2, 0.0))
        bounds += [mean(one, (high > 0.0).astype(float))[0] for one in (low, high)]
    rest = [column for name in ("poisson", "anisotropy") for column in mean(curve[name], some.astype(float))]
    return [*columns, *rest, *bounds]


def main(out: Path) -> None:
    """Read the table, write that of the means and draw the figure."""
    table, tables = pm.read_table(out / "orders.csv"), []
    figure, axes = plt.subplots(2, 2, figsize=(9.6, 7.2), layout="constrained")
    for count in np.unique(table["particles"]):
        mine = table["particles"] == count
        place = tuple(table[name][mine].astype(int) for name in ("seed", "order", "number"))
        # after complete rigidity there is nothing that gives
        names = [name for name in table.columns if table[name].dtype.kind in "if"]
        curve = {name: np.full([one.max() + 1 for one in place], np.inf) for name in names}
        for name, values in curve.items():
            values[place] = table[name][mine]
        share = [(curve["stiff"] > directions).mean(axis=(0, 1)) for directions in (0, 5)]
        x = np.floor(np.arange(len(share[0])) * curve["step"][0, 0, 0] * count + 1e-9) / count
        tables.append(np.column_stack([np.full(len(x), count), x, *means(curve), *share]))
        # from here on means over the others are no longer those of the ensemble
        shown = tables[-1][share[0] < 0.5].T
        for k, (ax, name) in enumerate(
            zip(axes.flat, ("bulk modulus", "shear modulus", "Poisson ratio"), strict=False)
        ):
            ax.errorbar(shown[1], shown[2 + 2 * k], shown[3 + 2 * k], fmt="o-", capsize=2.0, label=f"N = {count:g}")
            ax.set(ylabel=name, yscale="linear" if k == 2 else "log")
        lines = axes[1, 1].plot(x, share[0], "o-")
        axes[1, 1].plot(x, share[1], "o--", color=lines[0].get_color())
    axes[1, 1].set(ylabel="trials with a stiff direction; dashed: completely rigid", xlabel="$n_l/N$")
    axes[0, 0].legend()
    figure.savefig(out / "cementing.png", dpi=150)
    np.savetxt(out / "curve.csv", np.concatenate(tables), "%.9g", delimiter=",", header=HEAD, comments="")


if __name__ == "__main__":
    run(main)
