# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What touching rows do to each other, in one place. What a scene lacks is None, and numba leaves out its branches."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import literal_unroll

from packmech.dynamics.by_shape import (
    contact_axes,
    inertia_against,
    law_of_rows,
    place_of_spring,
    rate_of_touch,
    relax_all,
    slip_at_touch,
    steepness,
    touch_of_rows,
    touches_of,
    with_torques_of_slopes,
)
from packmech.dynamics.deformation import rates, relative
from packmech.dynamics.friction import (
    Across,
    Pull,
    Slipping,
    Spring,
    add_force,
    add_reaction,
    energy_of_springs,
    reduced_arm,
    relax,
    resist,
    spin_of_round,
    spring_columns,
    turns_at,
)
from packmech.dynamics.stretches import inner_stretches
from packmech.effects import (
    DampingRatio,
    Friction,
    Mindlin,
    RoughContacts,
    TouchingPair,
    cap_force,
    damps,
    is_interaction,
    mindlin_stiffness,
    pair_damping,
    pair_energy,
    pair_first,
    pair_second,
)
from packmech.effects.interaction import (
    PairLaw,
    bring_memory,
    memory_at,
    memory_size,
    remembering_law,
    remembering_slope,
    remembers,
)
from packmech.effects.kinds import number_at
from packmech.effects.pair import hook_of
from packmech.effects.partners import Partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, inlined
from packmech.minimize.passes.kind_rows import kinds_between, partners_of_rows
from packmech.minimize.passes.pair_list import NO_SLOT, Pair, is_near, visit, walk_pairs
from packmech.minimize.passes.shape_rows import partners_at

# what stands for no stiffness where a spring is divided by it
_NO_STIFFNESS = 1e-200
# what `Pull` says of a tangential spring where there is none
_NO_SPRING = Across(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class ContactLaws(NamedTuple):
    """What acts at contacts, and what it depends on.

    Effects on pairs, friction (with what resists rolling, `RoughContacts`) and shapes (None without), axes, rows, their
    inverse masses and moments of inertia, rates of the flow, the stretches of tangential springs, and at which time
    they are taken: a `Pace` or `Now`.
    """

    effects: Any
    friction: Any
    shapes: Any
    axes: Any
    body: Any
    weight_nk: Any
    rates: Any
    stretch_pk: Any
    pace: Any


@inlined
def laws_of(system, pace):
    """Return what acts at contacts in a system as it is, at this pace."""
    acting = system.acting
    return ContactLaws(
        acting.pairs,
        acting.friction,
        acting.shapes,
        system.axes,
        system.state.body,
        system.state.weight_nk,
        rates(system.space.flow),
        inner_stretches(system.track),
        pace,
    )


@inlined
def energy_of(effects, pair, touch):
    """Return the energy of a contact."""
    energy, partners = 0.0, partners_at(effects, pair.i, pair.j, touch)
    for one in literal_unroll(effects):
        energy += pair_energy(one, touch.rho, partners)
    return energy


@inlined
def slope_of(effects, pair, touch):
    """Return the derivative of the energy of a contact by its distance."""
    slope, partners = 0.0, partners_at(effects, pair.i, pair.j, touch)
    for one in literal_unroll(effects):
        slope += pair_first(one, touch.rho, partners)
    return slope


@inlined
def _number(number, *others):
    return number


@inlined
def _stiffness_of(mindlin, laws, pair, touch):
    kinds = kinds_between(laws.effects, pair.i, pair.j)
    _, second = _law_of_touch(laws.effects, touch, kinds)
    steep = steepness(laws.shapes, touch)
    # of a law without stiffness there is no spring, and no division by it
    return max(mindlin_stiffness(mindlin, second * steep * steep, kinds), _NO_STIFFNESS)


@inlined
def _dashpot_of(damping, laws, pair, touch, u):
    elastic = slope_of(laws.effects, pair, touch)
    _, coefficient = rate_and_dashpot(laws.effects, laws, pair, touch, u, elastic)
    return damping.ratio * coefficient


_stiffness_here = by_type(_number, {Mindlin: _stiffness_of})
_dashpot_here = by_type(_number, {DampingRatio: _dashpot_of})


@inlined
def friction_here(friction, laws, pair, touch, u):
    """Return the friction with the numbers that it has at a contact."""
    stiffness = _stiffness_here(friction.stiffness, laws, pair, touch)
    coefficient = number_at(friction.coefficient, kinds_between(laws.effects, pair.i, pair.j))
    return Friction(coefficient, stiffness, _dashpot_here(friction.damping, laws, pair, touch, u))


@inlined
def _energy_without(friction, laws, pair, touch, pull):
    return 0.0


@inlined
def _energy_here(friction, laws, pair, touch, pull):
    k = _stiffness_here(friction.stiffness, laws, pair, touch)
    return energy_of_springs(Friction(friction.coefficient, k, 0.0), pull)


@inlined
def _energy_of_rough(rough, laws, pair, touch, pull):
    k = _stiffness_here(rough.friction.stiffness, laws, pair, touch)
    here = Friction(rough.friction.coefficient, k, 0.0)
    return energy_of_springs(RoughContacts(here, rough.rolling, rough.twisting), pull)


# the energy of the springs of a touch, from what its pull says of them; 0 without friction
energy_across = by_type(_energy_here, {type(None): _energy_without, RoughContacts: _energy_of_rough})


@inlined
def _no_friction(friction, laws, pair, k, touch, u, normal):
    nothing = 0.0, 0.0, 0.0
    return _NO_SPRING, None, nothing, nothing


@inlined
def _slipping(friction, laws, pair, k, touch, u):
    slip = slip_at_touch(laws.shapes, laws.axes, laws.body, pair, k, touch, u)
    return Slipping(friction_here(friction, laws, pair, touch, u), slip, None)


@inlined
def _slipping_and_turning(rough, laws, pair, k, touch, u):
    axes, body = laws.axes, laws.body
    slip = slip_at_touch(laws.shapes, axes, body, pair, k, touch, u)
    here = friction_here(rough.friction, laws, pair, touch, u)
    wi, wj = spin_of_round(axes, body, pair.i), spin_of_round(axes, body, pair.j)
    return Slipping(here, slip, turns_at(axes, reduced_arm(slip), wi, wj, slip))


# how a touch slips, against which friction, and how its rows turn where that is resisted
slipping_of_touch = by_type(_slipping, {RoughContacts: _slipping_and_turning})


@inlined
def _friction_of_touch(friction, laws, pair, k, touch, u, normal):
    here, slip, turns = slipping_of_touch(friction, laws, pair, k, touch, u)
    return resist(friction, laws.axes, here, slip, turns, spring_of(laws, pair, k), normal, laws.pace)


# the tangential force, what resists rolling and twisting (None without), and torques on both rows
friction_at = by_type(_friction_of_touch, {type(None): _no_friction})


def resistance_at(effects: Any, laws: Any, pair: Any, touch: Any, u: Any, elastic: Any) -> Any:
    """Return the part of dashpots in the radial derivative of a touch; zero where a scene has none."""
    raise NotImplementedError("contacts act in compiled loops")


@inlined
def rate_and_dashpot(effects, laws, pair, touch, u, elastic):
    """Return the rate of the distance of a touch, and the coefficient of its dashpots."""
    rate = rate_of_touch(laws.shapes, laws.axes, laws.body, pair, touch, u)
    mass = inertia_against(laws.shapes, laws.axes, laws.weight_nk, pair, touch)
    kinds = kinds_between(effects, pair.i, pair.j)
    energy, second = _law_of_touch(effects, touch, kinds)
    known = TouchingPair(touch.rho, touch.sigma, rate, energy, elastic, second, mass, touch.effective_radius, kinds)
    coefficient = 0.0
    for one in literal_unroll(effects):
        coefficient += pair_damping(one, known)
    return rate, coefficient


@inlined
def _resistance_at(effects, laws, pair, touch, u, elastic):
    rate, coefficient = rate_and_dashpot(effects, laws, pair, touch, u, elastic)
    return coefficient * rate


@compiled_form(resistance_at, inline=True)
def _choose_resistance_at(effects: Any, laws: Any, pair: Any, touch: Any, u: Any, elastic: Any) -> Any:
    if any(damps(one) for one in effects):
        return _resistance_at
    return lambda effects, laws, pair, touch, u, elastic: 0.0


@inlined
def _law_of_touch(effects, touch, kinds):
    energy = 0.0
    second = 0.0
    partners = Partners(touch.sigma, touch.effective_radius, kinds)
    for one in literal_unroll(effects):
        energy += pair_energy(one, touch.rho, partners)
        second += pair_second(one, touch.rho, partners)
    return energy, second


def normal_under_cap(effects: Any, pair: Any, touch: Any, normal: Any) -> Any:
    """Return the normal force that Coulomb's limit is made of; the same where a scene has no cohesion."""
    raise NotImplementedError("contacts act in compiled loops")


@inlined
def _with_cohesion(effects, pair, touch, normal):
    partners = partners_at(effects, pair.i, pair.j, touch)
    for one in literal_unroll(effects):
        normal += cap_force(one, touch.rho, partners)
    return max(normal, 0.0)


@compiled_form(normal_under_cap, inline=True)
def _choose_normal_under_cap(effects: Any, pair: Any, touch: Any, normal: Any) -> Any:
    if any(hook_of(one, "cap_force") is not None for one in effects):
        return _with_cohesion
    return lambda effects, pair, touch, normal: normal


@inlined
def spring_of(laws, pair, k):
    """Return where the spring of the k-th touch of a pair stands."""
    columns = spring_columns(laws.friction, laws.axes)
    return Spring(laws.stretch_pk, pair.p, place_of_spring(laws.shapes, columns, laws.stretch_pk, pair, k))


@inlined
def pull_of_touch(laws, pair, k, touch):
    """Return what two rows do to each other where they touch for the k-th time: all forces at contacts are made here.

    Effects give the derivative of the energy by the distance rho, and dashpots add to it; its slopes make forces and
    torques of it. Friction adds what acts across.
    """
    effects = laws.effects
    u = relative(laws.rates, laws.axes, laws.body, pair.i, pair.j, pair.dx, pair.dy, pair.dz)
    elastic = slope_of(effects, pair, touch)
    first = elastic + resistance_at(effects, laws, pair, touch, u, elastic)
    normal = abs(elastic) * steepness(laws.shapes, touch)
    under_cap = normal_under_cap(effects, pair, touch, normal)
    across, turning, on_i, on_j = friction_at(laws.friction, laws, pair, k, touch, u, under_cap)
    on_i, on_j = with_torques_of_slopes(laws.shapes, touch, first, on_i, on_j)
    return Pull(
        first * touch.x + across.fx, first * touch.y + across.fy, first * touch.z + across.fz,
        on_i, on_j, normal, across, turning,
    )  # fmt: skip


@inlined
def _forgetful_law(effects, laws, pair, r):
    return law_of_rows(laws.shapes, effects, laws.body, pair.i, pair.j, r)


@inlined
def _remembering_law(effects, laws, pair, r):
    partners = partners_of_rows(effects, laws.body, pair.i, pair.j)
    column = len(spring_columns(laws.friction, laws.axes))
    energy = first = 0.0
    for one in literal_unroll(effects):
        law = remembering_law(one, r, partners, 1.0, memory_at(one, laws.stretch_pk, pair.p, column))
        energy += law.energy
        first += law.first
        column += memory_size(one)
    return PairLaw(energy, first, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0


@inlined
def _slope_alone(effects, laws, pair, r):
    partners = partners_of_rows(effects, laws.body, pair.i, pair.j)
    column = len(spring_columns(laws.friction, laws.axes))
    first = 0.0
    for one in literal_unroll(effects):
        first += remembering_slope(one, r, partners, 1.0, memory_at(one, laws.stretch_pk, pair.p, column))
        column += memory_size(one)
    return first


def law_of_pair(effects: Any, laws: Any, pair: Any, r: Any) -> Any:
    """Return the PairLaw of a pair's interactions and the slopes of its alignment along rotations of i."""
    raise NotImplementedError("pairs are visited in compiled loops")


@compiled_form(law_of_pair, inline=True)
def _choose_law_of_pair(effects: Any, laws: Any, pair: Any, r: Any) -> Any:
    return _remembering_law if any(remembers(one) for one in effects) else _forgetful_law


@inlined
def _remember(effects, laws, pair):
    r = math.sqrt(pair.dx * pair.dx + pair.dy * pair.dy + pair.dz * pair.dz)
    partners = partners_of_rows(effects, laws.body, pair.i, pair.j)
    column = len(spring_columns(laws.friction, laws.axes))
    for one in literal_unroll(effects):
        bring_memory(one, r, partners, laws.stretch_pk, pair.p, column)
        column += memory_size(one)


def remember(effects: Any, laws: ContactLaws, pair: Pair) -> None:
    """Bring the numbers that effects keep of a pair to its distance; nothing where none keeps any."""
    raise NotImplementedError("pairs are visited in compiled loops")


@compiled_form(remember, inline=True)
def _choose_remember(effects: Any, laws: Any, pair: Any) -> Any:
    return _remember if any(remembers(one) for one in effects) else lambda effects, laws, pair: None


@inlined
def _pull_of_law(pair, r, law, x, y, z):
    push = law.first / r if r > 0.0 else 0.0
    x, y, z = law.turning * x, law.turning * y, law.turning * z
    return Pull(
        push * pair.dx, push * pair.dy, push * pair.dz, (-x, -y, -z), (x, y, z), abs(law.first), _NO_SPRING, None
    )


@inlined
def pull_beyond(effects, laws, pair):
    """Return the energy of a pair's interactions, touching or not, and what these do to the two rows."""
    r = math.sqrt(pair.dx * pair.dx + pair.dy * pair.dy + pair.dz * pair.dz)
    law, x, y, z = law_of_pair(effects, laws, pair, r)
    return law.energy, _pull_of_law(pair, r, law, x, y, z)


def has_interactions(effects: Any) -> bool:
    """Return whether a tuple of effects, or numba's type of one, holds interactions beyond contact."""
    return any(is_interaction(one) for one in effects)


def slope_beyond(effects: Any, laws: ContactLaws, pair: Pair, r: float) -> Any:
    """Return the radial derivative of the interactions of two discs or spheres; None where a scene has none."""
    raise NotImplementedError("pairs are visited in compiled loops")


@inlined
def _slope_beyond(effects, laws, pair, r):
    remember(effects, laws, pair)
    return _slope_alone(effects, laws, pair, r)


@compiled_form(slope_beyond, inline=True)
def _choose_slope_beyond(effects: Any, laws: Any, pair: Any, r: Any) -> Any:
    return _slope_beyond if has_interactions(effects) else lambda effects, laws, pair, r: None


class Pushing(NamedTuple):
    """The visitor that adds forces and torques to the rows of a block, and to slots what reaches other blocks."""

    spins: Any
    push: Any
    slot_qk: Any


@inlined
def _add(pull, pushing, axes, pair):
    add_force(axes, pushing.spins, pushing.push, pair.i, pull)
    if pair.slot == NO_SLOT:
        add_reaction(axes, pushing.spins, pushing.push, pair.j, pull)
    else:
        add_reaction(axes, pushing.spins, pushing.slot_qk, pair.slot, pull)


@inlined
def _along(slope, touch, pull):
    fx, fy, fz = pull.fx + slope * touch.x, pull.fy + slope * touch.y, pull.fz + slope * touch.z
    return Pull(fx, fy, fz, pull.on_i, pull.on_j, pull.normal, pull.across, pull.turning)


# a pull with a force along the line of centers
_with_slope = by_type(_along, {type(None): lambda slope, touch, pull: pull})


@inlined
def _push_along(slope, touch, pushing, axes, pair):
    nothing = 0.0, 0.0, 0.0
    _add(_along(slope, touch, Pull(0.0, 0.0, 0.0, nothing, nothing, 0.0, _NO_SPRING, None)), pushing, axes, pair)


# adds such a force alone
_push_apart = by_type(_push_along, {type(None): lambda slope, touch, pushing, axes, pair: None})


@inlined
def _push_discs(shapes, pushing, laws, pair):
    axes = laws.axes
    if is_near(laws, pair):
        # one distance and one sum for what acts at contact and beyond
        touch = touch_of_rows(shapes, axes, laws.body, pair, 0)
        slope = slope_beyond(laws.effects, laws, pair, touch.rho)
        _add(_with_slope(slope, touch, pull_of_touch(laws, pair, 0, touch)), pushing, axes, pair)
    else:
        relax_all(shapes, spring_columns(laws.friction, axes), laws.stretch_pk, pair.p)
        touch = touch_of_rows(shapes, axes, laws.body, pair, 0)
        _push_apart(slope_beyond(laws.effects, laws, pair, touch.rho), touch, pushing, axes, pair)


def push_beyond(effects: Any, pushing: Pushing, laws: ContactLaws, pair: Pair) -> None:
    """Add what the interactions of two shapes do to them, touching or not; nothing where a scene has none."""
    raise NotImplementedError("pairs are visited in compiled loops")


@inlined
def _push_beyond(effects, pushing, laws, pair):
    _, pull = pull_beyond(effects, laws, pair)
    _add(pull, pushing, laws.axes, pair)


@compiled_form(push_beyond, inline=True)
def _choose_push_beyond(effects: Any, pushing: Any, laws: Any, pair: Any) -> Any:
    return _push_beyond if has_interactions(effects) else lambda effects, pushing, laws, pair: None


@inlined
def _push_shapes(shapes, pushing, laws, pair):
    push_beyond(laws.effects, pushing, laws, pair)
    if not is_near(laws, pair):
        relax_all(shapes, spring_columns(laws.friction, laws.axes), laws.stretch_pk, pair.p)
        return
    for k in range(touches_of(shapes, pair.i, pair.j)):
        touch = touch_of_rows(shapes, laws.axes, laws.body, pair, k)
        if touch.touching:
            _add(pull_of_touch(laws, pair, k, touch), pushing, laws.axes, pair)
        else:
            relax(laws.friction, laws.axes, spring_of(laws, pair, k))


_push_rows = by_type(_push_shapes, {type(None): _push_discs})


@visit.form(Pushing)
@inlined
def _push(pushing, laws, pair, value):
    slot_qk, slot = pushing.slot_qk, pair.slot
    if slot != NO_SLOT:
        # a slot is its pair's alone; as many as a force and torque: a loop of unknown length would become a call
        for a in range(len(laws.axes) + len(pushing.spins)):
            slot_qk[slot, a] = 0.0
    _push_rows(laws.shapes, pushing, laws, pair)
    return value


@inlined
def contacts_of_block(effects, laws, push, pairs, b):
    """Add what touching pairs of a block's rows do to these, and leave in slots what they do to other blocks' rows."""
    if effects is None:
        for q in range(pairs.slots.start_b[b], pairs.slots.start_b[b + 1]):
            pairs.slots.push_qk[q] = 0.0
        return
    spins = contact_axes(laws.shapes, laws.friction, laws.axes)
    walk_pairs(Pushing(spins, push, pairs.slots.push_qk), laws, pairs, b, 0)
