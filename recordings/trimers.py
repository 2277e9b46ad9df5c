"""Jam the shipped scenes of fifty trimers by shear stabilization at falling pressure, and record the way.

    python recordings/trimers.py            # writes trimers-2d.rrd and trimers-3d.rrd beside itself

Each packing is quenched in its box, then relaxed in positions and strains at one pressure after the other.
"""

from pathlib import Path
from typing import Any

import numpy as np

import packmech as pm

PRESSURES = 24
# frames, thinned evenly
LARGEST = 150


def stabilize(scene: pm.Scene) -> tuple[list[pm.Packing], pm.Run]:
    """Return the packings on the way to the pressure of the scene's drive, and the run that ends there."""
    drive, way = scene.drive, [scene.packing]

    def watch(stage: str, figures: dict[str, Any]) -> None:
        if "packing" in figures:
            way.append(figures["packing"])

    given = {"force_tolerance": drive.force_tolerance, "progress": watch}
    for pressure in np.geomspace(0.05, drive.pressure, PRESSURES).tolist():
        run = pm.shear_stabilize(scene, pressure=pressure, **given)
        scene = scene.replace(packing=run.packing)
    return [*way, run.packing], run


def record(name: str, target: Path) -> None:
    """Jam a scene at the pressure of its drive and write the recording."""
    scene = pm.read_scene(name)
    way, run = stabilize(scene)
    with pm.Recording(target, scene, parameters={"scene": name, "pressures": PRESSURES}) as recording:
        for step in np.unique(np.linspace(0, len(way) - 1, LARGEST).astype(int)).tolist():
            here = scene.replace(packing=way[step])
            figures = {"energy": pm.energy(here), "pressure": pm.pressure(here)}
            recording.add(way[step], step=step, figures=figures)
        verdict = pm.classify_jamming(scene.replace(packing=run.packing))
        results = {name: run.report[name] for name in ("contacts", "isostatic_contacts", "packing_fraction")}
        recording.close(results | {"strict": verdict.strict, "force_residual": run.residual})
    print(f"{target.name}: {results['contacts']} contacts, isostatic {results['isostatic_contacts']}, {verdict.strict}")


if __name__ == "__main__":
    here = Path(__file__).parent
    record("fifty-trimers-2d", here / "trimers-2d.rrd")
    record("fifty-trimers-3d", here / "trimers-3d.rrd")
