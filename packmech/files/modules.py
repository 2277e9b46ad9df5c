"""Python files of a user's own, imported for what they register or hold."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from packmech.check import brief, listed


def load_modules(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Import Python files, from their own folders, for what they register; return their paths.

    Raises
    ------
    TypeError, ValueError
        If these are no paths, there is no such file, another module has its name, or its import fails.

    """
    files: list[Path] = []
    for one in listed("load", paths, "paths"):
        if not isinstance(one, str | os.PathLike):
            raise TypeError(f"load must hold paths, got {brief(one)}")
        path = Path(one)
        if path.suffix != ".py" or not path.is_file():
            raise ValueError(f"load must name an existing Python file, got {str(path)!r}")
        folder = str(path.absolute().parent)
        if folder not in sys.path:
            sys.path.insert(0, folder)
        try:
            found = importlib.import_module(path.stem).__file__
        except Exception as error:
            raise ValueError(f"load must name a file that can be imported, got {str(path)!r}: {error}") from error
        if found is None or not path.samefile(found):
            raise ValueError(f"load must name a file that is called as no other module, got {str(path)!r}")
        files.append(path)
    return files
