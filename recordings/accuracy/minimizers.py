"""Minimizer and force tolerance against the errors of a jamming point, its contacts and its shear modulus.

    python recordings/accuracy/minimizers.py

Every trial does the same decompression: a packing a little above jamming is strained off its minimum, quenched, and
brought down to a 64th of its pressure in three steps, each quenched to the same tolerance. The line through the last
two pressures gives the packing fraction at which the pressure vanishes.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

SHEAR = "shear modulus (relative)"
METHODS = {"FIRE": pm.Fire(), "FIRE 2.0": pm.Fire2(), "conjugate gradient": pm.ConjugateGradient()}
METHODS |= {"L-BFGS": pm.LBFGS(), "damped dynamics": pm.DampedDynamics(), "gradient descent": pm.GradientDescent()}


def above_jamming(particles: int) -> pm.Scene:
    """Return the common start: a jammed packing compressed by 2e-4 and sheared by 2e-5, near one minimum."""
    scene = pm.Scene(pm.random_packing(particles, dimension=2, packing_fraction=0.87, seed=1), (pm.Repulsion(),))
    jammed = pm.jam(scene, pressure=1e-8, strain="isotropic").packing
    change = (1.0 + 2e-4 / pm.packing_fraction(jammed)) ** -0.5 * np.array([[1.0, 2e-5], [0.0, 1.0]])
    box = pm.Box(change @ jammed.box.lattice_dd)
    return scene.replace(packing=jammed.replace(position_nd=jammed.position_nd @ change.T, box=box))


def decompress(
    scene: pm.Scene, relax: Callable[[pm.Scene], pm.Run], slope: float
) -> tuple[float, pm.Scene, list[pm.Run]]:
    """Return the packing fraction at which the pressure vanishes, the last scene above it, and the runs.

    `slope`, the first guess at dP/dphi, decides only how far the first step goes.
    """
    runs, fraction, pressure, slope = [relax(scene)], [], [], slope * scene.pressure_unit
    for _ in range(4):
        scene = scene.replace(packing=runs[-1].packing)
        fraction.append(pm.packing_fraction(scene.packing))
        pressure.append(pm.pressure(scene))
        slope = (pressure[-1] - pressure[-2]) / (fraction[-1] - fraction[-2]) if len(pressure) > 1 else slope
        if not (slope > 0.0 and pressure[-1] > 0.0):
            raise FloatingPointError(f"pressure does not fall with the packing fraction: {pressure}")
        if len(runs) < 4:
            lower = pm.at_packing_fraction(scene.packing, fraction[-1] - 0.75 * pressure[-1] / slope)
            runs.append(relax(scene.replace(packing=lower)))
    return fraction[-1] - pressure[-1] / slope, scene, runs


def trial(start: pm.Scene, method: object, tolerance: float) -> pm.Answer:
    """Return jamming point, contacts and shear modulus by one method, or the default route, at one tolerance."""
    chosen = {"method": method, "step_limit": 200_000} if method else {}
    relax = partial(pm.quench, force_tolerance=tolerance, check=False, **chosen)
    onset, scene, runs = decompress(start, relax, 0.4)
    c = pm.elastic_moduli(scene).cauchy / scene.pressure_unit
    # mean over the directions of shear; negative where the packing is unstable to shear in its box
    modulus = float(c[0, 0] + c[1, 1] - c[0, 1] - c[1, 0] + 2.0 * c[2, 2]) / 8.0
    contacts, evaluations = len(pm.find_contacts(scene.packing)), sum(one.force_evaluations for one in runs)
    value = {"packing fraction at jamming": onset, "contacts": float(contacts), SHEAR: modulus}
    return pm.Answer(value, all(one.ok for one in runs), {"force evaluations": float(evaluations)})


def errors(value: dict[str, float], true: dict[str, float]) -> dict[str, float]:
    """Return the absolute errors of the jamming point and the contacts, the relative one of the shear modulus."""
    return {name: abs(value[name] - one) / (abs(one) if name == SHEAR else 1.0) for name, one in true.items()}


def main(*, particles: int = 128, decades: int = 12, out: Path = Path(__file__).parent) -> None:
    """Run all methods at all tolerances against the default route at 1e-14; write table and figure."""
    start = above_jamming(particles)
    methods = {"default route": None} | METHODS
    table = pm.work_precision(
        {name: partial(trial, start, method) for name, method in methods.items()},
        [10.0**-k for k in range(1, decades + 1)],
        trial(start, None, 1e-14).value,
        error=errors,
        knob="force tolerance",
        title=f"{particles} bidisperse discs decompressed to jamming",
        reference_is="the default route, Newton's method to the rounding floor",
        repeats=1,
    )
    (out / "minimizers.csv").write_text(table.to_csv())
    (out / "minimizers.md").write_text(table.to_markdown())
    table.save_figure(out / "minimizers.png")


if __name__ == "__main__":
    run(main)
