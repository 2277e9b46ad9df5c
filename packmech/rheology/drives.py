"""What the drives that follow Newton's equations do: simulate, and strain in one of five ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from packmech.calls.status import Progress
from packmech.check import check_steps
from packmech.dynamics.book import refuse_unknown
from packmech.dynamics.integrators import INTEGRATORS, VelocityVerlet, choose_time_step
from packmech.dynamics.simulate import simulate, simulate_from
from packmech.dynamics.simulation import Simulation
from packmech.effects import Bonds
from packmech.loop.checkpoint import RunsFile
from packmech.rheology.arguments import runs_file
from packmech.rheology.at_pressure import PressureShear, shear_at_pressure
from packmech.rheology.equilibrate import equilibrate
from packmech.rheology.oscillatory import OscillatoryShear, oscillatory_shear
from packmech.rheology.steady import FlowCurve, creep, ramp_strain, steady_shear
from packmech.rheology.strain_run import StrainRun
from packmech.rheology.walls import rough_plates
from packmech.scene import DriveCode, OscillatoryShearDrive, Scene, ShearAtPressureDrive, SimulateDrive

# arguments of oscillatory shear that the periods at rest before it take, too
_AT_REST = (
    *("amplitude", "frequency", "relative_frequency", "axes", "dt", "method", "progress", "checkpoint"),
    "check",
)
# rows of a trace that is kept of a simulation
_ROWS = 200


def follow(
    drive: SimulateDrive,
    scene: Scene,
    *,
    frames: int = 0,
    progress: Progress = None,
    checkpoint: Path | None = None,
    **changes: Any,
) -> Simulation:
    """Return the simulation that a drive describes.

    Parameters
    ----------
    drive, scene
        The drive, and the scene.
    frames
        Positions are kept about so many times; 0: only observables are.
    progress
        As of `pm.simulate`.
    checkpoint
        A file to go on from, and to leave.
    changes
        Other arguments of `pm.simulate` than the drive's.

    """
    n = scene.packing.particles
    held = None
    if drive.held:
        if max(drive.held) >= n:
            raise ValueError(f"drive.held must be numbers of {n} particles, got {max(drive.held)}")
        held = np.isin(np.arange(n), drive.held)
    steps = drive.steps
    if steps is None:
        fraction = (VelocityVerlet() if drive.method is None else drive.method).fraction
        longest = choose_time_step(scene, fraction) if drive.dt is None else drive.dt
        assert drive.duration is not None
        check_steps("drive.duration", drive.duration, longest)
        steps = int(np.ceil(drive.duration / longest))
    arguments: dict[str, Any] = {
        **({"steps": drive.steps} if drive.duration is None else {"duration": drive.duration}),
        "dt": drive.dt,
        "method": drive.method,
        "velocity_nd": None if drive.velocities is None else np.array(drive.velocities),
        "spin_nk": None if drive.spins is None else np.array(drive.spins),
        "held_n": held,
        "trace_every": max(1, steps // (frames or _ROWS)) if drive.trace_every is None else drive.trace_every,
        "trace_positions": frames > 0,
        "ledger": drive.ledger,
        "progress": progress,
        "check": False,
    }
    arguments |= changes
    return simulate(scene, **arguments) if checkpoint is None else simulate_from(checkpoint, scene, **arguments)


def _arguments(
    drive: Any, scene: Scene, frames: int, progress: Progress, checkpoint: Path | RunsFile | None
) -> dict[str, Any]:
    """Return what a drive says to the call that it names: its fields."""
    named = {field.name: getattr(drive, field.name) for field in fields(drive)}
    return {**named, "frames": frames, "progress": progress, "checkpoint": checkpoint}


def _oscillatory_shear(
    drive: OscillatoryShearDrive, scene: Scene, *, frames: int, progress: Progress, checkpoint: Path | None
) -> OscillatoryShear:
    """Bring the scene to rest, then shear it; the run holds the steps of both, and what is wrong with the first.

    Bonds with limits do not break while the scene comes to rest.
    """
    # one file keeps the periods at rest and the shear, one after the other
    named = _arguments(drive, scene, frames, progress, runs_file(checkpoint)) | {"check": False}
    largest, plates, expected = (named.pop(one) for one in ("largest_oscillation", "plates", "expected_stress"))
    rest = None
    if drive.ledger:
        # what no ledger knows is refused before the scene comes to rest, not after
        refuse_unknown("scene.packing", scene)
    if largest is not None:
        asked = {"largest_oscillation": largest, "expected_stress": expected}
        rest = equilibrate(_unbreakable(scene), **asked, **{name: named[name] for name in _AT_REST})
        scene = scene.replace(packing=rest.packing)
    held = None if plates is None else rough_plates(scene.packing, layer=plates, axis=drive.axes[1])
    try:
        run = oscillatory_shear(scene, held_n=held, **named)
    except KeyboardInterrupt as stop:
        stop.run = getattr(stop, "run", rest)  # type: ignore[attr-defined]
        raise
    if rest is None:
        return run
    return replace(
        run,
        outcome=run.outcome if rest.ok else rest.outcome,
        residual=run.residual if rest.ok else rest.residual,
        seconds=run.seconds + rest.seconds,
        stages=(*rest.stages, *run.stages),
        report={
            **run.report,
            "residual_oscillation": rest.oscillation,
            "expected_stress": rest.expected_stress,
            "oscillation_ratio": rest.ratio,
        },
    )


def _unbreakable(scene: Scene) -> Scene:
    return scene.replace(effects=tuple(one.unbreakable() if isinstance(one, Bonds) else one for one in scene.effects))


def _strained(call: Callable[..., Any]) -> Callable[..., Any]:
    """Return what follows a drive by the call that it names."""

    def follow_it(
        drive: Any, scene: Scene, *, frames: int, progress: Progress, checkpoint: Path | None
    ) -> FlowCurve | StrainRun:
        made: FlowCurve | StrainRun = call(scene, **_arguments(drive, scene, frames, progress, checkpoint), check=False)
        return made

    return follow_it


def _shear_at_pressure(drive: ShearAtPressureDrive, scene: Scene, *, progress: Progress) -> PressureShear:
    named = {field.name: getattr(drive, field.name) for field in fields(drive)}
    return shear_at_pressure(scene, **named, progress=progress, check=False)


_METHODS = {"method": lambda: INTEGRATORS}
SIMULATE = DriveCode(follow, _METHODS)
OSCILLATORY_SHEAR = DriveCode(_oscillatory_shear, _METHODS)
STEADY_SHEAR = DriveCode(_strained(steady_shear), _METHODS)
SHEAR_AT_PRESSURE = DriveCode(_shear_at_pressure)
RAMP_STRAIN = DriveCode(_strained(ramp_strain), _METHODS)
CREEP = DriveCode(_strained(creep), _METHODS)
