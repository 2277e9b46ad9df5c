"""Which program, which solver and which tolerance decide whether a packing is jammed: seconds, errors, verdicts.

    python tests/benchmarks/bench_jamming_programs.py recordings/accuracy

A packing with one state of self stress is jammed, and is not without any one of its contacts: the weakest is the one
hardest to miss. Every solver stands alone here; in `pm.classify_jamming` simplex decides where another gave no proof.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.jamming.certificates import Finding, proven, yield_to_loads
from packmech.jamming.contact_selection import backbone_of, select_contacts
from packmech.jamming.motion_cone import FLOPPY, MotionCone, motion_cone
from packmech.jamming.programs import largest_smallest_force, load_program, open_all
from packmech.linalg.linear_programs import LinearProgram
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

PARTICLES, SEED, PRESSURE = {2: 256, 3: 128}, 1, 1e-8
TOLERANCES = tuple(10.0**-k for k in range(4, 11))
JAMMED, OPENED = "jammed packing", "packing less its weakest contact"
# what a motion must exceed to be one, of its bound
MOVED = 1e-3
INTERIOR = "loads in a box, HiGHS interior, unchecked"


class Pair(NamedTuple):
    """The motions of a jammed packing, its largest smallest force, and its motions without the weakest contact."""

    jammed: MotionCone
    smallest_force: float
    opened: MotionCone


class Claim(NamedTuple):
    """What a method claims: jammed, not jammed or nothing (None), and how wrong its numbers are."""

    jammed: bool | None
    error: float


@cache
def packings(dimension: int) -> Pair:
    """Return a jammed packing with one state of self stress, with and without its weakest contact.

    Raises
    ------
    RuntimeError
        If the packing has another number of states of self stress, or its forces are not all positive.

    """
    sizes: object = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(
        PARTICLES[dimension], dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=SEED
    )
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=PRESSURE, strain="free").packing
    network, kept = backbone_of(packing, select_contacts(packing, None).contacts)
    cone = motion_cone(packing, network, strain="free", kept_n=kept)
    states = cone.rows.shape[0] - (cone.unknowns - dimension - cone.floppy_modes())
    # the only state of self stress is what is left of any weights, to rounding
    force = cone.balanced(np.ones(cone.rows.shape[0]))[: len(network)]
    force /= force.mean()
    if states != 1 or force.min() <= 0.0:
        raise RuntimeError(f"packing must have one state of self stress without tension, got {states} states")
    rest = network.select(np.arange(len(network)) != int(np.argmin(force)))
    return Pair(cone, float(force.min()), motion_cone(packing, rest, strain="free", kept_n=kept))


def closing(cone: MotionCone, motion: NDArray[np.float64]) -> float:
    """Return the largest shortening of a contact over the largest lengthening."""
    stretch = cone.opening @ motion
    return float(max(0.0, -stretch.min()) / stretch.max()) if stretch.max() > 0.0 else np.inf


def certificate(cone: MotionCone, smallest_force: float | None, tolerance: float, *, solver: str) -> Claim:
    """Return what rank and the force program say; the error is that of the smallest force, or of the motion."""
    softest, motion = cone.softest()
    if softest**2 <= FLOPPY and (cone.is_floppy or cone.is_floppy_within_error):
        return Claim(False, closing(cone, motion))
    stress = largest_smallest_force(cone, solver=solver, tolerance=tolerance)
    finding = proven(cone, softest, stress.weight, stress.motion, (stress.solve, stress.solve))
    if finding.jammed is None and solver != "clarabel":
        opened = open_all(cone, solver=solver, tolerance=tolerance)
        finding = proven(cone, softest, opened.weight, opened.motion, (stress.solve, opened.solve))
    if smallest_force is not None:
        return Claim(finding.jammed, abs(stress.smallest - smallest_force) / smallest_force)
    return Claim(finding.jammed, np.nan if finding.motion is None else closing(cone, finding.motion))


def loads(cone: MotionCone, smallest_force: float | None, tolerance: float, *, solver: str, bound: str) -> Claim:
    """Return what a load and its opposite say; the error is the longest motion left, or that of the motion found."""
    rng = np.random.default_rng(SEED)
    finding: Finding = yield_to_loads(cone, rng, bound=bound, solver=solver, tolerance=tolerance, fallback=False)
    if smallest_force is not None:
        return Claim(finding.jammed, finding.longest)
    return Claim(finding.jammed, np.nan if finding.motion is None else closing(cone, finding.motion))


def interior(cone: MotionCone, smallest_force: float | None, tolerance: float) -> Claim:
    """Return what HiGHS' interior-point method without crossover says of the loads, believed whatever its status."""
    load = cone.without_translations(np.random.default_rng(SEED).standard_normal(cone.unknowns))
    load /= np.sqrt(load @ load)
    motions = [interior_point(load_program(cone, sign * load, "box"), tolerance) for sign in (1.0, -1.0)]
    longest = max(motions, key=lambda motion: float(np.abs(motion).max()))
    size = float(np.abs(longest).max())
    return Claim(size <= MOVED, size if smallest_force is not None else closing(cone, longest))


def interior_point(program: LinearProgram, tolerance: float) -> NDArray[np.float64]:
    """Return the point at which HiGHS' interior-point method stops."""
    import highspy
    import scipy.sparse as sp

    rows = sp.csc_matrix(sp.vstack([program.equal, program.below]))
    size, equal = len(program.cost), program.equal.shape[0]
    model = highspy.HighsLp()
    model.num_col_, model.num_row_ = size, rows.shape[0]
    model.col_cost_, model.col_lower_, model.col_upper_ = program.cost, program.lower, program.upper
    model.row_upper_ = np.concatenate([program.equal_to, program.below_to])
    model.row_lower_ = np.concatenate([program.equal_to, np.full(rows.shape[0] - equal, -np.inf)])
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_, model.a_matrix_.index_, model.a_matrix_.value_ = rows.indptr, rows.indices, rows.data
    highs = highspy.Highs()
    for name, value in {
        "output_flag": False,
        "solver": "ipm",
        "run_crossover": "off",
        "threads": 1,
        "ipm_optimality_tolerance": tolerance,
        "primal_feasibility_tolerance": max(tolerance, 1e-10),
        "dual_feasibility_tolerance": max(tolerance, 1e-10),
    }.items():
        highs.setOptionValue(name, value)
    highs.passModel(model)
    highs.run()
    return np.asarray(highs.getSolution().col_value)


def methods() -> dict[str, Callable[[MotionCone, float | None, float], Claim]]:
    """Return the methods compared, by name."""
    return {
        "certificate, Clarabel": partial(certificate, solver="clarabel"),
        "certificate, cvxpy": partial(certificate, solver="cvxpy"),
        "certificate, HiGHS simplex": partial(certificate, solver="highs"),
        "loads in a ball, Clarabel": partial(loads, solver="clarabel", bound="ball"),
        "loads in a ball, cvxpy as printed": partial(loads, solver="cvxpy", bound="ball"),
        "loads in a box, Clarabel": partial(loads, solver="clarabel", bound="box"),
        "loads in a box, HiGHS simplex": partial(loads, solver="highs", bound="box"),
        INTERIOR: interior,
    }


def trial(dimension: int, method: Callable[[MotionCone, float | None, float], Claim], tolerance: float) -> Answer:
    """Return what a method says at a tolerance of the packing, and of the packing without its weakest contact."""
    pair = packings(dimension)
    found = {
        JAMMED: method(pair.jammed, pair.smallest_force, tolerance),
        OPENED: method(pair.opened, None, tolerance),
    }
    truth = {JAMMED: True, OPENED: False}
    bad = [f"{_word(one.jammed)}, {name}" for name, one in found.items() if one.jammed is not truth[name]]
    work = {f"verdict on {name}": _number(one.jammed, truth[name]) for name, one in found.items()}
    return Answer({name: one.error for name, one in found.items()}, not bad, work=work, note="; ".join(bad))


def _word(jammed: bool | None) -> str:
    return "nothing said" if jammed is None else "'jammed' said" if jammed else "'not jammed' said"


def _number(jammed: bool | None, truth: bool) -> float:
    return np.nan if jammed is None else float(jammed is truth)


def measure(dimension: int) -> WorkPrecision:
    """Return the table of all methods at all tolerances."""
    return work_precision(
        {name: partial(trial, dimension, method) for name, method in methods().items()},
        TOLERANCES,
        {JAMMED: 0.0, OPENED: 0.0},
        knob="tolerance of the solver",
        title=f"Is it jammed? {PARTICLES[dimension]} {'discs' if dimension == 2 else 'spheres'} in {dimension}D",
        reference_is="one state of self stress, by linear algebra: jammed, and not without any contact",
        repeats=3,
    )


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for dimension in (2, 3):
        table = measure(dimension)
        (folder / f"jamming_{dimension}d.csv").write_text(table.to_csv())
        (folder / f"jamming_{dimension}d.md").write_text(table.to_markdown())
        table.save_figure(folder / f"jamming_{dimension}d.png")
