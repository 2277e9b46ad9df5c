"""Ensembles: every member once, the same bits wherever it runs, and what a table of them says."""

import concurrent.futures
import hashlib
import json

import numpy as np
import pytest

import packmech as pm
from packmech.ensemble.folder import JOB, find, listed_members

SMALL = {"packing.particles": 12, "drive.pressure": 1e-4}


def test_a_function_is_run_for_every_member_and_its_results_are_the_table(tmp_path, called):
    found = pm.run_ensemble(called("square"), {"scale": [1.0, 2.0], "seed": range(3)}, tmp_path / "out", workers=2)
    assert found.counts() == {"done": 6, "failed": 0, "missing": 0}
    assert found["square"].tolist() == [0.0, 1.0, 4.0, 0.0, 2.0, 8.0]
    assert found["even"].tolist() == [1, 0, 1, 1, 0, 1]
    assert found.where(seed=2, scale=2.0)["word"].tolist() == ["number 2"]
    assert found.results == ("square", "half", "even", "word")


def test_done_again_nothing_is_run_and_a_larger_grid_runs_what_is_missing(tmp_path, called):
    log = tmp_path / "log"
    grid = {"log": str(log), "seed": range(4)}
    first = pm.run_ensemble(called("counted"), grid, tmp_path / "out", workers=1)
    again = pm.run_ensemble(called("counted"), grid, tmp_path / "out", workers=1)
    assert again["value"].tolist() == first["value"].tolist()
    more = pm.run_ensemble(called("counted"), grid | {"seed": range(6)}, tmp_path / "out", workers=1)
    assert more["value"][:4].tolist() == first["value"].tolist()
    assert sorted(map(int, log.read_text().split())) == list(range(6))


def test_a_scene_gives_what_running_it_by_hand_with_the_same_seed_gives(tmp_path):
    found = pm.run_ensemble("default", SMALL | {"seed": range(2)}, tmp_path / "out", workers=1)
    assert found.counts()["done"] == 2
    for row in range(2):
        scene = pm.read_scene("default", seed=int(found["random_seed"][row]), changes=SMALL)
        run = pm.run(scene)
        assert found.packing(row) == run.packing
        assert found["contacts"][row] == run.report["contacts"]
        moduli = pm.elastic_moduli(scene.replace(packing=run.packing))
        assert found["bulk_modulus"][row] == pytest.approx(moduli.bulk_modulus / scene.pressure_unit, rel=1e-14)


def test_starts_are_drawn_from_all_parameters_or_from_the_seed_alone(tmp_path):
    grid = {"packing.particles": 8, "drive.pressure": [1e-3, 1e-2], "seed": 4}
    measures = ["packing_fraction"]
    apart = pm.run_ensemble("default", grid, tmp_path / "apart", measures=measures, workers=1)
    same = pm.run_ensemble("default", grid, tmp_path / "same", measures=measures, seeding="seed", workers=1)
    assert not np.array_equal(apart.packing(0).radius_n, apart.packing(1).radius_n) or (
        np.abs(apart.packing(0).position_nd - apart.packing(1).position_nd).max() > 0.1
    )
    for row, pressure in enumerate((1e-3, 1e-2)):
        scene = pm.read_scene("default", seed=4, changes={"packing.particles": 8, "drive.pressure": pressure})
        assert pm.run(scene).packing == same.packing(row)


def test_measures_are_names_of_the_report_and_functions_of_the_scene(tmp_path):
    found = pm.run_ensemble(
        "default", SMALL | {"seed": 0}, tmp_path / "out", measures=["strict", "rattlers", pm.pressure], workers=1
    )
    assert found.results == ("strict", "rattlers", "pressure")
    assert found["strict"].tolist() == ["jammed"]
    assert found["pressure"][0] == pytest.approx(1e-4, rel=1e-6)
    with pytest.warns(UserWarning, match="1 of 1 members failed, the first with ValueError: measures must be among"):
        wrong = pm.run_ensemble("default", SMALL | {"seed": 0}, tmp_path / "wrong", measures=["rattlrs"], workers=1)
    assert "rattlers" in wrong["message"][0]


def test_a_scene_in_memory_is_a_job(tmp_path):
    crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=1e-3)
    scene = pm.Scene(crystal, (pm.Repulsion(),), pm.QuenchDrive())
    found = pm.run_ensemble(scene, {"effects.repulsion.law.energy_scale": [1.0, 3.0]}, tmp_path / "out", workers=1)
    # in its own unit of pressure a modulus does not depend on the scale of the energy
    np.testing.assert_allclose(found["bulk_modulus"][1], found["bulk_modulus"][0], rtol=1e-12)


def test_packings_and_arrays_are_read_when_asked_for(tmp_path, called):
    found = pm.run_ensemble(called("packed"), {"seed": range(2)}, tmp_path / "out", workers=1)
    assert found.packing(1) == pm.random_packing(8, dimension=2, packing_fraction=0.5, seed=1)
    assert found.arrays(1)["radii"].tolist() == found.packing(1).radius_n.tolist()
    assert found.results == ("fraction",)
    bare = pm.run_ensemble(called("packed"), {"seed": 0}, tmp_path / "bare", keep_packings=False, workers=1)
    with pytest.raises(FileNotFoundError):
        bare.packing(0)


def test_a_job_may_ask_for_a_seed_of_its_own_and_for_its_folder(tmp_path, called):
    found = pm.run_ensemble(called("drawn"), {"seed": range(2)}, tmp_path / "out", workers=1)
    assert found["drawn"].tolist() == [one.random_seed for one in found.members]
    assert found["own"].tolist() == [one.id for one in found.members]


def test_the_folder_is_all_that_is_needed_to_go_on(tmp_path, called):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": range(6)}, folder, part="1/2", workers=1)
    assert len(pm.read_ensemble(folder)) == 3
    names = [one.id for one in listed_members(folder)]
    (folder / "workspace" / names[0] / "result.json").unlink()
    (folder / "workspace" / names[1] / "result.json").write_text("{")  # as a disk without power may leave it
    with pytest.warns(UserWarning, match="not as they were written"):
        assert pm.read_ensemble(folder).counts() == {"done": 1, "failed": 0, "missing": 2}
    with pytest.warns(UserWarning, match="not as they were written"):
        assert pm.resume_ensemble(folder, trust=True, members=names[1:], workers=1).counts()["done"] == 2
    assert pm.resume_ensemble(folder, trust=True, workers=1).counts()["done"] == 3


def test_code_that_a_folder_names_runs_only_where_it_is_trusted(tmp_path, called):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": range(2)}, folder, part="1/2", workers=1)
    (folder / "workspace" / listed_members(folder)[0].id / "result.json").unlink()
    for given in ({}, {"trust": False}):
        with pytest.raises(ValueError, match=r"trust must be True \(--trust\) for a folder .* square of .*jobs"):
            pm.resume_ensemble(folder, workers=1, **given)
    assert pm.resume_ensemble(folder, workers=1, trust=True).counts()["done"] == 1
    # a function of any package is code of others
    job = folder / JOB
    table = json.loads(job.read_text())
    table["job"]["function"] = {"module": "os", "name": "system", "root": ""}
    job.write_text(json.dumps(table))
    with pytest.raises(ValueError, match="system of module os"):
        pm.resume_ensemble(folder, workers=1)
    # and one of packmech's may take a file of code
    table["job"]["function"] = {"module": "packmech.files.modules", "name": "load_modules", "root": ""}
    job.write_text(json.dumps(table))
    with pytest.raises(ValueError, match=r"load_modules of module packmech\.files\.modules"):
        pm.resume_ensemble(folder, workers=1)


def test_a_folder_of_a_scene_runs_no_code_of_its_own_and_needs_no_trust(tmp_path):
    grid = {"packing.particles": 16, "seed": range(2)}
    pm.run_ensemble("default", grid, tmp_path / "out", part="1/2", workers=1)
    assert pm.resume_ensemble(tmp_path / "out", workers=1).counts()["done"] == 1


def test_a_result_that_was_changed_counts_as_none(tmp_path, called):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": range(3)}, folder, workers=1)
    path = folder / "workspace" / listed_members(folder)[2].id / "result.json"
    result = json.loads(path.read_text())
    result["values"] = dict.fromkeys(result["values"], 5)
    # with a seal that is not its own, without one, and too deep to be read
    unsealed = {name: one for name, one in result.items() if name != "sha256"}
    for text in (json.dumps(result), json.dumps(unsealed), 100_000 * "["):
        path.write_text(text)
        with pytest.warns(UserWarning, match=f"holds 1 results or failures .* the first in workspace/.*{path.name}"):
            assert pm.read_ensemble(folder).counts() == {"done": 2, "failed": 0, "missing": 1}
    with pytest.warns(UserWarning, match="are not as they were written and count as none"):
        found = pm.run_ensemble(called("square"), {"seed": range(3)}, folder, workers=1)
    assert sorted(found["square"].tolist()) == [0, 1, 4]


def test_a_failure_that_was_changed_counts_as_none(tmp_path):
    folder = tmp_path / "out"
    with pytest.warns(UserWarning, match="1 of 1 members failed"):
        pm.run_ensemble("default", {"seed": [0]}, folder, measures=["no such figure"], workers=1)
    path = folder / "workspace" / listed_members(folder)[0].id / "failure.json"
    failure = json.loads(path.read_text())
    path.write_text(json.dumps({**failure, "message": "all is well"}))
    with pytest.warns(UserWarning, match="holds 1 results or failures .* the first in workspace/.*failure.json"):
        assert pm.read_ensemble(folder).counts() == {"done": 0, "failed": 0, "missing": 1}


def test_a_table_is_read_back_to_the_last_bit_from_either_format(tmp_path, called):
    found = pm.run_ensemble(called("counted"), {"log": str(tmp_path / "log"), "seed": range(3)}, tmp_path / "out")
    for ending in ("csv", "parquet"):
        if ending == "parquet":
            pytest.importorskip("pyarrow")
        path = tmp_path / f"table.{ending}"
        pm.write_table(found, path)
        table = pm.read_table(path)
        assert list(table.columns) == list(found.columns)
        for name in found.columns:
            assert table[name].tolist() == found[name].tolist()
            assert table[name].dtype.kind == found[name].dtype.kind
        assert table.about["done"] == 3


def bits(ensemble):
    """Return a hash of all results and packings."""
    found = hashlib.sha256()
    for one in ensemble.members:
        place = ensemble.folder / "workspace" / one.id
        values = find(ensemble.folder, one).result["values"]
        found.update(json.dumps(values, sort_keys=True).encode())
        with np.load(place / "packing.npz") as packing:
            for name in sorted(packing.files):
                found.update(packing[name].tobytes())
    return found.hexdigest()


def test_any_executor_gives_the_same_bits(tmp_path):
    grid = SMALL | {"seed": range(4)}
    here = pm.run_ensemble("default", grid, tmp_path / "here", workers=2)
    with concurrent.futures.ProcessPoolExecutor(2) as pool:
        there = pm.run_ensemble("default", grid, tmp_path / "there", pool, group=2)
    assert bits(here) == bits(there)


def test_progress_says_what_is_done_and_what_is_left(tmp_path, called):
    said = []
    pm.run_ensemble(
        called("square"), {"seed": range(3)}, tmp_path / "out", workers=1, progress=lambda *one: said.append(one)
    )
    assert [figures["done"] for _, figures in said] == [0, 1, 2, 3]
    assert said[-1][1]["seconds_left"] == 0.0
    assert said[-1][1]["rate"] > 0.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"job": lambda seed: seed}, "top of a file"),
        ({"job": 3}, "scene file"),
        ({"job": "microscopic"}, "shipped scene"),
        ({"job": "no_such_file.py:run"}, "existing file"),
        ({"job": "math:no_such_name"}, "must be a function"),
        ({"grid": {"sede": 1}}, "sede"),
        ({"job": "default", "grid": {"effects.friction.coefficient": 0.1}}, "friction"),
        ({"job": "default", "grid": {"packing.partcles": 8}}, "partcles"),
        ({"job": "triangular", "grid": {"seed": 1}}, "not random"),
        ({"seeding": "none"}, "seeding"),
        ({"workers": -1}, "workers"),
        ({"workers": 0, "time_limit": 1.0}, "time_limit must be left out with workers 0"),
        ({"workers": 0, "memory_limit": 1e9}, "memory_limit must be left out with workers 0"),
        ({"workers": 0, "group": 2}, "group must be left out with workers 0"),
        ({"time_limit": -1.0}, "time_limit"),
        ({"executor": 3}, "executor.submit"),
        ({"part": "3"}, "K/N"),
        ({"folder": 3}, "folder"),
        ({"measures": [abs]}, "measures"),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_is_written(tmp_path, called, options, words):
    given = {"job": called("square"), "grid": {"seed": 1}, "folder": tmp_path / "out"} | options
    with pytest.raises((TypeError, ValueError, FileNotFoundError), match=words):
        pm.run_ensemble(**given)
    assert not (tmp_path / "out").exists()


def test_another_job_in_the_same_folder_is_refused_by_what_differs(tmp_path, called):
    folder = tmp_path / "out"
    pm.run_ensemble(called("square"), {"seed": 1}, folder, workers=1)
    with pytest.raises(ValueError, match="another function"):
        pm.run_ensemble(called("packed"), {"seed": 1}, folder, workers=1)
    with pytest.raises(ValueError, match="another check"):
        pm.run_ensemble(called("square"), {"seed": 1}, folder, check=False, workers=1)


def test_a_folder_that_is_none_is_refused(tmp_path):
    for call in (pm.read_ensemble, pm.resume_ensemble):
        with pytest.raises(FileNotFoundError, match="that of an ensemble"):
            call(tmp_path)
