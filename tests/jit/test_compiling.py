"""Facts about the line that tells of compiling: one in a process, for those who wait and can read it."""

import os
import pathlib
import pty
import subprocess
import sys
import time

import pytest
from numba.core import event

import packmech
from packmech.jit.compiled import compile_clock, working_time

ROOT = pathlib.Path(packmech.__file__).parents[1]
SCRIPT = """
import sys, time
from numba import njit
from numba.extending import overload
from packmech.jit.compiled import kernel

def slow(number):
    return number

@overload(slow)
def _slow(number):
    time.sleep(0.6)  # while types are inferred
    return lambda number: number

def one(number):
    return slow(number)

def other(number):
    return slow(number) + 1

kind = sys.argv[1]
if kind == "notebook":
    class OutStream:
        def __init__(self, stream):
            self.write, self.flush, self.isatty = stream.write, stream.flush, lambda: False
    OutStream.__module__ = "ipykernel.iostream"
    sys.stderr = OutStream(sys.stderr)
for function in (one, other):
    made = njit(function) if kind == "not ours" else kernel(function)
    made(1)
"""
LINE = "packmech: compiling machine code, which later runs will find on disk"


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Return what a script that compiles two codes, 0.6 s or more each, says on stderr, by what that is."""
    folder = tmp_path_factory.mktemp("notice")
    script = folder / "script.py"
    script.write_text(SCRIPT)

    def run(kind, cache):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / cache), "PYTHONPATH": str(ROOT)}
        command = [sys.executable, str(script), kind]
        if kind != "terminal":
            done = subprocess.run(command, env=environment, stderr=subprocess.PIPE, text=True, check=True)
            return done.stderr.splitlines()
        reader, writer = pty.openpty()
        subprocess.run(command, env=environment, stderr=writer, check=True)
        os.close(writer)
        written = b""
        try:
            while part := os.read(reader, 1000):
                written += part
        except OSError:  # so ends what a terminal's other side wrote, on Linux
            pass
        os.close(reader)
        return written.decode().splitlines()

    return {
        "terminal": run("terminal", "one"),
        "terminal again": run("terminal", "one"),
        "notebook": run("notebook", "two"),
        "pipe": run("pipe", "three"),
        "not ours": run("not ours", "four"),
    }


@pytest.mark.parametrize("where", ["terminal", "notebook"])
def test_who_waits_for_the_compiler_is_told_once(told, where):
    assert told[where] == [LINE]


def test_nothing_is_said_where_the_code_is_found_on_disk(told):
    assert told["terminal again"] == []


@pytest.mark.parametrize("where", ["pipe", "not ours"])
def test_nothing_is_said_into_a_pipe_nor_of_others_functions(told, where):
    assert told[where] == []


def test_compiling_is_timed_by_the_clock_of_all_costs():
    began = time.process_time()
    with compile_clock() as clock, event.trigger_event("numba:compile", data={"dispatcher": None}):
        time.sleep(0.2)  # takes no CPU time
        with event.trigger_event("numba:compile", data={"dispatcher": None}):
            sum(range(300_000))
    assert 0.0 < clock() <= time.process_time() - began < 0.2


def test_compiling_takes_nothing_off_a_time_limit():
    before, began = working_time(), time.process_time()
    with event.trigger_event("numba:compile", data={"dispatcher": None}):
        sum(range(3_000_000))
    spent = time.process_time() - began
    assert working_time() - before < 0.5 * spent
