"""Facts about the house: one direction of import, light to import, every public name explained by an example."""

import ast
import doctest
import importlib
import inspect
import pathlib
import pkgutil
import subprocess
import sys
import tomllib

import pytest

import packmech as pm

ROOT = pathlib.Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())

# each is imported where it is used, never by `import packmech` or by the physics
HEAVY = set("rerun dask gymnasium matplotlib cvxpy clarabel highspy gsd rich cyclopts pandas".split())


def modules_after(code):
    """Return the top-level modules loaded by a new process that runs the code."""
    script = f"{code}\nimport sys\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(done.stdout.split())


def test_imports_point_in_one_direction():
    linter = pytest.importorskip("importlinter.cli")
    assert linter.lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True) == 0


def test_import_packmech_loads_nothing_but_python():
    loaded = modules_after("import packmech")
    assert not loaded & (HEAVY | {"numpy", "scipy", "numba"})


def test_physics_loads_nothing_that_draws_records_or_solves_programs():
    code = """
import packmech as pm
scene = pm.read_scene("default")
pm.energy(scene), pm.forces(scene), pm.stress_tensor(scene), pm.find_contacts(scene.packing)
pm.write_scene, pm.read_packing, pm.hessian, pm.normal_modes, pm.elastic_moduli, pm.classify_jamming, pm.jam
"""
    assert not modules_after(code) & HEAVY


def test_top_level_holds_only_what_the_project_names():
    allowed = {"pyproject.toml", "packmech", "envs", "tests", "recordings", "README.md"}
    listed = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    top = {line.partition("/")[0] for line in listed.stdout.splitlines()}
    assert {name for name in top if not name.startswith(".")} <= allowed


def all_modules():
    return sorted(info.name for info in pkgutil.walk_packages(pm.__path__, "packmech."))


def test_every_public_name_is_found_and_listed():
    for name in pm.__all__:
        assert getattr(pm, name) is not None
    assert set(pm.__all__) <= set(dir(pm))
    with pytest.raises(AttributeError, match="has no attribute 'no_such_name'"):
        pm.no_such_name  # noqa: B018 - reading it is the test


def test_environments_use_only_public_names_and_only_by_pm():
    for path in (ROOT / "envs").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert (node.module or "").partition(".")[0] != "packmech", f"{path.name}:{node.lineno}"
            if isinstance(node, ast.Import):
                for one in node.names:
                    if one.name.partition(".")[0] == "packmech":
                        assert (one.name, one.asname) == ("packmech", "pm"), f"{path.name}:{node.lineno}"
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "pm":
                assert node.attr in pm.__all__, f"{path.name}:{node.lineno} pm.{node.attr}"


def test_environments_without_gymnasium_say_which_extra_to_install():
    code = """
import sys
sys.modules["gymnasium"] = None  # as where it is not installed
try:
    import packmech_envs
except ModuleNotFoundError as missing:
    assert 'pip install "packmech[envs]"' in str(missing), str(missing)
    assert missing.name == "gymnasium"
else:
    raise SystemExit("imported without gymnasium")
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_gymnasium_is_no_dependency_of_the_physics_but_of_the_environments_and_the_tests():
    project = PYPROJECT["project"]
    assert not any(one.startswith("gymnasium") for one in project["dependencies"])
    assert any(one.startswith("gymnasium") for one in project["optional-dependencies"]["envs"])
    assert "packmech[envs]" in project["optional-dependencies"]["test"]


def test_default_run_includes_the_examples_in_docstrings():
    options = PYPROJECT["tool"]["pytest"]["ini_options"]
    assert "--doctest-modules" in options["addopts"] and "packmech" in options["testpaths"]


def test_every_public_function_has_a_runnable_example():
    bare = []
    for name in pm.__all__:
        function = getattr(pm, name)
        if inspect.isfunction(function):
            module = importlib.import_module(function.__module__)
            found = doctest.DocTestFinder(recurse=False).find(function, name, module=module)
            if not any(test.examples for test in found):
                bare.append(name)
    assert bare == []


def test_every_public_name_says_what_it_is_in_one_first_line():
    first = {name: (inspect.getdoc(getattr(pm, name)) or "").partition("\n")[0] for name in pm.__all__}
    assert {name: line for name, line in first.items() if not (len(line) > 10 and line.endswith((".", ":")))} == {}


def test_every_module_can_be_imported_and_says_what_it_is_for():
    for name in all_modules():
        if not name.endswith("__main__"):
            assert (importlib.import_module(name).__doc__ or "").strip(), name


def test_every_room_has_its_place_in_the_order():
    contracts = {one["name"]: one for one in PYPROJECT["tool"]["importlinter"]["contracts"]}
    listed = {word.strip() for layer in contracts["The order of the rooms"]["layers"] for word in layer.split("|")}
    assert {path.parent.name for path in (ROOT / "packmech").glob("*/__init__.py")} == listed
