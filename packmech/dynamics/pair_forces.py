# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Who pushes whom in a march, contacts and bonds alike, with force and branch vector; looking changes no bit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.march.bonding import bond_first, bond_vector
from packmech.dynamics.march.flow import rates, relative
from packmech.dynamics.march.inlined import lean
from packmech.dynamics.march.look import along_contact, seen_pair, slip_of, stretch_now, touch

if TYPE_CHECKING:
    from packmech.dynamics.march.state import March


class PairForces(NamedTuple):
    """Every touching pair once, then every bond.

    i_k, j_k are particles; branch_kd (K, d) points from i to the image of j that is meant [length], force_kd (K, d) is
    the whole force on i, dashpots and friction included [force]; bonded_k marks the bonds.
    """

    i_k: NDArray[np.int64]
    j_k: NDArray[np.int64]
    force_kd: NDArray[np.float64]
    branch_kd: NDArray[np.float64]
    bonded_k: NDArray[np.bool_]

    def net(self, particles: int) -> NDArray[np.float64]:
        """Return the (N, d) sums of these forces on each particle [force]."""
        total = np.zeros((particles, self.force_kd.shape[1]))
        np.add.at(total, self.i_k, self.force_kd)
        np.subtract.at(total, self.j_k, self.force_kd)
        return total


def pair_forces(march: March) -> PairForces:
    """Return the forces of contacts and bonds of a march at the present moment.

    Their sum of force times branch vector, over the volume, is the contact stress that a march reports; which of them
    reach a wall, or a particle, is for the caller to choose.
    """
    if not march.started:
        march.begin()
    d = len(march.axes)
    bonds = 0 if march.space.bonds is None else len(march.space.bonds.i_b)
    most = len(march.pairs.i_p) + bonds
    row_k2 = np.zeros((most, 2), dtype=np.int64)
    force, branch = np.zeros((most, 3)), np.zeros((most, 3))
    count = 0
    if march.acting.pairs is not None:
        count = _list_contacts(
            *(march.acting, march.axes, march.state, march.space, march.pairs, march.track, march.pace),
            *(row_k2, force, branch),
        )
    whole = _list_all_bonds(march.axes, march.state, march.space, march.pace, count, row_k2, force, branch)
    order = march.order_n
    return PairForces(
        order[row_k2[:whole, 0]],
        order[row_k2[:whole, 1]],
        force[:whole, :d],
        branch[:whole, :d],
        np.arange(whole) >= count,
    )


@device
def _write(row_k2, force_k3, branch_k3, k, i, j, fx, fy, fz, dx, dy, dz):
    row_k2[k, 0], row_k2[k, 1] = i, j
    force_k3[k, 0], force_k3[k, 1], force_k3[k, 2] = fx, fy, fz
    branch_k3[k, 0], branch_k3[k, 1], branch_k3[k, 2] = dx, dy, dz


@lean
def _list_contacts(acting, axes, state, space, pairs, track, pace, row_k2, force_k3, branch_k3):
    """Write the touching pairs; return how many there are."""
    flowing = rates(space.flow)
    body = state.body
    held_pk = None if track is None else track.inner_pk
    count = 0
    for s in range(pairs.start_s.shape[0] - 1):
        for p in range(pairs.start_s[s], pairs.start_s[s + 1]):
            i, j = pairs.i_p[p], pairs.j_p[p]
            dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], 0.0
            if len(axes) == 3:
                dz = body[j, 2] - body[i, 2]
            if s % 2 == 1:
                k = pairs.image_p[p]
                dx += pairs.shift_kd[k, 0]
                dy += pairs.shift_kd[k, 1]
                dz += pairs.shift_kd[k, 2]
            square = dx * dx + dy * dy + dz * dz
            # coincident centers push along no branch vector
            if square == 0.0 or not touch(body, i, j, dx, dy, dz):
                continue
            _, _, _, _, (gx, gy, gz), (fx, fy, fz), _, _ = seen_pair(
                acting.pairs, acting.friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace
            )
            _write(row_k2, force_k3, branch_k3, count, i, j, gx + fx, gy + fy, gz + fz, dx, dy, dz)
            count += 1
    return count


@device
def _list_bonds(bonds, flowing, axes, body, lattice, pace, first_k, row_k2, force_k3, branch_k3):
    k = first_k
    for b in range(bonds.i_b.shape[0]):
        i, j = bonds.i_b[b], bonds.j_b[b]
        dx, dy, dz = bond_vector(axes, body, bonds.image_bd, lattice, b, i, j)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        if r == 0.0:
            continue
        nx, ny, nz = dx / r, dy / r, dz / r
        ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
        sigma = body[i, 3] + body[j, 3]
        first = bond_first(bonds.compression, bonds.tension, r, bonds.rest_b[b])
        first += bonds.damping * (ux * nx + uy * ny + uz * nz)
        _, _, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
        x, y, z = stretch_now(axes, bonds.stretch_bk, b, sx, sy, sz, ox, oy, oz, pace.after)
        stiff, slow = bonds.tangential_stiffness, bonds.tangential_damping
        fx, fy, fz = along_contact(axes, nx, ny, stiff * x + slow * sx, stiff * y + slow * sy, stiff * z + slow * sz)
        _write(row_k2, force_k3, branch_k3, k, i, j, first * nx + fx, first * ny + fy, first * nz + fz, dx, dy, dz)
        k += 1
    return k


def list_bonds(
    bonds: Any,
    flowing: Any,
    axes: Any,
    body: Any,
    lattice: Any,
    pace: Any,
    first_k: int,
    row_k2: Any,
    force_k3: Any,
    branch_k3: Any,
) -> int:
    """Write the bonds behind what is there; return how many there are in all."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(list_bonds)
def _choose_list_bonds(
    bonds: Any,
    flowing: Any,
    axes: Any,
    body: Any,
    lattice: Any,
    pace: Any,
    first_k: Any,
    row_k2: Any,
    force_k3: Any,
    branch_k3: Any,
) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, flowing, axes, body, lattice, pace, first_k, row_k2, force_k3, branch_k3: first_k
    return lambda bonds, flowing, axes, body, lattice, pace, first_k, row_k2, force_k3, branch_k3: _list_bonds(
        bonds, flowing, axes, body, lattice, pace, first_k, row_k2, force_k3, branch_k3
    )


@kernel
def _list_all_bonds(axes, state, space, pace, first_k, row_k2, force_k3, branch_k3):
    flowing = rates(space.flow)
    return list_bonds(
        space.bonds, flowing, axes, state.body, space.frame.lattice_dd, pace, first_k, row_k2, force_k3, branch_k3
    )
