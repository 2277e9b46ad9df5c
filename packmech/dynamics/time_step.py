# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The time steps: velocity Verlet and semi-implicit Euler for positions, velocities and spins."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll

from packmech.constraints.rattle import rattle_positions, rattle_velocities
from packmech.dynamics.account import Kicks, book_kicks, keep_springs
from packmech.dynamics.bath import bathe_rows, leave_bath
from packmech.dynamics.bonds import bonds_of_block, collect_bonds
from packmech.dynamics.breaking import limits_of, some_bond_breaks
from packmech.dynamics.by_shape import contact_axes, dragged_to, push_on_row, turn_shapes
from packmech.dynamics.contact_forces import contacts_of_block, laws_of
from packmech.dynamics.deformation import ALONG_X, flow_to, gamma_at, maps_of_step, turning, with_scratch
from packmech.dynamics.faces import finish_faces, move_faces, push_faces
from packmech.dynamics.friction import Pace
from packmech.dynamics.observables import append_row, is_due
from packmech.dynamics.wall_friction import faces_of, push_of_walls
from packmech.effects import on_row, spin_drag
from packmech.jit.compiled import compiled_form, device, inlined, lean
from packmech.jit.threads import ThreadRecord, broadcast, is_first, largest, run_together, share, some_failed, wait
from packmech.minimize.passes.kernels import NOT_FINITE, RUNNING, SEARCH
from packmech.minimize.passes.pair_list import (
    collect,
    is_stale_strained,
    largest_contact,
    place_images,
    update_lists,
)

TOO_FAST = NOT_FINITE
# a loop that ended at the end of a step in which bonds went beyond their limits, before its observables
BREAKING = 18
# where a loop starts: with a step, in the middle of one, or only to take the forces
WHOLE_STEP, REST_OF_STEP, FORCES = 0, 1, 2


class Acting(NamedTuple):
    """What acts: effects on pairs and on single particles, friction, the shapes they act on, and visited walls.

    None for what a scene lacks.
    """

    pairs: Any
    bodies: Any
    friction: Any
    shapes: Any = None
    walls: Any = None


class EngineArrays(NamedTuple):
    """The arrays of the engine. weight_nk holds 1/m and, where particles turn, 1/I; both are 0 for what is held.

    `spins` is a tuple as long as a spin: none where nothing turns, 1 in a plane, 3 in space. `lead` is the share of the
    last change of the forces, from `last` to `push`, in extrapolated velocities; `last` is None where it is zero, and
    `bath` without thermal noise.
    """

    spins: Any
    body: Any
    push: Any
    half: Any
    weight_nk: Any
    mass_n: Any
    last: Any
    lead: Any
    bath: Any = None


class EngineSystem(NamedTuple):
    """All that moves: what acts, axes, arrays, links (None without), space, pair lists and their track.

    axes is (0, 1) or (0, 1, 2). `account` is that of the energy, None unless a ledger was asked for.
    """

    acting: Acting
    axes: Any
    state: EngineArrays
    links: Any
    space: Any
    pairs: Any
    track: Any
    account: Any = None


class Rule(NamedTuple):
    """How steps are taken: their time, velocity Verlet or else semi-implicit Euler, and how far nothing may move."""

    dt: float
    second_order: bool
    reach: float


class Span(NamedTuple):
    """Which steps are taken: where the first of them starts, its number, and how many at most."""

    start: int
    first: int
    steps: int


@device
def _clear(axes, spins, push, i):
    for a in range(len(axes) + len(spins)):
        push[i, a] = 0.0


@device
def clear_rows(axes, state, low, high):
    """Set the forces on rows to zero."""
    for i in range(low, high):
        _clear(axes, state.spins, state.push, i)


class Split(NamedTuple):
    """How a step is split: a kick by forces for a time `early`, a drift for dt, and a kick for a time `late`.

    The velocities that forces at its end see are extrapolated there: kicked ones, and `ahead` times the first kick.
    """

    dt: float
    early: float
    late: float
    ahead: float


@device
def split_of(rule):
    """Return how steps are split: velocity Verlet, or semi-implicit Euler, which kicks once."""
    if rule.second_order:
        return Split(rule.dt, 0.5 * rule.dt, 0.5 * rule.dt, 1.0)
    return Split(rule.dt, rule.dt, 0.0, 0.0)


@inlined
def extrapolated(last, state, split, i, a, kick, kicked, before):
    """Return what a velocity, kicked by a force from what it was before, is taken for at the end of the step."""
    if last is None:
        return kicked + split.ahead * (kicked - before)
    force = state.push[i, a]
    change = force - last[i, a]
    last[i, a] = force
    return kicked + split.ahead * (kicked - before) + kick * state.lead * change


@inlined
def _kick_spins(axes, state, i, split):
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for k in range(len(state.spins)):
        a = len(axes) + k
        before = body[i, 4 + a]
        kick = split.early * weight[i, 1]
        kicked = before + kick * push[i, a]
        half[i, a] = kicked
        body[i, 4 + a] = extrapolated(state.last, state, split, i, a, kick, kicked, before)


@inlined
def _drift_along_x(axes, state, rows, shear_step, split):
    """Drift in a simple shear that carries x along y by `shear_step`, 0 in a box at rest, and leaves all else alone."""
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    dt, largest = split.dt, 0.0
    # unsigned, here and below, so that no index can count from the end
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        kick = split.early * weight[i, 0]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        mx, my = dt * p, dt * q
        body[i, 0] += shear_step * body[i, 1] + mx
        body[i, 1] += my
        half[i, 0] = p - shear_step * q
        half[i, 1] = q
        t = extrapolated(state.last, state, split, i, 1, kick, q, v)
        body[i, 4] = extrapolated(state.last, state, split, i, 0, kick, p, u) - shear_step * t
        body[i, 5] = t
        square = mx * mx + my * my
        if len(axes) == 3:
            w = body[i, 6]
            r = w + kick * push[i, 2]
            mz = dt * r
            body[i, 2] += mz
            half[i, 2] = r
            body[i, 6] = extrapolated(state.last, state, split, i, 2, kick, r, w)
            square += mz * mz
        _kick_spins(axes, state, i, split)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= largest:
            largest = square
    return largest


@inlined
def _drift_in_any_flow(flow, axes, state, rows, time, split):
    d, dt = len(axes), split.dt
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    g, b, h = maps_of_step(flow, time, dt)
    largest = 0.0
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        kick = split.early * weight[i, 0]
        x, y = body[i, 0], body[i, 1]
        u, v = body[i, 4], body[i, 5]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        s = extrapolated(state.last, state, split, i, 0, kick, p, u)
        t = extrapolated(state.last, state, split, i, 1, kick, q, v)
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
            o = extrapolated(state.last, state, split, i, 2, kick, r, w)
            half[i, 0] = b[0][0] * p + b[0][1] * q + b[0][2] * r
            half[i, 1] = b[1][0] * p + b[1][1] * q + b[1][2] * r
            half[i, 2] = b[2][0] * p + b[2][1] * q + b[2][2] * r
            body[i, 4] = b[0][0] * s + b[0][1] * t + b[0][2] * o
            body[i, 5] = b[1][0] * s + b[1][1] * t + b[1][2] * o
            body[i, 6] = b[2][0] * s + b[2][1] * t + b[2][2] * o
            square = mx * mx + my * my + mz * mz
        _kick_spins(axes, state, i, split)
        _clear(axes, state.spins, push, i)
        # written so that a displacement that is not a number is the largest
        if not square <= largest:
            largest = square
    return largest


@inlined
def kick_and_drift_rows(flow, axes, state, rows, time, split):
    """Kick rows, take them to the end of the step and clear their forces; return the largest squared displacement.

    `half` is left with the velocities and spins after the kick, the velocities of the rows are half + ahead (half -
    velocities). The box's own share of displacements is not counted.
    """
    if flow is None:
        return _drift_along_x(axes, state, rows, 0.0, split)
    if flow.number[ALONG_X] != 0.0:
        shear = gamma_at(flow.course, time + split.dt)[0] - gamma_at(flow.course, time)[0]
        return _drift_along_x(axes, state, rows, shear * flow.direction_dd[0, 1], split)
    return _drift_in_any_flow(flow, axes, state, rows, time, split)


@device
def move_box(flow, frame, pairs, time):
    """Set the box to its shape at a time, and the images with it; nothing where nothing deforms."""
    if flow is not None:
        flow_to(flow, frame, time)
        place_images(frame, pairs)


@inlined
def body_forces(shapes, bodies, axes, state, rates, rows):
    """Set push of rows, which is zero, to the forces on single particles; nothing where nothing acts on them."""
    if bodies is None:
        return
    d = len(axes)
    body, push, weight = state.body, state.push, state.weight_nk
    wx, wy, wz = turning(rates)
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        fx = fy = fz = 0.0
        drag = 0.0
        tx = ty = tz = 0.0
        for one in literal_unroll(bodies):
            x, y, z, turn_x, turn_y, turn_z = push_on_row(shapes, on_row(one, i), axes, body, i, state.mass_n[i])
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
def _finish_kick(axes, state, rows, late):
    """Set velocities and spins to half, kicked by the forces."""
    d = len(axes)
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
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


@inlined
def kick_and_drift(system, thread, rows, time, rule, split):
    """Kick the rows of this thread and take them to the end of a step that begins at a time; return how that ended.

    The box and the images follow; where pair lists must be rebuilt, by `follow`, nothing is lost: SEARCH.
    """
    axes, state, space, links, pairs = system.axes, system.state, system.space, system.links, system.pairs
    lattice = space.frame.lattice_dd
    square = kick_and_drift_rows(space.flow, axes, state, rows, time, split)
    shapes = system.acting.shapes
    square = bathe_rows(state.bath, shapes, space.flow, axes, state, rows, time, rule.dt, square)
    turn_shapes(shapes, axes, state.half, rows[0], rows[1], rule.dt)
    leave_bath(state.bath, axes, state, rows)
    moved = math.sqrt(largest(thread, square))
    status = RUNNING
    if is_first(thread):
        moved = rattle_positions(links, axes, state.body, state.half, lattice, rule.dt, split.ahead, moved)
        # written so that a number that is none is too large
        if not (moved < rule.reach and move_faces(faces_of(system.acting.walls), split) < rule.reach):
            status = TOO_FAST
        else:
            move_box(space.flow, space.frame, pairs, time + rule.dt)
            if is_stale_strained(space.flow, pairs.number, largest_contact(space.sizes), moved) and update_lists(
                axes, state.body, space, pairs, system.track
            ):
                status = SEARCH
    return np.int64(broadcast(thread, status))


@inlined
def take_forces(system, thread, blocks, pace):
    """Add the forces and torques of everything that acts to the cleared rows of this thread's blocks."""
    acting, axes, state, space, pairs = system.acting, system.axes, system.state, system.space, system.pairs
    laws, row_b, push = laws_of(system, pace), pairs.row_b, state.push
    for b in range(blocks[0], blocks[1]):
        body_forces(acting.shapes, acting.bodies, axes, state, laws.rates, (row_b[b], row_b[b + 1]))
        push_of_walls(acting.walls, axes, state, pace, (row_b[b], row_b[b + 1]), b)
        contacts_of_block(acting.pairs, laws, push, pairs, b)
        bonds_of_block(space.bonds, laws, push, space.frame.lattice_dd, b)
    wait(thread)
    if is_first(thread):
        push_faces(faces_of(acting.walls))
    # where bonds or walls alone turn particles, contacts leave no torques in slots
    spins = contact_axes(acting.shapes, acting.friction, axes)
    for b in range(blocks[0], blocks[1]):
        collect(axes, spins, pairs.slots, push, b)
        collect_bonds(space.bonds, axes, state.spins, push, b)


@lean
def take_steps(system, ledger, thread, span, rule):
    """Take up to `span.steps` steps; return how that ended and the steps taken.

    A step drifts, takes the forces, and kicks. `span.start` says where to begin. With a `Ledger`, observables of the
    steps that are due are written to it.
    """
    axes, state, links = system.axes, system.state, system.links
    split = split_of(rule)
    pace = Pace(split.late if span.start != FORCES else 0.0, rule.dt - split.late)
    row_b = system.pairs.row_b
    blocks = share(thread, row_b.shape[0] - 1)
    rows = row_b[blocks[0]], row_b[blocks[1]]
    start = span.start
    if start == FORCES:
        clear_rows(axes, state, rows[0], rows[1])
    for taken in range(span.steps):
        step = span.first + taken
        if start == WHOLE_STEP:
            status = kick_and_drift(system, thread, rows, step * rule.dt, rule, split)
            if status != RUNNING:
                return status, taken
        keep_springs(system.account, system, blocks)
        take_forces(system, thread, blocks, pace)
        if some_failed(thread):
            return NOT_FINITE, taken
        if start == FORCES:
            kicks = Kicks(0.0, split.early, True)
            book_kicks(system.account, system, thread, blocks, pace, kicks, step * rule.dt)
            return RUNNING, 0
        kicks = Kicks(split.late, split.early, False)
        book_kicks(system.account, system, thread, blocks, pace, kicks, (step + 1) * rule.dt)
        _finish_kick(axes, state, rows, split.late)
        if is_first(thread):
            finish_faces(faces_of(system.acting.walls), split.late)
        if rule.second_order:
            project_velocities(thread, links, axes, state.body, state.half)
        start = WHOLE_STEP
        if some_bond_breaks(limits_of(system.space.bonds), system, thread, blocks, pace):
            return BREAKING, taken + 1
        if is_due(ledger, step + 1):
            wait(thread)
            if is_first(thread):
                append_row(ledger, system, step + 1, pace, rule.dt)
            wait(thread)
    return RUNNING, span.steps


def run_steps(system: EngineSystem, ledger: Any, threads: int, span: Span, rule: Rule) -> tuple[int, int]:
    """Take steps as `take_steps` does, on so many threads; one thread in compiled code."""

    def run(thread: ThreadRecord | None) -> tuple[int, int]:
        own = system
        if thread is not None and system.space.flow is not None:
            # each thread has scratch arrays of its own
            own = system._replace(space=system.space._replace(flow=with_scratch(system.space.flow)))
        status, taken = take_steps(own, ledger, thread, span, rule)
        return int(status), int(taken)

    threads = min(threads, len(system.pairs.row_b) - 1)
    return run(None) if threads == 1 else run_together(run, threads)


@compiled_form(run_steps)
def _choose_run_steps(system: Any, ledger: Any, threads: Any, span: Any, rule: Any) -> Any:
    return lambda system, ledger, threads, span, rule: take_steps(system, ledger, None, span, rule)
