"""Facts about `packmech accuracy`: the scene it writes meets the target, and what it cannot do it says."""

import json
import subprocess
import sys

import pytest

import packmech as pm

SCENE = """
[packing]
kind = "random"
particles = 24
dimension = 2
packing_fraction = 0.95
seed = 1

[[effects]]
kind = "repulsion"

[drive]
kind = "quench"
"""


def accuracy(folder, *words):
    (folder / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-m", "packmech", "accuracy", "scene.toml", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_scene_that_is_written_has_the_settings_and_its_own_start(tmp_path):
    files = ("--out", "good.toml", "--json", "found.json", "--csv", "found.csv")
    done = accuracy(tmp_path, "--target", "pressure:1%", "--starts", "3", *files)
    assert done.returncode == 0, done.stderr
    assert "cheapest: drive.force_tolerance = " in done.stdout
    found = json.loads((tmp_path / "found.json").read_text())
    scene = pm.read_scene(tmp_path / "good.toml")
    assert scene.drive.force_tolerance == found["settings"]["drive.force_tolerance"]
    assert scene.packing == pm.read_scene(tmp_path / "scene.toml").packing
    assert len((tmp_path / "found.csv").read_text().splitlines()) == len(found["trials"]) + 1


def test_a_target_that_is_not_met_fails_and_writes_no_scene(tmp_path):
    words = ("--target", "energy:0 absolute", "--knob", "drive.force_tolerance=1e-1,1e-8", "--starts", "2")
    done = accuracy(tmp_path, *words, "--out", "good.toml")
    assert done.returncode == 1
    assert "no settings meet the target: no settings of the grid" in done.stderr
    assert not (tmp_path / "good.toml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--target", "pressure"), 'target must be FIGURE:ERROR, as in "storage_modulus:1%"'),
        (("--target", "pressure:1%", "--out", "scene.toml"), "out must not exist (or give --overwrite)"),
        (("--target", "pressure:1%", "--out", "scene.txt"), "out must end in .toml"),
        (("--target", "pressure:1%", "--knob", "drive.dt"), "knob must be PATH=VALUES"),
        (("--target", "pressure:1%", "--knob", "drive.dt=1,2"), "knobs must name fields of the drive"),
    ],
)
def test_bad_words_are_named_before_any_work(tmp_path, words, said):
    done = accuracy(tmp_path, *words)
    assert done.returncode == 2
    assert said in done.stderr
