"""Ctrl-C at a safe place."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_AGAIN_SECONDS = 0.05
# an exception in the middle of these leaves types and caches half made
_DELICATE = ("numba", "llvmlite")


@contextmanager
def safe_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back while machine code is made, loaded or chosen; elsewhere it is the usual KeyboardInterrupt.

    What follows an exception inside numba are senseless errors in calls that were right, and now and then the end of
    the process without a word. Outside the main thread nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    # who ignores Ctrl-C, or handles it beyond Python, goes on doing so
    if not callable(before):
        yield
        return
    waiting = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal waiting
        if not _delicate(frame):
            before(number, frame)
            return
        if not waiting:
            waiting = True
            print("packmech: stopping when this piece of machine code is compiled", file=sys.stderr, flush=True)
        later = threading.Timer(_AGAIN_SECONDS, signal.raise_signal, (number,))
        later.daemon = True
        later.start()

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _delicate(frame: FrameType | None) -> bool:
    """Whether this frame, or one that led to it, is inside the compiler."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in _DELICATE:
            return True
        frame = frame.f_back
    return False


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back until the block has ended, so that what it changes is changed wholly.

    For blocks of some tens of milliseconds; only the compiler makes one longer. Outside the main thread nothing is
    changed.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    held: list[tuple[int, FrameType | None]] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if not held and _delicate(frame):
            print("packmech: stopping when this piece of machine code is compiled", file=sys.stderr, flush=True)
        held.append((number, frame))

    signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if held:
            before(*held[0])
