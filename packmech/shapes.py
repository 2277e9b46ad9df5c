"""Shapes of particles other than discs and spheres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import finite_array, positive_array

# a director this near to unit length is one already, so that those of a file stay as they are
_UNIT = 4.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Spheroids:
    """Ellipses (d = 2) or spheroids (d = 3): one axis along a director, the others equal to each other.

    A particle's radius is that of the disc or sphere of equal area or volume, so that packing fractions and masses do
    not depend on its aspect.

    Parameters
    ----------
    aspect_n
        (N,) axis along the director over that across it: above 1 prolate, below 1 oblate, 1 a disc or sphere [1].
    director_nd
        (N, d) directions of the axes, kept with unit length; opposite ones are the same shape.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, naming the particle.

    Examples
    --------
    >>> import packmech as pm
    >>> ellipses = pm.Spheroids([4.0, 1.0], [[1.0, 0.0], [0.0, 2.0]])
    >>> pm.Packing([[0.0, 0.0], [2.0, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2), shapes=ellipses).shapes.semi_axes(0.5)
    (array([1. , 0.5]), array([0.25, 0.5 ]))

    """

    aspect_n: NDArray[np.float64]
    director_nd: NDArray[np.float64]

    def __post_init__(self) -> None:
        aspect = positive_array("aspect_n", self.aspect_n, shape=(None,))
        director = finite_array("director_nd", self.director_nd, shape=(len(aspect), None))
        if director.shape[1] not in (2, 3):
            raise ValueError(f"director_nd must have two or three components, got {director.shape[1]}")
        largest = np.abs(director).max(axis=1)
        if (largest == 0.0).any():
            raise ValueError(f"director_nd must have a direction, got zeros for particle {int(np.argmin(largest))}")
        off = np.abs((director**2).sum(axis=1) - 1.0) > _UNIT
        scaled = director[off] / largest[off, None]
        director = director.copy()
        director[off] = scaled / np.sqrt((scaled**2).sum(axis=1, keepdims=True))
        for name, array in (("aspect_n", aspect), ("director_nd", director)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.aspect_n)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Spheroids)
            and np.array_equal(self.aspect_n, other.aspect_n)
            and np.array_equal(self.director_nd, other.director_nd)
        )

    def __hash__(self) -> int:
        return hash((self.aspect_n.tobytes(), self.director_nd.tobytes()))

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.director_nd.shape[1])

    def semi_axes(self, radius_n: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (N,) semi-axes along the directors and across them, for particles of these radii [length]."""
        across = np.asarray(radius_n) / self.aspect_n ** (1.0 / self.dimension)
        return self.aspect_n * across, across

    def select(self, kept_n: NDArray[Any]) -> Spheroids:
        """Return the shapes of some of the particles."""
        return Spheroids(self.aspect_n[kept_n], self.director_nd[kept_n])
