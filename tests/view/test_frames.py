"""Facts about pictures: as many as asked, evenly spaced, of the run that was made, without a display."""

import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute
from packmech.view import drawing
from packmech.view.figures import DOTS, SIZE


@cache
def quenched():
    packing = pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene, pm.quench(scene, force_tolerance=1e-6, trace_every=5, trace_positions=True)


@cache
def sheared():
    packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2)
    bonds = bonds.select(np.arange(len(bonds)) % 3 == 0)
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.1), pm.Friction(0.5, 0.4, 0.1), bonds)
    scene = pm.Scene(packing, effects)
    strain = pm.SteadyStrain(1.5)
    return scene, pm.simulate(scene, steps=40, dt=0.02, applied_strain=strain, trace_every=4, trace_positions=True)


def pixels(path):
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image)


def test_as_many_pictures_as_asked_of_the_stated_size(tmp_path):
    scene, run = sheared()
    written = pm.write_pictures(run, tmp_path / "new" / "folder", scene=scene, frames=5)
    assert [path.name for path in written] == [f"frame-{k:04d}.png" for k in range(5)]
    for path in written:
        assert pixels(path).shape == (round(SIZE[1] * DOTS), round(SIZE[0] * DOTS), 3)


def test_no_more_pictures_than_moments_that_were_kept(tmp_path):
    scene, run = sheared()
    assert len(pm.write_pictures(run, tmp_path, scene=scene, frames=200)) == len(run.trace.step_t)


def test_pictures_differ_from_each_other_and_repeat_themselves(tmp_path):
    scene, run = sheared()
    one = pm.write_pictures(run, tmp_path / "one", scene=scene, frames=4)
    two = pm.write_pictures(run, tmp_path / "two", scene=scene, frames=4)
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
    assert len({path.read_bytes() for path in one}) == 4


def test_vector_pictures_repeat_themselves_too(tmp_path):
    scene, run = sheared()
    one = pm.write_pictures(run, tmp_path / "one", scene=scene, frames=2, format="svg")
    two = pm.write_pictures(run, tmp_path / "two", scene=scene, frames=2, format="svg")
    assert [path.suffix for path in one] == [".svg", ".svg"]
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
    assert one[0].read_text().lstrip().startswith("<?xml")


def test_writing_pictures_changes_no_bit_of_the_run(tmp_path):
    scene, run = sheared()
    before = run.packing.position_nd.tobytes(), run.trace.position_tnd.tobytes()
    pm.write_pictures(run, tmp_path, scene=scene, frames=3)
    assert (run.packing.position_nd.tobytes(), run.trace.position_tnd.tobytes()) == before


def test_a_disc_is_drawn_in_its_place(tmp_path):
    packing = pm.Packing([[1.0, 3.0]], [0.5], pm.Box.cubic(4.0, 2))
    scene = pm.Scene(packing, (pm.Repulsion(),))
    run = pm.Run(packing, pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0)
    image = pixels(pm.write_pictures(run, tmp_path, scene=scene, frames=2)[0]).astype(int)
    blue = np.abs(image - np.array(drawing.LARGE)).sum(axis=2) < 6
    rows, columns = np.nonzero(blue)
    # the corners of the box: the leftmost and rightmost, lowest and highest pixels of its outline
    outline = np.abs(image - np.array(drawing.OUTLINE)).sum(axis=2) < 60
    outline[:, image.shape[1] * 2 // 3 :] = False
    outline[: image.shape[0] // 12] = False
    down, across = np.nonzero(outline)
    x = 4.0 * (columns.mean() - across.min()) / np.ptp(across)
    y = 4.0 * (down.max() - rows.mean()) / np.ptp(down)
    assert [x, y] == pytest.approx([1.0, 3.0], abs=0.05)


def test_spheres_are_drawn_too(tmp_path):
    packing = pm.random_packing(30, dimension=3, packing_fraction=0.6, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    run = pm.Run(packing, pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0)
    image = pixels(pm.write_pictures(run, tmp_path, scene=scene, frames=2)[0])
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 30


def test_no_display_is_needed_and_none_is_looked_for(tmp_path):
    code = f"""
import sys
import packmech as pm
packing = pm.random_packing(16, dimension=2, packing_fraction=0.8, seed=3)
run = pm.Run(packing, pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0)
scene = pm.Scene(packing, (pm.Repulsion(),))
print(len(pm.write_pictures(run, {str(tmp_path)!r}, scene=scene, frames=2)), "matplotlib.pyplot" in sys.modules)
"""
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=bare)
    assert done.stdout.split() == ["2", "False"]


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"frames": 1}, ValueError, "frames must be an integer at least 2, got 1"),
        ({"format": "gif"}, ValueError, "format must be one of 'png', 'svg', got 'gif'"),
        ({"folder": 3}, TypeError, "folder must be a folder's name, got 3"),
        ({"run": None}, TypeError, "run must be a Run"),
    ],
)
def test_bad_arguments_are_named(tmp_path, given, error, message):
    scene, run = quenched()
    with pytest.raises(error, match=message):
        pm.write_pictures(**{"run": run, "folder": tmp_path, "scene": scene, **given})


def test_the_command_writes_pictures_the_packing_and_what_was_seen_live(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = [
        "run",
        "quench",
        "--frames",
        "3",
        "--format",
        "svg",
        "--pictures",
        "pictures",
        "--live",
        "live.rrd",
        "--out",
        "end.npz",
    ]
    assert execute([*words, "--modes", "0"]) == 0
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == [
        "frame-0000.svg",
        "frame-0001.svg",
        "frame-0002.svg",
    ]
    assert pm.read_packing(tmp_path / "end.npz").particles > 0
    assert "pictures: 3 in pictures" in capsys.readouterr().out
    assert (tmp_path / "live.rrd").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--frames", "3", "--format", "gif"], "format must be one of 'png', 'svg', got 'gif'"),
        (["--frames", "1"], "frames must be an integer at least 2, got 1"),
        (["--live", "live.txt"], "live must be 'viewer', an address such as"),
    ],
)
def test_the_command_names_what_it_cannot_show_before_it_runs(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        execute(["run", "quench", *words])
