"""What a long call is doing, in one line of a terminal or a notebook, and how long it has taken.

The line appears after a second on standard error, where somebody reads it, and goes away with the call. A call within
another one changes the words of the same line. `progress=False` of a call, or PACKMECH_PROGRESS=0 in the environment,
shows none.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

from packmech.check import clear_errors, function

# what calls take as `progress`: a function of the stage and its figures, False for none, None for the line here
Report = Callable[[str, dict[str, Any]], None]
Progress = Report | bool | None
P = ParamSpec("P")
R = TypeVar("R")

# time after which a call is long [s]
_LONG = 1.0
# figures that the line has room for
_FIGURES = 4


def is_read(stream: Any) -> bool:
    """Whether somebody reads along: a terminal, or the cell of a notebook."""
    return stream is not None and (stream.isatty() or type(stream).__module__.startswith("ipykernel."))


class Status:
    """The line of the outermost call: its words change as the call reports.

    Parameters
    ----------
    words
        What stands there first.
    shown
        Whether there is a line at all; else a call within shows none either.
    after
        When it appears [s].

    """

    # the line that is in use, by whatever thread
    current: Status | None = None

    def __init__(self, words: str, shown: bool, after: float = _LONG) -> None:
        self.words, self.shown = words, shown
        self._lock = threading.Lock()
        self._bar: Any = None
        self._timer = threading.Timer(after, self._appear) if shown and after > 0.0 else None
        if self._timer is not None:
            self._timer.daemon = True
            self._timer.start()
        elif shown:
            self._appear()

    def say(self, words: str) -> None:
        """Change the words."""
        self.words = words
        with self._lock:
            if self._bar is not None:
                self._bar.update(self._bar.task_ids[0], description=words)

    def report(self, stage: str, figures: dict[str, Any]) -> None:
        """Change the words to a stage and its figures."""
        self.say(words_of(stage, figures))

    def _appear(self) -> None:
        from rich.console import Console
        from rich.progress import Progress as Bar
        from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        with self._lock:
            if Status.current is not self and Status.current is not None:
                return
            self._bar = Bar(*columns, console=Console(stderr=True, highlight=False), transient=True)
            self._bar.add_task(self.words, total=None)
            self._bar.start()

    def close(self) -> None:
        """Take the line away."""
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            if self._bar is not None:
                self._bar.stop()
                self._bar = None


def words_of(stage: str, figures: dict[str, Any]) -> str:
    """Return a stage and its figures in words.

    Examples
    --------
    >>> words_of("quench", {"steps": 120, "residual": 3.21e-7, "packing": None})
    'quench, steps 120, residual 3.21e-07'

    """
    numbers = {name: value for name, value in figures.items() if isinstance(value, int | float)}
    return ", ".join([stage, *(f"{name.replace('_', ' ')} {numbers[name]:.3g}" for name in list(numbers)[:_FIGURES])])


def check_progress(progress: Any) -> Progress:
    """Return what was given as `progress` after checking that it is a function, True, False or None."""
    if progress is not None and not isinstance(progress, bool):
        function("progress", progress)
    return progress  # type: ignore[no-any-return]


def is_watched(progress: Progress) -> bool:
    """Whether somebody hears what is reported: a function, or who reads the line."""
    return callable(progress) or (Status.current is not None and Status.current.shown)


@contextmanager
def shows(words: str, progress: Progress = None, *, after: float = _LONG) -> Iterator[Report]:
    """Show what a call does while it lasts; give what is to be called with stages and figures.

    Parameters
    ----------
    words
        What the call is.
    progress
        As the call was given it. A function is called in place of the line; no call within shows one either.
    after
        When the line appears [s].

    """
    quiet = callable(progress) or progress is False or os.environ.get("PACKMECH_PROGRESS") == "0"
    outer = Status.current
    if outer is not None:
        yield progress if callable(progress) else outer.report
        return
    status = Status.current = Status(words, not quiet and (progress is True or is_read(sys.stderr)), after)
    try:
        yield progress if callable(progress) else status.report
    finally:
        Status.current = None
        status.close()


def shown_as(words: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator of a call that may take long: the line shows these words while it lasts."""

    def decorated(call: Callable[P, R]) -> Callable[P, R]:
        clear = clear_errors(call)

        @functools.wraps(call)
        def wrapped(*given: P.args, **named: P.kwargs) -> R:
            with shows(words):
                return clear(*given, **named)

        wrapped.shown_as = words  # type: ignore[attr-defined]
        return wrapped

    return decorated
