"""Facts about compiled functions on disk: found again by a new process, never stale, nobody else's concern."""

import ast
import os
import pathlib
import subprocess
import sys
import time
from typing import NamedTuple

import pytest

import packmech
from packmech.jit import source_key as keys
from packmech.jit.source_key import code_of, imported_files, module_files, source_hash, source_key

CACHED = (keys._text, keys._hash_and_imports, source_hash)

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


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a function that writes a package of two files and gives the hash of the outer one."""

    def hash_of(inner, folder="here"):
        root = tmp_path / folder / "packmech"
        root.mkdir(parents=True, exist_ok=True)
        (root / "outer.py").write_text("from packmech.inner import f\n")
        (root / "inner.py").write_text(inner)
        monkeypatch.setattr(keys, "PACKAGE", root)
        monkeypatch.setattr(keys, "_IMPORTED", time.time() + 1.0)
        for cached in CACHED:
            cached.cache_clear()
        return source_hash(root / "outer.py")

    yield hash_of
    for cached in CACHED:
        cached.cache_clear()


def test_hash_of_a_file_sees_a_change_in_any_packmech_file_that_it_imports(package):
    hashes = [package(text) for text in ("f = 1\n", "f = 2\n", "f = 1\n")]
    assert hashes[0] == hashes[2] != hashes[1]


def test_hash_of_a_file_is_the_same_wherever_the_sources_lie(package):
    assert package("f = 1\n", "here") == package("f = 1\n", "there") is not None


def test_a_file_that_changed_after_packmech_was_imported_has_no_hash(package, monkeypatch):
    assert package("f = 1\n") is not None
    monkeypatch.setattr(keys, "_IMPORTED", time.time() - 60.0)
    for cached in CACHED:
        cached.cache_clear()
    assert source_hash(keys.PACKAGE / "outer.py") is None


def test_key_of_a_record_class_sees_the_order_of_its_fields():
    def method(self):
        return self.a

    one, other = (NamedTuple("Own", [(name, float) for name in names]) for names in ("ab", "ba"))
    one.value = other.value = method
    assert source_key(one) != source_key(other)


def test_hash_of_a_file_does_not_see_docstrings_comments_and_imports_for_types(package):
    plain = 'def f(x):\n    """Return it."""\n    return x\n'
    told = "# why\n" + plain.replace("Return it.", 'Return x: a "number".\n\n    # ok\n    ')
    typed = "if TYPE_CHECKING:\n    from packmech.outer import g\n    import packmech.outer\n\n" + plain
    assert package(plain) == package(told) == package(typed) != package(plain.replace("return x", "return -x"))


class Bare(ast.NodeTransformer):
    """Empties docstrings and leaves out imports that are for type checkers only."""

    def visit(self, node):
        self.generic_visit(node)
        for_types = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        if for_types and all(isinstance(one, ast.Import | ast.ImportFrom) for one in node.body):
            return None
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if documented and ast.get_docstring(node) is not None:
            node.body[0].value.value = ""
        return node


FILES = sorted(pathlib.Path(packmech.__file__).parent.rglob("*.py"))


def test_code_of_every_file_is_what_a_parser_keeps():
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        assert ast.dump(ast.parse(code_of(text))) == ast.dump(Bare().visit(ast.parse(text))), path.name


def test_imports_are_found_as_a_parser_finds_them():
    for path in FILES:
        code = code_of(path.read_text(encoding="utf-8"))
        found = set()
        for node in ast.walk(ast.parse(code)):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            for name in names:
                if name.split(".")[0] == "packmech" and name != "packmech":
                    found.update(module_files(name))
        assert imported_files(code) == found, path.name


def test_the_key_of_a_class_depends_on_its_attributes_that_are_numbers():
    """Whether an effect begins at contact is compiled in, and no method says so."""

    def made(**attributes):
        return type("Sticky", (), {"__module__": "mine", "reach": lambda self, x: 1.1 * x, **attributes})

    plain, same, other, more = (
        source_key(made(**one)) for one in ({}, {}, {"begins_at_contact": True}, {"begins_at_contact": False})
    )
    assert plain == same and len({plain, other, more}) == 3
