"""What the members of an ensemble run, as a table that any process can read: a scene with its drive, or a function."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import numbers
import os
import site
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech
from packmech.check import boolean, brief, did_you_mean, listed, one_of
from packmech.ensemble.folder import ARRAYS, CHECKPOINT, FAILURE, RESULT, STATE_POINT, MemberOutcome
from packmech.ensemble.function_text import file_key, first_text_key, own_text_key, text_key
from packmech.ensemble.members import Member
from packmech.files.archive import SEAL
from packmech.files.modules import load_modules
from packmech.files.paths import PathLike
from packmech.jit.source_key import function_key
from packmech.packing import Packing
from packmech.result import NotConverged, Run
from packmech.scene import Scene, scene_after
from packmech.scenes import run as run_drive
from packmech.scenes import takes_checkpoint
from packmech.scenes.recipes import is_random
from packmech.scenes.scene_file import list_scenes, read_scene_tables, scene_of_tables, write_scene
from packmech.view.report import examine

Functions = Mapping[str, Callable[..., Any]]

SEEDING = ("parameters", "seed")
# what a run says of its cost: of no interest to a table of results, and never the same twice
_COSTS = ("seconds", "build_seconds", "verdict_seconds")
_SCALAR = bool | int | float | str | np.generic
# names of a member's files that no result may take
_TAKEN = {Path(name).stem for name in (STATE_POINT, RESULT, FAILURE, CHECKPOINT, ARRAYS)} | {SEAL, "file"}


def job_table(
    job: Any,
    *,
    measures: Sequence[Any] | None = None,
    seeding: str = "parameters",
    check: bool = True,
    keep_packings: bool = True,
    load: Sequence[PathLike] = (),
    here: bool = False,
) -> dict[str, Any]:
    """Return what `run_ensemble` was given as a table that JSON knows.

    Raises
    ------
    TypeError, ValueError
        If it cannot be run in another process, unless it is to run in this one (`here`).

    """
    one_of("seeding", seeding, SEEDING)
    boolean("check", check)
    boolean("keep_packings", keep_packings)
    files = load_modules(load)
    table: dict[str, Any] = {
        "seeding": seeding,
        "check": check,
        "keep_packings": keep_packings,
        "load": [str(one.absolute()) for one in files],
        **({"loaded": [file_key(one) for one in files]} if files else {}),
        "measures": None
        if measures is None
        else [_measure(one, here) for one in listed("measures", measures, "names and functions")],
    }
    named = _named_function(job)
    if callable(job) or named is not None:
        if measures is not None and any(callable(one) for one in measures):
            raise ValueError("measures must be names where job is a function: it returns what it measures")
        reference = _reference("job", job, here) if named is None else named
        if named is not None or not here:
            function_at(reference, "job")
        return table | {"function": _with_text(reference)}
    if isinstance(job, Scene):
        with tempfile.TemporaryDirectory() as place:
            write_scene(job, Path(place) / "scene.toml")
            tables, folder = read_scene_tables(Path(place) / "scene.toml")
        name = "scene"
    elif isinstance(job, str | os.PathLike):
        name = os.fspath(job)
        try:
            tables, folder = read_scene_tables(job)
        except FileNotFoundError:
            raise ValueError(
                f"job must be a scene file that exists, a shipped scene ({', '.join(list_scenes())}) or a function "
                f"such as file.py:name, got {brief(name)}"
            ) from None
    else:
        raise TypeError(f"job must be a scene file, a pm.Scene or a function, got {brief(job)}")
    if "drive" not in tables:
        raise ValueError(f"job must be a scene with a drive, got {brief(name)} without")
    # only packings in other files are looked for beside the scene's
    place = str(folder.absolute()) if "path" in tables.get("packing", {}) else ""
    return table | {"scene": tables, "name": Path(name).name, "folder": place}


def functions_of(job: Any, measures: Sequence[Any] | None) -> Functions:
    """Return the functions among what `run_ensemble` was given by their names in its table."""
    given = [one for one in (job, *(measures or ())) if callable(one)]
    named = {_reference("job", one, here=True)["name"]: one for one in given}
    if len(named) < len(given):
        raise ValueError(f"measures must be functions of different names, got {', '.join(map(brief, measures or ()))}")
    return named


def _measure(measure: Any, here: bool) -> Any:
    if isinstance(measure, str):
        found = _named_function(measure)
        if found is None:
            return measure
        function_at(found, "measures")
        return _with_text(found)
    if not callable(measure):
        raise TypeError(f"measures must be names or functions, got {brief(measure)}")
    return _with_text(_reference("measures", measure, here))


def _named_function(job: Any) -> dict[str, str] | None:
    """Return the function that a text names, as in "file.py:name" or "package.module:name"; None if it names none."""
    if not isinstance(job, str) or ":" not in job:
        return None
    where, _, name = job.rpartition(":")
    if not name.isidentifier():
        return None
    if where.endswith(".py"):
        if not Path(where).is_file():
            raise ValueError(f"job must name a function in an existing file, got {brief(job)}")
        return {"module": Path(where).stem, "name": name, "root": str(Path(where).absolute().parent)}
    return {"module": where, "name": name, "root": ""}


def _reference(argument: str, function: Any, here: bool = False) -> dict[str, str]:
    """Return where another process finds a function; what it is called where that is of no matter (`here`)."""
    name, module = getattr(function, "__qualname__", ""), getattr(function, "__module__", None)
    file = getattr(sys.modules.get(module or ""), "__file__", None)
    if not name.isidentifier() or file is None:
        if here:
            code = function_key(function) or own_text_key(function)
            known = {"module": str(module), "name": name or type(function).__qualname__, "root": ""}
            return known if code is None else known | {"code": code}
        raise TypeError(
            f"{argument} must be a function at the top of a file, which other processes can import, or workers 0, got "
            f"{function!r}"
        )
    path, parts = Path(file).absolute(), str(module).split(".")
    if parts[0] == packmech.__name__ or is_installed(path):
        return {"module": str(module), "name": name, "root": ""}
    stem = path.with_suffix("") if path.stem != "__init__" else path.parent
    if list(stem.parts[-len(parts) :]) == parts:
        return {"module": str(module), "name": name, "root": str(stem.parents[len(parts) - 1])}
    return {"module": path.stem, "name": name, "root": str(path.parent)}


def _with_text(reference: dict[str, str]) -> dict[str, str]:
    """Return a reference that also says what the function is written as; of an installed one its name says enough."""
    path = _file_of(reference)
    key = None if path is None else text_key(path, reference["name"])
    return reference if key is None else reference | {"text": key}


def _file_of(reference: Mapping[str, str]) -> Path | None:
    """Return the file of a function of a user's; None of one that is installed, or stands in none."""
    module, root = reference["module"], reference["root"]
    if root:
        stem = Path(root, *module.split("."))
        return next((one for one in (stem.with_suffix(".py"), stem / "__init__.py") if one.is_file()), None)
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or module.partition(".")[0] == packmech.__name__ or is_installed(Path(file).absolute()):
        return None
    return Path(file).absolute() if Path(file).suffix == ".py" else None


def is_installed(path: Path) -> bool:
    """Whether a file lies where Python looks for packages by itself."""
    return any(Path(one) in path.parents for one in (*site.getsitepackages(), site.getusersitepackages()))


def function_at(
    reference: Mapping[str, str], argument: str = "job", given: Functions | None = None
) -> Callable[..., Any]:
    """Return the function that a reference names: that of this name which was given, or the one in its module.

    Raises
    ------
    ValueError
        If it is not there.

    """
    module, name, root = reference["module"], reference["name"], reference["root"]
    if given and name in given:
        return given[name]
    if not name.isidentifier():
        raise ValueError(
            f"{argument} must be at the top of a file, which any process can import, got {name}: what was run here "
            "with workers 0 goes on by the same call of run_ensemble"
        )
    loaded = sys.modules.get("__main__")
    file = getattr(loaded, "__file__", None)
    if root and file is not None and Path(file).absolute() == Path(root, f"{module}.py"):
        # the script that is running; imported by its name it would run again
        found = getattr(loaded, name, None)
    else:
        if root and root not in sys.path:
            sys.path.insert(0, root)
        try:
            found = getattr(importlib.import_module(module), name, None)
        except Exception as error:
            raise ValueError(f"{argument} must be in a module that can be imported, got {module}: {error}") from error
    if not callable(found):
        raise ValueError(f"{argument} must be a function, got {module}:{name}, which is {found!r}")
    path = _file_of(reference) if "text" in reference else None
    if path is not None and first_text_key(found, path, name) != reference["text"]:
        raise ValueError(
            f"{argument} must be written as when the folder was made, got a changed {name} in {path.name}: run it into "
            "a new folder"
        )
    return found  # type: ignore[no-any-return]


def check_functions(table: Mapping[str, Any]) -> None:
    """Refuse a job of functions that have changed since its folder was made, before anything is run.

    Raises
    ------
    ValueError
        Naming the function.

    """
    for argument, one in [("job", table.get("function")), *(("measures", one) for one in table["measures"] or ())]:
        if isinstance(one, Mapping):
            function_at(one, argument)


def check_trusted(table: Mapping[str, Any], trust: bool) -> None:
    """Refuse to run code that a folder names, and packmech does not have, before any of it is imported.

    Raises
    ------
    ValueError
        Naming the functions and the files, unless they are to be trusted.

    """
    measures = [one for one in table["measures"] or () if isinstance(one, Mapping)]
    # packmech's own measures are given packings alone; any other call of its takes what the folder says
    functions = [one for one in measures if one["root"] or str(one["module"]).partition(".")[0] != packmech.__name__]
    functions += [one for one in [table.get("function")] if isinstance(one, Mapping)]
    named = [
        f"{one['name']} of {one['root'] or 'module'}{'/' if one['root'] else ' '}{one['module']}" for one in functions
    ]
    named += [str(one) for one in table["load"]]
    if named and not trust:
        raise ValueError(
            f"trust must be True (--trust) for a folder whose job runs code of others, got False and "
            f"{', '.join(named)}: look at them first, or call run_ensemble with the function itself"
        )


def check_parameters(table: Mapping[str, Any], member: Member, given: Functions | None = None) -> None:
    """Refuse a grid whose parameters the job does not have, before anything is run.

    Raises
    ------
    ValueError
        Naming the parameter.

    """
    if "function" in table:
        # whoever runs members looks at the text: this process may have imported one that was edited since
        named = {part: value for part, value in table["function"].items() if part != "text"}
        _arguments(function_at(named, given=given), member, Path())
    else:
        _scene(table, member)


def _arguments(function: Callable[..., Any], member: Member, folder: Path) -> dict[str, Any]:
    """Return what a function is called with: its parameters, and what else it asks for by name."""
    signature = inspect.signature(function)
    own = {"random_seed": member.random_seed, "folder": folder}
    given = {name: value for name, value in own.items() if name in signature.parameters} | member.parameters
    try:
        signature.bind(**given)
    except TypeError as error:
        raise ValueError(
            f"grid must name the parameters of {getattr(function, '__name__', 'the job')}{signature}, got "
            f"{', '.join(member.parameters)}: {error}"
        ) from error
    return given


def _scene(table: Mapping[str, Any], member: Member) -> Scene:
    """Return the scene of a member: with its values, from a start that is drawn for it."""
    changes = {name: value for name, value in member.parameters.items() if name != "seed"}
    given = member.parameters.get("seed")
    random = is_random(table["scene"])
    seed = given
    if table["seeding"] == "parameters" and "packing.seed" not in changes and (random or given is not None):
        seed = member.random_seed
    return scene_of_tables(table["scene"], Path(table["folder"]), seed=seed, changes=changes, name=table["name"])


def run_member(table: Mapping[str, Any], member: Member, folder: Path, given: Functions | None = None) -> MemberOutcome:
    """Return what comes of a member.

    Parameters
    ----------
    table
        The job.
    member
        The member.
    folder
        Its folder, where a run that takes checkpoints leaves one and goes on from it.
    given
        Functions of the job by name that no module need have.

    Raises
    ------
    Exception
        Whatever the job raises; NotConverged if a run is no success, unless that is not to be checked.

    """
    began = time.process_time()
    load_modules([Path(one) for one in table["load"]])
    if "function" in table:
        function = function_at(table["function"], given=given)
        made = function(**_arguments(function, member, folder))
        found = _of_run(made, table) if isinstance(made, Run) else _of_value(made)
        wanted = table["measures"]
        if wanted is not None:
            found = dataclasses.replace(found, values=_chosen(found.values, wanted))
    else:
        scene = _scene(table, member)
        checkpoint = folder / CHECKPOINT if takes_checkpoint(scene) else None
        found = _of_scene(run_drive(scene, checkpoint=checkpoint), scene, table, given)
    if not table["keep_packings"]:
        found = dataclasses.replace(found, packings={})
    return dataclasses.replace(found, seconds=time.process_time() - began)


def _of_scene(run: Any, scene: Scene, table: Mapping[str, Any], given: Functions | None) -> MemberOutcome:
    """Return what is measured of a run of a scene."""
    found = _of_run(run, table)
    measures = table["measures"]
    names = None if measures is None else [one for one in measures if isinstance(one, str)]
    values = found.values
    packing = found.packings.get("packing")
    strain = getattr(scene.drive, "examined_strain", None)
    after = scene if packing is None else scene_after(getattr(run, "runs", (run,))[-1], scene)
    if packing is not None and strain is not None:
        for verdict in (False, True):
            lacking = names is not None and not set(names) <= set(values)
            if lacking or (names is None and not verdict):
                report = examine(after, strain=strain, modes=0, verdict=verdict)
                values = _scalars(report.to_dict()) | values
    chosen = values if names is None else _chosen(values, names)
    for one in measures or ():
        if not isinstance(one, str):
            measured = function_at(one, "measures", given)(after)
            chosen |= dict(measured) if isinstance(measured, Mapping) else {one["name"]: measured}
    extra = _of_value(chosen)
    return dataclasses.replace(found, values=extra.values, arrays=extra.arrays)


def _of_run(run: Any, table: Mapping[str, Any]) -> MemberOutcome:
    """Return what a run, or several of a drive, say of themselves; refuse those that are no success."""
    several = getattr(run, "runs", (run,))
    if table["check"]:
        for one in several:
            if isinstance(one, Run) and not one.ok:
                raise NotConverged(one)
    packing = getattr(several[-1], "packing", None)
    # packings and other records that a run reports are texts there
    records = {name for name, value in getattr(run, "report", {}).items() if not isinstance(value, _SCALAR)}
    values = {name: value for name, value in _scalars(run.to_dict()).items() if name not in records}
    return MemberOutcome(values, {}, {} if packing is None else {"packing": packing})


def _scalars(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers and texts among values by name, without what they cost."""
    return {
        name: value
        for name, value in values.items()
        if isinstance(value, bool | int | float | str) and name not in _COSTS
    }


def _chosen(values: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    missing = [name for name in names if name not in values]
    if missing:
        raise ValueError(
            f"measures must be among {', '.join(sorted(values))}, got {', '.join(missing)}"
            f"{did_you_mean(missing[0], values)}"
        )
    return {name: values[name] for name in names}


def _of_value(made: Any) -> MemberOutcome:
    """Return what a function returned: numbers and texts, arrays and packings by name."""
    if dataclasses.is_dataclass(made) and not isinstance(made, type | Packing):
        made = {one.name: getattr(made, one.name) for one in dataclasses.fields(made)}
    elif not isinstance(made, Mapping):
        made = {"packing" if isinstance(made, Packing) else "value": made}
    values: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    packings: dict[str, Packing] = {}
    for name, value in made.items():
        if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN:
            raise ValueError(
                f"job must name what it returns by words other than {', '.join(sorted(_TAKEN))}, got {brief(name)}"
            )
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, Packing):
            packings[name] = value
        elif isinstance(value, bool | str):
            values[name] = value
        elif isinstance(value, numbers.Integral):
            values[name] = int(value)
        elif isinstance(value, numbers.Real):
            values[name] = float(value)
        elif isinstance(value, np.ndarray | list | tuple):
            arrays[name] = np.asarray(value)
            if arrays[name].dtype == object:
                raise TypeError(f"job must return arrays of numbers or texts, got {brief(value)} for {name}")
        elif value is not None:
            raise TypeError(
                f"job must return numbers, texts, arrays and packings by name, got {brief(value)} for {name}"
            )
    return MemberOutcome(values, arrays, packings)
