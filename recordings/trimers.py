"""Jam the shipped scenes of fifty trimers by shear stabilization at falling pressure, and record the way.

    python recordings/trimers.py            # writes trimers-2d.rrd and trimers-3d.rrd beside itself

Each packing is quenched in its box, then relaxed in positions and strains at one pressure after the other.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import packmech as pm
from packmech.view.report import examine
from packmech.view.trajectory import trace_of

PRESSURES = 24
# frames, thinned evenly
MOST = 150


def record(name: str, target: Path) -> None:
    """Jam a scene at the pressure of its drive and write the recording."""
    scene = pm.read_scene(name)
    drive = scene.drive
    assert isinstance(drive, pm.ShearStabilizeDrive) and drive.pressure is not None
    step_t, packing_t = [0], [scene.packing]

    def watch(stage: str, figures: dict[str, Any]) -> None:
        if "packing" in figures:
            # stages that do not count their steps show one packing after the other
            step_t.append(max(before + int(figures.get("steps", 0)), step_t[-1] + 1))
            packing_t.append(figures["packing"])

    tolerance = drive.force_tolerance
    before = 0
    run = pm.shear_stabilize(scene, pressure=0.05, force_tolerance=tolerance, progress=watch)
    for pressure in np.geomspace(0.05, drive.pressure, PRESSURES)[1:]:
        before = step_t[-1] + 1
        run = pm.shear_stabilize(
            scene.replace(packing=run.packing), pressure=float(pressure), force_tolerance=tolerance, progress=watch
        )
    steps = step_t[-1] + 1
    step_t.append(steps)
    packing_t.append(run.packing)
    if len(step_t) > MOST:
        keep = np.unique(np.linspace(0, len(step_t) - 1, MOST).astype(int))
        step_t, packing_t = [step_t[k] for k in keep], [packing_t[k] for k in keep]
    report = examine(scene.replace(packing=run.packing), strain="free", modes=10)
    whole = pm.Run(
        run.packing, run.outcome, run.residual, steps, run.force_evaluations, run.seconds,
        trace=trace_of(scene, step_t, packing_t),
    )  # fmt: skip
    kind = "discs" if scene.packing.dimension == 2 else "spheres"
    summary = report.summary().markdown(f"{name}: {scene.packing.particles} {kind}")
    pm.record_run(
        whole,
        target,
        scene=scene,
        modes=report.modes,
        parameters={"scene": name, "drive": drive},
        results=report.numbers,
        summary=summary,
    )
    numbers = report.numbers
    print(
        f"{target.name}: {numbers['contacts']} contacts, isostatic {numbers['isostatic_contacts']}, {numbers['strict']}"
    )


if __name__ == "__main__":
    here = Path(__file__).parent
    record("fifty-trimers-2d", here / "trimers-2d.rrd")
    record("fifty-trimers-3d", here / "trimers-3d.rrd")
