# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds between the particles of a march, chosen by type."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.flow import relative
from packmech.dynamics.march.pairs import NO_SLOT, Slots, collect
from packmech.dynamics.march.rubbing import turning_axes
from packmech.dynamics.march.springs import (
    Pace,
    give,
    give_back,
    leave,
    slip_in_plane,
    slip_in_space,
    stretch_after,
    stretch_before,
    with_moment,
)
from packmech.effects import law_first


class BondTable(NamedTuple):
    """Bonds between rows: laws for compression and tension, numbers, places, rest lengths, stretches of the springs.

    image_bd is in the loops' lattice. visit_v lists the bonds by the block of rows of their i, start_b the first visit
    of each block, slot_v and slots what reaches rows of other blocks. start_n, other_s and image_sd list both ways who
    is bonded to a row, sorted, so that a bonded pair is found and taken out of the contacts.
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
    visit_v: NDArray[np.int64]
    start_b: NDArray[np.int64]
    slot_v: NDArray[np.uint32]
    slots: Slots
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
def _pull(bonds, rates, axes, body, lattice, pace, b):
    """Return what a bond does: force on its i, moment and arms, and its rows."""
    i, j, dx, dy, dz = bond_ends(axes, body, bonds, lattice, b)
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    # ends at the same place have no direction: the next step tells them apart
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    ux, uy, uz = relative(rates, axes, body, i, j, dx, dy, dz)
    first = 0.0
    if r > 0.0:
        first = bond_first(bonds, r, bonds.rest_b[b]) + bonds.damping * (ux * nx + uy * ny + uz * nz)
    sigma = body[i, 3] + body[j, 3]
    k, c = bonds.tangential_stiffness, bonds.tangential_damping
    stretch_bk = bonds.stretch_bk
    if len(axes) == 2:
        ai, aj, slip = slip_in_plane(body, i, j, nx, ny, ux, uy, r, sigma)
        stretch = stretch_bk[b, 0]
        if r > 0.0:
            stretch += pace.before * slip
            stretch_bk[b, 0] = stretch + pace.after * slip
        force = k * stretch + c * slip
        return (first * nx - force * ny, first * ny + force * nx, 0.0, 0.0, 0.0, force, ai, aj), i, j
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_bk[b, 0], stretch_bk[b, 1], stretch_bk[b, 2]
    if r > 0.0:
        x, y, z = stretch_before(stretch_bk, b, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
        stretch_after(stretch_bk, b, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
    fx, fy, fz, mx, my, mz, ai, aj = with_moment(nx, ny, nz, k * x + c * sx, k * y + c * sy, k * z + c * sz, ai, aj)
    return (first * nx + fx, first * ny + fy, first * nz + fz, mx, my, mz, ai, aj), i, j


@device
def _bonds_of_block(bonds, rates, axes, body, push, lattice, pace, block):
    spins = turning_axes(bonds, axes)
    for v in range(bonds.start_b[block], bonds.start_b[block + 1]):
        b = bonds.visit_v[v]
        done, i, j = _pull(bonds, rates, axes, body, lattice, pace, b)
        give(axes, spins, push, i, done)
        slot = bonds.slot_v[v]
        if slot == NO_SLOT:
            give_back(axes, spins, push, j, done)
        else:
            leave(axes, spins, bonds.slots.push_qk, slot, done)


def bonds_of_block(
    bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Pace, block: int
) -> None:
    """Add what the bonds of a block's rows do; nothing where the scene has none."""
    raise NotImplementedError("bonds act in compiled loops")


@compiled_form(bonds_of_block)
def _choose_bonds_of_block(
    bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Any, block: Any
) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, rates, axes, body, push, lattice, pace, block: None
    return lambda bonds, rates, axes, body, push, lattice, pace, block: _bonds_of_block(
        bonds, rates, axes, body, push, lattice, pace, block
    )


def collect_bonds(bonds: Any, push: Any, block: int) -> None:
    """Add what bonds of other blocks do to the rows of a block; nothing where the scene has none."""
    raise NotImplementedError("bonds act in compiled loops")


@compiled_form(collect_bonds)
def _choose_collect_bonds(bonds: Any, push: Any, block: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, push, block: None
    return lambda bonds, push, block: collect(bonds.slots, push, block)
