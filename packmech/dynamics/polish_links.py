"""Newton's method for the last digits of a packing with links, in its box."""

from __future__ import annotations

from typing import Any

import numpy as np

from packmech.dynamics.descend import descend
from packmech.dynamics.polished import Polished
from packmech.dynamics.soft_network import Units, length_unit
from packmech.dynamics.soft_newton import judge
from packmech.outcome import Outcome
from packmech.packing import Packing


def polish_linked(packing: Packing, effects: tuple[Any, ...], *, force_tolerance: float, step_limit: int) -> Polished:
    """Return the packing with links after Newton steps in its box; `outcome` tells a failure to converge.

    Parameters
    ----------
    packing, effects, force_tolerance, step_limit
        As in `polish`.

    """
    units = Units(effects, length_unit(packing), 1.0)
    none = np.zeros((0, packing.dimension, packing.dimension))
    state = descend(units.reduced(packing), units, none, None, iterations=step_limit)
    outcome = judge(state, force_tolerance)
    if outcome is Outcome.STALLED and state.iterations == step_limit:
        outcome = Outcome.STEP_LIMIT
    mean = state.mean_force / units.length
    if not mean > 0.0:
        outcome = Outcome.UNJAMMED
    residual = state.residual if mean > 0.0 else 0.0
    final = units.restored(state.packing, packing)
    return Polished(
        final, outcome, residual, residual * mean, mean, state.iterations, state.evaluations, 0, state.negative
    )  # fmt: skip
