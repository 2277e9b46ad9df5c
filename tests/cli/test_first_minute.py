"""Facts about the first minute with the command: what comes of no words, new scenes, other values, shipped scenes."""

import json
import re

import numpy as np
import pytest

import packmech as pm
from packmech.cli import OK, execute
from packmech.observables import OBSERVABLES


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_command_alone_says_what_to_do_next(capsys):
    assert execute([]) == OK
    said = capsys.readouterr().out
    assert "packmech jam" in said and "packmech new" in said and "packmech guide" in said


def test_a_new_scene_is_what_its_options_say_and_every_field_has_a_comment(folder):
    words = ["--particles", "20", "--dimension", "3", "--law", "hertz", "--friction", "0.3", "--seed", "7"]
    execute(["new", "mine.toml", *words, "--set", "drive.pressure=2e-3", "--set", 'packing.sizes="monodisperse"'])
    scene = pm.read_scene(folder / "mine.toml")
    assert (scene.packing.particles, scene.packing.dimension) == (20, 3)
    assert scene.packing == pm.random_packing(20, dimension=3, packing_fraction=0.5, sizes=pm.Monodisperse(), seed=7)
    assert scene.effects == (pm.Repulsion(pm.Hertz()), pm.Friction(0.3))
    assert scene.drive == pm.JamDrive(pressure=2e-3)
    lines = (folder / "mine.toml").read_text().splitlines()
    for k, line in enumerate(lines):
        if re.match(r"[a-z_]+ = ", line) and not line.startswith("description"):
            assert lines[k - 1].startswith("#"), line


@pytest.mark.parametrize("name", list(pm.list_scenes()))
def test_a_new_scene_like_any_that_ships_is_that_scene(folder, name):
    execute(["new", "copy.toml", "--like", name])
    assert pm.read_scene(folder / "copy.toml") == pm.read_scene(name)


def test_what_stands_as_a_comment_in_a_new_scene_are_the_defaults(folder):
    execute(["new", "mine.toml", "--friction", "0.3"])
    text = (folder / "mine.toml").read_text()
    uncommented = re.sub(r"(?m)^# (?=[a-z_]+ = )", "", text)
    assert uncommented != text
    (folder / "all.toml").write_text(uncommented)
    assert pm.read_scene(folder / "all.toml") == pm.read_scene(folder / "mine.toml")


def test_a_file_that_exists_is_only_replaced_when_asked(folder):
    execute(["new", "mine.toml"])
    with pytest.raises(ValueError, match="file must not exist"):
        execute(["new", "mine.toml"])
    execute(["new", "mine.toml", "--overwrite", "--particles", "8"])
    assert pm.read_scene(folder / "mine.toml").packing.particles == 8


def test_shipped_scenes_are_shown_and_copied_as_they_are(folder, capsys):
    execute(["scenes", "--show", "kagome"])
    shown = capsys.readouterr().out
    execute(["scenes", "--copy", "kagome"])
    assert (folder / "kagome.toml").read_text() == shown
    assert pm.read_scene(folder / "kagome.toml") == pm.read_scene("kagome")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["scenes", "--show", "kagom"], "did you mean 'kagome'"),
        (["scenes", "--to", "x.toml"], "to must be left out without --copy"),
        (["jam", "--set", "packing.particles"], "set must be NAME=VALUE"),
        (["jam", "--set", "packing.partcles=4"], "did you mean 'particles'"),
        (["jam", "--set", "effects.fricton.coefficient=1"], "must lie in what the scene has"),
        (["run", "defalt"], "did you mean 'default'"),
        (["new", "mine.txt"], "file must end in .toml"),
    ],
)
def test_what_is_misspelled_is_said_before_anything_runs(words, message):
    with pytest.raises((ValueError, OSError), match=re.escape(message)):
        execute(words)


def test_jam_takes_other_values_than_the_scene_s(folder, capsys):
    words = ["--particles", "24", "--set", "packing.sizes=monodisperse", "--law", "hertz", "--no-record"]
    assert execute(["jam", *words, "--json", "numbers.json", "--out", "packing.npz", "--modes", "0"]) == OK
    packing = pm.read_packing(folder / "packing.npz")
    assert packing.particles == 24 and len(set(packing.radius_n.tolist())) == 1
    assert pm.read_law(folder / "packing.npz") == pm.Hertz()


def test_every_error_of_a_scene_is_said_at_once(folder):
    (folder / "wrong.toml").write_text(
        """
        colour = "red"
        [packing]
        kind = "random"
        particles = 4.5
        packing_fracton = 0.8
        seed = 1
        [[effects]]
        kind = "repulsion"
        law = { kind = "hertzian" }
        [drive]
        kind = "jamm"
        """
    )
    with pytest.raises(ValueError, match="5 errors in scene file") as caught:
        pm.read_scene(folder / "wrong.toml")
    said = str(caught.value).splitlines()[1:]
    starts = ["colour", "effects[0].law.kind", "drive.kind", "packing.particles", "packing.packing_fracton"]
    assert [line[2:].partition(" must")[0] for line in said] == starts
    assert "did you mean 'hertz'" in said[1] and "--load" in said[1]


def test_one_error_of_a_scene_stands_alone(folder):
    (folder / "wrong.toml").write_text('[packing]\nkind = "lattice"\nname = "square"\n[[effects]]\nkind = 3\n')
    with pytest.raises(ValueError, match=r"^effects\[0\].kind must be one of .* \(in scene file"):
        pm.read_scene(folder / "wrong.toml")


def test_an_observable_of_one_s_own_is_among_the_numbers(folder, capsys):
    (folder / "mine.py").write_text(
        """
import packmech as pm


@pm.observable(unit="1")
def largest_overlap_of_mine(state):
    return pm.find_contacts(state.packing).overlap_c.max(initial=0.0)
"""
    )
    words = ["--load", "mine.py", "--particles", "24", "--no-record", "--modes", "0", "--set", "drive.pressure=1e-3"]
    try:
        execute(["jam", *words, "--json", "numbers.json", "--out", "packing.npz"])
        numbers = json.loads((folder / "numbers.json").read_text())
        overlap = pm.find_contacts(pm.read_packing(folder / "packing.npz")).overlap_c.max()
        assert numbers["largest_overlap_of_mine"] == pytest.approx(overlap, rel=1e-12)
    finally:
        OBSERVABLES.pop("largest_overlap_of_mine", None)


def test_a_packing_file_is_jammed_or_becomes_a_scene_with_its_law(folder, capsys):
    start = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    (folder / "in").mkdir()
    pm.write_packing(start, "in/mine.npz", law=pm.Hertz(2.0))
    with pytest.raises(ValueError, match="packmech jam in/mine.npz .*packmech analyze in/mine.npz"):
        execute(["run", "in/mine.npz"])
    execute(["new", "in/my.toml", "--packing", "in/mine.npz", "--set", "drive.pressure=1e-3"])
    scene = pm.read_scene("in/my.toml")
    assert (scene.packing, scene.effects) == (start, (pm.Repulsion(pm.Hertz(2.0)),))
    execute(["jam", "in/mine.npz", "--pressure", "1e-3", "--no-record", "--out", "end.npz", "--modes", "0"])
    assert pm.pressure(scene.replace(packing=pm.read_packing("end.npz"))) == pytest.approx(2e-3, rel=1e-9)


def test_a_packing_file_in_a_scene_like_another_keeps_its_materials_and_the_kinds_of_the_file_if_it_has_some(folder):
    start = pm.random_packing(16, dimension=3, packing_fraction=0.5, seed=1)
    own = start.replace(kind_n=[0] * 4 + [1] * 12)
    for name, packing in (("none.npz", start), ("own.npz", own)):
        pm.write_packing(packing, name)
        execute(["new", f"{name}.toml", "--like", "glass-and-steel", "--packing", name])
    like = pm.read_scene("glass-and-steel")
    drawn, kept = pm.read_scene("none.npz.toml"), pm.read_scene("own.npz.toml")
    assert kept.effects == like.effects and drawn.effects == like.effects and kept.drive == like.drive
    assert kept.packing.kind_n.tolist() == own.kind_n.tolist()
    assert np.bincount(drawn.packing.kind_n).tolist() == [11, 5]


def test_another_kind_of_packing_drops_the_fields_of_the_old_one_and_says_so(folder, capsys):
    pm.write_packing(pm.lattice_packing("kagome"), "mine.csv")
    execute(
        ["new", "my.toml", "--set", "packing.kind=file", "--set", "packing.path=mine.csv", "--set", "drive.kind=quench"]
    )
    assert pm.read_scene("my.toml").packing.particles == 3
    assert pm.read_scene("my.toml").drive == pm.QuenchDrive()
    said = capsys.readouterr().err
    assert "packing.kind = file leaves out what the packing of kind 'random' had: particles" in said
    assert "drive.kind = quench leaves out" in said
