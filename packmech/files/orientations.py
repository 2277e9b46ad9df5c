"""Quaternions and semi-axes, by which other programs say what ellipsoids are, and spheroids of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.packing import Packing
from packmech.shapes import Spheroids

# by what numbers differ that are the same in single precision [1]
ROUNDING = 4 * float(np.finfo(np.float32).eps)


def quaternions_to(director_nd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 4) unit quaternions, real part first, that turn the first axis to directors the shortest way."""
    director = np.zeros((len(director_nd), 3))
    director[:, : director_nd.shape[1]] = director_nd
    # the turn about what is across both
    turn = np.column_stack([1.0 + director[:, 0], np.zeros(len(director)), -director[:, 2], director[:, 1]])
    back = turn[:, 0] < 1e-6
    turn[back] = (0.0, 0.0, 0.0, 1.0)
    return np.asarray(turn / np.sqrt((turn**2).sum(axis=1, keepdims=True)))


def ellipsoids_of(packing: Packing) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return (N, 3) semi-axes, first along directors, and (N, 4) quaternions of ellipses and spheroids; else None."""
    shapes = packing.shapes
    if not isinstance(shapes, Spheroids):
        return None
    along, across = shapes.semi_axes(packing.radius_n)
    return np.column_stack([along, across, across]), quaternions_to(shapes.director_nd)


def rotations_of(quaternion_nq: Any) -> NDArray[np.float64]:
    """Return the (N, 3, 3) rotations of unit quaternions, real part first, whose columns are the turned axes."""
    turn = np.asarray(quaternion_nq, dtype=np.float64)
    size = np.sqrt((turn**2).sum(axis=1))
    if not (np.abs(size - 1.0) < 1e-3).all():
        n = int(np.abs(size - 1.0).argmax())
        raise ValueError(f"its orientations must be unit quaternions, got {turn[n].tolist()} for particle {n}")
    w, x, y, z = (turn / size[:, None]).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def spheroids_of(
    axes: NDArray[np.float64], turn: NDArray[np.float64], dimension: int, names: Sequence[str] | None = None
) -> tuple[NDArray[np.float64], Spheroids]:
    """Return radii and shapes of ellipsoids, whose equal axes may be any two; in the plane, of their sections there.

    Parameters
    ----------
    axes
        (N, 3) semi-axes along the axes of the particles [length].
    turn
        (N, 3, 3) rotations, whose columns are these axes.
    dimension
        2 or 3.
    names
        (N,) types, for messages.

    """
    many = np.arange(len(axes))
    if dimension == 2:
        # in the plane are the two axes that are not along z
        upright = np.abs(turn[:, 2]).argmax(axis=1)
        tilted = (np.abs(turn[many, 2, upright]) < 1.0 - 1e-5) & (np.ptp(axes, axis=1) > 0.0)
        if tilted.any():
            n = int(tilted.argmax())
            raise ValueError(
                f"its ellipsoids must have an axis along z in two dimensions, got another for particle {n}"
            )
        first, other = np.array([[1, 2], [0, 2], [0, 1]])[upright].T
    else:
        # the axis that differs from the others, which are equal; the first where all are
        pair = np.array([[1, 2], [0, 2], [0, 1]])
        apart = np.abs(axes[:, pair[:, 0]] - axes[:, pair[:, 1]]) / axes.max(axis=1, keepdims=True)
        equal = apart <= ROUNDING
        if not equal.any(axis=1).all():
            n = int((~equal.any(axis=1)).argmax())
            of_type = "" if names is None else f" of type {names[n]!r}"
            raise ValueError(
                f"its ellipsoids must have two equal axes, got {axes[n].tolist()} for particle {n}{of_type}"
            )
        first = equal.argmax(axis=1)
        other = pair[first, 0]
    along, across = axes[many, first], axes[many, other]
    director = turn[many, :dimension, first]
    radius = np.sqrt(along * across) if dimension == 2 else np.cbrt(along * across * axes[many, pair[first, 1]])
    return radius, Spheroids(along / across, director)
