"""Arrays by name in numpy's .npz archives: looked at before they are unpacked, and sealed.

The seal is one more array, ``sha256``: the hash of the names, kinds, shapes and bytes of all others. Who changes an
array of a sealed archive, by chance or with numpy, breaks it. An archive without one, such as numpy alone writes, is
read as it is.
"""

from __future__ import annotations

import hashlib
import io
import lzma
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from packmech.check import check_memory

SEAL = "sha256"
# what numpy and zipfile make of an archive that was damaged, or made by hand
UNREADABLE = (
    OSError, EOFError, LookupError, AttributeError, TypeError, ValueError, RuntimeError, ArithmeticError, MemoryError,
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, tokenize.TokenError,
)  # fmt: skip
_ENDING = ".npy"
# numbers, truth values, times and texts: what needs no code of a file to be read
_KINDS = "biufcmMUS"


def write_archive(file: BinaryIO, arrays: Mapping[str, Any]) -> None:
    """Write arrays by name into an open file, and their seal."""
    found = {name: np.asarray(one) for name, one in arrays.items()}
    np.savez(file, allow_pickle=False, **found, **{SEAL: np.array(seal(found))})


def seal(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Return the hash of arrays by name, in whichever order; the seal itself does not count."""
    taken = hashlib.sha256()
    for name in sorted(arrays):
        if name != SEAL:
            one = np.ascontiguousarray(arrays[name])
            taken.update(f"{name}\0{one.dtype.str}{arrays[name].shape}\0".encode())
            taken.update(one.tobytes())
    return taken.hexdigest()


def read_archive(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive by name, after a look at what each of them says that it is.

    Raises
    ------
    ValueError
        If it is no such archive; if two arrays have one name, an array is of objects, does not hold what its head says
        or needs more memory than there is; or if there is a seal and it is broken.
    zipfile.BadZipFile, zlib.error
        If bytes are not those that were written.

    """
    # numpy would take what is none for pickled objects
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path.name} is not a .npz file")
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        names = [one.filename for one in members]
        twice = next((one for one in names if names.count(one) > 1), None)
        if twice is not None:
            raise ValueError(f"it must hold each array once, got {twice!r} twice")
        other = next((one for one in names if not one.endswith(_ENDING)), None)
        if other is not None:
            raise ValueError(f"it must hold arrays ({_ENDING}), got {other!r}")
        for member in members:
            _check_head(archive, member)
        check_memory(path.name, sum(one.file_size for one in members))
        arrays = {}
        for member in members:
            with archive.open(member) as file:
                arrays[member.filename.removesuffix(_ENDING)] = np.lib.format.read_array(file, allow_pickle=False)
    if SEAL in arrays:
        check_seal(arrays, str(arrays[SEAL]))
    return arrays


def _check_head(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Refuse a member whose head says something else than its size, or nothing that is an array of numbers or texts."""
    with archive.open(member) as packed:
        file = io.BytesIO(packed.read(_LONGEST_HEAD))
    name = member.filename
    version = np.lib.format.read_magic(file)
    if version not in _HEADS:
        raise ValueError(f"{name} must be of a version of numpy's format from 1 to 3, got {version[0]}.{version[1]}")
    shape, _, dtype = _HEADS[version](file)
    if dtype.kind not in _KINDS:
        raise ValueError(f"{name} must be an array of numbers, times or texts, got one of {dtype}")
    wanted, held = dtype.itemsize * int(np.prod(shape, dtype=object)), member.file_size - file.tell()
    if wanted != held:
        raise ValueError(f"{name} must hold the {wanted} bytes of {dtype} of shape {shape}, got {held}")


_LONGEST_HEAD = 1 << 17
_HEADS: dict[tuple[int, int], Any] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
    (3, 0): np.lib.format.read_array_header_2_0,
}


def check_seal(arrays: Mapping[str, NDArray[Any]], given: str) -> None:
    """Refuse arrays that are not those that a seal was made of."""
    if given != seal(arrays):
        raise ValueError(
            f"its arrays must be those that were written, by their seal ({SEAL}), got others: it was changed since; "
            f"without the array {SEAL} it is read as it is"
        )
