"""Exact against paper Hessian of shear-stabilized packings with links over pressure: compliance, lowest eigenvalue.

    python recordings/accuracy/exact_hessian.py

The paper form leaves out the forces that links bear times the curvature of their lengths, so that it should come right
as the pressure goes to zero, and not before. Both forms are held against finite differences of the stress by the tests.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

PRESSURES = tuple(10.0**-k for k in range(1, 7))


@cache
def state(name: str, dimension: int, pressure: float) -> pm.Scene:
    """Return the packing shear-stabilized at a pressure, brought down from the next higher one."""
    higher = [one for one in PRESSURES if one > pressure]
    if higher:
        scene = state(name, dimension, min(higher))
    else:
        common = {"dimension": dimension, "packing_fraction": {2: 0.9, 3: 0.7}[dimension], "seed": 1}
        start = {
            "dimers": partial(pm.cluster_packing, 10, pm.Dimer(), **common),
            "rigid trimers": partial(pm.cluster_packing, 7, pm.Trimer(angle=(1.1, 2.6)), **common),
            "flexible chains": partial(pm.chain_packing, 4, 5, **common),
        }[name]
        scene = pm.Scene(start(), (pm.Repulsion(),))
    return scene.replace(packing=pm.shear_stabilize(scene, pressure=pressure).packing)


def lowest(scene: pm.Scene, kind: str) -> float:
    """Return the lowest eigenvalue at fixed volume, translations and dangling ends left out."""
    equal = scene.replace(packing=scene.packing.replace(mass_n=np.ones(scene.packing.particles)))
    value = np.linalg.eigvalsh(pm.dynamical_matrix(equal, "isochoric", kind).toarray())
    return float(value[np.abs(value) > 1e-9 * value.max()].min())


def trial(name: str, dimension: int, pressure: float) -> dict[str, float]:
    """Return the relative differences of the paper form from the exact one."""
    scene = state(name, dimension, pressure)
    scene = scene.replace(packing=pm.remove_rattlers(scene.packing)[0])
    exact, paper = (pm.compliance_matrix(scene, kind=kind) for kind in ("exact", "paper"))
    off = float(np.abs(paper - exact).max() / np.abs(exact).max())
    true, near = lowest(scene, "exact"), lowest(scene, "paper")
    return {"compliance, paper": off, "lowest eigenvalue, paper": abs(near - true) / abs(true)}


def main(*, pressures: tuple[float, ...] = PRESSURES, out: Path = Path(__file__).parent) -> None:
    """Compare both forms of all packings at all pressures; write table and figure."""
    names = ("dimers", "rigid trimers", "flexible chains")
    table = pm.work_precision(
        {f"{name}, {dimension}D": partial(trial, name, dimension) for name in names for dimension in (2, 3)},
        pressures,
        {"compliance, paper": 0.0, "lowest eigenvalue, paper": 0.0},
        knob="pressure",
        title="Exact and paper Hessian of shear-stabilized packings with links",
        reference_is="the exact form",
        repeats=1,
    )
    (out / "exact_hessian.csv").write_text(table.to_csv())
    (out / "exact_hessian.md").write_text(table.to_markdown())
    table.save_figure(out / "exact_hessian.png")


if __name__ == "__main__":
    run(main)
