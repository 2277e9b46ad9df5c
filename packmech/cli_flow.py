"""What `packmech run` does with a scene that is to be sheared steadily: print its flow curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from packmech.cli_show import console, working, write_json
from packmech.interrupts import safe_interrupts
from packmech.measure import packing_fraction
from packmech.report_table import rich_table
from packmech.scene import Scene, SteadyShearDrive

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.rheology.steady import FlowCurve

HEADINGS = ("rate", "stress", "+-", "pressure", "+-", "stress/rate", "stress/pressure", "contacts", "sliding")


def flow_scene(name: str, scene: Scene, outputs: Outputs) -> int:
    """Shear the scene as its drive says; return the exit code."""
    from packmech.cli_run import INTERRUPTED, OK, write_result
    from packmech.cli_shear import masses
    from packmech.dynamics.rheology.steady import steady_shear

    drive = scene.drive
    assert isinstance(drive, SteadyShearDrive)
    if outputs.record is not None:
        raise ValueError(f"record must be left out for a scene that is sheared steadily, got {str(outputs.record)!r}")
    code, curve = OK, None
    try:
        with safe_interrupts(), working(f"{name}: {scene.packing.particles} particles") as tell:
            curve = steady_shear(
                scene,
                rates=drive.rates,
                strain=drive.strain,
                skip_strain=drive.skip_strain,
                blocks=drive.blocks,
                samples=drive.samples,
                axes=drive.axes,
                dt=drive.dt,
                method=drive.method,
                mass_n=masses(scene, drive.density),
                progress=_watch(tell),
            )
    except KeyboardInterrupt as stop:
        code, curve = INTERRUPTED, getattr(stop, "run", None)
        console(error=True).print("packmech: interrupted")
    if curve is None:
        return code
    title = f"{name}: {scene.packing.particles} particles under steady shear to a strain of {drive.strain:g}"
    console().print(rich_table(title, HEADINGS, _rows(curve), right=range(len(HEADINGS))))
    if outputs.out is not None:
        write_result(scene, curve.runs[-1].packing, outputs.out)
        console().print(f"packing: {outputs.out}")
    if outputs.json is not None:
        write_json(outputs.json, _numbers(scene, curve))
        console().print(f"numbers: {outputs.json}")
    return code


def _watch(tell: Callable[[str], None]) -> Callable[[str, dict[str, Any]], None]:
    def told(stage: str, figures: dict[str, Any]) -> None:
        words = [f"{name} {value:.3g}" for name, value in figures.items() if isinstance(value, int | float)]
        tell(", ".join([stage, *words]))

    return told


def _rows(curve: FlowCurve) -> list[tuple[str, ...]]:
    return [
        (
            f"{curve.rate_r[k]:.4g}",
            f"{curve.stress_r[k]:.5g}",
            f"{curve.stress_error_r[k]:.2g}",
            f"{curve.pressure_r[k]:.5g}",
            f"{curve.pressure_error_r[k]:.2g}",
            f"{curve.viscosity_r[k]:.5g}",
            f"{curve.stress_ratio_r[k]:.4f}",
            f"{curve.contacts_r[k]:.3f}",
            f"{curve.sliding_r[k]:.1%}",
        )
        for k in range(len(curve.rate_r))
    ]


def _numbers(scene: Scene, curve: FlowCurve) -> dict[str, Any]:
    """Return the flow curve by name; stresses in the scene's own units of energy/length^d."""
    return {
        "particles": scene.packing.particles,
        "dimension": scene.packing.dimension,
        "packing_fraction": packing_fraction(scene.packing),
        "rates": curve.rate_r.tolist(),
        "stresses": curve.stress_r.tolist(),
        "stress_errors": curve.stress_error_r.tolist(),
        "pressures": curve.pressure_r.tolist(),
        "pressure_errors": curve.pressure_error_r.tolist(),
        "contacts_per_particle": curve.contacts_r.tolist(),
        "sliding_fractions": curve.sliding_r.tolist(),
        "seconds": curve.seconds,
    }
