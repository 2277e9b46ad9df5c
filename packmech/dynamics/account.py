# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The energy account of time steps: what every force does in its two kicks, channel by channel, and what that leaves.

A force f that kicks velocities from v to v' for a time t does the work t f.(v + v')/2 on them, exactly. So the kinetic
energy, summed over rows, changes in a kick by the sum of such works over contacts, bonds and single particles but for
rounding, and between kicks where a box that deforms changes peculiar velocities, or a heat bath any. What a channel
takes up, less what it then stores, is the error of the integrator. So is what shapes in space gain in kinetic energy as
they turn between kicks, where nothing twists them: a channel that stores nothing.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.dynamics.bonds import bond_energy, bond_first, bond_vector, pull_of_bond
from packmech.dynamics.by_shape import (
    dragged_to,
    energy_of_row,
    push_on_row,
    spin_of_turn,
    steepness,
    touch_of_rows,
    touches_of,
    with_torques_of_slopes,
)
from packmech.dynamics.contact_forces import (
    ContactLaws,
    energy_of,
    has_interactions,
    laws_of,
    normal_under_cap,
    pull_beyond,
    remember,
    resistance_at,
    slipping_of_touch,
    slope_of,
    spring_of,
)
from packmech.dynamics.deformation import relative, turning, with_flow
from packmech.dynamics.faces import DRAG as FACE_DRAG
from packmech.dynamics.faces import FORCE, HALF, INVERSE, VELOCITY, WHOLE, Faces
from packmech.dynamics.faces import HELD as FACE_HELD
from packmech.dynamics.friction import (
    Across,
    Now,
    Spring,
    across_contact,
    follow_stiffness,
    resist_rolling,
    resist_twisting,
    rolling_columns,
    sliding_columns,
    spring_columns,
    stretch_of_force,
    tangential_force,
    torque_of,
    torque_of_rolling,
    torque_of_twisting,
    turning_axes,
)
from packmech.dynamics.stretches import inner_stretches
from packmech.dynamics.wall_friction import (
    MovingWall,
    VisitedWalls,
    energy_of_push,
    faces_of,
    normal_at_moving_wall,
    release_springs,
    slipping_at_wall,
    visit_wall,
    walk_walls,
)
from packmech.effects import (
    ConstantRolling,
    MeshRows,
    Mindlin,
    RoughContacts,
    ViscousRolling,
    Walls,
    on_row,
    spin_drag,
)
from packmech.effects.interaction import memory_at, memory_size, remembered_energy, remembers
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, device, inlined, lean
from packmech.jit.threads import is_first, wait
from packmech.minimize.passes.kind_rows import partners_of_rows
from packmech.minimize.passes.pair_list import is_near, visit, walk_pairs

# channels that store energy, that dissipate it, and through which work comes in
STORING = (
    "contacts",
    "interactions",
    "tangential",
    "rolling",
    "twisting",
    "bonds",
    "bond_tangential",
    "bodies",
    "walls",
    "pistons",
    "turning",
)
DISSIPATING = (
    "normal_dashpots", "tangential_dashpots", "sliding", "rolling", "twisting", "bond_dashpots", "breaking", "drag",
    "wall_dashpots", "stiffness_changes", "interactions", "piston_dashpots",
)  # fmt: skip
WORKING = ("box", "held", "pushing", "bath", "moved_walls", "held_stress")
CONTACTS, INTERACTIONS, TANGENTIAL, ROLLING, TWISTING, BONDS, BOND_TANGENTIAL, BODIES, WALLS, PISTONS = range(10)
TURNING = 10
DASHPOTS, TANGENTIAL_DASHPOTS, SLIDING, ROLLED, TWISTED, BOND_DASHPOTS, BREAKING, DRAG, WALL_DASHPOTS = range(11, 20)
STIFFNESS_CHANGES, FORMING, PISTON_DASHPOTS = 20, 21, 22
BOX, HELD, PUSHING, BATH, MOVED_WALLS, HELD_STRESS = range(23, 29)
CHANNELS, STORED = 29, 11
# columns of the figures: sums over the time so far, energies stored now, kinetic energy of what is free, now and once
# it is kicked, of the latter what shapes in space have as they turn, energy of single particles that wrapping took
# away, and what the next step's first kick adds to each sum
ENERGY, KINETIC, KICKED, TURNED, SHIFT = CHANNELS, *(CHANNELS + STORED + k for k in range(4))
AHEAD = SHIFT + 1
FIGURES = AHEAD + CHANNELS
# columns of a block: works of the last kick, of the first one, energies, kinetic ones before, between and after them,
# and those of shapes in space that turn, before and after
_EARLY, _ENERGY, _BEFORE, _BETWEEN, _AFTER = CHANNELS, 2 * CHANNELS, *(2 * CHANNELS + STORED + k for k in range(3))
_BEFORE_TURN, _AFTER_TURN = _AFTER + 1, _AFTER + 2
_COLUMNS = _AFTER_TURN + 1
# of the contact at which a step left most, and of the one that gave most energy from where it is dissipated: how much,
# its rows, and the time
LEFT, GAVE = 0, 4
WORST = 8


class Account(NamedTuple):
    """What a ledger needs: figures by the columns above, the same by blocks, the worst contacts, and scratch.

    late_nk and early_nk hold the mean velocities of rows in the last kick of a step and in the first of the next, then
    of a row that never moves, which walls stand for, and of the faces of walls that move; still_nk the rows at rest,
    spring_pk and wall_nk the springs of pairs and of walls before the forces of a step (None where there are none).
    """

    number: NDArray[np.float64]
    part_bk: NDArray[np.float64]
    worst: NDArray[np.float64]
    worst_bk: NDArray[np.float64]
    late_nk: NDArray[np.float64]
    early_nk: NDArray[np.float64]
    still_nk: NDArray[np.float64]
    spring_pk: Any
    wall_nk: Any


def new_account(body: NDArray[np.float64], width: int, blocks: int, faces: int = 0) -> Account:
    """Return an account of rows with so many velocities each and of faces, in blocks, in which nothing has happened."""
    rows = len(body) + 1 + faces
    return Account(
        np.zeros(FIGURES), np.zeros((blocks, _COLUMNS)), np.zeros(WORST), np.zeros((blocks, WORST)),
        np.zeros((rows, width)), np.zeros((rows, width)), np.zeros_like(body), None, None,
    )  # fmt: skip


class Kicks(NamedTuple):
    """The times of the last kick of a step and of the first of the next, and whether only forces are taken, at first.

    No kick comes before these.
    """

    late: float
    early: float
    at_start: bool


class Accounting(NamedTuple):
    """The visitor that adds up what contacts do in the kicks."""

    account: Account
    kicks: Kicks
    b: Any


@inlined
def _rate_of(laws, mean_nk, pair, force, on_i, on_j):
    """Return what a force on i, the opposite one on j, and torques take from rows that move at mean velocities."""
    axes, i, j = laws.axes, pair.i, pair.j
    d = len(axes)
    rate = force[0] * (mean_nk[j, 0] - mean_nk[i, 0]) + force[1] * (mean_nk[j, 1] - mean_nk[i, 1])
    if d == 3:
        rate += force[2] * (mean_nk[j, 2] - mean_nk[i, 2])
    if mean_nk.shape[1] > d:
        if d == 2:
            rate -= on_i[2] * mean_nk[i, 2] + on_j[2] * mean_nk[j, 2]
        else:
            for a in range(3):
                rate -= on_i[a] * mean_nk[i, 3 + a] + on_j[a] * mean_nk[j, 3 + a]
    return rate


@inlined
def _carried(laws, pair, force):
    """Return what a box that deforms does against a force on i and the opposite one on j [power]."""
    x, y, z = with_flow(laws.rates, 0.0, 0.0, 0.0, pair.dx, pair.dy, pair.dz)
    return force[0] * x + force[1] * y + force[2] * z


@inlined
def _taken(visiting, laws, pair, force, on_i, on_j):
    """Return what a force takes up in the last kick and in the first: from rows, and from a box that deforms."""
    kicks, carried = visiting.kicks, _carried(laws, pair, force)
    late = kicks.late * (_rate_of(laws, visiting.account.late_nk, pair, force, on_i, on_j) + carried)
    return late, kicks.early * (_rate_of(laws, visiting.account.early_nk, pair, force, on_i, on_j) + carried)


@inlined
def _supply(visiting, laws, pair, force):
    """Book what of that the box supplies."""
    carried = _carried(laws, pair, force)
    _add(visiting, BOX, visiting.kicks.late * carried, visiting.kicks.early * carried)


@inlined
def _add(visiting, channel, late, early):
    visiting.account.part_bk[visiting.b, channel] += late
    visiting.account.part_bk[visiting.b, _EARLY + channel] += early


@inlined
def _store(visiting, channel, energy):
    visiting.account.part_bk[visiting.b, _ENERGY + channel] += energy


@inlined
def _compare(visiting, pair, place, value):
    worst_bk, b = visiting.account.worst_bk, visiting.b
    # written so that what is not a number is the largest
    if not value <= worst_bk[b, place]:
        worst_bk[b, place] = value
        worst_bk[b, place + 1], worst_bk[b, place + 2] = pair.i, pair.j


@inlined
def _compare_left(visiting, pair, late, early):
    # before the first step there is one kick alone
    if not visiting.kicks.at_start:
        _compare(visiting, pair, LEFT, abs(early - late))


_NOTHING = (0.0, 0.0, 0.0)


@inlined
def _plain(across):
    return across.fx, across.fy, across.fz


@inlined
def _along(axes, across, x, y, z):
    """Return the product of a tangential force and a displacement of its spring."""
    return across.mz * x if len(axes) == 2 else across.fx * x + across.fy * y + across.fz * z


@inlined
def _of_spring(one, axes, spring, slip, pace):
    """Return the spring's part of a force that was taken, with the stretch it was left with."""
    x, y, z = stretch_of_force(axes, spring, slip, Now(pace.after))
    k = one.stiffness
    return across_contact(axes, slip, (k * x, k * y, k * z), x, y, z, 0.0)


@inlined
def _share_out(visiting, axes, one, slip, whole, spring, across, elastic, channels):
    """Book what a resistance took up: its spring, and what is lost to its dashpot or, at its cap, as it gives way.

    whole and spring are what the force and the spring's part of it take up in both kicks. What gives way in a step does
    so under the mean of the forces at its ends; that at its start is less by what the spring was stretched since.
    """
    stored, damped, slid = channels
    k, dt = one.stiffness, visiting.kicks.late + visiting.kicks.early
    x, y, z = across.x - elastic.x, across.y - elastic.y, across.z - elastic.z
    slack = _along(axes, elastic, x, y, z)
    slack += 0.5 * k * (x * (x - dt * slip.sx) + y * (y - dt * slip.sy) + z * (z - dt * slip.sz))
    late, early = whole[0] - spring[0] + slack, whole[1] - spring[1]
    _add(visiting, stored, spring[0] - slack, spring[1])
    _add(visiting, slid if across.sliding > 0.0 else damped, late, early)
    square = elastic.x * elastic.x + elastic.y * elastic.y + elastic.z * elastic.z
    _store(visiting, stored, 0.5 * k * square)
    return late + early


@inlined
def _no_resistance(one, visiting, laws, pair, spring, slip, turns, normal):
    return 0.0


@inlined
def _account_rolling(one, visiting, laws, pair, spring, slip, turns, normal):
    axes, roll = laws.axes, turns.roll
    across = resist_rolling(one, axes, spring, roll, normal, laws.pace)
    elastic = _of_spring(one, axes, spring, roll, laws.pace)
    x, y, z = torque_of_rolling(across, turns.arm, slip)
    whole = _taken(visiting, laws, pair, _NOTHING, (x, y, z), (-x, -y, -z))
    x, y, z = torque_of_rolling(elastic, turns.arm, slip)
    part = _taken(visiting, laws, pair, _NOTHING, (x, y, z), (-x, -y, -z))
    return _share_out(visiting, axes, one, roll, whole, part, across, elastic, (ROLLING, ROLLED, ROLLED))


@inlined
def _account_rolling_dashpot(one, visiting, laws, pair, spring, slip, turns, normal):
    across = resist_rolling(one, laws.axes, spring, turns.roll, normal, laws.pace)
    x, y, z = torque_of_rolling(across, turns.arm, slip)
    late, early = _taken(visiting, laws, pair, _NOTHING, (x, y, z), (-x, -y, -z))
    _add(visiting, ROLLED, late, early)
    return late + early


@inlined
def _account_twisting(one, visiting, laws, pair, spring, slip, turns, normal):
    axes, twist = laws.axes, turns.twist
    across = resist_twisting(one, axes, spring, twist, normal, laws.pace)
    # one number, as the slip of a plane
    elastic = _of_spring(one, (0, 1), spring, twist, laws.pace)
    x, y, z = torque_of_twisting(across, turns.arm, slip)
    whole = _taken(visiting, laws, pair, _NOTHING, (x, y, z), (-x, -y, -z))
    x, y, z = torque_of_twisting(elastic, turns.arm, slip)
    part = _taken(visiting, laws, pair, _NOTHING, (x, y, z), (-x, -y, -z))
    return _share_out(visiting, (0, 1), one, twist, whole, part, across, elastic, (TWISTING, TWISTED, TWISTED))


_rolling = by_type(
    _account_rolling,
    {type(None): _no_resistance, ConstantRolling: _account_rolling_dashpot, ViscousRolling: _account_rolling_dashpot},
)
_twisting = by_type(_account_twisting, {type(None): _no_resistance})


@inlined
def _same_stiffness(kind, visiting, axes, spring, stiffness, pace):
    return 0.0


@inlined
def _other_stiffness(kind, visiting, axes, spring, stiffness, pace):
    before = _spring_energy(kind, axes, spring)
    follow_stiffness(kind, axes, spring, stiffness, pace)
    # a stretch that was handed on without a stiffness belongs to the present one
    lost = before - _spring_energy(kind, axes, spring) if before > 0.0 else 0.0
    _add(visiting, TANGENTIAL, -lost, 0.0)
    _add(visiting, STIFFNESS_CHANGES, lost, 0.0)
    return lost


@inlined
def _energy_of_number(stiffness, axes, spring):
    stretch, p, k = spring
    square = 0.0
    for a in range(len(turning_axes(0.0, axes))):
        square += stretch[p, k + a] * stretch[p, k + a]
    return 0.5 * stiffness * square


@inlined
def _energy_of_kept(kind, axes, spring):
    # of Mindlin's spring the stiffness that the stretch belongs to is kept beside it
    return _energy_of_number(spring.stretch_pk[spring.p, spring.k + len(turning_axes(0.0, axes))], axes, spring)


# the energy of a tangential spring by its stiffness: a number, or a rule of which the number is kept
_spring_energy = by_type(_energy_of_number, {Mindlin: _energy_of_kept})
# lets a spring follow the stiffness of its contact, and books what that takes from it; returns that
_follow_stiffness = by_type(_same_stiffness, {Mindlin: _other_stiffness})


@inlined
def _account_sliding(friction, visiting, laws, pair, slipping, spring, normal):
    axes, (here, slip, _) = laws.axes, slipping
    lost = _follow_stiffness(friction.stiffness, visiting, axes, spring, here.stiffness, laws.pace)
    across = tangential_force(here, axes, spring, slip, normal, laws.pace)
    elastic = _of_spring(here, axes, spring, slip, laws.pace)
    _supply(visiting, laws, pair, _plain(across))
    li, lj = slip.lever_i, slip.lever_j
    whole = _taken(visiting, laws, pair, _plain(across), torque_of(li, across), torque_of(lj, across))
    part = _taken(visiting, laws, pair, _plain(elastic), torque_of(li, elastic), torque_of(lj, elastic))
    channels = TANGENTIAL, TANGENTIAL_DASHPOTS, SLIDING
    return lost + _share_out(visiting, axes, here, slip, whole, part, across, elastic, channels)


@inlined
def _account_roughness(rough, visiting, laws, pair, slipping, spring, normal):
    axes, (_, slip, turns) = laws.axes, slipping
    stretch, p, column = spring
    lost = _account_sliding(rough.friction, visiting, laws, pair, slipping, spring, normal)
    # columns as where the forces are taken
    column += len(sliding_columns(rough.friction, axes))
    lost += _rolling(rough.rolling, visiting, laws, pair, Spring(stretch, p, column), slip, turns, normal)
    column += len(rolling_columns(rough.rolling, axes))
    return lost + _twisting(rough.twisting, visiting, laws, pair, Spring(stretch, p, column), slip, turns, normal)


# books what acts across a contact that slips; returns how much of it is dissipated
_account_slipping = by_type(_account_sliding, {RoughContacts: _account_roughness})


@inlined
def _without_friction(friction, visiting, laws, pair, k, touch, u, normal):
    return 0.0


@inlined
def _with_friction(friction, visiting, laws, pair, k, touch, u, normal):
    slipping = slipping_of_touch(friction, laws, pair, k, touch, u)
    return _account_slipping(friction, visiting, laws, pair, slipping, spring_of(laws, pair, k), normal)


# the same at a touch of two rows
_account_across = by_type(_with_friction, {type(None): _without_friction})


@inlined
def _no_spring(one, visiting, axes, spring, stored, slid):
    return None


@inlined
def _release(one, visiting, axes, spring, stored, slid):
    """Book the energy of a spring that is let go where a touch has opened."""
    energy = _spring_energy(one.stiffness, axes, spring)
    _add(visiting, stored, -energy, 0.0)
    _add(visiting, slid, energy, 0.0)


_release_spring = by_type(_release, {type(None): _no_spring, ConstantRolling: _no_spring, ViscousRolling: _no_spring})


@inlined
def _release_friction(friction, visiting, axes, spring):
    _release_spring(friction, visiting, axes, spring, TANGENTIAL, SLIDING)


@inlined
def _release_roughness(rough, visiting, axes, spring):
    stretch, p, column = spring
    _release_spring(rough.friction, visiting, axes, spring, TANGENTIAL, SLIDING)
    column += len(sliding_columns(rough.friction, axes))
    _release_spring(rough.rolling, visiting, axes, Spring(stretch, p, column), ROLLING, ROLLED)
    column += len(rolling_columns(rough.rolling, axes))
    # one number, as the slip of a plane
    _release_spring(rough.twisting, visiting, (0, 1), Spring(stretch, p, column), TWISTING, TWISTED)


# books the springs of a contact that is open
_release_springs = by_type(_release_friction, {RoughContacts: _release_roughness})


@inlined
def _release_at_touch(friction, visiting, laws, pair, k):
    _release_springs(friction, visiting, laws.axes, spring_of(laws, pair, k))


# the same at a touch of two rows
_release_across = by_type(_release_at_touch, {type(None): lambda friction, visiting, laws, pair, k: None})


def _form_and_break(effects: Any, visiting: Any, laws: Any, pair: Any) -> None:
    """Bring what effects remember of a pair to its distance, and book the energy that this takes."""
    raise NotImplementedError("works are summed in compiled loops")


@inlined
def _formed_and_broken(effects, visiting, laws, pair):
    r = math.sqrt(pair.dx * pair.dx + pair.dy * pair.dy + pair.dz * pair.dz)
    lost = _remembered_energy(effects, laws, pair, r)
    remember(effects, laws, pair)
    lost -= _remembered_energy(effects, laws, pair, r)
    _add(visiting, INTERACTIONS, -lost, 0.0)
    _add(visiting, FORMING, lost, 0.0)
    _compare(visiting, pair, GAVE, -lost)


@inlined
def _remembered_energy(effects, laws, pair, r):
    partners = partners_of_rows(effects, laws.body, pair.i, pair.j)
    column, energy = len(spring_columns(laws.friction, laws.axes)), 0.0
    for one in literal_unroll(effects):
        energy += remembered_energy(one, r, partners, memory_at(one, laws.stretch_pk, pair.p, column))
        column += memory_size(one)
    return energy


@compiled_form(_form_and_break, inline=True)
def _choose_form_and_break(effects: Any, visiting: Any, laws: Any, pair: Any) -> Any:
    return _formed_and_broken if any(remembers(one) for one in effects) else lambda effects, visiting, laws, pair: None


def _account_beyond(effects: Any, visiting: Any, laws: Any, pair: Any) -> None:
    """Book what a pair's interactions beyond contact do; nothing where a scene has none."""
    raise NotImplementedError("works are summed in compiled loops")


@inlined
def _beyond(effects, visiting, laws, pair):
    _form_and_break(effects, visiting, laws, pair)
    energy, pull = pull_beyond(effects, laws, pair)
    force = pull.fx, pull.fy, pull.fz
    _supply(visiting, laws, pair, force)
    late, early = _taken(visiting, laws, pair, force, pull.on_i, pull.on_j)
    _add(visiting, INTERACTIONS, late, early)
    _store(visiting, INTERACTIONS, energy)
    _compare_left(visiting, pair, late, early)


@compiled_form(_account_beyond, inline=True)
def _choose_account_beyond(effects: Any, visiting: Any, laws: Any, pair: Any) -> Any:
    return _beyond if has_interactions(effects) else lambda effects, visiting, laws, pair: None


@visit.form(Accounting)
@inlined
def _account_pair(visiting, laws, pair, value):
    effects, axes, shapes = laws.effects, laws.axes, laws.shapes
    _account_beyond(effects, visiting, laws, pair)
    near = is_near(laws, pair)
    for k in range(touches_of(shapes, pair.i, pair.j)):
        touching = False
        if near:
            touch = touch_of_rows(shapes, axes, laws.body, pair, k)
            if touch.touching:
                touching = True
                _account_touch(effects, visiting, laws, pair, k, touch)
        if not touching:
            _release_across(laws.friction, visiting, laws, pair, k)
    return value


@inlined
def _account_touch(effects, visiting, laws, pair, k, touch):
    u = relative(laws.rates, laws.axes, laws.body, pair.i, pair.j, pair.dx, pair.dy, pair.dz)
    elastic = slope_of(effects, pair, touch)
    damped = resistance_at(effects, laws, pair, touch, u, elastic)
    normal = normal_under_cap(effects, pair, touch, abs(elastic) * steepness(laws.shapes, touch))
    # what a derivative of one takes up, times the derivatives
    slope = touch.x, touch.y, touch.z
    on_i, on_j = with_torques_of_slopes(laws.shapes, touch, 1.0, _NOTHING, _NOTHING)
    late, early = _taken(visiting, laws, pair, slope, on_i, on_j)
    first = elastic + damped
    _supply(visiting, laws, pair, (first * touch.x, first * touch.y, first * touch.z))
    _add(visiting, CONTACTS, elastic * late, elastic * early)
    _add(visiting, DASHPOTS, damped * late, damped * early)
    _store(visiting, CONTACTS, energy_of(effects, pair, touch))
    lost = _account_across(laws.friction, visiting, laws, pair, k, touch, u, normal)
    _compare(visiting, pair, GAVE, -(damped * (late + early) + lost))
    _compare_left(visiting, pair, elastic * late, elastic * early)


class Singly(NamedTuple):
    """The visitor that does the same with a row of the account for each listed pair, the first of them left free."""

    account: Account
    kicks: Kicks


@visit.form(Singly)
@inlined
def _account_singly(visiting, laws, pair, value):
    return _account_pair(Accounting(visiting.account, visiting.kicks, np.int64(pair.p) + 1), laws, pair, value)


@inlined
def _account_pairs(effects, account, kicks, laws, pairs, b):
    walk_pairs(Accounting(account, kicks, b), laws, pairs, b, 0)


_account_contacts = by_type(_account_pairs, {type(None): lambda effects, account, kicks, laws, pairs, b: None})


@inlined
def _each_pair(effects, account, kicks, laws, pairs, b):
    walk_pairs(Singly(account, kicks), laws, pairs, b, 0)


_account_each = by_type(_each_pair, {type(None): lambda effects, account, kicks, laws, pairs, b: None})


class _Ends(NamedTuple):
    """The rows of a bond, and the vector between them."""

    i: Any
    j: Any
    dx: float
    dy: float
    dz: float


@device
def _row_of(block, first, b):
    """Return the row of the account of a bond: its block's, or its own beyond a first one."""
    return np.int64(block) if first == 0 else np.int64(first) + np.int64(b)


@inlined
def _account_bonds(bonds, account, kicks, laws, lattice, block, first):
    axes, k = laws.axes, bonds.tangential_stiffness
    for b in range(np.uint64(bonds.start_s[2 * block]), np.uint64(bonds.start_s[2 * block + 2])):
        visiting = Accounting(account, kicks, _row_of(block, first, b))
        dx, dy, dz = bond_vector(axes, laws.body, bonds, lattice, b)
        pair = _Ends(bonds.i_b[b], bonds.j_b[b], dx, dy, dz)
        pull = pull_of_bond(bonds, laws, b, dx, dy, dz)
        across, r = pull.across, math.sqrt(dx * dx + dy * dy + dz * dz)
        _supply(visiting, laws, pair, (pull.fx, pull.fy, pull.fz))
        late, early = _taken(visiting, laws, pair, (pull.fx, pull.fy, pull.fz), pull.on_i, pull.on_j)
        if r > 0.0:
            slope = bond_first(bonds.compression, bonds.tension, r, bonds.rest_b[b]) / r
            normal = _taken(visiting, laws, pair, (slope * dx, slope * dy, slope * dz), _NOTHING, _NOTHING)
            _add(visiting, BONDS, normal[0], normal[1])
            late -= normal[0]
            early -= normal[1]
            _compare_left(visiting, pair, normal[0], normal[1])
        _store(visiting, BONDS, bond_energy(bonds, b, r))
        # of the force across, which its torques and the levers of its ends go with, the part of the spring
        elastic = _spring_of_bond(axes, k, dx, dy, dz, r, across)
        share = laws.body[pair.i, 3] + laws.body[pair.j, 3]
        li, lj = laws.body[pair.i, 3] * r / share, laws.body[pair.j, 3] * r / share
        spring = _taken(visiting, laws, pair, _plain(elastic), torque_of(li, elastic), torque_of(lj, elastic))
        _add(visiting, BOND_TANGENTIAL, spring[0], spring[1])
        _store(visiting, BOND_TANGENTIAL, 0.5 * k * (across.x * across.x + across.y * across.y + across.z * across.z))
        late -= spring[0]
        early -= spring[1]
        _add(visiting, BOND_DASHPOTS, late, early)
        _compare(visiting, pair, GAVE, -(late + early))


@inlined
def _spring_of_bond(axes, k, dx, dy, dz, r, across):
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    x, y, z = k * across.x, k * across.y, k * across.z
    if len(axes) == 2:
        return Across(x * -ny, x * nx, 0.0, 0.0, 0.0, x, across.x, 0.0, 0.0, 0.0)
    return Across(x, y, z, ny * z - nz * y, nz * x - nx * z, nx * y - ny * x, across.x, across.y, across.z, 0.0)


_account_of_bonds = by_type(
    _account_bonds, {type(None): lambda bonds, account, kicks, laws, lattice, block, first: None}
)


@inlined
def _no_turns(shapes, account, kicks, axes, state, i, b):
    return 0.0


@inlined
def _account_turn(shapes, account, kicks, axes, state, i, b):
    """Do the same with the spin of a shape in space, whose row holds its angular momentum over a moment of inertia."""
    part_bk, inverse, ahead = account.part_bk, state.weight_nk[i, 1], 4 if kicks.at_start else 0
    rows = state.body if kicks.at_start else state.half
    before = rows[i, ahead + 3], rows[i, ahead + 4], rows[i, ahead + 5]
    torque = state.push[i, 3], state.push[i, 4], state.push[i, 5]
    first = spin_of_turn(shapes, axes, i, before[0], before[1], before[2])
    gain = spin_of_turn(shapes, axes, i, inverse * torque[0], inverse * torque[1], inverse * torque[2])
    energy_before = energy_between = energy_after = held = 0.0
    for a in range(3):
        between, after = first[a] + kicks.late * gain[a], first[a] + (kicks.late + kicks.early) * gain[a]
        account.late_nk[i, 3 + a] = 0.5 * (first[a] + between)
        account.early_nk[i, 3 + a] = 0.5 * (between + after)
        held -= torque[a] * between
        momentum, change = before[a], inverse * torque[a]
        energy_before += momentum * first[a]
        energy_between += (momentum + kicks.late * change) * between
        energy_after += (momentum + (kicks.late + kicks.early) * change) * after
    if inverse == 0.0:
        return held
    share = 0.5 / inverse
    part_bk[b, _BEFORE] += share * energy_before
    part_bk[b, _BETWEEN] += share * energy_between
    part_bk[b, _AFTER] += share * energy_after
    part_bk[b, _BEFORE_TURN] += share * energy_before
    part_bk[b, _AFTER_TURN] += share * energy_after
    return 0.0


# sets the mean spins of a row whose spin is not what it holds, and books their energy; returns the power that holds it
_account_turns = by_type(_account_turn, {type(None): _no_turns})


@inlined
def _account_rows(account, kicks, axes, state, shapes, low, high, b):
    """Set the mean velocities of rows in both kicks, and book their kinetic energies and what moves held ones."""
    d, part_bk = len(axes), account.part_bk
    body, push, half, weight = state.body, state.push, state.half, state.weight_nk
    of_shapes = shapes is not None and d == 3
    for i in range(low, high):
        held = 0.0
        if of_shapes:
            held = _account_turns(shapes, account, kicks, axes, state, i, b)
        for a in range(d if of_shapes else push.shape[1]):
            inverse = weight[i, 0] if a < d else weight[i, 1]
            before = body[i, 4 + a] if kicks.at_start else half[i, a]
            between = before + kicks.late * inverse * push[i, a]
            after = between + kicks.early * inverse * push[i, a]
            account.late_nk[i, a] = 0.5 * (before + between)
            account.early_nk[i, a] = 0.5 * (between + after)
            if inverse > 0.0:
                share = 0.5 / inverse
                part_bk[b, _BEFORE] += share * before * before
                part_bk[b, _BETWEEN] += share * between * between
                part_bk[b, _AFTER] += share * after * after
            else:
                held -= push[i, a] * between
        part_bk[b, HELD] += kicks.late * held
        part_bk[b, _EARLY + HELD] += kicks.early * held


@inlined
def _account_singles(bodies, account, kicks, laws, state, shapes, low, high, b):
    visiting = Accounting(account, kicks, b)
    for i in range(low, high):
        _set_still(account.still_nk, laws.body, i)
        for one in literal_unroll(bodies):
            _account_single(one, visiting, laws, state, shapes, i)


@device
def _set_still(still_nk, body, i):
    """Put a row where it is, at rest."""
    for a in range(body.shape[1]):
        still_nk[i, a] = body[i, a] if a < 4 else 0.0


@device
def _account_single(acting, visiting, laws, state, shapes, i):
    one = on_row(acting, i)
    axes, body, account, kicks = laws.axes, laws.body, visiting.account, visiting.kicks
    d, mass = len(axes), state.mass_n[i]
    whole = push_on_row(shapes, one, axes, body, i, mass)
    still = push_on_row(shapes, one, axes, account.still_nk, i, mass)
    x, y, z = with_flow(laws.rates, 0.0, 0.0, 0.0, body[i, 0], body[i, 1], body[i, 2] if d == 3 else 0.0)
    carried = still[0] * x + still[1] * y + still[2] * z
    late, early = _given(account, kicks, axes, i, still)
    _book(one, visiting, late, early, kicks, carried, energy_of_row(shapes, one, body, i, mass))
    whole_late, whole_early = _given(account, kicks, axes, i, whole)
    _resist(one, visiting, late - whole_late, early - whole_early)
    drag, inverse = spin_drag(one), state.weight_nk[i, 1]
    if body.shape[1] > 4 + d and drag > 0.0 and inverse > 0.0:
        _account_spin_drag(visiting, laws, shapes, i, drag / inverse, turning(laws.rates))


@device
def _given(account, kicks, axes, i, push):
    """Return what a force and a torque give a row in both kicks."""
    d, late, early = len(axes), 0.0, 0.0
    for a in range(d):
        late += push[a] * account.late_nk[i, a]
        early += push[a] * account.early_nk[i, a]
    if account.late_nk.shape[1] > d:
        if d == 2:
            late += push[5] * account.late_nk[i, 2]
            early += push[5] * account.early_nk[i, 2]
        else:
            for a in range(3):
                late += push[3 + a] * account.late_nk[i, 3 + a]
                early += push[3 + a] * account.early_nk[i, 3 + a]
    return kicks.late * late, kicks.early * early


@device
def _account_spin_drag(visiting, laws, shapes, i, rate, flow):
    axes, account, kicks, body = laws.axes, visiting.account, visiting.kicks, laws.body
    d = len(axes)
    wx, wy, wz = flow
    if d == 2:
        push = 0.0, 0.0, 0.0, 0.0, 0.0, -rate * (body[i, 6] - wz)
        spun = push[5] * wz
    else:
        ox, oy, oz = dragged_to(shapes, axes, i, wx, wy, wz)
        push = 0.0, 0.0, 0.0, -rate * (body[i, 7] - ox), -rate * (body[i, 8] - oy), -rate * (body[i, 9] - oz)
        spun = push[3] * wx + push[4] * wy + push[5] * wz
    late, early = _given(account, kicks, axes, i, push)
    _add(visiting, DRAG, kicks.late * spun - late, kicks.early * spun - early)
    _add(visiting, BOX, kicks.late * spun, kicks.early * spun)


@inlined
def _book_pushing(one, visiting, late, early, kicks, carried, energy):
    _add(visiting, PUSHING, late, early)


@inlined
def _book_energy(one, visiting, late, early, kicks, carried, energy):
    channel = _channel(one)
    _add(visiting, channel, -late - kicks.late * carried, -early - kicks.early * carried)
    _add(visiting, BOX, -kicks.late * carried, -kicks.early * carried)
    _store(visiting, channel, energy)


# books the force on a row at rest: one with an energy stores what it takes, any other does work
def _book(one: Any, visiting: Any, late: float, early: float, kicks: Any, carried: float, energy: float) -> None:
    raise NotImplementedError("works are summed in compiled loops")


@compiled_form(_book, inline=True)
def _choose_book(one: Any, visiting: Any, late: Any, early: Any, kicks: Any, carried: Any, energy: Any) -> Any:
    return _book_energy if hasattr(one.instance_class, "body_energy") else _book_pushing


_channel = by_type(lambda one: BODIES, {Walls: lambda one: WALLS, MeshRows: lambda one: WALLS})


# books what of a force goes with the velocity
@inlined
def _resist_by_drag(one, visiting, late, early):
    _add(visiting, DRAG, late, early)


@inlined
def _resist_by_wall(one, visiting, late, early):
    _add(visiting, WALL_DASHPOTS, late, early)


_resist = by_type(_resist_by_drag, {Walls: _resist_by_wall, MeshRows: _resist_by_wall})
_account_bodies = by_type(
    _account_singles, {type(None): lambda bodies, account, kicks, laws, state, shapes, low, high, b: None}
)


@inlined
def _account_still(one, visiting, axes, state, i, touch, spring, laws):
    # the row behind all others never moves, as walls do not
    return _account_at_face(one.rough, one, visiting, axes, state, i, touch, spring, laws, state.body.shape[0])


@inlined
def _account_moving(one, visiting, axes, state, i, touch, spring, laws):
    row = state.body.shape[0] + 1 + touch.face
    pair = _Ends(i, row, 0.0, 0.0, 0.0)
    elastic, whole = normal_at_moving_wall(one, axes, state, i, touch)
    damped = whole - elastic
    late, early = _taken(visiting, laws, pair, (touch.x, touch.y, touch.z), _NOTHING, _NOTHING)
    _add(visiting, WALLS, elastic * late, elastic * early)
    _add(visiting, WALL_DASHPOTS, damped * late, damped * early)
    _store(visiting, WALLS, energy_of_push(one, i, touch))
    _compare_left(visiting, pair, elastic * late, elastic * early)
    return damped * (late + early) + _account_at_face(
        one.rough, one, visiting, axes, state, i, touch, spring, laws, row
    )


@inlined
def _account_rough_face(rough, one, visiting, axes, state, i, touch, spring, laws, row):
    slipping, normal = slipping_at_wall(one, axes, state, i, touch)
    pair = _Ends(i, row, 0.0, 0.0, 0.0)
    return _account_slipping(rough, visiting, laws, pair, slipping, spring, normal)


# books what acts across a contact with a wall, the row that stands for it given; returns how much is dissipated
_account_at_face = by_type(
    _account_rough_face,
    {type(None): lambda rough, one, visiting, axes, state, i, touch, spring, laws, row: 0.0},
)
# books what a visited wall does to a row; returns how much is dissipated
_account_wall = by_type(_account_still, {MovingWall: _account_moving})
_release_at_wall = by_type(
    lambda rough, visiting, axes, spring: _release_springs(rough, visiting, axes, spring),
    {type(None): lambda rough, visiting, axes, spring: None},
)


@visit_wall.form(Accounting)
@inlined
def _account_at_wall(visiting, one, axes, state, i, touch, spring, value):
    if touch.rho < touch.sigma:
        lost = _account_wall(one, visiting, axes, state, i, touch, spring, value)
        _compare(visiting, _Ends(i, state.body.shape[0], 0.0, 0.0, 0.0), GAVE, -lost)
    else:
        _release_at_wall(one.rough, visiting, axes, spring)
    return value


@release_springs.form(Accounting)
@inlined
def _release_at_surface(visiting, one, axes, spring):
    _release_at_wall(one.rough, visiting, axes, spring)


@inlined
def _account_walls(visited, account, kicks, laws, state, rows, b):
    walk_walls(Accounting(account, kicks, b), visited, laws.axes, state, account.wall_nk, rows, b, laws)


# books what visited walls do to rows; nothing in a scene without
_account_visited = by_type(lambda visited, account, kicks, laws, state, rows, b: None, {VisitedWalls: _account_walls})


@device
def _account_moved(faces, account, kicks, axes, rows):
    """Set the mean velocities of faces in both kicks, and book what moves them and what they store."""
    visiting, number_fk = Accounting(account, kicks, 0), faces.number_fk
    for f in range(number_fk.shape[0]):
        for a in range(len(axes)):
            inverse = number_fk[f, INVERSE + a]
            force, held, whole = number_fk[f, FORCE + a], number_fk[f, FACE_HELD + a], number_fk[f, WHOLE + a]
            before = number_fk[f, (VELOCITY if kicks.at_start else HALF) + a]
            between = before + kicks.late * inverse * whole
            after = between + kicks.early * inverse * whole
            late, early = 0.5 * (before + between), 0.5 * (between + after)
            account.late_nk[rows + 1 + f, a] = late
            account.early_nk[rows + 1 + f, a] = early
            late *= kicks.late
            early *= kicks.early
            if inverse > 0.0:
                # the dashpot's force as it was taken, at the velocity that was extrapolated
                drag = number_fk[f, FACE_DRAG + a] * number_fk[f, VELOCITY + a]
                _add(visiting, HELD_STRESS, held * late, held * early)
                _add(visiting, PISTON_DASHPOTS, drag * late, drag * early)
                _add(visiting, PISTONS, whole * late, whole * early)
                _store(visiting, PISTONS, 0.5 / inverse * between * between)
            else:
                _add(visiting, MOVED_WALLS, -force * late, -force * early)


# books what faces do that move; nothing in a scene without
_account_faces = by_type(lambda faces, account, kicks, axes, rows: None, {Faces: _account_moved})


@inlined
def _with_springs(laws, pace, stretch_pk):
    return ContactLaws(
        laws.effects, laws.friction, laws.shapes, laws.axes, laws.body, laws.weight_nk, laws.rates, stretch_pk, pace
    )


@device
def _close(account, between, at_start, time):
    """Add the blocks up in their order, and the figures of this time to those before."""
    number, part_bk, worst, worst_bk = account.number, account.part_bk, account.worst, account.worst_bk
    for b in range(1, part_bk.shape[0]):
        for c in range(part_bk.shape[1]):
            part_bk[0, c] += part_bk[b, c]
    node = part_bk[0]
    for c in range(CHANNELS):
        # at the start no kick has come before: what springs give up is all
        number[c] += node[c] if at_start else number[AHEAD + c] + node[c]
    if not at_start:
        # what changes velocities between the kicks: a box that deforms, or a heat bath, which changes spins, too
        turned = 0.0 if between == BATH else node[_BEFORE_TURN] - number[TURNED]
        number[TURNING] -= turned
        if between >= 0:
            number[between] += node[_BEFORE] - number[KICKED] - turned
    for c in range(CHANNELS):
        number[AHEAD + c] = node[_EARLY + c]
    for c in range(STORED):
        number[ENERGY + c] = node[_ENERGY + c]
    number[ENERGY + BODIES] += number[SHIFT]
    number[KINETIC], number[KICKED], number[TURNED] = node[_BETWEEN], node[_AFTER], node[_AFTER_TURN]
    for b in range(worst_bk.shape[0]):
        for place in range(LEFT, WORST, GAVE):
            if not worst_bk[b, place] <= worst[place]:
                for k in range(3):
                    worst[place + k] = worst_bk[b, place + k]
                worst[place + 3] = time


@device
def _copy(stretch_pk, inner_pk, low, high):
    for p in range(low, high):
        for k in range(inner_pk.shape[1]):
            stretch_pk[p, k] = inner_pk[p, k]


_copy_springs = by_type(_copy, {type(None): lambda stretch_pk, inner_pk, low, high: None})


@inlined
def _copy_at_walls(rough, wall_nk, rows):
    _copy(wall_nk, rough.stretch_nk, rows[0], rows[1])


_copy_walls = by_type(lambda rough, wall_nk, rows: None, {VisitedWalls: _copy_at_walls})


@inlined
def _keep(account, system, blocks):
    start, row_b = system.pairs.start_s, system.pairs.row_b
    _copy_springs(account.spring_pk, inner_stretches(system.track), start[2 * blocks[0]], start[2 * blocks[1]])
    _copy_walls(system.acting.walls, account.wall_nk, (row_b[blocks[0]], row_b[blocks[1]]))


# keeps the springs as they are before forces are taken; nothing without an account
keep_springs = by_type(_keep, {type(None): lambda account, system, blocks: None})
_channel_of_flow = by_type(lambda flow: BOX, {type(None): lambda flow: -1})
# the channel of what changes velocities between the kicks, -1 for none: that of the bath, or else of the flow
_channel_between = by_type(lambda bath, flow: BATH, {type(None): lambda bath, flow: _channel_of_flow(flow)})


@inlined
def _no_account(account, system, thread, blocks, pace, kicks, time):
    return None


@inlined
def _book_kicks(account, system, thread, blocks, pace, kicks, time):
    acting, axes, state, space, pairs = system.acting, system.axes, system.state, system.space, system.pairs
    laws, row_b = laws_of(system, pace), pairs.row_b
    springs = _with_springs(laws, pace, account.spring_pk)
    now = _with_springs(laws, Now(pace.after), inner_stretches(system.track))
    wait(thread)
    for b in range(blocks[0], blocks[1]):
        for c in range(account.part_bk.shape[1]):
            account.part_bk[b, c] = 0.0
        for c in range(WORST):
            account.worst_bk[b, c] = 0.0
        _account_rows(account, kicks, axes, state, acting.shapes, row_b[b], row_b[b + 1], b)
    if is_first(thread):
        # in the first block, which is its own
        _account_faces(faces_of(acting.walls), account, kicks, axes, state.body.shape[0])
    wait(thread)
    for b in range(blocks[0], blocks[1]):
        _account_bodies(acting.bodies, account, kicks, laws, state, acting.shapes, row_b[b], row_b[b + 1], b)
        _account_visited(acting.walls, account, kicks, laws, state, (row_b[b], row_b[b + 1]), b)
        _account_contacts(acting.pairs, account, kicks, springs, pairs, b)
        _account_of_bonds(space.bonds, account, kicks, now, space.frame.lattice_dd, b, 0)
    wait(thread)
    if is_first(thread):
        _close(account, _channel_between(state.bath, space.flow), kicks.at_start, time)
    wait(thread)


# books what forces that were taken do in the kicks before and after them; nothing without an account
book_kicks = by_type(_book_kicks, {type(None): _no_account})


@lean
def book_each(system, account, kicks, pace, pairs):
    """Book what each listed pair, then each bond does in kicks, in rows of their own; in the first what acts on rows.

    `pairs` is the number of pairs; the springs of the account are stretched by the pace.
    """
    acting, axes, state, space = system.acting, system.axes, system.state, system.space
    laws, n = laws_of(system, pace), state.body.shape[0]
    springs = _with_springs(laws, pace, account.spring_pk)
    now = _with_springs(laws, Now(pace.after), inner_stretches(system.track))
    # at the velocities as they are
    _account_rows(account, Kicks(0.0, 0.0, True), axes, state, acting.shapes, 0, n, 0)
    _account_bodies(acting.bodies, account, kicks, laws, state, acting.shapes, 0, n, 0)
    for b in range(system.pairs.row_b.shape[0] - 1):
        _account_each(acting.pairs, account, kicks, springs, system.pairs, b)
        _account_of_bonds(space.bonds, account, kicks, now, space.frame.lattice_dd, b, pairs + 1)
