# mypy: disable-error-code="no-untyped-call"
"""One assembly: the second derivatives of a sum of elements by all coordinates of their particles, and by strains.

Each of the N particles has q coordinates, its d positions and then K turns (rotations about fixed axes, measured in
lengths: angles times the radius of gyration), and the box has strains E. They move the coordinates of a pair by

    d(vector) = du_j - du_i + E vector        d(rotations of i) = sum over k of turn_ik dt_ik, and of j alike

so that a matrix A takes changes of coordinates to those of all pairs' coordinates. With pulls p = dE/dxi and stiffness
W = d2E/dxi dxi of the elements (`packmech.contacts.elements`),

    f = A^T p        slopes of the energy: minus net forces and torques; along strains stress times volume
    K = A^T W A      second derivatives

A strain moves centers and turns nothing. The assembly knows no kind of contact by name.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts.elements import Elements, sum_slopes
from packmech.contacts.network import distinct_pairs
from packmech.jit.compiled import device, kernel
from packmech.linalg.mandel import mandel_basis


@kernel
def _turned(i_c, j_c, stiffness, turn, d):  # type: ignore[no-untyped-def]
    """Return stiffness by vectors and coordinates of turns, from that by vectors and rotations."""
    count, x = stiffness.shape[:2]
    turns, t = turn.shape[1:]
    y = d + 2 * turns
    out = np.empty((count, y, y))
    change = np.zeros((y, x))
    half = np.empty((y, x))
    for a in range(d):
        change[a, a] = 1.0
    for c in range(count):
        for k in range(turns):
            for a in range(t):
                change[d + k, d + a] = turn[i_c[c], k, a]
                change[d + turns + k, d + t + a] = turn[j_c[c], k, a]
        for a in range(y):
            for b in range(x):
                total = 0.0
                for m in range(x):
                    total += change[a, m] * stiffness[c, m, b]
                half[a, b] = total
        for a in range(y):
            for b in range(y):
                total = 0.0
                for m in range(x):
                    total += half[a, m] * change[b, m]
                out[c, a, b] = total
    return out


@kernel
def _scatter(  # type: ignore[no-untyped-def]
    i_c, j_c, pair_c, vector, local, symmetric, basis, upper, lower, diagonal, column, row, corner
):
    """Add the blocks of all contacts, in order; `row` and `lower` only where these are no transposes."""
    count, d = vector.shape
    s, y = basis.shape[0], local.shape[1]
    turns = (y - d) // 2
    q = d + turns
    # which of a pair's coordinates a particle's are, as i and as j, and with which sign
    place = np.empty((2, q), np.int64)
    sign = np.ones((2, q))
    for a in range(q):
        place[0, a] = a
        place[1, a] = a if a < d else a + turns
        if a < d:
            sign[0, a] = -1.0
    tilt = np.empty((s, d))
    by_strain, of_stress = np.empty((s, y)), np.empty((s, y))
    for c in range(count):
        i, j = i_c[c], j_c[c]
        one = local[c]
        for m in range(s):
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += basis[m, a, b] * vector[c, b]
                tilt[m, a] = total
            for a in range(y):
                total = 0.0
                for b in range(d):
                    total += one[a, b] * tilt[m, b]
                by_strain[m, a] = total
                if not symmetric:
                    total = 0.0
                    for b in range(d):
                        total += tilt[m, b] * one[b, a]
                    of_stress[m, a] = total
        for m in range(s):
            for k in range(s):
                for a in range(d):
                    corner[m, k] += tilt[m, a] * by_strain[k, a]
        if i == j:
            # an own image moves along, and turns alike
            for a in range(d, q):
                at, to = place[0, a], place[1, a]
                for b in range(d, q):
                    diagonal[i, a, b] += (one[at, place[0, b]] + one[to, place[1, b]]) + (
                        one[at, place[1, b]] + one[to, place[0, b]]
                    )
                for m in range(s):
                    column[i, a, m] += by_strain[m, at] + by_strain[m, to]
                    if not symmetric:
                        row[i, a, m] += of_stress[m, at] + of_stress[m, to]
            continue
        p = pair_c[c]
        for a in range(q):
            for end in range(2):
                n = i if end == 0 else j
                at, side = place[end, a], sign[end, a]
                for b in range(q):
                    diagonal[n, a, b] += side * sign[end, b] * one[at, place[end, b]]
                for m in range(s):
                    column[n, a, m] += side * by_strain[m, at]
                    if not symmetric:
                        row[n, a, m] += side * of_stress[m, at]
            for b in range(q):
                upper[p, a, b] += sign[0, a] * sign[1, b] * one[place[0, a], place[1, b]]
                if not symmetric:
                    lower[p, a, b] += sign[1, a] * sign[0, b] * one[place[1, a], place[0, b]]


@device
def _write(number, n, m, block, transposed, place, data, index):  # type: ignore[no-untyped-def]
    """Write the block of two particles, or its transpose, at the places that their rows have reached."""
    q = block.shape[0]
    for a in range(q):
        row = number[n * q + a]
        if row < 0:
            continue
        for b in range(q):
            column = number[m * q + b]
            if column >= 0:
                data[place[row]] = block[b, a] if transposed else block[a, b]
                index[place[row]] = column
                place[row] += 1


@kernel
def _rows(number, pair_i, pair_j, upper, lower, diagonal):  # type: ignore[no-untyped-def]
    """Return entries, columns and beginnings of the rows of coordinates that have a number, -1 being those without.

    `lower` is empty where it is the transpose of `upper`.
    """
    particles, q = diagonal.shape[:2]
    width = np.zeros(particles, np.int32)
    for n in range(particles):
        for a in range(q):
            width[n] += number[n * q + a] >= 0
    length = width.copy()
    for p in range(pair_i.shape[0]):
        length[pair_i[p]] += width[pair_j[p]]
        length[pair_j[p]] += width[pair_i[p]]
    start = np.zeros(width.sum() + 1, np.int32)
    for n in range(particles):
        for a in range(q):
            row = number[n * q + a]
            if row >= 0:
                start[row + 1] = start[row] + length[n]
    data, index, place = np.empty(start[-1]), np.empty(start[-1], np.int32), start[:-1].copy()
    # pairs are sorted by (i, j): taken in order, columns of a row come in order
    for p in range(pair_i.shape[0]):
        if lower.shape[0]:
            _write(number, pair_j[p], pair_i[p], lower[p], False, place, data, index)
        else:
            _write(number, pair_j[p], pair_i[p], upper[p], True, place, data, index)
    for n in range(particles):
        _write(number, n, n, diagonal[n], False, place, data, index)
    for p in range(pair_i.shape[0]):
        _write(number, pair_i[p], pair_j[p], upper[p], False, place, data, index)
    return data, index, start


def _number_pairs(
    i_c: NDArray[np.int64], j_c: NDArray[np.int64], particles: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of different particles, each once, sorted by (i, j), and the number of each element's pair."""
    # elements of one kind are sorted already, which a stable sort finds out first
    order = np.argsort(i_c * particles + j_c, kind="stable")
    pair_i, pair_j, sorted_c = distinct_pairs(i_c[order], j_c[order])
    pair_c = np.empty_like(sorted_c)
    pair_c[order] = sorted_c
    return pair_i, pair_j, pair_c


@dataclass(frozen=True, eq=False)
class Assembled:
    """Slopes and second derivatives of a sum of elements, in blocks of q coordinates a particle.

    Attributes
    ----------
    pair_i, pair_j
        (P,) pairs of particles i < j that interact, each once.
    upper_pqq, lower_pqq
        (P, q, q) their blocks (i, j) and (j, i); the latter None where it is the transpose of the former.
    diagonal_nqq
        (N, q, q) blocks on the diagonal.
    column_nqe, row_nqe
        (N, q, s) derivatives of the slopes by strains, and of stress times volume by coordinates; the latter None where
        both are the same.
    corner_ee
        (s, s) derivatives of stress times volume by strains [energy].
    elements, turn_nkt
        As in `assemble`.

    """

    pair_i: NDArray[np.int64]
    pair_j: NDArray[np.int64]
    upper_pqq: NDArray[np.float64]
    lower_pqq: NDArray[np.float64] | None
    diagonal_nqq: NDArray[np.float64]
    column_nqe: NDArray[np.float64]
    row_nqe: NDArray[np.float64] | None
    corner_ee: NDArray[np.float64]
    elements: Sequence[Elements]
    turn_nkt: NDArray[np.float64]

    @functools.cached_property
    def slope_nq(self) -> NDArray[np.float64]:
        """The (N, q) slopes of the energy: minus net forces, and torques over the radii of gyration [force]."""
        total, d = np.zeros(self.diagonal_nqq.shape[:2]), self.diagonal_nqq.shape[1] - self.turn_nkt.shape[1]
        for one in self.elements:
            total += sum_slopes(one.i_c, one.j_c, one.pull_cx, self.turn_nkt, d)
        return total

    @property
    def symmetric(self) -> bool:
        """Whether second derivatives are symmetric by what they are made of."""
        return self.lower_pqq is None

    def matrix(self, free_f: NDArray[np.bool_], extra_f: NDArray[np.float64] | None = None) -> sp.csr_array:
        """Return the derivatives by the free ones of the (N q,) coordinates, with something added on the diagonal."""
        diagonal, lower = self.diagonal_nqq, self.lower_pqq
        if extra_f is not None:
            diagonal, q = diagonal.copy(), diagonal.shape[1]
            diagonal[:, range(q), range(q)] += extra_f.reshape(-1, q)
        number = np.where(free_f, np.cumsum(free_f) - 1, -1)
        lower = np.zeros((0, *self.upper_pqq.shape[1:])) if lower is None else lower
        rows = _rows(number, self.pair_i, self.pair_j, self.upper_pqq, lower, diagonal)
        size = len(rows[2]) - 1
        found = sp.csr_array(rows, shape=(size, size))
        found.has_canonical_format = True
        return found

    def column(self, free_f: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the (F, s) derivatives of the slopes along the free coordinates by strains."""
        return np.compress(free_f, self.column_nqe.reshape(len(free_f), len(self.corner_ee)), axis=0)

    def row(self, free_f: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the (s, F) derivatives of stress times volume by the free coordinates."""
        side = self.column_nqe if self.row_nqe is None else self.row_nqe
        return np.compress(free_f, side.reshape(len(free_f), len(self.corner_ee)), axis=0).T


def assemble(
    elements: Sequence[Elements],
    turn_nkt: NDArray[np.float64],
    dimension: int,
    *,
    single_nqq: NDArray[np.float64] | None = None,
    basis_edd: NDArray[np.float64] | None = None,
) -> Assembled:
    """Return the second derivatives of a sum of elements, and its slopes.

    Parameters
    ----------
    elements
        Elements of any kinds.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns; K = 0 where nothing turns.
    dimension
        2 or 3.
    single_nqq
        (N, q, q) second derivatives of what acts on single particles, added on the diagonal.
    basis_edd
        (s, d, d) strains, any displacement gradients; Mandel's unless given.

    """
    # arrays that may not be written to would be compiled for once more
    basis = np.array(mandel_basis(dimension) if basis_edd is None else basis_edd, order="C")
    particles, turns = turn_nkt.shape[:2]
    q, s = dimension + turns, len(basis)
    symmetric = all(one.symmetric for one in elements)
    elements = [one for one in elements if len(one.i_c)]
    i_c, j_c = (
        np.concatenate([np.zeros(0, np.int64), *(getattr(one, name) for one in elements)]) for name in ("i_c", "j_c")
    )
    pair_i, pair_j, pair_c = _number_pairs(i_c, j_c, particles)
    upper = np.zeros((len(pair_i), q, q))
    lower = np.zeros((0 if symmetric else len(pair_i), q, q))
    diagonal = np.zeros((particles, q, q))
    if single_nqq is not None:
        diagonal += single_nqq
    column, corner = np.zeros((particles, q, s)), np.zeros((s, s))
    row = np.zeros((0 if symmetric else particles, q, s))
    end = 0
    for one in elements:
        part = slice(end, end := end + len(one.i_c))
        local, ends = one.stiffness_cxx, (i_c[part], j_c[part])
        if turns or one.rotations:
            local = _turned(*ends, _with_rotations(local, dimension, turn_nkt.shape[2]), turn_nkt, dimension)
        blocks = upper, lower, diagonal, column, row, corner
        _scatter(*ends, pair_c[part], one.vector_cd, local, symmetric, basis, *blocks)
    if symmetric:
        # but for rounding it is
        corner = 0.5 * (corner + corner.T)
    return Assembled(
        pair_i, pair_j, upper, None if symmetric else lower, diagonal, column, None if symmetric else row, corner,
        elements, turn_nkt,
    )  # fmt: skip


def _with_rotations(stiffness_cxx: NDArray[np.float64], d: int, rotations: int) -> NDArray[np.float64]:
    """Return the stiffness by vectors and so many rotations of both particles, which those without do not feel."""
    x = d + 2 * rotations
    if stiffness_cxx.shape[1] == x:
        return stiffness_cxx
    whole = np.zeros((len(stiffness_cxx), x, x))
    whole[:, :d, :d] = stiffness_cxx
    return whole
