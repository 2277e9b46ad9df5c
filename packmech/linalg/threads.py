"""How many threads a sparse factorization may take.

The library that factors large matrices gives the same bits for any number of threads, so that the number is no part of
what is asked for: a call sets it for all that it factors.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_THREADS = ContextVar("threads", default=1)


@contextmanager
def factor_threads(threads: int) -> Iterator[None]:
    """Let sparse factorizations take so many threads.

    Examples
    --------
    >>> with factor_threads(2):
    ...     allowed_threads()
    2

    """
    before = _THREADS.set(threads)
    try:
        yield
    finally:
        _THREADS.reset(before)


def allowed_threads() -> int:
    """Return how many threads a sparse factorization may take: one unless `factor_threads` allows more."""
    return _THREADS.get()
