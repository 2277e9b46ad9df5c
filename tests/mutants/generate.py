"""Faults made from the syntax tree of a file: one operator, bound, constant or condition changed at a time."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mutants.catalogue import Fault

COMPARED = {
    ast.Lt: ("<", ("<=", ">=")), ast.LtE: ("<=", ("<", ">")), ast.Gt: (">", (">=", "<=")), ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)), ast.NotEq: ("!=", ("==",)), ast.Is: ("is", ("is not",)), ast.IsNot: ("is not", ("is",)),
}  # fmt: skip
REWRITTEN = {ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")}
JOINED = {ast.And: ("and", "or"), ast.Or: ("or", "and")}
NAMES = {"max": "min", "min": "max", "maximum": "minimum", "minimum": "maximum", "any": "all", "all": "any"}


def _between(text: str, first: int, last: int, was: str, now: str) -> tuple[int, int, str] | None:
    """Return where an operator stands between two operands, and what takes its place."""
    found = re.search(rf"(?<![\w<>=!*/]){re.escape(was)}(?![\w<>=*/])", text[first:last])
    return None if found is None else (first + found.start(), first + found.end(), now)


def changes(text: str) -> Iterator[tuple[str, tuple[int, int, str]]]:
    """Yield a sentence on each change that the rules make of a text, and where it stands: start, end, new text."""
    data = text.encode()
    starts = np.concatenate([[0], np.cumsum([len(line) for line in data.splitlines(keepends=True)])])
    letters = data.decode("latin-1")  # a letter for each byte, as the tree counts them

    def at(line: int, column: int) -> int:
        return int(starts[line - 1]) + column

    def ends(node: ast.expr) -> tuple[int, int]:
        return at(node.lineno, node.col_offset), at(node.end_lineno or 0, node.end_col_offset or 0)

    tree = ast.parse(text)
    hidden = {
        id(sub) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr | ast.Raise) for sub in ast.walk(node)
    }
    hidden |= {
        id(sub)
        for node in ast.walk(tree)
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None))
        if isinstance(part, ast.AST)
        for sub in ast.walk(part)
    }
    for node in ast.walk(tree):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
            was, others = COMPARED[type(node.ops[0])]
            for now in others:
                found = _between(letters, ends(node.left)[1], ends(node.comparators[0])[0], was, now)
                if found:
                    yield f"line {node.lineno}: {was} is {now}", found
        elif isinstance(node, ast.BinOp) and type(node.op) in REWRITTEN:
            was, now = REWRITTEN[type(node.op)]
            found = _between(letters, ends(node.left)[1], ends(node.right)[0], was, now)
            if found:
                yield f"line {node.lineno}: {was} is {now}", found
        elif isinstance(node, ast.BoolOp):
            was, now = JOINED[type(node.op)]
            found = _between(letters, ends(node.values[0])[1], ends(node.values[1])[0], was, now)
            if found:
                yield f"line {node.lineno}: {was} is {now}", found
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert | ast.USub):
            start, first = ends(node)[0], ends(node.operand)[0]
            # parentheses around what it acts on stay
            found = re.match(r"(not|~|-)\s*", letters[start:first])
            if found:
                yield f"line {node.lineno}: {found.group(1)} dropped", (start, start + found.end(), "")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            value = 2 * node.value or type(node.value)(1)
            yield f"line {node.lineno}: {node.value!r} is {value!r}", (*ends(node), repr(value))
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in NAMES:
                last = ends(node.func)[1]
                yield f"line {node.lineno}: {name} is {NAMES[name]}", (last - len(name), last, NAMES[name])
        elif isinstance(node, ast.If | ast.IfExp):
            first, last = ends(node.test)
            yield f"line {node.lineno}: the condition is False", (first, last, "False")


# a text of so many letters around a change makes it stand once in most files
_AROUND = 12


def _around(text: str, start: int, end: int) -> tuple[int, int]:
    """Return the bounds of a text around a change that stands once in its file and holds whole words."""
    first, last = start, end
    for wide in range(_AROUND, len(text) + _AROUND, _AROUND):
        first, last = max(start - wide, 0), min(end + wide, len(text))
        while first > 0 and text[first - 1 : first + 1].strip().isalnum():
            first -= 1
        while last < len(text) and text[last - 1 : last + 1].strip().isalnum():
            last += 1
        if text.count(text[first:last]) == 1:
            break
    return first, last


def _owners(text: str) -> list[tuple[int, int, str]]:
    """Return the lines of each function and class, first to last, and its qualified name, inner ones last."""
    found = []

    def look(node: ast.AST, within: str) -> None:
        for one in ast.iter_child_nodes(node):
            name = within
            if isinstance(one, ast.FunctionDef | ast.ClassDef):
                name = f"{within}.{one.name}" if within else one.name
                found.append((one.lineno, one.end_lineno or 0, name))
            look(one, name)

    look(ast.parse(text), "")
    return found


def generated(root: Path, file: str, seed: int, count: int) -> list[Fault]:
    """Return so many faults of a file, drawn from all that the rules make; the same seed draws the same.

    A fault is named by its function, by what changes and by how often that was there before in the function.
    """
    text = (root / file).read_text(encoding="utf-8")
    data, owners = text.encode(), _owners(text)
    found, seen = [], Counter[str]()
    for what, (first, last, now) in changes(text):
        line, _, change = what.removeprefix("line ").partition(": ")
        owner = [name for begin, end, name in owners if begin <= int(line) <= end]
        name = f"{owner[-1] if owner else 'module'}: {change}"
        seen[name] += 1
        start, end = len(data[:first].decode()), len(data[:last].decode())
        found.append((f"{name} ({seen[name]})" if seen[name] > 1 else name, start, end, now))
    chosen = np.sort(np.random.default_rng(seed).permutation(len(found))[:count])
    faults = []
    for name, start, end, now in (found[k] for k in chosen):
        low, high = _around(text, start, end)
        faults.append(Fault(file, name, text[low:high], text[low:start] + now + text[end:high]))
    return faults
