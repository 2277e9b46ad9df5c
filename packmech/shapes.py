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

    def reach(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N,) radii of the discs or spheres about the centers that just hold the particles [length]."""
        return np.maximum(*self.semi_axes(radius_n))

    def gyration(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N,) radii of gyration, the square root of inertia over mass about a center across the axis [length].

        Turns are measured in them: an angle times this is a length.
        """
        along, across = self.semi_axes(radius_n)
        return np.asarray(np.sqrt((along**2 + across**2) / (4.0 if self.dimension == 2 else 5.0)))

    def turn_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, K, t) rotations that one length of each coordinate of turns makes, K = 1 in a plane, else 2.

        Rotations are angles in a plane (t = 1) and rotation vectors in space (t = 3), there about two directions across
        the axis. Zeros for discs and spheres (aspect exactly 1), which have no such coordinates.
        """
        turns = self.aspect_n != 1.0
        rate = np.where(turns, 1.0 / self.gyration(radius_n), 0.0)
        if self.dimension == 2:
            return rate[:, None, None]
        # the axis of the smallest component is farthest from the director
        aside = np.zeros_like(self.director_nd)
        aside[np.arange(len(self)), np.abs(self.director_nd).argmin(axis=1)] = 1.0
        first = np.cross(self.director_nd, aside)
        first /= np.sqrt((first**2).sum(axis=1, keepdims=True))
        return np.asarray(np.stack([first, np.cross(self.director_nd, first)], axis=1) * rate[:, None, None])

    def turned(self, rotation_nt: NDArray[np.float64]) -> Spheroids:
        """Return the shapes turned by (N, 1) angles in a plane, or (N, 3) rotation vectors in space."""
        director = self.director_nd
        if self.dimension == 2:
            cosine, sine = np.cos(rotation_nt), np.sin(rotation_nt)
            across = np.stack([-director[:, 1], director[:, 0]], axis=1)
            return Spheroids(self.aspect_n, cosine * director + sine * across)
        angle = np.sqrt((rotation_nt**2).sum(axis=1, keepdims=True))
        along = (rotation_nt * director).sum(axis=1, keepdims=True)
        # Rodrigues' formula; sinc and its square are those of the small angles, too
        half = np.sinc(angle / (2.0 * np.pi))
        turned = np.cos(angle) * director + np.sinc(angle / np.pi) * np.cross(rotation_nt, director)
        return Spheroids(self.aspect_n, turned + 0.5 * half**2 * along * rotation_nt)

    def rotation_since(self, start: Spheroids) -> NDArray[np.float64]:
        """Return the (N, 1) angles, or (N, 3) rotation vectors, by which the directors have turned on the short way."""
        one, other = start.director_nd, self.director_nd
        if self.dimension == 2:
            sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
            return np.asarray(np.arctan2(sine, (one * other).sum(axis=1))[:, None])
        axis = np.cross(one, other)
        sine = np.sqrt((axis**2).sum(axis=1))
        angle = np.arctan2(sine, (one * other).sum(axis=1))
        return np.asarray(axis * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)[:, None])

    def select(self, kept_n: NDArray[Any]) -> Spheroids:
        """Return the shapes of some of the particles."""
        return Spheroids(self.aspect_n[kept_n], self.director_nd[kept_n])
