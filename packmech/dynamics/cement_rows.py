"""The pairs whose distances cemented contacts hold: the contact itself, bond angles, or whole clusters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts

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
