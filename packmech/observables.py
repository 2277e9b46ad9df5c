"""Observables: what is measured of a packing while it moves, declared once by name, shape and unit.

Traces, tables of columns and the curves of recordings are made from these declarations. `pm.observable` adds one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.check import brief, function, instance, one_of
from packmech.packing import Packing

Column = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.str_]

SHAPES = ("", "d", "k", "dd")
PLOTS = ("linear", "log10", "none")
_AXES = "xyz"


@shown()
@dataclass(frozen=True, eq=False)
class State:
    """What an observable is measured of: a packing as it is at one step.

    Attributes
    ----------
    packing
        The packing, in its box at that time.
    effects
        The effects of the scene: `pm.Scene(state.packing, state.effects)` has its energy and forces.
    step, time
        Number of the step [1]; time since the start [time], or None for a minimization.
    velocity_nd, spin_nk
        (N, d) velocities [length/time], peculiar ones in a box that deforms; (N, 1 or 3) spins [1/time]. None for a
        minimization, and spins where particles do not turn.

    """

    packing: Packing
    effects: tuple[Any, ...]
    step: int
    time: float | None = None
    velocity_nd: NDArray[np.float64] | None = None
    spin_nk: NDArray[np.float64] | None = None


Measure = Callable[[State], ArrayLike | None]


@dataclass(frozen=True)
class Observable:
    """One quantity that is measured against time.

    Attributes
    ----------
    name
        Its name: a trace keeps it as ``trace[name]``, a table as the columns ``name``, ``name_x`` or ``name_xy``.
    unit
        Its unit, {d} standing for the dimension.
    shape
        "" for a number, "d" for a vector, "k" for a vector along the axes of rotation (one number in a plane), "dd"
        for a tensor.
    plot
        How recordings plot a number: "linear", "log10", or "none".
    label
        What plots call it.
    integer
        Whether it counts something.
    measure
        Function of a `State`; None for those that the compiled loops measure.

    """

    name: str
    unit: str = "1"
    shape: str = ""
    plot: str = "linear"
    label: str = ""
    integer: bool = False
    measure: Measure | None = None

    def unit_in(self, dimension: int | None) -> str:
        """Return the unit in this dimension; None: unknown."""
        return self.unit.format(d="d" if dimension is None else dimension)

    def size_in(self, dimension: int) -> tuple[int, ...]:
        """Return the shape of one value as a tuple of numbers."""
        d = dimension
        return {"": (), "d": (d,), "k": (1 if d == 2 else 3,), "dd": (d, d)}[self.shape]

    def of(self, state: State) -> NDArray[np.float64]:
        """Return what is measured of a state, as an array of the declared shape; nan where there is nothing.

        Raises
        ------
        ValueError
            If the function returns another shape.

        """
        assert self.measure is not None
        size = self.size_in(state.packing.dimension)
        found = self.measure(state)
        value = np.full(size, np.nan) if found is None else np.array(found, dtype=np.float64)
        if value.shape != size:
            raise ValueError(f"observable {self.name!r} must return an array of shape {size}, got {value.shape}")
        return value


def _declared() -> dict[str, Observable]:
    energy_density = "energy/length^{d}"
    tensors = ("stress", "contact_stress", "overall_stress", "torque_stress", "spin_stress", "bond_stress")
    listed = (
        Observable("step", integer=True, plot="none"),
        Observable("time", "time", plot="none"),
        Observable("strain"),
        Observable("strain_rate", "1/time", plot="none"),
        Observable("rate", "1/time", plot="none"),
        Observable("phase", plot="none"),
        Observable("energy", "energy", plot="log10"),
        Observable("potential", "energy", plot="none"),
        Observable("tangential", "energy", plot="none"),
        Observable("kinetic", "energy", plot="log10", label="kinetic energy"),
        Observable("rotational", "energy", plot="none"),
        Observable("pressure", energy_density, plot="log10"),
        Observable("shear_stress", energy_density, plot="none"),
        *(Observable(name, energy_density, "dd", "none") for name in (*tensors, "kinetic_stress")),
        Observable("kinetic_energy", "energy", plot="log10", label="kinetic energy"),
        Observable("elastic_energy", "energy", plot="log10"),
        Observable("work", "energy"),
        Observable("max_force", "force", plot="log10", label="max force"),
        Observable("contacts", integer=True),
        Observable("sliding", integer=True, plot="none"),
        Observable("sliding_fraction", label="sliding part"),
        Observable("momentum", "mass length/time", "d", "none"),
        Observable("angular_momentum", "mass length^2/time", "k", "none"),
        Observable("link_error", plot="none"),
    )
    return {one.name: one for one in listed}


OBSERVABLES: dict[str, Observable] = _declared()


def observable(
    *, unit: str = "1", shape: str = "", plot: str = "linear", label: str = ""
) -> Callable[[Measure], Measure]:
    """Return a decorator that adds a function of a `State` to what traces, tables and recordings keep.

    The function's name is that of the observable. It is called whenever a run keeps a row of its trace, and must not
    change what it is given; it may return None where there is nothing to measure (velocities of a minimization), which
    is kept as nan.

    Parameters
    ----------
    unit
        The unit, {d} standing for the dimension: "energy/length^{d}".
    shape
        "" for a number, "d" for a vector, "k" for a vector along the axes of rotation, "dd" for a tensor.
    plot
        "linear", "log10" or "none": how recordings plot it; only numbers are plotted.
    label
        What plots call it; the name unless given.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or the name is that of an observable of packmech's own.

    Examples
    --------
    >>> import numpy as np, packmech as pm
    >>> @pm.observable(unit="length")
    ... def largest_overlap(state):
    ...     return pm.find_contacts(state.packing).overlap_c.max(initial=0.0)
    >>> scene = pm.Scene(pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1), (pm.Repulsion(),))
    >>> trace = pm.quench(scene, force_tolerance=1e-6, trace_every=50).trace
    >>> trace["largest_overlap"].shape == trace.energy_t.shape
    True
    >>> del OBSERVABLES["largest_overlap"]

    """
    one_of("shape", shape, SHAPES)
    one_of("plot", plot, PLOTS)
    for name, value in (("unit", unit), ("label", label)):
        if not isinstance(value, str):
            raise TypeError(f"{name} must be a text, got {brief(value)}")

    def add(measure: Measure) -> Measure:
        function("measure", measure)
        name = str(getattr(measure, "__name__", ""))
        if not name.isidentifier():
            raise ValueError(f"measure must be a function with a name, got {brief(measure)}")
        if name in OBSERVABLES and OBSERVABLES[name].measure is None:
            raise ValueError(f"measure must have a name of its own, got {brief(name)}, which packmech measures itself")
        OBSERVABLES[name] = Observable(name, unit, shape, plot, label, measure=measure)
        return measure

    return add


def added_observables() -> tuple[Observable, ...]:
    """Return the observables that were added by `pm.observable`, in that order."""
    return tuple(one for one in OBSERVABLES.values() if one.measure is not None)


def measure_added(state: Callable[[], State]) -> dict[str, NDArray[np.float64]]:
    """Return what the added observables say of a state, which is made only if there are any."""
    added = added_observables()
    if not added:
        return {}
    now = state()
    return {one.name: one.of(now) for one in added}


def added_arrays(rows: Sequence[Mapping[str, NDArray[np.float64]]]) -> dict[str, NDArray[np.float64]]:
    """Return rows of added observables as arrays of a checkpoint, by name."""
    return {f"added_{name}": np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


def added_rows(arrays: Mapping[str, Any], count: int, dimension: int) -> list[dict[str, NDArray[np.float64]]]:
    """Return so many rows of the observables that are added now from the arrays of a checkpoint; nan where it has none.

    Parameters
    ----------
    arrays
        Arrays by name.
    count
        How many rows were kept.
    dimension
        Of the packing.

    """
    columns: dict[str, NDArray[np.float64]] = {}
    for one in added_observables():
        shape = (count, *one.size_in(dimension))
        kept = arrays.get(f"added_{one.name}")
        columns[one.name] = kept if kept is not None and kept.shape == shape else np.full(shape, np.nan)
    return [{name: column[t] for name, column in columns.items()} for t in range(count)]


def component_names(name: str, shape: Sequence[int], *, symmetric: bool = False) -> list[str]:
    """Return the names of the components of a number, vector or tensor, a tensor's row first.

    Those of a symmetric tensor are named once: xx, yy, zz, yz, xz, xy.

    Examples
    --------
    >>> component_names("momentum", (2,)), component_names("stress", (2, 2), symmetric=True)
    (['momentum_x', 'momentum_y'], ['stress_xx', 'stress_yy', 'stress_xy'])

    """
    if len(shape) == 0:
        return [name]
    if len(shape) == 1:
        return [f"{name}_{axis}" for axis in (_AXES[: shape[0]] if shape[0] > 1 else "z")]
    axes = _AXES[: shape[0]]
    if symmetric:
        mixed = ("xy",) if len(axes) == 2 else ("yz", "xz", "xy")
        return [f"{name}_{pair}" for pair in (*(2 * a for a in axes), *mixed)]
    return [f"{name}_{a}{b}" for a in axes for b in axes]


def columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """Return rows of values by name as columns by name: integers for what counts, without names that are None.

    Examples
    --------
    >>> {name: column.tolist() for name, column in columns_of([{"step": 0, "energy": 1.0, "rotational": None}]).items()}
    {'step': [0], 'energy': [1.0]}

    """
    first = rows[0]
    columns = {name: np.array([row[name] for row in rows]) for name in first if first[name] is not None}
    return {
        name: column.astype(np.int64) if name in OBSERVABLES and OBSERVABLES[name].integer else column
        for name, column in columns.items()
    }


def columns_in(record: Any, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return the observables among a record's fields, which are named after them with their axes: energy_t, stress_tdd.

    Parameters
    ----------
    record
        The record.
    names
        Its fields.

    """
    found: dict[str, NDArray[Any]] = {}
    for field in names:
        stem, _, axes = field.rpartition("_")
        if stem in OBSERVABLES and axes == f"t{OBSERVABLES[stem].shape}":
            value = getattr(record, field)
            if value is not None:
                found[stem] = value
    return found


@shown()
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
            raise KeyError(f"name must be one of {', '.join(self.columns)}, got {brief(name)}")
        return self.columns[name]

    def tensor(self, name: str) -> NDArray[np.float64]:
        """Return the (T, d, d) tensor whose components are columns.

        Raises
        ------
        TypeError, KeyError
            If the name is no text, or there is none of that name.

        """
        instance("name", name, str)
        axes = _AXES if f"{name}_zz" in self.columns else _AXES[:2]
        rows = [[self[f"{name}_{a}{b}"] for b in axes] for a in axes]
        return np.moveaxis(np.array(rows, dtype=np.float64), 2, 0)


@runtime_checkable
class HasTable(Protocol):
    """A run or a trace that makes its own table."""

    def table(self) -> Table:
        """Return every tensor and number that was kept against time."""


def make_table(
    found: Mapping[str, NDArray[Any]], about: Mapping[str, Any], units: Mapping[str, str] | None = None
) -> Table:
    """Return the table of scalars, vectors and tensors against time, a column for each component.

    Parameters
    ----------
    found
        (T,), (T, d) or (T, d, d) arrays by name.
    about
        What the run says of itself; "dimension" is that of the units.
    units
        Unit of each; those of the observables unless given.

    """
    columns: dict[str, Column] = {}
    unit_of: dict[str, str] = {}
    for name, value in found.items():
        plain: NDArray[Any] = value.astype(np.int64 if np.issubdtype(value.dtype, np.integer) else np.float64)
        names = component_names(name, plain.shape[1:])
        parts = dict(zip(names, plain.reshape(len(plain), len(names)).T, strict=True))
        columns |= {key: np.ascontiguousarray(part) for key, part in parts.items()}
        unit = OBSERVABLES[name].unit_in(about.get("dimension")) if units is None else units[name]
        unit_of |= dict.fromkeys(parts, unit)
    return Table(columns, unit_of, dict(about))
