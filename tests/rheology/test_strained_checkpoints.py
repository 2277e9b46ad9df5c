"""Facts about checkpoints of strained runs: called again, they go on with the bits of one that was never stopped."""

import dataclasses
import signal
import threading

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import Engine
from packmech.loop import run_loop
from packmech.loop.checkpoint import read_checkpoint, scene_fingerprints, write_checkpoint
from packmech.loop.run_loop import RunLoop
from packmech.rheology import strain_run
from packmech.rheology.arguments import KIND

LAW = pm.LinearSpring()


@pytest.fixture(scope="module")
def scene():
    """Discs with friction at rest, every second contact a bond; the effects of test_rheology."""
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-12).packing
    bonds = pm.bond_contacts(
        packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    bonds = bonds.select(np.arange(len(bonds)) % 2 == 0)
    return pm.Scene(
        packing,
        (pm.Repulsion(law=LAW), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2), bonds, pm.BackgroundDamping(0.02)),
    )


SINE = {"frequency": 0.05, "samples_per_period": 20}
CALLS = {
    "sine": (pm.oscillatory_shear, {"amplitude": 0.2, "pre_periods": 0.5, "periods": 3, "post_periods": 0.5, **SINE}),
    "ramp": (pm.ramp_strain, {"rate": 0.1, "applied_strain": 2.5, "samples": 20}),
    "creep": (pm.creep, {"stress": 0.02, "duration": 15.0, "hold": 10.0}),
}
SEVERAL = {
    "sweep": (pm.amplitude_sweep, {"amplitudes": [0.01, 0.2], "periods": 2, **SINE}),
    "steady": (pm.steady_shear, {"rates": [0.2, 0.3], "applied_strain": 2.0, "samples": 40, "check": False}),
    "rest": (pm.equilibrate, {"amplitude": 1e-4, "frequency": 0.05, "expected_stress": 1e-4, "step_limit": 3000}),
}


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Look up every few steps."""
    monkeypatch.setattr(strain_run, "_CHUNK", 2000)
    monkeypatch.setattr("packmech.rheology.steady._REPORT", 5)


def bits(value):
    """Everything that a run says but for its CPU times, as bytes."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return {name: bits(getattr(value, name)) for name in names if "seconds" not in name and name != "stages"}
    if isinstance(value, dict):
        return {name: bits(part) for name, part in value.items()}
    if isinstance(value, tuple):
        return [bits(part) for part in value]
    # a number that is none equals itself here
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value)


class StopAt:
    """Progress that is interrupted the n-th time it is called."""

    def __init__(self, turn):
        self.left = turn

    def __call__(self, stage, figures):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("turn", [1, 7])
def test_an_interrupted_run_goes_on_with_the_same_bits_when_called_again(name, turn, scene, tmp_path):
    call, given = CALLS[name]
    whole = call(scene, frames=4, **given)
    given = {**given, "frames": 4, "checkpoint": tmp_path / "run.npz"}
    with pytest.raises(KeyboardInterrupt) as caught:
        call(scene, progress=StopAt(turn), **given)
    assert 0 < caught.value.run.steps < whole.steps
    assert bits(call(scene, **given)) == bits(whole)


def steps_taken(monkeypatch):
    """Return a list that gets the steps of every advance from now on."""
    taken, usual = [], Engine.advance

    def advance(march, steps, ledger=None):
        taken.append(steps)
        return usual(march, steps, ledger)

    monkeypatch.setattr(Engine, "advance", advance)
    return taken


@pytest.mark.parametrize("name", CALLS | SEVERAL)
def test_a_run_that_got_to_its_end_is_returned_as_it_was_without_a_step(name, scene, tmp_path, monkeypatch):
    call, given = (CALLS | SEVERAL)[name]
    given = {**given, "checkpoint": tmp_path / "run.npz"}
    whole = call(scene, **given)
    taken = steps_taken(monkeypatch)
    assert bits(call(scene, **given)) == bits(whole)
    assert not taken


@pytest.mark.parametrize("name", SEVERAL)
def test_of_several_runs_those_that_were_finished_are_not_made_again(name, scene, tmp_path, monkeypatch):
    call, given = SEVERAL[name]
    if name == "rest":
        # moved from where it was at rest: it is looked at, settles, and is looked at again
        shaken = scene.packing.position_nd + 0.02 * np.random.default_rng(2).normal(size=(24, 2))
        scene = scene.replace(packing=scene.packing.replace(position_nd=shaken))
        given = {**given, "check": False}
    counted = StopAt(-1)
    whole = call(scene, progress=counted, **given)
    given = {**given, "checkpoint": tmp_path / "run.npz"}
    with pytest.raises(KeyboardInterrupt):
        call(scene, progress=StopAt(2 * (-1 - counted.left) // 3), **given)
    taken = steps_taken(monkeypatch)
    assert bits(call(scene, **given)) == bits(whole)
    again = sum(taken)
    taken.clear()
    call(scene, **{**given, "checkpoint": None})
    assert 0 < again < 0.45 * sum(taken)


def test_the_frictionless_minimum_is_found_once(scene, tmp_path, monkeypatch):
    rubbing = scene.replace(effects=tuple(one for one in scene.effects if not isinstance(one, pm.Bonds)))
    given = {"amplitude": 1e-3, "frequency": 0.05, "checkpoint": tmp_path / "run.npz"}
    whole = pm.equilibrate(rubbing, **given)
    monkeypatch.delattr("packmech.rheology.equilibrate.quench")
    again = pm.equilibrate(rubbing, **given)
    assert bits(again) == bits(whole)
    assert [one.name for one in again.stages] == [one.name for one in whole.stages]


def test_a_time_limit_of_several_runs_is_that_of_all_of_them(scene, tmp_path, monkeypatch):
    given = {"rates": [0.05, 0.1], "applied_strain": 1.0, "skip_strain": 0.2, "samples": 40}
    curve = pm.steady_shear(scene, time_limit=1e-9, check=False, **given)
    assert curve.outcome is pm.Outcome.TIME_LIMIT and np.isnan(curve.stress_r).all()
    with pytest.raises(pm.NotConverged) as late:
        pm.steady_shear(scene, time_limit=1e-9, **given)
    assert late.value.run.outcome is pm.Outcome.TIME_LIMIT
    given = {"amplitudes": [1e-3, 2e-3], "frequency": 0.05, "periods": 2, "checkpoint": tmp_path / "sweep.npz"}
    with pytest.raises(pm.NotConverged) as late:
        pm.amplitude_sweep(scene, time_limit=1e-9, **given)
    assert late.value.run.outcome is pm.Outcome.TIME_LIMIT
    # the second has what the first left of it
    left = []

    def takes_a_second(*given, time_limit, **named):
        left.append(time_limit)
        monkeypatch.setattr("packmech.loop.run_loop.working_time", lambda: 1e9 + len(left))
        return run(*given, time_limit=None, **named)

    run = pm.oscillatory_shear
    with monkeypatch.context():
        monkeypatch.setattr("packmech.rheology.amplitude_sweep.oscillatory_shear", takes_a_second)
        monkeypatch.setattr("packmech.loop.run_loop.working_time", lambda: 1e9)
        pm.amplitude_sweep(scene, time_limit=5.0, **{**given, "checkpoint": None})
    monkeypatch.undo()
    assert left == [5.0, 4.0]
    # what was reached is in the file, and goes on
    whole = pm.amplitude_sweep(scene, time_limit=1e9, **given)
    given["checkpoint"] = None
    np.testing.assert_array_equal(whole.storage_a, pm.amplitude_sweep(scene, **given).storage_a)


@pytest.mark.parametrize("call", ["steady_shear", "amplitude_sweep"])
def test_runs_before_the_one_out_of_time_are_handed_over(call, scene, monkeypatch):
    given = {
        "steady_shear": {"rates": [0.05, 0.1], "applied_strain": 1.0, "skip_strain": 0.2, "samples": 40},
        "amplitude_sweep": {"amplitudes": [1e-3, 2e-3], "frequency": 0.05, "periods": 2},
    }[call]
    advance, runs = RunLoop.advance, []

    def second_is_late(loop, task, *named):
        runs.append(task)
        return pm.Outcome.TIME_LIMIT if len(runs) == 2 else advance(loop, task, *named)

    with monkeypatch.context() as patched:
        patched.setattr(RunLoop, "advance", second_is_late)
        with pytest.raises(pm.NotConverged) as late:
            getattr(pm, call)(scene, **given)
    name = "rates" if call == "steady_shear" else "amplitudes"
    alone = getattr(pm, call)(scene, **{**given, name: given[name][:1]})
    found = late.value.finished
    assert len(found.runs) == 1 and bits(found.runs[0]) == bits(alone.runs[0])
    assert late.value.run.outcome is pm.Outcome.TIME_LIMIT


def test_a_run_out_of_time_goes_on_with_the_same_bits(scene, tmp_path):
    call, given = CALLS["sine"]
    early = call(scene, time_limit=1e-9, check=False, checkpoint=tmp_path / "run.npz", **given)
    assert early.outcome is pm.Outcome.TIME_LIMIT
    assert bits(call(scene, checkpoint=tmp_path / "run.npz", **given)) == bits(call(scene, **given))


def test_a_signal_in_the_middle_of_a_loop_leaves_a_whole_checkpoint(scene, tmp_path, monkeypatch):
    call, given = CALLS["sine"]
    given = {**given, "periods": 10}
    monkeypatch.setattr(strain_run, "_CHUNK", 200_000)
    whole = call(scene, **given)
    given["checkpoint"] = tmp_path / "run.npz"
    usual = Engine.advance

    def advance(march, steps, ledger=None):
        # it comes while the compiled loop is on
        threading.Timer(1e-3, signal.raise_signal, (signal.SIGINT,)).start()
        monkeypatch.setattr(Engine, "advance", usual)
        return usual(march, steps, ledger)

    monkeypatch.setattr(Engine, "advance", advance)
    with pytest.raises(KeyboardInterrupt):
        call(scene, **given)
        threading.Event().wait(1.0)
    assert bits(call(scene, **given)) == bits(whole)


def test_what_goes_on_is_written_now_and_then(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(run_loop, "_WRITE_EVERY", 0.0)
    call, given = CALLS["ramp"]
    path = tmp_path / "run.npz"
    seen = []
    call(scene, checkpoint=path, progress=lambda stage, figures: seen.append(path.exists()), **given)
    assert len(seen) > 3 and all(seen)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"amplitude": 0.1}, "strain"),
        ({"dt": 0.01}, "dt"),
        ({"method": pm.SemiImplicitEuler()}, "method"),
        ({"frames": 3}, "frames"),
        ({"held_n": np.arange(24) < 2}, "held_n"),
    ],
)
def test_other_arguments_are_refused_by_name(change, named, scene, tmp_path):
    call, given = CALLS["sine"]
    given = {**given, "checkpoint": tmp_path / "run.npz", "time_limit": 1e-9, "check": False}
    call(scene, **given)
    with pytest.raises(ValueError, match=f"same scene and settings.* another {named}"):
        call(scene, **{**given, **change})


def test_another_scene_is_refused_by_what_differs(scene, tmp_path):
    call, given = CALLS["ramp"]
    given = {**given, "checkpoint": tmp_path / "run.npz", "time_limit": 1e-9, "check": False}
    call(scene, **given)
    effects = (*scene.effects[:-1], pm.BackgroundDamping(0.03))
    with pytest.raises(ValueError, match=r"another scene.effects\[4\]"):
        call(scene.replace(effects=effects), **given)


@pytest.mark.parametrize("name", [*CALLS, "plates"])
def test_a_checkpoint_that_lacks_an_array_or_has_one_of_another_length_is_refused(name, scene, tmp_path):
    call, given = CALLS["sine" if name == "plates" else name]
    plates = {"held_n": pm.rough_plates(scene.packing)} if name == "plates" else {}
    given = {**given, **plates, "frames": 3000 if name == "creep" else 60, "checkpoint": tmp_path / "run.npz"}
    with pytest.raises(KeyboardInterrupt):
        call(scene, progress=StopAt(7), **given)
    settings, kept = read_checkpoint(tmp_path / "run.npz", KIND)
    steps, rows, frames = (kept[f"0.{name}"] for name in ("engine.steps", "rows", "frame_time_f"))
    assert steps > 0 and len(rows) > 1 and len(frames) > 1
    assert ("0.wall_rows" in kept) == (name == "plates")
    long = [one for one in kept if kept[one].ndim and kept[one].size]
    damaged = [
        *({other: kept[other] for other in kept if other != one} for one in kept),
        *(kept | {one: kept[one][:-1]} for one in long),
        *(kept | {one: np.concatenate([kept[one], kept[one][-1:]])} for one in long),
        *(kept | {"0.engine.steps": np.array(other)} for other in (0, 10**9)),
        kept | {"0.snapshot_count_t": kept["0.snapshot_count_t"] + 1},
    ]
    for arrays in damaged:
        write_checkpoint(tmp_path / "run.npz", KIND, settings, arrays)
        with pytest.raises(ValueError, match="^checkpoint must hold a run that can go on, got "):
            call(scene, **given)
    for table in ({"runs": settings["runs"], "finished": []}, {"runs": 3, "finished": [False]}, {}):
        write_checkpoint(tmp_path / "run.npz", KIND, table, kept)
        with pytest.raises(ValueError, match="^checkpoint must hold runs, got "):
            call(scene, **given)
    write_checkpoint(tmp_path / "run.npz", KIND, settings, kept)
    assert call(scene, **given).ok


def test_checkpoints_of_simulate_and_of_strained_runs_are_told_apart(scene, tmp_path):
    call, given = CALLS["ramp"]
    write_checkpoint(tmp_path / "motion.npz", "pm.simulate", {"scene": scene_fingerprints(scene), "steps": 2}, {})
    with pytest.raises(ValueError, match="checkpoint must name a checkpoint of strained runs"):
        call(scene, checkpoint=tmp_path / "motion.npz", **given)
    call(scene, checkpoint=tmp_path / "run.npz", time_limit=1e-9, check=False, **given)
    with pytest.raises(ValueError, match=r"must name a checkpoint of pm\.simulate"):
        pm.resume(tmp_path / "run.npz", scene)
    (tmp_path / "other.npz").write_text("nothing")
    with pytest.raises(ValueError, match="checkpoint must name a checkpoint, got"):
        call(scene, checkpoint=tmp_path / "other.npz", **given)
