"""The contacts that carry a packing: its network with the rattlers taken out."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.rattlers import loose_particles
from packmech.packing import Packing

RATTLERS = ("remove", "keep")


class Network(NamedTuple):
    """Contacts among the particles that are kept, numbered anew, and the numbers that these had before."""

    contacts: Contacts
    index_n: NDArray[np.int64]


def held_network(packing: Packing, *, gap_tolerance: float, rattlers: str = "remove") -> Network:
    """Return the contacts within the gap tolerance, without those of rattlers unless these are to be kept.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    rattlers
        "remove" or "keep".

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.1, 0.0], [1.5, 1.5]], [0.5, 0.2], pm.Box([[1.0, 0.5], [0.0, 3.0]]))
    >>> held_network(packing, gap_tolerance=1e-9, rattlers="keep").index_n.tolist()
    [0, 1]
    >>> held_network(packing, gap_tolerance=1e-9).index_n.tolist()
    []

    """
    one_of("rattlers", rattlers, RATTLERS)
    contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    if rattlers == "keep":
        return Network(contacts, np.arange(packing.particles))
    held = ~loose_particles(contacts)
    number = np.cumsum(held) - 1
    kept = contacts.select(held[contacts.i_c] & held[contacts.j_c])
    renumbered = dataclasses.replace(
        kept, i_c=number[kept.i_c], j_c=number[kept.j_c], particles=int(np.count_nonzero(held))
    )
    return Network(renumbered, np.flatnonzero(held))
