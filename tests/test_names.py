"""Facts about the public names: which there are, where they are, and what is said of names that are none."""

import dataclasses
import importlib
import inspect
import re
import subprocess
import sys

import pytest

import packmech as pm


def test_only_public_names_are_listed():
    assert set(dir(pm)) == {*pm.__all__, "__version__", "help"}


@pytest.mark.parametrize("name", pm.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name):
    found = getattr(pm, name)
    assert found is getattr(importlib.import_module(pm._PUBLIC[name]), name)
    if inspect.isclass(found) or inspect.isfunction(found):
        assert inspect.getdoc(found)


def test_every_name_stands_once_and_under_a_subject():
    listed = [name for names in pm._SUBJECTS.values() for name in names]
    assert sorted(listed) == pm.__all__
    assert all(subject for subject in pm._SUBJECTS)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("elastic_modulii", "did you mean 'elastic_moduli'"),
        ("hertz", "did you mean 'Hertz'"),
        ("quench_", "did you mean 'quench'"),
        ("xyzzyq", "pm.help() lists what there is"),
    ],
)
def test_a_misspelled_name_is_answered_with_what_was_meant(name, message):
    with pytest.raises(AttributeError, match=message.replace("(", r"\(").replace(")", r"\)")):
        getattr(pm, name)


def test_help_lists_names_with_a_word_by_subject(capsys):
    pm.help("self stress")
    said = capsys.readouterr().out
    assert said.startswith("rigidity\n") and "states_of_self_stress" in said and "quench" not in said


def test_import_brings_neither_scipy_nor_the_compiler_nor_matplotlib():
    code = "import packmech, sys; print([m for m in ('scipy', 'numba', 'matplotlib', 'rich') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pm.jam(None, pressue=1e-3), "jam() has no argument 'pressue'; did you mean 'pressure'?"),
        (lambda: pm.Bidisperse(rato=2.0), "Bidisperse() has no argument 'rato'; did you mean 'ratio'?"),
        (lambda: pm.Friction(coeficient=0.5), "Friction() has no argument 'coeficient'; did you mean 'coefficient'?"),
        (lambda: pm.read_packing("a.npz", frme=1), "read_packing() has no argument 'frme'; did you mean 'frame'?"),
        (lambda: pm.jam(pm.lattice_packing("square"), 1e-3), "pm.Scene(packing, effects=(pm.Repulsion(),)) makes one"),
    ],
)
def test_a_misspelled_argument_is_answered_with_the_one_that_was_meant(call, words):
    with pytest.raises(TypeError, match=re.escape(words)):
        call()


def test_every_public_function_and_record_says_which_argument_it_does_not_have():
    # decorators of one's own laws and the like take any arguments, or functions only
    apart = {"law", "effect", "drive", "kernel", "minimizer", "observable", "packing_kind"}
    for name in set(pm.__all__) - apart:
        thing = getattr(pm, name)
        record = inspect.isclass(thing) and (dataclasses.is_dataclass(thing) or hasattr(thing, "_fields"))
        if not (record or inspect.isfunction(thing)) or inspect.isabstract(thing):
            continue
        if any(one.kind is one.VAR_KEYWORD for one in inspect.signature(thing).parameters.values()):
            continue
        with pytest.raises(TypeError, match="has no argument 'no_such_thing'"):
            thing(no_such_thing=1)


@pytest.mark.parametrize(
    ("word", "name"),
    [("shear_modulus", "elastic_moduli"), ("DOS", "density_of_states"), ("phi", "packing_fraction")],
)
def test_everyday_words_find_what_they_are_called_here(word, name, capsys):
    with pytest.raises(AttributeError, match=f"did you mean '{name}'"):
        getattr(pm, word)
    pm.help(word.replace("_", " "))
    assert name in capsys.readouterr().out


@pytest.mark.parametrize(
    ("word", "names", "page"),
    [
        ("heap", ("settle", "Gravity"), "friction"),
        ("pile", ("settle", "SettleDrive"), "friction"),
        ("convergence", ("work_precision",), "accuracy"),
        ("polymer", ("chain_packing", "Links"), "links"),
        ("pull-off", ("JKR", "DMT"), "glossary"),
        ("reaction", ("contact_forces", "wall_contacts"), "friction"),
        ("plastic", ("quasistatic_shear",), "shear"),
    ],
)
def test_everyday_words_find_names_and_the_page_to_read(word, names, page, capsys):
    pm.help(word)
    said = capsys.readouterr().out
    assert f"packmech guide {page}" in said
    assert {f"  {name} " in said for name in names} == {True}
    # "pile" is no part of "compiled"
    assert "  kernel " not in said


def test_help_names_the_pages_of_the_guide_with_a_heading_on_a_word(capsys):
    pm.help("cohesion")
    said = capsys.readouterr().out
    assert "CapillaryBridge" in said and "packmech guide cohesion" in said


def test_everyday_words_stand_for_public_names_and_help_says_where_it_finds_nothing(capsys):
    assert {name for names in pm._WORDS.values() for name in names} <= set(pm.__all__)
    assert not set(pm._WORDS) & set(pm.__all__)
    pm.help("qqqq")
    assert capsys.readouterr().out.startswith("nothing found for 'qqqq'")
