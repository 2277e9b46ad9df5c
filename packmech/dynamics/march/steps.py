# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The time steps of a march: velocity Verlet and semi-implicit Euler for places, velocities and spins.

A Verlet step kicks for half a step, lets the box carry everything to the middle of the step, moves by the peculiar
velocity, lets the box carry on to the end, takes the forces there and kicks again (a Strang splitting, of second
order). Dashpots, slips and drag see velocities extrapolated to the end of the step.

Every loop starts and ends with the forces of the present state in `push`, so that a run may be cut anywhere without a
change of a bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll, types

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.kernels import NOT_FINITE, RUNNING
from packmech.dynamics.march.contact import contact_pass
from packmech.dynamics.march.flow import gamma_at, is_still, map_between, rates, set_flow, turning
from packmech.dynamics.march.lists import crossing_of, deform_images, keep_up, within_of
from packmech.dynamics.march.springs import Pace
from packmech.dynamics.march.tally import tally
from packmech.dynamics.pair_list import AGE, TRAVEL
from packmech.effects import body_force, spin_drag

TOO_FAST = NOT_FINITE
_FAR = 1e300


class Acting(NamedTuple):
    """What acts: effects on pairs and on single particles (None without), friction (None without)."""

    pairs: Any
    bodies: Any
    friction: Any


class State(NamedTuple):
    """The arrays of a march. weight_nk holds 1/m and, where particles turn, 1/I; both are 0 for what is held."""

    body: Any
    push: Any
    half: Any
    weight_nk: Any
    mass_n: Any


@device
def kick(axes, state, step):
    """Set half to the velocities and spins after a kick by the present forces."""
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for i in range(body.shape[0]):
        move = step * weight[i, 0]
        for a in range(d):
            half[i, a] = body[i, 4 + a] + move * push[i, a]
        for a in range(d, half.shape[1]):
            half[i, a] = body[i, 4 + a] + step * weight[i, 1] * push[i, a]


def drift(flow: Any, axes: Any, state: State, dt: float, ahead: float) -> float:
    """Move by dt along half; set velocities to half + ahead (half - velocities); return the largest speed in half."""
    raise NotImplementedError("a march is stepped in compiled loops")


@device
def _drift_still(axes, state, dt, ahead):
    d = len(axes)
    body, half = state.body, state.half
    most = 0.0
    for i in range(body.shape[0]):
        square = 0.0
        for a in range(d):
            c = half[i, a]
            square += c * c
            body[i, a] += dt * c
        for a in range(half.shape[1]):
            body[i, 4 + a] = half[i, a] + ahead * (half[i, a] - body[i, 4 + a])
        # written so that a speed that is not a number is the largest
        if not square <= most:
            most = square
    return math.sqrt(most)


@device
def _drift_flowing(flow, axes, state, time, dt, ahead):
    d = len(axes)
    body, half = state.body, state.half
    low = gamma_at(flow.profile, time)[0]
    middle = gamma_at(flow.profile, time + 0.5 * dt)[0]
    high = gamma_at(flow.profile, time + dt)[0]
    most = 0.0
    # first to the middle of the step, then to its end
    for part in range(2):
        start, end = (low, middle) if part == 0 else (middle, high)
        map_between(flow, start, end, flow.step_dd)
        map_between(flow, end, start, flow.back_dd)
        g, b = flow.step_dd, flow.back_dd
        for i in range(body.shape[0]):
            x, y, z = body[i, 0], body[i, 1], body[i, 2]
            body[i, 0] = g[0, 0] * x + g[0, 1] * y + g[0, 2] * z
            body[i, 1] = g[1, 0] * x + g[1, 1] * y + g[1, 2] * z
            u, v = half[i, 0], half[i, 1]
            w = 0.0
            p, q = body[i, 4], body[i, 5]
            r = 0.0
            if d == 3:
                body[i, 2] = g[2, 0] * x + g[2, 1] * y + g[2, 2] * z
                w = half[i, 2]
                r = body[i, 6]
                half[i, 2] = b[2, 0] * u + b[2, 1] * v + b[2, 2] * w
                body[i, 6] = b[2, 0] * p + b[2, 1] * q + b[2, 2] * r
            half[i, 0] = b[0, 0] * u + b[0, 1] * v + b[0, 2] * w
            half[i, 1] = b[1, 0] * u + b[1, 1] * v + b[1, 2] * w
            body[i, 4] = b[0, 0] * p + b[0, 1] * q + b[0, 2] * r
            body[i, 5] = b[1, 0] * p + b[1, 1] * q + b[1, 2] * r
            if part == 0:
                square = 0.0
                for a in range(d):
                    c = half[i, a]
                    square += c * c
                    body[i, a] += dt * c
                if not square <= most:
                    most = square
            else:
                for a in range(half.shape[1]):
                    body[i, 4 + a] = half[i, a] + ahead * (half[i, a] - body[i, 4 + a])
    return math.sqrt(most)


def advance_places(flow: Any, frame: Any, axes: Any, state: State, time: float, dt: float, ahead: float) -> float:
    """Take everybody, and the box, to the end of a step; return the largest peculiar speed."""
    raise NotImplementedError("a march is stepped in compiled loops")


@compiled_form(advance_places)
def _choose_advance_places(flow: Any, frame: Any, axes: Any, state: Any, time: Any, dt: Any, ahead: Any) -> Any:
    if is_still(flow):
        return lambda flow, frame, axes, state, time, dt, ahead: _drift_still(axes, state, dt, ahead)

    def flowing(flow, frame, axes, state, time, dt, ahead):
        fastest = _drift_flowing(flow, axes, state, time, dt, ahead)
        set_flow(flow, frame, time + dt)
        return fastest

    return flowing


def bodies_push(bodies: Any, axes: Any, state: State, rates: Any) -> None:
    """Set push to the forces on single particles: zero where nothing acts on them."""
    raise NotImplementedError("a march is stepped in compiled loops")


@device
def _clear(push):
    for i in range(push.shape[0]):
        for a in range(push.shape[1]):
            push[i, a] = 0.0


@device
def _push_bodies(bodies, axes, state, rates):
    d = len(axes)
    body, push, weight = state.body, state.push, state.weight_nk
    wx, wy, wz = turning(rates)
    for i in range(body.shape[0]):
        fx = fy = fz = 0.0
        drag = 0.0
        w = body[i, 6] if d == 3 else 0.0
        for one in literal_unroll(bodies):
            x, y, z = body_force(
                one, body[i, 0], body[i, 1], body[i, 2], body[i, 4], body[i, 5], w, state.mass_n[i], body[i, 3]
            )
            fx += x
            fy += y
            fz += z
            drag += spin_drag(one)
        push[i, 0] = fx
        push[i, 1] = fy
        if d == 3:
            push[i, 2] = fz
        if push.shape[1] > d:
            slow = -drag / weight[i, 1] if weight[i, 1] > 0.0 else 0.0
            if d == 2:
                push[i, 2] = slow * (body[i, 6] - wz)
            else:
                push[i, 3] = slow * (body[i, 7] - wx)
                push[i, 4] = slow * (body[i, 8] - wy)
                push[i, 5] = slow * (body[i, 9] - wz)


@compiled_form(bodies_push)
def _choose_bodies_push(bodies: Any, axes: Any, state: Any, rates: Any) -> Any:
    if isinstance(bodies, types.NoneType):
        return lambda bodies, axes, state, rates: _clear(state.push)
    return lambda bodies, axes, state, rates: _push_bodies(bodies, axes, state, rates)


@device
def finish_kick(axes, state, step):
    """Set velocities and spins to half, kicked by the forces."""
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for i in range(body.shape[0]):
        move = step * weight[i, 0]
        for a in range(d):
            body[i, 4 + a] = half[i, a] + move * push[i, a]
        for a in range(d, half.shape[1]):
            body[i, 4 + a] = half[i, a] + step * weight[i, 1] * push[i, a]


def begin_flow(flow: Any, frame: Any, time: float) -> None:
    """Set the box to its shape at a time."""
    if flow is not None:
        set_flow(flow, frame, time)


@compiled_form(begin_flow)
def _choose_begin_flow(flow: Any, frame: Any, time: Any) -> Any:
    if is_still(flow):
        return lambda flow, frame, time: None
    return lambda flow, frame, time: set_flow(flow, frame, time)


@kernel
def start_march(acting, axes, state, space, pairs, track, time, pace):
    """Set the forces at the present state; return pair list and track."""
    begin_flow(space.flow, space.frame, time)
    if pairs.number[TRAVEL] < np.inf:
        # wherever everybody is now
        pairs.number[TRAVEL] = _FAR
    pairs, track = keep_up(axes, state.body, space, pairs, track)
    deform_images(space.flow, space.frame, pairs)
    flowing = rates(space.flow)
    bodies_push(acting.bodies, axes, state, flowing)
    contact_pass(
        acting.pairs,
        acting.friction,
        space.bonds,
        flowing,
        axes,
        state.body,
        state.push,
        space.frame.lattice_dd,
        pairs,
        within_of(track),
        crossing_of(track),
        pace,
    )
    return pairs, track


@kernel
def march(acting, axes, state, space, pairs, track, ledger, first, steps, dt, second_order, reach):
    """Take up to `steps` steps from step number `first`; return how that ended, steps taken, pair list and track.

    Velocity Verlet if `second_order`, else semi-implicit Euler.
    """
    early = 0.5 * dt if second_order else dt
    late = dt - early
    ahead = 1.0 if second_order else 0.0
    pace = Pace(0.5 * dt, 0.5 * dt) if second_order else Pace(0.0, dt)
    for step in range(steps):
        time = (first + step) * dt
        kick(axes, state, early)
        fastest = advance_places(space.flow, space.frame, axes, state, time, dt, ahead)
        if not dt * fastest < reach:
            return TOO_FAST, step, pairs, track
        pairs.number[TRAVEL] += dt * fastest
        pairs.number[AGE] += 1.0
        pairs, track = keep_up(axes, state.body, space, pairs, track)
        deform_images(space.flow, space.frame, pairs)
        flowing = rates(space.flow)
        bodies_push(acting.bodies, axes, state, flowing)
        contact_pass(
            acting.pairs,
            acting.friction,
            space.bonds,
            flowing,
            axes,
            state.body,
            state.push,
            space.frame.lattice_dd,
            pairs,
            within_of(track),
            crossing_of(track),
            pace,
        )
        finish_kick(axes, state, late)
        tally(ledger, acting, axes, state, space, pairs, track, first + step + 1, dt, pace)
    return RUNNING, steps, pairs, track
