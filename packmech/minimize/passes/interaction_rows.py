# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Interactions beyond contact inside the loops of minimizers: one walk over the pair list, where a scene has any."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import literal_unroll

from packmech.effects.interaction import PairLaw, interaction_law, is_interaction
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.pair_list import inner_pairs, visit, walk
from packmech.minimize.passes.shape_rows import RowLaws, axis_of, by_shape
from packmech.minimize.passes.single_rows import add_torque


@inlined
def _alignment_of_discs(shapes, row, i, j):
    return row[i, 3] + row[j, 3], 1.0, 0.0, 0.0, 0.0


@inlined
def _alignment_of_shapes(shapes, row, i, j):
    ax, ay, az = axis_of(shapes, i)
    bx, by, bz = axis_of(shapes, j)
    sigma, alignment = shapes.radius_n[i] + shapes.radius_n[j], ax * bx + ay * by + az * bz
    return sigma, alignment, ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@device
def _turn_shapes(shapes, axes, force_nd, i, j, x, y, z):
    add_torque(shapes, axes, force_nd, i, x, y, z)
    add_torque(shapes, axes, force_nd, j, -x, -y, -z)


@inlined
def _stiffness_of_turns(shapes, stiffness_n, i, j, turns):
    stiffness_n[i] += turns / shapes.gyration_n[i] ** 2
    stiffness_n[j] += turns / shapes.gyration_n[j] ** 2


# the contact distance of two rows, their alignment, and its slopes along rotations of i
_alignment_of = by_shape(_alignment_of_discs, _alignment_of_shapes, _alignment_of_shapes)
# adds a torque to the row of i's turn and takes it from that of j's; adds a bound on the curvature along turns
_turn = by_shape(lambda shapes, axes, force_nd, i, j, x, y, z: None, _turn_shapes, _turn_shapes)
_stiffen = by_shape(lambda shapes, stiffness_n, i, j, turns: None, _stiffness_of_turns, _stiffness_of_turns)


@inlined
def law_between(shapes, effects, row, i, j, r):
    """Return the PairLaw of all interactions together, and the slopes of the alignment along rotations of i."""
    sigma, alignment, x, y, z = _alignment_of(shapes, row, i, j)
    energy = first = turning = second = mixed = bending = 0.0
    for one in literal_unroll(effects):
        law = interaction_law(one, r, sigma, alignment)
        energy += law.energy
        first += law.first
        turning += law.turning
        second += law.second
        mixed += law.mixed
        bending += law.bending
    return PairLaw(energy, first, turning, second, mixed, bending), x, y, z


class _PushingBeyond(NamedTuple):
    """The visitor that adds the forces of interactions to rows."""

    force_nd: Any


class _SurveyingBeyond(NamedTuple):
    """The visitor that adds up what interactions give to the virial and to the bounds on curvatures."""

    virial_dd: Any
    stiffness_n: Any


@visit.form(_PushingBeyond)
@inlined
def _push_pair(pushing, laws, pair, value):
    i, j, dx, dy, dz = pair.i, pair.j, pair.dx, pair.dy, pair.dz
    axes, force_nd = laws.axes, pushing.force_nd
    total, pushed = value
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    law, x, y, z = law_between(laws.shapes, laws.effects, laws.body, i, j, r)
    if law.first != 0.0 or law.turning != 0.0:
        push = law.first / r if r > 0.0 else 0.0
        force_nd[i, 0] += push * dx
        force_nd[i, 1] += push * dy
        force_nd[j, 0] -= push * dx
        force_nd[j, 1] -= push * dy
        if len(axes) == 3:
            force_nd[i, 2] += push * dz
            force_nd[j, 2] -= push * dz
        _turn(laws.shapes, axes, force_nd, i, j, -law.turning * x, -law.turning * y, -law.turning * z)
        total += abs(law.first)
        pushed += 1
    return total, pushed


@visit.form(_SurveyingBeyond)
@inlined
def _survey_pair(surveying, laws, pair, whole):
    i, j, shapes, stiffness_n = pair.i, pair.j, laws.shapes, surveying.stiffness_n
    r = math.sqrt(pair.dx * pair.dx + pair.dy * pair.dy + pair.dz * pair.dz)
    law, _, _, _ = law_between(shapes, laws.effects, laws.body, i, j, r)
    push = law.first / r if r > 0.0 else 0.0
    vector = (pair.dx, pair.dy, pair.dz)
    for a in range(3):
        for b in range(3):
            surveying.virial_dd[a, b] += push * vector[a] * vector[b]
    steep = abs(law.second)
    stiffness_n[i] += steep
    stiffness_n[j] += steep
    _stiffen(shapes, stiffness_n, i, j, abs(law.bending) + abs(law.turning))
    return whole + law.energy


@device
def _push(shapes, effects, axes, row, force_nd, pairs):
    start = pairs.start_s
    laws, pushing = RowLaws(effects, shapes, axes, row), _PushingBeyond(force_nd)
    return walk(pushing, laws, inner_pairs(pairs), start[0], start[1], start[2], (0.0, 0))


@device
def _survey(shapes, effects, row, pairs, virial_dd, stiffness_n):
    start = pairs.start_s
    laws, surveying = RowLaws(effects, shapes, (0, 1, 2), row), _SurveyingBeyond(virial_dd, stiffness_n)
    return walk(surveying, laws, inner_pairs(pairs), start[0], start[1], start[2], 0.0)


def _has(effects: Any) -> bool:
    """Return whether a tuple of effects, or numba's type of one, holds interactions."""
    return any(is_interaction(one) for one in effects)


def push_interactions(shapes: Any, effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> tuple[float, int]:
    """Add the forces of interactions, and their torques to the rows of turns; return their total and how many act."""
    total, pushed = _push(shapes, effects, axes, row, force_nd, pairs) if _has(effects) else (0.0, 0)
    return total, pushed


@compiled_form(push_interactions)
def _choose_push(shapes: Any, effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> Any:
    return _push if _has(effects) else lambda shapes, effects, axes, row, force_nd, pairs: (0.0, 0)


def survey_interactions(shapes: Any, effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> float:
    """Return the energy of interactions; add to the virial, and to the bounds on curvatures."""
    return float(_survey(shapes, effects, row, pairs, virial_dd, stiffness_n)) if _has(effects) else 0.0


@compiled_form(survey_interactions)
def _choose_survey(shapes: Any, effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> Any:
    return _survey if _has(effects) else lambda shapes, effects, row, pairs, virial_dd, stiffness_n: 0.0
