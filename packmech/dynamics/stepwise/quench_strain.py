# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""A packing in compiled loops strained with its box: particles, or clusters of linked ones, go along."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device
from packmech.contacts.cells import Frame
from packmech.dynamics.kernels import Space
from packmech.dynamics.pair_list import SKIN_OUTER, TRAVEL


class Bodies(NamedTuple):
    """What is strained as one, and what counts as one when contacts are counted: clusters of linked rows, or rows.

    cluster_n is the number of each row's cluster, freedom_c its motions, offset_nd the images that unwrap it, and
    winding_n whether it winds around the box. i_l, j_l and image_ld are the links. volume is that of the particles.
    The rest is working space: the rows and the lattice before a step, centers of clusters, and their contacts.
    """

    cluster_n: NDArray[np.int64]
    freedom_c: NDArray[np.int64]
    offset_nd: NDArray[np.float64]
    winding_n: NDArray[np.bool_]
    i_l: NDArray[np.int64]
    j_l: NDArray[np.int64]
    image_ld: NDArray[np.float64]
    volume: float
    last_nd: NDArray[np.float64]
    last_dd: NDArray[np.float64]
    center_cd: NDArray[np.float64]
    touching_c: NDArray[np.int64]
    loose_c: NDArray[np.bool_]


@device
def set_frame(frame, lattice_dd):
    """Write the lattice, its inverse and the distances between faces into the frame."""
    a = lattice_dd
    inverse = frame.inverse_dd
    for i in range(3):
        for j in range(3):
            frame.lattice_dd[i, j] = a[i, j]
            p, q = (j + 1) % 3, (j + 2) % 3
            r, s = (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    determinant = a[0, 0] * inverse[0, 0] + a[0, 1] * inverse[1, 0] + a[0, 2] * inverse[2, 0]
    for i in range(3):
        square = 0.0
        for j in range(3):
            inverse[i, j] /= determinant
            square += inverse[i, j] * inverse[i, j]
        frame.height_d[i] = 1.0 / math.sqrt(square)


@device
def lattice_volume(lattice_dd):
    """Return the volume of a cell."""
    a = lattice_dd
    return abs(
        a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
        - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
        + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0])
    )


@device
def _largest(axes, row, lattice_dd):
    most = 0.0
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            most = max(most, abs(row[i, a]))
    for a in range(len(axes)):
        for b in range(len(axes)):
            most = max(most, abs(lattice_dd[a, b]))
    return most


@device
def _map_rows(axes, row, bodies, old_dd, new_dd, map_dd):
    """Carry particles, or the centers of clusters, along with the box; a cluster that winds is strained."""
    d = len(axes)
    n = row.shape[0]
    moved = np.empty(3)
    if bodies.freedom_c.shape[0] == n:
        for i in range(n):
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    moved[a] += map_dd[a, b] * row[i, b]
            for a in range(d):
                row[i, a] = moved[a]
        return
    center = bodies.center_cd
    count = bodies.touching_c
    for c in range(center.shape[0]):
        count[c] = 0
        for a in range(3):
            center[c, a] = 0.0
    for i in range(n):
        c = bodies.cluster_n[i]
        count[c] += 1
        for a in range(d):
            for b in range(d):
                row[i, a] += old_dd[a, b] * bodies.offset_nd[i, b]
            center[c, a] += row[i, a]
    for i in range(n):
        c = bodies.cluster_n[i]
        for a in range(d):
            moved[a] = row[i, a]
            for b in range(d):
                held = row[i, b] if bodies.winding_n[i] else center[c, b] / count[c]
                moved[a] += (map_dd[a, b] - (1.0 if a == b else 0.0)) * held
        for a in range(d):
            row[i, a] = moved[a]
            for b in range(d):
                row[i, a] -= new_dd[a, b] * bodies.offset_nd[i, b]


@device
def strain_slot(axes, row, space, pairs, bodies, map_dd):
    """Strain the box and what is in it; return the space as it is then. The pair list is kept as far as it holds."""
    d = len(axes)
    frame = space.frame
    new = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for k in range(3):
                new[a, b] += map_dd[a, k] * frame.lattice_dd[k, b]
    _map_rows(axes, row, bodies, frame.lattice_dd, new, map_dd)
    set_frame(frame, new)
    # no distance shrinks by more than the size of the strain tells
    strain2 = 0.0
    for a in range(d):
        for b in range(d):
            strain2 += (map_dd[a, b] - (1.0 if a == b else 0.0)) ** 2
    shrink = max(0.0, 1.0 - math.sqrt(strain2))
    moved = np.empty(3)
    anchor = pairs.outer_anchor_nd
    for i in range(row.shape[0]):
        for a in range(d):
            moved[a] = 0.0
            for b in range(d):
                moved[a] += map_dd[a, b] * anchor[i, b]
        for a in range(d):
            anchor[i, a] = moved[a]
    widest = 0.0
    for a in range(space.sizes.largest_a.shape[0]):
        widest = max(widest, space.sizes.largest_a[a])
    pairs.number[SKIN_OUTER] = shrink * pairs.number[SKIN_OUTER] - (1.0 - shrink) * 4.0 * widest
    pairs.number[TRAVEL] = np.inf
    return refreshed(axes, row, space)


@device
def refreshed(axes, row, space):
    """Return the space with the rounding of the places as they are."""
    resolution = 2.220446049250313e-16 * _largest(axes, row, space.frame.lattice_dd)
    return Space(space.sizes, Frame(space.frame.lattice_dd, space.frame.inverse_dd, space.frame.height_d),
                 resolution, space.joints)  # fmt: skip


@device
def is_identity(map_dd):
    """Whether a map moves nothing."""
    for a in range(3):
        for b in range(3):
            if map_dd[a, b] != (1.0 if a == b else 0.0):
                return False
    return True
