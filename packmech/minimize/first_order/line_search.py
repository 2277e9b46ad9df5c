# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""A line search that looks at slopes only, and the sums over long vectors that its callers need.

Differences of energies drown in rounding when net forces are still 1e-8 of the contact forces; the slope F.p does not,
so that a search for its zero takes conjugate gradients and L-BFGS down to the floor of double precision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from packmech.constraints.compiled_links import project_rows
from packmech.jit.compiled import device, inner_kernel
from packmech.minimize.passes.kernels import Sums, clear, net_forces
from packmech.minimize.passes.pair_list import PairList, follow, is_stale

_TRIALS = 40


class Reached(NamedTuple):
    """Where a search ended: sums and pair list there, step length, whether it is good, passes over the forces."""

    sums: Sums
    pairs: PairList
    length: float
    good: bool
    evaluations: int


@inner_kernel
def line_search(
    effects, axes, row, force_nd, direction_nd, space, pairs, start_f, slope, first, longest, fastest, shallow, steep
):
    """Move the rows along direction_nd to where -shallow slope <= F.p <= steep slope; return the Reached.

    `slope` is F.p > 0 at the start, `first` the first trial length, `longest` the largest length allowed, `fastest` the
    largest length of a particle's part of the direction. Forces at the end are left in force_nd.
    """
    d = len(axes)
    low = 0.0
    low_slope = slope
    high = np.inf
    high_slope = 0.0
    length = min(first, longest)
    last = 0.0
    fixed = 0.0
    side = 0
    good = False
    evaluations = 0
    sums = Sums(0.0, 0, 0.0, 0.0, 0.0)
    for _ in range(_TRIALS):
        for i in range(row.shape[0]):
            for a in range(d):
                row[i, a] = start_f[i * d + a] + length * direction_nd[i, a]
        back = fixed
        fixed = project_rows(space.links, axes, row, space)
        if is_stale(pairs.number, abs(length - last) * fastest + back + fixed):
            pairs, _ = follow(axes, row, space, pairs, None)
        clear(force_nd)
        sums = net_forces(None, effects, axes, row, force_nd, direction_nd, space, pairs, None)
        evaluations += 1
        last = length
        here = sums.power
        good = -shallow * slope <= here <= steep * slope or (length == longest and here > 0.0)
        if good:
            break
        if not abs(here) < np.inf:
            # forces beyond all numbers: a hard core was hit
            high = length
            high_slope = -np.inf
            length = low + 0.1 * (high - low)
            continue
        if here > 0.0:
            # the zero is farther on; where a straight line through the slopes meets it, in reason
            guess = 4.0 * length
            if high == np.inf and low_slope > here:
                guess = length + (length - low) * here / (low_slope - here)
            low = length
            low_slope = here
            if high == np.inf:
                length = min(max(guess, 1.5 * length), 4.0 * length, longest)
                continue
            again = side > 0
            side = 1
        else:
            high = length
            high_slope = here
            again = side < 0
            side = -1
        width = high - low
        if width <= 4e-16 * high:
            break
        # where the straight line vanishes; the middle when that has moved the same end twice
        part = 0.5 if again or high_slope == -np.inf else low_slope / (low_slope - high_slope)
        length = low + width * min(max(part, 0.05), 0.95)
    return Reached(sums, pairs, last, good, evaluations)


@device
def dot(a_f, b_f):
    """Return the inner product, summed in eight interleaved parts: fast, and with the same bits everywhere."""
    n = a_f.shape[0]
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    whole = n - n % 8
    for k in range(0, whole, 8):
        s0 += a_f[k] * b_f[k]
        s1 += a_f[k + 1] * b_f[k + 1]
        s2 += a_f[k + 2] * b_f[k + 2]
        s3 += a_f[k + 3] * b_f[k + 3]
        s4 += a_f[k + 4] * b_f[k + 4]
        s5 += a_f[k + 5] * b_f[k + 5]
        s6 += a_f[k + 6] * b_f[k + 6]
        s7 += a_f[k + 7] * b_f[k + 7]
    rest = 0.0
    for k in range(whole, n):
        rest += a_f[k] * b_f[k]
    return ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7)) + rest


@device
def add_to(a_f, factor, b_f):
    """Set a = a + factor b."""
    for k in range(a_f.shape[0]):
        a_f[k] += factor * b_f[k]


@device
def copy_to(a_f, b_f):
    """Set a = b."""
    for k in range(a_f.shape[0]):
        a_f[k] = b_f[k]


@device
def read_places(axes, row, place_f):
    """Copy the positions of the rows to a flat vector."""
    d = len(axes)
    for i in range(row.shape[0]):
        for a in range(d):
            place_f[i * d + a] = row[i, a]


@device
def longest(axes, vector_nd):
    """Return the largest length of a particle's part of the vector."""
    largest = 0.0
    for i in range(vector_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += vector_nd[i, a] * vector_nd[i, a]
        largest = max(largest, own)
    return largest**0.5
