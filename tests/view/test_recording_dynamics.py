"""Facts about recordings of time integrations: what is drawn is where it is, and recording changes no bit of a run."""

import json
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import packmech as pm
from packmech.view import drawing
from packmech.view.live import LiveRecording
from packmech.view.trajectory import draw_moving, trajectory_of_run, turned_marks

STEPS, EVERY = 40, 7


@pytest.fixture(scope="module", autouse=True)
def strict_rerun():
    import rerun as rr

    rr.set_strict_mode(True)  # bad data are errors, not warnings
    yield
    rr.set_strict_mode(False)


@cache
def scene():
    """Discs with friction, a third of them bonded."""
    packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2)
    bonds = bonds.select(np.arange(len(bonds)) % 3 == 0)
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.1), pm.Friction(0.5, 0.4, 0.1), bonds)
    return pm.Scene(packing, effects)


def sheared(**more):
    strain = pm.SteadyStrain(1.5)
    return pm.simulate(
        scene(), steps=STEPS, dt=0.02, applied_strain=strain, trace_every=EVERY, trace_positions=True, **more
    )


@cache
def run():
    return sheared()


class ReadBack:
    """Every column of a recording, by entity path and column name."""

    def __init__(self, path: Path) -> None:
        import rerun.chunk as chunk

        self.step, self.column = {}, {}
        for piece in chunk.RrdReader(path).stream().to_chunks():
            batch = piece.to_record_batch()
            entity = str(piece.entity_path)
            if "step" in batch.schema.names:
                self.step.setdefault(entity, []).extend(batch.column("step").to_pylist())
            for name in set(batch.schema.names) - {"log_time", "rerun.controls.RowId"}:
                self.column.setdefault((entity, name), []).extend(batch.column(name).to_pylist())

    def at_steps(self, entity: str, name: str) -> dict[int, list]:
        rows = [value for value in self.column[entity, name] if value is not None]
        return dict(zip(self.step[entity], rows, strict=True))


@pytest.fixture(scope="module")
def back(tmp_path_factory):
    path = pm.record_run(
        run(), tmp_path_factory.mktemp("run") / "run.rrd", scene=scene(), parameters={"rate": 1.5}, summary="# shear"
    )
    return ReadBack(path)


def test_positions_and_boxes_are_read_back_exactly(back):
    trace = run().trace
    position, lattice = (
        back.at_steps("/state/position", "position_nd"),
        back.at_steps("/state/lattice", "lattice_dd"),
    )
    assert sorted(position) == trace.step_t.tolist()
    for t, step in enumerate(trace.step_t.tolist()):
        assert position[step] == trace.position_tnd[t].ravel().tolist()
        assert lattice[step] == trace.lattice_tdd[t].ravel().tolist()


def test_sticking_and_sliding_contacts_are_entities_of_their_own_with_a_line_for_each_end_inside(back):
    trace = run().trace
    sticking = back.at_steps("/world/contacts/sticking", "LineStrips2D:strips")
    sliding = back.at_steps("/world/contacts/sliding", "LineStrips2D:strips")
    assert any(len(lines) for lines in sliding.values())
    for t, step in enumerate(trace.step_t.tolist()):
        one = trace.touching_t[t]
        assert len(sliding[step]) >= one.sliding_c.sum()
        assert len(sticking[step]) >= (~one.sliding_c).sum()
        assert len(sticking[step]) + len(sliding[step]) <= 2 * len(one.i_c)


def test_each_bond_is_a_line_as_long_as_the_bond(back):
    bonds, trace = scene().effects[-1], run().trace
    lines = back.at_steps("/world/bonds", "LineStrips2D:strips")
    for t, step in enumerate(trace.step_t.tolist()):
        position = trace.position_tnd[t]
        vector = position[bonds.j_b] - position[bonds.i_b] + bonds.image_bd @ trace.lattice_tdd[t].T
        drawn = np.array(lines[step])[: len(bonds)]
        assert np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1) == pytest.approx(
            np.linalg.norm(vector, axis=1), rel=1e-5
        )


def test_strain_and_stress_against_step_are_read_back(back):
    trace = run().trace
    for name, value_t in (("strain", trace.strain_t), ("stress_xy", trace.overall_stress_tdd[:, 0, 1])):
        seen = back.at_steps(f"/series/{name}", "Scalars:scalars")
        assert [seen[step][0] for step in trace.step_t.tolist()] == value_t.tolist()


def test_stress_against_strain_is_a_curve_with_the_present_place_on_it(back):
    trace = run().trace
    (curve,) = back.column["/loop/curve", "LineStrips2D:strips"]
    whole = np.column_stack([trace.strain_t, trace.overall_stress_tdd[:, 0, 1]])
    assert np.array(curve[0]) == pytest.approx(whole / np.abs(whole).max(axis=0), abs=1e-6)
    now = back.at_steps("/loop/now", "Points2D:positions")
    assert np.array([now[step][0] for step in trace.step_t.tolist()]) == pytest.approx(np.array(curve[0]), abs=1e-6)


def test_the_parameters_tell_every_effect(back):
    (metadata,) = back.column["/__properties/packmech", "parameters_json"]
    metadata = json.loads(metadata[0] if isinstance(metadata, list) else metadata)
    assert [effect["kind"] for effect in metadata["effects"]] == ["repulsion", "contact-damping", "friction", "bonds"]
    assert metadata["rate"] == 1.5


def test_writing_a_recording_changes_no_bit_of_what_follows(tmp_path):
    path = tmp_path / "run.ckpt.npz"
    pm.simulate(
        scene(),
        steps=20,
        dt=0.02,
        applied_strain=pm.SteadyStrain(1.5),
        trace_every=EVERY,
        trace_positions=True,
        checkpoint=path,
    )
    half = pm.resume(path, scene(), steps=28)
    before = half.packing.position_nd.tobytes(), half.trace.position_tnd.tobytes()
    pm.record_run(half, tmp_path / "half.rrd", scene=scene())
    assert (half.packing.position_nd.tobytes(), half.trace.position_tnd.tobytes()) == before
    whole = pm.resume(path, scene(), steps=STEPS)
    assert whole.packing == run().packing
    assert whole.trace.position_tnd.tobytes() == run().trace.position_tnd.tobytes()


def test_keeping_positions_and_contacts_changes_no_bit_of_the_run():
    bare = pm.simulate(scene(), steps=STEPS, dt=0.02, applied_strain=pm.SteadyStrain(1.5), trace_every=EVERY)
    assert bare.packing == run().packing
    assert bare.spin_nk.tobytes() == run().spin_nk.tobytes()
    assert bare.trace.overall_stress_tdd.tobytes() == run().trace.overall_stress_tdd.tobytes()


def test_watching_live_changes_no_bit_of_the_run_and_sends_what_is_seen(tmp_path):
    target = tmp_path / "live.rrd"
    live = LiveRecording(scene(), target, least_seconds=0.0)
    watched = sheared(progress=live.watch)
    live.close()
    assert watched.packing == run().packing
    assert watched.trace.overall_stress_tdd.tobytes() == run().trace.overall_stress_tdd.tobytes()
    back = ReadBack(target)
    position = back.at_steps("/state/position", "position_nd")
    assert sorted(position) == run().trace.step_t.tolist()[1:]
    assert live.shown == len(position)
    assert position[STEPS] == run().packing.position_nd.ravel().tolist()
    assert sorted(back.step["/world/contacts/sliding"]) == sorted(position)
    strain = back.at_steps("/series/strain", "Scalars:scalars")
    assert strain[STEPS] == [run().strain]


def test_marches_that_follow_each_other_are_shown_one_after_the_other(tmp_path):
    target = tmp_path / "live.rrd"
    live = LiveRecording(scene(), target, least_seconds=0.0)
    for _ in range(2):
        sheared(progress=live.watch)
    live.close()
    shown = sorted(ReadBack(target).at_steps("/state/position", "position_nd"))
    each = run().trace.step_t.tolist()[1:]
    assert shown == [*each, *(each[-1] + 1 + step for step in each)]


def test_a_viewer_that_listens_receives_what_is_sent_live():
    import rerun as rr

    listener = rr.RecordingStream("packmech-listener")
    address = listener.serve_grpc(grpc_port=9917)
    live = LiveRecording(scene(), address, least_seconds=0.0)
    sheared(progress=live.watch)
    live.close()
    listener.disconnect()
    assert live.shown == len(run().trace.step_t) - 1


def test_live_pictures_come_no_faster_than_they_are_looked_at(tmp_path):
    live = LiveRecording(scene(), tmp_path / "live.rrd", least_seconds=60.0)
    began = time.monotonic()
    sheared(progress=live.watch)
    live.close()
    assert time.monotonic() - began < 60.0
    assert live.shown == 1


@pytest.mark.parametrize(
    ("target", "error", "message"),
    [
        (3, TypeError, "live must be 'viewer', an address or a file name, got 3"),
        ("live.txt", ValueError, "live must be 'viewer', an address such as rerun"),
        ("no such folder/live.rrd", ValueError, "live must lie in an existing folder"),
    ],
)
def test_where_live_pictures_go_is_checked(target, error, message):
    with pytest.raises(error, match=message):
        LiveRecording(scene(), target)


def test_marks_turn_with_the_spins_in_a_plane_and_in_space():
    time_t = np.linspace(0.0, 1.0, 50)
    spin = np.tile([0.3, -0.8, 0.5], (50, 1, 1))
    angle, axis = np.linalg.norm(spin[0]), spin[0, 0] / np.linalg.norm(spin[0])
    x = np.array([1.0, 0.0, 0.0])
    whole = axis * axis[0] + np.cos(angle) * (x - axis * axis[0]) + np.sin(angle) * np.cross(axis, x)
    assert turned_marks(time_t, spin, 3)[-1, 0] == pytest.approx(whole, abs=1e-12)
    flat = turned_marks(time_t, spin[:, :, 2:], 2)
    assert flat[-1, 0] == pytest.approx([np.cos(0.5), np.sin(0.5)], abs=1e-12)
    again = turned_marks(time_t, spin[:, :, 2:], 2, flat[-1])
    assert again[-1, 0] == pytest.approx([np.cos(1.0), np.sin(1.0)], abs=1e-12)


def test_bonds_are_drawn_until_they_break():
    pair = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    bond = pm.Bonds([0], [1], [[0, 0]], [1.0], breaks_at=pm.BondLimits(tension=0.02))
    bonded = pm.Scene(pair, (pm.Repulsion(), bond))
    apart = [[-0.05, 0.0], [0.05, 0.0]]
    run = pm.simulate(bonded, duration=1.0, velocity_nd=apart, trace_every=1, trace_positions=True)
    trajectory = trajectory_of_run(run, bonded, 100)
    drawn = [len(draw_moving(frame, trajectory.effects).bond_sed) for frame in trajectory.frames]
    step = int(run.broken_bonds.step_e[0])
    assert step > 1 and drawn == [1] * step + [0] * (run.steps + 1 - step)


def test_a_box_sheared_far_is_drawn_with_short_vectors_and_lines_still_end_on_discs():
    far = pm.simulate(
        scene(), steps=60, dt=0.02, applied_strain=pm.SteadyStrain(4.0), trace_every=60, trace_positions=True
    )
    assert far.strain > 4.0
    trajectory = trajectory_of_run(far, scene(), 10)
    picture = draw_moving(trajectory.frames[-1], scene().effects)
    outline = picture.drawing.outline_ed[0]
    assert np.linalg.norm(np.diff(outline, axis=0), axis=1).max() < 2.0 * np.sqrt(far.packing.box.volume)
    ends = np.concatenate([picture.sticking_sed, picture.sliding_sed, picture.bond_sed]).reshape(-1, 2)
    lattice = np.column_stack([outline[1] - outline[0], outline[3] - outline[0]])
    offset = (ends[:, None, :] - picture.drawing.center_nd[None, :, :]) @ np.linalg.inv(lattice).T
    assert np.abs(offset - np.rint(offset)).max(axis=2).min(axis=1).max() < 1e-9
    bonds, touching = scene().effects[-1], trajectory.frames[-1].touching
    reach = far.packing.radius_n[touching.i_c] + far.packing.radius_n[touching.j_c]
    drawn = np.concatenate([picture.sticking_sed, picture.sliding_sed])
    assert np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1).max() < reach.max()
    assert len(picture.bond_sed) >= len(bonds)


def test_fragments_have_hues_of_their_own_and_who_is_held_is_gray():
    held = np.zeros(40, dtype=bool)
    held[3] = True
    trajectory = trajectory_of_run(sheared(held_n=held), scene(), 10)
    colors = trajectory.colors()
    bonds = scene().effects[-1]
    assert colors[3].tolist() == list(drawing.HELD)
    hues = {tuple(color) for color in drawing.CLUSTERS}
    free = np.flatnonzero(~held & np.isin(np.arange(40), np.concatenate([bonds.i_b, bonds.j_b])))
    assert {tuple(color) for color in colors[free].tolist()} <= hues
    mates = ~held[bonds.i_b] & ~held[bonds.j_b]
    assert np.array_equal(colors[bonds.i_b[mates]], colors[bonds.j_b[mates]])


def test_an_oscillatory_run_is_recorded_with_its_moduli(tmp_path):
    shear = pm.oscillatory_shear(scene(), amplitude=0.05, frequency=0.5, periods=1.0, samples_per_period=20, frames=6)
    trajectory = trajectory_of_run(shear, scene(), 60)
    assert len(trajectory.frames) == 6
    # frames have no springs, which no picture shows
    assert trajectory.frames[-1].packing == shear.packing.replace(tangential=None)
    assert trajectory.moduli["storage_modulus"] == shear.moduli.storage
    assert np.array_equal(trajectory.stress_t, shear.shear_stress_t)
    assert len(trajectory.frames[-1].touching.i_c) == shear.contacts_t[-1]
    back = ReadBack(pm.record_run(shear, tmp_path / "shear.rrd", scene=scene()))
    assert len(back.step["/world/particles"]) == 6
