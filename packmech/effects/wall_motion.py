"""How walls move: each component of a face's motion has a velocity, or a stress that the face holds as it gives way."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from packmech.check import brief


class HeldStress(NamedTuple):
    """A stress that a face of `Walls` holds along one axis: the face is a piston, which gives way until it is reached.

    With the area A of the face in the cell (a length in a plane) and the force F of the particles on it, inertia A
    dv/dt = F + H - damping A v. The force H of the stress is stress A along the axis at the high face, and minus that
    at the low one, as a body between them bears it: tension is positive, so that across the face stress = -pressure,
    and along it a positive one drags the high face along the axis and the low face against it. At rest the particles
    bear just this stress. Gravity does not act on faces. A light face, or one with a strong dashpot, asks for short
    time steps: they are chosen for as many contacts as fit on the face.
    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    stress
        What is held [energy/length^d].
    inertia
        Mass of the face over its area [mass/length^(d-1)].
    damping
        Dashpot of the face over its area [mass/(time length^(d-1))].
    velocity
        At the start [length/time].

    """

    stress: float = 0.0
    inertia: float = 1.0
    damping: float = 0.0
    velocity: float = 0.0

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        return "" if self.inertia > 0.0 else f"inertia must be positive, got {brief(self.inertia)}"


class WallMotion(NamedTuple):
    """How one face of `Walls` moves along x, y and z: a velocity [length/time], or a `HeldStress`.

    Across the face it moves to another place; along it, it drags what touches it by friction, and stands where it does.
    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    x, y, z
        A velocity, or `HeldStress(...)`; z is zero in a plane.

    """

    x: float | HeldStress = 0.0
    y: float | HeldStress = 0.0
    z: float | HeldStress = 0.0

    def fault(self) -> str:
        """Return what is wrong with the components; nothing is, where it is empty."""
        for name, value in zip(self._fields, self, strict=True):
            number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
            if not (number or isinstance(value, HeldStress)):
                return f"{name} must be a velocity or HeldStress(...), got {brief(value)}"
        return ""


def moved_along(motion: Any) -> tuple[float | HeldStress, ...]:
    """Return how a face moves along each axis; it stands still where it has no motion."""
    return (0.0, 0.0, 0.0) if motion is None else tuple(motion)
