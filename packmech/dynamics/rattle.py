# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links in time-stepped dynamics: RATTLE, chosen by type, so that a scene without links has no code and no cost of it.

Positions go back to the links' lengths along the gradients at the old positions, x - W Omega_old lambda, and not by the
shortest way along the new ones: then a step is its own inverse when velocities are reversed, it is symplectic, and the
method is of second order (H. C. Andersen, J. Comput. Phys. 52, 24, 1983; B. Leimkuhler and R. Skeel, ibid. 112, 117,
1994). W are the inverse masses. The impulses are internal and along the links, so momentum and angular momentum hold.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device
from packmech.dynamics.joints import TIGHT, Joints, has_links
from packmech.mechanics.link_factor import solve_links
from packmech.mechanics.link_system import (
    LinkSystem,
    measure,
    project_velocity,
    refill,
)

# errors, over the larger of a link's length and the mean diameter, that are rounding where they no longer fall; links
# with larger ones are lost
_ROUNDING = 1e-13
_MOST_TRIES = 200
# places in Rattle.number
ERROR, TRIES, NUMBERS = 0, 1, 2


class Rattle(NamedTuple):
    """The links of a program in two configurations: at the start of a step, factored, and on the way to its end.

    Errors of links are over their scale: brought down to `tolerance`, lost above `lost`. `number` holds the largest at
    the end of the last step, and the iterations so far.
    """

    here: LinkSystem
    there: LinkSystem
    impulse_r: NDArray[np.float64]
    multiplier_l: NDArray[np.float64]
    tolerance: float
    lost: float
    number: NDArray[np.float64]


def make_rattle(joints: Joints | None, inverse_mass_n: NDArray[np.float64], resolution: float) -> Rattle | None:
    """Return the links of a program as time steps take them; None where there are none.

    Parameters
    ----------
    joints
        The links of the program.
    inverse_mass_n
        (N,) inverse masses of its rows.
    resolution
        Rounding of positions [length].

    """
    if joints is None:
        return None
    here = joints.system._replace(inverse_mass_n=inverse_mass_n)
    there = here._replace(
        normal_rd=np.zeros_like(here.normal_rd),
        distance_r=np.zeros_like(here.distance_r),
        error_r=np.zeros_like(here.error_r),
    )
    count = len(here.length_r)
    tolerance = max(TIGHT, 2.0 * resolution / float(here.scale_r.min()))
    lost = max(_ROUNDING, 4.0 * tolerance)
    return Rattle(here, there, np.zeros(count), np.zeros(count), tolerance, lost, np.zeros(NUMBERS))


@device
def _pull(system, value_r, factor, vector_nd):
    """Take factor W Omega value from positions or velocities."""
    normal, weight = system.normal_rd, system.inverse_mass_n
    for r in range(value_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        for a in range(len(system.axes)):
            impulse = factor * value_r[r] * normal[r, a]
            vector_nd[j, a] -= weight[j] * impulse
            vector_nd[i, a] += weight[i] * impulse


@device
def _hold(rattle, row, velocity_nd, lattice, dt):
    here, there, impulse = rattle.here, rattle.there, rattle.impulse_r
    value = here.multiplier_r
    for r in range(impulse.shape[0]):
        impulse[r] = 0.0
    worst = measure(there, row, lattice)
    tries = 0
    # Newton's method with the matrix of the old positions: it differs from the right one by the turn of a step
    while not worst <= rattle.tolerance and tries < _MOST_TRIES:
        for r in range(impulse.shape[0]):
            value[r] = there.error_r[r]
        solve_links(here, value)
        for r in range(impulse.shape[0]):
            impulse[r] += value[r]
        _pull(here, value, 1.0, row)
        before = worst
        worst = measure(there, row, lattice)
        tries += 1
        if worst <= rattle.lost and worst > 0.5 * before:
            break
    _pull(here, impulse, 1.0 / dt, velocity_nd)
    refill(here, row, lattice)
    rattle.number[ERROR] = worst
    rattle.number[TRIES] += tries
    return worst <= rattle.lost


@device
def _tangent(rattle, velocity_nd):
    project_velocity(rattle.here, velocity_nd, velocity_nd, rattle.multiplier_l)


def hold(
    rattle: Rattle | None, row: NDArray[np.float64], velocity_nd: NDArray[np.float64], lattice: Any, dt: float
) -> bool:
    """Move rows that went dt v from good ones back to the links' lengths, v with them; return whether that worked."""
    return True if rattle is None else bool(_hold(rattle, row, velocity_nd, lattice, dt))


@compiled_form(hold)
def _choose_hold(rattle: Any, row: Any, velocity_nd: Any, lattice: Any, dt: Any) -> Any:
    if has_links(rattle):
        return lambda rattle, row, velocity_nd, lattice, dt: _hold(rattle, row, velocity_nd, lattice, dt)
    return lambda rattle, row, velocity_nd, lattice, dt: True


def tangent(rattle: Rattle | None, velocity_nd: NDArray[np.float64]) -> None:
    """Project velocities onto those that change no link's length, at the rows of the last `hold` or refill."""
    if rattle is not None:
        _tangent(rattle, velocity_nd)


@compiled_form(tangent)
def _choose_tangent(rattle: Any, velocity_nd: Any) -> Any:
    def project_it(rattle: Any, velocity_nd: Any) -> None:
        _tangent(rattle, velocity_nd)

    def nothing(rattle: Any, velocity_nd: Any) -> None:
        pass

    return project_it if has_links(rattle) else nothing
