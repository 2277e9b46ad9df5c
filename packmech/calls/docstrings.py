"""Docstrings in sections, read for what they say of parameters and attributes."""

from __future__ import annotations

import importlib
import inspect
import re
import textwrap
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from packmech.check import did_you_mean

_TAKEN = re.compile(r"(?:As of|What) `?pm\.(\w+)")
_UNIT = re.compile(r"\[([^\[\]]*)\]")


def sections(text: str) -> dict[str, list[str]]:
    r"""Return the sections of a docstring by their titles, as lines; what stands before the first one is "".

    Examples
    --------
    >>> list(sections("Return one.\n\nRaises\n------\nValueError\n    Never."))
    ['', 'Raises']

    """
    found: dict[str, list[str]] = {"": []}
    title, lines = "", inspect.cleandoc(text or "").splitlines()
    for k, line in enumerate(lines):
        if k + 1 < len(lines) and lines[k + 1] and set(lines[k + 1]) == {"-"}:
            title = line.strip()
            found[title] = []
        elif not (line and set(line) == {"-"}):
            found[title].append(line)
    return found


def meanings_of(thing: Any) -> dict[str, str]:
    """Return what the docstring of a class or a function says of each of its parameters or attributes.

    Where it says "What pm.call takes" that of the call's parameter of this name stands there.
    """
    parts = sections(thing.__doc__ or "")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in [*parts.get("Parameters", []), *parts.get("Attributes", [])]:
        if line and not line[0].isspace():
            names = [one.strip() for one in line.partition(" : ")[0].split(",")]
            found |= dict.fromkeys(names, "")
        else:
            for name in names:
                found[name] = f"{found[name]} {line.strip()}".strip()
    for name, text in found.items():
        taken = _TAKEN.match(text)
        call = getattr(importlib.import_module("packmech"), taken[1], None) if taken else None
        of_call = meanings_of(call).get(name) if inspect.isfunction(call) else None
        found[name] = (of_call or text).replace("``", "`")
    return found


def first_sentence(thing: Any) -> str:
    """Return the first paragraph of a docstring in one line."""
    lines = sections(thing.__doc__ or "")[""]
    end = next((k for k, line in enumerate(lines) if not line.strip()), len(lines))
    return " ".join(" ".join(lines[:end]).split())


def unit_in(meaning: str) -> str:
    """Return the unit that a meaning names in brackets; empty where it names none.

    Examples
    --------
    >>> unit_in("(N, d) net force on each particle [force]"), unit_in("Number of contacts.")
    ('force', '')

    """
    found = _UNIT.search(meaning)
    return found[1] if found else ""


def print_subjects(
    subjects: Mapping[str, Mapping[str, str]], word: str = "", words: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Print names by subject, each with the first sentence on it; only those with a word, if one is given.

    Pages of the guide with a heading on it stand below.
    `words` are everyday ones with the names that they stand for.
    """
    package, parts = importlib.import_module("packmech"), word.lower().split()
    known, found = words or {}, False
    meant = set(known.get("_".join(parts).replace("-", "_"), ()))
    for subject, names in subjects.items():
        about = {name: first_sentence(getattr(package, name)) for name in names}
        rows = {
            name: line
            for name, line in about.items()
            # a symbol, such as z, is a part of too many words
            if name in meant
            or not (meant and len(word) < 3)
            and (
                all(part in subject.lower() for part in parts)
                # of what is said only words that begin so: "pile" is no part of "compiled"
                or all(part in name.lower() or re.search(rf"\b{re.escape(part)}", line.lower()) for part in parts)
            )
        }
        if rows:
            found = True
            print(subject)
            for name, line in rows.items():
                print("\n".join(textwrap.wrap(line, 120, initial_indent=f"  {name:22s} ", subsequent_indent=" " * 25)))
    pages = _guide_pages_on(parts) if parts else {}
    if pages:
        print("to read")
        for topic, heading in pages.items():
            print(f"  packmech guide {topic:15s} {heading}")
    if not found and not pages:
        public = [name for group in subjects.values() for name in group]
        near = did_you_mean("_".join(parts), [*public, *known])
        print(f"nothing found for {word!r}{near}; try one word of it, or pm.help() for all names by subject")


def guide_pages() -> dict[str, str]:
    """Return the text of each page of the guide, by its topic, in the order of these."""
    pages = (one for one in (resources.files("packmech") / "guide").iterdir() if one.name.endswith(".md"))
    return {one.name.removesuffix(".md"): one.read_text("utf-8") for one in sorted(pages, key=lambda one: one.name)}


def _guide_pages_on(parts: Sequence[str]) -> dict[str, str]:
    """Return the pages of the guide that have a heading with these words, and the heading."""
    found: dict[str, str] = {}
    for topic, text in guide_pages().items():
        for line in text.splitlines():
            if line.startswith("#") and all(re.search(rf"\b{re.escape(one)}", line.lower()) for one in parts):
                found.setdefault(topic, line.lstrip("# "))
    return found
