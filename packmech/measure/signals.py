"""Signals and repeats: means with error bars, and the moduli of a stress that answers to a sine of strain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.check import clear_errors, finite_array, integer, one_of, positive, real

ERRORS = ("standard", "bootstrap")


@clear_errors
def mean_with_error(
    value_r: ArrayLike, *, error: str = "standard", draws: int = 2000, seed: int = 0
) -> tuple[float, float]:
    """Return the mean of independent values and the error of it; nan as the error of a single one.

    Parameters
    ----------
    value_r
        (R,) values, such as those of repeats.
    error
        "standard": standard deviation over the root of R. "bootstrap": standard deviation of the means of `draws`
        samples drawn with replacement, times sqrt(R / (R - 1)), without which it is too small for few values.
    draws, seed
        Of the bootstrap.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> mean_with_error([1.0, 2.0, 3.0])
    (2.0, 0.5773502691896258)

    """
    value = finite_array("value_r", value_r, shape=(None,), what="value")
    one_of("error", error, ERRORS)
    count = integer("draws", draws, at_least=2, bytes_each=16.0 * len(value))
    rng = np.random.default_rng(integer("seed", seed, at_least=0))
    mean = float(value.mean())
    if len(value) == 1:
        return mean, math.nan
    if error == "standard":
        return mean, float(value.std(ddof=1) / math.sqrt(len(value)))
    drawn = value[rng.integers(len(value), size=(count, len(value)))].mean(axis=1)
    return mean, float(drawn.std() * math.sqrt(len(value) / (len(value) - 1.0)))


def block_mean(value_t: NDArray[np.float64], blocks: int) -> tuple[float, float]:
    """Return the mean of a signal and its error from the means of equal blocks, as if these were independent.

    Parameters
    ----------
    value_t
        (T,) values, at least one for each block.
    blocks
        At least 2.

    """
    means = np.array([part.mean() for part in np.array_split(value_t, blocks)])
    return float(value_t.mean()), float(means.std(ddof=1) / math.sqrt(blocks))


def block_drift(value_t: NDArray[np.float64], blocks: int) -> tuple[float, float]:
    """Return the mean of the second half of a signal less that of the first, and its error by blocks.

    The error is that of the scatter of block means about a straight line, so that a drift is no part of it.

    Parameters
    ----------
    value_t
        (T,) values, at least one for each block.
    blocks
        Four are taken where there are fewer.

    Examples
    --------
    >>> change, error = block_drift(np.arange(80.0), 8)
    >>> change, error < 1e-12
    (40.0, True)

    """
    first, second = (float(part.mean()) for part in np.array_split(value_t, 2))
    means = np.array([part.mean() for part in np.array_split(value_t, max(blocks, 4))])
    place = np.arange(len(means)) - 0.5 * (len(means) - 1)
    slope = float(place @ means) / float(place @ place)
    left = means - means.mean() - slope * place
    scatter = math.sqrt(float(left @ left) / (len(means) - 2))
    return second - first, 2.0 * scatter / math.sqrt(len(means))


_TURN = 2.0 * math.pi
# columns of the fit: sine, cosine, third harmonics, offset, slope
_TERMS = 6
# fits whose columns are nearly dependent say nothing
_DEPENDENT = 1e-6


@shown()
@dataclass(frozen=True, eq=False)
class Demodulation:
    """Moduli of a stress a sin(phase) + b cos(phase) + third harmonics + offset + slope * phase, fitted together.

    Attributes
    ----------
    storage, loss
        G' = a / amplitude and G'' = b / amplitude [stress].
    storage_error, loss_error
        Their standard errors over periods, each period fitted for itself and taken for independent of the others
        [stress]; nan with less than two of them. Where particles keep rearranging periods are correlated, and the true
        error is some twice as large: take repeats.
    storage_fit_error, loss_fit_error
        Their standard errors from what the fit leaves over, as if that were white [stress].
    storage_p, loss_p
        (P,) moduli of each whole period [stress].
    third_in_phase, third_out_of_phase
        Amplitudes of sin(3 phase) and cos(3 phase) [stress].
    offset, slope
        Stress at phase zero without the waves, and its drift in a period [stress].
    amplitude
        Of the strain [1].
    residual
        Root mean square of what the fit leaves over [stress].
    samples
        How many samples counted.

    """

    storage: float
    loss: float
    storage_error: float
    loss_error: float
    storage_fit_error: float
    loss_fit_error: float
    storage_p: NDArray[np.float64]
    loss_p: NDArray[np.float64]
    third_in_phase: float
    third_out_of_phase: float
    offset: float
    slope: float
    amplitude: float
    residual: float
    samples: int

    @property
    def in_phase(self) -> float:
        """Amplitude of the stress in phase with the strain [stress]."""
        return self.storage * self.amplitude

    @property
    def out_of_phase(self) -> float:
        """Amplitude of the stress a quarter of a period ahead of the strain [stress]."""
        return self.loss * self.amplitude

    @property
    def stress(self) -> float:
        """Amplitude of both together [stress]."""
        return math.hypot(self.in_phase, self.out_of_phase)


@clear_errors
def demodulate(
    phase_t: ArrayLike,
    stress_t: ArrayLike,
    *,
    amplitude: float,
    skip_periods: float = 1.0,
    periods: float | None = None,
) -> Demodulation:
    """Return G' and G'' of a stress under the strain amplitude * sin(phase), by harmonic least squares.

    Sine, cosine, their third harmonics, an offset and a slope are fitted together, so that a drift of the stress takes
    nothing from the moduli.

    Parameters
    ----------
    phase_t
        (T,) phases of the strain, 2 pi frequency (time - start), rising.
    stress_t
        (T,) stresses, with the sign in which a spring resists: sigma_xy of the Cauchy stress for a shear of x along y.
    amplitude
        Of the strain [1].
    skip_periods
        How many of the first periods do not count [1].
    periods
        Where the last one ends [1]; None: at the last sample.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, or if too few samples count to separate waves, offset and slope.

    Examples
    --------
    >>> import numpy as np
    >>> phase = 2 * np.pi * np.arange(0.0, 4.001, 0.01)
    >>> found = demodulate(phase, 20 * np.sin(phase) + 4 * np.cos(phase) + 3 * phase, amplitude=0.2)
    >>> round(found.storage, 9), round(found.loss, 9), len(found.storage_p)
    (100.0, 20.0, 3)

    """
    phase = finite_array("phase_t", phase_t, shape=(None,), what="time")
    stress = finite_array("stress_t", stress_t, shape=(len(phase),), what="time")
    amplitude = positive("amplitude", amplitude)
    skip = real("skip_periods", skip_periods, at_least=0.0)
    if (np.diff(phase) <= 0.0).any():
        raise ValueError(f"phase_t must rise, got a step of {np.diff(phase).min():g}")
    last = phase[-1] / _TURN if periods is None else real("periods", periods, above=skip)
    # no later than the end of the last period that was begun
    last = min(last, math.floor(phase[-1] / _TURN) + 1.0)
    # a sample at either end must not be lost to rounding
    slack = min(1e-9 * max(1.0, abs(last)), 1e-3)
    window = (phase >= _TURN * (skip - slack)) & (phase <= _TURN * (last + slack))
    phase, stress = phase[window], stress[window]
    found, error, left = _fit(phase, stress)
    steady = stress - found[4] - found[5] * phase
    each = []
    for k in np.unique(np.floor(phase / _TURN)):
        if not math.ceil(skip - slack) <= k < math.floor(last + slack):
            continue
        inside = (phase >= _TURN * (k - slack)) & (phase <= _TURN * (k + 1 + slack))
        if np.count_nonzero(inside) > _TERMS:
            each.append(np.linalg.lstsq(_waves(phase[inside])[:, :5], steady[inside], rcond=None)[0][:2])
    by_period = np.array(each).reshape(-1, 2) / amplitude
    count = len(by_period)
    spread = by_period.std(axis=0, ddof=1) / math.sqrt(count) if count > 1 else np.full(2, np.nan)
    return Demodulation(
        storage=float(found[0] / amplitude),
        loss=float(found[1] / amplitude),
        storage_error=float(spread[0]),
        loss_error=float(spread[1]),
        storage_fit_error=float(error[0] / amplitude),
        loss_fit_error=float(error[1] / amplitude),
        storage_p=by_period[:, 0].copy(),
        loss_p=by_period[:, 1].copy(),
        third_in_phase=float(found[2]),
        third_out_of_phase=float(found[3]),
        offset=float(found[4]),
        slope=float(_TURN * found[5]),
        amplitude=amplitude,
        residual=float(np.sqrt((left**2).mean())),
        samples=len(phase),
    )


def _waves(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    waves = [np.sin(phase), np.cos(phase), np.sin(3.0 * phase), np.cos(3.0 * phase), np.ones_like(phase), phase]
    return np.stack(waves, axis=1)


def _fit(
    phase: NDArray[np.float64], stress: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return coefficients, their standard errors, and what is left over."""
    if len(phase) <= _TERMS:
        raise ValueError(f"phase_t must hold more than {_TERMS} samples that count, got {len(phase)}")
    # the slope is taken about the middle, so that it is independent of the offset
    middle = 0.5 * (phase[0] + phase[-1])
    matrix = _waves(phase)
    matrix[:, 5] -= middle
    scale = np.sqrt((matrix**2).sum(axis=0))
    found, _, rank, _ = np.linalg.lstsq(matrix / scale, stress, rcond=_DEPENDENT)
    if rank < _TERMS:
        raise ValueError(
            f"phase_t must separate waves, offset and slope, got {len(phase)} samples over "
            f"{(phase[-1] - phase[0]) / _TURN:.3g} periods"
        )
    left = stress - (matrix / scale) @ found
    variance = float(left @ left) / (len(phase) - _TERMS)
    inverse = np.linalg.inv((matrix / scale).T @ (matrix / scale))
    error = np.sqrt(variance * np.diag(inverse)) / scale
    found = found / scale
    found[4] -= middle * found[5]
    return found, error, left


def _sweep(
    amplitude_a: ArrayLike, storage_a: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    amplitude = finite_array("amplitude_a", amplitude_a, shape=(None,), what="amplitude")
    storage = finite_array("storage_a", storage_a, shape=(len(amplitude),), what="amplitude")
    order = np.argsort(amplitude, kind="stable")
    amplitude, storage = amplitude[order], storage[order]
    if amplitude[0] <= 0.0 or (np.diff(amplitude) <= 0.0).any():
        raise ValueError("amplitude_a must be positive and all different")
    return amplitude, storage, order


@clear_errors
def yield_strain(amplitude_a: ArrayLike, storage_a: ArrayLike, loss_a: ArrayLike) -> float:
    """Return the strain amplitude at which G' = G'' [1]: going down from the largest, the first where G' > G''.

    It is interpolated linearly between that amplitude and the one above it; nan where G' exceeds G'' at the largest
    amplitude already, or nowhere.

    Parameters
    ----------
    amplitude_a
        (A,) strain amplitudes, in any order.
    storage_a, loss_a
        (A,) moduli [stress].

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> round(yield_strain([0.01, 0.1, 0.2, 0.4], [100.0, 90.0, 40.0, 10.0], [10.0, 20.0, 30.0, 30.0]), 6)
    0.266667

    """
    amplitude, storage, order = _sweep(amplitude_a, storage_a)
    loss = finite_array("loss_a", loss_a, shape=(len(amplitude),), what="amplitude")[order]
    above = storage - loss
    solid = np.flatnonzero(above > 0.0)
    if not len(solid) or solid[-1] == len(amplitude) - 1:
        return math.nan
    k = int(solid[-1])
    return float(amplitude[k] + (amplitude[k + 1] - amplitude[k]) * above[k] / (above[k] - above[k + 1]))


@clear_errors
def softening_strain(amplitude_a: ArrayLike, storage_a: ArrayLike, *, remaining: float = 0.9) -> float:
    """Return the strain amplitude above which G' has fallen to a part of what it is at the smallest amplitude [1].

    Going up from the smallest, the first crossing, interpolated linearly; nan where there is none.

    Parameters
    ----------
    amplitude_a
        (A,) strain amplitudes, in any order; the smallest should lie in the linear range.
    storage_a
        (A,) storage moduli [stress].
    remaining
        The part that is left [1].

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> round(softening_strain([0.01, 0.1, 0.2, 0.4], [100.0, 95.0, 85.0, 10.0]), 6)
    0.15

    """
    amplitude, storage, _ = _sweep(amplitude_a, storage_a)
    part = real("remaining", remaining, above=0.0, below=1.0)
    above = storage - part * storage[0]
    soft = np.flatnonzero(above <= 0.0)
    if not len(soft) or storage[0] <= 0.0:
        return math.nan
    k = int(soft[0])
    return float(amplitude[k - 1] + (amplitude[k] - amplitude[k - 1]) * above[k - 1] / (above[k - 1] - above[k]))
