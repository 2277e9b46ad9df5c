"""Facts about recordings of played motions, read back, and about the command that makes them."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech import cli

rc = pytest.importorskip("rerun.chunk")


def read(path):
    """Return {entity: {column: [value per step]}} and the steps; static columns have one value."""
    found = {}
    for chunk in rc.RrdReader(str(path)).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            found.setdefault(str(chunk.entity_path), {}).setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    packing = pm.lattice_packing("kagome", repeats=(2, 2))
    played = pm.play_motion(packing, pm.classify_jamming(packing).strictly.unjamming_motion, amplitude=0.3, steps=12)
    path = pm.record_motion(played, tmp_path_factory.mktemp("motion") / "kagome.rrd")
    return played, read(path), path


def entity(found, name):
    return next(columns for path, columns in found.items() if path.strip("/") == name)


def test_recorded_positions_and_boxes_are_the_played_ones_to_the_bit(recorded):
    played, found, _ = recorded
    position = entity(found, "state/position")
    values = next(value for name, value in position.items() if "position_nd" in name)
    steps = position["step"]
    assert steps == list(range(played.steps + 1))
    for t, value in zip(steps, values, strict=True):
        assert np.array_equal(np.ravel(value), played.packing_t[t].position_nd.ravel())
    lattice = entity(found, "state/lattice")
    values = next(value for name, value in lattice.items() if "lattice_dd" in name)
    for t, value in zip(lattice["step"], values, strict=True):
        assert np.array_equal(np.ravel(value), played.packing_t[t].box.lattice_dd.ravel())


def test_contacts_are_drawn_as_staying_at_the_start_and_as_open_at_the_end(recorded):
    played, found, _ = recorded
    lines = {}
    for kind in ("stayed", "opened"):
        columns = entity(found, f"world/contacts/{kind}")
        strips = next(value for name, value in columns.items() if name.endswith("strips"))
        lines[kind] = [len(one) for one in strips if one is not None]
    assert lines["stayed"][0] >= len(played.contacts)
    assert lines["opened"][0] == 0
    assert lines["opened"][-1] >= played.opened_t[-1] > 0
    assert lines["stayed"][-1] < lines["stayed"][0]


def test_every_particle_has_an_arrow_in_the_direction_of_the_motion(recorded):
    played, found, _ = recorded
    columns = entity(found, "world/motion")
    vectors = np.array(next(value for name, value in columns.items() if name.endswith("vectors"))[0])
    start = played.packing_t[0].position_nd
    along = played.displacement_tnd[0] + start @ played.strain_tdd[0]
    cosine = (vectors * along).sum() / np.linalg.norm(vectors) / np.linalg.norm(along)
    assert cosine == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("what", ["fcc", "links"])
def test_motions_in_space_and_of_links_can_be_recorded(what, tmp_path):
    if what == "fcc":
        packing = pm.lattice_packing("sc", repeats=(3, 3, 3))
        motion = pm.classify_jamming(packing).unjamming_motion
    else:
        links = pm.Links([0], [1], [[0, 0]], [1.0])
        packing = pm.Packing([[1.0, 1.0], [2.0, 1.0], [1.5, 1.9]], [0.5] * 3, pm.Box.cubic(6.0, 2), links)
        motion = [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]]
    played = pm.play_motion(packing, motion, amplitude=0.1, steps=3)
    found = read(pm.record_motion(played, tmp_path / "motion.rrd"))
    assert len(entity(found, "state/position")["step"]) == played.steps + 1


def run(*words):
    return cli.execute(words)


def test_command_unjams_a_lattice_as_python_does(tmp_path, capsys):
    asked = ["--repeats", "3", "3", "--amplitude", "0.2", "--steps", "4"]
    files = {name: str(tmp_path / f"a.{name}") for name in ("rrd", "json", "npz")}
    code = run("unjam", "square", *asked, "--record", files["rrd"], "--json", files["json"], "--out", files["npz"])
    assert code == 0
    packing = pm.lattice_packing("square", repeats=(3, 3))
    played = pm.play_motion(packing, pm.classify_jamming(packing).unjamming_motion, amplitude=0.2, steps=4)
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert (numbers["collective"], numbers["outcome"], numbers["opened"]) == (
        "not jammed",
        "unjammed",
        played.opened_t[-1],
    )
    assert pm.read_packing(files["npz"]) == played.packing
    assert (tmp_path / "a.rrd").stat().st_size > 1000
    assert "unjammed" in capsys.readouterr().out


def test_command_says_that_there_is_no_motion_where_the_packing_is_jammed(tmp_path, capsys):
    pm.write_packing(pm.lattice_packing("triangular", repeats=(3, 3)), tmp_path / "a.npz")
    assert run("unjam", str(tmp_path / "a.npz")) == 1
    assert "no unjamming motion" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["unjam", "nonsense"], "packing must be a file or one of"),
        (["unjam", "square", "--strain", "open"], "strain must be one of"),
        (["unjam", "square", "--repeats", "3", "3", "--amplitude", "-1"], "amplitude must be"),
        (["unjam", "square", "--repeats", "3", "3", "--record", "a.txt"], "record must be"),
    ],
)
def test_command_refuses_what_it_cannot_do(words, message):
    with pytest.raises(ValueError, match=message):
        run(*words)
