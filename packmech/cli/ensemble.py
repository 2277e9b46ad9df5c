"""`packmech ensemble`: run a scene or a function over seeds and parameters, and read the results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from packmech.calls.display import in_words, value_with_error
from packmech.check import brief
from packmech.cli import FAILED, OK
from packmech.cli.output import WHOLE, Load, Switch, show, table, working
from packmech.ensemble.drawing import draw_ensemble
from packmech.ensemble.folder import make_members, prepare
from packmech.ensemble.jobs import check_parameters, job_table
from packmech.ensemble.members import members_of, values_in
from packmech.ensemble.row import write_row as write_workflow
from packmech.ensemble.run import Made, MemberSettings, complete_folder, complete_members, member_settings
from packmech.ensemble.statistics import crossover_warning, fit_power_law, group_statistics, varied_parameters
from packmech.ensemble.table import Ensemble, read_ensemble
from packmech.files.packings import is_packing_file
from packmech.files.tables import write_table
from packmech.scenes.recipes import is_random
from packmech.scenes.scene_file import read_scene_tables

Texts = Annotated[list[str] | None, Parameter(consume_multiple=True)]
# failures that status lists, and results that table shows unless they are named
_LISTED, _COLUMNS = 10, 7
# results that come first in tables
_FIRST = (
    "jamming_packing_fraction",
    "packing_fraction",
    "coordination_number",
    "contacts",
    "bulk_modulus",
    "shear_modulus",
    "pressure",
)

Folder = Annotated[Path, Parameter(help="where everything is kept: a signac project")]
Of = Annotated[Texts, Parameter(help="results that it is about, named as in the table (default: numbers that vary)")]
Workers = Annotated[
    int | None,
    WHOLE,
    Parameter(help="processes on this machine (default: one for each core); 0: the command's own, without limits"),
]
Scheduler = Annotated[
    str | None,
    Parameter(
        help="address of a Dask scheduler, such as tcp://10.0.0.1:8786, whose workers see the folder at the same path"
    ),
]
Part = Annotated[str | None, Parameter(help="K/N: only this part, for array jobs")]
Members = Annotated[Texts, Parameter(help="only these, named by their folders")]
Trust = Annotated[Switch, Parameter(help="run the functions and files that the folder names: look at them first")]
Group = Annotated[int | None, WHOLE, Parameter(help="members that a scheduler, or a job of row, is given at once")]
TimeLimit = Annotated[
    float | None, Parameter(help="of each member, without compiling [s]; a member beyond it is ended and has failed")
]
MemoryLimit = Annotated[float | None, Parameter(help="of each member's process [MB]")]

ensemble = App(
    name="ensemble",
    help="Run a scene or a function over seeds and parameters; the same command goes on with what is missing.",
    help_format="plaintext",
    default_parameter=Parameter(negative=()),
)


@ensemble.default
def run_members(
    job: Annotated[str, Parameter(help="a scene file, a shipped scene, or file.py:function")],
    /,
    *,
    folder: Folder = Path("ensemble"),
    seeds: str | None = None,
    grid: Texts = None,
    set: Texts = None,
    measures: Texts = None,
    same_starts: Switch = False,
    no_packings: Switch = False,
    load: Load = (),
    workers: Workers = None,
    scheduler: Scheduler = None,
    part: Part = None,
    group: Group = None,
    time_limit: TimeLimit = None,
    memory_limit: MemoryLimit = None,
    write_row: Switch = False,
) -> int:
    """Run a scene or a function over seeds and parameters; the same command goes on with what is missing.

    Parameters
    ----------
    seeds
        of random starts, such as 0:1000
    grid
        further parameters and their values: "effects.friction.coefficient=0.01:1:20:log" or "packing.particles=32,64"
    set
        NAME=VALUE, a field that is the same for all members, such as drive.applied_strain=20
    measures
        results to keep, named as in `packmech jam --json` (default: counts, moduli and what the run reports)
    same_starts
        the same random starts for every value of the other parameters; else all members are independent. With one seed,
        or with none (that of the scene), starts are always the same
    no_packings
        do not keep packings
    write_row
        write row's workflow.toml and the folders of all members; run nothing

    """
    if is_packing_file(job):
        raise ValueError(
            f"job must be a scene or file.py:function, got the packing {job!r}: packmech new my.toml --packing {job} "
            "makes a scene of it"
        )
    asked = _grid(seeds, [*(grid or ()), *(set or ())])
    # a function draws from what it is given
    same = same_starts or (":" not in job and len(asked.get("seed", ())) < 2)
    kept: dict[str, Any] = {
        "measures": measures,
        "seeding": "seed" if same else "parameters",
        "keep_packings": not no_packings,
        "load": load,
    }
    if write_row:
        written = job_table(job, **kept)
        wanted = members_of(asked)
        check_parameters(written, wanted[0])
        prepare(folder.absolute(), written)
        make_members(folder.absolute(), wanted)
        options = [
            f"--{name.replace('_', '-')} {value:g}"
            for name, value in (("time_limit", time_limit), ("memory_limit", memory_limit))
            if value is not None
        ]
        path = write_workflow(folder, group=group or 100, seconds=time_limit or 60.0, options=" ".join(options))
        show(f"wrote {path} and {len(wanted)} members; in {folder}: row submit")
        return OK
    limits = _limits(workers, group, time_limit, memory_limit)
    code = _carried_out(
        scheduler,
        lambda settings: complete_members(job, asked, folder, settings, part=part, **kept),
        limits,
    )
    if ":" not in job and "packing.seed" not in asked:
        show(_starts(job, asked, same))
    return code


@ensemble.command
def status(*, folder: Folder = Path("ensemble")) -> int:
    """Say what is done, and why members failed; the exit code is 1 if any did."""
    return _status(read_ensemble(folder))


@ensemble.command(name="table")
def table_of_members(*, folder: Folder = Path("ensemble"), out: Path | None = None, of: Of = None) -> int:
    """Print means over seeds with bootstrap errors, and write every member to a .parquet or .csv file.

    Parameters
    ----------
    out
        the file (default: table.parquet in the folder)

    """
    return _table(read_ensemble(folder), folder / "table.parquet" if out is None else out, of)


@ensemble.command
def plot(
    *,
    folder: Folder = Path("ensemble"),
    out: Path | None = None,
    of: Of = None,
    over: str | None = None,
    statistic: str = "mean",
    log: Switch = False,
    fit: Switch = False,
) -> int:
    """Draw a result's spread and its statistic over a parameter, and print its values; of several, a picture each.

    Parameters
    ----------
    out
        the picture (default: plot.png in the folder)
    over
        parameter along the axis (default: the first that varies)
    statistic
        mean, width or median
    log
        logarithmic axes
    fit
        fit a power law to the statistic over the parameter

    """
    return _plot(read_ensemble(folder), folder / "plot.png" if out is None else out, of, over, statistic, log, fit)


@ensemble.command
def resume(
    *,
    folder: Folder = Path("ensemble"),
    members: Members = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    part: Part = None,
    group: Group = None,
    time_limit: TimeLimit = None,
    memory_limit: MemoryLimit = None,
    trust: Trust = False,
) -> int:
    """Run what is missing of an ensemble, with the job and the parameters that its folder holds."""
    return _resumed(folder, members, part, scheduler, trust, False, _limits(workers, group, time_limit, memory_limit))


@ensemble.command
def retry(
    *,
    folder: Folder = Path("ensemble"),
    members: Members = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    part: Part = None,
    group: Group = None,
    time_limit: TimeLimit = None,
    memory_limit: MemoryLimit = None,
    trust: Trust = False,
) -> int:
    """Run what is missing of an ensemble, and what failed again."""
    return _resumed(folder, members, part, scheduler, trust, True, _limits(workers, group, time_limit, memory_limit))


def _limits(
    workers: int | None, group: int | None, time_limit: float | None, memory_limit: float | None
) -> dict[str, Any]:
    """Return what bounds a run of members, as arguments of `member_settings`."""
    memory = None if memory_limit is None else memory_limit * 1e6
    return {"time_limit": time_limit, "memory_limit": memory, "group": group, "workers": workers}


def _resumed(
    folder: Path,
    members: list[str] | None,
    part: str | None,
    scheduler: str | None,
    trust: bool,
    retry: bool,
    limits: dict[str, Any],
) -> int:
    """Go on with an ensemble; return the exit code."""
    names = None if members is None else [Path(one).name for one in members]
    return _carried_out(
        scheduler,
        lambda settings: complete_folder(folder, settings, members=names, part=part, trust=trust),
        {"retry": retry, **limits},
    )


def _starts(job: str, asked: dict[str, Any], same: bool) -> str:
    """Return which random starts the members of a scene have, in words."""
    if not is_random(read_scene_tables(job)[0]):
        return "starts: the packing of the scene"
    if not same:
        return "starts: drawn for each member by itself (--same-starts: one for each seed, whatever the other values)"
    if "seed" not in asked:
        return "starts: of the scene's own seed for each member (--seeds 0:10 for several)"
    return "starts: one for each seed, whatever the other values"


def _grid(seeds: str | None, grid: list[str] | None) -> dict[str, Any]:
    """Return the grid that the command line says."""
    found: dict[str, Any] = {}
    for text in grid or ():
        name, given, values = text.partition("=")
        if not given or name in found:
            raise ValueError(f"grid must be NAME=VALUES, each name once, got {brief(text)}")
        found[name] = values_in(values)
    if seeds is not None:
        found["seed"] = values_in(seeds, "seeds")
    if not found:
        raise ValueError("seeds or grid must be given, got neither")
    return found


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Executor | None]:
    """Give the executor of a Dask scheduler; None without one."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError(
            "scheduler must be left out where dask.distributed is missing; pip install 'packmech[cluster]' brings it"
        ) from error
    try:
        client = Client(scheduler, timeout=20, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConnectionError(
            f"scheduler must be the address of one that answers, got {brief(scheduler)}: {error}"
        ) from error
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=5)


def _carried_out(scheduler: str | None, complete: Callable[[MemberSettings], Made], limits: dict[str, Any]) -> int:
    """Run members with progress on standard error, and report the result; return the exit code."""
    with (
        working("ensemble") as say,
        _executor(scheduler) as executor,
    ):
        settings = member_settings(executor, progress=lambda stage, figures: say(_progress_words(figures)), **limits)
        made = complete(settings)
    return _status(read_ensemble(made.folder))


def _progress_words(figures: dict[str, Any]) -> str:
    """Return progress in words: what is done, how fast, and how long it will take."""
    words = [f"ensemble: {figures['done']} of {figures['of']}"]
    if figures["failed"]:
        words.append(f"{figures['failed']} failed")
    if math.isfinite(figures["rate"]):
        rate = figures["rate"]
        words.append(f"{rate:.3g} a second" if rate >= 1.0 else f"{60.0 * rate:.3g} a minute")
        words.append(f"{_time_words(figures['seconds_left'])} left")
    if figures.get("busy"):
        words.append(f"waiting for {figures['busy']} that another command runs")
    return ", ".join(words)


def _time_words(seconds: float) -> str:
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    return f"{whole // 3600} h {whole // 60 % 60:02d} min" if whole >= 3600 else f"{whole // 60} min"


def _status(found: Ensemble) -> int:
    """Print what is done and why members failed; return whether any did."""
    counts = found.counts()
    show(
        f"{found.folder}: {counts['done']} done, {counts['failed']} failed, {counts['missing']} missing of {len(found)}"
    )
    seconds = found["seconds"].astype(float)[found["state"] == "done"]
    if len(seconds):
        show(f"CPU time of a member: {seconds.mean():.3g} s in the mean, {seconds.max():.3g} s the longest")
    failed = [k for k, state in enumerate(found["state"]) if state == "failed"]
    rows = []
    for k in failed[:_LISTED]:
        asked = ", ".join(f"{name} = {in_words(value)}" for name, value in found.members[k].parameters.items())
        rows.append((asked, str(found["reason"][k]), str(found["message"][k])))
    if rows:
        show(
            table(
                "failures, with tracebacks in the table; again by: packmech ensemble retry",
                ("member", "reason", ""),
                rows,
                right=(),
            )
        )
    if len(failed) > _LISTED:
        show(f"and {len(failed) - _LISTED} more")
    if counts["done"]:
        show(f"results: packmech ensemble table --folder {found.folder}")
    return FAILED if failed else OK


def _results(found: Ensemble, of: list[str] | None) -> list[str]:
    """Return the results that are meant: those named, else those of numbers that vary, the best known first."""
    if of:
        return of
    numbers = [name for name in found.results if found[name].dtype.kind in "if" and len(set(found[name].tolist())) > 1]
    return sorted(numbers, key=lambda name: _FIRST.index(name) if name in _FIRST else len(_FIRST))


def _table(found: Ensemble, path: Path, of: list[str] | None) -> int:
    """Write the table and print means over seeds."""
    write_table(found, path)
    names = _results(found, of)[: None if of else _COLUMNS]
    if names and found.counts()["done"]:
        means = [group_statistics(found, name) for name in names]
        varied = varied_parameters(found)
        rows = []
        for g in range(len(means[0])):
            cells = [value_with_error(one.value_g[g], one.error_g[g]) for one in means]
            rows.append((*(in_words(means[0].by[name][g]) for name in varied), str(means[0].count_g[g]), *cells))
        head = (*varied, "members", *(name.replace("_", " ") for name in names))
        show(table("means with bootstrap errors", head, rows))
    show(f"wrote {path}: {len(found)} rows")
    return OK


def _plot(
    found: Ensemble, path: Path, of: list[str] | None, over: str | None, statistic: str, log: bool, fit: bool
) -> int:
    """Draw a result, fit it if that is wanted, and print its values."""
    names = _results(found, of)
    if not names:
        raise ValueError(f"of must name a result of numbers, got none among {', '.join(found.results) or 'no results'}")
    if of and len(of) > 1:
        for one in of:
            _plot(found, path.with_stem(f"{path.stem}_{one}"), [one], over, statistic, log, fit)
        return OK
    name, law = names[0], None
    if fit:
        varied = varied_parameters(found)
        axis = over or (varied[0] if varied else "")
        groups = group_statistics(found, name, [axis], statistic=statistic)
        if len(set(groups.by[axis].tolist())) < 3:
            raise ValueError(f"fit must have three values of {axis} or more, got {len(set(groups.by[axis].tolist()))}")
        law = fit_power_law(groups.by[axis], groups.value_g, groups.error_g)
    drawn = draw_ensemble(found, name, path, over=over, statistic=statistic, log=log, fit=law)
    rows = [
        (
            *(in_words(column[g]) for column in drawn.by.values()),
            str(drawn.count_g[g]),
            f"{drawn.value_g[g]:.6g}",
            "" if math.isnan(drawn.error_g[g]) else f"{drawn.error_g[g]:.2g}",
        )
        for g in range(len(drawn))
    ]
    show(table(f"{statistic} of {name.replace('_', ' ')}", (*drawn.by, "members", statistic, "+-"), rows))
    if law is not None:
        show(
            f"{statistic} = ({value_with_error(law.prefactor, law.prefactor_error)}) "
            f"x^({value_with_error(law.exponent, law.exponent_error)}), "
            f"chi^2 {law.chi_square:.2f} per degree of freedom"
        )
        if words := crossover_warning(found, name, axis):
            show(words)
    show(f"wrote {path}")
    return OK
