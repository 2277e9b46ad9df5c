"""The figure of an ensemble: how a result is spread, and its statistic over a parameter."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from packmech.calls.display import in_words
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
            label = None if over is None else f"{over.rpartition('.')[2]} = {in_words(value)}"
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
                    right.set_xticks(np.arange(len(x)), [in_words(one) for one in x])
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
