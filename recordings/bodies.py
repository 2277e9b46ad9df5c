"""Record rigid bodies with friction that are thrown into each other, in a plane and in space.

    python recordings/bodies.py FOLDER

Writes bodies-in-motion-2d.rrd and -3d.rrd; `recordings/picture.py` makes pictures of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import packmech as pm

REPULSION = (pm.Repulsion(),)


def record(folder: Path) -> None:
    """Write both recordings."""
    for d, packing_fraction in ((2, 0.85), (3, 0.6)):
        start = pm.random_packing(
            40, dimension=d, packing_fraction=packing_fraction, seed=1, shapes=pm.Trimer(angle=2.0)
        )
        packing = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6).packing
        rng = np.random.default_rng(0)
        velocity = 0.3 * rng.normal(size=packing.position_nd.shape)
        velocity -= packing.mass_n @ velocity / packing.mass_n.sum()
        spin = 0.3 * rng.normal(size=(40, 1 if d == 2 else 3))
        scene = pm.Scene(packing, (*REPULSION, pm.Friction(coefficient=0.3, stiffness=0.7, damping=0.0)))
        run = pm.simulate(
            scene, steps=200, dt=0.02, trace_every=20, trace_positions=True, velocity_nd=velocity, spin_nk=spin
        )
        pm.record_run(run, folder / f"bodies-in-motion-{d}d.rrd", scene=scene)


if __name__ == "__main__":
    record(Path(sys.argv[1]))
