"""Facts about `packmech gallery`: it lists, shows and runs scripts, and knows what was meant."""

import matplotlib
import matplotlib.pyplot as plt
import pytest

from packmech.cli import execute
from packmech.cli.gallery import gallery, scripts

matplotlib.use("agg")
if not scripts():
    pytest.skip("no gallery here", allow_module_level=True)


def test_every_script_is_listed_with_its_question(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert execute(["gallery"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in scripts())
    assert listed.count("?") >= len(scripts())


def test_a_script_is_shown_as_it_stands(capsys):
    assert execute(["gallery", "kagome", "--show"]) == 0
    assert capsys.readouterr().out == scripts()["kagome"].read_text(encoding="utf-8")


def test_a_script_runs_and_leaves_its_figure_in_the_folder_named(tmp_path, capsys):
    assert execute(["gallery", "kagome", "--out", str(tmp_path / "shown")]) == 0
    plt.close("all")
    assert (tmp_path / "shown" / "kagome.png").exists()
    assert "floppy modes = 7" in capsys.readouterr().out


def test_what_a_misspelled_name_may_have_meant_is_said():
    with pytest.raises(ValueError, match="did you mean 'kagome'"):
        gallery("kagom")


def test_a_folder_that_cannot_be_made_is_named_with_the_reason(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="out must be a folder, or one that can be made, got .*file': File exists"):
        gallery("kagome", out=tmp_path / "file")
