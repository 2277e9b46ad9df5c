"""Helpers whose code is written into the loop that calls them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba.extending import register_jitable

from packmech.compiled import OPTIONS

F = TypeVar("F", bound=Callable[..., Any])


def inlined(function: F) -> F:
    """Return a helper as `device` does, written into its callers however long it is.

    A call that passes all that a contact needs costs as much as the contact.
    """
    return register_jitable(**OPTIONS, forceinline=True)(function)  # type: ignore[no-any-return]
