"""What every minimization method is, the state between two chunks of its steps, and what a program answers."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from packmech.outcome import Outcome

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


class Evaluation(NamedTuple):
    """Energy and forces of a scene at given positions.

    energy [energy]; pressure [energy/length^d]; stress_dd, Cauchy, tension positive; contacts touching pairs;
    max_force the largest net force on a particle and mean_force the mean contact force [force]; residual their ratio,
    0 when nothing touches; force_nd (N, d) net forces; force_floor the net force that rounding of positions alone can
    cause [force]; deepest_overlap the largest relative overlap [1].
    """

    energy: float
    pressure: float
    stress_dd: NDArray[np.float64]
    contacts: int
    max_force: float
    mean_force: float
    residual: float
    force_nd: NDArray[np.float64]
    force_floor: float
    deepest_overlap: float


class Relaxation(NamedTuple):
    """What a minimization of arrays arrived at: the positions in the caller's order, and figures as in Evaluation."""

    position_nd: NDArray[np.float64]
    outcome: Outcome
    residual: float
    max_force: float
    mean_force: float
    energy: float
    pressure: float
    contacts: int
    steps: int
    force_evaluations: int
