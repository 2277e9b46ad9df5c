"""Random contacts of jammed packings become rigid links, one after another: their moduli at every step.

    python recordings/cementing/cementing.py --particles 64 --particles 128 --particles 256 --packings 25 --orders 50
    python recordings/cementing/cementing.py --freeze clusters

`curves.py` makes the curves of bulk and shear modulus of it.
"""

from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

BOUNDS = ("bulk_reuss", "bulk_voigt", "shear_reuss", "shear_voigt")


def cement(particles: int, orders: int, step: float, freeze: str, seed: int) -> dict[str, np.ndarray]:
    """Return the curves of all orders of cementing of one packing, drawn until it has one state of self stress."""
    for attempt in range(50):
        start = pm.random_packing(particles, dimension=3, packing_fraction=0.5, seed=1000 * seed + attempt)
        one = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8, check=False)
        if one.ok and one.report["states_of_self_stress"] == 1:
            break
    else:
        raise pm.NotConverged(one)
    columns = []
    for order in range(orders):
        found = pm.cement(pm.Scene(one.packing, (pm.Repulsion(),)), seed=order, step=step, freeze=freeze)
        curves, number = found.curves, np.arange(len(found.cemented_k))
        ends = [particles if end is None else end for end in (found.first_stiff, found.all_stiff)]
        rows = [number, found.stiff_k, *(curves[name] for name in (*BOUNDS, "poisson", "anisotropy"))]
        columns.append(np.vstack([np.full(len(number), order), *rows, *np.outer(ends, np.ones(len(number)))]))
    names = ("order", "number", "stiff", *BOUNDS, "poisson", "anisotropy", "first_stiff", "all_stiff")
    return dict(zip(names, np.hstack(columns), strict=True))


def main(
    *,
    particles: tuple[int, ...] = (64, 128, 256),
    packings: int = 10,
    orders: int = 20,
    step: float = 0.05,
    freeze: str = "angles",
    out: Path | None = None,
    workers: int | None = None,
) -> None:
    """Cement the packings, print where they become stiff and write the table."""
    out = out or Path(__file__).parent / freeze
    grid = {"particles": particles, "orders": orders, "step": step, "freeze": freeze, "seed": range(packings)}
    table = pm.run_ensemble(cement, grid, out / "members", workers=workers).of(grid).rows()
    pm.write_table(table, out / "orders.csv")
    for count in particles:
        # one row of each order
        first = (table["particles"] == count) & (table["number"] == 0.0)
        ends = [f"{table[name][first].mean() / count:.4f}" for name in ("first_stiff", "all_stiff")]
        print(f"N = {count}: first stiff direction at {ends[0]}, complete rigidity at {ends[1]} contacts per particle")


if __name__ == "__main__":
    run(main)
