# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Frames of sheared packings: every packing of a batch is advanced by so many steps and observed, in one call.

A batch is a typed list of an engine's records; nothing of a frame returns to Python but for wrapping particles,
which is rare. Each packing is advanced by one thread, with the code that a batch of one runs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.typed import List

from packmech.dynamics.friction import Pace
from packmech.dynamics.observables import (
    COLUMNS,
    CONTACTS,
    FORCE,
    KINETIC,
    MOTION,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    SPINNING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TORQUE,
    measure,
)
from packmech.dynamics.pair_lists import search
from packmech.dynamics.time_step import REST_OF_STEP, SEARCH, WHOLE_STEP, Acting, take_steps
from packmech.effects import Friction
from packmech.jit.compiled import compiled_form, device, kernel
from packmech.minimize.kernels import NOT_FINITE, RUNNING
from packmech.observables import OBSERVABLES, component_names

# what a frame's strain is controlled by: the strain at its end, the rate, or the strain and the rate at its end
END_STRAIN, MEAN_RATE, END_STRAIN_AND_RATE = 0, 1, 2
# columns of the counts and of the numbers of each packing
STEPS, LEFT, SINCE, STATUS, GOOD, COUNTS = 0, 1, 2, 3, 4, 5
REACH, VOLUME, SHEARED, FASTEST, LAST_FORCE, LAST_STRAIN, HEIGHT, NUMBERS = 0, 1, 2, 3, 4, 5, 6, 7
# whether a particle left the cell is checked every so many steps, or whenever the box has sheared by so much
_WRAP_EVERY, _MOST_SHEARED = 1024, 0.2
# other lattice vectors may be better where the least height has become so much smaller
_FLATTER = 0.85
# what a call does: start a frame, go on with one that was left, or only observe
FRESH, AGAIN, OBSERVE = 0, 1, 2
# leading columns of figures; then the stress (3 numbers in a plane, 6 in space), and the others named in `figure_names`
FIGURE_TIME, FIGURE_STRAIN, FIGURE_RATE, FIGURE_STRESS = 0, 1, 2, 3


class Plan(NamedTuple):
    """What is the same for all packings of a batch, and one packing's counts, numbers, row of observables, and figures.

    axes is (0, 1) or (0, 1, 2); a and b are the axes of displacement and gradient. `switched`: the last number of what
    that control a packing is its coefficient of friction. good_nk holds its rows at the end of the last good frame.
    """

    axes: Any
    a: int
    b: int
    control: int
    switched: bool
    steps: int
    dt: float
    second_order: bool
    good_nk: Any
    count_k: Any
    number_k: Any
    row: Any
    figure_k: Any


def figure_names(dimension: int) -> tuple[str, ...]:
    """Return the names of the figures' columns.

    Examples
    --------
    >>> figure_names(2)[3:7]
    ('stress_xx', 'stress_yy', 'stress_xy', 'pressure')

    """
    size = OBSERVABLES["stress"].size_in(dimension)
    named = ("kinetic_energy", "elastic_energy", "work", "contacts", "sliding_fraction")
    return ("time", "strain", "rate", *component_names("stress", size, symmetric=True), "pressure", *named)


def with_friction(acting: Acting, coefficient: float) -> Acting:
    """Return what acts, with another coefficient of friction; the same where there is none."""
    raise NotImplementedError("frames are taken in compiled loops")


@compiled_form(with_friction)
def _choose_with_friction(acting: Any, coefficient: Any) -> Any:
    if isinstance(acting[2], types.NoneType):
        return lambda acting, coefficient: acting

    def another(acting, coefficient):
        old = acting.friction
        return Acting(acting.pairs, acting.bodies, Friction(coefficient, old.stiffness, old.damping))

    return another


@kernel
def put(batch, b, record):
    """Replace the record of a packing."""
    batch[b] = record


@kernel
def new_batch(record, count):
    """Return a batch of so many packings, all of this record until others are put there."""
    batch = List()
    for _ in range(count):
        batch.append(record)
    return batch


@kernel
def fetch(batch, b):
    """Return the record of a packing."""
    return batch[b]


@device
def _drive(number, control, begin, end, control_k):
    """Set the next piece of a path from where the last one ended; return the largest rate in it, at most."""
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
def _write_figures(plan):
    row, number_k, out = plan.row, plan.number_k, plan.figure_k
    d = len(plan.axes)
    volume = number_k[VOLUME]
    out[FIGURE_TIME], out[FIGURE_STRAIN], out[FIGURE_RATE] = row[TIME], row[STRAIN], row[RATE]
    k = FIGURE_STRESS
    trace = 0.0
    for a in range(d):
        stress = row[FORCE + 4 * a] / volume - row[SPINNING + 4 * a] / volume
        trace += stress
        out[k] = stress
        k += 1
    # yz, xz, xy; in a plane the last one
    for c in range(3 - d * (d - 1) // 2, 3):
        a, b = (c + 1) % 3, (c + 2) % 3
        torque = 0.5 * row[TORQUE + c] / volume
        out[k] = row[FORCE + 3 * a + b] / volume + torque - row[SPINNING + 3 * a + b] / volume
        k += 1
    out[k] = -trace / d
    out[k + 1] = row[KINETIC] + row[ROTATIONAL]
    out[k + 2] = row[POTENTIAL] + row[TANGENTIAL]
    # what the box shears against, the mean of both ends of the frame
    force = row[FORCE + 3 * plan.a + plan.b] - row[MOTION + 3 * plan.a + plan.b]
    out[k + 3] += 0.5 * (number_k[LAST_FORCE] + force) * (row[STRAIN] - number_k[LAST_STRAIN])
    out[k + 4] = row[CONTACTS]
    out[k + 5] = row[SLIDING] / max(row[CONTACTS], 1.0)
    number_k[LAST_FORCE] = force
    number_k[LAST_STRAIN] = row[STRAIN]


@device
def _is_finite(row):
    total = 0.0
    for k in range(row.shape[0]):
        total += abs(row[k])
    return total < math.inf


@device
def _put_back(state, plan, path):
    """Put places, velocities, strain and time back to the end of the last frame that was finished."""
    good_nk, count_k, row = plan.good_nk, plan.count_k, plan.row
    for i in range(good_nk.shape[0]):
        for a in range(good_nk.shape[1]):
            state.body[i, a] = good_nk[i, a]
    count_k[STEPS] = count_k[GOOD]
    count_k[LEFT] = 0
    path[0] = path[1] = row[TIME]
    path[2] = path[3] = row[STRAIN]
    path[4] = path[5] = row[RATE]


@device
def _is_outside(axes, body, frame, height):
    """Whether a particle is more than a cell away from the cell, or the cell so flat that others may be better."""
    d = len(axes)
    for a in range(d):
        if frame.height_d[a] < _FLATTER * height:
            return True
    for i in range(body.shape[0]):
        for a in range(d):
            fraction = 0.0
            for b in range(d):
                fraction += frame.inverse_dd[a, b] * body[i, b]
            if fraction < -1.0 or fraction >= 2.0:
                return True
    return False


@device
def _frame(batch, b, doing, control_k):
    """Take a frame of one packing, or what was left of it; return how it fares.

    That is RUNNING or how it failed, and whether its particles must be wrapped.
    """
    acting, state, space, pairs, track, plan = batch[b]
    count_k, number_k, row = plan.count_k, plan.number_k, plan.row
    if count_k[STATUS] != RUNNING:
        return count_k[STATUS], False
    path = space.flow.profile.number_k
    dt = plan.dt
    changed = False
    step = count_k[STEPS]
    if doing == FRESH:
        if plan.switched:
            acting = with_friction(acting, control_k[control_k.shape[0] - 1])
            changed = True
        fastest = _drive(path, plan.control, step * dt, (step + plan.steps) * dt, control_k)
        number_k[FASTEST] = fastest * dt
        count_k[LEFT] = plan.steps
    left = count_k[LEFT]
    status = RUNNING
    start = WHOLE_STEP
    outside = False
    while left > 0 and not outside:
        due = min(left, _WRAP_EVERY - count_k[SINCE])
        room = _MOST_SHEARED - number_k[SHEARED]
        if number_k[FASTEST] * due > room:
            due = max(1, int(room / number_k[FASTEST]))
        status, taken = take_steps(
            acting,
            plan.axes,
            state,
            None,
            space,
            pairs,
            track,
            None,
            None,
            start,
            step,
            due,
            dt,
            plan.second_order,
            number_k[REACH],
        )
        step += taken
        left -= taken
        count_k[SINCE] += taken
        number_k[SHEARED] += taken * number_k[FASTEST]
        start = WHOLE_STEP
        if status == SEARCH:
            pairs, track = search(plan.axes, state.body, space, pairs, track)
            changed = True
            start = REST_OF_STEP
            continue
        if status != RUNNING:
            break
        if count_k[SINCE] >= _WRAP_EVERY or number_k[SHEARED] >= _MOST_SHEARED * (1.0 - 1e-9):
            outside = _is_outside(plan.axes, state.body, space.frame, number_k[HEIGHT])
            count_k[SINCE] = 0
            number_k[SHEARED] = 0.0
    count_k[STEPS] = step
    count_k[LEFT] = left
    if status == RUNNING and left == 0:
        half = 0.5 * dt
        pace = Pace(half, half) if plan.second_order else Pace(0.0, dt)
        fresh = np.empty(COLUMNS)
        measure(acting, plan.axes, state, None, space, pairs, track, step * dt, pace, fresh)
        if _is_finite(fresh):
            row[:] = fresh
            _write_figures(plan)
            plan.good_nk[:] = state.body
            count_k[GOOD] = step
        else:
            status = NOT_FINITE
    if changed:
        batch[b] = (acting, state, space, pairs, track, plan)
    if status != RUNNING:
        _put_back(state, plan, path)
        count_k[STATUS] = status
        return status, False
    return status, outside


@kernel
def not_finite(control_bk, active_b):
    """Return the first active packing that is given a number that is not finite; -1: none."""
    for b in range(control_bk.shape[0]):
        if active_b[b]:
            for k in range(control_bk.shape[1]):
                if not math.isfinite(control_bk[b, k]):
                    return b
    return -1


@kernel
def frames(batch, doing, low, high, active_b, control_bk, wrap_b, good_b):
    """Take frames of the active packings from low to high; return how many must be wrapped.

    Those are marked in home_b; of a frame that they cut short LEFT steps are left. A packing that moved too fast in a
    step is put back to where its last frame ended, and so is its count; its STATUS is not RUNNING, it is marked in
    good_b and it moves no more. Where packing b is given a number that is not finite, nothing moves: -1 - b.
    """
    if doing == FRESH:
        bad = not_finite(control_bk, active_b)
        if bad >= 0:
            return -1 - bad
    count = 0
    for b in range(low, high):
        if active_b[b]:
            status, outside = _frame(batch, b, doing, control_bk[b])
            wrap_b[b] = outside
            count += outside
            good_b[b] = status == RUNNING
    return count
