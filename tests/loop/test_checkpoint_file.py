"""Facts about the one file format of checkpoints: nothing in it changes unnoticed, and a failed write loses nothing."""

import json
import threading

import numpy as np
import pytest

import packmech as pm
from packmech.loop import checkpoint
from packmech.loop.checkpoint import IndexBounds, check_indices, read_checkpoint, write_checkpoint

ARRAYS = {"x_nd": np.arange(12.0).reshape(6, 2), "i_c": np.arange(5), "name": np.array("text")}


@pytest.fixture
def path(tmp_path):
    """A checkpoint."""
    write_checkpoint(tmp_path / "run.npz", "a test", {"dt": 0.1}, ARRAYS)
    return tmp_path / "run.npz"


def test_what_is_written_is_read_and_numpy_reads_it_too(path):
    found = read_checkpoint(path, "a test")
    assert found.settings == {"dt": 0.1}
    assert {name: value.tobytes() for name, value in found.arrays.items()} == {
        name: value.tobytes() for name, value in ARRAYS.items()
    }
    with np.load(path) as archive:
        assert archive["x_nd"].tobytes() == ARRAYS["x_nd"].tobytes()


def test_every_flipped_byte_is_noticed(path):
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        with pytest.raises(ValueError, match="path must name a checkpoint, got .*: "):
            read_checkpoint(path, "a test")


@pytest.mark.parametrize("part", [0.0, 0.3, 0.99])
def test_a_file_that_was_cut_off_is_refused(path, part):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(ValueError, match="path must name a checkpoint"):
        read_checkpoint(path, "a test")


def test_another_version_and_another_kind_are_refused_by_name(path, monkeypatch):
    with pytest.raises(ValueError, match="a checkpoint of strained runs, got .*, one of a test"):
        read_checkpoint(path, "strained runs")
    with monkeypatch.context() as patched:
        patched.setattr(pm, "__version__", "0.2.0")
        with pytest.raises(ValueError, match=r"packmech must be 0\.2\.0, got 0\.1\.0"):
            read_checkpoint(path, "a test")
    monkeypatch.setattr(checkpoint, "_VERSION", 3)
    with pytest.raises(ValueError, match="version must be 3, got 2"):
        read_checkpoint(path, "a test")


def test_a_checkpoint_of_the_first_version_is_refused_by_its_version(tmp_path):
    np.savez(tmp_path / "old.npz", checkpoint_json=np.array(json.dumps({"version": 1})), row=np.zeros(3))
    with pytest.raises(ValueError, match="version must be 2, got 1"):
        read_checkpoint(tmp_path / "old.npz", "a test")


def test_threads_that_write_at_once_leave_one_whole_file(path, tmp_path):
    failures = []

    def write(number):
        try:
            for _ in range(20):
                write_checkpoint(path, "a test", {"dt": number}, {"x_nd": np.full((2000, 2), float(number))})
        except BaseException as failure:
            failures.append(failure)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert not failures
    found = read_checkpoint(path, "a test")
    assert (found.arrays["x_nd"] == found.settings["dt"]).all()
    assert [one.name for one in tmp_path.iterdir()] == ["run.npz"]


def test_arrays_of_integers_must_be_declared_and_within_their_bounds():
    bounds = {"i_c": IndexBounds(0, 5, (None,))}
    check_indices(ARRAYS, bounds)
    with pytest.raises(ValueError, match="i_c must be declared with its bounds"):
        check_indices(ARRAYS, {})
    for bad, message in (
        (np.array([0, 5]), "at least 0 and below 5, got 5"),
        (np.array([-1]), "at least 0 and below 5, got -1"),
        (np.array([[0]]), r"must have shape \(None,\), got \(1, 1\)"),
        (np.array([0.0]), "must be of kind int64, got float64"),
    ):
        with pytest.raises(ValueError, match=message):
            check_indices({"i_c": bad}, bounds)


class Stopped:
    """A disk that is full from the n-th write on, and has room again after so many failures."""

    def __init__(self, monkeypatch, failures):
        self.left, self.usual = failures, checkpoint.replacing
        monkeypatch.setattr(checkpoint, "replacing", self)

    def __call__(self, path):
        if self.left:
            self.left -= 1
            raise OSError(28, "No space left on device")
        return self.usual(path)


def discs():
    """A few discs under slow shear."""
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=1)
    return pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))


RAMP = {"rate": 0.1, "applied_strain": 0.2, "samples": 20}


def test_a_disk_that_is_full_for_a_while_costs_a_warning(tmp_path, monkeypatch):
    monkeypatch.setattr("packmech.loop.run_loop._WRITE_EVERY", -1.0)
    monkeypatch.setattr("packmech.rheology.strain_run._CHUNK", 2000)
    whole = pm.ramp_strain(discs(), **RAMP)
    Stopped(monkeypatch, 1)
    with pytest.warns(UserWarning, match="the checkpoint could not be written, the one before stays.*No space"):
        run = pm.ramp_strain(discs(), checkpoint=tmp_path / "run.npz", **RAMP)
    assert run.packing == whole.packing
    assert pm.ramp_strain(discs(), checkpoint=tmp_path / "run.npz", **RAMP).packing == whole.packing


def test_a_checkpoint_that_cannot_be_written_at_the_end_leaves_the_old_file_and_the_run(tmp_path, monkeypatch):
    path = tmp_path / "run.npz"
    whole = pm.ramp_strain(discs(), **RAMP)
    pm.ramp_strain(discs(), checkpoint=path, time_limit=1e-9, check=False, **RAMP)
    before = path.read_bytes()
    Stopped(monkeypatch, 1)
    with pytest.raises(OSError, match="No space") as caught:
        pm.ramp_strain(discs(), checkpoint=path, **RAMP)
    assert caught.value.run.packing == whole.packing
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["run.npz"]


def test_a_folder_that_is_gone_leaves_the_run(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    gone = []

    def remove(stage, figures):
        if not gone:
            gone.append(folder.rmdir())

    with pytest.raises(FileNotFoundError) as caught:
        pm.ramp_strain(discs(), checkpoint=folder / "run.npz", progress=remove, **RAMP)
    assert caught.value.run.outcome is pm.Outcome.FINISHED
