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

from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.elements import distance_rows
from packmech.effects import (
    Bonds,
    acts_on_single,
)
from packmech.honors import honors
from packmech.jit.blas import single_thread
from packmech.linalg.factor import Factorization, factorize
from packmech.linalg.linear_programs import SOLVE, LinearProgram
from packmech.measure.contact_forces import contact_forces
from packmech.measure.counting import find_rattlers
from packmech.measure.friction import friction_of
from packmech.measure.walls import rattlers_of_scene
from packmech.mechanics.network import untouched_clusters
from packmech.mechanics.rigidity import contacts_of
from packmech.packing import Packing, no_own_images, no_tangential
from packmech.result import Outcome
from packmech.scene import Scene

# singular values below this fraction of the largest are zero
_RANK = 1e-5
_SWEEPS = 12
# blocks of random zero modes that differ by less, as part of their size, are equal
_EQUAL = 1e-6
# forces are a state of self stress if they balance to this part of the smallest, and this is so much of their mean
_BALANCED = 1e-3
_LOADED = 1e-10
_REFINEMENTS = 4
# the program's unknowns come out as 0 or 1: a solution with one this near to one half tells nothing
_SURE = 0.1
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
        (N,) those of them that their clusters alone hold: linked particles that touch nothing. A single particle
        that touches nothing is held by nothing.
    cluster_n
        (N,) number of each particle's cluster; a single particle is one.
    rattling_cluster_n
        (N,) particles of clusters that rattle as a whole: these can be taken out.
    backbone_c
        (C,) contacts that a state of self stress pushes.

    """

    rattling_n: NDArray[np.bool_]
    dangling_n: NDArray[np.bool_]
    cluster_n: NDArray[np.int64]
    rattling_cluster_n: NDArray[np.bool_]
    backbone_c: NDArray[np.bool_]

    @property
    def empty(self) -> bool:
        """Whether every particle rattles: no backbone."""
        return bool(self.rattling_n.all())


@honors("links", packing_only=True, shaped="pm.find_rattlers")
def find_rattling_clusters(
    packing: Packing, *, gap_tolerance: float | None = None, contacts: Contacts | None = None
) -> Rattling:
    """Return which particles rattle, alone or with their clusters, in the fixed box.

    Parameters
    ----------
    packing
        The packing, with links or without.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, the contacts belong to another number of particles, or a particle is
        linked to its own image.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2), links)
    >>> pm.find_rattling_clusters(dimer).empty
    True

    """
    found = contacts_of(packing, contacts, gap_tolerance)
    no_own_images("packing", packing)
    no_tangential("packing", packing)
    links = packing.links
    cluster = np.arange(packing.particles) if links is None else links.clusters(packing.particles)
    with single_thread():
        independent, _ = ConstraintFactor(packing).independent_rows()
        rows = _rows(found, independent)
        backbone = _pushed(found, independent, rows)
        if not backbone.all():
            rows = _rows(found.select(backbone), independent)
        rattling = _moving(found.select(backbone), rows)
    held = np.bincount(cluster, ~rattling) > 0
    linked = np.bincount(cluster)[cluster] > 1
    dangling = rattling & linked & (found.count_n() == 0)
    return Rattling(rattling, dangling, cluster, ~held[cluster], backbone)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Changes of distances of contacts and of lengths of independent links, and their normal matrix, factored."""

    matrix: sp.csr_array
    shift: float
    factor: Factorization


def _rows(contacts: Contacts, independent: sp.csr_array) -> _Rows:
    matrix = sp.csr_array(sp.vstack([distance_rows(contacts), independent], format="csr"))
    square = sp.csc_array(matrix.T @ matrix)
    # without any row everything moves
    shift = _RANK**2 * float(abs(square).sum(axis=0).max()) or 1.0
    return _Rows(matrix, shift, factorize(sp.csc_array(square + shift * sp.eye_array(square.shape[0]))))


def _pushed(contacts: Contacts, independent: sp.csr_array, rows: _Rows) -> NDArray[np.bool_]:
    """Return which contacts bear a force in some state of self stress that pulls nowhere.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no solver could tell.

    """
    count = len(contacts)
    if not count:
        return np.zeros(0, dtype=bool)
    overlap = np.maximum(contacts.overlap_c, 0.0)
    # forces of the harmonic law, and of Hertz's
    if any(_balance_nearby(rows, overlap**power / contacts.contact_distance_c) for power in (1.0, 1.5)):
        return np.ones(count, dtype=bool)
    # s = p + q with p at most 1: the largest sum of p has p = 1 wherever any state pushes
    matrix = rows.matrix
    equal = sp.csr_array(sp.hstack([matrix[:count].T, matrix.T], format="csr"))
    free = independent.shape[0]
    program = LinearProgram(
        cost=np.concatenate([-np.ones(count), np.zeros(count + free)]),
        equal=equal,
        equal_to=np.zeros(equal.shape[0]),
        below=sp.csr_array((0, equal.shape[1])),
        below_to=np.zeros(0),
        lower=np.concatenate([np.zeros(2 * count), np.full(free, -np.inf)]),
        upper=np.concatenate([np.ones(count), np.full(count + free, np.inf)]),
    )
    # the interior-point method first: HiGHS' simplex may lose the solution between its presolve and the end
    states = []
    for name in ("clarabel", "highs"):
        found = SOLVE[name](program, _PROGRAM_TOLERANCE)
        states.append(found.solve.status)
        pushed: NDArray[np.bool_] = found.x[:count] > 0.5
        sure = np.abs(found.x[:count] - 0.5).min() > _SURE
        if found.solve.outcome is Outcome.CONVERGED and sure:
            return pushed
    raise np.linalg.LinAlgError(f"packing must have contacts whose balances can be found, got: {'; '.join(states)}")


def _balance_nearby(rows: _Rows, force_c: NDArray[np.float64]) -> bool:
    """Return whether the balance nearest to the given forces pushes at every contact.

    A soft packing at rest shows a state of self stress by its overlaps, whatever its law: where it is the only one, it
    is the nearest balance to anything that it is not orthogonal to; where there are more, overlaps are near enough.
    """
    if not (force_c > 0.0).any():
        return False
    count = len(force_c)
    contact, link = rows.matrix[:count], rows.matrix[count:]
    weight = np.zeros(rows.matrix.shape[0])
    weight[:count] = force_c / force_c.mean()
    if link.shape[0]:
        # the links' share first, or the nearest balance is looked for far from where it is
        weight[count:] = -factorize(sp.csc_array(link @ link.T)).solve(link @ (contact.T @ weight[:count]))
    for _ in range(_REFINEMENTS):
        weight -= rows.matrix @ rows.factor.solve(rows.matrix.T @ weight)
    push = weight[:count]
    balance = float(np.abs(rows.matrix.T @ weight).max())
    return bool(push.min() > _LOADED * push.mean() > 0.0 and balance < _BALANCED * push.min())


def moving_apart(packing: Packing, backbone: Contacts) -> NDArray[np.bool_]:
    """Return who moves differently from the largest group of particles that contacts and links hold together."""
    independent, _ = ConstraintFactor(packing).independent_rows()
    return _moving(backbone, _rows(backbone, independent))


def _moving(backbone: Contacts, rows: _Rows) -> NDArray[np.bool_]:
    """Return who does not move with the largest group in a generic motion that changes no contact and no link."""
    particles, dimension = backbone.particles, backbone.dimension
    if not len(backbone):
        return np.ones(particles, dtype=bool)
    # what inverse iteration leaves of random motions is their part without any extension
    motion = np.random.default_rng(0).normal(size=(rows.matrix.shape[1], 2))
    for _ in range(_SWEEPS):
        motion = rows.shift * rows.factor.solve(motion)
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


def rattlers_in(scene: Scene) -> NDArray[np.bool_]:
    """Return, for each particle of a scene at rest, whether it rattles: by friction, weights, walls and links, too.

    With links, particles that move apart from the backbone; where something acts on single particles beside links,
    those of clusters that touch nothing.
    """
    packing, effects = scene.packing, scene.effects
    acting = acts_on_single(effects)
    if packing.tangential is not None or friction_of(scene) is not None:
        unbonded = tuple(one for one in effects if not isinstance(one, Bonds))
        return contact_forces(scene.replace(effects=unbonded)).rattlers_n
    if packing.links is not None:
        if not acting:
            return find_rattling_clusters(packing).rattling_n
        return untouched_clusters(packing, find_contacts(packing), effects)
    if acting:
        return rattlers_of_scene(packing, find_contacts(packing), effects)
    return find_rattlers(packing)
