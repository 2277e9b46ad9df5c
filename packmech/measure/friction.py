"""Tangential forces of contacts at rest: a scene's friction and the tangential displacements of its packing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.effects import (
    Mindlin,
    Repulsion,
    RoughContacts,
    WallSide,
    at_contact,
    contact_terms,
    friction_of,
    rolling_of,
    twisting_of,
)
from packmech.links import named_rows
from packmech.packing import Packing
from packmech.scene import Scene


class TangentialForces(NamedTuple):
    """(C, d) tangential forces on particle i [force], and (C,) energies of their springs."""

    force_cd: NDArray[np.float64]
    energy_c: NDArray[np.float64]


class TurningForces(NamedTuple):
    """What resists rolling and twisting: (C, d) and (C,) forces as of friction, and (C,) energies of their springs.

    The arm (C,) makes torques of the forces: rolling turns i by arm n x f, twisting by arm f n, and j the other way.
    """

    rolling_cd: NDArray[np.float64]
    twisting_c: NDArray[np.float64]
    arm_c: NDArray[np.float64]
    energy_c: NDArray[np.float64]

    def moment_ck(self, normal_cd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, 1 or 3) torques on i [force * length]."""
        n, f = normal_cd, self.rolling_cd
        if n.shape[1] == 2:
            return (self.arm_c * (n[:, 0] * f[:, 1] - n[:, 1] * f[:, 0]))[:, None]
        return self.arm_c[:, None] * (np.cross(n, f) + self.twisting_c[:, None] * n)


def tangential_forces(
    scene: Scene, contacts: Contacts | ShapeContacts, normal_c: NDArray[np.float64]
) -> TangentialForces:
    """Return the tangential forces of the contacts, zeros without friction.

    Parameters
    ----------
    scene
        The scene.
    contacts
        Its touching pairs.
    normal_c
        (C,) normal forces, positive for repulsion [force].

    """
    friction = friction_of(scene.effects)
    if friction is not None:
        terms = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c)
        friction = at_contact(friction, terms.second_c * contacts.push_c**2, 0.0)
    displacement = _displacements(scene, contacts, "displacement_ck")
    return _across(friction, displacement, contacts.normal_cd, normal_c)


def turning_forces(scene: Scene, contacts: Contacts | ShapeContacts, normal_c: NDArray[np.float64]) -> TurningForces:
    """Return what resists rolling and twisting at the contacts, zeros where nothing does.

    Parameters
    ----------
    scene, contacts, normal_c
        As in `tangential_forces`.

    """
    rolling, twisting = rolling_of(scene.effects), twisting_of(scene.effects)
    radius = scene.packing.radius_n
    one, other = radius[contacts.i_c], radius[contacts.j_c]
    arm = one * other / (one + other) ** 2 * contacts.distance_c
    rolled = _across(rolling, _displacements(scene, contacts, "rolling_ck"), contacts.normal_cd, normal_c)
    twist = _displacements(scene, contacts, "twisting_c")
    force, energy = _limited(twisting, twist, normal_c)
    return TurningForces(rolled.force_cd, force[:, 0], arm, rolled.energy_c + energy)


class WallResistance(NamedTuple):
    """What rough walls do across to what touches them, in the order of `wall_sides`: nothing of smooth ones.

    (W, d) forces, (W, 1 or 3) torques, (W,) energies of their springs.
    """

    force_wd: NDArray[np.float64]
    torque_wk: NDArray[np.float64]
    energy_w: NDArray[np.float64]

    def sums(self, particle_w: NDArray[np.int64], particles: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (N, d) and (N, 1 or 3) sums over what touches walls."""
        force, torque = (np.zeros((particles, one.shape[1])) for one in (self.force_wd, self.torque_wk))
        np.add.at(force, particle_w, self.force_wd)
        np.add.at(torque, particle_w, self.torque_wk)
        return force, torque


def wall_resistance(packing: Packing, sides: list[WallSide]) -> WallResistance:
    """Return what rough walls do across at rest, by the springs that a packing holds.

    Parameters
    ----------
    packing
        The packing.
    sides
        What touches each wall (`wall_sides`).

    """
    n, d = packing.particles, packing.dimension
    turns, springs, column = 1 if d == 2 else 3, packing.tangential, 0
    rough = [one.wall.roughness for one in sides]
    numbers = [(0, 0, 0) if one is None else _numbers(one, turns) for one in rough]
    whole = sum(map(sum, numbers))
    stretch_nk = np.zeros((n, whole)) if springs is None or not whole else springs.at_walls(n, whole)
    found = [WallResistance(np.zeros((0, d)), np.zeros((0, turns)), np.zeros(0))]
    for one, counts in zip(sides, numbers, strict=True):
        stretch = stretch_nk[one.touches.particle_w, column : column + sum(counts)]
        column += sum(counts)
        sliding, rolling, twisting = np.split(stretch, np.cumsum(counts)[:-1], axis=1)
        found.append(_resistance(one, d, (sliding, rolling, twisting)))
    return WallResistance(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _numbers(rough: Any, turns: int) -> tuple[int, int, int]:
    """Return how many numbers a contact keeps of sliding (its stiffness among them), rolling and twisting."""
    friction, rolling, twisting = (
        (rough.friction, rough.rolling, rough.twisting) if isinstance(rough, RoughContacts) else (rough, None, None)
    )
    kept = isinstance(friction.stiffness, Mindlin)
    return turns + kept, turns * (rolling is not None), int(twisting is not None)


def _resistance(side: WallSide, d: int, stretches: tuple[NDArray[np.float64], ...]) -> WallResistance:
    """Return what a side of a wall does across, given the stretches of sliding, rolling and twisting."""
    wall, touches = side.wall, side.touches
    count, turns, rough = len(touches), 1 if d == 2 else 3, wall.roughness
    if rough is None:
        return WallResistance(np.zeros((count, d)), np.zeros((count, turns)), np.zeros(count))
    terms = contact_terms((Repulsion(law=wall.law),), touches.distance_w, touches.contact_distance_w)
    normal = np.zeros((count, d))
    normal[:, int(wall.axis)] = -side.below
    push, arm = np.abs(terms.first_c), 0.5 * touches.distance_w
    friction, *others = rough if isinstance(rough, RoughContacts) else (rough, None, None)
    here = at_contact(friction, 2.0 * terms.second_c, 0.0)
    slid = stretches[0][:, :turns]
    if stretches[0].shape[1] > turns:
        before = stretches[0][:, turns]
        slid = slid * np.where((before > 0.0) & (before < here.stiffness), before / here.stiffness, 1.0)[:, None]
    across = _across(here, slid, normal, push)
    rolled, twisted = np.zeros((count, turns)), np.zeros((count, 1))
    rolled = stretches[1] if others[0] is not None else rolled
    twisted = stretches[2] if others[1] is not None else twisted
    rolling, (twisting, energy) = _across(others[0], rolled, normal, push), _limited(others[1], twisted, push)
    turning = TurningForces(across.force_cd + rolling.force_cd, twisting[:, 0], arm, across.energy_c)
    return WallResistance(across.force_cd, turning.moment_ck(normal), across.energy_c + rolling.energy_c + energy)


def _displacements(scene: Scene, contacts: Contacts | ShapeContacts, name: str) -> NDArray[np.float64]:
    """Return the (C, k) displacements of one kind that the packing holds for its contacts; zeros for all others."""
    springs, d = scene.packing.tangential, contacts.dimension
    held = None if springs is None else getattr(springs, name)
    found = np.zeros((len(contacts), 1 if d == 2 or name == "twisting_c" else 3))
    if springs is not None and held is not None and len(springs):
        known, asked = ((one.i_c, one.j_c, one.image_cd) for one in (contacts, springs))
        place = named_rows(known, asked, contacts.bead_c2, springs.bead_c2)
        found[place[place >= 0]] = held.reshape(len(springs), -1)[place >= 0]
    return found


def _limited(
    resistance: Any, displacement_ck: NDArray[np.float64], normal_c: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return forces of springs as far as their limit lets them, and their energies; zeros where nothing resists."""
    if resistance is None:
        return np.zeros_like(displacement_ck), np.zeros(len(displacement_ck))
    stiffness = np.broadcast_to(resistance.stiffness, len(displacement_ck))
    force = stiffness[:, None] * displacement_ck
    size = np.sqrt((force**2).sum(axis=1))
    cap = resistance.coefficient * np.abs(normal_c)
    force = force * np.where(size > cap, cap / np.maximum(size, 1e-300), 1.0)[:, None]
    # a spring that gave way holds what its force is worth
    stretch = np.divide(np.minimum(size, cap), stiffness, out=np.zeros(len(force)), where=stiffness > 0.0)
    return force, 0.5 * stiffness * stretch**2


def _across(
    resistance: Any,
    displacement_ck: NDArray[np.float64],
    normal_cd: NDArray[np.float64],
    normal_c: NDArray[np.float64],
) -> TangentialForces:
    """Return the forces of springs across contacts, from displacements as the engine holds them."""
    d = normal_cd.shape[1]
    displacement = _laid_across(displacement_ck, normal_cd) if d == 3 else displacement_ck
    force, energy = _limited(resistance, displacement, normal_c)
    if d == 2:
        force = np.stack([-normal_cd[:, 1], normal_cd[:, 0]], axis=1) * force
    return TangentialForces(force, energy)


def _laid_across(displacement_c3: NDArray[np.float64], normal_c3: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the displacements laid into the contacts' tangent planes, as long as they were, as the engine does."""
    across = displacement_c3 - (displacement_c3 * normal_c3).sum(axis=1)[:, None] * normal_c3
    before, after = (np.sqrt((one**2).sum(axis=1)) for one in (displacement_c3, across))
    return np.asarray(across * np.divide(before, after, out=np.zeros_like(after), where=after > 0.0)[:, None])


def sum_both(
    contacts: Contacts | ShapeContacts, on_i: NDArray[np.float64], on_j: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (N, k) sums of what contacts do to their two particles."""
    total = np.empty((contacts.particles, on_i.shape[1]))
    for k in range(on_i.shape[1]):
        total[:, k] = np.bincount(contacts.i_c, on_i[:, k], contacts.particles)
        total[:, k] += np.bincount(contacts.j_c, on_j[:, k], contacts.particles)
    return total
