"""Facts about the public names: which there are, where they are, and what is said of names that are none."""

import importlib
import inspect
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
