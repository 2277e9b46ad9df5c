"""Every script of the gallery is short, on public names, and finds again the numbers that its docstring states."""

import ast
import importlib.util
import re
import runpy
import sys

import matplotlib
import matplotlib.pyplot as plt
import pytest

import packmech as pm
from packmech.cli.gallery import CHECKOUT, about, scripts

matplotlib.use("agg")
if not CHECKOUT.is_dir():
    pytest.skip("no recordings/gallery here", allow_module_level=True)

SCRIPTS = {file.stem: file for file in sorted(CHECKOUT.glob("*.py"))}
# what a script may import besides the standard library
ALLOWED = {"packmech", "numpy"}
LEARNING = {"gymnasium", "packmech_envs", "stable_baselines3"}
LINE = re.compile(r"^ *(.+?) = (\S.*?)(?: \+- (\S+))?$", re.MULTILINE)


def stated(file):
    """Name -> value and spread (None where there is none), as the docstring states them."""
    printed = about(file).partition("\nPrints")[2].partition("\n\nTime")[0]
    return {name: (value, spread) for name, value, spread in LINE.findall(printed)}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_has_25_lines_of_code_and_uses_public_names_only(name):
    text = SCRIPTS[name].read_text(encoding="utf-8")
    tree = ast.parse(text)
    code = [line.strip() for line in text.splitlines()[tree.body[0].end_lineno :]]
    assert len([line for line in code if line and not line.startswith("#")]) <= 25
    imported = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "pm":
            assert node.attr in pm.__all__
        assert not (isinstance(node, ast.Attribute) and node.attr.startswith("_"))
    roots = {one.partition(".")[0] for one in imported} - sys.stdlib_module_names
    assert roots <= ALLOWED | (LEARNING if name == "learn_to_jam" else set())
    assert "packmech" in imported and not any(one.startswith("packmech.") for one in imported)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_says_its_question_its_source_its_time_and_what_it_prints(name):
    words = about(SCRIPTS[name])
    assert words.partition("\n")[0].endswith("?")
    assert re.search(r"\((19|20)\d\d\)", words)
    assert re.search(r"^Time: \d+ s", words, re.MULTILINE)
    assert 1 <= len(stated(SCRIPTS[name])) <= 3
    assert SCRIPTS[name].with_suffix(".png").stat().st_size > 5_000


def test_the_table_of_the_gallery_shows_every_script_with_its_question_and_figure():
    table = (CHECKOUT / "README.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| \[(\w+)\]\(\1\.py\)<br>(.+?) \| !\[.*\]\((\w+)\.png\) \|", table, re.MULTILINE)
    wanted = [(name, about(file).partition("\n")[0], name) for name, file in SCRIPTS.items()]
    assert sorted(shown) == sorted(wanted)


def test_the_command_finds_the_scripts_of_an_editable_checkout():
    assert scripts() == SCRIPTS


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_prints_the_numbers_that_it_states_within_their_spread(name, tmp_path, monkeypatch, capsys):
    if name == "learn_to_jam" and importlib.util.find_spec("stable_baselines3") is None:
        pytest.skip("needs the extra learning")
    monkeypatch.setattr(sys, "argv", [name, str(tmp_path)])
    runpy.run_path(str(SCRIPTS[name]), run_name="__main__")
    plt.close("all")
    assert (tmp_path / f"{name}.png").stat().st_size > 5_000
    printed = {found: value for found, value, _ in LINE.findall(capsys.readouterr().out)}
    wanted = stated(SCRIPTS[name])
    assert printed.keys() == wanted.keys()
    for quantity, (value, spread) in wanted.items():
        if spread:
            assert float(printed[quantity]) == pytest.approx(float(value), abs=float(spread)), quantity
        else:
            assert printed[quantity] == value, quantity
