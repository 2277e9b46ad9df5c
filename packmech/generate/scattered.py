"""Particles of a packing, or its clusters of linked ones, at random places again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, positive, real
from packmech.generate.clusters import random_rotation
from packmech.generate.random import box_for, generator_of
from packmech.generate.room import Room
from packmech.links import Links, image_offsets
from packmech.packing import Packing

# places that a cluster tries before it may overlap others by so much more
_TRIES, _MORE = 50, 0.05


def scattered_packing(
    packing: Packing,
    *,
    packing_fraction: float,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    largest_overlap: float = 0.1,
) -> Packing:
    """Return the packing with its particles at independent uniform places, in its box scaled to the packing fraction.

    Clusters of linked particles keep their shape and are turned at random. They are put in one by one where they
    overlap earlier ones but little, so that their links do not cross; where a cluster finds no room in 50 places, it
    may overlap by 0.05 more.

    Parameters
    ----------
    packing
        The packing; its positions only tell the shapes of clusters.
    packing_fraction
        Volumes of the particles over that of the box [1].
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    largest_overlap
        Largest overlap of particles of two clusters, over the sum of their radii [1].

    Raises
    ------
    TypeError, ValueError
        Naming the argument; a cluster that winds around the box has no other place in it.

    Examples
    --------
    >>> import packmech as pm
    >>> trimers = pm.cluster_packing(10, pm.Trimer(), dimension=2, packing_fraction=0.3, seed=1)
    >>> again = pm.scattered_packing(trimers, packing_fraction=0.4, seed=2)
    >>> round(pm.packing_fraction(again), 12), again.link_error < 1e-14
    (0.4, True)

    """
    instance("packing", packing, Packing)
    fraction = positive("packing_fraction", packing_fraction)
    rng = generator_of(seed, rng)
    overlap = real("largest_overlap", largest_overlap, at_least=0.0, at_most=1.0)
    radius, n, d = packing.radius_n, packing.particles, packing.dimension
    box = box_for(radius, fraction, packing.box.lattice_dd)
    links = packing.links
    if links is None:
        return Packing(np.einsum("de,ne->nd", box.lattice_dd, rng.random((n, d))), radius, box=box)
    offset, winding = image_offsets(links, n)
    if winding.any():
        particle = int(np.argmax(winding))
        raise ValueError(f"packing must have no cluster that winds around the box, got that of particle {particle}")
    whole = packing.position_nd + np.einsum("de,ne->nd", packing.box.lattice_dd, offset)
    cluster = links.clusters(n)
    order = np.argsort(cluster, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1)
    room = Room(box, radius[order], overlap)
    position = np.empty((n, d))
    for part in parts:
        shape = whole[part] - whole[part].mean(axis=0)
        position[part] = _placed(room, shape, box.lattice_dd, overlap, rng)
        room.take(position[part])
    none = np.zeros_like(links.image_ld)
    return Packing(position, radius, box, Links(links.i_l, links.j_l, none, links.length_l, links.shape_l))


def _placed(
    room: Room,
    shape_bd: NDArray[np.float64],
    lattice_dd: NDArray[np.float64],
    overlap: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    d = shape_bd.shape[1]
    room.allow(overlap)
    tries = 0
    while True:
        center = np.einsum("de,e->d", lattice_dd, rng.random(d))
        place = center + np.einsum("de,be->bd", random_rotation(d, rng), shape_bd)
        if room.has(place):
            return np.asarray(place)
        tries += 1
        if tries % _TRIES == 0:
            overlap += _MORE
            room.allow(overlap)
