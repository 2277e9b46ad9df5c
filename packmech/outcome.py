"""What an answer achieved and what it cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from packmech.packing import Packing


class Outcome(Enum):
    """How a run or a solve ended; the value is the sentence for the user."""

    CONVERGED = "The stated tolerance was met."
    ROUNDING_FLOOR = "Forces fell to the floor that double precision sets here; the tolerance asked for lies below it."
    UNJAMMED = "No particles touch any more: the energy is zero and there is nothing left to minimize."
    STEP_LIMIT = "The step limit was reached before the tolerance; raise step_limit or loosen the tolerance."
    STALLED = "No further progress is possible with this method; try another method or a looser tolerance."
    NOT_JAMMED = "The protocol ended without a jammed packing; start denser or change the protocol's parameters."
    UNSTABLE = "The energy has directions of negative curvature here: this is a saddle, not a minimum."
    INACCURATE = "The solver stopped short of its tolerance; see the residual and the gap."
    INFEASIBLE = "The program has no feasible point."
    DEGENERATE = "Links lose rank here: Newton's method converges only linearly and link forces are not determined."
    FINISHED = "The time that was asked for has been simulated."
    STEP_TOO_LONG = (
        "The time step is too long: links were lost or energy came from nowhere; the state is the last good one."
    )
    INTERRUPTED = "Stopped from outside; the packing is the last one that was finished."

    @property
    def ok(self) -> bool:
        """Whether the answer may be used without a further look."""
        return self in (Outcome.CONVERGED, Outcome.ROUNDING_FLOOR, Outcome.UNJAMMED, Outcome.FINISHED)


@dataclass(frozen=True)
class Stage:
    """One step of a protocol: what it achieved and what it cost.

    `residual` is the largest net force over the mean contact force [1] unless the note says otherwise; `seconds` is
    CPU time.
    """

    name: str
    residual: float
    steps: int = 0
    force_evaluations: int = 0
    seconds: float = 0.0
    note: str = ""


@dataclass(frozen=True, eq=False)
class Trace:
    """Quantities against step, kept at the steps that the caller asked for.

    Attributes
    ----------
    step_t, energy_t, pressure_t, contacts_t, max_force_t
        (T,) arrays: step number, energy [energy], pressure [energy/length^d], number of contacts, largest net
        force [force].
    position_tnd, lattice_tdd
        (T, N, d) positions and (T, d, d) lattice vectors [length], or None when they were not asked for.

    """

    step_t: NDArray[np.int64]
    energy_t: NDArray[np.float64]
    pressure_t: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    max_force_t: NDArray[np.float64]
    position_tnd: NDArray[np.float64] | None = None
    lattice_tdd: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """A packing that a minimizer, an integrator or a protocol arrived at, what it achieved and what it cost.

    Attributes
    ----------
    packing
        The packing at the end.
    outcome
        How the run ended.
    residual
        Largest net force on a particle over the mean contact force [1]; 0 when nothing touches.
    steps, force_evaluations
        Counts over the whole run.
    seconds, build_seconds
        CPU seconds of the run, and of building (and, the first time, compiling) its program.
    stages
        The parts of a protocol, in order.
    trace
        Quantities against step, when asked for.
    report
        Further named results of a protocol (numbers, texts, arrays).

    """

    packing: Packing
    outcome: Outcome
    residual: float
    steps: int
    force_evaluations: int
    seconds: float
    build_seconds: float = 0.0
    stages: tuple[Stage, ...] = ()
    trace: Trace | None = None
    report: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the outcome is a success."""
        return self.outcome.ok


@dataclass(frozen=True)
class Solve:
    """What a solver achieved and what it cost.

    `residual` and `gap` are relative (the solver's own scaling is said where it is used); `seconds` is CPU time.
    """

    outcome: Outcome
    residual: float
    gap: float = 0.0
    iterations: int = 0
    seconds: float = 0.0
    status: str = ""


class NotConverged(RuntimeError):  # noqa: N818 - the outcome is a value first and an error second
    """Raised when a run did not reach what was asked for; `.run` holds what it did reach."""

    def __init__(self, run: Run, message: str = "") -> None:
        self.run = run
        super().__init__(message or f"{run.outcome.value} (residual {run.residual:.3g} after {run.steps} steps)")
