"""packmech: mechanics of jammed packings.

`pm.help()` lists every public name by subject, `pm.help("modul")` those with a word; `packmech guide` is what to read.
Names are found on first use, so that `import packmech` is light and a command pays only for what it touches.
"""

from __future__ import annotations

import builtins
import importlib
import os
import re
from typing import Any

__version__ = "0.1.0"


def _read() -> tuple[dict[str, dict[str, str]], dict[str, list[str]]]:
    """Return subject -> public name -> module that holds it, and everyday word -> names, as __init__.pyi has them."""
    found: dict[str, dict[str, str]] = {}
    names: dict[str, str] = {}
    words: dict[str, list[str]] = {}
    with open(f"{os.path.splitext(__file__)[0]}.pyi", encoding="utf-8") as file:
        lines = file.read().splitlines()
    for line in lines[1:]:
        if line.startswith("# "):
            names = found.setdefault(line[2:], {})
        elif named := re.fullmatch(r"from (\S+) import (\w+) as \2", line):
            names[named[2]] = named[1]
        elif said := re.fullmatch(r"#: (.+) -> (.+)", line):
            words |= dict.fromkeys(said[1].split(", "), said[2].split(", "))
    return found, words


_SUBJECTS, _WORDS = _read()
_PUBLIC = {name: module for names in _SUBJECTS.values() for name, module in names.items()}

__all__ = sorted(_PUBLIC)


def help(word: Any = "") -> None:
    """Print the public names by subject, each with one line on it.

    Parameters
    ----------
    word
        Only names, lines and subjects in which this stands, all its words; everyday words and symbols, such as "DOS",
        find what they are called here. Of anything but a text the docstring is shown, as Python's help does.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.help("fit_power")
    ensembles
      fit_power_law          Return the power law that fits values of groups, weighted by their errors.

    """
    from packmech.calls.docstrings import print_subjects

    if isinstance(word, str):
        print_subjects(_SUBJECTS, word, _WORDS)
    else:
        builtins.help(word)


def __getattr__(name: str) -> Any:
    module = _PUBLIC.get(name)
    if module is None:
        if name.startswith("__"):
            raise AttributeError(f"module 'packmech' has no attribute {name!r}")
        from packmech.check import did_you_mean

        known = _WORDS.get(name.lower())
        near = f"; did you mean {' or '.join(map(repr, known))}?" if known else did_you_mean(name, _PUBLIC)
        raise AttributeError(f"module 'packmech' has no attribute {name!r}{near or '; pm.help() lists what there is'}")
    found = importlib.import_module(module)
    value = getattr(found, name, None) or importlib.import_module(f"{module}.{name}")
    if isinstance(value, type):
        # numpy, which checks need, is not loaded before a name is asked for
        from packmech.check import clear_fields

        clear_fields(value)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__", "help"]
