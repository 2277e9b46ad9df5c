"""Ctrl-C and SIGTERM at a safe place."""

from __future__ import annotations

import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_AGAIN_SECONDS = 0.05
# a wait that was announced less than this before is the same one
_QUIET_SECONDS = 10.0
# an exception in the middle of these leaves types and caches half made
_DELICATE = ("numba", "llvmlite")
Handler = Callable[[int, FrameType | None], object]


def _handlers() -> dict[int, Handler]:
    """Return what Ctrl-C and SIGTERM call, by their numbers; SIGTERM, unless somebody handles it, the same as Ctrl-C.

    Nothing is changed outside the main thread, nor for who ignores a signal or handles it beyond Python.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    found: dict[int, Handler] = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        before = signal.getsignal(number)
        if callable(before) and not isinstance(before, int):
            found[number] = before
        elif number == signal.SIGTERM and before is signal.SIG_DFL:
            found[number] = signal.default_int_handler
    return found


@contextmanager
def _handled(handlers: dict[int, Handler]) -> Iterator[None]:
    """Let these handle their signals until the block has ended."""
    before = {number: signal.getsignal(number) for number in handlers}
    try:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)


# when the wait for the compiler was announced last [s]: signals come again and again until it is over
_announced = -math.inf


def _announce(frame: FrameType | None) -> None:
    """Say once that the compiler is waited for, however many signals come and whoever holds them back."""
    global _announced
    if not _delicate(frame):
        return
    before, _announced = _announced, time.monotonic()
    if _announced - before > _QUIET_SECONDS:
        print("packmech: stopping when this piece of machine code is compiled", file=sys.stderr, flush=True)


@contextmanager
def safe_interrupts() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back while machine code is made, loaded or chosen; elsewhere they are KeyboardInterrupts.

    What follows an exception inside numba are senseless errors in calls that were right, and now and then the end of
    the process without a word. Outside the main thread nothing is changed.
    """
    handlers = _handlers()
    waiting = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal waiting
        if not _delicate(frame):
            handlers[number](number, frame)
            return
        if not waiting:
            waiting = True
            _announce(frame)
        later = threading.Timer(_AGAIN_SECONDS, signal.raise_signal, (number,))
        later.daemon = True
        later.start()

    with _handled(dict.fromkeys(handlers, interrupt)):
        yield


def _delicate(frame: FrameType | None) -> bool:
    """Whether this frame, or one that led to it, is inside the compiler."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in _DELICATE:
            return True
        frame = frame.f_back
    return False


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back until the block has ended, so that what it changes is changed wholly.

    For blocks of some tens of milliseconds; only the compiler makes one longer. Outside the main thread nothing is
    changed.
    """
    handlers = _handlers()
    held: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if not held:
            _announce(frame)
        held.append((number, frame))

    try:
        with _handled(dict.fromkeys(handlers, hold)):
            yield
    finally:
        if held:
            number, frame = held[0]
            handlers[number](number, frame)
