"""Record quenches of ellipses and of rigid trimers, a quartic mode played back and forth, and jammed spheroids.

    python recordings/shapes.py FOLDER

Writes quench.rrd, bodies.rrd, quartic.rrd and spheroids.rrd; `recordings/picture.py` makes pictures of them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import packmech as pm

REPULSION = (pm.Repulsion(),)


def record(folder: Path) -> None:
    """Write the four recordings."""
    for name, shapes in (("quench", pm.Ellipses(1.7)), ("bodies", pm.Trimer(0.8, 1.6))):
        crowd = pm.Scene(pm.random_packing(40, dimension=2, packing_fraction=0.95, seed=1, shapes=shapes), REPULSION)
        run = pm.quench(crowd, force_tolerance=1e-8, trace_every=10, trace_positions=True)
        pm.record_run(run, folder / f"{name}.rrd", scene=crowd)
    loose = pm.Scene(
        pm.random_packing(40, dimension=3, packing_fraction=0.72, seed=1, shapes=pm.Ellipses(1.8)), REPULSION
    )
    pm.record_packing(loose.replace(packing=pm.jam(loose, pressure=1e-4).packing), folder / "spheroids.rrd")
    start = pm.Scene(
        pm.random_packing(24, dimension=2, packing_fraction=0.6, seed=4, shapes=pm.Ellipses(1.4)), REPULSION
    )
    scene = start.replace(packing=pm.jam(start, pressure=1e-9, strain="isotropic").packing)
    modes = pm.quartic_modes(scene)
    with pm.Recording(folder / "quartic.rrd", scene) as recording:
        for step in range(60):
            amplitude = 0.6 * float(np.sin(2.0 * np.pi * step / 60.0))
            moved = pm.displaced(scene.packing, amplitude * modes.displacement_mnd[0], amplitude * modes.turn_mnk[0])
            energy = pm.energy(scene.replace(packing=moved))
            recording.add(moved, figures={"amplitude": amplitude, "energy": energy})


if __name__ == "__main__":
    record(Path(sys.argv[1]))
