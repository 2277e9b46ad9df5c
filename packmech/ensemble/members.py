"""The members of an ensemble: parameters, the name of their folder, and the seed that is drawn from them."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from packmech.check import LARGEST_FLOAT, brief, check_memory, instance, integer, listed
from packmech.files.records import split_values, value_of_text

Grid = Mapping[str, Any] | Sequence[Mapping[str, Any]]

_NAME = re.compile(r"[A-Za-z_][\w-]*(\.[\w-]+)*")
# what a member takes at least: its parameters, its name
_MEMBER_BYTES = 500.0
_PART = re.compile(r"(\d+)/(\d+)")


@dataclass(frozen=True)
class Member:
    """One run: what it is called and what it is asked for.

    Attributes
    ----------
    id
        Name of its folder: signac's hash of the parameters.
    parameters
        Values by name, dots standing between the names of nested tables: "effects.friction.coefficient".

    """

    id: str
    parameters: dict[str, Any]

    @property
    def random_seed(self) -> int:
        """A seed that is drawn from all parameters, below 2^63; other members' are independent of it."""
        return int(self.id[:16], 16) >> 1


def member_of(parameters: Mapping[str, Any]) -> Member:
    """Return the member with these parameters.

    Raises
    ------
    TypeError, ValueError
        If a name or a value cannot be a parameter.

    Examples
    --------
    >>> member_of({"seed": 1, "effects.friction.coefficient": 0.1}).id
    'af02471969f2c6bfa3e7b543de133c8f'

    """
    values = {_checked(name): _plain(name, value) for name, value in parameters.items()}
    return Member(hashlib.md5(state_point_text(values).encode()).hexdigest(), values)


def state_point_text(parameters: Mapping[str, Any]) -> str:
    """Return the parameters as nested JSON with sorted names: what the file holds and what signac hashes."""
    nested: dict[str, Any] = {}
    for name, value in parameters.items():
        *path, last = name.split(".")
        table = nested
        for k, part in enumerate(path):
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise ValueError(
                    f"grid must not name a value and what lies in it, got {'.'.join(path[: k + 1])} and {name}"
                )
        if last in table:
            raise ValueError(f"grid must not name a value and what lies in it, got {name} and more below it")
        table[last] = value
    return json.dumps(nested, sort_keys=True)


def flattened(state_point: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the parameters that a state point nests.

    Examples
    --------
    >>> flattened({"seed": 1, "effects": {"friction": {"coefficient": 0.1}}})
    {'seed': 1, 'effects.friction.coefficient': 0.1}

    """
    found: dict[str, Any] = {}
    for name, value in state_point.items():
        found |= flattened(value, f"{before}{name}.") if isinstance(value, dict) else {f"{before}{name}": value}
    return found


def members_of(grid: Grid) -> list[Member]:
    """Return the members of a grid: every combination of the values of its parameters, the last one fastest.

    Parameters
    ----------
    grid
        Lists of values, or single values, by the name of the parameter; or a list of such tables, one after the other.

    Raises
    ------
    TypeError, ValueError
        If it is no such thing, names a value twice, or has no members.

    Examples
    --------
    >>> [one.parameters for one in members_of({"particles": 64, "seed": range(2)})]
    [{'particles': 64, 'seed': 0}, {'particles': 64, 'seed': 1}]

    """
    words = "tables of values by name, or one table of values"
    tables = [grid] if isinstance(grid, Mapping) else listed("grid", grid, words)
    found: dict[str, Member] = {}
    for table in tables:
        if not isinstance(table, Mapping) or not table:
            raise TypeError(f"grid must hold tables of values by name, got {brief(table)}")
        columns = [_listed(value) for value in table.values()]
        check_memory("grid", math.prod(map(len, columns)) * _MEMBER_BYTES)
        for values in itertools.product(*columns):
            one = member_of(dict(zip(table, values, strict=True)))
            if one.id in found:
                raise ValueError(f"grid must name each member once, got {one.parameters} twice")
            found[one.id] = one
    if not found:
        raise ValueError("grid must have at least one member, got none")
    return list(found.values())


def _listed(value: Any) -> list[Any]:
    """Return the values that a parameter takes."""
    if isinstance(value, str) or not isinstance(value, Iterable) or isinstance(value, Mapping):
        return [value]
    if isinstance(value, range):
        check_memory("grid", (value.stop - value.start) / value.step * _MEMBER_BYTES)
    return list(value)


def _checked(name: Any) -> str:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(f"grid must name parameters by words with dots between them, got {brief(name)}")
    return name


def _plain(name: str, value: Any) -> Any:
    """Return a value as JSON knows it."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(name, one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"grid[{name!r}] must be finite, got {brief(value)}")
    if isinstance(value, int) and abs(value) > LARGEST_FLOAT:
        raise ValueError(f"grid[{name!r}] must be at most {LARGEST_FLOAT:.2g} in size, got {brief(value)}")
    if value is not None and not isinstance(value, bool | int | float | str):
        raise TypeError(
            f"grid[{name!r}] must be a number, a text, a truth value or a list of these, got {brief(value)}"
        )
    return value


def values_in(text: str, name: str = "grid") -> list[Any]:
    """Return the values that a text of the command line names.

    ``0:10`` are whole numbers, the last left out; ``0.01:1:20:log`` and ``0:1:11:linear`` so many numbers with both
    ends; anything else is a list with commas. Lists, tables and texts with colons are written as in TOML.

    Raises
    ------
    ValueError
        If it is none of these.

    Examples
    --------
    >>> values_in("0:3"), values_in("1:100:3:log"), values_in("0:1:3:linear"), values_in("bulk,0.5,3")
    ([0, 1, 2], [1.0, 10.0, 100.0], [0.0, 0.5, 1.0], ['bulk', 0.5, 3])

    """
    written = any(letter in text for letter in "\"'[{")
    parts = [text] if written else text.split(":")
    try:
        if len(parts) == 2:
            first, end = map(int, parts)
            if end <= first:
                raise ValueError("it must rise")
            check_memory(name, (end - first) * _MEMBER_BYTES)
            return list(range(first, end))
        if len(parts) == 4 and parts[3] in ("log", "linear"):
            low, high, count = (
                float(parts[0]),
                float(parts[1]),
                integer("count", int(parts[2]), at_least=2, bytes_each=_MEMBER_BYTES),
            )
            spaced = np.geomspace if parts[3] == "log" else np.linspace
            return [float(f"{one:.12g}") for one in spaced(low, high, count)]
        if len(parts) == 1 and text:
            return [value_of_text(one) for one in split_values(text)]
        raise ValueError("it is none of these")
    except ValueError as error:
        raise ValueError(
            f"{name} must be FIRST:END, LOW:HIGH:COUNT:log, LOW:HIGH:COUNT:linear or values with commas, "
            f"got {brief(text)} ({error})"
        ) from error


def part_of(members: Sequence[Member], part: str | None) -> list[Member]:
    """Return one part of the members, named as in "3/100": every hundredth, from the third on.

    Raises
    ------
    TypeError, ValueError
        If it is no such text.

    """
    if part is None:
        return list(members)
    instance("part", part, str)
    found = _PART.fullmatch(part)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"part must be K/N with K from 1 to N, got {brief(part)}")
    return list(members[int(found[1]) - 1 :: int(found[2])])
