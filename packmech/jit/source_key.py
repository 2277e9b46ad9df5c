"""What compiled code was made of, as text: the key under which it may be kept on disk.

Numba's own disk cache looks at the file of the outermost function only: after an edit in a called file it returns the
stale machine code. A hash of sources here holds all packmech files that a file imports, directly or not. Of a user's
class, which may stand in a script or at a prompt, the key holds the code and the values that it computes with.
"""

from __future__ import annotations

import builtins
import functools
import hashlib
import inspect
import os
import pathlib
import re
import time
import types
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

PACKAGE = pathlib.Path(__file__).parents[1]

# A file that was changed later may differ from the code that this process has imported.
_IMPORTED = time.time()
# modules whose contents do not change under a program
_SETTLED = ("math", "cmath", "numpy", "numba")

# import statements of packmech's, at the head of a file or in a function; to parse every file would take 0.1 s
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(packmech[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n(]+)|import[ \t]+(packmech[\w.]*))",
    re.MULTILINE,
)


# Text that no compiled code depends on. These expressions know packmech's files, not all of Python: a test compares
# them with a parser, which would take longer than all the rest of a warm start.
_DOCSTRING = re.compile(r'(\A|:(?:[ \t]+#[^\n]*)?\n)([ \t]*)r?"""(?:[^"\\]|\\.|"(?!""))*"""(?=[ \t]*\n)', re.DOTALL)
_COMMENT = re.compile(r"^[ \t]*(?:#[^\n]*)?\n", re.MULTILINE)
_TYPES_ONLY = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n)+", re.MULTILINE)


def code_of(text: str) -> str:
    """Return a source text without what no compiled code depends on: docstrings, comments, imports for types only."""
    return _TYPES_ONLY.sub("", _DOCSTRING.sub(r'\1\2""', _COMMENT.sub("", text)))


@functools.cache
def _text(path: pathlib.Path) -> str | None:
    """Return the code in a file; None where it cannot be read or has changed since packmech was imported."""
    try:
        text = path.read_text(encoding="utf-8")
        # after it was read: an edit in between is seen
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    changed = found.st_mtime if os.name == "nt" else found.st_ctime  # the other there tells when it was made
    return code_of(text) if changed <= _IMPORTED else None


def module_files(name: str) -> Iterator[pathlib.Path]:
    """Find the files of one of packmech's modules."""
    stem = PACKAGE.parent.joinpath(*name.split("."))
    for candidate in (stem.with_suffix(".py"), stem / "__init__.py"):
        if candidate.is_file():
            yield candidate


def imported_files(text: str) -> set[pathlib.Path]:
    """Return the packmech files that a source text names in an import statement."""
    found: set[pathlib.Path] = set()
    for module, listed, plain in _IMPORT.findall(text):
        names = [word.split()[0] for word in listed.strip("()").split(",") if word.strip()]
        for name in (plain, module, *(f"{module}.{one}" for one in names)):
            if name and name != "packmech" and name != "packmech.":
                found.update(module_files(name))
    return found


@functools.cache
def _hash_and_imports(path: pathlib.Path) -> tuple[str, frozenset[pathlib.Path]] | None:
    text = _text(path)
    if text is None:
        return None
    inside = PACKAGE in path.parents
    name = path.relative_to(PACKAGE).as_posix() if inside else path.name
    return f"{name} {hashlib.sha256(text.encode()).hexdigest()}", frozenset(imported_files(text))


@functools.cache
def source_hash(path: pathlib.Path) -> str | None:
    """Return a hash of a source file and of every packmech file that it imports, directly or not.

    It depends on what the files say, not on where they lie; None where one of them cannot be read or was changed after
    this process had imported packmech, so that its compiled code may be another's.

    Parameters
    ----------
    path
        The file to start from.

    """
    seen: dict[pathlib.Path, str] = {}
    queue = [path]
    while queue:
        current = queue.pop()
        if current not in seen:
            found = _hash_and_imports(current)
            if found is None:
                return None
            seen[current], imports = found
            queue.extend(imports)
    return hashlib.sha256("\n".join(sorted(seen.values())).encode()).hexdigest()


def written_name(made: Callable[..., Any]) -> str:
    """Return the name that the statement of a class or function gave, whatever it is called now."""
    return made.__qualname__.rpartition(".")[2]


class _UnknownMeaningError(Exception):
    """A value whose meaning no text says."""


@functools.cache
def source_key(cls: type) -> str | None:
    """Return a hash that changes whenever the methods of a record class compute something else; None if none can.

    Of a class of packmech's it is the hash of its sources. Of a user's it is made of the fields' names, of the class's
    public attributes that are numbers or text, of the code of the public methods and of the functions they call, and of
    the values that their free names stand for: numbers, text, tuples, and arrays to the last bit. A module of the
    user's or any other object has no such key.

    Examples
    --------
    >>> def law(factor):
    ...     return type("Law", (), {"__module__": "mine", "value": lambda self, x: factor * x})
    >>> source_key(law(2.0)) == source_key(law(2.0)), source_key(law(2.0)) == source_key(law(3.0))
    (True, False)

    """
    try:
        path = pathlib.Path(inspect.getsourcefile(cls) or "")
    except (OSError, TypeError):  # a class typed at the prompt has no file
        path = pathlib.Path()
    if PACKAGE in path.parents:
        return source_hash(path)
    parts = [repr(getattr(cls, "_fields", ()))]
    try:
        for name, value in sorted(vars(cls).items()):
            if inspect.isfunction(value) and not name.startswith("_"):
                parts += [name, *_function(value, set())]
            elif isinstance(value, bool | int | float | str) and not name.startswith("_"):
                # such as how many numbers an effect remembers of a pair
                parts += [name, repr(value)]
    except _UnknownMeaningError:
        return None
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def function_key(function: Any) -> str | None:
    """Return a hash that changes whenever a function, and those that it calls, compute something else.

    As `source_key`: of its code and the values that its free names stand for; None where one has no such text.

    Examples
    --------
    >>> def scaled(factor):
    ...     return lambda x: factor * x
    >>> function_key(scaled(2.0)) == function_key(scaled(2.0)), function_key(scaled(2.0)) == function_key(scaled(3.0))
    (True, False)

    """
    if not inspect.isfunction(function):
        return None
    try:
        return hashlib.sha256("\n".join(_function(function, set())).encode()).hexdigest()
    except _UnknownMeaningError:
        return None


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            yield from _codes(one)


def _function(function: Any, seen: set[int]) -> Iterator[str]:
    if id(function) in seen:
        return
    seen.add(id(function))
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    yield _value(
        (function.__defaults__, function.__kwdefaults__ and tuple(sorted(function.__kwdefaults__.items()))), seen
    )
    for name, cell in sorted(cells.items()):
        try:
            held = cell.cell_contents
        except ValueError:  # not bound yet
            raise _UnknownMeaningError from None
        yield f"{name} = {_value(held, seen)}"
    for code in _codes(function.__code__):
        consts = tuple(one for one in code.co_consts if not isinstance(one, types.CodeType))
        yield repr((code.co_code, code.co_names, code.co_varnames)) + _value(consts, seen)
        for name in sorted(code.co_names):
            if name in function.__globals__:
                yield f"{name} = {_value(function.__globals__[name], seen)}"


def _value(value: Any, seen: set[int]) -> str:
    if value is None or value is Ellipsis or isinstance(value, bool | int | float | complex | str | bytes):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, tuple | frozenset):
        items = value if isinstance(value, tuple) else sorted(value, key=repr)
        return f"{type(value).__qualname__}({', '.join(_value(one, seen) for one in items)})"
    if isinstance(value, np.generic | np.ndarray):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise _UnknownMeaningError
        return f"array {array.dtype.str} {array.shape} {array.tobytes().hex()}"
    if isinstance(value, types.ModuleType):
        if value.__name__.partition(".")[0] in (*_SETTLED, "packmech"):
            return f"module {value.__name__}"
        raise _UnknownMeaningError
    inner = getattr(value, "py_func", value)
    if inspect.isfunction(inner):
        return "; ".join(_function(inner, seen)) or "recursive"
    home = str(getattr(value, "__module__", "")).partition(".")[0]
    if isinstance(value, types.BuiltinFunctionType | np.ufunc) or home in _SETTLED:
        return f"{home}.{getattr(value, '__name__', '')}"
    if isinstance(value, type) and (getattr(builtins, value.__name__, None) is value or home == "packmech"):
        return f"type {value.__qualname__}"
    raise _UnknownMeaningError
