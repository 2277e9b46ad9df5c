"""What goes along with compiling: fewer collections of garbage, and one line for whoever waits."""

from __future__ import annotations

import gc
import sys
import threading
import time
from typing import Any

from numba.core import event

from packmech.calls.status import is_read
from packmech.jit.cache import KernelCache

# The compiler makes many small objects that refer to each other and are needed until it is done: to look through them
# for garbage as often as Python does by itself takes a sixth of the time, and finds next to none.
_OBJECTS_BETWEEN_COLLECTIONS = 100_000
# a shorter wait is not worth a line [s]
_PATIENCE = 0.5
# nor one of this length where no terminal shows it, as in a batch job [s]
_UNREAD = 10.0


class CompileClock(event.Listener):  # type: ignore[misc]
    """Adds up the CPU time that goes into compiling [s], the clock of all costs; 0 where all is found on disk."""

    def __init__(self) -> None:
        self.seconds = self._began = 0.0
        self._depth = 0

    def on_start(self, event: Any) -> None:
        """Begin, at the outermost function."""
        if self._depth == 0:
            self._began = time.process_time()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """End, with the outermost function."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.process_time() - self._began


# that of all that this process compiles
COMPILING = CompileClock()


class CompileListener(event.Listener):  # type: ignore[misc]
    """Hears when functions of ours are compiled, not when they are found on disk."""

    def __init__(self) -> None:
        self._depth = 0
        self._threshold: tuple[int, ...] | None = None
        self._told = False
        self._spent = self._began = 0.0
        self._timer: threading.Timer | None = None

    def on_start(self, event: Any) -> None:
        """Begin, at the outermost function."""
        self._depth += 1
        if self._depth > 1 or not isinstance(getattr(event.data["dispatcher"], "_cache", None), KernelCache):
            return
        threshold = gc.get_threshold()
        if 0 < threshold[0] < _OBJECTS_BETWEEN_COLLECTIONS:
            self._threshold = threshold
            gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS, *threshold[1:])
        if not self._told:
            patience = _PATIENCE if is_read(sys.stderr) else _UNREAD
            self._began = time.perf_counter()
            self._timer = threading.Timer(max(patience - self._spent, 0.0), self._tell)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        """End, with the outermost function."""
        self._depth -= 1
        if self._depth > 0:
            return
        if self._threshold is not None:
            gc.set_threshold(*self._threshold)
            self._threshold = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._spent += time.perf_counter() - self._began

    def _tell(self) -> None:
        self._told = True
        print("packmech: compiling machine code, which later runs will find on disk", file=sys.stderr, flush=True)
