"""Studies that grow row by row: each row is written once it is there, and found there again."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Protocol, TypeVar

from packmech.files.packings import replacing
from packmech.result import csv_text


class Settled(Protocol):
    """A frozen dataclass of whole and other numbers, whose first fields are what it was asked for."""

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        ...


T = TypeVar("T", bound=Settled)


def read_rows(path: Path, kind: type[T]) -> list[T]:
    """Return the rows of a table; none where there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        types: list[type] = [int if one.type == "int" else float for one in fields(kind)]  # type: ignore[arg-type]
        rows = list(csv.reader(file))[1:]
        return [kind(*(one(value) for one, value in zip(types, row, strict=True))) for row in rows]


def complete_rows(
    path: Path,
    kind: type[T],
    wanted: Sequence[tuple[float, ...]],
    make: Callable[..., T],
    progress: Callable[[int, int, T | None], None],
) -> list[T]:
    """Return the rows of all settings that are wanted, in order, those that are missing made and written.

    Parameters
    ----------
    path
        The table.
    kind
        The class of its rows.
    wanted
        Settings of each row.
    make
        Makes a row of its settings.
    progress
        Called before each with the number that is there, how many there will be, and the last that was made.

    """
    known = {one.settings: one for one in read_rows(path, kind)}
    names = [one.name for one in fields(kind)]  # type: ignore[arg-type]
    last: T | None = None
    for count, settings in enumerate(wanted):
        progress(count, len(wanted), last)
        if settings in known:
            continue
        known[settings] = last = make(*settings)
        # what another command wrote meanwhile stays, and no row is ever half there
        there: list[Any] = list(({one.settings: one for one in read_rows(path, kind)} | {settings: last}).values())
        with replacing(path) as partial:
            partial.write_text(csv_text(names, [asdict(one).values() for one in there]), encoding="utf-8")
    return [known[settings] for settings in wanted]
