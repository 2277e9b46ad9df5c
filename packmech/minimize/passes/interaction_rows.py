# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Interactions beyond contact inside the loops of minimizers: one walk over the pair list, where a scene has any."""

from __future__ import annotations

import math
from typing import Any

from numba import literal_unroll

from packmech.effects.interaction import PairLaw, interaction_law, is_interaction
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.shape_rows import axis_of, has_shapes, shapes_of


def has_interactions(effects: Any) -> bool:
    """Return whether a tuple of effects, or numba's type of one, holds interactions."""
    return any(is_interaction(one) for one in effects)


@device
def _law(effects, distance, contact_distance, alignment):
    """Return the PairLaw of all interactions together."""
    energy = first = turning = second = mixed = bending = 0.0
    for one in literal_unroll(effects):
        law = interaction_law(one, distance, contact_distance, alignment)
        energy += law.energy
        first += law.first
        turning += law.turning
        second += law.second
        mixed += law.mixed
        bending += law.bending
    return PairLaw(energy, first, turning, second, mixed, bending)


@inlined
def _listed(row, pairs, p):
    """Return the particles of a listed pair and the vector between them."""
    within = pairs.count_b[0]
    if p < within:
        i, j = pairs.i_p[p], pairs.j_p[p]
        return i, j, row[j, 0] - row[i, 0], row[j, 1] - row[i, 1], row[j, 2] - row[i, 2]
    i, j, k = pairs.crossing_i_p[p - within], pairs.crossing_j_p[p - within], pairs.crossing_k_p[p - within]
    shift = pairs.shift_kd
    dx, dy, dz = row[j, 0] - row[i, 0], row[j, 1] - row[i, 1], row[j, 2] - row[i, 2]
    return i, j, dx + shift[k, 0], dy + shift[k, 1], dz + shift[k, 2]


@device
def _push_round(effects, axes, row, force_nd, pairs):
    total = 0.0
    pushed = 0
    for p in range(pairs.count_b[0] + pairs.count_b[1]):
        i, j, dx, dy, dz = _listed(row, pairs, p)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        law = _law(effects, r, row[i, 3] + row[j, 3], 1.0)
        if law.first != 0.0:
            more = _push_apart(axes, force_nd, i, j, law.first, r, dx, dy, dz)
            total += more
            pushed += 1
    return total, pushed


@inlined
def _push_apart(axes, force_nd, i, j, first, r, dx, dy, dz):
    """Add the forces along the line of centers; return their size."""
    push = first / r if r > 0.0 else 0.0
    force_nd[i, 0] += push * dx
    force_nd[i, 1] += push * dy
    force_nd[j, 0] -= push * dx
    force_nd[j, 1] -= push * dy
    if len(axes) == 3:
        force_nd[i, 2] += push * dz
        force_nd[j, 2] -= push * dz
    return abs(first)


@device
def _push_turning(effects, axes, row, force_nd, pairs):
    shapes = shapes_of(effects)
    n = shapes.radius_n.shape[0]
    total = 0.0
    pushed = 0
    for p in range(pairs.count_b[0] + pairs.count_b[1]):
        i, j, dx, dy, dz = _listed(row, pairs, p)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        ax, ay, az = axis_of(shapes, i)
        bx, by, bz = axis_of(shapes, j)
        law = _law(effects, r, shapes.radius_n[i] + shapes.radius_n[j], ax * bx + ay * by + az * bz)
        if law.first != 0.0 or law.turning != 0.0:
            total += _push_apart(axes, force_nd, i, j, law.first, r, dx, dy, dz)
            pushed += 1
            tx, ty, tz = (
                law.turning * (ay * bz - az * by),
                law.turning * (az * bx - ax * bz),
                law.turning * (ax * by - ay * bx),
            )
            if len(axes) == 2:
                force_nd[n + i, 0] -= tz
                force_nd[n + j, 0] += tz
            else:
                force_nd[n + i, 0] -= tx
                force_nd[n + i, 1] -= ty
                force_nd[n + i, 2] -= tz
                force_nd[n + j, 0] += tx
                force_nd[n + j, 1] += ty
                force_nd[n + j, 2] += tz
    return total, pushed


def push_interactions(effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> tuple[float, int]:
    """Add the forces of interactions, and their torques to the rows of turns; return their total and how many act."""
    if not has_interactions(effects):
        return 0.0, 0
    total, pushed = (_push_turning if has_shapes(effects) else _push_round)(effects, axes, row, force_nd, pairs)
    return total, pushed


@compiled_form(push_interactions)
def _choose_push_interactions(effects: Any, axes: Any, row: Any, force_nd: Any, pairs: Any) -> Any:
    if not has_interactions(effects):
        return lambda effects, axes, row, force_nd, pairs: (0.0, 0)
    return _push_turning if has_shapes(effects) else _push_round


@device
def _survey(effects, row, pairs, virial_dd, stiffness_n):
    whole = 0.0
    for p in range(pairs.count_b[0] + pairs.count_b[1]):
        i, j, dx, dy, dz = _listed(row, pairs, p)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        law = _pair_law(effects, row, i, j, r)
        whole += law.energy
        push = law.first / r if r > 0.0 else 0.0
        for a, one in enumerate((dx, dy, dz)):
            for b, other in enumerate((dx, dy, dz)):
                virial_dd[a, b] += push * one * other
        turns = abs(law.bending) + abs(law.turning)
        stiffness_n[i] += abs(law.second) + turns * _turned(effects, i)
        stiffness_n[j] += abs(law.second) + turns * _turned(effects, j)
    return whole


def _pair_law(effects: Any, row: Any, i: int, j: int, r: float) -> PairLaw:
    """Return the law of a pair at a distance of centers."""
    raise NotImplementedError("pairs are surveyed in compiled loops")


@compiled_form(_pair_law)
def _choose_pair_law(effects: Any, row: Any, i: Any, j: Any, r: Any) -> Any:
    if not has_shapes(effects):
        return lambda effects, row, i, j, r: _law(effects, r, row[i, 3] + row[j, 3], 1.0)

    def turned(effects, row, i, j, r):
        shapes = shapes_of(effects)
        ax, ay, az = axis_of(shapes, i)
        bx, by, bz = axis_of(shapes, j)
        return _law(effects, r, shapes.radius_n[i] + shapes.radius_n[j], ax * bx + ay * by + az * bz)

    return turned


def _turned(effects: Any, i: int) -> float:
    """Return one over the square of the radius of gyration; 0 where nothing turns."""
    return 1.0 / shapes_of(effects).gyration_n[i] ** 2 if has_shapes(effects) else 0.0


@compiled_form(_turned)
def _choose_turned(effects: Any, i: Any) -> Any:
    if has_shapes(effects):
        return lambda effects, i: 1.0 / shapes_of(effects).gyration_n[i] ** 2
    return lambda effects, i: 0.0


def survey_interactions(effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> float:
    """Return the energy of interactions; add to the virial, and to the bounds on curvatures."""
    return _survey(effects, row, pairs, virial_dd, stiffness_n) if has_interactions(effects) else 0.0


@compiled_form(survey_interactions)
def _choose_survey_interactions(effects: Any, row: Any, pairs: Any, virial_dd: Any, stiffness_n: Any) -> Any:
    if has_interactions(effects):
        return _survey
    return lambda effects, row, pairs, virial_dd, stiffness_n: 0.0
