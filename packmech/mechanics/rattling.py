"""Rattlers of packings with rigid links: particles that do not move with the backbone.

A particle of a cluster may be held by its links alone, and one with many contacts may still turn: counting contacts
tells neither. Instead (section 12 of the corrected specification): contacts that some state of self stress pushes make
up the backbone; motions that change no backbone contact and no link, translations included, leave the particles of the
backbone at rest relative to each other; all others rattle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.compiled import single_thread
from packmech.contacts import Contacts
from packmech.measure.link_tension import LinkGradients, distance_gradients, link_gradients
from packmech.mechanics.factor import factorize
from packmech.mechanics.linear_programs import Program, solve_highs
from packmech.mechanics.link_rows import independent_rows
from packmech.mechanics.rigidity import TOUCHING, contacts_of
from packmech.packing import Packing

# singular values below this fraction of the largest are zero
_RANK = 1e-5
_SWEEPS = 12
# blocks of random zero modes that differ by less, as part of their size, are equal
_EQUAL = 1e-6
# forces of overlaps that balance to this part of their mean are a state of self stress
_BALANCED = 1e-6
_PROGRAM_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Rattling:
    """Which particles rattle, by the motions that contacts and links leave them.

    Attributes
    ----------
    rattling_n
        (N,) particles that can move relative to the backbone. All of them if there is no backbone: then nothing is
        jammed.
    dangling_n
        (N,) those of them that touch nothing: loose ends of clusters that are held elsewhere, and clusters that are
        held nowhere.
    cluster_n
        (N,) number of each particle's cluster; a single particle is one.
    loose_n
        (N,) particles of clusters that rattle as a whole: these can be taken out.
    backbone_c
        (C,) contacts that a state of self stress pushes.

    """

    rattling_n: NDArray[np.bool_]
    dangling_n: NDArray[np.bool_]
    cluster_n: NDArray[np.int64]
    loose_n: NDArray[np.bool_]
    backbone_c: NDArray[np.bool_]

    @property
    def empty(self) -> bool:
        """Whether every particle rattles: no backbone."""
        return bool(self.rattling_n.all())


def find_rattling_clusters(
    packing: Packing, *, gap_tolerance: float = TOUCHING, contacts: Contacts | None = None
) -> Rattling:
    """Return which particles rattle, alone or with their clusters, in the fixed box.

    Parameters
    ----------
    packing
        The packing, with links or without.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the contacts belong to another number of particles.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2), links)
    >>> pm.find_rattling_clusters(dimer).empty
    True

    """
    found = contacts_of(packing, contacts, gap_tolerance)
    links = packing.links
    cluster = np.arange(packing.particles) if links is None else links.clusters(packing.particles)
    with single_thread():
        gradients = link_gradients(packing)
        backbone = _pushed(found, gradients)
        rattling = _moving(found.select(backbone), gradients)
    held = np.bincount(cluster, ~rattling) > 0
    return Rattling(rattling, rattling & (found.count_n() == 0), cluster, ~held[cluster], backbone)


def _pushed(contacts: Contacts, links: LinkGradients) -> NDArray[np.bool_]:
    """Return which contacts bear a force in some state of self stress that pulls nowhere."""
    count = len(contacts)
    if not count:
        return np.zeros(0, dtype=bool)
    rows = distance_gradients(contacts)
    overlap = contacts.overlap_c
    if overlap.min() > 0.0:
        # a soft packing at rest shows such a state by itself, if its law is harmonic
        force = overlap / contacts.contact_distance_c
        net = rows.T @ force
        net = net + links.gradient_lx.T @ links.multipliers(net)
        if np.abs(net).max() < _BALANCED * force.mean() and force.min() > 10.0 * np.abs(net).max():
            return np.ones(count, dtype=bool)
    independent, _ = independent_rows(links)
    # s = p + q with p at most 1: the largest sum of p has p = 1 wherever any state pushes
    equal = sp.csr_array(sp.hstack([rows.T, rows.T, independent.T], format="csr"))
    free = independent.shape[0]
    program = Program(
        cost=np.concatenate([-np.ones(count), np.zeros(count + free)]),
        equal=equal,
        equal_to=np.zeros(equal.shape[0]),
        below=sp.csr_array((0, equal.shape[1])),
        below_to=np.zeros(0),
        lower=np.concatenate([np.zeros(2 * count), np.full(free, -np.inf)]),
        upper=np.concatenate([np.ones(count), np.full(count + free, np.inf)]),
    )
    pushed: NDArray[np.bool_] = solve_highs(program, _PROGRAM_TOLERANCE).x[:count] > 0.5
    return pushed


def moving_apart(packing: Packing, backbone: Contacts) -> NDArray[np.bool_]:
    """Return who moves differently from the largest group of particles that contacts and links hold together."""
    return _moving(backbone, link_gradients(packing))


def _moving(backbone: Contacts, links: LinkGradients) -> NDArray[np.bool_]:
    """Return who moves differently from the most particles in a generic motion that changes no contact and no link."""
    particles, dimension = backbone.particles, backbone.dimension
    if not len(backbone):
        return np.ones(particles, dtype=bool)
    independent, _ = independent_rows(links)
    rows = sp.csr_array(sp.vstack([distance_gradients(backbone), independent], format="csr"))
    square = sp.csc_array(rows.T @ rows)
    shift = _RANK**2 * float(abs(square).sum(axis=0).max())
    factor = factorize(sp.csc_array(square + shift * sp.eye_array(square.shape[0])))
    # what inverse iteration leaves of random motions is their part without any extension
    motion = np.random.default_rng(0).normal(size=(square.shape[0], 2))
    for _ in range(_SWEEPS):
        motion = shift * factor.solve(motion)
    blocks = motion.reshape(particles, 2 * dimension)
    size = float(np.sqrt((blocks**2).mean()))
    label = np.zeros(particles, dtype=np.int64)
    for column in blocks.T:
        order = np.argsort(column, kind="stable")
        split = np.concatenate([[0], np.cumsum(np.diff(column[order]) > _EQUAL * size)])
        part = np.empty(particles, dtype=np.int64)
        part[order] = split
        _, label = np.unique(label * (particles + 1) + part, return_inverse=True)
    largest = int(np.bincount(label).argmax())
    same = label == largest
    if not (same[backbone.i_c] & same[backbone.j_c]).any():
        return np.ones(particles, dtype=bool)
    return np.asarray(~same)
