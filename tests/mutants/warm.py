"""Faults tried in forks of one process that has packmech, its compiled code and the tests at hand: the quick way.

A fork takes the code of those functions that a fault changes, and runs the tests. What a fault changes outside of plain
functions (constants of a module, compiled code) is beyond it. Results that are kept from the first run of the tests may
hide a fault, and never make one: who survives here is to be tried again in a process of its own.
"""

from __future__ import annotations

import importlib
import os
import re
import resource
import signal
import sys
import tempfile
import time
import types
from pathlib import Path
from typing import Any

import pytest

# a fork has none of its parent's threads, and may wait for one of them without end: it then does nothing, so long [s]
_IDLE = 5.0
_OPTIONS = ("-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no")


def _codes(code: types.CodeType) -> list[types.CodeType]:
    return [one for one in code.co_consts if isinstance(one, types.CodeType)]


def _own(code: types.CodeType) -> tuple[Any, ...]:
    """Return what code does by itself, wherever it stands, apart from functions and classes in it."""
    consts = [repr(one) for one in code.co_consts if not isinstance(one, types.CodeType)]
    names = [one.co_qualname for one in _codes(code)]
    return code.co_code, consts, names, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars


def _same(one: types.CodeType, other: types.CodeType) -> bool:
    a, b = _codes(one), _codes(other)
    return _own(one) == _own(other) and len(a) == len(b) and all(map(_same, a, b))


def changed_functions(was: types.CodeType, now: types.CodeType) -> list[types.CodeType] | None:
    """Return the new code of the changed functions of a module; None where more than functions changed."""
    if _own(was) != _own(now):
        return None
    found: list[types.CodeType] = []
    for one, other in zip(_codes(was), _codes(now), strict=True):
        if _same(one, other):
            continue
        # a class runs its body when it is made, and keeps no locals of its own
        if not one.co_flags & 0x2:
            within = changed_functions(one, other)
            if within is None:
                return None
            found += within
        else:
            found.append(other)
    return found


def _function(module: types.ModuleType, name: str) -> types.FunctionType | None:
    """Return the plain function of that qualified name, from beneath what decorators made of it."""
    here: Any = module
    for part in name.split("."):
        here = vars(here).get(part)
        if here is None:
            return None
        while not isinstance(here, types.FunctionType | type) or hasattr(here, "__wrapped__"):
            for attribute in ("__wrapped__", "fget", "func", "__func__"):
                below = getattr(here, attribute, None)
                if below is not None:
                    here = below
                    break
            else:
                return None
    return here if isinstance(here, types.FunctionType) else None


def take(file: str, was: str, now: str) -> bool:
    """Give the functions of a file's module the code of its changed text; return whether that says all."""
    name = file.removeprefix("envs/").removesuffix(".py").replace("/", ".")
    module = importlib.import_module(name)
    changed = changed_functions(
        compile(was, module.__file__ or file, "exec"), compile(now, module.__file__ or file, "exec")
    )
    if changed is None:
        return False
    found = [(_function(module, code.co_qualname), code) for code in changed]
    if not found or any(one is None or one.__code__.co_qualname != code.co_qualname for one, code in found):
        return False
    for one, code in found:
        one.__code__ = code  # type: ignore[union-attr]
    return True


def _end_of(child: int) -> int | None:
    """Return how a process ended; None where it waited without end, and was killed."""
    work = Path(f"/proc/{child}/stat")
    before, since = "", time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        time.sleep(0.05)
        # its times in the program and in the system
        now = " ".join(work.read_text().rpartition(")")[2].split()[11:13]) if work.is_file() else str(time.monotonic())
        if now != before:
            before, since = now, time.monotonic()
        elif time.monotonic() - since > _IDLE:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None


class Warm:
    """The process in which tests of a copy of the checkout have been run once."""

    def __init__(self, here: Path, tests: tuple[str, ...]) -> None:
        self.here = here
        paths = [str(here), str(here / "envs"), str(here / "tests")]
        sys.path[:0] = paths
        os.environ["PYTHONPATH"] = os.pathsep.join(paths[:2])
        os.chdir(here)
        if pytest.main([*_OPTIONS, *tests]) != 0:
            raise SystemExit("tests must pass without a fault")
        if not Path(sys.modules["packmech"].__file__ or "").is_relative_to(here):
            raise SystemExit(f"packmech must come from the copy, got {sys.modules['packmech'].__file__}")

    def outcome(self, fault: Any, text: str, tests: tuple[str, ...], seconds: int) -> tuple[int, str] | None:
        """Return how pytest ended with a fault (negative by a signal) and what failed; None where it is beyond this."""
        with tempfile.TemporaryFile() as said:
            child = os.fork()
            if child == 0:
                code = 99
                try:
                    os.dup2(said.fileno(), 1)
                    os.dup2(said.fileno(), 2)
                    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
                    if take(fault.file, text, fault.put_into(text)):
                        for name in [one for one in sys.modules if one.startswith("tests.")]:
                            del sys.modules[name]
                        code = int(pytest.main([*_OPTIONS, *tests]))
                finally:
                    sys.stdout.flush()
                    os._exit(code)
            status = _end_of(child)
            if status is None:
                return None
            said.seek(0)
            output = said.read().decode(errors="replace")
        code = os.waitstatus_to_exitcode(status)
        failed = re.search(r"^(?:FAILED|ERROR) ([^\s]+)", output, re.MULTILINE)
        return None if code == 99 else (code, failed.group(1) if failed else "")
