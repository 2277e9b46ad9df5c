"""Facts about machine code on disk: it is the right code or none, whatever happens to the files."""

import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

import pytest
from numba.core import config

import packmech
from packmech.effects.laws import Harmonic, Hertz, law_energy
from packmech.effects.partners import equal_partners
from packmech.jit import cache
from packmech.jit.compiled import kernel

ROOT = pathlib.Path(packmech.__file__).parents[1]
LAWS = (Harmonic(), Hertz())
# overlap 0.36 of 1: 0.36**2 / 2 and 0.36**2.5 / 2.5
ENERGIES = [pytest.approx(0.0648, rel=1e-14), pytest.approx(0.031104, rel=1e-14)]


def energy(law, distance):
    """Return the energy of a pair with contact distance 1."""
    return law_energy(law, distance, equal_partners(1.0))


def as_a_new_process():
    """Return the energies under both laws, and how many codes were found on disk."""
    new = kernel(energy)
    return [new(law, 0.64) for law in LAWS], sum(new.stats.cache_hits.values())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a new cache folder with the code of two laws in it, and count warnings anew."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(cache._Process, "warned", False)
    config.reload_config()
    assert as_a_new_process() == (ENERGIES, 0)
    yield tmp_path / "packmech"
    monkeypatch.undo()
    config.reload_config()


def flipped(place):
    """Return what flips a bit of a file at a place between its start, 0, and its end, 1."""

    def flip(path):
        content = bytearray(path.read_bytes())
        content[int(place * (len(content) - 1))] ^= 4
        path.write_bytes(content)

    return flip


def swapped(path):
    """Give each file of the folder the name of the other."""
    other = next(one for one in path.parent.iterdir() if one != path)
    mine, others = path.read_bytes(), other.read_bytes()
    path.write_bytes(others)
    other.write_bytes(mine)


def halved(path):
    os.truncate(path, path.stat().st_size // 2)


def replaced_by_a_folder(path):
    path.unlink()
    (path / "inside").mkdir(parents=True)


DAMAGES = {
    "emptied": (lambda path: path.write_bytes(b""), 1),
    "halved": (halved, 1),
    "one byte too long": (lambda path: path.write_bytes(path.read_bytes() + b"x"), 1),
    "removed": (lambda path: path.unlink(), 1),
    "of something else": (lambda path: path.write_bytes(os.urandom(5000)), 1),
    "swapped": (swapped, 0),
    **{f"flipped at {place}": (flipped(place), 1) for place in (0.0, 1e-4, 2e-3, 0.01, 0.1, 0.5, 0.9, 1.0)},
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_file_is_compiled_anew_and_then_whole_again(folder, damage):
    harm, hits = DAMAGES[damage]
    harm(sorted(folder.iterdir())[0])
    assert as_a_new_process() == (ENERGIES, hits)
    assert as_a_new_process() == (ENERGIES, 2)


def test_payload_that_loads_as_nothing_of_numbas_is_compiled_anew(folder):
    # whole by its checksum and key, but not what numba of this version reads
    for path in folder.iterdir():
        body = path.read_bytes()[cache._DIGEST :]
        length = int.from_bytes(body[: cache._LENGTH], "big")
        path.write_bytes(cache._packed(body[cache._LENGTH : cache._LENGTH + length], b"not a pickle"))
    assert as_a_new_process() == (ENERGIES, 0)
    assert as_a_new_process() == (ENERGIES, 2)


def no_space(path, content):
    raise OSError(28, "No space left on device")


def unpicklable(data):
    raise TypeError("cannot pickle this")


@pytest.mark.parametrize(
    "trouble", ["full", "full halfway", "a file in the way", "a folder in the way", "not picklable"]
)
def test_code_that_cannot_be_written_runs_with_one_warning_and_leaves_nothing(folder, trouble, monkeypatch):
    for path in folder.iterdir():
        path.unlink()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    if trouble == "full":
        monkeypatch.setattr(pathlib.Path, "write_bytes", no_space)
    elif trouble == "full halfway":
        # files hold a thousand bytes at most: writing fails after those
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    elif trouble == "a file in the way":
        folder.rmdir()
        folder.write_text("")
    elif trouble == "a folder in the way":
        as_a_new_process()
        for path in folder.iterdir():
            replaced_by_a_folder(path)
    else:
        monkeypatch.setattr(cache, "dumps", unpicklable)
    try:
        with pytest.warns(RuntimeWarning, match="set NUMBA_CACHE_DIR to a folder that can be written") as told:
            assert as_a_new_process() == (ENERGIES, 0)
            assert as_a_new_process() == (ENERGIES, 0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(told) == 1
    left = list(folder.iterdir()) if folder.is_dir() else []
    assert all(path.is_dir() for path in left)


PLACES = """
import json, os, pathlib, sys, warnings
from numba.core import config
from packmech.effects.laws import Harmonic, law_energy
from packmech.effects.partners import equal_partners
from packmech.jit import cache
from packmech.jit.compiled import kernel

def energy(law, distance):
    return law_energy(law, distance, equal_partners(1.0))

def again(law, distance):
    return law_energy(law, distance, equal_partners(1.0))

top = pathlib.Path(sys.argv[1])
kernel(energy)(Harmonic(), 0.64)  # what numba imports late is imported; the code lies in the first folder
if os.getuid() == 0:
    os.setuid(65534)  # no bit of a folder's mode binds root

def tried(chosen, package, home):
    os.environ.pop("NUMBA_CACHE_DIR", None)
    if chosen:
        os.environ["NUMBA_CACHE_DIR"] = str(top / chosen)
    os.environ["HOME"] = str(top / home)
    cache.PACKAGE = top / package
    config.reload_config()
    cache._Process.warned = False
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        made = [kernel(energy), kernel(again)]
        values = [one(Harmonic(), 0.64) for one in made]
    hits = [sum(one.stats.cache_hits.values()) for one in made]
    return values, hits, [str(one.message) for one in told]

cases = [("first", "no", "no"), ("no", "yes", "yes"), (None, "no", "no"), (None, "no", "yes"), (None, "no", "yes"),
         (None, "yes", "no"), (None, "none/at/all", "no")]
print(json.dumps([tried(*case) for case in cases]))
"""


@pytest.fixture(scope="module")
def places():
    """Return what a process that may not write everywhere finds on disk and warns of, by where it may."""
    with tempfile.TemporaryDirectory() as name:
        top = pathlib.Path(name)
        for folder, mode in (("first", 0o755), ("no", 0o555), ("yes", 0o777)):
            (top / folder).mkdir()
            (top / folder).chmod(mode)
        top.chmod(0o755)
        script = top / "script.py"
        script.write_text(PLACES)
        environment = os.environ | {"NUMBA_CACHE_DIR": str(top / "first"), "PYTHONPATH": str(ROOT)}
        environment.pop("XDG_CACHE_HOME", None)
        command = [sys.executable, str(script), str(top)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        files = {folder: len(list((top / folder).rglob("*.nbc"))) for folder in ("first", "no", "yes")}
    assert all(values == [ENERGIES[0]] * 2 for values, _, _ in found)
    names = ("kept, read-only", "chosen, read-only", "nowhere", "home", "home again", "package", "no folder")
    return dict(zip(names, ((hits, len(told)) for _, hits, told in found), strict=True)), files


def test_code_in_a_folder_that_cannot_be_written_is_used(places):
    # the other function's code is not there, and cannot be kept
    assert places[0]["kept, read-only"] == ([1, 0], 1)


@pytest.mark.parametrize("where", ["chosen, read-only", "nowhere", "no folder"])
def test_no_place_to_write_costs_one_warning(places, where):
    assert places[0][where] == ([0, 0], 1)


def test_code_goes_to_the_users_folder_where_the_package_cannot_be_written(places):
    assert places[0]["home"] == ([0, 0], 0) and places[0]["home again"] == ([1, 1], 0)


def test_code_goes_beside_the_package_where_that_can_be_written(places):
    assert places[0]["package"] == ([0, 0], 0)
    assert places[1] == {"first": 1, "no": 0, "yes": 4}


RACE = """
import os, pathlib, sys, time
from packmech.effects.laws import Harmonic, Hertz, law_energy
from packmech.effects.partners import equal_partners
from packmech.jit.compiled import kernel

def energy(law, distance):
    return law_energy(law, distance, equal_partners(1.0))

who, turns = sys.argv[1:]
law = {"a": Harmonic(), "b": Hertz()}[who]
if turns != "-":
    turns, replace = iter(turns.split(",")), os.replace

    def arrive(name):
        pathlib.Path(name + who).touch()

    def wait_for_other(name):
        other = pathlib.Path(name + "ab".replace(who, ""))
        began = time.monotonic()
        while not other.exists():
            assert time.monotonic() - began < 60.0, "the other process never came"
            time.sleep(0.002)

    def in_turn(source, target):
        turn = next(turns)
        arrive(turn + "-ready-")
        wait_for_other(turn + "-ready-")
        if not turn.endswith(who + "-first"):
            wait_for_other(turn + "-done-")
        replace(source, target)
        arrive(turn + "-done-")

    os.replace = in_turn
made = kernel(energy)
print(made(law, 0.64), sum(made.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("turns", ["1-a-first,2-b-first", "1-b-first,2-a-first"])
def test_processes_that_compile_different_laws_at_the_same_moment_do_not_exchange_code(turns, tmp_path):
    # both have compiled before either writes; where a writer moves two files into place, the order turns between them
    script = tmp_path / "race.py"
    script.write_text(RACE)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def of_both(turns):
        commands = [[sys.executable, script.name, who, turns] for who in "ab"]
        running = [
            subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
            for command in commands
        ]
        printed = [one.communicate()[0].split() for one in running]
        assert all(one.returncode == 0 for one in running)
        return [(float(value), int(hits)) for value, hits in printed]

    assert of_both(turns) == [(ENERGIES[0], 0), (ENERGIES[1], 0)]
    assert (tmp_path / "1-a-first-done-a").exists() or (tmp_path / "1-b-first-done-b").exists()
    assert of_both("-") == [(ENERGIES[0], 1), (ENERGIES[1], 1)]


def test_key_says_nothing_of_where_the_sources_lie(folder):
    for path in folder.iterdir():
        body = path.read_bytes()[cache._DIGEST :]
        key = body[cache._LENGTH : cache._LENGTH + int.from_bytes(body[: cache._LENGTH], "big")].decode()
        assert "energy" in key and str(ROOT) not in key and str(pathlib.Path.home()) not in key


def test_code_of_a_function_made_in_another_is_not_kept(folder):
    factor = len(os.sep) + 2.0

    def scaled(number):
        return factor * number

    before = sorted(folder.iterdir())
    assert kernel(scaled)(2.0) == 6.0
    assert sorted(folder.iterdir()) == before


def test_full_folder_loses_what_was_used_longest_ago(tmp_path):
    for age, name in enumerate(("d.nbc", "c.nbc", "b.nbc", "a.nbc", "writing.tmp")):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (time.time() - 3600.0 * age,) * 2)
    cache._prune(tmp_path, limit=400)
    assert len(list(tmp_path.iterdir())) == 5
    cache._prune(tmp_path, limit=399)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["d.nbc", "writing.tmp"]
    os.utime(tmp_path / "writing.tmp", (time.time() - 3e5,) * 2)
    cache._prune(tmp_path, limit=400)
    assert [path.name for path in tmp_path.iterdir()] == ["d.nbc"]
