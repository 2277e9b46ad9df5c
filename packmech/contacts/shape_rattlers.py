"""Which particles with shapes rattle, as contacts can balance no force and torque on them; and what turns freely."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from packmech.contacts.friction_cones import BALANCED
from packmech.contacts.network import pair_contacts
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, slopes_of_ends
from packmech.contacts.wall_touches import WallTouches
from packmech.packing import Packing
from packmech.shapes import Beads


def shape_rattlers(
    packing: Packing,
    contacts: ShapeContacts,
    walls: Sequence[WallTouches] = (),
    held_n: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return (N,) which particles are held by less than d + 1 contacts, or by none that can balance force and torque.

    Taken out one after the other with their contacts, until none is left. An ellipse on three contacts whose normals
    meet in one point is held: what turns it is resisted by their curvature and the forces, to higher order. Forces
    balance where no mean of what the contacts push with, each by a unit force, is smaller than 1e-6. Packings of discs
    or spheres alone are judged as those. What touches walls is held by them, too, and what is held never rattles.
    """
    shapes = packing.shapes
    assert shapes is not None
    if not shapes.turns_n.any() and not walls and held_n is None:
        return rattlers_of(pair_contacts(packing, contacts.i_c, contacts.j_c, contacts.image_cd))
    n, d = packing.particles, packing.dimension
    fixed = np.zeros(n, dtype=bool) if held_n is None else held_n
    if not len(contacts) and not any(map(len, walls)):
        return ~fixed
    turn = shapes.turn_basis(packing.radius_n)
    ends = slopes_of_ends(contacts, turn) / contacts.push_c[None, :, None]
    on_wall = [np.zeros((0, ends.shape[2]))]
    for one in walls:
        turned = np.einsum("wkt,wt->wk", turn[one.particle_w], one.slope_wx[:, d:])
        size = np.sqrt((one.slope_wx[:, :d] ** 2).sum(axis=1, keepdims=True))
        on_wall.append(np.hstack([one.slope_wx[:, :d], turned]) / size)
    touching = np.concatenate([np.zeros(0, np.int64), *(one.particle_w for one in walls)])
    owner = np.concatenate([contacts.i_c, contacts.j_c, touching])
    # a wall is one more, which never rattles
    other = np.concatenate([contacts.j_c, contacts.i_c, np.full(len(touching), n)])
    wrench = np.concatenate([ends.reshape(2 * len(contacts), -1), *on_wall])
    order = np.argsort(owner, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=n))])
    rattling = np.zeros(n + 1, dtype=bool)
    waiting = set(np.flatnonzero(~fixed).tolist())
    while waiting:
        k = min(waiting)
        waiting.discard(k)
        mine = order[start[k] : start[k + 1]]
        mine = mine[~rattling[other[mine]]]
        if rattling[k] or (len(mine) > packing.dimension and _balance(wrench[mine])):
            continue
        rattling[k] = True
        waiting.update(int(m) for m in other[mine] if m < n and not (rattling[m] or fixed[m]))
    return rattling[:n]


def _balance(wrench_kq: NDArray[np.float64]) -> bool:
    """Return whether some mean of the wrenches is zero to rounding."""
    matrix = np.vstack([wrench_kq.T, np.ones(len(wrench_kq))])
    right = np.zeros(len(matrix))
    right[-1] = 1.0
    share, left = nnls(matrix, right)
    return bool(left <= BALANCED and share.sum() > 0.5)


def free_turns(packing: Packing, contacts: ShapeContacts) -> NDArray[np.float64]:
    """Return (F, N, d + K) turns of rigid bodies about all the beads with which they touch others; none of ellipses.

    Displacements of the centers and turns as lengths (`Beads.turn_basis`): no contact changes along them, at whatever
    amplitude, until other beads touch. Nothing resists a turn about the only bead that is touched, nor in space about
    a line of those that are. Rattlers must have been taken out.
    """
    shapes, d = packing.shapes, packing.dimension
    assert shapes is not None
    turn = shapes.turn_basis(packing.radius_n)
    width = d + turn.shape[1]
    found: list[NDArray[np.float64]] = []
    if isinstance(shapes, Beads) and len(contacts):
        site = np.unique(np.concatenate([contacts.site_i_c, contacts.site_j_c]))
        owner, arm = shapes.particle_b[site], shapes.arms(packing.radius_n)
        for n in np.unique(owner):
            mine = site[owner == n]
            aside = shapes.offset_bd[mine] - shapes.offset_bd[mine[0]]
            spanned = np.linalg.matrix_rank(aside, tol=1e-9)
            there = np.flatnonzero((turn[n] != 0.0).any(axis=1))
            share = np.zeros((0, turn.shape[1]))
            if spanned == 0:
                share = np.eye(turn.shape[1])[there]
            elif spanned == 1 and len(there) == 3:
                # a row of beads does not turn about itself, which is no turn of it
                line = arm[mine[np.argmax((aside**2).sum(axis=1))]] - arm[mine[0]]
                share = np.linalg.solve(turn[n].T, line)[None]
            for one in share:
                motion = np.zeros((packing.particles, width))
                rotation = one @ turn[n]
                beside = np.zeros(3)
                beside[:d] = arm[mine[0]]
                about = np.array([0.0, 0.0, rotation[0]]) if d == 2 else rotation
                motion[n, :d] = -np.cross(about, beside)[:d]
                motion[n, d:] = one
                found.append(motion)
    return np.array(found).reshape(len(found), packing.particles, width)
