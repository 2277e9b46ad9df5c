"""What takes part: the packing's contacts without its rattlers."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.rattlers import loose_particles
from packmech.packing import Packing


class Backbone(NamedTuple):
    """Contacts in numbers of the backbone, and the (N',) numbers that its particles have in the packing."""

    contacts: Contacts
    index_n: NDArray[np.int64]


def find_backbone(packing: Packing, *, gap_tolerance: float, rattlers: str = "remove") -> Backbone:
    """Return the contacts between particles that do not rattle, renumbered, and who those particles are.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    rattlers
        "remove" leaves rattlers and their contacts out; "keep" takes every particle.

    """
    one_of("rattlers", rattlers, ("remove", "keep"))
    contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    if rattlers == "keep":
        return Backbone(contacts, np.arange(packing.particles))
    held = ~loose_particles(contacts)
    inside = contacts.select(held[contacts.i_c] & held[contacts.j_c])
    number = np.cumsum(held) - 1
    index = np.flatnonzero(held)
    return Backbone(
        dataclasses.replace(inside, i_c=number[inside.i_c], j_c=number[inside.j_c], particles=len(index)), index
    )
