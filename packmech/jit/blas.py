"""Threads of the linear algebra libraries."""

from __future__ import annotations

import functools
import sys
from contextlib import AbstractContextManager
from typing import Any


def single_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS uses one thread, so that sums have the same bits on every machine.

    Examples
    --------
    >>> import numpy as np
    >>> with single_thread():
    ...     total = float(np.ones(4) @ np.ones(4))
    >>> total
    4.0

    """
    # finding the libraries takes a millisecond; only an import can add one
    return _libraries(len(sys.modules)).limit(limits=1)  # type: ignore[no-any-return]


@functools.lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
