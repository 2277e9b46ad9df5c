"""Pages and tables of the guide that are made from the code; run this file to write them again.

From the top folder: python -m tests.guide_pages
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import packmech as pm
from packmech.calls.honors import CALLS, COLUMNS
from packmech.result import markdown_table
from packmech.scenes.reference import scene_reference

GUIDE = Path(__file__).parents[1] / "packmech" / "guide"
BEGIN, END = "<!-- made by tests/guide_pages.py: {} -->\n", "<!-- end -->\n"


def effects_page() -> str:
    """Return the page that says which call honors which effect."""
    for name in pm.__all__:
        getattr(pm, name)
    rows = [(f"`pm.{name}`", *(CALLS[name].answer(column) for column in COLUMNS)) for name in sorted(CALLS)]
    return (
        "\n\n".join(
            [
                "# What each call does with the effects of a scene",
                "Which call honors which effect of a scene, and which refuses it.",
                "No call ignores what a scene holds. Each public call declares which effects it honors and refuses the "
                "others with an error that names the effect, the call, and what to do: leave the effect out with "
                "`scene.without(pm.Friction)`, or use a call that honors it. `packmech effects` prints this table, and "
                "this page is made from the same declarations (`packmech/calls/honors.py`).",
                "- **yes**: the answer depends on the effect.\n"
                "- **zero at rest**: dashpots and drag exert no force on particles that do not move, so that an answer "
                "about a packing at rest does not depend on them.\n"
                "- **refused**: the call raises ValueError.\n"
                "- empty: the call takes a packing, which has no effects.",
                "A packing that holds tangential displacements (`pm.TangentialDisplacements`) comes from a run with "
                "friction. Calls of a packing alone refuse it where only friction could answer, and name "
                "`pm.contact_forces`.",
                "## Columns",
                markdown_table(("column", "what it is"), COLUMNS.items()).strip(),
                "## Calls",
                markdown_table(("call", *COLUMNS), rows).strip(),
                "## Friction beside walls",
                "Walls have a friction of their own: a scene whose contacts have friction must say what that of its "
                "`pm.Walls` and `pm.MeshWalls` is, `friction=pm.Friction(0.0)` for smooth ones. So for resistance to "
                "rolling and to twisting, but for `pm.MeshWalls` whose friction is Friction(0.0).",
            ]
        )
        + "\n"
    )


def outcomes_table() -> str:
    """Return the table of how a run may end, from the enum."""
    rows = [(f"`{one.name}`", "yes" if one.ok else "no", one.value) for one in pm.Outcome]
    return markdown_table(("outcome", "success", "what it says"), rows)


def modules_list() -> str:
    """Return what each module of packmech is for, by folder: the first paragraphs of their docstrings."""
    found: dict[str, list[str]] = {}
    for path in sorted(GUIDE.parent.rglob("*.py")):
        if path.name == "__init__.py":
            continue
        text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
        about = " ".join(text.partition("\n\n")[0].split())
        folder = path.parent.relative_to(GUIDE.parent.parent).as_posix()
        found.setdefault(folder, []).append(f"- `{path.name}`: {about}\n")
    return "\n".join(f"### {folder}\n\n" + "".join(found[folder]) for folder in sorted(found))


# whole pages, and tables that stand in pages that are written by hand
PAGES = {"scene-files": scene_reference, "effects": effects_page}
TABLES = {"errors": {"outcomes": outcomes_table}, "architecture": {"modules": modules_list}}


def made_pages() -> dict[str, str]:
    """Return the text that pages made from the code should have, by topic."""
    found = {topic: make() for topic, make in PAGES.items()}
    for topic, tables in TABLES.items():
        text = (GUIDE / f"{topic}.md").read_text("utf-8")
        for name, make in tables.items():
            before, begin, rest = text.partition(BEGIN.format(name))
            assert begin, f"{topic}.md must hold the line {BEGIN.format(name).strip()!r}"
            text = before + begin + "\n" + make() + "\n" + END + rest.partition(END)[2]
        found[topic] = text
    return found


def main() -> None:
    """Write the pages; with --check, only name those that would change, and fail if there are any."""
    changed = {
        topic: text
        for topic, text in made_pages().items()
        if not (path := GUIDE / f"{topic}.md").exists() or path.read_text("utf-8") != text
    }
    for topic, text in changed.items():
        print(f"{topic}.md has changed")
        if "--check" not in sys.argv:
            (GUIDE / f"{topic}.md").write_text(text, encoding="utf-8")
    sys.exit(bool(changed) and "--check" in sys.argv)


if __name__ == "__main__":
    main()
