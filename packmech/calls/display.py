"""How results are shown: a few lines at a prompt, a table in a notebook; never a whole array."""

from __future__ import annotations

import dataclasses
import html
import importlib
import math
import re
import sys
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from packmech.calls.docstrings import first_sentence, meanings_of, unit_in

C = TypeVar("C", bound=type)

# lines of a repr, and letters of one line
LINES, LETTERS = 12, 110
# errors below this part of a value are rounding
_ROUNDING = 1e-12
# arrays of no more numbers are written out
_FEW = 6
# name, value in words, unit or meaning
Row = tuple[str, str, str]

# a zero with a sign, as a whole number in a text
_NEGATIVE_ZERO = re.compile(r"(?<![\w.+-])-(0(?:\.0+)?(?:e[+-]00)?)(?![\w.])")

# small pictures of what can be seen; drawn in a room above, found by its name when a notebook asks
_PICTURE = "packmech.plotting.plot:picture_of"


def value_with_error(value: float, error: float, sign: str = "+-") -> str:
    """Return a value to the last digit of its error, and the error; the value alone where no error is known.

    An error has two digits below 3.55 times a power of ten and one above (the rule of the Particle Data Group): 3.5
    +- 1.7, 12.3 +- 0.4.
    """
    largest = max(abs(value), error)
    if not (math.isfinite(largest) and error > max(_ROUNDING * largest, sys.float_info.min)):
        return f"{value:.6g}" if math.isnan(error) else f"{value:.6g} {sign} {error:.1g}"
    leading, power = f"{error:.2e}".split("e")
    # the place of the last digit that is written; an error of .96 is written as 1.0
    place = int(power) - (float(leading) < 3.55)
    if not 1e-5 < largest < 1e6:
        error = round(error, -place)
        value_digits = max(0, math.floor(math.log10(abs(value))) - place) if value else 0
        error_digits = math.floor(math.log10(float(f"{error:.0e}"))) - place
        return f"{value:.{value_digits}e} {sign} {error:.{error_digits}e}"
    # plus zero: a value that is rounded to zero has no sign
    value, error = round(value, -place) + 0.0, round(error, -place)
    return f"{value:.{max(0, -place)}f} {sign} {error:.{max(0, -place)}f}"


def without_negative_zeros(text: str) -> str:
    """Return a text in which zeros have no sign.

    Examples
    --------
    >>> without_negative_zeros("-0  -0.000  [-0, 1]  -0.5  1e-06  frame-0")
    '0  0.000  [0, 1]  -0.5  1e-06  frame-0'

    """
    return _NEGATIVE_ZERO.sub(r"\1", text)


def shown(headline: Callable[[Any], str] | None = None) -> Callable[[C], C]:
    """Return a decorator of a record's class: its fields are shown in a few lines, and as a table in notebooks.

    Parameters
    ----------
    headline
        What the first line says of a record besides its class, and perhaps a second line; its length where it has one
        unless given.

    """

    def decorated(cls: C) -> C:
        def text(self: Any) -> str:
            return as_text(type(self).__name__, _headline(self, headline), field_rows(self))

        def page(self: Any) -> str:
            first = _headline(self, headline) or repr(self).partition("\n")[0].removeprefix(
                f"<packmech.{cls.__name__}>"
            )
            return as_html(type(self).__name__, first.strip(), field_rows(self, long=True), self)

        # a repr that was written for the class stays
        if "__repr__" not in cls.__dict__ or hasattr(cls.__repr__, "__wrapped__") or hasattr(cls, "_fields"):
            cls.__repr__ = text  # type: ignore[assignment, method-assign]
        cls._repr_html_ = page  # type: ignore[attr-defined]
        return cls

    return decorated


def _headline(record: Any, headline: Callable[[Any], str] | None) -> str:
    if headline is not None:
        return headline(record)
    return str(len(record)) if hasattr(record, "__len__") and not isinstance(record, tuple) else ""


def field_rows(record: Any, *, long: bool = False) -> list[Row]:
    """Return name, value in words and unit of the fields of a record that are not empty.

    If `long`, the meaning stands for the unit, and only those that are None are left out.
    """
    meanings = meanings_of(type(record))
    names: Any = getattr(record, "_fields", None) or [one.name for one in dataclasses.fields(record) if one.repr]
    rows: list[Row] = []
    for name in names:
        value = getattr(record, name)
        if value is None or name.startswith("_") or (not long and _is_empty(value)):
            continue
        meaning = meanings.get(name, "")
        unit = unit_in(meaning)
        rows.append((name, in_words(value), meaning if long else f"[{unit}]" if unit not in ("", "1") else ""))
    return rows


def _is_empty(value: Any) -> bool:
    """Return whether a value is a text, an array or a collection that holds nothing."""
    if isinstance(value, np.ndarray):
        return value.size == 0
    return isinstance(value, str | tuple | list | Mapping) and len(value) == 0


def counted(number: int, name: str) -> str:
    """Return a number with the name of what it counts, in the plural but for one."""
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def in_words(value: Any) -> str:
    """Return a value in one short line: numbers, small arrays, the shape and the range of large ones.

    Examples
    --------
    >>> in_words(0.123456789), in_words(np.arange(12.0).reshape(6, 2)), in_words([True] * 9), in_words(np.eye(2) > 0)
    ('0.123457', '(6, 2) array, 0 to 11', '9 of bool', '[[True, False], [False, True]]')
    >>> in_words(("", "strain"))
    '(strain)'

    """
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        short = ", ".join(filter(None, map(in_words, value[:_FEW])))
        if len(value) <= _FEW and len(short) < LETTERS // 2:
            return f"({short})"
        kinds = {type(one).__name__ for one in value}
        return f"{len(value)} of {kinds.pop() if len(kinds) == 1 else 'several kinds'}"
    if isinstance(value, Mapping):
        return _cut(f"{len(value)} of: {', '.join(map(str, value))}" if value else "none", LETTERS // 2)
    own = isinstance(value, str) or "__str__" in type(value).__dict__
    return _cut((str(value) if own else repr(value)).partition("\n")[0], LETTERS)


def _array(array: np.ndarray[Any, Any]) -> str:
    if array.size <= _FEW and array.dtype.kind in "biuf":
        text = np.array2string(array, separator=", ", formatter={"float_kind": lambda one: f"{one:.5g}"})
        return " ".join(text.split()).replace("[ ", "[")
    words = f"{array.shape} array"
    if array.dtype.kind == "b":
        return f"{words}, {int(array.sum())} true"
    finite = array[np.isfinite(array)] if array.dtype.kind == "f" else array
    if array.dtype.kind not in "iuf" or not finite.size:
        return words
    low, high = finite.min(), finite.max()
    return f"{words}, all {in_words(low)}" if low == high else f"{words}, {low:.4g} to {high:.4g}"


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else text[: letters - 3] + "..."


def as_text(name: str, headline: str, rows: list[Row], further: str = "") -> str:
    """Return the repr of a result: a first line, and its rows below each other, at most a dozen lines.

    A headline of several lines is one that a reader must see first.
    """
    first, *others = (_cut(line, LETTERS) for line in f"<packmech.{name}> {headline}".rstrip().splitlines())
    fit = LINES - 1 - len(others)
    most = fit if len(rows) <= fit else fit - 1
    kept = rows[:most]
    first_wide, last_wide = (max((len(row[k]) for row in kept), default=0) for k in (0, 2))
    room = LETTERS - first_wide - min(last_wide, LETTERS // 2) - 6
    values = [_cut(row[1], room if row[2] else LETTERS) for row in kept]
    wide = max((len(value) for value, row in zip(values, kept, strict=True) if row[2]), default=0)
    lines = [f"  {a:{first_wide}}  {value:{wide}}  {c}".rstrip() for (a, _, c), value in zip(kept, values, strict=True)]
    more = (
        [_cut(f"  {further}and " + ", ".join(row[0] for row in rows[most:] if row[0]), LETTERS)] if rows[most:] else []
    )
    text = "\n".join([first, *(f"  {line}" for line in others), *(_cut(line, LETTERS) for line in lines), *more])
    return without_negative_zeros(text)


def as_html(name: str, headline: str, rows: list[Row], record: Any) -> str:
    """Return a result as a table of a notebook, with a small picture where there is something to see."""
    cells = "".join(
        f"<tr><td style='text-align:left'><b>{html.escape(a)}</b></td>"
        f"<td style='text-align:left'>{html.escape(without_negative_zeros(b))}</td>"
        f"<td style='text-align:left;color:#666'>{html.escape(c)}</td></tr>"
        for a, b, c in rows
    )
    about = html.escape(first_sentence(type(record)))
    module, _, function = _PICTURE.partition(":")
    picture = getattr(importlib.import_module(module), function)(record)
    return (
        "<div style='display:flex;gap:1.5em;flex-wrap:wrap;align-items:flex-start'><div>"
        f"<div><b>packmech.{html.escape(name)}</b> {html.escape(headline)}</div>"
        f"<div style='color:#666;max-width:46em'>{about}</div><table>{cells}</table></div>{picture}</div>"
    )
