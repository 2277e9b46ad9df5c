"""`run_ensemble`: what is missing of an ensemble, run on an executor."""

from __future__ import annotations

import math
import os
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from packmech.calls.status import Progress, Report, check_progress, shows
from packmech.check import boolean, brief, clear_errors, function, integer, listed, positive, warn
from packmech.ensemble.folder import (
    WORKSPACE,
    FolderError,
    find,
    find_all,
    listed_members,
    make_members,
    prepare,
    read_job,
)
from packmech.ensemble.jobs import (
    Functions,
    check_functions,
    check_parameters,
    check_trusted,
    functions_of,
    job_table,
    run_member,
)
from packmech.ensemble.members import Grid, Member, members_of, part_of
from packmech.ensemble.table import Ensemble, read_ensemble
from packmech.ensemble.worker import INSIDE, Limits, Reply, StartError, Worker, can_limit_memory, carry_out
from packmech.files.paths import PathLike, file_name
from packmech.jit.blas import single_thread
from packmech.jit.interrupts import safe_interrupts

# results of each group as it ended, or the executor's own error
Replies = Iterator[list[Reply] | BaseException]

# for so long the first member is alone, so that what it compiles the others find [s]
_HEAD_START = 60.0
# members that take less than this are given to a process in groups that take about as long [s]
_GROUP_SECONDS = 0.5
# between two attempts at members that another command runs [s]
_BUSY = 0.5
# executors other than this process get groups of members: so many groups at least, and members in a group at most
_GROUPS, _LARGEST_GROUP = 64, 32

# events that stop members running in threads of this process, by the run that they belong to, and their workers
_STOPPING: dict[str, threading.Event] = {}
_WORKERS: dict[str, list[Worker]] = {}
_THREAD = threading.local()


@dataclass
class _MembersDone:
    """What is known of a run of an ensemble while it goes on."""

    of: int
    done: int
    failed: int
    call: Report
    began: float = field(default_factory=time.monotonic)
    ended: int = 0
    busy: int = 0

    def count(self, reply: Reply) -> None:
        """Take note of how a member ended, and call the progress callback."""
        if reply.state == "done":
            self.done += 1
        elif reply.state == "failed":
            self.failed += 1
        self.ended += 1
        self.report(member=reply.id)

    def report(self, **more: str) -> None:
        """Call the progress callback with what is done, the rate and the time left."""
        passed = time.monotonic() - self.began
        rate = self.ended / passed if self.ended and passed > 0.0 else math.nan
        left = (self.of - self.done - self.failed) / rate
        figures = {"done": self.done, "failed": self.failed, "of": self.of, "rate": rate, "seconds_left": left}
        self.call("ensemble", figures | ({"busy": self.busy} if self.busy else {}) | more)

    def words(self) -> str:
        """Return what is finished, and that it stays."""
        return f"{self.done} of {self.of} members are finished and stay; the same call goes on with the rest"


@clear_errors
def run_ensemble(
    job: Any,
    grid: Grid,
    folder: PathLike,
    executor: Executor | None = None,
    *,
    measures: Sequence[Any] | None = None,
    seeding: str = "parameters",
    check: bool = True,
    keep_packings: bool = True,
    load: Sequence[PathLike] = (),
    workers: int | None = None,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    group: int | None = None,
    part: str | None = None,
    retry: bool = False,
    progress: Progress = None,
) -> Ensemble:
    """Run a job for every combination of seeds and parameters, as far as the folder does not have it; return the table.

    Each member has a folder of its own, into which its result is moved when it is whole. Whatever ends this call or any
    of its processes, the same call goes on with what is missing. Members of other grids in the same folder stay.

    Parameters
    ----------
    job
        A scene with a drive: its file, the name of one that ships, or a `pm.Scene`. Or a function at the top of a file,
        or its name as "file.py:name" or "package.module:name", which is called with the parameters by name, and with
        ``random_seed`` and ``folder`` (the member's own) if it takes these; it returns a number, or numbers, texts,
        arrays and packings by name, or a dataclass of them, or a run.
    grid
        Values by the name of the parameter, single ones or lists; every combination is a member. Or a list of such
        tables. Of a scene, "seed" is that of its random start, and other names are paths in its file, such as
        "effects.friction.coefficient" (see `pm.read_scene`).
    folder
        Where all is kept, made if it is not there; a signac project.
    executor
        Any of `concurrent.futures`, whose workers see the folder under the same path; None: processes on this machine.
        Wherever a member runs, it runs in a process started for that, with one thread of numba and BLAS.
    measures
        What is kept of a run: names of its report's figures (as ``packmech jam --json`` writes them) and functions of
        the scene at the end; None: every number that the run reports, counts and moduli.
    seeding
        "parameters": the start of a member is drawn from all its parameters (`random_seed` in the table), so that
        members are independent. "seed": from "seed" alone, so that other parameters are compared on the same starts.
    check
        Whether a run that is no success is a failure.
    keep_packings
        Whether the packing at the end is kept.
    load
        Python files to import first, which register laws, effects, drives, ... of your own.
    workers
        How many processes on this machine; None: one for each core. Not for an executor. 0: none, members run here, one
        after the other; any callable is a job then, such as a closure or a function of a notebook, which the folder
        knows by its name and, as far as can be known, by its code. Limits, which need a process, are refused then.
    time_limit, memory_limit
        Of each member: wall time without compiling [s], and memory of its process [bytes]. A member beyond is ended and
        has failed.
    group
        How many members an executor is given at once; None: it follows from their number.
    part
        "3/100": only the third of a hundred parts, for array jobs. Parts share no member.
    retry
        Whether members that failed are run again.
    progress
        Called as progress("ensemble", figures) with done, failed, of, rate [1/s] and seconds_left, and when a member
        has ended, its id as member.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the folder holds another job.
    OSError
        If the folder cannot be written (a full disk, too), or no process can be started.
    ConnectionError
        If the executor is gone.
    KeyboardInterrupt
        Passed on, and raised at SIGTERM, with `.folder`, and `.finished` of `.wanted` members in it; members that take
        checkpoints have left one.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp()) / "out"
    >>> found = pm.run_ensemble("math:sqrt", [], folder)
    Traceback (most recent call last):
    ...
    ValueError: grid must have at least one member, got none
    >>> grid = {"packing.particles": 16, "seed": range(2)}
    >>> found = pm.run_ensemble("default", grid, folder, measures=["contacts", "bulk_modulus"], workers=1)
    >>> found.counts(), found.results
    ({'done': 2, 'failed': 0, 'missing': 0}, ('contacts', 'bulk_modulus'))
    >>> pm.run_ensemble(lambda x: x**2, {"x": [2, 3]}, folder.with_name("squares"), workers=0)["value"].tolist()
    [4, 9]

    """
    settings = member_settings(executor, workers, time_limit, memory_limit, group, retry, progress)
    kept = {"seeding": seeding, "check": check, "keep_packings": keep_packings, "load": load}
    return _with_warning(complete_members(job, grid, folder, settings, measures=measures, part=part, **kept))


class Made(NamedTuple):
    """The folder of an ensemble, and the members that a call was to run."""

    folder: Path
    members: Sequence[Member]


def complete_members(
    job: Any,
    grid: Grid,
    folder: PathLike,
    settings: MemberSettings,
    *,
    measures: Sequence[Any] | None = None,
    part: str | None = None,
    **kept: Any,
) -> Made:
    """Run what is missing of a grid; arguments as of `run_ensemble`, `kept` those of `job_table`."""
    here = settings.workers == 0
    place = _folder(folder, here)
    members = part_of(members_of(grid), part)
    table = job_table(job, measures=measures, here=here, **kept)
    functions = functions_of(job, measures) if here else {}
    if members:
        check_parameters(table, members[0], functions)
    prepare(place, table)
    make_members(place, members)
    _complete(place, members, settings, functions)
    return Made(place, members)


@clear_errors
def resume_ensemble(
    folder: PathLike,
    executor: Executor | None = None,
    *,
    members: Sequence[str] | None = None,
    workers: int | None = None,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    group: int | None = None,
    part: str | None = None,
    retry: bool = False,
    trust: bool = False,
    progress: Progress = None,
) -> Ensemble:
    """Run what is missing of the members that a folder has, with the job that it names; return the table.

    Parameters
    ----------
    folder
        That of `run_ensemble`.
    members
        Names of the folders of those that are meant; None: all.
    trust
        Whether to run code that the folder names: a function, measures or files to load that are not packmech's own.
        A folder of somebody else's may name any function that Python can import.
    executor, workers, time_limit, memory_limit, group, part, retry, progress
        As in `run_ensemble`.

    Raises
    ------
    FileNotFoundError, ValueError
        If the folder is none of an ensemble, has no such member, or names code that is not trusted; else as
        `run_ensemble`.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp()) / "out"
    >>> found = pm.run_ensemble("default", {"packing.particles": 16, "seed": range(2)}, folder, part="1/2", workers=1)
    >>> len(found), len(pm.resume_ensemble(folder))
    (1, 1)

    """
    settings = member_settings(executor, workers, time_limit, memory_limit, group, retry, progress)
    return _with_warning(complete_folder(folder, settings, members=members, part=part, trust=trust))


def complete_folder(
    folder: PathLike,
    settings: MemberSettings,
    *,
    members: Sequence[str] | None = None,
    part: str | None = None,
    trust: bool = False,
) -> Made:
    """Run what is missing of the members that a folder has; arguments as of `resume_ensemble`."""
    place = _folder(folder, settings.workers == 0)
    boolean("trust", trust)
    job = read_job(place)
    check_trusted(job, trust)
    check_functions(job)
    there = listed_members(place)
    if members is not None:
        known = {one.id: one for one in there}
        names = listed("members", members, "names of folders")
        unknown = [brief(name) for name in names if not isinstance(name, str) or name not in known]
        if unknown:
            more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
            raise ValueError(f"members must be folders in {place}, got {', '.join(unknown[:3])}{more}")
        there = [known[name] for name in names]
    wanted = part_of(there, part)
    _complete(place, wanted, settings, {})
    return Made(place, wanted)


def _with_warning(made: Made) -> Ensemble:
    """Return the ensemble; warn of members of this call that failed, which have no results."""
    failures = [failure for one in made.members if (failure := find(made.folder, one).failure)]
    if failures:
        first = failures[0]
        warn(
            f"{len(failures)} of {len(made.members)} members failed, the first with {first.get('reason', '')}: "
            f"{first.get('message', '')!s:.200}; retry=True runs them again, and the column traceback says where"
        )
    return read_ensemble(made.folder)


def _folder(folder: Any, here: bool) -> Path:
    place = file_name("folder", folder, "a folder's name")
    if os.environ.get(INSIDE) and not here:
        raise ValueError(
            "job must not run an ensemble itself, unless with workers 0; a script that does needs its call below "
            "if __name__ == '__main__':"
        )
    return place.absolute()


@dataclass(frozen=True)
class MemberSettings:
    """How members are run."""

    executor: Executor | None
    workers: int
    limits: Limits
    group: int | None
    retry: bool
    progress: Progress


def member_settings(
    executor: Any = None,
    workers: Any = None,
    time_limit: Any = None,
    memory_limit: Any = None,
    group: Any = None,
    retry: Any = False,
    progress: Any = None,
) -> MemberSettings:
    """Return how members are run, after checking it."""
    if workers is not None:
        integer("workers", workers, at_least=0)
    if workers == 0:
        for name, value in (("time_limit", time_limit), ("memory_limit", memory_limit), ("group", group)):
            if value is not None:
                raise ValueError(f"{name} must be left out with workers 0, which runs members in this process")
    if executor is not None:
        if isinstance(executor, type):
            raise TypeError(f"executor must be an executor, not its class, got {brief(executor)}")
        function("executor.submit", getattr(executor, "submit", None))
        if workers is not None:
            raise ValueError(f"workers must be left out where an executor is given, got {brief(workers)}")
    if memory_limit is not None and not can_limit_memory():
        raise ValueError("memory_limit must be left out on a system that does not say what a process takes")
    check_progress(progress)
    boolean("retry", retry)
    return MemberSettings(
        executor,
        _cores() if workers is None else workers,
        Limits(
            math.inf if time_limit is None else positive("time_limit", time_limit),
            math.inf if memory_limit is None else positive("memory_limit", memory_limit),
        ),
        None if group is None else integer("group", group, at_least=1),
        retry,
        progress,
    )


def _cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _complete(folder: Path, members: Sequence[Member], settings: MemberSettings, functions: Functions) -> None:
    """Run the members that are missing, and those that failed if they are to be run again."""
    states = {one.member.id: one.state for one in find_all(folder, members)}
    waiting = [one for one in members if states[one.id] == "missing" or (settings.retry and states[one.id] == "failed")]
    failed = 0 if settings.retry else sum(state == "failed" for state in states.values())
    with shows("ensemble", settings.progress) as report:
        known = _MembersDone(len(members), sum(state == "done" for state in states.values()), failed, report)
        known.report()
        if not waiting:
            return
        try:
            _run(folder, waiting, settings, functions, known)
        except KeyboardInterrupt as stop:
            # for whoever says what stays, if the folder does
            stop.folder, stop.finished, stop.wanted = folder, known.done, known.of  # type: ignore[attr-defined]
            raise


def _run(
    folder: Path, waiting: Sequence[Member], settings: MemberSettings, functions: Functions, known: _MembersDone
) -> None:
    """Run members here, or in other processes."""
    if settings.workers == 0:
        with single_thread(), safe_interrupts():
            _until_none_is_busy(waiting, lambda some: _here(folder, some, settings.retry, functions), known)
        return
    token = uuid.uuid4().hex
    stopping = _STOPPING[token] = threading.Event()
    workers = _WORKERS[token] = []
    local = settings.executor is None
    threads = min(settings.workers, len(waiting))
    engine = settings.executor or ThreadPoolExecutor(threads)
    pending: set[Future[list[Reply]]] = set()

    def size() -> int:
        """Return how many members a group gets."""
        if settings.group is not None:
            return settings.group
        if not local:
            return min(_LARGEST_GROUP, max(1, len(waiting) // _GROUPS))
        # so many that a process is busy while its next group is on the way; single ones where they take long
        taken = (time.monotonic() - known.began) * threads / max(known.ended, 1)
        return max(1, min(_LARGEST_GROUP, int(_GROUP_SECONDS / taken))) if known.ended >= threads else 1

    try:
        with safe_interrupts():
            given = (str(folder), settings.limits, settings.retry, token)
            shared = threads if local else 0
            _until_none_is_busy(waiting, lambda some: _replies(engine, some, size, given, pending, shared), known)
    finally:
        stopping.set()
        for one in pending:
            one.cancel()
        if local:
            engine.shutdown(wait=True, cancel_futures=True)
        for worker in workers:
            worker.close()
        del _STOPPING[token], _WORKERS[token]


def _until_none_is_busy(
    members: Sequence[Member],
    run: Callable[[Sequence[Member]], Iterator[list[Reply] | BaseException]],
    known: _MembersDone,
) -> None:
    """Run members, and those that another command ran meanwhile again, which finds them finished or has them to run."""
    while members:
        busy = _taken(run(members), known)
        members = [one for one in members if one.id in busy]
        if members:
            known.busy = len(members)
            known.report()
            time.sleep(_BUSY)


def _here(folder: Path, members: Sequence[Member], retry: bool, functions: Functions) -> Replies:
    """Run members in this process, one after the other, and give how each ended."""
    table = read_job(folder)
    for one in members:
        run = partial(run_member, table, one, folder / WORKSPACE / one.id, functions)
        yield [carry_out(folder, one, run, retry=retry)]


def _replies(
    engine: Executor,
    members: Sequence[Member],
    size: Callable[[], int],
    settings: tuple[str, Limits, bool, str],
    pending: set[Future[list[Reply]]],
    threads: int,
) -> Replies:
    """Yield the results of each group as it ends, and the executor's own errors.

    Threads of this process get two groups each at a time, and the first of them a head start; other executors all.
    """
    finished: queue.SimpleQueue[Future[list[Reply]]] = queue.SimpleQueue()
    given = 0

    def submit() -> Future[list[Reply]]:
        nonlocal given
        group = members[given : given + size()]
        given += len(group)
        future: Future[list[Reply]] = engine.submit(run_group, group, *settings)
        pending.add(future)
        future.add_done_callback(finished.put)
        return future

    try:
        first = submit()
        if threads > 1:
            # the other threads start their processes meanwhile
            for _ in range(threads - 1):
                engine.submit(run_group, [], *settings)
            wait([first], _HEAD_START)
        while pending:
            while given < len(members) and (not threads or len(pending) < 2 * threads):
                submit()
            future = finished.get()
            pending.discard(future)
            yield future.result()
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        # a cancelled future's error is no Exception in every library
        yield error


def _taken(replies: Replies, known: _MembersDone) -> set[str]:
    """Count the results of the members; return those that another command runs.

    Raises
    ------
    FolderError, StartError
        If a member's process could not write, or not be started.
    ConnectionError
        If the executor is gone.

    """
    busy: set[str] = set()
    for found in replies:
        if isinstance(found, StartError):
            raise found
        if isinstance(found, BaseException):
            raise ConnectionError(
                f"executor must live until all members are finished, got {type(found).__name__}: {found}; "
                f"{known.words()}"
            ) from found
        for reply in found:
            if reply.state == "folder":
                raise FolderError(f"{reply.message}; {known.words()}")
            if reply.state == "stopped":
                raise KeyboardInterrupt
            if reply.state == "busy":
                busy.add(reply.id)
            else:
                known.count(reply)
    return busy


def run_group(members: Sequence[Member], folder: str, limits: Limits, retry: bool, token: str) -> list[Reply]:
    """Run some members one after the other in the process that belongs to this thread; return how each ended.

    This is what an executor runs. It needs the folder and no more than names.
    """
    stopping = _STOPPING.get(token)
    worker: Worker | None = getattr(_THREAD, "worker", None)
    if worker is None or getattr(_THREAD, "token", None) != token and stopping is not None:
        worker = _THREAD.worker = Worker()
        _THREAD.token = token
        if token in _WORKERS:
            _WORKERS[token].append(worker)
    stopping = stopping or threading.Event()
    if not members:
        worker.start(stopping)
    return worker.run(Path(folder), members, limits, stopping, retry=retry)
