# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds and interactions beyond contact inside the loops of minimizers, where a scene has any.

Interactions are one walk over the pair list. Bonds travel in the tuple of effects as a record of their own; the pair
list has no bonded pairs, which are no contacts.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.constraints.compiled_links import LinkedPairs
from packmech.effects import bonds_of, law_energy, law_first, law_second, refuse_tangential_springs
from packmech.effects.interaction import PairLaw, interaction_law, is_interaction
from packmech.effects.partners import equal_partners, partners_of
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.kind_rows import kinds_between, partners_of_rows
from packmech.minimize.passes.pair_list import visit, walk_blocks
from packmech.minimize.passes.shape_rows import RowLaws, axis_of, by_shape
from packmech.minimize.passes.single_rows import add_torque
from packmech.scene import Scene


class RowsBonded(NamedTuple):
    """Laws of bonds below and above their rest lengths, the rows of their ends, images, and rest lengths.

    Their vectors are row[j] - row[i] + shift, the shifts (B, 3) lattice vectors.
    """

    compression: Any
    tension: Any
    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    shift_bd: NDArray[np.float64]
    rest_b: NDArray[np.float64]


def bonded_rows(
    scene: Scene, order_n: NDArray[np.int64], wrap_nd: NDArray[np.float64], change_dd: NDArray[np.int64]
) -> tuple[tuple[RowsBonded, ...], LinkedPairs | None]:
    """Return the bonds of a scene by rows, and what pairs of rows they join, which are no contacts; nothing without.

    Parameters
    ----------
    scene
        The scene.
    order_n
        (N,) particle of each row.
    wrap_nd
        (N, d) images by which particles were moved: x = row + lattice @ wrap.
    change_dd
        (d, d) whole numbers: the loops' lattice is lattice @ change.

    """
    bonds, packing = bonds_of(scene.effects), scene.packing
    if bonds is None:
        return (), None
    refuse_tangential_springs(scene.effects)
    n, d = packing.particles, packing.dimension
    row_n = np.empty(n, dtype=np.int64)
    row_n[order_n] = np.arange(n)
    i, j = row_n[bonds.i_b], row_n[bonds.j_b]
    image = bonds.image_bd + (wrap_nd[bonds.j_b] - wrap_nd[bonds.i_b]).astype(np.int64)
    shift, padded = np.zeros((len(bonds), 3)), np.zeros((len(bonds), 3), dtype=np.int64)
    shift[:, :d] = image @ packing.box.lattice_dd.T
    padded[:, :d] = image @ np.rint(np.linalg.inv(change_dd)).astype(np.int64).T
    # a search may find a pair from either end
    ends, others, images = np.concatenate([i, j]), np.concatenate([j, i]), np.concatenate([padded, -padded])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], np.arange(n + 1)).astype(np.int64)
    joined = LinkedPairs(first, others[order], images[order], np.full(n, -1), np.zeros((n, 3), dtype=np.int64))
    return (RowsBonded(bonds.compression, bonds.tension, i, j, shift, bonds.rest_length_b),), joined


@inlined
def _alignment_of_discs(shapes, effects, row, i, j):
    return partners_of_rows(effects, row, i, j), 1.0, 0.0, 0.0, 0.0


@inlined
def _alignment_of_shapes(shapes, effects, row, i, j):
    ax, ay, az = axis_of(shapes, i)
    bx, by, bz = axis_of(shapes, j)
    partners = partners_of(shapes.radius_n[i], shapes.radius_n[j], kinds_between(effects, i, j))
    alignment = ax * bx + ay * by + az * bz
    return partners, alignment, ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@device
def _turn_shapes(shapes, axes, force_nd, i, j, x, y, z):
    add_torque(shapes, axes, force_nd, i, x, y, z)
    add_torque(shapes, axes, force_nd, j, -x, -y, -z)


@inlined
def _stiffness_of_turns(shapes, stiffness_n, i, j, turns):
    stiffness_n[i] += turns / shapes.gyration_n[i] ** 2
    stiffness_n[j] += turns / shapes.gyration_n[j] ** 2


# the partners that two rows are, their alignment, and its slopes along rotations of i
_alignment_of = by_shape(_alignment_of_discs, _alignment_of_shapes, _alignment_of_shapes)
# adds a torque to the row of i's turn and takes it from that of j's; adds a bound on the curvature along turns
_turn = by_shape(lambda shapes, axes, force_nd, i, j, x, y, z: None, _turn_shapes, _turn_shapes)
_stiffen = by_shape(lambda shapes, stiffness_n, i, j, turns: None, _stiffness_of_turns, _stiffness_of_turns)


@inlined
def law_between(shapes, effects, row, i, j, r):
    """Return the PairLaw of all interactions together, and the slopes of the alignment along rotations of i."""
    partners, alignment, x, y, z = _alignment_of(shapes, effects, row, i, j)
    energy = first = turning = second = mixed = bending = 0.0
    for one in literal_unroll(effects):
        law = interaction_law(one, r, partners, alignment)
        energy += law.energy
        first += law.first
        turning += law.turning
        second += law.second
        mixed += law.mixed
        bending += law.bending
    return PairLaw(energy, first, turning, second, mixed, bending), x, y, z


@inlined
def _bond(one, row, b):
    """Return the ends of a bond, its vector and length."""
    i, j = one.i_b[b], one.j_b[b]
    dx = row[j, 0] - row[i, 0] + one.shift_bd[b, 0]
    dy = row[j, 1] - row[i, 1] + one.shift_bd[b, 1]
    dz = row[j, 2] - row[i, 2] + one.shift_bd[b, 2]
    return i, j, dx, dy, dz, math.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def _pull(axes, force_nd, i, j, first, r, dx, dy, dz):
    """Add the forces of a pair along its vector; those of ends at one place have no direction."""
    push = first / r if r > 0.0 else 0.0
    force_nd[i, 0] += push * dx
    force_nd[i, 1] += push * dy
    force_nd[j, 0] -= push * dx
    force_nd[j, 1] -= push * dy
    if len(axes) == 3:
        force_nd[i, 2] += push * dz
        force_nd[j, 2] -= push * dz


@inlined
def _add_curvature(i, j, first, second, r, dx, dy, dz, virial_dd, stiffness_n):
    """Add to the virial, and to the bounds on the curvatures of both rows."""
    push = first / r if r > 0.0 else 0.0
    vector = (dx, dy, dz)
    for a in range(3):
        for b in range(3):
            virial_dd[a, b] += push * vector[a] * vector[b]
    stiffness_n[i] += abs(second)
    stiffness_n[j] += abs(second)


@device
def _push_bonds(one, axes, row, force_nd):
    total = 0.0
    for b in range(one.rest_b.shape[0]):
        i, j, dx, dy, dz, r = _bond(one, row, b)
        rest, closed = equal_partners(one.rest_b[b]), r < one.rest_b[b]
        first = law_first(one.compression, r, rest) if closed else law_first(one.tension, r, rest)
        _pull(axes, force_nd, i, j, first, r, dx, dy, dz)
        total += abs(first)
    return total, one.rest_b.shape[0]


@device
def _survey_bonds(one, row, virial_dd, stiffness_n):
    energy = 0.0
    for b in range(one.rest_b.shape[0]):
        i, j, dx, dy, dz, r = _bond(one, row, b)
        rest, closed = equal_partners(one.rest_b[b]), r < one.rest_b[b]
        energy += law_energy(one.compression, r, rest) if closed else law_energy(one.tension, r, rest)
        first = law_first(one.compression, r, rest) if closed else law_first(one.tension, r, rest)
        second = law_second(one.compression, r, rest) if closed else law_second(one.tension, r, rest)
        _add_curvature(i, j, first, second, r, dx, dy, dz, virial_dd, stiffness_n)
    return energy


# the forces of one of the effects if it is that of bonds, their total and how many they are
_bonds_push = by_type(lambda one, axes, row, force_nd: (0.0, 0), {RowsBonded: _push_bonds})
# its energy; adds to the virial, and to the bounds on curvatures
_bonds_survey = by_type(lambda one, row, virial_dd, stiffness_n: 0.0, {RowsBonded: _survey_bonds})


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
        _pull(axes, force_nd, i, j, law.first, r, dx, dy, dz)
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
    _add_curvature(i, j, law.first, law.second, r, pair.dx, pair.dy, pair.dz, surveying.virial_dd, stiffness_n)
    _stiffen(shapes, stiffness_n, i, j, abs(law.bending) + abs(law.turning))
    return whole + law.energy


@device
def _push(shapes, effects, axes, row, force_nd, pairs):
    return walk_blocks(_PushingBeyond(force_nd), RowLaws(effects, shapes, axes, row), pairs, (0.0, 0))


@device
def _survey(shapes, effects, row, pairs, virial_dd, stiffness_n):
    laws, surveying = RowLaws(effects, shapes, (0, 1, 2), row), _SurveyingBeyond(virial_dd, stiffness_n)
    return walk_blocks(surveying, laws, pairs, 0.0)


def _has(effects: Any) -> bool:
    """Return whether a tuple of effects, or numba's type of one, holds interactions."""
    return any(is_interaction(one) for one in effects)


def _between(shapes: Any, effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> tuple[float, int]:
    """Add the forces of interactions, and their torques to the rows of turns; return their total and how many act."""
    total, pushed = _push(shapes, effects, axes, row, force_nd, pairs) if _has(effects) else (0.0, 0)
    return total, pushed


@compiled_form(_between)
def _choose_between(shapes: Any, effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> Any:
    return _push if _has(effects) else lambda shapes, effects, axes, row, force_nd, pairs: (0.0, 0)


def _survey_between(shapes: Any, effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> float:
    """Return the energy of interactions; add to the virial, and to the bounds on curvatures."""
    return float(_survey(shapes, effects, row, pairs, virial_dd, stiffness_n)) if _has(effects) else 0.0


@compiled_form(_survey_between)
def _choose_survey(shapes: Any, effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> Any:
    return _survey if _has(effects) else lambda shapes, effects, row, pairs, virial_dd, stiffness_n: 0.0


@device
def push_interactions(shapes, effects, axes, row, force_nd, pairs):
    """Add the forces and torques of interactions and bonds; return their total and how many act."""
    total, pushed = _between(shapes, effects, axes, row, force_nd, pairs)
    for one in literal_unroll(effects):
        more, number = _bonds_push(one, axes, row, force_nd)
        total += more
        pushed += number
    return total, pushed


@device
def survey_interactions(shapes, effects, row, pairs, virial_dd, stiffness_n):
    """Return the energy of interactions and bonds; add to the virial, and to the bounds on curvatures."""
    energy = _survey_between(shapes, effects, row, pairs, virial_dd, stiffness_n)
    for one in literal_unroll(effects):
        energy += _bonds_survey(one, row, virial_dd, stiffness_n)
    return energy
