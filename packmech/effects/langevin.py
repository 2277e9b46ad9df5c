"""Thermal noise: drag against the local flow and the random kicks that belong to it."""

from __future__ import annotations

from typing import Any, NamedTuple

from packmech.check import brief
from packmech.effects.pair import effect


@effect
class Langevin(NamedTuple):
    """A bath of a temperature: drag as of `BackgroundDamping`, and random kicks that balance it.

    m dc/dt = F - rate m c + sqrt(2 rate m temperature) noise for the peculiar velocities c = v - L x, so that they have
    the temperature and not the flow; and so for spins, with their moments of inertia, against half the flow's
    vorticity. Alone, a particle diffuses with D = temperature / (mass rate). Without a temperature it is a drag.

    In time steps dt the bath acts between both kicks of velocity Verlet, as Groenbech-Jensen and Farago (Mol. Phys. 111
    (2013) 983) do: with a kicked velocity p the particle goes dt q and has the velocity 2 q - p behind,
    q = b (p + sqrt(2 rate temperature dt / m) xi / 2), b = 1 / (1 + rate dt / 2). Places of harmonic oscillators have
    the Boltzmann distribution, and free particles their D, at any stable dt; velocities of oscillators lack the part
    (omega dt / 2)^2 of their mean square. The numbers xi, of Philox4x32-10 (Salmon et al., 2011), depend on the seed,
    the step and the number of the particle alone, and not on threads, on interruptions or on the order of places.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    temperature
        In units of energy, Boltzmann's constant being one [energy].
    rate
        Of the drag [1/time].
    seed
        Of the random numbers, a whole number below 2^53; runs with different ones are independent.

    """

    temperature: float = 1e-6
    rate: float = 0.1
    seed: int = 0

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        whole = float(self.seed).is_integer() and 0 <= self.seed < 1 << 53
        return "" if whole else f"seed must be a whole number from 0 on, below 2^53, got {brief(self.seed)}"

    def bath_rate(self) -> float:
        """Return the rate of the drag [1/time]."""
        return self.rate


def langevin_of(effects: tuple[Any, ...]) -> Langevin | None:
    """Return the bath of a scene; None in one without.

    Raises
    ------
    ValueError
        If there are two.

    """
    found = [(k, one) for k, one in enumerate(effects) if isinstance(one, Langevin)]
    if len(found) > 1:
        raise ValueError(f"scene.effects must hold one Langevin, got them at {found[0][0]} and {found[1][0]}")
    return found[0][1] if found else None
