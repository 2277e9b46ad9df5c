# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What `link_system` computes, compiled for calls from Python."""

from __future__ import annotations

from typing import Any

import numpy as np

from packmech.compiled import device, kernel
from packmech.mechanics.link_affix import reaffix_recorded
from packmech.mechanics.link_factor import solve_links
from packmech.mechanics.link_system import (
    AT_ROUNDING,
    MOST_PASSES,
    project_vector,
    push,
    rates,
    refill,
)


@kernel
def refill_links(system, position, lattice):
    """Call `refill` from Python."""
    return refill(system, position, lattice)


@kernel
def project_links(system, vector_nd, out_nd, multiplier_l, of_force):
    """Call `project_force` (or `project_velocity`) from Python."""
    return project_vector(system, vector_nd, out_nd, multiplier_l, of_force)


@kernel
def record_links(system, position, lattice, tolerance, most_iterations, error_t):
    """Call `reaffix_recorded` from Python."""
    return reaffix_recorded(system, position, lattice, tolerance, most_iterations, error_t)


def reaffix_links(system: Any, position: Any, lattice: Any, tolerance: float, most_iterations: int) -> Any:
    """Call `reaffix` from Python."""
    return record_links(system, position, lattice, tolerance, most_iterations, np.empty(0))


@device
def _move(system, rate_l, motion_nd, multiplier_l):
    """Set motion = Omega multiplier, multiplier = A^-1 rate: for equal masses the shortest motion with these rates."""
    order, value = system.order_r, system.multiplier_r
    motion_nd[:] = 0.0
    multiplier_l[:] = 0.0
    # each further pass takes the rounding of the one before out
    for _ in range(MOST_PASSES):
        rates(system, motion_nd, True)
        rest, largest = 0.0, 0.0
        for r in range(order.shape[0]):
            value[r] -= rate_l[order[r]]
            rest = max(rest, abs(value[r]))
            largest = max(largest, abs(rate_l[order[r]]))
        if not rest > AT_ROUNDING * largest:
            break
        solve_links(system, value)
        for r in range(order.shape[0]):
            multiplier_l[order[r]] -= value[r]
        push(system, value, motion_nd, True)


@kernel
def move_links(system, rate_l, motion_nd, multiplier_l):
    """Set motion = Omega multiplier, multiplier = A^-1 rate: for equal masses the shortest motion with these rates."""
    _move(system, rate_l, motion_nd, multiplier_l)


@device
def _dot(one, other):
    """Return a sum in one order, whatever the number of threads."""
    total = 0.0
    for k in range(one.shape[0]):
        total += one[k] * other[k]
    return total


@kernel
def prepare_strains(system, basis_edd, scale, rows_el, part_el, motion_ex, inner_ee):
    """Set the links' rates under each scaled strain, the motions Y with these rates, and 1 + Y^T Y.

    The basis holds the strains' tensors, part the multipliers of the motions. Needs `refill` at this configuration.
    """
    normal, d = system.normal_rd, len(system.axes)
    for m in range(basis_edd.shape[0]):
        for r in range(system.order_r.shape[0]):
            stretch = 0.0
            for a in range(d):
                for b in range(d):
                    stretch += normal[r, a] * basis_edd[m, a, b] * normal[r, b]
            rows_el[m, system.order_r[r]] = stretch * system.distance_r[r] / scale
        _move(system, rows_el[m], motion_ex[m].reshape((motion_ex.shape[1] // d, d)), part_el[m])
        for k in range(m + 1):
            inner_ee[m, k] = inner_ee[k, m] = _dot(motion_ex[m], motion_ex[k]) + (1.0 if k == m else 0.0)


@kernel
def project_strained(system, strains, force_nd, pull_e, out_nd, strain_e, multiplier_l):
    """Set out, strain and multiplier: what is left of a force and of one on the scaled strains, and the links' shares.

    `strains` holds what `prepare_strains` set, (rows, part, motion), and the matrix that makes of a pull the strain
    that is free to follow it. A second pass takes the rounding of the first one out. Returns the part of the pull that
    is left on the trace, held or not, and the largest rate of a link.
    """
    rows, part, motion, follow, held = strains
    count = rows.shape[0]
    square = _dot(held, held)
    more, own, share = np.empty(rows.shape[1]), np.empty(count), 0.0
    out, force = out_nd.reshape(out_nd.size), force_nd.reshape(force_nd.size)
    out[:] = force
    strain_e[:] = pull_e
    multiplier_l[:] = 0.0
    for _ in range(2):
        for m in range(count):
            own[m] = strain_e[m] - _dot(motion[m], out)
        for m in range(count):
            own_m = _dot(follow[m], own)
            share += held[m] * (strain_e[m] - own_m) / square if square > 0.0 else 0.0
            strain_e[m] = own_m
        project_vector(system, out_nd, out_nd, more, True)
        for m in range(count):
            for x in range(out.shape[0]):
                out[x] -= strain_e[m] * motion[m, x]
            for k in range(more.shape[0]):
                more[k] += strain_e[m] * part[m, k]
        for m in range(count):
            share -= held[m] * _dot(rows[m], more) / square if square > 0.0 else 0.0
        multiplier_l += more
    rates(system, out_nd, True)
    largest = abs(_dot(held, strain_e))
    for r in range(more.shape[0]):
        rate = system.multiplier_r[r]
        for m in range(count):
            rate += rows[m, system.order_r[r]] * strain_e[m]
        if not abs(rate) <= largest:
            largest = abs(rate)
    return share, largest
