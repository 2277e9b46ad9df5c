"""The results of an ensemble: one row for each member, made from the folder at any time."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import in_words, shown
from packmech.check import brief, chosen_rows, clear_errors, did_you_mean, integer
from packmech.ensemble.folder import WORKSPACE, Found, find_all, listed_members, read_arrays, read_job
from packmech.ensemble.members import Grid, Member, members_of
from packmech.files.packings import read_packing
from packmech.files.paths import PathLike, file_name
from packmech.observables import Column, Table
from packmech.packing import Packing

STATES = ("done", "failed", "missing")
# columns beside parameters and results
_OWN = ("id", "state", "random_seed", "seconds", "reason", "message", "traceback")
_REDUCED = "energy_scale/diameter^d"
_UNITS = {
    "seconds": "s",
    **dict.fromkeys(
        ("pressure", "bulk_modulus", "shear_modulus", "shear_modulus_mean", "shear_modulus_reuss"), _REDUCED
    ),
}
# longest list of values that a repr shows
_SHOWN = 4


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """The members of a folder and their results, as they were when it was read.

    ``ensemble["phi"]`` is the column of that name; rows are in the order of the parameters.

    Attributes
    ----------
    folder
        Where they lie.
    members
        Each with its parameters.
    columns
        (M,) arrays by name: ``id``; the parameters; ``state``, one of "done", "failed" and "missing"; the results,
        nan or empty where there are none; ``random_seed``; ``seconds`` of CPU time; and why a member failed:
        ``reason``, ``message`` and ``traceback``.

    """

    folder: Path
    members: tuple[Member, ...]
    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.members)

    def __getitem__(self, name: str) -> Column:
        if name not in self.columns:
            near = did_you_mean(name, self.columns)
            raise KeyError(f"name must be one of {', '.join(self.columns)}, got {brief(name)}{near}")
        return self.columns[name]

    def counts(self) -> dict[str, int]:
        """Return how many members are done, failed and missing."""
        return {state: int((self.columns["state"] == state).sum()) for state in STATES}

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(dict.fromkeys(name for one in self.members for name in one.parameters))

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the results."""
        return tuple(name for name in self.columns if name not in _OWN and name not in self.parameters)

    def table(self) -> Table:
        """Return the columns with their units, for `pm.write_table`."""
        about = {"kind": "Ensemble", **self.counts()}
        return Table(dict(self.columns), {name: _UNITS.get(name, "") for name in self.columns}, about)

    def rows(self) -> Table:
        """Return the arrays that members left, one below the other: a row for each entry, with the member's parameters.

        For jobs that return columns, as of a packing that is followed over levels. Members without arrays have no rows,
        and parameters that are lists no column.

        Raises
        ------
        ValueError
            If members left arrays of other names or shapes.

        """
        kept = {row: arrays for row in range(len(self)) if (arrays := self.arrays(row))}
        names = list(next(iter(kept.values()), ()))
        for row, arrays in kept.items():
            if list(arrays) != names or len({one.shape for one in arrays.values()}) > 1 or arrays[names[0]].ndim != 1:
                raise ValueError(
                    f"members must have left columns {', '.join(names)} of one length each, got "
                    f"{ {name: one.shape for name, one in arrays.items()} } of {self.members[row].parameters}"
                )
        count = [len(arrays[names[0]]) for arrays in kept.values()]
        single = [
            name for name in self.parameters if not any(isinstance(m.parameters.get(name), list) for m in self.members)
        ]
        columns: dict[str, Any] = {name: np.repeat(self.columns[name][list(kept)], count) for name in single}
        columns |= {name: np.concatenate([arrays[name] for arrays in kept.values()]) for name in names}
        return Table(columns, {name: _UNITS.get(name, "") for name in columns}, {"kind": "Ensemble", **self.counts()})

    def where(self, **parameters: Any) -> Ensemble:
        """Return the members with these values of parameters or results; "__" stands for the dots of a name.

        Raises
        ------
        KeyError
            If there is no such column.

        """
        chosen_m = np.ones(len(self), dtype=bool)
        for name, value in parameters.items():
            chosen_m &= self[name.replace("__", ".")] == value
        return self.take(np.flatnonzero(chosen_m))

    def of(self, grid: Grid) -> Ensemble:
        """Return the members of a grid, in its order; a folder keeps those of other grids, too.

        Raises
        ------
        TypeError, ValueError
            If it is no grid (see `pm.run_ensemble`), or names a member that is not here.

        """
        place = {one.id: row for row, one in enumerate(self.members)}
        wanted = members_of(grid)
        for one in wanted:
            if one.id not in place:
                raise ValueError(f"grid must name members of the ensemble, got {one.parameters}")
        return self.take([place[one.id] for one in wanted])

    def take(self, rows: NDArray[np.int64] | Sequence[int]) -> Ensemble:
        """Return the members of these rows."""
        index = np.arange(len(self))[chosen_rows("rows", rows, len(self))]
        return replace(
            self,
            members=tuple(self.members[k] for k in index),
            columns={name: column[index] for name, column in self.columns.items()},
        )

    def path(self, row: int) -> Path:
        """Return the folder of the member in a row."""
        return self.folder / WORKSPACE / self.members[integer("row", row, at_least=0, at_most=len(self) - 1)].id

    def packing(self, row: int, name: str = "packing") -> Packing:
        """Return the packing that the member in a row left, read from its folder.

        Raises
        ------
        FileNotFoundError
            If it left none.

        """
        return read_packing(self.path(row) / f"{name}.npz")

    def arrays(self, row: int) -> dict[str, NDArray[Any]]:
        """Return the arrays that the member in a row left, by name; none if it left none."""
        return read_arrays(self.path(row))

    def __repr__(self) -> str:
        counted = ", ".join(f"{number} {state}" for state, number in self.counts().items() if number)
        lines = [f"Ensemble: {len(self)} members in {self.folder} ({counted or 'none'})"]
        for name in self.parameters:
            values = list(dict.fromkeys(self.columns[name].tolist()))
            shown = values if len(values) <= _SHOWN else [*values[: _SHOWN - 1], "...", values[-1]]
            lines.append(f"  {name} = {', '.join(map(in_words, shown))}")
        lines.append(f"  results: {', '.join(self.results) or 'none yet'}")
        return "\n".join(lines)


@clear_errors
def read_ensemble(folder: PathLike) -> Ensemble:
    """Return the table of an ensemble, made from its members as they are now; packings are read when asked for.

    Parameters
    ----------
    folder
        That of `pm.run_ensemble`, which may be running.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If it is none of an ensemble.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp()) / "crystals"
    >>> changed = pm.run_ensemble("triangular", {"effects.repulsion.law.energy_scale": [1.0, 2.0]}, folder, workers=1)
    >>> found = pm.read_ensemble(folder)
    >>> found["state"].tolist(), found["bulk_modulus"].shape, found.packing(0).particles > 0
    (['done', 'done'], (2,), True)

    """
    place = file_name("folder", folder, "a folder's name")
    read_job(place)
    return ensemble_of(place, find_all(place, listed_members(place)))


def ensemble_of(folder: Path, found: Sequence[Found]) -> Ensemble:
    """Return the ensemble of members as they were found."""
    members = tuple(one.member for one in found)
    rows: list[dict[str, Any]] = []
    for one in found:
        result, failure = one.result or {}, one.failure or {}
        rows.append(
            {
                **result.get("values", {}),
                **one.member.parameters,
                "id": one.member.id,
                "state": one.state,
                "random_seed": one.member.random_seed,
                "seconds": result.get("seconds"),
                **{name: str(failure.get(name, "")) for name in ("reason", "message", "traceback")},
            }
        )
    parameters = list(dict.fromkeys(name for one in members for name in one.parameters))
    results = [name for name in dict.fromkeys(name for row in rows for name in row) if name not in (*parameters, *_OWN)]
    names = ["id", *parameters, "state", *results, *_OWN[2:]]
    return Ensemble(folder, members, {name: _column([row.get(name) for row in rows]) for name in names})


def _column(values: list[Any]) -> Column:
    """Return values as a column: whole numbers, numbers with nan where there are none, or texts."""
    given = [one for one in values if one is not None]
    if all(isinstance(one, int) for one in given) and len(given) == len(values):
        return np.array(values, dtype=np.int64)
    if all(isinstance(one, int | float) for one in given):
        return np.array([np.nan if one is None else one for one in values], dtype=np.float64)
    return np.array(
        ["" if one is None else one if isinstance(one, str) else json.dumps(one) for one in values], dtype=np.str_
    )
