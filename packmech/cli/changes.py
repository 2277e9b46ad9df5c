"""Other values than a scene file's, given on the command line, for every verb that reads a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from packmech.files.records import value_of_text
from packmech.scene import Scene
from packmech.scenes.scene_file import changed_tables, read_scene_tables, scene_of_tables

# pressure at which a scene is jammed that gets friction here [energy_scale / diameter^d]
_PRESSED = 1e-3
# packing fraction from which it is pressed then, by dimension: what begins denser than friction lets it jam stays so
_LOOSE = {2: 0.7, 3: 0.5}


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """Other values than the scene's.

    Attributes
    ----------
    set
        NAME=VALUE, a field of the scene by its path, such as packing.particles=500, drive.strain=isotropic or
        effects.friction.coefficient=0.1; may be repeated
    particles
        number of particles
    dimension
        2 or 3
    packing_fraction
        of the random start
    law
        of the repulsion: harmonic, hertz, ...
    friction
        Coulomb's coefficient; adds friction to a scene without, which is then jammed at a pressure of 1e-3, from a
        random start at a packing fraction of at most 0.7 (0.5 in space), unless others are given

    """

    set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    particles: int | None = None
    dimension: int | None = None
    packing_fraction: float | None = None
    law: str | None = None
    friction: float | None = None

    def scene(self, name: str, *, seed: int | None) -> Scene:
        """Return the scene of a file, or a shipped one, with these values."""
        tables, folder = self.tables(name, seed=seed)
        return scene_of_tables(tables, folder, name=name)

    def tables(self, name: str, *, seed: int | None) -> tuple[dict[str, Any], Path]:
        """Return the tables of a scene file with these values, and the folder that its paths are relative to."""
        tables, folder = read_scene_tables(name)
        changes = self.by_path()
        if self.friction is not None:
            effects, drive = tables.get("effects"), tables.get("drive")
            if isinstance(effects, list) and all(one.get("kind") != "friction" for one in effects):
                effects.append({"kind": "friction"})
                # what is pressed in time takes ever longer to come to rest at ever lower pressures
                if isinstance(drive, dict) and drive.get("kind") == "jam":
                    drive["pressure"] = max(_PRESSED, drive.get("pressure", _PRESSED))
                    packing = tables.get("packing", {})
                    if packing.get("kind") == "random" and packing.get("shapes") is None:
                        loose = _LOOSE.get(self.dimension or packing.get("dimension", 2), math.inf)
                        packing["packing_fraction"] = min(loose, packing.get("packing_fraction", loose))
            changes["effects.friction.coefficient"] = self.friction
        return changed_tables(tables, seed=seed, changes=changes), folder

    def by_path(self) -> dict[str, Any]:
        """Return the values by their paths, as `pm.read_scene` takes them."""
        named = {
            "packing.particles": self.particles,
            "packing.dimension": self.dimension,
            "packing.packing_fraction": self.packing_fraction,
            "effects.repulsion.law": self.law,
        }
        found = {path: value for path, value in named.items() if value is not None}
        for text in self.set:
            path, given, value = text.partition("=")
            if not given or not path.strip():
                raise ValueError(f"set must be NAME=VALUE, such as packing.particles=500, got {text!r}")
            found[path.strip()] = value_of_text(value.strip())
        return found


UNCHANGED = Changes()
