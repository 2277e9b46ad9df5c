# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Structure in real space: the pair distribution function, correlations of what particles carry, and their lengths.

Every pair is counted through the cell search in double precision. Pairs come in the order (i, j, image), so that sums
do not depend on how a packing was made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown, value_with_error
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import brief, entries, finite_array, instance, integer, positive, real
from packmech.contacts.cells import find_pairs, frame_of, size_levels
from packmech.jit.compiled import inlined, kernel
from packmech.linalg.line import fit_line, windows_without_ends
from packmech.packing import DISCRETE_SIZES, Packing

# a distance this near below the edge of a bin lies on it: shells of crystals are not split by rounding
_ON_EDGE = 1e-12
# bins in which the minimum after the main peak is looked for end at this many times its distance
_SEARCHED = 1.9
# largest distance where none is asked for and the box allows it
_REACH = 3.0
# as many pairs, and images of the cell, are searched at most: they stand in memory
_MOST_PAIRS, _MOST_IMAGES = 1e8, 4e6

_BIN_BYTES = 64.0


@inlined
def _bin_of(axes, row, lattice_dd, image_kd, i, j, k, width):
    """Return the bin of the distance of a pair."""
    d = len(axes)
    square = 0.0
    for a in range(d):
        x = row[j, a] - row[i, a]
        for b in range(d):
            x += lattice_dd[a, b] * image_kd[k, b]
        square += x * x
    return np.int64(np.sqrt(square) * (1.0 + _ON_EDGE) / width)


@kernel
def _count(axes, row, sizes, frame, reach, species_n, species, bins):
    """Return (S, S, B) numbers of ordered pairs of two species with their distance in a bin."""
    count = np.zeros((species, species, bins), np.int64)
    i_p, code_p, image_kd, bits = find_pairs(axes, row, sizes, frame, 1.0, 0.0)
    mask = (np.int64(1) << bits) - 1
    for p in range(i_p.shape[0]):
        i, code = np.int64(i_p[p]), np.int64(code_p[p])
        j = code >> bits
        b = _bin_of(axes, row, frame.lattice_dd, image_kd, i, j, code & mask, reach / bins)
        if b < bins:
            count[species_n[i], species_n[j], b] += 1
            count[species_n[j], species_n[i], b] += 1
    return count


@kernel
def _correlate(axes, row, sizes, frame, reach, value_nq, size_n, bins):
    """Return (B,) sums over pairs, each once, of the scalar products and of the products of sizes, and pairs."""
    product, both, count = np.zeros(bins), np.zeros(bins), np.zeros(bins, np.int64)
    i_p, code_p, image_kd, bits = find_pairs(axes, row, sizes, frame, 1.0, 0.0)
    mask = (np.int64(1) << bits) - 1
    for p in range(i_p.shape[0]):
        i, code = np.int64(i_p[p]), np.int64(code_p[p])
        j = code >> bits
        b = _bin_of(axes, row, frame.lattice_dd, image_kd, i, j, code & mask, reach / bins)
        if b < bins:
            total = 0.0
            for q in range(value_nq.shape[1]):
                total += value_nq[i, q] * value_nq[j, q]
            product[b] += total
            both[b] += size_n[i] * size_n[j]
            count[b] += 1
    return product, both, count


def _searched(packing: Packing, r_max: Any, bins: Any) -> tuple[tuple[Any, ...], float, int]:
    """Return what the pair loops take, the largest distance and the number of bins, checked."""
    number = integer("bins", bins, at_least=1, bytes_each=_BIN_BYTES)
    small, _ = packing.box.reduced()
    half = 0.5 * float(small.height_d.min())
    reach = min(_REACH, half) if r_max is None else positive("r_max", r_max)
    d = packing.dimension
    # beyond half a width a pair is near in several images, a particle in its own: all of them count
    with np.errstate(over="ignore"):
        pairs = 0.5 * packing.particles**2 * float(_shells(np.array([0.0, reach]), d)[0]) / packing.box.volume
        around = float(np.prod(2.0 * np.ceil(reach / small.height_d) + 3.0))
    if pairs > _MOST_PAIRS or packing.particles * around > 2.0**31 or around > _MOST_IMAGES:
        raise ValueError(
            f"r_max must be so small that at most {_MOST_PAIRS:g} pairs are nearer, in {_MOST_IMAGES:g} images of the "
            f"cell, got {reach:g} with about {pairs:.2g} pairs in {around:.2g} images"
        )
    wrapped, _ = small.wrap(packing.position_nd)
    row = np.zeros((packing.particles, 4))
    row[:, :d] = wrapped
    row[:, 3] = 0.5 * reach
    return ((0,) * d, row, size_levels(row[:, 3]), frame_of(small), reach), reach, number


def species_of(packing: Packing) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the (S,) radii of a mixture, growing, and each particle's place among them; more than ten count as one."""
    radius = np.sort(packing.radius_n)
    new = np.concatenate([[True], np.diff(radius) > 1e-9 * radius[1:]])
    if new.sum() > DISCRETE_SIZES:
        return np.array([float(radius.mean())]), np.zeros(packing.particles, np.int64)
    first = radius[new]
    # the nearest of them: those of one species differ by rounding at most
    middle = 0.5 * (first[1:] + first[:-1])
    return first, np.searchsorted(middle, packing.radius_n).astype(np.int64)


def _shells(edge_b: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """Return the (B,) areas or volumes between the edges."""
    unit = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    return np.asarray(unit * np.diff(edge_b**dimension))


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class PairDistribution:
    """How many pairs there are at which distance, over what there would be without any order.

    Attributes
    ----------
    edge_b
        (B + 1,) edges of the bins [length]; a distance within rounding of an edge lies above it.
    g_b
        (B,) pair distribution function [1].
    radius_s
        (S,) radii of the species of a mixture, growing [length]; their mean alone where sizes are more than ten.
    particles_s
        (S,) numbers of their particles.
    partial_ssb
        (S, S, B) partial functions, V / (N_a N_b) times pairs over shells [1]: their mean with the weights of the
        species' shares, N_a N_b / N^2, is `g_b`.
    count_ssb
        (S, S, B) numbers of ordered pairs, each pair twice.
    density
        Particles in a unit of area or volume [1/length^d].
    dimension
        Number of Cartesian axes.

    """

    edge_b: NDArray[np.float64]
    g_b: NDArray[np.float64]
    radius_s: NDArray[np.float64]
    particles_s: NDArray[np.int64]
    partial_ssb: NDArray[np.float64]
    count_ssb: NDArray[np.int64]
    density: float
    dimension: int

    @property
    def r_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [length]."""
        return np.asarray(0.5 * (self.edge_b[1:] + self.edge_b[:-1]))

    @property
    def count_b(self) -> NDArray[np.int64]:
        """The (B,) numbers of ordered pairs, each pair twice."""
        return np.asarray(self.count_ssb.sum(axis=(0, 1)))

    @property
    def coordination_b(self) -> NDArray[np.float64]:
        """The (B,) mean numbers of neighbors of a particle up to the upper edges of the bins [1]."""
        return np.asarray(np.cumsum(self.count_b) / self.particles_s.sum())

    @property
    def bin_width(self) -> float:
        """Width of a bin [length]; heights of peaks, and `translational_order`, depend on it."""
        return float(self.edge_b[1])

    @property
    def peak(self) -> float:
        """Distance of the highest bin [length]."""
        return float(self.r_b[np.argmax(self.g_b)])

    @property
    def first_minimum(self) -> float:
        """Distance of the lowest bin after the highest one, up to 1.9 times its distance [length]; nan without any.

        The mean of several that are equally low. The usual cutoff for neighbors.
        """
        window = (self.r_b > self.peak) & (self.r_b < _SEARCHED * self.peak)
        if not window.any():
            return math.nan
        return float(self.r_b[window & (self.g_b == self.g_b[window].min())].mean())

    @property
    def translational_order(self) -> float:
        """Ratio of g at the first minimum to g at the highest bin [1]; 0 in crystals, a constant in what is jammed."""
        window = (self.r_b > self.peak) & (self.r_b < _SEARCHED * self.peak)
        return float(self.g_b[window].min() / self.g_b.max()) if window.any() else math.nan

    def __repr__(self) -> str:
        return (
            f"PairDistribution of {self.particles_s.sum()} particles: {len(self.g_b)} bins up to "
            f"{self.edge_b[-1]:.6g}, highest {self.g_b.max():.4g} at {self.peak:.4g}, first minimum at "
            f"{self.first_minimum:.4g}, {len(self.radius_s)} species"
        )


@shown_as("pair distribution")
@honors("links shapes", packing_only=True)
def pair_distribution(packing: Packing, r_max: float | None = None, bins: int = 60) -> PairDistribution:
    """Return the pair distribution function of the centers, and the partial ones of a mixture.

    g(r) = V / N^2 times the ordered pairs in a bin over the area or volume of its shell (equation 2.28 of Schreck and
    O'Hern, 2010), so that it goes to 1 - 1/N at random. Pairs count at all images: beyond half the width of the box a
    pair in several, and a particle with its own, which makes g go to 1. It is that of the infinite periodic packing at
    every distance; what it repeats of the box begins to show there.

    Parameters
    ----------
    packing
        The packing; linked and touching pairs count as all others.
    r_max
        Largest distance [length]. None: half the smallest width of the box, but no more than 3.
    bins
        Number of bins of equal width.

    Returns
    -------
    PairDistribution
        With `r_b`, `g_b`, partial functions by species of radius, numbers of neighbors, and the first minimum.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or there are too many pairs within `r_max`.

    Examples
    --------
    >>> import packmech as pm
    >>> found = pm.pair_distribution(pm.lattice_packing("triangular", repeats=(8, 8)), r_max=3.0, bins=30)
    >>> found.r_b[found.count_b > 0].round(2).tolist(), found.coordination_b[[11, 18, 22]].tolist()
    ([1.05, 1.75, 2.05, 2.65], [6.0, 12.0, 18.0])

    """
    instance("packing", packing, Packing)
    given, reach, number = _searched(packing, r_max, bins)
    radius, species = species_of(packing)
    count = _count(*given, species, len(radius), number)
    edge = reach * np.arange(number + 1) / number
    shell = _shells(edge, packing.dimension)
    many = np.bincount(species, minlength=len(radius))
    volume = packing.box.volume
    return PairDistribution(
        edge_b=edge,
        g_b=count.sum(axis=(0, 1)) * volume / (float(packing.particles) ** 2 * shell),
        radius_s=radius,
        particles_s=many,
        partial_ssb=count * volume / (many[:, None, None] * many[None, :, None] * shell),
        count_ssb=count,
        density=packing.particles / volume,
        dimension=packing.dimension,
    )


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Correlation:
    """Correlation of a quantity of the particles against their distance.

    Attributes
    ----------
    edge_b
        (B + 1,) edges of the bins [length]; a distance within rounding of an edge lies above it.
    value_b
        (B,) means of v_i . conj(v_j) over the pairs of a bin [value^2]; nan where there is no pair. They are real, as
        every pair counts both ways.
    magnitude_b
        (B,) means of |v_i| |v_j| [value^2].
    count_b
        (B,) numbers of ordered pairs, each pair twice.
    mean_square
        |mean of v|^2 over all particles [value^2]: what is left at large distances.

    """

    edge_b: NDArray[np.float64]
    value_b: NDArray[np.float64]
    magnitude_b: NDArray[np.float64]
    count_b: NDArray[np.int64]
    mean_square: float

    @property
    def r_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [length]."""
        return np.asarray(0.5 * (self.edge_b[1:] + self.edge_b[:-1]))

    @property
    def connected_b(self) -> NDArray[np.float64]:
        """The (B,) |values less mean_square| [value^2]: C(r) of Schreck and O'Hern (2010)."""
        return np.abs(self.value_b - self.mean_square)

    def length(self, *, r_min: float = 0.0, separation: float = 0.0) -> CorrelationLength:
        """Return the length over which `connected_b` decays, see `correlation_length`.

        Parameters
        ----------
        r_min, separation
            As there.

        """
        return correlation_length(self.r_b, self.connected_b, self.count_b, r_min=r_min, separation=separation)

    def __repr__(self) -> str:
        return (
            f"Correlation: {len(self.value_b)} bins up to {self.edge_b[-1]:.6g}, {self.count_b.sum() // 2} pairs, "
            f"|mean|^2 {self.mean_square:.4g}"
        )


def _components(value_n: ArrayLike, particles: int) -> NDArray[np.float64]:
    """Return the (N, Q) real components of real or complex values of the particles, checked."""
    value = entries("value_n", value_n, "biufc", "numbers")
    if not value.ndim or not len(value):
        raise ValueError(f"value_n must have one entry for each of {particles} particles, got {brief(value_n)}")
    part = np.stack([value.real, value.imag], axis=-1) if np.iscomplexobj(value) else value
    return finite_array("value_n", part.reshape(len(part), -1), shape=(particles, None))


@honors("links shapes", packing_only=True)
def correlation_function(
    packing: Packing, value_n: ArrayLike, r_max: float | None = None, bins: int = 60
) -> Correlation:
    """Return the correlation <v_i . conj(v_j)> of a quantity of the particles against the distance of their centers.

    Parameters
    ----------
    packing
        The packing.
    value_n
        (N,) or (N, Q) real or complex values: psi_k or q_lm of `bond_orientational_order`, exp(2 i angle) of directors,
        displacements. Several components are multiplied one by one and summed.
    r_max
        Largest distance [length]; pairs count at all images, as in `pair_distribution`. None: half the smallest width
        of the box, but no more than 3.
    bins
        Number of bins of equal width.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or there are too many pairs within `r_max`.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(8, 8))
    >>> psi = pm.bond_orientational_order(crystal, 6).psi_n
    >>> found = pm.correlation_function(crystal, psi, r_max=3.0, bins=30)
    >>> float(found.value_b[10].round(12)), round(found.mean_square, 12)
    (1.0, 1.0)

    """
    instance("packing", packing, Packing)
    part = _components(value_n, packing.particles)
    given, reach, number = _searched(packing, r_max, bins)
    size = np.sqrt((part**2).sum(axis=1))
    product, both, count = _correlate(*given, part, size, number)
    with np.errstate(invalid="ignore"):
        found, magnitude = product / count, both / count
    mean_square = float((part.mean(axis=0) ** 2).sum())
    return Correlation(reach * np.arange(number + 1) / number, found, magnitude, 2 * count, mean_square)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class CorrelationLength:
    """The length of an exponential decay, amplitude * exp(-r / length), through the local maxima of a correlation.

    Attributes
    ----------
    length
        Decay length [length]; nan with less than three maxima, inf where they do not decay.
    error
        Its standard error from the scatter about the line, and how far the length moves when maxima are left out at
        either end, half of them at the most and three being left [length].
    amplitude
        Value of the line at r = 0 [value].
    r_m, value_m
        (M,) the maxima that were used: distances [length] and values.
    noise_m
        (M,) what counts as noise there.

    """

    length: float
    error: float
    amplitude: float
    r_m: NDArray[np.float64]
    value_m: NDArray[np.float64]
    noise_m: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"CorrelationLength: {value_with_error(self.length, self.error)}, through {len(self.r_m)} maxima"


@shown_as("correlation length")
def correlation_length(
    r_b: ArrayLike,
    value_b: ArrayLike,
    count_b: ArrayLike,
    *,
    noise_b: ArrayLike | None = None,
    r_min: float = 0.0,
    separation: float = 0.0,
) -> CorrelationLength:
    """Return the length over which a correlation decays: a line through the logarithms of its local maxima.

    Maxima count that lie above the noise, and with a `separation`, which leaves one for each wave, only up to the first
    that does not: beyond it they are maxima of noise, which does not decay. For the pair distribution function give
    g - 1.

    Parameters
    ----------
    r_b
        (B,) distances, growing [length].
    value_b
        (B,) values; nan in bins without pairs.
    count_b
        (B,) numbers of pairs.
    noise_b
        (B,) what counts as noise, not negative [value]; None: 1/sqrt(pairs in the bin), as for independent pairs. Those
        of a packing with domains are not: give twice the standard error over packings, if there are several.
    r_min
        Maxima nearer than this are left out [length].
    separation
        A maximum is to be the highest within this distance on either side, so that noise on a wave has none [length].

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import numpy as np
    >>> r = np.linspace(0.0, 10.0, 1001)
    >>> round(correlation_length(r, np.exp(-r / 2.0) * np.cos(2.0 * np.pi * r), np.full(1001, 10**6)).length, 6)
    2.0

    """
    r = finite_array("r_b", r_b, shape=(None,), what="bin")
    count = finite_array("count_b", count_b, shape=(len(r),), what="bin")
    if (np.diff(r) <= 0.0).any():
        b = int(np.argmax(np.diff(r) <= 0.0)) + 1
        raise ValueError(f"r_b must grow, got {r[b]} after {r[b - 1]} for bin {b}")
    if (count < 0.0).any():
        raise ValueError(f"count_b must not be negative, got {count.min()} for bin {int(np.argmin(count))}")
    full = entries("value_b", value_b, "biuf", "real numbers").astype(np.float64)
    value = finite_array("value_b", np.where(np.isnan(full), 0.0, full), shape=(len(r),), what="bin")
    start, apart = real("r_min", r_min), real("separation", separation, at_least=0.0)
    top = np.flatnonzero((value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:])) + 1
    noise = 1.0 / np.sqrt(np.maximum(count, 1.0))
    if noise_b is not None:
        noise = finite_array("noise_b", noise_b, shape=(len(r),), what="bin")
        if (noise < 0.0).any():
            raise ValueError(f"noise_b must not be negative, got {noise.min()} for bin {int(np.argmin(noise))}")
    top = top[(r[top] >= start) & (value[top] > 0.0) & (count[top] > 0.0)]
    above = value[top] > noise[top]
    if apart > 0.0:
        highest = np.array([value[b] >= value[np.abs(r - r[b]) <= apart].max() for b in top], dtype=bool)
        top, above = top[highest], np.logical_and.accumulate(above[highest])
    top = top[above]
    noise = noise[top]
    length = error = amplitude = math.nan
    if len(top) >= 3:
        line, covariance = np.polyfit(r[top], np.log(value[top]), 1, cov="unscaled")
        left = np.log(value[top]) - np.polyval(line, r[top])
        slope_error = math.sqrt(float(left @ left) / (len(top) - 2) * covariance[0, 0])
        amplitude = float(np.exp(line[1]))
        length = -1.0 / float(line[0]) if line[0] < 0.0 else math.inf
        error = slope_error * length**2 if line[0] < 0.0 else math.inf
        windows = [top[part] for part in windows_without_ends(len(top), 3)]
        if windows and math.isfinite(length):
            ends = [-fit_line(r[w], np.log(value[w])).slope for w in windows]
            error = math.hypot(error, max(abs(1.0 / one - length) if one > 0.0 else math.inf for one in ends))
    return CorrelationLength(length, error, amplitude, r[top], value[top], noise)
