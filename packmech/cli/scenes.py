"""`packmech scenes`: list, show or copy the scenes that ship inside the package."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from packmech.cli.output import show as say
from packmech.cli.output import table
from packmech.files.paths import replacing, writable_file
from packmech.scenes.scene_file import list_scenes, shipped_scene_text


def scenes(
    *,
    show: str | None = None,
    copy: str | None = None,
    to: Path | None = None,
    overwrite: Annotated[bool, Parameter(show_default=False)] = False,
) -> None:
    """List the scenes that ship inside the package; or show or copy one.

    Parameters
    ----------
    show
        print the file of the scene of this name
    copy
        copy the file of the scene of this name
    to
        the copy (default: the scene's name with .toml, in this folder)
    overwrite
        replace a file that exists

    """
    if show is not None:
        sys.stdout.write(shipped_scene_text(show))
    if copy is not None:
        text = shipped_scene_text(copy)
        target = writable_file("to", Path(f"{copy}.toml") if to is None else to)
        if target.exists() and not overwrite:
            raise ValueError(f"to must name a file that does not exist (or give --overwrite), got {str(target)!r}")
        with replacing(target) as partial:
            partial.write_text(text, encoding="utf-8")
        say(f"wrote {target}   (next: packmech run {target})")
    elif to is not None:
        raise ValueError("to must be left out without --copy NAME")
    if show is None and copy is None:
        say(table("scenes that ship", ("name", "what it is"), list_scenes().items(), right=()))
        say("see one: packmech scenes --show NAME; take it: packmech scenes --copy NAME; run it: packmech run NAME")
