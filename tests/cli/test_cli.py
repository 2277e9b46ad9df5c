"""Facts about the command: what it writes is what Python gives, errors are one line, exit codes say what happened."""

import contextlib
import io
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.cli import main
from packmech.cli.output import Files, Watch
from packmech.effects import registered_effects

JSON_FIELDS = {
    "packing_fraction",
    "pressure",
    "particles",
    "rattlers",
    "contacts",
    "isostatic_contacts",
    "collective",
    "strict",
    "bulk_modulus",
    "shear_modulus",
    "force_residual",
    "seconds",
}

SMALL = """
[packing]
kind = "random"
particles = 24
dimension = 2
packing_fraction = 0.87
seed = 2

[[effects]]
kind = "repulsion"
law = { kind = "harmonic", energy_scale = 1.0 }

[drive]
kind = "jam"
pressure = 1e-6
strain = "isotropic"
"""


class Done(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


def packmech(*arguments: str, folder: Path) -> Done:
    """Run the command as the shell would, in this process: the words, the exit code, the working folder."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        argv, sys.argv = sys.argv, ["packmech", *arguments]
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            sys.argv = argv
    return Done(code, out.getvalue(), err.getvalue())


def one_line(done: Done) -> str:
    """The one line of an error; more than one line, or a traceback, fails."""
    (line,) = done.stderr.strip().splitlines()
    return line


@pytest.fixture(scope="module")
def jammed(tmp_path_factory):
    """A small scene jammed by the command, with everything it can write."""
    folder = tmp_path_factory.mktemp("jammed")
    (folder / "small.toml").write_text(SMALL)
    done = packmech("jam", "small.toml", "--out", "end.npz", "--json", "end.json", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder, done, json.loads((folder / "end.json").read_text())


def test_jam_writes_every_number_that_is_promised(jammed):
    _, _, numbers = jammed
    assert set(numbers) >= JSON_FIELDS


def test_jam_leaves_a_recording_by_default_and_says_how_to_open_it(jammed):
    folder, done, _ = jammed
    assert (folder / "jam.rrd").stat().st_size > 1000
    assert "rerun jam.rrd" in done.stdout


def test_numbers_of_jam_are_those_of_the_packing_it_wrote(jammed):
    folder, _, numbers = jammed
    packing = pm.read_packing(folder / "end.npz")
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    verdict = pm.classify_jamming(scene)
    moduli = pm.elastic_moduli(scene)
    assert numbers["packing_fraction"] == pm.packing_fraction(packing)
    assert numbers["pressure"] == pm.pressure(scene) / scene.pressure_unit
    assert numbers["contacts"] == verdict.contacts
    assert numbers["rattlers"] == int(verdict.rattlers.sum())
    assert (numbers["collective"], numbers["strict"]) == (verdict.collective, verdict.strict)
    assert numbers["bulk_modulus"] == moduli.bulk_modulus
    assert numbers["shear_modulus"] == moduli.shear_modulus


def test_numbers_of_jam_are_those_of_the_python_call(jammed):
    folder, _, numbers = jammed
    run = pm.jam(pm.read_scene(folder / "small.toml"), pressure=1e-6, strain="isotropic")
    assert pm.read_packing(folder / "end.npz") == run.packing
    assert numbers["force_residual"] == run.residual


def test_jam_reaches_the_pressure_of_the_scene_at_the_isostatic_count(jammed):
    _, _, numbers = jammed
    assert numbers["pressure"] == pytest.approx(1e-6, rel=1e-4)
    assert numbers["contacts"] == numbers["isostatic_contacts"]
    assert numbers["isostatic_contacts"] == 2 * (numbers["particles"] - numbers["rattlers"]) - 1
    assert numbers["force_residual"] <= 1e-5


def test_the_recording_of_jam_holds_the_numbers_of_its_json(jammed):
    import rerun.chunk as chunk

    folder, _, numbers = jammed
    (kept,) = [
        piece.to_record_batch()
        for piece in chunk.RrdReader(folder / "jam.rrd").stream().to_chunks()
        if str(piece.entity_path) == "/__properties/packmech"
    ]
    results = json.loads(kept.column("results_json").to_pylist()[0][0])
    assert {name: results[name] for name in JSON_FIELDS} == {name: numbers[name] for name in JSON_FIELDS}
    parameters = json.loads(kept.column("parameters_json").to_pylist()[0][0])
    wanted = {"kind": "jam-drive", "pressure": 1e-6, "strain": "isotropic", "force_tolerance": 1e-5}
    assert parameters["drive"] == wanted


@pytest.mark.parametrize(
    "words",
    [
        "packing fraction",
        "pressure",
        "isostatic",
        "rattlers",
        "collectively jammed",
        "strictly jammed",
        "smallest singular value",
        "bulk modulus",
        "shear modulus",
        "simple shear xy",
        "lowest frequencies",
        "residual",
        "force evaluations",
        "CPU s",
    ],
)
def test_the_table_names(jammed, words):
    assert words in jammed[1].stdout


def test_analyze_of_the_written_packing_finds_the_same_numbers(jammed):
    folder, _, numbers = jammed
    done = packmech("analyze", "end.npz", "--json", "again.json", folder=folder)
    assert done.returncode == 0, done.stderr
    again = json.loads((folder / "again.json").read_text())
    same = JSON_FIELDS - {"seconds", "force_residual"}
    assert {name: again[name] for name in same} == {name: numbers[name] for name in same}
    assert "stored with it" in done.stdout
    packmech("analyze", "end.npz", "--strain", "free", "--json", "free.json", folder=folder)
    free = json.loads((folder / "free.json").read_text())
    assert free["isostatic_contacts"] == numbers["isostatic_contacts"] + 2
    assert free["coordination_number"] == numbers["coordination_number"]


def test_run_does_what_the_drive_of_the_scene_says(jammed, tmp_path):
    folder, _, numbers = jammed
    done = packmech("run", str(folder / "small.toml"), "--json", "run.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    ran = json.loads((tmp_path / "run.json").read_text())
    assert ran["packing_fraction"] == numbers["packing_fraction"]


def test_options_overrule_the_scene(jammed, tmp_path):
    folder, _, numbers = jammed
    options = ("--pressure", "1e-5", "--strain", "free", "--seed", "3", "--no-record", "--json", "other.json")
    done = packmech("jam", str(folder / "small.toml"), *options, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    other = json.loads((tmp_path / "other.json").read_text())
    assert other["pressure"] == pytest.approx(1e-5, rel=1e-4)
    assert other["isostatic_contacts"] == 2 * (other["particles"] - other["rattlers"]) + 1
    assert other["packing_fraction"] != numbers["packing_fraction"]
    assert not list(tmp_path.glob("*.rrd"))


def test_a_packing_is_written_even_where_its_format_has_no_place_for_all_of_it(tmp_path, capsys):
    packing = pm.cluster_packing(4, pm.Dimer(), dimension=2, packing_fraction=0.3, seed=1)
    Files(out=tmp_path / "end.csv").write_packing(packing)
    assert "end.csv has no place for, and does not hold: links" in capsys.readouterr().out
    assert pm.read_packing(tmp_path / "end.csv") == packing.replace(links=None)
    Files(out=tmp_path / "end.data").write_packing(packing)
    assert capsys.readouterr().out == "" and pm.read_packing(tmp_path / "end.data") == packing


def test_a_packing_without_law_is_analyzed_as_harmonic_and_says_so(tmp_path):
    pm.write_packing(pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-3), tmp_path / "crystal.txt")
    done = packmech("analyze", "crystal.txt", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "law: harmonic" in done.stdout
    assert "none is stored with it" in done.stdout


def test_a_touching_lattice_is_analyzed_with_no_residual_and_null_in_its_json(tmp_path):
    pm.write_packing(pm.lattice_packing("kagome", repeats=(2, 2)), tmp_path / "kagome.npz")
    done = packmech("analyze", "kagome.npz", "--json", "kagome.json", folder=tmp_path)
    assert re.search(r"force residual +- +no contact carries a force", done.stdout)
    assert re.search(r"lowest frequencies +0  0  0  0  1  1 ", done.stdout)
    assert json.loads((tmp_path / "kagome.json").read_text())["force_residual"] is None


def test_a_packing_that_is_not_at_rest_is_told_first_and_called_jammed_by_nothing(tmp_path):
    pm.write_packing(pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1), tmp_path / "raw.csv")
    lines = packmech("analyze", "raw.csv", folder=tmp_path).stdout.splitlines()
    title = next(k for k, line in enumerate(lines) if "32 discs" in line)
    assert "NOT AT REST" in lines[title + 2] and "packmech jam FILE" in lines[title + 2]
    assert not any("jammed to first order" in line for line in lines)


def test_a_packing_held_by_friction_is_analyzed_with_its_coefficient_only(tmp_path):
    crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=1e-3)
    first = pm.find_contacts(crystal).select(np.arange(1))
    springs = pm.TangentialDisplacements(first.i_c, first.j_c, first.image_cd, np.zeros((1, 1)))
    pm.write_packing(crystal.replace(tangential=springs), tmp_path / "rough.npz")
    refused = packmech("analyze", "rough.npz", folder=tmp_path)
    assert refused.returncode == 2 and "friction must be given for a packing that friction holds" in one_line(refused)
    done = packmech("analyze", "rough.npz", "--friction", "0.5", "--json", "rough.json", folder=tmp_path)
    assert json.loads((tmp_path / "rough.json").read_text())["coordination_number"] == 6.0
    assert "'coefficient': 0.5" in done.stdout and "with friction; 0 at the Coulomb limit" in done.stdout
    assert "it is about particles without friction" in done.stdout and "would ignore" not in done.stdout
    smooth = packmech("analyze", "rough.npz", "--friction", "0", folder=tmp_path)
    assert "strictly jammed" in smooth.stdout and "tangential springs left out" in smooth.stdout


def test_scenes_lists_every_shipped_scene(tmp_path):
    done = packmech("scenes", folder=tmp_path)
    assert all(name in done.stdout for name in pm.list_scenes())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("jam", "no-such-scene"), "packmech: path must name a file or a shipped scene"),
        (("jam", "broken.toml"), "packmech: packing.particels must be a field of random"),
        (("jam", "--pressure", "-1"), "packmech: drive.pressure must be"),
        (("jam", "--strain", "loose"), "packmech: drive.strain must be one of 'isotropic', 'free', got 'loose'"),
        (("jam", "--out", "packing.docx"), "packmech: path must end in one of"),
        (("jam", "--json", "no/such/folder.json"), "packmech: path must lie in an existing folder"),
        (("jam", "--record", "x.png"), "packmech: record must be a file name ending in .rrd, got 'x.png'"),
        (("analyze", "missing.npz"), "packmech: path must name an existing file, got 'missing.npz'"),
        (
            ("analyze", "text.npz"),
            "packmech: path must name a readable packing, got 'text.npz': text.npz is not a .npz file",
        ),
        (("analyze", "nan.txt"), "position_nd must be finite"),
        (("analyze", "pair.txt", "--law", "sticky"), "packmech: law must be one of"),
        (("run", "idle.toml"), "packmech: scene must have a [drive] to be run"),
        (("jam", "--particles", "64.5"), "must be a whole number, got '64.5'"),
        (
            ("jam", "--packing-fraction", "90"),
            "packing_fraction must be at most 5, got 90.0: it is the particles'",
        ),
    ],
)
def test_bad_input_is_one_clear_line_and_exit_code_2(tmp_path, arguments, message):
    (tmp_path / "broken.toml").write_text(SMALL.replace("particles", "particels"))
    (tmp_path / "idle.toml").write_text(SMALL.split("[drive]")[0])
    (tmp_path / "text.npz").write_text("no archive")
    (tmp_path / "nan.txt").write_text("lattice 4 0\nlattice 0 4\nnan 0 0.5\n")
    (tmp_path / "pair.txt").write_text("lattice 4 0\nlattice 0 4\n0 0 0.5\n0.9 0 0.5\n")
    done = packmech(*arguments, folder=tmp_path)
    assert done.returncode == 2
    assert message in one_line(done)


def test_a_run_that_does_not_converge_is_exit_code_1_and_says_so(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL + 'method = { kind = "hard-vertex", iteration_limit = 2 }\n')
    done = packmech("jam", "small.toml", "--no-record", "--out", "end.npz", folder=tmp_path)
    assert done.returncode == 1
    assert pm.Outcome.NOT_JAMMED.value in " ".join(done.stderr.split())
    assert (tmp_path / "end.npz").exists()


@pytest.fixture
def ctrl_c():
    """Give Ctrl-C its usual meaning, however the tests were started: a shell's background jobs ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_waits_until_the_compiler_is_done():
    from packmech.jit.interrupts import safe_interrupts

    seen = []

    def compiling():
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.1)
        seen.append("compiled")

    inside = {"__name__": "numba.core.dispatcher", "compiling": compiling}
    exec("def compile(): compiling()", inside)  # a function that numba's own frames lead to
    with pytest.raises(KeyboardInterrupt), safe_interrupts():
        inside["compile"]()
        for _ in range(100):
            time.sleep(0.05)
        seen.append("never interrupted")
    assert seen == ["compiled"]


@pytest.mark.usefixtures("ctrl_c")
def test_the_wait_for_the_compiler_is_told_once(capsys, monkeypatch):
    from packmech.jit import interrupts

    def compiling():
        for _ in range(3):
            with interrupts.held_interrupts():
                signal.raise_signal(signal.SIGINT)

    inside = {"__name__": "numba.core.dispatcher", "compiling": compiling}
    exec("def compile(): compiling()", inside)
    monkeypatch.setattr(interrupts, "_announced", -np.inf)
    with pytest.raises(KeyboardInterrupt), interrupts.safe_interrupts():
        inside["compile"]()
        time.sleep(5.0)
    assert capsys.readouterr().err.count("stopping when") == 1


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_acts_at_once_elsewhere_and_as_before_afterwards():
    from packmech.jit.interrupts import safe_interrupts

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), safe_interrupts():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_sigterm_ends_a_run_as_ctrl_c_does(tmp_path):
    (tmp_path / "scene.toml").write_text(SMALL)
    program = (
        "import signal, sys; sys.argv = ['packmech', 'run', 'scene.toml', '--out', 'saved.npz']\n"
        "from packmech.cli import main\n"
        "from packmech.cli.output import Watch\n"
        "signal.signal(signal.SIGINT, signal.{})\n"
        "Watch.__call__ = lambda self, stage, figures: signal.raise_signal(signal.SIGTERM)\n"
        "main()\n"
    )
    for usual in ("default_int_handler", "SIG_IGN"):
        words = [sys.executable, "-c", program.replace("{}", usual)]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 130, done.stderr
        assert "interrupted; the last finished packing is in saved.npz" in done.stderr
        assert pm.read_packing(tmp_path / "saved.npz").particles == 24
        (tmp_path / "saved.npz").unlink()


def test_lines_have_no_blanks_at_their_ends_where_the_output_is_no_terminal(tmp_path):
    lines = packmech("scenes", folder=tmp_path).stdout.splitlines()
    assert len(lines) > 20 and all(line == line.rstrip() for line in lines)


def test_wrong_words_on_the_command_line_are_one_line_and_exit_code_2(tmp_path):
    for words, message in ((("bake",), "bake"), (("jam", "--sped", "3"), "--sped"), (("run",), "SCENE")):
        done = packmech(*words, folder=tmp_path)
        assert done.returncode == 2 and message in one_line(done)
    assert packmech(folder=tmp_path).returncode == 0


def test_ctrl_c_stays_ignored_where_it_was():
    from packmech.jit.interrupts import safe_interrupts

    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with safe_interrupts():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("drive", ["jam", "quench"])
def test_ctrl_c_saves_the_last_finished_packing(monkeypatch, tmp_path, drive):
    def press_ctrl_c(self, stage, figures):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Watch, "__call__", press_ctrl_c)
    text = SMALL if drive == "jam" else SMALL.split("[drive]")[0] + '[drive]\nkind = "quench"\n'
    (tmp_path / "scene.toml").write_text(text)
    done = packmech("run", "scene.toml", "--out", "saved.npz", folder=tmp_path)
    assert done.returncode == 130
    assert "interrupted; the last finished packing is in saved.npz" in " ".join(done.stderr.split())
    assert np.isfinite(pm.read_packing(tmp_path / "saved.npz").position_nd).all()


def test_the_command_imports_nothing_heavy_before_the_first_force(tmp_path):
    program = (
        "import sys; sys.argv = ['packmech', 'jam', '--no-record']\n"
        "import packmech.minimize.first_order.fire as fire\n"
        "import packmech.minimize.program as program\n"
        "def stop(*arguments, **names): print(' '.join(sorted(sys.modules))); raise SystemExit\n"
        "fire.fire_steps = program.evaluate = stop\n"
        "from packmech.cli import main; main()\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    loaded = set(done.stdout.split())
    assert "packmech.protocols.jam" in loaded, done.stderr
    assert not loaded & {"cvxpy", "rerun", "matplotlib", "clarabel", "highspy", "gsd", "gymnasium", "pyarrow"}


def test_effects_names_every_effect_that_ships_with_its_columns(tmp_path):
    lines = packmech("effects", folder=tmp_path).stdout.splitlines()
    words = [line.split() for line in lines[lines.index("effects") :]]
    found = {one[0]: one[1].rstrip(",") for one in words if len(one) > 2}
    named = {kind.__name__ for kind in registered_effects() if kind.__module__.startswith("packmech.")}
    assert named <= set(found)
    shown = ("TwistingResistance", "DMT", "CapillaryBridge", "BackgroundDamping", "Langevin", "MeshWalls")
    assert [found[one] for one in shown] == ["rolling", "interactions", "interactions", "drag", "noise", "mesh"]


def test_a_packing_without_room_in_its_place_is_kept_elsewhere(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "end.npz").symlink_to("/dev/full")
    done = packmech("jam", "small.toml", "--no-record", "--out", "end.npz", folder=tmp_path)
    assert done.returncode == 2
    kept = re.search(
        r"out must be a file that can be written, got 'end\.npz' \(the packing is kept in (\S+)\)", one_line(done)
    )
    assert kept, done.stderr
    assert pm.read_packing(kept[1]).particles == 24


@pytest.mark.parametrize("verb", ["scenes", "effects"])
def test_output_without_room_is_one_line_and_without_a_place_is_none(verb):
    words = [sys.executable, "-m", "packmech", verb]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (2, "packmech: the output could not be written: No space left on device\n")
    done = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *words], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
