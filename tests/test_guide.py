"""Facts about the guide and README: their blocks run, their links lead somewhere, made pages are up to date."""

import copy
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from guide_pages import GUIDE

import packmech as pm
from packmech import observables, scene
from packmech.cli import execute
from packmech.cli.guide import guide_page, guide_topics
from packmech.effects import laws, pair
from packmech.minimize import minimizers
from packmech.protocols import method
from packmech.scenes import recipes
from packmech.view import report

ROOT = Path(__file__).parents[1]
PAGES = {path.stem: path for path in sorted(GUIDE.glob("*.md"))} | {"README": ROOT / "README.md"}
# pages that take minutes
SLOW = set()
# blocks that are not run, by page and the reason that stands in their fence
NOT_RUN = {
    ("ensembles", "needs Slurm"),
    ("ensembles", "shows options that need a longer run or a cluster"),
    ("environments", "trains an agent for minutes"),
}
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
LANGUAGES = {"python", "console", "bash", "toml", "text", "bibtex"}


def blocks(page):
    """Return the language, the rest of the fence line and the text of each block of a page."""
    return [(kind, rest.strip(), text) for kind, rest, text in FENCE.findall(PAGES[page].read_text("utf-8"))]


def without_blocks(page):
    return FENCE.sub("", PAGES[page].read_text("utf-8"))


def commands(text):
    """Return the words of each line that calls packmech; a line that ends in a backslash goes on."""
    lines = [line.strip().removeprefix("$ ") for line in text.replace("\\\n", " ").splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("packmech ")]


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub makes them."""
    found = set()
    for title in re.findall(r"^#+ (.*)$", without_blocks(page), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


# where laws, effects, ... of one's own are registered: what a page registers is gone with it
REGISTRIES = (
    *(observables.OBSERVABLES, laws._COMPILED, pair._COMPILED, minimizers._REGISTERED, method._METHODS),
    *(scene._DRIVES, recipes.PACKINGS, report.REPORT_FIGURES),
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of its own, where nothing asks for a terminal and Gymnasium's wrappers warn of nothing."""
    kept = [copy.copy(one) for one in REGISTRIES]
    yield _folder(tmp_path, monkeypatch)
    for one, before in zip(REGISTRIES, kept, strict=True):
        one.clear()
        one.extend(before) if isinstance(one, list) else one.update(before)


def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gym = pytest.importorskip("gymnasium")
    monkeypatch.setattr(gym.logger, "warn", lambda *told, **more: None)
    return tmp_path


@pytest.mark.parametrize("page", [pytest.param(one, marks=[pytest.mark.slow] * (one in SLOW)) for one in PAGES])
def test_the_blocks_of_a_page_run_one_after_the_other(page, folder):
    names = {"__name__": "__main__"}
    for number, (kind, rest, text) in enumerate(blocks(page)):
        if rest.startswith("no-run"):
            continue
        if kind == "toml" and rest:
            (folder / rest).write_text(text, encoding="utf-8")
        elif kind == "python":
            exec(compile(text, f"{page}.md, block {number}", "exec"), names)
        elif kind in ("console", "bash"):
            for words in commands(text):
                assert execute(words) == 0, words


def test_blocks_that_are_not_run_are_listed_with_their_reason():
    found = {
        (page, rest.removeprefix("no-run:").strip())
        for page in PAGES
        for _, rest, _ in blocks(page)
        if rest.startswith("no-run")
    }
    assert found == NOT_RUN


def test_blocks_are_of_languages_that_are_run_or_shown():
    for page in PAGES:
        for kind, rest, text in blocks(page):
            assert kind in LANGUAGES, f"{page}: {kind} {text[:40]}"
            assert not rest or kind == "toml" or rest.startswith("no-run: "), f"{page}: {rest}"


@pytest.mark.parametrize("page", list(PAGES))
def test_links_lead_to_files_and_headings(page):
    for target in LINK.findall(without_blocks(page)):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        file = (PAGES[page].parent / path).resolve() if path else PAGES[page]
        assert file.exists(), f"{page}: {target}"
        if page != "README":  # what is installed holds the pages and nothing else
            assert file.parent == GUIDE, f"{page}: {target}"
        if anchor:
            assert anchor in anchors(file.stem), f"{page}: {target}"


@pytest.mark.parametrize("page", list(PAGES))
def test_names_in_the_pages_are_public(page):
    named = set(re.findall(r"\bpm\.([A-Za-z]\w*)", PAGES[page].read_text("utf-8")))
    named -= {"X"}  # stands for any call
    assert {name for name in named if name != "help" and name not in pm.__all__} == set()


def test_pages_made_from_the_code_are_up_to_date():
    # in a process of its own: other tests register laws and effects of theirs
    command = [sys.executable, "-m", "tests.guide_pages", "--check"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, f"{done.stdout}{done.stderr}write them again: python -m tests.guide_pages"


def test_every_page_has_a_title_and_one_line_on_it():
    topics = guide_topics()
    assert list(topics) and set(topics) == set(PAGES) - {"README"}
    for topic, about in topics.items():
        assert guide_page(topic).startswith("# "), topic
        assert about.endswith(".") and 20 < len(about) < 120, f"{topic}: {about}"


def test_the_guide_lists_and_prints_its_pages(capsys):
    assert execute(["guide"]) == 0
    listed = capsys.readouterr().out
    for topic, about in guide_topics().items():
        assert re.search(rf"^ *{topic} +{re.escape(about)}$", listed, re.MULTILINE), topic
    assert execute(["guide", "units"]) == 0
    assert capsys.readouterr().out == (GUIDE / "units.md").read_text("utf-8")


def test_a_misspelled_topic_names_the_one_that_was_meant():
    with pytest.raises(ValueError, match="topic must be one of .*; did you mean 'units'"):
        execute(["guide", "unit"])


def test_readme_is_short_and_names_every_page():
    text = PAGES["README"].read_text("utf-8")
    assert len(text.encode()) <= 8192
    assert set(re.findall(r"\(packmech/guide/([\w-]+)\.md\)", text)) >= set(guide_topics())
