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

from packmech.effects import (
    body_energy,
    body_force,
    body_second,
    held_particles,
    on_row,
    pair_second,
    single_rows,
)
from packmech.effects.kinds import kinds_by_rows, reference_partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined
from packmech.minimize.passes.shape_rows import by_shape
from packmech.minimize.passes.shape_singles import RowMotion, energy_of_shape, push_on_shape
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
    single = single_rows(scene.effects, kinds_by_rows(packing, order_n))
    held = held_particles(scene.effects, packing.particles)
    rows: list[Any] = []
    held_n = np.zeros(packing.particles, dtype=np.bool_) if held is None else held[order_n]
    if single:
        sigma = packing.reference_diameter
        stiffness = max(
            sum(abs(float(pair_second(one, 0.99 * sigma, pair))) for one in scene.effects)
            for pair in reference_partners(scene.effects, packing)
        )
        rows.append(RowsPushed(single, np.ascontiguousarray(packing.mass_n[order_n]), held_n, stiffness))
    if held is not None:
        bound = held[packing.links.i_l] | held[packing.links.j_l]
        if bound.any():
            raise ValueError(
                "scene.effects must hold no particle that is linked, got FixedParticles with an end of link "
                f"{int(np.argmax(bound))}"
            )
        rows.append(RowsHeld(held_n))
    return tuple(rows)


@inlined
def _disc_pushed(shapes, one, row, i, mass):
    x, y, z = body_force(one, row[i, 0], row[i, 1], row[i, 2], 0.0, 0.0, 0.0, mass, row[i, 3])
    return x, y, z, 0.0, 0.0, 0.0


@inlined
def _shape_pushed(shapes, one, row, i, mass):
    return push_on_shape(one, shapes, i, RowMotion(row[i, 0], row[i, 1], row[i, 2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), mass)


@device
def _turn_shape(shapes, axes, force_nd, i, tx, ty, tz):
    n = shapes.radius_n.shape[0]
    if len(axes) == 3:
        force_nd[n + i, 0] += tx
        force_nd[n + i, 1] += ty
        force_nd[n + i, 2] += tz
    else:
        force_nd[n + i, 0] += tz


@inlined
def _energy_of_disc(shapes, one, row, i, mass):
    x, y, z, radius = row[i, 0], row[i, 1], row[i, 2], row[i, 3]
    xx, yy, zz, yz, xz, xy = body_second(one, x, y, z, mass, radius)
    stiffness = max(abs(xx), abs(yy), abs(zz)) + abs(yz) + abs(xz) + abs(xy)
    return body_energy(one, x, y, z, mass, radius), stiffness


@inlined
def _energy_of_shape(shapes, one, row, i, mass):
    return energy_of_shape(one, shapes, i, row[i, 0], row[i, 1], row[i, 2], mass)


# force and torque of one effect on a particle at rest, and its energy with a bound of its stiffness
_pushed = by_shape(_disc_pushed, _shape_pushed, _shape_pushed)
_energy = by_shape(_energy_of_disc, _energy_of_shape, _energy_of_shape)
# adds a torque to the row of a particle's turn, if it has one
add_torque = by_shape(lambda shapes, axes, force_nd, i, tx, ty, tz: None, _turn_shape, _turn_shape)


@device
def _push(one, shapes, axes, row, force_nd, low, high):
    total = 0.0
    pushed = 0
    for i in range(low, high):
        fx = fy = fz = 0.0
        tx = ty = tz = 0.0
        for acting in literal_unroll(one.single):
            px, py, pz, qx, qy, qz = _pushed(shapes, on_row(acting, i), row, i, one.mass_n[i])
            fx += px
            fy += py
            fz += pz
            tx += qx
            ty += qy
            tz += qz
            square = px * px + py * py + pz * pz
            if square != 0.0 and not one.held_n[i]:
                total += math.sqrt(square)
                pushed += 1
        force_nd[i, 0] += fx
        force_nd[i, 1] += fy
        if len(axes) == 3:
            force_nd[i, 2] += fz
        add_torque(shapes, axes, force_nd, i, tx, ty, tz)
    return total, pushed


@device
def _hold(one, shapes, axes, row, force_nd, low, high):
    n = one.held_n.shape[0]
    for i in range(low, high):
        if one.held_n[i]:
            for k in range(i, row.shape[0], n):
                for a in range(len(axes)):
                    force_nd[k, a] = 0.0
    return 0.0, 0


# adds what one record does to particles with these shapes, None for discs and spheres; its total and how many
_push_rows = by_type(lambda one, shapes, axes, row, force_nd, low, high: (0.0, 0), {RowsPushed: _push, RowsHeld: _hold})


@device
def push_rows(shapes, effects, axes, row, force_nd, low, high):
    """Add what acts on single rows to their forces, none on those that are held; return its total and how many."""
    total = 0.0
    pushed = 0
    for one in literal_unroll(effects):
        more, count = _push_rows(one, shapes, axes, row, force_nd, low, high)
        total += more
        pushed += count
    return total, pushed


@device
def _survey_pushed(one, shapes, row, stiffness_n):
    energy = 0.0
    for i in range(one.mass_n.shape[0]):
        for acting in literal_unroll(one.single):
            own, stiffness = _energy(shapes, on_row(acting, i), row, i, one.mass_n[i])
            energy += own
            stiffness_n[i] += stiffness
    return energy, one.stiffness


@device
def _survey_held(one, shapes, row, stiffness_n):
    for i in range(one.held_n.shape[0]):
        if one.held_n[i]:
            stiffness_n[i] = 0.0
    return 0.0, 0.0


# the energy of what one record does, and a stiffness of contacts; adds its own to stiffness_n
_survey_rows = by_type(
    lambda one, shapes, row, stiffness_n: (0.0, 0.0), {RowsPushed: _survey_pushed, RowsHeld: _survey_held}
)


@device
def survey_rows(shapes, effects, row, stiffness_n):
    """Return the energies of what acts on single rows and a stiffness of contacts; add its own to stiffness_n."""
    energy = 0.0
    stiffness = 0.0
    for one in literal_unroll(effects):
        more, least = _survey_rows(one, shapes, row, stiffness_n)
        energy += more
        stiffness = max(stiffness, least)
    return energy, stiffness
