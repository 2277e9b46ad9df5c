"""Exact against paper Hessian of packings with links, over pressure, and both against finite differences.

The paper form projects the second derivatives of the contacts alone; what it leaves out is the forces that links bear
times the curvature of their lengths, so that it should come right as the pressure goes to zero, and not before.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.validation.studies.finite_strain import at_rest, finite_tangent, kept_step
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

PRESSURES = tuple(10.0**-k for k in range(1, 7))
SEED = 1
DENSITY = {2: 0.9, 3: 0.7}
STATES = ("dimers", "rigid trimers", "flexible chains")
EXACT, PAPER = "tangent, exact", "tangent, paper"
FINER = "exact, finer step"
COMPLIANCE, LOWEST = "compliance, paper", "lowest eigenvalue, paper"
KINDS = ("exact", "paper")
# first step of strain, in pressures, and the largest: its square is the error that differences make by themselves
STEP, LARGEST_STEP = 1e-2, 1e-4
# part of the largest eigenvalue below which one is a translation or a loose end
_ZERO = 1e-9


def start(name: str, dimension: int) -> pm.Scene:
    """Return 20 to 21 particles in clusters of the named kind at random, dense."""
    common: dict[str, Any] = {"dimension": dimension, "packing_fraction": DENSITY[dimension], "seed": SEED}
    if name == "dimers":
        packing = pm.cluster_packing(10, pm.Dimer(), **common)
    elif name == "rigid trimers":
        packing = pm.cluster_packing(7, pm.Trimer(angle=(1.1, 2.6)), **common)
    else:
        packing = pm.chain_packing(4, 5, **common)
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))


@cache
def state(name: str, dimension: int, pressure: float) -> pm.Scene:
    """Return the packing shear-stabilized at a pressure, brought down from the next higher one, without rattlers."""
    higher = [one for one in PRESSURES if one > pressure]
    scene = state(name, dimension, min(higher)) if higher else start(name, dimension)
    run = pm.shear_stabilize(scene, pressure=pressure)
    return at_rest(scene.replace(packing=pm.remove_rattlers(run.packing)[0]))


def lowest(scene: pm.Scene, kind: str) -> float:
    """Return the lowest eigenvalue of the reduced Hessian at fixed volume, translations and loose ends left out."""
    value: NDArray[np.float64] = np.linalg.eigvalsh(pm.dynamical_matrix(scene, "isochoric", kind).toarray())
    return float(value[np.abs(value) > _ZERO * value.max()].min())


def trial(name: str, dimension: int, pressure: float) -> Answer:
    """Return the relative differences of the two Hessians from each other and from finite differences."""
    scene = state(name, dimension, pressure)
    exact, paper = (pm.compliance_matrix(scene, kind=kind) for kind in KINDS)
    by_exact, by_paper = (lowest(scene, kind) for kind in KINDS)
    step = kept_step(scene, min(STEP * pressure, LARGEST_STEP))
    tangent = finite_tangent(scene, step)
    exact_tangent, paper_tangent = (pm.elastic_moduli(scene, kind=kind).cauchy for kind in KINDS)
    return Answer(
        {
            COMPLIANCE: relative(paper, exact),
            LOWEST: abs(by_paper - by_exact) / abs(by_exact),
            EXACT: relative(exact_tangent, tangent),
            FINER: relative(exact_tangent, finite_tangent(scene, step / 4.0)),
            PAPER: relative(paper_tangent, tangent),
        },
        note=f"strain steps of {step:.0e}",
    )


def relative(one_ee: NDArray[np.float64], other_ee: NDArray[np.float64]) -> float:
    """Return the largest entry of the difference over the largest entry of the second."""
    return float(np.abs(one_ee - other_ee).max() / np.abs(other_ee).max())


def exact_hessian(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {f"{name}, {dimension}D": partial(trial, name, dimension) for name in STATES for dimension in (2, 3)},
        PRESSURES,
        dict.fromkeys((COMPLIANCE, LOWEST, EXACT, FINER, PAPER), 0.0),
        error=differences,
        knob="pressure",
        title="Exact and paper Hessian of shear-stabilized packings with links",
        reference_is="the exact form, and central differences of the stress of packings at rest again after a strain",
        repeats=1,
        progress=progress,
    )
    return table, "\n".join([told(table), *_seconds()])


def differences(value: Mapping[str, float], reference: Mapping[str, float]) -> dict[str, float]:
    """Return the relative differences, which a trial has taken already."""
    return {name: abs(value[name] - reference[name]) for name in reference}


def told(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = [
        "Compliance and tangent: largest entry of the difference over the largest entry. Lowest eigenvalue: of B H B^T",
        "at fixed volume with the curvature of the volume, B H0 B^T in the paper form, translations and loose ends",
        "left out. Finite differences: of the total stress over strains of both signs, the packing at rest again after",
        "each; their own error falls with the square of the step (a quarter of it: a sixteenth) until rounding.",
        "The seconds of the figure are of all of it; of the moduli alone see the last table.",
        "",
        "Paper against exact, relative difference of the compliance:",
        "",
        _heading(table),
        *(_row(table, method, COMPLIANCE) for method in table.methods),
        "",
        "The same of the lowest eigenvalue:",
        "",
        _heading(table),
        *(_row(table, method, LOWEST) for method in table.methods),
        "",
        "Exact against finite differences, relative difference of the tangent:",
        "",
        _heading(table),
        *(_row(table, method, EXACT) for method in table.methods),
        "",
        "At a quarter of the step:",
        "",
        _heading(table),
        *(_row(table, method, FINER) for method in table.methods),
        "",
        "Paper against finite differences:",
        "",
        _heading(table),
        *(_row(table, method, PAPER) for method in table.methods),
        "",
    ]
    worst = max(one.errors[EXACT] for one in table.trials if not one.failed)
    orders = [falls(table, method) for method in table.methods]
    lines += [
        f"Largest difference of the exact form from finite differences: {worst:.1e}.",
        f"The paper form comes near the exact one as pressure to the power {min(orders):.2f} to {max(orders):.2f}"
        " below 1e-4 (compliance).",
        "",
    ]
    return "\n".join(lines)


def falls(table: WorkPrecision, method: str) -> float:
    """Return the exponent with which paper and exact compliance come together over the lowest pressures."""
    low = [one for one in table.of(method) if one.setting <= 1.0001e-4 and not one.failed]
    first, last = low[0], low[-1]
    return math.log(first.errors[COMPLIANCE] / last.errors[COMPLIANCE]) / math.log(first.setting / last.setting)


def _heading(table: WorkPrecision) -> str:
    settings = [f"{one.setting:.0e}" for one in table.of(table.methods[0])]
    return "\n".join(["| packing | " + " | ".join(settings) + " |", "|---" * (len(settings) + 1) + "|"])


def _row(table: WorkPrecision, method: str, quantity: str) -> str:
    cells = [one.failed or f"{one.errors[quantity]:.1e}" for one in table.of(method)]
    return f"| {method} | " + " | ".join(cells) + " |"


def _seconds() -> list[str]:
    """Return a table of particles, contacts and CPU milliseconds of either kind at one pressure."""
    lines = [
        "At pressure 1e-4, CPU milliseconds of the moduli, the smallest of five:",
        "",
        "| packing | particles | links | contacts | exact | paper | finite differences |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in STATES:
        for dimension in (2, 3):
            scene = state(name, dimension, PRESSURES[3])
            links = scene.packing.links
            took = {kind: 1e3 * min(pm.elastic_moduli(scene, kind=kind).seconds for _ in range(5)) for kind in KINDS}
            began = time.process_time()
            finite_tangent(scene, STEP * PRESSURES[3])
            spent = 1e3 * (time.process_time() - began)
            lines.append(
                f"| {name}, {dimension}D | {scene.packing.particles} | {0 if links is None else len(links)} "
                f"| {len(pm.find_contacts(scene.packing))} | {took['exact']:.1f} | {took['paper']:.1f} | {spent:.0f} |"
            )
    return lines
