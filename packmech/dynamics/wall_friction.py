# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What walls do across: friction, and resistance to rolling and twisting; and all that walls do that move.

Walls that stand still push by `Walls.body_force`, surfaces of triangles by that of `MeshRows`, and both are visited
here only where they are rough. A contact with a wall slips as one with a row of no spin would, which moves as the wall
does and whose arm is nothing: i is the particle, n points to the wall.

Springs at a surface are known by the direction to where it is touched, which is kept beside them: as a sphere goes from
one triangle of a plane to the next, or over an edge, the direction stays or turns, and the spring goes along. A contact
that is nearest to none of the step before begins slack.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.triangles import EDGE, FACE, first_near, next_near, touch_of_triangle
from packmech.dynamics.contact_records import write_springs
from packmech.dynamics.faces import PLACE, VELOCITY, clear_faces, load_face, make_faces
from packmech.dynamics.friction import (
    Pull,
    Slip,
    Slipping,
    Spring,
    add_force,
    energy_of_springs,
    relax,
    resist,
    slip_of_round,
    spin_of_round,
    spring_columns,
    turns_at,
)
from packmech.effects import (
    DIRECTION_COLUMNS,
    SAME_DIRECTION,
    SIDES,
    ConstantRolling,
    DampingRatio,
    Friction,
    KindWalls,
    MeshWalls,
    Mindlin,
    RoughContacts,
    ViscousRolling,
    Walls,
    first_on_wall,
    law_energy,
    law_first,
    law_second,
    on_row,
)
from packmech.effects.body import dashpot_of, walls_by_rows
from packmech.effects.friction import mindlin_stiffness
from packmech.effects.pair import TouchingPair
from packmech.effects.partners import equal_partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, lean


class RoughWall(NamedTuple):
    """Walls that stand still, and what acts across contacts: friction, with what resists rolling and twisting."""

    wall: Walls | KindWalls
    rough: Any


class MovingWall(NamedTuple):
    """Walls that move, what acts across contacts with them (None where they are smooth), and which faces they are."""

    wall: Walls | KindWalls
    rough: Any
    faces: Any
    first: int


class RoughMesh(NamedTuple):
    """A rough surface of triangles, what acts across contacts with it, and how many of a sphere it has springs for.

    touch_bsk holds the contacts of the row that a block is at, by the columns below, then their springs; crowded_b is 1
    where a row of the block had more of them than there is room for.
    """

    wall: Any
    rough: Any
    slots: int
    touch_bsk: Any
    crowded_b: Any


class VisitedWalls(NamedTuple):
    """The walls that rows are walked past, the stretches of the springs of each row, and the faces that move.

    Of each wall low, then high; of each surface its slots, directions before springs. Faces are None where all stand
    still.
    """

    walls: Any
    stretch_nk: Any
    faces: Any


class WallTouch(NamedTuple):
    """A contact of a row with a wall: the direction to it, and the distances of the particle's image in it."""

    x: float
    y: float
    z: float
    rho: float
    sigma: float


class MovingTouch(NamedTuple):
    """The same with a wall that moves: its velocity, and the number of the face."""

    x: float
    y: float
    z: float
    rho: float
    sigma: float
    u: float
    v: float
    w: float
    face: int


class MeshTouch(NamedTuple):
    """The same with a surface of triangles, which stands still, and how the direction turns as the row moves.

    By `bend` times the velocity across the direction [1/length], over an edge without the part along the edge (a, b,
    c).
    """

    x: float
    y: float
    z: float
    rho: float
    sigma: float
    bend: float
    a: float
    b: float
    c: float


# columns of a contact with a surface in `RoughMesh.touch_bsk`: direction to it, distance, `bend`, direction of an edge
_DISTANCE, _BEND, _ALONG, _SPRING = 3, 4, 5, 8
# the same of a contact that is none of the step before, but the nearest of those that are left: contacts within ten
# degrees count as one, that with the next facet once it is nearer
_SAME_AFTER_JUMP = math.cos(math.radians(15.0))


def make_visited_walls(
    walls: tuple[Any, ...], box: Box, kind_n: NDArray[np.int64], axes: tuple[int, ...], blocks: int
) -> VisitedWalls | None:
    """Return rough walls and walls that move, for rows of (N,) kinds, with slack springs; None where there are none."""
    faces, first = make_faces(tuple(one for one in walls if isinstance(one, Walls)), box, blocks), 0
    found: list[MovingWall | RoughMesh | RoughWall] = []
    for one in walls:
        if isinstance(one, MeshWalls):
            room = np.zeros((blocks, one.slots, _SPRING + len(spring_columns(one.roughness, axes))))
            found.append(RoughMesh(one.rows, one.roughness, one.slots, room, np.zeros(blocks, dtype=np.int64)))
            continue
        wall = walls_by_rows(one.still, kind_n)
        # of walls that differ by kinds the first one's says which springs there are
        rough = wall.roughs[0] if isinstance(wall, KindWalls) else one.roughness
        if one.moves:
            found.append(MovingWall(wall, rough, faces, first))
            first += SIDES
        else:
            found.append(RoughWall(wall, rough))
    columns = sum(_columns_of(one, axes) for one in found)
    return VisitedWalls(tuple(found), np.zeros((len(kind_n), columns)), faces) if found else None


def is_crowded(visited: VisitedWalls | None) -> bool:
    """Return whether a sphere touched a rough surface of triangles at more places than it has springs for."""
    meshes = () if visited is None else (one for one in visited.walls if isinstance(one, RoughMesh))
    return any(bool(one.crowded_b.any()) for one in meshes)


@inlined
def _unit(axis, sign):
    return sign if axis == 0 else 0.0, sign if axis == 1 else 0.0, sign if axis == 2 else 0.0


@inlined
def _same_rough(wall, rough, i):
    return rough


@inlined
def _rough_of_kind(wall, rough, i):
    return wall.roughs[wall.kind_n[i]]


# what acts across contacts of a row with walls: (walls, rough, row)
_rough_at = by_type(_same_rough, {KindWalls: _rough_of_kind})


@inlined
def _touch_still(one, body, i, side):
    wall = on_row(one.wall, i)
    axis = int(wall.axis)
    x, y, z = _unit(axis, -1.0 if side == 0 else 1.0)
    distance = body[i, axis] - wall.low if side == 0 else wall.high - body[i, axis]
    return WallTouch(x, y, z, 2.0 * distance, 2.0 * body[i, 3])


@inlined
def _touch_moving(one, body, i, side):
    number_fk, axis, face = one.faces.number_fk, int(on_row(one.wall, i).axis), one.first + side
    x, y, z = _unit(axis, -1.0 if side == 0 else 1.0)
    distance = body[i, axis] - number_fk[face, PLACE] if side == 0 else number_fk[face, PLACE] - body[i, axis]
    u, v, w = number_fk[face, VELOCITY], number_fk[face, VELOCITY + 1], number_fk[face, VELOCITY + 2]
    return MovingTouch(x, y, z, 2.0 * distance, 2.0 * body[i, 3], u, v, w, face)


# the contact of a row with a side of a wall, whether it touches it or not
_touch = by_type(_touch_still, {MovingWall: _touch_moving})


@inlined
def _from_still(touch, axes, body, i):
    return -body[i, 4], -body[i, 5], -body[i, 6] if len(axes) == 3 else 0.0


@inlined
def _from_moving(touch, axes, body, i):
    return touch.u - body[i, 4], touch.v - body[i, 5], touch.w - body[i, 6] if len(axes) == 3 else 0.0


# the velocity of a wall, relative to a row
_velocity_to = by_type(_from_still, {MovingTouch: _from_moving})


@inlined
def _rate_of(touch, u):
    """Return the rate of the distance between a particle and its image in a wall that it sees move at u."""
    return 2.0 * (u[0] * touch.x + u[1] * touch.y + u[2] * touch.z)


@inlined
def normal_at_moving_wall(one, axes, state, i, touch):
    """Return the derivative of the law at a contact with a wall that moves, and that with the dashpot's force."""
    rate, sigma = _rate_of(touch, _velocity_to(touch, axes, state.body, i)), touch.sigma
    wall = on_row(one.wall, i)
    whole = first_on_wall(wall, touch.rho, sigma, rate, 0.5 * state.mass_n[i])
    return law_first(wall.law, touch.rho, equal_partners(sigma)), whole


@inlined
def _number(number, wall, touch, rate, mass):
    return number


@inlined
def _stiffness(mindlin, wall, touch, rate, mass):
    second = 2.0 * law_second(wall.law, touch.rho, equal_partners(touch.sigma))
    return max(mindlin_stiffness(mindlin, second, 0), 1e-200)


@inlined
def _dashpot(damping, wall, touch, rate, mass):
    law, rho, image = wall.law, touch.rho, equal_partners(touch.sigma)
    energy, first, second = law_energy(law, rho, image), law_first(law, rho, image), law_second(law, rho, image)
    pair = TouchingPair(rho, touch.sigma, rate, energy, first, second, mass, image.effective_radius, 0)
    return 2.0 * damping.ratio * dashpot_of(wall.damping, pair)


_stiffness_here = by_type(_number, {Mindlin: _stiffness})
_dashpot_here = by_type(_number, {DampingRatio: _dashpot})


@inlined
def _sliding_here(friction, wall, touch, rate, mass):
    return Friction(
        friction.coefficient,
        _stiffness_here(friction.stiffness, wall, touch, rate, mass),
        _dashpot_here(friction.damping, wall, touch, rate, mass),
    )


@inlined
def _rough_here(rough, wall, touch, rate, mass):
    return _sliding_here(rough.friction, wall, touch, rate, mass)


# the friction with the numbers that it has at a contact with a wall
_friction_here = by_type(_sliding_here, {RoughContacts: _rough_here})


@inlined
def _no_turns(rough, axes, wi, slip):
    return None


@inlined
def _turns(rough, axes, wi, slip):
    return turns_at(axes, slip.lever_i, wi, (0.0, 0.0, 0.0), slip)


_turns_at_wall = by_type(_no_turns, {RoughContacts: _turns})


@inlined
def _slip_on_plane(touch, axes, u, wi):
    # no line of centers turns: the distance of the slip is left out
    here = WallTouch(touch.x, touch.y, touch.z, 0.0, 0.0)
    return slip_of_round(axes, here, (0.5 * touch.rho, 0.0), u, wi, (0.0, 0.0, 0.0))


@inlined
def _slip_on_mesh(touch, axes, u, wi):
    slip = _slip_on_plane(touch, axes, u, wi)
    nx, ny, nz = slip.nx, slip.ny, slip.nz
    ux, uy, uz = u
    along = ux * touch.a + uy * touch.b + uz * touch.c
    ux, uy, uz = ux - along * touch.a, uy - along * touch.b, uz - along * touch.c
    return Slip(
        nx, ny, nz, slip.lever_i, slip.lever_j, slip.sx, slip.sy, slip.sz,
        slip.ox + touch.bend * (ny * uz - nz * uy),
        slip.oy + touch.bend * (nz * ux - nx * uz),
        slip.oz + touch.bend * (nx * uy - ny * ux),
    )  # fmt: skip


# how a row slips on what it touches, which moves at u relative to it
_slip = by_type(_slip_on_plane, {MeshTouch: _slip_on_mesh})


@inlined
def slipping_at_wall(one, axes, state, i, touch):
    """Return how a row that touches a wall slips on it, and the normal force."""
    body, wall, rough = state.body, on_row(one.wall, i), _rough_at(one.wall, one.rough, i)
    u = _velocity_to(touch, axes, body, i)
    rate = _rate_of(touch, u)
    here = _friction_here(rough, wall, touch, rate, 0.5 * state.mass_n[i])
    wi = spin_of_round(axes, body, i)
    slip = _slip(touch, axes, u, wi)
    normal = abs(law_first(wall.law, touch.rho, equal_partners(touch.sigma)))
    return Slipping(here, slip, _turns_at_wall(rough, axes, wi, slip)), normal


@inlined
def _pull(one, axes, state, i, touch, spring, pace):
    """Return what a wall does across to a row that touches it; its push is left out, but as the normal force."""
    (here, slip, turns), normal = slipping_at_wall(one, axes, state, i, touch)
    rough = _rough_at(one.wall, one.rough, i)
    across, turning, on_i, on_j = resist(rough, axes, here, slip, turns, spring, normal, pace)
    return here, Pull(across.fx, across.fy, across.fz, on_i, on_j, normal, across, turning)


def _not_in_python(visitor: Any, one: Any, axes: Any, state: Any, i: Any, touch: Any, spring: Any, value: Any) -> Any:
    raise NotImplementedError("walls are visited in compiled loops")


# the value after the visit of a row at a side of a wall, where it touches it and where it does not; the spring is where
# its stretches begin: (visitor, wall, axes, state, row, touch, spring, value) -> value
visit_wall = by_type(_not_in_python)
# what becomes of the springs of a contact with a surface of triangles that is open: (visitor, surface, axes, spring)
release_springs = by_type(lambda visitor, one, axes, spring: None)


@inlined
def _visit_sides(one, visitor, axes, state, stretch_nk, i, column, b, value):
    for side in range(SIDES):
        touch = _touch(one, state.body, i, side)
        value = visit_wall(visitor, one, axes, state, i, touch, Spring(stretch_nk, i, column), value)
        column += len(spring_columns(one.rough, axes))
    return value


@device
def _find_touches(one, body, i, b):
    """Write the contacts of a row with a surface into the room of a block; return how many there are."""
    touches, triangles, found = one.touch_bsk, one.wall.triangles, 0
    near = first_near(triangles, body[i, 0], body[i, 1], body[i, 2], body[i, 3])
    while near.number >= 0:
        touch = touch_of_triangle(triangles, near)
        if touch.touches and found < one.slots:
            edge = 1.0 if touch.part == EDGE else 0.0
            for a in range(3):
                touches[b, found, a] = -touch.n[a]
                touches[b, found, _ALONG + a] = edge * touch.along[a]
            touches[b, found, _DISTANCE] = touch.distance
            touches[b, found, _BEND] = 1.0 / touch.distance if touch.part != FACE else 0.0
            found += 1
        elif touch.touches:
            one.crowded_b[b] = 1
        near = next_near(triangles, near)
    return found


@device
def _is_held(stretch_nk, i, column):
    """Whether a contact is remembered here: its direction is a unit vector, or else zero."""
    return stretch_nk[i, column] != 0.0 or stretch_nk[i, column + 1] != 0.0 or stretch_nk[i, column + 2] != 0.0


@device
def _count_held(one, stretch_nk, i, first, width):
    held = 0
    while held < one.slots and _is_held(stretch_nk, i, first + held * width):
        held += 1
    return held


@device
def _nearest_held(one, stretch_nk, i, first, width, held, b, t, least):
    """Return which of the contacts held is nearest in direction to contact t of now, beyond a cosine; -1 if none."""
    found = -1
    for s in range(held):
        k = first + s * width
        x, y, z = stretch_nk[i, k], stretch_nk[i, k + 1], stretch_nk[i, k + 2]
        cosine = x * one.touch_bsk[b, t, 0] + y * one.touch_bsk[b, t, 1] + z * one.touch_bsk[b, t, 2]
        if cosine > least:
            least, found = cosine, s
    return found


@device
def _take_springs(one, stretch_nk, i, first, width, held, b, found):
    """Give the contacts of now the springs of those held that they are, which are held no longer; others are slack."""
    touches = one.touch_bsk
    for t in range(found):
        for k in range(DIRECTION_COLUMNS, width):
            touches[b, t, _SPRING + k - DIRECTION_COLUMNS] = 0.0
    # one bit for each
    given = 0
    for least in (SAME_DIRECTION, _SAME_AFTER_JUMP):
        for t in range(found):
            s = -1
            if not given & (1 << t):
                s = _nearest_held(one, stretch_nk, i, first, width, held, b, t, least)
            if s >= 0:
                given |= 1 << t
                for k in range(DIRECTION_COLUMNS, width):
                    touches[b, t, _SPRING + k - DIRECTION_COLUMNS] = stretch_nk[i, first + s * width + k]
                for k in range(width):
                    stretch_nk[i, first + s * width + k] = 0.0


@device
def _hold(one, stretch_nk, i, first, width, held, b, found):
    """Remember the contacts of now, in the order in which they were found, with their springs."""
    touches = one.touch_bsk
    for t in range(found):
        for k in range(width):
            column = k if k < DIRECTION_COLUMNS else _SPRING + k - DIRECTION_COLUMNS
            stretch_nk[i, first + t * width + k] = touches[b, t, column]
    for k in range(first + found * width, first + held * width):
        stretch_nk[i, k] = 0.0


@inlined
def _touch_of_now(one, body, i, b, t):
    now = one.touch_bsk
    return MeshTouch(
        now[b, t, 0], now[b, t, 1], now[b, t, 2], 2.0 * now[b, t, _DISTANCE], 2.0 * body[i, 3], now[b, t, _BEND],
        now[b, t, _ALONG], now[b, t, _ALONG + 1], now[b, t, _ALONG + 2],
    )  # fmt: skip


@inlined
def _visit_surface(one, visitor, axes, state, stretch_nk, i, first, b, value):
    body, width = state.body, DIRECTION_COLUMNS + len(spring_columns(one.rough, axes))
    found, held = _find_touches(one, body, i, b), _count_held(one, stretch_nk, i, first, width)
    _take_springs(one, stretch_nk, i, first, width, held, b, found)
    for s in range(held):
        if _is_held(stretch_nk, i, first + s * width):
            release_springs(visitor, one, axes, Spring(stretch_nk, i, first + s * width + DIRECTION_COLUMNS))
    _hold(one, stretch_nk, i, first, width, held, b, found)
    for t in range(found):
        spring = Spring(stretch_nk, i, first + t * width + DIRECTION_COLUMNS)
        value = visit_wall(visitor, one, axes, state, i, _touch_of_now(one, body, i, b, t), spring, value)
    return value


# the value after the visits of a row at all contacts that it may have with a wall, whose first column is given
_visit_all = by_type(_visit_sides, {RoughMesh: _visit_surface})
# how many columns the springs of a row at a wall take
_columns_of = by_type(
    lambda one, axes: SIDES * len(spring_columns(one.rough, axes)),
    {RoughMesh: lambda one, axes: one.slots * (DIRECTION_COLUMNS + len(spring_columns(one.rough, axes)))},
)


@inlined
def walk_walls(visitor, rough, axes, state, stretch_nk, rows, b, value):
    """Visit each row of a range, which block b has room for, at each side of each wall and where it touches meshes."""
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        column = 0
        for one in literal_unroll(rough.walls):
            value = _visit_all(one, visitor, axes, state, stretch_nk, i, column, b, value)
            column += _columns_of(one, axes)
    return value


class _Pushing(NamedTuple):
    """The visitor that adds forces and torques to the rows of a block."""

    pace: Any
    b: Any


@inlined
def _push_across(one, pushing, axes, state, i, touch, spring):
    _, pull = _pull(one, axes, state, i, touch, spring, pushing.pace)
    add_force(axes, state.spins, state.push, i, pull)


@inlined
def _push_and_load(rough, one, pushing, axes, state, i, touch, spring):
    _, pull = _pull(one, axes, state, i, touch, spring, pushing.pace)
    add_force(axes, state.spins, state.push, i, pull)
    load_face(one.faces, pushing.b, touch.face, pull.fx, pull.fy, pull.fz)


# what a wall that moves does across to a row
_push_rough = by_type(_push_and_load, {type(None): lambda rough, one, pushing, axes, state, i, touch, spring: None})


@inlined
def _push_by_moving(one, pushing, axes, state, i, touch, spring):
    _, first = normal_at_moving_wall(one, axes, state, i, touch)
    fx, fy, fz = first * touch.x, first * touch.y, first * touch.z
    state.push[i, 0] += fx
    state.push[i, 1] += fy
    if len(axes) == 3:
        state.push[i, 2] += fz
    load_face(one.faces, pushing.b, touch.face, fx, fy, fz)
    _push_rough(one.rough, one, pushing, axes, state, i, touch, spring)


# what a wall does to a row that touches it, but for the push of one that stands still
_push_touching = by_type(_push_across, {MovingWall: _push_by_moving})


@visit_wall.form(_Pushing)
@inlined
def _push_row(pushing, one, axes, state, i, touch, spring, value):
    if touch.rho < touch.sigma:
        _push_touching(one, pushing, axes, state, i, touch, spring)
    else:
        relax(one.rough, axes, spring)
    return value


@inlined
def _nothing(visited, axes, state, pace, rows, b):
    return None


@inlined
def _push(visited, axes, state, pace, rows, b):
    clear_faces(visited.faces, b)
    walk_walls(_Pushing(pace, b), visited, axes, state, visited.stretch_nk, rows, b, 0)


@inlined
def _nothing_held(one, normal):
    return 0.0


@inlined
def _held_at_cap(one, normal):
    cap = one.coefficient * normal
    return 0.5 * cap * cap / one.stiffness if one.stiffness > 0.0 else 0.0


# what a spring can hold at its cap
_held = by_type(
    _held_at_cap, {type(None): _nothing_held, ConstantRolling: _nothing_held, ViscousRolling: _nothing_held}
)


@inlined
def _held_by_friction(rough, here, normal):
    return _held(here, normal)


@inlined
def _held_by_all(rough, here, normal):
    return _held(here, normal) + _held(rough.rolling, normal) + _held(rough.twisting, normal)


_held_there = by_type(_held_by_friction, {RoughContacts: _held_by_all})


@inlined
def _energy_of_sliding(rough, here, pull):
    return energy_of_springs(here, pull)


@inlined
def _energy_of_all(rough, here, pull):
    return energy_of_springs(RoughContacts(here, rough.rolling, rough.twisting), pull)


_energy_of_springs = by_type(_energy_of_sliding, {RoughContacts: _energy_of_all})


class _Summing(NamedTuple):
    """The visitor that adds up the energies of springs, and what they can hold."""

    now: Any


@inlined
def _springs_there(rough, summing, one, axes, state, i, touch, spring):
    here, pull = _pull(one, axes, state, i, touch, spring, summing.now)
    return _energy_of_springs(rough, here, pull), _held_there(rough, here, pull.normal)


_springs_at = by_type(
    _springs_there, {type(None): lambda rough, summing, one, axes, state, i, touch, spring: (0.0, 0.0)}
)


@visit_wall.form(_Summing)
@inlined
def _sum_row(summing, one, axes, state, i, touch, spring, value):
    energy, held = value
    if touch.rho < touch.sigma:
        more = _springs_at(one.rough, summing, one, axes, state, i, touch, spring)
        energy += more[0]
        held += more[1]
    return energy, held


class _SummingPushes(NamedTuple):
    """The visitor that adds up the energies of contacts with walls that move, half that of a particle and image."""


@inlined
def _no_push_energy(one, i, touch):
    return 0.0


@inlined
def _push_energy(one, i, touch):
    return 0.5 * law_energy(on_row(one.wall, i).law, touch.rho, equal_partners(touch.sigma))


# the energy of the push of a wall that moves; that of others is counted where single particles are
energy_of_push = by_type(_no_push_energy, {MovingWall: _push_energy})


@visit_wall.form(_SummingPushes)
@inlined
def _sum_push(summing, one, axes, state, i, touch, spring, value):
    return value + energy_of_push(one, i, touch) if touch.rho < touch.sigma else value


@inlined
def _sum_pushes(faces, visited, axes, state):
    rows = 0, state.body.shape[0]
    return walk_walls(_SummingPushes(), visited, axes, state, visited.stretch_nk, rows, 0, 0.0)


_pushes_of = by_type(_sum_pushes, {type(None): lambda faces, visited, axes, state: 0.0})


@inlined
def _no_sums(rough, axes, state, now):
    return 0.0, 0.0


@inlined
def _sum_energy(rough, axes, state, now):
    rows = 0, state.body.shape[0]
    return walk_walls(_Summing(now), rough, axes, state, rough.stretch_nk, rows, 0, (0.0, 0.0))


class _Writing(NamedTuple):
    """The visitor that writes down the stretches of springs."""

    now: Any
    stretch_nk: Any


@inlined
def _write_springs(rough, writing, one, axes, state, i, touch, spring):
    _, pull = _pull(one, axes, state, i, touch, spring, writing.now)
    write_springs(rough, axes, writing.stretch_nk, i, spring.k, pull)


_write_at = by_type(_write_springs, {type(None): lambda rough, writing, one, axes, state, i, touch, spring: None})


@visit_wall.form(_Writing)
@inlined
def _write_row(writing, one, axes, state, i, touch, spring, value):
    if touch.rho < touch.sigma:
        _write_at(one.rough, writing, one, axes, state, i, touch, spring)
    return value


@lean
def _write_down(rough, axes, state, now, stretch_nk):
    rows = 0, state.body.shape[0]
    walk_walls(_Writing(now, stretch_nk), rough, axes, state, rough.stretch_nk, rows, 0, 0)


def stretches_at_walls(system: Any, now: Any) -> NDArray[np.float64]:
    """Return the stretches of rows at rough walls at the time of the force taken last, `now`; no columns without."""
    rough = system.acting.walls
    if rough is None:
        return np.zeros((len(system.state.body), 0))
    # stiffnesses are those of this time
    found: NDArray[np.float64] = rough.stretch_nk.copy()
    _write_down(rough, system.axes, system.state, now, found)
    return found


# adds what visited walls do to rows of a block whose push holds all else that acts on single ones, and loads faces
push_of_walls = by_type(_nothing, {VisitedWalls: _push})
# the energy of the springs of rough walls, and what they can hold at their caps
energy_at_walls = by_type(_no_sums, {VisitedWalls: _sum_energy})
# the energy of contacts with walls that move
energy_at_moving_walls = by_type(
    lambda visited, axes, state: 0.0,
    {VisitedWalls: lambda visited, axes, state: _pushes_of(visited.faces, visited, axes, state)},
)
# the faces of visited walls; None without
faces_of = by_type(lambda visited: None, {VisitedWalls: lambda visited: visited.faces})
