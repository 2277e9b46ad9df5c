"""The picture of means that deviate from a reference: with error bars, and in logarithms. Imported only when drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from packmech.accuracy_figure import COLORS, MARKERS, STYLE

# (setting, deviation, its standard error), by method and quantity
Deviations = Mapping[str, Mapping[str, Sequence[tuple[float, float, float]]]]


def draw_deviations(deviations: Deviations, path: Path, *, title: str, knob: str, most: float = 0.15) -> None:
    """Write the figure: a column for each quantity; above deviations with error bars, below their sizes in logarithms.

    Parameters
    ----------
    deviations
        Deviations relative to the reference, by method, then by quantity.
    path
        The file; its ending names the format.
    title, knob
        Words: what is shown, and what the setting is.
    most
        Deviations are drawn above up to this size; larger ones stand below alone.

    """
    quantities = list(next(iter(deviations.values())))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(4.4 * len(quantities), 6.8), layout="constrained")
        axes = figure.subplots(2, len(quantities), squeeze=False, sharex=True)
        settings = sorted({row[0] for found in deviations.values() for rows in found.values() for row in rows})
        for column, quantity in enumerate(quantities):
            above, below = axes[0][column], axes[1][column]
            for k, (method, found) in enumerate(deviations.items()):
                setting, off, bar = np.array(found[quantity]).reshape(-1, 3).T
                style = {"color": COLORS[k % 8], "marker": MARKERS[k % 8], "markersize": 4.5, "linewidth": 1.0}
                # side by side, or bars hide each other
                beside = setting * 1.05 ** (k - 0.5 * (len(deviations) - 1))
                shown = np.abs(off) <= most
                above.errorbar(
                    beside[shown], 100.0 * off[shown], 100.0 * bar[shown], capsize=2.0, label=method, **style
                )
                below.plot(setting, np.abs(off), **style)
            above.axhline(0.0, color="#999999", linewidth=0.8)
            above.set(title=quantity, ylabel="off the reference [%]", xscale="log")
            # what is nowhere off cannot be seen in logarithms
            scale = "log" if any(row[1] for found in deviations.values() for row in found[quantity]) else "linear"
            below.set(xlabel=knob, ylabel="size of it, relative", yscale=scale)
            below.set_xticks(settings, [f"{one:g}" for one in settings], minor=False)
            below.xaxis.set_minor_formatter(NullFormatter())
        # all columns share it
        axes[0][0].invert_xaxis()
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        figure.suptitle(title, fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)
