"""`packmech scenes`: list the scenes that ship inside the package."""

from __future__ import annotations

from packmech.cli.output import show, table
from packmech.scenes.scene_file import list_scenes


def scenes() -> None:
    """List the scenes that ship inside the package."""
    show(table("scenes that ship", ("name", "what it is"), list_scenes().items(), right=()))
