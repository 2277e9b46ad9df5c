"""Bonds at rest: named pairs with normal springs of any distance, which are no contacts; tangential springs are slack.

A scene starts with its tangential springs of bonds slack (`Bonds`), so that they have no part in energies and forces.
How they stretch depends on the way that particles take and turn: what moves particles without time, or has no
coordinates for the turns of discs and spheres, takes bonds without them.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.contacts.network import pair_contacts
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.effects import Bonds, ContactTerms, law_energy, law_first, law_second
from packmech.jit.compiled import kernel
from packmech.links import Links, named_rows
from packmech.packing import Packing

T = TypeVar("T", bound=Contacts | ShapeContacts)


class BondedPairs(NamedTuple):
    """Bonds as pairs, whose contact distances are their rest lengths, and the derivatives of their energies."""

    pairs: Contacts
    terms: ContactTerms

    def forces(self) -> NDArray[np.float64]:
        """Return the (N, d) net forces of the bonds [force]."""
        one, count = self.pairs, self.pairs.particles
        pull = self.terms.first_c[:, None] * one.normal_cd
        ends = [np.stack([np.bincount(end, part, count) for part in pull.T], axis=1) for end in (one.i_c, one.j_c)]
        return np.asarray(ends[0] - ends[1], dtype=np.float64)

    def virial(self) -> NDArray[np.float64]:
        """Return the (d, d) stress of the bonds times the volume, tension positive [energy]."""
        one = self.pairs
        return np.asarray((self.terms.first_c[:, None] * one.normal_cd).T @ one.vector_cd)


@kernel
def _normal_springs(compression, tension, distance_b, rest_b):  # type: ignore[no-untyped-def]
    """Return energies of bonds and their first and second derivatives by distance."""
    energy, first, second = np.empty_like(distance_b), np.empty_like(distance_b), np.empty_like(distance_b)
    for b in range(distance_b.shape[0]):
        r, rest = distance_b[b], rest_b[b]
        if r < rest:
            energy[b] = law_energy(compression, r, rest)
            first[b] = law_first(compression, r, rest)
            second[b] = law_second(compression, r, rest)
        else:
            energy[b] = law_energy(tension, r, rest)
            first[b] = law_first(tension, r, rest)
            second[b] = law_second(tension, r, rest)
    return energy, first, second


def bonds_of(effects: tuple[Any, ...]) -> Bonds | None:
    """Return the bonds among the effects, if there are any."""
    return next((one for one in effects if isinstance(one, Bonds) and len(one)), None)


def bonded_pairs(effects: tuple[Any, ...], packing: Packing) -> BondedPairs | None:
    """Return the bonds among the effects where a packing has their particles; None without."""
    bonds = bonds_of(effects)
    if bonds is None:
        return None
    pairs = pair_contacts(packing, bonds.i_b, bonds.j_b, bonds.image_bd)
    terms = _normal_springs(bonds.compression, bonds.tension, pairs.distance_c, bonds.rest_length_b)
    return BondedPairs(dataclasses.replace(pairs, contact_distance_c=bonds.rest_length_b), ContactTerms(*terms))


def unbonded(contacts: T, effects: tuple[Any, ...]) -> T:
    """Return the contacts of pairs that no bond joins at the same image."""
    bonds = bonds_of(effects)
    if bonds is None:
        return contacts
    named = (contacts.i_c, contacts.j_c, contacts.image_cd)
    return cast(T, contacts.select(named_rows((bonds.i_b, bonds.j_b, bonds.image_bd), named) < 0))


def joined(contacts: Contacts, terms: ContactTerms, bonded: BondedPairs | None) -> tuple[Contacts, ContactTerms]:
    """Return contacts and bonds of discs or spheres as pairs of one kind, and the derivatives of their energies."""
    if bonded is None:
        return contacts, terms
    names = ("i_c", "j_c", "image_cd", "normal_cd", "distance_c", "contact_distance_c")
    parts: dict[str, Any] = {
        name: np.concatenate([getattr(contacts, name), getattr(bonded.pairs, name)]) for name in names
    }
    both = (np.concatenate(pair) for pair in zip(terms, bonded.terms, strict=True))
    return dataclasses.replace(contacts, **parts), ContactTerms(*both)


def with_bonds_as_links(packing: Packing, effects: tuple[Any, ...]) -> Packing:
    """Return the packing with its bonds as links besides its own: what bonds join goes together, as clusters do."""
    bonds = bonds_of(effects)
    if bonds is None:
        return packing
    length = pair_contacts(packing, bonds.i_b, bonds.j_b, bonds.image_bd).distance_c
    links = Links(bonds.i_b, bonds.j_b, bonds.image_bd, length)
    return packing.replace(links=packing.links.joined(links))


def refuse_tangential_springs(effects: tuple[Any, ...]) -> None:
    """Refuse bonds with tangential springs where only those along bonds have an energy.

    Raises
    ------
    ValueError
        Naming the effect and the way out.

    """
    for k, one in enumerate(effects):
        if isinstance(one, Bonds) and len(one) and one.tangential_stiffness:
            raise ValueError(
                f"scene.effects[{k}] must have tangential_stiffness=0.0 here: tangential springs of bonds have no "
                "energy of positions, since they stretch as particles move and turn on their way, got "
                f"{one.tangential_stiffness:g}; use pm.complex_modulus or pm.simulate"
            )
