"""How well links must be projected back to their lengths: tolerance against lengths, energy and balance of a descent.

Rigid trimers at rest are shoved a little and descend again: a heavy ball rolls down the constrained force, and links go
back to their lengths after each step, to the tolerance. What is left at the end is compared with the rest it came from.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.result import markdown_table
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

CLUSTERS, SEED = 20, 1
DENSITY = {2: 0.95, 3: 0.75}
TOLERANCES = tuple(10.0**-k for k in range(2, 16))
# largest shove [diameter], small enough to stay near one minimum
SHOVE = 0.01
STEPS, STEP, MOMENTUM = 600, 0.2, 0.85
LENGTHS, ENERGY, BALANCE = "error of links", "energy (relative)", "residual"


@cache
def rest(dimension: int) -> pm.Scene:
    """Return rigid trimers at rest in a fixed box, without rattlers."""
    packing = pm.cluster_packing(
        CLUSTERS, pm.Trimer(angle=(1.1, 2.6)), dimension=dimension, packing_fraction=DENSITY[dimension], seed=SEED
    )
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-13).packing)


def shoved(scene: pm.Scene) -> pm.Scene:
    """Return the scene with every particle shoved, links not at their lengths."""
    packing = scene.packing
    shove = np.random.default_rng(SEED).uniform(-SHOVE, SHOVE, packing.position_nd.shape)
    return scene.replace(packing=packing.replace(position_nd=packing.position_nd + shove))


def balance(scene: pm.Scene) -> float:
    """Return the largest constrained force over the mean contact force."""
    left = pm.project_force(scene.packing, pm.forces(scene)).force_nd
    overlap = pm.find_contacts(scene.packing)
    mean = float((overlap.overlap_c / overlap.contact_distance_c).mean())
    return float(np.sqrt((left**2).sum(axis=1)).max()) / mean


def trial(dimension: int, tolerance: float) -> Answer:
    """Return what a descent leaves of link errors, energy and force when links are re-affixed to a tolerance."""
    aim = pm.energy(rest(dimension))
    scene = shoved(rest(dimension))
    velocity: NDArray[np.float64] = np.zeros_like(scene.packing.position_nd)
    iterations, seconds, missed, largest = 0, 0.0, 0, 0.0
    for _ in range(STEPS):
        back = pm.reaffix_links(scene.packing, tolerance=tolerance, check=False)
        iterations, seconds, missed = iterations + back.iterations, seconds + back.seconds, missed + (not back.ok)
        # Newton's method often ends far below the tolerance; what counts is what it may leave
        largest = max(largest, back.residual)
        scene = scene.replace(packing=back.packing)
        velocity = MOMENTUM * velocity + STEP * pm.project_force(scene.packing, pm.forces(scene)).force_nd
        scene = scene.replace(packing=scene.packing.replace(position_nd=scene.packing.position_nd + velocity))
    scene = scene.replace(packing=pm.reaffix_links(scene.packing, tolerance=tolerance, check=False).packing)
    value = {LENGTHS: largest, ENERGY: abs(pm.energy(scene) - aim) / aim, BALANCE: balance(scene)}
    work = {"iterations a step": iterations / STEPS, "seconds of re-affixing": seconds, "steps that missed": missed}
    return Answer(value, work=work, note=f"missed in {missed} steps" if missed else "")


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {f"rigid trimers, {dimension}D": partial(trial, dimension) for dimension in (2, 3)},
        TOLERANCES,
        dict.fromkeys((LENGTHS, ENERGY, BALANCE), 0.0),
        knob="tolerance of re-affixing",
        title=f"Re-affixing of links: {CLUSTERS} rigid trimers descending {STEPS} steps to rest",
        reference_is="the rest from which they were shoved, by Newton's method to the rounding floor",
        repeats=1,
        progress=progress,
    )
    return table, describe(table)


def describe(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = [
        "Error of links: the largest left after any step, over the larger of length and mean diameter. Energy: from",
        "that of the rest, relative. Residual: largest constrained force over mean contact force. Iterations: steps of",
        "Newton's method for a step of the descent. Seconds: CPU seconds of re-affixing in all.",
        "",
    ]
    rows = []
    for method in table.methods:
        for one in table.of(method):
            errors = (f"{one.errors[name]:.1e}" for name in (LENGTHS, ENERGY, BALANCE))
            iterations, seconds = one.work["iterations a step"], one.work["seconds of re-affixing"]
            counts = (f"{iterations:.2f}", f"{seconds:.3f}", f"{one.work['steps that missed']:.0f}")
            rows.append((method, f"{one.setting:.0e}", *errors, *counts))
    headings = ("packing", "tolerance", LENGTHS, "energy", BALANCE, "iterations", "seconds", "steps that missed it")
    lines.append(markdown_table(headings, rows))
    for method in table.methods:
        met = [one for one in table.of(method) if not one.work["steps that missed"]]
        tight = met[-1]
        dear = tight.work["seconds of re-affixing"] / met[0].work["seconds of re-affixing"]
        lines.append(
            f"{method}: met in every step down to {tight.setting:.0e}, there at {dear:.1f} times the cost of "
            f"{met[0].setting:.0e}; energy then off by {tight.errors[ENERGY]:.1e}."
        )
    return "\n".join(lines)
