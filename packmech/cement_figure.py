"""The picture of cementing curves. Imported only when one is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from packmech.accuracy_figure import COLORS, MARKERS, STYLE
from packmech.cement_table import MOST
from packmech.dynamics.cement_curve import CementingCurve


def draw(curves: Sequence[CementingCurve], path: Path) -> None:
    """Write the figure: shear and bulk modulus, Poisson ratio, and the fractions of stiff packings, against n_l/N."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 7.2), layout="constrained")
        axes = figure.subplots(2, 2)
        for number, curve in enumerate(curves):
            color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
            style = {"color": color, "marker": marker, "markersize": 4.0, "linewidth": 1.0}
            _moduli(axes[0][0], curve, "shear", style)
            _moduli(axes[0][1], curve, "bulk", style)
            show = curve.some_stiff_k < MOST
            poisson = curve.poisson_ratio
            axes[1][0].errorbar(
                curve.link_fraction_k[show], poisson.mean_k[show], poisson.error_k[show], capsize=2.0, **style
            )
            axes[1][1].plot(curve.link_fraction_k, curve.some_stiff_k, **style)
            axes[1][1].plot(curve.link_fraction_k, curve.all_stiff_k, markerfacecolor="none", linestyle="--", **style)
        for ax, name in ((axes[0][0], "shear"), (axes[0][1], "bulk")):
            shown = [getattr(curve, name).mean_k[curve.some_stiff_k < MOST] for curve in curves]
            # means of the upper bound run away shortly before directions become stiff
            ax.set_ylim(0.4 * min(map(np.nanmin, shown)), 5.0 * max(map(np.nanmax, shown)))
        axes[0][0].set(ylabel="shear modulus (energy / diameter$^d$)", yscale="log")
        axes[0][1].set(ylabel="bulk modulus (energy / diameter$^d$)", yscale="log")
        axes[1][0].set(ylabel="Poisson ratio")
        axes[1][1].set(ylabel="fraction of trials", ylim=(-0.03, 1.03))
        axes[1][1].set_title("filled: a stiff direction; open: completely rigid", fontsize=8.0)
        for ax in axes.flat:
            ax.set_xlabel("cemented contacts per particle, $n_l/N$")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
        first = curves[0]
        shape = " x ".join(map(str, first.first_stiff_po.shape))
        figure.suptitle(
            f"Cementing: random contacts become rigid links; {shape} packings x orders\n"
            "points: means weighted by the Voigt and Reuss bounds; bands: mean bounds; shown until half are stiff",
            fontsize=10,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)


def _moduli(ax: Any, curve: CementingCurve, name: str, style: dict[str, Any]) -> None:
    show = curve.some_stiff_k < MOST
    means, fraction = getattr(curve, name), curve.link_fraction_k[show]
    ax.errorbar(fraction, means.mean_k[show], means.error_k[show], capsize=2.0, label=f"N = {curve.particles}", **style)
    low, high = (curve.bound_means[f"{name}_{bound}"][show] for bound in ("reuss", "voigt"))
    ax.fill_between(fraction, low, high, color=style["color"], alpha=0.12, linewidth=0.0)
