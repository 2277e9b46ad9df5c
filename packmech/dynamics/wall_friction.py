# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What walls do across: friction, and resistance to rolling and twisting. A scene without rough walls has none of it.

The push of walls is that of `Walls.body_force`. A contact with a wall at rest slips as one with a row of no spin would,
whose arm is nothing: i is the particle, n points to the wall.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.dynamics.contact_records import write_springs
from packmech.dynamics.friction import (
    Pull,
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
    SIDES,
    ConstantRolling,
    DampingRatio,
    Friction,
    Mindlin,
    RoughContacts,
    ViscousRolling,
    Walls,
    law_energy,
    law_first,
    law_second,
)
from packmech.effects.body import dashpot_of
from packmech.effects.friction import mindlin_stiffness
from packmech.effects.pair import TouchingPair
from packmech.effects.partners import equal_partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import inlined, lean


class RoughWall(NamedTuple):
    """Walls, and what acts across contacts with them: friction, with what resists rolling and twisting if anything."""

    wall: Walls
    rough: Any


class RoughWalls(NamedTuple):
    """The rough walls of a scene, and the stretches of the springs of each row: of each wall, low then high."""

    walls: Any
    stretch_nk: Any


class WallTouch(NamedTuple):
    """A contact of a row with a wall: the direction to it, and the distances of the particle's image in it."""

    x: float
    y: float
    z: float
    rho: float
    sigma: float


def make_rough_walls(walls: tuple[Walls, ...], rows: int, axes: tuple[int, ...]) -> RoughWalls | None:
    """Return the rough walls of a scene with slack springs; None where there are none."""
    found = tuple(RoughWall(one, one.roughness) for one in walls)
    columns = sum(SIDES * len(spring_columns(one.rough, axes)) for one in found)
    return RoughWalls(found, np.zeros((rows, columns))) if found else None


@inlined
def _distance(wall, body, i, side):
    """Return how far the center of a row is from a wall, and the axis and the sign of the direction to it."""
    axis = int(wall.axis)
    if side == 0:
        return body[i, axis] - wall.low, axis, -1.0
    return wall.high - body[i, axis], axis, 1.0


@inlined
def _touch(wall, body, i, side):
    distance, axis, sign = _distance(wall, body, i, side)
    x = sign if axis == 0 else 0.0
    y = sign if axis == 1 else 0.0
    z = sign if axis == 2 else 0.0
    return WallTouch(x, y, z, 2.0 * distance, 2.0 * body[i, 3])


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
def slipping_at_wall(one, axes, state, i, touch):
    """Return how a row that touches a wall slips on it, and the normal force."""
    body, wall, rough = state.body, one.wall, one.rough
    u = -body[i, 4], -body[i, 5], -body[i, 6] if len(axes) == 3 else 0.0
    rate = 2.0 * (u[0] * touch.x + u[1] * touch.y + u[2] * touch.z)
    here = _friction_here(rough, wall, touch, rate, 0.5 * state.mass_n[i])
    wi = spin_of_round(axes, body, i)
    # no line of centers turns: the distance of the slip is left out
    slip = slip_of_round(
        axes, WallTouch(touch.x, touch.y, touch.z, 0.0, 0.0), (0.5 * touch.rho, 0.0), u, wi, (0.0, 0.0, 0.0)
    )
    normal = abs(law_first(wall.law, touch.rho, equal_partners(touch.sigma)))
    return Slipping(here, slip, _turns_at_wall(rough, axes, wi, slip)), normal


@inlined
def _pull(one, axes, state, i, touch, spring, pace):
    """Return what a wall does across to a row that touches it; its push is left out, but as the normal force."""
    (here, slip, turns), normal = slipping_at_wall(one, axes, state, i, touch)
    across, turning, on_i, on_j = resist(one.rough, axes, here, slip, turns, spring, normal, pace)
    return here, Pull(across.fx, across.fy, across.fz, on_i, on_j, normal, across, turning)


def _not_in_python(visitor: Any, one: Any, axes: Any, state: Any, i: Any, touch: Any, spring: Any, value: Any) -> Any:
    raise NotImplementedError("walls are visited in compiled loops")


# the value after the visit of a row at a side of a wall, where it touches it and where it does not; the spring is where
# its stretches begin: (visitor, wall, axes, state, row, touch, spring, value) -> value
visit_wall = by_type(_not_in_python)


@inlined
def walk_walls(visitor, rough, axes, state, stretch_nk, rows, value):
    """Visit each row of a range at each side of each wall."""
    for i in range(np.uint64(rows[0]), np.uint64(rows[1])):
        column = 0
        for one in literal_unroll(rough.walls):
            for side in range(SIDES):
                touch = _touch(one.wall, state.body, i, side)
                value = visit_wall(visitor, one, axes, state, i, touch, Spring(stretch_nk, i, column), value)
                column += len(spring_columns(one.rough, axes))
    return value


class _Pushing(NamedTuple):
    """The visitor that adds forces and torques to rows."""

    pace: Any


@visit_wall.form(_Pushing)
@inlined
def _push_row(pushing, one, axes, state, i, touch, spring, value):
    if touch.rho < touch.sigma:
        _, pull = _pull(one, axes, state, i, touch, spring, pushing.pace)
        add_force(axes, state.spins, state.push, i, pull)
    else:
        relax(one.rough, axes, spring)
    return value


@inlined
def _nothing(rough, axes, state, pace, rows):
    return None


@inlined
def _push(rough, axes, state, pace, rows):
    walk_walls(_Pushing(pace), rough, axes, state, rough.stretch_nk, rows, 0)


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


@visit_wall.form(_Summing)
@inlined
def _sum_row(summing, one, axes, state, i, touch, spring, value):
    energy, held = value
    if touch.rho < touch.sigma:
        here, pull = _pull(one, axes, state, i, touch, spring, summing.now)
        energy += _energy_of_springs(one.rough, here, pull)
        held += _held_there(one.rough, here, pull.normal)
    return energy, held


@inlined
def _no_sums(rough, axes, state, now):
    return 0.0, 0.0


@inlined
def _sum_energy(rough, axes, state, now):
    rows = 0, state.body.shape[0]
    return walk_walls(_Summing(now), rough, axes, state, rough.stretch_nk, rows, (0.0, 0.0))


class _Writing(NamedTuple):
    """The visitor that writes down the stretches of springs."""

    now: Any
    stretch_nk: Any


@visit_wall.form(_Writing)
@inlined
def _write_row(writing, one, axes, state, i, touch, spring, value):
    if touch.rho < touch.sigma:
        _, pull = _pull(one, axes, state, i, touch, spring, writing.now)
        write_springs(one.rough, axes, writing.stretch_nk, i, spring.k, pull)
    return value


@lean
def _write_down(rough, axes, state, now, stretch_nk):
    rows = 0, state.body.shape[0]
    walk_walls(_Writing(now, stretch_nk), rough, axes, state, rough.stretch_nk, rows, 0)


def stretches_at_walls(system: Any, now: Any) -> NDArray[np.float64]:
    """Return the stretches of rows at rough walls at the time of the force taken last, `now`; no columns without."""
    rough = system.acting.walls
    if rough is None:
        return np.zeros((len(system.state.body), 0))
    # stiffnesses are those of this time
    found: NDArray[np.float64] = rough.stretch_nk.copy()
    _write_down(rough, system.axes, system.state, now, found)
    return found


# adds what rough walls do across to rows whose push holds all else that acts on single ones
push_of_rough_walls = by_type(_nothing, {RoughWalls: _push})
# the energy of the springs of rough walls, and what they can hold at their caps
energy_at_walls = by_type(_no_sums, {RoughWalls: _sum_energy})
