"""The command that cements: figure 5 of the polymer source, its tables, and what they say."""

from __future__ import annotations

import argparse
from pathlib import Path

from packmech.cli_show import console, working
from packmech.report_table import rich_table


def run_cement(given: argparse.Namespace) -> int:
    """Cement, going on where earlier work in the folder ended; write tables and figure, print what they say."""
    from packmech.cement_figure import draw
    from packmech.cement_table import curve_csv, thresholds, thresholds_csv, told
    from packmech.dynamics.cement_curve import cementing_curve

    sizes, packings, orders = ([64, 128, 256, 512, 1024, 2048], 25, 50) if given.full else ([64, 128, 256], 10, 20)
    sizes = sizes if given.particles is None else given.particles
    packings = packings if given.packings is None else given.packings
    orders = orders if given.orders is None else given.orders
    folder: Path = given.out
    with working("cementing") as tell:
        curves = cementing_curve(
            folder / "trials",
            particles=sizes,
            packings=packings,
            orders=orders,
            seed=given.seed,
            step=given.step,
            freeze=given.freeze,
            processes=given.processes,
            progress=lambda size, packing, done: tell(
                f"cementing: N = {size}, packing {packing + 1} of {packings}, {done} of {orders} orders"
            ),
        )
    made_by = (
        f"packmech cement --particles {' '.join(map(str, sizes))} --packings {packings} --orders {orders} "
        f"--seed {given.seed} --step {given.step:g} --freeze {given.freeze}"
    )
    (folder / "curve.csv").write_text(curve_csv(curves), encoding="utf-8")
    (folder / "thresholds.csv").write_text(thresholds_csv(curves), encoding="utf-8")
    (folder / "cementing.md").write_text(told(curves, made_by), encoding="utf-8")
    draw(curves, folder / "cementing.png")
    headings, rows = thresholds(curves)
    by_size = [(heading, *(row[k] for row in rows)) for k, heading in enumerate(headings) if k]
    title, head = "cementing", (headings[0], *(row[0] for row in rows))
    console().print(rich_table(title, head, by_size, right=tuple(range(1, len(head)))))
    console().print(f"wrote curve.csv, thresholds.csv, cementing.md and cementing.png in {folder}")
    return 0
