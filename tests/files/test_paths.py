"""Names of files, and files that are replaced as a whole."""

import concurrent.futures
import fcntl
import os
from pathlib import Path

import pytest

from packmech.files.paths import existing_file, file_name, made_folder, replacing, writable_file


def replace(path, text="new"):
    with replacing(path) as partial:
        partial.write_text(text)


@pytest.mark.parametrize(
    ("path", "error", "message"),
    [
        (3, TypeError, "path must be a file name, got 3"),
        ("", TypeError, "path must be a file name, got ''"),
        (b"a.npz", TypeError, "path must be a file name, got b'a.npz'"),
        ("a\0b", ValueError, "path must be a file name without zero bytes"),
        ("\udc80\ud800", ValueError, "path must be a file name without zero bytes and halves of letters"),
        ("n" * 256, ValueError, "path must be a file name of fewer letters, got .* of 256"),
        ("n/" * 4000, ValueError, "path must be a file name of fewer letters"),
    ],
)
def test_what_is_no_file_name_is_refused(path, error, message):
    with pytest.raises(error, match=message):
        file_name("path", path)


def test_a_long_name_can_be_read_where_nothing_could_be_written_beside_it(tmp_path):
    path = tmp_path / ("n" * 240)
    path.write_text("x")
    assert existing_file("path", path) == path
    with pytest.raises(ValueError, match="out must lie in a folder where a file can be made, got .*File name too long"):
        writable_file("out", path)


def test_a_note_of_ones_own_beside_a_file_stays(tmp_path):
    note = tmp_path / f".a.{'z' * 32}.csv"
    note.write_text("mine")
    os.utime(note, (0, 0))
    with replacing(tmp_path / "a.csv") as partial:
        partial.write_text("x")
    assert note.exists()


def test_a_folder_is_no_file(tmp_path):
    for look in (existing_file, writable_file):
        with pytest.raises(ValueError, match="out must name a file, got the folder"):
            look("out", tmp_path)
    with pytest.raises(FileNotFoundError, match="out must name an existing file, got .*none"):
        existing_file("out", tmp_path / "none")
    with pytest.raises(ValueError, match="out must lie in an existing folder, got .*none"):
        writable_file("out", tmp_path / "none" / "a.npz")


def test_a_folder_is_made_with_those_that_it_lies_in_or_the_reason_is_named(tmp_path):
    assert made_folder("out", tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    for impossible, why in ((tmp_path / "file", "File exists"), (tmp_path / "file" / "a", "Not a directory")):
        with pytest.raises(ValueError, match=f"out must be a folder, or one that can be made, got .*file.*: {why}"):
            made_folder("out", impossible)
    with pytest.raises(TypeError, match="out must be a folder's name, got 3"):
        made_folder("out", 3)


def test_a_file_may_lie_in_a_folder_that_is_made_for_it(tmp_path):
    assert writable_file("out", tmp_path / "new" / "a.npz", make_folder=True).parent.is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="out must lie in an existing folder, got .*file/a.npz"):
        writable_file("out", tmp_path / "file" / "a.npz", make_folder=True)


def test_that_a_file_can_be_made_is_tried_and_leaves_nothing():
    # where no file can be made, whoever asks
    with pytest.raises(ValueError, match="out must lie in a folder where a file can be made, got '/proc/self/fd/a'"):
        writable_file("out", "/proc/self/fd/a")


def test_a_trial_leaves_nothing(tmp_path):
    assert writable_file("out", tmp_path / "a.npz") == tmp_path / "a.npz"
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_and_what_it_leads_to_is_replaced(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "a.txt").write_text("old")
    (tmp_path / "b.txt").symlink_to(tmp_path / "there" / "a.txt")
    replace(tmp_path / "b.txt")
    assert (tmp_path / "b.txt").is_symlink()
    assert (tmp_path / "there" / "a.txt").read_text() == "new"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["b.txt", "there"]


def test_a_device_stays_one(tmp_path):
    (tmp_path / "full.txt").symlink_to("/dev/full")
    assert writable_file("out", tmp_path / "full.txt") == tmp_path / "full.txt"
    with pytest.raises(OSError, match="No space left.*full.txt"):
        replace(tmp_path / "full.txt")
    assert Path("/dev/full").is_char_device() and (tmp_path / "full.txt").is_symlink()


@pytest.mark.parametrize("rights", [0o600, 0o640, 0o444])
def test_a_replaced_file_has_the_rights_that_it_had(tmp_path, rights):
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "a.txt").chmod(rights)
    replace(tmp_path / "a.txt")
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == rights


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(OSError, match="full"), replacing(tmp_path / "a.txt") as partial:
        partial.write_text("half")
        raise OSError("full")
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("a.txt", "old")]


def test_a_write_that_fails_names_the_file_and_not_the_half_of_it(tmp_path):
    with pytest.raises(OSError, match=r"\[Errno 28\] no room: '.*/a.txt'"), replacing(tmp_path / "a.txt") as partial:
        raise OSError(28, "no room", str(partial))
    with pytest.raises(OSError, match=r"\[Errno 28\] no room: '.*/a.txt'"), replacing(tmp_path / "a.txt"):
        raise OSError(28, "no room")


def test_threads_that_write_one_file_leave_one_of_theirs_whole(tmp_path):
    texts = [str(k) * 100_000 for k in range(4)]

    def write(text):
        for _ in range(20):
            with replacing(tmp_path / "a.txt") as partial:
                partial.write_text(text)
            assert (tmp_path / "a.txt").read_text() in texts

    with concurrent.futures.ThreadPoolExecutor() as pool:
        list(pool.map(write, texts))
    assert [one.name for one in tmp_path.iterdir()] == ["a.txt"]


def test_files_that_a_killed_process_left_are_removed_and_those_in_work_are_not(tmp_path):
    names = [f".a.{digit * 32}.txt" for digit in "123"]
    for name in names:
        (tmp_path / name).write_text("half")
    (tmp_path / ".a.notes.txt").write_text("somebody's own")
    # two of them are old, and one of these is being written
    for name in names[:2]:
        os.utime(tmp_path / name, (0.0, 0.0))
    with open(tmp_path / names[1], "rb") as written:
        fcntl.flock(written, fcntl.LOCK_EX)
        replace(tmp_path / "a.txt")
    assert sorted(one.name for one in tmp_path.iterdir()) == sorted([*names[1:], ".a.notes.txt", "a.txt"])
