"""G' and G'' from a shear stress over time: as the reference package does it, and as it should be done."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check

# how a drift of the stress is treated
DRIFTS = ("package", "none", "removed", "least_squares")


class Moduli(NamedTuple):
    """In-phase and out-of-phase stress [Pa] and the storage and loss moduli G' and G'' [Pa]."""

    in_phase: float
    out_of_phase: float
    storage: float
    loss: float


class Periods(NamedTuple):
    """An oscillatory protocol: frequency [Hz], strain amplitude [1], and periods before, under and after shear [1]."""

    frequency: float
    amplitude: float
    pre_periods: float
    periods: float
    post_periods: float


def demodulate(time_t: ArrayLike, stress_t: ArrayLike, protocol: Periods, *, drift: str = "package") -> Moduli:
    """Return G' and G'' of a shear stress under the strain A sin(2 pi (t f - pre)).

    The first period of shear is left out where there are at least two.

    Parameters
    ----------
    time_t, stress_t
        (T,) times [s] and shear stresses [Pa].
    protocol
        What was applied.
    drift
        "package": the line through the mean stresses before and after the shear is *added* to the stress, as the
        package does (its slope has the wrong sign), which doubles a drift. "removed": the line is subtracted, as was
        meant. "none": the stress as it is. For these three G' = sum(stress sin) / (A sum(sin^2)), with sin and cos
        taken one by one. "least_squares": sine, cosine, their third harmonics, an offset and a slope fitted together.

    Raises
    ------
    ValueError
        If no time falls inside the shear that counts.

    Examples
    --------
    >>> protocol = Periods(frequency=1.0, amplitude=0.2, pre_periods=1.0, periods=3.0, post_periods=1.0)
    >>> time_t = np.arange(5000) / 1000.0
    >>> sheared = (time_t >= 1.0) & (time_t <= 4.0)
    >>> stress_t = 20.0 * np.sin(2 * np.pi * time_t) * sheared + 10.0 * time_t  # G' = 100 Pa, 10 Pa/period of drift
    >>> for drift in DRIFTS:
    ...     print(drift, round(demodulate(time_t, stress_t, protocol, drift=drift).storage, 1))
    package 68.2
    none 84.1
    removed 100.0
    least_squares 100.0

    """
    treatment = check.one_of("drift", drift, DRIFTS)
    time = check.finite_array("time_t", time_t, shape=(None,), what="time")
    stress = check.finite_array("stress_t", stress_t, shape=(len(time),), what="time")
    check.instance("protocol", protocol, Periods)
    frequency = check.positive("frequency", protocol.frequency)
    amplitude = check.positive("amplitude", protocol.amplitude)
    pre = check.real("pre_periods", protocol.pre_periods, at_least=0.0)
    periods = check.positive("periods", protocol.periods)
    check.real("post_periods", protocol.post_periods, at_least=0.0)
    skipped = 1.0 if periods >= 2.0 else 0.0
    window = (time >= (pre + skipped) / frequency) & (time <= (pre + periods) / frequency)
    if not window.any():
        raise ValueError(f"time_t must reach into the shear that counts, got {time[0]:g} to {time[-1]:g} s")
    if treatment in ("package", "removed"):
        sign = 1.0 if treatment == "package" else -1.0
        stress = stress + sign * _drift_slope(time, stress, protocol) * (time - pre / frequency)
    phase = 2.0 * np.pi * (time[window] * frequency - pre)
    if treatment == "least_squares":
        in_phase, out_of_phase = _fit(phase, stress[window])
    else:
        in_phase, out_of_phase = (
            float((stress[window] * wave).sum() / (wave**2).sum()) for wave in (np.sin(phase), np.cos(phase))
        )
    return Moduli(in_phase, out_of_phase, in_phase / amplitude, out_of_phase / amplitude)


def _drift_slope(time: NDArray[np.float64], stress: NDArray[np.float64], protocol: Periods) -> float:
    """Return the slope between the rests before and after the shear [Pa/s]; their first and last samples if none."""
    f, pre, end = protocol.frequency, protocol.pre_periods, protocol.pre_periods + protocol.periods
    before = (time >= 2.0 / 3.0 * pre / f) & (time < pre / f) if pre > 0.0 else np.arange(len(time)) == 0
    after = np.arange(len(time)) == len(time) - 1
    if protocol.post_periods > 0.0:
        after = (time > end / f) & (time <= (end + protocol.post_periods / 3.0) / f)
    if not before.any() or not after.any():
        raise ValueError("time_t must hold the rests before and after the shear that the drift is taken from")
    return float((stress[after].mean() - stress[before].mean()) / (time[after].mean() - time[before].mean()))


def _fit(phase: NDArray[np.float64], stress: NDArray[np.float64]) -> tuple[float, float]:
    waves = [np.sin(phase), np.cos(phase), np.sin(3.0 * phase), np.cos(3.0 * phase), np.ones_like(phase), phase]
    found = np.linalg.lstsq(np.stack(waves, axis=1), stress, rcond=None)[0]
    return float(found[0]), float(found[1])
