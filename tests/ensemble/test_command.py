"""`packmech ensemble`: what its actions print and write."""

import pytest
from cyclopts import CycloptsError

import packmech as pm
from packmech.cli import FAILED, OK, execute


def test_the_actions_say_what_came_of_members(tmp_path, job, capsys):
    folder = tmp_path / "out"
    words = ["--folder", str(folder)]
    run = ["ensemble", job("square"), "--seeds", "0:4", "--grid", "scale=1,2,4", *words, "--workers", "1"]
    assert execute(run) == OK
    assert "12 done, 0 failed, 0 missing of 12" in capsys.readouterr().out
    assert execute(["ensemble", "status", *words]) == OK
    assert "12 done" in capsys.readouterr().out
    path = tmp_path / "table.csv"
    assert execute(["ensemble", "table", *words, "--out", str(path), "--of", "square"]) == OK
    said = capsys.readouterr().out
    assert "3.5 +- " in said  # the mean of 0, 1, 4 and 9
    assert "12 rows" in said
    assert pm.read_table(path)["square"].tolist() == [0, 1, 4, 9, 0, 2, 8, 18, 0, 4, 16, 36]
    picture = tmp_path / "plot.png"
    plot = ["ensemble", "plot", *words, "--out", str(picture), "--of", "square", "--over", "scale", "--log", "--fit"]
    assert execute(plot) == OK
    # every value is the scale times a number, so means are its first power
    assert "x^(1.0000 +- " in capsys.readouterr().out
    assert picture.stat().st_size > 10_000


def test_failures_are_listed_and_make_the_exit_code(tmp_path, job, capsys):
    folder, flag = tmp_path / "out", tmp_path / "flag"
    words = ["--folder", str(folder), "--workers", "1"]
    assert execute(["ensemble", job("waits_for"), "--seeds", "0:2", "--grid", f"flag={flag}", *words]) == FAILED
    said = capsys.readouterr().out
    assert "0 done, 2 failed, 0 missing" in said
    assert "RuntimeError" in said
    assert "not yet" in said
    flag.touch()
    assert execute(["ensemble", "resume", *words]) == FAILED
    assert execute(["ensemble", "retry", *words]) == OK


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["default"], "seeds or grid"),
        (["default", "--grid", "a"], "NAME=VALUES"),
        (["default", "--grid", "packing.particles=8", "packing.particles=9"], "each name once"),
        (["default", "--seeds", "5"], None),
        (["resume", "--seeds", "0:2"], "Unknown option"),
        (["default", "--seeds", "0:2", "--members", "x"], "Unknown option"),
        (["status"], "that of an ensemble"),
        (["no-such-scene", "--seeds", "0:2"], "job must be a scene file .*a shipped scene .*kagome.*'no-such-scene'"),
    ],
)
def test_wrong_words_are_refused(tmp_path, words, message):
    if message is None:
        # a single seed is one member
        assert execute(["ensemble", "default", "--seeds", "5", "--grid", "packing.particles=8", "--write-row",
                        "--folder", str(tmp_path / "out")]) == OK  # fmt: skip
        return
    with pytest.raises((ValueError, FileNotFoundError, CycloptsError), match=message):
        execute(["ensemble", *words, "--folder", str(tmp_path / "out")])


@pytest.mark.parametrize(("letter", "name"), [("z", "coordination_number"), ("phi_J", "jamming_packing_fraction")])
def test_the_letter_of_a_result_suggests_its_name(tmp_path, letter, name):
    (tmp_path / "job.py").write_text(
        "def told(seed):\n    return {'coordination_number': 4.0 + seed, 'jamming_packing_fraction': 0.84}\n"
    )
    folder = ["--folder", str(tmp_path / "out")]
    assert execute(["ensemble", f"{tmp_path}/job.py:told", "--seeds", "0:2", "--workers", "0", *folder]) == OK
    with pytest.raises(ValueError, match=f"did you mean '{name}'"):
        execute(["ensemble", "table", "--of", letter, *folder])
