"""Facts about scenes of grains with friction that flow or pile up."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute


def test_a_pile_stands_on_its_floor_and_is_no_wider_than_that():
    scene = pm.read_scene("pile")
    run = pm.run(scene)
    assert run.ok
    found = pm.contact_forces(scene.replace(packing=run.packing))
    floor = np.zeros(scene.packing.particles, dtype=bool)
    floor[list(scene.effects[-2].particles)] = True
    on_floor = floor[found.contacts.j_c] & ~floor[found.contacts.i_c]
    weight = 1e-4 * run.packing.mass_n[~floor].sum()
    # the floor holds up the whole weight, and pushes nothing aside
    assert found.force_cd[on_floor].sum(axis=0) == pytest.approx([0.0, weight], abs=1e-4 * weight)
    height = run.packing.position_nd[~floor, 1]
    assert height.min() > 0.5
    assert height.max() < 0.6 * scene.packing.position_nd[:, 1].max()


def test_the_drive_at_constant_pressure_is_the_call_with_its_fields(tmp_path, capsys):
    changes = {"drive.applied_strain": 2.0, "drive.skip_strain": 1.0, "packing.particles": 30}
    scene = pm.read_scene("dense-flow", changes=changes)
    run = pm.shear_at_pressure(scene, rate=3e-3, pressure=1e-3, applied_strain=2.0, skip_strain=1.0, check=False)
    words = ["run", "dense-flow", "--json", str(tmp_path / "flow.json")]
    execute([*words, *(f"--set={name}={value}" for name, value in changes.items())])
    told = json.loads((tmp_path / "flow.json").read_text())
    assert told["stress_ratio"] == run.stress_ratio[0]
    assert told["inertial_number"] == run.inertial_number
    assert "stress over pressure" in capsys.readouterr().out
