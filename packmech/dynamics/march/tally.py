# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Figures kept on the way, in the loop itself: every so many steps a row, nothing where none are asked for."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.compiled import compiled_form
from packmech.dynamics.march.look import COLUMNS, look_into


class Ledger(NamedTuple):
    """Rows of figures: a row every `every` steps, `written` (one number) of them written."""

    every: int
    row_tk: NDArray[np.float64]
    written: NDArray[np.int64]


def new_ledger(every: int, rows: int) -> Ledger:
    """Return a ledger with room for so many rows."""
    return Ledger(every, np.zeros((rows, COLUMNS)), np.zeros(1, dtype=np.int64))


def tally(
    ledger: Ledger | None,
    acting: Any,
    axes: Any,
    state: Any,
    space: Any,
    pairs: Any,
    track: Any,
    step: int,
    dt: float,
    pace: Any,
) -> None:
    """Write the figures of this step."""
    raise NotImplementedError("a march is stepped in compiled loops")


@compiled_form(tally)
def _choose_tally(
    ledger: Any,
    acting: Any,
    axes: Any,
    state: Any,
    space: Any,
    pairs: Any,
    track: Any,
    step: Any,
    dt: Any,
    pace: Any,
) -> Any:
    if isinstance(ledger, types.NoneType):
        return lambda ledger, acting, axes, state, space, pairs, track, step, dt, pace: None

    def keep(ledger, acting, axes, state, space, pairs, track, step, dt, pace):
        look_into(acting, axes, state, space, pairs, track, step * dt, pace, ledger.row_tk[ledger.written[0]])
        ledger.written[0] += 1

    return keep


def due_now(ledger: Ledger | None, step: int) -> bool:
    """Whether the figures of this step are to be kept."""
    raise NotImplementedError("a march is stepped in compiled loops")


@compiled_form(due_now)
def _choose_due_now(ledger: Any, step: Any) -> Any:
    if isinstance(ledger, types.NoneType):
        return lambda ledger, step: False
    return lambda ledger, step: step % ledger.every == 0 and ledger.written[0] < ledger.row_tk.shape[0]
