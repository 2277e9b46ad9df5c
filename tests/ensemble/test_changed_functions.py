"""A folder never mixes what two versions of a function gave, and an unchanged one is never refused."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

import packmech as pm
from packmech.ensemble.function_text import file_key, text_key

FIRST = """
import numpy as np
from beside import twice

FACTORS = [1, np.int64(10)]
KINDS = (twice, abs)


class Base:
    offset = 0


class Shift(Base):
    def moved(self, x):
        return x + self.offset + extra(x)


def extra(x):
    "What nothing depends on but a method."
    return KINDS[0](0 * x)


def decorated(function):
    def inner(x, shift=Shift()):
        return function(x, shift)
    return inner


@decorated
def job(x, shift):
    values = {"y": shift.moved(x) * FACTORS[1]}
    return values  # a comment


def other(x):
    return x


if __name__ == "__main__":
    y = shift = values = 3
"""
BESIDE = "def twice(x):\n    return 2 * x\n"
# what changes what the job gives, or may
CHANGES = {
    "a constant of any kind": ("np.int64(10)", "np.int64(20)"),
    "a tuple of functions": ("(twice, abs)", "(abs, twice)"),
    "a base class": ("offset = 0", "offset = 1"),
    "what a method calls": ("(0 * x)", "(1 * x)"),
    "the body of a decorator": ("return function(x, shift)", "return function(-x, shift)"),
    "the function": ('"y":', '"z":'),
    "a default": ("shift=Shift()", "shift=None"),
}
SAME = {
    "a comment": ("# a comment", "# another"),
    "a docstring": ("What nothing", "What little"),
    "another function": ("def other(x):\n    return x", "def other(x):\n    return -x"),
    "what runs as a script": ("y = shift = values = 3", "y = shift = values = 4"),
    "layout": ('"y": shift.moved(x) * FACTORS[1]', '"y":\n        shift.moved(x) * FACTORS[1]'),
}


@pytest.fixture
def written(tmp_path):
    """Return a function that writes the files with a change, and returns the first."""
    (tmp_path / "beside.py").write_text(BESIDE)

    def write(old="", new=""):
        assert old in FIRST
        (tmp_path / "mine.py").write_text(FIRST.replace(old, new) if old else FIRST)
        return tmp_path / "mine.py"

    return write


@pytest.mark.parametrize("change", CHANGES)
def test_what_the_function_depends_on_changes_its_key(change, written):
    first = text_key(written(), "job")
    assert first is not None and text_key(written(*CHANGES[change]), "job") != first


@pytest.mark.parametrize("change", SAME)
def test_what_it_does_not_depend_on_leaves_its_key(change, written):
    assert text_key(written(*SAME[change]), "job") == text_key(written(), "job")


def test_a_module_beside_counts_and_a_changed_entry_of_a_constant(written, tmp_path):
    first, loaded = text_key(written(), "job"), file_key(tmp_path / "mine.py")
    (tmp_path / "beside.py").write_text(BESIDE.replace("2 * x", "3 * x"))
    assert text_key(tmp_path / "mine.py", "job") != first and file_key(tmp_path / "mine.py") != loaded
    (tmp_path / "beside.py").write_text(f"# a comment\n{BESIDE}")
    assert text_key(tmp_path / "mine.py", "job") == first
    (tmp_path / "mine.py").write_text(FIRST + "\n\nFACTORS[1] = 7\n")
    assert text_key(tmp_path / "mine.py", "job") != first
    assert text_key(tmp_path / "mine.py", "missing") is None and text_key(tmp_path / "none.py", "job") is None


def run(code, folder):
    """Run a script of its own in a process of its own; return what it prints."""
    (folder / "script.py").write_text(textwrap.dedent(code))
    done = subprocess.run([sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


SCRIPT = """
import pathlib, sys
import packmech as pm

half = lambda x: x / 2
KINDS, DONE = (half, abs), 0
HERE = str(pathlib.Path(__file__).parent)


def job(x, folder):
    global DONE
    DONE += 1
    found = pm.pressure, HERE
    if x == 1:
        # the file changes while members run
        own = pathlib.Path(__file__)
        own.write_text("# new\\n" + own.read_text())
    return {"y": 10 * KINDS[0](x)}


if __name__ == "__main__":
    pressure = len(sys.argv)
    found = pm.run_ensemble(job, {"x": [1, 2, 3]}, "out", workers=1)
    print(*found["state"], *found["y"])
"""


def test_a_script_is_not_refused_for_what_it_is_not_written_as(tmp_path):
    """Not for names that only the running script has, values that its job changes, or a file edited on the way."""
    assert run(SCRIPT, tmp_path) == ["done"] * 3 + ["5.0", "10.0", "15.0"]
    assert run(SCRIPT, tmp_path) == ["done"] * 3 + ["5.0", "10.0", "15.0"]


def test_a_changed_function_of_a_file_is_refused_by_run_and_resume(tmp_path):
    file, folder = tmp_path / "jobs_that_change.py", tmp_path / "out"
    code = "FACTOR = 10\n\ndef job(x):\n    return {'y': x * FACTOR}\n"

    def carried_out(call):
        text = (
            f"import packmech as pm\ntry:\n    print(*pm.{call}['y'])\nexcept ValueError as error:\n    print(error)\n"
        )
        return " ".join(run(text, tmp_path))

    started = "run_ensemble('jobs_that_change.py:job', {'x': [1, %d]}, 'out', workers=1)"
    file.write_text(code)
    assert carried_out(started % 2) == "10 20"
    file.write_text(code.replace("10", "20"))
    assert "folder must hold members of the same job, or be new" in carried_out(started % 3)
    assert "with a job that was written otherwise" in carried_out(started % 3)
    assert "job must be written as when the folder was made, got a changed job" in carried_out(
        "resume_ensemble('out', trust=True)"
    )
    file.write_text(f"# a comment\n{code}")
    assert carried_out(started % 3) == "10 20 30"
    assert carried_out("resume_ensemble('out', trust=True)") == "10 20 30"
    assert folder.exists()


EDITED = """
import pathlib
import packmech as pm

if __name__ == "__main__":
    file = pathlib.Path("edited_job.py")
    for folder, factor in (("one", 10), ("two", 20)):
        file.write_text(f"def job(x):\\n    return {{'y': {factor} * x}}\\n")
        print(*pm.run_ensemble("edited_job.py:job", {"x": [1, 2]}, folder, workers=1)["y"])
"""


def test_a_file_edited_between_two_runs_of_one_process_runs_into_a_new_folder(tmp_path):
    assert run(EDITED, tmp_path) == ["10", "20", "20", "40"]


def test_a_changed_file_that_is_loaded_is_another_job(tmp_path):
    file = tmp_path / "laws.py"
    file.write_text("SCALE = 1.0\n")
    pm.run_ensemble(lambda x: x, {"x": [1]}, tmp_path / "out", workers=0, load=[file])
    file.write_text("SCALE = 2.0\n")
    with pytest.raises(ValueError, match="with files to load that were written otherwise"):
        pm.run_ensemble(lambda x: x, {"x": [1]}, tmp_path / "out", workers=0, load=[file])


def test_failed_members_of_a_call_give_a_warning(tmp_path):
    def inverse(x):
        return {"y": 1.0 / x}

    with pytest.warns(
        UserWarning, match="1 of 2 members failed, the first with ZeroDivisionError: float division by zero"
    ):
        pm.run_ensemble(inverse, {"x": [0, 1]}, tmp_path / "out", workers=0)
    # of other members of the folder nothing is said
    assert pm.run_ensemble(inverse, {"x": [2]}, tmp_path / "out", workers=0).counts()["failed"] == 1
