"""What is done with a scene that is followed through time. Data only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from packmech.check import integer, positive, real
from packmech.records import is_record


@dataclass(frozen=True)
class SimulateDrive:
    """Follow Newton's equations in the box as it is; `packmech run` prints stress, energy and momentum at the end.

    Parameters
    ----------
    steps, duration, dt, method
        What pm.simulate takes; exactly one of steps and duration.
    velocities, spins
        One row a particle: velocities, and one number (three in space) of spin; at rest unless given.
    masses, density
        One a particle, or else mass over area (over volume in space) of every one [mass/length^d]; those of pm.simulate
        unless given.
    held
        Numbers of the particles that nothing pushes or turns.

    """

    steps: int | None = None
    duration: float | None = None
    dt: float | None = None
    method: Any = None
    velocities: tuple[tuple[float, ...], ...] | None = None
    spins: tuple[tuple[float, ...], ...] | None = None
    masses: tuple[float, ...] | None = None
    density: float | None = None
    held: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.steps is not None:
            integer("drive.steps", self.steps, at_least=1)
        for name in ("duration", "dt", "density"):
            if getattr(self, name) is not None:
                positive(f"drive.{name}", getattr(self, name))
        if (self.steps is None) == (self.duration is None):
            got = "neither" if self.steps is None else "both"
            raise ValueError(f"drive.steps must be given, or else duration, got {got}")
        if self.masses is not None and self.density is not None:
            raise ValueError(f"drive.density must be left out where masses are given, got {self.density:g}")
        for name in ("velocities", "spins"):
            rows = _entries(f"drive.{name}", getattr(self, name))
            for k, row in enumerate(rows):
                for value in _entries(f"drive.{name}[{k}]", row):
                    real(f"drive.{name}[{k}]", value)
        for k, mass in enumerate(_entries("drive.masses", self.masses)):
            positive(f"drive.masses[{k}]", mass)
        if self.held is None:
            raise TypeError("drive.held must be a tuple of particle numbers, got None")
        for k, particle in enumerate(_entries("drive.held", self.held)):
            integer(f"drive.held[{k}]", particle, at_least=0)
        if self.method is not None and not is_record(self.method):
            raise TypeError(f"drive.method must be a record of settings or None, got {self.method!r}")


def _entries(name: str, value: Any) -> tuple[Any, ...]:
    if value is None:
        return ()
    if not isinstance(value, tuple):
        raise TypeError(f"{name} must be a tuple, got {value!r}")
    return value
