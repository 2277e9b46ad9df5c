"""`packmech effects`: which call honors which effect."""

from __future__ import annotations

import inspect

import packmech
from packmech.calls.honors import CALLS, COLUMNS, columns_of
from packmech.cli.output import show, table
from packmech.effects import registered_effects


def effects() -> None:
    """Say which call honors which effect of a scene: "yes", "zero at rest", or "refused" with an error."""
    for name in dir(packmech):
        getattr(packmech, name)
    rows = [(f"pm.{name}", *(CALLS[name].answer(column) for column in COLUMNS)) for name in sorted(CALLS)]
    show(table("what calls do with what a scene holds", ("call", *COLUMNS), rows, right=()))
    show(table("columns", ("column", "what it is"), COLUMNS.items(), right=()))
    known = sorted(registered_effects(), key=lambda kind: kind.__name__)
    about = [
        (kind.__name__, ", ".join(_columns(kind)), (inspect.getdoc(kind) or "").partition("\n")[0]) for kind in known
    ]
    show(table("effects", ("effect", "columns", "what it does"), about, right=()))


def _columns(kind: type) -> tuple[str, ...]:
    """Return the columns of an effect: those that its class names, else those of its default numbers."""
    if hasattr(kind, "acts_as"):
        return (str(kind.acts_as),)
    try:
        return columns_of(kind())
    # one of a user's own that has none
    except Exception:
        return columns_of(kind)
