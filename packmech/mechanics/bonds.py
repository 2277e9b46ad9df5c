"""Second derivatives of pair energies, gathered by pairs of particles (the bond tensors).

For a pair at distance rho along n with radial derivatives u' and u''; positions x and strains E enter as
v -> (1 + strain)(x_j - x_i + lattice image):

    positions           h = u'' n n + (u' / rho)(1 - n n)             +h at (i,i) and (j,j), -h at (i,j) and (j,i)
    position, strain    (u'' rho - u') n (n.E.n) + 2 u' E n           + at j, - at i
    strain, strain      rho (rho u'' - u')(n.E.n)(n.F.n) + rho u' (E n).(F n)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.compiled import kernel
from packmech.contacts import Contacts
from packmech.mechanics.strain import mandel_basis


@kernel
def _gather(i_c, j_c, pair_c, normal, distance, first, second, basis, pair, diagonal, coupling, strain):  # type: ignore[no-untyped-def]
    count, d = normal.shape
    s = basis.shape[0]
    block = np.empty((d, d))
    stretch = np.empty(s)
    tilt = np.empty((s, d))
    for c in range(count):
        n = normal[c]
        r = distance[c]
        u1 = first[c]
        u2 = second[c]
        across = u1 / r if u1 != 0.0 else 0.0
        for a in range(d):
            for b in range(d):
                block[a, b] = (u2 - across) * (n[a] * n[b])
            block[a, a] += across
        for m in range(s):
            stretch[m] = 0.0
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += basis[m, a, b] * n[b]
                tilt[m, a] = total
                stretch[m] += n[a] * total
        for m in range(s):
            for k in range(m, s):
                product = 0.0
                for a in range(d):
                    product += tilt[m, a] * tilt[k, a]
                strain[m, k] += r * (r * u2 - u1) * stretch[m] * stretch[k] + r * u1 * product
        i = i_c[c]
        j = j_c[c]
        if i == j:
            continue
        q = pair_c[c]
        for a in range(d):
            for b in range(d):
                pair[q, a, b] += block[a, b]
                diagonal[i, a, b] += block[a, b]
                diagonal[j, a, b] += block[a, b]
            for m in range(s):
                g = (u2 * r - u1) * n[a] * stretch[m] + 2.0 * u1 * tilt[m, a]
                coupling[j, a, m] += g
                coupling[i, a, m] -= g
    for m in range(s):
        for k in range(m):
            strain[m, k] = strain[k, m]


@kernel
def _pairs(i_c, j_c):  # type: ignore[no-untyped-def]
    """Return the pairs of particles, each once, and the number of each contact's pair; images stand together."""
    pair_i, pair_j, pair_c = np.empty_like(i_c), np.empty_like(j_c), np.empty_like(i_c)
    used = 0
    for c in range(i_c.shape[0]):
        if i_c[c] != j_c[c] and (used == 0 or i_c[c] != pair_i[used - 1] or j_c[c] != pair_j[used - 1]):
            pair_i[used], pair_j[used] = i_c[c], j_c[c]
            used += 1
        pair_c[c] = used - 1
    return pair_i[:used], pair_j[:used], pair_c


@dataclass(frozen=True, eq=False)
class BondSums:
    """Second derivatives of a sum of pair energies, in blocks.

    Attributes
    ----------
    pair_i, pair_j
        (P,) pairs of particles i < j that interact, each once, whatever the number of images.
    pair_pdd
        (P, d, d) sums of h over the images of each pair; the Hessian's block (i, j) is minus this [energy/length^2].
    diagonal_ndd
        (N, d, d) blocks on the diagonal [energy/length^2].
    coupling_nde
        (N, d, s) mixed derivatives with respect to position and Mandel strain [energy/length].
    strain_ee
        (s, s) derivatives with respect to the strains [energy].

    """

    pair_i: NDArray[np.int64]
    pair_j: NDArray[np.int64]
    pair_pdd: NDArray[np.float64]
    diagonal_ndd: NDArray[np.float64]
    coupling_nde: NDArray[np.float64]
    strain_ee: NDArray[np.float64]

    @property
    def coupling_xe(self) -> NDArray[np.float64]:
        """The (N d, s) mixed derivatives, rows particle-major."""
        return self.coupling_nde.reshape(-1, self.strain_ee.shape[0])

    def position_matrix(self, keep_n: NDArray[np.bool_] | None = None) -> sp.csr_array:
        """Return the (N d, N d) derivatives with respect to positions, or only those of the particles to keep."""
        pair_i, pair_j, blocks, diagonal = self.pair_i, self.pair_j, self.pair_pdd, self.diagonal_ndd
        if keep_n is not None:
            number = np.cumsum(keep_n) - 1
            inside = keep_n[pair_i] & keep_n[pair_j]
            pair_i, pair_j, blocks = number[pair_i[inside]], number[pair_j[inside]], blocks[inside]
            diagonal = diagonal[keep_n]
        count, dimension = diagonal.shape[:2]
        row = np.concatenate([pair_i, pair_j, np.arange(count)])
        column = np.concatenate([pair_j, pair_i, np.arange(count)])
        order = np.argsort(row * max(count, 1) + column, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
        value = np.concatenate([-blocks, -blocks, diagonal])[order]
        size = count * dimension
        if not count:
            return sp.csr_array((0, 0))
        matrix = sp.bsr_array((value, column[order], start), shape=(size, size)).tocsr()
        matrix.has_sorted_indices = True
        return matrix


def bond_sums(contacts: Contacts, first_c: NDArray[np.float64], second_c: NDArray[np.float64]) -> BondSums:
    """Return the second derivatives of a sum of pair energies with the given radial derivatives.

    Parameters
    ----------
    contacts
        The pairs.
    first_c, second_c
        (C,) du/dr [force] and d2u/dr2 [force/length].

    Raises
    ------
    ValueError
        If a pair with a force has coincident centers: its energy has no second derivative there.

    """
    stuck = (contacts.distance_c == 0.0) & (first_c != 0.0)
    if stuck.any():
        c = int(np.flatnonzero(stuck)[0])
        raise ValueError(
            "packing must have no coincident centers where second derivatives are asked for, "
            f"got particles {contacts.i_c[c]} and {contacts.j_c[c]} at one place"
        )
    dimension, particles = contacts.dimension, contacts.particles
    basis = mandel_basis(dimension)
    # contacts are sorted by (i, j, image)
    pair_i, pair_j, pair_c = _pairs(contacts.i_c, contacts.j_c)
    pair = np.zeros((len(pair_i), dimension, dimension))
    diagonal = np.zeros((particles, dimension, dimension))
    coupling = np.zeros((particles, dimension, len(basis)))
    strain = np.zeros((len(basis), len(basis)))
    _gather(
        contacts.i_c, contacts.j_c, pair_c, contacts.normal_cd, contacts.distance_c, first_c, second_c, basis,
        pair, diagonal, coupling, strain,
    )  # fmt: skip
    return BondSums(pair_i, pair_j, pair, diagonal, coupling, strain)
