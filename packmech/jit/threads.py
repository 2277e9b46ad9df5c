# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator, import-untyped"
"""Several threads in one loop of steps: which blocks each walks, and how they wait for each other.

Every thread runs the same compiled loop without the interpreter's lock; between the parts of a step they meet at a
barrier. One thread alone has no record (None), and no code of it: numba leaves out branches that None rules out.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from packmech.jit.compiled import device

R = TypeVar("R")

# numbers a thread keeps to itself lie a cache line apart
_APART = 16
# the arrivals where a thread failed, beyond all that are due: no other waits for it any more
_GAVE_UP = 1 << 62
# turns of waiting before the processor is offered to others
_PATIENCE = 50_000


class ThreadRecord(NamedTuple):
    """One thread of several: its rank, their number, arrivals at the barrier, barriers passed, and messages."""

    rank: int
    size: int
    arrived: NDArray[np.int64]
    passed_t: NDArray[np.int64]
    message_t: NDArray[np.float64]


def thread_records(size: int) -> list[ThreadRecord]:
    """Return the records of so many threads."""
    arrived = np.zeros(_APART, dtype=np.int64)
    passed = np.zeros(size * _APART, dtype=np.int64)
    message = np.zeros((size + 1) * _APART)
    return [ThreadRecord(rank, size, arrived, passed, message) for rank in range(size)]


def run_together(run: Callable[[ThreadRecord], R], size: int) -> R:
    """Return what the first of so many threads returns; each runs its own part.

    The error of one is raised once all are done: where they meet, none waits for one that failed.

    Parameters
    ----------
    run
        Called with the record of each thread; the threads meet inside.
    size
        Number of threads.

    """
    first, *others = thread_records(size)
    failures: list[BaseException] = []

    def run_or_give_up(thread: ThreadRecord) -> R | None:
        try:
            return run(thread)
        except BaseException as failure:
            failures.append(failure)
            thread.arrived[0] = _GAVE_UP
            return None

    helpers: list[threading.Thread] = []
    try:
        for thread in others:
            helper = threading.Thread(target=run_or_give_up, args=(thread,))
            helper.start()
            helpers.append(helper)
        result = run_or_give_up(first)
    finally:
        # without all of them those that were started would wait for ever
        if len(helpers) < len(others):
            first.arrived[0] = _GAVE_UP
        for helper in helpers:
            helper.join()
    if failures:
        raise failures[0]
    return cast(R, result)


@intrinsic
def _add(context: Any, array: Any, value: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", place, arguments[1], "seq_cst")

    return types.int64(types.Array(types.int64, 1, "C"), types.int64), build


@intrinsic
def _read(context: Any, array: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.load_atomic(place, "seq_cst", 8)

    return types.int64(types.Array(types.int64, 1, "C")), build


@intrinsic
def _yield_processor(context: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), build


@device
def wait(thread):
    """Wait for the other threads."""
    if thread is None:
        return
    own = thread.rank * _APART
    thread.passed_t[own] += 1
    due = thread.passed_t[own] * thread.size
    _add(thread.arrived, 1)
    turns = 0
    while _read(thread.arrived) < due:
        turns += 1
        if turns > _PATIENCE:
            _yield_processor()


@device
def some_failed(thread):
    """Whether a thread failed, so that the others did not wait for it and must end."""
    if thread is None:
        return False
    return _read(thread.arrived) >= _GAVE_UP


@device
def is_first(thread):
    """Whether this thread does what only one may do."""
    if thread is None:
        return True
    return thread.rank == 0


@device
def is_shared(thread):
    """Whether there are other threads."""
    if thread is None:
        return False
    return True


@device
def share(thread, blocks):
    """Return the first of the blocks that this thread walks and the one after its last."""
    if thread is None:
        return 0, blocks
    return thread.rank * blocks // thread.size, (thread.rank + 1) * blocks // thread.size


@device
def largest(thread, value):
    """Return the largest value of all threads; all of them are done with what came before."""
    if thread is None:
        return value
    thread.message_t[thread.rank * _APART] = value
    wait(thread)
    largest = 0.0
    for t in range(thread.size):
        sent = thread.message_t[t * _APART]
        # written so that what is not a number is the largest
        if not sent <= largest:
            largest = sent
    return largest


@device
def broadcast(thread, value):
    """Return the number of thread 0; all threads see what it did before."""
    if thread is None:
        return value
    if thread.rank == 0:
        thread.message_t[thread.size * _APART] = value
    wait(thread)
    return thread.message_t[thread.size * _APART]
