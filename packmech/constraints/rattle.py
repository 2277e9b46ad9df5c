# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""RATTLE: the two projections of a time step onto links, and the forces in these.

Positions go back to the links' lengths along the gradients at the old positions, x - W Omega_old lambda, and velocities
to those that change no length. Then a step is its own inverse when velocities are reversed, it is symplectic, and the
method is of second order (H. C. Andersen, J. Comput. Phys. 52, 24, 1983; B. Leimkuhler and R. Skeel, ibid. 112, 117,
1994). W are the inverse masses. The impulses are internal and along the links, so momentum and angular momentum hold.

Rows hold a position in the first columns, velocities are in arrays of their own. One thread does all of it, so that the
number of threads changes no bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.compiled_links import ERROR, ITERATIONS, NUMBERS, CompiledLinks
from packmech.constraints.link_system import (
    NEWTON,
    TIGHT,
    Lengths,
    LinkSystem,
    measure_lengths,
    project_force,
    project_links,
    project_velocity,
    record_link_positions,
    refill,
    refill_links,
    set_multipliers,
    solve_links,
)
from packmech.jit.compiled import device, inner_lean

# errors, over the larger of a link's length and the mean diameter, that are rounding where they no longer fall; links
# with larger ones are lost
_ROUNDING = 1e-13
_ITERATION_LIMIT = 200


class Rattle(NamedTuple):
    """The links between rows as time steps take them, at the start of a step, factored, and their lengths at its end.

    tension_l holds the tensions that were last measured, centripetal_l the part of them by which links turn. Errors of
    links are over their scale: brought down to `tolerance`, lost above `lost`. `number` holds the largest at the end of
    the last step, and the iterations so far.
    """

    here: LinkSystem
    there: Lengths
    impulse_r: NDArray[np.float64]
    multiplier_l: NDArray[np.float64]
    tension_l: NDArray[np.float64]
    centripetal_l: NDArray[np.float64]
    tolerance: float
    lost: float
    number: NDArray[np.float64]


def make_rattle(links: CompiledLinks, inverse_mass_n: NDArray[np.float64], resolution: float) -> Rattle:
    """Return the links of rows as time steps take them; `project_rattle` or `refill_rattle` put the numbers in.

    Parameters
    ----------
    links
        The links between the rows.
    inverse_mass_n
        (N,) inverse masses of the rows, zero for what is held.
    resolution
        Rounding of positions [length].

    """
    here = links.system._replace(inverse_mass_n=inverse_mass_n)
    there = Lengths(np.zeros_like(here.normal_rd), np.zeros_like(here.distance_r), np.zeros_like(here.error_r))
    count = len(here.length_r)
    tolerance = max(TIGHT, 2.0 * resolution / float(here.scale_r.min()))
    return Rattle(
        here,
        there,
        impulse_r=np.zeros(count),
        multiplier_l=np.zeros(count),
        tension_l=np.zeros(count),
        centripetal_l=np.zeros(count),
        tolerance=tolerance,
        lost=max(_ROUNDING, 4.0 * tolerance),
        number=np.zeros(NUMBERS),
    )


def project_rattle(rattle: Rattle | None, row: NDArray[np.float64], lattice: NDArray[np.float64]) -> None:
    """Move rows, whose first columns are positions, back onto the links' lengths by the least displacement.

    Raises
    ------
    ValueError
        If that cannot be done.

    """
    if rattle is None:
        return
    _, error, _ = record_link_positions(rattle.here, row, lattice, rattle.tolerance, NEWTON, np.empty(0))
    if not error <= rattle.lost:
        raise ValueError(f"scene.packing must have links that can be held at their lengths, got an error of {error:g}")
    refill_rattle(rattle, row, lattice)
    rattle.number[ERROR] = error


def refill_rattle(rattle: Rattle, row: NDArray[np.float64], lattice: NDArray[np.float64]) -> None:
    """Set the gradients of the links and their factor at the present rows."""
    refill_links(rattle.here, row, lattice)


def along_rattle(rattle: Rattle | None, velocity_nd: NDArray[np.float64]) -> int:
    """Take what would stretch links out of the (N, d) velocities of rows; return how many links are independent."""
    if rattle is None:
        return 0
    project_links(rattle.here, velocity_nd, velocity_nd, rattle.multiplier_l, False)
    return int(np.count_nonzero(rattle.here.inverse_pivot_r))


@device
def _pull(system, value_r, factor, vector_nd, first):
    """Take factor W Omega value from positions or velocities, which start at a column of rows."""
    normal, weight = system.normal_rd, system.inverse_mass_n
    for r in range(value_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        for a in range(len(system.axes)):
            impulse = factor * value_r[r] * normal[r, a]
            vector_nd[j, first + a] -= weight[j] * impulse
            vector_nd[i, first + a] += weight[i] * impulse


@device
def _rattle_positions(rattle, row, lattice):
    """Move rows back to the links' lengths by impulse_r, along the links as they were; return whether that worked."""
    here, there, impulse = rattle.here, rattle.there, rattle.impulse_r
    value = here.multiplier_r
    for r in range(impulse.shape[0]):
        impulse[r] = 0.0
    worst = measure_lengths(here, there, row, lattice)
    tries = 0
    # Newton's method with the matrix of the old positions: it differs from the right one by the turn of a step
    while not worst <= rattle.tolerance and tries < _ITERATION_LIMIT:
        for r in range(impulse.shape[0]):
            value[r] = there.error_r[r]
        solve_links(here, value)
        for r in range(impulse.shape[0]):
            impulse[r] += value[r]
        _pull(here, value, 1.0, row, 0)
        before = worst
        worst = measure_lengths(here, there, row, lattice)
        tries += 1
        if worst <= rattle.lost and worst > 0.5 * before:
            break
    rattle.number[ERROR] = worst
    rattle.number[ITERATIONS] += tries
    return worst <= rattle.lost


@inner_lean
def rattle_positions(rattle, axes, body, half_nd, lattice, dt, ahead, moved):
    """Move rows that went dt v from good ones back to the links' lengths, the velocities half_nd with them.

    The velocities in the rows are half + ahead (half - what they were before), and stay so. Returns the largest
    displacement in the step, `moved` where nothing is linked, infinity where links are lost.
    """
    if rattle is None:
        return moved
    d = len(axes)
    good = _rattle_positions(rattle, body, lattice)
    _pull(rattle.here, rattle.impulse_r, 1.0 / dt, half_nd, 0)
    if ahead > 0.0:
        _pull(rattle.here, rattle.impulse_r, (1.0 + ahead) / dt, body, 4)
    refill(rattle.here, body, lattice)
    if ahead == 0.0:
        # these are the velocities at the end of the step
        project_velocity(rattle.here, half_nd, half_nd, rattle.multiplier_l)
        for i in range(body.shape[0]):
            for a in range(d):
                body[i, 4 + a] = half_nd[i, a]
    largest = 0.0
    for i in range(body.shape[0]):
        square = 0.0
        for a in range(d):
            square += half_nd[i, a] * half_nd[i, a]
        # written so that a speed that is not a number is the largest
        if not square <= largest:
            largest = square
    return dt * math.sqrt(largest) if good else np.inf


@inner_lean
def rattle_velocities(rattle, axes, body, half_nd):
    """Project the velocities in rows onto those that change no link's length; half_nd is room for them."""
    d = len(axes)
    for i in range(body.shape[0]):
        for a in range(d):
            half_nd[i, a] = body[i, 4 + a]
    project_velocity(rattle.here, half_nd, half_nd, rattle.multiplier_l)
    for i in range(body.shape[0]):
        for a in range(d):
            body[i, 4 + a] = half_nd[i, a]


@inner_lean
def measure_tensions(rattle, axes, body, push):
    """Set tension_l to the forces in the links, tension positive; return the largest net force with them.

    A link's length does not accelerate: n.(a_j - a_i) = -w^2 / length with w the relative velocity across it, so
    that (Omega^T W Omega) t = Omega^T W F + w^2 / length. push (N, >= d) are the forces F of everything else.
    """
    here, d = rattle.here, len(axes)
    force, motion, turning = here.spare_nd, here.start_nd, rattle.multiplier_l
    for i in range(body.shape[0]):
        for a in range(d):
            force[i, a] = push[i, a]
    for r in range(here.i_r.shape[0]):
        i, j = here.i_r[r], here.j_r[r]
        along = square = 0.0
        for a in range(d):
            rate = body[j, 4 + a] - body[i, 4 + a]
            along += rate * here.normal_rd[r, a]
            square += rate * rate
        turning[here.order_r[r]] = (square - along * along) / here.distance_r[r]
    project_force(here, force, force, rattle.tension_l)
    set_multipliers(here, turning, motion, rattle.centripetal_l)
    for k in range(turning.shape[0]):
        rattle.tension_l[k] += rattle.centripetal_l[k]
    largest = 0.0
    for i in range(body.shape[0]):
        square = 0.0
        for a in range(d):
            net = force[i, a] - motion[i, a]
            square += net * net
        largest = max(largest, square)
    return math.sqrt(largest)
