# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Interactions beyond contact inside the loops of minimizers: one walk over the pair list, where a scene has any."""

from __future__ import annotations

import math
from typing import Any

from numba import literal_unroll

from packmech.effects.interaction import PairLaw, interaction_law, is_interaction
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.pair_list import pair_at
from packmech.minimize.passes.shape_rows import axis_of


@inlined
def _listed(row, pairs, p):
    """Return the particles of a listed pair and the vector between them."""
    i, j, sx, sy, sz = pair_at(pairs, p)
    return i, j, row[j, 0] - row[i, 0] + sx, row[j, 1] - row[i, 1] + sy, row[j, 2] - row[i, 2] + sz


@inlined
def law_between(shapes, effects, row, i, j, r):
    """Return the PairLaw of all interactions together, and the slopes of the alignment along rotations of i."""
    if shapes is None:
        sigma, alignment = row[i, 3] + row[j, 3], 1.0
        x = y = z = 0.0
    else:
        ax, ay, az = axis_of(shapes, i)
        bx, by, bz = axis_of(shapes, j)
        sigma, alignment = shapes.radius_n[i] + shapes.radius_n[j], ax * bx + ay * by + az * bz
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
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


@device
def _turn(shapes, axes, force_nd, i, j, x, y, z):
    """Add a torque to the row of i's turn, and take it from that of j's."""
    if shapes is not None:
        n = shapes.radius_n.shape[0]
        if len(axes) == 2:
            force_nd[n + i, 0] += z
            force_nd[n + j, 0] -= z
        else:
            force_nd[n + i, 0] += x
            force_nd[n + i, 1] += y
            force_nd[n + i, 2] += z
            force_nd[n + j, 0] -= x
            force_nd[n + j, 1] -= y
            force_nd[n + j, 2] -= z


@device
def _push(shapes, effects, axes, row, force_nd, pairs):
    total = 0.0
    pushed = 0
    for p in range(pairs.count_b[0] + pairs.count_b[1]):
        i, j, dx, dy, dz = _listed(row, pairs, p)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        law, x, y, z = law_between(shapes, effects, row, i, j, r)
        if law.first == 0.0 and law.turning == 0.0:
            continue
        push = law.first / r if r > 0.0 else 0.0
        force_nd[i, 0] += push * dx
        force_nd[i, 1] += push * dy
        force_nd[j, 0] -= push * dx
        force_nd[j, 1] -= push * dy
        if len(axes) == 3:
            force_nd[i, 2] += push * dz
            force_nd[j, 2] -= push * dz
        _turn(shapes, axes, force_nd, i, j, -law.turning * x, -law.turning * y, -law.turning * z)
        total += abs(law.first)
        pushed += 1
    return total, pushed


@device
def _survey(shapes, effects, row, pairs, virial_dd, stiffness_n):
    whole = 0.0
    for p in range(pairs.count_b[0] + pairs.count_b[1]):
        i, j, dx, dy, dz = _listed(row, pairs, p)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        law, _, _, _ = law_between(shapes, effects, row, i, j, r)
        whole += law.energy
        push = law.first / r if r > 0.0 else 0.0
        vector = (dx, dy, dz)
        for a in range(3):
            for b in range(3):
                virial_dd[a, b] += push * vector[a] * vector[b]
        steep = abs(law.second)
        stiffness_n[i] += steep
        stiffness_n[j] += steep
        if shapes is not None:
            turns = abs(law.bending) + abs(law.turning)
            stiffness_n[i] += turns / shapes.gyration_n[i] ** 2
            stiffness_n[j] += turns / shapes.gyration_n[j] ** 2
    return whole


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
