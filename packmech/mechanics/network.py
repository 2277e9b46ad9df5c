"""The network that holds a packing: contacts and links among particles that do not rattle, and their coordinates."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import Interactions, acting_contacts, acts_on_single, find_interactions, held_particles
from packmech.measure.rattlers import rattlers_among
from packmech.packing import Packing

RATTLERS = ("remove", "keep")


@dataclass(frozen=True, eq=False)
class Network:
    """Contacts and links among the particles that are kept, renumbered, and the coordinates of these.

    Attributes
    ----------
    parent
        The packing that the particles are of.
    index_n
        (N',) particles that are kept, by their numbers there.
    contacts
        Contacts among them.
    found
        The contacts of the parent that these were chosen from, by its numbers.
    links
        Links among them, perhaps none.
    turn_nkt
        (N', K, t) rotations per length of each coordinate of turns: K = 0 where nothing turns.
    there_nq
        (N', q) which coordinates there are: a disc among ellipses has no turns.
    free_nq
        Which of these can move: not those of particles that are held.
    anchored
        Whether walls, held particles or potentials keep the packing at its place.
    interactions
        What acts between centers of the kept particles whether these touch or not, bonds among it; perhaps nothing.

    """

    parent: Packing
    index_n: NDArray[np.int64]
    contacts: Contacts | ShapeContacts
    found: Contacts | ShapeContacts
    links: ConstraintFactor
    turn_nkt: NDArray[np.float64]
    there_nq: NDArray[np.bool_]
    free_nq: NDArray[np.bool_]
    anchored: bool
    interactions: Interactions

    @functools.cached_property
    def packing(self) -> Packing:
        """The packing of the kept particles alone; of all where every particle rattles, since there is none of none."""
        return self.links.packing if len(self.index_n) else self.parent

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes."""
        return self.contacts.dimension

    @property
    def free_f(self) -> NDArray[np.bool_]:
        """The (N' q,) coordinates that can move."""
        return self.free_nq.ravel()

    @functools.cached_property
    def link_rows(self) -> tuple[sp.csr_array, NDArray[np.float64]]:
        """The derivatives of the independent links' lengths by all coordinates (L, N' q), and by strains (L, s)."""
        gradient, stretch = self.links.independent_rows()
        d, (count, q) = self.dimension, self.there_nq.shape
        column = gradient.indices // d * q + gradient.indices % d
        return sp.csr_array((gradient.data, column, gradient.indptr), shape=(gradient.shape[0], count * q)), stretch

    @functools.cached_property
    def pinned_f(self) -> NDArray[np.bool_]:
        """The coordinates that can move once the best connected particle stays: no translation is left."""
        pinned = self.free_nq.copy()
        if len(pinned) and not self.anchored:
            pairs = self.contacts.count_n() + self.interactions.pairs.count_n()
            pinned[int(np.argmax(pairs)), : self.dimension] = False
        return pinned.ravel()


def contact_network(
    packing: Packing,
    effects: tuple[Any, ...] = (),
    *,
    gap_tolerance: float | None = None,
    rattlers: str = "remove",
    second: bool = True,
) -> Network:
    """Return the contacts within the gap tolerance, without those of rattlers unless these are to be kept.

    What links and bonds join goes together: a cluster is taken out if it can be moved as a whole. One that can only
    turn stays,
    and so do its ends: they are zero modes that carry no strain. Walls and held particles hold others as contacts do,
    and what has a weight, or feels another potential, rattles only where it touches nothing.

    Parameters
    ----------
    packing
        The packing.
    effects
        Effects on single particles, among others; none where only contacts are asked for.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    rattlers
        "remove" or "keep".
    second
        Whether curvatures of the distances of shapes are asked for.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.1, 0.0], [1.5, 1.5]], [0.5, 0.2], pm.Box([[1.0, 0.5], [0.0, 3.0]]))
    >>> contact_network(packing, gap_tolerance=1e-9, rattlers="keep").index_n.tolist()
    [0, 1]
    >>> contact_network(packing, gap_tolerance=1e-9).index_n.tolist()
    []

    """
    one_of("rattlers", rattlers, RATTLERS)
    contacts = acting_contacts(touching_pairs(packing, gap_tolerance, second=second), effects)
    kept = np.ones(packing.particles, dtype=bool)
    if rattlers == "remove":
        kept = ~rattlers_among(packing, contacts, effects)
    return network_among(packing, contacts, kept, effects, packing.turn_nkt)


def network_among(
    packing: Packing,
    contacts: Contacts | ShapeContacts,
    kept_n: NDArray[np.bool_],
    effects: tuple[Any, ...],
    turn_nkt: NDArray[np.float64],
) -> Network:
    """Return the network of the given contacts among the particles that are kept.

    Parameters
    ----------
    packing, contacts
        The packing and its contacts.
    kept_n
        (N,) particles that are kept.
    effects
        As in `contact_network`.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns.

    """
    index = np.flatnonzero(kept_n)
    turn = turn_nkt[index]
    there = np.hstack([np.ones((len(index), packing.dimension), dtype=bool), (turn != 0.0).any(axis=2)])
    free, held = there, held_particles(effects, packing.particles)
    if held is not None:
        free = there & ~held[index, None]
    left, found = packing, contacts
    if not kept_n.all():
        number = np.where(kept_n, np.cumsum(kept_n) - 1, -1)
        if len(index):
            left = packing.select(index)
        contacts = contacts.among(kept_n).numbered(number, left)
    links = ConstraintFactor(left if len(index) else packing.replace(links=None))
    beyond = find_interactions(packing, effects).among(index)
    return Network(packing, index, contacts, found, links, turn, there, free, acts_on_single(effects), beyond)
