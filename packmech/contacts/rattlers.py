"""Loose particles: those that their contacts do not hold, found again and again until none is left.

A particle can move freely, to first order, when there is a direction u != 0 along which it approaches no neighbor:
n . u <= 0 for all its contact normals n (pointing outwards). It is held exactly when there is none, that is when the
normals span the space and admit a strictly positive balance, sum of s n = 0 with every s > 0. Fewer than d + 1 contacts
never do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.compiled import device, kernel
from packmech.contacts.network import Contacts
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
def _within_half_plane(x: NDArray[np.float64], y: NDArray[np.float64], count: int) -> bool:
    """Return whether some direction of the plane makes no acute angle with the first `count` vectors (x, y)."""
    if count >= 3 and _surely_around(x, y, count):
        return False
    angle = np.empty(count)
    used = 0
    for k in range(count):
        # a vector this short puts no bound on motions within the plane
        if x[k] * x[k] + y[k] * y[k] > _OPPOSITE * _OPPOSITE:
            angle[used] = np.arctan2(y[k], x[k])
            used += 1
    if used < 3:
        return True
    angle = np.sort(angle[:used])
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
def _is_free(normal: NDArray[np.float64], count: int) -> bool:
    """Return whether a particle with the first `count` rows of `normal` as its contact normals can move."""
    d = normal.shape[1]
    if count < d + 1:
        return True
    if d == 2:
        return _within_half_plane(normal[:, 0], normal[:, 1], count)
    if _surely_balanced(normal, count):
        return False
    # If any motion is free, one is that slides along some contact a: look for it in the plane across each normal.
    x = np.empty(count)
    y = np.empty(count)
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
        if _within_half_plane(x, y, count):
            return True
    return False


@kernel
def _find_loose(
    start: NDArray[np.int64], neighbor: NDArray[np.int64], outward: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return who is loose; outward[start[i]:start[i+1]] are the normals of particle i, towards `neighbor`."""
    particles = start.shape[0] - 1
    d = outward.shape[1]
    loose = np.zeros(particles, np.bool_)
    # first in, first out: a large particle with many neighbors is looked at once a round, not once for each it loses
    waiting = np.ones(particles, np.bool_)
    queue = np.arange(particles)
    length = particles
    head = 0
    most = 0
    for i in range(particles):
        most = max(most, start[i + 1] - start[i])
    normal = np.empty((most, d))
    while length > 0:
        i = queue[head]
        head = (head + 1) % particles
        length -= 1
        waiting[i] = False
        count = 0
        for h in range(start[i], start[i + 1]):
            if not loose[neighbor[h]]:
                for k in range(d):
                    normal[count, k] = outward[h, k]
                count += 1
        if not _is_free(normal, count):
            continue
        loose[i] = True
        for h in range(start[i], start[i + 1]):
            j = neighbor[h]
            if not loose[j] and not waiting[j]:
                waiting[j] = True
                queue[(head + length) % particles] = j
                length += 1
    return loose


@kernel
def _outward(i_c: NDArray[np.int64], j_c: NDArray[np.int64], normal_cd: NDArray[np.float64], particles: int) -> Any:
    """Return where each particle's contacts start, its neighbors, and the normals towards these."""
    count, d = normal_cd.shape
    start = np.zeros(particles + 2, np.int64)
    for c in range(count):
        start[i_c[c] + 2] += 1
        start[j_c[c] + 2] += 1
    for n in range(particles):
        start[n + 2] += start[n + 1]
    neighbor, outward = np.empty(2 * count, np.int64), np.empty((2 * count, d))
    for side in range(2):
        for c in range(count):
            own, other = (i_c[c], j_c[c]) if side == 0 else (j_c[c], i_c[c])
            at = start[own + 1]
            start[own + 1] += 1
            neighbor[at] = other
            for a in range(d):
                outward[at, a] = normal_cd[c, a] if side == 0 else -normal_cd[c, a]
    return start[: particles + 1], neighbor, outward


def loose_ends(
    i_c: NDArray[np.int64], j_c: NDArray[np.int64], normal_cd: NDArray[np.float64], particles: int
) -> NDArray[np.bool_]:
    """Return, for each of so many bodies, whether contacts with these normals from i to j leave it free to move."""
    loose: NDArray[np.bool_] = _find_loose(*_outward(i_c, j_c, normal_cd, particles))
    return loose


def loose_particles(contacts: Contacts) -> NDArray[np.bool_]:
    """Return, for each particle, whether the given contacts leave it free, the free ones removed first.

    Parameters
    ----------
    contacts
        The contacts; one with the particle's own image holds it from both sides.

    """
    return loose_ends(contacts.i_c, contacts.j_c, contacts.normal_cd, contacts.particles)


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
