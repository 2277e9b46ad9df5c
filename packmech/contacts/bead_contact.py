"""Distances of beads of rigid bodies, with slopes and curvatures along the pair's coordinates.

With arms a_i and a_j from the centers to the beads, w = v + a_j - a_i and n = w / |w|, a rotation of the body i by dt
moves its bead by dt x a_i + dt x (dt x a_i) / 2, so that

    d|w| / dt_i = -a_i x n,    d|w| / dt_j = a_j x n

and second derivatives follow from those of |w|, with the curvature of the beads' paths along n.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bead_contacts(
    apart_cd: NDArray[np.float64], arm_i_cd: NDArray[np.float64], arm_j_cd: NDArray[np.float64], *, second: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (C,) distances, (C, X) slopes along v and the rotations of i and j, and (C, X, X) curvatures if asked for.

    Parameters
    ----------
    apart_cd
        Vectors from bead to bead [length], none of them zero.
    arm_i_cd, arm_j_cd
        Vectors from the centers to the beads [length].
    second
        Whether curvatures are asked for; none otherwise.

    """
    count, d = apart_cd.shape
    distance = np.sqrt((apart_cd**2).sum(axis=1))
    normal = apart_cd / distance[:, None]
    # (C, d, X): how the vector between the beads moves with each coordinate
    shift = np.concatenate(
        [np.broadcast_to(np.eye(d), (count, d, d)), -turned_arms(arm_i_cd), turned_arms(arm_j_cd)], axis=2
    )
    slope = (normal[:, :, None] * shift).sum(axis=1)
    if not second:
        return distance, slope, np.zeros((0, slope.shape[1], slope.shape[1]))
    across = shift - normal[:, :, None] * slope[:, None, :]
    curvature = np.einsum("cdx,cdy->cxy", across, across) / distance[:, None, None]
    t = (slope.shape[1] - d) // 2
    curvature[:, d : d + t, d : d + t] -= _bent(arm_i_cd, normal)
    curvature[:, d + t :, d + t :] += _bent(arm_j_cd, normal)
    return distance, slope, curvature


def turned_arms(arm_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (C, d, t) how turns move the ends of arms: the cross product of each axis of rotation with the arm."""
    if arm_cd.shape[1] == 2:
        return np.stack([-arm_cd[:, 1], arm_cd[:, 0]], axis=1)[:, :, None]
    return np.cross(np.eye(3)[None], arm_cd[:, None, :]).transpose(0, 2, 1)


def _bent(arm_cd: NDArray[np.float64], normal_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (C, t, t) second derivatives by rotations of where arms end, along the normal."""
    along = (arm_cd * normal_cd).sum(axis=1)[:, None, None]
    if arm_cd.shape[1] == 2:
        return np.asarray(-along)
    mixed = arm_cd[:, :, None] * normal_cd[:, None, :]
    return np.asarray(0.5 * (mixed + mixed.transpose(0, 2, 1)) - along * np.eye(3))
