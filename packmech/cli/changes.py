"""Other values than a scene file's, given on the command line, for every verb that reads a scene."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from packmech.check import brief
from packmech.cli import SEVERAL
from packmech.cli.output import WHOLE, show
from packmech.files.packings import is_packing_file, read_law, read_packing
from packmech.files.records import to_table, value_of_text
from packmech.scene import ROUGH_PRESSURE, Scene, registered_drives
from packmech.scenes.recipes import PACKINGS
from packmech.scenes.scene_file import changed_tables, read_scene_tables, scene_of_tables

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
        of the random start; the exact hard packing is looked for from a quench at 0.87 (of spheres 0.68), unless
        --set drive.method.start_packing_fraction=... says another
    law
        of the repulsion: harmonic, hertz, ...
    friction
        Coulomb's coefficient; adds friction to a scene without, which is then jammed at a pressure of 1e-3, from a
        random start of discs at a packing fraction of at most 0.7 (of spheres 0.5), unless others are given

    """

    set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    particles: Annotated[int | None, WHOLE] = None
    dimension: Annotated[int | None, WHOLE] = None
    packing_fraction: float | None = None
    law: str | None = None
    friction: float | None = None

    def scene(self, name: str, *, seed: int | None, jams: bool = False) -> Scene:
        """Return the scene of a file, or a shipped one, with these values; one that `jams` may be a packing's file."""
        packing = Path(name) if is_packing_file(name) else None
        if packing is not None and not jams:
            raise ValueError(
                f"scene must be a scene file (.toml), got the packing {name!r}: packmech jam {name} jams it, "
                f"packmech analyze {name} examines it as it stands, packmech new my.toml --packing {name} makes a scene"
            )
        tables, folder = self.tables(name if packing is None else "default", seed=seed, packing=packing)
        return scene_of_tables(tables, folder, name=name)

    def tables(
        self, name: str, *, seed: int | None, packing: Path | None = None, beside: Path = Path(".")
    ) -> tuple[dict[str, Any], Path]:
        """Return the tables of a scene file with these values, and the folder that its paths are relative to.

        With a packing's file they hold that packing, and the law that is stored with it; its path is relative to the
        folder that the scene's file will be `beside`.
        """
        tables, folder = read_scene_tables(name)
        if packing is not None:
            tables, folder = _of_file(tables, packing, beside), beside
        kind = tables.get("packing", {}).get("kind") if isinstance(tables.get("packing"), dict) else None
        for option in ("particles", "dimension", "packing_fraction"):
            if kind in ("inline", "file") and getattr(self, option) is not None:
                raise ValueError(
                    f"{option} must be left out for a scene that lists its particles or takes them from a file, got "
                    f"{getattr(self, option)!r}"
                )
        changes = self.by_path()
        for path, value in changes.items():
            _drop_others(tables, path, value)
        if self.friction is not None:
            effects, drive = tables.get("effects"), tables.get("drive")
            if isinstance(effects, list) and all(one.get("kind") != "friction" for one in effects):
                effects.append({"kind": "friction"})
                if isinstance(drive, dict) and drive.get("kind") == "jam":
                    drive["pressure"] = max(ROUGH_PRESSURE, drive.get("pressure", ROUGH_PRESSURE))
                    start = tables.get("packing", {})
                    if start.get("kind") == "random" and start.get("shapes") is None:
                        loose = _LOOSE.get(changes.get("packing.dimension", start.get("dimension", 2)), math.inf)
                        start["packing_fraction"] = min(loose, start.get("packing_fraction", loose))
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
                raise ValueError(f"set must be NAME=VALUE, such as packing.particles=500, got {brief(text)}")
            found[path.strip()] = read = value_of_text(value.strip())
            if isinstance(read, str) and all(isinstance(value_of_text(one), float | int) for one in read.split(",")):
                raise ValueError(f"set must give one value to a name, got {brief(text)}: {SEVERAL} --grid {text}")
        return found


def _of_file(tables: dict[str, Any], file: Path, beside: Path) -> dict[str, Any]:
    """Return the tables of a scene with the packing of a file in its place; kinds in the file stay as they are."""
    law = read_law(file)
    effects = [
        {**one, "law": to_table(law)} if law is not None and one.get("kind") == "repulsion" else one
        for one in tables.get("effects", [])
    ]
    packing = {"kind": "file", "path": os.path.relpath(file, beside)}
    made = tables | {"description": f"The packing in {file.name}", "packing": packing}
    if "effects" in made:
        made["effects"] = effects
    if "kinds" in made and read_packing(file).given_kind_n is not None:
        del made["kinds"]
    return made


def _drop_others(tables: dict[str, Any], path: str, kind: Any) -> None:
    """Leave out, and say so, what a table holds that another kind of packing or drive does not know."""
    name, _, last = path.partition(".")
    of_tables: dict[str, Mapping[str, Callable[..., Any]]] = {"packing": PACKINGS, "drive": registered_drives()}
    kinds = of_tables.get(name, {})
    table = tables.get(name)
    if last != "kind" or str(kind) not in kinds or not isinstance(table, dict) or table.get("kind") == kind:
        return
    known = inspect.signature(kinds[kind]).parameters
    dropped = [field for field in table if field != "kind" and field not in known]
    for field in dropped:
        del table[field]
    if dropped:
        of = f"of kind {table.get('kind')!r}"
        show(f"packmech: {path} = {kind} leaves out what the {name} {of} had: {', '.join(dropped)}", error=True)


UNCHANGED = Changes()
