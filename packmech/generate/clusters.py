"""Random starting packings of clusters, at independent positions and orientations: of one shape, or a packing's."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import PARTICLE_BYTES, brief, instance, integer, one_of, positive, real
from packmech.contacts.fused_volume import shared_volume
from packmech.generate.chains import CROSSING, Bond, BondGrid, minus
from packmech.generate.cluster_shapes import Cluster, Shape, drawn_clusters
from packmech.generate.placed import Placed, checked_overlap
from packmech.generate.random import (
    Monodisperse,
    SizeDistribution,
    box_for,
    generator_of,
    shape_of,
    sizes_of,
    start_fraction,
)
from packmech.links import Links, image_offsets
from packmech.packing import Packing, masses_of_density, no_own_images

# positions tried for a cluster of a packing before it may overlap others by so much more
_TRIES, _MORE = 50, 0.05


@shown_as("placing clusters")
def cluster_packing(
    count: int,
    shape: Shape,
    *,
    dimension: int,
    packing_fraction: float,
    sizes: SizeDistribution | ArrayLike | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    box: Box | ArrayLike | None = None,
    crossing: str = "avoided",
    largest_overlap: float | None = None,
    tries: int = 1000,
    density: float | None = None,
) -> Packing:
    """Return clusters of one shape at independent uniform places and orientations, at the packing fraction asked for.

    Clusters overlap at random, some of them deeply, as particles do in ``random_packing``. In two dimensions their
    bonds do not cross: a cluster whose bonds would cross earlier ones is placed again. The particles of a cluster
    follow each other, in the order of the shape's beads.

    Parameters
    ----------
    count
        Number of clusters.
    shape
        ``Dimer``, ``Trimer``, ``RingCluster``, ``StarCluster``, ``LinearCluster``, or a ``Cluster`` of beads given by
        hand. A ``Trimer`` with a range of angles has another angle in every cluster.
    dimension
        2 (discs) or 3 (spheres).
    packing_fraction
        Area or volume of all clusters over that of the box [1]. That of a rigid cluster is its beads' union; what
        clusters share counts for each of them, as in ``packing_fraction``.
    sizes
        Distribution of the sizes of whole clusters: each is the shape times a diameter drawn from it. All equal to the
        shape when nothing is said.
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    box
        Shape of the box, a ``Box`` or (d, d) lattice vectors as columns; its size is set by the packing fraction.
        Square or cubic when nothing is said.
    crossing
        ``"avoided"`` or ``"allowed"``: whether bonds may cross in two dimensions.
    largest_overlap
        Largest overlap of beads of different clusters, relative to the sum of their radii [1]; any when nothing is
        said. Where beads lie deep in each other a quench may push bonds through each other; at low packing fractions
        a small number here keeps them apart for good.
    tries
        Number of places tried for a cluster before giving up.
    density
        Mass over area, or over volume in space, of every bead [mass/length^d]; as of a `Packing` unless given.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what was given; also where bonds find no room in ``tries`` tries.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.cluster_packing(50, pm.Trimer(), dimension=2, packing_fraction=0.9, seed=1)
    >>> packing.particles, len(packing.links), len(pm.crossing_links(packing))
    (150, 150, 0)

    """
    count = integer("count", count, at_least=1, bytes_each=PARTICLE_BYTES)
    if not isinstance(shape, Shape) or isinstance(shape, type):
        raise TypeError(f"shape must be a shape such as Dimer(...) or Cluster(...), got {brief(shape)}")
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    packing_fraction = start_fraction(packing_fraction)
    sizes = sizes_of(sizes, Monodisperse())
    rng = generator_of(seed, rng)
    shape_dd = shape_of(box, dimension)
    one_of("crossing", crossing, CROSSING)
    overlap = checked_overlap(largest_overlap)
    tries = integer("tries", tries, at_least=1)
    avoid = dimension == 2 and crossing == "avoided"
    factor_k = 2.0 * sizes.radii(count, rng)
    cluster_k = drawn_clusters(shape, count, dimension, rng)
    beads = len(cluster_k[0].radius_b)
    for cluster in cluster_k:
        if len(cluster.radius_b) != beads:
            raise ValueError(
                f"shape must draw clusters of one number of beads, got {len(cluster.radius_b)} after {beads}"
            )
    for cluster in {id(cluster): cluster for cluster in cluster_k}.values() if avoid else ():
        own = cluster.crossing()
        if own is not None:
            raise ValueError(
                f"shape must have no bonds that cross unless crossing is 'allowed', got {own[0]} and {own[1]}"
            )

    radius_n = np.concatenate([factor * one.radius_b for factor, one in zip(factor_k, cluster_k, strict=True)])
    centered_kbd = np.stack(
        [
            factor * (one.position_bd - one.position_bd.mean(axis=0))
            for factor, one in zip(factor_k, cluster_k, strict=True)
        ]
    )
    links = _links(cluster_k, factor_k)
    anywhere = Packing(centered_kbd.reshape(-1, dimension), radius_n, Box.cubic(1.0, dimension), links)
    scaled = box_for(radius_n, packing_fraction, shape_dd, shared_volume(anywhere))
    longest = max(float(factor * one.longest_bond) for factor, one in zip(factor_k, cluster_k, strict=True))
    bonds = BondGrid(scaled, max(1, sum(len(one.bonds) for one in cluster_k)), longest or 1.0, avoid=avoid)
    placed = Placed(scaled, radius_n, overlap)
    position = np.empty_like(centered_kbd)
    for k in range(count):
        for _ in range(tries):
            position[k] = _at_random(centered_kbd[k], scaled, rng)
            if placed.admits(position[k]) and bonds.place(_bonds_at(cluster_k[k], k * beads, position[k])):
                break
        else:
            tight = "crossing" if largest_overlap is None else "largest_overlap"
            raise ValueError(
                f"{tight} must leave room for all clusters (allow more, or take a lower packing fraction, shorter "
                f"links or more tries), got no place for cluster {k} in {tries} tries"
            )
        placed.add(position[k])
    mass_n = masses_of_density(density, radius_n, dimension)
    return Packing(position.reshape(-1, dimension), radius_n, scaled, links, mass_n).wrapped()


@shown_as("placing clusters")
@honors("links shapes", packing_only=True)
def scattered_packing(
    packing: Packing,
    *,
    packing_fraction: float,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    largest_overlap: float = 0.1,
) -> Packing:
    """Return the packing with its particles at independent uniform positions, its box scaled to the packing fraction.

    Clusters of linked particles keep their shape and are rotated at random. They are placed one by one where they
    overlap earlier ones little, so that their links do not cross; after every 50 positions tried a cluster may overlap
    by 0.05 more. Ellipses, spheroids and rigid bodies are turned in all directions alike.

    Parameters
    ----------
    packing
        The packing; of its positions only the shapes of clusters are kept.
    packing_fraction
        Volume of the particles over that of the box [1], as ``packing_fraction`` returns it.
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    largest_overlap
        Largest overlap of particles of two clusters, over the sum of their radii [1].

    Raises
    ------
    TypeError, ValueError
        Naming the argument; a cluster that winds around the box has no other position in it.

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
    no_own_images("packing", packing)
    box = box_for(radius, fraction, packing.box.lattice_dd, shared_volume(packing))
    links = packing.links
    if not len(links):
        position = np.einsum("de,ne->nd", box.lattice_dd, rng.random((n, d)))
        shapes = packing.shapes.oriented(rng.standard_normal(packing.shapes.orientation_nq.shape))
        return packing.replace(position_nd=position, box=box, shapes=shapes)
    offset, winding = image_offsets(links, n)
    if winding.any():
        particle = int(np.argmax(winding))
        raise ValueError(f"packing must have no cluster that winds around the box, got that of particle {particle}")
    unwrapped_nd = packing.position_nd + np.einsum("de,ne->nd", packing.box.lattice_dd, offset)
    cluster = links.clusters(n)
    order = np.argsort(cluster, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1)
    placed = Placed(box, radius[order], overlap)
    position = np.empty((n, d))
    for part in parts:
        shape_bd = unwrapped_nd[part] - unwrapped_nd[part].mean(axis=0)
        allowed = overlap
        for tries in itertools.count(1):
            placed.allow(allowed)
            position[part] = _at_random(shape_bd, box, rng)
            if placed.admits(position[part]):
                break
            if tries % _TRIES == 0:
                allowed += _MORE
        placed.add(position[part])
    return packing.replace(position_nd=position, box=box, links=links.at_images(np.zeros_like(links.image_ld)))


def _at_random(shape_bd: NDArray[np.float64], box: Box, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the beads of a cluster about a random center, rotated at random."""
    dimension = box.dimension
    center_d = np.einsum("de,e->d", box.lattice_dd, rng.random(dimension))
    return np.asarray(center_d + np.einsum("de,be->bd", random_rotation(dimension, rng), shape_bd))


def _bonds_at(cluster: Cluster, first: int, position_bd: NDArray[np.float64]) -> list[Bond]:
    """Return the bonds of a cluster whose first particle has this number."""
    place = [tuple(one) for one in position_bd.tolist()]
    return [(first + i, first + j, place[i], minus(place[j], place[i]), ()) for i, j in cluster.bonds]


def random_rotation(dimension: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a rotation drawn uniformly: an angle, or a unit quaternion."""
    if dimension == 2:
        turn = 2.0 * math.pi * rng.random()
        return np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    drawn = rng.standard_normal(4)
    w, x, y, z = (drawn / math.sqrt(math.fsum(drawn**2))).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _links(cluster_k: list[Cluster], factor_k: NDArray[np.float64]) -> Links:
    beads, dimension = cluster_k[0].position_bd.shape
    pairs, lengths, shapes = [], [], []
    for k, (cluster, factor) in enumerate(zip(cluster_k, factor_k, strict=True)):
        pairs.append(cluster.links + beads * k)
        lengths.append(factor * cluster.length_l)
        shapes.append(cluster.shape_l)
    pair = np.concatenate(pairs)
    image = np.zeros((len(pair), dimension), dtype=np.int64)
    return Links(pair[:, 0], pair[:, 1], image, np.concatenate(lengths), np.concatenate(shapes))
