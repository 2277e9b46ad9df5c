"""`packmech jam`: jam a scene, examine the packing, and leave a recording of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, cast

from cyclopts import Parameter

from packmech.check import BoxStrain
from packmech.cli.changes import UNCHANGED, Changes
from packmech.cli.output import SCENE, Files, Json, Load, Modes, Out, Seed, Switch, check_modes
from packmech.cli.run import Pictures, Wanted, carry_out
from packmech.files.modules import load_modules
from packmech.scene import JamDrive


def jam(
    scene: Annotated[str, Parameter(help=f"{SCENE}, or the file of a packing")] = "default",
    /,
    *,
    load: Load = (),
    changes: Changes = UNCHANGED,
    pressure: float | None = None,
    strain: str | None = None,
    record: Path = Path("jam.rrd"),
    no_record: Switch = False,
    out: Out = None,
    json: Json = None,
    modes: Modes = 10,
    seed: Seed = None,
) -> int:
    """Jam a scene, say what the packing is, and leave a recording of it.

    Parameters
    ----------
    pressure
        pressure to end at [energy_scale / diameter^d]; else the scene's
    strain
        "isotropic" keeps the shape of the box, "free" relaxes every strain; else the scene's
    record
        Rerun recording
    no_record
        write no recording

    """
    load_modules(load)
    files = Files(None if no_record else record, out, json)
    read = changes.scene(scene, seed=seed, jams=True)
    drive = read.drive if isinstance(read.drive, JamDrive) else JamDrive()
    drive = replace(
        drive,
        pressure=drive.pressure if pressure is None else pressure,
        strain=drive.strain if strain is None else cast(BoxStrain, strain),
    )
    return carry_out(Wanted(scene, read.replace(drive=drive), seed, files, Pictures(), check_modes(modes)))
