"""The compliance of a packing while pairs of particles are held at their distance, one after another."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from packmech.contacts import Contacts, find_contacts
from packmech.linalg.mandel import mandel_basis
from packmech.mechanics.hessian import bordered, closed_terms
from packmech.mechanics.network import held_network
from packmech.mechanics.pair_stiffness import bond_sums, prestressed
from packmech.scene import Scene

FREEZE = ("angles", "clusters", "nothing")


class HeldPair(NamedTuple):
    """Two particles at the image and the vector from one to the other; `shape` marks all but the contact itself."""

    i: int
    j: int
    image: tuple[int, ...]
    vector: NDArray[np.float64]
    shape: bool


def canonical(pair: HeldPair) -> tuple[int, int, tuple[int, ...]]:
    """Return the particles and the image of a pair as `Links` names it."""
    back = tuple(-z for z in pair.image)
    if pair.i > pair.j or (pair.i == pair.j and pair.image < back):
        return pair.j, pair.i, back
    return pair.i, pair.j, pair.image


class Cement:
    """Contacts cemented one after another, and the new pairs that each of them holds at a fixed distance.

    With "angles", any two particles cemented to the same third keep their distance: bond angles are frozen, turns about
    a bond stay free. With "clusters", all particles that are cemented together, directly or not, move as one body.
    With "nothing", the contact alone keeps its length.
    """

    def __init__(self, contacts: Contacts, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64]) -> None:
        self._contacts = contacts
        self._place = position_nd
        self._lattice = lattice_dd
        self._seen: set[tuple[int, int, tuple[int, ...]]] = set()
        self._around: dict[int, list[tuple[int, NDArray[np.int64], NDArray[np.float64]]]] = {}
        # clusters: number of each particle's, its members, and the images that unwrap them
        self._cluster = np.arange(contacts.particles)
        self._members = [[n] for n in range(contacts.particles)]
        self._offset = np.zeros((contacts.particles, contacts.dimension), dtype=np.int64)

    def add(self, contact: int, freeze: str) -> list[HeldPair]:
        """Return the pairs that are held once this contact is cemented and that were not named before."""
        c = self._contacts
        i, j = int(c.i_c[contact]), int(c.j_c[contact])
        image, vector = c.image_cd[contact], c.vector_cd[contact]
        pairs = [HeldPair(i, j, tuple(image.tolist()), vector, False)]
        if freeze == "angles":
            pairs += self._angles(i, j, image, vector)
        elif freeze == "clusters":
            pairs += self._bodies(i, j, image)
        new = []
        for pair in pairs:
            key = canonical(pair)
            if key not in self._seen and (pair.i != pair.j or any(pair.image)):
                self._seen.add(key)
                new.append(pair)
        return new

    def _angles(self, i: int, j: int, image: NDArray[np.int64], vector: NDArray[np.float64]) -> Iterator[HeldPair]:
        for k, its_image, its_vector in self._around.get(i, []):
            yield HeldPair(k, j, tuple((image - its_image).tolist()), vector - its_vector, True)
        for k, its_image, its_vector in self._around.get(j, []):
            yield HeldPair(i, k, tuple((image + its_image).tolist()), vector + its_vector, True)
        self._around.setdefault(i, []).append((j, image, vector))
        self._around.setdefault(j, []).append((i, -image, -vector))

    def _unwrapped(self, member: list[int]) -> NDArray[np.float64]:
        place: NDArray[np.float64] = self._place[member] + self._offset[member] @ self._lattice.T
        return place

    def _frame(self, n: int) -> list[int]:
        """Return up to three members of a particle's cluster, itself first, that span the widest triangle with it."""
        member = self._members[self._cluster[n]]
        if len(member) <= 3:
            return member
        arm = self._unwrapped(member) - self._unwrapped([n])
        far = int((arm**2).sum(axis=1).argmax())
        along = arm[far] / np.sqrt(arm[far] @ arm[far])
        aside = arm - np.outer(arm @ along, along)
        return [n, member[far], member[int((aside**2).sum(axis=1).argmax())]]

    def _bodies(self, i: int, j: int, image: NDArray[np.int64]) -> list[HeldPair]:
        # the image of j's cluster that touches i's, once both are unwrapped
        apart = image + self._offset[i] - self._offset[j]
        one, other = int(self._cluster[i]), int(self._cluster[j])
        if one == other and not apart.any():
            return []
        pairs = []
        for a in self._frame(i):
            for b in self._frame(j):
                reach = apart - self._offset[a] + self._offset[b]
                vector = self._place[b] - self._place[a] + self._lattice @ reach
                pairs.append(HeldPair(a, b, tuple(reach.tolist()), vector, True))
        if one != other:
            if len(self._members[one]) < len(self._members[other]):
                one, other, apart = other, one, -apart
            moved = self._members[other]
            self._offset[moved] += apart
            self._cluster[moved] = one
            self._members[one] = self._members[one] + moved
            self._members[other] = []
        return pairs


# part of a row across those before it, below which it depends on them. New rows have 1e-7 and more, most 1e-3;
# redundant ones 1e-12 until a row of small part p has come, 1e-16/p from then on
DEPENDENT = 1e-8
# strains that stresses make, over those before cementing (both in the metric of the Hessian), below which none is left
STIFF = 1e-7
_SOFT = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class Backbone:
    """The backbone of a packing with its Hessian factored and inverted, to be cemented many times.

    Attributes
    ----------
    contacts
        Contacts among all particles of the packing, those of rattlers left out.
    place_c
        For every contact of the packing its place among these, -1 for those of rattlers.
    bearing
        Number of particles that bear force.
    inverse_xm
        (N d + s, M) transposed inverse of the Hessian's Cholesky factor; zero rows for what does not move.
    length, volume
        Scale of the strains, and volume of the box.

    """

    scene: Scene
    contacts: Contacts
    place_c: NDArray[np.int64]
    bearing: int
    inverse_xm: NDArray[np.float64]
    length: float
    volume: float

    @property
    def strain_em(self) -> NDArray[np.float64]:
        """(s, M) strains in the metric of the Hessian."""
        d = self.contacts.dimension
        columns: NDArray[np.float64] = self.inverse_xm[-(d * (d + 1) // 2) :] / self.length
        return columns

    def rows(self, pairs: list[HeldPair]) -> NDArray[np.float64]:
        """Return the (B, M) gradients of the pairs' distances in the metric of the Hessian, of length 1."""
        d, inverse = self.contacts.dimension, self.inverse_xm
        i, j = (d * np.array([pair[k] for pair in pairs], dtype=np.int64) for k in (0, 1))
        vector = np.array([pair.vector for pair in pairs])
        distance = np.sqrt((vector**2).sum(axis=1))
        normal = vector / distance[:, None]
        rows = np.zeros((len(pairs), inverse.shape[1]))
        for a in range(d):
            rows += normal[:, a, None] * (inverse[j + a] - inverse[i + a])
        for strain, columns in zip(mandel_basis(d), inverse[self.scene.packing.particles * d :], strict=True):
            stretch = distance * ((normal @ strain) * normal).sum(axis=1) / self.length
            rows += stretch[:, None] * columns
        rows /= np.sqrt((rows**2).sum(axis=1))[:, None]
        return rows


def backbone_of(scene: Scene, kind: str, gap_tolerance: float) -> Backbone:
    """Return the factored backbone of a packing.

    Raises
    ------
    ValueError
        If no contacts bear force, or some motion or strain costs nothing or lowers the energy.

    """
    packing = scene.packing
    held = held_network(packing, gap_tolerance=gap_tolerance)
    contacts, d = held.contacts, packing.dimension
    if not len(contacts):
        raise ValueError("scene.packing must be jammed, got one whose particles all rattle")
    sums = bond_sums(*prestressed(contacts, closed_terms(scene, contacts), kind, None))
    free = np.ones(contacts.particles, dtype=bool)
    free[np.argmax(contacts.count_n())] = False
    volume = packing.box.volume
    length = float(volume ** (1.0 / d))
    strains = d * (d + 1) // 2
    whole = bordered(sums.position_matrix(free), sums.coupling_nde[free].reshape(-1, strains), sums.strain_ee).toarray()
    whole[-strains:] /= length
    whole[:, -strains:] /= length
    try:
        factor = sl.cholesky(whole, lower=True, overwrite_a=False, check_finite=False)
    except sl.LinAlgError:
        factor = None
    if factor is None or (np.diag(factor) ** 2).min() <= _SOFT * np.diag(whole).max():
        raise ValueError(
            "scene.packing must resist every motion and strain (shear-stabilized: jam with strain='free'), got one "
            "with a direction that costs nothing or lowers the energy"
        )
    inverse = sl.solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False, overwrite_b=True)
    spread = np.zeros((packing.particles * d + strains, len(factor)))
    moving = (held.index_n[free][:, None] * d + np.arange(d)).ravel()
    spread[moving] = inverse.T[:-strains]
    spread[-strains:] = inverse.T[-strains:]
    found = find_contacts(packing, gap_tolerance=gap_tolerance)
    bears = np.zeros(packing.particles, dtype=bool)
    bears[held.index_n] = True
    kept = bears[found.i_c] & bears[found.j_c]
    place = np.where(kept, np.cumsum(kept) - 1, -1)
    return Backbone(scene, found.select(kept), place, len(held.index_n), spread, length, volume)


class HeldCompliance:
    """The compliance of a backbone, updated as pairs are held."""

    def __init__(self, backbone: Backbone) -> None:
        self._backbone = backbone
        self._basis = np.empty((backbone.inverse_xm.shape[1], backbone.inverse_xm.shape[1]))
        self._strain = backbone.strain_em
        self._scale = float(np.sqrt((self._strain**2).sum(axis=1).max()))
        self.rank = 0
        # parts of rows across those before: the least that counted, and the largest that did not
        self.least_new, self.largest_old = 1.0, 0.0

    def saved(self) -> tuple[int, NDArray[np.float64], float, float]:
        """Return what `restore` needs to come back here."""
        return self.rank, self._strain, self.least_new, self.largest_old

    def restore(self, state: tuple[int, NDArray[np.float64], float, float]) -> None:
        """Take back what was held since."""
        self.rank, self._strain, self.least_new, self.largest_old = state

    def hold(self, pairs: list[HeldPair]) -> list[int]:
        """Hold the pairs; return which of them are independent of each other and of those before, in order."""
        room = len(self._basis) - self.rank
        if not pairs or not room:
            return []
        rows = self._backbone.rows(pairs)
        basis = self._basis[: self.rank]
        for _ in range(2):
            rows -= (rows @ basis.T) @ basis
        q, triangle, order = sl.qr(rows.T, mode="economic", pivoting=True, check_finite=False)
        part = np.abs(np.diag(triangle))
        count = min(int(np.count_nonzero(part > DEPENDENT)), room)
        if count < len(part):
            self.largest_old = max(self.largest_old, float(part[count]))
        if not count:
            return []
        self.least_new = min(self.least_new, float(part[count - 1]))
        # parts that are small lose their right angle to the basis in proportion
        new = q[:, :count].T
        new = new - (new @ basis.T) @ basis
        new = sl.qr(new.T, mode="economic", check_finite=False)[0].T
        self._basis[self.rank : self.rank + count] = new
        self.rank += count
        self._strain = self._strain - (self._strain @ new.T) @ new
        return sorted(int(k) for k in order[:count])

    def stiff_directions(self) -> NDArray[np.float64]:
        """Return the (k, s) orthonormal strains that the held pairs forbid."""
        direction, size, _ = np.linalg.svd(self._strain, full_matrices=False)
        stiff: NDArray[np.float64] = direction.T[size <= STIFF * self._scale]
        return stiff

    def compliance(self) -> NDArray[np.float64]:
        """Return the (s, s) compliance [length^d/energy] in Mandel components, zero along the stiff directions."""
        stiff = self.stiff_directions()
        across = np.eye(len(self._strain)) - stiff.T @ stiff
        strain = across @ self._strain
        if len(stiff) == len(strain):
            strain = np.zeros_like(strain)
        product: NDArray[np.float64] = self._backbone.volume * (strain @ strain.T)
        return product
