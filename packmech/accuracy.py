"""What accuracy costs in time: one problem, many settings of one knob, against a stated reference.

This module knows no physics. A setting is a time step, a tolerance, a gap level, a number of particles; a method is
whatever the caller puts behind a name.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from packmech.accuracy_table import WorkPrecision
from packmech.check import function, integer, positive

__all__ = ["Answer", "Trial", "WorkPrecision", "work_precision"]

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
    repeats = integer("repeats", repeats, at_least=1)
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
    value_array, reference_array = np.asarray(value, float), np.asarray(reference, float)
    if value_array.shape != reference_array.shape:
        raise ValueError(f"value must have the reference's shape {reference_array.shape}, got {value_array.shape}")
    return float(np.max(np.abs(value_array - reference_array), initial=0.0))


def _check_methods(solvers: Mapping[str, Solver]) -> None:
    if not solvers:
        raise ValueError("problem must have at least one method, got none")
    for method, solver in solvers.items():
        if not callable(solver):
            raise TypeError(f"problem must be a function of the setting, got {solver!r} for method {method!r}")


def _checked_settings(settings: Sequence[float]) -> tuple[float, ...]:
    if isinstance(settings, str) or not isinstance(settings, Iterable):
        raise TypeError(f"settings must be a sequence of positive numbers, got {settings!r}")
    setting_t = tuple(positive(f"settings[{k}]", setting) for k, setting in enumerate(settings))
    if not setting_t:
        raise ValueError("settings must have at least one value, got none")
    if len(set(setting_t)) < len(setting_t):
        raise ValueError(f"settings must be different from one another, got {setting_t}")
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
