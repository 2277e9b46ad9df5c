"""Build the documentation site from the guide, the gallery and the docstrings: `python .ci/site.py [FOLDER]`.

Sphinx reads Markdown through MyST; a link that leads nowhere is an error. Needs the extra `site`.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from sphinx.cmd.build import main as build

import packmech as pm

ROOT = Path(__file__).resolve().parents[1]
GUIDE, GALLERY = ROOT / "packmech" / "guide", ROOT / "recordings" / "gallery"
CONF = f"""
project, author, release = "packmech", "the packmech developers", "{pm.__version__}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
html_theme, html_title = "furo", "packmech"
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"
suppress_warnings = ["docutils", "ref.python"]
"""


def api_page(subject: str, names: dict[str, str]) -> str:
    """Return the page of the public names of a subject, in reStructuredText."""
    lines = [subject, "=" * len(subject), ""]
    for name in names:
        found = getattr(pm, name)
        kind = "autoclass" if isinstance(found, type) else "autofunction" if callable(found) else "automodule"
        lines += [
            f".. {kind}:: {found.__module__}.{name}" if kind != "automodule" else f".. automodule:: {found.__name__}"
        ]
        lines += ["   :members:", ""] if kind == "autoclass" else [""]
    return "\n".join(lines)


def write_source(source: Path) -> None:
    """Write what Sphinx reads into an empty folder."""
    (source / "conf.py").write_text(CONF, encoding="utf-8")
    guide = sorted(page.stem for page in GUIDE.glob("*.md"))
    first = [name for name in ("first-steps", "choosing", "verdicts") if name in guide]
    shutil.copytree(GUIDE, source / "guide")
    gallery = (GALLERY / "README.md").is_file()
    if gallery:
        shutil.copytree(GALLERY, source / "gallery")
    (source / "api").mkdir()
    pages = []
    for k, (subject, names) in enumerate(pm._SUBJECTS.items()):
        pages.append(f"api/{k:02d}-{subject.split(',')[0].replace(' ', '-')}")
        (source / f"{pages[-1]}.rst").write_text(api_page(subject.capitalize(), names), encoding="utf-8")
    parts = [
        ("Guide", [f"guide/{name}" for name in dict.fromkeys([*first, *guide])]),
        ("Gallery", ["gallery/README"] if gallery else []),
        ("Names", pages),
    ]
    lines = ["# packmech", "", "Mechanics of jammed packings.", ""]
    for caption, entries in parts:
        if entries:
            lines += ["```{toctree}", f":caption: {caption}", ":maxdepth: 1", "", *entries, "```", ""]
    (source / "index.md").write_text("\n".join(lines), encoding="utf-8")


def main() -> int:
    """Build the site; return the exit code."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / ".site"
    with tempfile.TemporaryDirectory(prefix="packmech-site-") as place:
        write_source(Path(place))
        return build(["-W", "--keep-going", "-q", "-b", "html", place, str(target)])


if __name__ == "__main__":
    sys.exit(main())
