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

import numpy as np
from numba import literal_unroll, types

from packmech.compiled import compiled_form
from packmech.dynamics.kernels import NOT_FINITE, RUNNING
from packmech.dynamics.march.bonding import bonds_of_block, collect_bonds
from packmech.dynamics.march.contact import contacts_of_block
from packmech.dynamics.march.flow import flow_to, is_still, rates, turning
from packmech.dynamics.march.inlined import inlined, inlined_form, lean
from packmech.dynamics.march.leaps import clear_rows, leap
from packmech.dynamics.march.lists import deform_images, keep_up, largest_contact, worn
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


def move_box(flow: Any, frame: Any, time: float) -> None:
    """Set the box to its shape at a time."""
    if flow is not None:
        flow_to(flow, frame, time)


@compiled_form(move_box)
def _choose_move_box(flow: Any, frame: Any, time: Any) -> Any:
    if is_still(flow):
        return lambda flow, frame, time: None
    return lambda flow, frame, time: flow_to(flow, frame, time)


def bodies_push(bodies: Any, axes: Any, state: State, rates: Any, low: int, high: int) -> None:
    """Set push of rows, which is zero, to the forces on single particles; nothing where nothing acts on them."""
    raise NotImplementedError("a march is stepped in compiled loops")


@inlined
def _push_bodies(bodies, axes, state, rates, low, high):
    d = len(axes)
    body, push, weight = state.body, state.push, state.weight_nk
    wx, wy, wz = turning(rates)
    for i in range(np.uint64(low), np.uint64(high)):
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


@inlined_form(bodies_push)
def _choose_bodies_push(bodies: Any, axes: Any, state: Any, rates: Any, low: Any, high: Any) -> Any:
    if isinstance(bodies, types.NoneType):
        return lambda bodies, axes, state, rates, low, high: None
    return lambda bodies, axes, state, rates, low, high: _push_bodies(bodies, axes, state, rates, low, high)


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


@lean
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
    held_pk = None if track is None else track.inner_pk
    listed, contact = pairs.number, largest_contact(space.sizes)
    body, push, lattice = state.body, state.push, space.frame.lattice_dd
    if start == FORCES:
        clear_rows(axes, state, low, high)
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
                deform_images(space.flow, lattice, pairs.image_kd, pairs.shift_kd)
                if worn(space.flow, listed, contact, moved):
                    stale = keep_up(axes, body, space, pairs, track)
            if told(team, stale):
                return SEARCH, step
        flowing = rates(space.flow)
        for b in range(low_b, high_b):
            bodies_push(acting.bodies, axes, state, flowing, row_b[b], row_b[b + 1])
            contacts_of_block(acting.pairs, acting.friction, flowing, axes, body, push, pairs, held_pk, pace, b)
            bonds_of_block(space.bonds, flowing, axes, body, push, lattice, pace, b)
        wait(team)
        for b in range(low_b, high_b):
            collect(axes, state.spins, pairs.slots, push, b)
            collect_bonds(space.bonds, axes, state.spins, push, b)
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
