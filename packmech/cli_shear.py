"""What `packmech run` does with a scene that is to be sheared as a sine: bring it to rest, shear it, print moduli."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from packmech.cli_show import working
from packmech.cli_watch import Watch, finish_run, live_watch, moments_wanted, telling
from packmech.effects import Bonds
from packmech.generate import fragment_numbers
from packmech.interrupts import safe_interrupts
from packmech.measure import packing_fraction
from packmech.report_table import Row
from packmech.scene import OscillatoryShearDrive, Scene

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.preparation import Equilibration
    from packmech.dynamics.rheology.keeper import Keeper
    from packmech.dynamics.rheology.oscillatory import OscillatoryShear


def shear_scene(name: str, scene: Scene, outputs: Outputs, keeper: Keeper | None) -> int:
    """Shear the scene as its drive says; return the exit code."""
    from packmech.cli_run import interrupted

    drive = scene.drive
    assert isinstance(drive, OscillatoryShearDrive)
    rest: Equilibration | None = None
    try:
        about = f"{name}: {scene.packing.particles} particles"
        with safe_interrupts(), working(about) as tell, live_watch(scene, outputs) as live:
            shared = _shared(scene, drive, telling(tell, live), keeper)
            rest = _rest(scene, drive, shared)
            start = scene if rest is None else scene.replace(packing=rest.packing)
            run = _shear(start, drive, shared, frames=moments_wanted(outputs))
    except KeyboardInterrupt as stop:
        return interrupted(scene, getattr(stop, "run", rest), outputs)
    numbers = _numbers(scene, rest, run)
    title = f"{name}: {scene.packing.particles} particles, strain {drive.amplitude:g} sin(2 pi {run.frequency:.6g} t)"
    return finish_run(name, title, _rows(numbers), numbers, run, scene, outputs, start=start, before=rest)


def masses(scene: Scene, density: float | None) -> Any:
    """Return the (N,) masses of particles of one density; None where none is given."""
    if density is None:
        return None
    ball = math.pi if scene.packing.dimension == 2 else 4.0 * math.pi / 3.0
    return density * ball * scene.packing.radius_n**scene.packing.dimension


def _shared(scene: Scene, drive: OscillatoryShearDrive, watch: Watch, keeper: Keeper | None) -> dict[str, Any]:
    return {
        "amplitude": drive.amplitude,
        "frequency": drive.frequency,
        "relative_frequency": drive.relative_frequency,
        "axes": drive.axes,
        "dt": drive.dt,
        "method": drive.method,
        "mass_n": masses(scene, drive.density),
        "progress": watch,
        "checkpoint": keeper,
        "check": False,
    }


def _rest(scene: Scene, drive: OscillatoryShearDrive, shared: dict[str, Any]) -> Equilibration | None:
    from packmech.dynamics.preparation import equilibrate

    if drive.largest_oscillation is None:
        return None
    return equilibrate(scene, largest_oscillation=drive.largest_oscillation, **shared)


def _shear(scene: Scene, drive: OscillatoryShearDrive, shared: dict[str, Any], *, frames: int) -> OscillatoryShear:
    from packmech.dynamics.rheology.oscillatory import oscillatory_shear

    held = None
    if drive.plates is not None:
        from packmech.dynamics.rheology.plates import rough_plates

        held = rough_plates(scene.packing, layer=drive.plates, axis=drive.axes[1])
    return oscillatory_shear(
        scene,
        held_n=held,
        carried=drive.carried,
        pre_periods=drive.pre_periods,
        periods=drive.periods,
        post_periods=drive.post_periods,
        skip_periods=drive.skip_periods,
        samples_per_period=drive.samples_per_period,
        frames=frames,
        **shared,
    )


def _numbers(scene: Scene, rest: Equilibration | None, run: OscillatoryShear) -> dict[str, Any]:
    """Return the results by name; stresses and moduli in the scene's own units of energy/length^d."""
    numbers: dict[str, Any] = {
        "particles": scene.packing.particles,
        "dimension": scene.packing.dimension,
        "packing_fraction": packing_fraction(scene.packing),
        "outcome": run.outcome.name.lower(),
        "strain_amplitude": run.amplitude,
        "frequency": run.frequency,
        "time_step": run.dt,
        "steps": run.steps,
        "seconds": run.seconds + (0.0 if rest is None else rest.seconds),
        "mean_pressure": float(np.mean(run.pressure_t)),
        "end_stress": run.stress["overall"][-1].tolist(),
        "mean_contacts": float(np.mean(run.contacts_t)),
        "mean_sliding_fraction": float(np.mean(run.sliding_fraction_t)),
    }
    bonds = [one for one in scene.effects if isinstance(one, Bonds)]
    if bonds:
        numbers["bonds"] = sum(map(len, bonds))
        numbers["fragments"] = int(fragment_numbers(bonds[0], scene.packing.particles).max()) + 1
    if rest is not None:
        numbers |= {
            "residual_oscillation": rest.oscillation,
            "expected_stress": rest.expected_stress,
            "oscillation_ratio": rest.ratio,
        }
    found = run.moduli
    if found is not None:
        numbers |= {
            "in_phase_stress": found.in_phase,
            "out_of_phase_stress": found.out_of_phase,
            "stress": found.stress,
            "storage_modulus": found.storage,
            "loss_modulus": found.loss,
            "storage_error": found.storage_error,
            "loss_error": found.loss_error,
            "storage_fit_error": found.storage_fit_error,
            "loss_fit_error": found.loss_fit_error,
        }
    if run.held_n is not None:
        numbers["held"] = int(run.held_n.sum())
    if run.walls is not None:
        walls = run.walls
        numbers["walls"] = {
            "separation": walls.separation,
            "difference": walls.difference,
            "agree": walls.agree,
            **{
                f"{name}_{part}": getattr(found, part)
                for name, found in (("force", walls.force), ("volume", walls.volume))
                for part in ("storage", "loss", "storage_error", "loss_error")
            },
        }
    return numbers


def _rows(numbers: Mapping[str, Any]) -> list[Row]:
    unit = f"energy / length^{numbers['dimension']} of the scene"
    rows: list[Row] = []
    if "storage_modulus" in numbers:
        rows = [
            ("in-phase stress", f"{numbers['in_phase_stress']:.6g}", f"amplitude; {unit}"),
            ("out-of-phase stress", f"{numbers['out_of_phase_stress']:.6g}", f"amplitude; {unit}"),
            ("stress", f"{numbers['stress']:.6g}", "amplitude of both together"),
        ]
        for name, key in (("G'", "storage"), ("G''", "loss")):
            between, fit = numbers[f"{key}_error"], numbers[f"{key}_fit_error"]
            # one period that counts says nothing of how periods differ
            error = f"+- {between:.2g} between periods" if math.isfinite(between) else f"+- {fit:.2g} of the fit"
            rows.append((name, f"{numbers[f'{key}_modulus']:.6g}", f"{error}; {unit}"))
    else:
        lines = ["  ".join(f"{entry + 0.0:.6g}" for entry in row) for row in numbers["end_stress"]]
        rows = [("stress at the end", ";  ".join(lines), f"row by row, tension positive; {unit}")]
    if "walls" in numbers:
        rows += _wall_rows(numbers["walls"], numbers.get("held", 0), unit)
    if "oscillation_ratio" in numbers:
        note = f"stress before the shear over the amplitude expected, {numbers['expected_stress']:.4g}"
        rows.append(("residual oscillation", f"{numbers['oscillation_ratio']:.2g}", note))
    rows += [
        ("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted in full"),
        ("mean pressure", f"{numbers['mean_pressure']:.6g}", unit),
        ("contacts", f"{numbers['mean_contacts']:.1f}", f"mean; {numbers['mean_sliding_fraction']:.1%} of them slide"),
    ]
    if "bonds" in numbers:
        rows.append(("bonds", str(numbers["bonds"]), f"in {numbers['fragments']} fragments"))
    return rows


def _wall_rows(walls: Mapping[str, Any], held: int, unit: str) -> list[Row]:
    apart = f"{held} particles held, " if held else ""
    where = {"force": f"force on the walls over their area; {unit}", "volume": "stress of what is between them"}
    rows = [
        (name, f"{walls[f'{kind}_storage']:.6g}  {walls[f'{kind}_loss']:.6g}", f"G'  G'', {where[kind]}")
        for name, kind in (("at the walls", "force"), ("between them", "volume"))
    ]
    if walls["agree"]:
        note = "within the 30 % that are let pass"
    else:
        note = "MORE THAN 30 %: the sample's inertia counts, take a lower frequency"
    return [*rows, ("walls differ", f"{walls['difference']:.1%}", f"{note}; {apart}{walls['separation']:.6g} apart")]
