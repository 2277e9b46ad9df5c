"""Hard cases of jamming: pressures from 0.1 to 1e-9, rattlers, gaps, tiny boxes, and solvers that lie."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from packmech.linalg.linear_programs import SOLVE, LinearProgram, Solution

EPS = float(np.finfo(float).eps)
PRESSURES = tuple(10.0**-k for k in range(1, 10))


@cache
def _jammed(pressure: float = 1e-8, strain: str = "isotropic") -> pm.Run:
    packing = pm.random_packing(64, dimension=2, packing_fraction=0.87, seed=4)
    return pm.jam(pm.Scene(packing, HARMONIC), pressure=pressure, strain=strain, check=False)


def _imbalance(pressure: float) -> float:
    """Residual over what rounding allows at this pressure, infinite for another pressure or a failure."""
    run = _jammed(pressure)
    scene = pm.Scene(run.packing, HARMONIC)
    reached = float(run.report["pressure"])
    if not run.ok or abs(reached / pressure - 1.0) > 1e-3:
        return math.inf
    side = float(run.packing.box.lattice_dd.max())
    overlap = pressure / scene.pressure_unit
    return float(run.residual / (8.0 * EPS * side / overlap))


def _with_hanger() -> tuple[pm.Packing, int]:
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
        if distance[nearest] > 0.01 and not pm.find_rattlers(packing)[nearest]:
            # straight towards the nearest disc until they overlap a little
            way = vector[nearest] / np.linalg.norm(vector[nearest])
            hung = center + way * (distance[nearest] + 1e-8)
            position_nd = np.vstack([packing.position_nd, hung])
            return pm.Packing(position_nd, np.append(packing.radius_n, radius), packing.box), len(position_nd) - 1
    raise RuntimeError("no hole was found")


def _hanger_found() -> float:
    packing, last = _with_hanger()
    before = pm.find_rattlers(_jammed().packing)
    return float(np.count_nonzero(pm.find_rattlers(packing) != np.append(before, True)))


def _hanger_moduli() -> float:
    packing, _ = _with_hanger()
    with warnings.catch_warnings():
        # that the one that hangs is pushed is the case
        warnings.filterwarnings("ignore", "scene should be at rest")
        with_it = pm.elastic_moduli(pm.Scene(packing, HARMONIC)).cauchy
    without = pm.elastic_moduli(pm.Scene(_jammed().packing, HARMONIC)).cauchy
    return float(np.abs(with_it - without).max() / np.abs(without).max())


def _redundant(name: str, repeats: tuple[int, ...]) -> float:
    """Count wrong answers about a crystal with many more contacts than it needs: verdicts and certificate."""
    verdict = pm.classify_jamming(pm.lattice_packing(name, repeats=repeats))
    wrong = (verdict.collective != "jammed") + (verdict.strict != "jammed")
    force_c = verdict.contact_force_c
    return float(wrong + (force_c is None or force_c.min() <= 0.0))


def _one_contact_less(which: str) -> float:
    """Wrong answers when one force-bearing contact of a packing with one state of self stress is taken away."""
    packing = _jammed().packing
    complete = pm.classify_jamming(packing)
    if complete.collective != "jammed" or complete.collectively.states_of_self_stress != 1:
        return math.inf
    force_c = complete.contact_force_c
    if force_c is None:
        return math.inf
    order = np.argsort(force_c)
    gone = int(order[0 if which == "weakest" else len(order) // 2])
    verdict = pm.classify_jamming(packing, contacts=complete.network.select(np.arange(len(order)) != gone))
    return float((verdict.collective != "not jammed") + (verdict.strict != "not jammed"))


def _saddle() -> float:
    """Whether a packing at a saddle passes as stable: a square crystal, pressed, is unstable to shear."""
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.01)
    moduli = pm.elastic_moduli(pm.Scene(crystal, HARMONIC))
    return float(moduli.stable) + float(moduli.negative_modes == 0)


def _strain_free() -> float:
    """Anisotropy of the stress when every strain is free, at pressure 1e-8."""
    run = _jammed(1e-8, "free")
    return float(run.report["stress_anisotropy"]) if run.ok else math.inf


def _tiny_box() -> float:
    """Wrong answers for one disc in its own triangular cell, jammed by its own images, in a tilted description."""
    cell = pm.lattice_packing("triangular", repeats=(1, 1))
    tilted = cell.replace(box=pm.Box(cell.box.lattice_dd @ np.array([[1.0, 10.0], [0.0, 1.0]])))
    return float(sum(pm.classify_jamming(one).strict != "jammed" for one in (cell, tilted)))


JAMMED, NOT_JAMMED, AMBIGUOUS = "jammed", "not jammed", "ambiguous"
METHODS = ("certificate", "loads")
# relative gaps of one contact, and what the gap tolerance of 1e-9 with its tenth and its tenfold makes of them
GAPS = {
    1e-12: JAMMED,
    5e-11: JAMMED,
    5e-10: AMBIGUOUS,
    5e-9: AMBIGUOUS,
    1e-7: NOT_JAMMED,
    1e-6: NOT_JAMMED,
    1e-5: NOT_JAMMED,
    1e-4: NOT_JAMMED,
}


@cache
def isostatic() -> tuple[pm.Packing, pm.Contacts]:
    """Return a jammed packing without rattlers that has one state of self stress, and its contacts.

    Raises
    ------
    ValueError
        If no such packing was made.

    """
    for seed in range(20):
        start = pm.random_packing(32, dimension=2, packing_fraction=0.87, seed=seed)
        run = pm.jam(
            pm.Scene(start, (pm.Repulsion(law=pm.Harmonic()),)), pressure=1e-8, strain="isotropic", check=False
        )
        if run.ok and not pm.find_rattlers(run.packing).all():
            backbone, _ = pm.remove_rattlers(run.packing)
            contacts = pm.find_contacts(backbone, gap_tolerance=0.0)
            if len(contacts) == 2 * backbone.particles - 1:
                return backbone, contacts
    raise ValueError("packing must have one contact more than degrees of freedom, got none in twenty")


def with_gaps(gap_c: NDArray[np.float64]) -> pm.Packing:
    """Return the packing of `isostatic` with the given relative gaps, from -1 [1], moved and swollen to fit them.

    Positions but for a translation, and one factor of all radii, are as many unknowns as there are gaps.

    Parameters
    ----------
    gap_c
        (C,) gaps over contact distances; negative ones overlap.

    """
    packing, contacts = isostatic()
    place, size = packing.position_nd, 1.0
    sigma = contacts.contact_distance_c
    for _ in range(6):
        now = packing.replace(position_nd=place)
        vector = place[contacts.j_c] - place[contacts.i_c] + contacts.image_cd @ packing.box.lattice_dd.T
        distance = np.sqrt((vector**2).sum(axis=1))
        bent = replace(contacts, normal_cd=vector / distance[:, None], distance_c=distance)
        matrix = np.hstack([pm.rigidity_matrix(now, "none", contacts=bent).toarray(), -sigma[:, None]])
        step = np.linalg.lstsq(matrix, (size + gap_c) * sigma - distance, rcond=1e-12)[0]
        place, size = place + step[:-1].reshape(place.shape), size + step[-1]
    return packing.replace(position_nd=place, radius_n=size * packing.radius_n)


def three_in_a_hole() -> pm.Packing:
    """Return a crystal with three discs wedged in a vacancy: each held, all pushed, free to turn together."""
    crystal = pm.lattice_packing("triangular", (6, 6))
    side, hole = 2.0 * float(crystal.radius_n[0]), 14
    out = 0.5 / (1.0 + math.sqrt(0.75))
    angle = 2.0 * np.pi / 3.0 * np.arange(3)
    three = crystal.position_nd[hole] + side * out * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rest = np.arange(crystal.particles) != hole
    radius = np.append(crystal.radius_n[rest], [side * (0.5 - out)] * 3)
    return pm.Packing(np.vstack([crystal.position_nd[rest], three]), radius, crystal.box)


def _wrong(packing: pm.Packing, collective: str, strict: str | None = None, **options: float) -> int:
    """Count wrong answers of both methods; `strict` is not asked for where it is None."""
    wrong = 0
    for method in METHODS:
        verdict = pm.classify_jamming(packing, method=method, **options)
        wrong += verdict.collective != collective
        wrong += strict is not None and verdict.strict != strict
    return wrong


def _one_gap(gap: float) -> float:
    """Count contacts whose gap, all others closed, gets another answer than its size deserves."""
    count = len(isostatic()[1])
    wrong = 0
    for contact in range(0, count, max(1, count // 5)):
        gap_c = np.zeros(count)
        gap_c[contact] = gap
        wrong += _wrong(with_gaps(gap_c), GAPS[gap])
    return float(wrong)


def _all_gaps(gap: float) -> float:
    """Wrong answers where all contacts are open alike, by the rule and with a tolerance that covers the gaps."""
    packing = with_gaps(np.full(len(isostatic()[1]), gap))
    return float(_wrong(packing, GAPS[gap]) + _wrong(packing, JAMMED, gap_tolerance=3.0 * gap))


def _rattlers_kept() -> float:
    """Wrong answers, and rattlers misjudged, when discs are put into holes of a crystal that is jammed without them."""
    packing = three_in_a_hole()
    crystal = packing.particles - 3
    lone = packing.replace(position_nd=packing.position_nd[: crystal + 1], radius_n=packing.radius_n[: crystal + 1])
    wrong = 0
    for one in (packing, lone):
        wrong += _wrong(one, JAMMED, JAMMED)
        for method in METHODS:
            rattlers = pm.classify_jamming(one, method=method).rattlers
            wrong += int(np.count_nonzero(rattlers != (np.arange(one.particles) >= crystal)))
    return float(wrong)


def _tiny_cells() -> float:
    """Count wrong answers about crystals of one or two particles, which touch their own images, in skew cells too."""
    wrong = 0
    for name, dimension, collective, strict in (
        ("triangular", 2, JAMMED, JAMMED),
        ("square", 2, JAMMED, NOT_JAMMED),
        ("fcc", 3, JAMMED, JAMMED),
    ):
        cell = pm.lattice_packing(name, (1,) * dimension)
        skew = np.eye(dimension)
        skew[0, 1:] = 7.0
        for one in (cell, cell.replace(box=pm.Box(cell.box.lattice_dd @ skew))):
            wrong += _wrong(one, collective, strict)
    for name, repeats, answer in (("triangular", (2, 1), JAMMED), ("square", (2, 1), NOT_JAMMED)):
        wrong += _wrong(pm.lattice_packing(name, repeats), answer, answer)
    return float(wrong)


def _shaken(size: float) -> float:
    """Count answers other than ambiguous for a packing shaken off its rest by `size` of a diameter."""
    packing = with_gaps(np.full(len(isostatic()[1]), -1e-6))
    noise = size * packing.reference_diameter * np.random.default_rng(1).standard_normal(packing.position_nd.shape)
    return float(_wrong(packing.replace(position_nd=packing.position_nd + noise), AMBIGUOUS, AMBIGUOUS))


class Liar(Protocol):
    """A solver in form only."""

    def __call__(self, program: LinearProgram, tolerance: float) -> Solution:
        """Return what it calls a solution."""


def _stalled(program: LinearProgram, tolerance: float) -> Solution:
    """Return a start of zeros, called the solution."""
    solve = pm.Solve(pm.Outcome.CONVERGED, residual=0.0, gap=0.0, status="claims a solution")
    rows, below = program.equal.shape[0], program.below.shape[0]
    return Solution(np.zeros(len(program.cost)), np.zeros(rows), np.zeros(below), 0.0, solve)


def _infeasible(program: LinearProgram, tolerance: float) -> Solution:
    """Return that there is no solution, with random multipliers for a proof."""
    found = _stalled(program, tolerance)
    solve = replace(found.solve, outcome=pm.Outcome.INFEASIBLE, status="claims that there is no solution")
    random = np.random.default_rng(0).standard_normal(program.equal.shape[0])
    return replace(found, equal_multiplier=random, solve=solve)


def _made_up(program: LinearProgram, tolerance: float) -> Solution:
    """Return random positive numbers, called the solution."""
    found = _stalled(program, tolerance)
    rng = np.random.default_rng(0)
    return replace(
        found,
        x=np.clip(rng.random(len(program.cost)), program.lower, program.upper),
        equal_multiplier=rng.standard_normal(program.equal.shape[0]),
        below_multiplier=rng.random(program.below.shape[0]),
    )


@contextmanager
def lying(*names: str, liar: Liar) -> Iterator[None]:
    """Put a solver that reports the wrong status in the place of the named ones.

    Parameters
    ----------
    names
        Of the solvers replaced: "clarabel", "highs".
    liar
        What is put there.

    """
    kept = dict(SOLVE)

    SOLVE.update(dict.fromkeys(names, liar))
    try:
        yield
    finally:
        SOLVE.update(kept)


def _lied_to(liar: Liar, method: str) -> float:
    """Count false answers about jammed and unjammed packings when every solver lies; ambiguous is not false."""
    count = len(isostatic()[1])
    one_open = np.zeros(count)
    one_open[count // 2] = 1e-6
    false = 0
    with lying("clarabel", "highs", liar=liar):
        for packing, collective in (
            (with_gaps(np.zeros(count)), JAMMED),
            (with_gaps(one_open), NOT_JAMMED),
            (pm.lattice_packing("triangular", (3, 3)), JAMMED),
            (pm.lattice_packing("square", (3, 3)), NOT_JAMMED),
        ):
            false += pm.classify_jamming(packing, method=method).collective not in (collective, AMBIGUOUS)
    return float(false)


def _one_liar(liar: Liar, method: str) -> float:
    """Count wrong answers when only the interior-point solver lies: simplex has the last word."""
    packing = with_gaps(np.zeros(len(isostatic()[1])))
    with lying("clarabel", liar=liar):
        return float(pm.classify_jamming(packing, method=method).collective != JAMMED)


def _emptied() -> float:
    """Count answers other than "not jammed (empty backbone)" where everything rattles or is taken out."""
    packing, _ = isostatic()
    dilute = packing.replace(radius_n=0.9 * packing.radius_n)
    wrong = 0
    for method in METHODS:
        verdict = pm.classify_jamming(dilute, method=method)
        answers = (str(verdict.collectively), str(verdict.strictly))
        wrong += answers != ("not jammed (empty backbone)",) * 2 or verdict.local != NOT_JAMMED
        wrong += not verdict.rattlers.all()
    square = pm.classify_jamming(pm.lattice_packing("square", (3, 3)), method="loads")
    return float(wrong + (str(square.collectively) != "not jammed (empty backbone)"))


LIES = {"a start of zeros": _stalled, "no solution": _infeasible, "made up numbers": _made_up}


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
    *(
        HardCase(
            f"one contact of a jammed packing open by {gap:.0e}",
            "the answer turns on whether a gap counts, and is given without a word about it",
            "wrong answers, six contacts in turn, both methods",
            0.0,
            f"one state of self stress needs every contact; gaps of 1e-10 to 1e-8 are in doubt: {answer}",
            partial(_one_gap, gap),
        )
        for gap, answer in GAPS.items()
    ),
    *(
        HardCase(
            f"all contacts of a jammed packing open by {gap:.0e}",
            "nothing touches, so nothing is jammed, or everything is although there is room",
            "wrong answers of four: by the rule, and with a tolerance of three such gaps",
            0.0,
            f"by the rule {answer}; with a tolerance that covers the gaps: jammed",
            partial(_all_gaps, gap),
        )
        for gap, answer in GAPS.items()
    ),
    HardCase(
        "rattlers kept",
        "a disc in a hole, or three that hold one another there and turn, unjam everything around them",
        "wrong answers, and particles misjudged as rattling or held",
        0.0,
        "the crystal around a vacancy is jammed by itself, so what moves in the hole rattles",
        _rattlers_kept,
    ),
    HardCase(
        "tiny cells with self-images",
        "contacts with own images count once, twice or not at all; one particle has no motion but translations",
        "wrong answers of 32",
        0.0,
        "one triangular or face-centered cell is strictly jammed, one square cell collectively only, two of it are not",
        _tiny_cells,
    ),
    *(
        HardCase(
            f"a packing {size:.0e} of a diameter off its rest",
            "forces out of balance open contacts that a better converged packing has: not jammed by accident",
            "answers other than ambiguous, of four",
            0.0,
            "overlaps of 1e-6 leave net forces above 1e-5 of the mean",
            partial(_shaken, size),
        )
        for size in (1e-10, 1e-8)
    ),
    *(
        HardCase(
            f"every solver lies, {lie}, {method}",
            "a solver reports the wrong status, and is believed",
            "false answers of four; ambiguous is not false",
            0.0,
            "answers rest on forces and motions that were checked, not on a status",
            partial(_lied_to, liar, method),
        )
        for lie, liar in LIES.items()
        for method in METHODS
    ),
    *(
        HardCase(
            f"one solver lies, {lie}, {method}",
            "a solver reports the wrong status, and is believed",
            "wrong answers of one",
            0.0,
            "an answer that fails its check is asked for again, of simplex",
            partial(_one_liar, liar, method),
        )
        for lie, liar in LIES.items()
        for method in METHODS
    ),
    HardCase(
        "an empty backbone",
        "taking out what moves, again and again, ends with nothing, and nothing moves there: jammed",
        "answers other than: not jammed (empty backbone)",
        0.0,
        "particles that touch nothing, and crystals that move everywhere, have no backbone",
        _emptied,
    ),
)
