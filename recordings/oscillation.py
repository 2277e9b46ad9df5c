"""Shear the shipped gel of bonded fragments as a sine; record it, and plot stress against strain with G' and G''.

    python recordings/oscillation.py            # writes oscillation.rrd and oscillation-loop.png beside itself

The discs are brought to rest first, as the scene's drive says. Lengths are in um, stresses in Pa, times in s.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import packmech as pm

SCENE, FRAMES = "microgel", 90


def sheared() -> tuple[pm.Scene, pm.OscillatoryShear]:
    """Return the scene at rest, and its run."""
    scene = pm.read_scene(SCENE)
    drive = scene.drive
    assert isinstance(drive, pm.OscillatoryShearDrive)
    shared = {
        "amplitude": drive.amplitude,
        "relative_frequency": drive.relative_frequency,
        "axes": drive.axes,
        "dt": drive.dt,
    }
    if drive.largest_oscillation is not None:
        rest = pm.equilibrate(scene, largest_oscillation=drive.largest_oscillation, **shared)
        scene = scene.replace(packing=rest.packing)
    run = pm.oscillatory_shear(scene, periods=drive.periods, frames=FRAMES, **shared)
    return scene, run


def plot(run: pm.OscillatoryShear, target: Path) -> None:
    """Plot stress against strain, the first harmonic over it, and what part of each cycle slides."""
    assert run.moduli is not None
    moduli, phase = run.moduli, run.phase_t
    figure = Figure(figsize=(9.6, 4.8), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    loop, beside = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    counted = phase >= 2.0 * np.pi * run.skip_periods
    loop.plot(
        run.strain_t[~counted], run.shear_stress_t[~counted], color="0.75", lw=0.8, label="first period, left out"
    )
    loop.plot(run.strain_t[counted], run.shear_stress_t[counted], color="tab:blue", lw=0.9, label="measured")
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    fitted = run.amplitude * (moduli.storage * np.sin(turn) + moduli.loss * np.cos(turn))
    middle = float(run.shear_stress_t[counted].mean())
    loop.plot(run.amplitude * np.sin(turn), middle + fitted, color="tab:red", lw=1.6, label="first harmonic")
    loop.axhline(0.0, color="0.6", lw=0.6)
    loop.axvline(0.0, color="0.6", lw=0.6)
    storage, loss = f"{moduli.storage:.1f} ± {moduli.storage_error:.1f}", f"{moduli.loss:.1f} ± {moduli.loss_error:.1f}"
    loop.set_title(f"G' = {storage} Pa,  G'' = {loss} Pa", fontsize=11)
    loop.set(xlabel="strain", ylabel="shear stress [Pa]")
    loop.legend(fontsize=8, frameon=False)
    periods = phase / (2.0 * np.pi)
    beside.plot(periods, run.sliding_fraction_t, color="tab:cyan", lw=0.8)
    beside.set(xlabel="periods", ylabel="part of the contacts that slides", ylim=(0.0, None))
    bond = run.stress["bond"][:, 0, 1]
    other = beside.twinx()
    other.plot(periods, run.shear_stress_t, color="tab:blue", lw=0.8, label="stress")
    other.plot(periods, bond, color="tab:purple", lw=0.8, label="of that by bonds")
    other.set_ylabel("shear stress [Pa]")
    other.legend(fontsize=8, frameon=False, loc="upper right")
    beside.set_title(f"{run.packing.particles} discs, strain amplitude {run.amplitude:g}", fontsize=11)
    figure.savefig(target)


if __name__ == "__main__":
    here = Path(__file__).parent
    scene, run = sheared()
    plot(run, here / "oscillation-loop.png")
    assert run.moduli is not None
    results = {"storage_modulus": run.moduli.storage, "loss_modulus": run.moduli.loss}
    summary = "\n".join(
        [
            f"# {SCENE}: stress against strain",
            "| | value |",
            "|---|---|",
            f"| G' | {run.moduli.storage:.4g} ± {run.moduli.storage_error:.2g} Pa |",
            f"| G'' | {run.moduli.loss:.4g} ± {run.moduli.loss_error:.2g} Pa |",
            f"| strain amplitude | {run.amplitude:g} |",
            f"| frequency | {run.frequency:.6g} Hz |",
            f"| steps | {run.steps} |",
            "",
            "Contacts that slide are blue; bonds green in tension, violet in compression; fragments have hues.",
        ]
    )
    pm.record_run(
        run, here / "oscillation.rrd", scene=scene, frames=FRAMES, parameters={"scene": SCENE}, results=results,
        summary=summary,
    )  # fmt: skip
    print(f"G' {run.moduli.storage:.6g}, G'' {run.moduli.loss:.6g}, {run.steps} steps, {run.seconds:.1f} s")
