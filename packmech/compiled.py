"""Compiled functions, cached on disk under a key that sees every file they were made of.

Numba's own disk cache looks at the file of the outermost function only: after an edit in a called file it returns the
stale machine code. Here the key also holds a hash of all packmech files that the function's file imports, directly or
not, and of the files that define the record types in its signature (a user's own law, for instance).
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import itertools
import pathlib
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from numba import njit, typeof, types
from numba.core.caching import FunctionCache
from numba.core.errors import NumbaError
from numba.core.typing import signature
from numba.extending import overload, register_jitable

from packmech.meaning import meaning, written_name

F = TypeVar("F", bound=Callable[..., Any])

# contraction to fused multiply-add and no signed zeros; everything else stays IEEE, so infinities and NaN are seen
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}, "nogil": True}

_PACKAGE = pathlib.Path(__file__).parent


@functools.cache
def _file_hash(path: pathlib.Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return f"unreadable:{path.name}"


# import statements of packmech's, at the head of a file or in a function; to parse every file would take 0.1 s
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(packmech[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]+)|import[ \t]+(packmech[\w.]*))",
    re.MULTILINE,
)


def _module_files(name: str) -> Iterator[pathlib.Path]:
    stem = _PACKAGE.parent.joinpath(*name.split("."))
    for candidate in (stem.with_suffix(".py"), stem / "__init__.py"):
        if candidate.is_file():
            yield candidate


@functools.cache
def _imported_files(path: pathlib.Path) -> tuple[pathlib.Path, ...]:
    """Return the packmech files that this file names in an import statement."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ()
    if "packmech" not in text:
        return ()
    found: set[pathlib.Path] = set()
    for module, listed, plain in _IMPORT.findall(text):
        names = [word.split()[0] for word in listed.strip("()").split(",") if word.strip()]
        for name in (plain, module, *(f"{module}.{one}" for one in names)):
            if name and name != "packmech" and name != "packmech.":
                found.update(_module_files(name))
    return tuple(sorted(found))


@functools.cache
def source_hash(path: pathlib.Path) -> str:
    """Return a hash of a source file and of every packmech file that it imports, directly or not.

    Parameters
    ----------
    path
        The file to start from.

    """
    seen: set[pathlib.Path] = set()
    queue = [path]
    while queue:
        current = queue.pop()
        if current not in seen:
            seen.add(current)
            queue.extend(_imported_files(current))
    joined = "".join(_file_hash(p) for p in sorted(seen))
    return hashlib.sha256(joined.encode()).hexdigest()


def _record_types(numba_type: Any) -> Iterator[tuple[type, Any]]:
    """Find the record classes in a type, those inside others first."""
    for part in getattr(numba_type, "types", None) or ():
        yield from _record_types(part)
    listed = getattr(numba_type, "item_type", None)
    if listed is not None:
        yield from _record_types(listed)
    cls = getattr(numba_type, "instance_class", None)
    if cls is not None:
        yield cls, numba_type


def _record_classes(numba_type: Any) -> Iterator[type]:
    return (cls for cls, _ in _record_types(numba_type))


@functools.cache
def _class_hash(cls: type) -> str | None:
    path = None
    with contextlib.suppress(OSError, TypeError):  # a class typed at the prompt has no file
        path = pathlib.Path(inspect.getsourcefile(cls) or "")
    if path is not None and _PACKAGE in path.parents:
        return source_hash(path)
    told = meaning(cls)
    return None if told is None else hashlib.sha256(told.encode()).hexdigest()


def _equal(self: Any, other: object) -> bool:
    return bool(type(self) is type(other)) and tuple.__eq__(self, other)


def _different(self: Any, other: object) -> bool:
    return not _equal(self, other)


def _hash(self: Any) -> int:
    return hash((type(self), tuple.__hash__(self)))


def _repr(self: Any) -> str:
    fields = ", ".join(f"{name}={value!r}" for name, value in zip(self._fields, self, strict=True))
    return f"{written_name(type(self))}({fields})"


_TAKEN: set[str] = set()


def tell_apart(cls: Any) -> None:
    """Give a record class a `__name__` of its own (`__qualname__` stays as written) and make its records no others'.

    Numba looks up compiled code by the name of a record's class and by its fields' names. A law that is defined again
    under the same name, as happens at a prompt, would silently get the code of the law before it. And named tuples of
    two classes count as equal where their numbers are.
    """
    if vars(cls).get("__eq__") is _equal:
        return
    cls.__eq__, cls.__ne__, cls.__hash__, cls.__repr__ = _equal, _different, _hash, _repr
    names = itertools.chain([written_name(cls)], (f"{written_name(cls)}_{n}" for n in itertools.count(2)))
    cls.__name__ = next(name for name in names if name not in _TAKEN)
    _TAKEN.add(cls.__name__)


_METHODS: dict[type, tuple[str, dict[str, Callable[..., Any]]]] = {}


def compiled_methods(what: str, cls: type, methods: dict[str, Callable[..., Any]]) -> dict[str, Callable[..., Any]]:
    """Return the methods of a record class for compiled code to call; one that does not compile will be named."""
    _METHODS[cls] = what, methods
    return {name: device(method) for name, method in methods.items()}


def own_name(what: str, cls: type, known: Iterable[type]) -> None:
    """Refuse a user's class under the name of one that ships: files name laws and effects by their class names."""
    shipped = {written_name(one) for one in known if one.__module__.startswith("packmech.") and one is not cls}
    if written_name(cls) in shipped and not cls.__module__.startswith("packmech."):
        raise ValueError(f"{what} must have a name that none of packmech's has, got {written_name(cls)}")


class _SourceCache(FunctionCache):  # type: ignore[misc]
    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        path = pathlib.Path(inspect.getsourcefile(self._py_func) or "")
        classes = {cls for part in sig for cls in _record_classes(part)}
        named = sorted((cls.__module__, cls.__qualname__, _class_hash(cls) or "") for cls in classes)
        # The signature as text: numba unpickles the whole index to find one entry, and a type that holds a user's law
        # would do so by importing the user's file, in processes that know nothing of it and may not find it.
        return (str(sig), *super()._index_key(sig, codegen)[1:], source_hash(path), *named)

    def _kept(self, sig: Any) -> bool:
        """Whether the code may be on disk: not where it is unknown what a user's law computes with."""
        return all(_class_hash(cls) is not None for part in sig for cls in _record_classes(part))

    def save_overload(self, sig: Any, data: Any) -> None:
        if self._kept(sig):
            super().save_overload(sig, data)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if not self._kept(sig):
            return None
        found = super().load_overload(sig, target_context)
        if found is None or tuple(found.signature.args) == tuple(sig):
            return found
        # A record class of a script that was run directly comes back from disk as a copy of that class. The machine
        # code is the right one (the key says so), but filed under the copy's type the next call would not find it.
        found.fndesc.argtypes = tuple(sig)
        return found._replace(signature=signature(found.signature.return_type, *sig))


def _reason(error: NumbaError) -> str:
    """Return the first line of numba's message that says more than that it failed."""
    lines = [line.strip() for line in str(error).splitlines()]
    lines = [line for line in lines if line and not line.startswith("Failed in")]
    return " ".join(lines[:2] if lines and lines[0].endswith(":") else lines[:1]) or type(error).__name__


def _refusal(classes: dict[type, Any]) -> TypeError | None:
    """Return the error that names the first method of these record classes that compiled code cannot use."""
    for cls, numba_type in classes.items():
        what, methods = _METHODS.get(cls, ("", {}))
        for name, method in methods.items():
            told = f"{what} {written_name(cls)}.{name} must"
            dispatcher = njit(**OPTIONS)(method)
            numbers = [types.float64] * (len(inspect.signature(method).parameters) - 1)
            try:
                dispatcher.compile((numba_type, *numbers))
            except NumbaError as error:
                refusal = TypeError(f"{told} compile: {_reason(error)}")
                refusal.__cause__ = error
                return refusal
            given = dispatcher.nopython_signatures[0].return_type
            if not isinstance(given, types.Integer | types.Float | types.Boolean):
                return TypeError(f"{told} return a number, got {given} when compiled")
    return None


def _naming_refusals(compile_for: Callable[..., Any]) -> Callable[..., Any]:
    """Return numba's entry to compilation, but a user's method that does not compile is named in one line."""

    def compile_or_name(*arguments: Any, **named: Any) -> Any:
        try:
            return compile_for(*arguments, **named)
        except NumbaError as error:
            original = error
        found = [typeof(part) for part in arguments]
        refusal = _refusal({cls: part for whole in found for cls, part in _record_types(whole)})
        if refusal is None:
            raise original
        raise refusal from refusal.__cause__ or original

    return compile_or_name


def kernel(function: Callable[..., Any]) -> Any:
    """Return the function compiled by numba on first use, its machine code cached on disk.

    The cache lies beside the source file, or in the user's cache folder where that is read-only. Module-level functions
    only: one that closes over another compiled function would never be found in the cache again.
    """
    dispatcher = njit(**OPTIONS)(function)
    dispatcher._cache = _SourceCache(function)
    dispatcher._compile_for_args = _naming_refusals(dispatcher._compile_for_args)
    return dispatcher


def device(function: F) -> F:
    """Return a helper that kernels may call and that plain Python may call too."""
    return register_jitable(**OPTIONS)(function)  # type: ignore[no-any-return]


def compiled_form(target: Callable[..., Any]) -> Callable[[F], F]:
    """Return a decorator for a function that picks, by argument types, what compiled code runs for the target."""

    def register(chooser: F) -> F:
        overload(target, jit_options=OPTIONS, strict=False)(chooser)
        return chooser

    return register


@contextlib.contextmanager
def compile_clock() -> Iterator[Callable[[], float]]:
    """Give a function that tells how many seconds of the time since were spent compiling [s]; 0 with a warm cache."""
    from numba.core import event

    clock = event.TimingListener()
    with event.install_listener("numba:compile", clock):
        yield lambda: float(clock.duration) if clock.done else 0.0


def compiling_noted(note: str, compiling: float, seconds: float) -> str:
    """Return a stage's note, and how much of its time was compiling where that was a good part of it.

    Examples
    --------
    >>> compiling_noted("", 1.2, 1.3), compiling_noted("found", 1.2, 1.3), compiling_noted("found", 0.1, 1.3)
    ('1.2 s of it compiling, once for all runs', 'found; 1.2 s of it compiling, once for all runs', 'found')

    """
    if compiling <= 0.1 * seconds:
        return note
    return "; ".join(filter(None, [note, f"{compiling:.1f} s of it compiling, once for all runs"]))


def single_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS uses one thread, so that sums have the same bits on every machine.

    Examples
    --------
    >>> import numpy as np
    >>> with single_thread():
    ...     total = float(np.ones(4) @ np.ones(4))
    >>> total
    4.0

    """
    # finding the libraries takes a millisecond; only an import can add one
    return _libraries(len(sys.modules)).limit(limits=1)  # type: ignore[no-any-return]


@functools.lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
