"""Machine code on disk: one file for each function and key, never the code of another key.

Numba's own cache keeps an index of numbered data files, written without a lock: two processes that compile at the same
time can give one number to two codes, and a damaged file stops every later run. Here the name of a file is a hash of
the key. The file holds a checksum, the key and the code, and is moved into place when it is whole. A file that cannot
be read is as good as none, and one that cannot be written costs one warning.

The key names all that the code depends on and nothing of where the sources lie: checkouts with the same sources can
share a folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pathlib
import pickle
import sys
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.core.typing import signature
from numba.misc.appdirs import user_cache_dir

from packmech.jit.source_key import PACKAGE, source_hash, source_key

_SUFFIX = ".nbc"
_DIGEST = hashlib.sha256().digest_size
_LENGTH = 8  # bytes that hold the length of the key
# what a folder may hold [bytes]; beyond, the files that were used longest ago go
_LIMIT = 2 * 1024**3
_DAY = 86400.0


def record_types(numba_type: Any) -> Iterator[tuple[type, Any]]:
    """Find the record classes in a type, those inside others first."""
    for part in getattr(numba_type, "types", None) or ():
        yield from record_types(part)
    listed = getattr(numba_type, "item_type", None)
    if listed is not None:
        yield from record_types(listed)
    cls = getattr(numba_type, "instance_class", None)
    if cls is not None:
        yield cls, numba_type


def cache_folders() -> list[pathlib.Path]:
    """Return the folders in which compiled code is looked for; it is written to the first that takes it.

    `NUMBA_CACHE_DIR` where that is set, else beside the sources, then the user's cache folder.
    """
    if config.CACHE_DIR:
        return [pathlib.Path(config.CACHE_DIR, "packmech")]
    return [PACKAGE / "__pycache__" / "compiled", pathlib.Path(user_cache_dir("packmech", appauthor=False))]


def _tools() -> tuple[Any, ...]:
    """Return what compiles: versions, and settings of numba's that change the code."""
    return (
        sys.implementation.cache_tag,
        numba.__version__,
        llvmlite.__version__,
        np.__version__,
        config.OPT,
        config.BOUNDSCHECK,
        config.LOOP_VECTORIZE,
        config.SLP_VECTORIZE,
        config.USING_SVML,
    )


def _packed(key: bytes, payload: bytes) -> bytes:
    """Return the contents of a file."""
    body = len(key).to_bytes(_LENGTH, "big") + key + payload
    return hashlib.sha256(body).digest() + body


def _payload(content: bytes, key: bytes) -> memoryview | None:
    """Return the code in the contents of a file; None where they are damaged or another key's."""
    body = memoryview(content)[_DIGEST:]
    if hashlib.sha256(body).digest() != content[:_DIGEST] or body[_LENGTH : _LENGTH + len(key)] != key:
        return None
    if int.from_bytes(body[:_LENGTH], "big") != len(key):
        return None
    return body[_LENGTH + len(key) :]


def _write(path: pathlib.Path, content: bytes) -> None:
    """Write a file that others see whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}-{uuid.uuid4().hex}.tmp")
    try:
        partial.write_bytes(content)
        os.replace(partial, path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def _prune(folder: pathlib.Path, limit: int) -> None:
    """Delete what writers left behind and, of a folder above the limit, the files that were used longest ago."""
    now, files = time.time(), []
    for entry in os.scandir(folder):
        # another process may delete the same files
        with contextlib.suppress(OSError):
            found = entry.stat()
            if entry.name.endswith(".tmp"):
                if found.st_mtime < now - _DAY:
                    os.unlink(entry.path)
            elif entry.name.endswith(_SUFFIX):
                files.append((found.st_mtime, found.st_size, entry.path))
    total = sum(size for _, size, _ in files)
    if total > limit:
        for _, size, path in sorted(files):
            with contextlib.suppress(OSError):
                os.unlink(path)
            total -= size
            if total <= limit // 2:
                break


class _Process:
    """What this process has done once."""

    pruned = False
    warned = False


def _warn(error: Exception) -> None:
    if not _Process.warned:
        _Process.warned = True
        warnings.warn(
            f"compiled code could not be kept on disk ({type(error).__name__}: {error}), so that each new process will "
            "compile again; set NUMBA_CACHE_DIR to a folder that can be written",
            RuntimeWarning,
            stacklevel=2,
        )


class KernelCache(NullCache):  # type: ignore[misc]
    """The machine code of one function on disk, for numba's dispatchers to ask.

    Parameters
    ----------
    function
        A function of a module: of one made in another function, which may close over anything, no code is kept.
    options
        The options that it is compiled with.

    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._function = function
        self._options = sorted((name, sorted(v) if isinstance(v, set) else v) for name, v in options.items())

    @property
    def cache_path(self) -> str:
        """The first folder that is looked in."""
        return str(cache_folders()[0])

    def _kept(self, sig: Any) -> bool:
        """Whether the code may be on disk: not where it is unknown what a user's law computes with."""
        return all(source_key(cls) is not None for part in sig for cls, _ in record_types(part))

    def _key(self, sig: Any, codegen: Any) -> bytes | None:
        """Return all that the code depends on; None where that is unknown."""
        function, signature = self._function, str(sig)
        # a function passed as an argument shows as its address
        if "<locals>" in function.__qualname__ or " at 0x" in signature or not self._kept(sig):
            return None
        sources = source_hash(pathlib.Path(function.__code__.co_filename))
        if sources is None:
            return None
        classes = {cls for part in sig for cls, _ in record_types(part)}
        # The signature as text: a type that holds a user's law would be unpickled by importing the user's file, in
        # processes that know nothing of it and may not find it.
        parts = [
            f"{function.__module__}.{function.__qualname__}",
            hashlib.sha256(function.__code__.co_code).hexdigest(),
            signature,
            self._options,
            _tools(),
            codegen.magic_tuple(),
            sources,
            *sorted((cls.__module__, cls.__qualname__, source_key(cls)) for cls in classes),
        ]
        return "\n".join(str(part) for part in parts).encode()

    def _name(self, key: bytes) -> str:
        return f"{self._function.__module__}.{self._function.__name__}-{hashlib.sha256(key).hexdigest()[:40]}{_SUFFIX}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function for a signature; None where no file holds it whole."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        if key is None:
            return None
        for folder in cache_folders():
            path = folder / self._name(key)
            try:
                payload = _payload(path.read_bytes(), key)
                found = None if payload is None else CompileResult._rebuild(target_context, *pickle.loads(payload))
            except Exception:
                # whatever is wrong with a file: it is compiled again
                continue
            if found is None or str(tuple(found.signature.args)) != str(tuple(sig)):
                continue
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < time.time() - _DAY:
                    os.utime(path)
            if tuple(found.signature.args) == tuple(sig):
                return found
            # A record class of a script that was run directly comes back from disk as a copy of that class. The machine
            # code is the right one (the key says so), but filed under the copy's type the next call would not find it.
            found.fndesc.argtypes = tuple(sig)
            return found._replace(signature=signature(found.signature.return_type, *sig))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function, if it is known what it depends on."""
        key = self._key(sig, data.codegen)
        if key is None or data.library.has_dynamic_globals or any(not part.can_cache for part in data.lifted):
            return
        refused: Exception | None = None
        try:
            content = _packed(key, dumps(data._reduce()))
        except Exception as error:
            _warn(error)
            return
        for folder in cache_folders():
            try:
                _write(folder / self._name(key), content)
                if not _Process.pruned:
                    _Process.pruned = True
                    _prune(folder, _LIMIT)
            except OSError as error:
                refused = refused or error
            else:
                return
        if refused is not None:
            _warn(refused)
