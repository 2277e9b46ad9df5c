"""Exact against paper Hessian of packings with links, over pressure, and both against finite differences.

The paper form projects the second derivatives of the contacts alone; what it leaves out is the forces that links bear
times the curvature of their lengths, so that it should come right as the pressure goes to zero, and not before.

The finite differences share nothing with `elastic_moduli` but energy, forces and stress: small packings are strained a
little, brought back to mechanical equilibrium, and their stress is measured. Dense, for small packings.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.jit.blas import single_thread
from packmech.result import markdown_table
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
# part of the largest eigenvalue below which one is a translation or a dangling end
_ZERO = 1e-9
# of the dense Newton iteration: its steps, the singular values that count over the largest; halvings of a strain
_NEWTON_STEPS, _RANK_TOLERANCE, _HALVINGS = 30, 1e-11, 40


def _components(dimension: int) -> list[NDArray[np.float64]]:
    """Return the orthonormal symmetric strains xx, yy, sqrt2 xy; or xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy."""
    pairs = [(a, a) for a in range(dimension)] + ([(0, 1)] if dimension == 2 else [(1, 2), (0, 2), (0, 1)])
    made = []
    for a, b in pairs:
        strain = np.zeros((dimension, dimension))
        strain[a, b] = strain[b, a] = 1.0 if a == b else 0.5**0.5
        made.append(strain)
    return made


def at_rest(scene: pm.Scene) -> pm.Scene:
    """Return the scene at the rest nearest to it in its box: Newton's method on positions and link forces, dense.

    It stops where steps no longer get smaller, which is at rounding.

    Raises
    ------
    FloatingPointError
        When the steps do not die out: the packing given was not near rest.

    """
    links = scene.packing.links
    size, held = scene.packing.position_nd.size, 0 if links is None else len(links)
    best, last = np.inf, scene
    with single_thread():
        for _ in range(_NEWTON_STEPS):
            packing = scene.packing
            push = pm.forces(scene).ravel()
            matrix = np.zeros((size + held, size + held))
            matrix[:size, :size] = pm.hessian(scene, strain="none").toarray()
            right = np.concatenate([push, np.zeros(held)])
            if links is not None:
                gradient = pm.constraint_jacobian(packing).toarray()
                matrix[:size, size:], matrix[size:, :size] = gradient, gradient.T
                vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
                right[size:] = links.length_l - np.sqrt((vector**2).sum(axis=1))
            step = np.linalg.lstsq(matrix, right, rcond=_RANK_TOLERANCE)[0][:size].reshape(packing.position_nd.shape)
            largest = float(np.abs(step).max())
            if not largest < best:
                return last
            best = largest
            last = scene = scene.replace(packing=packing.replace(position_nd=packing.position_nd + step))
    raise FloatingPointError(f"steps do not die out, the last one was {best:.1e}")


def strained(scene: pm.Scene, strain_dd: NDArray[np.float64]) -> pm.Scene:
    """Return the scene strained by 1 + strain, at rest again in the strained box, its links at their lengths."""
    packing = scene.packing
    change = np.eye(packing.dimension) + strain_dd
    box = pm.Box(change @ packing.box.lattice_dd)
    return at_rest(scene.replace(packing=packing.replace(position_nd=packing.position_nd @ change.T, box=box)))


def _same_contacts(one: pm.Scene, other: pm.Scene) -> bool:
    a, b = pm.find_contacts(one.packing), pm.find_contacts(other.packing)
    return len(a) == len(b) and bool(
        (a.i_c == b.i_c).all() and (a.j_c == b.j_c).all() and (a.image_cd == b.image_cd).all()
    )


def kept_step(scene: pm.Scene, step: float) -> float:
    """Return the largest of step, step/2, step/4, ... at which no strain component makes or breaks a contact.

    Raises
    ------
    FloatingPointError
        When forty halvings are not enough: a contact just touches.

    """
    for _ in range(_HALVINGS):
        if all(
            _same_contacts(scene, strained(scene, sign * step * component))
            for component in _components(scene.packing.dimension)
            for sign in (1.0, -1.0)
        ):
            return step
        step /= 2.0
    raise FloatingPointError("a contact changes at every step")


def finite_tangent(scene: pm.Scene, step: float) -> NDArray[np.float64]:
    """Return the (s, s) change of stress with strain in Mandel components, by central differences [energy/length^d].

    Column m is (stress(+step E_m) - stress(-step E_m)) / (2 step), each packing at rest: the error falls with the
    square of the step until rounding takes over.
    """
    components = _components(scene.packing.dimension)
    columns = []
    for component in components:
        up, down = (pm.stress_tensor(strained(scene, sign * step * component)) for sign in (1.0, -1.0))
        columns.append([float((up - down).ravel() @ row.ravel()) / (2.0 * step) for row in components])
    return np.array(columns).T


def second_difference(scene: pm.Scene, step: float) -> NDArray[np.float64]:
    """Return the (s, s) second differences of the energy at rest with strain, over the volume [energy/length^d].

    Strains are 1 + step (E_a +- E_b)/2, so that off-diagonal entries come from the polarization identity.
    """
    components = _components(scene.packing.dimension)
    size, rest = len(components), pm.energy(scene)
    answer = np.zeros((size, size))

    def along(strain: NDArray[np.float64]) -> float:
        up, down = (pm.energy(strained(scene, sign * step * strain)) for sign in (1.0, -1.0))
        curvature: float = (up - 2.0 * rest + down) / step**2
        return curvature

    for a in range(size):
        answer[a, a] = along(components[a])
        for b in range(a):
            plus, minus = (along((components[a] + sign * components[b]) / 2.0) for sign in (1.0, -1.0))
            answer[a, b] = answer[b, a] = plus - minus
    answer /= scene.packing.box.volume
    return answer


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
    """Return the lowest eigenvalue of the reduced Hessian at fixed volume, translations and dangling ends left out."""
    equal = scene.replace(packing=scene.packing.replace(mass_n=np.ones(scene.packing.particles)))
    value: NDArray[np.float64] = np.linalg.eigvalsh(pm.dynamical_matrix(equal, "isochoric", kind).toarray())
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


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {f"{name}, {dimension}D": partial(trial, name, dimension) for name in STATES for dimension in (2, 3)},
        PRESSURES,
        dict.fromkeys((COMPLIANCE, LOWEST, EXACT, FINER, PAPER), 0.0),
        knob="pressure",
        title="Exact and paper Hessian of shear-stabilized packings with links",
        reference_is="the exact form, and central differences of the stress of packings at rest again after a strain",
        repeats=1,
        progress=progress,
    )
    return table, "\n".join([describe(table), _seconds()])


def describe(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = [
        "Compliance and tangent: largest entry of the difference over the largest entry. Lowest eigenvalue: of B H B^T",
        "at fixed volume with the curvature of the volume, B H0 B^T in the paper form, translations and dangling ends",
        "left out. Finite differences: of the total stress over strains of both signs, the packing at rest again after",
        "each; their own error falls with the square of the step (a quarter of it: a sixteenth) until rounding.",
        "The seconds of the figure are of all of it; of the moduli alone see the last table.",
        "",
    ]
    for words, quantity in (
        ("Paper against exact, relative difference of the compliance:", COMPLIANCE),
        ("The same of the lowest eigenvalue:", LOWEST),
        ("Exact against finite differences, relative difference of the tangent:", EXACT),
        ("At a quarter of the step:", FINER),
        ("Paper against finite differences:", PAPER),
    ):
        lines += [words, "", _over_pressure(table, quantity)]
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


def _over_pressure(table: WorkPrecision, quantity: str) -> str:
    """Return a table of one error by packing and pressure."""
    settings = [f"{one.setting:.0e}" for one in table.of(table.methods[0])]
    rows = [
        (method, *(one.failed or f"{one.errors[quantity]:.1e}" for one in table.of(method))) for method in table.methods
    ]
    return markdown_table(("packing", *settings), rows)


def _seconds() -> str:
    """Return a table of particles, contacts and CPU milliseconds of either kind at one pressure."""
    rows = []
    for name in STATES:
        for dimension in (2, 3):
            scene = state(name, dimension, PRESSURES[3])
            links = scene.packing.links
            took = {kind: 1e3 * min(pm.elastic_moduli(scene, kind=kind).seconds for _ in range(5)) for kind in KINDS}
            began = time.process_time()
            finite_tangent(scene, STEP * PRESSURES[3])
            spent = 1e3 * (time.process_time() - began)
            counts = (scene.packing.particles, 0 if links is None else len(links), len(pm.find_contacts(scene.packing)))
            times = (f"{took['exact']:.1f}", f"{took['paper']:.1f}", f"{spent:.0f}")
            rows.append((f"{name}, {dimension}D", *map(str, counts), *times))
    headings = ("packing", "particles", "links", "contacts", "exact", "paper", "finite differences")
    words = "At pressure 1e-4, CPU milliseconds of the moduli, the smallest of five:"
    return f"{words}\n\n{markdown_table(headings, rows)}".rstrip("\n")
