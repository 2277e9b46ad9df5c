"""Facts about recordings: what is read back equals what was recorded, and what is drawn is where it should be."""

import importlib.util
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.view import drawing
from packmech.view.trajectory import motions_of, trajectory_of_run

STEPS = 20


@pytest.fixture(scope="module", autouse=True)
def strict_rerun():
    import rerun as rr

    rr.set_strict_mode(True)  # bad data are errors, not warnings
    yield
    rr.set_strict_mode(False)


def descent(dimension: int) -> tuple[pm.Scene, pm.Run]:
    """A start and a run of a few steps downhill in a box that is sheared on the way."""
    start = pm.random_packing(24, dimension=dimension, packing_fraction=0.9 if dimension == 2 else 0.7, seed=3)
    scene = start_scene = pm.Scene(start, effects=(pm.Repulsion(law=pm.Harmonic()),))
    rows = []
    shear = np.zeros((dimension, dimension))
    shear[0, 1] = 0.01
    for step in range(STEPS):
        force_nd = pm.forces(scene)
        packing = scene.packing
        rows.append(
            (
                10 * step,
                pm.energy(scene),
                pm.pressure(scene),
                len(pm.find_contacts(packing)),
                np.linalg.norm(force_nd, axis=1).max(),
                packing.position_nd,
                packing.box.lattice_dd,
            )
        )
        scene = scene.replace(
            packing=packing.replace(position_nd=packing.position_nd + 0.2 * force_nd, box=packing.box.strained(shear))
        )
    run = pm.Run(
        packing=scene.packing,
        outcome=pm.Outcome.STEP_LIMIT,
        residual=0.125,
        steps=10 * STEPS,
        force_evaluations=STEPS,
        seconds=0.5,
        trace=pm.Trace(*(np.array(column) for column in zip(*rows, strict=True))),
    )
    return start_scene, run


def vibration(packing: pm.Packing) -> SimpleNamespace:
    """Four made-up modes, the first two of zero eigenvalue."""
    displacement_mnd = np.random.default_rng(5).normal(size=(4, *packing.position_nd.shape))
    eigenvalue_m = np.array([0.0, 1e-14, 0.04, 0.09])
    return SimpleNamespace(
        eigenvalue_m=eigenvalue_m, frequency_m=np.sqrt(eigenvalue_m), displacement_mnd=displacement_mnd
    )


class ReadBack:
    """Every column of a recording, by entity path and column name, in the order of the steps."""

    def __init__(self, path: Path) -> None:
        import rerun.chunk as chunk

        reader = chunk.RrdReader(path)
        assert [entry.application_id for entry in reader.recordings()] == ["packmech"]
        assert len(reader.blueprints()) == 1
        self.step, self.column = {}, {}
        for piece in reader.stream().to_chunks():
            batch = piece.to_record_batch()
            entity = str(piece.entity_path)
            if "step" in batch.schema.names:
                self.step.setdefault(entity, []).extend(batch.column("step").to_pylist())
            for name in set(batch.schema.names) - {"log_time", "rerun.controls.RowId"}:
                self.column.setdefault((entity, name), []).extend(batch.column(name).to_pylist())

    def at_steps(self, entity: str, name: str) -> dict[int, list]:
        return dict(zip(self.step[entity], self.column[entity, name], strict=True))

    def property(self, name: str):
        ((value,),) = self.column["/__properties/packmech", name]
        return value


@pytest.fixture(scope="module", params=[2, 3], ids=["2D", "3D"])
def recorded(request, tmp_path_factory):
    scene, run = descent(request.param)
    path = pm.record_run(
        run,
        tmp_path_factory.mktemp("recorded") / "new folder" / "run.rrd",
        scene=scene,
        frames=7,
        modes=vibration(run.packing),
        parameters={"seed": 3, "pressure": np.float64(1e-8), "method": pm.Harmonic()},
        results={"packing_fraction": 0.25, "verdict": "jammed"},
        summary="# results",
    )
    return SimpleNamespace(scene=scene, run=run, back=ReadBack(path), path=path)


def test_numbers_that_the_run_reported_are_read_back(recorded):
    run, back = recorded.run, recorded.back
    assert back.property("force_residual") == run.residual
    assert back.property("force_evaluations") == run.force_evaluations
    assert back.property("steps") == run.steps
    assert back.property("seconds") == run.seconds
    assert back.property("outcome") == "step_limit"
    assert back.property("pressure") == pm.pressure(recorded.scene.replace(packing=run.packing))


def test_results_of_the_caller_are_read_back(recorded):
    assert recorded.back.property("packing_fraction") == 0.25
    assert json.loads(recorded.back.property("results_json"))["verdict"] == "jammed"


def test_every_parameter_is_read_back(recorded):
    kept_as = json.loads(recorded.back.property("parameters_json"))
    assert kept_as["seed"] == 3
    assert kept_as["pressure"] == 1e-8
    assert kept_as["method"] == {"kind": "harmonic", "energy_scale": 1.0}
    assert kept_as["effects"] == [{"kind": "repulsion", "law": {"kind": "harmonic", "energy_scale": 1.0}}]
    assert kept_as["particles"] == recorded.run.packing.particles


def test_final_packing_is_read_back_exactly(recorded):
    packing, back = recorded.run.packing, recorded.back
    last = max(back.step["/state/position"])
    assert last == recorded.run.steps
    assert back.at_steps("/state/position", "position_nd")[last] == packing.position_nd.ravel().tolist()
    assert back.at_steps("/state/lattice", "lattice_dd")[last] == packing.box.lattice_dd.ravel().tolist()
    assert back.column["/state/radius", "radius_n"] == [packing.radius_n.tolist()]


def test_frames_are_at_most_as_many_as_asked_first_and_last_included(recorded):
    steps = sorted(recorded.back.step["/world/particles"])
    assert len(steps) == 7
    assert (steps[0], steps[-1]) == (0, recorded.run.steps)


@pytest.mark.parametrize(("name", "attribute"), [("energy", "energy_t"), ("pressure", "pressure_t")])
def test_curves_hold_the_logarithm_of_every_saved_value(recorded, name, attribute):
    values = recorded.back.at_steps(f"/series/log10_{name}", "Scalars:scalars")
    expected = np.log10(getattr(recorded.run.trace, attribute))
    assert [values[step][0] for step in sorted(values)] == expected.tolist()


def test_contacts_against_step_are_read_back(recorded):
    values = recorded.back.at_steps("/series/contacts", "Scalars:scalars")
    assert [values[step][0] for step in sorted(values)] == recorded.run.trace.contacts_t.tolist()


def test_each_frame_draws_a_line_for_each_end_of_a_contact_inside_the_cell(recorded):
    back, trace = recorded.back, recorded.run.trace
    d = recorded.scene.packing.dimension
    lines = back.at_steps("/world/forces", f"LineStrips{d}D:strips")
    for step, line in lines.items():
        if step == recorded.run.steps:
            packing = recorded.run.packing
        else:
            (t,) = np.flatnonzero(trace.step_t == step)
            packing = pm.Packing(trace.position_tnd[t], recorded.scene.packing.radius_n, pm.Box(trace.lattice_tdd[t]))
        contacts = pm.find_contacts(packing.wrapped())
        assert len(line) == len(contacts) + np.count_nonzero(np.any(contacts.image_cd != 0, axis=1))


def test_free_motions_are_not_drawn_as_modes(recorded):
    drawn = {entity for entity in recorded.back.step if entity.startswith("/world/modes/")}
    assert drawn == {"/world/modes/mode_1", "/world/modes/mode_2"}


def test_arrows_are_parallel_to_the_mode(recorded):
    d = recorded.scene.packing.dimension
    (vector_nd,) = recorded.back.column["/world/modes/mode_1", f"Arrows{d}D:vectors"]
    drawn, mode = np.array(vector_nd), vibration(recorded.run.packing).displacement_mnd[2]
    cosine = np.sum(drawn * mode) / np.linalg.norm(drawn) / np.linalg.norm(mode)
    assert cosine == pytest.approx(1.0, abs=1e-6)  # the picture is kept in single precision


def test_recording_a_run_changes_no_bit_of_it(tmp_path):
    scene, run = descent(2)
    before = run.packing.position_nd.tobytes(), run.trace.position_tnd.tobytes()
    pm.record_run(run, tmp_path / "run.rrd", scene=scene)
    assert (run.packing.position_nd.tobytes(), run.trace.position_tnd.tobytes()) == before


def test_a_run_without_trace_shows_its_start_and_its_end(tmp_path):
    scene, run = descent(2)
    bare = pm.Run(run.packing, run.outcome, run.residual, run.steps, run.force_evaluations, run.seconds)
    trajectory = trajectory_of_run(bare, scene, 60)
    assert trajectory.packing_f == (scene.packing, run.packing)
    assert pm.record_run(bare, tmp_path / "bare.rrd", scene=scene).exists()


def test_a_packing_without_law_is_recorded_with_its_contacts(tmp_path):
    kagome = pm.lattice_packing("kagome", repeats=(3, 3), relative_overlap=1e-9)
    back = ReadBack(pm.record_packing(kagome, tmp_path / "kagome.rrd"))
    assert back.at_steps("/series/contacts", "Scalars:scalars") == {0: [54.0]}


def test_a_packing_without_contacts_is_recorded_with_empty_lines(tmp_path):
    lonely = pm.Packing([[0.5, 0.5]], [0.1], pm.Box.cubic(1.0, 2))
    back = ReadBack(pm.record_packing(lonely, tmp_path / "lonely.rrd"))
    assert back.at_steps("/world/forces", "LineStrips2D:strips") == {0: []}


def test_lines_across_the_edge_end_in_centers_or_their_copies():
    packing = pm.random_packing(40, dimension=2, packing_fraction=1.0, seed=2, box=[[1.0, 0.4], [0.0, 0.9]])
    picture = drawing.draw_packing(packing)
    fraction = picture.segment_sed.reshape(-1, 2) @ packing.box.inverse_dd.T
    center = picture.center_nd @ packing.box.inverse_dd.T
    offset = fraction[:, None, :] - center[None, :, :]
    nearest = np.abs(offset - np.rint(offset)).max(axis=2).min(axis=1)
    assert nearest.max() < 1e-12


def test_copies_reach_into_the_cell_and_stand_a_lattice_vector_away():
    packing = pm.random_packing(40, dimension=2, packing_fraction=0.8, seed=2, box=[[1.0, 0.4], [0.0, 0.9]])
    picture = drawing.draw_packing(packing)
    shift = (picture.copy_center_kd - picture.center_nd[picture.copy_of_k]) @ packing.box.inverse_dd.T
    assert np.abs(shift - np.rint(shift)).max() < 1e-12
    fraction = picture.copy_center_kd @ packing.box.inverse_dd.T
    outside = np.maximum(-fraction, fraction - 1.0) * packing.box.height_d
    assert (outside.max(axis=1) > 0.0).all()
    assert (outside.max(axis=1) < packing.radius_n[picture.copy_of_k]).all()


def test_rattlers_have_a_color_of_their_own():
    radius_n = np.array([0.5, 0.6, 0.7])
    packing = pm.Packing([[1.0, 1.0], [3.0, 1.0], [5.0, 1.0]], radius_n, pm.Box.cubic(6.0, 2))
    colors = drawing.particle_colors(packing, rattler_n=np.array([False, True, False]))
    assert colors.tolist() == [list(drawing.SMALL), list(drawing.RATTLER), list(drawing.LARGE)]


def test_line_width_is_proportional_to_the_force_up_to_the_widest():
    width = drawing.force_radii(np.array([0.0, 1.0, 2.0, 100.0]), 1.0, 2)
    assert (width / width[1]).tolist() == [0.0, 1.0, 2.0, drawing.WIDEST]


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda s, r, p: pm.record_packing(3, p), TypeError, "subject must be a Packing or a Scene, got int"),
        (lambda s, r, p: pm.record_run(s, p, scene=s), TypeError, "run must be a Run"),
        (lambda s, r, p: pm.record_run(r, p, scene=r), TypeError, "scene must be a Scene"),
        (lambda s, r, p: pm.record_run(r, p, scene=s, frames=1), ValueError, "frames must be an integer at least 2"),
        (
            lambda s, r, p: pm.record_packing(s, p, mode_count=-1),
            ValueError,
            "mode_count must be an integer at least 0",
        ),
        (lambda s, r, p: pm.record_packing(s, p.parent), ValueError, "path must name a file, got the folder"),
    ],
)
def test_bad_arguments_are_named(tmp_path, call, error, message):
    scene, run = descent(2)
    with pytest.raises(error, match=message):
        call(scene, run, tmp_path / "bad.rrd")


def test_a_recording_without_room_is_an_error_that_names_it_and_leaves_nothing(tmp_path):
    scene, run = descent(2)
    path = tmp_path / "full.rrd"
    path.symlink_to("/dev/full")
    for record in (lambda: pm.record_packing(scene, path), lambda: pm.record_run(run, path, scene=scene)):
        with pytest.raises(OSError, match=r"path must be a file that can be written, got .*full\.rrd': No space left"):
            record()
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_made_again_replaces_the_whole_file(tmp_path):
    scene, run = descent(2)
    pm.record_run(run, tmp_path / "a.rrd", scene=scene)
    (tmp_path / "b.rrd").write_bytes((tmp_path / "a.rrd").read_bytes())
    pm.record_packing(scene, tmp_path / "b.rrd")
    pm.record_packing(scene, tmp_path / "c.rrd")
    # but for names and times that Rerun writes into it
    sizes = [(tmp_path / name).stat().st_size for name in ("b.rrd", "c.rrd")]
    assert abs(sizes[0] - sizes[1]) < 0.01 * sizes[1]


def test_modes_of_another_packing_are_refused():
    packing = pm.random_packing(9, dimension=2, packing_fraction=0.5, seed=1)
    with pytest.raises(ValueError, match=r"modes must be those of the packing with positions of shape \(9, 2\)"):
        motions_of(
            vibration(packing.replace(position_nd=packing.position_nd[:8], radius_n=packing.radius_n[:8])),
            packing,
            1.0,
            4,
        )


@pytest.mark.slow
@pytest.mark.skipif(
    not list(Path("/usr/share/vulkan/icd.d").glob("*.json")),
    reason="the viewer needs a Vulkan driver, a software one at least",
)
def test_the_viewer_opens_a_recording_without_warnings(recorded, tmp_path):
    script = Path(__file__).parents[2] / "recordings" / "picture.py"
    spec = importlib.util.spec_from_file_location("picture", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shot = tmp_path / "shot.png"
    assert module.picture(recorded.path, shot, step=recorded.run.steps, size=(1600, 900)) == []
    assert shot.stat().st_size > 10_000


RECORDINGS = Path(__file__).parents[2] / "recordings"


def test_recordings_in_the_repository_stay_light():
    sizes = [path.stat().st_size for path in RECORDINGS.rglob("*.rrd")]
    assert sizes
    assert max(sizes) <= 2_000_000
    assert sum(sizes) <= 20_000_000
    assert (RECORDINGS / "jam.png").stat().st_size < 500_000


def test_the_recording_in_the_repository_ends_with_the_packing_that_its_properties_tell_of():
    back = ReadBack(RECORDINGS / "jam.rrd")
    last = max(back.step["/state/position"])
    position_nd = np.array(back.at_steps("/state/position", "position_nd")[last]).reshape(-1, 2)
    lattice_dd = np.array(back.at_steps("/state/lattice", "lattice_dd")[last]).reshape(2, 2)
    (radius_n,) = back.column["/state/radius", "radius_n"]
    packing = pm.Packing(position_nd, np.array(radius_n), pm.Box(lattice_dd))
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    results = json.loads(back.property("results_json"))
    assert back.property("packing_fraction") == pytest.approx(pm.packing_fraction(packing), rel=1e-14)
    assert back.property("pressure") == pytest.approx(pm.pressure(scene), rel=1e-12)
    assert back.property("rattlers") == int(pm.find_rattlers(packing).sum())
    assert results["strict"] == "jammed"
    assert results["contacts"] >= results["isostatic_contacts"]


def test_a_result_may_be_a_word_in_one_recording_and_a_number_in_the_next(tmp_path):
    packing = pm.lattice_packing("square", repeats=2)
    kept_as = [
        ReadBack(pm.record_packing(packing, tmp_path / f"{n}.rrd", results={"kept_as": value})).property("kept_as")
        for n, value in enumerate(("free", 0.25, True, 7))
    ]
    assert kept_as == ["free", 0.25, True, 7]
