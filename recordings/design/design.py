"""Design a network that grows wide when pulled, sizes that jam denser, and masses that leave a gap of frequencies.

    python recordings/design/design.py FOLDER

Writes design.png, the figures of all packings on the way, for three seeds; prints what was reached.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import packmech as pm

REPULSION, MODE, KEEP = (pm.Repulsion(law=pm.Harmonic()),), 20, "mean and deviation"


def dense(seed: int, particles: int = 64) -> pm.Scene:
    """Return a packing at rest well above jamming."""
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.96, seed=seed)
    scene = pm.Scene(start.replace(mass_n=np.ones(particles)), REPULSION)
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-12).packing)


def network(seed: int) -> pm.Scene:
    """Return slack springs where discs touch, and points in their place."""
    packing = dense(seed).packing
    bonds = pm.bond_contacts(packing, rest="distance", tangential_stiffness=0.0)
    return pm.Scene(packing.replace(radius_n=0.1 * packing.radius_n), (*REPULSION, bonds))


def gap(scene: pm.Scene) -> tuple[float, np.ndarray]:
    """Return the gap between two neighboring frequencies, and its derivatives by the masses."""
    low, high = (pm.sensitivity(scene, "frequency", "mass", mode=m) for m in (MODE - 1, MODE))
    return high.value - low.value, high.gradient - low.gradient


def design(folder: Path) -> None:
    """Write the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 3, figsize=(12.0, 3.6), layout="constrained")
    for seed in (1, 2, 3):
        loose = pm.random_packing(32, dimension=2, packing_fraction=0.8, seed=seed)
        hard = pm.Scene(loose.replace(radius_n=np.random.default_rng(seed).uniform(0.4, 0.7, 32)), REPULSION)
        runs = (
            pm.design(network(seed), "poisson_ratio", "bonds", at_most=-0.5),
            pm.design(hard, "packing_fraction", "radius", at_least=0.88, bounds=(0.35, 0.8), keep=KEEP),
            pm.design(dense(seed, 24), gap, "mass", at_least=0.2, bounds=(0.25, 4.0)),
        )
        for axis, run, name in zip(axes, runs, ("Poisson ratio", "phi_J", "gap of frequencies"), strict=True):
            print(run)
            axis.plot(run.value_t, ".-")
            axis.axhline(run.goal, color="black", linestyle=":")
            axis.set(xlabel="packings made", ylabel=name)
    figure.savefig(folder / "design.png", dpi=120)


if __name__ == "__main__":
    design(Path(sys.argv[1]))
