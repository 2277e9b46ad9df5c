"""Hard cases of pressures from 1e-9 to 1e-12, whose overlaps differences of coordinates hardly show.

Every figure of forces here is from exact arithmetic (`exact_forces`), of the displaced packing and, for the naive way,
of the same packing after its coordinates were rounded to double precision.
"""

from __future__ import annotations

import math
from functools import cache, partial

import numpy as np

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from hard_cases.exact import as_it_stands, exact_forces

PRESSURES = (1e-9, 1e-10, 1e-11, 1e-12)
FRACTION = {2: 0.87, 3: 0.68}


@cache
def _jammed(particles: int, dimension: int = 2, pressure: float = 1e-9, strain: pm.BoxStrain = "isotropic") -> pm.Run:
    start = pm.random_packing(particles, dimension=dimension, packing_fraction=FRACTION[dimension], seed=4)
    return pm.jam(pm.Scene(start, HARMONIC), pressure=pressure, strain=strain, check=False)


@cache
def _displaced(
    particles: int, pressure: float, dimension: int = 2, start: float = 1e-9, strain: pm.BoxStrain = "isotropic"
) -> pm.DisplacedRest:
    packing = _jammed(particles, dimension, start, strain).packing
    return pm.displaced_rest(pm.Scene(packing, HARMONIC), pressure=pressure, strain=strain, force_tolerance=6e-11)


def _residual(particles: int, pressure: float, dimension: int = 2, strain: pm.BoxStrain = "isotropic") -> float:
    """Exact residual, infinite at another pressure."""
    fine = _displaced(particles, pressure, dimension, strain=strain)
    return exact_forces(fine).residual if abs(fine.pressure / pressure - 1.0) < 1e-10 else math.inf


def _rounded(particles: int, pressure: float, dimension: int = 2, strain: pm.BoxStrain = "isotropic") -> float:
    """Residual of forces from the absolute positions, reference and displacement added up."""
    fine = _displaced(particles, pressure, dimension, strain=strain)
    return pm.contact_forces(pm.Scene(fine.packing, HARMONIC)).residual


def _force_error(particles: int, pressure: float) -> float:
    return exact_forces(_displaced(particles, pressure)).force_error


def _rounded_force_error(particles: int, pressure: float) -> float:
    fine = _displaced(particles, pressure)
    return exact_forces(as_it_stands(fine.packing, fine.contacts.at(fine.packing))).force_error


def _pressure_law() -> float:
    """How far forces are from proportional to the pressure over three decades, relative to the mean force."""
    high, low = (_displaced(256, pressure) for pressure in (1e-9, 1e-12))
    if not np.array_equal(np.column_stack(high.contacts.pairs[:2]), np.column_stack(low.contacts.pairs[:2])):
        return math.inf
    scaled = 1e-3 * high.normal_c
    return float(np.abs(low.normal_c - scaled).max() / scaled.mean())


def _rounded_law() -> float:
    high, low = (_displaced(256, pressure) for pressure in (1e-9, 1e-12))
    scaled, stands = 1e-3 * high.normal_c, high.contacts.at(low.packing)
    found = -stands.gap_c / stands.contact_distance_c**2
    return float(np.abs(found - scaled).max() / scaled.mean())


def _hertzian() -> float:
    """Residual at 1e-15, where Hertz's law asks for overlaps of 1e-10."""
    scene = pm.Scene(_jammed(256).packing, (pm.Repulsion(law=pm.Hertz()),))
    jammed = pm.jam(scene, pressure=1e-15, strain="isotropic", check=False)
    return pm.displaced_rest(scene.replace(packing=jammed.packing), pressure=1e-15).residual


def _hertzian_rounded() -> float:
    scene = pm.Scene(_jammed(256).packing, (pm.Repulsion(law=pm.Hertz()),))
    return pm.jam(scene, pressure=1e-15, strain="isotropic", check=False).residual


def _floor(particles: int) -> float:
    """Exact residual of a packing at 1e-12 over the floor that its run reports; infinite for a better outcome."""
    run = _jammed(particles, 2, 1e-12)
    if run.outcome is not pm.Outcome.ROUNDING_FLOOR:
        return math.inf
    touching = pm.find_contacts(run.packing, gap_tolerance=0.0)
    return exact_forces(as_it_stands(run.packing, touching)).residual / float(run.report["rounding_floor"])


def _false_outcomes() -> float:
    """How many of three packings, certified as hard ones, are not jammed at 1e-12 by outcome or collective verdict."""
    false = 0
    for seed in (4, 5, 6):
        start = pm.random_packing(1024, dimension=2, packing_fraction=FRACTION[2], seed=seed)
        run = pm.jam(pm.Scene(start, HARMONIC), pressure=1e-12, strain="isotropic", check=False)
        false += run.report["floppy_modes"] != 0 or run.outcome is pm.Outcome.NOT_JAMMED
        false += pm.classify_jamming(run.packing).collective == "not jammed"
    return float(false)


WHY = "asked for as 6e-11 of forces that are known to 1e-13 of a thousand overlaps; infinite for another pressure"
LOST = "residual of the displaced packing in exact arithmetic"
RISK = "overlaps are small differences of large coordinates: whatever is done, four digits of them are left, or none"

CASES = (
    *(
        HardCase(
            f"pressure {pressure:.0e}, {particles} {'discs' if dimension == 2 else 'spheres'}, displacements",
            RISK,
            LOST,
            1e-10,
            WHY,
            partial(_residual, particles, pressure, dimension),
            partial(_rounded, particles, pressure, dimension),
        )
        for particles, dimension in ((64, 2), (1024, 2), (256, 3))
        for pressure in (PRESSURES if particles != 64 else PRESSURES[-1:])
    ),
    HardCase(
        "pressure 1e-12, every strain free, displacements",
        RISK,
        LOST,
        1e-10,
        "asked for as 6e-11, for the missing stress on each of three strains, too",
        partial(_residual, 256, 1e-12, strain="free"),
        partial(_rounded, 256, 1e-12, strain="free"),
    ),
    HardCase(
        "pressure 1e-12, single forces, 1024 discs",
        RISK,
        "largest error of a force against exact arithmetic, over the mean force",
        1e-10,
        "gaps that change from 1e-9 are a thousand overlaps, each rounded by 2e-16, where soft by a hundred more",
        partial(_force_error, 1024, 1e-12),
        partial(_rounded_force_error, 1024, 1e-12),
    ),
    HardCase(
        "forces in proportion to pressures of 1e-9 and 1e-12",
        "a network of one state of self stress has one set of forces: what differs is rounding, or a lost contact",
        "largest difference from a thousandth of the forces at 1e-9, over the mean; infinite for other contacts",
        1e-5,
        "contacts turn by overlaps of 1e-9 times the softness of the network, up to 1e4",
        _pressure_law,
        _rounded_law,
    ),
    HardCase(
        "Hertz's law at pressure 1e-15",
        "the law sees a distance, in which an overlap of 1e-10 has six digits",
        "residual of the displaced packing",
        1e-10,
        "asked for as 1e-10; the law is continued as the power that it is from the rounded overlap to the exact one",
        _hertzian,
        _hertzian_rounded,
    ),
    *(
        HardCase(
            f"pressure 1e-12 in absolute positions, {particles} discs",
            "a run claims a tolerance that its coordinates cannot have, or reports a floor that is none",
            "residual in exact arithmetic over the reported floor (infinite for another outcome than ROUNDING_FLOOR)",
            8.0,
            "eight floors are what counts as at rest: spacings of a dozen coordinates that add up at random",
            partial(_floor, particles),
            "nothing reported: forces that look like balance to 1e-3 of the mean",
        )
        for particles in (64, 256)
    ),
    HardCase(
        "jammed at 1e-12 or not, 1024 discs",
        "a contact that bears less than rounding is lost, and with one contact less nothing is held",
        "false answers of six: outcomes NOT_JAMMED, verdicts not jammed, of packings certified at zero pressure",
        0.0,
        "the hard packing nearby is jammed by certificate; what rounding hides may be doubted, not denied",
        _false_outcomes,
    ),
)
