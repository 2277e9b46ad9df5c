# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The pass over the contacts and bonds of a march: everything that a scene may lack is chosen by type."""

from __future__ import annotations

import math

from numba import literal_unroll

from packmech.compiled import device, kernel
from packmech.dynamics.kernels import coincident_direction
from packmech.dynamics.march.bonding import bond_pass
from packmech.dynamics.march.flow import with_flow
from packmech.dynamics.march.rubbing import forget, rub
from packmech.effects import pair_first


@device
def meet(effects, friction, rates, axes, body, push, held_pk, p, i, j, dx, dy, dz, square, sigma, pace):
    """Add what a touching pair does to both."""
    r = math.sqrt(square)
    inverse = 1.0 / r
    if square == 0.0:
        dx, dy, dz = coincident_direction(i, j, len(axes))
        inverse = 1.0
    ux = body[j, 4] - body[i, 4]
    uy = body[j, 5] - body[i, 5]
    uz = 0.0
    if len(axes) == 3:
        uz = body[j, 6] - body[i, 6]
    if square > 0.0:
        ux, uy, uz = with_flow(rates, ux, uy, uz, dx, dy, dz)
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    rate = ux * nx + uy * ny + uz * nz
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, r, sigma, rate)
        elastic += pair_first(one, r, sigma, 0.0)
    push[i, 0] += first * nx
    push[i, 1] += first * ny
    push[j, 0] -= first * nx
    push[j, 1] -= first * ny
    if len(axes) == 3:
        push[i, 2] += first * nz
        push[j, 2] -= first * nz
    rub(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, abs(elastic), pace)


@kernel
def contact_pass(effects, friction, bonds, rates, axes, body, push, lattice, pairs, within_pk, crossing_pk, pace):
    """Add the forces and torques of touching pairs and of bonds to push."""
    shift_kd = pairs.shift_kd
    for p in range(pairs.count_b[1]):
        i = pairs.crossing_i_p[p]
        j = pairs.crossing_j_p[p]
        k = pairs.crossing_k_p[p]
        dx = body[j, 0] - body[i, 0] + shift_kd[k, 0]
        dy = body[j, 1] - body[i, 1] + shift_kd[k, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2] + shift_kd[k, 2]
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            meet(effects, friction, rates, axes, body, push, crossing_pk, p, i, j, dx, dy, dz, square, sigma, pace)
        else:
            forget(crossing_pk, p)
    i_p = pairs.i_p
    j_p = pairs.j_p
    for p in range(pairs.count_b[0]):
        i = i_p[p]
        j = j_p[p]
        dx = body[j, 0] - body[i, 0]
        dy = body[j, 1] - body[i, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            meet(effects, friction, rates, axes, body, push, within_pk, p, i, j, dx, dy, dz, square, sigma, pace)
        else:
            forget(within_pk, p)
    bond_pass(bonds, rates, axes, body, push, lattice, pace)
