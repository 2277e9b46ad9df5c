"""The periodic box: any lattice vectors, in two or three dimensions."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import brief, finite_array, given_shape, integer, positive, positive_array

# lengths between these have squares, and volumes, that double precision carries [length]
SHORTEST, LONGEST = 1e-60, 1e60
# all sums and differences of lattice vectors, as columns
_SUMS = {d: np.array(np.meshgrid(*[[-1, 0, 1]] * d)).reshape(d, -1) for d in (2, 3)}
# wrapping from further away, in lattice vectors, leaves few digits of the place in the cell
_FARTHEST = 2.0**31
# part of the height by which other lattice vectors may stand out of a plane across an axis
_FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class Box:
    """A periodic box whose lattice vectors are the columns of `lattice_dd`.

    Parameters
    ----------
    lattice_dd
        (d, d) lattice vectors as columns [length]; d = 2 or 3. A point is x = lattice_dd @ fraction. Or the (d,)
        lengths of the sides of a rectangular box; `Box.cubic` takes one length.

    Raises
    ------
    TypeError, ValueError
        If the array is not a finite square matrix of two or three linearly independent columns, nor as many lengths.

    Examples
    --------
    >>> box = Box([[2.0, 1.0], [0.0, 3.0]])
    >>> box.volume, Box([2.0, 3.0]).volume
    (6.0, 6.0)

    """

    lattice_dd: NDArray[np.float64]

    def __post_init__(self) -> None:
        sides = given_shape(self.lattice_dd)
        if sides in ((2,), (3,)):
            lattice = np.diag(positive_array("lattice_dd", self.lattice_dd, shape=sides, what="side"))
        elif sides == () and isinstance(self.lattice_dd, int | float | np.number):
            raise ValueError(
                f"lattice_dd must say how many dimensions a box has, got {brief(self.lattice_dd)}: take "
                f"Box.cubic({brief(self.lattice_dd)}, 2), or name the sides, Box([...])"
            )
        else:
            lattice = finite_array("lattice_dd", self.lattice_dd, shape=(None, None), what="row")
        if lattice.shape not in ((2, 2), (3, 3)):
            raise ValueError(f"lattice_dd must have shape (2, 2) or (3, 3), got {lattice.shape}")
        column = np.abs(lattice).max(axis=0)
        for k in np.flatnonzero((column > 0.0) & ((column < SHORTEST) | (column > LONGEST))):
            raise ValueError(
                f"lattice_dd must have columns of lengths between {SHORTEST:g} and {LONGEST:g} (take another unit of "
                f"length), got {lattice[:, k].tolist()} for column {k}"
            )
        length = np.linalg.norm(lattice, axis=0)
        if not (length > 0).all() or abs(np.linalg.det(lattice / length)) < 1e-12:
            raise ValueError(f"lattice_dd must have linearly independent columns, got {lattice.tolist()}")
        lattice.setflags(write=False)
        object.__setattr__(self, "lattice_dd", lattice)

    @staticmethod
    def cubic(side: float, dimension: int) -> Box:
        """Return a square (d = 2) or cubic (d = 3) box of the given side [length]."""
        side = positive("side", side)
        return Box(side * np.eye(integer("dimension", dimension, at_least=2, at_most=3)))

    def __str__(self) -> str:
        """Return the sides of a rectangular box, or the lattice vectors of another."""
        side = self.lattice_dd.diagonal()
        if np.array_equal(self.lattice_dd, np.diag(side)):
            return " x ".join(f"{one:.6g}" for one in side)
        return ", ".join(f"({', '.join(f'{one:.6g}' for one in vector)})" for vector in self.lattice_dd.T)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Box) and bool(np.array_equal(self.lattice_dd, other.lattice_dd))

    def __hash__(self) -> int:
        return hash(self.lattice_dd.tobytes())

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.lattice_dd.shape[0])

    @functools.cached_property
    def volume(self) -> float:
        """Area (d = 2) or volume (d = 3) of the box [length^d]."""
        return abs(float(np.linalg.det(self.lattice_dd)))

    @functools.cached_property
    def inverse_dd(self) -> NDArray[np.float64]:
        """The (d, d) inverse of the lattice [1/length]; rows are the reciprocal vectors."""
        # scaled by the column lengths first, so that flat boxes and any unit of length invert equally well
        length = np.linalg.norm(self.lattice_dd, axis=0)
        inverse: NDArray[np.float64] = np.linalg.inv(self.lattice_dd / length) / length[:, None]
        inverse.setflags(write=False)
        return inverse

    @functools.cached_property
    def height_d(self) -> NDArray[np.float64]:
        """The (d,) distances between opposite faces [length]."""
        height: NDArray[np.float64] = 1.0 / np.linalg.norm(self.inverse_dd, axis=1)
        height.setflags(write=False)
        return height

    def wrap(self, position_nd: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return positions inside the cell, and the (N, d) integer vectors taken away: x = wrapped + lattice @ image.

        Parameters
        ----------
        position_nd
            (N, d) Cartesian positions [length], at most 2^31 lattice vectors away.

        Raises
        ------
        ValueError
            If a position is so far away that rounding leaves too few digits of its place in the cell.

        """
        position = finite_array("position_nd", position_nd, shape=(None, self.dimension), empty=True)
        fraction = _fraction(position, self.inverse_dd)
        far = ~(np.abs(fraction) <= _FARTHEST).all(axis=1)
        if far.any():
            n = int(np.argmax(far))
            raise ValueError(
                f"position_nd must stay within {_FARTHEST:.0f} lattice vectors of the cell, got {position[n].tolist()} "
                f"for particle {n}"
            )
        image = np.floor(fraction)
        wrapped = position - image @ self.lattice_dd.T
        return wrapped, image.astype(np.int64)

    def strained(self, strain_dd: ArrayLike) -> Box:
        """Return the box with lattice (1 + strain) lattice, for a (d, d) displacement gradient."""
        strain = finite_array("strain_dd", strain_dd, shape=(self.dimension, self.dimension), what="row")
        return Box((np.eye(self.dimension) + strain) @ self.lattice_dd)

    def scaled(self, factor: float) -> Box:
        """Return the box with every length multiplied by the factor."""
        return Box(positive("factor", factor) * self.lattice_dd)

    @functools.cached_property
    def _reduction(self) -> tuple[Box | None, NDArray[np.int64]]:
        """The box of short vectors, None where it is this one, and U."""
        lattice, change = _reduce(self.lattice_dd)
        return None if lattice is self.lattice_dd else Box(lattice), change

    def height_across(self, axis: int) -> float | None:
        """Return the height along an axis that all but one of the lattice vectors are across; None without such.

        Parameters
        ----------
        axis
            0, 1 or 2.

        Examples
        --------
        >>> Box([[2.0, 1.0], [0.0, 3.0]]).height_across(1), Box([[2.0, 1.0], [0.0, 3.0]]).height_across(0)
        (3.0, None)

        """
        row = np.abs(self.lattice_dd[axis])
        return float(row.max()) if np.count_nonzero(row > _FLAT * row.max()) == 1 else None

    def reduced(self) -> tuple[Box, NDArray[np.int64]]:
        """Return a box of short vectors of the same lattice, and the integer matrix U with reduced = lattice @ U.

        Pairs of vectors are shortened against each other until none gets shorter (Lagrange-Gauss in 2D; in 3D the
        same, with sums of two, after Semaev 2001), so the vectors are the shortest independent ones.

        Examples
        --------
        >>> box, change = Box([[1.0, 10.0], [0.0, 1.0]]).reduced()
        >>> box.lattice_dd.tolist(), change.tolist()
        ([[1.0, 0.0], [0.0, 1.0]], [[1, -10], [0, 1]])

        """
        box, change = self._reduction
        return self if box is None else box, change.copy()

    def nearest_images(self, vector_pd: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the (P, d) images that make vectors [length] shortest: vector + lattice @ image.

        Rounding the fractions of a vector finds its nearest image in a cell of right angles alone.

        Examples
        --------
        >>> box = Box([[1.0, 0.4], [0.0, 1.0]])
        >>> box.nearest_images(np.array([[0.6, 0.45]])).tolist()  # fractions .42 and .45 are less than a half
        [[0, -1]]

        """
        short, change = self.reduced()
        image = -np.rint(vector_pd @ short.inverse_dd.T)
        moved = vector_pd + image @ short.lattice_dd.T
        # what is shorter than half of the least height is nearest; of other images those around are looked at
        far = np.flatnonzero((moved**2).sum(axis=1) > (0.5 * short.height_d.min()) ** 2)
        step = np.indices((3,) * self.dimension).reshape(self.dimension, -1).T - 1
        length2 = ((moved[far, None] + step @ short.lattice_dd.T) ** 2).sum(axis=2)
        image[far] += step[length2.argmin(axis=1)]
        return np.asarray(image @ change.T).astype(np.int64)


@dataclass(frozen=True)
class Copies:
    """Copies of a box side by side, numbered as their places count up, the last lattice vector fastest."""

    repeats: tuple[int, ...]

    @functools.cached_property
    def place_md(self) -> NDArray[np.int64]:
        """The (M, d) places of the copies, in numbers of boxes."""
        return np.indices(self.repeats).reshape(len(self.repeats), -1).T

    def __len__(self) -> int:
        return len(self.place_md)

    def reached(self, image_cd: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the (M, C) copies where what leaves copy m by image c ends, and by which (M, C, d) image of all."""
        beyond, inside = np.divmod(self.place_md[:, None] + image_cd, np.array(self.repeats))
        return np.ravel_multi_index(tuple(np.moveaxis(inside, 2, 0)), self.repeats), beyond


def _fraction(position_nd: NDArray[np.float64], inverse_dd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions in units of the lattice vectors; those too far away for any number are infinite or nan."""
    with np.errstate(over="ignore", invalid="ignore"):
        return position_nd @ inverse_dd.T


def _reduce(lattice_dd: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    dimension = lattice_dd.shape[0]
    change = np.eye(dimension, dtype=np.int64)
    # of reduced vectors no sum or difference of some is shorter than the longest of these
    sums = _SUMS[dimension]
    length2, longest2 = ((lattice_dd @ sums) ** 2).sum(axis=0), (lattice_dd**2).sum(axis=0)[:, None] * (sums != 0)
    if (length2 >= longest2.max(axis=0) * (1 - 1e-12)).all():
        return lattice_dd, change
    steps = np.array(np.meshgrid(*[[-1, 0, 1]] * (dimension - 1), indexing="ij")).reshape(dimension - 1, -1).T
    for _ in range(200):
        lattice = lattice_dd @ change
        length2 = (lattice**2).sum(axis=0)
        done = True
        for k in np.argsort(-length2, kind="stable"):
            others = [m for m in range(dimension) if m != k]
            basis = lattice[:, others]
            # nearest point of the sub-lattice of the other vectors, then its neighbors
            center = np.rint(np.linalg.lstsq(basis, lattice[:, k], rcond=None)[0]).astype(np.int64)
            trial = -(center + steps)
            vectors = lattice[:, [k]] + basis @ trial.T
            best = int(np.argmin((vectors**2).sum(axis=0)))
            if (vectors[:, best] ** 2).sum() < length2[k] * (1 - 1e-12):
                change[:, k] += change[:, others] @ trial[best]
                done = False
                break
        if done:
            break
    return np.ascontiguousarray(lattice_dd @ change), change
