"""Particles that their contacts do not hold, found again and again until none is left; contacts that a user gives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.contacts.cells import sort_row
from packmech.contacts.friction_cones import FrictionCones, can_balance
from packmech.contacts.network import Contacts, pair_contacts
from packmech.jit.compiled import device, kernel
from packmech.packing import Packing

# Two contacts opposite to within this angle [rad] count as exactly opposite, as in crystals: a third contact between
# them could only be balanced by forces a hundred million times larger than itself.
_OPPOSITE = 1e-8
# angles [rad] and lengths this large are no matter of rounding
_PLAIN = 1e-3


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
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    angle: NDArray[np.float64],
    count: int,
) -> bool:
    """Return whether a particle with the first `count` rows of `normal` as its contact normals can move.

    x, y and angle are room for as many numbers.
    """
    d = normal.shape[1]
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


@kernel
def _find_rattling(
    start: NDArray[np.int64],
    neighbor: NDArray[np.int64],
    outward: NDArray[np.float64],
    queue: NDArray[np.int64],
    length: int,
    waiting: NDArray[np.bool_],
    rattling: NDArray[np.bool_],
    normal: NDArray[np.float64],
    cones: Any,
) -> None:
    """Mark the bodies that rattle; outward[start[i]:start[i+1]] are the normals of particle i, towards `neighbor`.

    The first `length` in the queue wait, first in, first out: a large one with many neighbors is looked at once a
    round, not once for each that it loses. Those that wait without being in the queue never rattle. `normal` is room
    for the largest number of contacts. With friction `cones` holds its coefficient and the points of contact, in the
    order of the normals; None without.
    """
    particles = start.shape[0] - 1
    d = outward.shape[1]
    head = 0
    x = np.empty(normal.shape[0])
    y = np.empty(normal.shape[0])
    angle = np.empty(normal.shape[0])
    point = np.empty_like(normal)
    while length > 0:
        i = queue[head]
        head = (head + 1) % particles
        length -= 1
        waiting[i] = False
        count = 0
        for h in range(start[i], start[i + 1]):
            if not rattling[neighbor[h]]:
                for k in range(d):
                    normal[count, k] = outward[h, k]
                    if cones is not None:
                        point[count, k] = cones[1][h, k]
                count += 1
        if cones is None:
            free = _is_free(normal, x, y, angle, count)
        else:
            free = not can_balance(normal, point, count, cones[0])  # type: ignore[no-untyped-call]
        if not free:
            continue
        rattling[i] = True
        for h in range(start[i], start[i + 1]):
            j = neighbor[h]
            if not rattling[j] and not waiting[j]:
                waiting[j] = True
                queue[(head + length) % particles] = j
                length += 1


@kernel
def _ends_by_particle(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    normal_cd: NDArray[np.float64],
    of_i_cd: NDArray[np.float64],
    of_j_cd: NDArray[np.float64],
    particles: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the ends of contacts by particle: where each one's begin, neighbors, outward normals, and points if any.

    Points are given from center i, and up to center j; seen from there they are turned round, as normals are.
    """
    count, d = normal_cd.shape
    start = np.zeros(particles + 1, np.int64)
    for c in range(count):
        start[i_c[c] + 1] += 1
        start[j_c[c] + 1] += 1
    for n in range(particles):
        start[n + 1] += start[n]
    place = start[:-1].copy()
    neighbor = np.empty(2 * count, np.int64)
    outward = np.empty((2 * count, d))
    point = np.empty((2 * count if len(of_i_cd) else 0, d))
    for side in range(2):
        for c in range(count):
            own, other = (i_c[c], j_c[c]) if side == 0 else (j_c[c], i_c[c])
            h = place[own]
            place[own] += 1
            neighbor[h] = other
            for k in range(d):
                outward[h, k] = normal_cd[c, k] if side == 0 else -normal_cd[c, k]
                if len(of_i_cd):
                    point[h, k] = of_i_cd[c, k] if side == 0 else -of_j_cd[c, k]
    return start, neighbor, outward, point


def rattling_bodies(
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    normal_cd: NDArray[np.float64],
    particles: int,
    friction: FrictionCones | None = None,
    held: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return, for each of so many bodies, whether contacts with these normals from i to j leave it free to move.

    With friction, whether no forces within the friction cones balance on it: it has fewer than two contacts, or the
    chord between its two lies outside a cone, and so on. Those that are held rattle never.
    """
    none = np.zeros((0, normal_cd.shape[1]))
    ends = (none, none) if friction is None else (friction.of_i_cd, friction.of_j_cd)
    start, neighbor, outward, point = _ends_by_particle(i_c, j_c, normal_cd, *ends, particles)
    rattling = np.zeros(particles, dtype=bool)
    room = np.empty((np.diff(start).max(initial=0), normal_cd.shape[1]))
    cones = None if friction is None else (float(friction.coefficient), point)
    queue = np.arange(particles)
    waiting = np.ones(particles, dtype=bool)
    length = particles
    if held is not None:
        length = int(np.count_nonzero(~held))
        queue[:length] = np.flatnonzero(~held)
    _find_rattling(start, neighbor, outward, queue, length, waiting, rattling, room, cones)
    return rattling


def rattlers_of(contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether the given contacts leave it free, the free ones removed first.

    Parameters
    ----------
    contacts
        The contacts; one with the particle's own image holds it from both sides.

    """
    return rattling_bodies(contacts.i_c, contacts.j_c, contacts.normal_cd, contacts.particles)


def check_contacts(packing: Packing, contacts: Contacts) -> None:
    """Check that the contacts can belong to the packing.

    Raises
    ------
    TypeError, ValueError
        If they are of the wrong kind, or made for another number of particles or axes.

    """
    instance("contacts", contacts, Contacts)
    if (contacts.particles, contacts.dimension) != (packing.particles, packing.dimension):
        raise ValueError(
            f"contacts must belong to {packing.particles} particles in {packing.dimension} dimensions,"
            f" got {contacts.particles} in {contacts.dimension}"
        )


# distances of another packing or image differ by more than this, of themselves; particles that moved by less since the
# contacts were found may be judged by them
_SAME = 1e-6


def check_given(packing: Packing, contacts: Contacts) -> None:
    """Check that the contacts are pairs of the packing as it stands, each once.

    Parameters
    ----------
    packing
        The packing.
    contacts
        What was given as its contacts.

    Raises
    ------
    TypeError, ValueError
        If they are of the wrong kind, made for another number of particles or axes, name particles that are not there,
        a particle and itself, or a pair and image twice, if a vector is not the packing's, or if a contact distance is
        neither the sum of the radii nor the distance itself, which says that the pair touches whatever its radii are.

    """
    check_contacts(packing, contacts)
    if not len(contacts):
        return
    i, j, image = contacts.i_c, contacts.j_c, contacts.image_cd
    for c in np.flatnonzero((np.minimum(i, j) < 0) | (np.maximum(i, j) >= packing.particles)):
        raise ValueError(
            f"contacts must be between particles 0 to {packing.particles - 1}, got {i[c]} and {j[c]} for contact {c}"
        )
    for c in np.flatnonzero((i == j) & ~image.any(axis=1)):
        raise ValueError(f"contacts must be between two particles or images, got {i[c]} and itself for contact {c}")
    twice = _twice(contacts)
    if twice is not None:
        one, two = twice
        raise ValueError(
            f"contacts must name each pair once, got particles {i[two]} and {j[two]}, image {image[two].tolist()},"
            f" for contacts {one} and {two}"
        )
    here = pair_contacts(packing, i, j, image)
    off = np.sqrt(((contacts.vector_cd - here.vector_cd) ** 2).sum(axis=1))
    # what is no number is not within it either
    within = _SAME * np.maximum(here.contact_distance_c, here.distance_c)
    for c in np.flatnonzero(~(off <= within)):
        raise ValueError(
            f"contacts must have the packing's vectors from center to center, got {contacts.vector_cd[c].tolist()}"
            f" instead of {here.vector_cd[c].tolist()} for contact {c} (particles {i[c]} and {j[c]},"
            f" image {image[c].tolist()})"
        )
    given = contacts.contact_distance_c
    known = (np.abs(given - here.contact_distance_c) <= within) | (np.abs(given - here.distance_c) <= within)
    for c in np.flatnonzero(~known):
        raise ValueError(
            f"contacts must have the packing's sums of radii or its distances, got {given[c]:.9g} instead of"
            f" {here.contact_distance_c[c]:.9g} or {here.distance_c[c]:.9g} for contact {c}"
            f" (particles {i[c]} and {j[c]})"
        )


def _twice(contacts: Contacts) -> tuple[int, int] | None:
    """Return the numbers of two contacts that are the same pair and image, seen from either side, or None."""
    i, j, image = contacts.i_c, contacts.j_c, contacts.image_cd
    rows = np.arange(len(contacts))
    first: NDArray[np.int64] = image[rows, (image != 0).argmax(axis=1)]
    turned = (i > j) | ((i == j) & (first < 0))
    pair = np.column_stack([np.minimum(i, j), np.maximum(i, j), np.where(turned[:, None], -image, image)])
    order = np.lexsort(pair.T)
    again = np.flatnonzero((pair[order[1:]] == pair[order[:-1]]).all(axis=1))
    if not len(again):
        return None
    one, two = sorted((int(order[again[0]]), int(order[again[0] + 1])))
    return one, two
