"""What a run or a solve achieved and what it cost, and how that is said in words, by name and as a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, KeysView, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import as_html, as_text, shown, without_negative_zeros
from packmech.check import brief, table
from packmech.observables import Table, columns_in, columns_of, make_table
from packmech.packing import Packing

# name, value in words, what the value is or its unit
Row = tuple[str, str, str]

STAGE_HEADINGS = ("step", "residual", "force evaluations", "CPU s", "")
# what the residual of a flow is
_OF_A_FLOW = "residual: unbalanced force, of a flow not expected to vanish"
# units and meanings of what protocols report, d being the dimension
_REPORT_NOTES = {
    "packing_fraction": "rattlers included",
    "jamming_packing_fraction": "of the hard packing, rattlers included",
    "pressure": "energy_scale / diameter^{d}",
    "pressure_asked": "energy_scale / diameter^{d}",
    "contacts": "between particles that are no rattlers",
    "stress_anisotropy": "largest deviatoric stress / pressure",
    "gap_error": "of the hard packing, over the diameter",
    "force_imbalance": "of the hard packing, over the mean force",
}


class Outcome(Enum):
    """How a run or a solve ended; the value is the sentence for the user."""

    CONVERGED = "The stated tolerance was met."
    ROUNDING_FLOOR = "Forces fell to the floor that double precision sets here; the tolerance asked for lies below it."
    UNJAMMED = "No particles touch any more: the energy is zero and there is nothing left to minimize."
    STEP_LIMIT = "The step limit was reached before the tolerance; raise step_limit or loosen the tolerance."
    STALLED = "No further progress is possible with this method; try another method or a looser tolerance."
    NOT_JAMMED = "The protocol ended without a jammed packing; start denser, or change its parameters."
    UNSTABLE = "Forces balance on a saddle, not in a minimum: a small displacement grows; move it a little and go on."
    INACCURATE = "The solver stopped short of its tolerance; see the residual and the gap."
    INFEASIBLE = "The program has no feasible point."
    DEGENERATE = "Links lose rank here: Newton's method converges only linearly and link forces are not determined."
    FINISHED = "The time or strain that was asked for has been reached."
    STEP_TOO_LONG = (
        "The time step is too long: something moved too far in a step, links were lost, or energy grew by more than "
        "work explains; the packing is the last one before that was seen: take a shorter dt."
    )
    TIME_LIMIT = (
        "The time limit was reached before the end; the packing is the last one that was finished: "
        "raise time_limit, or go on from it."
    )
    NOT_AT_PRESSURE = (
        "The pressure measured is not the one asked for, within its error and the tolerance: begin nearer to it, "
        "skip more of the start, or go on for longer."
    )
    NOT_STEADY = (
        "What was measured still changed, or is known too badly to tell: skip more of the start, or go on for longer."
    )
    NEAR_RESONANCE = (
        "The stress is led by inertia: the frequency is near or above that of a mode, and moduli are not those of a "
        "slow strain; lower the frequency."
    )
    WALLS_MET = (
        "Walls that move have met, or stand farther apart than the box is long, so that particles touch each other "
        "through them; the packing is the last one before that was seen: take a longer box, or slower walls."
    )
    TOO_MANY_TOUCHES = (
        "A sphere touched a rough surface of triangles at more places than it has springs for; the packing is the last "
        "one before that was seen: take a surface with fewer facets around its tip, or a smooth one."
    )
    INTERRUPTED = "Stopped by Ctrl-C or a signal; the packing is the last one that was finished."

    @property
    def ok(self) -> bool:
        """Whether the answer may be used without a further look."""
        return self in (Outcome.CONVERGED, Outcome.ROUNDING_FLOOR, Outcome.UNJAMMED, Outcome.FINISHED)


@dataclass(frozen=True)
class Condition:
    """A figure that a run reached, beside the one that was asked for.

    Attributes
    ----------
    name
        What it is, in words.
    reached, asked
        The figures.
    tolerance
        Largest difference between them over the one asked for at which the condition is met [1]; None where the figure
        asked for is a bound.
    hint
        What to change so that it is met.
    lower
        Whether the bound is a lower one.

    Examples
    --------
    >>> print(Condition("pressure", 5e-4, 1e-4, tolerance=1e-6))
    pressure 0.0005 where 0.0001 was asked for
    >>> print(Condition("force residual", 2e-6, 1e-10), Condition("force residual", 2e-12, 1e-10).met)
    force residual 2e-06 where 1e-10 at most is allowed True

    """

    name: str
    reached: float
    asked: float
    tolerance: float | None = None
    hint: str = ""
    lower: bool = False

    @property
    def met(self) -> bool:
        """Whether it is met; what is not a number meets none."""
        if self.tolerance is None:
            return bool(self.reached >= self.asked if self.lower else self.reached <= self.asked)
        return bool(abs(self.reached - self.asked) <= self.tolerance * abs(self.asked))

    def __str__(self) -> str:
        digits = next((n for n in (4, 8) if f"{self.reached:.{n}g}" != f"{self.asked:.{n}g}"), 17)
        bound = " at least was asked for" if self.lower else " at most is allowed"
        asked = bound if self.tolerance is None else " was asked for"
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.name} {self.reached:.{digits}g} where {self.asked:.{digits}g}{asked}{hint}"


def unmet_conditions(outcome: Outcome, *conditions: Condition) -> tuple[Condition, ...]:
    """Return those of the conditions that a run which ended so does not meet; none where it is a success."""
    return () if outcome.ok else tuple(one for one in conditions if not one.met)


@dataclass(frozen=True)
class Stage:
    """One step of a protocol: what it achieved and what it cost.

    `residual` is the largest net force over the mean contact force [1] unless the note says otherwise; `seconds` is
    CPU time.
    """

    name: str
    residual: float
    steps: int = 0
    force_evaluations: int = 0
    seconds: float = 0.0
    note: str = ""


def stage_rows(stages: Iterable[Stage]) -> list[tuple[str, ...]]:
    """Return rows of step, residual, force evaluations, CPU seconds and note."""
    return [
        (
            stage.name,
            f"{stage.residual:.1e}" if stage.residual else "-",
            f"{stage.force_evaluations:,}" if stage.force_evaluations else "-",
            f"{stage.seconds:.3f}",
            stage.note,
        )
        for stage in stages
    ]


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown.

    Examples
    --------
    >>> print(markdown_table(("step", "CPU s"), [("verdict", "0.1")]), end="")
    | step | CPU s |
    |---|---|
    | verdict | 0.1 |

    """
    lines = [headings, *rows]
    text = ["| " + " | ".join(line) + " |\n" for line in lines]
    return text[0] + "|" + "---|" * len(headings) + "\n" + "".join(text[1:])


def csv_text(headings: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as comma-separated values; numbers keep every digit.

    Examples
    --------
    >>> print(csv_text(("step", "CPU s"), [("verdict", 0.1)]), end="")
    step,CPU s
    verdict,0.1

    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([headings, *rows])
    return text.getvalue()


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the rows as lines, their columns below each other."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows else []
    return ["  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def particles_in_words(packing: Packing) -> str:
    """Return how many discs or spheres, ellipses or spheroids, or rigid bodies there are, in words."""
    one, many = packing.shapes.names
    return f"{packing.particles} {one if packing.particles == 1 else many}"


@dataclass(frozen=True)
class Summary:
    """The results of a run or an examined packing, in words.

    Attributes
    ----------
    title
        What it is of.
    rows
        Name, value, and what the value is or its unit.
    stages
        What each step achieved and cost.

    """

    title: str
    rows: tuple[Row, ...]
    stages: tuple[Stage, ...]

    def __str__(self) -> str:
        steps = _aligned([STAGE_HEADINGS, *stage_rows(self.stages)])
        lines = [self.title, *(f"  {line}" for line in [*_aligned(self.rows), "", *steps])]
        return without_negative_zeros("\n".join(lines))

    def markdown(self, title: str | None = None) -> str:
        """Return the text that stands beside a recorded packing: narrow tables, what the values are below them."""
        results = markdown_table((self.title if title is None else title, ""), [row[:2] for row in self.rows])
        steps = markdown_table(STAGE_HEADINGS[:-1], [row[:-1] for row in stage_rows(self.stages)])
        said: dict[str, list[str]] = {}
        name = ""
        for row in self.rows:
            # further rows of a tensor have no name, and say more of it
            name = row[0] or name
            said.setdefault(name, []).extend(filter(None, row[2:]))
        notes = "".join(f"- **{name}**: {'; '.join(found)}\n" for name, found in said.items() if found)
        return without_negative_zeros(f"{results}\n{steps}\n{notes}")


@runtime_checkable
class HasSummary(Protocol):
    """Something that says what it reached, in words and by name."""

    def summary(self) -> Summary:
        """Return what was reached, in words."""

    def to_dict(self) -> dict[str, Any]:
        """Return what was reached by name, as plain values."""


@shown(lambda one: f"{len(one)} observables at {len(one.step_t)} steps")
@dataclass(frozen=True, eq=False)
class Trace:
    """Observables against step, kept at the steps that the caller asked for.

    ``trace["energy"]`` and ``trace.energy_t`` are the same; observables that were added by `pm.observable` are there by
    their names. ``for name in trace``, ``name in trace`` and ``dict(trace)`` go through all that were kept.

    Attributes
    ----------
    step_t
        (T,) step numbers.
    energy_t
        (T,) energies [energy].
    pressure_t
        (T,) pressures [energy/length^d].
    contacts_t
        (T,) numbers of contacts.
    max_force_t
        (T,) largest net forces on a particle [force].
    position_tnd, lattice_tdd
        (T, N, d) positions and (T, d, d) lattice vectors [length], or None when they were not asked for.
    orientation_tnq
        (T, N, d) directors of particles with shapes, kept with the positions; None without shapes.
    added
        (T, ...) arrays of the observables that were added, by name.

    """

    step_t: NDArray[np.int64]
    energy_t: NDArray[np.float64]
    pressure_t: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    max_force_t: NDArray[np.float64]
    position_tnd: NDArray[np.float64] | None = None
    lattice_tdd: NDArray[np.float64] | None = None
    orientation_tnq: NDArray[np.float64] | None = None
    added: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @classmethod
    def of_rows(cls, rows: Sequence[Mapping[str, Any]], **further: Any) -> Self:
        """Return the trace of rows of observables by name; `further` are its other fields."""
        columns = columns_of(rows)
        own = {name.rpartition("_")[0]: name for name in (one.name for one in fields(cls))}
        added = {name: column for name, column in columns.items() if name not in own}
        return cls(**{own[name]: columns[name] for name in columns if name in own}, **further, added=added)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the observables that were kept, by name."""
        return columns_in(self, [one.name for one in fields(self)]) | dict(self.added)

    def keys(self) -> KeysView[str]:
        """Return the names of the observables that were kept."""
        return self.columns().keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns())

    def __len__(self) -> int:
        return len(self.columns())

    def __contains__(self, name: object) -> bool:
        return name in self.columns()

    def __getitem__(self, name: str) -> NDArray[Any]:
        found = self.columns()
        if name not in found:
            raise KeyError(f"name must be one of {', '.join(found)}, got {brief(name)}")
        return found[name]

    def table(self, about: Mapping[str, Any] | None = None) -> Table:
        """Return every observable as columns, with what the run says of itself."""
        if about is not None:
            table("about", about)
        found = self.columns()
        tensor = next((value for value in found.values() if value.ndim == 3), None)
        own = {"kind": type(self).__name__, "dimension": None if tensor is None else tensor.shape[1]}
        return make_table(found, own if about is None else about)


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A packing that a minimizer, an integrator or a protocol arrived at, what it achieved and what it cost.

    Attributes
    ----------
    packing
        The packing at the end.
    outcome
        How the run ended.
    residual
        Largest net force on a particle over the mean contact force [1]; 0 when nothing touches. Of a flow (`flows`) it
        is not expected to vanish.
    steps, force_evaluations
        Counts over the whole run.
    seconds, build_seconds
        CPU seconds of the run, and of building (and, the first time, compiling) its program.
    stages
        The parts of a protocol, in order.
    trace
        Quantities against step, when asked for.
    report
        Further named results of a protocol (numbers, texts, arrays).
    unmet
        What was asked for and not reached, with both figures; empty where the run is a success.

    """

    packing: Packing
    outcome: Outcome
    residual: float
    steps: int
    force_evaluations: int
    seconds: float
    build_seconds: float = 0.0
    stages: tuple[Stage, ...] = ()
    trace: Trace | None = None
    report: Mapping[str, Any] = field(default_factory=dict)
    unmet: tuple[Condition, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the outcome is a success."""
        return self.outcome.ok

    @property
    def flows(self) -> bool:
        """Whether the run is a flow, in which forces accelerate particles and are not expected to balance."""
        return False

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return particles_in_words(self.packing)

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached and what it cost by name, as plain values; `report` with it."""
        reported = {"redundant_patches" if name == "patches" else name: value for name, value in self.report.items()}
        return {
            "particles": self.packing.particles,
            "dimension": self.packing.dimension,
            "outcome": self.outcome.name.lower(),
            **({"unmet": "; ".join(map(str, self.unmet))} if self.unmet else {}),
            "force_residual": self.residual,
            "steps": self.steps,
            "force_evaluations": self.force_evaluations,
            "seconds": self.seconds,
            "build_seconds": self.build_seconds,
            **{name: _plain(value) for name, value in reported.items()},
        }

    def outcome_rows(self) -> list[Row]:
        """Return how the run ended, each condition that it does not meet, and whether its energy is accounted for."""
        ended = ("outcome", self.outcome.name.lower().replace("_", " "), self.outcome.value)
        ledger = getattr(self, "ledger", None)
        return [
            ended,
            *(("not met", one.name, str(one)) for one in self.unmet),
            *(() if ledger is None else (ledger.row(),)),
        ]

    def _residual_rows(self) -> list[Row]:
        """Return how well forces balance; of a flow, whose forces do not, nothing."""
        balance = ("force residual", f"{self.residual:.1e}", "largest net force / mean contact force")
        return [] if self.flows else [balance]

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        reported = {
            name: value
            for name, value in self.report.items()
            if isinstance(value, bool | int | float | str) and name != "particles"
        }
        return [
            *self.outcome_rows(),
            *self._residual_rows(),
            *(
                (
                    name.replace("_", " "),
                    f"{value:.8g}" if isinstance(value, float) else str(value),
                    _REPORT_NOTES.get(name, "").format(d=self.packing.dimension),
                )
                for name, value in reported.items()
            ),
            *([onset_row(*self.report["onset_between"])] if "onset_between" in self.report else []),
        ]

    def summary(self) -> Summary:
        """Return what the run reached and what each step cost, in words; printed, it is a table."""
        whole = Stage("run", self.residual, self.steps, self.force_evaluations, self.seconds, self.outcome.name.lower())
        *before, last = self.stages or (whole,)
        if self.flows:
            last = replace(last, note="; ".join(filter(None, (last.note, _OF_A_FLOW))))
        return Summary(self.title, tuple(self.rows()), (*before, last))

    def __repr__(self) -> str:
        return as_text(type(self).__name__, self._headline(), self._shown_rows(), "all of it: print(run.summary()); ")

    def _repr_html_(self) -> str:
        return as_html(type(self).__name__, self._headline(), self._shown_rows(), self)

    def _headline(self) -> str:
        """Return how the run ended and what it cost, in one line."""
        ended = self.outcome.name.lower().replace("_", " ")
        balance = "" if self.flows else f"residual {self.residual:.1e}, "
        return f"{self.title}: {ended}, {balance}{self.steps} steps, {self.seconds:.3g} CPU s"

    def _shown_rows(self) -> list[Row]:
        """Return the rows of `rows` that the headline does not say; what to change comes first where it failed."""
        rows = [one for one in self.rows() if one[0] not in ("outcome", "force residual")]
        failed = [] if self.ok else [("not a success", self.outcome.value, "")]
        return [*failed, *rows]

    def about(self) -> dict[str, Any]:
        """Return what a table of this run says of it."""
        return {
            "kind": type(self).__name__,
            "dimension": self.packing.dimension,
            "outcome": self.outcome.name.lower(),
            "steps": self.steps,
        }

    def table(self) -> Table:
        """Return every observable that the run kept, as columns.

        Raises
        ------
        ValueError
            If it kept nothing.

        """
        if self.trace is None:
            raise ValueError("subject must be a run with a trace (trace_every=...), got one without")
        return self.trace.table(self.about())


def onset_row(low: float, high: float) -> Row:
    """Return the row that tells both sides of the onset apart, with the digits that this takes."""
    return "onset between", f"{low:.10f}, {high:.10f}", "packing fractions without overlaps and under pressure"


def _plain(value: Any) -> Any:
    """Return arrays and tuples as lists, and other things that JSON does not know as their text."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


@dataclass(frozen=True)
class Solve:
    """What a solver achieved and what it cost.

    `residual` and `gap` are relative (the solver's own scaling is said where it is used); `seconds` is CPU time.
    """

    outcome: Outcome
    residual: float
    gap: float = 0.0
    iterations: int = 0
    seconds: float = 0.0
    status: str = ""


class NotConverged(RuntimeError):  # noqa: N818 - the outcome is a value first and an error second
    """Raised when a run did not reach what was asked for; `.run` holds what it did reach.

    Where it was one of several, as of the rates of a flow curve, `.finished` holds what came of those before, or None.
    """

    def __init__(self, run: Run, message: str = "") -> None:
        self.run = run
        self.finished: Any = None
        unmet = f" Not met: {'; '.join(map(str, run.unmet))}." if run.unmet else ""
        reached = f"({'' if run.flows else f'residual {run.residual:.3g} '}after {run.steps} steps)"
        super().__init__(message or f"{run.outcome.value}{unmet} {reached}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.run, str(self)), {"finished": self.finished}
