"""What `packmech run` does with a scene that is strained: keep what is finished in a file, and go on from it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from packmech.cli_show import console
from packmech.scene import CreepDrive, OscillatoryShearDrive, RampStrainDrive, Scene, SteadyShearDrive

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.rheology.keeper import Keeper

STRAINED = OscillatoryShearDrive | SteadyShearDrive | RampStrainDrive | CreepDrive


def strain_scene(name: str, scene: Scene, outputs: Outputs, *, seed: int | None) -> int:
    """Strain the scene as its drive says, from its checkpoint if there is one; return the exit code.

    Without `--checkpoint` the file is named after the scene and taken away at the end.
    """
    from packmech.cli_run import INTERRUPTED
    from packmech.dynamics.rheology.keeper import Keeper

    path = _own_path(name, seed) if outputs.checkpoint is None else outputs.checkpoint
    keeper = None if path is None else Keeper(path)
    if keeper is not None and keeper.marks:
        console(error=True).print(f"packmech: going on from {keeper.path}")
    code = _run(name, scene, outputs, keeper)
    if keeper is not None and keeper.path.exists():
        if code == INTERRUPTED:
            console(error=True).print(f"packmech: the same command goes on from {keeper.path}")
        elif outputs.checkpoint is None:
            keeper.path.unlink()
    return code


def _run(name: str, scene: Scene, outputs: Outputs, keeper: Keeper | None) -> int:
    if isinstance(scene.drive, OscillatoryShearDrive):
        from packmech.cli_shear import shear_scene

        return shear_scene(name, scene, outputs, keeper)
    if isinstance(scene.drive, SteadyShearDrive):
        from packmech.cli_flow import flow_scene

        return flow_scene(name, scene, outputs, keeper)
    from packmech.cli_creep import single_scene

    return single_scene(name, scene, outputs, keeper)


def _own_path(name: str, seed: int | None) -> Path | None:
    """Return the file of a scene in this folder, unless nothing can be written there."""
    if not os.access(".", os.W_OK):
        return None
    return Path(f"{Path(name).stem}{'' if seed is None else f'-seed-{seed}'}.checkpoint.npz")
