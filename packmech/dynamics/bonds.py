# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds in time steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import effective_radius
from packmech.dynamics.deformation import relative
from packmech.dynamics.friction import (
    Pull,
    Spring,
    across_contact,
    add_force,
    add_reaction,
    keep_stretch,
    slip_of_discs,
    stretch_of_force,
    torque_of,
    turning_axes,
)
from packmech.effects import Bonds, law_energy, law_first
from packmech.effects.partners import equal_partners
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.pair_list import NO_SLOT, Slots, blocks_of, collect
from packmech.minimize.passes.shape_rows import ShapeTouch


class BondTable(NamedTuple):
    """Bonds between rows: laws for compression and tension, numbers, places, rest lengths, stretches of the springs.

    Bonds are sorted as pairs are: start_s holds the first of each section, those within a block of rows and the cell
    and the special ones of each block in turn; slot_b and slots what reaches rows of other blocks. place_b is the place
    of each in the scene's bonds. image_bd is in the loops' lattice. start_n, other_s and image_sd list both ways who is
    bonded to a row, sorted, so that a bonded pair is found and taken out of the contacts. limit_bk holds the (B, 5)
    limits of bonds that break, as `BondLimits.table` does; None where they never break.
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
    limit_bk: Any = None


@device
def bond_vector(axes, body, bonds, lattice, b):
    """Return the vector of a bond between two rows."""
    i, j, image_bd = bonds.i_b[b], bonds.j_b[b], bonds.image_bd
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


@device
def bond_energy(bonds, b, r):
    """Return the energy of a bond's normal spring."""
    rest, closed = equal_partners(bonds.rest_b[b]), r < bonds.rest_b[b]
    return law_energy(bonds.compression, r, rest) if closed else law_energy(bonds.tension, r, rest)


def bond_first(compression: Any, tension: Any, r: float, rest: float) -> float:
    """Return du/dr of a bond's normal spring [force]."""
    raise NotImplementedError("bonds act in compiled loops")


@compiled_form(bond_first)
def _choose_bond_first(compression: Any, tension: Any, r: Any, rest: Any) -> Any:
    if compression == tension:
        # no branch predictor knows whether a bond is stretched: laws of one kind differ by their numbers alone

        def alike(compression, tension, r, rest):
            return law_first(compression if r < rest else tension, r, equal_partners(rest))

        return alike

    def unlike(compression, tension, r, rest):
        pair = equal_partners(rest)
        return law_first(compression, r, pair) if r < rest else law_first(tension, r, pair)

    return unlike


@inlined
def pull_of_bond(bonds, laws, b, dx, dy, dz):
    """Return what a bond does to its two rows, which are (dx, dy, dz) apart."""
    i, j = bonds.i_b[b], bonds.j_b[b]
    axes, body, pace = laws.axes, laws.body, laws.pace
    k, c = bonds.tangential_stiffness, bonds.tangential_damping
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    # ends at the same place have no direction: the next step parts them
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    ux, uy, uz = relative(laws.rates, axes, body, i, j, dx, dy, dz)
    first = 0.0
    if r == 0.0:
        # no branch that holds an array: it would be counted at every bond
        ux = uy = uz = 0.0
    else:
        first = bond_first(bonds.compression, bonds.tension, r, bonds.rest_b[b])
        first += bonds.damping * (ux * nx + uy * ny + uz * nz)
    size, other = body[i, 3], body[j, 3]
    sigma, effective = size + other, effective_radius(size, other)
    touch = ShapeTouch(True, r, sigma, effective, nx, ny, nz, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    slip = slip_of_discs(axes, body, i, j, touch, (ux, uy, uz))
    spring = Spring(bonds.stretch_bk, b, 0)
    x, y, z = stretch_of_force(axes, spring, slip, pace)
    keep_stretch(axes, spring, x, y, z, slip, pace)
    force = k * x + c * slip.sx, k * y + c * slip.sy, k * z + c * slip.sz
    across = across_contact(axes, slip, force, x, y, z, 0.0)
    return Pull(
        first * nx + across.fx, first * ny + across.fy, first * nz + across.fz,
        torque_of(slip.lever_i, across), torque_of(slip.lever_j, across), first, across, None,
    )  # fmt: skip


@inlined
def bonds_of_block(bonds, laws, push, lattice, block):
    """Add what the bonds of a block's rows do; nothing where the scene has none."""
    if bonds is None:
        return
    axes = laws.axes
    spins = turning_axes(bonds, axes)
    slot_b, slot_qk = bonds.slot_b, bonds.slots.push_qk
    for b in range(np.uint64(bonds.start_s[2 * block]), np.uint64(bonds.start_s[2 * block + 2])):
        dx, dy, dz = bond_vector(axes, laws.body, bonds, lattice, b)
        pull = pull_of_bond(bonds, laws, b, dx, dy, dz)
        add_force(axes, spins, push, bonds.i_b[b], pull)
        slot = slot_b[b]
        if slot == NO_SLOT:
            add_reaction(axes, spins, push, bonds.j_b[b], pull)
        else:
            for a in range(len(axes) + len(spins)):
                slot_qk[slot, a] = 0.0
            add_reaction(axes, spins, slot_qk, slot, pull)


@inlined
def collect_bonds(bonds, axes, spins, push, block):
    """Add what bonds of other blocks do to the rows of a block; nothing where the scene has none."""
    if bonds is not None:
        collect(axes, spins, bonds.slots, push, block)


def bond_table(
    bonds: Bonds,
    order_n: NDArray[np.int64],
    wrap_nd: NDArray[np.int64],
    change_dd: NDArray[np.int64],
    stretch_bk: NDArray[np.float64] | None,
) -> BondTable:
    """Return the bonds between rows, sorted for the loops, with images of the loops' lattice.

    Parameters
    ----------
    bonds
        The bonds between particles.
    order_n
        (N,) particle of each row.
    wrap_nd
        (N, d) lattice vectors by which particles were moved: x = row + lattice @ wrap.
    change_dd
        (d, d) whole numbers: the loops' lattice is lattice @ change.
    stretch_bk
        (B, 1 or 3) stretches of the tangential springs in the order of `bonds`; None: slack.

    """
    n, d = wrap_nd.shape
    row = np.empty(n, dtype=np.int64)
    row[order_n] = np.arange(n)
    back = np.rint(np.linalg.inv(change_dd)).astype(np.int64)
    padded = np.zeros((len(bonds), 3), dtype=np.int64)
    padded[:, :d] = (bonds.image_bd + wrap_nd[bonds.j_b] - wrap_nd[bonds.i_b]) @ back.T
    i, j = row[bonds.i_b], row[bonds.j_b]
    # a search finds a pair from either end
    start, other = np.concatenate([i, j]), np.concatenate([j, i])
    both = np.concatenate([padded, -padded])
    order = np.lexsort((*both.T[::-1], other, start))
    place, first = _sections(i, j, padded, n)
    slot, slots = _slots(i[place], j[place], n, d + (1 if d == 2 else 3))
    if stretch_bk is None:
        stretch_bk = np.zeros((len(bonds), 1 if d == 2 else 3))
    return BondTable(
        bonds.compression,
        bonds.tension,
        bonds.tangential_stiffness,
        bonds.damping,
        bonds.tangential_damping,
        i[place].astype(np.uint32),
        j[place].astype(np.uint32),
        padded[place].astype(np.float64),
        bonds.rest_length_b[place],
        stretch_bk[place],
        place,
        first,
        slot,
        slots,
        np.searchsorted(start[order], np.arange(n + 1)).astype(np.int64),
        np.ascontiguousarray(other[order]),
        np.ascontiguousarray(both[order]),
        None if bonds.breaks_at is None else bonds.breaks_at.table(len(bonds))[place],
    )


def bond_stretches(table: BondTable) -> NDArray[np.float64]:
    """Return the (B, 1 or 3) stretches in the order of the scene's bonds."""
    stretch = np.empty_like(table.stretch_bk)
    stretch[table.place_b] = table.stretch_bk
    return stretch


def _block(row_b: NDArray[np.int64], row: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.searchsorted(row_b, row, side="right") - 1


def _sections(
    i_b: NDArray[np.int64], j_b: NDArray[np.int64], image_bd: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the bonds section by section, in their own order in each, and the first of each section."""
    row = blocks_of(n)
    own = _block(row, i_b)
    section = 2 * own + ((own != _block(row, j_b)) | image_bd.any(axis=1))
    place = np.argsort(section, kind="stable")
    return place, np.searchsorted(section[place], np.arange(2 * len(row) - 1)).astype(np.int64)


def _slots(i_b: NDArray[np.int64], j_b: NDArray[np.int64], n: int, width: int) -> tuple[NDArray[np.uint32], Slots]:
    """Return the slots of sorted bonds, NO_SLOT for those within a block, and these by the block of their j."""
    row = blocks_of(n)
    other = _block(row, j_b)
    away = np.flatnonzero(_block(row, i_b) != other)
    away = away[np.argsort(other[away], kind="stable")]
    slot = np.full(len(i_b), NO_SLOT, dtype=np.uint32)
    slot[away] = np.arange(len(away), dtype=np.uint32)
    first = np.searchsorted(other[away], np.arange(len(row))).astype(np.int64)
    return slot, Slots(
        np.zeros((len(away), width)), j_b[away].astype(np.uint32), first, np.zeros(len(row) - 1, dtype=np.int64)
    )
