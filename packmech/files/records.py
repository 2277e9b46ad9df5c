"""Small records (laws, effects, sizes, drives) as plain tables and back, with errors that name the field.

A table is a dict as TOML and JSON know it. Its ``kind`` is the record's class name in lower case with hyphens
(``RepulsiveLennardJones`` is ``repulsive-lennard-jones``); its other entries are the record's fields. What makes a
packing may also be a function: its kind is the function's name, and its fields are its parameters.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from packmech.check import brief, did_you_mean
from packmech.jit.source_key import written_name

Maker = Callable[..., Any]
Kinds = Mapping[str, Maker]

_WORD = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|_+")


class TableError(ValueError):
    """Several errors of one table, one in each line; `found` holds them."""

    def __init__(self, found: list[Exception]) -> None:
        super().__init__("\n".join(f"- {one}" for one in found))
        self.found = found


class Errors:
    """The errors of a table, kept so that all of them are said at once."""

    def __init__(self) -> None:
        self.found: list[Exception] = []

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep the error that reading one part ends with."""
        try:
            yield
        except TableError as several:
            self.found += several.found
        except (TypeError, ValueError, OSError) as error:
            self.found.append(error)

    def check(self) -> None:
        """Raise the error that was kept, or all of them as one."""
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            raise TableError(self.found)


class OpenKinds(dict[str, Maker]):
    """Kinds to which users add their own by a function of this name."""

    def __init__(self, kinds: Kinds, register: str) -> None:
        super().__init__(kinds)
        self.register = register


def kind_of(maker: Maker) -> str:
    """Return the name that tables give to a record class, or to a function that makes something.

    >>> kind_of(type("RepulsiveLennardJones", (), {}))
    'repulsive-lennard-jones'
    """
    return _WORD.sub("-", written_name(maker)).strip("-").lower()


def kinds_of(makers: Iterable[Maker]) -> dict[str, Maker]:
    """Return the record classes, or functions, by the names that tables give them."""
    return {kind_of(maker): maker for maker in makers}


def is_record(value: object) -> bool:
    """Return whether the value is an instance of a NamedTuple or of a dataclass."""
    return (isinstance(value, tuple) and hasattr(value, "_fields")) or (
        dataclasses.is_dataclass(value) and not isinstance(value, type)
    )


def to_table(record: Any) -> dict[str, Any]:
    """Return the record as a table; fields that are None are left out."""
    table: dict[str, Any] = {"kind": kind_of(type(record))}
    hints = _hints(type(record))
    for name in inspect.signature(type(record)).parameters:
        value = getattr(record, name)
        if is_record(value):
            table[name] = to_table(value)
        elif isinstance(value, np.ndarray):
            table[name] = value.tolist()
        elif isinstance(value, tuple):
            table[name] = [to_table(one) if is_record(one) else one for one in value]
        elif hints.get(name) is int and isinstance(value, float):
            # compiled records hold all numbers alike
            table[name] = int(value)
        elif value is not None:
            table[name] = value
    return table


def from_table(table: Any, where: str, kinds: Kinds, nested: Mapping[str, Kinds] | None = None) -> Any:
    """Return the record that a table describes.

    Parameters
    ----------
    table
        Dict with ``kind`` and the record's fields. A string stands for a table with this kind and every default.
    where
        Path of the table in its file, such as ``effects[0].law``, for the messages.
    kinds
        The record classes that may stand here, by name.
    nested
        For each field name that holds a record itself, the classes that may stand there.

    Raises
    ------
    TypeError, ValueError
        Naming the path of the field, what it must be and what was given.

    """
    return make(*read_fields(table, where, kinds, nested), where)


def read_fields(
    table: Any,
    where: str,
    kinds: Kinds,
    nested: Mapping[str, Kinds] | None = None,
    *,
    given: Iterable[str] = (),
) -> tuple[Maker, dict[str, Any]]:
    """Return what makes the thing that a table describes, and its checked fields; see ``from_table``.

    Parameters that are `given` by other means than the table are no fields of it.
    """
    if isinstance(table, str):
        table = {"kind": table}
    if not isinstance(table, dict):
        raise TypeError(f"{where} must be a table with a kind, got {brief(table)}")
    # where one kind alone may stand, it need not be named
    alone = list(kinds) if len(kinds) == 1 else _tables_by_kinds(table, kinds)
    kind = table.get("kind", *alone) if len(alone) == 1 else table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(f"{where}.kind must be one of {_listed(kinds, kind, 'kind' in table)}")
    maker = kinds[kind]
    fields = {name: one for name, one in inspect.signature(maker).parameters.items() if name not in given}
    hints = _hints(maker)
    values: dict[str, Any] = {}
    errors, meant = Errors(), set[str]()
    for name, value in table.items():
        path = f"{where}.{name}"
        if name == "kind":
            continue
        with errors.kept():
            if name not in fields:
                known, near = ", ".join(fields), did_you_mean(name, fields)
                meant |= {one for one in fields if near.endswith(f"{one!r}?")}
                raise ValueError(f"{path} must be a field of {kind_of(maker)} ({known}), got an unknown one{near}")
            if nested and name in nested and holds_record(hints.get(name, Any)) and not _number(value, hints.get(name)):
                values[name] = _records(value, path, nested[name], nested)
            else:
                values[name] = _value(path, value, hints.get(name, Any))
    for name, field in fields.items():
        # a field that stands there misspelled is not missing, too
        if name not in table and name not in meant and field.default is inspect.Parameter.empty:
            errors.found.append(ValueError(f"{where}.{name} must be given, got nothing"))
    errors.check()
    return maker, values


def _tables_by_kinds(table: Mapping[str, Any], kinds: Kinds) -> list[str]:
    """Return the kinds with the fields of a table, where all kinds are tables by kinds of particles."""
    if not all(getattr(maker, "table_of_kinds", False) for maker in kinds.values()):
        return []
    return [kind for kind, maker in kinds.items() if table.keys() <= inspect.signature(maker).parameters.keys()]


def _records(value: Any, where: str, kinds: Kinds, nested: Mapping[str, Kinds]) -> Any:
    """Return the record that a table describes, or those of a list of tables, or of rows of them."""
    if isinstance(value, list):
        return tuple(_records(one, f"{where}[{k}]", kinds, nested) for k, one in enumerate(value))
    return from_table(value, where, kinds, nested)


def _number(value: Any, hint: Any) -> bool:
    """Return whether a number stands where one may, beside records."""
    return isinstance(value, int | float) and not isinstance(value, bool) and float in _options(hint)


def _listed(kinds: Kinds, kind: Any, given: bool) -> str:
    """Return the kinds there are and what was given, for a message."""
    words = f"{', '.join(map(repr, sorted(kinds)))}, got {repr(kind) if given else 'nothing'}"
    words += did_you_mean(kind, kinds) if given else ""
    if given and isinstance(kinds, OpenKinds):
        words += f" (one of your own: register it with {kinds.register}, and load its file with --load FILE.py)"
    return words


def make(maker: Maker, values: Mapping[str, Any], where: str, renamed: Mapping[str, str] | None = None) -> Any:
    """Return what is made of the values; an error names the path of the field.

    `renamed` holds the fields of the table by the names that errors use for them.
    """
    try:
        return maker(**values)
    except (TypeError, ValueError, OSError) as error:
        argument, must, rest = str(error).partition(" must ")
        message = f"{(renamed or {}).get(argument, argument)}{must}{rest}"
        raise type(error)(message if message.startswith(f"{where}.") else f"{where}.{message}") from error


def _hints(maker: Maker) -> dict[str, Any]:
    try:
        return typing.get_type_hints(maker)
    except NameError:  # a user's class may be annotated with names that only its checker sees
        return {}


_WORDS = {float: "a number", int: "an integer", str: "a string", bool: "true or false"}


def holds_record(hint: Any) -> bool:
    """Return whether a field of this annotation may hold a record: not where it names numbers and texts alone."""
    return not all(option in _WORDS or typing.get_origin(option) is tuple for option in _options(hint))


def _options(hint: Any) -> tuple[Any, ...]:
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    return tuple(option for option in options if option is not type(None))


def _value(path: str, value: Any, hint: Any) -> Any:
    """Return the plain value in the type that the annotation asks for; annotations other than plain ones accept any."""
    if holds_record(hint) and not _number(value, hint):
        return tuple(value) if isinstance(value, list) else value
    options = _options(hint)
    for option in options:
        if typing.get_origin(option) is tuple and isinstance(value, list):
            inner = typing.get_args(option)[0]
            return tuple(_value(f"{path}[{k}]", entry, inner) for k, entry in enumerate(value))
        if option is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if option in (int, str, bool) and type(value) is option:
            return value
    words = " or ".join(_WORDS.get(option, "a list") for option in options)
    raise TypeError(f"{path} must be {words}, got {brief(value)}")


def value_of_text(text: str) -> Any:
    """Return what a text of the command line stands for: a number, or what TOML reads, or else the text itself.

    Examples
    --------
    >>> value_of_text("1e-4"), value_of_text("hertz"), value_of_text("[1, 2]"), value_of_text('{ kind = "normal" }')
    (0.0001, 'hertz', [1, 2], {'kind': 'normal'})

    """
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    try:
        read = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return read["value"] if len(read) == 1 else text


def split_values(text: str) -> list[str]:
    """Return the values of a list with commas; commas in brackets and quotes part nothing.

    Examples
    --------
    >>> split_values('1,[2, 3],{ kind = "uniform", width = 0.2 },"a,b"')
    ['1', '[2, 3]', '{ kind = "uniform", width = 0.2 }', '"a,b"']

    """
    found, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        else:
            depth += (letter in "[{(") - (letter in "]})")
        if letter == "," and not depth and not quote:
            found.append("")
        else:
            found[-1] += letter
    return [one.strip() for one in found]
