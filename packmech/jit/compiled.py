"""Compiled functions: what numba makes of ours and of users' records, with errors that name the user's method."""

from __future__ import annotations

import contextlib
import functools
import inspect
import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from numba import njit, typeof, types
from numba.core import event
from numba.core.errors import NumbaError
from numba.extending import overload, register_jitable

from packmech.check import boolean, brief
from packmech.jit.cache import KernelCache, record_types
from packmech.jit.compiling import COMPILING, CompileListener
from packmech.jit.source_key import written_name

F = TypeVar("F", bound=Callable[..., Any])

# contraction to fused multiply-add and no signed zeros; everything else stays IEEE, so infinities and NaN are seen
OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "nsz"},
    "nogil": True,
    "no_cfunc_wrapper": True,
}
# of what only compiled code calls: to unpack arguments that come from Python has to be compiled as well
_INNER = {**OPTIONS, "no_cpython_wrapper": True}

event.register("numba:compile", CompileListener())
event.register("numba:compile", COMPILING)


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


# of record classes: what one is in messages, its methods, and examples of what these take that is no number
_METHODS: dict[type, tuple[str, dict[str, Callable[..., Any]], dict[str, tuple[Any, ...]]]] = {}


def compiled_methods(
    what: str, cls: type, methods: dict[str, Callable[..., Any]], records: dict[str, tuple[Any, ...]] | None = None
) -> dict[str, Callable[..., Any]]:
    """Return the methods of a record class for compiled code to call; one that does not compile will be named.

    Parameters
    ----------
    what
        What the class is, in messages.
    cls, methods
        The class, and its methods by name.
    records
        By names of methods that take records, not numbers: an example of each argument after self.

    """
    _METHODS[cls] = what, methods, records or {}
    return {name: device(method) for name, method in methods.items()}


def own_name(what: str, cls: type, known: Iterable[type]) -> None:
    """Refuse a user's class under the name of one that ships: files name laws and effects by their class names."""
    shipped = {written_name(one) for one in known if one.__module__.startswith("packmech.") and one is not cls}
    if written_name(cls) in shipped and not cls.__module__.startswith("packmech."):
        raise ValueError(f"{what} must have a name that none of packmech's has, got {written_name(cls)}")


def _reason(error: NumbaError) -> str:
    """Return the first line of numba's message that says more than that it failed."""
    lines = [line.strip() for line in str(error).splitlines()]
    lines = [line for line in lines if line and not line.startswith("Failed in")]
    return " ".join(lines[:2] if lines and lines[0].endswith(":") else lines[:1]) or type(error).__name__


def _argument_types(cls: type, name: str) -> list[Any]:
    """Return numba's types of what compiled code gives to a method of a class after self."""
    _, methods, records = _METHODS[cls]
    count = len(inspect.signature(methods[name]).parameters) - 1
    return [typeof(one) for one in records[name]] if name in records else [types.float64] * count


def _refusal(classes: dict[type, Any]) -> TypeError | None:
    """Return the error that names the first method of these record classes that compiled code cannot use."""
    for cls, numba_type in classes.items():
        what, methods, _ = _METHODS.get(cls, ("", {}, {}))
        for name, method in methods.items():
            rule = f"{what} {written_name(cls)}.{name} must"
            dispatcher = njit(**OPTIONS)(method)
            try:
                dispatcher.compile((numba_type, *_argument_types(cls, name)))
            except NumbaError as error:
                refusal = TypeError(f"{rule} compile: {_reason(error)}")
                refusal.__cause__ = error
                return refusal
            given = dispatcher.nopython_signatures[0].return_type
            if not isinstance(given, types.Integer | types.Float | types.Boolean):
                return TypeError(f"{rule} return a number, got {given} when compiled")
    return None


def makes_arrays(laws: Any) -> bool:
    """Return whether a user's record among numba's types of what acts has a method that needs references counted."""
    for cls, numba_type in record_types(laws):
        if cls.__module__.startswith("packmech."):
            continue
        for name, method in _METHODS.get(cls, ("", {}, {}))[1].items():
            # tried out with references counted: numba would remember for good what failed without
            tried = njit(**OPTIONS)(method)
            try:
                tried.compile((numba_type, *_argument_types(cls, name)))
            except NumbaError:
                return True
            named = next(iter(tried.overloads.values())).type_annotation.typemap.values()
            if any(isinstance(one, types.Array) for one in named):
                return True
    return False


def _called_from_python(dispatcher: Any) -> Any:
    """Return numba's compiled form of a function, but a user's method that does not compile is named in one line."""
    compile_for = dispatcher._compile_for_args

    def compile_or_name(*arguments: Any, **named: Any) -> Any:
        try:
            return compile_for(*arguments, **named)
        except NumbaError as error:
            original = error
        found = [typeof(part) for part in arguments]
        refusal = _refusal({cls: part for whole in found for cls, part in record_types(whole)})
        if refusal is None:
            raise original
        raise refusal from refusal.__cause__ or original

    dispatcher._compile_for_args = compile_or_name
    return dispatcher


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return numba's compiled form of a function of ours, its machine code kept on disk."""
    # numba takes what is not said here from the first caller: code on disk would then depend on who that was
    options = {"_nrt": True, "forceinline": False, **options}
    dispatcher = njit(**options)(function)
    dispatcher._cache = KernelCache(function, options)
    return dispatcher


def _lean_dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return the same without counts of references; with them where a user's law among the arguments makes arrays."""
    dispatcher = _dispatcher(function, {**options, "_nrt": False})
    counting, compile_lean = _dispatcher(function, options)._compiler, dispatcher._compiler.compile

    def compile_either(arguments: Any, return_type: Any) -> Any:
        chosen = counting.compile if any(map(makes_arrays, arguments)) else compile_lean
        return chosen(arguments, return_type)

    dispatcher._compiler.compile = compile_either
    return dispatcher


def kernel(function: Callable[..., Any], *, contract: bool = True) -> Any:
    """Return the function compiled by numba on first use, its machine code cached on disk.

    The code of module-level functions only is kept. What a function outside packmech calls must stand in its own file
    or in packmech.

    Parameters
    ----------
    function
        What numba can compile, without arguments by keyword.
    contract
        Whether a product and a sum may be rounded once, together, and zeros may lose their sign; otherwise numbers are
        those of plain Python. Division by zero gives infinity or nan, never an error.

    Raises
    ------
    TypeError
        If it is no Python function, or `contract` is not True or False.

    Examples
    --------
    >>> def half(number):
    ...     return 0.5 * number
    >>> kernel(half)(3.0)
    1.5

    """
    if not inspect.isfunction(function):
        raise TypeError(f"function must be a Python function, got {brief(function)}")
    boolean("contract", contract)
    return _called_from_python(_dispatcher(function, OPTIONS if contract else {**OPTIONS, "fastmath": False}))


class _InnerKernel:
    """What stands for a kernel without an entry from Python; numba reads the type where another kernel names it."""

    def __init__(self, function: Callable[..., Any], dispatcher: Any) -> None:
        functools.update_wrapper(self, function)
        # the type refers to it weakly
        self._function, self._dispatcher = function, dispatcher
        self._numba_type_ = types.Dispatcher(dispatcher)

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Return a kernel for other kernels to call, its machine code cached on disk; plain Python runs it uncompiled.

    To unpack records of many arrays that come from Python takes up to a second to compile; and helpers that are called
    from here and from other helpers are compiled once, while those that a `kernel` calls are compiled again for it.
    """
    return _InnerKernel(function, _dispatcher(function, _INNER))


def lean(function: Callable[..., Any]) -> Any:
    """Return a kernel that counts no references to arrays: every part of a record would be counted in every step.

    It must not make arrays and no helper that it calls may return one, not even one that it was given: helpers are
    compiled once, and a caller that does count would count it wrongly. Where an argument brings a user's law that makes
    arrays, references are counted. Kernels that count may call it too.
    """
    return _called_from_python(_lean_dispatcher(function, OPTIONS))


def inner_lean(function: Callable[..., Any]) -> Any:
    """Return a `lean` kernel for other kernels to call, as `inner_kernel` does.

    A helper that kernels that count and kernels that do not call is compiled for each of both; this is compiled once.
    """
    return _InnerKernel(function, _lean_dispatcher(function, _INNER))


def device(function: F) -> F:
    """Return a helper that kernels may call and that plain Python may call too."""
    return register_jitable(**_INNER)(function)  # type: ignore[no-any-return]


def compiled_form(target: Callable[..., Any], *, inline: bool = False) -> Callable[[F], F]:
    """Return a decorator for a function that picks, by argument types, what compiled code runs for the target.

    Written into its callers, as `inlined` does, where that is asked for.
    """
    options = {**_INNER, "forceinline": True} if inline else _INNER

    def register(chooser: F) -> F:
        overload(target, jit_options=options, strict=False)(chooser)
        return chooser

    return register


def inlined(function: F) -> F:
    """Return a helper as `device` does, written into its callers however long it is.

    A call that passes all that a contact needs costs as much as the contact.
    """
    return register_jitable(**_INNER, forceinline=True)(function)  # type: ignore[no-any-return]


@contextlib.contextmanager
def compile_clock() -> Iterator[Callable[[], float]]:
    """Give a function that tells how many CPU seconds since were spent compiling [s]; 0 with a warm cache."""
    began = COMPILING.seconds
    yield lambda: COMPILING.seconds - began


def working_time() -> float:
    """Return the CPU time of this process that did not go into compiling: the clock of time limits [s]."""
    return time.process_time() - COMPILING.seconds


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
