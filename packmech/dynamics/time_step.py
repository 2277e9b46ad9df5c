# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The time steps: velocity Verlet and semi-implicit Euler for positions, velocities and spins."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll

from packmech.constraints.rattle import rattle_positions, rattle_velocities
from packmech.dynamics.bonds import bonds_of_block, collect_bonds
from packmech.dynamics.contact_forces import contacts_of_block
from packmech.dynamics.deformation import ALONG_X, entries, flow_to, gamma_at, map_between, rates, turning
from packmech.dynamics.friction import Pace
from packmech.dynamics.observables import append_row, is_due
from packmech.dynamics.pair_lists import (
    collect,
    deform_images,
    is_stale,
    largest_contact,
    update_lists,
)
from packmech.dynamics.shape_pairs import dragged_to, push_on_row, shapes_of_block, turn_shapes
from packmech.dynamics.threads import broadcast, is_first, largest, share, wait
from packmech.effects import spin_drag
from packmech.jit.compiled import device, inlined, lean
from packmech.minimize.passes.kernels import NOT_FINITE, RUNNING


@device
def _clear(axes, spins, push, i):
    for a in range(len(axes) + len(spins)):
        push[i, a] = 0.0


@device
def clear_rows(axes, state, low, high):
    """Set the forces on rows to zero."""
    for i in range(low, high):
        _clear(axes, state.spins, state.push, i)


@inlined
def extrapolated(last, state, ahead, i, a, kick, kicked, before):
    """Return what a velocity, kicked by a force from what it was before, is taken for at the end of the step."""
    if last is None:
        return kicked + ahead * (kicked - before)
    force = state.push[i, a]
    change = force - last[i, a]
    last[i, a] = force
    return kicked + ahead * (kicked - before) + kick * state.lead * change


@inlined
def _kick_spins(axes, state, i, early, ahead):
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for k in range(len(state.spins)):
        a = len(axes) + k
        before = body[i, 4 + a]
        kick = early * weight[i, 1]
        kicked = before + kick * push[i, a]
        half[i, a] = kicked
        body[i, 4 + a] = extrapolated(state.last, state, ahead, i, a, kick, kicked, before)


@inlined
def _drift_in_still_box(axes, state, low, high, dt, early, ahead):
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    largest = 0.0
    # unsigned, here and below, so that no index can count from the end
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        square = 0.0
        for a in range(len(axes)):
            before = body[i, 4 + a]
            kicked = before + kick * push[i, a]
            half[i, a] = kicked
            body[i, 4 + a] = extrapolated(state.last, state, ahead, i, a, kick, kicked, before)
            body[i, a] += dt * kicked
            square += kicked * kicked
        _kick_spins(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a speed that is not a number is the largest
        if not square <= largest:
            largest = square
    return dt * dt * largest


@inlined
def _drift_along_x(axes, state, low, high, shear_step, dt, early, ahead):
    """Drift in a simple shear that carries x along y and leaves all else alone."""
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    largest = 0.0
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        mx, my = dt * p, dt * q
        body[i, 0] += shear_step * body[i, 1] + mx
        body[i, 1] += my
        half[i, 0] = p - shear_step * q
        half[i, 1] = q
        t = extrapolated(state.last, state, ahead, i, 1, kick, q, v)
        body[i, 4] = extrapolated(state.last, state, ahead, i, 0, kick, p, u) - shear_step * t
        body[i, 5] = t
        square = mx * mx + my * my
        if len(axes) == 3:
            w = body[i, 6]
            r = w + kick * push[i, 2]
            mz = dt * r
            body[i, 2] += mz
            half[i, 2] = r
            body[i, 6] = extrapolated(state.last, state, ahead, i, 2, kick, r, w)
            square += mz * mz
        _kick_spins(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= largest:
            largest = square
    return largest


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
def _drift_in_any_flow(flow, axes, state, low, high, time, dt, early, ahead):
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    g, b, h = _maps(flow, time, dt)
    largest = 0.0
    for i in range(np.uint64(low), np.uint64(high)):
        kick = early * weight[i, 0]
        x, y = body[i, 0], body[i, 1]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        s = extrapolated(state.last, state, ahead, i, 0, kick, p, u)
        t = extrapolated(state.last, state, ahead, i, 1, kick, q, v)
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
            o = extrapolated(state.last, state, ahead, i, 2, kick, r, w)
            half[i, 0] = b[0][0] * p + b[0][1] * q + b[0][2] * r
            half[i, 1] = b[1][0] * p + b[1][1] * q + b[1][2] * r
            half[i, 2] = b[2][0] * p + b[2][1] * q + b[2][2] * r
            body[i, 4] = b[0][0] * s + b[0][1] * t + b[0][2] * o
            body[i, 5] = b[1][0] * s + b[1][1] * t + b[1][2] * o
            body[i, 6] = b[2][0] * s + b[2][1] * t + b[2][2] * o
            square = mx * mx + my * my + mz * mz
        _kick_spins(axes, state, i, early, ahead)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= largest:
            largest = square
    return largest


@inlined
def kick_and_drift(flow, axes, state, low, high, time, dt, early, ahead):
    """Kick rows, take them to the end of the step and clear their forces; return the largest squared displacement.

    `half` is left with the velocities and spins after the kick, the velocities of the rows are half + ahead (half -
    velocities). The box's own share of displacements is not counted.
    """
    if flow is None:
        return _drift_in_still_box(axes, state, low, high, dt, early, ahead)
    if flow.number[ALONG_X] != 0.0:
        shear = gamma_at(flow.profile, time + dt)[0] - gamma_at(flow.profile, time)[0]
        return _drift_along_x(axes, state, low, high, shear * flow.direction_dd[0, 1], dt, early, ahead)
    return _drift_in_any_flow(flow, axes, state, low, high, time, dt, early, ahead)


TOO_FAST = NOT_FINITE
# a loop that ended because its pair lists must be rebuilt, in the middle of a step
SEARCH = 17
# where a loop starts: with a step, in the middle of one, or only to take the forces
WHOLE_STEP, REST_OF_STEP, FORCES = 0, 1, 2


class Acting(NamedTuple):
    """What acts: effects on pairs and on single particles, friction, and the shapes they act on (None without)."""

    pairs: Any
    bodies: Any
    friction: Any
    shapes: Any = None


class State(NamedTuple):
    """The arrays of the engine. weight_nk holds 1/m and, where particles turn, 1/I; both are 0 for what is held.

    `spins` is a tuple as long as a spin: none where nothing turns, 1 in a plane, 3 in space. `lead` is the share of the
    last change of the forces, from `last` to `push`, in extrapolated velocities; `last` is None where it is zero.
    """

    spins: Any
    body: Any
    push: Any
    half: Any
    weight_nk: Any
    mass_n: Any
    last: Any
    lead: Any


@device
def move_box(flow, frame, time):
    """Set the box to its shape at a time."""
    if flow is not None:
        flow_to(flow, frame, time)


@inlined
def pairs_of_block(shapes, effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b):
    """Add what touching pairs of a block's rows do, of discs and spheres or of shapes."""
    if shapes is None:
        contacts_of_block(effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b)
    else:
        shapes_of_block(shapes, effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b)


@inlined
def body_forces(shapes, bodies, axes, state, rates, low, high):
    """Set push of rows, which is zero, to the forces on single particles; nothing where nothing acts on them."""
    if bodies is None:
        return
    d = len(axes)
    body, push, weight = state.body, state.push, state.weight_nk
    wx, wy, wz = turning(rates)
    for i in range(np.uint64(low), np.uint64(high)):
        fx = fy = fz = 0.0
        drag = 0.0
        tx = ty = tz = 0.0
        for one in literal_unroll(bodies):
            x, y, z, turn_x, turn_y, turn_z = push_on_row(one, shapes, axes, body, i, state.mass_n[i])
            fx += x
            fy += y
            fz += z
            tx += turn_x
            ty += turn_y
            tz += turn_z
            drag += spin_drag(one)
        push[i, 0] = fx
        push[i, 1] = fy
        if d == 3:
            push[i, 2] = fz
        if push.shape[1] > d:
            slow = -drag / weight[i, 1] if weight[i, 1] > 0.0 else 0.0
            if d == 2:
                push[i, 2] = slow * (body[i, 6] - wz) + tz
            else:
                ox, oy, oz = dragged_to(shapes, axes, i, wx, wy, wz)
                push[i, 3] = slow * (body[i, 7] - ox) + tx
                push[i, 4] = slow * (body[i, 8] - oy) + ty
                push[i, 5] = slow * (body[i, 9] - oz) + tz


@inlined
def _finish_kick(axes, state, low, high, late):
    """Set velocities and spins to half, kicked by the forces."""
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for i in range(np.uint64(low), np.uint64(high)):
        kick = late * weight[i, 0]
        for a in range(d):
            body[i, 4 + a] = half[i, a] + kick * push[i, a]
        for k in range(len(state.spins)):
            a = d + k
            body[i, 4 + a] = half[i, a] + late * weight[i, 1] * push[i, a]


@device
def project_velocities(thread, links, axes, body, half):
    """Take what would stretch links out of the velocities at the end of a step; nothing where nothing is linked."""
    if links is not None:
        wait(thread)
        if is_first(thread):
            rattle_velocities(links, axes, body, half)
        wait(thread)


@lean
def take_steps(
    acting, axes, state, links, space, pairs, track, ledger, thread, start, first, steps, dt, second_order, reach
):
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
    low_b, high_b = share(thread, row_b.shape[0] - 1)
    low, high = row_b[low_b], row_b[high_b]
    stretch_pk = None if track is None else track.inner_pk
    listed, contact = pairs.number, largest_contact(space.sizes)
    body, push, lattice = state.body, state.push, space.frame.lattice_dd
    if start == FORCES:
        clear_rows(axes, state, low, high)
    for step in range(steps):
        time = (first + step) * dt
        if start == WHOLE_STEP:
            square = kick_and_drift(space.flow, axes, state, low, high, time, dt, early, ahead)
            turn_shapes(acting.shapes, axes, state, low, high, dt)
            moved = math.sqrt(largest(thread, square))
            status = RUNNING
            if is_first(thread):
                moved = rattle_positions(links, axes, body, state.half, lattice, dt, ahead, moved)
                if not moved < reach:
                    status = TOO_FAST
                else:
                    move_box(space.flow, space.frame, time + dt)
                    deform_images(space.flow, lattice, pairs.image_kd, pairs.shift_kd)
                    if is_stale(space.flow, listed, contact, moved) and update_lists(axes, body, space, pairs, track):
                        status = SEARCH
            status = broadcast(thread, status)
            if status != RUNNING:
                return status, step
        flowing = rates(space.flow)
        for b in range(low_b, high_b):
            body_forces(acting.shapes, acting.bodies, axes, state, flowing, row_b[b], row_b[b + 1])
            pairs_of_block(
                acting.shapes, acting.pairs, acting.friction, flowing, axes, body, push, pairs, stretch_pk, pace, b
            )
            bonds_of_block(space.bonds, flowing, axes, body, push, lattice, pace, b)
        wait(thread)
        for b in range(low_b, high_b):
            collect(axes, state.spins, pairs.slots, push, b)
            collect_bonds(space.bonds, axes, state.spins, push, b)
        if start == FORCES:
            return RUNNING, 0
        _finish_kick(axes, state, low, high, late)
        if second_order:
            project_velocities(thread, links, axes, body, state.half)
        start = WHOLE_STEP
        if is_due(ledger, first + step + 1):
            wait(thread)
            if is_first(thread):
                append_row(ledger, acting, axes, state, links, space, pairs, track, first + step + 1, dt, pace)
            wait(thread)
    return RUNNING, steps
