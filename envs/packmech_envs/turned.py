"""How particles with shapes are turned, as numbers of an observation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import packmech as pm

# independent components of the order tensor, which has no trace
_COMPONENTS = {2: ((0, 0), (0, 1)), 3: ((0, 0), (1, 1), (1, 2), (0, 2), (0, 1))}


def _have_directors(packing: pm.Packing) -> bool:
    """Whether particles have a nematic order: not those that are round, nor bodies without one longest axis."""
    try:
        pm.nematic_order(packing)
    except ValueError:
        return False
    return True


class ObservedOrientations:
    """What an observation says of how particles are turned; nothing of discs and spheres.

    Parameters
    ----------
    packing
        The packing at the start.
    each
        Whether each particle's direction is observed, beside the order tensor.

    Attributes
    ----------
    names
        "order_xx", "order_xy" in a plane, "order_xx", "_yy", "_yz", "_xz", "_xy" in space: the tensor of
        `pm.nematic_order`, left out where no particle has a director or a rigid body has no one longest axis. With
        `each` then, particle by particle: "director_0_x", ... of ellipses and spheroids (opposite ones are the same
        shape), "axis_0_x", "axis_0_y" of rigid bodies in a plane, "quaternion_0_w", "_x", "_y", "_z" in space, with a
        real part of at least 0.
    bounds
        Lower and upper bounds of these numbers.

    """

    def __init__(self, packing: pm.Packing, each: bool) -> None:
        width = packing.shapes.orientation_nq.shape[1]
        self.each = each
        self.names: tuple[str, ...] = ()
        self._where: tuple[tuple[int, int], ...] = ()
        if not width:
            if each:
                raise ValueError("orientations must be left out for a scene of discs or spheres, got True")
            return
        if _have_directors(packing):
            self._where = _COMPONENTS[packing.dimension]
        self.names = tuple("order_" + "xyz"[a] + "xyz"[b] for a, b in self._where)
        if each:
            letters = "wxyz" if width == 4 else "xyz"
            word = "director" if isinstance(packing.shapes, pm.Spheroids) else "quaternion" if width == 4 else "axis"
            self.names += tuple(f"{word}_{n}_{letters[k]}" for n in range(packing.particles) for k in range(width))

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Lower and upper bounds: all of these numbers are between -1 and 1, up to rounding."""
        return [(-1.0, 1.0)] * len(self.names)

    def row(self, packing: pm.Packing) -> NDArray[np.float64]:
        """Return the numbers of a packing with shapes as they are turned now."""
        numbers = np.zeros(0)
        if self._where:
            order = pm.nematic_order(packing).tensor_dd
            numbers = np.array([order[a, b] for a, b in self._where])
        if self.each:
            orientation = packing.shapes.orientation_nq
            if orientation.shape[1] == 4:
                orientation = orientation * np.where(orientation[:, :1] < 0.0, -1.0, 1.0)
            numbers = np.concatenate([numbers, orientation.ravel()])
        return np.asarray(np.clip(numbers, -1.0, 1.0))
