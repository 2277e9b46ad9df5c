"""Minimizers that `minima.py` compares, and where each takes a random start."""

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


def end(method: str, particles: int, jammed: bool, seed: int) -> dict[str, float]:
    """Return where a method takes a start: energy, network as a checksum, cost and, if asked for, the jamming point."""
    given = {"dimension": 2, "sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": 0.9, "seed": seed}
    scene = pm.Scene(pm.random_packing(particles, **given), (pm.Repulsion(law=pm.LinearSpring()),))
    chosen = {"method": METHODS[method], "step_limit": 20_000_000} if METHODS[method] else {}
    found = pm.quench(scene, force_tolerance=1e-10, check=False, **chosen)
    scene = scene.replace(packing=found.packing)
    backbone, index = pm.remove_rattlers(found.packing)
    contacts = pm.find_contacts(backbone)
    pairs = np.sort(np.stack([index[contacts.i_c], index[contacts.j_c]], axis=1), axis=1)
    network = zlib.crc32(np.ascontiguousarray(pairs[np.lexsort(pairs.T)], dtype="<i8").tobytes())
    deeper = pm.jam(scene, strain="isotropic", check=False) if jammed and found.ok else found
    onset = deeper.report.get("jamming_packing_fraction", np.nan) if deeper.ok else np.nan
    cost = {"evaluations": found.force_evaluations, "converged": int(found.ok)}
    return cost | {"energy": pm.energy(scene), "network": network, "onset": onset}
