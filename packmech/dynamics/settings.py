"""Checks that the calls of this room share: a minimizer's numbers, and how a run reports and ends.

Minimizers are NamedTuples, because compiled loops take them as they are; a NamedTuple does not check itself, so they
are checked where they are handed over, by one table of what each number may be.
"""

from __future__ import annotations

from typing import Any

from packmech.check import function, instance, integer, real

_BOUNDS: dict[str, dict[str, float]] = {
    "dt": {"above": 0.0},
    "dt_max": {"above": 0.0},
    "dt_min": {"at_least": 0.0},
    "delay": {"at_least": 0.0},
    "grow": {"at_least": 1.0},
    "shrink": {"above": 0.0, "at_most": 1.0},
    "mixing": {"at_least": 0.0, "at_most": 1.0},
    "mixing_decay": {"at_least": 0.0, "at_most": 1.0},
    "slope_ratio": {"above": 0.0, "below": 1.0},
    "damping": {"above": 0.0},
    "step": {"above": 0.0},
    "skin": {"above": 0.0},
    "largest_step": {"above": 0.0},
}
_COUNTS = ("memory",)


def check_minimizer(method: Any) -> None:
    """Check that the method is a minimizer and that each of its numbers is within its bounds.

    Raises
    ------
    TypeError, ValueError
        Naming `method`, or the field of it that is wrong.

    """
    fields = getattr(method, "_fields", None)
    if fields is None or isinstance(method, type) or not set(fields) <= {*_BOUNDS, *_COUNTS}:
        raise TypeError(f"method must be a minimizer such as Fire() or LBFGS(), got {method!r}")
    for name, value in zip(fields, method, strict=True):
        if name in _COUNTS:
            integer(f"method.{name}", value, at_least=1)
        else:
            real(f"method.{name}", value, **_BOUNDS[name])


def check_manner(progress: Any, check: Any) -> None:
    """Check that `progress` can be called, unless it is None, and that `check` is a truth value.

    Raises
    ------
    TypeError
        Naming the argument.

    """
    if progress is not None:
        function("progress", progress)
    instance("check", check, bool)
