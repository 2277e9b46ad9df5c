"""Facts about `packmech run` with scenes that are strained: what it writes of them, and how it goes on after Ctrl-C."""

import json
import math
import signal

import numpy as np
import pytest

import packmech as pm
from packmech.cli import FAILED, INTERRUPTED, execute
from packmech.dynamics.engine import Engine
from packmech.rheology import strain_run as travel

CRYSTAL = """
[packing]
kind = "lattice"
name = "triangular"
repeats = 4
relative_overlap = 0.01

[[effects]]
kind = "repulsion"
law = "linear-spring"

[[effects]]
kind = "background-damping"
rate = 0.5

[drive]
"""
DRIVES = {
    "sine": 'kind = "oscillatory-shear"\namplitude = 0.01\nfrequency = 0.05\nperiods = 3\nsamples_per_period = 20\n',
    "flow": 'kind = "steady-shear"\nrates = [0.1, 0.2]\napplied_strain = 0.4\nskip_strain = 0.2\nsamples = 40\n',
    "squeeze": 'kind = "ramp-strain"\nrate = -0.01\napplied_strain = 0.05\nmode = "isotropic"\nsamples = 20\n',
    "creep": 'kind = "creep"\nstress = 0.002\nduration = 80.0\nhold = 40.0\n',
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the scenes in it, where the command runs and looks up every few steps."""
    for name, drive in DRIVES.items():
        (tmp_path / f"{name}.toml").write_text(CRYSTAL + drive)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(travel, "_CHUNK", 2000)
    monkeypatch.setattr("packmech.rheology.steady._REPORT", 5)
    return tmp_path


def run(*words):
    return execute(["run", *words])


def stop_at(monkeypatch, steps):
    """Press Ctrl-C in the next run, once it has taken so many steps."""
    usual, taken = Engine.advance, [0]

    def advance(running, due, ledger=None):
        taken[0] += due
        if taken[0] > steps:
            monkeypatch.setattr(Engine, "advance", usual)
            signal.raise_signal(signal.SIGINT)
        return usual(running, due, ledger)

    monkeypatch.setattr(Engine, "advance", advance)


def plain(path):
    """The numbers in a file, less those that depend on the clock."""
    return {name: value for name, value in json.loads(path.read_text()).items() if "seconds" not in name}


@pytest.mark.parametrize("name", DRIVES)
def test_the_same_command_goes_on_after_an_interrupt_and_ends_with_the_same_numbers(name, folder, monkeypatch, capsys):
    assert run(f"{name}.toml", "--json", "whole.json", "--out", "whole.npz") == 0
    # nothing is left behind where nothing was interrupted
    kept = folder / f"{name}.checkpoint.npz"
    assert not kept.exists()
    command = (f"{name}.toml", "--json", "again.json", "--out", "again.npz")
    stop_at(monkeypatch, 50)
    assert run(*command) == INTERRUPTED
    assert kept.exists()
    assert f"the same command goes on from {kept.name}" in capsys.readouterr().err
    assert run(*command) == 0
    assert f"going on from {kept.name}" in capsys.readouterr().err
    assert plain(folder / "again.json") == plain(folder / "whole.json")
    assert pm.read_packing("again.npz") == pm.read_packing("whole.npz")
    assert not kept.exists()


def test_a_flow_curve_with_a_rate_that_did_not_finish_is_written_and_the_exit_code_says_so(folder, capsys):
    text = (CRYSTAL + DRIVES["flow"]).replace("rates = [0.1, 0.2]", "rates = [0.001, 0.5]\ndt = 3.0")
    (folder / "flow.toml").write_text(
        text.replace('law = "linear-spring"', 'law = { kind = "linear-spring", stiffness = 50.0 }')
    )
    assert run("flow.toml", "--json", "flow.json") == FAILED
    assert "packmech: rate-0.001: The time step is too long" in capsys.readouterr().err
    numbers = plain(folder / "flow.json")
    assert numbers["outcome"] == "step_too_long"
    assert numbers["stresses"][0] is None and numbers["stresses"][1] > 0.0


def test_a_checkpoint_that_was_asked_for_stays_and_spares_the_work(folder, monkeypatch):
    command = ("sine.toml", "--checkpoint", "mine.npz", "--json", "a.json")
    assert run(*command) == 0
    assert (folder / "mine.npz").exists() and not (folder / "sine.checkpoint.npz").exists()
    before = plain(folder / "a.json")
    stop_at(monkeypatch, 0)
    assert run(*command) == 0
    assert plain(folder / "a.json") == before


def test_a_full_disk_loses_the_checkpoint_and_no_result(folder, monkeypatch, capsys):
    assert run("flow.toml", "--json", "a.json") == 0
    right = plain(folder / "a.json")

    def full(*given, **named):
        raise OSError(28, "No space left on device", "mine.npz")

    monkeypatch.setattr("packmech.loop.checkpoint.write_checkpoint", full)
    assert run("flow.toml", "--checkpoint", "mine.npz", "--json", "b.json") == 0
    assert "the checkpoint could not be written: [Errno 28] No space left on device: 'mine.npz'" in (
        capsys.readouterr().err
    )
    assert plain(folder / "b.json") == right and not (folder / "mine.npz").exists()


def test_a_checkpoint_of_another_scene_is_refused(folder):
    assert run("sine.toml", "--checkpoint", "mine.npz") == 0
    (folder / "sine.toml").write_text(CRYSTAL.replace("0.5", "0.4") + DRIVES["sine"])
    with pytest.raises(ValueError, match=r"checkpoint must hold a run of the same scene and settings.*effects\[1\]"):
        run("sine.toml", "--checkpoint", "mine.npz")


def test_a_checkpoint_is_refused_where_nothing_is_strained(folder):
    (folder / "rest.toml").write_text(CRYSTAL + 'kind = "quench"\n')
    with pytest.raises(ValueError, match="checkpoint must be left out for a drive that keeps none"):
        run("rest.toml", "--checkpoint", "mine.npz")


@pytest.mark.parametrize(("name", "stems"), [("flow", ["-rate-0.1", "-rate-0.2"]), ("squeeze", [""])])
def test_recordings_pictures_and_live_streams_are_written_of_every_strained_run(name, stems, folder, capsys):
    words = ("--record", "run.rrd", "--live", "live.rrd", "--frames", "3", "--format", "svg", "--pictures", "pictures")
    assert run(f"{name}.toml", *words) == 0
    for stem in stems:
        assert (folder / f"run{stem}.rrd").stat().st_size > 10_000
        pictures = sorted((folder / "pictures" / stem.removeprefix("-")).glob("frame-*.svg"))
        assert len(pictures) == 3
        assert pictures[0].read_bytes() != pictures[-1].read_bytes()
    assert (folder / "live.rrd").stat().st_size > 10_000
    assert "live: " in capsys.readouterr().out


def test_a_squeezed_crystal_has_the_pressure_of_its_overlaps_and_creep_the_compliance_of_the_crystal(folder):
    run("squeeze.toml", "--json", "squeeze.json")
    numbers = plain(folder / "squeeze.json")
    assert numbers["strain"] == pytest.approx(-0.05)
    # three contacts a disc, each of force k (1 - 0.95 * 0.99): pressure = sqrt(3) force / distance
    distance = 0.95 * 0.99
    assert numbers["pressure"] == pytest.approx(np.sqrt(3.0) * (1.0 - distance) / distance, rel=1e-3)
    run("creep.toml", "--json", "creep.json")
    numbers = plain(folder / "creep.json")
    # sqrt(3)/4 less the pressure's part
    assert 1.0 / numbers["compliance"] == pytest.approx(0.42, abs=0.01)
    assert abs(numbers["strain"]) < 1e-2 * numbers["strain_under_stress"]


DRAG = 'kind = "background-damping"\nrate = 0.5\n'
BONDS = 'kind = "bonds"\nof = "contacts"\ntangential_stiffness = 0.5\ndamping = 0.5\nbreaks_at = { stretch = 0.02 }\n'
BRITTLE = CRYSTAL.replace("triangular", "square").replace(DRAG, BONDS)


def test_the_numbers_are_those_of_the_bonds_that_are_left(folder, capsys):
    """A square lattice that is drawn out along x loses its bonds along x: columns are left."""
    drive = 'kind = "ramp-strain"\nrate = 0.01\napplied_strain = 0.05\nmode = "uniaxial"\nsamples = 20\n'
    (folder / "torn.toml").write_text(BRITTLE + drive)
    assert run("torn.toml", "--json", "torn.json") == 0
    numbers = json.loads((folder / "torn.json").read_text())
    whole = pm.read_scene("torn.toml")
    total = len(whole.effects[1])
    across = round(math.sqrt(whole.packing.particles))
    assert numbers["bonds_broken"] == total // 2 == len(numbers["broken_bonds"]["step"])
    assert numbers["bonds"] == numbers["bonds_left"] == total - total // 2
    assert numbers["fragments"] == across
    assert "16 of 32" in capsys.readouterr().out


def test_functions_that_measure_a_scene_see_the_bonds_that_are_left(folder):
    drive = 'kind = "ramp-strain"\nrate = 0.01\napplied_strain = 0.05\nmode = "uniaxial"\nsamples = 20\n'
    (folder / "torn.toml").write_text(BRITTLE + drive)
    measures = [lambda scene: {"counted": len(scene.effects[1])}]
    found = pm.run_ensemble("torn.toml", {"drive.rate": 0.01}, folder / "members", measures=measures, workers=0)
    assert found["counted"].tolist() == [16]


def test_bonds_with_limits_do_not_break_while_a_scene_comes_to_rest(folder):
    drive = 'kind = "oscillatory-shear"\namplitude = 0.3\nfrequency = 0.05\nperiods = 2\nsamples_per_period = 20\n'
    (folder / "shaken.toml").write_text(BRITTLE.replace('"square"', '"triangular"') + drive)
    run("shaken.toml", "--json", "shaken.json")
    numbers = json.loads((folder / "shaken.json").read_text())
    assert numbers["oscillation_ratio"] < 0.1 and numbers["bonds_broken"] > 0
    assert min(numbers["broken_bonds"]["time"]) > 0.0


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_accounts_for_its_energy_where_it_says_so(name, folder, capsys):
    assert run(f"{name}.toml", "--set", "drive.ledger=true", "--json", "a.json") == 0
    found = json.loads((folder / "a.json").read_text())["ledger"]
    ledgers = found if name == "flow" else [found]
    assert len(ledgers) == (2 if name == "flow" else 1)
    for one in ledgers:
        kinds = ("work", "stored", "dissipated", "integrator")
        work, stored, dissipated, left = (sum(one[kind].values()) for kind in kinds)
        assert one["closed"] and work != 0.0
        # of energies of the order of 1e-3
        assert work == pytest.approx(one["kinetic"] + stored + dissipated + left, abs=1e-13)
    said = capsys.readouterr().out
    assert said.count("where the energy went") == len(ledgers) and "energy ledger" in said
