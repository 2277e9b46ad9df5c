# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What `link_system` computes, compiled for calls from Python."""

from __future__ import annotations

import numpy as np

from packmech.compiled import kernel
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


def reaffix_links(system, position, lattice, tolerance, most_iterations):
    """Call `reaffix` from Python."""
    return record_links(system, position, lattice, tolerance, most_iterations, np.empty(0))


@kernel
def move_links(system, rate_l, motion_nd, multiplier_l):
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
