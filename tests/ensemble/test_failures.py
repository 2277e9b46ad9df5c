"""What goes wrong: each is a row or a clear message, and what is finished survives."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import packmech as pm
from packmech.ensemble.folder import claimed, listed_members

# what failed is what these tests look at
pytestmark = pytest.mark.filterwarnings("ignore:.* members failed:UserWarning")


def test_members_that_raise_hang_eat_memory_or_die_are_rows_and_not_fatal(tmp_path, called):
    kinds = ["raises", "hangs", "eats", "dies", "exits", "unknown", "works"]
    folder, job = tmp_path / "out", called("troubled")
    pm.run_ensemble(job, {"kind": "hangs", "seed": 3}, folder, workers=1, time_limit=4.0)
    found = pm.run_ensemble(job, {"kind": kinds, "seed": 3}, folder, workers=2, memory_limit=1.2e9)
    assert found.counts() == {"done": 1, "failed": 6, "missing": 0}
    row = {kind: found.where(kind=kind) for kind in kinds}
    assert row["works"]["value"].tolist() == [3.0]
    reasons = {kind: str(one["reason"][0]) for kind, one in row.items()}
    assert reasons == {
        "raises": "ZeroDivisionError",
        "hangs": "time limit",
        "eats": "memory limit",
        "dies": "process ended",
        "exits": "SystemExit",
        "unknown": "TypeError",
        "works": "",
    }
    messages = {kind: str(one["message"][0]) for kind, one in row.items()}
    assert messages["raises"] == "the job divided by nothing"
    assert "more than 4 s" in messages["hangs"]
    assert "MB, more than 1200 MB" in messages["eats"]
    assert "SIGKILL" in messages["dies"]
    # where it was, also of those that could not say it themselves
    for kind in ("raises", "hangs", "eats"):
        assert "jobs.py" in str(row[kind]["traceback"][0]), kind


def test_failures_are_run_again_only_when_that_is_asked_for(tmp_path, called):
    flag, folder = tmp_path / "flag", tmp_path / "out"
    grid = {"flag": str(flag), "seed": range(2)}
    assert pm.run_ensemble(called("waits_for"), grid, folder, workers=1).counts()["failed"] == 2
    flag.touch()
    assert pm.run_ensemble(called("waits_for"), grid, folder, workers=1).counts()["failed"] == 2
    found = pm.resume_ensemble(folder, trust=True, retry=True, workers=1)
    assert found.counts() == {"done": 2, "failed": 0, "missing": 0}
    assert found["reason"].tolist() == ["", ""]


def test_a_run_that_is_no_success_is_a_failure_unless_it_is_not_checked(tmp_path, called):
    grid = {"seed": 1, "step_limit": [3, 100_000]}
    found = pm.run_ensemble(called("quenched"), grid, tmp_path / "checked", workers=1)
    assert found["state"].tolist() == ["failed", "done"]
    assert found["reason"].tolist() == ["NotConverged", ""]
    assert "step limit" in found["message"][0]
    found = pm.run_ensemble(called("quenched"), grid, tmp_path / "any", check=False, workers=1)
    assert found["outcome"].tolist() == ["step_limit", "converged"]
    assert found.packing(1).particles == 16


@pytest.fixture
def small_disk(tmp_path):
    """Return a folder with little room, and a function that gives it other options."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", place], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("only root may mount a small disk")
    yield place, lambda options: subprocess.run(["mount", "-o", f"remount,{options}", place], check=True)
    subprocess.run(["umount", "-l", place], check=True)


def test_a_full_disk_ends_the_call_and_keeps_what_is_finished(small_disk, called, rows, tmp_path):
    place, remount = small_disk
    grid = {"kind": "writes", "seed": range(8)}
    with pytest.raises(OSError, match="No space left on device.*of 8 members are finished and stay"):
        pm.run_ensemble(called("troubled"), grid, place / "out", workers=1)
    counts = pm.read_ensemble(place / "out").counts()
    assert counts["done"] >= 1
    assert counts["failed"] == 0
    remount("size=40m")
    found = pm.run_ensemble(called("troubled"), grid, place / "out", workers=1)
    assert found.counts()["done"] == 8
    assert rows(found) == rows(pm.run_ensemble(called("troubled"), grid, tmp_path / "undisturbed", workers=1))


def test_a_disk_that_may_not_be_written_any_more_ends_the_call(small_disk, called):
    place, remount = small_disk
    pm.run_ensemble(called("square"), {"seed": range(2)}, place / "out", workers=1)
    remount("ro")
    with pytest.raises(OSError, match="folder must be one that can be written"):
        pm.run_ensemble(called("square"), {"seed": range(4)}, place / "out", workers=1)
    assert pm.read_ensemble(place / "out").counts()["done"] == 2
    remount("rw")
    assert pm.run_ensemble(called("square"), {"seed": range(4)}, place / "out", workers=1).counts()["done"] == 4


def test_a_result_that_does_not_fit_ends_the_call_anywhere(tmp_path, job):
    script = f"""
import resource, sys
import packmech as pm
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
try:
    pm.run_ensemble({job("troubled")!r}, {{"kind": ["works", "writes"]}}, {str(tmp_path / "out")!r}, workers=1)
except OSError as error:
    sys.exit(str(error))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert "File too large" in done.stderr
    assert "1 of 2 members are finished and stay" in done.stderr
    assert pm.read_ensemble(tmp_path / "out").counts() == {"done": 1, "failed": 0, "missing": 1}


def test_a_folder_that_cannot_be_made_is_refused_with_its_name(tmp_path, called):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="folder must be one that can be written.*file/out"):
        pm.run_ensemble(called("square"), {"seed": 1}, tmp_path / "file" / "out", workers=1)


def test_no_process_is_no_fault_of_a_member(tmp_path, called, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(OSError, match="no process for members could be started"):
        pm.run_ensemble(called("square"), {"seed": 1}, tmp_path / "out", workers=1)
    assert pm.read_ensemble(tmp_path / "out").counts() == {"done": 0, "failed": 0, "missing": 1}


def test_a_member_that_another_command_runs_is_waited_for(tmp_path, called, wait_until):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": range(3)}, folder, workers=1)
    first = listed_members(folder)[0]
    (folder / "workspace" / first.id / "result.json").unlink()
    said = []
    call = threading.Thread(
        target=lambda: pm.resume_ensemble(
            folder, trust=True, workers=1, progress=lambda stage, figures: said.append(figures)
        )
    )
    with claimed(folder, first) as own:
        assert own
        call.start()
        wait_until(lambda: any(figures.get("busy") == 1 for figures in said))
        assert pm.read_ensemble(folder).counts()["missing"] == 1
    call.join(60.0)
    assert pm.read_ensemble(folder).counts()["done"] == 3


def test_two_commands_on_one_folder_share_the_members(tmp_path, command, job):
    log = tmp_path / "log"
    words = [job("counted"), "--seeds", "0:30", "--grid", f"log={log}", "wait=0.1", "--folder", tmp_path / "out"]
    both = [command(*words, "--workers", 1) for _ in range(2)]
    for process in both:
        out, error = process.communicate(timeout=300)
        assert process.returncode == 0, error
        assert "30 done, 0 failed, 0 missing" in out
    assert sorted(map(int, log.read_text().split())) == list(range(30))


def test_sigterm_from_a_batch_system_leaves_what_the_same_command_goes_on_from(tmp_path, command, job, wait_until):
    folder = tmp_path / "out"
    words = [job("stepping"), "--seeds", "0:3", "--grid", "steps=60", "--folder", folder, "--workers", 2]
    process = command(*words)
    wait_until(lambda: list(folder.glob("workspace/*/result.json")))
    time.sleep(1.5)
    os.killpg(process.pid, signal.SIGTERM)
    out, error = process.communicate(timeout=120)
    assert process.returncode == 130, error
    assert "interrupted" in error
    assert "of 3 members are finished and stay" in error
    before = pm.read_ensemble(folder).counts()
    assert before["done"] >= 1
    assert before["failed"] == 0
    assert before["missing"] >= 1
    again = command(*words)
    assert again.wait(300) == 0
    found = pm.read_ensemble(folder)
    assert found["steps"].tolist() == [60, 60, 60]
    # one of those underway went on from where it was asked to stop
    assert max(found["began"]) > 0
