"""How a box is deformed while particles are stepped through time: steady, or as a sine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import integer, one_of, positive, real
from packmech.dynamics.march.flow import Ramp, Sine

MODES = ("shear", "uniaxial", "isotropic")


def _direction(mode: str, axes: tuple[int, int], dimension: int) -> NDArray[np.float64]:
    a, b = axes
    if max(a, b) >= dimension:
        raise ValueError(f"strain.axes must be axes of {dimension} dimensions, got {axes}")
    matrix = np.zeros((dimension, dimension))
    if mode == "shear":
        matrix[a, b] = 1.0
    elif mode == "uniaxial":
        matrix[a, a] = 1.0
    else:
        matrix[:] = np.eye(dimension)
    return matrix


def _check(mode: str, axes: tuple[int, int]) -> None:
    one_of("strain.mode", mode, MODES)
    if not isinstance(axes, tuple) or len(axes) != 2:
        raise TypeError(f"strain.axes must be two axes, got {axes!r}")
    for axis in axes:
        integer("strain.axes", axis, at_least=0, at_most=2)
    if mode == "shear" and axes[0] == axes[1]:
        raise ValueError(f"strain.axes must be two different axes, got {axes}")


@dataclass(frozen=True)
class SteadyStrain:
    """The box deforms at a constant rate: F(t) = 1 + gamma(t) M with gamma = start + rate t.

    Parameters
    ----------
    rate
        Of gamma [1/time].
    start
        gamma at time zero [1].
    duration
        Time after which it stops; None: never.
    mode
        "shear": M has a one at `axes` (displacements along the first, gradient along the second), Lees and Edwards's
        sliding images in any box. "uniaxial": along the first of the axes. "isotropic": all of them; negative rates
        compress.
    axes
        Two axes.

    """

    rate: float
    start: float = 0.0
    duration: float | None = None
    mode: str = "shear"
    axes: tuple[int, int] = (0, 1)

    def __post_init__(self) -> None:
        real("strain.rate", self.rate)
        real("strain.start", self.start)
        if self.duration is not None:
            positive("strain.duration", self.duration)
        _check(self.mode, self.axes)

    def profile(self) -> Any:
        """Return gamma(t) as the loops take it."""
        end = math.inf if self.duration is None else float(self.duration)
        return Ramp(float(self.start), float(self.rate), 0.0, end)

    def direction(self, dimension: int) -> NDArray[np.float64]:
        """Return M."""
        return _direction(self.mode, self.axes, dimension)


@dataclass(frozen=True)
class OscillatoryStrain:
    """gamma(t) = amplitude sin(2 pi frequency (t - start)), for a number of periods; 0 before, as it ended after.

    Parameters
    ----------
    amplitude
        Of gamma [1].
    frequency
        Periods in a unit of time [1/time].
    start
        Time at which it starts.
    periods
        How many; None: for ever.
    mode, axes
        As in `SteadyStrain`.

    """

    amplitude: float
    frequency: float
    start: float = 0.0
    periods: float | None = None
    mode: str = "shear"
    axes: tuple[int, int] = (0, 1)

    def __post_init__(self) -> None:
        positive("strain.amplitude", self.amplitude)
        positive("strain.frequency", self.frequency)
        real("strain.start", self.start, at_least=0.0)
        if self.periods is not None:
            positive("strain.periods", self.periods)
        _check(self.mode, self.axes)

    def profile(self) -> Any:
        """Return gamma(t) as the loops take it."""
        end = math.inf if self.periods is None else self.start + self.periods / self.frequency
        return Sine(float(self.amplitude), 2.0 * math.pi * self.frequency, float(self.start), float(end))

    def direction(self, dimension: int) -> NDArray[np.float64]:
        """Return M."""
        return _direction(self.mode, self.axes, dimension)


Strain = SteadyStrain | OscillatoryStrain
