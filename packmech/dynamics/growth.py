"""Energy that comes from nowhere: how a time step too long for what it steps is told from motion that is right.

Above its limit of stability a step turns a few stiff motions into ever larger ones. Against the energy of a whole
packing that may be little for long, and friction or dashpots may keep it so: what is compared is what grew between two
looks with what was there to grow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from packmech.dynamics.strain import Strain
from packmech.effects import BackgroundDamping, law_scale
from packmech.scene import Scene

if TYPE_CHECKING:
    from packmech.dynamics.motion import Sight

# a stable step shows up to 1 / (1 - (omega dt / 2)^2) times the energy of a motion: this much at 0.995 of the limit
_SWING = 100.0
# what rounding may add, over the unit of energy and the energy itself
_ROUNDING = 1e-12
# part of the energy that may be added between two looks
_PART = 0.25
# part of the pressure that may come and go as shear stress between two looks
_UNSEEN = 0.05
# looks at a box that deforms: after so much strain, or this part of a period, but no more often than every so many
# steps of one particle, as a look takes the time of some, and never more often than every so many steps
_STRAIN, _PERIOD, _SELDOM, _LEAST = 0.02, 1.0 / 16.0, 5000, 16


def energy_unit(scene: Scene) -> float:
    """Return the largest unit of energy that a law of the scene sets; 0 without laws [energy]."""
    length = scene.packing.reference_diameter
    named = [getattr(one, name) for one in scene.effects for name in ("law", "compression") if hasattr(one, name)]
    return max((law_scale(one, length) for one in named), default=0.0)


def knows_its_energy(scene: Scene) -> bool:
    """Whether every force on single particles of the scene has an energy or only takes some."""
    bodies = [type(one) for one in scene.effects if hasattr(type(one), "body_force")]
    return all(hasattr(one, "body_energy") or one is BackgroundDamping for one in bodies)


def look_every(strain: Strain | None, dt: float, particles: int) -> float:
    """Return after how many steps at most the work of a box's deformation is to be looked at; infinite at rest."""
    if strain is None:
        return np.inf
    seldom = max(_LEAST, _SELDOM // particles)
    frequency = getattr(strain, "frequency", None)
    if frequency is not None:
        fastest = 2.0 * np.pi * frequency * strain.amplitude  # type: ignore[union-attr]
        return max(seldom, int(min(_PERIOD / (frequency * dt), _STRAIN / (fastest * dt))))
    fastest = abs(strain.rate)  # type: ignore[union-attr]
    return max(seldom, int(_STRAIN / (fastest * dt))) if fastest * dt > 0.0 else np.inf


def _there(one: Sight, part: float) -> float:
    """Return the most that may seem to be added to an energy that nothing is given to [energy]."""
    return min(_SWING * one.kinetic, part * (abs(one.energy) + one.kinetic))


def calm(
    now: Sight,
    start: Sight,
    last: Sight,
    fallen: float,
    unit: float,
    *,
    strained: bool,
    known: bool,
    rubbing: bool = False,
) -> bool:
    """Whether energy has grown no more than it may: by work, by what was in motion, by what fell from the potential.

    Parameters
    ----------
    now, start, last
        Figures now, at the start and at the look before.
    fallen
        Largest potential energy at the start less that at a look before now [energy].
    unit
        `energy_unit` of the scene.
    strained
        Whether the box deforms, and so works.
    known
        `knows_its_energy` of the scene; unless it does, only numbers that are none are noticed.
    rubbing
        Whether the scene has friction.

    """
    if not np.isfinite(now.total):
        return False
    if not known:
        return True
    tiny = _ROUNDING * (unit + abs(last.energy) + abs(start.energy))
    time = now.time - last.time
    work = 0.5 * (last.power + now.power) * time
    unseen = (0.5 * (abs(last.power) + abs(now.power)) + _UNSEEN * (last.pressing + now.pressing)) * time
    grown = now.total - last.total - work
    if rubbing:
        # a spring at Coulomb's cap is set to what its dashpot leaves of the cap, whatever energy it then holds
        grown -= max(now.tangential - last.tangential, 0.0)
    if grown > _there(last, _PART) + max(last.energy - now.energy, 0.0) + unseen + tiny:
        return False
    fallen = max(fallen, start.energy - now.energy)
    return strained or bool(now.total - start.total <= _there(start, 1.0) + fallen + tiny)


def power_of(volume: float, stress_dd: Any, kinetic_dd: Any, rate_dd: Any) -> tuple[float, float]:
    """Return the power of a box's deformation, V stress : L, and V |pressure| |L|, which it is of the order of.

    Parameters
    ----------
    volume
        Of the box.
    stress_dd, kinetic_dd
        Stress of contacts and bonds, and -(1/V) sum m c c of the peculiar velocities themselves.
    rate_dd
        L.

    """
    whole = np.asarray(stress_dd) + kinetic_dd
    pressing = volume * abs(float(np.trace(whole))) / len(whole) * float(np.linalg.norm(rate_dd))
    return volume * float(np.sum(whole * rate_dd)), pressing
