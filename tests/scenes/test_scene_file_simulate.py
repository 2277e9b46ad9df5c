"""Facts about scenes that are followed through time: the drive in files, and what the command prints of them."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute

SHORT = [
    "single-sphere-moving",
    "single-sphere-spinning",
    "two-spheres-central",
    "two-spheres-tangential",
    "two-spheres-general",
    "sphere-against-plate",
    "two-spheres-across",
]
SHEARED = ["assembly-sheared", "crosslinked-sheared"]


def ran(name, folder, *more):
    arguments = ["run", str(name), "--json", str(folder / "a.json"), *more]
    assert execute(arguments) == 0
    return json.loads((folder / "a.json").read_text())


def test_every_scenario_of_the_reference_package_ships_as_a_scene():
    from packmech.validation.particle_shear import SCENARIOS

    assert {name.replace("_", "-") for name in SCENARIOS} == {*SHORT, *SHEARED, "assembly-at-rest"}
    assert {name.replace("_", "-") for name in SCENARIOS} <= set(pm.list_scenes())


@pytest.mark.parametrize("name", SHORT)
def test_the_command_prints_stress_energy_and_momentum_of_a_disc_or_two(name, tmp_path, capsys):
    numbers = ran(name, tmp_path)
    said = capsys.readouterr().out
    for words in ("overall stress", "contact stress", "spin stress", "kinetic stress", "energy", "momentum"):
        assert words in said
    scene = pm.read_scene(name)
    assert numbers["steps"] == scene.drive.steps and numbers["time_step"] == scene.drive.dt
    overall = np.array(numbers["stress"]["overall"])
    assert abs(overall[0, 1] - overall[1, 0]) <= 1e-13 * np.abs(overall).max()


@pytest.mark.parametrize("name", SHEARED)
def test_the_command_prints_the_stress_at_the_end_of_a_shear_without_a_whole_period(name, tmp_path, capsys):
    numbers = ran(name, tmp_path)
    assert "stress at the end" in capsys.readouterr().out
    assert "storage_modulus" not in numbers
    overall = -np.array(numbers["end_stress"])
    assert (np.diag(overall) > 500.0).all()
    assert abs(overall[0, 1] - overall[1, 0]) <= 1e-13 * np.abs(overall).max()


@pytest.mark.slow
def test_an_assembly_at_rest_stays_at_rest(tmp_path):
    numbers = ran("assembly-at-rest", tmp_path)
    assert (-np.diag(numbers["stress"]["overall"]) > 500.0).all()
    assert numbers["kinetic_energy"] < 1e-9 * numbers["potential_energy"]


def test_a_drive_is_read_back_equal_and_does_what_simulate_does(tmp_path):
    packing = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), mass_n=[1.0, 2.0])
    drive = pm.SimulateDrive(duration=2.0, dt=0.1, velocities=((1.0, 0.0), (0.0, 0.5)))
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),), drive)
    other = scene.replace(
        drive=pm.SimulateDrive(steps=3, method=pm.SemiImplicitEuler(), spins=((0.5,), (0.0,)), held=(1,))
    )
    for one in (other, scene):
        pm.write_scene(one, tmp_path / "a.toml")
        assert pm.read_scene(tmp_path / "a.toml") == one
    numbers = ran(tmp_path / "a.toml", tmp_path, "--out", str(tmp_path / "end.npz"))
    run = pm.simulate(scene, duration=2.0, dt=0.1, velocity_nd=[[1.0, 0.0], [0.0, 0.5]])
    assert pm.read_packing(tmp_path / "end.npz") == run.packing
    assert numbers["steps"] == 20 and numbers["momentum"] == pytest.approx([1.0, 1.0], rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "drive.steps must be given, or else duration, got neither"),
        ({"steps": 2, "duration": 1.0}, "drive.steps must be given, or else duration, got both"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        pm.SimulateDrive(**changes)


def test_who_is_held_must_be_there(tmp_path):
    packing = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    scene = pm.Scene(packing, (pm.Repulsion(),), pm.SimulateDrive(steps=2, held=(2,)))
    pm.write_scene(scene, tmp_path / "a.toml")
    with pytest.raises(ValueError, match="drive.held must be numbers of 2 particles, got 2"):
        execute(["run", str(tmp_path / "a.toml")])


def test_a_run_without_friction_is_recorded_too(tmp_path):
    packing = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    pm.write_scene(pm.Scene(packing, (pm.Repulsion(),), pm.SimulateDrive(steps=2)), tmp_path / "a.toml")
    assert execute(["run", str(tmp_path / "a.toml"), "--record", str(tmp_path / "a.rrd")]) == 0
    assert (tmp_path / "a.rrd").stat().st_size > 0


def test_a_thrown_ball_is_stopped_by_a_resistance_to_rolling_that_a_file_gives_the_floor(tmp_path):
    scene = pm.read_scene("rolling-ball")
    assert scene.effects[0].rolling == pm.ConstantRolling(0.05, 20.0)
    pm.write_scene(scene, tmp_path / "again.toml")
    assert pm.read_scene(tmp_path / "again.toml").effects == scene.effects
    drive = scene.drive
    run = pm.simulate(scene, duration=drive.duration, velocity_nd=drive.velocities, ledger=True)
    assert np.abs(run.velocity_nd).max() < 1e-12
    lost = {name: curve[-1] for name, curve in run.ledger.dissipated.items()}
    # what a ball keeps that slips until it rolls is five sevenths of its energy, less a part that rolls as it slips
    assert lost["sliding"] == pytest.approx(0.5 * 2.0 / 7.0, rel=0.2)
    assert sum(lost.values()) == pytest.approx(0.5, rel=1e-3)


def test_the_shipped_ball_that_spins_is_stopped_as_its_resistance_to_twisting_says():
    scene = pm.read_scene("spinning-ball")
    # a torque mu_t m g h on I = 2/5 m r^2, at the height h of the center, once the spring is at its limit: with its
    # dashpot that is after less than the time in which the ball turns by mu_t m g / (k h)
    slowing, turned = 0.02 * 0.4995 / (0.4 * 0.25), 0.02 / (1e3 * 0.4995)
    run = pm.simulate(scene, duration=4.0, spin_nk=[[0.0, 1.0, 0.0]])
    assert run.spin_nk[0, 1] == pytest.approx(1.0 - 4.0 * slowing, abs=slowing * turned)
    assert run.packing.position_nd[0] == pytest.approx([5.0, 0.4995, 5.0], abs=1e-12)
