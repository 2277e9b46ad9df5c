"""Hard cases of sizes: ratios of 300 to 1000 that jam, search among them in space, thousands of two exact radii."""

from __future__ import annotations

import math
from functools import cache, partial

import numpy as np

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from hard_cases.static import every_pair, key_list


@cache
def _jammed(ratio: float, small: int, large: int, seed: int) -> pm.Run:
    """Return a mixture jammed at a pressure that presses the large ones by some 1e-4 of their diameter."""
    sizes = pm.Mixture(ratios=(1.0, ratio), fractions=(float(small), float(large)))
    start = pm.random_packing(small + large, dimension=2, packing_fraction=0.87, sizes=sizes, seed=seed)
    return pm.jam(pm.Scene(start, HARMONIC), pressure=1e-4 / ratio**2, strain="isotropic", check=False)


def _imbalance(*which: int) -> float:
    """Residual over eight floors of rounding, infinite unless jammed at the pressure asked for, the large ones held."""
    run = _jammed(*which)
    held = ~pm.find_rattlers(run.packing)
    large = run.packing.radius_n > run.packing.radius_n.min() * 2.0
    if not run.ok or held[large].mean() < 0.9 or abs(float(run.report["pressure"]) * which[0] ** 2 / 1e-4 - 1.0) > 1e-5:
        return math.inf
    there = pm.contact_forces(pm.Scene(run.packing, HARMONIC)).residual
    return there / (8.0 * float(run.report["rounding_floor"]))


def _quenched(*which: int) -> float:
    """Return the residual, over the same, at which FIRE reached its limit of steps."""
    run = _jammed(*which)
    return run.stages[0].residual / (8.0 * float(run.report["rounding_floor"]))


def _displaced(*which: int) -> float:
    scene = pm.Scene(_jammed(*which).packing, HARMONIC)
    return pm.displaced_rest(scene, pressure=1e-6 / which[0] ** 2).residual


def _rounded(*which: int) -> float:
    scene = pm.Scene(_jammed(*which).packing, HARMONIC)
    there = pm.displaced_rest(scene, pressure=1e-6 / which[0] ** 2).packing
    return pm.contact_forces(scene.replace(packing=there)).residual


def _false_verdicts(*which: int) -> float:
    """False answers of four: the packing, without what is small, and less one contact that bears; ambiguous is none."""
    packing = _jammed(*which).report["hard_packing"]
    large = packing.radius_n > packing.radius_n.min() * 2.0
    alone = packing.select(np.flatnonzero(large))
    whole, without = pm.classify_jamming(packing), pm.classify_jamming(alone)
    false = (whole.collective == "not jammed") + (without.collective == "not jammed")
    false += int(whole.rattlers[large].sum() != without.rattlers.sum())
    force_c = without.contact_force_c
    if force_c is None or without.collectively.states_of_self_stress != 1:
        return math.inf
    kept = np.arange(len(force_c)) != int(np.argmax(force_c))
    less = pm.classify_jamming(alone, contacts=without.network.select(kept))
    return float(false + (less.collective == "jammed"))


def _spheres() -> pm.Packing:
    """Return 3 spheres of diameter 1000 and 300 of 1 on and around their surfaces."""
    rng, side = np.random.default_rng(3), 2500.0
    large = rng.random((3, 3)) * side
    way = rng.normal(size=(300, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    small = large[rng.integers(0, 3, 300)] + way * (500.0 + rng.uniform(-0.4, 0.6, 300))[:, None]
    radius = np.concatenate([np.full(3, 500.0), np.full(300, 0.5)])
    return pm.Packing(np.vstack([large, small]), radius, pm.Box.cubic(side, 3))


def _broad() -> pm.Packing:
    """Return 400 discs whose radii are spread evenly over five decades of length, at random."""
    rng = np.random.default_rng(4)
    radius = 10.0 ** rng.uniform(-4.0, 1.0, 400)
    return pm.Packing(rng.random((400, 2)) * 60.0, radius, pm.Box(np.array([[60.0, 25.0], [0.0, 60.0]])))


def _wrong_contacts(packing: pm.Packing) -> float:
    return float(len(set(key_list(packing)) ^ set(every_pair(packing, 1))))


@cache
def _thousands() -> pm.Run:
    start = pm.random_packing(4096, dimension=2, packing_fraction=0.87, seed=1)
    return pm.jam(pm.Scene(start, HARMONIC), pressure=1e-8, strain="isotropic", check=False)


def _two_radii() -> float:
    """Residual of 4096 discs over eight floors; infinite unless jammed, with two radii and their redundant patches.

    Contacts beyond one state of self stress must all lie in patches that the run names.
    """
    run = _thousands()
    hard = run.report["hard_packing"]
    surplus = int(run.report["hard_excess_contacts"])
    if not run.ok or len(np.unique(hard.radius_n)) != 2 or (surplus > 0) != (len(run.report["patches"]) > 0):
        return math.inf
    return run.residual / max(8.0 * float(run.report["rounding_floor"]), 1e-5)


def _two_radii_verdict() -> float:
    """False answers of two about 4096 discs, pressed and hard; ambiguous is none."""
    run = _thousands()
    packings = (run.packing, run.report["hard_packing"])
    return float(sum(pm.classify_jamming(one).collective == "not jammed" for one in packings))


MIXED = ((300, 400, 12, 7), (1000, 100, 12, 7), (1000, 200, 24, 5))
NAMES = {one: f"{one[2]} discs of {one[0]} among {one[1]} of 1" for one in MIXED}

CASES = (
    *(
        HardCase(
            f"jammed: {NAMES[which]}",
            "one time step and one tolerance for forces that differ by a million; small ones are lost between large",
            "residual over eight floors of rounding (infinite unless jammed at the pressure, the large ones held)",
            1.0,
            "eight floors are what counts as at rest",
            partial(_imbalance, *which),
            partial(_quenched, *which),
        )
        for which in MIXED
    ),
    *(
        HardCase(
            f"displacements: {NAMES[which]}",
            "coordinates of 4000 are rounded by half a millionth of the overlaps of the large",
            "residual at a hundredth of the pressure",
            1e-10,
            "asked for as 1e-10",
            partial(_displaced, *which),
            partial(_rounded, *which),
        )
        for which in MIXED[:2]
    ),
    HardCase(
        f"verdicts: {NAMES[MIXED[2]]}",
        "gaps between small ones are a thousandth of those between large, and so are their motions",
        "false answers of four: whole, only the large ones, their rattlers, less one contact that bears",
        0.0,
        "certified by the search; small ones that rattle hold nothing; one state of self stress needs every contact",
        partial(_false_verdicts, *MIXED[2]),
    ),
    HardCase(
        "size ratio 1000 in space, contacts",
        "cells as large as the largest particle, or images cut at the smallest",
        "contacts missing or invented against a test of every pair and image",
        0.0,
        "a count is right or wrong",
        lambda: _wrong_contacts(_spheres()),
    ),
    HardCase(
        "radii over five decades, contacts",
        "levels of cells between which a pair is looked for on neither, or on both",
        "contacts missing or invented against a test of every pair and image",
        0.0,
        "a count is right or wrong",
        lambda: _wrong_contacts(_broad()),
    ),
    HardCase(
        "4096 discs of two exact radii, jammed",
        "hexagonal patches close exactly: dozens of contacts too many, and forces that are not unique",
        "residual over eight floors of rounding or 1e-5 (infinite unless jammed and patches account for the surplus)",
        1.0,
        "what was asked for; eight floors are what counts as at rest",
        _two_radii,
        lambda: float(_thousands().stages[0].residual),
    ),
    HardCase(
        "4096 discs of two exact radii, verdicts",
        "a surplus of contacts is no proof, and a gap of 1e-9 is no contact",
        "false answers of two; ambiguous is none",
        0.0,
        "the hard packing is certified; at a pressure the answer may be in doubt, not denied",
        _two_radii_verdict,
    ),
)
