"""Methods of time integration, and the time step that a scene asks for."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import brief, finite_array, particle_mask, positive
from packmech.dynamics.faces import face_area
from packmech.dynamics.friction import frictions_at_contacts, resistance_at_contacts, stiffening
from packmech.effects import (
    Bonds,
    Friction,
    HeldStress,
    Langevin,
    MeshWalls,
    Rolling,
    TwistingResistance,
    Walls,
    interaction_law,
    interactions_of,
    is_bound,
    law_second,
    memory_size,
    moved_along,
    pair_damping,
    remembered,
    remembered_energy,
    remembers,
    walls_met,
)
from packmech.effects.derivatives import may_jump
from packmech.effects.interaction import reach_of
from packmech.effects.kinds import bounding_partners
from packmech.effects.pair import at_overlap
from packmech.effects.partners import equal_partners
from packmech.packing import Packing
from packmech.scene import Scene

# overlaps [1] at which the stiffness of a contact is looked up
_OVERLAPS = (0.0, 0.1)
# part of the range of a bond before its reach at which its energy is looked up
_BEFORE = 1e-10
# a wall's law is cut off where it just touches
_BARELY = 1e-6
# distances between the largest of these overlaps and their reach, and alignments, at which interactions are looked up
_DISTANCES, _ALIGNMENTS = 64, (-1.0, 0.0, 0.5, 1.0)


class VelocityVerlet(NamedTuple):
    """Velocity Verlet, of second order; with rigid links RATTLE. Symplectic, and its own inverse, without dashpots.

    Dashpots see a velocity extrapolated to the end of the step, 2 v(half) - v(start), so that the method stays of
    second order with them, as long as no contact opens or closes: there a dashpot's force jumps.

    Parameters
    ----------
    fraction
        Where no time step is given it is this fraction of the shortest of sqrt(m / stiffness), m / damping, and the
        time in which bonds that jump (`JKR`, `CapillaryBridge`) are made and broken by what just sticks [1].

    """

    fraction: float = 0.05


class SemiImplicitEuler(NamedTuple):
    """Semi-implicit Euler, v += dt F(x) / m and then x += dt v, of first order; with rigid links as RATTLE does.

    Parameters
    ----------
    fraction
        As for `VelocityVerlet`.

    """

    fraction: float = 0.05


Method = VelocityVerlet | SemiImplicitEuler
INTEGRATORS: tuple[Any, ...] = (VelocityVerlet, SemiImplicitEuler)


def checked_method(method: Any) -> Method:
    """Return the method of integration, VelocityVerlet() where it is None."""
    found = VelocityVerlet() if method is None else method
    if not isinstance(found, Method):
        raise TypeError(f"method must be VelocityVerlet() or SemiImplicitEuler(), got {brief(method)}")
    positive("method.fraction", found.fraction)
    return found


class StartOfMotion(NamedTuple):
    """(N, d) velocities, (N, 1 or 3) spins, and the (N,) mask of held ones; None where nothing turns or is held."""

    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    held_n: NDArray[np.bool_] | None


def start_of_motion(packing: Packing, velocity_nd: Any, spin_nk: Any, held_n: Any) -> StartOfMotion:
    """Return what particles start with, checked.

    Parameters
    ----------
    packing
        The packing.
    velocity_nd, spin_nk
        (N, d) velocities and (N, 1 or 3) spins; None: at rest.
    held_n
        (N,) True for particles that are held; None: none.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    n, d = packing.particles, packing.dimension
    velocity = np.zeros((n, d)) if velocity_nd is None else finite_array("velocity_nd", velocity_nd, shape=(n, d))
    spin = None if spin_nk is None else finite_array("spin_nk", spin_nk, shape=(n, 1 if d == 2 else 3))
    held = None if held_n is None else particle_mask("held_n", held_n, n)
    return StartOfMotion(velocity, spin, held)


def choose_time_step(scene: Scene, fraction: float) -> float:
    """Return fraction times the shortest of sqrt(m / k), m / c and the time in which a bond is made and broken [time].

    And of the same for walls that hold a stress, see `_rate_of_pistons`. m is the smallest mass, k the largest
    stiffness, c the largest damping of whatever acts (`stiffness_and_damping`); for bonds that jump see
    `_rate_of_jumps`. How far anything moves has no part in it.

    Parameters
    ----------
    scene
        The scene.
    fraction
        The fraction [1].

    """
    stiffest, most_damped, drag = stiffness_and_damping(scene)
    smallest = float(scene.packing.mass_n.min())
    # one over each of the three times
    fastest = max(math.sqrt(stiffest / smallest), most_damped / smallest + drag, _rate_of_jumps(scene))
    fastest = max(fastest, _rate_of_pistons(scene))
    if not fastest > 0.0:
        raise ValueError("dt must be given for effects without stiffness, got None")
    return fraction / fastest


def stiffness_and_damping(scene: Scene) -> tuple[float, float, float]:
    """Return the largest stiffness k [energy/length^2], damping c [mass/time] and background drag [1/time] of a scene.

    Contacts are looked up for the smallest, mean and largest particles (of rigid bodies, beads), each with each, of
    each pair of kinds, at overlaps of 0 and 0.1, with the smallest mass: k is |d2u/dr2|, c the damping of a slow
    approach. Bonds are looked up at their rest lengths; walls as a particle and its mirror image, with half the
    stiffness. Each counts as many fold as `stiffening` says. That bounds what resists rolling and twisting, too: with
    the arm a = r_i r_j / (r_i + r_j) a^2 (1/I_i + 1/I_j) is at most m r^2 / I over the smallest mass, whatever the
    sizes. Interactions beyond contact count by their largest curvature from an overlap of 0.1 on, along the pair,
    across it, and by turns in lengths.
    """
    packing = scene.packing
    sizes = np.unique(2.0 * packing.shapes.site_radius(packing.radius_n)).tolist()
    steep, turned = stiffening(packing)
    stiff, damped, drag = [_stiffness_beyond_contact(scene)], [0.0], 0.0
    pairs = [one for one in scene.effects if not is_bound(one)]
    smallest = float(packing.mass_n.min())
    for partners in bounding_partners(scene.effects, packing, sites=True):
        for overlap in _OVERLAPS:
            touch = at_overlap(pairs, overlap, partners, 0.5 * smallest)
            stiff.append(steep * abs(touch.second))
            damped.append(steep * sum(pair_damping(one, touch) for one in pairs))
    for one in scene.effects:
        if isinstance(one, Friction):
            there = frictions_at_contacts(scene, one, smallest)
            stiff += [turned * each.stiffness for each in there]
            damped += [turned * each.damping for each in there]
        elif isinstance(one, Rolling | TwistingResistance):
            rolling = resistance_at_contacts(scene, one, smallest)
            stiff += [turned * each.stiffness for each in rolling]
            damped += [turned * each.damping for each in rolling]
        elif isinstance(one, Bonds) and len(one):
            for rest in (float(one.rest_length_b.min()), float(one.rest_length_b.max())):
                pair = equal_partners(rest)
                stiff += [abs(law_second(one.compression, (1.0 - overlap) * rest, pair)) for overlap in _OVERLAPS]
                stiff.append(abs(law_second(one.tension, rest, pair)))
            stiff.append(turned * one.tangential_stiffness)
            damped += [one.damping, turned * one.tangential_damping]
        elif isinstance(one, Walls | MeshWalls):
            for wall in walls_met(one.flat if isinstance(one, MeshWalls) else one, packing):
                # barely touching and pressed deep, as contacts are looked up
                for overlap in (_BARELY, _OVERLAPS[-1]):
                    stiff += [0.5 * steep * wall.body_stiffness(0.5 * sigma, overlap) for sigma in sizes]
                damped += [steep * wall.body_damping(0.5 * sigma, smallest) for sigma in sizes]
                across = wall.resistances([0.5 * sigma for sigma in sizes], smallest)
                stiff += [0.5 * turned * each.stiffness for each in across]
                damped += [0.5 * turned * each.damping for each in across]
        elif isinstance(one, Langevin):
            drag += one.rate
        elif hasattr(type(one), "body_force"):
            center = np.zeros(3)
            center[: packing.dimension] = packing.box.lattice_dd.sum(axis=1) / 2.0
            radius = 0.5 * packing.reference_diameter
            slow, fast = (one.body_force(*center.tolist(), speed, 0.0, 0.0, 1.0, radius)[0] for speed in (0.0, 1.0))
            drag += abs(fast - slow)
    return max(stiff), max(damped), drag


def _rate_of_jumps(scene: Scene) -> float:
    """Return one over the time that the fastest pair that sticks takes through the range of its bond [1/time].

    Of interactions that remember and whose force jumps: a bond forms and breaks within a step, by an error of about
    force times speed times half the step. Two particles stick below the speed at which their energy is what making and
    breaking takes; faster ones lose the same, a smaller part of their energy.
    """
    packing, fastest = scene.packing, 0.0
    for one in interactions_of(scene.effects):
        jumps = remembers(one) and may_jump(one)
        for partners in bounding_partners(scene.effects, packing) if jumps else ():
            sigma = partners.contact_distance
            held = remembered(one, (1.0 - _OVERLAPS[-1]) * sigma, partners, (0.0,) * memory_size(one))
            reach = reach_of(one, partners)
            # hooks are asked below their reach
            last = reach - _BEFORE * (reach - sigma)
            lost = remembered_energy(one, last, partners, held) - remembered_energy(one, sigma, partners, held)
            if not math.isfinite(lost):
                raise ValueError(
                    f"dt must be given for {type(one).__qualname__}, whose energies at contact and before its reach "
                    f"differ by {lost}, got None"
                )
            if lost > 0.0 and reach > sigma:
                speed = math.sqrt(4.0 * lost / float(packing.mass_n.min()))
                fastest = max(fastest, speed / (reach - sigma))
    return fastest


def _rate_of_pistons(scene: Scene) -> float:
    """Return one over the shortest time of a face that holds a stress [1/time]: of sqrt(M / (n k)) and of M / c.

    n is the number of the smallest particles that find place at the face side by side, at most all, and k the stiffness
    of a contact with it, or of its friction, where it is pressed deep.
    """
    packing, fastest = scene.packing, 0.0
    radius = float(packing.radius_n.min())
    section = 2.0 * radius if packing.dimension == 2 else math.pi * radius**2
    for one in scene.effects:
        for motion in (one.low_motion, one.high_motion) if isinstance(one, Walls) and one.moves else ():
            area = face_area(packing.box, int(one.axis))
            number = min(packing.particles, math.ceil(area / section))
            met = walls_met(one, packing)
            across = [each for wall in met for each in wall.resistances([radius], float(packing.mass_n.min()))]
            for a, along in enumerate(moved_along(motion)):
                if isinstance(along, HeldStress):
                    deep = [wall.body_stiffness(radius, _OVERLAPS[-1]) for wall in met]
                    stiff = deep if a == int(one.axis) else [0.0]
                    stiff += [] if a == int(one.axis) else [each.stiffness for each in across]
                    mass = along.inertia * area
                    fastest = max(fastest, math.sqrt(number * max(stiff) / mass), along.damping / along.inertia)
    return fastest


def _stiffness_beyond_contact(scene: Scene) -> float:
    """Return the largest stiffness of the interactions beyond contact [energy/length^2]; 0 without any."""
    packing, acting = scene.packing, interactions_of(scene.effects)
    radius, shapes = packing.radius_n, packing.shapes
    stiff = [0.0]
    for partners in bounding_partners(scene.effects, packing) if acting else ():
        reach = max(reach_of(one, partners) for one in acting)
        for r in np.linspace(
            (1.0 - _OVERLAPS[-1]) * partners.contact_distance, reach, _DISTANCES, endpoint=False
        ).tolist():
            for alignment in _ALIGNMENTS if shapes.has_orientations else (1.0,):
                laws = [interaction_law(one, r, partners, alignment) for one in acting]
                along, push, bending, torque = (
                    abs(sum(getattr(one, name) for one in laws)) for name in ("second", "first", "bending", "turning")
                )
                stiff += [along, push / r]
                if shapes.has_orientations:
                    stiff.append((bending + torque) / float(shapes.gyration(radius).min()) ** 2)
    return max(stiff)
