# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The pass over the contacts in a time step: what a scene lacks is None, and numba leaves out its branches."""

from __future__ import annotations

import math

import numpy as np
from numba import literal_unroll

from packmech.dynamics.deformation import relative
from packmech.dynamics.friction import (
    Contact,
    add_force,
    add_reaction,
    reset_stretch,
    store_reaction,
    tangential_force_of_pair,
    turning_axes,
)
from packmech.dynamics.pair_lists import NO_SLOT
from packmech.effects import pair_elastic, pair_first
from packmech.jit.compiled import inlined
from packmech.minimize.passes.kernels import coincident_direction


@inlined
def touching_pair(rates, axes, body, i, j, dx, dy, dz, square, sigma):
    """Return the contact of two rows; coincident ones get a direction."""
    r = math.sqrt(square)
    inverse = 1.0 / r
    ux, uy, uz = relative(rates, axes, body, i, j, dx, dy, dz)
    if square == 0.0:
        dx, dy, dz = coincident_direction(i, j, len(axes))
        inverse = 1.0
    return Contact(i, j, dx * inverse, dy * inverse, dz * inverse, ux, uy, uz, r, sigma)


@inlined
def force_of_pair(effects, friction, axes, body, stretch_pk, p, contact, pace):
    """Return what a touching pair does: force on i, and moment and arms of its tangential part."""
    nx, ny, nz = contact.nx, contact.ny, contact.nz
    rate = contact.ux * nx + contact.uy * ny
    if len(axes) == 3:
        rate += contact.uz * nz
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, contact.r, contact.sigma, rate)
        elastic += pair_elastic(one, contact.r, contact.sigma)
    fx, fy, fz, mx, my, mz, ai, aj = tangential_force_of_pair(
        friction, axes, body, stretch_pk, p, contact, abs(elastic), pace
    )
    return first * nx + fx, first * ny + fy, first * nz + fz, mx, my, mz, ai, aj


@inlined
def contacts_of_block(effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b):
    """Add what touching pairs of a block's rows do to these, and leave in slots what they do to other blocks' rows."""
    if effects is None:
        for q in range(pairs.slots.start_b[b], pairs.slots.start_b[b + 1]):
            pairs.slots.push_qk[q] = 0.0
        return
    spins = turning_axes(friction, axes)
    i_p, j_p, image_p, slot_p = pairs.i_p, pairs.j_p, pairs.image_p, pairs.slot_p
    shift_kd, slot_qk = pairs.shift_kd, pairs.slots.push_qk
    # unsigned, so that no index can count from the end
    first = np.uint64(pairs.start_s[2 * b])
    special = np.uint64(pairs.start_s[2 * b + 1])
    last = np.uint64(pairs.start_s[2 * b + 2])
    for p in range(first, special):
        i = i_p[p]
        j = j_p[p]
        dx = body[j, 0] - body[i, 0]
        dy = body[j, 1] - body[i, 1]
        dz = 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
        square = dx * dx + dy * dy
        if len(axes) == 3:
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            contact = touching_pair(rates, axes, body, i, j, dx, dy, dz, square, sigma)
            done = force_of_pair(effects, friction, axes, body, stretch_pk, p, contact, pace)
            add_force(axes, spins, push, i, done)
            add_reaction(axes, spins, push, j, done)
        else:
            reset_stretch(axes, stretch_pk, p)
    for p in range(special, last):
        i = i_p[p]
        j = j_p[p]
        k = image_p[p]
        slot = slot_p[p]
        dx = body[j, 0] - body[i, 0] + shift_kd[k, 0]
        dy = body[j, 1] - body[i, 1] + shift_kd[k, 1]
        dz = 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2] + shift_kd[k, 2]
        square = dx * dx + dy * dy
        if len(axes) == 3:
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            contact = touching_pair(rates, axes, body, i, j, dx, dy, dz, square, sigma)
            done = force_of_pair(effects, friction, axes, body, stretch_pk, p, contact, pace)
            add_force(axes, spins, push, i, done)
            if slot == NO_SLOT:
                add_reaction(axes, spins, push, j, done)
            else:
                store_reaction(axes, spins, slot_qk, slot, done)
        else:
            reset_stretch(axes, stretch_pk, p)
            if slot != NO_SLOT:
                # as many as a pair's force and torque: a loop of unknown length would become a call
                for a in range(len(axes) + len(spins)):
                    slot_qk[slot, a] = 0.0
