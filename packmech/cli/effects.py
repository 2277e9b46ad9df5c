"""`packmech effects`: which call honors which effect."""

from __future__ import annotations

import packmech
from packmech.calls.honors import CALLS, COLUMNS
from packmech.cli.output import show, table


def effects() -> None:
    """Say which call honors which effect of a scene: "yes", "zero at rest", or "refused" with an error."""
    for name in dir(packmech):
        getattr(packmech, name)
    rows = [(f"pm.{name}", *(CALLS[name].answer(column) for column in COLUMNS)) for name in sorted(CALLS)]
    show(table("what calls do with what a scene holds", ("call", *COLUMNS), rows, right=()))
    show(table("columns", ("column", "what it is"), COLUMNS.items(), right=()))
