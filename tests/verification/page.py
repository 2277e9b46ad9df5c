"""The page of motions with closed forms: a table of errors and orders, and a figure.

python tests/verification/page.py recordings/verification
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from verification.cases import CASES, Case, Compared  # noqa: E402

COLUMNS = 3
HEAD = """# Time steps against closed forms

Each motion is run at a time step and at half of it; the error is the largest difference from the closed form over its
largest value. Smooth contacts converge with the second order; where the order is another one the last column says why.
Points are time steps, lines closed forms. `pytest tests/verification` checks every row.

![Points of time steps on lines of closed forms](verification.png)

| motion | source | steps | error | at half the step | order | why no second order |
|---|---|---|---|---|---|---|
"""


def row(one: Case, coarse: Compared, fine: Compared) -> str:
    """Return the row of a case."""
    order = f"{math.log2(coarse.error / fine.error):.2f}" if one.order is not None else "-"
    cells = (one.title, one.source, f"{one.steps}", f"{coarse.error:.1e}", f"{fine.error:.1e}", order, one.why)
    return f"| {' | '.join(cells)} |\n"


def main(folder: Path) -> None:
    """Write the page and its figure."""
    folder.mkdir(parents=True, exist_ok=True)
    solved = {name: (one.solve(one.steps), one.solve(2 * one.steps)) for name, one in CASES.items()}
    lines = math.ceil(len(CASES) / COLUMNS)
    figure, axes = plt.subplots(lines, COLUMNS, figsize=(4.0 * COLUMNS, 2.9 * lines), squeeze=False)
    for ax in axes.flat[len(CASES) :]:
        ax.remove()
    for ax, (name, (found, _)) in zip(axes.flat, solved.items(), strict=False):
        order = np.argsort(found.x)
        ax.plot(found.x[order], found.exact[order], color="#888888", linewidth=1.2, label="closed form")
        ax.plot(found.x, found.found, ".", color="#1f77b4", markersize=5.0, label="time steps")
        ax.set_xlabel(CASES[name].axes[0])
        ax.set_ylabel(CASES[name].axes[1], fontsize=8)
        ax.set_title(name.replace("-", " "), fontsize=9)
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    figure.savefig(folder / "verification.png", dpi=110)
    rows = "".join(row(CASES[name], *both) for name, both in solved.items())
    (folder / "README.md").write_text(HEAD + rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
