"""Facts about the one file format of checkpoints: nothing in it changes unnoticed, and a failed write loses nothing."""

import json
import threading

import numpy as np
import pytest

import packmech as pm
from packmech.loop import checkpoint
from packmech.loop.checkpoint import (
    IndexBounds,
    RunsFile,
    check_indices,
    fingerprint,
    read_checkpoint,
    saved_array,
    scene_fingerprints,
    write_checkpoint,
)

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


def test_an_archive_of_other_things_is_refused_by_what_it_lacks(tmp_path):
    np.savez(tmp_path / "other.npz", row=np.zeros(3), number=np.zeros(1))
    with pytest.raises(ValueError, match=r"it must hold checkpoint_json, got row, number"):
        read_checkpoint(tmp_path / "other.npz", "a test")


def test_what_is_no_archive_at_all_is_said_to_be_none(tmp_path):
    for content in (b"", b"a text", b"\x93NUMPY"):
        (tmp_path / "text.npz").write_bytes(content)
        with pytest.raises(ValueError, match="it is not a .npz file"):
            read_checkpoint(tmp_path / "text.npz", "a test")


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


# -- what a checkpoint is of


def packings():
    """Return packings, each of which differs from the first in one thing, by what that is."""
    one = pm.random_packing(6, dimension=2, packing_fraction=0.3, seed=1)
    links = {"i_l": [0, 1], "j_l": [1, 2], "image_ld": [[0, 0], [0, 0]], "length_l": [1.0, 1.0]}
    linked = pm.Links(**links)
    aspect, director = np.full(6, 1.5), np.tile([1.0, 0.0], (6, 1))
    return {
        "nothing": one,
        "a position by rounding": one.replace(position_nd=one.position_nd * (1.0 + 2.0**-52)),
        "radii": one.replace(radius_n=one.radius_n * 1.5),
        "box": one.replace(box=pm.Box(2.0 * one.box.lattice_dd)),
        "masses": one.replace(mass_n=np.ones(6)),
        "other masses": one.replace(mass_n=np.full(6, 2.0)),
        "kinds": one.replace(kind_n=[0, 1, 0, 1, 0, 1]),
        "other kinds": one.replace(kind_n=[1, 0, 1, 0, 1, 0]),
        "links": one.replace(links=linked),
        "ends of links": one.replace(links=pm.Links(**links | {"j_l": [1, 3]})),
        "first ends of links": one.replace(links=pm.Links(**links | {"i_l": [0, 4]})),
        "images of links": one.replace(links=pm.Links(**links | {"image_ld": [[0, 0], [1, 0]]})),
        "lengths of links": one.replace(links=pm.Links(**links | {"length_l": [1.0, 1.25]})),
        "links that hold a shape": one.replace(links=pm.Links(**links, shape_l=[True, False])),
        "shapes": one.replace(shapes=pm.Spheroids(aspect, director)),
        "aspect ratios": one.replace(shapes=pm.Spheroids(2.0 * aspect, director)),
        "directions": one.replace(shapes=pm.Spheroids(aspect, director[:, ::-1])),
    }


def test_packings_that_differ_in_anything_have_other_fingerprints_and_equal_ones_the_same():
    def taken():
        return {
            name: scene_fingerprints(pm.Scene(packing, (pm.Repulsion(),)))["packing"]
            for name, packing in packings().items()
        }

    found = taken()
    assert len(set(found.values())) == len(found) and found == taken()


def test_arrays_of_the_same_bytes_have_other_fingerprints_where_shapes_or_types_differ():
    x = np.arange(4.0)
    alike = [x, x.reshape(2, 2), x.view(np.int64), list(x), tuple(x), x.copy(order="F")[::1]]
    found = [fingerprint(one) for one in alike]
    assert len(set(found[:5])) == 5 and found[5] == found[0]
    assert fingerprint(np.arange(8.0)[::2]) == fingerprint(np.arange(0.0, 8.0, 2.0))


def test_a_law_of_ones_own_has_another_fingerprint_when_its_formula_was_edited(tmp_path):
    def law(power):
        file = tmp_path / f"own_{power}.py"
        file.write_text(
            "from typing import NamedTuple\nclass Own(NamedTuple):\n    energy_scale: float = 1.0\n"
            f"    def energy(self, r, s):\n        return self.energy_scale * (1.0 - r / s) ** {power}\n"
        )
        space = {"__name__": "own_law"}
        exec(compile(file.read_text(), str(file), "exec"), space)
        return space["Own"]()

    assert fingerprint(law(2)) != fingerprint(law(3)) and fingerprint(law(2)) == fingerprint(law(2))


def test_the_sources_of_packmech_are_no_part_of_a_fingerprint(monkeypatch):
    values = (1, "a", 2.0, None, np.arange(3), pm.Harmonic(), pm.Repulsion(law=pm.Hertz()), pm.Fire())
    before = fingerprint(values)
    # its version tells these apart
    monkeypatch.setattr(checkpoint, "source_key", lambda kind: "edited")
    assert fingerprint(values) == before


class Counted:
    """A run that is a number."""

    def __init__(self, number=0.0):
        self.number = number

    def arrays(self):
        return {"number": np.array([self.number]), "place_n": np.arange(3)}

    def index_bounds(self):
        return {"place_n": IndexBounds(0, 3, (3,))}

    def restore(self, kept):
        self.number = float(saved_array(kept, "number", (1,))[0])


def test_runs_that_follow_each_other_are_each_restored_in_their_turn(tmp_path):
    path = tmp_path / "runs.npz"
    first = RunsFile(path, "counts")
    for turn in range(3):
        run = Counted(10.0 + turn)
        assert not first.begin(run, {"turn": turn})
        first.write(run, finished=turn < 2)
    again = RunsFile(path, "counts")
    assert again.finished == [True, True, False]
    for turn in range(3):
        run = Counted()
        assert again.begin(run, {"turn": turn}) and run.number == 10.0 + turn
        # one that was finished stays as it was
        again.write(Counted(99.0), finished=True)
    last = RunsFile(path, "counts")
    numbers = [Counted() for _ in range(4)]
    assert [last.begin(run, {"turn": turn}) for turn, run in enumerate(numbers)] == [True, True, True, False]
    assert [run.number for run in numbers] == [10.0, 11.0, 99.0, 0.0] and last.finished == [True, True, True, False]


def test_runs_of_other_settings_and_files_that_hold_no_runs_are_refused(tmp_path):
    path = tmp_path / "runs.npz"
    first = RunsFile(path, "counts")
    first.begin(Counted(), {"turn": 0, "rate": 1.0})
    first.write(Counted(), finished=False)
    with pytest.raises(ValueError, match="with another rate; without that file"):
        RunsFile(path, "counts").begin(Counted(), {"turn": 0, "rate": 2.0})
    with pytest.raises(ValueError, match="with another rate, another size; without"):
        RunsFile(path, "counts").begin(Counted(), {"turn": 0, "size": 2.0})
    for settings, arrays, message in (
        ({"runs": [{}]}, {}, "checkpoint must hold runs, got .*finished"),
        ({"runs": [{}], "finished": []}, {}, "finished must be of length 1, as runs are, got 0"),
        ({"runs": [{}], "finished": [True]}, {"1.number": np.zeros(1)}, "checkpoint must hold runs"),
        ({"runs": [{}], "finished": [True]}, {"number": np.zeros(1)}, "checkpoint must hold runs"),
    ):
        write_checkpoint(path, "counts", settings, arrays)
        with pytest.raises(ValueError, match=message):
            RunsFile(path, "counts")
    write_checkpoint(path, "counts", {"runs": [{}], "finished": [False]}, {"0.place_n": np.arange(3)})
    with pytest.raises(ValueError, match="it must hold 'number', got none"):
        RunsFile(path, "counts").begin(Counted(), {})
    write_checkpoint(
        path, "counts", {"runs": [{}], "finished": [False]}, {"0.place_n": np.arange(3), "0.number": np.zeros(2)}
    )
    with pytest.raises(ValueError, match=r"number must be float64 of shape \(1,\), got float64 of \(2,\)"):
        RunsFile(path, "counts").begin(Counted(), {})


def test_a_saved_array_is_returned_as_it_is_and_refused_by_kind_and_shape():
    x = np.zeros((3, 2))
    assert saved_array({"x": x}, "x", (3, 2)) is x and saved_array({"x": x}, "x", (None, 2)) is x
    for bad in (np.zeros((3, 2), dtype=np.int64), np.zeros(3), np.zeros((2, 2)), np.zeros((3, 2, 1))):
        with pytest.raises(ValueError, match="x must be float64 of shape"):
            saved_array({"x": bad}, "x", (3, 2))


def test_checkpoints_are_written_to_files_of_their_ending_only(tmp_path):
    assert checkpoint.check_path(tmp_path / "run.npz") == tmp_path / "run.npz"
    with pytest.raises(ValueError, match="checkpoint must end in .npz, got"):
        checkpoint.check_path(tmp_path / "run.txt")
