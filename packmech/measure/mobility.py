"""How far particles go with time: mean square displacements, and what scattering sees of single particles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j0

from packmech.calls.display import shown
from packmech.calls.status import shown_as
from packmech.check import boolean, brief, entries, finite_array, integer, positive
from packmech.measure.displacements import displacements
from packmech.measure.signals import mean_with_error
from packmech.packing import Packing

# lags where none are asked for: about so many, nearly evenly spaced in their logarithm, up to half of the frames
_LAGS = 30
# frames of runs are taken at whole steps: their distances in time may differ by this part [1]
_EVEN = 0.1


class Frames(NamedTuple):
    """(T,) times, (T, N, d) places in lattice vectors, never wrapped, and (T, d, d) lattice vectors."""

    time_t: NDArray[np.float64]
    fraction_tnd: NDArray[np.float64]
    lattice_tdd: NDArray[np.float64]


def _of_arrays(time_t: Any, position_tnd: Any, lattice_tdd: Any) -> Frames:
    lattice = np.asarray(lattice_tdd)
    return Frames(np.asarray(time_t), np.einsum("tij,tnj->tni", np.linalg.inv(lattice), position_tnd), lattice)


def frames_of(frames: Any, time_t: ArrayLike | None) -> Frames:
    """Return the frames of a run that kept positions, or of packings that follow each other.

    The end of a run that falls between two frames is left out.

    Raises
    ------
    TypeError, ValueError
        If there are fewer than two, they are of different particles, or their times are not evenly spaced.

    """
    trace = getattr(frames, "trace", None)
    if isinstance(frames, Sequence) and all(isinstance(one, Packing) for one in frames) and len(frames) > 1:
        sizes = {(one.particles, one.dimension) for one in frames}
        if len(sizes) > 1:
            raise ValueError(
                f"frames must be of the same particles, got packings of {sorted(sizes)} particles and axes"
            )
        steps = [displacements(before, after) for before, after in zip(frames, frames[1:], strict=False)]
        inverse = [one.box.inverse_dd for one in frames[1:]]
        moved = [step.nonaffine_nd @ one.T for step, one in zip(steps, inverse, strict=True)]
        start = frames[0].position_nd @ frames[0].box.inverse_dd.T
        fraction = np.cumsum(np.array([start, *moved]), axis=0)
        count = len(frames)
        time = np.arange(count) if time_t is None else finite_array("time_t", time_t, shape=(count,), what="frame")
        found = Frames(np.asarray(time, dtype=float), fraction, np.array([one.box.lattice_dd for one in frames]))
    elif time_t is not None:
        raise TypeError(f"time_t must be left out where frames are a run's, got {brief(time_t)}")
    elif getattr(trace, "position_tnd", None) is not None and getattr(trace, "lattice_tdd", None) is not None:
        found = _of_arrays(trace.time_t, trace.position_tnd, trace.lattice_tdd)  # type: ignore[union-attr]
    elif getattr(frames, "position_fnd", None) is not None:
        found = _of_arrays(frames.frame_time_f, frames.position_fnd, frames.lattice_fdd)
    else:
        raise TypeError(
            "frames must be a run that kept positions (trace_every, trace_positions=True) or two packings at least, "
            f"got {brief(frames)}"
        )
    apart = np.diff(found.time_t)
    # a run keeps its end, too, wherever it falls
    if time_t is None and len(apart) > 1 and apart[-1] < (1.0 - _EVEN) * apart[0]:
        found, apart = Frames(*(part[:-1] for part in found)), apart[:-1]
    if len(apart) == 0 or not (apart > 0.0).all() or np.ptp(apart) > _EVEN * apart.mean():
        what = "frames" if time_t is None else "time_t"
        raise ValueError(f"{what} must be evenly spaced in time, growing, two at least, got {brief(found.time_t)}")
    return found


def _lags(lags: ArrayLike | None, frames: int) -> NDArray[np.int64]:
    """Return the numbers of frames between those that are compared, checked."""
    if lags is None:
        longest = max(frames // 2, 1)
        return np.unique(np.rint(np.geomspace(1.0, longest, _LAGS)).astype(np.int64))
    given = np.atleast_1d(entries("lags", lags, "iu", "numbers of frames"))
    if given.ndim > 1 or not len(given):
        raise ValueError(f"lags must be numbers of frames, one at least, got {brief(lags)}")
    return np.array([integer("lags", one, at_least=1, at_most=frames - 1) for one in given.tolist()], dtype=np.int64)


def _chosen(particles: ArrayLike | None, count: int) -> NDArray[np.int64]:
    """Return the numbers of the particles that are meant, from a mask or numbers."""
    numbers = np.arange(count)
    if particles is None:
        return numbers
    given = entries("particles", particles, "iub", "numbers or truth values")
    mask = given.dtype == bool and given.shape == (count,)
    inside = given.ndim == 1 and given.dtype.kind in "iu" and len(given) and 0 <= given.min() <= given.max() < count
    if not (mask and given.any()) and not inside:
        raise ValueError(
            f"particles must be numbers below {count} or a mask of {count}, of one at least, got {brief(particles)}"
        )
    return np.asarray(numbers[given])


class _Lags(NamedTuple):
    """Frames, the particles that are meant, the numbers of frames between those compared, and whether drift goes."""

    frames: Frames
    chosen_n: NDArray[np.int64]
    number_l: NDArray[np.int64]
    remove_drift: bool

    @property
    def time_l(self) -> NDArray[np.float64]:
        """The (L,) mean times between the frames that are compared."""
        time = self.frames.time_t
        return np.array([float((time[lag:] - time[:-lag]).mean()) for lag in self.number_l])

    def moved(self) -> Iterator[NDArray[np.float64]]:
        """Yield for each lag the (T', N', d) displacements beyond the strain of the box, in the box at their ends."""
        _, fraction, lattice = self.frames
        for lag in self.number_l:
            step = fraction[lag:] - fraction[:-lag]
            if self.remove_drift:
                step = step - step.mean(axis=1, keepdims=True)
            yield np.asarray(np.einsum("tij,tnj->tni", lattice[lag:], step[:, self.chosen_n]))


def _lags_of(frames: Any, time_t: Any, lags: Any, particles: Any, remove_drift: bool) -> _Lags:
    """Return what is compared, checked."""
    boolean("remove_drift", remove_drift)
    known = frames_of(frames, time_t)
    count, particles_in_all, _ = known.fraction_tnd.shape
    return _Lags(known, _chosen(particles, particles_in_all), _lags(lags, count), remove_drift)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class MeanSquareDisplacement:
    """Mean square displacements over lags of time, beyond the strain of the box.

    Attributes
    ----------
    time_l
        (L,) lags [time]; numbers of frames, where packings came without times.
    msd_l, error_l
        (L,) mean square displacements over particles and starts, and their standard errors over particles [length^2].
    non_gaussian_l
        (L,) d <u^4> / ((d + 2) <u^2>^2) - 1: zero where displacements are Gaussian [1].
    starts_l
        (L,) numbers of starts that each lag is averaged over; they overlap.
    dimension
        d.

    """

    time_l: NDArray[np.float64]
    msd_l: NDArray[np.float64]
    error_l: NDArray[np.float64]
    non_gaussian_l: NDArray[np.float64]
    starts_l: NDArray[np.int64]
    dimension: int

    @property
    def diffusion_l(self) -> NDArray[np.float64]:
        """The (L,) mean square displacements over 2 d times the lag [length^2/time]."""
        return np.asarray(self.msd_l / (2.0 * self.dimension * self.time_l))

    def __repr__(self) -> str:
        return (
            f"MeanSquareDisplacement over {len(self.time_l)} lags from {self.time_l[0]:.4g} to {self.time_l[-1]:.4g}: "
            f"{self.msd_l[0]:.4g} to {self.msd_l[-1]:.4g}"
        )


@shown_as("mean square displacement")
def mean_square_displacement(
    frames: Any,
    *,
    time_t: ArrayLike | None = None,
    lags: ArrayLike | None = None,
    particles: ArrayLike | None = None,
    remove_drift: bool = False,
) -> MeanSquareDisplacement:
    """Return mean square displacements against time, over all starts, beyond the strain of the box.

    Parameters
    ----------
    frames
        A run that kept positions at even times (`simulate` with trace_every and trace_positions), or packings that
        follow each other; between two of these no particle may have moved half of the box beyond its strain.
    time_t
        (T,) times of packings [time]; None counts frames.
    lags
        Numbers of frames between those that are compared. None: about thirty, up to half of the frames.
    particles
        Numbers of the particles to average over, or a mask; None: all.
    remove_drift
        Whether the mean displacement of all particles is taken out first.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or frames are not evenly spaced.

    Examples
    --------
    >>> import packmech as pm
    >>> box = pm.Box.cubic(4.0, 2)
    >>> path = [pm.Packing([[0.3 * t, 1.0]], [0.5], box) for t in range(40)]
    >>> found = mean_square_displacement(path, lags=[1, 10, 30])
    >>> found.msd_l.round(12).tolist(), found.starts_l.tolist()
    ([0.09, 9.0, 81.0], [39, 30, 10])

    """
    compared = _lags_of(frames, time_t, lags, particles, remove_drift)
    count, _, d = compared.frames.fraction_tnd.shape
    rows = []
    for moved in compared.moved():
        square = (moved**2).sum(axis=2)
        mean, error = mean_with_error(square.mean(axis=0))
        broad = d * float((square**2).mean()) / ((d + 2.0) * mean**2) - 1.0 if mean > 0.0 else math.nan
        rows.append((mean, error, broad))
    msd, error_l, broad_l = np.array(rows).T
    return MeanSquareDisplacement(compared.time_l, msd, error_l, broad_l, count - compared.number_l, d)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class SelfScattering:
    """Self-intermediate scattering function over lags of time.

    Attributes
    ----------
    time_l
        (L,) lags [time]; numbers of frames, where packings came without times.
    f_l, error_l
        (L,) means over particles and starts, and their standard errors over particles [1].
    wave_number
        k [1/length].

    """

    time_l: NDArray[np.float64]
    f_l: NDArray[np.float64]
    error_l: NDArray[np.float64]
    wave_number: float

    @property
    def relaxation_time(self) -> float:
        """The lag at which it falls to 1/e, by straight lines against the logarithm of time; inf if it does not."""
        below = np.flatnonzero(self.f_l <= math.exp(-1.0))
        if not len(below):
            return math.inf
        k = int(below[0])
        if k == 0:
            return float(self.time_l[0])
        part = (self.f_l[k - 1] - math.exp(-1.0)) / (self.f_l[k - 1] - self.f_l[k])
        return float(self.time_l[k - 1] * (self.time_l[k] / self.time_l[k - 1]) ** part)

    def __repr__(self) -> str:
        return (
            f"SelfScattering at k = {self.wave_number:.4g} over {len(self.time_l)} lags: {self.f_l[0]:.4g} to "
            f"{self.f_l[-1]:.4g}, relaxation time {self.relaxation_time:.4g}"
        )


@shown_as("self-intermediate scattering")
def self_scattering(
    frames: Any,
    wave_number: float,
    *,
    time_t: ArrayLike | None = None,
    lags: ArrayLike | None = None,
    particles: ArrayLike | None = None,
    remove_drift: bool = False,
) -> SelfScattering:
    """Return the self-intermediate scattering function F_s(k, t), the mean of cos(k . u), beyond the strain of the box.

    It is averaged over all directions of k: J0(k u) in a plane, sin(k u) / (k u) in space.

    Parameters
    ----------
    frames, time_t, lags, particles, remove_drift
        As in `mean_square_displacement`.
    wave_number
        k [1/length], such as that of the first peak of the structure factor.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or frames are not evenly spaced.

    Examples
    --------
    >>> import packmech as pm
    >>> box = pm.Box.cubic(4.0, 3)
    >>> path = [pm.Packing([[0.25 * t, 1.0, 1.0]], [0.5], box) for t in range(9)]
    >>> self_scattering(path, wave_number=np.pi, lags=[1, 2, 4]).f_l.round(6).tolist()
    [0.900316, 0.63662, 0.0]

    """
    k = positive("wave_number", wave_number)
    compared = _lags_of(frames, time_t, lags, particles, remove_drift)
    rows = []
    for moved in compared.moved():
        phase = k * np.sqrt((moved**2).sum(axis=2))
        wave = j0(phase) if moved.shape[2] == 2 else np.sinc(phase / np.pi)
        rows.append(mean_with_error(wave.mean(axis=0)))
    f, error_l = np.array(rows).T
    return SelfScattering(compared.time_l, f, error_l, k)
