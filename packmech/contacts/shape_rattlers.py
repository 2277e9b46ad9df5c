"""Which particles with shapes rattle: their contacts can balance no force and torque on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from packmech.contacts.friction_cones import BALANCED
from packmech.contacts.network import pair_contacts
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, slopes_of_ends
from packmech.packing import Packing


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
