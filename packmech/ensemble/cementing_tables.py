"""Cementing curves as tables, words and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from packmech.ensemble.cementing_curve import CementingCurve, error_of_mean
from packmech.protocols.cement import AVERAGES
from packmech.result import csv_text, markdown_table
from packmech.view.figures import COLORS, MARKERS, styled_figure

WEIGHTS = (
    "A trial's value is the mean of its Voigt and Reuss bounds, its weight 12/(Voigt - Reuss)^2: the inverse variance "
    "of a value spread evenly between the bounds. Trials with an infinite bound carry no weight. Standard errors take "
    "packings as independent, not the orders of one packing. Soft trials, whose bounds are nearer, weigh most: shortly "
    "before directions become stiff weighted means fall below the mean Reuss bound."
)
# from this fraction of trials with a stiff direction on, means over the others are no longer those of the ensemble
STIFF_SHARE = 0.5


def curve_csv(curves: Sequence[CementingCurve]) -> str:
    """Return the curves as CSV, a line for each N and step."""
    head = ["N", "nl/N", "trials", "K", "K error", "K Reuss", "K Hill", "K Voigt"]
    head += ["G", "G error", "G Reuss", "G Hill", "G Voigt"]
    head += ["Poisson ratio", "Poisson ratio error", "anisotropy", "anisotropy error", "some stiff", "all stiff"]
    lines = []
    for curve in curves:
        for k, fraction in enumerate(curve.link_fraction_k):
            numbers = [fraction, float(curve.shear.trials_k[k])]
            for name in ("bulk", "shear"):
                means = getattr(curve, name)
                numbers += [means.mean_k[k], means.error_k[k]]
                numbers += [curve.bound_means[f"{name}_{bound}"][k] for bound in AVERAGES]
            for means in (curve.poisson_ratio, curve.anisotropy):
                numbers += [means.mean_k[k], means.error_k[k]]
            numbers += [curve.some_stiff_k[k], curve.all_stiff_k[k]]
            lines.append([str(curve.particles), *(f"{number:.9g}" for number in numbers)])
    return csv_text(head, lines)


def thresholds_csv(curves: Sequence[CementingCurve]) -> str:
    """Return n_l/N at the first stiff direction and at complete rigidity of every trial as CSV."""
    lines = [
        [str(curve.particles), str(packing), str(order), f"{first:.9g}", f"{last:.9g}"]
        for curve in curves
        for packing, row in enumerate(zip(curve.first_stiff_po, curve.all_stiff_po, strict=True))
        for order, (first, last) in enumerate(zip(*row, strict=True))
    ]
    return csv_text(["N", "packing", "order", "nl/N first stiff direction", "nl/N complete rigidity"], lines)


def thresholds(curves: Sequence[CementingCurve]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows: thresholds, and the moduli and Poisson ratio where cementing starts and halfway."""
    headings = (
        "N",
        "packings x orders",
        "n_l/N, first stiff direction",
        "n_l/N, complete rigidity",
        "K at 0",
        "G at 0",
        "Poisson ratio at 0",
        "K at 0.5",
        "G at 0.5",
        "Poisson ratio at 0.5",
        "CPU s",
    )
    rows = []
    for curve in curves:
        row = [str(curve.particles), " x ".join(map(str, curve.first_stiff_po.shape))]
        row += [_pair(*error_of_mean(table)) for table in (curve.first_stiff_po, curve.all_stiff_po)]
        for fraction in (0.0, 0.5):
            k = int(np.abs(curve.link_fraction_k - fraction).argmin())
            row += [
                _pair(means.mean_k[k], means.error_k[k]) for means in (curve.bulk, curve.shear, curve.poisson_ratio)
            ]
        rows.append((*row, f"{curve.seconds:.0f}"))
    return headings, rows


def _pair(mean: float, error: float) -> str:
    return f"{mean:.4g}" if np.isnan(error) else f"{mean:.4g} ({error:.2g})"


def cementing_markdown(curves: Sequence[CementingCurve], made_by: str) -> str:
    """Return the thresholds and the safety of the counts as Markdown."""
    headings, rows = thresholds(curves)
    # a column for each N reads better than eleven columns
    lines = ["# Cementing", "", f"Made by `{made_by}`.", "", WEIGHTS]
    lines += ["Moduli in energy_scale/diameter^d, of the unstressed network; standard errors in parentheses.", ""]
    by_size = [(heading, *(row[k] for row in rows)) for k, heading in enumerate(headings) if k]
    lines += markdown_table((headings[0], *(row[0] for row in rows)), by_size).splitlines()
    least = np.concatenate([trial.smallest_new_o for curve in curves for trial in curve.trials])
    largest = np.concatenate([trial.largest_old_o for curve in curves for trial in curve.trials])
    apart = (least / np.maximum(largest, 1e-16)).min()
    drawn = sum(trial.attempts for curve in curves for trial in curve.trials)
    kept = sum(len(curve.trials) for curve in curves)
    lines += [
        "",
        f"{drawn} packings were drawn for {kept} with one state of self stress."
        if drawn
        else "Packings are one's own, with the states of self stress that they have.",
        f"Links taken for independent have {least.min():.1e} or more of their gradient across the others, redundant "
        f"ones {largest.max():.1e} or less; in no trial are the two nearer than by a factor of {apart:.0f}.",
        f"No bound of any trial falls from one step to the next by more than {largest_fall(curves):.1e} of itself, and "
        f"no Reuss bound is above its Voigt bound by more than {largest_crossing(curves):.1e} of it.",
        "",
    ]
    return "\n".join(lines)


def largest_fall(curves: Sequence[CementingCurve]) -> float:
    """Return the largest relative fall of a bound from one step to the next over all trials; 0 when none falls."""
    worst = 0.0
    for trial in (one for curve in curves for one in curve.trials):
        for name in ("bulk_reuss", "bulk_voigt", "shear_reuss", "shear_voigt"):
            table = trial.curves[name]
            before, after = table[:, :-1], table[:, 1:]
            seen = np.isfinite(before)
            worst = max(worst, float((1.0 - after[seen] / before[seen]).max(initial=0.0)))
    return worst


def largest_crossing(curves: Sequence[CementingCurve]) -> float:
    """Return by how much a Reuss bound is above its Voigt bound, relative, over all trials; 0 when none is."""
    worst = 0.0
    for trial in (one for curve in curves for one in curve.trials):
        for modulus in ("bulk", "shear"):
            low, high = trial.curves[f"{modulus}_reuss"], trial.curves[f"{modulus}_voigt"]
            seen = np.isfinite(high)
            worst = max(worst, float((low[seen] / high[seen] - 1.0).max(initial=0.0)))
    return worst


def draw_cementing(curves: Sequence[CementingCurve], path: Path) -> None:
    """Write the figure: shear and bulk modulus, Poisson ratio, and the fractions of stiff packings, against n_l/N."""
    with styled_figure(path, (9.6, 7.2)) as figure:
        axes = figure.subplots(2, 2)
        for number, curve in enumerate(curves):
            color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
            style = {"color": color, "marker": marker, "markersize": 4.0, "linewidth": 1.0}
            _moduli(axes[0][0], curve, "shear", style)
            _moduli(axes[0][1], curve, "bulk", style)
            show = curve.some_stiff_k < STIFF_SHARE
            poisson = curve.poisson_ratio
            axes[1][0].errorbar(
                curve.link_fraction_k[show], poisson.mean_k[show], poisson.error_k[show], capsize=2.0, **style
            )
            axes[1][1].plot(curve.link_fraction_k, curve.some_stiff_k, **style)
            axes[1][1].plot(curve.link_fraction_k, curve.all_stiff_k, markerfacecolor="none", linestyle="--", **style)
        for ax, name in ((axes[0][0], "shear"), (axes[0][1], "bulk")):
            shown = [getattr(curve, name).mean_k[curve.some_stiff_k < STIFF_SHARE] for curve in curves]
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


def _moduli(ax: Any, curve: CementingCurve, name: str, style: dict[str, Any]) -> None:
    show = curve.some_stiff_k < STIFF_SHARE
    means, fraction = getattr(curve, name), curve.link_fraction_k[show]
    ax.errorbar(fraction, means.mean_k[show], means.error_k[show], capsize=2.0, label=f"N = {curve.particles}", **style)
    low, high = (curve.bound_means[f"{name}_{bound}"][show] for bound in ("reuss", "voigt"))
    ax.fill_between(fraction, low, high, color=style["color"], alpha=0.12, linewidth=0.0)
