"""The arguments that all strained runs share, and their checks."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.status import Progress
from packmech.check import FRAME_BYTES, boolean, brief, call_fault, instance, integer, positive
from packmech.dynamics.engine import refuse_misfits
from packmech.dynamics.integrators import Method, checked_method, choose_time_step, start_of_motion
from packmech.dynamics.observables import COLUMNS
from packmech.loop.checkpoint import RunsFile
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.result import NotConverged, Outcome, Run
from packmech.scene import Scene

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C")
# what a sample of a strained run takes
SAMPLE_BYTES = 8.0 * COLUMNS
R = TypeVar("R", bound=Run)


class Stepping(TypedDict, total=False):
    """Arguments of every call that steps a scene through time."""

    dt: float | None
    method: Method | None
    progress: Progress
    checkpoint: str | os.PathLike[str] | RunsFile | None


class AtRest(Stepping, total=False):
    """Arguments of a call that brings a scene to rest."""

    time_limit: float | None
    check: bool


class Several(Stepping, total=False):
    """Arguments of every call that strains a scene, those that make several runs among them."""

    held_n: ArrayLike | None
    frames: int
    ledger: bool
    time_limit: float | None


class Common(Several, total=False):
    """Arguments of the calls that make a single run."""

    velocity_nd: ArrayLike | None
    spin_nk: ArrayLike | None
    check: bool


KIND = "strained runs"
_DEFAULTS = {"frames": 0, "ledger": False, "check": True}


def listed(arguments: type) -> Callable[[F], F]:
    """Return a decorator that lists the arguments behind a function's ``**common`` in its signature, one by one.

    Other names are refused with a TypeError.

    Examples
    --------
    >>> @listed(Several)
    ... def strained(scene, **common): ...
    >>> list(inspect.signature(strained).parameters)
    ['scene', 'dt', 'method', 'progress', 'checkpoint', 'held_n', 'frames', 'ledger', 'time_limit']

    """
    keyword = inspect.Parameter.KEYWORD_ONLY
    hints: dict[str, Any] = {}
    for part in reversed(arguments.__mro__):
        hints |= getattr(part, "__annotations__", {})
    further = [
        inspect.Parameter(name, keyword, default=_DEFAULTS.get(name), annotation=hint) for name, hint in hints.items()
    ]

    def list_them(function: F) -> F:
        signature = inspect.signature(function)
        own = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        known = {one.name for one in (*own, *further)}

        @functools.wraps(function)
        def call(*positional: Any, **named: Any) -> Any:
            if named.keys() - known:
                raise TypeError(call_fault(call, positional, named))
            return function(*positional, **named)

        call.__signature__ = signature.replace(parameters=[*own, *further])  # type: ignore[attr-defined]
        return cast(F, call)

    return list_them


@dataclass(frozen=True)
class StrainSettings:
    """Checked arguments that all strained runs share; one loop and one file serve all runs of a call."""

    scene: Scene
    method: Method
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    held_n: NDArray[np.bool_] | None
    longest: float
    frames: int
    loop: RunLoop
    file: RunsFile | None
    ledger: bool = False


def check_arguments(
    scene: Scene,
    *,
    dt: float | None = None,
    method: Method | None = None,
    velocity_nd: ArrayLike | None = None,
    spin_nk: ArrayLike | None = None,
    held_n: ArrayLike | None = None,
    time_limit: float | None = None,
    progress: Progress = None,
    frames: int = 0,
    ledger: bool = False,
    checkpoint: str | os.PathLike[str] | RunsFile | None = None,
    check: bool = True,
) -> StrainSettings:
    """Return the arguments as the engine takes them.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    instance("scene", scene, Scene)
    boolean("ledger", ledger)
    refuse_misfits(scene)
    method = checked_method(method)
    start = start_of_motion(scene.packing, velocity_nd, spin_nk, held_n)
    if start.held_n is not None:
        start.velocity_nd[start.held_n] = 0.0
    return StrainSettings(
        scene,
        method,
        *start,
        choose_time_step(scene, method.fraction) if dt is None else positive("dt", dt),
        integer("frames", frames, at_least=0, bytes_each=FRAME_BYTES),
        RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check)),
        runs_file(checkpoint),
        ledger,
    )


class SeveralRuns:
    """What the runs of one call reached together."""

    runs: tuple[Any, ...]

    @property
    def outcome(self) -> Outcome:
        """How the runs ended: as the first of them that is no success, if there is one."""
        return next((run.outcome for run in self.runs if not run.ok), Outcome.FINISHED)

    @property
    def ok(self) -> bool:
        """Whether every run is a success."""
        return self.outcome.ok

    @property
    def bonds_broken(self) -> list[int] | None:
        """How many bonds broke in each run; None where none may."""
        found = [run.broken_bonds for run in self.runs]
        return None if any(one is None for one in found) else [len(one) for one in found]


def listed_numbers(name: str, values: Any, what: str) -> list[float]:
    """Return the positive numbers of a list that an argument names.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.

    """
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
        raise TypeError(f"{name} must be a list of {what}, got {brief(values)}")
    if not len(values):
        raise ValueError(f"{name} must hold one of the {what} at least, got none")
    return [positive(f"{name}[{k}]", one) for k, one in enumerate(values)]


def run_each(values: Sequence[float], run: Callable[[float], R], gathered: Callable[[list[R]], C]) -> C:
    """Return what is gathered of a run for each of the numbers.

    Where a checkpoint could not be written, OSError is raised at the end, with `.run` set to what is gathered.
    An interrupt is passed on with `.run` set to what is gathered of the runs that were finished, or, where none was, to
    the one that it stopped; that one is `.unfinished`, too. NotConverged is passed on with what is gathered of the runs
    before, or None, as `.finished`.
    """
    runs: list[R] = []
    failure: OSError | None = None
    for value in values:
        try:
            runs.append(run(value))
        except KeyboardInterrupt as stop:
            stop.unfinished = getattr(stop, "run", None)  # type: ignore[attr-defined]
            stop.run = gathered(runs) if runs else stop.unfinished  # type: ignore[attr-defined]
            raise
        except NotConverged as stop:
            stop.finished = gathered(runs) if runs else None
            raise stop from failure
        except OSError as error:
            # its checkpoint could not be written; the run itself is whole
            if getattr(error, "run", None) is None:
                raise
            runs.append(error.run)  # type: ignore[attr-defined]
            failure = error
    if failure is not None:
        failure.run = gathered(runs)  # type: ignore[attr-defined]
        raise failure
    return gathered(runs)


def runs_file(checkpoint: Any) -> RunsFile | None:
    """Return the file of strained runs that is named; what is one already, or None, as it is."""
    return checkpoint if checkpoint is None or isinstance(checkpoint, RunsFile) else RunsFile(checkpoint, KIND)
