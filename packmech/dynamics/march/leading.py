"""Tangential springs without dashpots: what keeps their oscillations from growing.

A stretch is the trapezoidal sum of slips, which are taken with velocities extrapolated to the end of each step,
v(half) + dt a / 2 with the a of its start. That lags: an undamped oscillation of frequency omega would grow by
(omega dt)^4 / 8 of itself in every step. With the share 1/3 of the last change of a added to it, (omega dt)^6 is left.
"""

from __future__ import annotations

from packmech.effects import Bonds, Friction
from packmech.scene import Scene

# a little more than 1/3: oscillations up to omega dt = 1/3 then fall, by less than (omega dt)^4 / 100 a step
_SHARE = 0.35
# (omega dt)^2 of the fastest tangential springs, over stiffness dt^2 / mass: with 6 neighbors, or 12 in space
_FASTEST = {2: 36.0, 3: 84.0}


def leading_share(scene: Scene, dt: float, least_mass: float) -> float:
    """Return the share of the forces' last change that belongs in extrapolated velocities [1].

    None, unless some tangential spring k has a dashpot c so weak that what it takes, (c / 2k) omega^2 dt of an
    oscillation in every step, is less than the growth.

    Parameters
    ----------
    scene
        The scene.
    dt, least_mass
        Time step, and the least of the masses.

    """
    springs = []
    for one in scene.effects:
        if isinstance(one, Friction) and one.coefficient > 0.0:
            springs.append((one.stiffness, one.damping))
        if isinstance(one, Bonds) and len(one):
            springs.append((one.tangential_stiffness, one.tangential_damping))
    weak = 0.25 * _FASTEST[scene.packing.dimension] * dt**3 / least_mass
    return _SHARE if any(k > 0.0 and c < weak * k * k for k, c in springs) else 0.0
