# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator, import-untyped"
"""Several threads in one march: who walks which blocks, and how they wait for each other.

Every thread runs the same compiled loop without the interpreter's lock; between the parts of a step they meet at a
barrier. A march of one thread has no team (None), and no code of it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device

R = TypeVar("R")

# numbers a thread keeps to itself lie a cache line apart
_APART = 16
# turns of waiting before the processor is offered to others
_PATIENCE = 2000


class Team(NamedTuple):
    """One thread of several: its rank, their number, arrivals at the barrier, barriers passed, and what they tell."""

    rank: int
    size: int
    arrived: NDArray[np.int64]
    passed_t: NDArray[np.int64]
    told_t: NDArray[np.float64]


def make_teams(size: int) -> list[Team]:
    """Return the records of so many threads."""
    arrived = np.zeros(_APART, dtype=np.int64)
    passed = np.zeros(size * _APART, dtype=np.int64)
    told = np.zeros((size + 1) * _APART)
    return [Team(rank, size, arrived, passed, told) for rank in range(size)]


def together(run: Callable[[Team], R], size: int) -> R:
    """Return what the first of so many threads returns; each runs its own part.

    Parameters
    ----------
    run
        Called with the record of each thread; the threads meet inside.
    size
        Number of threads.

    """
    first, *others = make_teams(size)
    helpers = [threading.Thread(target=run, args=(team,)) for team in others]
    for helper in helpers:
        helper.start()
    try:
        return run(first)
    finally:
        for helper in helpers:
            helper.join()


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
def _offer(context: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), build


@device
def _wait(team):
    own = team.rank * _APART
    team.passed_t[own] += 1
    due = team.passed_t[own] * team.size
    _add(team.arrived, 1)
    turns = 0
    while _read(team.arrived) < due:
        turns += 1
        if turns > _PATIENCE:
            _offer()


def wait(team: Any) -> None:
    """Wait for the other threads."""
    raise NotImplementedError("threads meet in compiled loops")


@compiled_form(wait)
def _choose_wait(team: Any) -> Any:
    if isinstance(team, types.NoneType):
        return lambda team: None
    return lambda team: _wait(team)


def leads(team: Any) -> bool:
    """Whether this thread does what only one may do."""
    raise NotImplementedError("threads meet in compiled loops")


@compiled_form(leads)
def _choose_leads(team: Any) -> Any:
    if isinstance(team, types.NoneType):
        return lambda team: True
    return lambda team: team.rank == 0


def share(team: Any, blocks: int) -> tuple[int, int]:
    """Return the first of the blocks that this thread walks and the one after its last."""
    raise NotImplementedError("threads meet in compiled loops")


@compiled_form(share)
def _choose_share(team: Any, blocks: Any) -> Any:
    if isinstance(team, types.NoneType):
        return lambda team, blocks: (0, blocks)
    return lambda team, blocks: (team.rank * blocks // team.size, (team.rank + 1) * blocks // team.size)


@device
def _largest(team, value):
    team.told_t[team.rank * _APART] = value
    _wait(team)
    most = 0.0
    for t in range(team.size):
        told = team.told_t[t * _APART]
        # written so that what is not a number is the largest
        if not told <= most:
            most = told
    return most


def largest(team: Any, value: float) -> float:
    """Return the largest value of all threads; all of them are done with what came before."""
    raise NotImplementedError("threads meet in compiled loops")


@compiled_form(largest)
def _choose_largest(team: Any, value: Any) -> Any:
    if isinstance(team, types.NoneType):
        return lambda team, value: value
    return lambda team, value: _largest(team, value)


@device
def _told(team, value):
    if team.rank == 0:
        team.told_t[team.size * _APART] = 1.0 if value else 0.0
    _wait(team)
    return team.told_t[team.size * _APART] != 0.0


def told(team: Any, value: bool) -> bool:
    """Return the leader's answer; all threads see what it did."""
    raise NotImplementedError("threads meet in compiled loops")


@compiled_form(told)
def _choose_told(team: Any, value: Any) -> Any:
    if isinstance(team, types.NoneType):
        return lambda team, value: value
    return lambda team, value: _told(team, value)
