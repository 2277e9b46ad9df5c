"""Whether a function of a user's file is still the one that a folder was made with: a hash of what it is written as."""

from __future__ import annotations

import ast
import hashlib
import inspect
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

_Named = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def text_key(path: Path, name: str) -> str | None:
    """Return a hash of the statement of a file that defines a name, and of those in the file that it depends on.

    What counts are statements, not values: functions, classes, constants of any kind, decorators, defaults and imports
    that are named by one that counts, and all of a module that lies beside the file and is imported by one. Comments,
    docstrings and layout do not count, nor does what stands below ``if __name__ == "__main__":``.

    Parameters
    ----------
    path
        The Python file.
    name
        A name at its top.

    Returns
    -------
    str or None
        None where the file cannot be read or no statement at its top defines the name.

    """
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, UnicodeDecodeError):
        return None
    top = [one for one in tree.body if not _is_main_guard(one)]
    by_name: dict[str, list[int]] = {}
    for k, one in enumerate(top):
        for bound in _bound(one):
            by_name.setdefault(bound, []).append(k)
    if name not in by_name:
        return None
    # what `from module import *` brings is not known by name
    waiting, chosen = [name, "*"], set[int]()
    while waiting:
        for k in by_name.get(waiting.pop(), ()):
            if k not in chosen:
                chosen.add(k)
                waiting.extend({node.id for node in ast.walk(top[k]) if isinstance(node, ast.Name)})
    parts = [_plain(top[k]) for k in sorted(chosen)]
    seen = {path.resolve()}
    for k in sorted(chosen):
        for beside in _beside(top[k], path):
            parts += _whole(beside, seen)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


_MET: dict[int, tuple[Any, str | None]] = {}


def first_text_key(function: Any, path: Path, name: str) -> str | None:
    """Return `text_key` as it was when this process met the function: later edits change no code that it runs."""
    if id(function) not in _MET:
        # the function is kept, so that no other takes its place in memory
        _MET[id(function)] = function, text_key(path, name)
    return _MET[id(function)][1]


def file_key(path: Path) -> str:
    """Return a hash of all statements of a file, and of modules beside it that it imports."""
    return hashlib.sha256("\n".join(_whole(path, set())).encode()).hexdigest()


def own_text_key(function: Callable[..., Any]) -> str | None:
    """Return a hash of the text of a function that stands in no file, as of a notebook; None where it has no text."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):
        return None
    return hashlib.sha256(_plain(tree).encode()).hexdigest()


def _is_main_guard(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.If) and any(
        isinstance(node, ast.Name) and node.id == "__name__" for node in ast.walk(statement.test)
    )


def _bound(node: ast.AST) -> set[str]:
    """Return the names that a statement binds, or changes an entry or attribute of."""
    if isinstance(node, _Named):
        return {node.name}
    if isinstance(node, ast.Import | ast.ImportFrom):
        return {alias.asname or alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.ctx, ast.Store | ast.Del):
        inner: ast.expr = node
        while isinstance(inner, ast.Subscript | ast.Attribute):
            inner = inner.value
        return {inner.id} if isinstance(inner, ast.Name) else set()
    if isinstance(node, ast.Name):
        return {node.id} if isinstance(node.ctx, ast.Store) else set()
    if isinstance(node, ast.Lambda):
        return set()
    return set().union(*map(_bound, ast.iter_child_nodes(node)))


def _plain(tree: ast.AST) -> str:
    """Return the text of a tree in one layout, without docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | _Named) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree)


def _beside(tree: ast.AST, path: Path) -> Iterator[Path]:
    """Find the files beside one, or below, that statements in a tree import."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            places = [(path.parent, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            home = path.parent if node.level == 0 else path.parents[min(node.level, len(path.parents)) - 1]
            named = [f"{node.module}.{alias.name}" if node.module else alias.name for alias in node.names]
            places = [(home, one) for one in ([node.module] if node.module else []) + named]
        else:
            continue
        for home, module in places:
            stem = home.joinpath(*module.split("."))
            yield from (one for one in (stem.with_suffix(".py"), stem / "__init__.py") if one.is_file())


def _whole(path: Path, seen: set[Path]) -> list[str]:
    """Return the texts of a file and of the files beside it that it imports, each once."""
    if path.resolve() in seen:
        return []
    seen.add(path.resolve())
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, UnicodeDecodeError):
        return [path.name]
    found = [path.name, _plain(tree)]
    for beside in _beside(tree, path):
        found += _whole(beside, seen)
    return found
