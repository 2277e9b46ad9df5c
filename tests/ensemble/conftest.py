"""What tests of ensembles share: the jobs, commands in processes of their own, and kills at random times."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from packmech.ensemble.jobs import function_at

HERE = pathlib.Path(__file__).parent


@pytest.fixture(scope="session")
def job():
    """Return a function: the job of that name in jobs.py, as the command line names it."""
    return lambda name: f"{HERE / 'jobs.py'}:{name}"


@pytest.fixture(scope="session")
def called():
    """Return a function: the job of that name itself."""
    return lambda name: function_at({"module": "jobs", "name": name, "root": str(HERE)})


@pytest.fixture
def command():
    """Return a function that starts `packmech ensemble` in a process group of its own; what is left of it is ended."""
    started = []

    def start(*words, **options):
        process = subprocess.Popen(
            [sys.executable, "-m", "packmech", "ensemble", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **options,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.communicate()


def rows_of(ensemble):
    """Return the rows of an ensemble without what they cost, as texts of every bit."""
    names = [name for name in ensemble.columns if name != "seconds"]
    return [tuple(repr(ensemble[name][k]) for name in names) for k in range(len(ensemble))]


@pytest.fixture(scope="session")
def rows():
    """Return the function that gives an ensemble's rows to the last bit."""
    return rows_of


def children_of(pid):
    """Return the processes that a process started, and those that these did."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            own = int(path.parent.name)
            found += [own, *children_of(own)]
    return found


@pytest.fixture(scope="session")
def children():
    """Return the function that finds the processes that one started."""
    return children_of


def until(condition, seconds=120.0):
    """Wait until something is so."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.02)


@pytest.fixture(scope="session")
def wait_until():
    """Return the function that waits until something is so."""
    return until


@pytest.fixture(scope="session")
def rng():
    """Return a generator for times at which to kill: others in every run."""
    return np.random.default_rng()
