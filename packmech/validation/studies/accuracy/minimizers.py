"""Minimizer and force tolerance against the errors of a jamming point, its contacts and its shear modulus.

Every trial does the same decompression, so that only the minimizer and its tolerance differ: a packing a little above
jamming is strained off its minimum, quenched, and brought down towards zero pressure in a few steps, each quenched to
the same tolerance. The line through the last two pressures gives the packing fraction at which the pressure vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

import packmech as pm
from packmech.minimize.quench import quench
from packmech.result import Outcome, Run, markdown_table
from packmech.scene import Scene
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

PARTICLES, SEED = 128, 1
TOLERANCES = tuple(10.0**-k for k in range(1, 13))
# the start: packing fraction above jamming and shear off rest, small enough to stay near one minimum
ABOVE, SHEAR_OFF = 2e-4, 2e-5
# the part of the pressure that each step down leaves
KEPT, STEPS_DOWN = 0.25, 3
STEP_LIMIT = 200_000
# dP/dphi of disordered discs near jamming [energy_scale / diameter^2]
SLOPE = 0.4
ONSET, CONTACTS, SHEAR = "packing fraction at jamming", "contacts", "shear modulus (relative)"
# a jamming point so many times farther off than the other methods' at the same tolerance is another one
ELSEWHERE = 300.0
REFERENCE, CONFIRMED = "default route", 1e-13


class Decompressed(NamedTuple):
    """The jamming point by decompression, and the last packing above it."""

    packing_fraction: float
    scene: Scene
    runs: tuple[Run, ...]


def methods() -> dict[str, Any]:
    """Return the minimizers compared, by name; None is what `pm.quench` chooses by itself."""
    return {
        REFERENCE: None,
        "FIRE": pm.Fire(),
        "FIRE 2.0": pm.Fire2(),
        "conjugate gradient": pm.ConjugateGradient(),
        "L-BFGS": pm.LBFGS(),
        "damped dynamics": pm.DampedDynamics(),
        "gradient descent": pm.GradientDescent(),
    }


@cache
def start() -> Scene:
    """Return the common start: a jammed packing compressed by ABOVE and sheared by SHEAR_OFF, not at rest."""
    packing = pm.random_packing(PARTICLES, dimension=2, packing_fraction=0.87, seed=SEED)
    scene = Scene(packing, effects=(pm.Repulsion(law=pm.Harmonic()),))
    jammed = pm.jam(scene, pressure=1e-8, strain="isotropic").packing
    shear = np.array([[0.0, SHEAR_OFF], [0.0, 0.0]])
    squeeze = (1.0 + ABOVE / pm.packing_fraction(jammed)) ** -0.5
    affine = squeeze * (np.eye(2) + shear)
    box = pm.Box(affine @ jammed.box.lattice_dd)
    return scene.replace(packing=jammed.replace(position_nd=jammed.position_nd @ affine.T, box=box))


def decompress(scene: Scene, relax: Callable[[Scene], Run], slope: float = SLOPE) -> Decompressed:
    """Return the packing fraction at which the pressure of a quenched packing vanishes, followed down in a few steps.

    slope, the first guess at dP/dphi [energy_scale / diameter^d], decides only how far the first step goes.

    Raises
    ------
    FloatingPointError
        When the pressure stops falling with the packing fraction, so that no onset can be extrapolated.

    """
    runs = [relax(scene)]
    scene = scene.replace(packing=runs[-1].packing)
    fraction_t, pressure_t = [pm.packing_fraction(scene.packing)], [pm.pressure(scene)]
    slope *= scene.pressure_unit
    for _ in range(STEPS_DOWN):
        target = fraction_t[-1] - (1.0 - KEPT) * pressure_t[-1] / slope
        scale = (fraction_t[-1] / target) ** (1.0 / scene.packing.dimension)
        packing = scene.packing
        box = packing.box.scaled(scale)
        runs.append(relax(scene.replace(packing=packing.replace(position_nd=scale * packing.position_nd, box=box))))
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
        ONSET: found.packing_fraction,
        CONTACTS: float(len(pm.find_contacts(found.scene.packing))),
        SHEAR: moduli.voigt.shear_modulus / found.scene.pressure_unit,
    }
    bad = [run.outcome for run in found.runs if not run.ok]
    work = {"force evaluations": float(sum(run.force_evaluations for run in found.runs))}
    return Answer(value, converged=not bad, work=work, note=_words(bad, found.runs))


def _quench(scene: Scene, *, tolerance: float, chosen: Mapping[str, Any]) -> Run:
    return quench(scene, force_tolerance=tolerance, check=False, **chosen)


def _words(bad: list[Outcome], runs: tuple[Run, ...]) -> str:
    if bad:
        return bad[0].name.lower().replace("_", " ")
    return "rounding floor" if any(run.outcome is Outcome.ROUNDING_FLOOR for run in runs) else ""


def errors(value: Mapping[str, float], reference: Mapping[str, float]) -> dict[str, float]:
    """Return the absolute errors of the jamming point and the contacts, the relative one of the shear modulus."""
    found = {name: abs(value[name] - reference[name]) for name in reference}
    found[SHEAR] /= abs(reference[SHEAR])
    return found


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    reference = trial(None, 1e-14).value
    table = work_precision(
        {name: partial(trial, method) for name, method in methods().items()},
        TOLERANCES,
        reference,
        error=errors,
        knob="force tolerance",
        title=f"Minimizer and force tolerance: {PARTICLES} bidisperse discs decompressed to jamming",
        reference_is="the default route, Newton's method to the rounding floor",
        repeats=1,
        progress=progress,
    )
    return table, describe(table, reference)


def describe(table: WorkPrecision, reference: Mapping[str, float]) -> str:
    """Return what the table shows, every figure taken from it."""
    spacing = float(np.spacing(reference[ONSET]))
    lines = [
        f"Reference: packing fraction at jamming {reference[ONSET]:.12f}, {reference[CONTACTS]:.0f} contacts, "
        f"shear modulus {reference[SHEAR]:.6e} energy_scale / diameter^2.",
        "Force tolerance: largest net force over mean contact force. Order: exponent of the error against the",
        f"tolerance, above the floor. The floor of the packing fraction is rounding: doubles near it are {spacing:.1e}",
        "apart. The floor of the shear modulus is the rounding of positions, magnified by how soft the packing is.",
        "",
    ]
    headings = ("method", "order, packing fraction", "floor", "order, shear modulus", "floor")
    rows = [_cells(table, method) for method in table.methods]
    lines.append(markdown_table((*headings, "CPU s at 1e-3", "at 1e-9"), rows))
    best_of = {
        name: min((t.errors[ONSET] for t in table.of(name) if not t.failed), default=1.0) for name in table.methods
    }
    near = {name: error for name, error in best_of.items() if error < CONFIRMED and name != REFERENCE}
    if near:
        lines.append(f"The reference is confirmed to {max(near.values()):.0e} by {', '.join(near)}.")
    for bound in (1e-6, 1e-9, 1e-12):
        best = table.cheapest(error_below=bound, quantity=ONSET)
        if best is not None:
            lines.append(
                f"Cheapest packing fraction with error below {bound:.0e}: {best.method} at tolerance "
                f"{best.setting:.0e}, {best.seconds:.3f} CPU s."
            )
    lines += _elsewhere(table)
    return "\n".join(lines)


def _cells(table: WorkPrecision, method: str) -> list[str]:
    cells = [method]
    for quantity in (ONSET, SHEAR):
        try:
            fit = table.fit(method, quantity=quantity)
            exact = table.of(method)[-1].errors[quantity] == 0.0 and method == REFERENCE
            floor = "it is the reference" if exact else f"{fit.floor:.0e}" if fit.floor else "not reached"
            cells += [f"{fit.order:.2f}", floor]
        except ValueError:
            cells += ["-", "-"]
    for tolerance in (1e-3, 1e-9):
        (found,) = [one for one in table.of(method) if math.isclose(one.setting, tolerance)]
        cells.append(f"{found.seconds:.3f}" if not found.failed else f"failed: {found.failed}")
    return cells


def _elsewhere(table: WorkPrecision) -> list[str]:
    """Name methods whose tightest answer is far worse than the others' at that tolerance: it is of another minimum."""
    lines = []
    for method in table.methods:
        met = [one for one in table.of(method) if not one.failed]
        if not met:
            continue
        last = met[-1]
        peers = [
            one.errors[ONSET]
            for one in table.trials
            if one.setting == last.setting and one.method != method and not one.failed
        ]
        if peers and last.errors[ONSET] > ELSEWHERE * float(np.median(peers)):
            lines.append(
                f"{method} met tolerance {last.setting:.0e} and still differs by {last.errors[ONSET]:.0e}: it went to "
                "another minimum of the energy, which no tolerance can mend."
            )
    return lines
