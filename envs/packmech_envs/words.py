"""Words of messages: values in one short line, and names that were meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def brief(value: object) -> str:
    """Return a value in one short line, whatever it is.

    Examples
    --------
    >>> brief("all"), len(brief("n" * 1000))
    ("'all'", 60)

    """
    try:
        # what is cut anyway is not written
        text = repr(value[:99] if isinstance(value, str | bytes) else value)
    except Exception as error:
        text = f"a {type(value).__name__} that cannot be shown ({type(error).__name__})"
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the end of a message that says which name was meant; empty where none is near."""
    # no name is as long as this, and distances of long texts take long
    near = difflib.get_close_matches(name, list(names), 1) if len(name) <= 200 else []
    return f"; did you mean {near[0]!r}?" if near else ""
