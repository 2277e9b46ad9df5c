"""Energy that comes from nowhere: how a time step too long for what it steps is told from motion that is right.

Above its limit of stability a step turns a few stiff motions into ever larger ones. Against the energy of a whole
packing that may be little for long, and friction or dashpots may keep it so: what is compared is what grew between two
looks with what was there to grow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from packmech.dynamics.strain import Strain
from packmech.effects import BackgroundDamping, Friction, law_scale
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
# steps between looks that are compared where the box is at rest
_APART = 256


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


def _there(potential: float, kinetic: float, part: float) -> float:
    """Return the most that may seem to be added to an energy that nothing is given to [energy]."""
    return min(_SWING * kinetic, part * (abs(potential) + kinetic))


@dataclass
class EnergyWatch:
    """What is remembered to tell energy from nowhere: a look some steps ago, and the work done since.

    Parameters
    ----------
    unit
        `energy_unit` of the scene.
    known
        `knows_its_energy` of the scene; unless it does, only numbers that are none are noticed.
    strained
        Whether the box deforms, and so works.
    rubbing
        Whether the scene has friction.
    every
        Steps between the looks that are compared, at least.

    """

    unit: float
    known: bool
    strained: bool
    rubbing: bool
    every: float
    energy: float = 0.0
    kinetic: float = 0.0
    tangential: float = 0.0
    steps: int = 0
    work: float = 0.0
    unseen: float = 0.0
    fallen: float = 0.0

    def told(self) -> dict[str, float]:
        """Return what is remembered, as a checkpoint keeps it."""
        names = ("energy", "kinetic", "tangential", "steps", "work", "unseen", "fallen")
        return {name: getattr(self, name) for name in names}

    def remember(self, now: Sight, steps: int) -> None:
        """Compare with this look from here on."""
        self.energy, self.kinetic, self.tangential, self.steps = now.energy, now.kinetic, now.tangential, steps
        self.work = self.unseen = 0.0

    def calm(self, now: Sight, last: Sight, start: Sight, steps: int) -> bool:
        """Whether energy has grown no more than by work, by what was in motion, by what fell from the potential.

        Parameters
        ----------
        now, last, start
            Figures now, at the look before and at the start.
        steps
            Steps taken until now.

        """
        if not np.isfinite(now.total):
            return False
        if not self.known:
            return True
        time = now.time - last.time
        self.work += 0.5 * (last.power + now.power) * time
        self.unseen += (0.5 * (abs(last.power) + abs(now.power)) + _UNSEEN * (last.pressing + now.pressing)) * time
        self.fallen = max(self.fallen, start.energy - now.energy)
        tiny = _ROUNDING * (self.unit + abs(self.energy) + abs(start.energy))
        grown = now.total - self.energy - self.kinetic - self.work
        risen = now.total - start.total
        if self.rubbing:
            # a spring at Coulomb's cap is set to what its dashpot leaves of the cap, whatever energy it then holds
            grown -= max(now.tangential - self.tangential, 0.0)
            risen -= max(now.tangential - start.tangential, 0.0)
        fallen = max(self.energy - now.energy, 0.0)
        good = grown <= _there(self.energy, self.kinetic, _PART) + fallen + self.unseen + tiny
        if not self.strained:
            good &= risen <= _there(start.energy, start.kinetic, 1.0) + self.fallen + tiny
        if steps - self.steps >= self.every:
            self.remember(now, steps)
        return bool(good)


def watch_of(scene: Scene, strain: Strain | None, dt: float) -> EnergyWatch:
    """Return a watch for a scene stepped by dt in a box that deforms so, or does not."""
    often = look_every(strain, dt, scene.packing.particles)
    strained = bool(np.isfinite(often))
    rubbing = any(isinstance(one, Friction) for one in scene.effects)
    apart = often if strained else _APART
    return EnergyWatch(energy_unit(scene), knows_its_energy(scene), strained, rubbing, apart)


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
