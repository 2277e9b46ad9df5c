"""Hard cases of jammed packings: rattlers, redundancy, missing contacts, pressures from 0.1 to 1e-9."""

from __future__ import annotations

import math
from functools import cache, partial

import numpy as np

from packmech.box import Box
from packmech.effects import Harmonic, Repulsion
from packmech.generate import lattice_packing, random_packing
from packmech.jamming.classify import classify_jamming
from packmech.measure.counting import find_rattlers
from packmech.mechanics.elasticity import elastic_moduli
from packmech.packing import Packing
from packmech.protocols.jam import jam
from packmech.result import Run
from packmech.scene import Scene
from packmech.validation.hard_cases.case import HardCase

EPS = float(np.finfo(float).eps)
HARMONIC = (Repulsion(law=Harmonic()),)
PRESSURES = tuple(10.0**-k for k in range(1, 10))


@cache
def _jammed(pressure: float = 1e-8, strain: str = "isotropic") -> Run:
    packing = random_packing(64, dimension=2, packing_fraction=0.87, seed=4)
    return jam(Scene(packing, HARMONIC), pressure=pressure, strain=strain, check=False)


def _imbalance(pressure: float) -> float:
    """Residual over what rounding allows at this pressure, infinite for another pressure or a failure."""
    run = _jammed(pressure)
    scene = Scene(run.packing, HARMONIC)
    reached = float(run.report["pressure"])
    if not run.ok or abs(reached / pressure - 1.0) > 1e-3:
        return math.inf
    side = float(run.packing.box.lattice_dd.max())
    overlap = pressure / scene.pressure_unit
    return run.residual / (8.0 * EPS * side / overlap)


def _with_hanger() -> tuple[Packing, int]:
    """Return a jammed packing with one small disc more, which hangs in a hole by one contact, and its number."""
    packing = _jammed().packing
    rng = np.random.default_rng(0)
    radius = 0.05
    inverse = packing.box.inverse_dd
    for _ in range(20_000):
        center = packing.box.lattice_dd @ rng.random(2)
        offset = (packing.position_nd - center) @ inverse.T
        vector = (offset - np.rint(offset)) @ packing.box.lattice_dd.T
        distance = np.linalg.norm(vector, axis=1) - packing.radius_n - radius
        nearest = int(np.argmin(distance))
        if distance[nearest] > 0.01 and not find_rattlers(packing)[nearest]:
            # straight towards the nearest disc until they overlap a little
            way = vector[nearest] / np.linalg.norm(vector[nearest])
            hung = center + way * (distance[nearest] + 1e-8)
            position_nd = np.vstack([packing.position_nd, hung])
            return Packing(position_nd, np.append(packing.radius_n, radius), packing.box), len(position_nd) - 1
    raise RuntimeError("no hole was found")


def _hanger_found() -> float:
    packing, last = _with_hanger()
    before = find_rattlers(_jammed().packing)
    return float(np.count_nonzero(find_rattlers(packing) != np.append(before, True)))


def _hanger_moduli() -> float:
    packing, _ = _with_hanger()
    with_it = elastic_moduli(Scene(packing, HARMONIC)).cauchy
    without = elastic_moduli(Scene(_jammed().packing, HARMONIC)).cauchy
    return float(np.abs(with_it - without).max() / np.abs(without).max())


def _redundant(name: str, repeats: tuple[int, ...]) -> float:
    """Count wrong answers about a crystal with many more contacts than it needs: verdicts and certificate."""
    verdict = classify_jamming(lattice_packing(name, repeats=repeats))
    wrong = (verdict.collective != "jammed") + (verdict.strict != "jammed")
    force_c = verdict.contact_force_c
    return float(wrong + (force_c is None or force_c.min() <= 0.0))


def _one_contact_less(which: str) -> float:
    """Wrong answers when one force-bearing contact of a packing with one state of self stress is taken away."""
    packing = _jammed().packing
    whole = classify_jamming(packing)
    if whole.collective != "jammed" or whole.collectively.states_of_self_stress != 1:
        return math.inf
    force_c = whole.contact_force_c
    if force_c is None:
        return math.inf
    order = np.argsort(force_c)
    gone = int(order[0 if which == "weakest" else len(order) // 2])
    verdict = classify_jamming(packing, contacts=whole.network.select(np.arange(len(order)) != gone))
    return float((verdict.collective != "not jammed") + (verdict.strict != "not jammed"))


def _saddle() -> float:
    """Whether a packing at a saddle passes as stable: a square crystal, pressed, is unstable to shear."""
    crystal = lattice_packing("square", repeats=(4, 4), relative_overlap=0.01)
    moduli = elastic_moduli(Scene(crystal, HARMONIC))
    return float(moduli.stable) + float(moduli.negative_modes == 0)


def _strain_free() -> float:
    """Anisotropy of the stress when every strain is free, at pressure 1e-8."""
    run = _jammed(1e-8, "free")
    return float(run.report["stress_anisotropy"]) if run.ok else math.inf


def _tiny_box() -> float:
    """Wrong answers for one disc in its own triangular cell, jammed by its own images, in a tilted description."""
    cell = lattice_packing("triangular", repeats=(1, 1))
    tilted = cell.replace(box=Box(cell.box.lattice_dd @ np.array([[1.0, 10.0], [0.0, 1.0]])))
    return float(sum(classify_jamming(one).strict != "jammed" for one in (cell, tilted)))


CASES = (
    *(
        HardCase(
            f"pressure {pressure:.0e}",
            "near jamming overlaps are small differences of large coordinates: forces drown in rounding",
            "residual over eight rounding errors of the box side over the overlap",
            1.0,
            "eight such errors are what counts as at rest; infinite if the pressure is off by 0.1 % or the run failed",
            partial(_imbalance, pressure),
        )
        for pressure in PRESSURES
    ),
    HardCase(
        "every strain free at 1e-8",
        "stress must vanish on each strain to a part of a pressure that is itself near rounding",
        "largest deviatoric stress over pressure",
        1e-8,
        "what strain-free packings promise; rounding is 2e-7 of one contact's force, far less of the mean of 120",
        _strain_free,
    ),
    HardCase(
        "rattler hanging by one contact",
        "a particle with one contact counts as held, or takes its neighbor down with it",
        "particles misjudged as rattling or held",
        0.0,
        "one contact cannot hold a disc, and carries no force at rest",
        _hanger_found,
    ),
    HardCase(
        "moduli with a hanging rattler",
        "its one spring and its zero mode spoil the inverse of the Hessian",
        "relative change of the stiffness matrix",
        1e-9,
        "the same linear system after the rattler is out: condition 1e5 x 2e-16, with two digits to spare",
        _hanger_moduli,
    ),
    *(
        HardCase(
            f"verdict of a redundant crystal, {name}",
            "many states of self stress: the certificate is not unique, the linear program degenerate",
            "wrong answers of three: collective, strict, all forces of the certificate positive",
            0.0,
            "jammed in every respect (Torquato and Stillinger, Rev. Mod. Phys. 82, 2633, table II)",
            partial(_redundant, name, repeats),
        )
        for name, repeats in (("triangular", (6, 6)), ("fcc", (3, 3, 3)))
    ),
    *(
        HardCase(
            f"isostatic less its {which} contact",
            "rank alone still sees a rigid network",
            "wrong answers of two: collective, strict",
            0.0,
            "2N' - 2 contacts bear no self stress: not jammed (d N' - d + 1 are needed)",
            partial(_one_contact_less, which),
        )
        for which in ("weakest", "median")
    ),
    HardCase(
        "one disc jammed by its own images",
        "a vacuous cell: no motion but translations, six self-contacts, a box described with tilt 10",
        "wrong answers of two",
        0.0,
        "the triangular crystal is strictly jammed",
        _tiny_box,
    ),
    HardCase(
        "Hessian that is not definite",
        "a saddle is factored as if it were a minimum and its moduli are returned without a word",
        "wrong claims of two about a pressed square crystal: stable, no negative mode",
        0.0,
        "only its contact forces answer a shear of the square crystal, and they push it over",
        _saddle,
    ),
)
