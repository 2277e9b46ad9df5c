"""Nested tables as TOML text. The standard library reads TOML but does not write it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return the TOML document of a dict of numbers, strings, booleans, lists and dicts, read back the same.

    A dict becomes a table, a list of dicts an array of tables, a dict inside those an inline table. A list of lists is
    broken into lines.

    Raises
    ------
    TypeError
        For a value that has no place in TOML.

    Examples
    --------
    >>> print(toml_text({"title": "a", "drive": {"kind": "jam", "pressure": 1e-8}}))
    title = "a"
    <BLANKLINE>
    [drive]
    kind = "jam"
    pressure = 1e-08
    <BLANKLINE>

    """
    plain = {key: value for key, value in tables.items() if not _is_table(value) and not _is_table_array(value)}
    blocks = [_lines(plain)] if plain else []
    for key, value in tables.items():
        if _is_table(value):
            blocks.append(f"[{_key(key)}]\n{_lines(value)}")
        elif _is_table_array(value):
            blocks += [f"[[{_key(key)}]]\n{_lines(table)}" for table in value]
    return "\n".join(blocks)


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _is_table_array(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(_is_table(entry) for entry in value)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _string(key)


def _string(text: str) -> str:
    # JSON's escapes are TOML's, except that TOML also escapes DEL
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        if any(isinstance(entry, list | tuple) for entry in value):
            return "[\n" + "".join(f"    {_value(entry)},\n" for entry in value) + "]"
        return "[" + ", ".join(map(_value, value)) + "]"
    raise TypeError(f"value must be a number, a string, a boolean, a list or a dict, got {value!r}")
