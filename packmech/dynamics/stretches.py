"""Displacements of tangential springs of listed pairs, by pair and image: how they outlive a list that is given up."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.friction import sliding_columns, spring_columns, turning_axes
from packmech.effects import RollingResistance, RoughContacts
from packmech.jit.compiled import device
from packmech.minimize.passes.pair_list import PairList, Track, listed_pairs
from packmech.tangential import TangentialDisplacements


@device
def inner_stretches(track):  # type: ignore[no-untyped-def]
    """Return the stretches of the inner pairs; None without a track."""
    return None if track is None else track.inner_pk


def empty_track(columns: int, beads: int = 1) -> Track:
    """Return a track without pairs, for an empty list.

    Parameters
    ----------
    columns
        Numbers of the springs of one touch.
    beads
        How many beads a particle has at most: any two of two particles may touch.

    """
    none = np.zeros((0, beads * beads * columns))
    return Track(none, none.copy())


class Stretches(NamedTuple):
    """Pairs of rows (i < j, or i == j), images in the loops' lattice (C, 3), beads (C, 2), and stretches of one touch.

    Those of sliding in 1 or 3 columns, then of rolling in as many, then of twisting in one, where there are such; then
    the numbers that interactions keep of the pair, `memory` columns of them.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    bead_c2: NDArray[np.int64]
    stretch_ck: NDArray[np.float64]

    def moved(self, shift_nd: NDArray[np.int64], back_dd: NDArray[np.int64], memory: int = 0) -> Stretches:
        """Return them after rows were moved by minus lattice @ shift and the lattice was exchanged.

        Parameters
        ----------
        shift_nd
            (N, d) whole numbers.
        back_dd
            (d, d) whole numbers: inverse of the change of lattice vectors.
        memory
            Columns at the end that have no direction.

        """
        d = shift_nd.shape[1]
        image = self.image_cd.copy()
        image[:, :d] += shift_nd[self.j_c] - shift_nd[self.i_c]
        image[:, :d] = image[:, :d] @ back_dd.T
        bead, stretch = self.bead_c2, self.stretch_ck
        own = self.i_c == self.j_c
        if own.any():
            # the list takes the image of a pair with itself whose first nonzero number is positive
            first = np.take_along_axis(image, np.argmax(image != 0, axis=1)[:, None], axis=1)[:, 0]
            turned = own & (first < 0)
            image[turned] *= -1
            bead = np.where(turned[:, None], bead[:, ::-1], bead)
            if d == 3:
                # nothing rolls or twists on itself
                directed = turned[:, None] & (np.arange(stretch.shape[1]) < stretch.shape[1] - memory)
                stretch = np.where(directed, -stretch, stretch)
        return Stretches(self.i_c, self.j_c, image, bead, stretch)


def split_columns(
    friction: Any, axes: tuple[int, ...], stretch_ck: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return sliding (C, 1 or 3), rolling (C, 1 or 3) and twisting (C,) displacements of stretches; None for no such.

    Without friction sliding ones are 0.

    Parameters
    ----------
    friction, axes
        Of the engine.
    stretch_ck
        As in `Stretches`, without what interactions remember.

    """
    if friction is None:
        return np.zeros((len(stretch_ck), 1 if len(axes) == 2 else 3)), None, None
    sliding = len(turning_axes(friction, axes))
    if not isinstance(friction, RoughContacts):
        return stretch_ck[:, :sliding], None, None
    first = len(sliding_columns(friction.friction, axes))
    rolling = stretch_ck[:, first : first + sliding] if isinstance(friction.rolling, RollingResistance) else None
    return stretch_ck[:, :sliding], rolling, None if friction.twisting is None else stretch_ck[:, -1]


def columns_of(
    friction: Any,
    axes: tuple[int, ...],
    given: TangentialDisplacements,
    turned_c: NDArray[np.bool_],
    memory: int = 0,
) -> NDArray[np.float64]:
    """Return the stretches of a packing's displacements, zero for what it has none of.

    Parameters
    ----------
    friction, axes
        Of the engine.
    given
        The packing's.
    turned_c
        (C,) whether i and j of a row are exchanged.
    memory
        How many numbers interactions keep of each pair.

    """
    given.check_memory(memory)
    kept = np.zeros((len(given), memory)) if given.memory_ck is None else given.memory_ck
    if friction is None:
        return kept
    count, sliding = len(given), len(turning_axes(friction, axes))
    found = np.zeros((count, len(spring_columns(friction, axes))))
    turned = turned_c[:, None]
    found[:, :sliding] = np.where(turned & (sliding == 3), -given.displacement_ck, given.displacement_ck)
    _, rolling, twisting = split_columns(friction, axes, found)
    if rolling is not None and given.rolling_ck is not None:
        # the tangent of a plane turns round with n, what rolls does not
        rolling[:] = np.where(turned & (sliding == 1), -given.rolling_ck, given.rolling_ck)
    if twisting is not None and given.twisting_c is not None:
        twisting[:] = given.twisting_c
    return np.hstack([found, kept])


def read_stretches(pairs: PairList, track: Track | None, components: int) -> Stretches:
    """Return the stretches that are not zero, sorted by (i, j, image, beads); none without a track.

    Parameters
    ----------
    pairs, track
        Of the engine.
    components
        Numbers of the springs of one touch.

    """
    if track is None:
        none, two, three = (np.zeros((0, *more), dtype=np.int64) for more in ((), (2,), (3,)))
        return Stretches(none, none, three, two, np.zeros((0, components)))
    i, j, image = listed_pairs(pairs)
    springs = track.inner_pk[: len(i)].reshape(len(i), track.inner_pk.shape[1] // components, components)
    pair, spring = np.nonzero(springs.any(axis=2))
    i, j, image, stretch = i[pair], j[pair], image[pair], springs[pair, spring]
    bead = np.stack(np.divmod(spring, math.isqrt(springs.shape[1])), axis=1)
    order = np.lexsort((*bead.T[::-1], *image.T[::-1], j, i))
    return Stretches(i[order], j[order], image[order], bead[order], stretch[order])


def write_stretches(pairs: PairList, track: Track | None, held: Stretches) -> None:
    """Give the pairs of a list the stretches that are held for them."""
    if track is None or not len(held.i_c):
        return
    i, j, image = listed_pairs(pairs)
    whole = np.concatenate([np.column_stack([i, j, image]), np.column_stack([held.i_c, held.j_c, held.image_cd])])
    _, key = np.unique(whole, axis=0, return_inverse=True)
    key = key.ravel()
    listed, asked = key[: len(i)], key[len(i) :]
    order = np.argsort(listed)
    place = np.searchsorted(listed[order], asked)
    found = order[np.minimum(place, len(order) - 1)]
    hit = listed[found] == asked
    components = held.stretch_ck.shape[1]
    springs = np.zeros((len(i), track.inner_pk.shape[1] // components, components))
    spring = held.bead_c2[:, 0] * math.isqrt(springs.shape[1]) + held.bead_c2[:, 1]
    springs[found[hit], spring[hit]] = held.stretch_ck[hit]
    track.inner_pk[: len(i)] = springs.reshape(len(i), -1)
