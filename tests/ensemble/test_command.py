"""`packmech ensemble`: what its actions print and write."""

import re

import numpy as np
import pytest
from cyclopts import CycloptsError

import packmech as pm
from packmech.cli import FAILED, OK, execute
from packmech.ensemble.folder import prepare
from packmech.ensemble.jobs import job_table
from packmech.ensemble.statistics import crossover_warning
from packmech.ensemble.table import Ensemble


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
    assert re.search(r"= \(3\.\d+ \+- \S+\) x\^\(1\.0\d* \+- ", capsys.readouterr().out)
    assert picture.stat().st_size > 10_000
    assert execute(["ensemble", "plot", *words, "--out", str(picture), "--of", "square", "seconds"]) == OK
    assert (tmp_path / "plot_square.png").exists() and (tmp_path / "plot_seconds.png").exists()


def test_tables_and_pictures_write_parameters_with_six_digits_at_most(tmp_path, job, called, capsys):
    folder, picture = tmp_path / "out", tmp_path / "plot.svg"
    grid = {"scale": np.geomspace(1.0, 10.0, 4) / 3.0, "seed": range(2)}
    found = pm.run_ensemble(called("square"), grid, folder, workers=0)
    longest = max(map(str, found["scale"]), key=len)
    assert len(longest) > 15
    words = ["--folder", str(folder), "--of", "square"]
    assert execute(["ensemble", "table", *words, "--out", str(tmp_path / "table.csv")]) == OK
    with pm.view.figures.matplotlib_parts().rc_context({"svg.fonttype": "none"}):
        assert execute(["ensemble", "plot", *words, "--out", str(picture), "--fit"]) == OK
    drawn = pm.plot(pm.group_statistics(found, "square", ["seed", "scale"])).get_legend_handles_labels()[1]
    short = f"{float(longest):.6g}"
    for text in (capsys.readouterr().out, picture.read_text(), repr(found), " ".join(drawn)):
        assert short in text and longest[:9] not in text


def test_failures_are_listed_and_make_the_exit_code(tmp_path, job, capsys):
    folder, flag = tmp_path / "out", tmp_path / "flag"
    words = ["--folder", str(folder), "--workers", "1"]
    assert execute(["ensemble", job("waits_for"), "--seeds", "0:2", "--grid", f"flag={flag}", *words]) == FAILED
    said = capsys.readouterr().out
    assert "0 done, 2 failed, 0 missing" in said
    assert "RuntimeError" in said
    assert "not yet" in said
    flag.touch()
    assert execute(["ensemble", "resume", "--trust", *words]) == FAILED
    assert execute(["ensemble", "retry", "--trust", *words]) == OK


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


def test_the_excess_coordination_can_be_asked_for(tmp_path, capsys):
    (tmp_path / "small.toml").write_text(
        '[packing]\nkind = "random"\nparticles = 16\ndimension = 2\npacking_fraction = 0.9\nseed = 3\n'
        '[[effects]]\nkind = "repulsion"\nlaw = "harmonic"\n[drive]\nkind = "jam"\npressure = 1e-3\n'
    )
    words = ["--folder", str(tmp_path / "out"), "--workers", "0"]
    assert execute(["ensemble", f"{tmp_path}/small.toml", "--seeds", "0:2", *words]) == OK
    found = pm.read_ensemble(tmp_path / "out")
    held = found["particles"] - found["rattlers"]
    np.testing.assert_allclose(found["excess_coordination"], 2.0 * found["excess_contacts"] / held, atol=1e-12)
    capsys.readouterr()
    assert execute(["ensemble", "table", *words[:2], "--of", "excess_coordination"]) == OK
    assert "excess coordination" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("result", "particles", "warned"),
    [("shear_modulus", 100, "N^2 P is 0.01 "), ("shear_modulus", 10_000, ""), ("bulk_modulus", 100, "")],
)
def test_a_power_law_over_pressures_of_the_finite_size_plateau_is_warned_of(
    tmp_path, job, result, particles, warned, capsys
):
    """N^2 P is 0.01 at the lowest pressure of 100 discs, and 100 of ten thousand; bulk moduli have no plateau."""
    folder = ["--folder", str(tmp_path / "out")]
    grid = ["--grid", "pressure=1e-6:1e-2:5:log", f"particles={particles}"]
    assert execute(["ensemble", job("pressed"), "--seeds", "0:2", "--workers", "0", *grid, *folder]) == OK
    capsys.readouterr()
    assert execute(["ensemble", "plot", "--of", result, "--over", "pressure", "--fit", *folder]) == OK
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("warning")]
    assert [warned in line for line in lines] == ([True] if warned else [])
    assert execute(["ensemble", "plot", "--of", result, "--over", "pressure", *folder]) == OK
    assert "warning" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("effects", "least"),
    [
        ('[[effects]]\nkind = "repulsion"\nlaw = "harmonic"\n', "0.0016 "),
        # overlaps, which P over the stiffness is, grow as P^(2/3)
        ('[[effects]]\nkind = "repulsion"\nlaw = "hertz"\n', "0.16 "),
        ('[[effects]]\nkind = "repulsion"\nlaw = "harmonic"\n[[effects]]\nkind = "friction"\n', ""),
    ],
)
def test_the_plateau_is_told_by_the_stiffness_of_contacts(tmp_path, effects, least):
    (tmp_path / "small.toml").write_text(
        '[packing]\nkind = "random"\nparticles = 40\ndimension = 2\npacking_fraction = 0.5\nseed = 3\n'
        f'{effects}[drive]\nkind = "jam"\npressure = 1e-6\n'
    )
    folder = tmp_path / "out"
    prepare(folder, job_table(f"{tmp_path}/small.toml"))
    columns = {"drive.pressure": np.array([1e-6, 1e-5]), "particles": np.array([40, 40])}
    found = Ensemble(folder, (), {**columns, "state": np.array(["done", "done"])})
    words = crossover_warning(found, "excess_coordination", "drive.pressure")
    assert f"N^2 P is {least}" in words if least else words == ""


@pytest.mark.parametrize(("letter", "name"), [("z", "coordination_number"), ("phi_J", "jamming_packing_fraction")])
def test_the_letter_of_a_result_suggests_its_name(tmp_path, letter, name):
    (tmp_path / "job.py").write_text(
        "def told(seed):\n    return {'coordination_number': 4.0 + seed, 'jamming_packing_fraction': 0.84}\n"
    )
    folder = ["--folder", str(tmp_path / "out")]
    assert execute(["ensemble", f"{tmp_path}/job.py:told", "--seeds", "0:2", "--workers", "0", *folder]) == OK
    with pytest.raises(ValueError, match=f"did you mean '{name}'"):
        execute(["ensemble", "table", "--of", letter, *folder])


def test_a_grid_without_seeds_has_one_start_and_numbers_without_errors(tmp_path, capsys):
    (tmp_path / "small.toml").write_text(
        '[packing]\nkind = "random"\nparticles = 12\ndimension = 2\npacking_fraction = 0.95\nseed = 3\n'
        '[[effects]]\nkind = "repulsion"\nlaw = "harmonic"\n[drive]\nkind = "quench"\nforce_tolerance = 1e-2\n'
    )
    scene, folder = f"{tmp_path}/small.toml", tmp_path / "out"
    words = ["ensemble", scene, "--folder", str(folder), "--workers", "0"]
    assert execute([*words, "--grid", "drive.force_tolerance=1e-2,1e-3", "effects.repulsion.law=harmonic"]) == OK
    assert "scene's own seed for each member" in capsys.readouterr().out
    found = pm.read_ensemble(folder)
    rows = range(len(found))
    start = pm.quench(pm.read_scene(scene), force_tolerance=1e-2)
    assert any(found.packing(row) == start.packing for row in rows)
    execute(["ensemble", "table", "--folder", str(folder)])
    said = capsys.readouterr().out
    assert "force tolerance" in said or "drive.force_tolerance" in said
    assert "nan" not in said


@pytest.mark.parametrize(
    "words",
    [
        ["jam", "--pressure", "1e-6", "1e-5"],
        ["jam", "--set", "drive.pressure=1e-6,1e-5"],
        ["run", "default", "--grid", "drive.pressure=1e-6,1e-5"],
        ["run", "default", "--seeds", "0:3"],
        ["sweep", "default"],
    ],
)
def test_one_run_for_several_values_names_the_command_that_makes_them(words):
    with pytest.raises(ValueError, match="packmech ensemble SCENE --grid drive.pressure=1e-6,1e-5"):
        execute(words)
