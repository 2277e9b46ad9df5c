"""Commands that are killed at random times and given again, and what is wrong with how they end.

    python tests/fuzz/kills.py [--seed 0] [--kills 500] [--only PATTERN ...]

`packmech run` with a checkpoint and `packmech ensemble` are ended by SIGKILL or SIGTERM at random times and given
again until they end by themselves. That is well where the results are, bit for bit, those of a command that nobody
disturbed, what was finished is never written again, every file that is in place can be read, and no half-written file
stays. Commands run in children of this process, which has loaded what they need; checkpoints are written many times a
second in place of twice a minute.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "envs"), str(ROOT / "tests")]

import packmech as pm  # noqa: E402
from packmech import cli  # noqa: E402
from packmech.loop import run_loop  # noqa: E402
from packmech.loop.checkpoint import fingerprint  # noqa: E402

# between two checkpoints, and after which a half-written file is one that nobody writes any more [s]
WRITE_EVERY, FORGOTTEN = 0.02, 61.0
# longest time of a command that nobody disturbs [s]
LONGEST = 300.0

_SCENE = """
[packing]
kind = "random"
particles = 40
dimension = 2
packing_fraction = 0.9
seed = 1
[[effects]]
kind = "repulsion"
law = "linear-spring"
[[effects]]
kind = "friction"
coefficient = 0.5
stiffness = 0.5
damping = 0.1
[[effects]]
kind = "contact-damping"
coefficient = 0.1
"""
_DRIVES = {
    "simulate": '[drive]\nkind = "simulate"\nsteps = 60_000\ndt = 0.05\n',
    "steady shear": '[drive]\nkind = "steady-shear"\nrates = [0.1, 0.2]\napplied_strain = 40.0\nskip_strain = 10.0\n',
}
_JOB = """
import numpy as np


def drawn(seed):
    rng = np.random.default_rng(seed)
    return {"value": float(rng.normal()), "array": rng.normal(size=5)}
"""


class Command(NamedTuple):
    """A command that goes on where it was: its words, what must be in its folder, and what its results are."""

    words: list[str]
    prepare: Callable[[Path], None]
    results: Callable[[Path], str]


def _numbers(value: Any) -> Any:
    """Return what a command wrote without what it cost."""
    if isinstance(value, dict):
        return [(name, _numbers(one)) for name, one in value.items() if "seconds" not in name and name != "stages"]
    return value


def _of_run(folder: Path) -> str:
    packing = pm.read_packing(folder / "end.npz")
    arrays = packing.position_nd, packing.radius_n, packing.box.lattice_dd
    return fingerprint((*arrays, _numbers(json.loads((folder / "end.json").read_text()))))


def _of_ensemble(folder: Path) -> str:
    found = pm.read_ensemble(folder / "ensemble")
    return fingerprint([(name, list(found[name])) for name in found.columns if name not in ("seconds", "id")])


def _scene(drive: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "scene.toml").write_text(_SCENE + drive) and None


_RUN = ["run", "scene.toml", "--checkpoint", "run.npz", "--out", "end.npz", "--json", "end.json"]
COMMANDS = {
    **{name: Command(_RUN, _scene(drive), _of_run) for name, drive in _DRIVES.items()},
    "ensemble": Command(
        ["ensemble", "job.py:drawn", "--seeds", "0:40", "--folder", "ensemble", "--workers", "1"],
        lambda folder: (folder / "job.py").write_text(_JOB) and None,
        _of_ensemble,
    ),
}


def start(words: list[str], folder: Path) -> int:
    """Give a command in a folder, in a child with a process group of its own; return its number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        run_loop._WRITE_EVERY = WRITE_EVERY
        sys.argv = ["packmech", *words]
        cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.stdout.flush()
        os._exit(code)


def wait(child: int, seconds: float) -> int | None:
    """Return how a child ended within a time, as subprocess says it; None where it has not."""
    until = time.monotonic() + seconds
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() >= until:
            return None
        time.sleep(0.002)


def _end(child: int, how: signal.Signals, seconds: float) -> int:
    """Send a signal to the group of a child and return how it ended."""
    with suppress(ProcessLookupError):
        os.killpg(child, how)
    code = wait(child, seconds)
    if code is None:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        wait(child, LONGEST)
        return 1 << 10
    return code


def half_written(folder: Path) -> list[str]:
    """Return the names of files that are being written, or were."""
    return sorted(str(one.relative_to(folder)) for one in folder.rglob(".*.*") if len(one.name) > 33)


def _age(folder: Path) -> None:
    """Have half-written files look as if nobody had touched them for a minute."""
    for name in half_written(folder):
        past = time.time() - FORGOTTEN
        with suppress(FileNotFoundError):
            os.utime(folder / name, (past, past))


def _finished(folder: Path) -> dict[str, tuple[int, int]]:
    """Return what marks each result of an ensemble that is in place: the file itself and when it was written."""
    found = {str(one): one.stat() for one in folder.glob("ensemble/workspace/*/result.json")}
    return {name: (one.st_ino, one.st_mtime_ns) for name, one in found.items()}


class Right(NamedTuple):
    """How a command ends that nobody disturbs: its results, how long it takes [s], and its exit code."""

    results: str
    seconds: float
    code: int


def undisturbed(command: Command, folder: Path) -> Right:
    """Return how a command ends that nobody disturbs."""
    folder.mkdir()
    command.prepare(folder)
    began = time.monotonic()
    code = wait(start(command.words, folder), LONGEST)
    # of a flow that was not steady the results are whole, too
    if code not in (cli.OK, cli.FAILED):
        raise RuntimeError(f"undisturbed, it ended with {code}: {(folder / 'said').read_text()}")
    return Right(command.results(folder), time.monotonic() - began, code)


def killed(command: Command, folder: Path, right: Right, kills: int, rng: np.random.Generator) -> tuple[int, list[str]]:
    """Give a command, kill it up to so often, and let it end; return how often it was killed and what is wrong."""
    folder.mkdir()
    command.prepare(folder)
    faults: list[str] = []
    done, kept = 0, _finished(folder)
    while done < kills:
        child = start(command.words, folder)
        code = wait(child, rng.uniform(0.0, 1.1 * right.seconds))
        if code is not None:
            break
        how = (signal.SIGKILL, signal.SIGTERM)[int(rng.integers(2))]
        code = _end(child, how, LONGEST)
        done += 1
        # one that was asked to end before it listens is killed; one that has just ended has ended well
        if code not in (-signal.SIGKILL, -signal.SIGTERM, cli.INTERRUPTED, right.code):
            faults.append(f"{how.name}: it ended with {code}: {(folder / 'said').read_text()[-300:]}")
        _age(folder)
        now = _finished(folder)
        if any(now.get(name) != one for name, one in kept.items()):
            faults.append(f"{how.name}: a result that was finished is another")
        kept = now
    code = wait(start(command.words, folder), LONGEST)
    if code != right.code:
        faults.append(f"given again, it ended with {code}: {(folder / 'said').read_text()[-300:]}")
    elif command.results(folder) != right.results:
        faults.append("its results are others than undisturbed")
    if half_written(folder):
        faults.append(f"half-written files stay: {', '.join(half_written(folder))}")
    now = _finished(folder)
    if any(now.get(name) != one for name, one in kept.items()):
        faults.append("a result that was finished is another in the end")
    shutil.rmtree(folder)
    return done, faults


def load(folder: Path) -> None:
    """Load into this process what the commands of its children need."""
    here = Path.cwd()
    for k, drive in enumerate(_DRIVES.values()):
        made = folder / f"load-{k}"
        made.mkdir()
        short = drive.replace("60_000", "10").replace("40.0", "1.0").replace("10.0", "0.1")
        _scene(short)(made)
        os.chdir(made)
        try:
            cli.execute(_RUN)
        finally:
            os.chdir(here)


def main() -> int:
    """Kill commands so often as is asked for and print the faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end after so much time")
    parser.add_argument("--only", nargs="*", default=["*"])
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    names = [name for name in COMMANDS if any(fnmatch.fnmatch(name, pattern) for pattern in asked.only)]
    total, rounds, faults = dict.fromkeys(names, 0), 0, 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        load(folder)
        right = {name: undisturbed(COMMANDS[name], folder / f"right-{k}") for k, name in enumerate(names)}
        until = time.monotonic() + asked.seconds
        while sum(total.values()) < asked.kills and time.monotonic() < until:
            name = names[rounds % len(names)]
            left = min(asked.kills - sum(total.values()), 1 + int(rng.integers(6)))
            done, wrong = killed(COMMANDS[name], folder / f"round-{rounds}", right[name], left, rng)
            total[name], rounds, faults = total[name] + done, rounds + 1, faults + len(wrong)
            for one in wrong:
                print(f"{name}, round {rounds}: {one}", flush=True)
    print(f"{sum(total.values())} kills in {rounds} rounds, {faults} faults; {total}")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
