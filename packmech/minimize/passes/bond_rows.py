# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds inside the loops of minimizers: each row gathers what its bonds do, in the box as it is.

They travel in the tuple of effects as a record of their own. Pair lists hold bonded pairs like any others: what their
contacts do is taken off again, since a bonded pair is no contact.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.effects import law_energy, law_first, law_second, pair_energy, pair_first, pair_second
from packmech.jit.compiled import device
from packmech.measure.bonds import bonds_of, refuse_tangential_springs
from packmech.scene import Scene


class RowsBonded(NamedTuple):
    """Effects of contacts, laws of the bonds, and by rows from either end: the other end, the vector, the rest length.

    Bonds of row i are those from start_n[i] to start_n[i + 1]; their vectors are row[other] - row[i] + shift. Each bond
    is there twice, once with first_s: sums over bonds count that one.
    """

    contacts: Any
    compression: Any
    tension: Any
    start_n: NDArray[np.int64]
    other_s: NDArray[np.int64]
    shift_sd: NDArray[np.float64]
    rest_s: NDArray[np.float64]
    first_s: NDArray[np.bool_]


def bonds_of_rows(scene: Scene, order_n: NDArray[np.int64], wrap_nd: NDArray[np.float64]) -> tuple[RowsBonded, ...]:
    """Return the bonds of a scene by rows; nothing without.

    Parameters
    ----------
    scene
        The scene.
    order_n
        (N,) particle of each row.
    wrap_nd
        (N, d) lattice vectors by which particles were moved: x = row + lattice @ wrap.

    """
    bonds = bonds_of(scene.effects)
    if bonds is None:
        return ()
    refuse_tangential_springs(scene.effects)
    packing = scene.packing
    if packing.shapes.has_orientations:
        raise ValueError(
            f"scene.packing must be of discs or spheres where bonds are relaxed, got {type(packing.shapes).__name__}: "
            "leave bonds out with scene.without(pm.Bonds), or use pm.simulate"
        )
    row_n = np.empty(packing.particles, dtype=np.int64)
    row_n[order_n] = np.arange(packing.particles)
    i, j, count = bonds.i_b, bonds.j_b, len(bonds)
    shift = np.zeros((count, 3))
    shift[:, : packing.dimension] = (bonds.image_bd + wrap_nd[j] - wrap_nd[i]) @ packing.box.lattice_dd.T
    start, other = row_n[np.concatenate([i, j])], row_n[np.concatenate([j, i])]
    order = np.argsort(start, kind="stable")
    rest, first = np.tile(bonds.rest_length_b, 2), np.arange(2 * count) < count
    return (
        RowsBonded(
            tuple(one for one in scene.effects if hasattr(type(one), "pair_energy")),
            bonds.compression,
            bonds.tension,
            np.searchsorted(start[order], np.arange(packing.particles + 1)).astype(np.int64),
            other[order],
            np.concatenate([shift, -shift])[order],
            rest[order],
            first[order],
        ),
    )


@device
def push_bonded(one, shapes, axes, row, force_nd, low, high):
    """Add the forces of bonds, and take off those of contacts of bonded pairs; return their total and how many."""
    total = 0.0
    pushed = 0
    for i in range(low, high):
        fx = fy = fz = 0.0
        for s in range(one.start_n[i], one.start_n[i + 1]):
            j = one.other_s[s]
            dx = row[j, 0] - row[i, 0] + one.shift_sd[s, 0]
            dy = row[j, 1] - row[i, 1] + one.shift_sd[s, 1]
            dz = row[j, 2] - row[i, 2] + one.shift_sd[s, 2]
            r, rest, sigma = math.sqrt(dx * dx + dy * dy + dz * dz), one.rest_s[s], row[i, 3] + row[j, 3]
            first = law_first(one.compression, r, rest) if r < rest else law_first(one.tension, r, rest)
            contact = 0.0
            if r < sigma:
                for law in literal_unroll(one.contacts):
                    contact += pair_first(law, r, sigma, 0.0)
            if one.first_s[s]:
                total += abs(first) - abs(contact)
                pushed += 0 if r < sigma else 1
            # ends at one place have no direction
            push = (first - contact) / r if r > 0.0 else 0.0
            fx += push * dx
            fy += push * dy
            fz += push * dz
        force_nd[i, 0] += fx
        force_nd[i, 1] += fy
        if len(axes) == 3:
            force_nd[i, 2] += fz
    return total, pushed


@device
def survey_bonded(one, shapes, row, stiffness_n):
    """Return the energy of bonds without that of contacts of bonded pairs; add bonds' stiffness."""
    energy = 0.0
    for i in range(one.start_n.shape[0] - 1):
        for s in range(one.start_n[i], one.start_n[i + 1]):
            j = one.other_s[s]
            dx = row[j, 0] - row[i, 0] + one.shift_sd[s, 0]
            dy = row[j, 1] - row[i, 1] + one.shift_sd[s, 1]
            dz = row[j, 2] - row[i, 2] + one.shift_sd[s, 2]
            r, rest, sigma = math.sqrt(dx * dx + dy * dy + dz * dz), one.rest_s[s], row[i, 3] + row[j, 3]
            second = law_second(one.compression, r, rest) if r < rest else law_second(one.tension, r, rest)
            stiffness_n[i] += abs(second)
            if r < sigma:
                for law in literal_unroll(one.contacts):
                    stiffness_n[i] -= abs(pair_second(law, r, sigma))
            if one.first_s[s]:
                energy += law_energy(one.compression, r, rest) if r < rest else law_energy(one.tension, r, rest)
                if r < sigma:
                    for law in literal_unroll(one.contacts):
                        energy -= pair_energy(law, r, sigma)
    return energy, 0.0
