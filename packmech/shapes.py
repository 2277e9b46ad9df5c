"""Shapes of particles: discs and spheres, ellipses and spheroids, superellipsoids, rigid bodies of beads."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import brief, finite_array, integer_array, positive_array

# a director this near to unit length is one already, so that those of a file stay as they are
_UNIT = 4.0 * float(np.finfo(float).eps)
# beads nearer to an axis than this, relative to the particle's radius, lie on it
_ON_AXIS = 1e-9
# exponents above this leave edges sharper than contacts are computed for
SHARPEST = 50.0
# radius of curvature of a face where it is flat, over its size
_FLATTEST = 1e13
# moments of the beads about two axes nearer than this, relative to the larger, leave the long axis open
_ROUND = 1e-9


def _unit(name: str, given_nk: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Return the rows with unit length, those that have it as they are."""
    largest = np.abs(given_nk).max(axis=1, initial=0.0)
    if (largest == 0.0).any():
        raise ValueError(f"{name} must have a {kind}, got zeros for particle {int(np.argmin(largest))}")
    off = np.abs((given_nk**2).sum(axis=1) - 1.0) > _UNIT
    scaled = given_nk[off] / largest[off, None]
    unit = given_nk.copy()
    unit[off] = scaled / np.sqrt((scaled**2).sum(axis=1, keepdims=True))
    return unit


class _Turned:
    """Shapes with orientations, equal where all their arrays are."""

    has_orientations: ClassVar[bool] = True
    has_beads: ClassVar[bool] = False
    # whether sites have one axis that may differ from the others: `axis_bd` and `semi_axes` say what they are then
    has_spheroid_sites: ClassVar[bool] = True
    # whether they turn by quaternions in space
    has_frames: ClassVar[bool] = False

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and all(
            np.array_equal(one, other.arrays()[name]) for name, one in self.arrays().items()
        )

    def __hash__(self) -> int:
        return hash(tuple(one.tobytes() for one in self.arrays().values()))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the shapes are made of, by name."""
        return {one.name: getattr(self, one.name) for one in fields(self)}  # type: ignore[arg-type]

    def turned_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the array that says how the particles are turned, by the name that files give it."""
        return {"orientation_nq": self.orientation_nq}  # type: ignore[attr-defined]

    def _keep(self, **arrays: NDArray[Any]) -> None:
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)


class _SingleSites:
    """Shapes of one site each, at the center: discs, spheres, spheroids and superellipsoids."""

    if TYPE_CHECKING:

        def __len__(self) -> int: ...
        def reach(self, radius_n: Any) -> NDArray[np.float64]: ...

        @property
        def dimension(self) -> int: ...

    @property
    def start_n(self) -> NDArray[np.int64]:
        """The (N + 1,) numbers of the first site of each particle: one site each."""
        return np.arange(len(self) + 1)

    @property
    def particle_b(self) -> NDArray[np.int64]:
        """The (B,) particles that the sites belong to."""
        return np.arange(len(self))

    def arms(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (B, d) vectors from the particles' centers to the sites: zeros [length]."""
        return np.zeros((len(self), self.dimension))

    def site_radius(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the radii: sites are the particles [length]."""
        return np.asarray(radius_n)

    def site_reach(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (B,) reaches: sites are the particles [length]."""
        return self.reach(radius_n)

    def sweep(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N,) zeros: particles turn within the discs or spheres that hold them [length]."""
        return np.zeros(len(self))


@dataclass(frozen=True)
class Discs(_SingleSites):
    """Discs (d = 2) or spheres (d = 3), which have no orientations: the shapes of a packing that is given none.

    They answer what other shapes do: no coordinates of turns (K = 0), one site each. The sites are what particles are
    made of: beads, or the particles themselves.

    Parameters
    ----------
    count
        Number of particles N.
    dimension
        Number of Cartesian axes, 2 or 3.

    """

    count: int
    dimension: int

    # whether particles turn without friction, and whether each is a body of beads
    has_orientations: ClassVar[bool] = False
    has_beads: ClassVar[bool] = False
    has_spheroid_sites: ClassVar[bool] = True
    has_frames: ClassVar[bool] = False

    def __len__(self) -> int:
        return self.count

    @property
    def names(self) -> tuple[str, str]:
        """What one of the particles is called, and several."""
        return ("disc", "discs") if self.dimension == 2 else ("sphere", "spheres")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the shapes are made of: none."""
        return {}

    turned_arrays = arrays

    @property
    def orientation_nq(self) -> NDArray[np.float64]:
        """An (N, 0) array: nothing changes as particles turn."""
        return np.zeros((self.count, 0))

    def oriented(self, orientation_nq: NDArray[np.float64]) -> Discs:
        """Return these shapes."""
        return self

    @property
    def turns_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that turn: none does."""
        return np.zeros(self.count, dtype=bool)

    @property
    def axis_bd(self) -> NDArray[np.float64]:
        """Some (B, d) directions, since no axis differs from the others."""
        return _any_axis(self.count, self.dimension)

    axis_nd = axis_bd

    def semi_axes(self, radius_n: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the radii twice, for the (B,) semi-axes along some direction and across it [length]."""
        return np.asarray(radius_n), np.asarray(radius_n)

    def reach(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N,) radii [length]."""
        return np.asarray(radius_n)

    def gyration(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N,) radii of gyration, the square root of inertia over mass about an axis [length]."""
        return np.asarray(np.sqrt(0.5 if self.dimension == 2 else 0.4) * np.asarray(radius_n))

    def stiffening(self, radius_n: Any) -> tuple[float, float]:
        """Return 1, and by how much the stiffness over mass of tangential springs exceeds that of contacts."""
        return 1.0, 3.0 if self.dimension == 2 else 3.5

    def spin_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, k, k) rotations that one length of each coordinate makes where friction turns them; k = 1 or 3."""
        k, share = (1, 0.5) if self.dimension == 2 else (3, 0.4)
        return np.asarray(np.eye(k) / (np.sqrt(share) * np.asarray(radius_n))[:, None, None])

    def turn_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return an array (N, 0, 0): no coordinates of turns, and no rotations along which slopes are taken."""
        return np.zeros((self.count, 0, 0))

    def turned(self, rotation_nt: NDArray[np.float64]) -> Discs:
        """Return these shapes, which no rotation changes."""
        return self

    def rotation_since(self, start: Any) -> NDArray[np.float64]:
        """Return zeros, (N, 1) angles or (N, 3) rotation vectors."""
        return np.zeros((self.count, 1 if self.dimension == 2 else 3))

    def coordinates(self, now: Any, radius_n: Any) -> NDArray[np.float64]:
        """Return a (0, d) array: no lengths say how the shapes are turned."""
        return np.zeros((0, self.dimension))

    def at_coordinates(self, coordinate_nd: NDArray[np.float64], radius_n: Any) -> Discs:
        """Return these shapes."""
        return self

    def long_axes(self) -> NDArray[np.float64]:
        """Return a (0, d) array: no particle has a long axis."""
        return np.zeros((0, self.dimension))

    def select(self, kept_n: NDArray[Any]) -> Discs:
        """Return the shapes of some of the particles."""
        return Discs(len(np.arange(self.count)[kept_n]), self.dimension)


@shown()
@dataclass(frozen=True, eq=False)
class Spheroids(_SingleSites, _Turned):
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
        self._keep(aspect_n=aspect, director_nd=_unit("director_nd", director, "direction"))

    def __len__(self) -> int:
        return len(self.aspect_n)

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.director_nd.shape[1])

    @property
    def names(self) -> tuple[str, str]:
        """What one of the particles is called, and several."""
        return ("ellipse", "ellipses") if self.dimension == 2 else ("spheroid", "spheroids")

    @property
    def orientation_nq(self) -> NDArray[np.float64]:
        """The (N, d) directors: what changes as particles turn."""
        return self.director_nd

    @property
    def axis_nd(self) -> NDArray[np.float64]:
        """The (N, d) directions by which pairs are aligned: the directors."""
        return self.director_nd

    def oriented(self, orientation_nq: NDArray[np.float64]) -> Spheroids:
        """Return the shapes with other directors."""
        return Spheroids(self.aspect_n, orientation_nq)

    @property
    def turns_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that turn: those that are no discs or spheres."""
        return np.asarray(self.aspect_n != 1.0)

    @property
    def axis_bd(self) -> NDArray[np.float64]:
        """The (B, d) directions of the axes that may differ from the others: the directors."""
        return self.director_nd

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

    def stiffening(self, radius_n: Any) -> tuple[float, float]:
        """Return by how much the stiffness over mass of contacts, and of tangential springs, may exceed that of discs.

        A contact's distance goes up to r / b as fast as the particles move, b the smaller semi-axis; its normal passes
        the center at a distance of up to the difference of the semi-axes, and a tangential force has arms of up to the
        larger one. The second figure is 3 for discs, 3.5 for spheres.
        """
        along, across = self.semi_axes(radius_n)
        square = self.gyration(radius_n) ** 2
        steep = (np.asarray(radius_n) / np.minimum(along, across)) ** 2
        normal = steep * (1.0 + (along - across) ** 2 / square)
        return float(normal.max()), float((1.0 + self.reach(radius_n) ** 2 / square).max())

    def turn_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, K, t) rotations that one length of each coordinate of turns makes, K = 1 in a plane, else 2.

        Rotations are angles in a plane (t = 1) and rotation vectors in space (t = 3), there about two directions across
        the axis. Zeros for discs and spheres (aspect exactly 1), which have no such coordinates.
        """
        rate = np.where(self.turns_n, 1.0 / self.gyration(radius_n), 0.0)
        if self.dimension == 2:
            return rate[:, None, None]
        # the axis of the smallest component is farthest from the director
        aside = np.zeros_like(self.director_nd)
        aside[np.arange(len(self)), np.abs(self.director_nd).argmin(axis=1)] = 1.0
        first = np.cross(self.director_nd, aside)
        first /= np.sqrt((first**2).sum(axis=1, keepdims=True))
        return np.asarray(np.stack([first, np.cross(self.director_nd, first)], axis=1) * rate[:, None, None])

    def spin_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, k, k) rotations as `turn_basis` does, where friction turns discs and about the axes, too."""
        rate = 1.0 / self.gyration(radius_n)[:, None, None]
        if self.dimension == 2:
            return np.asarray(rate)
        across = Spheroids(np.full(len(self), 2.0), self.director_nd).turn_basis(np.ones(len(self)))
        across /= np.sqrt((across**2).sum(axis=2, keepdims=True))
        about = self.director_nd / (np.sqrt(0.4) * self.semi_axes(radius_n)[1])[:, None]
        return np.concatenate([across * rate, about[:, None]], axis=1)

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

    def rotation_since(self, start: Any) -> NDArray[np.float64]:
        """Return the (N, 1) angles, or (N, 3) rotation vectors, by which the directors have turned on the short way."""
        one, other = start.director_nd, self.director_nd
        if self.dimension == 2:
            sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
            return np.asarray(np.arctan2(sine, (one * other).sum(axis=1))[:, None])
        axis = np.cross(one, other)
        sine = np.sqrt((axis**2).sum(axis=1))
        angle = np.arctan2(sine, (one * other).sum(axis=1))
        return np.asarray(axis * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)[:, None])

    def coordinates(self, now: Any, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N, d) lengths that say how shapes like these are turned: directors times radii of gyration."""
        return np.asarray(now.director_nd * self.gyration(radius_n)[:, None])

    def at_coordinates(self, coordinate_nd: NDArray[np.float64], radius_n: Any) -> Spheroids:
        """Return the shapes turned as such lengths say."""
        return Spheroids(self.aspect_n, coordinate_nd)

    def long_axes(self) -> NDArray[np.float64]:
        """Return the (N', d) directors of the particles that have one."""
        return self.director_nd[self.turns_n]

    def select(self, kept_n: NDArray[Any]) -> Spheroids:
        """Return the shapes of some of the particles."""
        return Spheroids(self.aspect_n[kept_n], self.director_nd[kept_n])


class _Framed(_Turned):
    """Bodies with a frame of axes, turned by angles in a plane and by quaternions in space.

    Of a class are its radii of gyration about the axes over the radii (`gyration_nk`), and about which axes a turn
    changes a body (`_turns_nk`).
    """

    has_frames: ClassVar[bool] = True

    if TYPE_CHECKING:

        def __len__(self) -> int: ...
        def oriented(self, orientation_nq: NDArray[np.float64]) -> Self: ...

        @property
        def orientation_nq(self) -> NDArray[np.float64]: ...
        @property
        def gyration_nk(self) -> NDArray[np.float64]: ...
        @property
        def dimension(self) -> int: ...
        @property
        def _turns_nk(self) -> NDArray[np.bool_]: ...

    @property
    def axis_nd(self) -> NDArray[np.float64]:
        """The (N, d) directions by which pairs are aligned: the first axes of the bodies."""
        return np.asarray(self.frames()[:, :, 0])

    @property
    def turns_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that turn: those that a turn changes."""
        return np.asarray(self._turns_nk.any(axis=1))

    def gyration(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N,) radii of gyration, the mean square of those about the axes in space [length]."""
        return np.asarray(np.sqrt((self.gyration_nk**2).mean(axis=1)) * radius_n)

    def frames(self) -> NDArray[np.float64]:
        """Return (N, d, d) axes of the bodies in columns."""
        if self.dimension == 2:
            x, y = self.orientation_nq.T
            return np.stack([np.stack([x, -y], axis=1), np.stack([y, x], axis=1)], axis=1)
        w, x, y, z = self.orientation_nq.T
        rows = [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
        return np.array(rows).transpose(2, 0, 1)

    def turn_rates(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, k) angles about the axes that make one length of a coordinate of turns; 0 where nothing turns."""
        return np.where(self._turns_nk, 1.0 / (self.gyration_nk * np.asarray(radius_n)[:, None]), 0.0)

    def turn_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, K, t) rotations that one length of each coordinate of turns makes, K = 1 in a plane, else 3.

        As of `Spheroids.turn_basis`, about the axes of the bodies. Zeros where a turn changes nothing: of
        discs and spheres, and about the axis of a row of beads.
        """
        return self._about_axes(self.turn_rates(radius_n))

    def spin_basis(self, radius_n: Any) -> NDArray[np.float64]:
        """Return (N, k, k) rotations as `turn_basis` does, where friction turns what is round, too."""
        return self._about_axes(1.0 / (self.gyration_nk * np.asarray(radius_n)[:, None]))

    def _about_axes(self, rate_nk: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.dimension == 2:
            return rate_nk[:, :, None]
        return np.asarray(self.frames().transpose(0, 2, 1) * rate_nk[:, :, None])

    def turned(self, rotation_nt: NDArray[np.float64]) -> Self:
        """Return the shapes turned by (N, 1) angles in a plane, or (N, 3) rotation vectors in space."""
        if self.dimension == 2:
            (x, y), angle = self.orientation_nq.T, rotation_nt[:, 0]
            c, s = np.cos(angle), np.sin(angle)
            return self.oriented(np.stack([c * x - s * y, s * x + c * y], axis=1))
        angle = np.sqrt((rotation_nt**2).sum(axis=1, keepdims=True))
        vector = 0.5 * np.sinc(angle / (2.0 * np.pi)) * rotation_nt
        return self.oriented(_quaternion_product(np.hstack([np.cos(0.5 * angle), vector]), self.orientation_nq))

    def rotation_since(self, start: Any) -> NDArray[np.float64]:
        """Return the (N, 1) angles, or (N, 3) rotation vectors, by which the bodies have turned on the short way."""
        one, other = start.orientation_nq, self.orientation_nq
        if self.dimension == 2:
            sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
            return np.asarray(np.arctan2(sine, (one * other).sum(axis=1))[:, None])
        turn = _quaternion_product(other, one * np.array([1.0, -1.0, -1.0, -1.0]))
        turn *= np.where(turn[:, :1] < 0.0, -1.0, 1.0)
        sine = np.sqrt((turn[:, 1:] ** 2).sum(axis=1))
        angle = 2.0 * np.arctan2(sine, turn[:, 0])
        return np.asarray(turn[:, 1:] * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)[:, None])

    def coordinates(self, now: Any, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N, d) lengths that say how bodies like these are turned: rotations times radii of gyration.

        In a plane the first component is that length and the other one nothing.
        """
        found = np.zeros((len(self), self.dimension))
        rotation = now.rotation_since(self)
        found[:, : rotation.shape[1]] = rotation * self.gyration(radius_n)[:, None]
        return found

    def at_coordinates(self, coordinate_nd: NDArray[np.float64], radius_n: Any) -> Self:
        """Return the bodies turned as such lengths say."""
        rotations = 1 if self.dimension == 2 else 3
        return self.turned(coordinate_nd[:, :rotations] / self.gyration(radius_n)[:, None])


@shown()
@dataclass(frozen=True, eq=False)
class Superellipsoids(_SingleSites, _Framed):
    """Superellipses |x/a|^p + |y/b|^p = 1 or superellipsoids |x/a|^p + |y/b|^p + |z/c|^p = 1, each with an exponent.

    The exponent 2 makes ellipses, and ellipsoids of three axes; large ones come near to rectangles and boxes. A
    particle's radius is that of the disc or sphere of equal area or volume, so that packing fractions and masses do not
    depend on its shape: area and volume are (2 Gamma(1 + 1/p))^d / Gamma(1 + d/p) times the product of the semi-axes.

    Parameters
    ----------
    exponent_n
        (N,) exponents p, from 2 to 50 [1].
    ratio_nd
        (N, d) semi-axes over each other, in any unit; the radius sets their lengths [1].
    orientation_nq
        (N, 2) directions of the first axis in a plane; (N, 4) unit quaternions in space, real part first, that turn the
        axes of the packing into those of the body. Kept with unit length.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, naming the particle.

    Examples
    --------
    >>> import packmech as pm
    >>> squares = pm.Superellipsoids([4.0], [[1.0, 1.0]], [[1.0, 0.0]])
    >>> area = np.prod(2.0 * squares.axes([0.5])) * 0.9270373386
    >>> round(float(area / (np.pi * 0.25)), 9)
    1.0

    """

    has_spheroid_sites: ClassVar[bool] = False

    exponent_n: NDArray[np.float64]
    ratio_nd: NDArray[np.float64]
    orientation_nq: NDArray[np.float64]

    def __post_init__(self) -> None:
        exponent = positive_array("exponent_n", self.exponent_n, shape=(None,))
        n = len(exponent)
        off = (exponent < 2.0) | (exponent > SHARPEST)
        if off.any():
            k = int(off.argmax())
            raise ValueError(f"exponent_n must be from 2 to {SHARPEST:g}, got {exponent[k]:g} for particle {k}")
        ratio = positive_array("ratio_nd", self.ratio_nd, shape=(n, None))
        d = ratio.shape[1]
        if d not in (2, 3):
            raise ValueError(f"ratio_nd must have two or three components, got {d}")
        orientation = finite_array("orientation_nq", self.orientation_nq, shape=(n, 2 if d == 2 else 4))
        orientation = _unit("orientation_nq", orientation, "direction")
        self._keep(exponent_n=exponent, ratio_nd=ratio, orientation_nq=orientation)

    def __len__(self) -> int:
        return len(self.exponent_n)

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.ratio_nd.shape[1])

    @property
    def names(self) -> tuple[str, str]:
        """What one of the particles is called, and several."""
        return ("superellipse", "superellipses") if self.dimension == 2 else ("superellipsoid", "superellipsoids")

    def oriented(self, orientation_nq: NDArray[np.float64]) -> Superellipsoids:
        """Return the shapes with other orientations."""
        return Superellipsoids(self.exponent_n, self.ratio_nd, orientation_nq)

    @property
    def _semi_nd(self) -> NDArray[np.float64]:
        """The (N, d) semi-axes over the radii."""
        mean = np.exp(np.log(self.ratio_nd).mean(axis=1))
        return np.asarray(self.ratio_nd * (self._measures_n2[:, 0] / mean)[:, None])

    @property
    def _measures_n2(self) -> NDArray[np.float64]:
        """The (N, 2) mean semi-axes over radii, and mean squares of distances along an axis over its semi-axis."""
        d, log_gamma = self.dimension, math.lgamma
        value, place = np.unique(self.exponent_n, return_inverse=True)
        table = np.empty((len(value), 2))
        ball = math.log(math.pi if d == 2 else 4.0 * math.pi / 3.0)
        for k, one in enumerate(1.0 / value):
            own = d * (math.log(2.0) + log_gamma(1.0 + one)) - log_gamma(1.0 + d * one)
            share = log_gamma(3.0 * one) - log_gamma(one) + log_gamma(1.0 + d * one) - log_gamma(1.0 + (d + 2) * one)
            table[k] = math.exp((ball - own) / d), math.exp(share)
        return table[place.reshape(-1)]

    def axes(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N, d) semi-axes of particles of these radii [length]."""
        return np.asarray(self._semi_nd * np.asarray(radius_n)[..., None])

    @property
    def axis_bd(self) -> NDArray[np.float64]:
        """The (B, d) directions of the first axes."""
        return self.axis_nd

    def semi_axes(self, radius_n: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Refuse what asks for semi-axes along one axis and across it: these have others (`axes`).

        Raises
        ------
        ValueError
            Always.

        """
        raise ValueError(
            f"shapes must be discs, spheres, ellipses, spheroids or rigid bodies here, got {type(self).__name__}"
        )

    @property
    def spread_nd(self) -> NDArray[np.float64]:
        """The (N, d) mean squares of the distances along the axes from the center, over those of the radii [1]."""
        return np.asarray(self._measures_n2[:, 1:] * self._semi_nd**2)

    @property
    def gyration_nk(self) -> NDArray[np.float64]:
        """The (N, k) radii of gyration about the center in a plane, about the axes in space, over the radii [1]."""
        spread = self.spread_nd
        whole = spread.sum(axis=1, keepdims=True)
        return np.asarray(np.sqrt(whole if self.dimension == 2 else whole - spread))

    @property
    def _turns_nk(self) -> NDArray[np.bool_]:
        """Return (N, k) about which axes a turn changes a shape: of ellipsoids where the other two axes differ."""
        sharp, ratio = (self.exponent_n > 2.0)[:, None], self.ratio_nd
        if self.dimension == 2:
            return np.asarray(sharp | (ratio[:, :1] != ratio[:, 1:]))
        return np.asarray(sharp | (ratio[:, [1, 2, 0]] != ratio[:, [2, 0, 1]]))

    def reach(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N,) radii of the discs or spheres about the centers that just hold the particles [length].

        By Hoelder's inequality the norm of the semi-axes with the exponent 2 p / (p - 2).
        """
        axes = self.axes(radius_n)
        largest = axes.max(axis=1)
        # 1 / (2 p / (p - 2)), zero of ellipsoids, whose norm is the largest semi-axis
        inverse = 0.5 - 1.0 / self.exponent_n
        power = 1.0 / np.where(inverse > 0.0, inverse, 1.0)
        norm = ((axes / largest[:, None]) ** power[:, None]).sum(axis=1) ** inverse
        return np.asarray(largest * np.where(inverse > 0.0, norm, 1.0))

    def stiffening(self, radius_n: Any) -> tuple[float, float]:
        """Return by how much the stiffness over mass of contacts, and of tangential springs, may exceed that of discs.

        As of `Spheroids.stiffening`: a normal passes the center at a distance whose square is below that of the reach
        less that of the smallest semi-axis, which is as near as a tangent comes.
        """
        radius = np.asarray(radius_n)
        near, reach = self.axes(radius).min(axis=1), self.reach(radius)
        square = (self.gyration_nk.min(axis=1) * radius) ** 2
        normal = (radius / near) ** 2 * (1.0 + (reach**2 - near**2) / square)
        return float(normal.max()), float((1.0 + reach**2 / square).max())

    def surface_points(self, normal_md: NDArray[np.float64], radius_n: Any) -> NDArray[np.float64]:
        """Return the (..., N, d) points of the surfaces, from the centers, where normals are (..., N, d) [length].

        They are the slopes of the support h(n), which is the norm with the exponent p / (p - 1) of the components of n
        along the axes times the semi-axes.
        """
        frame, axes = self.frames(), self.axes(radius_n)
        along = (normal_md[..., :, None] * frame).sum(axis=-2) * axes
        power = (1.0 / (self.exponent_n - 1.0))[:, None]
        largest = np.abs(along).max(axis=-1, keepdims=True)
        share = np.abs(along / largest) ** power
        support = (share * np.abs(along / largest)).sum(axis=-1, keepdims=True) ** (1.0 / self.exponent_n)[:, None]
        point = np.sign(along) * axes * share / support
        return np.asarray((frame * point[..., None, :]).sum(axis=-1))

    def surface_bends(self, normal_nd: NDArray[np.float64], radius_n: Any) -> NDArray[np.float64]:
        """Return the (N, d, d) derivatives of `surface_points` by the (N, d) unit normals: radii of curvature [length].

        That of a face in its middle, where it is flat, is 1e13 of its size and not infinite.
        """
        frame, axes = self.frames(), self.axes(radius_n)
        power = (1.0 / (self.exponent_n - 1.0))[:, None]
        normal, point = (
            (one[:, :, None] * frame).sum(axis=1) for one in (normal_nd, self.surface_points(normal_nd, radius_n))
        )
        support = (normal * point).sum(axis=1, keepdims=True)
        share = np.maximum(np.abs(normal) * axes / support, np.finfo(float).tiny)
        bend = np.minimum(share ** (power - 1.0), _FLATTEST)[:, :, None] * np.eye(self.dimension) * axes[:, None] ** 2
        bend -= point[:, :, None] * point[:, None, :]
        return np.asarray(frame @ ((power / support)[:, :, None] * bend) @ frame.transpose(0, 2, 1))

    def long_axes(self) -> NDArray[np.float64]:
        """Return the (N', d) axes of greatest extent of the particles that turn.

        Raises
        ------
        ValueError
            Naming a particle that has no such axis.

        """
        ratio, which = self.ratio_nd[self.turns_n], np.flatnonzero(self.turns_n)
        ordered = np.sort(ratio, axis=1)
        if (ordered[:, -1] == ordered[:, -2]).any():
            n = int(which[(ordered[:, -1] == ordered[:, -2]).argmax()])
            raise ValueError(f"packing.shapes must have one long axis each, got none for particle {n}")
        return np.asarray(self.frames()[which, :, ratio.argmax(axis=1)])

    def select(self, kept_n: NDArray[Any]) -> Superellipsoids:
        """Return the shapes of some of the particles."""
        return Superellipsoids(self.exponent_n[kept_n], self.ratio_nd[kept_n], self.orientation_nq[kept_n])


@shown()
@dataclass(frozen=True, eq=False)
class Beads(_Framed):
    """Rigid bodies, each a union of discs or spheres that may overlap: dimers, n-mers, bent and asymmetric ones too.

    `rigid_packing` makes them, with what follows from their beads: the place of a particle is its center of mass (of
    the union, of even density), its radius that of the disc or sphere of equal area or volume. Lengths are relative to
    that radius, in the frame of the body.

    Parameters
    ----------
    start_n
        (N + 1,) number of the first bead of each particle, and of beads in all.
    offset_bd
        (B, d) places of the beads, from the center of mass [radius].
    size_b
        (B,) radii of the beads [radius].
    gyration_nk
        (N, 1) radii of gyration about the center of mass in a plane; (N, 3) about the axes of the body in space, which
        are its principal axes of inertia [radius].
    orientation_nq
        (N, 2) directions of the first axis of the body in a plane; (N, 4) unit quaternions in space, real part first,
        that turn the axes of the packing into those of the body.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, naming the particle or the bead.

    Examples
    --------
    >>> import packmech as pm
    >>> two = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    >>> dimer = pm.rigid_packing(two, [0, 0])
    >>> dimer.position_nd.tolist(), round(float(dimer.radius_n[0]) ** 2, 12), len(dimer.shapes.size_b)
    ([[0.5, 0.0]], 0.5, 2)

    """

    has_beads: ClassVar[bool] = True

    start_n: NDArray[np.int64]
    offset_bd: NDArray[np.float64]
    size_b: NDArray[np.float64]
    gyration_nk: NDArray[np.float64]
    orientation_nq: NDArray[np.float64]

    def __post_init__(self) -> None:
        offset = finite_array("offset_bd", self.offset_bd, shape=(None, None), what="bead")
        d = offset.shape[1]
        if d not in (2, 3):
            raise ValueError(f"offset_bd must have two or three components, got {d}")
        size = positive_array("size_b", self.size_b, shape=(len(offset),), what="bead")
        start = integer_array("start_n", self.start_n, shape=(None,))
        if not len(start) or start[0] != 0 or start[-1] != len(size) or (np.diff(start) < 1).any():
            raise ValueError(
                f"start_n must grow from 0 to the number of beads ({len(size)}), got {brief(start.tolist())}"
            )
        n = len(start) - 1
        gyration = positive_array("gyration_nk", self.gyration_nk, shape=(n, 1 if d == 2 else 3))
        orientation = finite_array("orientation_nq", self.orientation_nq, shape=(n, 2 if d == 2 else 4))
        self._keep(
            start_n=start,
            offset_bd=offset,
            size_b=size,
            gyration_nk=gyration,
            orientation_nq=_unit("orientation_nq", orientation, "direction"),
        )

    def __len__(self) -> int:
        return len(self.start_n) - 1

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.offset_bd.shape[1])

    @property
    def names(self) -> tuple[str, str]:
        """What one of the particles is called, and several."""
        return "rigid body", "rigid bodies"

    def oriented(self, orientation_nq: NDArray[np.float64]) -> Beads:
        """Return the bodies with other orientations."""
        return Beads(self.start_n, self.offset_bd, self.size_b, self.gyration_nk, orientation_nq)

    @property
    def particle_b(self) -> NDArray[np.int64]:
        """The (B,) particles that the beads belong to."""
        return np.repeat(np.arange(len(self)), np.diff(self.start_n))

    @property
    def _turns_nk(self) -> NDArray[np.bool_]:
        """Return (N, k) about which axes a turn moves a bead: a row of beads does not turn about itself."""
        square = self.offset_bd**2
        aside = square.sum(axis=1, keepdims=True) - (square if self.dimension == 3 else 0.0)
        largest = np.maximum.reduceat(aside[:, : self.gyration_nk.shape[1]], self.start_n[:-1], axis=0)
        return np.asarray(largest > _ON_AXIS**2)

    def reach(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N,) radii of the discs or spheres about the centers that hold the particles [length]."""
        far = np.sqrt((self.offset_bd**2).sum(axis=1)) + self.size_b
        return np.asarray(np.maximum.reduceat(far, self.start_n[:-1]) * radius_n)

    def sweep(self, radius_n: Any) -> NDArray[np.float64]:
        """Return the (N,) distances from the centers within which beads go round as the bodies turn [length]."""
        return self.reach(radius_n)

    def stiffening(self, radius_n: Any) -> tuple[float, float]:
        """Return by how much the stiffness over mass of contacts, and of tangential springs, may exceed that of discs.

        As of `Spheroids.stiffening`: a contact's force turns a body by the arm of its bead, along or across which it
        does no more than across; a tangential one by that and the radius of the bead.
        """
        gyration = self.gyration_nk[self.particle_b]
        if self.dimension == 2:
            arm = np.sqrt((self.offset_bd**2).sum(axis=1)) / gyration[:, 0]
        else:
            # of all directions the one in which the cross product with the arm, over the inertia, is largest
            turned = np.cross(np.eye(3)[None], self.offset_bd[:, None, :]) / gyration[:, None, :]
            arm = np.linalg.norm(turned, 2, axis=(1, 2))
        whole = arm + self.size_b / gyration.min(axis=1)
        return 1.0 + float((arm**2).max()), 1.0 + float((whole**2).max())

    def arms(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (B, d) vectors from the particles' centers to their beads [length]."""
        owner = self.particle_b
        # a sum over the axes, not BLAS: the same bits for any number of threads
        turned = (self.frames()[owner] * self.offset_bd[:, None, :]).sum(axis=2)
        return np.asarray(turned * radius_n[owner, None])

    @property
    def axis_bd(self) -> NDArray[np.float64]:
        """Some (B, d) directions: no axis of a bead differs from the others."""
        return _any_axis(len(self.size_b), self.dimension)

    def semi_axes(self, radius_n: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the radii of the beads twice, for the (B,) semi-axes along some direction and across it [length]."""
        radius_b = self.site_radius(radius_n)
        return radius_b, radius_b

    def site_radius(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (B,) radii of the beads [length]."""
        return np.asarray(self.size_b * radius_n[self.particle_b])

    site_reach = site_radius

    def long_axes(self) -> NDArray[np.float64]:
        """Return the (N', d) axes of greatest extent of the bodies of more than one bead.

        Raises
        ------
        ValueError
            Naming a particle that has no such axis.

        """
        weight = self.size_b**self.dimension
        spread = weight[:, None, None] * self.offset_bd[:, :, None] * self.offset_bd[:, None, :]
        moment = np.add.reduceat(spread, self.start_n[:-1], axis=0)[self.turns_n]
        value, vector = np.linalg.eigh(moment)
        if (value[:, -1] - value[:, -2] <= _ROUND * value[:, -1]).any():
            n = int(np.flatnonzero(self.turns_n)[np.argmin(value[:, -1] - value[:, -2])])
            raise ValueError(f"packing.shapes must have one long axis each, got none for particle {n}")
        frames = self.frames()[self.turns_n]
        return np.asarray((frames * vector[:, None, :, -1]).sum(axis=2))

    def select(self, kept_n: NDArray[Any]) -> Beads:
        """Return the shapes of some of the particles."""
        kept = np.arange(len(self))[kept_n]
        bead = np.concatenate(
            [np.arange(self.start_n[n], self.start_n[n + 1]) for n in kept] or [np.zeros(0, np.int64)]
        )
        start = np.concatenate([[0], np.cumsum(np.diff(self.start_n)[kept])])
        return Beads(start, self.offset_bd[bead], self.size_b[bead], self.gyration_nk[kept], self.orientation_nq[kept])


def _any_axis(count: int, dimension: int) -> NDArray[np.float64]:
    """Return the direction of x for so many sites."""
    return np.tile(np.eye(dimension)[0], (count, 1))


def _quaternion_product(one_nq: NDArray[np.float64], other_nq: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions of the second rotations followed by the first ones."""
    a, u = one_nq[:, :1], one_nq[:, 1:]
    b, v = other_nq[:, :1], other_nq[:, 1:]
    real = a * b - (u * v).sum(axis=1, keepdims=True)
    return np.hstack([real, a * v + b * u + np.cross(u, v)])


Shapes = Discs | Spheroids | Superellipsoids | Beads


def same_but_turned(one: Shapes, other: Shapes) -> bool:
    """Return whether two shapes differ by how they are turned only."""
    if type(one) is not type(other) or len(one) != len(other):
        return False
    return one.oriented(other.orientation_nq) == other
