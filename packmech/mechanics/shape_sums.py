"""Second derivatives of the energy of particles with shapes, their rotations among the coordinates.

Coordinates of a particle are its position and its turns, measured in lengths (`Spheroids.turn_basis`). For a contact
with the coordinates xi of its pair, the vector between the centers and the rotations of both,

    d2u/dxi dxi = u''(rho) (d rho/d xi) (d rho/d xi)^T + u'(rho) d2 rho/d xi d xi

of which the first part is the stiffness and the second the prestress. A strain of the box moves centers and turns
nobody.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts.network import distinct_pairs
from packmech.contacts.shape_contacts import ShapeContacts, slopes_of_ends
from packmech.jit.compiled import kernel
from packmech.linalg.mandel import mandel_basis


@kernel
def _gather(i_c, j_c, pair_c, vector, slope, curvature, first, second, turn, basis, pair, diagonal, coupling, strain):  # type: ignore[no-untyped-def]
    count, d = vector.shape
    s = basis.shape[0]
    turns, t = turn.shape[1], turn.shape[2]
    q = d + turns
    x = d + 2 * t
    whole = np.empty((x, x))
    # pair coordinates per coordinate of i, of j, and per strain
    left, right, tilt = np.empty((x, q)), np.empty((x, q)), np.empty((x, s))
    by_left, by_right, by_strain = np.empty((x, q)), np.empty((x, q)), np.empty((x, s))
    for c in range(count):
        i, j = i_c[c], j_c[c]
        for a in range(x):
            for b in range(x):
                whole[a, b] = second[c] * slope[c, a] * slope[c, b] + first[c] * curvature[c, a, b]
        left[:] = 0.0
        right[:] = 0.0
        tilt[:] = 0.0
        for a in range(d):
            left[a, a], right[a, a] = -1.0, 1.0
            for m in range(s):
                for b in range(d):
                    tilt[a, m] += basis[m, a, b] * vector[c, b]
        for k in range(turns):
            for a in range(t):
                left[d + a, d + k] = turn[i, k, a]
                right[d + t + a, d + k] = turn[j, k, a]
        if i == j:
            # an own image turns and moves along
            for a in range(x):
                for b in range(q):
                    left[a, b] += right[a, b]
        for a in range(x):
            for b in range(q):
                one = other = 0.0
                for m in range(x):
                    one += whole[a, m] * left[m, b]
                    other += whole[a, m] * right[m, b]
                by_left[a, b], by_right[a, b] = one, other
            for m in range(s):
                one = 0.0
                for b in range(d):
                    one += whole[a, b] * tilt[b, m]
                by_strain[a, m] = one
        for m in range(s):
            for k in range(s):
                for a in range(d):
                    strain[m, k] += tilt[a, m] * by_strain[a, k]
        for a in range(q):
            for b in range(q):
                for m in range(x):
                    diagonal[i, a, b] += left[m, a] * by_left[m, b]
            for k in range(s):
                for m in range(x):
                    coupling[i, a, k] += left[m, a] * by_strain[m, k]
        if i == j:
            continue
        place = pair_c[c]
        for a in range(q):
            for b in range(q):
                for m in range(x):
                    diagonal[j, a, b] += right[m, a] * by_right[m, b]
                    pair[place, a, b] += left[m, a] * by_right[m, b]
            for k in range(s):
                for m in range(x):
                    coupling[j, a, k] += right[m, a] * by_strain[m, k]


@kernel
def _compressed(start, column, order, blocks, number_nq, extra_f):  # type: ignore[no-untyped-def]
    """Return the compressed rows of the numbered coordinates of a matrix of blocks, its columns in order."""
    count, q = number_nq.shape
    size = 0
    for n in range(count):
        rows = 0
        for a in range(q):
            rows += number_nq[n, a] >= 0
        for k in range(start[n], start[n + 1]):
            for b in range(q):
                size += rows * (number_nq[column[k], b] >= 0)
    data, index = np.empty(size), np.empty(size, np.int32)
    first = [0]
    place = 0
    for n in range(count):
        for a in range(q):
            if number_nq[n, a] < 0:
                continue
            for k in range(start[n], start[n + 1]):
                other = column[k]
                for b in range(q):
                    if number_nq[other, b] >= 0:
                        data[place] = blocks[order[k], a, b]
                        if other == n and a == b:
                            data[place] += extra_f[n * q + a]
                        index[place] = number_nq[other, b]
                        place += 1
            first.append(place)
    return data, index, np.array(first, dtype=np.int32)


@dataclass(frozen=True, eq=False)
class ShapeSums:
    """Second derivatives of a sum of energies of contacts between shapes, in blocks of q coordinates a particle.

    Attributes
    ----------
    pair_i, pair_j, pair_pqq
        (P,) pairs of particles i < j that interact, and the blocks (i, j) of the Hessian.
    diagonal_nqq, coupling_nqe, strain_ee
        Blocks on the diagonal, mixed derivatives with the strains, and those of the strains alone.

    """

    pair_i: NDArray[np.int64]
    pair_j: NDArray[np.int64]
    pair_pqq: NDArray[np.float64]
    diagonal_nqq: NDArray[np.float64]
    coupling_nqe: NDArray[np.float64]
    strain_ee: NDArray[np.float64]

    def matrix(self, free_f: NDArray[np.bool_], extra_f: NDArray[np.float64] | None = None) -> sp.csr_array:
        """Return the derivatives by the free ones of the (N q,) coordinates, with something added on the diagonal."""
        count, q = self.diagonal_nqq.shape[:2]
        row = np.concatenate([self.pair_i, self.pair_j, np.arange(count)])
        column = np.concatenate([self.pair_j, self.pair_i, np.arange(count)])
        blocks = np.concatenate([self.pair_pqq, self.pair_pqq.transpose(0, 2, 1), self.diagonal_nqq])
        order = np.argsort(row * max(count, 1) + column, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
        extra = np.zeros(count * q) if extra_f is None else extra_f
        number = np.where(free_f, np.cumsum(free_f) - 1, -1)
        data, index, first = _compressed(start, column[order], order, blocks, number.reshape(count, q), extra)
        size = int(free_f.sum())
        found = sp.csr_array((data, index, first), shape=(size, size))
        found.has_sorted_indices = True
        return found

    def coupling(self, free_f: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the (F, s) mixed derivatives of the free coordinates."""
        return self.coupling_nqe.reshape(len(free_f), len(self.strain_ee))[free_f]


def shape_sums(
    contacts: ShapeContacts,
    turn_nkt: NDArray[np.float64],
    first_c: NDArray[np.float64],
    second_c: NDArray[np.float64],
    basis_edd: NDArray[np.float64] | None = None,
) -> ShapeSums:
    """Return the second derivatives of a sum of energies with the given derivatives by the distances.

    Parameters
    ----------
    contacts
        The contacts, with curvatures.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns.
    first_c, second_c
        (C,) du/drho and d2u/drho2.
    basis_edd
        (s, d, d) strains, any displacement gradients; Mandel's unless given.

    """
    basis = mandel_basis(contacts.dimension) if basis_edd is None else np.ascontiguousarray(basis_edd)
    pair_i, pair_j, pair_c = distinct_pairs(contacts.i_c, contacts.j_c)
    n, q = contacts.particles, contacts.dimension + turn_nkt.shape[1]
    pair, diagonal = np.zeros((len(pair_i), q, q)), np.zeros((n, q, q))
    coupling, strain = np.zeros((n, q, len(basis))), np.zeros((len(basis), len(basis)))
    _gather(
        contacts.i_c, contacts.j_c, pair_c, contacts.vector_cd, contacts.slope_cx, contacts.curvature_cxx,
        first_c, second_c, turn_nkt, basis, pair, diagonal, coupling, strain,
    )  # fmt: skip
    return ShapeSums(pair_i, pair_j, pair, diagonal, coupling, strain)


def slope_rows(contacts: ShapeContacts, turn_nkt: NDArray[np.float64], free_f: NDArray[np.bool_]) -> sp.csr_array:
    """Return the (C, F) slopes of the distances along the free ones of the (N q,) coordinates."""
    q, count = contacts.dimension + turn_nkt.shape[1], len(contacts)
    ends = slopes_of_ends(contacts, turn_nkt)
    column = np.concatenate([contacts.i_c, contacts.j_c])[:, None] * q + np.arange(q)
    row = np.repeat(np.tile(np.arange(count), 2), q)
    whole = sp.coo_array((ends.ravel(), (row, column.ravel())), shape=(count, contacts.particles * q)).tocsr()
    return sp.csr_array(whole[:, np.flatnonzero(free_f)])


def shape_strain_columns(contacts: ShapeContacts) -> NDArray[np.float64]:
    """Return the (C, s) derivatives of the distances with respect to the Mandel strains, which turn nobody [length]."""
    d = contacts.dimension
    return np.asarray(np.einsum("mab,ca,cb->cm", mandel_basis(d), contacts.slope_cx[:, :d], contacts.vector_cd))


def turning(turn_nkt: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (N, K) which coordinates of turns there are: none of discs and spheres."""
    return np.asarray((turn_nkt != 0.0).any(axis=2))
