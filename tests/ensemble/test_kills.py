"""SIGKILL at random times: every row is there once in the end, bit for bit, and nothing finished is run again."""

import os
import pathlib
import signal
import time

import pytest

import packmech as pm

MEMBERS = 40


def finished(folder):
    """Return what marks every result that is in place: the file itself and when it was written."""
    found = {}
    for path in pathlib.Path(folder).glob("workspace/*/result.json"):
        state = path.stat()
        found[path.parent.name] = (state.st_ino, state.st_mtime_ns, path.read_bytes())
    return found


@pytest.fixture
def ensemble(tmp_path, command, job, rows, called):
    """Return the words of a command, its folder, and a check of that folder against an undisturbed run."""
    grid = {"log": str(tmp_path / "log"), "wait": 0.05, "seed": range(MEMBERS)}
    folder = tmp_path / "out"
    words = [job("counted"), "--seeds", f"0:{MEMBERS}", "--grid", f"log={tmp_path / 'log'}", "wait=0.05"]
    words += ["--folder", folder, "--workers", 2]
    kept = {}

    def keep():
        now = finished(folder)
        # what was in place before is the same file still
        assert {name: now.get(name) for name in kept} == kept
        kept.update(now)
        return len(now)

    def check():
        keep()
        undisturbed = pm.run_ensemble(called("counted"), grid, tmp_path / "undisturbed", workers=2)
        assert rows(pm.read_ensemble(folder)) == rows(undisturbed)
        assert len({one.id for one in pm.read_ensemble(folder).members}) == MEMBERS
        leftovers = [path for path in folder.rglob(".*") if path.name != ".signac"]
        assert not leftovers

    return words, folder, keep, check


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
    process = command(*words)
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    assert f"{MEMBERS} done, 0 failed, 0 missing" in out
    check()


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
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    assert f"{MEMBERS} done, 0 failed, 0 missing" in out
    check()


def test_two_kills_of_the_group_lose_nothing(ensemble, command, wait_until, rng):
    kill_groups(2, ensemble, command, wait_until, rng)


def test_two_kills_of_workers_are_repaired_by_the_command(ensemble, command, children, wait_until, rng):
    kill_workers(2, ensemble, command, children, wait_until, rng)


@pytest.mark.slow
def test_twelve_kills_of_the_group_lose_nothing(ensemble, command, wait_until, rng):
    kill_groups(12, ensemble, command, wait_until, rng)


@pytest.mark.slow
def test_twelve_kills_of_workers_are_repaired_by_the_command(ensemble, command, children, wait_until, rng):
    kill_workers(12, ensemble, command, children, wait_until, rng)
