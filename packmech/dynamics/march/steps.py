# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The time steps of a march: velocity Verlet and semi-implicit Euler for places, velocities and spins.

A Verlet step kicks for half a step, lets the box carry everything to the middle of the step, moves by the peculiar
velocity, lets the box carry on to the end, takes the forces there and kicks again (a Strang splitting, of second
order). Dashpots, slips and drag see velocities extrapolated to the end of the step: by the force, and for tangential
springs without dashpots by its last change too, as their stretch, an integral of the slip, would grow by (omega dt)^4/8
of itself in every step otherwise.

Every loop starts and ends with the forces of the present state in `push`, so that a run may be cut anywhere without a
change of a bit. Rows are walked by blocks, each by one thread.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import literal_unroll, types

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.kernels import NOT_FINITE, RUNNING
from packmech.dynamics.march.bonding import bonds_of_block, collect_bonds
from packmech.dynamics.march.contact import contacts_of_block
from packmech.dynamics.march.flow import gamma_at, is_still, map_between, rates, set_flow, turning
from packmech.dynamics.march.lists import deform_images, held_of, keep_up
from packmech.dynamics.march.pairs import collect
from packmech.dynamics.march.springs import Pace
from packmech.dynamics.march.tally import due_now, tally
from packmech.dynamics.march.team import largest, leads, share, told, wait
from packmech.effects import body_force, spin_drag

TOO_FAST = NOT_FINITE
# a loop that ended because its pair lists must be searched anew, in the middle of a step
SEARCH = 17
# where a loop starts: with a step, in the middle of one, or only to take the forces
WHOLE_STEP, REST_OF_STEP, FORCES = 0, 1, 2


class Acting(NamedTuple):
    """What acts: effects on pairs and on single particles (None without), friction (None without)."""

    pairs: Any
    bodies: Any
    friction: Any


class State(NamedTuple):
    """The arrays of a march. weight_nk holds 1/m and, where particles turn, 1/I; both are 0 for what is held.

    `spins` is a tuple as long as a spin: none where nothing turns, 1 in a plane, 3 in space. `lead` is the share of the
    last change of the forces, from `last` to `push`, in extrapolated velocities; `last` is empty where it is zero.
    """

    spins: Any
    body: Any
    push: Any
    half: Any
    weight_nk: Any
    mass_n: Any
    last: Any
    lead: Any


def leap(
    flow: Any, axes: Any, state: State, low: int, high: int, time: float, dt: float, early: float, ahead: float
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
def _clear_all(axes, state, low, high):
    for i in range(low, high):
        _clear(axes, state.spins, state.push, i)


@device
def _led(spins, lead, last, i, a, force):
    """Return what the change of a force since the last step adds to it for an extrapolation; remember the force."""
    if len(spins) == 0 or lead == 0.0:
        return 0.0
    change = force - last[i, a]
    last[i, a] = force
    return lead * change


@device
def _leap_still(axes, state, low, high, dt, early, ahead):
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    spins, last, lead = state.spins, state.last, state.lead
    most = 0.0
    for i in range(low, high):
        kick = early * weight[i, 0]
        square = 0.0
        for a in range(d):
            c = body[i, 4 + a]
            kicked = c + kick * push[i, a]
            half[i, a] = kicked
            body[i, 4 + a] = kicked + ahead * (kicked - c) + kick * _led(spins, lead, last, i, a, push[i, a])
            body[i, a] += dt * kicked
            square += kicked * kicked
        for k in range(len(spins)):
            a = d + k
            c = body[i, 4 + a]
            turn = early * weight[i, 1]
            kicked = c + turn * push[i, a]
            half[i, a] = kicked
            body[i, 4 + a] = kicked + ahead * (kicked - c) + turn * _led(spins, lead, last, i, a, push[i, a])
        _clear(axes, spins, push, i)
        # written so that a speed that is not a number is the largest
        if not square <= most:
            most = square
    return dt * dt * most


@device
def _entries(matrix):
    return (
        (matrix[0, 0], matrix[0, 1], matrix[0, 2]),
        (matrix[1, 0], matrix[1, 1], matrix[1, 2]),
        (matrix[2, 0], matrix[2, 1], matrix[2, 2]),
    )


@device
def _maps(flow, time, dt):
    """Return what a step of the box does: to places, to peculiar velocities, and to displacements at half time."""
    start = gamma_at(flow.profile, time)[0]
    middle = gamma_at(flow.profile, time + 0.5 * dt)[0]
    end = gamma_at(flow.profile, time + dt)[0]
    # all of these commute
    map_between(flow, start, end, flow.step_dd)
    places = _entries(flow.step_dd)
    map_between(flow, end, start, flow.step_dd)
    speeds = _entries(flow.step_dd)
    map_between(flow, middle, start, flow.step_dd)
    map_between(flow, middle, end, flow.back_dd)
    for i in range(3):
        x, y, z = flow.back_dd[i, 0], flow.back_dd[i, 1], flow.back_dd[i, 2]
        for j in range(3):
            flow.back_dd[i, j] = x * flow.step_dd[0, j] + y * flow.step_dd[1, j] + z * flow.step_dd[2, j]
    return places, speeds, _entries(flow.back_dd)


@device
def _leap_flowing(flow, axes, state, low, high, time, dt, early, ahead):
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    spins, last, lead = state.spins, state.last, state.lead
    g, b, h = _maps(flow, time, dt)
    most = 0.0
    for i in range(low, high):
        kick = early * weight[i, 0]
        x, y = body[i, 0], body[i, 1]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        if d == 2:
            mx = dt * (h[0][0] * p + h[0][1] * q)
            my = dt * (h[1][0] * p + h[1][1] * q)
            body[i, 0] = g[0][0] * x + g[0][1] * y + mx
            body[i, 1] = g[1][0] * x + g[1][1] * y + my
            s = p + ahead * (p - u) + kick * _led(spins, lead, last, i, 0, push[i, 0])
            t = q + ahead * (q - v) + kick * _led(spins, lead, last, i, 1, push[i, 1])
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
            s = p + ahead * (p - u) + kick * _led(spins, lead, last, i, 0, push[i, 0])
            t = q + ahead * (q - v) + kick * _led(spins, lead, last, i, 1, push[i, 1])
            o = r + ahead * (r - w) + kick * _led(spins, lead, last, i, 2, push[i, 2])
            half[i, 0] = b[0][0] * p + b[0][1] * q + b[0][2] * r
            half[i, 1] = b[1][0] * p + b[1][1] * q + b[1][2] * r
            half[i, 2] = b[2][0] * p + b[2][1] * q + b[2][2] * r
            body[i, 4] = b[0][0] * s + b[0][1] * t + b[0][2] * o
            body[i, 5] = b[1][0] * s + b[1][1] * t + b[1][2] * o
            body[i, 6] = b[2][0] * s + b[2][1] * t + b[2][2] * o
            square = mx * mx + my * my + mz * mz
        for k in range(len(spins)):
            a = d + k
            c = body[i, 4 + a]
            turn = early * weight[i, 1]
            kicked = c + turn * push[i, a]
            half[i, a] = kicked
            body[i, 4 + a] = kicked + ahead * (kicked - c) + turn * _led(spins, lead, last, i, a, push[i, a])
        _clear(axes, spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= most:
            most = square
    return most


@compiled_form(leap)
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


def move_box(flow: Any, frame: Any, time: float) -> None:
    """Set the box to its shape at a time."""
    if flow is not None:
        set_flow(flow, frame, time)


@compiled_form(move_box)
def _choose_move_box(flow: Any, frame: Any, time: Any) -> Any:
    if is_still(flow):
        return lambda flow, frame, time: None
    return lambda flow, frame, time: set_flow(flow, frame, time)


def bodies_push(bodies: Any, axes: Any, state: State, rates: Any, low: int, high: int) -> None:
    """Set push of rows, which is zero, to the forces on single particles; nothing where nothing acts on them."""
    raise NotImplementedError("a march is stepped in compiled loops")


@device
def _push_bodies(bodies, axes, state, rates, low, high):
    d = len(axes)
    body, push, weight = state.body, state.push, state.weight_nk
    wx, wy, wz = turning(rates)
    for i in range(low, high):
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
def _choose_bodies_push(bodies: Any, axes: Any, state: Any, rates: Any, low: Any, high: Any) -> Any:
    if isinstance(bodies, types.NoneType):
        return lambda bodies, axes, state, rates, low, high: None
    return lambda bodies, axes, state, rates, low, high: _push_bodies(bodies, axes, state, rates, low, high)


@device
def _finish_kick(axes, state, low, high, late):
    """Set velocities and spins to half, kicked by the forces."""
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for i in range(low, high):
        kick = late * weight[i, 0]
        for a in range(d):
            body[i, 4 + a] = half[i, a] + kick * push[i, a]
        for k in range(len(state.spins)):
            a = d + k
            body[i, 4 + a] = half[i, a] + late * weight[i, 1] * push[i, a]


@kernel
def march(acting, axes, state, space, pairs, track, ledger, team, start, first, steps, dt, second_order, reach):
    """Take up to `steps` steps from step number `first`; return how that ended and the steps taken.

    Velocity Verlet if `second_order`, else semi-implicit Euler. `start` says where to begin.
    """
    early = 0.5 * dt if second_order else dt
    late = dt - early
    ahead = 1.0 if second_order else 0.0
    before = 0.5 * dt if second_order and start != FORCES else 0.0
    after = 0.5 * dt if second_order else dt
    pace = Pace(before, after)
    row_b = pairs.row_b
    low_b, high_b = share(team, row_b.shape[0] - 1)
    low, high = row_b[low_b], row_b[high_b]
    held_pk = held_of(track)
    body, push, lattice = state.body, state.push, space.frame.lattice_dd
    if start == FORCES:
        _clear_all(axes, state, low, high)
    for step in range(steps):
        time = (first + step) * dt
        if start == WHOLE_STEP:
            square = leap(space.flow, axes, state, low, high, time, dt, early, ahead)
            moved = math.sqrt(largest(team, square))
            if not moved < reach:
                return TOO_FAST, step
            stale = False
            if leads(team):
                move_box(space.flow, space.frame, time + dt)
                deform_images(space.flow, space.frame, pairs)
                stale = keep_up(axes, body, space, pairs, track, moved)
            if told(team, stale):
                return SEARCH, step
        flowing = rates(space.flow)
        for b in range(low_b, high_b):
            bodies_push(acting.bodies, axes, state, flowing, row_b[b], row_b[b + 1])
            contacts_of_block(acting.pairs, acting.friction, flowing, axes, body, push, pairs, held_pk, pace, b)
            bonds_of_block(space.bonds, flowing, axes, body, push, lattice, pace, b)
        wait(team)
        for b in range(low_b, high_b):
            collect(pairs.slots, push, b)
            collect_bonds(space.bonds, push, b)
        if start == FORCES:
            return RUNNING, 0
        _finish_kick(axes, state, low, high, late)
        start = WHOLE_STEP
        if due_now(ledger, first + step + 1):
            wait(team)
            if leads(team):
                tally(ledger, acting, axes, state, space, pairs, track, first + step + 1, dt, pace)
            wait(team)
    return RUNNING, steps
