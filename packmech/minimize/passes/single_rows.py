# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What acts on single particles, inside the loops of minimizers: rows are pushed once their contacts are summed.

It travels in the tuple of effects as records of its own: loops of scenes without it have no code for it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.effects import body_energy, body_force, body_second, held_particles, pair_second, single_effects
from packmech.jit.compiled import compiled_form, device
from packmech.minimize.passes.bond_rows import RowsBonded, push_bonded, survey_bonded
from packmech.minimize.passes.shape_rows import has_shapes, shapes_of
from packmech.minimize.passes.shape_singles import Motion, energy_of_shape, push_on_shape
from packmech.scene import Scene


class RowsPushed(NamedTuple):
    """Effects on single particles, masses by row, particles that are held besides, and a contact's stiffness.

    The stiffness [energy/length^2] sets the step where nothing touches yet.
    """

    single: Any
    mass_n: NDArray[np.float64]
    held_n: NDArray[np.bool_]
    stiffness: float


class RowsHeld(NamedTuple):
    """The mask of held particles, by rows."""

    held_n: NDArray[np.bool_]


def acting_on_rows(scene: Scene, order_n: NDArray[np.int64]) -> tuple[Any, ...]:
    """Return what acts on single particles and which are held, by rows; nothing where neither is."""
    packing = scene.packing
    single, held = single_effects(scene.effects), held_particles(scene.effects, packing.particles)
    rows: list[Any] = []
    held_n = np.zeros(packing.particles, dtype=np.bool_) if held is None else held[order_n]
    if single:
        sigma = packing.reference_diameter
        stiffness = sum(abs(float(pair_second(one, 0.99 * sigma, sigma))) for one in scene.effects)
        rows.append(RowsPushed(single, np.ascontiguousarray(packing.mass_n[order_n]), held_n, stiffness))
    if held is not None:
        if packing.links is not None:
            bound = held[packing.links.i_l] | held[packing.links.j_l]
            if bound.any():
                raise ValueError(
                    "scene.effects must hold no particle that is linked, got FixedParticles with an end of link "
                    f"{int(np.argmax(bound))}"
                )
        rows.append(RowsHeld(held_n))
    return tuple(rows)


@device
def _push(rows, axes, row, force_nd, low, high):
    total = 0.0
    pushed = 0
    for i in range(low, high):
        fx = fy = fz = 0.0
        for one in literal_unroll(rows.single):
            x, y, z = body_force(one, row[i, 0], row[i, 1], row[i, 2], 0.0, 0.0, 0.0, rows.mass_n[i], row[i, 3])
            fx += x
            fy += y
            fz += z
            square = x * x + y * y + z * z
            if square != 0.0 and not rows.held_n[i]:
                total += math.sqrt(square)
                pushed += 1
        force_nd[i, 0] += fx
        force_nd[i, 1] += fy
        if len(axes) == 3:
            force_nd[i, 2] += fz
    return total, pushed


@device
def _hold(rows, axes, row, force_nd, low, high):
    for i in range(low, high):
        if rows.held_n[i]:
            for a in range(len(axes)):
                force_nd[i, a] = 0.0
    return 0.0, 0


@device
def _push_shapes(rows, shapes, axes, row, force_nd, low, high):
    n = shapes.radius_n.shape[0]
    total = 0.0
    pushed = 0
    for i in range(low, high):
        fx = fy = fz = 0.0
        tx = ty = tz = 0.0
        motion = Motion(row[i, 0], row[i, 1], row[i, 2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for one in literal_unroll(rows.single):
            px, py, pz, qx, qy, qz = push_on_shape(one, shapes, i, motion, rows.mass_n[i])
            fx += px
            fy += py
            fz += pz
            tx += qx
            ty += qy
            tz += qz
            square = px * px + py * py + pz * pz
            if square != 0.0 and not rows.held_n[i]:
                total += math.sqrt(square)
                pushed += 1
        force_nd[i, 0] += fx
        force_nd[i, 1] += fy
        if len(axes) == 3:
            force_nd[i, 2] += fz
            force_nd[n + i, 0] += tx
            force_nd[n + i, 1] += ty
            force_nd[n + i, 2] += tz
        else:
            force_nd[n + i, 0] += tz
    return total, pushed


@device
def _hold_shapes(rows, shapes, axes, row, force_nd, low, high):
    n = shapes.radius_n.shape[0]
    for i in range(low, high):
        if rows.held_n[i]:
            for a in range(len(axes)):
                force_nd[i, a] = 0.0
                force_nd[n + i, a] = 0.0
    return 0.0, 0


def _push_rows(
    one: Any, effects: Any, axes: Any, row: Any, force_nd: Any, low: Any, high: Any
) -> tuple[float, int]:  # fmt: skip
    """Add what one record does; `effects` hold the shapes, if there are any."""
    raise NotImplementedError("rows are pushed in compiled loops")


@compiled_form(_push_rows)
def _choose_push_rows(one: Any, effects: Any, axes: Any, row: Any, force_nd: Any, low: Any, high: Any) -> Any:
    kind = getattr(one, "instance_class", None)
    if kind is RowsBonded:
        return lambda one, effects, axes, row, force_nd, low, high: push_bonded(
            one, effects, axes, row, force_nd, low, high
        )
    if kind not in (RowsPushed, RowsHeld):
        return lambda one, effects, axes, row, force_nd, low, high: (0.0, 0)
    if has_shapes(effects):
        act = _push_shapes if kind is RowsPushed else _hold_shapes
        return lambda one, effects, axes, row, force_nd, low, high: act(
            one, shapes_of(effects), axes, row, force_nd, low, high
        )
    on_discs = _push if kind is RowsPushed else _hold
    return lambda one, effects, axes, row, force_nd, low, high: on_discs(one, axes, row, force_nd, low, high)


@device
def push_rows(effects, axes, row, force_nd, low, high):
    """Add what acts on single rows to their forces, none on those that are held; return its total and how many."""
    total = 0.0
    pushed = 0
    for one in literal_unroll(effects):
        more, count = _push_rows(one, effects, axes, row, force_nd, low, high)
        total += more
        pushed += count
    return total, pushed


@device
def _survey_pushed(rows, row, stiffness_n):
    energy = 0.0
    for i in range(row.shape[0]):
        x, y, z, mass, radius = row[i, 0], row[i, 1], row[i, 2], rows.mass_n[i], row[i, 3]
        for one in literal_unroll(rows.single):
            energy += body_energy(one, x, y, z, mass, radius)
            xx, yy, zz, yz, xz, xy = body_second(one, x, y, z, mass, radius)
            stiffness_n[i] += max(abs(xx), abs(yy), abs(zz)) + abs(yz) + abs(xz) + abs(xy)
    return energy, rows.stiffness


@device
def _survey_pushed_shapes(rows, shapes, row, stiffness_n):
    energy = 0.0
    for i in range(shapes.radius_n.shape[0]):
        x, y, z = row[i, 0], row[i, 1], row[i, 2]
        for one in literal_unroll(rows.single):
            own, stiffness = energy_of_shape(one, shapes, i, x, y, z, rows.mass_n[i])
            energy += own
            stiffness_n[i] += stiffness
    return energy, rows.stiffness


@device
def _survey_held(rows, row, stiffness_n):
    for i in range(rows.held_n.shape[0]):
        if rows.held_n[i]:
            stiffness_n[i] = 0.0
    return 0.0, 0.0


def _survey_rows(one: Any, effects: Any, row: Any, stiffness_n: Any) -> tuple[float, float]:
    """Return what one record does; `effects` hold the shapes, if there are any."""
    raise NotImplementedError("rows are looked at in compiled loops")


@compiled_form(_survey_rows)
def _choose_survey_rows(one: Any, effects: Any, row: Any, stiffness_n: Any) -> Any:
    kind = getattr(one, "instance_class", None)
    if kind is RowsBonded:
        return lambda one, effects, row, stiffness_n: survey_bonded(one, effects, row, stiffness_n)
    if kind is RowsPushed and has_shapes(effects):
        return lambda one, effects, row, stiffness_n: _survey_pushed_shapes(one, shapes_of(effects), row, stiffness_n)
    if kind is RowsPushed:
        return lambda one, effects, row, stiffness_n: _survey_pushed(one, row, stiffness_n)
    if kind is RowsHeld:
        return lambda one, effects, row, stiffness_n: _survey_held(one, row, stiffness_n)
    return lambda one, effects, row, stiffness_n: (0.0, 0.0)


@device
def survey_rows(effects, row, stiffness_n):
    """Return the energies of what acts on single rows and a stiffness of contacts; add its own to stiffness_n."""
    energy = 0.0
    stiffness = 0.0
    for one in literal_unroll(effects):
        more, least = _survey_rows(one, effects, row, stiffness_n)
        energy += more
        stiffness = max(stiffness, least)
    return energy, stiffness
