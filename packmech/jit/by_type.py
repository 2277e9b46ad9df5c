"""Functions with a form for each class of record that they may be given first.

The class decides when code is compiled: a kernel calls such a function without a branch, and holds the one form that it
needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from packmech.jit.compiled import compiled_form


class _ByType:
    """The forms of one function by class."""

    def __init__(self, otherwise: Callable[..., Any]) -> None:
        self._otherwise, self._forms = otherwise, {}  # type: tuple[Callable[..., Any], dict[type, Callable[..., Any]]]

    def form_for(self, first: Any, *_: Any) -> Callable[..., Any]:
        """Return the form for a record, or for numba's type of one."""
        cls = type(None) if isinstance(first, types.NoneType) else getattr(first, "instance_class", type(first))
        return self._forms.get(cls, self._otherwise)

    def add(self, cls: type, form: Callable[..., Any]) -> None:
        """Take a form for one class."""
        self._forms[cls] = form


def by_type(otherwise: Callable[..., Any], forms: dict[type, Callable[..., Any]] | None = None) -> Any:
    """Return a function that runs the form of the class of its first argument, in compiled code and outside.

    `@function.form(cls)` adds a form; it must stand in the file of the class, or in one that every caller imports, so
    that compiled code on disk is made again where it changes.

    Parameters
    ----------
    otherwise
        The form for all classes that have none of their own, None among them.
    forms
        Forms by class.

    Examples
    --------
    >>> size = by_type(lambda one: 1, {tuple: len})
    >>> size(2.0), size((1, 2, 3))
    (1, 3)

    """
    table = _ByType(otherwise)
    for known, own in (forms or {}).items():
        table.add(known, own)

    def chosen(first: Any, *others: Any) -> Any:
        return table.form_for(first)(first, *others)

    def form(cls: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        def register(function: Callable[..., Any]) -> Callable[..., Any]:
            table.add(cls, function)
            return function

        return register

    compiled_form(chosen, inline=True)(table.form_for)
    chosen.form = form  # type: ignore[attr-defined]
    return chosen
