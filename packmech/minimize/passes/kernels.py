# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The compiled passes over pairs and particles that every minimizer is made of.

A row holds x, y, z, radius, fx, fy, fz and a stiffness: one cache line a particle (z = 0 in two dimensions). Passes
take the scene's tuple of effects and walk it with `literal_unroll`, so that code for an absent effect does not exist,
and a tuple `axes` as long as the dimension, so that a plane does not pay for the third axis.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.constraints.compiled_links import add_tensions, project_forces, project_rows, refresh
from packmech.effects import pair_energy, pair_first, pair_second
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, inner_kernel, inner_lean, kernel
from packmech.jit.threads import share, some_failed, wait
from packmech.minimize.passes.interaction_rows import push_interactions, survey_interactions
from packmech.minimize.passes.kind_rows import partners_of_rows
from packmech.minimize.passes.pair_list import (
    NO_SLOT,
    collect,
    first_pair_of,
    follow,
    inner_pairs,
    is_stale,
    visit,
    walk,
    walk_blocks,
)
from packmech.minimize.passes.shape_rows import (
    RowLaws,
    by_shape,
    flat_spin,
    keep_turned,
    partners_at,
    shape_touch,
    shapes_of,
    spin_of,
    touches,
    turn_rows,
)
from packmech.minimize.passes.single_rows import push_rows, survey_rows

# how a chunk of steps ended
RUNNING, CONVERGED, FLOOR, UNJAMMED, NOT_FINITE, STALLED = range(6)
# or because its pair lists must be rebuilt, which threads leave to who called them
SEARCH = 17

# rows whose forces are completed, and then summed over, together
_TOGETHER = 256


class Goal(NamedTuple):
    """When to stop: largest net force over mean contact force [1]; mean contact force [force] that counts as none."""

    force_tolerance: float
    force_floor: float


@device
def coincident_direction(i, j, dimension):
    """Return a fixed unit vector for two particles at the same place, made of their numbers only."""
    turn = (i + 1) * 0.6180339887498949 + (j + 1) * 0.7548776662466927
    angle = 2.0 * math.pi * (turn - math.floor(turn))
    if dimension == 2:
        return math.cos(angle), math.sin(angle), 0.0
    rise = (i + 1) * 0.5698402909980532 + (j + 1) * 0.8191725133961645
    height = 2.0 * (rise - math.floor(rise)) - 1.0
    across = math.sqrt(1.0 - height * height)
    return across * math.cos(angle), across * math.sin(angle), height


class Sums(NamedTuple):
    """What one pass over the forces adds up.

    `total` of the contact forces, their number, F.v and F.F over all particles, and the largest squared net force.
    Forces on single particles (gravity, walls) are counted with those of contacts, where they are not zero.
    """

    total: float
    touching: int
    power: float
    square: float
    largest: float


class Virial(NamedTuple):
    """What a pass over the forces adds up beside them: over pairs (du/dr) n v (outer product), its upper half."""

    sum_dd: NDArray[np.float64]


@device
def _add_virial(virial, x, y, z, dx, dy, dz):
    """Add what a force along (x, y, z) at a distance (dx, dy, dz) gives, symmetric in all where torques balance."""
    whole = virial.sum_dd
    whole[0, 0] += x * dx
    whole[0, 1] += 0.5 * (x * dy + y * dx)
    whole[1, 1] += y * dy
    whole[0, 2] += 0.5 * (x * dz + z * dx)
    whole[1, 2] += 0.5 * (y * dz + z * dy)
    whole[2, 2] += z * dz


# adds a touch to a virial, where one is taken
_stretch = by_type(lambda virial, x, y, z, dx, dy, dz: None, {Virial: _add_virial})


class _PushingRows(NamedTuple):
    """The visitor that adds the forces of touching pairs to rows; the value is their total and number."""

    force_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    virial: Any


class _PushingSlots(NamedTuple):
    """The same for pairs of which one may belong to another block: what is done to it goes to a slot."""

    force_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    virial: Any
    slot_qd: NDArray[np.float64]


@inlined
def _push_back_row(pushing, axes, pair, push, dx, dy, dz):
    j, force_nd = pair.j, pushing.force_nd
    force_nd[j, 0] -= push * dx
    force_nd[j, 1] -= push * dy
    if len(axes) == 3:
        force_nd[j, 2] -= push * dz


@inlined
def _push_back_anywhere(pushing, axes, pair, push, dx, dy, dz):
    if pair.slot == NO_SLOT:
        _push_back_row(pushing, axes, pair, push, dx, dy, dz)
    else:
        slot_qd, slot = pushing.slot_qd, pair.slot
        slot_qd[slot, 0] = -push * dx
        slot_qd[slot, 1] = -push * dy
        if len(axes) == 3:
            slot_qd[slot, 2] = -push * dz


@inlined
def _clear_slot(pushing, axes, pair):
    if pair.slot != NO_SLOT:
        _push_back_anywhere(pushing, axes, pair, 0.0, 0.0, 0.0, 0.0)


# takes a force along the vector of a pair from its second row, or leaves that in a slot; leaves in a slot that there is
# none
_push_back = by_type(_push_back_row, {_PushingSlots: _push_back_anywhere})
_leave_none = by_type(lambda pushing, axes, pair: None, {_PushingSlots: _clear_slot})


@device
def _push_round(shapes, laws, pushing, pair, square, partners):
    """Add the forces of a touching pair of discs or spheres, and return their size, and 1."""
    axes, force_nd, velocity_nd = laws.axes, pushing.force_nd, pushing.velocity_nd
    i, j, dx, dy, dz = pair.i, pair.j, pair.dx, pair.dy, pair.dz
    r = math.sqrt(square)
    inverse = 1.0 / r
    # what coincides has a direction to part along, but no distance
    apart_x, apart_y, apart_z = dx, dy, dz
    if square == 0.0:
        dx, dy, dz = coincident_direction(i, j, len(axes))
        inverse = 1.0
    rate = (velocity_nd[j, 0] - velocity_nd[i, 0]) * dx + (velocity_nd[j, 1] - velocity_nd[i, 1]) * dy
    if len(axes) == 3:
        rate += (velocity_nd[j, 2] - velocity_nd[i, 2]) * dz
    rate *= inverse
    first = _slope(laws.effects, r, partners, rate)
    push = first * inverse
    force_nd[i, 0] += push * dx
    force_nd[i, 1] += push * dy
    if len(axes) == 3:
        force_nd[i, 2] += push * dz
    _push_back(pushing, axes, pair, push, dx, dy, dz)
    _stretch(pushing.virial, push * dx, push * dy, push * dz, apart_x, apart_y, apart_z)
    return abs(first), 1


class Resistance(NamedTuple):
    """Stands among effects for a dashpot at every touch of rows: coefficient times the rate of its distance."""

    coefficient: float


# the part of a dashpot in the slope of a touch; zero of effects
_resistance = by_type(lambda effect, rate: 0.0, {Resistance: lambda effect, rate: effect.coefficient * rate})


@device
def _slope(effects, rho, partners, rate):
    first = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, rho, partners) + _resistance(one, rate)
    return first


@device
def _law(effects, rho, partners):
    energy = first = second = 0.0
    for one in literal_unroll(effects):
        energy += pair_energy(one, rho, partners)
        first += pair_first(one, rho, partners)
        second += pair_second(one, rho, partners)
    return energy, first, second


@inlined
def _push_shaped(shapes, laws, pushing, pair, square, partners):
    """Do the same for two shapes whose surrounding discs or spheres overlap; torques go to the rows of the turns.

    Shapes are in one block, so that no pair has a slot.
    """
    effects, axes, row = laws.effects, laws.axes, laws.body
    force_nd, velocity_nd, virial = pushing.force_nd, pushing.velocity_nd, pushing.virial
    i, j, dx, dy, dz = pair.i, pair.j, pair.dx, pair.dy, pair.dz
    if square == 0.0:
        nx, ny, nz = coincident_direction(i, j, len(axes))
        small = 1e-9 * partners.contact_distance
        dx, dy, dz = small * nx, small * ny, small * nz
    n = shapes.radius_n.shape[0]
    total = 0.0
    touching = 0
    for k in range(touches(shapes, i, j)):
        touch = shape_touch(shapes, i, j, k, dx, dy, dz, len(axes))
        if not touch.touching:
            continue
        rate = (velocity_nd[j, 0] - velocity_nd[i, 0]) * touch.x + (velocity_nd[j, 1] - velocity_nd[i, 1]) * touch.y
        if len(axes) == 3:
            rate += (velocity_nd[j, 2] - velocity_nd[i, 2]) * touch.z
            ax, ay, az = spin_of(shapes, row, velocity_nd, i)
            bx, by, bz = spin_of(shapes, row, velocity_nd, j)
            rate += touch.ix * ax + touch.iy * ay + touch.iz * az + touch.jx * bx + touch.jy * by + touch.jz * bz
        else:
            rate += touch.iz * flat_spin(shapes, row, velocity_nd, i) + touch.jz * flat_spin(
                shapes, row, velocity_nd, j
            )
        first = _slope(effects, touch.rho, partners_at(effects, i, j, touch), rate)
        force_nd[i, 0] += first * touch.x
        force_nd[i, 1] += first * touch.y
        force_nd[j, 0] -= first * touch.x
        force_nd[j, 1] -= first * touch.y
        if len(axes) == 3:
            force_nd[i, 2] += first * touch.z
            force_nd[j, 2] -= first * touch.z
            force_nd[n + i, 0] -= first * touch.ix
            force_nd[n + i, 1] -= first * touch.iy
            force_nd[n + i, 2] -= first * touch.iz
            force_nd[n + j, 0] -= first * touch.jx
            force_nd[n + j, 1] -= first * touch.jy
            force_nd[n + j, 2] -= first * touch.jz
            size = math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
        else:
            force_nd[n + i, 0] -= first * touch.iz
            force_nd[n + j, 0] -= first * touch.jz
            size = math.sqrt(touch.x * touch.x + touch.y * touch.y)
        _stretch(virial, first * touch.x, first * touch.y, first * touch.z, dx, dy, dz)
        total += abs(first) * size
        touching += 1
    return total, touching


# adds forces and torques of a pair whose surrounding discs or spheres overlap; their size and number
_push_pair = by_shape(_push_round, _push_shaped, _push_shaped)


@inlined
def _near(laws, pair):
    """Return the square of a pair's distance, and its surrounding discs or spheres as partners."""
    square = pair.dx * pair.dx + pair.dy * pair.dy
    if len(laws.axes) == 3:
        square += pair.dz * pair.dz
    return square, partners_of_rows(laws.effects, laws.body, pair.i, pair.j)


@inlined
def _push_listed(pushing, laws, pair, value):
    square, partners = _near(laws, pair)
    total, touching = value
    if square < partners.contact_distance * partners.contact_distance:
        more, one = _push_pair(laws.shapes, laws, pushing, pair, square, partners)
        total += more
        touching += one
    else:
        _leave_none(pushing, laws.axes, pair)
    return total, touching


visit.form(_PushingRows)(_push_listed)
visit.form(_PushingSlots)(_push_listed)
# the visitor of special pairs: shapes are in one block, which has no slots
_visitor_of_special = by_shape(
    lambda shapes, pushing, slot_qd: _PushingSlots(pushing.force_nd, pushing.velocity_nd, pushing.virial, slot_qd),
    lambda shapes, pushing, slot_qd: pushing,
    lambda shapes, pushing, slot_qd: pushing,
)


# columns of PairList.sum_bk
_TOTAL, _TOUCHING, _POWER, _SQUARE, _LARGEST, _SPEED2, _FASTEST2 = range(7)


@inlined
def _walk_special(pushing, laws, pairs, b):
    """Add the forces of pairs of a block with an image or a row of another block, and of interactions.

    What they do to a row of another block goes to a slot. Scenes with interactions are one block.
    """
    start, sums = pairs.start_s, pairs.sum_bk[b]
    # the number of touches is of one type in all walks, so that those of one visitor are compiled once
    visitor = _visitor_of_special(laws.shapes, pushing, pairs.slots.push_qk)
    total, touching = walk(
        visitor, laws, inner_pairs(pairs), start[2 * b + 1], start[2 * b + 1], start[2 * b + 2], (0.0, np.int64(0))
    )
    more, pushed = push_interactions(laws.shapes, laws.effects, laws.axes, laws.body, pushing.force_nd, pairs)
    sums[_TOTAL] = total + more
    sums[_TOUCHING] = touching + pushed


@inner_lean
def _sum_rows(axes, force_nd, velocity_nd, begin, after, power, whole, largest):
    """Add the powers and squares of forces, and return the largest square: one code for any number of threads."""
    for i in range(begin, after):
        fx = force_nd[i, 0]
        fy = force_nd[i, 1]
        own = fx * fx + fy * fy
        power += fx * velocity_nd[i, 0] + fy * velocity_nd[i, 1]
        if len(axes) == 3:
            fz = force_nd[i, 2]
            own += fz * fz
            power += fz * velocity_nd[i, 2]
        whole += own
        largest = max(largest, own)
    return power, whole, largest


@inlined
def _complete_rows(pushing, laws, pairs, b):
    """Add all other forces on the rows of a block, and sum up over them."""
    axes, force_nd, velocity_nd = laws.axes, pushing.force_nd, pushing.velocity_nd
    sums, listed = pairs.sum_bk[b], inner_pairs(pairs)
    collect(axes, (), pairs.slots, force_nd, b)
    first, last = pairs.row_b[b], pairs.row_b[b + 1]
    low, special = pairs.start_s[2 * b], pairs.start_s[2 * b + 1]
    total, touching = sums[_TOTAL], np.int64(sums[_TOUCHING])
    power = 0.0
    whole = 0.0
    largest = 0.0
    for begin in range(first, last, _TOGETHER):
        after = min(last, begin + _TOGETHER)
        high = special if after == last else first_pair_of(listed.i_p, low, special, after)
        total, touching = walk(pushing, laws, listed, low, special, high, (total, touching))
        low = high
        # pairs are sorted by i < j: the forces of pairs on these rows are complete, and still near
        more, pushed = push_rows(laws.shapes, laws.effects, axes, laws.body, force_nd, begin, after)
        total += more
        touching += pushed
        power, whole, largest = _sum_rows(axes, force_nd, velocity_nd, begin, after, power, whole, largest)
    sums[_TOTAL] = total
    sums[_TOUCHING] = touching
    sums[_POWER] = power
    sums[_SQUARE] = whole
    sums[_LARGEST] = largest


@inlined
def _walk_shared_blocks(thread, pushing, laws, pairs):
    """Add the forces on all rows, and sum up in each block."""
    first, last = share(thread, pairs.sum_bk.shape[0])
    if thread is None:
        for b in range(first, last):
            # what goes to slots goes to blocks further on, as i < j
            _walk_special(pushing, laws, pairs, b)
            _complete_rows(pushing, laws, pairs, b)
    else:
        for b in range(first, last):
            _walk_special(pushing, laws, pairs, b)
        wait(thread)
        for b in range(first, last):
            _complete_rows(pushing, laws, pairs, b)
        wait(thread)


@inner_lean
def force_pass(thread, effects, axes, row, force_nd, velocity_nd, pairs, virial):
    """Add the forces of touching pairs to force_nd, which was zero, and to a Virial or None; return the Sums.

    Only scenes without shapes, links, bonds and interactions are several blocks, which threads share, without a virial.
    """
    shapes = shapes_of(effects)
    keep_turned(shapes, row)
    laws, pushing = RowLaws(effects, shapes, axes, row), _PushingRows(force_nd, velocity_nd, virial)
    _walk_shared_blocks(thread, pushing, laws, pairs)
    power, square, largest = turn_rows(shapes, axes, row, force_nd, velocity_nd)
    sum_bk, total, touching = pairs.sum_bk, 0.0, 0.0
    for b in range(sum_bk.shape[0]):
        total += sum_bk[b, _TOTAL]
        touching += sum_bk[b, _TOUCHING]
        power += sum_bk[b, _POWER]
        square += sum_bk[b, _SQUARE]
        largest = max(largest, sum_bk[b, _LARGEST])
    if some_failed(thread):
        total = np.inf
    return Sums(total, int(touching), power, square, largest)


@inlined
def _projected(links, axes, force_nd, velocity_nd, sums):
    """Project the forces of a pass onto the motions that the links admit; return the sums over what is left."""
    power, square, largest = project_forces(
        links, axes, force_nd, velocity_nd, sums.power, sums.square, sums.largest
    )  # fmt: skip
    return Sums(sums.total, sums.touching, power, square, largest)


@inner_lean
def net_forces(thread, effects, axes, row, force_nd, velocity_nd, space, pairs, virial):
    """Add all forces to force_nd, which was zero, and take out what links bear; return the Sums over what is left.

    A Virial takes those of contacts, with what links bear still in them. Each thread takes the forces of its blocks.
    """
    sums = force_pass(thread, effects, axes, row, force_nd, velocity_nd, pairs, virial)
    return _projected(space.links, axes, force_nd, velocity_nd, sums)


@inlined
def moved_far(axes, row, space, number, moved):
    """Bring rows back onto their links after none moved farther than `moved`; return whether pairs must be followed.

    `number` is that of the pair list. Who calls it makes the list valid with `follow`: a list that came back from here
    in every step would be copied in every step.
    """
    return is_stale(number, moved + project_rows(space.links, axes, row, space))


@inner_kernel
def move_rows(axes, row, force_nd, velocity_nd, keep, push, dt, low, high):
    """Set v = keep v + push F, move by dt v, clear the forces; return v.v over rows and the largest squared speed."""
    square = 0.0
    largest = 0.0
    for i in range(low, high):
        vx = keep * velocity_nd[i, 0] + push * force_nd[i, 0]
        vy = keep * velocity_nd[i, 1] + push * force_nd[i, 1]
        velocity_nd[i, 0] = vx
        velocity_nd[i, 1] = vy
        row[i, 0] += dt * vx
        row[i, 1] += dt * vy
        force_nd[i, 0] = 0.0
        force_nd[i, 1] = 0.0
        own = vx * vx + vy * vy
        if len(axes) == 3:
            vz = keep * velocity_nd[i, 2] + push * force_nd[i, 2]
            velocity_nd[i, 2] = vz
            row[i, 2] += dt * vz
            force_nd[i, 2] = 0.0
            own += vz * vz
        square += own
        largest = max(largest, own)
    return square, largest


@device
def rows_of(pairs, row, blocks):
    """Return the first row of a range of blocks and the one after the last; turns are rows of the last block."""
    row_b = pairs.row_b
    high = row.shape[0] if blocks[1] == row_b.shape[0] - 1 else row_b[blocks[1]]
    return row_b[blocks[0]], high


@inlined
def move_pass(thread, axes, row, force_nd, velocity_nd, pairs, keep, push, dt):
    """Move all rows as `move_rows` does, on each thread those of its blocks; return the same over all."""
    sum_bk = pairs.sum_bk
    blocks = share(thread, sum_bk.shape[0])
    for b in range(blocks[0], blocks[1]):
        low, high = rows_of(pairs, row, (b, b + 1))
        sum_bk[b, _SPEED2], sum_bk[b, _FASTEST2] = move_rows(
            axes, row, force_nd, velocity_nd, keep, push, dt, low, high
        )
    wait(thread)
    square = 0.0
    largest = 0.0
    for b in range(sum_bk.shape[0]):
        square += sum_bk[b, _SPEED2]
        largest = max(largest, sum_bk[b, _FASTEST2])
    return square, largest


@device
def clear(array_nd):
    """Set all entries to zero."""
    clear_rows(array_nd, 0, array_nd.shape[0])


@device
def clear_rows(array_nd, low, high):
    """Set the entries of rows to zero."""
    for i in range(low, high):
        for a in range(array_nd.shape[1]):
            array_nd[i, a] = 0.0


class Survey(NamedTuple):
    """Energy, virial, and largest sum of contact stiffnesses on one particle, half a bound on the largest curvature.

    virial_dd is the sum over pairs of (du/dr) n v (outer product), in three dimensions; deepest the largest relative
    overlap; contacts the number of touching pairs.
    """

    energy: float
    virial_dd: NDArray[np.float64]
    stiffness: float
    deepest: float
    contacts: int


@device
def _survey_round(shapes, effects, i, j, dx, dy, dz, square, partners, stiffness_n, virial):
    """Add the stiffness and the virial of a touching pair of discs or spheres; return its energy, overlap, and 1."""
    r = math.sqrt(square)
    energy, first, second = _law(effects, r, partners)
    stiffness_n[i] += abs(second)
    stiffness_n[j] += abs(second)
    if r > 0.0:
        first /= r
    virial[0, 0] += first * dx * dx
    virial[0, 1] += first * dx * dy
    virial[1, 1] += first * dy * dy
    virial[0, 2] += first * dx * dz
    virial[1, 2] += first * dy * dz
    virial[2, 2] += first * dz * dz
    sigma = partners.contact_distance
    return energy, (sigma - r) / sigma, 1


@device
def _survey_shaped(shapes, effects, i, j, dx, dy, dz, square, partners, stiffness_n, virial):
    """Do the same for all contacts of two particles; return their energy, the largest overlap, and their number."""
    if square == 0.0:
        dx = 1e-9 * partners.contact_distance
    energy = deepest = 0.0
    contacts = 0
    for k in range(touches(shapes, i, j)):
        touch = shape_touch(shapes, i, j, k, dx, dy, dz, shapes.dimension)
        if not touch.touching:
            continue
        contacts += 1
        deepest = max(deepest, (touch.sigma - touch.rho) / touch.sigma)
        own, first, second = _law(effects, touch.rho, partners_at(effects, i, j, touch))
        energy += own
        turn_i = (touch.ix * touch.ix + touch.iy * touch.iy + touch.iz * touch.iz) / shapes.gyration_n[i] ** 2
        turn_j = (touch.jx * touch.jx + touch.jy * touch.jy + touch.jz * touch.jz) / shapes.gyration_n[j] ** 2
        steep = abs(second) * (touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
        stiffness_n[i] += steep + abs(second) * turn_i
        stiffness_n[j] += steep + abs(second) * turn_j
        # symmetric in all where torques balance
        virial[0, 0] += first * touch.x * dx
        virial[0, 1] += 0.5 * first * (touch.x * dy + touch.y * dx)
        virial[1, 1] += first * touch.y * dy
        virial[0, 2] += 0.5 * first * (touch.x * dz + touch.z * dx)
        virial[1, 2] += 0.5 * first * (touch.y * dz + touch.z * dy)
        virial[2, 2] += first * touch.z * dz
    return energy, deepest, contacts


@device
def _touches_of_shapes(shapes, i, j, dx, dy, dz, square, partners):
    if square == 0.0:
        dx = 1e-9 * partners.contact_distance
    number = 0
    for k in range(touches(shapes, i, j)):
        number += shape_touch(shapes, i, j, k, dx, dy, dz, shapes.dimension).touching
    return number


_survey_pair = by_shape(_survey_round, _survey_shaped, _survey_shaped)
_touches_of = by_shape(
    lambda shapes, i, j, dx, dy, dz, square, partners: 1, _touches_of_shapes, _touches_of_shapes
)  # fmt: skip


@device
def contacts_of(laws, pair):
    """Return in how many places two listed rows touch."""
    square, partners = _near(laws, pair)
    if square >= partners.contact_distance * partners.contact_distance:
        return 0
    return _touches_of(laws.shapes, pair.i, pair.j, pair.dx, pair.dy, pair.dz, square, partners)


class _SurveyingRows(NamedTuple):
    """The visitor that adds up stiffness and virial; the value is the energy, the deepest overlap, and contacts."""

    stiffness_n: NDArray[np.float64]
    virial_dd: NDArray[np.float64]


@visit.form(_SurveyingRows)
@inlined
def _survey_listed(surveying, laws, pair, value):
    square, partners = _near(laws, pair)
    energy, deepest, contacts = value
    if square < partners.contact_distance * partners.contact_distance:
        own, overlap, count = _survey_pair(
            laws.shapes, laws.effects, pair.i, pair.j, pair.dx, pair.dy, pair.dz, square, partners,
            surveying.stiffness_n, surveying.virial_dd,
        )  # fmt: skip
        energy += own
        deepest = max(deepest, overlap)
        contacts += count
    return energy, deepest, contacts


@inner_kernel
def survey(effects, row, pairs):
    """Return the Survey of the touching pairs, without what links bear."""
    shapes = shapes_of(effects)
    keep_turned(shapes, row)
    stiffness_n = np.zeros(row.shape[0])
    virial = np.zeros((3, 3))
    laws, surveying = RowLaws(effects, shapes, (0, 1, 2), row), _SurveyingRows(stiffness_n, virial)
    energy, deepest, contacts = walk_blocks(surveying, laws, pairs, (0.0, 0.0, 0))
    virial[1, 0] = virial[0, 1]
    virial[2, 0] = virial[0, 2]
    virial[2, 1] = virial[1, 2]
    energy += survey_interactions(shapes, effects, row, pairs, virial, stiffness_n)
    more, stiffness = survey_rows(shapes, effects, row, stiffness_n)
    energy += more
    for i in range(row.shape[0]):
        stiffness = max(stiffness, stiffness_n[i])
    return Survey(energy, virial, stiffness, deepest, contacts)


@kernel
def evaluate(effects, axes, row, force_nd, velocity_nd, space, pairs):
    """Return Sums, Survey (with what links bear) and the pair list at the positions in row; forces stay in force_nd."""
    if is_stale(pairs.number, np.inf):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    sums = force_pass(None, effects, axes, row, force_nd, velocity_nd, pairs, None)
    refresh(space.links, row, space)
    sums = _projected(space.links, axes, force_nd, velocity_nd, sums)
    found = survey(effects, row, pairs)
    add_tensions(space.links, axes, found.virial_dd)
    return sums, found, pairs


@device
def judge(sums, stiffness, space, goal):
    """Return how things stand after a pass over the forces."""
    if not (sums.total < np.inf and sums.largest < np.inf):
        return NOT_FINITE
    floor = stiffness * space.resolution[0]
    if sums.total <= sums.touching * max(floor, goal.force_floor):
        return UNJAMMED
    if math.sqrt(sums.largest) * sums.touching <= goal.force_tolerance * sums.total:
        return CONVERGED
    if math.sqrt(sums.largest) <= floor:
        return FLOOR
    return RUNNING
