"""Bodies that their contacts do not hold, found again and again until none is left: one rule on the rows of contacts.

Where a contact meets a body it has a row: the slope of its distance along the body's coordinates, which is what a unit
push does to them (`packmech.contacts.elements`); with friction also the rows of its tangential displacements. A body
that only moves is held where its rows positively span its motions: any motion closes a contact. One that turns, too, is
held where d + 1 contacts or more can balance it, by positive forces: motions that close none to first order are
resisted by curvatures and forces. With friction two contacts suffice, whose forces lie in their cones.

Contacts push, each by a unit normal force, with the wrenches p + mu T, where T is the tangential part of a unit force
or less. Forces of all contacts balance, without being all zero, where zero is a mean of such wrenches. Wolfe's
algorithm (Math. Program. 11, 128 (1976)) finds the mean of smallest size, over points without friction, segments in the
plane and discs in space, whose farthest point in a direction is known: no cone is replaced by a pyramid. Either that
mean gets as small as rounding, or the direction of it parts all wrenches from zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.cells import sort_row
from packmech.contacts.elements import PairGeometry, end_slopes
from packmech.jit.compiled import device, kernel

# Two contacts opposite to within this angle [rad] count as exactly opposite, as in crystals: a third contact between
# them could only be balanced by forces a hundred million times larger than itself.
_OPPOSITE = 1e-8
# angles [rad] and lengths this large are no matter of rounding
_PLAIN = 1e-3
# unbalanced part of the normal forces that counts as none [1]
_BALANCED = 1e-6
_ROUNDS = 1000
# smallest pivot and weight, over the largest
_ROUNDING = 1e-14


class Ends(NamedTuple):
    """Where contacts meet bodies, a row each; X coordinates of a body are d positions, then its turns.

    Attributes
    ----------
    body_e
        (E,) bodies.
    other_e
        (E,) bodies on the other side; -1 for what cannot rattle, such as a wall.
    push_ex
        (E, X) what a unit normal force does to the body.
    side_esx
        (E, d - 1, X) what unit tangential forces along orthonormal directions do; (E, 0, X) without friction. After
        them what resists rolling about the same directions, and twisting, as far as the friction's coefficient lets it.

    """

    body_e: NDArray[np.int64]
    other_e: NDArray[np.int64]
    push_ex: NDArray[np.float64]
    side_esx: NDArray[np.float64]


def join_ends(parts: Sequence[Ends]) -> Ends:
    """Return the ends of several kinds of contacts; rows that lack turns or tangential forces have zeros there."""
    found = [one for one in parts if len(one.body_e)] or parts[:1]
    sides, width = (max(one.side_esx.shape[k] for one in found) for k in (1, 2))
    start = np.cumsum([0, *(len(one.body_e) for one in found)])
    push, side = np.zeros((start[-1], width)), np.zeros((start[-1], sides, width))
    for first, one in zip(start, found, strict=False):
        rows = slice(first, first + len(one.body_e))
        push[rows, : one.push_ex.shape[1]] = one.push_ex
        side[rows, : one.side_esx.shape[1], : one.side_esx.shape[2]] = one.side_esx
    body, other = (np.concatenate([getattr(one, name) for one in found]) for name in ("body_e", "other_e"))
    return Ends(body, other, push, side)


@device
def _surely_around(x: NDArray[np.float64], y: NDArray[np.float64], count: int) -> bool:
    """Return whether three of the vectors (x, y) obviously leave no half plane free; False says nothing."""
    first = np.sqrt(x[0] * x[0] + y[0] * y[0])
    if first < _PLAIN:
        return False
    # on each side of the first vector, the one that points back the most
    left = right = -1
    left_cosine = right_cosine = 2.0
    for k in range(1, count):
        size = np.sqrt(x[k] * x[k] + y[k] * y[k])
        if size < _PLAIN:
            continue
        sine = (x[0] * y[k] - y[0] * x[k]) / (first * size)
        cosine = (x[0] * x[k] + y[0] * y[k]) / (first * size)
        if sine > _PLAIN and cosine < left_cosine:
            left, left_cosine = k, cosine
        elif sine < -_PLAIN and cosine < right_cosine:
            right, right_cosine = k, cosine
    if left < 0 or right < 0:
        return False
    area = x[left] * y[right] - y[left] * x[right]
    lengths = (x[left] * x[left] + y[left] * y[left]) * (x[right] * x[right] + y[right] * y[right])
    return bool(area > 0.0 and area * area > _PLAIN * _PLAIN * lengths)


@device
def _within_half_plane(x: NDArray[np.float64], y: NDArray[np.float64], angle: NDArray[np.float64], count: int) -> bool:
    """Return whether some direction of the plane makes no acute angle with the first `count` vectors (x, y)."""
    if count >= 3 and _surely_around(x, y, count):
        return False
    used = 0
    for k in range(count):
        # a vector this short puts no bound on motions within the plane
        if x[k] * x[k] + y[k] * y[k] > _OPPOSITE * _OPPOSITE:
            angle[used] = np.arctan2(y[k], x[k])
            used += 1
    if used < 3:
        return True
    sort_row(angle, 0, used)  # type: ignore[no-untyped-call]
    widest = angle[0] + 2.0 * np.pi - angle[used - 1]
    for k in range(1, used):
        widest = max(widest, angle[k] - angle[k - 1])
    return bool(widest > np.pi - _OPPOSITE)


@device
def _surely_balanced(normal: NDArray[np.float64], count: int) -> bool:
    """Return whether the first `count` vectors of space obviously span it and balance; False says nothing.

    With r = sum n and M = sum n n, forces 1 - n . M^-1 r balance; are all positive, no direction is free.
    """
    r0 = r1 = r2 = xx = yy = zz = yz = xz = xy = 0.0
    for k in range(count):
        n0, n1, n2 = normal[k, 0], normal[k, 1], normal[k, 2]
        r0 += n0
        r1 += n1
        r2 += n2
        xx += n0 * n0
        yy += n1 * n1
        zz += n2 * n2
        yz += n1 * n2
        xz += n0 * n2
        xy += n0 * n1
    # cofactors
    c0, c1, c2 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    c3, c4, c5 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    volume = xx * c0 + xy * c1 + xz * c2
    mean = (xx + yy + zz) / 3.0
    if not volume > _PLAIN * mean * mean * mean:
        return False
    f0 = (c0 * r0 + c1 * r1 + c2 * r2) / volume
    f1 = (c1 * r0 + c3 * r1 + c4 * r2) / volume
    f2 = (c2 * r0 + c4 * r1 + c5 * r2) / volume
    for k in range(count):
        if normal[k, 0] * f0 + normal[k, 1] * f1 + normal[k, 2] * f2 > 1.0 - _PLAIN:
            return False
    return True


@device
def _is_free(
    normal: NDArray[np.float64],
    d: int,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    angle: NDArray[np.float64],
    count: int,
) -> bool:
    """Return whether a particle with the first `count` rows of `normal`, d numbers each, as its normals can move.

    x, y and angle are room for as many numbers.
    """
    if count < d + 1:
        return True
    if d == 2:
        for k in range(count):
            x[k] = normal[k, 0]
            y[k] = normal[k, 1]
        return _within_half_plane(x, y, angle, count)
    if _surely_balanced(normal, count):
        return False
    # If any motion is free, one is that slides along some contact a: look for it in the plane across each normal.
    for a in range(count):
        n0, n1, n2 = normal[a, 0], normal[a, 1], normal[a, 2]
        # e, f: an orthonormal basis of that plane, e across the smallest component of the normal
        if abs(n0) <= abs(n1) and abs(n0) <= abs(n2):
            e0, e1, e2 = 0.0, n2, -n1
        elif abs(n1) <= abs(n2):
            e0, e1, e2 = -n2, 0.0, n0
        else:
            e0, e1, e2 = n1, -n0, 0.0
        size = np.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
        e0, e1, e2 = e0 / size, e1 / size, e2 / size
        f0, f1, f2 = n1 * e2 - n2 * e1, n2 * e0 - n0 * e2, n0 * e1 - n1 * e0
        for k in range(count):
            x[k] = normal[k, 0] * e0 + normal[k, 1] * e1 + normal[k, 2] * e2
            y[k] = normal[k, 0] * f0 + normal[k, 1] * f1 + normal[k, 2] * f2
        if _within_half_plane(x, y, angle, count):
            return True
    return False


@device
def _along(side, k, s, x):  # type: ignore[no-untyped-def]
    total = 0.0
    for a in range(x.shape[0]):
        total += x[a] * side[k, s, a]
    return total


@device
def _reach(side, k, first, last, x):  # type: ignore[no-untyped-def]
    """Return how far a unit of force along some rows of a contact reaches along x."""
    square = 0.0
    for s in range(first, last):
        part = _along(side, k, s, x)  # type: ignore[no-untyped-call]
        square += part * part
    return math.sqrt(square)


@device
def _farthest(push, side, groups, count, mu, x, best):  # type: ignore[no-untyped-def]
    """Write the wrench that lies farthest against x; return its product with x."""
    p = push.shape[1]
    lowest = math.inf
    chosen = 0
    for k in range(count):
        value = 0.0
        for a in range(p):
            value += x[a] * push[k, a]
        first = 0
        for last in groups:
            value -= mu * _reach(side, k, first, last, x)  # type: ignore[no-untyped-call]
            first = last
        if value < lowest:
            lowest = value
            chosen = k
    for a in range(p):
        best[a] = push[chosen, a]
    first = 0
    for last in groups:
        size = _reach(side, chosen, first, last, x)  # type: ignore[no-untyped-call]
        scale = -mu / size if size > 0.0 else 0.0
        for s in range(first, last):
            part = scale * _along(side, chosen, s, x)  # type: ignore[no-untyped-call]
            for a in range(p):
                best[a] += part * side[chosen, s, a]
        first = last
    return lowest


@device
def _nearest_weights(point, used, gram, weight):  # type: ignore[no-untyped-def]
    """Write the weights, of sum 1 and any sign, of the combination of the points that is nearest to zero."""
    p = point.shape[1]
    largest = 0.0
    for a in range(used):
        for b in range(a + 1):
            total = 1.0
            for c in range(p):
                total += point[a, c] * point[b, c]
            gram[a, b] = total
        largest = max(largest, gram[a, a])
    # Cholesky factors of the products plus one: positive definite for points in general position
    for a in range(used):
        for b in range(a + 1):
            total = gram[a, b]
            for c in range(b):
                total -= gram[a, c] * gram[b, c]
            gram[a, b] = math.sqrt(max(total, _ROUNDING * largest)) if a == b else total / gram[b, b]
    for a in range(used):
        total = 1.0
        for c in range(a):
            total -= gram[a, c] * weight[c]
        weight[a] = total / gram[a, a]
    whole = 0.0
    for back in range(used):
        a = used - 1 - back
        total = weight[a]
        for c in range(a + 1, used):
            total -= gram[c, a] * weight[c]
        weight[a] = total / gram[a, a]
        whole += weight[a]
    for a in range(used):
        weight[a] /= whole


@device
def can_balance(push, side, groups, count, mu):  # type: ignore[no-untyped-def]
    """Return whether forces in the friction cones of the first `count` contacts can balance without being all zero.

    `push` (K, p) and `side` (K, s, p) are rows as in `Ends`, of mu = 0 without friction; `groups` as there.
    """
    p = push.shape[1]
    room = p + 2
    point, share, weight = np.zeros((room, p)), np.zeros(room), np.zeros(room)
    gram, x, best = np.zeros((room, room)), np.zeros(p), np.zeros(p)
    if count < 2:
        return False
    for a in range(p):
        point[0, a] = x[a] = push[0, a]
    share[0] = 1.0
    used = 1
    for _ in range(_ROUNDS):
        square = 0.0
        for a in range(p):
            square += x[a] * x[a]
        if square <= _BALANCED * _BALANCED:
            return True
        value = _farthest(push, side, groups, count, mu, x, best)  # type: ignore[no-untyped-call]
        # all wrenches lie beyond a plane across x
        if value > _BALANCED * math.sqrt(square):
            return False
        if used == room:
            return True
        point[used] = best
        share[used] = 0.0
        used += 1
        while True:
            _nearest_weights(point, used, gram, weight)  # type: ignore[no-untyped-call]
            inside = True
            for a in range(used):
                inside = inside and weight[a] > _ROUNDING
            if inside:
                for a in range(used):
                    share[a] = weight[a]
                break
            # as far towards it as weights stay positive; then without what has none
            step = 1.0
            for a in range(used):
                if weight[a] <= _ROUNDING and share[a] - weight[a] > 0.0:
                    step = min(step, share[a] / (share[a] - weight[a]))
            kept = 0
            for a in range(used):
                left = share[a] + step * (weight[a] - share[a])
                if left > _ROUNDING:
                    share[kept] = left
                    point[kept] = point[a]
                    kept += 1
            if kept == used:
                break
            used = kept
        whole = 0.0
        for a in range(used):
            whole += share[a]
        for a in range(p):
            x[a] = 0.0
            for b in range(used):
                x[a] += share[b] / whole * point[b, a]
    # nothing parts the wrenches from zero
    return True


@kernel
def _find_rattling(  # type: ignore[no-untyped-def]
    start, order, other, push, side, groups, d, mu, rotates, queue, length, waiting, rattling
):
    """Mark the bodies that rattle; order[start[i]:start[i+1]] are the ends of body i, rotates None where none does.

    The first `length` in the queue wait, first in, first out: a large one with many neighbors is looked at once a
    round, not once for each that it loses. Those that wait without being in the queue never rattle.
    """
    bodies = start.shape[0] - 1
    most = 0
    for i in range(bodies):
        most = max(most, start[i + 1] - start[i])
    x, y, angle = np.empty(most), np.empty(most), np.empty(most)
    pushes, sides = np.empty((most, push.shape[1])), np.empty((most, side.shape[1], push.shape[1]))
    head = 0
    while length > 0:
        i = queue[head]
        head = (head + 1) % bodies
        length -= 1
        waiting[i] = False
        count = 0
        slides = False
        for h in range(start[i], start[i + 1]):
            e = order[h]
            if other[e] < 0 or not rattling[other[e]]:
                for a in range(push.shape[1]):
                    pushes[count, a] = push[e, a]
                    if rotates is not None:
                        for b in range(side.shape[1]):
                            sides[count, b, a] = side[e, b, a]
                            slides = slides or side[e, b, a] != 0.0
                count += 1
        if rotates is None:
            held = not _is_free(pushes, d, x, y, angle, count)
        else:
            # where walls alone are rough, what touches none of them is held by pushes, whatever turns
            if rotates[i] and (slides or mu == 0.0):
                enough = mu > 0.0 or count > d
                held = enough and can_balance(pushes, sides, groups, count, mu)  # type: ignore[no-untyped-call]
            else:
                held = not _is_free(pushes, d, x, y, angle, count)
        if held:
            continue
        rattling[i] = True
        for h in range(start[i], start[i + 1]):
            j = other[order[h]]
            if j >= 0 and not rattling[j] and not waiting[j]:
                waiting[j] = True
                queue[(head + length) % bodies] = j
                length += 1


def rattling_bodies(
    ends: Ends,
    turns_b: NDArray[np.bool_],
    dimension: int,
    *,
    friction: float = 0.0,
    groups: tuple[int, ...] | None = None,
    held_b: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return (B,) which bodies their contacts with bodies that do not rattle leave free.

    Parameters
    ----------
    ends
        The rows of the contacts.
    turns_b
        (B,) which bodies turn.
    dimension
        Number of Cartesian axes.
    friction
        Coefficient of friction [1].
    groups
        Numbers of the first tangential rows of a contact, of the first two kinds, and so on, whose forces are at most
        friction times the normal force together: sliding, then rolling, then twisting. All are of one kind unless
        given.
    held_b
        (B,) bodies that never rattle; none unless given.

    """
    bodies = len(turns_b)
    start = np.concatenate([[0], np.cumsum(np.bincount(ends.body_e, minlength=bodies))])
    order = np.argsort(ends.body_e, kind="stable")
    rattling = np.zeros(bodies, dtype=bool)
    free = np.arange(bodies) if held_b is None else np.flatnonzero(~held_b)
    queue = np.zeros(bodies, dtype=np.int64)
    queue[: len(free)] = free
    waiting = np.ones(bodies, dtype=bool)
    # what judges bodies that turn is compiled where there are any
    rotates = turns_b if turns_b.any() else None
    kinds = np.array((ends.side_esx.shape[1],) if groups is None else groups, dtype=np.int64)
    _find_rattling(
        start, order, ends.other_e, ends.push_ex, ends.side_esx, kinds, dimension, float(friction), rotates, queue,
        len(free), waiting, rattling,
    )  # fmt: skip
    return rattling


def ends_of(contacts: PairGeometry) -> Ends:
    """Return the ends of contacts without friction; one with a particle's own image holds it from both sides."""
    slope = end_slopes(contacts.i_c, contacts.j_c, contacts.slope_cx, contacts.turn_nkt, contacts.dimension)
    push = np.concatenate(slope / contacts.push_c[:, None])
    body, other = np.concatenate([contacts.i_c, contacts.j_c]), np.concatenate([contacts.j_c, contacts.i_c])
    return Ends(body, other, push, np.zeros((len(body), 0, push.shape[1])))


def rough_ends_of(
    contacts: PairGeometry,
    arm_2cd: NDArray[np.float64],
    turn_nkt: NDArray[np.float64],
    moment_kc: Sequence[NDArray[np.float64] | None] = (),
) -> Ends:
    """Return the ends of contacts with friction, which turns particles whatever their shape.

    Parameters
    ----------
    contacts
        The contacts.
    arm_2cd
        (2, C, d) vectors from the centers of i and of j to the point of contact [length].
    turn_nkt
        (N, K, t) rotations per length of each coordinate of turns, of discs and spheres, too.
    moment_kc
        (C,) torques that a unit of force against rolling is worth, and of force against twisting [length]; None for
        what nothing resists.

    """
    i, j, d = contacts.i_c, contacts.j_c, contacts.dimension
    push = end_slopes(i, j, contacts.slope_cx, turn_nkt, d) / contacts.push_c[:, None]
    ends = zip((i, j), arm_2cd, strict=True)
    sides = [rows_across(push[1, :, :d], arm_cd, turn_nkt[end], moment_kc) for end, arm_cd in ends]
    return Ends(np.concatenate([i, j]), np.concatenate([j, i]), np.concatenate(push), np.concatenate(sides))


def rows_across(
    normal_cd: NDArray[np.float64],
    arm_cd: NDArray[np.float64],
    turn_ckt: NDArray[np.float64],
    moment_kc: Sequence[NDArray[np.float64] | None] = (),
) -> NDArray[np.float64]:
    """Return the (C, S, X) rows of what acts across one end of contacts: sliding, then rolling, then twisting.

    Parameters
    ----------
    normal_cd, arm_cd
        (C, d) normals, and vectors from the center to the point of contact [length].
    turn_ckt, moment_kc
        As of `rough_ends_of`, of the bodies at these ends.

    """
    d = normal_cd.shape[1]
    if d == 2:
        across = np.stack([-normal_cd[:, 1], normal_cd[:, 0]], axis=1)[:, None]
    else:
        # across the axis of the smallest component, which is farthest from the normal
        first = np.cross(normal_cd, np.eye(3)[np.abs(normal_cd).argmin(axis=1)])
        first /= np.sqrt((first**2).sum(axis=1, keepdims=True))
        across = np.stack([first, np.cross(normal_cd, first)], axis=1)
    moment = _cross(arm_cd[:, None], across)
    rows = [np.concatenate([across, np.einsum("ckt,cst->csk", turn_ckt, moment)], axis=2)]
    # torques along all directions across in space, along the third axis in a plane; then along the normal
    axes = (np.ones((len(normal_cd), 1, 1)) if d == 2 else across), normal_cd[:, None]
    for axis, size_c in zip(axes, moment_kc, strict=False):
        if size_c is not None:
            turned = np.einsum("ckt,cst->csk", turn_ckt, size_c[:, None, None] * axis)
            rows.append(np.concatenate([np.zeros((*turned.shape[:2], d)), turned], axis=2))
    return np.concatenate(rows, axis=1)


def _cross(arm: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the torques of forces at the ends of arms, of one component in a plane."""
    if arm.shape[-1] == 3:
        return np.cross(arm, force)
    return np.asarray(arm[..., :1] * force[..., 1:] - arm[..., 1:] * force[..., :1])


def rattlers_of(contacts: PairGeometry, held_n: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Return (N,) which particles the given contacts leave free, those that rattle removed first; none that is held."""
    return rattling_bodies(ends_of(contacts), turns_of(contacts.turn_nkt), contacts.dimension, held_b=held_n)


def turns_of(turn_nkt: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (N,) which particles turn: a disc among ellipses does not."""
    return np.asarray((turn_nkt != 0.0).any(axis=(1, 2)))
