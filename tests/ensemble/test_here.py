"""Members that run in the process that calls: any callable, the same bits, nothing lost."""

import functools
import json
import os
import signal

import numpy as np
import pytest

import packmech as pm
from packmech.ensemble.folder import find, listed_members

# what failed is what these tests look at
pytestmark = pytest.mark.filterwarnings("ignore:.* members failed:UserWarning")


def values(ensemble):
    """Return the results of the members to the last bit, by their names."""
    return {one.id: json.dumps(find(ensemble.folder, one).result["values"], sort_keys=True) for one in ensemble.members}


def test_the_results_are_to_the_last_bit_those_of_other_processes(tmp_path, called):
    grid = {"packing.particles": 12, "drive.pressure": 1e-4, "seed": range(3)}
    for job, asked in (("default", grid), (called("packed"), {"seed": range(3)})):
        here = pm.run_ensemble(job, asked, tmp_path / f"{job} here", workers=0)
        there = pm.run_ensemble(job, asked, tmp_path / f"{job} there", workers=2)
        assert here.counts() == {"done": 3, "failed": 0, "missing": 0}
        assert values(here) == values(there)
        assert [here.packing(k) for k in range(3)] == [there.packing(k) for k in range(3)]
        for k in range(3):
            assert {name: value.tobytes() for name, value in here.arrays(k).items()} == {
                name: value.tobytes() for name, value in there.arrays(k).items()
            }


def test_any_callable_is_a_job_and_no_process_is_started(tmp_path):
    offset, ran = 3.0, []

    def shifted(x, random_seed):
        ran.append(x)
        return {"value": x + offset, "process": os.getpid(), "drawn": random_seed}

    class Doubled:
        def __call__(self, x):
            return 2 * x

    found = pm.run_ensemble(shifted, {"x": [1.0, 2.0]}, tmp_path / "closure", workers=0)
    assert found["value"].tolist() == [4.0, 5.0]
    assert set(found["process"].tolist()) == {os.getpid()}
    assert found["drawn"].tolist() == [one.random_seed for one in found.members]
    more = pm.run_ensemble(shifted, {"x": [1.0, 2.0, 4.0]}, tmp_path / "closure", workers=0)
    assert more["value"].tolist() == [4.0, 5.0, 7.0]
    assert ran == [1.0, 2.0, 4.0]
    assert pm.run_ensemble(Doubled(), {"x": 4}, tmp_path / "object", workers=0)["value"].tolist() == [8]
    with pytest.raises(ValueError, match="another function"):
        pm.run_ensemble(Doubled(), {"x": 4}, tmp_path / "closure", workers=0)


def test_functions_that_measure_a_scene_may_be_any(tmp_path):
    grid = {"packing.particles": 12, "seed": 0}
    measures = ["contacts", lambda scene: {"largest": float(scene.packing.radius_n.max())}]
    found = pm.run_ensemble("default", grid, tmp_path / "out", measures=measures, workers=0)
    assert found["largest"][0] == found.packing(0).radius_n.max()
    with pytest.raises(ValueError, match="different names"):
        pm.run_ensemble("default", grid, tmp_path / "two", measures=measures * 2, workers=0)


def test_ctrl_c_passes_on_and_finished_members_stay(tmp_path):
    ran = []

    def interrupted(seed):
        ran.append(seed)
        if ran == [0, 1, 2]:
            signal.raise_signal(signal.SIGINT)
        return float(np.random.default_rng(seed).normal())

    grid = {"seed": range(5)}
    with pytest.raises(KeyboardInterrupt):
        pm.run_ensemble(interrupted, grid, tmp_path / "out", workers=0)
    assert pm.read_ensemble(tmp_path / "out").counts() == {"done": 2, "failed": 0, "missing": 3}
    found = pm.run_ensemble(interrupted, grid, tmp_path / "out", workers=0)
    assert ran == [0, 1, 2, 2, 3, 4]
    assert values(found) == values(pm.run_ensemble(interrupted, grid, tmp_path / "whole", workers=0))


def test_failures_are_rows_and_run_again_only_when_that_is_asked_for(tmp_path):
    broken = [True]

    def fragile(seed):
        if broken[0] and seed == 1:
            raise ZeroDivisionError("the job divided by nothing")
        return seed

    grid, folder = {"seed": range(3)}, tmp_path / "out"
    said = []
    found = pm.run_ensemble(fragile, grid, folder, workers=0, progress=lambda stage, figures: said.append(figures))
    assert found.counts() == {"done": 2, "failed": 1, "missing": 0}
    assert found["reason"].tolist() == ["", "ZeroDivisionError", ""]
    assert "fragile" in found["traceback"][1]
    assert [one["done"] for one in said] == [0, 1, 1, 2]
    broken.clear()
    broken.append(False)
    assert pm.run_ensemble(fragile, grid, folder, workers=0).counts()["failed"] == 1
    assert pm.run_ensemble(fragile, grid, folder, workers=0, retry=True)["value"].tolist() == [0, 1, 2]


def test_a_member_may_run_an_ensemble_of_its_own_in_its_process(tmp_path, called):
    assert pm.run_ensemble(called("nested"), {"seed": range(2)}, tmp_path, workers=1)["total"].tolist() == [3, 6]


def test_a_folder_goes_on_in_other_processes_if_its_function_has_a_name(tmp_path, called):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": range(2)}, folder, workers=0)
    assert pm.run_ensemble(called("square"), {"seed": range(3)}, folder, workers=1)["square"].tolist() == [0, 1, 4]
    (folder / "workspace" / listed_members(folder)[0].id / "result.json").unlink()
    assert pm.resume_ensemble(folder, trust=True, workers=0).counts()["done"] == 3
    # the folder knows the name of a closure, and no place where it is
    pm.run_ensemble(lambda seed: seed, {"seed": 0}, tmp_path / "closure", workers=0)
    for (path,) in [list((tmp_path / "closure").glob("workspace/*/result.json"))]:
        path.unlink()
    with pytest.raises(ValueError, match="goes on by the same call of run_ensemble"):
        pm.resume_ensemble(tmp_path / "closure", trust=True, workers=0)


def test_a_closure_that_computes_something_else_is_another_job(tmp_path):
    def times(factor):
        def scaled(n):
            return factor * n

        return pm.run_ensemble(scaled, {"n": [1, 2]}, tmp_path, workers=0)

    assert times(2)["value"].tolist() == times(2)["value"].tolist() == [2, 4]
    with pytest.raises(ValueError, match="folder must hold members of the same job, .* that was written otherwise"):
        times(3)


def test_columns_of_members_stand_one_below_the_other_with_their_parameters(tmp_path):
    def follow(seed, levels):
        return {"level": levels, "value": [seed * one for one in levels]} if seed else {"value": 0.0}

    found = pm.run_ensemble(follow, {"seed": range(3), "levels": [[1.0, 2.5]]}, tmp_path / "out", workers=0)
    rows = found.rows()
    assert list(rows.columns) == ["seed", "level", "value"]
    assert rows["seed"].tolist() == [1, 1, 2, 2] and rows["value"].tolist() == [1.0, 2.5, 2.0, 5.0]
    assert len(found.where(seed=0).rows()) == 0
    uneven = pm.run_ensemble(lambda seed: {"one": [1, 2], "two": [3]}, {"seed": 0}, tmp_path / "uneven", workers=0)
    with pytest.raises(ValueError, match="members must have left columns one, two of one length each"):
        uneven.rows()


def test_members_of_a_grid_are_those_alone_and_in_its_order(tmp_path):
    run = functools.partial(pm.run_ensemble, lambda seed, scale: seed * scale, folder=tmp_path / "out", workers=0)
    run(grid={"seed": range(4), "scale": [1.0, 2.0]})
    asked = {"seed": [3, 1], "scale": 2.0}
    assert run(grid=asked).of(asked)["value"].tolist() == [6.0, 2.0]
    with pytest.raises(ValueError, match="grid must name members of the ensemble, got .*'seed': 9"):
        run(grid=asked).of({"seed": 9, "scale": 1.0})
