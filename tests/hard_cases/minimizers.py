"""Hard cases of minimizers: starts that overlap deeply or coincide, wide sizes, odd boxes and units, no convergence."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

import packmech as pm
from hard_cases.case import HARMONIC, HardCase

METHODS: dict[str, Any] = {
    "FIRE": pm.Fire(),
    "FIRE 2.0": pm.Fire2(),
    "conjugate gradient": pm.ConjugateGradient(),
    "L-BFGS": pm.LBFGS(),
    "damped dynamics": pm.DampedDynamics(),
    "gradient descent": pm.GradientDescent(),
}


def _residual(run: pm.Run) -> float:
    """Return the residual of a run that ended well with every number finite, else infinity."""
    finite = np.isfinite(run.packing.position_nd).all() and np.isfinite(run.residual)
    return run.residual if finite and run.ok else math.inf


def _coincident(method: Any) -> float:
    """24 discs at one point of a box in which they have room at a packing fraction of 0.9."""
    side = math.sqrt(24 * math.pi / 4 / 0.9)
    packing = pm.Packing(np.full((24, 2), 0.3), np.full(24, 0.5), pm.Box.cubic(side, 2))
    return _residual(pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-4, method=method, check=False))


def _deep(method: Any) -> float:
    """Quench a random start in which every disc overlaps a dozen others, and stays that dense."""
    packing = pm.random_packing(64, dimension=2, packing_fraction=3.0, seed=5)
    return _residual(pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-4, method=method, check=False))


def _diverging() -> float:
    """Random overlaps under a law that grows as r^-12."""
    packing = pm.random_packing(64, dimension=3, packing_fraction=0.7, seed=5)
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.RepulsiveLennardJones()),))
    return _residual(pm.quench(scene, force_tolerance=1e-6, check=False))


def _wide_sizes() -> float:
    """12 discs of diameter 1000 and 400 of diameter 1, quenched from random."""
    sizes = pm.Mixture(ratios=(1.0, 1000.0), fractions=(400.0, 12.0))
    packing = pm.random_packing(412, dimension=2, packing_fraction=0.9, sizes=sizes, seed=7)
    return _residual(pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-6, check=False))


def _start(seed: int = 9) -> pm.Packing:
    return pm.random_packing(48, dimension=2, packing_fraction=0.95, seed=seed)


def _tilted() -> float:
    """Relative difference of the final energy in a box given by tilted lattice vectors of the same lattice."""
    packing = _start()
    tilt = np.array([[1.0, 10.0], [0.0, 1.0]])
    tilted = packing.replace(box=pm.Box(packing.box.lattice_dd @ tilt))
    plain = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-12)
    other = pm.quench(pm.Scene(tilted, HARMONIC), force_tolerance=1e-12)
    reference = pm.energy(pm.Scene(plain.packing, HARMONIC))
    return float(abs(pm.energy(pm.Scene(other.packing, HARMONIC)) - reference) / reference)


def _flat() -> float:
    """Quench 30 discs in a box twenty times wider than a disc and a third as high."""
    rng = np.random.default_rng(3)
    box = pm.Box(np.array([[20.0, 0.1], [0.0, 0.35]]))
    position_nd = rng.random((30, 2)) @ box.lattice_dd.T
    scene = pm.Scene(pm.Packing(position_nd, np.full(30, 0.5), box), HARMONIC)
    return _residual(pm.quench(scene, force_tolerance=1e-8, check=False))


def _units(length: float) -> float:
    """Relative difference of the final energy in another unit of length and energy."""
    packing = _start()
    scaled = pm.Packing(packing.position_nd * length, packing.radius_n * length, packing.box.scaled(length))
    plain = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-12)
    scene = pm.Scene(scaled, (pm.Repulsion(law=pm.Harmonic(energy_scale=length)),))
    run = pm.quench(scene, force_tolerance=1e-12)
    reference = pm.energy(pm.Scene(plain.packing, HARMONIC))
    return float(abs(pm.energy(scene.replace(packing=run.packing)) / length - reference) / reference)


def _hopeless(method: Any) -> float:
    """How many of three runs that cannot converge claim to have converged, or do not raise when asked to."""
    scene = pm.Scene(_start(), HARMONIC)
    wrong = 0
    for limits in ({"step_limit": 3}, {"step_limit": 0}, {"time_limit": 1e-9, "step_limit": 40}):
        options = {"force_tolerance": 1e-10, "method": method, **limits}
        run = pm.quench(scene, check=False, **options)
        try:
            pm.quench(scene, **options)
            raised = False
        except pm.NotConverged as failure:
            raised = failure.run.residual > 1e-10
        wrong += run.ok or not raised or not np.isfinite(run.packing.position_nd).all()
    return float(wrong)


def _beyond_rounding() -> float:
    """Largest net force over mean contact force when a tolerance of 1e-300 is asked for: it must end, at the floor."""
    run = pm.quench(pm.Scene(_start(), HARMONIC), force_tolerance=1e-300)
    return run.residual if run.outcome.name == "ROUNDING_FLOOR" else math.inf


CASES = (
    *(
        HardCase(
            f"coincident start, {name}",
            "the force between coincident centers has no direction: NaN, or nobody moves",
            "residual of the quench of 24 discs that start at one point (infinite if lost or not converged)",
            1e-4,
            "the tolerance asked for",
            partial(_coincident, method),
        )
        for name, method in METHODS.items()
    ),
    *(
        HardCase(
            f"deep overlaps, {name}",
            "the first steps fling particles out, or several times around, the box",
            "residual of the quench of a random start at packing fraction 3 (infinite if lost or not converged)",
            1e-4,
            "the tolerance asked for",
            partial(_deep, method),
        )
        for name, method in METHODS.items()
    ),
    HardCase(
        "random start under a diverging law",
        "r^-12 at r near 0 overflows",
        "residual of the quench (infinite if lost or not converged)",
        1e-6,
        "the tolerance asked for",
        _diverging,
    ),
    HardCase(
        "size ratio 1000, quench",
        "one step length for all is too long for the small or too short for the large",
        "residual of the quench of 12 discs of 1000 and 400 of 1 (infinite if lost or not converged)",
        1e-6,
        "the tolerance asked for",
        _wide_sizes,
    ),
    HardCase(
        "box tilted by 10, quench",
        "neighbors and images differ, the physics must not",
        "relative difference of the final energy to the square box",
        1e-12,
        "the same minimum: energies agree to rounding, positions 10 boxes away lose 2e-16 x 100 over overlaps of 0.1",
        _tilted,
    ),
    HardCase(
        "nearly flat box, quench",
        "particles touch their own images, whose forces cancel but whose stiffness does not",
        "residual of the quench (infinite if lost or not converged)",
        1e-8,
        "the tolerance asked for",
        _flat,
    ),
    *(
        HardCase(
            f"units of {length:.0e}, quench",
            "absolute tolerances and time steps hidden in the minimizer",
            "relative difference of the final energy to ordinary units",
            1e-12,
            "the same minimum: scaled positions differ by rounding, energies by its square and their own sum",
            partial(_units, length),
        )
        for length in (1e-12, 1e12)
    ),
    *(
        HardCase(
            f"no time to converge, {name}",
            "a run that was cut short passes for a minimum",
            "runs of three (3 steps, none, no time) that claim success or do not raise",
            0.0,
            "a failure must be reported as one",
            partial(_hopeless, method),
        )
        for name, method in METHODS.items()
    ),
    HardCase(
        "tolerance below rounding",
        "the minimizer never ends, or claims the impossible",
        "residual at the rounding floor (infinite if another outcome is claimed)",
        1e-12,
        "coordinates of 7 diameters round by 9e-16 each; a dozen of them over mean overlaps of 0.05 is 2e-13",
        _beyond_rounding,
    ),
)
