"""Figures of ensembles: how a result is spread, its statistic over a parameter, and the scaling near jamming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from packmech.ensemble.jamming_scaling import Exponent, JammingScaling
from packmech.ensemble.statistics import (
    GroupStatistics,
    PowerLawFit,
    group_statistics,
    histogram,
    series_of,
    values_of,
    varied_parameters,
)
from packmech.ensemble.table import Ensemble
from packmech.view.figures import COLORS, MARKERS, styled_figure

# curves that can be distinguished
_MOST = 8
_INK = "#404040"
# what falls towards the jamming point, and how it is called on its axis
FITTED = {
    "pressure": "pressure (energy / diameter$^d$)",
    "distance": "packing fraction above jamming",
    "energy_per_particle": "energy per particle",
    "excess_coordination": "contacts in excess, $z - z_{iso}$",
    "bulk_modulus": "bulk modulus (energy / diameter$^d$)",
    "shear_modulus": "shear modulus (energy / diameter$^d$)",
    "plateau_edge": r"end of the plateau of states, $\omega^*$",
}


def draw_ensemble(
    ensemble: Ensemble,
    name: str,
    path: Path,
    *,
    over: str | None = None,
    statistic: str = "mean",
    log: bool = False,
    fit: PowerLawFit | None = None,
) -> GroupStatistics:
    """Write the figure of one result; return what it shows.

    Parameters
    ----------
    ensemble
        The ensemble.
    name
        Of the result.
    path
        The picture: .png, .svg or .pdf.
    over
        The parameter along the axis of the right part; None: the first that varies.
    statistic
        "mean", "width" or "median".
    log
        Whether the axes of the right part are logarithmic.
    fit
        A power law to be drawn there.

    """
    varied = varied_parameters(ensemble)
    over = over or (varied[0] if varied else None)
    found = group_statistics(ensemble, name, varied, statistic=statistic)
    with styled_figure(path, (9.6, 4.0)) as figure:
        left, right = figure.subplots(1, 2)
        edges = histogram(values_of(ensemble, name)).edge_b
        groups = sorted(set(ensemble[over].tolist())) if over else [None]
        for number, value in enumerate(groups[:: max(1, -(-len(groups) // _MOST))]):
            part = ensemble if over is None else ensemble.take(np.flatnonzero(ensemble[over] == value))
            if not len(values_of(part, name)):
                continue
            shown = histogram(values_of(part, name), bins=edges if over is None else None)
            label = None if over is None else f"{over.rpartition('.')[2]} = {value}"
            left.stairs(shown.density_b, shown.edge_b, color=COLORS[number % len(COLORS)], label=label)
        left.set(xlabel=name.replace("_", " "), ylabel="probability density")
        if over is not None:
            left.legend(fontsize=7.0)
            for number, (label, index) in enumerate(series_of(found, over)):
                x = found.by[over][index]
                right.errorbar(
                    x if x.dtype.kind in "if" else np.arange(len(x)), found.value_g[index], found.error_g[index],
                    color=COLORS[number % len(COLORS)], marker=MARKERS[number % len(MARKERS)], markersize=4.0,
                    linewidth=1.0, capsize=2.0, label=label or None,
                )  # fmt: skip
                if x.dtype.kind not in "if":
                    right.set_xticks(np.arange(len(x)), [str(one) for one in x])
                if label:
                    right.legend(fontsize=7.0)
            if fit is not None:
                x = np.geomspace(found.by[over].min(), found.by[over].max(), 100)
                right.plot(
                    x, fit.limit + fit.prefactor * x**fit.exponent, color="#404040", linestyle="--", linewidth=1.0
                )
            right.set(xlabel=over, ylabel=f"{statistic} of {name.replace('_', ' ')}")
            if log:
                right.set(xscale="log", yscale="log")
        else:
            right.axis("off")
        counts = ensemble.counts()
        figure.suptitle(f"{counts['done']} of {len(ensemble)} members", fontsize=10)
    return found


def draw_scaling(found: JammingScaling, path: Path) -> None:
    """Write the figure: what falls towards the jamming point, and the corrected power laws fitted to it."""
    names = [name for name in FITTED if name in found.names and name != found.control]
    with styled_figure(path, (12.6, 7.2)) as figure:
        axes = figure.subplots(2, 3)
        x, counted = found.level_p, found.counted_p
        for number, (ax, name) in enumerate(zip(axes.flat, names, strict=False)):
            mean, error, color = found.mean_p(name), found.error_p(name), COLORS[number]
            shown = mean > 0.0
            if not shown.any():
                ax.set(xlabel=FITTED[found.control], ylabel=FITTED[name], title="nowhere positive")
                continue
            ax.errorbar(x[shown], mean[shown], error[shown], color=color, marker="o", capsize=2.0, linestyle="")
            theory = found.theory(name, over=found.control)
            try:
                fit = found.fit(name, corrected=True)
            except ValueError:
                # too few levels, or one that is not positive
                fit = None
            if fit is not None:
                ends = np.geomspace(x[counted].min(), x[counted].max(), 60)
                correction = 1.0 + fit.correction * np.sqrt(ends)
                label = rf"exponent ${fit.exponent:.3f} \pm {fit.error:.3f}$, corrected, {fit.levels} levels"
                ax.plot(ends, fit.prefactor * ends**fit.exponent * correction, color=_INK, label=label)
                ax.plot(*(ends, fit.prefactor * ends**theory), color=_INK, linestyle=":", label=f"slope {theory:.4g}")
                ax.legend(loc="upper left", fontsize=7.5)
            if counted.any() and not counted.all():
                ax.axvspan(x.min() / 1.5, np.sqrt(x[counted].min() * x[~counted].max()), color="#f0f0f0", zorder=0)
            ax.set(xscale="log", yscale="log", xlabel=FITTED[found.control], ylabel=FITTED[name])
            ax.set_xlim(x.min() / 1.5, x.max() * 1.5)
            ax.set_ylim(mean[shown].min() / 3.0, mean[shown].max() * 3.0)
        for ax in axes.flat[len(names) :]:
            ax.set_visible(False)
        figure.suptitle(
            f"{found.packings} packings of N = {found.particles}, d = {found.dimension}, strain {found.strain}, energy "
            f"~ overlap$^{{{found.law_exponent:g}}}$; means and standard errors\n"
            "gray: the plateau that N sets, a handful of contacts too many or none; not fitted",
            fontsize=10,
        )


def draw_sizes(
    scalings: Sequence[JammingScaling], fits: Mapping[str, Exponent], largest: float | None, path: Path
) -> None:
    """Write the figure: quantities of several N over the distance, in units of their power laws, and one fit of all."""
    first = scalings[0]
    names = [name for name in FITTED if name in first.names and name != "distance"]
    with styled_figure(path, (12.6, 7.2)) as figure:
        axes = figure.subplots(2, 3)
        for ax, name in zip(axes.flat, names, strict=False):
            theory = first.theory(name, over="distance")
            fit = fits.get(name)
            for number, one in enumerate(scalings):
                x, counted = one.mean_p("distance"), one.counted_p
                if not counted.any():
                    continue
                unit, color = x[counted] ** theory, COLORS[number]
                ax.errorbar(
                    x[counted], one.mean_p(name)[counted] / unit, one.error_p(name)[counted] / unit, color=color,
                    marker=MARKERS[number], markersize=4.0, capsize=2.0, linestyle="",
                    label=f"N = {one.particles}, {one.packings} packings",
                )  # fmt: skip
                if fit is not None:
                    ends = np.geomspace(x[counted].min(), min(x[counted].max(), largest or np.inf), 80)
                    root = np.sqrt(ends)
                    law = 1.0 + fit.correction * root + fit.finite_size / (one.particles * root)
                    ax.plot(ends, fit.prefactor * ends ** (fit.exponent - theory) * law, color=color, linewidth=1.0)
            ax.set(
                xscale="log",
                xlabel=FITTED["distance"],
                ylabel=f"{FITTED[name].split(' (')[0]} / distance$^{{{theory:.4g}}}$",
            )
            ax.set_ylim(bottom=0.0)
            if fit is not None:
                ax.set_title(rf"exponent ${fit.exponent:.3f} \pm {fit.error:.3f}$, expected {theory:.4g}", fontsize=8.5)
        axes.flat[0].legend(fontsize=8.0)
        for ax in axes.flat[len(names) :]:
            ax.set_visible(False)
        figure.suptitle(
            f"energy ~ overlap$^{{{first.law_exponent:g}}}$; one law for all N, corrected in distance and in N",
            fontsize=10,
        )
