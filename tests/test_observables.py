"""Facts about observables and figures of the report that are added from outside the package, in one short function."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech.observables import OBSERVABLES
from packmech.view.report import REPORT_FIGURES, examine
from packmech.view.trajectory import trajectory_of_run

SCENE = pm.Scene(pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=3), (pm.Repulsion(),))


@pytest.fixture
def largest_overlap_kept():
    """An observable that is forgotten after the test."""
    name = "largest_overlap"

    @pm.observable(unit="length", label="largest overlap")
    def largest_overlap(state: pm.State) -> float:
        return pm.find_contacts(state.packing).overlap_c.max(initial=0.0)

    yield name
    del OBSERVABLES[name]


def test_an_added_observable_is_in_trace_table_and_recording_of_a_minimization(largest_overlap_kept, tmp_path):
    chunk = pytest.importorskip("rerun.chunk")
    run = pm.quench(SCENE, force_tolerance=1e-6, trace_every=20, trace_positions=True)
    kept = run.trace["largest_overlap"]
    assert "largest_overlap" in run.trace and list(run.trace) == list(run.trace.keys()) == list(dict(run.trace))
    assert len(run.trace) == len(run.trace.columns())
    for position_nd, value in zip(run.trace.position_tnd, kept, strict=True):
        packing = SCENE.packing.replace(position_nd=position_nd)
        assert value == pm.find_contacts(packing).overlap_c.max(initial=0.0)
    pm.write_table(run, tmp_path / "run.csv")
    back = pm.read_table(tmp_path / "run.csv")
    assert back["largest_overlap"].tolist() == kept.tolist()
    assert back.units["largest_overlap"] == "length"
    pm.record_run(run, tmp_path / "run.rrd", scene=SCENE, frames=2)
    chunks = chunk.RrdReader(tmp_path / "run.rrd").stream().to_chunks()
    found = [one for one in chunks if one.entity_path == "/series/largest_overlap" and not one.is_static]
    plotted = np.concatenate([one.to_record_batch().column("Scalars:scalars").flatten().to_numpy() for one in found])
    assert plotted.tolist() == kept.tolist()


def test_an_added_observable_of_a_simulation_goes_on_after_a_checkpoint(tmp_path):
    @pm.observable(unit="length/time", shape="d")
    def mean_velocity(state: pm.State):
        return None if state.velocity_nd is None else state.velocity_nd.mean(axis=0)

    try:
        settings = {"dt": 0.05, "trace_every": 5, "trace_positions": True, "temperature": 0.01, "seed": 1}
        whole = pm.simulate(SCENE, steps=20, **settings)
        assert np.array_equal(whole.trace["mean_velocity"], whole.trace.velocity_tnd.mean(axis=1))
        pm.simulate(SCENE, steps=10, checkpoint=tmp_path / "half.npz", **settings)
        resumed = pm.resume(tmp_path / "half.npz", SCENE, steps=20)
        assert resumed.trace["mean_velocity"].tobytes() == whole.trace["mean_velocity"].tobytes()
        assert resumed.table().units["mean_velocity_x"] == "length/time"
    finally:
        del OBSERVABLES["mean_velocity"]


def test_an_added_observable_of_a_strained_run_is_measured_at_every_row_and_changes_no_bit(tmp_path):
    shear = {"rate": 0.05, "applied_strain": 0.1, "samples": 20, "frames": 21}
    plain = pm.ramp_strain(SCENE, **shear)

    @pm.observable(unit="time")
    def clock(state: pm.State):
        return state.time

    try:
        run = pm.ramp_strain(SCENE, **shear)
        assert run.added["clock"].tolist() == run.time_t.tolist()
        assert run.packing.position_nd.tobytes() == plain.packing.position_nd.tobytes()
        pm.write_table(run, tmp_path / "run.csv")
        assert pm.read_table(tmp_path / "run.csv")["clock"].tolist() == run.time_t.tolist()
        assert "clock" in trajectory_of_run(run, SCENE, 5).curves
        crept = pm.creep(SCENE, stress=1e-3, duration=3.0)
        assert crept.added["clock"].tolist() == crept.time_t.tolist()
    finally:
        del OBSERVABLES["clock"]


def test_measuring_changes_no_bit_of_a_minimization(largest_overlap_kept):
    runs = [pm.quench(SCENE, force_tolerance=1e-6, trace_every=every) for every in (None, 10)]
    assert np.array_equal(runs[0].packing.position_nd, runs[1].packing.position_nd)


def test_a_value_of_another_shape_is_refused_by_name():
    @pm.observable(shape="d")
    def odd(state: pm.State) -> float:
        return 1.0

    try:
        with pytest.raises(ValueError, match=r"observable 'odd' must return an array of shape \(2,\), got \(\)"):
            pm.quench(SCENE, force_tolerance=1e-6, trace_every=10)
    finally:
        del OBSERVABLES["odd"]


def test_names_of_built_in_observables_are_refused():
    with pytest.raises(ValueError, match="measure must have a name of its own, got 'energy'"):

        @pm.observable()
        def energy(state: pm.State) -> float:
            return 0.0


def test_an_added_figure_of_the_report_is_in_numbers_table_and_file():
    @pm.report_figure(unit="length", label="largest radius")
    def largest_radius(scene: pm.Scene) -> float:
        return float(scene.packing.radius_n.max())

    try:
        report = examine(SCENE, modes=0)
        radius = SCENE.packing.radius_n.max()
        assert report.to_dict()["largest_radius"] == radius
        assert ("largest radius", f"{radius:.6g}", "length") in report.summary().rows
        json.dumps(report.to_dict())
    finally:
        del REPORT_FIGURES["largest_radius"]


def test_a_figure_that_cannot_be_had_is_named_and_the_others_count():
    @pm.report_figure()
    def hopeless(scene: pm.Scene) -> float:
        raise ValueError("there is none")

    try:
        report = examine(SCENE, modes=0)
        assert ("hopeless", "not available", "there is none") in report.summary().rows
        assert "bulk_modulus" in report.numbers
    finally:
        del REPORT_FIGURES["hopeless"]


def test_what_a_run_says_of_itself_is_a_dozen_lines_and_names_outcome_and_residual():
    run = pm.quench(SCENE, force_tolerance=1e-6)
    words = repr(run)
    assert len(words.splitlines()) <= 13
    assert "converged" in words and f"{run.residual:.1e}" in words
    assert json.loads(json.dumps(run.to_dict()))["force_evaluations"] == run.force_evaluations
    assert all(stage.name in str(run.summary()) for stage in run.summary().stages)
