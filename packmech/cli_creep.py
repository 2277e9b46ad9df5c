"""What `packmech run` does with a scene that is strained once: at a constant rate, or under a constant stress."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from packmech.cli_shear import masses
from packmech.cli_show import working
from packmech.cli_watch import finish_run, live_watch, moments_wanted, telling
from packmech.interrupts import safe_interrupts
from packmech.measure import packing_fraction
from packmech.report_table import Row
from packmech.scene import CreepDrive, RampStrainDrive, Scene

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.rheology.keeper import Keeper
    from packmech.dynamics.rheology.travel import StrainRun


def single_scene(name: str, scene: Scene, outputs: Outputs, keeper: Keeper | None) -> int:
    """Strain the scene as its drive says; return the exit code."""
    from packmech.cli_run import interrupted

    drive = scene.drive
    assert isinstance(drive, RampStrainDrive | CreepDrive)
    try:
        about = f"{name}: {scene.packing.particles} particles"
        with safe_interrupts(), working(about) as tell, live_watch(scene, outputs) as live:
            run = _strain(
                scene,
                drive,
                dt=drive.dt,
                method=drive.method,
                axes=drive.axes,
                mass_n=masses(scene, drive.density),
                frames=moments_wanted(outputs),
                progress=telling(tell, live),
                checkpoint=keeper,
                check=False,
            )
    except KeyboardInterrupt as stop:
        return interrupted(scene, getattr(stop, "run", None), outputs)
    numbers = _numbers(drive, run)
    title = f"{about} {_done(drive)}"
    return finish_run(name, title, _rows(numbers), numbers, run, scene, outputs)


def _strain(scene: Scene, drive: RampStrainDrive | CreepDrive, **shared: Any) -> StrainRun:
    if isinstance(drive, RampStrainDrive):
        from packmech.dynamics.rheology.steady import ramp_strain

        return ramp_strain(
            scene, rate=drive.rate, strain=drive.strain, mode=drive.mode, samples=drive.samples, **shared
        )
    from packmech.dynamics.rheology.creep import creep

    return creep(
        scene,
        stress=drive.stress,
        duration=drive.duration,
        hold=drive.hold,
        inertia=drive.inertia,
        viscosity=drive.viscosity,
        **shared,
    )


def _done(drive: RampStrainDrive | CreepDrive) -> str:
    if isinstance(drive, CreepDrive):
        return f"under a shear stress of {drive.stress:g}"
    return f"under {drive.mode} strain at the rate {drive.rate:g}, to {drive.strain:g}"


def _numbers(drive: RampStrainDrive | CreepDrive, run: StrainRun) -> dict[str, Any]:
    """Return the results by name; stresses in the scene's own units of energy/length^d."""
    numbers: dict[str, Any] = {
        "particles": run.packing.particles,
        "dimension": run.packing.dimension,
        "outcome": run.outcome.name.lower(),
        "time_step": run.dt,
        "steps": run.steps,
        "seconds": run.seconds,
        "strain": float(run.strain_t[-1]),
        "stress": float(run.shear_stress_t[-1]),
        "largest_stress": float(np.abs(run.shear_stress_t).max()),
        "pressure": float(run.pressure_t[-1]),
        "packing_fraction": packing_fraction(run.packing),
        "contacts": int(run.contacts_t[-1]),
        "sliding_fraction": float(run.sliding_fraction_t[-1]),
    }
    if isinstance(drive, CreepDrive):
        held = run.time_t <= (drive.duration if drive.hold is None else drive.hold) * (1.0 + 1e-9)
        numbers["strain_under_stress"] = float(run.strain_t[held][-1])
        numbers["compliance"] = numbers["strain_under_stress"] / drive.stress
    return numbers


def _rows(numbers: dict[str, Any]) -> list[Row]:
    unit = f"energy / length^{numbers['dimension']} of the scene"
    rows: list[Row] = []
    if "compliance" in numbers:
        rows = [
            ("strain under stress", f"{numbers['strain_under_stress']:.6g}", "when the stress ends"),
            ("compliance", f"{numbers['compliance']:.6g}", "that strain over the stress"),
        ]
    return [
        *rows,
        ("strain at the end", f"{numbers['strain']:.6g}", ""),
        ("stress at the end", f"{numbers['stress']:.6g}", f"largest {numbers['largest_stress']:.6g}; {unit}"),
        ("pressure at the end", f"{numbers['pressure']:.6g}", unit),
        ("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted in full"),
        ("contacts", str(numbers["contacts"]), f"{numbers['sliding_fraction']:.1%} of them slide"),
    ]
