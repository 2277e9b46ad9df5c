"""Facts about compiled functions on disk: found again by a new process, never stale, nobody else's concern."""

import ast
import os
import pathlib
import subprocess
import sys

import pytest

import packmech
from packmech.compiled import _imported_files, _module_files, source_hash

PLAIN = """
import packmech as pm
from packmech.effects.pair import _contact_terms as kernel

packing = pm.random_packing(10, dimension=2, packing_fraction=0.9, seed=1)
energy = pm.energy(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)))
"""
OWN_LAW = """
from typing import NamedTuple
import packmech as pm
from packmech.effects.pair import _contact_terms as kernel

@pm.law
class Own(NamedTuple):
    energy_scale: float = 1.0

    def energy(self, distance, contact_distance):
        return FACTOR * self.energy_scale * (1.0 - distance / contact_distance) ** 4

    def first(self, distance, contact_distance):
        return -4.0 * FACTOR * self.energy_scale * (1.0 - distance / contact_distance) ** 3 / contact_distance

    def second(self, distance, contact_distance):
        return 12.0 * FACTOR * self.energy_scale * (1.0 - distance / contact_distance) ** 2 / contact_distance**2

packing = pm.random_packing(10, dimension=2, packing_fraction=0.9, seed=1)
scene = pm.Scene(packing, (pm.Repulsion(law=Own()),))
energy = pm.energy(scene)
for _ in range(3):
    pm.energy(scene)
"""
COUNTS = "\nprint(energy, sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values()))\n"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Run scripts one after the other, each in a new process, all with one cache: name -> (energy, hits, misses)."""
    folder = tmp_path_factory.mktemp("scripts")
    root = pathlib.Path(packmech.__file__).parents[1]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(root)}

    def run(script, text, *arguments):
        path = folder / script
        path.parent.mkdir(exist_ok=True)
        path.write_text(text + COUNTS)
        command = [sys.executable, *(arguments or (str(path),))]
        done = subprocess.run(command, env=environment, cwd=path.parent, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        energy, hits, misses = done.stdout.split()
        return float(energy), int(hits), int(misses)

    quarter, half = (OWN_LAW.replace("FACTOR", factor) for factor in ("0.25", "0.5"))
    return {
        # a module that the scripts in the other folder cannot import
        "module": run("library/own_module.py", quarter, "-c", "import own_module"),
        "plain": run("scripts/plain.py", PLAIN),
        "plain again": run("scripts/plain.py", PLAIN),
        "own": run("scripts/own.py", quarter),
        "own again": run("scripts/own.py", quarter),
        "own changed": run("scripts/own.py", half),
    }


def test_a_new_process_finds_the_compiled_function_on_disk(runs):
    assert runs["plain"][1:] == (0, 1) and runs["plain again"][1:] == (1, 0)
    assert runs["plain"][0] == runs["plain again"][0]


def test_a_users_law_is_compiled_once_and_looked_up_once_by_the_next_process(runs):
    # four calls in each process
    assert runs["own"][1:] == (0, 1) and runs["own again"][1:] == (1, 0)
    assert runs["own"][0] == runs["own again"][0] == runs["module"][0]


def test_a_changed_law_is_compiled_anew(runs):
    assert runs["own changed"][1:] == (0, 1)
    assert runs["own changed"][0] == pytest.approx(2 * runs["own"][0], rel=1e-15)


def test_a_users_law_in_the_cache_is_not_imported_by_other_scripts(runs):
    # what it would print shows that the module ran once; the scripts elsewhere could not even find it
    assert runs["module"][1:] == (0, 1) and runs["plain"][1:] == (0, 1)


def test_hash_of_a_file_sees_a_change_in_any_packmech_file_that_it_imports(tmp_path, monkeypatch):
    from packmech import compiled

    package = tmp_path / "packmech"
    package.mkdir()
    (package / "outer.py").write_text("from packmech.inner import f\n")
    inner = package / "inner.py"
    monkeypatch.setattr(compiled, "_PACKAGE", package)
    hashes = []
    for text in ("f = 1\n", "f = 2\n", "f = 1\n"):
        inner.write_text(text)
        for cached in (compiled._file_hash, compiled._imported_files, compiled.source_hash):
            cached.cache_clear()
        hashes.append(source_hash(package / "outer.py"))
    for cached in (compiled._file_hash, compiled._imported_files, compiled.source_hash):
        cached.cache_clear()
    assert hashes[0] == hashes[2] != hashes[1]


def test_imports_are_found_as_a_parser_finds_them():
    for path in pathlib.Path(packmech.__file__).parent.rglob("*.py"):
        found = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            for name in names:
                if name.split(".")[0] == "packmech" and name != "packmech":
                    found.update(_module_files(name))
        assert _imported_files(path) == tuple(sorted(found)), path.name
