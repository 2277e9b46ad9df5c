"""A process that runs members one after the other, and who watches it: limits of time and memory, ends of all kinds.

`Worker` starts ``python -m packmech.ensemble.worker`` and talks to it in lines of JSON. The process writes results
itself, so that nothing of a finished member is in memory anywhere; who watches it learns only how the member ended, and
records what the process cannot: that it was ended.
"""

from __future__ import annotations

import contextlib
import errno
import faulthandler
import functools
import json
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from numba.core import event

import packmech
from packmech.ensemble.folder import (
    JOB,
    WORKSPACE,
    FolderError,
    MemberOutcome,
    claimed,
    find,
    read_job,
    remove_leftovers,
    write_failure,
    write_outcome,
)
from packmech.ensemble.jobs import is_installed, run_member
from packmech.ensemble.members import Member
from packmech.jit.blas import single_thread
from packmech.jit.interrupts import safe_interrupts

# one thread for each process: members are what is spread over cores
_THREADS = (
    "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)  # fmt: skip
# set in the process, whose job must not start an ensemble again
INSIDE = "PACKMECH_ENSEMBLE_MEMBER"
# between two looks at a process: at its memory, at whether to stop [s]
_LOOK = 0.05
# until a process must be ready; for a member that was asked to stop to leave a checkpoint [s]
_START, _GRACE = 300.0, 10.0
# a member whose process ends so often, for no reason that is known, has failed
ATTEMPTS = 3
# reasons of failures that are not the job's own exceptions; after these no further attempt is made
_TIME, _MEMORY, _ENDED, _INTERRUPTED = "time limit", "memory limit", "process ended", "interrupted"
_FINAL = (_TIME, _MEMORY)
# a process that is asked for nothing ends [s]
_IDLE = 120.0
# of what a process wrote to standard error, the end is kept [bytes]
_TAIL = 4000
# errors of the file system that are no fault of a job
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


@dataclass(frozen=True)
class Limits:
    """What a member may take: wall time without compiling [s], and memory of its process [bytes]."""

    seconds: float = math.inf
    memory: float = math.inf


@dataclass(frozen=True)
class Reply:
    """How a member ended: "done", "failed", "busy" (another command runs it), "stopped", "folder" (not writable)."""

    id: str
    state: str
    message: str = ""


class StartError(OSError):
    """No process for members could be started: no fault of a member, and the end of the command."""


class Worker:
    """Who watches a process that runs members; the process is started when there is something to run."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._errors = tempfile.NamedTemporaryFile(prefix="packmech-", suffix=".log")  # noqa: SIM115 - lives as long
        self._unread = b""

    def run(
        self,
        folder: Path,
        members: Sequence[Member],
        limits: Limits,
        stopping: threading.Event,
        *,
        retry: bool = False,
    ) -> list[Reply]:
        """Run members one after the other; return how each ended, after recording it.

        The process has all requests at once, so that it need not wait for who watches. The list is shorter where the
        work stopped.

        Raises
        ------
        StartError
            If no process can be started.

        """
        replies: list[Reply] = []
        attempts = 0
        while len(replies) < len(members):
            waiting = members[len(replies) :]
            found, failure = self._attempt(folder, waiting, limits, stopping, retry)
            replies += found
            attempts = 0 if found else attempts
            if failure is None:
                break
            attempts += 1
            if failure["reason"] in _FINAL or attempts == ATTEMPTS:
                replies.append(self._record(folder, members[len(replies)], failure))
                attempts = 0
            else:
                # what ended the process may be about to end this one
                stopping.wait(0.2)
        if stopping.is_set() and len(replies) < len(members):
            replies.append(Reply(members[len(replies)].id, "stopped"))
        return replies

    def _record(self, folder: Path, member: Member, failure: dict[str, str]) -> Reply:
        """Write why a member failed whose process could not; it may have finished in the last moment."""
        if failure["reason"] == _INTERRUPTED:
            return Reply(member.id, "stopped")
        try:
            with claimed(folder, member) as own:
                if not own:
                    return Reply(member.id, "busy")
                if find(folder, member).state == "done":
                    return Reply(member.id, "done")
                write_failure(folder, member, failure)
        except FolderError as error:
            return Reply(member.id, "folder", str(error))
        return Reply(member.id, "failed", f"{failure['reason']}: {failure['message']}")

    def _attempt(
        self, folder: Path, members: Sequence[Member], limits: Limits, stopping: threading.Event, retry: bool
    ) -> tuple[list[Reply], dict[str, str] | None]:
        """Let the process run members; return what it said of them, and what ended it in the one after these."""
        replies: list[Reply] = []
        process = self._started(stopping)
        if process is None:
            return replies, None
        assert process.stdin is not None
        os.ftruncate(self._errors.fileno(), 0)
        requests = [{"folder": str(folder), "member": asdict(one), "retry": retry} for one in members]
        try:
            process.stdin.write(b"".join(json.dumps(one).encode() + b"\n" for one in requests))
            process.stdin.flush()
        except OSError:
            return replies, self._ended()
        # of the member that runs: when it began, how long it compiled, since when it does
        began, paused, since = time.monotonic(), 0.0, None
        while True:
            line = self._line(_LOOK)
            now = time.monotonic()
            if line and "state" in line and line["state"] != _INTERRUPTED:
                replies.append(Reply(members[len(replies)].id, line["state"], line.get("message", "")))
                if len(replies) == len(members) or line["state"] == "folder":
                    return replies, None
                began, paused, since = now, 0.0, None
                os.ftruncate(self._errors.fileno(), 0)
                continue
            if stopping.is_set():
                self.stop()
                return replies, None
            if line is None:
                return replies, self._ended()
            if "state" in line:
                self._kill()
                return replies, _failure(_INTERRUPTED, "the process that ran it was asked to stop", "")
            if "compiling" in line:
                if line["compiling"]:
                    since = now
                elif since is not None:
                    paused, since = paused + now - since, None
            if (since or now) - began - paused > limits.seconds:
                return replies, self._over(_TIME, f"it ran for more than {limits.seconds:g} s")
            if limits.memory < math.inf:
                memory = _memory(process.pid)
                if memory > limits.memory:
                    limit = f"{limits.memory / 1e6:.0f} MB"
                    return replies, self._over(_MEMORY, f"its process took {memory / 1e6:.0f} MB, more than {limit}")

    def start(self, stopping: threading.Event) -> None:
        """Start the process ahead of the first member."""
        self._started(stopping)

    def _started(self, stopping: threading.Event) -> subprocess.Popen[bytes] | None:
        """Return the process, after starting it if there is none; None if the work is to stop."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        for _ in range(ATTEMPTS):
            self._spawn()
            deadline = time.monotonic() + _START
            while time.monotonic() < deadline:
                line = self._line(_LOOK)
                if stopping.is_set():
                    self._kill()
                    return None
                if line is None:
                    break
                if line.get("ready"):
                    return self._process
            said = self._said()
            self._kill()
        raise StartError(f"no process for members could be started; the last one said: {said or 'nothing'}")

    def _spawn(self) -> None:
        self._kill()
        env = dict(os.environ) | dict.fromkeys(_THREADS, "1") | {INSIDE: "1"}
        home = Path(packmech.__file__).parents[1]
        if not is_installed(home / packmech.__name__):
            env["PYTHONPATH"] = os.pathsep.join(filter(None, [str(home), env.get("PYTHONPATH")]))
        self._unread = b""
        errors = os.open(self._errors.name, os.O_WRONLY | os.O_APPEND)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=env,
            )
        finally:
            os.close(errors)

    def _line(self, seconds: float) -> dict[str, Any] | None:
        """Return the next line that the process wrote, {} if there is none so soon, None if there will be none."""
        process = self._process
        assert process is not None and process.stdout is not None
        if b"\n" not in self._unread:
            if not select.select([process.stdout], [], [], seconds)[0]:
                return {}
            more = os.read(process.stdout.fileno(), 65536)
            if not more:
                return None
            self._unread += more
        line, found, rest = self._unread.partition(b"\n")
        if not found:
            return {}
        self._unread = rest
        return dict(json.loads(line))

    def _ended(self) -> dict[str, str]:
        """Say how a process ended that was not ended here."""
        process = self._process
        assert process is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1.0)
        code = process.poll()
        how = f"with code {code}" if code is None or code >= 0 else f"by {signal.Signals(-code).name}"
        hint = ", as a system does that is out of memory" if code == -signal.SIGKILL else ""
        said = self._said()
        self._kill()
        return _failure(_ENDED, f"the process that ran it ended {how}{hint}, {ATTEMPTS} times", said)

    def _over(self, reason: str, message: str) -> dict[str, str]:
        """End a process that goes beyond a limit; say where it was."""
        process = self._process
        assert process is not None
        process.send_signal(signal.SIGUSR1)  # writes where every thread is
        time.sleep(_LOOK)
        said = self._said()
        self._kill()
        return _failure(reason, message, said)

    def _said(self) -> str:
        """Return the end of what the process wrote to standard error."""
        with open(self._errors.name, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - _TAIL))
            return file.read().decode(errors="replace").strip()

    def stop(self) -> None:
        """Tell the process to stop, which leaves a checkpoint where the job has them; end it if it does not."""
        process = self._process
        if process is None:
            return
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE)
        self._kill()

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """End the process, which runs nothing, and forget it."""
        self._kill()
        self._errors.close()


def _failure(reason: str, message: str, said: str) -> dict[str, str]:
    """Return the row of a failure."""
    return {"reason": reason, "message": message, "traceback": said}


def can_limit_memory() -> bool:
    """Whether this system says how much memory a process takes."""
    return Path("/proc/self/statm").exists()


def _memory(pid: int) -> float:
    """Return the memory that a process has in use [bytes]; 0 when it is gone."""
    try:
        resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return float(resident * os.sysconf("SC_PAGE_SIZE"))


# what follows runs in the process


class _Requests:
    """Requests as they come, and the end of the process when no requests can come any more."""

    def __init__(self) -> None:
        self._arrived = threading.Condition()
        self._lines: list[bytes] = []
        self._ended = False
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        rest = b""
        while more := os.read(0, 1 << 16):
            *lines, rest = (rest + more).split(b"\n")
            with self._arrived:
                self._lines += lines
                self._arrived.notify()
        with self._arrived:
            self._ended = True
            self._arrived.notify()
        # whoever watched is gone: stop as after SIGTERM, and do not wait forever
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE)
        os._exit(1)

    def next(self) -> dict[str, Any] | None:
        """Return the next request; None if there will be none."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._lines or self._ended, _IDLE)
            return dict(json.loads(self._lines.pop(0))) if self._lines else None


class _Compiling(event.Listener):  # type: ignore[misc]
    """Says when code is compiled or loaded, which is not the member's own time."""

    def __init__(self, answer: Callable[..., None]) -> None:
        self._answer, self._depth = answer, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._answer(compiling=True)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._answer(compiling=False)


def main() -> None:
    """Run members as they are asked for, until none is."""
    # what jobs print goes where errors go
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    faulthandler.enable()
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.default_int_handler)

    def answer(**what: Any) -> None:
        answers.write(json.dumps(what) + "\n")

    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        requests = _Requests()
        answer(ready=True)
        with event.install_listener("numba:compiler_lock", _Compiling(answer)), single_thread(), safe_interrupts():
            _serve(requests, answer)
    sys.stdout.flush()
    # the thread that reads is in a system call, which an ordinary end would wait for
    os._exit(0)


def _serve(requests: _Requests, answer: Callable[..., None]) -> None:
    while (request := requests.next()) is not None:
        member = Member(**request["member"])
        folder = Path(request["folder"])

        def run(folder: Path = folder, member: Member = member) -> MemberOutcome:
            return run_member(_job(folder, (folder / JOB).stat().st_mtime_ns), member, folder / WORKSPACE / member.id)

        try:
            reply = carry_out(folder, member, run, retry=request["retry"])
            answer(state=reply.state, message=reply.message)
        except KeyboardInterrupt:
            answer(state="interrupted")
            return


@functools.lru_cache(maxsize=4)
def _job(folder: Path, written: int) -> dict[str, Any]:
    """Return what the members of a folder run, as it was written at this time."""
    return read_job(folder)


def carry_out(folder: Path, member: Member, run: Callable[[], MemberOutcome], *, retry: bool) -> Reply:
    """Run a member in this process unless it is finished or somebody else's; return how it ended, after recording it.

    Raises
    ------
    KeyboardInterrupt
        Passed on; nothing is recorded then.

    """
    try:
        with claimed(folder, member) as own:
            if not own:
                return Reply(member.id, "busy")
            known = find(folder, member)
            if known.state == "done":
                return Reply(member.id, "done")
            if known.failure is not None and not retry:
                return Reply(member.id, "failed", f"{known.failure['reason']}: {known.failure['message']}")
            remove_leftovers(folder, member, checkpoint=known.failure is not None)
            try:
                outcome = run()
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                if isinstance(error, OSError) and error.errno in _FULL:
                    return Reply(member.id, "folder", f"{folder} could not be written: {error}")
                failure = _failure(type(error).__name__, str(error) or repr(error), traceback.format_exc())
                write_failure(folder, member, failure)
                return Reply(member.id, "failed", f"{failure['reason']}: {failure['message']}")
            write_outcome(folder, member, outcome)
    except FolderError as error:
        return Reply(member.id, "folder", str(error))
    return Reply(member.id, "done")


if __name__ == "__main__":
    main()
