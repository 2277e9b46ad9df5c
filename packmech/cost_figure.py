"""The picture of a table of costs: bars by name. Imported only when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from packmech.accuracy_figure import COLORS, STYLE


def draw_costs(title: str, names: Sequence[str], columns: Mapping[str, Sequence[float]], path: Path) -> None:
    """Write the figure: a column of bars for each quantity, names at the left, numbers at the ends of the bars."""
    with matplotlib.rc_context(STYLE):
        # a letter takes about 0.075 inches
        margin = 0.075 * max(len(name) for name in names)
        figure = Figure(figsize=(margin + 2.6 * len(columns), 1.2 + 0.42 * len(names)), layout="constrained")
        axes = figure.subplots(1, len(columns), squeeze=False, sharey=True)[0]
        place = range(len(names))
        for k, (ax, (quantity, values)) in enumerate(zip(axes, columns.items(), strict=True)):
            bars = ax.barh(place, values, color=COLORS[k % len(COLORS)], height=0.62)
            ax.bar_label(bars, [f"{value:.3g}" if value < 1000.0 else f"{value:.0f}" for value in values], padding=3)
            ax.set(title=quantity, xlim=(0.0, 1.18 * max(values)))
            ax.grid(axis="y", visible=False)
            ax.set_axisbelow(True)
        axes[0].set_yticks(place, names)
        axes[0].invert_yaxis()
        figure.suptitle(title, fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)
