# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Structure in reciprocal space: structure factors, the spectral density of sizes, shell averages, small wave vectors.

A wave vector is k = 2 pi (inverse transposed lattice) @ index: its product with a lattice vector is 2 pi times an
integer, so that what is measured is periodic with the packing in any box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.special import j1, spherical_jn

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import boolean, clear_errors, finite_array, instance, integer_array, positive
from packmech.jit.compiled import inlined, kernel
from packmech.measure.structure import species_of
from packmech.packing import Packing

# particles at a time: the phases of their places then stay in the cache
_BLOCK = 64
# numbers of a table of weights that are held at once
_WEIGHTS = 2_000_000
# steps of scoring of a line of two parameters, which converges quadratically
_SCORINGS = 30
# largest index of packings that count as hyperuniform
_HYPERUNIFORM = 1e-3
# indices beyond this, times the fraction, leave fewer digits of the phase than are promised
_LARGEST_INDEX = 2**20


@inlined
def _phases(fraction_nd, low, count, value_v, place_v, table):
    """Write cosine and sine of 2 pi times the values of an index times each fraction, of a block of particles."""
    for v in range(value_v.shape[0]):
        a, index = place_v[v], value_v[v]
        for p in range(_BLOCK):
            turn = 0.0
            if p < count:
                turn = index * fraction_nd[low + p, a]
                turn -= np.rint(turn)
            table[v, 0, p] = np.cos(2.0 * np.pi * turn)
            table[v, 1, p] = np.sin(2.0 * np.pi * turn)


@kernel
def _density(fraction_nd, value_v, place_v, entry_kd, weight_kn):
    """Return (K, 2) sums of weights times cosines and sines of k . x; weights of shape (1, 1) are ones.

    The phases of each value that an index takes along an axis are computed once for a block of particles; those of a
    wave vector are their products.
    """
    n, d = fraction_nd.shape
    vectors = entry_kd.shape[0]
    weighted = weight_kn.shape[1] == n and weight_kn.shape[0] == vectors
    found = np.zeros((vectors, 2))
    table = np.empty((value_v.shape[0], 2, _BLOCK))
    real, imaginary = np.empty(_BLOCK), np.empty(_BLOCK)
    for low in range(0, n, _BLOCK):
        count = min(_BLOCK, n - low)
        _phases(fraction_nd, low, count, value_v, place_v, table)
        for k in range(vectors):
            first, second = table[entry_kd[k, 0]], table[entry_kd[k, 1]]
            for p in range(_BLOCK):
                real[p] = first[0, p] * second[0, p] - first[1, p] * second[1, p]
                imaginary[p] = first[0, p] * second[1, p] + first[1, p] * second[0, p]
            if d == 3:
                third = table[entry_kd[k, 2]]
                for p in range(_BLOCK):
                    x, y = real[p], imaginary[p]
                    real[p] = x * third[0, p] - y * third[1, p]
                    imaginary[p] = x * third[1, p] + y * third[0, p]
            if weighted:
                for p in range(count):
                    real[p] *= weight_kn[k, low + p]
                    imaginary[p] *= weight_kn[k, low + p]
            for p in range(count, _BLOCK):
                real[p] = imaginary[p] = 0.0
            # halves on halves: as exact as it is fast, and always the same
            half = _BLOCK // 2
            while half > 0:
                for p in range(half):
                    real[p] += real[p + half]
                    imaginary[p] += imaginary[p + half]
                half //= 2
            found[k, 0] += real[0]
            found[k, 1] += imaginary[0]
    return found


class _Waves:
    """Wave vectors as the compiled sum takes them: the values that indices take along each axis, and entries there."""

    def __init__(self, packing: Packing, index_kd: ArrayLike) -> None:
        instance("packing", packing, Packing)
        d = packing.dimension
        index = integer_array("index_kd", index_kd, shape=(None, d), what="wave vector")
        if np.abs(index).max(initial=0) > _LARGEST_INDEX:
            k = int(np.abs(index).max(axis=1).argmax())
            raise ValueError(f"index_kd must stay within {_LARGEST_INDEX}, got {index[k].tolist()} for wave vector {k}")
        values: list[NDArray[np.int64]] = []
        entries, places = [], []
        for a in range(d):
            value, entry = np.unique(index[:, a], return_inverse=True)
            entries.append(entry.reshape(-1) + sum(len(one) for one in values))
            values.append(value)
            places.append(np.full(len(value), a))
        self.value_v, self.place_v = np.concatenate(values).astype(float), np.concatenate(places)
        self.entry_kd = np.ascontiguousarray(np.stack(entries, axis=1))
        self.vector_kd = wave_vectors(packing.box, index)
        fraction = packing.position_nd @ packing.box.inverse_dd.T
        self.fraction_nd = fraction - np.floor(fraction)

    def density(
        self, kept_n: NDArray[np.bool_] | None = None, weight_kn: NDArray[np.float64] | None = None, first: int = 0
    ) -> NDArray[np.complex128]:
        """Return the (K,) sums of exp(i k . x) over particles, weighted from the first wave vector on if asked for."""
        fraction = self.fraction_nd if kept_n is None else np.ascontiguousarray(self.fraction_nd[kept_n])
        weight = np.ones((1, 1)) if weight_kn is None else weight_kn
        entry = self.entry_kd if weight_kn is None else self.entry_kd[first : first + len(weight_kn)]
        found = _density(fraction, self.value_v, self.place_v, entry, weight)
        return np.asarray(found[:, 0] + 1j * found[:, 1])


@clear_errors
def wave_vectors(box: Box, index_kd: ArrayLike) -> NDArray[np.float64]:
    """Return the (K, d) wave vectors 2 pi (inverse transposed lattice) @ index [1/length].

    Parameters
    ----------
    box
        The periodic box.
    index_kd
        (K, d) integers.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> (pm.wave_vectors(pm.Box([[2.0, 1.0], [0.0, 4.0]]), [[1, 0], [0, 1]]) / np.pi).tolist()
    [[1.0, -0.25], [0.0, 0.5]]

    """
    instance("box", box, Box)
    index = integer_array("index_kd", index_kd, shape=(None, box.dimension), what="wave vector")
    return np.asarray(2.0 * np.pi * index @ box.inverse_dd)


@clear_errors
def wave_indices(box: Box, k_max: float, *, half: bool = False) -> NDArray[np.int64]:
    """Return the (K, d) indices of all wave vectors that a box admits up to a length, by length; zero is left out.

    Parameters
    ----------
    box
        The periodic box, of any shape.
    k_max
        Largest length of a wave vector [1/length].
    half
        Whether of each pair of opposite ones, which have the same structure factor, only one is wanted.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or there would be more than 10^7 of them to look through.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.wave_indices(pm.Box.cubic(1.0, 2), 6.3).tolist()
    [[-1, 0], [0, -1], [0, 1], [1, 0]]

    """
    instance("box", box, Box)
    largest = positive("k_max", k_max)
    boolean("half", half)
    d = box.dimension
    # m = lattice^T k / 2 pi, so an index is at most the vector's length times k over 2 pi; few where vectors are short
    small, change = box.reduced()
    bound = np.floor(np.linalg.norm(small.lattice_dd, axis=0) * largest / (2.0 * np.pi) + 1e-9)
    if np.prod(2.0 * bound + 1.0) > 1e7:
        raise ValueError(f"k_max must leave at most 1e7 indices to look through, got {largest:g}")
    axes = [np.arange(-int(one), int(one) + 1) for one in bound]
    index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    length = np.linalg.norm(2.0 * np.pi * index @ small.inverse_dd, axis=1)
    kept = (length <= largest * (1.0 + 1e-12)) & index.any(axis=1)
    index, length = index[kept], length[kept]
    # of the reduced lattice L U the index is U^T m
    index = np.rint(index @ np.linalg.inv(change)).astype(np.int64)
    if half:
        sign = np.zeros(len(index), np.int64)
        for a in range(d):
            sign = np.where(sign == 0, np.sign(index[:, a]), sign)
        index, length = index[sign > 0], length[sign > 0]
    # lengths that differ by rounding are equal
    level = np.zeros(len(length), np.int64)
    order = np.argsort(length, kind="stable")
    level[order[1:]] = np.cumsum(np.diff(length[order]) > 1e-9 * largest)
    return np.ascontiguousarray(index[np.lexsort((*index.T[::-1], level))])


@shown_as("structure factor")
@honors("links shapes", packing_only=True)
def structure_factor(packing: Packing, index_kd: ArrayLike) -> NDArray[np.float64]:
    """Return the (K,) structure factors |sum of exp(i k . x)|^2 / N of the centers, the self term included [1].

    The wave vectors are k = 2 pi (inverse transposed lattice) @ index, in any box; `wave_indices` lists all up to a
    length, `shell_average` averages over directions. For two sizes and more the fluctuations of what particles fill are
    those of `spectral_density`; S(k) of all centers together is a poor measure of them.

    Parameters
    ----------
    packing
        The packing.
    index_kd
        (K, d) integers of either sign, up to 2^20.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.structure_factor(pm.lattice_packing("square", repeats=(4, 4)), [[4, 0], [1, 2]]).round(12).tolist()
    [16.0, 0.0]

    """
    density = _Waves(packing, index_kd).density()
    return np.asarray((density.real**2 + density.imag**2) / packing.particles)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class PartialStructureFactors:
    """Structure factors of a mixture, species by species.

    Attributes
    ----------
    radius_s
        (S,) radii of the species, growing [length]; their mean alone where sizes are more than ten.
    particles_s
        (S,) numbers of their particles.
    value_ssk
        (S, S, K) rho_a conj(rho_b) / N [1], complex and Hermitian in (a, b); summed over both, the structure factor.

    """

    radius_s: NDArray[np.float64]
    particles_s: NDArray[np.int64]
    value_ssk: NDArray[np.complex128]

    def __repr__(self) -> str:
        return f"PartialStructureFactors: {len(self.radius_s)} species, {self.value_ssk.shape[2]} wave vectors"


@shown_as("structure factors")
@honors("links shapes", packing_only=True)
def partial_structure_factors(packing: Packing, index_kd: ArrayLike) -> PartialStructureFactors:
    """Return the structure factors of the species of a mixture, rho_a conj(rho_b) / N.

    Parameters
    ----------
    packing, index_kd
        As in `structure_factor`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.5, seed=1)
    >>> parts, whole = (one(packing, [[1, -2]]) for one in (pm.partial_structure_factors, pm.structure_factor))
    >>> bool(abs(parts.value_ssk.sum() - whole[0]) < 1e-12)
    True

    """
    waves = _Waves(packing, index_kd)
    radius, species = species_of(packing)
    density = np.stack([waves.density(species == s) for s in range(len(radius))])
    value = density[:, None] * density[None, :].conj() / packing.particles
    return PartialStructureFactors(radius, np.bincount(species, minlength=len(radius)), value)


def _form(q: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """Return the Fourier transform of a disc or sphere of unit area or volume, at wave number times radius."""
    safe = np.where(q == 0.0, 1.0, q)
    bessel = 2.0 * j1(safe) if dimension == 2 else 3.0 * spherical_jn(1, safe)
    return np.where(q == 0.0, 1.0, bessel / safe)


@shown_as("spectral density")
@honors("links shapes", packing_only=True)
def spectral_density(packing: Packing, index_kd: ArrayLike) -> NDArray[np.float64]:
    """Return the (K,) spectral densities of what particles fill, |sum of v m(k) exp(i k . x)|^2 / V [length^d].

    v m(k) is the Fourier transform of a particle's area or volume: 2 pi R J1(k R) / k for discs, the like for spheres,
    and for ellipses and spheroids that of the disc or sphere at the wave number squeezed along their axes. Where
    particles overlap, what they share counts for each. Small wave vectors tell how even the packing is, whatever the
    sizes (Zachary, Jiao and Torquato 2011).

    Parameters
    ----------
    packing
        The packing, of discs, spheres, ellipses or spheroids; of rigid bodies of beads the form is not known.
    index_kd
        As in `structure_factor`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or particles are `Beads`.

    Examples
    --------
    >>> import packmech as pm
    >>> one = pm.Packing([[0.3, 0.2]], [0.5], pm.Box.cubic(4.0, 2))
    >>> round(float(pm.spectral_density(one, [[0, 0]])[0]), 12), round((np.pi / 4) ** 2 / 16, 12)
    (0.038553142192, 0.038553142192)

    """
    waves = _Waves(packing, index_kd)
    shapes, d = packing.shapes, packing.dimension
    if shapes.has_beads or not shapes.has_spheroid_sites:
        raise ValueError(
            f"packing must be of discs, spheres, ellipses or spheroids for pm.spectral_density, got "
            f"{type(shapes).__name__}: ask pm.structure_factor for their centers"
        )
    unit = math.pi if d == 2 else 4.0 * math.pi / 3.0
    length_k = np.linalg.norm(waves.vector_kd, axis=1)
    radius, place = np.unique(packing.radius_n, return_inverse=True)
    if not shapes.has_orientations and len(radius) <= 16:
        total = np.zeros(len(length_k), np.complex128)
        for s, one in enumerate(radius):
            total += unit * one**d * _form(length_k * one, d) * waves.density(place.reshape(-1) == s)
    else:
        parts = []
        rows = max(1, _WEIGHTS // packing.particles)
        for first in range(0, len(length_k), rows):
            vector = waves.vector_kd[first : first + rows]
            along, across = shapes.semi_axes(packing.radius_n)
            square = (vector**2).sum(axis=1)[:, None]
            part = (vector[:, None, :] * shapes.axis_nd).sum(axis=2) ** 2
            q = np.sqrt(along**2 * part + across**2 * np.maximum(square - part, 0.0))
            weight = unit * packing.radius_n**d * _form(q, d)
            parts.append(waves.density(weight_kn=np.ascontiguousarray(weight), first=first))
        total = np.concatenate(parts)
    return np.asarray((total.real**2 + total.imag**2) / packing.box.volume)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class ShellAverage:
    """Means over directions of what was measured at wave vectors, in shells of their length.

    Attributes
    ----------
    k_b
        (B,) mean lengths of the wave vectors of each shell [1/length].
    value_b
        (B,) means, each wave vector with the same weight.
    error_b
        (B,) standard errors, opposite wave vectors as one; nan for a single one.
    count_b
        (B,) numbers of wave vectors.

    """

    k_b: NDArray[np.float64]
    value_b: NDArray[np.float64]
    error_b: NDArray[np.float64]
    count_b: NDArray[np.int64]

    def power_law(self, k_min: float, k_max: float) -> SpectrumFit:
        """Return the fits of amplitude * k^exponent and of value_at_zero + c * k^a between two wave numbers.

        Values at single wave vectors are distributed exponentially, so that means over shells follow a gamma
        distribution; both fits are the likeliest under it. Errors hold the scatter of the shells, and how far the fit
        moves when the lowest or the highest quarter of the shells is left out.

        Parameters
        ----------
        k_min, k_max
            Where the shells lie that count [1/length].

        Raises
        ------
        ValueError
            If fewer than three of them do, or one has a value that is not positive.

        """
        low, high = positive("k_min", k_min), positive("k_max", k_max)
        inside = (self.k_b >= low) & (self.k_b <= high)
        if inside.sum() < 3 or (self.value_b[inside] <= 0.0).any():
            raise ValueError(
                f"k_min and k_max must enclose at least three shells of positive values, got {int(inside.sum())} "
                f"shells between {low:g} and {high:g}"
            )
        k, value, count = self.k_b[inside], self.value_b[inside], self.count_b[inside].astype(float)
        quarter = max(1, len(k) // 4)
        windows = (slice(quarter, None), slice(None, -quarter))
        line, line_error = _spectral_line(k, value, count)
        moved = math.nan
        if len(k) - quarter >= 3:
            moved = max(abs(_spectral_line(k[w], value[w], count[w])[0][0] - line[0]) for w in windows)
        zero, zero_error = math.nan, math.nan
        if len(k) - quarter >= 4:
            zero, scatter = _spectral_limit(k, value, count)
            shifts = [_spectral_limit(k[w], value[w], count[w])[0] - zero for w in windows]
            zero_error = math.hypot(scatter, max(abs(one) for one in shifts))
        peak = float(self.value_b.max())
        return SpectrumFit(
            exponent=float(line[0]),
            exponent_error=math.hypot(line_error, moved),
            amplitude=float(np.exp(line[1])),
            value_at_zero=zero,
            value_at_zero_error=zero_error,
            hyperuniformity_index=zero / peak,
            hyperuniformity_index_error=zero_error / peak,
            k_min=low,
            k_max=high,
            shells=len(k),
        )

    def __repr__(self) -> str:
        return (
            f"ShellAverage: {self.count_b.sum()} wave vectors in {len(self.k_b)} shells, {self.k_b[0]:.4g} to "
            f"{self.k_b[-1]:.4g}, highest {self.value_b.max():.4g} at {self.k_b[np.argmax(self.value_b)]:.4g}"
        )


@shown()
@dataclass(frozen=True)
class SpectrumFit:
    """How a structure factor or spectral density falls towards small wave numbers, in a window.

    A window says nothing of what lies below it.

    Attributes
    ----------
    exponent, exponent_error
        Of amplitude * k^exponent, and its standard error [1]: the scatter of the shells, and how far the exponent moves
        when the lowest or the highest quarter of them is left out; nan where fewer than three shells would be left.
    amplitude
        At k = 1.
    value_at_zero, value_at_zero_error
        Of value_at_zero + c k^a through the same shells, and its error, made likewise; nan with fewer than five shells.
    hyperuniformity_index, hyperuniformity_index_error
        That over the highest shell of all [1].
    k_min, k_max, shells
        The window [1/length] and the number of shells in it.

    """

    exponent: float
    exponent_error: float
    amplitude: float
    value_at_zero: float
    value_at_zero_error: float
    hyperuniformity_index: float
    hyperuniformity_index_error: float
    k_min: float
    k_max: float
    shells: int

    @property
    def hyperuniformity(self) -> str:
        """What the window says: hyperuniform, not hyperuniform, or ambiguous.

        Packings count as effectively hyperuniform when the index is at most 1e-3 (Torquato 2018, Physics Reports 745,
        section 2). The answer is ambiguous when that bound lies within two errors of the index.
        """
        index, error = self.hyperuniformity_index, 2.0 * self.hyperuniformity_index_error
        if abs(index) + error <= _HYPERUNIFORM:
            return "hyperuniform"
        return "not hyperuniform" if index - error > _HYPERUNIFORM else "ambiguous"


def _spectral_line(
    k: NDArray[np.float64], value: NDArray[np.float64], count: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return exponent and log(amplitude) of the likeliest power law of shells, and the error of the exponent."""
    # by scoring: a line through logarithms of means would have a bias where shells have few vectors
    x, root = np.log(k), np.sqrt(count)
    line = np.polyfit(x, np.log(value), 1, w=root)
    for _ in range(_SCORINGS):
        ratio = value / np.exp(np.polyval(line, x))
        line, covariance = np.polyfit(x, np.polyval(line, x) + ratio - 1.0, 1, w=root, cov="unscaled")
    scatter = float((count * (value / np.exp(np.polyval(line, x)) - 1.0) ** 2).sum()) / (len(x) - 2)
    return line, math.sqrt(scatter * covariance[0, 0])


def _spectral_limit(
    k: NDArray[np.float64], value: NDArray[np.float64], count: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the value at k = 0 of the likeliest value_at_zero + c k^a through shells, and its error by their scatter.

    Spectra that rise (a > 0, c > 0) and that fall (c < 0) are tried from several powers, and the likeliest is kept.
    """
    unit = float(np.median(value))
    q, seen = k / float(np.exp(np.log(k).mean())), value / unit

    def deviance(guess: NDArray[np.float64]) -> NDArray[np.float64]:
        # square roots of the deviance of gamma distributions, signed; what is not positive cannot be the mean
        ratio = seen / np.maximum(guess[0] + guess[1] * q ** guess[2], 1e-12)
        return np.asarray(np.sign(ratio - 1.0) * np.sqrt(2.0 * count * np.maximum(ratio - 1.0 - np.log(ratio), 0.0)))

    starts = [(seen.min() / 2.0, 1.0, power) for power in (0.5, 1.0, 2.0, 4.0)]
    starts += [(seen.max(), -0.1, power) for power in (1.0, 2.0)]
    fits = [
        least_squares(deviance, one, bounds=([-np.inf, -np.inf, 0.05], [np.inf, np.inf, 8.0]), xtol=1e-13, gtol=1e-13)
        for one in starts
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    spread = np.linalg.pinv(best.jac.T @ best.jac)[0, 0] * 2.0 * best.cost / max(len(k) - 3, 1)
    return unit * float(best.x[0]), unit * math.sqrt(spread)


@clear_errors
def shell_average(box: Box, index_kd: ArrayLike, value_k: ArrayLike, *, width: float | None = None) -> ShellAverage:
    """Return means over directions of values at wave vectors, in shells of equal width.

    Parameters
    ----------
    box
        The periodic box.
    index_kd
        (K, d) indices of the wave vectors; zero is left out.
    value_k
        (K,) real values there, such as those of `structure_factor`.
    width
        Of a shell [1/length]; None: 2 pi / V^(1/d), the distance of neighbors among the wave vectors.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(6, 6))
    >>> index = pm.wave_indices(crystal.box, 8.0)
    >>> found = pm.shell_average(crystal.box, index, pm.structure_factor(crystal, index), width=0.1)
    >>> float(found.k_b[found.value_b > 1.0][0].round(3)), round(4.0 * np.pi / 3.0**0.5, 3)
    (7.255, 7.255)

    """
    length = np.linalg.norm(wave_vectors(box, index_kd), axis=1)
    value = finite_array("value_k", value_k, shape=(len(length),), what="wave vector")
    step = 2.0 * np.pi / box.volume ** (1.0 / box.dimension) if width is None else positive("width", width)
    kept = length > 0.0
    if not kept.any():
        raise ValueError("index_kd must hold a wave vector that is not zero, got none")
    # opposite wave vectors have one value
    index = integer_array("index_kd", index_kd, shape=(None, box.dimension), what="wave vector")[kept]
    both = len({tuple(one) for one in index.tolist()} & {tuple(one) for one in (-index).tolist()})
    return average_shells(length[kept], value[kept], step, 1.0 - 0.5 * both / len(index))


def average_shells(
    length_k: NDArray[np.float64], value_k: NDArray[np.float64], width: float, independent: float = 1.0
) -> ShellAverage:
    """Return means over shells of width `width` of values at wave numbers, of which a share is independent."""
    shell = (length_k * (1.0 + 1e-12) / width).astype(np.int64)
    _, place, count = np.unique(shell, return_inverse=True, return_counts=True)
    place = place.reshape(-1)
    mean = np.bincount(place, value_k) / count
    square = np.bincount(place, (value_k - mean[place]) ** 2)
    apart = count * independent
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(apart > 1.0, np.sqrt(square / count / (apart - 1.0)), np.nan)
    return ShellAverage(np.bincount(place, length_k) / count, mean, error, count)
