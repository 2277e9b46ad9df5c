# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds between the particles of a march, chosen by type."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.flow import with_flow
from packmech.dynamics.march.springs import Pace, push_in_space, slip_in_space, stretch_after, stretch_before
from packmech.effects import law_first


class BondTable(NamedTuple):
    """Bonds between rows: laws for compression and tension, numbers, places, rest lengths, stretches of the springs.

    image_bd is in the loops' lattice; start_n, other_s and image_sd list both ways who is bonded to a row, sorted, so
    that a bonded pair is found and taken out of the contacts.
    """

    compression: Any
    tension: Any
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    image_bd: NDArray[np.float64]
    rest_b: NDArray[np.float64]
    stretch_bk: NDArray[np.float64]
    start_n: NDArray[np.int64]
    other_s: NDArray[np.int64]
    image_sd: NDArray[np.int64]


@device
def bond_ends(axes, body, bonds, lattice, b):
    """Return the rows of a bond and the vector between them."""
    i, j = bonds.i_b[b], bonds.j_b[b]
    dx = body[j, 0] - body[i, 0]
    dy = body[j, 1] - body[i, 1]
    dz = 0.0
    for k in range(len(axes)):
        dx += lattice[0, k] * bonds.image_bd[b, k]
        dy += lattice[1, k] * bonds.image_bd[b, k]
    if len(axes) == 3:
        dz = body[j, 2] - body[i, 2]
        for k in range(3):
            dz += lattice[2, k] * bonds.image_bd[b, k]
    return i, j, dx, dy, dz


@device
def bond_first(bonds, r, rest):
    """Return du/dr of a bond's normal spring [force]."""
    if r < rest:
        return law_first(bonds.compression, r, rest)
    return law_first(bonds.tension, r, rest)


@device
def _bond_pass(bonds, rates, axes, body, push, lattice, pace):
    for b in range(bonds.i_b.shape[0]):
        i, j, dx, dy, dz = bond_ends(axes, body, bonds, lattice, b)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        if r == 0.0:
            # no direction is better than another: the next step tells them apart
            continue
        nx, ny, nz = dx / r, dy / r, dz / r
        ux = body[j, 4] - body[i, 4]
        uy = body[j, 5] - body[i, 5]
        uz = 0.0
        if len(axes) == 3:
            uz = body[j, 6] - body[i, 6]
        ux, uy, uz = with_flow(rates, ux, uy, uz, dx, dy, dz)
        first = bond_first(bonds, r, bonds.rest_b[b]) + bonds.damping * (ux * nx + uy * ny + uz * nz)
        push[i, 0] += first * nx
        push[i, 1] += first * ny
        push[j, 0] -= first * nx
        push[j, 1] -= first * ny
        sigma = body[i, 3] + body[j, 3]
        if len(axes) == 2:
            ai = body[i, 3] * r / sigma
            aj = body[j, 3] * r / sigma
            slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
            stretch = bonds.stretch_bk[b, 0] + pace.before * slip
            force = bonds.tangential_stiffness * stretch + bonds.tangential_damping * slip
            bonds.stretch_bk[b, 0] = stretch + pace.after * slip
            push[i, 0] += force * -ny
            push[i, 1] += force * nx
            push[j, 0] -= force * -ny
            push[j, 1] -= force * nx
            push[i, 2] += ai * force
            push[j, 2] += aj * force
        else:
            push[i, 2] += first * nz
            push[j, 2] -= first * nz
            ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
            x, y, z = stretch_before(bonds.stretch_bk, b, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
            fx = bonds.tangential_stiffness * x + bonds.tangential_damping * sx
            fy = bonds.tangential_stiffness * y + bonds.tangential_damping * sy
            fz = bonds.tangential_stiffness * z + bonds.tangential_damping * sz
            stretch_after(bonds.stretch_bk, b, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
            push_in_space(push, i, j, ai, aj, nx, ny, nz, fx, fy, fz)


def bond_pass(bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Pace) -> None:
    """Add the forces and torques of all bonds; nothing where the scene has none."""
    if bonds is not None:
        _bond_pass(bonds, rates, axes, body, push, lattice, pace)


@compiled_form(bond_pass)
def _choose_bond_pass(bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, rates, axes, body, push, lattice, pace: None
    return lambda bonds, rates, axes, body, push, lattice, pace: _bond_pass(
        bonds, rates, axes, body, push, lattice, pace
    )
