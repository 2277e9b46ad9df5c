"""Minimizers that `minima.py` compares, where each takes a random start, and how minima are told from each other."""

import zlib

import numpy as np

import packmech as pm

REFERENCE = "steepest descent, 1e-9"
METHODS = {REFERENCE: pm.SteepestDescent(1e-9), "steepest descent, 1e-6": pm.SteepestDescent(1e-6)}
METHODS |= {
    "default route": None,
    "FIRE": pm.Fire(),
    "FIRE 2.0": pm.Fire2(),
    "conjugate gradient": pm.ConjugateGradient(),
}
METHODS |= {"L-BFGS": pm.LBFGS(), "gradient descent, step 0.8": pm.GradientDescent()}
DAMPINGS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
METHODS |= {f"dashpots, b = {one:g}": pm.DampedDynamics(damping=one) for one in DAMPINGS}


def minimum(scene: pm.Scene) -> dict[str, float]:
    """Return by what a minimum is told from others: its energy, and its network without rattlers as a checksum."""
    backbone, index = pm.remove_rattlers(scene.packing)
    contacts = pm.find_contacts(backbone)
    pairs = np.sort(np.stack([index[contacts.i_c], index[contacts.j_c]], axis=1), axis=1)
    network = zlib.crc32(np.ascontiguousarray(pairs[np.lexsort(pairs.T)], dtype="<i8").tobytes())
    return {"energy": pm.energy(scene), "network": network}


def start(particles: int, seed: int) -> pm.Scene:
    """Return the random start of a seed."""
    given = {"dimension": 2, "sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": 0.9, "seed": seed}
    return pm.Scene(pm.random_packing(particles, **given), (pm.Repulsion(law=pm.LinearSpring()),))


def end(method: str, particles: int, jammed: bool, seed: int) -> dict[str, float]:
    """Return where a method takes a start: energy, network as a checksum, cost and, if asked for, the jamming point."""
    scene = start(particles, seed)
    chosen = {"method": METHODS[method], "step_limit": 20_000_000} if METHODS[method] else {}
    found = pm.quench(scene, force_tolerance=1e-10, check=False, **chosen)
    scene = scene.replace(packing=found.packing)
    deeper = pm.jam(scene, strain="isotropic", check=False) if jammed and found.ok else found
    onset = deeper.report.get("jamming_packing_fraction", np.nan) if deeper.ok else np.nan
    cost = {"evaluations": found.force_evaluations, "converged": int(found.ok)}
    return cost | minimum(scene) | {"onset": onset}
