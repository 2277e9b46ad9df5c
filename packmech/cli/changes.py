"""Other values than a scene file's, given on the command line, for every verb that reads a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Parameter

from packmech.files.records import value_of_text


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """Other values than the scene's.

    Attributes
    ----------
    set
        NAME=VALUE, a field of the scene by its path, such as packing.particles=500, drive.strain=isotropic or
        effects.friction.coefficient=0.1 (an effect that the scene lacks is added); may be repeated
    particles
        number of particles
    dimension
        2 or 3
    packing_fraction
        of the random start
    law
        of the repulsion: harmonic, hertz, ...
    friction
        Coulomb's coefficient; adds friction to a scene without

    """

    set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    particles: int | None = None
    dimension: int | None = None
    packing_fraction: float | None = None
    law: str | None = None
    friction: float | None = None

    def by_path(self) -> dict[str, Any]:
        """Return the values by their paths, as `pm.read_scene` takes them."""
        named = {
            "packing.particles": self.particles,
            "packing.dimension": self.dimension,
            "packing.packing_fraction": self.packing_fraction,
            "effects.repulsion.law": self.law,
            "effects.friction.coefficient": self.friction,
        }
        found = {path: value for path, value in named.items() if value is not None}
        for text in self.set:
            path, given, value = text.partition("=")
            if not given or not path.strip():
                raise ValueError(f"set must be NAME=VALUE, such as packing.particles=500, got {text!r}")
            found[path.strip()] = value_of_text(value.strip())
        return found
