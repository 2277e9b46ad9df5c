"""Hard cases of ellipses and spheroids: needles of aspect 100, all but round ones, quartic modes at jamming."""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HARMONIC, HardCase

WIDE = np.longdouble
NEEDLE, ROUND = 100.0, 1.0 + 1e-9
_HALVINGS = 90


def wide_distance(vector_pd: Any, axes_pk: Any, director_pkd: Any) -> NDArray[Any]:
    """Return contact distances of pairs in extended precision: F = l (1 - l) n C^-1 n is largest, by bisection.

    C = (1 - l) A_i + l A_j with A = b^2 + (a^2 - b^2) mu mu of semi-axes a and b along and across the director mu.
    """
    vector, director = np.asarray(vector_pd, WIDE), np.asarray(director_pkd, WIDE)
    d = vector.shape[1]
    normal = vector / np.sqrt((vector**2).sum(axis=1))[:, None]
    director = director / np.sqrt((director**2).sum(axis=2))[:, :, None]
    square = np.asarray(axes_pk, WIDE) ** 2
    across, more = square[:, :, 1], square[:, :, 0] - square[:, :, 1]
    outer = director[:, :, :, None] * director[:, :, None, :]
    shape = across[:, :, None, None] * np.eye(d, dtype=WIDE) + more[:, :, None, None] * outer

    def solved(at: NDArray[Any]) -> NDArray[Any]:
        c = (1 - at)[:, None, None] * shape[:, 0] + at[:, None, None] * shape[:, 1]
        if d == 2:
            det = c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] ** 2
            x = c[:, 1, 1] * normal[:, 0] - c[:, 0, 1] * normal[:, 1]
            y = c[:, 0, 0] * normal[:, 1] - c[:, 0, 1] * normal[:, 0]
            return np.stack([x, y], axis=1) / det[:, None]
        rows = np.stack([np.cross(c[:, 1], c[:, 2]), np.cross(c[:, 2], c[:, 0]), np.cross(c[:, 0], c[:, 1])], axis=1)
        return (rows * normal[:, None]).sum(axis=2) / (c[:, 0] * rows[:, 0]).sum(axis=1)[:, None]

    low, high = np.zeros(len(vector), WIDE), np.ones(len(vector), WIDE)
    for _ in range(_HALVINGS):
        at = (low + high) / 2
        w = solved(at)
        pull = [np.einsum("pa,pab,pb->p", w, shape[:, k], w) for k in (0, 1)]
        below = (1 - at) ** 2 * pull[0] > at**2 * pull[1]
        low, high = np.where(below, at, low), np.where(below, high, at)
    at = (low + high) / 2
    return np.asarray(1 / np.sqrt(at * (1 - at) * (normal * solved(at)).sum(axis=1)))


def _axes(aspect: float, dimension: int, radius: float = 0.5) -> NDArray[np.float64]:
    across = radius / aspect ** (1.0 / dimension)
    return np.array([aspect * across, across])


@cache
def _pairs(aspect: float, dimension: int) -> tuple[NDArray[np.float64], ...]:
    """Return 500 pairs: vectors, semi-axes, directors; half of them turned from each other by 1e-9 to 1."""
    rng = np.random.default_rng(6)
    vector, director = rng.normal(size=(500, dimension)), rng.normal(size=(500, 2, dimension))
    director[:250, 1] = director[:250, 0] + 10.0 ** rng.uniform(-9, 0, (250, 1)) * director[:250, 1]
    return vector, np.broadcast_to(_axes(aspect, dimension), (500, 2, 2)), director


def _distance_error(aspect: float, dimension: int, level: str) -> float:
    vector, axes, director = _pairs(aspect, dimension)
    found = pm.contact_distance(vector, axes[:, 0], director[:, 0], axes[:, 1], director[:, 1], level=level)
    return float(np.abs(found / wide_distance(vector, axes, director) - 1).max())


def _from_discs(dimension: int) -> float:
    """Largest error of contact distances less that of discs, over the aspect less one."""
    vector, axes, director = _pairs(ROUND, dimension)
    found = pm.contact_distance(vector, axes[:, 0], director[:, 0], axes[:, 1], director[:, 1])
    exact = wide_distance(vector, axes, director)
    return float(np.abs((found - 1.0) - (exact - 1)).max() / (ROUND - 1.0))


def _closed_forms() -> float:
    """Largest relative error of needles end to end, side by side and one on the other's side: 2 a, 2 b, a + b."""
    a, b = _axes(NEEDLE, 2)
    x, y = [1.0, 0.0], [0.0, 1.0]
    cases = ((x, x, x, 2.0 * a), (x, y, y, 2.0 * b), (x, x, y, a + b), (y, x, y, a + b))
    worst = 0.0
    for way, one, other, exact in cases:
        found = pm.contact_distance([way], [[a, b]], [one], [[a, b]], [other])
        worst = max(worst, abs(float(found[0]) / exact - 1.0))
    return worst


def _pair_scene(aspect: float, angle: float) -> pm.Scene:
    """Return two overlapping ellipses, the second turned by an angle and nearer than contact by a hundredth."""
    director = np.array([[math.cos(0.2), math.sin(0.2)], [math.cos(0.2 + angle), math.sin(0.2 + angle)]])
    way = np.array([0.4, 1.0])
    axes = _axes(aspect, 2)
    reach = 0.99 * float(wide_distance([way], [[axes, axes]], director[None])[0])
    place = 50.0 + np.array([[0.0, 0.0], reach * way / np.sqrt(way @ way)])
    packing = pm.Packing(place, [0.5, 0.5], pm.Box.cubic(100.0, 2), shapes=pm.Spheroids([aspect, aspect], director))
    return pm.Scene(packing, HARMONIC)


def _wide_energy(packing: pm.Packing, moved: NDArray[Any], turned: NDArray[Any]) -> Any:
    """Return the energy of a pair in extended precision, after displacements and turns."""
    place = np.asarray(packing.position_nd, WIDE) + moved
    start = np.asarray(packing.shapes.director_nd, WIDE)
    cos, sin = np.cos(turned), np.sin(turned)
    director = np.stack([cos * start[:, 0] - sin * start[:, 1], sin * start[:, 0] + cos * start[:, 1]], axis=1)
    axes = np.stack([_axes(float(one), 2) for one in packing.shapes.aspect_n])
    vector = place[1] - place[0]
    overlap = 1 - np.sqrt(vector @ vector) / wide_distance([vector], [axes], director[None])[0]
    return overlap**2 / 2


def _force_error(aspect: float, angle: float) -> float:
    """Largest error of forces and torques of a pair against differences in extended precision, over the largest."""
    scene = _pair_scene(aspect, angle)
    force, torque = pm.forces(scene), pm.torques(scene)
    # the energy of a pair that is all but round hardly bends: a long step keeps the digits of what is left
    step, exact = WIDE(1e-7 if aspect > 2.0 else 1e-2), np.zeros((2, 3), WIDE)
    for n in range(2):
        for k in range(3):
            slope = WIDE(0)
            # five-point differences, exact to the fourth power of the step
            for share, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
                moved, turned = np.zeros((2, 2), WIDE), np.zeros(2, WIDE)
                if k < 2:
                    moved[n, k] = share * step
                else:
                    turned[n] = share * step
                slope += weight * _wide_energy(scene.packing, moved, turned)
            exact[n, k] = -slope / (12 * step)
    found = np.hstack([force, torque.reshape(2, 1)])
    scale = np.abs(exact).max(axis=0)
    return float((np.abs(found - exact) / scale).max())


def _like_discs(aspect: float) -> float:
    """Largest difference of forces on overlapping discs and on all but round ellipses, over the mean contact force."""
    start = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=2)
    angle = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, 32)
    shapes = pm.Spheroids(np.full(32, aspect), np.stack([np.cos(angle), np.sin(angle)], axis=1))
    discs, ellipses = pm.Scene(start, HARMONIC), pm.Scene(start.replace(shapes=shapes), HARMONIC)
    mean = pm.contact_forces(discs).mean_force
    return float(np.abs(pm.forces(discs) - pm.forces(ellipses)).max() / mean / (aspect - 1.0))


def _quenched(aspect: float, dimension: int, packing_fraction: float) -> float:
    """Residual of a quench, infinite if it is lost or not converged."""
    start = pm.random_packing(
        16, dimension=dimension, packing_fraction=packing_fraction, seed=3, shapes=pm.Ellipses(aspect)
    )
    run = pm.quench(pm.Scene(start, HARMONIC), force_tolerance=1e-8, check=False)
    scene = pm.Scene(run.packing, HARMONIC)
    return pm.contact_forces(scene).residual if run.ok and run.outcome is not pm.Outcome.UNJAMMED else math.inf


def _saddles_named() -> float:
    """Return the residual of a quench of 16 all but round ellipses, whose turns cost 1e-9 of what displacements do.

    Infinite if a saddle is called a minimum, or a minimum a saddle.
    """
    start = pm.random_packing(16, dimension=2, packing_fraction=0.95, seed=3, shapes=pm.Ellipses(ROUND))
    run = pm.quench(pm.Scene(start, HARMONIC), force_tolerance=1e-8, check=False)
    scene = pm.Scene(pm.remove_rattlers(run.packing)[0], HARMONIC)
    lowest = np.linalg.eigvalsh(pm.hessian(scene, strain="none").toarray())[0]
    named = run.outcome is pm.Outcome.UNSTABLE
    if named != (lowest < -1e-13) or run.outcome not in (pm.Outcome.UNSTABLE, pm.Outcome.CONVERGED):
        return math.inf
    return pm.contact_forces(pm.Scene(run.packing, HARMONIC)).residual


@cache
def _jammed(aspect: float, pressure: float = 1e-8) -> pm.Scene:
    start = pm.random_packing(20, dimension=2, packing_fraction=0.7, seed=1, shapes=pm.Ellipses(aspect))
    run = pm.jam(pm.Scene(start, HARMONIC), pressure=pressure, strain="isotropic", check=False)
    if not run.ok:
        raise RuntimeError(f"jam ended with {run.outcome.name}")
    return pm.Scene(run.packing, HARMONIC)


def _missing_contacts(scene: pm.Scene) -> int:
    """Return what is missing of as many contacts as hold every particle: 3 N' - 2 - contacts + 1."""
    held, _ = pm.remove_rattlers(scene.packing)
    return 3 * held.particles - 2 - len(pm.find_shape_contacts(held, gap_tolerance=0.0)) + 1


def _quartic_count(aspect: float) -> float:
    """How far the number of quartic modes is from that of missing contacts; infinite if one is not held at all."""
    scene = _jammed(aspect)
    modes = pm.quartic_modes(scene)
    if not (modes.curvature_m > 0.0).all() or not modes.certain:
        return math.inf
    return float(abs(len(modes) - _missing_contacts(scene)))


def _counted_low(aspect: float) -> float:
    """Return the same with modes below a 1e-10th of the largest eigenvalue of the Hessian, translations left out."""
    scene = _jammed(aspect)
    held = scene.replace(packing=pm.remove_rattlers(scene.packing)[0])
    eigenvalue_m = np.linalg.eigvalsh(pm.hessian(held, strain="none").toarray())
    low = int(np.count_nonzero(eigenvalue_m < 1e-10 * eigenvalue_m[-1])) - 2
    return float(abs(low - _missing_contacts(scene)))


def _fourth_power(aspect: float) -> float:
    """Largest distance from four of the exponents of the energy along quartic modes at pressure 1e-10."""
    scene = _jammed(aspect, 1e-10)
    modes, packing = pm.quartic_modes(scene), scene.packing
    amplitude = np.logspace(-3.0, -2.0, 7)
    start = pm.energy(scene)
    worst = 0.0 if len(modes) else math.inf
    for m in range(len(modes)):
        rise = [
            pm.energy(
                scene.replace(packing=pm.displaced(packing, a * modes.displacement_mnd[m], a * modes.turn_mnk[m]))
            )
            for a in amplitude
        ]
        slope = np.polyfit(np.log(amplitude), np.log(np.array(rise) - start), 1)[0]
        worst = max(worst, abs(float(slope) - 4.0))
    return worst


CASES = (
    *(
        HardCase(
            f"contact distance at aspect 100, {name}",
            "squares of semi-axes differ by 1e4, and all but parallel needles by their rounding",
            "largest relative error against bisection in extended precision, 500 pairs",
            1e-12,
            "directions round by 1e-16, which counts a^2 / b^2 = 1e4 times at most",
            partial(_distance_error, NEEDLE, dimension, "exact"),
            partial(_distance_error, NEEDLE, dimension, "gaussian"),
        )
        for dimension, name in ((2, "ellipses"), (3, "spheroids"))
    ),
    HardCase(
        "needles that touch end to end, side by side, across",
        "the parameter's range ends where axes are parallel",
        "largest relative error of closed forms",
        1e-15,
        "2 a, 2 b and a + b: a few roundings of 2e-16",
        _closed_forms,
    ),
    *(
        HardCase(
            f"contact distance at aspect 1 + 1e-9, {name}",
            "what differs from discs is lost in a difference, or round ones are taken for discs",
            "largest error of the distance less that of discs, over the aspect less one",
            1e-6,
            "distances of 1 round by a few 2e-16, over 1e-9",
            partial(_from_discs, dimension),
            "discs: off by 0.5 and more",
        )
        for dimension, name in ((2, "ellipses"), (3, "spheroids"))
    ),
    *(
        HardCase(
            f"force and torque at aspect {aspect:g}, turned by {angle:g}",
            "slopes of the contact distance are a quotient of small differences where needles are all but parallel",
            "largest error against differences in extended precision, over the largest of its kind",
            bound,
            why,
            partial(_force_error, aspect, angle),
        )
        for aspect, angle, bound, why in (
            (
                NEEDLE,
                1.0,
                1e-9,
                "rounding of directions 1e-16 times a^2 / b^2 = 1e4 over the overlap, .01, and a digit",
            ),
            (
                NEEDLE,
                1e-3,
                1e-9,
                "rounding of directions 1e-16 times a^2 / b^2 = 1e4 over the overlap, .01, and a digit",
            ),
            (ROUND, 1.0, 2e-6, "squares of semi-axes differ by 2e-9 and are rounded by 2e-16, and a digit"),
        )
    ),
    HardCase(
        "32 ellipses of aspect 1 + 1e-9 and as many discs",
        "another contact, or another force, because shapes are treated otherwise",
        "largest difference of a force, over the mean force and the aspect less one",
        100.0,
        "contact distances differ by half of 1e-9 each way, over overlaps of .05, of six contacts",
        partial(_like_discs, ROUND),
    ),
    *(
        HardCase(
            f"quench at aspect {aspect:g} in {dimension}D",
            "turns are stiffer than displacements by the square of the aspect, or not held at all",
            "residual (infinite if lost or not converged)",
            1e-8,
            "the tolerance asked for",
            partial(_quenched, aspect, dimension, fraction),
        )
        for aspect, dimension, fraction in ((NEEDLE, 2, 3.0), (10.0, 3, 0.9))
    ),
    HardCase(
        "quench at aspect 1 + 1e-9 in 2D",
        "turns cost a 1e-9th of what displacements do: forces balance on a saddle, and nobody notices",
        "residual (infinite if a saddle is called a minimum, or a minimum a saddle)",
        1e-8,
        "the tolerance asked for; the Hessian's lowest eigenvalue tells a saddle",
        _saddles_named,
        "balance of forces alone: converged, with five unstable turns",
    ),
    *(
        HardCase(
            f"quartic modes at aspect {aspect:g}, pressure 1e-8",
            "what holds them is the pressure: no threshold for eigenvalues tells them from modes that contacts hold",
            "difference from the number of missing contacts (infinite if one is not held)",
            0.0,
            "degrees of freedom - 2 - contacts + 1, one state of self stress",
            partial(_quartic_count, aspect),
            partial(_counted_low, aspect),
        )
        for aspect in (1.05, 1.5, 3.0)
    ),
    HardCase(
        "energy along quartic modes at pressure 1e-10",
        "a quadratic part that is rounding, or a motion that is not the mode",
        "largest distance of an exponent from four, amplitudes of 1e-3 to 1e-2",
        0.1,
        "the next power in the amplitude adds 1e-2 of itself at its end; prestress is 1e-10 of 1e-6",
        partial(_fourth_power, 1.3),
        "two, by the Hessian: off by 2",
    ),
)
