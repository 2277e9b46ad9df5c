"""Where the search for a hard packing starts from a large soft one: near balance at every pair, and at every rattler.

One step length serves all particles of an interior-point step, so that a single pair far off holds up all others. From
a soft packing in rough balance two kinds are. Contacts: slack and force of each are those of a spring behind a barrier,

    slack - gap = force / stiffness,   slack * force = barrier,

so that all products are the same, and forces of contacts nearly those of the soft packing. Rattlers: each is taken to
where the barriers of its cage balance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.jamming.hard_packing import HardState, NearPairs, start_state
from packmech.jit.compiled import kernel

# barrier over mean overlap times mean force: slacks of contacts come to about three overlaps
_BARRIER = 10.0
# forces below this part of the mean hold nothing
_BEARS = 1e-2
# visits of all rattlers, steps of each, and how far one may go, over the reach of the list times its radius
_ROUNDS, _STEPS, _FURTHEST = 12, 3, 0.7
# part of a gap that one step may close
_CLOSED = 0.7


@kernel
def _pairs_of(i_c, j_c, particles):  # type: ignore[no-untyped-def]
    """Return where the pairs of each particle begin in a list of them, and that list; own images are left out."""
    first = np.zeros(particles + 1, np.int64)
    for c in range(i_c.shape[0]):
        if i_c[c] != j_c[c]:
            first[i_c[c] + 1] += 1
            first[j_c[c] + 1] += 1
    for i in range(particles):
        first[i + 1] += first[i]
    place, pair = first[:-1].copy(), np.empty(first[-1], np.int64)
    for c in range(i_c.shape[0]):
        if i_c[c] != j_c[c]:
            for i in (i_c[c], j_c[c]):
                pair[place[i]] = c
                place[i] += 1
    return first, pair


@kernel
def _step_inward(position, lattice, i, pair, pairs, sigma_c):  # type: ignore[no-untyped-def]
    """Return Newton's step of a particle towards the middle of its cage, short enough to close none of its gaps."""
    i_c, j_c, image_cd = pairs
    d, count = position.shape[1], pair.shape[0]
    gap, normal = np.empty(count), np.zeros((count, d))
    for m in range(count):
        c = pair[m]
        sign = 1.0 if j_c[c] == i else -1.0
        square = 0.0
        for a in range(d):
            v = position[j_c[c], a] - position[i_c[c], a]
            for b in range(d):
                v += lattice[a, b] * image_cd[c, b]
            normal[m, a] = sign * v
            square += v * v
        gap[m] = np.sqrt(square) - sigma_c[c]
        normal[m] /= np.sqrt(square)
    # where gaps overlap all are widened by twice as much
    gap += 2.0 * max(0.0, -gap.min()) + 1e-9
    slope, curvature = np.zeros(d), np.zeros((d, d))
    for m in range(count):
        for a in range(d):
            slope[a] += normal[m, a] / gap[m]
            for b in range(d):
                curvature[a, b] += normal[m, a] * normal[m, b] / gap[m] ** 2
    trace = 0.0
    for a in range(d):
        trace += curvature[a, a]
    for a in range(d):
        curvature[a, a] += 1e-6 * trace
    step = np.linalg.solve(curvature, slope)
    size = 1.0
    for m in range(count):
        growth = 0.0
        for a in range(d):
            growth += normal[m, a] * step[a]
        if growth < 0.0:
            size = min(size, -_CLOSED * gap[m] / growth)
    return size * step


@kernel
def _center(position, lattice, pairs, sigma_c, rattling_n, furthest_n):  # type: ignore[no-untyped-def]
    """Take rattlers, one after another and again and again, to the middle of their cages."""
    first, pair = _pairs_of(pairs[0], pairs[1], position.shape[0])
    start = position.copy()
    for _ in range(_ROUNDS):
        for i in range(position.shape[0]):
            if not rattling_n[i] or first[i] == first[i + 1]:
                continue
            for _ in range(_STEPS):
                step = _step_inward(position, lattice, i, pair[first[i] : first[i + 1]], pairs, sigma_c)
                gone = 0.0
                for a in range(position.shape[1]):
                    gone += (position[i, a] + step[a] - start[i, a]) ** 2
                # pairs that are not listed stay apart
                if gone > furthest_n[i] ** 2:
                    break
                for a in range(position.shape[1]):
                    position[i, a] += step[a]


def _rattling(pairs: NearPairs, bears_c: NDArray[np.bool_], particles: int) -> NDArray[np.bool_]:
    """Return the (N,) particles that fewer than d + 1 contacts hold, found again and again until no more are."""
    i_c, j_c, dimension = pairs.list.i_c, pairs.list.j_c, pairs.list.image_cd.shape[1]
    rattling, bears = np.zeros(particles, dtype=bool), bears_c.copy()
    while True:
        ends = np.concatenate([i_c[bears], j_c[bears]])
        more = (np.bincount(ends, minlength=particles) <= dimension) & ~rattling
        if not more.any():
            return rattling
        rattling |= more
        bears &= ~(rattling[i_c] | rattling[j_c])


def settled_start(
    position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64], radius_n: NDArray[np.float64], load: float
) -> HardState:
    """Return the first state of a search that begins at a soft packing in rough balance.

    Parameters
    ----------
    position_nd, lattice_dd, radius_n, load
        As in `start_state`, which is what a packing without overlaps gets.

    """
    pairs = NearPairs(position_nd, lattice_dd, radius_n)
    overlap = np.maximum(-pairs.measure(position_nd, lattice_dd), 0.0)
    if not overlap.any():
        return start_state(position_nd, lattice_dd, radius_n, load)
    bears = overlap > _BEARS * overlap[overlap > 0.0].mean()
    rattling = _rattling(pairs, bears, len(radius_n))
    position, lattice = position_nd.copy(), lattice_dd.copy()
    _center(position, lattice, tuple(pairs.list), pairs.sigma_c, rattling, _FURTHEST * pairs.reach * radius_n)
    gap = pairs.measure(position, lattice)
    depth = -float(gap[gap < 0.0].mean()) if (gap < 0.0).any() else float(overlap[bears].mean())
    barrier = _BARRIER * depth**2
    slack = 0.5 * (gap + np.sqrt(gap**2 + 4.0 * barrier))
    force = barrier / slack
    force *= load / float((force * pairs.distance_c).sum())
    mean, violation = float((force * slack).mean()), float((slack - gap).max())
    return HardState(position, lattice, pairs.list, slack, force, mean, violation)
