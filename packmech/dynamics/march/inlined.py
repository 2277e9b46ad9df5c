"""Loops without reference counts, and helpers whose code is written into the loop that calls them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit, typeof
from numba.core.errors import NumbaError
from numba.extending import overload, register_jitable

from packmech.compiled import OPTIONS, _SourceCache, kernel

F = TypeVar("F", bound=Callable[..., Any])


def inlined(function: F) -> F:
    """Return a helper as `device` does, written into its callers however long it is.

    A call that passes all that a contact needs costs as much as the contact.
    """
    return register_jitable(**OPTIONS, forceinline=True)(function)  # type: ignore[no-any-return]


def inlined_form(target: Callable[..., Any]) -> Callable[[F], F]:
    """Return a decorator as `compiled_form` does, whose code is written into the callers.

    Records of arrays are handed to a function word by word: lists and state alone take longer than a hundred contacts.
    """

    def register(chooser: F) -> F:
        overload(target, jit_options={**OPTIONS, "forceinline": True}, strict=False)(chooser)
        return chooser

    return register


class _LeanCache(_SourceCache):
    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return ("without reference counts", *super()._index_key(sig, codegen))


def lean(function: Callable[..., Any]) -> Any:
    """Return a kernel that counts no references to arrays: every part of a record would be counted in every step.

    It must not make arrays and no helper that it calls may return one, not even one that it was given: helpers are
    compiled once, and a caller that does count would count it wrongly. Where the first argument brings a user's law
    that makes arrays, the counting kernel takes over. Kernels that count may call it too.
    """
    counting = kernel(function)
    dispatcher = njit(**OPTIONS, _nrt=False)(function)
    dispatcher._cache = _LeanCache(function)
    refused: set[Any] = set()

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        if not refused or typeof(arguments[0]) not in refused:
            try:
                return dispatcher(*arguments)
            except NumbaError:
                refused.add(typeof(arguments[0]))
        return counting(*arguments)

    overload(call, jit_options={**OPTIONS, "_nrt": False}, strict=False)(lambda *_: function)
    return call
