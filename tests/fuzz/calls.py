"""Calls of public functions with hostile arguments, and what is wrong with how they end.

    python tests/fuzz/calls.py [--seed 0] [--calls 100000] [--name PATTERN ...]

A call is one of `arguments.good` with one or two of its arguments replaced by a hostile value, and with a time limit
where it has one. It ends well where it returns, or raises an error that packmech itself wrote, in one short line; what
a caller's own function raises is the caller's. Anything else is a fault: an error out of a
library or of the language (a foreign one), a message without end, a call that ignores its limits of time or memory.
A call that ends its process, or that never comes back, is one, too: calls are made in a process beside that which
counts. Prints each fault once for each place that it comes from, with the call that shows it.
"""

from __future__ import annotations

import argparse
import contextlib
import decimal
import fnmatch
import fractions
import inspect
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "envs"), str(ROOT / "tests")]

from arguments import METHODS, call, good, parameters, public, write_files  # noqa: E402

import packmech as pm  # noqa: E402

# what a call on a handful of particles may take, with its code compiled [CPU s], and what it may say
SECONDS, BYTES, LETTERS = 20.0, 6 << 30, 1000
# and so many times as long where it is given a long array
MANY = 5.0
# where a call has a time limit, it is asked to keep this one [CPU s]
TIME_LIMIT = 5.0
# a call that waits for something uses no CPU time: so many seconds of the clock for each [1]
PATIENCE = 10.0
# where nothing that Python runs can stop a call, as machine code is at work, its process is ended after so long [s]
LOST = 1.5 * PATIENCE * SECONDS * MANY
OWN_ERRORS = (TypeError, ValueError, pm.NotConverged, OSError)


class Shy:
    """An object that cannot be looked at."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("no comparison")

    __hash__ = None  # type: ignore[assignment]


class Pretender:
    """An object that says that it is an array and a number, and is neither."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        raise RuntimeError("no array")

    def __float__(self) -> float:
        raise RuntimeError("no number")

    def __index__(self) -> int:
        raise RuntimeError("no integer")

    def __len__(self) -> int:
        return -1

    def __iter__(self) -> Iterator[Any]:
        raise RuntimeError("no entries")


def _recursive() -> list[Any]:
    one: list[Any] = []
    one.append(one)
    return one


# name -> maker: each call has a value of its own
HOSTILE = {
    **{
        f"{n}": (lambda n=n: n)
        for n in (0, -1, 1, 2, 7, 2**31, 2**53 + 1, 2**63 - 1, 2**63, 2**64, -(2**63), -(2**63) - 1)
    },
    "10**400": lambda: 10**400,
    "10**5000": lambda: 10**5000,
    **{
        f"{x!r}": (lambda x=x: x)
        for x in (1e18, 1e30, 1e200, 1e308, -1e308, 1e-12, 1e-200, 5e-324, -0.0, 0.5, 1e6, 2.0**63)
    },
    "nan": lambda: float("nan"),
    "inf": lambda: float("inf"),
    "-inf": lambda: -float("inf"),
    "1+2j": lambda: 1 + 2j,
    "True": lambda: True,
    "None": lambda: None,
    "...": lambda: ...,
    "Fraction": lambda: fractions.Fraction(1, 3),
    "Decimal nan": lambda: decimal.Decimal("nan"),
    "Decimal huge": lambda: decimal.Decimal("1e999"),
    "uint64": lambda: np.uint64(2**64 - 1),
    "int8": lambda: np.int8(5),
    "float16 inf": lambda: np.float16("inf"),
    "longdouble": lambda: np.longdouble("1e4000"),
    "datetime": lambda: np.datetime64("2020"),
    "empty text": lambda: "",
    "text": lambda: "free",
    "number as text": lambda: "1e3",
    "long name": lambda: "n" * 250,
    "very long text": lambda: "y" * 1_000_000,
    "zero byte": lambda: "a\0b",
    "surrogate": lambda: "\udc80",
    "braces": lambda: "{0} %s %d",
    "bytes": lambda: b"1e-3",
    "folder": lambda: "/",
    "here": lambda: ".",
    "path": lambda: Path("/"),
    "device": lambda: "/dev/full",
    "no folder": lambda: "no/such/folder.npz",
    "int": lambda: int,
    "dict": lambda: dict,
    "print": lambda: repr,
    "lambda": lambda: lambda: None,
    "raises": lambda: lambda *given, **named: 1 / 0,
    "module": lambda: np,
    "object": lambda: object(),
    "shy": Shy,
    "pretender": Pretender,
    "exception": lambda: ValueError("a"),
    "()": lambda: (),
    "[]": lambda: [],
    "[[]]": lambda: [[]],
    "{}": lambda: {},
    "set": lambda: {1, 2},
    "{1: 2}": lambda: {1: 2},
    "{'a': 1}": lambda: {"a": 1},
    "range": lambda: range(3),
    "huge range": lambda: range(10**18),
    "iterator": lambda: iter([0.1, 0.2]),
    "generator": lambda: (x for x in (0, 1)),
    "recursive": _recursive,
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "pair": lambda: (0, 1),
    "pair of huge": lambda: (2**62, 2**62),
    "huge in list": lambda: [10**400],
    "list of nan": lambda: [float("nan")] * 3,
    "list of None": lambda: [None, None],
    "list of texts": lambda: ["a", "b"],
    "list of shy": lambda: [Shy()],
    "0-d": lambda: np.array(1.0),
    "0-d integer": lambda: np.array(3),
    "0-d object": lambda: np.array(None),
    "empty": lambda: np.zeros(0),
    "no rows": lambda: np.zeros((0, 2)),
    "no columns": lambda: np.zeros((9, 0)),
    "zeros (9, 2)": lambda: np.zeros((9, 2)),
    "ones (2, 2)": lambda: np.ones((2, 2)),
    "huge (9, 2)": lambda: np.full((9, 2), 1e300),
    "tiny (9, 2)": lambda: np.full((9, 2), 1e-310),
    "nine": lambda: np.arange(9),
    "nine floats": lambda: np.linspace(0.1, 1.0, 9),
    "smallest integers": lambda: np.full(9, -(2**63)),
    "largest unsigned": lambda: np.full(9, 2**64 - 1, dtype=np.uint64),
    "rank 30": lambda: np.zeros((1,) * 30),
    "masked": lambda: np.ma.masked_array([0.1, 0.2], mask=[False, True]),
    "masked (9, 2)": lambda: np.ma.masked_array(np.full((9, 2), 0.1), mask=np.eye(9, 2, dtype=bool)),
    "complex": lambda: np.array([1j, 2.0]),
    "complex (9, 2)": lambda: np.full((9, 2), 1j),
    "texts": lambda: np.array(["a", "b"]),
    "objects": lambda: np.array([object(), None], dtype=object),
    "booleans": lambda: np.zeros(9, dtype=bool),
    "structured": lambda: np.zeros(3, dtype=[("a", float)]),
    "datetimes": lambda: np.array(["2020", "NaT"], dtype="datetime64[D]"),
    "not contiguous": lambda: np.zeros((18, 4))[::2, ::2],
    "broadcast": lambda: np.broadcast_to(0.5, (9, 2)),
    "read only": lambda: np.frombuffer(bytes(72)),
    "matrix": lambda: np.matrix("1 0; 0 1"),
    "long": lambda: np.full(200_000, 0.5),
}


class TooLong(BaseException):
    """A call that went on when its time was over."""


class Fault(NamedTuple):
    """A call that ended in a way that it must not."""

    call: str
    what: str
    where: str


def _stop(*_: Any) -> None:
    raise TooLong


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        one for one in frames if "packmech" in Path(one.filename).parts or "packmech_envs" in Path(one.filename).parts
    ]
    last = own[-1] if own else frames[-1]
    return f"{Path(last.filename).name}:{last.lineno}"


def _of_gymnasium() -> tuple[type, ...]:
    """Return the errors that Gymnasium's conventions ask of environments, where it has been loaded."""
    found = sys.modules.get("gymnasium")
    return () if found is None else (found.error.Error,)


def _is_own(error: BaseException) -> bool:
    """Return whether packmech raised the error itself, its deepest frame being packmech's."""
    if not isinstance(error, OWN_ERRORS):
        return False
    deepest = traceback.extract_tb(error.__traceback__)[-1]
    return any(part in ("packmech", "packmech_envs") for part in Path(deepest.filename).parts)


def judge(call_text: str, act: Any, seconds: float = SECONDS, also: tuple[type, ...] = ()) -> Fault | None:
    """Make a call; return what is wrong with its end, None where nothing is."""
    _set_timers(seconds)
    began = time.process_time()
    try:
        act()
    except TooLong as error:
        return Fault(call_text, f"still at work after {seconds:g} s", _where(error))
    except BaseException as error:
        _set_timers(0.0)
        text = str(error)
        if not _is_own(error) and not isinstance(error, (*also, *_of_gymnasium())):
            return Fault(call_text, f"{type(error).__name__}: {text[:200]}", _where(error))
        if len(text) > LETTERS:
            return Fault(call_text, f"a message of {len(text)} letters: {text[:80]}", _where(error))
    finally:
        _set_timers(0.0)
    took = time.process_time() - began
    return Fault(call_text, f"took {took:.1f} s", "") if took > seconds else None


def _set_timers(seconds: float) -> None:
    """Have `TooLong` raised after so much CPU time, or where a call waits; 0: never."""
    for timer, number, limit in (
        (signal.ITIMER_PROF, signal.SIGPROF, seconds),
        (signal.ITIMER_REAL, signal.SIGALRM, PATIENCE * seconds),
    ):
        signal.signal(number, _stop)
        signal.setitimer(timer, limit)


def calls(rng: np.random.Generator, names: list[str], count: int, folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Return names with the hostile values of one or two parameters, so many calls of each name in turn."""
    values = list(HOSTILE)
    for turn in range(count):
        name = names[turn % len(names)]
        fields = fields_of(name, folder)
        if fields:
            chosen = rng.choice(fields, size=min(len(fields), 1 + int(rng.random() < 0.2)), replace=False)
            yield name, {str(field): values[rng.integers(len(values))] for field in chosen}


def shown(name: str, hostile: dict[str, str]) -> str:
    """Return a call as it is printed."""
    return f"{name}({', '.join(f'{field}=<{value}>' for field, value in hostile.items())})"


def run(name: str, hostile: dict[str, str], folder: Path) -> Fault | None:
    """Return what is wrong with one call; `hostile` names the values by parameter."""
    call_text = shown(name, hostile)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        values = {field: HOSTILE[value]() for field, value in hostile.items()}
        if name in METHODS:
            method, arguments = METHODS[name](folder)
            # what is asked for by a key raises what Python's own containers raise
            also = (LookupError,) if name.endswith(("__getitem__", "Table.tensor")) else ()
            return judge(call_text, lambda: method(**arguments | values), also=also)
        limit = {"time_limit": TIME_LIMIT} if "time_limit" in fields_of(name, folder) else {}
        arguments = limit | good(name, folder) | values
        # an array of 200,000 numbers asks for as many answers
        seconds = SECONDS * (MANY if "long" in hostile.values() else 1.0)
        also = (ZeroDivisionError,) if "raises" in hostile.values() else ()
        return judge(call_text, lambda: call(name, arguments), seconds, also)


def fields_of(name: str, folder: Path) -> list[str]:
    """Return the parameters of what a name calls that can be named."""
    fields = inspect.signature(METHODS[name](folder)[0]).parameters if name in METHODS else parameters(name)
    return [one for one, field in fields.items() if field.kind not in (field.VAR_POSITIONAL, field.VAR_KEYWORD)]


def _make(asked_for: list[tuple[str, dict[str, str]]], folder: Path, out: Connection) -> None:
    """Make calls one after another, and send what is wrong with each; None: nothing."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    # where hostile names of files lead
    os.chdir(folder)
    for name, hostile in asked_for:
        out.send(run(name, hostile, folder))


def made(asked_for: list[tuple[str, dict[str, str]]], folder: Path) -> Iterator[Fault | None]:
    """Make calls in a process beside this one, and in another one after each that ends it or never comes back."""
    first, context = 0, multiprocessing.get_context("fork")
    while first < len(asked_for):
        here, there = context.Pipe(duplex=False)
        worker = context.Process(target=_make, args=(asked_for[first:], folder, there), daemon=True)
        worker.start()
        there.close()
        with here, contextlib.ExitStack() as ends:
            ends.callback(worker.join)
            ends.callback(worker.kill)
            while first < len(asked_for):
                name, hostile = asked_for[first]
                try:
                    found = here.recv() if here.poll(LOST) else Fault(shown(name, hostile), "never came back", name)
                except EOFError:
                    worker.join()
                    found = Fault(shown(name, hostile), f"ended the process: {worker.exitcode}", name)
                first += 1
                yield found
                if found is not None and found.where == name:
                    break


def main() -> int:
    """Make the calls that the command asks for and print their faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calls", type=int, default=100_000)
    parser.add_argument("--name", nargs="*", default=["*"])
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after so much time")
    parser.add_argument("--all", action="store_true", help="each value at each parameter, once")
    asked = parser.parse_args()
    names = [one for one in (*public(), *METHODS) if any(fnmatch.fnmatch(one, pattern) for pattern in asked.name)]
    seen: dict[tuple[str, str], int] = {}
    count = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_files(folder)
        asked_for = (
            [(one, {field: value}) for one in names for field in fields_of(one, folder) for value in HOSTILE]
            if asked.all
            else list(calls(np.random.default_rng(asked.seed), names, asked.calls, folder))
        )
        began = time.monotonic()
        for count, fault in enumerate(made(asked_for, folder), 1):
            if count % 1000 == 0:
                print(f"{count} of {len(asked_for)} calls in {time.monotonic() - began:.0f} s", file=sys.stderr)
            if fault is not None:
                place = (fault.what.split(":")[0], fault.where)
                seen[place] = seen.get(place, 0) + 1
                if seen[place] == 1:
                    print(f"{fault.where:28} {fault.call}: {fault.what}", flush=True)
            if time.monotonic() - began > asked.seconds:
                break
    print(f"{count} calls, {sum(seen.values())} faults from {len(seen)} places")
    return bool(seen)


if __name__ == "__main__":
    sys.exit(main())
