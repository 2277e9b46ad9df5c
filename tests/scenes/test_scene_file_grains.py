"""Facts about scenes of grains with friction that flow or pile up."""

import json
import pathlib

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute


def test_a_pile_stands_on_its_floor_under_its_whole_weight():
    scene = pm.read_scene("pile")
    run = pm.run(scene)
    assert run.ok
    found = pm.contact_forces(scene.replace(packing=run.packing))
    floor = np.zeros(scene.packing.particles, dtype=bool)
    floor[list(scene.effects[-2].particles)] = True
    on_floor = floor[found.contacts.j_c] & ~floor[found.contacts.i_c]
    weight = 1e-4 * run.packing.mass_n[~floor].sum()
    # the floor holds up the whole weight and pushes nothing aside, but for what is not balanced on each disc
    unbalanced = (~floor).sum() * found.residual * found.mean_force
    assert unbalanced < 1e-5 * weight
    assert found.force_cd[on_floor].sum(axis=0) == pytest.approx([0.0, weight], abs=unbalanced)
    # the slope of the surface of a collapsed column is below the angle of friction, arctan(.5) = 26.6 degrees
    x, y = run.packing.position_nd[~floor].T
    distance = np.arange(2, 14, 2)
    height = [y[abs(x - x.mean()) > far].max() for far in distance]
    assert 8.0 < np.degrees(np.arctan(-np.polyfit(distance, height, 1)[0])) < 26.6


def test_the_command_runs_a_pile(tmp_path, capsys):
    assert execute(["run", "pile", "--json", str(tmp_path / "pile.json")]) == 0
    numbers = json.loads((tmp_path / "pile.json").read_text())
    assert numbers["particles"] == 260
    assert numbers["force_residual"] <= pm.read_scene("pile").drive.force_tolerance
    assert "coordination number" in capsys.readouterr().out


def test_particles_that_are_listed_are_not_so_many_as_one_likes():
    with pytest.raises(ValueError, match="particles must be left out for a scene that lists its particles"):
        execute(["run", "pile", "--particles", "100"])


def test_grains_are_pressed_to_a_pressure_that_is_reached_in_seconds_where_none_is_given():
    start = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.7, seed=1)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(0.5))
    run = pm.jam(pm.Scene(start, effects), strain="isotropic")
    assert run.report["pressure_asked"] == 1e-3
    assert run.report["pressure"] == pytest.approx(1e-3, rel=1e-8)


def test_the_drive_at_constant_pressure_is_the_call_with_its_fields(tmp_path, capsys):
    changes = {"drive.applied_strain": 2.0, "drive.skip_strain": 1.0, "packing.particles": 30}
    scene = pm.read_scene("dense-flow", changes=changes)
    run = pm.shear_at_pressure(scene, rate=3e-3, pressure=1e-3, applied_strain=2.0, skip_strain=1.0, check=False)
    words = ["run", "dense-flow", "--json", str(tmp_path / "flow.json")]
    execute([*words, *(f"--set={name}={value}" for name, value in changes.items())])
    numbers = json.loads((tmp_path / "flow.json").read_text())
    assert numbers["stress_ratio"] == run.stress_ratio[0]
    assert numbers["inertial_number"] == run.inertial_number
    assert "stress over pressure" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("added", "said"),
    [
        ("packing.density", "packing.density must be left out beside several materials, which have their own, got 2.0"),
        ("walls", r"effects\[0\].law must be given for walls beside several materials, got nothing"),
    ],
)
def test_what_several_materials_leave_open_or_have_themselves_is_named(tmp_path, added, said):
    text = (pathlib.Path(pm.__file__).parent / "scenes" / "glass-and-steel.toml").read_text(encoding="utf-8")
    if added == "walls":
        text = text.replace("[drive]", '[[effects]]\nkind = "walls"\naxis = 1\nlow = 0.0\nhigh = 2.0\n\n[drive]')
    else:
        text = text.replace("packing_fraction = 0.5", "packing_fraction = 0.5\ndensity = 2.0")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        pm.read_scene(tmp_path / "mine.toml")


def test_a_glass_and_a_steel_ball_rebound_from_wood_as_their_materials_say():
    scene = pm.read_scene("glass-and-steel-on-wood")
    run = pm.run(scene)
    height, speed = run.packing.position_nd[:, 2] - 0.5, run.velocity_nd[:, 2]
    # sqrt(e of both) is left of the speed, and a part as large as its square of the energy of a fall by 2
    assert 0.5 * speed**2 + height == pytest.approx([2.0 * 0.9 * 0.6, 2.0 * 0.4 * 0.6], rel=2e-2)
    # both slide all through it: its push is (1 + e) times the speed of the fall, 2, and they lose mu times that
    push = 2.0 * (1.0 + np.sqrt([0.9 * 0.6, 0.4 * 0.6]))
    assert 2.0 - run.velocity_nd[:, 0] == pytest.approx(np.sqrt([0.02 * 0.1, 0.1 * 0.1]) * push, rel=2e-2)
