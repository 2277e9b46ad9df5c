"""What a run kept against time, or an ensemble of its members, as a file with columns: parquet, or CSV by its ending.

A tensor takes a column for each component, ``overall_stress_xy`` and so on, row first; the unit of each column and what
the run says of itself are in the file. CSV files start with a line ``# packmech table`` and a JSON table of both, then
the names; numbers have as many digits as they need to be read back exactly.
"""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from packmech.check import brief, clear_errors
from packmech.files.paths import existing_file, replacing, writable_file
from packmech.observables import Column, HasTable, Table

ENDINGS = (".parquet", ".csv")
_FIRST_LINE = "# packmech table "
_KEY = b"packmech"


def table_of(subject: Any) -> Table:
    """Return every tensor and number that a run kept against time.

    Parameters
    ----------
    subject
        A run that was traced (`pm.simulate(..., trace_every=...)`, `pm.oscillatory_shear`, a minimizer's), a trace, or
        anything that makes its own table, as the run of a `pm.ParticleShear` does.

    Raises
    ------
    TypeError, ValueError
        If it makes none, or kept nothing.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> run = pm.simulate(pm.Scene(crystal, (pm.Repulsion(),)), steps=20, dt=0.1, trace_every=5)
    >>> table = table_of(run)
    >>> table["step"].tolist(), table.units["stress_xy"], table.tensor("stress").shape
    ([0, 5, 10, 15, 20], 'energy/length^2', (5, 2, 2))

    """
    if not isinstance(subject, HasTable):
        raise TypeError(f"subject must be a run or a trace, got {type(subject).__name__}")
    return subject.table()


@clear_errors
def write_table(subject: Any, path: str | os.PathLike[str]) -> None:
    """Write every tensor and number that a run kept against time to a columnar file; read them with `pm.read_table`.

    Parameters
    ----------
    subject
        What `table_of` takes: a run that was traced, a trace; or a table.
    path
        The file: `.parquet` (for pandas, polars, DuckDB, R's arrow, ...) or `.csv`. An existing one is replaced
        completely or not at all.

    Raises
    ------
    TypeError, ValueError
        If nothing was kept, or the path has another ending.
    ImportError
        For parquet without pyarrow, which the extra `tables` brings.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> scene = pm.Scene(crystal, (pm.Repulsion(),))
    >>> run = pm.simulate(scene, steps=20, dt=0.1, trace_every=5, temperature=0.01, seed=1)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "run.parquet"
    >>> write_table(run, path)
    >>> bool((read_table(path)["pressure"] == run.trace.pressure_t).all())
    True

    """
    table = subject if isinstance(subject, Table) else table_of(subject)
    target = writable_file("path", path)
    ending = _ending(target)
    if ending == ".parquet":
        _arrow()
    with replacing(target) as partial:
        if ending == ".parquet":
            _write_parquet(table, partial)
        else:
            _write_csv(table, partial)


@clear_errors
def read_table(path: str | os.PathLike[str]) -> Table:
    """Return the table that `pm.write_table` wrote.

    Parameters
    ----------
    path
        A `.parquet` or `.csv` file.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If there is no such table.
    ImportError
        For parquet without pyarrow.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> run = pm.simulate(pm.Scene(crystal, (pm.Repulsion(),)), steps=20, dt=0.1, trace_every=5)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "run.csv"
    >>> pm.write_table(run, path)
    >>> table = read_table(path)
    >>> table["contacts"].tolist(), table.units["time"], table.about["dt"]
    ([27, 27, 27, 27, 27], 'time', 0.1)

    """
    found = existing_file("path", path)
    read = _read_parquet if _ending(found) == ".parquet" else _read_csv
    if read is _read_parquet:
        _arrow()
    try:
        return read(found)
    # pyarrow's errors are ValueErrors and OSErrors
    except (OSError, ValueError, LookupError, ArithmeticError, AttributeError, TypeError) as error:
        raise ValueError(f"path must name a table of packmech, got {str(path)!r}: {error}") from error


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise ValueError(f"path must end in one of {', '.join(ENDINGS)}, got {str(path)!r}")
    return ending


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ImportError(
            "path must end in .csv where pyarrow is missing, got .parquet; "
            "pip install 'packmech[tables]' brings what .parquet needs"
        ) from error
    return pyarrow, pyarrow.parquet


def _write_parquet(table: Table, path: Path) -> None:
    pyarrow, parquet = _arrow()
    schema = pyarrow.schema(
        [
            pyarrow.field(name, _arrow_type(value), False, {"unit": table.units[name]})
            for name, value in table.columns.items()
        ],
        metadata={_KEY: json.dumps(dict(table.about)).encode()},
    )
    arrow_table = pyarrow.table([pyarrow.array(value) for value in table.columns.values()], schema=schema)
    parquet.write_table(arrow_table, path)


def _arrow_type(column: Column) -> Any:
    pyarrow, _ = _arrow()
    return pyarrow.string() if column.dtype.kind == "U" else pyarrow.from_numpy_dtype(column.dtype)


def _read_parquet(path: Path) -> Table:
    _, parquet = _arrow()
    arrow_table = parquet.read_table(path)
    metadata = arrow_table.schema.metadata or {}
    if _KEY not in metadata:
        raise ValueError("it was not written by packmech")
    found = {name: arrow_table.column(name).to_numpy() for name in arrow_table.schema.names}
    columns = {name: value.astype(np.str_) if value.dtype == object else value for name, value in found.items()}
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in arrow_table.schema}
    return Table(columns, units, json.loads(metadata[_KEY]))


def _write_csv(table: Table, path: Path) -> None:
    integers = [name for name, value in table.columns.items() if value.dtype == np.int64]
    texts = [name for name, value in table.columns.items() if value.dtype.kind == "U"]
    rows = len(next(iter(table.columns.values()), ()))
    head = {"about": dict(table.about), "units": dict(table.units), "integers": integers, "rows": rows}
    head |= {"texts": texts} if texts else {}
    with open(path, "w", encoding="utf-8", newline="") as file:
        file.write(f"{_FIRST_LINE}{json.dumps(head)}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table.columns)
        # the csv module writes floats by repr: the shortest decimal that is read back exactly
        writer.writerows(zip(*(value.tolist() for value in table.columns.values()), strict=True))


def _read_csv(path: Path) -> Table:
    with open(path, encoding="utf-8", newline="") as file:
        first = file.readline()
        if not first.startswith(_FIRST_LINE):
            raise ValueError(f"its first line must start with {_FIRST_LINE!r}, got {brief(first[:40])}")
        head = json.loads(first[len(_FIRST_LINE) :])
        lines = list(csv.reader(file))
    if not lines:
        raise ValueError("its second line must hold the names of columns, got none")
    names, *rows = lines
    count = head.get("rows", len(rows))
    if len(rows) != count:
        raise ValueError(
            f"it must hold {count} rows, as its first line says, got {len(rows)}: it was cut off or changed"
        )
    uneven = next((k for k, row in enumerate(rows) if len(row) != len(names)), None)
    if uneven is not None:
        raise ValueError(f"line {uneven + 3} must hold {len(names)} values, got {len(rows[uneven])}")
    columns: dict[str, Column] = {}
    for k, name in enumerate(names):
        if name in head["integers"]:
            columns[name] = np.array([int(row[k]) for row in rows], dtype=np.int64)
        elif name in head.get("texts", ()):
            columns[name] = np.array([row[k] for row in rows], dtype=np.str_)
        else:
            columns[name] = np.array([float(row[k]) for row in rows], dtype=np.float64)
    return Table(columns, head["units"], head["about"])
