"""Radii of a starting packing: discrete mixtures with exactly apportioned numbers, and continuous distributions.

Each distribution is a small frozen record with one method, ``radii``. Lengths are in units of the packing's reference
diameter: the smallest diameter of a mixture is 1, the mean diameter of a continuous distribution is 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from packmech.check import positive, real

# A gaussian factor this far from 1 is drawn again: radii stay positive, and cutting both tails alike keeps the mean.
_LARGEST_DEVIATION = 0.9
_LARGEST_SPREAD = 0.3


@runtime_checkable
class Sizes(Protocol):
    """A distribution of radii: anything with this method can be given as ``sizes``."""

    def radii(self, particles: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return radius_n: (N,) positive radii [length], the same for the same state of the generator."""
        ...


def sizes_of(sizes: Sizes | None, default: Sizes) -> Sizes:
    """Return the distribution that an argument `sizes` names, checked; the default for None."""
    if sizes is None:
        return default
    if not isinstance(sizes, Sizes) or isinstance(sizes, type):
        raise TypeError(f"sizes must have a method radii(particles, rng), got {sizes!r}")
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
        (the two usual mixtures, jammed-systems source, Figs. 2.16 and 2.8).
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
            raise ValueError(f"fraction must be a number or like '50:50' or '2:1' (small:large), got {self.fraction!r}")
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
            if isinstance(values, str) or not hasattr(values, "__iter__"):
                raise TypeError(f"{name} must be a sequence of numbers, got {values!r}")
            checked = tuple(positive(f"{name}[{k}]", value) for k, value in enumerate(values))
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
        Largest over smallest diameter that can be drawn, larger than 1 [1] (jammed-systems source, Fig. 2.8(c): 1.4).

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
