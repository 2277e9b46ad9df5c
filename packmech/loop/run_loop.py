"""The run loop: the clock, Ctrl-C and SIGTERM, the time limit, progress and checkpoints of everything that is stepped.

How a run ends: what it reached decides (CONVERGED, FINISHED, STEP_TOO_LONG, ...), else the limit that it met first
(STEP_LIMIT, or TIME_LIMIT when time is up); Ctrl-C and SIGTERM are a KeyboardInterrupt whose `.run` has INTERRUPTED.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from packmech.calls.status import Progress, Report, check_progress, is_watched, shows
from packmech.check import boolean, brief, integer, positive
from packmech.jit.compiled import compile_clock, working_time
from packmech.jit.interrupts import held_interrupts, safe_interrupts
from packmech.loop.checkpoint import check_path
from packmech.result import NotConverged, Outcome, Run

R = TypeVar("R", bound=Run)

# CPU time between two readings of the clock that is aimed at [s]
_SLICE = 0.1
# steps before the first reading where there is a time limit, and by how much a portion grows while readings come early
_FIRST, _GROWTH = 1, 8.0
# time limit of a part of a run where no time is left [s]
_SHORTEST = 1e-9
# a step limit that is none
_ENDLESS = 1 << 62
# checkpoints are written so often where nothing else is asked for [s]
_WRITE_EVERY = 30.0


@dataclass(frozen=True)
class RunSettings:
    """Checked settings that mean the same in each call.

    Attributes
    ----------
    time_limit
        CPU time, that of compiling left out, after which a run ends with Outcome.TIME_LIMIT [s].
    step_limit
        Steps after which it ends with Outcome.STEP_LIMIT.
    checkpoint, checkpoint_every
        The file, and the steps between two writings; None: none, and every half minute.
    threads
        Number of threads.
    progress
        Called as progress(stage, figures); None shows a line in a terminal or notebook, False nothing.
    check
        Whether whatever is no success raises NotConverged.

    """

    time_limit: float = math.inf
    step_limit: int = _ENDLESS
    checkpoint: Path | None = None
    checkpoint_every: int | None = None
    threads: int = 1
    progress: Progress = None
    check: bool = True


def run_settings(
    *,
    time_limit: Any = None,
    step_limit: Any = _ENDLESS,
    checkpoint: Any = None,
    checkpoint_every: Any = None,
    threads: Any = 1,
    progress: Any = None,
    check: Any = True,
) -> RunSettings:
    """Return the settings of a run after checking them.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what is required and what was given.

    Examples
    --------
    >>> run_settings(time_limit=0.5).time_limit
    0.5
    >>> run_settings(threads=0)
    Traceback (most recent call last):
    ...
    ValueError: threads must be an integer at least 1, got 0

    """
    boolean("check", check)
    if checkpoint_every is not None:
        integer("checkpoint_every", checkpoint_every, at_least=1)
        if checkpoint is None:
            raise ValueError(
                f"checkpoint_every must be left out where no checkpoint is given, got {brief(checkpoint_every)}"
            )
    return RunSettings(
        math.inf if time_limit is None else positive("time_limit", time_limit),
        integer("step_limit", step_limit, at_least=0),
        None if checkpoint is None else check_path(checkpoint),
        checkpoint_every,
        integer("threads", threads, at_least=1),
        check_progress(progress),
        check,
    )


class TimeUp(Exception):  # noqa: N818 - no error
    """Raised within a piece of work where the time limit has passed; `RunLoop.run` then ends as TIME_LIMIT."""


class Task(Protocol):
    """What the loop steps: a minimization, a simulation, a strained run."""

    @property
    def steps(self) -> int:
        """Steps taken so far."""

    def next_stop(self) -> int | Outcome:
        """Return the step at which `observe` is due next, or how it ended. No clock may decide on it."""

    def advance(self, steps: int) -> Outcome | None:
        """Take so many steps, with the same bits in whatever portions; return how it ended, None if it goes on."""

    def observe(self) -> Outcome | None:
        """Keep what is to be kept of this stop; return how it ended, None if it goes on."""

    def figures(self) -> tuple[str, dict[str, Any]] | None:
        """Return the stage and the figures that `progress` is called with at this stop, None if it is not."""


class RunLoop:
    """The clock, the limit, the interrupts and the checkpoints of one call; its stages share it.

    Parameters
    ----------
    settings
        The call's settings.

    """

    def __init__(self, settings: RunSettings) -> None:
        self.settings = settings
        self.deadline = working_time() + settings.time_limit
        self.compiling: Callable[[], float] = lambda: 0.0
        self._watch: Report = settings.progress if callable(settings.progress) else lambda stage, figures: None
        # writes the checkpoint of the task that is being stepped
        self._save: Callable[[], None] | None = None
        self._written = time.monotonic()

    @property
    def watched(self) -> bool:
        """Whether what the run reports is heard."""
        return is_watched(self.settings.progress)

    @property
    def late(self) -> bool:
        """Whether time is up; without a limit the clock, which is slow to read on some machines, is left alone."""
        return not math.isinf(self.deadline) and working_time() > self.deadline

    @property
    def time_left(self) -> float | None:
        """CPU time until the limit, above zero [s]; None without a limit."""
        return None if math.isinf(self.deadline) else max(self.deadline - working_time(), _SHORTEST)

    def rest(self) -> RunSettings:
        """Return the settings of a part of this call: its own, with the time that is left."""
        left = self.time_left
        return replace(self.settings, time_limit=math.inf if left is None else left)

    def check_time(self) -> None:
        """Raise TimeUp where time is up: for work that is no task, between two of its steps."""
        if self.late:
            raise TimeUp

    def report(self, stage: str, **figures: Any) -> None:
        """Report a stage to whoever watches."""
        self._watch(stage, figures)

    def advance(self, task: Task, save: Callable[[], None] | None = None) -> Outcome:
        """Step a task to its end or to a limit; return how it ended.

        Each portion of steps is taken wholly before Ctrl-C or SIGTERM is heard. Where there is a time limit,
        its size follows from the measured speed, so that the clock is read several times a second however long a step
        takes.

        Parameters
        ----------
        task
            What to step.
        save
            Writes a checkpoint of the task: now and then, at the end of the run, and when it is interrupted.

        """
        self._save = save
        every, portion = self.settings.checkpoint_every, math.inf if math.isinf(self.deadline) else _FIRST
        while True:
            stop = task.next_stop()
            if isinstance(stop, Outcome):
                return stop
            with held_interrupts():
                part = int(min(stop - task.steps, portion))
                if every is not None:
                    part = min(part, every - task.steps % every)
                began = time.process_time()
                outcome = task.advance(part)
                portion = _next_portion(portion, part, time.process_time() - began)
                observed = outcome is None and task.steps == stop
                if observed:
                    outcome = task.observe()
                if outcome is None and save is not None and self._is_due(task.steps):
                    self._write(save, warn=True)
            if outcome is not None:
                # the state after a step that was too long is no state to go on from
                self._save = None if outcome is Outcome.STEP_TOO_LONG else save
                return outcome
            if observed:
                figures = task.figures()
                if figures is not None:
                    self._watch(*figures)
            if self.late and not isinstance(task.next_stop(), Outcome):
                return Outcome.TIME_LIMIT

    def _is_due(self, steps: int) -> bool:
        every = self.settings.checkpoint_every
        if every is not None and steps % every == 0:
            return True
        return time.monotonic() - self._written > _WRITE_EVERY

    def _write(self, save: Callable[[], None], *, warn: bool = False) -> OSError | None:
        """Write a checkpoint; return what went wrong, and warn of it where it will not be raised."""
        self._written = time.monotonic()
        try:
            with held_interrupts():
                save()
        except OSError as failure:
            if warn:
                warnings.warn(f"the checkpoint could not be written, the one before stays: {failure}", stacklevel=4)
            return failure
        return None

    def run(self, work: Callable[[], Outcome], finished: Callable[[Outcome], R], *, check: bool | None = None) -> R:
        """Return the run that comes of some work, as far as it came.

        Parameters
        ----------
        work
            Does it, stepping tasks by `advance`; returns how it ended.
        finished
            Makes the run of how it ended.
        check
            In place of that of the settings, where this is a part of the call's run.

        Raises
        ------
        NotConverged
            If it is no success, unless that is not to be checked.
        KeyboardInterrupt
            Passed on, and raised at SIGTERM, with `.run` set to what was reached.
        OSError
            If the checkpoint at the end cannot be written; `.run` is the run.

        """
        self._save, failure = None, None
        with safe_interrupts():
            try:
                with compile_clock() as self.compiling, shows("running", self.settings.progress) as self._watch:
                    try:
                        outcome = work()
                    except TimeUp:
                        outcome = Outcome.TIME_LIMIT
                if self._save is not None:
                    failure = self._write(self._save)
                run = finished(outcome)
            except KeyboardInterrupt as stop:
                if self._save is not None:
                    self._write(self._save, warn=True)
                stop.run = finished(Outcome.INTERRUPTED)  # type: ignore[attr-defined]
                raise
        if failure is not None:
            failure.run = run
            raise failure
        if (self.settings.check if check is None else check) and not run.ok:
            raise NotConverged(run)
        return run


def _next_portion(portion: float, steps: int, seconds: float) -> float:
    """Return how many steps to take before the clock is looked at again."""
    if seconds > _SLICE:
        return max(1.0, steps * _SLICE / seconds)
    if steps >= portion and seconds < _SLICE / _GROWTH:
        return portion * _GROWTH
    return portion
