"""Facts about how the commands judge jamming: by the tolerance and the method asked for, and as Python does."""

import json
import subprocess
import sys

import pytest

import packmech as pm
from packmech import cli
from packmech.view.report import examine


def run(*words):
    return cli.execute(words)


@pytest.fixture
def apart(tmp_path):
    """Return the file of a crystal whose contacts have all opened by 1e-6."""
    pm.write_packing(pm.lattice_packing("triangular", (4, 4), relative_overlap=-1e-6), tmp_path / "apart.npz")
    return tmp_path / "apart.npz"


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_analyze_judges_by_the_gap_tolerance_and_the_method_asked_for(apart, method):
    written = []
    for words in ((), ("--gap-tolerance", "1e-5")):
        assert run("analyze", str(apart), *words, "--method", method, "--modes", "0", "--json", f"{apart}.json") == 0
        written.append(json.loads(apart.with_name("apart.npz.json").read_text()))
    assert [numbers["strict"] for numbers in written] == ["not jammed", "jammed"]
    assert [numbers["gap_tolerance"] for numbers in written] == [1e-9, 1e-5]
    assert [numbers["gap_rule"] for numbers in written] == ["max(7 x mean overlap, 1e-09)", "given"]
    assert {numbers["verdict_method"] for numbers in written} == {method}
    assert written[1]["verdict_bound"] == ("ball" if method == "loads" else None)


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_unjam_judges_by_the_gap_tolerance_and_the_method_asked_for(apart, method, capsys):
    words = ("--gap-tolerance", "1e-5", "--method", method, "--json", f"{apart}.json")
    assert run("unjam", str(apart), *words) == 1
    written = json.loads(apart.with_name("apart.npz.json").read_text())
    assert (written["strict"], written["method"], written["gap_tolerance"]) == ("jammed", method, 1e-5)
    assert "no unjamming motion" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["analyze", "unjam"])
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--method", "guess"), "method must be one of 'certificate', 'loads', got 'guess'"),
        (("--gap-tolerance", "2"), "gap_tolerance must be a finite number above -0.1 and below 1"),
        (("--gap-tolerance", "nan"), "gap_tolerance must be a finite number"),
    ],
)
def test_wrong_method_or_tolerance_is_refused_before_anything_is_made(apart, command, words, message):
    with pytest.raises(ValueError, match=message):
        run(command, str(apart), *words, "--json", f"{apart}.json")
    assert not apart.with_name("apart.npz.json").exists()


@pytest.mark.parametrize("given", [{"method": "guess"}, {"gap_tolerance": float("nan")}])
def test_report_refuses_them_too_instead_of_missing_a_verdict(given):
    with pytest.raises(ValueError, match=next(iter(given))):
        examine(pm.Scene(pm.lattice_packing("triangular", (2, 2)), (pm.Repulsion(),)), **given)


def test_python_runs_the_package_as_the_command(tmp_path):
    """The option -m finds the command where no script of that name is on the path."""
    found = [
        subprocess.run([sys.executable, "-m", "packmech", *words], capture_output=True, text=True, cwd=tmp_path)
        for words in (["--version"], ["unjam", "nonsense"])
    ]
    assert found[0].returncode == 0 and found[0].stdout.startswith("packmech ")
    assert found[1].returncode == 2 and found[1].stderr.startswith("packmech: packing must be a file or one of")
