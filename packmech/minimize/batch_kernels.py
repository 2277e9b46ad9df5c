# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Many small packings strained, relaxed and measured in one compiled call.

A packing is a tuple (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf), the arrays of its program
and of its minimizer. The packings of a batch stand in a typed list; no two of them share an array, so that threads may
each advance some of them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.typed import List
from numpy.typing import NDArray

from packmech.constraints.compiled_links import has_links
from packmech.contacts.cells import Frame
from packmech.jit.compiled import compiled_form, device, kernel
from packmech.minimize.first_order.damped import _Damped, damped_steps
from packmech.minimize.first_order.fire import fire_steps
from packmech.minimize.passes.kernels import NOT_FINITE, RUNNING, Goal, Space, evaluate
from packmech.minimize.passes.pair_list import DISPLACED, SKIN_OUTER
from packmech.minimize.passes.shape_rows import shape_touch, spin_of, touches

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
    it, and winding_n whether it winds around the box. i_l, j_l and image_ld are the links. volume is that of the
    particles. Then working space: the rows and the lattice before a step, centers of clusters, their numbers of
    contacts, and whether they are rattlers. Last the shapes of rows; None for discs and spheres.
    """

    cluster_n: NDArray[np.int64]
    freedom_c: NDArray[np.int64]
    offset_nd: NDArray[np.float64]
    winding_n: NDArray[np.bool_]
    i_l: NDArray[np.int64]
    j_l: NDArray[np.int64]
    image_ld: NDArray[np.float64]
    volume: float
    last_nd: NDArray[np.float64]
    last_dd: NDArray[np.float64]
    center_cd: NDArray[np.float64]
    contacts_c: NDArray[np.int64]
    rattler_c: NDArray[np.bool_]
    shapes: Any = None


def with_shapes(effects: Any, shapes: Any) -> Any:
    """Return the effects with a packing's own shapes among them; as they are without."""
    return effects if shapes is None else (*effects, shapes)


@compiled_form(with_shapes)
def _choose_with_shapes(effects: Any, shapes: Any) -> Any:
    if isinstance(shapes, types.NoneType):
        return lambda effects, shapes: effects
    return lambda effects, shapes: effects + (shapes,)  # noqa: RUF005


@kernel
def spins_of_rows(shapes, row, velocity_nd):
    """Return the (N, 3) angular velocities of rigid bodies in space, whose rows hold rotations."""
    n = shapes.radius_n.shape[0]
    spin = np.empty((n, 3))
    for i in range(n):
        spin[i, 0], spin[i, 1], spin[i, 2] = spin_of(shapes, row, velocity_nd, i)
    return spin


@device
def set_frame(frame, lattice_dd):
    """Write the lattice, its inverse and the distances between faces into the frame."""
    a = lattice_dd
    inverse = frame.inverse_dd
    for i in range(3):
        for j in range(3):
            frame.lattice_dd[i, j] = a[i, j]
            p, q = (j + 1) % 3, (j + 2) % 3
            r, s = (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    for i in range(3):
        square = 0.0
        for j in range(3):
            inverse[i, j] /= determinant
            square += inverse[i, j] * inverse[i, j]
        frame.height_d[i] = 1.0 / math.sqrt(square)


@device
def lattice_volume(lattice_dd):
    """Return the volume of a cell."""
    a = lattice_dd
    return abs(
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


@device
def _largest(axes, row, lattice_dd):
    """Return the largest coordinate of a row or a lattice vector."""
    largest = 0.0
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            largest = max(largest, abs(row[i, a]))
    for a in range(len(axes)):
        for b in range(len(axes)):
            largest = max(largest, abs(lattice_dd[a, b]))
    return largest


@device
def _map_rows(axes, row, bodies, old_dd, new_dd, map_dd):
    """Strain particles, or the centers of clusters, with the box; a cluster that winds around it is strained itself.

    Shapes keep their directions.
    """
    d = len(axes)
    n = bodies.cluster_n.shape[0]
    moved = np.empty(3)
    if bodies.freedom_c.shape[0] == n:
        for i in range(n):
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    moved[a] += map_dd[a, b] * row[i, b]
            for a in range(d):
                row[i, a] = moved[a]
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
                row[i, a] -= new_dd[a, b] * bodies.offset_nd[i, b]


@device
def strain_packing(axes, row, space, pairs, bodies, map_dd):
    """Strain the box and what is in it; return the new space. The pair list is kept as far as it is still complete."""
    d = len(axes)
    frame = space.frame
    new = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for k in range(3):
                new[a, b] += map_dd[a, k] * frame.lattice_dd[k, b]
    _map_rows(axes, row, bodies, frame.lattice_dd, new, map_dd)
    set_frame(frame, new)
    # no distance shrinks by more than the norm of the strain times itself
    strain2 = 0.0
    for a in range(d):
        for b in range(d):
            strain2 += (map_dd[a, b] - (1.0 if a == b else 0.0)) ** 2
    shrink = max(0.0, 1.0 - math.sqrt(strain2))
    moved = np.empty(3)
    anchor = pairs.outer_anchor_nd
    for i in range(anchor.shape[0]):
        for a in range(d):
            moved[a] = 0.0
            for b in range(d):
                moved[a] += map_dd[a, b] * anchor[i, b]
        for a in range(d):
            anchor[i, a] = moved[a]
    widest = 0.0
    for a in range(space.sizes.largest_a.shape[0]):
        widest = max(widest, space.sizes.largest_a[a])
    pairs.number[SKIN_OUTER] = shrink * pairs.number[SKIN_OUTER] - (1.0 - shrink) * 4.0 * widest
    pairs.number[DISPLACED] = np.inf
    return refreshed(axes, row, space)


@device
def refreshed(axes, row, space):
    """Return the space with the rounding of the positions as they are."""
    resolution = 2.220446049250313e-16 * _largest(axes, row, space.frame.lattice_dd)
    return Space(space.sizes, Frame(space.frame.lattice_dd, space.frame.inverse_dd, space.frame.height_d),
                 resolution, space.links)  # fmt: skip


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
    def damped(effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps):
        return damped_steps(
            effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps
        )

    def fire(effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps):
        return fire_steps(
            effects, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, cap, number, vector_kf, steps
        )

    return damped if numbers.instance_class is _Damped else fire


def _touching(shapes: Any, row: Any, i: int, j: int, dx: float, dy: float, dz: float) -> int:
    """Return in how many places two rows touch."""
    raise NotImplementedError("contacts are counted in compiled loops")


@compiled_form(_touching)
def _choose_touching(shapes: Any, row: Any, i: Any, j: Any, dx: Any, dy: Any, dz: Any) -> Any:
    def round_ones(shapes, row, i, j, dx, dy, dz):
        sigma = row[i, 3] + row[j, 3]
        return 1 if dx * dx + dy * dy + dz * dz < sigma * sigma else 0

    def others(shapes, row, i, j, dx, dy, dz):
        sigma = row[i, 3] + row[j, 3]
        square = dx * dx + dy * dy + dz * dz
        if square >= sigma * sigma:
            return 0
        if square == 0.0:
            dx = 1e-9 * sigma
        number = 0
        for k in range(touches(shapes, i, j)):
            if shape_touch(shapes, i, j, k, dx, dy, dz, shapes.dimension).touching:
                number += 1
        return number

    return round_ones if isinstance(shapes, types.NoneType) else others


@device
def _count_contacts(row, pairs, bodies):
    """Count the contacts between bodies that are no rattlers, of each body and in all; return their number."""
    number = 0
    within = pairs.count_b[0]
    contacts_c = bodies.contacts_c
    for c in range(contacts_c.shape[0]):
        contacts_c[c] = 0
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
        if bodies.rattler_c[one] or bodies.rattler_c[other]:
            continue
        dx = row[j, 0] - row[i, 0] + sx
        dy = row[j, 1] - row[i, 1] + sy
        dz = row[j, 2] - row[i, 2] + sz
        here = _touching(bodies.shapes, row, i, j, dx, dy, dz)
        number += here
        contacts_c[one] += here
        contacts_c[other] += here
    return number


@device
def _count(axes, row, pairs, bodies, figure_k):
    """Set rattlers and excess contacts: bodies with fewer than d + 1 contacts are removed until there are none."""
    d = len(axes)
    rattler = bodies.rattler_c
    for c in range(rattler.shape[0]):
        rattler[c] = False
    number = _count_contacts(row, pairs, bodies)
    removed = True
    while removed:
        removed = False
        for c in range(rattler.shape[0]):
            if not rattler[c] and bodies.contacts_c[c] <= d:
                rattler[c] = True
                removed = True
        if removed:
            number = _count_contacts(row, pairs, bodies)
    freedom = 0
    for c in range(rattler.shape[0]):
        if not rattler[c]:
            freedom += bodies.freedom_c[c]
    rattlers = 0
    for i in range(bodies.cluster_n.shape[0]):
        rattlers += rattler[bodies.cluster_n[i]]
    figure_k[RATTLERS] = rattlers
    figure_k[EXCESS] = number - (freedom - d + 1) if freedom else 0


def add_tensions(links: Any, bodies: Any, axes: Any, row: Any, lattice_dd: Any, virial_dd: Any) -> None:
    """Add the links' part of V times the stress."""
    raise NotImplementedError("stresses are added up in compiled loops")


@compiled_form(add_tensions)
def _choose_tensions(links: Any, bodies: Any, axes: Any, row: Any, lattice_dd: Any, virial_dd: Any) -> Any:
    def with_links(links, bodies, axes, row, lattice_dd, virial_dd):
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
                    virial_dd[a, b] += links.multiplier_l[k] / math.sqrt(square) * v[a] * v[b]

    def without(links, bodies, axes, row, lattice_dd, virial_dd):
        pass

    return with_links if has_links(links) else without


@device
def _measure(effects, axes, packing, figure_k, stress_dd):
    """Write the figures of a packing whose effects these are; return its pair list."""
    row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = packing
    d = len(axes)
    frame = space.frame
    sums, totals, pairs = evaluate(effects, axes, row, force_nd, velocity_nd, space, pairs)
    virial = totals.virial_dd
    add_tensions(space.links, bodies, axes, row, frame.lattice_dd, virial)
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
    _count(axes, row, pairs, bodies, figure_k)
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
    packings, index_k, low, high, effects, axes, numbers, settings, start_k, change_b, strain_b, figure_bk, stress_bdd
):
    """Strain and relax the packings index_k[low:high], and write their figures.

    change_b is of the packing fraction, strain_b a simple shear along the first axis with gradient along the second.
    One that ends without finite forces, or whose links were lost, is put back to where it was before.
    """
    d = len(axes)
    for q in range(low, high):
        b = index_k[q]
        row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf = packings[b]
        acting = with_shapes(effects, bodies.shapes)
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
            space = strain_packing(axes, row, space, pairs, bodies, map_dd)
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
                acting, axes, row, force_nd, velocity_nd, space, pairs, numbers, goal, settings.cap, number,
                vector_kf, settings.steps,
            )  # fmt: skip
            figure[STEPS] = number[_STEP] - steps
            figure[EVALUATIONS] += number[_EVALUATIONS] - evaluations
            figure[STATUS] = status
        while True:
            packing = (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
            pairs = _measure(acting, axes, packing, figure, stress)
            finite = figure[MAX_FORCE] < np.inf and figure[MEAN_FORCE] < np.inf and abs(figure[ENERGY]) < np.inf
            if undone or (finite and figure[STATUS] != NOT_FINITE):
                break
            for i in range(row.shape[0]):
                for a in range(d):
                    row[i, a] = bodies.last_nd[i, a]
                    velocity_nd[i, a] = 0.0
            set_frame(space.frame, bodies.last_dd)
            space = refreshed(axes, row, space)
            pairs.number[SKIN_OUTER] = -1.0
            pairs.number[DISPLACED] = np.inf
            undone = True
        if undone:
            figure[STATUS] = NOT_FINITE
        else:
            figure[STRAIN] += strain_b[b]
        packings[b] = (row, force_nd, velocity_nd, space, pairs, bodies, number, vector_kf)
