"""Scenes as TOML files: how one is read and written, those that ship, and the run that a scene's drive describes."""

from __future__ import annotations

import inspect
import os
from pathlib import Path
from typing import Any

from packmech.calls.status import Progress, check_progress
from packmech.check import FRAME_BYTES, brief, clear_errors, instance, integer
from packmech.scene import Scene, drive_code


def takes_checkpoint(scene: Scene) -> bool:
    """Whether what the scene's drive does can go on from a file."""
    return "checkpoint" in inspect.signature(drive_code(type(scene.drive)).run).parameters


@clear_errors
def run(
    scene: Scene,
    *,
    frames: int = 0,
    progress: Progress = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> Any:
    """Return the run that the scene's drive describes, as `packmech run` does; what it reached is not checked.

    Parameters
    ----------
    scene
        A scene with a drive.
    frames
        About how many packings to keep on the way, for pictures and recordings; what a drive cannot keep it passes to
        `progress`.
    progress
        Called now and then as progress(stage, figures).
    checkpoint
        A file to go on from, and to leave; for drives that step through time.

    Raises
    ------
    TypeError, ValueError
        If the scene has no drive, its drive takes no checkpoint, or an argument is of the wrong kind.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=1e-3)
    >>> pm.run(pm.Scene(crystal, (pm.Repulsion(),), pm.QuenchDrive())).outcome.name
    'CONVERGED'

    """
    instance("scene", scene, Scene)
    if scene.drive is None:
        raise ValueError("scene must have a drive to be run, got none")
    integer("frames", frames, at_least=0, bytes_each=FRAME_BYTES)
    check_progress(progress)
    if checkpoint is not None and not takes_checkpoint(scene):
        raise ValueError(f"checkpoint must be left out for a drive that keeps none, got {brief(checkpoint)}")
    wanted = {
        "frames": frames,
        "progress": progress,
        "checkpoint": None if checkpoint is None else Path(checkpoint),
    }
    code = drive_code(type(scene.drive)).run
    known = inspect.signature(code).parameters
    return code(scene.drive, scene, **{name: value for name, value in wanted.items() if name in known})
