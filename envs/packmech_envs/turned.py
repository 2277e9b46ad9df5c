"""How particles with shapes are turned, as numbers of an observation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm

# independent components of the order tensor, which has no trace
_COMPONENTS = {2: ((0, 0), (0, 1)), 3: ((0, 0), (1, 1), (1, 2), (0, 2), (0, 1))}


def order_tensor(shapes: Any) -> NDArray[np.float64]:
    """Return the (d, d) order tensor (d <a a> - 1) / (d - 1) of the particles' axes a [1].

    The axis of an ellipse or spheroid is its director, that of a rigid body its longest principal axis. Without a
    trace; its largest eigenvalue is 1 where all axes are parallel, and all are near 0 where they point anywhere.

    Parameters
    ----------
    shapes
        pm.Spheroids or pm.Beads.

    Examples
    --------
    >>> order_tensor(pm.Spheroids([2.0, 2.0], [[1.0, 0.0], [-1.0, 0.0]])).tolist()
    [[1.0, 0.0], [0.0, -1.0]]

    """
    axis_nd = shapes.director_nd if isinstance(shapes, pm.Spheroids) else shapes.frames()[:, :, 0]
    d = axis_nd.shape[1]
    # not BLAS: the same bits for any number of threads
    mean = (axis_nd[:, :, None] * axis_nd[:, None, :]).mean(axis=0)
    return np.asarray((d * mean - np.eye(d)) / (d - 1))


class Turned:
    """What an observation says of how particles are turned; nothing of discs and spheres.

    Parameters
    ----------
    shapes
        The shapes at the start; None for discs and spheres.
    each
        Whether each particle's direction is observed, beside the order tensor.

    Attributes
    ----------
    names
        "order_xx", "order_xy" in a plane, "order_xx", "_yy", "_yz", "_xz", "_xy" in space: see `order_tensor`. With
        `each` then, particle by particle: "director_0_x", ... of ellipses and spheroids (opposite ones are the same
        shape), "axis_0_x", "axis_0_y" of rigid bodies in a plane, "quaternion_0_w", "_x", "_y", "_z" in space, with a
        real part of at least 0.
    bounds
        Lower and upper bounds of these numbers.

    """

    def __init__(self, shapes: Any, each: bool) -> None:
        self.each = each
        self.names: tuple[str, ...] = ()
        if shapes is None:
            if each:
                raise ValueError("orientations must be left out for a scene of discs or spheres, got True")
            return
        self._where = _COMPONENTS[shapes.dimension]
        self.names = tuple("order_" + "xyz"[a] + "xyz"[b] for a, b in self._where)
        if each:
            letters = "xyz" if isinstance(shapes, pm.Spheroids) or shapes.dimension == 2 else "wxyz"
            word = "director" if isinstance(shapes, pm.Spheroids) else "axis" if shapes.dimension == 2 else "quaternion"
            width = shapes.orientation_nq.shape[1]
            self.names += tuple(f"{word}_{n}_{letters[k]}" for n in range(len(shapes)) for k in range(width))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Lower and upper bounds: all of these numbers are between -1 and 1, up to rounding."""
        return [(-1.0, 1.0)] * len(self.names)

    def row(self, shapes: Any) -> NDArray[np.float64]:
        """Return the numbers of shapes as they are turned now."""
        order = order_tensor(shapes)
        numbers = np.array([order[a, b] for a, b in self._where])
        if self.each:
            orientation = shapes.orientation_nq
            if orientation.shape[1] == 4:
                orientation = orientation * np.where(orientation[:, :1] < 0.0, -1.0, 1.0)
            numbers = np.concatenate([numbers, orientation.ravel()])
        return np.asarray(np.clip(numbers, -1.0, 1.0))
