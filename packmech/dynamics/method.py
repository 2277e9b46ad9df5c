"""What every minimization method is, and the state that it leaves between two chunks of steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from packmech.dynamics.kernels import Goal
    from packmech.dynamics.program import Program


class Progress(NamedTuple):
    """The state of a minimization between two chunks of steps: numbers, of which the first two count, and vectors."""

    number: NDArray[np.float64]
    vector_kf: NDArray[np.float64]

    @property
    def steps(self) -> int:
        """Steps so far."""
        return int(self.number[0])

    @property
    def force_evaluations(self) -> int:
        """Passes over the forces so far."""
        return int(self.number[1])


class Minimizer(Protocol):
    """What every minimization method is: a record of settings that starts a run on a program, and advances it."""

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        ...

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        ...
