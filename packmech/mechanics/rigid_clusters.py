"""Rigid clusters: what moves as one in every motion that a network of contacts and links admits.

A random motion among those that change no contact is generic: with probability one two parts of the network stand
still against each other in it only if they do in all of them. In the plane every bar between two points turns at one
rate; bars that share a point are rigid with each other where their rates are the same. In space two bars that share a
point and whose far ends keep their distance make a corner, which turns as a whole. A particle whose spin contacts
resist turns at a rate of its own. Then it is proven that each cluster is rigid by the contacts within it, whose rank is
counted, and that no two which touch are one: they turn at different rates.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from packmech.calls.display import counted, shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import brief, instance, integer, one_of, real
from packmech.constraints.factor import link_pairs
from packmech.contacts import Contacts
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import pair_rows
from packmech.contacts.given import contacts_of
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.contacts.tangential_elements import slip_slopes
from packmech.effects import (
    acting_contacts,
    held_particles,
    refuse_unknown_to_shapes,
    rolling_spring_of,
    roughness_of,
    twisting_of,
)
from packmech.jit.blas import single_thread
from packmech.linalg.factor import Factorization, eigenvalues_below, factorize
from packmech.links import tree_offsets
from packmech.measure.contact_forces import resting_forces, unless_at_rest
from packmech.mechanics.frictional import springs_at_limit
from packmech.mechanics.pebble_game import play_pebble_game
from packmech.mechanics.self_stress import RANK_TOLERANCE
from packmech.packing import Packing
from packmech.scene import Scene

METHODS = ("null space", "pebble game")
# independent random motions, and random forces
_MOTIONS, _FORCES = 3, 2
# rates of turning, and forces, of random vectors of components of size 1 that count as zero, or so many times what
# rounding makes of them [1]
TOLERANCE, _NOISES = 1e-10, 30.0
# sweeps that take away what is no null vector, and what rounding leaves of it
_SWEEPS, _ROUNDING = 12, 3e-15
# conjugate gradients begin where more than this is left, and end after so many steps, when little of what they began
# with is left, or when steps are as long as no motion is soft
_SOFT, _STEPS, _REDUCED, _LONGEST = 1e-12, 60, 1e-8, 1e6
# motions are soft if the first sweep leaves so many times what it leaves of one at the tolerance
_LEFT = 3.0
# corners flatter than this do not turn as a whole [rad]
_FLAT = 1e-3
# held particles count as on one line in space if the squares of their distances from it are a smaller part of all
_STRAIGHT = 1e-12
_INVERSIONS = 12
# part of the tolerance for singular values that regularizes, and smallest square of it that rounding allows
_SHIFT, _SMALLEST_SHIFT = 3e-3, 1e-15
# clusters of so many coordinates are looked at by singular values
_DENSE = 400


class Joints(NamedTuple):
    """What joins particles: contacts, then links, with the changes that each forbids.

    Attributes
    ----------
    i_e, j_e, image_ed, vector_ed
        Particles, image of the second against the first, and vector between their centers [length].
    rows
        (R, F) derivatives of what is forbidden by the coordinates that there are.
    joint_r
        (R,) the joint of each row.
    column_f
        (F,) numbers of these coordinates among all N q.
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns.
    body_n, held_n
        (N,) particles that something keeps from turning freely; particles that are held.
    contacts
        Number of contacts among the joints.
    bars_e
        (E,) number of bars that each joint is in the pebble game.
    position_nd, lattice_dd
        Places of the particles, and the box [length].

    """

    i_e: NDArray[np.int64]
    j_e: NDArray[np.int64]
    image_ed: NDArray[np.int64]
    vector_ed: NDArray[np.float64]
    rows: sp.csr_array
    joint_r: NDArray[np.int64]
    column_f: NDArray[np.int64]
    turn_nkt: NDArray[np.float64]
    body_n: NDArray[np.bool_]
    held_n: NDArray[np.bool_]
    contacts: int
    bars_e: NDArray[np.int64]
    position_nd: NDArray[np.float64]
    lattice_dd: NDArray[np.float64]

    @property
    def particles(self) -> int:
        """Number of particles."""
        return len(self.body_n)

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes."""
        return int(self.vector_ed.shape[1])

    @property
    def width(self) -> int:
        """Number q of coordinates of a particle."""
        return self.dimension + int(self.turn_nkt.shape[1])


def _words(one: RigidClusters) -> str:
    largest = f", the largest of {one.size_k[0]} particles" if len(one) else ""
    doubt = "" if one.certain else ": not certain"
    return unless_at_rest(one.force_residual, one.at_rest, f"{counted(len(one), 'rigid cluster')}{largest}{doubt}")


@shown(_words)
@dataclass(frozen=True, eq=False)
class RigidClusters:
    """Rigid clusters of a network of contacts and links, the largest first, and what is over-constrained.

    Attributes
    ----------
    packing, contacts
        The packing, and the contacts that were looked at; its links are joints, too.
    cluster_c, cluster_l
        (C,), (L,) the cluster of each contact and link; -1 for those between particles that turn against each other. In
        space one may be the hinge of several, of which it has the largest.
    start_k, member_m
        Particles of cluster k are member_m[start_k[k] : start_k[k + 1]] (`particles_of`); those that turn freely may be
        in several, of which they are pivots.
    overconstrained_c, overconstrained_l
        (C,), (L,) which carry a state of self stress: without one of them the same motions are left.
    sliding_c
        (C,) contacts at the Coulomb limit, which resist nothing across; so do all without friction.
    winding_kd
        (K, d) along which lattice vectors clusters wind around the box; one that winds cannot turn.
    own_rank_k, rigid_rank_k
        (K,) rank of the rows within each cluster alone, and that of one which is rigid: its coordinates less d (d + 1)
        / 2 rigid motions, or less d where it winds, or less the rotations about held particles where it has any. Where
        the former is smaller others help to hold it.
    smallest_k
        (K,) smallest singular value of these rows beyond the rigid motions, over a bound on the largest of all [1];
        nan for one joint alone, which is rigid.
    rank, rows
        Rank of all rows, and their number: one for each normal direction of a contact or link, more with friction.
    floppy_modes, states_of_self_stress
        Numbers of independent motions besides uniform translations, and of forces in balance.
    within, between
        Largest difference of rates within a cluster, and smallest between two that touch, of random motions of size
        1 [1].
    free_stress, least_stress
        Largest part of random states of self stress, of size 1, in joints that count as carrying none, and smallest in
        those that count as over-constrained [1].
    residual
        Largest change of a joint in the random motions, and largest net force in the random states [1].
    force_residual, at_rest
        Of a scene with friction, as in `ContactForces`.
    certain
        Whether all answers are about the same motions: the rank of all rows is the same for a tolerance ten times
        smaller, random motions and states found no singular value below that but for zeros, states of self stress are
        counted if and only if some joint is over-constrained, the inertia of the clusters' own rows agrees with
        `own_rank_k`, and rates and stresses that count as zero are a tenth of the others or less. Of counting, whether
        no disc that contacts turn has one that slides: a normal force turns no disc, which counting does not know.
    method
        "null space" or "pebble game". Counting knows no numbers: they are nan, and own ranks are those of rigid ones.
    seconds
        CPU time.

    """

    packing: Packing
    contacts: Contacts | ShapeContacts
    cluster_c: NDArray[np.int64]
    cluster_l: NDArray[np.int64]
    start_k: NDArray[np.int64]
    member_m: NDArray[np.int64]
    overconstrained_c: NDArray[np.bool_]
    overconstrained_l: NDArray[np.bool_]
    sliding_c: NDArray[np.bool_]
    winding_kd: NDArray[np.bool_]
    own_rank_k: NDArray[np.int64]
    rigid_rank_k: NDArray[np.int64]
    smallest_k: NDArray[np.float64]
    rank: int
    rows: int
    floppy_modes: int
    states_of_self_stress: int
    within: float
    between: float
    free_stress: float
    least_stress: float
    residual: float
    force_residual: float
    at_rest: bool
    certain: bool
    method: str
    seconds: float

    def __len__(self) -> int:
        return len(self.start_k) - 1

    @property
    def size_k(self) -> NDArray[np.int64]:
        """The (K,) numbers of particles of the clusters."""
        return np.diff(self.start_k)

    @property
    def largest_fraction(self) -> float:
        """Part of all particles that are in the largest cluster [1]."""
        return float(self.size_k[0] / self.packing.particles) if len(self) else 0.0

    @property
    def percolates(self) -> bool:
        """Whether some cluster winds around the box."""
        return bool(self.winding_kd.any())

    @property
    def self_held_k(self) -> NDArray[np.bool_]:
        """The (K,) clusters that are rigid by the joints within them alone, as the rank of their own rows proves."""
        return np.asarray(self.own_rank_k == self.rigid_rank_k)

    @property
    def pivots_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that are in several clusters, which turn against each other about them."""
        return np.asarray(np.bincount(self.member_m, minlength=self.packing.particles) > 1)

    def particles_of(self, cluster: int) -> NDArray[np.int64]:
        """Return the particles of a cluster."""
        k = integer("cluster", cluster, at_least=0)
        if k >= len(self):
            raise ValueError(f"cluster must be below {len(self)}, the number of rigid clusters, got {k}")
        return self.member_m[self.start_k[k] : self.start_k[k + 1]]


@shown_as("rigid clusters")
@honors(
    "repulsion kinds friction rolling held links shapes",
    at_rest=True,
    remarks={
        "bonds": "springs hold no length; links do: packing.replace(links=pm.Links(i_l, j_l, image_ld, length_l))"
    },
)
def rigid_clusters(
    packing: Packing | Scene,
    *,
    contacts: Contacts | ShapeContacts | None = None,
    gap_tolerance: float | None = None,
    method: str = "null space",
    rank_tolerance: float = RANK_TOLERANCE,
    tolerance: float = TOLERANCE,
) -> RigidClusters:
    """Return the maximal rigid clusters of a network, in its box of fixed shape, and what is over-constrained.

    Two parts belong to one cluster if they move as one body in every motion that changes no contact and no link.
    Without friction particles are points, joined by contacts and links, and may be pivots of several clusters. With
    friction, and of shapes, a particle is a body, whose spin is in one cluster at most: contacts that stick forbid
    slip, those at the Coulomb limit resist along their normal alone, so that others may turn about the center of a
    disc, and resistance to rolling and twisting forbids these. A particle whose spin nothing resists is a point.
    Particles that are held are one body that does not move, and clusters may turn about one of them.

    Parameters
    ----------
    packing
        The packing, or a scene, whose contacts with friction are those that overlap. Rattlers stay, with their contacts
        (`remove_rattlers` takes them out).
    contacts
        The contacts to use, without friction, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    method
        "null space": from random motions and random states of self stress, of the packing as it is. "pebble game":
        counting, in the plane; it answers for places in no special position, at once.
    rank_tolerance
        Singular values below this fraction of a bound on the largest count as zero [1].
    tolerance
        Rates of turning, and forces, of random motions and states below this are zero, or below thirty times what
        rounding makes of them, as one more sweep shows [1].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, contacts are given for a scene with friction, shapes in
        space turn about some of their axes only, or counting is asked for in space.

    Examples
    --------
    Two triangles that share a particle turn against each other:

    >>> import packmech as pm
    >>> place = [[2.0, 2.0], [1.1, 2.4], [1.1, 1.6], [2.9, 2.4], [2.9, 1.6]]
    >>> pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (0, 4), (3, 4)]
    >>> length = [sum((a - b) ** 2 for a, b in zip(place[i], place[j])) ** 0.5 for i, j in pairs]
    >>> links = pm.Links(*zip(*pairs), [[0, 0]] * 6, length)
    >>> found = pm.rigid_clusters(pm.Packing(place, [0.1] * 5, pm.Box.cubic(4.0, 2), links))
    >>> found.cluster_l.tolist(), found.floppy_modes, found.pivots_n.tolist()
    ([0, 0, 1, 1, 0, 1], 2, [True, False, False, False, False])

    """
    start = time.process_time()
    one_of("method", method, METHODS)
    real("rank_tolerance", rank_tolerance, above=0.0, below=0.1)
    real("tolerance", tolerance, above=0.0, below=0.1)
    scene = packing if isinstance(packing, Scene) else None
    own = packing.packing if isinstance(packing, Scene) else packing
    instance("packing", own, Packing)
    with single_thread():
        joints, touching, sliding, rest = _joints(own, scene, contacts, gap_tolerance)
        if method == "pebble game":
            found = _counted(joints)
        else:
            found = _of_motions(joints, rank_tolerance, tolerance)
    count = joints.contacts
    return RigidClusters(
        packing=own,
        contacts=touching,
        cluster_c=found.cluster_e[:count],
        cluster_l=found.cluster_e[count:],
        start_k=found.start_k,
        member_m=found.member_m,
        overconstrained_c=found.stressed_e[:count],
        overconstrained_l=found.stressed_e[count:],
        sliding_c=sliding,
        winding_kd=found.winding_kd,
        own_rank_k=found.own_rank_k,
        rigid_rank_k=found.rigid_rank_k,
        smallest_k=found.smallest_k,
        rank=found.rank,
        rows=found.rows,
        floppy_modes=found.floppy,
        states_of_self_stress=found.rows - found.rank,
        within=found.within,
        between=found.between,
        free_stress=found.free_stress,
        least_stress=found.least_stress,
        residual=found.residual,
        force_residual=rest[0],
        at_rest=rest[1],
        certain=found.certain,
        method=method,
        seconds=time.process_time() - start,
    )


class _Found(NamedTuple):
    """What a method says, of joints; fields as of `RigidClusters`."""

    cluster_e: NDArray[np.int64]
    start_k: NDArray[np.int64]
    member_m: NDArray[np.int64]
    stressed_e: NDArray[np.bool_]
    winding_kd: NDArray[np.bool_]
    own_rank_k: NDArray[np.int64]
    rigid_rank_k: NDArray[np.int64]
    smallest_k: NDArray[np.float64]
    rank: int
    rows: int
    floppy: int
    within: float
    between: float
    free_stress: float
    least_stress: float
    residual: float
    certain: bool


# -- joints -----------------------------------------------------------------------------------------------------------


def _joints(
    packing: Packing,
    scene: Scene | None,
    contacts: Contacts | ShapeContacts | None,
    gap_tolerance: float | None,
) -> tuple[Joints, Contacts | ShapeContacts, NDArray[np.bool_], tuple[float, bool]]:
    """Return what joins particles, the contacts among it, which slide, and residual and rest of the forces."""
    effects = () if scene is None else scene.effects
    d, rest = packing.dimension, (0.0, True)
    if scene is not None and roughness_of(effects) is not None:
        for name, given in (("contacts", contacts), ("gap_tolerance", gap_tolerance)):
            if given is not None:
                raise ValueError(
                    f"{name} must be None for a scene with friction, whose contacts are overlaps, got {brief(given)}"
                )
        forces = resting_forces(scene)
        touching, turn, rest = forces.contacts, packing.spin_nkk, (forces.residual, forces.at_rest)
        slides = springs_at_limit(forces)[0]
        sticks = (forces.coefficient_c > 0.0) & ~slides[0]
        resists = [
            np.full(len(touching), one is not None and one.coefficient > 0.0) & ~at_limit
            for one, at_limit in zip((rolling_spring_of(effects), twisting_of(effects)), slides[1:], strict=True)
        ]
    else:
        if scene is not None:
            refuse_unknown_to_shapes(scene)
        touching, turn = acting_contacts(contacts_of(packing, contacts, gap_tolerance), effects), packing.turn_nkt
        slides, sticks = np.zeros((3, len(touching)), dtype=bool), np.zeros(len(touching), dtype=bool)
        resists = [sticks, sticks]
    links = link_pairs(packing)
    shift = len(touching)
    parts = [(np.arange(shift), touching.slope_cx), (shift + np.arange(len(links)), links.slope_cx)]
    parts += _rows_across(packing, touching, sticks, resists)
    i, j = (np.concatenate([getattr(touching, name), getattr(links, name)]) for name in ("i_c", "j_c"))
    matrix = sp.vstack([pair_rows(i[one], j[one], slope, turn, d) for one, slope in parts], format="csc")
    joint_r = np.concatenate([one for one, _ in parts])
    held = held_particles(effects, packing.particles)
    held = np.zeros(packing.particles, dtype=bool) if held is None else held
    resisted = (np.asarray(abs(matrix).sum(axis=0)) > 0.0).reshape(packing.particles, -1)
    free = np.ones_like(resisted)
    free[:, d:] = resisted[:, d:]
    turns = free[:, d:].sum(axis=1)
    if d == 3 and ((turns > 0) & (turns < 3)).any():
        n = int(np.argmax((turns > 0) & (turns < 3)))
        raise ValueError(
            "packing must be of particles that turn about all their axes or about none for pm.rigid_clusters, got "
            f"particle {n}, which contacts resist about {turns[n]} of 3"
        )
    free[held] = False
    column = np.flatnonzero(free.ravel())
    bars = np.concatenate([1 + sticks.astype(np.int64) + resists[0], np.ones(len(links), dtype=np.int64)])
    return (
        Joints(
            i,
            j,
            np.concatenate([touching.pairs.image_cd, links.image_cd]),
            np.concatenate([touching.vector_cd, links.vector_cd]),
            sp.csr_array(matrix[:, column]),
            joint_r,
            column,
            turn,
            (turns > 0) & ~held,
            held,
            shift,
            bars,
            packing.position_nd,
            packing.box.lattice_dd,
        ),
        touching,
        slides[0],
        rest,
    )


def _rows_across(
    packing: Packing,
    contacts: Contacts | ShapeContacts,
    sticks_c: NDArray[np.bool_],
    resists: list[NDArray[np.bool_]],
) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Return joints and slopes of slip, rolling and twisting, where contacts resist them."""
    if not any(one.any() for one in (sticks_c, *resists)):
        return []
    d, normal = packing.dimension, contacts.normal_cd
    t = 1 if d == 2 else 3
    across = _tangents(normal)
    slip = slip_slopes(contacts, packing.radius_n)
    length = 0.5 * (packing.radius_n[contacts.i_c] + packing.radius_n[contacts.j_c])
    found = []
    for a in range(d - 1):
        found.append((sticks_c, np.einsum("ca,cax->cx", across[:, a], slip)))
    axes = [np.ones((len(normal), 1))] if d == 2 else [across[:, 0], across[:, 1], normal]
    for axis, resisted in zip(axes, (resists[0], resists[0], resists[1]), strict=False):
        turned = np.zeros((len(normal), d + 2 * t))
        turned[:, d : d + t], turned[:, d + t :] = -length[:, None] * axis, length[:, None] * axis
        found.append((resisted, turned))
    return [(np.flatnonzero(there), slope[there]) for there, slope in found]


def _tangents(normal_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (C, d - 1, d) unit vectors across the normals and each other."""
    if normal_cd.shape[1] == 2:
        return np.stack([-normal_cd[:, 1], normal_cd[:, 0]], axis=1)[:, None]
    aside = np.zeros_like(normal_cd)
    aside[np.arange(len(normal_cd)), np.abs(normal_cd).argmin(axis=1)] = 1.0
    first = np.cross(normal_cd, aside)
    first /= np.sqrt((first**2).sum(axis=1, keepdims=True))
    return np.stack([first, np.cross(normal_cd, first)], axis=1)


# -- random motions and states of self stress -------------------------------------------------------------------------


def _bound(square: sp.csc_array) -> float:
    """Return a bound on the largest eigenvalue of a symmetric matrix."""
    return float(abs(square).sum(axis=0).max()) if square.nnz else 1.0


def _resolved(tolerance: float) -> float:
    """Return the singular value below which random motions keep what a matrix changes, over the bound [1]."""
    return float(np.sqrt(max((_SHIFT * tolerance) ** 2, _SMALLEST_SHIFT)))


def _shifted(square: sp.csc_array, tolerance: float) -> Factorization:
    """Return a matrix A^T A factored, with less than what counts as zero on its diagonal."""
    shift = _resolved(tolerance) ** 2 * _bound(square)
    return factorize(sp.csc_array(square + shift * sp.eye_array(square.shape[0])), kind="symmetric")


def _ranks(square: sp.csc_array, tolerance: float) -> tuple[int, bool]:
    """Return the rank of a matrix A from A^T A, and whether it is the same for a tolerance ten times smaller."""
    if not square.nnz:
        return 0, True
    rank, most = (
        square.shape[0] - eigenvalues_below(square, (one * tolerance) ** 2 * _bound(square)) for one in (1.0, 0.1)
    )
    # inertia does not resolve what motions do not
    return rank, rank == most and 0.1 * tolerance >= _resolved(tolerance)


class _NullVectors(NamedTuple):
    """Random motions and forces in balance, rows^T rows, what is left of the rows, and by how much rounding moves both.

    A soft motion takes little of a random one from the rows, so that rounding there makes much of it. `soft` is whether
    there are motions softer than the tolerance that are not of singular value 0: the sweeps find what inertia cannot.
    """

    motion_fm: NDArray[np.float64]
    force_rm: NDArray[np.float64]
    square: sp.csc_array
    residual: float
    noise: tuple[float, float]
    soft: bool


def _null_vectors(rows: sp.csr_array, tolerance: float) -> _NullVectors:
    """Return random motions on which rows vanish and random forces in balance.

    Both are what is left of random vectors of components of size 1 as each sweep takes the part s^2 / (s^2 + shift) off
    what has the singular value s.
    """
    rng = np.random.default_rng(0)
    motion = rng.normal(size=(rows.shape[1], _MOTIONS))
    force = rng.normal(size=(rows.shape[0], _FORCES))
    turned = sp.csr_array(rows.T)
    square = sp.csc_array(turned @ rows)
    if not rows.nnz:
        return _NullVectors(motion, force, square, 0.0, (0.0, 0.0), False)
    solve = _shifted(square, tolerance).solve

    def sweep() -> tuple[float, tuple[float, float]]:
        """Take off what the sweep takes; return what was left of the rows, and how far motions and forces moved."""
        nonlocal motion, force
        changed, pushed = rows @ motion, turned @ force
        step = solve(np.hstack([turned @ changed, pushed]))
        motion, push = motion - step[:, :_MOTIONS], rows @ step[:, _MOTIONS:]
        force = force - push
        left = max(float(np.abs(changed).max()), float(np.abs(pushed).max()))
        return left, (float(np.abs(step[:, :_MOTIONS]).max()), float(np.abs(push).max()))

    sweep()
    # the first leaves shift / s of what has the singular value s
    size = max(float(np.linalg.norm(one, axis=0).max(initial=0.0)) for one in (rows @ motion, turned @ force))
    soft = size > _LEFT * _resolved(tolerance) ** 2 / tolerance * np.sqrt(_bound(square))
    for _ in range(_SWEEPS - 1):
        left, noise = sweep()
        if left <= _ROUNDING:
            break
    # what is left is soft: some few motions, of which each step takes one away
    if left > _SOFT:
        soft = True
        step, force_left = _least_squares(rows, turned, solve, np.hstack([rows @ motion, force]))
        motion, force = motion - step[:, :_MOTIONS], force_left[:, _MOTIONS:]
        for _ in range(2):
            _, noise = sweep()
    error = max(float(np.abs(rows @ motion).max()), float(np.abs(turned @ force).max()))
    return _NullVectors(motion, force, square, error, noise, soft)


def _least_squares(
    rows: sp.csr_array,
    turned: sp.csr_array,
    solve: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    right_rk: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x with the smallest |right - rows x|, and right - rows x, by preconditioned conjugate gradients."""
    x, left = np.zeros((rows.shape[1], right_rk.shape[1])), right_rk.copy()
    slope = turned @ left
    ahead = solve(slope)
    along, size = ahead.copy(), (slope * ahead).sum(axis=0)
    active, least = size > 0.0, _REDUCED**2 * size
    for _ in range(_STEPS):
        change = rows @ along
        cost = (change**2).sum(axis=0)
        # a direction that changes nothing is rounding
        active &= (size > least) & (_LONGEST * cost > size)
        if not active.any():
            break
        step = np.where(active, size / np.where(active, cost, 1.0), 0.0)
        x += step * along
        left -= step * change
        slope = turned @ left
        ahead = solve(slope)
        now = (slope * ahead).sum(axis=0)
        along = ahead + np.where(active, now / np.where(active, size, 1.0), 0.0) * along
        size = now
    return x, left


# -- clusters of what turns at one rate -------------------------------------------------------------------------------


class _Parts(NamedTuple):
    """What turns as a whole, bars between points in the plane, corners in space, then bodies: rates and members.

    Part part_m has the particle particle_m, and part owner_o the joint joint_o. `between` is the smallest rate at which
    two bars that share a point change the distance of their far ends, if they do [1].
    """

    rate_px: NDArray[np.float64]
    part_m: NDArray[np.int64]
    particle_m: NDArray[np.int64]
    owner_o: NDArray[np.int64]
    joint_o: NDArray[np.int64]
    between: float


class _Motion(NamedTuple):
    """Random motions: velocities, spins times the mean length of joints, and that length."""

    velocity_ndm: NDArray[np.float64]
    spin_ntm: NDArray[np.float64]
    length: float


def _of_motions(joints: Joints, rank_tolerance: float, tolerance: float) -> _Found:
    """Return rigid clusters from random motions."""
    n, d, t = joints.particles, joints.dimension, 1 if joints.dimension == 2 else 3
    random, force, square, residual, noise, soft = _null_vectors(joints.rows, rank_tolerance)
    zero_rate, zero_force = (max(tolerance, _NOISES * one) for one in noise)
    motion_f = np.zeros((n * joints.width, _MOTIONS))
    motion_f[joints.column_f] = random
    whole = motion_f.reshape(n, joints.width, _MOTIONS)
    size_e = np.sqrt((joints.vector_ed**2).sum(axis=1))
    length = float(size_e.mean()) if len(size_e) else 1.0
    spin = np.zeros((n, t, _MOTIONS))
    if joints.turn_nkt.shape[1]:
        spin = length * np.einsum("nkt,nkm->ntm", joints.turn_nkt, whole[:, d:])
    motion = _Motion(whole[:, :d], spin, length)
    far = motion.velocity_ndm[joints.j_e] - motion.velocity_ndm[joints.i_e]
    stretch = np.abs(np.einsum("ea,eam->em", joints.vector_ed, far)).max(axis=1, initial=0.0)
    is_bar = (stretch <= zero_rate * size_e) & (size_e > 0.0)
    parts = _with_bodies(joints, motion, (_bars if d == 2 else _corners)(joints, motion, is_bar, zero_rate))
    label, within, between = _together(joints, parts, motion, zero_rate)
    clusters = _numbered(joints, parts, label, is_bar)
    stress = np.zeros(len(joints.i_e))
    np.maximum.at(stress, joints.joint_r, np.abs(force).max(axis=1))
    stressed = stress > zero_force
    rank, one_rank = _ranks(square, rank_tolerance)
    states = joints.rows.shape[0] - rank
    own = _own_ranks(joints, clusters, rank_tolerance, _bound(square))
    free_stress = float(stress[~stressed].max(initial=0.0))
    least_stress = float(stress[stressed].min(initial=np.inf))
    certain = one_rank and not soft and own.certain and (states > 0) == bool(stressed.any())
    certain = certain and between >= 10.0 * within and least_stress >= 10.0 * free_stress
    translations = 0 if joints.held_n.any() else d
    return _Found(
        clusters.cluster_e, clusters.start_k, clusters.member_m, stressed, own.winding_kd, own.rank_k, own.rigid_k,
        own.smallest_k, rank, joints.rows.shape[0], joints.rows.shape[1] - rank - translations, within, between,
        free_stress, least_stress, residual, certain,
    )  # fmt: skip


def _bars(joints: Joints, motion: _Motion, is_bar: NDArray[np.bool_], tolerance: float) -> _Parts:
    """Return the bars in the plane that end at a point."""
    point = ~(joints.body_n | joints.held_n)
    bar = np.flatnonzero(is_bar & (point[joints.i_e] | point[joints.j_e]))
    i, j, vector = joints.i_e[bar], joints.j_e[bar], joints.vector_ed[bar]
    far = motion.velocity_ndm[j] - motion.velocity_ndm[i]
    across = vector[:, 0, None] * far[:, 1] - vector[:, 1, None] * far[:, 0]
    rate = motion.length * across / (vector**2).sum(axis=1)[:, None]
    own = np.arange(len(bar))
    return _Parts(rate, np.tile(own, 2), np.concatenate([i, j]), own, bar, np.inf)


def _corners(joints: Joints, motion: _Motion, is_bar: NDArray[np.bool_], tolerance: float) -> _Parts:
    """Return pairs of bars in space that share a point and whose far ends keep their distance."""
    point = ~(joints.body_n | joints.held_n)
    bar = np.flatnonzero(is_bar)
    apex = np.concatenate([joints.i_e[bar], joints.j_e[bar]])
    end = np.concatenate([joints.j_e[bar], joints.i_e[bar]])
    arm = np.concatenate([joints.vector_ed[bar], -joints.vector_ed[bar]])
    order = np.flatnonzero(point[apex])
    order = order[np.argsort(apex[order], kind="stable")]
    apex, end, arm, bar = apex[order], end[order], arm[order], np.tile(bar, 2)[order]
    far = motion.velocity_ndm[end] - motion.velocity_ndm[apex]
    found, between = [], np.inf
    for shift in range(1, int(np.bincount(apex).max(initial=0))):
        one = np.flatnonzero(apex[shift:] == apex[:-shift])
        other = one + shift
        apart = arm[other] - arm[one]
        size = np.sqrt((apart**2).sum(axis=1))
        cross = np.cross(arm[one], arm[other])
        square = (arm[one] ** 2).sum(axis=1) * (arm[other] ** 2).sum(axis=1)
        bent = (cross**2).sum(axis=1) > _FLAT**2 * square
        one, other, apart, size = one[bent], other[bent], apart[bent], size[bent]
        change = np.abs(np.einsum("ca,cam->cm", apart, far[other] - far[one])).max(axis=1, initial=0.0) / size
        rigid = change <= tolerance
        between = min(between, float(change[~rigid].min(initial=np.inf)))
        found.append(np.stack([one[rigid], other[rigid]]))
    one, other = np.concatenate(found, axis=1) if found else np.zeros((2, 0), dtype=np.int64)
    # least squares of w x arm = velocity, for both arms
    inertia, moment = np.zeros((len(one), 3, 3)), np.zeros((len(one), 3, far.shape[2]))
    for side in (one, other):
        a = arm[side]
        inertia += (a**2).sum(axis=1)[:, None, None] * np.eye(3) - a[:, :, None] * a[:, None, :]
        moment += np.cross(a[:, :, None], far[side], axis=1)
    rate = np.asarray(motion.length * np.linalg.solve(inertia, moment), dtype=np.float64)
    own = np.arange(len(one))
    return _Parts(
        rate.reshape(len(one), 3 * far.shape[2]),
        np.tile(own, 3),
        np.concatenate([apex[one], end[one], end[other]]),
        np.tile(own, 2),
        np.concatenate([bar[one], bar[other]]),
        between,
    )


def _with_bodies(joints: Joints, motion: _Motion, parts: _Parts) -> _Parts:
    """Return the parts with all bodies after them."""
    body = np.flatnonzero(joints.body_n | joints.held_n)
    number = len(parts.rate_px) + np.arange(len(body))
    rate = motion.spin_ntm[body].reshape(len(body), parts.rate_px.shape[1])
    return parts._replace(
        rate_px=np.concatenate([parts.rate_px, rate]),
        part_m=np.concatenate([parts.part_m, number]),
        particle_m=np.concatenate([parts.particle_m, body]),
    )


def _together(
    joints: Joints, parts: _Parts, motion: _Motion, tolerance: float
) -> tuple[NDArray[np.int64], float, float]:
    """Return the cluster of each part, the largest difference within one, and the smallest between two that touch."""
    rate, count = parts.rate_px, len(parts.rate_px)
    edges, within, between = [np.zeros((2, 0), dtype=np.int64)], 0.0, np.inf
    rng = np.random.default_rng(1)
    # parts of a particle that turn at one rate stand together in order of any component; twice, for what is in between
    for _ in range(2):
        component = rate @ rng.normal(size=rate.shape[1])
        order = np.lexsort((component[parts.part_m], parts.particle_m))
        particle, part = parts.particle_m[order], parts.part_m[order]
        near = np.flatnonzero(particle[1:] == particle[:-1])
        apart = np.abs(rate[part[near + 1]] - rate[part[near]]).max(axis=1, initial=0.0)
        same = apart <= tolerance
        within = max(within, float(apart[same].max(initial=0.0)))
        edges.append(np.stack([part[near][same], part[near + 1][same]]))
    edge, slip = _body_joints(joints, motion, count)
    same = slip <= tolerance
    within = max(within, float(slip[same].max(initial=0.0)))
    between = float(slip[~same].min(initial=np.inf))
    edges.append(edge[:, same])
    # what is held is one body
    held = _body_numbers(joints, count)[joints.held_n]
    edges.append(np.stack([np.repeat(held[:1], len(held)), held]))
    one, other = np.concatenate(edges, axis=1)
    label = connected_components(sp.coo_array((np.ones(len(one)), (one, other)), shape=(count, count)), directed=False)[
        1
    ].astype(np.int64)
    between = min(between, parts.between, _smallest_apart(parts, label))
    return label, within, between


def _body_numbers(joints: Joints, parts: int) -> NDArray[np.int64]:
    """Return the (N,) numbers of bodies among so many parts, which they are the last of; -1 for points."""
    body = joints.body_n | joints.held_n
    return np.where(body, parts - int(body.sum()) + np.cumsum(body) - 1, -1)


def _body_joints(joints: Joints, motion: _Motion, parts: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return joints between two bodies as pairs of parts, and how these move against each other in them [1]."""
    number = _body_numbers(joints, parts)
    both = np.flatnonzero((number[joints.i_e] >= 0) & (number[joints.j_e] >= 0) & (joints.i_e != joints.j_e))
    i, j, vector = joints.i_e[both], joints.j_e[both], joints.vector_ed[both] / motion.length
    turned = motion.spin_ntm[j] - motion.spin_ntm[i]
    far, spin = motion.velocity_ndm[j] - motion.velocity_ndm[i], motion.spin_ntm[i]
    if joints.dimension == 2:
        carried = np.stack([-spin[:, 0] * vector[:, 1, None], spin[:, 0] * vector[:, 0, None]], axis=1)
    else:
        carried = np.cross(spin, vector[:, :, None], axis=1)
    apart = np.abs(np.concatenate([turned, far - carried], axis=1)).max(axis=(1, 2), initial=0.0)
    return np.stack([number[i], number[j]]), apart


def _smallest_apart(parts: _Parts, label_p: NDArray[np.int64]) -> float:
    """Return the smallest difference of the rates of two clusters that share a particle."""
    clusters = int(label_p.max(initial=-1)) + 1
    first = np.zeros(clusters, dtype=np.int64)
    first[label_p[::-1]] = np.arange(len(label_p))[::-1]
    pair = np.unique(parts.particle_m * clusters + label_p[parts.part_m]) if clusters else np.zeros(0, dtype=np.int64)
    particle, cluster = pair // max(clusters, 1), pair % max(clusters, 1)
    rate, smallest = parts.rate_px[first], np.inf
    for shift in range(1, int(np.bincount(particle).max(initial=0))):
        same = np.flatnonzero(particle[shift:] == particle[:-shift])
        apart = np.abs(rate[cluster[same + shift]] - rate[cluster[same]]).max(axis=1, initial=0.0)
        smallest = min(smallest, float(apart.min(initial=np.inf)))
    return smallest


class _Clusters(NamedTuple):
    """Clusters by their particles, and which joints belong to which; `turns_m` are bodies among the particles."""

    cluster_e: NDArray[np.int64]
    start_k: NDArray[np.int64]
    member_m: NDArray[np.int64]
    turns_m: NDArray[np.bool_]
    cluster_o: NDArray[np.int64]
    joint_o: NDArray[np.int64]

    @property
    def cluster_m(self) -> NDArray[np.int64]:
        """The cluster of each member."""
        return np.repeat(np.arange(len(self.start_k) - 1), np.diff(self.start_k))


def _numbered(joints: Joints, parts: _Parts, label_p: NDArray[np.int64], is_bar: NDArray[np.bool_]) -> _Clusters:
    """Return the clusters in order of their sizes, bodies alone left out."""
    n, count = joints.particles, len(parts.rate_px)
    number = _body_numbers(joints, count)
    cluster, joint = label_p[parts.owner_o], parts.joint_o
    body = np.full(n, -1, dtype=np.int64)
    body[number >= 0] = label_p[number[number >= 0]]
    one, other = body[joints.i_e], body[joints.j_e]
    both = np.flatnonzero((one >= 0) & (one == other))
    cluster, joint = np.concatenate([cluster, one[both]]), np.concatenate([joint, both])
    part, particle = label_p[parts.part_m], parts.particle_m
    clusters = int(label_p.max(initial=-1)) + 1
    if joints.dimension == 3:
        # bars in no corner are clusters of their own
        alone = is_bar & (number[joints.i_e] < 0) | is_bar & (number[joints.j_e] < 0)
        alone[joint] = False
        bars = np.flatnonzero(alone)
        own = clusters + np.arange(len(bars))
        cluster, joint = np.concatenate([cluster, own]), np.concatenate([joint, bars])
        part = np.concatenate([part, own, own])
        particle = np.concatenate([particle, joints.i_e[bars], joints.j_e[bars]])
        clusters += len(bars)
    pair = np.unique(part * n + particle)
    part, particle = pair // n, pair % n
    size = np.bincount(part, minlength=clusters)
    # a body that its own images touch is alone
    counts = (joints.i_e != joints.j_e) | (body[joints.i_e] < 0)
    used = np.bincount(cluster[counts[joint]], minlength=clusters)
    order = np.argsort(-size, kind="stable")
    order = order[used[order] > 0]
    rank = np.full(clusters, -1, dtype=np.int64)
    rank[order] = np.arange(len(order))
    kept = rank[part] >= 0
    sort = np.lexsort((particle[kept], rank[part[kept]]))
    member, owner = particle[kept][sort], rank[part[kept]][sort]
    start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=len(order)))])
    cluster, joint = rank[cluster][rank[cluster] >= 0], joint[rank[cluster] >= 0]
    belong = np.unique(cluster * max(len(joints.i_e), 1) + joint)
    cluster, joint = belong // max(len(joints.i_e), 1), belong % max(len(joints.i_e), 1)
    cluster_e = np.full(len(joints.i_e), -1, dtype=np.int64)
    # the first is the largest
    cluster_e[joint[::-1]] = cluster[::-1]
    whole = np.full(n, -1, dtype=np.int64)
    whole[body >= 0] = rank[body[body >= 0]]
    return _Clusters(cluster_e, start, member, whole[member] == owner, cluster, joint)


# -- proofs -----------------------------------------------------------------------------------------------------------


class _Own(NamedTuple):
    """What the rows within each cluster say; fields as of `RigidClusters`."""

    winding_kd: NDArray[np.bool_]
    rank_k: NDArray[np.int64]
    rigid_k: NDArray[np.int64]
    smallest_k: NDArray[np.float64]
    certain: bool


def _own_ranks(joints: Joints, clusters: _Clusters, tolerance: float, bound: float) -> _Own:
    """Return the rank of the rows within each cluster, all clusters side by side in one matrix.

    Each has its own copies of its particles. Across its rigid motions the softest motion is found by inverse iteration;
    the number of eigenvalues that are zero is that of the rigid motions of all, unless some cluster is not rigid.
    """
    n, d, q, count = joints.particles, joints.dimension, joints.width, len(clusters.start_k) - 1
    key = clusters.cluster_m * n + clusters.member_m
    i, j = (np.searchsorted(key, clusters.cluster_o * n + one[clusters.joint_o]) for one in (joints.i_e, joints.j_e))
    image = joints.image_ed[clusters.joint_o]
    offset = tree_offsets(i, j, image, len(key))
    winding = np.zeros((count, d), dtype=bool)
    np.logical_or.at(winding, clusters.cluster_o, image + offset[i] - offset[j] != 0)
    copies = _copied_rows(joints, clusters, key)
    there = np.zeros((n, q), dtype=bool)
    there.ravel()[joints.column_f] = True
    there = there[clusters.member_m]
    there[:, d:] &= clusters.turns_m[:, None]
    column = np.flatnonzero(there.ravel())
    block = np.repeat(clusters.cluster_m, q)[column]
    rigid = _rigid_motions(joints, clusters, offset, np.asarray(winding.any(axis=1)))[column]
    rigid, free_k = _orthonormal(rigid, block, count)
    size_k = np.bincount(block, minlength=count)
    rigid_rank = size_k - free_k
    # one joint alone
    single = np.bincount(clusters.cluster_o, minlength=count) == 1
    smallest = np.full(count, np.nan)
    kept = ~single[block]
    rows = sp.csr_array(copies[:, column[kept]])
    square = sp.csc_array(rows.T @ rows)
    own_rank, certain = rigid_rank.copy(), True
    if square.nnz:
        value = _softest(square, rigid[kept], block[kept], count, tolerance)
        several = ~single & (rigid_rank > 0)
        smallest[several] = np.sqrt(np.maximum(value[several], 0.0) / bound)
        zeros = eigenvalues_below(square, tolerance**2 * bound)
        soft = several & ~(smallest > tolerance)
        missing = zeros - int(free_k[~single].sum())
        certain = missing == 0 and not soft.any()
        most = own_rank.copy()
        for k in np.flatnonzero(soft):
            own = np.flatnonzero(block[kept] == k)
            found = np.linalg.svd(rows[:, own].toarray(), compute_uv=False) if len(own) <= _DENSE else np.zeros(0)
            own_rank[k], most[k] = (
                np.count_nonzero(found > one * np.sqrt(bound))
                if len(own) <= _DENSE
                else (len(own) - eigenvalues_below(square[own][:, own], one**2 * bound))
                for one in (tolerance, min(_resolved(tolerance), tolerance) if len(own) <= _DENSE else 0.1 * tolerance)
            )
        if soft.any():
            certain = missing == int((rigid_rank - own_rank).sum()) and np.array_equal(own_rank, most)
    return _Own(winding, own_rank, rigid_rank, smallest, certain)


def _copied_rows(joints: Joints, clusters: _Clusters, key: NDArray[np.int64]) -> sp.csc_array:
    """Return the rows of each cluster's joints by the coordinates of its own copies of its particles."""
    n, d, q = joints.particles, joints.dimension, joints.width
    # rows of a joint for each cluster that it is in
    order = np.argsort(joints.joint_r, kind="stable")
    start = np.searchsorted(joints.joint_r[order], np.arange(len(joints.i_e) + 1))
    many = np.diff(start)[clusters.joint_o]
    first = np.repeat(start[clusters.joint_o], many) + np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
    owner = np.repeat(clusters.cluster_o, many)
    rows = sp.coo_array(joints.rows[order[first]])
    row, whole = rows.coords[0], joints.column_f[rows.coords[1]]
    particle, place = whole // q, whole % q
    copy = np.searchsorted(key, owner[row] * n + particle)
    kept = (place < d) | clusters.turns_m[np.minimum(copy, max(len(key) - 1, 0))]
    at = (row[kept], copy[kept] * q + place[kept])
    return sp.csc_array((rows.data[kept], at), shape=(len(owner), len(key) * q))


def _rigid_motions(
    joints: Joints,
    clusters: _Clusters,
    offset_md: NDArray[np.int64],
    winds_k: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return (M q, x) translations and rotations of each cluster, zeros where it cannot move so.

    One that has what is held in it does not move; one that turns about held particles rotates about these alone.
    """
    d, t, q = joints.dimension, 1 if joints.dimension == 2 else 3, joints.width
    cluster, member = clusters.cluster_m, clusters.member_m
    count = len(clusters.start_k) - 1
    place = joints.position_nd[member] + offset_md @ joints.lattice_dd.T
    size = np.maximum(np.bincount(cluster, minlength=count), 1)
    center = np.stack([np.bincount(cluster, place[:, a], count) / size for a in range(d)], axis=1)
    held = joints.held_n[member]
    still, pivot = np.zeros(count, dtype=bool), np.flatnonzero(held & ~clusters.turns_m)
    still[cluster[held & clusters.turns_m]] = True
    pivots = np.bincount(cluster[pivot], minlength=count)
    center[cluster[pivot]] = place[pivot]
    arm = place - center[cluster]
    motion = np.zeros((len(member), q, d + t))
    motion[:, :d, :d] = np.eye(d) * (pivots[cluster] == 0)[:, None, None]
    turning = (~winds_k)[cluster].astype(float)
    motion[:, :d, d:] = turned_arms(arm) * turning[:, None, None]
    turn = joints.turn_nkt[member]
    if turn.shape[1]:
        turned = np.zeros((len(member), turn.shape[1], t))
        body = np.flatnonzero(clusters.turns_m)
        turned[body] = np.linalg.pinv(turn[body]).transpose(0, 2, 1)
        motion[:, d:, d:] = turned * turning[:, None, None]
    if (pivots > 1).any():
        motion[:, :, d:] = motion[:, :, d:] @ _rotations_about(arm[pivot], cluster[pivot], count)[cluster]
    motion[still[cluster]] = 0.0
    return motion.reshape(-1, d + t)


def _rotations_about(arm_pd: NDArray[np.float64], cluster_p: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Return (K, t, t) rotations of each cluster that leave its held particles where they are, zeros for the rest."""
    turned = turned_arms(arm_pd)
    moved = np.zeros((count, turned.shape[2], turned.shape[2]))
    np.add.at(moved, cluster_p, turned.transpose(0, 2, 1) @ turned)
    value, vector = np.linalg.eigh(moved)
    return np.asarray(vector * (value <= _STRAIGHT * value.sum(axis=1, keepdims=True))[:, None])


def _orthonormal(
    motion_fx: NDArray[np.float64], block_f: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the motions made orthonormal within each block, zeros for those that depend on others, and how many."""
    found, rank = np.zeros_like(motion_fx), np.zeros(count, dtype=np.int64)
    for x in range(motion_fx.shape[1]):
        one = motion_fx[:, x].copy()
        before = np.bincount(block_f, one**2, count)
        for _ in range(2):
            for y in range(x):
                one -= np.bincount(block_f, one * found[:, y], count)[block_f] * found[:, y]
        after = np.bincount(block_f, one**2, count)
        there = after > 1e-12 * before
        found[:, x] = one * (there / np.sqrt(np.where(there, after, 1.0)))[block_f]
        rank += there
    return found, rank


def _softest(
    square: sp.csc_array, rigid_fx: NDArray[np.float64], block_f: NDArray[np.int64], count: int, tolerance: float
) -> NDArray[np.float64]:
    """Return the smallest eigenvalue of each block across its rigid motions, by inverse iteration on all at once."""
    solve = _shifted(square, tolerance).solve
    vector = np.random.default_rng(0).normal(size=square.shape[0])

    def across(one: NDArray[np.float64]) -> NDArray[np.float64]:
        for _ in range(2):
            for motion in rigid_fx.T:
                one = one - np.bincount(block_f, one * motion, count)[block_f] * motion
        size = np.sqrt(np.bincount(block_f, one**2, count))
        return one / np.where(size > 0.0, size, 1.0)[block_f]

    for _ in range(_INVERSIONS):
        vector = across(solve(across(vector)))
    return np.asarray(np.bincount(block_f, vector * (square @ vector), count), dtype=np.float64)


# -- counting ---------------------------------------------------------------------------------------------------------


def _counted(joints: Joints) -> _Found:
    """Return what the pebble game says."""
    if joints.dimension != 2:
        raise ValueError(f"method must be 'null space' in space, where counting decides nothing, got {'pebble game'!r}")
    if joints.held_n.any():
        raise ValueError(
            f"method must be 'null space' where particles are held, got 'pebble game' with {int(joints.held_n.sum())}"
        )
    n, count = joints.particles, len(joints.i_e)
    bar = np.repeat(np.arange(count), joints.bars_e)
    played = play_pebble_game(joints.i_e[bar], joints.j_e[bar], joints.image_ed[bar], joints.body_n)
    stressed = np.zeros(count, dtype=bool)
    stressed[bar[played.stressed_b]] = True
    label = np.full(count, -1, dtype=np.int64)
    label[bar] = played.cluster_b
    inside = np.flatnonzero(label >= 0)
    body = np.flatnonzero(played.cluster_n >= 0)
    owner = np.concatenate([np.tile(label[inside], 2), played.cluster_n[body]])
    pair = np.unique(owner * n + np.concatenate([joints.i_e[inside], joints.j_e[inside], body]))
    order = np.argsort(-np.bincount(pair // n, minlength=played.clusters), kind="stable")
    rank_k = np.zeros(played.clusters, dtype=np.int64)
    rank_k[order] = np.arange(played.clusters)
    label[inside] = rank_k[label[inside]]
    key = np.sort(rank_k[pair // n] * n + pair % n)
    owner, member = key // n, key % n
    start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=played.clusters))])
    i, j = (np.searchsorted(key, label[inside] * n + one[inside]) for one in (joints.i_e, joints.j_e))
    image = joints.image_ed[inside]
    offset = tree_offsets(i, j, image, len(key))
    winding = np.zeros((played.clusters, 2), dtype=bool)
    np.logical_or.at(winding, label[inside], image + offset[i] - offset[j] != 0)
    turns = np.zeros(n, dtype=np.int64)
    turns[body] = rank_k[played.cluster_n[body]] + 1
    pebbles = np.bincount(owner, 2 + (turns[member] == owner + 1), played.clusters).astype(np.int64)
    rigid = pebbles - np.where(winding.any(axis=1), 2, 3)
    rank, nan = int(played.independent_b.sum()), float("nan")
    return _Found(
        label, start, member, stressed, winding, rigid, rigid, np.full(played.clusters, nan), rank, len(bar),
        2 * n + int(joints.body_n.sum()) - rank - 2, nan, nan, nan, nan, nan, not _pushes_centers(joints),
    )  # fmt: skip


def _pushes_centers(joints: Joints) -> bool:
    """Whether single bars turn bodies not at all: they act on centers, which is no place in general position."""
    spins = joints.rows[:, joints.column_f % joints.width >= joints.dimension].tocoo()
    turned = np.bincount(joints.joint_r[spins.coords[0][spins.data != 0.0]], minlength=len(joints.i_e))
    bodies = joints.body_n[joints.i_e].astype(np.int64) + joints.body_n[joints.j_e]
    return bool(((joints.bars_e == 1) & (turned < bodies)).any())
