"""Shear the shipped gel of bonded fragments as a sine; record it, and plot stress against strain with G' and G''.

    python recordings/oscillation.py            # writes oscillation.rrd and oscillation-loop.png beside itself

The discs are brought to rest first, as the scene's drive says. Lengths are in um, stresses in Pa, times in s.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import packmech as pm

SCENE, FRAMES, HERE = "microgel", 90, Path(__file__).parent


def sheared() -> tuple[pm.Scene, pm.OscillatoryShear]:
    """Return the scene at rest, and its run."""
    scene = pm.read_scene(SCENE)
    drive = scene.drive
    shared = {name: getattr(drive, name) for name in ("amplitude", "relative_frequency", "axes", "dt")}
    rest = pm.equilibrate(scene, largest_oscillation=drive.largest_oscillation, **shared)
    scene = scene.replace(packing=rest.packing)
    return scene, pm.oscillatory_shear(scene, periods=drive.periods, frames=FRAMES, **shared)


def plot(run: pm.OscillatoryShear, target: Path) -> None:
    """Plot stress against strain, the first harmonic over it, and what part of each cycle slides."""
    moduli, periods, strain, stress = run.moduli, run.phase_t / (2.0 * np.pi), run.strain_t, run.shear_stress_t
    figure, (loop, beside) = plt.subplots(1, 2, figsize=(9.6, 4.8), width_ratios=(1.25, 1.0), layout="constrained")
    counted = periods >= run.skip_periods
    loop.plot(strain[~counted], stress[~counted], color="0.75", lw=0.8, label="first period, left out")
    loop.plot(strain[counted], stress[counted], color="tab:blue", lw=0.9, label="measured")
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    fitted = run.amplitude * (moduli.storage * np.sin(turn) + moduli.loss * np.cos(turn)) + stress[counted].mean()
    loop.plot(run.amplitude * np.sin(turn), fitted, color="tab:red", lw=1.6, label="first harmonic")
    storage, loss = f"{moduli.storage:.1f} ± {moduli.storage_error:.1f}", f"{moduli.loss:.1f} ± {moduli.loss_error:.1f}"
    loop.set(xlabel="strain", ylabel="shear stress [Pa]", title=f"G' = {storage} Pa,  G'' = {loss} Pa")
    loop.legend(fontsize=8, frameon=False)
    beside.plot(periods, run.sliding_fraction_t, color="tab:cyan", lw=0.8)
    beside.set(xlabel="periods", ylabel="part of the contacts that slides", ylim=(0.0, None))
    other = beside.twinx()
    other.plot(periods, stress, color="tab:blue", lw=0.8, label="stress")
    other.plot(periods, run.stress["bond"][:, 0, 1], color="tab:purple", lw=0.8, label="of that by bonds")
    other.set_ylabel("shear stress [Pa]")
    other.legend(fontsize=8, frameon=False, loc="upper right")
    beside.set_title(f"{run.packing.particles} discs, strain amplitude {run.amplitude:g}", fontsize=11)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    scene, run = sheared()
    plot(run, HERE / "oscillation-loop.png")
    results = {"storage_modulus": run.moduli.storage, "loss_modulus": run.moduli.loss}
    summary = f"""# {SCENE}: stress against strain
| | value |
|---|---|
| G' | {run.moduli.storage:.4g} ± {run.moduli.storage_error:.2g} Pa |
| G'' | {run.moduli.loss:.4g} ± {run.moduli.loss_error:.2g} Pa |
| strain amplitude | {run.amplitude:g} |
| frequency | {run.frequency:.6g} Hz |
| steps | {run.steps} |

Contacts that slide are blue; bonds green in tension, violet in compression; fragments have hues."""
    kept = {"parameters": {"scene": SCENE}, "results": results, "summary": summary}
    pm.record_run(run, HERE / "oscillation.rrd", scene=scene, frames=FRAMES, **kept)
    print(f"G' {run.moduli.storage:.6g}, G'' {run.moduli.loss:.6g}, {run.steps} steps, {run.seconds:.1f} s")
