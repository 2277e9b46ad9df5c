"""Studies of many rows: each row, or some that belong together, comes of a member of an ensemble."""

from __future__ import annotations

import csv
import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.ensemble.callers import Finished, complete
from packmech.ensemble.folder import WORKSPACE
from packmech.ensemble.members import member_of
from packmech.files.packings import replacing
from packmech.result import csv_text

# beside a study's tables: ensembles, by the names of the tables
MEMBERS = "members"


class Settled(Protocol):
    """A frozen dataclass of whole and other numbers, whose first fields are what it was asked for."""

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        ...


T = TypeVar("T", bound=Settled)
# called with the number of members that are finished, how many there will be, and a row of the last one
Progress = Callable[[int, int, T | None], None]


def read_rows(path: Path, kind: type[T]) -> list[T]:
    """Return the rows of a table; none where there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
        return [kind(*(one(value) for one, value in zip(_types(kind).values(), row, strict=True))) for row in rows]


def _types(kind: type[T]) -> dict[str, type]:
    """Return the types of the fields of rows, by name."""
    return {one.name: int if one.type == "int" else float for one in fields(kind)}  # type: ignore[arg-type]


def columns_of(rows: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Return rows that belong together as what a member returns; there must be one."""
    return {one.name: np.array([getattr(row, one.name) for row in rows]) for one in fields(rows[0])}


def _rows_of(kind: type[T], member: Finished) -> list[T]:
    """Return the rows of a member: one of its numbers, or several of its columns."""
    types = _types(kind)
    if set(types) <= set(member.values):
        return [kind(**{name: one(member.values[name]) for name, one in types.items()})]
    columns = member.arrays()
    rows = zip(*(columns[name].tolist() for name in types), strict=True)
    return [kind(*(one(value) for one, value in zip(types.values(), row, strict=True))) for row in rows]


def members_of(path: Path) -> Path:
    """Return where the members of a table are."""
    return path.parent / MEMBERS / path.stem


def kept_of(path: Path, row: Settled) -> Finished:
    """Return the member that a row of a table came of, where the row's settings are all of its parameters."""
    values = asdict(row)  # type: ignore[call-overload]
    one = member_of(dict(zip(values, row.settings, strict=False)))
    return Finished(members_of(path) / WORKSPACE / one.id, values)


def complete_rows(
    path: Path,
    kind: type[T],
    wanted: Iterable[Sequence[Any]],
    make: Callable[..., Any],
    progress: Progress[T],
    workers: int | None = None,
) -> list[T]:
    """Return the rows of all that is wanted, in order, after running what is missing; write them to the table.

    Parameters
    ----------
    path
        The table, written when all is finished or the call ends otherwise. Rows that it has already, of other settings,
        stay in it; those without members beside it are run again.
    kind
        The class of its rows.
    wanted
        The arguments of `make` for each member; those named like fields of rows are numbers of their types.
    make
        Returns a row of its arguments; or the fields of a row, with arrays and packings that are kept in the member's
        folder, by name; or `columns_of` rows. A function at the top of a module unless `workers` is 0.
    progress
        Called before the first and after each.
    workers
        As in `pm.run_ensemble`.

    """
    types = _types(kind)
    names = [name for name in inspect.signature(make).parameters if name not in ("folder", "random_seed")]
    grid = [
        {name: types[name](value) if name in types else value for name, value in zip(names, values, strict=True)}
        for values in wanted
    ]
    progress(0, len(grid), None)
    finished: dict[int, list[T]] = {}

    def report(done: int, of: int, number: int, member: Finished) -> None:
        finished[number] = _rows_of(kind, member)
        progress(done, of, finished[number][-1])

    try:
        complete(make, grid, members_of(path), workers=workers, progress=report)
    finally:
        # those that are finished, too, where others failed or the study is stopped
        found = [row for _, rows in sorted(finished.items()) for row in rows]
        table: dict[Any, T] = {one.settings: one for one in [*read_rows(path, kind), *found]}
        with replacing(path) as partial:
            lines = [asdict(one).values() for one in table.values()]  # type: ignore[call-overload]
            partial.write_text(csv_text(list(types), lines), encoding="utf-8")
    return found
