"""Where particles touch a wall: one distance each, with its slopes and curvatures.

The distance is that of the particle and its mirror image (`packmech.effects.Walls`): rho = 2 D for a disc whose center
is D from the wall. An ellipse or spheroid reaches h(n) = sqrt(n A n) toward a wall across n; its distance is
rho = 2 D r / h, the diameter 2 r times the scale D / h at which it would just touch. A rigid body has a distance for
each bead, as that is a disc or sphere: h = r, off the center of the body. Of the energy u(rho) of both the particle has
half.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.packing import Packing


class WallTouches(NamedTuple):
    """Particles, or their beads, that touch a wall, sorted by them.

    Attributes
    ----------
    particle_w
        (W,) particles.
    distance_w, contact_distance_w
        (W,) distances at which the law is taken, and those at which they would just touch [length].
    slope_wx, curvature_wxx
        (W, X) slopes and (W, X, X) second derivatives of the distance along the position and the rotation of the
        particle, X = 3 in a plane and 6 in space; the mirror image moves with it.

    """

    particle_w: NDArray[np.int64]
    distance_w: NDArray[np.float64]
    contact_distance_w: NDArray[np.float64]
    slope_wx: NDArray[np.float64]
    curvature_wxx: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.particle_w)


def wall_touches(packing: Packing, height_n: NDArray[np.float64], axis: int, side: float) -> WallTouches:
    """Return what touches a wall across an axis.

    Parameters
    ----------
    packing
        The packing.
    height_n
        (N,) distances of the centers from the wall [length].
    axis
        The axis.
    side
        1 for a wall below the particles, -1 for one above.

    """
    shapes, d = packing.shapes, packing.dimension
    t = 1 if d == 2 else 3
    particle, arm, axis_b3 = shapes.particle_b, _padded(shapes.arms(packing.radius_n)), _padded(shapes.axis_bd)
    a, b = shapes.semi_axes(packing.radius_n)
    excess = (a - b) * (a + b)
    # how far sites reach from their centers along the axis
    support = np.sqrt(b**2 + excess * axis_b3[:, axis] ** 2)
    height = height_n[particle] + side * arm[:, axis]
    near = np.flatnonzero(height < support)
    size, own, arm, director, excess = support[near], height[near], arm[near], axis_b3[near], excess[near]
    sigma = 2.0 * shapes.site_radius(packing.radius_n)[near]
    along = np.zeros(3)
    along[axis] = 1.0
    cosine, across = director[:, axis], np.cross(director, along)
    # derivatives of the square of the support, then of the support
    square_1 = 2.0 * (excess * cosine)[:, None] * across
    square_2 = (
        2.0
        * excess[:, None, None]
        * (across[:, :, None] * across[:, None, :] + cosine[:, None, None] * _turned_twice(along, director))
    )
    support_1 = square_1 / (2.0 * size[:, None])
    support_2 = (
        square_2 / (2.0 * size[:, None, None]) - support_1[:, :, None] * support_1[:, None, :] / (size[:, None, None])
    )
    # rho = scale * height, where the scale turns with sites that are long, and the height with those beside centers
    scale, over = sigma / size, sigma / size**2
    height_1, height_2 = side * np.cross(arm, along), side * _turned_twice(along, arm)
    slope, curvature = np.zeros((len(near), d + t)), np.zeros((len(near), d + t, d + t))
    slope[:, axis] = side * scale
    slope[:, d:] = _turns(scale[:, None] * height_1 - (own * over)[:, None] * support_1, d)
    mixed = -side * over[:, None] * _turns(support_1, d)
    curvature[:, axis, d:] = mixed
    curvature[:, d:, axis] = mixed
    bent = 2.0 * support_1[:, :, None] * support_1[:, None, :] / size[:, None, None] - support_2
    both = height_1[:, :, None] * support_1[:, None, :]
    whole = scale[:, None, None] * height_2 + (own * over)[:, None, None] * bent
    whole -= over[:, None, None] * (both + both.transpose(0, 2, 1))
    curvature[:, d:, d:] = _turns_of_both(whole, d)
    return WallTouches(particle[near], own * scale, sigma, slope, curvature)


def _padded(vector_nd: NDArray[np.float64]) -> NDArray[np.float64]:
    found = np.zeros((len(vector_nd), 3))
    found[:, : vector_nd.shape[1]] = vector_nd
    return found


def _turned_twice(along: NDArray[np.float64], vector_w3: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (W, 3, 3) second derivatives of a component of vectors by a rotation vector, at none."""
    outer = along[None, :, None] * vector_w3[:, None, :]
    return np.asarray(0.5 * (outer + outer.transpose(0, 2, 1)) - (vector_w3 @ along)[:, None, None] * np.eye(3))


def _turns(vector_w3: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """Return the components by rotations that there are: about the third axis in a plane."""
    return vector_w3[:, 2:] if dimension == 2 else vector_w3


def _turns_of_both(matrix_w33: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    return matrix_w33[:, 2:, 2:] if dimension == 2 else matrix_w33
