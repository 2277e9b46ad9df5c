"""Particles that are held where they are, or moved: the grains of a rough wall, a hopper, a floor that is lowered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import brief, finite_array, listed
from packmech.effects.pair import bound_effect


@shown()
@bound_effect
@dataclass(frozen=True)
class FixedParticles:
    """Particles that stay where they are, whatever pushes them: rough walls and hoppers are made of them.

    Ellipses, spheroids and rigid bodies keep their directions, too. Nothing else distinguishes them: others touch them
    as they touch each other. Two that are held do not touch, however they overlap: no contact, energy or stress is
    counted between them. Bonds between them still are, and calls of a packing alone do not know who is held. What holds
    them takes up their net force, so that `forces` is zero for them. With a velocity they are moved all the same way,
    whatever pushes them: then nothing is at rest, and calls of what is at rest refuse them.

    Parameters
    ----------
    particles
        Their numbers, each once.
    velocity
        At which they move, a number for each axis, relative to the flow of a box that deforms [length/time]; none: they
        stay.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    >>> scene = pm.Scene(packing, (pm.Repulsion(), pm.FixedParticles((0,))))
    >>> pm.forces(scene).round(12).tolist()
    [[0.0, 0.0], [0.1, 0.0]]

    """

    particles: tuple[int, ...]
    velocity: tuple[float, ...] = ()

    acts_as: ClassVar[str] = "held"

    def __post_init__(self) -> None:
        given = self.particles
        numbers = listed("particles", given, "numbers of particles")
        for k, one in enumerate(numbers):
            if isinstance(one, bool | np.bool_) or not isinstance(one, int | np.integer):
                raise TypeError(f"particles must be whole numbers, got {brief(one)} at {k}")
            if one < 0:
                raise ValueError(f"particles must not be negative, got {one} at {k}")
        if len(set(numbers)) < len(numbers):
            twice = next(one for k, one in enumerate(numbers) if one in numbers[:k])
            raise ValueError(f"particles must name each particle once, got {twice} twice")
        object.__setattr__(self, "particles", tuple(sorted(int(one) for one in numbers)))
        moved = finite_array("velocity", self.velocity, shape=(None,), what="axis", empty=True)
        object.__setattr__(self, "velocity", tuple(moved.tolist()))

    @property
    def moves(self) -> bool:
        """Whether they move."""
        return any(self.velocity)

    def marked(self, count: int) -> NDArray[np.bool_]:
        """Return which of so many particles are held.

        Raises
        ------
        ValueError
            If there are not so many.

        """
        if self.particles and self.particles[-1] >= count:
            raise ValueError(f"particles must be below {count}, got {self.particles[-1]}")
        held = np.zeros(count, dtype=bool)
        held[list(self.particles)] = True
        return held


def held_particles(effects: tuple[Any, ...], particles: int) -> NDArray[np.bool_] | None:
    """Return the (N,) mask of held particles; None where none is held.

    Raises
    ------
    ValueError
        If one is held that is not there.

    """
    held = None
    for k, one in enumerate(effects):
        if isinstance(one, FixedParticles):
            if one.particles and one.particles[-1] >= particles:
                raise ValueError(
                    f"scene.effects[{k}].particles must be below {particles}, the number of particles, got "
                    f"{one.particles[-1]}"
                )
            held = one.marked(particles) if held is None else held | one.marked(particles)
    return held
