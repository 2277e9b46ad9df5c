"""Contacts with walls: who touches which wall, and how hard; and who rattles where more than contacts holds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.contacts import Contacts
from packmech.contacts.friction_cones import FrictionCones
from packmech.contacts.rattlers import rattling_bodies
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.contacts.shape_rattlers import shape_rattlers
from packmech.effects import (
    Repulsion,
    Walls,
    contact_terms,
    held_particles,
    refuse_unknown_to_shapes,
    single_effects,
    single_terms,
    wall_sides,
)
from packmech.honors import honors
from packmech.packing import Packing
from packmech.scene import Scene


class WallContacts(NamedTuple):
    """Contacts of particles with walls, sorted by effect, low wall before high one, and particle.

    A rigid body has one for each bead that touches.

    Attributes
    ----------
    particle_w
        (W,) particles.
    wall_w
        (W,) place of each wall's effect among the effects of the scene.
    normal_wd
        (W, d) unit vectors from the particle to the wall.
    force_w
        (W,) forces with which particle and wall push each other [force].

    """

    particle_w: NDArray[np.int64]
    wall_w: NDArray[np.int64]
    normal_wd: NDArray[np.float64]
    force_w: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.particle_w)

    def on_walls(self) -> NDArray[np.float64]:
        """Return the (d,) force of all particles on all walls [force]."""
        return np.asarray(self.force_w @ self.normal_wd)


def wall_contacts_of(effects: tuple[Any, ...], packing: Packing) -> WallContacts:
    """Return the contacts of a packing with the walls among the effects; one that just touches counts as open."""
    found = [WallContacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, packing.dimension)), np.zeros(0))]
    held = held_particles(effects, packing.particles)
    if packing.shapes is not None:
        return _of_shapes(effects, packing, held)
    for k, one in enumerate(effects):
        if not isinstance(one, Walls):
            continue
        for side in (one._replace(high=np.inf), one._replace(low=-np.inf)):
            force = single_terms((side,), packing).force_nd
            if held is not None:
                force[held] = 0.0
            size = np.abs(force).sum(axis=1)
            pushed = np.flatnonzero(size)
            normal = -force[pushed] / size[pushed, None]
            found.append(WallContacts(pushed, np.full(len(pushed), k), normal, size[pushed]))
    return WallContacts(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _of_shapes(effects: tuple[Any, ...], packing: Packing, held_n: NDArray[np.bool_] | None) -> WallContacts:
    """Return the contacts of ellipses, spheroids, or the beads of bodies with walls."""
    d = packing.dimension
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, d)), np.zeros(0))]
    for k, wall, side, touches in wall_sides(effects, packing):
        terms = contact_terms((Repulsion(law=wall.law),), touches.distance_w, touches.contact_distance_w)
        # the slope of half the energy of the particle and its mirror image
        force = -0.5 * terms.first_c * np.abs(touches.slope_wx[:, int(wall.axis)])
        kept = force != 0.0
        if held_n is not None:
            kept &= ~held_n[touches.particle_w]
        normal = np.zeros((int(kept.sum()), d))
        normal[:, int(wall.axis)] = -side * np.sign(force[kept])
        found.append((touches.particle_w[kept], np.full(len(normal), k), normal, np.abs(force[kept])))
    return WallContacts(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


@honors("repulsion friction gravity walls held links shapes", at_rest=True)
def wall_contacts(scene: Scene) -> WallContacts:
    """Return which particles touch walls, and how hard; those that are held do not count.

    Parameters
    ----------
    scene
        The scene; without `Walls` the answer is empty.

    Raises
    ------
    TypeError
        If it is no scene.

    Examples
    --------
    >>> import packmech as pm
    >>> ball = pm.Packing([[1.0, 1.45]], [0.5], pm.Box.cubic(4.0, 2))
    >>> floor = pm.wall_contacts(pm.Scene(ball, (pm.Repulsion(), pm.Walls(1, 1.0, 3.0))))
    >>> floor.on_walls().round(12).tolist()
    [0.0, -0.1]

    """
    instance("scene", scene, Scene)
    if scene.packing.shapes is not None:
        refuse_unknown_to_shapes(scene)
    return wall_contacts_of(scene.effects, scene.packing)


def rattlers_of_scene(
    packing: Packing, contacts: Contacts | ShapeContacts, effects: tuple[Any, ...], cones: FrictionCones | None = None
) -> NDArray[np.bool_]:
    """Return, for each particle, whether contacts with others, walls and what is held leave it free to move.

    What has a weight, or feels another potential, presses on whatever it touches: it rattles only where it touches
    nothing. So do clusters of linked particles with friction, whose spins take part in their balance: at rest what
    presses on one is balanced.

    Parameters
    ----------
    packing, contacts, effects
        The packing, its contacts and the scene's effects.
    cones
        Friction of the contacts; None without. Scenes with friction have no walls.

    """
    count = packing.particles
    held = held_particles(effects, count)
    held_n = np.zeros(count, dtype=bool) if held is None else held
    walls = wall_contacts_of(effects, packing)
    on_wall = np.bincount(walls.particle_w, minlength=count) > 0
    links = None if cones is None else packing.links
    if links is not None or not all(isinstance(one, Walls) for one in single_effects(effects)):
        touched = (contacts.count_n() > 0) | on_wall | held_n
        cluster = np.arange(count) if links is None else links.clusters(count)
        return np.asarray(np.bincount(cluster, touched)[cluster] == 0)
    if isinstance(contacts, ShapeContacts) and cones is None:
        return shape_rattlers(packing, contacts, [one for _, _, _, one in wall_sides(effects, packing)], held)
    if cones is not None:
        return rattling_bodies(contacts.i_c, contacts.j_c, contacts.normal_cd, count, cones, held_n)
    # each contact with a wall is one with a body of its own, which is held
    own = count + np.arange(len(walls))
    return rattling_bodies(
        np.concatenate([contacts.i_c, walls.particle_w]),
        np.concatenate([contacts.j_c, own]),
        np.concatenate([contacts.normal_cd, walls.normal_wd]),
        count + len(walls),
        held=np.concatenate([held_n, np.ones(len(walls), dtype=bool)]),
    )[:count]
