"""What a user's class computes with, as text: the key under which its machine code may be kept on disk."""

from __future__ import annotations

import builtins
import inspect
import types
from collections.abc import Iterator
from typing import Any

import numpy as np

# modules whose contents do not change under a program
_SETTLED = ("math", "cmath", "numpy", "numba")


def written_name(cls: type) -> str:
    """Return the name that the class statement gave, whatever the class is called now."""
    return cls.__qualname__.rpartition(".")[2]


class _Unknown(Exception):  # noqa: N818 - internal: a value whose meaning cannot be told
    pass


def meaning(cls: type) -> str | None:
    """Return a text that changes whenever the methods of the class compute something else; None if none can be told.

    It holds the code of the public methods and of the functions they call, and the values that their free names stand
    for: numbers, text, tuples, and arrays to the last bit. A module of the user's or any other object has no such text.

    Examples
    --------
    >>> class Doubled:
    ...     def value(self, x):
    ...         return 2.0 * x
    >>> meaning(Doubled) == meaning(Doubled)
    True

    """
    parts: list[str] = []
    try:
        for name, value in sorted(vars(cls).items()):
            if inspect.isfunction(value) and not name.startswith("_"):
                parts += [name, *_function(value, set())]
    except _Unknown:
        return None
    return "\n".join(parts)


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
            raise _Unknown from None
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
            raise _Unknown
        return f"array {array.dtype.str} {array.shape} {array.tobytes().hex()}"
    if isinstance(value, types.ModuleType):
        if value.__name__.partition(".")[0] in _SETTLED:
            return f"module {value.__name__}"
        raise _Unknown
    inner = getattr(value, "py_func", value)
    if inspect.isfunction(inner):
        return "; ".join(_function(inner, seen)) or "recursive"
    home = str(getattr(value, "__module__", "")).partition(".")[0]
    if isinstance(value, types.BuiltinFunctionType | np.ufunc) or home in _SETTLED:
        return f"{home}.{getattr(value, '__name__', '')}"
    if isinstance(value, type) and (getattr(builtins, value.__name__, None) is value or home == "packmech"):
        return f"type {value.__qualname__}"
    raise _Unknown
