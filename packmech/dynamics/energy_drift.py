"""Energy drift check: how a time step that is too long is found by energy that no work explains.

Above its limit of stability a step turns a few stiff motions into ever larger ones. Against the energy of a whole
packing that may be little for long, and friction or dashpots may keep it so: what is compared is what grew between two
observations with what was there to grow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics import observables as columns
from packmech.dynamics.deformation import Strain
from packmech.dynamics.friction import frictions_at_contacts
from packmech.effects import (
    BackgroundDamping,
    Friction,
    Walls,
    held_velocity,
    langevin_of,
    law_scale,
    resistances,
    rough_walls,
    roughness_of,
    springs_of,
)
from packmech.effects.kinds import largest_number
from packmech.scene import Scene

# a stable step shows up to 1 / (1 - (omega dt / 2)^2) times the energy of a motion: this much at 0.995 of the limit
_SWING = 100.0
# what rounding may add, over the unit of energy and the energy itself
_ROUNDING = 1e-12
# part of the energy that may be added between two observations
_PART = 0.25
# part of the pressure that may come and go as shear stress between two observations
_UNSEEN = 0.05
# observations of a box that deforms: after so much strain, or this part of a period, but no more often than every so
# many steps of one particle, as one takes the time of some, and never more often than every so many steps
_STRAIN, _PERIOD, _SELDOM, _MINIMUM_STEPS = 0.02, 1.0 / 16.0, 5000, 16
# steps between observations that are compared where the box is at rest
_APART = 256
# mean square of the normal forces of a scene over the square of their mean, at most
_BROAD = 9.0


class Moment(NamedTuple):
    """Energies of one row of observables: potential, the part of it in sliding springs, kinetic, and `power_of`.

    In sliding springs there is at most what Coulomb's limit lets them hold (`largest_held`). What broken bonds
    `released` until then is part of the potential.
    """

    time: float
    energy: float
    tangential: float
    kinetic: float
    power: float
    pressing: float
    released: float = 0.0


def energy_unit(scene: Scene) -> float:
    """Return the largest unit of energy that a law of the scene sets; 0 without laws [energy]."""
    length = scene.packing.reference_diameter
    named = [getattr(one, name) for one in scene.effects for name in ("law", "compression") if hasattr(one, name)]
    return max((law_scale(one, length) for one in named), default=0.0)


def knows_its_energy(scene: Scene, *, strained: bool = False) -> bool:
    """Whether every force on single particles of the scene has an energy or only takes some; a heat bath gives some.

    In a box that deforms what carries them against such a force is not in the stress: there all may only take.
    """
    bodies = [type(one) for one in scene.effects if hasattr(type(one), "body_force")]
    return langevin_of(scene.effects) is None and all(
        one is BackgroundDamping or (hasattr(one, "body_energy") and not strained) for one in bodies
    )


def largest_held(scene: Scene) -> float:
    """Return what tangential springs can hold at Coulomb's limit, over contacts and the square of their mean force.

    mu^2 / (2 k) times 9, as normal forces are not all the same [length/force]; 0 without friction. So those against
    rolling and twisting.
    """
    held, lightest = 0.0, float(scene.packing.mass_n.min())
    for one in resistances(roughness_of(scene.effects)):
        there = frictions_at_contacts(scene, one, lightest) if isinstance(one, Friction) else [one]
        softest = min(each.stiffness for each in there)
        held += _BROAD * largest_number(one.coefficient) ** 2 / (2.0 * softest) if softest > 0.0 else 0.0
    return held


def is_frictional(scene: Scene) -> bool:
    """Whether contacts of a scene, or its walls, have springs that give way."""
    rough = (roughness_of(scene.effects), *(one.roughness for one in rough_walls(scene.effects)))
    return any(largest_number(one.coefficient) > 0.0 for each in rough for one in resistances(springs_of(each)))


def pace_of_held(scene: Scene) -> float:
    """Return the largest speed of particles that are held and moved, over the reference diameter [1/time]."""
    packing = scene.packing
    velocity = held_velocity(scene.effects, packing.particles, packing.dimension)
    return float(np.abs(velocity).max()) / packing.reference_diameter


def steps_between_observations(strain: Strain | None, dt: float, particles: int, pace: float = 0.0) -> float:
    """Return after how many steps at most the work of the box and of what moves held particles is to be observed.

    Infinite where neither moves; `pace` is that of the held particles.
    """
    seldom = max(_MINIMUM_STEPS, _SELDOM // particles)
    if strain is None and pace * dt > 0.0:
        return max(seldom, int(_STRAIN / (pace * dt)))
    if strain is None:
        return np.inf
    frequency = getattr(strain, "frequency", None)
    if frequency is not None:
        fastest = 2.0 * np.pi * frequency * strain.amplitude  # type: ignore[union-attr]
        return max(seldom, int(min(_PERIOD / (frequency * dt), _STRAIN / (fastest * dt))))
    fastest = abs(strain.rate)  # type: ignore[union-attr]
    return max(seldom, int(_STRAIN / (fastest * dt))) if fastest * dt > 0.0 else np.inf


def _there(potential: float, kinetic: float, part: float) -> float:
    """Return the maximum that may seem to be added to an energy that nothing is given to [energy]."""
    return min(_SWING * kinetic, part * (abs(potential) + kinetic))


@dataclass
class EnergyWatch:
    """What is remembered to find energy that no work explains: an observation some steps ago, and the work done since.

    Parameters
    ----------
    unit
        `energy_unit` of the scene.
    known
        `knows_its_energy` of the scene; unless it does, only numbers that are none are noticed.
    works
        Whether the box deforms, or held particles or walls are moved, and so work is done.
    frictional
        Whether the scene has friction.
    every
        Steps between the observations that are compared, at least.

    """

    unit: float
    known: bool
    works: bool
    frictional: bool
    every: float
    energy: float = 0.0
    kinetic: float = 0.0
    tangential: float = 0.0
    steps: int = 0
    work: float = 0.0
    unseen: float = 0.0
    fallen: float = 0.0

    def to_table(self) -> dict[str, float]:
        """Return what is remembered, as a checkpoint keeps it."""
        names = ("energy", "kinetic", "tangential", "steps", "work", "unseen", "fallen")
        return {name: getattr(self, name) for name in names}

    def remember(self, now: Moment, steps: int) -> None:
        """Compare with this observation from here on."""
        self.energy, self.kinetic, self.tangential, self.steps = now.energy, now.kinetic, now.tangential, steps
        self.work = self.unseen = 0.0

    def is_calm(self, now: Moment, last: Moment, start: Moment, steps: int) -> bool:
        """Whether energy has grown no more than by work, by what was in motion, by what fell from the potential.

        Parameters
        ----------
        now, last, start
            Figures now, at the observation before and at the start.
        steps
            Steps taken until now.

        """
        if not np.isfinite(now.energy + now.kinetic):
            return False
        if not self.known:
            return True
        time = now.time - last.time
        self.work += 0.5 * (last.power + now.power) * time
        self.unseen += (0.5 * (abs(last.power) + abs(now.power)) + _UNSEEN * (last.pressing + now.pressing)) * time
        # a bond that broke since was given its energy until then, and neither of both powers holds that
        self.unseen += abs(now.released - last.released)
        self.fallen = max(self.fallen, start.energy - now.energy)
        tiny = _ROUNDING * (self.unit + abs(self.energy) + abs(start.energy))
        grown = now.energy + now.kinetic - self.energy - self.kinetic - self.work
        risen = now.energy + now.kinetic - start.energy - start.kinetic
        if self.frictional:
            # a spring at Coulomb's cap is set to what its dashpot leaves of the cap, whatever energy it then holds
            grown -= max(now.tangential - self.tangential, 0.0)
            risen -= max(now.tangential - start.tangential, 0.0)
        fallen = max(self.energy - now.energy, 0.0)
        good = grown <= _there(self.energy, self.kinetic, _PART) + fallen + self.unseen + tiny
        if not self.works:
            good &= risen <= _there(start.energy, start.kinetic, 1.0) + self.fallen + tiny
        if steps - self.steps >= self.every:
            self.remember(now, steps)
        return bool(good)


def watch_of(scene: Scene, strain: Strain | None, dt: float) -> EnergyWatch:
    """Return a watch for a scene stepped by dt in a box that deforms so, or does not."""
    often = steps_between_observations(strain, dt, scene.packing.particles, pace_of_held(scene))
    timed = bool(np.isfinite(often))
    # walls that move keep count of the work done on them: it is part of the energy
    works = timed or any(isinstance(one, Walls) and one.moves for one in scene.effects)
    frictional = is_frictional(scene)
    apart = often if timed else _APART
    known = knows_its_energy(scene, strained=timed and strain is not None)
    return EnergyWatch(energy_unit(scene), known, works, frictional, apart)


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


def moments_of(
    row_tk: NDArray[np.float64],
    direction_dd: NDArray[np.float64],
    held: float,
    released: Callable[[float], float],
) -> list[Moment]:
    """Return the energies of rows of observables.

    Parameters
    ----------
    row_tk
        Rows of observables.
    direction_dd
        The box is at 1 + gamma direction_dd.
    held
        `largest_held` of the scene.
    released
        What breaking bonds took out of the energy until a time, which counts as potential energy.

    """
    d = len(direction_dd)
    found = []
    for row in row_tk:
        rate = row[columns.RATE] * direction_dd @ np.linalg.inv(np.eye(d) + row[columns.STRAIN] * direction_dd)
        contact, motion = (row[k : k + 9].reshape(3, 3)[:d, :d] for k in (columns.FORCE, columns.MOTION))
        tangential, at_walls = float(row[columns.TANGENTIAL]), float(row[columns.AT_WALLS])
        contacts = float(row[columns.CONTACTS])
        # what an unstable spring seems to hold beyond its cap is energy from nowhere
        sliding = 0.0
        if contacts > 0.0:
            sliding = min(tangential - at_walls, held * float(row[columns.TOTAL]) ** 2 / contacts)
        sliding += min(at_walls, float(row[columns.HELD_AT_WALLS]))
        gone = released(float(row[columns.TIME]))
        energy = row[columns.POTENTIAL] + tangential + gone + row[columns.BEHIND_FACES]
        kinetic = row[columns.KINETIC] + row[columns.ROTATIONAL] + row[columns.OF_FACES]
        power, pressing = power_of(1.0, contact, -motion, rate)
        power += float(row[columns.MOVING])
        found.append(Moment(float(row[columns.TIME]), float(energy), sliding, float(kinetic), power, pressing, gone))
    return found


class RowWatch:
    """Rows of observables, watched as they come.

    Parameters
    ----------
    scene
        The scene.
    direction_dd
        (d, d) direction of its strain.
    every
        Steps from row to row.
    released
        Energy that breaking bonds released until a time.

    """

    def __init__(
        self,
        scene: Scene,
        direction_dd: NDArray[np.float64],
        every: int,
        released: Callable[[float], float],
    ) -> None:
        self.released = released
        frictional = is_frictional(scene)
        known = knows_its_energy(scene, strained=True)
        self.watch = EnergyWatch(energy_unit(scene), known, True, frictional, _APART)
        self.direction_dd, self.every, self.held = direction_dd, every, largest_held(scene)
        self.start: Moment | None = None
        self.last: Moment | None = None
        self.checked = 0

    def is_calm(self, row_tk: NDArray[np.float64]) -> bool:
        """Whether no row that came since the last call, of all so far, holds more energy than work explains."""
        good = True
        for now in moments_of(row_tk[self.checked :], self.direction_dd, self.held, self.released):
            if self.start is None or self.last is None:
                self.start = now
                self.watch.remember(now, 0)
            else:
                good &= self.watch.is_calm(now, self.last, self.start, self.checked * self.every)
            self.last, self.checked = now, self.checked + 1
        return good
