"""How well links must be projected back to their lengths: tolerance against lengths, energy and balance of a descent.

    python recordings/accuracy/reaffixing.py

Rigid trimers at rest are shoved a little and descend again: a heavy ball rolls down the constrained force, and links go
back to their lengths after each step, to the tolerance. What is left at the end is compared with the rest it came from.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm


@cache
def rest(dimension: int) -> pm.Scene:
    """Return rigid trimers at rest in a fixed box."""
    given = {"packing_fraction": {2: 0.95, 3: 0.75}[dimension], "seed": 1}
    packing = pm.cluster_packing(20, pm.Trimer(angle=(1.1, 2.6)), dimension=dimension, **given)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-13).packing)


def shoved(scene: pm.Scene, largest: float = 0.01) -> pm.Scene:
    """Return the scene with every particle shoved [diameter], links not at their lengths."""
    place_nd = scene.packing.position_nd
    shove_nd = np.random.default_rng(1).uniform(-largest, largest, place_nd.shape)
    return scene.replace(packing=scene.packing.replace(position_nd=place_nd + shove_nd))


def trial(dimension: int, steps: int, tolerance: float) -> pm.Answer:
    """Return what a descent leaves of link errors, energy and force when links are re-affixed to a tolerance."""
    aim, scene, velocity, backs = pm.energy(rest(dimension)), shoved(rest(dimension)), 0.0, []
    for _ in range(steps):
        backs.append(pm.reaffix_links(scene.packing, tolerance=tolerance, check=False))
        scene = scene.replace(packing=backs[-1].packing)
        velocity = 0.85 * velocity + 0.2 * pm.project_force(scene.packing, pm.forces(scene)).force_nd
        scene = scene.replace(packing=scene.packing.replace(position_nd=scene.packing.position_nd + velocity))
    scene = scene.replace(packing=pm.reaffix_links(scene.packing, tolerance=tolerance, check=False).packing)
    contacts = pm.find_contacts(scene.packing)
    mean = float((contacts.overlap_c / contacts.contact_distance_c).mean())
    left = np.linalg.norm(pm.project_force(scene.packing, pm.forces(scene)).force_nd, axis=1).max()
    # Newton's method often ends far below the tolerance; what counts is what it may leave
    value = {
        "error of links": max(one.residual for one in backs),
        "energy (relative)": abs(pm.energy(scene) / aim - 1.0),
    }
    work = {"iterations a step": sum(one.iterations for one in backs) / steps}
    work |= {"seconds of re-affixing": sum(one.seconds for one in backs)}
    work |= {"steps that missed": float(sum(not one.ok for one in backs))}
    return pm.Answer(value | {"residual": float(left) / mean}, work=work)


def main(*, steps: int = 600, decades: int = 15, out: Path = Path(__file__).parent) -> None:
    """Descend at all tolerances in both dimensions; write table and figure."""
    table = pm.work_precision(
        {f"rigid trimers, {dimension}D": partial(trial, dimension, steps) for dimension in (2, 3)},
        [10.0**-k for k in range(2, decades + 1)],
        dict.fromkeys(("error of links", "energy (relative)", "residual"), 0.0),
        knob="tolerance of re-affixing",
        title=f"Re-affixing of links: 20 rigid trimers descending {steps} steps to rest",
        reference_is="the rest from which they were shoved, by Newton's method to the rounding floor",
        repeats=1,
    )
    (out / "reaffixing.csv").write_text(table.to_csv())
    (out / "reaffixing.md").write_text(table.to_markdown())
    table.save_figure(out / "reaffixing.png")


if __name__ == "__main__":
    run(main)
