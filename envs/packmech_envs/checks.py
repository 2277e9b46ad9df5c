"""Checks of options: every wrong one gets an error that names it, what is required and what came."""

from __future__ import annotations

from dataclasses import Field, fields, replace
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np


class _Record(Protocol):
    """What `dataclasses.replace` takes."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


Task = TypeVar("Task", bound=_Record)


def task_of(kind: type[Task], task: Any, options: dict[str, Any]) -> Task:
    """Return the task of an environment: the one given, or the default one, with these options changed.

    Parameters
    ----------
    kind
        QuenchTask or ShearTask.
    task
        A record of that kind; None: the one with all defaults.
    options
        Fields of the record by name, as an environment gets them as keywords.

    Raises
    ------
    TypeError
        For another kind of task, or an option that there is not.

    Examples
    --------
    >>> from packmech_envs.quench import QuenchTask
    >>> task_of(QuenchTask, QuenchTask(relax=5), {"step_budget": 10}).relax
    5

    """
    names = [field.name for field in fields(kind)]
    for name in options:
        if name not in names:
            raise TypeError(f"{name!r} is no option of {kind.__name__}, which has {', '.join(names)}")
    if task is None:
        return kind(**options)
    if not isinstance(task, kind):
        raise TypeError(f"task must be a {kind.__name__}, got {task!r:.60}")
    return replace(task, **options)


def one_of(name: str, value: Any, allowed: tuple[str, ...]) -> None:
    """Check that a value is one of some names."""
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r:.60}")


def boolean(name: str, value: Any) -> None:
    """Check that a value is True or False."""
    if not isinstance(value, bool):
        raise TypeError(f"{name} must be True or False, got {value!r:.60}")


def real(name: str, value: Any, what: str = "a finite number") -> float:
    """Return a finite real number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be {what}, got {value!r:.60}")
    if not np.isfinite(value):
        raise ValueError(f"{name} must be {what}, got {value!r}")
    return float(value)


def positive(name: str, value: Any) -> float:
    """Return a positive finite number."""
    number = real(name, value, "a positive number")
    if number <= 0.0:
        raise ValueError(f"{name} must be a positive number, got {value!r}")
    return number


def count(name: str, value: Any, what: str = "an integer at least 1") -> int:
    """Return an integer of 1 or more."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be {what}, got {value!r:.60}")
    if value < 1:
        raise ValueError(f"{name} must be {what}, got {value}")
    return int(value)


def budget(name: str, value: Any) -> int | None:
    """Return an integer of 1 or more, or None."""
    return None if value is None else count(name, value, "None or an integer at least 1")
