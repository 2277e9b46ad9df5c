"""Random contacts of jammed packings become rigid links: bulk and shear modulus over cemented contacts per particle.

    python recordings/cementing/cementing.py --particles 64 --particles 128 --particles 256 --packings 25 --orders 50
    python recordings/cementing/cementing.py --freeze clusters

A trial's value is the mean of its Voigt and Reuss bounds, its weight 12/(Voigt - Reuss)^2; trials with an infinite
bound carry none. Standard errors take packings as independent, not the orders of one packing.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

MEANS = ("bulk", "shear", "poisson_ratio", "anisotropy")


def main(
    *,
    particles: tuple[int, ...] = (64, 128, 256),
    packings: int = 10,
    orders: int = 20,
    step: float = 0.05,
    freeze: str = "angles",
    out: Path | None = None,
    workers: int | None = None,
) -> None:
    """Cement the packings, write both tables and draw the figure."""
    out = out or Path(__file__).parent / freeze
    given = {"particles": particles, "packings": packings, "orders": orders, "step": step, "freeze": freeze}
    curves = pm.cementing_curve(out / "members", workers=workers, **given)
    rows, thresholds = [], []
    figure, axes = plt.subplots(2, 2, figsize=(9.6, 7.2), layout="constrained")
    for number, curve in enumerate(curves):
        x, means = curve.link_fraction_k, [getattr(curve, name) for name in MEANS]
        columns = [column for one in means for column in (one.mean_k, one.error_k)]
        bounds = [curve.bound_means[f"{name}_{bound}"] for name in MEANS[:2] for bound in ("reuss", "voigt")]
        table = np.column_stack([x, *columns, *bounds, curve.some_stiff_k, curve.all_stiff_k])
        rows.append(np.insert(table, 0, curve.particles, axis=1))
        first, last = curve.first_stiff_po, curve.all_stiff_po
        packing, order = np.indices(first.shape)
        numbers = [one.ravel() for one in (packing, order, first, last)]
        thresholds.append(np.insert(np.column_stack(numbers), 0, curve.particles, axis=1))
        print(
            f"N = {curve.particles}: first stiff direction at {first.mean():.4f}, complete rigidity {last.mean():.4f}"
        )
        # from here on means over the others are no longer those of the ensemble
        show = curve.some_stiff_k < 0.5
        for ax, name, one in zip(axes.flat, MEANS[:3], means, strict=False):
            ax.errorbar(
                x[show], one.mean_k[show], one.error_k[show], fmt="o-", capsize=2.0, label=f"N = {curve.particles}"
            )
            ax.set(ylabel=name.replace("_", " "), xlabel="cemented contacts per particle, $n_l/N$")
        for k, ax in enumerate(axes[0]):
            ax.fill_between(x[show], bounds[2 * k][show], bounds[2 * k + 1][show], color=f"C{number}", alpha=0.12)
            ax.set_yscale("log")
        axes[1, 1].plot(x, curve.some_stiff_k, f"C{number}o-", x, curve.all_stiff_k, f"C{number}o--")
    axes[1, 1].set(ylabel="trials with a stiff direction; dashed: completely rigid", xlabel="$n_l/N$")
    axes[0, 0].legend()
    figure.savefig(out / "cementing.png", dpi=150)
    head = ",".join(["N", "nl/N", *(f"{name}{end}" for name in MEANS for end in ("", " error"))])
    head += ",bulk Reuss,bulk Voigt,shear Reuss,shear Voigt,some stiff,all stiff"
    np.savetxt(out / "curve.csv", np.concatenate(rows), "%.9g", delimiter=",", header=head, comments="")
    head = "N,packing,order,nl/N first stiff direction,nl/N complete rigidity"
    np.savetxt(out / "thresholds.csv", np.concatenate(thresholds), "%.9g", delimiter=",", header=head, comments="")


if __name__ == "__main__":
    run(main)
