"""Where particles touch a wall: one distance each, with its slopes and curvatures.

The distance is that of the particle and its mirror image (`packmech.effects.Walls`): rho = 2 D for a disc whose center
is D from the wall. An ellipse or spheroid reaches h(n) = sqrt(n A n) toward a wall across n; its distance is
rho = 2 D r / h, the diameter 2 r times the scale D / h at which it would just touch. So it is of superellipsoids, with
their own h (`Superellipsoids.surface_points`). A rigid body has a distance for each bead, as that is a disc or sphere:
h = r, off the center of the body. Of the energy u(rho) of both the particle has half.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.packing import Packing
from packmech.shapes import Superellipsoids


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
    particle, arm = shapes.particle_b, _padded(shapes.arms(packing.radius_n))
    along = np.eye(3)[axis]
    support = _SUPPORTS.get(type(shapes), _support_of_spheroids)(shapes, packing.radius_n, along)
    height = height_n[particle] + side * arm[:, axis]
    near = np.flatnonzero(height < support.size_b)
    size, own, arm = support.size_b[near], height[near], arm[near]
    sigma = 2.0 * shapes.site_radius(packing.radius_n)[near]
    support_1, support_2 = support.slopes(near)
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


class _Support(NamedTuple):
    """How far (B,) sites reach along an axis; what returns slopes and second derivatives of some by their turns."""

    size_b: NDArray[np.float64]
    slopes: Callable[[NDArray[np.int64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


def _support_of_spheroids(shapes: Any, radius_n: NDArray[np.float64], along: NDArray[np.float64]) -> _Support:
    """Return the support of discs, spheroids or beads."""
    axis, axis_b3 = int(along.argmax()), _padded(shapes.axis_bd)
    a, b = shapes.semi_axes(radius_n)
    excess_b = (a - b) * (a + b)
    size_b = np.sqrt(b**2 + excess_b * axis_b3[:, axis] ** 2)

    def slopes(near: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        size, director, excess = size_b[near], axis_b3[near], excess_b[near]
        cosine, across = director[:, axis], np.cross(director, along)
        # derivatives of the square of the support, then of the support
        square_1 = 2.0 * (excess * cosine)[:, None] * across
        square_2 = (
            2.0
            * excess[:, None, None]
            * (across[:, :, None] * across[:, None, :] + cosine[:, None, None] * _turned_twice(along, director))
        )
        first = square_1 / (2.0 * size[:, None])
        second = square_2 / (2.0 * size[:, None, None]) - first[:, :, None] * first[:, None, :] / (size[:, None, None])
        return first, second

    return _Support(size_b, slopes)


def _support_of_superellipsoids(shapes: Any, radius_n: NDArray[np.float64], along: NDArray[np.float64]) -> _Support:
    """Return the support of superellipsoids, whose slope along the axis is the point of the surface."""
    d = shapes.dimension
    normal_nd = np.tile(along[:d], (len(shapes), 1))
    point_n3 = _padded(shapes.surface_points(normal_nd, radius_n))

    def slopes(near: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        bend = np.zeros((len(near), 3, 3))
        bend[:, :d, :d] = shapes.surface_bends(normal_nd, radius_n)[near]
        # the axis turns against the shape
        turned = np.cross(np.eye(3), along)
        return np.cross(point_n3[near], along), turned @ bend @ turned.T + _turned_twice(along, point_n3[near])

    return _Support(point_n3 @ along, slopes)


# the support of each kind of shape, that of spheroids where there is none here
_SUPPORTS: dict[type, Callable[[Any, NDArray[np.float64], NDArray[np.float64]], _Support]] = {
    Superellipsoids: _support_of_superellipsoids
}


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
