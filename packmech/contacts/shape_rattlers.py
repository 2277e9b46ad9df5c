"""Which particles with shapes rattle, as contacts can balance no force and torque on them; and what turns freely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from packmech.contacts.friction_cones import BALANCED
from packmech.contacts.network import pair_contacts
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, slopes_of_ends
from packmech.packing import Packing
from packmech.shapes import Beads


def shape_rattlers(packing: Packing, contacts: ShapeContacts) -> NDArray[np.bool_]:
    """Return (N,) which particles are held by less than d + 1 contacts, or by none that can balance force and torque.

    Taken out one after the other with their contacts, until none is left. An ellipse on three contacts whose normals
    meet in one point is held: what turns it is resisted by their curvature and the forces, to higher order. Forces
    balance where no mean of what the contacts push with, each by a unit force, is smaller than 1e-6. Packings of discs
    or spheres alone are judged as those.
    """
    shapes = packing.shapes
    assert shapes is not None
    if not shapes.turns_n.any():
        return rattlers_of(pair_contacts(packing, contacts.i_c, contacts.j_c, contacts.image_cd))
    n = packing.particles
    if not len(contacts):
        return np.ones(n, dtype=bool)
    turn = shapes.turn_basis(packing.radius_n)
    ends = slopes_of_ends(contacts, turn) / contacts.push_c[None, :, None]
    owner = np.concatenate([contacts.i_c, contacts.j_c])
    other = np.concatenate([contacts.j_c, contacts.i_c])
    wrench = ends.reshape(2 * len(contacts), -1)
    order = np.argsort(owner, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=n))])
    rattling = np.zeros(n, dtype=bool)
    waiting = set(range(n))
    while waiting:
        k = min(waiting)
        waiting.discard(k)
        mine = order[start[k] : start[k + 1]]
        mine = mine[~rattling[other[mine]]]
        if rattling[k] or (len(mine) > packing.dimension and _balance(wrench[mine])):
            continue
        rattling[k] = True
        waiting.update(int(m) for m in other[mine] if not rattling[m])
    return rattling


def _balance(wrench_kq: NDArray[np.float64]) -> bool:
    """Return whether some mean of the wrenches is zero to rounding."""
    matrix = np.vstack([wrench_kq.T, np.ones(len(wrench_kq))])
    right = np.zeros(len(matrix))
    right[-1] = 1.0
    share, left = nnls(matrix, right)
    return bool(left <= BALANCED and share.sum() > 0.5)


def free_turns(packing: Packing, contacts: ShapeContacts) -> int:
    """Return the number of turns of rigid bodies about all the beads with which they touch others; none of ellipses.

    Nothing resists a turn about the only bead that is touched, nor in space about a line of those that are. Rattlers
    must have been taken out.
    """
    shapes = packing.shapes
    if not isinstance(shapes, Beads) or not len(contacts):
        return 0
    site = np.unique(np.concatenate([contacts.site_i_c, contacts.site_j_c]))
    owner = shapes.particle_b[site]
    turns_n = (shapes.turn_basis(packing.radius_n) != 0.0).any(axis=2).sum(axis=1)
    free = 0
    for n in np.unique(owner):
        place = shapes.offset_bd[site[owner == n]]
        spanned = np.linalg.matrix_rank(place - place[0], tol=1e-9)
        # a row of beads does not turn about itself
        free += int(turns_n[n]) if spanned == 0 else int(spanned == 1 and turns_n[n] == 3)
    return free
