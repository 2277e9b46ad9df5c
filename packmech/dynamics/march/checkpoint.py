"""The state of compiled loops as named arrays, and back: nested records are taken apart by the names of their fields.

What comes back holds the very numbers that were taken, pair lists with their order and skins included, so that what
follows has the bits of a run that was never stopped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from packmech.dynamics.march.state import March

Leaves = dict[str, Any]

# fields of a march that change on its way; the rest follows from scene and settings
_CHANGING = ("home_nd", "change_dd", "state", "space", "pairs", "track", "steps", "started")


def leaves(record: Any, name: str) -> Leaves:
    """Return copies of the arrays and numbers in nested named tuples, by their path.

    Arrays that cannot be written to are left out: nothing changes them.

    Parameters
    ----------
    record
        Named tuples of named tuples, arrays, numbers and None.
    name
        Path of the record itself.

    Examples
    --------
    >>> from packmech.dynamics.march.flow import Still
    >>> leaves(Still(0.5), "profile")
    {'profile.gamma': array(0.5)}

    """
    if record is None:
        return {}
    if isinstance(record, np.ndarray):
        return {name: record.copy()} if record.flags.writeable else {}
    if isinstance(record, bool | int | float | np.generic):
        return {name: np.array(record)}
    found: Leaves = {}
    if isinstance(record, tuple):
        names = getattr(record, "_fields", range(len(record)))
        for part, value in zip(names, record, strict=True):
            found |= leaves(value, f"{name}.{part}")
    return found


def regrown(record: Any, name: str, saved: Mapping[str, Any], *, in_place: bool = False) -> Any:
    """Return a record of the same kinds with the saved arrays and numbers.

    Parameters
    ----------
    record
        A record built anew for the same scene; arrays may be of other lengths.
    name
        Path of the record.
    saved
        What `leaves` returned.
    in_place
        Write into the record's own arrays, which some of its parts may share.

    Raises
    ------
    ValueError
        If something is missing or of another kind.

    """
    if record is None:
        return None
    if isinstance(record, np.ndarray):
        if not record.flags.writeable:
            return record
        value = _found(saved, name)
        if value.dtype != record.dtype or value.ndim != record.ndim:
            raise ValueError(f"{name} must be of kind {record.dtype}, got {value.dtype}")
        if not in_place:
            return np.array(value, order="C")
        if value.shape != record.shape:
            raise ValueError(f"{name} must have shape {record.shape}, got {value.shape}")
        record[...] = value
        return record
    if isinstance(record, bool | int | float | np.generic):
        return type(record)(_found(saved, name)[()])
    if not isinstance(record, tuple):
        return record
    names = getattr(record, "_fields", range(len(record)))
    parts = [
        regrown(value, f"{name}.{part}", saved, in_place=in_place) for part, value in zip(names, record, strict=True)
    ]
    return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)


def _found(saved: Mapping[str, Any], name: str) -> Any:
    if name not in saved:
        raise ValueError(f"it must hold {name}, got none")
    return saved[name]


def march_leaves(march: March) -> Leaves:
    """Return everything that changes on the way of a march, by name."""
    found: Leaves = {}
    for name in _CHANGING:
        found |= leaves(getattr(march, name), f"march.{name}")
    return found


def restore_march(march: March, saved: Mapping[str, Any]) -> None:
    """Put a march, built anew for the same scene and settings, where the saved one was.

    Parameters
    ----------
    march
        The march; it need not have begun.
    saved
        What `march_leaves` returned.

    """
    for name in _CHANGING:
        # rows keep their place in memory; lists are of other lengths
        own = name in ("state", "space")
        setattr(march, name, regrown(getattr(march, name), f"march.{name}", saved, in_place=own))
