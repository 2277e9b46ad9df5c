"""Figures of a run against time as a file with columns: parquet, or plain CSV by the ending of the name.

A tensor takes a column for each component, ``overall_stress_xy`` and so on, row first; the unit of each column and what
the run says of itself are in the file. CSV files start with a line ``# packmech table`` and a JSON table of both, then
the names; numbers have as many digits as they need to be read back exactly.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.particle_shear import ParticleShearRun
from packmech.dynamics.rheology.travel import StrainRun
from packmech.files import replacing, target_file
from packmech.outcome import Run, Trace

Column = NDArray[np.float64] | NDArray[np.int64]

ENDINGS = (".parquet", ".csv")
_AXES = "xyz"
_FIRST_LINE = "# packmech table "
_KEY = b"packmech"

# what is kept once a step, by name less the axes; d is the dimension
_UNITS = {
    "step": "1",
    "contacts": "1",
    "sliding": "1",
    "sliding_fraction": "1",
    "strain": "1",
    "link_error": "1",
    "phase": "1",
    "time": "time",
    "strain_rate": "1/time",
    "rate": "1/time",
    "max_force": "force",
    "momentum": "mass length/time",
    "angular_momentum": "mass length^2/time",
    "energy": "energy",
    "potential": "energy",
    "tangential": "energy",
    "kinetic": "energy",
    "rotational": "energy",
    "pressure": "energy/length^{d}",
}
_RUN_FIGURES = ("outcome", "steps", "dt", "amplitude", "frequency", "start", "periods", "skip_periods", "energy_drift")
# further columns that strained runs derive from the others
_DERIVED = ("pressure_t", "shear_stress_t", "sliding_fraction_t", "phase_t")


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one length by name, with the unit of each.

    Attributes
    ----------
    columns
        (T,) arrays by name.
    units
        Unit of each, "1" for plain numbers.
    about
        What the run says of itself: its outcome, time step and so on.

    """

    columns: Mapping[str, Column]
    units: Mapping[str, str]
    about: Mapping[str, Any]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> Column:
        if name not in self.columns:
            raise KeyError(f"name must be one of {', '.join(self.columns)}, got {name!r}")
        return self.columns[name]

    def tensor(self, name: str) -> NDArray[np.float64]:
        """Return the (T, d, d) tensor whose components are columns.

        Raises
        ------
        KeyError
            If there is none of that name.

        """
        axes = _AXES if f"{name}_zz" in self.columns else _AXES[:2]
        rows = [[self[f"{name}_{a}{b}"] for b in axes] for a in axes]
        return np.moveaxis(np.array(rows, dtype=np.float64), 2, 0)


def table_of(subject: Any) -> Table:
    """Return every tensor and figure that a run kept against time.

    Parameters
    ----------
    subject
        A run that was traced (`pm.simulate(..., trace_every=...)`, `pm.oscillatory_shear`, a minimizer's), a trace, or
        the run of a `pm.ParticleShear`.

    Raises
    ------
    TypeError, ValueError
        If it is neither, or kept nothing.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> run = pm.simulate(pm.Scene(crystal, (pm.Repulsion(),)), steps=20, dt=0.1, trace_every=5)
    >>> table = table_of(run)
    >>> table["step"].tolist(), table.units["stress_xy"], table.tensor("stress").shape
    ([0, 5, 10, 15, 20], 'energy/length^2', (5, 2, 2))

    """
    if isinstance(subject, ParticleShearRun):
        return _table_of_preset(subject)
    if not isinstance(subject, Run | Trace):
        raise TypeError(f"subject must be a run or a trace, got {type(subject).__name__}")
    holder = subject
    if isinstance(subject, Run) and not isinstance(subject, StrainRun):
        if subject.trace is None:
            raise ValueError("subject must be a run with a trace (trace_every=...), got one without")
        holder = subject.trace
    found: dict[str, NDArray[Any]] = {}
    for field in fields(holder):
        value = getattr(holder, field.name)
        stem, _, axes = field.name.rpartition("_")
        # positions and lattices are not figures: the last axis of those that are has d numbers, or they are tensors
        # (who touches whom, which has no axes, is none either)
        if axes in ("t", "td", "tk", "tdd") and stem != "lattice" and isinstance(value, np.ndarray):
            found[stem] = value
    if isinstance(holder, StrainRun):
        found |= {f"{name}_stress": value for name, value in holder.stress.items()}
        found |= {name.removesuffix("_t"): getattr(holder, name) for name in _DERIVED if hasattr(holder, name)}
    stress = next((value for name, value in found.items() if value.ndim == 3), None)
    d = _dimension(subject) if stress is None else stress.shape[1]
    about: dict[str, Any] = {"kind": type(subject).__name__, "dimension": d}
    for name in _RUN_FIGURES:
        if hasattr(subject, name):
            value = getattr(subject, name)
            about[name] = value.name.lower() if name == "outcome" else value
    moduli = getattr(subject, "moduli", None)
    if moduli is not None:
        about |= {"storage_modulus": float(moduli.storage), "loss_modulus": float(moduli.loss)}
    return _flattened(found, {name: _unit(name, d) for name in found}, about)


def _dimension(subject: Any) -> int | None:
    packing = getattr(subject, "packing", None)
    return None if packing is None else int(packing.dimension)


def _unit(name: str, dimension: int | None) -> str:
    power = "d" if dimension is None else str(dimension)
    if name.endswith("stress"):
        return _UNITS["pressure"].format(d=power)
    return _UNITS.get(name, "").format(d=power)


def _flattened(found: Mapping[str, NDArray[Any]], units: Mapping[str, str], about: Mapping[str, Any]) -> Table:
    """Return the table of scalars, vectors and tensors against time."""
    columns: dict[str, Column] = {}
    unit_of: dict[str, str] = {}
    for name, value in found.items():
        plain: NDArray[Any] = value.astype(np.int64 if np.issubdtype(value.dtype, np.integer) else np.float64)
        if plain.ndim == 1:
            parts = {name: plain}
        elif plain.ndim == 2:
            own = _AXES[: plain.shape[1]] if plain.shape[1] > 1 else "z"
            parts = {f"{name}_{axis}": plain[:, a] for a, axis in enumerate(own)}
        else:
            d = plain.shape[1]
            parts = {f"{name}_{_AXES[a]}{_AXES[b]}": plain[:, a, b] for a in range(d) for b in range(d)}
        columns |= {key: np.ascontiguousarray(part) for key, part in parts.items()}
        unit_of |= dict.fromkeys(parts, units[name])
    return Table(columns, unit_of, dict(about))


def _table_of_preset(run: ParticleShearRun) -> Table:
    from packmech.dynamics.particle_shear import STRESSES

    series = run.series
    found = {"time": series.time_t, "strain": series.strain_t, "strain_rate": series.strain_rate_t}
    units = {"time": "s", "strain": "1", "strain_rate": "1/s"}
    for name in STRESSES:
        found[f"{name}_stress"] = run.stress(name)
        units[f"{name}_stress"] = "Pa"
    about = {"kind": "ParticleShearRun", "dimension": 2, "sign": "compression positive"}
    return _flattened(found, units, about)


def write_table(subject: Any, path: str | os.PathLike[str]) -> None:
    """Write every tensor and figure that a run kept against time to a columnar file; read them with `pm.read_table`.

    Parameters
    ----------
    subject
        What `table_of` takes: a run that was traced, a trace; or a table.
    path
        The file: `.parquet` (for pandas, polars, DuckDB, R's arrow, ...) or `.csv`. An existing one is replaced, whole
        or not at all.

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
    target = target_file(path)
    ending = _ending(target)
    if ending == ".parquet":
        _arrow()
    with replacing(target) as partial:
        if ending == ".parquet":
            _write_parquet(table, partial)
        else:
            _write_csv(table, partial)


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
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name, got {path!r}")
    found = Path(path)
    if not found.is_file():
        raise FileNotFoundError(f"path must name an existing file, got {str(path)!r}")
    read = _read_parquet if _ending(found) == ".parquet" else _read_csv
    if read is _read_parquet:
        _arrow()
    try:
        return read(found)
    # pyarrow's errors are ValueErrors and OSErrors
    except (OSError, ValueError, KeyError, TypeError) as error:
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
            pyarrow.field(name, pyarrow.from_numpy_dtype(value.dtype), False, {"unit": table.units[name]})
            for name, value in table.columns.items()
        ],
        metadata={_KEY: json.dumps(dict(table.about)).encode()},
    )
    whole = pyarrow.table([pyarrow.array(value) for value in table.columns.values()], schema=schema)
    parquet.write_table(whole, path)


def _read_parquet(path: Path) -> Table:
    _, parquet = _arrow()
    whole = parquet.read_table(path)
    metadata = whole.schema.metadata or {}
    if _KEY not in metadata:
        raise ValueError("it was not written by packmech")
    columns = {name: whole.column(name).to_numpy() for name in whole.schema.names}
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in whole.schema}
    return Table(columns, units, json.loads(metadata[_KEY]))


def _write_csv(table: Table, path: Path) -> None:
    whole = [name for name, value in table.columns.items() if value.dtype == np.int64]
    head = {"about": dict(table.about), "units": dict(table.units), "integers": whole}
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
            raise ValueError(f"its first line must start with {_FIRST_LINE!r}, got {first[:40]!r}")
        head = json.loads(first[len(_FIRST_LINE) :])
        names, *rows = csv.reader(file)
    columns: dict[str, Column] = {}
    for k, name in enumerate(names):
        if name in head["integers"]:
            columns[name] = np.array([int(row[k]) for row in rows], dtype=np.int64)
        else:
            columns[name] = np.array([float(row[k]) for row in rows], dtype=np.float64)
    return Table(columns, head["units"], head["about"])
