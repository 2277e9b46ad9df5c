"""The picture of a work-precision table. Imported only when one is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

if TYPE_CHECKING:
    from packmech.accuracy_table import WorkPrecision

# eight colors and shapes that stay apart for color-blind readers and in gray (Okabe and Ito)
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#8C6D31")
MARKERS = "osD^vP*X"
STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "svg.hashsalt": "packmech",
}


def draw(table: WorkPrecision, path: Path) -> None:
    """Write the figure: one column for each quantity; above error against setting, below seconds against error."""
    quantities = table.quantities
    if not quantities:
        raise ValueError("table must have at least one measured error to be drawn, got none")
    with matplotlib.rc_context(STYLE):
        width = max(3.9 * len(quantities) + 0.4, 7.2)
        figure = Figure(figsize=(width, 6.6), layout="constrained")
        ax_rows = figure.subplots(2, len(quantities), squeeze=False)
        for column, quantity in enumerate(quantities):
            above, below = ax_rows[0][column], ax_rows[1][column]
            zero = _zero_level(table, quantity)
            for index, method in enumerate(table.methods):
                _method(table, method, quantity, zero, COLORS[index % 8], MARKERS[index % 8], above, below)
            above.set(title=quantity, xlabel=table.knob, ylabel=f"error in {quantity}", xscale="log", yscale="log")
            settings = sorted({trial.setting for trial in table.trials})
            if settings[-1] < 100.0 * settings[0]:
                # less than two decades: powers of ten say too little, and numbers between them overlap
                above.set_xticks(settings, [f"{one:g}" for one in settings], minor=False)
                above.xaxis.set_minor_formatter(NullFormatter())
            above.invert_xaxis()
            below.set(xlabel=f"error in {quantity}", ylabel="CPU seconds", xscale="log", yscale="log")
            below.invert_xaxis()
            if any(trial.errors.get(quantity) == 0.0 for trial in table.trials):
                above.axhline(zero, color="#999999", linewidth=0.8, linestyle=":")
                above.annotate("exactly 0", (0.01, zero), xycoords=("axes fraction", "data"), va="top", fontsize=7.5)
                above.set_ylim(bottom=0.1 * zero)
                below.axvline(zero, color="#999999", linewidth=0.8, linestyle=":")
                below.annotate(
                    "exactly 0", (zero, 0.02), xycoords=("data", "axes fraction"), rotation=90, ha="right", fontsize=7.5
                )
        handles, labels = ax_rows[0][0].get_legend_handles_labels()
        if any(trial.failed and trial.errors for trial in table.trials):
            handles.append(Line2D([], [], color="#666666", marker="o", markerfacecolor="none", linestyle="none"))
            labels.append("hollow: failed")
        # a letter takes about 0.075 inches, a line and the space around it half an inch
        fitting = int(width / (0.5 + 0.075 * max((len(label) for label in labels), default=1)))
        figure.legend(handles, labels, loc="outside lower center", ncols=max(1, min(len(labels), 4, fitting)))
        heading = table.title or "work and precision"
        figure.suptitle(f"{heading}\nreference: {table.reference_is}" if table.reference_is else heading, fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)


def _zero_level(table: WorkPrecision, quantity: str) -> float:
    """Where exact zeros are drawn on a logarithmic axis: a decade under the smallest error."""
    positive = [t.errors[quantity] for t in table.trials if t.errors.get(quantity, 0.0) > 0.0]
    return 0.1 * min(positive, default=1e-15)


def _method(
    table: WorkPrecision, method: str, quantity: str, zero: float, color: str, marker: str, above: Any, below: Any
) -> None:
    trials = [trial for trial in table.of(method) if quantity in trial.errors]
    good = [trial for trial in trials if not trial.failed]
    failed = [trial for trial in trials if trial.failed]
    common = {"color": color, "marker": marker, "markersize": 5.0, "linewidth": 1.2}
    for subset, extra in (
        (good, {"label": method or "method"}),
        (failed, {"markerfacecolor": "none", "linestyle": "none"}),
    ):
        errors = [max(trial.errors[quantity], zero) for trial in subset]
        style: dict[str, Any] = {**common, **extra}
        above.plot([trial.setting for trial in subset], errors, **style)
        below.plot(errors, [trial.seconds for trial in subset], **style)
