"""Archives of arrays: what was changed is refused, what is too large is not unpacked, what numpy wrote is read."""

import io
import zipfile

import numpy as np
import pytest

import packmech as pm
from packmech.files.archive import SEAL, read_archive, write_archive

ARRAYS = {
    "position_nd": np.array([[0.1, 0.2], [0.3, 0.4]]),
    "kind_n": np.array([0, 1]),
    "law": np.array("harmonic"),
    "day": np.array(["2026-11-29"], dtype="M8[D]"),
}


def written(path, arrays):
    with open(path, "wb") as file:
        write_archive(file, arrays)
    return path


def member(array):
    held = io.BytesIO()
    np.lib.format.write_array(held, array, allow_pickle=True)
    return held.getvalue()


def archive(path, *members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members:
            file.writestr(name, content)
    return path


def test_what_is_written_is_read_back_with_its_seal(tmp_path):
    found = read_archive(written(tmp_path / "a.npz", ARRAYS))
    assert set(found) == {*ARRAYS, SEAL}
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array)


@pytest.mark.parametrize(
    "change",
    [
        lambda held: held["position_nd"].__setitem__((1, 1), np.nextafter(0.4, 1.0)),
        lambda held: held.update(position_nd=held["position_nd"][::-1]),
        lambda held: held.update(position_nd=held["position_nd"].astype(np.float32)),
        lambda held: held.update(kind_n=held["kind_n"].astype(np.uint8)),
        lambda held: held.update(kind_n=held["kind_n"].reshape(2, 1)),
        lambda held: held.update(law=np.array("hertz")),
        lambda held: held.update(other=np.zeros(2)),
        lambda held: held.pop("kind_n"),
        lambda held: held.update({SEAL: np.array("0" * 64)}),
    ],
)
def test_a_sealed_archive_that_was_written_again_otherwise_is_refused(tmp_path, change):
    held = read_archive(written(tmp_path / "a.npz", ARRAYS))
    change(held)
    np.savez(tmp_path / "b.npz", **held)
    with pytest.raises(ValueError, match="its arrays must be those that were written, by their seal"):
        read_archive(tmp_path / "b.npz")
    held.pop(SEAL)
    np.savez(tmp_path / "c.npz", **held)
    assert set(read_archive(tmp_path / "c.npz")) == set(held)


def test_a_packing_that_was_changed_by_numpy_is_refused_and_one_that_numpy_made_is_read(tmp_path):
    packing = pm.lattice_packing("triangular", repeats=(2, 2))
    pm.write_packing(packing, tmp_path / "a.npz", law=pm.Hertz())
    with np.load(tmp_path / "a.npz") as file:
        held = {name: file[name] for name in file.files}
    held["radius_n"] = held["radius_n"] * 1.01
    np.savez(tmp_path / "b.npz", **held)
    with pytest.raises(ValueError, match=r"path must name a readable packing, got .*b\.npz.*seal"):
        pm.read_packing(tmp_path / "b.npz")
    held.pop(SEAL)
    np.savez(tmp_path / "c.npz", **held)
    assert pm.read_packing(tmp_path / "c.npz").radius_n[0] == 0.5 * 1.01


def test_two_arrays_of_one_name_are_refused(tmp_path):
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = archive(tmp_path / "a.npz", ("a.npy", member(np.zeros(3))), ("a.npy", member(np.ones(3))))
    with pytest.raises(ValueError, match=r"it must hold each array once, got 'a\.npy' twice"):
        read_archive(path)


def test_objects_are_refused_before_anything_of_them_is_read(tmp_path):
    path = archive(tmp_path / "a.npz", ("a.npy", member(np.array([print], dtype=object))))
    with pytest.raises(ValueError, match=r"a\.npy must be an array of numbers, times or texts, got one of object"):
        read_archive(path)


def test_what_is_no_array_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"it must hold arrays \(\.npy\), got 'a\.txt'"):
        read_archive(archive(tmp_path / "a.npz", ("a.txt", b"text")))
    with pytest.raises(ValueError, match=r"b\.npz is not a \.npz file"):
        (tmp_path / "b.npz").write_bytes(b"no archive")
        read_archive(tmp_path / "b.npz")


def test_a_head_that_says_another_size_is_refused_before_memory_is_taken(tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 2)})
    path = archive(tmp_path / "a.npz", ("a.npy", head.getvalue() + bytes(160)))
    with pytest.raises(ValueError, match=r"a\.npy must hold the 16000000000000 bytes of float64 .* got 160"):
        read_archive(path)


def test_what_memory_does_not_hold_is_refused_by_what_the_archive_says(tmp_path, monkeypatch):
    path = archive(tmp_path / "a.npz", ("a.npy", member(np.zeros(1_000_000))))
    assert path.stat().st_size < 20_000
    monkeypatch.setattr("packmech.check._memory", lambda: 1e6)
    with pytest.raises(ValueError, match=r"a\.npz must be so small that memory holds it, got what takes 8 MB"):
        read_archive(path)


def test_what_a_damaged_archive_holds_is_not_the_message(tmp_path):
    """Where the length of a name is damaged, the library's error repeats thousands of bytes as the name."""
    path = tmp_path / "long.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("position_nd.npy", 9_000 * b"x")
    content = bytearray(path.read_bytes())
    content[26:28] = (6_000).to_bytes(2, "little")
    path.write_bytes(content)
    with pytest.raises(ValueError, match="path must name a readable packing.*File name in directory") as found:
        pm.read_packing(path)
    assert len(str(found.value)) < 1000
