"""Which particles rattle: what contacts, walls, links and friction leave free, and what is left without them.

Single particles, and clusters of linked ones that move as a whole, are bodies of `packmech.contacts.rattlers`. Whether
the particles of a cluster can move against each other, or turn, no count of contacts says: links are rows that push and
pull. What moves is then found by two questions on the rows of contacts and links, which rows push in some balance, and
which particles a generic motion moves that changes none of these and no link. They are asked of one cluster after the
other, its surroundings at rest (`find_rattlers`), or of the whole packing (`find_rattling_clusters`): contacts that
some state of self stress pushes make up the backbone; motions that change no backbone contact and no link, translations
included, leave the particles of the backbone at rest relative to each other; all others rattle.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import instance
from packmech.constraints.factor import DEPENDENT, ConstraintFactor
from packmech.contacts import Contacts, pair_contacts
from packmech.contacts.elements import distance_rows, end_slopes
from packmech.contacts.given import check_given, contacts_of
from packmech.contacts.rattlers import Ends, ends_of, join_ends, rattlers_of, rattling_bodies, rows_across, turns_of
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import (
    RollingDashpot,
    find_interactions,
    held_particles,
    is_walls,
    links_and_bonds,
    single_effects,
    wall_sides,
)
from packmech.jit.blas import single_thread
from packmech.linalg.factor import Factorization, factorize
from packmech.linalg.linear_programs import SOLVE, LinearProgram
from packmech.links import Links, image_offsets
from packmech.packing import Packing, no_own_images, no_tangential
from packmech.result import Outcome
from packmech.scene import Scene

# singular values below this fraction of the largest are zero
_RANK = 1e-5
_SWEEPS = 12
# particles that random zero modes move by less than this part of their size are held; their motions that differ by
# less are equal
_STILL = 1e-6
# forces are a state of self stress if they balance to this part of the smallest, and this is so much of their mean
_BALANCED = 1e-3
_LOADED = 1e-10
_REFINEMENTS = 4
# an overlap counts as a force where the net force on its cluster is below this part of it: pairs that are bent by more
# from a straight line squeeze out what they touch
_SHOWN = 1e-6
# the program's unknowns come out as 0 or 1: a solution with one this near to one half is inconclusive
_SURE = 0.1
_PROGRAM_TOLERANCE = 1e-9


def rattlers_among(
    packing: Packing,
    contacts: Contacts | ShapeContacts,
    effects: tuple[Any, ...] = (),
    *,
    rough: Ends | None = None,
    friction: float = 0.0,
    turning: tuple[bool, bool] = (False, False),
) -> NDArray[np.bool_]:
    """Return (N,) which particles contacts with others, walls and what is held leave free to move.

    Linked particles go together: a cluster rattles if it can be moved as a whole, and not where it closes around the
    box. What has a weight, or feels another potential, presses on whatever it touches: it rattles only where it touches
    nothing; so does a cluster of particles that turn, whose links take any force. Bonds count as links.

    Parameters
    ----------
    packing, contacts, effects
        The packing, its contacts and the scene's effects.
    rough
        The ends of the contacts with friction; those without unless given.
    friction, turning
        Coefficient of friction that the rows of `rough` and of walls are made for [1]; and whether these have rows
        against rolling, and against twisting.

    """
    d, links = packing.dimension, links_and_bonds(packing, effects)
    cluster, (offset, held) = links.clusters(packing.particles), image_offsets(links, packing.particles)
    held = held.copy()
    fixed = held_particles(effects, packing.particles)
    if fixed is not None:
        held |= fixed
    walls = _wall_ends(packing, effects, friction, turning)
    pressed = not all(is_walls(one) for one in single_effects(effects))
    turns = turns_of(packing.turn_nkt) | (rough is not None)
    pulls = _interaction_ends(packing, effects, cluster)
    touching = contacts.count_n() > 0
    touching[walls.body_e] = touching[pulls.body_e] = True
    held |= touching & (pressed | (turns & (np.bincount(cluster)[cluster] > 1)))
    if pressed:
        return np.asarray(np.bincount(cluster, held)[cluster] == 0)
    ends = join_ends([ends_of(contacts) if rough is None else rough, walls, pulls])
    if links:
        # a cluster's contact with its own image holds it, one within it does not
        inside = (cluster[contacts.i_c] == cluster[contacts.j_c]) & (
            contacts.image_cd == offset[contacts.j_c] - offset[contacts.i_c]
        ).all(axis=1)
        between = ~np.concatenate([inside, inside, np.zeros(len(walls.body_e) + len(pulls.body_e), dtype=bool)])
        body, other, push, side = (part[between] for part in ends)
        ends = Ends(cluster[body], np.where(other < 0, -1, cluster[other]), push, side)
    bodies = int(cluster.max()) + 1
    turns_b = np.zeros(bodies, dtype=bool)
    turns_b[cluster] = turns
    held_b = np.bincount(cluster, held, bodies) > 0
    kinds = (d - 1, (d - 1) * turning[0], int(turning[1]))
    groups = tuple(itertools.accumulate(one for one in kinds if one)) if rough is not None else None
    return rattling_bodies(ends, turns_b, d, friction=friction, groups=groups, held_b=held_b)[cluster]


def _no_ends(width: int) -> Ends:
    """Return no ends, whose rows have so many numbers."""
    none = np.zeros(0, np.int64)
    return Ends(none, none, np.zeros((0, width)), np.zeros((0, 0, width)))


def _interaction_ends(packing: Packing, effects: tuple[Any, ...], cluster_n: NDArray[np.int64]) -> Ends:
    """Return the ends of interactions, which hold particles both ways: by distances, and directions by alignments.

    Those within a cluster hold nothing.
    """
    found, turn, d = find_interactions(packing, effects), packing.turn_nkt, packing.dimension
    if not len(found):
        return _no_ends(d + turn.shape[1])
    found = found.select(cluster_n[found.pairs.i_c] != cluster_n[found.pairs.j_c])
    i, j = found.pairs.i_c, found.pairs.j_c
    rows = [end_slopes(i, j, found.slope_ckx[:, k], turn, d) for k in range(2 if turn.size else 1)]
    slope = np.concatenate([one.reshape(-1, d + turn.shape[1]) for one in rows])
    times = len(slope) // max(2 * len(i), 1)
    body, other = np.tile(np.concatenate([i, j]), times), np.tile(np.concatenate([j, i]), times)
    push = np.concatenate([slope, -slope])
    return Ends(np.tile(body, 2), np.tile(other, 2), push, np.zeros((len(push), 0, push.shape[1])))


def _wall_ends(packing: Packing, effects: tuple[Any, ...], friction: float, turning: tuple[bool, bool]) -> Ends:
    """Return the ends of contacts with walls, which push particles and turn those with shapes; rough ones all.

    Rows of rough walls are as long as their coefficients are over that which rows are made for.
    """
    d, turn = packing.dimension, packing.turn_nkt
    found = [_no_ends(d + turn.shape[1])]
    for one in wall_sides(effects, packing):
        wall, touches = one.wall, one.touches
        n, slope = touches.particle_w, touches.slope_wx
        if friction > 0.0 and wall.roughness is not None:
            spin, normal = packing.spin_nkk[n], one.normal_wd(d)
            arm = 0.5 * touches.distance_w
            others = [
                0.0 if each is None or isinstance(each, RollingDashpot) else each.coefficient / friction
                for each in (wall.rolling, wall.twisting)
            ]
            moments = [size * arm if there else None for size, there in zip(others, turning, strict=True)]
            side = rows_across(normal, arm[:, None] * normal, spin, moments)
            side[:, : d - 1] *= (one.coefficient_w / friction)[:, None, None]
            push = np.hstack([-normal, np.zeros((len(n), spin.shape[1]))])
            found.append(Ends(n, np.full(len(n), -1), push, side))
            continue
        turned = np.einsum("wkt,wt->wk", turn[n], slope[:, d : d + turn.shape[2]])
        size = np.sqrt((slope[:, :d] ** 2).sum(axis=1, keepdims=True))
        push = np.hstack([slope[:, :d], turned]) / size
        found.append(Ends(n, np.full(len(n), -1), push, np.zeros((len(n), 0, push.shape[1]))))
    return join_ends(found)


def rattling_particles(packing: Packing, contacts: Contacts | ShapeContacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether the contacts, and links if there are any, leave it free.

    Links to rattlers still count: what they admit, and no more, is a motion.
    """
    if not packing.links:
        return rattlers_of(contacts)
    assert isinstance(contacts, Contacts)
    with single_thread():
        return _rattling_by_links(packing, contacts)


def _rattling_by_links(packing: Packing, contacts: Contacts) -> NDArray[np.bool_]:
    """Return (N,) which particles contacts with particles that do not rattle, and links, leave free."""
    links = ConstraintFactor(packing)
    independent, _ = links.independent_rows()
    cluster, d = packing.cluster_n, packing.dimension
    rattling = np.zeros(packing.particles, dtype=bool)
    while not rattling.all():
        rows, owner, overlap = _one_by_one(contacts.among(~rattling), cluster, packing.unwrapping_nd)
        pushed = _shown(rows, owner, overlap, links, cluster)
        moving = _LinkedRows(rows[np.flatnonzero(pushed)], independent).moving(d)
        unsure = np.unique(cluster[moving & ~rattling])
        if not len(unsure):
            break
        look, here = np.isin(owner, unsure), np.isin(cluster, unsure)
        pushed |= look
        column = np.flatnonzero(np.repeat(here, d))
        own = sp.csr_array(independent[:, column])
        pushed[look] = pushing_rows(rows[np.flatnonzero(look)][:, column], own[np.flatnonzero(np.diff(own.indptr) > 0)])
        found = _LinkedRows(rows[np.flatnonzero(pushed)], independent).moving(d) & here
        if not (found & ~rattling).any():
            break
        rattling |= found
    return rattling


def _one_by_one(
    contacts: Contacts, cluster_n: NDArray[np.int64], offset_nd: NDArray[np.int64]
) -> tuple[sp.csr_array, NDArray[np.int64], NDArray[np.float64]]:
    """Return changes of contact distances as one cluster moves, all else at rest: rows, their clusters and overlaps.

    A contact between clusters, or of a cluster with its own image, has a row for either side.
    """
    inside = cluster_n[contacts.i_c] == cluster_n[contacts.j_c]
    inside &= (contacts.image_cd == offset_nd[contacts.j_c] - offset_nd[contacts.i_c]).all(axis=1)
    between = np.flatnonzero(~inside)
    within = np.flatnonzero(inside)
    d, size = contacts.dimension, contacts.particles * contacts.dimension
    end = np.concatenate([contacts.i_c[between], contacts.j_c[between]])
    normal = np.concatenate([-contacts.normal_cd[between], contacts.normal_cd[between]])
    column = end[:, None] * d + np.arange(d)
    halves = sp.csr_array((normal.ravel(), column.ravel(), np.arange(len(end) + 1) * d), shape=(len(end), size))
    rows = sp.csr_array(sp.vstack([halves, distance_rows(contacts.select(within))], format="csr"))
    place = np.concatenate([between, between, within])
    owner = cluster_n[np.concatenate([end, contacts.i_c[within]])]
    return rows, owner, contacts.overlap_c[place] / contacts.contact_distance_c[place]


def _shown(
    rows: sp.csr_array,
    owner: NDArray[np.int64],
    force: NDArray[np.float64],
    links: ConstraintFactor,
    cluster_n: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return which rows push as the packing is: overlaps of clusters that rest in balance, if its law is harmonic."""
    push = np.maximum(force, 0.0)
    if not (push > 0.0).any():
        return np.zeros(len(owner), dtype=bool)
    net = rows.T @ push
    net = np.abs(net + links.gradient_lx.T @ links.multipliers(net)).reshape(len(cluster_n), -1).max(axis=1)
    worst = np.zeros(int(cluster_n.max()) + 1)
    np.maximum.at(worst, cluster_n, net)
    return np.asarray(_SHOWN * push > worst[owner])


@shown()
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


@shown_as("rattling clusters")
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
    assert isinstance(found, Contacts)
    cluster = packing.cluster_n
    with single_thread():
        independent, _ = ConstraintFactor(packing).independent_rows()
        backbone = _backbone(found, independent)
        rattling = _moving_apart(found.select(backbone), independent)
    held = np.bincount(cluster, ~rattling) > 0
    linked = np.bincount(cluster)[cluster] > 1
    dangling = rattling & linked & (found.count_n() == 0)
    return Rattling(rattling, dangling, cluster, ~held[cluster], backbone)


class _LinkedRows:
    """Changes of distances of contacts and of lengths of independent links, and their normal matrix, factored."""

    def __init__(self, contact_cx: sp.csr_array, link_lx: sp.csr_array) -> None:
        self.contact_cx, self.link_lx = contact_cx, link_lx
        self.matrix = sp.csr_array(sp.vstack([contact_cx, link_lx], format="csr"))
        square = sp.csc_array(self.matrix.T @ self.matrix)
        # without any row everything moves
        self.shift = _RANK**2 * float(abs(square).sum(axis=0).max()) or 1.0
        self.factor: Factorization = factorize(sp.csc_array(square + self.shift * sp.eye_array(square.shape[0])))

    def motions(self, dimension: int) -> NDArray[np.float64]:
        """Return (N, 2 d) two generic motions that change none of the rows."""
        # what inverse iteration leaves of random motions is their part without any extension
        motion = np.random.default_rng(0).normal(size=(self.matrix.shape[1], 2))
        for _ in range(_SWEEPS):
            motion = self.shift * self.factor.solve(motion)
        return motion.reshape(-1, 2 * dimension)

    def moving(self, dimension: int) -> NDArray[np.bool_]:
        """Return (N,) which particles move in a generic motion that changes none of the rows."""
        return np.asarray(np.abs(self.motions(dimension)).max(axis=1) > _STILL)


def pushing_rows(push: sp.csr_array, links: sp.csr_array) -> NDArray[np.bool_]:
    """Return which rows push in some balance of pushes, none of them a pull, and of links that do either.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no solver could tell.

    """
    count, free = push.shape[0], links.shape[0]
    if not count:
        return np.zeros(0, dtype=bool)
    # s = p + q with p at most 1: the largest sum of p has p = 1 wherever any balance pushes
    equal = sp.csr_array(sp.hstack([push.T, push.T, links.T], format="csr"))
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
        sure = np.abs(found.x[:count] - 0.5).min() > _SURE
        if found.solve.outcome is Outcome.CONVERGED and sure:
            return np.asarray(found.x[:count] > 0.5)
    raise np.linalg.LinAlgError(f"packing must have contacts whose balances can be found, got: {'; '.join(states)}")


def _backbone(contacts: Contacts, independent: sp.csr_array) -> NDArray[np.bool_]:
    """Return which contacts bear a force in some state of self stress that pulls nowhere."""
    if not len(contacts):
        return np.zeros(0, dtype=bool)
    rows, overlap = _LinkedRows(distance_rows(contacts), independent), np.maximum(contacts.overlap_c, 0.0)
    # forces of the harmonic law, and of Hertz's
    if any(_balance_nearby(rows, overlap**power / contacts.contact_distance_c) for power in (1.0, 1.5)):
        return np.ones(len(contacts), dtype=bool)
    return pushing_rows(rows.contact_cx, rows.link_lx)


def _balance_nearby(rows: _LinkedRows, force_c: NDArray[np.float64]) -> bool:
    """Return whether the balance nearest to the given forces pushes at every contact.

    A soft packing at rest shows a state of self stress by its overlaps, whatever its law: where it is the only one, it
    is the nearest balance to anything that it is not orthogonal to; where there are more, overlaps are near enough.
    """
    if not (force_c > 0.0).any():
        return False
    count = len(force_c)
    contact, link = rows.contact_cx, rows.link_lx
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
    """Return (N,) what moves differently from the largest group of particles that contacts and links hold together."""
    return _moving_apart(backbone, ConstraintFactor(packing).independent_rows()[0])


def _moving_apart(backbone: Contacts, independent: sp.csr_array) -> NDArray[np.bool_]:
    particles = backbone.particles
    if not len(backbone):
        return np.ones(particles, dtype=bool)
    blocks = _LinkedRows(distance_rows(backbone), independent).motions(backbone.dimension)
    size = float(np.sqrt((blocks**2).mean()))
    label = np.zeros(particles, dtype=np.int64)
    for column in blocks.T:
        order = np.argsort(column, kind="stable")
        split = np.concatenate([[0], np.cumsum(np.diff(column[order]) > _STILL * size)])
        part = np.empty(particles, dtype=np.int64)
        part[order] = split
        _, label = np.unique(label * (particles + 1) + part, return_inverse=True)
    same = label == int(np.bincount(label).argmax())
    # a group that nothing holds together is none
    return np.asarray(~same) if len(backbone.among(same)) else np.ones(particles, dtype=bool)


@honors("links shapes", packing_only=True)
def find_rattlers(
    packing: Packing,
    *,
    gap_tolerance: float | None = None,
    contacts: Contacts | ShapeContacts | None = None,
    effects: tuple[Any, ...] = (),
) -> NDArray[np.bool_]:
    """Return, for each particle, whether it rattles: its contacts with particles that do not rattle fail to hold it.

    A particle is held when its contact normals positively span the space. Particles in contact with none are rattlers.
    With rigid links it is held if no motion that its cluster's links admit moves it while its contacts stay closed:
    a particle without contacts may be held by its links, and the end of a chain rattles while the rest is held.

    Ellipses and spheroids are held by at least d + 1 contacts that can balance force and torque on them; three whose
    normals meet in one point hold an ellipse.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`. It is not that of `classify_jamming`, which
        goes by the mean overlap: `contacts=verdict.touching.contacts` gives the pairs that a verdict took.
    contacts
        The contacts to judge by instead of those within `gap_tolerance`.
    effects
        Effects of a scene that hold particles beside contacts, such as interactions beyond them and walls: with these
        linked particles rattle as a cluster.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the contacts are not those of the packing as it stands.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> int(find_rattlers(crystal).sum())
    0
    >>> apart = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=-1e-6)
    >>> int(find_rattlers(apart).sum()), int(find_rattlers(apart, gap_tolerance=1e-5).sum())
    (9, 0)

    """
    instance("packing", packing, Packing)
    no_tangential("packing", packing)
    no_own_images("packing", packing)
    if contacts is None:
        contacts = touching_pairs(packing, gap_tolerance)
    else:
        check_given(packing, contacts)
    acting = Scene(packing, effects).effects
    return rattlers_among(packing, contacts, acting) if acting else rattling_particles(packing, contacts)


@honors("links shapes", packing_only=True)
def remove_rattlers(
    packing: Packing, *, gap_tolerance: float | None = None, contacts: Contacts | ShapeContacts | None = None
) -> tuple[Packing, NDArray[np.int64]]:
    """Return the packing without its rattlers, and the (N',) numbers that its particles had before.

    Clusters are cut where only a part of them rattles: links between particles that are left stay, others go. Distances
    that those held (of a rigid part that turns about two of its particles, say) become links of shape.

    Parameters
    ----------
    packing, gap_tolerance, contacts
        As in `find_rattlers`: pairs touch up to a relative gap of 1e-9 unless another is given.

    Raises
    ------
    ValueError
        If every particle rattles, so that nothing is left.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    >>> backbone, index_n = remove_rattlers(crystal)
    >>> backbone == crystal, index_n.tolist()
    (True, [0, 1, 2, 3, 4, 5, 6, 7])

    """
    rattling = find_rattlers(packing, gap_tolerance=gap_tolerance, contacts=contacts)
    if rattling.all():
        raise ValueError(f"packing must have particles that do not rattle, got {packing.particles} rattlers")
    return without(packing, rattling)


def without(packing: Packing, rattling_n: NDArray[np.bool_]) -> tuple[Packing, NDArray[np.int64]]:
    """Return the packing without the named particles and their links, and the numbers that the others had before."""
    kept = np.flatnonzero(~rattling_n)
    return packing.replace(links=_with_inner_links(packing, rattling_n)).select(kept), kept


def _with_inner_links(packing: Packing, rattling_n: NDArray[np.bool_]) -> Links:
    """Return the links, and shape links for the distances that held particles have by way of those taken out."""
    links = packing.links
    ends = np.stack([links.i_l, links.j_l], axis=1)
    between = np.flatnonzero(rattling_n[ends].all(axis=1))
    part = links.select(between).clusters(packing.particles) if len(between) else np.arange(packing.particles)
    rim = np.flatnonzero(rattling_n[ends].sum(axis=1) == 1)
    found: list[tuple[int, int, NDArray[np.int64]]] = []
    for p in np.unique(part[ends[rim][rattling_n[ends[rim]]]]):
        inside = rattling_n & (part == p)
        edge = ends[inside[ends].any(axis=1)].ravel()
        edge = np.unique(edge[~inside[edge]])
        if len(edge) > 1:
            near = inside.copy()
            near[edge] = True
            found += _held_pairs(packing, links.select(near[ends].all(axis=1)), edge)
    if not found:
        return links
    i, j, image = (np.array(column) for column in zip(*found, strict=True))
    vector = packing.position_nd[j] - packing.position_nd[i] + image @ packing.box.lattice_dd.T
    return Links(
        np.concatenate([links.i_l, i]),
        np.concatenate([links.j_l, j]),
        np.concatenate([links.image_ld, image]),
        np.concatenate([links.length_l, np.sqrt((vector**2).sum(axis=1))]),
        np.concatenate([links.shape_l, np.ones(len(i), dtype=bool)]),
    )


def _held_pairs(packing: Packing, links: Links, edge: NDArray[np.int64]) -> list[tuple[int, int, NDArray[np.int64]]]:
    """Return pairs among the particles `edge`, with images, whose distance the links hold and those among them do not.

    To first order; each pair found counts as linked for those after it.
    """
    offset, _ = image_offsets(links, packing.particles)
    pairs = list(itertools.combinations(edge.tolist(), 2))
    i, j = np.array(pairs).T
    image = offset[j] - offset[i]
    own = pair_contacts(packing, links.i_l, links.j_l, links.image_ld)
    column = np.unique(np.concatenate([links.i_l, links.j_l]))
    column = (column[:, None] * packing.dimension + np.arange(packing.dimension)).ravel()
    row_l = distance_rows(own)[:, column].toarray()
    row_p = distance_rows(pair_contacts(packing, i, j, image))[:, column].toarray()
    known = row_l[np.isin(links.i_l, edge) & np.isin(links.j_l, edge)]
    found = []
    for k, row in enumerate(row_p):
        if _spanned(row, row_l) and not _spanned(row, known):
            found.append((*pairs[k], image[k]))
            known = np.vstack([known, row])
    return found


def _spanned(row: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether a row is a combination of the others."""
    if not len(others):
        return False
    share = np.linalg.lstsq(others.T, row, rcond=DEPENDENT)[0]
    return bool(np.abs(row - others.T @ share).max() < DEPENDENT)
