# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Many small packings strained, relaxed and looked at in one compiled call.

A slot is a packing's tuple (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf), the arrays of its
program and of its minimizer. Slots stand in a typed list; no two of them share an array, so that threads may each
advance some of them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.typed import List

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.damped import _Damped, damped_steps
from packmech.dynamics.fire import fire_steps
from packmech.dynamics.joints import has_links
from packmech.dynamics.kernels import NOT_FINITE, RUNNING, Goal, evaluate
from packmech.dynamics.pair_list import SKIN_OUTER, TRAVEL
from packmech.dynamics.stepwise.quench_strain import is_identity, lattice_volume, refreshed, set_frame, strain_slot

# places in a row of figures
(
    FRACTION, ENERGY, PRESSURE, MAX_FORCE, MEAN_FORCE, CONTACTS, RATTLERS, EXCESS, STEPS, EVALUATIONS, STATUS, OUTSIDE,
    STRAIN, FIGURES,
) = range(14)  # fmt: skip

# places in a minimizer's numbers, the same for every minimizer
_STEP, _EVALUATIONS = 0, 1
# a lattice vector this much longer than the distance between its faces asks for a shorter one
_SKEW = 2.5


class Orders(NamedTuple):
    """What is the same for all slots of a call: how they are strained and relaxed.

    steps of the minimizer, none if negative; anew: it starts anew in every call; cap on a particle's displacement in a
    step [length]; low and high packing fraction.
    """

    steps: int
    anew: bool
    force_tolerance: float
    force_floor: float
    cap: float
    low: float
    high: float


@kernel
def new_slots(slot):
    """Return a list that holds the slot."""
    slots = List()
    slots.append(slot)
    return slots


@kernel
def put_slot(slots, b, slot):
    """Put the slot at its place in the list, or at the end."""
    if b == len(slots):
        slots.append(slot)
    else:
        slots[b] = slot


def minimize(
    effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any, space: Any, pairs: Any, settings: Any,
    goal: Any, cap: Any, number: Any, vector_kf: Any, steps: Any,
) -> Any:  # fmt: skip
    """Take steps of the minimizer that the settings are of; return how they ended and the pair list."""
    raise NotImplementedError("minimizers take their steps in compiled loops")


@compiled_form(minimize)
def _choose_minimizer(
    effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any, space: Any, pairs: Any, settings: Any,
    goal: Any, cap: Any, number: Any, vector_kf: Any, steps: Any,
) -> Any:  # fmt: skip
    def damped(effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, cap, number, vector_kf, steps):
        return damped_steps(
            effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, cap, number, vector_kf, steps
        )

    def fire(effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, cap, number, vector_kf, steps):
        return fire_steps(
            effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, cap, number, vector_kf, steps
        )

    return damped if settings.instance_class is _Damped else fire


@device
def _count_touching(axes, row, pairs, bodies, recount):
    """Count touching pairs between clusters that are not loose, at their clusters if asked to; return their number."""
    number = 0
    within = pairs.count_b[0]
    touching = bodies.touching_c
    if recount:
        for c in range(touching.shape[0]):
            touching[c] = 0
    for p in range(within + pairs.count_b[1]):
        sx = sy = sz = 0.0
        if p < within:
            i = pairs.i_p[p]
            j = pairs.j_p[p]
        else:
            i = pairs.crossing_i_p[p - within]
            j = pairs.crossing_j_p[p - within]
            k = pairs.crossing_k_p[p - within]
            sx, sy, sz = pairs.shift_kd[k, 0], pairs.shift_kd[k, 1], pairs.shift_kd[k, 2]
        one = bodies.cluster_n[i]
        other = bodies.cluster_n[j]
        if bodies.loose_c[one] or bodies.loose_c[other]:
            continue
        dx = row[j, 0] - row[i, 0] + sx
        dy = row[j, 1] - row[i, 1] + sy
        dz = row[j, 2] - row[i, 2] + sz
        sigma = row[i, 3] + row[j, 3]
        if dx * dx + dy * dy + dz * dz < sigma * sigma:
            number += 1
            touching[one] += recount
            touching[other] += recount
    return number


@device
def _count(axes, row, pairs, bodies, figure_k):
    """Set rattlers and excess contacts: what has fewer than d + 1 contacts cannot be held, and is taken out."""
    d = len(axes)
    loose = bodies.loose_c
    for c in range(loose.shape[0]):
        loose[c] = False
    number = _count_touching(axes, row, pairs, bodies, True)
    again = True
    while again:
        again = False
        for c in range(loose.shape[0]):
            if not loose[c] and bodies.touching_c[c] <= d:
                loose[c] = True
                again = True
        if again:
            number = _count_touching(axes, row, pairs, bodies, True)
    freedom = 0
    for c in range(loose.shape[0]):
        if not loose[c]:
            freedom += bodies.freedom_c[c]
    rattlers = 0
    for i in range(row.shape[0]):
        rattlers += loose[bodies.cluster_n[i]]
    figure_k[RATTLERS] = rattlers
    figure_k[EXCESS] = number - (freedom - d + 1) if freedom else 0


def add_tensions(joints: Any, bodies: Any, axes: Any, row: Any, lattice_dd: Any, virial_dd: Any) -> None:
    """Add the links' part of V times the stress."""
    raise NotImplementedError("stresses are added up in compiled loops")


@compiled_form(add_tensions)
def _choose_tensions(joints: Any, bodies: Any, axes: Any, row: Any, lattice_dd: Any, virial_dd: Any) -> Any:
    def with_links(joints, bodies, axes, row, lattice_dd, virial_dd):
        v = np.zeros(3)
        for k in range(bodies.i_l.shape[0]):
            i, j = bodies.i_l[k], bodies.j_l[k]
            square = 0.0
            for a in range(len(axes)):
                v[a] = row[j, a] - row[i, a]
                for b in range(len(axes)):
                    v[a] += lattice_dd[a, b] * bodies.image_ld[k, b]
                square += v[a] * v[a]
            for a in range(len(axes)):
                for b in range(len(axes)):
                    virial_dd[a, b] += joints.multiplier_l[k] / math.sqrt(square) * v[a] * v[b]

    def without(joints, bodies, axes, row, lattice_dd, virial_dd):
        pass

    return with_links if has_links(joints) else without


@device
def _look(effects, axes, slot, figure_k, stress_dd):
    """Write the figures of a slot; return its pair list."""
    row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = slot
    d = len(axes)
    frame = space.frame
    sums, totals, pairs = evaluate(effects, axes, row, force_nd, velocity_nd, space, pairs)
    virial = totals.virial_dd
    add_tensions(space.joints, bodies, axes, row, frame.lattice_dd, virial)
    volume = lattice_volume(frame.lattice_dd)
    trace = 0.0
    for a in range(d):
        trace += virial[a, a] / volume
        for b in range(d):
            stress_dd[a, b] = virial[a, b] / volume
    figure_k[FRACTION] = bodies.volume / volume
    figure_k[ENERGY] = totals.energy
    figure_k[PRESSURE] = (0.0 - trace) / d
    figure_k[MAX_FORCE] = math.sqrt(sums.most)
    figure_k[MEAN_FORCE] = sums.total / sums.touching if sums.touching else 0.0
    figure_k[CONTACTS] = sums.touching
    _count(axes, row, pairs, bodies, figure_k)
    outside = False
    for i in range(row.shape[0]):
        for a in range(d):
            part = 0.0
            for b in range(d):
                part += frame.inverse_dd[a, b] * row[i, b]
            outside = outside or part < -1.0 or part >= 2.0
    for a in range(d):
        square = 0.0
        for b in range(d):
            square += frame.lattice_dd[b, a] ** 2
        outside = outside or math.sqrt(square) > _SKEW * frame.height_d[a]
    figure_k[OUTSIDE] = outside
    return pairs


@kernel
def advance_slots(
    slots, index_k, low, high, effects, axes, settings, orders, start_k, change_b, strain_b, figure_bk, stress_bdd
):
    """Strain and relax the slots index_k[low:high], and write their figures.

    change_b is of the packing fraction, strain_b a simple shear along the first axis with gradient along the second.
    What ends without finite forces, or with lost links, is put back to where it was before.
    """
    d = len(axes)
    for q in range(low, high):
        b = index_k[q]
        row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = slots[b]
        figure = figure_bk[b]
        stress = stress_bdd[b]
        for i in range(row.shape[0]):
            for a in range(d):
                bodies.last_nd[i, a] = row[i, a]
        for a in range(3):
            for k in range(3):
                bodies.last_dd[a, k] = space.frame.lattice_dd[a, k]
        fraction = bodies.volume / lattice_volume(space.frame.lattice_dd)
        goal_fraction = min(max(fraction + change_b[b], orders.low), orders.high)
        scale = 1.0
        if change_b[b] != 0.0:
            scale = (fraction / goal_fraction) ** (1.0 / d)
        map_dd = np.eye(3)
        for a in range(d):
            map_dd[a, a] = scale
        map_dd[0, 1] = scale * strain_b[b]
        strained = not is_identity(map_dd)
        if strained:
            space = strain_slot(axes, row, space, pairs, bodies, map_dd)
        ended = figure[STATUS] != RUNNING
        if orders.anew or (ended and strained):
            for k in range(number.shape[0]):
                number[k] = start_k[k]
            for i in range(row.shape[0]):
                for a in range(d):
                    velocity_nd[i, a] = 0.0
        figure[STEPS] = 0.0
        figure[EVALUATIONS] = 1.0
        figure[STATUS] = RUNNING
        put_back = False
        if orders.steps >= 0:
            steps = number[_STEP]
            evaluations = number[_EVALUATIONS]
            goal = Goal(orders.force_tolerance, orders.force_floor)
            status, pairs = minimize(
                effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, orders.cap, number,
                vector_kf, orders.steps,
            )  # fmt: skip
            figure[STEPS] = number[_STEP] - steps
            figure[EVALUATIONS] += number[_EVALUATIONS] - evaluations
            figure[STATUS] = status
        while True:
            slot = (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
            pairs = _look(effects, axes, slot, figure, stress)
            sound = figure[MAX_FORCE] < np.inf and figure[MEAN_FORCE] < np.inf and abs(figure[ENERGY]) < np.inf
            if put_back or (sound and figure[STATUS] != NOT_FINITE):
                break
            for i in range(row.shape[0]):
                for a in range(d):
                    row[i, a] = bodies.last_nd[i, a]
                    velocity_nd[i, a] = 0.0
            set_frame(space.frame, bodies.last_dd)
            space = refreshed(axes, row, space)
            pairs.number[SKIN_OUTER] = -1.0
            pairs.number[TRAVEL] = np.inf
            put_back = True
        if put_back:
            figure[STATUS] = NOT_FINITE
        else:
            figure[STRAIN] += strain_b[b]
        slots[b] = (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
