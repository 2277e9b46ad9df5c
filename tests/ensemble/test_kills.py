"""SIGKILL at random times: every row is there once in the end, bit for bit, and nothing finished is run again."""

import os
import pathlib
import signal
import time

import pytest

import packmech as pm


def finished(folder):
    """Return what marks every result that is in place: the file itself and when it was written."""
    found = {}
    for path in pathlib.Path(folder).glob("workspace/*/result.json"):
        state = path.stat()
        found[path.parent.name] = (state.st_ino, state.st_mtime_ns, path.read_bytes())
    return found


@pytest.fixture
def ensemble(tmp_path, job, rows, called):
    """Return a function of the number of members and the time that each takes.

    It gives the words of a command, its folder, a function that checks that what is finished stays, and one that checks
    the folder against an undisturbed run.
    """

    def make(members, wait):
        grid = {"log": str(tmp_path / "log"), "wait": wait, "seed": range(members)}
        folder = tmp_path / "out"
        words = [job("counted"), "--seeds", f"0:{members}", "--grid", f"log={tmp_path / 'log'}", f"wait={wait}"]
        words += ["--folder", folder, "--workers", 2]
        kept = {}

        def keep():
            now = finished(folder)
            # what was in place before is the same file still
            assert {name: now.get(name) for name in kept} == kept
            kept.update(now)
            return len(now)

        def check(process):
            out, error = process.communicate(timeout=300)
            assert process.returncode == 0, error
            assert f"{members} done, 0 failed, 0 missing" in out
            keep()
            undisturbed = pm.run_ensemble(called("counted"), grid, tmp_path / "undisturbed", workers=2)
            found = pm.read_ensemble(folder)
            assert rows(found) == rows(undisturbed)
            assert len({one.id for one in found.members}) == len(found) == members
            assert not [path for path in folder.rglob(".*") if path.name != ".signac"]

        return words, folder, keep, check

    return make


def kill_groups(kills, ensemble, command, wait_until, rng):
    """Kill the whole process group of the command so often, each time once some more is finished, then let it end."""
    words, folder, keep, check = ensemble
    for _ in range(kills):
        before = keep()
        process = command(*words)
        # at any time of its life: while it starts, while members begin, in the middle, or as it ends
        if rng.random() < 0.8:
            wait_until(
                lambda process=process, before=before: len(finished(folder)) > before or process.poll() is not None
            )
            time.sleep(rng.uniform(0.0, 0.3))
        else:
            time.sleep(rng.uniform(0.0, 3.0))
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
        keep()
    check(command(*words))


def kill_workers(kills, ensemble, command, children, wait_until, rng):
    """Kill single processes that run members while the command goes on."""
    words, folder, keep, check = ensemble
    process = command(*words)
    killed = 0
    while killed < kills and process.poll() is None:
        before = len(finished(folder))
        wait_until(lambda before=before: len(finished(folder)) > before or process.poll() is not None)
        time.sleep(rng.uniform(0.0, 0.1))
        there = children(process.pid)
        if there:
            try:
                os.kill(int(rng.choice(there)), signal.SIGKILL)
                killed += 1
            except ProcessLookupError:
                pass
        keep()
    assert killed == kills
    check(process)


def test_two_kills_of_the_group_lose_nothing(ensemble, command, wait_until, rng):
    kill_groups(2, ensemble(40, 0.05), command, wait_until, rng)


def test_two_kills_of_workers_are_repaired_by_the_command(ensemble, command, children, wait_until, rng):
    kill_workers(2, ensemble(40, 0.1), command, children, wait_until, rng)


@pytest.mark.slow
def test_twelve_kills_of_the_group_lose_nothing(ensemble, command, wait_until, rng):
    kill_groups(12, ensemble(60, 0.05), command, wait_until, rng)


@pytest.mark.slow
def test_twelve_kills_of_workers_are_repaired_by_the_command(ensemble, command, children, wait_until, rng):
    kill_workers(12, ensemble(200, 0.4), command, children, wait_until, rng)
