"""What `packmech run` does with a scene that is to be sheared steadily: print its flow curve."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from packmech.cli_shear import masses
from packmech.cli_show import console, working, write_json
from packmech.cli_watch import live_watch, moments_wanted, telling, write_film
from packmech.interrupts import safe_interrupts
from packmech.measure import packing_fraction
from packmech.report_table import rich_table, summary_markdown
from packmech.scene import Scene, SteadyShearDrive

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.rheology.keeper import Keeper
    from packmech.dynamics.rheology.steady import FlowCurve

HEADINGS = ("rate", "stress", "+-", "pressure", "+-", "stress/rate", "stress/pressure", "contacts", "sliding")
# columns of a flow curve, by their names in files
COLUMNS = {
    "rates": "rate_r",
    "stresses": "stress_r",
    "stress_errors": "stress_error_r",
    "pressures": "pressure_r",
    "pressure_errors": "pressure_error_r",
    "contacts_per_particle": "contacts_r",
    "sliding_fractions": "sliding_r",
}


def flow_scene(name: str, scene: Scene, outputs: Outputs, keeper: Keeper | None) -> int:
    """Shear the scene as its drive says; return the exit code."""
    from packmech.cli_run import INTERRUPTED, OK, write_result
    from packmech.dynamics.rheology.steady import steady_shear

    drive = scene.drive
    assert isinstance(drive, SteadyShearDrive)
    code, curve = OK, None
    try:
        about = f"{name}: {scene.packing.particles} particles"
        with safe_interrupts(), working(about) as tell, live_watch(scene, outputs) as live:
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
                frames=moments_wanted(outputs),
                checkpoint=keeper,
                progress=telling(tell, live),
            )
    except KeyboardInterrupt as stop:
        code, curve = INTERRUPTED, getattr(stop, "run", None)
        console(error=True).print("packmech: interrupted")
    if curve is None:
        return code
    title = f"{name}: {scene.packing.particles} particles under steady shear to a strain of {drive.strain:g}"
    table = _rows(curve)
    console().print(rich_table(title, HEADINGS, table, right=range(len(HEADINGS))))
    if outputs.out is not None:
        write_result(scene, curve.runs[-1].packing, outputs.out)
        console().print(f"packing: {outputs.out}")
    if outputs.json is not None:
        write_json(outputs.json, _numbers(scene, curve))
        console().print(f"numbers: {outputs.json}")
    for k, (run, row) in enumerate(zip(curve.runs, table, strict=True)):
        rate = float(curve.rate_r[k])
        write_film(
            run,
            scene,
            of_rate(outputs, rate, several=len(drive.rates) > 1),
            parameters={"scene": name, "drive": drive},
            results={name: float(getattr(curve, column)[k]) for name, column in COLUMNS.items()},
            summary=summary_markdown(title, [(head, row[c], "") for c, head in enumerate(HEADINGS)], list(run.stages)),
        )
    return code


def of_rate(outputs: Outputs, rate: float, *, several: bool) -> Outputs:
    """Return where recording and pictures of one of several rates go: the rate stands in their names."""
    if not several:
        return outputs
    told = f"rate-{rate:g}"
    record, folder = outputs.record, outputs.folder
    return replace(
        outputs,
        record=None if record is None else record.with_name(f"{record.stem}-{told}{record.suffix}"),
        folder=None if folder is None else folder / told,
    )


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
        **{name: getattr(curve, column).tolist() for name, column in COLUMNS.items()},
        "seconds": curve.seconds,
    }
