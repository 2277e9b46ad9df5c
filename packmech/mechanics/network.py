"""The network that holds a packing: contacts and links among particles that do not rattle, and their coordinates."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.rattlers import rattlers_of, rattling_bodies
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.contacts.shape_rattlers import shape_rattlers
from packmech.effects import ContactTerms, Walls, acts_on_single, held_particles, single_effects, wall_sides
from packmech.jit.compiled import kernel
from packmech.links import image_offsets
from packmech.measure.bonds import BondedPairs, bonded_pairs, unbonded, with_bonds_as_links
from packmech.measure.walls import rattlers_of_scene
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
    bonded
        Bonds among the kept particles; None without.

    """

    parent: Packing
    index_n: NDArray[np.int64]
    contacts: Contacts | ShapeContacts
    links: ConstraintFactor
    turn_nkt: NDArray[np.float64]
    there_nq: NDArray[np.bool_]
    free_nq: NDArray[np.bool_]
    anchored: bool
    bonded: BondedPairs | None = None

    @functools.cached_property
    def packing(self) -> Packing:
        """The packing of the kept particles alone; of all where every particle rattles, since there is none of none."""
        return self.links.packing if len(self.index_n) else self.parent

    @property
    def shape_contacts(self) -> ShapeContacts:
        """The contacts of a packing with shapes."""
        assert isinstance(self.contacts, ShapeContacts)
        return self.contacts

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
            pairs = self.contacts.count_n() + (0 if self.bonded is None else self.bonded.pairs.count_n())
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
    contacts = unbonded(touching_pairs(packing, gap_tolerance, second=second), effects)
    kept = np.ones(packing.particles, dtype=bool)
    if rattlers == "remove":
        kept = ~_rattling(with_bonds_as_links(packing, effects), contacts, effects)
    return network_among(packing, contacts, kept, effects)


def network_among(
    packing: Packing,
    contacts: Contacts | ShapeContacts,
    kept_n: NDArray[np.bool_],
    effects: tuple[Any, ...] = (),
    turn_nkt: NDArray[np.float64] | None = None,
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
        (N, K, t) rotations per length of each coordinate of turns; those of the shapes unless given.

    """
    index = np.flatnonzero(kept_n)
    turn = (packing.turn_nkt if turn_nkt is None else turn_nkt)[index]
    there = np.hstack([np.ones((len(index), packing.dimension), dtype=bool), (turn != 0.0).any(axis=2)])
    free, held = there, held_particles(effects, packing.particles)
    if held is not None:
        free = there & ~held[index, None]
    whole = kept_n.all()
    left = packing
    if not whole and len(index):
        number = np.where(kept_n, np.cumsum(kept_n) - 1, -1)
        left = packing.select(index, None if packing.links is None else packing.links.numbered(number))
    if not whole:
        contacts = _among(left, contacts, kept_n)
    links = ConstraintFactor(left if len(index) else packing.replace(links=None))
    bonded = bonded_pairs(effects, packing)
    if bonded is not None and not whole:
        keep = kept_n[bonded.pairs.i_c] & kept_n[bonded.pairs.j_c]
        terms = ContactTerms(*(one[keep] for one in bonded.terms))
        bonded = BondedPairs(_among(left, bonded.pairs, kept_n), terms)
    return Network(packing, index, contacts, links, turn, there, free, acts_on_single(effects), bonded)


def _among(left: Packing, contacts: Contacts | ShapeContacts, kept_n: NDArray[np.bool_]) -> Any:
    """Return the contacts among the particles that are kept, numbered by these."""
    number = np.cumsum(kept_n) - 1
    kept = contacts.select(kept_n[contacts.i_c] & kept_n[contacts.j_c])
    if isinstance(kept, ShapeContacts) and kept_n.any():
        return kept.numbered(number, left)
    return dataclasses.replace(
        kept, i_c=number[kept.i_c], j_c=number[kept.j_c], particles=int(np.count_nonzero(kept_n))
    )


def _rattling(packing: Packing, contacts: Contacts | ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Return, for each particle, whether contacts with others, walls and what is held leave it free to move."""
    if isinstance(contacts, ShapeContacts):
        walls = [one for _, _, _, one in wall_sides(effects, packing)]
        held = held_particles(effects, packing.particles)
        if packing.links is None and all(isinstance(one, Walls) for one in single_effects(effects)):
            return shape_rattlers(packing, contacts, walls, held)
        touching = contacts.count_n() > 0
        for one in walls:
            touching[one.particle_w] = True
        return ~touching if held is None else ~(touching | held)
    acting = acts_on_single(effects)
    if packing.links is None:
        return rattlers_of_scene(packing, contacts, effects) if acting else rattlers_of(contacts)
    if not acting:
        return _by_cluster(packing, contacts)
    return untouched_clusters(packing, contacts, effects)


def untouched_clusters(packing: Packing, contacts: Contacts, effects: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Return (N,) who belongs to a cluster of linked particles that all touch nothing, no wall among it."""
    assert packing.links is not None
    cluster = packing.links.clusters(packing.particles)
    loose = rattlers_of_scene(packing, contacts, effects)
    return np.asarray(np.bincount(cluster, ~loose)[cluster] == 0)


@kernel
def _between(i_c, j_c, image_cd, normal_cd, cluster_n, offset_nd):  # type: ignore[no-untyped-def]
    """Return clusters and normals of the contacts between them, the smaller number first."""
    count, d = image_cd.shape
    i, j, normal = np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, d))
    used = 0
    for c in range(count):
        one, other = i_c[c], j_c[c]
        # a cluster's contact with its own image holds it, one within it does not
        apart = cluster_n[one] != cluster_n[other]
        for a in range(d):
            apart = apart or image_cd[c, a] != offset_nd[other, a] - offset_nd[one, a]
        if apart:
            flip = cluster_n[one] > cluster_n[other]
            i[used] = cluster_n[other] if flip else cluster_n[one]
            j[used] = cluster_n[one] if flip else cluster_n[other]
            for a in range(d):
                normal[used, a] = -normal_cd[c, a] if flip else normal_cd[c, a]
            used += 1
    return i[:used], j[:used], normal[:used]


def _by_cluster(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return (N,) who belongs to a cluster that its contacts with others do not even keep from moving as a whole."""
    assert packing.links is not None
    cluster = packing.links.clusters(packing.particles)
    offset, winding = image_offsets(packing.links, packing.particles)
    i, j, normal = _between(contacts.i_c, contacts.j_c, contacts.image_cd, contacts.normal_cd, cluster, offset)
    # a cluster that closes around the box resists its strain, touched or not
    rattling: NDArray[np.bool_] = rattling_bodies(i, j, normal, int(cluster.max()) + 1)[cluster] & ~winding
    return rattling
