"""`packmech export`: write a scene as input of LAMMPS or JAX MD, with the energy that it must find."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import packmech as pm
from packmech.check import one_of
from packmech.cli.output import SCENE, Load, Seed, show
from packmech.files.modules import load_modules
from packmech.scenes.export import PROGRAMS
from packmech.scenes.scene_file import read_scene

_RUN = {"lammps": "lmp -in {script}", "jax-md": "python {script}"}


def export(
    scene: Annotated[str, Parameter(help=SCENE)],
    /,
    *,
    program: Annotated[str, Parameter(name="--as", help="lammps or jax-md")],
    out: Annotated[Path | None, Parameter(help="the folder (default: the scene's name and the program's)")] = None,
    load: Load = (),
    seed: Seed = None,
) -> None:
    """Write a scene, as it starts, as input of another program, with the energy and pressure that it must find.

    What the program has no place for is refused by name. To export a packing at rest, name its file in the scene:
    [packing] kind = "file".
    """
    load_modules(load)
    one_of("as", program, PROGRAMS)
    folder = Path(f"{Path(scene).stem}-{program}") if out is None else out
    made = pm.export_scene(read_scene(scene, seed=seed), folder, to=program)
    show(f"wrote {made.script} and {made.data}: the packing that the scene starts from, before its drive")
    show(f"to expect: energy {made.energy:.16g}, pressure {made.pressure:.16g}")
    show(f"run it in its folder: {_RUN[made.program].format(script=made.script.name)}")
