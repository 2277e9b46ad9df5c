"""Contacts with walls and surfaces: which particle touches which wall, and how hard."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import instance
from packmech.effects import held_particles, refuse_unknown_to_shapes, wall_sides
from packmech.measure.friction import wall_springs
from packmech.packing import Packing
from packmech.scene import Scene


@shown()
class WallContacts(NamedTuple):
    """Contacts of particles with walls, sorted by effect, low wall before high one, and particle.

    A rigid body has one for each bead that touches, a sphere one for each place of a surface of triangles.

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
    tangential_wd
        (W, d) tangential forces of rough walls on particles [force].

    """

    particle_w: NDArray[np.int64]
    wall_w: NDArray[np.int64]
    normal_wd: NDArray[np.float64]
    force_w: NDArray[np.float64]
    tangential_wd: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.particle_w)

    def on_walls(self) -> NDArray[np.float64]:
        """Return the (d,) force of all particles on all walls [force]."""
        return np.asarray(self.force_w @ self.normal_wd - self.tangential_wd.sum(axis=0))


def wall_contacts_of(effects: tuple[Any, ...], packing: Packing) -> WallContacts:
    """Return the contacts of particles, or the beads of bodies, with walls; one that just touches counts as open."""
    held, d = held_particles(effects, packing.particles), packing.dimension
    none = np.zeros(0, np.int64)
    found = [WallContacts(none, none, np.zeros((0, d)), np.zeros(0), np.zeros((0, d)))]
    sides = wall_sides(effects, packing)
    across_wd, first = wall_springs(packing, sides).force_wd, 0
    for one in sides:
        k, touches, terms = one.place, one.touches, one.terms()
        across = across_wd[first : first + len(touches)]
        first += len(touches)
        # the slope of half the energy of the particle and its mirror image
        force = -0.5 * terms.first_c * one.steepness_w
        kept = force != 0.0
        if held is not None:
            kept &= ~held[touches.particle_w]
        normal = one.normal_wd(d)[kept] * np.sign(force[kept])[:, None]
        size = np.abs(force[kept])
        found.append(WallContacts(touches.particle_w[kept], np.full(len(normal), k), normal, size, across[kept]))
    return WallContacts(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


@honors("repulsion kinds friction rolling gravity walls held links shapes rough mesh", at_rest=True)
def wall_contacts(scene: Scene) -> WallContacts:
    """Return which particles touch walls, and how hard; those that are held do not count.

    Tangential forces are those of the springs that the packing holds (`Packing.tangential`, which runs leave there).

    Parameters
    ----------
    scene
        The scene; without `Walls` or `MeshWalls` the answer is empty.

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
    refuse_unknown_to_shapes(scene)
    return wall_contacts_of(scene.effects, scene.packing)
