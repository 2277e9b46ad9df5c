"""The same command elsewhere: parts of an array job, a Dask scheduler with its workers, signac, row."""

import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tomllib

import pytest

import packmech as pm

GRID = ["packing.particles=8,12", "drive.pressure=1e-4"]


def test_three_parts_in_three_processes_are_the_same_table(tmp_path, command, rows):
    words = ["default", "--seeds", "0:5", "--grid", *GRID, "--workers", 1]
    parts = [command(*words, "--folder", tmp_path / "parts", "--part", f"{k}/3") for k in (1, 2, 3)]
    for process in parts:
        _, error = process.communicate(timeout=300)
        assert process.returncode == 0, error
    whole = command(*words, "--folder", tmp_path / "whole")
    assert whole.wait(300) == 0
    found = [pm.read_ensemble(tmp_path / name) for name in ("parts", "whole")]
    assert found[0].counts() == {"done": 10, "failed": 0, "missing": 0}
    assert rows(found[0]) == rows(found[1])


@pytest.fixture
def dask(tmp_path, wait_until):
    """Return the address of a Dask scheduler, its process, and those of two workers, on the loopback address."""
    pytest.importorskip("distributed")
    where = tmp_path / "scheduler.json"
    started = []

    def start(*words):
        process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        started.append(process)
        return process

    scheduler = start(
        "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where)
    )
    # the file is there before its text is
    wait_until(lambda: where.exists() and where.read_text().rstrip().endswith("}"))
    address = json.loads(where.read_text())["address"]
    workers = [
        start("worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard",
              "--local-directory", str(tmp_path / f"dask-{k}"))
        for k in range(2)
    ]  # fmt: skip
    yield address, scheduler, workers
    for process in started:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()


def test_a_dask_scheduler_with_workers_gives_the_same_bits(tmp_path, command, dask, rows):
    address, _, _ = dask
    words = ["default", "--seeds", "0:4", "--grid", *GRID]
    there = command(*words, "--folder", tmp_path / "there", "--scheduler", address)
    _, error = there.communicate(timeout=300)
    assert there.returncode == 0, error
    here = command(*words, "--folder", tmp_path / "here", "--workers", 2)
    assert here.wait(300) == 0
    found = [pm.read_ensemble(tmp_path / name) for name in ("there", "here")]
    assert found[0].counts()["done"] == 8
    assert rows(found[0]) == rows(found[1])
    for one in found[0].members:
        path = pathlib.Path("workspace", one.id, "packing.npz")
        assert pm.read_packing(tmp_path / "there" / path) == pm.read_packing(tmp_path / "here" / path)


def test_a_scheduler_that_goes_away_ends_the_command_and_finished_members_stay(
    tmp_path, command, job, dask, wait_until, rows, called
):
    address, scheduler, _ = dask
    log, folder = tmp_path / "log", tmp_path / "out"
    words = [job("counted"), "--seeds", "0:60", "--grid", f"log={log}", "wait=0.2", "--folder", folder]
    process = command(*words, "--scheduler", address, "--group", 1)
    wait_until(lambda: len(list(folder.glob("workspace/*/result.json"))) >= 4)
    os.killpg(scheduler.pid, signal.SIGKILL)
    _, error = process.communicate(timeout=200)
    assert process.returncode == 2, error
    assert "executor must live until all members are finished" in error
    assert re.search(r"\d+ of 60 members are finished and stay", error)
    before = {path: path.stat().st_mtime_ns for path in folder.glob("workspace/*/result.json")}
    assert len(before) >= 4
    again = command(*words, "--workers", 2)
    _, error = again.communicate(timeout=300)
    assert again.returncode == 0, error
    assert {path: path.stat().st_mtime_ns for path in before} == before
    grid = {"log": str(log), "wait": 0.2, "seed": range(60)}
    assert rows(pm.read_ensemble(folder)) == rows(pm.run_ensemble(called("counted"), grid, folder, workers=1))


def test_an_address_without_a_scheduler_is_refused(tmp_path, command, job):
    pytest.importorskip("distributed")
    process = command(job("square"), "--seeds", "0:2", "--folder", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    _, error = process.communicate(timeout=120)
    assert process.returncode == 2
    assert "address of one that answers" in error


def test_executorlib_works_as_it_is(tmp_path, job):
    executorlib = pytest.importorskip("executorlib")
    with executorlib.SingleNodeExecutor(max_workers=2) as executor:
        found = pm.run_ensemble(job("square"), {"seed": range(6)}, tmp_path / "out", executor, group=2)
    assert found["square"].tolist() == [0.0, 1.0, 4.0, 9.0, 16.0, 25.0]


def test_signac_lists_the_members_by_their_parameters(tmp_path, called):
    signac = pytest.importorskip("signac")
    folder = tmp_path / "out"
    pm.run_ensemble("default", {"packing.particles": [8, 12], "seed": range(2)}, folder, workers=1)
    project = signac.get_project(folder)
    assert len(project) == 4
    assert {job.id for job in project} == {one.id for one in pm.read_ensemble(folder).members}
    small = list(project.find_jobs({"packing.particles": 8}))
    assert len(small) == 2
    assert {job.statepoint["seed"] for job in small} == {0, 1}
    # signac's own names for the same state points, and what a job of it would look for
    assert project.open_job({"packing": {"particles": 12}, "seed": 1}).id in {job.id for job in project}
    assert all(pathlib.Path(job.fn("result.json")).exists() for job in project)
    project.check()


def test_row_gets_the_members_that_have_no_result_in_groups(tmp_path, command, job):
    folder = tmp_path / "out"
    process = command(
        job("square"), "--seeds", "0:4", "--folder", folder, "--write-row", "--group", 3, "--time-limit", 90
    )
    out, error = process.communicate(timeout=120)
    assert process.returncode == 0, error
    assert "4 members" in out
    workflow = tomllib.loads((folder / "workflow.toml").read_text())
    action = workflow["action"][0]
    assert workflow["workspace"]["value_file"] == "signac_statepoint.json"
    assert action["products"] == ["result.json"]
    assert action["group"]["maximum_size"] == 3
    assert action["resources"]["walltime"]["per_directory"] == "00:01:30"
    assert pm.read_ensemble(folder).counts()["missing"] == 4
    # what row would run for the first group of directories
    names = sorted(path.name for path in (folder / "workspace").iterdir())
    line = action["command"].replace("{directories}", " ".join(names[:3])).split()
    assert line[:2] == ["packmech", "ensemble"]
    done = subprocess.run([sys.executable, "-m", "packmech", *line[1:]], cwd=folder, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    found = pm.read_ensemble(folder)
    assert set(found["id"][found["state"] == "done"].tolist()) == set(names[:3])
