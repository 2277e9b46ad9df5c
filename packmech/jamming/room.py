"""Rattlers of a packing taken as far from what surrounds them as they can be, by linear programs."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts.elements import distance_rows
from packmech.contacts.network import Candidates, Contacts
from packmech.contacts.pairs import measure_pairs, search_pairs
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.jamming.hard_packing import clusters
from packmech.linalg.linear_programs import LinearProgram, solve_highs
from packmech.packing import Packing
from packmech.result import Outcome

# pairs are looked at within this reach beyond contact [contact distance]
NEAR = 0.1
# gaps of one strain, or one program, are as near as this [contact distance]
AT_ONCE = 1e-9
# room that is enough for a rattler, trust radius of its programs, and their number [diameter]
_ROOM, _TRUST, _PROGRAMS = 1e-3, 0.1, 30
# trust radius at which other shapes have straight distances
_STRAIGHT = 1e-7


def make_room(
    packing: Packing, near: Contacts | ShapeContacts, rattling_n: NDArray[np.bool_]
) -> tuple[Packing, float, Candidates]:
    """Return the packing with its rattlers as far from everything as they can be, the room left, and who limits it.

    Each program maximizes the smallest relative gap of each group of rattlers that can meet, to first order in their
    displacements, turns among them, over all pairs that these can bring together; distances of discs and spheres are
    convex, so that the true gaps are no smaller. Room of a thousandth is enough.

    Parameters
    ----------
    packing
        The packing.
    near
        All pairs that are near.
    rattling_n
        (N,) its rattlers.

    Returns
    -------
    tuple
        The packing, the smallest gap of a rattler over its contact distance, negative where one is squeezed, and the
        pairs that have that gap and hold it there.

    """
    gap_c = near.gap_c / near.contact_distance_c
    loose_i, loose_j = rattling_n[near.i_c], rattling_n[near.j_c]
    room = float(gap_c[loose_i | loose_j].min(initial=NEAR))
    waiting = np.zeros(packing.particles, dtype=bool)
    for loose_c, end_c in ((loose_i, near.i_c), (loose_j, near.j_c)):
        waiting[end_c[loose_c & (gap_c <= _ROOM)]] = True
    if not waiting.any():
        return packing, room, _no_pairs(packing)
    meeting = _within_reach(packing, rattling_n, _TRUST)
    label_n = _groups(meeting, rattling_n)
    packing, found = _apart(packing, rattling_n & np.isin(label_n, label_n[waiting]))
    room = min(own for own, _ in found)
    limiting = [limits for own, limits in found if own <= room + AT_ONCE]
    return packing, room, Candidates(*(np.concatenate(part) for part in zip(*limiting, strict=True)))


def _no_pairs(packing: Packing) -> Candidates:
    none = np.zeros(0, dtype=np.int64)
    return Candidates(none, none, np.zeros((0, packing.dimension), dtype=np.int64))


def _within_reach(packing: Packing, member_n: NDArray[np.bool_], trust: float) -> Contacts | ShapeContacts:
    """Return the pairs of members that are tight, or may be once each coordinate has changed by no more than `trust`.

    A pair is tight up to the room that is enough.
    """
    # beads go round their bodies' centers, other shapes turn within the discs or spheres that hold them
    turn = np.sqrt((packing.turn_nkt**2).sum(axis=(1, 2))) * packing.shapes.sweep(packing.radius_n)
    way = math.sqrt(packing.dimension) * (1.0 + float(turn.max()))
    skin, scale = 2.0 * way * trust, 1.0 + _ROOM
    pairs = search_pairs(packing, scale, skin)
    owner = packing.shapes.particle_b
    keep = member_n[owner[pairs.i_c]] | member_n[owner[pairs.j_c]]
    return measure_pairs(packing, Candidates(*(part[keep] for part in pairs)))


def _groups(near: Contacts | ShapeContacts, member_n: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the (N,) number of each particle's group of those members that the pairs join."""
    both = member_n[near.i_c] & member_n[near.j_c]
    return clusters(len(member_n), near.i_c[both], near.j_c[both])


def _apart(packing: Packing, member_n: NDArray[np.bool_]) -> tuple[Packing, list[tuple[float, Candidates]]]:
    """Return the packing with each group of members as far from everything as it can be, and of each its limits.

    These are the room that it has and the pairs that hold it there. One program moves all groups; they do not meet in
    it, so each has a room of its own.
    """
    found: list[tuple[float, Candidates]] = []
    member_n, trust_n = member_n.copy(), np.full(packing.particles, _TRUST)
    for left in range(_PROGRAMS, 0, -1):
        here = _within_reach(packing, member_n, float(trust_n[member_n].max()))
        label_n = _groups(here, member_n)
        names = np.unique(label_n[member_n])
        group_n = np.where(member_n, np.searchsorted(names, label_n), -1)
        group_c = np.where(member_n[here.i_c], group_n[here.i_c], group_n[here.j_c])
        trust_g = np.full(len(names), _TRUST)
        np.minimum.at(trust_g, group_n[member_n], trust_n[member_n])
        u_nq, push_c = _outwards(packing, here, group_n, group_c, trust_g)
        room_g = _smallest(here, group_c, len(names))
        reached_g = _smallest(measure_pairs(packing.moved(u_nq), here.pairs), group_c, len(names))
        better_g = reached_g > room_g + 1e-15
        packing = packing.moved(u_nq * better_g[group_n][:, None])
        way_g = np.zeros(len(names))
        np.maximum.at(way_g, group_n[member_n], np.abs(u_nq[member_n]).max(axis=1))
        stuck_g = ~better_g
        if packing.shapes.has_orientations:
            # distances of other shapes bend both ways: nearer by they are straight
            stuck_g &= (trust_g < _STRAIGHT) | (way_g == 0.0)
        done_g = stuck_g | (better_g & ((reached_g > _ROOM) | (reached_g - room_g < 1e-14))) | (left == 1)
        for g in np.flatnonzero(done_g):
            limits = here.select((group_c == g) & push_c).pairs
            found.append((float(max(reached_g[g], room_g[g])), limits))
        trust_g = np.where(better_g, np.minimum(trust_g, np.maximum(3.0 * way_g, 1e-6)), 0.25 * trust_g)
        trust_n[member_n] = trust_g[group_n[member_n]]
        member_n &= ~done_g[group_n]
        if not member_n.any():
            break
    return packing, found


def _smallest(near: Contacts | ShapeContacts, group_c: NDArray[np.int64], groups: int) -> NDArray[np.float64]:
    """Return the (G,) smallest relative gaps of the pairs of each group, at most that up to which pairs are near."""
    smallest = np.full(groups, NEAR)
    np.minimum.at(smallest, group_c, near.gap_c / near.contact_distance_c)
    return smallest


def _outwards(
    packing: Packing,
    here: Contacts | ShapeContacts,
    group_n: NDArray[np.int64],
    group_c: NDArray[np.int64],
    trust_g: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the displacements that give each group the most room to first order, and the pairs that limit them.

    Where the program is not solved there are none.
    """
    member_n, groups = group_n >= 0, len(trust_g)
    q = packing.dimension + packing.turn_nkt.shape[1]
    slopes = distance_rows(here)[:, np.repeat(member_n, q)]
    count = int(member_n.sum())
    rooms = sp.csr_array((here.contact_distance_c, (np.arange(len(here)), group_c)), shape=(len(here), groups))
    below = sp.csr_array(sp.hstack([-slopes, rooms]))
    bound = np.repeat(trust_g[group_n[member_n]], q)
    program = LinearProgram(
        cost=np.concatenate([np.zeros(count * q), -np.ones(groups)]),
        equal=sp.csr_array((0, count * q + groups)), equal_to=np.zeros(0), below=below, below_to=here.gap_c,
        lower=np.concatenate([-bound, np.full(groups, -np.inf)]),
        upper=np.concatenate([bound, np.full(groups, NEAR)]), dimension=q,
    )  # fmt: skip
    solution = solve_highs(program, 1e-10)
    u_nq = np.zeros((packing.particles, q))
    if solution.solve.outcome is not Outcome.CONVERGED:
        return u_nq, np.zeros(len(here), dtype=bool)
    u_nq[member_n] = solution.x[: count * q].reshape(count, q)
    return u_nq, np.asarray(solution.below_multiplier > 1e-6 * float(solution.below_multiplier.max(initial=1e-300)))
