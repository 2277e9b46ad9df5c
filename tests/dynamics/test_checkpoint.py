"""Facts about checkpoints: a simulation that goes on from one has the bits of one that was never stopped."""

import dataclasses
import json
import signal
import threading
import time
from functools import cache

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import Engine
from packmech.dynamics.simulation import KIND
from packmech.loop.checkpoint import check_scene, read_checkpoint, scene_fingerprints, write_checkpoint

DT, STEPS = 0.02, 60


@cache
def flat():
    """Discs with friction, a third of them bonded, sheared so fast that others are the best lattice vectors soon."""
    packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2)
    bonds = bonds.select(np.arange(len(bonds)) % 3 == 0)
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.1), pm.Friction(0.5, 0.4, 0.1), bonds)
    return pm.Scene(packing, effects), {"applied_strain": pm.SteadyStrain(0.7), "dt": DT, "trace_every": 7}


@cache
def spheres():
    """Spheres with friction, spinning, some of them held, in an oscillating box."""
    packing = pm.random_packing(40, dimension=3, packing_fraction=0.75, seed=5)
    spin = np.random.default_rng(1).normal(size=(40, 3))
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.Friction(0.5, 0.4, 0.1))
    manner = {
        "applied_strain": pm.OscillatoryStrain(0.1, 1.0),
        "spin_nk": spin,
        "held_n": np.arange(40) < 4,
        "method": pm.SemiImplicitEuler(),
    }
    return pm.Scene(packing, effects), {**manner, "dt": DT, "trace_every": 10, "trace_positions": True}


@cache
def dimers():
    """Rigid dimers that fly about: links held by RATTLE."""
    packing = pm.cluster_packing(12, shape=pm.Dimer(), dimension=2, packing_fraction=0.5, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene, {"temperature": 0.5, "seed": 2, "dt": 0.05, "trace_every": 15}


SCENES = {"flat": flat, "spheres": spheres, "dimers": dimers}


@cache
def uninterrupted(name):
    scene, manner = SCENES[name]()
    return pm.simulate(scene, steps=STEPS, **manner)


def bits(value):
    """Everything that a run says but for its CPU times, as bytes."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return {name: bits(getattr(value, name)) for name in names if "seconds" not in name and name != "stages"}
    if isinstance(value, tuple):
        return [bits(part) for part in value]
    return value.tobytes() if isinstance(value, np.ndarray) else value


def moved(run):
    """The same, less what depends on when somebody looked."""
    looked = ("energy_drift", "momentum_error", "link_error", "force_evaluations")
    return {name: value for name, value in bits(run).items() if name not in looked}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("step", [1, 7, 33, 59])
def test_restart_from_the_end_of_a_shorter_run_continues_with_the_same_bits(name, step, tmp_path):
    scene, manner = SCENES[name]()
    pm.simulate(scene, steps=step, checkpoint=tmp_path / "run.npz", **manner)
    assert moved(pm.resume(tmp_path / "run.npz", scene, steps=STEPS)) == moved(uninterrupted(name))


@pytest.mark.parametrize("name", SCENES)
def test_writing_checkpoints_changes_no_bit_of_the_run(name, tmp_path):
    scene, manner = SCENES[name]()
    run = pm.simulate(scene, steps=STEPS, checkpoint=tmp_path / "run.npz", checkpoint_every=11, **manner)
    assert bits(run) == bits(uninterrupted(name))


class Homecomings:
    """Notes at which steps particles are wrapped, and whether the lattice vectors were exchanged."""

    def __init__(self, monkeypatch):
        self.steps, self.exchanged = [], []
        usual = Engine.wrap

        def noted(engine):
            before = engine.change_dd.copy()
            usual(engine)
            self.steps.append(engine.steps)
            if not np.array_equal(before, engine.change_dd):
                self.exchanged.append(engine.steps)

        monkeypatch.setattr(Engine, "wrap", noted)


def test_restart_just_before_at_and_after_a_re_mapping_of_the_sheared_box_continues_with_the_same_bits(
    monkeypatch, tmp_path
):
    scene, manner = flat()
    manner = manner | {"applied_strain": pm.SteadyStrain(4.0)}
    seen = Homecomings(monkeypatch)
    whole = pm.simulate(scene, steps=STEPS, **manner)
    assert seen.exchanged
    for step in (seen.exchanged[0] - 1, seen.exchanged[0], seen.exchanged[0] + 1):
        pm.simulate(scene, steps=step, checkpoint=tmp_path / "run.npz", **manner)
        assert moved(pm.resume(tmp_path / "run.npz", scene, steps=STEPS)) == moved(whole)


def test_restart_across_the_step_that_wraps_free_particles_continues_with_the_same_bits(tmp_path):
    scene, _ = dimers()
    manner = {"temperature": 20.0, "seed": 2, "dt": 0.01}
    whole = pm.simulate(scene, steps=1030, **manner)
    box = scene.packing.box
    assert np.abs(np.floor(whole.packing.position_nd @ box.inverse_dd.T)).max() >= 2
    for step in (1023, 1024, 1025):
        pm.simulate(scene, steps=step, checkpoint=tmp_path / "run.npz", **manner)
        assert moved(pm.resume(tmp_path / "run.npz", scene, steps=1030)) == moved(whole)


@pytest.mark.parametrize("name", ["flat", "dimers"])
def test_an_interrupted_run_goes_on_from_where_it_was(name, tmp_path):
    scene, manner = SCENES[name]()

    def stop(stage, figures):
        if figures["steps"] >= 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        pm.simulate(scene, steps=STEPS, checkpoint=tmp_path / "run.npz", progress=stop, **manner)
    assert 20 <= stopped.value.run.steps < STEPS
    seen = []
    run = pm.resume(tmp_path / "run.npz", scene, progress=lambda stage, figures: seen.append(figures["steps"]))
    assert seen[0] > stopped.value.run.steps
    assert bits(run) == bits(uninterrupted(name))


def test_a_signal_in_the_middle_of_a_loop_leaves_a_whole_checkpoint(tmp_path):
    scene, manner = flat()
    manner = manner | {"trace_every": 200}
    steps = 20_000
    whole = pm.simulate(scene, steps=steps, **manner)
    # once more, with compiled loops: how long it takes here
    began = time.perf_counter()
    pm.simulate(scene, steps=steps, **manner)
    took = time.perf_counter() - began
    for delay in (0.01 * took, 0.1 * took):
        timer = threading.Timer(delay, signal.raise_signal, (signal.SIGINT,))

        def start(stage, figures, timer=timer):
            if not timer.ident:
                timer.start()

        with pytest.raises(KeyboardInterrupt) as stopped:
            pm.simulate(scene, steps=steps, checkpoint=tmp_path / "run.npz", progress=start, **manner)
        assert stopped.value.run.steps < steps
        assert bits(pm.resume(tmp_path / "run.npz", scene)) == bits(whole)


def test_a_run_out_of_time_goes_on_to_the_same_end(tmp_path):
    scene, manner = dimers()
    run = pm.simulate(scene, steps=STEPS, checkpoint=tmp_path / "run.npz", time_limit=1e-9, check=False, **manner)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert bits(pm.resume(tmp_path / "run.npz", scene)) == bits(uninterrupted("dimers"))


def test_resuming_writes_checkpoints_in_its_turn(tmp_path):
    scene, manner = flat()
    path = tmp_path / "run.npz"
    pm.simulate(scene, steps=13, checkpoint=path, checkpoint_every=5, **manner)
    for step in (20, 41):
        pm.resume(path, scene, steps=step)
    assert moved(pm.resume(path, scene, steps=STEPS)) == moved(uninterrupted("flat"))


def test_a_failed_write_leaves_the_checkpoint_that_was_there(monkeypatch, tmp_path):
    scene, manner = flat()
    path = tmp_path / "run.npz"
    pm.simulate(scene, steps=13, checkpoint=path, **manner)
    before = path.read_bytes()

    def fails(file, **arrays):
        file.write(b"half")
        raise OSError("disk full")

    with monkeypatch.context() as patched:
        patched.setattr(np, "savez", fails)
        with pytest.raises(OSError, match="disk full"):
            pm.resume(path, scene, steps=20)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["run.npz"]


def test_another_scene_is_refused_by_what_differs(tmp_path):
    scene, manner = flat()
    pm.simulate(scene, steps=1, checkpoint=tmp_path / "run.npz", **manner)
    rougher = scene.replace(effects=(*scene.effects[:2], pm.Friction(0.6, 0.4, 0.1), scene.effects[3]))
    with pytest.raises(ValueError, match=r"scene must be the one .* got one that differs in effects\[2\]"):
        pm.resume(tmp_path / "run.npz", rougher)
    fewer = scene.replace(effects=(*scene.effects[:3], scene.effects[3].select(np.arange(len(scene.effects[3])) > 0)))
    with pytest.raises(ValueError, match=r"differs in effects\[3\]"):
        check_scene(fewer, scene_fingerprints(scene))
    moved_packing = scene.packing.replace(position_nd=scene.packing.position_nd + 1e-15)
    with pytest.raises(ValueError, match="differs in packing"):
        pm.resume(tmp_path / "run.npz", scene.replace(packing=moved_packing))


def test_files_that_are_no_checkpoints_are_refused(tmp_path):
    scene, _ = flat()
    with pytest.raises(FileNotFoundError, match="path must name an existing file"):
        pm.resume(tmp_path / "none.npz", scene)
    pm.write_packing(scene.packing, tmp_path / "packing.npz")
    with pytest.raises(ValueError, match=r"path must name a checkpoint, got .*packing.npz': it must hold"):
        pm.resume(tmp_path / "packing.npz", scene)
    (tmp_path / "text.npz").write_text("text")
    with pytest.raises(ValueError, match=r"path must name a checkpoint, got .*: it is not a \.npz file"):
        pm.resume(tmp_path / "text.npz", scene)
    np.savez(tmp_path / "later.npz", checkpoint_json=np.array('{"version": 99}'))
    with pytest.raises(ValueError, match="version must be 2, got 99"):
        pm.resume(tmp_path / "later.npz", scene)


# a checkpoint without them is that of another run
OPTIONAL = ("held_n",)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A scene, and the checkpoint of a simulation of it that goes on."""
    path = tmp_path_factory.mktemp("kept") / "run.npz"
    scene, manner = spheres()
    pm.simulate(scene, steps=33, checkpoint=path, **manner)
    return scene, read_checkpoint(path, KIND)


def refused(scene, path, settings, arrays):
    """Resume from a checkpoint with a right checksum; it must be refused. Return the words."""
    write_checkpoint(path, KIND, settings, arrays)
    with pytest.raises(ValueError, match=r"^path must hold a run that can go on, got .*run\.npz': ") as caught:
        pm.resume(path, scene, steps=STEPS)
    return str(caught.value)


def test_a_checkpoint_that_lacks_an_array_is_refused(kept, tmp_path):
    scene, (settings, arrays) = kept
    for gone in arrays.keys() - OPTIONAL:
        refused(scene, tmp_path / "run.npz", settings, {name: arrays[name] for name in arrays if name != gone})
    rest = {name: arrays[name] for name in arrays if name != "start_row"}
    assert refused(scene, tmp_path / "run.npz", settings, rest).endswith("it must hold 'start_row', got none")


@pytest.mark.parametrize("change", [lambda array: array[:-1], lambda array: np.concatenate([array, array[-1:]])])
def test_a_checkpoint_with_an_array_of_another_length_is_refused(change, kept, tmp_path):
    scene, (settings, arrays) = kept
    for name in [name for name in arrays if arrays[name].ndim and arrays[name].size]:
        refused(scene, tmp_path / "run.npz", settings, arrays | {name: change(arrays[name])})


def test_a_checkpoint_whose_rows_are_not_those_of_its_steps_is_refused(kept, tmp_path):
    scene, (settings, arrays) = kept
    assert arrays["kept_step_t"].tolist() == [0, 10, 20, 30, 33]
    names = [name for name in arrays if name.startswith("kept_")]
    fewer = arrays | {name: arrays[name][[0, 1, 2, 4]] for name in names}
    assert "kept_step_t must be 0 and every 10 steps" in refused(scene, tmp_path / "run.npz", settings, fewer)
    shifted = arrays | {"kept_step_t": np.array([0, 10, 20, 31, 33])}
    assert "kept_step_t must be 0 and every 10 steps" in refused(scene, tmp_path / "run.npz", settings, shifted)
    count_t = arrays["snapshot_count_t"] + np.array([1, 0, 0, 0, 0])
    longer = arrays | {"snapshot_count_t": count_t}
    assert "the sum of snapshot_count_t" in refused(scene, tmp_path / "run.npz", settings, longer)


def test_a_checkpoint_with_wrong_settings_is_refused(kept, tmp_path):
    scene, (settings, arrays) = kept
    for gone in settings:
        rest = {name: settings[name] for name in settings if name != gone}
        assert refused(scene, tmp_path / "run.npz", rest, arrays).endswith(f"it must hold '{gone}', got none")
    for name, wrong in (
        ("dt", -0.1), ("dt", "short"), ("steps", 0), ("reached", 10**9), ("trace_every", 0), ("method", {"kind": ""}),
        ("trace_positions", 1), ("checkpoint_every", -1), ("scene", 3), ("applied_strain", {"kind": "steady-strain"}),
    ):  # fmt: skip
        refused(scene, tmp_path / "run.npz", settings | {name: wrong}, arrays)
    refused(scene, tmp_path / "run.npz", settings, arrays | {"held_n": scene.packing.mass_n})
    for wrong in ({}, [], {**json.loads(str(arrays["numbers_json"])), "largest": []}):
        refused(scene, tmp_path / "run.npz", settings, arrays | {"numbers_json": np.array(json.dumps(wrong))})


def test_an_end_that_lies_behind_is_refused(tmp_path):
    scene, manner = dimers()
    pm.simulate(scene, steps=20, checkpoint=tmp_path / "run.npz", **manner)
    with pytest.raises(ValueError, match="steps must be an integer at least 20 and at most 10000000000000, got 10"):
        pm.resume(tmp_path / "run.npz", scene, steps=10)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"checkpoint": "run.txt"}, r"checkpoint must end in \.npz, got 'run\.txt'"),
        ({"checkpoint": "no such folder/run.npz"}, "checkpoint must lie in an existing folder"),
        ({"checkpoint_every": 5}, "checkpoint_every must be left out where no checkpoint is given, got 5"),
    ],
)
def test_where_to_write_is_checked_before_the_run(given, message):
    scene, manner = dimers()
    with pytest.raises(ValueError, match=message):
        pm.simulate(scene, steps=2, **manner, **given)


def test_the_simulation_of_a_drive_goes_on_from_its_checkpoint_with_the_same_bits(tmp_path):
    pair = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    drive = pm.SimulateDrive(steps=40, dt=0.05, velocities=((0.1, 0.0), (0.0, 0.2)))
    scene = pm.Scene(pair, (pm.Repulsion(),), drive)
    longer = scene.replace(drive=dataclasses.replace(drive, steps=80))
    whole = pm.run(longer)
    half = pm.run(scene, checkpoint=tmp_path / "run.npz")
    assert half.steps == 40
    again = pm.run(longer, checkpoint=tmp_path / "run.npz")
    assert again.packing == whole.packing and (again.velocity_nd == whole.velocity_nd).all()
    assert again.steps == 80
    # what was finished comes back as it was
    assert pm.run(longer, checkpoint=tmp_path / "run.npz").packing == whole.packing
    for change in ({"dt": 0.04}, {"velocities": ((0.3, 0.0), (0.0, 0.2))}):
        other = scene.replace(drive=dataclasses.replace(drive, **change))
        with pytest.raises(ValueError, match="checkpoint must hold a run of the same scene and settings.*another"):
            pm.run(other, checkpoint=tmp_path / "run.npz")
