"""Checks at the edge, with one message format: argument, what is required, what was given, where."""

from __future__ import annotations

import difflib
import functools
import inspect
import math
import operator
import os
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

# what the box may do, and what second derivatives hold of the forces: the words of all calls
BoxStrain = Literal["none", "isotropic", "isochoric", "free"]
Kind = Literal["exact", "paper", "unstressed"]
STRAINS: tuple[BoxStrain, ...] = get_args(BoxStrain)
KINDS: tuple[Kind, ...] = get_args(Kind)
# what contacts at the Coulomb limit do under a small motion
AtLimit = Literal["stick", "slip"]
AT_LIMIT: tuple[AtLimit, ...] = get_args(AtLimit)
_LARGEST = 2**63 - 1
LARGEST_FLOAT = sys.float_info.max
# bytes that a particle takes at least while something is done with it: coordinates, radii, its share of a pair list
PARTICLE_BYTES = 200.0
# bytes that a frame takes at least: its time, strain and place in a list
FRAME_BYTES = 24.0
# steps of time that take months, however few the particles
MOST_STEPS = 1e13
Word = TypeVar("Word", bound=str)
P = ParamSpec("P")
R = TypeVar("R")


def _shape_text(shape: Sequence[int | None]) -> str:
    return "(" + ", ".join("any" if size is None else str(size) for size in shape) + ")"


def _first_bad(bad: NDArray[np.bool_], what: str) -> tuple[tuple[int, ...], str]:
    index = tuple(int(k) for k in np.argwhere(bad)[0])
    return index, f" for {what} {index[0]}" if index and what else ""


def finite_array(
    name: str, value: ArrayLike, *, shape: Sequence[int | None], what: str = "particle", empty: bool = False
) -> NDArray[np.float64]:
    """Return the value as a new C-contiguous float64 array after checking shape and finiteness.

    Parameters
    ----------
    name
        The argument's name, for the message.
    value
        Anything that numpy can turn into numbers.
    shape
        The required shape; None stands for any size.
    what
        What the first axis counts, for the message.
    empty
        Whether a first axis of length zero is allowed.

    Raises
    ------
    TypeError
        If the value is not made of real numbers.
    ValueError
        If the shape is wrong or an entry is not finite.

    """
    array = np.array(entries(name, value, "biuf", "real numbers"), dtype=np.float64, order="C")
    if array.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, array.shape, strict=True)
    ):
        raise ValueError(f"{name} must have shape {_shape_text(shape)}, got {array.shape}")
    if not empty and array.ndim and array.shape[0] == 0:
        raise ValueError(f"{name} must hold at least one {what}, got none")
    bad = ~np.isfinite(array)
    if bad.any():
        index, where = _first_bad(bad, what)
        raise ValueError(f"{name} must be finite, got {array[index]}{where}")
    return array


def entries(name: str, value: ArrayLike, kinds: str, words: str) -> NDArray[Any]:
    """Return a value as an array of one of the kinds of numpy's dtypes, or without entries; TypeError otherwise."""
    try:
        array = np.asarray(value)
        known = array.dtype.kind in kinds or not array.size
        hidden = np.ma.is_masked(value)
    # whatever an object raises that is asked for its entries, it has none that are numbers
    except Exception:
        known = hidden = False
    if not known:
        raise TypeError(f"{name} must be an array of {words}, got {brief(value)}") from None
    if hidden:
        raise TypeError(f"{name} must be an array of {words}, got a masked array that hides some of them")
    return array


def given_shape(value: Any) -> tuple[int, ...]:
    """Return the shape that numpy finds in a value; () where it finds none."""
    try:
        return np.shape(value)
    except Exception:
        return ()


def positive_array(
    name: str, value: ArrayLike, *, shape: Sequence[int | None], what: str = "particle", empty: bool = False
) -> NDArray[np.float64]:
    """Return the value as a float64 array after checking that every entry is finite and above zero."""
    array = finite_array(name, value, shape=shape, what=what, empty=empty)
    bad = array <= 0.0
    if bad.any():
        index, where = _first_bad(bad, what)
        raise ValueError(f"{name} must be positive, got {array[index]}{where}")
    return array


def integer_array(
    name: str, value: ArrayLike, *, shape: Sequence[int | None], what: str = "particle"
) -> NDArray[np.int64]:
    """Return the value as a new int64 array after checking that it holds whole numbers in the required shape."""
    given = entries(name, value, "iu", "integers")
    finite_array(name, given, shape=shape, what=what, empty=True)
    bad = given > _LARGEST if given.dtype.kind == "u" else np.zeros(given.shape, dtype=bool)
    if bad.any():
        index, where = _first_bad(bad, what)
        raise ValueError(f"{name} must be below 2^63, got {given[index]}{where}")
    return given.astype(np.int64)


def particle_mask(name: str, value: Any, particles: int) -> NDArray[np.bool_]:
    """Return True or False for each particle, as it is given; TypeError or ValueError otherwise."""
    mask = entries(name, value, "b", "booleans")
    if mask.dtype != bool:
        raise TypeError(f"{name} must be True or False for each particle, got {brief(value)}")
    if mask.shape != (particles,):
        raise ValueError(f"{name} must have shape ({particles},), got {mask.shape}")
    return mask


def chosen_rows(name: str, value: Any, rows: int) -> NDArray[np.bool_] | NDArray[np.int64]:
    """Return a mask of so many rows, or numbers of some of them, after checking that there are such rows.

    Examples
    --------
    >>> chosen_rows("keep_c", [0, -1], 3).tolist()
    [0, -1]
    >>> chosen_rows("keep_c", [3], 3)
    Traceback (most recent call last):
    ...
    ValueError: keep_c must be numbers of 3 rows, got 3

    """
    chosen = entries(name, value, "biu", "booleans or integers")
    if chosen.ndim != 1 or (chosen.dtype == bool and len(chosen) != rows):
        raise ValueError(f"{name} must be a mask of shape ({rows},) or a list of numbers, got shape {chosen.shape}")
    if chosen.dtype == bool:
        return chosen
    bad = (chosen >= rows) | (chosen < -rows)
    if bad.any():
        raise ValueError(f"{name} must be numbers of {rows} rows, got {chosen[bad][0]}")
    return chosen.astype(np.int64, copy=False)


def brief(value: object) -> str:
    """Return a value in one short line, for messages."""
    try:
        # what is cut anyway is not written
        text = repr(value[:99] if isinstance(value, str | bytes) else value)
    except Exception as error:
        text = f"a {type(value).__name__} that cannot be shown ({type(error).__name__})"
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def real(
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    below: float = math.inf,
    at_most: float = math.inf,
    infinite: bool = False,
) -> float:
    """Return the value as a float inside the stated bounds (above and below are strict), finite unless said."""
    required = [
        f"{word} {bound:g}"
        for word, bound in (("above", above), ("at least", at_least), ("below", below), ("at most", at_most))
        if math.isfinite(bound)
    ]
    kind = "a number, perhaps infinite," if infinite and required else "a number" if infinite else "a finite number"
    text = " ".join([kind, " and ".join(required)]).strip()
    if isinstance(value, bool | np.bool_ | str | bytes):
        raise TypeError(f"{name} must be {text}, got {brief(value)}")
    try:
        if not isinstance(value, int | float) and (np.ndim(value) or np.ma.is_masked(value)):
            raise TypeError
        number = float(value)
    except OverflowError:
        raise ValueError(f"{name} must be {text}, got {brief(value)}, which no float64 holds") from None
    except Exception:
        raise TypeError(f"{name} must be {text}, got {brief(value)}") from None
    known = not math.isnan(number) if infinite else math.isfinite(number)
    low = number < at_least or (number <= above and above > -math.inf)
    high = number > at_most or (number >= below and below < math.inf)
    if not known or low or high:
        raise ValueError(f"{name} must be {text}, got {brief(value)}")
    return number


def boolean(name: str, value: Any) -> bool:
    """Return True or False, as it is given; TypeError for anything else."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {brief(value)}")
    return bool(value)


def positive(name: str, value: Any) -> float:
    """Return the value as a finite float above zero."""
    return real(name, value, above=0.0)


def integer(
    name: str, value: Any, *, at_least: int | None = None, at_most: int | None = None, bytes_each: float = 0.0
) -> int:
    """Return the value as an int inside the stated bounds; where each takes memory, as many as memory holds."""
    bounds = [f"at least {at_least}"] * (at_least is not None) + [f"at most {at_most}"] * (at_most is not None)
    text = " ".join(["an integer", " and ".join(bounds)]).strip()
    if isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be {text}, got {brief(value)}")
    try:
        number = operator.index(value)
    except Exception:
        raise TypeError(f"{name} must be {text}, got {brief(value)}") from None
    if (at_least is not None and number < at_least) or (at_most is not None and number > at_most):
        raise ValueError(f"{name} must be {text}, got {brief(number)}")
    if abs(number) > _LARGEST:
        raise ValueError(f"{name} must be {text} below 2^63 in size, got {brief(number)}")
    check_memory(name, number * bytes_each)
    return number


def check_memory(name: str, bytes_needed: float) -> None:
    """Refuse what would not fit into the machine's memory, before any of it is taken.

    Parameters
    ----------
    name
        The argument that asks for it, or the file, for the message.
    bytes_needed
        The bytes that would have to be held at once, by the sizes of the largest arrays.

    Raises
    ------
    ValueError
        Naming the argument, the memory that it asks for and what there is.

    Examples
    --------
    >>> check_memory("particles", 8e17)
    Traceback (most recent call last):
    ...
    ValueError: particles must be so small that memory holds it, got what takes 800 PB, more than ...

    """
    if bytes_needed > _memory():
        raise ValueError(
            f"{name} must be so small that memory holds it, got what takes {_size(bytes_needed)}, more than the "
            f"{_size(_memory())} that this process may have"
        )


def check_steps(name: str, duration: float, dt: float) -> None:
    """Refuse a duration that takes more steps of time than anybody waits for.

    Examples
    --------
    >>> check_steps("applied_strain / rate", 1e300, 0.1)
    Traceback (most recent call last):
    ...
    ValueError: applied_strain / rate must be at most 1e+13 steps of 0.1, got 1e+300

    """
    if not duration / dt <= MOST_STEPS:
        raise ValueError(f"{name} must be at most {MOST_STEPS:.0e} steps of {dt:g}, got {duration:g}")


def _memory() -> float:
    """Return the bytes of memory that this process may have; infinity where the system does not say."""
    try:
        # not on every system
        import resource

        whole, limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), resource.getrlimit(resource.RLIMIT_AS)
    except (AttributeError, ImportError, OSError, ValueError):
        return math.inf
    return float(whole if limit[0] == resource.RLIM_INFINITY else min(whole, limit[0]))


def _size(number: float) -> str:
    if math.isinf(number):
        return "more than can be counted"
    steps = min(max(int(math.log10(max(number, 1.0))) // 3, 0), len(_UNITS) - 1)
    return f"{number / 1000.0**steps:.3g} {_UNITS[steps]}"


_UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


def two_axes(name: str, value: Any, *, dimension: int = 3, different: bool = True) -> tuple[int, int]:
    """Return the two axes of a strain after checking that the box has them, and that they differ where they must."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise TypeError(f"{name} must be two axes, got {brief(value)}")
    first, second = (integer(name, axis, at_least=0, at_most=dimension - 1) for axis in value)
    if different and first == second:
        raise ValueError(f"{name} must be two different axes, got {value}")
    return first, second


def one_of(name: str, value: Any, choices: Collection[Word]) -> Word:
    """Return the value after checking that it is one of the named choices."""
    for choice in choices:
        if isinstance(value, str) and value == choice:
            return choice
    listed = ", ".join(repr(choice) for choice in choices)
    raise ValueError(f"{name} must be one of {listed}, got {brief(value)}{did_you_mean(value, choices)}")


# letters of the field for names that packmech spells out
_LETTERS = {
    "z": "coordination_number",
    "dz": "excess_coordination",
    "delta_z": "excess_coordination",
    "phi": "packing_fraction",
    "phi_j": "jamming_packing_fraction",
    "phij": "jamming_packing_fraction",
    "p": "pressure",
    "k": "bulk_modulus",
    "b": "bulk_modulus",
    "g": "shear_modulus",
    "mu": "friction",
    "n": "particles",
    "d": "dimension",
}


def did_you_mean(value: Any, choices: Iterable[str]) -> str:
    """Return the end of a message that names the choice nearest in spelling; empty where none is near.

    The field's letter for a choice, such as z or phi_J, is near it, too.

    Examples
    --------
    >>> did_you_mean("hertzian", ("harmonic", "hertz")), did_you_mean("z", ("coordination_number", "pressure"))
    ("; did you mean 'hertz'?", "; did you mean 'coordination_number'?")

    """
    by_lower = {choice.lower(): choice for choice in choices}
    # no name is as long as this, and distances of long texts take long
    if not isinstance(value, str) or len(value) > 200:
        return ""
    letter = _LETTERS.get(value.lower())
    if letter in by_lower:
        return f"; did you mean {by_lower[letter]!r}?"
    near = difflib.get_close_matches(value.lower(), by_lower, 1)
    return f"; did you mean {by_lower[near[0]]!r}?" if near else ""


def instance(name: str, value: Any, kind: type, article: str = "a") -> None:
    """Check that the value is of the given class.

    Raises
    ------
    TypeError
        Naming the argument, the class and what was given.

    """
    if not isinstance(value, kind):
        # a class may say what makes one of another
        way = getattr(kind, "MADE_OF", {}).get(type(value).__name__)
        raise TypeError(
            f"{name} must be {article} {kind.__name__}, got {brief(value)}{f': {way} makes one of it' if way else ''}"
        )


def function(name: str, value: Any) -> None:
    """Check that the value can be called.

    Raises
    ------
    TypeError
        Naming the argument and what was given.

    """
    if not callable(value):
        raise TypeError(f"{name} must be a function, got {brief(value)}")


def listed(name: str, value: Any, what: str) -> list[Any]:
    """Return the entries of a sequence after checking that it is one, and no text; `what` it holds, for the message."""
    try:
        if isinstance(value, str | bytes) or not isinstance(value, Iterable):
            raise TypeError
        return list(value)
    except Exception:
        raise TypeError(f"{name} must be a sequence of {what}, got {brief(value)}") from None


def bin_edges(name: str, value: Any) -> int | NDArray[np.float64]:
    """Return how many bins of equal width there are to be, or their edges after checking that they increase."""
    if isinstance(value, int | np.integer):
        return integer(name, value, at_least=1, bytes_each=32.0)
    edge = finite_array(name, value, shape=(None,), what="edge")
    if len(edge) < 2 or (np.diff(edge) <= 0.0).any():
        raise ValueError(f"{name} must be a number or at least two increasing edges, got {brief(edge.tolist())}")
    return edge


def table(name: str, value: Any) -> None:
    """Check that the value is a mapping from names.

    Raises
    ------
    TypeError
        Naming the argument and what was given.

    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise TypeError(f"{name} must be a mapping from names, got {brief(value)}")


def warn(message: str) -> None:
    """Give a UserWarning at the line that called packmech."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "packmech":
        frame, level = frame.f_back, level + 1
    warnings.warn(message, stacklevel=level)


def clear_errors(call: Callable[P, R]) -> Callable[P, R]:
    """Return a public function whose errors of arguments name the one that was probably meant (`call_fault`)."""

    @functools.wraps(call)
    def wrapped(*given: P.args, **named: P.kwargs) -> R:
        try:
            return call(*given, **named)
        except TypeError:
            fault = call_fault(call, given, named)
            if fault:
                raise TypeError(fault) from None
            raise

    return wrapped


def clear_fields(kind: type) -> None:
    """Have a class say at a wrong field, too, which one was probably meant, as `clear_errors` has a function do it."""
    maker = "__new__" if hasattr(kind, "_fields") else "__init__"
    make: Any = getattr(kind, maker)
    if maker not in kind.__dict__ or not inspect.isfunction(make) or hasattr(make, "__wrapped__"):
        return

    @functools.wraps(make)
    def wrapped(*given: Any, **named: Any) -> Any:
        try:
            return make(*given, **named)
        except TypeError:
            fault = call_fault(kind, given[1:], named)
            if fault:
                raise TypeError(fault) from None
            raise

    setattr(kind, maker, staticmethod(wrapped) if maker == "__new__" else wrapped)


def call_fault(call: Callable[..., Any], given: Sequence[Any], named: Mapping[str, Any]) -> str:
    """Return what is wrong with the arguments of a call, by their names; empty where it can be made.

    Examples
    --------
    >>> def shear(scene, *, rate, periods=3): ...
    >>> call_fault(shear, (1,), {"rat": 0.1})
    "shear() has no argument 'rat'; did you mean 'rate'?"
    >>> call_fault(shear, (1, 0.1), {})
    'shear() takes scene by place, and the others by name: rate=..., periods=...'

    """
    signature = inspect.signature(call)
    try:
        signature.bind(*given, **named)
    except TypeError as error:
        fields, name = signature.parameters, getattr(call, "__name__", "call")
        unknown = next((one for one in named if one not in fields), None)
        if unknown is not None:
            near = did_you_mean(unknown, fields)
            return f"{name}() has no argument {unknown!r}{near or '; it has ' + ', '.join(fields)}"
        placed = [one for one, field in fields.items() if field.kind is not inspect.Parameter.KEYWORD_ONLY]
        if len(given) > len(placed):
            others = ", ".join(f"{one}=..." for one in fields if one not in placed and one not in named)
            if not others:
                return f"{name}() takes {len(placed)} arguments ({', '.join(placed)}), got {len(given)}"
            return f"{name}() takes {', '.join(placed)} by place, and the others by name: {others}"
        return f"{name}(): {error}"
    return ""
