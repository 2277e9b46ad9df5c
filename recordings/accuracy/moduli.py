"""Moduli three ways: by a sparse solve, by the pseudo-inverse of the whole Hessian, by strains of finite size.

    python recordings/accuracy/moduli.py

A packing at rest is strained by a small symmetric shear, both ways, and brought to rest again; the second difference of
its energy gives the elastic constant xyxy, with an error of the second order in the strain until contacts change, and
with rounding over the strain squared. The sparse solve and the pseudo-inverse have no strain, and stand in the table at
every strain. The reference is the sparse solve, from which the pseudo-inverse differs by rounding.
"""

from functools import partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

STRAINS = tuple(10.0**-k for k in (1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 7))
CONSTANT = "elastic constant xyxy"


def at_rest(particles: int, packing_fraction: float) -> pm.Scene:
    """Return discs at an energy minimum without rattlers, well above jamming."""
    start = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=packing_fraction, seed=1
    )
    scene = pm.Scene(start, (pm.Repulsion(),))
    return scene.replace(packing=pm.remove_rattlers(pm.quench(scene, force_tolerance=1e-13).packing)[0])


def sparse(scene: pm.Scene, strain: float) -> float:
    """Return the elastic constant by the sparse solve."""
    return pm.elastic_moduli(scene).component("xyxy", tangent="energy")


def by_pseudo_inverse(scene: pm.Scene, strain: float) -> float:
    """Return the elastic constant by the pseudo-inverse of the dense Hessian of the positions."""
    packing = scene.packing
    whole, q = pm.hessian(scene).toarray(), packing.particles * packing.dimension
    mixed = whole[:q, -1]
    relaxed = whole[-1, -1] - mixed @ np.linalg.pinv(whole[:q, :q], rcond=1e-12, hermitian=True) @ mixed
    # the last strain is sqrt(2) xy, half of whose square the constant xyxy has
    return float(0.5 * relaxed / packing.box.volume)


def strained(packing: pm.Packing, strain_dd: np.ndarray) -> pm.Packing:
    """Return the packing with its box and all in it strained."""
    change = np.eye(len(strain_dd)) + strain_dd
    return packing.replace(box=pm.Box(change @ packing.box.lattice_dd), position_nd=packing.position_nd @ change.T)


def by_strain(scene: pm.Scene, strain: float) -> float:
    """Return the elastic constant from energies of packings that were strained both ways and came to rest again."""
    shear = np.array([[0.0, 0.5], [0.5, 0.0]])
    energies = []
    for side in (1.0, 0.0, -1.0):
        moved = scene.replace(packing=strained(scene.packing, side * strain * shear))
        energies.append(pm.energy(moved.replace(packing=pm.quench(moved, force_tolerance=1e-13).packing)))
    return float((energies[0] - 2.0 * energies[1] + energies[2]) / strain**2 / scene.packing.box.volume)


def main(*, particles: int = 128, packing_fraction: float = 0.95, out: Path = Path(__file__).parent) -> None:
    """Find the constant all three ways; write table and figure."""
    scene = at_rest(particles, packing_fraction)
    true = sparse(scene, 0.0)
    methods = {"sparse solve": sparse, "pseudo-inverse": by_pseudo_inverse, "finite strain": by_strain}
    table = pm.work_precision(
        {name: partial(method, scene) for name, method in methods.items()},
        STRAINS,
        {CONSTANT: true},
        error=lambda value, reference: {CONSTANT: abs(value / reference[CONSTANT] - 1.0)},
        knob="strain",
        title=f"An elastic constant of {scene.packing.particles} discs, three ways",
        reference_is="the sparse solve",
        repeats=1,
    )
    (out / "moduli.csv").write_text(table.to_csv())
    (out / "moduli.md").write_text(f"# {table.title}\n\nReference: {table.reference_is}.\n\n{table.to_markdown()}")
    table.save_figure(out / "moduli.png")
    print(table.to_markdown())


if __name__ == "__main__":
    run(main)
