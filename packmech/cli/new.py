"""`packmech new`: write a scene file with comments, to change by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from packmech.cli.changes import UNCHANGED, Changes
from packmech.cli.output import Load, Seed, show
from packmech.files.modules import load_modules
from packmech.files.paths import replacing, writable_file
from packmech.scenes.reference import commented_scene
from packmech.scenes.scene_file import scene_of_tables


def new(
    file: Annotated[Path, Parameter(help="the scene file to write, such as my.toml")],
    /,
    *,
    like: Annotated[str, Parameter(help="the scene to begin with: a file or one that ships")] = "default",
    packing: Path | None = None,
    changes: Changes = UNCHANGED,
    seed: Seed = None,
    description: str | None = None,
    overwrite: Annotated[bool, Parameter(show_default=False)] = False,
    load: Load = (),
) -> None:
    """Write a scene file in which comments say what each field means.

    Parameters
    ----------
    packing
        the file of a packing to take in place of the scene's own
    description
        one sentence on the scene
    overwrite
        replace a file that exists

    """
    load_modules(load)
    if file.suffix != ".toml":
        raise ValueError(f"file must end in .toml, got {str(file)!r}")
    if file.exists() and not overwrite:
        raise ValueError(f"file must not exist (or give --overwrite), got {str(file)!r}")
    tables, folder = changes.tables(like, seed=seed, packing=packing, beside=file.parent)
    if description is not None:
        tables["description"] = description
    elif changes != UNCHANGED or seed is not None:
        tables.pop("description", None)
    scene_of_tables(tables, folder, name=str(file))
    with replacing(writable_file("file", file)) as partial:
        partial.write_text(commented_scene(tables), encoding="utf-8")
    verb = "jam" if tables.get("drive", {}).get("kind", "jam") == "jam" else "run"
    loaded = "".join(f" --load {one}" for one in load)
    show(f"wrote {file}   (next: packmech {verb} {file}{loaded})")
