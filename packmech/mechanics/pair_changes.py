"""What pulls and stiffnesses of single pairs become as their coordinates, sizes, shapes or laws change.

Each contact, bond and link is taken out of its packing and put into a packing of its own: particle c of C pairs stands
at the origin and particle C + c at the pair's vector. So every pair can be changed by itself, all of them at once, and
the geometry and the laws are those of the calls that made the elements in the first place.

Derivatives are central differences of eighth order over steps of a few hundredths of a contact's overlap, within which
laws are smooth: they err by 1e-11 of themselves and by rounding, 1e-16 over the relative overlap times thirty.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.elements import Elements, elements_of
from packmech.contacts.network import Candidates, Contacts, pair_contacts
from packmech.contacts.shape_contacts import ShapeContacts, shape_contacts
from packmech.contacts.tangential_elements import tangential_elements
from packmech.effects import (
    Bonds,
    LinearSpring,
    at_contact,
    bonded_pairs,
    contact_terms,
    friction_or_zero,
)
from packmech.mechanics.network import Network
from packmech.packing import Packing
from packmech.scene import Scene

# weights of central differences of eighth order at 1, 2, 3 and 4 steps, and of sixth order at the first three
_EIGHTH = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
_SIXTH = (3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0, 0.0)
# smaller steps, where differences of both orders differ by more than this part of the largest
_FINER, _RESOLVED = (0.2, 0.04, 0.008, 0.0016), 1e-8
# step over the distance to where a law begins, and over the length where it begins nowhere
_PART, _SMOOTH = 0.03, 0.01
# relative overlaps below which a contact only just touches: its law begins there
TOUCHING = 1e-9


def difference(at: Callable[[float], NDArray[np.float64]]) -> tuple[NDArray[np.float64], float]:
    """Return the derivative of an array by a number at zero, per step, and a bound on its error over its largest entry.

    The bound is the difference to the formula of sixth order at the same places, which errs by far more.

    Examples
    --------
    >>> found, error = difference(lambda t: np.exp([0.03 * t]))
    >>> float(round(found[0] / 0.03, 12)), error < 1e-9
    (1.0, True)

    """
    found, apart = _at_scale(at, 1.0)
    largest = float(np.abs(found).max(initial=0.0))
    for scale in _FINER:
        # geometry may change faster than laws do, as near the flat faces of superellipsoids
        if float(apart.max(initial=0.0)) <= _RESOLVED * largest:
            break
        finer, left = _at_scale(at, scale)
        found, apart = np.where(left < apart, finer, found), np.minimum(left, apart)
        largest = float(np.abs(found).max(initial=0.0))
    return found, float(apart.max(initial=0.0)) / largest if largest else 0.0


def _at_scale(at: Callable[[float], NDArray[np.float64]], scale: float) -> tuple[NDArray[np.float64], Any]:
    """Return central differences of eighth order, and by how much those of sixth order differ."""
    slopes = [(at(k * scale) - at(-k * scale), _EIGHTH[k - 1], _SIXTH[k - 1]) for k in (1, 2, 3, 4)]
    found = np.asarray(sum(change * weight for change, weight, _ in slopes)) / scale
    return found, np.abs(found - np.asarray(sum(change * weight for change, _, weight in slopes)) / scale)


def _apart(vector_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places of both particles of each pair."""
    return np.concatenate([np.zeros_like(vector_cd), vector_cd])


@dataclass(frozen=True, eq=False)
class Change:
    """A change of all pairs at once, by one step; zeros where nothing is said.

    Attributes
    ----------
    move_cx
        (C, X) changes of the pairs' coordinates: vectors, then rotations of i and of j.
    radius_c2
        (C, 2) changes of the radii of i and j [length].
    shape_c2
        (C, 2) changes of the named array of the shapes of i and j.
    rest_c
        (C,) changes of rest lengths of bonds [length].
    effects
        The effects after so many steps; the scene's own unless given.

    """

    move_cx: NDArray[np.float64] | None = None
    radius_c2: NDArray[np.float64] | None = None
    shape: str = ""
    shape_c2: NDArray[np.float64] | None = None
    rest_c: NDArray[np.float64] | None = None
    effects: Callable[[float], tuple[Any, ...]] | None = None


class ContactPairs:
    """The contacts of a network, each in a packing of its own.

    Parameters
    ----------
    scene, network
        The scene, and the contacts that take part.
    own
        Their elements at rest.
    smooth
        Whether what is asked for does not end where particles part, as distances do not.
    tangential_cd
        (C, d) tangential forces on particle i of contacts that stick [force]; None without friction.

    """

    def __init__(
        self,
        scene: Scene,
        network: Network,
        own: Elements,
        *,
        smooth: bool = False,
        tangential_cd: NDArray[np.float64] | None = None,
    ) -> None:
        self._smooth, self._tangential = smooth, tangential_cd
        self.scene, self.own, self.contacts = scene, own, network.contacts
        self.i_c, self.j_c = own.i_c, own.j_c
        packing = network.packing
        ends = np.concatenate([self.i_c, self.j_c])
        kinds = packing.kind_n
        self._box, self._radius = packing.box, packing.radius_n[ends]
        self._kinds = None if kinds is None else kinds[ends]
        self._shapes: Any = packing.shapes.select(ends)
        self._site_c2 = np.stack([np.arange(len(self.i_c)), np.arange(len(self.i_c)) + len(self.i_c)], axis=1)
        if isinstance(self.contacts, ShapeContacts) and self.contacts.bead_c2 is not None:
            self._site_c2 = self._shapes.start_n[self._site_c2] + self.contacts.bead_c2

    @functools.cached_property
    def step_c(self) -> NDArray[np.float64]:
        """The (C,) steps of lengths: a small part of the overlap [length]."""
        if self._smooth:
            return np.asarray(_SMOOTH * self.contacts.contact_distance_c)
        return np.asarray(-_PART * self.contacts.gap_c)

    def geometry(self, change: Change, steps: float) -> Contacts | ShapeContacts:
        """Return the contacts after so many steps."""
        d, count = self.own.vector_cd.shape[1], len(self.i_c)
        vector, radius, shapes = self.own.vector_cd, self._radius, self._shapes
        if change.move_cx is not None:
            vector = vector + steps * change.move_cx[:, :d]
            turn = steps * change.move_cx[:, d:]
            if turn.any():
                shapes = shapes.turned(np.concatenate(np.split(turn, 2, axis=1)))
        if change.radius_c2 is not None:
            radius = radius + steps * change.radius_c2.T.ravel()
        if change.shape_c2 is not None:
            shapes = replace(
                shapes, **{change.shape: getattr(shapes, change.shape) + steps * change.shape_c2.T.ravel()}
            )
        packing = Packing(_apart(vector), radius, self._box, shapes=shapes, kind_n=self._kinds)
        pairs = Candidates(self._site_c2[:, 0], self._site_c2[:, 1], np.zeros((count, d), dtype=np.int64))
        if isinstance(self.contacts, ShapeContacts):
            return shape_contacts(packing, pairs, second=True)
        return pair_contacts(packing, *pairs)

    def at(self, change: Change, steps: float) -> Elements:
        """Return the elements after so many steps."""
        contacts = self.geometry(change, steps)
        effects = self.scene.effects if change.effects is None else change.effects(steps)
        terms = contact_terms(effects, contacts)
        if self._tangential is None:
            return elements_of(contacts, terms.first_c, terms.second_c)
        friction = at_contact(
            friction_or_zero(effects), terms.second_c * contacts.push_c**2, 0.0, contacts.kinds_c
        )  # fmt: skip
        radius = self._radius if change.radius_c2 is None else self._radius + steps * change.radius_c2.T.ravel()
        force = self._tangential
        if change.move_cx is not None:
            force = force + steps * self._tangential_change(change.move_cx)
        return tangential_elements(contacts, radius, terms.first_c, terms.second_c, force, friction.stiffness)[0]

    def _tangential_change(self, move_cx: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d) change of tangential forces with a motion: that of the pulls, less the normal forces'."""
        d = self.own.vector_cd.shape[1]
        terms = contact_terms(self.scene.effects, self.contacts)
        normal = elements_of(self.contacts, terms.first_c, terms.second_c).stiffness_cxx[:, :d]
        whole = np.einsum("cax,cx->ca", self.own.stiffness_cxx[:, :d], move_cx)
        return np.asarray(whole - np.einsum("cax,cx->ca", normal, move_cx[:, : normal.shape[2]]))

    def energies(self, change: Change, steps: float) -> NDArray[np.float64]:
        """Return the (C,) energies after so many steps [energy]."""
        effects = self.scene.effects if change.effects is None else change.effects(steps)
        return contact_terms(effects, self.geometry(change, steps)).energy_c


class BondPairs:
    """The bonds of a network, each in a packing of its own; `index_b` are their numbers among all bonds."""

    def __init__(self, bonds: Bonds, network: Network, own: Elements) -> None:
        self.bonds, self.own = bonds, own
        self.i_c, self.j_c = own.i_c, own.j_c
        number = np.full(network.parent.particles, -1)
        number[network.index_n] = np.arange(len(network.index_n))
        self.index_b = np.flatnonzero((number[bonds.i_b] >= 0) & (number[bonds.j_b] >= 0))
        packing = network.packing
        ends = np.concatenate([self.i_c, self.j_c])
        self._box, self._radius, self._shapes = packing.box, packing.radius_n[ends], packing.shapes.select(ends)
        self._rest = bonds.rest_length_b[self.index_b]

    @functools.cached_property
    def step_c(self) -> NDArray[np.float64]:
        """The (B,) steps of lengths: hundredths of a length, or of the stretch where laws differ on both sides of it.

        Raises
        ------
        ValueError
            If a bond is slack where its stiffness jumps.

        """
        bonds, rest = self.bonds, self._rest
        if type(bonds.compression) is LinearSpring and bonds.compression == bonds.tension:
            return np.asarray(_SMOOTH * rest)
        stretch = np.abs(np.sqrt((self.own.vector_cd**2).sum(axis=1)) - rest)
        if (stretch <= TOUCHING * rest).any():
            b = int(self.index_b[np.argmin(stretch / rest)])
            raise ValueError(
                "scene.effects must hold no slack bonds whose laws differ under compression and tension, as nothing "
                f"has a derivative there, got bond {b}"
            )
        return np.asarray(_PART * stretch)

    def _pairs(self, change: Change, steps: float) -> Any:
        d, count = self.own.vector_cd.shape[1], len(self.i_c)
        vector, rest = self.own.vector_cd, self._rest
        if change.move_cx is not None:
            vector = vector + steps * change.move_cx[:, :d]
        if change.rest_c is not None:
            rest = rest + steps * change.rest_c
        bonds = self.bonds if change.effects is None else _bonds_in(change.effects(steps))
        number, none = np.arange(count), np.zeros((count, d), dtype=np.int64)
        one = replace(bonds, i_b=number, j_b=number + count, image_bd=none, rest_length_b=rest)
        packing = Packing(_apart(vector), self._radius, self._box, shapes=self._shapes)
        return bonded_pairs(packing, (one,))

    def at(self, change: Change, steps: float) -> Elements:
        """Return the elements after so many steps."""
        elements: Elements = self._pairs(change, steps).elements()
        return elements

    def energies(self, change: Change, steps: float) -> NDArray[np.float64]:
        """Return the (B,) energies after so many steps [energy]."""
        energy: NDArray[np.float64] = self._pairs(change, steps).energy_c
        return energy


def _bonds_in(effects: tuple[Any, ...]) -> Bonds:
    return next(one for one in effects if isinstance(one, Bonds))


class LinkPairs:
    """The links of a network with their forces, each in a packing of its own."""

    def __init__(self, network: Network, tension_l: NDArray[np.float64], own: Elements) -> None:
        self.own, self.i_c, self.j_c = own, own.i_c, own.j_c
        self.tension_c, self.pairs = tension_l, network.links.pairs
        self.step_c = _SMOOTH * self.pairs.distance_c
        ends = np.concatenate([self.i_c, self.j_c])
        self._box, self._radius = network.packing.box, network.packing.radius_n[ends]

    def at(self, change: Change, steps: float) -> Elements:
        """Return the elements after so many steps, under the same forces."""
        d, count = self.own.vector_cd.shape[1], len(self.i_c)
        vector = self.own.vector_cd
        if change.move_cx is not None:
            vector = vector + steps * change.move_cx[:, :d]
        number, none = np.arange(count), np.zeros((count, d), dtype=np.int64)
        packing = Packing(_apart(vector), self._radius, self._box)
        found = pair_contacts(packing, number, number + count, none)
        return elements_of(found, self.tension_c, np.zeros(count))

    def energies(self, change: Change, steps: float) -> NDArray[np.float64]:
        """Return zeros: links have no energy."""
        return np.zeros(len(self.i_c))


Pairs = ContactPairs | BondPairs | LinkPairs
