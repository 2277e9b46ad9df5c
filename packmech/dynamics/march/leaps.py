# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The first part of a time step of a march: rows are kicked and carried to its end, by the box and by themselves.

A simple shear along x, which most boxes that move are in, has a loop of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from packmech.compiled import device
from packmech.dynamics.march.flow import ALONG_X, entries, gamma_at, is_still, map_between
from packmech.dynamics.march.inlined import inlined, inlined_form


def leap(
    flow: Any, axes: Any, state: Any, low: int, high: int, time: float, dt: float, early: float, ahead: float
) -> float:
    """Kick rows, take them to the end of the step and clear their forces; return the largest squared displacement.

    `half` is left with the velocities and spins after the kick, the velocities of the rows are half + ahead (half -
    velocities). The box's own share of displacements is not counted.
    """
    raise NotImplementedError("a march is stepped in compiled loops")


@device
def _clear(axes, spins, push, i):
    for a in range(len(axes) + len(spins)):
        push[i, a] = 0.0


@device
def clear_rows(axes, state, low, high):
    """Set the forces on rows to zero."""
    for i in range(low, high):
        _clear(axes, state.spins, state.push, i)


def foreseen(state: Any, ahead: float, i: int, a: int, kick: float, kicked: float, before: float) -> float:
    """Return what a velocity, kicked by a force from what it was before, is taken for at the end of the step."""
    raise NotImplementedError("a march is stepped in compiled loops")


@inlined
def _foreseen_by_change(state, ahead, i, a, kick, kicked, before):
    force = state.push[i, a]
    change = force - state.last[i, a]
    state.last[i, a] = force
    return kicked + ahead * (kicked - before) + kick * state.lead * change


@inlined_form(foreseen)
def _choose_foreseen(state: Any, ahead: Any, i: Any, a: Any, kick: Any, kicked: Any, before: Any) -> Any:
    if isinstance(state[state.fields.index("last")], types.NoneType):
        return lambda state, ahead, i, a, kick, kicked, before: kicked + ahead * (kicked - before)
    return lambda state, ahead, i, a, kick, kicked, before: _foreseen_by_change(
        state, ahead, i, a, kick, kicked, before
    )


@inlined
def _turn_on(axes, state, i, early, ahead):
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for k in range(len(state.spins)):
        a = len(axes) + k
        before = body[i, 4 + a]
        kick = early * weight[i, 1]
        kicked = before + kick * push[i, a]
        half[i, a] = kicked
        body[i, 4 + a] = foreseen(state, ahead, i, a, kick, kicked, before)


@inlined
def _leap_still(axes, state, low, high, dt, early, ahead):
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    most = 0.0
    # unsigned, here and below, so that no index can count from the end
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        square = 0.0
        for a in range(len(axes)):
            before = body[i, 4 + a]
            kicked = before + kick * push[i, a]
            half[i, a] = kicked
            body[i, 4 + a] = foreseen(state, ahead, i, a, kick, kicked, before)
            body[i, a] += dt * kicked
            square += kicked * kicked
        _turn_on(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a speed that is not a number is the largest
        if not square <= most:
            most = square
    return dt * dt * most


@inlined
def _leap_along_x(axes, state, low, high, slide, dt, early, ahead):
    """Leap in a simple shear that carries x along y and leaves all else alone."""
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    most = 0.0
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        mx, my = dt * p, dt * q
        body[i, 0] += slide * body[i, 1] + mx
        body[i, 1] += my
        half[i, 0] = p - slide * q
        half[i, 1] = q
        t = foreseen(state, ahead, i, 1, kick, q, v)
        body[i, 4] = foreseen(state, ahead, i, 0, kick, p, u) - slide * t
        body[i, 5] = t
        square = mx * mx + my * my
        if len(axes) == 3:
            w = body[i, 6]
            r = w + kick * push[i, 2]
            mz = dt * r
            body[i, 2] += mz
            half[i, 2] = r
            body[i, 6] = foreseen(state, ahead, i, 2, kick, r, w)
            square += mz * mz
        _turn_on(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= most:
            most = square
    return most


@device
def _maps(flow, time, dt):
    """Return what a step of the box does: to places, to peculiar velocities, and to displacements at half time."""
    start = gamma_at(flow.profile, time)[0]
    middle = gamma_at(flow.profile, time + 0.5 * dt)[0]
    end = gamma_at(flow.profile, time + dt)[0]
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


@inlined
def _leap_anyhow(flow, axes, state, low, high, time, dt, early, ahead):
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    g, b, h = _maps(flow, time, dt)
    most = 0.0
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        x, y = body[i, 0], body[i, 1]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        s, t = foreseen(state, ahead, i, 0, kick, p, u), foreseen(state, ahead, i, 1, kick, q, v)
        if d == 2:
            mx = dt * (h[0][0] * p + h[0][1] * q)
            my = dt * (h[1][0] * p + h[1][1] * q)
            body[i, 0] = g[0][0] * x + g[0][1] * y + mx
            body[i, 1] = g[1][0] * x + g[1][1] * y + my
            half[i, 0] = b[0][0] * p + b[0][1] * q
            half[i, 1] = b[1][0] * p + b[1][1] * q
            body[i, 4] = b[0][0] * s + b[0][1] * t
            body[i, 5] = b[1][0] * s + b[1][1] * t
            square = mx * mx + my * my
        else:
            z, w = body[i, 2], body[i, 6]
            r = w + kick * push[i, 2]
            mx = dt * (h[0][0] * p + h[0][1] * q + h[0][2] * r)
            my = dt * (h[1][0] * p + h[1][1] * q + h[1][2] * r)
            mz = dt * (h[2][0] * p + h[2][1] * q + h[2][2] * r)
            body[i, 0] = g[0][0] * x + g[0][1] * y + g[0][2] * z + mx
            body[i, 1] = g[1][0] * x + g[1][1] * y + g[1][2] * z + my
            body[i, 2] = g[2][0] * x + g[2][1] * y + g[2][2] * z + mz
            o = foreseen(state, ahead, i, 2, kick, r, w)
            half[i, 0] = b[0][0] * p + b[0][1] * q + b[0][2] * r
            half[i, 1] = b[1][0] * p + b[1][1] * q + b[1][2] * r
            half[i, 2] = b[2][0] * p + b[2][1] * q + b[2][2] * r
            body[i, 4] = b[0][0] * s + b[0][1] * t + b[0][2] * o
            body[i, 5] = b[1][0] * s + b[1][1] * t + b[1][2] * o
            body[i, 6] = b[2][0] * s + b[2][1] * t + b[2][2] * o
            square = mx * mx + my * my + mz * mz
        _turn_on(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= most:
            most = square
    return most


@inlined
def _leap_flowing(flow, axes, state, low, high, time, dt, early, ahead):
    if flow.number[ALONG_X] != 0.0:
        slide = gamma_at(flow.profile, time + dt)[0] - gamma_at(flow.profile, time)[0]
        return _leap_along_x(axes, state, low, high, slide * flow.direction_dd[0, 1], dt, early, ahead)
    return _leap_anyhow(flow, axes, state, low, high, time, dt, early, ahead)


@inlined_form(leap)
def _choose_leap(
    flow: Any, axes: Any, state: Any, low: Any, high: Any, time: Any, dt: Any, early: Any, ahead: Any
) -> Any:
    if is_still(flow):

        def still(flow, axes, state, low, high, time, dt, early, ahead):
            return _leap_still(axes, state, low, high, dt, early, ahead)

        return still

    def flowing(flow, axes, state, low, high, time, dt, early, ahead):
        return _leap_flowing(flow, axes, state, low, high, time, dt, early, ahead)

    return flowing
