"""Where particles touch a wall: one distance each, with its slopes and curvatures.

The distance is that of the particle and its mirror image (`packmech.effects.Walls`): rho = 2 D for a disc whose center
is D from the wall. An ellipse or spheroid reaches h(n) = sqrt(n A n) toward a wall across n; its distance is
rho = 2 D r / h, the diameter 2 r times the scale D / h at which it would just touch. A rigid body has a distance for
each bead, as that is a disc or sphere. Of the energy u(rho) of both the particle has half.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.packing import Packing
from packmech.shapes import Beads, Spheroids


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
    n, t = packing.particles, 1 if d == 2 else 3
    if isinstance(shapes, Beads):
        particle = shapes.particle_b
        arm = _padded(shapes.arms(packing.radius_n))
        reach = shapes.bead_radius(packing.radius_n)
        height = height_n[particle] + side * arm[:, axis]
    else:
        particle, height = np.arange(n), height_n
        reach = packing.radius_n if shapes is None else support(shapes, packing.radius_n, axis)
    near = np.flatnonzero(height < reach)
    owner = particle[near]
    slope, curvature = np.zeros((len(near), d + t)), np.zeros((len(near), d + t, d + t))
    if shapes is None:
        slope[:, axis] = 2.0 * side
        return WallTouches(owner, 2.0 * height[near], 2.0 * reach[near], slope, curvature)
    along = np.zeros(3)
    along[axis] = 1.0
    if isinstance(shapes, Beads):
        sigma, distance = 2.0 * reach[near], 2.0 * height[near]
        slope[:, axis] = 2.0 * side
        first = np.cross(arm[near], along)
        second = _turned_twice(along, arm[near])
        slope[:, d:] = 2.0 * side * _turns(first, d)
        curvature[:, d:, d:] = 2.0 * side * _turns_of_both(second, d)
        return WallTouches(owner, distance, sigma, slope, curvature)
    radius, size, own = packing.radius_n[near], reach[near], height[near]
    a, b = (one[near] for one in shapes.semi_axes(packing.radius_n))
    director = _padded(shapes.director_nd)[near]
    cosine, excess = director[:, axis], (a - b) * (a + b)
    across = np.cross(director, along)
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
    sigma = 2.0 * radius
    over = sigma / size**2
    slope[:, axis] = side * sigma / size
    slope[:, d:] = -(own * over)[:, None] * _turns(support_1, d)
    mixed = -side * over[:, None] * _turns(support_1, d)
    curvature[:, axis, d:] = mixed
    curvature[:, d:, axis] = mixed
    bent = 2.0 * support_1[:, :, None] * support_1[:, None, :] / size[:, None, None] - support_2
    curvature[:, d:, d:] = (own * over)[:, None, None] * _turns_of_both(bent, d)
    return WallTouches(owner, own * sigma / size, sigma, slope, curvature)


def support(shapes: Spheroids, radius_n: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return (N,) how far ellipses or spheroids reach from their centers along an axis [length]."""
    along, across = shapes.semi_axes(radius_n)
    cosine = shapes.director_nd[:, axis]
    return np.asarray(np.sqrt(across**2 + (along - across) * (along + across) * cosine**2))


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
