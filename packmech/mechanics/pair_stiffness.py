"""Second derivatives of pair energies, gathered by pairs of particles (the bond tensors).

For a pair at distance rho along n with radial derivatives u' and u''; positions x and strains E enter as
v -> (1 + strain)(x_j - x_i + lattice image):

    positions           h = u'' n n + (u' / rho)(1 - n n)             +h at (i,i) and (j,j), -h at (i,j) and (j,i)
    position, strain    (u'' rho - u') n (n.E.n) + 2 u' E n           + at j, - at i
    strain, strain      rho (rho u'' - u')(n.E.n)(n.F.n) + rho u' (E n).(F n)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.network import distinct_pairs
from packmech.effects import ContactTerms
from packmech.jit.compiled import kernel
from packmech.linalg.mandel import mandel_basis


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
    pair_i, pair_j, pair_c = distinct_pairs(contacts.i_c, contacts.j_c)
    pair = np.zeros((len(pair_i), dimension, dimension))
    diagonal = np.zeros((particles, dimension, dimension))
    coupling = np.zeros((particles, dimension, len(basis)))
    strain = np.zeros((len(basis), len(basis)))
    _gather(
        contacts.i_c, contacts.j_c, pair_c, contacts.normal_cd, contacts.distance_c, first_c, second_c, basis,
        pair, diagonal, coupling, strain,
    )  # fmt: skip
    return BondSums(pair_i, pair_j, pair, diagonal, coupling, strain)


class Prestressed(NamedTuple):
    """Pairs with radial derivatives of their energies: contacts, and links as bonds with a force and no stiffness."""

    pairs: Contacts
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]


def prestressed(
    contacts: Contacts,
    terms: ContactTerms,
    kind: str,
    links: ConstraintFactor | None,
    tension_l: NDArray[np.float64] | None = None,
) -> Prestressed:
    """Return the pairs whose second derivatives make up the Hessian of the named kind.

    "exact" adds each link as a bond with u' = its tension (found here unless given) and u'' = 0; "paper" and
    "unstressed" have contacts only.
    """
    first = np.zeros_like(terms.first_c) if kind == "unstressed" else terms.first_c
    if links is None or kind != "exact":
        return Prestressed(contacts, first, terms.second_c)
    tension = links.tension(contacts, terms.first_c) if tension_l is None else tension_l
    pairs, order = joined(contacts, links.pairs)
    first = np.concatenate([first, tension])[order]
    return Prestressed(pairs, first, np.concatenate([terms.second_c, np.zeros(len(tension))])[order])


@kernel
def _merged(i_c, j_c, image_cd, count):  # type: ignore[no-untyped-def]
    """Return the order that merges the first `count` pairs and the others, each sorted by (i, j, image) already."""
    order = np.empty(i_c.shape[0], np.int64)
    a, b = 0, count
    for k in range(i_c.shape[0]):
        first = a < count
        if first and b < i_c.shape[0]:
            step = i_c[a] - i_c[b]
            if step == 0:
                step = j_c[a] - j_c[b]
            for m in range(image_cd.shape[1]):
                if step == 0:
                    step = image_cd[a, m] - image_cd[b, m]
            first = step <= 0
        if first:
            order[k] = a
            a += 1
        else:
            order[k] = b
            b += 1
    return order


@kernel
def _picked(order, i_c, j_c, image_cd, normal_cd, distance_c, touching_c):  # type: ignore[no-untyped-def]
    """Return the arrays in this order."""
    count, d = image_cd.shape
    i, j, image = np.empty_like(i_c), np.empty_like(j_c), np.empty((count, d), np.int64)
    normal, distance, touching = np.empty((count, d)), np.empty(count), np.empty(count)
    for k in range(count):
        c = order[k]
        i[k], j[k], distance[k], touching[k] = i_c[c], j_c[c], distance_c[c], touching_c[c]
        for a in range(d):
            image[k, a], normal[k, a] = image_cd[c, a], normal_cd[c, a]
    return i, j, image, normal, distance, touching


def joined(one: Contacts, other: Contacts) -> tuple[Contacts, NDArray[np.int64]]:
    """Return the pairs of both, sorted by (i, j, image), and where each of them came from."""
    i, j = np.concatenate([one.i_c, other.i_c]), np.concatenate([one.j_c, other.j_c])
    image = np.concatenate([one.image_cd, other.image_cd])
    order = _merged(i, j, image, len(one))
    normal = np.concatenate([one.normal_cd, other.normal_cd])
    distance = np.concatenate([one.distance_c, other.distance_c])
    touching = np.concatenate([one.contact_distance_c, other.contact_distance_c])
    i, j, image, normal, distance, touching = _picked(order, i, j, image, normal, distance, touching)
    return Contacts(i, j, image, normal, distance, touching, one.particles, one.dimension), order
