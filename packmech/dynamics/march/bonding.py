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
from packmech.dynamics.march.inlined import inlined, inlined_form
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

    Bonds are sorted as pairs are: start_s holds the first of each section, those within a block of rows and the cell
    and the special ones of each block in turn; slot_b and slots what reaches rows of other blocks. place_b is the place
    of each in the scene's bonds. image_bd is in the loops' lattice. start_n, other_s and image_sd list both ways who is
    bonded to a row, sorted, so that a bonded pair is found and taken out of the contacts.
    """

    compression: Any
    tension: Any
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    i_b: NDArray[np.uint32]
    j_b: NDArray[np.uint32]
    image_bd: NDArray[np.float64]
    rest_b: NDArray[np.float64]
    stretch_bk: NDArray[np.float64]
    place_b: NDArray[np.int64]
    start_s: NDArray[np.int64]
    slot_b: NDArray[np.uint32]
    slots: Slots
    start_n: NDArray[np.int64]
    other_s: NDArray[np.int64]
    image_sd: NDArray[np.int64]


@device
def bond_vector(axes, body, image_bd, lattice, b, i, j):
    """Return the vector of a bond between two rows."""
    dx = body[j, 0] - body[i, 0]
    dy = body[j, 1] - body[i, 1]
    dz = 0.0
    for k in range(len(axes)):
        dx += lattice[0, k] * image_bd[b, k]
        dy += lattice[1, k] * image_bd[b, k]
    if len(axes) == 3:
        dz = body[j, 2] - body[i, 2]
        for k in range(3):
            dz += lattice[2, k] * image_bd[b, k]
    return dx, dy, dz


def bond_first(compression: Any, tension: Any, r: float, rest: float) -> float:
    """Return du/dr of a bond's normal spring [force]."""
    raise NotImplementedError("bonds act in compiled loops")


@compiled_form(bond_first)
def _choose_bond_first(compression: Any, tension: Any, r: Any, rest: Any) -> Any:
    if compression == tension:
        # whether a bond is stretched is not to be foretold: laws of one kind are told apart by their numbers alone

        def alike(compression, tension, r, rest):
            return law_first(compression if r < rest else tension, r, rest)

        return alike

    def unlike(compression, tension, r, rest):
        return law_first(compression, r, rest) if r < rest else law_first(tension, r, rest)

    return unlike


@inlined
def _pull(laws, numbers, rates, axes, body, stretch_bk, pace, b, i, j, dx, dy, dz, rest):
    """Return what a bond does: force on its i, moment and arms."""
    compression, tension = laws
    k, damping, c = numbers
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    # ends at the same place have no direction: the next step tells them apart
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    ux, uy, uz = relative(rates, axes, body, i, j, dx, dy, dz)
    first = 0.0
    if r == 0.0:
        # no branch that holds an array: it would be counted at every bond
        ux = uy = uz = 0.0
    else:
        first = bond_first(compression, tension, r, rest) + damping * (ux * nx + uy * ny + uz * nz)
    sigma = body[i, 3] + body[j, 3]
    if len(axes) == 2:
        ai, aj, slip = slip_in_plane(body, i, j, nx, ny, ux, uy, r, sigma)
        stretch = stretch_bk[b, 0] + pace.before * slip
        stretch_bk[b, 0] = stretch + pace.after * slip
        force = k * stretch + c * slip
        return first * nx - force * ny, first * ny + force * nx, 0.0, 0.0, 0.0, force, ai, aj
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_before(stretch_bk, b, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
    stretch_after(stretch_bk, b, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
    fx, fy, fz, mx, my, mz, ai, aj = with_moment(nx, ny, nz, k * x + c * sx, k * y + c * sy, k * z + c * sz, ai, aj)
    return first * nx + fx, first * ny + fy, first * nz + fz, mx, my, mz, ai, aj


@inlined
def _bonds_of_block(bonds, rates, axes, body, push, lattice, pace, block):
    spins = turning_axes(bonds, axes)
    slot_b, slot_qk = bonds.slot_b, bonds.slots.push_qk
    i_b, j_b, image_bd, rest_b, stretch_bk = bonds.i_b, bonds.j_b, bonds.image_bd, bonds.rest_b, bonds.stretch_bk
    laws = bonds.compression, bonds.tension
    numbers = bonds.tangential_stiffness, bonds.damping, bonds.tangential_damping
    first = np.uint64(bonds.start_s[2 * block])
    special = np.uint64(bonds.start_s[2 * block + 1])
    last = np.uint64(bonds.start_s[2 * block + 2])
    for b in range(first, special):
        i, j = i_b[b], j_b[b]
        dx = body[j, 0] - body[i, 0]
        dy = body[j, 1] - body[i, 1]
        dz = 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
        done = _pull(laws, numbers, rates, axes, body, stretch_bk, pace, b, i, j, dx, dy, dz, rest_b[b])
        give(axes, spins, push, i, done)
        give_back(axes, spins, push, j, done)
    for b in range(special, last):
        i, j = i_b[b], j_b[b]
        dx, dy, dz = bond_vector(axes, body, image_bd, lattice, b, i, j)
        done = _pull(laws, numbers, rates, axes, body, stretch_bk, pace, b, i, j, dx, dy, dz, rest_b[b])
        give(axes, spins, push, i, done)
        slot = slot_b[b]
        if slot == NO_SLOT:
            give_back(axes, spins, push, j, done)
        else:
            leave(axes, spins, slot_qk, slot, done)


def bonds_of_block(
    bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Pace, block: int
) -> None:
    """Add what the bonds of a block's rows do; nothing where the scene has none."""
    raise NotImplementedError("bonds act in compiled loops")


@inlined_form(bonds_of_block)
def _choose_bonds_of_block(
    bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Any, block: Any
) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, rates, axes, body, push, lattice, pace, block: None
    return lambda bonds, rates, axes, body, push, lattice, pace, block: _bonds_of_block(
        bonds, rates, axes, body, push, lattice, pace, block
    )


def collect_bonds(bonds: Any, axes: Any, spins: Any, push: Any, block: int) -> None:
    """Add what bonds of other blocks do to the rows of a block; nothing where the scene has none."""
    raise NotImplementedError("bonds act in compiled loops")


@inlined_form(collect_bonds)
def _choose_collect_bonds(bonds: Any, axes: Any, spins: Any, push: Any, block: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, axes, spins, push, block: None
    return lambda bonds, axes, spins, push, block: collect(axes, spins, bonds.slots, push, block)
