"""Packings with links for the hard cases: rings, long chains, chains around the box, far and near ends, taut rings."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.dynamics.quench import quench
from packmech.dynamics.shear_stabilize import shear_stabilize
from packmech.effects import Harmonic, Repulsion
from packmech.generate import random_packing
from packmech.links import Links
from packmech.measure import remove_rattlers
from packmech.mechanics.reaffixing import reaffix_links
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.studies.finite_strain import at_rest

HARMONIC = (Repulsion(law=Harmonic()),)


def rigid(place_nd: NDArray[np.float64] | list[list[float]]) -> Packing:
    """Return particles of diameter 1 with all pairs linked, at the distances at which they stand."""
    place = np.array(place_nd)
    i, j = np.triu_indices(len(place), 1)
    length = np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1))
    links = Links(i, j, np.zeros((len(i), place.shape[1]), dtype=np.int64), length)
    return Packing(place, np.full(len(place), 0.5), Box.cubic(9.0, place.shape[1]), links)


def ring(beads: int, wrong: float = 0.0) -> Packing:
    """Return a ring of particles in a plane, all pairs linked, the last of the redundant ones too long by `wrong`."""
    angle = 2.0 * math.pi * np.arange(beads) / beads
    packing = rigid(2.0 * np.stack([np.cos(angle), np.sin(1.3 * angle)], axis=1))
    links = packing.links
    assert links is not None
    length = links.length_l.copy()
    length[-1] += wrong
    return packing.replace(links=Links(links.i_l, links.j_l, links.image_ld, length, np.arange(len(length)) > 0))


@cache
def chain(dimension: int, beads: int = 1000, angle: float = 0.6, reach: int = 1) -> Packing:
    """Return an open chain, bent at random within an angle, each particle linked to the next `reach`."""
    rng = np.random.default_rng(7)
    if dimension == 2:
        turn = np.cumsum(rng.uniform(-angle, angle, beads))
        step = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        step = np.empty((beads, 3))
        step[0] = [1.0, 0.0, 0.0]
        for k in range(1, beads):
            step[k] = step[k - 1] + angle * rng.uniform(-0.6, 0.6, 3)
            step[k] /= math.sqrt(float(step[k] @ step[k]))
    place = np.cumsum(step, axis=0)
    i = np.concatenate([np.arange(beads - u) for u in range(1, reach + 1)])
    j = np.concatenate([np.arange(u, beads) for u in range(1, reach + 1)])
    links = Links(
        i, j, np.zeros((len(i), dimension), dtype=np.int64), np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1))
    )
    return Packing(place, np.full(beads, 0.5), Box.cubic(1.2 * beads, dimension), links)


def around() -> Scene:
    """Return 12 discs in a chain that closes through the box wall, pressed by six free ones; wavy, not at rest."""
    rng, beads, side = np.random.default_rng(6), 12, 8.0
    place = np.stack([side * (np.arange(beads) + 0.5) / beads, 0.3 + 0.25 * rng.normal(size=beads)], axis=1)
    i, j = np.arange(beads), (np.arange(beads) + 1) % beads
    image = np.zeros((beads, 2), dtype=np.int64)
    image[-1, 0] = 1
    vector = place[j] - place[i] + side * image
    links = Links(i, j, image, np.sqrt((vector**2).sum(axis=1)))
    free = np.stack([side * np.arange(6) / 6, np.full(6, 1.05)], axis=1) + 0.05 * rng.normal(size=(6, 2))
    packing = Packing(np.concatenate([place, free]), np.full(beads + 6, 0.5), Box(np.diag([side, 1.9])), links)
    return Scene(packing, HARMONIC)


@cache
def scaled(ratio: float) -> Scene:
    """Return 24 spheres, six pairs of them joined by links `ratio` times a radius long, at rest.

    Long links go around the box many times. Ends of short ones lie in one another.
    """
    rng = np.random.default_rng(8)
    packing = random_packing(24, dimension=3, packing_fraction=0.8, seed=8)
    packing = quench(Scene(packing, HARMONIC), force_tolerance=1e-6).packing
    place, lattice = np.array(packing.position_nd), packing.box.lattice_dd
    i, j = np.arange(0, 12, 2), np.arange(1, 12, 2)
    reach = rng.normal(size=(6, 3))
    reach *= ratio * float(packing.radius_n.min()) / np.sqrt((reach**2).sum(axis=1))[:, None]
    image = np.zeros((6, 3), dtype=np.int64)
    if ratio > 1.0:
        image = np.rint((reach - place[j] + place[i]) @ np.linalg.inv(lattice).T).astype(np.int64)
    else:
        place[j] = place[i] + reach
    vector = place[j] - place[i] + image @ lattice.T
    packing = packing.replace(position_nd=place, links=Links(i, j, image, np.sqrt((vector**2).sum(axis=1))))
    run = quench(Scene(packing, HARMONIC), force_tolerance=1e-8, check=False)
    if not run.ok or np.abs(run.packing.link_error).max() > 1e-13:
        raise RuntimeError(f"quench ended with {run.outcome.name}, link error {np.abs(run.packing.link_error).max()}")
    return Scene(remove_rattlers(run.packing)[0], HARMONIC)


@cache
def bags(at: float = 1e-6) -> Scene:
    """Return four rings of 12 discs, each drawn tight around seven, pressed together softly from all sides."""
    rng = np.random.default_rng(10)
    places, pairs = [], []
    for k in range(4):
        turn = 2.0 * math.pi * (np.arange(12) + rng.random()) / 12
        inner = 2.0 * math.pi * (np.arange(6) + rng.random()) / 6
        around = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 0.5 / math.sin(math.pi / 12)
        core = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(inner), np.sin(inner)], axis=1)])
        places.append(np.concatenate([around, core]) + 4.4 * np.array([k % 2, k // 2 + 0.5 * (k % 2)]))
        pairs += [(19 * k + b, 19 * k + (b + 1) % 12) for b in range(12)]
    place = np.concatenate(places) + 0.01 * rng.normal(size=(76, 2))
    i, j = np.array(pairs).T
    radius = np.tile(np.r_[np.full(12, 0.5), np.full(7, 0.56)], 4)
    packing = Packing(
        place, radius, Box(np.diag([8.8, 8.8])), Links(i, j, np.zeros((48, 2), dtype=np.int64), np.ones(48))
    )
    packing = reaffix_links(packing).packing
    run = shear_stabilize(Scene(packing, HARMONIC), pressure=at)
    scene: Scene = at_rest(Scene(remove_rattlers(run.packing)[0], HARMONIC))
    return scene
