"""Facts about recordings written frame by frame: what was added is in the file, however it ended."""

import subprocess
import sys

import numpy as np
import pytest

import packmech as pm


@pytest.fixture(scope="module", autouse=True)
def strict_rerun():
    import rerun as rr

    rr.set_strict_mode(True)  # bad data are errors, not warnings
    yield
    rr.set_strict_mode(False)


def scene(links=False):
    if links:
        start = pm.cluster_packing(4, pm.Dimer(), dimension=2, packing_fraction=0.5, seed=1)
        return pm.Scene(start, (pm.Repulsion(),))
    return pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))


def strained(start, strain):
    shear = np.eye(start.dimension)
    shear[0, 1] = strain
    return start.replace(position_nd=start.position_nd @ shear.T, box=pm.Box(shear @ start.box.lattice_dd))


def read_back(path):
    """Return rows by (entity, column), each as {step: value}; what has no step by None."""
    import rerun.chunk as chunk

    reader = chunk.RrdReader(path)
    found = {}
    for piece in reader.stream().to_chunks():
        batch = piece.to_record_batch()
        steps = batch.column("step").to_pylist() if "step" in batch.schema.names else [None] * batch.num_rows
        for name in set(batch.schema.names) - {"log_time", "log_tick", "time", "step", "rerun.controls.RowId"}:
            values = found.setdefault((str(piece.entity_path), name), {})
            values.update((s, v) for s, v in zip(steps, batch.column(name).to_pylist(), strict=True) if v is not None)
    return found, len(reader.blueprints())


@pytest.mark.parametrize("links", [False, True])
def test_every_frame_is_read_back_exactly_with_its_figures_and_a_layout(tmp_path, links):
    start = scene(links)
    frames = [start.packing.replace(position_nd=start.packing.position_nd + 0.01 * k) for k in range(5)]
    with pm.Recording(tmp_path / "new" / "a.rrd", start, parameters={"rate": 2.5}) as recording:
        for k, packing in enumerate(frames):
            recording.add(packing, step=3 * k, time=0.5 * k, figures={"height": float(k), "gap": np.nan})
    assert recording.closed and recording.frames == 5
    found, layouts = read_back(recording.path)
    position = found["/state/position", "position_nd"]
    assert {step: value for step, value in position.items()} == {
        3 * k: packing.position_nd.ravel().tolist() for k, packing in enumerate(frames)
    }
    assert found["/series/height", "Scalars:scalars"] == {3 * k: [float(k)] for k in range(5)}
    assert ("/series/gap", "Scalars:scalars") not in found
    assert layouts == 1
    metadata = str(found["/__properties/packmech", "parameters_json"])
    assert '"rate": 2.5' in metadata and "repulsion" in metadata


@pytest.mark.parametrize("links", [False, True])
def test_packings_in_space_are_recorded_too(tmp_path, links):
    if links:
        start = pm.chain_packing(2, beads=4, dimension=3, packing_fraction=0.4, seed=1)
    else:
        start = pm.lattice_packing("fcc", repeats=(2, 2, 2), relative_overlap=0.01)
    scene = pm.Scene(start, (pm.Repulsion(),))
    with pm.Recording(tmp_path / "a.rrd", scene) as recording:
        recording.add(start)
        recording.add(start.replace(position_nd=start.position_nd + 0.1))
    found, layouts = read_back(recording.path)
    assert len(found["/world/particles", "Points3D:positions"]) == 2 and layouts == 1
    lines = found["/world/links/bonds" if links else "/world/contacts/sticking", "LineStrips3D:strips"]
    assert len(lines[1]) >= (6 if links else 6 * start.particles)


def test_blocks_that_are_full_are_written_and_every_frame_once(tmp_path, monkeypatch):
    monkeypatch.setattr("packmech.view.live.BLOCK_NUMBERS", 9 * 2 * 12 * 4)
    start = scene()
    with pm.Recording(tmp_path / "a.rrd", start) as recording:
        assert recording._writer.size == 4
        for _ in range(11):
            recording.add(start.packing)
    found, _ = read_back(recording.path)
    assert sorted(found["/world/contacts/sticking", "LineStrips2D:strips"]) == list(range(11))


def test_given_forces_and_sliding_contacts_are_what_is_drawn(tmp_path):
    start = scene()
    contacts = pm.find_contacts(start.packing)
    force, sliding = np.ones(len(contacts)), np.arange(len(contacts)) < 5
    force[0] = 3.0
    with pm.Recording(tmp_path / "a.rrd", start) as recording:
        recording.add(start.packing, contacts=contacts, force_c=force, sliding_c=sliding)
    found, _ = read_back(recording.path)
    width = np.array(found["/world/contacts/sliding", "LineStrips2D:radii"][0])
    assert 5 <= len(width) <= 10
    assert width.max() / width.min() == pytest.approx(3.0, rel=1e-6)


def test_bonded_pairs_are_drawn_as_bonds_and_not_as_contacts(tmp_path):
    start = scene()
    contacts = pm.find_contacts(start.packing)
    bonds = pm.bond_contacts(start.packing)
    with pm.Recording(tmp_path / "a.rrd", start.replace(effects=(*start.effects, bonds))) as recording:
        recording.add(start.packing)
    found, _ = read_back(recording.path)
    assert len(found["/world/bonds", "LineStrips2D:strips"][0]) >= len(contacts)
    assert found["/world/contacts/sticking", "LineStrips2D:strips"][0] == []


def test_two_figures_can_be_drawn_against_each_other(tmp_path):
    start = scene()
    with pm.Recording(tmp_path / "a.rrd", start, loop=("strain", "stress")) as recording:
        for k in range(8):
            recording.add(strained(start.packing, 0.01 * k), figures={"strain": 0.01 * k, "stress": float(k * k)})
    found, _ = read_back(recording.path)
    now = found["/loop/now", "Points2D:positions"]
    assert [now[k][0] for k in range(8)] == pytest.approx(np.array([[k / 7, k * k / 49] for k in range(8)]), abs=1e-6)


def test_results_are_kept_by_name(tmp_path):
    recording = pm.Recording(tmp_path / "a.rrd", scene())
    recording.add(scene().packing)
    assert recording.close({"return": 12.5}) == tmp_path / "a.rrd"
    found, _ = read_back(recording.path)
    assert "12.5" in str(found["/__properties/packmech", "results_json"])


def test_an_exception_leaves_a_complete_file(tmp_path):
    with pytest.raises(RuntimeError, match="stop"), pm.Recording(tmp_path / "a.rrd", scene()) as recording:
        recording.add(scene().packing)
        raise RuntimeError("stop")
    found, layouts = read_back(tmp_path / "a.rrd")
    assert list(found["/state/position", "position_nd"]) == [0] and layouts == 1


def test_a_recording_that_nobody_closed_is_complete_when_python_ends(tmp_path):
    code = f"""
import packmech as pm
scene = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(),))
recording = pm.Recording({str(tmp_path / "a.rrd")!r}, scene)
recording.add(scene.packing, figures={{"height": 1.0}})
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    found, layouts = read_back(tmp_path / "a.rrd")
    assert found["/series/height", "Scalars:scalars"] == {0: [1.0]} and layouts == 1


def test_what_cannot_be_added_is_refused_and_the_recording_goes_on(tmp_path):
    start = scene()
    other = pm.lattice_packing("square")
    with pm.Recording(tmp_path / "a.rrd", start) as recording:
        recording.add(start.packing, step=4)
        for bad, arguments, message in (
            (other, {}, "packing must have the scene's 9 particles in 2 dimensions, got"),
            (3, {}, "packing must be a Packing, got 3"),
            (start.packing.replace(radius_n=np.full(9, 0.1)), {}, "packing must have the scene's radii"),
            (start.packing, {"step": 4}, "step must be"),
            (start.packing, {"time": np.nan}, "time must be"),
            (start.packing, {"figures": {"a": "b"}}, r"figures\['a'\] must be a number, got 'b'"),
            (start.packing, {"force_c": [1.0]}, "force_c must come with the contacts"),
            (start.packing, {"contacts": pm.find_contacts(other)}, "contacts must be those of the packing"),
        ):
            with pytest.raises((TypeError, ValueError), match=message):
                recording.add(bad, **arguments)
        recording.add(start.packing)
    assert recording.frames == 2
    with pytest.raises(ValueError, match="recording must be open for more frames, got one that is closed: a.rrd"):
        recording.add(start.packing)
    assert recording.close() == recording.path


def test_an_existing_file_is_replaced(tmp_path):
    for count in (5, 2):
        with pm.Recording(tmp_path / "a.rrd", scene()) as recording:
            for _ in range(count):
                recording.add(scene().packing)
    found, _ = read_back(tmp_path / "a.rrd")
    assert sorted(found["/state/position", "position_nd"]) == [0, 1]
