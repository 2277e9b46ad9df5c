"""The density of vibrational states, counted by inertia or from all modes; of endless copies, over a grid of waves."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.box import Copies
from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import KINDS, Kind, bin_edges, brief, check_memory, instance, integer_array, one_of
from packmech.jit.blas import single_thread
from packmech.mechanics.linked_systems import FreeOperator, Operator
from packmech.mechanics.modes import Modes
from packmech.mechanics.vibrations import ZERO, vibrations_of
from packmech.mechanics.waves import DENSE_ROWS, WaveCell, real_form
from packmech.scene import Scene

# densities at the end of a plateau are averaged over this ratio of frequencies to both sides
_WINDOW = 1.25
# of eigenvalues of a full matrix, for each of its rows [bound on the largest one]
_DENSE_ERROR = 2e-16


@shown()
@dataclass(frozen=True, eq=False)
class StateDensity:
    """Density of vibrational states over angular frequency.

    Attributes
    ----------
    edge_b
        (B + 1,) edges of the bins [1/time].
    count_b
        (B,) number of modes in each bin, uniform translations left out.
    modes
        Number of modes that the packing has besides translations that cost nothing.
    seconds
        CPU time.
    uncertain
        Number of edges at which rounding may have changed the count, as in `ModeCounts`; 0 where all are exact.

    """

    edge_b: NDArray[np.float64]
    count_b: NDArray[np.int64]
    modes: int
    seconds: float
    uncertain: int = 0

    @property
    def density_b(self) -> NDArray[np.float64]:
        """The (B,) density [time]: its integral over all frequencies is 1; zeros where there is no mode."""
        return self.count_b / (np.diff(self.edge_b) * max(self.modes, 1))

    @property
    def center_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [1/time]."""
        return (self.edge_b[1:] + self.edge_b[:-1]) / 2.0

    @property
    def plateau(self) -> float:
        """Height of the plateau [time]: the mean density between the lowest tenth and the lowest three tenths of modes.

        Harmonic packings near jamming, taken without their stress (kind="unstressed"), have one; nan without modes.
        """
        low, high = self._quantile(0.1), self._quantile(0.3)
        return 0.2 / (high - low) if self.modes else float("nan")

    @property
    def plateau_edge(self) -> float:
        """Angular frequency omega* at which the plateau ends [1/time]; nan where it reaches down to the lowest bin.

        Followed down from the lowest tenth of the modes, the density falls to half of the plateau here. Densities are
        those over a quarter of the frequency to both sides, so that few packings give a smooth curve; bins finer than
        that, and many modes, of several packings if need be, give a sharp answer.
        """
        center = np.sqrt(np.maximum(self.edge_b[1:] * self.edge_b[:-1], 0.0))
        center = center[(center > 0.0) & (center <= self._quantile(0.1))]
        below = np.concatenate([[0], np.cumsum(self.count_b)])
        number = np.interp(center * _WINDOW, self.edge_b, below) - np.interp(center / _WINDOW, self.edge_b, below)
        share = number / (center * (_WINDOW - 1.0 / _WINDOW) * self.modes * self.plateau)
        low = np.nonzero(share < 0.5)[0]
        if not len(low) or low[-1] + 1 == len(center):
            return float("nan")
        k = low[-1]
        part = (0.5 - share[k]) / (share[k + 1] - share[k])
        return float(center[k] ** (1.0 - part) * center[k + 1] ** part)

    def _quantile(self, part: float) -> float:
        """Return the frequency below which this part of the modes lies."""
        below = np.concatenate([[0], np.cumsum(self.count_b)])
        return float(np.interp(part * self.modes, below, self.edge_b))

    @classmethod
    def merged(cls, parts: Sequence[StateDensity]) -> StateDensity:
        """Return the states of several packings in one; their bins must be the same."""
        if not parts or any(not np.array_equal(one.edge_b, parts[0].edge_b) for one in parts):
            raise ValueError("parts must be densities over the same bins, and at least one")
        return cls(
            parts[0].edge_b,
            np.sum([one.count_b for one in parts], axis=0),
            sum(one.modes for one in parts),
            sum(one.seconds for one in parts),
            sum(one.uncertain for one in parts),
        )


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.frictional_modes",
)
@shown_as("density of states")
def density_of_states(
    source: Modes | Scene,
    bins: int | ArrayLike = 50,
    *,
    repeats: Sequence[int] | None = None,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> StateDensity:
    """Return the density of vibrational states D(omega) = (N(omega + d omega) - N(omega)) / d omega, normalized to 1.

    N counts the modes up to a frequency, uniform translations left out, so that the normalization is d N' - d modes.
    For a scene N is counted by the inertia of the shifted Hessian, one sparse factorization for each bin edge and no
    mode computed: exact for any number of particles. Frequencies of unstable modes are minus their growth rates.

    Parameters
    ----------
    source
        All modes of a packing (`normal_modes(scene)`), or a scene, taken in its fixed box.
    bins
        Number of bins between zero (or the lowest unstable frequency) and the highest, or their edges [1/time].
    repeats
        Number of copies of a scene's box along each lattice vector: the states are those of all copies together,
        counted as waves in one box at the grid of wave vectors (i / n1, j / n2), in fractions of the reciprocal
        lattice. None: the box as it is.
    kind, rattlers, gap_tolerance
        As in `normal_modes`; used for a scene.

    Raises
    ------
    TypeError, ValueError
        If the source is neither, the modes are only some of the packing's, the edges do not increase, or copies are
        asked for of modes, or of what has none (links, walls, held particles).

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(6, 6)), (pm.Repulsion(),))
    >>> states = pm.density_of_states(scene, 10)
    >>> int(states.count_b.sum()), round(float((states.density_b * np.diff(states.edge_b)).sum()), 12)
    (70, 1.0)
    >>> cell = scene.replace(packing=pm.lattice_packing("triangular", repeats=(1, 1)))
    >>> same = pm.density_of_states(cell, states.edge_b, repeats=(6, 6))
    >>> bool((same.count_b == states.count_b).all())
    True

    """
    start = time.process_time()
    if isinstance(source, Modes):
        if repeats is not None:
            raise ValueError(f"repeats must be left out for modes, which are of one box, got {brief(repeats)}")
        if not source.complete:
            raise ValueError(
                f"source must hold all modes, got {len(source)} of {source.available}; "
                "call normal_modes without a count, or pass the scene"
            )
        frequency = source.frequency_m
        top = max(float(frequency.max(initial=0.0)), 0.0)
        edge = _edges(bins, min(float(frequency.min(initial=0.0)), 0.0), top)
        count = np.histogram(frequency, edge)[0]
        return StateDensity(edge, count.astype(np.int64), source.available, time.process_time() - start)
    instance("source", source, Scene)
    one_of("kind", kind, KINDS)
    if repeats is not None:
        return _of_copies(source, bins, repeats, WaveCell(source, kind, rattlers, gap_tolerance), start)
    with single_thread():
        vibrations = vibrations_of(source, kind, rattlers=rattlers, gap_tolerance=gap_tolerance)
        if not len(vibrations.index_n):
            return _nothing(bins, start)
        low, high = _ends(vibrations.operator)
        edge = _edges(bins, low, high)
        found = [vibrations.count(level) for level in _levels(edge, high)]
    below, uncertain = np.array([one.number for one in found]), sum(not one.certain for one in found)
    seconds = time.process_time() - start
    return StateDensity(edge, np.diff(below).astype(np.int64), vibrations.available, seconds, uncertain)


def _nothing(bins: int | ArrayLike, start: float) -> StateDensity:
    """Return the density of what cannot vibrate."""
    edge = _edges(bins, 0.0, 1.0)
    return StateDensity(edge, np.zeros(len(edge) - 1, np.int64), 0, time.process_time() - start)


def _levels(edge_b: NDArray[np.float64], high: float) -> list[float]:
    """Return the eigenvalues at which modes below frequencies are counted."""
    # zero modes have eigenvalues of either sign at rounding: an edge at zero counts all of them above it
    rounding = ZERO * high**2
    level = np.sign(edge_b) * edge_b**2
    level[np.abs(level) < rounding] = -rounding
    found: list[float] = level.tolist()
    return found


def _of_copies(
    scene: Scene, bins: int | ArrayLike, repeats: Sequence[int], cell: WaveCell, start: float
) -> StateDensity:
    """Return the density of states of copies of a box, from the waves in one."""
    d = scene.packing.dimension
    number = integer_array("repeats", repeats, shape=(d,), what="direction")
    if (number < 1).any():
        raise ValueError(f"repeats must be 1 or more along each direction, got {number.tolist()}")
    if not cell.branches:
        return _nothing(bins, start)
    # frequencies of half of the waves, and the grid itself
    check_memory("repeats", float(math.prod(number.tolist())) * (4.0 * cell.branches + 64.0))
    grid = Copies(tuple(number.tolist())).place_md
    # a wave and the one that runs back have the same frequencies: one of both stands for two
    place, mirror = np.arange(len(grid)), np.ravel_multi_index(tuple((-grid % number).T), tuple(number))
    chosen = place <= mirror
    times = np.where(place == mirror, 1, 2)[chosen]
    fraction = grid[chosen] / number
    with single_thread():
        spectra = [_WaveSpectrum(cell.matrix(one)) for one in fraction]
        ends = [one.ends for one in spectra]
        low = float(min(min(one for one, _ in ends), 0.0))
        high = float(max(one for _, one in ends))
        edge = _edges(bins, low, high)
        level = _levels(edge, high)
        found = [one.count(level) for one in spectra]
    below = sum(weight * one for weight, (one, _) in zip(times, found, strict=True))
    uncertain = int(np.count_nonzero(np.any([doubtful for _, doubtful in found], axis=0)))
    # uniform translations are zero modes of the matrix at k = 0, not vibrations
    below = below - np.where(np.array(level) > 0.0, d, 0)
    modes = cell.branches * int(number.prod()) - d
    return StateDensity(edge, np.diff(below).astype(np.int64), modes, time.process_time() - start, uncertain)


class _WaveSpectrum:
    """The squared frequencies of waves at one wave vector: all of a small matrix, counts of a large one."""

    def __init__(self, matrix: sp.csr_array) -> None:
        self.size = matrix.shape[0]
        self.largest = float(abs(matrix).sum(axis=1).max())
        self._value: NDArray[np.float64] | None = None
        if self.size <= DENSE_ROWS:
            self._value = np.linalg.eigvalsh(matrix.toarray())
        else:
            self._operator = FreeOperator(real_form(matrix))

    @property
    def ends(self) -> tuple[float, float]:
        """Frequencies just below the lowest and above the highest."""
        return _ends(self._operator) if self._value is None else _outside(self._value[0], self._value[-1])

    def count(self, level_b: list[float]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return how many eigenvalues lie below levels, and where rounding may have changed that."""
        if self._value is not None:
            level = np.array(level_b)
            place = np.searchsorted(self._value, level)
            near = np.abs(self._value[None] - level[:, None]).min(axis=1)
            return place.astype(np.int64), near < _DENSE_ERROR * self.size * self.largest
        found = [self._operator.count(level) for level in level_b]
        return (
            np.array([one.number // 2 for one in found], dtype=np.int64),
            np.array([not one.certain or bool(one.number % 2) for one in found]),
        )


def _edges(bins: int | ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    found = bin_edges("bins", bins)
    return np.linspace(low, high if high > low else low + 1.0, found + 1) if isinstance(found, int) else found


def _ends(operator: Operator) -> tuple[float, float]:
    """Return frequencies just below the lowest and above the highest mode, zero if none is unstable."""
    import scipy.sparse.linalg as spla

    rows = operator.size
    if rows < 40:
        value = np.linalg.eigvalsh(operator.apply(operator.project(np.eye(rows))))
        lowest, highest = float(value[0]), float(value[-1])
    else:
        begin = operator.project(np.random.default_rng(0).normal(size=rows))
        plain = spla.LinearOperator((rows, rows), matvec=lambda v: operator.apply(v.ravel()), dtype=np.float64)
        highest = float(spla.eigsh(plain, k=1, which="LA", v0=begin, return_eigenvectors=False)[0])
        lowest = 0.0
        if operator.below(-ZERO * highest):
            lowest = float(spla.eigsh(plain, k=1, which="SA", v0=begin, return_eigenvectors=False)[0])
    return _outside(lowest, highest)


def _outside(lowest: float, highest: float) -> tuple[float, float]:
    """Return frequencies just outside the lowest and the highest eigenvalue, zero for a lowest one that is stable."""
    floor = -ZERO * abs(highest)
    # a hair outside, so that the outermost modes fall inside the outermost bins
    low = -np.sqrt(-lowest) * (1.0 + 1e-9) if lowest < floor else 0.0
    return float(low), float(np.sqrt(max(highest, 0.0)) * (1.0 + 1e-9))
