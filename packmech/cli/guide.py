"""`packmech guide`: list what there is to read, or print one page of it."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import Parameter

from packmech.calls.docstrings import guide_pages
from packmech.check import one_of
from packmech.cli.output import show, table

# pages in the order in which they are listed; others that lie in the folder follow by name
_ORDER = (
    "first-steps",
    "choosing",
    "units",
    "glossary",
    "scene-files",
    "effects",
    "verdicts",
    "links",
    "friction",
    "cohesion",
    "shapes",
    "structure",
    "motion",
    "shear",
    "environments",
    "ensembles",
    "files",
    "accuracy",
    "errors",
    "coming-from",
    "extending",
    "architecture",
    "references",
    "citing",
)


def guide_topics() -> dict[str, str]:
    """Return what each page of the guide is about, by its topic: the first paragraph below its title."""
    found = guide_pages()
    ordered = [name for name in _ORDER if name in found] + [name for name in found if name not in _ORDER]
    return {name: " ".join(found[name].split("\n\n")[1].split()) for name in ordered}


def guide_page(topic: str) -> str:
    """Return a page of the guide as Markdown.

    Raises
    ------
    ValueError
        If there is no such page; it names the one that is nearest in spelling.

    """
    found = guide_pages()
    return found[one_of("topic", topic.removesuffix(".md"), found)]


Topic = Annotated[str | None, Parameter(help="the page to print; without one, all are listed")]


def guide(topic: Topic = None, /) -> None:
    """List the pages of the guide, or print one of them."""
    if topic is None:
        show(table("what there is to read", ("topic", "what it is about"), guide_topics().items(), right=()))
        show("read one: packmech guide TOPIC; names of the library by subject: packmech.help() in Python")
        return
    text = guide_page(topic)
    if not sys.stdout.isatty():
        sys.stdout.write(text)
        return
    from rich.markdown import Markdown

    show(Markdown(text))
