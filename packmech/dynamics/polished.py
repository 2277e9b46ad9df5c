"""What Newton's method made of a packing."""

from __future__ import annotations

from typing import NamedTuple

from packmech.outcome import Outcome
from packmech.packing import Packing


class Polished(NamedTuple):
    """What Newton's method made of a packing.

    `residual` is the largest net force over the mean contact force; `steps` counts the steps taken, `regularized`
    those of them whose Hessian had to be made definite, `negative` the unstable directions of the particles that are
    held, at the end.
    """

    packing: Packing
    outcome: Outcome
    residual: float
    max_force: float
    mean_force: float
    steps: int
    force_evaluations: int
    regularized: int
    negative: int
