"""Random packings, and the box that holds a given packing fraction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, instance, integer, positive
from packmech.generate.sizes import Bidisperse, Sizes, sizes_of
from packmech.packing import Packing


def random_packing(
    particles: int,
    *,
    dimension: int,
    packing_fraction: float,
    sizes: Sizes | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    box: Box | ArrayLike | None = None,
) -> Packing:
    """Return discs or spheres at independent uniform positions, in a box that gives the packing fraction asked for.

    The usual start of a quench: particles overlap at random, some of them deeply. The unit of length is the smallest
    diameter of a mixture, the mean diameter of a continuous distribution.

    Parameters
    ----------
    particles
        Number of particles N.
    dimension
        2 (discs) or 3 (spheres).
    packing_fraction
        Sum of the particle areas or volumes over that of the box [1], overlaps and rattlers counted in full.
    sizes
        Distribution of the radii: ``Monodisperse``, ``Bidisperse``, ``Mixture``, ``Uniform``, ``Normal`` or
        ``LogNormal``; ``Bidisperse()`` (50:50, 1:1.4) when nothing is said.
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    box
        Shape of the box, a ``Box`` or (d, d) lattice vectors as columns; its size is set by the packing fraction.
        Square or cubic when nothing is said.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what came.

    Examples
    --------
    >>> from packmech.generate.sizes import Bidisperse
    >>> packing = random_packing(256, dimension=2, sizes=Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1)
    >>> packing.particles, float(packing.radius_n.min())
    (256, 0.5)

    """
    particles = integer("particles", particles, at_least=1)
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    packing_fraction = positive("packing_fraction", packing_fraction)
    sizes = sizes_of(sizes, Bidisperse())
    rng = generator_of(seed, rng)
    shape_dd = shape_of(box, dimension)

    radius_n = sizes.radii(particles, rng)
    scaled = box_for(radius_n, packing_fraction, shape_dd)
    # einsum, not BLAS: the same bits for any number of threads
    position_nd = np.einsum("de,ne->nd", scaled.lattice_dd, rng.random((particles, dimension)))
    return Packing(position_nd, radius_n, box=scaled)


def fill_box(
    box: Box,
    particles: int,
    *,
    packing_fraction: float,
    sizes: Sizes | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
) -> Packing:
    """Return discs or spheres at independent uniform positions in this very box, of radii that fill it as asked.

    What `random_packing` returns for the shape of the box, in the unit of length in which the box is this one. Of an
    equal mixture with sizes 1:b in a square of side L the radii are those of equation S1-14 of particleShear's
    documentation, with r_large r_small = 2 phi L^2 / (pi N (b + 1/b)); exactly half of the particles are large.

    Parameters
    ----------
    box
        The box; 2 or 3 dimensions.
    particles
        Number of particles N.
    packing_fraction, sizes, seed, rng
        As for `random_packing`.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what came.

    Examples
    --------
    >>> packing = fill_box(Box.cubic(500.0, 2), 150, packing_fraction=1.5, seed=1)
    >>> [round(float(radius), 3) for radius in sorted(set(packing.radius_n))]
    [23.188, 32.463]

    """
    instance("box", box, Box)
    drawn = random_packing(
        particles,
        dimension=box.dimension,
        packing_fraction=packing_fraction,
        sizes=sizes,
        seed=seed,
        rng=rng,
        box=box,
    )
    scale = (box.volume / drawn.box.volume) ** (1.0 / box.dimension)
    return Packing(drawn.position_nd * scale, drawn.radius_n * scale, box=box)


def box_for(radius_n: NDArray[np.float64], packing_fraction: float, shape_dd: NDArray[np.float64]) -> Box:
    """Return the box of that shape in which the particles' volumes add up to the packing fraction."""
    dimension = len(shape_dd)
    ball = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    volume = ball * math.fsum(radius_n**dimension) / packing_fraction
    shape = Box(shape_dd)
    return shape.scaled((volume / shape.volume) ** (1.0 / dimension))


def generator_of(seed: int | None, rng: np.random.Generator | None) -> np.random.Generator:
    """Return the generator that a seed or a generator names: exactly one of them."""
    if rng is None:
        if seed is None:
            raise ValueError("seed must be an integer (or give rng, a numpy Generator), got None")
        return np.random.default_rng(integer("seed", seed, at_least=0))
    if seed is not None:
        raise ValueError(f"seed must be left out when rng is given, got {seed!r}")
    if not isinstance(rng, np.random.Generator):
        raise TypeError(f"rng must be a numpy Generator, got {rng!r}")
    return rng


def shape_of(box: Box | ArrayLike | None, dimension: int) -> NDArray[np.float64]:
    """Return the (d, d) lattice vectors that give a box its shape; those of a square or a cube for None."""
    if box is None:
        return np.eye(dimension)
    lattice_dd = box.lattice_dd if isinstance(box, Box) else box
    checked = finite_array("box", lattice_dd, shape=(dimension, dimension), what="row")
    length_d = np.linalg.norm(checked, axis=0)
    if not (length_d > 0).all() or abs(np.linalg.det(checked / length_d)) < 1e-12:
        raise ValueError(f"box must have linearly independent columns, got {checked.tolist()}")
    return checked
