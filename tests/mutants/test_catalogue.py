"""The catalogue of small faults: its texts stand in their files, and a fault in a copy of the checkout is noticed."""

import importlib.util
import os
import time
from pathlib import Path

import pytest
from mutants import warm
from mutants.catalogue import CATALOGUE, TESTS, Fault, read_drawn, stands
from mutants.generate import changes, generated
from mutants.warm import changed_functions

ROOT = Path(__file__).resolve().parents[2]


def test_every_text_stands_once_in_its_file_and_the_fault_is_python():
    text = {}
    for one in CATALOGUE:
        text.setdefault(one.file, (ROOT / one.file).read_text(encoding="utf-8"))
        assert text[one.file].count(one.was) == 1, one.key
        compile(one.put_into(text[one.file]), one.file, "exec")
    assert len({one.key for one in CATALOGUE}) == len(CATALOGUE)


def test_the_named_tests_are_there():
    named = {name for tests in TESTS.values() for name in tests} | {name for one in CATALOGUE for name in one.tests}
    assert [name for name in sorted(named) if not (ROOT / name.partition("::")[0]).is_file()] == []
    assert {one.file for one in CATALOGUE if not one.tests} <= set(TESTS)


def test_generated_faults_are_those_of_the_rules_and_of_the_seed():
    text = "def f(a, b):\n    return max(a - 1, 0) if not a <= b else 2.5  # é\n"
    found = {what: text.encode()[:start].decode() + now + text.encode()[end:].decode()
             for what, (start, end, now) in changes(text)}  # fmt: skip
    assert found["line 2: <= is <"] == text.replace("<=", "<") and found["line 2: - is +"] == text.replace("-", "+")
    assert found["line 2: not dropped"] == text.replace("not ", "") and found["line 2: 2.5 is 5.0"] == text.replace(
        "2.5", "5.0"
    )
    assert found["line 2: max is min"] == text.replace("max", "min") and found["line 2: 0 is 1"] == text.replace(
        "0)", "1)"
    )
    assert found["line 2: the condition is False"] == text.replace("not a <= b", "False")
    wrapped = "x = -(1.0 - y) + ~(z)\n"
    now = [wrapped[:start] + other + wrapped[end:] for _, (start, end, other) in changes(wrapped)]
    assert "x = (1.0 - y) + ~(z)\n" in now and "x = -(1.0 - y) + (z)\n" in now
    for one in now:
        compile(one, "x", "exec")
    file = "packmech/mechanics/stability.py"
    one, other = (generated(ROOT, file, seed=0, count=5) for _ in range(2))
    assert one == other and len({fault.key for fault in one}) == len({fault.now for fault in one}) == 5
    text = (ROOT / file).read_text(encoding="utf-8")
    for fault in one:
        assert len(fault.was) < 200
        compile(fault.put_into(text), file, "exec")


def test_most_faults_that_were_drawn_and_kept_still_stand_and_have_names_of_their_own():
    drawn = read_drawn()
    assert len({one.key for one in [*drawn, *CATALOGUE]}) == len(drawn) + len(CATALOGUE)
    assert {one.file for one in drawn if not one.tests} <= set(TESTS)
    # those whose text was edited since are not tried: too many of them ask for others to be drawn
    standing = [one for one in drawn if stands(one, ROOT)]
    assert len(standing) > 0.8 * len(drawn)
    for one in standing:
        compile(one.put_into((ROOT / one.file).read_text(encoding="utf-8")), one.file, "exec")


def test_a_fork_takes_what_changes_in_plain_functions_and_nothing_else():
    text = "LIMIT = 1.0\n\n\nclass Law:\n    scale = 2.0\n\n    def force(self, x):\n        return -x * LIMIT\n"
    was = compile(text, "law.py", "exec")

    def changed(old, new):
        found = changed_functions(was, compile(text.replace(old, new), "law.py", "exec"))
        return None if found is None else [code.co_qualname for code in found]

    assert changed("-x", "x") == ["Law.force"] and changed("\n\n\n", "\n\n\n\n") == []
    assert changed("= 1.0", "= 2.0") is None and changed("= 2.0", "= 3.0") is None


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="what a process does is read from /proc")
def test_a_fork_that_waits_without_end_is_ended_and_one_that_ends_says_how(monkeypatch):
    monkeypatch.setattr(warm, "_IDLE", 0.5)
    for seconds, ended in ((1000.0, None), (0.0, 3)):
        child = os.fork()
        if child == 0:
            time.sleep(seconds)
            os._exit(3)
        status = warm._end_of(child)
        assert status == ended or os.waitstatus_to_exitcode(status) == ended


def test_a_fault_is_killed_by_a_test_that_notices_and_survives_one_that_does_not(tmp_path):
    spec = importlib.util.spec_from_file_location("mutants_command", Path(__file__).with_name("__main__.py"))
    command = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(command)
    (tmp_path / "law.py").write_text("def force(x):\n    return -2.0 * x\n")
    (tmp_path / "test_law.py").write_text(
        "from law import force\n\ndef test_sign():\n    assert force(1.0) < 0.0\n\n"
        "def test_size():\n    assert force(1.0) == -2.0\n"
    )
    fault = Fault("law.py", "twice the force", "2.0", "4.0", ("test_law.py",))
    assert command.outcome(tmp_path, fault, 60)[:2] == ("killed", "test_law.py::test_size")
    blind = fault._replace(tests=("test_law.py::test_sign",))
    assert command.outcome(tmp_path, blind, 60)[:2] == ("survived", "")
    assert (tmp_path / "law.py").read_text() == "def force(x):\n    return -2.0 * x\n"
    with pytest.raises(ValueError, match="must stand once"):
        command.outcome(tmp_path, fault._replace(was="3.0"), 60)
    table = tmp_path / "table.md"
    rows = {fault.key: command.row_of(fault, "killed", 1.2, "a | b")}
    command.write_table(table, rows)
    assert command.read_table(table) == rows and "tried 1, killed 1" in table.read_text()
