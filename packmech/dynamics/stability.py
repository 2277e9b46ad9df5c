"""Explicit stability: which time steps let a spring or a dashpot of a scene gain energy in every step."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.faces import face_area
from packmech.dynamics.friction import frictions_at_contacts, resistance_at_contacts, resistances_at_walls, stiffening
from packmech.effects import (
    BackgroundDamping,
    Friction,
    HeldStress,
    RollingResistance,
    TwistingResistance,
    Walls,
    acting_friction,
    bonds_of,
    interaction_law,
    interactions_of,
    is_bound,
    law_second,
    moved_along,
    pair_damping,
    resistances,
    roughness_of,
    walls_met,
)
from packmech.effects.kinds import bounding_partners
from packmech.effects.pair import at_overlap
from packmech.effects.partners import equal_partners
from packmech.result import Condition
from packmech.scene import Scene

# overlaps [1] at which normal springs are looked up; the softest counts, as any contact may be there
_OVERLAPS = (1e-9, 0.1)
# growth of a motion in one step that counts as unstable: less is rounding of a step at the limit, or the slow growth of
# undamped tangential springs, which `leading_share` takes
_GROWTH = 1.1
_HALVINGS = 40
# a time step so long that nothing is stable with it, though its powers are numbers yet, and by how much shorter ones
# are tried before the way between two is halved [1]
_LARGEST_STEP, _SHORTER = 1e100, 1e-3


class LoneMotion(NamedTuple):
    """A motion of one contact or particle, a = -inverse_mass (spring x + dashpot v).

    `tangential` says whether x is the integral of a slip velocity, and `of` what acts, in words.
    """

    of: str
    spring: float
    dashpot: float
    inverse_mass: float
    tangential: bool


def lone_motions(scene: Scene, inverse_mass_n: NDArray[np.float64]) -> list[LoneMotion]:
    """Return the motions of one contact, one bond and one particle that a scene is sure to have, if it has any.

    A contact is that of the lightest with the heaviest particle: whatever the lightest one touches is no heavier, and
    further contacts only add stiffness and damping. What resists rolling and twisting is that of the lightest with the
    partner with which it turns most slowly. Shapes count as not turning, and normal contacts of shapes, and
    all contacts of linked particles, are left out: their inertia and stiffness depend on where they touch.

    Parameters
    ----------
    scene
        The scene.
    inverse_mass_n
        (N,) inverse masses, 0 for what is held [1/mass].

    """
    packing = scene.packing
    free_n = inverse_mass_n[inverse_mass_n > 0.0]
    found: list[LoneMotion] = []
    if not len(free_n):
        return found
    turned = 1.0 if packing.shapes.has_orientations else stiffening(packing)[1]
    pair = float(free_n.max()) + float(inverse_mass_n.min())
    if packing.particles > 1 and not packing.links:
        pairs, friction = [one for one in scene.effects if not is_bound(one)], acting_friction(scene.effects)
        if not packing.shapes.has_orientations:
            spring, dashpot = (min(column) for column in zip(*_normal(scene, pairs, 1.0 / pair), strict=True))
            found.append(LoneMotion("the normal force of a contact", max(spring, 0.0), max(dashpot, 0.0), pair, False))
        if friction is not None:
            there = frictions_at_contacts(scene, friction, 2.0 / pair)
            sticking = min(one.stiffness for one in there), min(one.damping for one in there), turned * pair
            found.append(LoneMotion("the friction of a contact", *sticking, True))
        for one in resistances(roughness_of(scene.effects))[1:]:
            there = resistance_at_contacts(scene, one, 2.0 / pair)
            stuck = min(each.stiffness for each in there), min(each.damping for each in there)
            rolling = *stuck, (turned - 1.0) * _slowest_rolling(packing.radius_n, inverse_mass_n)
            found.append(LoneMotion("the resistance of a contact to rolling or twisting", *rolling, True))
    lightest = float(free_n.max())
    at_walls = [] if packing.links else resistances_at_walls(scene, 1.0 / lightest)
    for kind, share in ((Friction, turned), (RollingResistance, turned - 1.0), (TwistingResistance, turned - 1.0)):
        there = [one for one in at_walls if isinstance(one, kind)]
        if there:
            across = min(one.stiffness for one in there), min(one.damping for one in there), share * lightest
            found.append(LoneMotion("what acts across a contact with a wall", *across, True))
    bonds = bonds_of(scene.effects)
    if bonds is not None and not packing.links:
        bond = float((inverse_mass_n[bonds.i_b] + inverse_mass_n[bonds.j_b]).max())
        rests = (float(bonds.rest_length_b.min()), float(bonds.rest_length_b.max()))
        spring = min(
            abs(law_second(law, r, equal_partners(r))) for r in rests for law in (bonds.compression, bonds.tension)
        )
        found.append(LoneMotion("the normal force of a bond", spring, bonds.damping, bond, False))
        across = bonds.tangential_stiffness, bonds.tangential_damping, turned * bond
        found.append(LoneMotion("the tangential force of a bond", *across, True))
    for one in scene.effects:
        if isinstance(one, BackgroundDamping):
            found.append(LoneMotion("the drag on a particle", 0.0, one.rate, 1.0, False))
        if isinstance(one, Walls) and one.moves:
            found += _pistons(scene, one, lightest)
    return found


def _pistons(scene: Scene, walls: Walls, inverse_mass: float) -> list[LoneMotion]:
    """Return the motions of faces that hold a stress: on one contact, and by their own dashpot."""
    packing, found = scene.packing, []
    radii = (float(packing.radius_n.min()), float(packing.radius_n.max()))
    met = walls_met(walls, packing)
    spring = min(one.body_stiffness(radius, overlap) for one in met for radius in radii for overlap in _OVERLAPS)
    area = face_area(packing.box, int(walls.axis))
    for motion in (walls.low_motion, walls.high_motion):
        for axis, along in enumerate(moved_along(motion)):
            if not isinstance(along, HeldStress):
                continue
            if axis == int(walls.axis) and not packing.links:
                both = 1.0 / (along.inertia * area) + inverse_mass
                found.append(LoneMotion("a face that holds a stress, on a contact,", spring, 0.0, both, False))
            drag = along.damping / along.inertia
            found.append(LoneMotion("the dashpot of a face that holds a stress", 0.0, drag, 1.0, False))
    return found


def _slowest_rolling(radius_n: NDArray[np.float64], inverse_mass_n: NDArray[np.float64]) -> float:
    """Return the smallest (a/r_i)^2 / m_i + (a/r_j)^2 / m_j that a contact of the lightest particle may have [1/mass].

    a = r_i r_j / (r_i + r_j) is the arm of rolling and twisting; times m r^2 / I it is a^2 (1/I_i + 1/I_j). Of a
    lightest and smallest one it is from 1/(2 m_i), with a partner of its size, to 1/m_i, with one much larger.
    """
    lightest = int(inverse_mass_n.argmax())
    share_j = np.delete(radius_n, lightest)
    share_j = share_j / (share_j + radius_n[lightest])
    rolling_j = share_j**2 * inverse_mass_n[lightest] + (1.0 - share_j) ** 2 * np.delete(inverse_mass_n, lightest)
    return float(rolling_j.min())


def _normal(scene: Scene, pairs: list[object], mass: float) -> list[tuple[float, float]]:
    """Return springs and dashpots of contacts of the smallest, mean and largest particles, each with each.

    Barely touching and pressed deep. The reduced mass is that of the lightest pair.
    """
    found, beyond = [], interactions_of(scene.effects)
    for partners in bounding_partners(scene.effects, scene.packing):
        for overlap in _OVERLAPS:
            touch = at_overlap(pairs, overlap, partners, mass)
            spring = touch.second + sum(interaction_law(one, touch.distance, partners, 1.0).second for one in beyond)
            found.append((spring, sum(pair_damping(one, touch) for one in pairs)))
    return found


@lru_cache(maxsize=4096)
def growth(spring: float, dashpot: float, *, tangential: bool, second_order: bool, lead: float) -> float:
    """Return by how much the fastest growing state of a motion grows in one step of time [1].

    The spectral radius of the step (`time_step`) of a'' = -(spring x + dashpot v), in units of the time step.

    Parameters
    ----------
    spring, dashpot
        w k dt^2 and w c dt [1].
    tangential
        Whether x is the integral of the slip, by the trapezoidal rule, and not a place.
    second_order, lead
        As of the engine.

    Examples
    --------
    >>> how = {"tangential": False, "second_order": True, "lead": 0.0}
    >>> round(growth(1.99**2, 0.0, **how), 6), growth(2.01**2, 0.0, **how) > 1.2  # velocity Verlet: omega dt < 2
    (1.0, True)
    >>> round(growth(0.0, 0.99, **how), 6), growth(0.0, 1.01, **how) > 1.01  # the dashpot sees extrapolated velocities
    (1.0, True)

    """
    x, v, a, before = np.eye(4)
    half = 0.5 if second_order else 1.0
    kicked = v + half * a
    seen = kicked + (kicked - v) + 0.5 * lead * (a - before) if second_order else kicked
    if tangential:
        # what is added before and after the force is taken: `Pace`
        place = x + 0.5 * seen if second_order else x
    else:
        place = x + kicked
    force = -spring * place - dashpot * seen
    after = place + (0.5 if second_order else 1.0) * seen if tangential else place
    step = np.array([after, kicked + (1.0 - half) * force, force, a])
    return float(np.abs(np.linalg.eigvals(step)).max())


def step_condition(
    scene: Scene, dt: float, inverse_mass_n: NDArray[np.float64], *, second_order: bool, lead: float
) -> Condition | None:
    """Return the longest time step at which no contact, bond or particle by itself is unstable, beside this one.

    None where this one is stable for each. A packing, in which contacts act together, may ask for less: what grows all
    the same is found by its energy (`energy_drift`).

    Parameters
    ----------
    scene, inverse_mass_n
        As in `lone_motions`.
    dt
        Time step.
    second_order, lead
        As of the engine.

    """
    longest, what = min(dt, _LARGEST_STEP), ""
    for one in lone_motions(scene, inverse_mass_n):

        def grows(step: float, one: LoneMotion = one) -> bool:
            spring, dashpot = one.inverse_mass * one.spring * step**2, one.inverse_mass * one.dashpot * step
            how = {"tangential": one.tangential, "second_order": second_order, "lead": lead}
            return growth(spring, dashpot, **how) > _GROWTH

        if grows(longest):
            while grows(_SHORTER * longest):
                longest *= _SHORTER
            what, low, high = one.of, 0.0, longest
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if grows(middle) else (middle, high)
            longest = low
    if not what:
        return None
    return Condition("time step", dt, longest, hint=f"{what} is unstable above; leave dt out for one that is accurate")
