# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Time steps of Newton's equations: velocity Verlet and semi-implicit Euler, with RATTLE where there are links.

Both loops start and end with the forces of the present positions in force_nd, so that a run may be cut into chunks
anywhere without a change of a bit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.compiled import kernel
from packmech.dynamics.kernels import NOT_FINITE, RUNNING, STALLED, clear, force_pass, travel
from packmech.dynamics.rattle import hold, tangent
from packmech.effects import pair_energy, pair_first

if TYPE_CHECKING:
    from packmech.dynamics.motion import Motion

# in one step somebody moved farther than the loop was told, over whole particles, or numbers overflowed
LINKS_LOST, TOO_FAST = STALLED, NOT_FINITE


class VelocityVerlet(NamedTuple):
    """Velocity Verlet, of second order; with rigid links RATTLE. Symplectic, and its own inverse, without dashpots.

    Dashpots see a velocity extrapolated to the end of the step, 2 v(half) - v(start), so that the method stays of
    second order with them, as long as no contact opens or closes: there a dashpot's force jumps.

    Parameters
    ----------
    fraction
        Where no time step is given it is this fraction of the shortest of sqrt(m / stiffness) and m / damping [1].

    """

    fraction: float = 0.05

    def advance(self, motion: Motion, steps: int) -> tuple[int, int]:
        """Advance by up to `steps` steps; return how that ended and the steps taken."""
        return motion.advance(verlet_steps, steps)


class SemiImplicitEuler(NamedTuple):
    """Semi-implicit Euler, v += dt F(x) / m and then x += dt v, of first order; with rigid links as RATTLE does.

    Parameters
    ----------
    fraction
        As for `VelocityVerlet`.

    """

    fraction: float = 0.05

    def advance(self, motion: Motion, steps: int) -> tuple[int, int]:
        """Advance by up to `steps` steps; return how that ended and the steps taken."""
        return motion.advance(euler_steps, steps)


@kernel
def start_forces(effects, axes, row, force_nd, velocity_nd, space, pairs):
    """Set the forces at the present positions and velocities; return the pair list."""
    pairs = travel(axes, row, space, pairs, np.inf)
    clear(force_nd)
    force_pass(effects, axes, row, force_nd, velocity_nd, pairs)
    return pairs


@kernel
def kick_and_drift(axes, row, force_nd, velocity_nd, half_nd, weight_n, kick, dt):
    """Set half = v + kick F / m and move by dt half."""
    for i in range(row.shape[0]):
        push = kick * weight_n[i]
        for a in range(len(axes)):
            half = velocity_nd[i, a] + push * force_nd[i, a]
            half_nd[i, a] = half
            row[i, a] += dt * half


@kernel
def extrapolate(axes, force_nd, velocity_nd, half_nd, ahead):
    """Set v = half + ahead (half - v) and clear the forces; return the largest speed in half."""
    most = 0.0
    for i in range(velocity_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            half = half_nd[i, a]
            velocity_nd[i, a] = half + ahead * (half - velocity_nd[i, a])
            force_nd[i, a] = 0.0
            own += half * half
        # written so that a speed that is not a number is the largest
        if not own <= most:
            most = own
    return math.sqrt(most)


@kernel
def verlet_steps(effects, axes, row, force_nd, velocity_nd, half_nd, weight_n, space, rattle, pairs, dt, reach, steps):
    """Take up to `steps` velocity Verlet steps; return how that ended, the steps taken and the pair list."""
    for step in range(steps):
        kick_and_drift(axes, row, force_nd, velocity_nd, half_nd, weight_n, 0.5 * dt, dt)
        if not hold(rattle, row, half_nd, space.frame.lattice_dd, dt):
            return LINKS_LOST, step, pairs
        fastest = extrapolate(axes, force_nd, velocity_nd, half_nd, 1.0)
        if not dt * fastest < reach:
            return TOO_FAST, step, pairs
        pairs = travel(axes, row, space, pairs, dt * fastest)
        force_pass(effects, axes, row, force_nd, velocity_nd, pairs)
        for i in range(row.shape[0]):
            push = 0.5 * dt * weight_n[i]
            for a in range(len(axes)):
                velocity_nd[i, a] = half_nd[i, a] + push * force_nd[i, a]
        tangent(rattle, velocity_nd)
    return RUNNING, steps, pairs


@kernel
def euler_steps(effects, axes, row, force_nd, velocity_nd, half_nd, weight_n, space, rattle, pairs, dt, reach, steps):
    """Take up to `steps` semi-implicit Euler steps; return how that ended, the steps taken and the pair list."""
    for step in range(steps):
        kick_and_drift(axes, row, force_nd, velocity_nd, half_nd, weight_n, dt, dt)
        if not hold(rattle, row, half_nd, space.frame.lattice_dd, dt):
            return LINKS_LOST, step, pairs
        fastest = extrapolate(axes, force_nd, velocity_nd, half_nd, 0.0)
        if not dt * fastest < reach:
            return TOO_FAST, step, pairs
        tangent(rattle, velocity_nd)
        pairs = travel(axes, row, space, pairs, dt * fastest)
        force_pass(effects, axes, row, force_nd, velocity_nd, pairs)
    return RUNNING, steps, pairs


class Look(NamedTuple):
    """Energy of the touching pairs, and the sum over them of (total radial force) n v, dashpots included.

    virial_dd is V times the contacts' part of the stress, tension positive.
    """

    energy: float
    virial_dd: NDArray[np.float64]


@kernel
def look(effects, axes, row, velocity_nd, pairs):
    """Return the Look at the present positions and velocities; nothing of the run is changed."""
    energy = 0.0
    virial = np.zeros((3, 3))
    v = np.zeros(3)
    within = pairs.count_b[0]
    for p in range(within + pairs.count_b[1]):
        if p < within:
            i, j = np.int64(pairs.i_p[p]), np.int64(pairs.j_p[p])
        else:
            i, j = np.int64(pairs.crossing_i_p[p - within]), np.int64(pairs.crossing_j_p[p - within])
        square = 0.0
        for a in range(3):
            v[a] = row[j, a] - row[i, a]
            if p >= within:
                v[a] += pairs.shift_kd[pairs.crossing_k_p[p - within], a]
            square += v[a] * v[a]
        sigma = row[i, 3] + row[j, 3]
        if square < sigma * sigma:
            r = math.sqrt(square)
            # coincident centers have an energy, but no branch vector and so no stress
            inverse = 1.0 / r if r > 0.0 else 0.0
            rate = 0.0
            for a in range(len(axes)):
                rate += (velocity_nd[j, a] - velocity_nd[i, a]) * v[a] * inverse
            first = 0.0
            for one in literal_unroll(effects):
                energy += pair_energy(one, r, sigma)
                first += pair_first(one, r, sigma, rate)
            for a in range(3):
                for b in range(3):
                    virial[a, b] += first * inverse * v[a] * v[b]
    return Look(energy, virial)


INTEGRATORS: tuple[Any, ...] = (VelocityVerlet, SemiImplicitEuler)
