"""What looks at the kinds of particles: effects and laws with tables by kinds, and a user's that read them."""

from __future__ import annotations

import dis
import functools
import inspect
from collections.abc import Iterator
from typing import Any


def records_in(record: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Give an effect or a law, then those in it and their tables, each with the path of its field."""
    yield name, record
    if getattr(record, "table_of_kinds", False) or not isinstance(record, tuple):
        return
    for field, value in zip(getattr(record, "_fields", map(str, range(len(record)))), record, strict=True):
        if isinstance(value, tuple):
            yield from records_in(value, f"{name}.{field}" if name else field)


def looks_at_kinds(record: Any) -> bool:
    """Return whether an effect or a law, or one in it, may do other things to other kinds of particles.

    It holds a table by kinds, whose class says so (`table_of_kinds`), or is of a user's class that reads `kinds`.
    """
    for _, one in records_in(record):
        cls: Any = type(one)
        if getattr(one, "table_of_kinds", False) or reads_kinds(cls):
            return True
    return False


@functools.cache
def reads_kinds(cls: Any) -> bool:
    """Return whether methods of a user's class read the kinds of the particles that they are given."""
    if not hasattr(cls, "_fields"):
        return False
    return any(_method_reads(name, method) for one in cls.__mro__ for name, method in vars(one).items())


def _method_reads(name: str, method: Any) -> bool:
    """Return whether a method reads the kinds of its `partners`, or a dashpot of its pair, or hands these on."""
    if not inspect.isfunction(method) or method.__module__.startswith("packmech."):
        return False
    arguments = list(inspect.signature(method).parameters)
    given = "partners" if "partners" in arguments else arguments[-1] if name == "pair_damping" else None
    if given is None:
        return False
    code = list(dis.get_instructions(method))
    for here, after in zip(code, code[1:], strict=False):
        read = here.argval if isinstance(here.argval, tuple) else (here.argval,)
        if here.opname.startswith(("LOAD_FAST", "LOAD_DEREF", "LOAD_CLOSURE")) and given in read:
            # what is handed on whole may be read for kinds where this does not see it
            number_alone = after.opname == "LOAD_ATTR" and read[-1] == given and read.count(given) == 1
            if not number_alone or after.argval == "kinds":
                return True
    return False
