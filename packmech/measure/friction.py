"""Tangential forces of contacts at rest: a scene's friction and the tangential displacements of its packing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.contacts.wall_elements import WallSprings
from packmech.effects import (
    DIRECTION_COLUMNS,
    SAME_DIRECTION,
    RoughContacts,
    WallSide,
    at_contact,
    contact_terms,
    friction_of,
    rolling_spring_of,
    springs_of,
    twisting_of,
    wall_columns,
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
        terms = contact_terms(scene.effects, contacts)
        friction = at_contact(friction, terms.second_c * contacts.push_c**2, 0.0, contacts.kinds_c)
    displacement = _displacements(scene, contacts, "displacement_ck")
    return _across(friction, displacement, contacts.normal_cd, normal_c)


def turning_forces(scene: Scene, contacts: Contacts | ShapeContacts, normal_c: NDArray[np.float64]) -> TurningForces:
    """Return what resists rolling and twisting at the contacts, zeros where nothing does.

    Parameters
    ----------
    scene, contacts, normal_c
        As in `tangential_forces`.

    """
    rolling, twisting = rolling_spring_of(scene.effects), twisting_of(scene.effects)
    radius = scene.packing.radius_n
    one, other = radius[contacts.i_c], radius[contacts.j_c]
    arm = one * other / (one + other) ** 2 * contacts.distance_c
    rolled = _across(rolling, _displacements(scene, contacts, "rolling_ck"), contacts.normal_cd, normal_c)
    twist = _displacements(scene, contacts, "twisting_c")
    force, energy = _limited(twisting, twist, normal_c)
    return TurningForces(rolled.force_cd, force[:, 0], arm, rolled.energy_c + energy)


def wall_springs(packing: Packing, sides: list[WallSide]) -> WallSprings:
    """Return what walls do across to discs and spheres at rest, by the springs that a packing holds.

    Parameters
    ----------
    packing
        The packing.
    sides
        What touches each wall (`wall_sides`), whose order the springs have.

    """
    n, d, springs = packing.particles, packing.dimension, packing.tangential
    walls = tuple(one.wall for one in sides if one.is_first and one.wall.roughness is not None)
    _, columns = wall_columns(walls, d)
    stretch_nk = np.zeros((n, columns)) if springs is None or not walls else springs.at_walls(n, columns)
    width, first = 4 if d == 2 else 8, 0
    found = [WallSprings.smooth(np.zeros((0, d)))]
    for one in sides:
        normal, particle = one.normal_wd(d), one.touches.particle_w
        if one.wall.roughness is None:
            found.append(WallSprings.smooth(normal))
            continue
        size = width if one.below else one.wall.slots * (DIRECTION_COLUMNS + width)
        own = stretch_nk[particle, first : first + size]
        found.append(_springs_at(one, normal, own if one.below else _in_direction(normal, own, width)))
        first += size
    return WallSprings(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _in_direction(normal_wd: NDArray[np.float64], stretch_wk: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return the (W, width) columns of the slots that are known by the direction of each touch; zeros where none is."""
    touches, columns = stretch_wk.shape
    slot = stretch_wk.reshape(touches, columns // (DIRECTION_COLUMNS + width), DIRECTION_COLUMNS + width)
    cosine = np.einsum("wsd,wd->ws", slot[:, :, :DIRECTION_COLUMNS], normal_wd)
    nearest = cosine.argmax(axis=1)[:, None]
    known = np.take_along_axis(cosine, nearest, axis=1) > SAME_DIRECTION
    return np.asarray(known * np.take_along_axis(slot, nearest[:, :, None], axis=1)[:, 0, DIRECTION_COLUMNS:])


def particles_at_walls(sides: list[WallSide]) -> NDArray[np.int64]:
    """Return the (W,) particles of the springs of `wall_springs`."""
    return np.concatenate([np.zeros(0, np.int64), *(one.touches.particle_w for one in sides)])


def _springs_at(side: WallSide, normal_wd: NDArray[np.float64], stretch_wk: NDArray[np.float64]) -> WallSprings:
    """Return what a side of rough walls does across, given the columns of its springs (`wall_columns`)."""
    wall, touches, d = side.wall, side.touches, normal_wd.shape[1]
    turns = 1 if d == 2 else 3
    rough: Any = springs_of(wall.roughness)
    terms = side.terms()
    push, steep = np.abs(terms.first_c), 2.0 * terms.second_c
    friction, rolling, twisting = rough if isinstance(rough, RoughContacts) else (rough, None, None)
    here, before = at_contact(friction, steep, 0.0, side.kind_w), stretch_wk[:, turns]
    # of `Mindlin`: 0 else
    fallen = (before > 0.0) & (before < here.stiffness)
    worth = np.divide(before, here.stiffness, out=np.ones_like(before), where=fallen)
    slid = stretch_wk[:, :turns] * worth[:, None]
    across = _across(here, slid, normal_wd, push)
    rolled = _across(rolling, stretch_wk[:, turns + 1 : 2 * turns + 1], normal_wd, push)
    twist, energy = _limited(twisting, stretch_wk[:, -1:], push)
    stiffness = np.zeros((len(touches), 3))
    stiffness[:, 0] = here.stiffness
    for k, one in enumerate((rolling, twisting)):
        stiffness[:, 1 + k] = 0.0 if one is None else one.stiffness
    return WallSprings(
        normal_wd=normal_wd,
        arm_w=0.5 * touches.distance_w,
        push_w=push,
        push_slope_w=steep,
        force_wd=across.force_cd,
        rolling_wd=rolled.force_cd,
        twisting_w=twist[:, 0],
        stiffness_w3=stiffness,
        coefficient_w=np.broadcast_to(np.asarray(here.coefficient, dtype=np.float64), len(touches)),
        energy_w=across.energy_c + rolled.energy_c + energy,
        bend_wdd=np.zeros((*normal_wd.shape, d)) if side.below else 0.5 * touches.curvature_wxx[:, :d, :d],
    )


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
