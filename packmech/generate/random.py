"""Random packings, and the sizes of their particles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import (
    PARTICLE_BYTES,
    brief,
    clear_errors,
    finite_array,
    given_shape,
    instance,
    integer,
    listed,
    positive,
    positive_array,
    real,
)
from packmech.generate.cluster_shapes import RandomShape, Shape, drawn_clusters
from packmech.generate.rigid import beads_of, body_of
from packmech.packing import Packing, masses_of_density
from packmech.shapes import SHARPEST, Shapes, Spheroids, Superellipsoids

# A gaussian factor this far from 1 is drawn again: radii stay positive, and cutting both tails alike keeps the mean.
_LARGEST_DEVIATION = 0.9
_LARGEST_SPREAD = 0.3
# packing fraction beyond which no start makes sense: every place lies in five particles
_LARGEST_FRACTION = 5.0


@runtime_checkable
class SizeDistribution(Protocol):
    """A distribution of radii: anything with this method can be given as ``sizes``."""

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) positive radii [length], the same for the same state of the generator."""
        ...


@dataclass(frozen=True, eq=False)
class _Listed:
    """Radii as they are given, one for each particle."""

    radius_n: NDArray[np.float64]

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return the radii."""
        if len(self.radius_n) != particles:
            raise ValueError(f"sizes must hold as many radii as are drawn ({particles}), got {len(self.radius_n)}")
        return self.radius_n.copy()


def sizes_of(sizes: SizeDistribution | ArrayLike | None, default: SizeDistribution) -> SizeDistribution:
    """Return the distribution that an argument `sizes` names, checked; the default for None."""
    if sizes is None:
        return default
    if isinstance(sizes, list | tuple | np.ndarray) and not isinstance(sizes, SizeDistribution):
        return _Listed(positive_array("sizes", sizes, shape=(None,)))
    if not isinstance(sizes, SizeDistribution) or isinstance(sizes, type):
        raise TypeError(f"sizes must be radii or have a method radii(particles, rng), got {brief(sizes)}")
    return sizes


def apportion(particles: int, fractions: tuple[float, ...]) -> tuple[int, ...]:
    """Return how many of ``particles`` each fraction gets: whole numbers that add up to ``particles``.

    Largest remainders (Hamilton's method): every share is rounded down, and what is left goes one each to the largest
    remainders, the earlier entry first when they tie.

    >>> apportion(5, (0.5, 0.5))
    (3, 2)
    """
    total = math.fsum(fractions)
    shares = [particles * fraction / total for fraction in fractions]
    # A share such as 3 * (1/3) may fall one rounding short of a whole number.
    counts = [math.floor(share + 1e-9) for share in shares]
    left = particles - sum(counts)
    by_remainder = sorted(range(len(shares)), key=lambda k: (-round(shares[k] - counts[k], 9), k))
    for k in by_remainder[:left]:
        counts[k] += 1
    return tuple(counts)


def _gaussian_factors(particles: int, spread: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return factor_n = 1 + spread * gaussian, drawn again where it leaves [0.1, 1.9]."""
    deviation_n = spread * rng.standard_normal(particles)
    while True:
        far_n = np.abs(deviation_n) > _LARGEST_DEVIATION
        count = int(np.count_nonzero(far_n))
        if count == 0:
            return 1.0 + deviation_n
        deviation_n[far_n] = spread * rng.standard_normal(count)


def _scattered(radius_n: NDArray[np.float64], scatter: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the radii, each times its own 1 + scatter * gaussian; nothing is drawn when scatter is 0."""
    return radius_n if scatter == 0.0 else radius_n * _gaussian_factors(radius_n.size, scatter, rng)


def _mean_diameter_one(radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radii scaled to mean radius 1/2: the sample's own mean, so that the unit of length is exact."""
    return radius_n * (0.5 * radius_n.size / math.fsum(radius_n))


@dataclass(frozen=True)
class Monodisperse:
    """Equal spheres of diameter 1 [length].

    Parameters
    ----------
    scatter
        Each radius is multiplied by 1 + scatter * gaussian (0.03: "radii scattered by 3 %"), at most 0.3 [1].
        It makes a packing generic: no crystalline patch closes redundant contacts exactly.

    Examples
    --------
    >>> import numpy as np
    >>> Monodisperse().radii(3, np.random.default_rng(0))
    array([0.5, 0.5, 0.5])
    """

    scatter: float = 0.0

    def __post_init__(self) -> None:
        real("scatter", self.scatter, at_least=0.0, at_most=_LARGEST_SPREAD)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length]."""
        return _scattered(np.full(particles, 0.5), self.scatter, rng)


@dataclass(frozen=True)
class Bidisperse:
    """Small spheres of diameter 1 and large ones of diameter ``ratio`` [length], small ones first.

    Parameters
    ----------
    ratio
        Large over small diameter, larger than 1 [1].
    fraction
        Number fraction of the small spheres, or the two numbers by name: ``"50:50"`` or ``"2:1"`` is small : large
        (the two usual mixtures, Schreck and O'Hern (2010), figures 2.16 and 2.8).
    scatter
        Each radius is multiplied by 1 + scatter * gaussian, at most 0.3 [1].

    Examples
    --------
    >>> import numpy as np
    >>> Bidisperse(ratio=1.4, fraction="2:1").radii(3, np.random.default_rng(0))
    array([0.5, 0.5, 0.7])
    """

    ratio: float = 1.4
    fraction: float | str = 0.5
    scatter: float = 0.0

    def __post_init__(self) -> None:
        real("ratio", self.ratio, above=1.0)
        real("scatter", self.scatter, at_least=0.0, at_most=_LARGEST_SPREAD)
        self._small_fraction()

    def _small_fraction(self) -> float:
        if not isinstance(self.fraction, str):
            return real("fraction", self.fraction, above=0.0, below=1.0)
        parts = self.fraction.split(":")
        if len(parts) != 2 or not all(part.strip().isdigit() and int(part) > 0 for part in parts):
            raise ValueError(
                f"fraction must be a number or like '50:50' or '2:1' (small:large), got {brief(self.fraction)}"
            )
        small, large = (int(part) for part in parts)
        return small / (small + large)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length], small spheres first."""
        small = self._small_fraction()
        return Mixture((1.0, float(self.ratio)), (small, 1.0 - small), self.scatter).radii(particles, rng)


@dataclass(frozen=True)
class Mixture:
    """Any discrete mixture, in the order of ``ratios``; the smallest diameter is 1 [length].

    Parameters
    ----------
    ratios
        Diameters relative to each other, positive [1].
    fractions
        Number fractions, positive; they are divided by their sum [1].
    scatter
        Each radius is multiplied by 1 + scatter * gaussian, at most 0.3 [1].

    Examples
    --------
    >>> import numpy as np
    >>> Mixture(ratios=(2, 4, 6), fractions=(2, 1, 1)).radii(4, np.random.default_rng(0))
    array([0.5, 0.5, 1. , 1.5])
    """

    ratios: tuple[float, ...]
    fractions: tuple[float, ...]
    scatter: float = 0.0

    def __post_init__(self) -> None:
        for name in ("ratios", "fractions"):
            values = getattr(self, name)
            given = listed(name, values, "numbers")
            checked = tuple(positive(f"{name}[{k}]", value) for k, value in enumerate(given))
            object.__setattr__(self, name, checked)
        if not self.ratios:
            raise ValueError("ratios must hold at least one number, got ()")
        if len(self.ratios) != len(self.fractions):
            raise ValueError(
                f"fractions must hold one number for each of the {len(self.ratios)} ratios, got {len(self.fractions)}"
            )
        real("scatter", self.scatter, at_least=0.0, at_most=_LARGEST_SPREAD)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length], in the order of ``ratios``."""
        radius_k = 0.5 * np.asarray(self.ratios) / min(self.ratios)
        radius_n = np.repeat(radius_k, apportion(particles, self.fractions))
        return _scattered(radius_n, self.scatter, rng)


@dataclass(frozen=True)
class Uniform:
    """Diameters with a flat distribution, largest over smallest = ``ratio``; the mean diameter is 1 [length].

    Parameters
    ----------
    ratio
        Largest over smallest diameter that can be drawn, larger than 1 [1] (Schreck and O'Hern, 2010, figure 2.8(c):
        1.4).

    Examples
    --------
    >>> import numpy as np
    >>> radius_n = Uniform(ratio=1.4).radii(1000, np.random.default_rng(0))
    >>> bool(radius_n.max() / radius_n.min() <= 1.4), round(float(radius_n.mean()), 12)
    (True, 0.5)
    """

    ratio: float = 1.4

    def __post_init__(self) -> None:
        real("ratio", self.ratio, above=1.0)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length]."""
        return _mean_diameter_one(1.0 + (self.ratio - 1.0) * rng.random(particles))


@dataclass(frozen=True)
class Normal:
    """Diameters with a normal distribution; the mean diameter is 1 [length].

    Parameters
    ----------
    spread
        Standard deviation over mean, larger than 0 and at most 0.3 [1]. Values outside 0.1 to 1.9 means: drawn again.

    Examples
    --------
    >>> import numpy as np
    >>> radius_n = Normal(spread=0.1).radii(1000, np.random.default_rng(0))
    >>> round(float(radius_n.std() / radius_n.mean()), 2)
    0.1
    """

    spread: float = 0.1

    def __post_init__(self) -> None:
        real("spread", self.spread, above=0.0, at_most=_LARGEST_SPREAD)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length]."""
        return _mean_diameter_one(_gaussian_factors(particles, self.spread, rng))


@dataclass(frozen=True)
class LogNormal:
    """Diameters with a log-normal distribution; the mean diameter is 1 [length].

    Parameters
    ----------
    spread
        Standard deviation over mean of the diameter itself (not of its logarithm), larger than 0 [1].

    Examples
    --------
    >>> import numpy as np
    >>> radius_n = LogNormal(spread=0.2).radii(1000, np.random.default_rng(0))
    >>> round(float(radius_n.std() / radius_n.mean()), 1)
    0.2
    """

    spread: float = 0.1

    def __post_init__(self) -> None:
        positive("spread", self.spread)

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) radii [length]."""
        # Var/mean^2 of exp(s g) is exp(s^2) - 1.
        width = math.sqrt(math.log1p(float(self.spread) ** 2))
        return _mean_diameter_one(np.exp(width * rng.standard_normal(particles)))


@dataclass(frozen=True)
class Ellipses:
    """Ellipses, in space spheroids, for `random_packing`.

    Parameters
    ----------
    aspect
        Axis along the director over that across it, one for all or one for each particle: above 1 prolate, below 1
        oblate [1].

    Examples
    --------
    >>> packing = random_packing(8, dimension=3, packing_fraction=0.5, shapes=Ellipses(aspect=1.5), seed=1)
    >>> packing.shapes.aspect_n.tolist()[:2]
    [1.5, 1.5]

    """

    aspect: float | tuple[float, ...]

    def __post_init__(self) -> None:
        each = bool(given_shape(self.aspect))
        aspect = (
            tuple(positive_array("aspect", self.aspect, shape=(None,)).tolist())
            if each
            else positive("aspect", self.aspect)
        )
        object.__setattr__(self, "aspect", aspect)

    def turned(self, particles: int, dimension: int, rng: np.random.Generator) -> Spheroids:
        """Return so many ellipses or spheroids, turned in all directions alike."""
        given = self.aspect
        aspect_n = (
            np.full(particles, given) if np.ndim(given) == 0 else positive_array("aspect", given, shape=(particles,))
        )
        return Spheroids(aspect_n, rng.standard_normal((particles, dimension)))


@dataclass(frozen=True)
class Superellipses:
    """Superellipses, in space superellipsoids, all of one form, for `random_packing`.

    Parameters
    ----------
    exponent
        Exponent of |x/a|^p + |y/b|^p (+ |z/c|^p) = 1: 2 for ellipses and for ellipsoids, which may have three different
        axes, up to 50 for nearly rectangles and boxes [1].
    ratios
        The two or three semi-axes over each other; all equal unless given [1].

    Examples
    --------
    >>> flat = Superellipses(2.0, ratios=(3.0, 2.0, 1.0))
    >>> packing = random_packing(8, dimension=3, packing_fraction=0.5, shapes=flat, seed=1)
    >>> packing.shapes.axes(packing.radius_n)[0].round(6).tolist()
    [0.825482, 0.550321, 0.275161]

    """

    exponent: float = 4.0
    ratios: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "exponent", real("exponent", self.exponent, at_least=2.0, at_most=SHARPEST))
        if self.ratios is not None:
            ratios = positive_array("ratios", self.ratios, shape=(None,))
            if len(ratios) not in (2, 3):
                raise ValueError(f"ratios must be two or three, got {len(ratios)}")
            object.__setattr__(self, "ratios", tuple(ratios.tolist()))

    def turned(self, particles: int, dimension: int, rng: np.random.Generator) -> Superellipsoids:
        """Return so many of them, turned in all directions alike."""
        ratios = (1.0,) * dimension if self.ratios is None else self.ratios
        if len(ratios) != dimension:
            raise ValueError(f"ratios must be one for each of {dimension} axes, got {ratios}")
        turn = rng.standard_normal((particles, 2 if dimension == 2 else 4))
        return Superellipsoids(np.full(particles, self.exponent), np.tile(ratios, (particles, 1)), turn)


@clear_errors
def random_packing(
    particles: int,
    *,
    dimension: int,
    packing_fraction: float,
    sizes: SizeDistribution | ArrayLike | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    box: Box | ArrayLike | None = None,
    density: float | None = None,
    shapes: Ellipses | Superellipses | Shape | RandomShape | None = None,
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
        ``LogNormal``; ``Bidisperse()`` (50:50, 1:1.4) when nothing is said. Or the (N,) radii themselves [length].
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    box
        Shape of the box, a ``Box`` or (d, d) lattice vectors as columns; its size is set by the packing fraction.
        Square or cubic when nothing is said.
    density
        Mass over area, or over volume in space, of every particle [mass/length^d]; as of a `Packing` unless given.
    shapes
        ``Ellipses`` of an aspect, ``Superellipses``, or rigid bodies of the shape of a cluster (``Dimer``, ``Trimer``,
        ``LinearCluster``, ..., or anything that `cluster_packing` takes), of the discs' or spheres' areas or volumes
        and turned in all directions alike. The radii and positions are those of the same seed without.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what was given.

    Examples
    --------
    >>> from packmech.generate.random import Bidisperse
    >>> packing = random_packing(256, dimension=2, sizes=Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1)
    >>> packing.particles, float(packing.radius_n.min())
    (256, 0.5)

    """
    particles = integer("particles", particles, at_least=1, bytes_each=PARTICLE_BYTES)
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    packing_fraction = start_fraction(packing_fraction)
    sizes = sizes_of(sizes, Bidisperse())
    rng = generator_of(seed, rng)
    shape_dd = shape_of(box, dimension)

    radius_n = sizes.radii(particles, rng)
    scaled = box_for(radius_n, packing_fraction, shape_dd)
    # einsum, not BLAS: the same bits for any number of threads
    position_nd = np.einsum("de,ne->nd", scaled.lattice_dd, rng.random((particles, dimension)))
    turned = _random_shapes(shapes, particles, dimension, rng)
    masses = masses_of_density(density, radius_n, dimension)
    return Packing(position_nd, radius_n, scaled, mass_n=masses, shapes=turned)


def _random_shapes(
    shapes: Ellipses | Superellipses | Shape | RandomShape | None,
    particles: int,
    dimension: int,
    rng: np.random.Generator,
) -> Shapes | None:
    """Return shapes turned in all directions alike, None where none are given."""
    if shapes is None:
        return None
    if isinstance(shapes, Ellipses | Superellipses):
        return shapes.turned(particles, dimension, rng)
    if not isinstance(shapes, Shape | RandomShape):
        raise TypeError(
            f"shapes must be Ellipses, Superellipses or a shape of a cluster, such as Dimer(), got {brief(shapes)}"
        )
    clusters = drawn_clusters(shapes, particles, dimension, rng)
    found = {key: body_of(one.position_bd, one.radius_b) for key, one in {id(one): one for one in clusters}.items()}
    return beads_of([found[id(one)] for one in clusters], rng.standard_normal((particles, 2 if dimension == 2 else 4)))


def start_fraction(packing_fraction: Any) -> float:
    """Return the packing fraction of a start after checking it: a percentage is none."""
    found = positive("packing_fraction", packing_fraction)
    if found > _LARGEST_FRACTION:
        raise ValueError(
            f"packing_fraction must be at most {_LARGEST_FRACTION:g}, got {brief(packing_fraction)}: it is the "
            "particles' volume over the box's, 0.9 for 90 %, and "
            "random packings jam near 0.84 in the plane and 0.64 in space"
        )
    return found


@clear_errors
def fill_box(
    box: Box,
    particles: int,
    *,
    packing_fraction: float,
    sizes: SizeDistribution | ArrayLike | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    density: float | None = None,
    shapes: Ellipses | Superellipses | Shape | RandomShape | None = None,
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
    packing_fraction, sizes, seed, rng, density, shapes
        As for `random_packing`.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what was given.

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
        shapes=shapes,
    )
    scale = (box.volume / drawn.box.volume) ** (1.0 / box.dimension)
    radius_n = drawn.radius_n * scale
    masses = masses_of_density(density, radius_n, box.dimension)
    return Packing(drawn.position_nd * scale, radius_n, box, mass_n=masses, shapes=drawn.shapes)


def box_for(
    radius_n: NDArray[np.float64], packing_fraction: float, shape_dd: NDArray[np.float64], shared: float = 0.0
) -> Box:
    """Return the box of that shape in which the particles' volumes, less what they share, are the packing fraction."""
    dimension = len(shape_dd)
    ball = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    with np.errstate(over="ignore", under="ignore"):
        power_n = radius_n**dimension
        # a sum of numbers that are finite need not be
        whole = math.fsum(power_n) if float(power_n.sum()) < math.inf else math.inf
        volume = (ball * whole - shared) / packing_fraction
    shape = Box(shape_dd)
    if not 0.0 < volume / shape.volume < math.inf:
        raise ValueError(
            f"radii must be of volumes that float64 can hold, got {radius_n.min():g} to {radius_n.max():g} in a box of "
            f"volume {volume:g}"
        )
    return shape.scaled((volume / shape.volume) ** (1.0 / dimension))


def generator_of(seed: int | None, rng: np.random.Generator | None) -> np.random.Generator:
    """Return the generator that a seed or a generator names: exactly one of them."""
    if rng is None:
        if seed is None:
            raise ValueError("seed must be an integer (or give rng, a numpy Generator), got None")
        return np.random.default_rng(integer("seed", seed, at_least=0))
    if seed is not None:
        raise ValueError(f"seed must be left out when rng is given, got {brief(seed)}")
    if not isinstance(rng, np.random.Generator):
        raise TypeError(f"rng must be a numpy Generator, got {brief(rng)}")
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
