"""What accuracy costs in time: one problem, many settings of one knob, against a stated reference."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from packmech.calls.display import shown
from packmech.check import brief, clear_errors, entries, function, integer, listed, one_of, positive, real
from packmech.linalg.line import fit_line, windows_without_ends
from packmech.result import csv_text, markdown_table
from packmech.view.figures import COLORS, MARKERS, hollow_marker, label_settings, styled_figure


@dataclass(frozen=True)
class OrderFit:
    """error = prefactor * setting**order, down to a floor; floor is 0 where none was reached.

    `order_error` is how far the order moves when settings above the floor are left out at either end, half of them at
    the most; nan where only two are above it.
    """

    order: float
    prefactor: float
    floor: float
    order_error: float = math.nan


@shown()
@dataclass(frozen=True)
class WorkPrecision:
    """Trials of every method at every setting, failures included, and the questions that they answer."""

    trials: tuple[Trial, ...]
    first_seconds: Mapping[str, float]
    knob: str = "setting"
    title: str = ""
    reference_is: str = ""

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods, in the order in which they ran."""
        return tuple(self.first_seconds)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities whose errors were measured."""
        return tuple(dict.fromkeys(name for trial in self.trials for name in trial.errors))

    def of(self, method: str | None = None) -> tuple[Trial, ...]:
        """Trials of one method, of the only one unless named, from the coarsest setting (the largest) to the finest."""
        if method is None and len(self.first_seconds) == 1:
            method = self.methods[0]
        chosen = one_of("method", method, self.methods)
        return tuple(sorted((t for t in self.trials if t.method == chosen), key=lambda trial: -trial.setting))

    def fit(self, method: str | None = None, *, quantity: str | None = None) -> OrderFit:
        """Power law and floor fitted to one method's errors; failed trials are left out.

        Raises
        ------
        ValueError
            For an unknown method or quantity, or fewer than two trials with an error above zero.
        """
        name = self._quantity(quantity)
        point_td = [
            (trial.setting, trial.errors[name])
            for trial in self.of(method)
            if not trial.failed and name in trial.errors
        ]
        return fit_power_law([setting for setting, _ in point_td], [error for _, error in point_td])

    def order(self, method: str | None = None, *, quantity: str | None = None) -> float:
        """Order of convergence: the exponent p of error ~ setting**p above the floor."""
        return self.fit(method, quantity=quantity).order

    def floor(self, method: str | None = None, *, quantity: str | None = None) -> float:
        """Error below which finer settings do not help; 0 where the trials did not reach one."""
        return self.fit(method, quantity=quantity).floor

    def cheapest(self, *, error_below: float | Mapping[str, float], quantity: str | None = None) -> Trial | None:
        """Return the quickest trial that did not fail and whose errors are below the bound; None when there is none.

        The next finer setting of its method must be below the bound as well: an error may be small by chance.

        Parameters
        ----------
        error_below
            One bound for the errors of all quantities, or of `quantity` alone; or bounds by quantity, of those that
            matter.
        quantity
            The only one that the bound is for.

        """
        bounds: dict[str, float]
        if isinstance(error_below, Mapping):
            bounds = {self._quantity(name): bound for name, bound in error_below.items()}
        else:
            bounds = dict.fromkeys(self.quantities if quantity is None else [self._quantity(quantity)], error_below)
        for name, bound in bounds.items():
            bounds[name] = real(f"error_below of {name!r}", bound, above=0.0, infinite=True)
        good = []
        for method in self.methods:
            finer = True
            for trial in reversed(self.of(method)):
                below = all(trial.errors.get(name, math.inf) < bound for name, bound in bounds.items())
                if below and finer and not trial.failed:
                    good.append(trial)
                finer = below and not trial.failed
        return min(good, key=lambda trial: trial.seconds, default=None)

    def to_csv(self) -> str:
        """Return the table as comma-separated values, numbers with every digit."""
        work = tuple(dict.fromkeys(name for trial in self.trials for name in trial.work))
        headings = ("method", self.knob, *map(error_heading, self.quantities), "cpu seconds", *work)
        rows = []
        for trial in self.trials:
            errors = (trial.errors.get(name, "") for name in self.quantities)
            counts = (trial.work.get(name, "") for name in work)
            rows.append((trial.method, trial.setting, *errors, trial.seconds, *counts, trial.failed))
        return csv_text((*headings, "failed"), rows)

    def to_markdown(self) -> str:
        """Return the table as Markdown: short numbers, failures in words."""
        work = tuple(dict.fromkeys(name for trial in self.trials for name in trial.work))
        headings = ("method", self.knob, *map(error_heading, self.quantities), "CPU s", *work, "failed")
        rows = []
        for trial in self.trials:
            errors = [f"{trial.errors[name]:.1e}" if name in trial.errors else "-" for name in self.quantities]
            counts = [_short(trial.work[name]) if name in trial.work else "-" for name in work]
            rows.append((trial.method, f"{trial.setting:.3g}", *errors, f"{trial.seconds:.2g}", *counts, trial.failed))
        return markdown_table(headings, rows)

    def save_figure(self, path: str | Path) -> None:
        """Write a picture: for each quantity error against setting (left) and CPU seconds against error (right).

        Failed trials that still gave an answer are drawn hollow. The ending of path names the format (png, svg, pdf).

        Raises
        ------
        ImportError
            When matplotlib is not installed.
        """
        draw_work_precision(self, Path(path))

    def _quantity(self, quantity: str | None) -> str:
        names = self.quantities
        if quantity is None:
            return names[0] if names else "error"
        return one_of("quantity", quantity, names)


def fit_power_law(setting_t: list[float], error_t: list[float]) -> OrderFit:
    """Power law that the errors follow down to a floor.

    Least squares in the logarithms of C h^p for the coarse settings and of a constant for the fine ones, for every
    place of the bend; the best fit stays. A floor needs two settings at least, the power law two (three where there
    are three or more), so exact data without a floor are fitted without one. Errors that fall with an exponent of more
    than a quarter of the order are no floor: finer settings still help there. Errors of exactly zero are under any
    floor and left out.

    Examples
    --------
    >>> fit = fit_power_law([1e-1, 1e-2, 1e-3, 1e-4, 1e-5], [2e-2, 2e-4, 2e-6, 3e-7, 3e-7])
    >>> print(f"{fit.order:.2f} {fit.floor:.0e}")
    2.00 3e-07
    """
    point_td = sorted(((h, e) for h, e in zip(setting_t, error_t, strict=True) if e > 0.0), reverse=True)
    if len(point_td) < 2:
        raise ValueError(f"an order must be fitted to at least two errors above zero, got {len(point_td)}")
    log_h_t, log_e_t = np.log(np.array(point_td).T)
    count = len(point_td)
    best: tuple[float, OrderFit] | None = None
    for bend in range(min(3, count), count + 1):
        if count - bend == 1:
            continue
        line = fit_line(log_h_t[:bend], log_e_t[:bend])
        residual = float(np.sum((line.slope * log_h_t[:bend] + line.height - log_e_t[:bend]) ** 2))
        floor = 0.0
        if bend < count:
            if fit_line(log_h_t[bend:], log_e_t[bend:]).slope > _STILL_FALLING * line.slope:
                continue
            level = float(np.mean(log_e_t[bend:]))
            residual += float(np.sum((log_e_t[bend:] - level) ** 2))
            floor = math.exp(level)
        if best is None or residual < best[0] * (1.0 - 1e-9) - 1e-24:
            slopes = [fit_line(log_h_t[part], log_e_t[part]).slope for part in windows_without_ends(bend, 2)]
            moved = max((abs(one - line.slope) for one in slopes), default=math.nan)
            best = (residual, OrderFit(line.slope, math.exp(line.height), floor, moved))
    assert best is not None
    return best[1]


# part of the order above which errors still fall and are no floor
_STILL_FALLING = 0.25


def error_heading(quantity: str) -> str:
    """Return the heading of a column of errors; that of a value without a name is "error"."""
    return quantity if quantity == "error" else f"error in {quantity}"


def _short(value: float) -> str:
    """Return whole numbers as they are, others with three digits."""
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"


__all__ = ["Answer", "OrderFit", "Trial", "WorkPrecision", "fit_power_law", "work_precision"]

Solver = Callable[[float], Any]
ErrorMeasure = Callable[[Any, Any], float | Mapping[str, float]]
Quantities = Mapping[str, npt.ArrayLike]


@dataclass(frozen=True)
class Answer:
    """One solver's answer: the value to compare, whether the solver vouches for it, and what it cost besides time.

    value is a number, an array, or a mapping of names to them (one error is then kept for each name). A problem may
    return the bare value instead, which counts as converged. work holds counts such as force evaluations.
    """

    value: Any
    converged: bool = True
    work: Mapping[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Trial:
    """One method at one setting: its errors by quantity, its cost, and why it failed where it did.

    seconds is the median over the repeats, the method's first call not among them. failed is empty for a trial that
    counts; errors may still hold figures when the solver gave an answer without vouching for it.
    """

    method: str
    setting: float
    errors: Mapping[str, float]
    seconds: float
    work: Mapping[str, float] = field(default_factory=dict)
    failed: str = ""
    note: str = ""

    @property
    def error(self) -> float:
        """The error of the first quantity; NaN when nothing was answered."""
        return next(iter(self.errors.values()), math.nan)


@clear_errors
def work_precision(
    problem: Solver | Mapping[str, Solver],
    settings: Sequence[float],
    reference: Any,
    *,
    error: ErrorMeasure | None = None,
    knob: str = "setting",
    title: str = "",
    reference_is: str = "",
    repeats: int = 3,
    failures: tuple[type[Exception], ...] = (ArithmeticError, RuntimeError, np.linalg.LinAlgError),
    clock: Callable[[], float] = time.process_time,
    progress: Callable[[str, float], None] | None = None,
) -> WorkPrecision:
    """Table of what each method costs and how far it is from the reference at each setting.

    Parameters
    ----------
    problem
        A function of the setting, or several by method name. It returns a value like `reference`, or an `Answer`.
    settings
        Values of the knob, all positive and different; the first one also serves as the first call.
    reference
        The true value: a closed form, else a tighter run of another method, else a tighter run of the same.
    error
        Measure (value, reference) -> number or {quantity: number}; by default the largest absolute difference, per
        quantity when the reference is a mapping.
    knob, title, reference_is
        Words for the table: what the setting is, what the study is, what the reference is.
    repeats
        Timed calls at each setting (the median is kept). The first call of each method, which may compile or fill
        caches, is timed apart in `first_seconds` and never counted.
    failures
        Exceptions that are kept in the table as failed trials; any other exception is a mistake and goes through.
    clock
        Seconds; CPU time of the process by default.
    progress
        Called with (method, setting) before each trial.

    Raises
    ------
    ValueError
        For no method, fewer than one setting, settings that are not finite, positive and different, repeats < 1.

    Examples
    --------
    The midpoint rule for the integral of exp over (0, 1), whose error falls with the square of the step:

    >>> import numpy as np
    >>> def midpoint(step):
    ...     points = round(1 / step)
    ...     return np.exp((np.arange(points) + 0.5) / points).mean()
    >>> table = work_precision({"midpoint": midpoint}, (0.1, 0.05, 0.025), np.e - 1, knob="step")
    >>> print(f"{table.order('midpoint'):.2f}")
    2.00
    >>> table.cheapest(error_below=1e-4) is None or table.cheapest(error_below=1e-4).error < 1e-4
    True
    """
    solvers = dict(problem) if isinstance(problem, Mapping) else {"": problem}
    _check_methods(solvers)
    setting_t = _checked_settings(settings)
    repeats = integer("repeats", repeats, at_least=1, bytes_each=8.0)
    for name, value in (("error", error), ("progress", progress)):
        if value is not None:
            function(name, value)
    function("clock", clock)
    measure = largest_difference if error is None else error
    trials: list[Trial] = []
    first_seconds: dict[str, float] = {}
    for method, solver in solvers.items():
        began = clock()
        _attempt(solver, setting_t[0], failures)
        first_seconds[method] = clock() - began
        for setting in setting_t:
            if progress is not None:
                progress(method, setting)
            trials.append(_trial(method, solver, setting, reference, measure, repeats, failures, clock))
    return WorkPrecision(
        trials=tuple(trials), first_seconds=first_seconds, knob=knob, title=title, reference_is=reference_is
    )


def largest_difference(value: Any, reference: Any) -> float | dict[str, float]:
    """Largest absolute difference between a value and the reference; per name when the reference is a mapping.

    Raises
    ------
    ValueError
        When the value lacks a name of the reference or has another shape.

    Examples
    --------
    >>> largest_difference([1.0, 2.5], [1.0, 2.0])
    0.5
    """
    if isinstance(reference, Mapping):
        missing = [name for name in reference if not isinstance(value, Mapping) or name not in value]
        if missing:
            raise ValueError(f"value must have every quantity of the reference, got none for {missing[0]!r}")
        return {name: _difference(value[name], reference[name]) for name in reference}
    return _difference(value, reference)


def _difference(value: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    value_array, reference_array = (
        entries(name, one, "biuf", "numbers").astype(np.float64)
        for name, one in (("value", value), ("reference", reference))
    )
    if value_array.shape != reference_array.shape:
        raise ValueError(f"value must have the reference's shape {reference_array.shape}, got {value_array.shape}")
    return float(np.max(np.abs(value_array - reference_array), initial=0.0))


def _check_methods(solvers: Mapping[str, Solver]) -> None:
    if not solvers:
        raise ValueError("problem must have at least one method, got none")
    for method, solver in solvers.items():
        if not callable(solver):
            raise TypeError(f"problem must be a function of the setting, got {brief(solver)} for method {method!r}")


def _checked_settings(settings: Sequence[float]) -> tuple[float, ...]:
    given = listed("settings", settings, "positive numbers")
    setting_t = tuple(positive(f"settings[{k}]", setting) for k, setting in enumerate(given))
    if not setting_t:
        raise ValueError("settings must have at least one value, got none")
    if len(set(setting_t)) < len(setting_t):
        raise ValueError(f"settings must be different from one another, got {brief(setting_t)}")
    return setting_t


def _attempt(solver: Solver, setting: float, failures: tuple[type[Exception], ...]) -> tuple[Answer | None, str]:
    """Answer, or None with the reason of the failure."""
    try:
        value = solver(setting)
    except failures as failure:
        first_line = str(failure).partition("\n")[0]
        return None, f"{type(failure).__name__}: {first_line}" if first_line else type(failure).__name__
    return (value if isinstance(value, Answer) else Answer(value)), ""


def _trial(
    method: str,
    solver: Solver,
    setting: float,
    reference: Any,
    measure: ErrorMeasure,
    repeats: int,
    failures: tuple[type[Exception], ...],
    clock: Callable[[], float],
) -> Trial:
    seconds: list[float] = []
    answer: Answer | None = None
    failed = ""
    for _ in range(repeats):
        began = clock()
        answer, failed = _attempt(solver, setting, failures)
        seconds.append(clock() - began)
        if answer is None:
            break
    cost = statistics.median(seconds)
    if answer is None:
        return Trial(method, setting, {}, cost, failed=failed)
    measured = measure(answer.value, reference)
    errors = dict(measured) if isinstance(measured, Mapping) else {"error": float(measured)}
    if not answer.converged:
        failed = answer.note or "did not converge"
    elif not all(math.isfinite(value) for value in errors.values()):
        failed = "the answer is not finite"
    return Trial(method, setting, errors, cost, dict(answer.work), failed, answer.note)


def draw_work_precision(table: WorkPrecision, path: Path) -> None:
    """Write the figure: one column for each quantity; above error against setting, below seconds against error."""
    # what is undefined throughout has no place on axes of logarithms
    quantities = [
        name
        for name in table.quantities
        if any(math.isfinite(trial.errors.get(name, math.nan)) for trial in table.trials)
    ]
    if not quantities:
        raise ValueError("table must have at least one measured error to be drawn, got none")
    width = max(3.9 * len(quantities) + 0.4, 7.2)
    with styled_figure(path, (width, 6.6)) as figure:
        ax_rows = figure.subplots(2, len(quantities), squeeze=False)
        for column, quantity in enumerate(quantities):
            above, below = ax_rows[0][column], ax_rows[1][column]
            zero = _zero_level(table, quantity)
            for index, method in enumerate(table.methods):
                _draw_method(table, method, quantity, zero, COLORS[index % 8], MARKERS[index % 8], above, below)
            above.set(title=quantity, xlabel=table.knob, ylabel=f"error in {quantity}", xscale="log", yscale="log")
            settings = sorted({trial.setting for trial in table.trials})
            if settings[-1] < 100.0 * settings[0]:
                # less than two decades: powers of ten say too little, and numbers between them overlap
                label_settings(above, settings)
            above.invert_xaxis()
            below.set(xlabel=f"error in {quantity}", ylabel="CPU seconds", xscale="log", yscale="log")
            below.invert_xaxis()
            if any(trial.errors.get(quantity) == 0.0 for trial in table.trials):
                above.axhline(zero, color="#999999", linewidth=0.8, linestyle=":")
                above.annotate("exactly 0", (0.01, zero), xycoords=("axes fraction", "data"), va="top", fontsize=7.5)
                above.set_ylim(bottom=0.1 * zero)
                below.axvline(zero, color="#999999", linewidth=0.8, linestyle=":")
                below.annotate(
                    "exactly 0", (zero, 0.02), xycoords=("data", "axes fraction"), rotation=90, ha="right", fontsize=7.5
                )
        handles, labels = ax_rows[0][0].get_legend_handles_labels()
        if any(trial.failed and trial.errors for trial in table.trials):
            handles.append(hollow_marker())
            labels.append("hollow: failed")
        # a letter takes about 0.075 inches, a line and the space around it half an inch
        fitting = int(width / (0.5 + 0.075 * max((len(label) for label in labels), default=1)))
        figure.legend(handles, labels, loc="outside lower center", ncols=max(1, min(len(labels), 4, fitting)))
        heading = table.title or "work and precision"
        figure.suptitle(f"{heading}\nreference: {table.reference_is}" if table.reference_is else heading, fontsize=10)


def _zero_level(table: WorkPrecision, quantity: str) -> float:
    """Where exact zeros are drawn on a logarithmic axis: a decade under the smallest error."""
    positive = [t.errors[quantity] for t in table.trials if t.errors.get(quantity, 0.0) > 0.0]
    return 0.1 * min(positive, default=1e-15)


def _draw_method(
    table: WorkPrecision, method: str, quantity: str, zero: float, color: str, marker: str, above: Any, below: Any
) -> None:
    trials = [trial for trial in table.of(method) if math.isfinite(trial.errors.get(quantity, math.nan))]
    good = [trial for trial in trials if not trial.failed]
    failed = [trial for trial in trials if trial.failed]
    common = {"color": color, "marker": marker, "markersize": 5.0, "linewidth": 1.2}
    for subset, extra in (
        (good, {"label": method or "method"}),
        (failed, {"markerfacecolor": "none", "linestyle": "none"}),
    ):
        errors = [max(trial.errors[quantity], zero) for trial in subset]
        style: dict[str, Any] = {**common, **extra}
        above.plot([trial.setting for trial in subset], errors, **style)
        below.plot(errors, [trial.seconds for trial in subset], **style)
