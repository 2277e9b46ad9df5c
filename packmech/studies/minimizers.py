"""Minimizer and force tolerance against the errors of a jamming point, its contacts and its shear modulus.

Every trial does the same decompression, so that only the minimizer and its tolerance differ: a packing a little above
jamming is strained off its minimum, quenched, and brought down towards zero pressure in a few steps, each quenched to the
same tolerance. The line through the last two pressures gives the packing fraction at which the pressure vanishes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

import packmech as pm
from packmech.accuracy import Answer, WorkPrecision, work_precision
from packmech.outcome import Outcome, Run
from packmech.scene import Scene

PARTICLES, SEED = 64, 3
TOLERANCES = tuple(10.0**-k for k in range(1, 13))
# packing fraction above jamming of the start, and the part of the pressure that each step down leaves
ABOVE, KEPT, STEPS_DOWN = 1e-3, 0.25, 3
STEP_LIMIT = 200_000


class Decompressed(NamedTuple):
    """The jamming point by decompression, and the last packing above it."""

    packing_fraction: float
    scene: Scene
    runs: tuple[Run, ...]


def methods() -> dict[str, Any]:
    """Return the minimizers compared, by name; None is what `pm.quench` chooses by itself."""
    return {
        "default route": None,
        "FIRE": pm.Fire(),
        "FIRE 2.0": pm.Fire2(),
        "conjugate gradient": pm.ConjugateGradient(),
        "L-BFGS": pm.LBFGS(),
        "damped dynamics": pm.DampedDynamics(),
        "gradient descent": pm.GradientDescent(),
    }


@cache
def start() -> Scene:
    """Return the common start: a jammed packing compressed by ABOVE and sheared by 1e-4, not at rest."""
    packing = pm.random_packing(PARTICLES, dimension=2, packing_fraction=0.87, seed=SEED)
    scene = Scene(packing, effects=(pm.Repulsion(law=pm.Harmonic()),))
    jammed = pm.jam(scene, pressure=1e-8, strain="fixed").packing
    shear = np.array([[0.0, 1e-4], [0.0, 0.0]])
    squeeze = (1.0 + ABOVE / pm.packing_fraction(jammed)) ** -0.5
    affine = squeeze * (np.eye(2) + shear)
    box = pm.Box(affine @ jammed.box.lattice_dd)
    return scene.replace(packing=jammed.replace(position_nd=jammed.position_nd @ affine.T, box=box))


def decompress(scene: Scene, quench: Callable[[Scene], Run]) -> Decompressed:
    """Return the packing fraction at which the pressure of a quenched packing vanishes, followed down in a few steps.

    Raises
    ------
    FloatingPointError
        When the pressure stops falling with the packing fraction, so that no onset can be extrapolated.

    """
    runs = [quench(scene)]
    scene = scene.replace(packing=runs[-1].packing)
    fraction_t, pressure_t = [pm.packing_fraction(scene.packing)], [pm.pressure(scene)]
    slope = 0.4 * scene.pressure_unit
    for _ in range(STEPS_DOWN):
        target = fraction_t[-1] - (1.0 - KEPT) * pressure_t[-1] / slope
        scale = (fraction_t[-1] / target) ** (1.0 / scene.packing.dimension)
        packing = scene.packing
        box = packing.box.scaled(scale)
        runs.append(quench(scene.replace(packing=packing.replace(position_nd=scale * packing.position_nd, box=box))))
        scene = scene.replace(packing=runs[-1].packing)
        fraction_t.append(pm.packing_fraction(scene.packing))
        pressure_t.append(pm.pressure(scene))
        slope = (pressure_t[-1] - pressure_t[-2]) / (fraction_t[-1] - fraction_t[-2])
        if not (slope > 0.0 and pressure_t[-1] > 0.0):
            raise FloatingPointError(f"pressure does not fall with the packing fraction: {pressure_t}")
    return Decompressed(fraction_t[-1] - pressure_t[-1] / slope, scene, tuple(runs))


def trial(method: Any, tolerance: float) -> Answer:
    """Return jamming point, contacts and shear modulus by one method at one tolerance."""
    chosen = {} if method is None else {"method": method, "step_limit": STEP_LIMIT}
    found = decompress(start(), partial(_quench, tolerance=tolerance, chosen=chosen))
    moduli = pm.elastic_moduli(found.scene)
    value = {
        "packing fraction at jamming": found.packing_fraction,
        "contacts": float(len(pm.find_contacts(found.scene.packing))),
        "shear modulus": moduli.voigt.shear_modulus / found.scene.pressure_unit,
    }
    bad = [run.outcome for run in found.runs if not run.ok]
    work = {"force evaluations": float(sum(run.force_evaluations for run in found.runs))}
    return Answer(value, converged=not bad, work=work, note=_words(bad, found.runs))


def _quench(scene: Scene, *, tolerance: float, chosen: Mapping[str, Any]) -> Run:
    return pm.quench(scene, force_tolerance=tolerance, **chosen)


def _words(bad: list[Outcome], runs: tuple[Run, ...]) -> str:
    if bad:
        return bad[0].name.lower().replace("_", " ")
    return "rounding floor" if any(run.outcome is Outcome.ROUNDING_FLOOR for run in runs) else ""


def minimizers(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    reference = trial(None, 1e-14).value
    problem = {name: partial(trial, method) for name, method in methods().items()}
    table = work_precision(
        problem,
        TOLERANCES,
        reference,
        knob="force tolerance (max net force / mean contact force)",
        title=f"Minimizers: {PARTICLES} bidisperse discs decompressed to jamming",
        reference_is="the default route to the rounding floor",
        repeats=1,
        failures=(ArithmeticError, RuntimeError, np.linalg.LinAlgError),
        progress=progress,
    )
    return table, told(table)


def told(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = []
    return "\n".join(lines)
