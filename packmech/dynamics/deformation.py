# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""How a box deforms with time, F(t) = 1 + gamma(t) M. A box at rest has none (None), and no code or cost of it.

Velocities in the loops are peculiar ones, c = v - L x with L = dF/dt F^-1: the same in all images, and zero where a
particle follows the box. Newton's equations dv/dt = f / m + (d2F/dt2 F^-1) x become dx/dt = L x + c and
dc/dt = f / m - L c (SLLOD). Both flows without f are exact: x -> G x, c -> G^-1 c with G = F(end) F(start)^-1, since
all F commute.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.check import instance, one_of, positive, real, two_axes
from packmech.jit.compiled import compiled_form, device, inner_lean, lean
from packmech.minimize.passes import pair_list

# places in Flow.number: gamma now and at both anchors of pair lists
GAMMA, ANCHORED = 0, 1
# norm of M F^-1 at either anchor; whether M M = 0; whether M carries nothing but x along y
BENDING, NILPOTENT, ALONG_X = 3, 5, 6
NUMBERS = 7


class Still(NamedTuple):
    """A profile that does not move: gamma(t) = gamma."""

    gamma: float = 0.0


class Ramp(NamedTuple):
    """gamma from `low` at time `start` with a constant rate; at `end` it stops."""

    low: float
    rate: float
    start: float
    end: float


class Sine(NamedTuple):
    """gamma = amplitude sin(angular_frequency (t - start)) from `start` to `end`, held before and after.

    It starts at zero, so that nothing jumps but the rate.
    """

    amplitude: float
    angular_frequency: float
    start: float
    end: float


class Increments(NamedTuple):
    """The strain of a `Sine` at every multiple of dt, and equal parts of its increments between: a piecewise line.

    The rate at a multiple of dt is that of the increment before it, so that it lags by half a step.
    """

    amplitude: float
    angular_frequency: float
    start: float
    end: float
    dt: float


class Driven(NamedTuple):
    """A piece of a path that is given as it goes: number_k is low and high time, gamma there, and its rates there.

    A cubic between the two; a line where both rates are the mean one. Beyond the piece gamma rests at its end.
    """

    number_k: NDArray[np.float64]


class Course(NamedTuple):
    """A profile of any kind as compiled loops take it, so that they are compiled once for all: its kind and numbers.

    The numbers of a `Driven` one are its own.
    """

    kind: int
    number_k: NDArray[np.float64]


def course_of(profile: Any) -> Course:
    """Return a profile as compiled loops take it."""
    kind = _KINDS.index(type(profile))
    return Course(kind, profile.number_k if isinstance(profile, Driven) else np.array(profile, dtype=np.float64))


# what extends a path: the strain at the end of its next piece, the rate there, or the strain and the rate at its end
END_STRAIN, MEAN_RATE, END_STRAIN_AND_RATE = 0, 1, 2


@device
def extend_path(profile, control, begin, end, control_k):
    """Set the next piece of a `Driven` path from where the last one ended; return a bound on the rates in it.

    From time `begin` to `end`, by the numbers that the control takes.
    """
    number = profile.number_k
    number[0], number[1] = begin, end
    number[2] = number[3]
    span = end - begin
    if control == MEAN_RATE:
        number[3] = number[2] + control_k[0] * span
    else:
        number[3] = control_k[0]
    mean = (number[3] - number[2]) / span
    if control == END_STRAIN_AND_RATE:
        number[4], number[5] = number[5], control_k[1]
    else:
        number[4] = number[5] = mean
    return abs(mean) + abs(number[4] - mean) + abs(number[5] - mean)


@device
def end_path(profile, time, strain, rate):
    """Let a `Driven` path rest at a strain, at a rate that its next piece goes on from."""
    number = profile.number_k
    number[0] = number[1] = time
    number[2] = number[3] = strain
    number[4] = number[5] = rate


def gamma_at(profile: Any, time: float) -> tuple[float, float]:
    """Return gamma and its rate [1/time] at a time."""
    found: tuple[float, float] = _GAMMA[type(profile)](profile, time)
    return found


@device
def _still(profile, time):
    return profile.gamma, 0.0


@device
def _ramp(profile, time):
    if time < profile.start:
        return profile.low, 0.0
    if time >= profile.end:
        return profile.low + profile.rate * (profile.end - profile.start), 0.0
    return profile.low + profile.rate * (time - profile.start), profile.rate


@device
def _sine(profile, time):
    omega = profile.angular_frequency
    if time < profile.start:
        return 0.0, 0.0
    if time > profile.end:
        return profile.amplitude * math.sin(omega * (profile.end - profile.start)), 0.0
    phase = omega * (time - profile.start)
    return profile.amplitude * math.sin(phase), profile.amplitude * omega * math.cos(phase)


@device
def _increments(profile, time):
    omega, begin, dt = profile.angular_frequency, profile.start, profile.dt
    # times are whole or half numbers of steps but for rounding; a whole one ends its step
    after = math.ceil(time / dt - 0.25) * dt
    before = after - dt
    low = profile.amplitude * math.sin(omega * (min(max(before, begin), profile.end) - begin))
    high = profile.amplitude * math.sin(omega * (min(max(after, begin), profile.end) - begin))
    rate = (high - low) / dt
    return high - rate * (after - time), rate


@device
def _driven(profile, time):
    number = profile.number_k
    begin, end = number[0], number[1]
    if time >= end:
        return number[3], number[5]
    if time <= begin:
        return number[2], number[4]
    span = end - begin
    u = (time - begin) / span
    rise = number[3] - number[2]
    # Hermite's cubic as a line and what bends it: where both rates are the mean one only the line is left
    mean = rise / span
    bend_low, bend_high = number[4] - mean, number[5] - mean
    gamma = number[2] + rise * u + span * u * (1.0 - u) * ((1.0 - u) * bend_low - u * bend_high)
    rate = mean + (1.0 - u) * (1.0 - 3.0 * u) * bend_low - u * (2.0 - 3.0 * u) * bend_high
    return gamma, rate


_GAMMA = {Still: _still, Ramp: _ramp, Sine: _sine, Increments: _increments, Driven: _driven}
_KINDS = tuple(_GAMMA)


@device
def _course(course, time):
    # in the order of the kinds
    n = course.number_k
    if course.kind == 4:
        return _driven(Driven(n), time)
    if course.kind == 3:
        return _increments(Increments(n[0], n[1], n[2], n[3], n[4]), time)
    if course.kind == 2:
        return _sine(Sine(n[0], n[1], n[2], n[3]), time)
    if course.kind == 1:
        return _ramp(Ramp(n[0], n[1], n[2], n[3]), time)
    return _still(Still(n[0]), time)


@compiled_form(gamma_at)
def _choose_gamma_at(course: Any, time: Any) -> Any:
    return _course


class Flow(NamedTuple):
    """A box that deforms: the course of its profile, M, F and lattice now, and the numbers named above.

    direction_dd is M; lattice_dd the lattice that the loops use, at gamma = 0; frame_dd and inverse_dd the arrays of
    the frame that follow it. step_dd and back_dd hold G and its inverse over half a step, rate_dd L.
    """

    course: Course
    direction_dd: NDArray[np.float64]
    lattice_dd: NDArray[np.float64]
    rate_dd: NDArray[np.float64]
    step_dd: NDArray[np.float64]
    back_dd: NDArray[np.float64]
    work_dd: NDArray[np.float64]
    number: NDArray[np.float64]


def with_scratch(flow: Flow) -> Flow:
    """Return the record with scratch matrices of its own."""
    return flow._replace(step_dd=np.eye(3), back_dd=np.eye(3), work_dd=np.eye(3))


@device
def _invert(a, out):
    """Write the inverse of a 3 x 3 matrix."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    w = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
    out[0, 0] = c00 * w
    out[1, 0] = c01 * w
    out[2, 0] = c02 * w
    out[0, 1] = (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]) * w
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]) * w
    out[2, 1] = (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]) * w
    out[0, 2] = (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]) * w
    out[1, 2] = (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]) * w
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) * w


@device
def _times(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@inner_lean
def map_between(flow, low, high, out):
    """Write F(high) F(low)^-1 = (1 + high M) (1 + low M)^-1."""
    direction, work = flow.direction_dd, flow.work_dd
    if flow.number[NILPOTENT] != 0.0:
        # M M = 0, as in simple shear
        for i in range(3):
            for j in range(3):
                out[i, j] = (1.0 if i == j else 0.0) + (high - low) * direction[i, j]
        return
    for i in range(3):
        for j in range(3):
            work[i, j] = (1.0 if i == j else 0.0) + low * direction[i, j]
    _invert(work, out)
    for i in range(3):
        for j in range(3):
            work[i, j] = (1.0 if i == j else 0.0) + high * direction[i, j]
    for j in range(3):
        x, y, z = out[0, j], out[1, j], out[2, j]
        for i in range(3):
            out[i, j] = work[i, 0] * x + work[i, 1] * y + work[i, 2] * z


@device
def entries(matrix):
    """Return the numbers of a 3 x 3 matrix as rows of a tuple."""
    return (
        (matrix[0, 0], matrix[0, 1], matrix[0, 2]),
        (matrix[1, 0], matrix[1, 1], matrix[1, 2]),
        (matrix[2, 0], matrix[2, 1], matrix[2, 2]),
    )


@inner_lean
def flow_to(flow, frame, time):
    """Set gamma, L, and the frame's lattice and inverse to those of a time."""
    gamma, rate = gamma_at(flow.course, time)
    flow.number[GAMMA] = gamma
    direction, work = flow.direction_dd, flow.work_dd
    for i in range(3):
        for j in range(3):
            work[i, j] = (1.0 if i == j else 0.0) + gamma * direction[i, j]
    _times(work, flow.lattice_dd, frame.lattice_dd)
    # L = rate M (1 + gamma M)^-1
    _bend(flow, gamma, flow.rate_dd)
    for i in range(3):
        for j in range(3):
            flow.rate_dd[i, j] *= rate
    _set_inverse(frame)


@lean
def set_flow(flow, frame, time):
    """Set gamma, L, and the frame's lattice and inverse to those of a time."""
    flow_to(flow, frame, time)


@device
def _bend(flow, gamma, out):
    """Write M (1 + gamma M)^-1."""
    direction = flow.direction_dd
    if flow.number[NILPOTENT] != 0.0:
        for i in range(3):
            for j in range(3):
                out[i, j] = direction[i, j]
        return
    map_between(flow, gamma, 0.0, flow.step_dd)
    _times(direction, flow.step_dd, out)


@inner_lean
def bending(flow, gamma):
    """Return a bound on the spectral norm of M (1 + gamma M)^-1: the square root of the sum of squares."""
    _bend(flow, gamma, flow.back_dd)
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += flow.back_dd[i, j] * flow.back_dd[i, j]
    return math.sqrt(square)


@pair_list.strained.form(Flow)
@device
def _strained(flow, since, largest):
    bent = flow.number[BENDING + since]
    return 0.5 * abs(flow.number[GAMMA] - flow.number[ANCHORED + since]) * bent * largest


@pair_list.displaced.form(Flow)
@device
def _displaced(flow, row, anchor_nd, since):
    map_between(flow, flow.number[ANCHORED + since], flow.number[GAMMA], flow.step_dd)
    g = entries(flow.step_dd)
    largest = 0.0
    for i in range(row.shape[0]):
        ax, ay, az = anchor_nd[i, 0], anchor_nd[i, 1], anchor_nd[i, 2]
        x = row[i, 0] - (g[0][0] * ax + g[0][1] * ay + g[0][2] * az)
        y = row[i, 1] - (g[1][0] * ax + g[1][1] * ay + g[1][2] * az)
        z = row[i, 2] - (g[2][0] * ax + g[2][1] * ay + g[2][2] * az)
        largest = max(largest, x * x + y * y + z * z)
    return math.sqrt(largest)


@pair_list.mark_strain.form(Flow)
@device
def _mark_strain(flow, since):
    flow.number[ANCHORED + since] = flow.number[GAMMA]
    flow.number[BENDING + since] = bending(flow, flow.number[GAMMA])


@device
def _set_inverse(frame):
    _invert(frame.lattice_dd, frame.inverse_dd)
    for k in range(3):
        total = 0.0
        for j in range(3):
            total += frame.inverse_dd[k, j] * frame.inverse_dd[k, j]
        frame.height_d[k] = 1.0 / math.sqrt(total)


def rates(flow: Any) -> Any:
    """Return L as a tuple of nine numbers, row by row; None where nothing deforms."""
    return None if flow is None else tuple(flow.rate_dd.ravel())


@compiled_form(rates)
def _choose_rates(flow: Any) -> Any:
    if isinstance(flow, types.NoneType):
        return lambda flow: None

    def nine(flow: Any) -> Any:
        a = flow.rate_dd
        return (a[0, 0], a[0, 1], a[0, 2], a[1, 0], a[1, 1], a[1, 2], a[2, 0], a[2, 1], a[2, 2])

    return nine


@device
def with_flow(rates, ux, uy, uz, dx, dy, dz):
    """Return the relative velocity of two places that are (dx, dy, dz) apart, from the peculiar one."""
    if rates is None:
        return ux, uy, uz
    return (
        ux + rates[0] * dx + rates[1] * dy + rates[2] * dz,
        uy + rates[3] * dx + rates[4] * dy + rates[5] * dz,
        uz + rates[6] * dx + rates[7] * dy + rates[8] * dz,
    )


@device
def relative(rates, axes, body, i, j, dx, dy, dz):
    """Return the velocity of row j relative to row i, the flow's included."""
    if len(axes) == 3:
        ux, uy, uz = body[j, 4] - body[i, 4], body[j, 5] - body[i, 5], body[j, 6] - body[i, 6]
        return with_flow(rates, ux, uy, uz, dx, dy, dz)
    if rates is None:
        return body[j, 4] - body[i, 4], body[j, 5] - body[i, 5], 0.0
    # a plane's flow does not pay for the third axis
    return (
        body[j, 4] - body[i, 4] + rates[0] * dx + rates[1] * dy,
        body[j, 5] - body[i, 5] + rates[3] * dx + rates[4] * dy,
        0.0,
    )


@device
def rates_at(flow, time):
    """Return L at a time as `rates` does."""
    gamma, rate = gamma_at(flow.course, time)
    a = flow.step_dd
    _bend(flow, gamma, a)
    return (
        rate * a[0, 0], rate * a[0, 1], rate * a[0, 2], rate * a[1, 0], rate * a[1, 1], rate * a[1, 2],
        rate * a[2, 0], rate * a[2, 1], rate * a[2, 2],
    )  # fmt: skip


@device
def maps_of_step(flow, time, dt):
    """Return what a step of the box does: to places, to peculiar velocities, and to displacements at half time."""
    start = gamma_at(flow.course, time)[0]
    middle = gamma_at(flow.course, time + 0.5 * dt)[0]
    end = gamma_at(flow.course, time + dt)[0]
    # all of these commute
    map_between(flow, start, end, flow.step_dd)
    places = entries(flow.step_dd)
    map_between(flow, end, start, flow.step_dd)
    speeds = entries(flow.step_dd)
    map_between(flow, middle, start, flow.step_dd)
    map_between(flow, middle, end, flow.back_dd)
    for i in range(3):
        x, y, z = flow.back_dd[i, 0], flow.back_dd[i, 1], flow.back_dd[i, 2]
        for j in range(3):
            flow.back_dd[i, j] = x * flow.step_dd[0, j] + y * flow.step_dd[1, j] + z * flow.step_dd[2, j]
    return places, speeds, entries(flow.back_dd)


@device
def turning(rates):
    """Return the spin of the flow: half its vorticity."""
    if rates is None:
        return 0.0, 0.0, 0.0
    return 0.5 * (rates[7] - rates[5]), 0.5 * (rates[2] - rates[6]), 0.5 * (rates[3] - rates[1])


MODES = ("shear", "uniaxial", "isotropic")


def strain_direction(mode: str, axes: tuple[int, int], dimension: int) -> NDArray[np.float64]:
    """Return M of a mode of strain: a shear along the first of the axes, its gradient along the second, and so on."""
    a, b = axes
    matrix = np.zeros((dimension, dimension))
    if mode == "shear":
        matrix[a, b] = 1.0
    elif mode == "uniaxial":
        matrix[a, a] = 1.0
    else:
        matrix[:] = np.eye(dimension)
    return matrix


def _check(mode: str, axes: tuple[int, int]) -> None:
    one_of("applied_strain.mode", mode, MODES)
    instance("applied_strain.axes", axes, tuple)
    two_axes("applied_strain.axes", axes, different=mode == "shear")


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
        real("applied_strain.rate", self.rate)
        real("applied_strain.start", self.start)
        if self.duration is not None:
            positive("applied_strain.duration", self.duration)
        _check(self.mode, self.axes)

    def profile(self) -> Any:
        """Return gamma(t) as the loops take it."""
        end = math.inf if self.duration is None else float(self.duration)
        return Ramp(float(self.start), float(self.rate), 0.0, end)

    def direction(self, dimension: int) -> NDArray[np.float64]:
        """Return M."""
        axes = two_axes("applied_strain.axes", self.axes, dimension=dimension, different=self.mode == "shear")
        return strain_direction(self.mode, axes, dimension)


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
        positive("applied_strain.amplitude", self.amplitude)
        positive("applied_strain.frequency", self.frequency)
        real("applied_strain.start", self.start, at_least=0.0)
        if self.periods is not None:
            positive("applied_strain.periods", self.periods)
        _check(self.mode, self.axes)

    def profile(self) -> Any:
        """Return gamma(t) as the loops take it."""
        end = math.inf if self.periods is None else self.start + self.periods / self.frequency
        return Sine(float(self.amplitude), 2.0 * math.pi * self.frequency, float(self.start), float(end))

    def direction(self, dimension: int) -> NDArray[np.float64]:
        """Return M."""
        axes = two_axes("applied_strain.axes", self.axes, dimension=dimension, different=self.mode == "shear")
        return strain_direction(self.mode, axes, dimension)


Strain = SteadyStrain | OscillatoryStrain
