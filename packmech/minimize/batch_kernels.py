# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Many small packings strained, relaxed and measured in one compiled call.

A packing is a tuple (effects, row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf), what its program
and its minimizer are made of. The packings of a batch stand in a typed list; no two of them share an array, so that
threads may each advance some of them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.typed import List
from numpy.typing import NDArray

from packmech.contacts.cells import lattice_volume, set_frame
from packmech.jit.compiled import compiled_form, device, inlined, kernel
from packmech.minimize.first_order.damped import _Damped, damped_steps
from packmech.minimize.first_order.fire import fire_steps
from packmech.minimize.passes.kernels import NOT_FINITE, RUNNING, Goal, contacts_of, evaluate
from packmech.minimize.passes.pair_list import DISPLACED, SKIN_OUTER, visit, walk_blocks
from packmech.minimize.passes.shape_rows import RowLaws, shapes_of, spin_of
from packmech.minimize.passes.strains import map_rows, set_resolution, strain_space

# columns of the figures of a packing
(
    FRACTION, ENERGY, PRESSURE, MAX_FORCE, MEAN_FORCE, CONTACTS, RATTLERS, EXCESS, STEPS, EVALUATIONS, STATUS, OUTSIDE,
    STRAIN, FIGURES,
) = range(14)  # fmt: skip

# places in a minimizer's numbers, the same for every minimizer
_STEP, _EVALUATIONS = 0, 1
# a lattice vector this much longer than the distance between its faces asks for a shorter one
_SKEW = 2.5


class Settings(NamedTuple):
    """How all packings of a call are strained and relaxed.

    steps of the minimizer, none if negative; restart: whether it starts again in every call; cap on a particle's
    displacement in a step [length]; low and high packing fraction.
    """

    steps: int
    restart: bool
    force_tolerance: float
    force_floor: float
    cap: float
    low: float
    high: float


class Bodies(NamedTuple):
    """The bodies of a packing, which are strained as one and counted as one: clusters of linked rows, or single rows.

    cluster_n is the number of each row's cluster, freedom_c its degrees of freedom, offset_nd the images that unwrap
    it, and winding_n whether it winds around the box. volume is that of the particles. Then working space: the rows and
    the lattice before a step, centers of clusters, their numbers of contacts, and whether they are rattlers.
    """

    cluster_n: NDArray[np.int64]
    freedom_c: NDArray[np.int64]
    offset_nd: NDArray[np.float64]
    winding_n: NDArray[np.bool_]
    volume: float
    last_nd: NDArray[np.float64]
    last_dd: NDArray[np.float64]
    center_cd: NDArray[np.float64]
    contacts_c: NDArray[np.int64]
    rattler_c: NDArray[np.bool_]


@kernel
def spins_of_rows(shapes, row, velocity_nd):
    """Return the (N, 3) angular velocities of rigid bodies in space, whose rows hold rotations."""
    n = shapes.radius_n.shape[0]
    spin = np.empty((n, 3))
    for i in range(n):
        spin[i, 0], spin[i, 1], spin[i, 2] = spin_of(shapes, row, velocity_nd, i)
    return spin


@device
def _strain_bodies(axes, row, bodies, old_dd, map_dd):
    """Strain particles, or the centers of clusters, with the box; a cluster that winds around it is strained itself.

    Shapes keep their directions.
    """
    d = len(axes)
    n = bodies.cluster_n.shape[0]
    moved = np.empty(3)
    if bodies.freedom_c.shape[0] == n:
        map_rows(axes, row, n, map_dd)
        return
    center = bodies.center_cd
    count = bodies.contacts_c
    for c in range(center.shape[0]):
        count[c] = 0
        for a in range(3):
            center[c, a] = 0.0
    for i in range(n):
        c = bodies.cluster_n[i]
        count[c] += 1
        for a in range(d):
            for b in range(d):
                row[i, a] += old_dd[a, b] * bodies.offset_nd[i, b]
            center[c, a] += row[i, a]
    for i in range(n):
        c = bodies.cluster_n[i]
        for a in range(d):
            moved[a] = row[i, a]
            for b in range(d):
                strained = row[i, b] if bodies.winding_n[i] else center[c, b] / count[c]
                moved[a] += (map_dd[a, b] - (1.0 if a == b else 0.0)) * strained
        for a in range(d):
            row[i, a] = moved[a]
            for b in range(d):
                for k in range(d):
                    row[i, a] -= map_dd[a, k] * old_dd[k, b] * bodies.offset_nd[i, b]


@device
def is_identity(map_dd):
    """Whether a map moves nothing."""
    for a in range(3):
        for b in range(3):
            if map_dd[a, b] != (1.0 if a == b else 0.0):
                return False
    return True


@kernel
def new_list(packing):
    """Return a list that holds the packing."""
    packings = List()
    packings.append(packing)
    return packings


@kernel
def put(packings, b, packing):
    """Put the packing at its place in the list, or at the end."""
    if b == len(packings):
        packings.append(packing)
    else:
        packings[b] = packing


def minimize(
    effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any, space: Any, pairs: Any, numbers: Any,
    goal: Any, cap: Any, number: Any, vector_kf: Any, steps: Any,
) -> Any:  # fmt: skip
    """Take steps of the minimizer that the numbers belong to; return how they ended and the pair list."""
    raise NotImplementedError("minimizers take their steps in compiled loops")


@compiled_form(minimize)
def _choose_minimizer(
    effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any, space: Any, pairs: Any, numbers: Any,
    goal: Any, cap: Any, number: Any, vector_kf: Any, steps: Any,
) -> Any:  # fmt: skip
    own = damped_steps if numbers.instance_class is _Damped else fire_steps

    def take(effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps):
        return own(
            effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps
        )

    return take


class _Counting(NamedTuple):
    """The visitor that counts contacts between bodies that are no rattlers."""

    cluster_n: NDArray[np.int64]
    rattler_c: NDArray[np.bool_]
    contacts_c: NDArray[np.int64]


@visit.form(_Counting)
@inlined
def _count_listed(counting, laws, pair, number):
    one, other = counting.cluster_n[pair.i], counting.cluster_n[pair.j]
    if not (counting.rattler_c[one] or counting.rattler_c[other]):
        here = contacts_of(laws, pair)
        number += here
        counting.contacts_c[one] += here
        counting.contacts_c[other] += here
    return number


@device
def _count_contacts(effects, row, pairs, bodies):
    """Count the contacts between bodies that are no rattlers, of each body and in all; return their number."""
    contacts_c = bodies.contacts_c
    for c in range(contacts_c.shape[0]):
        contacts_c[c] = 0
    counting = _Counting(bodies.cluster_n, bodies.rattler_c, contacts_c)
    laws = RowLaws(effects, shapes_of(effects), (0, 1, 2), row)
    return walk_blocks(counting, laws, pairs, 0)


@device
def _count(effects, axes, row, pairs, bodies, figure_k):
    """Set rattlers and excess contacts: bodies with fewer than d + 1 contacts are removed until there are none."""
    d = len(axes)
    rattler = bodies.rattler_c
    for c in range(rattler.shape[0]):
        rattler[c] = False
    number = _count_contacts(effects, row, pairs, bodies)
    removed = True
    while removed:
        removed = False
        for c in range(rattler.shape[0]):
            if not rattler[c] and bodies.contacts_c[c] <= d:
                rattler[c] = True
                removed = True
        if removed:
            number = _count_contacts(effects, row, pairs, bodies)
    freedom = 0
    for c in range(rattler.shape[0]):
        if not rattler[c]:
            freedom += bodies.freedom_c[c]
    rattlers = 0
    for i in range(bodies.cluster_n.shape[0]):
        rattlers += rattler[bodies.cluster_n[i]]
    figure_k[RATTLERS] = rattlers
    figure_k[EXCESS] = number - (freedom - d + 1) if freedom else 0


@device
def _measure(axes, packing, figure_k, stress_dd):
    """Write the figures of a packing; return its pair list."""
    effects, row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = packing
    d = len(axes)
    frame = space.frame
    sums, totals, pairs = evaluate(effects, axes, row, force_nd, velocity_nd, space, pairs)
    virial = totals.virial_dd
    volume = lattice_volume(frame.lattice_dd)
    trace = 0.0
    for a in range(d):
        trace += virial[a, a] / volume
        for b in range(d):
            stress_dd[a, b] = virial[a, b] / volume
    figure_k[FRACTION] = bodies.volume / volume
    figure_k[ENERGY] = totals.energy
    figure_k[PRESSURE] = (0.0 - trace) / d
    figure_k[MAX_FORCE] = math.sqrt(sums.largest)
    figure_k[MEAN_FORCE] = sums.total / sums.touching if sums.touching else 0.0
    figure_k[CONTACTS] = sums.touching
    _count(effects, axes, row, pairs, bodies, figure_k)
    outside = False
    for i in range(bodies.cluster_n.shape[0]):
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
def advance_packings(
    packings, index_k, low, high, axes, numbers, settings, start_k, change_b, strain_b, figure_bk, stress_bdd
):
    """Strain and relax the packings index_k[low:high], and write their figures.

    change_b is of the packing fraction, strain_b a simple shear along the first axis with gradient along the second.
    One that ends without finite forces, or whose links were lost, is put back to where it was before.
    """
    d = len(axes)
    for q in range(low, high):
        b = index_k[q]
        effects, row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = packings[b]
        figure = figure_bk[b]
        stress = stress_bdd[b]
        for i in range(row.shape[0]):
            for a in range(d):
                bodies.last_nd[i, a] = row[i, a]
        for a in range(3):
            for k in range(3):
                bodies.last_dd[a, k] = space.frame.lattice_dd[a, k]
        fraction = bodies.volume / lattice_volume(space.frame.lattice_dd)
        goal_fraction = min(max(fraction + change_b[b], settings.low), settings.high)
        scale = 1.0
        if change_b[b] != 0.0:
            scale = (fraction / goal_fraction) ** (1.0 / d)
        map_dd = np.eye(3)
        for a in range(d):
            map_dd[a, a] = scale
        map_dd[0, 1] = scale * strain_b[b]
        strained = not is_identity(map_dd)
        if strained:
            _strain_bodies(axes, row, bodies, space.frame.lattice_dd, map_dd)
            strain_space(axes, row, space, pairs, map_dd)
        ended = figure[STATUS] != RUNNING
        if settings.restart or (ended and strained):
            for k in range(number.shape[0]):
                number[k] = start_k[k]
            for i in range(row.shape[0]):
                for a in range(d):
                    velocity_nd[i, a] = 0.0
        figure[STEPS] = 0.0
        figure[EVALUATIONS] = 1.0
        figure[STATUS] = RUNNING
        undone = False
        if settings.steps >= 0:
            steps = number[_STEP]
            evaluations = number[_EVALUATIONS]
            goal = Goal(settings.force_tolerance, settings.force_floor)
            status, pairs = minimize(
                effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, settings.cap, number,
                vector_kf, settings.steps,
            )  # fmt: skip
            figure[STEPS] = number[_STEP] - steps
            figure[EVALUATIONS] += number[_EVALUATIONS] - evaluations
            figure[STATUS] = status
        while True:
            packing = (effects, row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
            pairs = _measure(axes, packing, figure, stress)
            finite = figure[MAX_FORCE] < np.inf and figure[MEAN_FORCE] < np.inf and abs(figure[ENERGY]) < np.inf
            if undone or (finite and figure[STATUS] != NOT_FINITE):
                break
            for i in range(row.shape[0]):
                for a in range(d):
                    row[i, a] = bodies.last_nd[i, a]
                    velocity_nd[i, a] = 0.0
            set_frame(space.frame, bodies.last_dd)
            set_resolution(axes, row, space)
            pairs.number[SKIN_OUTER] = -1.0
            pairs.number[DISPLACED] = np.inf
            undone = True
        if undone:
            figure[STATUS] = NOT_FINITE
        else:
            figure[STRAIN] += strain_b[b]
        packings[b] = (effects, row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
