"""The command that cements: figure 5 of the polymer source, its tables, and what they say."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from packmech.cli_show import console, working
from packmech.report_table import rich_table
from packmech.scene import CementDrive, Scene


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


def cement_scene(scene: Scene, drive: CementDrive, tell: Callable[[str], None]) -> dict[str, Any]:
    """Return what cementing a jammed packing shows, by name, the means over its orders at each step.

    Moduli are the middle of the Reuss and Voigt bounds, None from the step on at which a direction of strain has become
    infinitely stiff in some order.
    """
    from packmech.dynamics.cement import cement

    orders = []
    for order in range(drive.orders):
        tell(f"cementing, order {order + 1} of {drive.orders}")
        orders.append(cement(scene, seed=drive.seed + order, step=drive.step, freeze=drive.freeze))
    steps = min(sum(1 for stiff in one.stiff_k if stiff == 0) for one in orders)
    particles = scene.packing.particles
    told: dict[str, Any] = {
        "link_fraction": [float(x) for x in orders[0].link_fraction_k[:steps]],
        "states_of_self_stress": orders[0].self_stress,
        "first_stiff": [None if one.first_stiff is None else one.first_stiff / particles for one in orders],
        "all_stiff": [None if one.all_stiff is None else one.all_stiff / particles for one in orders],
        "freeze": drive.freeze,
        "seconds": sum(one.seconds for one in orders),
    }
    for name in ("bulk_modulus", "shear_modulus"):
        for bound in ("reuss", "voigt"):
            told[f"{name}_{bound}"] = [
                float(np.mean([getattr(getattr(one, bound)(k), name) for one in orders])) for k in range(steps)
            ]
    told["poisson_ratio"] = [float(np.mean([one.poisson_ratio(k) for one in orders])) for k in range(steps)]
    return told


def print_cementing(told: dict[str, Any]) -> None:
    """Print the table of a scene that was cemented, and its thresholds."""
    headings = ("n_l/N", "K Reuss", "K Voigt", "G Reuss", "G Voigt", "Poisson ratio")
    names = ("bulk_modulus_reuss", "bulk_modulus_voigt", "shear_modulus_reuss", "shear_modulus_voigt", "poisson_ratio")
    rows = [
        (f"{fraction:.3f}", *(f"{told[name][k]:.4g}" for name in names))
        for k, fraction in enumerate(told["link_fraction"])
    ]
    orders = len(told["first_stiff"])
    title = f"cementing, mean of {orders} order{'' if orders == 1 else 's'}"
    console().print(rich_table(title, headings, rows, right=tuple(range(len(headings)))))
    if told["states_of_self_stress"] != 1:
        console().print(f"cemented from {told['states_of_self_stress']} states of self stress, not from one")
    for words, name in (("first infinitely stiff direction", "first_stiff"), ("complete rigidity", "all_stiff")):
        reached = [x for x in told[name] if x is not None]
        if reached:
            console().print(f"{words}: n_l/N = {np.mean(reached):.3f} ({len(reached)} of {orders} orders)")
