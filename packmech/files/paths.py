"""Names of files: what is one, what is there to be read, what can be written, and how a file is replaced as a whole."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from packmech.check import brief

PathLike = str | os.PathLike[str]
# bytes of a name that file systems take, and of a whole path
_LONGEST_NAME, _LONGEST_PATH = 255, 4096
# seconds after which a half-written file without a writer is one that a process left when it was killed
_FORGOTTEN = 60.0


def file_name(argument: str, path: Any, what: str = "a file name") -> Path:
    """Return a path after checking that it can be the name of a file.

    Raises
    ------
    TypeError, ValueError
        Naming the argument and what was given.

    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"{argument} must be {what}, got {brief(path)}")
    text = os.fspath(path)
    if not isinstance(text, str) or not text:
        raise TypeError(f"{argument} must be {what}, got {brief(path)}")
    try:
        encoded = os.fsencode(text)
    except UnicodeEncodeError:
        encoded = b"\0"
    if b"\0" in encoded:
        raise ValueError(f"{argument} must be {what} without zero bytes and halves of letters, got {brief(text)}")
    longest = max(len(part) for part in encoded.split(b"/"))
    if longest > _LONGEST_NAME or len(encoded) > _LONGEST_PATH:
        raise ValueError(f"{argument} must be {what} of fewer letters, got {brief(text)} of {len(text)}")
    return Path(text)


def existing_file(argument: str, path: Any) -> Path:
    """Return the path of a file that is there.

    Raises
    ------
    TypeError, ValueError
        If it is no file name, or that of a folder.
    FileNotFoundError
        If there is no such file.

    """
    found = file_name(argument, path)
    if found.is_dir():
        raise ValueError(f"{argument} must name a file, got the folder {str(path)!r}")
    if not found.is_file():
        raise FileNotFoundError(f"{argument} must name an existing file, got {str(path)!r}")
    return found


def printable(text: str) -> str:
    """Return the name of a file with a question mark for each byte that no letter stands for."""
    return text.encode("utf-8", "replace").decode()


def writable_file(argument: str, path: Any, *, make_folder: bool = False) -> Path:
    """Return the path of a file to be written, after trying that a file can be made beside it, in a new folder or not.

    Raises
    ------
    TypeError, ValueError
        If it is no file name, that of a folder, lies in no folder, or in one where no file can be made.

    """
    target = file_name(argument, path)
    if target.is_dir():
        raise ValueError(f"{argument} must name a file, got the folder {str(path)!r}")
    if _is_device(target):
        return target
    folder = _behind_links(target).parent
    if make_folder:
        # what cannot be made is missing below
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
    if not folder.is_dir():
        raise ValueError(f"{argument} must lie in an existing folder, got {str(path)!r}")
    trial = folder / _beside(target.name)
    try:
        open(trial, "xb").close()
        trial.unlink(missing_ok=True)
    except OSError as error:
        raise ValueError(
            f"{argument} must lie in a folder where a file can be made, got {str(path)!r}: {error.strerror}"
        ) from error
    return target


def made_folder(argument: str, path: Any) -> Path:
    """Return the path of a folder, made with those that it lies in where need be.

    Raises
    ------
    TypeError, ValueError
        If it is no folder's name, that of a file, or one that cannot be made.

    """
    target = file_name(argument, path, "a folder's name")
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"{argument} must be a folder, or one that can be made, got {str(path)!r}: {error.strerror}"
        ) from error
    return target


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Give a file to write beside the target, of a name of its own, which replaces it in one step at the end.

    A link stays one, and what it leads to is replaced; the file has the rights that it had. Half-written files of
    processes that were killed while they wrote the same target are removed. A device or a pipe is written itself.
    """
    if _is_device(target):
        with _naming(target, target):
            yield target
        return
    whole = _behind_links(target)
    _remove_forgotten(whole)
    partial = whole.with_name(_beside(whole.name))
    try:
        # held for as long as it is written: a lock ends with its process, however that ends
        with _naming(partial, target), open(partial, "xb") as file:
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield partial
            with suppress(OSError):
                shutil.copymode(whole, partial)
            os.replace(partial, whole)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def _naming(partial: Path, target: Path) -> Iterator[None]:
    """Name the target, and not the temporary file beside it, in an error: of a full disk, say."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(partial)):
            raise
        raise OSError(error.errno, error.strerror, str(target)) from error


def _beside(name: str) -> str:
    """Return the name of a file that is half written; it ends as the whole one, as writers go by the ending."""
    path = Path(name)
    return f".{path.stem}.{uuid.uuid4().hex}{path.suffix}"


def _is_device(target: Path) -> bool:
    return target.exists() and not target.is_file()


def _behind_links(target: Path) -> Path:
    return Path(os.path.realpath(target)) if target.is_symlink() else target


def _remove_forgotten(whole: Path) -> None:
    """Remove half-written files of a target that nobody writes any more."""
    ours = re.compile(rf"\.{re.escape(whole.stem)}\.[0-9a-f]{{32}}{re.escape(whole.suffix)}")
    with suppress(OSError), os.scandir(whole.parent) as entries:
        for entry in entries:
            if not ours.fullmatch(entry.name):
                continue
            # another thread may have put its own in place by now
            with suppress(OSError):
                if time.time() - entry.stat().st_mtime < _FORGOTTEN:
                    continue
                with open(entry.path, "rb") as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(entry.path)
