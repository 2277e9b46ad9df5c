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


def test_what_was_tried_before_an_interrupt_is_shown_and_written(tmp_path):
    """Ctrl-C comes with the third line of progress."""
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "interrupts.py").write_text(
        "import packmech.cli.accuracy as command\n"
        "search, heard = command.search_settings, []\n"
        "def interrupted(*given, say, **named):\n"
        "    def count(*words):\n"
        "        heard.append(words)\n"
        "        if len(heard) == 3:\n"
        "            raise KeyboardInterrupt\n"
        "    return search(*given, say=count, **named)\n"
        "command.search_settings = interrupted\n"
    )
    words = (
        "--load",
        "interrupts.py",
        "--target",
        "pressure:1%",
        "--starts",
        "2",
        "--json",
        "a.json",
        "--csv",
        "a.csv",
    )
    done = accuracy(tmp_path, *words)
    assert done.returncode == 130, done.stderr
    assert "interrupted: this is what was tried so far, and nothing is chosen" in " ".join(done.stderr.split())
    found = json.loads((tmp_path / "a.json").read_text())
    assert not found["met"] and len((tmp_path / "a.csv").read_text().splitlines()) == len(found["trials"]) + 1
