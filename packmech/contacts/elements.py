"""Contacts as elements: how the energy of each changes with the coordinates of its pair.

The coordinates xi of a pair are the vector from center i to center j and the rotations of i and of j: t angles each, or
none where nothing turns. A contact of distance rho, `slope` d rho/d xi and `curvature` d2 rho/d xi d xi, whose energy
has the derivatives u' and u'' by rho, has

    pull        dE/dxi          u' slope
    stiffness   d2E/dxi dxi     u'' slope slope^T + u' curvature

Contacts of discs and spheres, of shapes and of beads, bonds, links under tension and springs with friction differ in
these two arrays and in nothing else (`packmech.mechanics.assembly`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import scipy.sparse as sp


class PairGeometry(Protocol):
    """Pairs of particles with the slopes of their distances: `Contacts`, `ShapeContacts`."""

    @property
    def i_c(self) -> NDArray[np.int64]:
        """The (C,) particles i."""

    @property
    def j_c(self) -> NDArray[np.int64]:
        """The (C,) particles j, i <= j."""

    @property
    def distance_c(self) -> NDArray[np.float64]:
        """The (C,) distances at which laws are taken [length]."""

    @property
    def particles(self) -> int:
        """Number of particles."""

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes."""

    @property
    def vector_cd(self) -> NDArray[np.float64]:
        """The (C, d) vectors from center i to center j [length]."""

    @property
    def normal_cd(self) -> NDArray[np.float64]:
        """The (C, d) unit vectors along which the pairs push, from i to j [1]."""

    @property
    def push_c(self) -> NDArray[np.float64]:
        """The (C,) sizes of the forces over the derivatives of the energies by the distances [1]."""

    @property
    def slope_cx(self) -> NDArray[np.float64]:
        """The (C, X) slopes of the distances along the pairs' coordinates."""

    @property
    def curvature_cxx(self) -> NDArray[np.float64]:
        """The (C, X, X) second derivatives of the distances."""

    @property
    def turn_nkt(self) -> NDArray[np.float64]:
        """The (N, K, t) rotations that one length of each coordinate of turns makes; K = 0 where nothing turns."""

    def points(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d) vectors from center i to the point of contact [length]."""

    def point_slopes(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d, X) derivatives of these by the pairs' coordinates, rotations among them."""


def normal_slopes(pairs: PairGeometry) -> NDArray[np.float64]:
    """Return the (C, d, X) derivatives of the normals by the pairs' coordinates."""
    d, normal = pairs.dimension, pairs.normal_cd
    bent = pairs.curvature_cxx[:, :d] / pairs.push_c[:, None, None]
    return np.asarray(bent - normal[:, :, None] * (normal[:, :, None] * bent).sum(axis=1)[:, None])


@dataclass(frozen=True, eq=False)
class Elements:
    """Contacts of one kind, ready to be assembled.

    Attributes
    ----------
    i_c, j_c
        (C,) particles, i <= j.
    vector_cd
        (C, d) vectors from center i to center j [length].
    pull_cx
        (C, X) derivatives of the energies by the pairs' coordinates [force], [torque]; X = d + 2 t.
    stiffness_cxx
        (C, X, X) derivatives of these, row by row; symmetric where there is an energy.
    symmetric
        Whether they are.

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    vector_cd: NDArray[np.float64]
    pull_cx: NDArray[np.float64]
    stiffness_cxx: NDArray[np.float64]
    symmetric: bool = True

    @property
    def rotations(self) -> int:
        """Number t of rotations of each particle of a pair."""
        return (int(self.pull_cx.shape[1]) - int(self.vector_cd.shape[1])) // 2


def elements_of(pairs: PairGeometry, first_c: NDArray[np.float64], second_c: NDArray[np.float64]) -> Elements:
    """Return the elements of pairs whose energies depend on their distances alone.

    Parameters
    ----------
    pairs
        The pairs, with curvatures.
    first_c, second_c
        (C,) du/drho [force] and d2u/drho2 [force/length].

    Raises
    ------
    ValueError
        If a pair with a force has coincident centers: its energy has no second derivative there.

    """
    check_centers(pairs, first_c)
    slope = np.ascontiguousarray(pairs.slope_cx)
    # with the pairs along the last axis: products over short rows take twice as long
    along = np.ascontiguousarray(slope.T)
    stiffness = np.ascontiguousarray((second_c * (along[:, None] * along)).transpose(2, 0, 1))
    if first_c.any():
        stiffness += first_c[:, None, None] * pairs.curvature_cxx
    return Elements(pairs.i_c, pairs.j_c, pairs.vector_cd, first_c[:, None] * slope, stiffness)


def check_centers(pairs: PairGeometry, first_c: NDArray[np.float64]) -> None:
    """Refuse pairs with a force whose centers coincide, where second derivatives are asked for."""
    stuck = (pairs.distance_c == 0.0) & (first_c != 0.0)
    if stuck.any():
        c = int(np.argmax(stuck))
        raise ValueError(
            "packing must have no coincident centers where second derivatives are asked for, "
            f"got particles {pairs.i_c[c]} and {pairs.j_c[c]} at one place"
        )


def end_slopes(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    slope_cx: NDArray[np.float64],
    turn_nkt: NDArray[np.float64],
    dimension: int,
) -> NDArray[np.float64]:
    """Return the (2, C, q) slopes along the coordinates of i and of j, q = d + K: positions, then turns as lengths.

    Parameters
    ----------
    i_c, j_c
        (C,) particles of the pairs.
    slope_cx
        (C, X) slopes along vectors and rotations, or along vectors alone.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns; K = 0 where nothing turns.
    dimension
        Number of Cartesian axes d.

    """
    d, (turns, t) = dimension, turn_nkt.shape[1:]
    ends = np.zeros((2, len(i_c), d + turns))
    ends[0, :, :d], ends[1, :, :d] = -slope_cx[:, :d], slope_cx[:, :d]
    if turns and slope_cx.shape[1] > d:
        ends[0, :, d:] = np.einsum("ckt,ct->ck", turn_nkt[i_c], slope_cx[:, d : d + t])
        ends[1, :, d:] = np.einsum("ckt,ct->ck", turn_nkt[j_c], slope_cx[:, d + t :])
    return ends


def sum_ends(pairs: PairGeometry, weight_c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, q) slopes of the sum of the distances times weights: with du/drho those of the energy."""
    slope = weight_c[:, None] * pairs.slope_cx
    return sum_slopes(pairs.i_c, pairs.j_c, slope, pairs.turn_nkt, pairs.dimension)


def sum_slopes(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    slope_cx: NDArray[np.float64],
    turn_nkt: NDArray[np.float64],
    dimension: int,
) -> NDArray[np.float64]:
    """Return the (N, q) sums of the slopes of pairs along the coordinates of each particle, arguments as above.

    Of pulls dE/dxi these are minus the net forces and, over radii of gyration, torques.
    """
    d, (particles, turns, t) = dimension, turn_nkt.shape
    total = np.zeros((particles, d + turns))
    for a in range(d):
        total[:, a] = np.bincount(j_c, slope_cx[:, a], particles) - np.bincount(i_c, slope_cx[:, a], particles)
    if turns and slope_cx.shape[1] > d:
        turned = np.empty((particles, t))
        for a in range(t):
            turned[:, a] = np.bincount(i_c, slope_cx[:, d + a], particles)
            turned[:, a] += np.bincount(j_c, slope_cx[:, d + t + a], particles)
        total[:, d:] = np.einsum("nkt,nt->nk", turn_nkt, turned)
    return total


def distance_rows(pairs: PairGeometry) -> sp.csr_array:
    """Return the (C, N q) derivatives of the pairs' distances by the q = d + K coordinates of each particle."""
    return pair_rows(pairs.i_c, pairs.j_c, pairs.slope_cx, pairs.turn_nkt, pairs.dimension)


def pair_rows(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    slope_cx: NDArray[np.float64],
    turn_nkt: NDArray[np.float64],
    dimension: int,
) -> sp.csr_array:
    """Return the (C, N q) derivatives, by the coordinates of the particles, of what has these slopes along its pair's.

    Arguments are as in `end_slopes`, with i <= j.
    """
    import scipy.sparse as sp

    ends = end_slopes(i_c, j_c, slope_cx, turn_nkt, dimension)
    size = len(turn_nkt) * ends.shape[2]
    # a particle keeps its distance to its own image when it moves; it turns with it
    own = i_c == j_c
    ends[0, own] += ends[1, own]
    ends[1, own] = 0.0
    q = ends.shape[2]
    data = np.concatenate([ends[0], ends[1]], axis=1)
    column = np.concatenate([i_c[:, None] * q + np.arange(q), j_c[:, None] * q + np.arange(q)], axis=1)
    kept = data != 0.0
    start = np.concatenate([[0], np.cumsum(kept.sum(axis=1))])
    rows = data[kept], column[kept].astype(np.int32), start.astype(np.int32)
    matrix = sp.csr_array(rows, shape=(len(i_c), size))
    matrix.has_canonical_format = True
    return matrix
