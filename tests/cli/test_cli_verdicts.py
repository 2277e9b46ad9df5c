"""Facts about how the commands judge jamming: by the tolerance and the method asked for, and as Python does."""

import json
import subprocess
import sys

import numpy as np
import pytest

import packmech as pm
from packmech import cli
from packmech.files.archive import SEAL, write_archive
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


@pytest.mark.parametrize("lattice, answer", [("kagome", "not jammed"), ("triangular", "jammed")])
def test_certificates_of_commands_are_proven_and_tampered_ones_refused(lattice, answer, tmp_path, capsys):
    packing, certificate = tmp_path / "packing.npz", tmp_path / "certificate.npz"
    pm.write_packing(pm.lattice_packing(lattice, (3, 3)), packing)
    for words in (("analyze", packing, "--modes", "0"), ("unjam", lattice, "--repeats", "3", "3")):
        certificate.unlink(missing_ok=True)
        run(*map(str, words), "--certificate", str(certificate))
        assert f"packmech verify {certificate}" in capsys.readouterr().out
        assert run("verify", str(certificate), "--json", f"{packing}.json") == 0
        said = capsys.readouterr().out.splitlines()
        assert said[0] == "accepted" and said[2].startswith(f"strict: {answer}: ")
        written = json.loads((tmp_path / "packing.npz.json").read_text())
        assert written["accepted"] and written["strict"] == answer and written["reasons"] == said[1:4]
    with np.load(certificate) as file:
        held = {name: file[name] for name in file.files if name != SEAL}
    with open(certificate, "wb") as file:
        write_archive(file, held | {"radius_n": 1.01 * held["radius_n"]})
    assert run("verify", str(certificate)) == 1
    assert capsys.readouterr().out.splitlines()[0] == "refused"


def test_a_certificate_that_cannot_be_written_is_said_and_the_exit_code_tells(tmp_path, capsys):
    packing, certificate = tmp_path / "loose.npz", tmp_path / "certificate.npz"
    pm.write_packing(pm.random_packing(20, dimension=2, packing_fraction=0.8, seed=1), packing)
    assert run("analyze", str(packing), "--modes", "0", "--certificate", str(certificate)) == 1
    assert "no certificate is written: verdict must have an answer with grounds" in capsys.readouterr().err
    assert not certificate.exists()
    with pytest.raises(ValueError, match=r"certificate must be a file name ending in \.npz, got 'a.txt'"):
        run("analyze", str(packing), "--certificate", "a.txt")
    with pytest.raises(FileNotFoundError, match="path must name an existing file"):
        run("verify", str(certificate))
